//! Gaze direction and lids, and the share of head and trunk in a look.
//!
//! Directions are angles in radians about Y, positive to the character's left, and about X, positive
//! down, as an eye's rotation (`motion::pose`).

#[cfg(test)]
mod tests;

use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::inverse;

use super::noise::{Stream, normal, smooth, uniform};
use super::rig::{
    DEGREE, EYES, HEAD, NECK, Rig, SPINE, Spring, add, after, arkit, ease, length_of_two, step, toward, turn,
    turn_in_parent, turn_vector, unit,
};
use super::{Attention, Mood, Tick};

/// How far a dull voice looks down where it does not look at the listener.
const LOW_GAZE: f32 = 8.0 * DEGREE;

/// Turn of an ARKit eye at 1.0, radians: sideways, and up or down (`motion::pose`).
const EYE_SHAPE_ANGLE: Angles = [30.0 * DEGREE, 25.0 * DEGREE];

/// Eye angle up to which the turn is not damped, and its limit: sideways, and up or down.
const UNDAMPED_EYE_ANGLE: Angles = [19.0 * DEGREE, 14.0 * DEGREE];
const MAX_EYE_ANGLE: Angles = [25.0 * DEGREE, 18.0 * DEGREE];

/// Eye angle beyond which the eyes drift back to it, and the time constant of that, seconds.
const COMFORTABLE_EYE_ANGLE: Angles = [13.0 * DEGREE, 10.0 * DEGREE];
const RECENTRE_SECONDS: f32 = 1.5;

/// Distance of the assumed listener without a look-at target, metres, and the time constant with which
/// the listener's position follows the body's position and heading, seconds.
const LISTENER_DISTANCE: f32 = 1.5;
const LISTENER_FOLLOW_SECONDS: f32 = 3.0;

/// Angles from the heading between which the look at the other of a scene fades out: nobody is looked at behind the back.
const COMPANY_ANGLE: [f32; 2] = [110.0 * DEGREE, 150.0 * DEGREE];
/// Distance by which that place jumps in a tick if it is another one's, metres.
const COMPANY_JUMP: f32 = 0.1;

/// Half the distance between the eyes, and the nearest point of convergence, metres.
const HALF_EYE_DISTANCE: f32 = 0.032;
const MIN_CONVERGENCE_DISTANCE: f32 = 0.25;

/// Time constant of the convergence, seconds: eyes change distance more slowly than direction.
const CONVERGENCE_SECONDS: f32 = 0.08;

/// Duration of a saccade: seconds, and seconds per radian (main sequence: 2.2 ms a degree).
const SACCADE_SECONDS: f32 = 0.021;
const SACCADE_SECONDS_PER_RADIAN: f32 = 0.0022 / DEGREE;

/// A change of the goal above this in a tick starts a saccade; a smaller one is pursued smoothly.
const SACCADE_THRESHOLD: f32 = 1.2 * DEGREE;

/// Share of the head in a look away from the listener, for the part beyond this angle.
const AVERTED_HEAD_SHARE: f32 = 0.45;
const AVERTED_HEAD_FROM: f32 = 4.0 * DEGREE;

/// Share of the head in a glance with a gesture, of what its own motion leaves.
const GLANCE_HEAD_SHARE: f32 = 0.3;

/// Trunk in a look-at: share of the angle beyond the first value, and limit.
const LOOK_AT_TRUNK_FROM: f32 = 27.0 * DEGREE;
const LOOK_AT_TRUNK_SHARE: f32 = 0.6;
const MAX_TRUNK_ANGLE: Angles = [38.0 * DEGREE, 12.0 * DEGREE];

/// Head in a look-at: share of the angle, less the trunk's turn, and limit.
const LOOK_AT_HEAD_SHARE: f32 = 0.85;
const MAX_HEAD_ANGLE: Angles = [52.0 * DEGREE, 28.0 * DEGREE];

