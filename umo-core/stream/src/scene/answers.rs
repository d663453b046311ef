//! Answers of listeners without words: nods, raised brows, half smiles.

use umo_core_base::state::{StateError, StatePass};

use super::draw::{Draws, between};
use super::long_ticks;

/// Seconds of listening between two nods, unless a phrase ends later; seconds by which it may.
const GAP: [f32; 2] = [3.6, 8.0];
const WAITS: [f32; 2] = [2.0, 4.0];
/// Seconds from the end of a phrase, or from the time that one is overdue, to an answer.
const DELAY: [f32; 2] = [0.1, 0.6];

/// Shares of raised brows and of half smiles with a nod, and without one at the end of a phrase.
const BROWS: [f32; 2] = [0.3, 0.12];
const SMILES: [f32; 2] = [0.15, 0.05];

/// Answers of one member; times in ticks.
#[derive(Debug)]
pub(super) struct Answers {
    /// Until the next nod is due, and for how long it then waits for a phrase's end.
    due: u32,
    waits: u32,
    /// Until each begins, one more than the ticks; 0 if none is due.
    pending: [u32; 3],
    /// Numbers of nods, brow raises and half smiles so far.
    pub(super) counts: [u32; 3],
}

impl Answers {
    pub(super) fn new(draws: &mut Draws) -> Self {
        let due = long_ticks(between(GAP, 0.7 * draws.next()));
        Self { due, waits: long_ticks(WAITS[0]), pending: [0; 3], counts: [0; 3] }
    }

    /// Advances by one tick; `listens` while somebody else speaks, `ends` as a phrase of theirs has ended.
    pub(super) fn advance(&mut self, (listens, ends): (bool, bool), allowed: [bool; 3], draws: &mut Draws) {
        for (kind, pending) in self.pending.iter_mut().enumerate() {
            if *pending == 1 && allowed[kind] {
                self.counts[kind] = self.counts[kind].wrapping_add(1);
            }
            *pending = pending.saturating_sub(1);
        }
        if !listens {
            return;
        }
        let is_due = self.due == 0;
        if is_due {
            self.waits = self.waits.saturating_sub(1);
        }
        self.due = self.due.saturating_sub(1);
        let nods = is_due && (ends || self.waits == 0);
        if !(nods || ends) {
            return;
        }
        let which = usize::from(!nods);
        let is_asked = [nods, draws.next() < BROWS[which], draws.next() < SMILES[which]];
        for (pending, is_asked) in self.pending.iter_mut().zip(is_asked) {
            let delay = long_ticks(between(DELAY, draws.next()));
            if is_asked && *pending == 0 {
                *pending = 1 + delay;
            }
        }
        if nods {
            self.due = long_ticks(between(GAP, draws.next()));
            self.waits = long_ticks(between(WAITS, draws.next()));
        }
    }

    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        for count in [&mut self.due, &mut self.waits].into_iter().chain(&mut self.pending) {
            super::count(pass, count, 1 << 20)?;
        }
        pass.ids(&mut self.counts)
    }
}
