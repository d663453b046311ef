//! The decoder: new rows against cached keys and values (paper section 3.1; SPEC 2.4, 2.5).

use std::ops::Range;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::filled;
use umo_core_base::time::Instant;
use umo_kernels::attention::{Operands, Visible, attention_bf16, attention_f32};
use umo_kernels::bf16::round_bf16;
use umo_kernels::gemm::Epilogue;
use umo_kernels::{Bf16, Isa, Mat, MatMut, PrefetchHint, ShapeError};

use super::attention::{PositionBias, Projections, for_each_head, projection};
use super::experts::Experts;
use super::{Lengths, LmScratch, no_more, norm, norm_input};
use crate::config::Config;
use crate::linear::{Compute, Linear};
use crate::weights::{AlignedBox, Loader, load_layers};

/// Approximate cost of rounding one value to bfloat16 and storing it, in multiply-adds.
const ROUND_WORK: usize = 8;

/// Approximate cost of reading one element of a key or value, in multiply-adds. It comes from memory, since a
/// pass reads more weights than the caches hold.
const READ_WORK: usize = 16;

/// The decoder stack.
#[derive(Debug)]
pub(super) struct Decoder {
    layers: Box<[Layer]>,
    bias: PositionBias,
    norm: Box<[f32]>,
    eps: f32,
    heads: usize,
    d_kv: usize,
}

#[derive(Debug)]
struct Layer {
    self_norm: Box<[f32]>,
    self_attention: Projections,
    cross_norm: Box<[f32]>,
    cross_attention: Projections,
    /// `[2 * inner, d]`: projection of the encoder's states to keys and values.
    cross_kv: Linear,
    experts: Experts,
}

/// Storage type of the keys and values of the encoder's states. Every pass reads all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CrossStorage {
    /// Unrounded.
    F32,
    /// Rounded to bfloat16: halves the reads.
    Bf16,
}

/// Keys and values of the encoder's states in all layers.
#[derive(Debug)]
enum Cross {
    /// `[layers, cross_max, 2 * inner]`: keys, then values, as the product writes them.
    F32(AlignedBox<f32>),
    /// `[layers, 2 * heads, cross_max, d_kv]`: keys of every head, then values, so that each head is
    /// contiguous.
    Bf16(AlignedBox<Bf16>),
}

/// Keys and values of one sequence: for the encoder's states and for the ids decoded so far.
#[derive(Debug)]
struct DecoderCache {
    /// `[layers, 2 * heads, own_max, d_kv]`: keys of every head, then values, so that each head is
    /// contiguous.
    own: AlignedBox<f32>,
    cross: Cross,
    own_len: usize,
    cross_len: usize,
    own_max: usize,
    cross_max: usize,
    /// Number of elements of the keys and values of one position in one layer.
    width: usize,
    d_kv: usize,
}

impl DecoderCache {
    /// Allocates caches for sequences of at most `lengths`.
    fn new(config: &Config, lengths: Lengths, storage: CrossStorage) -> Self {
        let (layers, d_kv) = (config.lm.num_decoder_layers, config.lm.d_kv);
        let width = 2 * config.lm.num_heads * d_kv;
        let (own_max, cross_max) = (lengths.decoder, lengths.encoder);
        Self {
            own: AlignedBox::zeroed(layers * own_max * width),
            cross: match storage {
                CrossStorage::F32 => Cross::F32(AlignedBox::zeroed(layers * cross_max * width)),
                CrossStorage::Bf16 => Cross::Bf16(AlignedBox::zeroed(layers * cross_max * width)),
            },
            own_len: 0,
            cross_len: 0,
            own_max,
            cross_max,
            width,
            d_kv,
        }
    }

    /// The first `rows` keys and values of a head's self-attention.
    fn own_head(&self, layer: usize, head: usize, rows: usize) -> [&[f32]; 2] {
        self.of_head(&self.own, layer, head, self.own_max, rows)
    }

