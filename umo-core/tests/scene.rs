//! Sessions in a scene: what the scene changes, and what it never does.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use umo_core::{
    Allowed, Engine, EngineConfig, Frame, Model, ModelFile, PacketConfig, Place, Poll, Precision, Role, Scene,
    SceneError, Session, SessionConfig, SessionError, Target, Threads,
};
use umo_kernels::Isa;

const RATE: usize = 16_000;
const FRAME: usize = RATE / 30;

fn model() -> Arc<Model> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mel_k2_arkit");
    let file = ModelFile::open(&folder.join("model.safetensors")).expect("a golden model");
    Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).expect("a golden model"))
}

fn engine(model: &Arc<Model>, threads: Threads) -> Engine {
    let config = EngineConfig { threads, max_sessions: 8, ..EngineConfig::default() };
    Engine::new(Arc::clone(model), &config).expect("threads")
}

/// Speech with syllables from second `from` to `to` of 4 s.
fn speech(from: f32, to: f32) -> Vec<f32> {
    let sample = |i: usize| {
        let t = i as f32 / RATE as f32;
        let loud = if (from..to).contains(&t) { 0.6 + 0.4 * (8.0 * t).sin() } else { 0.0 };
        0.3 * loud * (880.0 * t + 3.0 * (25.0 * t).sin()).sin()
    };
    (0..4 * RATE).map(sample).collect()
}

/// Bits of a frame.
fn bits(frame: &Frame) -> Vec<u32> {
    let values = frame.pose.rotations.as_flattened().iter().chain(&frame.pose.translation).chain(frame.face);
    values.map(|value| value.to_bits()).collect()
}

/// Three sessions in a half circle, of whom the first two speak in turn.
struct Trio {
    engine: Engine,
    sessions: Vec<Arc<Session>>,
    scene: Scene<Arc<Session>>,
    ids: Vec<u32>,
}

impl Trio {
    fn new(model: &Arc<Model>, threads: Threads) -> Self {
        let engine = engine(model, threads);
        let session = |seed: u64| {
            let mut config = SessionConfig::new(model.config());
            config.avatar.sampler.seed = seed;
            Arc::new(engine.session(&config).expect("a place"))
        };
        let sessions: Vec<_> = (0..3).map(session).collect();
        let scene = Scene::new(11).expect("memory");
        let place = |i: usize| Place {
            position: [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.5]][i],
            facing: [-0.6, 0.6, std::f32::consts::PI][i],
            ..Place::default()
        };
        let ids = sessions.iter().enumerate().map(|(i, session)| scene.add(Some(Arc::clone(session)), place(i)));
        let ids = ids.collect::<Result<_, _>>().expect("places");
        Self { sessions, ids, scene, engine }
    }

    /// Pushes 4 s of the conversation in pieces.
    fn talk(&self, piece: usize) {
        for (session, (from, to)) in self.sessions.iter().zip([(0.0, 1.8), (2.0, 3.6), (5.0, 5.0)]) {
            for piece in speech(from, to).chunks(piece) {
                session.push_audio(piece).expect("it runs");
            }
            session.finish().expect("it runs");
        }
    }

    /// Shows frames, one of each session after each update.
    fn show(&self, count: usize) -> Vec<Vec<u32>> {
        let mut shown = Vec::new();
        for _ in 0..count {
            self.scene.update(1.0 / 30.0).expect("nobody else calls");
            for session in &self.sessions {
                while session.ready_frames().expect("nobody else pulls") == 0 {
                    match self.engine.poll(Duration::from_secs(1)) {
                        Ok(Poll::More | Poll::Idle) => {}
                        Err(_) => std::thread::sleep(Duration::from_millis(1)),
                    }
                }
                session.pull_frames(1, |frame| shown.push(bits(&frame))).expect("nobody else pulls");
            }
        }
        shown
    }
}

