//! `umo bench`: a model's speed on this machine, in a real engine (the paper's runtime table,
//! section 4).

mod neighbours;
mod plot;
mod report;

use std::f32::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};

use umo_core::avatar::StageTimes;
use umo_core::engine::{Engine, EngineConfig, Priority, Threads};
use umo_core::floor::{self, Floor, Machine, Stored};
use umo_core::model::Model;
use umo_core::session::{Session, SessionConfig};
use umo_core::weights::layout::{self, Kind};
use umo_core::weights::writer::Storage;
use umo_core::{Config, LoadError, ModelFile, Precision};

use crate::args::Bench;
use crate::failure::Failure;
use crate::model;
use neighbours::Neighbours;
use report::{Crowd, Report};

/// A frame is looked for again after this share of the time that it was waited for, and not before
/// `SHORTEST_LOOK`: whoever wakes up thousands of times a second disturbs the engine.
const LOOK_SHARE: u32 = 50;
const SHORTEST_LOOK: Duration = Duration::from_micros(100);
/// Longest wait for a chunk.
const PATIENCE: Duration = Duration::from_secs(120);
/// Audio of one call in real time, 10 ms.
const CALLS_PER_SECOND: usize = 100;
/// Most memory that the bandwidth is measured over.
const MAX_READ: usize = 384 << 20;
/// So many weights take a whole number of bytes however they are stored.
const WEIGHTS: usize = 32;

pub(crate) fn run(args: &Bench) -> Result<(), Failure> {
    if let Some(kind) = args.neighbour {
        neighbours::be(kind);
        return Ok(());
    }
    for (name, value) in [("--chunks", args.chunks), ("--starts", args.starts), ("--sessions", args.sessions)] {
        if !(1..=100_000).contains(&value) {
            return Err(Failure::input(format!("{name} {value}: expected 1 to 100000")));
        }
    }
    if !(0.0..=86_400.0).contains(&args.seconds) {
        return Err(Failure::input(format!("--seconds {}: expected 0 to 86400", args.seconds)));
    }
    let file = model::open(args.model.as_deref())?;
    let (isa, threads) = (model::isa(&args.compute)?, model::threads(&args.compute)?);
    let start = Instant::now();
    let model = Arc::new(Model::load(&file, args.compute.precision(Precision::Stored), isa)?);
    let load = start.elapsed();
    let config = file.config().clone();
    let stored = stored(&file, args.compute.precision(Precision::Stored))?;
    let weights = file.tensors().iter().map(|&(.., bytes)| bytes).sum();
    drop(file);
    let mut session = SessionConfig::new(&config);
    session.avatar.target = args.target.unwrap_or(config.target);
    // Without frames held back, as the paper counts.
    session.avatar.lookahead = 0;
    let priority = Priority::from(args.priority);
    let engine = EngineConfig {
        threads: Threads::Own(threads),
        max_sessions: args.sessions + 1,
        max_batch: args.sessions.min(8),
        priority,
        gather: Duration::from_millis(args.gather.into()),
        ..EngineConfig::default()
    };
    let engine = Engine::new(Arc::clone(&model), &engine).map_err(Failure::input)?;
    if engine.priority() != priority {
        let what = format!("--priority {priority}: the system refuses it: {}", Priority::advice());
        return Err(Failure::environment(what));
    }
    let bench = Runner { engine, session, config: &config, speech: speech(&config) };

    let neighbours = || args.busy.then(Neighbours::start).transpose();
    let others = neighbours()?;
    let first = bench.first_frames(args.starts)?;
    let before = (bench.engine.stage_times(), processor_time());
    let (chunks, frames) = bench.chunks(args.chunks)?;
    let (before, processor) = (before.0, since(before.1));
    drop(others);
    let times = Times::between(before, bench.engine.stage_times(), args.chunks);
    let memory = peak_memory();
    let cached = floor::depth_layers(&config, stored);
    let peaks = || Machine::measure(threads, isa, usize::min(weights, MAX_READ), cached);
    let machine = peaks();
    let others = neighbours()?;
    if let Some(limit) = args.late_limit {
        let limit = Duration::try_from_secs_f64(limit / 1e3)
            .map_err(|error| Failure::input(format!("--late-limit {limit}: {error}")))?;
        bench.engine.set_late_limit(Some(limit));
    }
    let crowd = if args.seconds > 0.0 { Some(bench.crowd(args.sessions, args.seconds)?) } else { None };
    drop(others);
    let machine = machine.best(peaks());
    let floors = floor::Stages::of(&config, stored, bench.session.avatar.target);
    let report = Report {
        model: config.name.clone(),
        isa: isa.name(),
        threads,
        target: bench.session.avatar.target,
        load,
        first,
        chunks,
        frames,
        stages: stages(times, &floors, &machine),
        machine,
        memory,
        processor,
        is_busy: args.busy,
        priority,
        crowd,
    };
    if args.json {
        println!("{}", report.json())
    } else {
        print!("{report}")
    }
    if let Some(path) = &args.plot {
        plot::draw(&report, path).map_err(|error| Failure::environment(format!("{}: {error}", path.display())))?;
    }
    Ok(())
}

