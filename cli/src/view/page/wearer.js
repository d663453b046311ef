// Frames of the engine in this page on one's own character: the values of its animation's channels.
//
// A program does this by `Retarget::apply` and `FaceMap::apply` of umo-core. Here are the same steps, by the numbers that the
// program wrote into the page; a test compares the two.

import { add, clamp, cross, dot, inverse, product, rotate, scale, slerp, subtract } from "umo/math.js";
import { place } from "umo/motion.js";

const ORIGIN = { place: [0, 0, 0], turned: [0, 0, 0, 1], scale: 1 };
/** Metres of the heel's rise over which what is planted changes from the ankle to the ball. */
const ROLL = 0.02;
/** Most that the hips go down for a foot out of reach, and how near a foot is where it belongs; shares of the leg. */
const SINK = 0.15;
const THERE = 1e-4;
/** Where the jaw is open, lips are round and lips are wide for a vowel. */
const [OPEN, ROUND, WIDE] = [0.7, 0.7, 0.5];

const length = (v) => Math.hypot(...v);
const aside = (v, axis) => subtract(v, scale(axis, dot(v, axis)));
/** A vector's direction, or null where it is no longer than `least`. */
const direction = (v, least) => (length(v) > least ? scale(v, 1 / length(v)) : null);

/** The shortest turn from one direction to another; half a turn is about `axis`, or what of it is aside. */
function shortest(from, to, axis) {
  const side = cross(from, to);
  const sine = length(side);
  const angle = Math.atan2(sine, dot(from, to));
  const about = (axis, angle) => [...scale(axis, Math.sin(angle / 2)), Math.cos(angle / 2)];
  if (sine > 1e-6) return about(scale(side, 1 / sine), angle);
  if (angle < 1) return [0, 0, 0, 1];
  for (const candidate of [axis, [1, 0, 0], [0, 1, 0]]) {
    const found = direction(aside(candidate, from), 0.1);
    if (found) return about(found, Math.PI);
  }
  return [0, 0, 0, 1];
}

export class Wearer {
  constructor(scene) {
    this.scene = scene;
    const { retarget, faces } = scene.character.follower;
    Object.assign(this, retarget, { faces });
  }

  /** A frame's values, channel by channel as the character's animation has them. */
  values({ rotations, translation, face }) {
    const turns = Array.from({ length: this.scene.joints.length }, (_, joint) => Array.from(rotations.subarray(4 * joint, 4 * joint + 4)));
    const { turned, hips } = this.apply({ rotations: turns, translation: Array.from(translation) });
    const driven = turned.filter((_, bone) => this.driven[bone]);
    const moved = this.driven[this.hips] ? hips : [];
    return [...driven.flat(), ...moved, ...this.faces.tracks.flatMap((track) => this.weights(track, face))];
  }

  /** Each bone's rotation in its parent's frame, and the place of the hips. */
  apply(pose) {
    const source = place(this.scene, pose);
    if (this.base !== null) {
      const back = inverse(source.turned[this.base]);
      source.turned = source.turned.map((turn) => product(back, turn));
    }
    const hips = this.scaled(source.places[0]);
    const [world, turned] = [[], []];
    for (const at of this.order) {
      const bone = this.bones[at];
      const above = world[bone.parent] ?? ORIGIN;
      const driven = this.driven[at];
      const turn = driven ? product(this.axes, product(followed(driven, source), driven.rest)) : product(above.turned, bone.rotation);
      turned[at] = driven ? product(inverse(above.turned), turn) : bone.rotation;
      const own = hips && at === this.hips ? hips : add(above.place, rotate(above.turned, scale(bone.translation, above.scale)));
      world[at] = { place: own, turned: turn, scale: above.scale * bone.scale[0] };
    }
    const { parent, translation } = this.bones[this.hips];
    if (!hips) return { turned, hips: translation };
    const { up } = this.ground;
    const lift = this.plant(source, world, this.lift(source, world), turned);
    const above = world[parent] ?? ORIGIN;
    const from = subtract(add(hips, scale(up, lift)), above.place);
    return { turned, hips: scale(rotate(inverse(above.turned), from), 1 / above.scale) };
  }

