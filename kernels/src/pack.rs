//! Packed weights of the products: panels of [`PANEL`] output rows, so that one load feeds as
//! many outputs.
//!
//! ```text
//! w [n, k] row-major   packed f32                  packed bf16                         packed i8
//! ┌─ k ─┐              panel 0: k=0: w[0..16][0]   panel 0: k=0..2: w[0][0..2] …       panel 0: k=0..4: w[0][0..4] …
//! n     │      ──▶              k=1: w[0..16][1]            k=2..4: w[0][2..4] …                k=4..8: w[0][4..8] …
//! └─────┘              panel 1: …                  panel 1: …                          panel 1: …
//! ```
//! Except for f32, a row of 64 bytes is a row of an AMX tile. Outputs beyond `n` and (bf16,
//! int8) inputs beyond `k` are zeros. All back-ends read the same layout.
//!
//! Int4 weights are stored in groups of [`GROUP`] inputs, each with one int8 multiplier per output.
//! A block of 64 bytes has two quads of all outputs of a panel, the first in the low nibbles:
//!
//! ```text
//! panel 0: span 0: multipliers of four groups    m[0..16][group 0] … m[0..16][group 3], 64 bytes
//!                  codes + 8, in nibbles         block 0: inputs 0..4 (low), 4..8 (high); four blocks per group
//!          span 1: …
//! ```
//! A panel is thus read sequentially: with all multipliers before all codes there would be two streams, and the
//! prefetcher of a Zen 4 would follow neither.

use crate::bf16::Bf16;
use crate::error::{ShapeError, expect_len};
use crate::mat::Mat;
use core::ops::Range;

/// Outputs in one panel: one AVX-512 register of sums, two of AVX2, four of SSE2 or NEON.
pub const PANEL: usize = 16;

/// Inputs of one lane of a bf16 dot-product instruction.
pub const PAIR: usize = 2;

/// Inputs of one lane of an int8 dot-product instruction.
pub const QUAD: usize = 4;

/// Inputs of an int4 weight that share a multiplier.
pub const GROUP: usize = 32;

/// Bytes of int4 weights that hold two quads of all outputs of a panel.
pub const BLOCK: usize = PANEL * QUAD;

/// Blocks of codes in a group.
pub(crate) const GROUP_BLOCKS: usize = GROUP / (2 * QUAD);

/// Groups of a span, whose multipliers are one block.
pub(crate) const SPAN_GROUPS: usize = BLOCK / PANEL;

/// Blocks of a whole span.
pub(crate) const SPAN_BLOCKS: usize = 1 + SPAN_GROUPS * GROUP_BLOCKS;

/// Largest absolute value of a group's multiplier: its product with a code fits in int8.
pub const MAX_MULTIPLIER: i8 = 15;

/// Smallest and largest int4 code.
pub const CODES_I4: (i8, i8) = (-8, 7);

/// Offset that makes an int4 code an unsigned nibble.
pub const NIBBLE_OFFSET: i8 = 8;

/// Number of panels for `n` outputs.
pub const fn panels(n: usize) -> usize {
    n.div_ceil(PANEL)
}

/// Number of elements of a packed f32 weight `[n, k]`.
pub const fn packed_len(n: usize, k: usize) -> usize {
    panels(n) * PANEL * k
}

/// Number of elements of a packed bf16 weight `[n, k]`.
pub const fn packed_len_bf16(n: usize, k: usize) -> usize {
    panels(n) * PANEL * k.div_ceil(PAIR) * PAIR
}

/// Number of elements of a packed int8 weight `[n, k]`.
pub const fn packed_len_i8(n: usize, k: usize) -> usize {
    panels(n) * PANEL * k.div_ceil(QUAD) * QUAD
}

/// Number of bytes of a packed int4 weight `[n, k]`.
pub const fn packed_len_i4(n: usize, k: usize) -> usize {
    let groups = k.div_ceil(GROUP);
    panels(n) * (groups.div_ceil(SPAN_GROUPS) + groups * GROUP_BLOCKS) * BLOCK
}

/// An f32 weight `[n, k]` in panels.
#[derive(Clone, Copy, Debug)]
pub struct PackedF32<'a> {
    data: &'a [f32],
    n: usize,
    k: usize,
}

