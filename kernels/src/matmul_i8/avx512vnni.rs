//! Four inputs of 16 outputs per instruction: `vpdpbusd`, which multiplies unsigned by signed bytes.
//!
//! Input rows are made unsigned (`x + 128`) in a small buffer on the stack, a tile of rows at a time; what that adds,
//! `128 * sum(w)`, is taken from the sums before they start. All of it wraps in 32 bits, so the sums are exact.

use super::QuantInput;
use crate::mat::MatMut;
use crate::matmul_f32::Epilogue;
use crate::matmul_f32::avx512vnni::{finish_row, gated_row, load};
use crate::pack::{PANEL, PackedI8, QUAD, panels};
use core::arch::x86_64::*;

/// Rows of the largest tile: 14 rows x 2 panels are 28 sums, which leaves two registers of weights and two to spare.
const ROWS: usize = 14;
/// Rows of a tile that is bound by memory, where clearing the large buffers would show.
const FEW_ROWS: usize = 4;
/// Panels in work at once: their weights stay in L2 while tiles of rows go by.
const CHUNK: usize = 16;
/// Bytes of weights that may stay in L2: half of the smallest L2 among processors with VNNI on servers.
const CHUNK_BYTES: usize = 768 << 10;
/// Quads of inputs converted at once: 14 rows are 28 KiB, in L1 beside the weights that stream through.
const QUADS: usize = 512;
/// Bytes in a register.
const BYTES: usize = 64;

/// Unsigned steps of one row, with room for a whole register behind the last.
type Steps = [[u8; QUAD]; QUADS + BYTES / QUAD];
/// Sums of one row with the panels in work.
type Sums = [[i32; PANEL]; CHUNK];

/// The panels in work, with what their sums start from and the real size of their steps.
struct Chunk<'a> {
    panels: [&'a [[i8; BYTES]]; CHUNK],
    start: [[i32; PANEL]; CHUNK],
    scale: [[f32; PANEL]; CHUNK],
    len: usize,
}

impl<'a> Chunk<'a> {
    const EMPTY: Self = Self { panels: [&[]; CHUNK], start: [[0; PANEL]; CHUNK], scale: [[0.0; PANEL]; CHUNK], len: 0 };

