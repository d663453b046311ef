//! Gestures on command: streamed and offline frames are the same, and the effects of a host's calls.

use super::*;
use umo_core::{Gesture, GestureOptions, GestureParts, JOINTS, LayerGains, MAX_PENDING_GESTURES, Side};

/// Gestures that these tests play, with their times in no order.
fn asked() -> Vec<(&'static str, GestureOptions)> {
    let at = |seconds: f64| GestureOptions::default().at(seconds);
    vec![
        ("wave", at(1.1).side(Side::Left)),
        ("nod", at(0.4)),
        ("point", at(2.4).target([1.0, 1.4, 2.0]).strength(0.8)),
        ("shrug", at(3.5).speed(1.3)),
        ("bow", GestureOptions::default()),
    ]
}

/// The frames of a recording with gestures, as `umo animate --gesture` makes them.
fn offline_with(
    model: &Model,
    config: &SessionConfig,
    samples: &[f32],
    asked: &[(&str, GestureOptions)],
) -> Vec<Vec<u32>> {
    let team = Team::new(1).unwrap();
    let mut animation = Animation::with_layers(model, &config.avatar, config.layers, config.gestures.clone()).unwrap();
    for (name, options) in asked {
        animation.play_gesture(name, options).unwrap();
    }
    animation.push_audio(samples).unwrap();
    animation.finish(samples.len() * model.config().frame_rate / model.config().audio.sample_rate);
    let mut frames = Vec::new();
    let cx = Compute { isa: model.isa(), team: &team };
    while animation.step(model, cx, &mut |frame| frames.push(bits(frame.pose, frame.face))).unwrap() {}
    frames
}

/// All frames of a session that gets the samples in pieces of `cut`.
fn streamed(engine: &Engine, session: &Session, samples: &[f32], cut: usize) -> Vec<FrameBits> {
    let mut frames = Vec::new();
    for piece in samples.chunks(cut) {
        session.push_audio(piece).unwrap();
        settle(engine);
        frames.extend(pull(session));
    }
    session.finish().unwrap();
    settle(engine);
    frames.extend(pull(session));
    frames
}

fn with_layers(mut config: SessionConfig, gains: LayerGains) -> SessionConfig {
    config.layers = gains;
    config
}

#[test]
fn a_stream_with_gestures_gives_the_frames_of_the_recording_with_them() {
    for gains in [LayerGains::ON, LayerGains::OFF] {
        for which in [1, 3] {
            let engine = hosted(which);
            let config = with_layers(config(engine.model(), 2, 3, 9), gains);
            let samples = audio(80_000, 1, 1);
            let wanted = offline_with(engine.model(), &config, &samples, &asked());
            let plain = offline_with(engine.model(), &config, &samples, &[]);
            assert!(wanted.iter().zip(&plain).filter(|(a, b)| a != b).count() > 60, "gestures are seen");
            let session = engine.session(&config).unwrap();
            for (name, options) in asked() {
                session.play_gesture(name, &options).unwrap();
            }
            let cut = if which == 1 { 1_700 } else { 9_000 };
            check(&streamed(&engine, &session, &samples, cut), &wanted, 16_000);
        }
    }
}

/// Words with times, in no order.
const SAID: [(&str, f64, f64); 6] = [
    ("Hello", 2.9, 3.3),
    ("maybe", 4.2, 4.6),
    ("no", 1.0, 1.3),
    ("not bad", 1.7, 2.1),
    ("table", 2.2, 2.5),
    ("stop", 0.2, 0.5),
];

