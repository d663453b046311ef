// A character as somebody else would bring it, made of the figure: bones with Mixamo's names, no animation, and its back to us.

const SPINE = { pelvis: "Hips", spine1: "Spine", spine2: "Spine1", spine3: "Spine2", neck: "Neck", head: "Head", jaw: "Jaw" };
const SIDE = { hip: "UpLeg", knee: "Leg", ankle: "Foot", foot: "ToeBase", collar: "Shoulder", shoulder: "Arm", elbow: "ForeArm", wrist: "Hand", eye: "Eye" };

/** What Mixamo calls a joint. */
function mixamo(joint) {
  if (SPINE[joint]) return `mixamorig:${SPINE[joint]}`;
  const match = joint.match(/^(left|right)_([a-z]+?)(\d?)$/);
  // The eyes have a name that is not a side's.
  const [, side, part, number] = match ?? joint.match(/^(left|right)_(eye)(_smplhf)?$/);
  const named = `${side[0].toUpperCase()}${side.slice(1)}`;
  if (!/^\d$/.test(number ?? "")) return `mixamorig:${named}${SIDE[part]}`;
  return `mixamorig:${named}Hand${part[0].toUpperCase()}${part.slice(1)}${number}`;
}

/** A .glb file's JSON and the rest of it. */
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

/** The file that `umo animate` wrote, as such a character. `joints` are the names of the 55. */
export function stranger(bytes, joints) {
  const { json, rest } = split(bytes);
  for (const node of json.nodes) if (joints.includes(node.name)) node.name = mixamo(node.name);
  delete json.animations;
  const scene = json.scenes[json.scene ?? 0];
  json.nodes.push({ name: "Armature", rotation: [0, 1, 0, 0], children: scene.nodes });
  scene.nodes = [json.nodes.length - 1];
  return join(json, rest);
}

/** The same character with longer shins and shorter thighs, whose feet belong elsewhere than its bones' rotations put them. */
export function longShins(bytes) {
  return changed(bytes, (json) => {
    for (const { name, translation } of json.nodes) {
      if (/(Left|Right)Leg$/.test(name ?? "")) translation[1] *= 0.85;
      if (/(Left|Right)Foot$/.test(name ?? "")) translation[1] *= 1.25;
    }
  });
}

/** The same character with shapes of other names: those of `names`, and none that anybody knows. */
export function named(bytes, names) {
  return changed(bytes, (json) => {
    for (const { extras } of json.meshes.filter((mesh) => mesh.extras?.targetNames)) extras.targetNames = extras.targetNames.map((_, i) => names[i] ?? `shape ${i}`);
  });
}

/** The same file with something of its JSON changed. */
export function changed(bytes, change) {
  const { json, rest } = split(bytes);
  change(json);
  return join(json, rest);
}
