//! Nibbles times bytes, summed in words by `vpmaddubsw`, which is exact here, since a nibble has 4
//! bits; and one `vpmaddwd` per group, which multiplies the words by the group's multiplier and adds
//! them in pairs.
//!
//! ```text
//! half a block         o0 o0 o0 o0 o1 .. o7     32 bytes, two codes each: low nibbles one register, high another
//! times inputs          0  1  2  3  0 ..  3     the same four in every output
//! words                 o0    o0    o1 ..  o7   two sums per output: of a group's 8 quads, 16 products each
//! times multipliers      m0    m0    m1 ..  m7
//! sums                     o0          o1 ..    one per output
//! ```
//!
//! A nibble is its code plus 8, so that a group's words start at -8 times the sums of its inputs.
//! Intermediate values may wrap: the final one is a sum of 16 products of at most 8 * 128 each.

use super::tiles::{GROUPS, HELD_BLOCKS};
use crate::gemm::avx2::{store_gated_tile, store_tile};
use crate::gemm::{Epilogue, GemmTask, tiles};
use crate::isa::{Avx2, entry};
use crate::lanes::avx2::{load_two, store_two};
use crate::mat::MatMut;
use crate::matmul_i8::input::QuantInput;
use crate::pack::{BLOCK, GROUP, NIBBLE_OFFSET, PANEL, PackedI4, QUAD, Span, spans};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::x86_64::*;
use umo_kernels_features::avx2;

/// Rows of the largest tile: 4 rows of a half panel are 4 word sums and 4 totals, which leaves 8
/// registers for codes, an input and a product.
const ROWS: usize = 4;
/// Rows of a memory-bound tile: both halves of a panel are read at once.
const FEW_ROWS: usize = 2;
/// Prefetch distance in blocks.
const PREFETCH_DISTANCE: usize = 128;
/// Bytes of weights per chunk, which stays in L2 while tiles of rows pass.
const CHUNK_BYTES: usize = 256 << 10;
/// Quads of a group.
const GROUP_QUADS: usize = GROUP / QUAD;
/// Outputs of a register of sums.
const OUTPUTS: usize = 8;
/// Registers of sums of a panel.
const REGISTERS: usize = PANEL / OUTPUTS;
/// Panels whose epilogue runs at once: a gate and an up panel.
const WIDTH: usize = 2;

/// Inputs of some rows with the initial values of their groups' sums.
struct Inputs<const TILE: usize> {
    /// Quads as words of 32 bits, so that one is loaded into all lanes.
    quads: [[[i32; GROUP_QUADS]; GROUPS]; TILE],
    /// Two words, for the first and the second half of every quad.
    start: [[i32; GROUPS]; TILE],
}

