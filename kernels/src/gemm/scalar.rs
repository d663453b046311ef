//! Epilogues of the scalar back-end, the reference for all others.

use super::Epilogue;
use crate::mat::MatMut;
use crate::math::scalar::{activate, gelu_tanh};
use crate::pack::PANEL;

/// Applies the epilogue to the sums of the outputs `first..` of row `t`.
pub(crate) fn store_panel(sums: [f32; PANEL], t: usize, first: usize, epilogue: Epilogue, y: &mut MatMut<f32>) {
    let outputs = first..(first + PANEL).min(y.cols());
    let value = |lane: usize| {
        let sum = epilogue.bias.map_or(sums[lane], |bias| sums[lane] + bias[first + lane]);
        activate(epilogue.activation, sum)
    };
    let row = epilogue.scatter.map_or(t, |scatter| scatter.rows[t] as usize);
    let y = &mut y.row_mut(row)[outputs];
    for (lane, y) in y.iter_mut().enumerate() {
        *y = match epilogue.scatter {
            Some(scatter) => *y + scatter.weight[t] * value(lane),
            None if epilogue.add => *y + value(lane),
            None => value(lane),
        };
    }
}

/// Applies the epilogue to the gated outputs `first..` of row `t`.
pub(crate) fn store_gated_panel(gate: [f32; PANEL], up: [f32; PANEL], t: usize, first: usize, y: &mut MatMut<f32>) {
    let outputs = first..(first + PANEL).min(y.cols());
    for ((y, gate), up) in y.row_mut(t)[outputs].iter_mut().zip(gate).zip(up) {
        *y = gelu_tanh(gate) * up;
    }
}
