//! Tiles of rows by panels of outputs, as many sums as there are registers.

use crate::gemm::avx512vnni as float;
pub(in crate::matmul_i8) use crate::gemm::avx512vnni::MOST;
use crate::gemm::{Epilogue, tiles};
use crate::lanes::avx512vnni::{first_lanes, load, load_part, store, store_part};
use crate::mat::MatMut;
use crate::math::Activation;
use crate::matmul_i8::chunk::{AHEAD, CHUNK_BYTES, Chunk, FEW_ROWS, expect_end};
use crate::matmul_i8::input::{Job, QuantInput};
use crate::pack::{PANEL, QUAD};
use crate::prefetch;
use core::arch::asm;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// Rows of the largest tile: 9 rows x 3 panels are 27 sums, which leaves three registers of weights and two to spare.
const ROWS: usize = 9;
/// Rows of the largest tile of an even number of panels, as gated products need: 6 rows x 4 panels.
const EVEN_ROWS: usize = 6;
/// Quads of inputs converted at once: 9 rows are 37 KiB.
pub(super) const QUADS: usize = 1024;
/// Panels of sums in one tile at most. They are cleared once per product: clearing them per tile would wait for the
/// stores of the tile before.
const SUMS: usize = ROWS * 3;
/// Bytes in a register.
pub(super) const BYTES: usize = 64;

/// Unsigned steps of one row as bits, with room for a whole register behind the last; the extra line keeps rows off each
/// other's cache sets.
pub(super) type Steps = [[i8; QUAD]; QUADS + BYTES / QUAD];

#[avx512vnni]
pub(super) fn run(x: QuantInput, job: &Job, y: MatMut<f32>) {
    match job {
        _ if x.rows.rows() <= FEW_ROWS => product::<FEW_ROWS, FEW_ROWS>(x, job, y),
        Job::Plain(..) => product::<ROWS, ROWS>(x, job, y),
        Job::Gated(..) => product::<EVEN_ROWS, EVEN_ROWS>(x, job, y),
    }
}

/// The same of more than a few rows where they lie, each quad made unsigned on its way from memory to all lanes: nothing has to be made
/// room for, converted and read again. Costs nothing on a Zen 5, which has as many instructions to spare, and a quarter of the time on
/// an Intel.
#[avx512vnni]
pub(super) fn run_in_place(x: QuantInput, job: &Job, y: MatMut<f32>) {
    match job {
        // The last quad would end beyond the row.
        _ if !job.k().is_multiple_of(QUAD) || x.rows.rows() <= FEW_ROWS => run(x, job, y),
        Job::Plain(..) => product::<ROWS, 0>(x, job, y),
        Job::Gated(..) => product::<EVEN_ROWS, 0>(x, job, y),
    }
}

/// The product in tiles of `TILE` rows, as many `CONVERTED` beforehand, or none.
#[avx512vnni]
fn product<const TILE: usize, const CONVERTED: usize>(x: QuantInput, job: &Job, mut y: MatMut<f32>) {
    let mut steps = [[[0; QUAD]; QUADS + BYTES / QUAD]; CONVERTED];
    let mut sums = [[0.0; PANEL]; SUMS];
    let (rows, panel_bytes) = (x.rows.rows(), PANEL * job.k().max(1));
    let count = rows.div_ceil(TILE);
    // A multiple of the panels that any tile takes at once, and of gated pairs of them. Tiles of few rows take four, which 6 is not,
    // but where there are several tiles they have more.
    let granule = if count > 1 && 12 * panel_bytes > CHUNK_BYTES { 6 } else { 12 };
    let width = (CHUNK_BYTES / panel_bytes / granule).max(1) * granule;
    for first in (0..job.slots()).step_by(width) {
        let mut chunk = Chunk::new(job, first..first + width, rows, (count, MOST));
        for (t, rows) in tiles(rows, TILE) {
            let steps = &mut steps[..rows.min(CONVERTED)];
            convert(&x, t, 0, steps);
            match rows {
                1 => tile::<1, 8>(&x, t, steps, &mut chunk, &mut sums, &mut y),
                2 => tile::<2, 8>(&x, t, steps, &mut chunk, &mut sums, &mut y),
                3 => tile::<3, 4>(&x, t, steps, &mut chunk, &mut sums, &mut y),
                4 => tile::<4, 4>(&x, t, steps, &mut chunk, &mut sums, &mut y),
                5 => tile::<5, 4>(&x, t, steps, &mut chunk, &mut sums, &mut y),
                6 => tile::<6, 4>(&x, t, steps, &mut chunk, &mut sums, &mut y),
                7 => tile::<7, 3>(&x, t, steps, &mut chunk, &mut sums, &mut y),
                8 => tile::<8, 3>(&x, t, steps, &mut chunk, &mut sums, &mut y),
                ROWS => tile::<ROWS, 3>(&x, t, steps, &mut chunk, &mut sums, &mut y),
                rows => unreachable!("a tile of {rows} rows"),
            }
        }
    }
}

