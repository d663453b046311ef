//! 16 outputs per fused multiply-add, one sum per output in ascending order of inputs.

use super::{Epilogue, GemmTask, Input, Panels, tiles};
use crate::isa::Avx512Vnni;
use crate::lanes::avx512vnni::{load, load_part, store, store_part};
use crate::mat::MatMut;
use crate::math::Activation;
use crate::math::avx512vnni::{activate, gelu_tanh};
use crate::pack::{PAIR, PANEL};
use crate::prefetch;
use crate::tiling::Tiling;
use core::arch::x86_64::*;
use core::ops::Range;
use umo_kernels_features::avx512vnni;

/// Rows of the largest tile: 8 rows x 3 panels are 24 sums. A ninth row would fit the vector
/// registers, but its address would exceed the scalar ones.
const ROWS: usize = 8;
/// Rows of the largest tile with an even number of panels, as gated products need: 6 rows x 4 panels.
const EVEN_ROWS: usize = 6;
/// Panels that one row is multiplied with at once: an even number, whose sums hide the latency of their additions.
const ONE_ROW_PANELS: usize = 6;
/// Bytes of weights per chunk, which stays in L2 while tiles of rows pass.
const CHUNK_BYTES: usize = 768 << 10;
/// Prefetch distance from L2 in steps: 8 of 13 cycles.
const PREFETCH_DISTANCE: usize = 8;
/// Unrolling of the innermost loop: the loop counter is one instruction of 25 (of 13 when
/// unrolled by two).
const UNROLL: usize = 4;

/// Step by step computation of the dot products of rows of `X` with rows of a panel.
pub(crate) trait Step<X>: Copy {
    /// Inputs per step.
    const INPUTS: usize;
    /// Steps that share a row of a panel.
    const SHARED: usize;
    /// Proof of instructions beyond those of this back-end.
    type Token: Copy;
    /// The weights of step `i`.
    /// # Safety
    /// The processor has the features of this back-end; `panel` points to a whole panel
    /// that contains step `i`.
    unsafe fn weights(panel: *const Self, i: usize) -> __m512;
    /// The inputs of step `i`, in all lanes.
    /// # Safety
    /// As `weights`, with `row` pointing to a whole row that contains step `i`.
    unsafe fn inputs(row: *const X, i: usize) -> __m512;
    /// The first input of step `i`, with zeros for the inputs beyond the row.
    /// # Safety
    /// As `weights`, with `row` pointing to a whole row that contains the first input of
    /// step `i`.
    unsafe fn last(row: *const X, i: usize) -> __m512;
    /// `sum + x * w`; `FUSED`: rounded once, if inputs are f32.
    /// # Safety
    /// The processor has the features of this back-end.
    unsafe fn multiply<const FUSED: bool>(token: Self::Token, sum: __m512, x: __m512, w: __m512) -> __m512;
}

/// Rows of panels whose weights are widened to f32 when loaded.
pub(crate) trait Load: Copy {
    /// Inputs of one row.
    const INPUTS: usize;
    /// The weights of input `i`.
    /// # Safety
    /// The processor has the features of this back-end; `panel` points to a whole panel
    /// that contains input `i`.
    unsafe fn load(panel: *const Self, i: usize) -> __m512;
}

impl<W: Load> Step<f32> for W {
    const INPUTS: usize = 1;
    const SHARED: usize = W::INPUTS;
    type Token = ();

    #[inline]
    #[avx512vnni]
    unsafe fn weights(panel: *const Self, i: usize) -> __m512 {
        // SAFETY: this function enables the features that `load` needs; the panel has an input `i`
        // by its contract.
        unsafe { W::load(panel, i) }
    }

    #[inline]
    #[avx512vnni]
    unsafe fn inputs(row: *const f32, i: usize) -> __m512 {
        // SAFETY: the row has an input `i` by this function's contract.
        _mm512_set1_ps(unsafe { *row.wrapping_add(i) })
    }

    #[inline]
    #[avx512vnni]
    unsafe fn last(row: *const f32, i: usize) -> __m512 {
        // SAFETY: a step is one input.
        unsafe { <Self as Step<f32>>::inputs(row, i) }
    }

