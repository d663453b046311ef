//! Moves gesture strokes onto the accents of the voice, for complete recordings (SPEC 2.19).
//!
//! ```text
//! audio units ─► accents ──────┐
//!                              ├─► TimeMap ─► arms, hands, trunk and head read at other times
//! poses ─► turning points ─────┘
//! ```
//!
//! Not for streams, which have shown their frames by the time a later accent is known. Allocates as needed.

use umo_core_base::memory::with_capacity;
use umo_core_model::config::{Accents, Config};
use umo_core_pose::part::Part;
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{Quat, slerp};
use umo_core_pose::skeleton::{Skeleton, UPPER_JOINTS, joint_places, joints_of};

/// Largest shift of a stroke, seconds: 8 frames at 30 a second.
pub const MAX_SHIFT: f64 = 8.0 / 30.0;
/// Largest mean change of the shift per unit of time between two accents.
pub const MAX_SLOPE: f64 = 0.3;
/// Bounds of playback speed: between two accents the shift's steepest slope is one and a half times the mean.
pub const SPEED: [f64; 2] = [1.0 - 1.5 * MAX_SLOPE, 1.0 + 1.5 * MAX_SLOPE];
/// Time on each side within which the speed is lowest at a turning point, seconds.
const TURN: f64 = 7.0 / 30.0;
/// Shorter runs of accented units are noise.
const MIN_RUN: usize = 2;

/// Accents marked by a complete recording's units, in frames, ascending: the middle of each run of accented units,
/// minus the delay.
pub fn accents(config: &Config, said: Accents, units: &[u32]) -> Vec<f64> {
    let frames = config.frame_rate as f64 / config.audio.token_rate as f64;
    let (mut accents, mut first) = (Vec::new(), 0);
    for run in units.chunk_by(|&a, &b| said.marks(a) == said.marks(b)) {
        if run.len() >= MIN_RUN && said.marks(run[0]) {
            let middle = first as f64 + 0.5 * run.len() as f64;
            accents.push((middle - said.delay as f64) * frames);
        }
        first += run.len();
    }
    accents
}

/// Mean speed of the upper body's joints relative to the root, per frame.
fn speeds(skeleton: &Skeleton, poses: &[Pose]) -> Vec<f64> {
    let mut places: Vec<[[f64; 3]; UPPER_JOINTS.len()]> = with_capacity(poses.len());
    places.extend(poses.iter().map(|pose| {
        let places = joint_places(skeleton, &Pose { translation: [0.0; 3], ..*pose });
        UPPER_JOINTS.map(|joint| places[joint].map(f64::from))
    }));
    let last = poses.len().saturating_sub(1);
    let mut speeds = with_capacity(poses.len());
    speeds.extend((0..poses.len()).map(|frame| {
        let (before, after) = (frame.saturating_sub(1), (frame + 1).min(last));
        let lengths = places[before].iter().zip(&places[after]).map(|(a, b)| {
            let square: f64 = a.iter().zip(b).map(|(a, b)| (b - a).powi(2)).sum();
            square.sqrt()
        });
        lengths.sum::<f64>() / (after - before).max(1) as f64
    }));
    speeds
}

/// Frames at which a motion turns: their speed is lower than in all other frames within 7/30 s.
pub fn turning_points(config: &Config, poses: &[Pose]) -> Vec<usize> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most some 60 frames")]
    let near = ((TURN * config.frame_rate as f64).round() as usize).max(1);
    let speeds = speeds(&config.skeleton, poses);
    let is_least = |frame: usize| {
        let others = frame.saturating_sub(near)..(frame + near + 1).min(speeds.len());
        others.into_iter().all(|other| other == frame || speeds[frame] < speeds[other])
    };
    (1..speeds.len().saturating_sub(1)).filter(|&frame| is_least(frame)).collect()
}

/// Map from each frame to the moment of the motion that it shows: `t + shift(t)`.
///
/// The shift is a monotone cubic between knots: it stays between the values of adjacent knots and its derivative is
/// continuous (Fritsch and Butland 1984). So the map is smooth and never decreases.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeMap {
    /// Ascending; the first and last frame are not shifted.
    knots: Vec<Knot>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Knot {
    /// Frame.
    at: f64,
    shift: f64,
    /// Derivative of the shift.
    slope: f64,
}

