//! Tiles of rows by panels of outputs, as many sums as there are registers.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use crate::gemm::avx512vnni as float;
pub(in crate::matmul_i8) use crate::gemm::avx512vnni::MAX_PANELS;
use crate::gemm::{Epilogue, tiles};
use crate::lanes::avx512vnni::{lane_mask, load, load_part, store, store_part};
use crate::mat::MatMut;
use crate::math::Activation;
use crate::math::avx512vnni::gelu_tanh;
use crate::matmul_i8::chunk::{CHUNK_BYTES, Chunk, FEW_ROWS, PREFETCH_DISTANCE, prefetch_scales};
use crate::matmul_i8::input::{GemmTask, QuantInput};
use crate::pack::{PANEL, QUAD};
use crate::prefetch;
use core::arch::asm;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// Rows of the largest tile: 9 rows x 3 panels are 27 sums, which leaves three registers for
/// weights and two others.
pub(super) const ROWS: usize = 9;
/// Rows of the largest tile of an even number of panels, as gated products need: 6 rows x 4 panels.
pub(super) const EVEN_ROWS: usize = 6;
/// Quads of inputs converted at once: 9 rows are 37 KiB.
pub(super) const QUADS: usize = 1024;
/// Bytes in a register.
pub(super) const BYTES: usize = 64;

/// Quads of a row beyond its inputs: they pad it to a whole register, and the extra line avoids conflicts between rows
/// in cache sets.
pub(super) const SPARE: usize = BYTES / QUAD;

/// Inputs of one row, offset to unsigned, as bits.
pub(super) type Row<const N: usize> = [[i8; QUAD]; N];
type BiasedRow = Row<{ QUADS + SPARE }>;

#[avx512vnni]
pub(super) fn run(x: QuantInput, task: &GemmTask, y: MatMut<f32>) {
    match task {
        _ if x.rows.rows() <= FEW_ROWS => product::<FEW_ROWS, FEW_ROWS>(x, task, y),
        GemmTask::Plain(..) => product::<ROWS, ROWS>(x, task, y),
        GemmTask::Gated(..) => product::<EVEN_ROWS, EVEN_ROWS>(x, task, y),
    }
}

/// The product with inputs offset when they are loaded, unless rows are few: no buffer is
/// written and read. This is free on a Zen 5, and takes a quarter longer on an Intel Xeon.
#[avx512vnni]
pub(super) fn run_in_place(x: QuantInput, task: &GemmTask, y: MatMut<f32>) {
    match task {
        // The last quad would end beyond the row.
        _ if !task.k().is_multiple_of(QUAD) || x.rows.rows() <= FEW_ROWS => run(x, task, y),
        GemmTask::Plain(..) => product::<ROWS, 0>(x, task, y),
        GemmTask::Gated(..) => product::<EVEN_ROWS, 0>(x, task, y),
    }
}

/// The product in tiles of `TILE` rows, as many `CONVERTED` beforehand, or none.
#[avx512vnni]
fn product<const TILE: usize, const CONVERTED: usize>(x: QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    let mut buffer = [[[0; QUAD]; QUADS + SPARE]; CONVERTED];
    let (rows, panel_bytes) = (x.rows.rows(), PANEL * task.k().max(1));
    let count = rows.div_ceil(TILE);
    // A multiple of the panels per tile, and of gated pairs of them. Tiles of few rows use
    // four, which does not divide 6, but products of several tiles have more rows in each.
    let granule = if count > 1 && 12 * panel_bytes > CHUNK_BYTES { 6 } else { 12 };
    let width = (CHUNK_BYTES / panel_bytes / granule).max(1) * granule;
    for first in (0..task.slots()).step_by(width) {
        let mut chunk = Chunk::new(task, first..first + width, rows, (count, MAX_PANELS));
        for (t, rows) in tiles(rows, TILE) {
            let buffer = &mut buffer[..rows.min(CONVERTED)];
            convert(&x, t, 0, buffer);
            match rows {
                1 => tile::<1, 8>(&x, t, buffer, &mut chunk, &mut y),
                2 => tile::<2, 8>(&x, t, buffer, &mut chunk, &mut y),
                3 => tile::<3, 4>(&x, t, buffer, &mut chunk, &mut y),
                4 => tile::<4, 4>(&x, t, buffer, &mut chunk, &mut y),
                5 => tile::<5, 4>(&x, t, buffer, &mut chunk, &mut y),
                6 => tile::<6, 4>(&x, t, buffer, &mut chunk, &mut y),
                7 => tile::<7, 3>(&x, t, buffer, &mut chunk, &mut y),
                8 => tile::<8, 3>(&x, t, buffer, &mut chunk, &mut y),
                ROWS => tile::<ROWS, 3>(&x, t, buffer, &mut chunk, &mut y),
                rows => unreachable!("a tile of {rows} rows"),
            }
        }
    }
}