/// The inputs from `first` on of the rows from `t` on, made unsigned, as many of both as `steps` holds.
#[avx512vnni]
pub(super) fn convert(x: &QuantInput, t: usize, first: usize, steps: &mut [Steps]) {
    let inputs = first..(first + QUADS * QUAD).min(x.rows.cols());
    for (t, steps) in (t..).zip(steps.iter_mut()) {
        unsigned(&x.rows.row(t)[inputs.clone()], steps);
    }
}

/// `x + 128` of one row.
#[inline]
#[avx512vnni]
fn unsigned(x: &[i8], steps: &mut Steps) {
    let flip = _mm512_set1_epi8(i8::MIN);
    let steps = steps.as_flattened_mut().as_chunks_mut::<BYTES>().0;
    let (x, x_tail) = x.as_chunks::<BYTES>();
    for (x, steps) in x.iter().zip(steps.iter_mut()) {
        store_bytes(steps, _mm512_xor_si512(load_bytes(x), flip));
    }
    // Whatever stands behind the last input meets weights that are zero.
    store_bytes(&mut steps[x.len()], _mm512_xor_si512(load_bytes_part(x_tail), flip));
}

/// The rows from `t` on, `R` of them, with the slots of `chunk`, `P` at a time; `steps` has them converted, or nothing.
#[avx512vnni]
fn tile<const R: usize, const P: usize>(
    x: &QuantInput,
    t: usize,
    steps: &mut [Steps],
    chunk: &mut Chunk,
    sums: &mut [[f32; PANEL]; SUMS],
    y: &mut MatMut<f32>,
) {
    let (mut slot, end) = (chunk.slots.start, chunk.slots.end);
    while slot + P <= end {
        group::<R, P>(x, t, steps, chunk, slot, sums, y);
        slot += P;
    }
    if P > MOST && slot + MOST <= end {
        group::<R, MOST>(x, t, steps, chunk, slot, sums, y);
        slot += MOST;
    }
    while slot + 2 <= end {
        group::<R, 2>(x, t, steps, chunk, slot, sums, y);
        slot += 2;
    }
    if slot < end {
        group::<R, 1>(x, t, steps, chunk, slot, sums, y);
    }
}

