//! Breath, sway, weight shifts, and small continuous motion of arms, hands and fingers.
//!
//! Turns are about the parent's axes: X tilts forward, Y turns to the left, Z raises the left side.

use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{IDENTITY, Quat};
use umo_core_pose::skeleton::{FIRST_FINGER, JAW};

use super::Tick;
use super::inhale::Inhale;
use super::noise::{Stream, smooth, uniform};
use super::rig::{
    DEGREE, HEAD, NECK, SPINE, angle_between, arkit, ease, length_of_two, step, turn_in_own, turn_in_parent,
    turn_vector,
};

const PELVIS: usize = 0;
const HIPS: [usize; 2] = [1, 2];
const ANKLES: [usize; 2] = [7, 8];
const COLLARS: [usize; 2] = [13, 14];
const SHOULDERS: [usize; 2] = [16, 17];
const ELBOWS: [usize; 2] = [18, 19];
const WRISTS: [usize; 2] = [20, 21];

/// 1 if a joint's limb points to +X at rest (the left side), -1 if it points to -X.
const SIDES: [f32; 2] = [1.0, -1.0];

/// Breaths per second, and relative variation of the rate.
const BREATHS_PER_SECOND: f32 = 14.0 / 60.0;
const BREATH_RATE_VARIATION: f32 = 0.3;

/// Share of a breath that is inhalation.
const INHALATION_SHARE: f32 = 0.42;

/// By how much an idle breath is faster and deeper after long shouting.
const HARD_RATE: f32 = 1.2;
const HARD_DEPTH: f32 = 1.5;

/// Inhalation before a phrase, relative to an idle breath; the head's lift, and the jaw at it and at a jawOpen of 1.
const INHALATION: f32 = 1.4;
const HEAD_LIFT_DEGREES: f32 = 1.2;
const LIPS_PARTED: f32 = 0.05;
const JAW_DEGREES: f32 = 20.0;
const JAW_OPEN: usize = arkit("jawOpen");

/// Direction changes per second of the sway, the arms' drift and the fingers.
const SWAY_RATE: f64 = 0.35;
const ARM_RATE: f64 = 0.5;
const FINGER_RATE: f64 = 0.6;
const WRIST_RATE: f64 = 0.7;

/// Standard deviation of the noise.
const NOISE_DEVIATION: f32 = 0.4;

/// Standard deviation of the pelvis' sway, metres: sideways and forward.
const SWAY: [f32; 2] = [0.004, 0.004];

/// Standard deviation of the sway of each trunk joint, degrees: forward, to the left, sideways.
const TRUNK_SWAY: [f32; 3] = [0.35, 0.5, 0.3];

/// Ranges of the interval between weight shifts (seconds), duration (seconds) and distance (metres).
const SHIFT_INTERVAL_SECONDS: [f32; 2] = [6.0, 15.0];
const SHIFT_DURATION_SECONDS: [f32; 2] = [1.3, 2.2];
const SHIFT_DISTANCE: [f32; 2] = [0.013, 0.026];
/// Share by which the liveliest voice shifts the weight further and sooner, and lets the arms drift further and faster.
const LIVELY_SHARE: f32 = 0.3;

/// Pelvis rotation per metre of a shift, degrees: roll and yaw.
const SHIFT_ROLL_PER_METRE: f32 = 70.0;
const SHIFT_YAW_PER_METRE: f32 = 60.0;

/// Share of the pelvis' rotation that the trunk compensates.
const TRUNK_COMPENSATION: f32 = 0.85;

/// Cycles per second of an arm's drift, relative variation of the rate, and amplitudes in degrees.
const ARM_DRIFT_RATE: f32 = 0.36;
const ARM_DRIFT_RATE_VARIATION: f32 = 0.35;
/// Delay of the forearm behind the upper arm, cycles.
const FOREARM_LAG_CYCLES: f32 = 0.08;
const ARM_SWING_DEGREES: f32 = 2.3;
const ELBOW_FLEX_DEGREES: f32 = 4.3;
const ARM_SPREAD_DEGREES: f32 = 1.5;
const ARM_TWIST_DEGREES: f32 = 3.0;

