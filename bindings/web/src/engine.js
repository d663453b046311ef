// The engine on this thread: models, sessions and poses, over the C interface of `umo.wasm`. In a page, run it in a
// worker (`avatar.js`, `worker.js`); in Node it can be called directly.

import {
  ABI_VERSION, ABSENT, AXES, ENGINE_CONFIG, FRAME_LAYOUT, GESTURE_OPTIONS, LATENCY, MEMBER, MODEL_CONFIG, MODEL_INFO, MODEL_TEXTS, PLACE, RECEIVED,
  ROLES, SAMPLED, SCENE_PARTS, SESSION_CONFIG, STATUSES, VISEME_COUNT,
} from "./generated.js";

/** Names of the statuses by their numbers. */
const STATUS_NAMES = new Map(Object.entries(STATUSES).map(([name, status]) => [status, name]));

/** A failed call: `status` is the status name in `umo.h`. */
export class UmoError extends Error {
  constructor(status, message) {
    super(`${status}: ${message}`);
    this.name = "UmoError";
    this.status = status;
  }
}

/** Key of a session's handle, for scenes. */
const HANDLE = Symbol("handle");

/** Bytes for structures and texts, and samples that one call pushes. */
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
    if (this.exports.umo_abi_version() >>> 16 !== ABI_VERSION >>> 16) throw new UmoError("VERSION", "umo.wasm is of another version than this package");
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

  /** Sets fields of a structure; values that have names by these. */
  set(at, { fields }, values) {
    for (const [field, value] of Object.entries(values)) {
      const [offset, type, names] = fields[field];
      if (names && !Object.hasOwn(names, value)) throw new UmoError("INVALID_ARGUMENT", `${field} ${value}: expected one of ${Object.keys(names)}`);
      const number = names ? names[value] : value;
      this.view[`set${type}`](at + offset, type === "BigUint64" ? BigInt(number) : number, true);
    }
  }

  /** Sets options that a caller gave: fields of a structure that are free to be set. */
  configure(at, structure, options, what) {
    const unknown = Object.keys(options).find((name) => !structure.options.includes(name));
    if (unknown !== undefined) throw new UmoError("INVALID_ARGUMENT", `${what} has no option ${unknown}`);
    this.set(at, structure, options);
  }

  /** A field of a structure, as a number. */
  get(at, { fields }, field) {
    const [offset, type] = fields[field];
    return Number(this.view[`get${type}`](at + offset, true));
  }

  /** Calls a function. A trap ends the module: it has no way to go on. */
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
    const [, kind] = /^umo_(session|decoder|scene)_(?!new)/.exec(name) ?? [];
    const last = kind === "scene" ? "umo_scene_last_error" : "umo_session_last_error";
    if (kind && args[0] && this.run(last, args[0], this.scratch + 2048, 512, 0) === 0) detail = this.text(this.scratch + 2048) || detail;
    throw new UmoError(STATUS_NAMES.get(status) ?? `status ${status}`, detail || this.text(this.run("umo_status_message", status)));
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
  #scenes = new Set();

  /**
   * Loads a model. `wasm` and `model` are URLs, responses or bytes; `wasm` may be a `WebAssembly.Module`. The other options are those of
   * `umo_engine_config`, in camel case.
   */
  static async load({ wasm, model, precision = "stored", onProgress, ...engine } = {}) {
    if (!wasm || !model) throw new UmoError("NULL_POINTER", "`wasm` and `model` are needed");
    const [library, bytes] = await Promise.all([compiled(wasm).then(Library.load), fetchBytes(model, onProgress)]);
    return new Model(library, bytes, precision, engine);
  }

  constructor(library, bytes, precision, { maxSessions = 4, ...options }) {
    this.#library = library;
    const { scratch } = library;
    const config = scratch + 8;
    library.call("umo_model_config_init", config, MODEL_CONFIG.size);
    library.set(config, MODEL_CONFIG, { precision });
    const data = library.allocate(bytes.length);
    library.bytes(data, bytes.length).set(bytes);
    try {
      library.call("umo_model_load_memory", ABI_VERSION, data, bytes.length, config, scratch);
    } finally {
      if (!library.trap) library.run("umo_web_free", data, bytes.length);
    }
    this.#model = library.view.getUint32(scratch, true);
    this.#describe();
    const engine = scratch + 8;
    library.call("umo_engine_config_init", engine, ENGINE_CONFIG.size);
    library.set(engine, ENGINE_CONFIG, { mode: "polled" });
    library.configure(engine, ENGINE_CONFIG, { threads: 1, maxSessions, maxBatch: Math.min(maxSessions, 8), ...options }, "an engine");
    library.call("umo_engine_new", this.#model, engine, scratch);
    this.#engine = library.view.getUint32(scratch, true);
  }

  #describe() {
    const library = this.#library;
    const { scratch } = library;
    library.set(scratch, MODEL_INFO, { structSize: MODEL_INFO.size });
    library.call("umo_model_get_info", this.#model, scratch);
    for (const name of Object.keys(MODEL_INFO.fields)) {
      const value = library.get(scratch, MODEL_INFO, name);
      if (name !== "structSize") this[name] = /^(is|has)/.test(name) ? value === 1 : value;
    }
    const pointer = (name, ...args) => {
      library.call(name, this.#model, ...args, scratch);
      return library.text(library.view.getUint32(scratch, true));
    };
    const text = (which) => pointer("umo_model_get_text", MODEL_TEXTS[which]);
    [this.name, this.licence, this.notice, this.isa] = [text("name"), text("license"), text("notice"), text("isa")];
    this.channelNames = Array.from({ length: this.channels }, (_, i) => pointer("umo_model_get_channel_name", i));
    this.jointNames = Array.from({ length: this.joints }, (_, i) => library.text(library.run("umo_joint_name", i)));
    this.visemeNames = this.isArkit ? Array.from({ length: VISEME_COUNT }, (_, i) => library.text(library.run("umo_viseme_name", i))) : [];
    library.call("umo_model_get_skeleton", this.#model, AXES.gltf, scratch, scratch + 4 * this.joints, this.joints);
    this.parents = Array.from(new Int32Array(library.exports.memory.buffer, scratch, this.joints));
    this.offsets = Float32Array.from(new Float32Array(library.exports.memory.buffer, scratch + 4 * this.joints, 3 * this.joints));
    library.call("umo_frame_layout_init", scratch, FRAME_LAYOUT.size, this.#model);
    this.layout = { size: library.get(scratch, FRAME_LAYOUT, "frameStride") };
    for (const name of ["index", "sample", "translation", "rotations", "channels", "visemes"]) {
      this.layout[name] = library.get(scratch, FRAME_LAYOUT, name);
    }
    const bytes = library.bytes(scratch, FRAME_LAYOUT.size).slice();
    this.#frame = library.allocate(FRAME_LAYOUT.size + this.layout.size + 8) + 0;
    library.bytes(this.#frame, FRAME_LAYOUT.size).set(bytes);
  }

  /**
   * Creates a session: one avatar. Options are those of `umo_session_config` in camel case; `voice` is "delayed" or
   * "live", `packets` "none", "besideFrames" or "only". `language` ("en", "de") has the rules of `hintWords`, and
   * `wordRules` is the text of a file of rules to add.
   */
  session({ language = "en", wordRules, ...options } = {}) {
    this.#open();
    this.#setWordRules(language, wordRules);
    return this.#make("umo_session_new", [this.#engine], options);
  }

  /** Creates an avatar that is animated by received packets. `target`, `lookahead` and `smoothing` must match the
   * sender's. With `take`, the bytes of a `.umo` file, it plays that by `pushTake`, and these settings are the take's. */
  decoder({ take, ...options } = {}) {
    if (take === undefined) return this.#make("umo_decoder_new", [this.#open()], options);
    const library = this.#library;
    const data = library.allocate(take.length);
    let handle;
    try {
      library.bytes(data, take.length).set(take);
      library.call("umo_take_new", data, take.length, library.scratch);
      handle = library.view.getUint32(library.scratch, true);
      return this.#make("umo_decoder_new_of_take", [this.#open(), handle], options);
    } finally {
      if (!library.trap) library.run("umo_web_free", data, take.length);
      if (!library.trap && handle) library.call("umo_take_free", handle);
    }
  }

  /** Creates a scene: sessions of this model that know each other. */
  scene({ seed = 0 } = {}) {
    const library = this.#library;
    this.#open();
    library.call("umo_scene_new", BigInt(seed), library.scratch);
    const scene = new Scene(library, library.view.getUint32(library.scratch, true), () => this.#scenes.delete(scene));
    this.#scenes.add(scene);
    return scene;
  }

  /** Sets the engine's rules, which a new session keeps. */
  #setWordRules(language, toml) {
    const library = this.#library;
    const bytes = new TextEncoder().encode(`${toml ?? ""}\0`);
    const rules = library.allocate(bytes.length);
    library.bytes(rules, bytes.length).set(bytes);
    try {
      library.call("umo_engine_set_word_rules", this.#engine, library.write(language, 64).at, rules);
    } finally {
      if (!library.trap) library.run("umo_web_free", rules, bytes.length);
    }
  }

  #make(create, from, options) {
    const library = this.#library;
    const config = library.scratch + 8;
    library.call("umo_session_config_init", config, SESSION_CONFIG.size, this.#open());
    library.configure(config, SESSION_CONFIG, options, "a session");
    library.call(create, ...from, config, library.scratch);
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

  /** Frees the model, its scenes and its sessions. Calling it twice is harmless. */
  free() {
    const library = this.#library;
    if (this.#model === 0) return;
    for (const made of [...this.#scenes, ...this.#sessions]) made.free();
    const [model, engine] = [this.#model, this.#engine];
    this.#model = 0;
    if (library.trap) return;
    library.call("umo_engine_free", engine);
    library.call("umo_model_free", model);
    library.run("umo_web_free", this.#frame, FRAME_LAYOUT.size + this.layout.size + 8);
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
    this.#frame = layout + FRAME_LAYOUT.size;
    this.#freed = freed;
    library.set(library.scratch, LATENCY, { structSize: LATENCY.size });
    library.call("umo_session_latency", session, library.scratch);
    /** Samples of future audio that a frame needs at most, and its mouth. */
    this.latencySamples = library.get(library.scratch, LATENCY, "algorithmicSamples");
    this.mouthSamples = library.get(library.scratch, LATENCY, "mouthSamples");
  }

  get [HANDLE]() {
    if (this.#session === 0) throw new UmoError("INVALID_HANDLE", "the session was freed");
    return this.#session;
  }

  #call(name, ...args) {
    this.#library.call(name, this[HANDLE], ...args);
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

  /** Computes the frames of the next packet of the decoder's take, if there is room for them; returns whether there may be more. */
  pushTake() {
    this.#call("umo_decoder_push_take", this.#library.scratch);
    return this.#library.view.getUint32(this.#library.scratch, true) === 1;
  }

  /** The take so far of a session created with `takeBytes`: the bytes of a `.umo` file. */
  take() {
    const library = this.#library;
    this.#call("umo_session_take_size", library.scratch);
    const size = library.view.getUint32(library.scratch, true);
    const take = library.allocate(size);
    try {
      this.#call("umo_session_take", take, size, library.scratch);
      return library.bytes(take, library.view.getUint32(library.scratch, true)).slice();
    } finally {
      if (!library.trap) library.run("umo_web_free", take, size);
    }
  }

  /** Statistics of a decoder's packets: taken, late and missing packets; keyframes that were held. */
  get received() {
    const library = this.#library;
    library.set(library.scratch, RECEIVED, { structSize: RECEIVED.size });
    this.#call("umo_decoder_stats", library.scratch);
    const count = (name) => library.get(library.scratch, RECEIVED, name);
    return { packets: count("packets"), late: count("late"), lost: count("lost"), held: count("held") };
  }

  /** Pulls the next frame into `pose`; returns false if none is ready. */
  pull(pose) {
    const library = this.#library;
    try {
      this.#call("umo_session_pull_frames", this.#layout, this.#frame, this.#model.layout.size, library.scratch);
    } catch (error) {
      if (error.status === "BUFFER_TOO_SMALL") error.message += " (a defect of umo-web)";
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
    library.set(library.scratch, SAMPLED, { structSize: SAMPLED.size });
    this.#call("umo_session_sample_pose", seconds, this.#layout, this.#frame, this.#model.layout.size, library.scratch);
    pose.isAhead = library.get(library.scratch, SAMPLED, "isAhead") === 1;
    pose.newest = library.get(library.scratch, SAMPLED, "newest");
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

  /** Arousal of the voice at the newest frame pulled or sampled, 0 to 1; 0.5 for an ordinary voice, and for none. */
  get arousal() {
    this.#call("umo_session_arousal", this.#library.scratch, 0);
    return this.#library.view.getFloat32(this.#library.scratch, true);
  }

  /** Change of the arousal per second, over the last seconds. */
  get arousalTrend() {
    this.#call("umo_session_arousal", this.#library.scratch, this.#library.scratch + 4);
    return this.#library.view.getFloat32(this.#library.scratch + 4, true);
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
    this.#call("umo_session_look_at", AXES.gltf, at, strength);
  }

  /** Gives words and their time, in seconds of the pushed audio: some become gestures. `BUSY` if 64 are queued. */
  hintWords(text, start, end) {
    this.#call("umo_session_hint_words", this.#library.write(text, 64).at, start, end);
  }

  /** Plays a gesture by name, at motion time `at` in seconds or as soon as possible. */
  gesture(name, { side = "auto", at = -1, speed = 1, strength = 1, target, variant = 0 } = {}) {
    const library = this.#library;
    const options = library.scratch + 8;
    library.call("umo_gesture_options_init", options, GESTURE_OPTIONS.size);
    library.set(options, GESTURE_OPTIONS, { side, at, speed, strength, variant, hasTarget: target ? 1 : 0 });
    const [place] = GESTURE_OPTIONS.fields.target;
    target?.forEach((value, i) => library.view.setFloat32(options + place + 4 * i, value, true));
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

/** Avatars that know each other, and people with microphones: up to 32 members, each a number from 1 on. */
export class Scene {
  #library;
  #scene;
  #freed;

  constructor(library, scene, freed) {
    this.#library = library;
    this.#scene = scene;
    this.#freed = freed;
  }

  #call(name, ...args) {
    if (this.#scene === 0) throw new UmoError("INVALID_HANDLE", "the scene was freed");
    this.#library.call(name, this.#scene, ...args);
  }

  /** Writes three values to memory. */
  #point(at, values) {
    values.forEach((value, i) => this.#library.view.setFloat32(at + 4 * i, value, true));
    return at;
  }

  #place({ position = [0, 0, 0], ...rest }) {
    const library = this.#library;
    const at = library.scratch + 8;
    library.call("umo_place_init", at, PLACE.size);
    const unknown = Object.keys(rest).find((name) => name !== "facing" && name !== "eyeHeight");
    if (unknown !== undefined) throw new UmoError("INVALID_ARGUMENT", `a place has no option ${unknown}`);
    library.set(at, PLACE, rest);
    this.#point(at + PLACE.fields.position[0], position);
    return at;
  }

  /** Adds a session, or with `null` a person, whose voice comes by `push`; returns the member's number. */
  add(session, place = {}) {
    const library = this.#library;
    this.#call("umo_scene_add", session === null ? 0 : session[HANDLE], this.#place(place), library.scratch);
    return library.view.getUint32(library.scratch, true);
  }

  /** Removes a member. Its session goes on alone. */
  remove(member) {
    this.#call("umo_scene_remove", member);
  }

  /** Moves a member. */
  setPlace(member, place) {
    this.#call("umo_scene_set_place", member, this.#place(place));
  }

  /** Makes a member look at another, or at a point of the scene, whatever is said; `null` ends it. */
  setTarget(member, target) {
    const [other, point] = typeof target === "number" ? [target, 0] : [0, target ? this.#point(this.#library.scratch, target) : 0];
    this.#call("umo_scene_set_target", member, other, AXES.gltf, point);
  }

  /** Sets the parts that the scene plays of a member: of "look", "nod", "smile", "mirror" and "yield"; all at first. */
  setAllowed(member, parts) {
    let bits = 0;
    for (const part of parts) {
      if (!Object.hasOwn(SCENE_PARTS, part)) throw new UmoError("INVALID_ARGUMENT", `part ${part}: expected one of ${Object.keys(SCENE_PARTS)}`);
      bits |= SCENE_PARTS[part];
    }
    this.#call("umo_scene_set_allowed", member, bits);
  }

  /** Feeds the voice of a member without a session: samples of any rate, of which only the loudness is used. */
  push(member, samples) {
    const library = this.#library;
    for (let at = 0; at < samples.length; at += CHUNK) {
      const part = samples.subarray(at, at + CHUNK);
      new Float32Array(library.exports.memory.buffer, library.audio, part.length).set(part);
      this.#call("umo_scene_push_audio", member, library.audio, part.length);
    }
  }

  /** Advances the scene: once per picture, before poses are pulled or sampled. */
  update(seconds) {
    this.#call("umo_scene_update", seconds);
  }

  /** The member that has the floor; 0 for nobody. */
  get floor() {
    this.#call("umo_scene_floor", this.#library.scratch);
    return this.#library.view.getUint32(this.#library.scratch, true);
  }

  /** State of a member. */
  member(member) {
    const library = this.#library;
    const at = library.scratch;
    library.set(at, MEMBER, { structSize: MEMBER.size });
    this.#call("umo_scene_member", member, at);
    const [role, attendsTo, isContact, nods, brows, smiles, yielding, level] = [
      "role", "attendsTo", "isContact", "nods", "brows", "smiles", "yielding", "level",
    ].map((field) => library.get(at, MEMBER, field));
    const roleName = Object.keys(ROLES).find((name) => ROLES[name] === role);
    return { role: roleName, attendsTo, isContact: isContact === 1, nods, brows, smiles, yielding, level };
  }

  /** Saves the scene and the sessions of its members. */
  save() {
    const library = this.#library;
    this.#call("umo_scene_state_size", library.scratch);
    const size = library.view.getUint32(library.scratch, true);
    const state = library.allocate(size);
    try {
      this.#call("umo_scene_save", state, size, library.scratch);
      return library.bytes(state, library.view.getUint32(library.scratch, true)).slice();
    } finally {
      if (!library.trap) library.run("umo_web_free", state, size);
    }
  }

  /** Restores a state of this scene, or of one to which the same members were added in the same order. */
  restore(state) {
    const library = this.#library;
    const at = library.allocate(state.length);
    library.bytes(at, state.length).set(state);
    try {
      this.#call("umo_scene_restore", at, state.length);
    } finally {
      if (!library.trap) library.run("umo_web_free", at, state.length);
    }
  }

  /** Frees the scene; its sessions go on alone. Calling it twice is harmless. */
  free() {
    if (this.#scene === 0) return;
    const scene = this.#scene;
    this.#scene = 0;
    this.#freed();
    if (!this.#library.trap) this.#library.call("umo_scene_free", scene);
  }
}
