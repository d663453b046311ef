//! Misuse, full queues and no free places, objects dropped in any order, settings changed at run time.

use super::*;

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
    assert!(pull(&session).is_empty(), "three samples are less than a frame");
    assert!(matches!(session.set_prompt(&[0; 129]), Err(SessionError::Range(_))));
    let mut sampling = session.sampling().unwrap();
    sampling.temperature = f32::NAN;
    assert!(matches!(session.set_sampling(sampling), Err(SessionError::Range(_))));
    // A nested call of the same kind is like a concurrent one.
    session.reset().unwrap();
    session.push_audio(&audio(16_000, 2, 1)).unwrap();
    session.finish().unwrap();
    settle(&engine);
    let inner = |_: Frame| assert!(matches!(session.pull_frames(1, |_| ()), Err(SessionError::Busy(_))));
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

/// Every chunk fails in its last step, the motion decoder.
#[test]
fn an_engine_whose_every_session_fails_idles_and_takes_new_ones() {
    let mut bytes = ModelBytes::open("mel_k2_arkit");
    let bias = bytes.tensors.get_mut("vq.face.decoder.main.8.bias").unwrap();
    // The largest bf16.
    bias.bytes[..8].copy_from_slice(&[0x7f; 8]);
    let file = ModelFile::from_bytes(bytes.bytes()).unwrap();
    let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).unwrap());
    for (threads, count) in [Threads::Host(0), Threads::Own(1), Threads::Own(2)]
        .into_iter()
        .flat_map(|threads| [1, 2, 8].map(|count| (threads, count)))
    {
        let engine = engine(&model, threads, 8);
        for _ in 0..2 {
            let sessions: Vec<_> =
                (0..count).map(|seed| engine.session(&config(&model, 1, 0, seed)).unwrap()).collect();
            for session in &sessions {
                assert_eq!(session.push_audio(&audio(8_000, 1, 1)).map(|pushed| pushed.taken), Ok(8_000));
            }
            let start = Instant::now();
            let failure = |session: &Session| matches!(session.push_audio(&[]), Err(SessionError::Failed(_)));
            while !sessions.iter().all(failure) {
                assert!(start.elapsed() < Duration::from_secs(60), "{threads:?}, {count} sessions: no failure");
                if matches!(threads, Threads::Host(_)) {
                    engine.poll(Duration::ZERO).unwrap();
                } else {
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
            let idles = |_| engine.poll(Duration::ZERO) != Ok(Poll::More);
            assert!((0..1_000).any(idles), "{count} sessions: the engine never idles");
        }
    }
}

/// A job system that runs jobs where they are submitted, or after the poll.
#[test]
fn a_job_that_the_polling_thread_runs_returns_at_once() {
    let lent = Arc::new((OnceLock::<Weak<Engine>>::new(), AtomicU64::new(0)));
    let jobs = {
        let lent = Arc::clone(&lent);
        SubmitJobs(Arc::new(move |count| {
            for _ in 0..count {
                lent.0.get().and_then(Weak::upgrade).unwrap().run_job();
                lent.1.fetch_add(1, Ordering::Relaxed);
            }
        }))
    };
    let config = EngineConfig { threads: Threads::Host(2), jobs: Some(jobs), ..EngineConfig::default() };
    let engine = Arc::new(Engine::new(Arc::clone(&MODELS[2]), &config).unwrap());
    lent.0.set(Arc::downgrade(&engine)).unwrap();
    let config = without_layers(self::config(engine.model(), 2, 0, 4));
    let (session, samples) = (engine.session(&config).unwrap(), audio(16_000, 1, 4));
    session.push_audio(&samples).unwrap();
    session.finish().unwrap();
    settle(&engine);
    engine.run_job();
    assert!(lent.1.load(Ordering::Relaxed) > 0);
    let frames: Vec<_> = pull(&session).into_iter().map(|frame| frame.bits).collect();
    assert!(frames == offline(engine.model(), &config, &samples));
}

#[test]
fn a_host_that_never_pulls_stops_the_computation_and_pulling_starts_it_again() {
    let engine = hosted(4);
    let config = SessionConfig { queue_frames: 60, ..config(engine.model(), 2, 0, 4) };
    let session = engine.session(&config).unwrap();
    // The ring holds ten seconds at least, and as much as the full frame queue keeps from being computed.
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
    // Nothing was lost: with enough room, the same frames come.
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
            // Dropped while its chunk is in work.
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
        // In the middle of a chunk, if the engine is polled.
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
    let with_seed = |seed| without_layers(config(engine.model(), 2, 0, seed));
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
