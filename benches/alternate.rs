//! Times the language models of two files alternately, so that both run under the same conditions:
//! a decoder step, and a chunk (encoding 256 tokens, and its codes).
//!
//! Usage: `alternate MODEL[@PROFILE] OTHER[@PROFILE] [seconds per figure]`. A profile, `xeon`, `zen4` or `zen5`,
//! replaces the processor's own tuning on its side, for instance to compare two profiles on one model. Prints medians,
//! and medians of the ratios of neighbouring measurements: of wall time, and on Linux of the processor time of all
//! threads, on which other programs have less influence.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use umo_benches::parts::Language;
use umo_core::{Compute, ModelFile, Team};
use umo_kernels::Isa;
use umo_kernels::tuning::Tuning;

/// Steps per measurement.
const STEPS: usize = 10;

/// A language model, and its computing context.
struct Side {
    language: Language,
    isa: Isa,
}

impl Side {
    fn load(argument: &str) -> Result<Self, Box<dyn Error>> {
        let own = umo_benches::isa();
        let (path, isa) = match argument.rsplit_once('@') {
            None => (argument, own),
            Some((path, "xeon")) => (path, own.with_tuning(Tuning::XEON)),
            Some((path, "zen4")) => (path, own.with_tuning(Tuning::ZEN4)),
            Some((path, "zen5")) => (path, own.with_tuning(Tuning::ZEN5)),
            Some((_, other)) => return Err(format!("{other}: no profile; there are xeon, zen4 and zen5").into()),
        };
        Ok(Self { language: Language::load(&ModelFile::open(Path::new(path))?), isa })
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, other, rest @ ..] = &arguments[..] else {
        return Err("usage: alternate MODEL[@PROFILE] OTHER[@PROFILE] [seconds]".into());
    };
    let seconds: f64 = rest.first().map_or(Ok(20.0), |seconds| seconds.parse())?;
    let mut sides = [Side::load(model)?, Side::load(other)?];
    println!("{:>16} {:>8} {:>19} {:>19} {:>6} {:>9}", "", "threads", "ms", "processor ms", "ratio", "processor");
    for threads in [1, 2] {
        let team = Team::new(threads)?;
        for Side { language, isa } in &mut sides {
            language.encode(Compute { isa: *isa, team: &team });
        }
        let steps = |model: &mut Language, cx: Compute| (0..STEPS).for_each(|_| model.step(cx));
        report("decoder step", &team, seconds, STEPS, &mut sides, steps);
        report("encoder", &team, seconds / 2.0, 1, &mut sides, Language::encode);
        report("chunk", &team, seconds, 1, &mut sides, Language::chunk);
    }
    Ok(())
}

/// Times `call` on both sides alternately.
fn report(
    name: &str,
    team: &Team,
    seconds: f64,
    each: usize,
    sides: &mut [Side; 2],
    call: impl Fn(&mut Language, Compute),
) {
    let (mut wall, mut processor) = ([vec![], vec![]], [vec![], vec![]]);
    let start = Instant::now();
    while start.elapsed().as_secs_f64() < seconds || wall[0].len() < 5 {
        for (side, (wall, processor)) in sides.iter_mut().zip(wall.iter_mut().zip(&mut processor)) {
            let (now, before) = (Instant::now(), processor_seconds());
            call(&mut side.language, Compute { isa: side.isa, team });
            wall.push(1e3 * now.elapsed().as_secs_f64() / each as f64);
            processor.push(1e3 * (processor_seconds() - before) / each as f64);
        }
    }
    let ratio = |times: &[Vec<f64>; 2]| median(times[0].iter().zip(&times[1]).map(|(a, b)| a / b));
    let both = |times: &[Vec<f64>; 2]| {
        let [a, b] = [&times[0], &times[1]].map(|times| median(times.iter().copied()));
        format!("{a:.2} : {b:.2}")
    };
    let threads = team.threads();
    println!(
        "{name:>16} {threads:>8} {:>19} {:>19} {:>6.2} {:>9.2}",
        both(&wall),
        both(&processor),
        ratio(&wall),
        ratio(&processor)
    );
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Processor time of all threads of this process so far; 0 if the system does not report it.
fn processor_seconds() -> f64 {
    let of = |task: std::fs::DirEntry| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split(' ').next()?.parse::<f64>().ok()
    };
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    tasks.filter_map(of).sum::<f64>() / 1e9
}
