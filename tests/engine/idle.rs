//! Behaviour without audio: before it comes, when it returns, and after the end.

use super::*;

/// With layers an avatar is never still: before its first frame, while it is idle, and in
/// transitions. Motion stays continuous.
#[test]
fn layers_go_on_while_no_audio_comes() {
    for idle in [Idle::Hold, Idle::Rest] {
        let (engine, nanos) = timed(3);
        let session = engine.session(&SessionConfig { idle, ..config(engine.model(), 2, 0, 4) }).unwrap();
        let (mut poses, mut time) = (Vec::new(), 0.0);
        let mut sample = |poses: &mut Vec<Vec<u32>>, count: usize| {
            for _ in 0..count {
                nanos.fetch_add(16_666_667, Ordering::Relaxed);
                time += 1.0 / 60.0;
                let mut pose = Vec::new();
                session.sample_pose(time, |frame| pose = bits(frame.pose, frame.face)).unwrap();
                poses.push(pose);
            }
        };
        sample(&mut poses, 90);
        session.push_audio(&audio(12_800, 1, 2)).unwrap();
        settle(&engine);
        sample(&mut poses, 300);
        let value = |pose: &[u32], at: usize| f32::from_bits(pose[at]);
        let (still, speech) = ([&poses[..90], &poses[200..]].concat(), &poses[90..200]);
        let moves = still.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(moves > 350 - 90, "{moves} of {} poses move", still.len());
        let step = |pair: &[Vec<u32>]| {
            (0..4 * 55).map(|at| (value(&pair[0], at) - value(&pair[1], at)).abs()).fold(0.0, f32::max)
        };
        let largest = still[..90].windows(2).chain(still[91..].windows(2)).map(step).fold(0.0, f32::max);
        assert!(largest < 0.1, "{idle:?}: a jump of {largest}");
        assert!(speech.windows(2).any(|pair| pair[0] != pair[1]));
    }
}

/// Poses of a session on the host's time, which starts at `from` and advances by `step` seconds
/// per picture, with a pause of two seconds after the speech.
fn by_host_time(from: f64, step: f64, wait: impl Fn()) -> Vec<Vec<u32>> {
    let (engine, nanos) = timed(3);
    let session = engine.session(&SessionConfig { idle: Idle::Rest, ..config(engine.model(), 2, 0, 4) }).unwrap();
    let mut poses = Vec::new();
    for picture in 0..120 {
        // The engine's clock runs independently.
        nanos.fetch_add(picture * picture * 1_000_000, Ordering::Relaxed);
        wait();
        let time = f64::from(u32::try_from(picture).unwrap()) * step;
        session.set_clock(from + time).unwrap();
        if picture == 30 {
            session.push_audio(&audio(6_400, 1, 2)).unwrap();
            settle(&engine);
        }
        session.sample_pose(time, |frame| poses.push(bits(frame.pose, frame.face))).unwrap();
    }
    poses
}

#[test]
fn a_host_that_gives_its_time_gets_the_same_poses_however_long_its_pictures_take() {
    let poses = by_host_time(0.0, 1.0 / 30.0, || ());
    assert!(poses[90..].windows(2).filter(|pair| pair[0] != pair[1]).count() > 20, "it is alive");
    // From another start time, and with delays.
    assert!(by_host_time(4096.0, 1.0 / 30.0, || std::thread::sleep(Duration::from_micros(300))) == poses);
    assert!(by_host_time(0.0, 1.0 / 24.0, || ()) != poses);
}

#[test]
fn a_host_whose_time_stands_still_sees_an_avatar_that_stands_still() {
    let (engine, nanos) = timed(3);
    let session = engine.session(&config(engine.model(), 2, 0, 4)).unwrap();
    let show = || {
        nanos.fetch_add(16_666_667, Ordering::Relaxed);
        let mut pose = Vec::new();
        session.sample_pose(0.0, |frame| pose = bits(frame.pose, frame.face)).unwrap();
        pose
    };
    assert!((0..60).map(|_| show()).collect::<std::collections::HashSet<_>>().len() > 30, "by the clock");
    session.set_clock(12.0).unwrap();
    let still = show();
    assert!((0..30).all(|_| show() == still));
    // A time that goes back holds the pose.
    session.set_clock(3.0).unwrap();
    assert!(show() == still);
    session.set_clock(12.5).unwrap();
    assert!(show() != still);
    for wrong in [f64::NAN, f64::INFINITY, -1.0, 2e9] {
        assert!(matches!(session.set_clock(wrong), Err(SessionError::Range(_))));
    }
}

#[test]
fn idle_modes_during_silence() {
    for idle in [Idle::Hold, Idle::Rest, Idle::Live] {
        let (engine, nanos) = timed(3);
        let config = SessionConfig { idle, ..without_layers(config(engine.model(), 2, 0, 4)) };
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
            // The ease to rest follows the clock even if the host's time is that of a sound
            // that has stopped.
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
                // Filled-in silence has no sample index.
                let mut sample = 0;
                session.pull_frames(1, |frame| sample = frame.sample).unwrap();
                assert!(sample <= 12_800, "{sample}");
            }
        }
    }
}

/// After an idle time, speech continues from the last pose shown.
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

/// The model ran on silence beyond the end of the pushed audio, and holds back frames from before
/// that end.
#[test]
fn end_in_the_past_leaves_the_engine_idle() {
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
    // Half a chunk waits when the audio stops: silence completes it.
    nanos.fetch_add(5_000_000_000, Ordering::SeqCst);
    pull(&session);
    settle(&engine);
    assert_eq!(session.stats().chunks, 2);
    // Half a chunk again, and the end much later.
    session.push_audio(&audio(chunk / 2, 1, 5)).unwrap();
    nanos.fetch_add(5_000_000_000, Ordering::SeqCst);
    session.finish().unwrap();
    settle(&engine);
    assert_eq!((session.stats().chunks, session.stats().late_frames), (3, 0));
    assert_eq!(session.latency().compute_max, Duration::ZERO);
}
