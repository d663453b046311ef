// Unity's WebGL functions (bindings/unity/Runtime/WebGL/umo.jslib) in a stand-in for their Emscripten environment:
// separate memory, malloc, texts. Results must equal the package's, and every function that C# declares must exist.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import vm from "node:vm";
import { Model, Pose } from "../src/index.js";
import { speech } from "./speech.mjs";

const root = new URL("../../../", import.meta.url);
const [code, wasm, file, declarations] = await Promise.all([
  readFile(new URL("bindings/unity/Runtime/WebGL/umo.jslib", root), "utf8"),
  readFile(new URL("bindings/web/dist/umo.wasm", root)),
  readFile(new URL("models/umo-people/model.safetensors", root)),
  readFile(new URL("bindings/unity/Runtime/Native/Native.cs", root), "utf8"),
]);
const samples = await speech(new URL("assets/hello.wav", root));
const UNSUPPORTED = -16, INVALID_HANDLE = -2, MODEL = -8;

/** A player's memory and its functions. */
class Player {
  constructor(response = () => new Response(wasm)) {
    this.memory = new Uint8Array(96 << 20);
    this.top = 1024;
    this.words = new Uint32Array(this.memory.buffer);
    const player = this;
    const library = {};
    const scope = {
      LibraryManager: { library }, HEAPU8: this.memory, HEAPU32: this.words, Uint8Array, DataView, WebAssembly, BigInt, Number, String, Error,
      _malloc: (size) => player.malloc(size),
      UTF8ToString: (at) => player.text(at),
      mergeInto: (to, from) => Object.assign(to, from),
      autoAddDeps() {},
      fetch: async (url) => response(url),
    };
    vm.runInNewContext(code, scope);
    // As emitted by Emscripten at the top of a program.
    scope.umoModule = library.$umoModule;
    this.library = library;
  }

  malloc(size) {
    const at = this.top;
    this.top += (size + 15) & ~15;
    assert.ok(this.top <= this.memory.length);
    return at;
  }

  bytes(data) {
    const at = this.malloc(data.byteLength);
    this.memory.set(new Uint8Array(data.buffer, data.byteOffset, data.byteLength), at);
    return at;
  }

  put(text) {
    return this.bytes(new TextEncoder().encode(`${text}\0`));
  }

  text(at) {
    return at === 0 ? null : new TextDecoder().decode(this.memory.subarray(at, this.memory.indexOf(0, at)));
  }

  call(name, ...given) {
    const status = this.library[name](...given);
    assert.equal(status, 0, `${name}: ${this.text(this.library.umo_last_error())}`);
  }

  async load() {
    this.library.umo_web_load(this.put("StreamingAssets/umo.wasm"));
    while (this.library.umo_web_state() === 1) await new Promise((resolve) => setTimeout(resolve, 1));
    return this.library.umo_web_state();
  }
}

test("every function that C# declares is there, with as many arguments", () => {
  const { library } = new Player();
  const declared = [...declarations.matchAll(/extern \w+ (umo_\w+)\(([^)]*)\)/g)].map(([, name, list]) => [name, list.split(",").filter(Boolean)]);
  assert.ok(declared.length > 50);
  for (const [name, list] of declared) {
    assert.ok(library[name], `${name} is not in umo.jslib`);
    const kinds = library.$umoModule.functions[name].split(">")[0].split(" ").filter(Boolean);
    assert.equal(kinds.length, list.length, name);
    const wide = list.filter((parameter) => /\bulong\b/.test(parameter) && !parameter.includes("*")).length;
    assert.equal(kinds.filter((kind) => kind === "l").length, wide, name);
    assert.equal(library[name].length, list.length + wide, name);
    // Address parameters must be passed on as addresses.
    list.forEach((parameter, i) => assert.equal(/\*/.test(parameter), !/^[vl]$/.test(kinds[i]), `${name}: ${parameter}`));
  }
  assert.equal(Object.keys(library.$umoModule.functions).length, declared.length);
});

test("without a loaded module every call fails", async () => {
  const early = new Player();
  assert.equal(early.library.umo_model_free(5), UNSUPPORTED);
  assert.match(early.text(early.library.umo_last_error()), /not loaded/);
  const lost = new Player(() => new Response("", { status: 404 }));
  assert.equal(await lost.load(), 3);
  assert.match(lost.text(lost.library.umo_last_error()), /umo\.wasm: status 404/);
});