#[test]
fn neither_threads_nor_cuts_change_a_bit_and_a_restored_scene_goes_on_the_same() {
    let model = model();
    let one = Trio::new(&model, Threads::Host(0));
    one.talk(RATE);
    let first = one.show(50);
    let mut state = vec![0; one.scene.state_size().expect("nobody else calls")];
    let length = one.scene.save(&mut state).expect("nothing is in work");
    let wanted = one.show(69);
    let turn = one.scene.member(one.ids[1]).expect("it is there");
    assert_eq!((one.scene.floor(), turn.role), (Ok(Some(one.ids[1])), Role::Speaking));

    let other = Trio::new(&model, Threads::Own(2));
    other.talk(FRAME - 7);
    assert!(other.show(50) == first, "threads or cuts");
    assert!(other.show(69) == wanted, "threads or cuts");

    let third = Trio::new(&model, Threads::Host(0));
    third.scene.restore(&state[..length]).expect("a state of such a scene");
    assert!(third.show(69) == wanted, "restored");
    one.scene.restore(&state[..length]).expect("its own state");
    assert!(one.show(69) == wanted, "rolled back");

    // As a whole, or not at all: one session is busy.
    one.scene.restore(&state[..length]).expect("its own state");
    let before = one.show(1);
    one.scene.restore(&state[..length]).expect("its own state");
    let last = &one.sessions[2];
    last.pull_frames(1, |_| {
        let busy = Err(SceneError::Session(SessionError::Busy("pull_frames, sample_pose, set_clock, save or restore")));
        assert_eq!(one.scene.restore(&state[..length]), busy);
        assert_eq!(one.scene.save(&mut state.clone()).map(drop), busy);
    })
    .expect("nobody else pulls");
    one.scene.restore(&state[..length]).expect("its own state");
    assert!(one.show(1) == before);
    // A scene's state is not a session's, nor the other way round.
    assert!(one.sessions[0].restore(&state[..length]).is_err());
    let saved = one.sessions[0].save(&mut state).expect("nothing is in work");
    assert!(one.scene.restore(&state[..saved]).is_err());
}

#[test]
fn a_scene_of_one_leaves_every_bit_and_one_of_two_does_not() {
    let model = model();
    let run = |others: Option<usize>| {
        let engine = engine(&model, Threads::Host(0));
        let session = Arc::new(engine.session(&SessionConfig::new(model.config())).expect("a place"));
        let scene = Scene::new(3).expect("memory");
        if let Some(others) = others {
            scene.add(Some(Arc::clone(&session)), Place::default()).expect("a place");
            for i in 0..others {
                scene.add(None, Place { position: [1.0 + i as f32, 0.0, 1.0], ..Place::default() }).expect("a place");
            }
        }
        session.push_audio(&speech(0.2, 1.4)[..2 * RATE]).expect("it runs");
        session.finish().expect("it runs");
        while engine.poll(Duration::from_secs(1)) == Ok(Poll::More) {}
        let mut shown = Vec::new();
        for _ in 0..59 {
            scene.update(1.0 / 30.0).expect("nobody else calls");
            session.pull_frames(1, |frame| shown.push(bits(&frame))).expect("nobody else pulls");
        }
        shown
    };
    let alone = run(None);
    assert_eq!(alone.len(), 59);
    assert!(alone == run(Some(0)));
    assert!(alone != run(Some(1)));
}

#[test]
fn members_come_and_go_while_it_runs() {
    let model = model();
    let trio = Trio::new(&model, Threads::Host(0));
    trio.talk(RATE);
    trio.show(20);
    // A receiver of packets joins, and listens.
    let mut config = SessionConfig::new(model.config());
    config.packets = Some(PacketConfig::new(config.avatar.target));
    let sender = trio.engine.session(&config).expect("a place");
    config.packets = None;
    let decoder = Arc::new(Session::decoder(&model, &config).expect("a decoder"));
    let id = trio.scene.add(Some(Arc::clone(&decoder)), Place::default()).expect("a place");
    sender.push_audio(&speech(0.0, 2.0)).expect("it runs");
    while trio.engine.poll(Duration::from_secs(1)) == Ok(Poll::More) {}
    let (mut bytes, mut lengths) = (vec![0; 64 * sender.packet_size()], [0; 64]);
    let count = sender.pull_packets(&mut bytes, &mut lengths).expect("packets");
    let mut at = 0;
    for length in &lengths[..count] {
        decoder.push_packet(&bytes[at..at + length]).expect("a packet");
        at += length;
    }
    assert!(count > 0);
    for _ in 0..20 {
        trio.show(1);
        assert_eq!(decoder.pull_frames(1, |_| {}), Ok(1));
    }
    let heard = trio.scene.member(id).expect("it is there");
    assert!(heard.level > 0.0, "{heard:?}");
    // The scene is saved without the decoder's frames.
    let mut state = vec![0; trio.scene.state_size().expect("nobody else calls")];
    let length = trio.scene.save(&mut state).expect("nothing is in work");
    trio.scene.restore(&state[..length]).expect("its own state");

    trio.scene.set_target(trio.ids[0], Target::Member(trio.ids[1])).expect("both are there");
    trio.scene.set_allowed(trio.ids[2], Allowed::NONE).expect("it is there");
    trio.scene.remove(trio.ids[1]).expect("it is there");
    assert_eq!(trio.scene.remove(trio.ids[1]), Err(SceneError::NoMember(trio.ids[1])));
    trio.show(20);
    assert!(trio.scene.restore(&state[..length]).is_err(), "another set of members");
    trio.scene.remove(id).expect("it is there");
    trio.scene.remove(trio.ids[0]).expect("it is there");
    trio.show(5);
    drop(trio.scene);
}
