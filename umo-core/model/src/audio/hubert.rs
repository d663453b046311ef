//! HuBERT as in Hugging Face's `HubertModel`, up to the last layer in the file.
//!
//! Convolutions run once per feature, layers with context once per window. The group norm of the first
//! convolution and the normalisation of the waveform need statistics over time. Both are computed over the
//! raw samples: the convolution has no bias, so normalising the waveform to variance 1 only rescales the
//! group norm's epsilon.

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{Arena, Slice, filled, with_capacity};
use umo_core_base::state::{StateError, StatePass};
use umo_core_base::team::zip_split;
use umo_kernels::activation;
use umo_kernels::activation::Activation;
use umo_kernels::attention::{Operands, encoder_attention_bf16, encoder_attention_f32};
use umo_kernels::gemm::Epilogue;
use umo_kernels::norm::{channel_affine, channel_sums, layer_norm};
use umo_kernels::product::{Bf16Form, Rows};
use umo_kernels::{Isa, Mat, MatMut, PANEL};

use crate::config;
use crate::linear::{Compute, Linear, QuantScratch};
use crate::weights::{AlignedBox, Loader, load_layers};

/// Added to a channel's variance in the group norm: PyTorch's default, which Hugging Face does not change.
const GROUP_NORM_EPS: f64 = 1e-5;
/// Added to the waveform's variance in its normalisation, as in Hugging Face's feature extractor.
const WAVE_EPS: f64 = 1e-7;
/// Number of features per pass of the convolutions.
const BLOCK: usize = 16;
/// Approximate cost of one element of a norm or an activation, in multiply-adds.
const ELEMENT_WORK: usize = 8;
/// Number of outputs of the first convolution that are computed and then processed while in cache.
const NEAR: usize = 32;

const GELU: Epilogue<'static> = Epilogue::STORE.then(Activation::Gelu);

/// The network.
#[derive(Debug)]
pub(super) struct Hubert {
    sizes: config::Hubert,
    isa: Isa,
    convolutions: Box<[Linear]>,
    /// Affine part of the group norm, `[conv_dim[0]]`.
    group_norm: Norm,
    projection_norm: Norm,
    projection: Linear,
    /// One product per group.
    position: Vec<Linear>,
    norm: Norm,
    layers: Box<[Layer]>,
}

#[derive(Debug)]
struct Norm {
    weight: Box<[f32]>,
    bias: Box<[f32]>,
    eps: f32,
}

#[derive(Debug)]
struct Layer {
    /// Queries, keys and values, `[3 * hidden, hidden]`.
    qkv: Linear,
    out: Linear,
    norm: Norm,
    up: Linear,
    down: Linear,
    final_norm: Norm,
}

/// Running statistics of a stream, in f64 and in temporal order, so that the splitting of the stream does not
/// change their bits.
#[derive(Debug)]
pub(super) struct Statistics {
    normalise: bool,
    /// Number of samples so far.
    samples: usize,
    /// Sum of the samples, and sum of their squares.
    wave: [f64; 2],
    /// Number of outputs of the first convolution so far.
    outputs: usize,
    /// Sums and sums of squares of the outputs, `[2, conv_dim[0]]`.
    channels: Slice<f64>,
}

/// Scratch memory for the convolutions of one call and the layers of one window.
#[derive(Debug)]
pub(super) struct Scratch {
    /// Outputs of convolutions 0, 2, 4 ...
    even: AlignedBox<f32>,
    /// Outputs of convolutions 1, 3, 5 ...
    odd: AlignedBox<f32>,
    /// Factor of the group norm per channel, `[conv_dim[0]]`.
    scale: Box<[f32]>,
    /// Summand of the group norm per channel, `[conv_dim[0]]`.
    shift: Box<[f32]>,
    /// Input of the position convolution, `[groups, window + 2 * (kernel / 2), hidden / groups]`.
    padded: AlignedBox<f32>,
    /// `[window, hidden]`.
    sum: AlignedBox<f32>,
    /// `[window, hidden]`.
    hidden: AlignedBox<f32>,
    /// `[window, 3 * hidden]`.
    qkv: AlignedBox<f32>,
    /// `[window, intermediate]`.
    inside: AlignedBox<f32>,
    /// Quantized input of any product.
    quant: QuantScratch,
}

