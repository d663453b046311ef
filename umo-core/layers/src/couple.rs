//! Trunk, shoulders and legs that take part in what the hands do (SPEC 2.11.9): the trunk turns and leans towards the
//! busy hand, a raised arm takes its shoulder along; with each phrase the body takes another stance, whose free knee
//! gives and whose free foot steps at times.
//!
//! Turns are about the parent's axes: X tilts forward, Y turns to the left, Z raises the left side.

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::pose::Pose;

use super::Tick;
use super::gesture::{Arm, LEFT, RIGHT};
use super::noise::{Stream, uniform};
use super::rig::{
    DEGREE, HEAD, NECK, Rig, SPINE, Soft, Spring, add, ease, length_of_two, turn_in_own, turn_in_parent, turn_vector,
};

const ARMS: [Arm; 2] = [LEFT, RIGHT];
const HIPS: [usize; 2] = [1, 2];

/// Height of a hand over its shoulder, in arm lengths, at which it begins to count as raised, and from which it does.
const RAISED: [f32; 2] = [-0.85, -0.35];
/// Frequencies of the springs, radians a second: of what follows the hands, and of a stance; of a shoulder.
const REACH_RATE: f32 = 7.0;
const STANCE_RATE: f32 = 5.0;
const SHOULDER_RATE: f32 = 12.0;

/// Degrees of the trunk for a raised hand a metre aside, and at most: turn, lean. Degrees forward for hands as far ahead
/// as arms are long, beyond the usual distance.
const TURN: [f32; 2] = [32.0, 11.0];
const LEAN: [f32; 2] = [9.0, 3.5];
const FORWARD: f32 = 9.0;
const USUAL_AHEAD: f32 = 0.3;
/// Share of the pelvis in the turn and the lean of the trunk; share of the neck that takes them back.
const PELVIS_SHARE: f32 = 0.45;
const LEVEL_HEAD_SHARE: f32 = 0.5;
/// Degrees of a shoulder up and forward with a raised arm, and share of them that the upper arm takes back.
const SHOULDER: [f32; 2] = [6.5, 7.5];
const UPPER_ARM_SHARE: f32 = 0.5;

/// A stance: metres of the pelvis over the carrying foot, and down; degrees of its roll; least and most degrees of its turn;
/// of the heel of the free foot, radians.
const STANCE_ASIDE: f32 = 0.02;
const STANCE_DOWN: f32 = 0.011;
const STANCE_ROLL: f32 = 3.6;
const STANCE_TURN: [f32; 2] = [4.0, 11.0];
const STANCE_HEEL: f32 = 0.16;
/// Least size of a stance of 1, and share in silence.
const LEAST_STANCE: f32 = 0.6;
const SILENT_SHARE: f32 = 0.6;
/// Shares of roll and turn that the trunk takes back.
const ROLL_BACK: f32 = 0.85;
const TURN_BACK: f32 = 0.6;
/// Least seconds of a stance: until a phrase of gestures, and of the voice; seconds until another one anyway, in speech and in
/// silence.
const STANCE_SECONDS: [f32; 2] = [1.8, 3.2];
const SPEECH_SECONDS: [f32; 2] = [5.0, 9.0];
const SILENCE_SECONDS: [f32; 2] = [7.0, 14.0];
/// Chances that the weight goes to the other foot, and that the free foot steps.
const OTHER_FOOT: f32 = 0.8;
const STEPS: f32 = 0.55;
/// Place of a foot that steps beside where it stands by the animation: outwards and ahead, metres; outwards, radians.
const STEP_OUT: [f32; 2] = [-0.01, 0.05];
const STEP_AHEAD: [f32; 2] = [-0.05, 0.07];
const STEP_TURN: [f32; 2] = [-0.05, 0.22];
/// Seconds from a stance to its step, which waits for that long.
const STEP_AFTER: f32 = 0.3;
const STEP_WAITS: f32 = 0.9;
/// Frequency with which everything gives way to a prompt, radians a second.
const PROMPT_RATE: f32 = 4.0;
/// Cap of the counted time, seconds.
const MOST_SECONDS: f32 = 1e3;

const DRAWS: Stream = Stream(710);

/// What a stance asks of the feet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Stride {
    /// Where each foot is to stand beside its place in the animation: metres along x and z, radians about the vertical.
    pub(super) beside: [[f32; 3]; 2],
    /// The foot that steps there now.
    pub(super) foot: Option<usize>,
    /// Rise of each heel, radians.
    pub(super) heels: [f32; 2],
}

/// Trunk, shoulders and legs that go with the hands.
#[derive(Debug)]
pub(super) struct Couple {
    is_started: bool,
    draws: u64,
    /// Weight of the layer beside a prompt.
    free: Soft,
    turn: Spring,
    lean: Spring,
    forward: Spring,
    raised: [Spring; 2],
    /// Weight over the left foot, -1 to 1, and turn to the left, radians: as they are, and as the stance has them.
    weight: Soft,
    heading: Soft,
    goals: [f32; 2],
    /// Seconds since the stance began, and the draw of how long it lasts.
    since: f32,
    length: f32,
    beside: [[f32; 3]; 2],
    steps: bool,
}