/// How the weights of the language model's products are stored while they are computed with: the least of all of them,
/// so that where a file stores some with more bytes, the floor is only lower than it has to be.
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
    // Layout `parts` has no depth network.
    stages.retain(|stage| stage.name != "depth network" || stage.floor > Duration::ZERO);
    stages
}

/// What the decoder does beside its layers: the keys and values of the encoder's states, and the
/// output heads.
fn cross(times: &StageTimes) -> Duration {
    times.decoder - times.decoder_layers.attention - times.decoder_layers.experts
}

struct Runner<'a> {
    engine: Engine,
    session: SessionConfig,
    config: &'a Config,
    speech: Vec<f32>,
}

impl Runner<'_> {
    fn session(&self) -> Result<Session, Failure> {
        self.engine.session(&self.session).map_err(Failure::input)
    }

    /// Samples of a chunk.
    fn chunk(&self) -> usize {
        self.session.avatar.target * self.config.samples_per_keyframe()
    }

    /// Pushes one chunk of audio, and waits until its last frame is there; the time to the first
    /// one, and how many. A stream whose first chunk is a single keyframe has no frame before the
    /// second one, which is pushed then.
    fn one(&self, session: &Session, chunk: usize) -> Result<(Duration, usize), Failure> {
        let at = (chunk * self.chunk()) % (self.speech.len() - self.chunk());
        let push = || {
            let pushed = session.push_audio(&self.speech[at..at + self.chunk()]).map_err(Failure::environment)?;
            if pushed.taken < self.chunk() {
                return Err(Failure::environment("the engine does not keep up with one avatar"));
            }
            Ok(())
        };
        let mut wanted = session.stats().chunks + 1;
        let start = Instant::now();
        push()?;
        while session.ready_frames().map_err(Failure::environment)? == 0 {
            if session.stats().chunks == wanted && session.ready_frames().map_err(Failure::environment)? == 0 {
                wanted += 1;
                push()?;
            }
            if start.elapsed() > PATIENCE {
                return Err(Failure::environment(format!("no frame after {} s", PATIENCE.as_secs())));
            }
            wait_a_little(start);
        }
        let time = start.elapsed();
        while session.stats().chunks < wanted && start.elapsed() < PATIENCE {
            wait_a_little(start);
        }
        Ok((time, session.pull_frames(usize::MAX, |_| ()).map_err(Failure::environment)?))
    }

    /// Times to the first frame of fresh streams, their audio pushed at once.
    fn first_frames(&self, count: usize) -> Result<Vec<Duration>, Failure> {
        let session = self.session()?;
        // Once to touch all memory.
        self.one(&session, 0)?;
        let time = |i| {
            session.reset().map_err(Failure::environment)?;
            Ok(self.one(&session, i)?.0)
        };
        (0..count).map(time).collect()
    }

    /// Times of the chunks of one stream, each pushed when the last one is done; and all their
    /// frames.
    fn chunks(&self, count: usize) -> Result<(Vec<Duration>, usize), Failure> {
        let session = self.session()?;
        self.one(&session, 0)?;
        let mut frames = 0;
        let time = |i| {
            let (time, more) = self.one(&session, i + 1)?;
            frames += more;
            Ok(time)
        };
        Ok(((0..count).map(time).collect::<Result<_, Failure>>()?, frames))
    }

    /// Several avatars that speak in real time, one a little later than the other.
    fn crowd(&self, count: usize, seconds: f64) -> Result<Crowd, Failure> {
        let sessions = (0..count).map(|_| self.session()).collect::<Result<Vec<_>, _>>()?;
        let piece = self.config.audio.sample_rate / CALLS_PER_SECOND;
        let calls_per_chunk = self.chunk() / piece;
        let (start, before, processor) = (Instant::now(), self.engine.stage_times().total(), processor_time());
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a day has 8.6 million")]
        let calls = (seconds * CALLS_PER_SECOND as f64) as usize;
        for call in 0..calls {
            for (i, session) in sessions.iter().enumerate() {
                // Their chunks do not fall together: the first is late by a share of a chunk.
                if call >= i * calls_per_chunk / count {
                    let at = (call * piece + i * self.chunk()) % (self.speech.len() - piece);
                    session.push_audio(&self.speech[at..at + piece]).map_err(Failure::environment)?;
                }
                session.pull_frames(usize::MAX, |_| ()).map_err(Failure::environment)?;
            }
            let next = Duration::from_secs_f64((call + 1) as f64 / CALLS_PER_SECOND as f64);
            std::thread::sleep(next.saturating_sub(start.elapsed()));
        }
        // The last chunks may still be in work.
        std::thread::sleep(Duration::from_millis(200));
        let worked = self.engine.stage_times().total() - before;
        let (stats, latency): (Vec<_>, Vec<_>) = sessions.iter().map(|s| (s.stats(), s.latency())).unzip();
        Ok(Crowd {
            sessions: count,
            seconds: start.elapsed().as_secs_f64(),
            frames: stats.iter().map(|s| s.frames).sum(),
            late: stats.iter().map(|s| s.late_frames).sum(),
            held: stats.iter().map(|s| s.held_chunks).sum(),
            overruns: stats.iter().map(|s| s.overruns).sum(),
            p50: latency.iter().map(|l| l.compute_p50).max().unwrap_or_default(),
            p99: latency.iter().map(|l| l.compute_p99).max().unwrap_or_default(),
            max: latency.iter().map(|l| l.compute_max).max().unwrap_or_default(),
            busy: worked.as_secs_f64() / (start.elapsed().as_secs_f64() * self.engine.batches() as f64),
            processor: since(processor),
        })
    }
}

