//! Tuning profiles: the properties of a family of processors beyond its instruction set. A
//! profile determines the order of memory accesses and of exact operations, and never a result.

/// The performance properties of a family of processors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tuning {
    /// Memory is read in one stream; otherwise in several streams side by side.
    pub(crate) one_stream: bool,
    /// One stream of int8 weights is prefetched 4 KiB ahead, into L2; otherwise 16 KiB ahead, into
    /// L1.
    pub(crate) near_prefetch: bool,
    /// Memory-bound products of few rows with quantized weights in one stream rely on the hardware
    /// prefetcher.
    pub(crate) own_prefetch: bool,
    /// Attention prefetches the keys and values that it reads itself; otherwise the operands of the
    /// next operation.
    pub(crate) self_prefetch: bool,
    /// Int8 inputs are offset to unsigned when loaded; otherwise beforehand, in a buffer.
    pub(crate) offset_on_load: bool,
    /// `vdpbf16ps` has the issue rate of `vfmadd231ps`, so that it doubles the rate of
    /// multiply-adds.
    pub(crate) fast_bf16_dot: bool,
}

impl Tuning {
    /// Intel Xeon: eight streams have up to 1.5 times the bandwidth of one; `vdpbf16ps` has a
    /// quarter of the issue rate of `vfmadd231ps`.
    pub const XEON: Self = Self {
        one_stream: false,
        near_prefetch: false,
        own_prefetch: false,
        self_prefetch: false,
        offset_on_load: false,
        fast_bf16_dot: false,
    };

    /// AMD Zen 5: one stream has 1.5 times the bandwidth of eight.
    pub const ZEN5: Self = Self {
        one_stream: true,
        near_prefetch: false,
        own_prefetch: false,
        self_prefetch: true,
        offset_on_load: true,
        fast_bf16_dot: true,
    };

    /// AMD Zen 4: as Zen 5, but with near prefetches, which make a decoder step a tenth faster, and none for products
    /// that its hardware prefetcher makes faster, by a fifth to a quarter.
    pub const ZEN4: Self = Self { near_prefetch: true, own_prefetch: true, ..Self::ZEN5 };

    /// Arm: one stream, which the hardware prefetchers follow. Not measured.
    #[cfg(target_arch = "aarch64")]
    pub(crate) const ARM: Self = Self {
        one_stream: true,
        near_prefetch: false,
        own_prefetch: false,
        self_prefetch: false,
        offset_on_load: false,
        fast_bf16_dot: false,
    };

    /// The measured profiles.
    pub const ALL: [Self; 3] = [Self::XEON, Self::ZEN5, Self::ZEN4];

    /// The profile for this processor's vendor.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn detect() -> Self {
        let leaf = core::arch::x86_64::__cpuid(0);
        let vendor = [leaf.ebx, leaf.edx, leaf.ecx].map(u32::to_le_bytes);
        if vendor.as_flattened() == b"AuthenticAMD" { Self::of_zen() } else { Self::XEON }
    }

    /// The profile of this processor, if it is a Zen.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn of_zen() -> Self {
        Self::of_zen_family(core::arch::x86_64::__cpuid(1).eax)
    }

    /// The profile of a Zen by its signature from leaf 1 of `cpuid`: Zen 4 is the last of its family.
    #[cfg(target_arch = "x86_64")]
    const fn of_zen_family(signature: u32) -> Self {
        const FAMILY_OF_ZEN4: u32 = 0x19;
        let family = (signature >> 8 & 0xf) + (signature >> 20 & 0xff);
        if family <= FAMILY_OF_ZEN4 { Self::ZEN4 } else { Self::ZEN5 }
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;

    #[test]
    fn zen_4_and_zen_5_are_told_apart_by_family() {
        // EPYC 7763 (Zen 3), 9654 (Zen 4) and 9755 (Zen 5).
        for (signature, profile) in
            [(0x00A0_0F11, Tuning::ZEN4), (0x00A1_0F11, Tuning::ZEN4), (0x00B0_0F21, Tuning::ZEN5)]
        {
            assert_eq!(Tuning::of_zen_family(signature), profile, "{signature:#x}");
        }
    }
}
