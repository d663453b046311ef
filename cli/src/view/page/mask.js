// Hiding the figure's face: a smooth mask over it, and poses without its movements.

import { add, normalize, scale } from "umo/math.js";
import { restPlaces } from "umo/motion.js";

/** The mask from between the eyes, in heights of the eyes over the head's joint: from the brows to the chin. */
const MIDDLE = [0, -0.46, -0.62];
const RADII = [1.2, 1.77, 1.48];
const [ROWS, COLUMNS] = [32, 48];
const STILL = ["jaw", "left_eye", "right_eye"];
const PAINT = [150, 156, 164, 255];

/** The pose with the face at rest. */
export function faceless({ joints }, pose) {
  return { ...pose, face: [], rotations: pose.rotations.map((turn, i) => (STILL.includes(joints[i]) ? [0, 0, 0, 1] : turn)) };
}

/** Puts an ellipsoid over the face; returns a function that shows or hides it. */
export function addMask(scene) {
  const { joints, mesh } = scene;
  const [head, left, right] = ["head", "left_eye", "right_eye"].map((name) => restPlaces(scene)[joints.indexOf(name)]);
  const eyes = scale(add(left, right), 0.5);
  const unit = eyes[1] - head[1];
  const [middle, radii] = [add(eyes, scale(MIDDLE, unit)), scale(RADII, unit)];
  const first = mesh.positions.length / 3;
  const [positions, normals, indices] = [[], [], []];
  for (let row = 0; row <= ROWS; row++) {
    for (let column = 0; column <= COLUMNS; column++) {
      const [fall, turn] = [(Math.PI * row) / ROWS, (2 * Math.PI * column) / COLUMNS];
      const ball = [Math.sin(fall) * Math.sin(turn), Math.cos(fall), Math.sin(fall) * Math.cos(turn)];
      positions.push(...ball.map((x, axis) => middle[axis] + radii[axis] * x));
      normals.push(...normalize(ball.map((x, axis) => x / radii[axis])));
      const at = first + row * (COLUMNS + 1) + column;
      if (row < ROWS && column < COLUMNS) indices.push(at, at + COLUMNS + 1, at + 1, at + 1, at + COLUMNS + 1, at + COLUMNS + 2);
    }
  }
  const count = positions.length / 3;
  const each = (...values) => Array.from({ length: count }, () => values).flat();
  const more = { positions, normals, indices, colors: each(...PAINT), roughness: each(150), spots: each(0, 0) };
  Object.assign(more, { joints: each(joints.indexOf("head"), 0, 0, 0), weights: each(65535, 0, 0, 0) });
  for (const [name, values] of Object.entries(more)) mesh[name] = joined(mesh[name], values);
  const mask = { name: "mask", corners: indices.length, threads: [1, 1], map: [] };
  mesh.details.push(mask);
  return (isShown) => (mask.corners = isShown ? indices.length : 0);
}

function joined(values, more) {
  const all = new values.constructor(values.length + more.length);
  all.set(values);
  all.set(more, values.length);
  return all;
}
