// The stream from the program on this machine: frames as the engine makes them, sound a little later so that both agree.

import { microphone } from "umo/microphone.js";
import { wav } from "umo/scene.js";

/** What is added to what the engine must wait for: the network of one machine, and a slow moment, seconds. */
const MARGIN = 0.12;
/** The same for a mouth that waits for no computing: a piece of the microphone's, and a look for frames. */
const LIVE_MARGIN = 0.04;

/** Time of a stream: behind what is heard by what the engine, or a live mouth, must wait for. */
export class LiveClock {
  constructor(scene, motion) {
    this.motion = motion;
    this.delay = scene.live.algorithmicSeconds + MARGIN;
    this.playing = false;
    this.rate = 1;
    this.at = 0;
    this.ended = () => {};
  }

  get seconds() {
    return this.motion.seconds;
  }

  get time() {
    if (!this.playing) return this.at;
    const sounding = this.sound && !this.sound.paused && !this.sound.ended && this.sound.currentTime > 0;
    const now = sounding ? this.sound.currentTime : this.heard - this.delay;
    this.at = Math.max(this.at, now, 0);
    return this.at;
  }

  /** Seconds of sound since the stream began. */
  get heard() {
    return (performance.now() - this.start) / 1000;
  }

  /** Sound begins now; the picture follows, as late as `started` says. */
  begin(started) {
    this.delay = started.live ? started.mouthSeconds + LIVE_MARGIN : started.bodySeconds + MARGIN;
    [this.start, this.at, this.playing] = [performance.now(), 0, true];
  }

  async play() {}

  pause() {
    this.playing = false;
  }

  /** What was shown can be looked at again once the stream has ended. */
  seek(seconds) {
    if (!this.playing) this.at = Math.min(Math.max(seconds, 0), this.seconds);
  }

  setRate() {}
}

export class Live {
  constructor({ scene, motion, clock, tell, changed }) {
    Object.assign(this, { scene, motion, clock, tell, changed });
    /** What happened, for whoever looks: frames in the order of their coming, frames that came too late. */
    this.log = { received: 0, next: 0, inOrder: true, late: 0, arrivals: [], done: false, error: null, status: null, started: null };
    this.socket = null;
    if (scene.samples.length > 0) this.audio = new Audio(URL.createObjectURL(wav(scene.samples, scene.audio.sampleRate)));
  }

  get isRunning() {
    return this.socket !== null;
  }

  /** Starts a stream of the recording or of the microphone. */
  async start(source) {
    this.stop();
    this.silence();
    this.motion.clear();
    Object.assign(this.log, { received: 0, next: 0, inOrder: true, late: 0, arrivals: [], done: false, error: null, status: null, started: null });
    if (source === "microphone") {
      this.mouth = await microphone((samples) => {
        if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(samples);
      });
    }
    const socket = new WebSocket(`ws://${location.host}/stream`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => socket.send(JSON.stringify({ type: "start", source, rate: this.mouth?.rate ?? null }));
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
    // What came is shown to its end.
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
    this.tell(reason);
  }

  hear(message, source) {
    switch (message.type) {
      case "started":
        this.clock.begin(message);
        this.log.started = message;
        this.mouth?.listen();
        if (source === "recording") this.playSound();
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

  /** The recording's sound, as late as the picture. */
  playSound() {
    const { audio } = this;
    if (!audio) return;
    audio.currentTime = 0;
    this.clock.sound = audio;
    const { socket } = this;
    setTimeout(() => this.socket === socket && audio.play().catch(() => {}), this.clock.delay * 1000);
  }

  /** Frames: number of the first, then values. */
  take(data) {
    const first = new DataView(data).getUint32(0, true);
    const values = new Float32Array(data, 4);
    const count = values.length / this.motion.width;
    this.log.inOrder &&= first === this.log.next && Number.isInteger(count);
    this.log.next = first + count;
    this.log.received += count;
    const { heard } = this.clock;
    if (first / this.motion.rate < this.clock.time) this.log.late += 1;
    this.log.arrivals.push({ first, count, heard });
    if (this.log.arrivals.length > 1000) this.log.arrivals.shift();
    this.motion.append(values);
    this.changed();
  }

  /** Seconds from when a sound was made until its picture is shown, or null while nothing is shown. */
  behind() {
    const { clock, motion } = this;
    if (!clock.playing || motion.count === 0) return null;
    return clock.heard - Math.min(clock.time, (motion.end - 1) / motion.rate);
  }

  /** Seconds from a sound until the frame for it has come: the most of the last frames. */
  arrival() {
    const times = this.log.arrivals.slice(-50).map(({ first, heard }) => heard - first / this.motion.rate);
    return times.length > 0 ? Math.max(...times) : null;
  }
}
