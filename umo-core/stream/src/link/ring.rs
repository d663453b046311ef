//! Wait-free queue of words between two threads: audio into an engine, frames out of it.
//!
//! ```text
//!        read                    written
//!          v                        v
//!  ... free | words for the consumer | free ...      positions only grow; a word lives at `position % capacity`
//! ```
//! Each side moves its own position and reads the other's. Words are atomics, so nothing here is
//! `unsafe`: two concurrent producers could only mix up words. [`Session`](crate::session::Session)
//! limits each side to one thread at a time.

use std::ops::Range;

use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{Span, StateError, StatePass};
pub(super) use umo_core_base::sync::{AtomicU32, AtomicU64, Ordering};

/// Upper bound of a saved ring's positions: 2^62 words are thousands of years.
const MAX_POSITION: u64 = 1 << 62;

/// A queue of 32-bit words with one producer and one consumer.
#[derive(Debug)]
pub(crate) struct Ring {
    words: Slice<AtomicU32>,
    /// Total words written.
    written: AtomicU64,
    /// Total words read or skipped.
    read: AtomicU64,
}

impl Ring {
    /// Creates an empty ring for `capacity` words, in memory of `arena`.
    pub(crate) fn new_in(capacity: usize, arena: &Arena) -> Self {
        assert!(capacity > 0, "a ring has room for at least one word");
        let words = arena.collect((0..capacity).map(|_| AtomicU32::new(0)));
        Self { words, written: AtomicU64::new(0), read: AtomicU64::new(0) }
    }

    pub(crate) fn capacity(&self) -> usize {
        self.words.len()
    }

    /// Total words written: the position of the next one.
    pub(crate) fn written(&self) -> u64 {
        self.written.load(Ordering::SeqCst)
    }

    /// Total words read: the position of the oldest waiting one.
    pub(crate) fn read_position(&self) -> u64 {
        self.read.load(Ordering::SeqCst)
    }

    /// Number of words that wait for the consumer.
    #[expect(clippy::cast_possible_truncation, reason = "at most the capacity")]
    pub(crate) fn len(&self) -> usize {
        // The consumer may advance between the two loads, but never past the written position.
        let read = self.read.load(Ordering::SeqCst);
        self.written.load(Ordering::SeqCst).saturating_sub(read).min(self.capacity() as u64) as usize
    }

    /// Number of words that the producer can write.
    pub(crate) fn room(&self) -> usize {
        self.capacity() - self.len()
    }

    /// Producer: appends as many of `words` as fit; returns their number.
    pub(crate) fn push(&self, words: impl ExactSizeIterator<Item = u32>) -> usize {
        self.push_some(words.len(), words)
    }

    /// Producer: [`Self::push`] of the first `len` of `words`, which has at least that many.
    pub(crate) fn push_some(&self, len: usize, words: impl Iterator<Item = u32>) -> usize {
        let start = self.written.load(Ordering::Relaxed);
        let count = len.min(self.room());
        let mut at = self.place(start);
        for word in words.take(count) {
            self.words[at].store(word, Ordering::Relaxed);
            at = if at + 1 == self.words.len() { 0 } else { at + 1 };
        }
        // Publishes the words. SeqCst, because a producer that then checks whether the consumer
        // sleeps must not read a stale value.
        self.written.store(start + count as u64, Ordering::SeqCst);
        count
    }

    /// Consumer: moves the oldest words to `words`, as many as are waiting; returns their number.
    #[cfg(test)]
    pub(crate) fn pop(&self, words: &mut [u32]) -> usize {
        let count = self.peek(words);
        self.skip(count);
        count
    }

    /// Consumer: copies the oldest words without removing them; returns their number.
    pub(crate) fn peek(&self, words: &mut [u32]) -> usize {
        let count = words.len().min(self.len());
        let mut slots = words.iter_mut();
        self.peek_range(0..count, |word| {
            if let Some(slot) = slots.next() {
                *slot = word;
            }
        });
        count
    }

    /// Consumer: reads a range of words, counted from the oldest. All of them must be present.
    pub(crate) fn peek_range(&self, range: Range<usize>, mut read: impl FnMut(u32)) {
        debug_assert!(range.end <= self.len(), "the words are there");
        let start = self.read.load(Ordering::Relaxed) + range.start as u64;
        let mut at = self.place(start);
        for _ in range {
            read(self.words[at].load(Ordering::Relaxed));
            at = if at + 1 == self.words.len() { 0 } else { at + 1 };
        }
    }

    /// Consumer: drops the oldest `count` words, or all if there are fewer.
    pub(crate) fn skip(&self, count: usize) {
        let start = self.read.load(Ordering::Relaxed);
        self.read.store(start + count.min(self.len()) as u64, Ordering::SeqCst);
    }

    /// Consumer: drops all words before `position`.
    pub(crate) fn skip_to(&self, position: u64) {
        let start = self.read.load(Ordering::Relaxed);
        self.read.store(position.clamp(start, self.written()), Ordering::SeqCst);
    }

