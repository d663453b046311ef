// The body that shows the motion, independent of drawing: joint positions at a time, height, and the floor.

import { Gltf } from "umo/gltf.js";
import { clamp, cross, mix, multiply, normalize, slerp, subtract, transform } from "umo/math.js";
import { place, restPlaces } from "umo/motion.js";

/** Frames per second of the curves of a character with its own animation. */
const RATE = 30;
/** Display height in metres for characters of another size: some are made in centimetres. */
const TALL = 1.7;
const [LEAST, MOST] = [0.6, 3];

/** glTF extensions that the page does not support; the program already refuses such files. */
const UNREAD = ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu"];

const LEGS = [
  ["left_ankle", "left_foot"],
  ["right_ankle", "right_foot"],
];

/** Measurements of a body that the camera needs: its extent at rest, and its feet. */
class Body {
  constructor(scene) {
    this.scene = scene;
  }

  joint(name) {
    return this.scene.joints.indexOf(name);
  }

  /** Sets the measurements from the rest positions of joints and surface. */
  measure(places, [low, high]) {
    const head = places[this.joint("head")];
    this.height = high - low;
    /** From the head joint to the crown, ignoring hats and horns unless the body is a head alone. */
    const most = this.nodes && this.nodes[this.joint("pelvis")] === null ? 1 : 0.24;
    this.crown = clamp(high - head[1], 0.06 * this.height, most * this.height);
    this.soles = LEGS.map((names) => Math.min(...names.map((name) => places[this.joint(name)][1])) - low);
  }

  /** Height of the floor under a pose's lower foot. */
  ground(places) {
    return Math.min(...LEGS.map((names, i) => Math.min(...names.map((name) => places[this.joint(name)][1])) - this.soles[i]));
  }

  /** Heel, ball and height over the floor of each foot. */
  feet(places, floor) {
    return LEGS.map(([ankle, foot], i) => {
      const [a, b] = [places[this.joint(ankle)], places[this.joint(foot)]];
      const along = [b[0] - a[0], b[2] - a[2]];
      const beyond = (share) => [a[0] + share * along[0], a[2] + share * along[1]];
      return { heel: beyond(-0.2), ball: beyond(1.45), height: Math.max(Math.min(a[1], b[1]) - this.soles[i] - floor, 0) };
    });
  }
}

/** The figure: joints at fixed distances, rotated by the motion. */
export class FigureBody extends Body {
  constructor(scene, motion) {
    super(scene);
    this.motion = motion;
    this.measure(restPlaces(scene), extent(scene.mesh.positions));
  }

  at(seconds) {
    const pose = this.motion.pose(seconds);
    return { pose, placed: place(this.scene, pose) };
  }

  get still() {
    return place(this.scene, this.motion.rest).places;
  }
}

/** Floor height: under the feet in most frames. */
export function usualFloor(body, motion) {
  if (motion.count === 0) return body.ground(body.still);
  const step = Math.max(1, Math.floor(motion.count / 100));
  const found = [];
  for (let frame = motion.first; frame < motion.end; frame += step) found.push(body.ground(body.at(frame / motion.rate).placed.places));
  found.sort((a, b) => a - b);
  return found[Math.floor(found.length / 2)];
}

function extent(positions) {
  let [low, high] = [Infinity, -Infinity];
  for (let i = 1; i < positions.length; i += 3) [low, high] = [Math.min(low, positions[i]), Math.max(high, positions[i])];
  return [low, high];
}

/** A custom character: a glTF file whose first animation is the motion. */
export class CharacterBody extends Body {
  constructor(scene, character, rest) {
    super(scene);
    this.gltf = new Gltf(character.file);
    const { extensionsRequired = [] } = this.gltf.json;
    const unread = UNREAD.find((name) => extensionsRequired.includes(name));
    if (unread) throw new Error(`it is compressed in a way that the page does not read, ${unread}: export it without`);
    if (this.gltf.list("meshes").length === 0) throw new Error("it has bones and no body: it lacks a mesh to show");
    if (character.follower) this.gltf.channels = channelsOf(character.follower, rest);
    this.nodes = character.nodes;
    this.parts = parts(this.gltf);
    const streamed = character.follower?.description.held.length ?? character.streamed;
    /** The channels whose values arrive with a stream's frames. */
    this.streamed = streamed === null ? [] : this.gltf.channels.slice(streamed);
    character.worn = this.streamed.reduce((sum, { width }) => sum + width, 0);
    this.face();
    const world = this.gltf.world(this.gltf.rest);
    const [low, high] = this.surface(world);
    /** Joint positions for a face without bones: about where a head would be. */
    this.middle = [0, mix(low, high, 0.35), 0];
    this.measure(this.placed({ own: this.gltf.rest, world, weights: new Map() }).places, this.surface(world));
  }

