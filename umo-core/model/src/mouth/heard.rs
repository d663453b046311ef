//! The mouth of an avatar's frames from their own sound: the second head of the live mouth's network, which has heard
//! what follows (SPEC 2.10).
//!
//! ```text
//! samples of the chunk ──► mouth network ──► mouth of frame n ─┐
//! motion decoders ───────────────────────────► frame n ────────┴─► frame n
//! ```

use std::ops::Range;

use umo_core_base::error::StepError;
use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{axis_angle_to_quat, slerp};
use umo_core_pose::skeleton::JAW;
use umo_kernels::Isa;

use super::{Mouth, MouthStream};
use crate::motion::FrameRef;

/// Rotation of the jaw at a jawOpen of 1, radians: that of the default model's performer.
pub const JAW_OPEN: f32 = 0.35;
/// Share of the remaining way to rest that the mouth moves in each frame after the last sound.
pub const TO_REST: f32 = 0.3;
/// Share of the way between the two heads in one frame.
const FADE: f32 = 0.25;
/// The default model's decoders smile less than this in vowels without a mood.
const VOWEL_SMILE: f32 = 0.15;
/// Steps of a channel from 0 to 1: what a packet says of it is exact.
const STEPS: f32 = 255.0;
/// Upper bound on the number of frames in a valid state.
const MAX_FRAMES: u64 = 1 << 50;

/// The mouth of one avatar's frames.
#[derive(Debug)]
pub(crate) struct HeardMouth {
    stream: MouthStream,
    /// Whether the stream begins with the next samples.
    is_new: bool,
    behind: u64,
    /// One more than the last frame of the first head.
    known: u64,
    /// `[room, channels]` of each head: the mouth of frame `index`, at `index % room`.
    now: Slice<f32>,
    later: Slice<f32>,
    room: u64,
    /// Weight of the second head in the last frame.
    weight: f32,
    /// The mouth of the last frame: `[channels]`.
    last: Slice<f32>,
    /// `[said_room, channels]`: the same in steps of frame `index`, at `index % said_room`.
    said: Slice<u8>,
    said_room: u64,
    /// Frames of the last chunk; `None` before its first.
    chunk: Option<(u64, u64)>,
    over: MouthOver,
}

/// Puts a mouth over frames.
#[derive(Debug)]
pub struct MouthOver {
    /// Indices of jawOpen, and of the corners' smile, among the mouth's channels.
    jaw: Option<usize>,
    smiles: [Option<usize>; 2],
    pose: Pose,
    face: Slice<f32>,
}

impl MouthOver {
    /// Creates it for a model's mouth and the names of the face's values.
    pub fn new_in(mouth: &Mouth, names: &[String], face_values: usize, arena: &Arena) -> Self {
        let at = |name: &str| mouth.channels().iter().position(|&channel| names[channel] == name);
        Self {
            jaw: at("jawOpen"),
            smiles: [at("mouthSmileLeft"), at("mouthSmileRight")],
            pose: Pose::REST,
            face: arena.filled(0.0, face_values),
        }
    }

    /// Returns a frame with the mouth `said`, a byte for each channel, 255 for 1. With a `share` below 1 it is between
    /// the frame's own and that.
    pub fn put(&mut self, mouth: &Mouth, frame: &FrameRef, said: &[u8], share: f32) -> (&Pose, &[f32]) {
        self.face.copy_from_slice(frame.face);
        self.pose = *frame.pose;
        for (i, (&channel, &said)) in mouth.channels().iter().zip(said).enumerate() {
            let (own, value) = (frame.face[channel], f32::from(said) / STEPS);
            // The network does not know the smile of a mood.
            let value = if self.smiles.contains(&Some(i)) { value.max(of_mood(own)) } else { value };
            self.face[channel] = if share < 1.0 { own + share * (value - own) } else { value };
        }
        if let Some(jaw) = self.jaw {
            let open = axis_angle_to_quat([JAW_OPEN * f32::from(said[jaw]) / STEPS, 0.0, 0.0]);
            let own = frame.pose.rotations[JAW];
            self.pose.rotations[JAW] = if share < 1.0 { slerp(own, open, share) } else { open };
        }
        (&self.pose, &self.face)
    }
}

/// The part of a smile above that of vowels.
fn of_mood(smile: f32) -> f32 {
    smile * (smile / VOWEL_SMILE - 1.0).clamp(0.0, 1.0)
}

/// A channel's value in steps.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
fn steps(value: f32) -> u8 {
    (STEPS * value).round().clamp(0.0, STEPS) as u8
}

