//! Arms that respect a body's volume: they stay out of trunk, head, legs and each other, and touch where the source's
//! do.
//!
//! Each arm's correction moves to that of the pose as a critically damped spring does, so a frame depends on those
//! before it, and the same frames in the same order give the same bits. What is inside of the body is pushed out at once.

use umo_core_pose::rotation::{IDENTITY, Matrix, Quat, axis_angle_to_quat, inverse, product, quat_to_matrix, rotate};
use umo_core_pose::skeleton::JOINTS;

use super::align::{Vector, aside, cross, dot, less, shortest};
use super::rig::World;
use super::volume::{ANGLES, FOREARM, RINGS, Shape, THIGH, UPPER_ARM, out};
use super::{Mapping, Rig, Volume};

/// Points of an arm that are kept out of the body: elbow, two of the forearm, wrist, then those of the hand.
const PROBES: usize = 12;
const WRIST: usize = 3;
/// Places of the points between elbow and wrist.
const FOREARM_SHARES: [f32; 4] = [0.0, 0.4, 0.75, 1.0];
/// Points of a left hand: a joint, and the one before it if the point is the tip beyond it.
const HAND: [(usize, Option<usize>); PROBES - WRIST - 1] =
    [(25, None), (31, None), (26, None), (39, None), (27, Some(26)), (30, Some(29)), (33, Some(32)), (39, Some(38))];
/// Length of a finger's last bone, in lengths of the one before it.
const TIP: f32 = 0.9;
/// Way of a wrist in a frame of a 30th of a second from which on it is another motion.
const JUMP: f32 = 0.3;
/// Rate of the corrections' spring a second, and in a frame of a 30th.
const RATE: f32 = 18.0;
const FRAME: f32 = 0.6;
/// Least and most seconds of a frame.
const STEPS: [f32; 2] = [1e-3, 0.2];

/// Trunk length of the body for which the distances below are, metres.
const SIZE: f32 = 0.53;
/// Gap up to which a hand keeps its place about the body or the other arm, and gap from which it does not.
const TOUCH: f32 = 0.03;
const ABOUT: f32 = 0.2;
/// The same of the arms for each other.
const TOGETHER: f32 = 0.3;
/// Depth over which pushing begins.
const SOFT: f32 = 0.005;

/// Upper bound on the rounds of pushing.
const ROUNDS: usize = 2;
/// The same in a motion's first frame, which has no push before it.
const FIRST: usize = 8;
/// Share of a shape's height over which its surroundings end beyond its ends.
const BEYOND: f32 = 0.35;
/// Largest swivel of an elbow, radians.
const SWIVEL: f32 = 1.2;
/// Largest reach and largest shift of a wrist, in arm lengths.
const REACH: f32 = 0.97;
const SHIFT: f32 = 0.7;