  /** Turns the character to face the camera, and scales it to the size of a person. */
  face() {
    const { gltf } = this;
    const world = gltf.world(gltf.rest);
    const node = (name) => this.nodes[this.joint(name)];
    const at = (name) => world[node(name)].slice(12, 15);
    // A head has at least eyes; a face alone faces as the format defines.
    const pairs = ["shoulder", "hip", "eye_smplhf", "eye"].map((part) => [`left_${part}`, `right_${part}`]);
    const pair = pairs.find((names) => names.every((name) => this.joint(name) >= 0 && node(name) !== null));
    const ahead = pair ? normalize(cross(subtract(at(pair[0]), at(pair[1])), [0, 1, 0])) : [0, 0, 1];
    const quarter = Math.round(Math.atan2(ahead[0], ahead[2]) / (Math.PI / 2));
    const [c, s] = [
      [1, 0],
      [0, -1],
      [-1, 0],
      [0, 1],
    ][((quarter % 4) + 4) % 4];
    const [low, high] = this.surface(world);
    const size = high - low > LEAST && high - low < MOST ? 1 : TALL / (high - low);
    gltf.base = [c * size, 0, -s * size, 0, 0, size, 0, 0, s * size, 0, c * size, 0, 0, 0, 0, 1];
  }

  /** Lowest and highest points of the surface in world space. */
  surface(world) {
    let [low, high] = [Infinity, -Infinity];
    for (const part of this.parts) {
      const matrices = part.matrices(world);
      const step = Math.max(1, Math.floor(part.count / 4000));
      for (let i = 0; i < part.count; i += step) {
        const strongest = [0, 1, 2, 3].reduce((best, k) => (part.weights[4 * i + k] > part.weights[4 * i + best] ? k : best), 0);
        const y = transform(matrices[part.joints[4 * i + strongest]], part.positions.subarray(3 * i, 3 * i + 3))[1];
        [low, high] = [Math.min(low, y), Math.max(high, y)];
      }
    }
    return [low, high];
  }

  /** The 55 joints; a joint without a bone uses the one above. */
  placed({ own, world, weights }) {
    const { parents } = this.scene;
    const places = [];
    const first = this.nodes.find((node) => node !== null);
    const root = first === undefined ? this.middle : world[first].slice(12, 15);
    this.nodes.forEach((node, joint) => places.push(node === null ? (places[parents[joint]] ?? root) : world[node].slice(12, 15)));
    return { places, own, world, weights };
  }

  /** Follows a stream's frames. */
  follow(motion) {
    this.motion = motion;
  }

  /** The nodes at a time, from the file's animation or a stream's frames. */
  state(seconds) {
    if (!this.motion) return this.gltf.at(seconds);
    if (this.motion.count === 0) return this.gltf.at(0);
    const { a, b, t } = this.motion.channels(seconds);
    let start = 0;
    const values = this.streamed.map(({ path, width }) => {
      const [from, to] = [a, b].map((values) => Array.from(values.subarray(start, start + width)));
      start += width;
      return path === "rotation" ? slerp(from, to, t) : from.map((x, i) => mix(x, to[i], t));
    });
    return this.gltf.at(0, new Map(this.streamed.map((channel, i) => [channel, values[i]])));
  }

  at(seconds) {
    const state = this.state(seconds);
    const rotations = this.nodes.map((node) => (node === null ? [0, 0, 0, 1] : state.own[node].rotation));
    return { pose: { rotations, translation: [0, 0, 0], face: [] }, placed: this.placed(state) };
  }

  get still() {
    return this.placed(this.gltf.at(0)).places;
  }

  /** Converts the file's animation to frames of the 55 joints, for the curves. Fills in the scene. */
  becomeMotion() {
    const { gltf, scene } = this;
    const faces = gltf.channels.filter(({ path }) => path === "weights").sort((a, b) => b.width - a.width);
    const names = faces.length > 0 ? shapeNames(gltf, faces[0].node, faces[0].width) : [];
    const count = Math.round(scene.character.seconds * RATE) + 1;
    const width = 4 * this.nodes.length + 3 + names.length;
    const frames = new Float32Array(count * width);
    const root = this.still[0];
    for (let frame = 0; frame < count; frame++) {
      const { pose, placed } = this.at(frame / RATE);
      const face = names.length > 0 ? placed.weights.get(faces[0].node) : [];
      frames.set([...pose.rotations.flat(), ...subtract(placed.places[0], root), ...face], frame * width);
    }
    Object.assign(scene, { frames, frameRate: RATE, face: { kind: "shapes", names } });
  }
}

/** Channels of a dropped character standing as `rest`: those of the bind pose, then those that arrive with frames. */
function channelsOf(follower, rest) {
  const { held, driven, hips, tracks } = follower.description;
  const values = follower.values({ ...rest, rotations: rest.rotations.flat() }).slice();
  let at = 0;
  const still = (node, path, value) => ({ node, path, times: [0], values: Float32Array.from(value), width: value.length, interpolation: "STEP" });
  const next = (node, path, count) => still(node, path, values.subarray(at, (at += count)));
  return [
    ...held.map(([node, path, value]) => still(node, path, value)),
    ...driven.map((node) => next(node, "rotation", 4)),
    ...(hips === null ? [] : [next(hips, "translation", 3)]),
    ...tracks.map(({ node, count }) => next(node, "weights", count)),
  ];
}

