//! Priorities of threads, by the means of each system.

use std::fmt;

/// Priority of an engine's own threads, among all threads of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Priority {
    /// That of any new thread of the process.
    #[default]
    Normal,
    /// Before threads of normal priority: frames are nearly as fast beside a program that keeps every core
    /// busy. Linux refuses it to most users.
    High,
    /// Behind threads of normal priority: the engine computes in the time that they leave.
    Low,
}

impl Priority {
    /// Gives the calling thread this priority; whether the system let it.
    pub(crate) fn set(self) -> bool {
        self == Self::Normal || system::set(self)
    }

    /// What to do where the system refuses a priority.
    #[must_use]
    pub fn advice() -> &'static str {
        system::ADVICE
    }
}

impl fmt::Display for Priority {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Normal => "normal",
            Self::High => "high",
            Self::Low => "low",
        })
    }
}

#[cfg(all(feature = "threads", any(target_os = "linux", target_os = "android")))]
mod system {
    use super::Priority;

    /// Steps of nice from normal. The system gives a thread 1.25 times the time for each step.
    const STEPS: libc::c_int = 10;

    pub(super) const ADVICE: &str = "it needs the capability CAP_SYS_NICE, or RLIMIT_NICE of 30 (`ulimit -e 30`; \
                                     in a systemd unit `LimitNICE=-10`)";

    pub(super) fn set(priority: Priority) -> bool {
        let step = match priority {
            Priority::Normal => 0,
            Priority::High => -STEPS,
            Priority::Low => STEPS,
        };
        let wanted = (nice(0) + step).clamp(-20, 19);
        // -1 is an error and a value, so that the thread is asked again.
        nice(step);
        nice(0) == wanted
    }

    /// Adds to the nice value of the calling thread, which in Linux each thread has of its own; returns the new one.
    fn nice(step: libc::c_int) -> libc::c_int {
        // SAFETY: takes and returns numbers alone.
        unsafe { libc::nice(step) }
    }

    #[cfg(test)]
    pub(super) fn current() -> libc::c_int {
        nice(0)
    }
}

#[cfg(all(feature = "threads", windows))]
mod system {
    use windows_sys::Win32::Foundation::HANDLE;
    use windows_sys::Win32::System::Threading::{
        GetCurrentThread, SetThreadPriority, THREAD_PRIORITY_ABOVE_NORMAL, THREAD_PRIORITY_BELOW_NORMAL,
        THREAD_PRIORITY_NORMAL,
    };

    use super::Priority;

    pub(super) const ADVICE: &str = "leave it normal";

    pub(super) fn set(priority: Priority) -> bool {
        let level = match priority {
            Priority::Normal => THREAD_PRIORITY_NORMAL,
            Priority::High => THREAD_PRIORITY_ABOVE_NORMAL,
            Priority::Low => THREAD_PRIORITY_BELOW_NORMAL,
        };
        // SAFETY: the handle of the calling thread is valid.
        unsafe { SetThreadPriority(this_thread(), level) != 0 }
    }

    fn this_thread() -> HANDLE {
        // SAFETY: takes nothing, and the handle that it gives needs no closing.
        unsafe { GetCurrentThread() }
    }

    #[cfg(test)]
    pub(super) fn current() -> i32 {
        // SAFETY: the handle of the calling thread is valid.
        unsafe { windows_sys::Win32::System::Threading::GetThreadPriority(this_thread()) }
    }
}

#[cfg(all(feature = "threads", target_vendor = "apple"))]
mod system {
    use super::Priority;

    pub(super) const ADVICE: &str = "leave it normal";

    pub(super) fn set(priority: Priority) -> bool {
        let class = match priority {
            Priority::Normal => libc::qos_class_t::QOS_CLASS_DEFAULT,
            Priority::High => libc::qos_class_t::QOS_CLASS_USER_INTERACTIVE,
            Priority::Low => libc::qos_class_t::QOS_CLASS_UTILITY,
        };
        // SAFETY: takes a class and a number, and changes the calling thread alone.
        unsafe { libc::pthread_set_qos_class_self_np(class, 0) == 0 }
    }
}

#[cfg(not(all(
    feature = "threads",
    any(target_os = "linux", target_os = "android", windows, target_vendor = "apple")
)))]
mod system {
    use super::Priority;

    pub(super) const ADVICE: &str = "the library cannot set it on this system; leave it normal";

    pub(super) fn set(_priority: Priority) -> bool {
        false
    }
}

#[cfg(all(test, feature = "threads", any(target_os = "linux", target_os = "android", windows)))]
mod tests {
    use super::*;

    /// Before and after, and whether the system let it; of a thread of its own, so that no other test has it.
    fn of_thread(priority: Priority) -> (i32, i32, bool) {
        let life = move || (system::current(), priority.set(), system::current());
        let (before, is_set, after) = std::thread::spawn(life).join().unwrap();
        (before, after, is_set)
    }

    /// The higher, the sooner the thread runs.
    fn rank(value: i32) -> i32 {
        if cfg!(windows) { value } else { -value }
    }

    #[test]
    fn priorities_have_their_order() {
        let (before, after, is_set) = of_thread(Priority::Normal);
        assert!(is_set && before == after);
        let (before, after, is_set) = of_thread(Priority::Low);
        assert!(is_set && rank(after) < rank(before), "{before} -> {after}");
        // Linux refuses it to most users: then nothing has changed.
        let (before, after, is_set) = of_thread(Priority::High);
        assert_eq!(is_set, rank(after) > rank(before), "{before} -> {after}");
        assert!(is_set || before == after);
    }
}
