//! One avatar computed on demand by the caller, for recordings and tests. For the stream of a game use an
//! [`Engine`](crate::engine::Engine).

use std::fmt;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{Arena, Boxed};
use umo_core_base::samples::silence_unusable;
use umo_core_layers::{GestureOptions, Gestures, LayerGains, LayerStack, LipShape, Mood, WordRules};
use umo_core_model::avatar::{Avatar, AvatarConfig, Due, StageTimes};
use umo_core_model::batch::Batch;
use umo_core_model::config::{Accents, Config};
use umo_core_model::linear::Compute;
use umo_core_model::model::Model;
use umo_core_model::motion::FrameRef;
use umo_core_model::record::Chunk;
use umo_core_pose::frame::{Cue, OwnedFrame};
use umo_core_pose::part::PerPart;

use crate::levels::Levels;
use crate::packet::{PacketLayout, PacketRoom};
use crate::playback::Layers;
use crate::retime::{self, TimeMap};
use crate::session::{Argument, SessionError, check_words};
use crate::take::{Event, Head, Known, Log, Take};

/// Audio source that an animation reads on demand.
pub trait AudioSource: Send {
    /// Appends the next samples, mono at the model's rate, to `samples`. Returns `false` at the end.
    ///
    /// # Errors
    /// [`StepError`] if the audio ends earlier than announced.
    fn pull(&mut self, samples: &mut Vec<f32>) -> Result<bool, StepError>;
}

/// One avatar, its audio, and buffers to compute its chunks.
#[derive(Debug)]
pub struct Animation {
    avatar: Avatar,
    track: Track,
    batch: Batch,
    /// Work done by the last step.
    stepped: Due,
    /// Buffers for a packet's levels and codes.
    said: PacketRoom,
    /// Settings, for a take.
    config: AvatarConfig,
    gains: LayerGains,
    recorder: Option<Recorder>,
}

/// Head of a take, and what its packets are written with.
#[derive(Debug)]
struct Recorder {
    head: Head,
    layout: PacketLayout,
    packet: Vec<u8>,
}

impl Recorder {
    /// Adds the packet of the chunk that `stepped` describes to the track's log.
    fn packet(
        &mut self,
        said: &mut PacketRoom,
        avatar: &Avatar,
        config: &Config,
        stepped: Due,
        track: &mut Track,
    ) -> Result<(), StepError> {
        let Self { layout, packet, .. } = self;
        if let Some(log) = &mut track.log
            && let Some(length) = said.write(avatar, config, layout, stepped, (0, 0), &track.levels, packet)?
        {
            log.packet(&packet[..length]);
        }
        Ok(())
    }

    /// The take of the track so far.
    fn take(&self, track: &Track) -> Option<Take> {
        let log = track.log.as_ref()?;
        let mut bytes = vec![0; log.length(&self.head)];
        log.take(&self.head, track.layers.stack.word_rules().fingerprint(), &mut bytes);
        Take::new(&bytes).ok()
    }
}

/// Audio of an avatar, and the stages of its frames.
struct Track {
    /// Source of further samples, if they are read on demand.
    source: Option<Box<dyn AudioSource>>,
    /// Samples that no chunk has used.
    pending: Vec<f32>,
    /// Total number of samples pushed.
    samples: usize,
    /// Levels of the frames' sound.
    levels: Levels,
    /// The frame that the layers modify.
    frame: OwnedFrame,
    layers: Boxed<Layers>,
    gestures: Gestures,
    frame_rate: usize,
    /// Frames that wait for the end of the recording, to be retimed.
    retiming: Option<Retiming>,
    /// Records of a take, if one is made.
    log: Option<Log>,
}

impl fmt::Debug for Track {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Track")
            .field("pending", &self.pending.len())
            .field("samples", &self.samples)
            .finish_non_exhaustive()
    }
}

/// A recording whose strokes are moved onto its accents.
#[derive(Debug)]
struct Retiming {
    said: Accents,
    /// Audio units so far.
    units: Vec<u32>,
    /// The decoders' frames so far.
    frames: Vec<OwnedFrame>,
}

