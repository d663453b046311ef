//! Tiles of rows by panels of outputs, with as many sums as fit the registers.

use super::end::end;
pub(in crate::matmul_i8) use crate::gemm::avx512vnni::MAX_PANELS;
use crate::gemm::tiles;
use crate::mat::MatMut;
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
/// Rows of the largest tile with an even number of panels, as gated products need: 6 rows x 4 panels.
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

/// The product with inputs offset when loaded, unless rows are few: no buffer is
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

/// The product in tiles of `TILE` rows, with a buffer for `CONVERTED` converted rows: `TILE` or 0.
#[avx512vnni]
fn product<const TILE: usize, const CONVERTED: usize>(x: QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    let mut buffer = [[[0; QUAD]; QUADS + SPARE]; CONVERTED];
    let (rows, panel_bytes) = (x.rows.rows(), PANEL * task.k().max(1));
    let count = rows.div_ceil(TILE);
    // A multiple of the panels per tile, and of gated pairs of them. Tiles of few rows use
    // four, which does not divide 6, but products of several tiles have more rows in each.
    // Where rows are converted, which is done once per chunk, chunks are as large as fit.
    let granule = match task {
        GemmTask::Gated(..) if CONVERTED == EVEN_ROWS && count > 1 => 4,
        _ if count > 1 && 12 * panel_bytes > CHUNK_BYTES => 6,
        GemmTask::Plain(..) if CONVERTED == ROWS && rows >= 7 * count => 3,
        _ => 12,
    };
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

/// Converts one row to `x + 128`.
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

/// Processes `R` rows from `t` on with the slots of `chunk`, `P` at a time; `buffer` has the rows
/// converted, or is empty.
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

/// Processes `R` rows with `P` slots from `slot` on, from the first input through the epilogue.
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
    // Not with `from_fn`: a closure has this function's features and cannot be inlined into a function
    // without them.
    let mut panels = [&[][..]; P];
    for (p, panel) in panels.iter_mut().enumerate() {
        *panel = task.panel(slot + p);
        prefetch_scales(task, slot + p);
    }
    let k = task.k();
    let mut sums = [[_mm512_setzero_si512(); P]; R];
    if buffer.is_empty() {
        let next = chunk.fetch(panels[0]);
        let mut rows = [core::ptr::null(); R];
        for (r, row) in rows.iter_mut().enumerate() {
            let (quads, _) = x.rows.row(t + r).as_chunks::<QUAD>();
            assert!(quads.len() >= panels[0].len());
            *row = quads.as_ptr();
        }
        // SAFETY: all rows have as many quads as the panels.
        sums = unsafe { multiply::<R, P, false>(rows, panels, (chunk.ahead, next), sums) };
    } else if k <= QUADS * QUAD {
        let next = chunk.fetch(panels[0]);
        sums = multiply_converted(buffer, panels, (chunk.ahead, next), sums);
    } else {
        for first in (0..k).step_by(QUADS * QUAD) {
            convert(x, t, first, buffer);
            let quads = first / QUAD..(first / QUAD + QUADS).min(k.div_ceil(QUAD));
            let mut part = panels;
            for part in &mut part {
                *part = &part[quads.clone()];
            }
            let ahead = (chunk.ahead, [part[0].as_ptr(); 2]);
            sums = multiply_converted(buffer, part, ahead, sums);
        }
    }
    // The first weights of the next tile are prefetched while the epilogue of this one runs.
    for slot in slot + P..(slot + 2 * P).min(task.slots()) {
        task.panel(slot).iter().take(chunk.ahead).for_each(|line| prefetch::to_l1(line));
    }
    end(x, t, &sums, task, slot, y);
}

/// [`multiply`] with the first `R` converted rows.
#[inline]
#[avx512vnni]
fn multiply_converted<const R: usize, const P: usize>(
    buffer: &[BiasedRow],
    panels: [&[[i8; BYTES]]; P],
    ahead: (usize, [*const [i8; BYTES]; 2]),
    sums: [[__m512i; P]; R],
) -> [[__m512i; P]; R] {
    assert!(buffer.len() >= R && panels[0].len() <= QUADS);
    // At constant distances, so that they need one register: the others would be loaded in every step.
    let mut rows = [buffer.as_ptr().cast::<[i8; QUAD]>(); R];
    for (r, row) in rows.iter_mut().enumerate() {
        *row = row.wrapping_add(r * (QUADS + SPARE));
    }
    // SAFETY: all rows have as many quads as the panels.
    unsafe { multiply::<R, P, true>(rows, panels, ahead, sums) }
}

/// The innermost tile: multiplies quads of `rows`, offset already (`BIASED`) or when loaded, by quads of panels,
/// and adds the products to `R x P` `sums` in registers. Prefetches weights at the distance `ahead`, and the `next`
/// panels, quad by quad.
///
/// # Safety
/// The rows have as many quads as the panels.
#[inline]
#[avx512vnni]
unsafe fn multiply<const R: usize, const P: usize, const BIASED: bool>(
    x: [*const [i8; QUAD]; R],
    panels: [&[[i8; BYTES]]; P],
    (ahead, next): (usize, [*const [i8; BYTES]; 2]),
    mut sums: [[__m512i; P]; R],
) -> [[__m512i; P]; R] {
    let quads = panels[0].len();
    let flip = _mm512_set1_epi8(i8::MIN);
    // A constant for one row, a decoder step, where it matters.
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
/// flip them before the broadcast, which then needs a shuffle, on a port that products use.
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
    // SAFETY: the mask selects only the bytes of `src`; others are not read.
    unsafe { _mm512_maskz_loadu_epi8((1 << src.len()) - 1, src.as_ptr()) }
}

#[inline]
#[avx512vnni]
fn store_bytes(dst: &mut [i8; BYTES], v: __m512i) {
    // SAFETY: `dst` is 64 writable bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(dst.as_mut_ptr().cast(), v) }
}
