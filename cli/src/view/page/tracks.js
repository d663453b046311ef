// Available curves: joint angles, root position, face channels.

import { degrees } from "umo/math.js";

const COLORS = ["--x", "--y", "--z"];

/** All curves of a motion, in groups. A curve gives one or three numbers per frame. */
export function allTracks(scene, motion) {
  const faceAt = 4 * motion.joints + 3;
  const face = scene.face.names.map((name, i) => ({
    name,
    group: "Face",
    unit: "",
    values: (frame) => [motion.frame(frame)[faceAt + i]],
  }));
  const joints = scene.joints.map((name, joint) => ({
    name: name.replaceAll("_", " "),
    group: "Joints",
    unit: "°",
    values: (frame) => degrees(motion.rotation(frame, joint)),
  }));
  const root = {
    name: "root place",
    group: "Joints",
    unit: " m",
    values: (frame) => Array.from(motion.frame(frame).subarray(faceAt - 3, faceAt)),
  };
  return [...face, root, ...joints];
}

/** The curves shown initially. */
const FIRST = ["jawOpen", "mouthSmileLeft", "expression_0", "head", "right elbow"];

/** The list of curves with a filter field. Calls `changed` with the selected ones. */
export function trackList(element, tracks, changed) {
  const filter = element.querySelector("input[type=search]");
  const list = element.querySelector("#track-list");
  const chosen = new Set(tracks.filter(({ name }) => FIRST.includes(name)).slice(0, 4));
  const rows = tracks.map((track) => {
    const label = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = chosen.has(track);
    box.addEventListener("change", () => {
      if (box.checked) chosen.add(track);
      else chosen.delete(track);
      changed(tracks.filter((one) => chosen.has(one)));
    });
    label.append(box, breakable(track.name));
    return { track, label };
  });
  for (const group of new Set(tracks.map((track) => track.group))) {
    const field = document.createElement("fieldset");
    const legend = document.createElement("legend");
    legend.textContent = group;
    field.append(legend, ...rows.filter(({ track }) => track.group === group).map(({ label }) => label));
    list.append(field);
  }
  filter.addEventListener("input", () => {
    const word = filter.value.trim().toLowerCase();
    for (const { track, label } of rows) label.hidden = !track.name.toLowerCase().includes(word);
  });
  changed(tracks.filter((one) => chosen.has(one)));
}

/** Allows line breaks before capitals. */
function breakable(name) {
  const words = document.createElement("span");
  name.split(/(?=[A-Z])/).forEach((word, i) => words.append(...(i > 0 ? [document.createElement("wbr"), word] : [word])));
  return words;
}

/** Minimum range of a curve, so that small tremors look small. */
function range(track, frames) {
  let [low, high] = track.unit === "°" ? [-15, 15] : track.unit === "" ? [0, 1] : [Infinity, -Infinity];
  for (const frame of frames) {
    for (const value of track.values(frame)) [low, high] = [Math.min(low, value), Math.max(high, value)];
  }
  return high - low < 1e-6 ? [low - 0.5, high + 0.5] : [low, high];
}

/** Draws a curve over the frames into a lane. */
export function drawTrack(context, track, { frames, x, top, height, color }) {
  const [low, high] = range(track, frames);
  const y = (value) => top + height - 3 - ((value - low) / (high - low)) * (height - 6);
  if (low < 0 && high > 0) {
    context.strokeStyle = color("--line");
    context.beginPath();
    context.moveTo(x(frames[0]), y(0));
    context.lineTo(x(frames.at(-1)), y(0));
    context.stroke();
  }
  const lines = track.values(frames[0]).length;
  for (let line = 0; line < lines; line++) {
    context.strokeStyle = color(lines === 1 ? "--accent" : COLORS[line]);
    context.lineWidth = 1.4;
    context.beginPath();
    for (const frame of frames) context.lineTo(x(frame), y(track.values(frame)[line]));
    context.stroke();
  }
  context.lineWidth = 1;
}

/** Text of a curve's value in a frame. */
export function reading(track, frame) {
  const digits = track.unit === "°" ? 0 : 2;
  // Adding 0 turns negative zero into zero.
  const text = (value) => (Number(value.toFixed(digits)) + 0).toFixed(digits);
  return track.values(frame).map(text).join(" / ") + track.unit;
}
