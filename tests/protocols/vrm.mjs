// Loads a .vrm and a .vrma file with @pixiv/three-vrm, as its authors' examples do, plays the one on the other, and compares
// the bones and the face with the .glb file of the same take, which three.js plays beside it.
//
//   node vrm.mjs NODE_MODULES FIGURE.vrm TAKE.vrma TAKE.glb

import { readFile } from "node:fs/promises";
import path from "node:path";
import { pathToFileURL } from "node:url";

const [modules, ...files] = process.argv.slice(2);
const load = (...parts) => import(pathToFileURL(path.resolve(modules, ...parts)));

// What GLTFLoader takes from browsers. Pictures are not looked at: their size is read from the PNG header.
globalThis.self = globalThis;
globalThis.createImageBitmap = async (blob) => {
  const head = Buffer.from(await blob.arrayBuffer());
  if (head.toString("latin1", 1, 4) !== "PNG") throw new Error("not a PNG");
  return { width: head.readUInt32BE(16), height: head.readUInt32BE(20), close() {} };
};

const warnings = [];
for (const kind of ["warn", "error"]) console[kind] = (...words) => warnings.push(words.join(" "));

const THREE = await load("three/build/three.module.js");
const { GLTFLoader } = await load("three/examples/jsm/loaders/GLTFLoader.js");
const VRM = await load("@pixiv/three-vrm/lib/three-vrm.module.js");
const ANIMATION = await load("@pixiv/three-vrm-animation/lib/three-vrm-animation.module.js");

const versions = {};
for (const name of ["three", "@pixiv/three-vrm", "@pixiv/three-vrm-animation"]) {
  versions[name] = JSON.parse(await readFile(path.resolve(modules, name, "package.json"), "utf8")).version;
}
let program;
let failed = false;
function check(name, isOk, finding = "") {
  failed ||= !isOk;
  process.stdout.write(`VRM 1.0\t${program}\t${name}\t${isOk ? "ok" : "FAILED"}\t${finding}\n`);
  if (!isOk) process.stderr.write(`VRM 1.0: ${name}: FAILED: ${finding}\n`);
}
const within = (name, found, most, unit) => check(name, found <= most, `${found.toPrecision(3)}${unit}, at most ${most}${unit}`);

async function open(file) {
  const loader = new GLTFLoader();
  loader.register((parser) => new VRM.VRMLoaderPlugin(parser));
  loader.register((parser) => new ANIMATION.VRMAnimationLoaderPlugin(parser));
  const bytes = await readFile(file);
  return loader.parseAsync(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), "");
}
function quiet(name) {
  check(name, warnings.length === 0, warnings.splice(0).join(" / "));
}

/** Joint of SMPL-X for each bone of VRM's humanoid. */
const JOINTS = {
  hips: "pelvis", spine: "spine1", chest: "spine2", upperChest: "spine3", neck: "neck", head: "head",
};
const FINGERS = { Index: "index", Middle: "middle", Ring: "ring", Little: "pinky", Thumb: "thumb" };
for (const side of ["left", "right"]) {
  const pairs = { Shoulder: "collar", UpperArm: "shoulder", LowerArm: "elbow", Hand: "wrist" };
  Object.assign(pairs, { UpperLeg: "hip", LowerLeg: "knee", Foot: "ankle", Toes: "foot" });
  for (const [finger, joint] of Object.entries(FINGERS)) {
    const parts = finger === "Thumb" ? ["Metacarpal", "Proximal", "Distal"] : ["Proximal", "Intermediate", "Distal"];
    parts.forEach((part, index) => (pairs[finger + part] = `${joint}${index + 1}`));
  }
  for (const [bone, joint] of Object.entries(pairs)) JOINTS[side + bone] = `${side}_${joint}`;
}

program = `@pixiv/three-vrm ${versions["@pixiv/three-vrm"]}, three ${versions.three}`;
const vrm = (await open(files[0])).userData.vrm;
quiet(".vrm loads without a warning");
check("a VRM 1.0 model with a licence", vrm?.meta?.metaVersion === "1" && vrm.meta.licenseUrl.length > 0, vrm?.meta?.licenseUrl);
const required = Object.values(VRM.VRMRequiredHumanBoneName);
const bones = Object.values(VRM.VRMHumanBoneName).filter((name) => vrm.humanoid.getRawBoneNode(name));
check("humanoid: every required bone", required.every((name) => bones.includes(name)), required.length);
check("humanoid: the 52 bones of the body, eyes, no jaw", Object.keys(JOINTS).every((name) => bones.includes(name)), bones.length);
const turned = bones.filter((name) => vrm.humanoid.getRawBoneNode(name).quaternion.angleTo(new THREE.Quaternion()) > 1e-4);
check("T-pose: bones without rotation", turned.length === 0, turned.join(" "));
const armLine = ["leftUpperArm", "leftLowerArm", "leftHand"].map((name) => vrm.humanoid.getRawBoneNode(name).getWorldPosition(new THREE.Vector3()));
const slope = Math.max(...armLine.map(({ y, z }) => Math.hypot(y - armLine[0].y, z - armLine[0].z)));
within("T-pose: the arm along X, off by", slope * 1000, 1, " mm");
const presets = Object.values(VRM.VRMExpressionPresetName).filter((name) => name !== "neutral");
const found = presets.filter((name) => vrm.expressionManager.getExpression(name));
const wanted = ["aa", "ih", "ou", "ee", "oh", "blink", "blinkLeft", "blinkRight", "happy", "angry", "sad", "relaxed", "surprised"];
check("expressions: vowels, blinks, moods", wanted.every((name) => found.includes(name)), found.join(" "));
const custom = Object.keys(vrm.expressionManager.customExpressionMap);
check("expressions of ARKit's names", ["browInnerUp", "cheekPuff", "noseSneerLeft", "jawOpen"].every((name) => custom.includes(name)), custom.length);
check("a gaze", vrm.lookAt?.applier !== undefined);