impl<'a> PackedF32<'a> {
    /// A view of packed data: `[panels(n), k, PANEL]`.
    ///
    /// # Errors
    /// [`ShapeError`] if the length of `data` is not [`packed_len`].
    pub fn new(data: &'a [f32], n: usize, k: usize) -> Result<Self, ShapeError> {
        expect_len("data", packed_len(n, k), data.len())?;
        Ok(Self { data, n, k })
    }

    /// Number of outputs.
    #[inline]
    pub fn n(&self) -> usize {
        self.n
    }

    /// Number of inputs.
    #[inline]
    pub fn k(&self) -> usize {
        self.k
    }

    /// Panel `p`: `[k, PANEL]`.
    #[inline]
    pub fn panel(&self, p: usize) -> &'a [[f32; PANEL]] {
        let len = packed_len(1, self.k);
        self.data[p * len..(p + 1) * len].as_chunks().0
    }

    /// The outputs `range`. Panics if `range` does not start at a panel or ends beyond `n`.
    #[inline]
    pub fn outputs(&self, range: Range<usize>) -> Self {
        assert!(range.start.is_multiple_of(PANEL) && range.start <= range.end && range.end <= self.n);
        let n = range.end - range.start;
        let first = packed_len(range.start, self.k);
        Self { data: &self.data[first..first + packed_len(n, self.k)], n, k: self.k }
    }
}

/// A bf16 weight `[n, k]` in panels of pairs.
#[derive(Clone, Copy, Debug)]
pub struct PackedBf16<'a> {
    data: &'a [Bf16],
    n: usize,
    k: usize,
}

impl<'a> PackedBf16<'a> {
    /// A view of packed data: `[panels(n), ceil(k / PAIR), PANEL, PAIR]`.
    ///
    /// # Errors
    /// [`ShapeError`] if the length of `data` is not [`packed_len_bf16`].
    pub fn new(data: &'a [Bf16], n: usize, k: usize) -> Result<Self, ShapeError> {
        expect_len("data", packed_len_bf16(n, k), data.len())?;
        Ok(Self { data, n, k })
    }

    /// Number of outputs.
    #[inline]
    pub fn n(&self) -> usize {
        self.n
    }

    /// Number of inputs.
    #[inline]
    pub fn k(&self) -> usize {
        self.k
    }

    /// Panel `p`: `[ceil(k / PAIR), PANEL, PAIR]`, a pair of all panel outputs at a time.
    #[inline]
    pub fn panel(&self, p: usize) -> &'a [[[Bf16; PAIR]; PANEL]] {
        let len = packed_len_bf16(1, self.k);
        self.data[p * len..(p + 1) * len].as_chunks().0.as_chunks().0
    }

    /// The outputs `range`. Panics if `range` does not start at a panel or ends beyond `n`.
    #[inline]
    pub fn outputs(&self, range: Range<usize>) -> Self {
        assert!(range.start.is_multiple_of(PANEL) && range.start <= range.end && range.end <= self.n);
        let n = range.end - range.start;
        let first = packed_len_bf16(range.start, self.k);
        Self { data: &self.data[first..first + packed_len_bf16(n, self.k)], n, k: self.k }
    }
}

/// An int8 weight `[n, k]` in panels of quads, with the scale and the sum of each output row.
#[derive(Clone, Copy, Debug)]
pub struct PackedI8<'a> {
    data: &'a [i8],
    scale: &'a [f32],
    sum: &'a [i32],
    n: usize,
    k: usize,
}

impl<'a> PackedI8<'a> {
    /// A view of packed data `[panels(n), ceil(k / QUAD), PANEL, QUAD]`, `scale [n]` (value
    /// of one unit of output row `o`) and `sum [n]` (sum of row `o`, the correction for
    /// inputs that are offset to unsigned).
    ///
    /// # Errors
    /// [`ShapeError`] if a length disagrees with `n` and `k`.
    pub fn new(data: &'a [i8], scale: &'a [f32], sum: &'a [i32], n: usize, k: usize) -> Result<Self, ShapeError> {
        expect_len("data", packed_len_i8(n, k), data.len())?;
        expect_len("scale", n, scale.len())?;
        expect_len("sum", n, sum.len())?;
        Ok(Self { data, scale, sum, n, k })
    }

