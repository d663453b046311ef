// The picture: figure, floor, shadow and skeleton, drawn when something has changed.

import { Bones } from "umo/bones.js";
import { Figure } from "umo/figure.js";
import { depthMap } from "umo/gl.js";
import { Ground } from "umo/ground.js";
import { add, lookAt, multiply, normalize, orthographic, scale } from "umo/math.js";
import { restPlaces, skin } from "umo/motion.js";

const TO_LAMP = normalize([0.5, 0.85, 0.62]);
const SHADOW_SIZE = 1024;
/** Half of what the lamp's shadow covers, metres. */
const SHADOW_HALF = 1.45;

const LIGHTING = {
  dark: {
    toLamp: TO_LAMP,
    sky: [0.36, 0.41, 0.49],
    floor: [0.15, 0.13, 0.12],
    lamp: 0.92,
    ground: [0.125, 0.14, 0.165],
    grid: [0.21, 0.235, 0.27],
    darkness: 0.6,
    bones: [0.97, 0.77, 0.42],
  },
  light: {
    toLamp: TO_LAMP,
    sky: [0.55, 0.57, 0.6],
    floor: [0.33, 0.3, 0.27],
    lamp: 0.78,
    ground: [0.905, 0.89, 0.865],
    grid: [0.8, 0.78, 0.75],
    darkness: 0.34,
    bones: [0.72, 0.36, 0.05],
  },
};

export class Picture {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.rest = restPlaces(scene);
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true, powerPreference: "high-performance" });
    if (!this.gl) throw new Error("this browser draws no WebGL 2");
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
    this.figure = new Figure(gl, scene);
    this.ground = new Ground(gl);
    this.bones = new Bones(gl, scene);
    this.shadow = depthMap(gl, SHADOW_SIZE);
  }

  /** Fits the drawing to the canvas as it is shown. */
  resize() {
    const { canvas } = this;
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const size = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.max(1, Math.round(x * density)));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    return size;
  }

  draw({ pose, placed, camera, floor, theme, skeleton }) {
    if (this.lost) return;
    const { gl, figure } = this;
    const lighting = LIGHTING[theme];
    const size = this.resize();
    const { view, eye } = camera.look(size[0] / size[1]);
    const root = placed.places[0];
    const middle = [root[0], floor + 0.85, root[2]];
    const light = multiply(orthographic(SHADOW_HALF, 0.1, 7), lookAt(add(middle, scale(TO_LAMP, 3.5)), middle, [0, 1, 0]));
    figure.setFace(pose.face);
    skin(placed, this.rest, figure.bones);

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
    figure.draw({ view, eye, light, lighting, shadow });
    this.ground.draw({ view, light, lighting, shadow, middle: [root[0], floor, root[2]] });
    if (skeleton) {
      const width = 1.6 * (size[1] / this.canvas.clientHeight);
      this.bones.draw({ view, places: placed.places, size, width, color: lighting.bones });
    }
  }
}
