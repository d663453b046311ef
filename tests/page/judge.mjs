// The page to judge: `umo view --judge`.

import assert from "node:assert/strict";
import fs from "node:fs";
import { pathToFileURL } from "node:url";

import { pictures, until } from "./chromium.mjs";
import { read, repeated } from "./frames.mjs";

const url = (path) => `${pathToFileURL(path).href}#seed=7`;
const REDUCED = [{ name: "prefers-reduced-motion", value: "reduce" }];

const RATE = 16000;
let truth, recordings;

export function prepare({ run, at, speech }) {
  // 15 s and 19 s: one piece and two pieces.
  recordings = [["one.wav", 0, 2], ["two.wav", 3, 4]].map(([name, start, times]) => {
    const wav = repeated(fs.readFileSync(speech), start, times);
    fs.writeFileSync(at(name), wav);
    return new Int16Array(wav.buffer.slice(wav.byteOffset + 44, wav.byteOffset + wav.length));
  });
  run("animate", at("two.wav"), "-o", at("two.npz"), "-o", at("two.jsonl"));
  truth = read(at("two.jsonl"));
  run("view", "--judge", at("one.wav"), `${at("two.npz")}=${at("two.wav")}`, "-o", at("judge.html"), "--no-open");
}

async function opened({ browser, at }, options = {}) {
  const page = await browser.open(url(at("judge.html")), { media: REDUCED, ...options });
  await page.ready();
  return page;
}

/** Plays A or B, and moves the clock to shortly before its end. */
async function hear(page, name) {
  await page.key(name.toLowerCase());
  await until(() => page.value("umo.playing?.clock.playing ?? false"), 60, `${name} to play`);
  await page.value("umo.playing.clock.seek(7.9)");
  await until(() => page.value("umo.playing === null"), 60, `${name} to end`);
}

/** Answers the next trial: with the right speech, the wrong one, or `equal`. */
async function answer(page, what) {
  await hear(page, "A");
  await hear(page, "B");
  const isOwnA = await page.value("umo.trial.isOwnA");
  const key = what === "equal" ? "ArrowDown" : (what === "right") === isOwnA ? "ArrowLeft" : "ArrowRight";
  await page.key(key);
}
const cells = (page) => page.value(`[...document.querySelectorAll("#results tr")].map((row) => [...row.cells].slice(1).map((cell) => cell.textContent))`);

/** Correlation of two equally long sounds. */
function correlation(a, b) {
  const product = (p, q) => p.reduce((sum, x, i) => sum + x * q[i], 0);
  return product(a, b) / Math.sqrt(product(a, a) * product(b, b));
}

/** The text of a file that a button saves. */
const saved = (page, button) =>
  page.value(`new Promise((done) => {
    const own = URL.createObjectURL;
    URL.createObjectURL = (file) => {
      URL.createObjectURL = own;
      file.text().then((text) => done({ name: file.name, text }));
      return own(file);
    };
    document.querySelector("${button}").click();
  })`);

/** Largest difference in brightness between pixels around the eyes, of 255. */
const features = (page) =>
  page.value(`(() => {
    const view = document.querySelector("#view"), gl = view.getContext("webgl2"), scale = view.width / view.clientWidth;
    umo.draw();
    const [left, right] = [umo.onScreen("left_eye"), umo.onScreen("right_eye")];
    const [x, y, wide] = [Math.min(left[0], right[0]), left[1], Math.abs(left[0] - right[0])].map((one) => Math.round(one * scale));
    const pixels = new Uint8Array(4 * wide * 5);
    gl.readPixels(x, view.height - y - 2, wide, 5, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const green = Array.from({ length: wide * 5 }, (_, i) => pixels[4 * i + 1]);
    return Math.max(...green) - Math.min(...green);
  })()`);

