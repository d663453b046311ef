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
use super::voiced::enlarge;

const ARMS: [Arm; 2] = [LEFT, RIGHT];
const HIPS: [usize; 2] = [1, 2];

/// Height of a hand over its shoulder, in arm lengths, at which it begins to count as raised, and from which it does.
const RAISED: [f32; 2] = [-0.85, -0.35];
/// Logarithm of the size of what raised arms do.
const REACH: f32 = 0.13;
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
const STANCE_DOWN: f32 = 0.004;
const STANCE_ROLL: f32 = 3.6;
const STANCE_TURN: [f32; 2] = [4.0, 11.0];
const STANCE_HEEL: f32 = 0.14;
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
const STEP_AHEAD: [f32; 2] = [-0.04, 0.04];
const STEP_TURN: [f32; 2] = [-0.05, 0.22];
/// Metres by which feet stand further back than the animation has them, so that the weight is over them.
const STEP_BACK: f32 = 0.025;
/// Seconds from a stance to its step, which waits for that long.
const STEP_AFTER: f32 = 0.3;
const STEP_WAITS: f32 = 0.9;
/// Frequency with which everything gives way to a prompt, radians a second.
const PROMPT_RATE: f32 = 4.0;
/// Cap of the counted time, seconds.
const MOST_SECONDS: f32 = 1e3;

const DRAWS: Stream = Stream(710);