    /// Number of outputs.
    #[inline]
    pub fn n(&self) -> usize {
        self.n
    }

    /// Number of inputs.
    #[inline]
    pub fn k(&self) -> usize {
        self.k
    }

    /// Value of one unit, per output.
    #[inline]
    pub fn scale(&self) -> &'a [f32] {
        self.scale
    }

    /// Sum of each output row.
    #[inline]
    pub fn sum(&self) -> &'a [i32] {
        self.sum
    }

    /// Panel `p`: `[ceil(k / QUAD), PANEL, QUAD]`, a quad of all panel outputs at a time.
    #[inline]
    pub fn panel(&self, p: usize) -> &'a [[i8; PANEL * QUAD]] {
        let len = PANEL * self.k.div_ceil(QUAD) * QUAD;
        self.data[p * len..(p + 1) * len].as_chunks().0
    }

    /// The outputs `range`. Panics if `range` does not start at a panel or ends beyond `n`.
    #[inline]
    pub fn outputs(&self, range: Range<usize>) -> Self {
        assert!(range.start.is_multiple_of(PANEL) && range.start <= range.end && range.end <= self.n);
        let n = range.end - range.start;
        let first = range.start * self.k.div_ceil(QUAD) * QUAD;
        Self {
            data: &self.data[first..first + packed_len_i8(n, self.k)],
            scale: &self.scale[range.clone()],
            sum: &self.sum[range],
            n,
            k: self.k,
        }
    }
}

/// An int4 weight `[n, k]` in panels: weight `[o, i]` is `scale[o] * multiplier[o, i / GROUP] *
/// code[o, i]`. The product of the two integers is an int8 value, so that a product with this weight has the
/// bits of one with a [`PackedI8`] of these values.
#[derive(Clone, Copy, Debug)]
pub struct PackedI4<'a> {
    data: &'a [u8],
    scale: &'a [f32],
    n: usize,
    k: usize,
}

impl<'a> PackedI4<'a> {
    /// A view of packed data of [`packed_len_i4`] bytes and `scale [n]` (the value of one unit of
    /// output row `o`). Multipliers must be within [`MAX_MULTIPLIER`], as [`pack_row_i4`] checks:
    /// otherwise sums overflow.
    ///
    /// # Errors
    /// [`ShapeError`] if a length disagrees with `n` and `k`.
    pub fn new(data: &'a [u8], scale: &'a [f32], n: usize, k: usize) -> Result<Self, ShapeError> {
        expect_len("data", packed_len_i4(n, k), data.len())?;
        expect_len("scale", n, scale.len())?;
        Ok(Self { data, scale, n, k })
    }

    /// Number of outputs.
    #[inline]
    pub fn n(&self) -> usize {
        self.n
    }

    /// Number of inputs.
    #[inline]
    pub fn k(&self) -> usize {
        self.k
    }

    /// Value of one unit, per output.
    #[inline]
    pub fn scale(&self) -> &'a [f32] {
        self.scale
    }

    /// Panel `p`: the blocks of its spans.
    #[inline]
    pub fn panel(&self, p: usize) -> &'a [[u8; BLOCK]] {
        let len = packed_len_i4(1, self.k);
        self.data[p * len..(p + 1) * len].as_chunks().0
    }

    /// The outputs `range`. Panics if `range` does not start at a panel or ends beyond `n`.
    #[inline]
    pub fn outputs(&self, range: Range<usize>) -> Self {
        assert!(range.start.is_multiple_of(PANEL) && range.start <= range.end && range.end <= self.n);
        let n = range.end - range.start;
        let first = packed_len_i4(range.start, self.k);
        Self { data: &self.data[first..first + packed_len_i4(n, self.k)], scale: &self.scale[range], n, k: self.k }
    }
}

/// Up to [`SPAN_GROUPS`] groups of a panel.
pub(crate) struct Span<'a> {
    /// Index of the first group.
    pub(crate) first_group: usize,
    /// Multipliers of each group, as `i8`; in the last span there may be more than groups.
    pub(crate) multipliers: &'a [[u8; PANEL]],
    /// Blocks of codes.
    pub(crate) groups: &'a [[[u8; BLOCK]; GROUP_BLOCKS]],
}

