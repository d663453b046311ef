//! A mouth network with a second head: frames of chunks have the mouth of their own sound (SPEC 2.10).

mod model_bytes;

use std::sync::Arc;
use std::time::Duration;

use model_bytes::{ModelBytes, Stored};
use serde_json::json;
use umo_core::{
    Animation, AvatarConfig, Compute, Engine, EngineConfig, LayerGains, Model, ModelFile, Poll, Precision,
    SessionConfig, Team, Threads,
};
use umo_core_model::mouth::MouthStream;
use umo_kernels::Isa;
use umo_tests::Noise;

const RATE: usize = 16_000;
const BEHIND: usize = 3;

/// The golden model with a mouth; with a second head whose channels are those of the first in another order.
fn model(has_second: bool) -> Arc<Model> {
    let mut bytes = ModelBytes::open("mel_k2_arkit");
    if has_second {
        bytes.config["mouth"]["behind"] = json!(BEHIND);
        for (kind, outputs) in [("weight", true), ("bias", false)] {
            let Stored { dtype, shape, bytes: head } = bytes.tensors[&format!("mouth.head.{kind}")].clone();
            let row = head.len() / shape[0];
            let (channels, voice) = head.split_at(head.len() - row);
            let turned = [&channels[row..], &channels[..row], voice].concat();
            assert_eq!(outputs, shape.len() > 1);
            bytes.tensors.insert(format!("mouth.later.{kind}"), Stored { dtype, shape, bytes: turned });
        }
    }
    let file = ModelFile::from_bytes(bytes.bytes()).unwrap();
    Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).unwrap())
}

fn sound(samples: usize) -> Vec<f32> {
    let mut noise = Noise::new(3);
    (0..samples)
        .map(|i| 0.3 * (i as f32 * 9.0 / RATE as f32).sin() * (i as f32 * 0.05).sin() + noise.float(0.02))
        .collect()
}

/// Faces of a recording.
fn faces(model: &Model, config: &AvatarConfig, samples: &[f32], of_codes: bool) -> Vec<Vec<f32>> {
    let team = Team::new(1).unwrap();
    let mut animation = Animation::new(model, config).unwrap();
    if of_codes {
        animation.keep_codes_mouth();
    }
    animation.push_audio(samples).unwrap();
    animation.finish(animation.frames_of_audio(model.config()));
    let mut faces = Vec::new();
    while animation
        .step(model, Compute { isa: model.isa(), team: &team }, &mut |frame| faces.push(frame.face.to_vec()))
        .unwrap()
    {}
    faces
}

#[test]
fn frames_have_the_mouth_of_their_own_sound() {
    let (model, samples) = (model(true), sound(40_000));
    let mouth = model.mouth().unwrap();
    let (mut stream, mut now, mut later) = (MouthStream::new(mouth), Vec::new(), Vec::new());
    let more = [&samples[..], &[0.0; RATE]].concat();
    stream
        .push(mouth, model.isa(), &more, |frame| {
            now.push(frame.channels.to_vec());
            later.extend((!frame.later.is_empty()).then(|| frame.later.to_vec()));
        })
        .unwrap();
    let config = AvatarConfig::new(model.config());
    let (heard, coded) = (faces(&model, &config, &samples, false), faces(&model, &config, &samples, true));
    assert_eq!(heard.len(), 75);
    let (mut ahead, mut moved) = (0, 0);
    for (i, (face, codes)) in heard.iter().zip(&coded).enumerate() {
        let mut is_later = true;
        for (channel, (value, coded)) in face.iter().zip(codes).enumerate() {
            let Some(at) = mouth.channels().iter().position(|&one| one == channel) else {
                assert_eq!(value.to_bits(), coded.to_bits(), "frame {i}, channel {channel}");
                continue;
            };
            let least = if model.config().face.names[channel].starts_with("mouthSmile") { *coded } else { 0.0 };
            // In the steps of packets.
            let said = |value: f32| ((255.0 * value).round().clamp(0.0, 255.0) / 255.0).max(least);
            let [low, high] = [f32::min, f32::max].map(|of| said(of(now[i][at], later[i][at])));
            assert!((low..=high).contains(value), "frame {i}, channel {channel}: {value}, {low} to {high}");
            is_later &= *value == said(later[i][at]);
            moved += usize::from(value != coded);
        }
        ahead += usize::from(is_later);
    }
    assert!(ahead >= 20, "{ahead} frames of the second head");
    assert!(moved > 200, "{moved} values that are not the codes'");
}

#[test]
fn the_codes_mouth_is_that_of_a_model_without_the_head() {
    let samples = sound(20_000);
    let [with, without] = [true, false].map(model);
    let config = AvatarConfig::new(with.config());
    assert_eq!(faces(&with, &config, &samples, true), faces(&without, &config, &samples, false));
}

fn settle(engine: &Engine) {
    while engine.poll(Duration::from_secs(1)).unwrap() == Poll::More {}
}

#[test]
fn sessions_have_the_same_mouth_and_keep_it_in_their_state() {
    let (model, samples) = (model(true), sound(48_000));
    let engine =
        Engine::new(Arc::clone(&model), &EngineConfig { threads: Threads::Host(0), ..EngineConfig::default() });
    let engine = engine.unwrap();
    let config = SessionConfig { layers: LayerGains::OFF, ..SessionConfig::new(model.config()) };
    let wanted = faces(&model, &config.avatar, &samples, false);
    let (first, second) = (engine.session(&config).unwrap(), engine.session(&config).unwrap());
    let mut found = Vec::new();
    let (begin, rest) = samples.split_at(25_000);
    first.push_audio(begin).unwrap();
    settle(&engine);
    while first.pull_frames(7, |frame| found.push(frame.face.to_vec())).unwrap() > 0 {}
    let mut state = vec![0; first.state_size()];
    let size = first.save(&mut state).unwrap();
    // Another stream came before.
    second.push_audio(rest).unwrap();
    settle(&engine);
    second.restore(&state[..size]).unwrap();
    second.push_audio(rest).unwrap();
    second.finish().unwrap();
    settle(&engine);
    while second.pull_frames(7, |frame| found.push(frame.face.to_vec())).unwrap() > 0 {}
    settle(&engine);
    while second.pull_frames(7, |frame| found.push(frame.face.to_vec())).unwrap() > 0 {}
    assert_eq!(found, wanted);
}
