//! bfloat16 values: the upper half of an `f32`.

/// One bfloat16 value, stored as its 16 bits. Conversion to `f32` is exact; from `f32` it rounds to nearest, ties to even.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct Bf16(pub u16);

impl Bf16 {
    /// Rounds `value` to the nearest bfloat16 (ties to even; NaN stays NaN).
    #[inline]
    pub fn from_f32(value: f32) -> Self {
        Self(half::bf16::from_f32(value).to_bits())
    }

    /// The exact value as `f32`.
    #[inline]
    pub fn to_f32(self) -> f32 {
        f32::from_bits(u32::from(self.0) << 16)
    }
}
