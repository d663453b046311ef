// The page's side without a browser: a worker that answers like worker.js, and a context whose time the test sets.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { Avatar, Model } from "../src/index.js";

const root = new URL("../../../", import.meta.url);
const [wasm, file] = await Promise.all(["bindings/web/dist/umo.wasm", "models/umo-people/model.safetensors"].map((path) => readFile(new URL(path, root))));

/** A worker backed by a real session. */
class Worker {
  calls = [];

  async postMessage({ id, call, args: [first, ...rest] }) {
    this.calls.push([call, first, ...rest]);
    const value = await this[call]?.(first);
    queueMicrotask(() => this.onmessage({ data: { id, value } }));
  }

  async load({ model, wasm }) {
    this.model = await Model.load({ model, wasm });
    this.session = this.model.session();
    const { channelNames, jointNames, visemeNames, parents, offsets, isArkit } = this.model;
    return { model: { channelNames, jointNames, visemeNames, parents, offsets, isArkit }, pose: this.session.samplePose(0), latency: 0.5, mouthLatency: 0.1 };
  }

  samplePose() {
    return { pose: { newest: 1 }, isDone: false };
  }

  terminate() {}
}

const create = (options) => Avatar.create({ worker: new Worker(), wasm, model: file, ...options });
const sound = () => ({ connect() {}, start(at) { this.at = at; }, stop() {} });

/** A context at a given time, and a recording for it. */
function playing(latencies) {
  const made = sound();
  const context = { currentTime: 10, destination: {}, createBufferSource: () => made, ...latencies };
  const buffer = { sampleRate: undefined, length: 4, numberOfChannels: 1, getChannelData: () => new Float32Array(4) };
  return { context, buffer, made };
}

test("the pose before the first is the model's rest", async () => {
  const avatar = await create();
  assert.ok(avatar.pose.rotations.some((value, i) => i % 4 !== 3 && Math.abs(value) > 0.1), "arms hang");
  avatar.close();
});

test("the motion is as late as a recording is heard: the context's latencies, and the device's own delay", async () => {
  const avatar = await create({ delay: 0.125 });
  const { context, buffer, made } = playing({ baseLatency: 0.0625, outputLatency: 0.25 });
  await avatar.say(buffer, context);
  context.currentTime = made.at + 1;
  assert.equal(avatar.time, 1 - 0.0625 - 0.25 - 0.125);
  // The context's latency may change, for example when headphones are connected, and so may the setting.
  context.outputLatency = 0.5;
  avatar.delay = 0;
  assert.equal(avatar.time, 1 - 0.0625 - 0.5);
  avatar.close();
});

test("a context that knows no latency counts as one without", async () => {
  const avatar = await create();
  const { context, buffer, made } = playing({});
  await avatar.say(buffer, context);
  context.currentTime = made.at + 2;
  assert.equal(avatar.time, 2);
  avatar.close();
});

test("a recording's words are given before its audio", async () => {
  const worker = new Worker();
  const avatar = await create({ worker });
  const { context, buffer } = playing({});
  await avatar.say(buffer, context, context.destination, [["No,", 0.5, 0.75]]);
  const [first, second] = worker.calls.slice(1);
  assert.deepEqual(first, ["hintWords", "No,", 0.5, 0.75]);
  assert.equal(second[0], "push");
  avatar.close();
});

test("a take plays beside its recording or in silence, and whatever comes next ends it", async () => {
  const worker = new Worker();
  const avatar = await create({ worker });
  const { context, buffer, made } = playing({ outputLatency: 0.25 });
  const take = Uint8Array.of(1, 2);
  await avatar.play(take, context, buffer);
  context.currentTime = made.at + 1;
  assert.equal(avatar.time, 0.75);
  await avatar.play(take, context);
  context.currentTime += 3;
  assert.ok(Math.abs(avatar.time - (3 - 0.25)) < 0.5 && avatar.time < 2.75);
  await avatar.say(buffer, context);
  const names = worker.calls.map(([name]) => name).filter((name) => name !== "samplePose");
  assert.deepEqual(names, ["load", "play", "reset", "play", "reset", "push", "finish"]);
  assert.deepEqual(worker.calls.find(([name]) => name === "play"), ["play", take]);
  avatar.close();
});