fn add(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

fn times(a: Vector, by: f32) -> Vector {
    a.map(|x| x * by)
}

/// Length of a vector of a body's size, whose square neither overflows nor vanishes.
fn length(v: Vector) -> f32 {
    dot(v, v).sqrt()
}

/// Normalises `v`; `None` if it is not longer than `least`.
fn direction(v: Vector, least: f32) -> Option<Vector> {
    let length = length(v);
    (length > least && length.is_finite()).then(|| times(v, 1.0 / length))
}

fn smooth(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// A place that moves with a bone.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    bone: usize,
    /// From the bone's rest rotation to none.
    undo: Quat,
    /// From the bone, in the rig's world at rest.
    offset: Vector,
}

impl Anchor {
    fn new(rig: &Rig, bone: usize, place: Vector) -> Self {
        Self { bone, undo: inverse(rig.rotation(bone)), offset: less(place, rig.place(bone)) }
    }

    fn rotation(&self, world: &[World]) -> Quat {
        product(world[self.bone].rotation, self.undo)
    }

    fn at(&self, world: &[World]) -> Vector {
        add(world[self.bone].place, rotate(self.rotation(world), self.offset))
    }
}

/// Axes of a shape in the world.
#[derive(Clone, Copy, Debug)]
struct Frame {
    place: Vector,
    matrix: Matrix,
}

impl Frame {
    fn new(anchor: &Anchor, axes: Quat, world: &[World]) -> Self {
        Self { place: anchor.at(world), matrix: quat_to_matrix(product(anchor.rotation(world), axes)) }
    }

    fn inside(&self, at: Vector) -> Vector {
        let at = less(at, self.place);
        std::array::from_fn(|i| (0..3).map(|j| self.matrix[j][i] * at[j]).sum())
    }

    fn turn(&self, v: Vector) -> Vector {
        self.matrix.map(|row| dot(row, v))
    }

    fn outside(&self, at: Vector) -> Vector {
        add(self.place, self.turn(at))
    }
}

/// A tapered capsule in the world.
#[derive(Clone, Copy, Debug)]
struct Capsule {
    from: Vector,
    way: Vector,
    radii: [f32; 2],
}

impl Capsule {
    /// Vector from the axis to a place, and the radius there.
    fn off_axis(&self, at: Vector) -> (Vector, f32) {
        let at = less(at, self.from);
        let share = (dot(at, self.way) / dot(self.way, self.way).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        (less(at, times(self.way, share)), self.radii[0] + share * (self.radii[1] - self.radii[0]))
    }
}

#[derive(Clone, Copy, Debug)]
struct Arm {
    /// Upper arm, forearm, hand.
    bones: [usize; 3],
    hand: [Anchor; HAND.len()],
    radii: [f32; PROBES],
}

/// A body with its volume: the source's or the rig's.
#[derive(Clone, Debug)]
struct Form {
    axes: Quat,
    volume: Volume,
    /// Pelvis, belly and chest carry the trunk.
    trunk: [Anchor; 3],
    head: Option<Anchor>,
    /// Distance from the head's origin beyond which it has no effect.
    beyond: f32,
    neck: Option<[Anchor; 2]>,
    thighs: [Option<[Anchor; 2]>; 2],
    arms: [Option<Arm>; 2],
}

/// A form's shapes in one pose.
struct Shapes<'a> {
    form: &'a Form,
    trunk: [Frame; 3],
    head: Option<Frame>,
    /// Neck and thighs.
    limbs: [Option<Capsule>; 3],
}

/// A place about the trunk or the head.
#[derive(Clone, Copy, Debug, Default)]
struct Near {
    /// In the shape's axes.
    at: Vector,
    /// Distance from the surface.
    gap: f32,
    radius: f32,
}

impl Form {
    fn new(
        rig: &Rig,
        mapping: &Mapping,
        turns: &[Quat; JOINTS],
        axes: Quat,
        volume: Volume,
        source: &Source,
    ) -> Option<Self> {
        let hips = mapping.bone(0)?;
        let spine: Vec<usize> = match mapping.spine() {
            [] => [3, 6, 9].into_iter().filter_map(|joint| mapping.bone(joint)).collect(),
            spine => spine.to_vec(),
        };
        let chest = spine.last().copied().unwrap_or(hips);
        let belly = spine.get((spine.len().max(1) - 1) / 2).copied().unwrap_or(hips);
        let trunk = [hips, belly, chest].map(|bone| Anchor::new(rig, bone, volume.trunk.base));
        let head = mapping.bone(15).map(|bone| Anchor::new(rig, bone, volume.head.base));
        let low = mapping.bone(12).or_else(|| mapping.neck().first().copied());
        let ends = |from: usize, to: usize, of: usize| [from, to].map(|end| Anchor::new(rig, of, rig.place(end)));
        let neck = low.zip(mapping.bone(15)).map(|(low, head)| ends(low, head, low));
        let thighs = [1, 2].map(|hip| {
            let (hip, knee) = mapping.bone(hip).zip(mapping.bone(hip + 3))?;
            Some(ends(hip, knee, hip))
        });
        let arms = [0, 1].map(|side| Self::arm(rig, mapping, turns, axes, &volume, side, source));
        let skull = &volume.head;
        let widest = skull.radii.as_flattened().iter().copied().fold(0.0, f32::max);
        let high = skull.ends[0].abs().max(skull.ends[1].abs());
        let beyond = length([widest, high, 0.0]) + (ABOUT + 0.15) * volume.size / SIZE;
        Some(Self { axes, volume, trunk, head, beyond, neck, thighs, arms })
    }

    fn arm(
        rig: &Rig,
        mapping: &Mapping,
        turns: &[Quat; JOINTS],
        axes: Quat,
        volume: &Volume,
        side: usize,
        source: &Source,
    ) -> Option<Arm> {
        let bone = |joint: usize| mapping.bone(joint);
        let bones = [bone(16 + side)?, bone(18 + side)?, bone(20 + side)?];
        let reach = bones.windows(2).map(|pair| length(less(rig.place(pair[1]), rig.place(pair[0])))).sum::<f32>();
        // A hand without fingers is the source's, to scale.
        let size = volume.size / source.size;
        let hand = HAND.map(|(joint, before)| {
            let (joint, before) = (joint + 15 * side, before.map(|before| before + 15 * side));
            if let (Some(tip), Some(before)) = (bone(joint), before.map(bone)) {
                let beyond = before.map_or([0.0; 3], |before| times(less(rig.place(tip), rig.place(before)), TIP));
                return Anchor::new(rig, tip, add(rig.place(tip), beyond));
            }
            if let (Some(knuckle), None) = (bone(joint), before) {
                return Anchor::new(rig, knuckle, rig.place(knuckle));
            }
            let beyond = before.map_or([0.0; 3], |before| times(less(source.rest[joint], source.rest[before]), TIP));
            let offset = add(less(source.rest[joint], source.rest[20 + side]), beyond);
            let offset = rotate(inverse(turns[20 + side]), rotate(axes, times(offset, size)));
            // Where there is neither a finger nor a mesh for it, the hand's mesh is nearest.
            let offset = volume.hands[side].as_ref().map_or(offset, |hand| hand.nearest(offset));
            Anchor::new(rig, bones[2], add(rig.place(bones[2]), offset))
        });
        let [elbow, wrist] = volume.limbs[FOREARM];
        let elbow = elbow.min(volume.limbs[UPPER_ARM][1]);
        let at = |share: f32| elbow + share * (wrist - elbow);
        let mut radii = [volume.finger; PROBES];
        radii[..=WRIST].copy_from_slice(&FOREARM_SHARES.map(at));
        radii[WRIST] = radii[WRIST].min(1.3 * volume.palm);
        radii[WRIST + 1..WRIST + 3].fill(volume.palm);
        (reach > 1e-3 * volume.size).then_some(Arm { bones, hand, radii })
    }

    fn shapes<'a>(&'a self, world: &[World]) -> Shapes<'a> {
        let capsule = |ends: &[Anchor; 2], limb: usize| {
            let [from, to] = ends.map(|end| end.at(world));
            Capsule { from, way: less(to, from), radii: self.volume.limbs[limb] }
        };
        let [left, right] = self.thighs.each_ref().map(|thigh| thigh.as_ref().map(|ends| capsule(ends, THIGH)));
        Shapes {
            form: self,
            trunk: self.trunk.each_ref().map(|anchor| Frame::new(anchor, self.axes, world)),
            head: self.head.as_ref().map(|anchor| Frame::new(anchor, self.axes, world)),
            limbs: [self.neck.as_ref().map(|ends| capsule(ends, 0)), left, right],
        }
    }

    /// Points of an arm.
    fn probes(arm: &Arm, world: &[World]) -> [Vector; PROBES] {
        let [_, elbow, wrist] = arm.bones.map(|bone| world[bone].place);
        std::array::from_fn(|probe| match FOREARM_SHARES.get(probe) {
            Some(&share) => add(elbow, times(less(wrist, elbow), share)),
            None => arm.hand[probe - WRIST - 1].at(world),
        })
    }
}

