//! Ends of products on 16 lanes.

use super::Epilogue;
use crate::mat::MatMut;
use crate::math::avx512vnni::{activate, gelu_tanh};
use crate::pack::PANEL;
use core::arch::x86_64::*;

/// Ends the outputs `first..` of row `t`, of which `value(i)` gives the panels.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(crate) fn finish_row(
    value: impl Fn(usize) -> __m512,
    panels: usize,
    t: usize,
    first: usize,
    end: &Epilogue,
    y: &mut MatMut<f32>,
) {
    let outputs = first..(first + panels * PANEL).min(y.cols());
    let row = end.scatter.map_or(t, |scatter| scatter.rows[t] as usize);
    let factor = end.scatter.map(|scatter| _mm512_set1_ps(scatter.weight[t]));
    let bias = end.bias.map_or(&[][..], |bias| &bias[outputs.clone()]);
    let (y, y_tail) = y.row_mut(row)[outputs].as_chunks_mut::<PANEL>();
    let (bias, bias_tail) = bias.as_chunks::<PANEL>();
    let ended = |v, old| match factor {
        Some(factor) => _mm512_add_ps(old, _mm512_mul_ps(factor, v)),
        None if end.add => _mm512_add_ps(old, v),
        None => v,
    };
    for (i, y) in y.iter_mut().enumerate() {
        let v = bias.get(i).map_or(value(i), |bias| _mm512_add_ps(value(i), load(bias)));
        let v = ended(activate(end.activation, v), load(y));
        store(y, v);
    }
    if !y_tail.is_empty() {
        let v = value(y.len());
        let v = if bias_tail.is_empty() { v } else { _mm512_add_ps(v, load_part(bias_tail)) };
        let v = ended(activate(end.activation, v), load_part(y_tail));
        store_part(y_tail, v);
    }
}

/// Ends the gated outputs `first..` of row `t`, of which `gate(i)` and `up(i)` give the panels.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(crate) fn gated_row(
    gate: impl Fn(usize) -> __m512,
    up: impl Fn(usize) -> __m512,
    panels: usize,
    t: usize,
    first: usize,
    y: &mut MatMut<f32>,
) {
    let outputs = first..(first + panels * PANEL).min(y.cols());
    let (y, y_tail) = y.row_mut(t)[outputs].as_chunks_mut::<PANEL>();
    for (i, y) in y.iter_mut().enumerate() {
        store(y, _mm512_mul_ps(gelu_tanh(gate(i)), up(i)));
    }
    if !y_tail.is_empty() {
        store_part(y_tail, _mm512_mul_ps(gelu_tanh(gate(y.len())), up(y.len())));
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
fn lanes(len: usize) -> __mmask16 {
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
