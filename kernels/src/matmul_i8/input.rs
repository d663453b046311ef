//! The operands of a product with quantized inputs, as its back-ends receive them.

use crate::gemm::Input;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "wasm32"))]
use crate::pack::PackedI8;

/// A product with int8 weights.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "wasm32"))]
pub(super) type GemmTask<'a> = crate::gemm::GemmTask<'a, PackedI8<'a>>;

/// Checked input rows with their scales.
#[derive(Clone, Copy)]
pub(crate) struct QuantInput<'a> {
    pub(crate) rows: Input<'a, i8>,
    pub(crate) scale: &'a [f32],
}

impl QuantInput<'_> {
    /// The scale of input row `t`.
    pub(crate) fn scale(&self, t: usize) -> f32 {
        self.scale[self.rows.index.map_or(t, |index| index[t] as usize)]
    }
}
