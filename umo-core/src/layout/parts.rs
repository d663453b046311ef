//! The codes of the window: `P` keyframes of history, `N` new ones, and the frames between them.

use crate::config::Config;
use crate::error::StepError;
use crate::memory::{Arena, Slice};
use crate::part::{Part, PerPart};
use crate::state::{StateError, StatePass};

/// Codes of one session's window.
#[derive(Debug)]
pub(crate) struct History {
    /// `[P + N]` keyframes of each part, oldest first.
    keyframes: PerPart<Slice<u16>>,
    /// `[(P + N - 1) * stride + 1]` frames of each part.
    frames: PerPart<Slice<u16>>,
    prefix: usize,
    target: usize,
    stride: usize,
    codes: usize,
    /// Rest codes.
    rest: PerPart<u16>,
}

impl History {
    /// Creates a history of rest codes.
    pub(crate) fn new_in(config: &Config, target: usize, arena: &Arena) -> Self {
        let (prefix, stride) = (config.prefix, config.keyframe_stride);
        let (len, rest) = ((prefix + target - 1) * stride + 1, config.part_rest());
        Self {
            keyframes: PerPart::from_fn(|part| arena.filled(rest[part], prefix + target)),
            frames: PerPart::from_fn(|_| arena.filled(0, len)),
            prefix,
            target,
            stride,
            codes: config.part_codes(),
            rest,
        }
    }

    /// Resets the history to rest codes.
    pub(crate) fn rest(&mut self) {
        Part::ALL.into_iter().for_each(|part| self.keyframes[part].fill(self.rest[part]));
    }

    /// Replaces the history by the last of `codes`.
    pub(crate) fn set(&mut self, codes: PerPart<&[u16]>) -> Result<(), StepError> {
        for part in Part::ALL {
            let Some(&first) = codes[part].first() else { return Err(StepError::Empty("codes of history")) };
            if let Some(&code) = codes[part].iter().find(|&&code| usize::from(code) >= self.codes) {
                return Err(StepError::OutOfRange { what: "code", got: code.into(), limit: self.codes });
            }
            let last = &codes[part][codes[part].len().saturating_sub(self.prefix)..];
            let (pad, rest) = self.keyframes[part][..self.prefix].split_at_mut(self.prefix - last.len());
            pad.fill(first);
            rest.copy_from_slice(last);
        }
        Ok(())
    }

    /// Describes the history. Each chunk writes the new keyframes and the frames in between before it reads them.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let (prefix, codes) = (self.prefix, self.codes);
        Part::ALL.into_iter().try_for_each(|part| pass.codes(&mut self.keyframes[part][..prefix], codes))
    }

    /// The history's keyframes.
    pub(crate) fn prefix(&self) -> PerPart<&[u16]> {
        PerPart::from_fn(|part| &self.keyframes[part][..self.prefix])
    }

    /// The new keyframes, mutable.
    pub(crate) fn target(&mut self) -> PerPart<&mut [u16]> {
        let PerPart { face, hands, upper, lower } = &mut self.keyframes;
        let prefix = self.prefix;
        PerPart {
            face: &mut face[prefix..],
            hands: &mut hands[prefix..],
            upper: &mut upper[prefix..],
            lower: &mut lower[prefix..],
        }
    }

    /// Copies the keyframes to their frames and masks all others.
    #[expect(clippy::cast_possible_truncation, reason = "the mask fits 16 bits by the config's checks")]
    pub(crate) fn lay_out(&mut self) {
        for part in Part::ALL {
            self.frames[part].fill(self.codes as u16);
            for (frame, &code) in self.frames[part].iter_mut().step_by(self.stride).zip(&self.keyframes[part]) {
                *frame = code;
            }
        }
    }

    /// The window's frames, mutable.
    pub(crate) fn frames(&mut self) -> PerPart<&mut [u16]> {
        let PerPart { face, hands, upper, lower } = &mut self.frames;
        PerPart { face, hands, upper, lower }
    }

    /// The window's frames.
    pub(crate) fn window(&self) -> PerPart<&[u16]> {
        PerPart::from_fn(|part| &*self.frames[part])
    }

    /// Frames whose codes this chunk made known: those after the last keyframe of the history, or in the first chunk
    /// from frame 0.
    pub(crate) fn fresh(&self, first: bool) -> PerPart<&[u16]> {
        let start = self.fresh_start(first);
        PerPart::from_fn(|part| &self.frames[part][start..])
    }

    /// Index of the first fresh frame in the window.
    pub(crate) fn fresh_start(&self, first: bool) -> usize {
        if first { self.prefix * self.stride } else { (self.prefix - 1) * self.stride + 1 }
    }

    /// Sets the new keyframes to the last one of the history.
    pub(crate) fn hold(&mut self) {
        for part in Part::ALL {
            let (history, new) = self.keyframes[part].split_at_mut(self.prefix);
            new.fill(history[self.prefix - 1]);
        }
    }

    /// Writes `codes [keyframes, parts]`, starting at keyframe `first` of the window.
    pub(crate) fn put(&mut self, first: usize, codes: &[u16]) {
        for (at, codes) in codes.chunks_exact(Part::ALL.len()).enumerate() {
            Part::ALL.into_iter().zip(codes).for_each(|(part, &code)| self.keyframes[part][first + at] = code);
        }
    }

    /// Reads codes in the layout of [`Self::put`].
    pub(crate) fn get(&self, first: usize, codes: &mut [u16]) {
        for (at, codes) in codes.chunks_exact_mut(Part::ALL.len()).enumerate() {
            Part::ALL.into_iter().zip(codes).for_each(|(part, code)| *code = self.keyframes[part][first + at]);
        }
    }

    /// Moves the window by one chunk.
    pub(crate) fn advance(&mut self) {
        for part in Part::ALL {
            self.keyframes[part].copy_within(self.target.., 0);
        }
    }
}
