//! Hands at rest between the phrases of gestures: both, or the one that has no part in a phrase (SPEC 2.21).
//!
//! Gestures come in phrases. Between two of them hands hang beside the thighs, as often as the activity says. What the host
//! asks for, a gesture or a prompt, comes first.

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{IDENTITY, Quat, inverse};

use super::Tick;
use super::gesture::{Arm, ArmTarget, LEFT, RELAXED, RIGHT};
use super::noise::{Stream, uniform};
use super::rig::{SPINE, Soft, after, angle_between, step, toward, turn_vector};

const ARMS: [Arm; 2] = [LEFT, RIGHT];

/// Duration of a phrase, and of a rest at an activity of 0.5: least and most, seconds.
const PHRASE_SECONDS: [f32; 2] = [3.2, 6.5];
const REST_SECONDS: [f32; 2] = [1.3, 2.7];
/// Time by which a phrase or a rest may be longer, until the model's arms are slow, or something begins; seconds.
const GRACE_SECONDS: f32 = 1.2;
/// Cap of the counted time, seconds.
const MOST_SECONDS: f32 = 1e3;
/// Share of the phrases of one hand at an activity of 0.5 and less.
const ONE_HAND: f32 = 0.22;
/// Change of the activity by the liveliest voice.
const LIVELY_SHARE: f32 = 0.12;
/// Weight of the attention from which the avatar speaks, and below which it does not.
const SPEAKS: f32 = 0.5;
const IS_SILENT: f32 = 0.1;

/// Frequencies of the two springs by which a hand goes down and comes up, radians a second: 95 % in 0.9 and in 0.7 s.
const DOWN_RATE: f32 = 8.5;
const UP_RATE: f32 = 10.5;

/// Speed of a wrist in the model's motion below which a stroke ends, and above which one begins; below which it is held, m/s.
const SLOW: f32 = 0.5;
const QUICK: f32 = 0.45;
const HELD: f32 = 0.3;
/// Seconds of a phrase after which hands that are held may go to rest.
const LEAST_PHRASE_SECONDS: f32 = 3.0;
/// Approximate distances from shoulder and elbow to the wrist, metres.
const LEVERS: [f32; 2] = [0.4, 0.25];
/// Time constants of the speed, and of the motion that says which hand is busy, seconds.
const SPEED_SECONDS: f32 = 0.12;
const BUSY_SECONDS: f32 = 2.0;

/// Place of a hanging hand from the shoulder, arm lengths: down along the vertical, outwards and ahead from least to most.
const DOWN: f32 = 0.97;
const OUT: [f32; 2] = [0.095, 0.13];
const AHEAD: [f32; 2] = [0.03, 0.13];
/// Share of the model's fingers that stays.
const OWN_FINGERS: f32 = 0.3;

const DRAWS: Stream = Stream(700);
const PLACES: [Stream; 2] = [Stream(701), Stream(702)];

/// Hands at rest.
#[derive(Debug)]
pub(super) struct Rest {
    is_started: bool,
    /// Whether a phrase of gestures is on, and which hands have a part in it.
    is_up: bool,
    busy: [bool; 2],
    /// Seconds of the present phrase or rest so far, and the draw of how long it lasts.
    since: f32,
    length: f32,
    /// Phrases and rests drawn so far.
    draws: u64,
    hands: [Hand; 2],
}

#[derive(Clone, Copy, Debug)]
struct Hand {
    /// Weight of rest.
    weight: Soft,
    /// Number of the draw of its place.
    place: u64,
    /// Shoulder and elbow of the model at the last tick, speed of its wrist, and the slow mean of that, m/s.
    before: [Quat; 2],
    speed: f32,
    motion: f32,
}

impl Hand {
    const NEW: Self = Self { weight: Soft::ZERO, place: 0, before: [IDENTITY; 2], speed: 0.0, motion: 0.0 };

