//! 4 outputs per multiplication and addition, one sum per output in ascending order of inputs: the
//! scalar order of roundings, so that all products have the scalar bits.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::{Epilogue, GemmTask, Input, Panels, tiles};
use crate::isa::Simd128;
use crate::lanes::simd128::{REGISTERS, Register, add, load_all, mul, multiply_add, splat, store_all, zero};
use crate::mat::MatMut;
use crate::math::Activation;
use crate::math::simd128::{activate, gelu_tanh};
use crate::pack::{PANEL, QUAD};
use crate::tiling::Tiling;

/// Rows of the largest tile: 3 rows x 1 panel are 12 registers of sums, which leaves 4 of the 16
/// of most processors.
pub(crate) const ROWS: usize = 3;
/// Panels whose epilogue runs at once: a gate and an up panel.
pub(crate) const WIDTH: usize = 2;

/// Rows of panels whose weights are widened to f32 when loaded.
pub(crate) trait Load: Copy {
    /// Inputs of one row.
    const INPUTS: usize;
    /// The weights of input `which` of the row.
    fn load(&self, which: usize) -> [Register; REGISTERS];
}

/// Sizes at which the loops change.
pub(crate) fn tiling(_token: Simd128) -> Tiling {
    Tiling { rows: &[ROWS], outputs: &[PANEL, WIDTH * PANEL], inputs: &[QUAD], held: 0, chunk: 0 }
}

/// Computes the whole product: all rows pass each pair of panels while it is in the cache.
pub(crate) fn run<'a, W: Panels<'a, Row: Load>>(x: Input<f32>, task: &GemmTask<'_, W>, mut y: MatMut<f32>) {
    let k = task.k();
    for slot in (0..task.slots()).step_by(WIDTH) {
        let width = WIDTH.min(task.slots() - slot);
        for (t, rows) in tiles(x.rows(), ROWS) {
            let mut sums = [[0.0; PANEL]; ROWS * WIDTH];
            let sums = &mut sums[..rows * width];
            for i in 0..width {
                let panel = task.panel(slot + i);
                match rows {
                    1 => multiply::<W::Row, 1>(&x, t, k, panel, &mut sums[i..], width),
                    2 => multiply::<W::Row, 2>(&x, t, k, panel, &mut sums[i..], width),
                    ROWS => multiply::<W::Row, ROWS>(&x, t, k, panel, &mut sums[i..], width),
                    rows => unreachable!("a tile of {rows} rows"),
                }
            }
            match task {
                GemmTask::Plain(_, epilogue) => store_tile(sums, width, t, slot * PANEL, epilogue, &mut y),
                GemmTask::Gated(..) => store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, &mut y),
            }
        }
    }
}

/// The innermost tile: `R` rows of `k` inputs with one panel, to every `width`th of `sums`.
#[inline(never)]
fn multiply<W: Load, const R: usize>(
    x: &Input<f32>,
    t: usize,
    k: usize,
    panel: &[W],
    sums: &mut [[f32; PANEL]],
    width: usize,
) {
    let panel = &panel[..k.div_ceil(W::INPUTS)];
    let mut rows = [&[][..]; R];
    for r in 0..R {
        rows[r] = &x.row(t + r)[..k];
    }
    let mut acc = [[zero(); REGISTERS]; R];
    for i in 0..k {
        let weights = panel[i / W::INPUTS].load(i % W::INPUTS);
        for r in 0..R {
            let x = splat(rows[r][i]);
            for g in 0..REGISTERS {
                acc[r][g] = multiply_add(x, weights[g], acc[r][g]);
            }
        }
    }
    for r in 0..R {
        store_all(&mut sums[r * width], acc[r]);
    }
}

/// Applies the epilogue to `values [rows, panels]`: the outputs from `first` on of the rows from `t` on.
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
        for values in values.chunks_exact_mut(panels) {
            values.as_flattened_mut().iter_mut().zip(&bias[outputs.clone()]).for_each(|(v, bias)| *v += bias);
        }
    }
    if epilogue.activation != Activation::None {
        for v in values.iter_mut() {
            store_all(v, load_all(v).map(|v| activate(epilogue.activation, v)));
        }
    }
    for (t, values) in (t..).zip(values.chunks_exact(panels)) {
        if let Some(scatter) = epilogue.scatter {
            let factor = splat(scatter.weight[t]);
            let y = &mut y.row_mut(scatter.rows[t] as usize)[outputs.clone()];
            combine(values, y, |old, v| add(old, mul(factor, v)));
        } else if epilogue.add {
            combine(values, &mut y.row_mut(t)[outputs.clone()], add);
        } else {
            combine(values, &mut y.row_mut(t)[outputs.clone()], |_, v| v);
        }
    }
}

/// Applies the gate to `values [rows, 2 * panels]`, in which gate and up panels alternate, and
/// stores the products.
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
            let (gate, mut product) = (load_all(&values[2 * i]), load_all(&values[2 * i + 1]));
            for g in 0..REGISTERS {
                product[g] = mul(gelu_tanh(gate[g]), product[g]);
            }
            store_all(&mut values[i], product);
        }
        combine(values, &mut y.row_mut(t)[outputs.clone()], |_, v| v);
    }
}

/// `y = f(y, values)`; there may be more values than outputs.
#[inline]
fn combine(values: &[[f32; PANEL]], y: &mut [f32], f: impl Fn(Register, Register) -> Register) {
    let both = |y: &mut [f32; PANEL], v: &[f32; PANEL]| {
        let (mut old, v) = (load_all(y), load_all(v));
        for g in 0..REGISTERS {
            old[g] = f(old[g], v[g]);
        }
        store_all(y, old);
    };
    let (y, y_tail) = y.as_chunks_mut::<PANEL>();
    for (y, v) in y.iter_mut().zip(values) {
        both(y, v);
    }
    if !y_tail.is_empty() {
        let mut whole = [0.0; PANEL];
        whole[..y_tail.len()].copy_from_slice(y_tail);
        both(&mut whole, &values[y.len()]);
        y_tail.copy_from_slice(&whole[..y_tail.len()]);
    }
}
