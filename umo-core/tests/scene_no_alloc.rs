//! Twenty seconds of a scene allocate nothing, and a member costs less than 10 µs per picture.

mod counting;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use counting::{allocator_calls, check_counter};
use umo_core::{
    Allowed, Engine, EngineConfig, MAX_MEMBERS, Model, ModelFile, Place, Poll, Precision, Scene, Session,
    SessionConfig, Target, Threads,
};
use umo_kernels::Isa;

/// Bound on an update, per member; a debug build is slower.
const MOST: Duration = Duration::from_micros(if cfg!(debug_assertions) { 200 } else { 10 });

fn main() {
    check_counter();
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mel_k2_arkit");
    let file = ModelFile::open(&folder.join("model.safetensors")).expect("a golden model");
    let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).expect("a golden model"));
    talks(&model);
    costs(&model);
}

fn place(i: usize) -> Place {
    let angle = i as f32 * 0.7;
    Place { position: [2.0 * angle.sin(), 0.0, 2.0 * angle.cos()], facing: angle + 3.1, ..Place::default() }
}

/// Two sessions and a person talk, come and go, and are saved and restored.
fn talks(model: &Arc<Model>) {
    let config = EngineConfig { threads: Threads::Host(0), max_sessions: 2, ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(model), &config).expect("no thread is needed");
    let session = || Arc::new(engine.session(&SessionConfig::new(model.config())).expect("a place"));
    let sessions = [session(), session()];
    let audio: Vec<f32> = (0_u16..16_000).map(|i| (f32::from(i) * 0.3).sin() * 0.3).collect();
    let scene = Scene::new(7).expect("memory");
    let ids = [0, 1].map(|i| scene.add(Some(Arc::clone(&sessions[i])), place(i)).expect("a place"));
    let mut person = scene.add(None, place(2)).expect("a place");
    let mut state = vec![0; scene.state_size().expect("nobody else calls")];
    let mut nods = 0;
    let calls = allocator_calls(|| {
        for picture in 0..600 {
            let turn = picture / 90 % 3;
            if turn < 2 {
                sessions[turn].push_audio(&audio[..533]).expect("it runs");
            } else {
                scene.push_audio(person, &audio[..533]).expect("it is there");
            }
            while engine.poll(Duration::from_millis(5)) == Ok(Poll::More) {}
            scene.update(1.0 / 30.0).expect("nobody else calls");
            for session in &sessions {
                session.pull_frames(2, |_| {}).expect("nobody else pulls");
            }
            scene.set_place(ids[0], place(picture % 5)).expect("it is there");
            match picture % 300 {
                100 => scene.set_target(ids[0], Target::Member(ids[1])).expect("they are there"),
                150 => scene.set_target(ids[0], Target::Free).expect("it is there"),
                200 => {
                    scene.set_allowed(ids[1], Allowed::LOOK | Allowed::NOD).expect("it is there");
                    let length = scene.save(&mut state).expect("nothing is in work");
                    scene.restore(&state[..length]).expect("its own state");
                    assert!(scene.restore(&state[..length / 2]).is_err());
                }
                250 => {
                    scene.remove(person).expect("it is there");
                    assert!(scene.remove(person).is_err() && scene.update(f64::NAN).is_err());
                    person = scene.add(None, place(3)).expect("a place");
                }
                _ => {}
            }
            nods = scene.member(ids[0]).expect("it is there").answers[0];
        }
    });
    assert_eq!(calls, 0, "allocations");
    assert!(nods > 0, "{nods}");
    println!("no allocation in 20 seconds of a scene");
}

/// Time of an update of a full scene.
fn costs(model: &Arc<Model>) {
    let config = EngineConfig { threads: Threads::Host(0), max_sessions: MAX_MEMBERS, ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(model), &config).expect("no thread is needed");
    let session = || engine.session(&SessionConfig::new(model.config())).expect("a place");
    let sessions: Vec<Session> = (0..MAX_MEMBERS).map(|_| session()).collect();
    let scene = Scene::new(7).expect("memory");
    let ids = sessions.iter().enumerate().map(|(i, session)| scene.add(Some(session), place(i)).expect("a place"));
    assert_eq!(ids.count(), MAX_MEMBERS);
    // The least of some rounds: other work of the machine does not count.
    let rounds = (0..20).map(|_| {
        let start = Instant::now();
        (0..50).for_each(|_| scene.update(1.0 / 30.0).expect("nobody else calls"));
        start.elapsed() / 50
    });
    let update = rounds.min().unwrap_or_default();
    let each = update / u32::try_from(MAX_MEMBERS).expect("a small number");
    println!("an update of {MAX_MEMBERS} members takes {update:?}, {each:?} each");
    assert!(each < MOST, "{each:?}");
}
