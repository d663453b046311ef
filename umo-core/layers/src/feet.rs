//! A root that stays near its home, planted feet, steps.
//!
//! The root's position is high-passed: drift that the decoders accumulate over minutes is removed, sway
//! and weight shifts stay. The leg of a planted foot holds it in place while the pelvis moves. If the
//! leg would be too short, the pelvis is lowered a little and the heel rises. A foot that stands far
//! from where the animation wants it takes a step while the other foot carries.
#![expect(clippy::needless_range_loop, reason = "arrays of two sides or axes are indexed together")]

use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{IDENTITY, Quat, inverse};

use super::Tick;
use super::leg::{Leg, Posed, length, sub};
use super::rig::{Rig, Spring, add, after, ease, step, toward, turn, turn_vector, unit};

/// Time constant with which the root returns to its home, seconds.
const HOME_RETURN_SECONDS: f32 = 10.0;
/// Distance from home up to which the root moves freely, and limit of the damped excess, metres.
const FREE_HOME_DISTANCE: f32 = 0.06;
const MAX_EXCESS_DISTANCE: f32 = 0.06;
/// Root speed above which the avatar walks and its home moves along, m/s.
const WALKING_SPEED: f32 = 0.25;
/// Displacement in one tick above which the root was placed elsewhere, metres.
const PLACED_DISTANCE: f32 = 0.15;

/// Height over the ground (metres) and speed (m/s). Without the model's contact, a foot below both values
/// of `PLANTED_BELOW` is planted, and one at or above either value of `LIFTED_FROM` is lifted.
const PLANTED_BELOW: [f32; 2] = [0.03, 0.3];
const LIFTED_FROM: [f32; 2] = [0.045, 0.5];
/// Contact value from which the model reports a planted foot.
const CONTACT_THRESHOLD: f32 = 0.5;

/// Distance (metres) and angle (radians) from the wanted foot placement that trigger a step.
const STEP_DISTANCE: f32 = 0.07;
const STEP_ANGLE: f32 = 0.45;
/// Factor on both thresholds, and time limit in seconds, for the second foot to follow the first.
const SECOND_FOOT_FACTOR: f32 = 0.5;
const SECOND_FOOT_SECONDS: f32 = 1.0;
/// Factor on both thresholds for the foot that a stance asks for.
const ASKED_FACTOR: f32 = 0.35;
/// Duration of a step and least standing time between steps, seconds; height of a step, metres.
const STEP_SECONDS: f32 = 0.4;
const MIN_STANDING_SECONDS: f32 = 0.25;
const STEP_HEIGHT: f32 = 0.04;
/// Downward pitch of the foot in a step, radians; shift of the pelvis towards the carrying foot,
/// metres.
const STEP_PITCH: f32 = 0.2;
const STEP_PELVIS_SHIFT: f32 = 0.015;

/// Seconds of the transition between two modes of a foot.
const MODE_CHANGE_SECONDS: f32 = 0.2;
/// Time constant of the averaged foot placement that the animation wants, seconds.
const WANTED_PLACEMENT_SECONDS: f32 = 0.25;

/// Extension of a leg, as a share of its length, above which the pelvis is lowered; largest drop in
/// metres; and frequency of its spring, radians a second.
const EXTENSION_LIMIT: f32 = 0.993;
const MAX_PELVIS_DROP: f32 = 0.025;
const PELVIS_SPRING_RATE: f32 = 10.0;

/// Mode of a foot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mode {
    /// Stands on the ground.
    #[default]
    Planted = 0,
    /// Moves to another place.
    Step = 1,
    /// Follows the animation.
    Free = 2,
}

const MODES: [Mode; 3] = [Mode::Planted, Mode::Step, Mode::Free];

/// State of the feet and of the root's home.
#[derive(Debug, Default)]
pub(super) struct Feet {
    /// Whether the layer has run since the start.
    is_on: bool,
    /// Number of the next tick; another number means that the layer was off in between.
    next: u64,
    /// Height of the balls of the standing feet, metres.
    ground: f32,
    /// Home of the root: x and z, metres.
    home: [f32; 2],
    /// Slow mean of the decoders' root position, and the position at the last tick.
    mean: [f32; 2],
    last: [f32; 2],
    /// Smoothed velocity of that position, m/s.
    speed: [f32; 2],
    drop: Spring,
    feet: [Foot; 2],
}

