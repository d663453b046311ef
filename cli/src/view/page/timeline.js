// The timeline: speech, which frames the language model made and which were filled in, chunks, experts, curves.

import { clamp } from "umo/math.js";
import { drawTrack, reading } from "umo/tracks.js";

const RULER = 20;
const SPEECH = 46;
const CHUNKS = 17;
const PART = 17;
const EXPERTS = 11;
const TRACK = 44;
const GAP = 7;
/** Width of a frame that lets keyframes and the others be told apart, CSS pixels. */
const FRAME = 4.6;
/** Shortest and longest stretch that is shown, seconds. */
const SHORTEST = 0.8;
const LONGEST = 600;

export class Timeline {
  constructor(element, { scene, motion, record, clock, seek }) {
    Object.assign(this, { element, scene, motion, record, clock, seek });
    this.canvas = element.querySelector("canvas");
    this.line = element.querySelector(".playhead");
    this.context = this.canvas.getContext("2d");
    this.tracks = [];
    this.layer = record.layers[0];
    this.from = 0;
    this.chosen = null;
    this.peaks = null;
    this.listen();
    new ResizeObserver(() => this.draw()).observe(element);
  }

  /** Width of the names on the left. */
  get gutter() {
    return this.canvas.clientWidth < 520 ? 58 : 92;
  }

  /** Seconds that are shown. */
  get window() {
    const fitting = (this.canvas.clientWidth - this.gutter) / FRAME / this.motion.rate;
    return clamp(this.chosen ?? fitting, SHORTEST, Math.max(SHORTEST, Math.min(LONGEST, this.length)));
  }

  get length() {
    return Math.max(this.motion.seconds, this.scene.live ? 10 : 0);
  }

  zoom(factor) {
    const middle = clamp(this.clock.time, this.from, this.from + this.window);
    const share = (middle - this.from) / this.window;
    this.chosen = clamp(this.window * factor, SHORTEST, Math.min(LONGEST, this.length));
    this.from = this.bounded(middle - share * this.window);
    this.draw();
  }

  bounded(from) {
    return clamp(from, 0, Math.max(0, this.length - this.window));
  }

  setTracks(tracks) {
    this.tracks = tracks;
    this.draw();
  }

  setLayer(layer) {
    this.layer = layer;
    this.draw();
  }

  /** The lanes from top to bottom: what, its name, where. */
  lanes() {
    const { scene, record } = this;
    const lanes = [];
    let top = RULER;
    const lane = (kind, name, height, more = {}) => {
      lanes.push({ kind, name, top, height, ...more });
      top += height;
    };
    if (scene.samples.length > 0) lane("speech", "speech", SPEECH);
    top += GAP;
    if (record.chunks.length > 0) lane("chunks", "chunks", CHUNKS);
    if (record.isKnown) {
      const parts = record.data ? scene.parts : ["frames"];
      parts.forEach((name, part) => lane("frames", name, PART, { part }));
      top += GAP;
    }
    if (record.data) {
      record.data.kinds.forEach((name, kind) => lane("experts", name, EXPERTS, { kind, of: name }));
      top += GAP;
    }
    for (const track of this.tracks) lane("track", track.name, TRACK, { track });
    return { lanes, height: top + 6 };
  }

  x(seconds) {
    return this.gutter + ((seconds - this.from) / this.window) * (this.canvas.clientWidth - this.gutter);
  }

  seconds(x) {
    return this.from + ((x - this.gutter) / (this.canvas.clientWidth - this.gutter)) * this.window;
  }

  /** Keeps the time in view: the page turns where the time leaves it. Moves the line. */
  follow(time) {
    const { window } = this;
    if (time > this.from + 0.97 * window || time < this.from) {
      const from = this.bounded(time - (time < this.from ? 0.5 : 0.06) * window);
      if (Math.abs(from - this.from) > 1e-6) {
        this.from = from;
        this.draw();
      }
    }
    this.line.style.transform = `translateX(${this.x(time)}px)`;
  }

