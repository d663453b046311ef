//! `umo bench`: measures a model's speed on this machine in a real engine (the paper's runtime table, section 4).

mod energy;
mod neighbours;
mod plot;
mod report;

use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

use umo_core::{Config, Engine, EngineConfig, Isa, LoadError, Model, ModelFile, Precision, SessionConfig, StageTimes};
use umo_core_base::team::Cores;
use umo_core_model::weights::layout::{self, Kind};
use umo_core_model::weights::writer::Storage;
use umo_core_tools::floor::{self, Floor, Machine, Stored};
use umo_self_test::speed::Runner;

use crate::args::Bench;
use crate::failure::Failure;
use crate::{atomic_file, model};
use neighbours::Neighbours;
use report::{Placed, Report};

/// Upper bound on the memory over which bandwidth is measured.
const MAX_READ: usize = 384 << 20;
/// Number of weights that occupies a whole number of bytes in every storage format.
const WEIGHTS: usize = 32;

pub(crate) fn run(args: &Bench) -> Result<(), Failure> {
    if let Some(kind) = args.neighbour {
        neighbours::be(kind);
        return Ok(());
    }
    check(args)?;
    if let Some(row) = args.energy_row {
        return energy::row(args, row);
    }
    if args.energy {
        return energy::run(args);
    }
    let picture = args.plot.as_deref().map(atomic_file::create).transpose()?;
    let report = measure(args)?;
    if args.json {
        println!("{}", report.json())
    } else {
        print!("{report}")
    }
    match picture {
        Some(file) => {
            let svg = plot::draw(&report).map_err(Failure::environment)?;
            atomic_file::commit(file, |out| out.write_all(svg.as_bytes()))
        }
        None => Ok(()),
    }
}

fn check(args: &Bench) -> Result<(), Failure> {
    for (name, value) in [("--chunks", args.chunks), ("--starts", args.starts), ("--sessions", args.sessions)] {
        if !(1..=100_000).contains(&value) {
            return Err(Failure::input(format!("{name} {value}: expected 1 to 100000")));
        }
    }
    if !(0.0..=86_400.0).contains(&args.seconds) {
        return Err(Failure::input(format!("--seconds {}: expected 0 to 86400", args.seconds)));
    }
    Ok(())
}

/// A loaded model, and what its floors and its report need of its file.
struct Loaded {
    model: Arc<Model>,
    /// Time of loading.
    load: Duration,
    config: Config,
    stored: Stored,
    /// Size of all tensors in bytes.
    weights: usize,
}

impl Loaded {
    fn new(args: &Bench, isa: Isa) -> Result<Self, Failure> {
        let compute = &args.engine.compute;
        let file = model::open(compute.model.as_deref())?;
        let precision = compute.precision(Precision::Stored);
        let start = Instant::now();
        let model = Arc::new(Model::load(&file, precision, isa)?);
        let load = start.elapsed();
        let weights = file.tensors().iter().map(|&(.., bytes)| bytes).sum();
        Ok(Self { model, load, config: file.config().clone(), stored: stored(&file, precision)?, weights })
    }
}

fn runner(args: &Bench, loaded: &Loaded) -> Result<Runner, Failure> {
    let mut session = SessionConfig::new(&loaded.config);
    session.avatar.target = args.target.unwrap_or(loaded.config.target);
    // No frames held back, as the paper counts.
    session.avatar.lookahead = 0;
    let config = EngineConfig { machine: Some(Cores::system_at(&args.sys)), ..model::engine_config(&args.engine)? };
    let engine: Engine = model::engine_of(config, Arc::clone(&loaded.model), args.sessions)?;
    Ok(Runner::new(engine, session))
}

fn measure(args: &Bench) -> Result<Report, Failure> {
    let compute = &args.engine.compute;
    let isa = model::isa(compute)?;
    let loaded = Loaded::new(args, isa)?;
    let bench = runner(args, &loaded)?;
    let threads = bench.engine.threads();
    let target = bench.session.avatar.target;

    let neighbours = || args.busy.then(Neighbours::start).transpose();
    let others = neighbours()?;
    let first = bench.first_frames(args.starts)?;
    let before = (bench.engine.stage_times(), processor_time());
    let (chunks, frames) = bench.chunks(args.chunks)?;
    let (before, processor) = (before.0, since(before.1));
    drop(others);
    let times = Times::between(before, bench.engine.stage_times(), args.chunks);
    let memory = memory("VmHWM:");
    let cached = floor::depth_layers(&loaded.config, loaded.stored);
    let peaks = || Machine::measure(threads, isa, usize::min(loaded.weights, MAX_READ), cached);
    let machine = peaks();
    let others = neighbours()?;
    if let Some(limit) = args.late_limit {
        let limit = Duration::try_from_secs_f64(limit / 1e3)
            .map_err(|error| Failure::input(format!("--late-limit {limit}: {error}")))?;
        bench.engine.set_late_limit(Some(limit));
    }
    let before_crowd = processor_time();
    let crowd = if args.seconds > 0.0 { Some(bench.crowd(args.sessions, args.seconds)?) } else { None };
    let crowd_processor = since(before_crowd);
    drop(others);
    let machine = machine.best(peaks());
    let cores = Placed::of(Cores::system_at(&args.sys), &bench.engine);
    let floors = floor::Stages::of(&loaded.config, loaded.stored, target);
    Ok(Report {
        model: loaded.config.name.clone(),
        isa: isa.name(),
        threads,
        cores,
        target,
        load: loaded.load,
        first,
        chunks,
        frames,
        stages: stages(times, &floors, &machine),
        machine,
        memory,
        processor,
        is_busy: args.busy,
        priority: bench.engine.priority(),
        crowd,
        crowd_processor,
    })
}

