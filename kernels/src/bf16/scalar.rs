//! The reference, without branches, so that compilers vectorize it.

use super::Bf16;
use crate::mat::{Mat, MatMut};

#[inline(always)]
pub(super) fn round(x: Mat<f32>, mut y: MatMut<Bf16>) {
    for i in 0..x.rows() {
        for (y, &x) in y.row_mut(i).iter_mut().zip(x.row(i)) {
            *y = nearest(x);
        }
    }
}

/// The discarded bits carry into the upper half if they exceed half a unit of it, or equal half
/// and the unit is odd.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the upper half of 32 bits has 16")]
fn nearest(value: f32) -> Bf16 {
    const QUIET: u32 = 0x40;
    let bits = value.to_bits();
    let (upper, carry) = (bits >> 16, 0x7fff + (bits >> 16 & 1));
    Bf16(if value.is_nan() { upper | QUIET } else { bits.wrapping_add(carry) >> 16 } as u16)
}
