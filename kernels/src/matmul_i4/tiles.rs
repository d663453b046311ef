//! The processing order of all back-ends except AVX2: tiles of up to `ROWS` rows, with inputs padded to whole
//! groups, pass each chunk of panels. Inlined, so that it has the features of its caller.

use crate::gemm::{GemmTask, tiles};
use crate::mat::MatMut;
use crate::matmul_i8::input::QuantInput;
use crate::pack::{BLOCK, GROUP, NIBBLE_OFFSET, PANEL, PackedI4, QUAD, SPAN_BLOCKS, SPAN_GROUPS};
use crate::tiling::Tiling;

/// Groups whose inputs are held at once: 4 rows are 8 KiB, which stay in L1 beside the weights.
pub(super) const GROUPS: usize = 64;
/// Blocks of a panel that has [`GROUPS`] groups.
pub(super) const HELD_BLOCKS: usize = GROUPS / SPAN_GROUPS * SPAN_BLOCKS;
/// Bytes of weights per chunk, which stays in L2 while tiles of rows pass.
const CHUNK_BYTES: usize = 256 << 10;
/// Panels whose epilogue runs at once: a gate and an up panel.
const WIDTH: usize = 2;

/// Inputs of some rows with the initial values of their groups' sums, since a nibble is a code plus 8:
/// `-NIBBLE_OFFSET` times the sums of the inputs.
pub(super) struct Inputs<G, const ROWS: usize> {
    pub(super) groups: [[G; GROUPS]; ROWS],
    pub(super) start: [[i32; GROUPS]; ROWS],
}

/// Place of the sums `[rows, width]` whose epilogue runs at once.
#[derive(Clone, Copy)]
pub(super) struct OutputTile {
    /// First row.
    pub(super) t: usize,
    /// First slot.
    pub(super) slot: usize,
    /// Number of slots.
    pub(super) width: usize,
}

/// The multiplication of one back-end.
pub(super) trait Kernel<const ROWS: usize>: Copy {
    /// The inputs of a group in the format of the loops.
    type Group: Copy + Default;

    /// Converts a group's inputs.
    fn group(inputs: &[i8; GROUP]) -> Self::Group;

    /// Adds the products of the first `sums.len()` rows of `inputs` with the spans of a panel, [`HELD_BLOCKS`] at most.
    fn multiply(self, inputs: &Inputs<Self::Group, ROWS>, weights: &[[u8; BLOCK]], sums: &mut [[i32; PANEL]]);

    /// Scales the integer sums of `tile` to floats, and applies the epilogue. The sums are stored as bits of floats.
    fn finish(
        self,
        x: &QuantInput,
        tile: OutputTile,
        sums: &mut [[f32; PANEL]],
        task: &GemmTask<PackedI4>,
        y: &mut MatMut<f32>,
    );
}

/// Sizes at which the loops change, with the `rows` of a back-end's tiles.
pub(super) fn tiling(rows: &'static [usize]) -> Tiling {
    Tiling {
        rows,
        outputs: &[PANEL, WIDTH * PANEL],
        inputs: &[QUAD, 2 * QUAD, GROUP, PANEL * QUAD, GROUPS * GROUP],
        held: 0,
        chunk: 2 * CHUNK_BYTES,
    }
}

/// The product.
#[inline(always)]
pub(super) fn run<K: Kernel<ROWS>, const ROWS: usize>(
    kernel: K,
    x: &QuantInput,
    task: &GemmTask<PackedI4>,
    mut y: MatMut<f32>,
) {
    let mut inputs = Inputs { groups: [[K::Group::default(); GROUPS]; ROWS], start: [[0; GROUPS]; ROWS] };
    let panel = 2 * task.k() * QUAD;
    let width = (CHUNK_BYTES / panel.max(1) / WIDTH).max(1) * WIDTH;
    let chunks = task.k().div_ceil(GROUP).div_ceil(GROUPS);
    for first in (0..task.slots()).step_by(width) {
        let slots = first..(first + width).min(task.slots());
        for (t, rows) in tiles(x.rows.rows(), ROWS) {
            prepare(x, (t, rows), 0, K::group, &mut inputs);
            for slot in slots.clone().step_by(WIDTH) {
                let width = WIDTH.min(slots.end - slot);
                let mut exact = [[[0; PANEL]; ROWS]; WIDTH];
                for chunk in 0..chunks {
                    if chunks > 1 {
                        prepare(x, (t, rows), chunk * GROUPS, K::group, &mut inputs);
                    }
                    for (i, exact) in exact[..width].iter_mut().enumerate() {
                        let panel = task.panel(slot + i);
                        let blocks = chunk * HELD_BLOCKS..((chunk + 1) * HELD_BLOCKS).min(panel.len());
                        kernel.multiply(&inputs, &panel[blocks], &mut exact[..rows]);
                    }
                }
                let mut sums = [[[0.0; PANEL]; WIDTH]; ROWS];
                let sums = &mut sums.as_flattened_mut()[..rows * width];
                for (i, exact) in exact[..width].iter().enumerate() {
                    for (sums, exact) in sums[i..].iter_mut().step_by(width).zip(exact) {
                        *sums = exact.map(|sum: i32| f32::from_bits(sum.cast_unsigned()));
                    }
                }
                kernel.finish(x, OutputTile { t, slot, width }, sums, task, &mut y);
            }
        }
    }
}

/// Copies the inputs of `rows` rows from `t` on, from group `first` on and as many as `inputs` holds, padded with
/// zeros to a whole group and converted by `convert`.
#[inline(always)]
pub(super) fn prepare<G, const ROWS: usize>(
    x: &QuantInput,
    (t, rows): (usize, usize),
    first: usize,
    convert: impl Fn(&[i8; GROUP]) -> G,
    inputs: &mut Inputs<G, ROWS>,
) {
    let columns = first * GROUP..((first + GROUPS) * GROUP).min(x.rows.cols());
    for r in 0..rows {
        let (full, tail) = x.rows.row(t + r)[columns.clone()].as_chunks::<GROUP>();
        let mut padded = [0; GROUP];
        padded[..tail.len()].copy_from_slice(tail);
        let groups = full.iter().chain((!tail.is_empty()).then_some(&padded));
        for ((codes, group), start) in groups.zip(&mut inputs.groups[r]).zip(&mut inputs.start[r]) {
            *group = convert(codes);
            *start = -i32::from(NIBBLE_OFFSET) * codes.iter().map(|&x| i32::from(x)).sum::<i32>();
        }
    }
}