  draw() {
    const { canvas, context } = this;
    const width = this.element.clientWidth;
    if (width === 0) return;
    const { lanes, height } = this.lanes();
    const density = Math.min(window.devicePixelRatio || 1, 3);
    canvas.style.height = `${height}px`;
    this.line.style.height = `${height}px`;
    [canvas.width, canvas.height] = [Math.round(width * density), Math.round(height * density)];
    context.setTransform(density, 0, 0, density, 0, 0);
    const style = getComputedStyle(this.element);
    const color = (name) => style.getPropertyValue(name);
    this.from = this.bounded(this.from);
    context.font = `11px ${style.fontFamily}`;
    context.textBaseline = "middle";
    this.drawChunkGround(lanes, height, color);
    this.drawRuler(color, height);
    context.save();
    context.beginPath();
    context.rect(this.gutter, 0, width - this.gutter, height);
    context.clip();
    const draw = { speech: "drawSpeech", chunks: "drawChunks", frames: "drawFrames", experts: "drawExperts", track: "drawCurve" };
    for (const lane of lanes) this[draw[lane.kind]](lane, color);
    context.restore();
    this.drawNames(lanes, color);
    this.line.style.transform = `translateX(${this.x(this.clock.time)}px)`;
  }

  drawNames(lanes, color) {
    const { context } = this;
    context.textAlign = "right";
    for (const { name, top, height, kind } of lanes) {
      context.fillStyle = color(kind === "track" ? "--text" : "--muted");
      context.font = `${kind === "experts" ? 10 : 11}px ${getComputedStyle(this.element).fontFamily}`;
      context.fillText(name, this.gutter - 8, top + height / 2 + 0.5, this.gutter - 10);
    }
  }

