//! Rounding to bfloat16: the same bits as one value at a time, for every kind of number.

use proptest::prelude::*;
use umo_kernels::bf16::round_bf16;
use umo_kernels::tiling::LANES;
use umo_kernels::{Bf16, Isa, Mat, MatMut};
use umo_tests::{Noise, Placed, cases, for_each_isa, near, offset};

/// Any bits, and often those around a tie: a lower half of 0x7fff, 0x8000 or 0x8001.
fn any_bits(noise: &mut Noise) -> f32 {
    let mut half = || u32::try_from(noise.below(1 << 16)).expect("16 bits");
    let (upper, lower, kind) = (half(), half(), half() % 6);
    f32::from_bits(upper << 16 | if kind < 3 { 0x7fff + kind } else { lower })
}

fn round_bf16_is_from_f32(isa: Isa) {
    let sizes = (near(8, 2), near(2 * LANES, 4), 0..9_usize, offset(), any::<u64>());
    proptest!(cases(64), |((rows, cols, gap, offset, seed) in sizes)| {
        let mut noise = Noise::new(seed);
        let x = Placed::new(rows, cols, gap, offset, || any_bits(&mut noise));
        let canary = Bf16(0x5a5a);
        let mut y = vec![canary; offset + rows * (cols + gap) + 64];
        round_bf16(isa, x.mat(), MatMut::with_stride(&mut y[offset..], rows, cols, cols + gap).expect("sized above"))
            .expect("shapes agree");
        for (at, &got) in y.iter().enumerate() {
            let place = at.checked_sub(offset).map(|at| (at / (cols + gap).max(1), at % (cols + gap).max(1)));
            let want = match place {
                Some((i, j)) if i < rows && j < cols => Bf16::from_f32(x.mat().row(i)[j]),
                _ => canary,
            };
            prop_assert_eq!(got, want, "at {}", at);
        }
    });
}

for_each_isa!(round_bf16_is_from_f32 => every);

#[test]
fn round_bf16_rejects_shapes_that_disagree() {
    let x = Mat::new(&[0.0; 6], 2, 3).expect("sized");
    let call = |rows, cols| {
        let mut y = [Bf16(0); 9];
        let y = MatMut::new(&mut y, rows, cols).expect("sized");
        round_bf16(Isa::SCALAR, x, y).map_err(|error| (error.arg, error.want, error.got))
    };
    assert_eq!(call(2, 3), Ok(()));
    assert_eq!(call(3, 3), Err(("y", 2, 3)));
    assert_eq!(call(2, 2), Err(("y", 3, 2)));
}