    #[inline]
    #[avx512vnni]
    unsafe fn multiply<const FUSED: bool>((): (), sum: __m512, x: __m512, w: __m512) -> __m512 {
        if FUSED { _mm512_fmadd_ps(x, w, sum) } else { _mm512_add_ps(_mm512_mul_ps(x, w), sum) }
    }
}

/// Sizes at which the loops change.
pub(crate) fn tiling(_token: Avx512Vnni) -> Tiling {
    Tiling {
        rows: &[EVEN_ROWS, ROWS],
        outputs: &[PANEL, 3 * PANEL, MAX_PANELS * PANEL, ONE_ROW_PANELS * PANEL],
        inputs: &[UNROLL, PAIR * UNROLL],
        held: 0,
        chunk: CHUNK_BYTES / size_of::<f32>(),
    }
}

/// Computes the whole product. `FUSED`: products of f32 are not rounded before they are added.
#[avx512vnni]
pub(crate) fn run<'a, X, W: Panels<'a, Row: Step<X>>, const FUSED: bool>(
    token: <W::Row as Step<X>>::Token,
    x: Input<X>,
    task: &GemmTask<'_, W>,
    mut y: MatMut<f32>,
) {
    let most = if matches!(task, GemmTask::Plain(..)) { ROWS } else { EVEN_ROWS };
    // A multiple of the panels per tile, and of gated pairs of them.
    let panel_bytes = size_of::<W::Row>() * task.k().div_ceil(panel_inputs::<X, W::Row>()).max(1);
    let width = (CHUNK_BYTES / panel_bytes / 12).max(1) * 12;
    // Cleared once: clearing them per tile would wait for the stores of the previous tile.
    let mut sums = [[0.0; PANEL]; SUMS];
    for first in (0..task.slots()).step_by(width) {
        let slots = first..(first + width).min(task.slots());
        for (t, rows) in tiles(x.rows(), most) {
            match rows {
                1 => tile::<X, W, 1, ONE_ROW_PANELS, FUSED>(token, &x, t, task, slots.clone(), &mut sums, &mut y),
                2 => tile::<X, W, 2, 4, FUSED>(token, &x, t, task, slots.clone(), &mut sums, &mut y),
                3 => tile::<X, W, 3, 4, FUSED>(token, &x, t, task, slots.clone(), &mut sums, &mut y),
                4 => tile::<X, W, 4, 4, FUSED>(token, &x, t, task, slots.clone(), &mut sums, &mut y),
                5 => tile::<X, W, 5, 4, FUSED>(token, &x, t, task, slots.clone(), &mut sums, &mut y),
                6 => tile::<X, W, 6, 4, FUSED>(token, &x, t, task, slots.clone(), &mut sums, &mut y),
                7 => tile::<X, W, 7, 3, FUSED>(token, &x, t, task, slots.clone(), &mut sums, &mut y),
                ROWS => tile::<X, W, ROWS, 3, FUSED>(token, &x, t, task, slots.clone(), &mut sums, &mut y),
                rows => unreachable!("a tile of {rows} rows"),
            }
        }
    }
}

/// Processes `R` rows from `t` on with all `slots`, `P` at a time.
#[avx512vnni]
fn tile<'a, X, W: Panels<'a, Row: Step<X>>, const R: usize, const P: usize, const FUSED: bool>(
    token: <W::Row as Step<X>>::Token,
    x: &Input<X>,
    t: usize,
    task: &GemmTask<'_, W>,
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
        group::<X, W, R, P, FUSED>(token, &rows, t, task, slot, sums, y);
        slot += P;
    }
    while slot + 2 <= slots.end {
        group::<X, W, R, 2, FUSED>(token, &rows, t, task, slot, sums, y);
        slot += 2;
    }
    if slot < slots.end {
        group::<X, W, R, 1, FUSED>(token, &rows, t, task, slot, sums, y);
    }
}

