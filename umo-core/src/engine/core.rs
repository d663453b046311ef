//! A session as the worker has it: the avatar, its audio, the way of its frames.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use crate::avatar::{Avatar, Due};
use crate::batch::{FrameSink, Member};
use crate::memory::filled;
use crate::model::Model;
use crate::motion::FrameRef;
use crate::session::{Cue, ENDLESS, Failure, Idle, NOBODY, Shared, frame_words, write_frame};
use crate::state::{StateError, StatePass};

/// Frames that a restored session may go on for before the position of one does not fit a word.
const MORE_FRAMES: u64 = 1 << 32;

/// An avatar and the engine's side of its session.
#[derive(Debug)]
pub(crate) struct Core {
    avatar: Avatar,
    out: Out,
    cue: Cue,
    /// Whether the audio side has seen the cue too, so that what is in the ring is this stream's.
    heard: bool,
    chunk_samples: usize,
    chunk_frames: usize,
    /// Nanoseconds that a chunk lasts.
    period: u64,
    /// When the next chunk's audio was there, nanoseconds; none while it is not.
    arrived: Option<u64>,
    /// When real time begins to show the next chunk.
    release: u64,
    /// When the last chunk was done.
    finished: u64,
    /// Samples in the ring that belong to the chunk in work: what comes after a cue is another stream's.
    take: usize,
}

/// Where frames go.
#[derive(Debug)]
struct Out {
    shared: Arc<Shared>,
    words: Box<[u32]>,
    cue: u32,
    sample_rate: u64,
    model_rate: u64,
    frame_rate: u64,
    silence: Silence,
    /// Frames of the chunk in work.
    frames: u64,
}

/// Silence that the engine put into the stream, at the model's rate.
#[derive(Debug, Default)]
struct Silence {
    /// The last of it.
    from: u64,
    len: u64,
    /// All before that.
    before: u64,
}

impl Silence {
    fn add(&mut self, from: u64, len: u64) {
        if self.len > 0 && self.from + self.len == from {
            self.len += len;
        } else {
            *self = Self { from, len, before: self.before + self.len };
        }
    }

    /// How much of the stream before `position` was pushed.
    fn pushed(&self, position: u64) -> u64 {
        position.saturating_sub(self.before + position.saturating_sub(self.from).min(self.len))
    }
}

impl Out {
    /// Describes the silence in a stream of so many samples.
    fn state(&mut self, pass: &mut StatePass, heard: u64) -> Result<(), StateError> {
        let Silence { from, len, before } = &mut self.silence;
        let from = pass.number("silence", from, heard)?;
        let len = pass.number("silence", len, heard - from.min(heard))?;
        let before = pass.number("silence", before, from)?;
        pass.must(len > 0 || (from, before) == (0, 0), "silence")?;
        let last = u128::from(heard) + u128::from(MORE_FRAMES) * u128::from(self.model_rate);
        pass.must(last * u128::from(self.sample_rate) < 1 << 64, "chunks")
    }
}

impl FrameSink for Out {
    fn frame(&mut self, frame: FrameRef) {
        let index = frame.index as u64;
        let sample = if self.silence.len == 0 {
            index * self.sample_rate / self.frame_rate
        } else {
            self.silence.pushed(index * self.model_rate / self.frame_rate) * self.sample_rate / self.model_rate
        };
        write_frame(&mut self.words, self.cue, index, sample, frame.pose, frame.face);
        let written = self.shared.frames.push(self.words.iter().copied());
        debug_assert_eq!(written, self.words.len(), "a chunk is computed only where its frames have room");
        // A stream that has begun since has a backlog of its own.
        if self.shared.cue().number == self.cue {
            self.shared.cover(sample + self.sample_rate / self.frame_rate);
        }
        self.frames += 1;
    }
}

