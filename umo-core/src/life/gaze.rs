//! Where the eyes look, and the lids; the head's and the trunk's part of a look.
//!
//! Directions are angles about Y, positive to the character's left, and about X, positive down, in
//! radians: those of an eye's rotation (`motion::pose`).

#[cfg(test)]
mod tests;

use super::noise::{Stream, normal, smooth, uniform};
use super::rig::{
    DEGREE, EYES, HEAD, NECK, Rig, SPINE, Spring, add, after, arkit, ease, length_of_two, step, toward, turn,
    turn_in_parent, turn_vector, unit,
};
use super::{Mood, Tick};
use crate::motion::Pose;
use crate::motion::rotation::inverse;
use crate::state::{StateError, StatePass};
use crate::stream::OwnedFrame;

/// How far an ARKit eye turns at 1.0, radians: sideways, and up or down (`motion::pose`).
const SHAPE_TURN: Angles = [30.0 * DEGREE, 25.0 * DEGREE];

/// Eyes turn freely so far, and never more than so far: sideways, and up or down.
const FREE: Angles = [19.0 * DEGREE, 14.0 * DEGREE];
const MOST: Angles = [25.0 * DEGREE, 18.0 * DEGREE];

/// Eyes that stay further out than this come back slowly, with this time constant in seconds.
const COMFORT: Angles = [13.0 * DEGREE, 10.0 * DEGREE];
const RECENTRE: f32 = 1.5;

/// Metres to the listener where there is nothing to look at, and seconds in which that place
/// follows the body's place and heading.
const DISTANCE: f32 = 1.5;
const FOLLOW: f32 = 3.0;

/// Half the distance of the eyes, metres, and the nearest that they converge to.
const HALF_EYES: f32 = 0.032;
const NEAREST: f32 = 0.25;

/// Time constant of the convergence, seconds: eyes turn to another distance slower than to another
/// direction.
const CONVERGE: f32 = 0.08;

/// The duration of a saccade: seconds, and seconds per radian (the main sequence: 2.2 ms a degree).
const SACCADE: f32 = 0.021;
const SACCADE_PER: f32 = 0.0022 / DEGREE;

/// A direction that changes by more than this in a tick is a saccade's goal; less is pursued.
const JUMP: f32 = 1.2 * DEGREE;

/// The head's share of a look away, beyond so much of it.
const HEAD_SHARE: f32 = 0.45;
const HEAD_BEYOND: f32 = 4.0 * DEGREE;

/// A look-at's trunk: beyond so much, this share, at most so much.
const TRUNK_BEYOND: f32 = 27.0 * DEGREE;
const TRUNK_SHARE: f32 = 0.6;
const TRUNK_MOST: Angles = [38.0 * DEGREE, 12.0 * DEGREE];

/// A look-at's head: what the trunk leaves, this share, at most so much.
const LOOK_SHARE: f32 = 0.85;
const LOOK_MOST: Angles = [52.0 * DEGREE, 28.0 * DEGREE];

/// Frequencies of the head's and the trunk's spring, radians a second: 95 % in 0.35 and 0.75 s.
const HEAD_RATE: f32 = 13.5;
const TRUNK_RATE: f32 = 6.5;

/// A head that is turned away from where the eyes look for long comes after them: time constant in
/// seconds, share, and how far at most.
const FACE_TIME: f32 = 2.0;
const FACE_SHARE: f32 = 0.7;
/// What of that share is left with a mood that holds the head otherwise.
const FACE_IN_MOOD: f32 = 0.35;
const FACE_MOST: Angles = [15.0 * DEGREE, 15.0 * DEGREE];

/// The neck's share of the head's turn.
const NECK_SHARE: f32 = 0.4;

/// Smallest drift of a fixation: standard deviation, and changes a second.
const DRIFT: f32 = 0.12 * DEGREE;
const DRIFT_RATE: f64 = 2.5;

/// Seconds that a lid takes down, stays and takes up, and that the right one comes later.
const CLOSING: f32 = 0.085;
const CLOSED: f32 = 0.03;
const OPENING: f32 = 0.165;
const LATER: f32 = 0.006;

/// Median seconds from a blink to the next that nothing else brings, and the standard deviation of
/// its logarithm.
const BLINK_MEDIAN: f32 = 3.6;
const BLINK_SPREAD: f32 = 0.4;
const BLINK_LEAST: f32 = 1.1;
const BROUGHT_LEAST: f32 = 1.8;
const BLINK_MOST: f32 = 7.5;