#[derive(Clone, Copy, Debug, Default)]
struct Foot {
    mode: Mode,
    /// Seconds in the current mode.
    since: f32,
    /// Ball position at which the foot stands or began its step (x and z, metres), and the foot's yaw.
    place: [f32; 2],
    yaw: f32,
    /// Target of the step.
    goal: [f32; 2],
    goal_yaw: f32,
    /// Averaged placement that the animation wants.
    want: [f32; 2],
    want_yaw: f32,
    /// Ball position in the animation at the last tick, and its smoothed speed.
    last: [f32; 2],
    speed: f32,
    /// Ball position and foot rotation shown last.
    ball: [f32; 3],
    turned: Quat,
    /// Offset from the mode's source at the last change of mode; fades out.
    off: [f32; 3],
    off_turned: Quat,
    /// Weight of flat toes, 0 to 1.
    flat: f32,
}

impl Feet {
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// Applies one tick to the frame.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, tick: &Tick) {
        let rig = tick.rig;
        let (Some(left), Some(right)) = (Leg::new(rig, 0), Leg::new(rig, 1)) else { return };
        let legs = [left, right];
        let original = frame.pose;
        let pose = &mut frame.pose;
        let is_new = !self.is_on || tick.number != self.next;
        (self.is_on, self.next) = (true, tick.number + 1);
        if is_new {
            self.start(rig, &legs, pose);
        }
        self.keep_home(pose, tick.seconds);
        let posed = [0, 1].map(|side| legs[side].posed(pose, pelvis(rig, pose)));
        for side in 0..2 {
            let foot = &mut self.feet[side];
            if is_new {
                foot.begin(&posed[side], self.ground);
            }
            foot.watch(&posed[side], tick.stride.beside[side], tick.seconds);
            // These indices hold for both orders: models of EMAGE's weights put joints before sides, and there,
            // too, the left ankle is first and the right foot last.
            let contact = tick.cue.contacts[3 * side];
            foot.follow_contact(&posed[side], self.ground, contact);
        }
        self.choose_step(tick.stride.foot);
        let lean = self.advance(&posed, tick.seconds);
        (pose.translation[0], pose.translation[2]) = (pose.translation[0] + lean[0], pose.translation[2] + lean[1]);
        self.lower(rig, &legs, pose, is_new, tick.seconds);
        for (side, (leg, foot)) in legs.iter().zip(&self.feet).enumerate() {
            foot.stand(leg, pose, pelvis(rig, pose), tick.stride.heels[side]);
        }
        let legs = legs.iter().flat_map(|leg| leg.joints);
        if !self.is_sound() || !pose.translation.iter().all(|v| v.is_finite()) {
            *pose = original;
            *self = Self::new();
        } else if tick.gain < 1.0 {
            mix(&original, pose, legs, tick.gain);
        }
    }

    /// Starts with the feet and the root as this pose has them.
    fn start(&mut self, rig: &Rig, legs: &[Leg; 2], pose: &Pose) {
        let height = |leg: &Leg| leg.posed(&rig.rest, pelvis(rig, &rig.rest)).ball[1];
        self.ground = height(&legs[0]).min(height(&legs[1]));
        let place = [pose.translation[0], pose.translation[2]];
        (self.home, self.mean, self.last, self.speed) = (place, place, place, [0.0; 2]);
        self.drop = Spring::default();
    }

    /// Removes the root's drift from its home.
    fn keep_home(&mut self, pose: &mut Pose, seconds: f32) {
        let wanted = [pose.translation[0], pose.translation[2]];
        let moved = difference(wanted, self.last);
        self.last = wanted;
        if size(moved) > PLACED_DISTANCE {
            self.mean = sum(self.mean, moved);
        } else {
            let share = step(seconds, 0.5);
            for axis in 0..2 {
                self.speed[axis] += share * (moved[axis] / seconds - self.speed[axis]);
            }
            let walks = ease((size(self.speed) - WALKING_SPEED) / WALKING_SPEED);
            let with = moved.map(|v| walks * v);
            (self.home, self.mean) = (sum(self.home, with), sum(self.mean, with));
        }
        let share = step(seconds, HOME_RETURN_SECONDS);
        for axis in 0..2 {
            self.mean[axis] += share * (wanted[axis] - self.mean[axis]);
        }
        let away = difference(wanted, self.mean);
        let distance = size(away);
        let scale = match distance > FREE_HOME_DISTANCE {
            true => {
                (FREE_HOME_DISTANCE
                    + MAX_EXCESS_DISTANCE
                        * ((distance - FREE_HOME_DISTANCE) / MAX_EXCESS_DISTANCE).hyperbolic_tangent())
                    / distance
            }
            false => 1.0,
        };
        let shown = sum(self.home, away.map(|v| scale * v));
        (pose.translation[0], pose.translation[2]) = (shown[0], shown[1]);
    }

    /// Starts a step of a foot that stands too far from its wanted placement, if both feet are planted; of the foot that a
    /// stance `asks` for, if it is to stand elsewhere at all.
    fn choose_step(&mut self, asks: Option<usize>) {
        let stands = |foot: &Foot| foot.mode == Mode::Planted && foot.since >= MIN_STANDING_SECONDS;
        if !self.feet.iter().all(stands) {
            return;
        }
        let need = |side: usize| {
            let [foot, other] = [&self.feet[side], &self.feet[1 - side]];
            let least = if asks == Some(side) { ASKED_FACTOR } else { 1.0 };
            let distance = size(difference(foot.want, foot.place)) / (least * STEP_DISTANCE);
            let angle = wrapped(foot.want_yaw - foot.yaw).abs() / (least * STEP_ANGLE);
            let follows = other.since < SECOND_FOOT_SECONDS && other.since < foot.since;
            distance.max(angle) / if follows { SECOND_FOOT_FACTOR } else { 1.0 }
        };
        let needs = [need(0), need(1)];
        let side = usize::from(needs[1] > needs[0]);
        if needs[side] > 1.0 {
            self.feet[side].change(Mode::Step);
        }
    }

    /// Advances both feet and returns the lean of the pelvis over a carrying foot: x and z.
    fn advance(&mut self, posed: &[Posed; 2], seconds: f32) -> [f32; 2] {
        let mut lean = [0.0; 2];
        for side in 0..2 {
            let carries = self.feet[1 - side].place;
            let foot = &mut self.feet[side];
            foot.advance(&posed[side], self.ground, seconds);
            if foot.mode == Mode::Step {
                let to = difference(carries, foot.place);
                let amount = STEP_PELVIS_SHIFT * bump(foot.since / STEP_SECONDS) / size(to).max(0.05);
                lean = sum(lean, to.map(|v| amount * v));
            }
        }
        lean
    }

    /// Lowers the pelvis smoothly if a leg would be too short.
    fn lower(&mut self, rig: &Rig, legs: &[Leg; 2], pose: &mut Pose, is_new: bool, seconds: f32) {
        let place = pelvis(rig, pose);
        let mut needed = 0.0_f32;
        for (leg, foot) in legs.iter().zip(&self.feet) {
            if foot.mode == Mode::Free {
                continue;
            }
            let to = sub(leg.posed(pose, place).hip, leg.ankle_over(foot.ball, foot.turned));
            let reach = EXTENSION_LIMIT * leg.length();
            let height = (reach * reach - to[0] * to[0] - to[2] * to[2]).max(0.0).sqrt();
            needed = needed.max(to[1] - height);
        }
        let goal = needed.clamp(0.0, MAX_PELVIS_DROP);
        if is_new {
            self.drop.at = goal;
        }
        self.drop.follow(goal, PELVIS_SPRING_RATE, seconds);
        pose.translation[1] -= self.drop.at;
    }

    /// Whether every value is finite.
    fn is_sound(&self) -> bool {
        let of_foot = |foot: &Foot| {
            let flat = [foot.since, foot.yaw, foot.goal_yaw, foot.want_yaw, foot.speed, foot.flat];
            let places = foot.place.iter().chain(&foot.goal).chain(&foot.want).chain(&foot.last);
            let shown = foot.ball.iter().chain(&foot.turned).chain(&foot.off).chain(&foot.off_turned);
            flat.iter().chain(places).chain(shown).all(|v| v.is_finite())
        };
        let places = self.home.iter().chain(&self.mean).chain(&self.last).chain(&self.speed);
        places.chain([&self.ground, &self.drop.at]).all(|v| v.is_finite()) && self.feet.iter().all(of_foot)
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.switch("feet", &mut self.is_on)?;
        pass.number("ticks", &mut self.next, umo_core_pose::frame::MAX_INDEX + 1)?;
        pass.places(std::slice::from_mut(&mut self.ground))?;
        for place in [&mut self.home, &mut self.mean, &mut self.last] {
            pass.places(place)?;
        }
        pass.moderate(&mut self.speed)?;
        self.drop.state(pass)?;
        self.feet.iter_mut().try_for_each(|foot| foot.state(pass))
    }
}

