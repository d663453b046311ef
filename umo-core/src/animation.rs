//! One avatar computed where and when the caller wants it: recordings, tests. The stream of a game
//! is an [`Engine`](crate::engine::Engine).

use crate::audio::silence_unusable;
use crate::avatar::{Avatar, AvatarConfig, Due, StageTimes};
use crate::batch::Batch;
use crate::config::Config;
use crate::error::{LoadError, StepError};
use crate::life::gesture::Request;
use crate::life::{Controls, GestureOptions, Gestures, Levels, Life};
use crate::linear::Compute;
use crate::memory::{Arena, Boxed};
use crate::model::Model;
use crate::motion::FrameRef;
use crate::packet::{PacketLayout, PacketRoom};
use crate::record::Chunk;
use crate::session::SessionError;
use crate::stream::OwnedFrame;

/// One avatar, its audio, and room to compute its chunks.
#[derive(Debug)]
pub struct Animation {
    avatar: Avatar,
    batch: Batch,
    /// Samples that no chunk has used yet.
    pending: Vec<f32>,
    /// Samples pushed in all.
    samples: usize,
    layers: Boxed<Layers>,
    gestures: Gestures,
    frame_rate: usize,
    /// What the last step computed.
    stepped: Due,
    /// Room for a packet's levels and codes.
    said: PacketRoom,
}

/// The layers over the decoders' frames, and the frame that they change.
#[derive(Debug)]
struct Layers {
    levels: Levels,
    life: Life,
    controls: Controls,
    frame: OwnedFrame,
}

impl Layers {
    fn new(model: &Model, config: &AvatarConfig, avatar: &Avatar) -> Result<Self, LoadError> {
        let frame = model.rest().map_err(|error| LoadError::config("rest", error.to_string()))?;
        Ok(Self {
            levels: Levels::new_in(avatar, &model.config, &Arena::system()),
            life: Life::new(&model.config, &frame, config.sampler.seed, config.gestures.clone()),
            controls: Controls::new(config.life),
            frame,
        })
    }

    /// The decoders' next frame with its layers.
    fn apply<'a>(&'a mut self, frame: FrameRef<'a>) -> FrameRef<'a> {
        let Self { levels, life, controls, frame: shown } = self;
        if life.is_off(controls) {
            return frame;
        }
        shown.index = frame.index as u64;
        shown.pose = *frame.pose;
        shown.face.copy_from_slice(frame.face);
        shown.cue = levels.cue(&frame);
        life.apply(shown, controls, 0.0);
        FrameRef { pose: &shown.pose, face: &shown.face, ..frame }
    }
}

impl Animation {
    /// An animation at its start.
    ///
    /// # Errors
    /// [`LoadError::Config`] where the template is missing or a number is out of range.
    pub fn new(model: &Model, config: &AvatarConfig) -> Result<Self, LoadError> {
        let avatar = Avatar::new(model, config)?;
        Ok(Self {
            layers: Arena::system().boxed(Layers::new(model, config, &avatar)?),
            avatar,
            batch: Batch::new(model, 1),
            pending: Vec::new(),
            samples: 0,
            gestures: config.gestures.clone(),
            frame_rate: model.config.frame_rate,
            stepped: Due::Nothing,
            said: PacketRoom::new(&model.config),
        })
    }

    /// The avatar.
    #[cfg(feature = "internals")]
    pub fn avatar(&self) -> &Avatar {
        &self.avatar
    }

    /// The avatar, to be set up.
    #[cfg(feature = "internals")]
    pub fn avatar_mut(&mut self) -> &mut Avatar {
        &mut self.avatar
    }

    /// Keeps from now on what each chunk was made of, for [`Self::chunk`]. Nothing else changes.
    #[cfg(feature = "internals")]
    pub fn keep_record(&mut self, config: &Config) {
        self.batch.keep_record(config);
    }