/// `R` rows with `P` slots from `slot` on, from the first input to the end of the product.
#[avx512vnni]
fn group<const R: usize, const P: usize>(
    x: &QuantInput,
    t: usize,
    steps: &mut [Steps],
    chunk: &mut Chunk,
    slot: usize,
    sums: &mut [[f32; PANEL]; SUMS],
    y: &mut MatMut<f32>,
) {
    let job = chunk.job;
    // Not by `from_fn`: a closure has this function's features and cannot be inlined into one that has not.
    let mut panels = [&[][..]; P];
    for (p, panel) in panels.iter_mut().enumerate() {
        *panel = job.panel(slot + p);
        expect_end(job, slot + p);
    }
    let k = job.k();
    if steps.is_empty() {
        let next = chunk.fetch(panels[0]);
        let mut rows = [&[][..]; R];
        for (r, row) in rows.iter_mut().enumerate() {
            *row = x.rows.row(t + r).as_chunks().0;
        }
        multiply::<R, P, false>(rows, panels, (chunk.ahead, next), true, sums);
    } else if k <= QUADS * QUAD {
        let next = chunk.fetch(panels[0]);
        multiply::<R, P, true>(converted(steps), panels, (chunk.ahead, next), true, sums);
    } else {
        for first in (0..k).step_by(QUADS * QUAD) {
            convert(x, t, first, steps);
            let quads = first / QUAD..(first / QUAD + QUADS).min(k.div_ceil(QUAD));
            let mut part = panels;
            for part in &mut part {
                *part = &part[quads.clone()];
            }
            let ahead = (chunk.ahead, [part[0].as_ptr(); 2]);
            multiply::<R, P, true>(converted(steps), part, ahead, first == 0, sums);
        }
    }
    // The next tile's first weights arrive while this one ends.
    for slot in slot + P..(slot + 2 * P).min(job.slots()) {
        job.panel(slot).iter().take(chunk.ahead).for_each(|line| prefetch::near(line));
    }
    let width = P.min(MOST);
    for (i, sums) in sums[..R * P].chunks_exact_mut(R * width).enumerate() {
        finish::<128>(x, t, sums, width, job, slot + i * width, y);
    }
}

/// The first `R` rows of what was converted.
#[inline]
fn converted<const R: usize>(steps: &[Steps]) -> [&[[i8; QUAD]]; R] {
    let mut rows = [&[][..]; R];
    for (row, steps) in rows.iter_mut().zip(steps) {
        *row = steps;
    }
    rows
}

/// Where the sum of row `r` and panel `p` lies: [`MOST`] panels of all rows, then the next.
#[inline]
const fn place<const R: usize, const P: usize>(r: usize, p: usize) -> usize {
    let width = if P < MOST { P } else { MOST };
    p / width * width * R + r * width + p % width
}

/// The innermost tile: adds the products of quads of `rows`, which are `RAISED` or will be, with those of panels to `R x P` sums in
/// registers. Weights are fetched so far `ahead`, and the `next` panels, quad by quad.
#[inline]
#[avx512vnni]
fn multiply<const R: usize, const P: usize, const RAISED: bool>(
    rows: [&[[i8; QUAD]]; R],
    panels: [&[[i8; BYTES]]; P],
    (ahead, next): (usize, [*const [i8; BYTES]; 2]),
    start: bool,
    sums: &mut [[f32; PANEL]; SUMS],
) {
    let quads = panels[0].len();
    // Pointers: slices' lengths take registers.
    let mut x = [core::ptr::null(); R];
    for r in 0..R {
        assert!(rows[r].len() >= quads);
        x[r] = rows[r].as_ptr();
    }
    let flip = _mm512_set1_epi8(i8::MIN);
    // Known to the compiler where it matters: a decoder's step.
    let ahead = if R == 1 { AHEAD[0] } else { ahead };
    for panel in panels {
        assert!(panel.len() == quads);
    }
    let mut acc = [[_mm512_setzero_si512(); P]; R];
    if !start {
        for r in 0..R {
            for p in 0..P {
                acc[r][p] = load_sums(&sums[place::<R, P>(r, p)]);
            }
        }
    }
    for q in 0..quads {
        let mut w = [_mm512_setzero_si512(); P];
        for p in 0..P {
            w[p] = load_bytes(&panels[p][q]);
        }
        for panel in &panels {
            prefetch::near(panel.as_ptr().wrapping_add(q + ahead));
        }
        if R > FEW_ROWS {
            for panel in next {
                prefetch::far(panel.wrapping_add(q));
            }
        }
        for r in 0..R {
            let quad = if RAISED {
                // SAFETY: all rows have as many quads as the panels, and `q` is below that; a quad is read as it lies.
                _mm512_set1_epi32(unsafe { x[r].wrapping_add(q).cast::<i32>().read_unaligned() })
            } else {
                // SAFETY: as above, all rows have that quad.
                unsafe { raised(x[r], q, flip) }
            };
            for p in 0..P {
                acc[r][p] = _mm512_dpbusd_epi32(acc[r][p], quad, w[p]);
            }
        }
    }
    for r in 0..R {
        for p in 0..P {
            store(&mut sums[place::<R, P>(r, p)], _mm512_castsi512_ps(acc[r][p]));
        }
    }
}

