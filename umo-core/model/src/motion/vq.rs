//! The codecs of the parts: codes to channels, and channels to codes (SPEC 2.7, 2.12).

use umo_core_base::error::{LoadError, StepError};

use super::conv::{ConvScratch, DecoderStack, EncoderStack};
use crate::config::{Channels, Codec, PartSpec};
use crate::linear::Compute;
use crate::weights::Loader;

/// Scratch memory for the convolutions of any part and of the root network.
#[derive(Debug)]
pub struct MotionScratch(pub(super) ConvScratch);

impl MotionScratch {
    /// Number of frames that the scratch has room for.
    pub fn rows(&self) -> usize {
        self.0.rows()
    }
}

/// Value of a decoder's input: of codes `[T, levels]`, or of vectors of the codes, summed over the levels, `[T, width]`.
pub trait Latent: Copy + Default + std::fmt::Debug {
    /// Number of values per frame.
    fn width(codebook: &Codebook) -> usize;

    /// Checks that a decoder can read `latents`.
    ///
    /// # Errors
    /// [`StepError`] if a code is out of range.
    fn check(codebook: &Codebook, latents: &[Self]) -> Result<(), StepError>;

    /// Writes the vectors of `latents` to `rows [T, width of a vector]`.
    ///
    /// # Errors
    /// [`StepError`] if a code is out of range.
    fn write(codebook: &Codebook, latents: &[Self], rows: &mut [f32]) -> Result<(), StepError>;
}

impl Latent for u16 {
    fn width(codebook: &Codebook) -> usize {
        codebook.levels
    }

    fn check(codebook: &Codebook, latents: &[Self]) -> Result<(), StepError> {
        let limit = codebook.codes;
        match latents.iter().find(|&&code| usize::from(code) >= limit) {
            Some(&code) => Err(StepError::OutOfRange { what: "motion code", got: code.into(), limit }),
            None => Ok(()),
        }
    }

    fn write(codebook: &Codebook, latents: &[Self], rows: &mut [f32]) -> Result<(), StepError> {
        let rows = rows.chunks_exact_mut(codebook.width);
        latents.chunks_exact(codebook.levels).zip(rows).try_for_each(|(codes, row)| codebook.vector(codes, row))
    }
}

impl Latent for f32 {
    fn width(codebook: &Codebook) -> usize {
        codebook.width
    }

    fn check(_: &Codebook, _: &[Self]) -> Result<(), StepError> {
        Ok(())
    }

    fn write(_: &Codebook, latents: &[Self], rows: &mut [f32]) -> Result<(), StepError> {
        rows.copy_from_slice(latents);
        Ok(())
    }
}

/// Vectors of a part's codes, `[levels, codes, width]`.
#[derive(Debug)]
pub struct Codebook {
    values: Box<[f32]>,
    codes: usize,
    levels: usize,
    width: usize,
}

impl Codebook {
    /// Loads `vq.{part}.quantizer`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader, part: &PartSpec) -> Result<Self, LoadError> {
        let PartSpec { codes, levels, width, .. } = *part;
        let name = format!("vq.{}.quantizer.embedding.weight", part.name);
        Ok(Self { values: loader.values(&name, &[levels * codes, width])?, codes, levels, width })
    }

    /// Number of codes per level.
    pub fn codes(&self) -> usize {
        self.codes
    }

    /// Number of levels of a frame's codes.
    pub fn levels(&self) -> usize {
        self.levels
    }

    /// Length of a vector.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Writes the sum of the vectors of one frame's `codes [levels]` to `out [width]`.
    ///
    /// # Errors
    /// [`StepError`] if a code is out of range.
    pub fn vector(&self, codes: &[u16], out: &mut [f32]) -> Result<(), StepError> {
        for (level, &code) in codes.iter().enumerate() {
            let row = self.row(level, code)?;
            match level {
                0 => out.copy_from_slice(row),
                _ => out.iter_mut().zip(row).for_each(|(out, v)| *out += v),
            }
        }
        Ok(())
    }

    fn row(&self, level: usize, code: u16) -> Result<&[f32], StepError> {
        let code = usize::from(code);
        if code >= self.codes {
            return Err(StepError::OutOfRange { what: "motion code", got: code, limit: self.codes });
        }
        Ok(&self.values[(level * self.codes + code) * self.width..][..self.width])
    }

    /// Writes the codes of `x [width]`. Each level selects the vector with the smallest Euclidean distance to
    /// the residual of the levels before it; ties go to the lowest code. Overwrites `x` with the residual
    /// before the last level.
    pub fn encode(&self, x: &mut [f32], codes: &mut [u16]) {
        let levels = self.values.chunks_exact(self.codes * self.width);
        for ((values, code), level) in levels.zip(codes).zip(0..) {
            *code = self.nearest(values, x);
            if level + 1 < self.levels {
                let row = &values[usize::from(*code) * self.width..][..self.width];
                x.iter_mut().zip(row).for_each(|(x, v)| *x -= v);
            }
        }
    }

    fn nearest(&self, values: &[f32], x: &[f32]) -> u16 {
        let distance = |row: &[f32]| -> f64 { row.iter().zip(x).map(|(a, b)| f64::from(a - b).powi(2)).sum() };
        let mut best = (0, f64::INFINITY);
        // The config limits the number of codes to the range of u16.
        for (row, code) in values.chunks_exact(self.width).zip(0_u16..) {
            let distance = distance(row);
            if distance < best.1 {
                best = (code, distance);
            }
        }
        best.0
    }
}