    /// The keys and values of a head in [`Cross::Bf16`].
    fn cross_head<'a>(&self, cross: &'a [Bf16], layer: usize, head: usize) -> [&'a [Bf16]; 2] {
        self.of_head(cross, layer, head, self.cross_max, self.cross_len)
    }

    /// The first `rows` of up to `max` keys and values of a head in
    /// `all [layers, 2 * heads, max, d_kv]`.
    fn of_head<'a, T>(&self, all: &'a [T], layer: usize, head: usize, max: usize, rows: usize) -> [&'a [T]; 2] {
        let values = self.width / self.d_kv / 2;
        let start = |row| layer * max * self.width + row * max * self.d_kv;
        [head, values + head].map(|row| &all[start(row)..start(row) + rows * self.d_kv])
    }

    /// Prefetch hint for the start of a head's keys and values in cross-attention.
    fn cross_prefetch_hint(&self, isa: Isa, layer: usize, head: usize) -> PrefetchHint<'_> {
        match &self.cross {
            Cross::F32(_) => PrefetchHint::NONE,
            Cross::Bf16(cross) => prefetch_hint(isa, self.cross_head(cross, layer, head)),
        }
    }

    /// Start of a layer in [`Cross`].
    fn cross_start(&self, layer: usize) -> usize {
        layer * self.cross_max * self.width
    }
}

/// One sequence: the ids for the next pass, and the cached keys and values of earlier ids.
#[derive(Debug)]
pub struct Sequence {
    /// `[own_max]`; the first `count` are new.
    ids: Box<[u32]>,
    count: usize,
    cache: DecoderCache,
}

impl Sequence {
    /// Allocates a sequence of at most `lengths`, without ids.
    /// [`Lm::cross_storage`](super::Lm::cross_storage) gives the storage type for a model.
    pub fn new(config: &Config, lengths: Lengths, storage: CrossStorage) -> Self {
        Self { ids: filled(0, lengths.decoder).into(), count: 0, cache: DecoderCache::new(config, lengths, storage) }
    }

    /// Ids that the next pass decodes; if empty, the pass skips the sequence.
    pub fn ids(&self) -> &[u32] {
        &self.ids[..self.count]
    }

    /// Sets the ids that the next pass decodes.
    ///
    /// # Errors
    /// [`StepError::TooLong`] if there are more ids than the sequence has room for.
    pub fn set_ids(&mut self, ids: &[u32]) -> Result<(), StepError> {
        let limit = self.ids.len();
        let room = self.ids.get_mut(..ids.len());
        room.ok_or(StepError::TooLong { what: "decoder tokens", got: ids.len(), limit })?.copy_from_slice(ids);
        self.count = ids.len();
        Ok(())
    }
}

