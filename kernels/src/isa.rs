//! Which instruction sets this processor has, found out once.

// For processor detection only; linking it also gives `f32` its `sqrt` and friends. `Vec` and `Box` stay out of reach.
extern crate std;

/// An instruction set that this processor is known to support. Holding one is the proof.
///
/// Detect once when a model is loaded, store it, and pass it to every kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(pub(crate) Backend);

/// The back-ends, slowest first. The feature strings that stand for each live in two places: here in
/// [`Isa::available`], and in the `#[target_feature]` of that back-end's functions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Backend {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512Vnni,
}

/// Every back-end of this target and whether this processor has it, slowest first.
fn backends() -> impl Iterator<Item = (Backend, bool)> {
    [
        (Backend::Scalar, true),
        #[cfg(target_arch = "x86_64")]
        (Backend::Avx2, std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma")),
        // `avx512vnni.rs` files enable "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni" (and what the AVX2 back-end enables).
        #[cfg(target_arch = "x86_64")]
        (
            Backend::Avx512Vnni,
            std::is_x86_feature_detected!("avx2")
                && std::is_x86_feature_detected!("fma")
                && std::is_x86_feature_detected!("avx512f")
                && std::is_x86_feature_detected!("avx512bw")
                && std::is_x86_feature_detected!("avx512dq")
                && std::is_x86_feature_detected!("avx512vl")
                && std::is_x86_feature_detected!("avx512vnni"),
        ),
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
            Backend::Avx512Vnni => "avx512vnni",
        }
    }

    /// The back-end of this name, if this processor supports it.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::available().find(|isa| isa.name() == name)
    }
}
