//! The live mouth: each frame has the mouth of its own audio as soon as that is heard, over the
//! latest body frames of the engine.

use umo_core::{LayerGains, Voice};
use umo_core_model::mouth::MouthStream;

use super::*;

/// The golden model that has a mouth.
pub(super) const WITH_MOUTH: usize = 3;
const JAW: usize = 22;

/// Without layers, to compare only the mouth and the body.
fn live(model: &Model, target: usize, lookahead: usize) -> SessionConfig {
    let mut config = SessionConfig { voice: Voice::Live, ..config(model, target, lookahead, 5) };
    config.layers = LayerGains::OFF;
    config
}

/// The mouth of every frame of a recording.
pub(super) fn mouths(model: &Model, samples: &[f32]) -> Vec<Vec<f32>> {
    let mouth = model.mouth().unwrap();
    let (mut stream, mut mouths) = (MouthStream::new(mouth), Vec::new());
    stream.push(mouth, model.isa(), samples, |frame| mouths.push(frame.channels.to_vec())).unwrap();
    stream.finish(mouth, model.isa(), |frame| mouths.push(frame.channels.to_vec())).unwrap();
    mouths
}

/// Value of a face channel in a frame's bits, which have the pose first.
fn face_value(frame: &FrameBits, channel: usize) -> f32 {
    f32::from_bits(frame.bits[4 * 55 + 3 + channel])
}

/// Pushes pieces, lets the engine settle, pulls; returns every frame of the stream.
fn run(engine: &Engine, session: &Session, samples: &[f32], pieces: &[usize]) -> Vec<FrameBits> {
    let (mut frames, mut rest) = (Vec::new(), samples);
    for &piece in pieces.iter().cycle() {
        let (now, later) = rest.split_at(piece.min(rest.len()));
        assert_eq!(session.push_audio(now).unwrap().taken, now.len());
        rest = later;
        settle(engine);
        let ready = session.ready_frames().unwrap();
        let before = frames.len();
        session.pull_frames(1000, |frame| frames.push(FrameBits::of(frame))).unwrap();
        assert_eq!(frames.len() - before, ready);
        if rest.is_empty() {
            break;
        }
    }
    session.finish().unwrap();
    for _ in 0..200 {
        settle(engine);
        let ready = session.ready_frames().unwrap();
        let pulled = session.pull_frames(3, |frame| frames.push(FrameBits::of(frame))).unwrap();
        assert_eq!(pulled, ready.min(3));
    }
    assert!(session.is_done().unwrap());
    frames
}

#[test]
fn the_mouth_is_the_sounds_and_the_body_follows() {
    let engine = hosted(WITH_MOUTH);
    let model = engine.model();
    let config = live(model, 2, 3);
    let samples = audio(32_000, 1, 3);
    let body = offline(model, &config, &samples);
    let mouths = mouths(model, &samples);
    assert_eq!(body.len(), mouths.len());
    let mut all = Vec::new();
    for pieces in [&[160][..], &[500, 7, 1_900]] {
        let session = engine.session(&config).unwrap();
        let latency = session.latency();
        let delay = (latency.algorithmic_samples * 30).div_ceil(16_000) + 2;
        let frames = run(&engine, &session, &samples, pieces);
        assert_eq!(frames.len(), body.len() + delay);
        let mouth = model.mouth().unwrap();
        for (i, frame) in frames.iter().enumerate() {
            assert_eq!((frame.index, frame.sample), (i as u64, (i * 16_000 / 30) as u64));
            for (at, &channel) in mouth.channels().iter().enumerate() {
                if let Some(values) = mouths.get(i) {
                    assert_eq!(face_value(frame, channel).to_bits(), values[at].to_bits(), "mouth of frame {i}");
                }
            }
            // The body of `delay` frames before, except the channels that the mouth moves.
            if let Some(wanted) = i.checked_sub(delay).map(|i| &body[i]) {
                for (at, (got, wanted)) in frame.bits.iter().zip(wanted).enumerate() {
                    let is_jaw = at / 4 == JAW;
                    let is_mouth = at >= 223 && mouth.channels().contains(&(at - 223));
                    assert!(is_jaw || is_mouth || got == wanted, "value {at} of frame {i}");
                }
            }
        }
        all.push(frames);
    }
    assert!(all[0] == all[1], "cuts change nothing");
    assert!(mouths.iter().any(|values| values != &mouths[0]), "the mouth moves");
}

/// The delay from sound to mouth is at most the reported one.
#[test]
fn a_mouth_is_as_late_as_is_said() {
    let engine = hosted(WITH_MOUTH);
    for rate in [16_000, 48_000] {
        let config = SessionConfig { sample_rate: rate, ..live(engine.model(), 2, 0) };
        let session = engine.session(&config).unwrap();
        let said = session.latency().mouth_samples;
        assert!(said < session.latency().algorithmic_samples);
        let worst = worst_wait(&session, rate, 16, || settle(&engine));
        assert!(worst <= said + 16 && worst + rate / 30 > said, "{rate} Hz: {worst}, {said} was said");
    }
}

#[test]
fn an_interrupt_begins_a_new_mouth() {
    let engine = hosted(WITH_MOUTH);
    let config = live(engine.model(), 1, 0);
    let (first, second) = (audio(12_000, 1, 8), audio(16_000, 1, 9));
    let session = engine.session(&config).unwrap();
    session.push_audio(&first).unwrap();
    settle(&engine);
    session.pull_frames(9, |_| ()).unwrap();
    session.interrupt(Duration::from_millis(100)).unwrap();
    let frames = run(&engine, &session, &second, &[900]);
    // Nine frames were shown, and three ease.
    assert_eq!(frames[0].index, 9);
    let wanted = mouths(engine.model(), &second);
    let mouth = engine.model().mouth().unwrap();
    for (frame, values) in frames[3..].iter().zip(&wanted) {
        for (&channel, value) in mouth.channels().iter().zip(values) {
            assert_eq!(face_value(frame, channel).to_bits(), value.to_bits(), "frame {}", frame.index);
        }
    }
}

#[test]
fn a_model_without_a_mouth_has_no_live_voice() {
    let engine = hosted(0);
    let config = SessionConfig { voice: Voice::Live, ..config(engine.model(), 1, 0, 1) };
    let error = engine.session(&config).unwrap_err().to_string();
    assert!(error.contains("voice"), "{error}");
}
