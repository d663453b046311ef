// The engine in Node: bit-exact frames compared with native ones; errors; memory. NATIVE names the native frames of
// `assets/hello.wav`, which `test/run` computes.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { Model, Mood, Parameter, Pose, UmoError } from "../src/index.js";
import { speech } from "./speech.mjs";

const root = new URL("../../../", import.meta.url);
const wasm = await WebAssembly.compile(await readFile(new URL("bindings/web/dist/umo.wasm", root)));
const file = await readFile(new URL("models/umo-people/model.safetensors", root));
const load = (options) => Model.load({ wasm, model: file, ...options });
const model = await load();
const samples = await speech(new URL("assets/hello.wav", root));

const fails = (call, status, message) => assert.throws(call, (error) => error instanceof UmoError && error.status === status && message.test(error.message));

/** All frames of the recording, pushed in steps of `step` samples. */
function frames(session, step = 16_000) {
  const poses = [];
  const take = () => {
    while (model.compute());
    for (let pose = new Pose(model); session.pull(pose); pose = new Pose(model)) poses.push(pose);
  };
  for (let at = 0; at < samples.length; at += step) {
    const part = samples.subarray(at, at + step);
    assert.equal(session.push(part), part.length);
    take();
  }
  session.finish();
  while (!session.isDone) take();
  return poses;
}

test("the module uses SIMD, and imports nothing: no threads, files or clock", () => {
  assert.equal(model.isa, "simd128");
  assert.deepEqual(WebAssembly.Module.imports(wasm), []);
});

test("the arousal of a voice is heard", () => {
  const session = model.session();
  assert.deepEqual([session.arousal, session.arousalTrend], [0.5, 0]);
  frames(session);
  assert.ok(session.arousal > 0 && session.arousal < 1 && session.arousal !== 0.5, `${session.arousal}`);
  assert.ok(session.arousalTrend !== 0 && Math.abs(session.arousalTrend) < 1, `${session.arousalTrend}`);
  session.free();
});

test("frames are those of a portable native model, bit for bit", async () => {
  const native = await readFile(process.env.NATIVE);
  const session = model.session();
  const poses = frames(session);
  session.free();
  const { layout } = model;
  assert.equal(poses.length, Math.floor((samples.length / 16_000) * 30));
  assert.equal(native.length, poses.length * layout.size);
  poses.forEach((pose, i) => {
    const at = native.byteOffset + i * layout.size;
    const parts = { translation: pose.translation, rotations: pose.rotations, channels: pose.face, visemes: pose.visemes };
    for (const [name, { buffer, byteOffset, byteLength }] of Object.entries(parts)) {
      const start = at + layout[name];
      const wanted = new Uint32Array(native.buffer.slice(start, start + byteLength));
      assert.deepEqual(new Uint32Array(buffer, byteOffset, byteLength / 4), wanted, `${name} of frame ${i}`);
    }
    assert.equal(pose.index, i);
  });
  assert.ok(poses.some((pose) => pose.face[model.channelNames.indexOf("jawOpen")] > 0.1), "the mouth opens");
});

test("the sizes of pushes change nothing, and a reset begins anew", () => {
  const session = model.session();
  const wanted = frames(session).map(({ rotations }) => rotations);
  session.reset();
  assert.deepEqual(frames(session, 777).map(({ rotations }) => rotations), wanted);
  session.free();
});

test("poses are sampled between frames", () => {
  const session = model.session();
  session.push(samples);
  session.finish();
  while (model.compute());
  const jaw = model.channelNames.indexOf("jawOpen");
  const at = (seconds) => session.samplePose(seconds).face[jaw];
  const [a, between, b] = [30 / 30, 30.5 / 30, 31 / 30].map(at);
  assert.ok(Math.abs(between - (a + b) / 2) < 1e-5);
  assert.equal(session.samplePose(1e6).isAhead, true);
  session.free();
});

