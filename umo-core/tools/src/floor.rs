//! Floor of each stage of a chunk: its least work, and the time of that at the processor's measured peaks.
//!
//! A floor is the greater of two times. One is the bytes that must be read (weights, keys and values) over the
//! bandwidth, a cache's for weights that are read repeatedly. The other is the multiply-adds of the products over the
//! peak of the back-end's instructions. Norms, activations, sampling, quantizing and copying count as nothing, and in
//! the decoder all tokens are assumed to choose the same expert. So nothing can be faster than its floor, and code at
//! its floor cannot be improved.

use std::fmt;
use std::ops::{Add, Mul};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use umo_kernels::{Isa, peak};

use umo_core_base::aligned::AlignedBox;
use umo_core_base::time::Instant;
use umo_core_model::config::{Codec, Config, MelNetwork, TemplateItem};
use umo_core_model::lm::layout::window_tokens;
use umo_core_pose::part::Part;

/// Least work of one call.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Floor {
    /// Weights, keys and values that are read once, bytes.
    pub bytes: usize,
    /// Weights that are read repeatedly from a cache, because each use depends on the previous result.
    pub cache_bytes: usize,
    /// Multiply-adds of products with int8 weights, and of attention: at best as fast as int8 products.
    pub macs: usize,
    /// Multiply-adds of products with float weights.
    pub float_macs: usize,
}

impl Add for Floor {
    type Output = Self;

    fn add(self, more: Self) -> Self {
        Self {
            bytes: self.bytes + more.bytes,
            cache_bytes: self.cache_bytes + more.cache_bytes,
            macs: self.macs + more.macs,
            float_macs: self.float_macs + more.float_macs,
        }
    }
}

impl Mul<usize> for Floor {
    type Output = Self;

    fn mul(self, times: usize) -> Self {
        Self {
            bytes: self.bytes * times,
            cache_bytes: self.cache_bytes * times,
            macs: self.macs * times,
            float_macs: self.float_macs * times,
        }
    }
}

impl Floor {
    /// Work for `times` as many rows; bytes are read once for all of them.
    #[must_use]
    pub fn rows(self, times: usize) -> Self {
        Self { macs: self.macs * times, float_macs: self.float_macs * times, ..self }
    }
}

/// Storage of weights during computation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stored {
    /// Four bits, and one eight-bit multiplier per 32 weights.
    Int4,
    /// One byte.
    Int8,
    /// Two bytes.
    Bf16,
    /// Four bytes.
    F32,
}

impl Stored {
    /// Bytes of this number of weights.
    pub const fn bytes(self, weights: usize) -> usize {
        match self {
            Self::Int4 => weights / 2 + weights / 32,
            Self::Int8 => weights,
            Self::Bf16 => 2 * weights,
            Self::F32 => 4 * weights,
        }
    }

    /// Whether activations are quantized, too.
    const fn is_quantized(self) -> bool {
        matches!(self, Self::Int4 | Self::Int8)
    }

    /// Product of `rows` rows with this number of weights.
    fn product(self, rows: usize, weights: usize) -> Floor {
        let (bytes, macs) = (self.bytes(weights), rows * weights);
        if self.is_quantized() {
            Floor { bytes, macs, ..Floor::default() }
        } else {
            Floor { bytes, float_macs: macs, ..Floor::default() }
        }
    }
}

/// Floors of a chunk's stages, named like the times in `StageTimes`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stages {
    /// Audio tokenizer.
    pub tokenizer: Floor,
    /// Attention of the encoder, including its projections.
    pub encoder_attention: Floor,
    /// Experts of the encoder.
    pub encoder_experts: Floor,
    /// Keys and values of the encoder's states: one product of many rows, before the first decoder step.
    pub cross: Floor,
    /// Both attentions of the decoder, including their other projections, and the heads.
    pub decoder_attention: Floor,
    /// Experts of the decoder.
    pub decoder_experts: Floor,
    /// Depth network, in layout `frames`: its layers are read from a cache for every code.
    pub depth: Floor,
    /// Interpolation network.
    pub interp: Floor,
    /// Motion decoders and root network.
    pub motion: Floor,
}

