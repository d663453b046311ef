//! Gestures on command, over the model's motion (SPEC 2.17).
//!
//! A gesture has a preparation, in which it fades in; a stroke, which may be timed; a hold; and a
//! retraction, in which it fades out. Arms take the shorter way from the model's pose to the gesture's,
//! so a gesture can begin and end at any pose of the model. A built-in gesture adds its motion of head,
//! trunk and face to the model's; a clip is blended over it. Parts that a gesture does not move stay
//! the model's.
//!
//! | module | contents |
//! |---|---|
//! | `table` | built-in gestures that act alone: keys of hands, curves of head, trunk and face |
//! | `speech` | those that go with words, and variants |
//! | `curve` | interpolation between keys |
//! | `arm` | inverse kinematics of an arm with a hand at a place, or pointing at one |
//! | `hand` | hand shapes |
//! | `clip` | the host's own gestures |
//! | `set` | gestures by name |

mod arm;
mod clip;
mod curve;
mod hand;
mod set;
mod speech;
mod table;

use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::{MAX_INDEX, OwnedFrame};
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{Quat, axis_angle_to_quat, inverse, product, rotate, slerp};

use super::Tick;
use super::noise::{Stream, uniform};
use super::rig::{Rig, length_of_two};
use crate::error::RequestError;
use arm::{ArmPose, Vec3, less};
use curve::{ease, through};
use table::{Arms, Channel, MOTIONS, Motion};

pub(crate) use arm::{Arm, ArmTarget, LEFT, RIGHT};
pub use clip::Gesture;
pub(crate) use hand::RELAXED;
pub use set::{GestureParts, Gestures, MAX_GESTURES};

/// Upper bound on the gestures that wait to be played.
pub const MAX_PENDING_GESTURES: usize = 8;
/// Upper bound on the gestures shown at once, including those that fade out.
const MAX_SHOWN: usize = 8;
/// Shortest fade-out after an interrupt, seconds.
const MIN_RELEASE_SECONDS: f32 = 0.3;
/// Default target of a pointing arm: ahead, slightly to the side.
const DEFAULT_POINTING_TARGET: Vec3 = [0.9, 0.15, 3.0];
/// Largest speed of a word's gesture that begins late, relative to its own.
const MOST_HURRY: f32 = 1.5;
/// Upper bound on the gestures that are shown when one of a word begins: the others are the host's.
const MAX_SHOWN_BEFORE_WORD: usize = MAX_SHOWN / 2;
/// A glance with a word's gesture: from and until when, seconds after the stroke.
const GLANCE: [f32; 2] = [-0.15, 0.4];
/// While a word's gesture takes its strength from the voice, seconds after the stroke.
const EMPHASIS: [f32; 2] = [-0.25, 0.1];
/// Factors of that strength where the voice is this far below its loud level, dB, and the factor's largest change a second.
const EMPHASES: [f32; 2] = [1.2, 0.85];
const EMPHASES_BELOW_LOUD: [f32; 2] = [2.0, 10.0];
const EMPHASIS_RATE: f32 = 0.6;
/// How much less the arms go to the pose of a word's gesture, of what its strength lacks.
const WEAK_ARMS: f32 = 0.4;
/// Lag of an arm's joints behind its shoulder, seconds.
const ELBOW_LAG_SECONDS: f32 = 0.03;
const WRIST_LAG_SECONDS: f32 = 0.07;
/// Lag of the second arm (the left, unless mirrored) if both move, seconds.
const SECOND_ARM_LAG_SECONDS: f32 = 0.035;
/// Stream of the variations of gestures: the seed is the variant.
const VARIANT_STREAM: Stream = Stream(500);
/// Largest absolute coordinate of a target, metres.
const MAX_DISTANCE: f32 = 10_000.0;
/// Share of the neck in a turn of the head.
const NECK_SHARE: f32 = 0.42;

const SPINE: [usize; 3] = [3, 6, 9];
const CHEST: usize = 9;
const NECK_JOINT: usize = 12;
const HEAD_JOINT: usize = 15;
const HIPS: [usize; 2] = [1, 2];
const COLLARS: [(usize, f32); 2] = [(13, 1.0), (14, -1.0)];

/// Hand that performs a gesture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Side {
    /// The right hand; with a target, the hand on the target's side.
    #[default]
    Auto = 0,
    /// The left hand; the whole gesture is mirrored.
    Left = 1,
    /// The right hand.
    Right = 2,
    /// Both hands, if a one-handed gesture can be done with both; else as `Auto`.
    Both = 3,
}

impl Side {
    /// All values in numeric order.
    pub const ALL: [Self; 4] = [Self::Auto, Self::Left, Self::Right, Self::Both];
}

/// Options of a gesture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GestureOptions {
    /// Time of the stroke, in seconds of the motion (frame index / 30). The preparation begins early enough
    /// for it, or at once if it is too late for that. `None`: as soon as the gesture's parts are free.
    pub at: Option<f64>,
    /// Speed, 0.5 to 2.
    pub speed: f32,
    /// Strength, 0 to 1: less is nearer to the model's motion.
    pub strength: f32,
    /// Hand.
    pub side: Side,
    /// Target in the avatar's space, metres, for gestures that point; `None` points ahead.
    pub target: Option<[f32; 3]>,
    /// Variant. 0 is the gesture as drawn. Others go through its poses in turn, and each number has a size,
    /// height and speed of its own, a little off the drawn ones.
    pub variant: u8,
}

