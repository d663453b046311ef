//! Counts of tokens per expert, by the kind of the token; optional.

use umo_core_base::memory::filled;
use umo_core_pose::part::Part;

use super::experts::ExpertScratch;
use crate::config::{Config, Modality};

/// Kinds of tokens in layout `parts`: text, audio units, and the four parts.
pub const KINDS: usize = 2 + Part::ALL.len();

/// Names of the kinds of tokens in layout `parts`, in order.
pub const KIND_NAMES: [&str; KINDS] = ["text", "audio", "face", "hands", "upper", "lower"];

/// Names of the kinds of tokens in layout `frames`, in order: the last two are keyframes, of the
/// history and of the chunk.
pub const FRAME_KIND_NAMES: [&str; 4] = ["text", "audio", "history", "chunk"];

/// Names of a model's kinds of tokens, in order.
pub fn kind_names(config: &Config) -> &'static [&'static str] {
    if config.is_frames() { &FRAME_KIND_NAMES } else { &KIND_NAMES }
}

/// Number of rows processed by every expert of every layer since the counts were last cleared, by the kind of
/// the row's token.
#[derive(Clone, Debug)]
pub struct Tally {
    /// `[encoder layers + decoder layers, kinds, experts]`.
    counts: Box<[u32]>,
    /// Kind of each row of the current pass; reserved for the longest.
    kinds: Vec<u8>,
    /// Modalities of the kinds after text, in order.
    spoken: Vec<Modality>,
    /// The first id of the history's keyframes and the first of the chunk's, in layout `frames`.
    keyframes: Option<[usize; 2]>,
    /// Number of kinds.
    width: usize,
    experts: usize,
}

impl Tally {
    /// Creates counters for `layers` layers in all and passes over at most `rows` rows.
    pub(crate) fn new(config: &Config, layers: usize, rows: usize) -> Self {
        let (vocab, experts, width) = (&config.vocab, config.lm.experts, kind_names(config).len());
        let mut spoken = vec![vocab.audio];
        if !config.is_frames() {
            spoken.extend(Part::ALL.map(|part| vocab[part]));
        }
        Self {
            counts: filled(0, layers * width * experts).into(),
            kinds: Vec::with_capacity(rows),
            spoken,
            keyframes: config.is_frames().then_some([vocab.size, vocab.size + config.prefix]),
            width,
            experts,
        }
    }

    /// `[encoder layers + decoder layers, kinds, experts]`: the encoder's layers first.
    pub fn counts(&self) -> &[u32] {
        &self.counts
    }

    /// Resets the counts.
    pub(crate) fn clear(&mut self) {
        self.counts.fill(0);
    }

    /// Starts a pass without rows.
    pub(super) fn begin_pass(&mut self) {
        self.kinds.clear();
    }

    /// Adds rows to the pass.
    pub(super) fn add_rows(&mut self, ids: &[u32]) {
        for &id in ids {
            let id = id as usize;
            let kind = match self.keyframes {
                Some([history, chunk]) if id >= history => 2 + usize::from(id >= chunk),
                _ => self.spoken.iter().position(|modality| holds(modality, id)).map_or(0, |kind| kind + 1),
            };
            // At most `KINDS` of them.
            self.kinds.push(u8::try_from(kind).unwrap_or(0));
        }
    }

    /// Counts the experts chosen in `layer` for the pass's rows from `first` on. Decoder layers are numbered
    /// after the encoder's.
    pub(crate) fn count(&mut self, layer: usize, first: usize, routed: &ExpertScratch) {
        let start = layer * self.width * self.experts;
        for expert in 0..self.experts {
            for &row in routed.rows_of(expert) {
                let kind = usize::from(self.kinds[first + row as usize]);
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
