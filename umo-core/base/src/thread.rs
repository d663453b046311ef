//! The library's own threads (feature `threads`), for teams and for engines that start their own workers.

#[cfg(not(feature = "threads"))]
pub use none::{JoinHandle, available, start, yield_now};
#[cfg(feature = "threads")]
pub use own::{JoinHandle, available, start, yield_now};

#[cfg(feature = "threads")]
mod own {
    #[cfg(not(any(target_os = "linux", target_os = "android")))]
    use std::io;
    #[cfg(not(any(target_os = "linux", target_os = "android")))]
    pub use std::thread::JoinHandle;
    pub use std::thread::yield_now;

    #[cfg(any(target_os = "linux", target_os = "android"))]
    pub use super::posix::{JoinHandle, start};

    #[cfg(not(any(target_os = "linux", target_os = "android")))]
    use umo_kernels::environment::in_default;

    /// Starts a named thread with the default floating-point environment, which it would otherwise inherit from its
    /// parent.
    ///
    /// # Errors
    /// The system's error.
    #[cfg(not(any(target_os = "linux", target_os = "android")))]
    pub fn start(name: String, work: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
        std::thread::Builder::new().name(name).spawn(|| in_default(work))
    }

    /// Number of threads that the system runs at once.
    pub fn available() -> usize {
        std::thread::available_parallelism().map_or(1, usize::from)
    }
}

/// Threads created by system calls. The standard library's threads leave thread-local data on the thread that starts
/// them, which keeps a shared library mapped until that thread ends, and end the process if there is no memory for
/// their names.
#[cfg(all(feature = "threads", any(target_os = "linux", target_os = "android")))]
#[expect(unsafe_code, reason = "the standard library's threads keep a library from being unloaded")]
mod posix {
    use std::ffi::{CString, c_void};
    use std::io;
    use std::marker::PhantomData;
    use std::mem::MaybeUninit;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::ptr::null_mut;

    use umo_kernels::environment::in_default;

    /// Bytes of a thread's stack: the standard library's default.
    const STACK: usize = 2 << 20;
    /// Maximum length of a thread name on Linux, bytes.
    const MAX_NAME: usize = 15;
    /// Number of attempts to start a thread: another thread may hold the address space of a heap for a moment, to find
    /// that it is not aligned.
    const ATTEMPTS: usize = 8;

    type Work = Box<dyn FnOnce() + Send>;

    /// Handle of a started thread.
    #[derive(Debug)]
    pub struct JoinHandle<T>(libc::pthread_t, PhantomData<T>);

    impl<T> JoinHandle<T> {
        /// Waits until the thread has ended.
        ///
        /// # Errors
        /// The system's error.
        pub fn join(self) -> io::Result<()> {
            let thread = self.0;
            std::mem::forget(self);
            // SAFETY: the thread was started, and is neither joined nor detached: only this and `drop` do so, and
            // both consume the handle.
            done(unsafe { libc::pthread_join(thread, null_mut()) })
        }
    }

    impl<T> Drop for JoinHandle<T> {
        fn drop(&mut self) {
            // SAFETY: as in `join`.
            unsafe { libc::pthread_detach(self.0) };
        }
    }

    /// Converts the return value of a pthread call.
    fn done(error: i32) -> io::Result<()> {
        if error == 0 { Ok(()) } else { Err(io::Error::from_raw_os_error(error)) }
    }

    /// Starts a named thread with the default floating-point environment, which it would otherwise inherit from its
    /// parent.
    ///
    /// # Errors
    /// The system's error.
    pub fn start(mut name: String, work: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
        name.truncate(MAX_NAME);
        let name = CString::new(name)?;
        let work: Work = Box::new(move || {
            // SAFETY: no preconditions.
            let this = unsafe { libc::pthread_self() };
            // SAFETY: the name is NUL-terminated, and the thread is the current one.
            unsafe { libc::pthread_setname_np(this, name.as_ptr()) };
            in_default(work);
        });
        let mut attributes = MaybeUninit::<libc::pthread_attr_t>::uninit();
        // SAFETY: initializes the attributes.
        done(unsafe { libc::pthread_attr_init(attributes.as_mut_ptr()) })?;
        // SAFETY: they are initialized.
        unsafe { libc::pthread_attr_setstacksize(attributes.as_mut_ptr(), STACK) };
        let (mut thread, work) = (MaybeUninit::uninit(), Box::into_raw(Box::new(work)));
        let mut error = libc::EAGAIN;
        for _ in 0..ATTEMPTS {
            // SAFETY: the attributes are initialized, and `run` accepts this pointer, which no thread has yet.
            error = unsafe { libc::pthread_create(thread.as_mut_ptr(), attributes.as_ptr(), run, work.cast()) };
            if error != libc::EAGAIN {
                break;
            }
            std::thread::yield_now();
        }
        // SAFETY: they are initialized, and not used again.
        unsafe { libc::pthread_attr_destroy(attributes.as_mut_ptr()) };
        if error != 0 {
            // SAFETY: no thread was started that would take it.
            drop(unsafe { Box::from_raw(work) });
        }
        done(error)?;
        // SAFETY: a thread was started, so the handle was written.
        Ok(JoinHandle(unsafe { thread.assume_init() }, PhantomData))
    }

    extern "C" fn run(work: *mut c_void) -> *mut c_void {
        // SAFETY: `start` passes a box's pointer of this type, to this thread only.
        let work = unsafe { Box::from_raw(work.cast::<Work>()) };
        // A panic ends the thread, not the process.
        drop(catch_unwind(AssertUnwindSafe(work)));
        null_mut()
    }
}

#[cfg(not(feature = "threads"))]
mod none {
    use std::io;
    use std::marker::PhantomData;

    /// Uninhabited: no thread can be started.
    #[derive(Debug)]
    pub struct JoinHandle<T>(std::convert::Infallible, PhantomData<T>);

    impl<T> JoinHandle<T> {
        /// Never called: no value exists.
        ///
        /// # Errors
        /// None.
        pub fn join(self) -> std::thread::Result<T> {
            match self.0 {}
        }
    }

    /// Fails.
    ///
    /// # Errors
    /// [`io::ErrorKind::Unsupported`].
    pub fn start(_: String, _: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
        Err(io::ErrorKind::Unsupported.into())
    }

    /// 1: the caller's thread.
    pub fn available() -> usize {
        1
    }

    /// Yields to other hardware threads.
    pub fn yield_now() {
        std::hint::spin_loop();
    }
}