/// Decoder from the codes of one part to its channels.
#[derive(Debug)]
pub struct VqDecoder {
    codebook: Codebook,
    stack: DecoderStack,
    codec: Codec,
    channels: Channels,
}

impl VqDecoder {
    /// Loads `vq.{part}.quantizer` and `vq.{part}.decoder`, for a part with `channels`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader, part: &PartSpec, channels: Channels) -> Result<Self, LoadError> {
        let codec = part.codec(channels.count());
        let stack = DecoderStack::load(loader, &format!("vq.{}.decoder.main", part.name), codec, part.width)?;
        Ok(Self { codebook: Codebook::load(loader, part)?, stack, codec, channels })
    }

    /// Number of values per frame.
    pub fn channels(&self) -> usize {
        self.codec.channels
    }

    /// Body channels that the decoder writes.
    pub fn places(&self) -> &Channels {
        &self.channels
    }

    /// Codebook of the part.
    pub fn codebook(&self) -> &Codebook {
        &self.codebook
    }

    /// Number of frames on each side that a frame depends on.
    pub fn reach(&self) -> usize {
        self.codec.decoder_reach()
    }

    /// Returns the number of frames in `latents`.
    ///
    /// # Errors
    /// [`StepError`] if `latents` is not a whole number of frames, or a code is out of range.
    pub(super) fn frames<T: Latent>(&self, latents: &[T]) -> Result<usize, StepError> {
        T::check(&self.codebook, latents)?;
        let (values, width) = (latents.len(), T::width(&self.codebook));
        match values.is_multiple_of(width) {
            true => Ok(values / width),
            false => Err(StepError::Disagree("motion codes or vectors of no whole number of frames")),
        }
    }

    /// Decodes `T` frames of latents, with nothing before or after them. Returns `[T, channels]`, in
    /// `scratch`.
    ///
    /// Numerics: the bits of a frame that is [`reach`](Self::reach) or more frames from either end do not
    /// depend on the frames beyond that end.
    ///
    /// # Errors
    /// [`StepError`] if a code is out of range, or there are more frames than `scratch` has room for.
    pub fn decode<'a, T: Latent>(
        &self,
        cx: Compute,
        scratch: &'a mut MotionScratch,
        latents: &[T],
    ) -> Result<&'a [f32], StepError> {
        self.decode_held(cx, scratch, latents, 0)
    }

    /// Like [`decode`](Self::decode), with the last frame repeated `held` times; returns
    /// `[T + held, channels]`.
    ///
    /// # Errors
    /// As `decode`.
    pub(super) fn decode_held<'a, T: Latent>(
        &self,
        cx: Compute,
        scratch: &'a mut MotionScratch,
        latents: &[T],
        held: usize,
    ) -> Result<&'a [f32], StepError> {
        let (given, width) = (self.frames(latents)?, self.codebook.width);
        let frames = if given == 0 { 0 } else { given + held };
        let input = scratch.0.input(frames, width)?;
        let (known, rest) = input.split_at_mut(given * width);
        T::write(&self.codebook, latents, known)?;
        if let Some(last) = known.len().checked_sub(width) {
            rest.chunks_exact_mut(width).for_each(|row| row.copy_from_slice(&known[last..]));
        }
        self.stack.run(cx, &mut scratch.0, frames)?;
        Ok(scratch.0.output(frames, self.codec.channels))
    }
}

/// Encoder from the channels of one part to its codes.
#[derive(Debug)]
pub struct VqEncoder {
    codebook: Codebook,
    stack: EncoderStack,
    codec: Codec,
}

impl VqEncoder {
    /// Loads `vq.{part}.quantizer` and `vq.{part}.encoder`, for a part with `channels` channels.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader, part: &PartSpec, channels: usize) -> Result<Self, LoadError> {
        let codec = part.codec(channels);
        let stack = EncoderStack::load(loader, &format!("vq.{}.encoder.main", part.name), codec, part.width)?;
        Ok(Self { codebook: Codebook::load(loader, part)?, stack, codec })
    }

    /// Number of values per frame.
    pub fn channels(&self) -> usize {
        self.codec.channels
    }

    /// Number of levels of a frame's codes.
    pub fn levels(&self) -> usize {
        self.codebook.levels
    }

    /// Encodes `channels [T, channels]` to `codes [T, levels]`: the nearest vector of the first level's
    /// codebook, then of each next level's to the residual.
    ///
    /// # Errors
    /// [`StepError`] if the lengths disagree, or there are more frames than `scratch` has room for.
    pub fn encode(
        &self,
        cx: Compute,
        scratch: &mut MotionScratch,
        channels: &[f32],
        codes: &mut [u16],
    ) -> Result<(), StepError> {
        let frames = codes.len() / self.codebook.levels;
        if channels.len() != frames * self.codec.channels || frames * self.codebook.levels != codes.len() {
            return Err(StepError::Disagree("channels and codes have different numbers of frames"));
        }
        scratch.0.input(frames, self.codec.channels)?.copy_from_slice(channels);
        self.stack.run(cx, &mut scratch.0, frames)?;
        let width = self.codebook.width;
        let latents = scratch.0.output_mut(frames, width);
        for (codes, row) in codes.chunks_exact_mut(self.codebook.levels).zip(latents.chunks_exact_mut(width)) {
            self.codebook.encode(row, codes);
        }
        Ok(())
    }
}
