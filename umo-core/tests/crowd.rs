//! More avatars than the processor can compute, with a late limit: bodies are held in turn, mouths keep moving,
//! backlogs stay bounded, and all recovers when the load ends. The clock is simulated: a chunk costs a fixed time,
//! in full or held.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use umo_core::{
    Clock, Engine, EngineConfig, Idle, LayerGains, Model, ModelFile, Poll, Precision, Session, SessionConfig, Threads,
};
use umo_kernels::Isa;

const MILLISECOND: u64 = 1_000_000;
/// Cost of a chunk.
const FULL: u64 = 50 * MILLISECOND;
const HELD: u64 = 12 * MILLISECOND;
/// Number of avatars whose every chunk, 0.4 s long, can be computed in full, and a number above it.
const FEW: usize = 6;
const MANY: usize = 13;

/// An engine, its clock, and its avatars.
struct Crowd {
    engine: Engine,
    nanos: Arc<AtomicU64>,
    avatars: Vec<Avatar>,
    /// Largest number of steps of one batch that run a mouth network.
    mouth_steps: usize,
}

struct Avatar {
    session: Session,
    /// Start time, nanoseconds, and samples pushed.
    start: u64,
    pushed: usize,
    /// The bits of each frame's face, then of its body's first joints.
    frames: Vec<(Vec<u32>, Vec<u32>)>,
}

impl Crowd {
    fn new(limit: Option<Duration>) -> Self {
        Self::in_batches(limit, 1)
    }

    fn in_batches(limit: Option<Duration>, max_batch: usize) -> Self {
        let golden = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mel_k2_arkit");
        let file = ModelFile::open(&golden.join("model.safetensors")).unwrap();
        let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).unwrap());
        let nanos = Arc::new(AtomicU64::new(0));
        let config = EngineConfig {
            threads: Threads::Host(0),
            clock: Clock::Manual(Arc::clone(&nanos)),
            max_sessions: MANY,
            max_batch,
            ..EngineConfig::default()
        };
        let engine = Engine::new(model, &config).unwrap();
        engine.set_late_limit(limit);
        let mut config = SessionConfig::new(engine.model().config());
        config.layers = LayerGains::OFF;
        let avatar = |number: usize| {
            let session = engine.session(&config).unwrap();
            Avatar { session, start: 400 * MILLISECOND * number as u64 / MANY as u64, pushed: 0, frames: Vec::new() }
        };
        let avatars = (0..MANY).map(avatar).collect();
        Self { engine, nanos, avatars, mouth_steps: 0 }
    }

    fn seconds(&self) -> f64 {
        self.nanos.load(Ordering::Relaxed) as f64 / 1e9
    }

    fn held(&self) -> Vec<u64> {
        self.avatars.iter().map(|avatar| avatar.session.stats().held_chunks).collect()
    }

    fn late(&self) -> u64 {
        self.avatars.iter().map(|avatar| avatar.session.stats().late_frames).sum()
    }

    /// Runs for this many seconds, with this many avatars speaking in real time.
    fn go_on(&mut self, seconds: f64, speakers: usize) {
        let until = self.seconds() + seconds;
        while self.seconds() < until {
            let now = self.nanos.load(Ordering::Relaxed);
            for (number, avatar) in self.avatars.iter_mut().enumerate() {
                let wanted = usize::try_from(now.saturating_sub(avatar.start) * 16 / MILLISECOND).unwrap();
                if number < speakers {
                    let sound = |at: usize| {
                        let t = at as f32 / 16_000.0;
                        (t * 900.0).sin() * 0.4 * (0.5 + 0.5 * (t * (17.0 + number as f32)).sin())
                    };
                    let samples: Vec<f32> = (avatar.pushed..wanted).map(sound).collect();
                    avatar.pushed += avatar.session.push_audio(&samples).unwrap().taken;
                } else {
                    // A silent avatar resumes later at the audio's current position.
                    avatar.start = now.saturating_sub(avatar.pushed as u64 * MILLISECOND / 16);
                }
                let frames = &mut avatar.frames;
                let keep = |frame: umo_core::Frame| {
                    let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
                    frames.push((bits(frame.face), bits(frame.pose.rotations[..22].as_flattened())));
                };
                avatar.session.pull_frames(usize::MAX, keep).unwrap();
            }
            let held: u64 = self.held().iter().sum();
            self.engine.poll(Duration::ZERO).unwrap();
            let cost = match self.engine.next_step() {
                Some("begin") => MILLISECOND,
                _ if self.held().iter().sum::<u64>() > held => HELD,
                _ => FULL,
            };
            self.nanos.fetch_add(cost, Ordering::Relaxed);
            let mut mouth_steps = 0;
            while self.engine.next_step() != Some("begin") {
                mouth_steps += usize::from(self.engine.next_step() == Some("mouth"));
                self.engine.poll(Duration::ZERO).unwrap();
            }
            self.mouth_steps = self.mouth_steps.max(mouth_steps);
        }
    }

    fn backlog(&self) -> f64 {
        let backlogs = self.avatars.iter().map(|avatar| avatar.session.latency().backlog_samples);
        backlogs.max().unwrap() as f64 / 16_000.0
    }
}

#[test]
fn while_the_engine_keeps_up_a_limit_changes_no_bit() {
    let (mut with, mut without) = (Crowd::new(Some(Duration::ZERO)), Crowd::new(None));
    with.go_on(6.0, FEW);
    without.go_on(6.0, FEW);
    assert_eq!((with.held(), with.late()), (vec![0; MANY], 0));
    for (got, want) in with.avatars.iter().zip(&without.avatars).take(FEW) {
        assert!(got.frames.len() > 100 && got.frames == want.frames);
    }
}