    /// Measures the model's arm.
    fn measure(&mut self, now: [Quat; 2], seconds: f32) {
        let [shoulder, elbow] = [0, 1].map(|joint| LEVERS[joint] * angle_between(self.before[joint], now[joint]));
        self.before = now;
        let speed = (shoulder + elbow) / seconds;
        self.speed += step(seconds, SPEED_SECONDS) * (speed - self.speed);
        self.motion += step(seconds, BUSY_SECONDS) * (speed - self.motion);
    }
}

impl Rest {
    pub(crate) fn new() -> Self {
        let hands = [Hand::NEW; 2];
        Self { is_started: false, is_up: false, busy: [false; 2], since: 0.0, length: 0.0, draws: 0, hands }
    }

    /// Decides one tick; returns the weight of rest of each hand, 0 to 1.
    pub(crate) fn advance(&mut self, pose: &Pose, tick: &Tick) -> [f32; 2] {
        let activity = tick.controls.activity;
        let is_first = !std::mem::replace(&mut self.is_started, true);
        for (hand, arm) in self.hands.iter_mut().zip(ARMS) {
            let now = [arm.shoulder, arm.elbow].map(|joint| pose.rotations[joint]);
            if is_first {
                hand.before = now;
            }
            hand.measure(now, tick.seconds);
        }
        self.since = (self.since + tick.seconds).min(MOST_SECONDS);
        let free = activity >= 1.0 || tick.cue.prompted > 0.5;
        if free {
            if !self.is_up || self.busy != [true; 2] {
                self.begin(activity, tick);
                self.busy = [true; 2];
            }
        } else if is_first || self.is_up && self.is_over(activity, tick) {
            self.settle(tick);
        } else if !self.is_up && self.is_rested(activity, tick) {
            self.begin(activity, tick);
        }
        for (hand, busy) in self.hands.iter_mut().zip(self.busy) {
            let goal = if busy { 0.0 } else { 1.0 };
            if is_first {
                hand.weight = Soft::at(goal);
            }
            hand.weight.follow(goal, if busy { UP_RATE } else { DOWN_RATE }, tick.seconds);
            // Hands that are up are the model's, bit for bit.
            if busy && hand.weight.is_within(1e-4) {
                hand.weight = Soft::ZERO;
            }
        }
        self.hands.map(|hand| hand.weight.value().clamp(0.0, 1.0))
    }

    /// Whether the phrase ends here.
    fn is_over(&mut self, activity: f32, tick: &Tick) -> bool {
        if tick.weights.speaking < IS_SILENT && tick.cue.onset <= 0.0 && self.since > 1.0 {
            return true;
        }
        let speed = self.hands.iter().zip(self.busy).map(|(hand, busy)| if busy { hand.speed } else { 0.0 });
        let speed = speed.fold(0.0, f32::max);
        let lasts = (0.5 + activity) * between(PHRASE_SECONDS, self.length);
        let is_held = self.since > LEAST_PHRASE_SECONDS && speed < HELD;
        let is_late = self.since > lasts && (speed < SLOW || self.since > lasts + GRACE_SECONDS);
        if !(is_held || is_late) {
            return false;
        }
        // The livelier, the longer: a phrase is followed by another one without a rest.
        let chance = (2.0 - 2.0 * lively(activity, tick)).clamp(0.0, 1.0);
        if self.draw(tick) < chance {
            return true;
        }
        self.begin(activity, tick);
        false
    }

    /// Whether the rest ends here.
    fn is_rested(&self, activity: f32, tick: &Tick) -> bool {
        let activity = lively(activity, tick);
        let lasts = (1.0 - activity) / activity * between(REST_SECONDS, self.length);
        let begins = tick.cue.onset > 0.0 || tick.weights.own.begins;
        if activity <= 0.0 || self.since < lasts || !(begins || tick.weights.speaking > SPEAKS) {
            return false;
        }
        let is_quick = self.hands.iter().any(|hand| hand.speed > QUICK);
        begins || is_quick || tick.weights.own.accent > 0.0 || self.since > lasts + GRACE_SECONDS
    }

