//! What layers hear of each frame's sound: its level, the voice's arousal, and the phrases that begin.

use umo_core_base::arousal::{Arousal, ORDINARY, RATE};
use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};
use umo_core_base::voice::{VoiceLevels, decibels};
use umo_core_model::avatar::Avatar;
use umo_core_model::config::Config;
use umo_core_model::motion::FrameRef;
use umo_core_pose::pose::FIRST_CONTACT;

use umo_core_pose::frame::Cue;

/// Least pause before a phrase, and longest time before one at which it is told, seconds.
const MIN_PAUSE_SECONDS: f32 = 0.3;
const ONSET_SECONDS: f32 = 0.4;
/// Cap of the counted silence, seconds.
const MAX_SILENCE_SECONDS: f32 = 1e3;

/// Returns the cue of a frame with the level of its sound.
pub(crate) fn cue(frame: &FrameRef, level: f32) -> Cue {
    let contacts = frame.channels.lower.get(FIRST_CONTACT..FIRST_CONTACT + 4);
    let contacts = std::array::from_fn(|i| contacts.map_or(0.0, |values| values[i].clamp(0.0, 1.0)));
    Cue { level, contacts, ..Cue::default() }
}

/// Levels of the newest frames of a stream, computed from the samples of its chunks.
#[derive(Debug)]
pub(crate) struct Levels {
    /// Root mean square of frame `index` at `index % len`, full scale 1.
    frames: Slice<f32>,
    /// Seconds of silence before the sound of each; 0 without sound.
    pauses: Slice<f32>,
    voice: VoiceLevels,
    /// Seconds since the last sound.
    silent: f32,
    arousal: Arousal,
    /// Value `index` of the arousal at `index % len`, and their number so far.
    values: Slice<f32>,
    known: u64,
    /// Samples heard so far.
    heard: u64,
    /// Sum of squares of the incomplete frame.
    sum: f64,
    sample_rate: u64,
    frame_rate: u64,
    /// Whether a prompt is in force.
    is_prompted: bool,
}

impl Levels {
    /// Creates the levels of an avatar at the start of its stream, in memory of `arena`.
    pub(crate) fn new_in(avatar: &Avatar, config: &Config, arena: &Arena) -> Self {
        // The frames of a chunk, the frames held back before it, and the horizon.
        let frames = 2 * avatar.chunk_frames(config) + 2 * config.keyframe_stride + avatar.horizon_frames(config);
        Self {
            frames: arena.filled(0.0, frames),
            pauses: arena.filled(0.0, frames),
            voice: VoiceLevels::default(),
            silent: MAX_SILENCE_SECONDS,
            arousal: Arousal::new_in(config.audio.sample_rate, arena),
            values: arena.filled(ORDINARY, frames * RATE as usize / config.frame_rate + 2),
            known: 0,
            heard: 0,
            sum: 0.0,
            sample_rate: config.audio.sample_rate as u64,
            frame_rate: config.frame_rate as u64,
            is_prompted: avatar.is_prompted(),
        }
    }

    /// Returns to the start of a stream.
    pub(crate) fn reset(&mut self) {
        self.frames.fill(0.0);
        self.pauses.fill(0.0);
        (self.voice, self.silent) = (VoiceLevels::default(), MAX_SILENCE_SECONDS);
        self.arousal.reset();
        (self.heard, self.sum, self.known) = (0, 0.0, 0);
    }

    /// Adds a chunk's samples.
    pub(crate) fn push(&mut self, samples: &[f32]) {
        for &sample in samples {
            self.sum += f64::from(sample) * f64::from(sample);
            let frame = self.heard * self.frame_rate / self.sample_rate;
            self.heard += 1;
            if self.heard * self.frame_rate / self.sample_rate > frame {
                self.end(frame);
            }
        }
        let Self { arousal, values, known, .. } = self;
        arousal.push(samples, |value| {
            let place = place(*known, values.len());
            values[place] = value;
            *known += 1;
        });
    }