  drawRuler(color, height) {
    const { context } = this;
    const least = (this.window * 62) / (this.canvas.clientWidth - this.gutter);
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120].find((step) => step >= least) ?? 300;
    context.textAlign = "left";
    for (let tick = Math.ceil(this.from / step - 1e-9); tick * step <= this.from + this.window; tick++) {
      const x = Math.round(this.x(tick * step)) + 0.5;
      context.strokeStyle = color("--line");
      context.beginPath();
      context.moveTo(x, 4);
      context.lineTo(x, height);
      context.stroke();
      context.fillStyle = color("--muted");
      context.fillText(`${Number((tick * step).toFixed(1))} s`, x + 4, RULER / 2);
    }
  }

  /** Every other chunk's ground, behind all that it made. */
  drawChunkGround(lanes, height, color) {
    const first = lanes.find(({ kind }) => kind === "chunks");
    if (!first) return;
    const { context } = this;
    context.fillStyle = color("--band");
    for (const [i, chunk] of this.record.chunks.entries()) {
      const [a, b] = this.ends(chunk);
      if (i % 2 === 1 && b > this.gutter) context.fillRect(a, first.top, b - a, height - first.top);
    }
  }

  ends({ first, frames }) {
    const { rate } = this.motion;
    const half = 0.5 / rate;
    return [first / rate - half, (first + frames) / rate - half].map((t) => Math.max(this.x(t), this.gutter));
  }

  drawChunks({ top, height }, color) {
    const { context } = this;
    context.textAlign = "left";
    context.fillStyle = color("--muted");
    for (const [i, chunk] of this.record.chunks.entries()) {
      const [a, b] = this.ends(chunk);
      if (b - a > 34) context.fillText(b - a > 70 ? `chunk ${i + 1}` : `${i + 1}`, a + 5, top + height / 2);
    }
  }

  drawSpeech({ top, height }, color) {
    const { context, scene } = this;
    const { samples } = scene;
    const rate = scene.audio.sampleRate;
    const middle = top + height / 2;
    context.fillStyle = color("--speech");
    const [left, right] = [this.gutter, this.canvas.clientWidth];
    const loudest = (this.loudest ??= loudestOf(samples));
    for (let x = left; x < right; x++) {
      const [from, to] = [this.seconds(x), this.seconds(x + 1)].map((t) => Math.round(t * rate));
      if (from >= samples.length) break;
      let [low, high] = [0, 0];
      const step = Math.max(1, Math.floor((to - from) / 64));
      for (let i = Math.max(from, 0); i < Math.min(to, samples.length); i += step) {
        [low, high] = [Math.min(low, samples[i]), Math.max(high, samples[i])];
      }
      const [up, down] = [(high / loudest) * (height / 2 - 2), (low / loudest) * (height / 2 - 2)];
      context.fillRect(x, middle - up - 0.5, 1, up - down + 1);
    }
  }

  /** Frames in view, the first and one after the last. */
  shown() {
    const { rate, end, first } = this.motion;
    return [Math.max(first, Math.floor(this.from * rate)), Math.min(end, Math.ceil((this.from + this.window) * rate) + 1)];
  }

  /** Keyframes as tall bars, filled frames as short ones between them; the shade is the code. */
  drawFrames({ top, height, part }, color) {
    const { context, motion, record } = this;
    const [from, to] = this.shown();
    const width = this.x(1 / motion.rate) - this.x(0);
    const [key, filled] = [color("--keyframe"), color("--filled")];
    for (let frame = from; frame < to; frame++) {
      const isKey = record.isKeyframe(frame);
      if (!isKey && width < 1.2 && frame % 2 === 1) continue;
      const code = record.code(part, frame);
      context.globalAlpha = code === null ? 0.9 : 0.42 + 0.58 * (code / 255);
      context.fillStyle = isKey ? key : filled;
      const bar = isKey ? clamp(width - 1, 1.6, 8) : clamp(width - 1.4, 0.8, 8);
      const tall = isKey ? height - 3 : 0.46 * (height - 3);
      context.fillRect(this.x(frame / motion.rate) - bar / 2, top + height / 2 - tall / 2, bar, tall);
    }
    context.globalAlpha = 1;
  }

  /** Shares of the experts among a chunk's tokens of one kind. */
  drawExperts({ top, height, kind }, color) {
    const { context, record } = this;
    for (const [i, chunk] of record.chunks.entries()) {
      const [a, b] = this.ends(chunk);
      if (b <= this.gutter || a > this.canvas.clientWidth) continue;
      const counts = record.routed(i, kind, this.layer);
      const sum = counts.reduce((x, y) => x + y, 0);
      let x = a + 1;
      counts.forEach((count, expert) => {
        const wide = sum === 0 ? 0 : (count / sum) * (b - a - 2);
        context.fillStyle = expertColor(color, expert);
        context.fillRect(x, top + 1.5, Math.max(wide - 0.5, 0), height - 3);
        x += wide;
      });
    }
  }

  drawCurve({ top, height, track }, color) {
    const [from, to] = this.shown();
    if (to <= from) return;
    const frames = Array.from({ length: to - from }, (_, i) => from + i);
    const x = (frame) => this.x(frame / this.motion.rate);
    drawTrack(this.context, track, { frames, x, top, height, color });
  }

  /** What is known about a frame, in words. */
  describe(frame) {
    const { record, scene } = this;
    const words = [`frame ${frame}`];
    if (record.isKnown) words.push(record.isKeyframe(frame) ? "keyframe" : "interpolated");
    const chunk = record.chunkOf(frame);
    if (chunk >= 0) words.push(`chunk ${chunk + 1}`);
    if (record.code(0, frame) !== null) words.push(scene.parts.map((name, part) => `${name} ${record.code(part, frame)}`).join(", "));
    return words.join(" · ");
  }

  listen() {
    const { element, canvas } = this;
    const readout = element.querySelector(".readout");
    let pressed = false;
    const at = (event) => clamp(this.seconds(event.clientX - canvas.getBoundingClientRect().left), 0, this.motion.seconds);
    canvas.addEventListener("pointerdown", (event) => {
      if (event.clientX - canvas.getBoundingClientRect().left < this.gutter) return;
      pressed = true;
      canvas.setPointerCapture(event.pointerId);
      this.seek(at(event));
    });
    canvas.addEventListener("pointermove", (event) => {
      if (pressed) this.seek(at(event));
      if (this.motion.count === 0) return;
      const frame = clamp(Math.round(at(event) * this.motion.rate), this.motion.first, this.motion.end - 1);
      const y = event.clientY - canvas.getBoundingClientRect().top;
      const lane = this.lanes().lanes.find(({ top, height }) => y >= top && y < top + height);
      const more = lane?.kind === "track" ? ` · ${lane.name} ${reading(lane.track, frame)}` : "";
      readout.textContent = this.describe(frame) + more;
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (pressed = false));
    canvas.addEventListener("pointerleave", () => (readout.textContent = ""));
    canvas.addEventListener(
      "wheel",
      (event) => {
        if (event.ctrlKey || event.metaKey) {
          event.preventDefault();
          this.zoom(Math.exp(clamp(event.deltaY, -80, 80) * 0.004));
        } else if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
          event.preventDefault();
          this.from = this.bounded(this.from + (event.deltaX / canvas.clientWidth) * this.window);
          this.draw();
        }
      },
      { passive: false },
    );
  }
}

/** The colour of an expert; beyond the named ones, hues around the circle. */
export function expertColor(color, expert) {
  return expert < 4 ? color(`--expert-${expert}`) : `hsl(${(expert * 137) % 360} 45% 60%)`;
}

function loudestOf(samples) {
  let loudest = 1000;
  for (let i = 0; i < samples.length; i += 7) loudest = Math.max(loudest, Math.abs(samples[i]));
  return loudest;
}