impl Default for GestureOptions {
    fn default() -> Self {
        Self { at: None, speed: 1.0, strength: 1.0, side: Side::Auto, target: None, variant: 0 }
    }
}

impl GestureOptions {
    /// Sets the time of the stroke, in seconds of the motion.
    #[must_use]
    pub fn at(mut self, seconds: f64) -> Self {
        self.at = Some(seconds);
        self
    }

    /// Sets the speed, 0.5 to 2.
    #[must_use]
    pub fn speed(mut self, speed: f32) -> Self {
        self.speed = speed;
        self
    }

    /// Sets the strength, 0 to 1.
    #[must_use]
    pub fn strength(mut self, strength: f32) -> Self {
        self.strength = strength;
        self
    }

    /// Sets the hand.
    #[must_use]
    pub fn side(mut self, side: Side) -> Self {
        self.side = side;
        self
    }

    /// Sets the target to point at, metres.
    #[must_use]
    pub fn target(mut self, place: [f32; 3]) -> Self {
        self.target = Some(place);
        self
    }

    /// Sets the variant.
    #[must_use]
    pub fn variant(mut self, variant: u8) -> Self {
        self.variant = variant;
        self
    }
}

/// Gesture that the host requested.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// Number of the gesture in [`Gestures`], or of a variant's pose.
    gesture: u32,
    /// Frame of the stroke.
    at: Option<u64>,
    speed: f32,
    strength: f32,
    side: Side,
    target: Option<[f32; 3]>,
    variant: u8,
    /// Epoch of the request.
    epoch: u32,
}

impl Request {
    pub(super) const NONE: Self =
        Self { gesture: 0, at: None, speed: 1.0, strength: 0.0, side: Side::Auto, target: None, variant: 0, epoch: 0 };

    /// Validates the host's request.
    pub fn new(
        gestures: &Gestures,
        name: &str,
        options: &GestureOptions,
        frame_rate: usize,
        epoch: u32,
    ) -> Result<Self, RequestError> {
        let GestureOptions { at, speed, strength, side, target, variant } = *options;
        let gesture = gestures.find(name).ok_or(RequestError::UnknownGesture)?;
        let gesture = gestures.pose(gesture, variant);
        if !(0.5..=2.0).contains(&speed) || !(0.0..=1.0).contains(&strength) {
            return Err(RequestError::GestureOptions);
        }
        if target.is_some_and(|place| !place.iter().all(|value| value.abs() <= MAX_DISTANCE)) {
            return Err(RequestError::GestureTarget);
        }
        let last = MAX_INDEX as f64 / frame_rate as f64;
        if at.is_some_and(|at| !(0.0..=last).contains(&at)) {
            return Err(RequestError::GestureTime);
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the limits")]
        let at = at.map(|at| (at * frame_rate as f64).round() as u64);
        let speed = (speed * Variation::of(variant).speed).clamp(0.5, 2.0);
        Ok(Self { gesture, at, speed, strength, side, target, variant, epoch })
    }

    /// Request of a word.
    pub(super) fn of_word(gesture: u32, variant: u8, speed: f32, strength: f32, side: Side) -> Self {
        let speed = (speed * Variation::of(variant).speed).clamp(0.5, 2.0);
        Self { gesture, speed, strength, side, variant, ..Self::NONE }
    }

    /// This request at a higher speed, which reaches its stroke after `seconds`, given that it takes `lead` at speed 1.
    pub(super) fn hurried(self, lead: f32, seconds: f32) -> Self {
        Self { speed: (lead / seconds.max(1e-3)).clamp(self.speed, (MOST_HURRY * self.speed).min(2.0)), ..self }
    }

    /// Speed, 0.5 to 2.
    pub(super) fn speed(&self) -> f32 {
        self.speed
    }

    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let gesture = pass.limited("gesture", self.gesture.into(), (MOTIONS.len() + MAX_GESTURES) as u64)?;
        pass.maybe("gesture's time", &mut self.at, MAX_INDEX)?;
        pass.within(&mut self.speed, 0.5..=2.0)?;
        pass.share(&mut self.strength)?;
        let side = pass.limited("gesture's side", self.side as u64, Side::ALL.len() as u64 - 1)?;
        let is_aimed = pass.flag("gesture's target", self.target.is_some())?;
        let mut target = self.target.unwrap_or_default();
        if pass.follows(is_aimed) {
            pass.moderate(&mut target)?;
        }
        let variant = pass.limited("gesture's variant", self.variant.into(), u8::MAX.into())?;
        let epoch = pass.limited("gesture's epoch", self.epoch.into(), u32::MAX.into())?;
        if pass.loads() {
            self.variant = u8::try_from(variant).unwrap_or_default();
            self.gesture = u32::try_from(gesture).unwrap_or_default();
            self.side = Side::ALL[usize::try_from(side).unwrap_or_default()];
            self.target = is_aimed.then_some(target);
            self.epoch = u32::try_from(epoch).unwrap_or_default();
        }
        Ok(())
    }
}

