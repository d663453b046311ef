//! How long a host that lends little time at once waits for it: `polls [SESSIONS [MICROSECONDS]] [MODEL…]`. Every session's
//! chunk becomes due at the same moment, and the engine is polled with the budget (8 sessions, 500 µs) until nothing is
//! due. Where the system says it, polls in which another program took the core are told apart.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use umo_core::engine::{Engine, EngineConfig, Poll, Threads};
use umo_core::model::Model;
use umo_core::session::{Session, SessionConfig};
use umo_core::{ModelFile, Precision};
use umo_kernels::Isa;

/// Chunks of every session whose polls are timed, after as many that are not.
const CHUNKS: usize = 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
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
        let config = EngineConfig {
            threads: Threads::Host(0),
            max_sessions: sessions,
            max_batch: sessions,
            ..EngineConfig::default()
        };
        let engine = Engine::new(Arc::clone(&model), &config)?;
        let config = SessionConfig::new(model.config());
        let avatars = (0..sessions).map(|_| engine.session(&config)).collect::<Result<Vec<_>, _>>()?;
        let (mut alone, mut shared, mut work) = (Vec::new(), Vec::new(), Duration::ZERO);
        for chunk in 0..2 * CHUNKS {
            let samples = model.config().target * model.config().keyframe_stride * config.sample_rate;
            speak(&avatars, samples / model.config().frame_rate)?;
            loop {
                let (switches, start) = (switches(), Instant::now());
                let left = engine.poll(budget)?;
                let took = start.elapsed();
                if chunk >= CHUNKS {
                    work += took;
                    if crate::switches() == switches { &mut alone } else { &mut shared }.push(took);
                }
                if left == Poll::Idle {
                    break;
                }
            }
            avatars.iter().try_for_each(|avatar| avatar.pull_frames(usize::MAX, |_| ()).map(|_| ()))?;
        }
        println!("{}, {}: {sessions} sessions, polls of {budget:?}", file.config().name, Isa::detect().name());
        println!("a chunk of one session: {:.2?}", work / u32::try_from(CHUNKS * sessions)?);
        let (times, chunks) = (engine.stage_times(), u32::try_from(2 * CHUNKS * sessions)?);
        let stages = [times.tokenizer, times.encoder, times.decoder, times.depth, times.interp, times.motion];
        println!(
            "  tokenizer, encoder, decoder, depth, interpolation, motion: {:.2?}",
            stages.map(|time| time / chunks)
        );
        report("with the core for itself", alone);
        report("with the core taken away", shared);
    }
    Ok(())
}

/// Half a second of sound, or what a chunk is, for every session.
fn speak(avatars: &[Session], samples: usize) -> Result<(), Box<dyn std::error::Error>> {
    let sound: Vec<f32> = (0u16..).take(samples).map(|i| (f32::from(i) * 0.03).sin() * 0.3).collect();
    for avatar in avatars {
        avatar.push_audio(&sound)?;
    }
    Ok(())
}

fn report(what: &str, mut polls: Vec<Duration>) {
    polls.sort_unstable();
    let Some(&most) = polls.last() else { return };
    let at = |share: usize| polls[(polls.len() * share / 1000).min(polls.len() - 1)];
    let (half, p99) = (at(500), at(990));
    println!("  {what}: {} polls, p50 {half:.2?}, p99 {p99:.2?}, most {most:.2?}", polls.len());
}

/// How often the calling thread has been put aside, where the system says it.
fn switches() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/thread-self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("nonvoluntary_ctxt_switches:"))?.trim().parse().ok()
}
