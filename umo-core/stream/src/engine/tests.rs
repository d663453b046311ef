//! Panics, and distribution of many sessions over the workers. The tests run the workers' turns in
//! a chosen order.

mod failures;

use umo_core_base::defect::keep_quiet;

use super::*;
use crate::session::SessionError;

fn model(name: &str) -> Arc<Model> {
    let path = format!("{}/../../{name}/model.safetensors", env!("CARGO_MANIFEST_DIR"));
    let file = umo_core_model::weights::ModelFile::open(path.as_ref()).unwrap();
    Arc::new(Model::load(&file, umo_core_model::linear::Precision::Stored, umo_kernels::Isa::detect()).unwrap())
}

fn polled() -> Engine {
    let config = EngineConfig { threads: Threads::Host(0), ..EngineConfig::default() };
    Engine::new(model("models/umo-people"), &config).unwrap()
}

/// Name and nice value of the thread with this folder in `/proc`, if it is alive.
#[cfg(target_os = "linux")]
fn thread(folder: &std::path::Path) -> Option<(String, i32)> {
    let stat = std::fs::read_to_string(folder.join("stat")).ok()?;
    let (name, fields) = stat.rsplit_once(") ").unwrap();
    let nice = fields.split(' ').nth(16).unwrap().parse().unwrap();
    Some((name.split_once('(').unwrap().1.to_owned(), nice))
}

/// Names and nice values of this process's threads.
#[cfg(target_os = "linux")]
fn threads() -> Vec<(String, i32)> {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap();
    tasks.filter_map(|task| thread(&task.unwrap().path())).collect()
}

#[cfg(target_os = "linux")]
#[test]
fn an_engines_own_threads_have_its_priority() {
    let config = EngineConfig { threads: Threads::Own(2), priority: Priority::Low, ..EngineConfig::default() };
    let engine = Engine::new(model("tests/golden/mel_k2_arkit"), &config).unwrap();
    assert_eq!(engine.priority(), Priority::Low);
    let own = || thread("/proc/thread-self".as_ref()).unwrap().1;
    let normal = own();
    let has_low = |name: &str| threads().contains(&(name.to_owned(), (normal + 10).min(19)));
    for name in ["umo-0", "umo-1", "umo-batch-1"] {
        assert!(has_low(name), "{name}: {:?}", threads());
    }
    drop(engine);
    // The host's thread polls.
    let config = EngineConfig { threads: Threads::Host(1), ..config };
    let engine = Engine::new(model("tests/golden/mel_k2_arkit"), &config).unwrap();
    assert!(has_low("umo-1"), "{:?}", threads());
    assert_eq!(own(), normal);
    drop(engine);
}

/// Fast and slow processors, by their capacities.
pub(super) fn two_kinds(fast: &[usize], slow: &[usize]) -> umo_core_base::team::Cores {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let root = std::env::temp_dir().join(format!("umo-two-kinds-{}-{number}", std::process::id()));
    for (cores, capacity) in [(fast, "1024"), (slow, "512")] {
        for core in cores {
            let folder = root.join(format!("devices/system/cpu/cpu{core}"));
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("cpu_capacity"), capacity).unwrap();
        }
    }
    let cores = umo_core_base::team::Cores::read(&root, &[fast, slow].concat());
    std::fs::remove_dir_all(root).unwrap();
    cores
}

/// Processors that the thread of this name may use, as the system lists them.
#[cfg(target_os = "linux")]
fn processors_of(name: &str) -> Option<String> {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap();
    let of = |task: std::path::PathBuf| {
        let status = std::fs::read_to_string(task.join("status")).ok()?;
        let value =
            |key: &str| status.lines().find_map(|line| line.strip_prefix(key)).map(|text| text.trim().to_owned());
        (value("Name:")? == name).then(|| value("Cpus_allowed_list:")).flatten()
    };
    tasks.filter_map(|task| of(task.unwrap().path())).next()
}

