//! What time it is, where the system says so.

#[cfg(all(feature = "clock", not(all(target_family = "wasm", target_os = "unknown"))))]
pub use std::time::Instant;

/// A moment of a system without a clock, as WebAssembly in a browser, or of a library without the
/// feature `clock`: all are the same, so that no time is measured, and no budget but a poll's zero is
/// ever used up.
#[cfg(any(not(feature = "clock"), all(target_family = "wasm", target_os = "unknown")))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Instant(());

#[cfg(any(not(feature = "clock"), all(target_family = "wasm", target_os = "unknown")))]
impl Instant {
    /// The only moment.
    pub fn now() -> Self {
        Self(())
    }

    /// None.
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
