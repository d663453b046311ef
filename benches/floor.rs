//! What a part of the model must do at least, and how long this processor takes for it at its measured peaks.

use std::fmt;

use umo_core::Config;
use umo_kernels::Isa;

use crate::{is_test, peak};

/// What one call must do at least.
#[derive(Clone, Copy, Debug, Default)]
pub struct Floor {
    /// Weights, keys and values that are read once.
    pub bytes: usize,
    /// Multiply-adds of the products.
    pub macs: usize,
}

/// What the processor can do with some threads.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    threads: usize,
    bytes_per_second: f64,
    macs_per_second: Option<f64>,
}

impl Machine {
    /// Measures with so many threads, unless benches run as tests.
    /// Reading is measured over as much memory as the decoder's weights take.
    pub fn measure(threads: usize) -> Option<Self> {
        if is_test() {
            return None;
        }
        let bytes = 384 << 20;
        Some(Self {
            threads,
            bytes_per_second: peak::read(threads, bytes),
            macs_per_second: peak::int8(threads, Isa::detect()),
        })
    }

    /// The greater of reading and multiplying.
    pub fn seconds(&self, floor: &Floor) -> f64 {
        let reading = floor.bytes as f64 / self.bytes_per_second;
        reading.max(self.macs_per_second.map_or(0.0, |m| floor.macs as f64 / m))
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let macs = self.macs_per_second.map_or_else(|| "unknown".to_owned(), |m| format!("{:.0} GMAC/s", m / 1e9));
        let (threads, read) = (self.threads, self.bytes_per_second / 1e9);
        write!(f, "peaks of {threads} threads with {}: int8 {macs}, read {read:.1} GB/s", Isa::detect().name())
    }
}

/// Multiply-adds (and so int8 bytes) of one token through the products of a stack, with `k` experts of each layer.
fn layer_values(config: &Config, attentions: usize) -> usize {
    let lm = &config.lm;
    attentions * 4 * lm.d_model * lm.num_heads * lm.d_kv + lm.top_k * 3 * lm.d_model * lm.d_ff
}

/// The floor of encoding `tokens`.
pub fn encoder(config: &Config, tokens: usize) -> Floor {
    let lm = &config.lm;
    let inner = lm.num_heads * lm.d_kv;
    let all = layer_values(config, 1) + (lm.experts - lm.top_k) * 3 * lm.d_model * lm.d_ff;
    let macs = lm.num_layers * tokens * (layer_values(config, 1) + 2 * tokens * inner);
    Floor { bytes: lm.num_layers * all, macs }
}

/// The floor of the keys and values that the decoder takes from the encoder's states.
pub fn cross(config: &Config, tokens: usize) -> Floor {
    let lm = &config.lm;
    let values = 2 * lm.d_model * lm.num_heads * lm.d_kv * lm.num_decoder_layers;
    Floor { bytes: values, macs: values * tokens }
}

/// The floor of one step of the decoder: its weights but for the cross keys and values, which are read as bfloat16.
pub fn step(config: &Config, tokens: usize) -> Floor {
    let lm = &config.lm;
    let inner = lm.num_heads * lm.d_kv;
    let weights = lm.num_decoder_layers * (layer_values(config, 2) - 2 * lm.d_model * inner);
    let cached = lm.num_decoder_layers * 2 * tokens * inner;
    let head = config.vq.codes * lm.d_model;
    Floor { bytes: weights + 2 * cached + 2 * head, macs: weights + cached + head }
}

/// The floor of encoding `tokens` and generating `codes` greedily.
pub fn chunk(config: &Config, tokens: usize, codes: usize) -> Floor {
    let (encoder, cross, step) = (encoder(config, tokens), cross(config, tokens), step(config, tokens));
    Floor {
        bytes: encoder.bytes + cross.bytes + codes * step.bytes,
        macs: encoder.macs + cross.macs + codes * step.macs,
    }
}

/// Multiply-adds of HuBERT on `samples`, as if all were int8 (convolutions that are not cannot reach it); its weights are
/// small beside them.
pub fn hubert(config: &Config, samples: usize) -> Floor {
    let Some(h) = &config.audio.hubert else { return Floor { bytes: 0, macs: 0 } };
    let (mut rows, mut channels, mut macs) = (samples, 1, 0);
    for ((&dim, &kernel), &stride) in h.conv_dim.iter().zip(&h.conv_kernel).zip(&h.conv_stride) {
        rows = (rows - kernel) / stride + 1;
        macs += rows * dim * kernel * channels;
        channels = dim;
    }
    let d = h.hidden_size;
    macs += rows * d * (channels + d / h.num_conv_pos_embedding_groups * h.num_conv_pos_embeddings);
    macs += h.num_hidden_layers * rows * (4 * d * d + 2 * d * h.intermediate_size + 2 * rows * d);
    Floor { bytes: 0, macs }
}
