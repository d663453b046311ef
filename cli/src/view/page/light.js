// Lighting: a lamp with a shadow, a fill and a rim light that move with the camera, sky and floor; and the shading of
// surfaces.

import { normalize } from "umo/math.js";

/** Direction from the avatar to the lamp. */
export const TO_LAMP = normalize([0.74, 0.82, 0.56]);

export const LIGHTING = {
  dark: {
    sky: [0.2, 0.23, 0.29],
    floor: [0.13, 0.115, 0.105],
    lamp: [1.28, 1.18, 1.04],
    fill: [0.13, 0.17, 0.24],
    rim: [0.75, 0.88, 1.1],
    ground: [0.2, 0.225, 0.26],
    darkness: 0.5,
    contact: 0.78,
    bones: [0.97, 0.77, 0.42],
  },
  light: {
    sky: [0.38, 0.4, 0.43],
    floor: [0.26, 0.24, 0.22],
    lamp: [1.02, 0.95, 0.86],
    fill: [0.16, 0.17, 0.19],
    rim: [0.26, 0.27, 0.28],
    ground: [0.905, 0.885, 0.85],
    darkness: 0.3,
    contact: 0.5,
    bones: [0.72, 0.36, 0.05],
  },
};

/** Vertex outputs for lighting: `place` and `facing` in world space, `shade` in the lamp's shadow map. */
export const LIGHT = `
in vec3 place;
in vec3 facing;
in vec4 shade;
uniform vec3 eye;
uniform vec3 toLamp;
uniform vec3 toFill;
uniform vec3 toRim;
uniform vec3 toCatch;
uniform vec3 sky;
uniform vec3 floorLight;
uniform vec3 lamp;
uniform vec3 fill;
uniform vec3 rim;
uniform mediump sampler2DShadow shadow;
out vec4 result;
float open() {
  vec3 at = 0.5 * shade.xyz / shade.w + 0.5;
  vec2 texel = 2.0 / vec2(textureSize(shadow, 0));
  float sum = 0.0;
  for (int i = 0; i < 4; i++) {
    vec2 corner = vec2(float(i & 1), float(i >> 1)) - 0.5;
    sum += texture(shadow, vec3(at.xy + corner * texel, at.z - 0.0016));
  }
  return 0.25 * sum;
}
/** Shades a surface of colour \`paint\` and normal \`n\`; \`wet\` is 1 for an eye, \`rough\` for chalk. */
vec3 lit(vec3 paint, vec3 n, float wet, float rough) {
  vec3 v = normalize(eye - place);
  float up = 0.5 + 0.5 * n.y;
  float towards = dot(n, toLamp);
  // Light bleeds around the terminator, red furthest, as in skin and wool.
  vec3 bleed = vec3(0.36, 0.26, 0.22);
  vec3 key = clamp((towards + bleed) / (1.0 + bleed), 0.0, 1.0);
  float clear = mix(1.0, open(), smoothstep(-0.1, 0.25, towards));
  key *= clear;
  float side = max(0.25 + 0.75 * dot(n, toFill), 0.0);
  vec3 color = paint * (mix(floorLight, sky, up) + lamp * key + fill * side);
  float edge = pow(1.0 - max(dot(n, v), 0.0), 3.0);
  color += rim * edge * smoothstep(-0.2, 0.9, dot(n, toRim)) * (0.08 + 0.92 * paint);
  float smoothness = (1.0 - rough) * (1.0 - rough);
  float gloss = pow(max(dot(n, normalize(toLamp + v)), 0.0), mix(14.0, 150.0, smoothness));
  gloss *= mix(0.015, 0.42, smoothness) * smoothstep(0.0, 0.25, towards) * clear;
  color += lamp * gloss;
  // Catch light of the eye: fixed relative to the camera, wherever the eye looks.
  float window = smoothstep(0.962, 0.982, dot(reflect(-v, n), toCatch));
  color += wet * (1.2 * window + 0.1 * edge);
  return color / (1.0 + 0.2 * color);
}
/** Tone mapping. */
vec3 shown(vec3 color) {
  return pow(color, vec3(1.0 / 2.2));
}
`;

/**
 * Normal mapping, `bumps` times as steep as the map. Orientation follows from `place`. `threads` is the number of
 * threads across the map, to the right and down, 0 if unknown: threads narrower than three pixels would cause moiré, so
 * they fade out before.
 */
export const RELIEF = `
uniform float bumps;
uniform vec2 threads;
uniform sampler2D bump;
/** Normal from the map at \`uv\` in place of the surface's own. */
vec3 bumped(vec3 n, vec2 uv) {
  vec3 dx = dFdx(place), dy = dFdy(place);
  vec2 ux = dFdx(uv), uy = dFdy(uv);
  vec3 t = dx * uy.y - dy * ux.y;
  vec3 b = dy * ux.x - dx * uy.x;
  float size = max(dot(t, t), dot(b, b));
  if (size <= 0.0) return n;
  vec3 sampled = 2.0 * texture(bump, uv).xyz - 1.0;
  float crowd = max(length(ux * threads), length(uy * threads));
  sampled.xy *= 1.0 - smoothstep(0.2, 0.4, crowd);
  float side = sign(ux.x * uy.y - ux.y * uy.x);
  return normalize(inversesqrt(size) * side * bumps * (sampled.x * t - sampled.y * b) + sampled.z * n);
}
`;

/** Sets the lighting uniforms of a program. */
export function setLight(gl, u, { eye, light, lighting, turned, shadow }) {
  gl.uniformMatrix4fv(u.light, false, light);
  gl.uniform3fv(u.eye, eye);
  gl.uniform3fv(u.toLamp, TO_LAMP);
  for (const [name, direction] of Object.entries(turned)) gl.uniform3fv(u[name], direction);
  gl.uniform3fv(u.sky, lighting.sky);
  gl.uniform3fv(u.floorLight, lighting.floor);
  for (const name of ["lamp", "fill", "rim"]) gl.uniform3fv(u[name], lighting[name]);
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, shadow);
  gl.uniform1i(u.shadow, 0);
}

/** Lights that move with the camera, given its axes. */
export function turnedLights({ right, up, back }) {
  const from = (x, y, z) => normalize([0, 1, 2].map((i) => x * right[i] + y * up[i] + z * back[i]));
  return { toFill: from(-0.8, 0.15, 0.6), toRim: from(-0.55, 0.45, -0.7), toCatch: from(0.25, 0.29, 0.92) };
}