impl Shapes<'_> {
    /// Shares of pelvis, belly and chest at a height above the line of the hips, in trunk lengths.
    fn shares(height: f32) -> [f32; 3] {
        let (low, high) = (1.0 - smooth((height - 0.05) / 0.3), smooth((height - 0.5) / 0.3));
        [low, 1.0 - low - high, high]
    }

    fn shape(&self, head: bool) -> &Shape {
        if head { &self.form.volume.head } else { &self.form.volume.trunk }
    }

    /// Where a place lies about trunk or head.
    fn near(&self, head: bool, place: Vector) -> Near {
        let at = match (head, &self.head) {
            (true, Some(frame)) => {
                let at = frame.inside(place);
                if dot(at, at) > self.form.beyond * self.form.beyond {
                    return Near { at, gap: f32::MAX, radius: 1.0 };
                }
                at
            }
            (true, None) => return Near { at: [0.0; 3], gap: f32::MAX, radius: 1.0 },
            (false, _) => {
                let middle = self.trunk[1].inside(place);
                let shares = Self::shares(middle[1] / self.form.volume.size);
                let mut at = times(middle, shares[1]);
                for part in [0, 2] {
                    if shares[part] > 0.0 {
                        at = add(at, times(self.trunk[part].inside(place), shares[part]));
                    }
                }
                at
            }
        };
        let shape = self.shape(head);
        let radius = shape.radius(shape.around(at));
        Near { at, gap: out(at) - radius, radius }
    }

    /// A direction in the axes of trunk or head at a place there, in the world.
    fn turn(&self, head: bool, at: Vector, v: Vector) -> Vector {
        match (head, &self.head) {
            (true, Some(frame)) => frame.turn(v),
            (true, None) => [0.0; 3],
            (false, _) => {
                let shares = Self::shares(at[1] / self.form.volume.size);
                (0..3).fold([0.0; 3], |sum, part| add(sum, times(self.trunk[part].turn(v), shares[part])))
            }
        }
    }

    /// A place about trunk or head, in the world.
    fn place(&self, head: bool, at: Vector) -> Vector {
        match (head, &self.head) {
            (true, Some(frame)) => frame.outside(at),
            (true, None) => [0.0; 3],
            (false, _) => {
                let shares = Self::shares(at[1] / self.form.volume.size);
                (0..3).fold([0.0; 3], |sum, part| add(sum, times(self.trunk[part].outside(at), shares[part])))
            }
        }
    }
}

/// The source's rest, for hands without fingers.
struct Source {
    rest: super::align::Rest,
    size: f32,
}

/// Both bodies.
#[derive(Clone, Debug)]
pub(super) struct Space {
    source: Form,
    rig: Form,
    gain: f32,
    /// Units of the rig for a metre of the source.
    scale: f32,
    /// Width of the rig's trunk beyond the source's, to scale: ahead, at the sides, behind.
    wider: [[f32; 3]; RINGS],
    /// Half width and half depth of the source's trunk.
    girth: [f32; 2],
}

/// An arm's pose: shoulder, elbow, wrist; the direction in which a straight elbow bends.
#[derive(Clone, Copy, Debug)]
struct Reach {
    at: [Vector; 3],
    back: Vector,
}

/// World rotations of upper arm and forearm that are applied to an arm.
pub(super) type Turned = Option<[Quat; 2]>;

impl Reach {
    fn lengths(&self) -> [f32; 2] {
        [length(less(self.at[1], self.at[0])), length(less(self.at[2], self.at[1]))]
    }

    /// The place nearest to `wrist` that the arm reaches.
    fn reachable(&self, wrist: Vector) -> Vector {
        let [upper, fore] = self.lengths();
        let now = length(less(self.at[2], self.at[0]));
        let least = now.min(1.1 * (upper - fore).abs() + 0.1 * (upper + fore));
        let way = less(wrist, self.at[0]);
        let far = length(way);
        if far <= 1e-6 * (upper + fore) {
            return self.at[2];
        }
        // Straightening slows down before an arm is straight.
        let (more, room) = (far - now, (REACH * (upper + fore) - now).max(0.01 * (upper + fore)));
        let slow = |more: f32| more / (1.0 + (more / room).powi(4)).sqrt().sqrt();
        let to = if more > 0.0 { now + slow(more) } else { far.max(least) };
        add(self.at[0], times(way, to / far))
    }

    /// The elbow with the wrist elsewhere.
    fn elbow(&self, wrist: Vector, swivel: f32) -> Option<Vector> {
        let [upper, fore] = self.lengths();
        let whole = upper + fore;
        let from = direction(less(self.at[2], self.at[0]), 1e-4 * whole)?;
        let way = less(wrist, self.at[0]);
        let to = direction(way, 1e-4 * whole)?;
        let far = length(way);
        let along = (upper * upper - fore * fore + far * far) / (2.0 * far);
        let out = (upper * upper - along * along).max(0.0).sqrt();
        let side = self.turned(from, to, swivel, aside(less(self.at[1], self.at[0]), from));
        // The elbow stays on its side; any further bend is about its hinge.
        let more = (out - length(side)).max(0.0);
        let back = match more > 0.0 {
            true => direction(aside(self.turned(from, to, swivel, self.back), to), 1e-3).unwrap_or([0.0; 3]),
            false => [0.0; 3],
        };
        let side = direction(add(side, times(back, more)), 1e-6 * whole).unwrap_or([0.0; 3]);
        Some(add(self.at[0], add(times(to, along), times(side, out))))
    }