/// Half a minute of something between a voice and a siren; how long computing takes does not depend
/// on it.
fn speech(config: &Config) -> Vec<f32> {
    let rate = config.audio.sample_rate;
    let sample = |i: usize| {
        let t = i as f32 / rate as f32;
        let envelope = (0.5 - 0.5 * (TAU * 3.1 * t).cos()) * (0.5 + 0.5 * (TAU * 0.23 * t).sin());
        let pitch = 130.0 * t + 4.0 * (TAU * 0.7 * t).sin();
        (1..12).map(|k| (TAU * pitch * k as f32).sin() / k as f32).sum::<f32>() * envelope * 0.2
    };
    (0..30 * rate).map(sample).collect()
}

/// Before something is looked for again that was waited for since `start`.
fn wait_a_little(start: Instant) {
    std::thread::sleep(SHORTEST_LOOK.max(start.elapsed() / LOOK_SHARE));
}

/// The processor time of all threads of this process so far, where the system says it; to the
/// hundredth of a second.
fn processor_time() -> Option<Duration> {
    const TICK: Duration = Duration::from_millis(10);
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // Behind the program's name, which may hold anything: user and system time are the twelfth and
    // thirteenth.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let ticks: u32 = fields.next()?.parse::<u32>().ok()? + fields.next()?.parse::<u32>().ok()?;
    Some(TICK * ticks)
}

/// The processor time from then until now.
fn since(before: Option<Duration>) -> Option<Duration> {
    processor_time()?.checked_sub(before?)
}

/// The most memory that the process ever had, bytes, where the system says it.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}
