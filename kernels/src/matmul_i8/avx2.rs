//! Bytes widened to 16 bits and multiplied in pairs: `vpmaddwd`, which is exact. (`vpmaddubsw`
//! has twice the rate, but saturates.)
//!
//! ```text
//! a quad of a panel    o0 o0 o0 o0 o1 o1 o1 o1 o2 .. o3     16 bytes, widened: one register
//! times inputs          0  1  2  3  0  1  2  3  0 ..  3     the same four in every output
//! adds up to             o0    o0    o1    o1   ..   o3     two sums per output, added at the end
//! ```

use super::chunk::{CHUNK_BYTES, Chunk, prefetch_scales};
use super::input::{GemmTask, QuantInput};
use crate::gemm::avx2 as float;
use crate::gemm::{Epilogue, tiles};
use crate::isa::{Avx2, entry};
use crate::lanes::avx2::{load_two as load, store_two as store};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedI8, QUAD};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::x86_64::*;
use umo_kernels_features::avx2;

/// Rows of the largest tile: 6 rows x 2 registers of sums leave four, for two of weights, an input
/// and a product.
const ROWS: usize = 6;
/// Quads of inputs converted at once: 6 rows are 24 KiB, which fit in L1 beside the weights.
const QUADS: usize = 512;
/// Prefetch distance in quads: panels are read in order, so that a long distance hides the
/// latency of memory while weights are read once.
const PREFETCH_DISTANCE: usize = 160;
/// Outputs whose quads fill a register when widened.
const OUTPUTS: usize = 4;
/// Registers of a panel.
const REGISTERS: usize = PANEL / OUTPUTS;
/// Panels whose epilogue runs at once: a gate and an up panel.
const WIDTH: usize = 2;

/// Length of a row in quads, and number of rows, up to which a smaller buffer is used: clearing the largest takes
/// longer than a small product.
const SHORT: usize = 128;
const FEW_ROWS: usize = 2;
/// Quads in a buffer's row behind the inputs, to keep rows in different cache sets.
const GAP: usize = 8;

/// Inputs of one row, widened, `N` quads of them.
type WideRow<const N: usize> = [[i16; QUAD]; N];
/// A quad of all outputs of a panel.
type Quads = [i8; PANEL * QUAD];