/// Time units per frame for placing lip hints.
const HINT_UNITS: usize = 1000;

impl Animation {
    /// Creates an animation at its start, with all layers off.
    ///
    /// # Errors
    /// [`LoadError::Config`] if the template is missing; [`LoadError::Argument`] if a number is out of range.
    pub fn new(model: &Model, config: &AvatarConfig) -> Result<Self, LoadError> {
        Self::with_layers(model, config, LayerGains::OFF, Gestures::new())
    }

    /// Creates an animation at its start, with layers over the model's frames and these gestures.
    ///
    /// # Errors
    /// As in [`Self::new`].
    pub fn with_layers(
        model: &Model,
        config: &AvatarConfig,
        gains: LayerGains,
        gestures: Gestures,
    ) -> Result<Self, LoadError> {
        let avatar = Avatar::new(model, config)?;
        Ok(Self {
            track: Track::new(model, config, &avatar, (gains, gestures))?,
            avatar,
            batch: Batch::new(model, 1),
            stepped: Due::Nothing,
            said: PacketRoom::new(model.config(), &PacketLayout::new(model)),
            config: config.clone(),
            gains,
            recorder: None,
        })
    }

    /// The avatar.
    #[doc(hidden)]
    pub fn avatar(&self) -> &Avatar {
        &self.avatar
    }

    /// The avatar, mutable for setup.
    #[doc(hidden)]
    pub fn avatar_mut(&mut self) -> &mut Avatar {
        &mut self.avatar
    }

    /// Records each chunk's codes and experts from now on, for [`Self::chunk`]. Has no other effect.
    #[doc(hidden)]
    pub fn keep_record(&mut self, config: &Config) {
        self.batch.keep_record(config);
    }

