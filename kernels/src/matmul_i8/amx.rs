//! 16 x 16 outputs and 64 inputs per instruction: `tdpbssd`, signed by signed bytes, which
//! needs no correction.
//!
//! The packed weights have the instruction's layout: 16 quads of one panel, 1 KiB, are one
//! tile. As many rows of inputs as fit are gathered into tiles on the stack, and pass each
//! pair of panels block by block. While the tiles of one block are multiplied, the epilogue of
//! the previous block runs, a few rows per step, and the next pair of panels is prefetched to L2.
//! Up to [`FEW_ROWS`] rows would leave most of a tile empty and are computed with VNNI.

use super::avx512vnni;
use super::avx512vnni::end::Scales;
use super::input::{GemmTask, QuantInput};
use crate::amx::{Aligned, BYTES, TILE, Tiles};
use crate::gemm::Epilogue;
use crate::gemm::avx512vnni::{MAX_PANELS, store_gated_tile, store_tile};
use crate::isa::{Amx, entry};
use crate::lanes::avx512vnni::{load, load_part, store, store_part};
use crate::mat::MatMut;
use crate::math::Activation;
use crate::math::avx512vnni::gelu_tanh;
use crate::pack::{PANEL, PackedI8, QUAD};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::x86_64::*;
use core::mem::MaybeUninit;
use core::ops::Range;
use umo_kernels_features::avx512vnni;

/// Number of rows up to which VNNI is faster.
const FEW_ROWS: usize = 6;
/// Rows per block.
const ROWS: usize = 2 * TILE;
/// Panels per block; gated products need an even number.
const WIDTH: usize = 2;
/// Tiles of inputs gathered at once: 256 rows of 768 inputs are 192 KiB.
const GATHERED_TILES: usize = 256;
/// Limit on the bytes between the first and the last output row of a group of more than two
/// blocks: each pair of panels writes two lines of each row, whose neighbours should still be
/// in L2 for the next pair.
const OUTPUT_SPAN: usize = 512 << 10;
/// Minimum of gated rows per step of the epilogue: the latencies of their divisions overlap.
const GATED_ROWS: usize = 6;
/// Bytes of weights per chunk, which stays in L2 while blocks of rows pass.
const CHUNK_BYTES: usize = 768 << 10;

/// Most rows gathered at once; their scales are stored too.
const GROUP: usize = 512;

/// Panels of sums in one block: integers, stored as bits of the floats that later replace them.
const SUMS: usize = ROWS * WIDTH;

/// 16 rows of 64 bytes.
type Tile = [[i8; BYTES]; TILE];
/// A tile of inputs. It is not initialized before rows are gathered: rows that are never read
/// cost nothing.
type Inputs = [MaybeUninit<[i8; BYTES]>; TILE];
/// Sums of one block.
type Sums = [[f32; PANEL]; SUMS];

