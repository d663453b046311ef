//! The frame side of a session: takes frames out of the ring, places them where the avatar stands,
//! eases interrupts and gaps, and interpolates poses.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::gain::Gained;
use super::packets::PacketQueue;
use super::receiver::frames_of;
use super::shared::try_lock;
use super::voice::LiveVoice;
use super::{Idle, SessionConfig, Shared};
use crate::config::Config;
use crate::life::{Controls, Cue, Heard, Life};
use crate::memory::{Arena, Boxed};
use crate::motion::Pose;
use crate::motion::rotation::{Quat, slerp};
use crate::state::{StateError, StatePass};
use crate::stream::{Epoch, MAX_INDEX, MAX_SAMPLE, OwnedFrame, Stamp};

/// A frame as the host sees it.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Frame<'a> {
    /// Index since the session's start or last reset, 30 per second.
    pub index: u64,
    /// Sample frame of the pushed audio, at the session's rate, that the frame belongs to.
    pub sample: u64,
    /// Rotations relative to the parents; root translation in metres.
    pub pose: &'a Pose,
    /// Face values, in the order of the model's names.
    pub face: &'a [f32],
}

/// Range of times that [`Session::sample_pose`](super::Session::sample_pose) could choose from.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Sampled {
    /// Time of the oldest frame still held, seconds.
    pub oldest: f64,
    /// Time of the newest ready frame, seconds.
    pub newest: f64,
    /// Whether the requested time was later than that.
    pub is_ahead: bool,
}

impl OwnedFrame {
    pub(crate) fn new(pose: Pose, face: &[f32]) -> Self {
        Self { index: 0, sample: 0, pose, face: Arena::system().copied(face), cue: Cue::default() }
    }

    /// Returns a copy in memory of `arena`.
    pub(crate) fn clone_in(&self, arena: &Arena) -> Self {
        Self { face: arena.copied(&self.face), ..*self }
    }

    /// Describes the frame.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("frame index", &mut self.index, 2 * MAX_INDEX)?;
        pass.number("frame's sample", &mut self.sample, 2 * MAX_SAMPLE)?;
        pass.rotations(&mut self.pose.rotations)?;
        pass.places(&mut self.pose.translation)?;
        pass.f32s(std::slice::from_mut(&mut self.cue.level))?;
        pass.moderate(&mut self.cue.contacts)?;
        pass.moderate(&mut self.face)
    }

    /// Copies `other` without allocating.
    pub(super) fn copy(&mut self, other: &Self) {
        (self.index, self.sample, self.pose, self.cue) = (other.index, other.sample, other.pose, other.cue);
        self.face.copy_from_slice(&other.face);
    }

    /// Interpolates the pose at `t` between `a` and `b`; copies one of them exactly at 0 and 1.
    fn between(&mut self, a: &Self, b: &Self, t: f32) {
        match t {
            _ if t <= 0.0 => self.pose_of(a),
            _ if t >= 1.0 => self.pose_of(b),
            _ => {
                let pairs = a.pose.rotations.iter().zip(&b.pose.rotations);
                self.pose.rotations.iter_mut().zip(pairs).for_each(|(q, (&a, &b))| *q = slerp(a, b, t));
                mixed(&mut self.pose.translation, &a.pose.translation, &b.pose.translation, t);
                mixed(&mut self.face, &a.face, &b.face, t);
            }
        }
    }

    /// Moves by `1 - t` towards `from`, the face by `1 - t_face`; at 1 nothing changes.
    fn ease_from(&mut self, from: &Self, t: f32, t_face: f32) {
        let ease = |to: &mut [f32], from: &[f32], t: f32| {
            if t < 1.0 {
                to.iter_mut().zip(from).for_each(|(to, from)| *to = from + (*to - from) * t);
            }
        };
        if t < 1.0 {
            let pairs = self.pose.rotations.iter_mut().zip(&from.pose.rotations);
            pairs.for_each(|(q, &from)| *q = slerp(from, *q, t));
        }
        ease(&mut self.pose.translation, &from.pose.translation, t);
        ease(&mut self.face, &from.face, t_face);
    }

    fn pose_of(&mut self, other: &Self) {
        self.pose = other.pose;
        self.face.copy_from_slice(&other.face);
    }

    pub(super) fn view(&self) -> Frame<'_> {
        Frame { index: self.index, sample: self.sample, pose: &self.pose, face: &self.face }
    }
}

