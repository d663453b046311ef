//! The frame side of a session: frames out of the ring, placed where the avatar stands, eased where it was interrupted, and
//! the poses between them.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::gain::Gained;
use super::{Cue, Idle, SessionConfig, Shared};
use crate::config::Config;
use crate::memory::filled;
use crate::motion::Pose;
use crate::motion::rotation::{Quat, slerp};
use crate::motion::skeleton::JOINTS;
use crate::state::{StateError, StatePass};

/// Frames that no session comes to, and samples of the pushed audio: at 240 a second, 145 years; at 192 kHz, 180 years.
const MOST_INDEX: u64 = 1 << 40;
const MOST_SAMPLE: u64 = 1 << 50;

/// Words of a frame before its pose: the cue's number, index, sample.
const HEAD: usize = 5;
/// Words of a frame before its face values.
const FACE: usize = HEAD + 4 * JOINTS + 3;

/// Words of a frame in the ring.
pub(crate) const fn words(face_values: usize) -> usize {
    FACE + face_values
}

/// Lays a frame out for the ring.
pub(crate) fn write(words: &mut [u32], cue: u32, index: u64, sample: u64, pose: &Pose, face: &[f32]) {
    words[0] = cue;
    put(&mut words[1..3], index);
    put(&mut words[3..5], sample);
    let values = pose.rotations.as_flattened().iter().chain(&pose.translation).chain(face);
    words[HEAD..].iter_mut().zip(values).for_each(|(word, value)| *word = value.to_bits());
}

/// Whether words that come from a state are whole frames, and their numbers ones that a session comes to.
pub(crate) fn are_frames(words: &[[u8; 4]], width: usize) -> bool {
    let number = |low: usize, frame: &[[u8; 4]]| {
        u64::from(u32::from_le_bytes(frame[low])) | u64::from(u32::from_le_bytes(frame[low + 1])) << 32
    };
    let mut frames = words.chunks_exact(width);
    let are_known = frames.all(|frame| number(1, frame) <= MOST_INDEX && number(3, frame) <= MOST_SAMPLE);
    are_known && words.len().is_multiple_of(width)
}

#[expect(clippy::cast_possible_truncation, reason = "the two halves")]
fn put(words: &mut [u32], value: u64) {
    words[0] = value as u32;
    words[1] = (value >> 32) as u32;
}

fn get(words: &[u32]) -> u64 {
    u64::from(words[0]) | u64::from(words[1]) << 32
}

/// A frame as the host sees it.
#[derive(Clone, Copy, Debug)]
pub struct FrameView<'a> {
    /// Its number since the session's start or last reset, 30 per second.
    pub index: u64,
    /// Sample frame of the pushed audio, at the session's rate, that it belongs to.
    pub sample: u64,
    /// Rotations relative to parents, place of the root in metres.
    pub pose: &'a Pose,
    /// Face values, as the model names them.
    pub face: &'a [f32],
}

/// Which times [`Session::sample_pose`](super::Session::sample_pose) could choose from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled {
    /// Seconds of the oldest frame that is still there.
    pub oldest: f64,
    /// Seconds of the newest frame that is ready.
    pub newest: f64,
    /// Whether the time asked for was later than that.
    pub is_ahead: bool,
}

/// One frame, owned.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    pub(super) index: u64,
    pub(super) sample: u64,
    pub(super) pose: Pose,
    pub(super) face: Box<[f32]>,
}

impl Shown {
    /// A frame of a pose, at the start.
    pub(crate) fn new(pose: Pose, face: &[f32]) -> Self {
        Self { index: 0, sample: 0, pose, face: face.into() }
    }

    /// Describes the frame.
    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("frame index", &mut self.index, 2 * MOST_INDEX)?;
        pass.number("frame's sample", &mut self.sample, 2 * MOST_SAMPLE)?;
        pass.rotations(&mut self.pose.rotations)?;
        pass.f32s(&mut self.pose.translation)?;
        pass.f32s(&mut self.face)
    }

    /// As `other`, without allocating.
    pub(super) fn copy(&mut self, other: &Self) {
        (self.index, self.sample, self.pose) = (other.index, other.sample, other.pose);
        self.face.copy_from_slice(&other.face);
    }

    /// Becomes the pose `t` of the way from `a` to `b`: exactly one of them at 0 and 1.
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

    fn pose_of(&mut self, other: &Self) {
        self.pose = other.pose;
        self.face.copy_from_slice(&other.face);
    }

    pub(super) fn view(&self) -> FrameView<'_> {
        FrameView { index: self.index, sample: self.sample, pose: &self.pose, face: &self.face }
    }
}

