//! Sizes at which the loops of a back-end take another path, from the constants of the
//! back-end itself. Tests draw their shapes around them; no kernel reads them.

/// Lanes of the widest register: element-wise loops have a tail below it.
pub const LANES: usize = crate::lanes::LANES;

/// Sizes of one operation on one back-end. The loops change at multiples of each, or beyond it.
#[derive(Clone, Copy, Debug)]
pub struct Tiling {
    /// Rows of a product; queries of attention.
    pub rows: &'static [usize],
    /// Outputs of a product; keys of attention.
    pub outputs: &'static [usize],
    /// Inputs of a product; columns of a head.
    pub inputs: &'static [usize],
    /// Rows times inputs that are held at once; 0 if there is no limit.
    pub held: usize,
    /// Outputs times inputs of a chunk of weights that stays in cache while rows pass; 0 if
    /// there are no chunks.
    pub chunk: usize,
}

/// One row and one panel of outputs at a time, as in every scalar product.
pub(crate) const fn portable() -> Tiling {
    Tiling { rows: &[1], outputs: &[crate::pack::PANEL], inputs: &[crate::pack::QUAD], held: 0, chunk: 0 }
}
