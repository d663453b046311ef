//! Invariants of an engine and its sessions: a stream has the frames of the recording, whichever
//! thread computes them and however the audio is cut; and every misuse gets the documented
//! error.

#[path = "engine/epochs.rs"]
mod epochs;
#[path = "engine/gestures.rs"]
mod gestures;
#[path = "engine/idle.rs"]
mod idle;
#[path = "engine/limits.rs"]
mod limits;
#[path = "engine/live.rs"]
mod live;
mod model_bytes;
#[path = "engine/mouth_alone.rs"]
mod mouth_alone;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, OnceLock, Weak};
use std::time::{Duration, Instant};

use model_bytes::ModelBytes;
use proptest::prelude::*;
use umo_core::{
    Animation, AvatarConfig, Clock, Compute, Engine, EngineConfig, EngineError, Frame, Idle, LayerGains, Model,
    ModelFile, Poll, PollError, Pose, Precision, Session, SessionConfig, SessionError, SubmitJobs, Team, Threads,
};
use umo_core_model::audio::resample;
use umo_kernels::Isa;
use umo_tests::{Ends, Noise};

const NAMES: [&str; 4] = ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit"];

/// Golden models of layout `frames`.
const FRAMES: [&str; 2] = ["frames_four", "frames_seven"];

/// The golden models, in f32 and in int8; then the ones of layout `frames`.
static MODELS: LazyLock<Vec<Arc<Model>>> = LazyLock::new(|| {
    let load = |name: &&str, precision| {
        let file = ModelFile::from_bytes(ModelBytes::open(name).bytes()).unwrap();
        Arc::new(Model::load(&file, precision, Isa::detect()).unwrap())
    };
    let floats = NAMES.iter().map(|name| load(name, Precision::F32));
    let parts = floats.chain(NAMES.iter().map(|name| load(name, Precision::Int8)));
    let frames = |precision| FRAMES.iter().map(move |name| load(name, precision));
    parts.chain(frames(Precision::F32)).chain(frames(Precision::Int8)).collect()
});

/// A frame as bits, with its stamps.
#[derive(Clone, Debug, PartialEq)]
struct FrameBits {
    index: u64,
    sample: u64,
    bits: Vec<u32>,
}

impl FrameBits {
    fn of(frame: Frame) -> Self {
        Self { index: frame.index, sample: frame.sample, bits: bits(frame.pose, frame.face) }
    }
}

fn bits(pose: &Pose, face: &[f32]) -> Vec<u32> {
    pose.rotations.as_flattened().iter().chain(&pose.translation).chain(face).map(|v| v.to_bits()).collect()
}

/// Interleaved noise over syllables, whose arousal is heard.
#[expect(clippy::cast_precision_loss, reason = "a few seconds have far fewer than 2^24 samples")]
fn audio(frames: usize, channels: usize, seed: u64) -> Vec<f32> {
    let mut noise = Noise::new(seed);
    let loud = |i: usize| if i / channels % 4000 < 2500 { 0.3 } else { 0.0 };
    (0..frames * channels).map(|i| loud(i) * (0.05 * i as f32).sin() + noise.float(0.02)).collect()
}

fn config(model: &Model, target: usize, lookahead: usize, seed: u64) -> SessionConfig {
    let mut session = SessionConfig::new(model.config());
    session.avatar.target = target.min(model.config().max_target);
    session.avatar.lookahead = lookahead;
    session.avatar.sampler.seed = seed;
    // Layout `frames` has a horizon, and guidance by a text; some of its sessions use them.
    let places = model.config().audio.ahead + 1;
    session.avatar.horizon = usize::try_from(seed % 64).unwrap() % places;
    if FRAMES[1..].iter().any(|name| model.config().name.ends_with(name)) && !seed.is_multiple_of(3) {
        session.avatar.text = vec![5, 6, 7];
        session.avatar.guidance = if seed % 3 == 1 { 2.5 } else { 1.0 };
    }
    session
}