program = `@pixiv/three-vrm-animation ${versions["@pixiv/three-vrm-animation"]}`;
const [animation] = (await open(files[1])).userData.vrmAnimations ?? [];
quiet(".vrma loads without a warning");
const tracks = animation.humanoidTracks;
check("tracks of 52 bones and the hips' position", tracks.rotation.size === 52 && tracks.translation.size === 1, tracks.rotation.size);
const proxy = new ANIMATION.VRMLookAtQuaternionProxy(vrm.lookAt);
proxy.name = "proxy";
vrm.scene.add(proxy);
const clip = ANIMATION.createVRMAnimationClip(animation, vrm);
quiet("it fits the .vrm file without a warning");
const glb = await open(files[2]);
quiet(".glb loads in three.js without a warning");
check("as long as .glb", Math.abs(clip.duration - glb.animations[0].duration) < 1e-4, `${clip.duration} s`);

const players = [[vrm.scene, clip], [glb.scene, glb.animations[0]]].map(([scene, played]) => {
  const mixer = new THREE.AnimationMixer(scene);
  mixer.clipAction(played).setLoop(THREE.LoopOnce).play();
  mixer.existingAction(played).clampWhenFinished = true;
  return mixer;
});
const face = glb.scene.getObjectByName("face");
const meshes = [];
vrm.scene.traverse((node) => node.morphTargetInfluences && meshes.push(node));
const [here, there] = [new THREE.Vector3(), new THREE.Vector3()];
let lift;
const errors = {};
const moved = {};
let [gaze, blink, lowest, highest, shape] = [0, 0, 1, 0, 0];
const RATE = 30;
const shapeOf = (mesh, name) => mesh.morphTargetInfluences[mesh.morphTargetDictionary[name]];
for (let frame = 0; frame <= Math.floor(clip.duration * RATE + 1e-6); frame += 1) {
  players.forEach((mixer) => mixer.setTime(frame / RATE));
  vrm.update(0);
  vrm.scene.updateMatrixWorld(true);
  glb.scene.updateMatrixWorld(true);
  for (const [bone, joint] of Object.entries(JOINTS)) {
    vrm.humanoid.getRawBoneNode(bone).getWorldPosition(here);
    glb.scene.getObjectByName(joint).getWorldPosition(there);
    // The figure stands on its soles, the .glb file on the joints of its feet: a constant height.
    if (bone === "hips") lift ??= there.clone().sub(here).setX(0).setZ(0);
    errors[bone] = Math.max(errors[bone] ?? 0, here.distanceTo(there.sub(lift)));
    const at = here.clone();
    moved[bone] ??= [at, 0];
    moved[bone][1] = Math.max(moved[bone][1], at.distanceTo(moved[bone][0]));
  }
  // three-vrm turns the eyes of a figure by the look-at's limits, so only the direction of the proxy is compared.
  const eyes = ["left_eye_smplhf", "right_eye_smplhf", "left_eye", "right_eye"].map((name) => glb.scene.getObjectByName(name)).filter(Boolean);
  const middle = eyes[0].quaternion.clone().slerp(eyes[1].quaternion, 0.5);
  gaze = Math.max(gaze, proxy.quaternion.angleTo(middle));
  blink = Math.max(blink, Math.abs(vrm.expressionManager.getValue("blinkLeft") - shapeOf(face, "eyeBlinkLeft")));
  const aa = vrm.expressionManager.getValue("aa");
  [lowest, highest] = [Math.min(lowest, aa), Math.max(highest, aa)];
  shape = Math.max(shape, ...meshes.map((mesh) => Math.max(...mesh.morphTargetInfluences)));
}
const worst = Object.entries(errors).sort(([, a], [, b]) => b - a)[0];
within("height of the .glb file's hips over the figure's", Math.abs(lift.y) * 1000, 5, " mm");
within(`bones where .glb has them, but for that: ${worst[0]}`, worst[1] * 1000, 1, " mm");
const still = Object.keys(moved).filter((bone) => moved[bone][1] < 1e-3 && !/Foot|Toes/.test(bone));
check("every bone above the planted feet moves", still.length === 0, still.join(" "));
within("gaze as the eyes of .glb", (gaze * 180) / Math.PI, 0.1, "°");
within("blinks as in .glb", blink, 0.01, "");
check("the mouth opens and closes", lowest < 0.1 && highest > 0.3, `aa from ${lowest.toFixed(2)} to ${highest.toFixed(2)}`);
check("the meshes follow the expressions", shape > 0.3, shape.toFixed(2));
quiet("it plays without a warning");
process.exit(failed ? 1 : 0);
