//! The system's counters of this process, for measurements: instructions, cycles, energy.
#![cfg_attr(
    any(target_os = "linux", target_os = "android", target_vendor = "apple"),
    expect(unsafe_code, reason = "the counters are the system's calls")
)]

/// Counts of this process so far; `None` for what the system does not count, or does not tell it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Instructions of the threads.
    pub instructions: Option<u64>,
    /// Cycles of the cores while they ran these.
    pub cycles: Option<u64>,
    /// Energy that the system bills to the process, nanojoules.
    pub energy: Option<u64>,
}

/// Counters of the calling thread and of all threads that it starts later, and these, on Linux; of the whole process on
/// Apple's systems.
#[derive(Debug)]
pub struct Counters(system::Counters);

impl Counters {
    /// Starts to count.
    #[must_use]
    pub fn start() -> Self {
        Self(system::Counters::start())
    }

    /// Counts so far.
    #[must_use]
    pub fn read(&self) -> Counts {
        self.0.read()
    }
}

#[cfg(any(target_os = "linux", target_os = "android"))]
mod system {
    use std::fs::File;
    use std::io::Read;
    use std::os::fd::{FromRawFd, RawFd};

    use super::Counts;

    /// `PERF_COUNT_HW_CPU_CYCLES` and `PERF_COUNT_HW_INSTRUCTIONS`, of the type `PERF_TYPE_HARDWARE`, which is 0.
    const CYCLES: u64 = 0;
    const INSTRUCTIONS: u64 = 1;
    /// Bits of the structure's flags: threads that are started later count; the kernel and the hypervisor do not, which
    /// needs no right.
    const INHERIT: u64 = 1 << 1;
    const EXCLUDE_KERNEL: u64 = 1 << 5;
    const EXCLUDE_HYPERVISOR: u64 = 1 << 6;

    #[derive(Debug)]
    pub(super) struct Counters {
        cycles: Option<File>,
        instructions: Option<File>,
    }

    impl Counters {
        pub(super) fn start() -> Self {
            Self { cycles: open(CYCLES), instructions: open(INSTRUCTIONS) }
        }

        pub(super) fn read(&self) -> Counts {
            let read = |file: &Option<File>| {
                let mut bytes = [0; 8];
                file.as_ref()?.read_exact(&mut bytes).ok()?;
                Some(u64::from_ne_bytes(bytes))
            };
            Counts { instructions: read(&self.instructions), cycles: read(&self.cycles), energy: None }
        }
    }

    /// Opens a counter; `None` if the system refuses it, or the processor has none.
    fn open(config: u64) -> Option<File> {
        /// Bytes of the structure's first version.
        const SIZE: u64 = 64;
        const CLOSE_ON_EXEC: libc::c_ulong = 8;
        // Type and size in the first word, as two halves; then config, period, sample type, read format, flags.
        let size = if cfg!(target_endian = "little") { SIZE << 32 } else { SIZE };
        let attributes = [size, config, 0, 0, 0, INHERIT | EXCLUDE_KERNEL | EXCLUDE_HYPERVISOR, 0, 0];
        let (this, any_core, no_group): (libc::c_int, libc::c_int, libc::c_int) = (0, -1, -1);
        // SAFETY: the system reads `SIZE` bytes, those of the array, which outlives the call.
        let opened = unsafe {
            libc::syscall(libc::SYS_perf_event_open, attributes.as_ptr(), this, any_core, no_group, CLOSE_ON_EXEC)
        };
        let descriptor = RawFd::try_from(opened).ok().filter(|&descriptor| descriptor >= 0)?;
        // SAFETY: the descriptor was opened just now, and belongs to nobody else.
        Some(unsafe { File::from_raw_fd(descriptor) })
    }
}

#[cfg(target_vendor = "apple")]
mod system {
    use std::mem::MaybeUninit;

    use super::Counts;

    #[derive(Debug)]
    pub(super) struct Counters;

    impl Counters {
        pub(super) fn start() -> Self {
            Self
        }

        pub(super) fn read(&self) -> Counts {
            let mut usage = MaybeUninit::<libc::rusage_info_v4>::zeroed();
            // SAFETY: the system writes the structure of this version, which the memory has room for.
            let error =
                unsafe { libc::proc_pid_rusage(libc::getpid(), libc::RUSAGE_INFO_V4, usage.as_mut_ptr().cast()) };
            if error != 0 {
                return Counts::default();
            }
            // SAFETY: all of it was written, and any bits are a value of its fields.
            let usage = unsafe { usage.assume_init() };
            // Counters that a processor lacks stay 0.
            let some = |count: u64| (count > 0).then_some(count);
            Counts {
                instructions: some(usage.ri_instructions),
                cycles: some(usage.ri_cycles),
                energy: some(usage.ri_billed_energy),
            }
        }
    }
}

#[cfg(not(any(target_os = "linux", target_os = "android", target_vendor = "apple")))]
mod system {
    use super::Counts;

    #[derive(Debug)]
    pub(super) struct Counters;

    impl Counters {
        pub(super) fn start() -> Self {
            Self
        }

        pub(super) fn read(&self) -> Counts {
            Counts::default()
        }
    }
}
