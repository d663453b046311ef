// The floor: a pool of light that fades out, with soft shadows, and contact shadows under the feet.

import { attribute, program } from "umo/gl.js";

const VERTEX = `
layout(location = 0) in vec2 corner;
uniform mat4 view;
uniform mat4 light;
uniform vec3 middle;
uniform float size;
out vec2 spot;
out vec2 world;
out vec4 shade;
void main() {
  spot = corner;
  vec4 place = vec4(middle + size * vec3(corner.x, 0.0, corner.y), 1.0);
  world = place.xz;
  shade = light * place;
  gl_Position = view * place;
}`;

const FRAGMENT = `
in vec2 spot;
in vec2 world;
in vec4 shade;
uniform vec3 tint;
uniform float darkness;
uniform float contact;
// Heel, ball and height of each foot.
uniform vec2 heels[FEET];
uniform vec2 balls[FEET];
uniform float heights[FEET];
uniform mediump sampler2DShadow shadow;
out vec4 result;
const int TAPS = 20;
float noise() {
  return fract(52.98 * fract(dot(gl_FragCoord.xy, vec2(0.0671, 0.00584))));
}
/** Ambient occlusion under a foot. */
float under(vec2 heel, vec2 ball, float height) {
  vec2 along = ball - heel;
  float t = clamp(dot(world - heel, along) / max(dot(along, along), 1e-6), 0.0, 1.0);
  float r = 0.062 + 0.5 * height;
  float d = distance(world, heel + t * along) / r;
  return exp(-d * d) * exp(-9.0 * height);
}
void main() {
  vec3 at = 0.5 * shade.xyz / shade.w + 0.5;
  float turn = 6.28 * noise();
  float lit = 0.0;
  // A spiral of samples, rotated per pixel.
  for (int i = 0; i < TAPS; i++) {
    float r = sqrt((float(i) + 0.5) / float(TAPS)) * 0.02;
    float a = turn + 2.399963 * float(i);
    lit += texture(shadow, vec3(at.xy + r * vec2(cos(a), sin(a)), at.z - 0.001));
  }
  lit /= float(TAPS);
  float far = length(spot);
  float fade = exp(-5.0 * far * far) * (1.0 - smoothstep(0.6, 1.0, far));
  float open = 1.0;
  for (int i = 0; i < FEET; i++) open *= 1.0 - under(heels[i], balls[i], heights[i]);
  vec3 color = tint * (1.0 - darkness * (1.0 - lit)) * (1.0 - contact * (1.0 - open));
  // Dithering: neighbouring greys would show as rings.
  color += (noise() - 0.5) / 255.0;
  result = vec4(color, 1.0) * fade;
}`;

/** Half of the pool's width around a single avatar, metres. */
const SIZE = 3.2;

export class Ground {
  /** For a number of feet, and a distance that they may be away from the middle. */
  constructor(gl, feet, reach) {
    this.gl = gl;
    this.size = SIZE + reach;
    this.drawing = program(gl, VERTEX, FRAGMENT.replaceAll("FEET", feet));
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    attribute(gl, 0, new Float32Array([-1, -1, -1, 1, 1, -1, 1, 1]), 2);
    gl.bindVertexArray(null);
  }

  draw({ view, light, lighting, shadow, middle, feet }) {
    const { gl, drawing } = this;
    const u = drawing.uniforms;
    gl.useProgram(drawing.made);
    gl.uniformMatrix4fv(u.view, false, view);
    gl.uniformMatrix4fv(u.light, false, light);
    gl.uniform3fv(u.middle, middle);
    gl.uniform1f(u.size, this.size);
    gl.uniform3fv(u.tint, lighting.ground);
    gl.uniform1f(u.darkness, lighting.darkness);
    gl.uniform1f(u.contact, lighting.contact);
    gl.uniform2fv(u.heels, feet.flatMap(({ heel }) => heel));
    gl.uniform2fv(u.balls, feet.flatMap(({ ball }) => ball));
    gl.uniform1fv(u.heights, feet.map(({ height }) => height));
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
