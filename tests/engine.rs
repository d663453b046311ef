//! What must hold of an engine and its sessions: the frames of a stream are those of the recording, whoever computes them
//! and however the audio comes; and every wrong use has the answer that its documentation promises.

mod model_bytes;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use model_bytes::ModelBytes;
use proptest::prelude::*;
use umo_core::animation::Animation;
use umo_core::audio::resample;
use umo_core::avatar::AvatarConfig;
use umo_core::clock::Clock;
use umo_core::engine::{Engine, EngineConfig, EngineError, Poll, PollError, Threads};
use umo_core::model::Model;
use umo_core::motion::Pose;
use umo_core::session::{FrameView, Idle, Session, SessionConfig, SessionError};
use umo_core::{Compute, ModelFile, Precision, Team};
use umo_kernels::Isa;
use umo_tests::Noise;

const NAMES: [&str; 4] = ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit"];

/// The golden models, in f32 and in int8.
static MODELS: LazyLock<Vec<Arc<Model>>> = LazyLock::new(|| {
    let load = |name: &&str, precision| {
        let file = ModelFile::from_bytes(ModelBytes::open(name).bytes()).unwrap();
        Arc::new(Model::load(&file, precision, Isa::detect()).unwrap())
    };
    let floats = NAMES.iter().map(|name| load(name, Precision::F32));
    floats.chain(NAMES.iter().map(|name| load(name, Precision::Int8))).collect()
});

/// A frame as bits, with what it is stamped with.
#[derive(Clone, Debug, PartialEq)]
struct Frame {
    index: u64,
    sample: u64,
    bits: Vec<u32>,
}

impl Frame {
    fn of(frame: FrameView) -> Self {
        Self { index: frame.index, sample: frame.sample, bits: bits(frame.pose, frame.face) }
    }
}

fn bits(pose: &Pose, face: &[f32]) -> Vec<u32> {
    pose.rotations.as_flattened().iter().chain(&pose.translation).chain(face).map(|v| v.to_bits()).collect()
}

/// Interleaved noise over tones.
#[expect(clippy::cast_precision_loss, reason = "a few seconds have far fewer than 2^24 samples")]
fn audio(frames: usize, channels: usize, seed: u64) -> Vec<f32> {
    let mut noise = Noise::new(seed);
    (0..frames * channels).map(|i| 0.3 * (0.05 * i as f32).sin() + noise.float(0.1)).collect()
}

fn config(model: &Model, target: usize, lookahead: usize, seed: u64) -> SessionConfig {
    let mut session = SessionConfig::new(model.config());
    session.avatar.target = target.min(model.config().max_target);
    session.avatar.lookahead = lookahead;
    session.avatar.sampler.seed = seed;
    session
}

/// The frames of a recording, as `umo animate` makes them.
fn offline(model: &Model, session: &SessionConfig, samples: &[f32]) -> Vec<Vec<u32>> {
    let rate = model.config().audio.sample_rate;
    let count = samples.len() / session.channels;
    let mut mono = vec![0.0; count];
    resample::mix(samples, session.channels, &mut mono);
    let mono = resample::to_rate(&mono, session.sample_rate, rate).unwrap();
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let mut animation = Animation::new(model, &session.avatar).unwrap();
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

/// Lets the engine work: polls it, or gives its thread time.
fn work(engine: &Engine, threads: Threads) {
    match threads {
        Threads::Host(_) => {
            engine.poll(Duration::ZERO).unwrap();
        }
        Threads::Own(_) => std::thread::yield_now(),
    }
}

/// One stream on its way through a session.
struct Drive<'a> {
    session: Session,
    samples: &'a [f32],
    channels: usize,
    /// Frames per push, over and over.
    pushes: &'a [usize],
    turn: usize,
    frames: Vec<Frame>,
    wanted: usize,
}

impl Drive<'_> {
    fn is_done(&self) -> bool {
        self.frames.len() == self.wanted
    }

    /// Pushes the next piece, or ends the stream, and pulls what is there.
    fn go_on(&mut self) {
        let size = self.pushes[self.turn % self.pushes.len()] * self.channels;
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
        self.session.pull_frames(self.turn % 5, |frame| frames.push(Frame::of(frame))).unwrap();
    }
}

