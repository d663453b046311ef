//! Cost of the calls on the audio and game threads, from C and from Rust: 10 ms of sound in, a
//! pose out, at three rates; the live mouth; the layers over the decoders' frames; the voice's arousal; and words.

use std::hint::black_box;
use std::ptr::null_mut;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use rubato::audioadapter_buffers::direct::SequentialSlice;
use rubato::{Async, Fft, FixedAsync, FixedSync, SincInterpolationParameters, SincInterpolationType, WindowFunction};
use umo::engine::{
    UMO_ENGINE_POLLED, UmoEngine, UmoEngineConfig, umo_engine_config_init, umo_engine_new, umo_engine_poll,
};
use umo::frame::{UmoFrameLayout, umo_frame_layout_init};
use umo::model::{UmoModel, umo_model_load_memory};
use umo::parameter::UMO_PARAMETER_GAIN_FACE;
use umo::session::settings::umo_session_get_parameter;
use umo::session::stream::{umo_session_push_audio, umo_session_reset, umo_session_sample_pose};
use umo::session::{UmoSession, UmoSessionConfig, umo_session_config_init, umo_session_new};
use umo::status::UMO_STATUS_OK;
use umo_core::{
    Clock, Engine, EngineConfig, Layer, LayerGains, Model, ModelFile, Precision, Resampler, Session, SessionConfig,
    Threads,
};
use umo_core_base::arousal::Arousal;
use umo_core_base::memory::Arena;
use umo_core_model::mouth::{Mouth, MouthStream};
use umo_core_model::weights::Loader;
use umo_core_words::{Hints, Planner, UNITS, WordRules};
use umo_kernels::Isa;

static MODEL: &[u8] = include_bytes!("../models/umo-people/model.safetensors");

fn ok(status: i32) {
    assert_eq!(status, UMO_STATUS_OK);
}

/// A session of the C interface whose engine computes only when polled.
struct Avatar {
    engine: *mut UmoEngine,
    session: *mut UmoSession,
    layout: UmoFrameLayout,
}

impl Avatar {
    fn new(rate: u32) -> Self {
        let (mut model, mut engine, mut session) = (null_mut::<UmoModel>(), null_mut(), null_mut());
        // SAFETY: plain integers and pointers, for which zero is a valid value.
        let (mut config, mut asked, mut layout): (UmoEngineConfig, UmoSessionConfig, UmoFrameLayout) =
            unsafe { std::mem::zeroed() };
        let (abi, data, size) = (umo::UMO_ABI_VERSION, MODEL.as_ptr().cast(), MODEL.len());
        // SAFETY: pointer and size are of one slice, and the other pointer is to a local value.
        ok(unsafe { umo_model_load_memory(abi, data, size, std::ptr::null(), &raw mut model) });
        // SAFETY: the pointer is to a local value, and the size is that value's.
        ok(unsafe { umo_engine_config_init(&raw mut config, size_of::<UmoEngineConfig>()) });
        (config.mode, config.threads) = (UMO_ENGINE_POLLED, 1);
        // SAFETY: the configuration was initialised, and the pointers are to local
        // values.
        ok(unsafe { umo_engine_new(model, &raw const config, &raw mut engine) });
        // SAFETY: the pointer is to a local value, and the size is that value's.
        ok(unsafe { umo_session_config_init(&raw mut asked, size_of::<UmoSessionConfig>(), model) });
        asked.sample_rate = rate;
        // SAFETY: the configuration was initialised, and the pointers are to local
        // values.
        ok(unsafe { umo_session_new(engine, &raw const asked, &raw mut session) });
        // SAFETY: the pointer is to a local value, and the size is that value's.
        ok(unsafe { umo_frame_layout_init(&raw mut layout, size_of::<UmoFrameLayout>(), model) });
        Self { engine, session, layout }
    }

    fn push(&self, samples: &[f32]) -> i32 {
        // SAFETY: pointer and length are of one slice.
        unsafe { umo_session_push_audio(self.session, samples.as_ptr(), samples.len(), null_mut()) }
    }

    fn compute(&self) {
        // SAFETY: the output pointer may be null.
        ok(unsafe { umo_engine_poll(self.engine, u32::MAX, null_mut()) });
    }

    fn sample(&self, seconds: f64, room: &mut [u8]) {
        let (layout, frame) = (&raw const self.layout, room.as_mut_ptr().cast());
        // SAFETY: pointer and length are of the buffer.
        ok(unsafe { umo_session_sample_pose(self.session, seconds, layout, frame, room.len(), null_mut()) });
    }
}