fn mixed(out: &mut [f32], a: &[f32], b: &[f32], t: f32) {
    out.iter_mut().zip(a.iter().zip(b)).for_each(|(out, (a, b))| *out = a + (b - a) * t);
}

/// 0 to 1 with level ends.
fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// An ease to rest after an interrupt: frames that stand before the next stream's.
#[derive(Debug)]
struct Ease {
    from: Shown,
    done: u64,
    frames: u64,
}

#[derive(Debug)]
pub(crate) struct Output {
    cue: Cue,
    /// The frame that was shown last.
    last: Shown,
    /// Whether any was since the start.
    any: bool,
    /// The one after it, where it was already taken out of the ring.
    next_frame: Shown,
    has_next: bool,
    /// What `sample` showed last.
    sampled: Shown,
    /// The model's pose of rest.
    rest: Shown,
    ease: Ease,
    /// Index of the present stream's first frame.
    base: u64,
    /// Where the present stream's origin is, metres: x and z.
    origin: [f32; 2],
    /// Where the pose of `sample` came from when frames came again after an idle time, and when that was.
    seam: Shown,
    seam_at: Option<u64>,
    /// The last time that was asked for.
    time: f64,
    was_idle: bool,
    /// One frame of the ring.
    words: Box<[u32]>,
    gained: Gained,
    chunk_frames: usize,
    frame_rate: f64,
    idle_after: Duration,
    idle_ease: f64,
}

impl Output {
    pub(super) fn new(
        session: &SessionConfig,
        config: &Config,
        rest: Shown,
        is_arkit: bool,
        chunk_frames: usize,
    ) -> Self {
        let shown = || rest.clone();
        let face_values = rest.face.len();
        Self {
            cue: Cue::default(),
            last: shown(),
            any: false,
            has_next: false,
            next_frame: shown(),
            sampled: shown(),
            ease: Ease { from: shown(), done: 0, frames: 0 },
            seam: shown(),
            gained: Gained::new(shown(), is_arkit),
            rest,
            base: 0,
            origin: [0.0; 2],
            seam_at: None,
            time: 0.0,
            was_idle: false,
            words: filled(0, words(face_values)).into(),
            chunk_frames,
            frame_rate: config.frame_rate as f64,
            idle_after: session.idle_after,
            idle_ease: session.ease.as_secs_f64().max(1e-3),
        }
    }

    /// Words of a frame in the ring.
    pub(super) fn width(&self) -> usize {
        self.words.len()
    }

    /// What a state must have in common with this session, beside the model.
    pub(super) fn identity(&self, pass: &mut StatePass, shared: &Shared) -> Result<(), StateError> {
        pass.same("queue of frames", (shared.frames.capacity() / self.words.len()) as u64)?;
        pass.same("time until idle", u64::try_from(self.idle_after.as_nanos()).unwrap_or(u64::MAX))?;
        pass.same("ease", self.idle_ease.to_bits())
    }

