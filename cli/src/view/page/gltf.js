// A glTF file: its accessors, its nodes, and their transforms in its first animation.

import { multiply, slerp } from "umo/math.js";

const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT2: 4, MAT3: 9, MAT4: 16 };
const TYPES = { 5120: Int8Array, 5121: Uint8Array, 5122: Int16Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
/** Value range of normalised integers by component type. */
const LARGEST = new Map([
  [Int8Array, 127],
  [Uint8Array, 255],
  [Int16Array, 32767],
  [Uint16Array, 65535],
]);

const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

export class Gltf {
  /** Reads a .glb file, whose chunks were checked when the page was generated. */
  constructor(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const length = view.getUint32(12, true);
    this.json = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + length)));
    const start = 20 + length + 8;
    this.bin = start < bytes.length ? bytes.subarray(start, start + view.getUint32(start - 8, true)) : new Uint8Array(0);
    this.readNodes();
    this.readAnimation();
  }

  list(name) {
    return this.json[name] ?? [];
  }

  /** Bytes of a buffer view. */
  viewBytes(index) {
    const { buffer, byteOffset = 0, byteLength } = this.json.bufferViews[index];
    if (buffer !== 0) throw new Error("the character's numbers are in another file");
    return this.bin.subarray(byteOffset, byteOffset + byteLength);
  }

  /** Reads `count` values of `width` components from an offset in a buffer view. */
  packed(viewIndex, offset, Type, count, width) {
    const bytes = this.viewBytes(viewIndex);
    const size = width * Type.BYTES_PER_ELEMENT;
    const stride = this.json.bufferViews[viewIndex].byteStride ?? size;
    const out = new Uint8Array(count * size);
    if (stride === size) out.set(bytes.subarray(offset, offset + count * size));
    else for (let i = 0; i < count; i++) out.set(bytes.subarray(offset + i * stride, offset + i * stride + size), i * size);
    return new Type(out.buffer);
  }

  /** Components of an accessor as stored. */
  stored(index) {
    const { bufferView, byteOffset = 0, componentType, count, type, sparse } = this.json.accessors[index];
    const [Type, width] = [TYPES[componentType], WIDTHS[type]];
    const values = bufferView === undefined ? new Type(count * width) : this.packed(bufferView, byteOffset, Type, count, width);
    if (sparse) {
      const { indices, values: replaced } = sparse;
      const at = this.packed(indices.bufferView, indices.byteOffset ?? 0, TYPES[indices.componentType], sparse.count, 1);
      const by = this.packed(replaced.bufferView, replaced.byteOffset ?? 0, Type, sparse.count, width);
      at.forEach((place, i) => values.set(by.subarray(i * width, (i + 1) * width), place * width));
    }
    return values;
  }

  /** Components of an accessor as floats, and the number of components per value. */
  floats(index) {
    const { normalized, type } = this.json.accessors[index];
    const stored = this.stored(index);
    const width = WIDTHS[type];
    if (stored instanceof Float32Array) return { values: stored, width };
    const largest = normalized ? LARGEST.get(stored.constructor) : 1;
    return { values: Float32Array.from(stored, (x) => Math.max(x / largest, -1)), width };
  }

  readNodes() {
    const nodes = this.list("nodes");
    this.parents = nodes.map(() => -1);
    nodes.forEach(({ children = [] }, parent) => children.forEach((child) => (this.parents[child] = parent)));
    this.rest = nodes.map(({ matrix, translation = [0, 0, 0], rotation = [0, 0, 0, 1], scale = [1, 1, 1] }) => ({
      matrix,
      translation,
      rotation,
      scale,
    }));
    const scene = this.list("scenes")[this.json.scene ?? 0];
    const roots = scene?.nodes ?? nodes.map((_, i) => i).filter((i) => this.parents[i] < 0);
    /** Nodes of the scene, parents first. */
    this.order = [];
    const waiting = [...roots];
    const seen = new Set();
    while (waiting.length > 0) {
      const node = waiting.shift();
      if (seen.has(node)) continue;
      seen.add(node);
      this.order.push(node);
      waiting.push(...(nodes[node].children ?? []));
    }
    /** Transform of the root nodes' parent. */
    this.base = IDENTITY;
  }

  readAnimation() {
    const animation = this.list("animations")[0];
    this.channels = [];
    this.seconds = 0;
    for (const { sampler, target } of animation?.channels ?? []) {
      if (target.node === undefined || !["translation", "rotation", "scale", "weights"].includes(target.path)) continue;
      const { input, output, interpolation = "LINEAR" } = animation.samplers[sampler];
      const times = this.floats(input).values;
      const { values } = this.floats(output);
      // Splines have a tangent on each side of a value.
      const parts = interpolation === "CUBICSPLINE" ? 3 : 1;
      const width = values.length / times.length / parts;
      this.channels.push({ node: target.node, path: target.path, times, values, width, interpolation });
      this.seconds = Math.max(this.seconds, times.at(-1));
    }
  }

  /** The nodes at a time: local values, world matrices, and shape weights. `others` replace the animation's values
   * of some channels. */
  at(seconds, others = new Map()) {
    const own = this.rest.map((rest) => ({ ...rest }));
    const weights = new Map();
    for (const channel of this.channels) {
      const value = others.get(channel) ?? sample(channel, seconds);
      if (channel.path === "weights") weights.set(channel.node, value);
      else own[channel.node][channel.path] = value;
    }
    return { own, world: this.world(own), weights };
  }

  world(own) {
    const world = new Array(own.length).fill(IDENTITY);
    for (const node of this.order) {
      const parent = this.parents[node];
      world[node] = multiply(parent < 0 ? this.base : world[parent], own[node].matrix ?? matrix(own[node]));
    }
    return world;
  }
}

