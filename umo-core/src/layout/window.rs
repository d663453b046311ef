//! The window in layout `frames`: the codes of `P` keyframes of history and `N` new ones, and the
//! vectors of all frames (SPEC 2.13, 2.14).

use std::ops::Range;

use crate::config::{Config, MAX_PARTS};
use crate::error::StepError;
use crate::memory::{Arena, Slice};
use crate::motion::Latents;
use crate::motion::vq::VqDecoder;
use crate::state::{StateError, StatePass};

/// Codes and vectors of one session's window.
#[derive(Debug)]
pub(crate) struct Keyframes {
    /// `[P + N, codes of a keyframe]`, oldest first.
    codes: Slice<u16>,
    /// `[(P + N - 1) * stride + 1, width]` of each part with channels.
    vectors: Slice<Slice<f32>>,
    /// Whether a frame is a keyframe.
    known: Slice<bool>,
    /// Range of each part's codes within a keyframe, and the width of its vectors; only parts with channels.
    parts: Slice<(Range<usize>, usize)>,
    /// Exclusive upper bound of each code of a keyframe.
    limits: Slice<usize>,
    /// Rest codes.
    rest: Slice<u16>,
    prefix: usize,
    target: usize,
    stride: usize,
}

impl Keyframes {
    /// Creates a history of rest codes.
    #[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
    pub(crate) fn new_in(config: &Config, target: usize, arena: &Arena) -> Self {
        let (prefix, stride) = (config.prefix, config.keyframe_stride);
        let frames = (prefix + target - 1) * stride + 1;
        let parts = config.parts.as_deref().unwrap_or_default();
        let moving = parts.iter().filter(|part| !part.is_annotation());
        let count = config.codes_per_keyframe();
        let rest = || parts.iter().flat_map(|part| part.rest.iter().map(|&code| code as u16));
        let limits = parts.iter().flat_map(|part| std::iter::repeat_n(part.codes, part.levels));
        let mut first = 0;
        let places = parts.iter().map(|part| {
            first += part.levels;
            (part, first - part.levels..first)
        });
        let moving_places = places.filter(|(part, _)| !part.is_annotation()).map(|(part, range)| (range, part.width));
        Self {
            codes: arena.collect_len((prefix + target) * count, rest().cycle()),
            vectors: arena
                .collect_len(moving.clone().count(), moving.clone().map(|part| arena.filled(0.0, frames * part.width))),
            known: arena.collect((0..frames).map(|frame| frame.is_multiple_of(stride))),
            parts: arena.collect_len(moving.clone().count(), moving_places),
            limits: arena.collect_len(count, limits),
            rest: arena.collect_len(count, rest()),
            prefix,
            target,
            stride,
        }
    }

    fn count(&self) -> usize {
        self.rest.len()
    }

    /// Resets the history to rest codes.
    pub(crate) fn rest(&mut self) {
        self.codes.chunks_exact_mut(self.rest.len()).for_each(|codes| codes.copy_from_slice(&self.rest));
    }

    /// Replaces the history by the last of `codes [T, codes of a keyframe]`.
    pub(crate) fn set(&mut self, codes: &[u16]) -> Result<(), StepError> {
        let count = self.count();
        let Some(first) = codes.get(..count) else { return Err(StepError::Empty("codes of history")) };
        if !codes.len().is_multiple_of(count) {
            return Err(StepError::Disagree("codes of history of no whole number of keyframes"));
        }
        for (&code, &limit) in codes.iter().zip(self.limits.iter().cycle()) {
            if usize::from(code) >= limit {
                return Err(StepError::OutOfRange { what: "code", got: code.into(), limit });
            }
        }
        let last = &codes[codes.len().saturating_sub(self.prefix * count)..];
        let (pad, rest) = self.codes[..self.prefix * count].split_at_mut(self.prefix * count - last.len());
        pad.chunks_exact_mut(count).for_each(|codes| codes.copy_from_slice(first));
        rest.copy_from_slice(last);
        Ok(())
    }

