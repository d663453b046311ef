//! An avatar of an [`Engine`](crate::engine::Engine), as its host sees it: audio goes in on one
//! thread and frames come out on another. Neither thread waits (SPEC 2, 2.8).
//!
//! ```text
//!  audio thread            any thread                  game thread
//!  push_audio, finish      interrupt, reset, set_*     pull_frames, sample_pose
//!       │                        │ epoch                    ▲
//!       ▼                        ▼                          │
//!  mix, resample ──ring──► engine: chunks of many avatars ──ring──► ease, place, interpolate
//! ```
//!
//! | module | part |
//! |---|---|
//! | `input`, `other`, `output`, `schedule` | the sides of the host's audio thread, of its game thread, and of the engine |
//! | `shared`, `backlog`, `outcome` | the state they share; their protocol is in `stream`, and the stages of `output` are in `playback` |
//! | `slots` | where the engine finds its sessions |
//! | `company` | calls of a scene |
//! | `packets`, `receiver` | chunks as packets, and sessions whose frames come from packets |
//! | `take` | sessions that play a take |
//! | `state` | saving and restoring |
//! | `config`, `error`, `delay` | settings, errors, the compute-time histogram |

mod backlog;
mod company;
mod config;
pub(crate) mod delay;
mod error;
mod held;
mod input;
mod kept;
mod other;
mod outcome;
mod output;
mod packets;
mod receiver;
mod schedule;
mod shared;
mod slots;
mod state;
mod take;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use umo_core_base::defect::Defect;
use umo_core_base::memory::Counted;
pub use umo_core_base::state::StateError;
use umo_core_layers::{Attention, Controls, GestureOptions, Layer, LipShape, Mood};
use umo_core_model::config::Sampling;
use umo_core_model::lm::layout::MAX_PROMPT_TOKENS;
use umo_core_model::model::Model;
use umo_core_pose::part::Part;

use crate::link::Epoch;
pub use crate::playback::{Frame, Idle, MAX_GAIN, Sampled, Voice};
use crate::take::{Event, Known, Recorder};
pub(crate) use config::check_words;
pub use config::{AUDIO_SECONDS, MAX_CHANNELS, MAX_EASE, MAX_RATE, MIN_RATE, PacketConfig, SessionConfig};
pub use error::{Argument, SessionError};
pub(crate) use outcome::Failure;
use packets::PacketQueue;
pub(crate) use packets::PacketWriter;
use receiver::Receiver;
pub(crate) use schedule::{Member, Members, Schedule};
pub(crate) use shared::{SessionInit, Shared};
use shared::{Settings, try_lock};
pub(crate) use slots::{SlotHandle, Slots};
pub(crate) use state::state_size;

/// Names of the calls that exclude each other, for [`SessionError::Busy`].
const INPUT: &str = "push_audio, finish, save or restore";
const OTHER: &str = "push_other_audio";
const OUTPUT: &str = "pull_frames, sample_pose, set_clock, save or restore";
const SETTER: &str = "a setter, save or restore";

/// Upper bound of [`Session::set_output_delay`], seconds.
pub const MAX_OUTPUT_DELAY: f64 = 2.0;

/// Upper bound of a look-at coordinate's magnitude, metres.
const MAX_DISTANCE: f32 = 10_000.0;

/// Takes a lock that the engine and the output hold only while they copy.
pub(crate) fn spin_lock<T>(mutex: &Mutex<T>) -> Result<MutexGuard<'_, T>, SessionError> {
    const ATTEMPTS: usize = 10_000;
    for _ in 0..ATTEMPTS {
        if let Some(guard) = try_lock(mutex) {
            return Ok(guard);
        }
        std::hint::spin_loop();
    }
    Err(SessionError::Busy(SETTER))
}

/// Result of [`Session::push_audio`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Pushed {
    /// Sample frames (one sample per channel) taken. The rest was refused because the engine is too
    /// far behind.
    pub taken: usize,
    /// Samples among them that were NaN, infinite or too loud, and became silence.
    pub silenced: usize,
}

