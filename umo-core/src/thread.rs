//! Threads of the library's own, where it is built with them (feature `threads`): for teams, for
//! engines that compute on their own, and for loading models.

#[cfg(not(feature = "threads"))]
pub use none::{JoinHandle, available, start, yield_now};
#[cfg(feature = "threads")]
pub use own::{JoinHandle, available, start, yield_now};

#[cfg(feature = "threads")]
mod own {
    use std::io;
    pub use std::thread::{JoinHandle, yield_now};

    use umo_kernels::environment::in_default;

    /// Starts a thread with a name, and with the default floating-point environment: it would inherit
    /// its starter's.
    ///
    /// # Errors
    /// What the system says.
    pub fn start(name: String, life: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
        std::thread::Builder::new().name(name).spawn(|| in_default(life))
    }

    /// How many threads the system computes at once.
    pub fn available() -> usize {
        std::thread::available_parallelism().map_or(1, usize::from)
    }
}

#[cfg(not(feature = "threads"))]
mod none {
    use std::io;
    use std::marker::PhantomData;

    /// No thread.
    #[derive(Debug)]
    pub struct JoinHandle<T>(std::convert::Infallible, PhantomData<T>);

    impl<T> JoinHandle<T> {
        /// Waits for the thread, of which there is none.
        ///
        /// # Errors
        /// None.
        pub fn join(self) -> std::thread::Result<T> {
            match self.0 {}
        }
    }

    /// Starts no thread.
    ///
    /// # Errors
    /// [`io::ErrorKind::Unsupported`].
    pub fn start(_: String, _: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
        Err(io::ErrorKind::Unsupported.into())
    }

    /// The caller's alone.
    pub fn available() -> usize {
        1
    }

    /// Lets the processor's other threads go on.
    pub fn yield_now() {
        std::hint::spin_loop();
    }
}

/// Packing weights by all threads of the caller's pool, or, without the feature `threads`, by the
/// caller.
pub(crate) mod parallel {
    #[cfg(feature = "threads")]
    pub(crate) use rayon::prelude::*;
    #[cfg(not(feature = "threads"))]
    pub(crate) use sequential::*;

    /// What loading calls of rayon, by iterators of the standard library.
    #[cfg(not(feature = "threads"))]
    mod sequential {
        use std::slice::{ChunksExact, ChunksExactMut, ChunksMut};

        pub(crate) trait IntoParallelIterator: IntoIterator + Sized {
            fn into_par_iter(self) -> Self::IntoIter {
                self.into_iter()
            }
        }

        impl<I: IntoIterator> IntoParallelIterator for I {}

        pub(crate) trait ParallelIterator: Iterator + Sized {
            fn with_min_len(self, _: usize) -> Self {
                self
            }

            fn try_for_each_init<T, E>(
                mut self,
                init: impl FnOnce() -> T,
                work: impl Fn(&mut T, Self::Item) -> Result<(), E>,
            ) -> Result<(), E> {
                let mut state = init();
                self.try_for_each(|item| work(&mut state, item))
            }
        }

        impl<I: Iterator> ParallelIterator for I {}

        pub(crate) trait ParallelSlice<T> {
            fn par_chunks_exact(&self, len: usize) -> ChunksExact<'_, T>;
        }

        impl<T> ParallelSlice<T> for [T] {
            fn par_chunks_exact(&self, len: usize) -> ChunksExact<'_, T> {
                self.chunks_exact(len)
            }
        }

        pub(crate) trait ParallelSliceMut<T> {
            fn par_chunks_mut(&mut self, len: usize) -> ChunksMut<'_, T>;
            fn par_chunks_exact_mut(&mut self, len: usize) -> ChunksExactMut<'_, T>;
        }

        impl<T> ParallelSliceMut<T> for [T] {
            fn par_chunks_mut(&mut self, len: usize) -> ChunksMut<'_, T> {
                self.chunks_mut(len)
            }

            fn par_chunks_exact_mut(&mut self, len: usize) -> ChunksExactMut<'_, T> {
                self.chunks_exact_mut(len)
            }
        }
    }
}
