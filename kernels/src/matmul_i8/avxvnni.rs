//! Four inputs of 8 outputs per instruction: `vpdpbusd` in registers of 32 bytes, which many
//! processors without AVX-512 have.
//!
//! As in `avx512vnni.rs`, inputs are offset to unsigned (`x + 128`), a tile of rows at a time,
//! and the epilogue subtracts the excess, `128 * sum(w)`, from the sums. A panel's quad is
//! two registers.

use super::avx2::dequantize_tile;
use super::chunk::{CHUNK_BYTES, Chunk, PREFETCH_DISTANCE, prefetch_scales};
use super::input::{GemmTask, QuantInput};
use crate::gemm::{Epilogue, tiles};
use crate::isa::{AvxVnni, entry};
use crate::lanes::avx2::{load_two as load, store_two as store};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedI8, QUAD};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::x86_64::*;
use umo_kernels_features::avxvnni;

/// Rows of the largest tile: 6 rows x 1 panel are 12 sums, which leaves two registers for
/// weights and one for an input.
const ROWS: usize = 6;
/// Panels in one group for one row, which are 12 sums; an even number, as gated products need.
const WIDE: usize = 6;
/// Panels in one group for more rows: a gate and an up panel.
const PAIR: usize = 2;
/// Panels of sums of a group.
const SUMS: usize = ROWS * PAIR;
/// Quads of inputs converted at once: 6 rows are 24 KiB, which fit in L1 beside the weights.
const QUADS: usize = 1024;
/// Bytes in a register.
const BYTES: usize = 32;

/// Inputs of one row, offset to unsigned, padded to a whole register; the extra line avoids
/// conflicts between rows in cache sets.
type BiasedRow = [[u8; QUAD]; QUADS + 16];