/// The spans of a panel, or of a part of it that starts at a span.
#[inline]
pub(crate) fn spans(blocks: &[[u8; BLOCK]]) -> impl Iterator<Item = Span<'_>> {
    blocks.chunks(SPAN_BLOCKS).enumerate().map(|(i, span)| {
        let (multipliers, codes) = span.split_at(1);
        Span {
            first_group: i * SPAN_GROUPS,
            multipliers: multipliers.as_flattened().as_chunks().0,
            groups: codes.as_chunks().0,
        }
    })
}

/// Packs `w [n, k]` into panels; every element of `packed` is written.
///
/// # Errors
/// [`ShapeError`] if the length of `packed` is not [`packed_len`].
pub fn pack(w: Mat<f32>, packed: &mut [f32]) -> Result<(), ShapeError> {
    expect_len("packed", packed_len(w.rows(), w.cols()), packed.len())?;
    packed.fill(0.0);
    let panel_len = packed_len(1, w.cols());
    (0..w.rows()).try_for_each(|o| pack_row(w.row(o), o % PANEL, &mut packed[o / PANEL * panel_len..][..panel_len]))
}

/// Packs one row as output `lane` of its panel `[k, PANEL]`; the other outputs are left
/// unchanged.
///
/// # Errors
/// [`ShapeError`] if `panel` is not a panel of the row's length, or `lane` is not one of its
/// outputs.
pub fn pack_row(row: &[f32], lane: usize, panel: &mut [f32]) -> Result<(), ShapeError> {
    expect_len("panel", packed_len(1, row.len()), panel.len())?;
    check_lane(lane)?;
    for (outputs, &v) in panel.as_chunks_mut::<PANEL>().0.iter_mut().zip(row) {
        outputs[lane] = v;
    }
    Ok(())
}

/// Rounds `w [n, k]` and packs it into panels of pairs; every element of `packed` is written.
///
/// # Errors
/// [`ShapeError`] if the length of `packed` is not [`packed_len_bf16`].
pub fn pack_bf16(w: Mat<f32>, packed: &mut [Bf16]) -> Result<(), ShapeError> {
    expect_len("packed", packed_len_bf16(w.rows(), w.cols()), packed.len())?;
    packed.fill(Bf16::default());
    let panel_len = packed_len_bf16(1, w.cols());
    (0..w.rows())
        .try_for_each(|o| pack_row_bf16(w.row(o), o % PANEL, &mut packed[o / PANEL * panel_len..][..panel_len]))
}

/// Rounds one row and packs it as output `lane` of its panel `[ceil(k / PAIR), PANEL, PAIR]`.
/// The other outputs, and the padding beyond `k`, are left unchanged: zeros in new memory.
///
/// # Errors
/// [`ShapeError`] if `panel` is not a panel of the row's length, or `lane` is not one of its
/// outputs.
pub fn pack_row_bf16(row: &[f32], lane: usize, panel: &mut [Bf16]) -> Result<(), ShapeError> {
    expect_len("panel", packed_len_bf16(1, row.len()), panel.len())?;
    check_lane(lane)?;
    for (outputs, values) in panel.as_chunks_mut::<{ PANEL * PAIR }>().0.iter_mut().zip(row.chunks(PAIR)) {
        for (packed, &v) in outputs[lane * PAIR..].iter_mut().zip(values) {
            *packed = Bf16::from_f32(v);
        }
    }
    Ok(())
}

/// Packs `w [n, k]` into panels of quads and sums every row; every element of `packed` and `sum` is
/// written.
///
/// # Errors
/// [`ShapeError`] if the length of `packed` is not [`packed_len_i8`], or that of `sum` not `n`.
pub fn pack_i8(w: Mat<i8>, packed: &mut [i8], sum: &mut [i32]) -> Result<(), ShapeError> {
    let (n, k) = (w.rows(), w.cols());
    expect_len("packed", packed_len_i8(n, k), packed.len())?;
    expect_len("sum", n, sum.len())?;
    packed.fill(0);
    let panel_len = packed_len_i8(1, k);
    for (o, sum) in sum.iter_mut().enumerate() {
        *sum = pack_row_i8(w.row(o), o % PANEL, &mut packed[o / PANEL * panel_len..][..panel_len])?;
    }
    Ok(())
}