    /// Describes the frame side. What `sample` shows is made anew by every call, and rest is the model's.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.cue.state(pass)?;
        pass.switch("frame shown", &mut self.any)?;
        pass.switch("next frame", &mut self.has_next)?;
        pass.switch("idle time", &mut self.was_idle)?;
        self.last.state(pass)?;
        self.next_frame.state(pass)?;
        self.ease.from.state(pass)?;
        self.seam.state(pass)?;
        let frames = pass.number("ease", &mut self.ease.frames, u16::MAX.into())?;
        pass.number("ease", &mut self.ease.done, frames)?;
        let base = pass.number("start of the stream", &mut self.base, MOST_INDEX)?;
        pass.must(base >= frames, "start of the stream")?;
        pass.f32s(&mut self.origin)?;
        pass.float(&mut self.time)?;
        let there = pass.flag("seam", self.seam_at.is_some())?;
        let mut seam_at = self.seam_at.unwrap_or_default();
        if pass.follows(there) {
            seam_at = pass.moment("seam", seam_at)?;
        }
        if pass.loads() {
            self.seam_at = there.then_some(seam_at);
        }
        self.gained.state(pass)
    }

    /// The frame that `next` made the one shown.
    pub(super) fn shown(&mut self, shared: &Shared) -> FrameView<'_> {
        let time = self.seconds(&self.last);
        self.gained.apply(shared, time, &self.last, &self.rest)
    }

    /// The pose that `sample` made.
    pub(super) fn sampled(&mut self, shared: &Shared) -> FrameView<'_> {
        self.gained.apply(shared, self.time, &self.sampled, &self.rest)
    }

    /// Starts anew where somebody interrupted or reset the session.
    fn follow(&mut self, shared: &Shared) {
        let cue = shared.cue();
        if cue == self.cue {
            return;
        }
        if cue.resets != self.cue.resets {
            self.last.copy(&self.rest);
            self.sampled.copy(&self.rest);
            (self.base, self.origin, self.any, self.time) = (0, [0.0; 2], false, 0.0);
            self.gained.started = false;
            // An interrupt that came after the reset, before anything was shown, has nothing to ease from.
            self.ease.frames = 0;
        } else {
            let start = if self.any { self.last.index + 1 } else { 0 };
            // Nothing was shown yet, or the avatar rests: there is nothing to ease from.
            self.ease.frames = if self.any { u64::from(cue.ease) } else { 0 };
            self.base = start + self.ease.frames;
            self.origin = [self.last.pose.translation[0], self.last.pose.translation[2]];
        }
        if std::mem::take(&mut self.has_next) {
            shared.stats.dropped_frames.fetch_add(1, Ordering::Relaxed);
        }
        self.ease.from.copy(&self.last);
        self.ease.done = 0;
        self.seam_at = None;
        self.cue = cue;
    }

    /// Makes the next frame the one shown; whether there was one.
    pub(super) fn next(&mut self, shared: &Shared) -> bool {
        self.follow(shared);
        let there = self.fetch(shared);
        if there {
            std::mem::swap(&mut self.last, &mut self.next_frame);
            self.has_next = false;
            self.any = true;
            self.time = self.time.max(self.seconds(&self.last));
        }
        there
    }

    /// Makes sure that `next_frame` is the frame after the one shown, if there is one.
    fn fetch(&mut self, shared: &Shared) -> bool {
        if self.has_next {
            return true;
        }
        if self.ease.done < self.ease.frames {
            self.ease.done += 1;
            let t = smooth(self.ease.done as f32 / self.ease.frames as f32);
            let frame = &mut self.next_frame;
            frame.between(&self.ease.from, &self.rest, t);
            // It stays where it stands.
            let (from, to) = (self.ease.from.pose.translation, &mut frame.pose.translation);
            (to[0], to[2]) = (from[0], from[2]);
            frame.index = self.base - self.ease.frames + self.ease.done - 1;
            frame.sample = self.ease.from.sample;
            self.has_next = true;
            return true;
        }
        let width = self.words.len();
        while shared.frames.len() >= width {
            shared.frames.pop(&mut self.words);
            self.make_room(shared);
            if self.words[0] == self.cue.number {
                self.read(shared);
                self.has_next = true;
                return true;
            }
            shared.stats.dropped_frames.fetch_add(1, Ordering::Relaxed);
        }
        false
    }

    /// Tells the engine, where it waits for room and there is enough.
    fn make_room(&self, shared: &Shared) {
        let enough = shared.frames.room() >= self.chunk_frames * self.words.len();
        if enough && shared.wants_room.swap(false, Ordering::SeqCst) {
            shared.signal.notify();
        }
    }

    /// The frame in `words`, where the avatar stands.
    fn read(&mut self, shared: &Shared) {
        let frame = &mut self.next_frame;
        frame.index = self.base + get(&self.words[1..3]);
        frame.sample = shared.sample_base.load(Ordering::Relaxed) + get(&self.words[3..5]);
        let mut values = self.words[HEAD..].iter().map(|&word| f32::from_bits(word));
        let pose = frame.pose.rotations.as_flattened_mut().iter_mut().chain(&mut frame.pose.translation);
        pose.chain(&mut frame.face).zip(&mut values).for_each(|(slot, value)| *slot = value);
        for (axis, origin) in [(0, self.origin[0]), (2, self.origin[1])] {
            // A stream that starts at the origin keeps its bits.
            if origin != 0.0 {
                frame.pose.translation[axis] += origin;
            }
        }
    }

    /// Frames that `next` would give, of this stream.
    #[expect(clippy::cast_possible_truncation, reason = "an ease is at most 2^16 frames")]
    pub(super) fn ready(&mut self, shared: &Shared) -> usize {
        self.follow(shared);
        let width = self.words.len();
        // Frames of a stream that was dropped stand before those that count.
        while shared.frames.len() >= width {
            shared.frames.peek(&mut self.words[..1]);
            if self.words[0] == self.cue.number {
                break;
            }
            shared.frames.skip(width);
            self.make_room(shared);
            shared.stats.dropped_frames.fetch_add(1, Ordering::Relaxed);
        }
        let eased = (self.ease.frames - self.ease.done) as usize;
        usize::from(self.has_next) + eased + shared.frames.len() / width
    }

    /// Whether every frame of a stream of `total` frames was shown.
    pub(super) fn is_done(&mut self, shared: &Shared, total: u64) -> bool {
        self.follow(shared);
        let shown = if self.any { (self.last.index + 1).saturating_sub(self.base) } else { 0 };
        !self.has_next && self.ease.done == self.ease.frames && shown >= total
    }

    /// Asks the engine for motion on silence, where the host waits for frames, wants that, and no audio comes.
    pub(super) fn want_silence(&self, shared: &Shared) {
        if shared.idle() == Idle::Live && self.is_silent(shared) && !shared.wants_silence.swap(true, Ordering::SeqCst) {
            shared.signal.notify();
        }
    }

    /// Whether no audio has come for some time, or none will.
    fn is_silent(&self, shared: &Shared) -> bool {
        let since = shared.clock.nanos().saturating_sub(shared.audio_time.load(Ordering::Relaxed));
        u128::from(since) >= self.idle_after.as_nanos()
    }

    fn seconds(&self, frame: &Shown) -> f64 {
        frame.index as f64 / self.frame_rate
    }

    /// Makes `sampled` the pose at a time.
    pub(super) fn sample(&mut self, shared: &Shared, seconds: f64) -> Sampled {
        self.follow(shared);
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
        (self.sampled.index, self.sampled.sample) = (self.last.index, self.last.sample);
        if self.has_next && self.any {
            let length = self.seconds(&self.next_frame) - oldest;
            self.sampled.between(&self.last, &self.next_frame, single((time - oldest) / length));
        } else {
            self.sampled.pose_of(&self.last);
        }
        self.idle(shared, is_ahead);
        let newest = self.newest(shared, oldest);
        Sampled { oldest, newest, is_ahead }
    }

    /// Leaves the stream for the rest pose while no audio comes, and comes back to it.
    fn idle(&mut self, shared: &Shared, is_ahead: bool) {
        // By the clock: a host's time stands still where it is that of the sound.
        let now = shared.clock.nanos();
        if is_ahead {
            self.want_silence(shared);
        }
        let rests = is_ahead && self.any && shared.idle() == Idle::Rest && self.is_silent(shared);
        if rests != self.was_idle {
            // From what was shown a moment ago, whatever that was.
            self.seam_at = Some(now);
            self.was_idle = rests;
        } else if self.seam_at.is_none() {
            self.seam.copy(&self.sampled);
        }
        let Some(start) = self.seam_at else { return };
        let passed = Duration::from_nanos(now.saturating_sub(start)).as_secs_f64();
        let t = smooth(single(passed / self.idle_ease));
        if rests {
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
        for (value, from) in self.sampled.face.iter_mut().zip(&self.seam.face) {
            *value = from + (*value - from) * t;
        }
        if t >= 1.0 {
            self.seam.copy(&self.sampled);
            if !rests {
                self.seam_at = None;
            }
        }
    }

    /// Seconds of the newest frame that is ready.
    fn newest(&self, shared: &Shared, oldest: f64) -> f64 {
        let queued = shared.frames.len() / self.words.len();
        let waiting = usize::from(self.has_next) + queued;
        #[expect(clippy::cast_precision_loss, reason = "a queue is short")]
        let ahead = waiting as f64 + (self.ease.frames - self.ease.done) as f64;
        oldest + ahead / self.frame_rate
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a share of a way")]
fn single(value: f64) -> f32 {
    value as f32
}

fn turned(a: Quat, b: Quat, t: f32) -> Quat {
    if t >= 1.0 { b } else { slerp(a, b, t) }
}