impl Couple {
    pub(crate) fn new() -> Self {
        Self {
            is_started: false,
            draws: 0,
            free: Soft::ZERO,
            turn: Spring::ZERO,
            lean: Spring::ZERO,
            forward: Spring::ZERO,
            raised: [Spring::ZERO; 2],
            weight: Soft::ZERO,
            heading: Soft::ZERO,
            goals: [0.0; 2],
            since: 0.0,
            length: 0.0,
            beside: [[0.0; 3]; 2],
            steps: false,
        }
    }

    /// Applies one tick to the pose. `resting` has the weight of rest of each hand; `phrase` says that a phrase of gestures
    /// begins, and which hands have a part in it.
    pub(crate) fn apply(&mut self, pose: &mut Pose, tick: &Tick, resting: [f32; 2], phrase: Option<[bool; 2]>) -> Stride {
        let is_first = !std::mem::replace(&mut self.is_started, true);
        let free = if tick.cue.prompted > 0.5 { 0.0 } else { 1.0 };
        if is_first {
            self.free = Soft::at(free);
        }
        self.free.follow(free, PROMPT_RATE, tick.seconds);
        self.since = (self.since + tick.seconds).min(MOST_SECONDS);
        self.stand(pose, tick, phrase, is_first);
        self.follow_hands(pose, tick, resting, is_first);
        self.show(pose, tick)
    }

    /// Chooses a stance.
    fn stand(&mut self, pose: &Pose, tick: &Tick, phrase: Option<[bool; 2]>, is_first: bool) {
        let speaks = tick.weights.speaking > 0.5 || phrase.is_some();
        let lasts = if speaks { SPEECH_SECONDS } else { SILENCE_SECONDS };
        let [of_hands, of_voice] = STANCE_SECONDS;
        let is_due = phrase.is_some() && self.since > of_hands
            || tick.weights.own.begins && self.since > of_voice
            || self.since > between(lasts, self.length);
        if is_first || is_due {
            let [length, other, size, turn, way, step] = std::array::from_fn(|_| self.draw(tick));
            let [out, ahead, yaw] = std::array::from_fn(|_| self.draw(tick));
            let side = match is_first {
                true => (other - 0.5).signum(),
                false => -self.goals[0].signum() * if other < OTHER_FOOT { 1.0 } else { -1.0 },
            };
            let share = if speaks { 1.0 } else { SILENT_SHARE };
            let towards = match phrase {
                Some([true, false]) => 1.0,
                Some([false, true]) => -1.0,
                // Away from the last one, mostly.
                _ => -self.goals[1].signum() * if way < 0.75 { 1.0 } else { -1.0 },
            };
            self.goals = [
                share * side * between([LEAST_STANCE, 1.0], size),
                share * towards * between(STANCE_TURN, turn) * DEGREE,
            ];
            (self.since, self.length) = (0.0, length);
            self.steps = speaks && !is_first && step < STEPS;
            if self.steps {
                let [sin, cos] = heading(pose);
                let foot = usize::from(self.goals[0] > 0.0);
                let sign = ARMS[foot].side;
                let (out, ahead) = (sign * between(STEP_OUT, out), between(STEP_AHEAD, ahead));
                self.beside[foot] = [out * cos + ahead * sin, ahead * cos - out * sin, sign * between(STEP_TURN, yaw)];
            }
        }
        if is_first {
            (self.weight, self.heading) = (Soft::at(self.goals[0]), Soft::at(self.goals[1]));
        }
        self.weight.follow(self.goals[0], STANCE_RATE, tick.seconds);
        self.heading.follow(self.goals[1], STANCE_RATE, tick.seconds);
    }

    /// Follows where the hands are.
    fn follow_hands(&mut self, pose: &Pose, tick: &Tick, resting: [f32; 2], is_first: bool) {
        let (mut aside, mut ahead) = (0.0, 0.0_f32);
        for (side, arm) in ARMS.into_iter().enumerate() {
            let [x, up, forward] = hand(pose, tick.rig, arm);
            let raised = ease((up - RAISED[0]) / (RAISED[1] - RAISED[0])) * (1.0 - resting[side]);
            aside += raised * x;
            ahead += 0.5 * raised * (forward - USUAL_AHEAD).max(0.0);
            let shoulder = &mut self.raised[side];
            if is_first {
                *shoulder = Spring::at(raised);
            }
            shoulder.follow(raised, SHOULDER_RATE, tick.seconds);
        }
        let goals = [
            (TURN[0] * aside).clamp(-TURN[1], TURN[1]),
            (LEAN[0] * aside).clamp(-LEAN[1], LEAN[1]),
            FORWARD * ahead,
        ];
        for (spring, goal) in [&mut self.turn, &mut self.lean, &mut self.forward].into_iter().zip(goals) {
            if is_first {
                *spring = Spring::at(goal * DEGREE);
            }
            spring.follow(goal * DEGREE, REACH_RATE, tick.seconds);
        }
    }