/// Counters of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Stats {
    /// Chunks computed.
    pub chunks: u64,
    /// Frames computed.
    pub frames: u64,
    /// Frames whose chunk was done too late for real-time playback.
    pub late_frames: u64,
    /// Computed chunks whose body was held because the engine could not keep up
    /// ([`Engine::set_late_limit`](crate::engine::Engine::set_late_limit)).
    pub held_chunks: u64,
    /// Frames dropped by an interrupt or a reset before they were shown.
    pub dropped_frames: u64,
    /// Sample frames refused because there was no room.
    pub overruns: u64,
    /// Samples that were NaN, infinite or too loud.
    pub silenced: u64,
}

/// Latency from speech to motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Latency {
    /// Upper bound on the future audio that a frame needs, in samples at the session's rate,
    /// including resampling. This is the algorithmic latency: a faster processor does not reduce
    /// it.
    pub algorithmic_samples: usize,
    /// Median time from a chunk's last sample, or from the end of the previous chunk if that is
    /// later, to the chunk's frames.
    pub compute_p50: Duration,
    /// 99th percentile of that time.
    pub compute_p99: Duration,
    /// 99.9th percentile of that time.
    pub compute_p999: Duration,
    /// Maximum of that time.
    pub compute_max: Duration,
    /// Backlog: samples, at the session's rate, by which the newest frame is behind the newest
    /// audio, beyond [`algorithmic_samples`](Self::algorithmic_samples). 0 while the engine keeps
    /// up.
    pub backlog_samples: u64,
    /// Largest backlog since the session was created.
    pub backlog_max_samples: u64,
    /// Upper bound on the future audio that a frame's mouth needs, in samples at the session's
    /// rate: [`algorithmic_samples`](Self::algorithmic_samples), or less with [`Voice::Live`].
    pub mouth_samples: usize,
}

/// One avatar. Every call may come from any thread; if two threads make the same call at once, one
/// gets [`SessionError::Busy`].
///
/// Once a session exists, its calls neither allocate nor wait, and make no system call except to
/// wake the engine.
#[derive(Debug)]
pub struct Session {
    shared: Counted<Shared>,
    source: Source,
    /// Upper bound on the bytes of a state.
    state_size: usize,
    /// Delay of the host's output device in seconds, as the bits of a float.
    output_delay: AtomicU64,
}

/// Source of a session's frames.
#[derive(Debug)]
enum Source {
    /// An engine, and the slot with its side of the session.
    Engine(SlotHandle),
    /// Packets.
    Packets(Box<Mutex<Receiver>>),
    /// The live mouth alone, of this model.
    Mouth(Arc<Model>),
}

impl Session {
    pub(crate) fn new(shared: Counted<Shared>, slot: SlotHandle, state_size: usize) -> Self {
        Self { shared, source: Source::Engine(slot), state_size, output_delay: AtomicU64::new(0) }
    }

    /// Creates a session of the mouth alone.
    pub(crate) fn of_mouth(shared: Counted<Shared>, model: Arc<Model>) -> Self {
        let state_size = state_size(&shared, None, &model);
        Self { shared, source: Source::Mouth(model), state_size, output_delay: AtomicU64::new(0) }
    }

    /// Slot with the engine's side of the session, in tests.
    #[cfg(test)]
    pub(crate) fn slot(&self) -> Result<&SlotHandle, SessionError> {
        match &self.source {
            Source::Engine(slot) => Ok(slot),
            Source::Packets(_) | Source::Mouth(_) => Err(SessionError::IsDecoder),
        }
    }

    /// The model of a session that hears.
    fn model(&self) -> Result<&Model, SessionError> {
        match &self.source {
            Source::Engine(slot) => Ok(slot.model()),
            Source::Mouth(model) => Ok(model),
            Source::Packets(_) => Err(SessionError::IsDecoder),
        }
    }