impl Stages {
    /// Floors of a chunk of `target` keyframes, for one speaking avatar.
    pub fn of(config: &Config, stored: Stored, target: usize) -> Self {
        let tokens = encoder_tokens(config, target);
        let steps = if config.is_frames() { target } else { 4 * target };
        let (encoder_attention, encoder_experts) = encoder(config, stored, tokens);
        // Two ids start a chunk, two markers separate parts, and the last code is not decoded. A keyframe is one row.
        let rows = if config.is_frames() { steps } else { steps + 7 };
        let (attention, experts) = step(config, stored, tokens);
        let more_rows = |floor: Floor| Floor {
            macs: floor.macs / steps * rows,
            float_macs: floor.float_macs / steps * rows,
            ..floor
        };
        Self {
            tokenizer: tokenizer(config, stored, target),
            encoder_attention,
            encoder_experts,
            cross: cross(config, stored, tokens),
            decoder_attention: more_rows(attention * steps) + head(config) * steps,
            decoder_experts: more_rows(experts * steps),
            depth: depth(config, stored, target),
            interp: interp(config, stored, target),
            motion: motion(config, stored, target),
        }
    }
}

/// Encoder tokens of a speaking avatar.
pub fn encoder_tokens(config: &Config, target: usize) -> usize {
    let items = config.templates.get("audio_to_motion").map_or(&[][..], Vec::as_slice);
    let len = |item: &TemplateItem| match item {
        TemplateItem::Id(_) => 1,
        TemplateItem::Name(name) if name == "audio" => window_tokens(config, target) + 2,
        TemplateItem::Name(name) if name == "text" => 0,
        TemplateItem::Name(name) if name == "history" => config.prefix,
        TemplateItem::Name(_) => config.prefix + 2,
    };
    items.iter().map(len).sum()
}

/// Weights of one attention's four projections.
fn projections(config: &Config) -> usize {
    4 * config.lm.d_model * config.lm.num_heads * config.lm.d_kv
}

/// Weights of one expert.
fn expert(config: &Config) -> usize {
    3 * config.lm.d_model * config.lm.d_ff
}

/// The encoder's attention and experts for `tokens` tokens, which choose every expert between them.
pub fn encoder(config: &Config, stored: Stored, tokens: usize) -> (Floor, Floor) {
    let lm = &config.lm;
    let pairs = Floor { macs: 2 * tokens * tokens * lm.num_heads * lm.d_kv, ..Floor::default() };
    let experts = stored.product(tokens, lm.top_k * expert(config));
    let experts = Floor { bytes: stored.bytes(lm.experts * expert(config)), ..experts };
    ((stored.product(tokens, projections(config)) + pairs) * lm.num_layers, experts * lm.num_layers)
}

/// The decoder's keys and values of the encoder's states.
pub fn cross(config: &Config, stored: Stored, tokens: usize) -> Floor {
    stored.product(tokens, projections(config) / 2) * config.lm.num_decoder_layers
}

/// The decoder's attention and experts in a step of one row. Keys and values of the encoder's states are read as
/// bfloat16 by int8 models and as f32 by others; the few of the decoder's own rows are not counted.
pub fn step(config: &Config, stored: Stored, tokens: usize) -> (Floor, Floor) {
    let lm = &config.lm;
    let cached = 2 * tokens * lm.num_heads * lm.d_kv;
    let bytes = if stored.is_quantized() { 2 } else { 4 };
    let cached = Floor { bytes: bytes * cached, macs: cached, ..Floor::default() };
    // Queries, keys, values and outputs of self-attention; queries and outputs of cross-attention.
    let attention = stored.product(1, projections(config) / 2 * 3) + cached;
    (attention * lm.num_decoder_layers, stored.product(1, lm.top_k * expert(config)) * lm.num_decoder_layers)
}

/// The depth network for all keyframes of a chunk: each code passes all layers and its head, after the previous code.
pub fn depth(config: &Config, stored: Stored, target: usize) -> Floor {
    let Some(sizes) = &config.depth else { return Floor::default() };
    let (d, codes) = (sizes.d_model, config.codes_per_keyframe());
    let layers = sizes.num_layers * (4 * d * d + 3 * d * sizes.d_ff);
    let heads: usize = config.part_list().iter().map(|part| part.levels * part.codes * d).sum();
    let inputs = 1 + config.heard_tokens().count();
    let rest = stored.product(target, heads + inputs * d * config.lm.d_model);
    let each = depth_layers(config, stored);
    let layers = Floor { bytes: each, ..stored.product(target * codes, layers) };
    Floor { cache_bytes: (target * codes - 1) * each, ..layers + rest }
}

