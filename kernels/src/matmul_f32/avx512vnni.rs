//! 16 outputs per fused multiply-add, one sum per output in ascending order of inputs.

use super::{Activation, Epilogue, Input, Job, Panels, tiles};
use crate::mat::MatMut;
use crate::math::avx512vnni::{activate, gelu_tanh};
use crate::pack::{PANEL, PackedF32};
use crate::prefetch;
use core::arch::x86_64::*;
use core::ops::Range;

/// Rows of the largest tile: 8 rows x 3 panels are 24 sums. A ninth row would fit the vector registers, but its address no
/// longer a scalar one.
const ROWS: usize = 8;
/// Rows of the largest tile of an even number of panels, as gated products need: 6 rows x 4 panels.
const EVEN_ROWS: usize = 6;
/// Bytes of weights in work at once, which stay in L2 while tiles of rows go by.
const CHUNK_BYTES: usize = 768 << 10;
/// Inputs between a multiplication and the prefetch of its weights from L2: 8 steps of 13 cycles.
const AHEAD: usize = 8;
/// Inputs per turn of the innermost loop: counting them takes one instruction of 25, of two inputs one of 13.
const TURN: usize = 4;

/// Rows of panels whose weights widen to f32 as they are loaded.
pub(crate) trait Load: Copy {
    /// Inputs of one row.
    const INPUTS: usize;
    /// The weights of input `i`.
    /// # Safety
    /// The processor has the features of this back-end; `panel` points to a whole panel, which ends behind input `i`.
    unsafe fn load(panel: *const Self, i: usize) -> __m512;
}

impl Load for [f32; PANEL] {
    const INPUTS: usize = 1;

    #[inline]
    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    unsafe fn load(panel: *const Self, i: usize) -> __m512 {
        // SAFETY: row `i` is inside the panel by this function's contract.
        load(unsafe { &*panel.wrapping_add(i) })
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul(x: Input<f32>, w: PackedF32, end: Epilogue, y: MatMut<f32>) {
    run(x, &Job::Plain(w, end), y);
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul_gated(x: Input<f32>, gate: PackedF32, up: PackedF32, y: MatMut<f32>) {
    run(x, &Job::Gated(gate, up), y);
}

/// The whole product.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(crate) fn run<'a, W: Panels<'a, Row: Load>>(x: Input<f32>, job: &Job<'_, W>, mut y: MatMut<f32>) {
    let most = if matches!(job, Job::Plain(..)) { ROWS } else { EVEN_ROWS };
    // A multiple of the panels that any tile takes at once, and of gated pairs of them.
    let panel_bytes = size_of::<W::Row>() * job.k().div_ceil(W::Row::INPUTS).max(1);
    let width = (CHUNK_BYTES / panel_bytes / 12).max(1) * 12;
    // Cleared once: clearing them per tile would wait for the stores of the tile before.
    let mut sums = [[0.0; PANEL]; SUMS];
    for first in (0..job.slots()).step_by(width) {
        let slots = first..(first + width).min(job.slots());
        for (t, rows) in tiles(x.rows(), most) {
            match rows {
                1 => tile::<W, 1, 4>(&x, t, job, slots.clone(), &mut sums, &mut y),
                2 => tile::<W, 2, 4>(&x, t, job, slots.clone(), &mut sums, &mut y),
                3 => tile::<W, 3, 4>(&x, t, job, slots.clone(), &mut sums, &mut y),
                4 => tile::<W, 4, 4>(&x, t, job, slots.clone(), &mut sums, &mut y),
                5 => tile::<W, 5, 4>(&x, t, job, slots.clone(), &mut sums, &mut y),
                6 => tile::<W, 6, 4>(&x, t, job, slots.clone(), &mut sums, &mut y),
                7 => tile::<W, 7, 3>(&x, t, job, slots.clone(), &mut sums, &mut y),
                ROWS => tile::<W, ROWS, 3>(&x, t, job, slots.clone(), &mut sums, &mut y),
                rows => unreachable!("a tile of {rows} rows"),
            }
        }
    }
}

/// The rows from `t` on, `R` of them, with all `slots`, `P` at a time.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn tile<'a, W: Panels<'a, Row: Load>, const R: usize, const P: usize>(
    x: &Input<f32>,
    t: usize,
    job: &Job<'_, W>,
    slots: Range<usize>,
    sums: &mut [[f32; PANEL]; SUMS],
    y: &mut MatMut<f32>,
) {
    let mut rows = [&[][..]; R];
    for (r, row) in rows.iter_mut().enumerate() {
        *row = x.row(t + r);
    }
    let mut slot = slots.start;
    while slot + P <= slots.end {
        group::<W, R, P>(&rows, t, job, slot, sums, y);
        slot += P;
    }
    while slot + 2 <= slots.end {
        group::<W, R, 2>(&rows, t, job, slot, sums, y);
        slot += 2;
    }
    if slot < slots.end {
        group::<W, R, 1>(&rows, t, job, slot, sums, y);
    }
}

/// `R` rows with `P` slots from `slot` on, from the first input to the end of the product.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn group<'a, W: Panels<'a, Row: Load>, const R: usize, const P: usize>(
    rows: &[&[f32]; R],
    t: usize,
    job: &Job<'_, W>,
    slot: usize,
    sums: &mut [[f32; PANEL]; SUMS],
    y: &mut MatMut<f32>,
) {
    // Not by `from_fn`: a closure has this function's features and cannot be inlined into one that has not.
    let mut panels = [&[][..]; P];
    for (p, panel) in panels.iter_mut().enumerate() {
        *panel = job.panel(slot + p);
    }
    multiply(rows, panels, sums);
    let sums = &mut sums[..R * P];
    match job {
        Job::Plain(_, end) => finish(sums, P, t, slot * PANEL, end, y),
        Job::Gated(..) => finish_gated(sums, P / 2, t, slot / 2 * PANEL, y),
    }
}

