// The picture: figure or character, floor, shadow and skeleton, redrawn when something has changed.

import { Bones } from "umo/bones.js";
import { Character } from "umo/character.js";
import { Figure } from "umo/figure.js";
import { depthMap } from "umo/gl.js";
import { Ground } from "umo/ground.js";
import { LIGHTING, TO_LAMP, turnedLights } from "umo/light.js";
import { add, lookAt, multiply, orthographic, scale } from "umo/math.js";

const SHADOW_SIZE = 1024;
/** Half of the area covered by the lamp's shadow map, metres. */
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
    this.figure = scene.character ? new Character(gl, scene.character.body) : new Figure(gl, scene);
    this.ground = new Ground(gl);
    this.bones = new Bones(gl, scene);
    this.shadow = depthMap(gl, SHADOW_SIZE);
  }

  /** Resizes the drawing buffer to the displayed canvas. */
  resize() {
    const { canvas } = this;
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const size = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.max(1, Math.round(x * density)));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    return size;
  }

  draw({ pose, placed, feet, camera, floor, theme, skeleton, insets }) {
    if (this.lost) return;
    const { gl, figure } = this;
    const lighting = LIGHTING[theme];
    const size = this.resize();
    const { view, eye, axes } = camera.look(size[0] / size[1], insets);
    const root = placed.places[0];
    const middle = [root[0], floor + 0.85, root[2]];
    const light = multiply(orthographic(SHADOW_HALF, 0.1, 7), lookAt(add(middle, scale(TO_LAMP, 3.5)), middle, [0, 1, 0]));
    figure.follow({ pose, placed });

    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow.frame);
    gl.viewport(0, 0, SHADOW_SIZE, SHADOW_SIZE);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    figure.drawDepth(light);

    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, ...size);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const shadow = this.shadow.texture;
    figure.draw({ view, eye, light, lighting, shadow, turned: turnedLights(axes) });
    this.ground.draw({ view, light, lighting, shadow, middle: [root[0], floor, root[2]], feet });
    figure.drawClear?.();
    if (skeleton) {
      const width = 1.6 * (size[1] / this.canvas.clientHeight);
      this.bones.draw({ view, places: placed.places, size, width, color: lighting.bones });
    }
  }
}
