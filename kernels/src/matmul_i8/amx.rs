//! 16 x 16 outputs and 64 inputs per instruction: `tdpbssd`, signed by signed bytes, so that nothing needs correction.
//!
//! The packed weights are the instruction's own layout: 16 quads of one panel, 1 KiB, are one tile. Rows of inputs are
//! gathered into tiles on the stack, 32 rows at a time. A product is 2 x 2 tiles of sums (1 x 4 where few rows are left):
//!
//! ```text
//!                  w: tmm6  tmm7    one panel each
//! x: tmm4 (rows  0..16)  tmm0  tmm1
//!    tmm5 (rows 16..32)  tmm2  tmm3
//! ```
//! Up to [`FEW_ROWS`] rows, most of a tile would be empty: they are left to VNNI.

use super::QuantInput;
use super::avx512vnni::{self, Job, finish};
use crate::mat::MatMut;
use crate::matmul_f32::Epilogue;
use crate::pack::{PANEL, PackedI8};
use core::arch::asm;
use core::marker::PhantomData;

/// Rows that VNNI multiplies sooner.
const FEW_ROWS: usize = 6;
/// Rows of a tile; also its quads of weights.
const TILE: usize = 16;
/// Rows of inputs in work.
const ROWS: usize = 2 * TILE;
/// Bytes of a tile's row: inputs in one step.
const BYTES: usize = 64;
/// Steps of inputs gathered at once, where there are few inputs and where there are many.
const STEPS: [usize; 2] = [16, 64];
/// Bytes of weights in work at once, which stay in L2 while blocks of rows go by.
const CHUNK_BYTES: usize = 768 << 10;

/// Panels of sums in one block: integers as bits in the place of the floats that they become.
const SUMS: usize = ROWS * 2;

/// 16 rows of 64 bytes.
type Tile = [[i8; BYTES]; TILE];

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
fn run(x: &QuantInput, job: &Job, y: MatMut<f32>) {
    let tiles = Configured::new();
    if job.k() <= STEPS[0] * BYTES {
        product::<{ STEPS[0] }>(&tiles, x, job, y);
    } else {
        product::<{ STEPS[1] }>(&tiles, x, job, y);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn product<const MOST: usize>(tiles: &Configured, x: &QuantInput, job: &Job, mut y: MatMut<f32>) {
    let mut inputs = [[[[0; BYTES]; TILE]; 2]; MOST];
    let mut sums = [[0.0; PANEL]; SUMS];
    // A multiple of the panels that any block takes at once.
    let width = (CHUNK_BYTES / (PANEL * job.k().max(1)) / 4).max(1) * 4;
    for first in (0..job.slots()).step_by(width) {
        let end = (first + width).min(job.slots());
        for t in (0..x.rows.rows()).step_by(ROWS) {
            let rows = (x.rows.rows() - t).min(ROWS);
            gather(x, t, rows, 0, &mut inputs);
            let mut slot = first;
            while slot < end {
                let panels = match end - slot {
                    4.. if rows <= TILE => 4,
                    1 => 1,
                    _ => 2,
                };
                block(tiles, x, t, rows, &mut inputs, job, slot, panels, &mut sums, &mut y);
                slot += panels;
            }
        }
    }
}

/// The inputs from `first` on of the rows from `t` on, in tiles, as many steps as `inputs` holds. Whatever stands behind the
/// last input meets weights that are zero, and behind the last row, sums that nobody reads.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn gather(x: &QuantInput, t: usize, rows: usize, first: usize, inputs: &mut [[Tile; 2]]) {
    let last = (first + inputs.len() * BYTES).min(x.rows.cols());
    for r in 0..rows {
        let (whole, part) = x.rows.row(t + r)[first..last].as_chunks::<BYTES>();
        for (step, whole) in inputs.iter_mut().zip(whole) {
            step[r / TILE][r % TILE] = *whole;
        }
        if let Some(step) = inputs.get_mut(whole.len()).filter(|_| !part.is_empty()) {
            step[r / TILE][r % TILE][..part.len()].copy_from_slice(part);
        }
    }
}

/// The rows from `t` on with the slots from `slot` on, from the first input to the end of the product.
#[expect(clippy::too_many_arguments, reason = "one block of a product, each operand named")]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn block(
    tiles: &Configured,
    x: &QuantInput,
    t: usize,
    rows: usize,
    inputs: &mut [[Tile; 2]],
    job: &Job,
    slot: usize,
    panels: usize,
    sums: &mut [[f32; PANEL]; SUMS],
    y: &mut MatMut<f32>,
) {
    // Not by `from_fn`: a closure has this function's features and cannot be inlined into one that has not.
    let mut quads = [&[][..]; 4];
    for (p, quads) in quads.iter_mut().enumerate() {
        *quads = job.panel(slot + p.min(panels - 1));
    }
    let blocks = quads[0].len().div_ceil(inputs.len() * TILE).max(1);
    for i in 0..blocks {
        if blocks > 1 {
            gather(x, t, rows, i * inputs.len() * BYTES, inputs);
        }
        let part = i * inputs.len() * TILE..((i + 1) * inputs.len() * TILE).min(quads[0].len());
        let mut quads = quads;
        for quads in &mut quads {
            *quads = &quads[part.clone()];
        }
        match (rows <= TILE, panels) {
            (true, 4) => multiply::<1, 4>(tiles, inputs, &quads, i == 0, sums),
            (true, 2) => multiply::<1, 2>(tiles, inputs, &quads, i == 0, sums),
            (true, _) => multiply::<1, 1>(tiles, inputs, &quads, i == 0, sums),
            (false, 2) => multiply::<2, 2>(tiles, inputs, &quads, i == 0, sums),
            (false, _) => multiply::<2, 1>(tiles, inputs, &quads, i == 0, sums),
        }
    }
    finish::<0>(x, t, &mut sums[..rows * panels], panels, job, slot, y);
}

