//! 16 x 16 outputs and 64 inputs per instruction: `tdpbssd`, signed by signed bytes, so that nothing needs correction.
//!
//! The packed weights are the instruction's own layout: 16 quads of one panel, 1 KiB, are one tile. Rows of inputs are
//! gathered into tiles on the stack, as many as there is room for, and pass by each pair of panels, block by block. While
//! the tiles of one block are multiplied, the sums of the block before are ended, a few rows per step, and the next
//! pair of panels comes to L2. Up to [`FEW_ROWS`] rows, most of a tile would be empty: they are left to VNNI.

use super::QuantInput;
use super::avx512vnni::{self, Job, finish};
use crate::amx::{Aligned, BYTES, TILE, Tiles};
use crate::mat::MatMut;
use crate::math::avx512vnni::gelu_tanh;
use crate::matmul_f32::avx512vnni::{load, load_part, store};
use crate::matmul_f32::{Activation, Epilogue};
use crate::pack::{PANEL, PackedI8};
use core::arch::x86_64::*;
use core::mem::MaybeUninit;

/// Rows that VNNI multiplies sooner.
const FEW_ROWS: usize = 6;
/// Rows of inputs in work.
const ROWS: usize = 2 * TILE;
/// Panels in work, of which gated products need an even number.
const WIDTH: usize = 2;
/// Tiles of inputs gathered at once: 256 rows of 768 inputs are 192 KiB.
const ROOM: usize = 256;
/// Bytes of outputs that the rows gathered at once reach over at most, where there are more than two blocks of them:
/// each pair of panels writes two lines of each row, whose neighbours are to be in L2 still when the next pair comes.
const REACH: usize = 512 << 10;
/// Bytes of weights in work at once, which stay in L2 while blocks of rows go by.
const CHUNK_BYTES: usize = 768 << 10;

/// Panels of sums in one block: integers as bits in the place of the floats that they become.
const SUMS: usize = ROWS * WIDTH;

