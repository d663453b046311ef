//! Detection of the instruction sets of x86-64, and the tokens that prove it.

use super::Backend;
use super::std::is_x86_feature_detected;
use crate::tuning::Tuning;
use core::arch::x86_64::*;
use core::hint::black_box;

macro_rules! tokens {
    ($($(#[$meta:meta])* $name:ident),* $(,)?) => {$(
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) struct $name(());
    )*};
}

// A token proves that the processor has every feature that the attribute of the same name in
// `umo_kernels_features` enables. The constructors are private to this module, each in the function
// that detects them.
tokens! {
    /// AVX2 and FMA.
    Avx2,
    /// The features of [`Avx2`], and AVX-VNNI.
    AvxVnni,
    /// The features of [`Avx2`], AVX-512 F, BW, DQ, VL and VNNI.
    Avx512Vnni,
    /// The features of [`Avx512Vnni`] and AVX512-BF16, whose `vdpbf16ps` rounds like two fused
    /// multiply-adds.
    Avx512Bf16,
    /// The features of [`Avx512Vnni`], AVX512-BF16, and tiles with products of int8 and bf16,
    /// granted by the system.
    #[cfg(target_os = "linux")]
    Amx,
}

impl Avx2 {
    fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
    }
}

impl AvxVnni {
    fn detect() -> Option<Self> {
        Avx2::detect()?;
        is_x86_feature_detected!("avxvnni").then_some(Self(()))
    }
}

impl Avx512Vnni {
    fn detect() -> Option<Self> {
        Avx2::detect()?;
        let supported = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512vnni");
        supported.then_some(Self(()))
    }
}

impl Avx512Bf16 {
    fn detect() -> Option<Self> {
        Avx512Vnni::detect()?;
        // SAFETY: the processor has both features of the function.
        let supported = is_x86_feature_detected!("avx512bf16") && unsafe { dot_product_rounds_each_addition() };
        supported.then_some(Self(()))
    }
}

#[cfg(target_os = "linux")]
impl Amx {
    fn detect() -> Option<Self> {
        Avx512Vnni::detect()?;
        (is_x86_feature_detected!("avx512bf16") && amx::available()).then_some(Self(()))
    }
}

// Conversions from a stronger token to a weaker one.

impl From<AvxVnni> for Avx2 {
    fn from(_: AvxVnni) -> Self {
        Self(())
    }
}

impl From<Avx512Vnni> for Avx2 {
    fn from(_: Avx512Vnni) -> Self {
        Self(())
    }
}

impl From<Avx512Bf16> for Avx2 {
    fn from(_: Avx512Bf16) -> Self {
        Self(())
    }
}

#[cfg(target_os = "linux")]
impl From<Amx> for Avx2 {
    fn from(_: Amx) -> Self {
        Self(())
    }
}

impl From<Avx512Bf16> for Avx512Vnni {
    fn from(_: Avx512Bf16) -> Self {
        Self(())
    }
}

#[cfg(target_os = "linux")]
impl From<Amx> for Avx512Vnni {
    fn from(_: Amx) -> Self {
        Self(())
    }
}

/// Every back-end of x86-64, slowest first.
pub(super) fn backends() -> impl Iterator<Item = (&'static str, Option<Backend>)> {
    let mut avx512 = [
        ("avx512vnni", Avx512Vnni::detect().map(Backend::Avx512Vnni)),
        ("avx512bf16", Avx512Bf16::detect().map(Backend::Avx512Bf16)),
    ];
    if !Tuning::detect().fast_bf16_dot {
        avx512.reverse();
    }
    let [slower, faster] = avx512;
    [
        ("avx2", Avx2::detect().map(Backend::Avx2)),
        ("avxvnni", AvxVnni::detect().map(Backend::AvxVnni)),
        slower,
        faster,
        #[cfg(target_os = "linux")]
        ("amx", Amx::detect().map(Backend::Amx)),
    ]
    .into_iter()
}

/// Whether `vdpbf16ps` first adds the product of the upper halves of a lane and rounds after
/// each of the two additions, which its description leaves partly open. The other back-ends compute
/// in this way.
#[target_feature(enable = "avx512f,avx512bf16")]
fn dot_product_rounds_each_addition() -> bool {
    const ONE: i32 = 0x3f80;
    const MINUS_ONE: i32 = 0xbf80;
    const HALF_ULP_OF_ONE: i32 = 0x3380;
    let dot = |start: f32, upper: i32, lower: i32| {
        let x = _mm512_set1_epi32(black_box(upper << 16 | lower));
        let w = _mm512_set1_epi32(ONE << 16 | ONE);
        // SAFETY: both types are 64 bytes, and any bits are valid for both.
        let [x, w] = [x, w].map(|words| unsafe { core::mem::transmute::<__m512i, __m512bh>(words) });
        _mm512_cvtss_f32(_mm512_dpbf16_ps(_mm512_set1_ps(start), x, w))
    };
    // Half an ulp twice: each addition rounds to 1, while their sum would not. 1 - 1 + half an
    // ulp: lost in the other order.
    dot(1.0, HALF_ULP_OF_ONE, HALF_ULP_OF_ONE) == 1.0 && dot(1.0, MINUS_ONE, HALF_ULP_OF_ONE) == f32::EPSILON / 2.0
}

/// AMX, which requires both the processor and the permission of the system.
#[cfg(target_os = "linux")]
mod amx {
    use core::arch::x86_64::{__cpuid_count, _xgetbv};

    /// AMX-TILE, AMX-BF16 and AMX-INT8 in CPUID leaf 7.
    const TILE_BF16_INT8: u32 = 1 << 24 | 1 << 22 | 1 << 25;
    /// XTILECFG and XTILEDATA in XCR0.
    const TILE_STATE: u64 = 1 << 17 | 1 << 18;

    pub(super) fn available() -> bool {
        cfg!(umo_emulated_tiles) || granted()
    }

    fn granted() -> bool {
        super::is_x86_feature_detected!("xsave")
            && __cpuid_count(7, 0).edx & TILE_BF16_INT8 == TILE_BF16_INT8
            // SAFETY: the processor has XSAVE, as AVX-512 was detected through this register.
            && unsafe { _xgetbv(0) } & TILE_STATE == TILE_STATE
            && permitted()
    }

    /// Requests tile data from Linux, once for the whole process, which then saves 8 KiB more
    /// per thread.
    fn permitted() -> bool {
        const ARCH_REQ_XCOMP_PERM: libc::c_long = 0x1023;
        const XFEATURE_XTILEDATA: libc::c_long = 18;
        // SAFETY: this system call takes two numbers and touches no memory of ours; on kernels without
        // it, it fails.
        unsafe { libc::syscall(libc::SYS_arch_prctl, ARCH_REQ_XCOMP_PERM, XFEATURE_XTILEDATA) == 0 }
    }
}
