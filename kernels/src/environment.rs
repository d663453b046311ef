//! The floating-point environment of a thread: rounding, traps, flushing of denormals. All results
//! are defined in the default environment.
//!
//! | target | register | default |
//! |---|---|---|
//! | x86-64 | MXCSR | round to nearest, no traps, denormals kept. The x87 unit is not used, only SSE |
//! | aarch64 | FPCR, and FPSR for the exception flags | the same |
//! | others | none is set | that of the caller |

use core::hint::black_box;

/// Runs `work` in the default environment. When it returns or panics, the caller's environment is
/// restored, including its exception flags: flags that `work` raises are discarded.
///
/// If the caller's environment is the default one, the cost is two reads of a register. Never
/// allocates.
#[inline]
pub fn in_default<R>(work: impl FnOnce() -> R) -> R {
    let _restored = Environment::enter();
    // The compiler does not know that arithmetic depends on the register: passing `work` and its result
    // through memory keeps the arithmetic between the two writes.
    black_box(black_box(work)())
}

/// The caller's environment, restored on drop.
struct Environment(registers::State);

impl Environment {
    fn enter() -> Self {
        let callers = registers::read();
        let default = registers::default(callers);
        if callers != default {
            registers::write(default);
        }
        Self(callers)
    }
}

impl Drop for Environment {
    fn drop(&mut self) {
        if registers::read() != self.0 {
            registers::write(self.0);
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod registers {
    use core::arch::asm;

    /// MXCSR.
    pub(super) type State = u32;

    /// All exceptions masked, round to nearest, denormals kept.
    const DEFAULT: u32 = 0x1f80;
    /// Exception flags.
    const FLAGS: u32 = 0x3f;

    /// The default, with the flags of `callers`.
    pub(super) const fn default(callers: State) -> State {
        DEFAULT | callers & FLAGS
    }

    #[inline]
    pub(super) fn read() -> State {
        let mut state = 0;
        // SAFETY: stores 4 bytes to `state`, which is 4 writable bytes.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut state, options(nostack, preserves_flags)) };
        state
    }

    #[inline]
    pub(super) fn write(state: State) {
        // SAFETY: loads 4 bytes of `state`. It came from `read` or `default`, so no reserved bit is
        // set. While another environment than the default is loaded, only the caller's code computes.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const state, options(nostack, preserves_flags)) };
    }
}

#[cfg(target_arch = "aarch64")]
mod registers {
    use core::arch::asm;

    /// FPCR, FPSR.
    pub(super) type State = (u64, u64);

    /// The default control, with the flags of `callers`.
    pub(super) const fn default(callers: State) -> State {
        (0, callers.1)
    }

    #[inline]
    pub(super) fn read() -> State {
        let (mut control, mut status) = (0, 0);
        // SAFETY: reads a register that every program may read.
        unsafe { asm!("mrs {}, fpcr", out(reg) control, options(nostack, preserves_flags)) };
        // SAFETY: as above.
        unsafe { asm!("mrs {}, fpsr", out(reg) status, options(nostack, preserves_flags)) };
        (control, status)
    }

    #[inline]
    pub(super) fn write((control, status): State) {
        // SAFETY: writes a register that every program may write, with a value from `read` or
        // `default`. While another environment than the default is loaded, only the caller's code computes.
        unsafe { asm!("msr fpcr, {}", in(reg) control, options(nostack, preserves_flags)) };
        // SAFETY: as above.
        unsafe { asm!("msr fpsr, {}", in(reg) status, options(nostack, preserves_flags)) };
    }
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
mod registers {
    /// No register.
    #[derive(Clone, Copy, PartialEq, Eq)]
    pub(super) struct State;

    pub(super) const fn default(callers: State) -> State {
        callers
    }

    pub(super) const fn read() -> State {
        State
    }

    pub(super) const fn write(_: State) {}
}

#[cfg(all(test, any(target_arch = "x86_64", target_arch = "aarch64")))]
mod tests {
    extern crate std;

    use super::{in_default, registers};
    use core::hint::black_box;
    use std::panic::catch_unwind;

    /// Another rounding mode, denormals flushed.
    #[cfg(target_arch = "x86_64")]
    const STRANGE: registers::State = 0x1f80 | 0x6000 | 0x8040;
    #[cfg(target_arch = "aarch64")]
    const STRANGE: registers::State = (0b111 << 22, 0);

    fn third() -> (u32, u32) {
        let (one, tiny) = (black_box(1.0_f32), black_box(f32::MIN_POSITIVE));
        // Through memory, or the divisions may move past the next write of the register.
        black_box(((one / black_box(3.0)).to_bits(), (tiny / black_box(4.0)).to_bits()))
    }

    #[test]
    fn work_has_the_default_and_the_caller_its_own() {
        let callers = registers::read();
        let wanted = third();
        registers::write(STRANGE);
        let (strange, inside) = (third(), in_default(third));
        let left = registers::read();
        let panicked = catch_unwind(|| in_default(|| panic!("planned {:?}", third()))).is_err();
        let left_by_panic = registers::read();
        registers::write(callers);
        assert_eq!(inside, wanted);
        assert_ne!(strange, wanted);
        // The flags of `strange` belong to the caller.
        #[cfg(target_arch = "x86_64")]
        let (left, left_by_panic) = (left & !0x3f, left_by_panic & !0x3f);
        #[cfg(target_arch = "aarch64")]
        let (left, left_by_panic) = ((left.0, 0), (left_by_panic.0, 0));
        assert!(panicked && left == STRANGE && left_by_panic == STRANGE);
    }

    #[test]
    fn flags_of_the_work_are_not_seen() {
        let before = registers::read();
        #[cfg(target_arch = "x86_64")]
        let clear = before & !0x3f;
        #[cfg(target_arch = "aarch64")]
        let clear = (before.0, 0);
        registers::write(clear);
        in_default(third);
        assert_eq!(registers::read(), clear);
        black_box(third());
        let after = registers::read();
        registers::write(before);
        assert_ne!(after, clear);
    }
}