    /// Turns the joints.
    fn show(&self, pose: &mut Pose, tick: &Tick) -> Stride {
        let gain = tick.gain * self.free.value().clamp(0.0, 1.0);
        if gain <= 0.0 {
            return Stride::default();
        }
        let [turn, lean, forward] = [&self.turn, &self.lean, &self.forward].map(|spring| gain * spring.at);
        let (weight, heading_turn) = (gain * self.weight.value(), gain * self.heading.value());
        let [sin, cos] = heading(pose);
        pose.translation[0] += STANCE_ASIDE * weight * cos;
        pose.translation[1] -= STANCE_DOWN * weight.abs();
        pose.translation[2] -= STANCE_ASIDE * weight * sin;
        let (yaw, roll) = (heading_turn + PELVIS_SHARE * turn, STANCE_ROLL * DEGREE * weight);
        let rotations = &mut pose.rotations;
        turn_in_own(&mut rotations[0], [0.0, yaw, roll]);
        for hip in HIPS {
            turn_in_parent(&mut rotations[hip], [0.0, -yaw, -roll]);
        }
        let third = 1.0 / SPINE.len() as f32;
        let in_spine = [
            forward,
            (1.0 - PELVIS_SHARE) * turn - TURN_BACK * heading_turn,
            -lean - ROLL_BACK * roll,
        ];
        for joint in SPINE {
            turn_in_parent(&mut rotations[joint], in_spine.map(|angle| third * angle));
        }
        let head = [
            -LEVEL_HEAD_SHARE * forward,
            -LEVEL_HEAD_SHARE * (turn + (1.0 - TURN_BACK) * heading_turn),
            LEVEL_HEAD_SHARE * lean,
        ];
        for (joint, share) in [(NECK, 0.4), (HEAD, 0.6)] {
            turn_in_parent(&mut rotations[joint], head.map(|angle| share * angle));
        }
        for (arm, raised) in ARMS.into_iter().zip(&self.raised) {
            let amount = gain * raised.at * DEGREE;
            let turned = [0.0, -arm.side * SHOULDER[1] * amount, arm.side * SHOULDER[0] * amount];
            turn_in_parent(&mut rotations[arm.collar], turned);
            turn_in_parent(&mut rotations[arm.shoulder], turned.map(|angle| -UPPER_ARM_SHARE * angle));
        }
        let foot = usize::from(self.goals[0] > 0.0);
        let waits = STEP_AFTER..STEP_AFTER + STEP_WAITS;
        Stride {
            beside: self.beside.map(|beside| beside.map(|value| gain * value)),
            foot: (self.steps && waits.contains(&self.since)).then_some(foot),
            heels: [-weight, weight].map(|free| STANCE_HEEL * free.max(0.0)),
        }
    }

    fn draw(&mut self, tick: &Tick) -> f32 {
        self.draws += 1;
        uniform(tick.seed, DRAWS, self.draws)
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.switch("stance", &mut self.is_started)?;
        pass.number("stance", &mut self.draws, 1 << 60)?;
        for soft in [&mut self.free, &mut self.weight, &mut self.heading] {
            soft.state(pass)?;
        }
        for spring in [&mut self.turn, &mut self.lean, &mut self.forward].into_iter().chain(&mut self.raised) {
            spring.state(pass)?;
        }
        self.goals.iter_mut().try_for_each(|goal| pass.within(goal, -1.0..=1.0))?;
        pass.within(&mut self.since, 0.0..=MOST_SECONDS)?;
        pass.share(&mut self.length)?;
        pass.moderate(self.beside.as_flattened_mut())?;
        pass.switch("stance", &mut self.steps).map(drop)
    }
}

/// Sine and cosine of the pelvis' heading.
fn heading(pose: &Pose) -> [f32; 2] {
    let [x, _, z] = turn_vector(pose.rotations[0], [0.0, 0.0, 1.0]);
    let flat = length_of_two(x, z).max(1e-3);
    [x / flat, z / flat]
}

/// Place of a wrist in the frame of the chest: metres to the left of its middle, up and ahead from the shoulder in arm
/// lengths.
fn hand(pose: &Pose, rig: &Rig, arm: Arm) -> [f32; 3] {
    let turned = |joint: usize, v: [f32; 3]| turn_vector(pose.rotations[joint], v);
    let fore = add(rig.offsets[arm.elbow], turned(arm.elbow, rig.offsets[arm.wrist]));
    let whole = turned(arm.collar, turned(arm.shoulder, fore));
    let shoulder = add(rig.offsets[arm.collar], turned(arm.collar, rig.offsets[arm.shoulder]));
    let length = arm.length(rig).max(1e-3);
    [shoulder[0] + whole[0], whole[1] / length, whole[2] / length]
}

fn between([least, most]: [f32; 2], t: f32) -> f32 {
    least + (most - least) * t
}
