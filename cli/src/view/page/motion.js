// The frames, interpolated poses, and the resulting joint positions.

import { add, dot, inverse, mix, product, rotate, scale, slerp } from "umo/math.js";

/** Maximum number of frames kept of a live stream: ten minutes. */
const MOST = 18000;

/** Consecutive frames of `joints * 4 + 3 + face + worn` numbers each: rotations, root position, face values, a
 * character's channels. */
export class Motion {
  constructor(scene) {
    this.joints = scene.joints.length;
    this.face = scene.face.names.length;
    this.rate = scene.frameRate;
    this.values = scene.frames;
    this.fit(scene);
    this.count = scene.frames.length / this.width;
    this.rest = scene.rest ?? { rotations: scene.joints.map(() => [0, 0, 0, 1]), translation: [0, 0, 0], face: [] };
  }

  /** Adapts to the channels of the scene's character, and drops all frames. */
  fit(scene) {
    this.worn = scene.character?.worn ?? 0;
    this.width = 4 * this.joints + 3 + this.face + this.worn;
    this.clear();
  }

  /** Total number of frames so far, including dropped ones. */
  get end() {
    return this.first + this.count;
  }

  get seconds() {
    return this.end / this.rate;
  }

  clear() {
    this.count = this.first = 0;
  }

  /** Appends whole frames, dropping the oldest beyond the limit. */
  append(frames) {
    const more = frames.length / this.width;
    if (this.count + more > MOST) {
      const drop = Math.min(this.count, Math.floor(MOST / 4));
      this.values.copyWithin(0, drop * this.width, this.count * this.width);
      this.count -= drop;
      this.first += drop;
    }
    const needed = (this.count + more) * this.width;
    if (needed > this.values.length) {
      const larger = new Float32Array(Math.max(needed, 2 * this.values.length));
      larger.set(this.values.subarray(0, this.count * this.width));
      this.values = larger;
    }
    this.values.set(frames, this.count * this.width);
    this.count += more;
  }

  /** Values of frame `index`, or of the nearest one kept. */
  frame(index) {
    const at = Math.min(Math.max(index - this.first, 0), this.count - 1) * this.width;
    return this.values.subarray(at, at + this.width);
  }

  rotation(index, joint) {
    return Array.from(this.frame(index).subarray(4 * joint, 4 * joint + 4));
  }

  /** The two frames around a time in seconds, and the weight of the second: 0 at the exact time of a frame. */
  around(seconds) {
    const at = Math.min(Math.max(seconds * this.rate, this.first), this.end - 1);
    const nearest = Math.round(at);
    const index = Math.abs(at - nearest) < 1e-4 ? nearest : Math.floor(at);
    const t = index === nearest && Math.abs(at - nearest) < 1e-4 ? 0 : at - index;
    return { a: this.frame(index), b: this.frame(index + 1), t };
  }

  /** A character's channels at a time: the values of the two frames around it, and the weight of the second. */
  channels(seconds) {
    const { a, b, t } = this.around(seconds);
    const start = this.width - this.worn;
    return { a: a.subarray(start), b: b.subarray(start), t };
  }

  /** The pose at a time in seconds: exactly a frame's pose at the time of that frame. */
  pose(seconds) {
    if (this.count === 0) return this.rest;
    const { a, b, t } = this.around(seconds);
    const places = 4 * this.joints;
    const value = (i) => (t === 0 ? a[i] : mix(a[i], b[i], t));
    const rotations = [];
    for (let i = 0; i < places; i += 4) rotations.push(slerp(Array.from(a.subarray(i, i + 4)), Array.from(b.subarray(i, i + 4)), t));
    return {
      rotations,
      translation: [0, 1, 2].map((i) => value(places + i)),
      face: Array.from({ length: this.face }, (_, i) => value(places + 3 + i)),
    };
  }
}

/** World positions and rotations of all joints. */
export function place(scene, pose) {
  const places = [];
  const turned = [];
  scene.parents.forEach((parent, joint) => {
    const offset = scene.offsets[joint];
    if (parent < 0) {
      places.push(add(offset, pose.translation));
      turned.push(pose.rotations[joint]);
    } else {
      places.push(add(places[parent], rotate(turned[parent], offset)));
      turned.push(product(turned[parent], pose.rotations[joint]));
    }
  });
  return { places, turned };
}

/** Rotation of a helper joint if its joint has rotation `turn`, both in the frame of that joint's parent. */
function share({ axis, swing, twist }, turn) {
  const along = dot(turn, axis);
  const size = Math.hypot(along, turn[3]);
  // Half a turn across the bone has no defined twist.
  const about = size > 1e-6 ? [...scale(axis, along / size), turn[3] / size] : [0, 0, 0, 1];
  const across = product(turn, inverse(about));
  return product(slerp([0, 0, 0, 1], across, swing), slerp([0, 0, 0, 1], about, twist));
}

/** The joints followed by the mesh's helper joints. */
export function withHelpers({ parents, mesh }, { rotations }, { places, turned }) {
  const turn = (helper) => product(turned[parents[helper.of]], share(helper, rotations[helper.of]));
  return {
    places: [...places, ...mesh.helpers.map(({ of }) => places[of])],
    turned: [...turned, ...mesh.helpers.map(turn)],
  };
}

/** Joint positions in the rest pose. */
export function restPlaces(scene) {
  const places = [];
  scene.parents.forEach((parent, joint) => {
    places.push(parent < 0 ? scene.offsets[joint] : add(places[parent], scene.offsets[joint]));
  });
  return places;
}

/** Writes the skinning matrices into `rows`: three rows of four numbers per joint. */
export function skin({ places, turned }, rest, rows) {
  turned.forEach(([x, y, z, w], joint) => {
    const m = [
      [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
      [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
      [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ];
    const moved = rotate([x, y, z, w], rest[joint]);
    for (let row = 0; row < 3; row++) {
      const shift = places[joint][row] - moved[row];
      rows.set([...m[row], shift], 12 * joint + 4 * row);
    }
  });
  return rows;
}