/// Bytes of the depth network's layers, 0 if there is none.
pub fn depth_layers(config: &Config, stored: Stored) -> usize {
    let Some(sizes) = &config.depth else { return 0 };
    sizes.num_layers * stored.bytes(4 * sizes.d_model.pow(2) + 3 * sizes.d_model * sizes.d_ff)
}

/// Output head of one part's codes, whose weights are always bfloat16; zero in layout `frames`.
pub fn head(config: &Config) -> Floor {
    if config.is_frames() {
        return Floor::default();
    }
    Stored::Bf16.product(1, config.part_codes() * config.lm.d_model)
}

/// Encoding `tokens` tokens and generating `codes` codes in as many steps: the encoder, keys and values of its
/// states, and the steps, which are sequential.
pub fn chunk(config: &Config, stored: Stored, tokens: usize, codes: usize) -> [Floor; 3] {
    let (encoder, step) = (encoder(config, stored, tokens), step(config, stored, tokens));
    [encoder.0 + encoder.1, cross(config, stored, tokens), (step.0 + step.1 + head(config)) * codes]
}

/// HuBERT on `samples` samples, its transformer over `window` features; all at the speed of products, although its
/// convolutions may be slower.
pub fn hubert(config: &Config, stored: Stored, samples: usize, window: Option<usize>) -> Floor {
    let Some(h) = &config.audio.hubert else { return Floor::default() };
    let (mut rows, mut channels, mut all) = (samples, 1, Floor::default());
    for ((&dim, &kernel), &stride) in h.conv_dim.iter().zip(&h.conv_kernel).zip(&h.conv_stride) {
        rows = rows.saturating_sub(kernel) / stride + 1;
        all = all + stored.product(rows, dim * kernel * channels);
        channels = dim;
    }
    let d = h.hidden_size;
    all = all + stored.product(rows, d * channels);
    let rows = window.unwrap_or(rows);
    all = all + stored.product(rows, d * d / h.num_conv_pos_embedding_groups * h.num_conv_pos_embeddings);
    let pairs = Floor { macs: 2 * rows * rows * d, ..Floor::default() };
    all + (stored.product(rows, 4 * d * d + 2 * d * h.intermediate_size) + pairs) * h.num_hidden_layers
}

/// Audio tokenizer for a chunk: HuBERT, or mel bands without the Fourier transform; then the nearest centroids.
fn tokenizer(config: &Config, stored: Stored, target: usize) -> Floor {
    let new = target * config.tokens_per_keyframe();
    let window = window_tokens(config, target);
    if let Some(h) = &config.audio.hubert {
        let samples = config.feature_reach_back() + new * config.hop();
        let centroids = Stored::F32.product(window, config.audio.units * h.hidden_size);
        return hubert(config, stored, samples, Some(window)) + centroids;
    }
    let Some(mel) = &config.audio.mel else { return Floor::default() };
    let layers = mel.network.iter().flat_map(|network| network.layers(mel.bands_width()));
    let network = layers.map(|(outputs, inputs)| outputs * inputs).sum::<usize>()
        + mel.network.as_ref().map_or(0, MelNetwork::block_weights);
    Stored::F32.product(new, mel.bands * (mel.fft / 2 + 1) + network + config.audio.units * mel.width())
}

/// Interpolation network: over time for the whole window; over parts, and output codes, for the filled frames.
fn interp(config: &Config, stored: Stored, target: usize) -> Floor {
    let (sizes, stride) = (&config.interp, config.keyframe_stride);
    let frames = (config.prefix + target - 1) * stride + 1;
    let (d, new) = (sizes.d_model, target * stride);
    let layer = |rows: usize, group: usize| {
        let pairs = Floor { macs: 2 * rows * group * d, ..Floor::default() };
        stored.product(rows, 4 * d * d + 2 * d * sizes.d_ff) + pairs
    };
    let moving = config.part_list().into_iter().filter(|part| !part.is_annotation());
    let (parts, heads) = match config.is_frames() {
        true => (moving.clone().count(), moving.map(|part| 2 * part.width * d).sum()),
        false => (Part::ALL.len(), Part::ALL.len() * d * config.part_codes()),
    };
    let heads = stored.product(new, heads);
    layer(frames, frames) * sizes.temporal_layers + layer(new * parts, parts) * sizes.part_layers + heads
}

