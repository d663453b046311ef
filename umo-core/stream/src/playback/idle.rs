//! Blend to idle when audio stops, and back: to the rest pose, or to the last pose with its layers.

use std::time::Duration;

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::{Cue, MAX_INDEX, OwnedFrame};
use umo_core_pose::rotation::{Quat, slerp};

use crate::link::Link;

use umo_core_pose::frame::mixed;

use super::Start;
use super::ease::{FACE_EASE, seconds_of, single, smooth};
use super::gap::Missed;
use super::host::Host;
use super::layers::Layers;

/// Upper bound on the ticks that one call catches up on: more of them at once would be a jump.
const MAX_STILL_TICKS: u64 = 8;

/// Duration of the way back as a multiple of the missing time, up to the session's ease: no joint
/// has to move much faster than usual.
const CATCH_UP: f64 = 6.0;

/// Behaviour while no audio comes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Idle {
    /// Holds the last pose.
    #[default]
    Hold,
    /// Eases to the rest pose; only [`Session::sample_pose`](crate::session::Session::sample_pose)
    /// shows it.
    Rest,
    /// Runs the model on silence.
    Live,
}

/// Where the avatar stands at a requested time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stand<'a> {
    /// Whether the requested time is past the newest frame.
    pub(crate) is_ahead: bool,
    /// Whether any frame was shown since the start.
    pub(crate) is_shown: bool,
    /// Seconds since the frame shown last.
    pub(crate) passed: f64,
    /// The frame shown last, without layers.
    pub(crate) last: &'a OwnedFrame,
    pub(crate) rest: &'a OwnedFrame,
}

/// The blend to idle and back.
#[derive(Debug)]
pub(crate) struct IdleBlend {
    /// Whether it blends to idle, or shows it.
    was_idle: bool,
    still: Still,
    seam: Seam,
    /// Time without audio after which idle begins.
    after: Duration,
    /// Duration of an ease, seconds.
    ease: f64,
}

/// Idle motion while no frames come: the layers' ticks over a pose that stands still.
#[derive(Debug)]
struct Still {
    /// Start, by the host's clock; `None` while frames come.
    since: Option<u64>,
    /// Ticks since then.
    ticks: u64,
    /// The last two ticks.
    from: OwnedFrame,
    to: OwnedFrame,
    frame_rate: f64,
}

/// The pose from which the sampled one eases since idle time began or ended.
#[derive(Debug)]
struct Seam {
    from: OwnedFrame,
    /// The pose shown last during an ease.
    shown: OwnedFrame,
    /// When that was, by the host's clock; `None` after the ease.
    at: Option<u64>,
    /// Duration of the ease, seconds.
    length: f64,
}

impl IdleBlend {
    /// Starts without idle time; `frame` makes the buffers. `after` is the time without audio after
    /// which idle begins, `ease` the duration of an ease.
    pub(crate) fn new(frame: impl Fn() -> OwnedFrame, after: Duration, ease: Duration, frame_rate: usize) -> Self {
        let ease = seconds_of(ease);
        Self {
            was_idle: false,
            still: Still { since: None, ticks: 0, from: frame(), to: frame(), frame_rate: frame_rate as f64 },
            seam: Seam { from: frame(), shown: frame(), at: None, length: ease },
            after,
            ease,
        }
    }

    pub(crate) fn reset(&mut self, start: &Start) {
        self.seam.at = None;
        if start.is_reset {
            self.still.since = None;
        }
    }

    /// Asks the engine for motion on silence, if the idle mode is live and no audio comes. Called
    /// when the host waits for frames.
    pub(crate) fn want_silence(&self, link: &Link, host: &Host) {
        if host.idle() == Idle::Live && self.is_silent(host) {
            link.want_silence();
        }
    }

    /// Whether no audio was pushed for a while, or the stream has ended.
    fn is_silent(&self, host: &Host) -> bool {
        u128::from(host.clock.silence()) >= self.after.as_nanos()
    }

    /// Blends `frame`, the sampled pose, to idle or back. `missed` is the gap that it ends, where
    /// frames come from packets.
    pub(crate) fn apply(
        &mut self,
        frame: &mut OwnedFrame,
        stand: &Stand,
        missed: Option<Missed>,
        layers: &mut Layers,
        host: &Host,
    ) {
        // Not the time of the pose, which stands still if it follows the sound.
        let now = host.clock.now();
        layers.follow(host);
        let is_alive = !layers.is_off();
        let rests = stand.is_ahead
            && if stand.is_shown { (is_alive || host.idle() == Idle::Rest) && self.is_silent(host) } else { is_alive };
        self.turn(frame, rests, missed, now);
        let Some(start) = self.seam.at else { return };
        let passed = Duration::from_nanos(now.saturating_sub(start)).as_secs_f64();
        let t = smooth(single(passed / self.seam.length));
        if rests && is_alive {
            self.still.apply(frame, stand, now, layers, host);
        } else if rests {
            let place = frame.pose.translation;
            frame.pose_of(stand.rest);
            frame.stay_at(place);
        }
        // Speech begins with the mouth: the face's way back is shorter.
        let t_face = if rests { t } else { smooth(single(passed / (FACE_EASE * self.seam.length))) };
        self.seam.apply(frame, t, t_face);
        self.seam.shown.copy(frame);
        if t >= 1.0 {
            self.seam.from.copy(frame);
            if !rests {
                self.seam.at = None;
                self.still.since = None;
            }
        }
    }

