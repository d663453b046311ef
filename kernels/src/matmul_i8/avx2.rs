//! Bytes widened to 16 bits and multiplied in pairs: `vpmaddwd`, which is exact. (`vpmaddubsw` would take twice as many
//! at once, but saturates.)
//!
//! ```text
//! a quad of a panel    o0 o0 o0 o0 o1 o1 o1 o1 o2 .. o3     16 bytes, widened: one register
//! times inputs          0  1  2  3  0  1  2  3  0 ..  3     the same four in every output
//! adds up to             o0    o0    o1    o1   ..   o3     two sums per output, added at the end
//! ```

use super::QuantInput;
use crate::mat::MatMut;
use crate::matmul_f32::avx2::{self as float, load, store};
use crate::matmul_f32::{Epilogue, tiles};
use crate::pack::{PANEL, PackedI8, QUAD, panels};
use crate::prefetch;
use core::arch::x86_64::*;

/// Rows of the largest tile: 6 rows x 2 registers of sums leave four, for two of weights, an input and a product.
const ROWS: usize = 6;
/// Quads of inputs converted at once: 6 rows are 24 KiB, in L1 beside the weights that stream through.
const QUADS: usize = 512;
/// Quads between a multiplication and the prefetch of its weights from L2.
const AHEAD: usize = 16;
/// Outputs whose quads fill a register once widened.
const OUTPUTS: usize = 4;
/// Registers of a panel.
const REGISTERS: usize = PANEL / OUTPUTS;
/// Panels whose weights stay in the cache while tiles of rows go by.
const CHUNK: usize = 16;
/// Panels of one output tile: a gate and an up panel.
const MOST: usize = 2;

/// Inputs of one row, widened; the extra quads keep rows off each other's cache sets.
type Steps = [[i16; QUAD]; QUADS + 8];

#[target_feature(enable = "avx2,fma")]
pub(super) fn matmul(x: QuantInput, w: PackedI8, end: Epilogue, y: MatMut<f32>) {
    run(&x, &[w], Some(end), y);
}

#[target_feature(enable = "avx2,fma")]
pub(super) fn matmul_gated(x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>) {
    run(&x, &[gate, up], None, y);
}

/// One weight with its end, or a gate and an up weight without one.
#[target_feature(enable = "avx2,fma")]
fn run(x: &QuantInput, weights: &[PackedI8], end: Option<Epilogue>, mut y: MatMut<f32>) {
    let mut steps = [[[0; QUAD]; QUADS + 8]; ROWS];
    for first in (0..panels(weights[0].n())).step_by(CHUNK) {
        let chunk = first..(first + CHUNK).min(panels(weights[0].n()));
        for (t, rows) in tiles(x.rows.rows(), ROWS) {
            let steps = &mut steps[..rows];
            convert(x, t, 0, steps);
            for p in chunk.clone() {
                let mut sums = [[0; PANEL]; ROWS * MOST];
                let sums = &mut sums[..rows * weights.len()];
                for (i, w) in weights.iter().enumerate() {
                    panel(x, t, steps, w, p, sums[i..].iter_mut().step_by(weights.len()));
                }
                finish(x, t, sums, weights, p, end.as_ref(), &mut y);
            }
        }
    }
}

/// The inputs from `first` on of the rows from `t` on, widened, as many of both as `steps` holds.
#[target_feature(enable = "avx2,fma")]
fn convert(x: &QuantInput, t: usize, first: usize, steps: &mut [Steps]) {
    let inputs = first..(first + QUADS * QUAD).min(x.rows.cols());
    for (t, steps) in (t..).zip(steps.iter_mut()) {
        let (wide, _) = steps.as_flattened_mut().as_chunks_mut::<16>();
        let (x, x_tail) = x.rows.row(t)[inputs.clone()].as_chunks::<16>();
        for (x, wide) in x.iter().zip(wide.iter_mut()) {
            store_words(wide, widen(x));
        }
        // Whatever stands behind the last input meets weights that are zero.
        for (x, wide) in x_tail.iter().zip(&mut wide[x.len()]) {
            *wide = i16::from(*x);
        }
    }
}

/// Exact sums of the rows from `t` on with panel `p` of one weight.
#[target_feature(enable = "avx2,fma")]
fn panel<'s>(
    x: &QuantInput,
    t: usize,
    steps: &mut [Steps],
    w: &PackedI8,
    p: usize,
    sums: impl Iterator<Item = &'s mut [i32; PANEL]>,
) {
    let mut partial = [[[0; 8]; REGISTERS]; ROWS];
    let partial = &mut partial[..steps.len()];
    let k = w.k();
    for first in (0..k).step_by(QUADS * QUAD) {
        if k > QUADS * QUAD {
            convert(x, t, first, steps);
        }
        let quads = &w.panel(p)[first / QUAD..(first / QUAD + QUADS).min(k.div_ceil(QUAD))];
        match steps.len() {
            1 => multiply::<1, 4>(steps, quads, partial),
            2 => multiply::<2, 4>(steps, quads, partial),
            3 => multiply::<3, 2>(steps, quads, partial),
            4 => multiply::<4, 2>(steps, quads, partial),
            5 => multiply::<5, 2>(steps, quads, partial),
            ROWS => multiply::<ROWS, 2>(steps, quads, partial),
            rows => unreachable!("a tile of {rows} rows"),
        }
    }
    for (partial, sums) in partial.iter().zip(sums) {
        let (halves, _) = sums.as_chunks_mut::<8>();
        store_sums(&mut halves[0], add_pairs(load_sums(&partial[0]), load_sums(&partial[1])));
        store_sums(&mut halves[1], add_pairs(load_sums(&partial[2]), load_sums(&partial[3])));
    }
}

