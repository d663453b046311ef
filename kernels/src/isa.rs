//! Which instruction sets this processor has, found out once.

// For processor detection only; linking it also gives `f32` its `sqrt` and friends. `Vec` and `Box` stay out of reach.
extern crate std;

/// An instruction set that this processor is known to support. Holding one is the proof.
///
/// Detect once when a model is loaded, store it, and pass it to every kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(pub(crate) Backend);

/// The back-ends. The feature strings that stand for each live in two places: here in
/// [`backends`], and in the `#[target_feature]` of that back-end's functions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Backend {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// The same where int8 is multiplied.
    #[cfg(target_arch = "x86_64")]
    AvxVnni,
    #[cfg(target_arch = "x86_64")]
    Avx512Vnni,
    /// The same where rows that are bfloat16 meet weights in bfloat16, and where few rows meet int8, in the order in which AMD's
    /// processors read fastest.
    #[cfg(target_arch = "x86_64")]
    Avx512Bf16,
    #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
    Amx,
}

#[cfg(target_arch = "x86_64")]
fn avx2() -> bool {
    std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma")
}

#[cfg(target_arch = "x86_64")]
fn avx512vnni() -> bool {
    avx2()
        && std::is_x86_feature_detected!("avx512f")
        && std::is_x86_feature_detected!("avx512bw")
        && std::is_x86_feature_detected!("avx512dq")
        && std::is_x86_feature_detected!("avx512vl")
        && std::is_x86_feature_detected!("avx512vnni")
}

/// Products of pairs of bfloat16, whose sums are rounded as those of the other back-ends are.
#[cfg(target_arch = "x86_64")]
fn avx512bf16() -> bool {
    // SAFETY: the processor has both features.
    avx512vnni() && std::is_x86_feature_detected!("avx512bf16") && unsafe { crate::bf16::avx512bf16::adds_one_by_one() }
}

/// Whether `vdpbf16ps`, which multiplies twice as many pairs as `vfmadd231ps`, comes as often: measured on a Zen 5, so said for
/// AMD's from Zen 4 on, who have it first. Intel's processors with AVX-512 issue it a quarter as often or have tiles.
#[cfg(target_arch = "x86_64")]
fn bf16_products_pay() -> bool {
    let maker = core::arch::x86_64::__cpuid(0);
    [maker.ebx, maker.edx, maker.ecx].map(u32::to_le_bytes).as_flattened() == b"AuthenticAMD"
}

/// Every back-end of this target and whether this processor has it, slowest first.
fn backends() -> impl Iterator<Item = (Backend, bool)> {
    // `avx512vnni.rs` files enable "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni" (and what the AVX2 back-end enables).
    #[cfg(target_arch = "x86_64")]
    let mut avx512 = [
        (Backend::Avx512Vnni, avx512vnni()),
        // `avx512bf16.rs` files use its one instruction by name.
        (Backend::Avx512Bf16, avx512bf16()),
    ];
    #[cfg(target_arch = "x86_64")]
    if !bf16_products_pay() {
        avx512.reverse();
    }
    [
        (Backend::Scalar, true),
        #[cfg(target_arch = "x86_64")]
        (Backend::Avx2, avx2()),
        // `avxvnni.rs` files enable "avxvnni" and what the AVX2 back-end enables.
        #[cfg(target_arch = "x86_64")]
        (Backend::AvxVnni, avx2() && std::is_x86_feature_detected!("avxvnni")),
        #[cfg(target_arch = "x86_64")]
        avx512[0],
        #[cfg(target_arch = "x86_64")]
        avx512[1],
        // `amx.rs` files enable what the AVX-512 back-end enables and "avx512bf16", and use tile instructions by name.
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        (Backend::Amx, avx512vnni() && std::is_x86_feature_detected!("avx512bf16") && amx::available()),
    ]
    .into_iter()
}

impl Isa {
    /// Portable code, on every processor.
    pub const SCALAR: Self = Self(Backend::Scalar);