entry! {
    pub(super) fn matmul(token: Amx, x: QuantInput, w: PackedI8, epilogue: Epilogue, y: MatMut<f32>, tuning: Tuning) {
        if x.rows.rows() <= FEW_ROWS {
            avx512vnni::matmul(token.into(), x, w, epilogue, y, tuning);
        } else {
            run(token, &x, &GemmTask::Plain(w, epilogue), y);
        }
    }

    pub(super) fn matmul_gated(token: Amx, x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>, tuning: Tuning) {
        if x.rows.rows() <= FEW_ROWS {
            avx512vnni::matmul_gated(token.into(), x, gate, up, y, tuning);
        } else {
            run(token, &x, &GemmTask::Gated(gate, up), y);
        }
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Amx) -> Tiling {
    Tiling {
        rows: &[FEW_ROWS, TILE, ROWS, GROUP],
        outputs: &[PANEL, WIDTH * PANEL],
        inputs: &[QUAD, BYTES, GATHERED_TILES / 2 * BYTES],
        held: GATHERED_TILES * TILE * BYTES,
        chunk: CHUNK_BYTES,
    }
}

#[avx512vnni]
fn run(token: Amx, x: &QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    let tiles = Tiles::new(token);
    let mut gathered_tiles = Aligned([const { [const { MaybeUninit::uninit() }; TILE] }; GATHERED_TILES]);
    let mut sums = Aligned([[[0.0; PANEL]; SUMS]; 2]);
    let [mut sums, mut before] = sums.0.each_mut();
    let mut scales = [[0.0; ROWS]; GROUP / ROWS];
    let (rows, steps) = (x.rows.rows(), task.k().div_ceil(BYTES));
    let row_bytes = size_of::<f32>() * y.stride().max(1) / if matches!(task, GemmTask::Gated(..)) { 2 } else { 1 };
    let group =
        (GATHERED_TILES / 2 / steps.max(1)).min((OUTPUT_SPAN / row_bytes / ROWS).max(2)).clamp(1, GROUP / ROWS) * ROWS;
    let width = (CHUNK_BYTES / (PANEL * task.k().max(1)) / WIDTH).max(1) * WIDTH;
    let whole = steps <= GATHERED_TILES / 2;
    let mut pending = PendingEpilogue::none();
    for first in (0..task.slots()).step_by(width) {
        let end = (first + width).min(task.slots());
        for t in (0..rows).step_by(group) {
            let part = (rows - t).min(group);
            for (r, scale) in scales.as_flattened_mut()[..part].iter_mut().enumerate() {
                *scale = x.scale(t + r);
            }
            let blocks = (t..t + part).step_by(ROWS).map(|t| (t, (rows - t).min(ROWS)));
            for (block, (t, rows)) in blocks.enumerate().filter(|&(_, (_, rows))| whole && !is_tile_loadable(x, rows)) {
                gather(x, t, rows, 0, steps, &mut gathered_tiles.0[block * 2 * steps..]);
            }
            for slot in (first..end).step_by(WIDTH) {
                let next = match slot + WIDTH {
                    next if next < end || t + part == rows => next,
                    _ => first,
                };
                let pair = Pair::new(task, slot, end, next, part);
                for (block, scales) in scales[..part.div_ceil(ROWS)].iter().enumerate() {
                    let (t, rows) = (t + block * ROWS, (part - block * ROWS).min(ROWS));
                    let mut work = BlockProduct { tiles: &tiles, x, task, pair: &pair, t, rows, block };
                    if whole {
                        let inputs = match is_tile_loadable(x, rows) {
                            true => Source::rows(x, t, rows),
                            false => Source::gathered(&gathered_tiles.0[block * 2 * steps..][..2 * steps]),
                        };
                        work.multiply_block(inputs, sums, (&mut pending, before), &mut y);
                    } else {
                        work.multiply_in_parts(&mut gathered_tiles.0, sums, (&mut pending, before), &mut y);
                    }
                    pending.all(x, task, before, &mut y);
                    pending.start(&pair, scales, t, rows);
                    (sums, before) = (before, sums);
                }
            }
        }
    }
    pending.all(x, task, before, &mut y);
}

/// Whether tiles can be loaded directly from a block of `rows` rows: whole tiles, whose rows
/// start at cache lines.
#[inline]
fn is_tile_loadable(x: &QuantInput, rows: usize) -> bool {
    let mat = &x.rows.mat;
    let (start, whole) =
        (mat.elements().as_ptr().addr(), mat.cols().is_multiple_of(BYTES) && rows.is_multiple_of(TILE));
    x.rows.index.is_none() && whole && start.is_multiple_of(BYTES) && mat.stride().is_multiple_of(BYTES)
}

/// Gathers the inputs from `first` on of `rows` rows from `t` on, for `steps` steps of one block.
/// The contents behind the last row produce sums that are never read.
#[avx512vnni]
fn gather(x: &QuantInput, t: usize, rows: usize, first: usize, steps: usize, gathered_tiles: &mut [Inputs]) {
    let last = (first + steps * BYTES).min(x.rows.cols());
    let (tiles, _) = gathered_tiles[..2 * steps].as_chunks_mut::<2>();
    for r in 0..rows {
        let (whole, part) = x.rows.row(t + r)[first..last].as_chunks::<BYTES>();
        for (tiles, whole) in tiles.iter_mut().zip(whole) {
            tiles[r / TILE][r % TILE].write(*whole);
        }
        if !part.is_empty() {
            let mut padded = [0; BYTES];
            padded[..part.len()].copy_from_slice(part);
            tiles[whole.len()][r / TILE][r % TILE].write(padded);
        }
    }
}

/// Location of a block's inputs.
#[derive(Clone, Copy)]
struct Source<'a> {
    bytes: &'a [MaybeUninit<i8>],
    /// Distances between the rows of a tile, between the upper and the lower tile, and
    /// between steps.
    row: usize,
    tile: usize,
    step: usize,
}

