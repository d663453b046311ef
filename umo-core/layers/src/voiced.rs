//! What a voice's arousal does to face and body: larger and lifted when it is lively, smaller and lower when it is not
//! (SPEC 2.22).

use umo_core_base::arousal::ORDINARY;
use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::scaled;
use umo_core_pose::skeleton::JAW;

use super::Tick;
use super::rig::{ARMS, DEGREE, HEAD, NECK, Rig, SPINE, angle_between, arkit, ease, step, toward, turn_in_parent};

/// Time constant of each of the two low-passes over the arousal, seconds.
const FILTER_SECONDS: f32 = 0.25;

/// Amount below which nothing changes, and the largest one.
const LEAST: f32 = 1e-3;
const MOST: f32 = 1.4;

/// Joints whose distance from rest is scaled, and the logarithm of the factor for the liveliest voice: arms, trunk, head.
const SCALED: [(usize, f32); 13] = [
    (13, 0.25),
    (14, 0.25),
    (16, 0.6),
    (17, 0.6),
    (18, 0.6),
    (19, 0.6),
    (20, 0.3),
    (21, 0.3),
    (SPINE[0], 0.3),
    (SPINE[1], 0.3),
    (SPINE[2], 0.3),
    (NECK, 0.35),
    (HEAD, 0.35),
];

/// Angle of a joint from an arm that hangs at which the arm counts as raised.
const RAISED: f32 = 55.0 * DEGREE;

/// Posture of the liveliest voice and of the dullest: degrees about X (forward), Y and Z, in the parent's frame.
const LIVELY: [(usize, [f32; 3]); 5] = [
    (SPINE[1], [-1.5, 0.0, 0.0]),
    (SPINE[2], [-1.5, 0.0, 0.0]),
    (HEAD, [-1.5, 0.0, 0.0]),
    (13, [0.0, 0.0, 2.0]),
    (14, [0.0, 0.0, -2.0]),
];
const DULL: [(usize, [f32; 3]); 6] = [
    (SPINE[1], [2.0, 0.0, 0.0]),
    (SPINE[2], [2.5, 0.0, 0.0]),
    (NECK, [3.0, 0.0, 0.0]),
    (HEAD, [4.0, 0.0, 0.0]),
    (13, [0.0, -1.0, -2.5]),
    (14, [0.0, 1.0, 2.5]),
];

/// Face of the liveliest voice and of the dullest: what a shape gets of its room, or loses of itself below 0.
const LIVELY_FACE: [(usize, f32); 7] = [
    (arkit("browInnerUp"), 0.25),
    (arkit("browOuterUpLeft"), 0.3),
    (arkit("browOuterUpRight"), 0.3),
    (arkit("eyeWideLeft"), 0.25),
    (arkit("eyeWideRight"), 0.25),
    (arkit("eyeSquintLeft"), -0.3),
    (arkit("eyeSquintRight"), -0.3),
];
const DULL_FACE: [(usize, f32); 9] = [
    (arkit("browInnerUp"), 0.2),
    (arkit("browOuterUpLeft"), -0.8),
    (arkit("browOuterUpRight"), -0.8),
    (arkit("browDownLeft"), 0.05),
    (arkit("browDownRight"), 0.05),
    (arkit("eyeWideLeft"), -0.8),
    (arkit("eyeWideRight"), -0.8),
    (arkit("eyeBlinkLeft"), 0.18),
    (arkit("eyeBlinkRight"), 0.18),
];

/// Shapes of the mouth's range; closing ones among them, so that closed lips stay closed. Share for the liveliest voice.
const MOUTH: [usize; 2] = [arkit("jawOpen"), arkit("mouthClose")];
const MOUTH_SHARE: f32 = 0.2;

/// How far body and face follow the voice.
#[derive(Debug)]
pub(super) struct Voiced {
    /// Arousal after the first and the second low-pass, less the ordinary one, -0.5 to 0.5.
    halfway: f32,
    now: f32,
}