fn rust(rate: usize) -> (Engine, Session) {
    let file = ModelFile::from_static(MODEL).expect("it is the default model");
    let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).expect("it is whole"));
    let config = EngineConfig { threads: Threads::Host(0), ..EngineConfig::default() };
    let engine = Engine::new(model, &config).expect("one thread is enough");
    let config = SessionConfig { sample_rate: rate, ..SessionConfig::new(engine.model().config()) };
    let session = engine.session(&config).expect("there is a place");
    (engine, session)
}

/// Cost of the layers: a tick of an idle figure with every layer on and with a single one, and the
/// pose between two ticks.
fn layers(c: &mut Criterion) {
    let file = ModelFile::from_static(MODEL).expect("it is the default model");
    let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).expect("it is whole"));
    let nanos = Arc::new(AtomicU64::new(0));
    let clock = Clock::Manual(Arc::clone(&nanos));
    let config = EngineConfig { threads: Threads::Host(0), clock, ..EngineConfig::default() };
    let engine = Engine::new(model, &config).expect("one thread is enough");
    let one = |layer| (format!("{} alone", Layer::name(layer)), LayerGains::OFF.with(layer, 1.0));
    for (name, gains) in [("all".to_owned(), LayerGains::ON)].into_iter().chain(Layer::ALL.map(one)) {
        let mut config = SessionConfig::new(engine.model().config());
        config.layers = gains;
        let session = engine.session(&config).expect("there is a place");
        c.bench_function(&format!("layers/{name}, and a pose between two ticks"), |b| {
            b.iter(|| {
                nanos.fetch_add(1_000_000_000 / 30, Ordering::Relaxed);
                session.sample_pose(0.0, |frame| _ = black_box(frame.pose.translation))
            });
        });
    }
}

/// Cost of a voice's arousal: a second of speech-like sound, ten values.
fn arousal(c: &mut Criterion) {
    let rate = 16_000;
    // A buzz whose pitch and level move as syllables do, with a breath of noise.
    let samples: Vec<f32> = (0..rate)
        .map(|i| {
            let seconds = i as f32 / rate as f32;
            let syllable = (12.0 * seconds).sin().abs();
            let phase = 150.0 * seconds + 2.0 * (6.0 * seconds).sin();
            syllable * (0.3 * (2.0 * phase.fract() - 1.0) + 0.02 * (i as f32 * 12.9898).sin())
        })
        .collect();
    let mut heard = Arousal::new_in(rate, &Arena::system());
    c.bench_function("arousal/1 s of a voice", |b| {
        b.iter(|| {
            let mut sum = 0.0;
            heard.push(black_box(&samples), |value| sum += value);
            sum
        });
    });
}

/// Cost of words: ten seconds of speech with three words a second, given and decided in 300 frames.
fn words(c: &mut Criterion) {
    let rules = WordRules::english();
    let said = ["no,", "we", "never", "saw", "that", "large", "table", "over", "there,", "maybe"];
    c.bench_function("words/30 words in 300 frames", |b| {
        b.iter(|| {
            let (mut hints, mut planner, mut decided) = (Hints::NONE, Planner::new(), 0);
            for (word, start) in said.iter().cycle().zip(0..30) {
                let start = f64::from(start) / 3.0;
                hints.push(&rules, word, (start, start + 0.3), (0, 0)).expect("there is room");
            }
            for frame in 0..300 {
                planner.plan(&rules, &hints, 1, frame * UNITS / 30, |_| decided += 1);
            }
            decided
        });
    });
}

fn calls(c: &mut Criterion) {
    for rate in [16_000, 44_100, 48_000] {
        let samples = vec![0.1; rate / 100];
        let avatar = Avatar::new(u32::try_from(rate).expect("a rate is small"));
        c.bench_function(&format!("push_audio/c/10 ms at {rate}"), |b| {
            b.iter(|| {
                // Keeps the rings from filling: discards the pushed audio at once.
                ok(umo_session_reset(avatar.session));
                avatar.push(black_box(&samples))
            });
        });
        let (_engine, session) = rust(rate);
        c.bench_function(&format!("push_audio/rust/10 ms at {rate}"), |b| {
            b.iter(|| {
                session.reset().expect("it runs");
                session.push_audio(black_box(&samples)).map(|pushed| pushed.taken)
            });
        });
    }
    let avatar = Avatar::new(16_000);
    ok(avatar.push(&vec![0.1; 32_000]));
    avatar.compute();
    let mut room = vec![0; 4 * avatar.layout.frame_stride as usize];
    avatar.sample(0.5, &mut room);
    c.bench_function("sample_pose/c/55 joints, 52 channels, 15 visemes", |b| b.iter(|| avatar.sample(0.51, &mut room)));
    let (engine, session) = rust(16_000);
    session.push_audio(&vec![0.1; 32_000]).expect("there is room");
    engine.poll(Duration::MAX).expect("nobody else polls");
    session.sample_pose(0.5, |_| {}).expect("it runs");
    c.bench_function("sample_pose/rust/a view", |b| {
        b.iter(|| session.sample_pose(0.51, |frame| _ = black_box(frame.pose.translation)));
    });
    c.bench_function("get_parameter/c", |b| {
        let mut value = 0.0;
        // SAFETY: the pointer is to a local value.
        b.iter(|| unsafe { umo_session_get_parameter(avatar.session, UMO_PARAMETER_GAIN_FACE, &raw mut value) });
    });
    c.bench_function("get_parameter/c/a handle that was made up", |b| {
        let mut value = 0.0;
        let none = std::ptr::without_provenance(0x1234_5673);
        // SAFETY: the pointer is to a local value.
        b.iter(|| unsafe { umo_session_get_parameter(none, UMO_PARAMETER_GAIN_FACE, &raw mut value) });
    });
}

