//! Normalisation of text for the pieces: replaces characters by the model's table and marks spaces.

use super::proto::{Kind, Proto};

/// Replacement of a space in pieces.
const SPACE: &str = "\u{2581}";

/// Replaces characters and marks spaces.
#[derive(Debug)]
pub(super) struct Normalizer {
    table: Option<Table>,
    /// Texts that are never replaced.
    user_defined: Vec<Box<str>>,
    add_dummy_prefix: bool,
    space_as_suffix: bool,
    remove_extra_spaces: bool,
    space: &'static str,
}

/// The character table: a trie of the replaced prefixes, as a double array, and the replacements.
#[derive(Debug)]
struct Table {
    units: Box<[u32]>,
    /// Replacements, each terminated by a zero.
    texts: Box<str>,
}

impl Normalizer {
    pub(crate) fn new(proto: &Proto) -> Result<Self, &'static str> {
        let user_defined =
            proto.pieces.iter().filter(|piece| piece.kind == Kind::UserDefined && !piece.text.is_empty());
        Ok(Self {
            table: if proto.charsmap.is_empty() { None } else { Some(Table::new(proto.charsmap)?) },
            user_defined: user_defined.map(|piece| piece.text.into()).collect(),
            add_dummy_prefix: proto.add_dummy_prefix,
            space_as_suffix: proto.space_as_suffix,
            remove_extra_spaces: proto.remove_extra_spaces,
            space: if proto.escape_spaces { SPACE } else { " " },
        })
    }

    pub(super) fn normalize(&self, mut text: &str) -> String {
        let mut out = String::with_capacity(text.len() + 2 * SPACE.len());
        if self.remove_extra_spaces {
            while let Some((" ", len)) = self.next(text) {
                text = &text[len..];
            }
        }
        if text.is_empty() {
            return out;
        }
        if self.add_dummy_prefix && !self.space_as_suffix {
            out.push_str(self.space);
        }
        let mut after_space = self.remove_extra_spaces;
        while let Some((mut replaced, len)) = self.next(text) {
            text = &text[len..];
            if after_space {
                replaced = replaced.trim_start_matches(' ');
            }
            for c in replaced.chars() {
                if c == ' ' { out.push_str(self.space) } else { out.push(c) }
            }
            if !replaced.is_empty() {
                after_space = self.remove_extra_spaces && replaced.ends_with(' ');
            }
        }
        if self.remove_extra_spaces {
            out.truncate(out.trim_end_matches(self.space).len());
        }
        if self.add_dummy_prefix && self.space_as_suffix {
            out.push_str(self.space);
        }
        out
    }

    /// Replacement of the start of `text`, and the number of bytes that it replaces.
    fn next<'a>(&'a self, text: &'a str) -> Option<(&'a str, usize)> {
        let kept = self.user_defined.iter().filter(|kept| text.starts_with(&***kept)).map(|kept| kept.len()).max();
        if let Some(len) = kept {
            return Some((&text[..len], len));
        }
        let first = text.chars().next()?.len_utf8();
        let replaced = self.table.as_ref().and_then(|table| table.longest(text));
        Some(replaced.unwrap_or((&text[..first], first)))
    }
}

impl Table {
    fn new(bytes: &[u8]) -> Result<Self, &'static str> {
        const CUT: &str = "its table of characters is cut short";
        let (len, rest) = bytes.split_first_chunk().ok_or(CUT)?;
        let (units, texts) = rest.split_at_checked(u32::from_le_bytes(*len) as usize).ok_or(CUT)?;
        let texts = str::from_utf8(texts).map_err(|_| "its table of characters is not UTF-8")?;
        let units = units.as_chunks().0.iter().map(|unit| u32::from_le_bytes(*unit)).collect();
        Ok(Self { units, texts: texts.into() })
    }

    /// Replacement of the longest prefix of `text` that has one, and the length of that prefix.
    fn longest(&self, text: &str) -> Option<(&str, usize)> {
        let mut found = None;
        let mut at = offset(*self.units.first()?);
        for (i, &byte) in text.as_bytes().iter().enumerate() {
            at ^= usize::from(byte);
            let Some(&unit) = self.units.get(at).filter(|unit| label(**unit) == u32::from(byte)) else { break };
            at ^= offset(unit);
            if has_leaf(unit) {
                found = self.units.get(at).and_then(|leaf| self.text(*leaf)).map(|text| (text, i + 1)).or(found);
            }
        }
        // A hostile table may end a prefix inside a character.
        found.filter(|(_, len)| text.is_char_boundary(*len))
    }

    fn text(&self, leaf: u32) -> Option<&str> {
        let rest = self.texts.get((leaf & 0x7fff_ffff) as usize..)?;
        rest.split('\0').next()
    }
}

/// Bits of a unit of the double array, as the `darts-clone` library lays them out.
fn label(unit: u32) -> u32 {
    unit & 0x8000_00ff
}

fn has_leaf(unit: u32) -> bool {
    unit >> 8 & 1 == 1
}

fn offset(unit: u32) -> usize {
    ((unit >> 10) << ((unit & 0x200) >> 6)) as usize
}
