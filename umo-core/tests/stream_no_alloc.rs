//! Ten simulated minutes of streams never allocate, from the first sample on: speech, silence in
//! which the host asks for frames, more audio than fits, interrupts, resets, refused calls; on the
//! engine's threads and on the host's.

mod counting;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use counting::{allocated, allocator_calls, check_counter};
use umo_core::{
    Clock, Engine, EngineConfig, GestureOptions, Idle, LipShape, Model, ModelFile, Poll, Precision, Session,
    SessionConfig, SessionError, Threads, Voice,
};
use umo_kernels::Isa;

/// Simulated seconds for each model on each kind of threads.
const SECONDS: usize = 600 / 10;
/// Factor by which a run may be extended if the engine's own threads got no processor time.
const PATIENCE: usize = 50;
/// Audio of one call, 48 kHz stereo.
const PIECE: usize = 480 * 2;

fn main() {
    check_counter();
    let audio: Vec<f32> = (0_u32..48_000 * 2 / 3).map(|i| (i as f32 * 0.013).sin() * 0.4).collect();
    for name in ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit", "frames_seven"] {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name);
        let file = ModelFile::open(&folder.join("model.safetensors")).expect("a golden model");
        let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).expect("a golden model"));
        for threads in [Threads::Own(2), Threads::Host(1)] {
            run(&model, threads, &audio, name);
        }
    }
    println!("no allocation in ten minutes of streams");
    for name in ["hubert_k3_i8", "mel_k2_arkit", "frames_seven"] {
        rolled_back(name, &audio);
    }
    println!("no allocation in 1,000 saves and restores");
    mouth_alone(&audio);
    let default = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models/umo-people/model.safetensors");
    let small = state(&default);
    assert!(small <= 2 << 20, "a session of the default model takes {small} bytes");
    let further = further_thread(&default);
    assert!(further <= 28 << 20, "a further thread of an engine of the default model takes {further} bytes");
    // The base model is too large for a test; if it is available, its session is measured too.
    if let Some(path) = std::env::var_os("UMO_BASE_MODEL") {
        let base = state(&PathBuf::from(path));
        assert!(base <= 24 << 20, "a session of the base model takes {base} bytes");
    }
}

/// Bytes of one session with the model's defaults.
fn state(path: &std::path::Path) -> usize {
    let file = ModelFile::open(path).expect("a model");
    let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).expect("a model"));
    let config = EngineConfig { threads: Threads::Host(0), max_sessions: 1, ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(&model), &config).expect("no thread is needed");
    let before = allocated();
    let session = engine.session(&SessionConfig::new(model.config())).expect("a place");
    let bytes = allocated() - before;
    drop(session);
    println!("{}: {bytes} bytes per session", model.config().name);
    bytes
}

/// Bytes of an engine's second thread: its batch.
fn further_thread(path: &std::path::Path) -> usize {
    let file = ModelFile::open(path).expect("a model");
    let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).expect("a model"));
    let bytes = [1, 2].map(|threads| {
        let before = allocated();
        let config = EngineConfig { threads: Threads::Own(threads), ..EngineConfig::default() };
        let engine = Engine::new(Arc::clone(&model), &config).expect("two threads");
        assert_eq!(engine.batches(), threads);
        allocated() - before
    });
    println!("{}: {} bytes per further thread", model.config().name, bytes[1] - bytes[0]);
    bytes[1] - bytes[0]
}