/// Differences of a variant from the drawn pose: factors of 1 and sums of 0 for variant 0.
#[derive(Clone, Copy, Debug)]
struct Variation {
    /// Factor of the distance between shoulder and hand, and of the turns of head and trunk.
    size: f32,
    /// Height of the hand, in arm lengths.
    height: f32,
    /// Raise of the elbow, outwards.
    elbow: f32,
    speed: f32,
}

impl Variation {
    fn of(variant: u8) -> Self {
        if variant == 0 {
            return Self { size: 1.0, height: 0.0, elbow: 0.0, speed: 1.0 };
        }
        let draw = |counter: u64| 2.0 * uniform(variant.into(), VARIANT_STREAM, counter) - 1.0;
        Self { size: 1.0 + 0.1 * draw(0), height: 0.04 * draw(1), elbow: 0.15 * draw(2), speed: 1.0 + 0.15 * draw(3) }
    }
}

/// Queue of requests from the host to the output: the newest ones, in a ring indexed by number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Requests {
    ring: [Request; MAX_PENDING_GESTURES],
    /// Number of requests so far.
    count: u64,
}

impl Requests {
    pub(super) const NONE: Self = Self { ring: [Request::NONE; MAX_PENDING_GESTURES], count: 0 };

    /// Adds a request. Fails if [`MAX_PENDING_GESTURES`] wait already, given that `begun` are done.
    pub fn push(&mut self, request: Request, begun: u64) -> Result<(), RequestError> {
        if self.count.saturating_sub(begun) >= MAX_PENDING_GESTURES as u64 {
            return Err(RequestError::GesturesFull);
        }
        self.ring[place(self.count)] = request;
        self.count += 1;
        Ok(())
    }

    /// Makes every request one of this epoch.
    pub(super) fn move_to(&mut self, epoch: u32) {
        self.ring.iter_mut().for_each(|request| request.epoch = epoch);
    }

    /// Describes the pending requests.
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("gestures", &mut self.count, MAX_REQUESTS)?;
        self.ring.iter_mut().try_for_each(|request| request.state(pass))
    }
}

/// Upper bound on the requests of a session.
const MAX_REQUESTS: u64 = 1 << 60;

#[expect(clippy::cast_possible_truncation, reason = "below the length")]
fn place(number: u64) -> usize {
    (number % MAX_PENDING_GESTURES as u64) as usize
}

/// Gesture that is being shown.
#[derive(Clone, Copy, Debug)]
struct Playing {
    request: Request,
    /// Whether left and right are swapped.
    is_mirrored: bool,
    /// Ticks since it began.
    ticks: u64,
    /// Elapsed and total ticks of the fade-out; `None` before it.
    release: Option<(u64, u64)>,
    /// Whether a word asked for it: one of the host's takes its place at once.
    is_word: bool,
    /// Factor of the strength: how much the voice accents the word.
    emphasis: f32,
}

impl Playing {
    const NONE: Self =
        Self { request: Request::NONE, is_mirrored: false, ticks: 0, release: None, is_word: false, emphasis: 1.0 };

    /// Time since its start at speed 1, seconds.
    fn seconds(&self, tick: &Tick) -> f32 {
        self.ticks as f32 * tick.seconds * self.request.speed
    }

    /// Follows the voice's accent by one tick, `since` seconds after the stroke.
    fn emphasise(&mut self, tick: &Tick, since: f32) {
        if self.is_word && tick.weights.own.is_on && (EMPHASIS[0]..EMPHASIS[1]).contains(&since) {
            let [loud, quiet] = EMPHASES_BELOW_LOUD;
            let share = ((tick.weights.own.below_loud - loud) / (quiet - loud)).clamp(0.0, 1.0);
            let goal = EMPHASES[0] + share * (EMPHASES[1] - EMPHASES[0]);
            let most = EMPHASIS_RATE * tick.seconds;
            self.emphasis += (goal - self.emphasis).clamp(-most, most);
        }
    }

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.request.state(pass)?;
        pass.switch("gesture's side", &mut self.is_mirrored)?;
        pass.switch("gesture's origin", &mut self.is_word)?;
        pass.within(&mut self.emphasis, EMPHASES[1]..=EMPHASES[0])?;
        pass.number("gesture", &mut self.ticks, MAX_INDEX)?;
        let is_on = pass.flag("gesture's release", self.release.is_some())?;
        let (mut ago, mut of) = self.release.unwrap_or((0, 1));
        if pass.follows(is_on) {
            pass.number("gesture's release", &mut ago, MAX_INDEX)?;
            let of = pass.number("gesture's release", &mut of, MAX_INDEX)?;
            pass.must(of > 0, "gesture's release")?;
        }
        if pass.loads() {
            self.release = is_on.then_some((ago, of));
        }
        Ok(())
    }
}

/// How much of a gesture is shown, 0 to 1.
#[derive(Clone, Copy, Debug)]
struct Shares {
    /// Head, trunk and face.
    whole: f32,
    arms: f32,
    fingers: f32,
}

/// Times of a gesture's phases, seconds from its start at speed 1.
#[derive(Clone, Copy, Debug)]
struct Phases {
    stroke: f32,
    /// Start of the fade-out.
    leaves: f32,
    end: f32,
}

