//! Instants, on systems with a clock.

#[cfg(all(feature = "clock", not(all(target_family = "wasm", target_os = "unknown"))))]
pub use std::time::Instant;

/// Instant on systems without a clock, such as WebAssembly in a browser, or without the feature `clock`. All instants
/// are equal: no time is measured, and only a poll's budget of zero is ever exhausted.
#[cfg(any(not(feature = "clock"), all(target_family = "wasm", target_os = "unknown")))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Instant(());

#[cfg(any(not(feature = "clock"), all(target_family = "wasm", target_os = "unknown")))]
impl Instant {
    /// Returns the only instant.
    pub fn now() -> Self {
        Self(())
    }

    /// Always zero.
    pub fn elapsed(&self) -> std::time::Duration {
        std::time::Duration::ZERO
    }
}

#[cfg(any(not(feature = "clock"), all(target_family = "wasm", target_os = "unknown")))]
impl std::ops::Sub for Instant {
    type Output = std::time::Duration;

    fn sub(self, _: Self) -> Self::Output {
        std::time::Duration::ZERO
    }
}
