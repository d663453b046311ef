//! Times the parts of a chunk on request from standard input, so that a peer can be timed in
//! between.
//!
//! After `ready`, each line `part kind threads repetitions` is answered by the milliseconds of that
//! many calls, as `peer.py` answers; `kind` is the precision of the model's file, int8. `floor` in place of
//! repetitions is answered by the minimum milliseconds of the part at this processor's peaks, which are
//! measured anew; NaN for `face`, an avatar of the default model. `reading` reads as many bytes as a step must. Other
//! requests in place of a part: `peaks` in readable form, `f32` for GMAC/s in single precision,
//! `isa` for the back-end in use, which `UMO_ISA` may set.

use std::cell::LazyCell;
use std::collections::BTreeMap;
use std::io::BufRead;
use std::time::Instant;

use umo_benches::parts::{Audio, Language, Reading, Speaker, TOKENS};
use umo_benches::{isa, machine};
use umo_core_tools::floor::{self, Floor, Stored};
use umo_core::{Compute, Config, Team};

fn main() {
    // The base model is loaded when a part of it is requested.
    let file = LazyCell::new(umo_benches::model);
    let mut language = LazyCell::new(|| Language::load(&file));
    let audio = LazyCell::new(|| Audio::load(&file));
    let (mut teams, mut speakers, mut reading) = (BTreeMap::new(), BTreeMap::new(), Reading::new());
    println!("ready");
    for line in std::io::stdin().lock().lines() {
        let line = line.expect("standard input is text");
        let words: Vec<&str> = line.split_whitespace().collect();
        let [part, "int8", count, repetitions] = words[..] else { panic!("unknown: {line}") };
        let count: usize = count.parse().expect("a number of threads");
        if part == "isa" {
            println!("{}", isa().name());
            continue;
        }
        if part == "f32" {
            println!("{:.4}", floor::f32(count, isa()).unwrap_or(f64::INFINITY) / 1e9);
            continue;
        }
        let measure = || machine(count, 0).expect("not a test run");
        if part == "peaks" {
            println!("{}", measure());
            continue;
        }
        if repetitions == "floor" && part == "face" {
            println!("{}", f64::NAN);
            continue;
        }
        if repetitions == "floor" {
            let floors = floors(file.config(), part, language.codes(), audio.samples());
            println!("{:.4}", 1e3 * measure().time_in_turn(&floors).as_secs_f64());
            continue;
        }
        let team = teams.entry(count).or_insert_with(|| Team::new(count).expect("threads can be started"));
        let cx = Compute { isa: isa(), team };
        let mut call = || match part {
            "encoder" => language.encode(cx),
            "step" => language.step(cx),
            "reading" => {
                let floors = floors(file.config(), "step", language.codes(), audio.samples());
                reading.read(cx, floors.iter().map(|floor| floor.bytes).sum());
            }
            "steps" => language.steps(cx),
            "chunk" => language.chunk(cx),
            "hubert" => audio.features(cx),
            "face" => speakers.entry(count).or_insert_with(|| Speaker::load(count)).chunk(),
            _ => panic!("no part of the model: {part}"),
        };
        let time = |_| {
            let start = Instant::now();
            call();
            format!("{:.4}", 1e3 * start.elapsed().as_secs_f64())
        };
        let repetitions: usize = repetitions.parse().expect("a number of repetitions");
        println!("{}", (0..repetitions).map(time).collect::<Vec<_>>().join(" "));
    }
}

/// Sequence of operations of a part.
fn floors(config: &Config, part: &str, codes: usize, samples: usize) -> Vec<Floor> {
    match part {
        "encoder" => {
            let (attention, experts) = floor::encoder(config, Stored::Int8, TOKENS);
            vec![attention + experts]
        }
        "step" => {
            let (attention, experts) = floor::step(config, Stored::Int8, TOKENS);
            vec![attention + experts + floor::head(config)]
        }
        "steps" | "chunk" => floor::chunk(config, Stored::Int8, TOKENS, codes).into(),
        _ => vec![floor::hubert(config, Stored::Int8, samples, None)],
    }
}