/// One avatar ends up on the slow core, two at once do not, and frames keep their bits.
#[cfg(target_os = "linux")]
#[test]
fn a_lone_avatar_is_computed_on_a_slow_core() {
    if thread::available() < 2 {
        return;
    }
    let model = model("tests/golden/mel_k2_arkit");
    let frames = |machine: umo_core_base::team::Cores, sessions: usize| {
        let config = EngineConfig { threads: Threads::Own(2), machine: Some(machine), ..EngineConfig::default() };
        let engine = Engine::new(Arc::clone(&model), &config).unwrap();
        let sessions: Vec<_> =
            (0..sessions).map(|_| engine.session(&SessionConfig::new(model.config())).unwrap()).collect();
        let mut bits = Vec::new();
        for chunk in 1..=12 {
            let length = SessionConfig::new(model.config()).avatar.target * model.config().samples_per_keyframe();
            for session in &sessions {
                session.push_audio(&vec![0.01; length]).unwrap();
            }
            for session in &sessions {
                while session.stats().chunks < chunk {
                    std::thread::sleep(Duration::from_millis(1));
                }
                let count = session.pull_frames(usize::MAX, |frame| bits.push(frame.pose.translation[1].to_bits()));
                assert!(count.is_ok());
            }
        }
        let placed = (engine.threads(), processors_of("umo-0"), processors_of("umo-economy"));
        (bits, engine.slow_chunks(), placed)
    };
    let (bits, slow, placed) = frames(two_kinds(&[0], &[1]), 1);
    assert_eq!(placed, (1, Some("0".to_owned()), Some("1".to_owned())));
    assert!((1..12).contains(&slow), "{slow} of 12 chunks");
    let (same, none, (threads, _, economy)) = frames(umo_core_base::team::Cores::unknown(), 1);
    assert_eq!((none, threads, economy), (0, 2, None));
    assert_eq!(bits, same);
}

/// An engine with two workers, whose turns the test runs itself.
struct Turns {
    engine: Engine,
    workers: [Worker; 2],
}

impl Turns {
    fn new() -> Self {
        let config =
            EngineConfig { threads: Threads::Own(2), max_sessions: 16, max_batch: 4, ..EngineConfig::default() };
        let engine = Engine::bare(model("tests/golden/mel_k2_arkit"), &config).unwrap();
        assert_eq!(engine.inner.load.workers(), 2);
        let workers = [0, 1].map(|index| Worker::new(&engine.inner, &config, index).unwrap());
        Self { engine, workers }
    }

    fn turn(&mut self, worker: usize) -> bool {
        self.workers[worker].turn(&self.engine.inner)
    }

    /// Runs turns of one worker until it finds no work.
    fn finish(&mut self, worker: usize) {
        while self.turn(worker) {}
    }
}

/// Creates sessions with seeds from `first` on, and pushes two chunks of sound into each.
fn sessions(engine: &Engine, first: u64, count: u64) -> Vec<Session> {
    let session = |seed: u64| {
        let mut config = SessionConfig::new(engine.model().config());
        config.avatar.sampler.seed = seed;
        let session = engine.session(&config).unwrap();
        let chunk = config.avatar.target * engine.model().config().samples_per_keyframe();
        let sound: Vec<f32> = (0..2 * chunk).map(|at| (at as f32 * (0.02 + 0.003 * seed as f32)).sin() * 0.3).collect();
        assert_eq!(session.push_audio(&sound).unwrap().taken, sound.len());
        session
    };
    (first..first + count).map(session).collect()
}

fn chunks(sessions: &[Session]) -> Vec<u64> {
    sessions.iter().map(|session| session.stats().chunks).collect()
}

/// Bits of all ready frames.
fn frames(session: &Session) -> Vec<u32> {
    let mut bits = Vec::new();
    let keep = |frame: crate::session::Frame| {
        bits.extend(frame.pose.rotations.as_flattened().iter().chain(frame.face).map(|value| value.to_bits()));
    };
    session.pull_frames(usize::MAX, keep).unwrap();
    bits
}

