// The avatar: a mesh that follows the joints, and a face that follows its channels.

import { attribute, program } from "umo/gl.js";
import { LIGHT, RELIEF, setLight } from "umo/light.js";
import { restPlaces, skin, withHelpers } from "umo/motion.js";

const SKIN = `
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 color;
layout(location = 3) in uvec4 joints;
layout(location = 4) in vec4 weights;
// Three rows per joint, helper joints last.
uniform vec4 bones[JOINTS * 3];
uniform mat4 view;
uniform mat4 light;
void bone(out vec4 x, out vec4 y, out vec4 z) {
  x = y = z = vec4(0.0);
  for (int i = 0; i < 4; i++) {
    int row = 3 * int(joints[i]);
    x += weights[i] * bones[row];
    y += weights[i] * bones[row + 1];
    z += weights[i] * bones[row + 2];
  }
}
`;

const VERTEX = `${SKIN}
layout(location = 5) in float damp;
layout(location = 6) in float roughness;
layout(location = 7) in vec2 spot;
out vec3 place;
out vec3 facing;
out vec3 paint;
out float wet;
out float rough;
out vec2 uv;
out vec4 shade;
void main() {
  vec4 x, y, z;
  bone(x, y, z);
  vec4 p = vec4(position, 1.0);
  place = vec3(dot(x, p), dot(y, p), dot(z, p));
  facing = vec3(dot(x.xyz, normal), dot(y.xyz, normal), dot(z.xyz, normal));
  paint = pow(color.rgb, vec3(2.2));
  wet = damp;
  rough = roughness;
  uv = spot;
  shade = light * vec4(place + 0.006 * normalize(facing), 1.0);
  gl_Position = view * vec4(place, 1.0);
}`;

const DEPTH = `${SKIN}
void main() {
  vec4 x, y, z;
  bone(x, y, z);
  vec4 p = vec4(position, 1.0);
  gl_Position = light * vec4(dot(x, p), dot(y, p), dot(z, p), 1.0);
}`;

const FRAGMENT = `${LIGHT}
${RELIEF}
in vec3 paint;
in float wet;
in float rough;
in vec2 uv;
uniform bool isBumpy;
void main() {
  vec3 n = normalize(facing);
  if (isBumpy) n = bumped(n, uv);
  result = vec4(shown(lit(paint, n, wet, rough)), 1.0);
}`;

/** Decodes the maps of a mesh's reliefs. */
export async function readReliefs(mesh) {
  const decode = ({ map }) => {
    if (map.length === 0) return null;
    const blob = new Blob([map], { type: "image/png" });
    return createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
  };
  const images = await Promise.all(mesh.details.map(decode));
  mesh.details.forEach((detail, i) => (detail.image = images[i]));
}

export class Figure {
  /** `like` is a figure of the same mesh, whose programs and maps it uses. */
  constructor(gl, scene, like) {
    this.gl = gl;
    this.scene = scene;
    this.mesh = scene.mesh;
    const rest = restPlaces(scene);
    this.rest = [...rest, ...scene.mesh.helpers.map(({ of }) => rest[of])];
    this.eyes = ["left_eye", "right_eye"].map((name) => scene.joints.indexOf(name));
    this.morphs = morphsOf(scene);
    this.moving = scene.mesh.moving;
    this.positions = scene.mesh.positions.slice(0, 3 * this.moving);
    this.normals = scene.mesh.normals.slice(0, 3 * this.moving);
    this.bones = new Float32Array(12 * this.rest.length);
    this.shown = "";
    this.upload(like);
  }

  upload(like) {
    const { gl, mesh } = this;
    const sized = (shader) => shader.replace("JOINTS", this.rest.length);
    this.drawing = like?.drawing ?? program(gl, sized(VERTEX), FRAGMENT);
    this.shadowing = like?.shadowing ?? program(gl, sized(DEPTH), "void main() {}");
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    const usage = gl.DYNAMIC_DRAW;
    this.positionBuffer = attribute(gl, 0, mesh.positions, 3, { usage });
    this.normalBuffer = attribute(gl, 1, mesh.normals, 3, { usage });
    attribute(gl, 2, mesh.colors, 4, { normalized: true });
    attribute(gl, 3, mesh.joints, 4, { integer: true });
    attribute(gl, 4, mesh.weights, 4, { normalized: true });
    attribute(gl, 5, this.damp(), 1, { normalized: true });
    attribute(gl, 6, mesh.roughness, 1, { normalized: true });
    attribute(gl, 7, mesh.spots, 2);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    this.reliefs = like?.reliefs ?? mesh.details.map(({ image }) => (image ? this.relief(image) : null));
    this.shown = "";
  }