/// Gestures that play or wait.
#[derive(Debug)]
pub(super) struct Player {
    gestures: Gestures,
    /// Epoch of the stream.
    epoch: u32,
    /// Number of requests taken from the queue, and of those that began or were dropped.
    taken: u64,
    begun: u64,
    /// In the order of the requests.
    pending: [Request; MAX_PENDING_GESTURES],
    waiting: usize,
    /// In the order in which they began.
    playing: [Playing; MAX_SHOWN],
    shown: usize,
    /// Within a tick, the time until the stroke of a list's next item, seconds; `None` without one.
    item: Option<f32>,
}

impl Player {
    pub(crate) fn new(gestures: Gestures) -> Self {
        Self {
            gestures,
            epoch: 0,
            taken: 0,
            begun: 0,
            pending: [Request::NONE; MAX_PENDING_GESTURES],
            waiting: 0,
            playing: [Playing::NONE; MAX_SHOWN],
            shown: 0,
            item: None,
        }
    }

    /// Whether no gesture plays, waits or has been requested.
    pub(super) fn is_empty(&self, requests: &Requests) -> bool {
        self.shown == 0 && self.waiting == 0 && self.taken == requests.count
    }

    /// Number of requests that began or were dropped.
    pub(super) fn begun(&self) -> u64 {
        self.begun
    }

    /// Starts a new stream at once: drops the gestures that play, and requests of earlier epochs.
    pub(crate) fn reset(&mut self, epoch: u32, requests: &Requests) {
        self.shown = 0;
        self.drop_before(epoch, requests);
    }

