//! Gain of each layer at a tick: gains that change at any time without a jump.

use umo_core_base::state::{StateError, StatePass};

use super::{LAYERS, LayerGains};

/// Seconds of the linear ramp from 0 to 1, before averaging.
const RAMP_SECONDS: f32 = 0.3;
/// Ticks over which the ramp is averaged, so that it starts and ends softly. A power of two, so that the
/// mean of equal gains is exact.
const MEAN_TICKS: usize = 4;

/// Current gains.
#[derive(Debug)]
pub(super) struct Gains {
    /// Gains of the last ticks, oldest first, each moving to its target at a limited rate.
    recent: [[f32; LAYERS]; MEAN_TICKS],
    /// Whether a tick has run.
    is_started: bool,
}

impl Gains {
    pub(crate) fn new() -> Self {
        Self { recent: [[0.0; LAYERS]; MEAN_TICKS], is_started: false }
    }

    /// Whether every gain is 0 and stays 0.
    pub(super) fn are_off(&self, set: &LayerGains) -> bool {
        set.is_off() && (!self.is_started || self.recent == [[0.0; LAYERS]; MEAN_TICKS])
    }

    /// Advances by one tick and returns its gains; the first tick starts at the targets.
    pub(crate) fn advance(&mut self, set: &LayerGains, seconds: f32) -> [f32; LAYERS] {
        if !std::mem::replace(&mut self.is_started, true) {
            self.recent = [set.gains; MEAN_TICKS];
        }
        let most = seconds / RAMP_SECONDS;
        let mut next = self.recent[MEAN_TICKS - 1];
        for (gain, set) in next.iter_mut().zip(set.gains) {
            // The target is reached exactly, despite rounding.
            *gain = if (set - *gain).abs() < 1.001 * most { set } else { *gain + most.copysign(set - *gain) };
        }
        self.recent.rotate_left(1);
        self.recent[MEAN_TICKS - 1] = next;
        let [a, b, c, d] = &self.recent;
        std::array::from_fn(|layer| 0.25 * ((a[layer] + b[layer]) + (c[layer] + d[layer])))
    }

    /// Saves or loads the gains between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.recent.as_flattened_mut().iter_mut().try_for_each(|gain| pass.share(gain))?;
        pass.switch("layers", &mut self.is_started)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use umo_core_pose::frame::OwnedFrame;
    use umo_core_pose::skeleton::ARKIT_NAMES;

    use super::super::rig::{DEGREE, EYES, add, angle_between, arkit, turn};
    use super::super::trial::{SECONDS, Trial, assert_sound};
    use super::super::{Cue, Layer, Mood};
    use super::*;

    /// Joints of the legs, and the share of their turns that counts: a step swings them.
    const LEGS: [usize; 6] = [1, 2, 4, 5, 7, 8];
    const STEP_SHARE: f32 = 0.25;
    /// Number of ticks of a change.
    const TICKS: usize = 12;

    fn set(trial: &mut Trial, layer: Layer, gain: f32) {
        trial.controls.layers = trial.controls.layers.with(layer, gain);
    }

    /// A figure with work for every layer: its decoders frown, close the eyes and move the pelvis, and it
    /// has a mood and a look-at target.
    fn trial(is_on: bool) -> Trial {
        let mut trial = Trial::new(if is_on { &Layer::ALL } else { &[] }, 3);
        for shape in ["browDownLeft", "browDownRight", "eyeBlinkLeft", "eyeBlinkRight", "mouthSmileLeft"] {
            trial.frame.face[arkit(shape)] = 0.6;
        }
        (trial.controls.mood, trial.controls.mood_strength) = (Mood::Sad, 1.0);
        (trial.controls.look_at, trial.controls.look_at_strength) = ([1.0, 1.4, 1.0], 1.0);
        trial
    }

    /// Runs one tick, in speech or silence.
    fn tick(trial: &mut Trial, number: usize, is_speech: bool) -> OwnedFrame {
        let level = if is_speech { super::super::trial::speech(number) } else { 0.0 };
        trial.frame.cue = Cue { level, ..Cue::default() };
        let time = number as f32 * SECONDS;
        let sway = [0.03 * (1.3 * time).sin(), 0.0, 0.02 * (0.9 * time).cos()];
        trial.frame.pose.translation = add(super::super::trial::standing().translation, sway);
        let frame = trial.tick();
        assert_sound(&frame);
        frame
    }

    /// Returns the largest steps between two frames: degrees of a joint except the eyes, metres of the root,
    /// and change of a face shape except eyes and lids, whose saccades and blinks are fast.
    fn steps(from: &OwnedFrame, to: &OwnedFrame) -> [f32; 3] {
        let joints = from.pose.rotations.iter().zip(&to.pose.rotations).enumerate();
        let turned = joints.filter(|(joint, _)| !EYES.contains(joint)).map(|(joint, (&a, &b))| {
            let share = if LEGS.contains(&joint) { STEP_SHARE } else { 1.0 };
            share * angle_between(a, b)
        });
        let ways = from.pose.translation.iter().zip(to.pose.translation).map(|(a, b)| (a - b).abs());
        let shapes = from.face.iter().zip(&to.face).zip(ARKIT_NAMES);
        let shapes = shapes.filter(|(_, name)| !name.starts_with("eye")).map(|((a, b), _)| (a - b).abs());
        [turned.fold(0.0, f32::max) / DEGREE, ways.fold(0.0, f32::max), shapes.fold(0.0, f32::max)]
    }