/** Matrix from translation, rotation and scale, applied in reverse order. */
export function matrix({ translation: [a, b, c], rotation: [x, y, z, w], scale: [s, t, u] }) {
  return [
    s * (1 - 2 * (y * y + z * z)), s * 2 * (x * y + w * z), s * 2 * (x * z - w * y), 0,
    t * 2 * (x * y - w * z), t * (1 - 2 * (x * x + z * z)), t * 2 * (y * z + w * x), 0,
    u * 2 * (x * z + w * y), u * 2 * (y * z - w * x), u * (1 - 2 * (x * x + y * y)), 0,
    a, b, c, 1,
  ];
}

/** Number of times that are not after `seconds`. */
function passed(times, seconds) {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= seconds) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Value of a channel at a time. */
export function sample({ path, times, values, width, interpolation }, seconds) {
  const spline = interpolation === "CUBICSPLINE";
  const part = (key, which) => {
    const at = (spline ? 3 * key + which : key) * width;
    return Array.from(values.subarray(at, at + width));
  };
  const after = passed(times, seconds);
  if (after === 0) return part(0, 1);
  const from = after - 1;
  if (after === times.length || interpolation === "STEP") return part(from, 1);
  const length = times[after] - times[from];
  const t = (seconds - times[from]) / length;
  if (spline) {
    const [p, m, q, n] = [part(from, 1), part(from, 2), part(after, 1), part(after, 0)];
    const [tt, ttt] = [t * t, t * t * t];
    const value = p.map((_, i) => (2 * ttt - 3 * tt + 1) * p[i] + length * (ttt - 2 * tt + t) * m[i] + (3 * tt - 2 * ttt) * q[i] + length * (ttt - tt) * n[i]);
    const long = path === "rotation" ? Math.hypot(...value) || 1 : 1;
    return value.map((x) => x / long);
  }
  const [a, b] = [part(from), part(after)];
  return path === "rotation" ? slerp(a, b, t) : a.map((x, i) => x + (b[i] - x) * t);
}
