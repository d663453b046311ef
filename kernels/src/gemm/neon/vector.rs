//! Registers for the loops of products.

pub(super) use crate::lanes::neon::{Register, add, fmadd, load_two, mul, splat, store_two, zero};
pub(super) use crate::math::neon::{activate, gelu_tanh};
pub(super) use umo_kernels_features::neon as features;

/// Whether full tiles load a value again for the next input or panel, by the inputs of a row of a
/// panel less one: rows of two inputs need a register more for their second weights.
pub(super) const RELOADS: [bool; 2] = [false, true];
