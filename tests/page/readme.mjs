// The ten lines of bindings/web/README.md, verbatim, with three.js characters: THREE names the folder of its packages.

import assert from "node:assert/strict";
import fs from "node:fs";
import path from "node:path";
import { gzipSync } from "node:zlib";

import { blender, vrm0, vrm1 } from "./character.mjs";
import { until } from "./chromium.mjs";
import { serve } from "./folder.mjs";
import { read } from "./frames.mjs";

const ROOT = path.join(import.meta.dirname, "../..");
const MODEL = path.join(ROOT, "models/umo-people/model.safetensors");
const VISEMES = ["sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "ih", "oh", "ou"].map((name) => `viseme_${name}`);
const IMPORTS = {
  three: "./packages/three/build/three.module.js",
  "three/addons/": "./packages/three/examples/jsm/",
  "@pixiv/three-vrm": "./packages/@pixiv/three-vrm/lib/three-vrm.module.min.js",
  "@pixiv/three-vrm-animation": "./packages/@pixiv/three-vrm-animation/lib/three-vrm-animation.module.min.js",
  "umo-web": "./umo/src/index.js",
  "umo-web/three": "./umo/src/three.js",
};
/** Mouth shapes to check. */
const CHARACTERS = { "blender.glb": VISEMES.slice(1), "one.vrm": ["mouth"], "zero.vrm": ["jawOpen"], "zero.vrm?turned": ["jawOpen"] };
let server;

/** The first code block of the README. */
function lines() {
  const text = fs.readFileSync(path.join(ROOT, "bindings/web/README.md"), "utf8");
  return text.match(/```js\n([^]*?)```/)[1];
}

/** A page with the objects that the lines assume: a character, a scene, a camera and a renderer. */
const page = (code) => `<!doctype html>
<link rel="icon" href="data:,">
<body style="margin:0"><script type="importmap">${JSON.stringify({ imports: IMPORTS })}</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { VRMLoaderPlugin, VRMUtils } from "@pixiv/three-vrm";
const [file, isTurned] = location.hash.slice(1).split("?");
const loader = new GLTFLoader();
loader.register((parser) => new VRMLoaderPlugin(parser));
const gltf = await loader.loadAsync(file);
const { vrm } = gltf.userData;
if (isTurned) VRMUtils.rotateVRM0(vrm);
const scene = new THREE.Scene();
scene.add(gltf.scene, new THREE.HemisphereLight(0xffffff, 0x665544, 3), new THREE.GridHelper(4, 8));
const camera = new THREE.PerspectiveCamera(30, 0.75, 0.1, 20);
camera.position.set(0, 1.1, gltf.userData.vrmMeta?.metaVersion === "0" && !isTurned ? -4 : 4);
camera.lookAt(0, 0.9, 0);
const drawing = new THREE.WebGLRenderer({ antialias: false });
drawing.setSize(240, 320);
document.body.append(drawing.domElement);
const placeOf = (node) => { gltf.scene.updateMatrixWorld(true); return node.getWorldPosition(new THREE.Vector3()); };
const seen = (window.seen = { drawn: 0, hips: [], soles: [], mouth: 0 });
const renderer = {
  setAnimationLoop: (call) => drawing.setAnimationLoop(call),
  render(...what) {
    vrm?.update(1 / 60);
    drawing.render(...what);
    seen.drawn += 1;
    window.look?.();
  },
};
${code}
const at = (joint) => placeOf(character.bones[joint][0]);
window.test = { THREE, gltf, avatar, character, at, file, Follower: (await import("umo-web")).Follower };
window.look = () => {
  seen.hips.push(at("pelvis").y);
  seen.soles.push(Math.min(...["left_ankle", "right_ankle", "left_foot", "right_foot"].map((joint) => at(joint).y)));
  gltf.scene.traverse(({ morphTargetDictionary: names, morphTargetInfluences: weights }) => {
    for (const name of window.shapes ?? []) if (names?.[name] !== undefined) seen.mouth = Math.max(seen.mouth, weights[names[name]]);
  });
};
window.isReady = true;
</script>`;

export async function prepare({ run, at, short }) {
  const folder = at("readme");
  fs.rmSync(folder, { recursive: true, force: true });
  fs.mkdirSync(folder);
  fs.symlinkSync(path.join(ROOT, "bindings/web"), path.join(folder, "umo"));
  fs.symlinkSync(path.resolve(process.env.THREE), path.join(folder, "packages"));
  fs.writeFileSync(path.join(folder, "index.html"), page(lines()));
  fs.writeFileSync(path.join(folder, "umo-people.safetensors.gz"), gzipSync(fs.readFileSync(MODEL), { level: 1 }));
  run("animate", short, "-o", at("readme.glb"), "-o", at("readme.jsonl"));
  const { header } = read(at("readme.jsonl"));
  const figure = () => fs.readFileSync(at("readme.glb"));
  fs.writeFileSync(path.join(folder, "blender.glb"), blender(figure(), header.joints, VISEMES));
  fs.writeFileSync(path.join(folder, "one.vrm"), vrm1(figure(), header.joints));
  fs.writeFileSync(path.join(folder, "zero.vrm"), vrm0(figure(), header.joints));
  server = await serve(folder);
}

export function end() {
  server.close();
}

/** A VRM with a umo animation in three-vrm's usual loop: distance of the left hand from its T-pose position, metres. */
const looped = (page, options) => page.value(`(async ({ file, clip, update }) => {
  const three = await import("three");
  const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
  const { VRMLoaderPlugin } = await import("@pixiv/three-vrm");
  const { VRMAnimationLoaderPlugin, createVRMAnimationClip } = await import("@pixiv/three-vrm-animation");
  const loader = new GLTFLoader();
  loader.register((parser) => new VRMLoaderPlugin(parser));
  loader.register((parser) => new VRMAnimationLoaderPlugin(parser));
  const { scene, userData: { vrm }, animations } = await loader.loadAsync(file);
  if (update !== undefined) vrm.humanoid.autoUpdateHumanBones = update;
  const hand = vrm.humanoid.getRawBoneNode("leftHand");
  const place = () => (scene.updateMatrixWorld(true), hand.getWorldPosition(new three.Vector3()));
  const rest = place();
  const animation = clip ? createVRMAnimationClip((await loader.loadAsync(clip)).userData.vrmAnimations[0], vrm) : animations[0];
  const mixer = new three.AnimationMixer(scene);
  mixer.clipAction(animation).play();
  for (let i = 0; i < 30; i++) {
    mixer.update(1 / 30);
    vrm.update(1 / 30);
  }
  return place().distanceTo(rest);
})(${JSON.stringify(options)})`);

async function loops({ browser, run, at }) {
  const folder = at("readme");
  for (const name of ["one", "zero"]) run("retarget", at("readme.jsonl"), "--onto", path.join(folder, `${name}.vrm`), "-o", path.join(folder, `moved-${name}.vrm`));
  run("animate", at("short.wav"), "-o", path.join(folder, "motion.vrma"));
  const page = await browser.open(`${server.address}#one.vrm`, { width: 240, height: 320 });
  await until(() => page.value("window.isReady === true").catch(() => false), 120, "the page");
  for (const name of ["one", "zero"]) {
    assert.ok((await looped(page, { file: `moved-${name}.vrm` })) < 0.01, "three-vrm overwrites what moves a VRM's own nodes: the note of `umo retarget` is needed");
    assert.ok((await looped(page, { file: `moved-${name}.vrm`, update: false })) > 0.2, `moved-${name}.vrm moves where it may`);
    assert.ok((await looped(page, { file: `${name}.vrm`, clip: "motion.vrma" })) > 0.2, `motion.vrma moves ${name}.vrm`);
  }
  await page.close();
}

/** Current joint positions, and the node rotations beside those computed from the character's file alone. */
const MEASURE = `(async () => {
  const { gltf, avatar, character, at, file, Follower } = test;
  const bytes = new Uint8Array(await (await fetch(file)).arrayBuffer());
  // No awaits from here on: the page's own loop would show another pose.
  const pose = avatar.pose;
  character.apply(pose);
  const places = Object.fromEntries(["pelvis", "head", "left_shoulder", "left_wrist", "right_shoulder", "right_wrist"].map((joint) => [joint, at(joint).toArray()]));
  const follower = new Follower(bytes, avatar.model);
  const values = follower.values(pose).slice();
  const { driven, hips } = follower.description;
  const nodes = new Map();
  gltf.scene.traverse((node) => { const found = gltf.parser.associations.get(node)?.nodes; if (found !== undefined && !nodes.has(found)) nodes.set(found, node); });
  let apart = 0;
  driven.forEach((node, i) => nodes.get(node).quaternion.toArray().forEach((x, k) => (apart = Math.max(apart, Math.abs(x - values[4 * i + k])))));
  nodes.get(hips).position.toArray().forEach((x, k) => (apart = Math.max(apart, Math.abs(x - values[4 * driven.length + k]))));
  return { places, apart, missing: character.missing.joints, driven: driven.length };
})()`;

async function speaks({ browser, at }, name) {
  const page = await browser.open(`${server.address}#${name}`, { width: 240, height: 320 });
  await until(() => page.value("window.isReady === true").catch(() => false), 120, "the model and the character");
  await page.value(`(window.shapes = ${JSON.stringify(CHARACTERS[name])}, true)`);
  await until(() => page.value("seen.drawn > 30 && seen.mouth > 0.1 && test.avatar.pose.index > 45"), 120, "frames of the microphone");
  const { places, apart, missing, driven } = await page.value(MEASURE);
  const { hips, soles } = await page.value("seen");
  await page.picture(at(`readme-${name.replace(/\W/g, "-")}.png`));
  // The figure's hips are at about 0.95 m, its ankles at 0.1 m, its soles at 0.
  assert.ok(Math.min(...hips) > 0.85 && Math.max(...hips) < 1.05, `hips at ${Math.min(...hips)} to ${Math.max(...hips)} m`);
  assert.ok(Math.min(...soles) > 0.005 && Math.max(...soles) < 0.1, `feet at ${Math.min(...soles)} to ${Math.max(...soles)} m`);
  for (const side of ["left", "right"]) {
    const [shoulder, wrist] = [places[`${side}_shoulder`], places[`${side}_wrist`]];
    // In a T-pose the hand is at shoulder height and far out; a gesture may lift it.
    assert.ok(wrist[1] < places.head[1], `the ${side} hand is below the head: ${wrist}`);
    assert.ok(Math.hypot(wrist[0] - shoulder[0], wrist[2] - shoulder[2]) < 0.45, `the ${side} arm is not stretched out: ${wrist}, ${shoulder}`);
    const out = Math.sign(shoulder[0] - places.pelvis[0]);
    assert.ok(out * (wrist[0] - places.pelvis[0]) > -0.2, `the ${side} hand is on its side: ${wrist}`);
  }
  assert.ok(apart < 1e-4, `the bones are where the file alone puts them: ${apart}`);
  assert.ok(driven > 40 && missing.length < 4, `${driven} bones; none for ${missing}`);
  assert.deepEqual(page.errors, []);
  await page.close();
}

export const tests = [
  ...Object.keys(CHARACTERS).map((name) => [`${name} stands, speaks and lets its arms hang`, (context) => speaks(context, name)]),
  ["three-vrm's loop shows a .vrma, and the .vrm of `umo retarget` as its note says", loops],
];
