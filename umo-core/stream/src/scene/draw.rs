//! Random choices: of a seed, a member's number and a tick.

use umo_core_base::random::philox;

/// Draws of one member at one tick, for one purpose.
#[derive(Debug)]
pub(super) struct Draws {
    key: [u32; 2],
    words: [u32; 4],
}

/// Purpose of a choice: draws of different purposes are independent.
#[derive(Clone, Copy, Debug)]
pub(super) enum Purpose {
    Looks = 1,
    Answers = 2,
    Posture = 3,
}

impl Draws {
    #[expect(clippy::cast_possible_truncation, reason = "taking halves of 64-bit words is intended")]
    pub(super) fn new(seed: u64, id: u32, tick: u64, purpose: Purpose) -> Self {
        // The last byte is 0 in the sampler's draws, and 1 in the layers'.
        let last = 2 | (purpose as u32) << 8;
        Self { key: [seed as u32, (seed >> 32) as u32], words: [tick as u32, (tick >> 32) as u32, id, last] }
    }

    /// A number in `0..1`.
    pub(super) fn next(&mut self) -> f32 {
        let [bits, ..] = philox(self.words, self.key);
        self.words[3] += 1 << 16;
        (bits >> 8) as f32 / (1 << 24) as f32
    }

    /// One of the bits of a set.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "less than 32")]
    pub(super) fn one_of(&mut self, set: u32) -> Option<usize> {
        let which = (self.next() * set.count_ones() as f32) as usize;
        (0..32).filter(|slot| set >> slot & 1 == 1).nth(which)
    }
}

/// A number of a range.
pub(super) fn between([least, most]: [f32; 2], t: f32) -> f32 {
    least + (most - least) * t
}

/// As [`between`], but small numbers are more frequent than large ones.
pub(super) fn short(range: [f32; 2], t: f32) -> f32 {
    between(range, t * t.sqrt())
}