fn mixed(out: &mut [f32], a: &[f32], b: &[f32], t: f32) {
    out.iter_mut().zip(a.iter().zip(b)).for_each(|(out, (a, b))| *out = a + (b - a) * t);
}

/// Smoothstep: 0 to 1 with zero slope at both ends.
fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// An ease after an interrupt: to rest, as frames before the next stream's; or from rest into the
/// first frames of the next stream.
#[derive(Debug)]
struct Ease {
    from: OwnedFrame,
    done: u64,
    frames: u64,
}

impl Ease {
    fn new(from: OwnedFrame) -> Self {
        Self { from, done: 0, frames: 0 }
    }

    /// Describes the ease; returns its number of frames.
    fn state(&mut self, pass: &mut StatePass) -> Result<u64, StateError> {
        self.from.state(pass)?;
        let frames = pass.number("ease", &mut self.frames, u16::MAX.into())?;
        pass.number("ease", &mut self.done, frames)?;
        Ok(frames)
    }
}

/// Idle motion while no frames come: the layers' ticks over a pose that stands still.
#[derive(Debug)]
struct Still {
    /// Start, by [`Shared::now`]; `None` while frames come.
    since: Option<u64>,
    /// Ticks since then.
    ticks: u64,
    /// The last two ticks.
    from: OwnedFrame,
    to: OwnedFrame,
}

/// Share of the time of the way back from rest or idle motion that the face takes.
const FACE_EASE: f64 = 0.25;

/// Upper bound on the ticks that one call catches up on, so that a paused host does not compute all
/// of them.
const MAX_STILL_TICKS: u64 = 8;

/// Upper bound of the host's time, nanoseconds: 36 years, below the count at which the clock
/// starts.
const MAX_HOST_TIME: u64 = 1 << 60;

/// Gaps: frames that were lost or late. The frames after a gap are eased in.
#[derive(Debug)]
struct Gaps {
    /// The last frame before a gap, without layers.
    from: OwnedFrame,
    /// Number of frames to ease after a gap, and how many of them are done.
    frames: u64,
    done: u64,
    /// Length of an ease, frames.
    ease: u64,
    /// The pose that `sample` showed last.
    shown: OwnedFrame,
    /// Seconds by which that time was past the newest frame.
    ahead: f64,
    /// Whether the next frame starts a later stream, which is eased in from rest.
    begins: bool,
    /// Duration of the current ease, seconds.
    length: f64,
}

/// Duration of the way back as a multiple of the missing time, up to the session's ease: no joint
/// has to move much faster than usual.
const CATCH_UP: f64 = 6.0;

#[derive(Debug)]
pub(crate) struct Output {
    epoch: Epoch,
    /// The frame shown last.
    last: OwnedFrame,
    /// That frame without layers.
    raw_last: OwnedFrame,
    /// Whether any frame was shown since the start.
    any: bool,
    /// The frame after it, if it was already taken out of the ring.
    next_frame: OwnedFrame,
    /// That frame without layers.
    raw_next: OwnedFrame,
    has_next: bool,
    life: Life,
    voice: Option<Boxed<LiveVoice>>,
    controls: Controls,
    still: Still,
    /// The pose that `sample` showed last.
    sampled: OwnedFrame,
    /// The model's rest pose.
    rest: OwnedFrame,
    ease: Ease,
    /// The ease from rest into the next stream.
    arrival: Ease,
    /// Upper bound on its frames.
    longest_arrival: u64,
    /// Index of the present stream's first frame.
    base: u64,
    /// Origin of the present stream, metres: x and z.
    origin: [f32; 2],
    /// The pose from which `sample` eases since idle time began or ended, and when that was.
    seam: OwnedFrame,
    seam_at: Option<u64>,
    /// Last requested time.
    time: f64,
    /// Origin of the host's time, nanoseconds of the clock's count.
    host_base: u64,
    was_idle: bool,
    /// Easing of gaps, if frames come from packets.
    gaps: Option<Gaps>,
    gained: Gained,
    chunk_frames: usize,
    frame_rate: f64,
    idle_after: Duration,
    idle_ease: f64,
}