impl Core {
    pub(super) fn new(avatar: Avatar, shared: Arc<Shared>, model: &Model, sample_rate: usize) -> Self {
        let config = &model.config;
        let frames = (avatar.target * config.keyframe_stride) as f64;
        let face_values = model.motion.assembly().face_values();
        Self {
            chunk_samples: avatar.chunk_samples(config),
            chunk_frames: avatar.chunk_frames(config),
            period: nanos(Duration::from_secs_f64(frames / config.frame_rate as f64)),
            avatar,
            out: Out {
                shared,
                words: filled(0, frame_words(face_values)).into(),
                cue: 0,
                sample_rate: sample_rate as u64,
                model_rate: config.audio.sample_rate as u64,
                frame_rate: config.frame_rate as u64,
                silence: Silence::default(),
                frames: 0,
            },
            cue: Cue::default(),
            heard: true,
            arrived: None,
            release: 0,
            finished: 0,
            take: 0,
        }
    }

    /// Whether the host has dropped the session.
    pub(super) fn is_dropped(&self) -> bool {
        self.out.shared.dropped.load(Ordering::SeqCst)
    }

    /// The engine is gone.
    pub(super) fn close(&self) {
        self.out.shared.close();
    }

    /// The session gives no more frames.
    pub(super) fn fail(&self, failure: Failure) {
        self.out.shared.fail(failure);
    }

    /// Makes the next frame panic.
    #[cfg(test)]
    pub(super) fn plant_defect(&mut self) {
        self.out.frame_rate = 0;
    }

