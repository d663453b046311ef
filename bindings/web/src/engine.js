// The engine on this thread: models, sessions and poses, over the C interface of `umo.wasm`. In a page, run it in a
// worker (`avatar.js`, `worker.js`); in Node it can be called directly.

const ABI = 1;
const POLLED = 1;
const AXES_GLTF = 0;
const ABSENT = 0xffff_ffff;
const PRECISIONS = { stored: 0, f32: 1, bf16: 2, int8: 3 };
const VOICES = { delayed: 0, live: 1 };
const PACKETS = { none: 0, besideFrames: 1, only: 2 };
/** Session options whose values are names. */
const NAMED = { voice: VOICES, packets: PACKETS };
const STATUS_BUFFER_TOO_SMALL = -5;

/** Names of the statuses of `umo.h`, from -1 down. */
const STATUSES = [
  "NULL_POINTER", "INVALID_HANDLE", "INVALID_ARGUMENT", "STRUCT_SIZE", "BUFFER_TOO_SMALL", "VERSION", "IO", "MODEL", "OUT_OF_MEMORY",
  "FULL", "BUSY", "FINISHED", "FAILED", "CLOSED", "PANIC", "UNSUPPORTED", "STATE", "THREAD", "PACKET",
];

/** Parameters of `session.set`. */
export const Parameter = Object.freeze({
  temperature: 1, topK: 2, topP: 3, idle: 4, attention: 5, gainFace: 16, gainHands: 17, gainUpper: 18, gainLower: 19, layerGaze: 32,
  layerIdle: 33, layerAsymmetry: 34, layerNods: 35, layerMood: 36, layerFeet: 37,
});
/** Moods of `session.mood`. */
export const Mood = Object.freeze({ neutral: 0, joy: 1, sad: 2, angry: 3, surprised: 4, disgusted: 5, afraid: 6 });
/** Values of `Parameter.attention`. */
export const Attention = Object.freeze({ auto: 0, idle: 1, listening: 2, thinking: 3, speaking: 4 });
/** Values of `Parameter.idle` and of the option `idle` of a session. */
export const Idle = Object.freeze({ hold: 0, rest: 1, live: 2 });
const SIDES = { auto: 0, left: 1, right: 2, both: 3 };

/** A failed call: `status` is the status name in `umo.h`. */
export class UmoError extends Error {
  constructor(status, message) {
    super(`${status}: ${message}`);
    this.name = "UmoError";
    this.status = status;
  }
}

/** Sizes and offsets of the structures of `umo.h` where pointers have 32 bits. */
const MODEL_CONFIG = { size: 20, precision: 4, isa: 8 };
const ENGINE_CONFIG = { size: 36, mode: 4, threads: 8, maxSessions: 12, maxBatch: 16 };
const SESSION_CONFIG = {
  size: 80, sampleRate: 4, channels: 8, target: 12, lookahead: 16, idle: 20, idleAfterMs: 24, easeMs: 28, queueFrames: 32, voice: 36, seed: 40,
  smoothing: 56, guidance: 60, horizon: 64, packets: 68, packetHistory: 72, patience: 76,
};
const MODEL_INFO = {
  frameRate: 4, sampleRate: 8, joints: 12, channels: 16, isArkit: 20, keyframeStride: 24, target: 28, maxTarget: 32, lookahead: 36,
  latencyFrames: 40, maxPrompt: 44, hasText: 48, hasNotice: 52,
};
const INFO = { size: 72, hasMouth: 64 };
const LAYOUT = { size: 48, stride: 8, index: 12, sample: 16, translation: 20, rotations: 24, channels: 32, visemes: 40 };
const SAMPLED = { size: 24, isAhead: 4, oldest: 8, newest: 16 };
const LATENCY = { size: 72, algorithmic: 8, mouth: 64 };
const DECODER_STATS = { size: 40, packets: 8, late: 16, lost: 24, held: 32 };
const GESTURE = { size: 48, side: 4, hasTarget: 12, at: 16, speed: 24, strength: 28, target: 32 };

/** Size of the buffer for structures and texts, and maximum samples per push. */
const SCRATCH = 4096;
const CHUNK = 16_384;