/// Packs one row as output `lane` of its panel `[ceil(k / QUAD), PANEL, QUAD]` and returns the
/// row's sum. The other outputs, and the padding beyond `k`, are left unchanged: zeros in new
/// memory.
///
/// # Errors
/// [`ShapeError`] if `panel` is not a panel of the row's length, or `lane` is not one of its
/// outputs.
pub fn pack_row_i8(row: &[i8], lane: usize, panel: &mut [i8]) -> Result<i32, ShapeError> {
    expect_len("panel", packed_len_i8(1, row.len()), panel.len())?;
    check_lane(lane)?;
    let (quads, _) = panel.as_chunks_mut::<{ PANEL * QUAD }>();
    let (full, tail) = row.as_chunks::<QUAD>();
    // A quad is four contiguous bytes in both layouts: one move.
    for (outputs, quad) in quads.iter_mut().zip(full) {
        outputs.as_chunks_mut::<QUAD>().0[lane] = *quad;
    }
    if let Some(outputs) = quads.get_mut(full.len()) {
        outputs[lane * QUAD..][..tail.len()].copy_from_slice(tail);
    }
    Ok(row.iter().map(|&step| i32::from(step)).sum())
}

/// Packs the codes and the multipliers of one row as output `lane` of its panel. The other outputs
/// are left unchanged: zeros in new memory.
///
/// # Errors
/// [`ShapeError`] if a length disagrees, `lane` is not an output of a panel, a code is not in
/// [`CODES_I4`], or a multiplier is beyond [`MAX_MULTIPLIER`].
pub fn pack_row_i4(codes: &[i8], multipliers: &[i8], lane: usize, panel: &mut [u8]) -> Result<(), ShapeError> {
    let groups = codes.len().div_ceil(GROUP);
    expect_len("panel", packed_len_i4(1, codes.len()), panel.len())?;
    expect_len("multipliers", groups, multipliers.len())?;
    check_lane(lane)?;
    let is_code = |code: &i8| (CODES_I4.0..=CODES_I4.1).contains(code);
    if let Some(&code) = codes.iter().find(|code| !is_code(code)) {
        let greatest = CODES_I4.1.unsigned_abs();
        return Err(ShapeError { arg: "codes", want: greatest.into(), got: code.unsigned_abs().into() });
    }
    let is_multiplier = |m: &i8| m.unsigned_abs() <= MAX_MULTIPLIER.unsigned_abs();
    if let Some(&m) = multipliers.iter().find(|m| !is_multiplier(m)) {
        let greatest = MAX_MULTIPLIER.unsigned_abs();
        return Err(ShapeError { arg: "multipliers", want: greatest.into(), got: m.unsigned_abs().into() });
    }
    let nibble = |code: &i8| (code + NIBBLE_OFFSET).cast_unsigned();
    let spans = panel.as_chunks_mut::<BLOCK>().0.chunks_mut(SPAN_BLOCKS);
    let rows = multipliers.chunks(SPAN_GROUPS).zip(codes.chunks(SPAN_GROUPS * GROUP));
    for (span, (multipliers, codes)) in spans.zip(rows) {
        let (head, blocks) = span.split_at_mut(1);
        for (outputs, m) in head.as_flattened_mut().as_chunks_mut::<PANEL>().0.iter_mut().zip(multipliers) {
            outputs[lane] = m.cast_unsigned();
        }
        for (block, codes) in blocks.iter_mut().zip(codes.chunks(2 * QUAD)) {
            let (low, high) = codes.split_at(codes.len().min(QUAD));
            for (i, byte) in block[lane * QUAD..][..QUAD].iter_mut().enumerate() {
                *byte = low.get(i).map_or(0, nibble) | high.get(i).map_or(0, nibble) << 4;
            }
        }
    }
    Ok(())
}

fn check_lane(lane: usize) -> Result<(), ShapeError> {
    if lane < PANEL { Ok(()) } else { Err(ShapeError { arg: "lane", want: PANEL, got: lane }) }
}