for (const wide of ["two halves", "a BigInt"]) {
  test(`frames are those of the package, 64 bits as ${wide}`, async () => {
    const player = new Player();
    const { library, words } = player;
    assert.equal(await player.load(), 2);
    assert.equal(library.umo_abi_version(), 1);
    assert.match(player.text(library.umo_version()), /^\d+\.\d+\.\d+/);

    const out = player.malloc(64), config = player.malloc(256);
    player.call("umo_model_config_init", config, 20);
    // The log is a C# callback, which the module cannot call.
    words[(config + 16) >> 2] = 4711;
    player.call("umo_model_load_memory", 1, player.bytes(file), file.length, config, out);
    const model = words[out >> 2];
    player.call("umo_model_get_channel_name", model, 0, out);
    const name = words[out >> 2];
    assert.equal(player.text(name), "eyeBlinkLeft");
    player.call("umo_model_get_channel_name", model, 0, out);
    assert.equal(words[out >> 2], name, "a text is copied once");

    player.call("umo_engine_config_init", config, 48);
    words[(config + 4) >> 2] = 1;
    words[(config + 8) >> 2] = 1;
    player.call("umo_engine_new", model, config, out);
    const engine = words[out >> 2];
    player.call("umo_session_config_init", config, 88, model);
    words[(config + 48) >> 2] = player.put("no such template");
    assert.notEqual(library.umo_session_new(engine, config, out), 0);
    assert.match(player.text(library.umo_last_error()), /no such template/);
    words[(config + 48) >> 2] = player.put("audio_to_motion");
    // The layers' seed is that of the configuration.
    const seed = 0x1_0000_0007n;
    words[(config + 40) >> 2] = Number(seed & 0xffff_ffffn);
    words[(config + 44) >> 2] = Number(seed >> 32n);
    player.call("umo_session_new", engine, config, out);
    const session = words[out >> 2];
    player.call("umo_session_set_seed", session, ...(wide === "a BigInt" ? [5n] : [5, 0]));
    if (wide === "a BigInt") player.call("umo_session_set_seed", session, seed);
    else player.call("umo_session_set_seed", session, Number(seed & 0xffff_ffffn), Number(seed >> 32n));
    player.call("umo_session_push_audio", session, player.bytes(samples), samples.length, out);
    assert.equal(words[out >> 2], samples.length);
    player.call("umo_session_finish", session);

    const layout = player.malloc(48);
    player.call("umo_frame_layout_init", layout, 48, model);
    const stride = words[(layout + 8) >> 2];
    const frames = player.malloc(2 * stride);
    const theirs = await Model.load({ wasm, model: file });
    const reference = theirs.session({ seed });
    reference.push(samples);
    reference.finish();
    const pose = new Pose(theirs);
    let count = 0;
    for (let done = 0; !done; ) {
      player.call("umo_engine_poll", engine, 0, out);
      player.memory.fill(0xa5, frames, frames + 2 * stride);
      player.call("umo_session_pull_frames", session, layout, frames, 2 * stride, out);
      const pulled = words[out >> 2];
      if (pulled < 2) assert.ok(player.memory.subarray(frames + pulled * stride, frames + 2 * stride).every((byte) => byte === 0xa5), "no byte too many");
      for (let i = 0; i < pulled; i++, count++) {
        while (!reference.pull(pose)) theirs.compute();
        const at = frames + i * stride;
        const values = new Float32Array(player.memory.buffer, at + theirs.layout.rotations, pose.rotations.length);
        assert.deepEqual(values, pose.rotations, `frame ${count}`);
        assert.deepEqual(new Float32Array(player.memory.buffer, at + theirs.layout.channels, pose.face.length), pose.face);
      }
      player.call("umo_session_is_done", session, out);
      done = words[out >> 2];
    }
    assert.equal(count, Math.floor((samples.length / 16_000) * 30));

    const sampled = player.malloc(24);
    words[sampled >> 2] = 24;
    player.call("umo_session_sample_pose", session, 0.5, layout, frames, stride, sampled);
    assert.ok(new Float64Array(player.memory.buffer, sampled + 8, 2)[1] > 0.5);
    const info = player.malloc(40);
    words[info >> 2] = 40;
    player.call("umo_parameter_get_info", 0, info);
    assert.equal(player.text(words[(info + 32) >> 2]), "temperature");
    player.call("umo_session_free", session);
    assert.equal(library.umo_session_free(session), INVALID_HANDLE);
    player.call("umo_engine_free", engine);
    player.call("umo_model_free", model);
    theirs.free();
  });
}

