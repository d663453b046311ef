//! 16 x 16 outputs and 32 inputs per instruction: `tdpbf16ps`, bf16 by bf16 with f32 sums.
//!
//! Inputs are usually f32: each is split into two bf16 values, `x = hi + lo + error`, and both
//! are multiplied with the weights. The high part is the upper half of the bits of `x`, the low
//! part is the rest, rounded; the error is at most 2^-16 of `x`.
//!
//! ```text
//!   x  s eeeeeeee mmmmmmm mmmmmmmmmmmmmmmm      per step of 32 inputs, for each tile of 16 rows and each panel:
//!      '---- hi ------' '- lo, 8 bits'         sums += hi . w;  sums += lo . w
//! ```
//! Parts are written to tiles on the stack, 32 rows at a time, for all panels of a chunk. A
//! row's steps do not depend on the other rows. A few rows leave a tile partly empty, which costs
//! nothing: the product is bound by the memory traffic of its weights.
//!
//! Rows that are bf16 already, in one part or two, are loaded in place, and the
//! epilogue of a block runs while the next block is multiplied: tiles and registers work at the
//! same time.

use super::Bf16Rows;
use crate::amx::{Aligned, TILE, Tiles};
use crate::bf16::Bf16;
use crate::gemm::avx512vnni::{store_gated_tile, store_tile};
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::{Amx, entry};
use crate::lanes::avx512vnni::{load, load_part};
use crate::mat::{Mat, MatMut};
use crate::pack::{PAIR, PANEL, PackedBf16};
use crate::tiling::Tiling;
use core::arch::x86_64::*;
use umo_kernels_features::avx512bf16;

/// Rows per block.
const ROWS: usize = 2 * TILE;
/// Inputs per step: a row of a tile.
const STEP: usize = TILE * PAIR;
/// Steps of inputs split at once, for few inputs and for many.
const STEPS: [usize; 2] = [24, 64];
/// Consecutive steps of a row that are split together.
const SPLIT_STEPS: usize = 4;
/// Bytes of weights per chunk, which stays in L2 while blocks of rows pass.
const CHUNK_BYTES: usize = 768 << 10;
/// Panels of sums in one block.
const SUMS: usize = ROWS * 2;
/// Rows whose epilogue runs after as many steps of the next block.
const EPILOGUE_ROWS: usize = 2;

/// 16 rows of inputs.
type Tile = [[Bf16; STEP]; TILE];
/// The inputs of one step: high and low parts of two tiles of rows.
type Step = [[Tile; 2]; 2];
/// Pairs of weights of 16 outputs: a row of a tile.
type Pairs = [[Bf16; PAIR]; PANEL];

/// The rows of inputs of a product.
#[derive(Clone, Copy)]
enum Rows<'a> {
    /// f32 rows, to be split.
    Whole(Input<'a, f32>),
    /// bf16 rows: rounded, or high and low parts.
    Ready(Bf16Rows<'a>),
}

impl Rows<'_> {
    fn count(&self) -> usize {
        match self {
            Rows::Whole(x) => x.rows(),
            Rows::Ready(x) => x.hi.rows(),
        }
    }
}

