//! The fields of a SentencePiece model that splitting needs, read from its protocol buffer.

/// Type of a piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Matched in text.
    Normal,
    /// Result for text that no other piece matches.
    Unknown,
    /// A marker, never matched in text.
    Control,
    /// Matched in text before all others.
    UserDefined,
    /// An unused id.
    Unused,
    /// One byte, for text that no other piece matches.
    Byte,
}

/// One piece; its index is its id.
#[derive(Debug)]
pub(super) struct Piece<'a> {
    pub(super) text: &'a str,
    pub(super) score: f32,
    pub(super) kind: Kind,
}

/// A SentencePiece model.
#[derive(Debug)]
pub(super) struct Proto<'a> {
    pub(super) pieces: Vec<Piece<'a>>,
    /// Type of the model; 1 is unigram.
    pub(super) model_type: u64,
    pub(super) byte_fallback: bool,
    /// Whether the space marker follows its word.
    pub(super) space_as_suffix: bool,
    /// The compiled character table.
    pub(super) charsmap: &'a [u8],
    pub(super) add_dummy_prefix: bool,
    pub(super) remove_extra_spaces: bool,
    pub(super) escape_spaces: bool,
}

type Parsed<T> = Result<T, &'static str>;

/// A field's value.
#[derive(Clone, Copy)]
enum Value<'a> {
    Number(u64),
    Float(f32),
    Bytes(&'a [u8]),
    /// Eight bytes; no field read here has this type.
    Other,
}

impl<'a> Proto<'a> {
    pub(super) fn parse(bytes: &'a [u8]) -> Parsed<Self> {
        let mut proto = Self {
            pieces: Vec::new(),
            model_type: 1,
            byte_fallback: false,
            space_as_suffix: false,
            charsmap: &[],
            add_dummy_prefix: true,
            remove_extra_spaces: true,
            escape_spaces: true,
        };
        for_each_field(bytes, |field, value| {
            match (field, value) {
                (1, Value::Bytes(piece)) => proto.pieces.push(parse_piece(piece)?),
                (2, Value::Bytes(trainer)) => proto.parse_trainer(trainer)?,
                (3, Value::Bytes(normalizer)) => proto.parse_normalizer(normalizer)?,
                _ => {}
            }
            Ok(())
        })?;
        Ok(proto)
    }

    fn parse_trainer(&mut self, bytes: &[u8]) -> Parsed<()> {
        for_each_field(bytes, |field, value| {
            match (field, value) {
                (3, Value::Number(kind)) => self.model_type = kind,
                (24, Value::Number(flag)) => self.space_as_suffix = flag != 0,
                (35, Value::Number(flag)) => self.byte_fallback = flag != 0,
                _ => {}
            }
            Ok(())
        })
    }

    fn parse_normalizer(&mut self, bytes: &'a [u8]) -> Parsed<()> {
        for_each_field(bytes, |field, value| {
            match (field, value) {
                (2, Value::Bytes(map)) => self.charsmap = map,
                (3, Value::Number(flag)) => self.add_dummy_prefix = flag != 0,
                (4, Value::Number(flag)) => self.remove_extra_spaces = flag != 0,
                (5, Value::Number(flag)) => self.escape_spaces = flag != 0,
                _ => {}
            }
            Ok(())
        })
    }
}

fn parse_piece(bytes: &[u8]) -> Parsed<Piece<'_>> {
    let mut piece = Piece { text: "", score: 0.0, kind: Kind::Normal };
    for_each_field(bytes, |field, value| {
        match (field, value) {
            (1, Value::Bytes(text)) => piece.text = str::from_utf8(text).map_err(|_| "a piece is not UTF-8")?,
            (2, Value::Float(score)) => piece.score = score,
            (3, Value::Number(kind)) => piece.kind = kind_of(kind)?,
            _ => {}
        }
        Ok(())
    })?;
    if !piece.score.is_finite() {
        return Err("a piece's score is not a finite number");
    }
    Ok(piece)
}

fn kind_of(number: u64) -> Parsed<Kind> {
    match number {
        1 => Ok(Kind::Normal),
        2 => Ok(Kind::Unknown),
        3 => Ok(Kind::Control),
        4 => Ok(Kind::UserDefined),
        5 => Ok(Kind::Unused),
        6 => Ok(Kind::Byte),
        _ => Err("a piece of unknown type"),
    }
}

/// Calls `f` with the number and value of every field of a message.
fn for_each_field<'a>(mut bytes: &'a [u8], mut f: impl FnMut(u64, Value<'a>) -> Parsed<()>) -> Parsed<()> {
    while !bytes.is_empty() {
        let key = varint(&mut bytes)?;
        let value = match key & 7 {
            0 => Value::Number(varint(&mut bytes)?),
            1 => take(&mut bytes, 8).map(|_| Value::Other)?,
            2 => {
                let len = usize::try_from(varint(&mut bytes)?).map_err(|_| "a field is too long")?;
                Value::Bytes(take(&mut bytes, len)?)
            }
            5 => {
                let four = take(&mut bytes, 4)?.try_into().map_err(|_| "cut short")?;
                Value::Float(f32::from_le_bytes(four))
            }
            _ => return Err("a field of unknown type"),
        };
        f(key >> 3, value)?;
    }
    Ok(())
}

fn take<'a>(bytes: &mut &'a [u8], len: usize) -> Parsed<&'a [u8]> {
    let (taken, rest) = bytes.split_at_checked(len).ok_or("cut short")?;
    *bytes = rest;
    Ok(taken)
}

/// Reads a number in groups of 7 bits, lowest first.
fn varint(bytes: &mut &[u8]) -> Parsed<u64> {
    let mut number = 0;
    for shift in (0..64).step_by(7) {
        let byte = take(bytes, 1)?[0];
        number |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Ok(number);
        }
    }
    Err("a number is too long")
}