/// Hearing all of them in one step would exceed a poll's budget.
#[test]
fn each_member_of_a_batch_is_heard_in_a_step_of_its_own() {
    let mut crowd = Crowd::in_batches(Some(Duration::ZERO), 3);
    crowd.go_on(1.0, FEW);
    assert_eq!(crowd.mouth_steps, 0, "nothing is held, and nothing heard");
    // A batch of three costs as much as one chunk here: only late chunks exceed the capacity.
    crowd.nanos.fetch_add(3_000 * MILLISECOND, Ordering::Relaxed);
    crowd.go_on(4.0, MANY);
    assert!(crowd.held().iter().sum::<u64>() > 0);
    assert_eq!(crowd.mouth_steps, 3);
}

#[test]
fn over_capacity_bodies_are_held_evenly_mouths_go_on_and_it_ends_with_the_load() {
    let mut without = Crowd::new(None);
    without.go_on(20.0, MANY);
    assert!(without.backlog() > 5.0, "without a limit the engine falls behind: {} s", without.backlog());

    let mut crowd = Crowd::new(Some(Duration::from_millis(100)));
    crowd.go_on(10.0, MANY);
    let (late, held, seen) = (crowd.late(), crowd.held(), crowd.avatars[0].frames.len());
    let mut worst = 0.0_f64;
    for _ in 0..40 {
        crowd.go_on(0.5, MANY);
        worst = worst.max(crowd.backlog());
    }
    // A chunk, its deadline, and the limit: the delay is bounded.
    assert!(worst < 1.2, "{worst} s behind");
    let frames = ((crowd.avatars[0].frames.len() - seen) * MANY) as u64;
    let late = crowd.late() - late;
    println!("late {late} of {frames} frames, {worst} s behind, held {:?}", crowd.held());
    assert!(late * 10 < frames, "{late} of {frames} frames were late");
    // Avatars take turns: of 50 chunks, each has a similar number held.
    let held: Vec<u64> = crowd.held().iter().zip(held).map(|(now, before)| now - before).collect();
    let (least, most) = (held.iter().min().unwrap(), held.iter().max().unwrap());
    assert!(*least >= 15 && *most <= 40 && most - least <= 8, "{held:?}");
    for avatar in &crowd.avatars {
        let last = &avatar.frames[avatar.frames.len() - 300..];
        // The mouth moves in nearly every frame.
        let mouth = last.windows(2).filter(|pair| pair[0].0 != pair[1].0).count();
        assert!(mouth > 270, "{mouth} of 299 faces differ from the one before");
    }

    crowd.go_on(16.0, FEW);
    let (held, late) = (crowd.held(), crowd.late());
    crowd.go_on(4.0, FEW);
    assert_eq!((crowd.held(), crowd.late()), (held, late), "it ends with the load");
}

/// Of motion on silence, who listens and has hands at rest needs that of the layers alone.
#[test]
fn who_listens_costs_held_bodies() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models/umo-people/model.safetensors");
    let model = Model::load(&ModelFile::open(&path).unwrap(), Precision::Stored, Isa::detect()).unwrap();
    let nanos = Arc::new(AtomicU64::new(0));
    let config = EngineConfig {
        threads: Threads::Host(0),
        clock: Clock::Manual(Arc::clone(&nanos)),
        max_sessions: 3,
        ..EngineConfig::default()
    };
    let engine = Engine::new(Arc::new(model), &config).unwrap();
    let config = SessionConfig { idle: Idle::Live, ..SessionConfig::new(engine.model().config()) };
    let bare = SessionConfig { layers: LayerGains::OFF, ..config.clone() };
    let sessions = [&config, &config, &bare].map(|config| engine.session(config).unwrap());
    let (mut heads, mut picture) = (Vec::new(), 0);
    let mut show = |pictures: usize, speaks: bool| {
        for _ in 0..pictures {
            nanos.fetch_add(1_000 * MILLISECOND / 30, Ordering::Relaxed);
            picture += 1;
            // A person speaks to the first and to the one without layers.
            let level = if speaks && picture % 90 < 70 { 0.2 } else { 0.0 };
            let said: Vec<f32> = (0..16_000 / 30 + 1).map(|at| level * (at as f32 * 0.3).sin()).collect();
            [0, 2].into_iter().for_each(|which: usize| sessions[which].push_other_audio(&said).unwrap());
            while engine.poll(Duration::from_secs(1)).unwrap() != Poll::Idle {}
            for session in &sessions {
                let mut head = None;
                session.pull_frames(1, |frame| head = Some(frame.pose.rotations[15])).unwrap();
                heads.extend(head.filter(|_| std::ptr::eq(session, &raw const sessions[0])));
            }
        }
    };
    show(30, false);
    show(150, true);
    let [(chunks, held), (others, none)] =
        [0, 1].map(|which: usize| sessions[which].stats()).map(|stats| (stats.chunks, stats.held_chunks));
    assert!(held >= 8 && held < chunks && none == 0 && others >= 8, "{held} of {chunks}, {none} of {others}");
    assert_eq!(sessions[2].stats().held_chunks, 0, "without layers it would be a statue");
    // It is alive, and does not jump.
    let steps = heads.windows(2).map(|pair| {
        let dot: f32 = pair[0].iter().zip(pair[1]).map(|(a, b)| a * b).sum();
        2.0 * dot.abs().min(1.0).acos().to_degrees()
    });
    let (moved, most) = steps.fold((0.0, 0.0_f32), |(sum, most), step| (sum + step, most.max(step)));
    assert!(moved > 5.0 && most < 6.0, "{moved} degrees, {most} at once");
}