/// Wrist speeds in the model's motion, m/s: below the first the drift is full, above the second least.
const STILL_WRIST_SPEED: f32 = 0.15;
const LIVELY_WRIST_SPEED: f32 = 0.6;

/// Share of the drift, and of the finger motion, that remains while the arm is lively.
const MIN_DRIFT_SHARE: f32 = 0.5;
const MIN_FINGER_SHARE: f32 = 0.35;
/// Share of the drift of an arm that hangs.
const HANGING_SHARE: f32 = 0.5;

/// Approximate distances from shoulder and elbow to the wrist, metres.
const SHOULDER_LEVER: f32 = 0.4;
const ELBOW_LEVER: f32 = 0.25;

/// Time constants of the measured speed when rising and falling, seconds.
const SPEED_RISE_SECONDS: f32 = 0.2;
const SPEED_FALL_SECONDS: f32 = 0.35;

/// Amplitudes of the wrist's drift and of a finger's curl and spread, degrees.
const WRIST_DRIFT_DEGREES: f32 = 3.5;
const HAND_CURL_DEGREES: f32 = 3.0;
const FINGER_CURL_DEGREES: f32 = 3.5;
const FINGER_SPREAD_DEGREES: f32 = 1.2;

/// Relative curl of each joint of a finger.
const PHALANX_CURL: [f32; 3] = [0.9, 1.1, 0.6];

const BREATH: Stream = Stream(200);
const SWAYS: Stream = Stream(201);
const TRUNK: Stream = Stream(202);
const SHIFT: Stream = Stream(203);
const PACE: Stream = Stream(204);
const ARMS: [Stream; 2] = [Stream(205), Stream(206)];
const HANDS: [Stream; 2] = [Stream(207), Stream(208)];
const FINGERS: [[Stream; 2]; 2] = [[Stream(209), Stream(210)], [Stream(211), Stream(212)]];

/// Idle motion.
#[derive(Debug)]
pub(super) struct Idle {
    is_started: bool,
    /// Phases of the breath and of the arms' drift, 0 to 1.
    breath: f32,
    drift: f32,
    inhale: Inhale,
    shift: Shift,
    arms: [Arm; 2],
}

impl Idle {
    pub(crate) fn new() -> Self {
        Self {
            is_started: false,
            breath: 0.0,
            drift: 0.0,
            inhale: Inhale::new(),
            shift: Shift::default(),
            arms: [Arm::default(), Arm::default()],
        }
    }