/// Shares of blinks: with a large shift of the gaze, at the end of a phrase, half ones, and ones that
/// another follows at once.
const WITH_SHIFT: f32 = 0.12;
const AT_END: f32 = 0.4;
const HALF: f32 = 0.12;
const DOUBLE: f32 = 0.06;

/// A shift that may bring a blink.
const LARGE_SHIFT: f32 = 9.0 * DEGREE;

/// How far lids go with the gaze: down with it, and wide open with it, at a shape's 1.0.
const LID_DOWN: f32 = 0.32;
const LID_UP: f32 = 0.3;

/// Streams of the draws.
const CHOICE: Stream = Stream(100);
const BLINK: Stream = Stream(101);
const DRIFTS: Stream = Stream(102);

type Angles = [f32; 2];

/// The shapes of one eye.
struct Shapes {
    blink: usize,
    down: usize,
    inwards: usize,
    outwards: usize,
    up: usize,
    squint: usize,
    wide: usize,
    /// 1 where outwards is towards +X (the left eye), -1 where it is towards -X.
    side: f32,
}

const LEFT: Shapes = Shapes {
    blink: arkit("eyeBlinkLeft"),
    down: arkit("eyeLookDownLeft"),
    inwards: arkit("eyeLookInLeft"),
    outwards: arkit("eyeLookOutLeft"),
    up: arkit("eyeLookUpLeft"),
    squint: arkit("eyeSquintLeft"),
    wide: arkit("eyeWideLeft"),
    side: 1.0,
};

const RIGHT: Shapes = Shapes {
    blink: arkit("eyeBlinkRight"),
    down: arkit("eyeLookDownRight"),
    inwards: arkit("eyeLookInRight"),
    outwards: arkit("eyeLookOutRight"),
    up: arkit("eyeLookUpRight"),
    squint: arkit("eyeSquintRight"),
    wide: arkit("eyeWideRight"),
    side: -1.0,
};

/// Eyes and lids.
#[derive(Debug)]
pub(super) struct Gaze {
    is_started: bool,
    /// Draws so far.
    draws: u64,
    /// Where the listener's place comes from, low-passed: x and z of the root, and of its heading.
    stand: [f32; 4],
    fixation: Fixation,
    saccade: Saccade,
    /// How far the eyes have come back from where they should look.
    recentred: Angles,
    /// How far each eye turns inwards, radians.
    convergence: f32,
    /// Where the eyes would look without the head's part of that, low-passed.
    aside: Angles,
    head: [Spring; 2],
    trunk: [Spring; 2],
    blink: Blink,
    /// What the decoders say of gaze and lids at this tick, in the order of [`Shapes::of_decoders`].
    decoded: [[f32; 5]; 2],
}

impl Shapes {
    /// The shapes that the layer sets in place of the decoders.
    fn of_decoders(&self) -> [usize; 5] {
        [self.blink, self.down, self.inwards, self.outwards, self.up]
    }
}

impl Gaze {
    pub(super) fn new() -> Self {
        Self {
            is_started: false,
            draws: 0,
            stand: [0.0; 4],
            fixation: Fixation::default(),
            saccade: Saccade::default(),
            recentred: [0.0; 2],
            convergence: 0.0,
            aside: [0.0; 2],
            head: [Spring::default(); 2],
            trunk: [Spring::default(); 2],
            blink: Blink::default(),
            decoded: [[0.0; 5]; 2],
        }
    }

    /// Reads the frame of a tick as the decoders give it: what is replaced. What other layers add to
    /// it later stays.
    pub(super) fn read(&mut self, frame: &OwnedFrame, rig: &Rig) {
        self.decoded = [LEFT, RIGHT].map(|eye| eye.of_decoders().map(|shape| rig.shape(&frame.face, shape)));
    }