    /// Takes as many interleaved samples, full scale 1, as there is room for. The avatar speaks
    /// them.
    ///
    /// Wait-free: meant for a real-time audio thread. Samples that are NaN, infinite or louder than
    /// [`MAX_AMPLITUDE`](umo_core_base::samples::MAX_AMPLITUDE) become silence and are counted.
    ///
    /// # Errors
    /// [`SessionError`] if the samples are not whole frames, after [`Self::finish`], or if another
    /// thread pushes.
    pub fn push_audio(&self, samples: &[f32]) -> Result<Pushed, SessionError> {
        self.push(samples, |&sample| sample)
    }

    /// [`Self::push_audio`] for 16-bit samples, whose full scale is 32768.
    ///
    /// # Errors
    /// As [`Self::push_audio`].
    pub fn push_audio_i16(&self, samples: &[i16]) -> Result<Pushed, SessionError> {
        self.push(samples, |&sample| f32::from(sample) / 32768.0)
    }

    fn push<T>(&self, samples: &[T], float: impl Fn(&T) -> f32) -> Result<Pushed, SessionError> {
        let shared = &*self.shared;
        shared.outcome.check()?;
        self.model()?;
        let mut input = try_lock(&shared.input).ok_or(SessionError::Busy(INPUT))?;
        input.push(shared, samples, float)
    }

    /// Feeds the voice of a person at a microphone, as interleaved samples at the session's rate and
    /// channels. From then on the person stands 1.5 m ahead of the avatar, until a reset, and the two
    /// are as in a [scene](crate::scene::Scene): the avatar looks there and away, listens, nods, and gives way.
    /// In a scene of the host's, its members count instead. Only the loudness is used. Samples that are NaN or infinite
    /// count as silence.
    ///
    /// Wait-free; any thread may call it while other calls run. Meant for the thread that records.
    ///
    /// # Errors
    /// [`SessionError::Uneven`] if the samples are not whole frames, [`SessionError::Busy`] if
    /// another thread is in this call.
    pub fn push_other_audio(&self, samples: &[f32]) -> Result<(), SessionError> {
        let shared = &*self.shared;
        shared.outcome.check()?;
        try_lock(&shared.other).ok_or(SessionError::Busy(OTHER))?.push(shared, samples)
    }

    /// Ends the audio: the tail is computed, for `floor(seconds * 30)` frames in all. A second call
    /// is a no-op.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread is pushing.
    pub fn finish(&self) -> Result<(), SessionError> {
        let shared = &*self.shared;
        shared.outcome.check()?;
        self.model()?;
        let mut input = try_lock(&shared.input).ok_or(SessionError::Busy(INPUT))?;
        input.finish(shared);
        Ok(())
    }

    /// Calls `frame` with up to `most` ready frames, in order, and returns their number.
    ///
    /// Never waits. Frame indices count from 0 at the start or the last reset.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread pulls; [`SessionError::Failed`], `Panicked` or
    /// `Closed` once all ready frames have been pulled.
    pub fn pull_frames(&self, most: usize, mut frame: impl FnMut(Frame)) -> Result<usize, SessionError> {
        let shared = &*self.shared;
        let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        let mut count = 0;
        while count < most
            && let Some(shown) = output.next(shared)
        {
            frame(shown);
            count += 1;
        }
        if count == 0 && most > 0 {
            shared.outcome.check()?;
            output.want_silence(shared);
        }
        Ok(count)
    }

