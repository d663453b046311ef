//! The encoder: every token sees the whole input (paper section 3.1; SPEC 2.4).

use umo_kernels::attention::{encoder_attention_bf16, encoder_attention_f32};
use umo_kernels::gemm::Epilogue;
use umo_kernels::{MatMut, PANEL};

use super::attention::{PositionBias, Projections, heads_of};
use super::experts::Experts;
use super::{LmScratch, no_more, norm, norm_input};
use crate::error::{LoadError, StepError};
use crate::linear::Compute;
use crate::thread::parallel::*;
use crate::time::Instant;
use crate::weights::Loader;

/// Heads whose queries, keys and values a thread computes before it attends with them: 576 KiB of
/// 256 tokens at 64 a head.
const HEADS_AT_ONCE: usize = 3;

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

    /// Runs layer `index` over the rows of `scratch.hidden` from `first` on, sequences of `lengths`.
    pub(super) fn layer(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        index: usize,
        first: usize,
        lengths: &[usize],
    ) -> Result<(), StepError> {
        let (d, rows) = (self.norm.len(), lengths.iter().sum::<usize>());
        let (layer, start) = (&self.layers[index], Instant::now());
        self.attend(cx, scratch, layer, first, lengths)?;
        let middle = Instant::now();
        let LmScratch { hidden, normed, experts, quant, middle: inside, .. } = scratch;
        let then = || {
            if let Some(next) = self.layers.get(index + 1) {
                let input = &next.attention.input;
                cx.team.expect(self.heads * self.d_kv, self.d_kv, |columns| input.ahead(columns).tuned_for(cx.isa));
            }
        };
        let hidden = &mut hidden[first * d..(first + rows) * d];
        layer.experts.forward(cx, (quant, inside), experts, hidden, &mut normed[..rows * d], then)?;
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

    /// `hidden += o(attention(qkv(norm(hidden))))`, each sequence by itself. A thread computes
    /// queries, keys and values of its heads, and from them these heads' columns of the context.
    fn attend(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        layer: &Layer,
        first: usize,
        lengths: &[usize],
    ) -> Result<(), StepError> {
        let (d, rows, inner) = (self.norm.len(), lengths.iter().sum::<usize>(), self.heads * self.d_kv);
        let LmScratch { hidden, normed, qkv, context, quant, middle, .. } = scratch;
        let hidden = &mut hidden[first * d..];
        let Projections { input, output } = &layer.attention;
        let none = MatMut::new(&mut [], rows, 0)?;
        let x = norm_input(cx, hidden, (&layer.norm, self.eps), normed, (input, quant), none, 0, no_more)?;

        let longest = lengths.iter().copied().max().unwrap_or(0);
        let work = rows * (3 * d + 2 * longest) * inner;
        // Heads begin at whole panels of all three, or one thread does them all.
        let apart = self.d_kv.is_multiple_of(PANEL);
        let (granule, most) = if apart { (self.d_kv, HEADS_AT_ONCE * self.d_kv) } else { (inner, inner) };
        let room = (&mut qkv[..], 3 * rows);
        // Int8 products cost queries, keys and values more digits than bfloat16 does.
        let attention = if input.is_quantized() { encoder_attention_bf16 } else { encoder_attention_f32 };
        output.expect(cx);
        let context = middle.computed(cx, output, (&mut context[..], rows), granule, work, room, |columns, to| {
            // A few heads at a time: what is computed for them is still in cache when it is read.
            for first in (0..columns.len()).step_by(most) {
                let width = (columns.len() - first).min(most);
                let at = columns.start + first;
                let mut y = MatMut::new(to.room, rows, 3 * width)?;
                if width == inner {
                    input.apply_here(cx, x, None, 0..3 * inner, Epilogue::STORE, y.reborrow())?;
                } else {
                    for kind in 0..3 {
                        let (_, y) = y.reborrow().split_columns(kind * width);
                        let outputs = kind * inner + at..kind * inner + at + width;
                        input.apply_here(cx, x, None, outputs, Epilogue::STORE, y.split_columns(width).0)?;
                    }
                }
                let qkv = y.dense();
                let y = to.y.reborrow().split_columns(first).1.split_columns(width).0;
                heads_of(at..at + width, self.d_kv, lengths.iter().copied(), y, |_, heads, at, rows, y| {
                    let block = qkv.row_range(rows);
                    let of = |kind: usize| block.columns(kind * width + at..kind * width + at + self.d_kv);
                    attention(cx.isa, of(0), of(1), of(2), 1.0, Some(self.bias.of(heads.start, 0)), y)
                })?;
            }
            to.complete(0..rows)
        })?;
        output.apply(cx, context, None, 0..d, Epilogue::ADD, MatMut::new(hidden, rows, d)?)
    }
}