impl TimeMap {
    /// Creates the map for a motion of `frames` frames that moves its `turns` onto `accents`, both ascending, in
    /// frames. For each accent in order, of the two nearest turns it takes the nearer one that the bounds allow after
    /// the earlier accents.
    pub fn new(frames: usize, frame_rate: usize, accents: &[f64], turns: &[usize]) -> Self {
        let most = MAX_SHIFT * frame_rate as f64;
        let end = frames.saturating_sub(1) as f64;
        let mut knots = vec![Knot { at: 0.0, shift: 0.0, slope: 0.0 }];
        for &accent in accents {
            let Some(&Knot { at, shift, .. }) = knots.last() else { continue };
            let next = turns.partition_point(|&turn| (turn as f64) < accent);
            let near = &turns[next.saturating_sub(2)..(next + 2).min(turns.len())];
            let mut shifts: Vec<f64> = near.iter().map(|&turn| turn as f64 - accent).collect();
            shifts.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
            let allowed = |&new: &f64| {
                new.abs() <= most
                    && (new - shift).abs() <= MAX_SLOPE * (accent - at)
                    && new.abs() <= MAX_SLOPE * (end - accent)
            };
            if at < accent
                && accent < end
                && let Some(&shift) = shifts.iter().take(2).find(|shift| allowed(shift))
            {
                knots.push(Knot { at: accent, shift, slope: 0.0 });
            }
        }
        if knots.len() > 1 {
            knots.push(Knot { at: end, shift: 0.0, slope: 0.0 });
        }
        for i in 1..knots.len().saturating_sub(1) {
            knots[i].slope = slope(&knots[i - 1..=i + 1]);
        }
        Self { knots }
    }

    /// Whether nothing is moved.
    pub fn is_identity(&self) -> bool {
        self.knots.iter().all(|knot| knot.shift == 0.0)
    }

    /// Number of accents that a stroke was moved onto.
    pub fn met(&self) -> usize {
        self.knots.len().saturating_sub(2)
    }

    /// Shift at frame `t`: how much later the moment is that it shows.
    pub fn shift(&self, t: f64) -> f64 {
        let next = self.knots.partition_point(|knot| knot.at <= t);
        let (Some(a), Some(b)) = (next.checked_sub(1).map(|i| self.knots[i]), self.knots.get(next)) else {
            return 0.0;
        };
        let length = b.at - a.at;
        let u = (t - a.at) / length;
        let (rest, way) = (1.0 - u, u * u * (3.0 - 2.0 * u));
        a.shift + (b.shift - a.shift) * way + length * u * rest * (a.slope * rest - b.slope * u)
    }
}

/// Derivative of the shift at the middle of three knots: the weighted harmonic mean of the slopes of the two
/// segments, 0 if one rises and the other falls.
fn slope(knots: &[Knot]) -> f64 {
    let line = |a: Knot, b: Knot| (b.at - a.at, (b.shift - a.shift) / (b.at - a.at));
    let ((before, fall), (after, rise)) = (line(knots[0], knots[1]), line(knots[1], knots[2]));
    if fall * rise <= 0.0 {
        return 0.0;
    }
    let (w_fall, w_rise) = (2.0 * after + before, after + 2.0 * before);
    (w_fall + w_rise) / (w_fall / fall + w_rise / rise)
}

/// Poses with arms, hands, trunk and head taken from the moments that `map` gives. Legs, pelvis, root, jaw and eyes
/// are unchanged, which keeps feet on the ground and lips in sync.
pub fn retimed(poses: &[Pose], map: &TimeMap) -> Vec<Pose> {
    let mut retimed = with_capacity(poses.len());
    retimed.extend_from_slice(poses);
    if map.is_identity() {
        return retimed;
    }
    for (frame, pose) in retimed.iter_mut().enumerate() {
        let shift = map.shift(frame as f64);
        if shift != 0.0 {
            let at = (frame as f64 + shift).clamp(0.0, (poses.len() - 1) as f64);
            for joint in joints_of(Part::Upper).chain(joints_of(Part::Hands)) {
                pose.rotations[joint] = turned(poses, joint, at);
            }
        }
    }
    retimed
}

/// A joint's rotation between frames, interpolated along the shorter arc.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a frame number, and a share")]
fn turned(poses: &[Pose], joint: usize, at: f64) -> Quat {
    let (low, share) = (at.floor() as usize, at.fract() as f32);
    let from = poses[low].rotations[joint];
    if share == 0.0 { from } else { slerp(from, poses[low + 1].rotations[joint], share) }
}