impl<'a> Source<'a> {
    /// Pairs of tiles.
    fn gathered(inputs: &'a [Inputs]) -> Self {
        let (start, len) = (inputs.as_ptr().cast(), size_of_val(inputs));
        // SAFETY: these are the bytes of `inputs`, which may be uninitialized in both
        // types.
        let bytes = unsafe { core::slice::from_raw_parts(start, len) };
        Self { bytes, row: BYTES, tile: TILE * BYTES, step: 2 * TILE * BYTES }
    }

    /// The rows from `t` on, loaded directly.
    fn rows(x: &QuantInput<'a>, t: usize, rows: usize) -> Self {
        let mat = x.rows.mat.row_range(t..t + rows);
        let elements = mat.elements();
        // SAFETY: these are the bytes of `elements`; initialized bytes are valid as
        // `MaybeUninit`.
        let bytes = unsafe { core::slice::from_raw_parts(elements.as_ptr().cast(), elements.len()) };
        Self { bytes, row: mat.stride(), tile: TILE * mat.stride(), step: BYTES }
    }

    /// Loads the upper tile of a step to `tmm4`, or the lower one (if `R` is 2) to `tmm5`.
    #[inline]
    fn load<const T: u8>(&self, tiles: &Tiles, step: usize) {
        let at = step * self.step + if T == 5 { self.tile } else { 0 };
        tiles.load_tile_streaming::<T, _>(&self.bytes[at..], self.row);
    }
}