/// 16 rows of 64 bytes.
type Tile = [[i8; BYTES]; TILE];
/// The same of inputs: not cleared before rows are gathered, so that what nobody multiplies or reads costs nothing.
type Inputs = [MaybeUninit<[i8; BYTES]>; TILE];
/// Sums of one block.
type Sums = [[f32; PANEL]; SUMS];

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul(x: QuantInput, w: PackedI8, end: Epilogue, y: MatMut<f32>) {
    if x.rows.rows() <= FEW_ROWS {
        avx512vnni::matmul(x, w, end, y);
    } else {
        run(&x, &Job::Plain(w, end), y);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul_gated(x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>) {
    if x.rows.rows() <= FEW_ROWS {
        avx512vnni::matmul_gated(x, gate, up, y);
    } else {
        run(&x, &Job::Gated(gate, up), y);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn run(x: &QuantInput, job: &Job, mut y: MatMut<f32>) {
    // SAFETY: only the `Amx` arm of the products leads here.
    let tiles = unsafe { Tiles::new() };
    let mut room = Aligned([const { [const { MaybeUninit::uninit() }; TILE] }; ROOM]);
    let mut sums = Aligned([[[0.0; PANEL]; SUMS]; 2]);
    let [mut sums, mut before] = sums.0.each_mut();
    let (rows, steps) = (x.rows.rows(), job.k().div_ceil(BYTES));
    let reach = size_of::<f32>() * y.stride().max(1) / if matches!(job, Job::Gated(..)) { 2 } else { 1 };
    let group = (ROOM / 2 / steps.max(1)).min((REACH / reach / ROWS).max(2)).max(1) * ROWS;
    let width = (CHUNK_BYTES / (PANEL * job.k().max(1)) / WIDTH).max(1) * WIDTH;
    let mut ending = Ending::NONE;
    for first in (0..job.slots()).step_by(width) {
        let end = (first + width).min(job.slots());
        for t in (0..rows).step_by(group) {
            let part = (rows - t).min(group);
            let whole = steps <= ROOM / 2;
            if whole {
                gather(x, t, part, 0, steps, &mut room.0);
            }
            for slot in (first..end).step_by(WIDTH) {
                let next = match slot + WIDTH {
                    next if next < end || t + part == rows => next,
                    _ => first,
                };
                let work = Work { x, job, slot, end, next, blocks: part.div_ceil(ROWS) };
                for block in 0..work.blocks {
                    let rows = (part - block * ROWS).min(ROWS);
                    let t = t + block * ROWS;
                    let inputs = if whole { &mut room.0[block * 2 * steps..][..2 * steps] } else { &mut room.0[..] };
                    work.block(&tiles, (t, rows, block), whole, inputs, sums, (&mut ending, before), &mut y);
                    ending.all(x, job, before, &mut y);
                    ending = Ending::new(job, t, rows, slot, work.panels());
                    (sums, before) = (before, sums);
                }
            }
        }
    }
    ending.all(x, job, before, &mut y);
}

/// The inputs from `first` on of `rows` rows from `t` on, `steps` steps of 32 rows at a time. Whatever stands behind the last row
/// makes sums that nobody reads.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn gather(x: &QuantInput, t: usize, rows: usize, first: usize, steps: usize, room: &mut [Inputs]) {
    let last = (first + steps * BYTES).min(x.rows.cols());
    for r in 0..rows {
        let (whole, part) = x.rows.row(t + r)[first..last].as_chunks::<BYTES>();
        let (tiles, _) = room[r / ROWS * 2 * steps..][..2 * steps].as_chunks_mut::<2>();
        for (tiles, whole) in tiles.iter_mut().zip(whole) {
            tiles[r % ROWS / TILE][r % TILE].write(*whole);
        }
        if !part.is_empty() {
            let mut padded = [0; BYTES];
            padded[..part.len()].copy_from_slice(part);
            tiles[whole.len()][r % ROWS / TILE][r % TILE].write(padded);
        }
    }
}

/// A pair of panels with the rows that were gathered.
struct Work<'a, 'b> {
    x: &'a QuantInput<'b>,
    job: &'a Job<'b>,
    slot: usize,
    /// The slot behind the last that may be in work.
    end: usize,
    /// The slot that will be in work next.
    next: usize,
    /// Blocks of rows.
    blocks: usize,
}

impl Work<'_, '_> {
    fn panels(&self) -> usize {
        (self.end - self.slot).min(WIDTH)
    }

    /// One block of rows, from the first input to the last: `(first row, rows, which block)`.
    #[expect(clippy::too_many_arguments, reason = "one block of a product, each operand named")]
    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    fn block(
        &self,
        tiles: &Tiles,
        (t, rows, block): (usize, usize, usize),
        whole: bool,
        inputs: &mut [Inputs],
        sums: &mut Sums,
        mut before: (&mut Ending, &mut Sums),
        y: &mut MatMut<f32>,
    ) {
        let panels = self.panels();
        // Not by `from_fn`: a closure has this function's features and cannot be inlined into one that has not.
        let (mut quads, mut ahead) = ([&[][..]; WIDTH], [&[][..]; WIDTH]);
        // Each block brings a share of the next panels. One tile of rows is done as soon as its weights are there: 3 to 8 % slower.
        let lines = if rows <= TILE && self.blocks == 1 { 0 } else { TILE.div_ceil(self.blocks) };
        for p in 0..WIDTH {
            quads[p] = self.job.panel(self.slot + p.min(panels - 1));
            if self.next + p < self.job.slots() {
                let next = self.job.panel(self.next + p);
                ahead[p] = &next[(block * lines * next.len() / TILE).min(next.len())..];
            }
        }
        let most = if whole { (inputs.len() / 2).max(1) } else { ROOM / 2 };
        for i in 0..quads[0].len().div_ceil(most * TILE).max(1) {
            let part = i * most * TILE..((i + 1) * most * TILE).min(quads[0].len());
            if !whole {
                gather(self.x, t, rows, i * most * BYTES, most, inputs);
            }
            let mut step = Steps {
                tiles,
                inputs,
                quads: [&quads[0][part.clone()], &quads[1][part.clone()]],
                ahead: [&ahead[0][part.start.min(ahead[0].len())..], &ahead[1][part.start.min(ahead[1].len())..]],
                lines,
                start: i == 0,
                x: self.x,
                job: self.job,
            };
            match (rows <= TILE, panels) {
                (true, WIDTH) => step.multiply::<1, WIDTH>(sums, &mut before, y),
                (true, _) => step.multiply::<1, 1>(sums, &mut before, y),
                (false, WIDTH) => step.multiply::<2, WIDTH>(sums, &mut before, y),
                (false, _) => step.multiply::<2, 1>(sums, &mut before, y),
            }
        }
    }
}

/// Steps of 64 inputs.
struct Steps<'a, 'b> {
    tiles: &'a Tiles,
    inputs: &'a [Inputs],
    quads: [&'a [[i8; BYTES]]; WIDTH],
    ahead: [&'a [[i8; BYTES]]; WIDTH],
    lines: usize,
    start: bool,
    x: &'a QuantInput<'b>,
    job: &'a Job<'b>,
}

impl Steps<'_, '_> {
    /// Adds the products of `R` tiles of rows with the quads of `P` panels to `sums [rows, P]`, or starts them.
    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    fn multiply<const R: usize, const P: usize>(
        &mut self,
        sums: &mut Sums,
        (ending, before): &mut (&mut Ending, &mut Sums),
        y: &mut MatMut<f32>,
    ) {
        if self.start {
            self.tiles.zero();
        } else {
            self.tiles.load_sums::<R, P>(sums);
        }
        let (first, rest) = self.quads[0].as_chunks::<TILE>();
        let (second, _) = self.quads[1].as_chunks::<TILE>();
        let (inputs, _) = self.inputs.as_chunks::<2>();
        assert!(second.len() == first.len() && inputs.len() >= first.len());
        let rows = ending.rows.div_ceil(first.len().max(1));
        for (i, ((first, second), x)) in first.iter().zip(second).zip(inputs).enumerate() {
            step::<R, P>(self.tiles, x, [first, second]);
            for ahead in &self.ahead[..P] {
                ahead.iter().skip(i * self.lines).take(self.lines).for_each(fetch);
            }
            for _ in 0..rows {
                ending.row(self.x, self.job, before, y);
            }
        }
        if !rest.is_empty() {
            let mut last = Aligned([[[0; BYTES]; TILE]; WIDTH]);
            for (last, quads) in last.0.iter_mut().zip(self.quads) {
                last[..rest.len()].copy_from_slice(&quads[first.len() * TILE..]);
            }
            step::<R, P>(self.tiles, &inputs[first.len()], last.0.each_ref());
        }
        self.tiles.store_sums::<R, P>(sums);
    }
}

/// 64 inputs of `R` tiles of rows with `P` panels.
#[inline]
fn step<const R: usize, const P: usize>(tiles: &Tiles, x: &[Inputs; 2], w: [&Tile; WIDTH]) {
    tiles.load::<4, _>(&x[0]);
    tiles.load::<6, _>(w[0]);
    tiles.multiply_i8::<0, 4, 6>();
    if R == 2 {
        tiles.load::<5, _>(&x[1]);
        tiles.multiply_i8::<2, 5, 6>();
    }
    if P > 1 {
        tiles.load::<7, _>(w[1]);
        tiles.multiply_i8::<1, 4, 7>();
    }
    if R == 2 && P > 1 {
        tiles.multiply_i8::<3, 5, 7>();
    }
}

/// Brings a line of weights to L2.
#[inline]
fn fetch(line: &[i8; BYTES]) {
    // SAFETY: a prefetch is a hint: it reads nothing that the program can see and never faults.
    unsafe { _mm_prefetch::<_MM_HINT_T1>(line.as_ptr()) }
}

/// A block whose sums are complete, and how much of it has been ended.
struct Ending {
    t: usize,
    rows: usize,
    slot: usize,
    panels: usize,
    done: usize,
    /// What each row of whole panels needs; none where the block is ended at once.
    row: Option<RowEnd>,
}

#[derive(Clone, Copy)]
struct RowEnd {
    scale: [__m512; WIDTH],
    bias: Option<[__m512; WIDTH]>,
}

impl Ending {
    const NONE: Self = Self { t: 0, rows: 0, slot: 0, panels: 0, done: 0, row: None };

    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    fn new(job: &Job, t: usize, rows: usize, slot: usize, panels: usize) -> Self {
        let (first, whole) = match job {
            Job::Plain(w, end) => (slot * PANEL, (slot + WIDTH) * PANEL <= w.n() && end.activation == Activation::None),
            Job::Gated(gate, _) => (slot / 2 * PANEL, (slot / 2 + 1) * PANEL <= gate.n()),
        };
        let row = whole.then(|| {
            let (now, then) = (first..first + PANEL, first + PANEL..first + 2 * PANEL);
            match job {
                Job::Plain(w, end) => RowEnd {
                    scale: [load_part(&w.scale()[now.clone()]), load_part(&w.scale()[then.clone()])],
                    bias: end.bias.map(|bias| [load_part(&bias[now]), load_part(&bias[then])]),
                },
                Job::Gated(gate, up) => {
                    let scale = [load_part(&gate.scale()[now.clone()]), load_part(&up.scale()[now])];
                    RowEnd { scale, bias: None }
                }
            }
        });
        Self { t, rows, slot, panels, done: 0, row }
    }

    /// Ends one row, where there is one left and rows are ended one by one.
    #[inline]
    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    fn row(&mut self, x: &QuantInput, job: &Job, sums: &Sums, y: &mut MatMut<f32>) {
        let Some(end) = &self.row else { return };
        if self.done == self.rows {
            return;
        }
        let t = self.t + self.done;
        let (sums, _) = sums.as_chunks::<WIDTH>();
        let x_scale = _mm512_set1_ps(x.scale(t));
        let sums = &sums[self.done];
        self.done += 1;
        // The exact sum rounded to f32 once, then scalar's order of roundings.
        let mut v = [_mm512_setzero_ps(); WIDTH];
        for i in 0..WIDTH {
            let sum = _mm512_cvtepi32_ps(_mm512_castps_si512(load(&sums[i])));
            v[i] = _mm512_mul_ps(sum, _mm512_mul_ps(x_scale, end.scale[i]));
        }
        if let Some(bias) = &end.bias {
            for i in 0..WIDTH {
                v[i] = _mm512_add_ps(v[i], bias[i]);
            }
        }
        let first = self.slot * PANEL;
        match job {
            Job::Gated(..) => {
                let y = y.row_mut(t)[first / 2..].first_chunk_mut().expect("whole panels");
                store(y, _mm512_mul_ps(gelu_tanh(v[0]), v[1]));
            }
            Job::Plain(_, Epilogue { scatter: Some(scatter), .. }) => {
                let factor = _mm512_set1_ps(scatter.weight[t]);
                let (y, _) = y.row_mut(scatter.rows[t] as usize)[first..].as_chunks_mut();
                for i in 0..WIDTH {
                    let sum = _mm512_add_ps(load(&y[i]), _mm512_mul_ps(factor, v[i]));
                    store(&mut y[i], sum);
                }
            }
            Job::Plain(_, Epilogue { add, .. }) => {
                let (y, _) = y.row_mut(t)[first..].as_chunks_mut();
                for i in 0..WIDTH {
                    let v = if *add { _mm512_add_ps(load(&y[i]), v[i]) } else { v[i] };
                    store(&mut y[i], v);
                }
            }
        }
    }

    /// Ends all rows that are left.
    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    fn all(&mut self, x: &QuantInput, job: &Job, sums: &mut Sums, y: &mut MatMut<f32>) {
        if self.row.is_some() {
            while self.done < self.rows {
                self.row(x, job, sums, y);
            }
        } else if self.rows > 0 {
            finish::<0>(x, self.t, &mut sums[..self.rows * self.panels], self.panels, job, self.slot, y);
        }
    }
}