fn check(frames: &[Frame], wanted: &[Vec<u32>], rate: usize) {
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

    /// Any model, number of avatars, rate, channels, cut of the audio, who computes, how many together.
    #[test]
    fn a_stream_gives_the_frames_of_the_recording(
        which in 0..2 * NAMES.len(),
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
                let frames = offline(model, &config, samples);
                let session = engine.session(&config).unwrap();
                let drive = Drive { session, samples, channels: *channels, pushes, turn: 0, frames: Vec::new(), wanted: frames.len() };
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

/// Sample by sample, and beside fifteen others.
#[test]
fn single_samples_and_sixteen_avatars_change_nothing() {
    let model = &MODELS[5];
    let session = config(model, 2, 4, 77);
    let samples = audio(9_000, 1, 5);
    let wanted = offline(model, &session, &samples);
    for threads in [Threads::Host(0), Threads::Own(2)] {
        let engine = engine(model, threads, 16);
        let others: Vec<Session> = (0..15).map(|_| engine.session(&config(model, 2, 0, 3)).unwrap()).collect();
        let alone = engine.session(&session).unwrap();
        let mut drive = Drive {
            session: alone,
            samples: &samples,
            channels: 1,
            pushes: &[1],
            turn: 0,
            frames: Vec::new(),
            wanted: wanted.len(),
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

fn pull(session: &Session) -> Vec<Frame> {
    let mut frames = Vec::new();
    while session.pull_frames(7, |frame| frames.push(Frame::of(frame))).unwrap() > 0 {}
    frames
}

fn hosted(which: usize) -> Engine {
    engine(&MODELS[which], Threads::Host(0), 4)
}

/// A poll with no budget does one piece of work, and every piece is a small one.
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
    // Eight codes; the encoder, and its keys and values; HuBERT's layers; and what stands between.
    let layers =
        lm.num_layers + lm.num_decoder_layers * (8 + 1) + config.audio.hubert.as_ref().unwrap().num_hidden_layers;
    assert!(polls > layers, "{polls} polls for {layers} layers");
    assert_eq!(engine.poll(Duration::MAX), Ok(Poll::Idle));
}

#[test]
fn a_reset_session_is_a_new_one() {
    let engine = hosted(3);
    let session = config(engine.model(), 2, 3, 9);
    let samples = audio(20_000, 1, 1);
    let wanted = offline(engine.model(), &session, &samples);
    let session = engine.session(&session).unwrap();
    for round in 0..4 {
        // Once in the middle of a chunk, once with frames that nobody pulled, once after the end.
        assert_eq!(session.push_audio(&samples).unwrap().taken, samples.len());
        session.finish().unwrap();
        if round % 2 == 0 {
            engine.poll(Duration::ZERO).unwrap();
        } else {
            settle(&engine);
        }
        if round == 3 {
            check(&pull(&session), &wanted, 16_000);
        }
        session.reset().unwrap();
        assert_eq!(session.ready_frames(), Ok(0));
    }
    session.push_audio(&samples).unwrap();
    session.finish().unwrap();
    settle(&engine);
    check(&pull(&session), &wanted, 16_000);
    assert!(session.stats().dropped_frames > 0);
}

/// The last chunk of a stream has less audio than it takes; what is pushed while it waits for its turn is the next stream's.
#[test]
fn a_chunk_takes_no_audio_of_the_next_stream() {
    let engine = hosted(3);
    let config = config(engine.model(), 2, 3, 9);
    let (short, next) = (audio(3_000, 1, 1), audio(20_000, 1, 2));
    let session = engine.session(&config).unwrap();
    for round in 0..2 {
        session.push_audio(&short).unwrap();
        session.finish().unwrap();
        // Into a batch, and no further.
        assert_eq!(engine.poll(Duration::ZERO), Ok(Poll::More));
        if round == 0 {
            session.reset().unwrap()
        } else {
            session.interrupt(Duration::ZERO).unwrap()
        }
        session.push_audio(&next).unwrap();
        session.finish().unwrap();
        settle(&engine);
        let wanted = offline(engine.model(), &config, &next);
        let frames = pull(&session);
        assert_eq!(frames.len(), wanted.len());
        // An interrupted avatar stays where it stands: the place differs, the rotations do not.
        let joints = 55 * 4;
        assert!(frames.iter().zip(&wanted).all(|(frame, wanted)| frame.bits[..joints] == wanted[..joints]));
        session.reset().unwrap();
    }
}

#[test]
fn an_interrupt_eases_to_rest_and_starts_a_new_stream_in_place() {
    let engine = hosted(2);
    let config = config(engine.model(), 2, 0, 4);
    let samples = audio(20_000, 1, 2);
    let session = engine.session(&config).unwrap();
    session.push_audio(&samples).unwrap();
    settle(&engine);
    let mut shown = Vec::new();
    session.pull_frames(10, |frame| shown.push(Frame::of(frame))).unwrap();
    let left = session.ready_frames().unwrap();
    assert!(left > 0);
    session.interrupt(Duration::from_millis(200)).unwrap();
    assert_eq!(session.ready_frames(), Ok(6), "200 ms at 30 frames per second");
    // What comes now is the new stream's, whoever is faster.
    let fresh = &samples[..12_800];
    session.push_audio(fresh).unwrap();
    session.finish().unwrap();
    settle(&engine);
    let eased = pull(&session);
    assert_eq!(session.stats().dropped_frames, left as u64);
    let wanted = offline(engine.model(), &config, fresh);
    assert_eq!(eased.len(), 6 + wanted.len());
    for (i, frame) in eased.iter().enumerate() {
        assert_eq!(frame.index, 10 + i as u64, "the index goes on");
    }
    let joints = 55 * 4;
    for (i, (frame, wanted)) in eased[6..].iter().zip(&wanted).enumerate() {
        assert!(frame.bits[..joints] == wanted[..joints], "the new stream's pose {i}");
        assert!(frame.bits[joints + 3..] == wanted[joints + 3..], "the new stream's face {i}");
        assert_eq!(frame.sample, 20_000 + (i * 16_000 / 30) as u64);
    }
    // It stands where it stood.
    let place = |frame: &Frame| [0, 2].map(|axis| f32::from_bits(frame.bits[joints + axis]));
    for frame in &eased[..6] {
        assert_eq!(place(frame), place(&shown[9]));
    }
    // Every step of the ease is a small one, and the last is the pose of rest.
    let rest = {
        let other = engine.session(&config).unwrap();
        let mut rest = Vec::new();
        other.sample_pose(0.0, |frame| rest = bits(frame.pose, frame.face)).unwrap();
        rest
    };
    assert!(eased[5].bits[..joints] == rest[..joints]);
    assert!(eased[5].bits[joints + 3..] == rest[joints + 3..]);
}

#[test]
fn an_interrupt_before_anything_was_shown_has_nothing_to_ease_from() {
    let engine = hosted(2);
    let session = engine.session(&config(engine.model(), 2, 0, 4)).unwrap();
    session.interrupt(Duration::from_secs(1)).unwrap();
    assert_eq!(session.ready_frames(), Ok(0));
    assert!(matches!(session.interrupt(Duration::from_secs(11)), Err(SessionError::Range(_))));
}

#[test]
fn poses_between_frames_lie_between_them() {
    let engine = hosted(3);
    let config = config(engine.model(), 2, 0, 4);
    let samples = audio(24_000, 1, 2);
    let wanted = offline(engine.model(), &config, &samples);
    let session = engine.session(&config).unwrap();
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
    // Later than the newest: held; and a time that goes back is held too.
    let mut held = Vec::new();
    let sampled = session.sample_pose(1e6, |frame| held = bits(frame.pose, frame.face)).unwrap();
    assert!(sampled.is_ahead && held == wanted[last]);
    session.sample_pose(0.0, |frame| held = bits(frame.pose, frame.face)).unwrap();
    assert!(held == wanted[last]);
    assert!(matches!(session.sample_pose(f64::NAN, |_| ()), Err(SessionError::Range(_))));
}

/// A clock that the test turns.
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

#[test]
fn while_no_audio_comes_an_avatar_does_what_idle_says() {
    for idle in [Idle::Hold, Idle::Rest, Idle::Live] {
        let (engine, nanos) = timed(3);
        let config = SessionConfig { idle, ..config(engine.model(), 2, 0, 4) };
        let session = engine.session(&config).unwrap();
        session.push_audio(&audio(12_800, 1, 2)).unwrap();
        settle(&engine);
        let frames = session.ready_frames().unwrap();
        let mut before = Vec::new();
        let end = (frames - 1) as f64 / 30.0;
        session.sample_pose(end, |frame| before = bits(frame.pose, frame.face)).unwrap();
        nanos.store(400_000_000, Ordering::Relaxed);
        let (mut poses, mut ahead) = (vec![before.clone()], 0);
        for step in 1..=40 {
            let mut pose = Vec::new();
            // The ease to rest goes by the clock, also where the host's own time is that of a sound that stands still.
            nanos.fetch_add(33_333_333, Ordering::Relaxed);
            let time = if idle == Idle::Rest { 0.5 } else { f64::from(step) } / 30.0;
            let sampled = session.sample_pose(end + time, |frame| pose = bits(frame.pose, frame.face)).unwrap();
            ahead += usize::from(sampled.is_ahead);
            poses.push(pose);
            settle(&engine);
        }
        let joints = 55 * 4;
        let jump = poses
            .windows(2)
            .flat_map(|pair| (0..joints).map(|i| (f32::from_bits(pair[0][i]) - f32::from_bits(pair[1][i])).abs()));
        match idle {
            Idle::Hold => assert!(poses.iter().all(|pose| *pose == before) && ahead == 40),
            Idle::Rest => {
                let rest = engine.session(&config).unwrap();
                let mut at_rest = Vec::new();
                rest.sample_pose(0.0, |frame| at_rest = bits(frame.pose, frame.face)).unwrap();
                assert!(poses[40][..joints] == at_rest[..joints], "at rest");
                let whole = (0..joints)
                    .map(|i| (f32::from_bits(before[i]) - f32::from_bits(at_rest[i])).abs())
                    .fold(0.0, f32::max);
                assert!(jump.fold(0.0, f32::max) < 0.5 * whole, "in small steps");
            }
            Idle::Live => {
                assert!(ahead < 10, "the model goes on: {ahead}");
                assert!(session.stats().chunks > 2);
                // Silence is nobody's sample.
                let mut sample = 0;
                session.pull_frames(1, |frame| sample = frame.sample).unwrap();
                assert!(sample <= 12_800, "{sample}");
            }
        }
    }
}

/// After an idle time, speech goes on from what was shown.
#[test]
fn the_way_back_from_rest_is_smooth() {
    let (engine, nanos) = timed(2);
    let config = SessionConfig { idle: Idle::Rest, ..config(engine.model(), 2, 0, 4) };
    let session = engine.session(&config).unwrap();
    let mut last: Option<Vec<u32>> = None;
    let mut largest = 0.0_f32;
    let mut step = 0;
    for second in 0..4 {
        if second != 1 {
            session.push_audio(&audio(16_000, 1, 3)).unwrap();
            settle(&engine);
        }
        for _ in 0..60 {
            nanos.fetch_add(16_666_667, Ordering::Relaxed);
            let mut pose = Vec::new();
            session.sample_pose(f64::from(step) / 60.0, |frame| pose = bits(frame.pose, frame.face)).unwrap();
            step += 1;
            if let Some(last) = &last {
                for i in 0..4 * 55 {
                    largest = largest.max((f32::from_bits(pose[i]) - f32::from_bits(last[i])).abs());
                }
            }
            last = Some(pose);
        }
    }
    let whole = offline(engine.model(), &config, &audio(16_000, 1, 3));
    let own = whole
        .windows(2)
        .flat_map(|w| (0..4 * 55).map(|i| (f32::from_bits(w[0][i]) - f32::from_bits(w[1][i])).abs()))
        .fold(0.0, f32::max);
    assert!(largest <= 1.5 * own + 0.1, "a step of {largest}, where the motion's own are {own}");
}

#[test]
fn wrong_use_is_refused_and_changes_nothing() {
    let engine = hosted(1);
    let session = engine.session(&SessionConfig { channels: 2, ..config(engine.model(), 2, 0, 4) }).unwrap();
    assert_eq!(session.push_audio(&[0.0; 3]), Err(SessionError::Uneven { got: 3, channels: 2 }));
    assert_eq!(session.push_audio(&[]).map(|p| p.taken), Ok(0));
    let pushed = session.push_audio(&[f32::NAN, 1.0, f32::INFINITY, f32::NEG_INFINITY, 0.5, 0.5]).unwrap();
    assert_eq!((pushed.taken, pushed.silenced), (3, 3));
    assert_eq!(session.stats().silenced, 3);
    session.finish().unwrap();
    session.finish().unwrap();
    assert_eq!(session.push_audio(&[0.0; 2]), Err(SessionError::Finished));
    settle(&engine);
    assert!(pull(&session).is_empty(), "three samples are no frame");
    assert!(matches!(session.set_prompt(&[0; 129]), Err(SessionError::Range(_))));
    let mut sampling = session.sampling().unwrap();
    sampling.temperature = f32::NAN;
    assert!(matches!(session.set_sampling(sampling), Err(SessionError::Range(_))));
    // A call within a call of the same kind is what two threads at once would be.
    session.reset().unwrap();
    session.push_audio(&audio(16_000, 2, 1)).unwrap();
    session.finish().unwrap();
    settle(&engine);
    let inner = |_: FrameView| assert!(matches!(session.pull_frames(1, |_| ()), Err(SessionError::Busy(_))));
    assert_eq!(session.pull_frames(1, inner), Ok(1));

    let refused = |change: &dyn Fn(&mut SessionConfig)| {
        let mut config = SessionConfig::new(engine.model().config());
        change(&mut config);
        engine.session(&config).unwrap_err().to_string()
    };
    assert!(refused(&|c| c.sample_rate = 7_999).contains("8000"));
    assert!(refused(&|c| c.sample_rate = 192_001).contains("192000"));
    assert!(refused(&|c| c.channels = 0).contains("channels"));
    assert!(refused(&|c| c.queue_frames = 1).contains("queue_frames"));
    assert!(refused(&|c| c.avatar.target = 0).contains("target"));
    let bad = EngineConfig { threads: Threads::Own(0), ..EngineConfig::default() };
    assert!(matches!(Engine::new(Arc::clone(&MODELS[0]), &bad), Err(EngineError::Config(_))));
    let own = self::engine(&MODELS[0], Threads::Own(1), 1);
    assert_eq!(own.poll(Duration::ZERO), Err(PollError::OwnThreads));
}

#[test]
fn a_host_that_never_pulls_stops_the_computation_and_pulling_starts_it_again() {
    let engine = hosted(4);
    let config = SessionConfig { queue_frames: 60, ..config(engine.model(), 2, 0, 4) };
    let session = engine.session(&config).unwrap();
    // The ring takes ten seconds at least, and what the queue of frames keeps from being computed.
    let samples = audio(20 * 16_000, 1, 4);
    let mut taken = 0;
    for _ in 0..10 {
        taken += session.push_audio(&samples[taken..]).unwrap().taken;
        settle(&engine);
    }
    assert!((10 * 16_000..13 * 16_000).contains(&taken), "{taken}");
    let stats = session.stats();
    assert!(stats.frames <= 60 && stats.frames >= 40);
    assert!(stats.overruns > 0);
    let computed = stats.frames;
    assert_eq!(pull(&session).len() as u64, computed);
    settle(&engine);
    assert!(session.stats().frames > computed);
    // Nothing was lost: with room for everything, the same frames come.
    let mut frames = pull(&session).len() as u64 + computed;
    while taken < samples.len() {
        taken += session.push_audio(&samples[taken..]).unwrap().taken;
        settle(&engine);
        frames += pull(&session).len() as u64;
    }
    session.finish().unwrap();
    for _ in 0..20 {
        settle(&engine);
        frames += pull(&session).len() as u64;
    }
    assert_eq!(frames, 600);
}

#[test]
fn places_are_given_back() {
    let engine = engine(&MODELS[6], Threads::Own(1), 4);
    let config = config(engine.model(), 1, 0, 4);
    let samples = audio(6_400, 1, 4);
    for round in 0..10_000 {
        let session = engine.session(&config).unwrap();
        if round % 10 == 0 {
            // Dropped while it is computed.
            session.push_audio(&samples).unwrap();
        }
        if round % 100 == 0 {
            std::thread::sleep(Duration::from_micros(200));
        }
    }
    let all: Vec<_> = (0..100).map_while(|_| engine.session(&config).ok()).collect();
    // One may still be in a batch.
    assert!(all.len() >= 15, "{}", all.len());
    assert!(matches!(engine.session(&config), Err(EngineError::Full { sessions: 16 })));
}

#[test]
fn sessions_outlive_their_engine() {
    for threads in [Threads::Host(0), Threads::Own(2)] {
        let engine = engine(&MODELS[0], threads, 4);
        let session = engine.session(&config(engine.model(), 1, 0, 4)).unwrap();
        session.push_audio(&audio(16_000, 1, 4)).unwrap();
        while session.ready_frames().unwrap() == 0 {
            work(&engine, threads);
        }
        // In the middle of a chunk, where it is polled.
        drop(engine);
        let mut count = 0;
        while session.pull_frames(1, |_| count += 1) == Ok(1) {}
        assert!(count > 0);
        assert_eq!(session.pull_frames(1, |_| ()), Err(SessionError::Closed));
        assert_eq!(session.push_audio(&[0.0]), Err(SessionError::Closed));
        assert_eq!(session.finish(), Err(SessionError::Closed));
    }
}

#[test]
fn settings_count_from_the_next_chunk() {
    let engine = hosted(3);
    let with_seed = |seed| config(engine.model(), 2, 0, seed);
    let samples = audio(20_000, 1, 1);
    let wanted = offline(engine.model(), &with_seed(11), &samples);
    let other = offline(engine.model(), &with_seed(3), &samples);
    assert!(wanted != other);
    let session = engine.session(&with_seed(3)).unwrap();
    session.set_seed(11).unwrap();
    session.push_audio(&samples).unwrap();
    session.finish().unwrap();
    settle(&engine);
    check(&pull(&session), &wanted, 16_000);
}

#[test]
fn a_seed_that_is_set_leaves_the_prompt_alone() {
    let engine = hosted(3);
    let mut config = config(engine.model(), 2, 0, 4);
    config.avatar = AvatarConfig { template: "text_to_motion".to_owned(), text: vec![5, 6], ..config.avatar };
    let frames = |set: &dyn Fn(&Session)| {
        let session = engine.session(&config).unwrap();
        set(&session);
        settle(&engine);
        pull(&session)
    };
    let wanted = frames(&|_| ());
    assert!(frames(&|session| session.set_seed(4).unwrap()) == wanted);
    assert!(frames(&|session| session.set_prompt(&[]).unwrap()) != wanted, "the prompt counts");
}

/// The model ran on silence beyond the end of what was pushed, and holds frames back that came before it.
#[test]
fn an_end_that_lies_behind_lets_the_engine_rest() {
    let (engine, nanos) = timed(4);
    let mut config = config(engine.model(), 1, 10, 4);
    config.idle = Idle::Live;
    let session = engine.session(&config).unwrap();
    let chunk = engine.model().config().samples_per_keyframe();
    session.push_audio(&audio(3 * chunk - 1_000, 1, 4)).unwrap();
    settle(&engine);
    let mut frames = pull(&session).len();
    for _ in 0..3 {
        nanos.fetch_add(1_000_000_000, Ordering::SeqCst);
        frames += pull(&session).len();
        settle(&engine);
    }
    session.finish().unwrap();
    for _ in 0..100 {
        if engine.poll(Duration::ZERO) == Ok(Poll::Idle) {
            frames += pull(&session).len();
            assert_eq!(frames, (3 * chunk - 1_000) * 30 / 16_000);
            return;
        }
    }
    panic!("the engine never rests");
}

/// The most audio that any frame needed of its future, found by trial: a few samples at a time.
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
    let (engine, nanos) = timed(2);
    for (target, lookahead, rate) in [(1, 0, 48_000), (2, 3, 44_100), (3, 0, 8_000), (1, 2, 22_050)] {
        let config = SessionConfig { sample_rate: rate, ..config(engine.model(), target, lookahead, 1) };
        let session = engine.session(&config).unwrap();
        let said = session.latency().algorithmic_samples;
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
    // Late frames are those whose chunk was done after real time needed it.
    assert_eq!(session.stats().late_frames, 0);
    session.push_audio(&samples[..12_800]).unwrap();
    nanos.store(5_000_000_000, Ordering::Relaxed);
    settle(&engine);
    let stats = session.stats();
    assert!(stats.late_frames > 0 && stats.late_frames < stats.frames);
    assert!(session.latency().compute_max >= Duration::from_secs(4));
}

/// Audio, frames and cues from three threads at once; sanitizers and the eyes of the assertions watch.
#[test]
fn three_threads_at_once() {
    let engine = engine(&MODELS[4], Threads::Own(2), 4);
    let session = engine.session(&config(engine.model(), 1, 0, 4)).unwrap();
    let samples = audio(160_000, 1, 4);
    let done = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for piece in samples.chunks(480).cycle().take(1500) {
                match session.push_audio(piece) {
                    Ok(_) | Err(SessionError::Finished) => {}
                    Err(error) => panic!("{error}"),
                }
                if piece.len() % 7 == 0 {
                    session.finish().unwrap();
                }
            }
            done.store(true, Ordering::SeqCst);
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

#[test]
fn a_pause_counts_neither_as_delay_nor_as_late() {
    let (engine, nanos) = timed(4);
    let mut config = config(engine.model(), 1, 0, 4);
    config.idle = Idle::Live;
    let session = engine.session(&config).unwrap();
    let chunk = engine.model().config().samples_per_keyframe();
    session.push_audio(&audio(chunk + chunk / 2, 1, 4)).unwrap();
    settle(&engine);
    // Half a chunk is there when the speaker falls silent: silence completes it.
    nanos.fetch_add(5_000_000_000, Ordering::SeqCst);
    pull(&session);
    settle(&engine);
    assert_eq!(session.stats().chunks, 2);
    // Half a chunk again, and the end long after it.
    session.push_audio(&audio(chunk / 2, 1, 5)).unwrap();
    nanos.fetch_add(5_000_000_000, Ordering::SeqCst);
    session.finish().unwrap();
    settle(&engine);
    assert_eq!((session.stats().chunks, session.stats().late_frames), (3, 0));
    assert_eq!(session.latency().compute_max, Duration::ZERO);
}

#[test]
fn an_interrupt_straight_after_a_reset_changes_nothing() {
    let engine = hosted(4);
    let config = config(engine.model(), 1, 0, 4);
    let session = engine.session(&config).unwrap();
    let samples = audio(24_000, 1, 4);
    session.push_audio(&samples).unwrap();
    settle(&engine);
    assert!(!pull(&session).is_empty());
    session.reset().unwrap();
    session.interrupt(Duration::from_millis(200)).unwrap();
    assert_eq!(session.ready_frames().unwrap(), 0);
    session.push_audio(&samples).unwrap();
    session.finish().unwrap();
    settle(&engine);
    let frames = pull(&session);
    let want = offline(engine.model(), &config, &samples);
    assert!(frames.iter().map(|frame| &frame.bits).eq(&want));
    assert!(frames.iter().map(|frame| frame.index).eq(0..want.len() as u64));
}

#[test]
fn text_alone_moves_an_avatar_until_its_queue_is_full() {
    let engine = hosted(3);
    let mut config = config(engine.model(), 2, 0, 4);
    config.avatar = AvatarConfig { template: "text_to_motion".to_owned(), text: vec![5, 6], ..config.avatar };
    let session = engine.session(&config).unwrap();
    settle(&engine);
    let first = pull(&session).len();
    assert!(first >= config.queue_frames - 2 * config.avatar.target * 6, "{first}");
    settle(&engine);
    assert!(!pull(&session).is_empty());
    session.reset().unwrap();
    settle(&engine);
    assert_eq!(pull(&session).len(), first);
}