    /// Number of frames that are ready.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread pulls.
    pub fn ready_frames(&self) -> Result<usize, SessionError> {
        let mut output = try_lock(&self.shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        Ok(output.ready(&self.shared))
    }

    /// Arousal of the voice at the newest frame that was pulled or sampled, 0 to 1: 0.5 for an ordinary voice, and for none;
    /// and its trend, the change per second over the last seconds (SPEC 2.22).
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread pulls.
    pub fn arousal(&self) -> Result<(f32, f32), SessionError> {
        let mut output = try_lock(&self.shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        Ok(output.arousal(&self.shared))
    }

    /// Message and location of the panic that ended the session with
    /// [`SessionError::Panicked`].
    pub fn defect(&self) -> Option<&Defect> {
        self.shared.outcome.defect()
    }

    /// Whether [`Self::finish`] was called and every frame up to the end was handed out, or every
    /// packet if the session queues no frames.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread pulls; [`SessionError::Failed`], `Panicked` or
    /// `Closed` if the remaining frames will never be computed.
    pub fn is_done(&self) -> Result<bool, SessionError> {
        let shared = &*self.shared;
        let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        if let Some(total) = shared.link.total() {
            let has_ended = |queue: &PacketQueue| total == 0 || queue.has_ended(shared.link.epoch().number);
            let is_done = match &shared.packets {
                Some(queue) if !queue.with_frames => has_ended(queue),
                _ => output.is_done(shared, total),
            };
            if is_done {
                return Ok(true);
            }
        }
        if output.ready(shared) == 0 {
            shared.outcome.check()?;
        }
        Ok(false)
    }

    /// Samples the pose at `seconds` of the motion (frame index / 30), minus
    /// [`Self::output_delay`], for a renderer at its own rate. Rotations are interpolated along the
    /// shorter arc, everything else linearly. Earlier frames are consumed as by
    /// [`Self::pull_frames`].
    ///
    /// A time before the oldest frame gives the oldest frame; a time after the newest gives the
    /// pose that [`Idle`] selects. The time never goes back: an earlier one counts as the last one.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread pulls; [`SessionError::Range`] if the time is not
    /// finite.
    pub fn sample_pose(&self, seconds: f64, mut frame: impl FnMut(Frame)) -> Result<Sampled, SessionError> {
        if !seconds.is_finite() {
            return Err(SessionError::Range(Argument::PoseTime));
        }
        let shared = &*self.shared;
        let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        let (sampled, pose) = output.sample(shared, seconds - self.output_delay());
        frame(pose);
        Ok(sampled)
    }

    /// Sets the delay of the output device: seconds from playing a sound to hearing it, 0 to
    /// [`MAX_OUTPUT_DELAY`]. [`Self::sample_pose`] shows the pose of that much earlier. The default
    /// is 0. The delay is not part of a state and changes no frame.
    ///
    /// # Errors
    /// [`SessionError::Range`] if the delay is out of range.
    pub fn set_output_delay(&self, seconds: f64) -> Result<(), SessionError> {
        if !(0.0..=MAX_OUTPUT_DELAY).contains(&seconds) {
            return Err(SessionError::Range(Argument::OutputDelay));
        }
        self.output_delay.store(seconds.to_bits(), Ordering::Relaxed);
        Ok(())
    }

    /// Delay of the output device, seconds.
    pub fn output_delay(&self) -> f64 {
        f64::from_bits(self.output_delay.load(Ordering::Relaxed))
    }

    /// Sets the host's time in seconds from any origin, 0 to 1e9. From the first call on, idle
    /// motion, the eases to it and back, and [`SessionConfig::idle_after`] follow this time instead
    /// of the clock. A host that pauses or renders slower than real time calls this for every
    /// rendered image, before [`Self::sample_pose`]. The time never goes back, except by
    /// [`Self::restore`], which returns to the state's time.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread pulls; [`SessionError::Range`] if the time is not
    /// in 0 to 1e9.
    pub fn set_clock(&self, seconds: f64) -> Result<(), SessionError> {
        if !(0.0..=1e9).contains(&seconds) {
            return Err(SessionError::Range(Argument::HostTime));
        }
        let shared = &*self.shared;
        let _output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        shared.host.clock.set(Duration::from_secs_f64(seconds));
        Ok(())
    }

    /// Barge-in: drops everything not shown yet and eases to the rest pose within `ease`, at most
    /// [`MAX_EASE`]. Audio pushed from now on starts a new stream, whose frames follow the ease.
    /// The frame index continues and the avatar stays where it stands. The new stream then blends
    /// in from the rest pose over as many frames, at most [`SessionConfig::ease`]; the face does so
    /// in a quarter of them.
    ///
    /// # Errors
    /// [`SessionError::Range`] if `ease` is longer.
    pub fn interrupt(&self, ease: Duration) -> Result<(), SessionError> {
        if ease > MAX_EASE {
            return Err(SessionError::Range(Argument::Ease));
        }
        self.shared.outcome.check()?;
        self.model()?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 10 seconds of frames")]
        let frames = (ease.as_secs_f64() * self.shared.format.frame_rate as f64).ceil() as u16;
        self.shared.link.begin_epoch(|epoch| epoch.interrupted(frames));
        Ok(())
    }

    /// Returns to the start: drops everything that was pushed and not shown. The frame index
    /// restarts at 0, and the output is that of a new session with the same settings.
    ///
    /// # Errors
    /// [`SessionError`] if the session has failed.
    pub fn reset(&self) -> Result<(), SessionError> {
        self.shared.outcome.check()?;
        if let Some(take) = &self.shared.take {
            let mut controls = spin_lock(&self.shared.host.controls.value)?;
            let Controls { gestures, hints, words, .. } = *controls;
            *controls = Controls { gestures, hints, words, ..take.controls() };
            drop(controls);
            self.shared.host.controls.changed();
        }
        self.shared.link.begin_epoch(Epoch::reset);
        Ok(())
    }

    /// Sets the token ids of the free-text prompt from the next chunk on, as
    /// [`TextTokenizer::encode`](umo_core_model::lm::text::TextTokenizer) returns them.
    ///
    /// # Errors
    /// [`SessionError::Range`] for more than [`MAX_PROMPT_TOKENS`] ids.
    pub fn set_prompt(&self, ids: &[u32]) -> Result<(), SessionError> {
        if ids.len() > MAX_PROMPT_TOKENS {
            return Err(SessionError::Range(Argument::PromptLength));
        }
        self.model()?;
        let mut bytes = [[0; 4]; MAX_PROMPT_TOKENS];
        bytes.iter_mut().zip(ids).for_each(|(bytes, id)| *bytes = id.to_le_bytes());
        let change = |settings: &mut Settings| {
            settings.text[..ids.len()].copy_from_slice(ids);
            settings.text_len = ids.len();
        };
        self.set_recorded(change, |_| Event::Prompt(&bytes[..ids.len()]))
    }

    /// Sets the sampling seed from the next chunk on. The layers keep the seed that the session was
    /// created with.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread sets something.
    pub fn set_seed(&self, seed: u64) -> Result<(), SessionError> {
        self.set(|settings| settings.sampler.seed = seed)
    }

    /// Sets how codes are sampled from the next chunk on.
    ///
    /// # Errors
    /// [`SessionError::Range`] if the temperature is not in 0 to 100, or `top_p` not in 0 to 1.
    pub fn set_sampling(&self, sampling: Sampling) -> Result<(), SessionError> {
        if !(0.0..=100.0).contains(&sampling.temperature) || !(0.0..=1.0).contains(&sampling.top_p) {
            return Err(SessionError::Range(Argument::Sampling));
        }
        self.set(|settings| settings.sampler.sampling = sampling)
    }

    /// Sets how often hands leave rest from the next chunk on, 0 to 1 (SPEC 2.21); layers follow
    /// from the next frame on. At 1 hands hardly rest, at 0 they hardly rise.
    ///
    /// # Errors
    /// [`SessionError::Range`] if it is not in 0 to 1.
    pub fn set_activity(&self, activity: f32) -> Result<(), SessionError> {
        if !(0.0..=1.0).contains(&activity) {
            return Err(SessionError::Range(Argument::Activity));
        }
        let sampler = {
            let mut settings = self.settings()?;
            settings.sampler.activity = activity;
            settings.sampler
        };
        self.shared.settings.changed();
        self.ask(&Event::Sampler(sampler))
    }

    /// Sets how far body and face follow the arousal of the voice, 0 to 1 (SPEC 2.22): the body from the next chunk on,
    /// the layers from the next frame on. 0 ignores the voice.
    ///
    /// # Errors
    /// [`SessionError::Range`] if it is not in 0 to 1; [`SessionError::Busy`] if another thread sets something.
    pub fn set_expression(&self, expression: f32) -> Result<(), SessionError> {
        if !(0.0..=1.0).contains(&expression) {
            return Err(SessionError::Range(Argument::Expression));
        }
        self.set(|settings| settings.sampler.expression = expression)?;
        self.ask(&Event::Expression(expression))
    }

    /// Sets the idle mode.
    pub fn set_idle(&self, idle: Idle) {
        self.shared.host.idle.store(idle as u8, Ordering::Relaxed);
    }

    /// Sets the gain of `part`'s motion from the next frame handed out: 0 keeps it at rest, 1 shows
    /// it as computed, up to [`MAX_GAIN`] exaggerates. A change ramps over up to a quarter of a
    /// second to avoid jumps. The lower body's gain also scales the root's translation; the face's
    /// also applies to jaw and eyes.
    ///
    /// # Errors
    /// [`SessionError::Range`] if the gain is not in 0 to [`MAX_GAIN`].
    pub fn set_gain(&self, part: Part, gain: f32) -> Result<(), SessionError> {
        if !(0.0..=MAX_GAIN).contains(&gain) {
            return Err(SessionError::Range(Argument::PartGain));
        }
        self.shared.host.gains[part].store(gain.to_bits(), Ordering::Relaxed);
        Ok(())
    }

    /// Gain of `part`, as set.
    pub fn gain(&self, part: Part) -> f32 {
        f32::from_bits(self.shared.host.gains[part].load(Ordering::Relaxed))
    }

    /// Sets the gain of a layer over the decoders' frames, 0 to 1, from the next frame on. At 0 the
    /// frame passes through unchanged.
    ///
    /// # Errors
    /// [`SessionError::Range`] if the gain is not in 0 to 1, [`SessionError::Busy`] if another
    /// thread sets something.
    pub fn set_layer(&self, layer: Layer, gain: f32) -> Result<(), SessionError> {
        if !(0.0..=1.0).contains(&gain) {
            return Err(SessionError::Range(Argument::LayerGain));
        }
        self.ask(&Event::Layer { layer, gain })
    }

    /// Looks at a point in the avatar's space, metres, with a strength of 0 to 1, from the next
    /// frame on: first with the eyes, then the head, then the trunk, within the body's limits. A
    /// strength of 0 releases the gaze. The point may change with every frame.
    ///
    /// # Errors
    /// [`SessionError::Range`] if a coordinate is not finite or beyond 10 km, or the strength is
    /// not in 0 to 1; [`SessionError::Busy`] if another thread sets something.
    pub fn look_at(&self, point: [f32; 3], strength: f32) -> Result<(), SessionError> {
        if !point.iter().all(|value| value.abs() <= MAX_DISTANCE) || !(0.0..=1.0).contains(&strength) {
            return Err(SessionError::Range(Argument::LookAt));
        }
        self.ask(&Event::Look { point, strength })
    }

    /// Sets the avatar's attention from the next frame on; changes blend over half a second.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread sets something.
    pub fn set_attention(&self, attention: Attention) -> Result<(), SessionError> {
        self.ask(&Event::Attention(attention))
    }

    /// Sets the mood of face and posture from the next frame on, with a strength of 0 to 1; changes
    /// blend over a second.
    ///
    /// # Errors
    /// [`SessionError::Range`] if the strength is not in 0 to 1, [`SessionError::Busy`] if another
    /// thread sets something.
    pub fn set_mood(&self, mood: Mood, strength: f32) -> Result<(), SessionError> {
        if !(0.0..=1.0).contains(&strength) {
            return Err(SessionError::Range(Argument::MoodStrength));
        }
        self.ask(&Event::Mood { mood, strength })
    }

    /// Plays a gesture over the model's motion, from the next frame on or at a given time. Its body
    /// parts ease to the gesture and back; the others continue. Gestures of the same parts play in
    /// the order of the requests; one with a time takes their place. An
    /// [`interrupt`](Self::interrupt) eases out of the playing gestures and drops the pending ones;
    /// a [`reset`](Self::reset) drops all at once. While no frames come, gestures without a time
    /// play on and times of the motion stand still.
    ///
    /// # Errors
    /// [`SessionError::UnknownGesture`]; [`SessionError::GesturesFull`] if
    /// [`MAX_PENDING_GESTURES`](umo_core_layers::MAX_PENDING_GESTURES) are pending; [`SessionError::Range`]
    /// if an option is out of range; [`SessionError::Busy`] if another thread sets something.
    pub fn play_gesture(&self, name: &str, options: &GestureOptions) -> Result<(), SessionError> {
        self.ask(&Event::Gesture { name, options: *options })
    }

    /// Schedules a viseme hint (bilabial, labiodental, rounded) at `start` for `duration`, in
    /// seconds of the audio pushed since the session's start or last reset. The lips then have that
    /// shape, and reach and leave it within 60 ms, regardless of the model. The hint has no effect
    /// on models without ARKit's blendshapes. Hints may come in any order, before or after their
    /// audio; one whose time was already handed out has no effect. An
    /// [`interrupt`](Self::interrupt) drops pending hints.
    ///
    /// # Errors
    /// [`SessionError::Range`] if a time is negative or not finite, or the duration is not in 0 to
    /// [`MAX_HINT_SECONDS`](umo_core_layers::MAX_HINT_SECONDS); [`SessionError::HintsFull`] if
    /// [`MAX_PENDING_HINTS`](umo_core_layers::MAX_PENDING_HINTS) are pending; [`SessionError::Busy`] if
    /// another thread sets something.
    pub fn hint_lips(&self, shape: LipShape, start: f64, duration: f64) -> Result<(), SessionError> {
        self.ask(&Event::Lips { shape, start, duration })
    }

    /// Gives the words of a text and their time, in seconds of the audio pushed since the session's start or last
    /// reset: usually one word; several share the time by their syllables. Punctuation belongs to its word. By
    /// [`SessionConfig::words`] some of them become gestures, whose stroke falls on the stressed vowel; those of
    /// [`play_gesture`](Self::play_gesture) come first. Words may come in any order, before or after their audio, but one
    /// that comes less than 1.6 seconds before its frame may be gestured late or not at all. An
    /// [`interrupt`](Self::interrupt) drops pending words.
    ///
    /// # Errors
    /// [`SessionError::Range`] if the start is negative or not finite, the end is not 0 to
    /// [`MAX_WORDS_SECONDS`](umo_core_layers::MAX_WORDS_SECONDS) later, or the text has more than
    /// [`MAX_PENDING_WORDS`](umo_core_layers::MAX_PENDING_WORDS) words; [`SessionError::WordsFull`] if more than so many
    /// would be pending; [`SessionError::Busy`] if another thread sets something.
    pub fn hint_words(&self, text: &str, start: f64, end: f64) -> Result<(), SessionError> {
        self.ask(&Event::Words { text, start, end })
    }

    /// Names of the gestures that the avatar knows.
    pub fn gesture_names(&self) -> impl Iterator<Item = &str> {
        self.shared.host.gestures.names()
    }

    /// Asks the layers for something, from the next frame on.
    fn ask(&self, event: &Event) -> Result<(), SessionError> {
        let Shared { outcome, host, link, format, recorder, .. } = &*self.shared;
        outcome.check()?;
        // Held until the record is written, so that the output cannot take the request over before.
        let recording = recorder.as_ref().map(Recorder::lock).transpose()?;
        let (epoch, passed) = (link.epoch(), host.passed());
        let known = Known {
            gestures: &host.gestures,
            rules: &host.words,
            frame_rate: format.frame_rate,
            sample_rate: format.sample_rate,
        };
        event.apply(&mut *spin_lock(&host.controls.value)?, &known, (epoch.number, passed))?;
        host.controls.changed();
        if let Some(mut recording) = recording {
            recording.event(epoch, event);
        }
        Ok(())
    }

    /// Gain of a layer, as set.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread sets something.
    pub fn layer(&self, layer: Layer) -> Result<f32, SessionError> {
        Ok(spin_lock(&self.shared.host.controls.value)?.layers.gain(layer))
    }

    /// Attention, as set.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread sets something.
    pub fn attention(&self) -> Result<Attention, SessionError> {
        Ok(spin_lock(&self.shared.host.controls.value)?.attention)
    }

    /// The idle mode.
    pub fn idle(&self) -> Idle {
        self.shared.host.idle()
    }

    /// Current sampling settings.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread sets something.
    pub fn sampling(&self) -> Result<Sampling, SessionError> {
        Ok(self.settings()?.sampler.sampling)
    }

    /// Current activity of the hands.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread sets something.
    pub fn activity(&self) -> Result<f32, SessionError> {
        Ok(self.settings()?.sampler.activity)
    }

    /// Current expression of the voice.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread sets something.
    pub fn expression(&self) -> Result<f32, SessionError> {
        Ok(self.settings()?.sampler.expression)
    }

    fn set(&self, change: impl FnOnce(&mut Settings)) -> Result<(), SessionError> {
        self.set_recorded(change, |settings| Event::Sampler(settings.sampler))
    }

    /// Changes the settings of the engine's side, and records what they are now.
    fn set_recorded<'a>(
        &self,
        change: impl FnOnce(&mut Settings),
        event: impl FnOnce(&Settings) -> Event<'a>,
    ) -> Result<(), SessionError> {
        let Shared { outcome, link, recorder, settings: handover, .. } = &*self.shared;
        outcome.check()?;
        let recording = recorder.as_ref().map(Recorder::lock).transpose()?;
        let mut settings = self.settings()?;
        change(&mut settings);
        if let Some(mut recording) = recording {
            recording.event(link.epoch(), &event(&settings));
        }
        drop(settings);
        handover.changed();
        Ok(())
    }

    /// Locks the settings. The engine holds this lock only while it copies them.
    fn settings(&self) -> Result<MutexGuard<'_, Settings>, SessionError> {
        spin_lock(&self.shared.settings.value)
    }

