// Characters of three.js: glTF files whose bones have the usual names, and VRM (@pixiv/three-vrm). Nothing of three.js is imported:
// the objects of the page's own copy are used.

/** Joints of SMPL-X that are one bone, and what others call it; `{}` is the side. In the order of search. */
const BONES = {
  pelvis: ["hips", "pelvis", "hip"],
  neck: ["neck", "neck01", "neck1"],
  head: ["head"],
  jaw: ["jaw", "jawroot", "lowerjaw"],
};
const SIDED = {
  collar: ["shoulder", "clavicle", "collar"],
  shoulder: ["upperarm", "arm", "shldrbend"],
  elbow: ["lowerarm", "forearm", "forearmbend", "elbow"],
  wrist: ["hand", "wrist"],
  hip: ["upperleg", "upleg", "thigh", "thighbend", "hip"],
  knee: ["lowerleg", "leg", "calf", "shin", "knee"],
  ankle: ["foot", "ankle"],
  foot: ["toes", "toebase", "ball", "toe"],
  eye: ["eye"],
};
const SPINE = [["spine", "spine01", "spine1", "lowerback"], ["chest", "spine02", "spine1", "spine2"], ["upperchest", "spine03", "spine2", "spine3"]];
const FINGERS = { index: ["index"], middle: ["middle", "mid"], ring: ["ring"], pinky: ["pinky", "little"], thumb: ["thumb"] };
const SEGMENTS = ["proximal", "intermediate", "distal"];
/** Joints whose direction at rest is brought to the model's T-pose, and the joint that they point at. */
const POINTED = { shoulder: "elbow", elbow: "wrist", hip: "knee", knee: "ankle" };

/** VRM's expressions and the visemes of the Oculus set that they take the place of. */
const VRM_MOUTH = { aa: ["aa"], ih: ["ih"], ou: ["ou"], ee: ["E"], oh: ["oh"] };

const multiply = ([ax, ay, az, aw], [bx, by, bz, bw]) => [
  aw * bx + ax * bw + ay * bz - az * by,
  aw * by - ax * bz + ay * bw + az * bx,
  aw * bz + ax * by - ay * bx + az * bw,
  aw * bw - ax * bx - ay * by - az * bz,
];
const conjugate = ([x, y, z, w]) => [-x, -y, -z, w];
const rotate = ([x, y, z, w], [a, b, c]) => {
  const t = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * t[0] + y * t[2] - z * t[1], b + w * t[1] + z * t[0] - x * t[2], c + w * t[2] + x * t[1] - y * t[0]];
};
const length = (v) => Math.sqrt(v.reduce((sum, x) => sum + x * x, 0));
const unit = (v) => v.map((x) => x / (length(v) || 1));

/** The shortest rotation from one direction to another. */
function between(a, b) {
  const [p, q] = [unit(a), unit(b)];
  const cosine = p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
  // Opposite directions have no shortest way: a bone that points there is left alone.
  if (cosine < -0.999) return [0, 0, 0, 1];
  return unit([p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0], 1 + cosine]);
}

/** A name without prefixes, separators and case: "mixamorig:LeftArm" is "arm" on the left. */
function key(name) {
  let text = name.replace(/^.*[:|]/, "").replace(/^(mixamorig\d*|cc_base|valvebiped|bip\d*|def|j_(bip|sec|adj)_?[clr]?)[_-]?/i, "");
  const side = /(^|[^a-z])(left)|left|(^|[_.\s-])l([_.\s-]|$)|J_Bip_L/i.test(name) ? "left" : /right|(^|[_.\s-])r([_.\s-]|$)|J_Bip_R/i.test(name) ? "right" : "";
  text = text.replace(/left|right/gi, "").replace(/(^|[_.\s-])[lr](?=[_.\s-]|$)/gi, "");
  return { side, name: text.replace(/[^a-z0-9]/gi, "").toLowerCase() };
}

