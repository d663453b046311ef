//! The scalar loop, compiled for this instruction set.

use super::{Bf16, scalar};
use crate::mat::{Mat, MatMut};

#[target_feature(enable = "avx2,fma")]
pub(super) fn round(x: Mat<f32>, y: MatMut<Bf16>) {
    scalar::round(x, y);
}
