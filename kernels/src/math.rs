//! Exponentials, the two forms of GELU and the other activations, on every back-end.
//!
//! | function | bound | used by |
//! |---|---|---|
//! | `exp` | 1 ULP; 0 below -87.33 | softmax, and the factor between blocks of attention |
//! | `softmax_exp` | 1 ULP for `x <= 0`; 0 below -87.33 | attention in f32 |
//! | `softmax_exp_reduce` | 1.5 ULP plus `1.25 * 2^-24 * abs(x)` of the value for `x <= 0` | attention in f32 on tiles |
//! | `exp2_bf16`, `exp2_bf16_unmasked` | 1.03e-4 of the value for `t <= 0` | attention with bf16 factors |
//! | `gelu_erf`, `gelu_tanh` | 4 ULP plus `1e-7 * abs(x)` | epilogues of products |
//!
//! `tests.rs` sweeps every bound over all exponents. The vector versions of `exp`, `exp2_bf16` and
//! the activations follow `scalar.rs` operation by operation, so that all back-ends agree **bit for
//! bit**. Multiplications and additions of `exp` are rounded separately, since fused ones cost a
//! library call each in portable scalar code. GELU, most of the work of an epilogue, is fused: the
//! tanh form has 19 operations, the erf form 21.

pub(crate) mod scalar;
#[cfg(target_arch = "wasm32")]
pub(crate) mod simd128;

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512vnni;
#[cfg(target_arch = "aarch64")]
pub(crate) mod neon;

/// An element-wise function.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Activation {
    /// The identity.
    #[default]
    None,
    /// `max(v, 0)`.
    Relu,
    /// `v` if positive, else `slope * v`.
    LeakyRelu(f32),
    /// `v * (1 + erf(v / sqrt(2))) / 2`.
    Gelu,
    /// The tanh approximation of GELU.
    GeluTanh,
}

/// Above this, `exp` is infinite.
const EXP_MAX: f32 = 88.722_84;
/// Below this, `exp` is 0: a little above the logarithm of the smallest normal number, so that no
/// result is denormal.
const EXP_MIN: f32 = -87.33;

/// `log2(e)`.
pub(crate) const LOG2_E: f32 = core::f32::consts::LOG2_E;
/// Adding and subtracting it rounds to an integer (ties to even), which the lowest bits of the
/// sum hold.
const ROUND: f32 = 12_582_912.0;
/// `ln(2)` to 9 bits: its product with an exponent is exact.
const LN_2_HIGH: f32 = 0.693_359_4;
/// The remainder of `ln(2)`.
const LN_2_LOW: f32 = -2.121_944_4e-4;
/// Minimax `(exp(r) - 1 - r) / r^2` for `abs(r) <= ln(2) / 2`, highest power first: off by 3.1e-9
/// in `exp(r)`.
const EXP: [f32; 5] = [0.001_395_049_2, 0.008_368_89, 0.041_666_206, 0.166_665_18, 0.5];

/// `-2 * sqrt(2 / pi) * log2(e)`.
const TANH_SCALE: f32 = -2.302_208_2;
/// [`TANH_SCALE`] times the cube's coefficient in the tanh form, 0.044715.
const TANH_CUBE: f32 = -0.102_943_24;
/// Limit on the exponent of the tanh form: the power stays normal, and the sigmoid
/// is within 1.2e-38 of 0 or 1.
const TANH_MAX: f32 = 126.0;
/// Minimax `(2^f - 1) / f` for `abs(f) <= 1 / 2`, highest power first: error 1.1e-7 in `2^f`,
/// at most a quarter of that in the sigmoid, and half in the normal distribution's tail.
#[expect(clippy::approx_constant, reason = "the last coefficient is fitted, and happens to lie near ln(2)")]
const EXP2: [f32; 5] = [0.001_326_472_7, 0.009_671_513, 0.055_507_336, 0.240_222_42, 0.693_147];

/// Beyond this the normal distribution's tail is constant: 3e-16.
const TAIL_MAX: f32 = 8.0;
/// Minimax of `log2(erfc(a / sqrt(2)) / 2)` on `0..=8`, weighted by the tail plus 3e-8, highest
/// power first: error 2e-8 in the tail. A polynomial in the exponent needs no division and
/// keeps the tail's magnitude.
const TAIL: [f32; 9] = [
    -1.533_552_1e-6,
    2.541_39e-5,
    -1.273_172_5e-4,
    -2.617_050_2e-4,
    0.007_204_758,
    -0.052_580_08,
    -0.459_184_47,
    -1.151_107_8,
    -0.999_999_94,
];

/// Minimax `(2^r - 1) / r` on `0..=1`, highest power first: off by 2e-9 in `2^r`.
#[cfg(all(target_arch = "x86_64", any(test, target_os = "linux")))]
const EXP2_UNIT: [f32; 6] =
    [0.000_216_129_16, 0.001_246_784_6, 0.009_675_452, 0.055_485_282, 0.240_229_31, 0.693_147_06];

/// Minimax `(2^r - 1) / r` on `0..=1` with the value 1 at 1, highest power first: error 1.03e-4
/// of `2^r`, where rounding to bf16 has up to 4e-3. A difference slightly below 0 rounds to `r
/// = 1`, and its weight to 1, as at 0.
const EXP2_BF16: [f32; 3] = [0.078_267_97, 0.226_307_68, 0.695_424_3];

/// Adding and subtracting it rounds a number in `1..=2` to bf16, ties to even.
#[cfg(target_arch = "x86_64")]
const ROUND_BF16: f32 = 98_304.0;

/// The smallest exponent of a normal power of 2; smaller powers are flushed to 0.
const EXP2_BF16_MIN: f32 = -126.0;

#[cfg(test)]
mod tests;
