// The page's side: an avatar whose engine runs in a worker.

import { Library, UmoError, compiled } from "./engine.js";

/** Seconds by which a recording's sound is delayed beyond the engine's latency, so that computing can finish. */
const MARGIN = 0.25;

export class Avatar {
  #worker;
  #count = 0;
  #waiting = new Map();
  #asked = false;
  #last = 0;
  #clock = () => 0;
  #node = null;
  #source = null;
  /** Whether a recording or a take plays. */
  #isPlaying = false;

  /**
   * Loads the engine and a model in a worker. `wasm` and `model` are URLs or bytes; `wasm` may also be a module.
   * `delay` sets the property of that name; the other options are a session's. `worker` is an existing worker that runs
   * `umo-web/worker`.
   */
  static async create({ worker, wasm = new URL("../dist/umo.wasm", import.meta.url), model, delay = 0, onProgress, onError, ...options }) {
    const avatar = new Avatar(worker ?? new Worker(new URL("./worker.js", import.meta.url), { type: "module" }), onProgress, onError);
    const absolute = (source) => (typeof source === "string" || source instanceof URL ? new URL(source, document.baseURI).href : source);
    try {
      const module = await compiled(absolute(wasm));
      const loaded = avatar.call("load", { ...options, wasm: module, model: absolute(model) });
      // Characters are animated on this thread.
      const [library] = await Promise.all([Library.load(module), loaded]);
      Object.assign(avatar, await loaded);
      avatar.model.library = library;
    } catch (error) {
      avatar.close();
      throw error;
    }
    avatar.sampleRate = options.sampleRate;
    /** Latency in seconds that the AudioContext does not know, such as a Bluetooth speaker's or a television's. */
    avatar.delay = delay;
    return avatar;
  }