entry! {
    pub(super) fn matmul(_token: Avx2, x: QuantInput, w: PackedI8, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(_token: Avx2, x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Gated(gate, up), y);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Avx2) -> Tiling {
    Tiling {
        rows: &[FEW_ROWS, ROWS],
        outputs: &[PANEL, WIDTH * PANEL],
        inputs: &[QUAD, PANEL, SHORT * QUAD, QUADS * QUAD],
        held: 0,
        chunk: CHUNK_BYTES,
    }
}

#[avx2]
fn run(x: &QuantInput, task: &GemmTask, y: MatMut<f32>) {
    match (x.rows.rows() <= FEW_ROWS, task.k() <= SHORT * QUAD) {
        (true, true) => product::<FEW_ROWS, { SHORT + GAP }>(x, task, y),
        (true, false) => product::<FEW_ROWS, { QUADS + GAP }>(x, task, y),
        (false, true) => product::<ROWS, { SHORT + GAP }>(x, task, y),
        (false, false) => product::<ROWS, { QUADS + GAP }>(x, task, y),
    }
}

/// The product in tiles of up to `TILE` rows, with a buffer of `N` quads for each.
#[avx2]
fn product<const TILE: usize, const N: usize>(x: &QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    let mut buffer = [[[0; QUAD]; N]; TILE];
    let mut sums = [[[0.0; PANEL]; WIDTH]; TILE];
    let rows = x.rows.rows();
    let width = (CHUNK_BYTES / (PANEL * task.k().max(1)) / WIDTH).max(1) * WIDTH;
    for first in (0..task.slots()).step_by(width) {
        let mut chunk = Chunk::new(task, first..first + width, rows, (rows.div_ceil(TILE), WIDTH));
        for (t, rows) in tiles(rows, TILE) {
            let buffer = &mut buffer[..rows];
            convert(x, t, 0, buffer);
            for slot in chunk.slots.clone().step_by(WIDTH) {
                let width = WIDTH.min(chunk.slots.end - slot);
                let next = chunk.fetch(task.panel(slot));
                let sums = &mut sums.as_flattened_mut()[..rows * width];
                for (i, next) in next[..width].iter().enumerate() {
                    let (fetch, quads) = ((PREFETCH_DISTANCE, *next), task.panel(slot + i));
                    prefetch_scales(task, slot + i);
                    let sums = sums[i..].iter_mut().step_by(width);
                    match rows {
                        1 => panel::<1, 4, N>(x, t, buffer, quads, fetch, sums),
                        2 => panel::<2, 4, N>(x, t, buffer, quads, fetch, sums),
                        3 => panel::<3, 2, N>(x, t, buffer, quads, fetch, sums),
                        4 => panel::<4, 2, N>(x, t, buffer, quads, fetch, sums),
                        5 => panel::<5, 2, N>(x, t, buffer, quads, fetch, sums),
                        ROWS => panel::<ROWS, 2, N>(x, t, buffer, quads, fetch, sums),
                        rows => unreachable!("a tile of {rows} rows"),
                    }
                }
                dequantize_tile::<0>(x, t, sums, width, task, slot, &mut y);
            }
        }
    }
}

/// Widens the inputs from `first` on of the rows from `t` on, as many of both as `buffer` holds.
#[avx2]
fn convert<const N: usize>(x: &QuantInput, t: usize, first: usize, buffer: &mut [WideRow<N>]) {
    let inputs = first..(first + QUADS * QUAD).min(x.rows.cols());
    for (t, buffer) in (t..).zip(buffer.iter_mut()) {
        let (wide, _) = buffer.as_flattened_mut().as_chunks_mut::<16>();
        let (x, x_tail) = x.rows.row(t)[inputs.clone()].as_chunks::<16>();
        for (x, wide) in x.iter().zip(wide.iter_mut()) {
            store_words(wide, widen(x));
        }
        // Values behind the last input are multiplied by zero weights.
        for (x, wide) in x_tail.iter().zip(&mut wide[x.len()]) {
            *wide = i16::from(*x);
        }
    }
}

/// Exact sums of the `R` rows from `t` on with one panel, `H` of its registers at a time.
#[avx2]
fn panel<'s, const R: usize, const H: usize, const N: usize>(
    x: &QuantInput,
    t: usize,
    buffer: &mut [WideRow<N>],
    quads: &[Quads],
    fetch: (usize, *const Quads),
    sums: impl Iterator<Item = &'s mut [f32; PANEL]>,
) {
    let mut partial = [[[0; 8]; REGISTERS]; R];
    for (i, quads) in quads.chunks(QUADS).enumerate() {
        let fetch = (fetch.0, fetch.1.wrapping_add(i * QUADS));
        if x.rows.cols() > QUADS * QUAD {
            convert(x, t, i * QUADS * QUAD, buffer);
        }
        multiply::<R, H, N>(buffer, quads, fetch, &mut partial);
    }
    for (partial, sums) in partial.iter().zip(sums) {
        let low = add_pairs(load_sums(&partial[0]), load_sums(&partial[1]));
        let high = add_pairs(load_sums(&partial[2]), load_sums(&partial[3]));
        store(sums, [_mm256_castsi256_ps(low), _mm256_castsi256_ps(high)]);
    }
}

