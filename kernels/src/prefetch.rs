//! Prefetching. An address may be anywhere, even beyond the object that it was derived from. On
//! targets without a prefetch instruction it is a no-op.

use crate::isa::Isa;
#[cfg(target_arch = "x86_64")]
use core::arch::x86_64::{_MM_HINT_T0, _MM_HINT_T1, _mm_prefetch};
use core::marker::PhantomData;
use core::sync::atomic::{AtomicPtr, AtomicUsize, Ordering};

/// Streams side by side: an Intel Xeon has 1.5 times the bandwidth of one.
const STREAMS: usize = 4;

/// Memory that will be read next and may be prefetched while something else is computed: a hint
/// that changes no result.
#[derive(Clone, Copy, Debug)]
pub struct PrefetchHint<'a> {
    pieces: [*const u8; 2],
    /// Bytes of each piece.
    len: usize,
    /// Streams side by side in each piece.
    streams: usize,
    memory: PhantomData<&'a [u8]>,
}

impl<'a> PrefetchHint<'a> {
    /// A hint without memory.
    pub const NONE: Self = Self { pieces: [core::ptr::null(); 2], len: 0, streams: STREAMS, memory: PhantomData };

    /// Two pieces of equal length, that of the shorter slice, for instance the keys and the values of the
    /// next head.
    pub fn new<T>(first: &'a [T], second: &'a [T]) -> Self {
        let pieces = [first.as_ptr().cast(), second.as_ptr().cast()];
        Self { pieces, len: size_of_val(first).min(size_of_val(second)), streams: STREAMS, memory: PhantomData }
    }

    /// Sets one stream or several side by side, whichever is faster by the tuning profile of
    /// `isa`.
    #[must_use]
    pub const fn tuned_for(mut self, isa: Isa) -> Self {
        self.streams = if isa.tuning().one_stream { 1 } else { STREAMS };
        self
    }
}

/// Memory for a thread to prefetch while it waits, set by another thread at any time.
#[derive(Debug, Default)]
pub struct SharedHint {
    pieces: [AtomicPtr<u8>; 2],
    len: AtomicUsize,
    streams: AtomicUsize,
}

impl SharedHint {
    /// Replaces the hint.
    pub fn set(&self, hint: PrefetchHint) {
        for (piece, start) in self.pieces.iter().zip(hint.pieces) {
            piece.store(start.cast_mut(), Ordering::Relaxed);
        }
        self.len.store(hint.len, Ordering::Relaxed);
        self.streams.store(hint.streams, Ordering::Relaxed);
    }

    /// Prefetches until all memory of the hint is done, or `is_over` returns true, which is called
    /// every few lines. A hint that is set meanwhile may or may not be used; an address is
    /// never read.
    pub fn fetch(&self, mut is_over: impl FnMut() -> bool) {
        let [first, second] = &self.pieces;
        let pieces = [first, second].map(|piece| piece.load(Ordering::Relaxed).cast_const());
        let [len, streams] = [&self.len, &self.streams].map(|number| number.load(Ordering::Relaxed));
        let hint = PrefetchHint { pieces, len, streams: streams.max(1), memory: PhantomData };
        #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
        {
            let mut fetch = HintPrefetch::new(hint, usize::MAX);
            while fetch.left > 0 && !is_over() {
                fetch.advance();
            }
        }
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        let _ = (hint, &mut is_over);
    }
}

/// Prefetches a line into L1.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[inline]
pub(crate) fn to_l1<T>(line: *const T) {
    // SAFETY: a prefetch is a hint: it reads nothing that the program can see and never faults.
    #[cfg(target_arch = "x86_64")]
    unsafe {
        _mm_prefetch::<_MM_HINT_T0>(line.cast());
    }
    // SAFETY: as above.
    #[cfg(target_arch = "aarch64")]
    unsafe {
        core::arch::asm!("prfm pldl1keep, [{}]", in(reg) line, options(nostack, preserves_flags, readonly));
    }
}

/// Prefetches a line into L2.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[inline]
pub(crate) fn to_l2<T>(line: *const T) {
    // SAFETY: a prefetch is a hint: it reads nothing that the program can see and never faults.
    #[cfg(target_arch = "x86_64")]
    unsafe {
        _mm_prefetch::<_MM_HINT_T1>(line.cast());
    }
    // SAFETY: as above.
    #[cfg(target_arch = "aarch64")]
    unsafe {
        core::arch::asm!("prfm pldl2keep, [{}]", in(reg) line, options(nostack, preserves_flags, readonly));
    }
}

