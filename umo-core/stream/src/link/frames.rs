//! Queue of frames from the engine to the host.

use umo_core_base::memory::Arena;
use umo_core_base::state::{StateError, StatePass, is_moderate, is_near, is_sample, is_unit};
use umo_core_pose::frame::{Cue, MAX_INDEX, MAX_SAMPLE, OwnedFrame};
use umo_core_pose::pose::Pose;
use umo_core_pose::skeleton::JOINTS;

use super::ring::Ring;

/// Words of a stamp.
const HEAD: usize = 5;
/// Words before a frame's pose: its stamp and its cue.
const POSE: usize = HEAD + 8;
/// Words before a frame's face values.
const FACE: usize = POSE + 4 * JOINTS + 3;

/// Identifies a frame within the session's streams.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Stamp {
    /// Number of the frame's epoch.
    pub(crate) epoch: u32,
    /// Index in the stream.
    pub(crate) index: u64,
    /// Sample frame of the stream's audio that the frame belongs to.
    pub sample: u64,
}

impl Stamp {
    #[expect(clippy::cast_possible_truncation, reason = "the two halves")]
    fn words(self) -> [u32; HEAD] {
        let Self { epoch, index, sample } = self;
        [epoch, index as u32, (index >> 32) as u32, sample as u32, (sample >> 32) as u32]
    }

    fn of([epoch, index, index_high, sample, sample_high]: [u32; HEAD]) -> Self {
        let whole = |low: u32, high: u32| u64::from(low) | u64::from(high) << 32;
        Self { epoch, index: whole(index, index_high), sample: whole(sample, sample_high) }
    }
}

/// Wait-free queue of frames with one producer and one consumer.
#[derive(Debug)]
pub(crate) struct FrameRing {
    words: Ring,
    /// Words per frame.
    width: usize,
}

impl FrameRing {
    /// Creates an empty ring for `capacity` frames, in memory of `arena`.
    pub(crate) fn new_in(capacity: usize, face_values: usize, arena: &Arena) -> Self {
        let width = FACE + face_values;
        Self { words: Ring::new_in(capacity * width, arena), width }
    }

    pub(crate) fn capacity(&self) -> usize {
        self.words.capacity() / self.width
    }

    /// Number of frames that wait for the consumer.
    pub(crate) fn len(&self) -> usize {
        self.words.len() / self.width
    }

    /// Number of frames that the producer can write.
    pub(crate) fn room(&self) -> usize {
        self.words.room() / self.width
    }

    /// Producer: appends a frame if there is room; returns whether there was.
    pub(crate) fn push(&self, stamp: Stamp, cue: Cue, pose: &Pose, face: &[f32]) -> bool {
        let cue = [cue.level, cue.arousal, cue.onset, cue.prompted].into_iter().chain(cue.contacts);
        let values = pose.rotations.as_flattened().iter().chain(&pose.translation).chain(face);
        let words = stamp.words().into_iter().chain(cue.chain(values.copied()).map(f32::to_bits));
        self.words.room() >= self.width && self.words.push_some(self.width, words) == self.width
    }

    /// Consumer: returns the oldest frame's stamp.
    pub(crate) fn next(&self) -> Option<Stamp> {
        let mut words = [0; HEAD];
        (self.words.peek(&mut words) == HEAD).then(|| Stamp::of(words))
    }

    /// Consumer: moves the oldest frame's pose, face and cue to `frame`; returns whether there was
    /// one.
    pub(crate) fn pop(&self, frame: &mut OwnedFrame) -> bool {
        if self.len() == 0 {
            return false;
        }
        let OwnedFrame { pose, face, cue, .. } = frame;
        let mut values = [&mut cue.level, &mut cue.arousal, &mut cue.onset, &mut cue.prompted]
            .into_iter()
            .chain(&mut cue.contacts)
            .chain(pose.rotations.as_flattened_mut().iter_mut().chain(&mut pose.translation).chain(face.iter_mut()));
        self.words.peek_range(HEAD..self.width, |word| {
            if let Some(value) = values.next() {
                *value = f32::from_bits(word);
            }
        });
        self.skip();
        true
    }

    /// Consumer: drops the oldest frame.
    pub(crate) fn skip(&self) {
        self.words.skip(self.width);
    }

    /// Position after the last frame.
    pub(crate) fn written(&self) -> u64 {
        self.words.written()
    }

    /// Number of frames between two positions.
    pub(crate) fn count(&self, from: u64, to: u64) -> u64 {
        to.saturating_sub(from) / self.width as u64
    }

    /// Describes the waiting frames; returns the position after the last of them.
    pub(crate) fn state(&self, pass: &mut StatePass) -> Result<u64, StateError> {
        let are_frames = |words: &[[u8; 4]]| {
            let mut frames = words.chunks_exact(self.width);
            let are_known = frames.all(|frame| {
                let stamp = Stamp::of(std::array::from_fn(|at| u32::from_le_bytes(frame[at])));
                let value = |word: [u8; 4]| f32::from_le_bytes(word);
                let (head, values) = frame[HEAD..].split_at(POSE - HEAD);
                let (rotations, rest) = values.split_at(4 * JOINTS);
                let mut rotations = rotations.as_chunks::<4>().0.iter();
                stamp.index <= MAX_INDEX
                    && stamp.sample <= MAX_SAMPLE
                    && is_sample(value(head[0]))
                    && head[1..].iter().chain(&rest[3..]).all(|&word| is_moderate(value(word)))
                    && rotations.all(|q| is_unit(q.map(value)))
                    && rest[..3].iter().all(|&word| is_near(value(word)))
            });
            are_known && words.len().is_multiple_of(self.width)
        };
        let waiting = self.words.state(pass, "waiting frames", None, are_frames)?;
        Ok(self.words.read_position() + waiting as u64)
    }
}
