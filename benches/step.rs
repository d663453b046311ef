//! The parts of a chunk at base size, in int8, on one and two threads, beside the floor of each: the bytes that it must
//! read at the bandwidth, and the multiply-adds that it must do at the peak, measured in the same run.
//!
//! The model is that of `UMO_BENCH_MODEL`, or a random one that is made once under `target/`; where benches run as tests
//! it is small, and the floors are left out.

use std::cell::RefCell;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use umo_benches::floor::{self, Floor, Machine};
use umo_benches::{Random, model};
use umo_core::audio::Tokenizer;
use umo_core::lm::decoder::Sequence;
use umo_core::lm::generate::{Draw, Generator};
use umo_core::lm::sampler::Sampler;
use umo_core::lm::{Lengths, Lm, LmScratch};
use umo_core::weights::Loader;
use umo_core::{Compute, ModelFile, PerPart, Precision, Team};
use umo_kernels::{Isa, Mat};

/// Encoder tokens.
const TOKENS: usize = 256;
const OK: &str = "the model and its input are sound";

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
        time(c, &format!("encoder_256/T{threads}"), machine.as_ref(), &floor::encoder(config, TOKENS), || {
            lm.encode(cx, &mut scratch, &ids, &[TOKENS], &mut hidden).expect(OK);
        });
        let states = Mat::new(&hidden, TOKENS, lm.d_model()).expect(OK);
        lm.attend_to(cx, &mut scratch, states, &mut sequence).expect(OK);
        let (mut at, mut logits) = (0, vec![0.0; config.vq.codes]);
        time(c, &format!("decoder_step/T{threads}"), machine.as_ref(), &floor::step(config, TOKENS), || {
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
        let floor = floor::chunk(config, TOKENS, codes);
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

fn tokenizer(c: &mut Criterion, file: &ModelFile) {
    const SECONDS: usize = 3;
    let config = file.config();
    let tokenizer = Tokenizer::load(&Loader::new(file, Precision::Stored, Isa::detect())).expect(OK);
    let mut random = Random::new(5);
    let audio: Vec<f32> = (0..SECONDS * config.audio.sample_rate).map(|_| 0.1 * random.unit()).collect();
    for threads in [1, 2] {
        let (team, machine) = (Team::new(threads).expect("threads can be started"), Machine::measure(threads));
        let cx = Compute { isa: Isa::detect(), team: &team };
        let floor = floor::hubert(config, audio.len());
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