/// Prefetches a line for writing into L1 and removes it from other cores' caches.
#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
#[inline]
pub(crate) fn for_write<T>(line: *const T) {
    // SAFETY: a prefetch is a hint: it changes nothing that the program can see and never faults.
    // Processors without it do nothing.
    unsafe { core::arch::asm!("prefetchw [{}]", in(reg) line, options(nostack, preserves_flags)) }
}

/// Prefetching during an operation that leaves memory bandwidth unused.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) trait Prefetch {
    /// Prefetches all of `hint` in `calls` calls of [`Self::advance`], unless the implementation ignores the hint.
    fn new(hint: PrefetchHint, calls: usize) -> Self;

    /// Prefetches the next lines.
    fn advance(&mut self);

    /// Called when register `c` of a row is read: may prefetch data behind it, if the
    /// register begins a line.
    fn touch<T, const N: usize>(&self, register: &[T; N], c: usize);
}

/// Prefetches only the data of the operation itself, shortly before it is read: for processors tuned for one stream.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) struct SelfPrefetch;

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
impl SelfPrefetch {
    /// Prefetch distance in bytes.
    const LEAD: usize = 4096;
}

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
impl Prefetch for SelfPrefetch {
    #[inline]
    fn new(_: PrefetchHint, _: usize) -> Self {
        Self
    }

    #[inline]
    fn advance(&mut self) {}

    #[inline]
    fn touch<T, const N: usize>(&self, register: &[T; N], c: usize) {
        if (c * size_of::<[T; N]>()).is_multiple_of(HintPrefetch::LINE) {
            to_l1(register.as_ptr().wrapping_byte_add(Self::LEAD));
        }
    }
}

/// Prefetches a [`PrefetchHint`] step by step, in several streams.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) struct HintPrefetch {
    /// The next line of each piece's first stream.
    pieces: [*const u8; 2],
    /// Bytes between the streams of a piece; bytes left of each stream; bytes of each that a call
    /// prefetches.
    stream: usize,
    left: usize,
    step: usize,
    streams: usize,
}

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
impl HintPrefetch {
    const LINE: usize = 64;
}

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
impl Prefetch for HintPrefetch {
    fn new(hint: PrefetchHint, calls: usize) -> Self {
        let lines = hint.len / Self::LINE / hint.streams;
        let (stream, step) = (lines * Self::LINE, lines.div_ceil(calls.max(1)) * Self::LINE);
        Self { pieces: hint.pieces, stream, left: stream, step, streams: hint.streams }
    }

    #[inline]
    fn advance(&mut self) {
        if self.left == 0 {
            return;
        }
        let step = self.step.min(self.left);
        self.left -= step;
        for piece in &mut self.pieces {
            for line in (0..step).step_by(Self::LINE) {
                for stream in 0..self.streams {
                    to_l2(piece.wrapping_add(line + stream * self.stream));
                }
            }
            *piece = piece.wrapping_add(step);
        }
    }

    #[inline]
    fn touch<T, const N: usize>(&self, _: &[T; N], _: usize) {}
}

#[cfg(all(test, any(target_arch = "x86_64", target_arch = "aarch64")))]
mod tests {
    use super::*;

    /// All whole lines of four streams in each piece are prefetched in the given number of calls.
    #[test]
    fn all_is_fetched_in_the_calls_that_there_are() {
        for len in [0, 1, 255, 256, 1000, 4096, 65_536] {
            let memory = &[0_u8; 65_536][..len];
            for calls in [1, 2, 7, 128] {
                let mut fetch = HintPrefetch::new(PrefetchHint::new(memory, memory), calls);
                (0..calls).for_each(|_| fetch.advance());
                assert_eq!(fetch.left, 0);
                let end = memory.as_ptr().wrapping_add(len / 256 * 64);
                assert_eq!(fetch.pieces, [end; 2]);
            }
        }
    }

    #[test]
    fn waiting_ends_when_it_is_over() {
        let (memory, expected) = ([0_u8; 4096], SharedHint::default());
        expected.fetch(|| panic!("nothing is expected"));
        expected.set(PrefetchHint::new(&memory, &memory));
        let mut asked = 0;
        expected.fetch(|| {
            asked += 1;
            asked == 3
        });
        assert_eq!(asked, 3);
        expected.fetch(|| false);
    }
}