    /// Fades out the playing gestures over `ticks`, at least `MIN_RELEASE_SECONDS`, and drops requests of
    /// earlier epochs.
    pub(super) fn interrupt(&mut self, epoch: u32, ticks: u64, frame_rate: f32, requests: &Requests) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few frames")]
        let ticks = ticks.max((MIN_RELEASE_SECONDS * frame_rate) as u64);
        self.playing[..self.shown].iter_mut().for_each(|playing| release(playing, ticks));
        self.drop_before(epoch, requests);
    }

    /// Goes on in another epoch, with what waits.
    pub(super) fn move_to(&mut self, epoch: u32) {
        self.epoch = epoch;
        self.pending.iter_mut().for_each(|request| request.epoch = epoch);
    }

    fn drop_before(&mut self, epoch: u32, requests: &Requests) {
        self.epoch = epoch;
        self.take(requests);
        let before = self.waiting;
        self.keep(|request| !is_older(request.epoch, epoch));
        self.begun += (before - self.waiting) as u64;
    }

    /// Keeps only the waiting requests for which `keeps` holds.
    fn keep(&mut self, mut keeps: impl FnMut(&Request) -> bool) {
        let mut kept = 0;
        for at in 0..self.waiting {
            if keeps(&self.pending[at]) {
                self.pending[kept] = self.pending[at];
                kept += 1;
            }
        }
        self.waiting = kept;
    }

    /// Applies one tick to the frame.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, tick: &Tick) {
        self.take(&tick.controls.gestures);
        self.begin(frame, tick);
        let mut kept = 0;
        for at in 0..self.shown {
            let mut playing = self.playing[at];
            let phases = self.phases(&playing.request);
            let seconds = playing.seconds(tick);
            let released = playing.release.map_or(1.0, |(ago, of)| 1.0 - ease(ago as f32 / of as f32));
            if seconds >= phases.end || released <= 0.0 {
                continue;
            }
            playing.emphasise(tick, (seconds - phases.stroke) / playing.request.speed);
            let shares = self.shares(&playing, released);
            if shares.whole > 0.0 {
                self.show(frame, tick.rig, &playing, seconds, shares);
            }
            let out = ticks(phases.end - phases.leaves, &playing.request, tick);
            let half = 0.5 * tick.seconds * playing.request.speed;
            match self.rest(&playing, tick) {
                Some(_) if playing.release.is_some() => {}
                Some(way) if self.item.is_some_and(|left| left * playing.request.speed > way + half) => {}
                // The last item of its list.
                Some(_) if self.item.is_none() => release(&mut playing, out),
                _ => playing.ticks += 1,
            }
            if let Some((ago, _)) = &mut playing.release {
                *ago += 1;
            }
            self.playing[kept] = playing;
            kept += 1;
        }
        self.shown = kept;
        self.item = None;
    }

    /// Takes the host's new requests from the queue.
    fn take(&mut self, requests: &Requests) {
        // Only a forged state has more than fit.
        self.taken = self.taken.max(requests.count.saturating_sub(MAX_PENDING_GESTURES as u64));
        while self.taken < requests.count {
            let request = requests.ring[place(self.taken)];
            self.taken += 1;
            if is_older(request.epoch, self.epoch) || self.waiting == MAX_PENDING_GESTURES {
                self.begun += 1;
            } else {
                self.pending[self.waiting] = request;
                self.waiting += 1;
            }
        }
    }

    /// Begins the gestures that are due: at their time, or when their parts are free.
    fn begin(&mut self, frame: &OwnedFrame, tick: &Tick) {
        let mut busy = self.busy(tick);
        let mut at = 0;
        while at < self.waiting {
            let request = self.pending[at];
            let is_left = self.built_in(&request).is_some_and(|motion| motion.is_left);
            let is_mirrored = is_mirrored(&request, is_left, frame);
            let parts = self.parts(&request, is_mirrored);
            let before = ticks(self.phases(&request).stroke, &request, tick);
            let is_due = match request.at {
                Some(stroke) => frame.index + before >= stroke,
                None => !parts.meets(busy),
            };
            if !is_due || self.shown == MAX_SHOWN {
                if request.at.is_none() {
                    // Later requests for the same parts wait for it.
                    busy = busy.union(parts);
                }
                at += 1;
                continue;
            }
            self.start(Playing { request, is_mirrored, ..Playing::NONE }, before);
            busy = busy.union(parts);
            self.pending.copy_within(at + 1..self.waiting, at);
            self.waiting -= 1;
            self.begun += 1;
        }
    }

    /// The built-in gesture of a request; `None` for one of the host's.
    fn built_in(&self, request: &Request) -> Option<&'static Motion> {
        MOTIONS.get(request.gesture as usize)
    }

    /// Parts of the host's gestures that are not on their way out.
    fn busy(&self, tick: &Tick) -> GestureParts {
        let holds = |playing: &&Playing| {
            let seconds = playing.seconds(tick);
            !playing.is_word && playing.release.is_none() && seconds < self.phases(&playing.request).leaves
        };
        let parts = |playing: &Playing| self.parts(&playing.request, playing.is_mirrored);
        self.playing[..self.shown].iter().filter(holds).map(parts).fold(GestureParts::NONE, GestureParts::union)
    }

    /// Begins a gesture whose stroke comes `before` ticks later. Those with the same parts fade out meanwhile.
    fn start(&mut self, new: Playing, before: u64) {
        let parts = self.parts(&new.request, new.is_mirrored);
        for other in 0..self.shown {
            let playing = self.playing[other];
            if self.parts(&playing.request, playing.is_mirrored).meets(parts) {
                release(&mut self.playing[other], before.max(1));
            }
        }
        self.playing[self.shown] = new;
        self.shown += 1;
    }

    /// Begins a word's gesture now, unless one of the host's has its parts or needs them before it ends.
    pub(super) fn offer(&mut self, request: Request, frame: &OwnedFrame, tick: &Tick) {
        self.take(&tick.controls.gestures);
        let is_left = |request: &Request| self.built_in(request).is_some_and(|motion| motion.is_left);
        let mirrored = |request: &Request| is_mirrored(request, is_left(request), frame);
        let is_mirrored = mirrored(&request);
        let (parts, phases) = (self.parts(&request, is_mirrored), self.phases(&request));
        let leaves = frame.index + ticks(phases.leaves, &request, tick);
        let is_needed = self.pending[..self.waiting].iter().any(|host| {
            let before = ticks(self.phases(host).stroke, host, tick);
            let begins = host.at.map_or(0, |stroke| stroke.saturating_sub(before));
            begins <= leaves && self.parts(host, mirrored(host)).meets(parts)
        });
        if is_needed || self.busy(tick).meets(parts) || self.shown >= MAX_SHOWN_BEFORE_WORD {
            return;
        }
        let new = Playing { request, is_mirrored, is_word: true, ..Playing::NONE };
        self.start(new, ticks(phases.stroke, &request, tick));
    }

    /// Where the eyes go with a word's gesture that points: to the left and down from the body's heading, radians.
    pub(super) fn glance(&self, tick: &Tick) -> Option<[f32; 2]> {
        self.playing[..self.shown].iter().rev().find_map(|playing| {
            let motion = self.built_in(&playing.request).filter(|_| playing.is_word && playing.release.is_none())?;
            let (_, [aside, down]) = speech::GLANCES.into_iter().find(|(name, _)| *name == motion.name)?;
            let since = playing.seconds(tick) - motion.preparation - motion.stroke;
            let is_on = (GLANCE[0]..GLANCE[1]).contains(&(since / playing.request.speed));
            let side = if playing.is_mirrored { 1.0 } else { -1.0 };
            is_on.then_some([side * radians(aside), radians(down)])
        })
    }

    /// Of a word's list whose hand rests before its next item: the way to that stroke at speed 1, seconds.
    fn rest(&self, playing: &Playing, tick: &Tick) -> Option<f32> {
        let motion = self.list(playing)?;
        let at = playing.seconds(tick) - motion.preparation;
        let step = tick.seconds * playing.request.speed;
        speech::RESTS.iter().find(|(rest, _)| (*rest..rest + step).contains(&at)).map(|(_, stroke)| stroke - at)
    }

    /// The motion of a word's list.
    fn list(&self, playing: &Playing) -> Option<&'static Motion> {
        self.built_in(&playing.request).filter(|motion| playing.is_word && motion.name == speech::LIST)
    }

    /// Whether a word's list can have one more item.
    pub(super) fn is_listing(&self, tick: &Tick) -> bool {
        let last = speech::RESTS[speech::RESTS.len() - 1].0;
        self.playing[..self.shown].iter().any(|playing| {
            let end = |motion: &Motion| motion.preparation + last + tick.seconds * playing.request.speed;
            playing.release.is_none() && self.list(playing).is_some_and(|motion| playing.seconds(tick) < end(motion))
        })
    }

    /// Sets the time until the stroke of a list's next item for this tick, seconds; without one the list ends at its rest.
    pub(super) fn set_item(&mut self, left: Option<f32>) {
        self.item = left;
    }

    /// Number of a named gesture.
    pub(super) fn find(&self, name: &str) -> Option<u32> {
        self.gestures.find(name)
    }

    /// Time from a gesture's start to its stroke at speed 1, seconds.
    pub(super) fn lead(&self, request: &Request) -> f32 {
        self.phases(request).stroke
    }

    fn phases(&self, request: &Request) -> Phases {
        let number = request.gesture as usize;
        match self.gestures.added(number) {
            Some(clip) => Phases { stroke: clip.stroke(), leaves: clip.leaves(), end: clip.seconds() },
            None => {
                let Motion { preparation, stroke, length, retraction, .. } = motion(number);
                let leaves = preparation + length;
                Phases { stroke: preparation + stroke, leaves, end: leaves + retraction }
            }
        }
    }

    /// Parts that no other gesture may move at the same time.
    fn parts(&self, request: &Request, is_mirrored: bool) -> GestureParts {
        let number = request.gesture as usize;
        let parts = match self.gestures.added(number) {
            Some(clip) => clip.parts(),
            None if request.side == Side::Both && matches!(motion(number).arms, Arms::One) => {
                motion(number).parts.union(GestureParts::LEFT_ARM)
            }
            None => motion(number).parts,
        };
        if is_mirrored { parts.mirrored() } else { parts }
    }

    /// How much of a gesture is shown while `released` of it is left.
    fn shares(&self, playing: &Playing, released: f32) -> Shares {
        let strength = (playing.request.strength * playing.emphasis).min(1.0);
        let whole = strength * released;
        let Some(motion) = self.built_in(&playing.request).filter(|_| playing.is_word) else {
            return Shares { whole, arms: whole, fingers: whole };
        };
        // A hand with half of its shape means nothing, and one that stops short of what it touches looks wrong.
        let arms = if motion.is_free { 1.0 - WEAK_ARMS * (1.0 - strength) } else { 1.0 };
        Shares { whole, arms: arms * released, fingers: released }
    }

    /// Applies a gesture to a frame, `seconds` after its start.
    fn show(&self, frame: &mut OwnedFrame, rig: &Rig, playing: &Playing, seconds: f32, shares: Shares) {
        let number = playing.request.gesture as usize;
        match self.gestures.added(number) {
            Some(clip) => {
                let share = shares.whole * clip.weight(seconds);
                clip.apply(&mut frame.pose.rotations, seconds, share, playing.is_mirrored);
            }
            None => show(frame, rig, playing, motion(number), seconds, shares),
        }
    }

    /// Checks the properties that a state must share with these gestures.
    pub(super) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.same("set of gestures", self.gestures.fingerprint())
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let epoch = pass.limited("epoch", self.epoch.into(), u32::MAX.into())?;
        if pass.loads() {
            self.epoch = u32::try_from(epoch).unwrap_or_default();
        }
        pass.number("gestures", &mut self.taken, MAX_REQUESTS)?;
        pass.number("gestures", &mut self.begun, MAX_REQUESTS)?;
        pass.length("gestures that wait", &mut self.waiting, MAX_PENDING_GESTURES as u64)?;
        pass.length("gestures that play", &mut self.shown, MAX_SHOWN as u64)?;
        self.pending.iter_mut().try_for_each(|request| request.state(pass))?;
        self.playing.iter_mut().try_for_each(|playing| playing.state(pass))
    }
}