/// Converts the inputs from `first` on of the rows from `t` on to unsigned, as many of both as
/// `buffer` holds.
#[avx512vnni]
pub(super) fn convert<const N: usize>(x: &QuantInput, t: usize, first: usize, buffer: &mut [Row<N>]) {
    let inputs = first..(first + (N - SPARE) * QUAD).min(x.rows.cols());
    for (t, buffer) in (t..).zip(buffer.iter_mut()) {
        unsigned(&x.rows.row(t)[inputs.clone()], buffer);
    }
}

/// `x + 128` of one row.
#[inline]
#[avx512vnni]
fn unsigned<const N: usize>(x: &[i8], buffer: &mut Row<N>) {
    let flip = _mm512_set1_epi8(i8::MIN);
    let buffer = buffer.as_flattened_mut().as_chunks_mut::<BYTES>().0;
    let (x, x_tail) = x.as_chunks::<BYTES>();
    for (x, buffer) in x.iter().zip(buffer.iter_mut()) {
        store_bytes(buffer, _mm512_xor_si512(load_bytes(x), flip));
    }
    // Values behind the last input are multiplied by zero weights.
    store_bytes(&mut buffer[x.len()], _mm512_xor_si512(load_bytes_part(x_tail), flip));
}

/// The rows from `t` on, `R` of them, with the slots of `chunk`, `P` at a time; `buffer` has them
/// converted, or nothing.
#[avx512vnni]
fn tile<const R: usize, const P: usize>(
    x: &QuantInput,
    t: usize,
    buffer: &mut [BiasedRow],
    chunk: &mut Chunk,
    y: &mut MatMut<f32>,
) {
    let (mut slot, end) = (chunk.slots.start, chunk.slots.end);
    while slot + P <= end {
        group::<R, P>(x, t, buffer, chunk, slot, y);
        slot += P;
    }
    if P > MAX_PANELS && slot + MAX_PANELS <= end {
        group::<R, MAX_PANELS>(x, t, buffer, chunk, slot, y);
        slot += MAX_PANELS;
    }
    while slot + 2 <= end {
        group::<R, 2>(x, t, buffer, chunk, slot, y);
        slot += 2;
    }
    if slot < end {
        group::<R, 1>(x, t, buffer, chunk, slot, y);
    }
}

