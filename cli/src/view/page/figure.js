// The avatar: a mesh that follows the joints, with a face that follows its channels.

import { attribute, program } from "umo/gl.js";

const SKIN = `
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 color;
layout(location = 3) in uvec4 joints;
layout(location = 4) in vec4 weights;
// Three rows for each joint.
uniform vec4 bones[165];
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
out vec3 place;
out vec3 facing;
out vec3 paint;
out vec4 shade;
void main() {
  vec4 x, y, z;
  bone(x, y, z);
  vec4 p = vec4(position, 1.0);
  place = vec3(dot(x, p), dot(y, p), dot(z, p));
  facing = vec3(dot(x.xyz, normal), dot(y.xyz, normal), dot(z.xyz, normal));
  paint = pow(color.rgb, vec3(2.2));
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

/** Sky and floor light, one lamp with a shadow, a rim from behind. */
const FRAGMENT = `
in vec3 place;
in vec3 facing;
in vec3 paint;
in vec4 shade;
uniform vec3 eye;
uniform vec3 toLamp;
uniform vec3 sky;
uniform vec3 floorLight;
uniform float lamp;
uniform mediump sampler2DShadow shadow;
out vec4 result;
float lit() {
  vec3 at = 0.5 * shade.xyz / shade.w + 0.5;
  vec2 texel = 1.3 / vec2(textureSize(shadow, 0));
  float sum = 0.0;
  for (int i = 0; i < 4; i++) {
    vec2 corner = vec2(float(i & 1), float(i >> 1)) - 0.5;
    sum += texture(shadow, vec3(at.xy + corner * texel, at.z - 0.0016));
  }
  return 0.25 * sum;
}
void main() {
  vec3 n = normalize(facing);
  vec3 v = normalize(eye - place);
  float up = 0.5 + 0.5 * n.y;
  float towards = dot(n, toLamp);
  // Light bleeds a little around the edge of the lit side, as it does in skin and wool.
  float key = clamp((towards + 0.25) / 1.25, 0.0, 1.0);
  key *= mix(1.0, lit(), smoothstep(-0.1, 0.25, towards));
  float gloss = pow(max(dot(n, normalize(toLamp + v)), 0.0), 36.0) * 0.05 * step(0.0, towards);
  float rim = pow(1.0 - max(dot(n, v), 0.0), 3.0) * (0.35 + 0.65 * up);
  vec3 color = paint * (mix(floorLight, sky, up) + lamp * vec3(1.0, 0.96, 0.9) * key);
  color += vec3(gloss) * lamp + 0.16 * rim * sky;
  color = color / (1.0 + 0.18 * color);
  result = vec4(pow(color, vec3(1.0 / 2.2)), 1.0);
}`;

export class Figure {
  constructor(gl, scene) {
    this.gl = gl;
    this.mesh = scene.mesh;
    this.morphs = morphsOf(scene);
    this.moving = scene.mesh.moving;
    this.positions = scene.mesh.positions.slice(0, 3 * this.moving);
    this.normals = scene.mesh.normals.slice(0, 3 * this.moving);
    this.bones = new Float32Array(165 * 4);
    this.shown = "";
    this.upload();
  }

  upload() {
    const { gl, mesh } = this;
    this.drawing = program(gl, VERTEX, FRAGMENT);
    this.shadowing = program(gl, DEPTH, "void main() {}");
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    const usage = gl.DYNAMIC_DRAW;
    this.positionBuffer = attribute(gl, 0, mesh.positions, 3, { usage });
    this.normalBuffer = attribute(gl, 1, mesh.normals, 3, { usage });
    attribute(gl, 2, mesh.colors, 4, { normalized: true });
    attribute(gl, 3, mesh.joints, 4, { integer: true });
    attribute(gl, 4, mesh.weights, 4, { normalized: true });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    this.shown = "";
  }

  /** The weight of every morph target that is not 0, by name. */
  weights(face) {
    const weights = {};
    for (const { name, channel } of this.morphs) if (face[channel]) weights[name] = face[channel];
    return weights;
  }

  /** Takes over the face values of a pose. */
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

  draw({ view, eye, light, lighting, shadow }) {
    const { gl, drawing } = this;
    const u = drawing.uniforms;
    gl.useProgram(drawing.made);
    gl.uniformMatrix4fv(u.view, false, view);
    gl.uniformMatrix4fv(u.light, false, light);
    gl.uniform4fv(u.bones, this.bones);
    gl.uniform3fv(u.eye, eye);
    gl.uniform3fv(u.toLamp, lighting.toLamp);
    gl.uniform3fv(u.sky, lighting.sky);
    gl.uniform3fv(u.floorLight, lighting.floor);
    gl.uniform1f(u.lamp, lighting.lamp);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, shadow);
    gl.uniform1i(u.shadow, 0);
    this.drawTriangles();
  }

  drawTriangles() {
    const { gl } = this;
    gl.bindVertexArray(this.array);
    gl.drawElements(gl.TRIANGLES, this.mesh.indices.length, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }
}

/** The morph targets whose names are channels of the motion. */
function morphsOf(scene) {
  const channels = new Map(scene.face.names.map((name, channel) => [name, channel]));
  const known = scene.mesh.morphs.filter(({ name }) => channels.has(name));
  return known.map((morph) => ({ name: morph.name, channel: channels.get(morph.name), morph }));
}
