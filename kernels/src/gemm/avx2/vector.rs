//! Registers for the loops of products.

pub(super) use crate::lanes::avx2::{Register, add, fmadd, load_two, mul, splat, store_two, zero};
pub(super) use crate::math::avx2::{activate, gelu_tanh};
pub(super) use umo_kernels_features::avx2 as features;

/// Whether full tiles reload a value for the next input or panel, indexed by the inputs of a row of a
/// panel minus one: sums leave two of 16 registers for values.
pub(super) const RELOADS: [bool; 2] = [true, true];
