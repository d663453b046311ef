// The page of takes: the score that is edited, the page as served, and takes side by side.

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import fs from "node:fs";
import http from "node:http";
import { pathToFileURL } from "node:url";

import { until } from "./chromium.mjs";

const REDUCED = [{ name: "prefers-reduced-motion", value: "reduce" }];
/** A score whose every line is known, in place of the take's own. */
const EVENTS = [
  { at: 0, to: 0.6, both: "rest" },
  { at: 0.3, to: 0.62, words: "hello" },
  { at: 0.6, to: 0.9, right: "prepare" },
  { at: 0.9, to: 1.3, right: "stroke", strength: 0.62 },
  { at: 1.3, to: 1.6, right: "hold" },
  { at: 1.6, to: 1.9, right: "retract" },
  { at: 2.4, to: 2.8, both: "stroke", strength: 0.9 },
  { at: 4.2, gesture: "there", side: "right" },
  { at: 0, look: [0, 1.6, 2], strength: 1 },
  { at: 0, mood: "sad", strength: 0.5 },
];
const LINES = [
  '{ at = 0, to = 0.6, both = "rest" }',
  "{ at = 0, look = [0, 1.6, 2], strength = 1 }",
  '{ at = 0, mood = "sad", strength = 0.5 }',
  '{ at = 0.3, to = 0.62, words = "hello" }',
  '{ at = 0.6, to = 0.9, right = "prepare" }',
  '{ at = 0.9, to = 1.3, right = "stroke", strength = 0.62 }',
  '{ at = 1.3, to = 1.6, right = "hold" }',
  '{ at = 1.6, to = 1.9, right = "retract" }',
  '{ at = 2.4, to = 2.8, both = "stroke", strength = 0.9 }',
  '{ at = 4.2, gesture = "there", side = "right" }',
];
const SHIFT = 8;
const CONTROL = 2;
let server;
let address;