/// Processes `R` rows with `P` slots from `slot` on, from the first input through the epilogue.
#[avx512vnni]
fn group<'a, X, W: Panels<'a, Row: Step<X>>, const R: usize, const P: usize, const FUSED: bool>(
    token: <W::Row as Step<X>>::Token,
    rows: &[&[X]; R],
    t: usize,
    task: &GemmTask<'_, W>,
    slot: usize,
    sums: &mut [[f32; PANEL]; SUMS],
    y: &mut MatMut<f32>,
) {
    // Not with `from_fn`: a closure has this function's features and cannot be inlined into a function
    // without them.
    let mut panels = [&[][..]; P];
    for (p, panel) in panels.iter_mut().enumerate() {
        *panel = task.panel(slot + p);
    }
    multiply::<X, W::Row, R, P, FUSED>(token, rows, panels, sums);
    let sums = &mut sums[..R * P];
    match task {
        GemmTask::Plain(_, epilogue) => store_tile(sums, P, t, slot * PANEL, epilogue, y),
        GemmTask::Gated(..) => store_gated_tile(sums, P / 2, t, slot / 2 * PANEL, y),
    }
}

/// Inputs of a row of a panel.
const fn panel_inputs<X, W: Step<X>>() -> usize {
    W::INPUTS * W::SHARED
}

/// The innermost tile: `R x P` sums in registers.
#[inline]
#[avx512vnni]
fn multiply<X, W: Step<X>, const R: usize, const P: usize, const FUSED: bool>(
    token: W::Token,
    rows: &[&[X]; R],
    panels: [&[W]; P],
    sums: &mut [[f32; PANEL]; SUMS],
) {
    let k = rows[0].len();
    for row in rows {
        assert!(row.len() == k);
    }
    for panel in panels {
        assert!(panel.len() == k.div_ceil(panel_inputs::<X, W>()));
    }
    // Pointers: the lengths of slices would occupy registers that eight rows and three
    // panels need.
    let (mut x, mut w) = ([core::ptr::null(); R], [core::ptr::null(); P]);
    for r in 0..R {
        x[r] = rows[r].as_ptr();
    }
    for p in 0..P {
        w[p] = panels[p].as_ptr();
    }
    let mut acc = [[_mm512_setzero_ps(); P]; R];
    let (whole, mut i) = (k / W::INPUTS, 0);
    while i + UNROLL <= whole {
        for which in 0..UNROLL {
            // One prefetch per line, which two inputs of bf16 may share.
            if which % W::SHARED == 0 {
                for panel in w {
                    prefetch::to_l1(panel.wrapping_add((i + which + PREFETCH_DISTANCE) / W::SHARED));
                }
            }
            // SAFETY: `i + which < i + UNROLL <= whole`: all rows have the inputs of these steps,
            // and all panels their weights.
            unsafe { step::<X, W, R, P, true, FUSED>(token, &mut acc, &x, &w, i + which) };
        }
        i += UNROLL;
    }
    while i < whole {
        // SAFETY: `i < whole`, as above.
        unsafe { step::<X, W, R, P, true, FUSED>(token, &mut acc, &x, &w, i) };
        i += 1;
    }
    if whole * W::INPUTS < k {
        // SAFETY: all rows have the first input of this step, and all panels, which are
        // padded with zeros, all of its weights.
        unsafe { step::<X, W, R, P, false, FUSED>(token, &mut acc, &x, &w, i) };
    }
    for r in 0..R {
        for p in 0..P {
            store(&mut sums[r * P + p], acc[r][p]);
        }
    }
}

/// Adds the products of step `i` of `R` rows with the weights of `P` panels; the rows have all of
/// the step's inputs (`WHOLE`), or at least the first.
/// # Safety
/// `x` point to rows that have these inputs, and `w` to panels that have the step.
#[inline]
#[avx512vnni]
unsafe fn step<X, W: Step<X>, const R: usize, const P: usize, const WHOLE: bool, const FUSED: bool>(
    token: W::Token,
    acc: &mut [[__m512; P]; R],
    x: &[*const X; R],
    w: &[*const W; P],
    i: usize,
) {
    let mut weights = [_mm512_setzero_ps(); P];
    for p in 0..P {
        // SAFETY: the panel has the step by this function's contract, which enables the features.
        weights[p] = unsafe { W::weights(w[p], i) };
    }
    for r in 0..R {
        let x = if WHOLE {
            // SAFETY: the row has the inputs of the step by this function's contract, which enables
            // the features.
            unsafe { W::inputs(x[r], i) }
        } else {
            // SAFETY: the row has the first input of the step by this function's contract, which
            // enables the features.
            unsafe { W::last(x[r], i) }
        };
        for p in 0..P {
            // SAFETY: this function enables the features of this back-end.
            acc[r][p] = unsafe { W::multiply::<FUSED>(token, acc[r][p], x, weights[p]) };
        }
    }
}