    /// Units and codes of the last [`Self::step`]'s chunk; none if it had no chunk or no record is
    /// kept.
    #[cfg(feature = "internals")]
    pub fn chunk(&self) -> Option<Chunk<'_>> {
        self.batch.chunk()
    }

    /// Takes mono samples at the model's rate. Returns how many became silence because they were NaN,
    /// infinite or beyond [`MAX_AMPLITUDE`](crate::MAX_AMPLITUDE).
    ///
    /// # Errors
    /// [`StepError::Order`] after [`Self::finish`].
    pub fn push_audio(&mut self, samples: &[f32]) -> Result<usize, StepError> {
        if self.avatar.total.is_some() {
            return Err(StepError::Order("audio was pushed after the end"));
        }
        let start = self.pending.len();
        self.pending.extend_from_slice(samples);
        self.samples += samples.len();
        Ok(silence_unusable(&mut self.pending[start..]))
    }

    /// No more audio: the stream ends after `frames` frames.
    pub fn finish(&mut self, frames: usize) {
        self.avatar.finish(frames);
    }

    /// Plays a gesture over what the model does, as
    /// [`Session::play_gesture`](crate::Session::play_gesture): from the next frame on or at a time
    /// of the motion.
    ///
    /// # Errors
    /// [`SessionError::UnknownGesture`], [`SessionError::GesturesFull`] where
    /// [`MAX_PENDING_GESTURES`](crate::MAX_PENDING_GESTURES) wait, [`SessionError::Range`] where an
    /// option is out of its range.
    pub fn play_gesture(&mut self, name: &str, options: &GestureOptions) -> Result<(), SessionError> {
        let request = Request::new(&self.gestures, name, options, self.frame_rate, 0)?;
        let Layers { life, controls, .. } = &mut *self.layers;
        controls.gestures.push(request, life.begun_gestures())
    }

    /// Frames of the audio pushed so far.
    pub fn frames_of_audio(&self, config: &Config) -> usize {
        self.samples * config.frame_rate / config.audio.sample_rate
    }

    /// Writes the packet of the last [`Self::step`] into `out`, with up to `history` keyframes before
    /// its own said again; its length, or none where the last step computed nothing. `layout` is
    /// [`Model::packets`] of its model, `stream` a number that tells streams apart. Never allocates.
    ///
    /// # Errors
    /// [`StepError`] where `out` is shorter than the packet.
    pub fn packet(
        &mut self,
        model: &Model,
        layout: &PacketLayout,
        (stream, history): (u8, usize),
        out: &mut [u8],
    ) -> Result<Option<usize>, StepError> {
        let Self { avatar, layers, said, stepped, .. } = self;
        said.write(avatar, &model.config, layout, *stepped, (stream, history), &layers.levels, out)
    }

    /// Time spent in each stage so far.
    pub fn stage_times(&self) -> StageTimes {
        self.batch.stage_times()
    }

    /// Computes the next chunk if its audio is there, and gives every frame that became final to
    /// `frame`, in order. Returns whether there was one, or frames that were held back at the end.
    /// A stream without audio has chunks only once its end is known.
    ///
    /// # Errors
    /// [`StepError`], after which the animation wants a new start.
    pub fn step(&mut self, model: &Model, cx: Compute, frame: &mut dyn FnMut(FrameRef)) -> Result<bool, StepError> {
        let Self { avatar, batch, pending, layers, .. } = self;
        let due = avatar.due(&model.config, pending.len());
        let endless = avatar.total.is_none() && !avatar.has_audio();
        if endless || !matches!(due, Due::Chunk | Due::Flush) {
            self.stepped = Due::Nothing;
            return Ok(false);
        }
        batch.begin([due].into_iter())?;
        self.stepped = due;
        if due == Due::Chunk {
            let count = avatar.chunk_samples().min(pending.len());
            let (here, ended) = avatar.samples_mut().split_at_mut(count);
            here.copy_from_slice(&pending[..count]);
            ended.fill(0.0);
            pending.drain(..count);
            layers.levels.push(avatar.samples_mut());
        }
        let mut sink = |raw: FrameRef| frame(layers.apply(raw));
        loop {
            match batch.step(model, cx, std::slice::from_mut(avatar), &mut sink) {
                Ok(true) => {}
                Ok(false) => return Ok(true),
                Err(error) => {
                    batch.abandon();
                    return Err(error);
                }
            }
        }
    }
}
