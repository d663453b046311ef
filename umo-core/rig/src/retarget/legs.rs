//! Plants the feet: legs of other proportions are bent until the feet are where the source's are.
//!
//! A foot of the rig moves as the source's does, to scale, starting from its rest position. If the rig's stance is
//! wider or narrower than the source's, the rig keeps its stance, which turns with the foot. A foot that the source
//! does not move therefore stays in place, whatever the body does above it. The planted point is the ankle, or the
//! ball of the foot when the heel is up.

use umo_core_pose::rotation::{IDENTITY, Quat, inverse, normalized, product, rotate};
use umo_core_pose::skeleton::JOINTS;

use super::align::{Rest, Vector, aside, cross, direction, dot, length, less, shortest};
use super::ground::Ground;
use super::rig::World;
use super::{Mapping, Retarget, Rig};

/// Heel rise of the source, in metres, over which the planted point changes from the ankle to the ball.
const ROLL: f32 = 0.02;

/// Upper bound on how far the hips sink for a foot out of reach, as a share of leg length.
const SINK: f32 = 0.15;

/// Tolerance of a foot's position, relative to leg length.
const THERE: f32 = 1e-4;

/// A foot joint and its bone.
#[derive(Clone, Copy, Debug)]
struct Point {
    joint: usize,
    bone: usize,
    /// Offset from the source's scaled position to the rig's when both stand, in the source's axes and the rig's
    /// unit.
    apart: Vector,
    /// Height of the source's joint when it stands, in metres.
    height: f32,
}

/// A leg of a rig.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leg {
    thigh: usize,
    shin: usize,
    /// The source's knee, which bends about its X axis.
    knee: usize,
    ankle: Point,
    ball: Option<Point>,
    /// Lengths of thigh and shin, in the rig's unit.
    lengths: [f32; 2],
}

