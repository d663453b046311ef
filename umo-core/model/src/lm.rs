//! The language model: T5 with expert feed-forwards, its inputs, and the codes it generates (paper sections
//! 3.1, 3.2; SPEC 2.2 to 2.5).

pub mod attention;
pub mod decoder;
pub mod depth;
pub mod encoder;
pub mod experts;
pub mod frames;
pub mod generate;
pub mod layout;
pub mod sampler;
pub mod tally;
pub mod text;

use std::ops::AddAssign;
use std::time::Duration;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::filled;
use umo_core_base::time::Instant;
use umo_kernels::gemm::Epilogue;
use umo_kernels::norm::rms_norm;
use umo_kernels::product::Rows;
use umo_kernels::{Mat, MatMut};

use crate::config::Config;
use crate::linear::{Compute, Linear, QuantScratch};
use crate::weights::{AlignedBox, Loader, Table};
use decoder::{CrossStorage, Decoder, Sequence};
use encoder::Encoder;
pub(crate) use encoder::EncoderPiece;
use tally::Tally;

/// Maximum sequence lengths that a model is loaded for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lengths {
    /// Encoder tokens.
    pub encoder: usize,
    /// Decoder tokens.
    pub decoder: usize,
}

impl Lengths {
    /// Lengths required by the model's own templates and chunks.
    pub fn of(config: &Config) -> Self {
        Self { encoder: layout::max_encoder_tokens(config), decoder: layout::max_decoder_tokens(config) }
    }
}

/// T5-MoE: embeddings, encoder and decoder.
#[derive(Debug)]
pub struct Lm {
    embedding: Table,
    encoder: Encoder,
    decoder: Decoder,
    /// Factor applied to hidden states before the head: `d_model^-0.5` if the head is tied to the embedding.
    head_scale: f32,
    d_model: usize,
    vocab: usize,
}