    /// Number of interleaved channels of the audio.
    pub fn channels(&self) -> usize {
        self.shared.format.channels
    }

    /// Counters so far.
    pub fn stats(&self) -> Stats {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let c = &self.shared.stats;
        Stats {
            chunks: read(&c.chunks),
            frames: read(&c.frames),
            late_frames: read(&c.late_frames),
            held_chunks: read(&c.held_chunks),
            dropped_frames: read(&c.dropped_frames),
            overruns: read(&c.overruns),
            silenced: read(&c.silenced),
        }
    }

    /// Latency from speech to motion.
    pub fn latency(&self) -> Latency {
        let Shared { stats, format, .. } = &*self.shared;
        let (backlog_samples, backlog_max_samples) = self.shared.backlog.measure();
        Latency {
            algorithmic_samples: format.algorithmic_samples,
            mouth_samples: format.mouth_samples,
            compute_p50: stats.delays.quantile(0.5),
            compute_p99: stats.delays.quantile(0.99),
            compute_p999: stats.delays.quantile(0.999),
            compute_max: stats.delays.largest(),
            backlog_samples,
            backlog_max_samples,
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.outcome.dropped.store(true, Ordering::SeqCst);
        if let Source::Engine(slot) = &self.source {
            slot.sweep();
        }
    }
}
