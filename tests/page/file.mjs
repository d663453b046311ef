// The page as a file.

import assert from "node:assert/strict";
import fs from "node:fs";
import { pathToFileURL } from "node:url";

import { changed, stranger } from "./character.mjs";
import { pictures, until } from "./chromium.mjs";
import { halfway, places, read } from "./frames.mjs";

const RATE = 30;
const REDUCED = [{ name: "prefers-reduced-motion", value: "reduce" }];
const url = (path) => pathToFileURL(path).href;

let truth;

export function prepare({ run, at, speech }) {
  run("animate", speech, "-o", at("hello.jsonl"), "-o", at("hello.npz"), "-o", at("hello.glb"));
  run("view", speech, "-o", at("hello.html"), "--no-open");
  run("view", at("hello.npz"), "--audio", speech, "-o", at("npz.html"), "--no-open");
  run("view", at("hello.glb"), "-o", at("glb.html"), "--no-open");
  const pair = [speech, speech, "--places", "-0.7,0,60 0.7,0.2,-90"];
  run("converse", ...pair, "-o", at("talk.html"), "-o", at("talk.glb"), "--figure", "alex,bea");
  run("view", at("talk.glb"), "--audio", speech, "--audio", speech, "-o", at("talk-read.html"), "--no-open");
  run("view", at("talk.glb"), "-o", at("talk-mute.html"), "--no-open");
  run("converse", ...pair, "-o", at("ada.jsonl"), "-o", at("bob.jsonl"));
  run("model", "random", "--size", "tiny", "--layout", "frames", "-o", at("frames.safetensors"));
  run("view", speech, "--model", at("frames.safetensors"), "-o", at("frames.html"), "--no-open");
  truth = read(at("hello.jsonl"));
  const character = stranger(fs.readFileSync(at("hello.glb")), truth.header.joints);
  fs.writeFileSync(at("stranger.glb"), character);
  // The same, a hundred times larger, as if a file in centimetres had been taken for metres.
  fs.writeFileSync(at("giant.glb"), changed(character, ({ nodes }) => (nodes.at(-1).scale = [100, 100, 100])));
  run("view", speech, "--onto", at("stranger.glb"), "-o", at("onto.html"), "--no-open");
  run("view", speech, "--onto", at("giant.glb"), "-o", at("giant.html"), "--no-open");
  run("retarget", speech, "--onto", at("stranger.glb"), "-o", at("moved.glb"));
  run("view", at("moved.glb"), "--audio", speech, "-o", at("moved.html"), "--no-open");
}

async function opened({ browser, at }, name = "hello.html", options = { media: REDUCED }) {
  const page = await browser.open(url(at(name)), options);
  await page.ready();
  return page;
}

/** Checks that the page had no errors and made no requests. */
async function closed(page) {
  assert.deepEqual(page.errors, []);
  const asked = page.requests.filter((address) => !/^(file|blob|data):/.test(address));
  assert.deepEqual(asked, []);
  await page.close();
}

function near(found, wanted, most, what) {
  found.forEach((x, i) => assert.ok(Math.abs(x - wanted[i]) <= most, `${what}: ${found} is not ${wanted}`));
}

/** Checks that the page's last drawn frame is this one. */
async function shows(page, frame, most, what) {
  const joints = await page.value("umo.joints()");
  assert.equal(joints.length, 55);
  const wanted = places(truth, frame);
  joints.forEach(({ name, place }, i) => {
    assert.equal(name, truth.header.joints[i]);
    near(place, wanted[i], most, `${what}, ${name}`);
  });
  const weights = await page.value("umo.weights()");
  truth.header.face.names.forEach((name, i) => near([weights[name] ?? 0], [frame.face[i]], most, `${what}, ${name}`));
}

async function showsFrames(context, name, most) {
  const page = await opened(context, name);
  const last = truth.frames.length - 1;
  assert.equal(await page.value("umo.frames"), truth.frames.length);
  for (const index of [0, 1, 6, 100, 101, last]) {
    await page.value(`umo.seek(${index} / ${RATE})`);
    await shows(page, truth.frames[index], most, `${name}, frame ${index}`);
  }
  for (const index of [0, 55, last - 1]) {
    await page.value(`umo.seek(${index + 0.5} / ${RATE})`);
    await shows(page, halfway(truth.frames[index], truth.frames[index + 1]), most, `${name}, frame ${index} and a half`);
  }
  await closed(page);
}