impl Lm {
    /// Loads `lm.*` for sequences of at most `lengths`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader, lengths: Lengths) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let (d_model, vocab) = (config.lm.d_model, config.vocab.size);
        Ok(Self {
            embedding: loader.table("lm.shared.weight", vocab, d_model)?,
            encoder: Encoder::load(loader, lengths.encoder)?,
            decoder: Decoder::load(&loader.for_few_rows(true), lengths.decoder)?,
            head_scale: head_scale(config),
            d_model,
            vocab,
        })
    }

    /// Width of the hidden states.
    pub fn d_model(&self) -> usize {
        self.d_model
    }

    /// Storage type of the encoder's keys and values in this model's sequences.
    pub fn cross_storage(&self) -> CrossStorage {
        self.decoder.cross_storage()
    }

    /// Runs the encoder over sequences stacked along the rows.
    ///
    /// Shapes: `ids [rows]`, `lengths` sum to `rows`, `hidden [rows, d_model]` (overwritten).
    ///
    /// # Errors
    /// [`StepError`] if an id is outside the vocabulary, or there are more rows than `scratch` has room for.
    pub fn encode(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        ids: &[u32],
        lengths: &[usize],
        hidden: &mut [f32],
    ) -> Result<(), StepError> {
        self.begin_encode(scratch, ids, lengths)?;
        (0..self.encoder_layers()).try_for_each(|layer| self.encode_layer(cx, scratch, layer, 0, lengths))?;
        self.end_encode(cx, scratch, lengths, hidden)
    }

    /// Number of encoder layers. [`Self::encode`] is [`Self::begin_encode`], then each layer in turn, then
    /// [`Self::end_encode`].
    pub fn encoder_layers(&self) -> usize {
        self.encoder.layers()
    }

    /// Embeds the ids of an encoder pass.
    ///
    /// # Errors
    /// As [`Self::encode`].
    pub fn begin_encode(&self, scratch: &mut LmScratch, ids: &[u32], lengths: &[usize]) -> Result<(), StepError> {
        scratch.check_rows(ids.len())?;
        self.encoder.check(lengths)?;
        if let Some(tally) = &mut scratch.tally {
            tally.begin_pass();
            tally.add_rows(ids);
        }
        self.embed(ids, &scratch.given, &mut scratch.hidden)
    }

    /// Runs one layer of an encoder pass over the sequences of `lengths`, whose rows begin at `first`. A
    /// layer can run over the whole pass at once or over groups of sequences in turn.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub(crate) fn encode_layer(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        layer: usize,
        first: usize,
        lengths: &[usize],
    ) -> Result<(), StepError> {
        self.encoder.layer(cx, scratch, layer, first, lengths)?;
        scratch.count(layer, first);
        Ok(())
    }

    /// Runs one piece of [`Self::encode_layer`] and returns the next, if any. All pieces of a layer must run
    /// in order, with no other use of the scratch in between.
    ///
    /// # Errors
    /// As [`Self::encode_layer`].
    pub(crate) fn encode_piece(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        layer: usize,
        (first, lengths): (usize, &[usize]),
        piece: EncoderPiece,
    ) -> Result<Option<EncoderPiece>, StepError> {
        let next = self.encoder.piece(cx, scratch, layer, (first, lengths), piece)?;
        if next.is_none() {
            scratch.count(layer, first);
        }
        Ok(next)
    }

    /// Number of weights of one encoder layer, including all experts.
    pub(crate) fn encoder_layer_weights(config: &Config) -> usize {
        let lm = &config.lm;
        lm.d_model * (4 * lm.num_heads * lm.d_kv + 3 * lm.experts * lm.d_ff)
    }

    /// Writes the final states of an encoder pass to `hidden [rows, d_model]`.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn end_encode(
        &self,
        cx: Compute,
        scratch: &LmScratch,
        lengths: &[usize],
        hidden: &mut [f32],
    ) -> Result<(), StepError> {
        self.encoder.finish(cx, scratch, lengths.iter().sum(), hidden)
    }

    /// Starts a sequence over encoder states `[rows, d_model]`.
    ///
    /// # Errors
    /// [`StepError`] if the sequence has too little room.
    pub fn attend_to(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        hidden: Mat<f32>,
        sequence: &mut Sequence,
    ) -> Result<(), StepError> {
        Decoder::begin(sequence, hidden.rows())?;
        (0..self.decoder_layers()).try_for_each(|layer| self.attend_layer(cx, scratch, layer, hidden, sequence))
    }

    /// Number of decoder layers. [`Self::attend_to`] is [`Self::begin_attend`], then [`Self::attend_layer`]
    /// for each layer.
    pub fn decoder_layers(&self) -> usize {
        self.decoder.layers()
    }

    /// Clears `sequence` and prepares it for `rows` encoder states.
    ///
    /// # Errors
    /// [`StepError`] if the sequence has too little room.
    pub fn begin_attend(&self, sequence: &mut Sequence, rows: usize) -> Result<(), StepError> {
        Decoder::begin(sequence, rows)
    }

    /// Computes the cross-attention's keys and values of one layer.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn attend_layer(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        layer: usize,
        hidden: Mat<f32>,
        sequence: &mut Sequence,
    ) -> Result<(), StepError> {
        self.decoder.attend_to(cx, scratch, layer, hidden, 0..hidden.rows(), sequence)
    }

    /// Computes the rows of [`Self::attend_layer`] from `row` on, up to the size of a piece. Returns the
    /// first row of the next piece, if any.
    ///
    /// # Errors
    /// As [`Self::attend_layer`].
    pub(crate) fn attend_piece(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        layer: usize,
        hidden: Mat<f32>,
        row: usize,
        sequence: &mut Sequence,
    ) -> Result<Option<usize>, StepError> {
        let rows = hidden.rows();
        let end = rows.min(row + piece_rows(rows, self.d_model * self.decoder.cross_width()));
        self.decoder.attend_to(cx, scratch, layer, hidden, row..end, sequence)?;
        Ok((end < rows).then_some(end))
    }

    /// Runs the decoder over the new ids of each sequence. The states after the final norm stay in `scratch`,
    /// one row per new id in order.
    ///
    /// # Errors
    /// [`StepError`] if an id is outside the vocabulary, a cache is full, or there are too many rows.
    pub fn decode(&self, cx: Compute, scratch: &mut LmScratch, sequences: &mut [Sequence]) -> Result<(), StepError> {
        self.begin_decode(scratch, sequences)?;
        (0..self.decoder_layers()).try_for_each(|layer| self.decode_layer(cx, scratch, layer, 0, sequences))?;
        self.end_decode(cx, scratch, sequences)
    }

    /// Embeds the new ids of a decoder pass.
    ///
    /// # Errors
    /// As [`Self::decode`].
    pub fn begin_decode(&self, scratch: &mut LmScratch, sequences: &[Sequence]) -> Result<(), StepError> {
        scratch.check_rows(sequences.iter().map(|s| s.ids().len()).sum())?;
        self.decoder.check(sequences)?;
        if let Some(tally) = &mut scratch.tally {
            tally.begin_pass();
            sequences.iter().for_each(|sequence| tally.add_rows(sequence.ids()));
        }
        let mut hidden = &mut scratch.hidden[..];
        for sequence in sequences {
            let (rows, rest) = hidden.split_at_mut(sequence.ids().len() * self.d_model);
            self.embed(sequence.ids(), &scratch.given, rows)?;
            hidden = rest;
        }
        Ok(())
    }

    /// Runs one layer of a decoder pass over `sequences`, whose rows begin at `first`. A layer can run over
    /// the whole pass at once or over groups of sequences in turn.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn decode_layer(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        layer: usize,
        first: usize,
        sequences: &mut [Sequence],
    ) -> Result<(), StepError> {
        self.decoder.layer(cx, scratch, layer, first, sequences)?;
        scratch.count(self.encoder_layers() + layer, first);
        Ok(())
    }

    /// Ends a decoder pass: appends its ids to the sequences.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn end_decode(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        sequences: &mut [Sequence],
    ) -> Result<(), StepError> {
        self.decoder.finish(cx, scratch, sequences)
    }

    /// Returns the logits of the whole vocabulary for the first `rows` rows of the last [`Self::decode`];
    /// `head` is from [`full_head`]. For checking a model, not for the stream.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn all_logits(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        head: &Linear,
        rows: usize,
    ) -> Result<Vec<f32>, StepError> {
        let mut logits = filled(0.0, rows * self.vocab);
        let states = Mat::new(&scratch.normed, rows, self.d_model)?;
        let y = MatMut::new(&mut logits, rows, self.vocab)?;
        head.forward(cx, &mut scratch.quant, states, Epilogue::STORE, y)?;
        logits.iter_mut().for_each(|v| *v *= self.head_scale);
        Ok(logits)
    }

    /// Copies the embedding rows of `ids`. Ids from the vocabulary's size on index the rows of `given`.
    fn embed(&self, ids: &[u32], given: &[f32], hidden: &mut [f32]) -> Result<(), StepError> {
        for (&id, hidden) in ids.iter().zip(hidden.chunks_exact_mut(self.d_model)) {
            let id = id as usize;
            match id.checked_sub(self.vocab) {
                None => self.embedding.gather(id, hidden),
                Some(row) => {
                    let limit = self.vocab + given.len() / self.d_model;
                    let values = given.get(row * self.d_model..(row + 1) * self.d_model);
                    let wrong = StepError::OutOfRange { what: "token id", got: id, limit };
                    hidden.copy_from_slice(values.ok_or(wrong)?);
                }
            }
        }
        Ok(())
    }
}