#[test]
fn a_worker_that_is_put_aside_delays_its_own_batch_alone_and_frames_are_the_same() {
    let mut turns = Turns::new();
    let crowd = sessions(&turns.engine, 0, 8);
    // Each worker begins with half of the due sessions; then the lead is preempted.
    assert!(turns.turn(0) && turns.turn(1));
    turns.finish(1);
    let done = chunks(&crowd);
    assert_eq!(done.iter().filter(|&&chunks| chunks == 2).count(), 4, "{done:?}");
    assert_eq!(done.iter().filter(|&&chunks| chunks == 0).count(), 4, "{done:?}");
    // Sessions come and go in the meantime.
    let late = sessions(&turns.engine, 8, 1);
    turns.finish(1);
    assert_eq!(chunks(&late), [2]);
    let place = |chunks| done.iter().position(|&of| of == chunks).unwrap();
    let (in_work, idle) = (place(0), place(2));
    let mut crowd: Vec<_> = crowd.into_iter().map(Some).collect();
    drop((crowd[in_work].take(), crowd[idle].take()));
    turns.finish(0);
    let more = sessions(&turns.engine, 9, 7);
    turns.finish(0);

    let config = EngineConfig { threads: Threads::Host(0), max_sessions: 16, ..EngineConfig::default() };
    let other = Engine::new(model("tests/golden/mel_k2_arkit"), &config).unwrap();
    let wanted = sessions(&other, 0, 16);
    while other.poll(Duration::from_secs(1)) != Ok(Poll::Idle) {}
    let crowd = crowd.into_iter().chain(late.into_iter().chain(more).map(Some));
    for (seed, (got, wanted)) in crowd.zip(&wanted).enumerate() {
        let wanted = frames(wanted);
        assert!(!wanted.is_empty());
        assert!(got.is_none_or(|session| frames(&session) == wanted), "session {seed}");
    }
}

#[test]
fn few_sessions_are_left_to_the_lead_which_is_called() {
    let mut turns = Turns::new();
    let few = sessions(&turns.engine, 0, 3);
    let inner = Arc::clone(&turns.engine.inner);
    assert!(inner.signal().begin_turn(LEAD));
    assert!(!turns.turn(1));
    // This sleep would not return without a call.
    inner.signal().sleep(LEAD, None);
    turns.finish(0);
    assert_eq!(chunks(&few), [2; 3]);
}

#[test]
fn a_defect_of_one_worker_ends_the_sessions_of_all() {
    let mut turns = Turns::new();
    let crowd = sessions(&turns.engine, 0, 8);
    assert!(turns.turn(0) && turns.turn(1));
    let defect = umo_core_base::defect::contain(|| panic!("planned")).unwrap_err();
    let _ = turns.engine.inner.defect.set(defect);
    let Turns { engine, workers } = turns;
    for worker in workers {
        run(worker, &engine.inner);
    }
    for session in &crowd {
        assert_eq!(session.push_audio(&[0.0]), Err(SessionError::Panicked));
        assert_eq!(session.defect().unwrap().message(), "planned");
    }
}

#[test]
fn a_panic_of_a_step_ends_its_session_alone_and_is_kept_with_its_place() {
    keep_quiet(&[crate::SOURCES]);
    let engine = polled();
    let config = SessionConfig::new(engine.model().config());
    let (bad, good) = (engine.session(&config).unwrap(), engine.session(&config).unwrap());
    bad.slot().unwrap().with_member(|member, _| member.plant_defect()).unwrap();
    for session in [&bad, &good] {
        session.push_audio(&vec![0.0; 2 * config.sample_rate]).unwrap();
    }
    while engine.poll(Duration::from_secs(1)) != Ok(Poll::Idle) {}
    assert_eq!(bad.pull_frames(1, |_| ()), Err(SessionError::Panicked));
    let defect = bad.defect().unwrap();
    assert!(defect.place().contains("schedule.rs:"), "{defect}");
    assert!(defect.message().contains("divide by zero"), "{defect}");
    assert!(good.ready_frames().unwrap() > 0);
    assert_eq!(good.defect(), None);
}

#[test]
fn sessions_of_an_engine_whose_thread_has_ended_say_why() {
    let engine = polled();
    let config = SessionConfig::new(engine.model().config());
    let session = engine.session(&config).unwrap();
    let defect = umo_core_base::defect::contain(|| panic!("planned")).unwrap_err();
    let _ = engine.inner.defect.set(defect.clone());
    engine.inner.fail(&defect);
    assert_eq!(session.push_audio(&[0.0]), Err(SessionError::Panicked));
    assert_eq!(session.defect().unwrap().message(), "planned");
    assert!(matches!(engine.session(&config), Err(EngineError::Panicked(_))));
}
