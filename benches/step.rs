//! The parts of a chunk at base size, in int8, on one and two threads, beside the floor of each: the bytes that it must
//! read at the bandwidth, and the multiply-adds that it must do at the peak, measured in the same run.
//!
//! The model is that of `UMO_BENCH_MODEL`, or a random one that is made once under `target/`; where benches run as tests
//! it is small, and the floors are left out.

use std::cell::RefCell;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use umo_benches::{Random, is_test, model, peak};
use umo_core::audio::Tokenizer;
use umo_core::lm::decoder::Sequence;
use umo_core::lm::generate::{Draw, Generator};
use umo_core::lm::sampler::Sampler;
use umo_core::lm::{Lengths, Lm, LmScratch};
use umo_core::weights::Loader;
use umo_core::{Compute, Config, ModelFile, PerPart, Precision, Team};
use umo_kernels::{Isa, Mat};

/// Encoder tokens.
const TOKENS: usize = 256;
const OK: &str = "the model and its input are sound";

/// What one call must do at least.
struct Floor {
    /// Weights, keys and values that are read once.
    bytes: usize,
    /// Multiply-adds of the products.
    macs: usize,
}

/// What the processor can do with some threads.
struct Machine {
    threads: usize,
    bytes_per_second: f64,
    macs_per_second: Option<f64>,
}

impl Machine {
    /// Reading is measured over as much memory as the decoder's weights take.
    fn measure(threads: usize) -> Option<Self> {
        if is_test() {
            return None;
        }
        let bytes = 384 << 20;
        Some(Self { threads, bytes_per_second: peak::read(threads, bytes), macs_per_second: peak::int8(threads) })
    }

    fn print(&self) {
        let macs = self.macs_per_second.map_or_else(|| "unknown".to_owned(), |m| format!("{:.0} GMAC/s", m / 1e9));
        println!("peaks of {} threads: int8 {macs}, read {:.1} GB/s", self.threads, self.bytes_per_second / 1e9);
    }

    fn seconds(&self, floor: &Floor) -> f64 {
        let reading = floor.bytes as f64 / self.bytes_per_second;
        reading.max(self.macs_per_second.map_or(0.0, |m| floor.macs as f64 / m))
    }
}

/// Times `call` under `name` and prints the median beside the floor.
fn time(c: &mut Criterion, name: &str, machine: Option<&Machine>, floor: &Floor, mut call: impl FnMut()) {
    let times = RefCell::new(Vec::new());
    c.bench_function(name, |b| {
        b.iter_custom(|iterations| {
            let all = Instant::now();
            for _ in 0..iterations {
                let start = Instant::now();
                call();
                times.borrow_mut().push(start.elapsed().as_secs_f64());
            }
            all.elapsed()
        });
    });
    let mut times = times.into_inner();
    times.sort_by(f64::total_cmp);
    if let (Some(machine), Some(&median)) = (machine, times.get(times.len() / 2)) {
        let least = machine.seconds(floor);
        let share = 100.0 * least / median;
        println!(
            "{name}: median {:.2} ms, best {:.2} ms, floor {:.2} ms ({:.1} MB, {:.2} GMAC), {share:.0} % of it",
            1e3 * median,
            1e3 * times[0],
            1e3 * least,
            floor.bytes as f64 / 1e6,
            floor.macs as f64 / 1e9,
        );
    }
}

/// Multiply-adds (and so int8 bytes) of one token through the products of a stack, with `k` experts of each layer.
fn layer_values(config: &Config, attentions: usize) -> usize {
    let lm = &config.lm;
    attentions * 4 * lm.d_model * lm.num_heads * lm.d_kv + lm.top_k * 3 * lm.d_model * lm.d_ff
}

/// The floor of encoding `tokens`.
fn encoder_floor(config: &Config, tokens: usize) -> Floor {
    let lm = &config.lm;
    let inner = lm.num_heads * lm.d_kv;
    let all = layer_values(config, 1) + (lm.experts - lm.top_k) * 3 * lm.d_model * lm.d_ff;
    let macs = lm.num_layers * tokens * (layer_values(config, 1) + 2 * tokens * inner);
    Floor { bytes: lm.num_layers * all, macs }
}

/// The floor of the keys and values that the decoder takes from the encoder's states.
fn cross_floor(config: &Config, tokens: usize) -> Floor {
    let lm = &config.lm;
    let values = 2 * lm.d_model * lm.num_heads * lm.d_kv * lm.num_decoder_layers;
    Floor { bytes: values, macs: values * tokens }
}

/// The floor of one step of the decoder: its weights but for the cross keys and values, which are read as f32.
fn step_floor(config: &Config, tokens: usize) -> Floor {
    let lm = &config.lm;
    let inner = lm.num_heads * lm.d_kv;
    let weights = lm.num_decoder_layers * (layer_values(config, 2) - 2 * lm.d_model * inner);
    let cached = lm.num_decoder_layers * 2 * tokens * inner;
    let head = config.vq.codes * lm.d_model;
    Floor { bytes: weights + 4 * cached + 2 * head, macs: weights + cached + head }
}

