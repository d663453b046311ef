//! 8 outputs per fused multiply-add, one sum per output in ascending order of inputs.

use super::{Activation, Epilogue, Input, Job, Panels, tiles};
use crate::mat::MatMut;
use crate::math::avx2::{activate, gelu_tanh};
use crate::pack::{PANEL, PackedF32};
use crate::prefetch;
use core::arch::x86_64::*;

/// Rows of the largest tile: 6 rows x 1 panel are 12 sums, which leaves two registers of weights and two to spare.
const ROWS: usize = 6;
/// Rows of the largest tile of two panels, as gated products need.
const EVEN_ROWS: usize = 3;
/// Inputs between a multiplication and the prefetch of its weights from L2.
const AHEAD: usize = 16;
/// Outputs in a register.
const LANES: usize = 8;
/// Most panels that a tile ends at once.
pub(crate) const MOST: usize = 4;

/// Rows of panels whose weights widen to f32 as they are loaded.
pub(crate) trait Load: Copy {
    /// Inputs of one row.
    const INPUTS: usize;
    /// The weights of input `i`. Panics where the panel ends before it.
    /// # Safety
    /// The processor has the features of this back-end.
    unsafe fn load(panel: &[Self], i: usize) -> [__m256; 2];
}

impl Load for [f32; PANEL] {
    const INPUTS: usize = 1;

    #[inline]
    #[target_feature(enable = "avx2,fma")]
    unsafe fn load(panel: &[Self], i: usize) -> [__m256; 2] {
        load(&panel[i])
    }
}

#[target_feature(enable = "avx2,fma")]
pub(super) fn matmul(x: Input<f32>, w: PackedF32, end: Epilogue, y: MatMut<f32>) {
    run(x, &Job::Plain(w, end), y);
}

#[target_feature(enable = "avx2,fma")]
pub(super) fn matmul_gated(x: Input<f32>, gate: PackedF32, up: PackedF32, y: MatMut<f32>) {
    run(x, &Job::Gated(gate, up), y);
}

/// The whole product: all rows pass by each group of panels while it is in the cache.
#[target_feature(enable = "avx2,fma")]
pub(crate) fn run<'a, W: Panels<'a, Row: Load>>(x: Input<f32>, job: &Job<'_, W>, mut y: MatMut<f32>) {
    let most = if matches!(job, Job::Plain(..)) { ROWS } else { EVEN_ROWS };
    let mut slot = 0;
    while slot < job.slots() {
        let width = if slot + MOST <= job.slots() { MOST } else { 2.min(job.slots() - slot) };
        for (t, rows) in tiles(x.rows(), most) {
            match rows {
                1 => tile::<W, 1, 4>(&x, t, job, slot, width, &mut y),
                2 => tile::<W, 2, 2>(&x, t, job, slot, width, &mut y),
                3 => tile::<W, 3, 2>(&x, t, job, slot, width, &mut y),
                4 => tile::<W, 4, 1>(&x, t, job, slot, width, &mut y),
                5 => tile::<W, 5, 1>(&x, t, job, slot, width, &mut y),
                ROWS => tile::<W, ROWS, 1>(&x, t, job, slot, width, &mut y),
                rows => unreachable!("a tile of {rows} rows"),
            }
        }
        slot += width;
    }
}

/// The rows from `t` on, `R` of them, with `width` slots, `P` at a time.
#[target_feature(enable = "avx2,fma")]
fn tile<'a, W: Panels<'a, Row: Load>, const R: usize, const P: usize>(
    x: &Input<f32>,
    t: usize,
    job: &Job<'_, W>,
    slot: usize,
    width: usize,
    y: &mut MatMut<f32>,
) {
    let mut rows = [&[][..]; R];
    for (r, row) in rows.iter_mut().enumerate() {
        *row = x.row(t + r);
    }
    let end = slot + width;
    let mut slot = slot;
    while slot + P <= end {
        group::<W, R, P>(&rows, t, job, slot, y);
        slot += P;
    }
    while P > 2 && slot + 2 <= end {
        group::<W, R, 2>(&rows, t, job, slot, y);
        slot += 2;
    }
    if slot < end {
        group::<W, R, 1>(&rows, t, job, slot, y);
    }
}

/// `R` rows with `P` slots from `slot` on, from the first input to the end of the product.
#[target_feature(enable = "avx2,fma")]
fn group<'a, W: Panels<'a, Row: Load>, const R: usize, const P: usize>(
    rows: &[&[f32]; R],
    t: usize,
    job: &Job<'_, W>,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut sums = [[[0.0; PANEL]; P]; R];
    // Not by `from_fn`: a closure has this function's features and cannot be inlined into one that has not.
    let mut panels = [&[][..]; P];
    for (p, panel) in panels.iter_mut().enumerate() {
        *panel = job.panel(slot + p);
    }
    multiply(rows, panels, &mut sums);
    let sums = sums.as_flattened_mut();
    match job {
        Job::Plain(_, end) => finish(sums, P, t, slot * PANEL, end, y),
        Job::Gated(..) => finish_gated(sums, P / 2, t, slot / 2 * PANEL, y),
    }
}