/// `R` rows with `P` slots from `slot` on, from the first input to the end of the product.
#[avx512vnni]
fn group<const R: usize, const P: usize>(
    x: &QuantInput,
    t: usize,
    buffer: &mut [BiasedRow],
    chunk: &mut Chunk,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let task = chunk.task;
    // Not by `from_fn`: a closure has this function's features and cannot be inlined into one that
    // has not.
    let mut panels = [&[][..]; P];
    for (p, panel) in panels.iter_mut().enumerate() {
        *panel = task.panel(slot + p);
        prefetch_scales(task, slot + p);
    }
    let k = task.k();
    let mut sums = [[_mm512_setzero_si512(); P]; R];
    if buffer.is_empty() {
        let next = chunk.fetch(panels[0]);
        let mut rows = [&[][..]; R];
        for (r, row) in rows.iter_mut().enumerate() {
            *row = x.rows.row(t + r).as_chunks().0;
        }
        sums = multiply::<R, P, false>(rows, panels, (chunk.ahead, next), sums);
    } else if k <= QUADS * QUAD {
        let next = chunk.fetch(panels[0]);
        sums = multiply::<R, P, true>(converted(buffer), panels, (chunk.ahead, next), sums);
    } else {
        for first in (0..k).step_by(QUADS * QUAD) {
            convert(x, t, first, buffer);
            let quads = first / QUAD..(first / QUAD + QUADS).min(k.div_ceil(QUAD));
            let mut part = panels;
            for part in &mut part {
                *part = &part[quads.clone()];
            }
            let ahead = (chunk.ahead, [part[0].as_ptr(); 2]);
            sums = multiply::<R, P, true>(converted(buffer), part, ahead, sums);
        }
    }
    // The first weights of the next tile are prefetched while the epilogue of this one runs.
    for slot in slot + P..(slot + 2 * P).min(task.slots()) {
        task.panel(slot).iter().take(chunk.ahead).for_each(|line| prefetch::to_l1(line));
    }
    end(x, t, &sums, task, slot, y);
}

/// Ends the sums of `R` rows from `t` on with `P` slots from `slot` on, whose inputs were offset to unsigned. The usual
/// ends of whole panels are computed as the sums leave their registers.
#[inline]
#[avx512vnni]
fn end<const R: usize, const P: usize>(
    x: &QuantInput,
    t: usize,
    sums: &[[__m512i; P]; R],
    task: &GemmTask,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut scales = [Scales::<128>::of(task, slot); P];
    for p in 1..P {
        scales[p] = Scales::of(task, slot + p);
    }
    match task {
        GemmTask::Plain(_, Epilogue { bias: None, activation: Activation::None, add, scatter: None })
            if (slot + P) * PANEL <= y.cols() =>
        {
            for r in 0..R {
                let x_scale = _mm512_set1_ps(x.scale(t + r));
                let y = &mut y.row_mut(t + r)[slot * PANEL..(slot + P) * PANEL];
                let (y, _) = y.as_chunks_mut::<PANEL>();
                for p in 0..P {
                    let v = scales[p].value(sums[r][p], x_scale);
                    let v = if *add { _mm512_add_ps(load(&y[p]), v) } else { v };
                    store(&mut y[p], v);
                }
            }
        }
        GemmTask::Gated(..) if (slot + P) / 2 * PANEL <= y.cols() => {
            for r in 0..R {
                let x_scale = _mm512_set1_ps(x.scale(t + r));
                let y = &mut y.row_mut(t + r)[slot / 2 * PANEL..(slot + P) / 2 * PANEL];
                let (y, _) = y.as_chunks_mut::<PANEL>();
                for i in 0..P / 2 {
                    let gate = scales[2 * i].value(sums[r][2 * i], x_scale);
                    let up = scales[2 * i + 1].value(sums[r][2 * i + 1], x_scale);
                    store(&mut y[i], _mm512_mul_ps(gelu_tanh(gate), up));
                }
            }
        }
        _ => {
            let mut values = [[[0.0; PANEL]; P]; R];
            for r in 0..R {
                let x_scale = _mm512_set1_ps(x.scale(t + r));
                for p in 0..P {
                    store(&mut values[r][p], scales[p].value(sums[r][p], x_scale));
                }
            }
            let values = values.as_flattened_mut();
            match task {
                GemmTask::Plain(_, epilogue) => float::store_tile(values, P, t, slot * PANEL, epilogue, y),
                GemmTask::Gated(..) => float::store_gated_tile(values, P / 2, t, slot / 2 * PANEL, y),
            }
        }
    }
}

/// The first `R` converted rows.
#[inline]
fn converted<const R: usize>(buffer: &[BiasedRow]) -> [&[[i8; QUAD]]; R] {
    let mut rows = [&[][..]; R];
    for (row, buffer) in rows.iter_mut().zip(buffer) {
        *row = buffer;
    }
    rows
}