/// Words in any pieces of audio move as those of a recording, and leave nothing behind; a host's gesture comes first.
#[test]
fn a_stream_with_words_gives_the_frames_of_the_recording_with_them() {
    let team = Team::new(1).unwrap();
    let engine = hosted(1);
    for gains in [LayerGains::ON, LayerGains::OFF] {
        let config = with_layers(config(engine.model(), 2, 3, 9), gains);
        let (model, samples) = (engine.model(), audio(96_000, 1, 1));
        let plain = offline_with(model, &config, &samples, &[]);
        let mut animation = Animation::with_layers(model, &config.avatar, gains, config.gestures.clone()).unwrap();
        for (text, start, end) in SAID {
            animation.hint_words(text, start, end).unwrap();
        }
        animation.push_audio(&samples).unwrap();
        animation.finish(plain.len());
        let (mut wanted, cx) = (Vec::new(), Compute { isa: model.isa(), team: &team });
        while animation.step(model, cx, &mut |frame| wanted.push(bits(frame.pose, frame.face))).unwrap() {}
        let moved = |from: usize, to: usize| (from..to).filter(|&i| wanted[i] != plain[i]).count();
        // Of "no" the head moves, of "stop", "hello" and "maybe" the arms; between them nothing.
        assert!(moved(25, 50) > 15 && moved(85, 130) > 30, "{} {}", moved(25, 50), moved(85, 130));
        for cut in [1_700, 9_000] {
            let session = engine.session(&config).unwrap();
            for (text, start, end) in SAID.iter().rev() {
                session.hint_words(text, *start, *end).unwrap();
            }
            check(&streamed(&engine, &session, &samples, cut), &wanted, 16_000);
        }
    }
}

/// Before a gesture begins and after it ends, the bits are those without it.
#[test]
fn a_gesture_leaves_nothing_behind() {
    let engine = hosted(3);
    let config = with_layers(config(engine.model(), 2, 3, 9), LayerGains::OFF);
    let samples = audio(80_000, 1, 1);
    let plain = offline_with(engine.model(), &config, &samples, &[]);
    let waved = offline_with(engine.model(), &config, &samples, &[("wave", GestureOptions::default().at(2.0))]);
    let differs: Vec<usize> = (0..plain.len()).filter(|&i| plain[i] != waved[i]).collect();
    let (first, last) = (differs[0], differs[differs.len() - 1]);
    assert!((35..60).contains(&first) && (100..140).contains(&last), "{first} to {last}");
    // The legs and the left arm are unaffected.
    let kept = (0..plain.len())
        .all(|i| [1, 4, 7, 16, 18, 20].iter().all(|j| plain[i][4 * j..4 * j + 4] == waved[i][4 * j..4 * j + 4]));
    assert!(kept);
}

#[test]
fn an_interrupt_takes_gestures_away_and_a_reset_forgets_them() {
    let engine = hosted(3);
    let config = with_layers(config(engine.model(), 2, 3, 9), LayerGains::OFF);
    let samples = audio(40_000, 1, 1);
    let session = engine.session(&config).unwrap();
    let run = |frames: usize| {
        session.push_audio(&samples).unwrap();
        settle(&engine);
        let mut seen = Vec::new();
        session.pull_frames(frames, |frame| seen.push(FrameBits::of(frame))).unwrap();
        seen
    };
    session.play_gesture("wave", &GestureOptions::default()).unwrap();
    session.play_gesture("wave", &GestureOptions::default()).unwrap();
    run(40);
    session.interrupt(Duration::from_millis(400)).unwrap();
    session.push_audio(&samples).unwrap();
    session.finish().unwrap();
    settle(&engine);
    let after = pull(&session);
    let alone = engine.session(&config).unwrap();
    alone.push_audio(&samples).unwrap();
    alone.finish().unwrap();
    settle(&engine);
    let alone = pull(&alone);
    // After the ease, the rotations equal a stream's without the gesture.
    let joints = JOINTS * 4;
    assert_eq!(after.len(), alone.len() + 12);
    assert!(after[24..].iter().zip(&alone[12..]).all(|(a, b)| a.bits[..joints] == b.bits[..joints]));
    // The ease lowers the hand in small steps.
    let step = |pair: &[FrameBits]| {
        let change = |i: usize| (f32::from_bits(pair[0].bits[i]) - f32::from_bits(pair[1].bits[i])).abs();
        (0..joints).map(change).fold(0.0, f32::max)
    };
    assert!(after[..12].windows(2).map(step).fold(0.0, f32::max) < 0.25);
    session.reset().unwrap();
    session.play_gesture("nod", &GestureOptions::default().at(0.5)).unwrap();
    session.reset().unwrap();
    session.push_audio(&samples).unwrap();
    session.finish().unwrap();
    settle(&engine);
    assert!(pull(&session) == alone, "a reset session has no gestures");
}

