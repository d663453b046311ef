//! The scalar loop, compiled for this instruction set.

use super::{Bf16, scalar};
use crate::isa::{Neon, entry};
use crate::mat::{Mat, MatMut};

entry! {
    pub(super) fn round(_token: Neon, x: Mat<f32>, y: MatMut<Bf16>) {
        scalar::round(x, y);
    }
}