    /// Applies one tick to the frame.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, tick: &Tick) {
        if !std::mem::replace(&mut self.is_started, true) {
            self.breath = uniform(tick.seed, BREATH, 0);
            self.drift = uniform(tick.seed, BREATH, 1);
            self.shift.left = 2.0 + 5.0 * uniform(tick.seed, BREATH, 3);
            for (side, arm) in self.arms.iter_mut().enumerate() {
                arm.before = arm_of(&frame.pose, side);
            }
        }
        let lively = [0, 1].map(|side| self.arms[side].measure(arm_of(&frame.pose, side), tick.seconds));
        let pace = smooth(tick.seed, PACE, tick.time(), ARM_RATE);
        self.breathe(frame, tick, pace[2]);
        self.stand(&mut frame.pose, tick);
        let rate = ARM_DRIFT_RATE * (1.0 + ARM_DRIFT_RATE_VARIATION * pace[0]) * (1.0 + LIVELY_SHARE * tick.lively);
        self.drift = advanced(self.drift, rate * tick.seconds);
        for (side, lively) in lively.into_iter().enumerate() {
            self.move_arm(&mut frame.pose, tick, side, pace[1], lively);
            move_hand(&mut frame.pose, tick, side, lively);
        }
    }

    /// Raises and lowers chest and shoulders.
    fn breathe(&mut self, frame: &mut OwnedFrame, tick: &Tick, pace: f32) {
        let hard = self.inhale.hard(tick);
        let rate = BREATHS_PER_SECOND * (1.0 + BREATH_RATE_VARIATION * pace) * (1.0 + HARD_RATE * hard);
        self.breath = advanced(self.breath, rate * tick.seconds);
        let at = self.breath;
        let air = if at < INHALATION_SHARE {
            ease(at / INHALATION_SHARE)
        } else {
            ease((1.0 - at) / (1.0 - INHALATION_SHARE))
        };
        let [more, parted] = self.inhale.advance(tick);
        let deep = tick.gain * ((1.0 + HARD_DEPTH * hard) * (air - 0.5) + INHALATION * more) * DEGREE;
        let rotations = &mut frame.pose.rotations;
        turn_in_parent(&mut rotations[SPINE[1]], [-0.7 * deep, 0.0, 0.0]);
        turn_in_parent(&mut rotations[SPINE[2]], [-1.2 * deep, 0.0, 0.0]);
        // The head stays level.
        turn_in_parent(&mut rotations[NECK], [1.2 * deep, 0.0, 0.0]);
        turn_in_parent(&mut rotations[HEAD], [0.4 * deep - HEAD_LIFT_DEGREES * tick.gain * more * DEGREE, 0.0, 0.0]);
        for (side, sign) in SIDES.into_iter().enumerate() {
            turn_in_parent(&mut rotations[COLLARS[side]], [0.0, -0.6 * sign * deep, 2.0 * sign * deep]);
            turn_in_parent(&mut rotations[SHOULDERS[side]], [0.6 * deep, 0.0, -1.3 * sign * deep]);
        }
        if parted > 0.0 {
            let open = tick.rig.shape(&frame.face, JAW_OPEN);
            let parted = (1.0 - open) * LIPS_PARTED * tick.gain * parted;
            tick.rig.set_shape(&mut frame.face, JAW_OPEN, open + parted);
            turn_in_parent(&mut frame.pose.rotations[JAW], [JAW_DEGREES * parted * DEGREE, 0.0, 0.0]);
        }
    }

    /// Sways the body over the feet and shifts its weight between them.
    fn stand(&mut self, pose: &mut Pose, tick: &Tick) {
        let sway = smooth(tick.seed, SWAYS, tick.time(), SWAY_RATE);
        let trunk = smooth(tick.seed, TRUNK, tick.time(), SWAY_RATE);
        let mut shifted = self.shift.advance(tick);
        if tick.shift != 0.0 {
            shifted += tick.shift;
        }
        let gain = tick.gain;
        let aside = gain * (shifted + SWAY[0] / NOISE_DEVIATION * sway[0]);
        let ahead = gain * SWAY[1] / NOISE_DEVIATION * sway[1];
        // Sideways and forward relative to the pelvis' heading.
        let [x, _, z] = turn_vector(pose.rotations[PELVIS], [0.0, 0.0, 1.0]);
        let flat = length_of_two(x, z).max(1e-3);
        let [sin, cos] = [x / flat, z / flat];
        pose.translation[0] += aside * cos + ahead * sin;
        pose.translation[2] += ahead * cos - aside * sin;
        // The hip of the supporting leg is higher and slightly behind.
        let roll = SHIFT_ROLL_PER_METRE * gain * shifted * DEGREE;
        let yaw = SHIFT_YAW_PER_METRE * gain * shifted * DEGREE;
        let rotations = &mut pose.rotations;
        turn_in_own(&mut rotations[PELVIS], [0.0, yaw, roll]);
        // Legs stay over the feet, and soles flat on the floor.
        let leg = tick.rig.leg;
        let lean = [ahead / leg, 0.0, -aside / leg];
        for (hip, ankle) in HIPS.into_iter().zip(ANKLES) {
            turn_in_parent(&mut rotations[hip], [lean[0], -yaw, lean[2] - roll]);
            turn_in_parent(&mut rotations[ankle], [-lean[0], 0.0, -lean[2]]);
        }
        for (number, joint) in SPINE.into_iter().enumerate() {
            let back = TRUNK_COMPENSATION * [0.5, 0.3, 0.2][number];
            let wave = gain * DEGREE / NOISE_DEVIATION;
            // Each joint uses other lanes of the noise, so that the joints do not move in unison.
            let turn: [f32; 3] = std::array::from_fn(|axis| wave * TRUNK_SWAY[axis] * trunk[(axis + number) % 4]);
            turn_in_parent(&mut rotations[joint], [turn[0], turn[1] - back * yaw, turn[2] - back * roll]);
        }
    }

    /// Moves upper arm and forearm in slow circles, so that their speed is never 0.
    fn move_arm(&self, pose: &mut Pose, tick: &Tick, side: usize, pace: f32, lively: f32) {
        // The arms are a quarter of a cycle apart: one reverses while the other is fastest.
        let phase = self.drift + 0.25 * side as f32 * (1.0 + 0.4 * pace);
        let (sin, cos) = (phase * std::f32::consts::TAU).sine_cosine();
        let late = ((phase - FOREARM_LAG_CYCLES) * std::f32::consts::TAU).sine();
        let noise = smooth(tick.seed, ARMS[side], tick.time(), ARM_RATE);
        let size = 1.0 + LIVELY_SHARE * tick.lively;
        let hangs = 1.0 - (1.0 - HANGING_SHARE) * tick.resting[side];
        let amount = tick.gain * (1.0 - (1.0 - MIN_DRIFT_SHARE) * lively) * hangs * size * DEGREE;
        let sign = SIDES[side];
        let rotations = &mut pose.rotations;
        // Forward and back, and outward only, never into the body.
        let swing = amount * (ARM_SWING_DEGREES * sin * (1.0 + 0.6 * noise[0]) + 2.0 * noise[1]);
        let spread = amount * (ARM_SPREAD_DEGREES * (1.2 + cos) + 1.2 * (noise[2] + 0.4));
        turn_in_parent(&mut rotations[SHOULDERS[side]], [-swing, 0.0, sign * spread]);
        turn_in_own(&mut rotations[SHOULDERS[side]], [sign * amount * ARM_TWIST_DEGREES * noise[3], 0.0, 0.0]);
        let flex = amount * (ELBOW_FLEX_DEGREES * late * (1.0 + 0.5 * noise[1]) + 5.0 * (noise[0] + 0.6));
        turn_in_parent(&mut rotations[ELBOWS[side]], [0.0, -sign * flex, 0.0]);
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.switch("idle motion", &mut self.is_started)?;
        pass.share(&mut self.breath)?;
        pass.share(&mut self.drift)?;
        self.inhale.state(pass)?;
        self.shift.state(pass)?;
        self.arms.iter_mut().try_for_each(|arm| arm.state(pass))
    }
}

