//! Binding of threads to cores, on Linux and Windows. Other systems, and builds without the feature `threads`, bind
//! none.

pub(super) use system::{bind, usable};

#[cfg(all(feature = "threads", any(target_os = "linux", target_os = "android")))]
mod system {
    use std::mem::size_of_val;

    /// One bit per core, lowest first, for as many cores as Linux can be built for.
    type Mask = [u64; 128];

    const BITS: usize = u64::BITS as usize;

    /// Binds the calling thread to a core; returns whether the system allowed it.
    pub(in super::super) fn bind(core: usize) -> bool {
        let mut mask: Mask = [0; _];
        let Some(word) = mask.get_mut(core / BITS) else { return false };
        *word = 1 << (core % BITS);
        // SAFETY: the system reads `size_of_val(&mask)` bytes of the array, which outlives the call. A `cpu_set_t` is
        // an array of words with one bit per core, of any length; 0 is the calling thread.
        unsafe { libc::sched_setaffinity(0, size_of_val(&mask), mask.as_ptr().cast()) == 0 }
    }

    /// Cores that the calling thread may use, ascending; empty if unknown.
    pub(in super::super) fn usable() -> Vec<usize> {
        let mut mask: Mask = [0; _];
        // SAFETY: the system writes at most `size_of_val(&mask)` bytes of the array, whose bits may have any value; 0
        // is the calling thread.
        let known = unsafe { libc::sched_getaffinity(0, size_of_val(&mask), mask.as_mut_ptr().cast()) } >= 0;
        let has = |core: &usize| known && mask[core / BITS] >> (core % BITS) & 1 == 1;
        (0..mask.len() * BITS).filter(has).collect()
    }
}

#[cfg(all(feature = "threads", windows))]
mod system {
    use windows_sys::Win32::System::Threading::{
        GetCurrentProcess, GetCurrentThread, GetProcessAffinityMask, SetThreadAffinityMask,
    };

    /// Binds the calling thread to a core of the process's group; returns whether the system allowed it.
    pub(in super::super) fn bind(core: usize) -> bool {
        let Some(mask) = u32::try_from(core).ok().and_then(|core| 1_usize.checked_shl(core)) else { return false };
        // SAFETY: no preconditions; the pseudo handle needs no closing.
        let thread = unsafe { GetCurrentThread() };
        // SAFETY: `thread` is a valid handle; a mask with a core that the process may not use is refused with 0.
        unsafe { SetThreadAffinityMask(thread, mask) != 0 }
    }

    /// Cores of its group that the process may use, ascending; empty if unknown.
    pub(in super::super) fn usable() -> Vec<usize> {
        let (mut of_process, mut of_system) = (0, 0);
        // SAFETY: no preconditions; the pseudo handle needs no closing.
        let process = unsafe { GetCurrentProcess() };
        // SAFETY: `process` is a valid handle, and both masks are variables of this function.
        let known = unsafe { GetProcessAffinityMask(process, &mut of_process, &mut of_system) } != 0;
        (0..usize::BITS as usize).filter(|core| known && of_process >> core & 1 == 1).collect()
    }
}

#[cfg(not(all(feature = "threads", any(target_os = "linux", target_os = "android", windows))))]
mod system {
    /// Always fails.
    pub(in super::super) fn bind(_core: usize) -> bool {
        false
    }

    /// Empty: this system binds no threads.
    pub(in super::super) fn usable() -> Vec<usize> {
        Vec::new()
    }
}

#[cfg(all(test, feature = "threads", any(target_os = "linux", target_os = "android", windows)))]
mod tests {
    use super::*;

    #[test]
    fn a_bound_thread_may_use_one_core() {
        // In its own thread, so that no other test is bound.
        let thread = || {
            let before = usable();
            let last = *before.last().unwrap();
            assert!(bind(last));
            #[cfg(not(windows))]
            assert_eq!(usable(), [last]);
            for core in [64 * 128 - 1, 64 * 128, usize::MAX] {
                assert!(!bind(core), "core {core}");
            }
        };
        std::thread::spawn(thread).join().unwrap();
    }
}
