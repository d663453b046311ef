//! Registers for the loops of products.

pub(super) use crate::lanes::neon::{Register, add, fmadd, load_two, mul, splat, store_two, zero};
pub(super) use crate::math::neon::{activate, gelu_tanh};
pub(super) use umo_kernels_features::neon as features;

/// Whether full tiles reload a value for the next input or panel, indexed by the inputs of a row of a
/// panel minus one: rows of two inputs need one more register for their second weights.
pub(super) const RELOADS: [bool; 2] = [false, true];
