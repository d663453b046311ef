// Draws a custom character: its surfaces with bones, shapes, colours and textures.

import { shapeNames } from "umo/body.js";
import { attribute, program } from "umo/gl.js";
import { LIGHT, RELIEF, setLight } from "umo/light.js";

const SKIN = `
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 color;
layout(location = 3) in uvec4 joints;
layout(location = 4) in vec4 weights;
layout(location = 5) in float damp;
layout(location = 6) in vec2 spot;
layout(location = 7) in vec2 bumpSpot;
// Three rows of the matrix per joint, one texture row per joint.
uniform highp sampler2D bones;
uniform mat4 view;
uniform mat4 light;
uniform mat3 across;
uniform mat3 acrossBump;
vec4 bone(int row) {
  vec4 sum = vec4(0.0);
  for (int i = 0; i < 4; i++) sum += weights[i] * texelFetch(bones, ivec2(row, int(joints[i])), 0);
  return sum;
}
`;

const VERTEX = `${SKIN}
out vec3 place;
out vec3 facing;
out vec4 paint;
out vec2 uv;
out vec2 bumpUv;
out float wet;
out vec4 shade;
void main() {
  vec4 x = bone(0), y = bone(1), z = bone(2);
  vec4 p = vec4(position, 1.0);
  place = vec3(dot(x, p), dot(y, p), dot(z, p));
  facing = vec3(dot(x.xyz, normal), dot(y.xyz, normal), dot(z.xyz, normal));
  paint = color;
  uv = (across * vec3(spot, 1.0)).xy;
  bumpUv = (acrossBump * vec3(bumpSpot, 1.0)).xy;
  wet = damp;
  shade = light * vec4(place + 0.006 * normalize(facing), 1.0);
  gl_Position = view * vec4(place, 1.0);
}`;

const DEPTH = `${SKIN}
void main() {
  vec4 p = vec4(position, 1.0);
  gl_Position = light * vec4(dot(bone(0), p), dot(bone(1), p), dot(bone(2), p), 1.0);
}`;

const FRAGMENT = `${LIGHT}
${RELIEF}
in vec4 paint;
in vec2 uv;
in vec2 bumpUv;
in float wet;
uniform vec4 base;
uniform vec3 glow;
uniform bool isMapped;
uniform bool isBumpy;
uniform bool isPlain;
uniform float cutoff;
uniform float roughness;
uniform bool isFinished;
uniform sampler2D map;
uniform sampler2D finish;
void main() {
  vec4 color = base * paint;
  if (isMapped) color *= texture(map, uv);
  if (color.a < cutoff) discard;
  vec3 n = normalize(facing) * (gl_FrontFacing ? 1.0 : -1.0);
  if (isBumpy) n = bumped(n, bumpUv);
  float rough = isFinished ? roughness * texture(finish, uv).g : roughness;
  vec3 light = lit(color.rgb, n, wet, rough);
  // Unlit materials still get some shading, as they stand beside a shadow.
  if (isPlain) light = mix(color.rgb, light, 0.35);
  float alpha = cutoff >= 0.0 ? 1.0 : color.a;
  result = vec4(shown(light + glow) * alpha, alpha);
}`;

/** Alpha modes of materials. */
const [SOLID, CUT, CLEAR] = ["OPAQUE", "MASK", "BLEND"];

/** Decodes the images of a file and passes them to its body. */
export async function readTextures(body) {
  const { gltf } = body;
  const decode = async ({ bufferView, mimeType }) => {
    if (bufferView === undefined) return null;
    const blob = new Blob([gltf.viewBytes(bufferView)], { type: mimeType });
    // An image that the browser cannot decode leaves the plain colour.
    return createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" }).catch(() => null);
  };
  body.images = await Promise.all(gltf.list("images").map(decode));
}

export class Character {
  constructor(gl, body) {
    this.gl = gl;
    this.body = body;
    this.drawing = program(gl, VERTEX, FRAGMENT);
    this.shadowing = program(gl, DEPTH, "void main() {}");
    this.textures = new Map();
    this.surfaces = body.parts.map((part) => this.upload(part));
    this.blank = this.texture(null, false);
  }

