// The three.js adapter on nodes with three.js' fields: bone names, the rest pose, and bone directions. In a browser
// with three.js itself, tests/page/readme.mjs tests it.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { Model, Pose } from "../src/index.js";
import { Character } from "../src/three.js";

const root = new URL("../../../", import.meta.url);
const [wasm, file] = await Promise.all(["bindings/web/dist/umo.wasm", "models/umo-people/model.safetensors"].map((path) => readFile(new URL(path, root))));
const model = await Model.load({ wasm, model: file });

class Node {
  constructor(name, [x, y, z] = [0, 0, 0], turn = [0, 0, 0, 1]) {
    const vector = (x, y, z) => ({ x, y, z, set(...v) { [this.x, this.y, this.z] = v; }, clone() { return vector(this.x, this.y, this.z); } });
    const [qx, qy, qz, qw] = turn;
    Object.assign(this, { name, parent: null, children: [], position: vector(x, y, z), scale: vector(1, 1, 1) });
    this.quaternion = { x: qx, y: qy, z: qz, w: qw, set(...q) { [this.x, this.y, this.z, this.w] = q; } };
  }

  add(...nodes) {
    for (const node of nodes) {
      node.parent = this;
      this.children.push(node);
    }
    return this;
  }

  traverse(call) {
    call(this);
    this.children.forEach((child) => child.traverse(call));
  }
}

const rotate = ([x, y, z, w], [a, b, c]) => {
  const t = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * t[0] + y * t[2] - z * t[1], b + w * t[1] + z * t[0] - x * t[2], c + w * t[2] + x * t[1] - y * t[0]];
};
const place = (node) => {
  if (!node.parent) return [0, 0, 0];
  let { x, y, z } = node.position;
  let v = [x, y, z];
  for (let up = node.parent; up; up = up.parent) {
    const { x, y, z, w } = up.quaternion;
    v = rotate([x, y, z, w], v);
    if (up.parent) v = v.map((value, i) => value + [up.position.x, up.position.y, up.position.z][i]);
  }
  return v;
};

/** A character with Mixamo names, arms lowered by 45 degrees, a rotated intermediate bone, and a face. */
function mixamo() {
  const half = Math.PI / 4;
  const arm = (side, s) => {
    // Mixamo's bone axes: y is along the bone.
    const turn = [0, 0, -s * Math.sin(half / 2 + Math.PI / 4), Math.cos(half / 2 + Math.PI / 4)];
    const hand = new Node(`mixamorig:${side}Hand`, [0, 0.25, 0]).add(new Node(`mixamorig:${side}HandIndex1`, [0, 0.08, 0]));
    const fore = new Node(`mixamorig:${side}ForeArm`, [0, 0.28, 0]).add(hand);
    const upper = new Node(`mixamorig:${side}Arm`, [s * 0.12, 0, 0], turn).add(fore);
    return new Node(`mixamorig:${side}Shoulder`, [s * 0.05, 0.1, 0]).add(upper);
  };
  const leg = (side, s) => {
    const foot = new Node(`mixamorig:${side}Foot`, [0, -0.42, 0]).add(new Node(`mixamorig:${side}ToeBase`, [0, -0.08, 0.12]));
    return new Node(`mixamorig:${side}UpLeg`, [s * 0.09, -0.05, 0]).add(new Node(`mixamorig:${side}Leg`, [0, -0.43, 0]).add(foot));
  };
  const head = new Node("mixamorig:Neck", [0, 0.15, 0]).add(new Node("mixamorig:Head", [0, 0.1, 0]));
  const chest = new Node("mixamorig:Spine2", [0, 0.12, 0]).add(head, arm("Left", 1), arm("Right", -1));
  const spine = new Node("mixamorig:Spine", [0, 0.1, 0]).add(new Node("mixamorig:Spine1", [0, 0.12, 0]).add(chest));
  const hips = new Node("mixamorig:Hips", [0, 1, 0]).add(spine, leg("Left", 1), leg("Right", -1));
  const face = Object.assign(new Node("Face"), { isMesh: true, morphTargetDictionary: { jawOpen: 0, eyeBlink_L: 1, smile: 2 }, morphTargetInfluences: [0, 0, 0.5] });
  return new Node("scene").add(new Node("Armature").add(hips), face);
}

