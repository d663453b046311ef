//! The epilogue of a product: integer sums become floats, and the epilogue's operations are applied.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use crate::gemm::avx512vnni as float;
use crate::gemm::{Epilogue, GemmTask, Scaled};
use crate::lanes::avx512vnni::{lane_mask, load, load_part, store};
use crate::mat::MatMut;
use crate::math::Activation;
use crate::math::avx512vnni::gelu_tanh;
use crate::matmul_i8::input::QuantInput;
use crate::pack::PANEL;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// Runs the epilogue for the sums of `R` rows from `t` on with `P` slots from `slot` on, whose inputs were offset to
/// unsigned if their weights have sums. Common epilogues of whole panels are computed in registers.
#[inline]
#[avx512vnni]
pub(crate) fn end<'a, W: Scaled<'a>, const R: usize, const P: usize>(
    x: &QuantInput,
    t: usize,
    sums: &[[__m512i; P]; R],
    task: &GemmTask<W>,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut scales = [Scales::<128>::of(task, slot); P];
    for p in 1..P {
        scales[p] = Scales::of(task, slot + p);
    }
    match task {
        GemmTask::Plain(_, Epilogue { bias: None, activation: Activation::None, add, scatter: None })
            if (slot + P) * PANEL <= y.cols() =>
        {
            for r in 0..R {
                let x_scale = _mm512_set1_ps(x.scale(t + r));
                let y = &mut y.row_mut(t + r)[slot * PANEL..(slot + P) * PANEL];
                let (y, _) = y.as_chunks_mut::<PANEL>();
                for p in 0..P {
                    let v = scales[p].value(sums[r][p], x_scale);
                    let v = if *add { _mm512_add_ps(load(&y[p]), v) } else { v };
                    store(&mut y[p], v);
                }
            }
        }
        GemmTask::Gated(..) if (slot + P) / 2 * PANEL <= y.cols() => {
            for r in 0..R {
                let x_scale = _mm512_set1_ps(x.scale(t + r));
                let y = &mut y.row_mut(t + r)[slot / 2 * PANEL..(slot + P) / 2 * PANEL];
                let (y, _) = y.as_chunks_mut::<PANEL>();
                for i in 0..P / 2 {
                    let gate = scales[2 * i].value(sums[r][2 * i], x_scale);
                    let up = scales[2 * i + 1].value(sums[r][2 * i + 1], x_scale);
                    store(&mut y[i], _mm512_mul_ps(gelu_tanh(gate), up));
                }
            }
        }
        _ => {
            let mut values = [[[0.0; PANEL]; P]; R];
            for r in 0..R {
                let x_scale = _mm512_set1_ps(x.scale(t + r));
                for p in 0..P {
                    store(&mut values[r][p], scales[p].value(sums[r][p], x_scale));
                }
            }
            let values = values.as_flattened_mut();
            match task {
                GemmTask::Plain(_, epilogue) => float::store_tile(values, P, t, slot * PANEL, epilogue, y),
                GemmTask::Gated(..) => float::store_gated_tile(values, P / 2, t, slot / 2 * PANEL, y),
            }
        }
    }
}

/// Factors that convert the integer sums of a slot to floats, for inputs offset by `OFFSET`.
#[derive(Clone, Copy)]
pub(in crate::matmul_i8) struct Scales<const OFFSET: i32> {
    /// `OFFSET` times the sum of each output's weights.
    correction: __m512i,
    scale: __m512,
}

impl<const OFFSET: i32> Scales<OFFSET> {
    #[inline]
    #[avx512vnni]
    pub(in crate::matmul_i8) fn of<'a, W: Scaled<'a>>(task: &GemmTask<W>, slot: usize) -> Self {
        let (w, p) = task.slot(slot);
        let outputs = p * PANEL..((p + 1) * PANEL).min(w.n());
        let sum = load_sums_part(w.sums(outputs.clone()));
        Self { correction: _mm512_mullo_epi32(sum, _mm512_set1_epi32(OFFSET)), scale: load_part(&w.scale()[outputs]) }
    }

    /// The exact sum rounded to f32 once, then scalar's order of roundings.
    #[inline]
    #[avx512vnni]
    pub(in crate::matmul_i8) fn value(&self, sum: __m512i, x_scale: __m512) -> __m512 {
        let sum = _mm512_sub_epi32(sum, self.correction);
        _mm512_mul_ps(_mm512_cvtepi32_ps(sum), _mm512_mul_ps(x_scale, self.scale))
    }
}

#[inline]
#[avx512vnni]
fn load_sums_part(src: &[i32]) -> __m512i {
    // SAFETY: the mask selects only the elements of `src`; others are not read.
    unsafe { _mm512_maskz_loadu_epi32(lane_mask(src.len()), src.as_ptr()) }
}