    /// Whether a prompt said what the newest frames show.
    pub(crate) fn is_prompted(&self) -> bool {
        self.is_prompted
    }

    /// Tells the avatar the arousal at the keyframes of its next chunk, whose samples were pushed; notes whether it has a
    /// prompt.
    pub(crate) fn tell(&mut self, avatar: &mut Avatar, config: &Config) {
        self.is_prompted = avatar.is_prompted();
        let first = avatar.chunk * avatar.target as u64;
        for (keyframe, arousal) in avatar.arousal_mut().iter_mut().enumerate() {
            *arousal = self.arousal((first + keyframe as u64) * config.keyframe_stride as u64);
        }
    }

    /// Arousal of the voice at a frame; the newest if that is not known yet.
    pub(crate) fn arousal(&self, frame: u64) -> f32 {
        let index = (frame * u64::from(RATE) / self.frame_rate).min(self.known.saturating_sub(1));
        if self.known == 0 { ORDINARY } else { self.values[place(index, self.values.len())].clamp(0.0, 1.0) }
    }

    /// Seconds from a frame until the next phrase begins, if it is heard and near; 0 otherwise.
    fn onset(&self, frame: u64) -> f32 {
        let seconds = |frames: u64| frames as f32 / self.frame_rate as f32;
        let heard = self.heard * self.frame_rate / self.sample_rate;
        let mut ahead = (1..).take_while(|&more| seconds(more) <= ONSET_SECONDS && frame + more < heard);
        let next = ahead.find(|&more| self.pauses[place(frame + more, self.pauses.len())] >= MIN_PAUSE_SECONDS);
        next.map_or(0.0, seconds)
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "a level's precision is enough")]
    fn end(&mut self, frame: u64) {
        let count = self.sample_rate as f64 / self.frame_rate as f64;
        let (place, seconds) = (place(frame, self.frames.len()), 1.0 / self.frame_rate as f32);
        self.frames[place] = (self.sum / count).sqrt() as f32;
        self.sum = 0.0;
        let is_on = self.voice.hear(decibels(self.frames[place]), seconds);
        self.pauses[place] = if is_on { self.silent } else { 0.0 };
        self.silent = if is_on { 0.0 } else { (self.silent + seconds).min(MAX_SILENCE_SECONDS) };
    }

    /// Returns the root mean square level of `count` frames from `first` on.
    pub(crate) fn mean(&self, first: u64, count: usize) -> f32 {
        let heard = self.heard * self.frame_rate / self.sample_rate;
        let level = |frame: u64| self.frames[place(frame, self.frames.len())];
        let squares = (first..heard.min(first + count as u64)).map(|frame| level(frame).powi(2));
        (squares.sum::<f32>() / count.max(1) as f32).sqrt()
    }

    /// Returns the cue of a frame.
    pub(crate) fn cue(&self, frame: &FrameRef) -> Cue {
        let index = frame.index as u64;
        let is_heard = index < self.heard * self.frame_rate / self.sample_rate;
        let level = if is_heard { self.frames[place(index, self.frames.len())] } else { 0.0 };
        let prompted = if self.is_prompted { 1.0 } else { 0.0 };
        Cue { arousal: self.arousal(index), onset: self.onset(index), prompted, ..cue(frame, level) }
    }

    /// Saves or loads the levels.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("samples heard", &mut self.heard, 1 << 60)?;
        pass.sum(&mut self.sum)?;
        pass.f32s(&mut self.frames)?;
        pass.f32s(&mut self.pauses)?;
        self.voice.state(pass)?;
        pass.within(&mut self.silent, 0.0..=MAX_SILENCE_SECONDS)?;
        self.arousal.state(pass)?;
        pass.f32s(&mut self.values)?;
        pass.number("arousal", &mut self.known, 1 << 60)?;
        pass.switch("prompt", &mut self.is_prompted).map(drop)
    }
}

/// Place of an entry in a ring.
#[expect(clippy::cast_possible_truncation, reason = "below the length")]
fn place(index: u64, length: usize) -> usize {
    (index % length as u64) as usize
}
