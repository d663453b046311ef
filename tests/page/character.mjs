// A third-party style character made from the figure: bones with Mixamo names, no animation, facing backwards.

const SPINE = { pelvis: "Hips", spine1: "Spine", spine2: "Spine1", spine3: "Spine2", neck: "Neck", head: "Head", jaw: "Jaw" };
const SIDE = { hip: "UpLeg", knee: "Leg", ankle: "Foot", foot: "ToeBase", collar: "Shoulder", shoulder: "Arm", elbow: "ForeArm", wrist: "Hand", eye: "Eye" };

/** Mixamo name of a joint. */
function mixamo(joint) {
  if (SPINE[joint]) return `mixamorig:${SPINE[joint]}`;
  const match = joint.match(/^(left|right)_([a-z]+?)(\d?)$/);
  // The eyes' names do not follow the side pattern.
  const [, side, part, number] = match ?? joint.match(/^(left|right)_(eye)(_smplhf)?$/);
  const named = `${side[0].toUpperCase()}${side.slice(1)}`;
  if (!/^\d$/.test(number ?? "")) return `mixamorig:${named}${SIDE[part]}`;
  return `mixamorig:${named}Hand${part[0].toUpperCase()}${part.slice(1)}${number}`;
}

/** Splits a .glb file into its JSON and the rest. */
function split(bytes) {
  const length = bytes.readUInt32LE(12);
  return { json: JSON.parse(bytes.subarray(20, 20 + length).toString("utf8")), rest: bytes.subarray(20 + length) };
}

function join(json, rest) {
  const text = Buffer.from(JSON.stringify(json), "utf8");
  const padded = Buffer.concat([text, Buffer.alloc((4 - (text.length % 4)) % 4, 0x20)]);
  const head = Buffer.alloc(20);
  head.write("glTF", 0, "latin1");
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(20 + padded.length + rest.length, 8);
  head.writeUInt32LE(padded.length, 12);
  head.write("JSON", 16, "latin1");
  return Buffer.concat([head, padded, rest]);
}

/** Converts a file of `umo animate` to such a character. `joints` are the names of the 55. */
export function stranger(bytes, joints) {
  const { json, rest } = split(bytes);
  for (const node of json.nodes) if (joints.includes(node.name)) node.name = mixamo(node.name);
  delete json.animations;
  const scene = json.scenes[json.scene ?? 0];
  json.nodes.push({ name: "Armature", rotation: [0, 1, 0, 0], children: scene.nodes });
  scene.nodes = [json.nodes.length - 1];
  return join(json, rest);
}

/** The same character with longer shins and shorter thighs, whose feet need to be placed, not just rotated. */
export function longShins(bytes) {
  return changed(bytes, (json) => {
    for (const { name, translation } of json.nodes) {
      if (/(Left|Right)Leg$/.test(name ?? "")) translation[1] *= 0.85;
      if (/(Left|Right)Foot$/.test(name ?? "")) translation[1] *= 1.25;
    }
  });
}

/** The same character with only the shapes in `names`, and otherwise unknown names. */
export function named(bytes, names) {
  return changed(bytes, (json) => {
    for (const { extras } of json.meshes.filter((mesh) => mesh.extras?.targetNames)) extras.targetNames = extras.targetNames.map((_, i) => names[i] ?? `shape ${i}`);
  });
}

/** The same file with its JSON changed. */
export function changed(bytes, change) {
  const { json, rest } = split(bytes);
  change(json);
  return join(json, rest);
}

/** VRM 1.0 names of the joints. */
function vrmName(joint, thumbs = ["Metacarpal", "Proximal", "Distal"]) {
  const middle = { pelvis: "hips", spine1: "spine", spine2: "chest", spine3: "upperChest", neck: "neck", head: "head", jaw: "jaw" };
  if (middle[joint]) return middle[joint];
  const limbs = { hip: "UpperLeg", knee: "LowerLeg", ankle: "Foot", foot: "Toes", collar: "Shoulder", shoulder: "UpperArm", elbow: "LowerArm", wrist: "Hand" };
  const [, side, part, number] = joint.match(/^(left|right)_([a-z]+?)(\d)?(?:_smplhf)?$/);
  if (part === "eye") return `${side}Eye`;
  if (!number) return side + limbs[part];
  const finger = { index: "Index", middle: "Middle", ring: "Ring", pinky: "Little", thumb: "Thumb" }[part];
  return side + finger + (part === "thumb" ? thumbs : ["Proximal", "Intermediate", "Distal"])[number - 1];
}

/** Properties common to all: the figure stands on the floor, below a parent node, without animation. */
function standing(json) {
  delete json.animations;
  const scene = json.scenes[json.scene ?? 0];
  const [height] = heights(json);
  json.nodes.push({ name: "Armature", translation: [0, -height, 0], children: scene.nodes });
  scene.nodes = [json.nodes.length - 1];
}

/** Lowest and highest points of the surface at rest. */
function heights(json) {
  const surfaces = json.meshes.flatMap(({ primitives }) => primitives.map(({ attributes }) => json.accessors[attributes.POSITION]));
  return [Math.min(...surfaces.map(({ min }) => min[1])), Math.max(...surfaces.map(({ max }) => max[1]))];
}