/// Moves wrist and fingers.
fn move_hand(pose: &mut Pose, tick: &Tick, side: usize, lively: f32) {
    let amount = tick.gain * (1.0 - (1.0 - MIN_FINGER_SHARE) * lively) * DEGREE / NOISE_DEVIATION;
    let sign = SIDES[side];
    let hand = smooth(tick.seed, HANDS[side], tick.time(), WRIST_RATE);
    let rotations = &mut pose.rotations;
    let wrist =
        [0.6 * WRIST_DRIFT_DEGREES * hand[2], 0.5 * WRIST_DRIFT_DEGREES * hand[1], WRIST_DRIFT_DEGREES * hand[0]];
    turn_in_own(&mut rotations[WRISTS[side]], wrist.map(|angle| amount * angle));
    let [near, far] = FINGERS[side].map(|stream| smooth(tick.seed, stream, tick.time(), FINGER_RATE));
    // Index, middle, little and ring finger, thumb: neighbours move together.
    let curls = [near[0], 0.7 * near[0] + 0.5 * near[1], near[2], 0.6 * near[2] + 0.5 * near[1], 0.6 * far[0]];
    let spreads = [far[1], 0.3 * far[2], -far[1], -0.5 * far[1], 0.8 * far[3]];
    let first = FIRST_FINGER + 15 * side;
    for (finger, (curl, spread)) in curls.into_iter().zip(spreads).enumerate() {
        let bend = amount * (FINGER_CURL_DEGREES * curl + HAND_CURL_DEGREES * hand[3]);
        for (phalanx, share) in PHALANX_CURL.into_iter().enumerate() {
            let aside = if phalanx == 0 { amount * FINGER_SPREAD_DEGREES * spread } else { 0.0 };
            let joint = &mut rotations[first + 3 * finger + phalanx];
            turn_in_own(joint, [0.0, sign * aside, -sign * share * bend]);
        }
    }
}