/// The innermost tile: `R x P` sums in registers.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn multiply<W: Load, const R: usize, const P: usize>(
    rows: &[&[f32]; R],
    panels: [&[W]; P],
    sums: &mut [[f32; PANEL]; SUMS],
) {
    let k = rows[0].len();
    for row in rows {
        assert!(row.len() == k);
    }
    for panel in panels {
        assert!(panel.len() == k.div_ceil(W::INPUTS));
    }
    // Pointers: slices' lengths take registers that eight rows and three panels need.
    let (mut x, mut w) = ([core::ptr::null(); R], [core::ptr::null(); P]);
    for r in 0..R {
        x[r] = rows[r].as_ptr();
    }
    for p in 0..P {
        w[p] = panels[p].as_ptr();
    }
    let mut acc = [[_mm512_setzero_ps(); P]; R];
    let mut i = 0;
    while i + TURN <= k {
        for which in 0..TURN {
            // One prefetch per line: two inputs of bf16 share one.
            if which % W::INPUTS == 0 {
                for panel in w {
                    prefetch::near(panel.wrapping_add((i + which + AHEAD) / W::INPUTS));
                }
            }
            // SAFETY: `i + which < i + TURN <= k`, which are the lengths of all rows and, in inputs, of all panels.
            unsafe { input(&mut acc, &x, &w, i + which) };
        }
        i += TURN;
    }
    while i < k {
        // SAFETY: `i < k`, as above.
        unsafe { input(&mut acc, &x, &w, i) };
        i += 1;
    }
    for r in 0..R {
        for p in 0..P {
            store(&mut sums[r * P + p], acc[r][p]);
        }
    }
}

/// Adds the products of input `i` of `R` rows with the weights of `P` panels.
/// # Safety
/// `x` point to rows and `w` to panels, all of which have an input `i`.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn input<W: Load, const R: usize, const P: usize>(
    acc: &mut [[__m512; P]; R],
    x: &[*const f32; R],
    w: &[*const W; P],
    i: usize,
) {
    let mut weights = [_mm512_setzero_ps(); P];
    for p in 0..P {
        // SAFETY: this function enables the features that `load` needs; the panel has an input `i` by its contract.
        weights[p] = unsafe { W::load(w[p], i) };
    }
    for r in 0..R {
        // SAFETY: the row has an input `i` by this function's contract.
        let x = _mm512_set1_ps(unsafe { *x[r].wrapping_add(i) });
        for p in 0..P {
            acc[r][p] = _mm512_fmadd_ps(x, weights[p], acc[r][p]);
        }
    }
}

/// Panels of sums in one tile at most.
const SUMS: usize = ROWS * 3;
/// Most panels that a tile ends at once.
pub(crate) const MOST: usize = 4;