/// Multiply-adds in a piece of a layer: about 0.2 ms with AVX2.
const PIECE_WORK: usize = 10_000_000;
/// Granularity of a piece's rows: the number that kernels process together.
const PIECE_ROWS: usize = 6;

/// Number of rows per piece, for a product over `rows` rows of `work` multiply-adds each.
fn piece_rows(rows: usize, work: usize) -> usize {
    let pieces = ((rows * work + PIECE_WORK / 2) / PIECE_WORK).max(1);
    rows.div_ceil(pieces).next_multiple_of(PIECE_ROWS)
}

/// Approximate cost of normalising one value, in multiply-adds.
const NORM_WORK: usize = 4;

/// Writes the RMS norm of the first `rows` rows of `x` to `y`; the threads share the rows. The row width is
/// the length of `factors`.
fn norm(cx: Compute, x: &[f32], rows: usize, (factors, eps): (&[f32], f32), y: &mut [f32]) -> Result<(), StepError> {
    let d = factors.len();
    let (x, y) = (Mat::new(x, rows, d)?, MatMut::new(y, rows, d)?);
    cx.team.rows(y, rows * d * NORM_WORK, |range, y| Ok(rms_norm(cx.isa, x.row_range(range), factors, eps, y)?))
}

/// Like [`norm`], with the result prepared as input of `next`. While a normed row is in cache, `f` computes
/// the matching row of `also` from it, at `work` multiply-adds a row.
#[expect(clippy::too_many_arguments, reason = "one phase of a layer, each operand named")]
fn norm_input<'a>(
    cx: Compute,
    x: &[f32],
    (factors, eps): (&[f32], f32),
    y: &'a mut [f32],
    (next, quant): (&Linear, &'a mut QuantScratch),
    also: MatMut<f32>,
    work: usize,
    f: impl Fn(Mat<f32>, MatMut<f32>) -> Result<(), StepError> + Sync,
) -> Result<Rows<'a>, StepError> {
    let (d, rows) = (factors.len(), also.rows());
    let x = Mat::new(x, rows, d)?;
    quant.computed_rows(cx, next, y, also, rows * (d * NORM_WORK + work), |range, mut y, also| {
        rms_norm(cx.isa, x.row_range(range), factors, eps, y.reborrow())?;
        f(y.dense(), also)
    })
}