impl Voiced {
    pub(crate) fn new() -> Self {
        Self { halfway: 0.0, now: 0.0 }
    }

    /// Follows the voice by one tick; returns how lively it is, times the expression: 0 for an ordinary voice, 1 for the liveliest
    /// one at an expression of 0.5.
    pub(crate) fn advance(&mut self, tick: &Tick) -> f32 {
        let share = step(tick.seconds, FILTER_SECONDS);
        self.halfway += share * (tick.cue.arousal - ORDINARY - self.halfway);
        self.now += share * (self.halfway - self.now);
        (2.0 * tick.controls.expression * 2.0 * self.now).clamp(-MOST, MOST)
    }

    /// Applies one tick to the frame.
    pub(crate) fn apply(frame: &mut OwnedFrame, tick: &Tick) {
        let amount = tick.lively * tick.gain;
        if amount.abs() < LEAST {
            return;
        }
        scale(&mut frame.pose, tick.rig, amount);
        let posture: &[_] = if amount > 0.0 { &LIVELY } else { &DULL };
        for &(joint, degrees) in posture {
            turn_in_parent(&mut frame.pose.rotations[joint], degrees.map(|angle| amount.abs() * angle * DEGREE));
        }
        let face: &[_] = if amount > 0.0 { &LIVELY_FACE } else { &DULL_FACE };
        for &(shape, share) in face {
            let value = tick.rig.shape(&frame.face, shape);
            let room = if share > 0.0 { 1.0 - value } else { value };
            tick.rig.set_shape(&mut frame.face, shape, value + amount.abs().min(1.0) * share * room);
        }
        // At rest the mouth stays where it is, however slowly the voice is forgotten.
        speak(frame, tick, amount * tick.weights.speaking);
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        [&mut self.halfway, &mut self.now].into_iter().try_for_each(|value| pass.within(value, -0.5..=0.5))
    }
}

/// Scales the distance of arms, trunk and head from rest.
fn scale(pose: &mut Pose, rig: &Rig, amount: f32) {
    enlarge(pose, rig, amount);
    for (joint, share) in SCALED.into_iter().filter(|(joint, _)| !ARMS.contains(joint)) {
        let rotation = &mut pose.rotations[joint];
        *rotation = scaled(rig.rest.rotations[joint], *rotation, (share * amount).exponential());
    }
}

/// Scales the distance of arms from rest. Arms that hang stay as they are.
pub(super) fn enlarge(pose: &mut Pose, rig: &Rig, amount: f32) {
    if amount == 0.0 {
        return;
    }
    // Left and right in turn.
    let mut raised = [0.0_f32; 2];
    for (at, (&joint, &down)) in ARMS.iter().zip(&rig.arms_down).enumerate() {
        raised[at % 2] = raised[at % 2].max(angle_between(pose.rotations[joint], down) / RAISED);
    }
    for (joint, share) in SCALED {
        let Some(at) = ARMS.iter().position(|&arm| arm == joint) else { continue };
        let rotation = &mut pose.rotations[joint];
        *rotation = scaled(rig.rest.rotations[joint], *rotation, (share * ease(raised[at % 2]) * amount).exponential());
    }
}

/// Opens the mouth more or less.
fn speak(frame: &mut OwnedFrame, tick: &Tick, amount: f32) {
    let open = tick.rig.shape(&frame.face, MOUTH[0]);
    let factor = (1.0 + MOUTH_SHARE * amount).min(1.0 / open.max(1e-3));
    for shape in MOUTH {
        let value = tick.rig.shape(&frame.face, shape);
        tick.rig.set_shape(&mut frame.face, shape, factor * value);
    }
    let jaw = &mut frame.pose.rotations[JAW];
    *jaw = toward(tick.rig.rest.rotations[JAW], *jaw, factor);
}

#[cfg(test)]
mod tests {
    use umo_core_pose::rotation::product;

