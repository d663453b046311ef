//! The codes of the keyframes in a window, in either layout.

use umo_core_base::error::StepError;
use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::part::Part;

use crate::config::Config;

/// Stands for a code that is drawn, among those that are set beforehand.
pub const FREE: u16 = u16::MAX;

/// Codes of one stream's window: `P` keyframes of history, and `N` new ones.
#[derive(Debug)]
pub struct Window {
    /// `[P + N, codes of a keyframe]`, oldest first.
    codes: Slice<u16>,
    /// `[N, codes of a keyframe]`: codes of the new keyframes that are not drawn; [`FREE`] for the others.
    wanted: Slice<u16>,
    /// Exclusive upper bound of each code of a keyframe.
    limits: Slice<usize>,
    /// Rest codes.
    rest: Slice<u16>,
    prefix: usize,
    target: usize,
    stride: usize,
}

/// Exclusive upper bound and rest code of each code of a keyframe.
#[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
fn codes(config: &Config) -> impl Iterator<Item = (usize, u16)> + Clone {
    let listed = config.parts.as_deref().unwrap_or_default().iter();
    let listed = listed.flat_map(|part| part.rest.iter().map(|&code| (part.codes, code as u16)));
    let (limit, rest) = (config.vq.codes, config.rest);
    // A config without a list has the paper's parts.
    let paper = Part::ALL.into_iter().map(move |part| (limit, rest[part] as u16));
    listed.chain(paper).take(config.codes_per_keyframe())
}

impl Window {
    /// Creates a window of `target` new keyframes, with a history of rest codes.
    pub fn new_in(config: &Config, target: usize, arena: &Arena) -> Self {
        let (prefix, count) = (config.prefix, config.codes_per_keyframe());
        let rest = codes(config).map(|(_, rest)| rest);
        Self {
            codes: arena.collect_len((prefix + target) * count, rest.clone().cycle()),
            wanted: arena.filled(FREE, target * count),
            limits: arena.collect_len(count, codes(config).map(|(limit, _)| limit)),
            rest: arena.collect_len(count, rest),
            prefix,
            target,
            stride: config.keyframe_stride,
        }
    }

    fn count(&self) -> usize {
        self.rest.len()
    }

    /// Resets the history to rest codes.
    pub fn rest(&mut self) {
        self.wanted.fill(FREE);
        self.codes.chunks_exact_mut(self.rest.len()).for_each(|codes| codes.copy_from_slice(&self.rest));
    }

    /// Replaces the history by the last of `codes [T, codes of a keyframe]`. If there are fewer, the first is repeated
    /// in front.
    pub(crate) fn set(&mut self, codes: &[u16]) -> Result<(), StepError> {
        let count = self.count();
        if codes.is_empty() {
            return Err(StepError::Empty("codes of history"));
        }
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
        pad.chunks_exact_mut(count).for_each(|pad| pad.copy_from_slice(&codes[..count]));
        rest.copy_from_slice(last);
        Ok(())
    }

    /// Sets codes `[N, codes of a keyframe]` of the new keyframes, [`FREE`] for those that the model draws.
    pub(crate) fn want(&mut self, codes: &[u16]) -> Result<(), StepError> {
        if codes.len() != self.wanted.len() {
            return Err(StepError::Disagree("codes and the keyframes of a chunk"));
        }
        for (&code, &limit) in codes.iter().zip(self.limits.iter().cycle()) {
            if code != FREE && usize::from(code) >= limit {
                return Err(StepError::OutOfRange { what: "code", got: code.into(), limit });
            }
        }
        self.wanted.copy_from_slice(codes);
        Ok(())
    }

    /// The codes of a new keyframe that are set, and [`FREE`].
    pub(super) fn wanted(&self, keyframe: usize) -> &[u16] {
        &self.wanted[keyframe * self.count()..][..self.count()]
    }

    /// Whether every code of the new keyframes is set.
    pub fn is_given(&self) -> bool {
        !self.wanted.contains(&FREE)
    }

    /// Describes the history, its codes in `order`. Each chunk writes the new keyframes before it reads them.
    pub(super) fn state(
        &mut self,
        pass: &mut StatePass,
        mut order: impl Iterator<Item = usize>,
    ) -> Result<(), StateError> {
        let count = self.count();
        order.try_for_each(|at| pass.codes(std::slice::from_mut(&mut self.codes[at]), self.limits[at % count]))
    }

    /// The history's codes, `[P, codes of a keyframe]`.
    pub(crate) fn history(&self) -> &[u16] {
        &self.codes[..self.prefix * self.count()]
    }

    /// The new keyframes' codes, `[N, codes of a keyframe]`.
    pub(crate) fn targets(&self) -> &[u16] {
        &self.codes[self.prefix * self.count()..]
    }

    /// The new keyframes' codes, mutable.
    pub(super) fn targets_mut(&mut self) -> &mut [u16] {
        let first = self.prefix * self.count();
        &mut self.codes[first..]
    }

    /// The codes of each keyframe, oldest first.
    pub(super) fn keyframes(&self) -> impl ExactSizeIterator<Item = &[u16]> {
        self.codes.chunks_exact(self.count())
    }

    /// The codes of a new keyframe.
    pub(super) fn target(&self, keyframe: usize) -> &[u16] {
        &self.targets()[keyframe * self.count()..][..self.count()]
    }

    /// The codes of the keyframe before a new one.
    pub(crate) fn before(&self, keyframe: usize) -> &[u16] {
        &self.codes[(self.prefix + keyframe - 1) * self.count()..][..self.count()]
    }

    /// Sets the new keyframes without drawing: to the codes that are all set, or to the last keyframe of the history.
    pub(crate) fn hold(&mut self) {
        if self.is_given() {
            let first = self.prefix * self.count();
            return self.codes[first..].copy_from_slice(&self.wanted);
        }
        let (count, first) = (self.count(), self.prefix * self.count());
        let (history, new) = self.codes.split_at_mut(first);
        new.chunks_exact_mut(count).for_each(|codes| codes.copy_from_slice(&history[first - count..]));
    }

    /// Writes `codes [keyframes, codes of a keyframe]` of the first new keyframes.
    pub fn write(&mut self, codes: &[u16]) {
        self.targets_mut()[..codes.len()].copy_from_slice(codes);
    }

    /// Overwrites the last `codes [keyframes, codes of a keyframe]` of the history.
    pub fn correct(&mut self, codes: &[u16]) {
        let end = self.prefix * self.count();
        self.codes[end - codes.len()..end].copy_from_slice(codes);
    }

    /// Reads the last `codes [keyframes, codes of a keyframe]` of the history.
    pub fn last(&self, codes: &mut [u16]) {
        let history = self.history();
        codes.copy_from_slice(&history[history.len() - codes.len()..]);
    }

    /// Index of the first frame in the window that a chunk makes known: the one after the last keyframe of the
    /// history, or in the first chunk frame 0 of the stream.
    pub fn fresh_start(&self, first: bool) -> usize {
        if first { self.prefix * self.stride } else { (self.prefix - 1) * self.stride + 1 }
    }

    /// Number of frames that a chunk makes known.
    pub(super) fn fresh_frames(&self, first: bool) -> usize {
        if first { (self.target - 1) * self.stride + 1 } else { self.target * self.stride }
    }

    /// Moves the window by one chunk.
    pub fn advance(&mut self) {
        self.wanted.fill(FREE);
        let count = self.count();
        self.codes.copy_within(self.target * count.., 0);
    }
}
