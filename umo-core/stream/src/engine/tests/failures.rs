//! A session fails in each kind of step: only that session ends, and its engine continues.

use std::sync::atomic::AtomicU64;

use umo_core_base::error::StepError;

use super::*;
use crate::engine::plant::{MOUTH, Plant, STEPS};
use crate::session::PacketConfig;

/// More turns than any run takes.
const MOST_TURNS: usize = 100_000;
/// Longer than any run takes.
const LONGEST: Duration = Duration::from_secs(60);

/// The threads that compute.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Driver {
    /// The host, in short steps.
    Polled,
    /// The test, in whole steps.
    Turned,
    /// Threads of the engine.
    Own,
}

struct Crowd {
    engine: Engine,
    worker: Option<Worker>,
    sessions: Vec<Session>,
}

impl Crowd {
    /// Creates `count` sessions; the one with the planted failure fails. In an engine that is
    /// `late`, mouth networks run.
    fn new(model: &Arc<Model>, driver: Driver, late: bool, count: usize, plant: Option<(usize, Plant)>) -> Self {
        let threads = match driver {
            Driver::Polled => Threads::Host(0),
            Driver::Turned => Threads::Own(1),
            Driver::Own => Threads::Own(2),
        };
        let clock = Clock::Manual(Arc::new(AtomicU64::new(0)));
        let config = EngineConfig { threads, max_sessions: 9, max_batch: 8, clock, ..EngineConfig::default() };
        let (engine, worker) = match driver {
            Driver::Turned => {
                let engine = Engine::bare(Arc::clone(model), &config).unwrap();
                let worker = Worker::new(&engine.inner, &config, LEAD).unwrap();
                (engine, Some(worker))
            }
            _ => (Engine::new(Arc::clone(model), &config).unwrap(), None),
        };
        if late {
            engine.set_late_limit(Some(Duration::ZERO));
        }
        let sessions = (0..count).map(|seed| session(&engine, seed as u64)).collect();
        let crowd = Self { engine, worker, sessions };
        if let Some((failing, plant)) = plant {
            let slot = crowd.sessions[failing].slot().unwrap();
            while slot.with_member(|member, _| member.schedule.plant = Some(plant)).is_none() {}
        }
        crowd
    }

    fn push(&self, chunks: usize) {
        for (seed, session) in self.sessions.iter().enumerate() {
            push(&self.engine, session, seed, chunks);
        }
    }

