//! The encoder: every token sees the whole input (paper section 3.1; SPEC 2.4).

use std::time::Instant;

use rayon::prelude::*;
use umo_kernels::attention::encoder_attention_f32;
use umo_kernels::matmul_f32::Epilogue;
use umo_kernels::{Mat, MatMut};

use super::attention::{PositionBias, Projections, for_each_head};
use super::experts::Experts;
use super::{LmScratch, norm};
use crate::error::{LoadError, StepError};
use crate::linear::Compute;
use crate::weights::Loader;

/// The encoder stack.
#[derive(Debug)]
pub(super) struct Encoder {
    layers: Box<[Layer]>,
    bias: PositionBias,
    norm: Box<[f32]>,
    eps: f32,
    heads: usize,
    d_kv: usize,
}

#[derive(Debug)]
struct Layer {
    norm: Box<[f32]>,
    attention: Projections,
    experts: Experts,
}

impl Encoder {
    pub(super) fn load(loader: &Loader, positions: usize) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let lm = &config.lm;
        let layer = |i: usize| {
            let block = format!("lm.encoder.block.{i}.layer");
            Ok(Layer {
                norm: loader.vector(&format!("{block}.0.layer_norm.weight"), lm.d_model)?,
                attention: Projections::load(loader, &format!("{block}.0.SelfAttention"), lm, &["q", "k", "v"])?,
                experts: Experts::load(loader, &format!("{block}.1"), lm)?,
            })
        };
        let bias = "lm.encoder.block.0.layer.0.SelfAttention.relative_attention_bias.weight";
        Ok(Self {
            layers: (0..lm.num_layers).into_par_iter().map(layer).collect::<Result<Vec<_>, LoadError>>()?.into(),
            bias: PositionBias::load(loader, bias, lm, true, positions)?,
            norm: loader.vector("lm.encoder.final_layer_norm.weight", lm.d_model)?,
            eps: lm.layer_norm_epsilon,
            heads: lm.num_heads,
            d_kv: lm.d_kv,
        })
    }

    /// Number of layers.
    pub(super) fn layers(&self) -> usize {
        self.layers.len()
    }

    /// Whether every one of `lengths` is within what the encoder was loaded for.
    pub(super) fn check(&self, lengths: &[usize]) -> Result<(), StepError> {
        match lengths.iter().find(|&&len| len > self.bias.positions()) {
            Some(&got) => Err(StepError::TooLong { what: "encoder tokens", got, limit: self.bias.positions() }),
            None => Ok(()),
        }
    }

    /// Runs layer `index` over `scratch.hidden`, whose rows are sequences of `lengths`.
    pub(super) fn layer(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        index: usize,
        lengths: &[usize],
    ) -> Result<(), StepError> {
        let (d, rows) = (self.norm.len(), lengths.iter().sum::<usize>());
        let (layer, start) = (&self.layers[index], Instant::now());
        self.attend(cx, scratch, layer, lengths)?;
        let middle = Instant::now();
        let LmScratch { hidden, normed, experts, quant, .. } = scratch;
        layer.experts.forward(cx, quant, experts, &mut hidden[..rows * d], &mut normed[..rows * d])?;
        scratch.times.add(start, middle);
        Ok(())
    }

    /// The final norm: `scratch.hidden` to `out [rows, d_model]`.
    pub(super) fn finish(
        &self,
        cx: Compute,
        scratch: &LmScratch,
        rows: usize,
        out: &mut [f32],
    ) -> Result<(), StepError> {
        norm(cx, &scratch.hidden, rows, (&self.norm, self.eps), out)
    }

    /// `hidden += o(attention(qkv(norm(hidden))))`, each sequence by itself.
    fn attend(&self, cx: Compute, scratch: &mut LmScratch, layer: &Layer, lengths: &[usize]) -> Result<(), StepError> {
        let (d, rows, inner) = (self.norm.len(), lengths.iter().sum::<usize>(), self.heads * self.d_kv);
        let LmScratch { hidden, normed, qkv, context, quant, .. } = scratch;
        norm(cx, hidden, rows, (&layer.norm, self.eps), normed)?;
        let x = Mat::new(normed, rows, d)?;
        layer.attention.input.forward(cx, quant, x, Epilogue::STORE, MatMut::new(qkv, rows, 3 * inner)?)?;

        let qkv = Mat::new(qkv, rows, 3 * inner)?;
        let longest = lengths.iter().copied().max().unwrap_or(0);
        let y = MatMut::new(context, rows, inner)?;
        let work = 2 * rows * longest * inner;
        for_each_head(cx, self.d_kv, lengths.iter().copied(), work, y, |_, head, rows, y| {
            let (block, at) = (qkv.row_range(rows), head * self.d_kv);
            let of = |kind: usize| block.columns(kind * inner + at..kind * inner + at + self.d_kv);
            encoder_attention_f32(cx.isa, of(0), of(1), of(2), 1.0, Some(self.bias.of(head, 0)), y)
        })?;

        let context = Mat::new(context, rows, inner)?;
        layer.attention.output.forward(cx, quant, context, Epilogue::ADD, MatMut::new(hidden, rows, d)?)
    }
}