/// A stance's requests to the feet.
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
    /// The pelvis' way to between the feet, metres along x and z.
    over: [Soft; 2],
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
            over: [Soft::ZERO; 2],
            steps: false,
        }
    }

    /// Applies one tick to the pose. `resting` has the weight of rest of each hand; `phrase` says that a phrase of gestures
    /// begins, and which hands have a part in it.
    pub(crate) fn apply(
        &mut self,
        pose: &mut Pose,
        tick: &Tick,
        resting: [f32; 2],
        phrase: Option<[bool; 2]>,
    ) -> Stride {
        let is_first = !std::mem::replace(&mut self.is_started, true);
        let free = if tick.cue.prompted > 0.5 { 0.0 } else { 1.0 };
        if is_first {
            self.free = Soft::at(free);
        }
        self.free.follow(free, PROMPT_RATE, tick.seconds);
        self.since = (self.since + tick.seconds).min(MOST_SECONDS);
        enlarge(pose, tick.rig, REACH * tick.gain * self.free.value().clamp(0.0, 1.0));
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
        for (axis, over) in self.over.iter_mut().enumerate() {
            over.follow(0.5 * (self.beside[0][axis] + self.beside[1][axis]), STANCE_RATE, tick.seconds);
        }
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
        let goals =
            [(TURN[0] * aside).clamp(-TURN[1], TURN[1]), (LEAN[0] * aside).clamp(-LEAN[1], LEAN[1]), FORWARD * ahead];
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
        let over = [&self.over[0], &self.over[1]].map(|over| gain * over.value());
        pose.translation[0] += STANCE_ASIDE * weight * cos + over[0];
        pose.translation[1] -= STANCE_DOWN * weight.abs();
        pose.translation[2] -= STANCE_ASIDE * weight * sin - over[1];
        let (yaw, roll) = (heading_turn + PELVIS_SHARE * turn, STANCE_ROLL * DEGREE * weight);
        let rotations = &mut pose.rotations;
        turn_in_own(&mut rotations[0], [0.0, yaw, roll]);
        for hip in HIPS {
            turn_in_parent(&mut rotations[hip], [0.0, -yaw, -roll]);
        }
        let third = 1.0 / SPINE.len() as f32;
        let in_spine = [forward, (1.0 - PELVIS_SHARE) * turn - TURN_BACK * heading_turn, -lean - ROLL_BACK * roll];
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
            beside: self
                .beside
                .map(|[x, z, yaw]| [x - STEP_BACK * sin, z - STEP_BACK * cos, yaw].map(|value| gain * value)),
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
        for soft in [&mut self.free, &mut self.weight, &mut self.heading].into_iter().chain(&mut self.over) {
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

#[cfg(test)]
mod tests {
    use umo_core_pose::frame::OwnedFrame;
    use umo_core_pose::rotation::Quat;

    use super::super::rig::{angle_between, turn};
    use super::super::trial::{SECONDS, Trial, assert_sound, deviation, speech, turned};
    use super::super::{Cue, Layer, LayerGains};
    use super::*;

    /// Runs ticks of speech with the model's right hand, or both, in slow strokes to the side.
    fn run(trial: &mut Trial, ticks: std::ops::Range<usize>, both: bool) -> Vec<OwnedFrame> {
        ticks
            .map(|tick| {
                let reach = (0.8 * tick as f32 * SECONDS).sin().powi(2);
                for arm in ARMS.into_iter().filter(|arm| both || arm.side < 0.0) {
                    let rotations = &mut trial.frame.pose.rotations;
                    rotations[arm.shoulder] = turn([0.0, 0.0, -arm.side * (70.0 - 60.0 * reach) * DEGREE]);
                    rotations[arm.elbow] = turn([0.0, -arm.side * 40.0 * DEGREE, 0.0]);
                }
                trial.frame.cue = Cue { level: speech(tick), contacts: [1.0; 4], ..Cue::default() };
                let frame = trial.tick();
                assert_sound(&frame);
                frame
            })
            .collect()
    }

    #[test]
    fn the_trunk_turns_to_the_busy_hand_and_its_shoulder_rises() {
        let shown = run(&mut Trial::new(&[Layer::Body], 1), 0..900, false);
        let trial = Trial::new(&[], 1);
        // The chest beside the pelvis: the stance turns both.
        let chest = |frame: &OwnedFrame| {
            let stance = Trial::new(&[], 1);
            turned(&trial, frame, SPINE[2])[0] - turned(&stance, frame, 0)[0]
        };
        let at = |from: usize, until: usize| (from..until).map(|tick| chest(&shown[tick])).sum::<f32>();
        // The hand is out around 1.96 s and every 3.93 s later, and down in between.
        let (out, down) =
            ((0..6).map(|k| at(62 + 118 * k, 72 + 118 * k)), (0..6).map(|k| at(3 + 118 * k, 13 + 118 * k)));
        let (out, down) = (out.sum::<f32>() / 60.0, down.sum::<f32>() / 60.0);
        assert!(out < down - 2.0, "to the right: {out} and {down} degrees");
        let collar = |side: usize| {
            let rotation = |frame: &OwnedFrame| frame.pose.rotations[ARMS[side].collar];
            shown.iter().map(|frame| angle_between(rotation(&shown[0]), rotation(frame))).fold(0.0, f32::max) / DEGREE
        };
        assert!(collar(1) > 7.0 && collar(0) < 1.0, "{} {}", collar(1), collar(0));
    }

    #[test]
    fn stances_move_pelvis_and_knees_and_the_feet_step_and_never_slide() {
        let mut trial = Trial::new(&[Layer::Body, Layer::Feet], 2);
        let shown = run(&mut trial, 0..3600, true);
        let pelvis = deviation(shown.iter().map(|frame| turned(&trial, frame, 0)[0]));
        assert!((4.0..10.0).contains(&pelvis), "{pelvis}");
        let knee = |joint: usize| {
            let bend = |q: Quat| 2.0 * q[3].clamp(-1.0, 1.0).acos() / DEGREE;
            deviation(shown.iter().map(move |frame| bend(frame.pose.rotations[joint])))
        };
        assert!(knee(4) > 3.0 && knee(5) > 3.0, "{} {}", knee(4), knee(5));
        let balls: Vec<[[f32; 3]; 2]> =
            shown.iter().map(|frame| [10, 11].map(|ball| trial.rig.world(&frame.pose).0[ball])).collect();
        let ground = balls[0][0][1];
        let mut lifts = 0;
        for pair in balls.windows(2) {
            let up = [0, 1].map(|side| pair[1][side][1] > ground + 0.005);
            assert!(up != [true; 2], "a foot carries");
            for side in 0..2 {
                let was_up = pair[0][side][1] > ground + 0.005;
                lifts += usize::from(up[side] && !was_up);
                let way = length_of_two(pair[1][side][0] - pair[0][side][0], pair[1][side][2] - pair[0][side][2]);
                assert!(up[side] || was_up || way < 0.004, "{way} m on the ground");
            }
        }
        assert!((6..60).contains(&lifts), "{lifts} steps in 2 minutes");
        let root = |axis: usize| shown.iter().map(move |frame| frame.pose.translation[axis]);
        assert!(root(0).chain(root(2)).all(|place| place.abs() < 0.12), "it stays where it is");
    }

    #[test]
    fn nothing_jerks() {
        let mut trial = Trial::new(&[Layer::Body], 3);
        let shown = run(&mut trial, 0..1800, true);
        for joint in [0, 3, 9, 15] {
            let places: Vec<[f32; 3]> = shown.iter().map(|frame| trial.rig.world(&frame.pose).0[joint]).collect();
            let jerks = places.windows(4).map(|w| {
                let third = |axis: usize| w[3][axis] - 3.0 * w[2][axis] + 3.0 * w[1][axis] - w[0][axis];
                [0, 1, 2].map(third).map(|value| value * value).iter().sum::<f32>().sqrt() / SECONDS.powi(3)
            });
            let most = jerks.fold(0.0, f32::max);
            assert!(most < 30.0, "joint {joint}: {most} m/s³");
        }
    }

    #[test]
    fn gain_0_and_a_prompt_leave_the_model_as_it_is() {
        let mut off = Trial::new(&[], 4);
        for frame in run(&mut off, 0..60, true) {
            assert_eq!(frame.pose.translation, off.frame.pose.translation);
        }
        assert_eq!(off.tick().pose, off.frame.pose);
        let mut trial = Trial::new(&[Layer::Body], 4);
        trial.frame.cue.prompted = 1.0;
        for _ in 0..60 {
            assert_eq!(trial.tick().pose, trial.frame.pose);
        }
        // And half of the gain half of it.
        let turned_by = |gain: f32| {
            let mut trial = Trial::new(&[], 4);
            trial.controls.layers = LayerGains::OFF.with(Layer::Body, gain);
            let shown = run(&mut trial, 0..60, true);
            angle_between(trial.frame.pose.rotations[0], shown[59].pose.rotations[0])
        };
        let share = turned_by(0.5) / turned_by(1.0);
        assert!((0.45..0.55).contains(&share), "{share}");
    }

    #[test]
    fn a_saved_state_goes_on_with_the_same_bits() {
        let layers = [Layer::Body, Layer::Feet, Layer::Idle];
        let mut trial = Trial::new(&layers, 5);
        trial.controls.activity = 0.5;
        run(&mut trial, 0..200, true);
        let bytes = trial.save();
        let poses = |frames: Vec<OwnedFrame>| frames.into_iter().map(|frame| frame.pose).collect::<Vec<_>>();
        let want = poses(run(&mut trial, 200..500, true));
        let mut other = Trial::new(&layers, 5);
        other.controls.activity = 0.5;
        other.load(&bytes);
        assert_eq!(poses(run(&mut other, 200..500, true)), want);
        let mut fresh = Trial::new(&layers, 5);
        assert_ne!(poses(run(&mut fresh, 200..500, true)), want);
    }
}
