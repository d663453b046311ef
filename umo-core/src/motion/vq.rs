//! The codecs of the four parts: codes to channels, and channels to codes (SPEC 2.7).

use super::conv::{ConvScratch, DecoderStack, EncoderStack};
use crate::config::Codec;
use crate::error::{LoadError, StepError};
use crate::linear::Compute;
use crate::part::Part;
use crate::weights::Loader;

/// Room for the convolutions of any part and of the root network, for so many frames at once.
#[derive(Debug)]
pub struct MotionScratch(pub(super) ConvScratch);

impl MotionScratch {
    /// Frames that there is room for.
    pub fn rows(&self) -> usize {
        self.0.rows()
    }
}

/// The vectors that a part's codes stand for, `[codes, width]`.
#[derive(Debug)]
struct Codebook {
    values: Box<[f32]>,
    codes: usize,
    width: usize,
}

impl Codebook {
    fn load(loader: &Loader, part: Part) -> Result<Self, LoadError> {
        let (codes, width) = (loader.file().config().vq.codes, loader.file().config().vq.width);
        let name = format!("vq.{}.quantizer.embedding.weight", part.name());
        Ok(Self { values: loader.values(&name, &[codes, width])?, codes, width })
    }

    fn row(&self, code: u16) -> Result<&[f32], StepError> {
        let code = usize::from(code);
        if code >= self.codes {
            return Err(StepError::OutOfRange { what: "motion code", got: code, limit: self.codes });
        }
        Ok(&self.values[code * self.width..][..self.width])
    }

    /// The code whose vector is nearest by Euclidean distance, the lowest of equals.
    fn nearest(&self, x: &[f32]) -> u16 {
        let distance = |row: &[f32]| -> f64 { row.iter().zip(x).map(|(a, b)| f64::from(a - b).powi(2)).sum() };
        let mut best = (0, f64::INFINITY);
        // The config allows no more codes than a u16 holds.
        for (row, code) in self.values.chunks_exact(self.width).zip(0_u16..) {
            let distance = distance(row);
            if distance < best.1 {
                best = (code, distance);
            }
        }
        best.0
    }
}

/// Codes of one part to its channels.
#[derive(Debug)]
pub struct VqDecoder {
    codebook: Codebook,
    stack: DecoderStack,
    codec: Codec,
}

impl VqDecoder {
    /// Loads `vq.{part}.quantizer` and `vq.{part}.decoder`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader, part: Part) -> Result<Self, LoadError> {
        let vq = &loader.file().config().vq;
        let name = format!("vq.{}.decoder.main", part.name());
        Ok(Self {
            codebook: Codebook::load(loader, part)?,
            stack: DecoderStack::load(loader, &name, vq[part], vq.width)?,
            codec: vq[part],
        })
    }

    /// Values per frame.
    pub fn channels(&self) -> usize {
        self.codec.channels
    }

    /// Frames on each side that a frame depends on.
    pub fn reach(&self) -> usize {
        self.codec.decoder_reach()
    }

    /// Decodes `codes [T]` as if nothing came before or after them; gives `[T, channels]`, in `scratch`.
    ///
    /// Numerics: a frame that is [`reach`](Self::reach) or more away from an end has the same bits whatever lies beyond.
    ///
    /// # Errors
    /// [`StepError`] where a code is no code or there are more than `scratch` has room for.
    pub fn decode<'a>(
        &self,
        cx: Compute,
        scratch: &'a mut MotionScratch,
        codes: &[u16],
    ) -> Result<&'a [f32], StepError> {
        self.decode_held(cx, scratch, codes, 0)
    }

    /// [`decode`](Self::decode) as if the last code came `held` times more; gives `[T + held, channels]`.
    ///
    /// # Errors
    /// As `decode`.
    pub(super) fn decode_held<'a>(
        &self,
        cx: Compute,
        scratch: &'a mut MotionScratch,
        codes: &[u16],
        held: usize,
    ) -> Result<&'a [f32], StepError> {
        let frames = if codes.is_empty() { 0 } else { codes.len() + held };
        let input = scratch.0.input(frames, self.codebook.width)?;
        let last = codes.last().copied().into_iter().cycle();
        for (code, row) in codes.iter().copied().chain(last).zip(input.chunks_exact_mut(self.codebook.width)) {
            row.copy_from_slice(self.codebook.row(code)?);
        }
        self.stack.run(cx, &mut scratch.0, frames)?;
        Ok(scratch.0.output(frames, self.codec.channels))
    }
}

/// Channels of one part to its codes.
#[derive(Debug)]
pub struct VqEncoder {
    codebook: Codebook,
    stack: EncoderStack,
    codec: Codec,
}

impl VqEncoder {
    /// Loads `vq.{part}.quantizer` and `vq.{part}.encoder`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader, part: Part) -> Result<Self, LoadError> {
        let vq = &loader.file().config().vq;
        let name = format!("vq.{}.encoder.main", part.name());
        Ok(Self {
            codebook: Codebook::load(loader, part)?,
            stack: EncoderStack::load(loader, &name, vq[part], vq.width)?,
            codec: vq[part],
        })
    }

    /// Values per frame.
    pub fn channels(&self) -> usize {
        self.codec.channels
    }

    /// Encodes `channels [T, channels]` to `codes [T]`: to each frame the nearest vector of the codebook.
    ///
    /// # Errors
    /// [`StepError`] where the lengths disagree or `scratch` has no room for so many frames.
    pub fn encode(
        &self,
        cx: Compute,
        scratch: &mut MotionScratch,
        channels: &[f32],
        codes: &mut [u16],
    ) -> Result<(), StepError> {
        if channels.len() != codes.len() * self.codec.channels {
            return Err(StepError::Disagree("channels and codes have different numbers of frames"));
        }
        scratch.0.input(codes.len(), self.codec.channels)?.copy_from_slice(channels);
        self.stack.run(cx, &mut scratch.0, codes.len())?;
        let width = self.codebook.width;
        let latents = scratch.0.output(codes.len(), width);
        for (code, row) in codes.iter_mut().zip(latents.chunks_exact(width)) {
            *code = self.codebook.nearest(row);
        }
        Ok(())
    }
}