entry! {
    pub(super) fn matmul(_token: Avx2, x: QuantInput, w: PackedI4, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(_token: Avx2, x: QuantInput, gate: PackedI4, up: PackedI4, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Gated(gate, up), y);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Avx2) -> Tiling {
    Tiling {
        rows: &[1, FEW_ROWS, ROWS],
        outputs: &[PANEL, WIDTH * PANEL],
        inputs: &[QUAD, 2 * QUAD, GROUP, PANEL * QUAD, GROUPS * GROUP],
        held: 0,
        chunk: 2 * CHUNK_BYTES,
    }
}

#[avx2]
fn run(x: &QuantInput, task: &GemmTask<PackedI4>, y: MatMut<f32>) {
    // Clearing the larger buffer takes longer than some products of few rows.
    match x.rows.rows() {
        1 => product::<1>(x, task, y),
        FEW_ROWS => product::<FEW_ROWS>(x, task, y),
        _ => product::<ROWS>(x, task, y),
    }
}

/// The product in tiles of up to `TILE` rows.
#[avx2]
fn product<const TILE: usize>(x: &QuantInput, task: &GemmTask<PackedI4>, mut y: MatMut<f32>) {
    let mut inputs = Inputs { quads: [[[0; GROUP_QUADS]; GROUPS]; TILE], start: [[0; GROUPS]; TILE] };
    let mut sums = [[[0.0; PANEL]; WIDTH]; TILE];
    let rows = x.rows.rows();
    let panel = 2 * task.k() * QUAD;
    let width = (CHUNK_BYTES / panel.max(1) / WIDTH).max(1) * WIDTH;
    for first in (0..task.slots()).step_by(width) {
        let slots = first..(first + width).min(task.slots());
        for (t, rows) in tiles(rows, TILE) {
            convert(x, t, rows, 0, &mut inputs);
            for slot in slots.clone().step_by(WIDTH) {
                let width = WIDTH.min(slots.end - slot);
                let sums = &mut sums.as_flattened_mut()[..rows * width];
                for i in 0..width {
                    let sums = sums[i..].iter_mut().step_by(width);
                    let panel = task.panel(slot + i);
                    match rows {
                        1 => self::panel::<1, 2, TILE>(x, t, &mut inputs, panel, sums),
                        2 => self::panel::<2, 2, TILE>(x, t, &mut inputs, panel, sums),
                        3 => self::panel::<3, 1, TILE>(x, t, &mut inputs, panel, sums),
                        ROWS => self::panel::<ROWS, 1, TILE>(x, t, &mut inputs, panel, sums),
                        rows => unreachable!("a tile of {rows} rows"),
                    }
                }
                dequantize_tile(x, t, sums, width, task, slot, &mut y);
            }
        }
    }
}

/// Copies and sums the inputs from group `first` on of `rows` rows from `t` on, as many as `inputs`
/// holds.
#[avx2]
fn convert<const TILE: usize>(x: &QuantInput, t: usize, rows: usize, first: usize, inputs: &mut Inputs<TILE>) {
    let columns = first * GROUP..((first + GROUPS) * GROUP).min(x.rows.cols());
    for r in 0..rows {
        let (full, tail) = x.rows.row(t + r)[columns.clone()].as_chunks::<GROUP>();
        let mut padded = [0; GROUP];
        padded[..tail.len()].copy_from_slice(tail);
        let groups = full.iter().chain((!tail.is_empty()).then_some(&padded));
        for ((codes, quads), start) in groups.zip(&mut inputs.quads[r]).zip(&mut inputs.start[r]) {
            let codes = load(codes);
            store(quads, codes);
            *start = negative_sums(codes);
        }
    }
}

/// `-NIBBLE_OFFSET` times the sums of a group's inputs, as two words: for the first and the second halves of
/// all quads.
#[inline]
#[avx2]
fn negative_sums(x: __m256i) -> i32 {
    let pairs = _mm256_maddubs_epi16(_mm256_set1_epi8(NIBBLE_OFFSET), x);
    let four = _mm_add_epi16(_mm256_castsi256_si128(pairs), _mm256_extracti128_si256::<1>(pairs));
    let two = _mm_add_epi16(four, _mm_unpackhi_epi64(four, four));
    let one = _mm_add_epi16(two, _mm_shuffle_epi32::<1>(two));
    _mm_cvtsi128_si32(_mm_sub_epi16(_mm_setzero_si128(), one))
}

/// Exact sums of the `R` rows from `t` on with one panel, `H` of its registers at a time.
#[avx2]
fn panel<'s, const R: usize, const H: usize, const TILE: usize>(
    x: &QuantInput,
    t: usize,
    inputs: &mut Inputs<TILE>,
    panel: &[[u8; BLOCK]],
    sums: impl Iterator<Item = &'s mut [f32; PANEL]>,
) {
    let mut partial = [[_mm256_setzero_si256(); REGISTERS]; R];
    for (i, weights) in panel.chunks(HELD_BLOCKS).enumerate() {
        if x.rows.cols() > GROUPS * GROUP {
            convert(x, t, R, i * GROUPS, inputs);
        }
        multiply::<R, H, TILE>(inputs, weights, &mut partial);
    }
    for (partial, sums) in partial.iter().zip(sums) {
        store_two(sums, partial.map(|sum| _mm256_castsi256_ps(sum)));
    }
}

/// The innermost tile: `R` rows with `H` registers of the panel at a time.
#[avx2]
fn multiply<const R: usize, const H: usize, const TILE: usize>(
    inputs: &Inputs<TILE>,
    weights: &[[u8; BLOCK]],
    partial: &mut [[__m256i; REGISTERS]; R],
) {
    assert!(weights.len() <= HELD_BLOCKS);
    // Pointers: with length checks in the loop the compiler loads the inputs to other registers first.
    let (mut quads, mut start) = ([core::ptr::null(); R], [core::ptr::null(); R]);
    for r in 0..R {
        (quads[r], start[r]) = (inputs.quads[r].as_ptr(), inputs.start[r].as_ptr());
    }
    for first in (0..REGISTERS).step_by(H) {
        let mut totals = [[_mm256_setzero_si256(); H]; R];
        for r in 0..R {
            for h in 0..H {
                totals[r][h] = partial[r][first + h];
            }
        }
        for Span { first_group, multipliers, groups } in spans(weights) {
            for (g, (blocks, multipliers)) in (first_group..).zip(groups.iter().zip(multipliers)) {
                let mut words = [[_mm256_setzero_si256(); H]; R];
                for r in 0..R {
                    // SAFETY: the number of groups is at most that of the inputs.
                    words[r] = [_mm256_set1_epi32(unsafe { *start[r].wrapping_add(g) }); H];
                }
                for (j, block) in blocks.iter().enumerate() {
                    if first == 0 {
                        prefetch::to_l1((&raw const *block).wrapping_add(PREFETCH_DISTANCE));
                    }
                    let (halves, _) = block.as_chunks::<{ BLOCK / REGISTERS }>();
                    let (mut low, mut high) = ([_mm256_setzero_si256(); H], [_mm256_setzero_si256(); H]);
                    for h in 0..H {
                        (low[h], high[h]) = nibbles(&halves[first + h]);
                    }
                    for r in 0..R {
                        // SAFETY: as above.
                        let quads: &[i32; GROUP_QUADS] = unsafe { &*quads[r].wrapping_add(g) };
                        let (x_low, x_high) = (_mm256_set1_epi32(quads[2 * j]), _mm256_set1_epi32(quads[2 * j + 1]));
                        for h in 0..H {
                            words[r][h] = _mm256_add_epi16(words[r][h], _mm256_maddubs_epi16(low[h], x_low));
                            words[r][h] = _mm256_add_epi16(words[r][h], _mm256_maddubs_epi16(high[h], x_high));
                        }
                    }
                }
                for h in 0..H {
                    let multipliers = spread(multipliers, first + h);
                    for r in 0..R {
                        totals[r][h] = _mm256_add_epi32(totals[r][h], _mm256_madd_epi16(words[r][h], multipliers));
                    }
                }
            }
        }
        for r in 0..R {
            for h in 0..H {
                partial[r][first + h] = totals[r][h];
            }
        }
    }
}