    /// A vector that turns with the line from shoulder to wrist.
    fn turned(&self, from: Vector, to: Vector, swivel: f32, v: Vector) -> Vector {
        let (side, cosine) = (cross(from, to), dot(from, to));
        // The shortest way, without a function of an angle.
        let v = match cosine > -0.99 {
            true => {
                let once = cross(side, v);
                add(v, add(once, times(cross(side, once), 1.0 / (1.0 + cosine))))
            }
            false => rotate(shortest(from, to, self.back), v),
        };
        if swivel == 0.0 {
            return v;
        }
        let (sine, cosine) = swivel.sin_cos();
        add(times(v, cosine), add(times(cross(to, v), sine), times(to, dot(to, v) * (1.0 - cosine))))
    }

    /// World rotations that bring the wrist there, relative to the arm as it is.
    fn bend(&self, wrist: Vector, swivel: f32) -> Turned {
        let elbow = self.elbow(wrist, swivel)?;
        let [from, to] = [self.at[2], wrist].map(|end| direction(less(end, self.at[0]), 0.0));
        let (from, to) = (from?, to?);
        let turn = product(axis_angle_to_quat(times(to, swivel)), shortest(from, to, self.back));
        let swing = |from: Vector, to: Vector| {
            let from = rotate(turn, direction(from, 0.0)?);
            Some(product(shortest(from, direction(to, 0.0)?, self.back), turn))
        };
        let [shoulder, was, hand] = self.at;
        Some([swing(less(was, shoulder), less(elbow, shoulder))?, swing(less(hand, was), less(wrist, elbow))?])
    }
}

/// Pushes that are averaged, the strongest most.
#[derive(Clone, Copy, Default)]
struct Push {
    shift: Vector,
    shifts: f32,
    swivel: f32,
    swivels: f32,
}

/// Movement of an arm.
#[derive(Clone, Copy, Default)]
struct Moved {
    shift: Vector,
    swivel: f32,
}

/// An arm of both bodies in one pose.
struct Posed<'a> {
    own: &'a Arm,
    rigs: &'a Arm,
    /// Points of the source's arm, and the same in the rig's axes.
    spots: [Vector; PROBES],
    turned: [Vector; PROBES],
    /// Points of the rig's arm, before its correction and after.
    held: [Vector; PROBES],
    now: [Vector; PROBES],
    /// Places of the source's points about trunk and head.
    near: [[Near; 2]; PROBES],
    reach: Reach,
    moved: Moved,
}

/// Time from a frame to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    /// Rate of the spring a frame.
    rate: f32,
    /// What is left of a deviation after a frame: `exp(-rate)`.
    fade: f32,
}

impl Default for Step {
    fn default() -> Self {
        Self::new(1.0 / 30.0)
    }
}

impl Step {
    /// `seconds` is clamped to [`STEPS`]; not a number is a 30th.
    pub(super) fn new(seconds: f32) -> Self {
        let seconds = if seconds.is_nan() { 1.0 / 30.0 } else { seconds.clamp(STEPS[0], STEPS[1]) };
        let rate = RATE * seconds;
        // The same bits on all systems: a 64th of the exponent's series, squared six times.
        let x = -f64::from(rate) / 64.0;
        let part = (1..=6).rev().fold(1.0, |sum, k| 1.0 + x / f64::from(k) * sum);
        #[expect(clippy::cast_possible_truncation, reason = "between 0 and 1")]
        let fade = (0..6).fold(part, |power, _| power * power) as f32;
        Self { rate, fade }
    }

    /// Length in frames of a 30th of a second.
    fn frames(self) -> f32 {
        self.rate / FRAME
    }
}

/// An arm's correction in the frame before.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Past {
    /// Place of the source's wrist about its hips; `None` before the first frame.
    wrist: Option<Vector>,
    /// Shift in the axes of the rig's trunk, then swivel, each with its change a frame.
    values: [[f32; 2]; 4],
}

impl Past {
    /// Goes on with frames of another length.
    pub(super) fn pace(&mut self, from: Step, to: Step) {
        let longer = to.rate / from.rate;
        self.values.iter_mut().for_each(|[_, change]| *change *= longer);
    }

    /// Whether the source's wrist moved further than `jump`.
    fn is_new(&self, wrist: Vector, jump: f32) -> bool {
        self.wrist.is_none_or(|was| length(less(wrist, was)) > jump)
    }

    /// Moves towards a correction; to it at once in the first frame.
    fn damp(&mut self, step: Step, wrist: Vector, to: Moved, axes: Quat) -> Moved {
        let Step { rate, fade } = step;
        let [x, y, z] = rotate(inverse(axes), to.shift);
        let is_new = self.wrist.is_none();
        self.wrist = Some(wrist);
        for (value, goal) in self.values.iter_mut().zip([x, y, z, to.swivel]) {
            let [at, change] = *value;
            let more = change + rate * (at - goal);
            *value = match is_new || !more.is_finite() {
                true => [goal, 0.0],
                false => [goal + (at - goal + more) * fade, (change - rate * more) * fade],
            };
        }
        let [x, y, z, swivel] = self.values.map(|value| value[0]);
        Moved { shift: rotate(axes, [x, y, z]), swivel }
    }