const bonesOf = (root) => Object.fromEntries(Object.entries(new Character(root, model).bones).map(([joint, nodes]) => [joint, nodes.map(({ name }) => name)]));

test("bones are found by their names", () => {
  const names = bonesOf(mixamo());
  assert.deepEqual(names.pelvis, ["mixamorig:Hips"]);
  assert.deepEqual(names.left_collar, ["mixamorig:LeftShoulder"]);
  assert.deepEqual(names.left_shoulder, ["mixamorig:LeftArm"]);
  assert.deepEqual(names.right_elbow, ["mixamorig:RightForeArm"]);
  assert.deepEqual(names.left_foot, ["mixamorig:LeftToeBase"]);
  assert.deepEqual(names.spine, ["mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2"]);
  assert.deepEqual(names.left_index1, ["mixamorig:LeftHandIndex1"]);
  const eyes = Object.keys(names).filter((joint) => joint.includes("eye"));
  assert.ok(eyes.every((joint) => names[joint].length === 0));
});

test("names are those of the file, from which three.js takes the signs", () => {
  const scene = mixamo();
  scene.traverse((node) => {
    const blender = node.name.replace(/mixamorig:(Left|Right)(.*)/, (_, side, rest) => `mixamorig:${rest}.${side[0].toLowerCase()}`);
    Object.assign(node, { userData: { name: blender }, name: blender.replace(/[:.]/g, "") });
  });
  const names = bonesOf(scene);
  assert.deepEqual([names.left_elbow, names.right_knee], [["mixamorigForeArml"], ["mixamorigLegr"]]);
});

test("a bone that has another name can be given, and one that is elsewhere is refused", () => {
  const scene = mixamo();
  let elbow;
  scene.traverse((node) => node.name === "mixamorig:LeftForeArm" && (elbow = node));
  elbow.name = "thing";
  assert.throws(() => new Character(scene, model), /INVALID_ARGUMENT.*left_elbow/);
  assert.equal(new Character(scene, model, { bones: { left_elbow: elbow } }).bones.left_elbow[0], elbow);
  assert.throws(() => new Character(scene, model, { bones: { left_elbow: new Node("thing") } }), /left_elbow is not part/);
});

test("the model's rest is a T-pose on a character that stands otherwise", () => {
  const scene = mixamo();
  const character = new Character(scene, model);
  const pose = new Pose(model);
  for (let j = 0; j < 55; j++) pose.rotations[4 * j + 3] = 1;
  character.apply(pose);
  for (const [side, s] of [["left", 1], ["right", -1]]) {
    const [elbow, shoulder] = [place(character.bones[`${side}_elbow`][0]), place(character.bones[`${side}_shoulder`][0])];
    const arm = elbow.map((v, i) => v - shoulder[i]);
    const joint = model.jointNames.indexOf(`${side}_elbow`);
    const wanted = [...model.offsets.subarray(3 * joint, 3 * joint + 3)];
    const size = Math.sqrt(wanted.reduce((sum, v) => sum + v * v, 0));
    assert.ok(s * arm[0] > 0.2, `${side}: ${arm}`);
    wanted.forEach((v, i) => assert.ok(Math.abs(arm[i] - (v / size) * 0.28) < 1e-5, `${side}: ${arm}`));
  }
});

test("a turn of a joint turns what hangs from it, and the root goes with the character's size", () => {
  const character = new Character(mixamo(), model);
  const pose = new Pose(model);
  for (let j = 0; j < 55; j++) pose.rotations[4 * j + 3] = 1;
  character.apply(pose);
  const before = place(character.bones.head[0]);
  // The pelvis turns left, about y.
  pose.rotations.set([0, Math.SQRT1_2, 0, Math.SQRT1_2], 0);
  pose.translation.set([0, 0.1, 0]);
  character.apply(pose);
  const hand = place(character.bones.left_wrist[0]);
  assert.ok(hand[2] < -0.3 && Math.abs(hand[0]) < 0.1, `${hand}`);
  const rise = place(character.bones.head[0])[1] - before[1];
  assert.ok(rise > 0.08 && rise < 0.13, `${rise}`);
});