/// Callback for [`norm_input`] that computes nothing further.
fn no_more(_: Mat<f32>, _: MatMut<f32>) -> Result<(), StepError> {
    Ok(())
}

/// Factor applied to hidden states before the head.
#[expect(clippy::cast_precision_loss, reason = "widths are far below 2^24")]
fn head_scale(config: &Config) -> f32 {
    if config.lm.tie_word_embeddings { (config.lm.d_model as f32).sqrt().recip() } else { 1.0 }
}

/// Name of the output head's tensor.
fn head_name(config: &Config) -> &'static str {
    if config.lm.tie_word_embeddings { "lm.shared.weight" } else { "lm.lm_head.weight" }
}

/// Loads the whole output head, for [`Lm::all_logits`].
///
/// # Errors
/// [`LoadError`] naming the tensor.
pub fn full_head(loader: &Loader) -> Result<Linear, LoadError> {
    let config = loader.file().config();
    loader.exact().linear(&[head_name(config).to_owned()], &[config.vocab.size], config.lm.d_model)
}

/// Scratch memory for passes over at most `rows` rows.
#[derive(Debug)]
pub struct LmScratch {
    /// Residual stream, `[rows, d_model]`.
    pub(crate) hidden: AlignedBox<f32>,
    /// Inputs from outside the embedding table, `[given, d_model]`, addressed by ids from the vocabulary's
    /// size on.
    pub(crate) given: Box<[f32]>,
    /// Normed rows, `[rows, d_model]`; after a pass, the final states.
    pub(crate) normed: AlignedBox<f32>,
    /// Queries, keys and values, `[rows, 3 * heads * d_kv]`.
    pub(crate) qkv: AlignedBox<f32>,
    /// Attention output, `[rows, heads * d_kv]`.
    pub(crate) context: AlignedBox<f32>,
    /// Routing and the experts' hidden rows.
    pub(crate) experts: experts::ExpertScratch,
    /// Quantized inputs of a layer's halves, and the quantized output of the decoder's attention.
    pub(crate) quant: QuantScratch,
    /// Quantized intermediates: the output of the encoder's attention and the experts' hidden rows.
    pub(crate) middle: QuantScratch,
    /// Time spent in layers since the scratch was created.
    pub(crate) times: LayerTimes,
    /// Expert routing counts, if enabled.
    pub(crate) tally: Option<Tally>,
    rows: usize,
}