    /// Changes the frame of one tick.
    pub(super) fn apply(&mut self, frame: &mut OwnedFrame, tick: &Tick) {
        let is_new = !self.is_started;
        if is_new {
            self.is_started = true;
            self.blink.left = 1.0 + 2.0 * self.draw(tick, BLINK);
        }
        self.follow(&frame.pose, tick, is_new);
        self.choose(tick);
        let (place, strength) = sought(tick);
        self.turn(&mut frame.pose, tick, place, strength);

        // Where to look, in the avatar's space.
        let rig = tick.rig;
        let (eyes, head) = rig.head(&frame.pose);
        let (listener, mut distance) = direction(eyes, self.listener(rig));
        let mut goal: Angles = std::array::from_fn(|axis| listener[axis] + self.fixation.offset[axis]);
        if strength > 0.0 {
            let (sought, away) = direction(eyes, place);
            goal = mix(goal, sought, strength);
            distance += strength * (away - distance);
        }
        let shift = self.saccade.advance(goal, tick.seconds, is_new);

        // In the head's frame.
        let drift = smooth(tick.seed, DRIFTS, tick.time(), DRIFT_RATE);
        let looks: Angles = std::array::from_fn(|axis| self.saccade.at(axis) + DRIFT / 0.4 * drift[axis]);
        let inside = angles(turn_vector(inverse(head), vector(looks)));
        let share = step(tick.seconds, FACE_TIME);
        let back = step(tick.seconds, RECENTRE);
        for (axis, &angle) in inside.iter().enumerate() {
            let without = angle + tick.gain * self.faced(tick, axis);
            self.aside[axis] += share * (without - self.aside[axis]);
            let outside = (1.0 - strength) * (angle - angle.clamp(-COMFORT[axis], COMFORT[axis]));
            self.recentred[axis] += back * (outside - self.recentred[axis]);
        }
        let inside: Angles = std::array::from_fn(|axis| inside[axis] - self.recentred[axis]);
        let convergence = (HALF_EYES / distance.max(NEAREST)).atan();
        let share = if is_new { 1.0 } else { step(tick.seconds, CONVERGE) };
        self.convergence += share * (convergence - self.convergence);
        self.blink(tick, shift);
        self.show(frame, tick, inside);
    }

    /// A draw in `0..1`.
    fn draw(&mut self, tick: &Tick, stream: Stream) -> f32 {
        self.draws += 1;
        uniform(tick.seed, stream, self.draws)
    }

    /// A draw of mean 0 and standard deviation 1.
    fn draw_normal(&mut self, tick: &Tick, stream: Stream) -> f32 {
        self.draws += 1;
        normal(tick.seed, stream, self.draws)
    }

    /// The listener goes slowly where the body goes.
    fn follow(&mut self, pose: &Pose, tick: &Tick, is_new: bool) {
        let ahead = turn_vector(pose.rotations[0], [0.0, 0.0, 1.0]);
        let share = if is_new { 1.0 } else { step(tick.seconds, FOLLOW) };
        let now = [pose.translation[0], pose.translation[2], ahead[0], ahead[2]];
        for (value, now) in self.stand.iter_mut().zip(now) {
            *value += share * (now - *value);
        }
    }

    /// The heading of the body.
    fn heading(&self) -> f32 {
        self.stand[2].atan2(self.stand[3])
    }

    /// Where the listener's eyes are, metres.
    fn listener(&self, rig: &Rig) -> [f32; 3] {
        let heading = self.heading();
        [self.stand[0] + DISTANCE * heading.sin(), rig.eye_height, self.stand[1] + DISTANCE * heading.cos()]
    }

    /// Chooses where to look next, where it is time.
    fn choose(&mut self, tick: &Tick) {
        let weights = &tick.weights;
        self.fixation.left -= tick.seconds;
        // Speakers look away where they begin, and at the listener where they end.
        if weights.own.begins && self.draw(tick, CHOICE) < 0.35 {
            self.look_away(tick, State::Speaking);
            return;
        }
        if weights.own.ends && !self.fixation.is_contact && self.draw(tick, CHOICE) < 0.5 {
            self.look_there(tick, State::Speaking);
            return;
        }
        let state = State::most(tick);
        if state != self.fixation.state {
            (self.fixation.state, self.fixation.is_fresh) = (state, true);
            // Some time later than what brought it.
            self.fixation.left = self.fixation.left.min(0.1 + 0.25 * self.draw(tick, CHOICE));
        }
        if self.fixation.left > 0.0 {
            return;
        }
        // What a listener hears begins with a look at who says it, a thought with one away.
        let contact = match state {
            State::Idle => 0.5,
            State::Listening if self.fixation.is_fresh => 1.0,
            State::Listening => 0.7,
            State::Thinking if self.fixation.is_fresh => 0.0,
            State::Thinking => 0.15,
            State::Speaking => 0.52,
        };
        if self.draw(tick, CHOICE) < contact {
            self.look_there(tick, state);
        } else {
            self.look_away(tick, state);
        }
        self.fixation.is_fresh = false;
    }