#[cfg(test)]
mod tests {
    use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat};
    use umo_core_pose::skeleton::JOINTS;

    use super::*;
    use proptest::prelude::*;

    const RATE: usize = 30;

    fn map() -> impl Strategy<Value = (usize, Vec<f64>, Vec<usize>)> {
        (0_usize..400).prop_flat_map(|frames| {
            let end = frames as f64 + 20.0;
            let accents = proptest::collection::vec(-20.0..end, 0..40);
            let turns = proptest::collection::btree_set(0..frames.max(1), 0..40);
            (Just(frames), accents, turns).prop_map(|(frames, mut accents, turns)| {
                accents.sort_by(f64::total_cmp);
                (frames, accents, turns.into_iter().collect())
            })
        })
    }

    proptest! {
        #[test]
        fn a_map_is_monotone_bounded_and_ends_where_it_began((frames, accents, turns) in map()) {
            let map = TimeMap::new(frames, RATE, &accents, &turns);
            let end = frames.saturating_sub(1) as f64;
            prop_assert_eq!((map.shift(0.0), map.shift(end)), (0.0, 0.0));
            let steps = 16 * frames.saturating_sub(1);
            let moments: Vec<f64> = (0..=steps).map(|i| i as f64 / 16.0).collect();
            for pair in moments.windows(2) {
                let (from, to) = (map.shift(pair[0]), map.shift(pair[1]));
                prop_assert!(from.abs() <= MAX_SHIFT * RATE as f64 + 1e-9);
                let speed = 1.0 + 16.0 * (to - from);
                prop_assert!((SPEED[0] - 1e-9..=SPEED[1] + 1e-9).contains(&speed), "{} at {:?}", speed, pair);
            }
            for knot in &map.knots {
                // The derivative is continuous, even if another accent follows closely.
                let (before, after) = (map.shift(knot.at - 1e-6), map.shift(knot.at + 1e-6));
                if knot.at > 0.0 && knot.at < end {
                    prop_assert!((1e6 * (after - knot.shift) - knot.slope).abs() < 1e-3);
                    prop_assert!((1e6 * (knot.shift - before) - knot.slope).abs() < 1e-3);
                    prop_assert!(accents.contains(&knot.at));
                    let turn = knot.at + knot.shift;
                    prop_assert!(turns.iter().any(|&other| (other as f64 - turn).abs() < 1e-9));
                }
            }
        }

        #[test]
        fn without_accents_or_turns_nothing_moves((frames, accents, turns) in map()) {
            prop_assert!(TimeMap::new(frames, RATE, &[], &turns).is_identity());
            prop_assert!(TimeMap::new(frames, RATE, &accents, &[]).is_identity());
        }

        #[test]
        fn retimed_poses_have_unit_rotations_on_the_shorter_way(
            turns in proptest::collection::vec((proptest::array::uniform3(-0.2_f32..0.2), any::<bool>()), 60),
            accents in proptest::collection::vec(0.0_f64..60.0, 1..8),
        ) {
            // Steps of at most 0.35 radians, some represented by the negated quaternion.
            let mut angle = [0.0; 3];
            let poses: Vec<Pose> = turns.iter().map(|&(step, is_other)| {
                angle = std::array::from_fn(|axis| angle[axis] + step[axis]);
                let q = axis_angle_to_quat(angle.map(|v: f32| 0.1 * v));
                Pose { rotations: [if is_other { q.map(|v| -v) } else { q }; JOINTS], translation: angle }
            }).collect();
            let mut accents = accents;
            accents.sort_by(f64::total_cmp);
            let map = TimeMap::new(poses.len(), RATE, &accents, &[5, 14, 22, 37, 45, 54]);
            let moved = retimed(&poses, &map);
            prop_assert_eq!(moved.len(), poses.len());
            prop_assert!(moved[0] == poses[0] && moved[59] == poses[59]);
            let moving: Vec<usize> = joints_of(Part::Upper).chain(joints_of(Part::Hands)).collect();
            for (frame, (moved, pose)) in moved.iter().zip(&poses).enumerate() {
                prop_assert_eq!(moved.translation, pose.translation);
                let at = frame as f64 + map.shift(frame as f64);
                #[expect(clippy::cast_possible_truncation, reason = "frame numbers")]
                let (low, high) = (at.floor() as usize, (at.ceil() as usize).min(59));
                for joint in 0..JOINTS {
                    let q = moved.rotations[joint];
                    if moving.contains(&joint) {
                        let length: f32 = q.iter().map(|v| v * v).sum();
                        prop_assert!((length - 1.0).abs() < 1e-5);
                        // No further from either neighbour than these are from each other.
                        let apart = |a: Quat, b: Quat| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>().abs().min(1.0).acos();
                        let (a, b) = (poses[low].rotations[joint], poses[high].rotations[joint]);
                        prop_assert!(apart(q, a) <= apart(a, b) + 2e-3 && apart(q, b) <= apart(a, b) + 2e-3);
                    } else {
                        prop_assert_eq!(q, pose.rotations[joint]);
                    }
                }
            }
        }
    }

    fn config() -> Config {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/umo-people/model.safetensors");
        umo_core_model::weights::ModelFile::open(path.as_ref()).unwrap().config().clone()
    }

    #[test]
    fn accents_are_runs_of_units_less_their_delay() {
        let config = config();
        let said = config.audio.accents.unwrap();
        assert_eq!(said, Accents { first: 512, delay: 14 });
        let mut units = vec![7; 200];
        // A run at the start, a single unit, a run of three, and one at the end.
        for token in [0, 1, 60, 113, 114, 115, 196, 197, 198, 199] {
            units[token] = 600;
        }
        let accents = accents(&config, said, &units);
        // Tokens of 1/50 s, frames of 1/30 s.
        assert_eq!(accents, [-13.0 * 0.6, 100.5 * 0.6, 184.0 * 0.6]);
        assert!(super::accents(&config, said, &[]).is_empty());
    }

    #[test]
    fn accents_that_no_unit_says_are_refused() {
        let good = serde_json::to_string(&config()).unwrap();
        assert!(Config::parse(&good).is_ok());
        for (first, delay, key) in [(0, 14, "first"), (1024, 14, "first"), (512, 51, "delay")] {
            let wrong = format!("\"accents\":{{\"first\":{first},\"delay\":{delay}}}");
            let text = good.replace("\"accents\":{\"first\":512,\"delay\":14}", &wrong);
            assert_ne!(text, good);
            let error = Config::parse(&text).unwrap_err().to_string();
            assert!(error.contains(&format!("audio.accents.{key}")), "{error}");
        }
    }

    /// Swinging arms that turn every `half` frames.
    fn swinging(frames: usize, half: f32) -> Vec<Pose> {
        let angle = |frame: usize| 0.6 * (std::f32::consts::PI * frame as f32 / half).cos();
        let pose = |frame: usize| {
            let mut pose = Pose { rotations: [IDENTITY; JOINTS], translation: [frame as f32, 1.0, 0.0] };
            for (joint, side) in [(16, 1.0), (17, -1.0)] {
                pose.rotations[joint] = axis_angle_to_quat([0.0, side * angle(frame), -1.2 * side]);
            }
            pose.rotations[4] = axis_angle_to_quat([angle(frame), 0.0, 0.0]);
            pose
        };
        (0..frames).map(pose).collect()
    }

    #[test]
    fn strokes_meet_planted_accents() {
        let config = config();
        let poses = swinging(200, 20.0);
        let turns = turning_points(&config, &poses);
        assert_eq!(turns, [20, 40, 60, 80, 100, 120, 140, 160, 180]);
        // Slightly early, late, exact; two for one stroke; one too far from any; one near the end.
        let wanted = [17, 63, 100, 103, 130, 155];
        let accents: Vec<f64> = wanted.map(f64::from).into();
        let map = TimeMap::new(poses.len(), RATE, &accents, &turns);
        assert_eq!(map.met(), 4);
        let moved = retimed(&poses, &map);
        let now = turning_points(&config, &moved);
        for accent in [17, 63, 100, 155] {
            assert!(now.iter().any(|&turn: &usize| turn.abs_diff(accent) <= 1), "{accent}: {now:?}");
        }
        assert_eq!(now.len(), turns.len());
        // Legs, the root and the ends do not move.
        assert!(
            moved.iter().zip(&poses).all(|(a, b)| a.rotations[4] == b.rotations[4] && a.translation == b.translation)
        );
        assert!(moved[0] == poses[0] && moved[199] == poses[199]);
    }
}