/// The innermost tile: `R` rows with `H` registers of the panel at a time.
#[target_feature(enable = "avx2,fma")]
fn multiply<const R: usize, const H: usize>(
    steps: &[Steps],
    quads: &[[i8; PANEL * QUAD]],
    partial: &mut [[[i32; 8]; REGISTERS]],
) {
    let steps: &[Steps; R] = steps.first_chunk().expect("R is the number of rows");
    let partial: &mut [_; R] = partial.first_chunk_mut().expect("one row of sums for each row of steps");
    assert!(quads.len() <= QUADS);
    for first in (0..REGISTERS).step_by(H) {
        let mut acc = [[_mm256_setzero_si256(); H]; R];
        for (q, quad) in quads.iter().enumerate() {
            let (outputs, _) = quad.as_chunks::<16>();
            prefetch::near(quads.as_ptr().wrapping_add(q + AHEAD));
            let mut w = [_mm256_setzero_si256(); H];
            for h in 0..H {
                w[h] = widen(&outputs[first + h]);
            }
            for r in 0..R {
                let x = _mm256_set1_epi64x(quad_bits(steps[r][q]));
                for h in 0..H {
                    acc[r][h] = _mm256_add_epi32(acc[r][h], _mm256_madd_epi16(w[h], x));
                }
            }
        }
        for r in 0..R {
            for h in 0..H {
                let sum = &mut partial[r][first + h];
                store_sums(sum, _mm256_add_epi32(load_sums(sum), acc[r][h]));
            }
        }
    }
}

/// Four inputs as one number.
#[inline]
fn quad_bits(x: [i16; QUAD]) -> i64 {
    x.iter().rev().fold(0, |bits, &x| bits << 16 | i64::from(x.cast_unsigned()))
}

/// The sums of 8 outputs from the two of each that stand side by side.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn add_pairs(low: __m256i, high: __m256i) -> __m256i {
    // Outputs 0 1 4 5 | 2 3 6 7: the addition works on halves.
    _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_hadd_epi32(low, high))
}

/// Ends the sums `[rows, weights]` of the rows from `t` on with panel `p`.
#[target_feature(enable = "avx2,fma")]
fn finish(
    x: &QuantInput,
    t: usize,
    sums: &[[i32; PANEL]],
    weights: &[PackedI8],
    p: usize,
    end: Option<&Epilogue>,
    y: &mut MatMut<f32>,
) {
    let mut w_scale = [[0.0; PANEL]; MOST];
    for (w_scale, w) in w_scale.iter_mut().zip(weights) {
        let w = &w.scale()[p * PANEL..((p + 1) * PANEL).min(w.n())];
        w_scale[..w.len()].copy_from_slice(w);
    }
    let mut values = [[0.0; PANEL]; ROWS * MOST];
    let values = &mut values[..sums.len()];
    let rows = values.chunks_exact_mut(weights.len()).zip(sums.chunks_exact(weights.len()));
    for (t, (values, sums)) in (t..).zip(rows) {
        let x_scale = _mm256_set1_ps(x.scale(t));
        for ((v, sums), w_scale) in values.iter_mut().zip(sums).zip(&w_scale) {
            let (halves, _) = sums.as_chunks::<8>();
            let [low, high] = load(w_scale);
            // The exact sum rounded to f32 once, then scalar's order of roundings.
            let low = _mm256_mul_ps(_mm256_cvtepi32_ps(load_sums(&halves[0])), _mm256_mul_ps(x_scale, low));
            let high = _mm256_mul_ps(_mm256_cvtepi32_ps(load_sums(&halves[1])), _mm256_mul_ps(x_scale, high));
            store(v, [low, high]);
        }
    }
    match end {
        Some(end) => float::finish(values, 1, t, p * PANEL, end, y),
        None => float::finish_gated(values, 1, t, p * PANEL, y),
    }
}

/// 16 bytes as 16 words.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn widen(src: &[i8; 16]) -> __m256i {
    // SAFETY: `src` is 16 readable bytes; the load needs no alignment.
    _mm256_cvtepi8_epi16(unsafe { _mm_loadu_si128(src.as_ptr().cast()) })
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn store_words(dst: &mut [i16; 16], v: __m256i) {
    // SAFETY: `dst` is 32 writable bytes; the store needs no alignment.
    unsafe { _mm256_storeu_si256(dst.as_mut_ptr().cast(), v) }
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn load_sums(src: &[i32; 8]) -> __m256i {
    // SAFETY: `src` is 32 readable bytes; the load needs no alignment.
    unsafe { _mm256_loadu_si256(src.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn store_sums(dst: &mut [i32; 8], v: __m256i) {
    // SAFETY: `dst` is 32 writable bytes; the store needs no alignment.
    unsafe { _mm256_storeu_si256(dst.as_mut_ptr().cast(), v) }
}
