//! The parts of a chunk at base size, in int8, on one and two threads, each with its floor:
//! the bytes that it must read over the bandwidth, and its multiply-adds over the peak,
//! measured in the same run.
//!
//! The models are at `UMO_BENCH_MODEL` and, for the depth network, `UMO_BENCH_FRAMES`, or
//! random ones that are made once under `target/`; if benches run as tests they are small, and
//! the floors are left out.

use std::cell::RefCell;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use umo_benches::parts::{Audio, Depth, Language, TOKENS};
use umo_benches::{frames_model, isa, machine, model};
use umo_core::{Compute, ModelFile, Team};
use umo_core_tools::floor::{self, Floor, Machine, Stored};

/// Times `call` under `name` and prints the median and the floor of its sequence of operations.
fn time(c: &mut Criterion, name: &str, machine: Option<&Machine>, floors: &[Floor], mut call: impl FnMut()) {
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
        let least = machine.time_in_turn(floors).as_secs_f64();
        let floor = floors.iter().fold(Floor::default(), |sum, &floor| sum + floor);
        let share = 100.0 * least / median;
        println!(
            "{name}: median {:.2} ms, best {:.2} ms, floor {:.2} ms ({:.1} MB, {:.2} GMAC), {share:.0} % of it",
            1e3 * median,
            1e3 * times[0],
            1e3 * least,
            (floor.bytes + floor.cache_bytes) as f64 / 1e6,
            (floor.macs + floor.float_macs) as f64 / 1e9,
        );
    }
}

fn language_model(c: &mut Criterion, file: &ModelFile) {
    let config = file.config();
    let mut language = Language::load(file);
    let codes = language.codes();
    let (attention, experts) = floor::encoder(config, Stored::Int8, TOKENS);
    let encoder = attention + experts;
    let (attention, experts) = floor::step(config, Stored::Int8, TOKENS);
    let step = attention + experts + floor::head(config);
    let chunk = floor::chunk(config, Stored::Int8, TOKENS, codes);
    for threads in [1, 2] {
        let machine = machine(threads, 0);
        if let Some(machine) = &machine {
            println!("{machine}");
        }
        let (team, isa) = (Team::new(threads).expect("threads can be started"), isa());
        let (cx, machine) = (Compute { isa, team: &team }, machine.as_ref());
        time(c, &format!("encoder_256/T{threads}"), machine, &[encoder], || language.encode(cx));
        time(c, &format!("decoder_step/T{threads}"), machine, &[step], || language.step(cx));
        let name = format!("chunk_256_{codes}/T{threads}");
        time(c, &name, machine, &chunk, || language.chunk(cx));
    }
}

fn tokenizer(c: &mut Criterion, file: &ModelFile) {
    let audio = Audio::load(file);
    for threads in [1, 2] {
        let (team, machine) = (Team::new(threads).expect("threads can be started"), machine(threads, 0));
        let cx = Compute { isa: isa(), team: &team };
        let floor = floor::hubert(file.config(), Stored::Int8, audio.samples(), None);
        time(c, &format!("tokenizer_3s/T{threads}"), machine.as_ref(), &[floor], || audio.features(cx));
    }
}

/// The codes of a keyframe: of one avatar, and of the largest number that one thread takes through the
/// network together.
fn depth(c: &mut Criterion) {
    let file = frames_model();
    let machine = machine(1, floor::depth_layers(file.config(), Stored::Int8));
    let (team, isa) = (Team::new(1).expect("one thread"), isa());
    for avatars in [1, 8] {
        let mut depth = Depth::load(&file, avatars);
        let floor = floor::depth(file.config(), Stored::Int8, 1).rows(avatars);
        let name = format!("depth_{}/avatars{avatars}", depth.codes());
        time(c, &name, machine.as_ref(), &[floor], || depth.draw(Compute { isa, team: &team }));
    }
}

fn step(c: &mut Criterion) {
    let file = model();
    language_model(c, &file);
    tokenizer(c, &file);
    depth(c);
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).measurement_time(std::time::Duration::from_secs(5));
    targets = step
}
criterion_main!(benches);