fn add(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

fn times(a: Vector, by: f32) -> Vector {
    a.map(|x| x * by)
}

impl Leg {
    /// Returns the leg of a side; `None` if one of its bones is missing or has no length.
    pub(super) fn new(
        rig: &Rig,
        mapping: &Mapping,
        turns: &[Quat; JOINTS],
        side: usize,
        ground: &Ground,
        axes: Quat,
        rest: &Rest,
    ) -> Option<Self> {
        let [hip, knee, ankle, ball] = [1, 4, 7, 10].map(|joint| joint + side);
        let (thigh, shin, foot) = (mapping.bone(hip)?, mapping.bone(knee)?, mapping.bone(ankle)?);
        let bones = [less(rig.place(shin), rig.place(thigh)), less(rig.place(foot), rig.place(shin))];
        let lengths = bones.map(length);
        let hips = rig.place(mapping.bone(0)?);
        if lengths.iter().any(|&length| length <= 1e-3 * (lengths[0] + lengths[1])) {
            return None;
        }
        // Ankle position when the legs are posed like the source's at rest.
        let knee_at = add(rig.place(thigh), rotate(turns[hip], bones[0]));
        let ankle_at = add(knee_at, rotate(turns[knee], bones[1]));
        let point = |joint: usize, bone: usize, at: Vector| {
            let scaled = rotate(axes, times(rest[joint], ground.scale));
            let mut apart = rotate(inverse(axes), less(less(at, hips), scaled));
            // The height offset is taken from the rig's actual rest pose.
            apart[1] = dot(less(rig.place(bone), hips), ground.up) - ground.scale * rest[joint][1];
            Point { joint, bone, apart, height: ground.standing + rest[joint][1] }
        };
        let ball = mapping.bone(ball).map(|bone| {
            let apart = rotate(turns[ankle], less(rig.place(bone), rig.place(foot)));
            point(ball, bone, add(ankle_at, apart))
        });
        Some(Self { thigh, shin, knee, ankle: point(ankle, foot, ankle_at), ball, lengths })
    }

    /// Target position of the ankle.
    fn wanted(&self, ground: &Ground, axes: Quat, source: &[World; JOINTS], world: &[World]) -> Option<Vector> {
        let ankle = source[self.ankle.joint];
        // Rotation of the foot about up.
        let yaw = normalized([0.0, ankle.rotation[1], 0.0, ankle.rotation[3]]);
        let place = |point: &Point| {
            let scaled = ground.place(axes, source[point.joint].place)?;
            Some(add(scaled, rotate(axes, rotate(yaw, point.apart))))
        };
        let by_ankle = place(&self.ankle)?;
        let Some(ball) = &self.ball else { return Some(by_ankle) };
        let foot = less(world[ball.bone].place, world[self.ankle.bone].place);
        let by_ball = less(place(ball)?, foot);
        let height = |point: &Point| source[point.joint].place[1] - point.height;
        let heel = height(&self.ankle) - height(ball);
        let share = (heel / ROLL + 0.5).clamp(0.0, 1.0);
        Some(std::array::from_fn(|i| by_ankle[i] + share * (by_ball[i] - by_ankle[i])))
    }

    /// Distance that the hips must sink for a leg that begins at `hip` to reach `wanted`.
    fn sink(&self, hip: Vector, wanted: Vector, up: Vector) -> f32 {
        let reach = self.lengths[0] + self.lengths[1];
        let way = less(hip, wanted);
        let (high, wide) = (dot(way, up), length(aside(way, up)));
        if high * high + wide * wide <= reach * reach {
            return 0.0;
        }
        (high - (reach * reach - wide * wide).max(0.0).sqrt()).clamp(0.0, SINK * reach)
    }

    /// World rotations of thigh and shin that bring the ankle to `wanted`. `at` are the positions of hip, knee and
    /// ankle; `ahead` is the direction in which a straight knee bends.
    fn bend(&self, at: [Vector; 3], wanted: Vector, ahead: Vector) -> Option<[Quat; 2]> {
        let [thigh, shin] = self.lengths;
        let reach = thigh + shin;
        let off = less(wanted, at[2]);
        let size = length(off);
        // Subtracting the tolerance keeps this continuous: near the target, the leg hardly moves.
        let wanted = add(at[2], times(off, (1.0 - THERE * reach / size.max(f32::MIN_POSITIVE)).max(0.0)));
        if wanted == at[2] {
            return None;
        }
        let now = direction(less(at[2], at[0]), 1e-3 * reach)?;
        let to = direction(less(wanted, at[0]), 1e-3 * reach)?;
        let far = length(less(wanted, at[0])).clamp((thigh - shin).abs() * 1.001 + 1e-4 * reach, reach);
        let along = (thigh * thigh - shin * shin + far * far) / (2.0 * far);
        let out = (thigh * thigh - along * along).max(0.0).sqrt();
        let turn = shortest(now, to, ahead);
        // The knee stays on its side; any further bend is about the knee's hinge.
        let side = rotate(turn, aside(less(at[1], at[0]), now));
        let more = (out - length(side)).max(0.0);
        let ahead = direction(aside(rotate(turn, ahead), to), 1e-3).unwrap_or([0.0; 3]);
        let side = direction(add(side, times(ahead, more)), 1e-6 * reach)?;
        let knee = add(at[0], add(times(to, along), times(side, out)));
        let ankle = add(at[0], times(to, far));
        let swing = |from: Vector, to: Vector| {
            let from = rotate(turn, direction(from, 0.0)?);
            Some(product(shortest(from, direction(to, 0.0)?, ahead), turn))
        };
        Some([swing(less(at[1], at[0]), less(knee, at[0]))?, swing(less(at[2], at[1]), less(ankle, knee))?])
    }
}

impl Retarget {
    /// Rotates the legs whose feet are not at the source's positions, writing to `rotations`. Returns the rise of the
    /// hips: `lift`, or less if a leg would be too short. `world` holds all bones before this correction.
    pub(super) fn plant(&self, source: &[World; JOINTS], world: &[World], lift: f32, rotations: &mut [Quat]) -> f32 {
        let up = self.ground.up;
        let legs = self.legs.each_ref().map(|leg| {
            let leg = leg.as_ref()?;
            let is_driven = [leg.thigh, leg.shin, leg.ankle.bone].iter().all(|&bone| self.driven[bone].is_some());
            let wanted = leg.wanted(&self.ground, self.axes, source, world).filter(|_| is_driven)?;
            wanted.iter().all(|x| x.is_finite()).then_some((leg, wanted))
        });
        let raised = |bone: usize, lift: f32| add(world[bone].place, times(up, lift));
        let sink = |(leg, wanted): &(&Leg, Vector)| leg.sink(raised(leg.thigh, lift), *wanted, up);
        let lift = lift - legs.iter().flatten().map(sink).fold(0.0, f32::max);
        for (leg, wanted) in legs.into_iter().flatten() {
            let bones = [leg.thigh, leg.shin, leg.ankle.bone];
            let hinge = rotate(self.axes, rotate(source[leg.knee].rotation, [1.0, 0.0, 0.0]));
            let at = bones.map(|bone| raised(bone, lift));
            let ahead = cross(less(at[2], at[0]), hinge);
            let Some([thigh, shin]) = leg.bend(at, wanted, direction(ahead, 0.0).unwrap_or([0.0; 3])) else { continue };
            // A bone's parent turns with the leg above it; the foot keeps its world rotation.
            let turned = [(IDENTITY, thigh), (thigh, shin), (shin, IDENTITY)];
            for (bone, (above, own)) in bones.into_iter().zip(turned) {
                let parent = self.bones[bone].parent.map_or(IDENTITY, |parent| world[parent].rotation);
                rotations[bone] = product(inverse(product(above, parent)), product(own, world[bone].rotation));
            }
        }
        lift
    }
}