/// Adds the products of `R` tiles of rows with the quads of `P` panels to `sums [rows, P]`, or starts them.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn multiply<const R: usize, const P: usize>(
    tiles: &Configured,
    inputs: &[[Tile; 2]],
    quads: &[&[[i8; BYTES]]; 4],
    start: bool,
    sums: &mut [[f32; PANEL]; SUMS],
) {
    if !start {
        tiles.load_sums::<R, P>(sums);
    } else {
        tiles.zero();
    }
    let [first, second, third, fourth] = *quads;
    let ((first, rest), (second, _)) = (first.as_chunks::<TILE>(), second.as_chunks::<TILE>());
    let ((third, _), (fourth, _)) = (third.as_chunks::<TILE>(), fourth.as_chunks::<TILE>());
    let (steps, rest) = (first.len(), rest.len());
    for (i, x) in inputs.iter().enumerate().take(steps) {
        tiles.step::<R, P>(x, [&first[i], &second[i], &third[i], &fourth[i]]);
    }
    if rest > 0 {
        let mut last = [[[0; BYTES]; TILE]; 4];
        for (last, quads) in last.iter_mut().zip(quads).take(P) {
            last[..rest].copy_from_slice(&quads[steps * TILE..]);
        }
        tiles.step::<R, P>(&inputs[steps], last.each_ref());
    }
    tiles.store_sums::<R, P>(sums);
}

/// The proof that this thread's tiles are configured, all of them 16 rows of 64 bytes; dropping it releases them.
struct Configured {
    /// Tiles belong to a thread.
    thread: PhantomData<*const ()>,
}

/// Palette 1, and the bytes per row and rows of each tile.
#[repr(C, align(64))]
struct Config {
    palette: u8,
    start_row: u8,
    reserved: [u8; 14],
    row_bytes: [u16; 16],
    rows: [u8; 16],
}

static CONFIG: Config = Config {
    palette: 1,
    start_row: 0,
    reserved: [0; 14],
    row_bytes: [64, 64, 64, 64, 64, 64, 64, 64, 0, 0, 0, 0, 0, 0, 0, 0],
    rows: [16, 16, 16, 16, 16, 16, 16, 16, 0, 0, 0, 0, 0, 0, 0, 0],
};

impl Configured {
    /// Called only by functions that `Backend::Amx` leads to.
    fn new() -> Self {
        // SAFETY: `Isa` holds `Amx` only after the processor and the system granted tiles, and only its arm leads here;
        // `CONFIG` is 64 readable bytes that describe what palette 1 allows.
        unsafe { asm!("ldtilecfg [{}]", in(reg) &raw const CONFIG, options(nostack, preserves_flags, readonly)) }
        Self { thread: PhantomData }
    }

    #[inline]
    fn zero(&self) {
        // SAFETY: tiles 0 to 3 are configured; nothing but this type's methods uses them.
        unsafe {
            asm!(
                "tilezero tmm0",
                "tilezero tmm1",
                "tilezero tmm2",
                "tilezero tmm3",
                options(nostack, preserves_flags, nomem)
            );
        }
    }