/// The innermost tile: `R` rows with `H` registers of the panel at a time.
#[avx2]
fn multiply<const R: usize, const H: usize, const N: usize>(
    buffer: &[WideRow<N>],
    quads: &[Quads],
    (ahead, next): (usize, *const Quads),
    partial: &mut [[[i32; 8]; REGISTERS]; R],
) {
    let buffer: &[WideRow<N>; R] = buffer.first_chunk().expect("R is the number of rows");
    assert!(quads.len() <= N);
    for first in (0..REGISTERS).step_by(H) {
        let mut acc = [[_mm256_setzero_si256(); H]; R];
        for (q, quad) in quads.iter().enumerate() {
            let (outputs, _) = quad.as_chunks::<16>();
            prefetch::to_l1(quads.as_ptr().wrapping_add(q + ahead));
            if R > 2 && first == 0 {
                prefetch::to_l2(next.wrapping_add(q));
            }
            let mut w = [_mm256_setzero_si256(); H];
            for h in 0..H {
                w[h] = widen(&outputs[first + h]);
            }
            for r in 0..R {
                let x = _mm256_set1_epi64x(quad_bits(buffer[r][q]));
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

/// The sums of 8 outputs from two adjacent partial sums each.
#[inline]
#[avx2]
fn add_pairs(low: __m256i, high: __m256i) -> __m256i {
    // Outputs 0 1 4 5 | 2 3 6 7: the addition works on halves of the registers.
    _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_hadd_epi32(low, high))
}

/// Scales the integer sums `[rows, width]` of the rows from `t` on with the slots from `slot`
/// on to floats, and applies the epilogue. The sums are stored as bits of floats; their inputs
/// were offset by `OFFSET`.
#[avx2]
pub(super) fn dequantize_tile<const OFFSET: i32>(
    x: &QuantInput,
    t: usize,
    sums: &mut [[f32; PANEL]],
    width: usize,
    task: &GemmTask,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    for i in 0..width {
        let (w, p) = task.slot(slot + i);
        let outputs = p * PANEL..((p + 1) * PANEL).min(w.n());
        let mut w_scale = [0.0; PANEL];
        w_scale[..outputs.len()].copy_from_slice(&w.scale()[outputs.clone()]);
        let w_scale = load(&w_scale);
        let mut w_sum = [0; PANEL];
        w_sum[..outputs.len()].copy_from_slice(&w.sum()[outputs]);
        let (halves, _) = w_sum.as_chunks::<8>();
        let raised = _mm256_set1_epi32(OFFSET);
        let correction = [0, 1].map(|half| _mm256_mullo_epi32(load_sums(&halves[half]), raised));
        for (t, sum) in (t..).zip(sums[i..].iter_mut().step_by(width)) {
            let x_scale = _mm256_set1_ps(x.scale(t));
            let bits = load(sum);
            // The exact sum rounded to f32 once, then scalar's order of roundings.
            let value = [0, 1].map(|half| {
                let exact = _mm256_sub_epi32(_mm256_castps_si256(bits[half]), correction[half]);
                _mm256_mul_ps(_mm256_cvtepi32_ps(exact), _mm256_mul_ps(x_scale, w_scale[half]))
            });
            store(sum, value);
        }
    }
    match task {
        GemmTask::Plain(_, epilogue) => float::store_tile(sums, width, t, slot * PANEL, epilogue, y),
        GemmTask::Gated(..) => float::store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, y),
    }
}

/// 16 bytes as 16 words.
#[inline]
#[avx2]
fn widen(src: &[i8; 16]) -> __m256i {
    // SAFETY: `src` is 16 readable bytes; the load needs no alignment.
    _mm256_cvtepi8_epi16(unsafe { _mm_loadu_si128(src.as_ptr().cast()) })
}

#[inline]
#[avx2]
fn store_words(dst: &mut [i16; 16], v: __m256i) {
    // SAFETY: `dst` is 32 writable bytes; the store needs no alignment.
    unsafe { _mm256_storeu_si256(dst.as_mut_ptr().cast(), v) }
}

#[inline]
#[avx2]
fn load_sums(src: &[i32; 8]) -> __m256i {
    // SAFETY: `src` is 32 readable bytes; the load needs no alignment.
    unsafe { _mm256_loadu_si256(src.as_ptr().cast()) }
}

#[inline]
#[avx2]
fn store_sums(dst: &mut [i32; 8], v: __m256i) {
    // SAFETY: `dst` is 32 writable bytes; the store needs no alignment.
    unsafe { _mm256_storeu_si256(dst.as_mut_ptr().cast(), v) }
}