/// Location of the parts of a block of rows: the rows of a part are `stride` elements apart, each
/// starting at its first input.
#[derive(Clone, Copy)]
struct Source<'a> {
    /// High and low parts of two tiles of rows.
    parts: [[&'a [Bf16]; 2]; 2],
    stride: usize,
    /// Elements between the inputs of consecutive steps.
    step: usize,
}

entry! {
    pub(super) fn matmul(token: Amx, _fused: bool, x: Input<f32>, w: PackedBf16, epilogue: Epilogue, y: MatMut<f32>) {
        run(token, &Rows::Whole(x), &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(token: Amx, _fused: bool, x: Input<f32>, gate: PackedBf16, up: PackedBf16, y: MatMut<f32>) {
        run(token, &Rows::Whole(x), &GemmTask::Gated(gate, up), y);
    }

    pub(super) fn matmul_rows(token: Amx, x: Bf16Rows, w: PackedBf16, epilogue: Epilogue, y: MatMut<f32>) {
        run(token, &Rows::Ready(x), &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn split_bf16x2(_token: Amx, x: &[f32], hi: &mut [Bf16], lo: &mut [Bf16]) {
        let ((x, x_tail), (hi, high_tail)) = (x.as_chunks::<STEP>(), hi.as_chunks_mut::<STEP>());
        let (lo, low_tail) = lo.as_chunks_mut::<STEP>();
        for ((x, hi), lo) in x.iter().zip(hi).zip(lo) {
            let (x, _) = x.as_chunks::<PANEL>();
            let parts = split_lanes(load(&x[0]), load(&x[1]));
            store(hi, parts[0]);
            store(lo, parts[1]);
        }
        let (front, back) = x_tail.split_at(x_tail.len().min(PANEL));
        let parts = split_lanes(load_part(front), load_part(back));
        for (dst, part) in [high_tail, low_tail].into_iter().zip(parts) {
            let mut whole = [Bf16(0); STEP];
            store(&mut whole, part);
            dst.copy_from_slice(&whole[..dst.len()]);
        }
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Amx) -> Tiling {
    Tiling {
        rows: &[TILE, ROWS],
        outputs: &[PANEL, 2 * PANEL, 4 * PANEL],
        inputs: &[PAIR, STEP, SPLIT_STEPS * STEP, STEPS[0] * STEP, STEPS[1] * STEP],
        held: 0,
        chunk: CHUNK_BYTES / size_of::<Bf16>(),
    }
}

#[avx512bf16]
fn run(token: Amx, x: &Rows, task: &GemmTask<PackedBf16>, y: MatMut<f32>) {
    let tiles = Tiles::new(token);
    match x {
        Rows::Ready(rows) if is_tile_loadable(rows) && rows.lo.is_none() => {
            product_in_place::<1>(&tiles, rows, task, y)
        }
        Rows::Ready(rows) if is_tile_loadable(rows) => product_in_place::<2>(&tiles, rows, task, y),
        Rows::Ready(Bf16Rows { lo: None, .. }) => product_from_stack::<1>(&tiles, x, task, y),
        _ => product_from_stack::<2>(&tiles, x, task, y),
    }
}

/// Whether tiles can be loaded directly from the rows: at least one tile of them, of whole
/// steps.
fn is_tile_loadable(x: &Bf16Rows) -> bool {
    let (rows, inputs) = (x.hi.rows(), x.hi.cols());
    rows >= TILE && inputs > 0 && inputs.is_multiple_of(STEP)
}

/// The product of rows that are first copied to tiles on the stack.
#[avx512bf16]
fn product_from_stack<const PARTS: usize>(tiles: &Tiles, x: &Rows, task: &GemmTask<PackedBf16>, y: MatMut<f32>) {
    if task.k() <= STEPS[0] * STEP {
        product::<{ STEPS[0] }, PARTS>(tiles, x, task, y);
    } else {
        product::<{ STEPS[1] }, PARTS>(tiles, x, task, y);
    }
}

/// Number of slots of a chunk, whose weights stay in L2 while blocks of rows pass: a multiple of the
/// panels per block.
fn chunk(task: &GemmTask<PackedBf16>) -> usize {
    (CHUNK_BYTES / (size_of::<Pairs>() * task.k().div_ceil(PAIR).max(1)) / 4).max(1) * 4
}

/// Number of panels of the next block if `left` slots are left.
fn panels(left: usize, rows: usize) -> usize {
    match left {
        4.. if rows <= TILE => 4,
        1 => 1,
        _ => 2,
    }
}

/// The product of rows loaded directly. The last block starts early enough to be complete.
#[avx512bf16]
fn product_in_place<const PARTS: usize>(tiles: &Tiles, x: &Bf16Rows, task: &GemmTask<PackedBf16>, mut y: MatMut<f32>) {
    let mut sums = Aligned([[[0.0; PANEL]; SUMS]; 2]);
    let [mut now, mut before] = sums.0.each_mut();
    let mut pending = PendingEpilogue { start: 0, slot: 0, panels: 1, done: 0, rows: 0 };
    let count = x.hi.rows();
    for first in (0..task.slots()).step_by(chunk(task)) {
        let end = (first + chunk(task)).min(task.slots());
        let mut t = 0;
        while t < count {
            let rows = if count < ROWS || count - t <= TILE { TILE } else { ROWS };
            let start = t.min(count - rows);
            let source = in_place(x, start, rows);
            let mut slot = first;
            while slot < end {
                let panels = panels(end - slot, rows);
                let advance_epilogue = || pending.rows(EPILOGUE_ROWS, task, before, &mut y);
                multiply_all::<PARTS>(
                    tiles,
                    (rows, panels),
                    source,
                    &pairs(task, slot, panels),
                    true,
                    now,
                    advance_epilogue,
                );
                pending.rows(ROWS, task, before, &mut y);
                pending = PendingEpilogue { start, slot, panels, done: t - start, rows };
                (now, before) = (before, now);
                slot += panels;
            }
            t = start + rows;
        }
    }
    pending.rows(ROWS, task, before, &mut y);
}

/// A block whose sums are complete, and the number of rows whose epilogue has run: the others run
/// while the next block is multiplied.
struct PendingEpilogue {
    /// First row in the product.
    start: usize,
    slot: usize,
    panels: usize,
    done: usize,
    rows: usize,
}

impl PendingEpilogue {
    /// Runs the epilogue of the next `count` rows, or as many as are left.
    #[inline]
    #[avx512bf16]
    fn rows(
        &mut self,
        count: usize,
        task: &GemmTask<PackedBf16>,
        sums: &mut [[f32; PANEL]; SUMS],
        y: &mut MatMut<f32>,
    ) {
        let rows = self.done..(self.done + count).min(self.rows);
        if !rows.is_empty() {
            self.done = rows.end;
            let sums = &mut sums[rows.start * self.panels..rows.end * self.panels];
            store_block(sums, task, self.start + rows.start, (self.slot, self.panels), y);
        }
    }
}

/// The product of rows copied to the stack, `MAX_STEPS` steps at a time.
#[avx512bf16]
fn product<const MAX_STEPS: usize, const PARTS: usize>(
    tiles: &Tiles,
    x: &Rows,
    task: &GemmTask<PackedBf16>,
    mut y: MatMut<f32>,
) {
    let mut buffer = Aligned([[[[[Bf16(0); STEP]; TILE]; 2]; 2]; MAX_STEPS]);
    let mut sums = Aligned([[0.0; PANEL]; SUMS]);
    for first in (0..task.slots()).step_by(chunk(task)) {
        let end = (first + chunk(task)).min(task.slots());
        for t in (0..x.count()).step_by(ROWS) {
            let rows = (x.count() - t).min(ROWS);
            fill(x, t, rows, 0, &mut buffer.0);
            let mut slot = first;
            while slot < end {
                let panels = panels(end - slot, rows);
                block::<PARTS>(tiles, x, (t, rows), &mut buffer.0, task, (slot, panels), &mut sums.0);
                store_block(&mut sums.0[..rows * panels], task, t, (slot, panels), &mut y);
                slot += panels;
            }
        }
    }
}

/// Runs the epilogue of the rows from `t` on of `panels` slots from `slot` on.
#[inline(never)]
#[avx512bf16]
fn store_block(
    sums: &mut [[f32; PANEL]],
    task: &GemmTask<PackedBf16>,
    t: usize,
    (slot, panels): (usize, usize),
    y: &mut MatMut<f32>,
) {
    match task {
        GemmTask::Plain(_, epilogue) => store_tile(sums, panels, t, slot * PANEL, epilogue, y),
        GemmTask::Gated(..) => store_gated_tile(sums, panels / 2, t, slot / 2 * PANEL, y),
    }
}

/// The pairs of `panels` slots from `slot` on, padded to four with the last one.
fn pairs<'a>(task: &GemmTask<PackedBf16<'a>>, slot: usize, panels: usize) -> [&'a [Pairs]; 4] {
    [0, 1, 2, 3].map(|p: usize| task.panel(slot + p.min(panels - 1)))
}

/// One or two tiles of rows from `t` on, loaded directly.
fn in_place<'a>(x: &Bf16Rows<'a>, t: usize, rows: usize) -> Source<'a> {
    let part = |part: &Mat<'a, Bf16>| [t, t + rows - TILE].map(|t| part.row_range(t..t + TILE).elements());
    let parts = [part(&x.hi), x.lo.as_ref().map_or([&[]; 2], part)];
    Source { parts, stride: x.hi.stride(), step: STEP }
}

/// Fills `buffer` with the inputs from `first` on of the rows from `t` on, in two parts each,
/// padded with zeros: old contents would be multiplied by zero weights, and the product of
/// infinity and zero is NaN.
#[avx512bf16]
fn fill(x: &Rows, t: usize, rows: usize, first: usize, buffer: &mut [Step]) {
    // Rows of consecutive steps are 4 KiB apart, in one set of L1, which a few steps at a time do
    // not exceed.
    for (i, steps) in buffer.chunks_mut(SPLIT_STEPS).enumerate() {
        for r in 0..rows {
            let first = first + i * SPLIT_STEPS * STEP;
            match x {
                Rows::Whole(x) => split_row(rest(x.row(t + r), first), r, steps),
                Rows::Ready(x) => {
                    copy_row(rest(x.hi.row(t + r), first), r, 0, steps);
                    if let Some(lo) = &x.lo {
                        copy_row(rest(lo.row(t + r), first), r, 1, steps);
                    }
                }
            }
        }
    }
}

/// The elements from `first` on; empty if the row is shorter.
fn rest<T>(row: &[T], first: usize) -> &[T] {
    &row[first.min(row.len())..]
}

/// Splits as many inputs of row `r` as `steps` holds.
#[avx512bf16]
fn split_row(x: &[f32], r: usize, steps: &mut [Step]) {
    let (whole, part) = x.as_chunks::<STEP>();
    for (step, values) in steps.iter_mut().zip(whole) {
        let (values, _) = values.as_chunks::<PANEL>();
        let [hi, lo] = split_lanes(load(&values[0]), load(&values[1]));
        store(&mut step[0][r / TILE][r % TILE], hi);
        store(&mut step[1][r / TILE][r % TILE], lo);
    }
    if let Some(step) = steps.get_mut(whole.len()).filter(|_| !part.is_empty()) {
        let (front, back) = part.split_at(part.len().min(PANEL));
        let [hi, lo] = split_lanes(load_part(front), load_part(back));
        store(&mut step[0][r / TILE][r % TILE], hi);
        store(&mut step[1][r / TILE][r % TILE], lo);
    }
}

/// Copies as many inputs of one part of row `r` as `steps` holds.
#[avx512bf16]
fn copy_row(x: &[Bf16], r: usize, which: usize, steps: &mut [Step]) {
    let (whole, part) = x.as_chunks::<STEP>();
    for (step, values) in steps.iter_mut().zip(whole) {
        step[which][r / TILE][r % TILE] = *values;
    }
    if let Some(step) = steps.get_mut(whole.len()).filter(|_| !part.is_empty()) {
        let row = &mut step[which][r / TILE][r % TILE];
        row.fill(Bf16(0));
        row[..part.len()].copy_from_slice(part);
    }
}

/// High and low parts of 32 inputs. The low part of an infinity is zero, that of a NaN is NaN.
#[inline]
#[avx512bf16]
fn split_lanes(front: __m512, back: __m512) -> [__m512i; 2] {
    const INFINITE: i32 = 0x18;
    let upper = _mm512_set1_epi32(-1 << 16);
    let hi = |x| _mm512_castsi512_ps(_mm512_and_si512(_mm512_castps_si512(x), upper));
    let lo = |x| _mm512_maskz_sub_ps(!_mm512_fpclass_ps_mask::<INFINITE>(x), x, hi(x));
    // The upper words of the first register and of the second.
    let odd = _mm512_set_epi16(
        63, 61, 59, 57, 55, 53, 51, 49, 47, 45, 43, 41, 39, 37, 35, 33, 31, 29, 27, 25, 23, 21, 19, 17, 15, 13, 11, 9,
        7, 5, 3, 1,
    );
    let words = _mm512_permutex2var_epi16(_mm512_castps_si512(front), odd, _mm512_castps_si512(back));
    let rounded = _mm512_cvtne2ps_pbh(lo(back), lo(front));
    // SAFETY: both are 64 bytes of 32 words, and any bits are valid for both.
    [words, unsafe { core::mem::transmute::<__m512bh, __m512i>(rounded) }]
}

/// Computes the sums of `rows` rows from `t` on with `panels` slots from `slot` on, over all inputs: `sums
/// [rows, panels]`.
#[avx512bf16]
fn block<const PARTS: usize>(
    tiles: &Tiles,
    x: &Rows,
    (t, rows): (usize, usize),
    buffer: &mut [Step],
    task: &GemmTask<PackedBf16>,
    (slot, panels): (usize, usize),
    sums: &mut [[f32; PANEL]; SUMS],
) {
    let pairs = pairs(task, slot, panels);
    let blocks = pairs[0].len().div_ceil(buffer.len() * TILE).max(1);
    for i in 0..blocks {
        if blocks > 1 {
            fill(x, t, rows, i * buffer.len() * STEP, buffer);
        }
        let part = i * buffer.len() * TILE..((i + 1) * buffer.len() * TILE).min(pairs[0].len());
        let mut pairs = pairs;
        for pairs in &mut pairs {
            *pairs = &pairs[part.clone()];
        }
        let flat = buffer.as_flattened().as_flattened().as_flattened().as_flattened();
        let tile = |i: usize| &flat[i * STEP * TILE..];
        let source = Source { parts: [[tile(0), tile(1)], [tile(2), tile(3)]], stride: STEP, step: 4 * STEP * TILE };
        multiply_all::<PARTS>(tiles, (rows, panels), source, &pairs, i == 0, sums, || {});
    }
}

#[avx512bf16]
fn multiply_all<const PARTS: usize>(
    tiles: &Tiles,
    (rows, panels): (usize, usize),
    source: Source,
    pairs: &[&[Pairs]; 4],
    start: bool,
    sums: &mut [[f32; PANEL]; SUMS],
    between: impl FnMut(),
) {
    match (rows <= TILE, panels) {
        (true, 4) => multiply::<1, 4, PARTS>(tiles, source, pairs, start, sums, between),
        (true, 2) => multiply::<1, 2, PARTS>(tiles, source, pairs, start, sums, between),
        (true, _) => multiply::<1, 1, PARTS>(tiles, source, pairs, start, sums, between),
        (false, 2) => multiply::<2, 2, PARTS>(tiles, source, pairs, start, sums, between),
        (false, _) => multiply::<2, 1, PARTS>(tiles, source, pairs, start, sums, between),
    }
}

/// Adds the products of `R` tiles of rows with the pairs of `P` panels to `sums [rows, P]`, or
/// starts the sums; calls `between` every [`EPILOGUE_ROWS`] steps.
#[avx512bf16]
fn multiply<const R: usize, const P: usize, const PARTS: usize>(
    tiles: &Tiles,
    source: Source,
    pairs: &[&[Pairs]; 4],
    start: bool,
    sums: &mut [[f32; PANEL]; SUMS],
    mut between: impl FnMut(),
) {
    if start {
        tiles.zero();
    } else {
        tiles.load_sums::<R, P>(sums);
    }
    let [first, second, third, fourth] = *pairs;
    let ((first, rest), (second, _)) = (first.as_chunks::<TILE>(), second.as_chunks::<TILE>());
    let ((third, _), (fourth, _)) = (third.as_chunks::<TILE>(), fourth.as_chunks::<TILE>());
    let (steps, rest) = (first.len(), rest.len());
    for i in 0..steps {
        step::<R, P, PARTS>(tiles, &source, i, [&first[i], &second[i], &third[i], &fourth[i]]);
        if i % EPILOGUE_ROWS == EPILOGUE_ROWS - 1 {
            between();
        }
    }
    if rest > 0 {
        let mut last = Aligned([[[[Bf16(0); PAIR]; PANEL]; TILE]; 4]);
        for (last, pairs) in last.0.iter_mut().zip(pairs).take(P) {
            last[..rest].copy_from_slice(&pairs[steps * TILE..]);
        }
        step::<R, P, PARTS>(tiles, &source, steps, last.0.each_ref());
    }
    tiles.store_sums::<R, P>(sums);
}

/// 32 inputs of `R` tiles of rows with `P` panels; in every sum the high parts are added first.
#[inline]
fn step<const R: usize, const P: usize, const PARTS: usize>(
    tiles: &Tiles,
    source: &Source,
    i: usize,
    w: [&[Pairs; TILE]; 4],
) {
    let [hi, lo] = &source.parts;
    let (at, stride) = (i * source.step, source.stride);
    if R == 1 {
        tiles.load_rows::<4, _>(&hi[0][at..], stride);
        if PARTS > 1 {
            tiles.load_rows::<5, _>(&lo[0][at..], stride);
        }
        tiles.load::<6, _>(w[0]);
        tiles.multiply_bf16::<0, 4, 6>();
        if P > 1 {
            tiles.load::<7, _>(w[1]);
            tiles.multiply_bf16::<1, 4, 7>();
        }
        if PARTS > 1 {
            tiles.multiply_bf16::<0, 5, 6>();
        }
        if P > 2 {
            tiles.load::<6, _>(w[2]);
            tiles.multiply_bf16::<2, 4, 6>();
        }
        if P > 1 && PARTS > 1 {
            tiles.multiply_bf16::<1, 5, 7>();
        }
        if P > 2 {
            tiles.load::<7, _>(w[3]);
            tiles.multiply_bf16::<3, 4, 7>();
        }
        if P > 2 && PARTS > 1 {
            tiles.multiply_bf16::<2, 5, 6>();
            tiles.multiply_bf16::<3, 5, 7>();
        }
    } else {
        tiles.load::<6, _>(w[0]);
        if P > 1 {
            tiles.load::<7, _>(w[1]);
        }
        for part in [hi, lo].into_iter().take(PARTS) {
            tiles.load_rows::<4, _>(&part[0][at..], stride);
            tiles.load_rows::<5, _>(&part[1][at..], stride);
            tiles.multiply_bf16::<0, 4, 6>();
            tiles.multiply_bf16::<2, 5, 6>();
            if P > 1 {
                tiles.multiply_bf16::<1, 4, 7>();
                tiles.multiply_bf16::<3, 5, 7>();
            }
        }
    }
}

#[inline]
#[avx512bf16]
fn store(dst: &mut [Bf16; STEP], v: __m512i) {
    // SAFETY: `dst` is 64 writable bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(dst.as_mut_ptr().cast(), v) }
}
