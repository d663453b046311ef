//! Lines of memory that are wanted soon. An address may lie anywhere, even beyond what it points into. Where there is no
//! instruction for it, nothing is fetched.

#[cfg(target_arch = "x86_64")]
use core::arch::x86_64::{_MM_HINT_T0, _MM_HINT_T1, _mm_prefetch};
use core::marker::PhantomData;

/// Memory that will be read next, and may come into cache while something else is computed: a hint that changes no result.
#[derive(Clone, Copy, Debug)]
pub struct Ahead<'a> {
    #[cfg_attr(not(target_arch = "x86_64"), expect(dead_code, reason = "nothing is fetched"))]
    pieces: [*const u8; 2],
    /// Bytes of each.
    #[cfg_attr(not(target_arch = "x86_64"), expect(dead_code, reason = "nothing is fetched"))]
    len: usize,
    memory: PhantomData<&'a [u8]>,
}

impl<'a> Ahead<'a> {
    /// Nothing is known.
    pub const NOTHING: Self = Self { pieces: [core::ptr::null(); 2], len: 0, memory: PhantomData };

    /// Two pieces, as the keys and the values of the head that follows, as far as the shorter one reaches.
    pub fn new<T>(first: &'a [T], second: &'a [T]) -> Self {
        let pieces = [first.as_ptr().cast(), second.as_ptr().cast()];
        Self { pieces, len: size_of_val(first).min(size_of_val(second)), memory: PhantomData }
    }
}

/// Fetches a line into L1.
#[cfg(target_arch = "x86_64")]
#[inline]
pub(crate) fn near<T>(line: *const T) {
    // SAFETY: a prefetch is a hint: it reads nothing that the program can see and never faults.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(line.cast()) }
}

/// Fetches a line into L2.
#[cfg(target_arch = "x86_64")]
#[inline]
pub(crate) fn far<T>(line: *const T) {
    // SAFETY: a prefetch is a hint: it reads nothing that the program can see and never faults.
    unsafe { _mm_prefetch::<_MM_HINT_T1>(line.cast()) }
}

/// How far [`Ahead`] has come: little by little, and in streams beside each other, of which memory gives half as much again as
/// of one.
#[cfg(target_arch = "x86_64")]
pub(crate) struct Fetch {
    streams: [*const u8; 8],
    /// Lines of each that are left, and how many a call fetches.
    left: usize,
    step: usize,
}

#[cfg(target_arch = "x86_64")]
impl Fetch {
    const LINE: usize = 64;

    /// All of `ahead` in so many calls.
    pub(crate) fn new(ahead: Ahead, calls: usize) -> Self {
        let mut streams = [core::ptr::null(); 8];
        let each = streams.len() / ahead.pieces.len();
        let left = ahead.len / Self::LINE / each;
        for (streams, start) in streams.chunks_exact_mut(each).zip(ahead.pieces) {
            for (i, stream) in streams.iter_mut().enumerate() {
                *stream = start.wrapping_add(i * left * Self::LINE);
            }
        }
        Self { streams, left, step: left.div_ceil(calls.max(1)) }
    }

    /// The next lines.
    #[inline]
    pub(crate) fn some(&mut self) {
        for _ in 0..self.step.min(self.left) {
            for stream in &mut self.streams {
                far(*stream);
                *stream = stream.wrapping_add(Self::LINE);
            }
            self.left -= 1;
        }
    }
}
