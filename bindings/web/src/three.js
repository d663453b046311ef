// Characters for three.js: glTF files with common bone names, and VRM (@pixiv/three-vrm). Imports nothing from
// three.js: it uses the objects of the page's own copy. The module (`follower.js`) finds bones and shapes and retargets
// poses; the character is described to it as a glTF file.

import { Follower } from "./follower.js";

/** Node name as in the character's file: three.js removes reserved characters. */
const nameOf = ({ name, userData }) => userData?.name ?? userData?.originalName ?? name ?? "";

/** Collects `root` and the nodes below it, ignoring the root's own transform, which places it in the scene. The surfaces of
 * meshes are only needed for the volume of the body. */
function describe(root, hasBody) {
  const nodes = [];
  root.traverse((node) => nodes.push(node));
  const index = new Map(nodes.map((node, i) => [node, i]));
  const json = { asset: { version: "2.0" }, nodes: [], meshes: [], skins: [], accessors: [], bufferViews: [], buffers: [] };
  const numbers = [];
  const accessor = (type, values) => {
    const width = { SCALAR: 1, VEC3: 3, VEC4: 4 }[type];
    const bufferView = json.bufferViews.push({ buffer: 0, byteOffset: 4 * numbers.length, byteLength: 4 * values.length }) - 1;
    for (const value of values) numbers.push(value);
    return json.accessors.push({ bufferView, componentType: 5126, count: values.length / width, type }) - 1;
  };
  for (const node of nodes) {
    const { x, y, z, w } = node.quaternion;
    const place = { translation: [node.position.x, node.position.y, node.position.z], rotation: [x, y, z, w], scale: [node.scale.x, node.scale.y, node.scale.z] };
    const described = { name: nameOf(node), children: node.children.map((child) => index.get(child)), ...(node === root ? {} : place) };
    if (node.morphTargetInfluences?.length > 0) {
      described.mesh = json.meshes.push(meshOf(node)) - 1;
      described.weights = [...node.morphTargetInfluences];
    }
    const surface = hasBody ? surfaceOf(node.geometry) : undefined;
    if (surface) {
      described.mesh ??= json.meshes.push({ primitives: [{}] }) - 1;
      const [primitive] = json.meshes[described.mesh].primitives;
      primitive.attributes = Object.fromEntries(Object.entries(surface.attributes).map(([name, [type, values]]) => [name, accessor(type, values)]));
      if (surface.indices) primitive.indices = accessor("SCALAR", surface.indices);
    }
    const { bones, boneInverses } = node.skeleton ?? {};
    if (bones?.every((bone) => index.has(bone))) {
      const bufferView = json.bufferViews.push({ buffer: 0, byteOffset: 4 * numbers.length, byteLength: 64 * bones.length }) - 1;
      const inverseBindMatrices = json.accessors.push({ bufferView, componentType: 5126, count: bones.length, type: "MAT4" }) - 1;
      boneInverses.forEach((inverse) => numbers.push(...times(inverse.elements, node.bindMatrix.elements)));
      described.skin = json.skins.push({ joints: bones.map((bone) => index.get(bone)), inverseBindMatrices }) - 1;
    }
    json.nodes.push(described);
  }
  json.buffers.push({ byteLength: 4 * numbers.length });
  return { nodes, index, json, numbers };
}

/** Points, weights and triangles of a three.js geometry; undefined without points. */
function surfaceOf({ attributes = {}, index } = {}) {
  const { position, skinIndex, skinWeight } = attributes;
  if (!position) return undefined;
  const values = (attribute, names) => Array.from({ length: attribute.count }, (_, at) => names.map((name) => attribute[name](at))).flat();
  const [three, four] = [["getX", "getY", "getZ"], ["getX", "getY", "getZ", "getW"]];
  const found = { POSITION: ["VEC3", values(position, three)] };
  if (skinIndex && skinWeight) Object.assign(found, { JOINTS_0: ["VEC4", values(skinIndex, four)], WEIGHTS_0: ["VEC4", values(skinWeight, four)] });
  return { attributes: found, indices: index ? values(index, ["getX"]) : undefined };
}

function meshOf({ name, morphTargetDictionary = {}, morphTargetInfluences }) {
  const targetNames = Array.from(morphTargetInfluences, () => "");
  for (const [shape, at] of Object.entries(morphTargetDictionary)) targetNames[at] = shape;
  return { name, primitives: [{ targets: targetNames.map(() => ({})) }], extras: { targetNames } };
}

/** Product of two matrices in column-major order. */
function times(a, b) {
  return Array.from({ length: 16 }, (_, at) => [0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + (at % 4)] * b[4 * (at >> 2) + k], 0));
}

/** Bones and expressions of a VRM, as a VRM 1.0 extension. */
function vrmExtension({ humanoid, expressionManager }, index) {
  const humanBones = {};
  for (const name of Object.keys(humanoid.humanBones)) {
    const node = index.get(humanoid.getRawBoneNode?.(name) ?? humanoid.getBoneNode?.(name));
    if (node !== undefined) humanBones[name] = { node };
  }
  const preset = {};
  for (const expression of expressionManager?.expressions ?? []) {
    const binds = (expression.binds ?? expression._binds ?? []).filter(({ primitives }) => primitives);
    const morphTargetBinds = binds.flatMap(({ primitives, index: shape, weight }) => primitives.map((mesh) => ({ node: index.get(mesh), index: shape, weight })));
    preset[expression.expressionName] = { morphTargetBinds: morphTargetBinds.filter(({ node }) => node !== undefined) };
  }
  return { humanoid: { humanBones }, expressions: { preset } };
}

