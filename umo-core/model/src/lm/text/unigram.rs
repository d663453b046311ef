//! Most likely segmentation of a normalised text into pieces.

use std::collections::HashMap;

use umo_core_base::memory::{filled, refuse};

use super::proto::{Kind, Proto};

/// Score difference between the least likely piece and an unknown character, as in SentencePiece.
const UNKNOWN_PENALTY: f32 = 10.0;

/// Pieces and their scores.
#[derive(Debug)]
pub(super) struct Unigram {
    pieces: HashMap<Box<str>, Scored>,
    /// Length of the longest piece, in bytes.
    longest: usize,
    unknown: Scored,
    /// Largest score of a normal piece.
    best: f32,
    /// Ids of the 256 bytes, if unknown text falls back to them.
    bytes: Option<Box<[u32]>>,
}

#[derive(Clone, Copy, Debug)]
struct Scored {
    id: u32,
    score: f32,
    user_defined: bool,
}

/// Best segmentation up to a position in the text.
#[derive(Clone, Copy, Default)]
struct Step {
    score: f32,
    /// Start and id of its last piece; `None` if the position was not reached.
    last: Option<(usize, u32)>,
}

impl Unigram {
    pub(crate) fn new(proto: &Proto) -> Result<Self, String> {
        if proto.model_type != 1 {
            return Err(format!("expected one of type 1, unigram, got type {}", proto.model_type));
        }
        let (mut pieces, mut unknown) = (HashMap::<Box<str>, Scored>::new(), None);
        if pieces.try_reserve(proto.pieces.len()).is_err() {
            refuse(proto.pieces.len() * size_of::<(Box<str>, Scored)>());
        }
        let (mut least, mut best) = (f32::MAX, f32::MIN_POSITIVE);
        for (piece, id) in proto.pieces.iter().zip(0_u32..) {
            let user_defined = piece.kind == Kind::UserDefined;
            match piece.kind {
                Kind::Normal => (least, best) = (least.min(piece.score), best.max(piece.score)),
                Kind::Unknown => unknown = Some(id),
                _ => {}
            }
            if (user_defined || piece.kind == Kind::Normal) && !piece.text.is_empty() {
                pieces.insert(piece.text.into(), Scored { id, score: piece.score, user_defined });
            }
        }
        let unknown = unknown.ok_or("it has no unknown piece")?;
        let bytes = if proto.byte_fallback { Some(byte_ids(proto)?) } else { None };
        let longest = pieces.keys().map(|text| text.len()).max().ok_or("it has no pieces")?;
        let unknown = Scored { id: unknown, score: least - UNKNOWN_PENALTY, user_defined: false };
        Ok(Self { pieces, longest, unknown, best, bytes })
    }

    /// Returns the ids of a normalised text. A run of unknown characters gives one id.
    pub(super) fn split(&self, text: &str) -> Vec<u32> {
        let steps = self.steps(text);
        let (mut ids, mut end) = (Vec::new(), text.len());
        while let Some((start, id)) = steps[end].last {
            match &self.bytes {
                Some(bytes) if id == self.unknown.id => {
                    ids.extend(text.as_bytes()[start..end].iter().rev().map(|&byte| bytes[usize::from(byte)]));
                }
                None if id == self.unknown.id && ids.last() == Some(&id) => {}
                _ => ids.push(id),
            }
            end = start;
        }
        ids.reverse();
        ids
    }

    /// Computes the best segmentation up to each position, from the front.
    fn steps(&self, text: &str) -> Vec<Step> {
        let mut steps = filled(Step::default(), text.len() + 1);
        for (start, c) in text.char_indices() {
            let so_far = steps[start].score;
            let mut offer = |end: usize, piece: Scored, score: f32| {
                let step = &mut steps[end];
                if step.last.is_none() || so_far + score > step.score {
                    *step = Step { score: so_far + score, last: Some((start, piece.id)) };
                }
            };
            let mut single = false;
            let limit = text.len().min(start.saturating_add(self.longest));
            for end in (start + c.len_utf8()..=limit).filter(|&end| text.is_char_boundary(end)) {
                let Some(&piece) = self.pieces.get(&text[start..end]) else { continue };
                single |= end - start == c.len_utf8();
                offer(end, piece, self.score(piece, end - start));
            }
            if !single {
                offer(start + c.len_utf8(), self.unknown, self.unknown.score);
            }
        }
        steps
    }

    /// A user-defined piece outscores any segmentation of its text.
    #[expect(clippy::cast_precision_loss, reason = "pieces have far fewer than 2^24 bytes")]
    fn score(&self, piece: Scored, len: usize) -> f32 {
        if piece.user_defined { len as f32 * self.best - 0.1 } else { piece.score }
    }
}

/// The ids of pieces `<0x00>` to `<0xFF>`.
fn byte_ids(proto: &Proto) -> Result<Box<[u32]>, String> {
    let bytes = proto.pieces.iter().zip(0_u32..).filter(|(piece, _)| piece.kind == Kind::Byte);
    let ids: HashMap<&str, u32> = bytes.map(|(piece, id)| (piece.text, id)).collect();
    let id = |byte: u8| ids.get(&*format!("<0x{byte:02X}>")).copied().ok_or_else(|| format!("no piece of byte {byte}"));
    (0..=u8::MAX).map(id).collect()
}
