// The floor: a disc that fades away, with the avatar's soft shadow.

import { attribute, program } from "umo/gl.js";

const VERTEX = `
layout(location = 0) in vec2 corner;
uniform mat4 view;
uniform mat4 light;
uniform vec3 middle;
out vec2 spot;
out vec2 world;
out vec4 shade;
void main() {
  spot = corner;
  vec4 place = vec4(middle + 3.2 * vec3(corner.x, 0.0, corner.y), 1.0);
  world = place.xz;
  shade = light * place;
  gl_Position = view * place;
}`;

const FRAGMENT = `
in vec2 spot;
in vec2 world;
in vec4 shade;
uniform vec3 tint;
uniform vec3 line;
uniform float darkness;
uniform mediump sampler2DShadow shadow;
out vec4 result;
const int TAPS = 20;
void main() {
  vec3 at = 0.5 * shade.xyz / shade.w + 0.5;
  float turn = 6.28 * fract(52.98 * fract(dot(gl_FragCoord.xy, vec2(0.0671, 0.00584))));
  float lit = 0.0;
  // A spiral of samples, turned from pixel to pixel.
  for (int i = 0; i < TAPS; i++) {
    float r = sqrt((float(i) + 0.5) / float(TAPS)) * 0.014;
    float a = turn + 2.399963 * float(i);
    lit += texture(shadow, vec3(at.xy + r * vec2(cos(a), sin(a)), at.z - 0.001));
  }
  lit /= float(TAPS);
  vec2 cell = abs(fract(2.0 * world - 0.5) - 0.5) / max(fwidth(2.0 * world), vec2(1e-5));
  float grid = 1.0 - clamp(min(cell.x, cell.y), 0.0, 1.0);
  float fade = 1.0 - smoothstep(0.25, 1.0, length(spot));
  vec3 color = mix(tint, line, 0.35 * grid);
  color *= 1.0 - darkness * (1.0 - lit);
  result = vec4(color, 1.0) * fade;
}`;

export class Ground {
  constructor(gl) {
    this.gl = gl;
    this.drawing = program(gl, VERTEX, FRAGMENT);
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    attribute(gl, 0, new Float32Array([-1, -1, -1, 1, 1, -1, 1, 1]), 2);
    gl.bindVertexArray(null);
  }

  draw({ view, light, lighting, shadow, middle }) {
    const { gl, drawing } = this;
    const u = drawing.uniforms;
    gl.useProgram(drawing.made);
    gl.uniformMatrix4fv(u.view, false, view);
    gl.uniformMatrix4fv(u.light, false, light);
    gl.uniform3fv(u.middle, middle);
    gl.uniform3fv(u.tint, lighting.ground);
    gl.uniform3fv(u.line, lighting.grid);
    gl.uniform1f(u.darkness, lighting.darkness);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, shadow);
    gl.uniform1i(u.shadow, 0);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.disable(gl.CULL_FACE);
    gl.bindVertexArray(this.array);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.bindVertexArray(null);
    gl.disable(gl.BLEND);
  }
}
