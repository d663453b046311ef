// The skeleton drawn over the figure: a line from each joint to its parent, a dot on each joint.

import { attribute, program } from "umo/gl.js";

const LINE = `
layout(location = 0) in vec2 corner;
layout(location = 1) in vec3 from;
layout(location = 2) in vec3 to;
uniform mat4 view;
uniform vec2 size;
uniform float width;
void main() {
  vec4 a = view * vec4(from, 1.0);
  vec4 b = view * vec4(to, 1.0);
  vec2 along = normalize((b.xy / b.w - a.xy / a.w) * size + vec2(1e-6, 0.0));
  vec4 end = mix(a, b, corner.x);
  vec2 side = vec2(-along.y, along.x) * corner.y * width / size;
  gl_Position = end + vec4(side * end.w, 0.0, 0.0);
}`;

const DOT = `
layout(location = 1) in vec3 place;
uniform mat4 view;
uniform float width;
void main() {
  gl_Position = view * vec4(place, 1.0);
  gl_PointSize = 3.2 * width;
}`;

const PLAIN = `
uniform vec4 color;
out vec4 result;
void main() { result = color; }`;

const ROUND = `
uniform vec4 color;
out vec4 result;
void main() {
  float r = 2.0 * length(gl_PointCoord - 0.5);
  result = color * (1.0 - smoothstep(0.75, 1.0, r));
}`;

export class Bones {
  constructor(gl, scene) {
    this.gl = gl;
    this.pairs = scene.parents.map((parent, joint) => [parent, joint]).filter(([parent]) => parent >= 0);
    this.lines = program(gl, LINE, PLAIN);
    this.dots = program(gl, DOT, ROUND);
    this.ends = new Float32Array(6 * this.pairs.length);
    this.points = new Float32Array(3 * scene.parents.length);
    this.lineArray = gl.createVertexArray();
    gl.bindVertexArray(this.lineArray);
    attribute(gl, 0, new Float32Array([0, -1, 1, -1, 0, 1, 1, 1]), 2);
    this.endBuffer = attribute(gl, 1, this.ends, 3, { usage: gl.DYNAMIC_DRAW, divisor: 1 });
    gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 24, 0);
    gl.enableVertexAttribArray(2);
    gl.vertexAttribPointer(2, 3, gl.FLOAT, false, 24, 12);
    gl.vertexAttribDivisor(2, 1);
    this.dotArray = gl.createVertexArray();
    gl.bindVertexArray(this.dotArray);
    this.pointBuffer = attribute(gl, 1, this.points, 3, { usage: gl.DYNAMIC_DRAW });
    gl.bindVertexArray(null);
  }

  draw({ view, places, size, width, color }) {
    const { gl } = this;
    this.pairs.forEach(([parent, joint], i) => this.ends.set([...places[parent], ...places[joint]], 6 * i));
    places.forEach((place, i) => this.points.set(place, 3 * i));
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    const paint = [...color.map((c) => c * 0.9), 0.9];
    for (const [drawing, array, buffer, values, kind] of [
      [this.lines, this.lineArray, this.endBuffer, this.ends, "lines"],
      [this.dots, this.dotArray, this.pointBuffer, this.points, "dots"],
    ]) {
      gl.useProgram(drawing.made);
      gl.uniformMatrix4fv(drawing.uniforms.view, false, view);
      gl.uniform1f(drawing.uniforms.width, width);
      gl.uniform4fv(drawing.uniforms.color, paint);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
      gl.bindVertexArray(array);
      if (kind === "lines") {
        gl.uniform2fv(drawing.uniforms.size, size);
        gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.pairs.length);
      } else {
        gl.drawArrays(gl.POINTS, 0, places.length);
      }
    }
    gl.bindVertexArray(null);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
  }
}
