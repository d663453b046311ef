//! 16 x 16 outputs and 32 inputs per instruction: `tdpbf16ps`, bf16 by bf16 with f32 sums.
//!
//! Inputs are f32: each is cut into two of bf16, `x = high + low + rest`, and both are multiplied with the weights. The high
//! part is the upper half of `x` as it stands, the low part what that leaves, rounded; so `rest` is at most 2^-16 of `x`.
//!
//! ```text
//!   x  s eeeeeeee mmmmmmm mmmmmmmmmmmmmmmm      per step of 32 inputs, for each tile of 16 rows and each panel:
//!      '---- high ------' '- low, 8 bits'       sums += high . w;  sums += low . w
//! ```
//! Parts are made in tiles on the stack, 32 rows at a time, for all panels of a chunk. A row goes through the same steps
//! whichever rows are beside it: few rows leave a tile empty, and weights arrive from memory no sooner for that.

use super::SplitRows;
use crate::amx::{Aligned, TILE, Tiles};
use crate::bf16::Bf16;
use crate::mat::{Mat, MatMut};
use crate::matmul_f32::avx512vnni::{finish, finish_gated, load, load_part};
use crate::matmul_f32::{Epilogue, Input, Job};
use crate::pack::{PAIR, PANEL, PackedBf16};
use core::arch::x86_64::*;

/// Rows of inputs in work.
const ROWS: usize = 2 * TILE;
/// Inputs of one step: a row of a tile.
const STEP: usize = TILE * PAIR;
/// Steps of inputs cut at once, where there are few inputs and where there are many.
const STEPS: [usize; 2] = [24, 64];
/// Steps of a row that are cut one after the other.
const NEAR: usize = 4;
/// Bytes of weights in work at once, which stay in L2 while blocks of rows go by.
const CHUNK_BYTES: usize = 768 << 10;
/// Panels of sums in one block.
const SUMS: usize = ROWS * 2;

/// 16 rows of inputs.
type Tile = [[Bf16; STEP]; TILE];
/// The inputs of one step: high and low parts of two tiles of rows.
type Step = [[Tile; 2]; 2];
/// Pairs of weights of 16 outputs: a row of a tile.
type Pairs = [[Bf16; PAIR]; PANEL];

/// Rows of inputs, as they come to a product.
#[derive(Clone, Copy)]
enum Rows<'a> {
    /// To be cut.
    Whole(Input<'a, f32>),
    /// High and low parts.
    Cut(SplitRows<'a>),
}

impl Rows<'_> {
    fn count(&self) -> usize {
        match self {
            Rows::Whole(x) => x.rows(),
            Rows::Cut(x) => x.high.rows(),
        }
    }
}

