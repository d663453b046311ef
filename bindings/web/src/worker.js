// The engine in a worker. Messages are `{ id, call, args }`; each is answered by `{ id, value }` or `{ id, error }`. Audio comes by
// the ports of worklets, or by `push`. Between two layers of a computation the worker answers.

import { Model, Pose } from "./engine.js";

let model;
let session;
let pose;
/** Samples a second, those pushed so far, and what there was no room for yet. */
let rate = 0;
let pushed = 0;
let waiting = [];
let finishing = false;

const turns = new MessageChannel();
let isComputing = false;
turns.port1.onmessage = () => {
  isComputing = false;
  attempt(() => {
    feed();
    if (model && model.compute(0)) compute();
    else if (waiting.length > 0) setTimeout(compute, 20);
  });
};

function compute() {
  if (isComputing) return;
  isComputing = true;
  turns.port2.postMessage(0);
}

/** Pushes what waits, as far as there is room. */
function feed() {
  while (waiting.length > 0) {
    const taken = session.push(waiting[0]);
    pushed += taken;
    if (taken < waiting[0].length) {
      waiting[0] = waiting[0].subarray(taken);
      return;
    }
    waiting.shift();
  }
  if (finishing) session.finish();
  finishing = false;
}

function attempt(what) {
  try {
    return what();
  } catch (error) {
    postMessage({ failed: described(error) });
  }
}

const described = ({ name, message, status }) => ({ name, message, status });

const calls = {
  async load({ wasm, model: source, precision, ...options }) {
    const onProgress = (progress) => postMessage({ progress });
    model = await Model.load({ wasm, model: source, precision, onProgress, maxSessions: 1 });
    return calls.session(options);
  },

  session(options) {
    session?.free();
    [waiting, finishing, pushed] = [[], false, 0];
    // The rest is another session's: one that was looked at before its speech begins eases from there.
    const still = model.session(options);
    const rest = still.samplePose(0);
    still.free();
    session = model.session(options);
    rate = options.sampleRate ?? model.sampleRate;
    pose = new Pose(model);
    const { name, licence, notice, isa, isArkit, hasMouth, hasText, frameRate, channelNames, jointNames, visemeNames, parents, offsets } = model;
    return {
      model: { name, licence, notice, isa, isArkit, hasMouth, hasText, frameRate, channelNames, jointNames, visemeNames, parents, offsets },
      /** At rest, until `samplePose` gives another. */
      pose: rest,
      latency: session.latencySamples / rate,
      mouthLatency: session.mouthSamples / rate,
    };
  },

  push(samples) {
    waiting.push(samples);
    compute();
  },

  listen(port) {
    port.onmessage = ({ data }) => attempt(() => calls.push(data));
  },

  finish() {
    finishing = true;
    compute();
  },

  interrupt(easeMs) {
    [waiting, finishing] = [[], false];
    session.interrupt(easeMs);
    compute();
  },

  reset() {
    [waiting, finishing, pushed] = [[], false, 0];
    session.reset();
    compute();
  },

  /** The pose at a time, and how far audio and frames are. */
  samplePose(seconds) {
    session.samplePose(seconds, pose);
    compute();
    return { pose, seconds, pushed: pushed / rate, isDone: session.isDone };
  },

  /** Frames that are ready, each once. */
  pull() {
    const frames = [];
    for (let frame = new Pose(model); session.pull(frame); frame = new Pose(model)) frames.push(frame);
    compute();
    return { frames, isDone: session.isDone, isWaiting: waiting.length > 0 };
  },
};
for (const name of ["set", "prompt", "mood", "lookAt", "gesture", "pushOther"]) calls[name] = (...args) => session[name](...args);

self.onmessage = async ({ data: { id, call, args } }) => {
  try {
    postMessage({ id, value: await calls[call](...args) });
  } catch (error) {
    postMessage({ id, error: described(error) });
  }
};
