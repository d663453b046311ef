// The timeline: speech, keyframes and interpolated frames, chunks, experts, curves.

import { DRAW, RULER, drawChunkGround, layOut } from "umo/lanes.js";
import { clamp } from "umo/math.js";
import { reading } from "umo/tracks.js";

/** Frame width at which keyframes can be distinguished, CSS pixels. */
const FRAME = 4.6;
/** Shortest and longest visible stretch, seconds. */
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
    this.score = null;
    this.listen();
    new ResizeObserver(() => this.draw()).observe(element);
  }

  /** Width of the names on the left. */
  get gutter() {
    return this.canvas.clientWidth < 520 ? 58 : 92;
  }

  /** Visible time in seconds. */
  get window() {
    const comfortable = (this.canvas.clientWidth - this.gutter) / FRAME / this.motion.rate;
    // Recordings that are only slightly longer are shown whole.
    const fitting = this.length < 1.4 * comfortable ? this.length : comfortable;
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

  /** Shows the events of a score. */
  useScore(editor) {
    this.score = editor;
    this.draw();
  }

  /** Shows a stretch of time, if it is not in view. */
  reveal(from, to) {
    const { window } = this;
    if (from >= this.from && Math.min(to, from + 0.5 * window) <= this.from + window) return;
    this.from = this.bounded(from - 0.2 * window);
    this.draw();
  }

  setLayer(layer) {
    this.layer = layer;
    this.draw();
  }

  x(seconds) {
    return this.gutter + ((seconds - this.from) / this.window) * (this.canvas.clientWidth - this.gutter);
  }

  seconds(x) {
    return this.from + ((x - this.gutter) / (this.canvas.clientWidth - this.gutter)) * this.window;
  }

  /** Keeps the time in view, turning the page when it leaves, and moves the cursor. */
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
    const width = canvas.clientWidth;
    if (width === 0) return;
    const { lanes, height } = layOut(this);
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
    drawChunkGround(this, lanes, height, color);
    this.drawRuler(color, height);
    context.save();
    context.beginPath();
    context.rect(this.gutter, 0, width - this.gutter, height);
    context.clip();
    for (const lane of lanes) DRAW[lane.kind](this, lane, color);
    context.restore();
    this.drawNames(lanes, color);
    this.score?.layOut(lanes);
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

  laneAt(y) {
    return layOut(this).lanes.find(({ top, height }) => y >= top && y < top + height);
  }

  /** Text about a frame. */
  describe(frame) {
    const { record } = this;
    const words = [`frame ${frame}`];
    if (record.isKnown) words.push(record.isKeyframe(frame) ? "keyframe" : "interpolated");
    const chunk = record.chunkOf(frame);
    if (chunk >= 0) words.push(`chunk ${chunk + 1}`);
    const codes = record.parts.map(({ name }, part) => [name, ...record.codes(part, frame)]);
    if (codes.some((one) => one.length > 1)) words.push(codes.map((one) => one.join(" ")).join(", "));
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
      const lane = this.laneAt(event.clientY - canvas.getBoundingClientRect().top);
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
