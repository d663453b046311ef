//! The parts of a chunk at base size, in int8, on one and two threads, beside the floor of each: the bytes that it must
//! read at the bandwidth, and the multiply-adds that it must do at the peak, measured in the same run.
//!
//! The model is that of `UMO_BENCH_MODEL`, or a random one that is made once under `target/`; where benches run as tests
//! it is small, and the floors are left out.

use std::cell::RefCell;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use umo_benches::floor::{self, Floor, Machine};
use umo_benches::model;
use umo_benches::parts::{Audio, Language, TOKENS};
use umo_core::{Compute, ModelFile, Team};
use umo_kernels::Isa;

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
    let mut language = Language::load(file);
    let codes = language.codes();
    for threads in [1, 2] {
        let machine = Machine::measure(threads);
        if let Some(machine) = &machine {
            println!("{machine}");
        }
        let (team, isa) = (Team::new(threads).expect("threads can be started"), Isa::detect());
        let (cx, machine) = (Compute { isa, team: &team }, machine.as_ref());
        time(c, &format!("encoder_256/T{threads}"), machine, &floor::encoder(config, TOKENS), || language.encode(cx));
        time(c, &format!("decoder_step/T{threads}"), machine, &floor::step(config, TOKENS), || language.step(cx));
        let name = format!("chunk_256_{codes}/T{threads}");
        time(c, &name, machine, &floor::chunk(config, TOKENS, codes), || language.chunk(cx));
    }
}

fn tokenizer(c: &mut Criterion, file: &ModelFile) {
    let audio = Audio::load(file);
    for threads in [1, 2] {
        let (team, machine) = (Team::new(threads).expect("threads can be started"), Machine::measure(threads));
        let cx = Compute { isa: Isa::detect(), team: &team };
        let floor = floor::hubert(file.config(), audio.samples());
        time(c, &format!("tokenizer_3s/T{threads}"), machine.as_ref(), &floor, || audio.features(cx));
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