    /// Looks at one of the listener's eyes, or at their mouth.
    fn look_there(&mut self, tick: &Tick, state: State) {
        let (where_, how_long) = (self.draw(tick, CHOICE), self.draw(tick, CHOICE));
        let place = match where_ {
            x if x < 0.4 => [1.2, 0.0],
            x if x < 0.8 => [-1.2, 0.0],
            _ => [0.2, 2.4],
        };
        let range = match state {
            State::Listening => [1.2, 4.2],
            State::Idle => [1.2, 4.2],
            State::Thinking | State::Speaking => [1.3, 4.6],
        };
        self.fixation.set(place, range, how_long, true);
    }

    /// Looks past the listener.
    fn look_away(&mut self, tick: &Tick, state: State) {
        let [side, far, high, how_long] = std::array::from_fn(|_| self.draw(tick, CHOICE));
        let (sideways, upwards, range) = match state {
            State::Idle => ([5.0, 15.0], [-4.0, 8.0], [1.1, 3.6]),
            State::Listening => ([3.0, 9.0], [-2.0, 6.0], [0.5, 1.5]),
            // Up for most thoughts, down for some.
            State::Thinking if high < 0.7 => ([7.0, 17.0], [-13.0, -6.0], [1.4, 3.8]),
            State::Thinking => ([5.0, 14.0], [5.0, 12.0], [1.4, 3.8]),
            State::Speaking => ([4.0, 13.0], [-5.0, 8.0], [0.9, 2.9]),
        };
        let between = |[from, to]: [f32; 2], t: f32| from + (to - from) * t;
        let sign = if side < 0.5 { -1.0 } else { 1.0 };
        let fine = (high * 7.0).fract();
        self.fixation.set([sign * between(sideways, far), between(upwards, fine)], range, how_long, false);
    }

    /// How far the head comes after eyes that look aside for long.
    fn faced(&self, tick: &Tick, axis: usize) -> f32 {
        let is_held = !matches!(tick.controls.mood, Mood::Neutral | Mood::Joy);
        let strength = if is_held { tick.controls.mood_strength.clamp(0.0, 1.0) } else { 0.0 };
        let share = FACE_SHARE * (1.0 - (1.0 - FACE_IN_MOOD) * strength);
        (share * self.aside[axis]).clamp(-FACE_MOST[axis], FACE_MOST[axis])
    }

    /// Turns trunk and head towards what is looked at, after the eyes.
    fn turn(&mut self, pose: &mut Pose, tick: &Tick, place: [f32; 3], strength: f32) {
        let offset = self.fixation.offset;
        let beyond = |angle: f32, from: f32| angle - angle.clamp(-from, from);
        let away = |axis: usize| HEAD_SHARE * beyond(offset[axis], HEAD_BEYOND) + self.faced(tick, axis);
        let mut head: Angles = std::array::from_fn(away);
        let mut trunk = [0.0; 2];
        if strength > 0.0 {
            let (sought, _) = direction(tick.rig.head(pose).0, place);
            let from_body = [wrapped(sought[0] - self.heading()), sought[1]];
            for axis in 0..2 {
                let turn = TRUNK_SHARE * beyond(from_body[axis], TRUNK_BEYOND);
                trunk[axis] = strength * turn.clamp(-TRUNK_MOST[axis], TRUNK_MOST[axis]);
                let rest = strength * LOOK_SHARE * from_body[axis] - trunk[axis];
                head[axis] = (1.0 - strength) * head[axis] + rest.clamp(-LOOK_MOST[axis], LOOK_MOST[axis]);
            }
        }
        for axis in 0..2 {
            self.head[axis].follow(head[axis], HEAD_RATE, tick.seconds);
            self.trunk[axis].follow(trunk[axis], TRUNK_RATE, tick.seconds);
        }
        let turned = |joint: &mut _, springs: &[Spring; 2], share: f32| {
            let share = share * tick.gain;
            // Sideways after up or down.
            turn_in_parent(joint, [share * springs[1].at, 0.0, 0.0]);
            turn_in_parent(joint, [0.0, share * springs[0].at, 0.0]);
        };
        for joint in SPINE {
            turned(&mut pose.rotations[joint], &self.trunk, 1.0 / SPINE.len() as f32);
        }
        turned(&mut pose.rotations[NECK], &self.head, NECK_SHARE);
        turned(&mut pose.rotations[HEAD], &self.head, 1.0 - NECK_SHARE);
    }