    /// Record of the last [`Self::step`]'s chunk; `None` if it had no chunk or records are off.
    #[doc(hidden)]
    pub fn chunk(&self) -> Option<Chunk<'_>> {
        self.batch.chunk()
    }

    /// Appends mono samples at the model's rate. Returns the number of samples that were replaced by silence because
    /// they were NaN, infinite or beyond [`MAX_AMPLITUDE`](umo_core_base::samples::MAX_AMPLITUDE).
    ///
    /// # Errors
    /// [`StepError::Order`] after [`Self::finish`].
    pub fn push_audio(&mut self, samples: &[f32]) -> Result<usize, StepError> {
        if self.avatar.total.is_some() {
            return Err(StepError::Order("audio was pushed after the end"));
        }
        Ok(self.track.push_audio(samples))
    }

    /// Reads all further audio from `source`, only when a chunk needs it; the stream ends after `frames` frames.
    pub fn hear(&mut self, source: Box<dyn AudioSource>, frames: usize) {
        self.track.source = Some(source);
        self.finish(frames);
    }

    /// Ends the audio: the stream ends after `frames` frames.
    pub fn finish(&mut self, frames: usize) {
        self.avatar.finish(frames);
    }

    /// Plays a gesture over the model's motion, like [`Session::play_gesture`](crate::session::Session::play_gesture): from
    /// the next frame on, or at a given time of the motion.
    ///
    /// # Errors
    /// [`SessionError::UnknownGesture`]; [`SessionError::GesturesFull`] if
    /// [`MAX_PENDING_GESTURES`](umo_core_layers::MAX_PENDING_GESTURES) are pending; [`SessionError::Range`] if an option is out
    /// of range.
    pub fn play_gesture(&mut self, name: &str, options: &GestureOptions) -> Result<(), SessionError> {
        self.track.ask(&Event::Gesture { name, options: *options })
    }

    /// Schedules a viseme hint, like [`Session::hint_lips`](crate::session::Session::hint_lips).
    ///
    /// # Errors
    /// [`SessionError::Range`] if a time is out of range; [`SessionError::HintsFull`] if
    /// [`MAX_PENDING_HINTS`](umo_core_layers::MAX_PENDING_HINTS) are pending.
    pub fn hint_lips(&mut self, shape: LipShape, start: f64, duration: f64) -> Result<(), SessionError> {
        self.track.ask(&Event::Lips { shape, start, duration })
    }

    /// Sets the rules of the words, before the first ones. English without.
    ///
    /// # Errors
    /// [`LoadError::Argument`] if the avatar does not know one of their gestures.
    pub fn set_word_rules(&mut self, rules: WordRules) -> Result<(), LoadError> {
        check_words(&rules, &self.track.gestures)?;
        self.track.layers.stack.set_word_rules(rules);
        Ok(())
    }

    /// Gives the words of a text and their time, like [`Session::hint_words`](crate::session::Session::hint_words).
    ///
    /// # Errors
    /// [`SessionError::Range`] if a time or the number of words is out of range; [`SessionError::WordsFull`] if more than
    /// [`MAX_PENDING_WORDS`](umo_core_layers::MAX_PENDING_WORDS) would be pending.
    pub fn hint_words(&mut self, text: &str, start: f64, end: f64) -> Result<(), SessionError> {
        self.track.ask(&Event::Words { text, start, end })
    }

    /// Sets the mood of face and posture from the next frame on, with a strength of 0 to 1, like
    /// [`Session::set_mood`](crate::session::Session::set_mood).
    ///
    /// # Errors
    /// [`SessionError::Range`] if the strength is not in 0 to 1.
    pub fn set_mood(&mut self, mood: Mood, strength: f32) -> Result<(), SessionError> {
        if !(0.0..=1.0).contains(&strength) {
            return Err(SessionError::Range(Argument::MoodStrength));
        }
        self.track.ask(&Event::Mood { mood, strength })
    }

    /// Records a take from now on, before the first chunk and before anything is asked of the avatar; [`Self::take`] has it.
    ///
    /// # Errors
    /// [`StepError::Order`] after the first chunk, or if the motion is retimed, which packets cannot represent.
    pub fn record(&mut self, model: &Model) -> Result<(), StepError> {
        if self.avatar.chunk > 0 || self.track.retiming.is_some() {
            return Err(StepError::Order("a take is recorded from the first chunk on, and not of a retimed motion"));
        }
        let layout = PacketLayout::new(model);
        let config = model.config();
        let mut history = vec![0; config.prefix * layout.codes()];
        self.avatar.window.last(&mut history);
        let head = Head::new(
            (config, model.fingerprint()),
            &self.config,
            self.gains,
            HINT_UNITS * self.track.frame_rate,
            &history,
            &Arena::system(),
        );
        let packet = vec![0; layout.most_bytes()];
        self.recorder = Some(Recorder { head, layout, packet });
        self.track.log = Some(Log::growing());
        Ok(())
    }

    /// Leaves the mouth to the codes, before the first chunk. Without it, the frames of a model with the head for it, and
    /// their packets, have the mouth of their own sound (SPEC 2.10).
    pub fn keep_codes_mouth(&mut self) {
        self.avatar.keep_codes_mouth();
    }

    /// The take so far; `None` without [`Self::record`].
    pub fn take(&self) -> Option<Take> {
        self.recorder.as_ref()?.take(&self.track)
    }

    /// Moves strokes of arms, hands, trunk and head onto the accents in the audio units, before layers are applied
    /// (SPEC 2.19). All frames then wait for the end of the recording, at a kilobyte or more each, and are emitted by
    /// the last [`Self::step`]. Their [`channels`](FrameRef::channels) are empty, because the pose no longer matches
    /// them.
    ///
    /// # Errors
    /// [`StepError::Missing`] if the model does not mark accents or reads no audio; [`StepError::Order`] after the
    /// first chunk.
    pub fn retime(&mut self, model: &Model) -> Result<(), StepError> {
        let said = model.config().audio.accents.filter(|_| self.avatar.has_audio());
        let said = said.ok_or(StepError::Missing("audio units with accents (`audio.accents` of its config)"))?;
        if self.avatar.chunk > 0 || self.track.log.is_some() {
            return Err(StepError::Order("retiming can only be enabled before the first chunk, and not for a take"));
        }
        self.track.retiming = Some(Retiming { said, units: Vec::new(), frames: Vec::new() });
        Ok(())
    }

    /// Sets codes of the next chunk's keyframes instead of drawing them, as [`Avatar::want`].
    ///
    /// # Errors
    /// As of [`Avatar::want`].
    pub fn want(&mut self, codes: &[u16]) -> Result<(), StepError> {
        self.avatar.want(codes)
    }

    /// Number of frames that wait to be retimed.
    #[doc(hidden)]
    pub fn waiting(&self) -> usize {
        self.track.retiming.as_ref().map_or(0, |retiming| retiming.frames.len())
    }

    /// Number of frames of the audio pushed so far.
    pub fn frames_of_audio(&self, config: &Config) -> usize {
        self.track.samples * config.frame_rate / config.audio.sample_rate
    }

    /// Writes the packet of the last [`Self::step`] into `out`, repeating up to `history` earlier keyframes; returns
    /// its length, or `None` if the step computed nothing. `layout` is that of its model, `stream` the
    /// number of the stream. Never allocates.
    ///
    /// # Errors
    /// [`StepError`] if `out` is shorter than the packet, or if the motion is retimed, which packets cannot
    /// represent.
    pub fn packet(
        &mut self,
        model: &Model,
        layout: &PacketLayout,
        (stream, history): (u8, usize),
        out: &mut [u8],
    ) -> Result<Option<usize>, StepError> {
        let Self { avatar, track, said, stepped, .. } = self;
        if track.retiming.is_some() {
            return Err(StepError::Order("packets cannot carry a retimed motion"));
        }
        said.write(avatar, model.config(), layout, *stepped, (stream, history), &track.levels, out)
    }

    /// Time spent in each stage so far.
    pub fn stage_times(&self) -> StageTimes {
        self.batch.stage_times()
    }

    /// Computes the next chunk if its audio has arrived, and passes every frame that became final to `frame`, in
    /// order. Returns whether there was a chunk, or frames held back at the end. Without audio, chunks are computed
    /// only after [`Self::finish`].
    ///
    /// # Errors
    /// [`StepError`]; the animation must then be created anew.
    pub fn step(&mut self, model: &Model, cx: Compute, frame: &mut dyn FnMut(FrameRef)) -> Result<bool, StepError> {
        let is_there = self.compute(model, cx, frame)?;
        let Self { avatar, track, said, stepped, recorder, .. } = self;
        if let Some(recorder) = recorder {
            recorder.packet(said, avatar, model.config(), *stepped, track)?;
        }
        Ok(is_there)
    }

    fn compute(&mut self, model: &Model, cx: Compute, frame: &mut dyn FnMut(FrameRef)) -> Result<bool, StepError> {
        let Self { avatar, batch, track, .. } = self;
        track.fill(avatar)?;
        let due = track.due(model, avatar);
        self.stepped = due;
        if due == Due::Nothing {
            return Ok(false);
        }
        batch.begin([due].into_iter())?;
        track.begin(avatar, due, model);
        let mut sink = |raw: FrameRef| track.take(raw, frame);
        loop {
            match batch.step(model, cx, std::slice::from_mut(avatar), &mut sink) {
                Ok(true) => {}
                Ok(false) => {
                    track.end(model, avatar, due, frame);
                    return Ok(true);
                }
                Err(error) => {
                    batch.abandon();
                    return Err(error);
                }
            }
        }
    }
}