/// Quad `q` of `row` in all lanes with the bits of `flip` turned, in one instruction: compilers turn them before the quad goes to all
/// lanes, which takes a shuffle then, in the place of a product.
///
/// # Safety
/// The row has more than `q` quads.
#[inline]
#[avx512vnni]
unsafe fn raised(row: *const [i8; QUAD], q: usize, flip: __m512i) -> __m512i {
    let quad;
    // SAFETY: the instruction reads the four bytes of a quad, which the caller says is there, and writes this register alone.
    unsafe {
        asm!("vpxord {quad}, {flip}, dword ptr [{row} + 4 * {q}]{{1to16}}", quad = out(zmm_reg) quad, flip = in(zmm_reg) flip,
            row = in(reg) row, q = in(reg) q, options(pure, readonly, nostack, preserves_flags));
    }
    quad
}

/// Ends the integer sums `[rows, width]` of the rows from `t` on with the slots from `slot` on, whose inputs were raised by `OFFSET`.
#[avx512vnni]
pub(in crate::matmul_i8) fn finish<const OFFSET: i32>(
    x: &QuantInput,
    t: usize,
    sums: &mut [[f32; PANEL]],
    width: usize,
    job: &Job,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut correction = [_mm512_setzero_si512(); MOST];
    let mut w_scale = [_mm512_setzero_ps(); MOST];
    for i in 0..width {
        let (w, p) = job.slot(slot + i);
        let outputs = p * PANEL..((p + 1) * PANEL).min(w.n());
        let sum = load_sums_part(&w.sum()[outputs.clone()]);
        correction[i] = _mm512_mullo_epi32(sum, _mm512_set1_epi32(OFFSET));
        w_scale[i] = load_part(&w.scale()[outputs]);
    }
    // The exact sum rounded to f32 once, then scalar's order of roundings.
    let value = |sum: &[f32; PANEL], x_scale: __m512, i: usize| {
        let sum = _mm512_sub_epi32(load_sums(sum), correction[i]);
        _mm512_mul_ps(_mm512_cvtepi32_ps(sum), _mm512_mul_ps(x_scale, w_scale[i]))
    };
    match job {
        // The usual end, in one pass.
        Job::Plain(_, Epilogue { bias: None, activation: Activation::None, add, scatter: None }) => {
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
    match job {
        Job::Plain(_, end) => float::finish(sums, width, t, slot * PANEL, end, y),
        Job::Gated(..) => float::finish_gated(sums, width / 2, t, slot / 2 * PANEL, y),
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

/// Integer sums, which lie as bits in the place of the floats that they become.
#[inline]
#[avx512vnni]
fn load_sums(src: &[f32; PANEL]) -> __m512i {
    _mm512_castps_si512(load(src))
}

#[inline]
#[avx512vnni]
fn load_sums_part(src: &[i32]) -> __m512i {
    // SAFETY: the mask names the elements of `src` alone; others are not read.
    unsafe { _mm512_maskz_loadu_epi32(first_lanes(src.len()), src.as_ptr()) }
}