entry! {
    pub(super) fn matmul(_token: AvxVnni, x: QuantInput, w: PackedI8, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(_token: AvxVnni, x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Gated(gate, up), y);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: AvxVnni) -> Tiling {
    Tiling {
        rows: &[1, ROWS],
        outputs: &[PANEL, PAIR * PANEL, WIDE * PANEL],
        inputs: &[QUAD, BYTES, QUADS * QUAD],
        held: 0,
        chunk: CHUNK_BYTES,
    }
}

#[avxvnni]
fn run(x: &QuantInput, task: &GemmTask, y: MatMut<f32>) {
    // One row, a decoder step, for which clearing the large buffer would be measurable.
    if x.rows.rows() == 1 { product::<1>(x, task, y) } else { product::<ROWS>(x, task, y) }
}

#[avxvnni]
fn product<const TILE: usize>(x: &QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    let mut buffer = [[[0; QUAD]; QUADS + 16]; TILE];
    let mut sums = [[0.0; PANEL]; SUMS];
    let rows = x.rows.rows();
    let width = (CHUNK_BYTES / (PANEL * task.k().max(1)) / WIDE).max(1) * WIDE;
    for first in (0..task.slots()).step_by(width) {
        let mut chunk = Chunk::new(task, first..first + width, rows, (rows.div_ceil(TILE), PAIR));
        for (t, rows) in tiles(rows, TILE) {
            let buffer = &mut buffer[..rows];
            convert(x, t, 0, buffer);
            match rows {
                1 => tile::<1, 6, WIDE>(x, t, buffer, &mut chunk, &mut sums, &mut y),
                2 => tile::<2, 3, WIDE>(x, t, buffer, &mut chunk, &mut sums, &mut y),
                3 => tile::<3, 2, PAIR>(x, t, buffer, &mut chunk, &mut sums, &mut y),
                4 => tile::<4, 1, PAIR>(x, t, buffer, &mut chunk, &mut sums, &mut y),
                5 => tile::<5, 1, PAIR>(x, t, buffer, &mut chunk, &mut sums, &mut y),
                ROWS => tile::<ROWS, 1, PAIR>(x, t, buffer, &mut chunk, &mut sums, &mut y),
                rows => unreachable!("a tile of {rows} rows"),
            }
        }
    }
}

/// Converts the inputs from `first` on of the rows from `t` on to unsigned, as many of both as
/// `buffer` holds.
#[avxvnni]
fn convert(x: &QuantInput, t: usize, first: usize, buffer: &mut [BiasedRow]) {
    let inputs = first..(first + QUADS * QUAD).min(x.rows.cols());
    for (t, buffer) in (t..).zip(buffer.iter_mut()) {
        let (buffer, _) = buffer.as_flattened_mut().as_chunks_mut::<BYTES>();
        let (x, x_tail) = x.rows.row(t)[inputs.clone()].as_chunks::<BYTES>();
        for (x, buffer) in x.iter().zip(buffer.iter_mut()) {
            store_bytes(buffer, unsigned(x));
        }
        // Values behind the last input are multiplied by zero weights.
        let mut last = [0; BYTES];
        last[..x_tail.len()].copy_from_slice(x_tail);
        store_bytes(&mut buffer[x.len()], unsigned(&last));
    }
}

/// Processes `R` rows from `t` on with the slots of `chunk`, `WIDTH` in a group, `P` of them at
/// a time.
#[avxvnni]
fn tile<const R: usize, const P: usize, const WIDTH: usize>(
    x: &QuantInput,
    t: usize,
    buffer: &mut [BiasedRow],
    chunk: &mut Chunk,
    sums: &mut [[f32; PANEL]; SUMS],
    y: &mut MatMut<f32>,
) {
    let buffer: &mut [BiasedRow; R] = buffer.first_chunk_mut().expect("R was chosen by the number of rows");
    let (mut slot, end) = (chunk.slots.start, chunk.slots.end);
    while slot + WIDTH <= end {
        group::<R, P, WIDTH>(x, t, buffer, chunk, slot, sums, y);
        slot += WIDTH;
    }
    while WIDTH > PAIR && slot + PAIR <= end {
        group::<R, PAIR, PAIR>(x, t, buffer, chunk, slot, sums, y);
        slot += PAIR;
    }
    if slot < end {
        group::<R, 1, 1>(x, t, buffer, chunk, slot, sums, y);
    }
}

/// Processes `R` rows with `WIDTH` slots from `slot` on, from the first input through the epilogue.
#[avxvnni]
fn group<const R: usize, const P: usize, const WIDTH: usize>(
    x: &QuantInput,
    t: usize,
    buffer: &mut [BiasedRow; R],
    chunk: &mut Chunk,
    slot: usize,
    sums: &mut [[f32; PANEL]; SUMS],
    y: &mut MatMut<f32>,
) {
    let task = chunk.task;
    let next = chunk.fetch(task.panel(slot));
    (slot..slot + WIDTH).for_each(|slot| prefetch_scales(task, slot));
    for first in (0..task.k().max(1)).step_by(QUADS * QUAD) {
        if task.k() > QUADS * QUAD {
            convert(x, t, first, buffer);
        }
        for i in (0..WIDTH).step_by(P) {
            // Not with `from_fn`: a closure has this function's features and cannot be inlined into
            // a function without them.
            let mut panels = [&[][..]; P];
            for (p, panel) in panels.iter_mut().enumerate() {
                let quads = task.panel(slot + i + p);
                *panel = &quads[first / QUAD..(first / QUAD + QUADS).min(quads.len())];
            }
            let fetch = (chunk.ahead, next[i % next.len()].wrapping_add(first / QUAD));
            multiply::<R, P, WIDTH>(buffer, panels, fetch, first == 0, &mut sums[i..]);
        }
    }
    // The first weights of the next group are prefetched while the epilogue of this one
    // runs.
    for slot in slot + WIDTH..(slot + 2 * WIDTH).min(task.slots()) {
        task.panel(slot).iter().take(chunk.ahead).for_each(|line| prefetch::to_l1(line));
    }
    dequantize_tile::<128>(x, t, &mut sums[..R * WIDTH], WIDTH, task, slot, y);
}

/// The innermost tile: adds the products of the panels' quads to `R x P` of the sums `[R,
/// WIDTH]`, in registers. Prefetches weights at the distance `ahead`, and the `next` panel,
/// quad by quad. Kept out of line: 16 registers are too few for the surrounding code.
#[inline(never)]
#[avxvnni]
fn multiply<const R: usize, const P: usize, const WIDTH: usize>(
    buffer: &[BiasedRow; R],
    panels: [&[[i8; PANEL * QUAD]]; P],
    (ahead, next): (usize, *const [i8; PANEL * QUAD]),
    start: bool,
    sums: &mut [[f32; PANEL]],
) {
    let quads = panels[0].len();
    assert!(quads <= QUADS);
    // A constant for one row, a decoder step, where it matters.
    let ahead = if R == 1 { PREFETCH_DISTANCE[0] } else { ahead };
    for panel in panels {
        assert!(panel.len() == quads);
    }
    let mut acc = [[[_mm256_setzero_si256(); 2]; P]; R];
    if !start {
        for r in 0..R {
            for p in 0..P {
                let [low, high] = load(&sums[r * WIDTH + p]);
                acc[r][p] = [_mm256_castps_si256(low), _mm256_castps_si256(high)];
            }
        }
    }
    for q in 0..quads {
        if R > 2 {
            prefetch::to_l2(next.wrapping_add(q));
        }
        for p in 0..P {
            prefetch::to_l1(panels[p].as_ptr().wrapping_add(q + ahead));
            let w = load_quads(&panels[p][q]);
            for r in 0..R {
                let x = _mm256_set1_epi32(i32::from_ne_bytes(buffer[r][q]));
                acc[r][p][0] = _mm256_dpbusd_avx_epi32(acc[r][p][0], x, w[0]);
                acc[r][p][1] = _mm256_dpbusd_avx_epi32(acc[r][p][1], x, w[1]);
            }
        }
    }
    for r in 0..R {
        for p in 0..P {
            let [low, high] = acc[r][p];
            store(&mut sums[r * WIDTH + p], [_mm256_castsi256_ps(low), _mm256_castsi256_ps(high)]);
        }
    }
}

/// A quad of all outputs of a panel.
#[inline]
#[avxvnni]
fn load_quads(src: &[i8; PANEL * QUAD]) -> [__m256i; 2] {
    let (halves, _) = src.as_chunks::<BYTES>();
    [load_bytes(&halves[0]), load_bytes(&halves[1])]
}

/// `x + 128`.
#[inline]
#[avxvnni]
fn unsigned(x: &[i8; BYTES]) -> __m256i {
    _mm256_xor_si256(load_bytes(x), _mm256_set1_epi8(i8::MIN))
}

#[inline]
#[avxvnni]
fn load_bytes(src: &[i8; BYTES]) -> __m256i {
    // SAFETY: `src` is 32 readable bytes; the load needs no alignment.
    unsafe { _mm256_loadu_si256(src.as_ptr().cast()) }
}

#[inline]
#[avxvnni]
fn store_bytes(dst: &mut [u8; BYTES], v: __m256i) {
    // SAFETY: `dst` is 32 writable bytes; the store needs no alignment.
    unsafe { _mm256_storeu_si256(dst.as_mut_ptr().cast(), v) }
}