    /// What a state must have in common with this session, beside the model.
    pub(crate) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        self.avatar.identity(pass)
    }

    /// Describes the engine's side between two chunks. The count of frames and what the chunk may take are set at the start of
    /// each, and a frame's words are written before they are pushed.
    pub(crate) fn state(&mut self, pass: &mut StatePass, model: &Model) -> Result<(), StateError> {
        self.cue.state(pass)?;
        pass.switch("cue", &mut self.heard)?;
        let there = pass.flag("time of audio", self.arrived.is_some())?;
        let arrived = match pass.follows(there) {
            true => Some(pass.moment("time of audio", self.arrived.unwrap_or_default())?),
            false => None,
        };
        let release = pass.moment("time of release", self.release)?;
        let finished = pass.moment("time of the last chunk", self.finished)?;
        if pass.loads() {
            (self.arrived, self.release, self.finished) = (arrived, release, finished);
            self.out.cue = self.cue.number;
        }
        let heard = self.avatar.state(pass, model)?;
        self.out.state(pass, heard)
    }

    /// Starts anew where somebody interrupted or reset the session.
    fn follow(&mut self) {
        let shared = &self.out.shared;
        let cue = shared.cue();
        if cue != self.cue {
            self.cue = cue;
            self.heard = false;
            self.avatar.reset();
            (self.out.cue, self.out.silence) = (cue.number, Silence::default());
            (self.arrived, self.release) = (None, 0);
        }
        if !self.heard && shared.heard_cue.load(Ordering::SeqCst) == cue.number {
            self.heard = true;
            shared.audio.skip_to(shared.heard_from.load(Ordering::Relaxed));
        }
    }

    /// What can be computed now, and its deadline; none where it waits for audio or for room. The host's side wakes the
    /// engine when that comes.
    pub(super) fn due(&mut self, model: &Model, now: u64) -> Option<(Due, u64)> {
        let shared = Arc::clone(&self.out.shared);
        if self.is_dropped() || !shared.is_running() {
            return None;
        }
        self.follow();
        let mut due = self.wanted(model, &shared);
        if due == Due::Audio {
            // After a cue, the first that is heard of the audio side says where its samples are.
            let wanted = if self.heard { shared.audio.read_position() + self.chunk_samples as u64 } else { 0 };
            shared.due_at.store(wanted, Ordering::SeqCst);
            // It may have come just before the host could see that it is waited for.
            self.follow();
            due = self.wanted(model, &shared);
        }
        if !matches!(due, Due::Chunk | Due::Rest) {
            return None;
        }
        let needed = self.chunk_frames * self.out.words.len();
        if shared.frames.room() < needed {
            shared.wants_room.store(true, Ordering::SeqCst);
            if shared.frames.room() < needed {
                return None;
            }
        }
        if self.arrived.is_none() {
            // Silence that the engine fills in, or a chunk without audio, is due from now on, however long it was quiet.
            let heard = self.avatar.total.is_some() || shared.audio.len() >= self.chunk_samples;
            let arrived = self.avatar.has_audio() && heard;
            let arrived = if arrived { shared.audio_time.load(Ordering::Relaxed) } else { now };
            self.arrived = Some(arrived);
            // Audio that comes faster than it plays is not shown before its time.
            self.release = arrived.max(self.release);
        }
        Some((due, self.release + self.period))
    }

    fn wanted(&mut self, model: &Model, shared: &Shared) -> Due {
        if !self.heard {
            return if self.avatar.has_audio() { Due::Audio } else { Due::Chunk };
        }
        // The end is set after the last audio: whoever sees it sees that too.
        let total = shared.total.load(Ordering::SeqCst);
        if total != ENDLESS {
            self.avatar.finish(usize::try_from(total).unwrap_or(usize::MAX));
        }
        let due = self.avatar.due(&model.config, shared.audio.len());
        let silence = due == Due::Audio && shared.idle() == Idle::Live && shared.wants_silence.load(Ordering::SeqCst);
        if silence { Due::Chunk } else { due }
    }

    /// Claims the next chunk's samples, and takes over what was set since the last one.
    pub(super) fn begin(&mut self) {
        let Self { avatar, out, cue, chunk_samples, take, .. } = self;
        // Nothing of the next stream is in the ring before its cue is given. Where it was given, the chunk is for nobody.
        let available = out.shared.audio.len().min(*chunk_samples);
        *take = if out.shared.cue() == *cue { available } else { 0 };
        out.frames = 0;
        out.shared.due_at.store(NOBODY, Ordering::SeqCst);
        out.shared.take_settings(|settings| {
            avatar.set_sampler(settings.sampler);
            avatar.set_text(&settings.text[..settings.text_len]).expect("a prompt was checked when it was set");
        });
    }

    /// Counts a chunk that is done.
    pub(super) fn end(&mut self, now: u64) {
        let Self { out, arrived, release, period, finished, .. } = self;
        let (stats, since) = (&out.shared.stats, arrived.take().unwrap_or(now));
        out.shared.delays.add(Duration::from_nanos(now.saturating_sub(since.max(*finished))));
        stats.chunks.fetch_add(1, Ordering::Relaxed);
        stats.frames.fetch_add(out.frames, Ordering::Relaxed);
        *release += *period;
        if now > *release {
            stats.late_frames.fetch_add(out.frames, Ordering::Relaxed);
        }
        *finished = now;
    }
}

impl Member for Core {
    fn avatar(&mut self) -> &mut Avatar {
        &mut self.avatar
    }

    fn listen(&mut self, samples: &mut [f32]) {
        let shared = &self.out.shared;
        let mut words = [0; 256];
        let mut came = 0;
        while came < self.take {
            let most = words.len().min(self.take - came);
            let count = shared.audio.pop(&mut words[..most]);
            if count == 0 {
                break;
            }
            let slots = samples[came..came + count].iter_mut();
            slots.zip(&words).for_each(|(slot, &word)| *slot = f32::from_bits(word));
            came += count;
        }
        samples[came..].fill(0.0);
        if came < samples.len() && self.avatar.total.is_none() {
            shared.wants_silence.store(false, Ordering::SeqCst);
            let start = self.avatar.chunk * self.chunk_samples as u64;
            self.out.silence.add(start + came as u64, (samples.len() - came) as u64);
        }
    }

    fn frames(&mut self) -> (&mut Avatar, &mut dyn FrameSink) {
        (&mut self.avatar, &mut self.out)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a chunk is seconds long")]
fn nanos(time: Duration) -> u64 {
    time.as_nanos() as u64
}