/// Time spent in the two halves of layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LayerTimes {
    /// Attention, with its norms and projections.
    pub attention: Duration,
    /// Expert feed-forwards, with their norms and routers.
    pub experts: Duration,
}

impl LayerTimes {
    /// Adds a layer whose attention took from `start` to `middle` and whose experts took from `middle` until
    /// now.
    fn add(&mut self, start: Instant, middle: Instant) {
        self.attention += middle - start;
        self.experts += middle.elapsed();
    }

    /// Time since an earlier reading.
    pub(crate) fn since(self, earlier: Self) -> Self {
        Self { attention: self.attention - earlier.attention, experts: self.experts - earlier.experts }
    }
}

impl AddAssign for LayerTimes {
    fn add_assign(&mut self, other: Self) {
        self.attention += other.attention;
        self.experts += other.experts;
    }
}

impl LmScratch {
    /// Allocates scratch for passes over at most `rows` rows in all.
    pub fn new(config: &Config, rows: usize) -> Self {
        Self::with_given(config, rows, 0)
    }

    /// Like [`Self::new`], with `given` rows of inputs from outside the embedding table.
    pub fn with_given(config: &Config, rows: usize, given: usize) -> Self {
        let lm = &config.lm;
        let inner = lm.num_heads * lm.d_kv;
        let (slots, widest) = (rows * lm.top_k, lm.d_model.max(inner));
        let zeros = AlignedBox::zeroed;
        Self {
            hidden: zeros(rows * lm.d_model),
            given: filled(0.0, given * lm.d_model).into(),
            normed: zeros(rows * lm.d_model),
            qkv: zeros(rows * 3 * inner),
            context: zeros(rows * inner),
            experts: experts::ExpertScratch::new(lm, rows),
            quant: QuantScratch::new(rows, widest),
            middle: QuantScratch::with_values(slots, (slots * lm.d_ff).max(rows * inner)).with_maxima(),
            times: LayerTimes::default(),
            tally: None,
            rows,
        }
    }

    /// Starts counting the experts that rows are sent to. Allocates, once.
    pub(crate) fn keep_tally(&mut self, config: &Config) {
        let layers = config.lm.num_layers + config.lm.num_decoder_layers;
        self.tally = Some(Tally::new(config, layers, self.rows));
    }

    /// Row `row` of the inputs from outside the embedding table.
    ///
    /// # Panics
    /// If `row` is out of range.
    pub fn given_mut(&mut self, row: usize) -> &mut [f32] {
        let width = self.hidden.len() / self.rows;
        &mut self.given[row * width..(row + 1) * width]
    }

    /// Number of inputs from outside the embedding table.
    pub fn given_rows(&self) -> usize {
        self.given.len() / (self.hidden.len() / self.rows)
    }

    /// The states of the last pass, `[rows, d_model]`.
    pub fn states(&self) -> &[f32] {
        &self.normed
    }

    fn count(&mut self, layer: usize, first: usize) {
        if let Some(tally) = &mut self.tally {
            tally.count(layer, first, &self.experts);
        }
    }

    fn check_rows(&self, rows: usize) -> Result<(), StepError> {
        match rows {
            0 => Err(StepError::Empty("tokens")),
            _ if rows > self.rows => Err(StepError::TooLong { what: "tokens", got: rows, limit: self.rows }),
            _ => Ok(()),
        }
    }
}