/** The module's memory and functions. */
export class Library {
  /** Instantiates a compiled module. */
  static async load(module) {
    return new Library(await WebAssembly.instantiate(module, {}));
  }

  constructor(instance) {
    this.exports = instance.exports;
    this.trap = null;
    this.scratch = this.allocate(SCRATCH);
    this.audio = this.allocate(4 * CHUNK);
    if (this.exports.umo_abi_version() >>> 16 !== ABI >>> 16) throw new UmoError("VERSION", "umo.wasm does not match the version of this package");
  }

  /** Valid until the next call, which may move the memory. */
  get view() {
    return new DataView(this.exports.memory.buffer);
  }

  bytes(at, length) {
    return new Uint8Array(this.exports.memory.buffer, at, length);
  }

  allocate(size) {
    const at = this.run("umo_web_allocate", size);
    if (at === 0) throw new UmoError("OUT_OF_MEMORY", `cannot allocate ${size} bytes`);
    return at;
  }

  text(at) {
    const memory = new Uint8Array(this.exports.memory.buffer);
    return new TextDecoder().decode(memory.slice(at, memory.indexOf(0, at)));
  }

  /** Writes a text with its terminator to the scratch memory at `offset`. */
  write(text, offset) {
    const bytes = new TextEncoder().encode(`${text}\0`);
    if (offset + bytes.length > SCRATCH) throw new UmoError("INVALID_ARGUMENT", "the text is too long");
    this.bytes(this.scratch + offset, bytes.length).set(bytes);
    return { at: this.scratch + offset, length: bytes.length - 1 };
  }

  /** Calls a function. A trap ends the module: it cannot continue. */
  run(name, ...args) {
    if (this.trap) throw this.trap;
    try {
      return this.exports[name](...args);
    } catch (error) {
      this.trap = new UmoError("PANIC", `the engine ended in ${name}: out of memory, or a defect of umo (${error.message})`);
      throw this.trap;
    }
  }

  /** Calls a function that returns a status. */
  call(name, ...args) {
    const status = this.run(name, ...args);
    if (status === 0) return;
    let detail = this.text(this.run("umo_last_error"));
    if (/^umo_(session|decoder)_(?!new)/.test(name) && args[0] && this.run("umo_session_last_error", args[0], this.scratch + 2048, 512, 0) === 0) {
      detail = this.text(this.scratch + 2048) || detail;
    }
    throw new UmoError(STATUSES[-status - 1] ?? `status ${status}`, detail || this.text(this.run("umo_status_message", status)));
  }
}

/** Fetches the bytes of a URL, a `Response`, a buffer or a view. Data that starts with the gzip header is
 * decompressed. */
export async function fetchBytes(source, onProgress) {
  if (source instanceof ArrayBuffer) return unpacked(new Uint8Array(source));
  if (ArrayBuffer.isView(source)) return unpacked(new Uint8Array(source.buffer, source.byteOffset, source.byteLength));
  const response = source instanceof Response ? source : await fetch(source);
  if (!response.ok) throw new UmoError("IO", `${response.url}: ${response.status} ${response.statusText}`);
  const total = Number(response.headers.get("content-length")) || undefined;
  const parts = [];
  let loaded = 0;
  for (const reader = response.body.getReader(); ; ) {
    const { done, value } = await reader.read();
    if (done) break;
    parts.push(value);
    loaded += value.length;
    onProgress?.({ loaded, total });
  }
  const bytes = new Uint8Array(loaded);
  let at = 0;
  for (const part of parts) {
    bytes.set(part, at);
    at += part.length;
  }
  return unpacked(bytes);
}

/** Returns a module, compiled from a URL, a response or bytes unless it already is one. */
export async function compiled(wasm) {
  return wasm instanceof WebAssembly.Module ? wasm : WebAssembly.compile(await fetchBytes(wasm));
}

