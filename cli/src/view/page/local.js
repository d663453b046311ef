// A stream of the engine in this page, with the same interface as the program's socket: the same messages except
// `status`.

/** Polling interval for frames, milliseconds. */
const LOOK = 8;

/** The engine and its model, loaded once for all streams of the page. */
let loaded = null;

async function load({ package: address, model, precision }, onProgress) {
  const { Avatar, Follower } = await import(new URL(address, document.baseURI).href);
  return { avatar: await Avatar.create({ model, precision, onProgress }), Follower };
}

/** The engine, and a character's follower if the page shows one. */
async function ready(scene, onProgress) {
  loaded ??= load(scene.live.engine, onProgress);
  try {
    const { avatar, Follower } = await loaded;
    const { character } = scene;
    if (character) character.follower ??= new Follower(character.file, avatar.model, character.given ?? {});
    return avatar;
  } catch (error) {
    // Let the next stream try again.
    loaded = null;
    throw error;
  }
}

/** A character dropped onto the page, in the format of the scene's. */
export async function follow(scene, file, onProgress) {
  const character = { file, streamed: null };
  await ready({ ...scene, character }, onProgress);
  return { ...character, nodes: character.follower.description.nodes };
}

export class LocalStream {
  constructor(scene) {
    this.scene = scene;
    this.readyState = WebSocket.CONNECTING;
    for (const name of ["onopen", "onmessage", "onclose", "onprogress"]) this[name] = () => {};
    this.open().catch((error) => this.end(error.message));
  }

  async open() {
    LocalStream.newest = this;
    this.avatar = await ready(this.scene, (progress) => LocalStream.newest.onprogress(progress));
    if (this.readyState !== WebSocket.CONNECTING) return;
    this.readyState = WebSocket.OPEN;
    this.onopen();
  }

  /** A command in JSON, or samples of 16 bits. */
  send(data) {
    const said = typeof data === "string" ? this.command(JSON.parse(data)) : this.avatar.call("push", Float32Array.from(data, (sample) => sample / 32_768));
    said.catch((error) => this.end(error.message));
  }

  async command({ type, rate, voice }) {
    if (type === "finish") return this.avatar.call("finish");
    if (type === "stats") return;
    const { joints, face, character, live } = this.scene;
    const { latency, mouthLatency } = await this.avatar.call("session", { ...live.engine.session, sampleRate: rate, voice });
    for (const [parameter, value] of live.engine.parameters) await this.avatar.call("set", parameter, value);
    const floats = 4 * joints.length + 3 + face.names.length + (character?.worn ?? 0);
    this.tell({ type: "ready", floats, latency_samples: latency * rate, mouth_samples: mouthLatency * rate });
    return this.work();
  }

  /** Emits frames as they are computed, until the stream ends. */
  async work() {
    let count = 0;
    while (this.readyState === WebSocket.OPEN) {
      const { frames, isDone } = await this.avatar.call("pull");
      if (this.readyState !== WebSocket.OPEN) return;
      if (frames.length > 0) this.onmessage({ data: packed(frames, this.scene.character) });
      count += frames.length;
      if (isDone) {
        this.tell({ type: "done", frames: count });
        return this.end("");
      }
      await new Promise((done) => setTimeout(done, LOOK));
    }
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

/** Frames in message format: the index of the first, then for each its values and the character's. */
function packed(frames, character) {
  // Expressions are already included in the weights of their shapes.
  const worn = (frame) => (character ? character.follower.values(frame).slice(0, character.worn) : []);
  const rows = frames.map((frame) => [frame.rotations, frame.translation, frame.face, worn(frame)]);
  const width = rows[0].reduce((sum, part) => sum + part.length, 0);
  const size = 16 + 4 * width;
  const message = new ArrayBuffer(8 + size * frames.length);
  const view = new DataView(message);
  view.setUint8(0, 1);
  view.setUint16(2, frames.length, true);
  view.setUint32(4, width, true);
  rows.forEach((row, i) => {
    const start = 8 + size * i;
    view.setBigUint64(start, BigInt(frames[i].index), true);
    const values = new Float32Array(message, start + 16, width);
    row.reduce((at, part) => (values.set(part, at), at + part.length), 0);
  });
  return message;
}
