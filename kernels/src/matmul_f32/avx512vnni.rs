//! Ends of products on 16 lanes.

use super::Epilogue;
use crate::mat::MatMut;
use crate::math::avx512vnni::{activate, gelu_tanh};
use crate::matmul_f32::Activation;
use crate::pack::PANEL;
use core::arch::x86_64::*;

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