  /** Where a place of the source is on the character, to scale from where both stand; null where there are no hips. */
  scaled(at) {
    const { hips, scale: size, standing } = this.ground;
    return hips && add(hips, scale(rotate(this.axes, subtract(at, [0, standing, 0])), size));
  }

  /** How much higher the hips must be for the lower foot to be as high as the source's. */
  lift(source, world) {
    const { feet, up, scale: size } = this.ground;
    const known = feet.filter((foot) => foot);
    if (known.length === 0) return 0;
    const wanted = Math.min(...known.map(({ joint, jointHeight }) => source.places[joint][1] - jointHeight));
    const found = Math.min(...known.map(({ bone, boneHeight }) => dot(world[bone].place, up) - boneHeight));
    return size * wanted - found;
  }

  /** Turns legs whose feet are not where the source's are, and gives how much the hips rise. */
  plant(source, world, rise, turned) {
    const { up } = this.ground;
    const legs = this.legs
      .filter((leg) => leg && [leg.thigh, leg.shin, leg.ankle.bone].every((bone) => this.driven[bone]))
      .map((leg) => ({ leg, wanted: this.wanted(leg, source, world) }));
    const raised = (bone, lift) => add(world[bone].place, scale(up, lift));
    const lift = rise - Math.max(0, ...legs.map(({ leg, wanted }) => sink(leg, raised(leg.thigh, rise), wanted, up)));
    for (const { leg, wanted } of legs) {
      const bones = [leg.thigh, leg.shin, leg.ankle.bone];
      const hinge = rotate(this.axes, rotate(source.turned[leg.knee], [1, 0, 0]));
      const at = bones.map((bone) => raised(bone, lift));
      const ahead = direction(cross(subtract(at[2], at[0]), hinge), 0) ?? [0, 0, 0];
      const bent = bend(leg, at, wanted, ahead);
      if (!bent) continue;
      const [thigh, shin] = bent;
      const still = [0, 0, 0, 1];
      // A bone's parent is turned with the leg above it, and the foot is turned as it was.
      [[still, thigh], [thigh, shin], [shin, still]].forEach(([above, own], i) => {
        const parent = (world[this.bones[bones[i]].parent] ?? ORIGIN).turned;
        turned[bones[i]] = product(inverse(product(above, parent)), product(own, world[bones[i]].turned));
      });
    }
    return lift;
  }

  /** Where the ankle of a leg belongs. */
  wanted({ ankle, ball }, source, world) {
    const [, y, , w] = source.turned[ankle.joint];
    const size = Math.hypot(y, w);
    // The foot's turn about up.
    const yaw = size > 0 ? [0, y / size, 0, w / size] : [0, 0, 0, 1];
    const placed = ({ joint, apart }) => add(this.scaled(source.places[joint]), rotate(this.axes, rotate(yaw, apart)));
    const byAnkle = placed(ankle);
    if (!ball) return byAnkle;
    const foot = subtract(world[ball.bone].place, world[ankle.bone].place);
    const byBall = subtract(placed(ball), foot);
    const height = ({ joint, height }) => source.places[joint][1] - height;
    const share = clamp((height(ankle) - height(ball)) / ROLL + 0.5, 0, 1);
    return add(byAnkle, scale(subtract(byBall, byAnkle), share));
  }

  /** The weights of a mesh's shapes. */
  weights({ rest, map, shares }, face) {
    const weights = [...rest];
    const { expressions } = this.faces;
    if (expressions) {
      const amounts = new Array(expressions.shapes).fill(0);
      applyCauses(expressions, face, amounts);
      for (const [, shape] of shares) weights[shape] = 0;
      for (const [expression, shape, share] of shares) weights[shape] = clamp(weights[shape] + share * amounts[expression], 0, 1);
    }
    applyCauses(map, face, weights);
    return weights;
  }
}

/** The rotation in the world that a bone follows. */
function followed({ joints: [from, to], share }, { turned }) {
  return share < 1 ? slerp(turned[from], turned[to], share) : turned[to];
}

/** How much the hips must go down for a leg that begins at `hip` to reach a place. */
function sink({ lengths: [thigh, shin] }, hip, wanted, up) {
  const reach = thigh + shin;
  const way = subtract(hip, wanted);
  const [high, wide] = [dot(way, up), length(aside(way, up))];
  if (high * high + wide * wide <= reach * reach) return 0;
  return clamp(high - Math.sqrt(Math.max(reach * reach - wide * wide, 0)), 0, SINK * reach);
}