/// The session without layers, which continue during an interrupt and without audio.
fn without_layers(mut session: SessionConfig) -> SessionConfig {
    session.layers = LayerGains::OFF;
    session
}

/// Words with start and end, given before their audio.
type Words = &'static [(&'static str, f64, f64)];

fn words(config: &SessionConfig) -> Words {
    match config.avatar.sampler.seed % 3 {
        0 => &[],
        1 => &[("First,", 0.3, 0.5), ("No,", 0.7, 0.9), ("second,", 1.3, 1.5)],
        _ => &[("There,", 0.6, 0.8), ("no!", 0.9, 1.1)],
    }
}

/// A session that was given its words.
fn told(engine: &Engine, config: &SessionConfig) -> Session {
    let session = engine.session(config).unwrap();
    words(config).iter().for_each(|(text, start, end)| session.hint_words(text, *start, *end).unwrap());
    session
}

/// The frames that `umo animate` makes of a recording.
fn offline(model: &Model, session: &SessionConfig, samples: &[f32]) -> Vec<Vec<u32>> {
    offline_told(model, session, samples, &[])
}

fn offline_told(model: &Model, session: &SessionConfig, samples: &[f32], words: Words) -> Vec<Vec<u32>> {
    let rate = model.config().audio.sample_rate;
    let count = samples.len() / session.channels;
    let mut mono = vec![0.0; count];
    umo_core_base::samples::mix(samples, session.channels, &mut mono);
    let mono = resample::to_rate(&mono, session.sample_rate, rate).unwrap();
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let mut animation =
        Animation::with_layers(model, &session.avatar, session.layers, session.gestures.clone()).unwrap();
    words.iter().for_each(|(text, start, end)| animation.hint_words(text, *start, *end).unwrap());
    animation.push_audio(&mono).unwrap();
    animation.finish(count * model.config().frame_rate / session.sample_rate);
    let mut frames = Vec::new();
    while animation.step(model, cx, &mut |frame| frames.push(bits(frame.pose, frame.face))).unwrap() {}
    frames
}

fn engine(model: &Arc<Model>, threads: Threads, max_batch: usize) -> Engine {
    let config = EngineConfig { threads, max_sessions: 16, max_batch, ..EngineConfig::default() };
    Engine::new(Arc::clone(model), &config).unwrap()
}

/// Lets the engine work: polls it, or gives its threads time.
fn work(engine: &Engine, threads: Threads) {
    match threads {
        Threads::Host(_) => {
            engine.poll(Duration::ZERO).unwrap();
        }
        Threads::Own(_) => std::thread::yield_now(),
    }
}

/// A stream's progress through a session.
struct Drive<'a> {
    session: Session,
    samples: &'a [f32],
    channels: usize,
    /// Frames per push, repeated in a cycle.
    pushes: &'a [usize],
    turn: usize,
    frames: Vec<FrameBits>,
    wanted: usize,
    /// Time when samples were last taken or frames last came.
    progress: Instant,
}

/// Time without progress after which a stream is stuck.
const STUCK: Duration = Duration::from_secs(60);

impl Drive<'_> {
    fn is_done(&self) -> bool {
        self.frames.len() >= self.wanted
    }

    /// Panics with the stream's state if it is stuck.
    fn check_progress(&mut self, before: (usize, usize)) {
        if before != (self.samples.len(), self.frames.len()) || self.is_done() {
            self.progress = Instant::now();
        }
        assert!(
            self.progress.elapsed() < STUCK,
            "no progress in {STUCK:?}: {} samples to push, {} of {} frames, {:?} ready, done: {:?}, {:?}, {:?}",
            self.samples.len(),
            self.frames.len(),
            self.wanted,
            self.session.ready_frames(),
            self.session.is_done(),
            self.session.stats(),
            self.session.latency(),
        );
    }

    /// Pushes the next piece, or ends the stream, and pulls the ready frames.
    fn go_on(&mut self) {
        let size = self.pushes[self.turn % self.pushes.len()] * self.channels;
        let before = (self.samples.len(), self.frames.len());
        self.turn += 1;
        if self.samples.is_empty() {
            self.session.finish().unwrap();
        } else {
            let piece = &self.samples[..size.min(self.samples.len())];
            let pushed = self.session.push_audio(piece).unwrap();
            assert_eq!(pushed.silenced, 0);
            self.samples = &self.samples[pushed.taken * self.channels..];
        }
        let frames = &mut self.frames;
        self.session.pull_frames(self.turn % 5, |frame| frames.push(FrameBits::of(frame))).unwrap();
        self.check_progress(before);
    }
}

