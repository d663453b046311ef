// The stream from the program on this machine, or from the engine in this page: frames are shown as they are computed,
// and sound is delayed to match.

import { LocalStream } from "umo/local.js";
import { microphone } from "umo/microphone.js";
import { wav } from "umo/scene.js";

/** Added to the engine's latency: local network and hiccups, seconds. */
const MARGIN = 0.12;
/** As above for a live mouth, which waits for no computing: one block of the microphone and one poll for frames. */
const LIVE_MARGIN = 0.04;

/** Length of a microphone block with a small reserve, seconds. */
const PIECE = 0.03;
/** Interval in milliseconds at which the page's recording is sent, and maximum samples per message. */
const SEND = 8;
const MOST_SAMPLES = 1 << 14;
/** Maximum drift of a recording's sound before it is moved, and minimum time between moves, seconds. */
const DRIFT = 0.25;
const MOVES_EVERY = 2;
/** Averaging time of the displayed latency, and duration of a problem before it is reported, seconds. */
const NOW = 1;
const LASTING = 4;
/** Messages that arrive within this time count as one, seconds. */
const AT_ONCE = 0.03;
/** Share of late messages above which the machine counts as too slow. */
const TOO_LATE = 0.5;

/** Time of a stream: the sound's time minus the latency of the engine, or of a live mouth. */
export class LiveClock {
  constructor(scene, motion) {
    this.motion = motion;
    this.delay = scene.live.algorithmicSeconds + MARGIN;
    this.playing = false;
    this.rate = 1;
    this.at = 0;
    /** Seconds of some clock; tests replace it. */
    this.now = () => performance.now() / 1000;
    this.ended = () => {};
  }

  get seconds() {
    return this.motion.seconds;
  }

  get time() {
    if (!this.playing) return this.at;
    this.at = Math.max(this.at, this.isSounding ? this.sound.currentTime : this.due, 0);
    return this.at;
  }

  get isSounding() {
    return this.sound && !this.sound.paused && !this.sound.ended && this.sound.currentTime > 0;
  }

  /** Seconds of sound since the stream started. */
  get heard() {
    return this.counted ? this.counted() : this.now() - this.start;
  }

  /** Motion time that should be shown. */
  get due() {
    return this.heard - this.delay;
  }

  /** Sound starts now; the picture follows with the delay given by `started`. `counted` returns the seconds of sound
   * that were sent, if they are counted. */
  begin(started, counted = null) {
    this.delay = started.live ? started.mouthSeconds + LIVE_MARGIN : started.bodySeconds + MARGIN;
    this.counted = counted;
    [this.start, this.at, this.playing] = [this.now(), 0, true];
  }

  async play() {}

  pause() {
    this.playing = false;
  }

  /** After the stream has ended, it can be replayed. */
  seek(seconds) {
    if (!this.playing) this.at = Math.min(Math.max(seconds, 0), this.seconds);
  }

  setRate() {}
}

/** Log for tests: frames in order of arrival, late messages. */
const fresh = () => ({ received: 0, next: 0, inOrder: true, late: 0, arrivals: [], pictures: [], worst: {}, done: false, error: null, status: null, started: null });

export class Live {
  constructor({ scene, motion, clock, changed }) {
    Object.assign(this, { scene, motion, clock, changed });
    this.log = fresh();
    this.socket = null;
    this.useRecording();
  }

  /** Uses the scene's recording. */
  useRecording() {
    const { samples, audio } = this.scene;
    if (samples.length > 0) this.audio = new Audio(URL.createObjectURL(wav(samples, audio.sampleRate)));
  }

  /** Whether the page must send the recording: an engine in the page does not have it, nor a server that of a dropped file. */
  get sends() {
    return Boolean(this.scene.live.engine || this.scene.isDropped);
  }

  get isRunning() {
    return this.socket !== null;
  }