/// Ticks of a gesture's `seconds` at speed 1.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds")]
fn ticks(seconds: f32, request: &Request, tick: &Tick) -> u64 {
    (seconds / (request.speed * tick.seconds)).round() as u64
}

/// Whether an epoch came before another; the numbers may wrap.
pub(super) fn is_older(epoch: u32, than: u32) -> bool {
    than.wrapping_sub(epoch).wrapping_sub(1) < u32::MAX / 2
}

/// Fades a gesture out within `ticks`, unless it ends sooner already.
fn release(playing: &mut Playing, ticks: u64) {
    if playing.release.is_none_or(|(ago, of)| of.saturating_sub(ago) > ticks) {
        // Continues from the level of an earlier fade-out, so that nothing jumps.
        let passed = playing.release.map_or(0.0, |(ago, of)| ago as f32 / of as f32);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few ticks")]
        let of = (ticks as f32 / (1.0 - passed).max(1e-3)).round().max(1.0) as u64;
        playing.release = Some((of.saturating_sub(ticks), of));
    }
}

fn motion(number: usize) -> &'static Motion {
    &MOTIONS[number.min(MOTIONS.len() - 1)]
}

/// Whether left and right of a gesture are swapped; `is_left` is what it does by itself.
fn is_mirrored(request: &Request, is_left: bool, frame: &OwnedFrame) -> bool {
    match request.side {
        Side::Left => true,
        Side::Right => false,
        Side::Auto | Side::Both => request.target.map_or(is_left, |target| {
            let place = less(target, frame.pose.translation);
            rotate(inverse(frame.pose.rotations[0]), place)[0] > 0.0
        }),
    }
}