/// Returns the storage of the language model's product weights during computation: the smallest of all products.
/// If a file mixes formats, the floor is thus a lower bound.
fn stored(file: &ModelFile, precision: Precision) -> Result<Stored, Failure> {
    let stored = |storage| match storage {
        Storage::Int4 => Stored::Int4,
        Storage::Int8 => Stored::Int8,
        Storage::Bf16 | Storage::F16 => Stored::Bf16,
        Storage::F32 | Storage::Bytes => Stored::F32,
    };
    match precision {
        Precision::F32 => Ok(Stored::F32),
        Precision::Bf16 => Ok(Stored::Bf16),
        Precision::Int8 => Ok(Stored::Int8),
        Precision::Stored => {
            let products = layout::specs(file.config(), false).into_iter();
            let products = products.filter(|spec| spec.kind == Kind::Product && spec.name.starts_with("lm."));
            let all =
                products.map(|spec| Ok(stored(file.storage(&spec.name)?))).collect::<Result<Vec<_>, LoadError>>()?;
            Ok(all.into_iter().min_by_key(|stored| stored.bytes(WEIGHTS)).unwrap_or(Stored::F32))
        }
    }
}

/// A stage of a chunk.
#[derive(Debug)]
struct Stage {
    name: &'static str,
    time: Duration,
    floor: Duration,
}

/// Time of each stage per chunk.
struct Times {
    total: StageTimes,
    chunks: u32,
}

impl Times {
    fn between(before: StageTimes, after: StageTimes, chunks: usize) -> Self {
        Self { total: after.since(before), chunks: u32::try_from(chunks).unwrap_or(u32::MAX) }
    }
}

fn stages(times: Times, floors: &floor::Stages, machine: &Machine) -> Vec<Stage> {
    let Times { total: t, chunks } = times;
    let stage = |name, time: Duration, floors: &[Floor]| {
        let floor = machine.time_in_turn(floors);
        Stage { name, time: time / chunks, floor }
    };
    let mut stages = vec![
        stage("audio tokenizer", t.tokenizer, &[floors.tokenizer]),
        stage("encoder attention", t.encoder_layers.attention, &[floors.encoder_attention]),
        stage("encoder experts", t.encoder_layers.experts, &[floors.encoder_experts]),
        stage("decoder attention", t.decoder_layers.attention + cross(&t), &[floors.cross, floors.decoder_attention]),
        stage("decoder experts", t.decoder_layers.experts, &[floors.decoder_experts]),
        stage("depth network", t.depth, &[floors.depth]),
        stage("interpolation", t.interp, &[floors.interp]),
        stage("motion decoders", t.motion, &[floors.motion]),
    ];
    // The layout `parts` has no depth network.
    stages.retain(|stage| stage.name != "depth network" || stage.floor > Duration::ZERO);
    stages
}

/// Returns the decoder's time outside its layers: keys and values of the encoder's states, and the output heads.
fn cross(times: &StageTimes) -> Duration {
    times.decoder - times.decoder_layers.attention - times.decoder_layers.experts
}

/// Returns the processor time used so far by all threads of this process, to a hundredth of a second;
/// `None` if the system does not report it.
fn processor_time() -> Option<Duration> {
    const TICK: Duration = Duration::from_millis(10);
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The program's name may contain anything, so parsing starts after it; user and system time are the
    // twelfth and thirteenth fields from there.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let ticks: u32 = fields.next()?.parse::<u32>().ok()? + fields.next()?.parse::<u32>().ok()?;
    Some(TICK * ticks)
}

/// Returns the processor time used since `before`.
fn since(before: Option<Duration>) -> Option<Duration> {
    processor_time()?.checked_sub(before?)
}

/// Returns memory of the process in bytes, if the system reports it: `VmHWM:` at its peak, `VmRSS:` now.
fn memory(key: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(key))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}
