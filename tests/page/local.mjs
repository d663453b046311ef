// The page of `umo view --web`: a folder that any web server can serve, with the model running in the browser.

import assert from "node:assert/strict";
import fs from "node:fs";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { pathToFileURL } from "node:url";

import { Model, Pose } from "../../bindings/web/src/index.js";
import { speech as samplesOf } from "../../bindings/web/test/speech.mjs";
import { longShins, named, stranger } from "./character.mjs";
import { until } from "./chromium.mjs";
import { serve } from "./folder.mjs";
import { read } from "./frames.mjs";

const OPTIONS = { target: 2, lookahead: 4, horizon: 0, seed: 7n };
const PACKAGE = path.join(import.meta.dirname, "../../bindings/web");
const VISEMES = ["sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "ih", "oh", "ou"].map((name) => `viseme_${name}`);
/** Custom characters: with ARKit shapes and other leg proportions, with the Oculus visemes, with VRM vowels and a
 * blink. */
const CHARACTERS = {
  shins: longShins,
  visemes: (bytes) => named(bytes, VISEMES),
  vowels: (bytes) => named(bytes, ["aa", "ih", "ou", "ee", "oh", "blink"]),
};
let server;
let folder;

export async function prepare({ run, at, short }) {
  folder = at("local");
  const options = ["--target", "2", "--lookahead", "4", "--seed", "7"];
  run("view", "--web", folder, short, "--package", PACKAGE, "--no-open", ...options);
  server = await serve(folder);
  run("animate", short, "-o", at("local.jsonl"), "-o", at("local.glb"));
  const { header } = read(at("local.jsonl"));
  for (const [name, change] of Object.entries(CHARACTERS)) {
    fs.writeFileSync(at(`local-${name}.glb`), change(stranger(fs.readFileSync(at("local.glb")), header.joints)));
    run("view", "--web", at(`local-${name}`), short, "--onto", at(`local-${name}.glb`), "--package", PACKAGE, ...options);
  }
}

/** The animation that a page has shown, as a file. */
async function written(page, jsonl, like) {
  const { header } = read(like);
  const count = await page.value("umo.frames");
  const lines = [{ ...header, frames: count }];
  for (let frame = 0; frame < count; frame++) {
    const values = await page.value(`umo.frame(${frame})`);
    const rotations = header.joints.map((_, joint) => values.slice(4 * joint, 4 * joint + 4));
    const start = 4 * header.joints.length;
    const face = values.slice(start + 3, start + 3 + header.face.names.length);
    lines.push({ frame, time: frame / header.frame_rate, translation: values.slice(start, start + 3), rotations, face });
  }
  fs.writeFileSync(jsonl, lines.map((line) => JSON.stringify(line)).join("\n") + "\n");
}

function near(found, wanted, most, what) {
  found.forEach((x, i) => assert.ok(Math.abs(x - wanted[i]) <= most, `${what}: ${found} is not ${wanted}`));
}

/** Checks that a page's character moves as `umo retarget` moves it: one built into the page, or one dropped onto it. */
async function follows(context, name, isDropped) {
  const { at, browser, run } = context;
  const own = await serve(isDropped ? folder : at(`local-${name}`));
  const page = await browser.open(own.address);
  await page.ready();
  if (isDropped) {
    await page.drop("#view", at(`local-${name}.glb`));
    await until(() => notice(page, / is on/), 120, "the character");
    await page.picture(at(`local-${name}-dropped.png`));
  }
  // Before the first frame it stands at rest.
  assert.ok((await page.value("umo.joints()")).every(({ place }) => place.every(Number.isFinite)));
  await page.click("#recording");
  await until(() => log(page, "done"), 120, "the end of the stream");
  assert.equal(await log(page, "error"), null);
  await until(() => page.value("!umo.playing"), 60, "the end of the sound");
  await written(page, at(`local-${name}.jsonl`), at("local.jsonl"));
  run("retarget", at(`local-${name}.jsonl`), "--onto", at(`local-${name}.glb`), "-o", at(`local-${name}-moved.glb`));
  run("view", at(`local-${name}-moved.glb`), "-o", at(`local-${name}-moved.html`), "--no-open");
  const file = await browser.open(pathToFileURL(at(`local-${name}-moved.html`)).href, { media: [{ name: "prefers-reduced-motion", value: "reduce" }] });
  await file.ready();
  const last = (await page.value("umo.frames")) - 1;
  let [moved, shaped] = [0, 0];
  for (const frame of [0, 11, 30, 47, last]) {
    const [[joints, weights], [wantedJoints, wantedWeights]] = await Promise.all(
      [page, file].map((one) => one.value(`(umo.seek(${frame} / 30), [umo.joints(), umo.weights()])`)),
    );
    joints.forEach(({ name, place }, i) => near(place, wantedJoints[i].place, 2e-4, `frame ${frame}, ${name}`));
    for (const shape of new Set([...Object.keys(weights), ...Object.keys(wantedWeights)])) near([weights[shape] ?? 0], [wantedWeights[shape] ?? 0], 1e-3, `frame ${frame}, ${shape}`);
    moved = Math.max(moved, ...joints.map(({ place }) => Math.abs(place[1])));
    shaped = Math.max(shaped, ...Object.values(weights));
  }
  assert.ok(moved > 0.5 && shaped > 0.05, `the character moves: ${moved}, ${shaped}`);
  await page.picture(at(`local-${name}.png`));
  assert.deepEqual([...page.errors, ...file.errors], []);
  await file.close();
  await page.close();
  own.close();
}

export function end() {
  server.close();
}

/** Whether the page's notice matches. */
const notice = async (page, text) => text.test(await page.value('document.querySelector("#notice").textContent'));

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

/** Values of all frames of a recording, computed in Node by the same package and model. */
async function framesInNode(samples) {
  const [wasm, model] = await Promise.all(["umo/dist/umo.wasm", "model.safetensors.gz"].map((name) => readFile(path.join(folder, name))));
  const engine = await Model.load({ wasm, model });
  const session = engine.session({ ...OPTIONS, sampleRate: 16_000, voice: "delayed" });
  session.push(samples);
  session.finish();
  const frames = [];
  while (!session.isDone) {
    while (engine.compute());
    // The sign of zero is lost on the way out of the browser.
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
        await until(() => page.value("umo.frames > 20 && umo.live.log.started?.isLive"), 90, `frames of the ${time} stream`);
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
  ...Object.keys(CHARACTERS).map((name) => [`one's own character, ${name}, moves as \`umo retarget\` moves it`, (context) => follows(context, name, false)]),
  ["a character that is dropped onto the page moves as `umo retarget` moves it", (context) => follows(context, "vowels", true)],
  [
    "a recording that is dropped onto the page is spoken, and a file of another kind is said",
    async (context) => {
      const page = await opened(context);
      await page.drop("#view", context.speech);
      await until(() => log(page, "done"), 120, "the end of the stream");
      assert.equal(await log(page, "error"), null);
      assert.equal(await page.value("umo.frames"), 229, "frames of hello.wav");
      assert.ok(await notice(page, /speaks hello\.wav/));
      await page.drop("#view", context.at("local.jsonl"));
      await until(() => notice(page, /local\.jsonl: expected a character/), 10, "the sentence");
      // An invalid character leaves the page unchanged.
      fs.writeFileSync(context.at("local-broken.glb"), "no glb");
      await page.drop("#view", context.at("local-broken.glb"));
      await until(() => notice(page, /local-broken\.glb: .*not a glb file/), 10, "the sentence");
      assert.ok((await page.value("umo.joints()")).every(({ place }) => place.every(Number.isFinite)));
      await done(page);
    },
  ],
];