impl Statistics {
    /// Resets the statistics.
    pub(super) fn clear(&mut self) {
        (self.samples, self.wave, self.outputs) = (0, [0.0; 2], 0);
        self.channels.fill(0.0);
    }

    /// Describes the statistics of a stream after `samples` samples.
    pub(super) fn state(&mut self, pass: &mut StatePass, samples: u64) -> Result<(), StateError> {
        // At most as many outputs as samples, including the outputs for silence before the stream.
        let outputs = pass.length("audio statistics", &mut self.outputs, 2 * samples.max(1))?;
        pass.must(outputs > 0 || samples == 0, "audio statistics")?;
        if pass.loads() {
            self.samples = usize::try_from(samples).unwrap_or(usize::MAX);
        }
        pass.f64s(&mut self.wave)?;
        pass.f64s(&mut self.channels)
    }

    /// Adds samples to the waveform's statistics.
    pub(super) fn add_waveform(&mut self, samples: &[f32]) {
        self.samples += samples.len();
        if self.normalise {
            for &sample in samples {
                self.wave[0] += f64::from(sample);
                self.wave[1] += f64::from(sample) * f64::from(sample);
            }
        }
    }

    /// Sample value that normalisation maps to zero: it fills the time before the stream.
    pub(super) fn silence(&self) -> f32 {
        if self.normalise { single(mean(self.wave[0], self.samples)) } else { 0.0 }
    }

    /// Factor of the group norm's epsilon, which is defined for the normalised waveform.
    fn wave_variance(&self) -> f64 {
        if self.normalise { variance(self.wave[0], self.wave[1], self.samples) + WAVE_EPS } else { 1.0 }
    }
}

#[expect(clippy::cast_precision_loss, reason = "2^53 samples are 17,000 years")]
fn mean(sum: f64, count: usize) -> f64 {
    sum / count.max(1) as f64
}