    /// Describes the words that wait, or those from position `from` on; returns their number.
    /// `is_good` validates words that come from a state. The caller excludes the consumer, and
    /// guarantees that the words from `from` on are not overwritten. Words that a producer adds
    /// meanwhile are left out.
    pub(crate) fn state(
        &self,
        pass: &mut StatePass,
        what: &'static str,
        from: Option<u64>,
        is_good: impl Fn(&[[u8; 4]]) -> bool,
    ) -> Result<usize, StateError> {
        let start = from.unwrap_or(self.read_position());
        #[expect(clippy::cast_possible_truncation, reason = "at most the capacity")]
        let waiting = self.written().saturating_sub(start).min(self.capacity() as u64) as usize;
        let read = pass.limited(what, start, MAX_POSITION)?;
        let len = pass.count(what, waiting, self.capacity())?;
        let place = self.place(read);
        let (old, young) =
            (place..self.words.len().min(place + len), 0..(place + len).saturating_sub(self.words.len()));
        let words = self.words[old].iter().chain(&self.words[young]);
        match pass.span(4 * len)? {
            Span::Size => {}
            Span::Save(bytes) => {
                let slots = bytes.as_chunks_mut().0.iter_mut();
                slots.zip(words).for_each(|(slot, word)| *slot = word.load(Ordering::Relaxed).to_le_bytes());
            }
            Span::Check(bytes) => {
                if !is_good(bytes.as_chunks().0) {
                    return Err(StateError::Field(what));
                }
            }
            Span::Load(bytes) => {
                let values = bytes.as_chunks().0.iter();
                words.zip(values).for_each(|(word, &value)| word.store(u32::from_le_bytes(value), Ordering::Relaxed));
                self.read.store(read, Ordering::SeqCst);
                self.written.store(read + len as u64, Ordering::SeqCst);
            }
        }
        Ok(len)
    }

    #[expect(clippy::cast_possible_truncation, reason = "below the capacity")]
    fn place(&self, position: u64) -> usize {
        (position % self.words.len() as u64) as usize
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    proptest! {
        #[test]
        fn a_ring_is_a_queue_with_an_end(capacity in 1_usize..20, steps in prop::collection::vec((0_u8..3, 0_usize..25), 0..60)) {
            let (ring, mut queue, mut next) = (Ring::new_in(capacity, &Arena::system()), VecDeque::new(), 0_u32);
            for (what, count) in steps {
                match what {
                    0 => {
                        let words: Vec<u32> = (next..).take(count).collect();
                        let taken = ring.push(words.iter().copied());
                        prop_assert_eq!(taken, count.min(capacity - queue.len()));
                        queue.extend(&words[..taken]);
                        next += u32::try_from(taken).unwrap();
                    }
                    1 => {
                        let mut words = vec![0; count];
                        let taken = ring.pop(&mut words);
                        prop_assert_eq!(&words[..taken], &queue.drain(..count.min(queue.len())).collect::<Vec<u32>>()[..]);
                    }
                    _ => {
                        ring.skip(count);
                        queue.drain(..count.min(queue.len()));
                    }
                }
                prop_assert_eq!(ring.len(), queue.len());
                prop_assert_eq!(ring.room(), capacity - queue.len());
            }
        }
    }

    #[test]
    fn two_threads_pass_every_word_on_once_and_in_order() {
        const WORDS: u32 = 2_000_000;
        let ring = Ring::new_in(1_000, &Arena::system());
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut next = 0;
                while next < WORDS {
                    let count = (next % 37 + 1).min(WORDS - next);
                    next += u32::try_from(ring.push((next..next + count).collect::<Vec<_>>().into_iter())).unwrap();
                }
            });
            let (mut next, mut words) = (0, [0; 64]);
            while next < WORDS {
                let count = ring.pop(&mut words);
                for &word in &words[..count] {
                    assert_eq!(word, next);
                    next += 1;
                }
            }
        });
    }
}

/// Every interleaving of one producer and one consumer:
/// `RUSTFLAGS="--cfg loom" cargo test -p umo-core-stream --release --lib interleavings`.
#[cfg(all(test, loom))]
mod interleavings {
    use super::*;
    use loom::sync::Arc;

    #[test]
    fn no_interleaving_loses_or_repeats_a_word() {
        loom::model(|| {
            let ring = Arc::new(Ring::new_in(2, &Arena::system()));
            let producer = Arc::clone(&ring);
            let thread = loom::thread::spawn(move || {
                let first = producer.push([1, 2].into_iter());
                first + producer.push([3].into_iter())
            });
            let (mut seen, mut words) = (Vec::new(), [0; 2]);
            for _ in 0..2 {
                let count = ring.pop(&mut words);
                seen.extend_from_slice(&words[..count]);
            }
            let pushed = thread.join().unwrap();
            loop {
                match ring.pop(&mut words) {
                    0 => break,
                    count => seen.extend_from_slice(&words[..count]),
                }
            }
            assert!(pushed >= 2);
            assert_eq!(seen, (1..=u32::try_from(pushed).unwrap()).collect::<Vec<_>>());
        });
    }

    #[test]
    fn concurrent_skip_drops_only_old_words() {
        loom::model(|| {
            let ring = Arc::new(Ring::new_in(2, &Arena::system()));
            ring.push([1].into_iter());
            let producer = Arc::clone(&ring);
            let thread = loom::thread::spawn(move || producer.push([2, 3].into_iter()));
            ring.skip_to(1);
            let pushed = thread.join().unwrap();
            let mut words = [0; 2];
            let count = ring.pop(&mut words);
            assert_eq!(&words[..count], &[2, 3][..pushed]);
        });
    }
}
