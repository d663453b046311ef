//! Few rows, one panel after another, its quads distributed over several accumulators to overlap
//! their latencies: rows on processors with the highest bandwidth in one stream ([`Tuning`]). On the
//! others, short rows are multiplied by several panels at once. Integer sums are exact in any order.
//! More rows are computed in tiles.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::end::end;
use super::tiles::{BYTES, QUADS, Row, SPARE, convert, load_bytes};
use crate::mat::MatMut;
use crate::matmul_i8::chunk::prefetch_scales;
use crate::matmul_i8::input::{GemmTask, QuantInput};
use crate::pack::{PANEL, QUAD};
use crate::prefetch;
use crate::tuning::Tuning;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// Most rows for which the product is memory bound.
pub(super) const ROWS: usize = 8;
/// Number of quads of short rows, as in small networks. They get a short buffer: clearing the long one takes a
/// twentieth of their products' time. Their weights come from a cache, for which the hardware prefetcher is enough: with a
/// prefetch for each line, a single row takes a twelfth longer.
pub(super) const SHORT: usize = 128;
/// Most rows, from two on, that a Zen 4 multiplies fastest without prefetches: one row takes as long with them, and
/// with more rows the product is so slow that the hardware prefetcher falls behind.
pub(super) const UNFETCHED: usize = 3;

/// Quads per turn of the loop over short rows.
pub(super) const UNROLL: usize = 4;

/// Kind of prefetch of the weights.
type Lead = u8;
/// No prefetch: see [`SHORT`] and [`UNFETCHED`].
const NONE: Lead = 0;
/// A line into L2, 4 KiB ahead.
const NEAR: Lead = 1;
/// A line into L1, 16 KiB ahead.
const FAR: Lead = 2;

/// Prefetch distance in quads.
const fn distance(lead: Lead) -> usize {
    if lead == NEAR { 64 } else { 256 }
}

/// Whether rows are few, and short enough not to be converted repeatedly. If one stream is not faster, they must
/// also be [`SHORT`], so that the weights come from a cache.
pub(super) fn suits(x: &QuantInput, task: &GemmTask, tuning: Tuning) -> bool {
    let longest = if tuning.one_stream { QUADS } else { SHORT };
    (1..=ROWS).contains(&x.rows.rows()) && task.k() <= longest * QUAD
}

/// Computes the product of rows that satisfy [`suits`].
#[avx512vnni]
pub(super) fn run(x: &QuantInput, task: &GemmTask, y: MatMut<f32>, tuning: Tuning) {
    match tuning.near_prefetch {
        _ if task.k() <= SHORT * QUAD && tuning.one_stream => rows::<{ SHORT + SPARE }, NONE>(x, task, y),
        _ if task.k() <= SHORT * QUAD => short(x, task, y),
        _ if tuning.own_prefetch && (2..=UNFETCHED).contains(&x.rows.rows()) => {
            rows::<{ QUADS + SPARE }, NONE>(x, task, y)
        }
        true => rows::<{ QUADS + SPARE }, NEAR>(x, task, y),
        false => rows::<{ QUADS + SPARE }, FAR>(x, task, y),
    }
}

/// Computes the product of [`SHORT`] rows, whose weights come from L2: panels side by side share the loads of inputs.
#[avx512vnni]
fn short(x: &QuantInput, task: &GemmTask, y: MatMut<f32>) {
    match x.rows.rows() {
        1 => together::<1, 4, 2>(x, task, y),
        2 => together::<2, 4, 2>(x, task, y),
        3 => together::<3, 4, 1>(x, task, y),
        4 => together::<4, 4, 1>(x, task, y),
        5 => together::<5, 4, 1>(x, task, y),
        6 => together::<6, 4, 1>(x, task, y),
        7 => together::<7, 2, 1>(x, task, y),
        ROWS => together::<ROWS, 2, 1>(x, task, y),
        rows => unreachable!("{rows} rows"),
    }
}

/// Computes the product of all [`SHORT`] rows, `R` of them, `P` panels at a time.
#[avx512vnni]
fn together<const R: usize, const P: usize, const ACCUMULATORS: usize>(
    x: &QuantInput,
    task: &GemmTask,
    mut y: MatMut<f32>,
) {
    let mut buffer = [[[0; QUAD]; SHORT + SPARE]; R];
    convert(x, 0, 0, &mut buffer);
    let mut slot = 0;
    while slot + P <= task.slots() {
        group::<R, P, ACCUMULATORS>(x, &buffer, task, slot, &mut y);
        slot += P;
    }
    while slot + 2 <= task.slots() {
        group::<R, 2, 1>(x, &buffer, task, slot, &mut y);
        slot += 2;
    }
    if slot < task.slots() {
        group::<R, 1, 1>(x, &buffer, task, slot, &mut y);
    }
}

