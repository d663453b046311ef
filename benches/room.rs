//! Cost of a scene: `room [MEMBERS [SECONDS [THREADS]]]`. Avatars of the default model (32) stand on a circle and speak in
//! turn, 3 s each, with all layers; every frame is pulled and the scene updated, as fast as the processor can. Prints the share
//! of real time, and of the time of all threads (2), and what the scene and the layers take of it: if listeners get silence,
//! which is computed as speech is, and if they get no audio, with the idle mode live.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use umo_core::{
    Clock, Engine, EngineConfig, Idle, MAX_BATCH, Model, ModelFile, Place, Poll, Precision, Scene, SessionConfig,
    Threads,
};
use umo_kernels::Isa;

/// Seconds after which another member speaks.
const TURN: usize = 3;
/// Distance between neighbours on the circle, metres.
const APART: f32 = 1.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let numbers = std::env::args().skip(1).map(|word| word.parse()).collect::<Result<Vec<usize>, _>>()?;
    let number = |at: usize, usual: usize| numbers.get(at).copied().unwrap_or(usual);
    let (members, seconds, threads) = (number(0, 32), number(1, 30), number(2, 2));
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let file = ModelFile::open(&assets.join("models/umo-people/model.safetensors"))?;
    let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect())?);
    println!("{}, {}, {threads} threads: {members} members, {seconds} s", model.config().name, Isa::detect().name());
    for gives_silence in [true, false] {
        println!("listeners {}:", if gives_silence { "with silence as audio" } else { "without audio" });
        room(&model, (members, seconds, threads), gives_silence)?;
    }
    Ok(())
}

fn room(
    model: &Arc<Model>,
    (members, seconds, threads): (usize, usize, usize),
    gives_silence: bool,
) -> Result<(), Box<dyn std::error::Error>> {
    let nanos = Arc::new(AtomicU64::new(0));
    let config = EngineConfig {
        clock: Clock::Manual(Arc::clone(&nanos)),
        threads: Threads::Host(threads - 1),
        max_sessions: members,
        max_batch: members.min(MAX_BATCH),
        ..EngineConfig::default()
    };
    let engine = Engine::new(Arc::clone(model), &config)?;
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let recording = umo_audio_file::read(&assets.join("assets/hello.wav"))?;
    let speech = recording.mono();
    let config = SessionConfig {
        sample_rate: recording.sample_rate as usize,
        idle: if gives_silence { Idle::Hold } else { Idle::Live },
        ..SessionConfig::new(model.config())
    };
    let sessions = (0..members).map(|_| engine.session(&config)).collect::<Result<Vec<_>, _>>()?;
    let scene = Scene::new(0)?;
    for (at, session) in sessions.iter().enumerate() {
        scene.add(Some(session), place(at, members))?;
    }
    let rate = model.config().frame_rate;
    let step = config.sample_rate / rate;
    let silence = vec![0.0; step];
    let [mut computed, mut scenes, mut layers] = [Duration::ZERO; 3];
    let (start, processor) = (Instant::now(), processor());
    for frame in 0..seconds * rate {
        nanos.store(frame as u64 * 1_000_000_000 / rate as u64, Ordering::Relaxed);
        let said = &speech[frame * step % (speech.len() - step)..][..step];
        let speaker = frame / (TURN * rate) % members;
        for (at, session) in sessions.iter().enumerate() {
            match at == speaker {
                true => drop(session.push_audio(said)?),
                false if gives_silence => drop(session.push_audio(&silence)?),
                false => {}
            }
        }
        computed += timed(|| {
            while engine.poll(Duration::MAX)? != Poll::Idle {}
            Ok(())
        })?;
        scenes += timed(|| Ok(scene.update(1.0 / rate as f64)?))?;
        layers += timed(|| Ok(sessions.iter().try_for_each(|session| session.pull_frames(1, |_| ()).map(|_| ()))?))?;
    }
    let (took, used) = (start.elapsed().as_secs_f64(), (self::processor() - processor).as_secs_f64());
    let real = seconds as f64;
    let each = |time: Duration| 1e6 * time.as_secs_f64() / (seconds * rate * members) as f64;
    println!(
        "  {:.1} % of real time, {:.1} % of the threads' processor time",
        100.0 * took / real,
        100.0 * used / real / threads as f64
    );
    let held: u64 = sessions.iter().map(|session| session.stats().held_chunks).sum();
    let chunks: u64 = sessions.iter().map(|session| session.stats().chunks).sum();
    println!("  {chunks} chunks, {held} of them with a held body");
    println!(
        "  a member and frame: engine {:.1} µs, scene {:.2} µs, layers and pull {:.1} µs",
        each(computed),
        each(scenes),
        each(layers)
    );
    Ok(())
}

/// A place on the circle, facing its centre.
fn place(at: usize, members: usize) -> Place {
    let turn = std::f32::consts::TAU * at as f32 / members as f32;
    let radius = APART * members as f32 / std::f32::consts::TAU;
    let (sine, cosine) = turn.sin_cos();
    Place { position: [radius * sine, 0.0, -radius * cosine], facing: -turn, ..Place::default() }
}

fn timed(
    call: impl FnOnce() -> Result<(), Box<dyn std::error::Error>>,
) -> Result<Duration, Box<dyn std::error::Error>> {
    let start = Instant::now();
    call()?;
    Ok(start.elapsed())
}

/// Processor time of all threads of the program; the time since it began if the system does not report it.
fn processor() -> Duration {
    #[cfg(target_os = "linux")]
    return Duration::try_from(rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime)).unwrap_or_default();
    #[cfg(not(target_os = "linux"))]
    {
        static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
        START.elapsed()
    }
}