    /// Describes the history. Each chunk writes the new keyframes and the vectors before it reads them.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let count = self.limits.len();
        for codes in self.codes[..self.prefix * count].chunks_exact_mut(count) {
            for (code, &limit) in codes.iter_mut().zip(&self.limits) {
                pass.codes(std::slice::from_mut(code), limit)?;
            }
        }
        Ok(())
    }

    /// The history's keyframes, oldest first.
    pub(crate) fn prefix(&self) -> impl ExactSizeIterator<Item = &[u16]> {
        self.codes.chunks_exact(self.count()).take(self.prefix)
    }

    /// A new keyframe.
    pub(crate) fn target(&self, keyframe: usize) -> &[u16] {
        &self.codes[(self.prefix + keyframe) * self.count()..][..self.count()]
    }

    /// The keyframe before a new one.
    pub(crate) fn before(&self, keyframe: usize) -> &[u16] {
        &self.codes[(self.prefix + keyframe - 1) * self.count()..][..self.count()]
    }

    /// The codes of all new keyframes.
    pub(crate) fn targets(&self) -> &[u16] {
        &self.codes[self.prefix * self.count()..]
    }

    /// Writes a new keyframe.
    pub(crate) fn write(&mut self, keyframe: usize, codes: &[u16]) {
        let count = self.count();
        self.codes[(self.prefix + keyframe) * count..][..count].copy_from_slice(codes);
    }

    /// Sets the new keyframes to the last one of the history.
    pub(crate) fn hold(&mut self) {
        let (count, first) = (self.count(), self.prefix * self.count());
        let (history, new) = self.codes.split_at_mut(first);
        new.chunks_exact_mut(count).for_each(|codes| codes.copy_from_slice(&history[first - count..]));
    }

    /// Writes the keyframes' vectors to their frames.
    pub(crate) fn lay_out(&mut self, decoders: &[VqDecoder]) -> Result<(), StepError> {
        let count = self.count();
        for (((range, width), vectors), decoder) in self.parts.iter().zip(&mut self.vectors).zip(decoders) {
            let rows = vectors.chunks_exact_mut(*width).step_by(self.stride);
            for (codes, row) in self.codes.chunks_exact(count).zip(rows) {
                decoder.codebook().vector(&codes[range.clone()], row)?;
            }
        }
        Ok(())
    }

    /// The vectors of the window's frames, mutable, and which frames are known.
    pub(crate) fn frames(&mut self) -> (&mut [Slice<f32>], &[bool]) {
        (&mut self.vectors, &self.known)
    }

    /// Vectors of the frames that this chunk made known: those after the last keyframe of the history, or in the
    /// first chunk from frame 0. Returns one entry per part, and the number of parts.
    pub(crate) fn fresh(&self, first: bool) -> ([Latents<'_>; MAX_PARTS], usize) {
        let start = self.known.len() - self.fresh_frames(first);
        let mut latents = [Latents::Vectors(&[]); MAX_PARTS];
        for ((latents, vectors), (_, width)) in latents.iter_mut().zip(&self.vectors).zip(&self.parts) {
            *latents = Latents::Vectors(&vectors[start * width..]);
        }
        (latents, self.parts.len())
    }

    /// Writes `codes [keyframes, codes of a keyframe]`, starting at keyframe `first` of the window.
    pub(crate) fn put(&mut self, first: usize, codes: &[u16]) {
        self.codes[first * self.rest.len()..][..codes.len()].copy_from_slice(codes);
    }

    /// Reads codes in the layout of [`Self::put`].
    pub(crate) fn get(&self, first: usize, codes: &mut [u16]) {
        codes.copy_from_slice(&self.codes[first * self.count()..][..codes.len()]);
    }

    /// Number of frames that this chunk made known.
    pub(crate) fn fresh_frames(&self, first: bool) -> usize {
        if first { (self.target - 1) * self.stride + 1 } else { self.target * self.stride }
    }

    /// Moves the window by one chunk.
    pub(crate) fn advance(&mut self) {
        let count = self.count();
        self.codes.copy_within(self.target * count.., 0);
    }
}
