// The picture: figures or character, floor, shadow and skeleton, redrawn when something has changed.

import { Bones } from "umo/bones.js";
import { Character } from "umo/character.js";
import { Figure } from "umo/figure.js";
import { depthMap } from "umo/gl.js";
import { Ground } from "umo/ground.js";
import { LIGHTING, TO_LAMP, turnedLights } from "umo/light.js";
import { add, lookAt, multiply, orthographic, scale } from "umo/math.js";
import { extentOf } from "umo/room.js";

const SHADOW_SIZE = 1024;
/** Half of the area around an avatar that the lamp's shadow map covers, metres. */
const SHADOW_HALF = 1.45;

export class Picture {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true, powerPreference: "high-performance" });
    if (!this.gl) throw new Error("this browser does not support WebGL 2");
    this.prepare();
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.lost = true;
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.lost = false;
      this.prepare();
    });
  }

  prepare() {
    const { gl, scene } = this;
    this.room = scene.room.length > 0 ? extentOf(scene.room) : null;
    this.figures = [];
    for (const { mesh } of scene.room) {
      const like = this.figures.find((figure) => figure.mesh === mesh);
      this.figures.push(new Figure(gl, { ...scene, mesh }, like));
    }
    if (!this.room) this.figures.push(scene.character ? new Character(gl, scene.character.body) : new Figure(gl, scene));
    this.ground = new Ground(gl, 2 * this.figures.length, this.room?.reach ?? 0);
    this.bones = new Bones(gl, scene);
    this.shadow = depthMap(gl, this.room ? 2 * SHADOW_SIZE : SHADOW_SIZE);
  }

  get figure() {
    return this.figures[0];
  }

  /** Resizes the drawing buffer to the displayed canvas. */
  resize() {
    const { canvas } = this;
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const size = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.max(1, Math.round(x * density)));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    return size;
  }

  /** Draws; `all` are the poses of the members of a room. Returns from where. */
  draw({ pose, placed, all = [{ pose, placed }], feet, camera, floor, theme, skeleton, insets }) {
    if (this.lost) return null;
    const { gl, figures } = this;
    const lighting = LIGHTING[theme];
    const size = this.resize();
    const from = camera.look(size[0] / size[1], insets);
    const { view, eye, axes } = from;
    const { centre: [x, , z], reach } = this.room ?? { centre: placed.places[0], reach: 0 };
    const middle = [x, floor + 0.85, z];
    const lamp = lookAt(add(middle, scale(TO_LAMP, 3.5 + reach)), middle, [0, 1, 0]);
    const light = multiply(orthographic(SHADOW_HALF + reach, 0.1, 7 + 2 * reach), lamp);
    figures.forEach((figure, i) => figure.follow(all[i]));

    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow.frame);
    gl.viewport(0, 0, this.shadow.size, this.shadow.size);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    for (const figure of figures) figure.drawDepth(light);

    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, ...size);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const shadow = this.shadow.texture;
    for (const figure of figures) figure.draw({ view, eye, light, lighting, shadow, turned: turnedLights(axes) });
    this.ground.draw({ view, light, lighting, shadow, middle: [x, floor, z], feet });
    for (const figure of figures) figure.drawClear?.();
    if (skeleton) {
      const width = 1.6 * (size[1] / this.canvas.clientHeight);
      for (const { placed } of all) this.bones.draw({ view, places: placed.places, size, width, color: lighting.bones });
    }
    return from;
  }
}
