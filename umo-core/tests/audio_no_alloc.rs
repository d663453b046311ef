//! A stream's chunks never allocate, including the first one and refused ones.

mod counting;

use std::path::PathBuf;

use counting::{allocator_calls, check_counter};
use umo_core::{Compute, ModelFile, Precision, Team};
use umo_core_model::audio::Tokenizer;
use umo_core_model::weights::Loader;
use umo_kernels::Isa;

fn main() {
    check_counter();
    let team = Team::new(2).expect("a second thread");
    let cx = Compute { isa: Isa::detect(), team: &team };
    let samples: Vec<f32> = (0_u16..20 * 320).map(|i| (f32::from(i) * 0.1).sin()).collect();
    for model in ["hubert_k1_smplx", "hubert_k3_i8", "mel_k2_arkit", "mel_k1_upcycled"] {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(model);
        let file = ModelFile::open(&folder.join("model.safetensors")).expect("a golden model");
        let tokenizer = Tokenizer::load(&Loader::new(&file, Precision::F32, Isa::detect())).expect("a golden model");
        let (mut stream, mut scratch) = (tokenizer.stream(60, 20), tokenizer.scratch(60, 20));
        let mut units = [0; 60];
        let calls = allocator_calls(|| {
            for hops in [1, 20, 5, 20] {
                let chunk = &samples[..hops * 320];
                let result = tokenizer.advance(cx, &mut stream, &mut scratch, chunk, &mut units);
                assert_eq!(result, Ok(()));
                assert!(tokenizer.advance(cx, &mut stream, &mut scratch, &samples[..hops], &mut units).is_err());
            }
            stream.reset();
        });
        assert_eq!(calls, 0, "{model}");
        println!("{model}: no allocator calls");
    }
}