/** The bones of `root` by SMPL-X's names: `{ head: Object3D, left_elbow: Object3D, … }`. Bones with other names are left out. */
export function findBones(root) {
  const known = new Map();
  root.traverse((node) => {
    const { side, name } = key(node.name ?? "");
    const place = `${side} ${name}`;
    if (node.name && !node.isMesh && !known.has(place)) known.set(place, node);
  });
  const used = new Set();
  const found = {};
  const put = (joint, side, names) => {
    const node = names.map((name) => known.get(`${side} ${name}`)).find((node) => node && !used.has(node));
    if (node) {
      used.add(node);
      found[joint] = node;
    }
  };
  for (const [joint, names] of Object.entries(BONES)) put(joint, "", names);
  SPINE.forEach((names, i) => put(`spine${i + 1}`, "", names));
  for (const side of ["left", "right"]) {
    for (const [joint, names] of Object.entries(SIDED)) put(`${side}_${joint}`, side, names);
    for (const [finger, names] of Object.entries(FINGERS)) {
      SEGMENTS.forEach((segment, i) => {
        const all = names.flatMap((name) => [`${name}${segment}`, `${name}${i + 1}`, `${name}0${i + 1}`, `hand${name}${i + 1}`]);
        if (finger === "thumb" && i === 0) all.unshift("thumbmetacarpal");
        put(`${side}_${finger}${i + 1}`, side, all);
      });
    }
  }
  return found;
}

/** VRM's humanoid bones by SMPL-X's names. */
function vrmBones(vrm) {
  const bone = (name) => vrm.humanoid.getRawBoneNode?.(name) ?? vrm.humanoid.getBoneNode?.(name);
  const found = {};
  const put = (joint, name) => {
    const node = bone(name);
    if (node) found[joint] = node;
  };
  for (const [joint, [name]] of Object.entries(BONES)) put(joint, name);
  ["spine", "chest", "upperChest"].forEach((name, i) => put(`spine${i + 1}`, name));
  const names = { collar: "Shoulder", shoulder: "UpperArm", elbow: "LowerArm", wrist: "Hand", hip: "UpperLeg", knee: "LowerLeg", ankle: "Foot", foot: "Toes", eye: "Eye" };
  const fingers = { index: "Index", middle: "Middle", ring: "Ring", pinky: "Little", thumb: "Thumb" };
  for (const side of ["left", "right"]) {
    for (const [joint, name] of Object.entries(names)) put(`${side}_${joint}`, `${side}${name}`);
    for (const [joint, name] of Object.entries(fingers)) {
      const segments = joint === "thumb" ? ["Metacarpal", "Proximal", "Distal"] : ["Proximal", "Intermediate", "Distal"];
      segments.forEach((segment, i) => put(`${side}_${joint}${i + 1}`, `${side}${name}${segment}`));
    }
  }
  return found;
}

/** Moves a character by poses: `character.apply(avatar.samplePose())` for each picture. */
export class Character {
  #model;
  #joints = [];
  #morphs = [];
  #root;
  #global;

  /**
   * `target` is a glTF's scene or any Object3D, or a VRM of @pixiv/three-vrm; it stands at rest and looks along +Z. `model` is
   * `avatar.model`. `bones` names or adds bones that are not found: `{ left_elbow: Object3D }`. `moves`: the root goes through the scene.
   */
  constructor(target, model, { bones = {}, moves = true } = {}) {
    const isVrm = target.humanoid !== undefined;
    const root = isVrm ? target.scene : target;
    // The humanoid's own rig would overwrite what is set here.
    if (isVrm && "autoUpdateHumanBones" in target.humanoid) target.humanoid.autoUpdateHumanBones = false;
    this.#model = model;
    this.bones = { ...(isVrm ? vrmBones(target) : findBones(root)), ...bones };
    this.expressions = isVrm ? target.expressionManager : undefined;
    /** Joints without a bone, and face channels without a morph target. */
    this.missing = { joints: model.jointNames.filter((name) => !this.bones[name]), channels: [] };
    if (!this.bones.pelvis) throw new Error(`umo: no hips among the bones of ${root.name || "the character"}: pass { bones: { pelvis, … } }`);
    this.#bind(root, moves);
    this.#findMorphs(root);
  }