/** The figure with Blender's sides, such as `upperarm.l`, from which three.js removes the dot, and the 15 visemes. */
export function blender(bytes, joints, visemes) {
  const names = { hip: "thigh", knee: "shin", ankle: "foot", foot: "toe", collar: "shoulder", shoulder: "upper_arm", elbow: "forearm", wrist: "hand" };
  return changed(bytes, (json) => {
    standing(json);
    for (const node of json.nodes.filter(({ name }) => joints.includes(name))) {
      const [, side, part, finger, number] = node.name.match(/^(left|right)_(([a-z]+)(\d?).*)$/) ?? [];
      if (side) node.name = `${number ? `${finger === "thumb" ? "" : "f_"}${finger}.0${number}` : (names[part] ?? part)}.${side[0]}`;
      if (node.name.startsWith("spine")) node.name = `spine.00${node.name.slice(5)}`;
    }
    for (const { extras } of json.meshes.filter((mesh) => mesh.extras?.targetNames)) extras.targetNames = extras.targetNames.map((_, i) => visemes[i] ?? `shape ${i}`);
  });
}

/** The figure as VRM 1.0 with unknown node and shape names: bones by its table, a mouth and blinks by its
 * expressions. */
export function vrm1(bytes, joints) {
  return changed(bytes, (json) => {
    standing(json);
    const humanBones = {};
    json.nodes.forEach((node, i) => {
      if (joints.includes(node.name)) humanBones[vrmName(node.name)] = { node: i };
      node.name = `node ${i}`;
    });
    const face = json.nodes.findIndex(({ mesh }) => json.meshes[mesh]?.extras?.targetNames);
    const { extras } = json.meshes[json.nodes[face].mesh];
    const expression = (...names) => ({ morphTargetBinds: names.map((name) => ({ node: face, index: extras.targetNames.indexOf(name), weight: 1 })) });
    const preset = { aa: expression("jawOpen"), ih: expression("mouthStretchLeft"), ou: expression("mouthPucker"), ee: expression("mouthSmileLeft"), oh: expression("mouthFunnel"), blink: expression("eyeBlinkLeft", "eyeBlinkRight") };
    const jaw = extras.targetNames.indexOf("jawOpen");
    extras.targetNames = extras.targetNames.map((_, i) => (i === jaw ? "mouth" : `s${i}`));
    const meta = { name: "figure", version: "1", authors: ["umo"], licenseUrl: "https://vrm.dev/licenses/1.0/" };
    json.extensionsUsed = ["VRMC_vrm"];
    json.extensions = { VRMC_vrm: { specVersion: "1.0", meta, humanoid: { humanBones }, expressions: { preset } } };
  });
}

/** The figure as VRM 0.x, which faces -Z, with ARKit shapes and expressions that share some of them. */
export function vrm0(bytes, joints) {
  const { json, rest } = split(bytes);
  turnRound(json, rest.subarray(8));
  standing(json);
  const humanBones = json.nodes.flatMap(({ name }, node) => (joints.includes(name) ? [{ bone: vrmName(name, ["Proximal", "Intermediate", "Distal"]), node, useDefaultValues: true }] : []));
  const mesh = json.meshes.findIndex(({ extras }) => extras?.targetNames);
  const bind = (name) => ({ mesh, index: json.meshes[mesh].extras.targetNames.indexOf(name), weight: 100 });
  const group = (presetName, ...names) => ({ name: presetName, presetName, binds: names.map(bind), materialValues: [], isBinary: false });
  const blendShapeGroups = [group("a", "jawOpen"), group("blink", "eyeBlinkLeft", "eyeBlinkRight"), group("joy", "mouthSmileLeft", "mouthSmileRight")];
  json.extensionsUsed = ["VRM"];
  json.extensions = {
    VRM: {
      exporterVersion: "umo", specVersion: "0.0", meta: { title: "figure", version: "1", author: "umo", allowedUserName: "Everyone", licenseName: "CC0" },
      humanoid: { humanBones }, blendShapeMaster: { blendShapeGroups }, firstPerson: { firstPersonBone: -1 }, secondaryAnimation: { boneGroups: [], colliderGroups: [] }, materialProperties: [],
    },
  };
  return join(json, rest);
}

/** Rotates by half a turn about up in the data itself: nodes, surfaces, shapes and bind matrices. */
function turnRound(json, bin) {
  for (const { translation } of json.nodes) if (translation) [translation[0], translation[2]] = [-translation[0], -translation[2]];
  const flip = (view, offset, count, width, places) => {
    const { byteOffset = 0, byteStride = 4 * width } = json.bufferViews[view];
    for (let i = 0; i < count; i++) {
      for (const place of places) {
        const at = byteOffset + offset + i * byteStride + 4 * place;
        bin.writeFloatLE(-bin.readFloatLE(at), at);
      }
    }
  };
  const turned = new Set();
  const turn = (index, width, places) => {
    if (index === undefined || turned.has(index)) return;
    turned.add(index);
    const accessor = json.accessors[index];
    const { bufferView, byteOffset = 0, count, sparse, min, max } = accessor;
    if (bufferView !== undefined) flip(bufferView, byteOffset, count, width, places);
    if (sparse) flip(sparse.values.bufferView, sparse.values.byteOffset ?? 0, sparse.count, width, places);
    if (min) for (const place of places) [min[place], max[place]] = [-max[place], -min[place]];
  };
  for (const { primitives } of json.meshes) {
    for (const { attributes, targets = [] } of primitives) {
      for (const one of [attributes, ...targets]) for (const name of ["POSITION", "NORMAL"]) turn(one[name], 3, [0, 2]);
    }
  }
  // The bones have no rest rotation: their matrices only translate.
  for (const { inverseBindMatrices } of json.skins) turn(inverseBindMatrices, 16, [12, 14]);
}
