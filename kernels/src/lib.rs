//! Compute kernels of umo: slices in, slices out, no allocation.
//!
//! Every operation is one module: `<op>.rs` has its contract, its shape checks and the dispatch
//! over [`Isa`], `<op>/<isa>.rs` its back-ends. `scalar.rs` is the reference for all other
//! back-ends, and the back-end of every processor without a vector version.
//!
//! | module | operations | SPEC |
//! |---|---|---|
//! | [`matmul_f32`], [`matmul_bf16`], [`matmul_i8`], [`matmul_i4`] | `x . w^T` with packed weights, plain, gated, gathered and scattered | 2.4 |
//! | [`product`] | the plan of a product, and products with weights of any type | 2.4 |
//! | [`attention`] | softmax(q . k^T + bias) . v for one head | 2.4, 2.1, 2.6 |
//! | [`experts`] | top-k routing and the counting sort of rows by expert | 2.4 |
//! | [`conv1d`] | windows over time as the rows of a product, grouped convolution | 2.1, 2.7 |
//! | [`filter`] | outputs of a finite impulse response: resampling | |
//! | [`norm`] | RMS norm, layer norm, per-channel statistics over time | 2.1, 2.4 |
//! | [`activation`] | GELU (erf and tanh forms), softmax, argmax | 2.4, 2.5 |
//! | [`quantize`] | rows quantized to int8 | 2.4 |
//! | [`gemm`] | shared parts of the products: inputs, epilogues, panels, micro-kernels | |
//! | [`environment`] | the rounding, traps and denormals that all results require | |
//! | [`peak`] | peak rates of this processor, for measurements | |
//! | [`mat`], [`pack`], [`error`] | views, weight layouts, the error type | |
//! | [`isa`], [`tuning`] | instruction sets: detection, tokens that prove them, dispatch; processor profiles | |
//!
//! A convolution over time is a matrix product: rows of a [`Mat`] may overlap, so that a window of
//! `kernel` frames with `channels` values each *is* a row of `kernel * channels` values at stride
//! `step * channels`.
#![no_std]
#![cfg_attr(
    target_arch = "x86_64",
    expect(clippy::duplicate_mod, reason = "loops are compiled once per instruction set")
)]

/// Path of this source file, by which callers distinguish panics of this crate.
#[doc(hidden)]
pub const SOURCE: &str = file!();

pub mod activation;
#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx;
pub mod attention;
pub mod bf16;
pub mod conv1d;
pub mod environment;
pub mod error;
pub mod experts;
pub mod filter;
pub mod gemm;
pub mod isa;
mod lanes;
pub mod mat;
mod math;
pub mod matmul_bf16;
pub mod matmul_f32;
pub mod matmul_i4;
pub mod matmul_i8;
pub mod norm;
pub mod pack;
pub mod peak;
mod prefetch;
pub mod product;
pub mod quantize;
#[doc(hidden)]
pub mod tiling;
pub mod tuning;

pub use bf16::Bf16;
pub use error::ShapeError;
pub use isa::Isa;
pub use mat::{Mat, MatMut};
pub use pack::{PANEL, PackedBf16, PackedF32, PackedI4, PackedI8};
pub use prefetch::{PrefetchHint, SharedHint};