export const tests = [
  [
    "each piece is a trial, once with its own speech and once with another's",
    async (context) => {
      const page = await opened(context);
      const { trials, takes } = await page.value("({ trials: umo.trials, takes: umo.scene.judge.takes })");
      assert.deepEqual(takes.map(({ pieces }) => pieces), [1, 2]);
      assert.deepEqual(trials.map(({ piece }) => piece.index).sort(), [0, 1, 2]);
      for (const { piece, other } of trials) assert.notEqual(piece.take, other.take);
      await page.close();
    },
  ],

  [
    "answers are taken after both were heard, and counted",
    async (context) => {
      const page = await opened(context);
      await page.key("ArrowLeft");
      await hear(page, "A");
      await page.key("ArrowLeft");
      assert.equal(await page.value("umo.answers.length"), 0, "an answer before B was heard");
      await page.click("[data-answer=equal]");
      assert.equal(await page.value("umo.answers.length"), 0, "a button before B was heard");
      for (const what of ["right", "equal", "wrong"]) await answer(page, what);
      assert.equal(await page.value("umo.trial"), null);
      // Wilson's interval of one half of three.
      assert.deepEqual(await cells(page), [["hidden"], ["3"], ["1"], ["1"], ["1"], ["50.0 %"], ["12.5 to 87.5 %"]]);
      await pictures(page, 4);
      await page.picture(context.at("judge-results.png"));

      const { name, text } = await saved(page, "#save-json");
      assert.equal(name, "umo-judge-7.json");
      const { about, seed, results, answers } = JSON.parse(text);
      assert.ok(about.startsWith("umo ") && about.includes("model "), about);
      assert.deepEqual([seed, results.hidden.pairs, results.hidden.share], [7, 3, 0.5]);
      assert.deepEqual(answers.map((one) => one.answer === "equal" ? "equal" : one.answer === one.own ? "right" : "wrong"), ["right", "equal", "wrong"]);
      for (const one of answers) {
        assert.deepEqual(new Set([one.motion, one.other]), new Set([context.at("one.wav"), context.at("two.wav")]));
        assert.ok(one.seconds > 0 && one.face === "hidden");
      }
      assert.deepEqual(answers.map(({ playsA, playsB }) => [playsA, playsB]), [[2, 1], [1, 1], [1, 1]]);
      const csv = (await saved(page, "#save-csv")).text.trim().split("\n").map((line) => line.split(","));
      assert.equal(csv.length, 4);
      assert.deepEqual(csv[0].slice(0, 4), ["seed", "pair", "motion", "start"]);
      assert.deepEqual(csv.slice(1).map((row) => row[csv[0].indexOf("answer")]), answers.map((one) => one.answer));
      assert.deepEqual(page.errors, []);
      await page.close();
    },
  ],

  [
    "a pair is one motion with its own sound and with the other's",
    async (context) => {
      const page = await opened(context);
      // Motion: the second piece of the second take is the file's from frame 240 on.
      const frames = await page.value(`(() => {
        const width = umo.scene.frames.length / (3 * 240);
        return Array.from(umo.scene.frames.subarray(2 * 240 * width, 2 * 240 * width + 220));
      })()`);
      const error = Math.max(...truth.frames[240].rotations.flat().map((x, i) => Math.abs(Math.abs(x) - Math.abs(frames[i]))));
      assert.ok(error < 2e-5, `the motion differs by ${error}`);
      await page.value(`(() => {
        const make = URL.createObjectURL;
        URL.createObjectURL = (file) => make((window.made = file));
      })()`);
      for (const name of ["A", "B"]) {
        await page.key(name.toLowerCase());
        await until(() => page.value("umo.playing?.clock.playing ?? false"), 60, `${name} to play`);
        await page.value("umo.playing.clock.seek(3)");
        await until(() => page.value("umo.playing.clock.time > 3.1"), 60, `${name} to go on`);
        await pictures(page, 2);
        const { trial, frame, time } = await page.value("({ trial: umo.trial, frame: umo.frame, time: umo.playing.clock.time })");
        assert.ok(Math.abs(frame - 240 * trial.piece.index - 30 * time) < 30, `${name}: frame ${frame} at ${time}`);
        const { take, part } = (name === "A") === trial.isOwnA ? trial.piece : trial.other;
        const heard = await page.value("window.made.arrayBuffer().then((all) => Array.from(new Int16Array(all.slice(44))))");
        assert.equal(heard.length, 8 * RATE);
        const similar = recordings.map((samples) => correlation(heard, samples.slice(8 * RATE * part, 8 * RATE * (part + 1))));
        assert.ok(similar[take] > 0.99 && similar[1 - take] < 0.5, `${name}: ${similar} for recording ${take}`);
        await page.key(name.toLowerCase());
      }
      await page.close();
    },
  ],

  [
    "the face is hidden until it is asked for, and each answer says so",
    async (context) => {
      const page = await opened(context);
      await page.key("1");
      assert.ok((await features(page)) < 40, "the mask has features");
      assert.deepEqual(await page.value("umo.weights()"), {});
      await page.click("#face");
      assert.ok((await features(page)) > 80, "the face has none");
      assert.ok(Object.keys(await page.value("umo.weights()")).length > 0);
      await page.key("f");
      assert.ok((await features(page)) < 40, "the mask is off");
      await answer(page, "right");
      await answer(page, "right");
      await page.key("r");
      assert.deepEqual((await cells(page)).slice(0, 2), [["hidden", "shown"], ["1", "1"]], "a face that was shown during a pair");
      await page.close();
    },
  ],

  [
    "pictures at the size of a screen and of a phone",
    async (context) => {
      for (const [name, options] of [
        ["judge-light", { media: [...REDUCED, { name: "prefers-color-scheme", value: "light" }] }],
        ["judge-phone", { width: 390, height: 844, phone: true }],
      ]) {
        const page = await opened(context, options);
        await hear(page, "A");
        await page.key("b");
        await until(() => page.value("umo.playing?.clock.playing ?? false"));
        await page.value("umo.playing.clock.seek(4)");
        await pictures(page, 4);
        await page.picture(context.at(`${name}.png`));
        for (const button of ["[data-play=A]", "[data-answer=B]", "#results-button"]) {
          const [x, y] = await page.place(button);
          assert.ok(x > 0 && y > 0 && x < (options.width ?? 1280) && y < (options.height ?? 860), `${name}: ${button} is at ${x}, ${y}`);
        }
        await page.close();
      }
    },
  ],
];
