// Lanes of the timeline and their drawing. `t` is the timeline.

import { clamp } from "umo/math.js";
import { drawTrack } from "umo/tracks.js";

export const RULER = 20;
const SPEECH = 46;
const VOICE = 28;
const CHUNKS = 17;
const PART = 15;
const LEVEL = 4;
const EXPERTS = 10;
const TRACK = 40;
/** Lanes of the score, for a mouse and for fingers. */
const SCORE = 25;
const TOUCHED = 38;
const GAP = 7;

/** The lanes from top to bottom: kind, name, position. */
export function layOut({ scene, record, tracks, score }) {
  const lanes = [];
  let top = RULER;
  const lane = (kind, name, height, more = {}) => {
    lanes.push({ kind, name, top, height, ...more });
    top += height;
  };
  if (scene.samples.length > 0) lane("speech", "speech", SPEECH, { voice: { samples: scene.samples, sampleRate: scene.audio.sampleRate } });
  // Takes of one recording have no voices of their own.
  for (const voice of scene.takes ? [] : scene.voices) lane("speech", voice.name, VOICE, { voice });
  top += GAP;
  for (const { name, kinds } of score?.lanes ?? []) lane("score", name, matchMedia("(pointer: coarse)").matches ? TOUCHED : SCORE, { kinds });
  if (score) top += GAP;
  if (record.chunks.length > 0) lane("chunks", "chunks", CHUNKS);
  if (record.isKnown) {
    const parts = record.data ? record.parts : [{ name: "frames", levels: 1 }];
    parts.forEach(({ name, levels }, part) => lane("frames", name, Math.max(PART, LEVEL * levels + 3), { part }));
    top += GAP;
  }
  if (record.data) {
    record.data.kinds.forEach((name, kind) => lane("experts", name, EXPERTS, { token: kind }));
    top += GAP;
  }
  for (const track of tracks) lane("track", track.name, TRACK, { track });
  return { lanes, height: top + 6 };
}

/** Background of every other chunk, behind everything it produced. */
export function drawChunkGround(t, lanes, height, color) {
  const first = lanes.find(({ kind }) => kind === "chunks");
  if (!first) return;
  const { context } = t;
  context.fillStyle = color("--band");
  for (const [i, chunk] of t.record.chunks.entries()) {
    const [a, b] = ends(t, chunk);
    if (i % 2 === 1 && b > t.gutter) context.fillRect(a, first.top, b - a, height - first.top);
  }
}

/** Start and end of a chunk. */
function ends(t, { first, frames }) {
  const { rate } = t.motion;
  const half = 0.5 / rate;
  return [first / rate - half, (first + frames) / rate - half].map((seconds) => Math.max(t.x(seconds), t.gutter));
}

function chunks(t, { top, height }, color) {
  const { context } = t;
  context.textAlign = "left";
  context.fillStyle = color("--muted");
  for (const [i, chunk] of t.record.chunks.entries()) {
    const [a, b] = ends(t, chunk);
    if (b - a > 34) context.fillText(b - a > 70 ? `chunk ${i + 1}` : `${i + 1}`, a + 5, top + height / 2);
  }
}

function speech(t, { top, height, voice }, color) {
  const { context } = t;
  const { samples, sampleRate: rate } = voice;
  const middle = top + height / 2;
  context.fillStyle = color("--speech");
  const [left, right] = [t.gutter, t.canvas.clientWidth];
  const loudest = (samples.loudest ??= loudestOf(samples));
  for (let x = left; x < right; x++) {
    const [from, to] = [t.seconds(x), t.seconds(x + 1)].map((seconds) => Math.round(seconds * rate));
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

/** Visible frames: the first, and one after the last. */
function shown(t) {
  const { rate, end, first } = t.motion;
  return [Math.max(first, Math.floor(t.from * rate)), Math.min(end, Math.ceil((t.from + t.window) * rate) + 1)];
}

/** Keyframes as tall bars, interpolated frames as short ones between them; the shade shows the code, level 0 on top. */
function frames(t, { top, height, part }, color) {
  const { context, motion, record } = t;
  const [from, to] = shown(t);
  const width = t.x(1 / motion.rate) - t.x(0);
  const [key, filled] = [color("--keyframe"), color("--filled")];
  for (let frame = from; frame < to; frame++) {
    const isKey = record.isKeyframe(frame);
    if (!isKey && width < 1.2 && frame % 2 === 1) continue;
    const codes = record.codes(part, frame);
    context.fillStyle = isKey ? key : filled;
    const bar = isKey ? clamp(width - 1, 1.6, 8) : clamp(width - 1.4, 0.8, 8);
    const tall = isKey ? height - 3 : 0.46 * (height - 3);
    const shades = codes.length > 0 ? codes.map((code) => 0.42 + 0.58 * (code / Math.max(record.parts[part].codes - 1, 1))) : [0.9];
    shades.forEach((shade, level) => {
      context.globalAlpha = shade;
      const y = top + (height - tall) / 2 + (level * tall) / shades.length;
      context.fillRect(t.x(frame / motion.rate) - bar / 2, y, bar, tall / shades.length);
    });
  }
  context.globalAlpha = 1;
}

/** Shares of the experts among a chunk's tokens of one kind. */
function experts(t, { top, height, token }, color) {
  const { context, record } = t;
  for (const [i, chunk] of record.chunks.entries()) {
    const [a, b] = ends(t, chunk);
    if (b <= t.gutter || a > t.canvas.clientWidth) continue;
    const counts = record.routed(i, token, t.layer);
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

function track(t, { top, height, track }, color) {
  const [from, to] = shown(t);
  if (to <= from) return;
  const frames = Array.from({ length: to - from }, (_, i) => from + i);
  const x = (frame) => t.x(frame / t.motion.rate);
  drawTrack(t.context, track, { frames, x, top, height, color });
}

/** Ground of a lane of the score, whose events lie over the canvas. */
function score(t, { top, height }, color) {
  t.context.fillStyle = color("--band");
  t.context.fillRect(t.gutter, top + 1, t.canvas.clientWidth - t.gutter, height - 3);
}

/** Drawing function of each kind of lane. */
export const DRAW = { speech, chunks, frames, experts, track, score };

/** Colour of an expert; beyond the named colours, hues around the circle. */
export function expertColor(color, expert) {
  return expert < 4 ? color(`--expert-${expert}`) : `hsl(${(expert * 137) % 360} 45% 60%)`;
}

function loudestOf(samples) {
  let loudest = 1000;
  for (let i = 0; i < samples.length; i += 7) loudest = Math.max(loudest, Math.abs(samples[i]));
  return loudest;
}
