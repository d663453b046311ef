//! Waiting times of a host that polls with small budgets: `polls [held] [SESSIONS [MICROSECONDS]] [MODEL…]`. The chunks
//! of all sessions become due at the same moment, and the engine is polled with the budget (8 sessions, 500 µs) until
//! nothing is due. With a budget of 0 every poll is one step, and each kind of step has a line with its durations. With
//! `held` all chunks are so late that their bodies are frozen.
//!
//! Times are this thread's processor time if the system reports it, so that other programs on the core do not count.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use umo_core::{Clock, Engine, EngineConfig, Model, ModelFile, Poll, Precision, Session, SessionConfig, Threads};
use umo_kernels::Isa;

/// Timed chunks of all sessions together, and their limits per session; as many come before, untimed.
const CHUNKS: usize = 640;
const MOST: usize = 20;
const LEAST: usize = 3;
/// Number of chunks after which every body is frozen if all are late.
const UNTIL_HELD: usize = 20;
/// Number of further chunks of each session then due at once, and the nanoseconds between two such moments.
const MORE: usize = 2;
const LATE: u64 = 10_000_000_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let held = words.first().is_some_and(|word| word == "held");
    if held {
        words.remove(0);
    }
    let numbers: Vec<u64> = words.iter().map_while(|word| word.parse().ok()).collect();
    let sessions = usize::try_from(numbers.first().copied().unwrap_or(8))?;
    let budget = Duration::from_micros(numbers.get(1).copied().unwrap_or(500));
    let mut models: Vec<PathBuf> = words.iter().skip(numbers.len()).map(PathBuf::from).collect();
    if models.is_empty() {
        models.push(Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/umo-people/model.safetensors"));
    }
    for path in models {
        let file = ModelFile::open(&path)?;
        let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect())?);
        let nanos = Arc::new(AtomicU64::new(0));
        let config = EngineConfig {
            threads: Threads::Host(0),
            clock: if held { Clock::Manual(Arc::clone(&nanos)) } else { Clock::system() },
            max_sessions: sessions,
            max_batch: sessions.min(umo_core::MAX_BATCH),
            ..EngineConfig::default()
        };
        let engine = Engine::new(Arc::clone(&model), &config)?;
        let config = SessionConfig::new(model.config());
        let avatars = (0..sessions).map(|_| engine.session(&config)).collect::<Result<Vec<_>, _>>()?;
        engine.set_late_limit(held.then_some(Duration::ZERO));
        let timed = (CHUNKS / sessions).clamp(LEAST, MOST);
        let first = if held { UNTIL_HELD } else { timed };
        let mut own = Vec::new();
        let mut kinds: BTreeMap<&str, Vec<Duration>> = BTreeMap::new();
        for chunk in 0..first + timed {
            let samples = model.config().target * model.config().keyframe_stride * config.sample_rate;
            speak(&avatars, samples / model.config().frame_rate)?;
            for _ in 0..if held { MORE } else { 0 } {
                speak(&avatars, samples / model.config().frame_rate)?;
            }
            nanos.fetch_add(LATE, Ordering::Relaxed);
            loop {
                let kind = engine.next_step().unwrap_or_default();
                let start = now();
                let left = engine.poll(budget)?;
                let took = now().saturating_sub(start);
                if chunk >= first {
                    own.push(took);
                    if budget.is_zero() {
                        kinds.entry(kind).or_default().push(took);
                    }
                }
                if left == Poll::Idle {
                    break;
                }
            }
            avatars.iter().try_for_each(|avatar| avatar.pull_frames(usize::MAX, |_| ()).map(|_| ()))?;
        }
        println!("{}, {}: {sessions} sessions, polls of {budget:?}", file.config().name, Isa::detect().name());
        let chunks = u32::try_from(timed * sessions * if held { 1 + MORE } else { 1 })?;
        let held_chunks: u64 = avatars.iter().map(|avatar| avatar.stats().held_chunks).sum();
        println!("a chunk of one session: {:.2?} {OF}; {held_chunks} held", own.iter().sum::<Duration>() / chunks);
        report("polls", own, chunks);
        for (kind, times) in kinds {
            report(kind, times, chunks);
        }
    }
    Ok(())
}

/// Pushes half a second of sound, or a chunk of it, to every session.
fn speak(avatars: &[Session], samples: usize) -> Result<(), Box<dyn std::error::Error>> {
    let sound: Vec<f32> = (0u16..).take(samples).map(|i| (f32::from(i) * 0.03).sin() * 0.3).collect();
    for avatar in avatars {
        avatar.push_audio(&sound)?;
    }
    Ok(())
}

fn report(what: &str, mut times: Vec<Duration>, chunks: u32) {
    times.sort_unstable();
    let Some(&most) = times.last() else { return };
    let at = |share: usize| times[(times.len() * share / 1000).min(times.len() - 1)];
    let (half, p99, sum) = (at(500), at(990), times.iter().sum::<Duration>() / chunks);
    println!("  {what}: {} times, {sum:.2?} a chunk, p50 {half:.2?}, p99 {p99:.2?}, most {most:.2?}", times.len());
}

/// Meaning of the times of [`now`].
const OF: &str = if cfg!(target_os = "linux") { "of the thread's own" } else { "elapsed" };

/// Processor time of the calling thread, or if the system does not report it, the time since the program began.
fn now() -> Duration {
    #[cfg(target_os = "linux")]
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    #[cfg(target_os = "linux")]
    return Duration::try_from(time).unwrap_or_default();
    #[cfg(not(target_os = "linux"))]
    {
        static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
        START.elapsed()
    }
}
