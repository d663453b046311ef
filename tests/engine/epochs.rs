//! Interrupts and resets: which frames are dropped, what follows, and that streams do not mix.

use super::*;

#[test]
fn a_reset_session_is_a_new_one() {
    let engine = hosted(3);
    let session = config(engine.model(), 2, 3, 9);
    let samples = audio(20_000, 1, 1);
    let wanted = offline(engine.model(), &session, &samples);
    let session = engine.session(&session).unwrap();
    for round in 0..4 {
        // Once in the middle of a chunk, once with frames left to pull, once after the end.
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

/// The last chunk of a stream has less audio than a full one; audio pushed while it waits
/// belongs to the next stream.
#[test]
fn a_chunk_takes_no_audio_of_the_next_stream() {
    let engine = hosted(3);
    let config = config(engine.model(), 2, 3, 9);
    let (short, next) = (audio(3_000, 1, 1), audio(20_000, 1, 2));
    let session = engine.session(&config).unwrap();
    for round in 0..2 {
        session.push_audio(&short).unwrap();
        session.finish().unwrap();
        // Puts the chunk into a batch, and does no more.
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
        // An interrupted avatar stays in place: the translation differs, the rotations do not.
        let joints = 55 * 4;
        assert!(frames.iter().zip(&wanted).all(|(frame, wanted)| frame.bits[..joints] == wanted[..joints]));
        session.reset().unwrap();
    }
}

#[test]
fn an_interrupt_eases_to_rest_and_starts_a_new_stream_in_place() {
    let engine = hosted(2);
    let config = without_layers(config(engine.model(), 2, 0, 4));
    let samples = audio(20_000, 1, 2);
    let session = engine.session(&config).unwrap();
    session.push_audio(&samples).unwrap();
    settle(&engine);
    let mut shown = Vec::new();
    session.pull_frames(10, |frame| shown.push(FrameBits::of(frame))).unwrap();
    let left = session.ready_frames().unwrap();
    assert!(left > 0);
    session.interrupt(Duration::from_millis(200)).unwrap();
    assert_eq!(session.ready_frames(), Ok(6), "200 ms at 30 frames per second");
    // Frames from here on are the new stream's, in any order of events.
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
    // The ease from rest to the new stream is as long as the ease to rest; the face takes a quarter of it.
    let joints = 55 * 4;
    for (i, (frame, wanted)) in eased[6..].iter().zip(&wanted).enumerate() {
        assert_eq!(frame.bits[..joints] == wanted[..joints], i >= 5, "the new stream's pose {i}");
        assert_eq!(frame.bits[joints + 3..] == wanted[joints + 3..], i >= 1, "the new stream's face {i}");
        assert_eq!(frame.sample, 20_000 + (i * 16_000 / 30) as u64);
    }
    // The ease from rest is as smooth as the ease to it: at most a third of the angle per frame.
    let turn = |a: &FrameBits, b: &FrameBits, joint: usize| {
        let q = |frame: &FrameBits| [0, 1, 2, 3].map(|i| f32::from_bits(frame.bits[joint * 4 + i]));
        let dot: f32 = q(a).iter().zip(q(b)).map(|(a, b)| a * b).sum();
        2.0 * dot.abs().min(1.0).acos()
    };
    for joint in 0..55 {
        let first: f32 = turn(&eased[5], &eased[6], joint);
        let all =
            turn(&eased[5], &eased[11], joint) + (6..11).map(|i| turn(&eased[i], &eased[i + 1], joint)).sum::<f32>();
        assert!(first <= all / 3.0 + 1e-3, "joint {joint}: {first} of {all}");
    }
    // The avatar stays in place.
    let place = |frame: &FrameBits| [0, 2].map(|axis| f32::from_bits(frame.bits[joints + axis]));
    for frame in &eased[..6] {
        assert_eq!(place(frame), place(&shown[9]));
    }
    // Every step of the ease is small, and the last frame is the rest pose.
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