    /// Asserts limits on the steps: an eighth of a face shape's range, 4 degrees of a joint (a look-at turns
    /// the head by 50), and 2.5 cm of the root.
    fn assert_small(steps: [f32; 3], what: &str) {
        assert!(steps[0] < 4.0 && steps[1] < 0.025 && steps[2] < 0.125, "{what}: {steps:?}");
    }

    #[test]
    fn nothing_jumps_when_a_gain_is_switched() {
        for is_speech in [false, true] {
            for layer in Layer::ALL {
                for others_are_on in [false, true] {
                    let mut trial = trial(others_are_on);
                    let mut before = None;
                    for number in 0..420 {
                        // On and off, also during a transition.
                        if [20, 110, 115, 200, 290, 293].contains(&number) {
                            let gain = trial.controls.layers.gain(layer);
                            set(&mut trial, layer, 1.0 - gain);
                        }
                        let frame = tick(&mut trial, number, is_speech);
                        if let Some(before) = before {
                            assert_small(steps(&before, &frame), &format!("{layer:?} {is_speech} tick {number}"));
                        }
                        before = Some(frame);
                    }
                }
            }
        }
    }

    #[test]
    fn lids_and_eyes_come_to_the_gaze_without_a_jump() {
        let mut trial = trial(false);
        trial.controls.look_at_strength = 0.0;
        let lid = |frame: &OwnedFrame| frame.face[arkit("eyeBlinkLeft")];
        let mut before = tick(&mut trial, 0, false);
        assert_eq!(lid(&before), 0.6);
        // The layer's first blink is at least a second after its start.
        set(&mut trial, Layer::Gaze, 1.0);
        for number in 1..28 {
            let frame = tick(&mut trial, number, false);
            assert!((lid(&frame) - lid(&before)).abs() < 0.1, "tick {number}");
            before = frame;
        }
        assert!(lid(&before) < 0.1);
    }

    #[test]
    fn eyes_without_shapes_go_over_to_the_gaze_and_back() {
        use super::super::trial::{face, skeleton, standing};
        let mut trial = Trial::of(&[], 3, &skeleton(), &face(false), &standing());
        let decoded = turn([0.0, 20.0 * DEGREE, 0.0]);
        trial.frame.pose.rotations[EYES[0]] = decoded;
        let eye = |frame: &OwnedFrame| frame.pose.rotations[EYES[0]];
        assert_eq!(eye(&trial.tick()), decoded);
        set(&mut trial, Layer::Gaze, 1.0);
        let first = trial.tick();
        assert!(angle_between(eye(&first), decoded) < 3.0 * DEGREE);
        let there = trial.ticks(TICKS).pop().unwrap();
        assert!(angle_between(eye(&there), decoded) > 5.0 * DEGREE);
        set(&mut trial, Layer::Gaze, 0.0);
        let last = trial.ticks(TICKS - 1).pop().unwrap();
        assert!(angle_between(eye(&last), decoded) < 3.0 * DEGREE);
        assert_eq!(eye(&trial.tick()), decoded);
    }

    #[test]
    fn a_start_has_the_gains_that_are_set_and_a_change_ends_exactly() {
        let with = |gain| LayerGains::OFF.with(Layer::Idle, gain);
        let mut gains = Gains::new();
        let idle = Layer::Idle as usize;
        assert!(gains.are_off(&LayerGains::OFF) && !gains.are_off(&with(0.3)));
        assert_eq!(gains.advance(&with(0.7), SECONDS)[idle], 0.7);
        let way: Vec<f32> = (0..TICKS).map(|_| gains.advance(&with(0.1), SECONDS)[idle]).collect();
        assert!(way.is_sorted_by(|a, b| a >= b) && way[0] > 0.6 && way[TICKS - 1] == 0.1, "{way:?}");
        // From 0 to 1 in exactly 0.4 s.
        let mut gains = Gains::new();
        gains.advance(&LayerGains::OFF, SECONDS);
        let way: Vec<f32> = (0..TICKS).map(|_| gains.advance(&LayerGains::ON, SECONDS)[idle]).collect();
        assert!(way[0] < 0.05 && way[TICKS - 3] < 1.0 && way[TICKS - 1] == 1.0, "{way:?}");
        // Not off before its last tick.
        (0..TICKS).for_each(|_| {
            assert!(!gains.are_off(&LayerGains::OFF));
            gains.advance(&LayerGains::OFF, SECONDS);
        });
        assert!(gains.are_off(&LayerGains::OFF));
    }

    #[test]
    fn moods_and_looks_begin_and_end_without_a_jump() {
        let mut trial = trial(true);
        trial.controls.look_at_strength = 0.0;
        let mut before = None;
        for number in 0..900 {
            let is_on = f32::from(u8::from(number / 90 % 2 == 1));
            trial.controls.mood = Mood::ALL[1 + number / 180 % 6];
            (trial.controls.mood_strength, trial.controls.look_at_strength) = (is_on, is_on);
            // A near target: the eyes converge.
            trial.controls.look_at = [0.3, 1.45, 0.35];
            let frame = tick(&mut trial, number, number > 450);
            if let Some(before) = before {
                let [turned, way, shape] = steps(&before, &frame);
                // A look-at itself turns the head, hence the larger limit.
                assert!(turned < 8.0 && way < 0.02 && shape < 0.1, "tick {number}: {turned} {way} {shape}");
            }
            before = Some(frame);
        }
    }
}