impl HeardMouth {
    /// `None` if the network has no second head. `chunk`: frames that an avatar hears before their frames are taken, and
    /// no fewer than a chunk makes final.
    pub(crate) fn new_in(
        mouth: &Mouth,
        names: &[String],
        (chunk, face_values): (usize, usize),
        arena: &Arena,
    ) -> Option<Self> {
        let (behind, channels) = (mouth.behind()?, mouth.channels().len());
        let room = chunk + behind + 2;
        Some(Self {
            stream: MouthStream::new_in(mouth, arena),
            is_new: false,
            behind: behind as u64,
            known: 0,
            now: arena.filled(0.0, room * channels),
            later: arena.filled(0.0, room * channels),
            room: room as u64,
            weight: 1.0,
            last: arena.copied(mouth.rest()),
            said: arena.filled(0, chunk * channels),
            said_room: chunk as u64,
            chunk: None,
            over: MouthOver::new_in(mouth, names, face_values, arena),
        })
    }

    /// Returns to the start of a stream.
    pub(crate) fn reset(&mut self) {
        (self.is_new, self.known, self.weight, self.chunk) = (true, 0, 1.0, None);
    }

    /// Begins a chunk's frames.
    pub(crate) fn begin(&mut self) {
        self.chunk = None;
    }

    /// The last chunk's frames.
    pub(crate) fn chunk(&self) -> Range<u64> {
        self.chunk.map_or(0..0, |(first, end)| first..end)
    }

    /// The mouth of one of the last chunk's frames, a byte for each channel.
    pub(crate) fn said(&self, index: u64) -> &[u8] {
        let width = self.last.len();
        &self.said[slot(index, self.said_room) * width..][..width]
    }

    /// Hears the next chunk's samples.
    pub(crate) fn hear(&mut self, mouth: &Mouth, isa: Isa, samples: &[f32]) -> Result<(), StepError> {
        let Self { stream, is_new, behind, known, now, later, room, last, .. } = self;
        if *is_new {
            stream.reset(mouth);
            last.copy_from_slice(mouth.rest());
            *is_new = false;
        }
        let width = mouth.channels().len();
        stream.push(mouth, isa, samples, |heard| {
            let at = slot(heard.index, *room) * width;
            now[at..][..width].copy_from_slice(heard.channels);
            if !heard.later.is_empty() {
                let at = slot(heard.index - *behind, *room) * width;
                later[at..][..width].copy_from_slice(heard.later);
            }
            *known = heard.index + 1;
        })
    }

    /// Returns the next frame with its mouth.
    pub(crate) fn put(&mut self, mouth: &Mouth, frame: &FrameRef) -> (&Pose, &[f32]) {
        let (index, width) = (frame.index as u64, self.last.len());
        let at = slot(index, self.room) * width;
        if index < self.known {
            // Frames whose second head is known, from this one on.
            let more = self.known.saturating_sub(self.behind + index);
            #[expect(clippy::cast_precision_loss, reason = "at most a chunk")]
            let wanted = (FADE * more as f32).min(1.0);
            self.weight = wanted.clamp(self.weight - FADE, self.weight + FADE);
            let heads = self.now[at..][..width].iter().zip(&self.later[at..][..width]);
            for (value, (now, later)) in self.last.iter_mut().zip(heads) {
                *value = if more > 0 { now + self.weight * (later - now) } else { *now };
            }
        } else {
            self.last.iter_mut().zip(mouth.rest()).for_each(|(value, rest)| *value += TO_REST * (rest - *value));
        }
        let said = &mut self.said[slot(index, self.said_room) * width..][..width];
        said.iter_mut().zip(&*self.last).for_each(|(said, &value)| *said = steps(value));
        self.chunk = Some((self.chunk.map_or(index, |(first, _)| first), index + 1));
        self.over.put(mouth, frame, said, 1.0)
    }

    /// Describes it.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.stream.state(pass)?;
        pass.switch("mouth", &mut self.is_new)?;
        pass.number("mouth", &mut self.known, MAX_FRAMES)?;
        pass.moderate(&mut self.now)?;
        pass.moderate(&mut self.later)?;
        pass.share(&mut self.weight)?;
        pass.moderate(&mut self.last)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "below the room")]
fn slot(index: u64, room: u64) -> usize {
    (index % room) as usize
}

#[cfg(test)]
mod tests {
    use super::of_mood;

    #[test]
    fn a_smile_of_vowels_is_the_network_s_and_one_of_a_mood_stays() {
        assert!([0.0, 0.05, 0.15].iter().all(|&smile| of_mood(smile) == 0.0));
        assert!([0.3, 0.5, 1.0].iter().all(|&smile| of_mood(smile) == smile));
        let rising: Vec<f32> = (0..=100_u8).map(|step| of_mood(f32::from(step) / 100.0)).collect();
        assert!(rising.is_sorted() && rising.windows(2).all(|pair| pair[1] - pair[0] < 0.04));
    }
}