impl Track {
    fn new(
        model: &Model,
        config: &AvatarConfig,
        avatar: &Avatar,
        (gains, gestures): (LayerGains, Gestures),
    ) -> Result<Self, LoadError> {
        let frame = model.rest().map_err(|error| LoadError::config("rest", error.to_string()))?;
        let Config { skeleton, face, frame_rate, .. } = model.config();
        let frame_rate = *frame_rate;
        let known = (gestures.clone(), WordRules::english());
        let stack = LayerStack::new((skeleton, face), frame_rate, &frame, config.sampler.seed, known);
        let controls = crate::playback::controls(&config.sampler, gains);
        let layers = Layers::new(stack, controls, (HINT_UNITS * frame_rate, frame_rate));
        Ok(Self {
            source: None,
            pending: Vec::new(),
            samples: 0,
            levels: Levels::new_in(avatar, model.config(), &Arena::system()),
            frame,
            layers: Arena::system().boxed(layers),
            gestures,
            frame_rate,
            retiming: None,
            log: None,
        })
    }

    /// Appends samples; returns how many were replaced by silence.
    fn push_audio(&mut self, samples: &[f32]) -> usize {
        let start = self.pending.len();
        self.pending.extend_from_slice(samples);
        self.samples += samples.len();
        silence_unusable(&mut self.pending[start..])
    }

