//! Long-running test of speaking avatars: late frames, memory growth, durations of
//! chunks.
//!
//! `soak [--seconds S] [--sessions N] [--threads T] [--model M] [--real]`: with `--real` like an
//! application, with an audio thread and a game thread beside the engine's own threads.
//! Without it, on a simulated clock that runs while the engine computes and jumps to the next event
//! when it is idle: an hour takes a minute or two. Exits with code 1 if a frame
//! was late or memory has grown.

#[path = "../umo-core/tests/counting/mod.rs"]
mod counting;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Barrier};
use std::time::{Duration, Instant};

use counting::{allocated, allocator_calls, check_counter};
use umo_core::{Clock, Engine, EngineConfig, Idle, Model, ModelFile, Poll, Precision, Session, SessionConfig, Threads};
use umo_kernels::Isa;

/// Audio comes in pieces of 10 ms, 48 kHz stereo.
const RATE: usize = 48_000;
const PIECE: usize = RATE / 100 * 2;
const AUDIO_NANOS: u64 = 10_000_000;
/// The game draws 60 times a second.
const GAME_NANOS: u64 = 16_666_667;
/// Avatars pause equally long in every turn, and are interrupted once in many turns.
const TURN_SECONDS: u64 = 11;
const PAUSE_SECONDS: u64 = 2;
const INTERRUPT_SECONDS: u64 = 37;

struct Args {
    seconds: u64,
    sessions: usize,
    threads: usize,
    model: PathBuf,
    real: bool,
}

impl Args {
    fn parse() -> Result<Self, String> {
        let model = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models/umo-people/model.safetensors");
        let mut args = Self { seconds: 3600, sessions: 8, threads: 2, model, real: false };
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or(format!("{word} wants a value"));
            let number = |text: String| text.parse::<usize>().map_err(|error| format!("{text}: {error}"));
            match word.as_str() {
                "--real" => args.real = true,
                "--model" => args.model = value()?.into(),
                "--seconds" => args.seconds = number(value()?)? as u64,
                "--sessions" => args.sessions = number(value()?)?,
                "--threads" => args.threads = number(value()?)?,
                _ => return Err(format!("unknown: {word}")),
            }
        }
        Ok(args)
    }
}

