//! The loops of the back-ends with panels of two registers, compiled once per instruction set:
//! each includes this file as its module `loops`, and its module `vector` has the registers with
//! their operations, the attribute `features`, and `RELOADS`. One sum per output, in ascending
//! order of inputs.

use super::vector::{
    RELOADS, Register, activate, add, features, fmadd, gelu_tanh, load_two as load, mul, splat, store_two as store,
    zero,
};
use crate::gemm::{Epilogue, GemmTask, Input, Panels, opaque, tiles};
use crate::mat::MatMut;
use crate::math::Activation;
use crate::pack::{PANEL, QUAD};
use crate::prefetch;
use crate::tiling::Tiling;

/// Rows of the largest tile: 6 rows x 1 panel are 12 registers of sums, of the 16 of AVX2,
/// or 24 of NEON's 32. The others are for weights and one input.
const ROWS: usize = 6;
/// Rows times panels from which sums leave no registers for values to be reused.
const FULL: usize = 5;
/// Panels whose epilogue runs at once in tiles of more than one row: a gate and an up panel.
const PAIR: usize = 2;
/// Prefetch distance from L2 in rows of a panel.
const PREFETCH_DISTANCE: usize = 16;
/// Most panels whose epilogue runs at once.
const MAX_PANELS: usize = 4;

/// Rows of panels whose weights are widened to f32 when loaded.
pub(crate) trait Load: Copy {
    /// Inputs of one row.
    const INPUTS: usize;
    /// The weights of input `i`.
    /// # Safety
    /// The processor has the features of this back-end; `panel` points to a whole panel
    /// that contains input `i`.
    unsafe fn load(panel: *const Self, i: usize) -> [Register; 2];
}

impl Load for [f32; PANEL] {
    const INPUTS: usize = 1;

    #[inline]
    #[features]
    unsafe fn load(panel: *const Self, i: usize) -> [Register; 2] {
        // SAFETY: row `i` is inside the panel by this function's contract.
        load(unsafe { &*panel.wrapping_add(i) })
    }
}

/// Sizes at which the loops change.
pub(super) const TILING: Tiling = Tiling {
    rows: &[PAIR, ROWS],
    outputs: &[PANEL, PAIR * PANEL, MAX_PANELS * PANEL],
    inputs: &[QUAD, PREFETCH_DISTANCE],
    held: 0,
    chunk: 0,
};

/// Computes the whole product: all rows pass each group of panels while it is in the cache. `FUSED`: products are not
/// rounded before they are added.
#[features]
pub(crate) fn run<'a, W: Panels<'a, Row: Load>, const FUSED: bool>(
    x: Input<f32>,
    task: &GemmTask<'_, W>,
    mut y: MatMut<f32>,
) {
    let mut slot = 0;
    while slot < task.slots() {
        let width = if slot + MAX_PANELS <= task.slots() { MAX_PANELS } else { PAIR.min(task.slots() - slot) };
        for (t, rows) in tiles(x.rows(), ROWS) {
            match rows {
                1 => tile::<W, 1, 4, MAX_PANELS, FUSED>(&x, t, task, slot, width, &mut y),
                2 => tile::<W, 2, 2, PAIR, FUSED>(&x, t, task, slot, width, &mut y),
                3 => tile::<W, 3, 2, PAIR, FUSED>(&x, t, task, slot, width, &mut y),
                4 => tile::<W, 4, 1, PAIR, FUSED>(&x, t, task, slot, width, &mut y),
                5 => tile::<W, 5, 1, PAIR, FUSED>(&x, t, task, slot, width, &mut y),
                ROWS => tile::<W, ROWS, 1, PAIR, FUSED>(&x, t, task, slot, width, &mut y),
                rows => unreachable!("a tile of {rows} rows"),
            }
        }
        slot += width;
    }
}

/// Processes `R` rows from `t` on with `width` slots, `WIDTH` in a group, `P` of them at a
/// time.
#[features]
fn tile<'a, W: Panels<'a, Row: Load>, const R: usize, const P: usize, const WIDTH: usize, const FUSED: bool>(
    x: &Input<f32>,
    t: usize,
    task: &GemmTask<'_, W>,
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
    while slot + WIDTH <= end {
        group::<W, R, P, WIDTH, FUSED>(&rows, t, task, slot, y);
        slot += WIDTH;
    }
    while WIDTH > PAIR && slot + PAIR <= end {
        group::<W, R, PAIR, PAIR, FUSED>(&rows, t, task, slot, y);
        slot += PAIR;
    }
    if slot < end {
        group::<W, R, 1, 1, FUSED>(&rows, t, task, slot, y);
    }
}

/// Processes `R` rows with `WIDTH` slots from `slot` on, from the first input through the epilogue.
#[features]
fn group<'a, W: Panels<'a, Row: Load>, const R: usize, const P: usize, const WIDTH: usize, const FUSED: bool>(
    rows: &[&[f32]; R],
    t: usize,
    task: &GemmTask<'_, W>,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut sums = [[[0.0; PANEL]; WIDTH]; R];
    for i in (0..WIDTH).step_by(P) {
        // Not with `from_fn`: a closure has this function's features and cannot be inlined into a
        // function without them.
        let mut panels = [&[][..]; P];
        for (p, panel) in panels.iter_mut().enumerate() {
            *panel = task.panel(slot + i + p);
        }
        multiply::<_, R, P, WIDTH, FUSED>(rows, panels, &mut sums, i);
    }
    let sums = sums.as_flattened_mut();
    match task {
        GemmTask::Plain(_, epilogue) => store_tile(sums, WIDTH, t, slot * PANEL, epilogue, y),
        GemmTask::Gated(..) => store_gated_tile(sums, WIDTH / 2, t, slot / 2 * PANEL, y),
    }
}