impl Decoder {
    pub(super) fn load(loader: &Loader, positions: usize) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let lm = &config.lm;
        let layer = |i: usize| {
            let block = format!("lm.decoder.block.{i}.layer");
            let norm = |j: usize| loader.vector(&format!("{block}.{j}.layer_norm.weight"), lm.d_model);
            let cross = format!("{block}.1.EncDecAttention");
            Ok(Layer {
                self_norm: norm(0)?,
                self_attention: Projections::load(loader, &format!("{block}.0.SelfAttention"), lm, &["q", "k", "v"])?,
                cross_norm: norm(1)?,
                cross_attention: Projections::load(loader, &cross, lm, &["q"])?,
                // This product runs over all of the encoder's states at once.
                cross_kv: projection(&loader.for_few_rows(false), &cross, lm, &["k", "v"])?,
                experts: Experts::load(loader, &format!("{block}.2"), lm)?,
            })
        };
        let bias = "lm.decoder.block.0.layer.0.SelfAttention.relative_attention_bias.weight";
        Ok(Self {
            layers: load_layers(lm.num_decoder_layers, layer)?,
            bias: PositionBias::load(loader, bias, lm, false, positions)?,
            norm: loader.vector("lm.decoder.final_layer_norm.weight", lm.d_model)?,
            eps: lm.layer_norm_epsilon,
            heads: lm.num_heads,
            d_kv: lm.d_kv,
        })
    }

    /// Returns bfloat16 if int8 products compute the keys and values: those lose more precision than bfloat16
    /// does.
    pub(super) fn cross_storage(&self) -> CrossStorage {
        let int8 = self.layers.iter().all(|layer| layer.cross_kv.is_quantized());
        if int8 { CrossStorage::Bf16 } else { CrossStorage::F32 }
    }

    /// Number of layers.
    pub(super) fn layers(&self) -> usize {
        self.layers.len()
    }

    /// Clears the decoded ids of `sequence` and makes room for the keys and values of `rows` encoder states,
    /// which [`Self::attend_to`] fills layer by layer.
    pub(super) fn begin(sequence: &mut Sequence, rows: usize) -> Result<(), StepError> {
        let cache = &mut sequence.cache;
        if rows > cache.cross_max {
            return Err(StepError::TooLong { what: "encoder tokens", got: rows, limit: cache.cross_max });
        }
        (cache.cross_len, cache.own_len, sequence.count) = (rows, 0, 0);
        Ok(())
    }

    /// Computes the keys and values of the rows `range` of encoder states `[rows, d_model]` in one layer.
    pub(super) fn attend_to(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        index: usize,
        states: Mat<f32>,
        range: Range<usize>,
        sequence: &mut Sequence,
    ) -> Result<(), StepError> {
        let (cache, cross_kv) = (&mut sequence.cache, &self.layers[index].cross_kv);
        let (start, all, width, d_kv) = (cache.cross_start(index), cache.cross_len, cache.width, self.d_kv);
        if states.rows() != all || range.end > all {
            return Err(StepError::Disagree("encoder states and the sequence that attends to them"));
        }
        let (rows, above) = (range.len(), range.start);
        let states = states.row_range(range);
        let LmScratch { qkv, quant, .. } = scratch;
        match &mut cache.cross {
            Cross::F32(cross) => {
                let y = MatMut::new(&mut cross[start + above * width..], rows, width)?;
                cross_kv.forward(cx, quant, states, Epilogue::STORE, y)
            }
            Cross::Bf16(cross) => {
                cross_kv.forward(cx, quant, states, Epilogue::STORE, MatMut::new(qkv, rows, width)?)?;
                let exact = Mat::new(qkv, rows, width)?;
                let cross = &mut cross[start + above * d_kv..];
                let heads = MatMut::with_stride(cross, 2 * self.heads, rows * d_kv, cache.cross_max * d_kv)?;
                cx.team.rows(heads, rows * width * ROUND_WORK, |range, mut heads| {
                    for (i, head) in range.enumerate() {
                        let x = exact.columns(head * d_kv..(head + 1) * d_kv);
                        round_bf16(cx.isa, x, MatMut::new(heads.row_mut(i), rows, d_kv)?)?;
                    }
                    Ok(())
                })
            }
        }
    }

    /// Checks that the new ids of `sequences` can be decoded.
    pub(super) fn check(&self, sequences: &[Sequence]) -> Result<(), StepError> {
        for sequence in sequences.iter().filter(|s| s.count > 0) {
            let got = sequence.cache.own_len + sequence.count;
            let limit = sequence.cache.own_max.min(self.bias.positions());
            if got > limit {
                return Err(StepError::TooLong { what: "decoder tokens", got, limit });
            }
            if sequence.cache.cross_len == 0 {
                return Err(StepError::Order("the decoder was run before the encoder"));
            }
        }
        Ok(())
    }

    /// Number of outputs of the product for the cross-attention's keys and values.
    pub(super) fn cross_width(&self) -> usize {
        2 * self.heads * self.d_kv
    }

    /// Runs layer `index` over the rows of `scratch.hidden` from `first` on, which hold the new ids of
    /// `sequences` in order.
    pub(super) fn layer(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        index: usize,
        first: usize,
        sequences: &mut [Sequence],
    ) -> Result<(), StepError> {
        let d = self.norm.len();
        let rows = sequences.iter().map(|s| s.count).sum::<usize>();
        let (layer, start, rows_of) = (&self.layers[index], Instant::now(), first * d..(first + rows) * d);
        self.attend_own(cx, scratch, (index, layer), sequences, rows_of.clone())?;
        self.attend_cross(cx, scratch, (index, layer), sequences, rows_of.clone())?;
        let middle = Instant::now();
        let LmScratch { hidden, normed, experts, quant, middle: inside, .. } = scratch;
        let then = || {
            if let Some(next) = self.layers.get(index + 1) {
                next.self_attention.input.prefetch_next(cx);
            }
        };
        layer.experts.forward(cx, (quant, inside), experts, &mut hidden[rows_of], &mut normed[..rows * d], then)?;
        scratch.times.add(start, middle);
        Ok(())
    }

    /// Ends a pass: appends the new ids to the sequences, and leaves the states after the final norm in
    /// `scratch.normed`.
    pub(super) fn finish(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        sequences: &mut [Sequence],
    ) -> Result<(), StepError> {
        let rows = sequences.iter().map(|s| s.count).sum::<usize>();
        for sequence in sequences {
            sequence.cache.own_len += sequence.count;
        }
        let LmScratch { hidden, normed, .. } = scratch;
        norm(cx, hidden, rows, (&self.norm, self.eps), normed)
    }

    /// Causal attention of the new rows over everything decoded so far. `rows` is their range of elements in
    /// `scratch.hidden`.
    fn attend_own(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        (index, layer): (usize, &Layer),
        sequences: &mut [Sequence],
        rows: Range<usize>,
    ) -> Result<(), StepError> {
        let (d, inner) = (self.norm.len(), self.heads * self.d_kv);
        let LmScratch { hidden, normed, qkv, context, quant, .. } = scratch;
        let (hidden, rows) = (&mut hidden[rows.clone()], rows.len() / d);
        let (input, none) = (&layer.self_attention.input, MatMut::new(&mut [], rows, 0)?);
        let x = norm_input(cx, hidden, (&layer.self_norm, self.eps), normed, (input, quant), none, 0, no_more)?;
        layer.self_attention.output.prefetch_next(cx);
        input.apply(cx, x, 0..3 * inner, Epilogue::STORE, MatMut::new(qkv, rows, 3 * inner)?)?;
        let qkv = Mat::new(qkv, rows, 3 * inner)?;
        append(sequences, index, qkv.columns(inner..3 * inner));

        let context = &mut context[..rows * inner];
        let keys = sequences.iter().map(|s| s.cache.own_len + s.count).max().unwrap_or(0);
        self.heads(cx, sequences, keys, qkv.columns(0..inner), context, |sequence, heads, q, y| {
            let first = sequence.cache.own_len;
            let (cache, rows) = (&sequence.cache, first + sequence.count);
            let next = heads.clone().nth(1);
            let hint = next.map_or(PrefetchHint::NONE, |head| prefetch_hint(cx.isa, cache.own_head(index, head, rows)));
            let [k, v] = cache.own_head(index, heads.start, rows).map(|values| Mat::new(values, rows, self.d_kv));
            let operands = Operands::new(q, k?, v?, 1.0).biased(self.bias.of(heads.start, first));
            attention_f32(cx.isa, operands.seeing(Visible::Causal { first }).hinting(hint), y)
        })?;
        layer.cross_attention.input.prefetch_next(cx);
        let context = Mat::new(context, rows, inner)?;
        layer.self_attention.output.forward(cx, quant, context, Epilogue::ADD, MatMut::new(hidden, rows, d)?)
    }

    /// Attention of the new rows over the encoder's states. `rows` is their range of elements in
    /// `scratch.hidden`.
    fn attend_cross(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        (index, layer): (usize, &Layer),
        sequences: &[Sequence],
        rows: Range<usize>,
    ) -> Result<(), StepError> {
        let (d, inner) = (self.norm.len(), self.heads * self.d_kv);
        let LmScratch { hidden, normed, qkv, context, quant, .. } = scratch;
        let (hidden, rows) = (&mut hidden[rows.clone()], rows.len() / d);
        let (input, none) = (&layer.cross_attention.input, MatMut::new(&mut [], rows, 0)?);
        let x = norm_input(cx, hidden, (&layer.cross_norm, self.eps), normed, (input, quant), none, 0, no_more)?;
        // Each thread prefetches its first head of the first sequence.
        cx.team.prefetch_next(inner, self.d_kv, |columns| {
            sequences
                .first()
                .map_or(PrefetchHint::NONE, |s| s.cache.cross_prefetch_hint(cx.isa, index, columns.start / self.d_kv))
        });
        input.apply(cx, x, 0..inner, Epilogue::STORE, MatMut::new(qkv, rows, inner)?)?;

        layer.cross_attention.output.prefetch_next(cx);
        let (q, context) = (Mat::new(qkv, rows, inner)?, &mut context[..rows * inner]);
        let keys = sequences.iter().map(|s| s.cache.cross_len).max().unwrap_or(0);
        self.heads(cx, sequences, keys, q, context, |sequence, heads, q, y| {
            self.attend_head(cx, &sequence.cache, (index, heads), q, y)
        })?;
        layer.experts.prefetch_next(cx);
        let context = Mat::new(context, rows, inner)?;
        layer.cross_attention.output.forward(cx, quant, context, Epilogue::ADD, MatMut::new(hidden, rows, d)?)
    }

    /// Cross-attention of the first of `heads`; the second is prefetched.
    fn attend_head(
        &self,
        cx: Compute,
        cache: &DecoderCache,
        (index, heads): (usize, Range<usize>),
        q: Mat<f32>,
        y: MatMut<f32>,
    ) -> Result<(), ShapeError> {
        let (head, rows, d_kv) = (heads.start, cache.cross_len, self.d_kv);
        match &cache.cross {
            Cross::F32(cross) => {
                let kv = Mat::new(&cross[cache.cross_start(index)..], rows, cache.width)?;
                let of = |column: usize| kv.columns(column * d_kv..(column + 1) * d_kv);
                attention_f32(cx.isa, Operands::new(q, of(head), of(self.heads + head), 1.0), y)
            }
            Cross::Bf16(cross) => {
                let next = heads.clone().nth(1);
                let hint =
                    next.map_or(PrefetchHint::NONE, |head| prefetch_hint(cx.isa, cache.cross_head(cross, index, head)));
                let [k, v] = cache.cross_head(cross, index, head).map(|values| Mat::new(values, rows, d_kv));
                attention_bf16(cx.isa, Operands::new(q, k?, v?, 1.0).hinting(hint), y)
            }
        }
    }

    /// Calls `f(sequence, heads, queries, output)` for every sequence with new rows and every head, the first
    /// of `heads`. `keys` is the maximum number of keys, for estimating the work.
    fn heads(
        &self,
        cx: Compute,
        sequences: &[Sequence],
        keys: usize,
        q: Mat<f32>,
        context: &mut [f32],
        f: impl Fn(&Sequence, Range<usize>, Mat<f32>, MatMut<f32>) -> Result<(), ShapeError> + Sync,
    ) -> Result<(), StepError> {
        let work = 2 * (q.rows() + READ_WORK) * keys * q.cols();
        let y = MatMut::new(context, q.rows(), q.cols())?;
        for_each_head(cx, self.d_kv, sequences.iter().map(|s| s.count), work, y, |sequence, heads, rows, y| {
            let q = q.row_range(rows).columns(heads.start * self.d_kv..(heads.start + 1) * self.d_kv);
            f(&sequences[sequence], heads, q, y)
        })
    }
}

/// Prefetch hint for keys and values.
fn prefetch_hint<T>(isa: Isa, [keys, values]: [&[T]; 2]) -> PrefetchHint<'_> {
    PrefetchHint::new(keys, values).tuned_for(isa)
}

/// Appends each sequence's new keys and values, rows of `kv`, to its cache of one layer.
fn append(sequences: &mut [Sequence], layer: usize, kv: Mat<f32>) {
    let mut row = 0;
    for sequence in sequences {
        let count = sequence.count;
        let cache = &mut sequence.cache;
        let heads = cache.own[layer * cache.own_max * cache.width..].chunks_exact_mut(cache.own_max * cache.d_kv);
        for (head, out) in heads.take(cache.width / cache.d_kv).enumerate() {
            let out = out[cache.own_len * cache.d_kv..].chunks_exact_mut(cache.d_kv);
            for (i, out) in out.take(count).enumerate() {
                out.copy_from_slice(&kv.row(row + i)[head * cache.d_kv..(head + 1) * cache.d_kv]);
            }
        }
        row += count;
    }
}
