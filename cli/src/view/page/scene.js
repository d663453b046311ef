// Data that the program embedded in this page: a description in JSON, and numbers in base64.

const TYPES = { f32: Float32Array, u32: Uint32Array, u16: Uint16Array, i16: Int16Array, u8: Uint8Array };

/** Values of a block, or an empty array of that type if the page has no such block. */
export function block(name, type) {
  const text = document.getElementById(`block-${name}`)?.textContent ?? "";
  const packed = atob(text);
  const bytes = new Uint8Array(packed.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = packed.charCodeAt(i);
  return new TYPES[type](bytes.buffer);
}

/** Fills in the arrays of a mesh, whose blocks have names with this end. */
function readMesh(mesh, end) {
  const read = (name, type) => block(name + end, type);
  mesh.positions = read("positions", "f32");
  mesh.normals = read("normals", "f32");
  mesh.colors = read("colors", "u8");
  mesh.roughness = read("roughness", "u8");
  mesh.joints = read("joints", "u8");
  mesh.weights = read("weights", "u16");
  mesh.indices = read("indices", "u32");
  /** Coordinates on a relief map, to the right and down; unused for vertices without relief. */
  mesh.spots = new Float32Array((2 * mesh.positions.length) / 3);
  mesh.spots.set(read("detail-places", "f32"), 2 * mesh.moving);
  for (const detail of mesh.details) detail.map = read(`detail-${detail.name}`, "u8");
  let start = 0;
  const vertices = read("morph-vertices", "u32");
  const moved = read("morph-positions", "f32");
  const turned = read("morph-normals", "f32");
  for (const morph of mesh.morphs) {
    const last = start + morph.count;
    morph.vertices = vertices.subarray(start, last);
    morph.positions = moved.subarray(3 * start, 3 * last);
    morph.normals = turned.subarray(3 * start, 3 * last);
    start = last;
  }
}

/** The description with its arrays. */
export function readScene() {
  const scene = JSON.parse(document.getElementById("scene").textContent);
  const { record, room } = scene;
  scene.meshes = [scene.mesh, ...scene.otherMeshes];
  scene.meshes.forEach((mesh, i) => readMesh(mesh, i === 0 ? "" : `-${i}`));
  room.forEach((member, i) => {
    member.mesh = scene.meshes[member.figure];
    member.frames = block(`frames-${i}`, "f32");
    member.samples = block(`audio-${i}`, "i16");
  });
  scene.people.forEach((person, i) => {
    person.samples = block(`person-${i}`, "i16");
  });
  /** Who is heard from a place. */
  scene.voices = [...room, ...scene.people];
  if (record) {
    record.codes = block("codes", "u16");
    record.routed = block("routed", "u32");
  }
  scene.frames = room.length > 0 ? room[0].frames : block("frames", "f32");
  scene.samples = block("audio", "i16");
  return scene;
}

/** A WAV file of 16-bit samples, for the browser's audio element. */
export function wav(samples, rate) {
  const header = new DataView(new ArrayBuffer(44));
  const text = (at, word) => [...word].forEach((c, i) => header.setUint8(at + i, c.charCodeAt(0)));
  text(0, "RIFF");
  header.setUint32(4, 36 + samples.byteLength, true);
  text(8, "WAVEfmt ");
  header.setUint32(16, 16, true);
  header.setUint16(20, 1, true);
  header.setUint16(22, 1, true);
  header.setUint32(24, rate, true);
  header.setUint32(28, 2 * rate, true);
  header.setUint16(32, 2, true);
  header.setUint16(34, 16, true);
  text(36, "data");
  header.setUint32(40, samples.byteLength, true);
  return new Blob([header, samples], { type: "audio/wav" });
}