test("a session that was sampled before its frames came eases from rest to them", () => {
  const session = model.session();
  const jaw = model.channelNames.indexOf("jawOpen");
  let time = 0;
  const at = (seconds) => {
    session.setClock((time += 1 / 30));
    return session.samplePose(seconds).face[jaw];
  };
  for (let i = 0; i < 30; i++) at(0);
  session.push(samples);
  session.finish();
  while (model.compute());
  let largest = 0;
  for (let i = 0; i < 200; i++) largest = Math.max(largest, at(i / 30));
  assert.ok(largest > 0.4, `${largest}`);
  session.free();
});

test("a decoder has the frames of its sender, and their bodies whatever is lost once", () => {
  const layers = [Parameter.layerGaze, Parameter.layerIdle, Parameter.layerAsymmetry, Parameter.layerNods, Parameter.layerMood, Parameter.layerFeet, Parameter.layerBody];
  const calm = (session) => {
    for (const layer of layers) session.set(layer, 0);
    return session;
  };
  const sender = calm(model.session({ packets: "besideFrames" }));
  const [decoder, other] = [calm(model.decoder({ reorderWindow: 1 })), calm(model.decoder())];
  const rotations = (session) => {
    const found = [];
    for (let pose = new Pose(model); session.pull(pose); pose = new Pose(model)) found.push(pose.rotations);
    return found;
  };
  const [wanted, shown, again] = [[], [], []];
  let packets = 0;
  for (let at = 0; at <= samples.length; at += 16_000) {
    const part = samples.subarray(at, at + 16_000);
    sender.push(part);
    if (part.length < 16_000) sender.finish();
    while (model.compute());
    for (const packet of sender.pullPackets()) {
      assert.ok(packet.length < 700);
      if (packets++ % 3 !== 1) decoder.pushPacket(packet);
      other.pushPacket(packet);
      other.pushPacket(packet);
      again.push(...rotations(other));
      shown.push(...rotations(decoder));
    }
    wanted.push(...rotations(sender));
  }
  assert.ok(sender.isDone && other.isDone);
  assert.deepEqual(other.received, { packets, late: packets, lost: 0, held: 0 });
  assert.deepEqual(again, wanted);
  assert.ok(decoder.received.lost > 2 && decoder.received.held === 0);
  const jaw = 4 * model.jointNames.indexOf("jaw");
  const bodies = (poses) => poses.map((rotations) => [...rotations.slice(0, jaw), ...rotations.slice(jaw + 4)]);
  assert.deepEqual(bodies(shown), bodies(wanted.slice(0, shown.length)));
  fails(() => decoder.pushPacket(new Uint8Array(40)), "PACKET", /not a packet/);
  fails(() => decoder.pushPacket(new Uint8Array(100_000)), "PACKET", /not a packet/);
  fails(() => decoder.push(new Float32Array(10)), "INVALID_ARGUMENT", /decoder/);
  fails(() => model.session({ packets: "all" }), "INVALID_ARGUMENT", /packets/);
  for (const session of [sender, decoder, other]) session.free();
});

test("a take plays the frames of its session, as often as it is wanted", () => {
  const session = model.session({ takeBytes: 1 << 16, seed: 5 });
  session.gesture("nod", { at: 1 });
  session.mood(Mood.joy, 0.5);
  const wanted = frames(session);
  const take = session.take();
  assert.ok(take.length > 1000 && take.length < 1 << 16, `${take.length}`);
  const player = model.decoder({ take, queueFrames: 40 });
  for (const again of [false, true]) {
    if (again) player.reset();
    const played = [];
    while (!player.isDone) {
      player.pushTake();
      for (let pose = new Pose(model); player.pull(pose); pose = new Pose(model)) played.push(pose);
    }
    assert.deepEqual(played, wanted);
    assert.equal(player.pushTake(), false);
  }
  fails(() => player.pushPacket(take), "INVALID_ARGUMENT", /take/);
  fails(() => session.pushTake(), "INVALID_ARGUMENT", /take/);
  fails(() => model.decoder({ take: take.subarray(1) }), "TAKE", /not a take/);
  fails(() => model.decoder({ take: take.slice(0, -1) }), "TAKE", /damaged/);
  const other = model.session();
  fails(() => other.take(), "INVALID_ARGUMENT", /take/);
  for (const each of [session, player, other]) each.free();
});