    /// Adds what was pushed.
    fn push(&mut self, from: Moved, to: Moved, axes: Quat) {
        let [x, y, z] = rotate(inverse(axes), less(to.shift, from.shift));
        for (value, by) in self.values.iter_mut().zip([x, y, z, to.swivel - from.swivel]) {
            value[0] += by;
        }
    }
}

/// Distance of the boxes around two sets of points.
fn apart(a: &[Vector; PROBES], b: &[Vector; PROBES]) -> f32 {
    let bounds = |points: &[Vector; PROBES], i: usize| {
        points.iter().fold([f32::MAX, f32::MIN], |[low, high], at| [low.min(at[i]), high.max(at[i])])
    };
    let gap: Vector = std::array::from_fn(|i| {
        let [[a_low, a_high], [b_low, b_high]] = [bounds(a, i), bounds(b, i)];
        (a_low - b_high).max(b_low - a_high).max(0.0)
    });
    length(gap)
}

impl Space {
    pub(super) fn new(
        source: (&Rig, &Mapping),
        rig: (&Rig, &Mapping),
        turns: &[Quat; JOINTS],
        axes: Quat,
        rest: &super::align::Rest,
        volume: &Volume,
        gain: f32,
    ) -> Option<Self> {
        let people = Volume::of_people(source.0, source.1)?;
        let base = Source { rest: *rest, size: people.size };
        let scale = volume.size / people.size;
        let own = Form::new(source.0, source.1, &[IDENTITY; JOINTS], IDENTITY, people, &base)?;
        let rig = Form::new(rig.0, rig.1, turns, axes, volume.clone(), &base)?;
        let palms = rig.volume.palm - scale * own.volume.palm;
        let wider = std::array::from_fn(|ring| {
            let [from, to] = [&own, &rig].map(|form| girths(&form.volume.trunk, ring));
            std::array::from_fn(|part| to[part] - scale * from[part] + palms)
        });
        let middle = girths(&own.volume.trunk, RINGS / 2);
        let girth = [middle[1], 0.5 * (middle[0] + middle[2])];
        Some(Self { source: own, rig, gain, scale, wider, girth })
    }

    /// The bones of an arm: upper arm, forearm, hand.
    pub(super) fn arm(&self, side: usize) -> Option<[usize; 3]> {
        self.rig.arms[side].map(|arm| arm.bones)
    }

    /// A distance of the source's.
    fn metres(&self, metres: f32) -> f32 {
        metres * self.source.volume.size / SIZE
    }

    /// World rotations to apply to each arm of a rig posed as the source is; `None` for an arm that stays.
    pub(super) fn correct(
        &self,
        past: &mut [Past; 2],
        step: Step,
        source: &[World; JOINTS],
        world: &[World],
    ) -> [Turned; 2] {
        let (from, to) = (self.source.shapes(source), self.rig.shapes(world));
        let mut arms = [0, 1].map(|side| self.posed(side, &from, source, world));
        for arm in arms.iter_mut().flatten() {
            let [wrist, index, little] = [WRIST, WRIST + 1, WRIST + 2].map(|probe| arm.spots[probe]);
            let middle = times(add(wrist, add(index, little)), 1.0 / 3.0);
            let wide = self.widen(&to, from.near(false, middle).at);
            let shift = self.about(&to, arm, WRIST..PROBES, wide);
            self.follow(arm, Moved { shift, swivel: 0.0 });
            // The elbow swivels towards its place about the body.
            let wide = self.widen(&to, arm.near[0][0].at);
            let wanted = add(arm.held[0], self.about(&to, arm, 0..1, wide));
            arm.moved.swivel = self.swivel(&arm.now, arm.reach.at[0], wanted);
        }
        if let [Some(left), Some(right)] = &mut arms {
            let shifts = self.together([left, right], true);
            for (arm, shift) in [left, right].into_iter().zip(shifts) {
                let Moved { shift: own, swivel } = arm.moved;
                self.follow(arm, Moved { shift: add(own, shift), swivel });
            }
        }
        let axes = product(self.rig.trunk[1].rotation(world), self.rig.axes);
        let mut rounds = ROUNDS;
        for (side, arm) in arms.iter_mut().enumerate() {
            let Some(arm) = arm else { continue };
            let wrist = less(source[20 + side].place, source[0].place);
            if past[side].is_new(wrist, self.metres(JUMP) * step.frames()) {
                past[side].wrist = None;
                rounds = FIRST;
            }
            let moved = past[side].damp(step, wrist, arm.moved, axes);
            self.follow(arm, moved);
        }
        let smoothed = arms.each_ref().map(|arm| arm.as_ref().map(|arm| arm.moved));
        self.clear(&to, &mut arms, rounds);
        let mut turned = [None; 2];
        for (side, arm) in arms.iter().enumerate() {
            let (Some(arm), Some(smoothed)) = (arm, smoothed[side]) else { continue };
            past[side].push(smoothed, arm.moved, axes);
            let reach = &arm.reach;
            let wrist = reach.reachable(add(reach.at[2], times(arm.moved.shift, self.gain)));
            let swivel = arm.moved.swivel * self.gain;
            let is_moved = length(less(wrist, reach.at[2])) > 1e-6 * self.rig.volume.size || swivel.abs() > 1e-6;
            turned[side] = if is_moved { reach.bend(wrist, swivel) } else { None };
        }
        turned
    }

