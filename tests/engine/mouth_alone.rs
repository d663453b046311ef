//! The live mouth without a body: no chunk is computed, and no more of the model is needed.

use umo_core::{PacketConfig, Voice};

use super::live::{WITH_MOUTH, mouths};
use super::*;

fn alone(model: &Model) -> SessionConfig {
    let layers = LayerGains::OFF;
    SessionConfig { voice: Voice::Mouth, layers, ..SessionConfig::new(model.config()) }
}

fn file(which: usize) -> ModelFile {
    ModelFile::from_bytes(ModelBytes::open(NAMES[which]).bytes()).unwrap()
}

/// An engine of a whole model.
fn whole(which: usize) -> Engine {
    engine(&Arc::new(Model::load(&file(which), Precision::Stored, Isa::detect()).unwrap()), Threads::Host(0), 4)
}

/// An engine of the mouth alone.
fn small() -> Engine {
    let model = Model::load_mouth(&file(WITH_MOUTH), Isa::detect()).unwrap();
    Engine::new(Arc::new(model), &EngineConfig::default()).unwrap()
}

/// Pushes pieces and pulls; returns every frame.
fn speak(session: &Session, samples: &[f32], piece: usize) -> Vec<FrameBits> {
    let mut frames = Vec::new();
    for piece in samples.chunks(piece) {
        assert_eq!(session.push_audio(piece).unwrap().taken, piece.len());
        let ready = session.ready_frames().unwrap();
        assert_eq!(session.pull_frames(1000, |frame| frames.push(FrameBits::of(frame))).unwrap(), ready);
    }
    session.finish().unwrap();
    session.pull_frames(1000, |frame| frames.push(FrameBits::of(frame))).unwrap();
    assert!(session.is_done().unwrap());
    frames
}

#[test]
fn the_mouth_speaks_over_the_rest_pose_without_the_engine() {
    let (whole, small) = (whole(WITH_MOUTH), small());
    let (model, samples) = (whole.model(), audio(32_000, 1, 3));
    let (mouths, rest) = (mouths(model, &samples), model.rest().unwrap());
    let mouth = model.mouth().unwrap();
    let rest = FrameBits::of((&rest).into());
    let mut all = Vec::new();
    for (engine, piece) in [(&whole, 160), (&whole, 5_000), (&small, 333)] {
        let session = engine.session(&alone(engine.model())).unwrap();
        let latency = session.latency();
        assert_eq!(
            (latency.algorithmic_samples, latency.mouth_samples),
            (mouth.latency_samples(), mouth.latency_samples())
        );
        let wanted = alone(model).latency_samples(model.config()).unwrap();
        assert_eq!(latency.algorithmic_samples, wanted);
        let frames = speak(&session, &samples, piece);
        assert_eq!(frames.len(), samples.len() * 30 / 16_000);
        for (i, (frame, channels)) in frames.iter().zip(&mouths).enumerate() {
            assert_eq!((frame.index, frame.sample), (i as u64, (i * 16_000 / 30) as u64));
            // The body's rotations except the jaw's, and its place.
            let (jaw, bits, still) = (4 * 22..4 * 23, &frame.bits, &rest.bits);
            assert_eq!(
                (&bits[..jaw.start], &bits[jaw.end..4 * 55 + 3]),
                (&still[..jaw.start], &still[jaw.end..4 * 55 + 3])
            );
            for (channel, value) in mouth.channels().iter().zip(channels) {
                assert_eq!(f32::from_bits(bits[4 * 55 + 3 + channel]), *value, "frame {i}");
            }
        }
        let stats = session.stats();
        assert_eq!((stats.chunks, stats.frames, stats.late_frames), (0, frames.len() as u64, 0));
        assert!(session.latency().backlog_samples == 0);
        all.push(frames);
    }
    assert!(all.windows(2).all(|pair| pair[0] == pair[1]), "pushes, or what was loaded, change frames");
}

#[test]
fn a_stream_has_as_many_frames_at_any_rate_and_idles_after_it() {
    let engine = small();
    for (rate, seconds) in [(8_000_u32, 1.01), (44_100, 0.777), (48_000, 1.5), (22_050, 0.05)] {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "seconds of samples")]
        let samples = audio((seconds * f64::from(rate)) as usize, 1, 5);
        let rate = rate as usize;
        let session = engine.session(&SessionConfig { sample_rate: rate, ..alone(engine.model()) }).unwrap();
        assert_eq!(speak(&session, &samples, 441).len(), samples.len() * 30 / rate, "{rate} Hz");
        session.reset().unwrap();
        assert_eq!(speak(&session, &samples, 4_410).len(), samples.len() * 30 / rate, "{rate} Hz, again");
        // After an interrupt and its ease, a separate stream begins.
        session.interrupt(Duration::from_millis(100)).unwrap();
        assert!(speak(&session, &samples, 1_000).len() >= samples.len() * 30 / rate);
        assert!(session.sample_pose(1e6, |_| ()).unwrap().is_ahead);
    }
}

#[test]
fn a_state_continues_in_a_session_of_its_kind_alone() {
    let (whole, small) = (whole(WITH_MOUTH), small());
    let samples = audio(30_000, 1, 9);
    let config = alone(whole.model());
    let (one, other) = (whole.session(&config).unwrap(), small.session(&config).unwrap());
    one.push_audio(&samples[..9_000]).unwrap();
    one.pull_frames(5, |_| ()).unwrap();
    let mut state = vec![0; one.state_size()];
    let count = one.save(&mut state).unwrap();
    // In a process that loaded no more than the mouth.
    other.restore(&state[..count]).unwrap();
    let frames = speak(&one, &samples[9_000..], 700);
    assert_eq!(speak(&other, &samples[9_000..], 160), frames);
    let live = whole.session(&SessionConfig { voice: Voice::Live, ..config }).unwrap();
    assert!(live.restore(&state[..count]).is_err());
}

#[test]
fn what_has_no_mouth_or_needs_a_body_is_refused_with_what_to_do() {
    let small = small();
    for voice in [Voice::Delayed, Voice::Live] {
        let error = small.session(&SessionConfig { voice, ..alone(small.model()) }).unwrap_err().to_string();
        assert!(error.contains("mouth alone") && error.contains("load all"), "{error}");
    }
    let packets = Some(PacketConfig::new(1));
    let error = small.session(&SessionConfig { packets, ..alone(small.model()) }).unwrap_err().to_string();
    assert!(error.contains("no chunks"), "{error}");
    let model = Arc::new(Model::load_mouth(&file(WITH_MOUTH), Isa::detect()).unwrap());
    let error = Session::decoder(&model, &SessionConfig::new(model.config()));
    assert!(error.unwrap_err().to_string().contains("mouth alone"));
    let mute = whole(0);
    assert!(mute.model().mouth().is_none());
    let error = mute.session(&alone(mute.model())).unwrap_err().to_string();
    assert!(error.contains("no mouth network"), "{error}");
    assert!(alone(mute.model()).latency_samples(mute.model().config()).is_err());
    let error = Model::load_mouth(&file(0), Isa::detect());
    assert!(error.unwrap_err().to_string().contains("no live mouth"));
    // An engine whose host polls has nothing to do.
    assert_eq!(small.poll(Duration::ZERO), Ok(Poll::Idle));
}