/// A pair of panels, or the last one alone.
struct Pair<'a> {
    slot: usize,
    panels: usize,
    quads: [&'a [[i8; BYTES]]; WIDTH],
    /// The panels of the next pair, and the lines of each that a step prefetches to L2.
    ahead: [&'a [[i8; BYTES]]; WIDTH],
    lines: usize,
    epilogue: PairEpilogue,
}

/// Constants of the epilogue of a pair of panels.
#[derive(Clone, Copy)]
struct PairEpilogue {
    kind: EpilogueKind,
    scale: [__m512; WIDTH],
    /// -0 without a bias: adding it changes no sum.
    bias: [__m512; WIDTH],
}

impl<'a> Pair<'a> {
    /// The slots from `slot` on, below `end`, for `rows` rows; `next` is the next slot to
    /// be processed.
    #[avx512vnni]
    fn new(task: &GemmTask<'a>, slot: usize, end: usize, next: usize, rows: usize) -> Self {
        let panels = (end - slot).min(WIDTH);
        // Not with `from_fn`: a closure has this function's features and cannot be inlined into a
        // function without them.
        let (mut quads, mut ahead) = ([&[][..]; WIDTH], [&[][..]; WIDTH]);
        for p in 0..WIDTH {
            quads[p] = task.panel(slot + p.min(panels - 1));
            if next + p < task.slots() {
                ahead[p] = task.panel(next + p);
            }
        }
        // A single tile of rows is bound by its weights: prefetching makes it 3 to 8 % slower.
        let lines = if rows <= TILE { 0 } else { TILE.div_ceil(rows.div_ceil(ROWS)) };
        Self { slot, panels, quads, ahead, lines, epilogue: PairEpilogue::new(task, slot) }
    }
}

impl PairEpilogue {
    #[avx512vnni]
    fn new(task: &GemmTask, slot: usize) -> Self {
        let mut this = Self {
            kind: EpilogueKind::Block,
            scale: [_mm512_setzero_ps(); WIDTH],
            bias: [_mm512_set1_ps(-0.0); WIDTH],
        };
        match task {
            GemmTask::Gated(gate, up) if (slot / 2 + 1) * PANEL <= gate.n() => {
                let outputs = slot / 2 * PANEL..(slot / 2 + 1) * PANEL;
                this.scale = [load_part(&gate.scale()[outputs.clone()]), load_part(&up.scale()[outputs])];
                this.kind = EpilogueKind::Gated;
            }
            GemmTask::Plain(w, epilogue)
                if (slot + WIDTH) * PANEL <= w.n() && epilogue.activation == Activation::None =>
            {
                let (now, then) = (slot * PANEL..(slot + 1) * PANEL, (slot + 1) * PANEL..(slot + 2) * PANEL);
                this.scale = [load_part(&w.scale()[now.clone()]), load_part(&w.scale()[then.clone()])];
                if let Some(bias) = epilogue.bias {
                    this.bias = [load_part(&bias[now]), load_part(&bias[then])];
                }
                this.kind = match epilogue {
                    Epilogue { scatter: Some(_), .. } => EpilogueKind::Scatter,
                    Epilogue { add: true, .. } => EpilogueKind::Add,
                    _ => EpilogueKind::Store,
                };
            }
            _ => {}
        }
        this
    }
}

/// One block of rows with a pair of panels.
struct BlockProduct<'a, 'b> {
    tiles: &'a Tiles,
    x: &'a QuantInput<'b>,
    task: &'a GemmTask<'b>,
    pair: &'a Pair<'b>,
    /// The first row, the number of rows, and the block's index among those gathered.
    t: usize,
    rows: usize,
    block: usize,
}

impl BlockProduct<'_, '_> {
    /// Multiplies all inputs at once.
    #[inline]
    #[avx512vnni]
    fn multiply_block(
        &mut self,
        inputs: Source,
        sums: &mut Sums,
        before: (&mut PendingEpilogue, &Sums),
        y: &mut MatMut<f32>,
    ) {
        let (pair, quads) = (self.pair, self.pair.quads[0].len());
        let mut ahead = pair.ahead;
        for ahead in &mut ahead {
            *ahead = &ahead[(self.block * pair.lines * quads / TILE).min(ahead.len())..];
        }
        self.by_epilogue(Steps { inputs, quads: pair.quads, ahead, start: true }, sums, before, y);
    }

    /// Multiplies as many inputs at a time as fit into the buffer.
    #[avx512vnni]
    fn multiply_in_parts(
        &mut self,
        gathered_tiles: &mut [Inputs],
        sums: &mut Sums,
        before: (&mut PendingEpilogue, &Sums),
        y: &mut MatMut<f32>,
    ) {
        let (pair, most, all, (pending, before)) = (self.pair, GATHERED_TILES / 2, self.pair.quads[0].len(), before);
        for first in (0..all).step_by(most * TILE) {
            gather(self.x, self.t, self.rows, first / TILE * BYTES, most, gathered_tiles);
            let part = first..(first + most * TILE).min(all);
            let quads = [&pair.quads[0][part.clone()], &pair.quads[1][part]];
            let steps =
                Steps { inputs: Source::gathered(gathered_tiles), quads, ahead: [&[]; WIDTH], start: first == 0 };
            self.by_epilogue(steps, sums, (pending, before), y);
        }
    }

    #[inline]
    #[avx512vnni]
    fn by_epilogue(
        &mut self,
        steps: Steps,
        sums: &mut Sums,
        before: (&mut PendingEpilogue, &Sums),
        y: &mut MatMut<f32>,
    ) {
        match before.0.epilogue.kind {
            EpilogueKind::Block => self.by_shape::<BLOCK>(steps, sums, before, y),
            EpilogueKind::Gated => self.by_shape::<GATED>(steps, sums, before, y),
            EpilogueKind::Scatter => self.by_shape::<SCATTER>(steps, sums, before, y),
            EpilogueKind::Add => self.by_shape::<ADD>(steps, sums, before, y),
            EpilogueKind::Store => self.by_shape::<STORE>(steps, sums, before, y),
        }
    }

    #[inline]
    #[avx512vnni]
    fn by_shape<const KIND: u8>(
        &mut self,
        steps: Steps,
        sums: &mut Sums,
        before: (&mut PendingEpilogue, &Sums),
        y: &mut MatMut<f32>,
    ) {
        match (self.rows <= TILE, self.pair.panels) {
            (true, WIDTH) => self.multiply::<1, WIDTH, KIND>(steps, sums, before, y),
            (true, _) => self.multiply::<1, 1, KIND>(steps, sums, before, y),
            (false, WIDTH) => self.multiply::<2, WIDTH, KIND>(steps, sums, before, y),
            (false, _) => self.multiply::<2, 1, KIND>(steps, sums, before, y),
        }
    }

    /// Adds the products of `R` tiles of rows with the quads of `P` panels to `sums [rows,
    /// P]`, or starts the sums; meanwhile, runs the epilogue of rows of the previous block, of
    /// kind `KIND`.
    #[avx512vnni]
    fn multiply<const R: usize, const P: usize, const KIND: u8>(
        &mut self,
        steps: Steps,
        sums: &mut Sums,
        (pending, before): (&mut PendingEpilogue, &Sums),
        y: &mut MatMut<f32>,
    ) {
        if steps.start {
            self.tiles.zero();
        } else {
            self.tiles.load_sums::<R, P>(sums);
        }
        let (first, rest) = steps.quads[0].as_chunks::<TILE>();
        let (second, _) = steps.quads[1].as_chunks::<TILE>();
        assert!(second.len() == first.len());
        let even = pending.rows.div_ceil(first.len().max(1));
        let rows = if KIND == GATED { even.max(GATED_ROWS) } else { even };
        let mut outputs = Outputs::new(self, y, first.len());
        for (i, (first, second)) in first.iter().zip(second).enumerate() {
            step::<R, P>(self.tiles, (&steps.inputs, i), [first, second]);
            // Products of few rows are bound by the bandwidth of their weights.
            if R == 2 {
                outputs.prefetch_rows();
            }
            for ahead in &steps.ahead[..P] {
                let lines = (i * self.pair.lines).min(ahead.len())..((i + 1) * self.pair.lines).min(ahead.len());
                ahead[lines].iter().for_each(|line| prefetch::to_l2(line));
            }
            if KIND != BLOCK {
                pending.rows::<KIND>(rows, self.task, before, y);
            }
        }
        if !rest.is_empty() {
            let mut last = Aligned([[[0; BYTES]; TILE]; WIDTH]);
            for (last, quads) in last.0.iter_mut().zip(steps.quads) {
                last[..rest.len()].copy_from_slice(&quads[first.len() * TILE..]);
            }
            step::<R, P>(self.tiles, (&steps.inputs, first.len()), last.0.each_ref());
        }
        self.tiles.store_sums::<R, P>(sums);
    }
}

/// Outputs of a block, prefetched to L1 while it is multiplied and written during the next
/// block: they may be in another core's cache or the last-level cache.
struct Outputs<'a> {
    /// Start of row 0, and elements between rows.
    first: *const f32,
    stride: usize,
    /// Remaining rows of the block.
    t: Range<usize>,
    /// The destination rows of a scatter.
    scatter: Option<&'a [u32]>,
    /// Whether a row has outputs of two panels.
    two: bool,
    /// Rows prefetched per step.
    rows: usize,
}