/// Applies a built-in gesture to a frame.
fn show(frame: &mut OwnedFrame, rig: &Rig, playing: &Playing, motion: &Motion, seconds: f32, shares: Shares) {
    let share = shares.whole;
    let t = seconds - motion.preparation;
    let side = if playing.is_mirrored { -1.0 } else { 1.0 };
    let variation = Variation::of(playing.request.variant);
    let mut collars = 0.0;
    let mut turns = Turns::default();
    for track in motion.tracks {
        let [value] = through(track.keys, |key| key.0, |key| [key.1], t);
        let value = value * share * variation.size;
        match track.channel {
            Channel::HeadPitch => turns.head[0] += value,
            Channel::HeadYaw => turns.head[1] += side * value,
            Channel::HeadRoll => turns.head[2] += side * value,
            Channel::TrunkPitch => turns.trunk[0] += value,
            Channel::TrunkYaw => turns.trunk[1] += side * value,
            Channel::TrunkRoll => turns.trunk[2] += side * value,
            Channel::HipPitch => turns.hips += value,
            Channel::Collars => collars += value,
            Channel::Face(shape) => {
                let shape = if playing.is_mirrored { other_side_of_face(shape) } else { shape };
                let present = rig.shape(&frame.face, shape);
                rig.set_shape(&mut frame.face, shape, present + (1.0 - present) * value);
            }
        }
    }
    let aim = matches!(motion.arms, Arms::Pointing).then(|| Aim::new(rig, frame, playing));
    if let Some(aim) = &aim {
        let into = share * weight(motion, [seconds; 2], 0.0);
        turns.trunk[1] += into * aim.trunk_yaw;
        turns.head[1] += into * aim.head_yaw;
        turns.head[0] += into * aim.head_pitch;
    }
    turns.apply(&mut frame.pose, rig);
    let (first, second) = if playing.is_mirrored { (LEFT, RIGHT) } else { (RIGHT, LEFT) };
    let mover = Mover { rig, motion, variation, seconds, shares };
    match motion.arms {
        Arms::None => {}
        Arms::Pointing => {
            let place = aim.as_ref().map_or(DEFAULT_POINTING_TARGET, |aim| aim.place);
            let arm = first.pointing(rig, in_chest(rig, &frame.pose, place), &hand::POINT);
            blend(&mut frame.pose, first, &arm, motion, shares, [seconds; 2]);
        }
        Arms::One if playing.request.side != Side::Both => mover.follow(frame, first, motion.keys, false),
        Arms::One | Arms::Both | Arms::Together => {
            mover.follow(frame, first, motion.keys, false);
            mover.follow(frame, second, motion.keys, !matches!(motion.arms, Arms::Together));
        }
        Arms::Pair(keys) => {
            mover.follow(frame, first, motion.keys, false);
            mover.follow(frame, second, keys, false);
        }
    }
    if collars != 0.0 {
        for (joint, sign) in COLLARS {
            // One shoulder is always slightly higher.
            let angle = sign * radians(collars) * if sign * side > 0.0 { 0.9 } else { 1.0 };
            let q = &mut frame.pose.rotations[joint];
            *q = product(*q, axis_angle_to_quat([0.0, 0.0, angle]));
        }
    }
}

/// Rotations of head, trunk and hips that are added to the model's, degrees.
#[derive(Debug, Default)]
struct Turns {
    head: Vec3,
    trunk: Vec3,
    hips: f32,
}

impl Turns {
    fn apply(&self, pose: &mut Pose, rig: &Rig) {
        let turn = |q: &mut Quat, angles: Vec3, share: f32| {
            if angles != [0.0; 3] {
                *q = product(*q, axis_angle_to_quat(angles.map(|angle| radians(angle) * share)));
            }
        };
        for joint in SPINE {
            turn(&mut pose.rotations[joint], self.trunk, 1.0 / 3.0);
        }
        turn(&mut pose.rotations[NECK_JOINT], self.head, NECK_SHARE);
        turn(&mut pose.rotations[HEAD_JOINT], self.head, 1.0 - NECK_SHARE);
        if self.hips != 0.0 {
            self.bend_hips(pose, rig);
        }
    }

    /// Rotates the pelvis about the hip axis; thighs and feet stay in place.
    fn bend_hips(&self, pose: &mut Pose, rig: &Rig) {
        let bend = axis_angle_to_quat([radians(self.hips), 0.0, 0.0]);
        let middle: Vec3 = std::array::from_fn(|i| 0.5 * (rig.offsets[HIPS[0]][i] + rig.offsets[HIPS[1]][i]));
        let pelvis = pose.rotations[0];
        let shift = rotate(pelvis, less(middle, rotate(bend, middle)));
        pose.translation = std::array::from_fn(|i| pose.translation[i] + shift[i]);
        pose.rotations[0] = product(pelvis, bend);
        for hip in HIPS {
            pose.rotations[hip] = product(inverse(bend), pose.rotations[hip]);
        }
    }
}

fn radians(degrees: f32) -> f32 {
    degrees * (std::f32::consts::PI / 180.0)
}

/// Target of a pointing gesture, and turns of trunk and head towards it, degrees.
#[derive(Debug)]
struct Aim {
    place: Vec3,
    trunk_yaw: f32,
    head_yaw: f32,
    head_pitch: f32,
}