/// Multiplies `R` rows with `P` slots from `slot` on, each sum distributed over `ACCUMULATORS`, and runs the epilogue.
#[inline]
#[avx512vnni]
fn group<const R: usize, const P: usize, const ACCUMULATORS: usize>(
    x: &QuantInput,
    buffer: &[Row<{ SHORT + SPARE }>; R],
    task: &GemmTask,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut panels = [core::ptr::null::<[i8; BYTES]>(); P];
    let quads = task.panel(slot).len();
    assert!(quads <= SHORT);
    for p in 0..P {
        let panel = task.panel(slot + p);
        assert!(panel.len() == quads);
        panels[p] = panel.as_ptr();
        prefetch_scales(task, slot + p);
    }
    let mut rows = [core::ptr::null(); R];
    for r in 0..R {
        rows[r] = buffer[r].as_ptr();
    }
    let mut acc = [[[_mm512_setzero_si512(); P]; R]; ACCUMULATORS];
    let whole = quads / UNROLL * UNROLL;
    for first in (0..whole).step_by(UNROLL) {
        for q in 0..UNROLL {
            // SAFETY: `first + q < quads`, which all panels and rows have.
            unsafe { joint_step(&panels, &rows, first + q, &mut acc[q % ACCUMULATORS]) };
        }
    }
    for q in whole..quads {
        // SAFETY: as above.
        unsafe { joint_step(&panels, &rows, q, &mut acc[0]) };
    }
    let mut sums = acc[0];
    for side in &acc[1..] {
        for r in 0..R {
            for p in 0..P {
                sums[r][p] = _mm512_add_epi32(sums[r][p], side[r][p]);
            }
        }
    }
    end(x, 0, &sums, task, slot, y);
}

/// Adds the products of all rows' quad `q` with all panels'.
/// # Safety
/// `w` point to panels and `x` to rows that have this quad.
#[inline]
#[avx512vnni]
unsafe fn joint_step<const R: usize, const P: usize>(
    w: &[*const [i8; BYTES]; P],
    x: &[*const [i8; QUAD]; R],
    q: usize,
    sums: &mut [[__m512i; P]; R],
) {
    let mut weights = [_mm512_setzero_si512(); P];
    for p in 0..P {
        // SAFETY: the panel has the quad by this function's contract.
        weights[p] = load_bytes(unsafe { &*w[p].wrapping_add(q) });
    }
    for r in 0..R {
        // SAFETY: the row has the quad by this function's contract; the read needs no
        // alignment.
        let x = unsafe { x[r].wrapping_add(q).cast::<i32>().read_unaligned() };
        for p in 0..P {
            sums[r][p] = _mm512_dpbusd_epi32(sums[r][p], _mm512_set1_epi32(x), weights[p]);
        }
    }
}

/// Computes the product with rows of `N` quads.
#[avx512vnni]
fn rows<const N: usize, const LEAD: Lead>(x: &QuantInput, task: &GemmTask, y: MatMut<f32>) {
    match x.rows.rows() {
        1 => product::<1, 4, N, LEAD>(x, task, y),
        2 => product::<2, 4, N, LEAD>(x, task, y),
        3 => product::<3, 4, N, LEAD>(x, task, y),
        4 => product::<4, 4, N, LEAD>(x, task, y),
        5 => product::<5, 2, N, LEAD>(x, task, y),
        6 => product::<6, 2, N, LEAD>(x, task, y),
        7 => product::<7, 2, N, LEAD>(x, task, y),
        ROWS => product::<ROWS, 2, N, LEAD>(x, task, y),
        rows => unreachable!("{rows} rows"),
    }
}

/// Computes the product of all rows, `R` of them.
#[avx512vnni]
fn product<const R: usize, const ACCUMULATORS: usize, const N: usize, const LEAD: Lead>(
    x: &QuantInput,
    task: &GemmTask,
    mut y: MatMut<f32>,
) {
    let mut buffer = [[[0; QUAD]; N]; R];
    convert(x, 0, 0, &mut buffer);
    match task {
        GemmTask::Plain(..) => panels::<R, ACCUMULATORS, N, LEAD, 1>(x, &buffer, task, &mut y),
        GemmTask::Gated(..) => panels::<R, ACCUMULATORS, N, LEAD, 2>(x, &buffer, task, &mut y),
    }
}

