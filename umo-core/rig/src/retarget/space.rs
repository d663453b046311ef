//! Arms that respect a body's volume: they stay out of trunk, head, legs and each other, and touch where the source's
//! do.
//!
//! Everything is a continuous function of one pose, so there are neither pops nor a state, and any frame gives the
//! same bits however it is reached.

use umo_core_pose::rotation::{IDENTITY, Matrix, Quat, axis_angle_to_quat, inverse, product, quat_to_matrix, rotate};
use umo_core_pose::skeleton::JOINTS;

use super::align::{Vector, aside, cross, dot, less, shortest};
use super::rig::World;
use super::volume::{FOREARM, Shape, THIGH, UPPER_ARM, out};
use super::{Mapping, Rig, Volume};

/// Points of an arm that are kept out of the body: elbow, two of the forearm, wrist, then those of the hand.
const PROBES: usize = 10;
const WRIST: usize = 3;
/// Places of the points between elbow and wrist.
const FOREARM_SHARES: [f32; 4] = [0.0, 0.4, 0.75, 1.0];
/// Points of a left hand: a joint, and the one before it if the point is the tip beyond it.
const HAND: [(usize, Option<usize>); PROBES - WRIST - 1] =
    [(25, None), (31, None), (27, Some(26)), (30, Some(29)), (33, Some(32)), (39, Some(38))];
/// Length of a finger's last bone, in lengths of the one before it.
const TIP: f32 = 0.9;

/// Trunk length of the body for which the distances below are, metres.
const SIZE: f32 = 0.53;
/// Gap up to which a hand keeps its place about the body or the other arm, and gap from which it does not.
const TOUCH: f32 = 0.02;
const ABOUT: f32 = 0.3;
/// Depth over which pushing begins.
const SOFT: f32 = 0.01;

