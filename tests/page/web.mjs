// The page of bindings/web, with the model running in the browser. WEB names its folder, as written by
// bindings/web/demo/make.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import path from "node:path";

import { Model, Pose } from "../../bindings/web/src/index.js";
import { speech as samplesOf } from "../../bindings/web/test/speech.mjs";
import { until } from "./chromium.mjs";
import { serve } from "./folder.mjs";

const folder = process.env.WEB;
let server;

export async function prepare() {
  server = await serve(folder);
}

export function end() {
  server.close();
}

async function opened({ browser }) {
  const page = await browser.open(server.address, { width: 900, height: 900 });
  await until(() => page.value("(window.demo?.character && !document.getElementById(\"file\").disabled) || window.demo?.failed").catch(() => false), 120, "the model and the character");
  assert.equal(await page.value("demo.failed"), null);
  return page;
}

const done = async (page) => {
  assert.deepEqual(page.errors, []);
  assert.deepEqual(page.requests.filter((url) => !url.startsWith(server.address) && !url.startsWith("blob:") && !url.startsWith("data:")), []);
  await page.close();
};

/** FNV-1a hash of the values' bits, also computed by the page. */
const HASH = `(arrays) => {
  let hash = 0x811c9dc5;
  for (const values of arrays) {
    for (const byte of new Uint8Array(values.buffer, values.byteOffset, values.byteLength)) hash = Math.imul(hash ^ byte, 0x01000193) >>> 0;
  }
  return hash;
}`;

/** All frames of a recording, in Node. */
async function framesInNode(samples) {
  const [wasm, model] = await Promise.all(
    ["umo/dist/umo.wasm", "umo-people.safetensors.gz"].map((name) => readFile(path.join(folder, name))),
  );
  const engine = await Model.load({ wasm, model });
  const session = engine.session();
  session.push(samples);
  session.finish();
  const hashes = [];
  const hash = (0, eval)(HASH);
  while (!session.isDone) {
    while (engine.compute());
    for (let pose = new Pose(engine); session.pull(pose); pose = new Pose(engine)) hashes.push(hash([pose.rotations, pose.translation, pose.face, pose.visemes]));
  }
  engine.free();
  return hashes;
}

export const tests = [
  [
    "frames computed in the browser's worker are those of Node, bit for bit",
    async (context) => {
      const page = await opened(context);
      const samples = await samplesOf(context.short);
      const wanted = await framesInNode(samples);
      const found = await page.value(`(async () => {
        const samples = Float32Array.from(${JSON.stringify([...samples])});
        const hash = ${HASH};
        const { Avatar } = await import("./umo/src/index.js");
        const avatar = await Avatar.create({ model: "umo-people.safetensors.gz", wasm: "umo/dist/umo.wasm" });
        await avatar.call("push", samples);
        await avatar.call("finish");
        const hashes = [];
        for (let isDone = false; !isDone; ) {
          const answer = await avatar.call("pull");
          hashes.push(...answer.frames.map((pose) => hash([pose.rotations, pose.translation, pose.face, pose.visemes])));
          isDone = answer.isDone;
          await new Promise((done) => setTimeout(done, 5));
        }
        avatar.close();
        return hashes;
      })()`);
      assert.equal(wanted.length, Math.floor((samples.length / 16_000) * 30));
      assert.deepEqual(found, wanted);
      await done(page);
    },
  ],
  [
    "a recording is spoken and drawn to its end",
    async (context) => {
      const page = await opened(context);
      const { root } = await page.send("DOM.getDocument");
      const { nodeId } = await page.send("DOM.querySelector", { nodeId: root.nodeId, selector: "#file" });
      await page.send("DOM.setFileInputFiles", { nodeId, files: [context.short] });
      await until(() => page.value("demo.drawn >= 40 || demo.failed"), 120, "frames of the recording");
      assert.equal(await page.value("demo.failed"), null);
      await page.picture(context.at("web.png"));
      assert.ok(await page.value("demo.character.speaks && demo.character.missing.joints.length === 0"), "the figure's bones and mouth are found");
      await until(() => page.value("demo.avatar.isDone || demo.failed"), 120, "the end");
      assert.ok((await page.value("demo.mouth")) > 0.1, "the mouth opens");
      await done(page);
    },
  ],
  [
    "the microphone is heard by the worklet",
    async (context) => {
      const page = await opened(context);
      await page.click("#microphone");
      await until(() => page.value("(demo.drawn >= 20 && demo.mouth > 0.1) || demo.failed"), 120, "frames of the microphone");
      assert.equal(await page.value("demo.failed"), null);
      assert.match(await page.value('document.getElementById("state").value'), /^listens/);
      await page.click("#stop");
      await until(() => page.value('document.getElementById("state").value === "ready"'), 120, "the end");
      await done(page);
    },
  ],
  [
    "an error of the worker reaches the page",
    async (context) => {
      const page = await opened(context);
      const message = await page.value(`(async () => {
        const { Avatar } = await import("./umo/src/index.js");
        return Avatar.create({ model: "umo/src/index.js", wasm: "umo/dist/umo.wasm" }).then(() => "", (error) => error.message);
      })()`);
      assert.match(message, /^MODEL: /);
      const option = await page.value('demo.avatar.call("gesture", "somersault").then(() => "", (error) => error.message)');
      assert.match(option, /^INVALID_ARGUMENT: .*somersault/);
      await done(page);
    },
  ],
];
