//! The scalar loop, compiled for this instruction set.

use super::{Bf16, scalar};
use crate::isa::Simd128;
use crate::mat::{Mat, MatMut};

pub(super) fn round(_token: Simd128, x: Mat<f32>, y: MatMut<Bf16>) {
    scalar::round(x, y);
}