impl Output {
    #[expect(clippy::too_many_arguments, reason = "the parts of a session, each named")]
    pub(super) fn new_in(
        session: &SessionConfig,
        config: &Config,
        life: Life,
        voice: Option<Boxed<LiveVoice>>,
        rest: &OwnedFrame,
        is_arkit: bool,
        chunk_frames: usize,
        is_decoder: bool,
        arena: &Arena,
    ) -> Self {
        let shown = || rest.clone_in(arena);
        let gaps = is_decoder.then(|| Gaps {
            from: shown(),
            frames: 0,
            done: 0,
            ease: frames_of(session.ease, config.frame_rate).max(1).into(),
            shown: shown(),
            ahead: 0.0,
            begins: false,
            length: 0.0,
        });
        Self {
            epoch: Epoch::default(),
            last: shown(),
            raw_last: shown(),
            any: false,
            has_next: false,
            next_frame: shown(),
            raw_next: shown(),
            life,
            voice,
            controls: Controls::new(session.avatar.life),
            still: Still { since: None, ticks: 0, from: shown(), to: shown() },
            sampled: shown(),
            ease: Ease::new(shown()),
            arrival: Ease::new(shown()),
            longest_arrival: frames_of(session.ease, config.frame_rate).into(),
            seam: shown(),
            gained: Gained::new(shown(), is_arkit),
            rest: shown(),
            base: 0,
            origin: [0.0; 2],
            seam_at: None,
            time: 0.0,
            host_base: 0,
            was_idle: false,
            gaps,
            chunk_frames,
            frame_rate: config.frame_rate as f64,
            idle_after: session.idle_after,
            idle_ease: session.ease.as_secs_f64().max(1e-3),
        }
    }

    /// Settings that a state must share with this session, besides the model.
    pub(super) fn identity(&self, pass: &mut StatePass, shared: &Shared) -> Result<(), StateError> {
        pass.same("queue of frames", shared.link.frames.capacity() as u64)?;
        pass.same("time until idle", u64::try_from(self.idle_after.as_nanos()).unwrap_or(u64::MAX))?;
        pass.same("ease", self.idle_ease.to_bits())?;
        let packets = shared.packets.as_ref().map_or(0, PacketQueue::identity);
        pass.same("voice, or of packets", u64::from(self.voice.is_some()) + 2 * packets)?;
        self.life.identity(pass)
    }

