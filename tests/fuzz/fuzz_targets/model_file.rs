//! Any bytes as a model file: an error or a model, never a panic, a crash or more memory than the file justifies.
#![no_main]

use libfuzzer_sys::fuzz_target;
use umo_core::{Model, ModelFile, Precision};
use umo_kernels::Isa;

fuzz_target!(|data: &[u8]| {
    let Ok(file) = ModelFile::from_bytes(data.to_vec()) else { return };
    for precision in [Precision::F32, Precision::Int8] {
        if let Err(error) = Model::load(&file, precision, Isa::SCALAR) {
            assert!(!error.to_string().is_empty());
            return;
        }
    }
});