    /// Asks the layers for something, from the next frame on.
    fn ask(&mut self, event: &Event) -> Result<(), SessionError> {
        let passed = self.layers.passed();
        let Layers { stack, controls, .. } = &mut *self.layers;
        let known = Known {
            gestures: &self.gestures,
            rules: stack.word_rules(),
            frame_rate: self.frame_rate,
            sample_rate: HINT_UNITS * self.frame_rate,
        };
        event.apply(controls, &known, (0, passed))?;
        if let Some(log) = &mut self.log {
            log.event(event);
        }
        Ok(())
    }

    /// Reads the samples of the next chunk from the source.
    fn fill(&mut self, avatar: &Avatar) -> Result<(), StepError> {
        while self.pending.len() < avatar.chunk_samples()
            && let Some(source) = &mut self.source
        {
            let start = self.pending.len();
            if !source.pull(&mut self.pending)? {
                self.source = None;
            }
            self.samples += self.pending.len() - start;
            silence_unusable(&mut self.pending[start..]);
        }
        Ok(())
    }

    /// Work that can be done now.
    fn due(&self, model: &Model, avatar: &Avatar) -> Due {
        let due = avatar.due(model.config(), self.pending.len());
        let endless = avatar.total.is_none() && !avatar.has_audio();
        if endless || !matches!(due, Due::Chunk | Due::Held | Due::Flush) { Due::Nothing } else { due }
    }

    /// Passes the next chunk's samples to the avatar.
    fn begin(&mut self, avatar: &mut Avatar, due: Due, model: &Model) {
        if matches!(due, Due::Chunk | Due::Held) {
            let count = avatar.chunk_samples().min(self.pending.len());
            let (here, ended) = avatar.samples_mut().split_at_mut(count);
            here.copy_from_slice(&self.pending[..count]);
            ended.fill(0.0);
            if let Some(log) = &mut self.log {
                log.hear(&self.pending[..count]);
            }
            self.pending.drain(..count);
            self.levels.push(avatar.samples_mut());
            self.levels.tell(avatar, model.config());
        }
    }

    /// Emits the decoders' next frame with its layers, or keeps it to be retimed.
    fn take(&mut self, raw: FrameRef, frame: &mut dyn FnMut(FrameRef)) {
        let cue = self.levels.cue(&raw);
        if let Some(log) = &mut self.log {
            log.frame(&cue, None);
        }
        match &mut self.retiming {
            None => frame(self.layered(raw, cue)),
            Some(retiming) => {
                let kept = OwnedFrame::new(*raw.pose, raw.face);
                retiming.frames.push(OwnedFrame { index: raw.index as u64, cue, ..kept });
            }
        }
    }

    /// Applies the layers to a frame of the decoders; returns `raw` itself if they are off.
    fn layered<'a>(&'a mut self, raw: FrameRef<'a>, cue: Cue) -> FrameRef<'a> {
        let Self { frame, layers, .. } = self;
        if layers.is_off() {
            layers.skip();
            return raw;
        }
        frame.take(raw.index as u64, (raw.pose, raw.face), cue, (HINT_UNITS * raw.index) as u64);
        layers.apply(frame);
        FrameRef { pose: &frame.pose, face: &frame.face, ..raw }
    }