fn run(model: &Arc<Model>, threads: Threads, audio: &[f32], name: &str) {
    let nanos = Arc::new(AtomicU64::new(0));
    let clock = Clock::Manual(Arc::clone(&nanos));
    let config = EngineConfig { threads, max_sessions: 7, max_batch: 2, clock, ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(model), &config).expect("two threads");
    // On its own threads the engine has more sessions, so that each thread has batches.
    let crowd = if matches!(threads, Threads::Own(_)) { 2 } else { 1 };
    assert_eq!(engine.batches(), crowd);
    // The session that is pushed too much is late, so that bodies are held.
    let holds = matches!(threads, Threads::Host(_));
    engine.set_late_limit(holds.then_some(Duration::ZERO));
    let mut session = SessionConfig::new(model.config());
    (session.sample_rate, session.channels, session.idle) = (48_000, 2, Idle::Live);
    session.avatar.target = 2;
    if model.config().depth.is_some() {
        (session.avatar.horizon, session.avatar.guidance) = (2, 2.0);
        session.avatar.text = vec![5, 6, 7];
    }
    let before = allocated();
    let sessions: Vec<_> = (0..3 * crowd).map(|_| engine.session(&session).expect("a place")).collect();
    let state = (allocated() - before) / sessions.len();
    let calls = allocator_calls(|| {
        for piece in 0..SECONDS * 100 * PATIENCE {
            let worked = || sessions.iter().all(|avatar| avatar.stats().chunks > 10);
            if piece >= SECONDS * 100 && worked() {
                break;
            }
            nanos.fetch_add(10_000_000, Ordering::Relaxed);
            for (i, avatar) in sessions.iter().enumerate() {
                play(avatar, audio, piece, i % 3);
            }
            match engine.poll(Duration::from_micros(300)) {
                Ok(Poll::Idle | Poll::More) => {}
                // The engine's own threads need real time, which the simulated clock does not show.
                Err(_) => std::thread::sleep(Duration::from_micros(150)),
            }
        }
    });
    let stats: Vec<_> = sessions.iter().map(Session::stats).collect();
    assert_eq!(calls, 0, "{name}, {threads:?}: allocations");
    assert!(stats.iter().all(|s| s.chunks > 10) && stats[0].silenced > 0, "{name}, {threads:?}: {stats:?}");
    assert!(stats[1].dropped_frames > 0 && stats[2].overruns > 0, "{name}, {threads:?}: {stats:?}");
    let held = stats.iter().map(|s| s.held_chunks).sum::<u64>();
    assert!((held > 0) == holds, "{name}, {threads:?}: {stats:?}");
    println!("{name}, {threads:?}: {} KiB per session; {stats:?}", state / 1024);
}

/// Saves and restores a state a thousand times, in place and elsewhere, from the first one on.
fn rolled_back(name: &str, audio: &[f32]) {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name);
    let file = ModelFile::open(&folder.join("model.safetensors")).expect("a golden model");
    let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).expect("a golden model"));
    let config = EngineConfig { threads: Threads::Host(0), max_sessions: 2, ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(&model), &config).expect("no thread is needed");
    let mut session = SessionConfig::new(model.config());
    (session.sample_rate, session.channels) = (44_100, 2);
    let [one, two] = [0, 1].map(|_| engine.session(&session).expect("a place"));
    let mut state = vec![0; one.state_size()];
    let before = allocated();
    let calls = allocator_calls(|| {
        for round in 0..500 {
            let at = round * 20 % (audio.len() - 6_000);
            one.push_audio(&audio[at..at + 6_000]).expect("nobody else pushes");
            while engine.poll(Duration::from_millis(5)) == Ok(Poll::More) {}
            one.pull_frames(round % 30, |_| ()).expect("nobody else pulls");
            let count = one.save(&mut state).expect("nothing is in work");
            for session in [&two, &one] {
                session.restore(&state[..count]).expect("a state of this model");
            }
            assert!(one.restore(&state[..count / 2]).is_err() && two.save(&mut []).is_err());
            two.pull_frames(3, |_| ()).expect("nobody else pulls");
            let count = two.save(&mut state).expect("nothing is in work");
            one.restore(&state[..count]).expect("a state of this model");
        }
    });
    assert_eq!((calls, allocated()), (0, before), "{name}: allocations");
    assert!(one.stats().chunks > 50, "{name}: {:?}", one.stats());
}

/// Ten simulated minutes of the mouth alone, of which none else is loaded, with saves and restores.
fn mouth_alone(audio: &[f32]) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mel_k2_arkit/model.safetensors");
    let file = ModelFile::open(&path).expect("a golden model");
    let model = Arc::new(Model::load_mouth(&file, Isa::detect()).expect("it has a mouth"));
    let nanos = Arc::new(AtomicU64::new(0));
    let config = EngineConfig { clock: Clock::Manual(Arc::clone(&nanos)), ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(&model), &config).expect("no thread is needed");
    let mut session = SessionConfig { voice: Voice::Mouth, ..SessionConfig::new(model.config()) };
    (session.sample_rate, session.channels, session.idle) = (48_000, 2, Idle::Live);
    let before = allocated();
    let sessions: Vec<_> = (0..3).map(|_| engine.session(&session).expect("nothing is needed")).collect();
    let bytes = (allocated() - before) / sessions.len();
    let mut state = vec![0; sessions[0].state_size()];
    let calls = allocator_calls(|| {
        for piece in 0..600 * 100 {
            nanos.fetch_add(10_000_000, Ordering::Relaxed);
            for (i, avatar) in sessions.iter().enumerate() {
                play(avatar, audio, piece, i);
            }
            assert_eq!(engine.poll(Duration::ZERO), Ok(Poll::Idle));
            if piece % 500 == 0 {
                let count = sessions[0].save(&mut state).expect("nobody else is in a call");
                sessions[0].restore(&state[..count]).expect("a state of this session");
            }
        }
    });
    let stats: Vec<_> = sessions.iter().map(Session::stats).collect();
    assert_eq!(calls, 0, "the mouth alone: allocations");
    assert!(stats.iter().all(|s| s.frames > 100 && s.chunks == 0), "{stats:?}");
    println!("the mouth alone: {} KiB per session; {stats:?}", bytes / 1024);
}