/// Weights of an encoder stack: per layer a convolution over three frames and a residual block of two.
fn encoder_stack(codec: Codec, width: usize) -> usize {
    3 * width * (codec.channels + (codec.layers - 1) * width + 2 * codec.layers * width)
}

/// Weights of a decoder stack: two residual blocks, convolutions of which the last widens, and one more.
fn decoder_stack(codec: Codec, width: usize) -> usize {
    3 * (width * ((4 + codec.layers - 1) * width + codec.channels) + codec.channels * codec.channels)
}

/// Motion decoders: for the new frames, and for earlier ones whose future has become known.
fn motion(config: &Config, stored: Stored, target: usize) -> Floor {
    let (vq, new) = (&config.vq, target * config.keyframe_stride);
    let list = config.part_list();
    let parts = list.iter().filter_map(|part| {
        let codec = part.codec(part.channels(&config.face)?.count());
        Some(stored.product(new + codec.decoder_reach(), decoder_stack(codec, part.width)))
    });
    let root = vq.root;
    let rows = new + root.encoder_reach() + root.decoder_reach();
    let root = stored.product(rows, encoder_stack(root, vq.width) + decoder_stack(root, vq.width));
    parts.fold(root, Add::add)
}

/// Measured peaks of the processor with some number of threads.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    /// Number of threads.
    pub threads: usize,
    /// Bytes read per second.
    pub bytes_per_second: f64,
    /// Bytes read per second from a cache; `None` if not measured.
    pub cache_per_second: Option<f64>,
    /// Int8 multiply-adds per second, if the back-end has instructions for them.
    pub int8_per_second: Option<f64>,
    /// Single-precision multiply-adds per second, if the back-end has instructions for them.
    pub f32_per_second: Option<f64>,
    isa: Isa,
}

impl Machine {
    /// Measures with this number of threads, in a few tenths of a second. Reads `bytes` of memory, the size of the
    /// weights: small weights are read from caches. `cache_bytes` is what each thread reads repeatedly, 0 to skip
    /// that.
    pub fn measure(threads: usize, isa: Isa, bytes: usize, cache_bytes: usize) -> Self {
        Self {
            threads,
            bytes_per_second: read(threads, isa, bytes),
            cache_per_second: (cache_bytes > 0).then(|| read(threads, isa, threads * cache_bytes)),
            int8_per_second: int8(threads, isa),
            f32_per_second: f32(threads, isa),
            isa,
        }
    }

    /// The better of two measurements with the same number of threads: peaks vary on a shared machine, and floors
    /// must be below all of them.
    #[must_use]
    pub fn best(self, other: Self) -> Self {
        let better = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a.max(b));
        Self {
            bytes_per_second: self.bytes_per_second.max(other.bytes_per_second),
            cache_per_second: better(self.cache_per_second, other.cache_per_second),
            int8_per_second: better(self.int8_per_second, other.int8_per_second),
            f32_per_second: better(self.f32_per_second, other.f32_per_second),
            ..self
        }
    }

    /// Time of `floors` one after another.
    pub fn time_in_turn(&self, floors: &[Floor]) -> Duration {
        floors.iter().map(|floor| self.time(floor)).sum()
    }

    /// Time of a floor: the greater of reading and multiplying.
    pub fn time(&self, floor: &Floor) -> Duration {
        let at = |count: usize, peak: Option<f64>| peak.map_or(0.0, |peak| count as f64 / peak);
        let reading = floor.bytes as f64 / self.bytes_per_second + at(floor.cache_bytes, self.cache_per_second);
        let multiplying = at(floor.macs, self.int8_per_second) + at(floor.float_macs, self.f32_per_second);
        Duration::from_secs_f64(reading.max(multiplying))
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let macs = |peak: Option<f64>| peak.map_or_else(|| "unknown".to_owned(), |m| format!("{:.0} GMAC/s", m / 1e9));
        write!(
            f,
            "peaks of {} thread{} with {}: int8 {}, f32 {}, read {:.1} GB/s",
            self.threads,
            if self.threads == 1 { "" } else { "s" },
            self.isa.name(),
            macs(self.int8_per_second),
            macs(self.f32_per_second),
            self.bytes_per_second / 1e9
        )?;
        match self.cache_per_second {
            Some(cache) => write!(f, ", from a cache {:.1} GB/s", cache / 1e9),
            None => Ok(()),
        }
    }
}

