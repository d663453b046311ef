//! Which experts tokens were sent to, by what the tokens are: counted only where somebody asked for it.

use super::experts::ExpertScratch;
use crate::config::{Modality, Vocab};
use crate::memory::filled;
use crate::part::Part;

/// Kinds of tokens: text, audio units, and the four parts.
pub const KINDS: usize = 2 + Part::ALL.len();

/// Names of the kinds of tokens, in order.
pub const KIND_NAMES: [&str; KINDS] = ["text", "audio", "face", "hands", "upper", "lower"];

/// Rows that every expert of every layer took since it was last cleared, by the kind of the row's token.
#[derive(Clone, Debug)]
pub struct Tally {
    /// `[encoder layers + decoder layers, KINDS, experts]`.
    counts: Box<[u32]>,
    /// Kind of each row of the pass in work; room for the longest.
    kinds: Vec<u8>,
    /// Kinds of ids that are no text, in the order of the kinds after it.
    spoken: [Modality; KINDS - 1],
    experts: usize,
}

impl Tally {
    /// For stacks of `layers` layers in all, and passes over at most `rows` rows.
    pub(super) fn new(vocab: &Vocab, layers: usize, experts: usize, rows: usize) -> Self {
        let [face, hands, upper, lower] = Part::ALL.map(|part| vocab[part]);
        Self {
            counts: filled(0, layers * KINDS * experts).into(),
            kinds: Vec::with_capacity(rows),
            spoken: [vocab.audio, face, hands, upper, lower],
            experts,
        }
    }

    /// `[encoder layers + decoder layers, KINDS, experts]`: the encoder's layers first.
    pub fn counts(&self) -> &[u32] {
        &self.counts
    }

    /// Starts counting anew.
    pub(crate) fn clear(&mut self) {
        self.counts.fill(0);
    }

    /// A pass without rows.
    pub(super) fn begin_pass(&mut self) {
        self.kinds.clear();
    }

    /// More rows of the pass.
    pub(super) fn add_rows(&mut self, ids: &[u32]) {
        for &id in ids {
            let kind = self.spoken.iter().position(|modality| holds(modality, id as usize));
            // At most `KINDS` of them.
            self.kinds.push(kind.map_or(0, |kind| u8::try_from(kind + 1).unwrap_or(0)));
        }
    }

    /// Counts where the rows of the pass went in `layer`, the decoder's layers after the encoder's.
    pub(super) fn count(&mut self, layer: usize, routed: &ExpertScratch) {
        let start = layer * KINDS * self.experts;
        for expert in 0..self.experts {
            for &row in routed.rows_of(expert) {
                let kind = usize::from(self.kinds[row as usize]);
                self.counts[start + kind * self.experts + expert] += 1;
            }
        }
    }
}

/// Whether `id` is a code of `modality`, or one of its markers.
fn holds(modality: &Modality, id: usize) -> bool {
    let codes = modality.first..modality.first + modality.codes;
    codes.contains(&id) || [modality.start, modality.end, modality.mask].contains(&id)
}