    /// Begins a blink, where it is time or something brings one.
    fn blink(&mut self, tick: &Tick, shift: f32) {
        let blink = &mut self.blink;
        blink.left -= tick.seconds;
        blink.passed = (blink.passed + tick.seconds).min(LONG);
        let is_free = blink.passed > BROUGHT_LEAST;
        let is_due = blink.left <= 0.0;
        let brought = match () {
            () if !is_free => false,
            () if tick.weights.own.ends => self.draw(tick, BLINK) < AT_END,
            () if shift > LARGE_SHIFT => self.draw(tick, BLINK) < WITH_SHIFT,
            () => false,
        };
        if !(is_due || brought) {
            return;
        }
        let [kind, depth] = std::array::from_fn(|_| self.draw(tick, BLINK));
        let interval = BLINK_MEDIAN * (BLINK_SPREAD * self.draw_normal(tick, BLINK)).exp();
        // Who thinks or listens blinks a little less.
        let calm = 1.0 + 0.2 * tick.weights.listening + 0.2 * tick.weights.thinking + 0.1 * tick.weights.idle;
        let interval = (interval * calm).clamp(BLINK_LEAST, BLINK_MOST);
        let is_half = kind < HALF;
        self.blink.depth = if is_half { 0.4 + 0.18 * depth } else { 0.93 + 0.07 * depth };
        self.blink.passed = 0.0;
        self.blink.left = if kind > 1.0 - DOUBLE { 0.42 } else { interval };
    }

    /// Sets the eyes' joints, and the shapes of gaze and lids where the face has them.
    fn show(&self, frame: &mut OwnedFrame, tick: &Tick, inside: Angles) {
        let (rig, gain) = (tick.rig, tick.gain);
        let pitch = limited(inside[1], 1);
        for (side, (eye, joint)) in [LEFT, RIGHT].iter().zip(EYES).enumerate() {
            let yaw = limited(inside[0] - eye.side * self.convergence, 0);
            let (mut turned, mut share) = ([yaw, pitch], gain);
            if eye.of_decoders()[1..].iter().all(|&shape| rig.shapes[shape].is_some()) {
                let (out, down) = (eye.side * yaw / SHAPE_TURN[0], pitch / SHAPE_TURN[1]);
                let wanted = [down, -out, out, -down];
                let shown: [f32; 4] = std::array::from_fn(|i| {
                    self.replace(frame, tick, side, i + 1, wanted[i].max(0.0));
                    rig.shape(&frame.face, eye.of_decoders()[i + 1])
                });
                // The joint is where the shapes say.
                turned = [eye.side * SHAPE_TURN[0] * (shown[2] - shown[1]), SHAPE_TURN[1] * (shown[0] - shown[3])];
                share = 1.0;
            }
            let turned = unit(after(turn([0.0, turned[0], 0.0]), turn([turned[1], 0.0, 0.0])));
            let eye_joint = &mut frame.pose.rotations[joint];
            *eye_joint = if share < 1.0 { toward(*eye_joint, turned, share) } else { turned };
            self.show_lids(frame, tick, eye, side);
        }
    }

    /// Sets a shape in place of the decoders' value, under what other layers have added to that.
    fn replace(&self, frame: &mut OwnedFrame, tick: &Tick, side: usize, number: usize, value: f32) {
        let (rig, shape) = (tick.rig, [LEFT, RIGHT][side].of_decoders()[number]);
        let (decoded, now) = (self.decoded[side][number], rig.shape(&frame.face, shape));
        let added = ((now - decoded) / (1.0 - decoded).max(1e-3)).clamp(0.0, 1.0);
        let value = mixed(decoded, value, tick.gain);
        rig.set_shape(&mut frame.face, shape, value + (1.0 - value) * added);
    }

