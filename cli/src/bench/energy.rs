//! `umo bench --energy`: what a second of an avatar costs in joules, or where the system does not measure them, in
//! instructions and cycles, or processor time. Each row is a process of its own, so that its memory is its own.

mod meter;

use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use umo_core::{Clock, Engine, EngineConfig, Model, Precision, Session, SessionConfig, Threads, Voice};
use umo_core_base::counters::{Counters, Counts};
use umo_core_base::team::Cores;
use umo_self_test::voice;

use crate::args::{Bench, EnergyRow};
use crate::failure::Failure;
use crate::model;
use meter::Meter;

/// Pushes per second in real time, 10 ms of audio each.
const CALLS_PER_SECOND: u32 = 100;
/// Chunks that a row with held bodies gets at once: those after the first are late.
const BURST: usize = 8;
/// Bursts until all bodies are held.
const BURSTS: usize = 24;
/// Avatars of a crowd, if `--sessions` says nothing.
const CROWD: usize = 8;

/// Result of one row.
#[derive(Debug, Deserialize, Serialize)]
struct Taken {
    /// Seconds of avatars: of all together.
    avatar_seconds: f64,
    seconds: f64,
    processor_seconds: Option<f64>,
    joules: Option<f64>,
    instructions: Option<u64>,
    cycles: Option<u64>,
    resident_bytes: Option<u64>,
    late_frames: u64,
    held_chunks: u64,
    slow_chunks: u64,
    chunks: u64,
}