/** A wide trunk, skinned to three bones of a character. */
function trunk(scene) {
  const nodes = [];
  scene.traverse((node) => nodes.push(node));
  const bones = ["Hips", "Spine1", "Spine2"].map((name) => nodes.find((node) => node.name === `mixamorig:${name}`));
  const matrix = (x, y, z) => ({ elements: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1] });
  const [points, joints, weights, corners] = [[], [], [], []];
  for (let ring = 0; ring <= 30; ring++) {
    for (let side = 0; side < 24; side++) {
      const turn = (Math.PI * side) / 12, a = 24 * ring + side, b = 24 * ring + ((side + 1) % 24);
      points.push([0.28 * Math.sin(turn), 0.9 + (0.6 * ring) / 30, 0.32 * Math.cos(turn)]);
      joints.push([ring < 9 ? 0 : ring < 18 ? 1 : 2, 0, 0, 0]);
      weights.push([1, 0, 0, 0]);
      if (ring < 30) corners.push([a], [b], [a + 24], [b], [b + 24], [a + 24]);
    }
  }
  const attribute = (rows) => ({ count: rows.length, getX: (at) => rows[at][0], getY: (at) => rows[at][1], getZ: (at) => rows[at][2], getW: (at) => rows[at][3] });
  const mesh = Object.assign(new Node("Trunk"), {
    geometry: { attributes: { position: attribute(points), skinIndex: attribute(joints), skinWeight: attribute(weights) }, index: attribute(corners) },
    skeleton: { bones, boneInverses: bones.map((bone) => matrix(...place(bone).map((v) => -v))) },
    bindMatrix: matrix(0, 0, 0),
  });
  return scene.add(mesh);
}

test("arms keep out of a wide body", () => {
  const pose = new Pose(model);
  for (let j = 0; j < 55; j++) pose.rotations[4 * j + 3] = 1;
  const turn = (name, [x, y, z], angle) => {
    const [s, c] = [Math.sin(angle / 2), Math.cos(angle / 2)];
    pose.rotations.set([x * s, y * s, z * s, c], 4 * model.jointNames.indexOf(name));
  };
  // A left hand before the belly.
  turn("left_shoulder", [0, 0, 1], -1.2);
  turn("left_elbow", [0, 1, 0], -1.9);
  const hand = (scene, options) => {
    const character = new Character(scene, model, options);
    character.apply(pose);
    const [wrist, hips] = ["left_wrist", "pelvis"].map((joint) => place(character.bones[joint][0]));
    character.free();
    return Math.hypot(wrist[0] - hips[0], wrist[2] - hips[2]);
  };
  const [plain, none, wide] = [hand(mixamo()), hand(trunk(mixamo()), { body: { gain: 0 } }), hand(trunk(mixamo()), { body: { gain: 1 } })];
  assert.equal(none, plain);
  assert.ok(wide > plain + 0.03, `${plain} to ${wide} m`);
  assert.ok(Math.abs(hand(trunk(mixamo()), { body: { gain: 1, pelvis: 0.4, belly: 0.4, chest: 0.4 } }) - wide) > 0.02);
  assert.throws(() => new Character(mixamo(), model, { body: { gain: 1, tail: 1 } }), /tail/);
});

test("morph targets by ARKit's names; others are left alone", () => {
  const scene = mixamo();
  const character = new Character(scene, model);
  const pose = new Pose(model);
  for (let j = 0; j < 55; j++) pose.rotations[4 * j + 3] = 1;
  pose.face[model.channelNames.indexOf("jawOpen")] = 0.7;
  pose.face[model.channelNames.indexOf("eyeBlinkLeft")] = 0.25;
  character.apply(pose);
  const influences = scene.children[1].morphTargetInfluences;
  assert.ok(Math.abs(influences[0] - 0.7) < 1e-6);
  assert.deepEqual(influences.slice(1), [0.25, 0.5]);
  assert.ok(character.missing.channels.includes("mouthPucker") && !character.missing.channels.includes("jawOpen"));
});

