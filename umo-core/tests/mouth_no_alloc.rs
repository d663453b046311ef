//! Once a stream is made, the live mouth never allocates: in pushes of any size, at the end, in a reset.

mod counting;

use std::path::PathBuf;

use counting::{allocator_calls, check_counter};
use umo_core::{ModelFile, Precision};
use umo_core_model::mouth::{Mouth, MouthStream};
use umo_core_model::weights::Loader;
use umo_kernels::Isa;

fn main() {
    check_counter();
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mel_k2_arkit/model.safetensors");
    let file = ModelFile::open(&path).expect("a golden model");
    let loader = Loader::new(&file, Precision::Stored, Isa::detect());
    let mouth = Mouth::load(&loader).expect("a golden model").expect("it has a mouth");
    let mut stream = MouthStream::new(&mouth);
    let samples: Vec<f32> = (0_u16..20_000).map(|i| (f32::from(i) * 0.1).sin()).collect();
    let mut frames = 0;
    let calls = allocator_calls(|| {
        for _ in 0..2 {
            for piece in [1, 160, 4000, 15_000] {
                let result = stream.push(&mouth, Isa::detect(), &samples[..piece], |_| frames += 1);
                assert_eq!(result, Ok(()));
            }
            assert_eq!(stream.finish(&mouth, Isa::detect(), |_| frames += 1), Ok(()));
            stream.reset(&mouth);
        }
    });
    assert_eq!(calls, 0);
    assert_eq!(frames, 2 * (19_161 * 30 / 16_000));
    println!("{frames} frames: no allocator calls");
}
