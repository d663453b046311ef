// The engine in a worker. Messages are `{ id, call, args }`; each is answered by `{ id, value }` or `{ id, error }`.
// Audio arrives through worklet ports or `push`. The worker answers messages between two layers of a computation.

import { Model, Pose } from "./engine.js";

let model;
/** The avatar that speaks, and the one that plays a take meanwhile. */
let session;
let player = null;
let pose;
/** Sample rate, samples pushed so far, and samples that have not fitted yet. */
let rate = 0;
let pushed = 0;
let waiting = [];
/** Words that the session had no room for yet. */
let words = [];
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

/** Pushes waiting samples until the queue is full. */
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

/** Gives waiting words until the session has no room. */
function tell() {
  for (; words.length > 0; words.shift()) {
    try {
      session.hintWords(...words[0]);
    } catch (error) {
      if (error.status === "BUSY") return;
      words.shift();
      throw error;
    }
  }
}

const shown = () => player ?? session;

/** Keeps two seconds of the take's frames ready. */
function turn() {
  const ahead = 2 * model.frameRate;
  for (let i = 0; player && i < ahead && player.ready < ahead && player.pushTake(); i++);
}

/** Ends the take. */
function silence() {
  player?.free();
  player = null;
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
    silence();
    session?.free();
    [waiting, words, finishing, pushed] = [[], [], false, 0];
    // The rest pose comes from another session: a session that was sampled before its speech would ease from that pose.
    const still = model.session(options);
    const rest = still.samplePose(0);
    still.free();
    session = model.session(options);
    rate = options.sampleRate ?? model.sampleRate;
    pose = new Pose(model);
    const { name, licence, notice, isa, isArkit, hasMouth, hasText, frameRate, channelNames, jointNames, visemeNames, parents, offsets } = model;
    return {
      model: { name, licence, notice, isa, isArkit, hasMouth, hasText, frameRate, channelNames, jointNames, visemeNames, parents, offsets },
      /** The rest pose until `samplePose` returns another. */
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

  hintWords(...word) {
    words.push(word);
    tell();
  },

  interrupt(easeMs) {
    [waiting, words, finishing] = [[], [], false];
    session.interrupt(easeMs);
    compute();
  },

  reset() {
    silence();
    [waiting, words, finishing, pushed] = [[], [], false, 0];
    session.reset();
    compute();
  },

  /** Plays a take until the next reset. */
  play(take) {
    calls.reset();
    player = model.decoder({ take });
  },

  /** The pose at a time, and the progress of audio and frames. */
  samplePose(seconds) {
    turn();
    shown().samplePose(seconds, pose);
    attempt(tell);
    compute();
    return { pose, seconds, pushed: pushed / rate, isDone: shown().isDone };
  },

  /** Pulls ready frames, each once. */
  pull() {
    const frames = [];
    turn();
    for (let frame = new Pose(model); shown().pull(frame); frame = new Pose(model)) frames.push(frame);
    attempt(tell);
    compute();
    return { frames, isDone: shown().isDone, isWaiting: waiting.length > 0 };
  },
};
for (const name of ["set", "prompt", "mood", "lookAt", "gesture", "pushOther"]) calls[name] = (...args) => shown()[name](...args);

self.onmessage = async ({ data: { id, call, args } }) => {
  try {
    postMessage({ id, value: await calls[call](...args) });
  } catch (error) {
    postMessage({ id, error: described(error) });
  }
};
