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
/** First byte of a message that holds frames, and bytes before the first frame and before a frame's values. */
const FRAMES = 1;
const HEAD = 8;
const NUMBERS = 16;
/** Interval of requests for statistics, milliseconds. */
const NEWS = 250;
/** Interval at which the played part of the page's recording is sent, milliseconds, and the maximum samples of a message. */
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
    this.delay = started.isLive ? started.mouthSeconds + LIVE_MARGIN : started.bodySeconds + MARGIN;
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

/** Events for debugging: frames in their order of arrival, and messages that came too late. */
const fresh = () => ({ received: 0, next: 0, inOrder: true, late: 0, arrivals: [], pictures: [], worst: {}, done: false, error: null, stats: null, started: null });

/** Samples as messages have them, 16 bits. */
export const whole = (samples) => Int16Array.from(samples, (sample) => Math.max(-32768, Math.min(32767, Math.round(sample * 32768))));

/** Timing of the mouth: as asked for, or with the sound for a microphone. */
const voiceOf = ({ hasMouth, voice }, source) => (hasMouth ? (voice ?? (source === "microphone" ? "live" : "delayed")) : "delayed");

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
        this.socket.send(whole(samples));
        this.sent.samples += samples.length;
        this.sent.now = this.clock.now();
      });
      this.sent.rate = this.mouth.rate;
    }
    const socket = this.scene.live.engine ? new LocalStream(this.scene) : new WebSocket(`ws://${location.host}/v1/session`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onprogress = ({ loaded, total }) => {
      this.log.loading = total ? `${Math.round((100 * loaded) / total)} %` : `${loaded >> 20} MB`;
      this.changed();
    };
    const rate = this.mouth?.rate ?? this.scene.audio.sampleRate;
    const hello = { type: "hello", rate, voice: voiceOf(this.scene.live, source), character: Boolean(this.scene.character) };
    socket.onopen = () => socket.send(JSON.stringify(hello));
    socket.onmessage = ({ data }) => {
      if (this.socket !== socket) return;
      if (typeof data === "string") this.hear(JSON.parse(data), source, hello);
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

  hear(message, source, { rate, voice }) {
    switch (message.type) {
      case "ready":
        if (message.floats !== this.motion.width) {
          this.fail("the program shows another character: reload the page");
          return this.stop();
        }
        this.log.started = { isLive: voice === "live", mouthSeconds: message.mouth_samples / rate, bodySeconds: message.latency_samples / rate };
        this.clock.begin(this.log.started, source === "microphone" ? () => this.spoken() : null);
        this.mouth?.listen();
        this.ask(this.socket);
        if (source === "recording") {
          this.playSound();
          this.speak(this.socket, this.clock.now(), 0);
        }
        break;
      case "stats":
        this.log.stats = message;
        if (this.log.done) this.stop();
        break;
      case "done":
        // The last statistics are those of the whole stream.
        this.log.done = true;
        this.socket.send(JSON.stringify({ type: "stats" }));
        break;
      case "error":
        this.fail(message.reason);
        break;
    }
    this.changed();
  }

  /** Asks for statistics from now on. */
  ask(socket) {
    if (this.socket !== socket || socket.readyState !== WebSocket.OPEN) return;
    socket.send(JSON.stringify({ type: "stats" }));
    setTimeout(() => this.ask(socket), NEWS);
  }

  /**
   * Seconds of the microphone's sound that the engine has taken: sent audio without overruns, plus the time since the
   * last block. Pauses of the page or the machine do not count: frames are numbered by the audio taken, and a clock
   * that kept running would stay ahead of them for ever.
   */
  spoken() {
    const { samples, now, rate } = this.sent;
    const since = samples > 0 ? Math.min(this.clock.now() - now, PIECE) : 0;
    return samples / rate + since;
  }

  /** Sends the part of the recording spoken since `start`, of which `sent` samples were already sent, until its end. */
  speak(socket, start, sent) {
    if (this.socket !== socket || socket.readyState !== WebSocket.OPEN) return;
    const { samples, audio } = this.scene;
    const spoken = Math.min(Math.floor((this.clock.now() - start) * audio.sampleRate), samples.length);
    for (; sent < spoken; sent += MOST_SAMPLES) {
      socket.send(samples.slice(sent, Math.min(sent + MOST_SAMPLES, spoken)));
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
    const view = new DataView(data);
    if (view.getUint8(0) !== FRAMES) return;
    const { width } = this.motion;
    const [count, size] = [view.getUint16(2, true), NUMBERS + 4 * width];
    const first = Number(view.getBigUint64(HEAD, true));
    const values = new Float32Array(count * width);
    for (let i = 0; i < count; i++) values.set(new Float32Array(data, HEAD + i * size + NUMBERS, width), i * width);
    this.log.inOrder &&= first === this.log.next && data.byteLength === HEAD + count * size;
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