    /// Pushes both arms out of the body and each other, until nothing moves or for so many rounds.
    fn clear(&self, to: &Shapes, arms: &mut [Option<Posed>; 2], rounds: usize) {
        for _ in 0..rounds {
            let shifts = match &*arms {
                [Some(left), Some(right)] => self.together([left, right], false),
                _ => [[0.0; 3]; 2],
            };
            let mut is_still = true;
            for (arm, mut shift) in arms.iter_mut().zip(shifts) {
                let Some(arm) = arm else { continue };
                let push = self.push(to, arm);
                let mut by = arm.moved;
                if push.shifts > 0.0 {
                    shift = add(shift, times(push.shift, 1.0 / push.shifts));
                }
                if push.swivels > 0.0 {
                    by.swivel = (by.swivel + push.swivel / push.swivels).clamp(-SWIVEL, SWIVEL);
                }
                if push.swivels > 0.0 || shift != [0.0; 3] {
                    is_still = false;
                    by.shift = add(by.shift, shift);
                    self.follow(arm, by);
                }
            }
            if is_still {
                break;
            }
        }
    }

    /// An arm before its correction.
    fn posed<'a>(&'a self, side: usize, from: &Shapes, source: &[World; JOINTS], world: &[World]) -> Option<Posed<'a>> {
        let (own, rigs) = (self.source.arms[side].as_ref()?, self.rig.arms[side].as_ref()?);
        let (spots, held) = (Form::probes(own, source), Form::probes(rigs, world));
        // A person's elbow points backwards where the palm faces down.
        let back = rotate(self.rig.axes, rotate(source[16 + side].rotation, [0.0, 0.0, -1.0]));
        Some(Posed {
            own,
            rigs,
            spots,
            turned: spots.map(|spot| rotate(self.rig.axes, spot)),
            held,
            now: held,
            near: spots.map(|spot| [from.near(false, spot), from.near(true, spot)]),
            reach: Reach { at: rigs.bones.map(|bone| world[bone].place), back },
            moved: Moved::default(),
        })
    }

    /// Shift by which a place about the trunk of the source moves because the rig is wider or narrower.
    fn widen(&self, to: &Shapes, at: Vector) -> Vector {
        let (from, target) = (&self.source.volume.trunk, &self.rig.volume.trunk);
        let share = from.share(at);
        let inside = smooth(1.0 - (share - 1.0) / BEYOND);
        if inside <= 0.0 {
            return [0.0; 3];
        }
        #[expect(clippy::cast_precision_loss, reason = "a dozen")]
        let ring = (share * (RINGS - 1) as f32).clamp(0.0, (RINGS - 1) as f32);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and not negative")]
        let (low, up) = (ring as usize, ring - ring.floor());
        let high = (low + 1).min(RINGS - 1);
        let wider: [f32; 3] = std::array::from_fn(|part| {
            inside * (self.wider[low][part] + up * (self.wider[high][part] - self.wider[low][part]))
        });
        let [u, v] = [at[0] / self.girth[0], at[2] / self.girth[1]].map(|x| x * x.abs());
        let all = (u * u + v * v + 0.5).sqrt();
        let (side, ahead) = (u / all, v / all);
        let by = [side * wider[1], 0.0, ahead * wider[if ahead > 0.0 { 0 } else { 2 }]];
        let height = target.ends[0] + share.clamp(0.0, 1.0) * (target.ends[1] - target.ends[0]);
        to.turn(false, [0.0, height, 0.0], by)
    }

    /// Angle about the line from shoulder to wrist that brings an elbow nearest to a place; less for a straight arm.
    fn swivel(&self, now: &[Vector; PROBES], shoulder: Vector, wanted: Vector) -> f32 {
        let Some(axis) = direction(less(now[WRIST], shoulder), 1e-4 * self.rig.volume.size) else { return 0.0 };
        let (from, to) = (aside(less(now[0], shoulder), axis), aside(less(wanted, shoulder), axis));
        let least = (0.02 * self.rig.volume.size) * (0.02 * self.rig.volume.size);
        let (sine, cosine) = (dot(cross(from, to), axis), dot(from, to));
        (sine / (cosine.max(0.0) + least + 0.5 * sine.abs())).clamp(-SWIVEL, SWIVEL)
    }

    /// Moves an arm and its points, within its reach.
    fn follow(&self, arm: &mut Posed, by: Moved) {
        let reach = &arm.reach;
        let most = SHIFT * reach.lengths().iter().sum::<f32>();
        let far = length(by.shift);
        let shift = if far > most { times(by.shift, most / far) } else { by.shift };
        let wrist = reach.reachable(add(reach.at[2], shift));
        let shift = less(wrist, reach.at[2]);
        let elbow = reach.elbow(wrist, by.swivel).unwrap_or(reach.at[1]);
        for (probe, now) in arm.now.iter_mut().enumerate() {
            *now = match FOREARM_SHARES.get(probe) {
                Some(&share) => add(elbow, times(less(wrist, elbow), share)),
                None => add(arm.held[probe], shift),
            };
        }
        arm.moved = Moved { shift, swivel: by.swivel };
    }

    /// Share to which a place at this gap of the source's is kept.
    fn contact(&self, gap: f32, until: f32) -> f32 {
        let (touch, until) = (self.metres(TOUCH), self.metres(until));
        smooth((until - gap) / (until - touch))
    }

    /// Vector from a point of an arm to the place about trunk or head where the source's is, and its weight: 1 on the
    /// surface, less further away.
    fn astray(&self, to: &Shapes, head: bool, near: Near, radii: [f32; 2], held: Vector) -> (Vector, f32) {
        let (from, target) = (self.source.volume_of(head), self.rig.volume_of(head));
        let share = from.share(near.at);
        let inside = smooth(1.0 + share / BEYOND) * smooth(1.0 - (share - 1.0) / BEYOND);
        let far = out(near.at);
        if inside <= 0.0 || far <= 0.0 {
            return ([0.0; 3], 0.0);
        }
        let level = |shape: &Shape, at: Vector| shape.radius(shape.around(at).level());
        let gap = far - level(from, near.at) - radii[0];
        let weight = inside * self.contact(gap, ABOUT);
        if weight <= 0.0 {
            return ([0.0; 3], 0.0);
        }
        let height = target.ends[0] + share * (target.ends[1] - target.ends[0]);
        let radius = level(target, [near.at[0], height, near.at[2]]);
        let grown = (radius + radii[1] + gap.max(0.0) * self.scale) / far;
        let place = to.place(head, [near.at[0] * grown, height, near.at[2] * grown]);
        (less(place, held), weight)
    }

    /// Shift that puts a hand about trunk and head where the source's is; `wide` away from them.
    fn about(&self, to: &Shapes, arm: &Posed, probes: std::ops::Range<usize>, wide: Vector) -> Vector {
        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for probe in probes {
            for head in [false, true] {
                let near = arm.near[probe][usize::from(head)];
                if near.gap == f32::MAX {
                    continue;
                }
                let radii = [arm.own.radii[probe], arm.rigs.radii[probe]];
                let (by, weight) = self.astray(to, head, near, radii, arm.held[probe]);
                // The nearest point counts most.
                let power = weight * weight * weight;
                sum = add(sum, times(less(by, wide), power * weight));
                weights += power;
            }
        }
        if weights > 0.0 { add(wide, times(sum, 1.0 / weights)) } else { wide }
    }

    /// Shifts of both wrists that keep the arms out of each other, or those that `pull` them to contacts.
    fn together(&self, arms: [&Posed; 2], pull: bool) -> [Vector; 2] {
        let [left, right] = arms;
        let (about, soft) = (self.metres(TOGETHER), self.metres(SOFT) * self.scale);
        let mut shifts = [([0.0; 3], 0.0); 2];
        let widest = |radii: [&[f32; PROBES]; 2]| radii.map(|radii| radii.iter().copied().fold(0.0, f32::max));
        let [own, wide] = [[&left.own.radii, &right.own.radii], [&left.rigs.radii, &right.rigs.radii]].map(widest);
        let is_far = match pull {
            true => apart(&left.turned, &right.turned) > own[0] + own[1] + about,
            false => apart(&left.now, &right.now) > wide[0] + wide[1] + soft,
        };
        if is_far {
            return [[0.0; 3]; 2];
        }
        for i in 0..PROBES {
            for j in 0..PROBES {
                let wide = left.rigs.radii[i] + right.rigs.radii[j];
                let own = left.own.radii[i] + right.own.radii[j];
                let was = less(left.turned[i], right.turned[j]);
                let have = less(left.now[i], right.now[j]);
                let (apart, limit) = if pull { (was, own + about) } else { (have, wide + soft) };
                if dot(apart, apart) > limit * limit {
                    continue;
                }
                let far = length(was);
                let gap = far - own;
                let (shift, weight) = if pull {
                    // Points that overlap keep their order.
                    let want = times(was, (wide + gap.max(0.0) * self.scale) / far.max(own));
                    let weight = if i > WRIST || j > WRIST { self.contact(gap, TOGETHER) } else { 0.0 };
                    (times(less(want, have), weight * weight), weight)
                } else {
                    let deep = ramp(wide - (-gap).max(0.0) * self.scale - length(have), soft);
                    let away = direction(add(have, times(was, self.scale)), 1e-6 * self.rig.volume.size);
                    (times(away.unwrap_or([0.0; 3]), deep * deep / soft), deep / soft)
                };
                // A forearm is reached by the other hand.
                let parts = match (i >= WRIST, j >= WRIST) {
                    (false, true) => [0.0, 1.0],
                    (true, false) => [1.0, 0.0],
                    _ => [0.5, 0.5],
                };
                for ((sum, weights), (part, sign)) in shifts.iter_mut().zip([(parts[0], 1.0), (parts[1], -1.0)]) {
                    *sum = add(*sum, times(shift, part * sign));
                    *weights += if part > 0.0 { weight } else { 0.0 };
                }
            }
        }
        shifts.map(|(sum, weights)| if weights > 0.0 { times(sum, 1.0 / weights) } else { sum })
    }

    /// Pushes of an arm out of trunk, head, neck and thighs.
    fn push(&self, to: &Shapes, arm: &Posed) -> Push {
        let mut push = Push::default();
        let Posed { now, near, rigs, reach, .. } = arm;
        let shoulder = reach.at[0];
        let soft = self.metres(SOFT) * self.scale;
        let line = less(now[WRIST], shoulder);
        let axis = direction(line, 1e-4 * self.rig.volume.size).unwrap_or([0.0; 3]);
        let mut add_push = |probe: usize, deep: f32, away: Vector| {
            let (mut away, weight) = (away, deep * deep * deep);
            if probe < WRIST {
                let arm = less(now[probe], shoulder);
                let lever = cross(axis, arm);
                let width = dot(lever, lever);
                // A straight arm cannot swivel out of the way.
                let least = (0.02 * self.rig.volume.size) * (0.02 * self.rig.volume.size);
                let can = width / (width + least);
                push.swivel += weight * deep * can * dot(lever, away) / (width + least);
                push.swivels += weight;
                if let Some(aside) = direction(lever, 1e-6 * self.rig.volume.size) {
                    away = less(away, times(aside, can * dot(away, aside)));
                }
            }
            push.shift = add(push.shift, times(away, weight * deep));
            push.shifts += weight;
        };
        for probe in 0..PROBES {
            for head in [false, true] {
                let here = to.near(head, now[probe]);
                let was = near[probe][usize::from(head)];
                // An arm is wider between its points.
                let early = if probe < WRIST { 0.5 * soft } else { 0.0 };
                let deep = ramp(rigs.radii[probe] + early - here.gap, soft);
                if deep <= 0.0 || here.radius <= 0.0 {
                    continue;
                }
                // Deep inside, the way out is where the source's is.
                let level = |at: Vector| direction([at[0], 0.0, at[2]], 0.0).unwrap_or([0.0, 0.0, 1.0]);
                let share = smooth(out(here.at) / here.radius);
                let way = add(times(level(here.at), share), times(level(was.at), 1.0 - share));
                let away = to.turn(head, here.at, direction(way, 0.0).unwrap_or([0.0, 0.0, 1.0]));
                add_push(probe, deep, away);
            }
            for limb in to.limbs.iter().flatten() {
                let (away, radius) = limb.off_axis(now[probe]);
                let deep = ramp(rigs.radii[probe] + radius - length(away), soft);
                if deep > 0.0
                    && let Some(away) = direction(away, 0.0)
                {
                    add_push(probe, deep, away);
                }
            }
        }
        push
    }
}

