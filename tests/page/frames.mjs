// Frames as written by `umo animate -o x.jsonl`, and their joint positions, computed with matrices, independent of the
// page's quaternions.

import fs from "node:fs";

export function read(path) {
  const [header, ...frames] = fs.readFileSync(path, "utf8").trim().split("\n").map((line) => JSON.parse(line));
  return { header, frames };
}

function matrix([x, y, z, w]) {
  return [
    [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
  ];
}

const apply = (m, v) => m.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
const times = (a, b) => a.map((row) => [0, 1, 2].map((j) => row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]));

/** Positions of all joints, metres. */
export function places({ header }, { rotations, translation }) {
  const turned = [];
  const found = [];
  header.parents.forEach((parent, joint) => {
    const offset = header.offsets[joint];
    const own = matrix(rotations[joint]);
    if (parent < 0) {
      found.push(offset.map((x, i) => x + translation[i]));
      turned.push(own);
    } else {
      const moved = apply(turned[parent], offset);
      found.push(found[parent].map((x, i) => x + moved[i]));
      turned.push(times(turned[parent], own));
    }
  });
  return found;
}

/** The frame halfway between two: for quaternions, their normalised sum. */
export function halfway(a, b) {
  const middle = (p, q) => p.map((x, i) => (x + q[i]) / 2);
  const turn = (p, q) => {
    const sign = Math.sign(p.reduce((sum, x, i) => sum + x * q[i], 0)) || 1;
    const sum = p.map((x, i) => x + sign * q[i]);
    return sum.map((x) => x / Math.hypot(...sum));
  };
  return {
    rotations: a.rotations.map((p, i) => turn(p, b.rotations[i])),
    translation: middle(a.translation, b.translation),
    face: middle(a.face, b.face),
  };
}

/** A recording of 16-bit samples from a time in seconds on, several times over, as a WAV file. */
export function repeated(bytes, seconds, times) {
  const start = bytes.indexOf("data") + 8;
  const sound = bytes.subarray(start + Math.round(seconds * bytes.readUInt32LE(24)) * bytes.readUInt16LE(32));
  const long = Buffer.concat([bytes.subarray(0, start), ...Array(times).fill(sound)]);
  long.writeUInt32LE(long.length - 8, 4);
  long.writeUInt32LE(sound.length * times, start - 4);
  return long;
}

/** The first seconds of a recording of 16-bit samples, as a WAV file. */
export function cut(bytes, seconds) {
  const rate = bytes.readUInt32LE(24);
  const frame = bytes.readUInt16LE(32);
  const start = bytes.indexOf("data") + 8;
  const size = Math.min(Math.round(seconds * rate) * frame, bytes.length - start);
  const short = Buffer.from(bytes.subarray(0, start + size));
  short.writeUInt32LE(short.length - 8, 4);
  short.writeUInt32LE(size, start - 4);
  return short;
}