    use super::super::rig::{angle_between, turn};
    use super::super::trial::{Trial, assert_sound, shape, turned};
    use super::super::{Cue, Layer};
    use super::*;

    /// The frame that a voice of this arousal ends with, over a pose with a raised arm and an open mouth.
    fn shown(layers: &[Layer], expression: f32, arousal: f32) -> (Trial, OwnedFrame) {
        let mut trial = Trial::new(layers, 3);
        trial.controls.expression = expression;
        trial.frame.cue = Cue { arousal, level: 0.1, ..Cue::default() };
        let rotations = &mut trial.frame.pose.rotations;
        rotations[16] = product(turn([0.0, 0.0, 40.0 * DEGREE]), rotations[16]);
        rotations[HEAD] = turn([0.0, 15.0 * DEGREE, 0.0]);
        trial.frame.face[MOUTH[0]] = 0.4;
        trial.frame.face[MOUTH[1]] = 0.1;
        trial.frame.face[arkit("eyeBlinkLeft")] = 0.0;
        let mut before: Option<OwnedFrame> = None;
        for _ in 0..90 {
            let frame = trial.tick();
            assert_sound(&frame);
            if let Some(before) = before {
                let pairs = before.pose.rotations.iter().zip(&frame.pose.rotations);
                let most = pairs.map(|(&a, &b)| angle_between(a, b)).fold(0.0, f32::max);
                assert!(most < 4.0 * DEGREE, "a jump of {}°", most / DEGREE);
            }
            before = Some(frame);
        }
        (trial, before.unwrap())
    }

    #[test]
    fn a_lively_voice_is_larger_and_lifted_and_a_dull_one_smaller_and_low() {
        let [dull, usual, lively] = [0.1, 0.5, 0.9].map(|arousal| shown(&[Layer::Mood], 0.5, arousal));
        let raised = |(trial, frame): &(Trial, OwnedFrame)| {
            angle_between(trial.rig.rest.rotations[16], frame.pose.rotations[16]) / DEGREE
        };
        assert!((38.0..40.0).contains(&raised(&usual)), "{}", raised(&usual));
        assert!(raised(&lively) > 55.0 && raised(&dull) < 30.0, "{} {}", raised(&lively), raised(&dull));
        let pitch = |(trial, frame): &(Trial, OwnedFrame)| turned(trial, frame, HEAD)[1];
        // Downwards is positive.
        assert!(pitch(&dull) > pitch(&usual) + 5.0 && pitch(&lively) < pitch(&usual) - 2.0);
        let value = |(_, frame): &(Trial, OwnedFrame), name| shape(frame, name);
        assert!(value(&lively, "browOuterUpLeft") > 0.2 && value(&lively, "eyeWideLeft") > 0.15);
        assert!(value(&dull, "eyeBlinkLeft") > 0.1);
        // Sad brows: the inner ends rise.
        assert!(value(&dull, "browInnerUp") > value(&usual, "browInnerUp") + 0.1);
        assert!(value(&dull, "browDownLeft") < 0.08);
        let open = |of: &(Trial, OwnedFrame)| value(of, "jawOpen");
        assert!(open(&lively) > 0.45 && open(&dull) < 0.35);
        for of in [&lively, &dull] {
            assert!((value(of, "mouthClose") - 0.25 * open(of)).abs() < 1e-5, "closed lips stay closed");
        }
    }

    #[test]
    fn no_expression_and_an_ordinary_voice_leave_every_bit() {
        let bits = |frame: &OwnedFrame| frame.pose.rotations.as_flattened().to_vec();
        let (_, usual) = shown(&Layer::ALL, 0.0, 0.5);
        for (expression, arousal) in [(0.0, 0.0), (0.0, 1.0), (1.0, 0.5)] {
            let (_, frame) = shown(&Layer::ALL, expression, arousal);
            assert_eq!(bits(&frame), bits(&usual), "{expression} {arousal}");
            assert_eq!(*frame.face, *usual.face);
        }
    }
}