  upload(part) {
    const { gl, body } = this;
    const material = part.material;
    const surface = { part, shown: "", array: gl.createVertexArray(), bones: gl.createTexture() };
    gl.bindVertexArray(surface.array);
    surface.positionBuffer = attribute(gl, 0, part.positions, 3, { usage: gl.DYNAMIC_DRAW });
    surface.normalBuffer = attribute(gl, 1, part.normals, 3, { usage: gl.DYNAMIC_DRAW });
    attribute(gl, 2, part.colors, 4);
    attribute(gl, 3, part.joints, 4, { integer: true });
    attribute(gl, 4, part.weights, 4);
    attribute(gl, 5, damp(part, body), 1, { normalized: true });
    const {
      baseColorTexture: map,
      baseColorFactor: base = [1, 1, 1, 1],
      metallicRoughnessTexture: finish,
      roughnessFactor: roughness = 1,
    } = material.pbrMetallicRoughness ?? {};
    const transformed = map?.extensions?.KHR_texture_transform;
    const { normalTexture: bump } = material;
    const bumpTransformed = bump?.extensions?.KHR_texture_transform;
    // Texture coordinates, from the set that the texture names.
    const spots = (texture, moved) => part.uv[moved?.texCoord ?? texture?.texCoord ?? 0] ?? new Float32Array(2 * part.count);
    attribute(gl, 6, spots(map, transformed), 2);
    attribute(gl, 7, spots(bump, bumpTransformed), 2);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, part.triangles, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    gl.bindTexture(gl.TEXTURE_2D, surface.bones);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, 3, part.bones.length);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
    surface.rows = new Float32Array(12 * part.bones.length);
    const mode = material.alphaMode ?? SOLID;
    return Object.assign(surface, {
      base,
      mode,
      across: across(transformed),
      acrossBump: across(bumpTransformed),
      map: map ? this.texture(map.index, true) : null,
      bump: bump ? this.texture(bump.index, false) : null,
      finish: finish ? this.texture(finish.index, false) : null,
      roughness,
      bumps: bump?.scale ?? 1,
      glow: material.emissiveTexture ? [0, 0, 0] : (material.emissiveFactor ?? [0, 0, 0]),
      isPlain: Boolean(material.extensions?.KHR_materials_unlit),
      isDouble: Boolean(material.doubleSided),
      cutoff: mode === CUT ? (material.alphaCutoff ?? 0.5) : mode === SOLID ? 0 : -1,
    });
  }

  /** A texture of the file, created once; white if there is no image. */
  texture(index, isColor) {
    const { gl, body } = this;
    const key = `${index} ${isColor}`;
    if (this.textures.has(key)) return this.textures.get(key);
    const { source, sampler, extensions } = index === null ? {} : body.gltf.list("textures")[index];
    const image = body.images?.[source ?? extensions?.EXT_texture_webp?.source] ?? null;
    if (index !== null && image === null) return null;
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    const format = isColor ? gl.SRGB8_ALPHA8 : gl.RGBA8;
    if (image) gl.texImage2D(gl.TEXTURE_2D, 0, format, gl.RGBA, gl.UNSIGNED_BYTE, image);
    else gl.texImage2D(gl.TEXTURE_2D, 0, format, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([255, 255, 255, 255]));
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    const { wrapS = gl.REPEAT, wrapT = gl.REPEAT } = body.gltf.list("samplers")[sampler] ?? {};
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, wrapS);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, wrapT);
    this.textures.set(key, made);
    return made;
  }

  /** Applies a pose: bones and shapes. */
  follow({ placed }) {
    const { gl } = this;
    this.placed = placed;
    for (const surface of this.surfaces) {
      surface.part.matrices(placed.world).forEach((m, joint) => {
        for (let row = 0; row < 3; row++) surface.rows.set([m[row], m[4 + row], m[8 + row], m[12 + row]], 12 * joint + 4 * row);
      });
      gl.bindTexture(gl.TEXTURE_2D, surface.bones);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 3, surface.part.bones.length, gl.RGBA, gl.FLOAT, surface.rows);
      if (surface.part.shapes.length > 0) this.setShapes(surface, this.shapeWeights(surface.part));
    }
  }

  /** Weights of a surface's shapes: the animation's, or those at rest. */
  shapeWeights({ node, shapes }) {
    const { gltf } = this.body;
    const { mesh, weights } = gltf.list("nodes")[node];
    return this.placed.weights.get(node) ?? weights ?? gltf.list("meshes")[mesh].weights ?? shapes.map(() => 0);
  }

  setShapes(surface, weights) {
    const key = weights.join();
    if (key === surface.shown) return;
    surface.shown = key;
    const { gl } = this;
    const { part } = surface;
    const positions = part.positions.slice();
    const normals = part.normals.slice();
    part.shapes.forEach((shape, i) => {
      const weight = weights[i] ?? 0;
      if (weight === 0) return;
      shape.vertices.forEach((vertex, at) => {
        for (let axis = 0; axis < 3; axis++) {
          positions[3 * vertex + axis] += weight * shape.positions[3 * at + axis];
          if (shape.normals) normals[3 * vertex + axis] += weight * shape.normals[3 * at + axis];
        }
      });
    });
    gl.bindBuffer(gl.ARRAY_BUFFER, surface.positionBuffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, positions);
    gl.bindBuffer(gl.ARRAY_BUFFER, surface.normalBuffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, normals);
  }

  /** Non-zero shape weights by name. */
  weights() {
    const found = {};
    for (const part of this.body.parts.filter(({ shapes }) => shapes.length > 0)) {
      const weights = this.shapeWeights(part);
      shapeNames(this.body.gltf, part.node, weights.length).forEach((name, i) => {
        if (weights[i]) found[name] = weights[i];
      });
    }
    return found;
  }

  drawDepth(light) {
    const { gl, shadowing } = this;
    gl.useProgram(shadowing.made);
    gl.uniformMatrix4fv(shadowing.uniforms.light, false, light);
    gl.disable(gl.CULL_FACE);
    for (const surface of this.surfaces) if (surface.mode !== CLEAR) this.drawTriangles(surface, shadowing.uniforms);
  }

  draw(picture) {
    this.picture = picture;
    this.drawAll((surface) => surface.mode !== CLEAR);
  }

  /** Draws transparent surfaces over opaque ones. */
  drawClear() {
    const { gl } = this;
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    this.drawAll((surface) => surface.mode === CLEAR);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  drawAll(which) {
    const { gl, drawing, picture } = this;
    const u = drawing.uniforms;
    gl.useProgram(drawing.made);
    setLight(gl, u, picture);
    gl.uniformMatrix4fv(u.view, false, picture.view);
    for (const surface of this.surfaces.filter(which)) {
      gl.uniform4fv(u.base, surface.base);
      gl.uniform3fv(u.glow, surface.glow);
      gl.uniformMatrix3fv(u.across, false, surface.across);
      gl.uniformMatrix3fv(u.acrossBump, false, surface.acrossBump);
      gl.uniform1i(u.isMapped, surface.map ? 1 : 0);
      gl.uniform1i(u.isBumpy, surface.bump ? 1 : 0);
      gl.uniform1i(u.isPlain, surface.isPlain ? 1 : 0);
      gl.uniform1f(u.cutoff, surface.cutoff);
      gl.uniform1f(u.bumps, surface.bumps);
      gl.uniform1f(u.roughness, surface.roughness);
      gl.uniform1i(u.isFinished, surface.finish ? 1 : 0);
      this.bind(2, surface.map ?? this.blank, u.map);
      this.bind(3, surface.bump ?? this.blank, u.bump);
      this.bind(4, surface.finish ?? this.blank, u.finish);
      if (surface.isDouble) gl.disable(gl.CULL_FACE);
      else gl.enable(gl.CULL_FACE);
      this.drawTriangles(surface, u);
    }
    gl.enable(gl.CULL_FACE);
  }

  bind(unit, texture, place) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform1i(place, unit);
    gl.activeTexture(gl.TEXTURE0);
  }

  drawTriangles(surface, uniforms) {
    const { gl } = this;
    this.bind(1, surface.bones, uniforms.bones);
    gl.bindVertexArray(surface.array);
    gl.drawElements(gl.TRIANGLES, surface.part.triangles.length, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }
}

/** 255 for every vertex that an eye bone moves. */
function damp({ joints, weights, bones, count }, body) {
  const eyes = ["left_eye", "right_eye"].map((name) => body.nodes[body.joint(name)]).filter((node) => node !== null);
  const isEye = (i) => eyes.includes(bones[joints[4 * i]]) && weights[4 * i] > 0.5;
  return Uint8Array.from({ length: count }, (_, i) => (isEye(i) ? 255 : 0));
}

/** Texture coordinate transform as a matrix. */
function across({ offset: [x, y] = [0, 0], scale: [s, t] = [1, 1], rotation = 0 } = {}) {
  const [cos, sin] = [Math.cos(rotation), Math.sin(rotation)];
  return [s * cos, -s * sin, 0, t * sin, t * cos, 0, x, y, 1];
}
