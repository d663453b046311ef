//! Size of a session's state and time to save and restore it: `state MODEL…`, for a session at 48 kHz in
//! the middle of speech, and for one with full rings. Medians of 300.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use umo_core::{Engine, EngineConfig, Model, ModelFile, Poll, Precision, Session, SessionConfig, Threads};
use umo_kernels::Isa;

/// Number of saves and restores per median.
const TIMES: usize = 300;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for path in std::env::args().skip(1) {
        let file = ModelFile::open(Path::new(&path))?;
        let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect())?);
        let config = EngineConfig { threads: Threads::Host(1), max_sessions: 1, ..EngineConfig::default() };
        let engine = Engine::new(Arc::clone(&model), &config)?;
        let session = engine.session(&SessionConfig { sample_rate: 48_000, ..SessionConfig::new(model.config()) })?;
        println!("{path}: at most {} bytes", session.state_size());
        for _ in 0..4 {
            speak(&engine, &session, 48_000)?;
        }
        session.pull_frames(usize::MAX, |_| ())?;
        speak(&engine, &session, 48_000)?;
        measure("speaks", &session)?;
        while speak(&engine, &session, 48_000)? > 0 {}
        measure("is full", &session)?;
    }
    Ok(())
}

/// Pushes sound and computes the due chunks; returns the sample frames taken.
fn speak(engine: &Engine, session: &Session, frames: u16) -> Result<usize, Box<dyn std::error::Error>> {
    let samples: Vec<f32> = (0..frames).map(|i| (f32::from(i) * 0.03).sin() * 0.3).collect();
    let pushed = session.push_audio(&samples)?;
    while engine.poll(Duration::from_secs(1))? == Poll::More {}
    Ok(pushed.taken)
}

fn measure(what: &str, session: &Session) -> Result<(), Box<dyn std::error::Error>> {
    let mut bytes = vec![0; session.state_size()];
    let (mut saves, mut restores, mut count) = (Vec::new(), Vec::new(), 0);
    for _ in 0..TIMES {
        let start = Instant::now();
        count = session.save(&mut bytes)?;
        saves.push(start.elapsed());
        let start = Instant::now();
        session.restore(&bytes[..count])?;
        restores.push(start.elapsed());
    }
    saves.sort_unstable();
    restores.sort_unstable();
    println!("  {what}: {count} bytes, saved in {:?}, restored in {:?}", saves[TIMES / 2], restores[TIMES / 2]);
    Ok(())
}