/** A VRM with an expression for each of some shapes, whose manager clears them as three-vrm's does. */
function vrmOf(scene, expressions) {
  const face = scene.children[1];
  const named = new Map();
  scene.traverse((node) => named.set(node.name, node));
  const table = { hips: "Hips", spine: "Spine", head: "Head" };
  for (const side of ["Left", "Right"]) {
    for (const [name, bone] of Object.entries({ UpperArm: "Arm", LowerArm: "ForeArm", Hand: "Hand", UpperLeg: "UpLeg", LowerLeg: "Leg", Foot: "Foot" })) {
      table[`${side.toLowerCase()}${name}`] = `${side}${bone}`;
    }
  }
  const values = {};
  const bound = Object.entries(expressions).map(([expressionName, index]) => ({ expressionName, binds: [{ primitives: [face], index, weight: 1 }] }));
  return {
    scene,
    values,
    humanoid: { autoUpdateHumanBones: true, humanBones: table, getRawBoneNode: (name) => named.get(`mixamorig:${table[name]}`) },
    expressionManager: {
      expressions: bound,
      setValue: (name, value) => (values[name] = value),
      update: () => Object.values(expressions).forEach((index) => (face.morphTargetInfluences[index] = 0)),
    },
  };
}

test("a VRM's bones are those of its table, and its expressions speak where its shapes do not", () => {
  const scene = mixamo();
  const face = scene.children[1];
  face.morphTargetDictionary = { s1: 0, s2: 1, s3: 2 };
  const vrm = vrmOf(scene, { aa: 0, blink: 1 });
  const character = new Character(vrm, model);
  assert.equal(vrm.humanoid.autoUpdateHumanBones, false);
  assert.equal(character.bones.left_elbow[0].name, "mixamorig:LeftForeArm");
  assert.equal(character.speaks, true);
  const pose = new Pose(model);
  for (let j = 0; j < 55; j++) pose.rotations[4 * j + 3] = 1;
  pose.face[model.channelNames.indexOf("jawOpen")] = 0.7;
  character.apply(pose);
  assert.ok(vrm.values.aa > 0.9, `${vrm.values.aa}`);
  assert.equal(vrm.values.blink, 0);
});

test("a VRM's own shapes are not cleared by its expressions", () => {
  const scene = mixamo();
  const vrm = vrmOf(scene, { aa: 0, blink: 1 });
  const character = new Character(vrm, model);
  const pose = new Pose(model);
  for (let j = 0; j < 55; j++) pose.rotations[4 * j + 3] = 1;
  pose.face[model.channelNames.indexOf("jawOpen")] = 0.75;
  character.apply(pose);
  vrm.expressionManager.update();
  assert.equal(scene.children[1].morphTargetInfluences[0], 0.75);
});

test("the feet stand on the floor, wherever the model's own root is", () => {
  const character = new Character(mixamo(), model);
  const session = model.session();
  const pose = session.samplePose(0);
  character.apply(pose);
  const foot = place(character.bones.left_ankle[0])[1];
  assert.ok(Math.abs(foot - 0.1) < 0.03, `the ankle is at ${foot}, at rest at 0.1`);
  session.free();
});

test("a character that is freed follows no more", () => {
  const character = new Character(mixamo(), model);
  character.free();
  character.free();
  assert.throws(() => character.apply(new Pose(model)), /INVALID_HANDLE/);
  // And writes nothing to the memory that it had.
  for (let i = 0; i < 20; i++) assert.throws(() => new Character(new Node("box"), model), /no bones found/);
});

test("a character without hips is an error that says so", () => {
  assert.throws(() => new Character(new Node("box"), model), /no bones found for pelvis/);
});