    /// Ends a step: collects its audio units, and after the last step retimes and emits the waiting frames.
    fn end(&mut self, model: &Model, avatar: &Avatar, stepped: Due, frame: &mut dyn FnMut(FrameRef)) {
        let is_over = self.due(model, avatar) == Due::Nothing && avatar.total.is_some();
        let Some(retiming) = &mut self.retiming else { return };
        if matches!(stepped, Due::Chunk | Due::Held) {
            avatar.append_units(model.config(), &mut retiming.units);
        }
        if !is_over {
            return;
        }
        let Retiming { said, units, frames } = retiming;
        let config = model.config();
        let poses: Vec<_> = frames.iter().map(|kept| kept.pose).collect();
        let accents = retime::accents(config, *said, units);
        let map = TimeMap::new(poses.len(), config.frame_rate, &accents, &retime::turning_points(config, &poses));
        for (kept, pose) in std::mem::take(frames).into_iter().zip(retime::retimed(&poses, &map)) {
            #[expect(clippy::cast_possible_truncation, reason = "as many frames are in memory")]
            let index = kept.index as usize;
            let raw = FrameRef { index, pose: &pose, face: &kept.face, channels: PerPart::default() };
            frame(self.layered(raw, kept.cue));
        }
    }
}

/// Animations computed together, so that weights are read once for all. Each gives the same bits as alone (SPEC 2.9).
#[derive(Debug)]
pub struct Group {
    batch: Batch,
    avatars: Vec<Avatar>,
    tracks: Vec<Track>,
    recorders: Vec<Option<Recorder>>,
    due: Vec<Due>,
    said: PacketRoom,
}

/// Sink that applies each animation's own layers.
struct Layered<'a> {
    tracks: &'a mut [Track],
    frame: &'a mut dyn FnMut(usize, FrameRef),
}

impl umo_core_model::batch::FrameSink for Layered<'_> {
    fn frame(&mut self, member: usize, raw: FrameRef) {
        let Self { tracks, frame } = self;
        tracks[member].take(raw, &mut |shown| frame(member, shown));
    }
}

impl Group {
    /// Creates an empty group with room for `width` animations.
    ///
    /// # Panics
    /// If `width` is 0, or the model is of the mouth alone.
    pub fn new(model: &Model, width: usize) -> Self {
        Self {
            batch: Batch::new(model, width),
            avatars: Vec::new(),
            tracks: Vec::new(),
            recorders: Vec::new(),
            due: Vec::new(),
            said: PacketRoom::new(model.config(), &PacketLayout::new(model)),
        }
    }

    /// Number of animations.
    pub fn len(&self) -> usize {
        self.avatars.len()
    }

    /// Whether the group has no animations.
    pub fn is_empty(&self) -> bool {
        self.avatars.is_empty()
    }

    /// Whether the group has reached its width.
    pub fn is_full(&self) -> bool {
        self.len() == self.batch.width()
    }

    /// Appends an animation whose audio and end are complete.
    ///
    /// # Panics
    /// If the group is full.
    pub fn add(&mut self, animation: Animation) {
        assert!(!self.is_full(), "a group has room for no more than its width");
        self.avatars.push(animation.avatar);
        self.tracks.push(animation.track);
        self.recorders.push(animation.recorder);
    }