/// Int8 multiply-adds per second of `threads` threads; `None` if the back-end has no instructions for them.
pub fn int8(threads: usize, isa: Isa) -> Option<f64> {
    // Some hundred microseconds, independent of the work in one round.
    let rounds = 300_000_000 / peak::int8(isa, 1)?;
    Some(best(threads, |_| peak::int8(isa, rounds).unwrap_or(0)))
}

/// Single-precision multiply-adds per second of `threads` threads; `None` if the back-end has no instructions for
/// them.
pub fn f32(threads: usize, isa: Isa) -> Option<f64> {
    let rounds = 100_000_000 / peak::f32(isa, 1)?;
    Some(best(threads, |_| peak::f32(isa, rounds).unwrap_or(0)))
}

/// Bytes per second that `threads` threads together read from `bytes` of memory in huge pages, in the faster order.
pub fn read(threads: usize, isa: Isa, bytes: usize) -> f64 {
    faster_order(threads, isa, bytes).1
}

/// The order in which `threads` threads together read `bytes` of memory in huge pages faster, and the bytes per
/// second.
pub fn faster_order(threads: usize, isa: Isa, bytes: usize) -> (peak::Order, f64) {
    /// Smaller sizes would be read within the time that the common start takes.
    const MIN_BYTES: usize = 64 << 20;
    let mut memory = AlignedBox::<i8>::zeroed(bytes);
    memory.fill(1);
    let (share, times) = (bytes / threads, MIN_BYTES.div_ceil(bytes.max(1)));
    let speeds = peak::Order::ALL.map(|order| {
        best(threads, |thread| {
            (0..times).for_each(|_| peak::read(isa, order, &memory[thread * share..(thread + 1) * share]));
            times * share
        })
    });
    let [streams, whole] = peak::Order::ALL;
    if speeds[0] > speeds[1] { (streams, speeds[0]) } else { (whole, speeds[1]) }
}