/// The innermost tile: adds the products of quads of `rows`, which are `BIASED` or will be,
/// with those of panels to `R x P` `sums` in registers. Prefetches weights at the distance
/// `ahead`, and the `next` panels, quad by quad.
#[inline]
#[avx512vnni]
fn multiply<const R: usize, const P: usize, const BIASED: bool>(
    rows: [&[[i8; QUAD]]; R],
    panels: [&[[i8; BYTES]]; P],
    (ahead, next): (usize, [*const [i8; BYTES]; 2]),
    mut sums: [[__m512i; P]; R],
) -> [[__m512i; P]; R] {
    let quads = panels[0].len();
    // Pointers: the lengths of slices would occupy registers.
    let mut x = [core::ptr::null(); R];
    for r in 0..R {
        assert!(rows[r].len() >= quads);
        x[r] = rows[r].as_ptr();
    }
    let flip = _mm512_set1_epi8(i8::MIN);
    // A constant for one row, a decoder's step, where it matters.
    let ahead = if R == 1 { PREFETCH_DISTANCE[0] } else { ahead };
    for panel in panels {
        assert!(panel.len() == quads);
    }
    for q in 0..quads {
        let mut w = [_mm512_setzero_si512(); P];
        for p in 0..P {
            w[p] = load_bytes(&panels[p][q]);
        }
        for panel in &panels {
            prefetch::to_l1(panel.as_ptr().wrapping_add(q + ahead));
        }
        if R > FEW_ROWS {
            for panel in next {
                prefetch::to_l2(panel.wrapping_add(q));
            }
        }
        for r in 0..R {
            let quad = if BIASED {
                // SAFETY: all rows have as many quads as the panels, and `q` is
                // below that; the read needs no alignment.
                _mm512_set1_epi32(unsafe { x[r].wrapping_add(q).cast::<i32>().read_unaligned() })
            } else {
                // SAFETY: as above, all rows have that quad.
                unsafe { load_biased_quad(x[r], q, flip) }
            };
            for p in 0..P {
                sums[r][p] = _mm512_dpbusd_epi32(sums[r][p], quad, w[p]);
            }
        }
    }
    sums
}

/// Broadcasts quad `q` of `row` and flips the bits of `flip`, in one instruction: compilers
/// flip them before the broadcast, which then needs a shuffle, in the port of a product.
///
/// # Safety
/// The row has more than `q` quads.
#[inline]
#[avx512vnni]
unsafe fn load_biased_quad(row: *const [i8; QUAD], q: usize, flip: __m512i) -> __m512i {
    let quad;
    // SAFETY: the instruction reads the four bytes of a quad, which this function's contract
    // guarantees, and writes only this register.
    unsafe {
        asm!("vpxord {quad}, {flip}, dword ptr [{row} + 4 * {q}]{{1to16}}", quad = out(zmm_reg) quad, flip = in(zmm_reg) flip,
            row = in(reg) row, q = in(reg) q, options(pure, readonly, nostack, preserves_flags));
    }
    quad
}

/// What makes floats of the integer sums of a slot, whose inputs were offset by `OFFSET`.
#[derive(Clone, Copy)]
pub(super) struct Scales<const OFFSET: i32> {
    /// `OFFSET` times the sum of each output's weights.
    correction: __m512i,
    scale: __m512,
}

impl<const OFFSET: i32> Scales<OFFSET> {
    #[inline]
    #[avx512vnni]
    pub(super) fn of(task: &GemmTask, slot: usize) -> Self {
        let (w, p) = task.slot(slot);
        let outputs = p * PANEL..((p + 1) * PANEL).min(w.n());
        let sum = load_sums_part(&w.sum()[outputs.clone()]);
        Self { correction: _mm512_mullo_epi32(sum, _mm512_set1_epi32(OFFSET)), scale: load_part(&w.scale()[outputs]) }
    }