fn add(a: Floor, b: Floor, times: usize) -> Floor {
    Floor { bytes: a.bytes + times * b.bytes, macs: a.macs + times * b.macs }
}

fn language_model(c: &mut Criterion, file: &ModelFile) {
    let config = file.config();
    let lengths = Lengths { encoder: TOKENS, decoder: Lengths::of(config).decoder };
    let lm = Lm::load(&Loader::new(file, Precision::Stored, Isa::detect()), lengths).expect(OK);
    let mut random = Random::new(4);
    let ids: Vec<u32> =
        (0..TOKENS).map(|_| u32::try_from(random.below(config.vocab.size)).expect("an id is small")).collect();
    let mut hidden = vec![0.0; TOKENS * lm.d_model()];
    let mut scratch = LmScratch::new(config, TOKENS);
    let mut sequence = Sequence::new(config, lengths);
    let mut generator = Generator::new(config);
    for threads in [1, 2] {
        let machine = Machine::measure(threads);
        if let Some(machine) = &machine {
            machine.print();
        }
        let (team, isa) = (Team::new(threads).expect("threads can be started"), Isa::detect());
        let cx = Compute { isa, team: &team };
        time(c, &format!("encoder_256/T{threads}"), machine.as_ref(), &encoder_floor(config, TOKENS), || {
            lm.encode(cx, &mut scratch, &ids, &[TOKENS], &mut hidden).expect(OK);
        });
        let states = Mat::new(&hidden, TOKENS, lm.d_model()).expect(OK);
        lm.attend_to(cx, &mut scratch, states, &mut sequence).expect(OK);
        let (mut at, mut logits) = (0, vec![0.0; config.vq.codes]);
        time(c, &format!("decoder_step/T{threads}"), machine.as_ref(), &step_floor(config, TOKENS), || {
            if at == lengths.decoder {
                lm.attend_to(cx, &mut scratch, states, &mut sequence).expect(OK);
                at = 0;
            }
            sequence.set_ids(&ids[at..=at]).expect(OK);
            lm.decode(cx, &mut scratch, std::slice::from_mut(&mut sequence)).expect(OK);
            lm.code_logits(cx, &mut scratch, 0, umo_core::Part::Face, &mut logits).expect(OK);
            at += 1;
        });
        let codes = 4 * config.target;
        let floor = add(encoder_floor(config, TOKENS), cross_floor(config, TOKENS), 1);
        let floor = add(floor, step_floor(config, TOKENS), codes);
        let mut out = PerPart::from_fn(|_| vec![0; config.target]);
        time(c, &format!("chunk_256_{codes}/T{threads}"), machine.as_ref(), &floor, || {
            lm.encode(cx, &mut scratch, &ids, &[TOKENS], &mut hidden).expect(OK);
            let states = Mat::new(&hidden, TOKENS, lm.d_model()).expect(OK);
            let PerPart { face, hands, upper, lower } = &mut out;
            let slices = PerPart { face: &mut **face, hands: &mut **hands, upper: &mut **upper, lower: &mut **lower };
            let draw = Draw { sampler: Sampler::GREEDY, chunk: 0, target: config.target };
            generator.generate(cx, &lm, &mut scratch, states, &mut sequence, draw, slices).expect(OK);
        });
    }
}

/// Multiply-adds of HuBERT on `samples`, as if all were int8 (convolutions that are not cannot reach it); its weights are
/// small beside them.
fn hubert_floor(config: &Config, samples: usize) -> Floor {
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

fn tokenizer(c: &mut Criterion, file: &ModelFile) {
    const SECONDS: usize = 3;
    let config = file.config();
    let tokenizer = Tokenizer::load(&Loader::new(file, Precision::Stored, Isa::detect())).expect(OK);
    let mut random = Random::new(5);
    let audio: Vec<f32> = (0..SECONDS * config.audio.sample_rate).map(|_| 0.1 * random.unit()).collect();
    for threads in [1, 2] {
        let (team, machine) = (Team::new(threads).expect("threads can be started"), Machine::measure(threads));
        let cx = Compute { isa: Isa::detect(), team: &team };
        let floor = hubert_floor(config, audio.len());
        time(c, &format!("tokenizer_3s/T{threads}"), machine.as_ref(), &floor, || {
            tokenizer.features(cx, &audio).expect(OK);
        });
    }
}

fn step(c: &mut Criterion) {
    let file = model();
    language_model(c, &file);
    tokenizer(c, &file);
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).measurement_time(std::time::Duration::from_secs(5));
    targets = step
}
criterion_main!(benches);