/// Upper bound on the rounds of pushing.
const ROUNDS: usize = 4;
/// Share of a shape's height over which its surroundings end beyond its ends.
const BEYOND: f32 = 0.35;
/// Largest swivel of an elbow, radians.
const SWIVEL: f32 = 1.2;
/// Largest reach and largest shift of a wrist, in arm lengths.
const REACH: f32 = 0.995;
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
        Some(Self { axes, volume, trunk, head, neck, thighs, arms })
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
            (true, Some(frame)) => frame.inside(place),
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
        let (least, most) =
            (now.min(1.1 * (upper - fore).abs() + 0.1 * (upper + fore)), now.max(REACH * (upper + fore)));
        let way = less(wrist, self.at[0]);
        let far = length(way);
        if far <= 1e-6 * (upper + fore) {
            return self.at[2];
        }
        add(self.at[0], times(way, far.max(least).min(most) / far))
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
        Some(Self { source: own, rig, gain, scale })
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
    pub(super) fn correct(&self, source: &[World; JOINTS], world: &[World]) -> [Turned; 2] {
        let (from, to) = (self.source.shapes(source), self.rig.shapes(world));
        let arms = [0, 1].map(|side| Some((self.source.arms[side].as_ref()?, self.rig.arms[side].as_ref()?)));
        let spots = arms.map(|arms| arms.map(|(own, _)| Form::probes(own, source)));
        let turned_spots = spots.map(|spots| spots.map(|spots| spots.map(|spot| rotate(self.rig.axes, spot))));
        let held = arms.map(|arms| arms.map(|(_, rigs)| Form::probes(rigs, world)));
        let near: [Option<[[Near; 2]; PROBES]>; 2] = std::array::from_fn(|side| {
            spots[side].map(|spots| spots.map(|spot| [from.near(false, spot), from.near(true, spot)]))
        });
        let reach: [Option<Reach>; 2] = std::array::from_fn(|side| {
            let (_, arm) = arms[side]?;
            let at = arm.bones.map(|bone| world[bone].place);
            // A person's elbow points backwards where the palm faces down.
            let back = rotate(self.rig.axes, rotate(source[16 + side].rotation, [0.0, 0.0, -1.0]));
            Some(Reach { at, back })
        });
        let mut moved = [Moved::default(); 2];
        for side in 0..2 {
            if let (Some(arms), Some(near), Some(held)) = (arms[side], near[side], held[side]) {
                moved[side].shift = self.about(&to, arms, &near, &held, WRIST..PROBES);
            }
        }
        let mut now = held;
        for side in 0..2 {
            let (Some(arms), Some(near), Some(held), Some(reach), Some(now)) =
                (arms[side], &near[side], &held[side], &reach[side], &mut now[side])
            else {
                continue;
            };
            moved[side] = self.follow(reach, held, moved[side], now);
            // The elbow swivels towards its place about the body.
            let wanted = add(held[0], self.about(&to, arms, near, held, 0..1));
            moved[side].swivel = self.swivel(now, reach.at[0], wanted);
        }
        for round in 0..ROUNDS {
            let mut shifts = [[0.0; 3]; 2];
            if let ([Some(left), Some(right)], [Some(a), Some(b)], [Some(p), Some(q)]) = (arms, &turned_spots, &now)
                && round + 1 < ROUNDS
            {
                shifts = self.together([left, right], [a, b], [p, q]);
            }
            let mut is_still = true;
            for side in 0..2 {
                let (Some((_, arm)), Some(near), Some(held), Some(reach), Some(now)) =
                    (arms[side], &near[side], &held[side], &reach[side], &mut now[side])
                else {
                    continue;
                };
                let push = self.push(&to, arm, near, now, reach.at[0]);
                let by = &mut moved[side];
                if push.shifts > 0.0 {
                    shifts[side] = add(shifts[side], times(push.shift, 1.0 / push.shifts));
                }
                if push.swivels > 0.0 {
                    by.swivel = (by.swivel + push.swivel / push.swivels).clamp(-SWIVEL, SWIVEL);
                }
                if push.swivels > 0.0 || shifts[side] != [0.0; 3] {
                    is_still = false;
                    by.shift = add(by.shift, shifts[side]);
                    *by = self.follow(reach, held, *by, now);
                }
            }
            if is_still {
                break;
            }
        }
        let mut turned = [None; 2];
        for side in 0..2 {
            let Some(reach) = &reach[side] else { continue };
            let wrist = reach.reachable(add(reach.at[2], times(moved[side].shift, self.gain)));
            let swivel = moved[side].swivel * self.gain;
            let is_moved = length(less(wrist, reach.at[2])) > 1e-6 * self.rig.volume.size || swivel.abs() > 1e-6;
            turned[side] = if is_moved { reach.bend(wrist, swivel) } else { None };
        }
        turned
    }

    /// Angle about the line from shoulder to wrist that brings an elbow nearest to a place; less for a straight arm.
    fn swivel(&self, now: &[Vector; PROBES], shoulder: Vector, wanted: Vector) -> f32 {
        let Some(axis) = direction(less(now[WRIST], shoulder), 1e-4 * self.rig.volume.size) else { return 0.0 };
        let (from, to) = (aside(less(now[0], shoulder), axis), aside(less(wanted, shoulder), axis));
        let least = (0.02 * self.rig.volume.size) * (0.02 * self.rig.volume.size);
        let (sine, cosine) = (dot(cross(from, to), axis), dot(from, to));
        (sine / (cosine.max(0.0) + least + 0.5 * sine.abs())).clamp(-SWIVEL, SWIVEL)
    }

    /// Limits an arm's movement to its reach, and moves its points.
    fn follow(&self, reach: &Reach, held: &[Vector; PROBES], by: Moved, now: &mut [Vector; PROBES]) -> Moved {
        let most = SHIFT * reach.lengths().iter().sum::<f32>();
        let far = length(by.shift);
        let shift = if far > most { times(by.shift, most / far) } else { by.shift };
        let wrist = reach.reachable(add(reach.at[2], shift));
        let shift = less(wrist, reach.at[2]);
        let elbow = reach.elbow(wrist, by.swivel).unwrap_or(reach.at[1]);
        for (probe, now) in now.iter_mut().enumerate() {
            *now = match FOREARM_SHARES.get(probe) {
                Some(&share) => add(elbow, times(less(wrist, elbow), share)),
                None => add(held[probe], shift),
            };
        }
        Moved { shift, swivel: by.swivel }
    }

    /// Share to which a place at this gap of the source's is kept.
    fn contact(&self, gap: f32) -> f32 {
        let (touch, about) = (self.metres(TOUCH), self.metres(ABOUT));
        smooth((about - gap) / (about - touch))
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
        let weight = inside * self.contact(gap);
        if weight <= 0.0 {
            return ([0.0; 3], 0.0);
        }
        let height = target.ends[0] + share * (target.ends[1] - target.ends[0]);
        let radius = level(target, [near.at[0], height, near.at[2]]);
        let grown = (radius + radii[1] + gap.max(0.0) * self.scale) / far;
        let place = to.place(head, [near.at[0] * grown, height, near.at[2] * grown]);
        (less(place, held), weight)
    }

    /// Shift that puts a hand about trunk and head where the source's is.
    fn about(
        &self,
        to: &Shapes,
        (own, arm): (&Arm, &Arm),
        near: &[[Near; 2]; PROBES],
        held: &[Vector; PROBES],
        probes: std::ops::Range<usize>,
    ) -> Vector {
        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for probe in probes {
            for head in [false, true] {
                if head && to.head.is_none() {
                    continue;
                }
                let near = near[probe][usize::from(head)];
                let (by, weight) = self.astray(to, head, near, [own.radii[probe], arm.radii[probe]], held[probe]);
                // The nearest point counts most.
                let power = weight * weight * weight;
                sum = add(sum, times(by, power * weight));
                weights += power;
            }
        }
        if weights > 0.0 { times(sum, 1.0 / weights) } else { sum }
    }

    /// Shifts of both wrists that keep contacts between the arms, and the arms out of each other.
    fn together(
        &self,
        arms: [(&Arm, &Arm); 2],
        spots: [&[Vector; PROBES]; 2],
        now: [&[Vector; PROBES]; 2],
    ) -> [Vector; 2] {
        let [(left, left_rig), (right, right_rig)] = arms;
        let (about, soft) = (self.metres(ABOUT), self.metres(SOFT) * self.scale);
        let mut shifts = [([0.0; 3], 0.0); 2];
        for i in 0..PROBES {
            for j in 0..PROBES {
                let have = less(now[0][i], now[1][j]);
                let wide = left_rig.radii[i] + right_rig.radii[j];
                let was = less(spots[0][i], spots[1][j]);
                let own = left.radii[i] + right.radii[j];
                let limit = own + about;
                let near = dot(was, was) < limit * limit;
                if !near && dot(have, have) > (wide + soft) * (wide + soft) {
                    continue;
                }
                let far = length(was);
                let gap = far - own;
                let both_hands = i >= WRIST && j >= WRIST;
                let mut pushes = [([0.0; 3], 0.0); 2];
                let weight = if i > WRIST || j > WRIST { self.contact(gap) } else { 0.0 };
                if weight > 0.0 && far > 0.0 {
                    // Points that overlap keep their order.
                    let want = (wide + gap.max(0.0) * self.scale) / far.max(own);
                    let want = times(was, want);
                    pushes[0] = (times(less(want, have), weight * weight), weight);
                }
                let deep = wide - (-gap).max(0.0) * self.scale - length(have);
                let deep = ramp(deep, soft);
                if deep > 0.0
                    && let Some(away) = direction(add(have, times(was, self.scale)), 1e-6 * self.rig.volume.size)
                {
                    let strength = deep / soft;
                    pushes[1] = (times(away, deep * strength), strength);
                }
                for (shift, weight) in pushes {
                    // A forearm is reached by the other hand.
                    let parts = match (both_hands, i >= WRIST) {
                        (true, _) => [0.5, 0.5],
                        (false, true) => [1.0, 0.0],
                        (false, false) if j >= WRIST => [0.0, 1.0],
                        (false, false) => [0.5, 0.5],
                    };
                    for ((sum, weights), (part, sign)) in shifts.iter_mut().zip([(parts[0], 1.0), (parts[1], -1.0)]) {
                        *sum = add(*sum, times(shift, part * sign));
                        *weights += if part > 0.0 { weight } else { 0.0 };
                    }
                }
            }
        }
        shifts.map(|(sum, weights)| if weights > 0.0 { times(sum, 1.0 / weights) } else { sum })
    }

    /// Pushes of an arm out of trunk, head, neck and thighs.
    fn push(
        &self,
        to: &Shapes,
        arm: &Arm,
        near: &[[Near; 2]; PROBES],
        now: &[Vector; PROBES],
        shoulder: Vector,
    ) -> Push {
        let mut push = Push::default();
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
                let deep = ramp(arm.radii[probe] + early - here.gap, soft);
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
                let deep = ramp(arm.radii[probe] + radius - length(away), soft);
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