test("words become gestures at their time", () => {
  const plain = model.session();
  // "now" means nothing in English.
  const session = model.session({ wordRules: "[class.own]\nwords = ['now']\ngestures = [{ name = 'stop' }]" });
  session.hintWords("now", 2, 2.4);
  const [wanted, said] = [plain, session].map((each) => frames(each));
  const shoulder = 4 * model.jointNames.indexOf("right_shoulder");
  const turned = (frame) => Math.max(...[0, 1, 2, 3].map((i) => Math.abs(said[frame].rotations[shoulder + i] - wanted[frame].rotations[shoulder + i])));
  assert.equal(turned(30), 0);
  assert.ok(turned(66) > 0.15, `${turned(66)}`);
  for (const each of [plain, session]) each.free();
});

/** Turn of neck and head to the left, radians, averaged over the second half of two seconds in which another speaks at x. */
function turn(x, change = () => {}) {
  const speech = samples.subarray(0, 40_000);
  const sessions = [speech, new Float32Array(speech.length)].map((voice) => {
    const session = model.session();
    session.push(voice);
    session.finish();
    return session;
  });
  while (model.compute());
  const scene = model.scene({ seed: 1 });
  const [speaker, listener] = sessions.map((session, i) => scene.add(session, i === 0 ? { position: [x, 0, 1], facing: Math.PI } : {}));
  scene.setAllowed(listener, ["look"]);
  change(scene, speaker, listener);
  const pose = new Pose(model);
  let sum = 0;
  for (let i = 0; i < 60; i++) {
    scene.update(1 / 30);
    for (const session of sessions) assert.ok(session.pull(pose));
    const yaw = (joint) => 2 * Math.atan2(pose.rotations[4 * joint + 1], pose.rotations[4 * joint + 3]);
    if (i >= 30) sum += yaw(model.jointNames.indexOf("neck")) + yaw(model.jointNames.indexOf("head"));
  }
  const found = { floor: scene.floor, speaker, listener: scene.member(listener), turn: sum / 30 };
  // Freed in any order.
  const freed = x > 0 ? [scene, ...sessions] : [...sessions, scene];
  freed.forEach((each) => each.free());
  return found;
}

test("who speaks has the floor, and the listener turns there", () => {
  const [left, right] = [turn(1), turn(-1)];
  assert.equal(left.floor, left.speaker);
  assert.equal(left.listener.role, "listening");
  assert.ok(left.turn - right.turn > 0.2, `turned by ${left.turn} and ${right.turn}`);
  // A target is looked at, whatever is said.
  const told = turn(1, (scene, _, listener) => scene.setTarget(listener, [-1, 1.6, 1]));
  assert.ok(left.turn - told.turn > 0.2, `turned by ${told.turn}`);
});

test("a scene has people, is saved and says what is wrong", () => {
  const scene = model.scene();
  const session = model.session();
  const person = scene.add(null, { position: [0, 0, 2], facing: Math.PI, eyeHeight: 1.7 });
  const avatar = scene.add(session);
  for (let at = 0; at < 24_000; at += 533) {
    scene.push(person, samples.subarray(at, at + 533));
    scene.update(1 / 30);
  }
  assert.equal(scene.floor, person);
  const state = scene.save();
  scene.update(1);
  scene.update(1);
  assert.equal(scene.floor, 0);
  scene.restore(state);
  assert.equal(scene.floor, person);
  scene.setTarget(avatar, person);
  scene.setTarget(avatar, null);
  scene.setPlace(avatar, { position: [1, 0, 0] });
  fails(() => scene.restore(state.subarray(1)), "STATE", /./);
  fails(() => scene.setAllowed(avatar, ["wink"]), "INVALID_ARGUMENT", /wink/);
  fails(() => scene.setTarget(avatar, avatar), "INVALID_ARGUMENT", /./);
  fails(() => scene.add(null, { height: 1 }), "INVALID_ARGUMENT", /height/);
  fails(() => scene.push(avatar, samples), "INVALID_ARGUMENT", /member/);
  scene.remove(person);
  fails(() => scene.member(person), "INVALID_ARGUMENT", /member/);
  scene.free();
  scene.free();
  fails(() => scene.update(1), "INVALID_HANDLE", /freed/);
  session.free();
});