    /// Takes over a frame that was pulled: idle time eases from it.
    pub(crate) fn show(&mut self, frame: &OwnedFrame) {
        self.seam.from.copy(frame);
        (self.seam.at, self.still.since, self.was_idle) = (None, None, false);
    }

    /// Begins an ease if idle time begins or ends, or a gap ends.
    fn turn(&mut self, frame: &OwnedFrame, rests: bool, missed: Option<Missed>, now: u64) {
        let Self { was_idle, seam, ease, .. } = self;
        if rests != *was_idle || missed.is_some_and(|missed| missed.seconds > 0.0) {
            // Ease from the pose shown a moment ago, whatever it was.
            if seam.at.is_some() {
                seam.from.copy(&seam.shown);
            }
            seam.at = Some(now);
            if let Some(Missed { seconds, shown }) = missed {
                seam.from.copy(shown);
                let is_short = rests == *was_idle && !rests;
                seam.length = if is_short { (CATCH_UP * seconds).min(*ease) } else { *ease };
            }
            *was_idle = rests;
        } else if seam.at.is_none() {
            seam.from.copy(frame);
        }
    }

    /// Describes whether idle is shown. [`Self::still_state`], [`Self::seam_state`] and
    /// [`Self::seam_time_state`] follow later in a state.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.switch("idle time", &mut self.was_idle).map(drop)
    }

    /// Describes the idle motion.
    pub(crate) fn still_state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let Still { since, ticks, from, to, .. } = &mut self.still;
        moment(pass, "idle motion", since)?;
        pass.number("idle motion", ticks, MAX_INDEX)?;
        from.state(pass)?;
        to.state(pass)
    }

    /// Describes the pose from which an ease began, and the one it has come to.
    pub(crate) fn seam_state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.seam.from.state(pass)?;
        self.seam.shown.state(pass)
    }

    /// Describes when an ease began.
    pub(crate) fn seam_time_state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        moment(pass, "seam", &mut self.seam.at)
    }

    /// Settings that a state must share with this session.
    pub(crate) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.same("time until idle", u64::try_from(self.after.as_nanos()).unwrap_or(u64::MAX))?;
        pass.same("ease", self.ease.to_bits())
    }
}

/// Describes a moment of the host's clock, if there is one.
fn moment(pass: &mut StatePass, what: &'static str, at: &mut Option<u64>) -> Result<(), StateError> {
    let there = pass.flag(what, at.is_some())?;
    let mut moment = at.unwrap_or_default();
    if pass.follows(there) {
        moment = pass.host_moment(what, moment)?;
    }
    if pass.loads() {
        *at = there.then_some(moment);
    }
    Ok(())
}

impl Still {
    /// Makes `frame` the layers' idle motion at this moment, over a pose that stands still.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of ticks")]
    fn apply(&mut self, frame: &mut OwnedFrame, stand: &Stand, now: u64, layers: &mut Layers, host: &Host) {
        let Self { since, ticks, from, to, frame_rate } = self;
        let frames = |start: u64| Duration::from_nanos(now.saturating_sub(start)).as_secs_f64() * *frame_rate;
        // Further behind, after a pause of the host or a speech, it begins anew.
        let kept = since.filter(|&start| frames(start) as u64 + 2 <= *ticks + MAX_STILL_TICKS);
        let is_new = kept.is_none();
        let start = kept.unwrap_or(now);
        *since = Some(start);
        let at = frames(start);
        let wanted = at as u64 + 2;
        if is_new {
            *ticks = 0;
        }
        while *ticks < wanted {
            std::mem::swap(from, to);
            to.copy(stand.last);
            to.cue = Cue::default();
            if !stand.is_shown || host.idle() == Idle::Rest {
                to.pose_of(stand.rest);
                to.stay_at(stand.last.pose.translation);
            }
            layers.apply_to_still(host, to);
            *ticks += 1;
            if is_new && *ticks == 1 {
                from.copy(to);
            }
        }
        frame.between(from, to, single(at.fract()));
    }
}

impl Seam {
    /// Moves `frame` by `1 - t` towards the seam, the face by `1 - t_face`.
    fn apply(&self, frame: &mut OwnedFrame, t: f32, t_face: f32) {
        let target = std::mem::replace(&mut frame.pose, self.from.pose);
        for (q, to) in frame.pose.rotations.iter_mut().zip(target.rotations) {
            *q = turned(*q, to, t);
        }
        let from = frame.pose.translation;
        mixed(&mut frame.pose.translation, &from, &target.translation, t);
        for (value, from) in frame.face.iter_mut().zip(&self.from.face) {
            *value = from + (*value - from) * t_face;
        }
    }
}

fn turned(a: Quat, b: Quat, t: f32) -> Quat {
    if t >= 1.0 { b } else { slerp(a, b, t) }
}