/// Spring frequencies of head and trunk, radians a second: 95 % in 0.35 and 0.75 s.
const HEAD_SPRING_RATE: f32 = 13.5;
const TRUNK_SPRING_RATE: f32 = 6.5;

/// Slow turn of the head towards a sustained eye direction: time constant in seconds, share and limit.
const FACE_TURN_SECONDS: f32 = 2.0;
const FACE_TURN_SHARE: f32 = 0.7;
/// Factor on that share for a mood with its own head posture.
const FACE_TURN_MOOD_FACTOR: f32 = 0.35;
const MAX_FACE_TURN: Angles = [15.0 * DEGREE, 15.0 * DEGREE];

/// Share of the neck in the head's turn.
const NECK_SHARE: f32 = 0.4;

/// Drift during a fixation: standard deviation, and direction changes per second.
const EYE_DRIFT: f32 = 0.12 * DEGREE;
const EYE_DRIFT_RATE: f64 = 2.5;

/// Seconds of a blink: lids closing, closed, opening, and delay of the right lid.
const LID_CLOSING_SECONDS: f32 = 0.085;
const LID_CLOSED_SECONDS: f32 = 0.03;
const LID_OPENING_SECONDS: f32 = 0.165;
const RIGHT_LID_DELAY_SECONDS: f32 = 0.006;

/// Interval between spontaneous blinks, seconds: median, standard deviation of its logarithm, and limits;
/// `TRIGGERED_BLINK_MIN_SECONDS` is the least interval before a blink that a gaze shift or phrase end triggers.
const BLINK_MEDIAN_SECONDS: f32 = 3.6;
const BLINK_LOG_DEVIATION: f32 = 0.4;
const BLINK_MIN_SECONDS: f32 = 1.1;
const TRIGGERED_BLINK_MIN_SECONDS: f32 = 1.8;
const BLINK_MAX_SECONDS: f32 = 7.5;

/// Probability of a blink on a large gaze shift and at the end of a phrase; shares of half blinks and of
/// blinks that another follows at once.
const SHIFT_BLINK_PROBABILITY: f32 = 0.12;
const PHRASE_END_BLINK_PROBABILITY: f32 = 0.4;
const HALF_BLINK_SHARE: f32 = 0.12;
const DOUBLE_BLINK_SHARE: f32 = 0.06;

/// Gaze shift that may trigger a blink.
const BLINK_SHIFT_ANGLE: f32 = 9.0 * DEGREE;

/// Lid motion with the gaze at a shape's 1.0: lowered with it, and wide open with it.
const LID_DOWN: f32 = 0.32;
const LID_UP: f32 = 0.3;

/// Random streams.
const CHOICE: Stream = Stream(100);
const BLINK: Stream = Stream(101);
const DRIFTS: Stream = Stream(102);

type Angles = [f32; 2];

