// A stream of the engine in this page, to the page what the socket of a program is: the same messages, but for `status`.

import { Wearer } from "umo/wearer.js";

/** How often frames are looked for, and the sound of a recording is pushed, milliseconds. */
const LOOK = 8;

/** The engine and its model, loaded once for all streams of the page. */
let loaded = null;

async function load({ package: address, model, precision }, onProgress) {
  const { Avatar } = await import(new URL(address, document.baseURI).href);
  return Avatar.create({ model, precision, onProgress });
}

export class LocalStream {
  constructor(scene) {
    this.scene = scene;
    this.readyState = WebSocket.CONNECTING;
    /** What puts frames on one's own character, where there is one. */
    this.wearer = scene.character ? new Wearer(scene) : null;
    for (const name of ["onopen", "onmessage", "onclose", "onprogress"]) this[name] = () => {};
    this.open().catch((error) => this.end(error.message));
  }

  async open() {
    loaded ??= load(this.scene.live.engine, (progress) => LocalStream.newest.onprogress(progress));
    LocalStream.newest = this;
    try {
      this.avatar = await loaded;
    } catch (error) {
      // The next stream tries again.
      loaded = null;
      throw error;
    }
    if (this.readyState !== WebSocket.CONNECTING) return;
    this.readyState = WebSocket.OPEN;
    this.onopen();
  }

  /** A command in JSON, or samples. */
  send(data) {
    const said = typeof data === "string" ? this.command(JSON.parse(data)) : this.avatar.call("push", data);
    said.catch((error) => this.end(error.message));
  }

  async command({ type, source, rate }) {
    if (type === "finish") return this.avatar.call("finish");
    const { scene } = this;
    const { engine } = scene.live;
    this.rate = source === "recording" ? scene.audio.sampleRate : rate;
    const { hasMouth } = this.avatar.model;
    const voice = hasMouth ? (engine.voice ?? (source === "microphone" ? "live" : "delayed")) : "delayed";
    const { latency, mouthLatency } = await this.avatar.call("session", { ...engine.session, sampleRate: this.rate, voice });
    for (const [parameter, value] of engine.parameters) await this.avatar.call("set", parameter, value);
    if (source === "recording") this.rest = Float32Array.from(scene.samples, (sample) => sample / 32_768);
    this.start = performance.now();
    this.pushed = 0;
    this.tell({ type: "started", live: voice === "live", mouthSeconds: mouthLatency, bodySeconds: latency });
    return this.work();
  }

  /** Gives frames as they are computed, until the stream ends. */
  async work() {
    let count = 0;
    while (this.readyState === WebSocket.OPEN) {
      if (this.rest) await this.hear();
      const { frames, isDone } = await this.avatar.call("pull");
      if (this.readyState !== WebSocket.OPEN) return;
      if (frames.length > 0) this.onmessage({ data: packed(frames, this.wearer) });
      count += frames.length;
      if (isDone) {
        this.tell({ type: "done", frames: count });
        return this.end("");
      }
      await new Promise((done) => setTimeout(done, LOOK));
    }
  }

  /** Pushes what has been spoken of the recording by now. */
  async hear() {
    const spoken = Math.floor(((performance.now() - this.start) / 1000) * this.rate);
    if (spoken > this.pushed) await this.avatar.call("push", this.rest.slice(this.pushed, spoken));
    this.pushed = Math.min(spoken, this.rest.length);
    if (this.pushed < this.rest.length) return;
    this.rest = null;
    await this.avatar.call("finish");
  }

  tell(message) {
    this.onmessage({ data: JSON.stringify(message) });
  }

  close() {
    this.readyState = WebSocket.CLOSED;
  }

  end(reason) {
    if (this.readyState === WebSocket.CLOSED) return;
    this.readyState = WebSocket.CLOSED;
    this.onclose({ reason });
  }
}

/** Frames as a message has them: the number of the first, then the values of each, and those of a character. */
function packed(frames, wearer) {
  const rows = frames.map((frame) => [frame.rotations, frame.translation, frame.face, wearer ? wearer.values(frame) : []]);
  const width = rows[0].reduce((sum, part) => sum + part.length, 0);
  const message = new ArrayBuffer(4 + 4 * width * frames.length);
  new DataView(message).setUint32(0, frames[0].index, true);
  const values = new Float32Array(message, 4);
  rows.forEach((row, i) => row.reduce((at, part) => (values.set(part, at), at + part.length), width * i));
  return message;
}
