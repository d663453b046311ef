//! Binding of threads to cores, on Linux and Windows, and to kinds of cores. Other systems, and builds without the feature
//! `threads`, bind none.
//!
//! A kind is a hard limit on Linux alone, among whose cores the system chooses. On Windows it is a preference (CPU sets),
//! and on Apple's systems a quality of service: both may run a thread elsewhere.

pub(super) use system::{bind, kinds, prefer, usable};

#[cfg(all(feature = "threads", any(target_os = "linux", target_os = "android")))]
mod system {
    use std::mem::size_of_val;
    use std::path::Path;

    use crate::team::kinds::{CoreGroup, Cores};

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

    /// The kinds of the cores that the calling thread may use.
    pub(in super::super) fn kinds() -> Cores {
        Cores::read(Path::new("/sys"), &usable())
    }

    /// Keeps the calling thread on the group's cores; returns whether the system allowed it.
    pub(in super::super) fn prefer(group: &CoreGroup) -> bool {
        let mut mask: Mask = [0; _];
        for &number in &group.processors {
            let Some(word) = mask.get_mut(number / BITS) else { return false };
            *word |= 1 << (number % BITS);
        }
        // SAFETY: as in `bind`.
        unsafe { libc::sched_setaffinity(0, size_of_val(&mask), mask.as_ptr().cast()) == 0 }
    }
}

#[cfg(all(feature = "threads", windows))]
mod system {
    use std::ptr::null_mut;

    use windows_sys::Win32::System::SystemInformation::GetSystemCpuSetInformation;
    use windows_sys::Win32::System::Threading::{
        GetCurrentProcess, GetCurrentThread, GetProcessAffinityMask, SetThreadAffinityMask, SetThreadSelectedCpuSets,
    };

    use crate::team::kinds::{CoreGroup, Cores};

    /// Most CPU sets that a thread prefers.
    const MAX_SETS: usize = 512;

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

    /// The kinds of the system's CPU sets.
    pub(in super::super) fn kinds() -> Cores {
        let mut size = 0;
        // SAFETY: asks for the size alone; the process is the current one.
        unsafe { GetSystemCpuSetInformation(null_mut(), 0, &mut size, null_mut(), 0) };
        // Words of 8 bytes, as the entries need their alignment.
        let mut words = vec![0_u64; (size as usize).div_ceil(8)];
        // SAFETY: the system writes at most `size` bytes, which the words have.
        let known =
            unsafe { GetSystemCpuSetInformation(words.as_mut_ptr().cast(), size, &mut size, null_mut(), 0) } != 0;
        let bytes: Vec<u8> = words.into_iter().flat_map(u64::to_le_bytes).take(size as usize).collect();
        if known { Cores::of_cpu_sets(&bytes) } else { Cores::unknown() }
    }

    /// Prefers the group's CPU sets for the calling thread; returns whether the system allowed it.
    pub(in super::super) fn prefer(group: &CoreGroup) -> bool {
        let (mut ids, mut count) = ([0; MAX_SETS], 0_u32);
        for (slot, &id) in ids.iter_mut().zip(&group.processors) {
            let Ok(id) = u32::try_from(id) else { return false };
            (*slot, count) = (id, count + 1);
        }
        // SAFETY: no preconditions; the pseudo handle needs no closing.
        let thread = unsafe { GetCurrentThread() };
        // SAFETY: `thread` is a valid handle, and the system reads `count` ids, which the array has.
        count > 0 && unsafe { SetThreadSelectedCpuSets(thread, ids.as_ptr(), count) != 0 }
    }
}

#[cfg(all(feature = "threads", target_vendor = "apple"))]
mod system {
    use std::ffi::CStr;
    use std::mem::size_of;

    use crate::team::kinds::{CoreGroup, CoreKind, Cores};

    /// Always fails.
    pub(in super::super) fn bind(_core: usize) -> bool {
        false
    }

    /// Empty: these systems bind no threads.
    pub(in super::super) fn usable() -> Vec<usize> {
        Vec::new()
    }

    /// A number of the system's; `None` if it has none of that name.
    fn number(name: &CStr) -> Option<usize> {
        let (mut value, mut size) = (0_u32, size_of::<u32>());
        // SAFETY: the name is NUL-terminated, and the system writes at most `size` bytes, those of `value`.
        let error = unsafe {
            libc::sysctlbyname(name.as_ptr(), (&raw mut value).cast(), &raw mut size, std::ptr::null_mut(), 0)
        };
        (error == 0 && size == size_of::<u32>()).then_some(value as usize)
    }

    /// The kinds of the processor's performance levels.
    pub(in super::super) fn kinds() -> Cores {
        let levels = [c"hw.perflevel0.physicalcpu", c"hw.perflevel1.physicalcpu", c"hw.perflevel2.physicalcpu"];
        let count = number(c"hw.nperflevels").unwrap_or_default().min(levels.len());
        Cores::of_levels(&levels[..count].iter().map(|name| number(name).unwrap_or_default()).collect::<Vec<_>>())
    }

    /// Gives the calling thread the quality of service by which the system chooses such cores; returns whether it did.
    pub(in super::super) fn prefer(group: &CoreGroup) -> bool {
        let class = match group.kind {
            CoreKind::Performance => libc::qos_class_t::QOS_CLASS_DEFAULT,
            _ => libc::qos_class_t::QOS_CLASS_UTILITY,
        };
        // SAFETY: takes a class and an integer, and changes the calling thread only.
        unsafe { libc::pthread_set_qos_class_self_np(class, 0) == 0 }
    }
}

#[cfg(not(all(
    feature = "threads",
    any(target_os = "linux", target_os = "android", windows, target_vendor = "apple")
)))]
mod system {
    use crate::team::kinds::{CoreGroup, Cores};

    /// Always fails.
    pub(in super::super) fn bind(_core: usize) -> bool {
        false
    }

    /// Empty: this system binds no threads.
    pub(in super::super) fn usable() -> Vec<usize> {
        Vec::new()
    }

    /// Unknown: this system does not report them.
    pub(in super::super) fn kinds() -> Cores {
        Cores::unknown()
    }

    /// Always fails.
    pub(in super::super) fn prefer(_group: &CoreGroup) -> bool {
        false
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

    #[test]
    #[cfg(not(windows))]
    fn a_thread_stays_on_the_cores_of_its_kind() {
        use crate::team::kinds::{CoreGroup, CoreKind};

        let thread = || {
            let all = usable();
            let group = |processors: &[usize]| CoreGroup {
                kind: CoreKind::Efficiency,
                speed: 0.5,
                cores: 1,
                processors: processors.to_vec(),
            };
            assert!(prefer(&group(&all[..1])));
            assert_eq!(usable(), all[..1]);
            // The kinds of one core do not differ.
            assert!(!kinds().differ());
            assert!(prefer(&group(&all)));
            assert_eq!(usable(), all);
            assert!(!prefer(&group(&[usize::MAX])) && !prefer(&group(&[])));
        };
        std::thread::spawn(thread).join().unwrap();
    }
}
