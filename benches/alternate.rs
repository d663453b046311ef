//! Times the language model of one file beside that of another, in turn, so that both see the same
//! machine: a step of the decoder, and a chunk (encoding 256 tokens, and its codes).
//!
//! Usage: `alternate MODEL OTHER [seconds per figure]`. Medians, and the medians of the ratios of neighbours: of
//! wall time, and on Linux of the processor time of all threads, which other programs change less.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use umo_benches::parts::Language;
use umo_core::{Compute, ModelFile, Team};

/// Steps that are timed together.
const STEPS: usize = 10;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, other, rest @ ..] = &arguments[..] else { return Err("usage: alternate MODEL OTHER [seconds]".into()) };
    let seconds: f64 = rest.first().map_or(Ok(20.0), |seconds| seconds.parse())?;
    let load = |path: &str| Ok::<_, Box<dyn Error>>(Language::load(&ModelFile::open(Path::new(path))?));
    let mut models = [load(model)?, load(other)?];
    println!("{:>16} {:>8} {:>19} {:>19} {:>6} {:>9}", "", "threads", "ms", "processor ms", "ratio", "processor");
    for threads in [1, 2] {
        let team = Team::new(threads)?;
        let cx = Compute { isa: umo_benches::isa(), team: &team };
        for model in &mut models {
            model.encode(cx);
        }
        report("decoder step", threads, seconds, STEPS, &mut models, |model| (0..STEPS).for_each(|_| model.step(cx)));
        report("encoder", threads, seconds / 2.0, 1, &mut models, |model| model.encode(cx));
        report("chunk", threads, seconds, 1, &mut models, |model| model.chunk(cx));
    }
    Ok(())
}

/// Times `call` with both models in turn.
fn report(
    name: &str,
    threads: usize,
    seconds: f64,
    each: usize,
    models: &mut [Language; 2],
    mut call: impl FnMut(&mut Language),
) {
    let (mut wall, mut processor) = ([vec![], vec![]], [vec![], vec![]]);
    let start = Instant::now();
    while start.elapsed().as_secs_f64() < seconds || wall[0].len() < 5 {
        for (model, (wall, processor)) in models.iter_mut().zip(wall.iter_mut().zip(&mut processor)) {
            let (now, before) = (Instant::now(), processor_seconds());
            call(model);
            wall.push(1e3 * now.elapsed().as_secs_f64() / each as f64);
            processor.push(1e3 * (processor_seconds() - before) / each as f64);
        }
    }
    let ratio = |times: &[Vec<f64>; 2]| median(times[0].iter().zip(&times[1]).map(|(a, b)| a / b));
    let both = |times: &[Vec<f64>; 2]| {
        let [a, b] = [&times[0], &times[1]].map(|times| median(times.iter().copied()));
        format!("{a:.2} : {b:.2}")
    };
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

/// Processor time of all threads of this process so far; 0 where the system does not tell it so.
fn processor_seconds() -> f64 {
    let of = |task: std::fs::DirEntry| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split(' ').next()?.parse::<f64>().ok()
    };
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    tasks.filter_map(of).sum::<f64>() / 1e9
}