/// Ends `values [rows, panels]`: the outputs from `first` on of the rows from `t` on.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(crate) fn finish(
    values: &mut [[f32; PANEL]],
    panels: usize,
    t: usize,
    first: usize,
    end: &Epilogue,
    y: &mut MatMut<f32>,
) {
    let outputs = first..(first + panels * PANEL).min(y.cols());
    if let Some(bias) = end.bias {
        add_bias(values, panels, &bias[outputs.clone()]);
    }
    if end.activation != Activation::None {
        activate_all(end.activation, values);
    }
    for (t, values) in (t..).zip(values.chunks_exact(panels)) {
        if let Some(scatter) = end.scatter {
            let factor = _mm512_set1_ps(scatter.weight[t]);
            let y = &mut y.row_mut(scatter.rows[t] as usize)[outputs.clone()];
            combine(values, y, |old, v| _mm512_add_ps(old, _mm512_mul_ps(factor, v)));
        } else if end.add {
            combine(values, &mut y.row_mut(t)[outputs.clone()], |old, v| _mm512_add_ps(old, v));
        } else {
            write(values, &mut y.row_mut(t)[outputs.clone()]);
        }
    }
}

/// Ends gated `values [rows, 2 * panels]`, in which gate and up panels take turns.
#[inline(never)]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(crate) fn finish_gated(values: &mut [[f32; PANEL]], panels: usize, t: usize, first: usize, y: &mut MatMut<f32>) {
    let outputs = first..(first + panels * PANEL).min(y.cols());
    for (t, values) in (t..).zip(values.chunks_exact_mut(2 * panels)) {
        for i in 0..panels {
            let v = _mm512_mul_ps(gelu_tanh(load(&values[2 * i])), load(&values[2 * i + 1]));
            store(&mut values[i], v);
        }
        write(values, &mut y.row_mut(t)[outputs.clone()]);
    }
}

/// Kept out of line, as are the activations: most products have neither, and their constants fill registers.
#[inline(never)]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn add_bias(values: &mut [[f32; PANEL]], panels: usize, bias: &[f32]) {
    let (bias, tail) = bias.as_chunks::<PANEL>();
    for values in values.chunks_exact_mut(panels) {
        for (v, bias) in values.iter_mut().zip(bias) {
            let sum = _mm512_add_ps(load(v), load(bias));
            store(v, sum);
        }
        if let Some(v) = values.get_mut(bias.len()) {
            let sum = _mm512_add_ps(load(v), load_part(tail));
            store(v, sum);
        }
    }
}

#[inline(never)]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn activate_all(activation: Activation, values: &mut [[f32; PANEL]]) {
    for v in values {
        let active = activate(activation, load(v));
        store(v, active);
    }
}

/// `y = values`; there may be more values than outputs.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn write(values: &[[f32; PANEL]], y: &mut [f32]) {
    let (y, y_tail) = y.as_chunks_mut::<PANEL>();
    for (y, v) in y.iter_mut().zip(values) {
        store(y, load(v));
    }
    if !y_tail.is_empty() {
        store_part(y_tail, load(&values[y.len()]));
    }
}

/// `y = f(y, values)`; there may be more values than outputs.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn combine(values: &[[f32; PANEL]], y: &mut [f32], f: impl Fn(__m512, __m512) -> __m512) {
    let (y, y_tail) = y.as_chunks_mut::<PANEL>();
    for (y, v) in y.iter_mut().zip(values) {
        let new = f(load(y), load(v));
        store(y, new);
    }
    if !y_tail.is_empty() {
        let new = f(load_part(y_tail), load(&values[y.len()]));
        store_part(y_tail, new);
    }
}

/// One panel's worth of floats.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(crate) fn load(src: &[f32; PANEL]) -> __m512 {
    // SAFETY: `src` is 16 readable floats; the load needs no alignment.
    unsafe { _mm512_loadu_ps(src.as_ptr()) }
}

/// Stores one panel's worth of floats.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(crate) fn store(dst: &mut [f32; PANEL], v: __m512) {
    // SAFETY: `dst` is 16 writable floats; the store needs no alignment.
    unsafe { _mm512_storeu_ps(dst.as_mut_ptr(), v) }
}

/// The first `len` lanes, at most 16.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "16 bits by the assertion")]
pub(crate) fn lanes(len: usize) -> __mmask16 {
    assert!(len <= PANEL);
    ((1_u32 << len) - 1) as __mmask16
}

/// A part of a panel, then zeros.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(crate) fn load_part(src: &[f32]) -> __m512 {
    // SAFETY: the mask names the lanes of `src` alone; others are not read.
    unsafe { _mm512_maskz_loadu_ps(lanes(src.len()), src.as_ptr()) }
}

/// Stores the first lanes, as many as `dst` has.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(crate) fn store_part(dst: &mut [f32], v: __m512) {
    // SAFETY: the mask names the lanes of `dst` alone; others are not written.
    unsafe { _mm512_mask_storeu_ps(dst.as_mut_ptr(), lanes(dst.len()), v) }
}