test("a file that is not a model is refused, and non-ASCII texts are passed correctly", async () => {
  const player = new Player();
  await player.load();
  const out = player.malloc(8);
  assert.equal(player.library.umo_model_load_memory(1, player.bytes(new Uint8Array(100)), 100, 0, out), MODEL);
  assert.notEqual(player.text(player.library.umo_last_error()), "");
  assert.notEqual(player.library.umo_model_load(1, player.put("Models/größe.safetensors"), 0, out), 0);
  assert.match(player.text(player.library.umo_last_error()), /größe|file/);
});

test("a character of the player's takes poses", async () => {
  const player = new Player();
  await player.load();
  const { library, words } = player;
  const out = player.malloc(16), count = 55, rig = player.malloc(96);
  player.call("umo_model_load_memory", 1, player.bytes(file), file.length, 0, out);
  const model = words[out >> 2], parents = player.malloc(4 * count), offsets = player.malloc(12 * count);
  player.call("umo_model_get_skeleton", model, 2, parents, offsets, count);
  const places = new Float32Array(3 * count), turns = new Float32Array(4 * count);
  const above = new Int32Array(player.memory.buffer, parents, count), steps = new Float32Array(player.memory.buffer, offsets, 3 * count);
  for (let i = 0; i < 3 * count; i++) {
    const parent = above[Math.floor(i / 3)];
    places[i] = steps[i] + (parent < 0 ? 0 : places[3 * parent + (i % 3)]);
  }
  for (let joint = 0; joint < count; joint++) turns[4 * joint + 3] = 1;
  player.call("umo_rig_init", rig, 96);
  const joints = player.bytes(Int32Array.from({ length: count }, (_, joint) => joint)), still = player.bytes(turns);
  const points = player.bytes(new Float32Array([0, 1, 0.3, 0, 1.1, 0.3, 0.1, 1, 0.3])), bones = player.bytes(new Int32Array(3)), corners = player.bytes(new Uint32Array([0, 1, 2]));
  words.set([2, count, 3, 3], (rig + 4) >> 2);
  words.set([0, parents, joints, player.bytes(places), still, points, bones, corners], (rig + 64) >> 2);
  player.call("umo_retarget_new", model, rig, out);
  const character = words[out >> 2], found = player.malloc(4 * count), rotations = player.malloc(16 * count), place = player.malloc(12);
  player.call("umo_retarget_get_joints", character, count, found);
  assert.deepEqual([...new Int32Array(player.memory.buffer, found, count)], Array.from({ length: count }, (_, joint) => joint));
  const at = player.bytes(new Float32Array([0.1, 0.02, -0.2]));
  player.call("umo_retarget_set_step", character, 1 / 60);
  player.call("umo_retarget_apply", character, still, at, count, rotations, place);
  for (const [i, turn] of new Float32Array(player.memory.buffer, rotations, 4 * count).entries()) assert.ok(Math.abs(turn - turns[i]) < 0.02, `${i}: ${turn}`);
  assert.ok(Math.abs(new Float32Array(player.memory.buffer, place, 3)[0] - places[0] - 0.1) < 1e-3);
  player.call("umo_retarget_free", character);
  // Names are not handed on: without joints there are no bones.
  words.set([joints, parents, 0], (rig + 64) >> 2);
  assert.equal(library.umo_retarget_new(model, rig, out), -1);
});

test("a trap ends the module, and says where", async () => {
  const player = new Player();
  await player.load();
  player.library.$umoModule.exports = { ...player.library.$umoModule.exports, umo_engine_free() { throw new WebAssembly.RuntimeError("unreachable"); } };
  assert.equal(player.library.umo_engine_free(1), -15);
  assert.match(player.text(player.library.umo_last_error()), /umo_engine_free.*unreachable/);
  assert.equal(player.library.umo_model_free(1), -15);
});