/// Face shapes of one eye.
struct Shapes {
    blink: usize,
    down: usize,
    inwards: usize,
    outwards: usize,
    up: usize,
    squint: usize,
    wide: usize,
    /// 1 if outwards is towards +X (the left eye), -1 if it is towards -X.
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

/// State of eyes and lids.
#[derive(Debug)]
pub(super) struct Gaze {
    is_started: bool,
    /// Number of random draws so far.
    draws: u64,
    /// Low-passed body placement that the listener's position derives from: x and z of root and heading.
    stand: [f32; 4],
    /// Place of the other of a scene at the previous tick.
    partner: Option<[f32; 3]>,
    fixation: Fixation,
    saccade: Saccade,
    /// Return of the eyes towards the centre, relative to the wanted direction.
    recentred: Angles,
    /// Inward turn of each eye, radians.
    convergence: f32,
    /// Low-passed eye direction without the head's slow turn (`faced`).
    aside: Angles,
    head: [Spring; 2],
    trunk: [Spring; 2],
    blink: Blink,
    /// The decoders' values of gaze and lids at this tick, in the order of [`Shapes::of_decoders`].
    decoded: [[f32; 5]; 2],
}

impl Shapes {
    /// Shapes whose decoded values the layer replaces.
    fn of_decoders(&self) -> [usize; 5] {
        [self.blink, self.down, self.inwards, self.outwards, self.up]
    }
}

impl Gaze {
    pub(crate) fn new() -> Self {
        Self {
            is_started: false,
            draws: 0,
            stand: [0.0; 4],
            partner: None,
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

    /// Reads the decoders' values that the layer replaces. Later additions of other layers are kept.
    pub(super) fn read(&mut self, frame: &OwnedFrame, rig: &Rig) {
        self.decoded = [LEFT, RIGHT].map(|eye| eye.of_decoders().map(|shape| rig.shape(&frame.face, shape)));
    }

    /// Applies one tick to the frame.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, tick: &Tick) {
        let is_new = !self.is_started;
        if is_new {
            self.is_started = true;
            self.blink.left = 1.0 + 2.0 * self.draw(tick, BLINK);
        }
        self.follow(&frame.pose, tick, is_new);
        match tick.controls.company.looks_at() {
            Some(place) if tick.controls.attention == Attention::Auto => self.accompany(tick, place),
            _ => self.choose(tick),
        }
        let (place, strength) = sought(tick);
        let partner = self.partner(&frame.pose, tick);
        self.turn(&mut frame.pose, tick, partner, (place, strength));

        // Wanted direction in the avatar's space.
        let rig = tick.rig;
        let (eyes, head) = rig.head(&frame.pose);
        let (mut listener, mut distance) = direction(eyes, self.listener(rig));
        let mut held = strength;
        if let Some((place, share)) = partner {
            let (there, away) = direction(eyes, place);
            listener = mix(listener, there, share);
            distance += share * (away - distance);
            held = held.max(share);
        }
        let mut goal: Angles = std::array::from_fn(|axis| listener[axis] + self.fixation.offset[axis]);
        if !self.fixation.is_contact {
            goal[1] += LOW_GAZE * (-tick.lively).max(0.0);
        }
        if let Some([aside, down]) = tick.glance {
            goal = [wrapped(self.heading() + aside), down];
        }
        if strength > 0.0 {
            let (sought, away) = direction(eyes, place);
            goal = mix(goal, sought, strength);
            distance += strength * (away - distance);
        }
        let shift = self.saccade.advance(goal, tick.seconds, is_new);

        // Direction in the head's frame.
        let drift = smooth(tick.seed, DRIFTS, tick.time(), EYE_DRIFT_RATE);
        let looks: Angles = std::array::from_fn(|axis| self.saccade.at(axis) + EYE_DRIFT / 0.4 * drift[axis]);
        let inside = angles(turn_vector(inverse(head), vector(looks)));
        let share = step(tick.seconds, FACE_TURN_SECONDS);
        let back = step(tick.seconds, RECENTRE_SECONDS);
        for (axis, &angle) in inside.iter().enumerate() {
            let without = angle + tick.gain * self.faced(tick, axis);
            self.aside[axis] += share * (without - self.aside[axis]);
            let outside =
                (1.0 - held) * (angle - angle.clamp(-COMFORTABLE_EYE_ANGLE[axis], COMFORTABLE_EYE_ANGLE[axis]));
            self.recentred[axis] += back * (outside - self.recentred[axis]);
        }
        let inside: Angles = std::array::from_fn(|axis| inside[axis] - self.recentred[axis]);
        let convergence = (HALF_EYE_DISTANCE / distance.max(MIN_CONVERGENCE_DISTANCE)).arc_tangent();
        let share = if is_new { 1.0 } else { step(tick.seconds, CONVERGENCE_SECONDS) };
        self.convergence += share * (convergence - self.convergence);
        self.blink(tick, shift);
        self.show(frame, tick, inside);
    }

    /// Draws a number in `0..1`.
    fn draw(&mut self, tick: &Tick, stream: Stream) -> f32 {
        self.draws += 1;
        uniform(tick.seed, stream, self.draws)
    }

    /// Draws a number of mean 0 and standard deviation 1.
    fn draw_normal(&mut self, tick: &Tick, stream: Stream) -> f32 {
        self.draws += 1;
        normal(tick.seed, stream, self.draws)
    }

    /// Lets the listener's position follow the body slowly.
    fn follow(&mut self, pose: &Pose, tick: &Tick, is_new: bool) {
        let ahead = turn_vector(pose.rotations[0], [0.0, 0.0, 1.0]);
        let share = if is_new { 1.0 } else { step(tick.seconds, LISTENER_FOLLOW_SECONDS) };
        let now = [pose.translation[0], pose.translation[2], ahead[0], ahead[2]];
        for (value, now) in self.stand.iter_mut().zip(now) {
            *value += share * (now - *value);
        }
    }

    /// Low-passed heading of the body.
    fn heading(&self) -> f32 {
        self.stand[2].arc_tangent_over(self.stand[3])
    }

    /// Position of the listener's eyes, metres.
    fn listener(&self, rig: &Rig) -> [f32; 3] {
        let heading = self.heading();
        [
            self.stand[0] + LISTENER_DISTANCE * heading.sine(),
            rig.eye_height,
            self.stand[1] + LISTENER_DISTANCE * heading.cosine(),
        ]
    }

    /// Place of the eyes of the other of a scene, and how far it is within reach, 0 to 1.
    fn partner(&self, pose: &Pose, tick: &Tick) -> Option<([f32; 3], f32)> {
        let [x, y, z] = tick.controls.company.looks_at()?;
        let place = [x, tick.rig.eye_height + y, z];
        let (there, _) = direction(tick.rig.head(pose).0, place);
        let [from, to] = COMPANY_ANGLE;
        let share = 1.0 - ease((wrapped(there[0] - self.heading()).abs() - from) / (to - from));
        (share > 0.0 && place.iter().all(|value| value.is_finite())).then_some((place, share))
    }

    /// Fixates the other of a scene, or past it, as the scene says; chooses where exactly.
    fn accompany(&mut self, tick: &Tick, place: [f32; 3]) {
        let before = self.partner.replace(place);
        let is_same = |before: [f32; 3]| before.iter().zip(place).all(|(a, b)| (a - b).abs() < COMPANY_JUMP);
        let is_new = !before.is_some_and(is_same);
        let is_contact = tick.controls.company.is_contact;
        self.fixation.left -= tick.seconds;
        if !is_new && is_contact == self.fixation.is_contact && self.fixation.left > 0.0 {
            return;
        }
        let state = State::most(tick);
        (self.fixation.state, self.fixation.is_fresh) = (state, false);
        if is_contact {
            self.look_there(tick, state);
        } else {
            self.look_away(tick, state);
        }
    }

    /// Chooses the next fixation if it is due.
    fn choose(&mut self, tick: &Tick) {
        self.partner = None;
        let weights = &tick.weights;
        self.fixation.left -= tick.seconds;
        // Speakers look away as they begin, and at the listener as they end.
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
            // A short delay after the change of state.
            self.fixation.left = self.fixation.left.min(0.1 + 0.25 * self.draw(tick, CHOICE));
        }
        if self.fixation.left > 0.0 {
            return;
        }
        // Listening begins with a look at the interlocutor, thinking with a look away.
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

    /// Looks at one of the listener's eyes or at the mouth.
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
            // Others see each other's eyes: past the face, not at its edge.
            State::Listening if self.partner.is_some() => ([8.0, 16.0], [-4.0, 9.0], [0.7, 2.2]),
            State::Speaking if self.partner.is_some() => ([11.0, 25.0], [-6.0, 13.0], [0.9, 2.9]),
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

    /// Turn of the head towards a sustained eye direction.
    fn faced(&self, tick: &Tick, axis: usize) -> f32 {
        let is_held = !matches!(tick.controls.mood, Mood::Neutral | Mood::Joy);
        let strength = if is_held { tick.controls.mood_strength.clamp(0.0, 1.0) } else { 0.0 };
        let share = FACE_TURN_SHARE * (1.0 - (1.0 - FACE_TURN_MOOD_FACTOR) * strength);
        (share * self.aside[axis]).clamp(-MAX_FACE_TURN[axis], MAX_FACE_TURN[axis])
    }

    /// Turns trunk and head towards the target, after the eyes.
    fn turn(
        &mut self,
        pose: &mut Pose,
        tick: &Tick,
        partner: Option<([f32; 3], f32)>,
        (place, strength): ([f32; 3], f32),
    ) {
        let offset = self.fixation.offset;
        let beyond = |angle: f32, from: f32| angle - angle.clamp(-from, from);
        let away = |axis: usize| AVERTED_HEAD_SHARE * beyond(offset[axis], AVERTED_HEAD_FROM) + self.faced(tick, axis);
        let mut head: Angles = std::array::from_fn(away);
        if let Some([aside, down]) = tick.glance {
            let ahead = angles(turn_vector(tick.rig.head(pose).1, [0.0, 0.0, 1.0]));
            let left = [wrapped(self.heading() + aside - ahead[0]), down - ahead[1]];
            head = std::array::from_fn(|axis| GLANCE_HEAD_SHARE * left[axis] + self.faced(tick, axis));
        }
        let mut trunk = [0.0; 2];
        let eyes = tick.rig.head(pose).0;
        let aim = |place: [f32; 3], strength: f32| {
            let (sought, _) = direction(eyes, place);
            let from_body = [wrapped(sought[0] - self.heading()), sought[1]];
            std::array::from_fn::<_, 2, _>(|axis| {
                let turn = LOOK_AT_TRUNK_SHARE * beyond(from_body[axis], LOOK_AT_TRUNK_FROM);
                let trunk = strength * turn.clamp(-MAX_TRUNK_ANGLE[axis], MAX_TRUNK_ANGLE[axis]);
                let rest = strength * LOOK_AT_HEAD_SHARE * from_body[axis] - trunk;
                (trunk, rest.clamp(-MAX_HEAD_ANGLE[axis], MAX_HEAD_ANGLE[axis]))
            })
        };
        // The eyes leave the other's face, and the head hardly.
        if let Some((place, share)) = partner {
            for (axis, (turned, rest)) in aim(place, share).into_iter().enumerate() {
                trunk[axis] = turned;
                head[axis] = (head[axis] + rest).clamp(-MAX_HEAD_ANGLE[axis], MAX_HEAD_ANGLE[axis]);
            }
        }
        if strength > 0.0 {
            for (axis, (turned, rest)) in aim(place, strength).into_iter().enumerate() {
                trunk[axis] = if partner.is_some() { (1.0 - strength) * trunk[axis] + turned } else { turned };
                head[axis] = (1.0 - strength) * head[axis] + rest;
            }
        }
        for axis in 0..2 {
            self.head[axis].follow(head[axis], HEAD_SPRING_RATE, tick.seconds);
            self.trunk[axis].follow(trunk[axis], TRUNK_SPRING_RATE, tick.seconds);
        }
        let turned = |joint: &mut _, springs: &[Spring; 2], share: f32| {
            let share = share * tick.gain;
            // Yaw after pitch.
            turn_in_parent(joint, [share * springs[1].at, 0.0, 0.0]);
            turn_in_parent(joint, [0.0, share * springs[0].at, 0.0]);
        };
        for joint in SPINE {
            turned(&mut pose.rotations[joint], &self.trunk, 1.0 / SPINE.len() as f32);
        }
        turned(&mut pose.rotations[NECK], &self.head, NECK_SHARE);
        turned(&mut pose.rotations[HEAD], &self.head, 1.0 - NECK_SHARE);
    }

    /// Begins a blink if one is due or triggered.
    fn blink(&mut self, tick: &Tick, shift: f32) {
        let blink = &mut self.blink;
        blink.left -= tick.seconds;
        blink.passed = (blink.passed + tick.seconds).min(COUNTER_CAP_SECONDS);
        let is_free = blink.passed > TRIGGERED_BLINK_MIN_SECONDS;
        let is_due = blink.left <= 0.0;
        let brought = match () {
            () if !is_free => false,
            () if tick.weights.own.ends => self.draw(tick, BLINK) < PHRASE_END_BLINK_PROBABILITY,
            () if shift > BLINK_SHIFT_ANGLE => self.draw(tick, BLINK) < SHIFT_BLINK_PROBABILITY,
            () => false,
        };
        if !(is_due || brought) {
            return;
        }
        let [kind, depth] = std::array::from_fn(|_| self.draw(tick, BLINK));
        let interval = BLINK_MEDIAN_SECONDS * (BLINK_LOG_DEVIATION * self.draw_normal(tick, BLINK)).exponential();
        // Thinking, listening and idle avatars blink slightly less.
        let calm = 1.0 + 0.2 * tick.weights.listening + 0.2 * tick.weights.thinking + 0.1 * tick.weights.idle;
        let interval = (interval * calm).clamp(BLINK_MIN_SECONDS, BLINK_MAX_SECONDS);
        let is_half = kind < HALF_BLINK_SHARE;
        self.blink.depth = if is_half { 0.4 + 0.18 * depth } else { 0.93 + 0.07 * depth };
        self.blink.passed = 0.0;
        self.blink.left = if kind > 1.0 - DOUBLE_BLINK_SHARE { 0.42 } else { interval };
    }

    /// Sets the eyes' joints, and the shapes of gaze and lids if the face has them.
    fn show(&self, frame: &mut OwnedFrame, tick: &Tick, inside: Angles) {
        let (rig, gain) = (tick.rig, tick.gain);
        let pitch = limited(inside[1], 1);
        for (side, (eye, joint)) in [LEFT, RIGHT].iter().zip(EYES).enumerate() {
            let yaw = limited(inside[0] - eye.side * self.convergence, 0);
            let (mut turned, mut share) = ([yaw, pitch], gain);
            if eye.of_decoders()[1..].iter().all(|&shape| rig.shapes[shape].is_some()) {
                let (out, down) = (eye.side * yaw / EYE_SHAPE_ANGLE[0], pitch / EYE_SHAPE_ANGLE[1]);
                let wanted = [down, -out, out, -down];
                let shown: [f32; 4] = std::array::from_fn(|i| {
                    self.replace(frame, tick, side, i + 1, wanted[i].max(0.0));
                    rig.shape(&frame.face, eye.of_decoders()[i + 1])
                });
                // The joint matches the shapes.
                turned =
                    [eye.side * EYE_SHAPE_ANGLE[0] * (shown[2] - shown[1]), EYE_SHAPE_ANGLE[1] * (shown[0] - shown[3])];
                share = 1.0;
            }
            let turned = unit(after(turn([0.0, turned[0], 0.0]), turn([turned[1], 0.0, 0.0])));
            let eye_joint = &mut frame.pose.rotations[joint];
            *eye_joint = if share < 1.0 { toward(*eye_joint, turned, share) } else { turned };
            self.show_lids(frame, tick, eye, side);
        }
    }

    /// Replaces the decoders' value of a shape and keeps what other layers have added to it.
    fn replace(&self, frame: &mut OwnedFrame, tick: &Tick, side: usize, number: usize, value: f32) {
        let (rig, shape) = (tick.rig, [LEFT, RIGHT][side].of_decoders()[number]);
        let (decoded, now) = (self.decoded[side][number], rig.shape(&frame.face, shape));
        let added = ((now - decoded) / (1.0 - decoded).max(1e-3)).clamp(0.0, 1.0);
        let value = mixed(decoded, value, tick.gain);
        rig.set_shape(&mut frame.face, shape, value + (1.0 - value) * added);
    }

    /// Sets one eye's lids: lowered or raised with the gaze, and closed by a blink.
    fn show_lids(&self, frame: &mut OwnedFrame, tick: &Tick, eye: &Shapes, side: usize) {
        let (rig, gain) = (tick.rig, tick.gain);
        let (down, up) = (rig.shape(&frame.face, eye.down), rig.shape(&frame.face, eye.up));
        let closed = self.blink.closed(if eye.side > 0.0 { 0.0 } else { RIGHT_LID_DELAY_SECONDS });
        let lowered = LID_DOWN * down;
        self.replace(frame, tick, side, 0, lowered + (1.0 - lowered) * closed);
        let wide = rig.shape(&frame.face, eye.wide);
        let wide = wide + gain * ((1.0 - wide) * LID_UP * up - closed * wide);
        rig.set_shape(&mut frame.face, eye.wide, wide);
        let squint = rig.shape(&frame.face, eye.squint);
        rig.set_shape(&mut frame.face, eye.squint, squint + gain * 0.08 * closed * (1.0 - squint));
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.switch("gaze", &mut self.is_started)?;
        pass.number("draws of the gaze", &mut self.draws, MAX_DRAWS)?;
        pass.moderate(&mut self.stand)?;
        let is_there = pass.flag("gaze", self.partner.is_some())?;
        let mut partner = self.partner.unwrap_or_default();
        pass.places(&mut partner)?;
        if pass.loads() {
            self.partner = is_there.then_some(partner);
        }
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

/// Upper bound on the draws of a stream.
const MAX_DRAWS: u64 = 1 << 60;

/// Cap of the time counters, seconds.
const COUNTER_CAP_SECONDS: f32 = 1e3;

/// Attention state that a fixation is chosen for.
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

    /// The state with the largest weight.
    fn most(tick: &Tick) -> Self {
        let weights = [tick.weights.idle, tick.weights.listening, tick.weights.thinking, tick.weights.speaking];
        let most = (1..4).fold(0, |best, i| if weights[i] > weights[best] { i } else { best });
        Self::ALL[most]
    }
}

/// Eye direction between two saccades.
#[derive(Debug, Default)]
struct Fixation {
    state: State,
    /// Whether the state has just changed.
    is_fresh: bool,
    /// Whether the target is the listener.
    is_contact: bool,
    /// Offset from the listener's direction.
    offset: Angles,
    /// Seconds until the next fixation.
    left: f32,
}

impl Fixation {
    /// Sets an offset in degrees from the listener and draws the duration from a range of seconds.
    fn set(&mut self, degrees: Angles, range: [f32; 2], how_long: f32, is_contact: bool) {
        self.offset = degrees.map(|angle| angle * DEGREE);
        // Short fixations are more frequent than long ones.
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

/// Eye direction, which jumps to its goal in the time of a saccade.
#[derive(Debug, Default)]
struct Saccade {
    /// Wanted direction.
    goal: Angles,
    /// Offset from the goal at the start of the saccade; its duration and elapsed time, seconds.
    from: Angles,
    lasts: f32,
    passed: f32,
}

impl Saccade {
    /// Advances by one tick towards a goal; returns the size of a saccade that begins, else 0.
    fn advance(&mut self, goal: Angles, seconds: f32, is_new: bool) -> f32 {
        let jump: Angles = [wrapped(goal[0] - self.goal[0]), goal[1] - self.goal[1]];
        let size = length(jump);
        let begins = size > SACCADE_THRESHOLD && !is_new;
        if begins {
            let rest = self.rest();
            self.from = std::array::from_fn(|axis| rest[axis] - jump[axis]);
            self.lasts = SACCADE_SECONDS + SACCADE_SECONDS_PER_RADIAN * length(self.from);
            self.passed = 0.0;
        }
        self.goal = goal;
        self.passed = (self.passed + seconds).min(COUNTER_CAP_SECONDS);
        if begins { size } else { 0.0 }
    }

    /// Remaining offset from the goal.
    fn rest(&self) -> Angles {
        let left = if self.passed < self.lasts { 1.0 - ease(self.passed / self.lasts) } else { 0.0 };
        self.from.map(|angle| angle * left)
    }

    /// Current eye direction.
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
    /// Largest closure of the lids.
    depth: f32,
}

impl Default for Blink {
    fn default() -> Self {
        Self { passed: COUNTER_CAP_SECONDS, left: 0.0, depth: 0.0 }
    }
}

impl Blink {
    /// Closure of a lid that is `later` seconds behind.
    fn closed(&self, later: f32) -> f32 {
        let at = self.passed - later;
        let share = match at {
            _ if at < LID_CLOSING_SECONDS => ease(at / LID_CLOSING_SECONDS),
            _ if at < LID_CLOSING_SECONDS + LID_CLOSED_SECONDS => 1.0,
            // Lids open fast at first and slow down.
            _ => {
                let left = (1.0 - (at - LID_CLOSING_SECONDS - LID_CLOSED_SECONDS) / LID_OPENING_SECONDS).max(0.0);
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

/// The host's look-at target and its strength.
fn sought(tick: &Tick) -> ([f32; 3], f32) {
    let place = tick.controls.look_at;
    let strength = tick.controls.look_at_strength;
    let is_good = strength > 0.0 && place.iter().all(|value| value.is_finite());
    (place, if is_good { strength.min(1.0) } else { 0.0 })
}

/// Direction and distance from one point to another.
fn direction(from: [f32; 3], to: [f32; 3]) -> (Angles, f32) {
    let way = add(to, from.map(|value| -value));
    (angles(way), (way[0] * way[0] + way[1] * way[1] + way[2] * way[2]).sqrt())
}

/// Direction of a vector; straight ahead for a zero vector.
fn angles(way: [f32; 3]) -> Angles {
    let flat = length_of_two(way[0], way[2]);
    [way[0].arc_tangent_over(way[2]), (-way[1]).arc_tangent_over(flat)]
}

/// Unit vector of a direction.
fn vector([yaw, pitch]: Angles) -> [f32; 3] {
    let (sin, cos) = pitch.sine_cosine();
    [yaw.sine() * cos, -sin, yaw.cosine() * cos]
}

/// Wraps an angle to -pi to pi.
fn wrapped(angle: f32) -> f32 {
    let turns = (angle / std::f32::consts::TAU).round();
    angle - turns * std::f32::consts::TAU
}

/// Interpolates from `a` to `b` by `t`, yaw the shorter way round.
fn mix(a: Angles, b: Angles, t: f32) -> Angles {
    [a[0] + t * wrapped(b[0] - a[0]), a[1] + t * (b[1] - a[1])]
}

fn mixed(a: f32, b: f32, t: f32) -> f32 {
    // Exactly `b` at the end.
    if t >= 1.0 { b } else { a + t * (b - a) }
}

fn length(angles: Angles) -> f32 {
    length_of_two(angles[0], angles[1])
}

/// Limits an eye's angle smoothly.
fn limited(angle: f32, axis: usize) -> f32 {
    let (free, room) = (UNDAMPED_EYE_ANGLE[axis], MAX_EYE_ANGLE[axis] - UNDAMPED_EYE_ANGLE[axis]);
    let beyond = angle.abs() - free;
    if beyond <= 0.0 { angle } else { (free + room * (beyond / room).hyperbolic_tangent()).copysign(angle) }
}