    /// Sets one eye's lids: with the gaze, and closed by a blink.
    fn show_lids(&self, frame: &mut OwnedFrame, tick: &Tick, eye: &Shapes, side: usize) {
        let (rig, gain) = (tick.rig, tick.gain);
        let (down, up) = (rig.shape(&frame.face, eye.down), rig.shape(&frame.face, eye.up));
        let closed = self.blink.closed(if eye.side > 0.0 { 0.0 } else { LATER });
        let lowered = LID_DOWN * down;
        self.replace(frame, tick, side, 0, lowered + (1.0 - lowered) * closed);
        let wide = rig.shape(&frame.face, eye.wide);
        let wide = wide + gain * ((1.0 - wide) * LID_UP * up - closed * wide);
        rig.set_shape(&mut frame.face, eye.wide, wide);
        let squint = rig.shape(&frame.face, eye.squint);
        rig.set_shape(&mut frame.face, eye.squint, squint + gain * 0.08 * closed * (1.0 - squint));
    }

    /// Describes the layer between two ticks.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.switch("gaze", &mut self.is_started)?;
        pass.number("draws of the gaze", &mut self.draws, MAX_DRAWS)?;
        pass.moderate(&mut self.stand)?;
        self.fixation.state(pass)?;
        self.saccade.state(pass)?;
        pass.moderate(&mut self.recentred)?;
        pass.moderate(&mut self.aside)?;
        pass.moderate(std::slice::from_mut(&mut self.convergence))?;
        for spring in self.head.iter_mut().chain(&mut self.trunk) {
            spring.state(pass)?;
        }
        self.blink.state(pass)
    }
}

/// More draws than a stream makes.
const MAX_DRAWS: u64 = 1 << 60;

/// Most seconds that are counted.
const LONG: f32 = 1e3;

/// What the gaze is chosen for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Idle = 0,
    Listening = 1,
    Thinking = 2,
    Speaking = 3,
}

impl State {
    const ALL: [Self; 4] = [Self::Idle, Self::Listening, Self::Thinking, Self::Speaking];

    /// The one that counts most.
    fn most(tick: &Tick) -> Self {
        let weights = [tick.weights.idle, tick.weights.listening, tick.weights.thinking, tick.weights.speaking];
        let most = (1..4).fold(0, |best, i| if weights[i] > weights[best] { i } else { best });
        Self::ALL[most]
    }
}

/// Where the eyes rest between two saccades.
#[derive(Debug, Default)]
struct Fixation {
    state: State,
    /// Whether the state has just changed.
    is_fresh: bool,
    /// Whether it is the listener.
    is_contact: bool,
    /// From the listener's direction.
    offset: Angles,
    /// Seconds until the next.
    left: f32,
}

impl Fixation {
    /// A place in degrees from the listener, for some time of a range of seconds.
    fn set(&mut self, degrees: Angles, range: [f32; 2], how_long: f32, is_contact: bool) {
        self.offset = degrees.map(|angle| angle * DEGREE);
        // Short ones are more frequent than long ones.
        self.left = range[0] + (range[1] - range[0]) * how_long * how_long.sqrt();
        self.is_contact = is_contact;
    }

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let state = pass.limited("gaze", self.state as u64, State::ALL.len() as u64 - 1)?;
        if pass.loads() {
            self.state = State::ALL[usize::try_from(state).unwrap_or_default()];
        }
        pass.switch("gaze", &mut self.is_fresh)?;
        pass.switch("gaze", &mut self.is_contact)?;
        pass.moderate(&mut self.offset)?;
        pass.moderate(std::slice::from_mut(&mut self.left))
    }
}

/// A direction that jumps in the time of a saccade.
#[derive(Debug, Default)]
struct Saccade {
    /// Where to look.
    goal: Angles,
    /// How far from it the saccade began; how long it takes, and for how long it has gone on.
    from: Angles,
    lasts: f32,
    passed: f32,
}

impl Saccade {
    /// Goes on for one tick towards a goal; the size of the jump that begins.
    fn advance(&mut self, goal: Angles, seconds: f32, is_new: bool) -> f32 {
        let jump: Angles = [wrapped(goal[0] - self.goal[0]), goal[1] - self.goal[1]];
        let size = length(jump);
        let begins = size > JUMP && !is_new;
        if begins {
            let rest = self.rest();
            self.from = std::array::from_fn(|axis| rest[axis] - jump[axis]);
            self.lasts = SACCADE + SACCADE_PER * length(self.from);
            self.passed = 0.0;
        }
        self.goal = goal;
        self.passed = (self.passed + seconds).min(LONG);
        if begins { size } else { 0.0 }
    }

