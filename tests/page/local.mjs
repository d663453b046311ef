// The page of `umo view --web`: a folder that any web server serves, whose model runs in the browser.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import path from "node:path";

import { Model, Pose } from "../../bindings/web/src/index.js";
import { speech as samplesOf } from "../../bindings/web/test/speech.mjs";
import { until } from "./chromium.mjs";
import { serve } from "./folder.mjs";

const OPTIONS = { target: 2, lookahead: 4, horizon: 0, seed: 7n };
const PACKAGE = path.join(import.meta.dirname, "../../bindings/web");
let server;
let folder;

export async function prepare({ run, at, short }) {
  folder = at("local");
  const options = ["--target", "2", "--lookahead", "4", "--seed", "7"];
  run("view", "--web", folder, short, "--package", PACKAGE, "--no-open", ...options);
  server = await serve(folder);
}

export function end() {
  server.close();
}

async function opened({ browser }) {
  const page = await browser.open(server.address);
  await page.ready();
  return page;
}

const log = (page, what) => page.value(`umo.live.log.${what}`);

const done = async (page) => {
  assert.deepEqual(page.errors, []);
  assert.deepEqual(page.requests.filter((url) => !url.startsWith(server.address) && !url.startsWith("blob:") && !url.startsWith("data:")), []);
  await page.close();
};

/** The values of every frame of a recording, computed in Node by the same package and model. */
async function framesInNode(samples) {
  const [wasm, model] = await Promise.all(["umo/dist/umo.wasm", "model.safetensors.gz"].map((name) => readFile(path.join(folder, name))));
  const engine = await Model.load({ wasm, model });
  const session = engine.session({ ...OPTIONS, sampleRate: 16_000, voice: "delayed" });
  session.push(samples);
  session.finish();
  const frames = [];
  while (!session.isDone) {
    while (engine.compute());
    // A zero's sign is lost on the way out of the browser.
    for (const pose = new Pose(engine); session.pull(pose); ) frames.push([...pose.rotations, ...pose.translation, ...pose.face].map((value) => value + 0));
  }
  engine.free();
  return frames;
}

export const tests = [
  [
    "a recording's frames are those of the package in Node, in order and to the end",
    async (context) => {
      const page = await opened(context);
      await page.click("#recording");
      await until(() => page.value("umo.frames > 20 && umo.time > 0.3"), 90, "the model and the first frames");
      await page.picture(context.at("local.png"));
      await until(() => log(page, "done"), 90, "the end of the stream");
      assert.equal(await log(page, "error"), null);
      assert.equal(await log(page, "inOrder"), true);
      const wanted = await framesInNode(await samplesOf(context.short));
      assert.equal(await log(page, "received"), wanted.length);
      for (const [index, values] of wanted.entries()) assert.deepEqual(await page.value(`umo.frame(${index})`), values, `frame ${index}`);
      await done(page);
    },
  ],
  [
    "the microphone moves the avatar; a second stream needs no second model",
    async (context) => {
      const page = await opened(context);
      const before = server.asked.filter((name) => name.endsWith(".safetensors.gz")).length;
      for (const time of ["first", "second"]) {
        await until(() => page.value('!document.querySelector("#microphone").hidden'));
        await page.click("#microphone");
        await until(() => page.value("umo.frames > 20 && umo.live.log.started?.live"), 90, `frames of the ${time} stream`);
        await until(() => page.value("umo.weights().jawOpen > 0.05"), 60, "the mouth");
        await until(() => page.value('!document.querySelector("#stop").hidden'));
        await page.click("#stop");
        await until(() => page.value("!umo.live.isRunning"));
      }
      assert.equal(server.asked.filter((name) => name.endsWith(".safetensors.gz")).length - before, 1, "the model is fetched once");
      await done(page);
    },
  ],
  [
    "a model that is missing is said, and the next try works",
    async (context) => {
      const page = await opened(context);
      await page.value('umo.scene.live.engine.model = "missing.gz"');
      await page.click("#recording");
      await until(() => log(page, "error"), 60, "the error");
      assert.match(await log(page, "error"), /missing\.gz: 404/);
      await page.value('umo.scene.live.engine.model = "model.safetensors.gz"');
      await until(() => page.value('!document.querySelector("#recording").hidden'));
      await page.click("#recording");
      await until(() => page.value("umo.frames > 5"), 90, "frames");
      assert.equal(await log(page, "error"), null);
      await page.close();
    },
  ],
];