    /// Computes the next chunk of all, and passes the frames that became final with their animation's index. Returns
    /// the indices of those that failed, ascending; the caller must remove them.
    ///
    /// # Errors
    /// [`StepError`] if the batch cannot begin.
    pub fn step(
        &mut self,
        model: &Model,
        cx: Compute,
        frame: &mut dyn FnMut(usize, FrameRef),
    ) -> Result<Vec<(usize, StepError)>, StepError> {
        let Self { batch, avatars, tracks, recorders, due, said } = self;
        let mut failed = Vec::new();
        due.clear();
        for (member, (avatar, track)) in avatars.iter().zip(tracks.iter_mut()).enumerate() {
            due.push(match track.fill(avatar) {
                Ok(()) => track.due(model, avatar),
                Err(error) => {
                    failed.push((member, error));
                    Due::Nothing
                }
            });
        }
        batch.begin(due.iter().copied())?;
        for ((avatar, track), &due) in avatars.iter_mut().zip(tracks.iter_mut()).zip(due.iter()) {
            track.begin(avatar, due, model);
        }
        let mut sink = Layered { tracks, frame };
        loop {
            match batch.step(model, cx, avatars, &mut sink) {
                Ok(true) => {}
                Ok(false) => {
                    for (member, (track, avatar)) in tracks.iter_mut().zip(avatars.iter()).enumerate() {
                        if failed.iter().any(|&(other, _)| other == member) {
                            continue;
                        }
                        track.end(model, avatar, due[member], &mut |shown| frame(member, shown));
                        if let Some(recorder) = &mut recorders[member]
                            && let Err(error) = recorder.packet(said, avatar, model.config(), due[member], track)
                        {
                            failed.push((member, error));
                        }
                    }
                    failed.sort_by_key(|&(member, _)| member);
                    return Ok(failed);
                }
                Err(error) => failed.extend(batch.exclude().map(|member| (member, error))),
            }
        }
    }

    /// [`Animation::hint_words`] of an animation.
    ///
    /// # Errors
    /// As there.
    pub fn hint_words(&mut self, index: usize, text: &str, start: f64, end: f64) -> Result<(), SessionError> {
        self.tracks[index].ask(&Event::Words { text, start, end })
    }

    /// [`Animation::take`] of an animation.
    pub fn take(&self, index: usize) -> Option<Take> {
        self.recorders[index].as_ref()?.take(&self.tracks[index])
    }

    /// Whether all frames of an animation were emitted.
    pub fn is_done(&self, model: &Model, index: usize) -> bool {
        self.tracks[index].due(model, &self.avatars[index]) == Due::Nothing
    }

    /// Removes an animation; the last one takes its index.
    pub fn remove(&mut self, index: usize) {
        self.avatars.swap_remove(index);
        self.tracks.swap_remove(index);
        self.recorders.swap_remove(index);
    }
}

#[cfg(test)]
mod tests {
    use umo_core_base::team::Team;

    use super::*;

    #[test]
    fn a_recording_that_is_retimed_hears_every_unit_once_and_gives_every_frame() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/umo-people/model.safetensors");
        let model = Model::open(path.as_ref()).unwrap();
        let team = Team::new(1).unwrap();
        let cx = Compute { isa: model.isa(), team: &team };
        let syllable = |i: usize| if i % 4000 < 2500 { (i as f32 * 0.06).sin() * 0.3 } else { 0.0 };
        let samples: Vec<f32> = (0..40_000).map(syllable).collect();
        let (whole, _) = model.tokenizer().whole_file(cx, &samples).unwrap();
        for (target, horizon, lookahead) in [(5, 5, 9), (2, 1, 0), (3, 0, 4)] {
            let config = AvatarConfig { target, horizon, lookahead, ..AvatarConfig::new(model.config()) };
            let mut animation = Animation::new(&model, &config).unwrap();
            animation.retime(&model).unwrap();
            animation.push_audio(&samples).unwrap();
            animation.finish(75);
            let mut indices = Vec::new();
            while animation.step(&model, cx, &mut |frame| indices.push(frame.index)).unwrap() {
                assert!(indices.is_empty() || indices.len() == 75, "frames before the end");
                assert!(animation.packet(&model, &PacketLayout::new(&model), (0, 0), &mut [0; 4096]).is_err());
            }
            assert!(indices.into_iter().eq(0..75), "target {target}");
            let heard = &animation.track.retiming.as_ref().unwrap().units;
            // The recording is followed by silence.
            let count = whole.len().min(heard.len());
            assert!(count >= 120 && heard[..count] == whole[..count], "target {target}, horizon {horizon}");
            assert!(matches!(animation.retime(&model), Err(StepError::Order(_))));
        }
    }
}