/// Rotations of shoulder and elbow.
fn arm_of(pose: &Pose, side: usize) -> [Quat; 2] {
    [pose.rotations[SHOULDERS[side]], pose.rotations[ELBOWS[side]]]
}

/// Advances a phase, which wraps at 1.
fn advanced(phase: f32, by: f32) -> f32 {
    (phase + by).fract().clamp(0.0, 1.0)
}

/// The model's motion of one arm.
#[derive(Debug)]
struct Arm {
    before: [Quat; 2],
    /// Smoothed speed of the wrist, m/s.
    speed: f32,
}

impl Default for Arm {
    fn default() -> Self {
        Self { before: [IDENTITY; 2], speed: 0.0 }
    }
}

impl Arm {
    /// Measures the liveliness of the arm, 0 to 1.
    fn measure(&mut self, now: [Quat; 2], seconds: f32) -> f32 {
        let [shoulder, elbow] = [0, 1].map(|joint| angle_between(self.before[joint], now[joint]));
        let speed = (SHOULDER_LEVER * shoulder + ELBOW_LEVER * elbow) / seconds;
        self.before = now;
        let time = if speed > self.speed { SPEED_RISE_SECONDS } else { SPEED_FALL_SECONDS };
        self.speed += step(seconds, time) * (speed - self.speed);
        ease((self.speed - STILL_WRIST_SPEED) / (LIVELY_WRIST_SPEED - STILL_WRIST_SPEED))
    }

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.rotations(&mut self.before)?;
        pass.moderate(std::slice::from_mut(&mut self.speed))
    }
}

/// Shift of weight from one foot to the other.
#[derive(Debug, Default)]
struct Shift {
    draws: u64,
    /// Metres to the left at the start and the end of the last shift.
    from: f32,
    to: f32,
    /// Seconds since it began, its duration, and seconds until the next.
    passed: f32,
    lasts: f32,
    left: f32,
}

impl Shift {
    /// Advances by one tick and returns the offset, metres to the left.
    fn advance(&mut self, tick: &Tick) -> f32 {
        self.left -= tick.seconds;
        self.passed = (self.passed + tick.seconds).min(1e3);
        if self.left <= 0.0 {
            let [when, way, lasts, rests] =
                std::array::from_fn(|i| uniform(tick.seed, SHIFT, 4 * self.draws + i as u64));
            self.draws += 1;
            let between = |[least, most]: [f32; 2], t: f32| least + (most - least) * t;
            self.from = self.to;
            // To the other side; sometimes a short shift.
            let side = if self.from > 0.0 || self.from == 0.0 && way < 0.5 { -1.0 } else { 1.0 };
            let size = between(SHIFT_DISTANCE, way);
            let size = size * (1.0 + LIVELY_SHARE * tick.lively);
            self.to = side * if rests < 0.2 { 0.3 * size } else { size };
            (self.passed, self.lasts) = (0.0, between(SHIFT_DURATION_SECONDS, lasts));
            let interval = between(SHIFT_INTERVAL_SECONDS, when) * (1.0 - LIVELY_SHARE * tick.lively);
            self.left = self.lasts + interval - SHIFT_DURATION_SECONDS[0];
        }
        self.from + (self.to - self.from) * smoother(self.passed / self.lasts.max(0.1))
    }

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("weight shifts", &mut self.draws, 1 << 60)?;
        let mut values = [self.from, self.to, self.passed, self.lasts, self.left];
        pass.moderate(&mut values)?;
        [self.from, self.to, self.passed, self.lasts, self.left] = values;
        Ok(())
    }
}