fn main() -> ExitCode {
    match Args::parse().and_then(|args| run(&args)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(args: &Args) -> Result<bool, String> {
    check_counter();
    let file = ModelFile::open(&args.model).map_err(|error| error.to_string())?;
    let model = Model::load(&file, Precision::Stored, Isa::detect()).map_err(|error| error.to_string())?;
    let nanos = Arc::new(AtomicU64::new(0));
    let (threads, clock) = match args.real {
        true => (Threads::Own(args.threads), Clock::system()),
        false => (Threads::Host(args.threads.saturating_sub(1)), Clock::Manual(Arc::clone(&nanos))),
    };
    let config = EngineConfig { threads, clock, max_sessions: args.sessions, ..EngineConfig::default() };
    let engine = Engine::new(Arc::new(model), &config).map_err(|error| error.to_string())?;
    let mut session = SessionConfig::new(file.config());
    (session.sample_rate, session.channels) = (RATE, 2);
    let avatars = (0..args.sessions).map(|which| {
        session.idle = [Idle::Live, Idle::Rest, Idle::Hold][which % 3];
        let session = engine.session(&session).map_err(|error| error.to_string())?;
        Ok(Avatar { session, which: which as u64 })
    });
    let avatars = avatars.collect::<Result<Vec<_>, String>>()?;
    let soak = Soak { avatars, engine, audio: speech(), end: args.seconds * 1_000_000_000, nanos };

    let before = (allocated(), resident());
    let start = Instant::now();
    let calls = if args.real { soak.real() } else { allocator_calls(|| soak.simulated()) };
    let growth = allocated() as i64 - before.0 as i64;
    let resident = resident().zip(before.1).map(|(after, before)| after as i64 - before as i64);

    let mode = if args.real { "in real time" } else { "on a simulated clock" };
    let (name, isa) = (&file.config().name, Isa::detect().name());
    println!("{name}, {isa}: {} sessions on {} threads for {} s {mode}", args.sessions, args.threads, args.seconds);
    println!("took                         {:.0} s", start.elapsed().as_secs_f64());
    let late = soak.report();
    println!("calls of the allocator       {calls}");
    println!("bytes allocated, growth      {growth}");
    if let Some(resident) = resident {
        println!("resident memory, growth      {resident} KiB, including pages first touched after the start");
    }
    Ok(late == 0 && growth == 0 && calls == 0)
}

struct Avatar {
    session: Session,
    which: u64,
}

impl Avatar {
    /// The avatar's audio and calls in the 10 ms from `now` on.
    fn speak(&self, now: u64, audio: &[f32]) {
        let (second, piece) = (now / 1_000_000_000 + 3 * self.which, now / AUDIO_NANOS);
        if piece % (100 * INTERRUPT_SECONDS) == 100 * self.which + 50 {
            self.session.interrupt(Duration::from_millis(300)).expect("the session runs");
        }
        if second % TURN_SECONDS >= PAUSE_SECONDS {
            let at = usize::try_from(piece + 31 * self.which).unwrap_or(0) * PIECE % (audio.len() - PIECE);
            self.session.push_audio(&audio[at..at + PIECE]).expect("the session runs");
        }
    }

    /// Shows the avatar at `now`: every second avatar at the game's own rate.
    fn draw(&self, now: u64) {
        if self.which.is_multiple_of(2) {
            self.session.pull_frames(usize::MAX, |_| ()).expect("the session runs");
        } else {
            self.session.sample_pose(now as f64 * 1e-9 - 1.5, |_| ()).expect("the session runs");
        }
    }
}

struct Soak {
    avatars: Vec<Avatar>,
    engine: Engine,
    audio: Vec<f32>,
    /// Nanoseconds.
    end: u64,
    nanos: Arc<AtomicU64>,
}

impl Soak {
    /// Advances the clock by the computing time, one layer at a time; if nothing is to be computed,
    /// to the next event.
    fn simulated(&self) {
        let (mut now, mut audio, mut frame) = (0, 0, 0);
        while now < self.end {
            self.nanos.store(now, Ordering::Relaxed);
            while audio <= now {
                self.avatars.iter().for_each(|avatar| avatar.speak(audio, &self.audio));
                audio += AUDIO_NANOS;
            }
            if frame <= now {
                self.avatars.iter().for_each(|avatar| avatar.draw(now));
                frame = now + GAME_NANOS;
            }
            let start = Instant::now();
            let left = self.engine.poll(Duration::ZERO).expect("nobody else polls");
            now = match left {
                Poll::More => now + u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX / 2),
                Poll::Idle => audio.min(frame),
            };
        }
    }

    /// Runs an audio thread and a game thread; returns the allocator calls from the first push to the last
    /// pull.
    fn real(&self) -> usize {
        let (gate, speaking) = (&Barrier::new(3), &AtomicBool::new(true));
        std::thread::scope(|scope| {
            std::thread::Builder::new()
                .name("audio".to_owned())
                .spawn_scoped(scope, move || {
                    gate.wait();
                    gate.wait();
                    every(AUDIO_NANOS, |now| {
                        self.avatars.iter().for_each(|avatar| avatar.speak(now, &self.audio));
                        now < self.end
                    });
                    speaking.store(false, Ordering::SeqCst);
                    gate.wait();
                    gate.wait();
                })
                .expect("a thread can be started");
            std::thread::Builder::new()
                .name("game".to_owned())
                .spawn_scoped(scope, move || {
                    gate.wait();
                    gate.wait();
                    every(GAME_NANOS, |now| {
                        self.avatars.iter().for_each(|avatar| avatar.draw(now));
                        speaking.load(Ordering::SeqCst)
                    });
                    gate.wait();
                    gate.wait();
                })
                .expect("a thread can be started");
            gate.wait();
            // Lets the threads that loaded the model become idle.
            std::thread::sleep(Duration::from_millis(500));
            // Tracers of this process look for these two lines.
            eprintln!("the steady phase begins");
            let calls = allocator_calls(|| {
                gate.wait();
                gate.wait();
            });
            eprintln!("the steady phase ends");
            gate.wait();
            calls
        })
    }

    /// Prints the avatars' statistics; returns the number of late frames.
    fn report(&self) -> u64 {
        let stats: Vec<_> = self.avatars.iter().map(|avatar| avatar.session.stats()).collect();
        let sum = |of: fn(&umo_core::Stats) -> u64| stats.iter().map(of).sum::<u64>();
        println!("chunks                       {}", sum(|s| s.chunks));
        println!("frames                       {}", sum(|s| s.frames));
        println!("dropped by interrupts        {}", sum(|s| s.dropped_frames));
        println!("overruns                     {}", sum(|s| s.overruns));
        println!("late frames                  {}", sum(|s| s.late_frames));
        let worst = |of: fn(&umo_core::Latency) -> Duration| {
            let all = self.avatars.iter().map(|avatar| of(&avatar.session.latency()));
            1e3 * all.max().unwrap_or_default().as_secs_f64()
        };
        println!(
            "audio to frames, p50         {:.2} ms (of the slowest session, as all below)",
            worst(|l| l.compute_p50)
        );
        println!("audio to frames, p99         {:.2} ms", worst(|l| l.compute_p99));
        println!("audio to frames, p99.9       {:.2} ms", worst(|l| l.compute_p999));
        println!("audio to frames, largest     {:.2} ms", worst(|l| l.compute_max));
        sum(|s| s.late_frames)
    }
}

/// Calls `work` with the nanoseconds since the start, every `period` of them, while it returns
/// true.
fn every(period: u64, mut work: impl FnMut(u64) -> bool) {
    let start = Instant::now();
    let mut now = 0;
    while work(now) {
        now += period;
        std::thread::sleep(Duration::from_nanos(now).saturating_sub(start.elapsed()));
    }
}

/// A third of a minute of tones that swell and fade.
#[expect(clippy::cast_precision_loss, reason = "a million samples have few digits")]
fn speech() -> Vec<f32> {
    let sample = |i: usize| {
        let t = (i / 2) as f32 / RATE as f32;
        (t * 900.0).sin() * (t * 19.0).sin() * 0.4
    };
    (0..20 * RATE * 2).map(sample).collect()
}

/// Resident memory of the process, KiB, if the system reports it.
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix("kB")?.trim().parse().ok()
}