async function unpacked(bytes) {
  if (bytes[0] !== 0x1f || bytes[1] !== 0x8b) return bytes;
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** A body and a face at one moment: arrays filled by a session. */
export class Pose {
  constructor(model) {
    /** Index of the frame, and the sample of the audio that it belongs to. */
    this.index = 0;
    this.sample = 0;
    /** Position of the root, metres, y up. */
    this.translation = new Float32Array(3);
    /** Rotation of each of `model.jointNames`: x y z w, in its parent's frame. */
    this.rotations = new Float32Array(4 * model.jointNames.length);
    /** Values of `model.channelNames`. */
    this.face = new Float32Array(model.channelNames.length);
    /** Values of `model.visemeNames`; empty if there are none. */
    this.visemes = new Float32Array(model.visemeNames.length);
    /** Whether the requested time is later than the computed frames. */
    this.isAhead = false;
  }
}

/** A model, and an engine that computes its sessions when `compute` is called. */
export class Model {
  #library;
  #model = 0;
  #engine = 0;
  #frame = 0;
  #sessions = new Set();

  /** Loads a model. `wasm` and `model` are URLs, responses or bytes; `wasm` may be a `WebAssembly.Module`. */
  static async load({ wasm, model, precision = "stored", maxSessions = 4, onProgress } = {}) {
    if (!wasm || !model) throw new UmoError("NULL_POINTER", "`wasm` and `model` are needed");
    if (!(precision in PRECISIONS)) throw new UmoError("INVALID_ARGUMENT", `precision ${precision} is not one of ${Object.keys(PRECISIONS)}`);
    const [library, bytes] = await Promise.all([compiled(wasm).then(Library.load), fetchBytes(model, onProgress)]);
    return new Model(library, bytes, precision, maxSessions);
  }

  constructor(library, bytes, precision, maxSessions) {
    this.#library = library;
    const { scratch } = library;
    const config = scratch + 8;
    library.call("umo_model_config_init", config, MODEL_CONFIG.size);
    library.view.setUint32(config + MODEL_CONFIG.precision, PRECISIONS[precision], true);
    const data = library.allocate(bytes.length);
    library.bytes(data, bytes.length).set(bytes);
    try {
      library.call("umo_model_load_memory", ABI, data, bytes.length, config, scratch);
    } finally {
      if (!library.trap) library.run("umo_web_free", data, bytes.length);
    }
    this.#model = library.view.getUint32(scratch, true);
    this.#describe();
    const engine = scratch + 8;
    library.call("umo_engine_config_init", engine, ENGINE_CONFIG.size);
    const view = library.view;
    view.setUint32(engine + ENGINE_CONFIG.mode, POLLED, true);
    view.setUint32(engine + ENGINE_CONFIG.threads, 1, true);
    view.setUint32(engine + ENGINE_CONFIG.maxSessions, maxSessions, true);
    view.setUint32(engine + ENGINE_CONFIG.maxBatch, Math.min(maxSessions, 8), true);
    library.call("umo_engine_new", this.#model, engine, scratch);
    this.#engine = library.view.getUint32(scratch, true);
  }

  #describe() {
    const library = this.#library;
    const { scratch } = library;
    library.view.setUint32(scratch, INFO.size, true);
    library.call("umo_model_get_info", this.#model, scratch);
    const info = library.view;
    for (const [name, offset] of Object.entries(MODEL_INFO)) {
      const value = info.getUint32(scratch + offset, true);
      this[name] = /^(is|has)/.test(name) ? value === 1 : value;
    }
    this.hasMouth = info.getUint32(scratch + INFO.hasMouth, true) === 1;
    const pointer = (name, ...args) => {
      library.call(name, this.#model, ...args, scratch);
      return library.text(library.view.getUint32(scratch, true));
    };
    const texts = [1, 2, 3, 4].map((which) => pointer("umo_model_get_text", which));
    [this.name, this.licence, this.notice, this.isa] = texts;
    this.channelNames = Array.from({ length: this.channels }, (_, i) => pointer("umo_model_get_channel_name", i));
    this.jointNames = Array.from({ length: this.joints }, (_, i) => library.text(library.run("umo_joint_name", i)));
    this.visemeNames = this.isArkit ? Array.from({ length: 15 }, (_, i) => library.text(library.run("umo_viseme_name", i))) : [];
    library.call("umo_model_get_skeleton", this.#model, AXES_GLTF, scratch, scratch + 4 * this.joints, this.joints);
    this.parents = Array.from(new Int32Array(library.exports.memory.buffer, scratch, this.joints));
    this.offsets = Float32Array.from(new Float32Array(library.exports.memory.buffer, scratch + 4 * this.joints, 3 * this.joints));
    library.call("umo_frame_layout_init", scratch, LAYOUT.size, this.#model);
    const layout = library.view;
    this.layout = { size: layout.getUint32(scratch + LAYOUT.stride, true) };
    for (const name of ["index", "sample", "translation", "rotations", "channels", "visemes"]) {
      this.layout[name] = layout.getUint32(scratch + LAYOUT[name], true);
    }
    const bytes = library.bytes(scratch, LAYOUT.size).slice();
    this.#frame = library.allocate(LAYOUT.size + this.layout.size + 8) + 0;
    library.bytes(this.#frame, LAYOUT.size).set(bytes);
  }

  /**
   * Creates a session: one avatar. Options are those of `umo_session_config` in camel case; `voice` is "delayed" or
   * "live", `packets` "none", "besideFrames" or "only".
   */
  session(options = {}) {
    return this.#make("umo_session_new", () => this.#engine, options);
  }

  /** Creates an avatar that is animated by received packets. `target`, `lookahead` and `smoothing` must match the
   * sender's. */
  decoder(options = {}) {
    return this.#make("umo_decoder_new", () => this.#model, options);
  }

  #make(create, from, options) {
    const library = this.#library;
    const config = library.scratch + 8;
    library.call("umo_session_config_init", config, SESSION_CONFIG.size, this.#open());
    const view = library.view;
    for (const [name, value] of Object.entries(options)) {
      const at = config + SESSION_CONFIG[name];
      if (!(name in SESSION_CONFIG) || name === "size") throw new UmoError("INVALID_ARGUMENT", `a session has no option ${name}`);
      const names = NAMED[name];
      if (names && !Object.hasOwn(names, value)) throw new UmoError("INVALID_ARGUMENT", `${name} ${value} is not one of ${Object.keys(names)}`);
      if (name === "seed") view.setBigUint64(at, BigInt(value), true);
      else if (name === "smoothing" || name === "guidance") view.setFloat32(at, value, true);
      else view.setUint32(at, names ? names[value] : value, true);
    }
    library.call(create, from(), config, library.scratch);
    const handle = library.view.getUint32(library.scratch, true);
    const session = new Session(this, library, handle, this.#frame, () => this.#sessions.delete(session));
    this.#sessions.add(session);
    return session;
  }

  /** Computes due work for at most `milliseconds`, but at least one layer; returns whether there is more. */
  compute(milliseconds = Infinity) {
    const library = this.#library;
    this.#open();
    const end = performance.now() + milliseconds;
    for (;;) {
      library.call("umo_engine_poll", this.#engine, 0, library.scratch);
      if (library.view.getUint32(library.scratch, true) === 0) return false;
      if (performance.now() >= end) return true;
    }
  }

  /** The module that it runs in, which also animates characters. */
  get library() {
    return this.#library;
  }

  /** Memory size of the module in bytes. */
  get memory() {
    return this.#library.exports.memory.buffer.byteLength;
  }

  #open() {
    if (this.#model === 0) throw new UmoError("INVALID_HANDLE", "the model was freed");
    return this.#model;
  }

  /** Frees the model and its sessions. Calling it twice is harmless. */
  free() {
    const library = this.#library;
    if (this.#model === 0) return;
    for (const session of [...this.#sessions]) session.free();
    const [model, engine] = [this.#model, this.#engine];
    this.#model = 0;
    if (library.trap) return;
    library.call("umo_engine_free", engine);
    library.call("umo_model_free", model);
    library.run("umo_web_free", this.#frame, LAYOUT.size + this.layout.size + 8);
  }
}

/** One avatar. */
export class Session {
  #model;
  #library;
  #session;
  #layout;
  #frame;
  #freed;
  #hasClock = false;
  #start = performance.now();

  constructor(model, library, session, layout, freed) {
    this.#model = model;
    this.#library = library;
    this.#session = session;
    this.#layout = layout;
    this.#frame = layout + LAYOUT.size;
    this.#freed = freed;
    library.view.setUint32(library.scratch, LATENCY.size, true);
    library.call("umo_session_latency", session, library.scratch);
    /** Maximum number of future audio samples that a frame needs, and its mouth. */
    this.latencySamples = Number(library.view.getBigUint64(library.scratch + LATENCY.algorithmic, true));
    this.mouthSamples = Number(library.view.getBigUint64(library.scratch + LATENCY.mouth, true));
  }

  #call(name, ...args) {
    if (this.#session === 0) throw new UmoError("INVALID_HANDLE", "the session was freed");
    this.#library.call(name, this.#session, ...args);
  }

  /** Takes audio as interleaved 32-bit floats; returns the number of samples taken. */
  push(samples) {
    const library = this.#library;
    let taken = 0;
    do {
      const part = samples.subarray(taken, taken + CHUNK);
      new Float32Array(library.exports.memory.buffer, library.audio, part.length).set(part);
      this.#call("umo_session_push_audio", library.audio, part.length, library.scratch);
      const now = library.view.getUint32(library.scratch, true);
      taken += now;
      if (now < part.length) break;
    } while (taken < samples.length);
    return taken;
  }

  /** Feeds the interlocutor's audio, so that the avatar listens. */
  pushOther(samples) {
    const library = this.#library;
    for (let at = 0; at < samples.length; at += CHUNK) {
      const part = samples.subarray(at, at + CHUNK);
      new Float32Array(library.exports.memory.buffer, library.audio, part.length).set(part);
      this.#call("umo_session_push_other_audio", library.audio, part.length);
    }
  }

  /** Ends the audio. */
  finish() {
    this.#call("umo_session_finish");
  }

  /** Drops frames that were not shown yet and eases to rest. */
  interrupt(easeMs = 200) {
    this.#call("umo_session_interrupt", easeMs);
  }

  /** Returns to the initial state. */
  reset() {
    this.#call("umo_session_reset");
  }

  /** Pulls the ready packets of a session created with `packets`, each a `Uint8Array` to be sent to decoders
   * unchanged. */
  pullPackets() {
    const library = this.#library;
    const { scratch, audio } = library;
    const packets = [];
    for (;;) {
      this.#call("umo_session_pull_packets", audio, 4 * CHUNK, scratch, 1, scratch + 8);
      if (library.view.getUint32(scratch + 8, true) === 0) return packets;
      packets.push(library.bytes(audio, library.view.getUint32(scratch, true)).slice());
    }
  }

  /** Takes a packet from the decoder's sender. Packets may arrive reordered or duplicated. */
  pushPacket(packet) {
    const library = this.#library;
    // Truncate: no valid packet is longer, and a longer one is still refused as malformed.
    const bytes = packet.subarray(0, 4 * CHUNK);
    library.bytes(library.audio, bytes.length).set(bytes);
    this.#call("umo_decoder_push_packet", library.audio, bytes.length);
  }

  /** Statistics of a decoder's packets: taken, late and missing packets; keyframes that were held. */
  get received() {
    const library = this.#library;
    library.view.setUint32(library.scratch, DECODER_STATS.size, true);
    this.#call("umo_decoder_stats", library.scratch);
    const count = (name) => Number(library.view.getBigUint64(library.scratch + DECODER_STATS[name], true));
    return { packets: count("packets"), late: count("late"), lost: count("lost"), held: count("held") };
  }

  /** Pulls the next frame into `pose`; returns false if none is ready. */
  pull(pose) {
    const library = this.#library;
    try {
      this.#call("umo_session_pull_frames", this.#layout, this.#frame, this.#model.layout.size, library.scratch);
    } catch (error) {
      if (error.status === STATUSES[-STATUS_BUFFER_TOO_SMALL - 1]) error.message += " (a defect of umo-web)";
      throw error;
    }
    if (library.view.getUint32(library.scratch, true) === 0) return false;
    this.#read(pose);
    return true;
  }

  /** Samples the pose at motion time `seconds` into `pose` and returns it. */
  samplePose(seconds, pose = new Pose(this.#model)) {
    const library = this.#library;
    // The module has no clock for easing to rest and back.
    if (!this.#hasClock) this.#call("umo_session_set_clock", (performance.now() - this.#start) / 1000);
    library.view.setUint32(library.scratch, SAMPLED.size, true);
    this.#call("umo_session_sample_pose", seconds, this.#layout, this.#frame, this.#model.layout.size, library.scratch);
    const view = library.view;
    pose.isAhead = view.getUint32(library.scratch + SAMPLED.isAhead, true) === 1;
    pose.newest = view.getFloat64(library.scratch + SAMPLED.newest, true);
    this.#read(pose);
    return pose;
  }

  #read(pose) {
    const { layout } = this.#model;
    const view = this.#library.view;
    const floats = (offset, length) => new Float32Array(view.buffer, this.#frame + offset, length);
    pose.index = Number(view.getBigUint64(this.#frame + layout.index, true));
    pose.sample = Number(view.getBigUint64(this.#frame + layout.sample, true));
    pose.translation.set(floats(layout.translation, 3));
    pose.rotations.set(floats(layout.rotations, pose.rotations.length));
    pose.face.set(floats(layout.channels, pose.face.length));
    if (layout.visemes !== ABSENT) pose.visemes.set(floats(layout.visemes, pose.visemes.length));
  }

  /** Number of frames that `pull` would return. */
  get ready() {
    this.#call("umo_session_ready_frames", this.#library.scratch);
    return this.#library.view.getUint32(this.#library.scratch, true);
  }

  /** Whether `finish` was called and all frames were pulled. */
  get isDone() {
    this.#call("umo_session_is_done", this.#library.scratch);
    return this.#library.view.getUint32(this.#library.scratch, true) === 1;
  }

  /** Sets the time in seconds, for pages that are paused or rendered offline. */
  setClock(seconds) {
    this.#hasClock = true;
    this.#call("umo_session_set_clock", seconds);
  }

  /** Sets one of `Parameter`. */
  set(parameter, value) {
    this.#call("umo_session_set_parameter", parameter, value);
  }

  /** Sets a text prompt, for models that take text. */
  prompt(text) {
    const { at, length } = this.#library.write(text, 64);
    this.#call("umo_session_set_prompt", at, length);
  }

  /** Sets one of `Mood` with strength 0 to 1. */
  mood(mood, strength = 1) {
    this.#call("umo_session_set_mood", mood, strength);
  }

  /** Looks at a point in the avatar's space, metres; a strength of 0 stops it. */
  lookAt([x, y, z], strength = 1) {
    const at = this.#library.scratch;
    [x, y, z].forEach((value, i) => this.#library.view.setFloat32(at + 4 * i, value, true));
    this.#call("umo_session_look_at", AXES_GLTF, at, strength);
  }

  /** Plays a gesture by name, at motion time `at` in seconds or as soon as possible. */
  gesture(name, { side = "auto", at = -1, speed = 1, strength = 1, target } = {}) {
    if (!(side in SIDES)) throw new UmoError("INVALID_ARGUMENT", `side ${side} is not one of ${Object.keys(SIDES)}`);
    const library = this.#library;
    const options = library.scratch + 8;
    library.call("umo_gesture_options_init", options, GESTURE.size);
    const view = library.view;
    view.setUint32(options + GESTURE.side, SIDES[side], true);
    view.setFloat64(options + GESTURE.at, at, true);
    view.setFloat32(options + GESTURE.speed, speed, true);
    view.setFloat32(options + GESTURE.strength, strength, true);
    if (target) {
      view.setUint32(options + GESTURE.hasTarget, 1, true);
      target.forEach((value, i) => view.setFloat32(options + GESTURE.target + 4 * i, value, true));
    }
    this.#call("umo_session_play_gesture", library.write(name, 64).at, options);
  }

  /** Frees the session. Calling it twice is harmless. */
  free() {
    if (this.#session === 0) return;
    const session = this.#session;
    this.#session = 0;
    this.#freed();
    if (!this.#library.trap) this.#library.call("umo_session_free", session);
  }
}
