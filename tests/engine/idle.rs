//! While no audio comes, and when it comes again or has ended.

use super::*;

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