    /// `tmmT = tile`.
    #[inline]
    fn load<const T: u8>(&self, tile: &Tile) {
        // SAFETY: tile `T` is configured as 16 rows of 64 bytes, which is what `tile` holds, one behind the other.
        unsafe {
            asm!("tileloadd tmm{t}, [{tile} + {stride}]", t = const T, tile = in(reg) tile, stride = in(reg) BYTES,
                options(nostack, preserves_flags, readonly));
        }
    }

    /// `tmmC += tmmX * tmmW`.
    #[inline]
    fn multiply<const C: u8, const X: u8, const W: u8>(&self) {
        // SAFETY: the three tiles are configured with sizes that fit each other; nothing but this type's methods uses them.
        unsafe {
            asm!("tdpbssd tmm{c}, tmm{x}, tmm{w}", c = const C, x = const X, w = const W,
                options(nostack, preserves_flags, nomem));
        }
    }

    /// 64 inputs of `R` tiles of rows with `P` panels.
    #[inline]
    fn step<const R: usize, const P: usize>(&self, x: &[Tile; 2], w: [&Tile; 4]) {
        self.load::<4>(&x[0]);
        self.load::<6>(w[0]);
        self.multiply::<0, 4, 6>();
        if R == 2 {
            self.load::<5>(&x[1]);
            self.multiply::<2, 5, 6>();
        }
        if P > 1 {
            self.load::<7>(w[1]);
            self.multiply::<1, 4, 7>();
        }
        if R == 2 && P > 1 {
            self.multiply::<3, 5, 7>();
        }
        if R == 1 && P > 2 {
            self.load::<6>(w[2]);
            self.multiply::<2, 4, 6>();
            self.load::<7>(w[3]);
            self.multiply::<3, 4, 7>();
        }
    }

    #[inline]
    fn load_sum<const C: u8>(&self, sums: &[[f32; PANEL]], stride: usize) {
        assert!(sums.len() > (TILE - 1) * stride);
        // SAFETY: tile `C` is configured as 16 rows of 64 bytes; row `r` is `sums[r * stride]`, inside by the assertion.
        unsafe {
            asm!("tileloadd tmm{c}, [{sums} + {stride}]", c = const C, sums = in(reg) sums.as_ptr(),
                stride = in(reg) stride * size_of::<[f32; PANEL]>(), options(nostack, preserves_flags, readonly));
        }
    }

    #[inline]
    fn store_sum<const C: u8>(&self, sums: &mut [[f32; PANEL]], stride: usize) {
        assert!(sums.len() > (TILE - 1) * stride);
        // SAFETY: tile `C` is configured as 16 rows of 64 bytes; row `r` is `sums[r * stride]`, inside by the assertion.
        unsafe {
            asm!("tilestored [{sums} + {stride}], tmm{c}", c = const C, sums = in(reg) sums.as_mut_ptr(),
                stride = in(reg) stride * size_of::<[f32; PANEL]>(), options(nostack, preserves_flags));
        }
    }

    #[inline]
    fn load_sums<const R: usize, const P: usize>(&self, sums: &[[f32; PANEL]]) {
        self.load_sum::<0>(sums, P);
        if P > 1 {
            self.load_sum::<1>(&sums[1..], P);
        }
        if R == 2 {
            self.load_sum::<2>(&sums[TILE * P..], P);
        } else if P > 2 {
            self.load_sum::<2>(&sums[2..], P);
        }
        if R == 2 && P > 1 {
            self.load_sum::<3>(&sums[TILE * P + 1..], P);
        } else if P > 3 {
            self.load_sum::<3>(&sums[3..], P);
        }
    }

    #[inline]
    fn store_sums<const R: usize, const P: usize>(&self, sums: &mut [[f32; PANEL]]) {
        self.store_sum::<0>(sums, P);
        if P > 1 {
            self.store_sum::<1>(&mut sums[1..], P);
        }
        if R == 2 {
            self.store_sum::<2>(&mut sums[TILE * P..], P);
        } else if P > 2 {
            self.store_sum::<2>(&mut sums[2..], P);
        }
        if R == 2 && P > 1 {
            self.store_sum::<3>(&mut sums[TILE * P + 1..], P);
        } else if P > 3 {
            self.store_sum::<3>(&mut sums[3..], P);
        }
    }
}

impl Drop for Configured {
    fn drop(&mut self) {
        // SAFETY: tiles are configured, so the processor has them; whoever needs them next configures them again.
        unsafe { asm!("tilerelease", options(nostack, preserves_flags, nomem)) }
    }
}