/// Processes one panel after another; the epilogue runs for the sums of `P` panels at once.
#[inline]
#[avx512vnni]
fn panels<const R: usize, const ACCUMULATORS: usize, const N: usize, const LEAD: Lead, const P: usize>(
    x: &QuantInput,
    buffer: &[Row<N>; R],
    task: &GemmTask,
    y: &mut MatMut<f32>,
) {
    for first in (0..task.slots()).step_by(P) {
        let mut sums = [[_mm512_setzero_si512(); P]; R];
        for p in 0..P {
            let slot = first + p;
            prefetch_scales(task, slot);
            let ahead = ahead(task, slot, distance(LEAD));
            let panel = multiply::<R, ACCUMULATORS, N, LEAD>(buffer, task.panel(slot), ahead);
            for r in 0..R {
                sums[r][p] = panel[r];
            }
        }
        end(x, 0, &sums, task, first, y);
    }
}

/// Start of the quads to be prefetched while the panel of a slot is multiplied: the same number as it
/// has, never beyond the weight's last panel.
#[inline]
fn ahead(task: &GemmTask, slot: usize, distance: usize) -> *const [i8; BYTES] {
    let (w, p) = task.slot(slot);
    let last = w.panel(w.n().div_ceil(PANEL) - 1).as_ptr();
    w.panel(p).as_ptr().wrapping_add(distance).min(last)
}

/// The products of `R` rows with a panel, with quads distributed over `ACCUMULATORS` accumulators.
/// Prefetches the same number of quads from `ahead` on, unless `LEAD` is [`NONE`].
#[inline]
#[avx512vnni]
fn multiply<const R: usize, const ACCUMULATORS: usize, const N: usize, const LEAD: Lead>(
    buffer: &[Row<N>; R],
    panel: &[[i8; BYTES]],
    ahead: *const [i8; BYTES],
) -> [__m512i; R] {
    assert!(panel.len() <= N);
    // Pointers: lengths are known to agree. Fewer instructions between two
    // lines allow more loads in flight.
    let (w, mut x) = (panel.as_ptr(), [core::ptr::null(); R]);
    for r in 0..R {
        x[r] = buffer[r].as_ptr();
    }
    let mut acc = [[_mm512_setzero_si512(); R]; ACCUMULATORS];
    // One row has so little work per line that the loop's own instructions count.
    let turns = if R == 1 { 4 } else { 1 };
    let whole = panel.len() / (turns * ACCUMULATORS) * (turns * ACCUMULATORS);
    for first in (0..whole).step_by(turns * ACCUMULATORS) {
        for turn in 0..turns {
            for (side, sums) in acc.iter_mut().enumerate() {
                let q = first + turn * ACCUMULATORS + side;
                match LEAD {
                    NEAR => prefetch::to_l2(ahead.wrapping_add(q)),
                    FAR => prefetch::to_l1(ahead.wrapping_add(q)),
                    _ => {}
                }
                // SAFETY: `q < whole <= panel.len() <= N`: the panel and all rows have this
                // quad.
                unsafe { dot_step(w, &x, q, sums) };
            }
        }
    }
    for q in whole..panel.len() {
        // SAFETY: `q < panel.len() <= N`, as above.
        unsafe { dot_step(w, &x, q, &mut acc[0]) };
    }
    let mut total = acc[0];
    for side in &acc[1..] {
        for r in 0..R {
            total[r] = _mm512_add_epi32(total[r], side[r]);
        }
    }
    total
}

/// Adds the products of all rows' quad `q`.
/// # Safety
/// `w` points to a panel and `x` to rows that have this quad.
#[inline]
#[avx512vnni]
unsafe fn dot_step<const R: usize>(
    w: *const [i8; BYTES],
    x: &[*const [i8; QUAD]; R],
    q: usize,
    sums: &mut [__m512i; R],
) {
    // SAFETY: the panel has the quad by this function's contract.
    let w = load_bytes(unsafe { &*w.wrapping_add(q) });
    for r in 0..R {
        // SAFETY: the row has the quad by this function's contract; the read needs no
        // alignment.
        let x = unsafe { x[r].wrapping_add(q).cast::<i32>().read_unaligned() };
        sums[r] = _mm512_dpbusd_epi32(sums[r], _mm512_set1_epi32(x), w);
    }
}