/// Where the parts of a block of rows lie: those of a part `stride` elements apart, each from its first input.
#[derive(Clone, Copy)]
struct Source<'a> {
    /// High and low parts of two tiles of rows.
    parts: [[&'a [Bf16]; 2]; 2],
    stride: usize,
    /// Elements from the inputs of one step to those of the next.
    step: usize,
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
pub(super) fn matmul(x: Input<f32>, w: PackedBf16, end: Epilogue, y: MatMut<f32>) {
    run(&Rows::Whole(x), &Job::Plain(w, end), y);
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
pub(super) fn matmul_gated(x: Input<f32>, gate: PackedBf16, up: PackedBf16, y: MatMut<f32>) {
    run(&Rows::Whole(x), &Job::Gated(gate, up), y);
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
pub(super) fn matmul_split(x: SplitRows, w: PackedBf16, end: Epilogue, y: MatMut<f32>) {
    run(&Rows::Cut(x), &Job::Plain(w, end), y);
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
pub(super) fn split(x: &[f32], high: &mut [Bf16], low: &mut [Bf16]) {
    let ((x, x_tail), (high, high_tail)) = (x.as_chunks::<STEP>(), high.as_chunks_mut::<STEP>());
    let (low, low_tail) = low.as_chunks_mut::<STEP>();
    for ((x, high), low) in x.iter().zip(high).zip(low) {
        let (x, _) = x.as_chunks::<PANEL>();
        let parts = cut(load(&x[0]), load(&x[1]));
        store(high, parts[0]);
        store(low, parts[1]);
    }
    let (front, back) = x_tail.split_at(x_tail.len().min(PANEL));
    let parts = cut(load_part(front), load_part(back));
    for (dst, part) in [high_tail, low_tail].into_iter().zip(parts) {
        let mut whole = [Bf16(0); STEP];
        store(&mut whole, part);
        dst.copy_from_slice(&whole[..dst.len()]);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
fn run(x: &Rows, job: &Job<PackedBf16>, y: MatMut<f32>) {
    // SAFETY: only the `Amx` arm of the products leads here.
    let tiles = unsafe { Tiles::new() };
    if job.k() <= STEPS[0] * STEP {
        product::<{ STEPS[0] }>(&tiles, x, job, y);
    } else {
        product::<{ STEPS[1] }>(&tiles, x, job, y);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
fn product<const MOST: usize>(tiles: &Tiles, x: &Rows, job: &Job<PackedBf16>, mut y: MatMut<f32>) {
    let mut buffer = Aligned([[[[[Bf16(0); STEP]; TILE]; 2]; 2]; MOST]);
    let mut sums = Aligned([[0.0; PANEL]; SUMS]);
    // A multiple of the panels that any block takes at once.
    let width = (CHUNK_BYTES / (size_of::<Pairs>() * job.k().div_ceil(PAIR).max(1)) / 4).max(1) * 4;
    for first in (0..job.slots()).step_by(width) {
        let end = (first + width).min(job.slots());
        for t in (0..x.count()).step_by(ROWS) {
            let rows = (x.count() - t).min(ROWS);
            let in_place = in_place(x, t, rows);
            if in_place.is_none() {
                fill(x, t, rows, 0, &mut buffer.0);
            }
            let mut slot = first;
            while slot < end {
                let panels = match end - slot {
                    4.. if rows <= TILE => 4,
                    1 => 1,
                    _ => 2,
                };
                block(tiles, x, (t, rows), in_place, &mut buffer.0, job, (slot, panels), &mut sums.0);
                let sums = &mut sums.0[..rows * panels];
                match job {
                    Job::Plain(_, end) => finish(sums, panels, t, slot * PANEL, end, &mut y),
                    Job::Gated(..) => finish_gated(sums, panels / 2, t, slot / 2 * PANEL, &mut y),
                }
                slot += panels;
            }
        }
    }
}

/// The rows from `t` on where they lie, if tiles can read them there: all of them cut, and whole steps.
fn in_place<'a>(x: &Rows<'a>, t: usize, rows: usize) -> Option<Source<'a>> {
    let Rows::Cut(x) = x else { return None };
    if rows < ROWS || !x.high.cols().is_multiple_of(STEP) {
        return None;
    }
    let part = |part: &Mat<'a, Bf16>| [t, t + TILE].map(|t| part.row_range(t..t + TILE).elements());
    Some(Source { parts: [part(&x.high), part(&x.low)], stride: x.high.stride(), step: STEP })
}

/// The inputs from `first` on of the rows from `t` on, in two parts each, as many steps as `buffer` holds; zeros behind the
/// last of them, because whatever stood there would meet weights of zero, and infinities have no such product.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
fn fill(x: &Rows, t: usize, rows: usize, first: usize, buffer: &mut [Step]) {
    // Rows are stored 4 KiB apart from step to step, which is one set of L1: few steps at a time, so that they stay there.
    for (i, steps) in buffer.chunks_mut(NEAR).enumerate() {
        for r in 0..rows {
            let first = first + i * NEAR * STEP;
            match x {
                Rows::Whole(x) => cut_row(rest(x.row(t + r), first), r, steps),
                Rows::Cut(x) => {
                    copy_row(rest(x.high.row(t + r), first), r, 0, steps);
                    copy_row(rest(x.low.row(t + r), first), r, 1, steps);
                }
            }
        }
    }
}

/// What stands from `first` on, nothing where the row ends before.
fn rest<T>(row: &[T], first: usize) -> &[T] {
    &row[first.min(row.len())..]
}

/// Cuts as many inputs of row `r` as `steps` holds.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
fn cut_row(x: &[f32], r: usize, steps: &mut [Step]) {
    let (whole, part) = x.as_chunks::<STEP>();
    for (step, values) in steps.iter_mut().zip(whole) {
        let (values, _) = values.as_chunks::<PANEL>();
        let [high, low] = cut(load(&values[0]), load(&values[1]));
        store(&mut step[0][r / TILE][r % TILE], high);
        store(&mut step[1][r / TILE][r % TILE], low);
    }
    if let Some(step) = steps.get_mut(whole.len()).filter(|_| !part.is_empty()) {
        let (front, back) = part.split_at(part.len().min(PANEL));
        let [high, low] = cut(load_part(front), load_part(back));
        store(&mut step[0][r / TILE][r % TILE], high);
        store(&mut step[1][r / TILE][r % TILE], low);
    }
}

/// Copies as many inputs of one part of row `r` as `steps` holds.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
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

/// High and low parts of 32 inputs. What is infinite has nothing left, and what is no number remains so in its low part.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
fn cut(front: __m512, back: __m512) -> [__m512i; 2] {
    const INFINITE: i32 = 0x18;
    let upper = _mm512_set1_epi32(-1 << 16);
    let high = |x| _mm512_castsi512_ps(_mm512_and_si512(_mm512_castps_si512(x), upper));
    let low = |x| _mm512_maskz_sub_ps(!_mm512_fpclass_ps_mask::<INFINITE>(x), x, high(x));
    // The upper words, of the first register and of the second.
    let odd = _mm512_set_epi16(
        63, 61, 59, 57, 55, 53, 51, 49, 47, 45, 43, 41, 39, 37, 35, 33, 31, 29, 27, 25, 23, 21, 19, 17, 15, 13, 11, 9,
        7, 5, 3, 1,
    );
    let words = _mm512_permutex2var_epi16(_mm512_castps_si512(front), odd, _mm512_castps_si512(back));
    let rounded = _mm512_cvtne2ps_pbh(low(back), low(front));
    // SAFETY: both are 64 bytes of 32 words, and any bits are a value of either.
    [words, unsafe { core::mem::transmute::<__m512bh, __m512i>(rounded) }]
}

/// The sums of `rows` rows from `t` on with `panels` slots from `slot` on, over all inputs: `sums [rows, panels]`.
#[expect(clippy::too_many_arguments, reason = "one block of a product, each operand named")]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
fn block(
    tiles: &Tiles,
    x: &Rows,
    (t, rows): (usize, usize),
    in_place: Option<Source>,
    buffer: &mut [Step],
    job: &Job<PackedBf16>,
    (slot, panels): (usize, usize),
    sums: &mut [[f32; PANEL]; SUMS],
) {
    // Not by `from_fn`: a closure has this function's features and cannot be inlined into one that has not.
    let mut pairs = [&[][..]; 4];
    for (p, pairs) in pairs.iter_mut().enumerate() {
        *pairs = job.panel(slot + p.min(panels - 1));
    }
    if let Some(source) = in_place {
        return multiply_all(tiles, rows, panels, source, &pairs, true, sums);
    }
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
        multiply_all(tiles, rows, panels, source, &pairs, i == 0, sums);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
fn multiply_all(
    tiles: &Tiles,
    rows: usize,
    panels: usize,
    source: Source,
    pairs: &[&[Pairs]; 4],
    start: bool,
    sums: &mut [[f32; PANEL]; SUMS],
) {
    match (rows <= TILE, panels) {
        (true, 4) => multiply::<1, 4>(tiles, source, pairs, start, sums),
        (true, 2) => multiply::<1, 2>(tiles, source, pairs, start, sums),
        (true, _) => multiply::<1, 1>(tiles, source, pairs, start, sums),
        (false, 2) => multiply::<2, 2>(tiles, source, pairs, start, sums),
        (false, _) => multiply::<2, 1>(tiles, source, pairs, start, sums),
    }
}

/// Adds the products of `R` tiles of rows with the pairs of `P` panels to `sums [rows, P]`, or starts them.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
fn multiply<const R: usize, const P: usize>(
    tiles: &Tiles,
    source: Source,
    pairs: &[&[Pairs]; 4],
    start: bool,
    sums: &mut [[f32; PANEL]; SUMS],
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
        step::<R, P>(tiles, &source, i, [&first[i], &second[i], &third[i], &fourth[i]]);
    }
    if rest > 0 {
        let mut last = Aligned([[[[Bf16(0); PAIR]; PANEL]; TILE]; 4]);
        for (last, pairs) in last.0.iter_mut().zip(pairs).take(P) {
            last[..rest].copy_from_slice(&pairs[steps * TILE..]);
        }
        step::<R, P>(tiles, &source, steps, last.0.each_ref());
    }
    tiles.store_sums::<R, P>(sums);
}

/// 32 inputs of `R` tiles of rows with `P` panels; in every sum the high parts come first.
#[inline]
fn step<const R: usize, const P: usize>(tiles: &Tiles, source: &Source, i: usize, w: [&[Pairs; TILE]; 4]) {
    let [high, low] = &source.parts;
    let (at, stride) = (i * source.step, source.stride);
    if R == 1 {
        tiles.load_rows::<4, _>(&high[0][at..], stride);
        tiles.load_rows::<5, _>(&low[0][at..], stride);
        tiles.load::<6, _>(w[0]);
        tiles.multiply_bf16::<0, 4, 6>();
        if P > 1 {
            tiles.load::<7, _>(w[1]);
            tiles.multiply_bf16::<1, 4, 7>();
        }
        tiles.multiply_bf16::<0, 5, 6>();
        if P > 2 {
            tiles.load::<6, _>(w[2]);
            tiles.multiply_bf16::<2, 4, 6>();
        }
        if P > 1 {
            tiles.multiply_bf16::<1, 5, 7>();
        }
        if P > 2 {
            tiles.load::<7, _>(w[3]);
            tiles.multiply_bf16::<3, 4, 7>();
            tiles.multiply_bf16::<2, 5, 6>();
            tiles.multiply_bf16::<3, 5, 7>();
        }
    } else {
        tiles.load::<6, _>(w[0]);
        if P > 1 {
            tiles.load::<7, _>(w[1]);
        }
        for part in [high, low] {
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
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16")]
fn store(dst: &mut [Bf16; STEP], v: __m512i) {
    // SAFETY: `dst` is 64 writable bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(dst.as_mut_ptr().cast(), v) }
}