    /// Describes the frame side. Each call of `sample` recomputes its pose, and rest is the
    /// model's, so neither is saved.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.epoch.state(pass)?;
        pass.switch("frame shown", &mut self.any)?;
        pass.switch("next frame", &mut self.has_next)?;
        pass.switch("idle time", &mut self.was_idle)?;
        self.last.state(pass)?;
        self.next_frame.state(pass)?;
        self.raw_last.state(pass)?;
        self.raw_next.state(pass)?;
        self.life.state(pass)?;
        if let Some(voice) = &mut self.voice {
            voice.state(pass)?;
        }
        self.controls.state(pass)?;
        self.still.state(pass)?;
        let frames = self.ease.state(pass)?;
        self.arrival.state(pass)?;
        self.seam.state(pass)?;
        let base = pass.number("start of the stream", &mut self.base, MAX_INDEX)?;
        pass.must(base >= frames, "start of the stream")?;
        pass.places(&mut self.origin)?;
        pass.float(&mut self.time)?;
        let there = pass.flag("seam", self.seam_at.is_some())?;
        let mut seam_at = self.seam_at.unwrap_or_default();
        if pass.follows(there) {
            seam_at = pass.host_moment("seam", seam_at)?;
        }
        if pass.loads() {
            self.seam_at = there.then_some(seam_at);
        }
        self.gained.state(pass)
    }

    /// Sets the host's time; it never goes back.
    pub(super) fn set_clock(&mut self, shared: &Shared, time: Duration) {
        #[expect(clippy::cast_possible_truncation, reason = "at most 2^60 nanoseconds")]
        let nanos = time.as_nanos() as u64;
        let before = shared.host_time.load(Ordering::Relaxed);
        if before == 0 {
            // The host's count continues from the clock's, so that eases in progress continue.
            let now = shared.clock.nanos();
            self.host_base = now - nanos;
            shared.host_time.store(now, Ordering::Relaxed);
        } else {
            shared.host_time.store(before.max(self.host_base + nanos), Ordering::Relaxed);
        }
    }

    /// Describes the host's time; a restored state maps it to the present.
    pub(super) fn clock_state(&mut self, pass: &mut StatePass, shared: &Shared) -> Result<(), StateError> {
        let time = shared.host_time.load(Ordering::Relaxed);
        let is_given = pass.flag("host's time", time != 0)?;
        let mut nanos = time.saturating_sub(self.host_base);
        if pass.follows(is_given) {
            nanos = pass.limited("host's time", nanos, MAX_HOST_TIME)?;
        }
        if pass.loads() {
            let now = if is_given { pass.now() } else { 0 };
            shared.host_time.store(now, Ordering::Relaxed);
            self.host_base = now.saturating_sub(nanos);
        }
        Ok(())
    }

    /// Returns the frame shown last, with gains.
    pub(super) fn shown(&mut self, shared: &Shared) -> Frame<'_> {
        let time = self.seconds(&self.last);
        self.gained.apply(shared, time, &self.last, &self.rest)
    }

    /// Returns the pose of the last `sample`, with gains.
    pub(super) fn sampled(&mut self, shared: &Shared) -> Frame<'_> {
        self.gained.apply(shared, self.time, &self.sampled, &self.rest)
    }

    /// Restarts if the session was interrupted or reset.
    fn sync_epoch(&mut self, shared: &Shared) {
        let epoch = shared.link.epoch();
        if epoch == self.epoch {
            return;
        }
        self.follow_controls(shared);
        if epoch.resets != self.epoch.resets {
            self.last.copy(&self.rest);
            self.raw_last.copy(&self.rest);
            self.sampled.copy(&self.rest);
            self.life.reset(epoch.number, &self.controls);
            self.still.since = None;
            (self.base, self.origin, self.any, self.time) = (0, [0.0; 2], false, 0.0);
            self.gained.started = false;
            if let Some(gaps) = &mut self.gaps {
                (gaps.frames, gaps.ahead, gaps.begins) = (0, 0.0, false);
            }
            // An interrupt after the reset, before anything was shown, has nothing to ease from.
            self.ease.frames = 0;
        } else {
            let start = if self.any { self.last.index + 1 } else { 0 };
            // If nothing was shown yet, there is nothing to ease from.
            self.ease.frames = if self.any { u64::from(epoch.ease) } else { 0 };
            self.life.interrupt(epoch.number, self.ease.frames, &self.controls);
            self.base = start + self.ease.frames;
            if let Some(gaps) = &mut self.gaps {
                (gaps.frames, gaps.begins) = (0, self.any);
            }
            self.origin = [self.raw_last.pose.translation[0], self.raw_last.pose.translation[2]];
        }
        if std::mem::take(&mut self.has_next) {
            shared.stats.dropped_frames.fetch_add(1, Ordering::Relaxed);
        }
        if let Some(voice) = &mut self.voice {
            voice.begin(&self.rest);
        }
        self.publish(shared);
        self.ease.from.copy(&self.raw_last);
        self.ease.done = 0;
        // With packets, `Gaps` eases.
        self.arrival.frames = if self.gaps.is_some() { 0 } else { self.ease.frames.min(self.longest_arrival) };
        self.arrival.done = 0;
        self.seam_at = None;
        self.epoch = epoch;
    }

    /// Makes the next frame the one shown; returns whether there was one.
    pub(super) fn next(&mut self, shared: &Shared) -> bool {
        self.sync_epoch(shared);
        let there = self.fetch(shared);
        if there {
            std::mem::swap(&mut self.last, &mut self.next_frame);
            std::mem::swap(&mut self.raw_last, &mut self.raw_next);
            self.has_next = false;
            self.any = true;
            self.time = self.time.max(self.seconds(&self.last));
        }
        there
    }

    /// Fetches the frame after the one shown into `next_frame`; returns whether there is one.
    fn fetch(&mut self, shared: &Shared) -> bool {
        if self.has_next {
            return true;
        }
        if self.ease.done < self.ease.frames {
            self.ease.done += 1;
            let t = smooth(self.ease.done as f32 / self.ease.frames as f32);
            let frame = &mut self.next_frame;
            frame.between(&self.ease.from, &self.rest, t);
            // The avatar stays where it stands.
            let (from, to) = (self.ease.from.pose.translation, &mut frame.pose.translation);
            (to[0], to[2]) = (from[0], from[2]);
            frame.index = self.base - self.ease.frames + self.ease.done - 1;
            frame.sample = self.ease.from.sample;
            frame.cue = Cue::default();
            self.add_layers(shared);
            return true;
        }
        let there = if self.voice.is_some() { self.fetch_live(shared) } else { self.fetch_delayed(shared) };
        if !there {
            return false;
        }
        let frame = &mut self.next_frame;
        for (axis, origin) in [(0, self.origin[0]), (2, self.origin[1])] {
            // A stream at the origin keeps its bits.
            if origin != 0.0 {
                frame.pose.translation[axis] += origin;
            }
        }
        self.arrive();
        self.close_gap();
        self.add_layers(shared);
        true
    }

    /// Eases from rest into the first frames of a stream after an interrupt.
    fn arrive(&mut self) {
        let Ease { from, done, frames } = &mut self.arrival;
        if done >= frames {
            return;
        }
        if *done == 0 {
            from.copy(&self.raw_last);
        }
        *done += 1;
        let t = *done as f32 / *frames as f32;
        // Speech begins with the mouth.
        self.next_frame.ease_from(from, smooth(t), smooth(t / single(FACE_EASE)));
    }

    /// Eases into the frames after a gap.
    fn close_gap(&mut self) {
        let Some(gaps) = &mut self.gaps else { return };
        if self.any && (self.next_frame.index > self.raw_last.index + 1 || std::mem::take(&mut gaps.begins)) {
            gaps.from.copy(&self.raw_last);
            (gaps.frames, gaps.done) = (gaps.ease, 0);
        }
        if gaps.done < gaps.frames {
            gaps.done += 1;
            let t = smooth(gaps.done as f32 / gaps.frames as f32);
            self.next_frame.ease_from(&gaps.from, t, t);
        }
    }

    /// Pops the engine's next frame into `next_frame`, if there is one.
    fn fetch_delayed(&mut self, shared: &Shared) -> bool {
        let Some(stamp) = self.drop_other_epochs(shared) else { return false };
        let frame = &mut self.next_frame;
        shared.link.frames.pop(frame);
        shared.link.frame_taken(self.chunk_frames);
        frame.index = self.base + stamp.index;
        frame.sample = shared.link.input_base() + stamp.sample;
        true
    }

    /// Makes `next_frame` the next frame whose mouth is known, over the body that is due.
    fn fetch_live(&mut self, shared: &Shared) -> bool {
        self.drop_other_epochs(shared);
        let Some(voice) = &mut self.voice else { return false };
        let Some(index) = voice.next(shared, self.epoch) else { return false };
        if !voice.take_body(shared, self.epoch, index, self.chunk_frames) {
            return false;
        }
        let frame = &mut self.next_frame;
        frame.copy(&voice.body);
        voice.put_mouth(frame);
        frame.index = self.base + index;
        frame.sample = shared.link.input_base() + shared.sample_of(index);
        true
    }

    /// Completes the next frame with a tick of the layers.
    fn add_layers(&mut self, shared: &Shared) {
        self.raw_next.copy(&self.next_frame);
        self.follow_controls(shared);
        let heard = Heard { sample: self.next_frame.sample, rate: shared.sample_rate };
        self.life.apply(&mut self.next_frame, &self.controls, shared.other_level(), Some(heard));
        self.publish(shared);
        self.has_next = true;
    }

    /// Publishes the numbers of begun gestures and passed hints for the host's setters.
    fn publish(&self, shared: &Shared) {
        shared.passed_hints.store(self.life.passed_hints(), Ordering::Release);
        shared.begun_gestures.store(self.life.begun_gestures(), Ordering::Release);
    }

    /// Takes over the host's controls; if the host is writing them, the next frame does.
    fn follow_controls(&mut self, shared: &Shared) {
        if shared.unseen_controls.load(Ordering::Acquire)
            && let Some(controls) = try_lock(&shared.controls)
        {
            shared.unseen_controls.store(false, Ordering::Relaxed);
            self.controls = *controls;
        }
    }

    /// Drops frames of other epochs, which precede this epoch's; returns the stamp of this epoch's
    /// next frame.
    fn drop_other_epochs(&self, shared: &Shared) -> Option<Stamp> {
        let frames = &shared.link.frames;
        while let Some(stamp) = frames.next() {
            if stamp.epoch == self.epoch.number {
                return Some(stamp);
            }
            frames.skip();
            shared.link.frame_taken(self.chunk_frames);
            shared.stats.dropped_frames.fetch_add(1, Ordering::Relaxed);
        }
        None
    }

    /// Number of frames that `next` would return, of this stream.
    #[expect(clippy::cast_possible_truncation, reason = "an ease is at most 2^16 frames")]
    pub(super) fn ready(&mut self, shared: &Shared) -> usize {
        self.sync_epoch(shared);
        self.drop_other_epochs(shared);
        let eased = (self.ease.frames - self.ease.done) as usize;
        usize::from(self.has_next) + eased + self.waiting(shared)
    }

    /// Number of this stream's frames that `fetch` would return after an ease.
    fn waiting(&mut self, shared: &Shared) -> usize {
        match &mut self.voice {
            Some(voice) => voice.ready(shared, self.epoch),
            None => shared.link.frames.len(),
        }
    }

    /// Whether every frame of a stream of `total` frames was shown.
    pub(super) fn is_done(&mut self, shared: &Shared, total: u64) -> bool {
        self.sync_epoch(shared);
        let shown = if self.any { (self.last.index + 1).saturating_sub(self.base) } else { 0 };
        let tail = self.voice.as_ref().map_or(0, |voice| voice.delay());
        !self.has_next && self.ease.done == self.ease.frames && shown >= total + if total > 0 { tail } else { 0 }
    }

    /// Asks the engine for motion on silence, if the idle mode is live and no audio comes. Called
    /// when the host waits for frames.
    pub(super) fn want_silence(&self, shared: &Shared) {
        if shared.idle() == Idle::Live && self.is_silent(shared) {
            shared.link.want_silence();
        }
    }

    /// Whether no audio was pushed for `idle_after`, or the stream has ended.
    fn is_silent(&self, shared: &Shared) -> bool {
        let since = shared.now().saturating_sub(shared.heard.load(Ordering::Relaxed));
        u128::from(since) >= self.idle_after.as_nanos()
    }

    fn seconds(&self, frame: &OwnedFrame) -> f64 {
        frame.index as f64 / self.frame_rate
    }

    /// Samples the pose at a time into `sampled`.
    pub(super) fn sample(&mut self, shared: &Shared, seconds: f64) -> Sampled {
        self.sync_epoch(shared);
        self.time = self.time.max(seconds);
        let time = self.time;
        if !self.any {
            self.next(shared);
        }
        while self.fetch(shared) && self.seconds(&self.next_frame) <= time {
            self.next(shared);
        }
        let oldest = self.seconds(&self.last);
        let is_ahead = !self.any || !self.has_next && time > oldest;
        if let Some(gaps) = &mut self.gaps {
            gaps.shown.copy(&self.sampled);
        }
        (self.sampled.index, self.sampled.sample) = (self.last.index, self.last.sample);
        if self.has_next && self.any {
            // Frames of a forged state may repeat a time or go back.
            let length = self.seconds(&self.next_frame) - oldest;
            let t = if length > 0.0 { single((time - oldest) / length) } else { 1.0 };
            self.sampled.between(&self.last, &self.next_frame, t);
        } else {
            self.sampled.pose_of(&self.last);
        }
        let missed = self.missed(is_ahead, time - oldest);
        self.idle(shared, is_ahead, missed);
        let newest = self.newest(shared, oldest);
        Sampled { oldest, newest, is_ahead }
    }

    /// Duration in seconds of a gap that has just ended, otherwise 0; for sessions with packets.
    /// `ahead` is the time since the last frame.
    fn missed(&mut self, is_ahead: bool, ahead: f64) -> f64 {
        let Some(gaps) = &mut self.gaps else { return 0.0 };
        let missing = match is_ahead {
            true if self.any => ahead,
            // Only rest was shown.
            true => self.idle_ease,
            false => 0.0,
        };
        let before = std::mem::replace(&mut gaps.ahead, missing);
        if missing < before { before } else { 0.0 }
    }

    /// Blends to idle when audio stops, and back: to the rest pose, or to the last pose with its
    /// layers.
    fn idle(&mut self, shared: &Shared, is_ahead: bool, missed: f64) {
        // Not the time of the pose, which stands still if it follows the sound.
        let now = shared.now();
        if is_ahead {
            self.want_silence(shared);
        }
        self.follow_controls(shared);
        let is_alive = !self.life.is_off(&self.controls);
        let rests = is_ahead
            && if self.any { (is_alive || shared.idle() == Idle::Rest) && self.is_silent(shared) } else { is_alive };
        if rests != self.was_idle || missed > 0.0 {
            // Ease from the pose shown a moment ago, whatever it was.
            self.seam_at = Some(now);
            if let Some(gaps) = &mut self.gaps {
                self.seam.copy(&gaps.shown);
                let is_short = rests == self.was_idle && !rests;
                gaps.length = if is_short { (CATCH_UP * missed).min(self.idle_ease) } else { self.idle_ease };
            }
            self.was_idle = rests;
        } else if self.seam_at.is_none() {
            self.seam.copy(&self.sampled);
        }
        let Some(start) = self.seam_at else { return };
        let passed = Duration::from_nanos(now.saturating_sub(start)).as_secs_f64();
        let ease = self.gaps.as_ref().map_or(self.idle_ease, |gaps| gaps.length);
        let t = smooth(single(passed / ease));
        if rests && is_alive {
            self.stand(shared, now);
        } else if rests {
            let place = self.sampled.pose.translation;
            self.sampled.pose_of(&self.rest);
            (self.sampled.pose.translation[0], self.sampled.pose.translation[2]) = (place[0], place[2]);
        }
        let target = std::mem::replace(&mut self.sampled.pose, self.seam.pose);
        for (q, to) in self.sampled.pose.rotations.iter_mut().zip(target.rotations) {
            *q = turned(*q, to, t);
        }
        let from = self.sampled.pose.translation;
        mixed(&mut self.sampled.pose.translation, &from, &target.translation, t);
        // Speech begins with the mouth: the face's way back is shorter.
        let t_face = if rests { t } else { smooth(single(passed / (FACE_EASE * ease))) };
        for (value, from) in self.sampled.face.iter_mut().zip(&self.seam.face) {
            *value = from + (*value - from) * t_face;
        }
        if t >= 1.0 {
            self.seam.copy(&self.sampled);
            if !rests {
                self.seam_at = None;
                self.still.since = None;
            }
        }
    }

    /// Makes `sampled` the layers' idle motion at this moment, over a pose that stands still.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of ticks")]
    fn stand(&mut self, shared: &Shared, now: u64) {
        let is_new = self.still.since.is_none();
        let start = *self.still.since.get_or_insert(now);
        let at = Duration::from_nanos(now.saturating_sub(start)).as_secs_f64() * self.frame_rate;
        let wanted = at as u64 + 2;
        if is_new {
            self.still.ticks = 0;
        }
        self.still.ticks = self.still.ticks.max(wanted.saturating_sub(MAX_STILL_TICKS));
        while self.still.ticks < wanted {
            let Still { from, to, ticks, .. } = &mut self.still;
            std::mem::swap(from, to);
            to.copy(&self.raw_last);
            to.cue = Cue::default();
            if !self.any || shared.idle() == Idle::Rest {
                to.pose_of(&self.rest);
                let place = self.raw_last.pose.translation;
                (to.pose.translation[0], to.pose.translation[2]) = (place[0], place[2]);
            }
            self.life.apply(to, &self.controls, shared.other_level(), None);
            shared.begun_gestures.store(self.life.begun_gestures(), Ordering::Release);
            *ticks += 1;
            if is_new && *ticks == 1 {
                from.copy(to);
            }
        }
        self.sampled.between(&self.still.from, &self.still.to, single(at.fract()));
    }

    /// Time of the newest ready frame, seconds.
    fn newest(&mut self, shared: &Shared, oldest: f64) -> f64 {
        let waiting = usize::from(self.has_next) + self.waiting(shared);
        #[expect(clippy::cast_precision_loss, reason = "a queue is short")]
        let ahead = waiting as f64 + (self.ease.frames - self.ease.done) as f64;
        oldest + ahead / self.frame_rate
    }
}

impl Still {
    /// Describes the idle motion.
    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let is_on = pass.flag("idle motion", self.since.is_some())?;
        let mut since = self.since.unwrap_or_default();
        if pass.follows(is_on) {
            since = pass.host_moment("idle motion", since)?;
        }
        if pass.loads() {
            self.since = is_on.then_some(since);
        }
        pass.number("idle motion", &mut self.ticks, MAX_INDEX)?;
        self.from.state(pass)?;
        self.to.state(pass)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a share of a way")]
fn single(value: f64) -> f32 {
    value as f32
}

fn turned(a: Quat, b: Quat, t: f32) -> Quat {
    if t >= 1.0 { b } else { slerp(a, b, t) }
}
