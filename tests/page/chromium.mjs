// Drives a headless Chromium through the DevTools protocol over two pipes: no package is needed.

import { spawn } from "node:child_process";
import fs from "node:fs";

const FLAGS = [
  "--headless",
  "--no-sandbox",
  "--disable-gpu-sandbox",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
  "--remote-debugging-pipe",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--hide-scrollbars",
  "--autoplay-policy=no-user-gesture-required",
  "--use-fake-ui-for-media-stream",
  "--use-fake-device-for-media-stream",
  // Hidden pages keep running, as several are open at once.
  "--disable-background-timer-throttling",
  "--disable-backgrounding-occluded-windows",
  "--disable-renderer-backgrounding",
];

export const pause = (seconds) => new Promise((done) => setTimeout(done, seconds * 1000));

/** Waits until `what` returns something true. The timeout only ends a hanging test: a busy machine takes long. */
export async function until(what, seconds = 120, name = what.toString()) {
  const end = Date.now() + seconds * 1000;
  for (;;) {
    const value = await what();
    if (value) return value;
    if (Date.now() > end) throw new Error(`waited ${seconds} s without success for ${name}`);
    await pause(0.05);
  }
}

/** Waits until a page has had the chance to draw the given number of frames. */
export const pictures = (page, count) =>
  page.value(`new Promise((done) => {
    let left = ${count};
    const next = () => (left-- > 0 ? requestAnimationFrame(next) : done(true));
    next();
  })`);

export class Chromium {
  /** Starts the program at `path`; its microphone plays the WAV file `speech`. */
  constructor(path, folder, speech) {
    const flags = [...FLAGS, `--user-data-dir=${folder}`, `--use-file-for-fake-audio-capture=${speech}`];
    this.process = spawn(path, flags, { stdio: ["ignore", "ignore", "ignore", "pipe", "pipe"] });
    this.ended = new Promise((done) => this.process.on("exit", done));
    this.waiting = new Map();
    this.pages = new Map();
    this.count = 0;
    let rest = "";
    this.process.stdio[4].setEncoding("utf8").on("data", (data) => {
      const messages = (rest + data).split("\0");
      rest = messages.pop();
      messages.forEach((message) => this.hear(JSON.parse(message)));
    });
  }

  hear({ id, result, error, method, params, sessionId }) {
    if (id === undefined) return this.pages.get(sessionId)?.hear(method, params);
    const { done, failed } = this.waiting.get(id);
    this.waiting.delete(id);
    return error ? failed(new Error(error.message)) : done(result);
  }

  send(method, params = {}, sessionId = undefined) {
    const id = ++this.count;
    this.process.stdio[3].write(`${JSON.stringify({ id, method, params, sessionId })}\0`);
    return new Promise((done, failed) => this.waiting.set(id, { done, failed }));
  }

  /** Opens a page of this size in CSS pixels. */
  async open(url, { width = 1280, height = 860, phone = false, media = [] } = {}) {
    const { targetId } = await this.send("Target.createTarget", { url: "about:blank" });
    const { sessionId } = await this.send("Target.attachToTarget", { targetId, flatten: true });
    const page = new Page(this, sessionId, targetId);
    this.pages.set(sessionId, page);
    for (const domain of ["Page", "Runtime", "Network", "Log"]) await page.send(`${domain}.enable`);
    await page.send("Emulation.setDeviceMetricsOverride", { width, height, deviceScaleFactor: phone ? 2 : 1, mobile: phone });
    if (phone) await page.send("Emulation.setTouchEmulationEnabled", { enabled: true });
    await page.send("Emulation.setEmulatedMedia", { features: media });
    await page.send("Page.navigate", { url });
    return page;
  }

  async close() {
    await Promise.race([this.send("Browser.close").catch(() => {}), pause(3)]);
    await Promise.race([this.ended, pause(3).then(() => this.process.kill("SIGKILL"))]);
  }
}

class Page {
  constructor(browser, session, target) {
    Object.assign(this, { browser, session, target, errors: [], requests: [] });
  }

  send(method, params) {
    return this.browser.send(method, params, this.session);
  }

  hear(method, params) {
    if (method === "Runtime.exceptionThrown") {
      const { exceptionDetails: details } = params;
      this.errors.push(details.exception?.description ?? details.text);
    }
    if (method === "Log.entryAdded" && params.entry.level === "error") this.errors.push(params.entry.text);
    if (method === "Runtime.consoleAPICalled" && params.type === "error") this.errors.push(JSON.stringify(params.args));
    if (method === "Network.requestWillBeSent") this.requests.push(params.request.url);
  }

  /** Value of an expression, or of the promise that it returns. */
  async value(expression) {
    const asked = { expression, awaitPromise: true, returnByValue: true, userGesture: true };
    const { result, exceptionDetails: failed } = await this.send("Runtime.evaluate", asked);
    if (failed) throw new Error(failed.exception?.description ?? failed.text);
    return result.value;
  }

  /** Waits until the page has drawn its first picture. */
  ready() {
    return until(() => this.value('document.documentElement?.dataset.ready === "true"').catch(() => false), 120, "the page");
  }

  /** Presses and releases a key, such as `ArrowLeft` or `.`. */
  async key(key, modifiers = 0) {
    const codes = { ArrowLeft: 37, ArrowRight: 39, ArrowUp: 38, ArrowDown: 40, Tab: 9, Escape: 27, Enter: 13, " ": 32, Home: 36, End: 35 };
    const text = key.length === 1 ? key : undefined;
    const what = { key, text, modifiers, windowsVirtualKeyCode: codes[key] ?? key.toUpperCase().charCodeAt(0) };
    await this.send("Input.dispatchKeyEvent", { type: text ? "keyDown" : "rawKeyDown", ...what });
    await this.send("Input.dispatchKeyEvent", { type: "keyUp", ...what, text: undefined });
  }

  /** Presses the mouse at a position, moves it through others, and releases it. */
  async drag(places) {
    const mouse = (type, [x, y], buttons) =>
      this.send("Input.dispatchMouseEvent", { type, x, y, button: "left", buttons, clickCount: 1 });
    await mouse("mousePressed", places[0], 1);
    for (const place of places.slice(1)) await mouse("mouseMoved", place, 1);
    await mouse("mouseReleased", places.at(-1), 0);
  }

  /** Position in an element, by default its middle, as shares of its size. */
  place(selector, across = 0.5, down = 0.5) {
    return this.value(`(() => {
      const { left, top, width, height } = document.querySelector(${JSON.stringify(selector)}).getBoundingClientRect();
      return [left + ${across} * width, top + ${down} * height];
    })()`);
  }

  /** Drops files onto an element. */
  async drop(selector, ...files) {
    const [x, y] = await this.place(selector);
    const data = { items: [], files, dragOperationsMask: 1 };
    for (const type of ["dragEnter", "dragOver", "drop"]) await this.send("Input.dispatchDragEvent", { type, x, y, data });
  }

  async click(selector) {
    await this.drag([await this.place(selector)]);
  }

  /** Writes a screenshot as PNG, or the part `{ x, y, width, height }` of it in pixels. */
  async picture(path, clip) {
    const part = clip && { clip: { ...clip, scale: 1 } };
    const { data } = await this.send("Page.captureScreenshot", { format: "png", ...part });
    fs.writeFileSync(path, Buffer.from(data, "base64"));
  }

  close() {
    return this.browser.send("Target.closeTarget", { targetId: this.target });
  }
}
