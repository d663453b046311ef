//! Attributes that compile a function for one instruction set: the list of target features of each
//! back-end of `umo-kernels`, written once.
//!
//! `#[avx2] fn f() {}` is `#[target_feature(enable = "avx2,fma")] fn f() {}`. The compiler checks
//! the calls: such a function is safe to call from a function with at least the same features, and
//! from nowhere else. `umo_kernels::isa` detects the same features and issues a token for each list;
//! both must change together.

use proc_macro::TokenStream;

/// AVX2 with fused multiply-add.
#[proc_macro_attribute]
pub fn avx2(_: TokenStream, function: TokenStream) -> TokenStream {
    enable("avx2,fma", function)
}

/// [`macro@avx2`] with int8 dot products (`vpdpbusd`) in 256-bit registers.
#[proc_macro_attribute]
pub fn avxvnni(_: TokenStream, function: TokenStream) -> TokenStream {
    enable("avx2,fma,avxvnni", function)
}

/// AVX-512 (F, BW, DQ, VL) with int8 dot products.
#[proc_macro_attribute]
pub fn avx512vnni(_: TokenStream, function: TokenStream) -> TokenStream {
    enable("avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni", function)
}

/// [`macro@avx512vnni`] with bf16 dot products (`vdpbf16ps`) and conversions.
#[proc_macro_attribute]
pub fn avx512bf16(_: TokenStream, function: TokenStream) -> TokenStream {
    enable("avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512bf16", function)
}

/// NEON, which every 64-bit Arm processor has.
#[proc_macro_attribute]
pub fn neon(_: TokenStream, function: TokenStream) -> TokenStream {
    enable("neon", function)
}

/// [`macro@neon`] with int8 dot products (`sdot`).
#[proc_macro_attribute]
pub fn neon_dotprod(_: TokenStream, function: TokenStream) -> TokenStream {
    enable("neon,dotprod", function)
}

/// [`macro@neon_dotprod`] with int8 matrix products (`smmla`).
#[proc_macro_attribute]
pub fn neon_i8mm(_: TokenStream, function: TokenStream) -> TokenStream {
    enable("neon,dotprod,i8mm", function)
}

/// 128-bit SIMD of WebAssembly.
#[proc_macro_attribute]
pub fn simd128(_: TokenStream, function: TokenStream) -> TokenStream {
    enable("simd128", function)
}

fn enable(features: &str, function: TokenStream) -> TokenStream {
    let attribute = format!("#[target_feature(enable = \"{features}\")]");
    let mut result: TokenStream = attribute.parse().expect("an attribute with a string of features");
    result.extend(function);
    result
}