/** Names of the shapes of a node's mesh, or their indices if unnamed. */
export function shapeNames(gltf, node, count) {
  const mesh = gltf.list("meshes")[gltf.list("nodes")[node].mesh];
  const names = mesh?.extras?.targetNames ?? mesh?.primitives.find((one) => one.extras?.targetNames)?.extras.targetNames;
  return Array.from({ length: count }, (_, i) => names?.[i] ?? `shape ${i + 1}`);
}

/** The visible surfaces: triangles, and the joints and shapes that deform them. */
function parts(gltf) {
  const found = [];
  for (const node of gltf.order) {
    const { mesh, skin } = gltf.list("nodes")[node];
    if (mesh === undefined) continue;
    const bones = skin === undefined ? { joints: [node] } : gltf.list("skins")[skin];
    const inverse = bones.inverseBindMatrices === undefined ? null : gltf.floats(bones.inverseBindMatrices).values;
    const bind = (i) => (inverse ? Array.from(inverse.subarray(16 * i, 16 * i + 16)) : null);
    const binds = bones.joints.map((_, i) => bind(i));
    const matrices = (world) => bones.joints.map((joint, i) => (binds[i] ? multiply(world[joint], binds[i]) : world[joint]));
    for (const primitive of gltf.list("meshes")[mesh].primitives) {
      if ((primitive.mode ?? 4) !== 4 || primitive.attributes.POSITION === undefined) continue;
      found.push(part(gltf, node, primitive, skin !== undefined, { bones: bones.joints, matrices }));
    }
  }
  return found;
}

function part(gltf, node, { attributes, indices, material, targets = [] }, isSkinned, moving) {
  const read = (name) => (attributes[name] === undefined ? null : gltf.floats(attributes[name]));
  const positions = read("POSITION").values;
  const count = positions.length / 3;
  const triangles = indices === undefined ? Uint32Array.from({ length: count }, (_, i) => i) : Uint32Array.from(gltf.stored(indices));
  return {
    ...moving,
    node,
    count,
    positions,
    normals: read("NORMAL")?.values ?? normalsOf(positions, triangles),
    uv: [0, 1].map((set) => read(`TEXCOORD_${set}`)?.values ?? null),
    colors: colorsOf(read("COLOR_0"), count),
    joints: isSkinned && attributes.JOINTS_0 !== undefined ? Uint16Array.from(gltf.stored(attributes.JOINTS_0)) : new Uint16Array(4 * count),
    weights: weightsOf(isSkinned ? read("WEIGHTS_0") : null, count),
    triangles,
    material: gltf.list("materials")[material] ?? {},
    shapes: targets.map((target) => shapeOf(gltf, target)),
  };
}

function colorsOf(read, count) {
  const colors = new Float32Array(4 * count).fill(1);
  if (read) for (let i = 0; i < count; i++) colors.set(read.values.subarray(read.width * i, read.width * (i + 1)), 4 * i);
  return colors;
}

/** Skin weights normalised to sum 1; all on the first joint if there are none. */
function weightsOf(read, count) {
  const weights = new Float32Array(4 * count);
  for (let i = 0; i < count; i++) {
    const own = read ? read.values.subarray(4 * i, 4 * i + 4) : [1, 0, 0, 0];
    const sum = own[0] + own[1] + own[2] + own[3];
    if (sum > 0) for (let k = 0; k < 4; k++) weights[4 * i + k] = own[k] / sum;
    else weights[4 * i] = 1;
  }
  return weights;
}

/** The vertices that a shape moves, and their displacements. */
function shapeOf(gltf, { POSITION, NORMAL }) {
  const moved = POSITION === undefined ? new Float32Array(0) : gltf.floats(POSITION).values;
  const turned = NORMAL === undefined ? null : gltf.floats(NORMAL).values;
  const vertices = [];
  for (let i = 0; i < moved.length; i += 3) if (moved[i] || moved[i + 1] || moved[i + 2]) vertices.push(i / 3);
  const pick = (values) => Float32Array.from(vertices.flatMap((vertex) => [values[3 * vertex], values[3 * vertex + 1], values[3 * vertex + 2]]));
  return { vertices, positions: pick(moved), normals: turned ? pick(turned) : null };
}

/** Normals for a surface without any. */
function normalsOf(positions, triangles) {
  const normals = new Float32Array(positions.length);
  const point = (vertex) => positions.subarray(3 * vertex, 3 * vertex + 3);
  for (let i = 0; i < triangles.length; i += 3) {
    const corners = triangles.subarray(i, i + 3);
    const [a, b, c] = [...corners].map(point);
    const normal = cross(subtract(b, a), subtract(c, a));
    for (const corner of corners) for (let axis = 0; axis < 3; axis++) normals[3 * corner + axis] += normal[axis];
  }
  return normals;
}