impl Aim {
    fn new(rig: &Rig, frame: &OwnedFrame, playing: &Playing) -> Self {
        let pose = &frame.pose;
        let side = if playing.is_mirrored { 1.0 } else { -1.0 };
        let chest_height = 0.35;
        let place = playing.request.target.unwrap_or_else(|| {
            let ahead = rotate(
                pose.rotations[0],
                [side * DEFAULT_POINTING_TARGET[0], DEFAULT_POINTING_TARGET[1], DEFAULT_POINTING_TARGET[2]],
            );
            let root = rig.offsets[0];
            std::array::from_fn(|i| pose.translation[i] + root[i] + ahead[i] + if i == 1 { chest_height } else { 0.0 })
        });
        let [x, y, z] = in_chest(rig, pose, place);
        let yaw = x.arc_tangent_over(z).to_degrees();
        let pitch = -(y - 0.3).arc_tangent_over(length_of_two(x, z)).to_degrees();
        Self {
            place,
            trunk_yaw: (0.25 * yaw).clamp(-24.0, 24.0),
            head_yaw: (0.45 * yaw).clamp(-45.0, 45.0),
            head_pitch: (0.5 * pitch).clamp(-22.0, 22.0),
        }
    }
}

/// Transforms a position from the avatar's space to the chest's frame.
fn in_chest(rig: &Rig, pose: &Pose, place: Vec3) -> Vec3 {
    let (places, turned) = rig.world(pose);
    rotate(inverse(turned[CHEST]), less(place, places[CHEST]))
}

/// Moves arms along keys, at one tick of a gesture.
struct Mover<'a> {
    rig: &'a Rig,
    motion: &'a Motion,
    variation: Variation,
    seconds: f32,
    shares: Shares,
}

impl Mover<'_> {
    /// Moves an arm along keys; `is_apart` if it is the second arm, a little later and lower.
    fn follow(&self, frame: &mut OwnedFrame, arm: Arm, keys: &[table::Key], is_apart: bool) {
        let Self { rig, motion, variation, seconds, shares } = *self;
        let late = seconds - if is_apart { SECOND_ARM_LAG_SECONDS } else { 0.0 };
        let t = late - motion.preparation;
        let flat = |key: &table::Key| {
            let mut all = [0.0; 12];
            for (part, values) in [key.hand, key.elbow, key.fingers, key.palm].iter().enumerate() {
                all[3 * part..3 * part + 3].copy_from_slice(values);
            }
            all
        };
        let all = through(keys, |key| key.at, flat, t);
        let part = |at: usize| -> Vec3 { std::array::from_fn(|i| all[3 * at + i]) };
        let (mut hand, mut elbow) = (part(0), part(1));
        if motion.is_free {
            hand = hand.map(|v| v * variation.size);
            hand[1] += variation.height;
        }
        elbow[0] += variation.elbow;
        if is_apart {
            // Hands are never at exactly one height.
            hand[1] -= 0.03;
            hand[0] *= 0.97;
        }
        let shape = through(keys, |key| key.at, |key| key.shape, t);
        let target = ArmTarget { hand, elbow, fingers: part(2), palm: part(3), shape };
        let pose = arm.pose(rig, &target, None);
        blend(&mut frame.pose, arm, &pose, motion, shares, [late, seconds]);
    }
}

/// Weight of a gesture for a joint that is `lag` seconds behind. Fade-in and fade-out have separate
/// clocks.
fn weight(motion: &Motion, [coming, going]: [f32; 2], lag: f32) -> f32 {
    let leaves = motion.preparation + motion.length;
    let into = ease((coming - lag) / (motion.preparation - lag));
    into * (1.0 - ease((going - leaves - lag) / (motion.retraction - lag)))
}

/// Blends an arm's joints from the model's pose to the gesture's.
fn blend(pose: &mut Pose, arm: Arm, to: &ArmPose, motion: &Motion, shares: Shares, clocks: [f32; 2]) {
    let mut turn = |joint: usize, to: Quat, lag: f32, share: f32| {
        let weight = share * weight(motion, clocks, lag);
        if weight > 0.0 {
            let q = &mut pose.rotations[joint];
            *q = if weight >= 1.0 { to } else { slerp(*q, to, weight) };
        }
    };
    turn(arm.collar, to.collar, 0.0, shares.arms);
    turn(arm.shoulder, to.shoulder, 0.0, shares.arms);
    turn(arm.elbow, to.elbow, ELBOW_LAG_SECONDS, shares.arms);
    turn(arm.wrist, to.wrist, WRIST_LAG_SECONDS, shares.arms);
    for (finger, q) in to.fingers.iter().enumerate() {
        turn(arm.first_finger + finger, *q, 0.0, shares.fingers);
    }
}

/// Returns the mirrored shape of a face shape.
fn other_side_of_face(shape: usize) -> usize {
    let names = &umo_core_pose::skeleton::ARKIT_NAMES;
    let name = names[shape];
    let is_other = |other: &&str| {
        let left = name.strip_suffix("Left").zip(other.strip_suffix("Right"));
        let right = name.strip_suffix("Right").zip(other.strip_suffix("Left"));
        left.or(right).is_some_and(|(a, b)| a == b)
    };
    names.iter().position(is_other).unwrap_or(shape)
}

#[cfg(test)]
mod tests;