    /// The fastest back-end that this processor supports.
    pub fn detect() -> Self {
        Self::available().last().unwrap_or(Self::SCALAR)
    }

    /// Every back-end that this processor supports, slowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        backends().filter(|(_, supported)| *supported).map(|(backend, _)| Self(backend))
    }

    /// Whether rows rounded to bf16 are multiplied faster than f32 ([`crate::matmul_bf16::matmul_bf16_rows`]), so that
    /// [`crate::bf16::round_bf16`] serves products that need no more digits.
    pub const fn multiplies_bf16(self) -> bool {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Backend::Avx512Bf16 => true,
            _ => self.has_tiles(),
        }
    }

    /// Whether memory comes faster from end to end than in streams beside each other: measured on a Zen 5, as an Intel Xeon's opposite.
    pub(crate) const fn reads_in_order(self) -> bool {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Backend::Avx512Bf16 => true,
            _ => false,
        }
    }

    /// The same without tiles, which take no f32: for float products whose inputs may not be rounded.
    #[must_use]
    pub const fn without_tiles(self) -> Self {
        match self.0 {
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            Backend::Amx => Self(Backend::Avx512Vnni),
            _ => self,
        }
    }

    /// Whether float products with bf16 weights go to tiles, so that [`crate::matmul_bf16::split`] serves them.
    pub const fn has_tiles(self) -> bool {
        match self.0 {
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            Backend::Amx => true,
            _ => false,
        }
    }

    /// The names of every back-end of this target, supported by this processor or not.
    pub fn names() -> impl Iterator<Item = &'static str> {
        backends().map(|(backend, _)| Self(backend).name())
    }

    /// The name used in files, tests, benches and logs.
    pub const fn name(self) -> &'static str {
        match self.0 {
            Backend::Scalar => "scalar",
            #[cfg(target_arch = "x86_64")]
            Backend::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Backend::AvxVnni => "avxvnni",
            #[cfg(target_arch = "x86_64")]
            Backend::Avx512Vnni => "avx512vnni",
            #[cfg(target_arch = "x86_64")]
            Backend::Avx512Bf16 => "avx512bf16",
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            Backend::Amx => "amx",
        }
    }

    /// The back-end of this name, if this processor supports it.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::available().find(|isa| isa.name() == name)
    }
}

/// Tiles of AMX, which the processor must have and the system must grant.
#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx {
    use core::arch::asm;
    use core::arch::x86_64::{__cpuid_count, _xgetbv};

    /// Tiles, and products of bf16 and of int8 on them, in leaf 7.
    const TILE_BF16_INT8: u32 = 1 << 24 | 1 << 22 | 1 << 25;
    /// Configuration and data of tiles, in the register of saved state.
    const TILE_STATE: u64 = 1 << 17 | 1 << 18;

    pub(super) fn available() -> bool {
        // Emulated, they are there.
        cfg!(umo_emulated_tiles) || granted()
    }

    fn granted() -> bool {
        super::std::is_x86_feature_detected!("xsave")
            && __cpuid_count(7, 0).edx & TILE_BF16_INT8 == TILE_BF16_INT8
            // SAFETY: the processor has XSAVE, and AVX-512 was found through this register.
            && unsafe { _xgetbv(0) } & TILE_STATE == TILE_STATE
            && permitted()
    }

    /// Asks Linux for the tiles' data, once for the whole process: it saves 8 KiB more per thread from then on.
    fn permitted() -> bool {
        /// `arch_prctl(ARCH_REQ_XCOMP_PERM, XFEATURE_XTILEDATA)`.
        const ARCH_PRCTL: i64 = 158;
        const REQUEST: i64 = 0x1023;
        const TILE_DATA: i64 = 18;
        let result: i64;
        // SAFETY: this system call takes two numbers and touches no memory of ours; it fails where it is unknown.
        unsafe {
            asm!("syscall", inout("rax") ARCH_PRCTL => result, in("rdi") REQUEST, in("rsi") TILE_DATA,
                out("rcx") _, out("r11") _, options(nostack));
        }
        result == 0
    }
}