impl Foot {
    /// Plants the foot where the animation has it.
    fn begin(&mut self, posed: &Posed, ground: f32) {
        let place = [posed.ball[0], posed.ball[2]];
        let yaw = yaw_of(posed.foot());
        *self = Self {
            place,
            yaw,
            goal: place,
            goal_yaw: yaw,
            want: place,
            want_yaw: yaw,
            last: place,
            ball: [place[0], ground, place[1]],
            turned: turn([0.0, yaw, 0.0]),
            off_turned: IDENTITY,
            flat: 1.0,
            // Both feet may step at once.
            since: SECOND_FOOT_SECONDS,
            ..Self::default()
        };
    }

    /// Tracks the animation's placement and speed of the foot, which is to stand `beside` it.
    fn watch(&mut self, posed: &Posed, beside: [f32; 3], seconds: f32) {
        let place = [posed.ball[0], posed.ball[2]];
        let speed = size(difference(place, self.last)) / seconds;
        self.speed += step(seconds, 0.1) * (speed - self.speed);
        self.last = place;
        let share = step(seconds, WANTED_PLACEMENT_SECONDS);
        for axis in 0..2 {
            self.want[axis] += share * (place[axis] + beside[axis] - self.want[axis]);
        }
        self.want_yaw = wrapped(self.want_yaw + share * wrapped(yaw_of(posed.foot()) + beside[2] - self.want_yaw));
    }