/** What thigh and shin are turned by to bring the ankle to a place: `at` is where hip, knee and ankle are. */
function bend({ lengths: [thigh, shin] }, at, aim, ahead) {
  const reach = thigh + shin;
  const off = subtract(aim, at[2]);
  const size = length(off);
  // Continuous: what is nearly there hardly moves.
  const share = size > 0 ? Math.max(1 - (THERE * reach) / size, 0) : 0;
  if (share === 0) return null;
  const wanted = add(at[2], scale(off, share));
  const now = direction(subtract(at[2], at[0]), 1e-3 * reach);
  const to = direction(subtract(wanted, at[0]), 1e-3 * reach);
  if (!now || !to) return null;
  const far = clamp(length(subtract(wanted, at[0])), Math.abs(thigh - shin) * 1.001 + 1e-4 * reach, reach);
  const along = (thigh * thigh - shin * shin + far * far) / (2 * far);
  const out = Math.sqrt(Math.max(thigh * thigh - along * along, 0));
  const turn = shortest(now, to, ahead);
  // The knee stays on its side; what it bends more, it bends as a knee does.
  const kept = rotate(turn, aside(subtract(at[1], at[0]), now));
  const more = Math.max(out - length(kept), 0);
  const forward = direction(aside(rotate(turn, ahead), to), 1e-3) ?? [0, 0, 0];
  const side = direction(add(kept, scale(forward, more)), 1e-6 * reach);
  if (!side) return null;
  const knee = add(at[0], add(scale(to, along), scale(side, out)));
  const ankle = add(at[0], scale(to, far));
  const swing = (from, towards) => {
    const turned = rotate(turn, scale(from, 1 / length(from)));
    return product(shortest(turned, scale(towards, 1 / length(towards)), forward), turn);
  };
  return [swing(subtract(at[1], at[0]), subtract(knee, at[0])), swing(subtract(at[2], at[1]), subtract(ankle, knee))];
}

/** Adds up what moves each shape of a list. */
function applyCauses(map, face, weights) {
  const visemes = map.causes.some(([, cause]) => "viseme" in cause) ? visemeWeights(map.visemes, face) : null;
  const vowels = map.causes.some(([, cause]) => "vowel" in cause) ? vowelWeights(map.vowels, face) : null;
  const amount = ({ channel, mean, viseme, vowel, open }) => {
    if (channel) return channel[1] * face[channel[0]];
    if (mean) return 0.5 * (face[mean[0]] + face[mean[1]]);
    if (viseme !== undefined) return visemes[viseme];
    if (vowel !== undefined) return vowels[vowel];
    return Math.max(face[open.jaw] - face[open.close], 0) / OPEN;
  };
  for (const [shape] of map.causes) weights[shape] = 0;
  for (const [shape, cause] of map.causes) weights[shape] = clamp(weights[shape] + amount(cause), 0, 1);
}

/** How near the mouth is to each viseme. */
function visemeWeights({ channels, shapes, width }, face) {
  const features = channels.map(([a, b]) => 0.5 * (face[a] + face[b]));
  const distances = shapes.map((shape) => shape.reduce((sum, x, i) => sum + (x - features[i]) ** 2, 0));
  const nearest = Math.min(...distances);
  const near = distances.map((distance) => Math.exp((nearest - distance) / (2 * width * width)));
  const sum = near.reduce((sum, x) => sum + x, 0);
  return near.map((x) => x / sum);
}

/** VRM's five vowels. */
function vowelWeights({ jaw, close, round, wide }, face) {
  const share = (value, full) => clamp(value / full, 0, 1);
  const o = share(face[jaw] - face[close], OPEN);
  const r = share(Math.max(...round.map((channel) => face[channel])), ROUND);
  const w = share(0.5 * wide.reduce((sum, channel) => sum + face[channel], 0), WIDE);
  // A closed mouth that smiles says nothing.
  const apart = Math.min(4 * o, 1);
  return [o * (1 - r) * (1 - w), apart * (1 - o) * (1 - r) * w, (1 - o) * r, o * (1 - r) * w, o * r];
}