    /// Begins a phrase.
    fn begin(&mut self, activity: f32, tick: &Tick) {
        let one = self.draw(tick);
        self.length = self.draw(tick);
        let chance = ONE_HAND * (2.0 - 2.0 * activity).clamp(0.0, 1.0);
        let [left, right] = self.hands.map(|hand| hand.motion + hand.speed);
        let busier = usize::from(right > left);
        self.busy = if one < chance { std::array::from_fn(|side| side == busier) } else { [true; 2] };
        (self.is_up, self.since) = (true, 0.0);
    }

    /// Begins a rest.
    fn settle(&mut self, tick: &Tick) {
        self.length = self.draw(tick);
        (self.is_up, self.busy, self.since) = (false, [false; 2], 0.0);
        for hand in &mut self.hands {
            if hand.weight.value() < 0.05 {
                hand.place = self.draws;
            }
        }
    }

    fn draw(&mut self, tick: &Tick) -> f32 {
        self.draws += 1;
        uniform(tick.seed, DRAWS, self.draws)
    }

    /// Takes the arms down. The trunk's lean does not take them along.
    pub(crate) fn apply(&self, pose: &mut Pose, tick: &Tick) {
        if tick.resting == [0.0; 2] {
            return;
        }
        let trunk = SPINE.into_iter().fold(pose.rotations[0], |turned, joint| after(turned, pose.rotations[joint]));
        let up = turn_vector(inverse(trunk), [0.0, 1.0, 0.0]);
        for ((hand, arm), weight) in self.hands.iter().zip(ARMS).zip(tick.resting) {
            let weight = tick.gain * weight;
            if weight <= 0.0 {
                continue;
            }
            let stream = PLACES[usize::from(arm.side < 0.0)];
            let [out, ahead] = [(OUT, 0), (AHEAD, 1)]
                .map(|(range, which)| between(range, uniform(tick.seed, stream, 2 * hand.place + which)));
            let target = ArmTarget {
                hand: std::array::from_fn(|axis| -DOWN * arm.sided(up)[axis] + [out, 0.0, ahead][axis]),
                elbow: [0.25, 0.0, -1.0],
                fingers: [0.03, -1.0, 0.12],
                palm: [-1.0, 0.0, -0.25],
                shape: RELAXED,
            };
            let low = arm.pose(tick.rig, &target, None);
            let joints = [arm.collar, arm.shoulder, arm.elbow, arm.wrist];
            for (joint, low) in joints.into_iter().zip([low.collar, low.shoulder, low.elbow, low.wrist]) {
                pose.rotations[joint] = toward(pose.rotations[joint], low, weight);
            }
            for (joint, low) in (arm.first_finger..).zip(low.fingers) {
                pose.rotations[joint] = toward(pose.rotations[joint], low, (1.0 - OWN_FINGERS) * weight);
            }
        }
    }

    /// The hands that have a part in the phrase that begins at this tick.
    pub(crate) fn phrase(&self, tick: &Tick) -> Option<[bool; 2]> {
        (self.is_up && self.since < 0.5 * tick.seconds).then_some(self.busy)
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.switch("hands at rest", &mut self.is_started)?;
        pass.switch("hands at rest", &mut self.is_up)?;
        self.busy.iter_mut().try_for_each(|busy| pass.switch("hands at rest", busy).map(drop))?;
        pass.number("hands at rest", &mut self.draws, 1 << 31)?;
        pass.within(&mut self.since, 0.0..=MOST_SECONDS)?;
        pass.share(&mut self.length)?;
        self.hands.iter_mut().try_for_each(|hand| {
            hand.weight.state(pass)?;
            pass.number("hands at rest", &mut hand.place, 1 << 31)?;
            pass.rotations(&mut hand.before)?;
            pass.moderate(std::slice::from_mut(&mut hand.speed))?;
            pass.moderate(std::slice::from_mut(&mut hand.motion))
        })
    }
}