/// Radii ahead, at the sides and behind near a cross-section, without its details.
fn girths(shape: &Shape, ring: usize) -> [f32; 3] {
    let mut sums = [0.0; 3];
    for (by, weight) in [1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0].into_iter().enumerate() {
        let row = &shape.radii[(ring + by).saturating_sub(3).min(RINGS - 1)];
        let near = |angle: usize| {
            0.25 * row[(angle + ANGLES - 1) % ANGLES] + 0.5 * row[angle] + 0.25 * row[(angle + 1) % ANGLES]
        };
        let quarter = ANGLES / 4;
        let radii = [near(2 * quarter), 0.5 * (near(quarter) + near(3 * quarter)), near(0)];
        sums.iter_mut().zip(radii).for_each(|(sum, radius)| *sum += weight / 16.0 * radius);
    }
    sums
}

/// A depth, softened where it begins.
fn ramp(deep: f32, soft: f32) -> f32 {
    if deep >= soft {
        deep
    } else if deep > -soft {
        (deep + soft) * (deep + soft) / (4.0 * soft)
    } else {
        0.0
    }
}

impl Form {
    fn volume_of(&self, head: bool) -> &Shape {
        if head { &self.volume.head } else { &self.volume.trunk }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corrections_follow_without_overshoot_and_begin_at_once() {
        let (mut past, step) = (Past::default(), Step::default());
        let to = |x: f32| Moved { shift: [x, 0.0, 0.0], swivel: -x };
        let still = [0.1, 0.2, 0.3];
        assert_eq!(past.damp(step, still, to(1.0), IDENTITY).shift, [1.0, 0.0, 0.0]);
        let mut before = 1.0;
        for frame in 0..30 {
            let Moved { shift, swivel } = past.damp(step, still, to(2.0), IDENTITY);
            assert!(shift[0] > before && shift[0] <= 2.0 && swivel == -shift[0], "{frame}: {shift:?} {swivel}");
            before = shift[0];
            if frame == 9 {
                assert!(before > 1.95, "{before}");
            }
        }
        // A push stays, then fades.
        past.push(to(before), to(before + 0.1), IDENTITY);
        let [pushed, later] = [0, 1].map(|_| past.damp(step, still, to(2.0), IDENTITY).shift[0]);
        assert!(pushed > 2.05 && later < pushed, "{pushed} {later}");
        assert!(past.is_new([1.0, 0.2, 0.3], 0.3) && !past.is_new([0.2, 0.2, 0.3], 0.3));
    }

    #[test]
    fn corrections_follow_in_seconds_at_any_frame_rate() {
        // A 30th of a second has the rounded constants of the exact function.
        assert_eq!(Step::default(), Step { rate: 0.6, fade: 0.548_811_6 });
        for wrong in [f32::NAN, 0.0, -1.0, f32::INFINITY] {
            let Step { rate, fade } = Step::new(wrong);
            assert!(rate > 0.0 && fade > 0.0 && fade < 1.0, "{wrong}: {rate} {fade}");
        }
        let to = |x: f32| Moved { shift: [x, 0.0, 0.0], swivel: 0.0 };
        let after = |steps: &[f32]| {
            let mut past = Past::default();
            past.damp(Step::default(), [0.0; 3], to(0.0), IDENTITY);
            let (mut at, mut before) = (0.0, Step::default());
            for &seconds in steps {
                let step = Step::new(seconds);
                past.pace(before, step);
                before = step;
                at = past.damp(step, [0.0; 3], to(1.0), IDENTITY).shift[0];
            }
            at
        };
        let want = after(&[1.0 / 30.0; 3]);
        assert!((0.4..0.6).contains(&want), "{want}");
        let mixed = [1.0 / 30.0, 1.0 / 60.0, 1.0 / 120.0, 1.0 / 120.0, 1.0 / 30.0];
        for steps in [&[1.0 / 60.0; 6][..], &[1.0 / 240.0; 24], &[1.0 / 20.0; 2], &mixed] {
            assert!((after(steps) - want).abs() < 1e-4, "{steps:?}: {}, not {want}", after(steps));
        }
    }

    #[test]
    fn arms_straighten_continuously() {
        let reach = Reach { at: [[0.0; 3], [0.25, 0.0, -0.1], [0.45, 0.0, 0.0]], back: [0.0, 0.0, -1.0] };
        let whole: f32 = reach.lengths().iter().sum();
        let mut before = reach.reachable([0.45, 0.0, 0.0])[0];
        assert!((before - 0.45).abs() < 1e-6, "{before}");
        for step in 1..200_u8 {
            let now = reach.reachable([0.45 + 0.002 * f32::from(step), 0.0, 0.0])[0];
            assert!(now > before - 1e-6 && now - before < 0.0021 && now < 0.975 * whole, "{step}: {before} to {now}");
            before = now;
        }
    }
}