  #bind(root, moves) {
    const { jointNames, parents, offsets } = this.#model;
    root.updateMatrixWorld?.(true);
    // Rotations and places at rest in the root's frame, from the nodes' own: the scene may be turned.
    const rest = new Map([[root, { rotation: [0, 0, 0, 1], place: [0, 0, 0] }]]);
    const at = (node) => {
      if (rest.has(node)) return rest.get(node);
      const parent = node.parent ? at(node.parent) : rest.get(root);
      const { x, y, z, w } = node.quaternion;
      const local = [node.position.x, node.position.y, node.position.z];
      const moved = rotate(parent.rotation, local);
      const value = { rotation: multiply(parent.rotation, [x, y, z, w]), place: moved.map((v, i) => v + parent.place[i]) };
      rest.set(node, value);
      return value;
    };
    const offset = (name) => [0, 1, 2].map((i) => offsets[3 * jointNames.indexOf(name) + i]);
    const swings = {};
    jointNames.forEach((name, index) => {
      const [, side, joint] = name.match(/^(left|right)_([a-z]+)$/) ?? [];
      const parent = parents[index] >= 0 ? jointNames[parents[index]] : undefined;
      const [bone, next] = [this.bones[name], this.bones[`${side}_${POINTED[joint]}`]];
      if (bone && next) {
        const direction = at(next).place.map((v, i) => v - at(bone).place[i]);
        swings[name] = between(direction, offset(`${side}_${POINTED[joint]}`));
      } else {
        // Hands and fingers turn with the forearm; feet and the trunk stand as they are.
        swings[name] = parent && !["ankle", "foot", "collar", "hip"].includes(joint) ? swings[parent] : [0, 0, 0, 1];
      }
      if (bone) this.#joints.push({ index, bone, rest: multiply(swings[name], at(bone).rotation), frame: undefined });
    });
    const byBone = new Map(this.#joints.map((joint) => [joint.bone, joint]));
    for (const joint of this.#joints) {
      // The nearest bone above that moves, and what lies between at rest.
      let [node, between] = [joint.bone.parent, [0, 0, 0, 1]];
      while (node && node !== root && !byBone.has(node)) {
        const { x, y, z, w } = node.quaternion;
        [between, node] = [multiply([x, y, z, w], between), node.parent];
      }
      [joint.above, joint.between] = [byBone.get(node), between];
    }
    // A bone's parent is set before it.
    const depth = (joint) => (joint.above ? 1 + depth(joint.above) : 0);
    this.#joints.sort((a, b) => depth(a) - depth(b));
    const { pelvis } = this.bones;
    const height = at(pelvis).place[1] - Math.min(...this.#joints.map(({ bone }) => at(bone).place[1]));
    const own = ["hip", "knee", "ankle", "foot"].reduce((sum, joint) => sum - offset(`left_${joint}`)[1], 0);
    this.#root = moves && { rest: pelvis.position.clone(), scale: height > 0 && own > 0 ? height / own : 1, parent: conjugate(pelvis.parent ? at(pelvis.parent).rotation : [0, 0, 0, 1]), first: undefined };
    this.#global = jointNames.map(() => [0, 0, 0, 1]);
  }

  #findMorphs(root) {
    const wanted = new Map(this.#model.channelNames.map((name, index) => [name.toLowerCase(), index]));
    const found = new Set();
    root.traverse((node) => {
      for (const [name, target] of Object.entries(node.morphTargetDictionary ?? {})) {
        const index = wanted.get(name.replace(/^.*\./, "").replace(/_L$/, "Left").replace(/_R$/, "Right").toLowerCase());
        if (index === undefined) continue;
        found.add(index);
        this.#morphs.push({ index, influences: node.morphTargetInfluences, target });
      }
    });
    this.missing.channels = this.#model.channelNames.filter((_, i) => !found.has(i));
    /** A face of few shapes: VRM's five vowels and blinks. */
    this.isVowels = found.size === 0 && this.expressions !== undefined;
  }

  /** Shows a pose of `avatar.samplePose()` or of a session. */
  apply(pose) {
    const { parents, channelNames, visemeNames } = this.#model;
    const global = this.#global;
    for (let j = 0; j < global.length; j++) {
      const own = pose.rotations.subarray(4 * j, 4 * j + 4);
      global[j] = parents[j] < 0 ? [...own] : multiply(global[parents[j]], own);
    }
    for (const joint of this.#joints) {
      joint.frame = multiply(global[joint.index], joint.rest);
      const above = joint.above ? multiply(joint.above.frame, joint.between) : joint.between;
      joint.bone.quaternion.set(...multiply(conjugate(above), joint.frame));
    }
    if (this.#root) {
      const { rest, scale, parent } = this.#root;
      this.#root.first ??= [...pose.translation];
      const [x, y, z] = rotate(parent, [...pose.translation].map((v, i) => (v - this.#root.first[i]) * scale));
      this.bones.pelvis.position.set(rest.x + x, rest.y + y, rest.z + z);
    }
    for (const { index, influences, target } of this.#morphs) influences[target] = pose.face[index];
    if (!this.isVowels) return;
    for (const [expression, visemes] of Object.entries(VRM_MOUTH)) {
      this.expressions.setValue(expression, visemes.reduce((sum, name) => sum + (pose.visemes[visemeNames.indexOf(name)] ?? 0), 0));
    }
    for (const side of ["Left", "Right"]) this.expressions.setValue(`blink${side}`, pose.face[channelNames.indexOf(`eyeBlink${side}`)] ?? 0);
  }
}
