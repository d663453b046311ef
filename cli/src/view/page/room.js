// The members of a conversation in one room: each at its place, with the sound from there.

import { FigureBody } from "umo/body.js";
import { Clock } from "umo/clock.js";
import { add, product, rotate, scale, subtract } from "umo/math.js";
import { Motion } from "umo/motion.js";

/** A member's figure at its place. */
export class MemberBody extends FigureBody {
  constructor(scene, member) {
    const own = { ...scene, mesh: member.mesh, frames: member.frames };
    super(own, new Motion(own));
    this.position = member.position;
    this.facing = member.facing;
    this.turn = [0, Math.sin(member.facing / 2), 0, Math.cos(member.facing / 2)];
    this.room = extentOf(scene.room);
  }

  at(seconds) {
    const { pose, placed } = super.at(seconds);
    const places = placed.places.map((place) => add(rotate(this.turn, place), this.position));
    return { pose, placed: { places, turned: placed.turned.map((turned) => product(this.turn, turned)) } };
  }
}

/** Centre of a room, the distance from there to the member farthest away, and half its depth, metres. */
export function extentOf(room) {
  const [low, high] = [Math.min, Math.max].map((most) => [0, 1, 2].map((axis) => most(...room.map(({ position }) => position[axis]))));
  const centre = scale(add(low, high), 0.5);
  const depth = 0.5 * (high[2] - low[2]);
  return { centre, depth, reach: Math.max(...room.map(({ position }) => Math.hypot(...subtract(position, centre)))) };
}

/** The time of the sound: all voices at once, each from its member's place. */
export class RoomClock extends Clock {
  constructor(scene, seconds) {
    super({ samples: [] }, seconds);
    this.speakers = scene.voices;
    this.sources = [];
  }

  now() {
    return this.context?.currentTime ?? 0;
  }

  /** Opens the sound: browsers allow it once somebody has touched the page. */
  open() {
    if (this.context) return;
    this.context = new AudioContext();
    this.recorded = this.context.createMediaStreamDestination();
    this.voices = this.speakers.map(({ samples, sampleRate, position: [x, y, z] }) => {
      const buffer = this.context.createBuffer(1, Math.max(samples.length, 1), sampleRate);
      buffer.getChannelData(0).set(Float32Array.from(samples, (sample) => sample / 32768));
      const place = { positionX: x, positionY: y, positionZ: z };
      const panner = new PannerNode(this.context, { panningModel: "HRTF", refDistance: 2, rolloffFactor: 0.4, ...place });
      panner.connect(this.context.destination);
      panner.connect(this.recorded);
      return { buffer, panner };
    });
  }

  /** What is heard, for a video. */
  get stream() {
    this.open();
    return this.recorded.stream;
  }

  async play() {
    if (this.playing) return;
    if (this.at >= this.seconds - 1e-3) this.seek(0);
    this.open();
    await this.context.resume();
    if (this.playing) return;
    this.playing = true;
    this.sound();
  }

  pause() {
    super.pause();
    this.silence();
  }

  seek(seconds) {
    super.seek(seconds);
    if (this.playing) this.sound();
  }

  setRate(rate) {
    super.setRate(rate);
    if (this.playing) this.sound();
  }

  /** Begins all voices at the present time. */
  sound() {
    this.silence();
    this.mark();
    this.sources = this.voices.map(({ buffer, panner }) => {
      const source = new AudioBufferSourceNode(this.context, { buffer, playbackRate: this.rate });
      source.connect(panner);
      source.start(0, Math.min(this.at, buffer.duration));
      return source;
    });
  }

  silence() {
    for (const source of this.sources) source.stop();
    this.sources = [];
  }

  /** Hears from the camera. */
  hear({ eye, axes: { up, back } }) {
    this.context?.listener.setPosition(...eye);
    this.context?.listener.setOrientation(...scale(back, -1), ...up);
  }
}
