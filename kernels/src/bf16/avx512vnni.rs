//! The scalar loop, compiled for this instruction set.

use super::{Bf16, scalar};
use crate::mat::{Mat, MatMut};

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn round(x: Mat<f32>, y: MatMut<Bf16>) {
    scalar::round(x, y);
}