/** Checks that a page shows both members of the conversation, with their voices. */
async function showsMembers(context, name, most) {
  const page = await opened(context, name);
  assert.deepEqual(await page.value("umo.scene.room.map(({ figure }) => figure)"), [0, 1]);
  const turned = ([x, y, z], degrees, position) => {
    const [s, c] = [Math.sin, Math.cos].map((of) => of((degrees * Math.PI) / 180));
    return [position[0] + x * c + z * s, y, position[1] + z * c - x * s];
  };
  const members = [["ada", 60, [-0.7, 0]], ["bob", -90, [0.7, 0.2]]];
  for (const index of [0, 77]) {
    await page.value(`umo.seek(${index} / ${RATE})`);
    const shown = await page.value("umo.members()");
    members.forEach(([name, degrees, position], i) => {
      const made = read(context.at(`${name}.jsonl`));
      const wanted = places(made, made.frames[index]).map((place) => turned(place, degrees, position));
      shown[i].places.forEach((place, joint) => near(place, wanted[joint], most, `${name}, frame ${index}, joint ${joint}`));
    });
  }
  for (const member of [0, 1]) {
    await page.value(`umo.follow(${member}); umo.camera("all"); umo.seek(2)`);
    for (const joint of ["head", "spine2"]) {
      assert.equal(await alpha(page, await page.value(`umo.onScreen("${joint}")`)), 255, `${joint} of member ${member}`);
    }
  }
  await page.value("umo.seek(0); umo.play()");
  await until(() => page.value("umo.playing && umo.time > 0.5"));
  assert.equal(await page.value("umo.clock.sources.length"), 2);
  await page.value("umo.pause()");
  assert.equal(await page.value("umo.clock.sources.length"), 0);
  await closed(page);
}

/** Alpha of the picture at a position: whether something is drawn there. */
const alpha = (page, [x, y]) =>
  page.value(`(() => {
    umo.seek(umo.time);
    const view = document.querySelector("#view"), gl = view.getContext("webgl2"), scale = view.width / view.clientWidth;
    const pixel = new Uint8Array(4);
    gl.readPixels(Math.round(${x} * scale), view.height - 1 - Math.round(${y} * scale), 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return pixel[3];
  })()`);

/** Red, green and blue of a square of the screen, row by row, including everything behind and in front of the
 * picture. */
const seen = async (page, [x, y], size) => {
  const { data } = await page.send("Page.captureScreenshot", { format: "png" });
  return page.value(`(async () => {
    const image = new Image();
    image.src = "data:image/png;base64,${data}";
    await image.decode();
    const canvas = new OffscreenCanvas(${size}, ${size}), context = canvas.getContext("2d");
    context.drawImage(image, ${Math.round(-x + size / 2)}, ${Math.round(-y + size / 2)});
    const { data } = context.getImageData(0, 0, ${size}, ${size});
    return Array.from({ length: ${size * size} }, (_, i) => [data[4 * i], data[4 * i + 1], data[4 * i + 2]]);
  })()`);
};
const brightness = ([r, g, b]) => (r + 2 * g + b) / 4;