/// Best of many rounds: work per second of all threads together, from the first start to the last end. A thread that
/// runs while others do not also has their share of the memory bandwidth.
fn best(threads: usize, work: impl Fn(usize) -> usize + Sync) -> f64 {
    let round = || {
        let ready = AtomicUsize::new(0);
        let (work, ready) = (&work, &ready);
        let run = move |thread: usize| {
            // Waking takes as long as part of the work, so threads spin.
            ready.fetch_add(1, Ordering::Relaxed);
            while ready.load(Ordering::Relaxed) < threads {
                std::thread::yield_now();
            }
            let start = Instant::now();
            (work(thread), start, Instant::now())
        };
        let runs: Vec<_> = std::thread::scope(|scope| {
            let runs: Vec<_> = (0..threads).map(|thread| scope.spawn(move || run(thread))).collect();
            runs.into_iter().map(|run| run.join().expect("no panics")).collect()
        });
        let done: usize = runs.iter().map(|run| run.0).sum();
        let (start, end) = (runs.iter().map(|run| run.1).min(), runs.iter().map(|run| run.2).max());
        start.zip(end).map_or(0.0, |(start, end)| done as f64 / (end - start).as_secs_f64())
    };
    (0..12).map(|_| round()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use umo_kernels::gemm::Epilogue;
    use umo_kernels::product::{Product, Rows, Weights, multiply};
    use umo_kernels::quantize::QuantRows;
    use umo_kernels::{Mat, MatMut, PackedF32, PackedI8};

    use super::*;

    #[test]
    fn a_floor_is_the_greater_of_reading_and_multiplying() {
        let machine = Machine {
            threads: 1,
            bytes_per_second: 10.0,
            cache_per_second: Some(40.0),
            int8_per_second: Some(100.0),
            f32_per_second: Some(20.0),
            isa: Isa::SCALAR,
        };
        let seconds = |bytes, cache_bytes, macs, float_macs| {
            machine.time(&Floor { bytes, cache_bytes, macs, float_macs }).as_secs_f64()
        };
        assert_eq!(seconds(50, 0, 100, 20), 5.0);
        assert_eq!(seconds(10, 0, 300, 20), 4.0);
        assert_eq!(seconds(10, 120, 300, 0), 4.0);
        // Sequential floors do not overlap.
        let floors = [(50, 100), (10, 300)].map(|(bytes, macs)| Floor { bytes, macs, ..Floor::default() });
        assert_eq!(machine.time_in_turn(&floors).as_secs_f64(), 8.0);
        let blind = Machine { int8_per_second: None, f32_per_second: None, ..machine };
        let floor = Floor { bytes: 20, cache_bytes: 0, macs: 1000, float_macs: 1000 };
        assert_eq!(blind.time(&floor).as_secs_f64(), 2.0);
    }

    /// Multiply-adds per second of products that fit a cache, with f32 weights or with int8 weights.
    fn product(isa: Isa, quantized: bool) -> f64 {
        const TIMES: usize = 8;
        const M: usize = 48;
        const N: usize = 128;
        const K: usize = 512;
        let (floats, codes) = (vec![0.5; N * K], vec![1; N * K]);
        let (scale, sum) = (vec![1.0; N], vec![512; N]);
        let (x, w) = if quantized {
            let x = QuantRows::new(Mat::new(&codes, M, K).unwrap(), &scale[..M]).unwrap();
            (Rows::quantized(x), Weights::I8(PackedI8::new(&codes, &scale, &sum, N, K).unwrap()))
        } else {
            let x = Rows::float(Mat::new(&floats, M, K).unwrap());
            (x, Weights::F32(PackedF32::new(&floats, N, K).unwrap()))
        };
        best(1, |_| {
            let mut y = vec![0.0; M * N];
            for _ in 0..TIMES {
                let y = MatMut::new(&mut y, M, N).unwrap();
                multiply(isa, x, Product::Plain(w, Epilogue::STORE), y).unwrap();
            }
            TIMES * M * N * K
        })
    }

    /// Measures a peak and a rate that it bounds, again if other processes disturbed one of them, until the rate is at
    /// most the peak and no implausibly small share of it.
    fn assert_bounds(name: &str, measure: impl Fn() -> (f64, f64)) {
        let mut measured = Vec::new();
        for _ in 0..20 {
            let (peak, rate) = measure();
            if rate <= 1.1 * peak && rate >= peak / 50.0 {
                return;
            }
            measured.push((peak, rate));
        }
        panic!("{name}: peaks and rates {measured:?}");
    }

    #[test]
    fn peaks_bound_what_every_back_end_reaches() {
        for isa in Isa::available() {
            for (kind, peak, quantized) in [("int8", int8 as fn(usize, Isa) -> Option<f64>, true), ("f32", f32, false)]
            {
                assert_eq!(peak(1, isa).is_none(), isa == Isa::SCALAR, "{kind}, {}", isa.name());
                if isa != Isa::SCALAR {
                    let measure = || (peak(1, isa).unwrap_or(0.0), product(isa, quantized));
                    assert_bounds(&format!("{kind} on {}", isa.name()), measure);
                }
            }
            // Vectors read at least as fast as the plain loop, and a cache as fast as what lies beyond it.
            assert_bounds(isa.name(), || (read(1, isa, 1 << 16), read(1, Isa::SCALAR, 1 << 16)));
            assert_bounds(isa.name(), || {
                let machine = Machine::measure(2, isa, 64 << 20, 1 << 14);
                (machine.cache_per_second.unwrap_or(0.0), machine.bytes_per_second)
            });
        }
    }

    #[test]
    fn counts_of_peaks_are_proportional_to_rounds() {
        for isa in Isa::available() {
            for count in [peak::int8, peak::f32] {
                let one = count(isa, 1);
                assert_eq!(count(isa, 7), one.map(|one| 7 * one), "{}", isa.name());
                assert!(one.is_none_or(|one| one > 0), "{}", isa.name());
            }
        }
    }
}