/// The calls of one avatar's host in one hundredth of a second.
fn play(avatar: &Session, audio: &[f32], piece: usize, which: usize) {
    let at = (piece * PIECE) % (audio.len() - PIECE);
    // The first avatar pauses for a second at a time, the third gets more audio than fits.
    let speaks = which != 0 || (piece / 100) % 3 != 2;
    for _ in 0..if which == 2 { 40 } else { usize::from(speaks) } {
        match avatar.push_audio(&audio[at..at + PIECE]) {
            Ok(_) | Err(SessionError::Finished) => {}
            Err(error) => panic!("{error}"),
        }
    }
    if piece % 500 == 77 {
        avatar.push_audio(&[f32::NAN; 2]).ok();
        assert!(avatar.push_audio(&[0.0]).is_err());
        assert!(avatar.sample_pose(f64::NAN, |_| ()).is_err());
        assert!(avatar.interrupt(Duration::MAX).is_err());
        avatar.set_seed(piece as u64).expect("nobody else sets it");
        avatar.set_prompt(&[1, 2, 3]).expect("nobody else sets it");
        assert_eq!(avatar.play_gesture("fly", &GestureOptions::default()), Err(SessionError::UnknownGesture));
    }
    if piece % 7 == 3 {
        let (shape, start) = (LipShape::ALL[piece % 3], piece as f64 / 40.0);
        assert!(avatar.hint_lips(shape, -1.0, 0.1).is_err());
        match avatar.hint_lips(shape, start, 0.1) {
            Ok(()) | Err(SessionError::HintsFull) => {}
            Err(error) => panic!("{error}"),
        }
    }
    if piece % 11 == 5 {
        let (text, start) = (["No!", "hello there", "maybe", "not bad", "table"][piece % 5], piece as f64 / 40.0);
        assert!(avatar.hint_words(text, -1.0, 0.1).is_err());
        match avatar.hint_words(text, start, start + 0.3) {
            Ok(()) | Err(SessionError::WordsFull) => {}
            Err(error) => panic!("{error}"),
        }
    }
    if piece % 150 == 33 {
        let names = ["wave", "nod", "point", "shrug", "count", "bow", "clap"];
        let options = GestureOptions::default().target([1.0, 1.5, 2.0]);
        match avatar.play_gesture(names[piece / 150 % names.len()], &options) {
            Ok(()) | Err(SessionError::GesturesFull) => {}
            Err(error) => panic!("{error}"),
        }
    }
    if which == 1 {
        match piece % 1000 {
            300 => avatar.interrupt(Duration::from_millis(250)).expect("it runs"),
            600 => avatar.finish().expect("it runs"),
            900 => avatar.reset().expect("it runs"),
            _ => {}
        }
    }
    if which == 0 && piece > 300 {
        avatar.set_clock(piece as f64 / 100.0).expect("nobody else pulls");
        assert!(avatar.set_clock(f64::NAN).is_err());
    }
    match which {
        0 => drop(avatar.sample_pose(piece as f64 / 100.0, |_| ()).expect("nobody else pulls")),
        // No pull, so that there is something to drop.
        1 if (200..310).contains(&(piece % 1000)) => {}
        1 => drop(avatar.pull_frames(1, |_| ()).expect("nobody else pulls")),
        // Pulled so rarely that its queue is mostly full.
        _ if piece.is_multiple_of(200) => drop(avatar.pull_frames(1000, |_| ()).expect("nobody else pulls")),
        _ => {}
    }
}
