//! The encoder: every token sees the whole input (paper section 3.1; SPEC 2.4).

use std::ops::Range;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::time::Instant;
use umo_kernels::attention::{Operands, encoder_attention_bf16, encoder_attention_f32};
use umo_kernels::gemm::Epilogue;
use umo_kernels::product::Rows;
use umo_kernels::{Mat, MatMut, PANEL};

use super::attention::{PositionBias, Projections, heads_of};
use super::experts::Experts;
use super::{LmScratch, PIECE_WORK, no_more, norm, norm_input, piece_rows};
use crate::linear::{Compute, Linear};
use crate::weights::{Loader, load_layers};

/// Number of heads whose queries, keys and values a thread computes before it attends with them: 576 KiB at
/// 256 tokens and 64 values per head.
const HEADS_AT_ONCE: usize = 3;

/// Progress through a layer that is computed in pieces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EncoderPiece {
    /// The attention of the heads from this one on.
    Heads(usize),
    /// The attention's output for the rows from this one on.
    Output(usize),
    /// The experts, for their slots from this one on.
    Experts(usize),
}

impl EncoderPiece {
    /// The first piece of a layer.
    pub(crate) const FIRST: Self = Self::Heads(0);
}

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
            layers: load_layers(lm.num_layers, layer)?,
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

    /// Checks that every one of `lengths` is within the limit that the encoder was loaded for.
    pub(super) fn check(&self, lengths: &[usize]) -> Result<(), StepError> {
        match lengths.iter().find(|&&len| len > self.bias.positions()) {
            Some(&got) => Err(StepError::TooLong { what: "encoder tokens", got, limit: self.bias.positions() }),
            None => Ok(()),
        }
    }

    /// Runs layer `index` over the rows of `scratch.hidden` from `first` on, which hold sequences of
    /// `lengths`.
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
                cx.team.prefetch_next(self.heads * self.d_kv, self.d_kv, |columns| {
                    input.prefetch_hint(columns).tuned_for(cx.isa)
                });
            }
        };
        let hidden = &mut hidden[first * d..(first + rows) * d];
        layer.experts.forward(cx, (quant, inside), experts, hidden, &mut normed[..rows * d], then)?;
        scratch.times.add(start, middle);
        Ok(())
    }

    /// Runs one piece of [`Self::layer`] and returns the next, if any.
    pub(super) fn piece(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        index: usize,
        (first, lengths): (usize, &[usize]),
        piece: EncoderPiece,
    ) -> Result<Option<EncoderPiece>, StepError> {
        let (d, rows) = (self.norm.len(), lengths.iter().sum::<usize>());
        let (layer, start) = (&self.layers[index], Instant::now());
        let LmScratch { hidden, normed, qkv, context, experts, quant, middle, .. } = scratch;
        let hidden = &mut hidden[first * d..(first + rows) * d];
        let next = match piece {
            EncoderPiece::Heads(head) => {
                let (input, output) = (&layer.attention.input, &layer.attention.output);
                if head == 0 {
                    let none = MatMut::new(&mut [], rows, 0)?;
                    norm_input(cx, hidden, (&layer.norm, self.eps), normed, (input, quant), none, 0, no_more)?;
                }
                let x = quant.again(input, normed, rows)?;
                let (width, longest) = (output.inputs(), lengths.iter().copied().max().unwrap_or(0));
                let work = rows * (3 * d + 2 * longest) * self.d_kv;
                let heads =
                    if self.heads_apart() { (PIECE_WORK / work.max(1)).clamp(1, HEADS_AT_ONCE) } else { self.heads };
                let end = self.heads.min(head + heads);
                let columns = head * self.d_kv..end * self.d_kv;
                let y = MatMut::new(context, rows, width)?.split_columns(columns.start).1;
                self.attend_heads(cx, input, x, columns.clone(), lengths, qkv, y.split_columns(columns.len()).0)?;
                Some(if end < self.heads { EncoderPiece::Heads(end) } else { EncoderPiece::Output(0) })
            }
            EncoderPiece::Output(row) => {
                let output = &layer.attention.output;
                let end = rows.min(row + piece_rows(rows, d * output.inputs()));
                let x = Mat::new(context, rows, output.inputs())?.row_range(row..end);
                let x = output.input(cx, middle, x)?;
                let y = MatMut::new(&mut hidden[row * d..end * d], end - row, d)?;
                output.apply(cx, x, 0..d, Epilogue::ADD, y)?;
                Some(if end < rows { EncoderPiece::Output(end) } else { EncoderPiece::Experts(0) })
            }
            EncoderPiece::Experts(slot) => {
                let normed = &mut normed[..rows * d];
                let next = layer.experts.piece(cx, (quant, middle), experts, hidden, normed, slot)?;
                next.map(EncoderPiece::Experts)
            }
        };
        match piece {
            EncoderPiece::Experts(_) => scratch.times.experts += start.elapsed(),
            _ => scratch.times.attention += start.elapsed(),
        }
        Ok(next)
    }

    /// Writes the final norm of `scratch.hidden` to `out [rows, d_model]`.
    pub(super) fn finish(
        &self,
        cx: Compute,
        scratch: &LmScratch,
        rows: usize,
        out: &mut [f32],
    ) -> Result<(), StepError> {
        norm(cx, &scratch.hidden, rows, (&self.norm, self.eps), out)
    }

    /// `hidden += o(attention(qkv(norm(hidden))))`, with each sequence attending only to itself. A thread
    /// computes the queries, keys and values of its heads, and from them these heads' columns of the context.
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
        let granule = if self.heads_apart() { self.d_kv } else { inner };
        let room = (&mut qkv[..], 3 * rows);
        output.prefetch_next(cx);
        let context = middle.computed(cx, output, (&mut context[..], rows), granule, work, room, |columns, to| {
            // A few heads at a time, so that their queries, keys and values are still in cache when they are
            // read.
            let most = if self.heads_apart() { HEADS_AT_ONCE * self.d_kv } else { inner };
            for first in (0..columns.len()).step_by(most) {
                let width = (columns.len() - first).min(most);
                let at = columns.start + first;
                let y = to.y.reborrow().split_columns(first).1.split_columns(width).0;
                self.attend_heads(cx, input, x, at..at + width, lengths, to.room, y)?;
            }
            to.complete(0..rows)
        })?;
        output.apply(cx, context, 0..d, Epilogue::ADD, MatMut::new(hidden, rows, d)?)
    }

    /// Whether each head begins at a whole panel of queries, keys and values. Otherwise one thread computes
    /// all heads.
    fn heads_apart(&self) -> bool {
        self.d_kv.is_multiple_of(PANEL)
    }

    /// Computes the queries, keys and values of the heads in `columns` into `room`, and from them these
    /// columns of the context.
    #[expect(clippy::too_many_arguments, reason = "one phase of a layer, each operand named")]
    fn attend_heads(
        &self,
        cx: Compute,
        input: &Linear,
        x: Rows,
        columns: Range<usize>,
        lengths: &[usize],
        room: &mut [f32],
        context: MatMut<f32>,
    ) -> Result<(), StepError> {
        let (rows, inner, width) = (context.rows(), self.heads * self.d_kv, columns.len());
        // Int8 products cost queries, keys and values more precision than bfloat16 does.
        let attention = if input.is_quantized() { encoder_attention_bf16 } else { encoder_attention_f32 };
        let mut y = MatMut::new(room, rows, 3 * width)?;
        if width == inner {
            input.apply_here(cx.isa, x, 0..3 * inner, Epilogue::STORE, y.reborrow())?;
        } else {
            for kind in 0..3 {
                let (_, y) = y.reborrow().split_columns(kind * width);
                let outputs = kind * inner + columns.start..kind * inner + columns.end;
                input.apply_here(cx.isa, x, outputs, Epilogue::STORE, y.split_columns(width).0)?;
            }
        }
        let qkv = y.dense();
        heads_of(columns, self.d_kv, lengths.iter().copied(), context, |_, heads, at, rows, y| {
            let block = qkv.row_range(rows);
            let of = |kind: usize| block.columns(kind * width + at..kind * width + at + self.d_kv);
            attention(cx.isa, Operands::new(of(0), of(1), of(2), 1.0).biased(self.bias.of(heads.start, 0)), y)
        })
    }
}