/// Prints the table, a row per setting.
pub(super) fn run(args: &Bench) -> Result<(), Failure> {
    let meter = Meter::open(&args.sys);
    let folder = std::env::temp_dir().join(format!("umo-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(Failure::environment)?;
    let rows = measure(args, &folder);
    drop(std::fs::remove_dir_all(&folder));
    let (idle, rows) = rows?;
    if args.json {
        let rows: Vec<_> =
            rows.iter().map(|(name, taken)| serde_json::json!({ "row": name, "taken": taken })).collect();
        let sources = meter.sources();
        println!("{}", serde_json::json!({ "idle_watts": idle, "energy_of": sources, "rows": rows }));
        return Ok(());
    }
    println!("cores       {}", Cores::system_at(&args.sys));
    match idle {
        Some(watts) => {
            println!("energy of   {}; {watts:.2} W with no avatar, which the rows leave out", meter.sources())
        }
        None => println!("energy of   {}", meter.sources()),
    }
    println!("\na second of avatar      joules  M instructions  M cycles  ms of processor  resident, MB  late frames");
    let shown =
        |value: Option<f64>, digits: usize| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$}"));
    for (name, taken) in &rows {
        let per = |value: f64| value / taken.avatar_seconds.max(1e-9);
        let joules = taken.joules.map(|joules| per(joules - idle.unwrap_or_default() * taken.seconds));
        println!(
            "{name:<22} {:>7} {:>15} {:>9} {:>16} {:>13} {:>12}",
            shown(joules, 3),
            shown(taken.instructions.map(|count| per(count as f64 / 1e6)), 1),
            shown(taken.cycles.map(|count| per(count as f64 / 1e6)), 1),
            shown(taken.processor_seconds.map(|seconds| per(1e3 * seconds)), 2),
            shown(taken.resident_bytes.map(|bytes| bytes as f64 / 1e6), 1),
            taken.late_frames,
        );
    }
    let missing = meter.missing();
    if rows.iter().all(|(_, taken)| taken.joules.is_none()) {
        println!("\nno joules: {missing}");
    }
    if rows.iter().all(|(_, taken)| taken.instructions.is_none()) {
        println!("no instructions or cycles: {}", meter::no_counters(&args.sys));
    }
    Ok(())
}

/// Watts of the machine with no avatar, and what each row took.
#[expect(clippy::type_complexity, reason = "a list of names and values")]
fn measure(args: &Bench, folder: &std::path::Path) -> Result<(Option<f64>, Vec<(String, Taken)>), Failure> {
    let mut meter = Meter::open(&args.sys);
    let idle_time = Duration::from_secs_f64(args.seconds.clamp(0.0, 5.0));
    let start = Instant::now();
    meter.start();
    std::thread::sleep(idle_time);
    let idle = meter.joules().map(|joules| joules / start.elapsed().as_secs_f64());

    let many = if args.sessions > 1 { args.sessions } else { CROWD };
    let given = args.engine.compute.model.as_deref();
    // A file for all: a model embedded in the program stays in memory.
    let whole = folder.join("model.safetensors");
    std::fs::write(&whole, model::bytes(given)?).map_err(Failure::environment)?;
    let mut rows = vec![
        ("one avatar, 1 thread".to_owned(), EnergyRow::Speak, 1, 1, None),
        ("one avatar, 2 threads".to_owned(), EnergyRow::Speak, 1, 2, None),
        (format!("{many} avatars, 1 thread"), EnergyRow::Speak, many, 1, None),
        (format!("{many} avatars, 2 threads"), EnergyRow::Speak, many, 2, None),
    ];
    if let Some(int4) = &args.int4 {
        rows.push(("one avatar, int4".to_owned(), EnergyRow::Speak, 1, 1, Some(int4.as_path())));
    }
    let has_mouth = model::open_quietly(given)?.config().mouth.is_some();
    rows.push(("one, held body".to_owned(), EnergyRow::Held, 1, 1, None));
    if has_mouth {
        rows.push(("one, mouth alone".to_owned(), EnergyRow::Mouth, 1, 1, None));
        rows.push((format!("{many}, mouths alone"), EnergyRow::Mouth, many, 1, None));
    }
    let mut taken = Vec::new();
    for (name, row, sessions, threads, file) in rows {
        taken.push((name, child(args, row, (sessions, threads), file.unwrap_or(&whole))?));
    }
    Ok((idle, taken))
}

/// Measures a row in a process of its own.
fn child(
    args: &Bench,
    row: EnergyRow,
    (sessions, threads): (usize, usize),
    file: &std::path::Path,
) -> Result<Taken, Failure> {
    let program = std::env::current_exe().map_err(Failure::environment)?;
    let mut command = Command::new(program);
    command.args(["bench", "--energy-row", row.name(), "--sys"]).arg(&args.sys);
    command.args(["--sessions", &sessions.to_string(), "--threads", &threads.to_string()]);
    command.args(["--seconds", &args.seconds.to_string(), "--cores", args.engine.cores.name()]);
    if let Some(isa) = &args.engine.compute.isa {
        command.args(["--isa", isa]);
    }
    command.arg("--model").arg(file);
    let ended = command.stdin(Stdio::null()).output().map_err(Failure::environment)?;
    if !ended.status.success() {
        let text = String::from_utf8_lossy(&ended.stderr);
        return Err(Failure::environment(format!("{}: {}", row.name(), text.trim())));
    }
    serde_json::from_slice(&ended.stdout).map_err(Failure::environment)
}

/// Measures one row, and prints it as a line of JSON.
pub(super) fn row(args: &Bench, row: EnergyRow) -> Result<(), Failure> {
    // Before any thread of the engine is started, so that they are counted.
    let counters = Counters::start();
    let compute = &args.engine.compute;
    let (isa, precision) = (model::isa(compute)?, compute.precision(Precision::Stored));
    let file = model::open_quietly(compute.model.as_deref())?;
    let model = Arc::new(match row {
        EnergyRow::Mouth => Model::load_mouth(&file, isa)?,
        EnergyRow::Speak | EnergyRow::Held => Model::load(&file, precision, isa)?,
    });
    drop(file);
    let nanos = Arc::new(AtomicU64::new(0));
    let engine = EngineConfig {
        threads: Threads::Own(model::threads(compute)?),
        max_sessions: args.sessions + 1,
        max_batch: args.engine.batch.min(args.sessions),
        machine: Some(Cores::system_at(&args.sys)),
        clock: if row == EnergyRow::Held { Clock::Manual(Arc::clone(&nanos)) } else { Clock::system() },
        ..args.engine.config(1)
    };
    let engine = Engine::new(Arc::clone(&model), &engine).map_err(Failure::input)?;
    let mut session = SessionConfig::new(model.config());
    if row == EnergyRow::Mouth {
        session.voice = Voice::Mouth;
    }
    let sessions = (0..args.sessions).map(|_| engine.session(&session)).collect::<Result<Vec<_>, _>>();
    let sessions = sessions.map_err(Failure::input)?;
    let chunk = session.avatar.target * model.config().samples_per_keyframe();
    let speech = Speech { samples: voice::samples(model.config().audio.sample_rate, 30.0), chunk };
    if row == EnergyRow::Held {
        engine.set_late_limit(Some(Duration::ZERO));
        for burst in 0..BURSTS {
            speech.burst(&sessions, burst, &nanos)?;
        }
    } else {
        speech.stream(&sessions, model.config().audio.sample_rate, Duration::from_secs(1))?;
    }

    let mut meter = Meter::open(&args.sys);
    let (before, slow, own) = (stats(&sessions), engine.slow_chunks(), counters.read());
    let (processor, start) = (processor_seconds(), Instant::now());
    meter.start();
    let time = Duration::from_secs_f64(args.seconds);
    let seconds_of_avatar = if row == EnergyRow::Held {
        speech.held(&sessions, model.config().audio.sample_rate, time, &nanos)?
    } else {
        speech.stream(&sessions, model.config().audio.sample_rate, time)?
    };
    let seconds = start.elapsed().as_secs_f64();
    let (after, counts) = (stats(&sessions), counters.read());
    let more =
        |of: fn(&Counts) -> Option<u64>| of(&counts).zip(of(&own)).map(|(now, before)| now.saturating_sub(before));
    let taken = Taken {
        avatar_seconds: seconds_of_avatar,
        seconds,
        processor_seconds: processor_seconds().zip(processor).map(|(now, before)| now - before),
        joules: meter.joules().or(more(|counts| counts.energy).map(|nanojoules| nanojoules as f64 / 1e9)),
        instructions: more(|counts| counts.instructions),
        cycles: more(|counts| counts.cycles),
        resident_bytes: super::memory("VmRSS:"),
        late_frames: after.late - before.late,
        held_chunks: after.held - before.held,
        slow_chunks: engine.slow_chunks() - slow,
        chunks: after.chunks - before.chunks,
    };
    println!("{}", serde_json::to_string(&taken).map_err(Failure::environment)?);
    Ok(())
}

/// Processor time of this process's threads so far, seconds; `None` if the system does not report it.
fn processor_seconds() -> Option<f64> {
    let tasks = std::fs::read_dir("/proc/self/task").ok()?;
    let of = |task: std::io::Result<std::fs::DirEntry>| {
        let text = std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<u64>().ok()
    };
    let nanos: u64 = tasks.filter_map(of).sum();
    // Without this file, in hundredths of a second.
    if nanos > 0 { Some(nanos as f64 / 1e9) } else { super::processor_time().map(|time| time.as_secs_f64()) }
}

/// Sums over all sessions.
struct Sums {
    late: u64,
    held: u64,
    chunks: u64,
}

fn stats(sessions: &[Session]) -> Sums {
    let sum = |of: fn(umo_core::Stats) -> u64| sessions.iter().map(|session| of(session.stats())).sum();
    Sums {
        late: sum(|stats| stats.late_frames),
        held: sum(|stats| stats.held_chunks),
        chunks: sum(|stats| stats.chunks),
    }
}

/// Speech to push, and the samples of a chunk.
struct Speech {
    samples: Vec<f32>,
    chunk: usize,
}

impl Speech {
    /// Pushes in real time, with staggered starts; returns the seconds of all avatars.
    fn stream(&self, sessions: &[Session], rate: usize, time: Duration) -> Result<f64, Failure> {
        let (piece, start) = (rate / CALLS_PER_SECOND as usize, Instant::now());
        let calls = (time.as_secs_f64() * f64::from(CALLS_PER_SECOND)).round().max(1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a day has 8.6 million")]
        let calls = calls as u32;
        for call in 0..calls {
            for (i, session) in sessions.iter().enumerate() {
                let offset = i * self.chunk / sessions.len() + i * self.chunk;
                let at = (call as usize * piece + offset) % (self.samples.len() - piece);
                session.push_audio(&self.samples[at..at + piece]).map_err(Failure::environment)?;
                session.pull_frames(usize::MAX, |_| ()).map_err(Failure::environment)?;
            }
            let next = Duration::from_secs(1) * (call + 1) / CALLS_PER_SECOND;
            std::thread::sleep(next.saturating_sub(start.elapsed()));
        }
        Ok(sessions.len() as f64 * f64::from(calls) / f64::from(CALLS_PER_SECOND))
    }

    /// Pushes bursts, each in the time that its sound lasts; returns the seconds of all avatars.
    fn held(&self, sessions: &[Session], rate: usize, time: Duration, nanos: &AtomicU64) -> Result<f64, Failure> {
        let (start, length) = (Instant::now(), (BURST * self.chunk) as f64 / rate as f64);
        let mut bursts = 0_u32;
        while bursts == 0 || start.elapsed() < time {
            self.burst(sessions, bursts as usize, nanos)?;
            bursts += 1;
            let next = Duration::from_secs_f64(length * f64::from(bursts)).min(time);
            std::thread::sleep(next.saturating_sub(start.elapsed()));
        }
        Ok(sessions.len() as f64 * length * f64::from(bursts))
    }

    /// Pushes several chunks at once and waits for them; a tenth of a second passes on the engine's clock.
    fn burst(&self, sessions: &[Session], burst: usize, nanos: &AtomicU64) -> Result<(), Failure> {
        const PATIENCE: Duration = Duration::from_secs(120);
        nanos.fetch_add(100_000_000, Ordering::Relaxed);
        let length = BURST * self.chunk;
        let at = burst * length % (self.samples.len() - length).max(1);
        let wanted: Vec<_> = sessions.iter().map(|session| session.stats().chunks + BURST as u64).collect();
        for session in sessions {
            session.push_audio(&self.samples[at..at + length]).map_err(Failure::environment)?;
        }
        let start = Instant::now();
        for (session, wanted) in sessions.iter().zip(wanted) {
            while session.stats().chunks < wanted {
                session.pull_frames(usize::MAX, |_| ()).map_err(Failure::environment)?;
                if start.elapsed() > PATIENCE {
                    return Err(Failure::environment("the engine does not keep up with one avatar"));
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            session.pull_frames(usize::MAX, |_| ()).map_err(Failure::environment)?;
        }
        Ok(())
    }
}