/// Minimum-jerk step from 0 to 1.
fn smoother(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

#[cfg(test)]
mod tests {
    use super::super::Layer;
    use super::super::trial::{SECONDS, Trial, assert_sound, deviation, turned};
    use super::*;

    fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt()
    }

    #[test]
    fn hands_are_never_still_and_never_fast() {
        for seed in 0..4 {
            let mut trial = Trial::new(&[Layer::Idle], seed);
            let places: Vec<[[f32; 3]; 2]> = trial
                .ticks(5400)
                .iter()
                .map(|frame| {
                    assert_sound(frame);
                    let (places, _) = trial.rig.world(&frame.pose);
                    WRISTS.map(|wrist| std::array::from_fn(|axis| places[wrist][axis] - places[PELVIS][axis]))
                })
                .collect();
            let speeds = places.windows(2).map(|pair| {
                [0, 1].map(|side| distance(pair[0][side], pair[1][side]) / SECONDS).into_iter().fold(0.0, f32::max)
            });
            let speeds: Vec<f32> = speeds.collect();
            let still = speeds.iter().filter(|&&speed| speed < 0.04).count() as f32 / speeds.len() as f32;
            assert!(still < 0.06, "{seed} {still}");
            assert!(speeds.iter().all(|&speed| speed < 0.3));
            // No tremor: limit of the jerk, m/s^3.
            let jerk = |side: usize| {
                places.windows(4).map(move |w| {
                    let third = |axis: usize| {
                        w[3][side][axis] - 3.0 * w[2][side][axis] + 3.0 * w[1][side][axis] - w[0][side][axis]
                    };
                    [0, 1, 2].map(third).map(|value| value * value).iter().sum::<f32>().sqrt() / SECONDS.powi(3)
                })
            };
            assert!((0..2).all(|side| jerk(side).fold(0.0, f32::max) < 12.0));
        }
    }

    #[test]
    fn it_breathes_12_to_16_times_a_minute() {
        let mut trial = Trial::new(&[Layer::Idle], 9);
        let mut breaths = 0;
        for _ in 0..18_000 {
            let before = trial.stack.idle.breath;
            trial.tick();
            breaths += usize::from(trial.stack.idle.breath < before);
        }
        assert!((120..=160).contains(&breaths), "{breaths}");
    }

    #[test]
    fn weight_goes_from_one_foot_to_the_other_and_soles_stay_near_their_place() {
        let mut trial = Trial::new(&[Layer::Idle], 4);
        let rest = trial.rig.world(&trial.frame.pose).0;
        let shown = trial.ticks(9000);
        let sideways: Vec<f32> = shown.iter().map(|frame| frame.pose.translation[0]).collect();
        assert!(sideways.iter().all(|x| x.abs() < 0.045));
        let crossings = sideways.windows(2).filter(|pair| (pair[0] > 0.008) != (pair[1] > 0.008)).count();
        assert!((10..=80).contains(&crossings), "{crossings}");
        for frame in &shown {
            let (places, _) = trial.rig.world(&frame.pose);
            for ankle in ANKLES {
                assert!(distance(places[ankle], rest[ankle]) < 0.02, "{:?} {:?}", places[ankle], rest[ankle]);
            }
            assert!(turned(&trial, frame, 10).into_iter().all(|angle| angle.abs() < 4.0));
        }
        // The head stays level throughout.
        let roll = deviation(shown.iter().map(|frame| turned(&trial, frame, HEAD)[2]));
        assert!(roll < 1.5, "{roll}");
    }

    #[test]
    fn a_lively_arm_has_less_of_it() {
        let drift = |swing: f32| {
            let mut trial = Trial::new(&[Layer::Idle], 1);
            let rest = trial.frame.pose;
            let mut added = Vec::new();
            for tick in 0..1800_u16 {
                let turn = [swing * DEGREE * (f32::from(tick) * 0.5).sin(), 0.0, 0.0];
                let mut raw = rest.rotations[ELBOWS[0]];
                turn_in_parent(&mut raw, turn);
                trial.frame.pose.rotations[ELBOWS[0]] = raw;
                added.push(angle_between(raw, trial.tick().pose.rotations[ELBOWS[0]]));
            }
            deviation(added[60..].iter().copied())
        };
        assert!(drift(40.0) < 0.7 * drift(0.0));
    }
}