  constructor(worker, onProgress, onError = (error) => console.error(error)) {
    this.#worker = worker;
    worker.onmessage = ({ data: { id, value, error, progress, failed } }) => {
      if (progress) return onProgress?.(progress);
      if (failed) return onError(revived(failed));
      const { resolve, reject } = this.#waiting.get(id);
      this.#waiting.delete(id);
      return error ? reject(revived(error)) : resolve(value);
    };
    worker.onerror = (event) => {
      const error = new UmoError("PANIC", event.message ?? "the worker could not be started");
      for (const { reject } of this.#waiting.values()) reject(error);
      this.#waiting.clear();
      onError(error);
    };
  }

  /** Calls the engine in the worker: `push`, `finish`, `interrupt`, `reset`, `set`, `prompt`, `mood`, `lookAt`,
   * `gesture`, `hintWords`, `play`, `pull`. */
  call(name, ...args) {
    const id = ++this.#count;
    const transfer = args.filter((arg) => arg instanceof MessagePort);
    this.#worker.postMessage({ id, call: name, args }, transfer);
    return new Promise((resolve, reject) => this.#waiting.set(id, { resolve, reject }));
  }

  /**
   * Speaks the output of an audio node from now on, such as a microphone's `MediaStreamAudioSourceNode`, a call, or an
   * element. The session must have the context's sample rate. Returns a function that stops it.
   */
  async listen(source) {
    const { context } = source;
    this.#check(context.sampleRate);
    await this.#stop();
    await context.audioWorklet.addModule(new URL("./worklet.js", import.meta.url));
    const node = new AudioWorkletNode(context, "umo-push", { numberOfInputs: 1, numberOfOutputs: 0 });
    const channel = new MessageChannel();
    await this.call("listen", channel.port1);
    node.port.postMessage({ target: channel.port2 }, [channel.port2]);
    let start;
    node.port.onmessage = ({ data }) => (start ??= data.time);
    // A frame is complete once its future audio has arrived; the mouth alone may be earlier.
    const behind = Math.min(this.latency, this.mouthLatency);
    // People beside a microphone hear themselves directly, without the device's latency.
    const played = () => ("mediaStream" in source ? 0 : this.#output(context));
    this.#clock = () => (start === undefined ? 0 : Math.max(0, context.currentTime - start - behind - played()));
    source.connect(node);
    this.#node = { node, source };
    return () => this.#stop();
  }

  /** Speaks and plays a recording; resolves when playback starts. `output` is the node to play to; `words` are the
   * recording's, each `[text, start, end]` in its seconds. */
  async say(buffer, context, output = context.destination, words = []) {
    this.#check(buffer.sampleRate);
    await this.#stop();
    const samples = new Float32Array(buffer.length);
    for (let c = 0; c < buffer.numberOfChannels; c++) {
      buffer.getChannelData(c).forEach((value, i) => (samples[i] += value / buffer.numberOfChannels));
    }
    await Promise.all(words.map((word) => this.call("hintWords", ...word)));
    await this.call("push", samples);
    await this.call("finish");
    await this.#begin(context, buffer, output);
  }

  /** Plays a take, the bytes of a `.umo` file, beside its recording, if that is given; resolves when playback starts. */
  async play(take, context, buffer, output = context.destination) {
    await this.#stop();
    await this.call("play", take);
    await this.#begin(context, buffer, output);
  }

  /** Waits for the first frames, and starts their sound and clock. */
  async #begin(context, buffer, output) {
    for (let first = this.#last; ; ) {
      const { pose } = await this.call("samplePose", first);
      if (pose.newest > 0) break;
      await new Promise((done) => setTimeout(done, 20));
    }
    const start = context.currentTime + MARGIN;
    if (buffer) {
      const sound = context.createBufferSource();
      sound.buffer = buffer;
      sound.connect(output);
      sound.start(start);
      this.#source = sound;
    }
    this.#isPlaying = true;
    this.#clock = () => Math.max(0, context.currentTime - start - this.#output(context));
  }

  /** Seconds from a context's time until its sound is heard. */
  #output({ baseLatency = 0, outputLatency = 0 }) {
    return baseLatency + outputLatency + this.delay;
  }

  #check(rate) {
    if (rate !== this.sampleRate) {
      throw new UmoError("INVALID_ARGUMENT", `the audio has ${rate} samples a second, the avatar was made for ${this.sampleRate ?? "the model's"}: pass \`sampleRate\``);
    }
  }

  async #stop() {
    const { node, source } = this.#node ?? {};
    if (node) {
      source.disconnect(node);
      node.port.postMessage({ end: true });
    }
    this.#source?.stop();
    if (node || this.#isPlaying) await this.call("reset");
    [this.#node, this.#source, this.#isPlaying, this.#last, this.#clock] = [null, null, false, 0, () => 0];
  }

  /** Motion time to show now, in seconds. */
  get time() {
    return this.#clock();
  }

  /**
   * The pose to show now, which the last call requested one frame ahead. Requests the next pose from the worker and
   * never waits. Call it once per frame.
   */
  samplePose(seconds = this.time) {
    if (!this.#asked) {
      this.#asked = true;
      const step = Math.min(0.1, Math.max(0, seconds - this.#last));
      this.#last = seconds;
      this.call("samplePose", seconds + step).then(
        ({ pose, isDone }) => {
          this.pose = pose;
          this.isDone = isDone;
          this.#asked = false;
        },
        (error) => {
          this.error = error;
        },
      );
    }
    return this.pose;
  }

  /** Terminates the worker, which frees everything. */
  close() {
    this.#node?.source.disconnect(this.#node.node);
    this.#source?.stop();
    this.#worker.terminate();
    const error = new UmoError("CLOSED", "the avatar was closed");
    for (const { reject } of this.#waiting.values()) reject(error);
    this.#waiting.clear();
  }
}

function revived({ status, message, name }) {
  const error = status ? new UmoError(status, "") : new Error();
  return Object.assign(error, { message, name });
}
