// The adapter for three.js, on nodes with three.js' fields: bones found by their names, a pose of rest, and directions of bones.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { Model, Pose } from "../src/index.js";
import { Character, findBones } from "../src/three.js";

const root = new URL("../../../", import.meta.url);
const [wasm, file] = await Promise.all(["bindings/web/dist/umo.wasm", "models/umo-people/model.safetensors"].map((path) => readFile(new URL(path, root))));
const model = await Model.load({ wasm, model: file });

class Node {
  constructor(name, [x, y, z] = [0, 0, 0], turn = [0, 0, 0, 1]) {
    const vector = (x, y, z) => ({ x, y, z, set(...v) { [this.x, this.y, this.z] = v; }, clone() { return vector(this.x, this.y, this.z); } });
    const [qx, qy, qz, qw] = turn;
    Object.assign(this, { name, parent: null, children: [], position: vector(x, y, z) });
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

/** A character of Mixamo's names, arms lowered by 45 degrees, with a turned bone between and a face. */
function mixamo() {
  const half = Math.PI / 4;
  const arm = (side, s) => {
    // Its own axes: along the bone is y, as Mixamo has it.
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

test("bones are found by their names", () => {
  const found = findBones(mixamo());
  const names = Object.fromEntries(Object.entries(found).map(([joint, node]) => [joint, node.name]));
  assert.equal(names.pelvis, "mixamorig:Hips");
  assert.equal(names.left_collar, "mixamorig:LeftShoulder");
  assert.equal(names.left_shoulder, "mixamorig:LeftArm");
  assert.equal(names.right_elbow, "mixamorig:RightForeArm");
  assert.equal(names.right_wrist, "mixamorig:RightHand");
  assert.equal(names.left_hip, "mixamorig:LeftUpLeg");
  assert.equal(names.left_foot, "mixamorig:LeftToeBase");
  assert.equal(names.spine3, "mixamorig:Spine2");
  assert.equal(names.left_index1, "mixamorig:LeftHandIndex1");
  assert.deepEqual(Object.keys(found).filter((joint) => joint.includes("eye")), []);
});

test("the bones of Unreal and Blender are found, too", () => {
  const names = ["pelvis", "spine_01", "neck_01", "head", "clavicle_l", "upperarm_l", "lowerarm_r", "hand_r", "thigh_l", "calf_l", "foot_l", "ball_l", "index_01_l"];
  const found = findBones(new Node("root").add(...names.map((name) => new Node(name))));
  for (const joint of ["pelvis", "spine1", "neck", "head", "left_collar", "left_shoulder", "right_elbow", "right_wrist", "left_hip", "left_knee", "left_ankle", "left_foot", "left_index1"]) {
    assert.ok(found[joint], joint);
  }
});

test("the model's rest is a T-pose on a character that stands otherwise", () => {
  const scene = mixamo();
  const character = new Character(scene, model);
  const pose = new Pose(model);
  for (let j = 0; j < 55; j++) pose.rotations[4 * j + 3] = 1;
  character.apply(pose);
  for (const [side, s] of [["left", 1], ["right", -1]]) {
    const [elbow, shoulder] = [place(character.bones[`${side}_elbow`]), place(character.bones[`${side}_shoulder`])];
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
  const before = place(character.bones.head);
  // The pelvis turns to the left, about y.
  pose.rotations.set([0, Math.SQRT1_2, 0, Math.SQRT1_2], 0);
  pose.translation.set([0, 0.1, 0]);
  character.apply(pose);
  const hand = place(character.bones.left_wrist);
  assert.ok(hand[2] < -0.3 && Math.abs(hand[0]) < 0.1, `${hand}`);
  const rise = place(character.bones.head)[1] - before[1];
  assert.ok(rise > 0.08 && rise < 0.13, `${rise}`);
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

test("VRM's vowels follow the visemes", () => {
  const scene = mixamo();
  const bones = findBones(scene);
  const values = {};
  const names = { hips: "pelvis", leftUpperArm: "left_shoulder", leftLowerArm: "left_elbow" };
  const vrm = {
    scene: scene.children[0],
    humanoid: { autoUpdateHumanBones: true, getRawBoneNode: (name) => bones[names[name]] },
    expressionManager: { setValue: (name, value) => (values[name] = value) },
  };
  const character = new Character(vrm, model);
  assert.equal(vrm.humanoid.autoUpdateHumanBones, false);
  assert.equal(character.isVowels, true);
  const pose = new Pose(model);
  for (let j = 0; j < 55; j++) pose.rotations[4 * j + 3] = 1;
  pose.visemes[model.visemeNames.indexOf("aa")] = 0.75;
  character.apply(pose);
  assert.equal(values.aa, 0.75);
  assert.equal(values.oh, 0);
  assert.equal(values.blinkLeft, 0);
});

test("a character without hips is an error that says so", () => {
  assert.throws(() => new Character(new Node("box"), model), /hips/);
});