  /** Starts a stream of the recording or of the microphone. */
  async start(source) {
    this.stop();
    this.silence();
    this.motion.clear();
    this.log = fresh();
    this.sent = { samples: 0, now: 0, rate: 1 };
    if (source === "microphone") {
      this.mouth = await microphone((samples) => {
        if (this.socket?.readyState !== WebSocket.OPEN) return;
        this.socket.send(samples);
        this.sent.samples += samples.length;
        this.sent.now = this.clock.now();
      });
      this.sent.rate = this.mouth.rate;
    }
    const socket = this.scene.live.engine ? new LocalStream(this.scene) : new WebSocket(`ws://${location.host}/stream`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onprogress = ({ loaded, total }) => {
      this.log.loading = total ? `${Math.round((100 * loaded) / total)} %` : `${loaded >> 20} MB`;
      this.changed();
    };
    const own = source === "recording" && this.sends;
    const rate = own ? this.scene.audio.sampleRate : (this.mouth?.rate ?? null);
    socket.onopen = () => socket.send(JSON.stringify({ type: "start", source: own ? "page" : source, rate }));
    socket.onmessage = ({ data }) => {
      if (this.socket !== socket) return;
      if (typeof data === "string") this.hear(JSON.parse(data), source);
      else this.take(data);
    };
    socket.onclose = ({ reason }) => {
      if (this.socket !== socket) return;
      if (!this.log.done) this.fail(reason || "the program has ended the stream");
      this.stop();
    };
  }

  stop() {
    const { socket } = this;
    this.socket = null;
    if (socket && socket.readyState <= WebSocket.OPEN) socket.close();
    this.mouth?.stop();
    this.mouth = null;
    // Received frames are shown to the end.
    if (!this.log.done) this.silence();
    this.changed();
  }

  silence() {
    this.clock.sound?.pause();
    this.clock.sound = null;
    this.clock.pause();
  }

  fail(reason) {
    this.log.error = reason;
    this.changed();
  }

  hear(message, source) {
    switch (message.type) {
      case "started":
        this.clock.begin(message, source === "microphone" ? () => this.spoken() : null);
        this.log.started = message;
        this.mouth?.listen();
        if (source === "recording") {
          this.playSound();
          if (this.sends) this.speak(this.socket, this.clock.now(), 0);
        }
        break;
      case "status":
        this.log.status = message;
        break;
      case "done":
        this.log.done = true;
        break;
      case "error":
        this.fail(message.reason);
        break;
    }
    this.changed();
  }

  /**
   * Seconds of the microphone's sound that the engine has taken: sent audio without overruns, plus the time since the
   * last block. Pauses of the page or the machine do not count: frames are numbered by the audio taken, and a clock
   * that kept running would stay ahead of them for ever.
   */
  spoken() {
    const { samples, now, rate } = this.sent;
    const lost = this.log.status?.overruns ?? 0;
    const since = samples > 0 ? Math.min(this.clock.now() - now, PIECE) : 0;
    return Math.max(samples - lost, 0) / rate + since;
  }

  /** Sends the part of the recording spoken since `start`, of which `sent` samples were already sent, until its end. */
  speak(socket, start, sent) {
    if (this.socket !== socket || socket.readyState !== WebSocket.OPEN) return;
    const { samples, audio } = this.scene;
    const spoken = Math.min(Math.floor((this.clock.now() - start) * audio.sampleRate), samples.length);
    for (; sent < spoken; sent += MOST_SAMPLES) {
      socket.send(Float32Array.from(samples.subarray(sent, Math.min(sent + MOST_SAMPLES, spoken)), (sample) => sample / 32_768));
    }
    if (spoken === samples.length) socket.send(JSON.stringify({ type: "finish" }));
    else setTimeout(() => this.speak(socket, start, spoken), SEND);
  }

  /** Plays the recording's sound, delayed like the picture. */
  playSound() {
    const { audio, socket } = this;
    if (!audio) return;
    audio.currentTime = 0;
    this.clock.sound = audio;
    setTimeout(() => this.socket === socket && audio.play().catch(() => {}), this.clock.delay * 1000);
  }

  /** Corrects the position of a recording's sound: a hidden page starts it late, a busy machine stops it. */
  catchUp() {
    const { clock, log } = this;
    if (!clock.isSounding || clock.due - clock.sound.currentTime < DRIFT) return;
    const now = clock.now();
    if (now - (log.moved ?? -Infinity) < MOVES_EVERY || clock.due > clock.sound.duration) return;
    log.moved = now;
    clock.sound.currentTime = clock.due;
  }

  /** Frames: index of the first, then values. */
  take(data) {
    const first = new DataView(data).getUint32(0, true);
    const values = new Float32Array(data, 4);
    const count = values.length / this.motion.width;
    this.log.inOrder &&= first === this.log.next && Number.isInteger(count);
    this.log.next = first + count;
    this.log.received += count;
    const { heard } = this.clock;
    const isLate = first / this.motion.rate < this.clock.time;
    if (isLate) this.log.late += 1;
    const latency = heard - first / this.motion.rate;
    // Messages held up by a stall arrive together and count once.
    if (heard - (this.log.arrivals.at(-1)?.heard ?? -1) < AT_ONCE) this.log.arrivals.pop();
    this.log.arrivals.push({ heard, latency, isLate });
    if (this.log.arrivals.length > 1000) this.log.arrivals.shift();
    this.log.worst.arrival = Math.max(this.log.worst.arrival ?? 0, latency);
    this.motion.append(values);
    this.changed();
  }

  /** Records the latency of the frame being drawn. */
  look() {
    const latency = this.lag();
    if (latency === null) return;
    const { pictures, worst } = this.log;
    pictures.push({ heard: this.clock.heard, latency });
    if (pictures.length > 200) pictures.shift();
    worst.picture = Math.max(worst.picture ?? 0, latency);
  }

  /** Seconds from the sound to the picture at this moment, or null while nothing is shown. */
  lag() {
    const { clock, motion } = this;
    if (!clock.playing || motion.count === 0) return null;
    return clock.heard - Math.min(clock.time, (motion.end - 1) / motion.rate);
  }

  /** Median of the last second. */
  behind() {
    return this.recent(this.log.pictures);
  }

  /** Seconds from a sound to the arrival of its frame: median of the last second. */
  arrival() {
    return this.recent(this.log.arrivals);
  }

  recent(list) {
    if (list.length === 0) return null;
    const since = list.at(-1).heard - NOW;
    return median(list.filter(({ heard }) => heard >= since).map(({ latency }) => latency));
  }

  /** A sentence about a problem of the stream, or an empty text. */
  trouble() {
    const { log, clock } = this;
    if (log.error) return `${log.error[0].toUpperCase()}${log.error.slice(1)}.`;
    if (!this.isRunning || !clock.playing || log.done) return "";
    const { heard } = clock;
    const last = log.arrivals.at(-1)?.heard ?? 0;
    if (heard - last > LASTING + clock.delay) return `No frame has come for ${Math.round(heard - last)} s: this machine is too slow, or the program is held up.`;
    const recent = log.arrivals.filter((one) => one.heard > heard - LASTING);
    const late = recent.filter(({ isLate }) => isLate).length;
    // Must persist: a short stall makes some messages late, then passes.
    const lasts = log.arrivals.length > 0 && heard - log.arrivals[0].heard > LASTING && recent.length >= 4;
    if (!lasts || late < TOO_LATE * recent.length) return "";
    const most = median(recent.map(({ latency }) => latency));
    return `This machine is too slow for the model: frames come ${most.toFixed(1)} s after their sound, later than they are shown.`;
  }
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted.length > 0 ? sorted[sorted.length >> 1] : null;
}
