//! The steps of a batch.

use crate::lm::EncoderPiece;

/// Position of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// No batch is in progress.
    Idle,
    /// A step of the audio tokenizer for one member.
    Tokenize { member: usize },
    /// One layer of the encoder, or a piece of it for the sequences from `first` on.
    Encode { layer: usize, first: usize, piece: EncoderPiece },
    /// The decoder's keys and values of one sequence's encoder states, starting at `row`, in one layer.
    Attend { sequence: usize, layer: usize, row: usize },
    /// One layer of a decoder pass, for the sequences from `first` on.
    Decode { layer: usize, first: usize },
    /// Drawing of a decoder pass's codes, for the tasks from `first` on, their codes from `code` on.
    Draw { first: usize, code: usize },
    /// A step of one member's interpolation, or all of it.
    Interpolate { member: usize },
    /// One motion decoder of one member, or all of them.
    DecodeMotion { member: usize },
}

impl Phase {
    /// The encoder's first layer.
    pub(super) const ENCODE: Self = Self::Encode { layer: 0, first: 0, piece: EncoderPiece::FIRST };
    /// A decoder pass.
    pub(super) const DECODE: Self = Self::Decode { layer: 0, first: 0 };
    /// The codes of a decoder pass.
    pub(super) const DRAW: Self = Self::Draw { first: 0, code: 0 };
    /// Number of kinds of steps.
    pub(super) const KINDS: usize = 8;

    /// Number of the step's kind.
    pub(super) fn kind(self) -> usize {
        match self {
            Self::Idle => 0,
            Self::Tokenize { .. } => 1,
            Self::Encode { .. } => 2,
            Self::Attend { .. } => 3,
            Self::Decode { .. } => 4,
            Self::Draw { .. } => 5,
            Self::Interpolate { .. } => 6,
            Self::DecodeMotion { .. } => 7,
        }
    }

    /// Name of the step's kind.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Idle => "begin",
            Self::Tokenize { .. } => "tokenize",
            Self::Encode { .. } => "encode",
            Self::Attend { .. } => "attend",
            Self::Decode { .. } => "decode",
            Self::Draw { .. } => "draw",
            Self::Interpolate { .. } => "interpolate",
            Self::DecodeMotion { .. } => "decode motion",
        }
    }
}