/** Writes a .glb file. */
function pack(json, numbers) {
  const words = new TextEncoder().encode(JSON.stringify(json));
  const text = new Uint8Array(4 * Math.ceil(words.length / 4)).fill(0x20);
  text.set(words);
  const [start, length] = [28 + text.length, 4 * numbers.length];
  const file = new Uint8Array(start + length);
  const view = new DataView(file.buffer);
  [0x46546c67, 2, file.length, text.length, 0x4e4f534a].forEach((word, i) => view.setUint32(4 * i, word, true));
  file.set(text, 20);
  [length, 0x004e4942].forEach((word, i) => view.setUint32(start - 8 + 4 * i, word, true));
  numbers.forEach((value, i) => view.setFloat32(start + 4 * i, value, true));
  return file;
}

/** Applies poses to a character: call `character.apply(avatar.samplePose(), seconds)` for each frame. */
export class Character {
  #follower;
  #moves;
  #joints;
  #hips;
  #tracks;
  #expressions;

  /**
   * `target` is a glTF scene or any Object3D at rest, or a VRM of @pixiv/three-vrm. `model` is `avatar.model`. `bones`
   * gives bones that were not found: `{ left_elbow: Object3D }`, or null to leave a joint out. With `moves: false` the
   * character stays in place, and only sways and turns. `body` is that of a mapping file: `{ gain: 1 }` keeps arms out of
   * the character's body, whose girth is measured on its meshes; `{ gain: 1, belly: 1.2 }` corrects it.
   */
  constructor(target, model, { bones = {}, moves = true, body = {} } = {}) {
    const isVrm = target.humanoid !== undefined;
    const root = isVrm ? target.scene : target;
    if (isVrm) {
      // The VRM's humanoid rig would overwrite the pose set here.
      if ("autoUpdateHumanBones" in target.humanoid) target.humanoid.autoUpdateHumanBones = false;
      target.humanoid.resetRawPose?.();
    }
    const { nodes, index, json, numbers } = describe(root, body.gain > 0);
    if (isVrm) json.extensions = { VRMC_vrm: vrmExtension(target, index) };
    const given = Object.entries(bones).map(([joint, node]) => {
      if (node && !index.has(node)) throw new Error(`umo: the bone for ${joint} is not part of the character`);
      return [joint, node ? index.get(node) : ""];
    });
    this.#follower = new Follower(pack(json, numbers), model, { bones: Object.fromEntries(given), body });
    this.#moves = moves;
    this.#bind(nodes, isVrm ? target.expressionManager : undefined);
  }

  #bind(nodes, manager) {
    const { held, driven, hips, tracks, expressions, bones, still } = this.#follower.description;
    const properties = { translation: "position", rotation: "quaternion", scale: "scale" };
    for (const [node, path, value] of held) nodes[node][properties[path]].set(...value);
    this.#joints = driven.map((node) => nodes[node].quaternion);
    this.#hips = hips === null ? undefined : nodes[hips].position;
    this.#tracks = tracks.map(({ node, count, moved }) => ({ influences: nodes[node].morphTargetInfluences, count, moved, values: [] }));
    this.#expressions = expressions.map((name) => ({ manager, name }));
    /** Bones of each joint, with `spine` and `neck` as lists; joints without a bone, and face channels without a
     * shape. */
    this.bones = Object.fromEntries(Object.entries(bones).map(([joint, found]) => [joint, found.map((node) => nodes[node])]));
    this.missing = { joints: Object.keys(bones).filter((joint) => bones[joint].length === 0), channels: still };
    /** Whether the mouth moves at all. */
    this.speaks = this.#follower.description.speaks;
    if (!manager?.update) return;
    // The expression manager clears every shape that an expression uses, at any point of a frame.
    const update = manager.update.bind(manager);
    manager.update = () => {
      update();
      this.#shape();
    };
  }

  /** Applies a pose from `avatar.samplePose()` or a session, `seconds` after the last one. */
  apply(pose, seconds) {
    const { translation: [x, y, z] } = pose;
    const values = this.#follower.values({ ...pose, translation: this.#moves ? [x, y, z] : [0, y, 0] }, seconds);
    let at = 0;
    const next = (count) => values.subarray(at, (at += count));
    for (const quaternion of this.#joints) quaternion.set(...next(4));
    this.#hips?.set(...next(3));
    for (const track of this.#tracks) track.values = next(track.count).slice();
    for (const { manager, name } of this.#expressions) manager.setValue(name, next(1)[0]);
    this.#shape();
  }

  #shape() {
    for (const { influences, moved, values } of this.#tracks) for (const shape of moved) influences[shape] = values[shape] ?? influences[shape];
  }

  /** Frees the character's memory in the module. */
  free() {
    this.#follower.free();
  }
}