fn check(frames: &[FrameBits], wanted: &[Vec<u32>], rate: usize) {
    assert_eq!(frames.len(), wanted.len());
    for (i, (frame, wanted)) in frames.iter().zip(wanted).enumerate() {
        assert_eq!(frame.index, i as u64);
        assert_eq!(frame.sample, (i * rate / 30) as u64);
        assert!(frame.bits == *wanted, "frame {i} of {} differs", frames.len());
    }
}

fn any_threads() -> impl Strategy<Value = Threads> {
    prop_oneof![(0_usize..3).prop_map(Threads::Host), (1_usize..4).prop_map(Threads::Own)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    /// Any model, number of avatars, rate, channels, cut of the audio, computing threads, batch
    /// size.
    #[test]
    fn a_stream_gives_the_frames_of_the_recording(
        which in 0..2 * (NAMES.len() + FRAMES.len()),
        threads in any_threads(),
        max_batch in 1_usize..5,
        avatars in prop::collection::vec(
            (1_usize..4, 0_usize..10, any::<u64>(), prop::sample::select(vec![(16_000_usize, 1_usize), (48_000, 2), (8_000, 1), (44_100, 3)]),
             1_usize..26_000, prop::collection::vec(1_usize..9_000, 1..4)),
            1..5,
        ),
    ) {
        let model = &MODELS[which];
        let engine = engine(model, threads, max_batch);
        let sounds: Vec<Vec<f32>> = avatars.iter()
            .map(|(_, _, seed, (rate, channels), length, _)| audio(length * rate / 16_000, *channels, *seed)).collect();
        let mut streams: Vec<(Drive, Vec<Vec<u32>>, usize)> = avatars.iter().zip(&sounds)
            .map(|((target, lookahead, seed, (rate, channels), _, pushes), samples)| {
                let config = SessionConfig { sample_rate: *rate, channels: *channels, ..config(model, *target, *lookahead, *seed) };
                let frames = offline_told(model, &config, samples, words(&config));
                let session = told(&engine, &config);
                let drive = Drive { session, samples, channels: *channels, pushes, turn: 0, frames: Vec::new(), wanted: frames.len(), progress: Instant::now() };
                (drive, frames, *rate)
            })
            .collect();
        while streams.iter().any(|(drive, ..)| !drive.is_done()) {
            streams.iter_mut().for_each(|(drive, ..)| drive.go_on());
            work(&engine, threads);
        }
        for (drive, wanted, rate) in &streams {
            check(&drive.frames, wanted, *rate);
        }
    }
}

/// Sample by sample, and beside fifteen other avatars.
#[test]
fn single_samples_and_sixteen_avatars_change_nothing() {
    for which in [5, 9] {
        single_samples_and_sixteen_avatars(&MODELS[which]);
    }
}

fn single_samples_and_sixteen_avatars(model: &Arc<Model>) {
    let session = config(model, 2, 4, 77);
    let samples = audio(9_000, 1, 5);
    let wanted = offline_told(model, &session, &samples, words(&session));
    for threads in [Threads::Host(0), Threads::Own(2)] {
        let engine = engine(model, threads, 16);
        let others: Vec<Session> = (0..15).map(|_| engine.session(&config(model, 2, 0, 3)).unwrap()).collect();
        let alone = told(&engine, &session);
        let mut drive = Drive {
            session: alone,
            samples: &samples,
            channels: 1,
            pushes: &[1],
            turn: 0,
            frames: Vec::new(),
            wanted: wanted.len(),
            progress: Instant::now(),
        };
        while !drive.is_done() {
            let at = samples.len() - drive.samples.len();
            drive.go_on();
            if at.is_multiple_of(1_600) && at < samples.len() {
                others.iter().for_each(|other| {
                    assert!(other.push_audio(&samples[at..][..1_600.min(samples.len() - at)]).is_ok())
                });
            }
            work(&engine, threads);
        }
        check(&drive.frames, &wanted, 16_000);
    }
}

/// Computes everything that is due.
fn settle(engine: &Engine) {
    while engine.poll(Duration::from_secs(1)).unwrap() == Poll::More {}
}

fn pull(session: &Session) -> Vec<FrameBits> {
    let mut frames = Vec::new();
    while session.pull_frames(7, |frame| frames.push(FrameBits::of(frame))).unwrap() > 0 {}
    frames
}

fn hosted(which: usize) -> Engine {
    engine(&MODELS[which], Threads::Host(0), 4)
}

/// A poll with no budget does one piece of work, and every piece is short.
#[test]
fn a_chunk_is_cut_into_layers() {
    let engine = hosted(0);
    let session = engine.session(&config(engine.model(), 2, 0, 4)).unwrap();
    session.push_audio(&audio(6_400, 1, 1)).unwrap();
    let mut polls = 0;
    while session.ready_frames().unwrap() == 0 {
        assert_eq!(engine.poll(Duration::ZERO), Ok(Poll::More));
        polls += 1;
    }
    let config = engine.model().config();
    let lm = &config.lm;
    // Eight codes; the encoder, and its keys and values; HuBERT's layers; and the steps between.
    let layers =
        lm.num_layers + lm.num_decoder_layers * (8 + 1) + config.audio.hubert.as_ref().unwrap().num_hidden_layers;
    assert!(polls > layers, "{polls} polls for {layers} layers");
    assert_eq!(engine.poll(Duration::MAX), Ok(Poll::Idle));
}

#[test]
fn poses_between_frames_lie_between_them() {
    let engine = hosted(3);
    let config = config(engine.model(), 2, 0, 4);
    let samples = audio(24_000, 1, 2);
    let wanted = offline_told(engine.model(), &config, &samples, words(&config));
    let session = told(&engine, &config);
    session.push_audio(&samples).unwrap();
    session.finish().unwrap();
    settle(&engine);
    let value = |frame: &[u32], i: usize| f32::from_bits(frame[i]);
    let last = wanted.len() - 1;
    for step in 0..4 * last {
        let (from, part) = (step / 4, step % 4);
        let mut pose = Vec::new();
        let sampled = session.sample_pose((step as f64) / 120.0, |frame| pose = bits(frame.pose, frame.face)).unwrap();
        assert!(!sampled.is_ahead);
        assert!((sampled.oldest - from as f64 / 30.0).abs() < 1e-9);
        assert!((sampled.newest - last as f64 / 30.0).abs() < 1e-9);
        if part == 0 {
            assert!(pose == wanted[from], "frame {from} itself");
        }
        for i in 4 * 55..pose.len() {
            let (a, b, v) = (value(&wanted[from], i), value(&wanted[from + 1], i), value(&pose, i));
            let exact = a + (b - a) * part as f32 / 4.0;
            assert!((v - exact).abs() <= 1e-4 * (1.0 + a.abs().max(b.abs())), "{v} between {a} and {b}");
        }
    }
    // Beyond the newest frame it holds; a time that goes back holds too.
    let mut held = Vec::new();
    let sampled = session.sample_pose(1e6, |frame| held = bits(frame.pose, frame.face)).unwrap();
    assert!(sampled.is_ahead && held == wanted[last]);
    session.sample_pose(0.0, |frame| held = bits(frame.pose, frame.face)).unwrap();
    assert!(held == wanted[last]);
    assert!(matches!(session.sample_pose(f64::NAN, |_| ()), Err(SessionError::Range(_))));
}

/// A clock that the test advances.
fn manual() -> (Clock, Arc<AtomicU64>) {
    let nanos = Arc::new(AtomicU64::new(0));
    (Clock::Manual(Arc::clone(&nanos)), nanos)
}

fn timed(which: usize) -> (Engine, Arc<AtomicU64>) {
    let (clock, nanos) = manual();
    let config =
        EngineConfig { threads: Threads::Host(0), clock, max_sessions: 8, max_batch: 4, ..EngineConfig::default() };
    (Engine::new(Arc::clone(&MODELS[which]), &config).unwrap(), nanos)
}

/// Maximum future audio that any frame needed, found by pushing a few samples at a time.
fn worst_wait(session: &Session, rate: usize, piece: usize, settle: impl Fn()) -> usize {
    let samples = audio(4 * rate, 1, 1);
    let (mut worst, mut seen, mut pushed) = (0, 0, 0);
    for samples in samples.chunks(piece) {
        session.push_audio(samples).unwrap();
        pushed += samples.len();
        settle();
        session
            .pull_frames(1000, |frame| {
                worst = worst.max(pushed - usize::try_from(frame.index).unwrap() * rate / 30);
                seen += 1;
            })
            .unwrap();
    }
    assert!(seen > 60);
    worst
}

#[test]
fn latency_says_what_a_frame_waits_for() {
    let (ahead, _) = timed(9);
    for (target, lookahead, horizon, rate) in [(1, 0, 3, 48_000), (2, 3, 1, 44_100), (2, 0, 2, 16_000)] {
        let mut config = SessionConfig { sample_rate: rate, ..config(ahead.model(), target, lookahead, 1) };
        config.avatar.horizon = 0;
        let heard = config.latency_samples(ahead.model().config()).unwrap();
        config.avatar.horizon = horizon;
        let session = ahead.session(&config).unwrap();
        let said = session.latency().algorithmic_samples;
        assert_eq!(said, heard + horizon * rate / 5, "a keyframe lasts a fifth of a second");
        let worst = worst_wait(&session, rate, 50, || settle(&ahead));
        assert!(worst <= said + 50 && worst + rate / 20 > said, "{target} {horizon} {rate}: {worst}, {said} was said");
    }
    let (engine, nanos) = timed(2);
    for (target, lookahead, rate) in [(1, 0, 48_000), (2, 3, 44_100), (3, 0, 8_000), (1, 2, 22_050)] {
        let config = SessionConfig { sample_rate: rate, ..config(engine.model(), target, lookahead, 1) };
        let session = engine.session(&config).unwrap();
        let said = session.latency().algorithmic_samples;
        assert_eq!(config.latency_samples(engine.model().config()).unwrap(), said);
        let worst = worst_wait(&session, rate, 50, || settle(&engine));
        assert!(
            worst <= said + 50 && worst + rate / 20 > said,
            "{target} {lookahead} {rate}: {worst}, {said} was said"
        );
    }
    let config = config(engine.model(), 2, 3, 1);
    let session = engine.session(&config).unwrap();
    let latency = session.latency();
    let samples = audio(64_000, 1, 1);
    let worst = worst_wait(&session, 16_000, 1, || settle(&engine));
    assert!(worst <= latency.algorithmic_samples, "{worst} > {}", latency.algorithmic_samples);
    assert!(worst + 600 > latency.algorithmic_samples, "{worst} << {}", latency.algorithmic_samples);
    assert_eq!(session.latency().compute_max, Duration::ZERO);
    // A frame is late if its chunk is done after real time needs it.
    assert_eq!(session.stats().late_frames, 0);
    session.push_audio(&samples[..12_800]).unwrap();
    nanos.store(5_000_000_000, Ordering::Relaxed);
    settle(&engine);
    let stats = session.stats();
    assert!(stats.late_frames > 0 && stats.late_frames < stats.frames);
    assert!(session.latency().compute_max >= Duration::from_secs(4));
}

/// The backlog is the pushed audio without frames, beyond the future that every frame needs;
/// it grows while nothing is computed, falls to zero, and its maximum is kept.
#[test]
fn latency_reports_current_and_largest_backlog() {
    for rate in [16_000, 48_000] {
        let (engine, _) = timed(3);
        let config = SessionConfig { sample_rate: rate, ..config(engine.model(), 2, 3, 1) };
        let session = engine.session(&config).unwrap();
        let algorithmic = session.latency().algorithmic_samples;
        let backlog = || (session.latency().backlog_samples, session.latency().backlog_max_samples);
        assert_eq!(backlog(), (0, 0));
        // Audio in real time: the engine keeps up, whatever future a frame needs.
        let samples = audio(6 * rate, 1, 1);
        // Two samples at a time: pushed audio counts as backlog until it is computed.
        for piece in samples[..2 * rate].chunks(2) {
            session.push_audio(piece).unwrap();
            settle(&engine);
            assert_eq!(backlog(), (0, 0));
        }
        // Two seconds without computing: all of it is backlog, less the future that the next frame
        // may need.
        let covered = session.ready_frames().unwrap() * rate / 30;
        session.push_audio(&samples[2 * rate..4 * rate]).unwrap();
        let behind = 4 * rate - covered - algorithmic;
        assert!(behind + algorithmic / 2 >= 2 * rate - algorithmic, "{behind} of {rate} Hz");
        let behind = behind as u64;
        assert_eq!(backlog(), (behind, behind));
        settle(&engine);
        assert_eq!(backlog(), (0, behind));
        // A new stream starts without the old one's backlog.
        session.push_audio(&samples[4 * rate..]).unwrap();
        assert!(backlog().0 > 0);
        session.reset().unwrap();
        session.push_audio(&samples[..10]).unwrap();
        assert_eq!(backlog(), (0, backlog().1));
        settle(&engine);
        assert_eq!(backlog().0, 0);
    }
}

/// Audio, frames and epochs from three threads at once, under the assertions and, in CI, the
/// sanitizers.
#[test]
fn three_threads_at_once() {
    let engine = engine(&MODELS[4], Threads::Own(2), 4);
    let session = engine.session(&config(engine.model(), 1, 0, 4)).unwrap();
    let samples = audio(160_000, 1, 4);
    let done = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        let _end = Ends(&done);
        scope.spawn(|| {
            let _end = Ends(&done);
            for piece in samples.chunks(480).cycle().take(1500) {
                match session.push_audio(piece) {
                    Ok(_) | Err(SessionError::Finished) => {}
                    Err(error) => panic!("{error}"),
                }
                if piece.len() % 7 == 0 {
                    session.finish().unwrap();
                }
            }
        });
        scope.spawn(|| {
            for round in 0_u32.. {
                if done.load(Ordering::SeqCst) {
                    break;
                }
                if round % 3 == 0 {
                    session.reset().unwrap()
                } else {
                    session.interrupt(Duration::from_millis(50)).unwrap()
                }
                session.set_seed(round.into()).unwrap();
                std::thread::sleep(Duration::from_millis(3));
            }
        });
        let mut last: Option<u64> = None;
        while !done.load(Ordering::SeqCst) {
            session
                .pull_frames(8, |frame| {
                    assert!(
                        last.is_none_or(|last| frame.index == last + 1 || frame.index == 0),
                        "{last:?}, {}",
                        frame.index
                    );
                    assert!(frame.face.iter().all(|v| v.is_finite()));
                    last = Some(frame.index);
                })
                .unwrap();
        }
    });
}