/// Most panels of sums in one tile.
const SUMS: usize = ROWS * 3;
/// Most panels whose epilogue runs at once.
pub(crate) const MAX_PANELS: usize = 4;

/// Applies the epilogue to `values [rows, panels]`: the outputs from `first` on of the rows from `t` on.
#[inline]
#[avx512vnni]
pub(crate) fn store_tile(
    values: &mut [[f32; PANEL]],
    panels: usize,
    t: usize,
    first: usize,
    epilogue: &Epilogue,
    y: &mut MatMut<f32>,
) {
    let outputs = first..(first + panels * PANEL).min(y.cols());
    if let Some(bias) = epilogue.bias {
        add_bias(values, panels, &bias[outputs.clone()]);
    }
    if epilogue.activation != Activation::None {
        activate_all(epilogue.activation, values);
    }
    for (t, values) in (t..).zip(values.chunks_exact(panels)) {
        if let Some(scatter) = epilogue.scatter {
            let factor = _mm512_set1_ps(scatter.weight[t]);
            let y = &mut y.row_mut(scatter.rows[t] as usize)[outputs.clone()];
            combine(values, y, |old, v| _mm512_add_ps(old, _mm512_mul_ps(factor, v)));
        } else if epilogue.add {
            combine(values, &mut y.row_mut(t)[outputs.clone()], |old, v| _mm512_add_ps(old, v));
        } else {
            write(values, &mut y.row_mut(t)[outputs.clone()]);
        }
    }
}

/// Applies the gate to `values [rows, 2 * panels]`, in which gate and up panels alternate, and
/// stores the products.
#[inline(never)]
#[avx512vnni]
pub(crate) fn store_gated_tile(
    values: &mut [[f32; PANEL]],
    panels: usize,
    t: usize,
    first: usize,
    y: &mut MatMut<f32>,
) {
    let outputs = first..(first + panels * PANEL).min(y.cols());
    for (t, values) in (t..).zip(values.chunks_exact_mut(2 * panels)) {
        for i in 0..panels {
            let v = _mm512_mul_ps(gelu_tanh(load(&values[2 * i])), load(&values[2 * i + 1]));
            store(&mut values[i], v);
        }
        write(values, &mut y.row_mut(t)[outputs.clone()]);
    }
}

/// Kept out of line, like the activations: most products have neither, and their constants occupy
/// registers.
#[inline(never)]
#[avx512vnni]
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
#[avx512vnni]
fn activate_all(activation: Activation, values: &mut [[f32; PANEL]]) {
    for v in values {
        let active = activate(activation, load(v));
        store(v, active);
    }
}

/// `y = values`; there may be more values than outputs.
#[inline]
#[avx512vnni]
fn write(values: &[[f32; PANEL]], y: &mut [f32]) {
    let (y, y_tail) = y.as_chunks_mut::<PANEL>();
    // One match arm per count: the compiler turns a loop into a call of `memcpy`, which
    // takes longer than so few stores.
    match (&mut *y, values) {
        ([a], [v, ..]) => store(a, load(v)),
        ([a, b], [v, w, ..]) => {
            store(a, load(v));
            store(b, load(w));
        }
        ([a, b, c], [v, w, x, ..]) => {
            store(a, load(v));
            store(b, load(w));
            store(c, load(x));
        }
        ([a, b, c, d], [v, w, x, z, ..]) => {
            store(a, load(v));
            store(b, load(w));
            store(c, load(x));
            store(d, load(z));
        }
        (y, values) => {
            for (y, v) in y.iter_mut().zip(values) {
                store(y, load(v));
            }
        }
    }
    if !y_tail.is_empty() {
        store_part(y_tail, load(&values[y.len()]));
    }
}

/// `y = f(y, values)`; there may be more values than outputs.
#[inline]
#[avx512vnni]
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