    /// Plants a foot that has come down, and releases one that the animation lifts.
    fn follow_contact(&mut self, posed: &Posed, ground: f32, contact: f32) {
        let is_under = |[height, speed]: [f32; 2]| posed.ball[1] - ground < height && self.speed < speed;
        match self.mode {
            Mode::Planted if contact < CONTACT_THRESHOLD && !is_under(LIFTED_FROM) => self.change(Mode::Free),
            Mode::Free
                if self.since > MODE_CHANGE_SECONDS && (contact > CONTACT_THRESHOLD || is_under(PLANTED_BELOW)) =>
            {
                self.place = [self.ball[0], self.ball[2]];
                self.yaw = yaw_of(self.turned);
                self.change(Mode::Planted);
            }
            _ => {}
        }
    }

    fn change(&mut self, mode: Mode) {
        (self.mode, self.since) = (mode, 0.0);
        // The new source is only known in `advance`: until then these hold what was shown.
        (self.off, self.off_turned) = (self.ball, self.turned);
        (self.goal, self.goal_yaw) = (self.want, self.want_yaw);
    }

    /// Advances the foot by one tick.
    fn advance(&mut self, posed: &Posed, ground: f32, seconds: f32) {
        let is_changed = self.since == 0.0;
        self.since += seconds;
        if self.mode == Mode::Step && self.since >= STEP_SECONDS {
            (self.place, self.yaw) = (self.goal, self.goal_yaw);
            (self.mode, self.since) = (Mode::Planted, seconds);
            (self.off, self.off_turned) = ([0.0; 3], IDENTITY);
        }
        let (ball, turned) = self.source(posed, ground);
        if is_changed {
            let (was, was_turned) = (self.off, self.off_turned);
            self.off = sub(was, ball);
            self.off_turned = unit(after(was_turned, inverse(turned)));
            if self.mode != Mode::Free {
                (self.off[0], self.off[2]) = (0.0, 0.0);
            }
        }
        let left = 1.0 - ease(self.since / MODE_CHANGE_SECONDS);
        self.ball = add(ball, self.off.map(|v| left * v));
        self.ball[1] = self.ball[1].max(ground);
        let axis = self.off_turned.map(|v| left * v);
        self.turned = unit(after(unit([axis[0], axis[1], axis[2], 1.0 - left + axis[3]]), turned));
        let flat = if self.mode == Mode::Free { 0.0 } else { 1.0 };
        self.flat += step(seconds, 0.1) * (flat - self.flat);
    }