    /// What is left of the way, backwards.
    fn rest(&self) -> Angles {
        let left = if self.passed < self.lasts { 1.0 - ease(self.passed / self.lasts) } else { 0.0 };
        self.from.map(|angle| angle * left)
    }

    /// The direction of the eyes.
    fn at(&self, axis: usize) -> f32 {
        self.goal[axis] + self.rest()[axis]
    }

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.moderate(&mut self.goal)?;
        pass.moderate(&mut self.from)?;
        pass.moderate(std::slice::from_mut(&mut self.lasts))?;
        pass.moderate(std::slice::from_mut(&mut self.passed))
    }
}

/// The last blink.
#[derive(Debug)]
struct Blink {
    /// Seconds since it began, and until the next.
    passed: f32,
    left: f32,
    /// How far the lids close.
    depth: f32,
}

impl Default for Blink {
    fn default() -> Self {
        Self { passed: LONG, left: 0.0, depth: 0.0 }
    }
}

impl Blink {
    /// How far a lid is closed that comes so much later.
    fn closed(&self, later: f32) -> f32 {
        let at = self.passed - later;
        let share = match at {
            _ if at < CLOSING => ease(at / CLOSING),
            _ if at < CLOSING + CLOSED => 1.0,
            // Lids open fast and end slowly.
            _ => {
                let left = (1.0 - (at - CLOSING - CLOSED) / OPENING).max(0.0);
                left * left * (3.0 - 2.0 * left) * (0.6 + 0.4 * left)
            }
        };
        self.depth * share
    }

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.moderate(std::slice::from_mut(&mut self.passed))?;
        pass.moderate(std::slice::from_mut(&mut self.left))?;
        pass.moderate(std::slice::from_mut(&mut self.depth))
    }
}

/// The point that the host wants to be looked at, and how much.
fn sought(tick: &Tick) -> ([f32; 3], f32) {
    let place = tick.controls.look_at;
    let strength = tick.controls.look_at_strength;
    let is_good = strength > 0.0 && place.iter().all(|value| value.is_finite());
    (place, if is_good { strength.min(1.0) } else { 0.0 })
}

/// The direction from a place to another, and the distance.
fn direction(from: [f32; 3], to: [f32; 3]) -> (Angles, f32) {
    let way = add(to, from.map(|value| -value));
    (angles(way), (way[0] * way[0] + way[1] * way[1] + way[2] * way[2]).sqrt())
}

/// The direction of a vector; straight ahead for one of no length.
fn angles(way: [f32; 3]) -> Angles {
    let flat = length_of_two(way[0], way[2]);
    [way[0].atan2(way[2]), (-way[1]).atan2(flat)]
}

/// The vector of length 1 in a direction.
fn vector([yaw, pitch]: Angles) -> [f32; 3] {
    let (sin, cos) = pitch.sin_cos();
    [yaw.sin() * cos, -sin, yaw.cos() * cos]
}

/// An angle between -pi and pi.
fn wrapped(angle: f32) -> f32 {
    let turns = (angle / std::f32::consts::TAU).round();
    angle - turns * std::f32::consts::TAU
}

/// `t` of the shorter way from `a` to `b`.
fn mix(a: Angles, b: Angles, t: f32) -> Angles {
    [a[0] + t * wrapped(b[0] - a[0]), a[1] + t * (b[1] - a[1])]
}

fn mixed(a: f32, b: f32, t: f32) -> f32 {
    // Exactly one of them at the ends.
    if t >= 1.0 { b } else { a + t * (b - a) }
}

fn length(angles: Angles) -> f32 {
    length_of_two(angles[0], angles[1])
}

/// An eye's angle within its limits, without an edge.
fn limited(angle: f32, axis: usize) -> f32 {
    let (free, room) = (FREE[axis], MOST[axis] - FREE[axis]);
    let beyond = angle.abs() - free;
    if beyond <= 0.0 { angle } else { (free + room * (beyond / room).tanh()).copysign(angle) }
}