    /// The exact sum rounded to f32 once, then scalar's order of roundings.
    #[inline]
    #[avx512vnni]
    pub(super) fn value(&self, sum: __m512i, x_scale: __m512) -> __m512 {
        let sum = _mm512_sub_epi32(sum, self.correction);
        _mm512_mul_ps(_mm512_cvtepi32_ps(sum), _mm512_mul_ps(x_scale, self.scale))
    }
}

/// Scales the integer sums `[rows, width]` of the rows from `t` on with the slots from `slot`
/// on to floats, and applies the epilogue. Their inputs were offset by `OFFSET`.
#[avx512vnni]
pub(in crate::matmul_i8) fn dequantize_tile<const OFFSET: i32>(
    x: &QuantInput,
    t: usize,
    sums: &mut [[f32; PANEL]],
    width: usize,
    task: &GemmTask,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut scales = [Scales::<OFFSET>::of(task, slot); MAX_PANELS];
    for i in 1..width {
        scales[i] = Scales::of(task, slot + i);
    }
    let value = |sum: &[f32; PANEL], x_scale: __m512, i: usize| scales[i].value(load_sums(sum), x_scale);
    match task {
        // The usual end, in one pass.
        GemmTask::Plain(_, Epilogue { bias: None, activation: Activation::None, add, scatter: None }) => {
            let outputs = slot * PANEL..((slot + width) * PANEL).min(y.cols());
            for (t, sums) in (t..).zip(sums.chunks_exact(width)) {
                let x_scale = _mm512_set1_ps(x.scale(t));
                let (y, y_tail) = y.row_mut(t)[outputs.clone()].as_chunks_mut::<PANEL>();
                for (i, (y, sum)) in y.iter_mut().zip(sums).enumerate() {
                    let v = value(sum, x_scale, i);
                    store(y, if *add { _mm512_add_ps(load(y), v) } else { v });
                }
                if !y_tail.is_empty() {
                    let v = value(&sums[y.len()], x_scale, y.len());
                    store_part(y_tail, if *add { _mm512_add_ps(load_part(y_tail), v) } else { v });
                }
            }
            return;
        }
        _ => {
            for (t, sums) in (t..).zip(sums.chunks_exact_mut(width)) {
                let x_scale = _mm512_set1_ps(x.scale(t));
                for (i, sum) in sums.iter_mut().enumerate() {
                    let v = value(sum, x_scale, i);
                    store(sum, v);
                }
            }
        }
    }
    match task {
        GemmTask::Plain(_, epilogue) => float::store_tile(sums, width, t, slot * PANEL, epilogue, y),
        GemmTask::Gated(..) => float::store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, y),
    }
}

#[inline]
#[avx512vnni]
pub(super) fn load_bytes(src: &[i8; BYTES]) -> __m512i {
    // SAFETY: `src` is 64 readable bytes; the load needs no alignment.
    unsafe { _mm512_loadu_si512(src.as_ptr().cast()) }
}

#[inline]
#[avx512vnni]
fn load_bytes_part(src: &[i8]) -> __m512i {
    assert!(src.len() < BYTES);
    // SAFETY: the mask names the bytes of `src` alone; others are not read.
    unsafe { _mm512_maskz_loadu_epi8((1 << src.len()) - 1, src.as_ptr()) }
}

#[inline]
#[avx512vnni]
fn store_bytes(dst: &mut [i8; BYTES], v: __m512i) {
    // SAFETY: `dst` is 64 writable bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(dst.as_mut_ptr().cast(), v) }
}

/// Integer sums, stored as bits in place of the floats that replace them.
#[inline]
#[avx512vnni]
fn load_sums(src: &[f32; PANEL]) -> __m512i {
    _mm512_castps_si512(load(src))
}

#[inline]
#[avx512vnni]
fn load_sums_part(src: &[i32]) -> __m512i {
    // SAFETY: the mask names the elements of `src` alone; others are not read.
    unsafe { _mm512_maskz_loadu_epi32(lane_mask(src.len()), src.as_ptr()) }
}
