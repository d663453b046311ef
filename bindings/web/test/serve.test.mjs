// Tests the client of `umo serve` against a server that `scripts/test/serve` starts.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { RemoteAvatar } from "../src/serve.js";

const url = process.env.UMO_SERVE;
const skip = !url && "UMO_SERVE names no server: scripts/test/serve starts one";
const speech = Int16Array.from({ length: 48000 }, (_, i) => 8000 * Math.sin(0.05 * i) + 2000 * Math.sin(0.61 * i));

async function frames(avatar, samples) {
  const made = [];
  avatar.onframe = (frame) => made.push(frame);
  const done = new Promise((resolve, reject) => Object.assign(avatar, { ondone: resolve, onend: reject }));
  avatar.push(samples);
  avatar.finish();
  return [made, await done];
}

const values = (made) => made.map(({ index, rotations, translation, face }) => [index, ...rotations, ...translation, ...face]);

test("frames come, the same for floats and for integers", { skip }, async () => {
  const avatar = await RemoteAvatar.connect(url, { seed: 3 });
  assert.equal(avatar.ready.rate, 16000);
  const [made, done] = await frames(avatar, speech);
  assert.deepEqual([made.length, done.frames], [90, 90]);
  assert.equal(made[5].rotations.length, 4 * avatar.ready.joints);
  assert.equal(made[5].face.length, avatar.ready.face.length);
  assert.ok(made.every((frame, index) => frame.index === index));
  avatar.close();
  const again = await RemoteAvatar.connect(url, { seed: 3 });
  const [floats] = await frames(again, Float32Array.from(speech, (sample) => sample / 32768));
  assert.deepEqual(values(floats), values(made));
  again.close();
});

test("a session goes on where its state was", { skip }, async () => {
  const whole = await RemoteAvatar.connect(url, { seed: 4 });
  const [expected] = await frames(whole, speech);
  whole.close();
  const first = await RemoteAvatar.connect(url, { seed: 4 });
  const before = [];
  first.onframe = (frame) => before.push(frame);
  first.push(speech.subarray(0, 20001));
  const [state, samples] = await new Promise((resolve) => {
    first.onstate = (...given) => resolve(given);
    first.save();
  });
  first.close();
  const second = await RemoteAvatar.connect(url, { seed: 4, state });
  const [after] = await frames(second, speech.subarray(samples));
  second.close();
  const kept = before.filter((frame) => frame.index < after[0].index);
  assert.deepEqual(values([...kept, ...after]), values(expected));
});

// Packets of 20 ms, 0.6 s of speech.
function opus() {
  const data = readFileSync(new URL("../../../serve/tests/opus/voice.packets", import.meta.url));
  const packets = [];
  for (let at = 0; at < data.length; at += 2 + data.readUInt16LE(at)) packets.push(data.subarray(at + 2, at + 2 + data.readUInt16LE(at)));
  return packets;
}

test("packets of Opus animate, and lost ones keep their time", { skip }, async () => {
  const avatar = await RemoteAvatar.connect(url, { audio: "opus" });
  assert.equal(avatar.ready.audio, "opus");
  const packets = opus();
  const made = [];
  avatar.onframe = (frame) => made.push(frame.index);
  const done = new Promise((resolve, reject) => Object.assign(avatar, { ondone: resolve, onend: reject }));
  for (const packet of packets.slice(0, 28)) avatar.pushOpus(packet);
  avatar.lost(2);
  avatar.finish();
  assert.equal((await done).frames, 18);
  assert.deepEqual(made, [...made.keys()]);
  avatar.close();
  const wrong = await RemoteAvatar.connect(url, { audio: "opus" });
  const end = new Promise((resolve) => { wrong.onend = resolve; });
  wrong.pushOpus(Uint8Array.of(0x4b, 0));
  assert.match((await end).message, /not an Opus packet/);
});

test("what is wrong is said", { skip }, async () => {
  await assert.rejects(RemoteAvatar.connect(url, { rate: 1 }), { code: "bad_request" });
  await assert.rejects(RemoteAvatar.connect(url, { mood: "happy" }), /joy/);
  await assert.rejects(RemoteAvatar.connect("ws://127.0.0.1:1/v1/session"), { code: "closed" });
});
