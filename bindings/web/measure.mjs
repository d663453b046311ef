// Cost of one avatar: the default model's share of a thread in Node, and the bytes to download. Run
// `bindings/web/build` first.

import { readFile } from "node:fs/promises";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";
import { Model, Pose } from "./src/index.js";
import { speech } from "./test/speech.mjs";

const root = new URL("../../", import.meta.url);
const read = (name) => readFile(new URL(name, root));
const [wasm, file] = await Promise.all([read("bindings/web/dist/umo.wasm"), read("models/umo-people/model.safetensors")]);
const samples = await speech(new URL("assets/hello.wav", root));
const cpu = () => process.cpuUsage().user / 1e6;

const before = performance.now();
const model = await Model.load({ wasm, model: file });
console.log(`${model.name}, ${model.isa}, Node ${process.version}; loaded in ${(performance.now() - before).toFixed(0)} ms, ${(model.memory / 2 ** 20).toFixed(0)} MiB of memory`);
const pose = new Pose(model);
const seconds = samples.length / 16_000;
const shares = [];
for (let i = 0; i < 12; i++) {
  const session = model.session();
  const start = cpu();
  for (let at = 0; at < samples.length; at += 1600) {
    session.push(samples.subarray(at, at + 1600));
    model.compute();
    while (session.pull(pose));
  }
  session.finish();
  while (!session.isDone) {
    model.compute();
    while (session.pull(pose));
  }
  shares.push((cpu() - start) / seconds);
  session.free();
}
// The first runs include compilation.
const warm = shares.slice(2).sort((a, b) => a - b);
const percent = (share) => `${(100 * share).toFixed(1)} %`;
console.log(`share of a thread: median ${percent(warm[warm.length >> 1])}, least ${percent(warm[0])}, first run ${percent(shares[0])}; ${(1 / warm[warm.length >> 1]).toFixed(1)} times real time`);
for (const [name, bytes] of [["umo.wasm", wasm], ["model", file]]) {
  const brotli = brotliCompressSync(bytes, { params: { [constants.BROTLI_PARAM_QUALITY]: 9, [constants.BROTLI_PARAM_LGWIN]: 24 } });
  console.log(`${name}: ${bytes.length} bytes, gzip ${gzipSync(bytes, { level: 9 }).length}, brotli ${brotli.length}`);
}
