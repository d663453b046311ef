//! Any bytes as a take, as they are and with a head that is right: an error, or frames of numbers.
#![no_main]

use std::sync::{Arc, OnceLock};

use libfuzzer_sys::fuzz_target;
use umo_core::{Isa, Model, ModelFile, Precision, Session, SessionConfig, Take};

static BYTES: &[u8] = include_bytes!("../../golden/frames_seven/model.safetensors");
static MODEL: OnceLock<(Arc<Model>, SessionConfig)> = OnceLock::new();

/// Where version, checksum, length and model are.
const VERSION: usize = 8;
const CHECKSUM: usize = 12;
const LENGTH: usize = 16;
const MODEL_NUMBER: usize = 48;
/// Most frames of one run.
const MOST: usize = 600;

fuzz_target!(|data: &[u8]| {
    let (model, config) = MODEL.get_or_init(|| {
        let file = ModelFile::from_bytes(BYTES.to_vec()).expect("a golden model");
        let model = Model::load(&file, Precision::Stored, Isa::detect()).expect("a golden model");
        let config = SessionConfig::new(model.config());
        (Arc::new(model), config)
    });
    if let Err(error) = Take::new(data) {
        assert!(!error.to_string().is_empty());
    }
    let mut bytes = data.to_vec();
    bytes.resize(bytes.len().max(MODEL_NUMBER + 8), 0);
    bytes[..CHECKSUM].copy_from_slice(b"umo take\x01\0\0\0");
    // A take that was edited has version 2.
    bytes[VERSION] = if data.get(VERSION) == Some(&2) { 2 } else { 1 };
    let length = bytes.len() as u64;
    bytes[LENGTH..LENGTH + 8].copy_from_slice(&length.to_le_bytes());
    bytes[MODEL_NUMBER..MODEL_NUMBER + 8].copy_from_slice(&model.fingerprint().to_le_bytes());
    let sum = crc32fast::hash(&bytes[LENGTH..]);
    bytes[CHECKSUM..LENGTH].copy_from_slice(&sum.to_le_bytes());
    let Ok(take) = Take::new(&bytes) else { return };
    assert!(take.bytes() == bytes && take.packets().count() == take.info().packets as usize);
    assert!(take.events().all(|(frame, event)| frame <= take.info().frames.into() && !event.to_string().is_empty()));
    let Ok(session) = Session::of_take(model, &take, config) else { return };
    let (mut next, mut is_over) = (0, false);
    // A chunk has frames, or the take has ended.
    for round in 0.. {
        if is_over || next >= MOST {
            return;
        }
        assert!(round < 2 * MOST, "it never ends, after frame {next}");
        let more = session.push_take();
        let pulled = session.pull_frames(64, |frame| {
            assert!(frame.pose.translation.iter().chain(frame.face).all(|v| v.is_finite()), "frame {next}");
            assert!(frame.pose.rotations.as_flattened().iter().all(|v| v.is_finite()), "frame {next}");
            next += 1;
        });
        is_over = more.is_err() || pulled.is_err() || session.is_done().unwrap_or(true);
    }
});