/// Activity with the voice's share.
fn lively(activity: f32, tick: &Tick) -> f32 {
    if activity <= 0.0 { 0.0 } else { (activity + LIVELY_SHARE * tick.lively).clamp(0.05, 1.0) }
}

fn between([least, most]: [f32; 2], t: f32) -> f32 {
    least + (most - least) * t
}

#[cfg(test)]
mod tests {
    use umo_core_pose::frame::OwnedFrame;
    use umo_core_pose::rotation::product;

    use super::super::gesture::{GestureOptions, Gestures, Request};
    use super::super::rig::{DEGREE, turn};
    use super::super::trial::{SECONDS, Trial, assert_sound, speech};
    use super::super::{Cue, Layer};
    use super::*;

    const WRISTS: [usize; 2] = [20, 21];

    fn trial(activity: f32, seed: u64) -> Trial {
        let mut trial = Trial::new(&[Layer::Idle], seed);
        trial.controls.activity = activity;
        trial
    }

    /// Runs ticks of speech or silence, with the model's hands before the waist, in strokes. Returns the heights of the
    /// wrists over the pelvis.
    fn run(trial: &mut Trial, ticks: std::ops::Range<usize>, cue: impl Fn(usize) -> Cue) -> Vec<[f32; 2]> {
        ticks
            .map(|tick| {
                let t = tick as f32 * SECONDS;
                let beat = 20.0 * DEGREE * (4.0 * t).sin() * (0.7 * t).sin();
                let rotations = &mut trial.frame.pose.rotations;
                for (side, arm) in ARMS.into_iter().enumerate() {
                    let raised = turn([-20.0 * DEGREE - beat, 0.0, -75.0 * arm.side * DEGREE]);
                    rotations[arm.shoulder] = raised;
                    rotations[arm.elbow] = turn([0.0, -arm.side * (85.0 * DEGREE + beat * side as f32), 0.0]);
                }
                trial.frame.cue = cue(tick);
                let frame = trial.tick();
                assert_sound(&frame);
                heights(trial, &frame)
            })
            .collect()
    }

    fn heights(trial: &Trial, frame: &OwnedFrame) -> [f32; 2] {
        let (places, _) = trial.rig.world(&frame.pose);
        WRISTS.map(|wrist| places[wrist][1] - places[0][1])
    }

    fn speaks(tick: usize) -> Cue {
        Cue { level: speech(tick), ..Cue::default() }
    }

    /// Share of the time with a hand below the hips.
    fn low(heights: &[[f32; 2]]) -> f32 {
        let low = heights.as_flattened().iter().filter(|&&height| height < -0.02).count();
        low as f32 / heights.as_flattened().len() as f32
    }

    #[test]
    fn hands_rest_in_speech_as_often_as_the_activity_says() {
        for seed in 0..3 {
            let [none, half, most] =
                [0.0, 0.5, 1.0].map(|activity| low(&run(&mut trial(activity, seed), 0..5400, speaks)));
            assert!(none > 0.9, "{seed}: {none}");
            assert!((0.2..0.5).contains(&half), "{seed}: {half}");
            assert!(most == 0.0, "{seed}: {most}");
        }
    }

    #[test]
    fn phrases_last_for_seconds_and_hands_neither_jump_nor_creep() {
        let heights = run(&mut trial(0.5, 5), 0..5400, speaks);
        for side in 0..2 {
            let is_low = |at: &[f32; 2]| at[side] < -0.02;
            let turns: Vec<usize> =
                (1..heights.len()).filter(|&at| is_low(&heights[at]) != is_low(&heights[at - 1])).collect();
            assert!((12..=70).contains(&turns.len()), "{side}: {}", turns.len());
            let speed = |pair: &[[f32; 2]]| (pair[1][side] - pair[0][side]).abs() / SECONDS;
            let fastest = heights.windows(2).map(speed).fold(0.0, f32::max);
            assert!((0.5..1.8).contains(&fastest), "{side}: {fastest} m/s");
        }
    }

