//! The batching window: how long chunks wait to be computed together, and which chunks do not wait.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use umo_core::{Clock, Engine, EngineConfig, Model, ModelFile, Poll, Precision, Session, SessionConfig, Threads};
use umo_kernels::Isa;

const MILLISECOND: u64 = 1_000_000;
const PATIENCE: Duration = Duration::from_secs(60);
/// Batching window of the engine with threads.
const BATCH_WINDOW: Duration = Duration::from_millis(30);

fn model() -> Arc<Model> {
    let golden = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mel_k2_arkit");
    let file = ModelFile::open(&golden.join("model.safetensors")).unwrap();
    Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).unwrap())
}

/// An engine that the test polls, with a simulated clock.
struct Host {
    engine: Engine,
    nanos: Arc<AtomicU64>,
    chunk: usize,
    /// Audio of one chunk.
    sound: Vec<f32>,
}

impl Host {
    fn new(batch_window: Duration, max_batch: usize) -> Self {
        let nanos = Arc::new(AtomicU64::new(0));
        let config = EngineConfig {
            threads: Threads::Host(0),
            clock: Clock::Manual(Arc::clone(&nanos)),
            max_batch,
            batch_window,
            ..EngineConfig::default()
        };
        let engine = Engine::new(model(), &config).unwrap();
        let config = engine.model().config();
        let chunk = config.target * config.samples_per_keyframe();
        let sound = (0..chunk).map(|i| (i as f32 * 0.05).sin() * 0.3).collect();
        Self { engine, nanos, chunk, sound }
    }

    /// A session whose first chunks are done: each further chunk of audio makes one due.
    fn speaking(&self) -> Session {
        let session = self.engine.session(&SessionConfig::new(self.engine.model().config())).unwrap();
        for _ in 0..3 {
            self.push(&session);
            self.pass(1000);
            self.compute();
        }
        assert!(session.stats().chunks > 0);
        session
    }

    fn push(&self, session: &Session) {
        assert_eq!(session.push_audio(&self.sound).unwrap().taken, self.chunk);
        session.pull_frames(usize::MAX, |_| ()).unwrap();
    }

    fn pass(&self, milliseconds: u64) {
        self.nanos.fetch_add(milliseconds * MILLISECOND, Ordering::Relaxed);
    }

    /// Computes all that may be computed now.
    fn compute(&self) {
        while self.engine.poll(Duration::MAX).unwrap() == Poll::More {}
    }
}

/// Number of chunks that each session gains by `act`.
fn done(sessions: &[&Session], act: impl FnOnce()) -> Vec<u64> {
    let count = |session: &&Session| session.stats().chunks;
    let before: Vec<_> = sessions.iter().map(count).collect();
    act();
    sessions.iter().map(count).zip(before).map(|(now, before)| now - before).collect()
}

#[test]
fn a_chunk_waits_until_another_fills_the_batch_or_its_time_is_over() {
    let host = Host::new(Duration::from_millis(50), 2);
    let (one, other, third) = (host.speaking(), host.speaking(), host.speaking());
    let all = [&one, &other, &third];
    let compute = || host.compute();
    host.push(&one);
    assert_eq!(done(&all, compute), [0, 0, 0]);
    host.pass(49);
    assert_eq!(done(&all, compute), [0, 0, 0]);
    host.push(&other);
    assert_eq!(done(&all, compute), [1, 1, 0], "a batch is full");
    host.push(&third);
    assert_eq!(done(&all, compute), [0, 0, 0]);
    host.pass(51);
    assert_eq!(done(&all, compute), [0, 0, 1], "it has waited for as long as it may");
}

#[test]
fn no_chunk_waits_longer_than_half_of_its_length() {
    let host = Host::new(Duration::from_secs(10), 8);
    let (one, other) = (host.speaking(), host.speaking());
    let config = host.engine.model().config();
    let length = (config.target * config.keyframe_stride * 1000 / config.frame_rate) as u64;
    host.push(&one);
    host.pass(length / 2 - 2);
    assert_eq!(done(&[&one, &other], || host.compute()), [0, 0]);
    host.pass(4);
    assert_eq!(done(&[&one, &other], || host.compute()), [1, 0]);
}

#[test]
fn who_has_nobody_to_wait_for_does_not_wait() {
    let host = Host::new(Duration::from_millis(50), 8);
    let one = host.speaking();
    host.push(&one);
    assert_eq!(done(&[&one], || host.compute()), [1], "there is no other session");
    let other = host.speaking();
    host.push(&one);
    host.push(&other);
    assert_eq!(done(&[&one, &other], || host.compute()), [1, 1], "all are due");
}

#[test]
fn the_start_of_a_stream_does_not_wait_and_takes_others_along() {
    let host = Host::new(Duration::from_millis(50), 8);
    let (one, other, third) = (host.speaking(), host.speaking(), host.speaking());
    let all = [&one, &other, &third];
    host.push(&one);
    assert_eq!(done(&all, || host.compute()), [0, 0, 0]);
    other.reset().unwrap();
    let start = || {
        let before = other.stats().chunks;
        while other.stats().chunks == before {
            host.push(&other);
            host.compute();
        }
    };
    assert_eq!(done(&all, start), [1, 1, 0]);
}

/// Its chunks become due when its frame queue has room.
#[test]
fn chunks_whose_audio_was_there_before_wait_too() {
    let host = Host::new(Duration::from_millis(50), 8);
    let (one, other) = (host.speaking(), host.speaking());
    // As much as its frame queue has room for, and more.
    for _ in 0..20 {
        assert_eq!(one.push_audio(&host.sound).unwrap().taken, host.chunk);
    }
    let until_full = || {
        for _ in 0..20 {
            host.pass(51);
            host.compute();
        }
    };
    let full = done(&[&one, &other], until_full);
    assert!(full[0] > 0 && full[0] < 20, "{full:?}");
    one.pull_frames(usize::MAX, |_| ()).unwrap();
    assert_eq!(done(&[&one, &other], || host.compute()), [0, 0]);
    host.pass(51);
    assert_eq!(done(&[&one, &other], || host.compute()), [1, 0]);
}

/// On the engine's own threads, which sleep while chunks wait.
#[test]
fn own_threads_compute_what_has_waited() {
    for threads in [1, 2] {
        let config =
            EngineConfig { threads: Threads::Own(threads), batch_window: BATCH_WINDOW, ..EngineConfig::default() };
        let engine = Engine::new(model(), &config).unwrap();
        let sessions: Vec<_> =
            (0..6).map(|_| engine.session(&SessionConfig::new(engine.model().config())).unwrap()).collect();
        let config = engine.model().config();
        let chunk = config.target * config.samples_per_keyframe();
        let sound: Vec<f32> = (0..chunk).map(|i| (i as f32 * 0.05).sin() * 0.3).collect();
        let push = |session: &Session| {
            session.push_audio(&sound).unwrap();
            session.pull_frames(usize::MAX, |_| ()).unwrap();
        };
        let wait = |session: &Session, chunks: u64| {
            let start = Instant::now();
            while session.stats().chunks < chunks {
                assert!(start.elapsed() < PATIENCE, "a chunk was forgotten");
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        for chunks in 1..=2 {
            sessions.iter().for_each(push);
            sessions.iter().for_each(|session| wait(session, chunks));
        }
        // Each session alone, with a chunk that has to wait; without batching it would be computed at once.
        for session in &sessions {
            let (start, before) = (Instant::now(), session.stats().chunks);
            push(session);
            wait(session, before + 1);
            assert!(start.elapsed() >= BATCH_WINDOW, "it did not wait");
        }
    }
}