    /// Computes until `is_done` holds for all sessions and nothing is in work.
    fn settle(&mut self, is_done: impl Fn(&Session) -> bool) {
        match &mut self.worker {
            Some(worker) => {
                assert!((0..MOST_TURNS).any(|_| !worker.turn(&self.engine.inner)), "the engine never idles");
            }
            None if self.engine.worker.is_some() => {
                let idles = (0..MOST_TURNS).any(|_| self.engine.poll(Duration::ZERO) == Ok(Poll::Idle));
                assert!(idles, "the engine never idles");
            }
            None => {
                let start = std::time::Instant::now();
                while !self.sessions.iter().all(&is_done) || !self.is_idle() {
                    assert!(start.elapsed() < LONGEST, "the engine never idles");
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
        }
        assert!(self.sessions.iter().all(is_done));
    }

    /// Whether every session is in its slot, checked several times.
    fn is_idle(&self) -> bool {
        (0..5).all(|_| {
            std::thread::sleep(Duration::from_micros(200));
            // The slot of a dropped session that a worker looked at.
            self.engine.inner.slots.sweep();
            let mut there = 0;
            self.engine.inner.slots.for_each(|member| there += usize::from(member.is_some()));
            there == self.sessions.len()
        })
    }
}

fn session(engine: &Engine, seed: u64) -> Session {
    let mut config = SessionConfig::new(engine.model().config());
    config.avatar.sampler.seed = seed;
    config.packets = Some(PacketConfig::new(config.avatar.target));
    config.queue_frames = 1000;
    engine.session(&config).unwrap()
}

fn push(engine: &Engine, session: &Session, seed: usize, chunks: usize) {
    let config = engine.model().config();
    let count = chunks * config.target * config.samples_per_keyframe();
    let sound: Vec<f32> = (0..count).map(|at| (at as f32 * (0.02 + 0.003 * seed as f32)).sin() * 0.3).collect();
    assert_eq!(session.push_audio(&sound).unwrap().taken, count);
}

/// Bits of a session's frames, and its packets.
fn output(session: &Session) -> (Vec<u32>, Vec<u8>) {
    let (mut bytes, mut lengths) = (vec![0; 1 << 20], [0; 64]);
    let count = session.pull_packets(&mut bytes, &mut lengths).unwrap();
    bytes.truncate(lengths[..count].iter().sum());
    (frames(session), bytes)
}

/// Output of a session in a run without failures: chunk count, frames and packets.
type Outcome = (u64, (Vec<u32>, Vec<u8>));

/// Outcomes of eight sessions.
fn outcomes(model: &Arc<Model>, late: bool) -> Vec<Outcome> {
    let mut crowd = Crowd::new(model, Driver::Polled, late, 8, None);
    crowd.push(chunks_of(late));
    crowd.settle(|_| true);
    assert!(!late || crowd.sessions.iter().any(|session| session.stats().held_chunks > 0));
    crowd.sessions.iter().map(|session| (session.stats().chunks, output(session))).collect()
}

/// Number of chunks of sound: pushed at once, five make an engine late.
fn chunks_of(late: bool) -> usize {
    if late { 5 } else { 2 }
}

/// Runs with a planted failure in one session; checks that the others produce `wanted`.
fn fails_alone(model: &Arc<Model>, driver: Driver, wanted: &[Outcome], at: usize, plant: Plant) {
    let case = format!("{driver:?}, {} sessions, number {at}: {plant:?}", wanted.len());
    let (late, done) = (plant.step == MOUTH, wanted[0].0);
    let mut crowd = Crowd::new(model, driver, late, wanted.len(), Some((at, plant)));
    crowd.push(chunks_of(late));
    let failure = |session: &Session| session.push_audio(&[]).err();
    crowd.settle(|session| session.stats().chunks == done || failure(session).is_some());
    for (number, (session, (_, wanted))) in crowd.sessions.iter().zip(wanted).enumerate() {
        let planted = match plant.panics {
            true => SessionError::Panicked,
            false => SessionError::Failed(StepError::NotFinite("planted values")),
        };
        assert_eq!(failure(session), (number == at).then_some(planted), "{case}: session {number}");
        assert!(number == at || output(session) == *wanted, "{case}: session {number}: other frames or packets");
    }
    // The slot is free again, and the engine computes new sessions.
    crowd.sessions.clear();
    crowd.sessions.extend((0..9).map(|_| session(&crowd.engine, 0)));
    crowd.sessions.truncate(1);
    crowd.push(chunks_of(late));
    crowd.settle(|session| session.stats().chunks == done);
}

#[test]
fn a_failing_session_ends_alone_in_every_kind_of_step() {
    for name in ["tests/golden/mel_k2_arkit", "tests/golden/frames_four"] {
        let model = model(name);
        let in_time = outcomes(&model, false);
        let late = model.mouth().is_some().then(|| outcomes(&model, true));
        let drivers = [Driver::Polled, Driver::Turned, Driver::Own].into_iter();
        for ((driver, count), step) in drivers
            .flat_map(|driver| [1, 2, 8].map(|count| (driver, count)))
            .flat_map(|case| STEPS.map(|step| (case, step)))
        {
            let wanted = match step {
                // With the engine's own threads, lateness depends on timing.
                MOUTH if driver == Driver::Own => continue,
                MOUTH => late.as_ref(),
                _ => Some(&in_time),
            };
            let Some(wanted) = wanted else { continue };
            // A panic on a thread other than the test's would be printed.
            for (at, after, panics) in [(0, 0, false), (count - 1, 1, driver != Driver::Own)] {
                fails_alone(&model, driver, &wanted[..count], at, Plant { step, after, panics });
            }
        }
    }
}