    #[test]
    fn hands_go_down_in_silence_and_a_prompt_keeps_them_up() {
        let silence = |_: usize| Cue::default();
        let heights = run(&mut trial(0.5, 1), 0..300, silence);
        assert!(low(&heights) == 1.0);
        let prompted = |_: usize| Cue { prompted: 1.0, ..Cue::default() };
        let mut acts = trial(0.0, 1);
        run(&mut acts, 0..90, silence);
        let heights = run(&mut acts, 90..300, prompted);
        assert!(low(&heights[..3]) == 1.0 && low(&heights[40..]) == 0.0, "up within 1.3 s");
        // Arms are where the model has them.
        let mut still = trial(1.0, 1);
        run(&mut still, 0..90, silence);
        let still = run(&mut still, 90..300, silence);
        let off = still[100..].as_flattened().iter().zip(heights[100..].as_flattened()).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f32::max) < 0.003);
    }

    #[test]
    fn an_asked_hand_comes_up() {
        let mut trial = trial(0.0, 2);
        run(&mut trial, 0..60, speaks);
        let request = Request::new(&Gestures::default(), "wave", &GestureOptions::default(), 30, 0).unwrap();
        trial.controls.gestures.push(request, 0).unwrap();
        let heights = run(&mut trial, 60..150, speaks);
        let highest = heights.iter().map(|height| height[1]).fold(f32::MIN, f32::max);
        assert!(highest > 0.3, "{highest} m");
        assert!(low(&run(&mut trial, 150..300, speaks)[90..]) == 1.0, "it goes down again");
    }

    #[test]
    fn a_full_activity_leaves_every_bit_and_so_does_a_gain_of_0() {
        let mut without = Trial::new(&[], 3);
        without.controls.activity = 0.0;
        let own = run(&mut without, 0..90, speaks);
        assert_eq!(own, run(&mut Trial::new(&[], 3), 0..90, speaks));
        assert_eq!(without.tick().pose, without.frame.pose);
    }

    #[test]
    fn a_hanging_hand_keeps_off_the_thigh_however_the_trunk_leans() {
        for lean in [[0.0; 3], [0.15, 0.0, 0.0], [0.0, 0.0, 0.12], [0.0, 0.3, -0.12]] {
            let mut trial = trial(0.0, 4);
            let spine = &mut trial.frame.pose.rotations[SPINE[0]];
            *spine = product(turn(lean), *spine);
            for _ in 0..60 {
                let frame = trial.tick();
                let (places, _) = trial.rig.world(&frame.pose);
                for (side, wrist) in WRISTS.into_iter().enumerate() {
                    let hip = places[1 + side];
                    let aside = ARMS[side].side * (places[wrist][0] - hip[0]);
                    assert!((0.08..0.35).contains(&aside), "{lean:?} {side}: {aside} m beside the hip");
                    let ahead = places[wrist][2] - hip[2];
                    assert!(ahead.abs() < 0.25, "{lean:?} {side}: {ahead}");
                }
            }
        }
    }

    #[test]
    fn a_saved_state_goes_on_with_the_same_bits() {
        let mut trial = trial(0.5, 6);
        run(&mut trial, 0..200, speaks);
        let bytes = trial.save();
        let want = run(&mut trial, 200..600, speaks);
        let mut other = self::trial(0.5, 6);
        other.load(&bytes);
        assert_eq!(run(&mut other, 200..600, speaks), want);
        assert_ne!(run(&mut self::trial(0.5, 6), 200..600, speaks), want);
    }
}