/// The innermost tile: `R x P` panels of sums in registers, stored to `sums` from panel `first`
/// on. Kept out of line, so that it has all registers.
#[inline(never)]
#[features]
fn multiply<W: Load, const R: usize, const P: usize, const WIDTH: usize, const FUSED: bool>(
    rows: &[&[f32]; R],
    panels: [&[W]; P],
    sums: &mut [[[f32; PANEL]; WIDTH]; R],
    first: usize,
) {
    let k = rows[0].len();
    for row in rows {
        assert!(row.len() == k);
    }
    for panel in panels {
        assert!(panel.len() == k.div_ceil(W::INPUTS));
    }
    // Pointers: lengths are known to agree, and slices would keep them in registers.
    let (mut x, mut w) = ([core::ptr::null(); R], [core::ptr::null(); P]);
    for r in 0..R {
        x[r] = rows[r].as_ptr();
    }
    for p in 0..P {
        w[p] = panels[p].as_ptr();
    }
    let mut acc = [[[zero(); 2]; P]; R];
    // Unrolled by two, so that the position in a pair is a constant.
    for i in (0..k - k % 2).step_by(2) {
        for which in 0..2 {
            // SAFETY: `i + which < k`: all rows and all panels have this input.
            unsafe { step::<W, R, P, FUSED>(&mut acc, &x, &w, i + which) };
        }
    }
    if !k.is_multiple_of(2) {
        // SAFETY: as above, for the last input.
        unsafe { step::<W, R, P, FUSED>(&mut acc, &x, &w, k - 1) };
    }
    for r in 0..R {
        for p in 0..P {
            store(&mut sums[r][first + p], acc[r][p]);
        }
    }
}

/// Adds the products of input `i` of `R` rows with the weights of `P` panels.
/// # Safety
/// `x` point to rows and `w` to panels that have this input.
#[inline]
#[features]
unsafe fn step<W: Load, const R: usize, const P: usize, const FUSED: bool>(
    acc: &mut [[[Register; 2]; P]; R],
    x: &[*const f32; R],
    w: &[*const W; P],
    i: usize,
) {
    for p in 0..P {
        // One prefetch per line, which two inputs of bf16 share.
        if i.is_multiple_of(W::INPUTS) {
            prefetch::to_l1(w[p].wrapping_add(i / W::INPUTS + PREFETCH_DISTANCE));
        }
        // Values are reloaded for other inputs or panels if sums fill the registers.
        let full = RELOADS[W::INPUTS - 1] && R * P >= FULL;
        let w = if full && !i.is_multiple_of(W::INPUTS) { opaque(w[p]) } else { w[p] };
        // SAFETY: the panel has the input by this function's contract, and this function enables
        // the features.
        let weights = unsafe { W::load(w, i) };
        for r in 0..R {
            let x = if full && p > 0 { opaque(x[r]) } else { x[r] };
            // SAFETY: the row has the input by this function's contract.
            let x = splat(unsafe { *x.wrapping_add(i) });
            for half in 0..2 {
                let sum = acc[r][p][half];
                acc[r][p][half] = if FUSED { fmadd(x, weights[half], sum) } else { add(mul(x, weights[half]), sum) };
            }
        }
    }
}

/// Applies the epilogue to `values [rows, panels]`: the outputs from `first` on of the rows from `t` on.
#[inline]
#[features]
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
            let factor = splat(scatter.weight[t]);
            let y = &mut y.row_mut(scatter.rows[t] as usize)[outputs.clone()];
            combine(values, y, |old, v| add(old, mul(factor, v)));
        } else if epilogue.add {
            combine(values, &mut y.row_mut(t)[outputs.clone()], |old, v| add(old, v));
        } else {
            combine(values, &mut y.row_mut(t)[outputs.clone()], |_, v| v);
        }
    }
}

/// Applies the gate to `values [rows, 2 * panels]`, in which gate and up panels alternate, and
/// stores the products.
#[inline(never)]
#[features]
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
            let (gate, up) = (load(&values[2 * i]), load(&values[2 * i + 1]));
            let v = [mul(gelu_tanh(gate[0]), up[0]), mul(gelu_tanh(gate[1]), up[1])];
            store(&mut values[i], v);
        }
        combine(values, &mut y.row_mut(t)[outputs.clone()], |_, v| v);
    }
}

/// Kept out of line, like the activations: most products have neither, and their constants occupy
/// registers.
#[inline(never)]
#[features]
fn add_bias(values: &mut [[f32; PANEL]], panels: usize, bias: &[f32]) {
    let (bias, tail) = bias.as_chunks::<PANEL>();
    for values in values.chunks_exact_mut(panels) {
        for (v, bias) in values.iter_mut().zip(bias) {
            let (sum, bias) = (load(v), load(bias));
            store(v, [add(sum[0], bias[0]), add(sum[1], bias[1])]);
        }
        if let Some(v) = values.get_mut(bias.len()) {
            v.iter_mut().zip(tail).for_each(|(v, bias)| *v += bias);
        }
    }
}

#[inline(never)]
#[features]
fn activate_all(activation: Activation, values: &mut [[f32; PANEL]]) {
    for v in values {
        let [low, high] = load(v);
        store(v, [activate(activation, low), activate(activation, high)]);
    }
}

/// `y = f(y, values)`; there may be more values than outputs.
#[inline]
#[features]
fn combine(values: &[[f32; PANEL]], y: &mut [f32], f: impl Fn(Register, Register) -> Register) {
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
