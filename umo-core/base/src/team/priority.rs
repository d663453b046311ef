//! Thread priorities on each system.

use std::fmt;

/// Priority of an engine's own threads, relative to all threads of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Priority {
    /// The priority of any new thread of the process.
    #[default]
    Normal,
    /// Above threads of normal priority: frames are nearly as fast beside a program that keeps every core busy. Linux
    /// refuses it to most users.
    High,
    /// Below threads of normal priority: the engine runs in the time that they leave.
    Low,
}

impl Priority {
    /// Gives the calling thread this priority; returns whether the system allowed it.
    #[doc(hidden)]
    pub fn set(self) -> bool {
        self == Self::Normal || system::set(self)
    }

    /// Advice for users whose system refuses a priority.
    #[must_use]
    pub fn remedy() -> &'static str {
        system::REMEDY
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

    /// Nice levels away from normal. Each level changes the thread's share of time by a factor of 1.25.
    const STEPS: libc::c_int = 10;

    pub(super) const REMEDY: &str = "it needs the capability CAP_SYS_NICE, or RLIMIT_NICE of 30 (`ulimit -e 30`; \
                                     in a systemd unit `LimitNICE=-10`)";

    pub(super) fn set(priority: Priority) -> bool {
        let step = match priority {
            Priority::Normal => 0,
            Priority::High => -STEPS,
            Priority::Low => STEPS,
        };
        let wanted = (nice(0) + step).clamp(-20, 19);
        // -1 is both an error and a valid value, so the value is queried again.
        nice(step);
        nice(0) == wanted
    }

    /// Adds to the nice value of the calling thread (per thread on Linux); returns the new one.
    fn nice(step: libc::c_int) -> libc::c_int {
        // SAFETY: takes and returns integers only.
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

    pub(super) const REMEDY: &str = "leave it normal";

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
        // SAFETY: no preconditions; the pseudo handle needs no closing.
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

    pub(super) const REMEDY: &str = "leave it normal";

    pub(super) fn set(priority: Priority) -> bool {
        let class = match priority {
            Priority::Normal => libc::qos_class_t::QOS_CLASS_DEFAULT,
            Priority::High => libc::qos_class_t::QOS_CLASS_USER_INTERACTIVE,
            Priority::Low => libc::qos_class_t::QOS_CLASS_UTILITY,
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
    use super::Priority;

    pub(super) const REMEDY: &str = "the library cannot set it on this system; leave it normal";

    pub(super) fn set(_priority: Priority) -> bool {
        false
    }
}

#[cfg(all(test, feature = "threads", any(target_os = "linux", target_os = "android", windows)))]
mod tests {
    use super::*;

    /// Values before and after, and whether the system allowed it; in a new thread, so that no other test is
    /// affected.
    fn of_thread(priority: Priority) -> (i32, i32, bool) {
        let work = move || (system::current(), priority.set(), system::current());
        let (before, is_set, after) = std::thread::spawn(work).join().unwrap();
        (before, after, is_set)
    }

    /// Rank of a value: higher runs first.
    fn rank(value: i32) -> i32 {
        if cfg!(windows) { value } else { -value }
    }

    #[test]
    fn priorities_have_their_order() {
        let (before, after, is_set) = of_thread(Priority::Normal);
        assert!(is_set && before == after);
        let (before, after, is_set) = of_thread(Priority::Low);
        assert!(is_set && rank(after) < rank(before), "{before} -> {after}");
        // Linux refuses it to most users: the value is then unchanged.
        let (before, after, is_set) = of_thread(Priority::High);
        assert_eq!(is_set, rank(after) > rank(before), "{before} -> {after}");
        assert!(is_set || before == after);
    }
}