    fn push(&mut self, w: PackedI8<'a>, p: usize) {
        let outputs = p * PANEL..((p + 1) * PANEL).min(w.n());
        self.panels[self.len] = w.panel(p);
        for (start, sum) in self.start[self.len].iter_mut().zip(&w.sum()[outputs.clone()]) {
            *start = sum.wrapping_mul(-128);
        }
        for (scale, w_scale) in self.scale[self.len].iter_mut().zip(&w.scale()[outputs]) {
            *scale = *w_scale;
        }
        self.len += 1;
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul(x: QuantInput, w: PackedI8, end: Epilogue, y: MatMut<f32>) {
    if x.rows.rows() <= FEW_ROWS {
        product::<FEW_ROWS>(x, w, end, y);
    } else {
        product::<ROWS>(x, w, end, y);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul_gated(x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>) {
    if x.rows.rows() <= FEW_ROWS {
        product_gated::<FEW_ROWS>(x, gate, up, y);
    } else {
        product_gated::<ROWS>(x, gate, up, y);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn product<const TILE: usize>(x: QuantInput, w: PackedI8, end: Epilogue, mut y: MatMut<f32>) {
    let mut steps = [[[0; QUAD]; QUADS + BYTES / QUAD]; TILE];
    let mut sums = [[[0; PANEL]; CHUNK]; TILE];
    let width = chunk_panels(w.k());
    for first in (0..panels(w.n())).step_by(width) {
        let mut chunk = Chunk::EMPTY;
        (first..(first + width).min(panels(w.n()))).for_each(|p| chunk.push(w, p));
        for (t, rows) in tiles(x.rows.rows(), TILE) {
            tile(&x, t, &chunk, w.k(), &mut steps[..rows], &mut sums[..rows]);
            for (t, sums) in (t..).zip(&sums[..rows]) {
                let x_scale = _mm512_set1_ps(x.scale(t));
                let value = |i: usize| scaled(&sums[i], x_scale, &chunk.scale[i]);
                finish_row(value, chunk.len, t, first * PANEL, &end, &mut y);
            }
        }
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn product_gated<const TILE: usize>(x: QuantInput, gate: PackedI8, up: PackedI8, mut y: MatMut<f32>) {
    let mut steps = [[[0; QUAD]; QUADS + BYTES / QUAD]; TILE];
    let mut sums = [[[0; PANEL]; CHUNK]; TILE];
    let width = chunk_panels(gate.k()) / 2;
    for first in (0..panels(gate.n())).step_by(width) {
        let mut chunk = Chunk::EMPTY;
        for p in first..(first + width).min(panels(gate.n())) {
            chunk.push(gate, p);
            chunk.push(up, p);
        }
        for (t, rows) in tiles(x.rows.rows(), TILE) {
            tile(&x, t, &chunk, gate.k(), &mut steps[..rows], &mut sums[..rows]);
            for (t, sums) in (t..).zip(&sums[..rows]) {
                let x_scale = _mm512_set1_ps(x.scale(t));
                let gate = |i: usize| scaled(&sums[2 * i], x_scale, &chunk.scale[2 * i]);
                let up = |i: usize| scaled(&sums[2 * i + 1], x_scale, &chunk.scale[2 * i + 1]);
                gated_row(gate, up, chunk.len / 2, t, first * PANEL, &mut y);
            }
        }
    }
}

/// Panels whose weights fit [`CHUNK_BYTES`], an even number.
fn chunk_panels(k: usize) -> usize {
    (CHUNK_BYTES / (PANEL * k.max(1))).clamp(2, CHUNK) & !1
}

/// First row and number of rows of each tile: as few tiles as possible, as equal as possible.
fn tiles(rows: usize, most: usize) -> impl Iterator<Item = (usize, usize)> {
    let count = rows.div_ceil(most);
    (0..count).map(move |i| (i * rows / count, (i + 1) * rows / count - i * rows / count))
}

/// The real values of 16 sums, in scalar's order of roundings.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn scaled(sums: &[i32; PANEL], x_scale: __m512, w_scale: &[f32; PANEL]) -> __m512 {
    _mm512_mul_ps(_mm512_cvtepi32_ps(load_sums(sums)), _mm512_mul_ps(x_scale, load(w_scale)))
}

/// Exact sums of the rows from `t` on, as many as `sums` has, with every panel of the chunk.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn tile(x: &QuantInput, t: usize, chunk: &Chunk, k: usize, steps: &mut [Steps], sums: &mut [Sums]) {
    sums.fill(chunk.start);
    for first in (0..k).step_by(QUADS * QUAD) {
        let inputs = first..(first + QUADS * QUAD).min(k);
        for (t, steps) in (t..).zip(steps.iter_mut()) {
            unsigned(&x.rows.row(t)[inputs.clone()], steps);
        }
        let quads = first / QUAD..inputs.end.div_ceil(QUAD);
        match steps.len() {
            1 => block::<1, 4>(steps, chunk, quads, sums),
            2 => block::<2, 4>(steps, chunk, quads, sums),
            3 => block::<3, 4>(steps, chunk, quads, sums),
            4 => block::<4, 4>(steps, chunk, quads, sums),
            5 => block::<5, 4>(steps, chunk, quads, sums),
            6 => block::<6, 4>(steps, chunk, quads, sums),
            7 => block::<7, 2>(steps, chunk, quads, sums),
            8 => block::<8, 2>(steps, chunk, quads, sums),
            9 => block::<9, 2>(steps, chunk, quads, sums),
            10 => block::<10, 2>(steps, chunk, quads, sums),
            11 => block::<11, 2>(steps, chunk, quads, sums),
            12 => block::<12, 2>(steps, chunk, quads, sums),
            13 => block::<13, 2>(steps, chunk, quads, sums),
            ROWS => block::<ROWS, 2>(steps, chunk, quads, sums),
            rows => unreachable!("a tile of {rows} rows"),
        }
    }
}

/// `x + 128` of one row.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn unsigned(x: &[i8], steps: &mut Steps) {
    let flip = _mm512_set1_epi8(i8::MIN);
    let steps = steps.as_flattened_mut().as_chunks_mut::<BYTES>().0;
    let (x, x_tail) = x.as_chunks::<BYTES>();
    for (x, steps) in x.iter().zip(steps.iter_mut()) {
        store_bytes(steps, _mm512_xor_si512(load_bytes(x), flip));
    }
    // Whatever stands behind the last input meets weights that are zero.
    store_bytes(&mut steps[x.len()], _mm512_xor_si512(load_part(x_tail), flip));
}

/// Adds the products of `R` rows over `quads` to the sums of every panel, `P` panels at a time.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn block<const R: usize, const P: usize>(
    steps: &[Steps],
    chunk: &Chunk,
    quads: core::ops::Range<usize>,
    sums: &mut [Sums],
) {
    let steps: &[Steps; R] = steps.first_chunk().expect("`tile` chose R by the number of rows");
    let sums: &mut [Sums; R] = sums.first_chunk_mut().expect("one row of sums for each row of steps");
    let (groups, rest) = chunk.panels[..chunk.len].as_chunks::<P>();
    for (i, panels) in groups.iter().enumerate() {
        multiply::<R, P>(steps, panels.map(|panel| &panel[quads.clone()]), sums, i * P);
    }
    for (i, panel) in rest.iter().enumerate() {
        multiply::<R, 1>(steps, [&panel[quads.clone()]], sums, groups.len() * P + i);
    }
}

/// The innermost tile: `R x P` sums in registers.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn multiply<const R: usize, const P: usize>(
    steps: &[Steps; R],
    panels: [&[[i8; BYTES]]; P],
    sums: &mut [Sums; R],
    slot: usize,
) {
    let quads = panels[0].len();
    assert!(quads <= QUADS && slot + P <= CHUNK);
    let panels = panels.map(|panel| &panel[..quads]);
    let mut acc = [[_mm512_setzero_si512(); P]; R];
    for q in 0..quads {
        let w: [__m512i; P] = core::array::from_fn(|p| load_bytes(&panels[p][q]));
        for r in 0..R {
            let x = _mm512_set1_epi32(i32::from_ne_bytes(steps[r][q]));
            for p in 0..P {
                acc[r][p] = _mm512_dpbusd_epi32(acc[r][p], x, w[p]);
            }
        }
    }
    for r in 0..R {
        for p in 0..P {
            let sum = &mut sums[r][slot + p];
            store_sums(sum, _mm512_add_epi32(load_sums(sum), acc[r][p]));
        }
    }
}

#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn load_bytes(src: &[i8; BYTES]) -> __m512i {
    // SAFETY: `src` is 64 readable bytes; the load needs no alignment.
    unsafe { _mm512_loadu_si512(src.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn load_part(src: &[i8]) -> __m512i {
    assert!(src.len() < BYTES);
    // SAFETY: the mask names the bytes of `src` alone; others are not read.
    unsafe { _mm512_maskz_loadu_epi8((1 << src.len()) - 1, src.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn store_bytes(dst: &mut [u8; BYTES], v: __m512i) {
    // SAFETY: `dst` is 64 writable bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(dst.as_mut_ptr().cast(), v) }
}

#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn load_sums(src: &[i32; PANEL]) -> __m512i {
    // SAFETY: `src` is 64 readable bytes; the load needs no alignment.
    unsafe { _mm512_loadu_si512(src.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn store_sums(dst: &mut [i32; PANEL], v: __m512i) {
    // SAFETY: `dst` is 64 writable bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(dst.as_mut_ptr().cast(), v) }
}