    /// Ball position and foot rotation of the current mode.
    fn source(&mut self, posed: &Posed, ground: f32) -> ([f32; 3], Quat) {
        match self.mode {
            Mode::Planted => ([self.place[0], ground, self.place[1]], turn([0.0, self.yaw, 0.0])),
            Mode::Free => ([posed.ball[0], posed.ball[1].max(ground), posed.ball[2]], posed.foot()),
            Mode::Step => {
                let t = self.since / STEP_SECONDS;
                if t < 0.6 {
                    (self.goal, self.goal_yaw) = (self.want, self.want_yaw);
                }
                let share = minimum_jerk(t);
                let way = difference(self.goal, self.place);
                let yaw = self.yaw + share * wrapped(self.goal_yaw - self.yaw);
                let ball =
                    [self.place[0] + share * way[0], ground + STEP_HEIGHT * bump(t), self.place[1] + share * way[1]];
                (ball, after(turn([0.0, yaw, 0.0]), turn([STEP_PITCH * bump(t), 0.0, 0.0])))
            }
        }
    }

    /// Makes the leg reach the foot, whose heel rises by at least `heel` radians.
    fn stand(&self, leg: &Leg, pose: &mut Pose, pelvis: [f32; 3], heel: f32) {
        let posed = leg.posed(pose, pelvis);
        let rise =
            if self.mode == Mode::Free { 0.0 } else { leg.heel_rise(posed.hip, self.ball, self.turned).max(heel) };
        let foot = after(self.turned, turn([rise, 0.0, 0.0]));
        leg.reach(pose, &posed, leg.ankle_over(self.ball, foot), foot);
        let toes = &mut pose.rotations[leg.joints[3]];
        *toes = toward(*toes, turn([-rise, 0.0, 0.0]), self.flat);
    }

    /// Saves or loads the foot between two ticks.
    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let mode = pass.limited("foot", self.mode as u64, MODES.len() as u64 - 1)?;
        if pass.loads() {
            self.mode = MODES[usize::try_from(mode).unwrap_or_default()];
        }
        for place in [&mut self.place, &mut self.goal, &mut self.want, &mut self.last] {
            pass.places(place)?;
        }
        pass.places(&mut self.ball)?;
        pass.moderate(&mut self.off)?;
        pass.moderate(&mut self.turned)?;
        pass.moderate(&mut self.off_turned)?;
        for value in
            [&mut self.since, &mut self.yaw, &mut self.goal_yaw, &mut self.want_yaw, &mut self.speed, &mut self.flat]
        {
            pass.moderate(std::slice::from_mut(value))?;
        }
        Ok(())
    }
}

/// Position of the root joint.
fn pelvis(rig: &Rig, pose: &Pose) -> [f32; 3] {
    add(rig.offsets[0], pose.translation)
}

/// Blends the root and `joints` from `before` to `now` by `gain`.
fn mix(before: &Pose, now: &mut Pose, joints: impl Iterator<Item = usize>, gain: f32) {
    for joint in joints {
        now.rotations[joint] = toward(before.rotations[joint], now.rotations[joint], gain);
    }
    for (now, before) in now.translation.iter_mut().zip(before.translation) {
        *now = before + gain * (*now - before);
    }
}

/// Yaw of a foot's forward direction, radians.
fn yaw_of(foot: Quat) -> f32 {
    let ahead = turn_vector(foot, [0.0, 0.0, 1.0]);
    ahead[0].arc_tangent_over(ahead[2])
}

