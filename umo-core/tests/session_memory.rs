//! A session is one block of the planned size: planning allocates nothing, making it allocates
//! only the block, and dropping it frees the block.

mod counting;

use std::cell::Cell;
use std::path::PathBuf;
use std::sync::Arc;

use counting::{allocated, allocator_calls, check_counter};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use umo_core::{Engine, EngineConfig, Model, ModelFile, Precision, SessionConfig, Threads, Voice};
use umo_core_base::memory::Arena;
use umo_kernels::Isa;

/// Models of both layouts, of both kinds of audio, with and without a live mouth.
const MODELS: [&str; 6] =
    ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit", "frames_four", "frames_seven"];
const RATES: [usize; 6] = [8_000, 16_000, 22_050, 44_100, 48_000, 96_000];

/// Sample rates and the documented upper bound of their filters, bytes, as in umo.h.
const FILTERS: [(usize, usize); 4] = [(16_000, 0), (44_100, 400 << 10), (48_000, 4 << 10), (191_999, 1 << 20)];

fn main() {
    check_counter();
    let golden = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden");
    let mut paths: Vec<_> = MODELS.iter().map(|name| golden.join(name).join("model.safetensors")).collect();
    paths.push(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models/umo-people/model.safetensors"));
    let live = Cell::new(0);
    for path in paths {
        let file = ModelFile::open(&path).expect("a model");
        let model = Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).expect("a model"));
        let config = EngineConfig { threads: Threads::Host(0), max_sessions: 2, ..EngineConfig::default() };
        let engine = Engine::new(Arc::clone(&model), &config).expect("no thread is needed");
        filters_are_small(&model);
        let (made, sizes) = (Cell::new(0), Cell::new((usize::MAX, 0)));
        let settings = (
            0..RATES.len(),
            1..=8_usize,
            1..=model.config().max_target,
            0..=9_usize,
            prop::sample::select(vec![0.0_f32, 0.7, 1.5]),
            prop::sample::select(vec![Voice::Delayed, Voice::Live, Voice::Mouth]),
            0..3000_usize,
            (0..=model.config().audio.ahead, prop::bool::ANY, 0..20_usize),
        );
        let mut runner = TestRunner::new(Config { cases: 200, failure_persistence: None, ..Config::default() });
        let checked = runner.run(&settings, |(rate, channels, target, lookahead, smoothing, voice, queue, more)| {
            let mut session = SessionConfig::new(model.config());
            (session.sample_rate, session.channels, session.queue_frames) = (RATES[rate], channels, queue);
            (session.avatar.target, session.avatar.lookahead) = (target, lookahead);
            (session.avatar.smoothing, session.voice) = (smoothing, voice);
            let (horizon, is_text, ids) = more;
            (session.avatar.horizon, session.avatar.text) = (horizon, vec![5; ids]);
            if is_text && model.config().templates.contains_key("text_to_motion") {
                session.avatar.template = "text_to_motion".to_owned();
            }
            // The first session of a rate makes its filter, which others then share.
            if engine.plan_session(&session, &Arena::plan()).is_err() {
                prop_assert!(engine.session(&session).is_err());
                return Ok(());
            }
            let plan = Arena::plan();
            let calls = allocator_calls(|| engine.plan_session(&session, &plan).expect("as before"));
            prop_assert_eq!(calls, 0, "planning allocates");
            let layout = plan.layout().expect("it fits");
            let before = allocated();
            let mut kept = None;
            let calls = allocator_calls(|| {
                let block = Arena::block(layout).expect("there is memory");
                kept = Some((engine.session_in(&session, &block).expect("as planned"), block));
            });
            prop_assert_eq!((calls, allocated() - before), (1, layout.size()), "one block and nothing else");
            let (session, block) = kept.expect("it was made");
            prop_assert_eq!(block.unused(), 0, "the plan is exact");
            drop(block);
            prop_assert_eq!(allocated() - before, layout.size());
            drop(session);
            prop_assert_eq!(allocated(), before, "the block goes with the session");
            made.set(made.get() + 1);
            live.set(live.get() + usize::from(voice != Voice::Delayed));
            let (least, most) = sizes.get();
            sizes.set((least.min(layout.size()), most.max(layout.size())));
            Ok(())
        });
        if let Err(error) = checked {
            panic!("{}: {error}", path.display());
        }
        let (made, (least, most)) = (made.get(), sizes.get());
        assert!(made > 20, "{}: {made} of 200 settings are a session", path.display());
        println!("{}: {made} sessions of {least} to {most} bytes", model.config().name);
    }
    assert!(live.get() > 0, "some have a live mouth");
}

/// The shared filter of a rate is within the documented size.
fn filters_are_small(model: &Arc<Model>) {
    for (sample_rate, most) in FILTERS {
        let config = EngineConfig { threads: Threads::Host(0), max_sessions: 1, ..EngineConfig::default() };
        let engine = Engine::new(Arc::clone(model), &config).expect("no thread is needed");
        let session = SessionConfig { sample_rate, ..SessionConfig::new(model.config()) };
        let before = allocated();
        engine.plan_session(&session, &Arena::plan()).expect("a session at any rate");
        let bytes = allocated() - before;
        assert!(bytes <= most, "{sample_rate} Hz: {bytes} bytes");
    }
}