  /** A repeating relief map; mipmaps fade it out with distance. */
  relief(image) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    return texture;
  }

  /** 255 for every vertex of an eye. */
  damp() {
    const { joints, weights } = this.mesh;
    const isEye = (i) => this.eyes.includes(joints[4 * i]) && weights[4 * i] > 32768;
    return Uint8Array.from({ length: joints.length / 4 }, (_, i) => (isEye(i) ? 255 : 0));
  }

  /** Applies a pose and its joint positions. */
  follow({ pose, placed }) {
    this.setFace(pose.face);
    skin(withHelpers(this.scene, pose, placed), this.rest, this.bones);
  }

  /** Non-zero morph target weights by name. */
  weights(face) {
    const weights = {};
    for (const { name, channel } of this.morphs) if (face[channel]) weights[name] = face[channel];
    return weights;
  }

  /** Applies the face values of a pose. */
  setFace(face) {
    const key = this.morphs.map(({ channel }) => face[channel] ?? 0).join();
    if (key === this.shown) return;
    this.shown = key;
    const { gl, mesh, positions, normals } = this;
    positions.set(mesh.positions.subarray(0, positions.length));
    normals.set(mesh.normals.subarray(0, normals.length));
    for (const { channel, morph } of this.morphs) {
      const weight = face[channel] ?? 0;
      if (weight === 0) continue;
      morph.vertices.forEach((vertex, i) => {
        for (let axis = 0; axis < 3; axis++) {
          positions[3 * vertex + axis] += weight * morph.positions[3 * i + axis];
          normals[3 * vertex + axis] += weight * morph.normals[3 * i + axis];
        }
      });
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, this.positionBuffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, positions);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.normalBuffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, normals);
  }

  drawDepth(light) {
    const { gl, shadowing } = this;
    gl.useProgram(shadowing.made);
    gl.uniformMatrix4fv(shadowing.uniforms.light, false, light);
    gl.uniform4fv(shadowing.uniforms.bones, this.bones);
    this.drawTriangles();
  }

  draw(picture) {
    const { gl, drawing } = this;
    gl.useProgram(drawing.made);
    setLight(gl, drawing.uniforms, picture);
    gl.uniformMatrix4fv(drawing.uniforms.view, false, picture.view);
    gl.uniform4fv(drawing.uniforms.bones, this.bones);
    gl.uniform1i(drawing.uniforms.bump, 1);
    gl.uniform1f(drawing.uniforms.bumps, 1);
    gl.bindVertexArray(this.array);
    let start = 0;
    this.mesh.details.forEach(({ corners, threads }, i) => {
      gl.activeTexture(gl.TEXTURE1);
      gl.bindTexture(gl.TEXTURE_2D, this.reliefs[i]);
      gl.activeTexture(gl.TEXTURE0);
      gl.uniform1i(drawing.uniforms.isBumpy, this.reliefs[i] ? 1 : 0);
      gl.uniform2fv(drawing.uniforms.threads, threads);
      gl.drawElements(gl.TRIANGLES, corners, gl.UNSIGNED_INT, 4 * start);
      start += corners;
    });
    gl.bindVertexArray(null);
  }

  drawTriangles() {
    const { gl, mesh } = this;
    const corners = mesh.details.reduce((sum, detail) => sum + detail.corners, 0);
    gl.bindVertexArray(this.array);
    gl.drawElements(gl.TRIANGLES, corners, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }
}

/** The morph targets named after channels of the motion. */
function morphsOf(scene) {
  const channels = new Map(scene.face.names.map((name, channel) => [name, channel]));
  const known = scene.mesh.morphs.filter(({ name }) => channels.has(name));
  return known.map((morph) => ({ name: morph.name, channel: channels.get(morph.name), morph }));
}