test("names and the skeleton", () => {
  assert.equal(model.jointNames.length, 55);
  assert.equal(model.jointNames[15], "head");
  assert.equal(model.channelNames.length, 52);
  assert.ok(model.visemeNames.includes("PP"));
  assert.equal(model.parents[0], -1);
  assert.equal(model.offsets.length, 165);
  assert.equal(model.frameRate, 30);
  assert.notEqual(model.licence, "");
});

test("what a session is told", () => {
  const session = model.session({ sampleRate: 48_000, voice: "live", seed: 7n });
  assert.ok(session.mouthSamples < session.latencySamples);
  session.set(Parameter.gainFace, 0.5);
  session.mood(Mood.joy, 0.5);
  session.lookAt([0, 1.6, 2]);
  session.gesture("wave", { side: "left", variant: 5 });
  session.interrupt();
  session.pushOther(new Float32Array(480));
  session.free();
});

test("errors say what is wrong", async () => {
  const rejected = (promise, status, message) => assert.rejects(promise, (error) => error.status === status && message.test(error.message));
  await rejected(Model.load({ wasm }), "NULL_POINTER", /model/);
  await rejected(Model.load({ wasm, model: new Uint8Array(100) }), "MODEL", /./);
  await rejected(Model.load({ wasm, model: file.subarray(0, 1 << 20) }), "MODEL", /./);
  await rejected(load({ precision: "int4" }), "INVALID_ARGUMENT", /int4/);
  await rejected(load({ sessions: 2 }), "INVALID_ARGUMENT", /an engine has no option sessions/);
  await rejected(load({ mode: "threads" }), "INVALID_ARGUMENT", /an engine has no option mode/);
  await rejected(load({ maxBatch: 65 }), "INVALID_ARGUMENT", /65/);
  fails(() => model.session({ sampleRate: 12 }), "INVALID_ARGUMENT", /12/);
  fails(() => model.session({ rate: 12 }), "INVALID_ARGUMENT", /rate/);
  fails(() => model.session({ voice: "loud" }), "INVALID_ARGUMENT", /loud/);
  const session = model.session();
  fails(() => model.session({ language: "xx" }), "INVALID_ARGUMENT", /xx/);
  fails(() => model.session({ wordRules: "[class" }), "INVALID_ARGUMENT", /./);
  fails(() => session.gesture("somersault"), "INVALID_ARGUMENT", /somersault/);
  fails(() => session.gesture("wave", { variant: 256 }), "INVALID_ARGUMENT", /variant 256/);
  fails(() => session.hintWords("no", 1, 0.5), "INVALID_ARGUMENT", /./);
  fails(() => session.samplePose(Number.NaN), "INVALID_ARGUMENT", /./);
  fails(() => session.lookAt([0, Infinity, 0]), "INVALID_ARGUMENT", /./);
  session.finish();
  fails(() => session.push(samples), "FINISHED", /./);
  session.free();
  session.free();
  fails(() => session.push(samples), "INVALID_HANDLE", /freed/);
});

test("a full engine says so, and places come back", () => {
  const sessions = Array.from({ length: 4 }, () => model.session());
  fails(() => model.session(), "FULL", /4/);
  sessions.forEach((session) => session.free());
  model.session().free();
});

test("memory is given back", async () => {
  const other = await load();
  const use = () => {
    const session = other.session();
    session.push(samples.subarray(0, 16_000));
    while (other.compute());
    session.free();
  };
  use();
  const before = other.memory;
  for (let i = 0; i < 20; i++) use();
  assert.equal(other.memory, before);
  other.free();
  other.free();
  fails(() => other.session(), "INVALID_HANDLE", /freed/);
});