export const tests = [
  ["bones and morph weights are the frames'", (context) => showsFrames(context, "hello.html", 2e-6)],
  ["an .npz shows the same", (context) => showsFrames(context, "npz.html", 2e-5)],
  ["a .glb shows the same", (context) => showsFrames(context, "glb.html", 2e-5)],

  [
    "parts and levels of layout frames have lanes of their own",
    async (context) => {
      const page = await opened(context, "frames.html");
      const parts = await page.value("umo.scene.record.parts.map(({ name, levels }) => `${name} ${levels}`)");
      assert.deepEqual(parts, ["lower 2", "intent 1", "brows 1", "hands 3", "jaw 4", "upper 2"]);
      const [places, keyframes] = await page.value("[umo.scene.record.codes.length, Math.ceil(umo.frames / umo.scene.record.every)]");
      assert.equal(places, 13 * keyframes);
      await page.value("umo.seek(1)");
      await closed(page);
    },
  ],

  ["a conversation shows every member at its place, with the sound of all", (context) => showsMembers(context, "talk.html", 1e-5)],
  ["a .glb of a conversation shows the same", (context) => showsMembers(context, "talk-read.html", 3e-5)],

  [
    "a conversation without sound plays",
    async (context) => {
      const page = await opened(context, "talk-mute.html");
      assert.equal(await page.value("umo.members().length"), 2);
      await page.value("umo.seek(0); umo.play()");
      await until(() => page.value("umo.playing && umo.time > 0.5"));
      await closed(page);
    },
  ],

  [
    "the figure is drawn where its bones are",
    async (context) => {
      const page = await opened(context);
      for (const [camera, joint] of [["whole", "head"], ["whole", "spine2"], ["half", "spine3"], ["face", "head"], ["hands", "left_wrist"]]) {
        await page.value(`umo.camera(${JSON.stringify(camera)}); umo.seek(2)`);
        assert.equal(await alpha(page, await page.value(`umo.onScreen(${JSON.stringify(joint)})`)), 255, `${joint} in ${camera}`);
      }
      await page.value(`umo.camera("whole"); umo.seek(2)`);
      assert.equal(await alpha(page, [4, 4]), 0, "a corner is empty");
      await closed(page);
    },
  ],

  [
    "relief is seen close by, and fades before its stitches are smaller than pixels can show",
    async (context) => {
      const page = await opened(context);
      // Frames in which no hand covers the chest.
      const free = await page.value(`(() => {
        umo.camera("half");
        let [best, most] = [0, 0];
        for (let time = 0.4; time < 7; time += 0.2) {
          umo.seek(time);
          const [x, y] = umo.onScreen("spine3");
          const apart = ["left_wrist", "right_wrist"].map((wrist) => umo.onScreen(wrist)).map((at) => Math.hypot(at[0] - x, at[1] - y));
          if (Math.min(...apart) > most) [best, most] = [time, Math.min(...apart)];
        }
        return best;
      })()`);
      // Mean difference in brightness between a pixel of the chest and the mean of its neighbours, of 255.
      const roughness = async () => {
        await pictures(page, 4);
        return page.value(`(() => {
          umo.seek(${free});
          const view = document.querySelector("#view"), gl = view.getContext("webgl2"), scale = view.width / view.clientWidth;
          const [x, y] = umo.onScreen("spine3"), size = 24, pixels = new Uint8Array(4 * size * size);
          gl.readPixels(Math.round(x * scale) - size / 2, view.height - Math.round(y * scale) - size / 2, size, size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
          let sum = 0;
          for (let i = size + 1; i < size * (size - 1) - 1; i++) {
            if (i % size === 0 || i % size === size - 1) continue;
            const at = (j) => pixels[4 * j + 1];
            sum += Math.abs(at(i) - (at(i - 1) + at(i + 1) + at(i - size) + at(i + size)) / 4);
          }
          return sum / (size - 2) ** 2;
        })()`);
      };
      // Wheel steps from half body: stitches of two and a half pixels, and of fourteen.
      const from = async (steps) => {
        await page.value(`umo.camera("half"); umo.seek(${free}); for (let i = 0; i < ${Math.abs(steps)}; i++) {
          const wheel = { deltaY: ${60 * Math.sign(steps)}, bubbles: true, cancelable: true };
          document.querySelector("#view").dispatchEvent(new WheelEvent("wheel", wheel));
        }`);
        return roughness();
      };
      const [afar, near] = [await from(3), await from(-10)];
      assert.ok(near > 1, `close by it is ${near}`);
      assert.ok(afar < 0.24, `from afar it is ${afar}`);
      await closed(page);
    },
  ],

  [
    "stands before a soft backdrop that is brightest behind it",
    async (context) => {
      const page = await opened(context);
      for (const theme of ["dark", "light"]) {
        await page.value(`umo.theme("${theme}"); umo.camera("whole"); umo.seek(2)`);
        await pictures(page, 10);
        const [, y] = await page.value(`umo.onScreen("neck")`);
        const row = [];
        for (const x of [30, 160, 290, 420]) {
          const square = (await seen(page, [x, y], 16)).map(brightness);
          assert.ok(Math.max(...square) - Math.min(...square) <= 8, `${theme}: at ${x} it is not soft: ${square}`);
          row.push(square.reduce((sum, one) => sum + one) / square.length);
        }
        row.slice(1).forEach((one, i) => assert.ok(one > row[i] - 1, `${theme}: ${row} from the edge to the middle`));
        assert.ok(row.at(-1) > row[0] + 12, `${theme}: ${row} from the edge to the middle`);
      }
      await closed(page);
    },
  ],

  [
    "each eye has a catch light, in the same place wherever it looks",
    async (context) => {
      const page = await opened(context);
      const looks = truth.header.face.names.flatMap((name, i) => (name.startsWith("eyeLook") ? [i] : []));
      // The lids cover the light where they are low, and where eyes look up from a bowed head.
      const lids = truth.header.face.names.flatMap((name, i) => (/^eye(Blink|Squint|LookUp)/.test(name) ? [i] : []));
      const open = truth.frames.map((_, i) => i).filter((i) => lids.every((lid) => truth.frames[i].face[lid] < 0.25));
      const apart = (a, b) => Math.hypot(...looks.map((look) => truth.frames[a].face[look] - truth.frames[b].face[look]));
      const other = open.reduce((most, i) => (apart(open[0], i) > apart(open[0], most) ? i : most));
      assert.ok(apart(open[0], other) > 0.1, "the eyes move");
      const found = [];
      for (const frame of [open[0], other]) {
        await page.value(`umo.camera("face"); umo.seek(${frame} / ${RATE})`);
        await pictures(page, 10);
        await page.value(`umo.seek(${frame} / ${RATE})`);
        for (const eye of ["left_eye", "right_eye"]) {
          const size = 48;
          const square = (await seen(page, await page.value(`umo.onScreen("${eye}")`), size)).map(brightness);
          const most = Math.max(...square);
          const light = square.flatMap((one, i) => (one > most - 12 ? [[i % size, Math.floor(i / size)]] : []));
          found.push({ most, count: light.length, place: [0, 1].map((axis) => light.reduce((sum, at) => sum + at[axis], 0) / light.length) });
        }
      }
      for (const { most, count } of found) {
        assert.ok(most > 225, `nothing shines: ${JSON.stringify(found)}`);
        // The light covers up to 72 pixels in these poses.
        assert.ok(count <= 90, `more than a catch light shines: ${JSON.stringify(found)}`);
      }
      for (const eye of [0, 1]) near(found[eye].place, found[2 + eye].place, 3, "the catch light");
      await closed(page);
    },
  ],

  [
    "the floor is dark under the feet that stand on it",
    async (context) => {
      const page = await opened(context);
      for (const [theme, foot] of ["dark", "light"].flatMap((theme) => ["left_foot", "right_foot"].map((foot) => [theme, foot]))) {
        await page.value(`umo.theme("${theme}"); umo.camera("whole"); umo.seek(2)`);
        await pictures(page, 10);
        // The bare floor's colour from the shoe's tip towards the camera, where the lamp casts no shadow.
        const floor = await page.value(`(() => {
          umo.seek(2);
          const view = document.querySelector("#view"), gl = view.getContext("webgl2"), scale = view.width / view.clientWidth;
          const [x, y] = umo.onScreen("${foot}"), length = 120, pixels = new Uint8Array(4 * length);
          gl.readPixels(Math.round(x * scale), view.height - Math.round(y * scale) - length, 1, length, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
          const down = Array.from({ length }, (_, i) => pixels.subarray(4 * (length - 1 - i)).subarray(0, 4));
          const tip = down.findLastIndex(([, , , alpha]) => alpha === 255);
          return down.slice(tip + 2).map(([, green, , alpha]) => green / alpha);
        })()`);
        assert.ok(floor.length > 40, `${theme}, ${foot}: the floor is not visible`);
        const [close, far] = [floor.slice(0, 3), floor.slice(35, 40)].map((part) => part.reduce((sum, one) => sum + one) / part.length);
        // 0.85 at the right foot in this pose.
        assert.ok(close < 0.87 * far, `${theme}, ${foot}: ${close} at the shoe, ${far} before it`);
        assert.ok(close > 0.1 * far, `${theme}, ${foot}: black`);
      }
      await closed(page);
    },
  ],

  [
    "pictures at known times",
    async (context) => {
      const page = await opened(context);
      for (const [name, camera, seconds, theme] of [
        ["half", "half", 1.4, "dark"],
        ["whole", "whole", 1, "dark"],
        ["face", "face", 2.5, "dark"],
        ["hands", "hands", 4, "dark"],
        ["light", "half", 5, "light"],
        ["light-face", "face", 3.2, "light"],
      ]) {
        await page.value(`umo.theme("${theme}"); umo.camera("${camera}"); umo.skeleton(${name === "hands"}); umo.seek(${seconds})`);
        await pictures(page, 10);
        await page.picture(context.at(`${name}.png`));
      }
      await closed(page);
    },
  ],

  [
    "plays with its audio, at other speeds, and stops",
    async (context) => {
      const page = await opened(context);
      // The audio time at each frame, and the frame's own time; the test uses no clock.
      const watch = (count) =>
        page.value(`new Promise((done) => {
          const { audio } = umo.clock, seen = [];
          const look = () => {
            const before = seen.at(-1)?.count ?? -1;
            const { count, time } = umo.drawn;
            if (count > before) seen.push({ count, time, heard: audio.currentTime, rate: audio.playbackRate });
            if (seen.length < ${count} && umo.playing) requestAnimationFrame(look);
            else done(seen);
          };
          requestAnimationFrame(look);
        })`);
      const setSpeed = (speed) =>
        page.value(`(() => { const speed = document.querySelector("#speed"); speed.value = "${speed}"; speed.dispatchEvent(new Event("change")); })()`);
      // Slow playback, so that a machine that draws one frame a second still draws some.
      await setSpeed(0.25);
      await page.value("umo.play()");
      const seen = await watch(6);
      assert.ok(seen.length > 2 && seen.at(-1).time > seen[0].time, `pictures follow: ${JSON.stringify(seen)}`);
      seen.forEach(({ time, heard, rate }, i) => {
        assert.ok(rate === 0.25 && time <= heard + 1e-6 && time >= (i > 0 ? seen[i - 1].time : 0), `a picture of ${time} s while ${heard} s are heard`);
      });
      await setSpeed(2);
      assert.deepEqual(await page.value("[umo.clock.audio.playbackRate, umo.clock.audio.preservesPitch]"), [2, true]);
      await page.value("umo.pause()");
      const still = await page.value("umo.time");
      await pictures(page, 10);
      assert.equal(await page.value("umo.time"), still);
      await page.value(`umo.seek(umo.seconds - 0.3); umo.play()`);
      await until(() => page.value("!umo.playing"));
      near([await page.value("umo.time")], [truth.frames.length / RATE], 1e-6, "it ends at its end");
      await closed(page);
    },
  ],

  [
    "without audio goes by the time that passes, as fast as it is told",
    async (context) => {
      const page = await opened(context, "glb.html");
      const told = await page.value(`(() => {
        let now = 5000;
        performance.now = () => now;
        const passed = (seconds) => ((now += 1000 * seconds), umo.time);
        const { clock } = umo;
        umo.play();
        const told = [passed(0.5)];
        clock.setRate(2);
        told.push(passed(0.5));
        clock.setRate(0.25);
        told.push(passed(1));
        umo.pause();
        told.push(passed(9));
        clock.setRate(1);
        umo.play();
        told.push(passed(1000), umo.playing);
        return told;
      })()`);
      near(told.slice(0, 5), [0.5, 1.5, 1.75, 1.75, truth.frames.length / RATE], 1e-6, "the time");
      assert.equal(told[5], false, "it ends at its end");
      await closed(page);
    },
  ],

  [
    "scrubs on the timeline and on the slider",
    async (context) => {
      const page = await opened(context);
      await page.value("umo.details(true); umo.seek(0)");
      const [left, right] = [await page.place("#timeline canvas", 0.4, 0.1), await page.place("#timeline canvas", 0.6, 0.1)];
      await page.drag([left]);
      const first = await page.value("umo.time");
      await page.drag([left, right]);
      const second = await page.value("umo.time");
      assert.ok(first > 0 && second > first, `${first}, then ${second}`);
      await until(() => page.value("Math.abs(umo.time - umo.drawn.time) < 1e-6"), 120, "the picture to follow");
      await page.value("umo.seek(0)");
      await page.drag([await page.place("#seek", 0.5)]);
      near([await page.value("umo.time")], [truth.frames.length / RATE / 2], 0.15, "the slider's middle");
      await closed(page);
    },
  ],

  [
    "is played by keyboard",
    async (context) => {
      const page = await opened(context);
      const time = () => page.value("umo.time");
      await page.key("ArrowRight");
      near([await time()], [1 / RATE], 1e-9, "a frame on");
      await page.key(".");
      near([await time()], [3 / RATE], 1e-9, "the next keyframe");
      await page.key(".");
      await page.key(",");
      near([await time()], [3 / RATE], 1e-9, "a keyframe back");
      await page.key("l");
      near([await time()], [3 / RATE + 1], 1e-9, "a second on");
      await page.key(" ");
      await until(() => page.value("umo.playing"));
      await page.key(" ");
      await until(() => page.value("!umo.playing"));
      for (const [key, name] of [["1", "face"], ["3", "whole"], ["4", "hands"], ["2", "half"]]) {
        await page.key(key);
        const pressed = await page.value(`[...document.querySelectorAll("[data-camera][aria-pressed=true]")].map((one) => one.dataset.camera)`);
        assert.deepEqual(pressed, [name]);
      }
      await page.key("d");
      assert.equal(await page.value(`document.querySelector("#details").getAttribute("aria-expanded")`), "true");
      await page.key("s");
      assert.equal(await page.value(`document.querySelector("#skeleton").getAttribute("aria-pressed")`), "true");
      await page.key("?");
      assert.ok(await page.value(`document.querySelector("#help").open`));
      await pictures(page, 10);
      await page.picture(context.at("help.png"));
      await page.key("Escape");
      await until(() => page.value(`!document.querySelector("#help").open`));
      const seen = new Set();
      for (let i = 0; i < 18; i++) {
        await page.key("Tab");
        const [id, outline] = await page.value(`(() => {
          const one = document.activeElement;
          return [one.id || one.dataset.camera || one.ariaLabel || one.tagName, getComputedStyle(one).outlineStyle];
        })()`);
        seen.add(id);
        assert.notEqual(outline, "none", `${id} shows that it has the focus`);
      }
      for (const id of ["view", "play", "seek", "face", "half", "whole", "skeleton", "details", "theme"]) assert.ok(seen.has(id), `${id} among ${[...seen]}`);
      await closed(page);
    },
  ],

  [
    "says how each frame was made",
    async (context) => {
      const page = await opened(context);
      const isShown = (id) => page.value(`document.querySelector("${id}").getBoundingClientRect().width > 0`);
      for (const id of ["#frame", "#experts", "#timeline", "#tracks"]) assert.equal(await isShown(id), false, `${id} at first`);
      await page.click("#details");
      for (const id of ["#frame", "#experts", "#timeline", "#tracks"]) assert.equal(await isShown(id), true, `${id} on request`);
      const words = () => page.value(`document.querySelector("#frame").textContent`);
      for (const [frame, kind] of [[0, "keyframe"], [7, "interpolated"], [12, "keyframe"], [29, "interpolated"]]) {
        await page.value(`umo.seek(${frame} / ${RATE})`);
        assert.equal(await words(), `frame ${frame} · ${kind}`);
      }
      const record = await page.value("(({ chunks, kinds, experts }) => ({ chunks, kinds, experts }))(umo.scene.record)");
      const frames = record.chunks.reduce((sum, { first, frames }) => (assert.equal(first, sum), sum + frames), 0);
      assert.equal(frames, truth.frames.length, "chunks follow each other to the end");
      assert.deepEqual(record.kinds, ["text", "audio", "history", "chunk"]);
      const rows = await page.value(`[...document.querySelectorAll("#experts tr")].map((row) => row.querySelector(".shares").ariaLabel)`);
      assert.equal(rows.length, 4);
      // In the encoder, every layer sees all of the window's audio once: 20 keyframes of 5 units and two markers.
      const audio = rows[1].match(/\d+(?=,|$)/g).map(Number).reduce((a, b) => a + b, 0);
      const layers = await page.value("umo.scene.record.encoderLayers");
      assert.equal(audio, layers * 102, rows[1]);
      await closed(page);
    },
  ],

  [
    "words can be read, and what can be pressed has a name",
    async (context) => {
      const page = await opened(context);
      await page.value("umo.details(true)");
      for (const theme of ["dark", "light"]) {
        await page.value(`umo.theme("${theme}"); umo.seek(0)`);
        const faint = await page.value(`(() => {
          const context = Object.assign(document.createElement("canvas"), { width: 1, height: 1 }).getContext("2d", { willReadFrequently: true });
          // Composites colours, the lowest first.
          const paint = (colors) => {
            context.clearRect(0, 0, 1, 1);
            for (const color of colors) { context.fillStyle = color; context.fillRect(0, 0, 1, 1); }
            return [...context.getImageData(0, 0, 1, 1).data].slice(0, 3);
          };
          const light = (color) => color.map((x) => x / 255).map((x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4))
            .reduce((sum, x, i) => sum + x * [0.2126, 0.7152, 0.0722][i], 0);
          const faint = [];
          for (const one of document.querySelectorAll("body *:not(script)")) {
            const words = [...one.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
            if (!words || one.getBoundingClientRect().width === 0 || one.disabled) continue;
            const under = [];
            for (let above = one; above; above = above.parentElement) under.unshift(getComputedStyle(above).backgroundColor);
            const [a, b] = [paint([...under, getComputedStyle(one).color]), paint(under)].map(light).sort((a, b) => b - a);
            const ratio = (a + 0.05) / (b + 0.05);
            if (ratio < 4.5) faint.push([one.id || one.className || one.tagName, one.textContent.trim().slice(0, 20), ratio.toFixed(2)].join(" "));
          }
          return faint;
        })()`);
        assert.deepEqual(faint, [], `too little contrast in ${theme}`);
      }
      const nameless = await page.value(`[...document.querySelectorAll("button, input, select, canvas, [role=group]")].filter((one) =>
        !(one.ariaLabel || one.textContent.trim() || one.closest("label")?.textContent.trim())).map((one) => one.outerHTML.slice(0, 80))`);
      assert.deepEqual(nameless, [], "without a name");
      await closed(page);
    },
  ],

  [
    "fits a phone",
    async (context) => {
      for (const width of [390, 320]) {
        const page = await opened(context, "hello.html", { width, height: 844, phone: true, media: REDUCED });
        const fits = async () => {
          assert.equal(await page.value("document.documentElement.scrollWidth"), width);
          const wide = await page.value(`[...document.querySelectorAll("body *")].filter((one) => {
            const { left, right, width } = one.getBoundingClientRect();
            return width > 0 && (right > innerWidth + 0.5 || left < -0.5) && !one.closest(".playhead");
          }).map((one) => one.id || one.className || one.tagName)`);
          assert.deepEqual(wide, [], `too wide at ${width}`);
          const small = await page.value(`[...document.querySelectorAll("button, select, input[type=range]")].filter((one) => {
            const { width, height } = one.getBoundingClientRect();
            return width > 0 && Math.min(width, height) < 44;
          }).map((one) => one.id || one.textContent)`);
          assert.deepEqual(small, [], "what is pressed is large enough for a finger");
        };
        for (const camera of ["whole", "half", "face"]) {
          await page.value(`umo.camera("${camera}"); umo.seek(1.4)`);
          await pictures(page, 10);
          await page.value("umo.seek(1.4)");
          await fits();
          await page.picture(context.at(`phone-${width}-${camera}.png`));
          // Crown, chin and eyes must be covered by nothing.
          const covered = await page.value(`(() => {
            const [x, y] = umo.onScreen("head"), eye = umo.onScreen("left_eye")[1];
            const size = 1.8 * (y - eye);
            return [[x, eye], [x, eye - size], [x, y + 0.4 * size], [x - 0.5 * size, eye], [x + 0.5 * size, eye]]
              .map(([x, y]) => document.elementFromPoint(x, y)?.id ?? "nothing").filter((id) => id !== "view");
          })()`);
          assert.deepEqual(covered, [], `over the face in ${camera} at ${width}`);
        }
        await page.value("umo.details(true); umo.seek(1.4)");
        await pictures(page, 10);
        await fits();
        await page.picture(context.at(`phone-${width}-made.png`));
        await closed(page);
      }
    },
  ],

  [
    "one's own character moves as the figure does",
    async (context) => {
      for (const [name, size, frames] of [["onto.html", 1, [0, 101]], ["moved.html", 1, [180]], ["giant.html", 0.966, [101]]]) {
        const page = await opened(context, name, { width: 480, height: 480, media: REDUCED });
        assert.equal(await page.value("umo.frames"), truth.frames.length);
        for (const index of frames) {
          await page.value(`umo.camera("whole"); umo.seek(${index} / ${RATE})`);
          const joints = await page.value("umo.joints()");
          const wanted = places(truth, truth.frames[index]);
          const from = (place, root) => place.map((x, i) => x - root[i]);
          joints.forEach(({ name: joint, place }, i) => {
            const expected = from(wanted[i], wanted[0]).map((x) => x * size);
            // The giant is displayed 1.7 m tall.
            near(from(place, joints[0].place), expected, size === 1 ? 0.002 : 0.01, `${name}, frame ${index}, ${joint}`);
          });
          const weights = await page.value("umo.weights()");
          truth.header.face.names.forEach((shape, i) => near([weights[shape] ?? 0], [truth.frames[index].face[i]], 1e-4, `${name}, ${shape}`));
          for (const joint of ["head", "left_knee"]) {
            assert.equal(await alpha(page, await page.value(`umo.onScreen("${joint}")`)), 255, `${joint} in ${name}`);
          }
        }
        // Pages show the record of how the motion was made if there is one; otherwise the curves come from the file.
        assert.equal(await page.value("umo.scene.record !== null"), name !== "moved.html");
        assert.ok(await page.value(`document.querySelectorAll("#track-list label").length > 55`));
        await page.value(`umo.camera("half"); umo.seek(1.4)`);
        await page.picture(context.at(name.replace("html", "png")));
        await closed(page);
      }
    },
  ],

  [
    "saves picture and sound as a video",
    async (context) => {
      const page = await opened(context);
      await page.click("#video");
      await until(() => page.value("umo.playing"), 30, "the start");
      assert.equal(await page.value('document.querySelector("#video").ariaLabel'), "Stop video");
      await until(() => page.value("umo.scene.video !== undefined"), 60, "the file");
      const { size, type, seconds, wide, loudest, colours } = await page.value(`(async () => {
        const file = umo.scene.video;
        const video = document.createElement("video");
        video.src = URL.createObjectURL(file);
        video.muted = true;
        await new Promise((done) => (video.onloadeddata = done));
        // A recorder does not write the duration; seeking far beyond the end finds it.
        video.currentTime = 1e6;
        await new Promise((done) => (video.onseeked = done));
        const seconds = video.currentTime;
        const canvas = Object.assign(document.createElement("canvas"), { width: 64, height: 64 });
        const painter = canvas.getContext("2d", { willReadFrequently: true });
        // A busy browser seeks, and has no picture of the place yet: it plays until there is one.
        video.currentTime = 0;
        await video.play();
        let colours = 0;
        for (let tries = 0; colours <= 50 && tries < 100; tries++) {
          await new Promise((done) => setTimeout(done, 100));
          painter.drawImage(video, 0, 0, 64, 64);
          colours = new Set(new Uint32Array(painter.getImageData(0, 0, 64, 64).data.buffer)).size;
        }
        video.pause();
        const sound = await new OfflineAudioContext(1, 1, 48000).decodeAudioData(await file.arrayBuffer());
        const loudest = sound.getChannelData(0).reduce((most, x) => Math.max(most, Math.abs(x)), 0);
        return { size: file.size, type: file.type, seconds, wide: video.videoWidth, loudest, colours };
      })()`);
      assert.match(type, /^video\//);
      // It records in real time: where drawing is slow it is longer.
      assert.ok(seconds > 229 / RATE - 1.2 && seconds < (2 * 229) / RATE, `${seconds} s`);
      assert.ok(wide > 500 && size > 50_000 && colours > 50, `${wide} pixels wide, ${size} bytes, ${colours} colours`);
      assert.ok(loudest > 0.1, `the sound reaches ${loudest}`);
      assert.equal(await page.value('document.querySelector("#video").ariaLabel'), "Save video");
      await closed(page);
    },
  ],

  [
    "says where a file that is dropped can be shown",
    async (context) => {
      const page = await opened(context);
      const notice = (text) => until(async () => text.test(await page.value('document.querySelector("#notice").textContent')), 10, `${text}`);
      await page.drop("#view", context.at("stranger.glb"));
      await notice(/umo view RECORDING --onto stranger\.glb/);
      await page.drop("#view", context.speech);
      await notice(/umo view hello\.wav/);
      await page.picture(context.at("dropped.png"));
      await closed(page);
    },
  ],

  [
    "moves by itself only for those who do not mind",
    async (context) => {
      const calm = await opened(context);
      await pictures(calm, 18);
      assert.deepEqual(await calm.value("[umo.playing, umo.time]"), [false, 0]);
      const head = () => calm.value(`umo.onScreen("head")`);
      await calm.value(`umo.camera("face")`);
      await until(() => calm.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"));
      const at = await head();
      await pictures(calm, 15);
      near(await head(), at, 0.01, "the camera is there at once");
      await closed(calm);
      const lively = await opened(context, "hello.html", { width: 480, height: 360 });
      await until(() => lively.value("umo.playing && umo.time > 0.1"));
      // Length of the neck in the picture, frame by frame, while the camera moves closer.
      const sizes = await lively.value(`new Promise((done) => {
        umo.pause();
        umo.camera("whole");
        umo.seek(1);
        const sizes = [];
        const look = () => {
          const [head, neck] = ["head", "neck"].map(umo.onScreen);
          sizes.push(Math.hypot(head[0] - neck[0], head[1] - neck[1]));
          const last = sizes.slice(-4);
          if (sizes.length < 8 || last.at(-1) - last[0] > 0.02) requestAnimationFrame(look);
          else done(sizes);
        };
        umo.camera("face");
        requestAnimationFrame(look);
      })`);
      const nearest = sizes.at(-1);
      assert.ok(nearest > 3 * sizes[0], `the face is nearer than the whole body: ${sizes}`);
      assert.ok(sizes.filter((size) => size > 1.1 * sizes[0] && size < 0.9 * nearest).length >= 3, `the camera moves: ${sizes}`);
      sizes.slice(1).forEach((size, i) => assert.ok(size > sizes[i] - 0.5, `it does not turn back: ${sizes}`));
      await closed(lively);
    },
  ],
];
