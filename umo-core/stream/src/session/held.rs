//! The mouth of chunks whose body holds its pose because the engine cannot keep up (SPEC 2.9). It
//! comes from the live mouth's network, which costs a fraction of a chunk.
//!
//! ```text
//! samples of the chunk ──► mouth network ──► mouth of frame n ─┐
//! motion decoders ───────────────────────────► frame n ────────┴─► frame n
//! ```

use std::ops::Range;
use std::sync::Arc;

use umo_core_base::error::StepError;
use umo_core_base::memory::{Arena, Slice};
use umo_core_model::avatar::Avatar;
use umo_core_model::config::Config;
use umo_core_model::model::Model;
use umo_core_model::motion::FrameRef;
use umo_core_model::mouth::{JAW_OPEN, MouthStream, TO_REST};
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{axis_angle_to_quat, slerp};
use umo_core_pose::skeleton::JAW;

/// Share of the blend between the two mouths that one frame advances, so that neither jumps.
const FADE: f32 = 0.25;
/// Frames that the network may be ahead of the chunk.
const AHEAD: usize = 32;

/// The mouth network's state in one session.
#[derive(Debug)]
pub(super) struct HeldMouth {
    model: Arc<Model>,
    stream: MouthStream,
    /// Whether the stream has heard the previous chunk.
    listens: bool,
    /// Frame of the chunk's first sample, if the chunk is still to be heard.
    awaited: Option<u64>,
    /// Frame of the session at which the stream began.
    start: u64,
    /// One more than the last frame whose mouth is known.
    known: u64,
    /// `[room, channels]`: the mouth of frame `index`, at `index % room`.
    mouths: Slice<f32>,
    /// `[room]`: whether the frame's body is held.
    held: Slice<bool>,
    /// `[channels]`: the mouth shown last.
    last: Slice<f32>,
    /// Blend weight of that mouth in the frame shown last.
    weight: f32,
    /// Index of jawOpen in it.
    jaw: Option<usize>,
    pose: Pose,
    face: Slice<f32>,
}

impl HeldMouth {
    /// `None` if the model has no mouth network.
    pub(super) fn new_in(model: &Arc<Model>, avatar: &Avatar, face_values: usize, arena: &Arena) -> Option<Self> {
        let (mouth, config) = (model.mouth()?, model.config());
        let channels = mouth.channels().len();
        let chunk = avatar.target * config.keyframe_stride + avatar.horizon_frames(config);
        let room = 2 * chunk + avatar.lookahead + AHEAD;
        let jaw_open = config.face.names.iter().position(|name| name == "jawOpen");
        Some(Self {
            stream: MouthStream::new_in(mouth, arena),
            listens: false,
            awaited: None,
            start: 0,
            known: 0,
            mouths: arena.filled(0.0, room * channels),
            held: arena.filled(false, room),
            last: arena.copied(mouth.rest()),
            weight: 0.0,
            jaw: mouth.channels().iter().position(|&channel| Some(channel) == jaw_open),
            pose: Pose::REST,
            face: arena.filled(0.0, face_values),
            model: Arc::clone(model),
        })
    }

    /// Returns to the start of a stream.
    pub(super) fn reset(&mut self) {
        (self.listens, self.awaited, self.start, self.known, self.weight) = (false, None, 0, 0, 0.0);
        self.held.fill(false);
    }

    /// Begins a chunk with frames `frames`, held or not. With `hears`, its samples are to be heard,
    /// and the first belongs to that frame.
    pub(super) fn begin(&mut self, frames: Range<u64>, held: bool, hears: Option<u64>) {
        self.awaited = hears;
        self.listens &= hears.is_some();
        for index in frames {
            let slot = self.slot(index);
            self.held[slot] = held;
        }
    }

    /// Whether the chunk's samples are still to be heard.
    pub(super) fn awaits(&self) -> bool {
        self.awaited.is_some()
    }

    /// Hears the chunk's samples, if they are still to be heard.
    pub(super) fn hear(&mut self, samples: &[f32]) -> Result<(), StepError> {
        let Self { model, stream, listens, awaited, start, known, mouths, held, .. } = self;
        let (Some(mouth), Some(frame)) = (model.mouth(), awaited.take()) else { return Ok(()) };
        if !*listens {
            stream.reset(mouth);
            (*listens, *start, *known) = (true, frame, frame);
        }
        let (width, room) = (mouth.channels().len(), held.len() as u64);
        stream.push(mouth, model.isa(), samples, |heard| {
            let index = *start + heard.index;
            #[expect(clippy::cast_possible_truncation, reason = "below the room")]
            let slot = (index % room) as usize;
            mouths[slot * width..][..width].copy_from_slice(heard.channels);
            *known = index + 1;
        })
    }

    /// Returns the frame with the mouth that was heard, if its body is held or was a moment ago.
    pub(super) fn put(&mut self, frame: &FrameRef) -> Option<(&Pose, &[f32])> {
        let (index, mouth) = (frame.index as u64, self.model.mouth()?);
        let slot = self.slot(index);
        let step = if self.held[slot] { FADE } else { -FADE };
        self.weight = (self.weight + step).clamp(0.0, 1.0);
        if self.weight == 0.0 {
            return None;
        }
        let width = self.last.len();
        if (self.start..self.known).contains(&index) && self.known - index <= self.held.len() as u64 {
            self.last.copy_from_slice(&self.mouths[slot * width..][..width]);
        } else {
            self.last.iter_mut().zip(mouth.rest()).for_each(|(value, rest)| *value += TO_REST * (rest - *value));
        }
        self.face.copy_from_slice(frame.face);
        for (&channel, &value) in mouth.channels().iter().zip(&*self.last) {
            self.face[channel] += self.weight * (value - self.face[channel]);
        }
        self.pose = *frame.pose;
        if let Some(jaw) = self.jaw {
            let open = axis_angle_to_quat([JAW_OPEN * self.last[jaw], 0.0, 0.0]);
            self.pose.rotations[JAW] = slerp(self.pose.rotations[JAW], open, self.weight);
        }
        Some((&self.pose, &self.face))
    }

    #[expect(clippy::cast_possible_truncation, reason = "below the room")]
    fn slot(&self, index: u64) -> usize {
        (index % self.held.len() as u64) as usize
    }
}

/// Range of frames that the avatar's next chunk makes known.
pub(super) fn next_frames(avatar: &Avatar, config: &Config) -> Range<u64> {
    avatar.known_frames(config, avatar.chunk) as u64..avatar.known_frames(config, avatar.chunk + 1) as u64
}