impl<'a> Outputs<'a> {
    #[inline]
    fn new(work: &BlockProduct<'a, '_>, y: &MatMut<f32>, steps: usize) -> Self {
        let (output, two, scatter) = match work.task {
            GemmTask::Gated(..) => (work.pair.slot / 2 * PANEL, false, None),
            GemmTask::Plain(_, epilogue) => {
                (work.pair.slot * PANEL, work.pair.panels == WIDTH, epilogue.scatter.map(|to| to.rows))
            }
        };
        let t = work.t..work.t + work.rows;
        Self {
            first: y.row(0)[output..].as_ptr(),
            stride: y.stride(),
            t,
            scatter,
            two,
            rows: work.rows.div_ceil(steps.max(1)),
        }
    }

    /// Prefetches the outputs of the next rows.
    #[inline]
    fn prefetch_rows(&mut self) {
        for t in self.t.by_ref().take(self.rows) {
            let row = self.scatter.map_or(t, |rows| rows[t] as usize);
            let line = self.first.wrapping_add(row * self.stride);
            prefetch::for_write(line);
            if self.two {
                prefetch::for_write(line.wrapping_add(PANEL));
            }
        }
    }
}

/// Steps of 64 inputs.
struct Steps<'a> {
    inputs: Source<'a>,
    quads: [&'a [[i8; BYTES]]; WIDTH],
    ahead: [&'a [[i8; BYTES]]; WIDTH],
    start: bool,
}

/// 64 inputs of `R` tiles of rows with `P` panels. Rows bypass L1, where the panels stay for
/// the next block: four tiles from L2 take longer than four products, two do not.
#[inline]
fn step<const R: usize, const P: usize>(tiles: &Tiles, (x, i): (&Source, usize), w: [&Tile; WIDTH]) {
    x.load::<4>(tiles, i);
    if R == 2 {
        x.load::<5>(tiles, i);
    }
    tiles.load::<6, _>(w[0]);
    if P > 1 {
        tiles.load::<7, _>(w[1]);
    }
    tiles.multiply_i8::<0, 4, 6>();
    if R == 2 {
        tiles.multiply_i8::<2, 5, 6>();
    }
    if P > 1 {
        tiles.multiply_i8::<1, 4, 7>();
    }
    if R == 2 && P > 1 {
        tiles.multiply_i8::<3, 5, 7>();
    }
}

/// Kind of epilogue of a block's rows.
#[derive(Clone, Copy, PartialEq, Eq)]
enum EpilogueKind {
    /// All rows at once.
    Block,
    Gated,
    Scatter,
    Add,
    Store,
}

const BLOCK: u8 = EpilogueKind::Block as u8;
const GATED: u8 = EpilogueKind::Gated as u8;
const SCATTER: u8 = EpilogueKind::Scatter as u8;
const ADD: u8 = EpilogueKind::Add as u8;
const STORE: u8 = EpilogueKind::Store as u8;

/// A block whose sums are complete, and the progress of its epilogue.
struct PendingEpilogue {
    t: usize,
    rows: usize,
    slot: usize,
    panels: usize,
    done: usize,
    x_scale: [f32; ROWS],
    epilogue: PairEpilogue,
}

impl PendingEpilogue {
    #[avx512vnni]
    fn none() -> Self {
        let zero = [_mm512_setzero_ps(); WIDTH];
        let epilogue = PairEpilogue { kind: EpilogueKind::Block, scale: zero, bias: zero };
        Self { t: 0, rows: 0, slot: 0, panels: 0, done: 0, x_scale: [0.0; ROWS], epilogue }
    }

    /// Sets the rows, from `t` on, and the pair of panels.
    #[inline]
    #[avx512vnni]
    fn start(&mut self, pair: &Pair, scales: &[f32; ROWS], t: usize, rows: usize) {
        let &Pair { slot, panels, epilogue, .. } = pair;
        *self = Self { t, rows, slot, panels, done: 0, x_scale: *scales, epilogue };
    }

    /// Runs the epilogue of the next `count` rows, or as many as are left.
    #[inline]
    #[avx512vnni]
    fn rows<const KIND: u8>(&mut self, count: usize, task: &GemmTask, sums: &Sums, y: &mut MatMut<f32>) {
        let (sums, _) = sums.as_chunks::<WIDTH>();
        let rows = self.done..(self.done + count).min(self.rows);
        self.done = rows.end;
        let (first, t) = (self.slot * PANEL, self.t);
        for r in rows {
            // The exact sums rounded to f32 once, then scalar's order of roundings.
            let x_scale = _mm512_set1_ps(self.x_scale[r]);
            let mut v = [_mm512_setzero_ps(); WIDTH];
            for i in 0..WIDTH {
                let sum = _mm512_cvtepi32_ps(_mm512_castps_si512(load(&sums[r][i])));
                v[i] = _mm512_mul_ps(sum, _mm512_mul_ps(x_scale, self.epilogue.scale[i]));
            }
            if KIND == GATED {
                let y = y.row_mut(t + r)[first / 2..].first_chunk_mut().expect("whole panels");
                store(y, _mm512_mul_ps(gelu_tanh(v[0]), v[1]));
                continue;
            }
            for (v, &bias) in v.iter_mut().zip(&self.epilogue.bias) {
                *v = _mm512_add_ps(*v, bias);
            }
            let mut row = t + r;
            if KIND == SCATTER
                && let GemmTask::Plain(_, Epilogue { scatter: Some(scatter), .. }) = task
            {
                let factor = _mm512_set1_ps(scatter.weight[row]);
                row = scatter.rows[row] as usize;
                for v in &mut v {
                    *v = _mm512_mul_ps(factor, *v);
                }
            }
            let y = y.row_mut(row)[first..].as_chunks_mut().0.first_chunk_mut::<WIDTH>().expect("whole panels");
            for i in 0..WIDTH {
                let sum = if KIND == STORE { v[i] } else { _mm512_add_ps(load(&y[i]), v[i]) };
                store(&mut y[i], sum);
            }
        }
    }

    /// Runs the epilogue of all remaining rows.
    #[avx512vnni]
    fn all(&mut self, x: &QuantInput, task: &GemmTask, sums: &mut Sums, y: &mut MatMut<f32>) {
        match self.epilogue.kind {
            _ if self.rows == self.done => {}
            EpilogueKind::Block => {
                dequantize_tile(x, self.t, &mut sums[..self.rows * self.panels], self.panels, task, self.slot, y)
            }
            EpilogueKind::Gated => self.rows::<GATED>(ROWS, task, sums, y),
            EpilogueKind::Scatter => self.rows::<SCATTER>(ROWS, task, sums, y),
            EpilogueKind::Add => self.rows::<ADD>(ROWS, task, sums, y),
            EpilogueKind::Store => self.rows::<STORE>(ROWS, task, sums, y),
        }
        self.done = self.rows;
    }
}

/// Scales the integer sums `[rows, width]` of the rows from `t` on with the slots from `slot`
/// on to floats, and applies the epilogue.
#[avx512vnni]
fn dequantize_tile(
    x: &QuantInput,
    t: usize,
    sums: &mut [[f32; PANEL]],
    width: usize,
    task: &GemmTask,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut scales = [Scales::<0>::of(task, slot); MAX_PANELS];
    for (i, scales) in scales.iter_mut().enumerate().take(width).skip(1) {
        *scales = Scales::of(task, slot + i);
    }
    // Integers are stored as bits of the floats that replace them.
    let value =
        |sum: &[f32; PANEL], x_scale: __m512, i: usize| scales[i].value(_mm512_castps_si512(load(sum)), x_scale);
    match task {
        // The most common epilogue, in one pass.
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
        GemmTask::Plain(_, epilogue) => store_tile(sums, width, t, slot * PANEL, epilogue, y),
        GemmTask::Gated(..) => store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, y),
    }
}