fn variance(sum: f64, squares: f64, count: usize) -> f64 {
    let average = mean(sum, count);
    (mean(squares, count) - average * average).max(0.0)
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of activations")]
fn single(value: f64) -> f32 {
    value as f32
}

/// Number of outputs of a convolution without padding.
fn outputs(inputs: usize, kernel: usize, stride: usize) -> usize {
    if inputs < kernel { 0 } else { (inputs - kernel) / stride + 1 }
}

impl Norm {
    fn load(loader: &Loader, name: &str, width: usize, eps: f32) -> Result<Self, LoadError> {
        let weight = loader.vector(&format!("{name}.weight"), width)?;
        Ok(Self { weight, bias: loader.vector(&format!("{name}.bias"), width)?, eps })
    }

    /// Applies the layer norm to every row of `x [rows, width]`.
    fn apply(&self, cx: Compute, x: &[f32], rows: usize, y: &mut [f32]) -> Result<(), StepError> {
        let width = self.weight.len();
        let (x, y) = (Mat::new(x, rows, width)?, MatMut::new(y, rows, width)?);
        cx.team.rows(y, rows * width * ELEMENT_WORK, |range, y| {
            Ok(layer_norm(cx.isa, x.row_range(range), &self.weight, &self.bias, self.eps, y)?)
        })
    }
}

impl Layer {
    fn load(loader: &Loader, name: &str, sizes: &config::Hubert) -> Result<Self, LoadError> {
        let (hidden, eps) = (sizes.hidden_size, sizes.layer_norm_eps);
        let projections = ["q_proj", "k_proj", "v_proj"].map(|p| format!("{name}.attention.{p}"));
        let mut bias = with_capacity(3 * hidden);
        for projection in &projections {
            bias.extend_from_slice(&loader.vector(&format!("{projection}.bias"), hidden)?);
        }
        let weights = projections.map(|projection| format!("{projection}.weight"));
        let (up, down) =
            (format!("{name}.feed_forward.intermediate_dense"), format!("{name}.feed_forward.output_dense"));
        Ok(Self {
            qkv: loader.linear(&weights, &[hidden; 3], hidden)?.with_bias(bias.into()),
            out: loader.linear_with_bias(&format!("{name}.attention.out_proj"), hidden, hidden)?,
            norm: Norm::load(loader, &format!("{name}.layer_norm"), hidden, eps)?,
            up: loader.linear_with_bias(&up, sizes.intermediate_size, hidden)?,
            down: loader.linear_with_bias(&down, hidden, sizes.intermediate_size)?,
            final_norm: Norm::load(loader, &format!("{name}.final_layer_norm"), hidden, eps)?,
        })
    }
}

impl Hubert {
    pub(super) fn load(loader: &Loader, sizes: &config::Hubert) -> Result<Self, LoadError> {
        let (root, hidden, eps) = ("audio.hubert", sizes.hidden_size, sizes.layer_norm_eps);
        let extractor = format!("{root}.feature_extractor.conv_layers");
        let layer = |i| Layer::load(loader, &format!("{root}.encoder.layers.{i}"), sizes);
        let layers = load_layers(sizes.num_hidden_layers, layer)?;
        let int8 = layers.iter().any(|layer| layer.qkv.is_quantized());
        let round = |product: Linear| if int8 { product.rounded() } else { product };
        let mut channels = 1;
        let mut convolutions = Vec::with_capacity(sizes.conv_dim.len());
        for (i, (&dim, &kernel)) in sizes.conv_dim.iter().zip(&sizes.conv_kernel).enumerate() {
            // Only ten samples per output: nothing to gain, and the group norm's statistics come from it.
            let loader = if i == 0 { loader.exact() } else { loader.clone() };
            convolutions.push(round(loader.conv(&format!("{extractor}.{i}.conv"), dim, channels, kernel, false)?));
            channels = dim;
        }
        let (kernel, groups) = (sizes.num_conv_pos_embeddings, sizes.num_conv_pos_embedding_groups);
        let position = format!("{root}.encoder.pos_conv_embed.conv");
        let position = loader.float().grouped_conv(&position, hidden, kernel, groups)?;
        let position = position.into_iter().map(round).collect();
        Ok(Self {
            sizes: sizes.clone(),
            isa: loader.isa(),
            convolutions: convolutions.into(),
            // Its epsilon is applied in f64, together with the statistics.
            group_norm: Norm::load(loader, &format!("{extractor}.0.layer_norm"), sizes.conv_dim[0], 0.0)?,
            projection_norm: Norm::load(loader, &format!("{root}.feature_projection.layer_norm"), channels, eps)?,
            projection: loader.linear_with_bias(&format!("{root}.feature_projection.projection"), hidden, channels)?,
            position,
            norm: Norm::load(loader, &format!("{root}.encoder.layer_norm"), hidden, eps)?,
            layers,
        })
    }

    /// Empty statistics.
    pub(super) fn statistics(&self, arena: &Arena) -> Statistics {
        let channels = arena.filled(0.0, 2 * self.sizes.conv_dim[0]);
        Statistics { normalise: self.sizes.do_normalize, samples: 0, wave: [0.0; 2], outputs: 0, channels }
    }

    /// All products whose input may be quantized.
    fn products(&self) -> impl Iterator<Item = &Linear> {
        let layers = self.layers.iter().flat_map(|layer| [&layer.qkv, &layer.out, &layer.up, &layer.down]);
        self.convolutions.iter().chain([&self.projection]).chain(layers)
    }

    /// Allocates scratch for the convolutions of `samples` samples and a window of `window` features.
    pub(super) fn scratch(&self, samples: usize, window: usize) -> Scratch {
        let sizes = &self.sizes;
        let mut len = [0_usize; 2];
        let (mut rows, mut dim) = (samples, 1);
        let mut parts = [0; 2];
        let need = |parts: &mut [usize; 2], product: &Linear, values: usize| {
            for part in parts.iter_mut().take(product.bf16_form(self.isa).map_or(0, Bf16Form::parts)) {
                *part = values.max(*part);
            }
        };
        let (mut most_rows, mut most_values) = (window, window * sizes.hidden_size.max(sizes.intermediate_size));
        for (i, (conv, &stride)) in self.convolutions.iter().zip(&sizes.conv_stride).enumerate() {
            need(&mut parts, conv, rows * dim);
            rows = outputs(rows, sizes.conv_kernel[i], stride);
            if conv.is_quantized() {
                (most_rows, most_values) = (most_rows.max(rows), most_values.max(rows * conv.inputs()));
            }
            dim = conv.outputs();
            len[i % 2] = len[i % 2].max(rows * dim);
        }
        // The projection's layer norm writes to the buffer that the last convolution does not.
        let last = self.convolutions.len() % 2;
        len[last] = len[last].max(rows * dim);
        let quantized = if self.products().any(Linear::is_quantized) { most_values.max(rows * dim) } else { 0 };
        let padded = window + 2 * (sizes.num_conv_pos_embeddings / 2);
        for group in &self.position {
            need(&mut parts, group, padded * sizes.hidden_size);
        }
        let zeros = AlignedBox::zeroed;
        Scratch {
            even: zeros(len[0]),
            odd: zeros(len[1]),
            scale: filled(0.0, sizes.conv_dim[0]).into(),
            shift: filled(0.0, sizes.conv_dim[0]).into(),
            padded: zeros(padded * sizes.hidden_size),
            sum: zeros(window * sizes.hidden_size),
            hidden: zeros(window * sizes.hidden_size),
            qkv: zeros(window * 3 * sizes.hidden_size),
            inside: zeros(window * sizes.intermediate_size),
            quant: QuantScratch::with_values(most_rows.max(rows), quantized).with_parts(parts),
        }
    }

    /// Adds the first convolution's outputs of a stream's new samples to the statistics; the waveform's
    /// statistics must be up to date. `waveform` holds `reach` earlier samples, then the new ones.
    pub(super) fn add_conv_outputs(
        &self,
        cx: Compute,
        statistics: &mut Statistics,
        scratch: &mut Scratch,
        waveform: &[f32],
        reach: usize,
    ) -> Result<(), StepError> {
        let (kernel, stride) = (self.sizes.conv_kernel[0], self.sizes.conv_stride[0]);
        let new = if statistics.samples + reach == waveform.len() {
            // The stream's first samples: windows that begin in the silence before them do not count.
            reach.div_ceil(stride)
        } else {
            // Windows that end before the new samples were already counted.
            (reach + 1).saturating_sub(kernel).div_ceil(stride)
        };
        let total = outputs(waveform.len(), kernel, stride);
        let (new, dim) = (new.min(total), self.sizes.conv_dim[0]);
        statistics.outputs += total - new;
        if new == total {
            return Ok(());
        }
        let x = Mat::with_stride(&waveform[new * stride..], total - new, kernel, stride)?;
        let (sums, room) = (MatMut::new(&mut statistics.channels, 2, dim)?, &mut scratch.even[..]);
        // Each thread handles its own channels, in temporal order, `near` outputs at a time while they are in
        // cache.
        let near = NEAR.min(room.len() / dim).max(1);
        let work = x.rows() * dim * (kernel + ELEMENT_WORK);
        let cut = zip_split(MatMut::split_columns, |room: &'_ mut [f32], at| room.split_at_mut(at * near));
        cx.team.split((sums, room), dim, PANEL, work, cut, |columns, (sums, room)| {
            let (mut sum, mut squares) = sums.split_rows(1);
            for start in (0..x.rows()).step_by(near) {
                let rows = x.row_range(start..(start + near).min(x.rows()));
                let mut y = MatMut::new(room, rows.rows(), columns.len())?;
                let first = &self.convolutions[0];
                first.apply_here(cx.isa, Rows::float(rows), columns.clone(), Epilogue::STORE, y.reborrow())?;
                channel_sums(cx.isa, y.dense(), sum.row_mut(0), squares.row_mut(0))?;
            }
            Ok(())
        })
    }

    /// Computes the features of block `block` of a stream's new samples; the statistics must be up to date.
    /// `features [n, hidden]` holds all blocks; only this block's are overwritten.
    #[expect(clippy::too_many_arguments, reason = "the stream's state, the scratch, the input, which part, the output")]
    pub(super) fn extract(
        &self,
        cx: Compute,
        statistics: &Statistics,
        scratch: &mut Scratch,
        waveform: &[f32],
        hop: usize,
        block: usize,
        features: &mut [f32],
    ) -> Result<(), StepError> {
        let hidden = self.sizes.hidden_size;
        let Some(features) = features.chunks_mut(BLOCK * hidden).nth(block) else { return Ok(()) };
        let start = block * BLOCK * hop;
        let end = start + (features.len() / hidden - 1) * hop + self.sizes.receptive_field();
        self.convolve(cx, statistics, scratch, &waveform[start..end], features)
    }

    /// Number of blocks in which `features` features are extracted.
    pub(super) fn blocks(features: usize) -> usize {
        features.div_ceil(BLOCK)
    }

    /// Number of samples that a block of at most `features` features covers.
    pub(super) fn block_samples(&self, features: usize, hop: usize) -> usize {
        (features.clamp(1, BLOCK) - 1) * hop + self.sizes.receptive_field()
    }

    /// Writes the feature of the given samples of silence to every row of `features`.
    pub(super) fn fill(
        &self,
        cx: Compute,
        statistics: &Statistics,
        scratch: &mut Scratch,
        silence: &[f32],
        features: &mut [f32],
    ) -> Result<(), StepError> {
        let hidden = self.sizes.hidden_size;
        if features.is_empty() {
            return Ok(());
        }
        self.convolve(cx, statistics, scratch, silence, &mut features[..hidden])?;
        let (silent, others) = features.split_at_mut(hidden);
        others.chunks_exact_mut(hidden).for_each(|row| row.copy_from_slice(silent));
        Ok(())
    }

    /// Runs the whole network on a clip: statistics first, then features in blocks, then the layers.
    /// Allocates.
    pub(super) fn features(
        &self,
        cx: Compute,
        audio: &[f32],
        hop: usize,
        features: &mut [f32],
    ) -> Result<(), StepError> {
        let window = features.len() / self.sizes.hidden_size;
        let mut scratch = self.scratch(self.block_samples(window, hop), window);
        let mut statistics = self.statistics(&Arena::system());
        statistics.add_waveform(audio);
        self.add_conv_outputs(cx, &mut statistics, &mut scratch, audio, 0)?;
        for block in 0..Self::blocks(window) {
            self.extract(cx, &statistics, &mut scratch, audio, hop, block, features)?;
        }
        let output = self.encode(cx, &mut scratch, features)?;
        features.copy_from_slice(output);
        Ok(())
    }

    /// Convolves raw samples to projected features.
    fn convolve(
        &self,
        cx: Compute,
        statistics: &Statistics,
        scratch: &mut Scratch,
        samples: &[f32],
        features: &mut [f32],
    ) -> Result<(), StepError> {
        let (sizes, mut dim) = (&self.sizes, self.sizes.conv_dim[0]);
        self.group_norm(statistics, &mut scratch.scale, &mut scratch.shift);
        let (scale, shift, first) = (&scratch.scale, &scratch.shift, &self.convolutions[0]);
        let (kernel, stride) = (sizes.conv_kernel[0], sizes.conv_stride[0]);
        let mut rows = outputs(samples.len(), kernel, stride);
        let waves = Mat::with_stride(samples, rows, kernel, stride)?;
        let work = rows * dim * (kernel + 2 * ELEMENT_WORK);
        // A few outputs at a time, normalised while they are in cache.
        cx.team.rows(MatMut::new(&mut scratch.even, rows, dim)?, work, |range, mut all| {
            for start in range.clone().step_by(NEAR) {
                let (mut x, rest) = all.split_rows(NEAR.min(range.end - start));
                let waves = Rows::float(waves.row_range(start..start + x.rows()));
                first.apply_here(cx.isa, waves, 0..dim, Epilogue::STORE, x.reborrow())?;
                channel_affine(cx.isa, x.reborrow(), scale, shift)?;
                for t in 0..x.rows() {
                    activation::apply(cx.isa, Activation::Gelu, x.row_mut(t));
                }
                all = rest;
            }
            Ok(())
        })?;
        let (mut x, mut y) = (&mut scratch.even, &mut scratch.odd);
        for (i, conv) in self.convolutions.iter().enumerate().skip(1) {
            let (kernel, stride) = (sizes.conv_kernel[i], sizes.conv_stride[i]);
            let count = outputs(rows, kernel, stride);
            let windows = Mat::with_stride(x, count, kernel * dim, stride * dim)?;
            (rows, dim) = (count, conv.outputs());
            conv.forward(cx, &mut scratch.quant, windows, GELU, MatMut::new(y, rows, dim)?)?;
            (x, y) = (y, x);
        }
        let count = features.len() / sizes.hidden_size;
        self.projection_norm.apply(cx, x, count, y)?;
        let features = MatMut::new(features, count, sizes.hidden_size)?;
        self.projection.forward(cx, &mut scratch.quant, Mat::new(y, count, dim)?, Epilogue::STORE, features)
    }

    /// Computes the group norm with the statistics so far, as one factor and one summand per channel.
    fn group_norm(&self, statistics: &Statistics, scale: &mut [f32], shift: &mut [f32]) {
        let (sums, squares) = statistics.channels.split_at(scale.len());
        let eps = GROUP_NORM_EPS * statistics.wave_variance();
        for (c, (scale, shift)) in scale.iter_mut().zip(shift).enumerate() {
            let spread = variance(sums[c], squares[c], statistics.outputs) + eps;
            let factor = f64::from(self.group_norm.weight[c]) / spread.sqrt();
            *scale = single(factor);
            *shift = single(f64::from(self.group_norm.bias[c]) - mean(sums[c], statistics.outputs) * factor);
        }
    }

    /// Runs the layers with context: `features [window, hidden]` to the last layer's output.
    fn encode<'a>(&self, cx: Compute, scratch: &'a mut Scratch, features: &[f32]) -> Result<&'a [f32], StepError> {
        self.begin_encode(cx, scratch, features)?;
        let window = features.len() / self.sizes.hidden_size;
        (0..self.layers.len()).try_for_each(|layer| self.encode_layer(cx, scratch, window, layer))?;
        Ok(self.encoded(scratch, window))
    }

    /// Runs the steps before the layers with context: positions and a norm.
    pub(super) fn begin_encode(&self, cx: Compute, scratch: &mut Scratch, features: &[f32]) -> Result<(), StepError> {
        let window = features.len() / self.sizes.hidden_size;
        self.add_positions(cx, scratch, features, window)?;
        self.norm.apply(cx, &scratch.sum, window, &mut scratch.hidden)
    }

    /// Number of layers with context.
    pub(super) fn layers(&self) -> usize {
        self.layers.len()
    }

    /// Runs one of these layers.
    pub(super) fn encode_layer(
        &self,
        cx: Compute,
        scratch: &mut Scratch,
        window: usize,
        layer: usize,
    ) -> Result<(), StepError> {
        self.layer(cx, &self.layers[layer], scratch, window)
    }

    /// Output of the last of these layers, `[window, hidden]`.
    pub(super) fn encoded<'a>(&self, scratch: &'a Scratch, window: usize) -> &'a [f32] {
        &scratch.hidden[..window * self.sizes.hidden_size]
    }

    /// `sum = features + gelu(convolution of features)`, padded with `kernel / 2` zeros on each side and cut
    /// to `window` rows.
    fn add_positions(
        &self,
        cx: Compute,
        scratch: &mut Scratch,
        features: &[f32],
        window: usize,
    ) -> Result<(), StepError> {
        let (hidden, kernel) = (self.sizes.hidden_size, self.sizes.num_conv_pos_embeddings);
        let width = hidden / self.position.len();
        let group_len = (window + 2 * (kernel / 2)) * width;
        let padded = &mut scratch.padded[..group_len * self.position.len()];
        padded.fill(0.0);
        for (t, row) in features.chunks_exact(hidden).enumerate() {
            for (group, values) in padded.chunks_exact_mut(group_len).zip(row.chunks_exact(width)) {
                group[(kernel / 2 + t) * width..][..width].copy_from_slice(values);
            }
        }
        let padded = &*padded;
        let form = self.position.first().and_then(|first| first.bf16_form(cx.isa));
        let values = form.map(|form| scratch.quant.to_bf16(cx, form, padded)).transpose()?;
        scratch.sum[..features.len()].copy_from_slice(features);
        let sum = MatMut::new(&mut scratch.sum, window, hidden)?;
        cx.team.columns(sum, width, window * kernel * hidden * width, |columns, mut rest| {
            for group in columns.start / width..columns.end / width {
                let (y, tail) = rest.split_columns(width);
                let (start, epilogue) = (group * group_len, Epilogue::ADD.then(Activation::Gelu));
                let windows = match &values {
                    Some(values) => values.rows(start, window, kernel * width, width)?,
                    None => Rows::float(Mat::with_stride(&padded[start..], window, kernel * width, width)?),
                };
                self.position[group].apply_here(cx.isa, windows, 0..width, epilogue, y)?;
                rest = tail;
            }
            Ok(())
        })
    }

    /// Runs one layer over `hidden`, in place.
    fn layer(&self, cx: Compute, layer: &Layer, scratch: &mut Scratch, window: usize) -> Result<(), StepError> {
        let (dim, ffn) = (self.sizes.hidden_size, self.sizes.intermediate_size);
        let Scratch { sum, hidden, qkv, inside, quant, .. } = scratch;
        let x = Mat::new(hidden, window, dim)?;
        layer.qkv.forward(cx, quant, x, Epilogue::STORE, MatMut::new(qkv, window, 3 * dim)?)?;
        self.attend(cx, &layer.qkv, Mat::new(qkv, window, 3 * dim)?, MatMut::new(sum, window, dim)?)?;
        layer.out.forward(cx, quant, Mat::new(sum, window, dim)?, Epilogue::ADD, MatMut::new(hidden, window, dim)?)?;
        layer.norm.apply(cx, hidden, window, sum)?;
        layer.up.forward(cx, quant, Mat::new(sum, window, dim)?, GELU, MatMut::new(inside, window, ffn)?)?;
        layer.down.forward(cx, quant, Mat::new(inside, window, ffn)?, Epilogue::ADD, MatMut::new(sum, window, dim)?)?;
        layer.final_norm.apply(cx, sum, window, hidden)
    }

    /// Attention of every head: from `qkv [window, 3 * hidden]`, the output of `input`, to
    /// `y [window, hidden]`.
    #[expect(clippy::cast_precision_loss, reason = "a head is at most 2^16 wide")]
    fn attend(&self, cx: Compute, input: &Linear, qkv: Mat<f32>, y: MatMut<f32>) -> Result<(), StepError> {
        let (window, dim) = (y.rows(), self.sizes.hidden_size);
        let head_dim = dim / self.sizes.num_attention_heads;
        let scale = 1.0 / (head_dim as f32).sqrt();
        let attention = if input.is_quantized() { encoder_attention_bf16 } else { encoder_attention_f32 };
        cx.team.columns(y, head_dim, 2 * window * window * dim, |columns, mut rest| {
            for start in columns.step_by(head_dim) {
                let (y, tail) = rest.split_columns(head_dim);
                let [q, k, v] = [0, dim, 2 * dim].map(|part| qkv.columns(part + start..part + start + head_dim));
                attention(cx.isa, Operands::new(q, k, v, scale), y)?;
                rest = tail;
            }
            Ok(())
        })
    }
}
