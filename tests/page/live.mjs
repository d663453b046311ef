// The page as served, with streams through a real engine.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import fs from "node:fs";
import http from "node:http";
import { pathToFileURL } from "node:url";

import { stranger } from "./character.mjs";
import { pause, until } from "./chromium.mjs";
import { read } from "./frames.mjs";

const OPTIONS = ["--target", "2", "--lookahead", "4"];
let server;
let address;
/** The same with a custom character on the page. */
let wearing;
let truth;

export async function prepare({ umo, run, at, short }) {
  // A live stream has no future audio.
  run("animate", short, "-o", at("short.jsonl"), "-o", at("short.glb"), "--horizon", "0", ...OPTIONS);
  truth = read(at("short.jsonl"));
  fs.writeFileSync(at("live-stranger.glb"), stranger(fs.readFileSync(at("short.glb")), truth.header.joints));
  run("retarget", at("short.jsonl"), "--onto", at("live-stranger.glb"), "-o", at("live-moved.glb"));
  run("view", at("live-moved.glb"), "-o", at("live-moved.html"), "--no-open");
  [server, address] = await served(umo, short);
  wearing = await served(umo, short, "--onto", at("live-stranger.glb"));
}

/** A server, and its address. */
async function served(umo, ...args) {
  const server = spawn(umo, ["live", ...args, "--no-open", ...OPTIONS], { stdio: ["ignore", "pipe", "inherit"] });
  server.ended = new Promise((done) => server.on("exit", (code, signal) => done({ code, signal })));
  let said = "";
  server.stdout.setEncoding("utf8").on("data", (text) => (said += text));
  return [server, await until(() => said.match(/http:\/\/127\.0\.0\.1:\d+\//)?.[0], 120, "the server's address")];
}

export function end() {
  server.kill("SIGKILL");
  wearing[0].kill("SIGKILL");
}

async function opened({ browser }, at = address) {
  const page = await browser.open(at);
  await page.ready();
  return page;
}

function near(found, wanted, most, what) {
  found.forEach((x, i) => assert.ok(Math.abs(x - wanted[i]) <= most, `${what}: ${found} is not ${wanted}`));
}

const log = (page, what) => page.value(`umo.live.log.${what}`);

/** A complete stream of the recording. */
async function stream(page) {
  // After a stop it can be pressed again from the next frame on.
  await until(() => page.value(`!document.querySelector("#recording").hidden`));
  await page.click("#recording");
  await until(() => log(page, "done"), 120, "the end of the stream");
}

/** Responses of a stream to messages; each is a text, or numbers for 32-bit floats. */
const told = (page, messages) =>
  page.value(`new Promise((done) => {
    const socket = new WebSocket("ws://" + location.host + "/v1/session");
    let told = null;
    socket.onopen = () => {
      for (const message of ${JSON.stringify(messages)}) socket.send(typeof message === "string" ? message : new Int16Array(message));
    };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string" && JSON.parse(data).type === "error") told = JSON.parse(data).reason;
    };
    socket.onclose = ({ code }) => done({ code, told });
  })`);

const request = (path, headers) =>
  new Promise((done, failed) => {
    http.get(new URL(path, address), { headers }, (answer) => done(answer.resume().statusCode)).on("error", failed);
  });

export const tests = [
  [
    "a recording's frames come in order, in time, and are the offline frames",
    async (context) => {
      const page = await opened(context);
      await page.picture(context.at("live-before.png"));
      await page.click("#recording");
      const numbers = `["#algorithmic", "#compute", "#arrival", "#behind"].every((id) => /\\d ms/.test(document.querySelector(id).textContent))`;
      await until(() => page.value(`umo.frames > 20 && umo.time > 0.3 && ${numbers}`));
      const behind = await page.value("umo.live.behind()");
      await page.picture(context.at("live.png"));
      await page.value("umo.details(true)");
      await page.picture(context.at("live-made.png"));
      const least = await page.value("umo.scene.live.algorithmicSeconds");
      // The rest depends on the machine; a stream with a simulated clock tests the page's own latency.
      assert.ok(behind >= least - 1e-3, `the picture is ${behind} s behind, the engine waits ${least}`);
      await until(() => log(page, "done"));
      assert.equal(await log(page, "inOrder"), true);
      assert.equal(await log(page, "received"), truth.frames.length);
      for (const [index, { rotations, translation, face }] of truth.frames.entries()) {
        // The sign of zero is lost on the way out of the browser.
        const wanted = [...rotations.flat(), ...translation, ...face].map((value) => Math.fround(value) + 0);
        assert.deepEqual(await page.value(`umo.frame(${index})`), wanted, `frame ${index}`);
      }
      await until(() => page.value("!umo.playing"), 120, "the end of the picture");
      assert.deepEqual(page.errors, []);
      await page.close();
    },
  ],

  [
    "the next visitor, and one who begins twice",
    async (context) => {
      const page = await opened(context);
      await page.click("#recording");
      await until(() => log(page, "received > 0"));
      await until(() => page.value(`!document.querySelector("#stop").hidden`));
      await page.click("#stop");
      await until(() => page.value("!umo.live.isRunning"));
      await stream(page);
      assert.equal(await log(page, "received"), truth.frames.length);
      assert.deepEqual(page.errors, []);
      await page.close();
    },
  ],

  [
    "a microphone moves the avatar",
    async (context) => {
      const page = await opened(context);
      await page.click("#microphone");
      await until(() => log(page, "received > 40"), 120, "frames of the microphone");
      assert.equal(await log(page, "inOrder"), true);
      assert.equal(await log(page, "error"), null);
      await until(() => page.value("umo.time > 0.5"));
      await until(() => page.value(`/^live · \\d\\.\\d\\d s behind/.test(document.querySelector("#state").textContent)`));
      await page.click("#stop");
      assert.equal(await page.value("umo.live.isRunning"), false);
      assert.deepEqual(page.errors, []);
      await page.close();
    },
  ],

  [
    "one's own character follows the stream as `umo retarget` moves it",
    async (context) => {
      const page = await opened(context, wearing[1]);
      // Before the first frame it stands at rest.
      assert.ok((await page.value("umo.joints()")).every(({ place }) => place.every(Number.isFinite)));
      await stream(page);
      assert.equal(await log(page, "received"), truth.frames.length);
      assert.equal(await log(page, "inOrder"), true);
      await until(() => page.value("!umo.playing"));
      const file = await context.browser.open(pathToFileURL(context.at("live-moved.html")).href, { media: [{ name: "prefers-reduced-motion", value: "reduce" }] });
      await file.ready();
      for (const frame of [0, 17, 40.5, truth.frames.length - 1]) {
        const [own, wanted] = await Promise.all([page, file].map((one) => one.value(`(umo.seek(${frame} / 30), [umo.joints(), umo.weights()])`)));
        own[0].forEach(({ name, place }, i) => near(place, wanted[0][i].place, 1e-4, `frame ${frame}, ${name}`));
        // Zero weights are omitted, and on one side a tiny one may be.
        const names = new Set([...Object.keys(own[1]), ...Object.keys(wanted[1])]);
        assert.ok(names.size > 20);
        for (const name of names) near([own[1][name] ?? 0], [wanted[1][name] ?? 0], 1e-4, `frame ${frame}, ${name}`);
      }
      await page.picture(context.at("live-onto.png"));
      assert.deepEqual([...page.errors, ...file.errors], []);
      await file.close();
      await page.close();
    },
  ],

  [
    "a microphone's mouth moves with the sound, and a recording's with its body",
    async (context) => {
      const page = await opened(context);
      const begun = async (source) => {
        await until(() => page.value(`!document.querySelector("#${source}").hidden`));
        await page.click(`#${source}`);
        await until(() => log(page, "started"), 120, "the beginning of the stream");
        const started = await log(page, "started");
        await until(() => page.value(`!document.querySelector("#stop").hidden`));
        await page.click("#stop");
        return started;
      };
      const [recording, microphone] = [await begun("recording"), await begun("microphone")];
      assert.equal(recording.isLive, false);
      assert.equal(recording.mouthSeconds, recording.bodySeconds);
      // The recording has the model's rate; resampling from 48 kHz adds about 40 ms.
      const more = microphone.bodySeconds - recording.bodySeconds;
      assert.ok(more >= 0 && more < 0.05, `the microphone's body is ${more} s later`);
      // 60 ms of the network and 40 of resampling. The default model may come without a mouth network.
      if (microphone.isLive) assert.ok(microphone.mouthSeconds > 0 && microphone.mouthSeconds <= 0.105, `the mouth is ${microphone.mouthSeconds} s later`);
      else assert.equal(microphone.mouthSeconds, microphone.bodySeconds);
      await page.close();
    },
  ],

  [
    "latency is that of now, a stall is caught up, and a slow machine is named",
    async (context) => {
      const page = await opened(context);
      // A stream without a program or a clock: the test sets the time and delivers frames.
      const told = await page.value(`(() => {
        const { live } = umo, { clock, motion } = live;
        let now = 100;
        const told = {};
        const frames = (count) => {
          const data = new ArrayBuffer(8 + (16 + 4 * motion.width) * count);
          const view = new DataView(data);
          view.setUint8(0, 1);
          view.setUint16(2, count, true);
          view.setBigUint64(8, BigInt(live.log.next), true);
          live.take(data);
        };
        // Each step is a frame; every fifth delivers five frames, \`late\` seconds after they could arrive.
        const run = (seconds, late) => {
          for (let step = 0; step < 30 * seconds; step++) {
            now += 1 / 30;
            while ((live.log.next + 5) / 30 <= clock.heard - late) frames(5);
            live.look();
          }
        };
        const begin = () => {
          live.log = { received: 0, next: 0, inOrder: true, late: 0, arrivals: [], pictures: [], worst: {}, done: false, error: null, stats: null, started: null };
          motion.clear();
          clock.now = () => now;
          live.socket = {};
          clock.sound = null;
          clock.begin({ isLive: false, mouthSeconds: 0.3, bodySeconds: 0.3 });
        };
        begin();
        run(3, 0.1);
        told.well = [live.behind(), live.arrival(), live.trouble(), motion.end / 30 > clock.time];
        run(2, 9);
        told.stalled = [live.behind(), live.trouble()];
        run(4, 9);
        told.long = live.trouble();
        run(3, 0.1);
        told.again = [live.behind(), live.arrival(), live.trouble(), live.log.worst.picture];
        run(8, 0.9);
        told.slow = [live.trouble(), live.arrival()];
        // A microphone whose page slept for a minute: no sound was sent, and no frame is missing.
        begin();
        live.sent = { samples: 0, now, rate: 100 };
        clock.counted = () => live.spoken();
        const speak = (seconds) => {
          for (let step = 0; step < 30 * seconds; step++) {
            now += 1 / 30;
            live.sent.samples += 100 / 30;
            live.sent.now = now;
            while ((live.log.next + 5) / 30 <= clock.heard - 0.1) frames(5);
            live.look();
          }
        };
        speak(3);
        now += 60;
        speak(2);
        told.slept = [live.behind(), live.trouble()];
        // A recording's sound that stood still, as on a page that nobody sees; then one that is nearly right.
        begin();
        clock.sound = { paused: false, ended: false, currentTime: 1, duration: 9 };
        now += 2.02;
        live.catchUp();
        told.moved = [clock.due, clock.sound.currentTime];
        now += 3;
        clock.sound.currentTime = clock.due - 0.1;
        live.catchUp();
        told.left = clock.due - clock.sound.currentTime;
        clock.sound = null;
        live.socket = null;
        clock.pause();
        return told;
      })()`);
      const delay = 0.42;
      near([told.well[0]], [delay], 0.05, "the picture is as late as it must be");
      assert.ok(told.well[1] > 0.1 && told.well[1] < 0.32, `frames come ${told.well[1]} s after their sound`);
      assert.deepEqual(told.well.slice(2), ["", true]);
      assert.ok(told.stalled[0] > 1 && told.stalled[1] === "", `a short stall is shown, not named: ${told.stalled}`);
      assert.match(told.long, /^No frame has come for \d s/);
      near([told.again[0]], [delay], 0.05, "after a stall the picture is where it was");
      assert.ok(told.again[1] < 0.32 && told.again[2] === "", `after a stall: ${told.again}`);
      assert.ok(told.again[3] > 5, "the worst is kept for the details");
      assert.match(told.slow[0], /^This machine is too slow for the model: frames come \d\.\d s after their sound/);
      near([told.slept[0]], [delay], 0.05, "after a pause of the page");
      assert.equal(told.slept[1], "");
      near(told.moved, [1.6, 1.6], 1e-6, "the sound is where the picture should be");
      near([told.left], [0.1], 1e-6, "a small distance is left alone");
      assert.deepEqual(page.errors, []);
      await page.close();
    },
  ],

  [
    "hostile messages are refused in words",
    async (context) => {
      const page = await opened(context);
      const hello = '{"type":"hello","rate":48000}';
      for (const [messages, code, words] of [
        [["{"], 4400, /not understood/],
        [['{"type":"hello","rate":1}'], 4400, /rate/],
        [['{"type":"hello","character":true}'], 4400, /shows none/],
        [[2], 4400, /first message must be a hello/],
        [[hello, hello], 4400, /second hello/],
        [[hello, 40_000], 1009, /[Mm]essage|[Ss]pace|too/],
      ]) {
        const answer = await told(page, messages);
        assert.equal(answer.code, code, JSON.stringify(messages));
        assert.match(answer.told, words);
      }
      await page.close();
    },
  ],

  [
    "a recording that is dropped onto the page is spoken",
    async (context) => {
      const page = await opened(context);
      await page.drop("#view", context.short);
      await until(() => log(page, "done"), 120, "the end of the stream");
      assert.deepEqual([await log(page, "error"), await log(page, "inOrder")], [null, true]);
      const seconds = (fs.statSync(context.short).size - 44) / 32_000;
      assert.equal(await page.value("umo.frames"), Math.floor(seconds * 30));
      await page.close();
    },
  ],

  [
    "a stream is saved as a video, to its end",
    async (context) => {
      const page = await opened(context);
      await page.click("#video");
      await until(() => page.value("umo.scene.video !== undefined"), 60, "the file");
      assert.equal(await log(page, "done"), true);
      const [seconds, loudest] = await page.value(`(async () => {
        const sound = await new OfflineAudioContext(1, 1, 48000).decodeAudioData(await umo.scene.video.arrayBuffer());
        return [sound.duration, sound.getChannelData(0).reduce((most, x) => Math.max(most, Math.abs(x)), 0)];
      })()`);
      // A busy machine records fewer frames and less sound.
      assert.ok(seconds > 1.2 && seconds < 8 && loudest > 0.1, `${seconds} s, as loud as ${loudest}`);
      await page.close();
    },
  ],

  [
    "a character that is dropped onto the page is put on, and one that cannot be is said",
    async (context) => {
      const [own, at] = await served(context.umo, context.short);
      const page = await opened(context, at);
      fs.writeFileSync(context.at("live-broken.glb"), "no glb");
      await page.drop("#view", context.at("live-broken.glb"));
      await until(async () => /not a glb file/.test(await page.value('document.querySelector("#notice").textContent')), 30, "the sentence");
      assert.equal(await page.value("umo.scene.character"), null);
      await page.drop("#view", context.at("live-stranger.glb"));
      await until(() => page.value("umo.scene.character !== null").catch(() => false), 60, "the page with the character");
      await page.ready();
      await stream(page);
      assert.equal(await log(page, "error"), null);
      await page.picture(context.at("live-dropped.png"));
      const weights = await page.value("(umo.seek(1.2), umo.weights())");
      assert.ok(Object.keys(weights).length > 0, "its face moves");
      await page.close();
      own.kill("SIGKILL");
    },
  ],

  [
    "other pages and other names do not get in",
    async ({ browser }) => {
      const { port } = new URL(address);
      assert.equal(await request("/", {}), 200);
      assert.equal(await request("/", { host: `evil.example:${port}` }), 421);
      assert.equal(await request("/etc/passwd", {}), 404);
      const upgrade = { connection: "Upgrade", upgrade: "websocket", "sec-websocket-version": "13", "sec-websocket-key": "AAAAAAAAAAAAAAAAAAAAAA==" };
      assert.equal(await request("/v1/session", { ...upgrade, origin: "http://evil.example" }), 403);
      const other = await browser.open("data:text/html,other");
      const got = await other.value(`new Promise((done) => {
        const socket = new WebSocket("ws://127.0.0.1:${port}/v1/session");
        socket.onopen = () => done("in");
        socket.onerror = () => done("out");
      })`);
      assert.equal(got, "out");
      await other.close();
    },
  ],

  [
    "ends cleanly, and says so",
    async (context) => {
      const page = await opened(context);
      await page.click("#recording");
      await until(() => log(page, "received > 0"));
      server.kill("SIGINT");
      assert.deepEqual(await Promise.race([server.ended, pause(120)]), { code: 0, signal: null });
      await until(() => log(page, "error"));
      assert.match(await log(page, "error"), /stops/);
      await page.close();
    },
  ],
];
