// The camera: presets that follow a part of the body, and orbits around it.

import { add, clamp, lookAt, mix, multiply, perspective, scale, subtract, transform } from "umo/math.js";

const FOV = (26 * Math.PI) / 180;
/** Rate at which the camera approaches its target and follows the body, per second. */
const EASE = 6;
const FOLLOW = 2.5;
/** Minimum share of the picture that stays free of overlaid buttons. */
const LEAST_FREE = 0.4;
/** Distance by which members of a room leave their places, metres. */
const STEP = 0.3;
/** Share of a member's direction from which the camera sees it. */
const ASIDE = 0.5;

/** Target of each preset, and half of the width and height that it must show, metres. */
function presets(body) {
  const { height, crown } = body;
  const [head, left, right] = ["head", "left_wrist", "right_wrist"].map((name) => body.joint(name));
  const above = (share) => (places, ground) => [places[0][0], ground + share * height, places[0][2]];
  const { centre, reach, depth } = body.room ?? { centre: null, reach: 0, depth: 0 };
  // Who stands nearer, or steps ahead, is seen larger.
  const nearer = (depth + STEP) * Math.tan(FOV / 2);
  return {
    all: { at: (_, ground) => [centre[0], ground + 0.5 * height, centre[2]], half: [reach + 0.3 * height, 0.55 * height + nearer], yaw: 0, pitch: 0.08 },
    face: { at: (places) => add(places[head], [0, 0.34 * crown, 0.2 * crown]), half: [0.72 * crown, 0.88 * crown], yaw: 0.2, pitch: 0.02 },
    half: { at: above(0.74), half: [0.2 * height, 0.282 * height], yaw: 0.22, pitch: 0.03 },
    whole: { at: above(0.5), half: [0.3 * height, 0.55 * height], yaw: 0.3, pitch: 0.08 },
    hands: {
      at: (places) => scale(add(places[left], places[right]), 0.5),
      half: [0.28 * height, 0.24 * height],
      yaw: 0.12,
      pitch: 0.16,
    },
  };
}

export class Camera {
  constructor(body, still) {
    this.body = body;
    this.presets = presets(body);
    this.still = still;
    this.use("half");
    this.now = { ...this.goal };
    this.target = null;
  }

  /** Switches to another body from the next frame on. */
  show(body) {
    this.body = body;
    this.presets = presets(body);
    this.target = null;
  }

  use(name) {
    this.name = name;
    const { yaw: from, pitch, half } = this.presets[name];
    // A member of a room from the side to which the room is open: others may stand before it.
    const yaw = from + (name === "all" ? 0 : ASIDE * (this.body.facing ?? 0));
    this.goal = { yaw, pitch, zoom: 1, x: 0, y: 0, wide: half[0], high: half[1] };
  }

  orbit(dx, dy) {
    this.goal.yaw -= dx;
    this.goal.pitch = clamp(this.goal.pitch + dy, -1.2, 1.45);
  }

  zoom(factor) {
    this.goal.zoom = clamp(this.goal.zoom * factor, 0.15, 4);
  }

  /** Moves the picture by shares of its height. */
  pan(dx, dy) {
    this.goal.x = clamp(this.goal.x + 2 * dx * this.goal.zoom, -2, 2);
    this.goal.y = clamp(this.goal.y + 2 * dy * this.goal.zoom, -2, 2);
  }

  /** Moves towards the target; returns whether it is still moving. `seconds` of 0 jumps there at once. */
  step(seconds, places, ground) {
    const wanted = this.presets[this.name].at(places, ground);
    const jump = this.still || seconds === 0 || !this.target;
    const share = (speed) => (jump ? 1 : 1 - Math.exp(-speed * seconds));
    const before = this.target ?? wanted;
    const sent = this.sent !== this.name;
    this.sent = this.name;
    if (sent) this.hurry = 0.6;
    this.hurry = Math.max((this.hurry ?? 0) - seconds, 0);
    const follow = share(this.hurry > 0 ? EASE : FOLLOW);
    this.target = before.map((x, i) => mix(x, wanted[i], follow));
    let moving = Math.hypot(...subtract(this.target, wanted)) > 5e-4;
    for (const key of Object.keys(this.goal)) {
      this.now[key] = mix(this.now[key], this.goal[key], share(EASE));
      moving ||= Math.abs(this.now[key] - this.goal[key]) > 5e-4;
    }
    return moving;
  }

  /** Matrices for a picture of this aspect ratio; `insets` are the shares covered at its top and bottom. */
  look(aspect, { top = 0, bottom = 0 } = {}) {
    const free = Math.max(1 - top - bottom, LEAST_FREE);
    const { yaw, pitch, zoom, x, y, wide, high } = this.now;
    const height = Math.max(high / free, wide / aspect);
    const distance = (height * zoom) / Math.tan(FOV / 2);
    const right = [Math.cos(yaw), 0, -Math.sin(yaw)];
    const middle = add(this.target, add(scale(right, -x * height), [0, y * height, 0]));
    const back = [Math.sin(yaw) * Math.cos(pitch), Math.sin(pitch), Math.cos(yaw) * Math.cos(pitch)];
    const up = [-Math.sin(yaw) * Math.sin(pitch), Math.cos(pitch), -Math.cos(yaw) * Math.sin(pitch)];
    const eye = add(middle, scale(back, distance));
    const near = Math.max(0.02, 0.05 * distance);
    const lens = perspective(FOV, aspect, near, distance + 12);
    // Centre the target in the uncovered part.
    lens[9] = -(bottom - top);
    const view = multiply(lens, lookAt(eye, middle, [0, 1, 0]));
    this.view = view;
    return { view, eye, axes: { right, up, back } };
  }

  /** Projects a world point into a picture of `width` and `height`. */
  project(point, width, height) {
    const [x, y, , w] = transform(this.view, point);
    return [(0.5 + (0.5 * x) / w) * width, (0.5 - (0.5 * y) / w) * height];
  }
}

/** Shares of the picture's height covered by the title and the controls. */
export function insetsOf(picture, title, controls) {
  const view = picture.getBoundingClientRect();
  const share = (pixels) => clamp(pixels / Math.max(view.height, 1), 0, 0.5);
  const { top, bottom } = controls.getBoundingClientRect();
  const isOver = top < view.bottom && bottom > view.top;
  return { top: share(title.getBoundingClientRect().bottom - view.top), bottom: isOver ? share(view.bottom - top) : 0 };
}

/** Mouse, touch and wheel input on the picture. Calls `changed` after each. */
export function steer(canvas, camera, changed) {
  const fingers = new Map();
  let span = 0;
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    span = spread();
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.x, event.clientY - before.y].map((d) => d / canvas.clientHeight);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (fingers.size > 1) {
      const now = spread();
      if (span > 0 && now > 0) camera.zoom(span / now);
      span = now;
      camera.pan(dx, dy);
    } else if (event.shiftKey || event.buttons === 2 || event.buttons === 4) {
      camera.pan(dx, dy);
    } else {
      camera.orbit(4 * dx, 3 * dy);
    }
    changed();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      camera.zoom(Math.exp(clamp(event.deltaY, -80, 80) * 0.0022));
      changed();
    },
    { passive: false },
  );
}