/// The live mouth: one frame of audio, three feature rows and one run of the network.
fn mouth(c: &mut Criterion) {
    let file = ModelFile::from_static(MODEL).expect("it is the default model");
    let isa = Isa::detect();
    let mouth = Mouth::load(&Loader::new(&file, Precision::Stored, isa)).expect("it is whole");
    let mouth = mouth.expect("the default model has a live mouth");
    let mut stream = MouthStream::new(&mouth);
    // Every third push has one more sample, so that three pushes are a tenth of a second.
    let samples: Vec<f32> = (0..1600_u16).map(|i| 0.2 * (f32::from(i) * 0.08).sin()).collect();
    let mut pieces = [&samples[..533], &samples[533..1066], &samples[1066..]].into_iter().cycle();
    c.bench_function(&format!("live_mouth/{}/33 ms", isa.name()), |b| {
        b.iter(|| {
            let piece = pieces.next().expect("they go round");
            stream.push(&mouth, isa, black_box(piece), |frame| _ = black_box(frame.channels[0]))
        });
    });
}

/// 10 ms of sound to 16 kHz, compared with rubato: its sinc filter of the same length and delay, without
/// interpolation for rates with few phases, and its Fourier filter of 10 ms pieces.
fn resampling(c: &mut Criterion) {
    for rate in [44_100, 48_000, 48_001] {
        let samples = vec![0.1; rate / 100];
        let mut ours = Resampler::new(rate, 16_000).expect("the rate is in range");
        c.bench_function(&format!("resample/ours/10 ms at {rate}"), |b| {
            b.iter(|| ours.push(&samples, |piece| _ = black_box(piece)));
        });
        let length = 2 * (112 * rate).div_ceil(16_000);
        let mut parameters = SincInterpolationParameters::new(length, WindowFunction::BlackmanHarris2);
        (parameters.oversampling_factor, parameters.interpolation) = match rate {
            48_000 => (1, SincInterpolationType::Nearest),
            44_100 => (160, SincInterpolationType::Nearest),
            _ => (512, SincInterpolationType::Linear),
        };
        let (ratio, chunk) = (16_000.0 / rate as f64, rate / 100);
        let sinc = Async::<f32>::new_sinc(ratio, 1.0, &parameters, chunk, 1, FixedAsync::Input);
        let window = WindowFunction::BlackmanHarris2;
        let fourier =
            (rate % 100 == 0).then(|| Fft::<f32>::new_custom(rate, 16_000, chunk, 1, 1, window, FixedSync::Both));
        let sinc: Box<dyn rubato::Resampler<f32>> = Box::new(sinc.expect("it is within its limits"));
        let fourier = fourier.map(|it| -> Box<dyn rubato::Resampler<f32>> { Box::new(it.expect("so is this")) });
        for (name, mut theirs) in [("rubato sinc", Some(sinc)), ("rubato Fourier", fourier)] {
            let Some(theirs) = &mut theirs else { continue };
            let (mut made, input) = (vec![0.0; theirs.output_frames_max()], &samples[..theirs.input_frames_next()]);
            c.bench_function(&format!("resample/{name}/10 ms at {rate}"), |b| {
                b.iter(|| {
                    let len = made.len();
                    let input = SequentialSlice::new(input, 1, input.len()).expect("one channel");
                    let mut output = SequentialSlice::new_mut(&mut made[..], 1, len).expect("one channel");
                    theirs.process_into_buffer(&input, &mut output, None).expect("the lengths are its own")
                });
            });
        }
    }
}

criterion_group!(benches, calls, mouth, layers, arousal, words, resampling);
criterion_main!(benches);
