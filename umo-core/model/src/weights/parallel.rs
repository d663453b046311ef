//! Packs weights on all threads of the caller's pool, or, without the feature `threads`, on the calling thread.

#[cfg(feature = "threads")]
pub(crate) use rayon::prelude::*;
#[cfg(not(feature = "threads"))]
pub(crate) use sequential::*;

/// The part of rayon's API that loading uses, on standard iterators.
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