/// The innermost tile: `R x P` panels of sums in registers.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn multiply<W: Load, const R: usize, const P: usize>(
    rows: &[&[f32]; R],
    panels: [&[W]; P],
    sums: &mut [[[f32; PANEL]; P]; R],
) {
    let k = rows[0].len();
    // Lengths that are known to be equal need no check in the loop.
    for row in rows {
        assert!(row.len() == k);
    }
    for panel in panels {
        assert!(panel.len() == k.div_ceil(W::INPUTS));
    }
    let mut acc = [[[_mm256_setzero_ps(); 2]; P]; R];
    let mut input = |i: usize| {
        for p in 0..P {
            // SAFETY: this function enables the features that `load` needs.
            let w = unsafe { W::load(panels[p], i) };
            prefetch::near(panels[p].as_ptr().wrapping_add((i + AHEAD) / W::INPUTS));
            for r in 0..R {
                let x = _mm256_set1_ps(rows[r][i]);
                acc[r][p][0] = _mm256_fmadd_ps(x, w[0], acc[r][p][0]);
                acc[r][p][1] = _mm256_fmadd_ps(x, w[1], acc[r][p][1]);
            }
        }
    };
    // Two at a time, so that it is known which of a pair each is.
    for i in (0..k - k % 2).step_by(2) {
        input(i);
        input(i + 1);
    }
    if !k.is_multiple_of(2) {
        input(k - 1);
    }
    for r in 0..R {
        for p in 0..P {
            store(&mut sums[r][p], acc[r][p]);
        }
    }
}

/// Ends `values [rows, panels]`: the outputs from `first` on of the rows from `t` on.
#[inline]
#[target_feature(enable = "avx2,fma")]
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
            let factor = _mm256_set1_ps(scatter.weight[t]);
            let y = &mut y.row_mut(scatter.rows[t] as usize)[outputs.clone()];
            combine(values, y, |old, v| _mm256_add_ps(old, _mm256_mul_ps(factor, v)));
        } else if end.add {
            combine(values, &mut y.row_mut(t)[outputs.clone()], |old, v| _mm256_add_ps(old, v));
        } else {
            combine(values, &mut y.row_mut(t)[outputs.clone()], |_, v| v);
        }
    }
}

/// Ends gated `values [rows, 2 * panels]`, in which gate and up panels take turns.
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn finish_gated(values: &mut [[f32; PANEL]], panels: usize, t: usize, first: usize, y: &mut MatMut<f32>) {
    let outputs = first..(first + panels * PANEL).min(y.cols());
    for (t, values) in (t..).zip(values.chunks_exact_mut(2 * panels)) {
        for i in 0..panels {
            let (gate, up) = (load(&values[2 * i]), load(&values[2 * i + 1]));
            let v = [_mm256_mul_ps(gelu_tanh(gate[0]), up[0]), _mm256_mul_ps(gelu_tanh(gate[1]), up[1])];
            store(&mut values[i], v);
        }
        combine(values, &mut y.row_mut(t)[outputs.clone()], |_, v| v);
    }
}

/// Kept out of line, as are the activations: most products have neither, and their constants fill registers.
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
fn add_bias(values: &mut [[f32; PANEL]], panels: usize, bias: &[f32]) {
    let (bias, tail) = bias.as_chunks::<PANEL>();
    for values in values.chunks_exact_mut(panels) {
        for (v, bias) in values.iter_mut().zip(bias) {
            let (sum, bias) = (load(v), load(bias));
            store(v, [_mm256_add_ps(sum[0], bias[0]), _mm256_add_ps(sum[1], bias[1])]);
        }
        if let Some(v) = values.get_mut(bias.len()) {
            v.iter_mut().zip(tail).for_each(|(v, bias)| *v += bias);
        }
    }
}

#[inline(never)]
#[target_feature(enable = "avx2,fma")]
fn activate_all(activation: Activation, values: &mut [[f32; PANEL]]) {
    for v in values {
        let [low, high] = load(v);
        store(v, [activate(activation, low), activate(activation, high)]);
    }
}

/// `y = f(y, values)`; there may be more values than outputs.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn combine(values: &[[f32; PANEL]], y: &mut [f32], f: impl Fn(__m256, __m256) -> __m256) {
    let (y, y_tail) = y.as_chunks_mut::<PANEL>();
    for (y, v) in y.iter_mut().zip(values) {
        let (old, v) = (load(y), load(v));
        store(y, [f(old[0], v[0]), f(old[1], v[1])]);
    }
    if !y_tail.is_empty() {
        let mut whole = [0.0; PANEL];
        whole[..y_tail.len()].copy_from_slice(y_tail);
        let (old, v) = (load(&whole), load(&values[y.len()]));
        store(&mut whole, [f(old[0], v[0]), f(old[1], v[1])]);
        y_tail.copy_from_slice(&whole[..y_tail.len()]);
    }
}

/// One panel's worth of floats.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn load(src: &[f32; PANEL]) -> [__m256; 2] {
    let (halves, _) = src.as_chunks::<LANES>();
    // SAFETY: `halves[0]` is 8 readable floats; the load needs no alignment.
    let low = unsafe { _mm256_loadu_ps(halves[0].as_ptr()) };
    // SAFETY: `halves[1]` is 8 readable floats; the load needs no alignment.
    let high = unsafe { _mm256_loadu_ps(halves[1].as_ptr()) };
    [low, high]
}

/// Stores one panel's worth of floats.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub(crate) fn store(dst: &mut [f32; PANEL], v: [__m256; 2]) {
    let (halves, _) = dst.as_chunks_mut::<LANES>();
    // SAFETY: `halves[0]` is 8 writable floats; the store needs no alignment.
    unsafe { _mm256_storeu_ps(halves[0].as_mut_ptr(), v[0]) }
    // SAFETY: `halves[1]` is 8 writable floats; the store needs no alignment.
    unsafe { _mm256_storeu_ps(halves[1].as_mut_ptr(), v[1]) }
}