/// Wraps an angle to -pi to pi.
fn wrapped(angle: f32) -> f32 {
    use std::f32::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

fn difference(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn sum(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

fn size(v: [f32; 2]) -> f32 {
    length([v[0], v[1], 0.0])
}

/// Minimum-jerk step from 0 to 1.
fn minimum_jerk(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

/// Pulse from 0 to 1 and back, without speed and acceleration at both ends.
fn bump(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    64.0 * (t * (1.0 - t)).powi(3)
}

#[cfg(test)]
mod tests {
    use umo_core_pose::skeleton::JOINTS;

    use super::super::trial::{SECONDS, Trial, assert_sound, face, skeleton, standing};
    use super::super::{Cue, Layer};
    use super::*;

    const BALLS: [usize; 2] = [10, 11];

    fn places(trial: &Trial, frame: &OwnedFrame) -> [[f32; 3]; JOINTS] {
        trial.rig.world(&frame.pose).0
    }

    /// Runs ticks with the root moved by `at`; returns the positions of the balls of the feet, and the
    /// largest displacement of any joint in a tick.
    fn walk(trial: &mut Trial, ticks: usize, at: impl Fn(f32) -> [f32; 3]) -> (Vec<[[f32; 3]; 2]>, f32) {
        let (mut balls, mut largest, mut before) = (Vec::new(), 0.0_f32, None::<[[f32; 3]; JOINTS]>);
        for tick in 0..ticks {
            trial.frame.pose.translation = add(standing().translation, at(tick as f32 * SECONDS));
            let frame = trial.tick();
            assert_sound(&frame);
            let places = places(trial, &frame);
            if let Some(before) = before {
                let ways = places.iter().zip(before).map(|(a, b)| length(sub(*a, b)));
                largest = ways.fold(largest, f32::max);
            }
            before = Some(places);
            balls.push(BALLS.map(|ball| places[ball]));
        }
        (balls, largest)
    }

    fn sway(t: f32) -> [f32; 3] {
        [0.04 * (1.3 * t).sin(), 0.005 * (2.0 * t).sin(), 0.03 * (0.9 * t).sin()]
    }

    #[test]
    fn planted_feet_stay_while_the_pelvis_sways() {
        let mut trial = Trial::new(&[Layer::Feet], 1);
        let (balls, largest) = walk(&mut trial, 600, sway);
        for (tick, now) in balls.iter().enumerate() {
            for side in 0..2 {
                let off = length(sub(now[side], balls[0][side]));
                assert!(off < 0.001, "tick {tick}: foot {side} is off by {off} m");
            }
        }
        assert!(largest < 0.01, "{largest} m in a tick");
        // Without the layer the feet move with the pelvis.
        let (free, _) = walk(&mut Trial::new(&[], 1), 60, sway);
        assert!(length(sub(free[30][0], free[0][0])) > 0.02);
    }

    #[test]
    fn feet_step_after_a_root_that_moves_and_end_under_the_body() {
        let mut trial = Trial::new(&[Layer::Feet], 1);
        // A walk of 60 cm within a second: home moves along.
        let at = |t: f32| [0.6 * t.clamp(0.0, 1.0), 0.0, 0.0];
        let (balls, largest) = walk(&mut trial, 300, at);
        let pelvis = {
            let frame = trial.tick();
            places(&trial, &frame)[0]
        };
        let last = balls[299];
        for side in 0..2 {
            let aside = last[side][0] - pelvis[0];
            assert!((0.05..0.16).contains(&aside.abs()), "foot {side} is {aside} m aside of the body");
            assert!((last[side][1] - balls[0][side][1]).abs() < 1e-4, "it stands on the ground");
        }
        let lifted = balls.iter().any(|balls| balls[0][1] > balls[1][1] + 0.02);
        assert!(lifted && last[0][0] > balls[0][0][0] + 0.1, "no step was made");
        assert!(largest < 0.09, "{largest} m in a tick");
        let both = balls.iter().filter(|balls| balls.iter().all(|ball| ball[1] > 0.03)).count();
        assert_eq!(both, 0, "both feet were in the air");
    }

    #[test]
    fn a_root_that_drifts_stays_near_its_home() {
        let mut trial = Trial::new(&[Layer::Feet], 1);
        for tick in 0..18_000 {
            trial.frame.pose.translation = add(standing().translation, [0.00113 * tick as f32 * SECONDS, 0.0, 0.0]);
            let place = trial.tick().pose.translation;
            assert!(place[0].abs() < 0.03, "{place:?} at tick {tick}");
        }
        // A lively root stays within bounds, too.
        let (balls, _) = walk(&mut Trial::new(&[Layer::Feet], 1), 900, |t| [0.5 * (0.3 * t).sin(), 0.0, 0.0]);
        assert!(balls.iter().all(|balls| balls[0][0].abs() < 0.35));
    }

    #[test]
    fn a_foot_that_is_lifted_goes_with_the_animation_and_lands_without_a_jump() {
        let mut trial = Trial::new(&[Layer::Feet], 1);
        let (mut before, mut highest) = (None::<[f32; 3]>, 0.0_f32);
        for tick in 0..150 {
            let t = (tick as f32 * SECONDS - 1.0).clamp(0.0, 2.0);
            let lift = (std::f32::consts::PI * 0.5 * t).sin().powi(2);
            trial.frame.pose.rotations[1] = turn([-0.6 * lift, 0.0, 0.0]);
            trial.frame.pose.rotations[4] = turn([0.9 * lift, 0.0, 0.0]);
            let on = if t > 0.0 && t < 2.0 { 0.0 } else { 1.0 };
            trial.frame.cue = Cue { contacts: [on, 1.0, on, 1.0], ..Cue::default() };
            let frame = trial.tick();
            assert_sound(&frame);
            let ball = places(&trial, &frame)[BALLS[0]];
            highest = highest.max(ball[1]);
            if let Some(before) = before {
                assert!(length(sub(ball, before)) < 0.04, "tick {tick}: from {before:?} to {ball:?}");
            }
            before = Some(ball);
        }
        assert!(highest > 0.06, "{highest} m");
    }

    #[test]
    fn a_stretched_leg_lowers_the_pelvis_and_raises_the_heel_not_the_ball() {
        let mut trial = Trial::new(&[Layer::Feet], 1);
        let (balls, largest) = walk(&mut trial, 300, |t| [0.0, 0.04 * (1.5 * t).sin().max(0.0), 0.0]);
        for now in &balls {
            for side in 0..2 {
                assert!(length(sub(now[side], balls[0][side])) < 0.001, "{now:?}");
            }
        }
        assert!(largest < 0.015, "{largest} m in a tick");
    }

    #[test]
    fn gain_0_changes_nothing_and_half_of_it_half() {
        let mut trial = Trial::new(&[], 1);
        trial.frame.pose.translation = [0.1, 0.97, 0.2];
        assert_eq!(trial.tick().pose, trial.frame.pose);
        let run = |gain: f32| {
            let mut trial = Trial::new(&[], 1);
            trial.controls.layers = trial.controls.layers.with(Layer::Feet, gain);
            walk(&mut trial, 60, sway).0[40][0]
        };
        let [whole, half, none] = [1.0, 0.5, 1e-6].map(run);
        let ways = [length(sub(half, none)), length(sub(whole, none))];
        assert!((ways[0] / ways[1] - 0.5).abs() < 0.05, "{ways:?}");
    }

    #[test]
    fn odd_bodies_and_numbers_are_left_alone() {
        let mut odd = skeleton();
        odd.offsets_m[4] = [0.0; 3];
        let mut trial = Trial::of(&[Layer::Feet], 1, &odd, &face(true), &standing());
        assert_eq!(trial.tick().pose, trial.frame.pose);
        let mut trial = Trial::new(&[Layer::Feet], 1);
        trial.tick();
        trial.frame.pose.translation[0] = f32::NAN;
        trial.tick();
        trial.frame.pose.translation[0] = 0.0;
        assert_sound(&trial.tick());
    }

    #[test]
    fn a_saved_state_goes_on_with_the_same_bits() {
        let mut trial = Trial::new(&[Layer::Feet], 1);
        walk(&mut trial, 20, |t| [0.5 * t, 0.0, 0.0]);
        let bytes = trial.save();
        let at = |t: f32| [0.4 + 0.3 * t, 0.0, 0.1 * t];
        let want = walk(&mut trial, 60, at).0;
        let mut other = Trial::new(&[Layer::Feet], 1);
        other.load(&bytes);
        assert_eq!(walk(&mut other, 60, at).0, want);
        let mut fresh = Trial::new(&[Layer::Feet], 1);
        assert_ne!(walk(&mut fresh, 60, at).0, want);
        trial.stack.reset(0, &trial.controls);
        let mut new = Trial::new(&[Layer::Feet], 1);
        assert_eq!(walk(&mut trial, 60, sway).0, walk(&mut new, 60, sway).0);
    }
}