/// The multipliers of the outputs of register `register`, each duplicated in two words.
#[inline]
#[avx2]
fn spread(multipliers: &[u8; PANEL], register: usize) -> __m256i {
    // SAFETY: `multipliers` is 16 readable bytes; the load needs no alignment.
    let all = _mm256_broadcastsi128_si256(unsafe { _mm_loadu_si128(multipliers.as_ptr().cast()) });
    // Moves byte `o` to the upper bytes of two words; 128 clears the lower ones.
    let of = |o: i32| (o << 24) | 0x80_0080 | (o << 8);
    let order = match register {
        0 => _mm256_setr_epi32(of(0), of(1), of(2), of(3), of(4), of(5), of(6), of(7)),
        _ => _mm256_setr_epi32(of(8), of(9), of(10), of(11), of(12), of(13), of(14), of(15)),
    };
    _mm256_srai_epi16::<8>(_mm256_shuffle_epi8(all, order))
}

/// Scales the integer sums `[rows, width]` of the rows from `t` on with the slots from `slot` on to
/// floats, and applies the epilogue. The sums are stored as bits of floats.
#[avx2]
pub(super) fn dequantize_tile(
    x: &QuantInput,
    t: usize,
    sums: &mut [[f32; PANEL]],
    width: usize,
    task: &GemmTask<PackedI4>,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    for i in 0..width {
        let (w, p) = task.slot(slot + i);
        let outputs = p * PANEL..((p + 1) * PANEL).min(w.n());
        let mut w_scale = [0.0; PANEL];
        w_scale[..outputs.len()].copy_from_slice(&w.scale()[outputs]);
        let w_scale = load_two(&w_scale);
        for (t, sum) in (t..).zip(sums[i..].iter_mut().step_by(width)) {
            let x_scale = _mm256_set1_ps(x.scale(t));
            let bits = load_two(sum);
            // The exact sum rounded to f32 once, then scalar's order of roundings.
            let value = [0, 1].map(|half| {
                let exact = _mm256_cvtepi32_ps(_mm256_castps_si256(bits[half]));
                _mm256_mul_ps(exact, _mm256_mul_ps(x_scale, w_scale[half]))
            });
            store_two(sum, value);
        }
    }
    match task {
        GemmTask::Plain(_, epilogue) => store_tile(sums, width, t, slot * PANEL, epilogue, y),
        GemmTask::Gated(..) => store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, y),
    }
}

/// The inputs of a group.
#[inline]
#[avx2]
fn load(src: &[i8; GROUP]) -> __m256i {
    // SAFETY: `src` is 32 readable bytes; the load needs no alignment.
    unsafe { _mm256_loadu_si256(src.as_ptr().cast()) }
}

#[inline]
#[avx2]
fn store(dst: &mut [i32; GROUP_QUADS], v: __m256i) {
    // SAFETY: `dst` is 32 writable bytes; the store needs no alignment.
    unsafe { _mm256_storeu_si256(dst.as_mut_ptr().cast(), v) }
}

/// The codes plus 8 of half a block: for a quad, and for the next.
#[inline]
#[avx2]
fn nibbles(half: &[u8; BLOCK / REGISTERS]) -> (__m256i, __m256i) {
    // SAFETY: `half` is 32 readable bytes; the load needs no alignment.
    let both = unsafe { _mm256_loadu_si256(half.as_ptr().cast()) };
    let nibbles = _mm256_set1_epi8(15);
    (_mm256_and_si256(both, nibbles), _mm256_and_si256(_mm256_srli_epi16::<4>(both), nibbles))
}