export async function prepare({ umo, run, at, speech }) {
  fs.writeFileSync(at("take.srt"), "1\n00:00:00,300 --> 00:00:01,050\nhello there\n\n2\n00:00:01,400 --> 00:00:02,600\nI \\am\n");
  run("animate", speech, "--words", at("take.srt"), "-o", at("take.umo"));
  run("animate", speech, "--seed", "1", "-o", at("other.umo"));
  run("view", at("take.umo"), "--audio", speech, "-o", at("take.html"), "--no-open");
  run("view", at("other.umo"), at("take.umo"), "--audio", speech, "-o", at("takes.html"), "--no-open");
  const page = fs.readFileSync(at("take.html"), "utf8");
  const [, description] = page.match(/id="scene">([^]*?)<\/script>/);
  const scene = JSON.parse(description);
  scene.takes.score.events = EVENTS;
  fs.writeFileSync(at("score.html"), page.replace(description, () => JSON.stringify(scene)));
  for (const name of ["served.toml", "served-kept.umo"]) fs.rmSync(at(name), { force: true });
  fs.copyFileSync(at("take.umo"), at("served.umo"));
  server = spawn(umo, ["view", at("served.umo"), "--audio", speech, "--live", "--no-open"], { stdio: ["ignore", "pipe", "inherit"] });
  let said = "";
  server.stdout.setEncoding("utf8").on("data", (text) => (said += text));
  address = await until(() => said.match(/http:\/\/127\.0\.0\.1:\d+\//)?.[0], 120, "the server's address");
}

export function end() {
  server.kill("SIGKILL");
}

const text = (lines, seconds = "7.633") =>
  `# What a take does, in seconds: docs/scores.md\nversion = 1\nseconds = ${seconds}\nevents = [\n${lines.map((line) => `    ${line},\n`).join("")}]\n`;

/** The lines with some replaced: `{ old: [new…] }`. */
const replaced = (changes) => text(LINES.flatMap((line) => changes[line] ?? [line]));

async function opened({ browser, at }, name = "score.html", options = { width: 1280, height: 900 }) {
  const page = await browser.open(name.startsWith("http") ? name : pathToFileURL(at(name)).href, { media: REDUCED, ...options });
  await page.ready();
  await page.value("umo.details(true)");
  return page;
}

async function closed(page) {
  assert.deepEqual(page.errors, []);
  // An edit that is not saved holds the page.
  await page.value("addEventListener('beforeunload', (event) => event.stopImmediatePropagation(), true)");
  await page.close();
}

/** Name and bytes of the file that is saved as something is done. */
async function saved(page, act) {
  await page.value(`void (window.savedFile = new Promise((done) => {
    const own = URL.createObjectURL;
    URL.createObjectURL = (file) => {
      URL.createObjectURL = own;
      file.arrayBuffer().then((bytes) => done({ name: file.name, bytes: [...new Uint8Array(bytes)] }));
      return own(file);
    };
  }))`);
  await act();
  const { name, bytes } = await page.value("savedFile");
  return { name, bytes: Buffer.from(bytes) };
}

const savedScore = async (page) => {
  const { name, bytes } = await saved(page, () => page.click("#save"));
  assert.equal(name, "take.toml");
  return bytes.toString();
};

const score = (page, what) => page.value(`umo.score.${what}`);
const numberOf = (page, condition) => page.value(`umo.score.events.find((event) => ${condition}).id`);
const selector = (id) => `.event[data-id="${id}"]`;
const said = (page) => page.value('document.querySelector("#notice").textContent');
const pixels = (page, seconds) => page.value(`(({ timeline }) => timeline.x(${seconds}) - timeline.x(0))(umo.score)`);

/** Drags an event, from this share of its width, by some seconds. */
async function drag(page, id, seconds, across = 0.5) {
  const [x, y] = await page.place(selector(id), across);
  const by = await pixels(page, seconds);
  const inside = across === 0 ? 2 : across === 1 ? -2 : 0;
  await page.drag([[x + inside, y], [x + by / 2, y], [x + inside + by, y]]);
}

const STROKE = LINES[5];

export const tests = [
  [
    "a score is saved as it is, and a stroke that is dragged cuts what it comes over",
    async (context) => {
      const page = await opened(context);
      assert.equal(await savedScore(page), text(LINES));
      const stroke = await numberOf(page, 'event.right === "stroke"');
      await drag(page, stroke, 0.5);
      assert.equal(await score(page, "chosen"), stroke);
      assert.equal(
        await savedScore(page),
        replaced({
          [STROKE]: [],
          [LINES[6]]: ['{ at = 1.3, to = 1.4, right = "hold" }', '{ at = 1.4, to = 1.8, right = "stroke", strength = 0.62 }'],
          [LINES[7]]: ['{ at = 1.8, to = 1.9, right = "retract" }'],
        }),
      );
      // Over both hands, the other hand keeps its own.
      await drag(page, stroke, 1.2);
      assert.equal(
        await savedScore(page),
        replaced({
          [STROKE]: [],
          [LINES[6]]: ['{ at = 1.3, to = 1.4, right = "hold" }'],
          [LINES[7]]: ['{ at = 1.8, to = 1.9, right = "retract" }'],
          [LINES[8]]: ['{ at = 2.4, to = 2.6, both = "stroke", strength = 0.9 }', '{ at = 2.6, to = 2.8, left = "stroke", strength = 0.9 }', '{ at = 2.6, to = 3, right = "stroke", strength = 0.62 }'],
        }),
      );
      await page.picture(context.at("score.png"));
      await closed(page);
    },
  ],

  [
    "ends are dragged, and no event leaves the take",
    async (context) => {
      const page = await opened(context);
      const stroke = await numberOf(page, 'event.right === "stroke"');
      await drag(page, stroke, 0.2, 1);
      await drag(page, stroke, 0.3, 0);
      const lines = {
        [STROKE]: ['{ at = 1.2, to = 1.5, right = "stroke", strength = 0.62 }'],
        [LINES[6]]: ['{ at = 1.5, to = 1.6, right = "hold" }'],
      };
      assert.equal(await score(page, "text"), replaced(lines));
      await drag(page, stroke, 0.9, 0);
      assert.equal(await score(page, "event.at"), 1.4, "a span of the hands has a length");
      await page.value("umo.score.undo()");
      const words = await numberOf(page, "event.words");
      await drag(page, words, -2);
      assert.equal(await score(page, "text"), replaced({ ...lines, [LINES[3]]: [], [LINES[0]]: ['{ at = 0, to = 0.32, words = "hello" }', LINES[0]] }));
      await closed(page);
    },
  ],

  [
    "events are added by a double click and by the list, deleted, undone and redone",
    async (context) => {
      const page = await opened(context);
      // The lane of the left hand, at 5 s.
      const [x, y] = await page.value(`(() => {
        const { timeline } = umo.score, { left } = timeline.canvas.getBoundingClientRect();
        const lane = [...document.querySelectorAll(".event")].find(({ dataset }) => dataset.kind === "rest").getBoundingClientRect();
        return [left + timeline.x(5.02), lane.top + 6];
      })()`);
      const mouse = (type, clickCount) => page.send("Input.dispatchMouseEvent", { type, x, y, button: "left", buttons: 1, clickCount });
      for (const count of [1, 2]) for (const type of ["mousePressed", "mouseReleased"]) await mouse(type, count);
      const added = ['{ at = 4.7, to = 5, left = "prepare" }', '{ at = 5, to = 5.4, left = "stroke", strength = 0.5 }', '{ at = 5.4, to = 5.7, left = "retract" }'];
      assert.equal(await score(page, "text"), text([...LINES, ...added]));
      assert.equal(await page.value('document.activeElement.closest("#event") !== null'), true, "its fields have the cursor");
      // A moving hand gets nothing before it, and the spans under it are cut.
      await page.value("umo.score.delete(); umo.score.undo(); umo.score.undo(); umo.seek(1.9)");
      await page.key("Escape");
      await page.value('document.activeElement.blur(); document.querySelector("#add-button").click()');
      await page.click('#add button[value="right"]');
      await until(() => score(page, 'event?.right'));
      const after = ['{ at = 1.9, to = 2.3, right = "stroke", strength = 0.5 }', '{ at = 2.3, to = 2.4, right = "retract" }'];
      assert.equal(await score(page, "text"), replaced({ [LINES[7]]: [LINES[7], ...after] }));
      await page.value("document.activeElement.blur()");
      await page.click("#delete");
      assert.equal(await score(page, "text"), replaced({ [LINES[7]]: [LINES[7], after[1]] }));
      await page.click("#undo");
      await page.click("#undo");
      assert.equal(await score(page, "text"), text(LINES));
      assert.equal(await page.value('document.querySelector("#undo").disabled'), true);
      await page.click("#redo");
      assert.equal(await score(page, "text"), replaced({ [LINES[7]]: [LINES[7], ...after] }));
      await closed(page);
    },
  ],

  [
    "the keyboard does it all",
    async (context) => {
      const page = await opened(context);
      for (let presses = 0; presses < 6; presses++) await page.key("n");
      assert.equal(await page.value("document.activeElement.ariaLabel"), "right hand, stroke, 0.9 to 1.3 s, strength 0.62");
      await page.key("p");
      assert.equal(await page.value("document.activeElement.ariaLabel"), "right hand, prepare, 0.6 to 0.9 s");
      await page.key("n");
      await page.key("ArrowRight");
      await page.key("]");
      await page.key("[");
      await page.key("ArrowRight", SHIFT);
      await page.key("{", SHIFT);
      await page.key("}", SHIFT);
      // The first step left the hold from 1.4 s, the longer stroke from 1.5 s.
      const moved = { [STROKE]: ['{ at = 1, to = 1.5, right = "stroke", strength = 0.62 }'], [LINES[6]]: ['{ at = 1.5, to = 1.6, right = "hold" }'] };
      assert.equal(await score(page, "text"), replaced(moved));
      await page.key("Delete");
      assert.equal(await score(page, "text"), replaced({ ...moved, [STROKE]: [] }));
      await page.key("u");
      assert.equal(await score(page, "text"), replaced(moved));
      await page.key("y");
      await page.key("z", CONTROL);
      assert.equal(await score(page, "text"), replaced(moved));
      const { bytes } = await saved(page, () => page.key("w"));
      assert.equal(bytes.toString(), replaced(moved));
      await page.value("umo.seek(6)");
      await page.key("a");
      assert.equal(await page.value('document.querySelector("#add").open'), true);
      await page.value(`document.querySelector('#add [value="mood"]').focus()`);
      await page.key(" ");
      await until(() => score(page, "event?.mood"), 20);
      assert.equal(await score(page, "text"), text([...replaced(moved).split("\n").slice(4, -2).map((line) => line.trim().slice(0, -1)), '{ at = 6, mood = "joy", strength = 0.5 }']));
      await page.key("Escape");
      await page.key("?");
      assert.match(await page.value('document.querySelector("#help").innerText'), /next event of the score/);
      await closed(page);
    },
  ],

  [
    "fields change an event, and refuse what is out of range",
    async (context) => {
      const page = await opened(context);
      const set = (name, value) =>
        page.value(`(() => {
          const row = [...document.querySelectorAll("#event label")].find(({ textContent }) => textContent.startsWith(${JSON.stringify(name)}));
          const input = row.querySelector("input, select");
          input.value = ${JSON.stringify(value)};
          input.dispatchEvent(new Event("change"));
          return input.value;
        })()`);
      await page.value(`umo.score.choose(${await numberOf(page, 'event.right === "stroke"')})`);
      await set("hands", "left");
      await set("strength", "0.25");
      assert.equal(await set("strength", "3"), "0.25");
      assert.equal(await set("from", "1.3"), "1.3");
      assert.equal(await score(page, "event.to"), 1.4, "it has a length");
      await page.value(`umo.score.choose(${await numberOf(page, "event.words")})`);
      await set("words", 'a "b"\\\n');
      await page.value(`umo.score.choose(${await numberOf(page, "event.gesture")})`);
      await set("side", "");
      await set("speed", "1.5");
      await set("variant", "0");
      await page.value(`umo.score.choose(${await numberOf(page, "event.look")})`);
      await set("y, m", "1.25");
      assert.equal(
        await score(page, "text"),
        replaced({
          [STROKE]: [],
          [LINES[6]]: ['{ at = 1.3, to = 1.4, left = "stroke", strength = 0.25 }', LINES[6]],
          // A line of a field has no line breaks.
          [LINES[3]]: ['{ at = 0.3, to = 0.62, words = "a \\"b\\"\\\\" }'],
          [LINES[9]]: ['{ at = 4.2, gesture = "there", speed = 1.5 }'],
          [LINES[1]]: ["{ at = 0, look = [0, 1.25, 2], strength = 1 }"],
        }),
      );
      await closed(page);
    },
  ],

  [
    "an event is heard, and the edit compared with what was before",
    async (context) => {
      const page = await opened(context);
      await page.value(`umo.score.choose(${await numberOf(page, 'event.right === "stroke"')})`);
      await page.click("#hear");
      await until(() => page.value("umo.playing && umo.time > 0.4 && umo.time < 1.8"), 20, "the stretch");
      await until(() => page.value("!umo.playing"), 20, "its end");
      // Where drawing is slow it ends later.
      const end = await page.value("umo.time");
      assert.ok(end >= 1.79 && end < 4, `it ended at ${end} s`);
      await page.value("umo.score.move(2)");
      const after = await score(page, "text");
      assert.match(await said(page), /umo animate hello\.wav --take take\.umo --score take\.toml/);
      await page.key("c");
      assert.equal(await page.value('document.querySelector("#before").ariaPressed'), "true");
      assert.equal(await score(page, "event.at"), 0.9);
      await page.key("ArrowRight");
      await page.key("Delete");
      assert.equal(await savedScore(page), after, "what is saved is the edit, and before it nothing is edited");
      await page.key("c");
      assert.equal(await score(page, "event.at"), 1.1);
      await closed(page);
    },
  ],

  [
    "what can be pressed has a name, words can be read, and a phone shows it all",
    async (context) => {
      const page = await opened(context, "score.html", { width: 390, height: 844, phone: true });
      await page.value(`umo.score.choose(${await numberOf(page, "event.gesture")})`);
      assert.equal(await page.value("document.documentElement.scrollWidth"), 390);
      const nameless = await page.value(`[...document.querySelectorAll("button, input, select, [role=group], [role=toolbar]")].filter((one) =>
        !(one.ariaLabel || one.textContent.trim() || one.closest("label")?.textContent.trim())).map((one) => one.outerHTML.slice(0, 80))`);
      assert.deepEqual(nameless, []);
      const small = await page.value(`[...document.querySelectorAll("button:not(.event), select, input:not([type=checkbox])")].filter((one) => {
        const { width, height } = one.getBoundingClientRect();
        return width > 0 && Math.min(width, height) < 44;
      }).map((one) => one.id || one.textContent || one.type)`);
      assert.deepEqual(small, []);
      await page.value('document.querySelector("#score").scrollIntoView()');
      await page.picture(context.at("score-phone.png"));
      await closed(page);
    },
  ],

  [
    "a page with nothing changed saves the text of `umo score`",
    async (context) => {
      const page = await opened(context, "take.html");
      assert.equal(await savedScore(page), execFileSync(context.umo, ["score", context.at("take.umo")]).toString());
      assert.ok(await score(page, "events.some((event) => event.right || event.both)"), "it has hands");
      assert.ok((await score(page, "events.some(({ words }) => words)")) && (await score(page, "events.length > 1")));
      assert.match(await savedScore(page), /words = " ?I \\\\am"/);
      assert.equal(await page.value("umo.frames"), 229);
      assert.deepEqual(page.requests.filter((one) => !/^(file|blob|data):/.test(one)), []);
      await closed(page);
    },
  ],

  [
    "the page as served saves beside the take, and answers itself alone",
    async (context) => {
      const { at } = context;
      const page = await opened(context, address);
      await page.value('umo.score.add("gesture", 3.5)');
      await page.click("#save");
      await until(async () => /saved in .*served\.toml/.test(await said(page)));
      assert.equal(fs.readFileSync(at("served.toml"), "utf8"), await score(page, "text"));
      assert.ok(!fs.existsSync(at("served-kept.umo")));
      const post = (headers) =>
        new Promise((done, failed) => {
          const request = http.request(new URL("take/score", address), { method: "POST", headers }, (answer) => done(answer.resume().statusCode));
          request.on("error", failed).end("version = 1");
        });
      const own = address.slice(0, -1);
      assert.deepEqual([await post({}), await post({ origin: "http://evil.example" }), await post({ origin: own, host: "evil.example" })], [403, 403, 421]);
      assert.equal(fs.readFileSync(at("served.toml"), "utf8"), await score(page, "text"));
      await closed(page);
    },
  ],

  [
    "the page as served draws an edit, compares it and keeps it",
    async (context) => {
      const { at } = context;
      const page = await opened(context, address);
      await until(() => page.value("umo.frames > 0"));
      const old = await page.value("umo.frame(150)");
      await page.value('umo.score.add("gesture", 4.5)');
      assert.equal(await page.value('document.querySelector("#keep").disabled'), true);
      await page.click("#draw");
      await until(async () => /^drawn/.test(await said(page)) || (await page.value('document.querySelector("#notice").dataset.kind')) === "error", 60, "the drawing");
      assert.match(await said(page), /^drawn/);
      const drawn = await page.value("umo.frame(150)");
      assert.ok(drawn.some((value, i) => Math.abs(value - old[i]) > 0.01), "the gesture moves it");
      assert.deepEqual(await page.value("umo.frame(20)"), await page.value('(umo.score.compare(true), umo.frame(20))'), "what is far from it stays");
      assert.deepEqual(await page.value("umo.frame(150)"), old);
      await page.key("c");
      assert.deepEqual(await page.value("umo.frame(150)"), drawn);
      await page.key("k");
      await until(async () => /kept in .*served-kept\.umo/.test(await said(page)));
      // The kept take plays the frames that the page shows.
      context.run("view", at("served-kept.umo"), "-o", at("kept.html"), "--no-open");
      const kept = await opened(context, "kept.html");
      assert.deepEqual(await kept.value("umo.frame(150)"), drawn);
      await closed(kept);
      await page.picture(at("score-drawn.png"));
      // A score that cannot be drawn is refused with its line.
      await page.value('umo.score.add("right", 0)');
      await page.click("#draw");
      await until(async () => /served\.toml:\d+: /.test(await said(page)), 60, "the refusal");
      assert.match(page.errors.splice(0).join(), /^Failed to load resource: .* 422 [^,]*$/);
      await closed(page);
    },
  ],

  [
    "takes side by side: one is chosen by its name and kept",
    async (context) => {
      const page = await opened(context, "takes.html", { width: 900, height: 700 });
      await page.value('umo.details(false); umo.camera("all"); umo.seek(2)');
      const names = await page.value('[...document.querySelectorAll("#names button")].map(({ textContent }) => textContent)');
      assert.deepEqual(names, ["other", "take"]);
      assert.deepEqual(await page.value("umo.scene.room.map(({ position }) => position[0] > 0)"), [false, true]);
      assert.ok(await page.value("umo.clock.audio !== undefined"), "one sound");
      await page.click("#names button:nth-child(2)");
      assert.equal(await page.value('document.querySelector("#member").value'), "1");
      const { name, bytes } = await saved(page, () => page.click("#keep"));
      assert.equal(name, "other.umo");
      assert.ok(bytes.equals(fs.readFileSync(context.at("take.umo"))));
      await page.value("umo.follow(0)");
      const other = await saved(page, () => page.key("k"));
      assert.ok(other.bytes.equals(fs.readFileSync(context.at("other.umo"))));
      await page.picture(context.at("takes.png"));
      await closed(page);
    },
  ],
];