#[test]
fn requests_that_cannot_be_are_refused() {
    let engine = hosted(3);
    let session = engine.session(&config(engine.model(), 2, 3, 9)).unwrap();
    assert_eq!(session.play_gesture("fly", &GestureOptions::default()), Err(SessionError::UnknownGesture));
    assert!(session.gesture_names().any(|name| name == "thumbs_up"));
    for name in session.gesture_names() {
        assert!(session.play_gesture(name, &GestureOptions::default().speed(3.0)).is_err());
    }
    let late = GestureOptions::default().at(60.0);
    for _ in 0..MAX_PENDING_GESTURES {
        session.play_gesture("nod", &late).unwrap();
    }
    assert_eq!(session.play_gesture("nod", &late), Err(SessionError::GesturesFull));
    // An interrupt frees the places when the output sees it.
    session.interrupt(Duration::ZERO).unwrap();
    session.ready_frames().unwrap();
    session.play_gesture("nod", &late).unwrap();
}

/// Gestures play without any speech.
#[test]
fn a_gesture_needs_no_speech() {
    for gains in [LayerGains::ON, LayerGains::OFF] {
        let shoulders = |waves: bool| {
            let (engine, nanos) = timed(3);
            let session = engine.session(&with_layers(config(engine.model(), 2, 0, 4), gains)).unwrap();
            let mut shoulders = Vec::new();
            session.sample_pose(0.0, |_| ()).unwrap();
            if waves {
                session.play_gesture("wave", &GestureOptions::default()).unwrap();
            }
            for step in 0..150 {
                nanos.fetch_add(33_333_333, Ordering::Relaxed);
                let shoulder = |frame: Frame| shoulders.push(frame.pose.rotations[17]);
                session.sample_pose(f64::from(step) / 30.0, shoulder).unwrap();
            }
            shoulders
        };
        let (waving, still) = (shoulders(true), shoulders(false));
        let turned = |a: [f32; 4], b: [f32; 4]| 1.0 - a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>().abs();
        assert!(turned(waving[45], still[45]) > 0.02, "{gains:?}: the arm is up");
        assert!(turned(waving[149], still[149]) < 0.01, "{gains:?}: and down again");
        assert!(waving.windows(2).all(|pair| turned(pair[0], pair[1]) < 0.02), "{gains:?}: in small steps");
    }
}

/// A restored session continues its gesture; a session with other gestures refuses the state.
#[test]
fn a_restored_session_goes_on_with_its_gesture() {
    let engine = hosted(3);
    let config = config(engine.model(), 2, 3, 9);
    let samples = audio(60_000, 1, 1);
    let session = engine.session(&config).unwrap();
    session.play_gesture("point", &GestureOptions::default().at(1.0).target([-1.0, 1.0, 1.0])).unwrap();
    session.play_gesture("list", &GestureOptions::default().variant(3)).unwrap();
    session.push_audio(&samples).unwrap();
    session.finish().unwrap();
    settle(&engine);
    session.pull_frames(33, |_| ()).unwrap();
    session.play_gesture("bow", &GestureOptions::default()).unwrap();
    let mut state = vec![0; session.state_size()];
    let len = session.save(&mut state).unwrap();
    let other = engine.session(&config).unwrap();
    other.restore(&state[..len]).unwrap();
    assert!(pull(&other) == pull(&session));
    let mut config = config;
    let clip = Gesture::new("salute", 30.0, &[[[0.0, 0.0, 0.0, 1.0]; JOINTS]; 30], 0.5, GestureParts::ALL).unwrap();
    config.gestures.add(clip).unwrap();
    let other = engine.session(&config).unwrap();
    let error = other.restore(&state[..len]).unwrap_err().to_string();
    assert!(error.contains("gestures"), "{error}");
    other.play_gesture("salute", &GestureOptions::default()).unwrap();
}
