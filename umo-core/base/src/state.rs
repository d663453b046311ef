//! Serialization of a session. Each component describes its fields once, to a [`StatePass`] that measures, writes,
//! checks or reads them, so that saving and restoring cannot diverge.
//!
//! ```text
//! bytes   0  magic "umostate"       12  CRC-32 of all from byte 16 on
//!         8  format version         16  length of the whole           24  model, config of the session, fields
//! ```
//! All values are little-endian. No field is an address or a clock reading: times are written relative to now.

use std::fmt;
use std::ops::RangeInclusive;

/// First bytes of every state.
const MAGIC: [u8; 8] = *b"umostate";
/// The version of the format that this library reads and writes.
const VERSION: u32 = 9;
/// Upper bound of numbers that are checked again where they are used. Larger than any field; sums and products of two
/// of them stay finite. Comparisons with it are false for NaN.
const LARGEST: f64 = 1e12;
/// Upper bound of positions and distances, metres.
const FARTHEST: f64 = 1e8;
/// Upper bound of angles, speeds, seconds, levels and face values.
const MOST: f32 = 1e4;
/// Offset at which the checksum starts.
const CHECKED: usize = 16;
/// Bytes before the fields.
const HEADER: usize = 24;

/// Largest distance of a time from now that a state can represent, nanoseconds: 36 years.
const FURTHEST: u64 = 1 << 60;

/// Error from restoring a state. `Copy`: reporting one does not allocate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateError {
    /// Not a session's state: the magic number is missing.
    Foreign,
    /// The state has another format version.
    Version {
        /// The state's version.
        got: u32,
        /// The version that this library reads.
        want: u32,
    },
    /// The number of bytes differs from the length in the header.
    Length {
        /// Bytes given.
        got: u64,
        /// Length in the header.
        want: u64,
    },
    /// The bytes were changed after saving.
    Checksum,
    /// The state belongs to another model, or to another precision of the model.
    Model,
    /// The state belongs to a session with another config.
    Config {
        /// Name of the setting.
        what: &'static str,
        /// The state's value.
        got: u64,
        /// The session's value.
        want: u64,
    },
    /// A field has a value that no session writes.
    Field(&'static str),
}

impl fmt::Display for StateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Foreign => write!(f, "not a session state"),
            Self::Version { got, want } => {
                write!(
                    f,
                    "the state is of format version {got}, this library reads version {want}: save it again with this one"
                )
            }
            Self::Length { got, want } => write!(f, "expected a state of {want} bytes, got {got}"),
            Self::Checksum => write!(f, "the state was changed after it was saved: its checksum is wrong"),
            Self::Model => write!(f, "the state is of another model, or of this model at another precision"),
            Self::Config { what, got, want } => {
                write!(f, "the state's session has another {what}: {got}; this one has {want}")
            }
            Self::Field(what) => write!(f, "the state's {what} is invalid"),
        }
    }
}

impl std::error::Error for StateError {}

/// One pass over the fields of a session.
///
/// Every operation takes the field's current value and returns the effective one: the current one while a state is
/// measured or written, the state's while it is checked or read. Relations between fields are written once, in terms
/// of effective values.
#[derive(Debug)]
pub struct StatePass<'a> {
    mode: Mode<'a>,
    at: usize,
    /// Current time, nanoseconds: by the engine's clock, and by the clock of the host's side.
    now: u64,
    host_now: u64,
}

#[derive(Debug)]
enum Mode<'a> {
    /// Adds up the maximum length of the fields.
    Size,
    Save(&'a mut [u8]),
    /// Validates and changes nothing.
    Check(&'a [u8]),
    /// Reads validated bytes.
    Load(&'a [u8]),
}

/// Bytes of a field.
pub enum Span<'s> {
    /// No bytes: they are only counted.
    Size,
    /// Bytes to write.
    Save(&'s mut [u8]),
    /// Bytes to check.
    Check(&'s [u8]),
    /// Bytes to read.
    Load(&'s [u8]),
}

impl<'a> StatePass<'a> {
    /// Starts a pass that measures.
    pub fn size() -> Self {
        Self { mode: Mode::Size, at: HEADER, now: 0, host_now: 0 }
    }

    /// Starts a pass that writes to `bytes`, which must have the maximum length of a state.
    pub fn save(bytes: &'a mut [u8], now: u64, host_now: u64) -> Self {
        Self { mode: Mode::Save(bytes), at: HEADER, now, host_now }
    }

    /// Checks the header of `bytes`, and starts a pass that checks fields.
    pub fn check(bytes: &'a [u8], now: u64) -> Result<Self, StateError> {
        let got = bytes.len() as u64;
        let Some((header, _)) = bytes.split_first_chunk::<HEADER>() else {
            return Err(StateError::Length { got, want: HEADER as u64 });
        };
        if header[..MAGIC.len()] != MAGIC {
            return Err(StateError::Foreign);
        }
        let version = u32::from_le_bytes(part(header, 8));
        if version != VERSION {
            return Err(StateError::Version { got: version, want: VERSION });
        }
        let want = u64::from_le_bytes(part(header, CHECKED));
        if got != want {
            return Err(StateError::Length { got, want });
        }
        if u32::from_le_bytes(part(header, 12)) != crc32fast::hash(&bytes[CHECKED..]) {
            return Err(StateError::Checksum);
        }
        Ok(Self { mode: Mode::Check(bytes), at: HEADER, now, host_now: now })
    }

    /// Starts a pass that reads the fields of `bytes`, which passed [`Self::check`]. If the host supplies the time,
    /// `now` is also its current time.
    pub fn load(bytes: &'a [u8], now: u64) -> Self {
        Self { mode: Mode::Load(bytes), at: HEADER, now, host_now: now }
    }

    /// Ends the pass after the last field: returns the length of the state, or its maximum.
    pub fn end(self) -> Result<usize, StateError> {
        let length = self.at;
        match self.mode {
            Mode::Size | Mode::Load(_) => {}
            Mode::Check(bytes) if bytes.len() != length => return Err(StateError::Field("number of bytes")),
            Mode::Check(_) => {}
            Mode::Save(bytes) => {
                bytes[..8].copy_from_slice(&MAGIC);
                bytes[8..12].copy_from_slice(&VERSION.to_le_bytes());
                bytes[CHECKED..HEADER].copy_from_slice(&(length as u64).to_le_bytes());
                let sum = crc32fast::hash(&bytes[CHECKED..length]);
                bytes[12..CHECKED].copy_from_slice(&sum.to_le_bytes());
            }
        }
        Ok(length)
    }

    /// Offset of the first field.
    pub const START: usize = HEADER;

    /// Offset of the next field.
    pub fn at(&self) -> usize {
        self.at
    }

    /// Appends fields that another pass has written.
    pub fn written(&mut self, fields: &[u8]) -> Result<(), StateError> {
        if let Span::Save(bytes) = self.span(fields.len())? {
            bytes.copy_from_slice(fields);
        }
        Ok(())
    }

    /// Current time by the engine's clock, nanoseconds.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Whether effective values are to be stored.
    pub fn loads(&self) -> bool {
        matches!(self.mode, Mode::Load(_))
    }

    /// Returns the next `count` bytes.
    pub fn span(&mut self, count: usize) -> Result<Span<'_>, StateError> {
        let (start, end) = (self.at, self.at + count);
        let short = StateError::Field("number of bytes");
        let span = match &mut self.mode {
            Mode::Size => Span::Size,
            Mode::Save(bytes) => Span::Save(&mut bytes[start..end]),
            Mode::Check(bytes) => Span::Check(bytes.get(start..end).ok_or(short)?),
            Mode::Load(bytes) => Span::Load(&bytes[start..end]),
        };
        self.at = end;
        Ok(span)
    }

    /// Requires a condition on effective values.
    pub fn must(&self, condition: bool, what: &'static str) -> Result<(), StateError> {
        if condition || !matches!(self.mode, Mode::Check(_)) { Ok(()) } else { Err(StateError::Field(what)) }
    }

    /// An unrestricted integer.
    pub fn word(&mut self, present: u64) -> Result<u64, StateError> {
        Ok(u64::from_le_bytes(match self.span(8)? {
            Span::Size => return Ok(present),
            Span::Save(bytes) => {
                bytes.copy_from_slice(&present.to_le_bytes());
                return Ok(present);
            }
            Span::Check(bytes) | Span::Load(bytes) => part(bytes, 0),
        }))
    }

    /// An integer of at most `most`.
    pub fn limited(&mut self, what: &'static str, present: u64, most: u64) -> Result<u64, StateError> {
        let value = self.word(present)?;
        self.must(value <= most, what)?;
        Ok(value)
    }

    /// A field with an integer of at most `most`.
    pub fn number(&mut self, what: &'static str, field: &mut u64, most: u64) -> Result<u64, StateError> {
        let value = self.limited(what, *field, most)?;
        if self.loads() {
            *field = value;
        }
        Ok(value)
    }

    /// A field with a count of at most `most`.
    #[expect(clippy::cast_possible_truncation, reason = "a session's counts fit its memory's words")]
    pub fn length(&mut self, what: &'static str, field: &mut usize, most: u64) -> Result<u64, StateError> {
        let value = self.limited(what, *field as u64, most)?;
        if self.loads() {
            *field = value as usize;
        }
        Ok(value)
    }

    /// A count of at most `most`, of items that follow; in a measuring pass, `most`.
    #[expect(clippy::cast_possible_truncation, reason = "at most as many as there is memory for")]
    pub fn count(&mut self, what: &'static str, present: usize, most: usize) -> Result<usize, StateError> {
        let value = self.limited(what, present as u64, most as u64)? as usize;
        Ok(if matches!(self.mode, Mode::Size) { most } else { value })
    }

    /// Whether an optional item follows; always in a measuring pass.
    pub fn follows(&self, present: bool) -> bool {
        present || matches!(self.mode, Mode::Size)
    }

    /// A flag.
    pub fn flag(&mut self, what: &'static str, present: bool) -> Result<bool, StateError> {
        Ok(self.limited(what, present.into(), 1)? == 1)
    }

    /// A field with a flag.
    pub fn switch(&mut self, what: &'static str, field: &mut bool) -> Result<bool, StateError> {
        let value = self.flag(what, *field)?;
        if self.loads() {
            *field = value;
        }
        Ok(value)
    }

    /// A field with an optional integer.
    pub fn maybe(&mut self, what: &'static str, field: &mut Option<u64>, most: u64) -> Result<Option<u64>, StateError> {
        let there = self.flag(what, field.is_some())?;
        let value = match self.follows(there) {
            true => Some(self.limited(what, field.unwrap_or_default(), most)?),
            false => None,
        };
        if self.loads() {
            *field = value;
        }
        Ok(value)
    }

    /// A time by the engine's clock: written relative to now.
    pub fn moment(&mut self, what: &'static str, present: u64) -> Result<u64, StateError> {
        self.moment_of(self.now, what, present)
    }

    /// A time by the clock of the host's side.
    pub fn host_moment(&mut self, what: &'static str, present: u64) -> Result<u64, StateError> {
        self.moment_of(self.host_now, what, present)
    }

    fn moment_of(&mut self, now: u64, what: &'static str, present: u64) -> Result<u64, StateError> {
        // Times further away are clamped, so that a restored state is saved identically.
        let age = |from: u64, to: u64| to.saturating_sub(from).min(FURTHEST);
        let (before, after) = (age(present, now), age(now, present));
        let before = self.limited(what, before, FURTHEST)?;
        let after = self.limited(what, after, FURTHEST)?;
        self.must(before == 0 || after == 0, what)?;
        Ok((now + after).saturating_sub(before))
    }

    /// A float in the range of session values.
    pub fn float(&mut self, field: &mut f64) -> Result<(), StateError> {
        self.float_within(field, -LARGEST..=LARGEST)
    }

    /// A sum of squares.
    pub fn sum(&mut self, field: &mut f64) -> Result<(), StateError> {
        self.float_within(field, 0.0..=f64::MAX)
    }

    /// A position, metres.
    pub fn place(&mut self, field: &mut f64) -> Result<(), StateError> {
        self.float_within(field, -FARTHEST..=FARTHEST)
    }

    fn float_within(&mut self, field: &mut f64, range: RangeInclusive<f64>) -> Result<(), StateError> {
        let value = f64::from_bits(self.word(field.to_bits())?);
        self.must(range.contains(&value), "numbers")?;
        if self.loads() {
            *field = value;
        }
        Ok(())
    }

    /// The model's fingerprint.
    pub fn model(&mut self, fingerprint: u64) -> Result<(), StateError> {
        let got = self.word(fingerprint)?;
        match self.mode {
            Mode::Check(_) if got != fingerprint => Err(StateError::Model),
            _ => Ok(()),
        }
    }

    /// A setting that must be equal in the state.
    pub fn same(&mut self, what: &'static str, want: u64) -> Result<(), StateError> {
        let got = self.word(want)?;
        match self.mode {
            Mode::Check(_) if got != want => Err(StateError::Config { what, got, want }),
            _ => Ok(()),
        }
    }

    /// Floats in the range of session values.
    pub fn f32s(&mut self, values: &mut [f32]) -> Result<(), StateError> {
        self.slice(values, f32::to_le_bytes, f32::from_le_bytes, is_sample, "numbers")
    }

    /// A share from 0 to 1.
    pub fn share(&mut self, value: &mut f32) -> Result<(), StateError> {
        self.within(value, 0.0..=1.0)
    }

    /// A float in a range.
    pub fn within(&mut self, value: &mut f32, range: RangeInclusive<f32>) -> Result<(), StateError> {
        let values = std::slice::from_mut(value);
        self.slice(values, f32::to_le_bytes, f32::from_le_bytes, |value| range.contains(&value), "shares")
    }

    /// Angles, speeds, seconds, levels or face values.
    pub fn moderate(&mut self, values: &mut [f32]) -> Result<(), StateError> {
        self.slice(values, f32::to_le_bytes, f32::from_le_bytes, is_moderate, "numbers")
    }

    /// Positions, metres.
    pub fn places(&mut self, values: &mut [f32]) -> Result<(), StateError> {
        self.slice(values, f32::to_le_bytes, f32::from_le_bytes, is_near, "places")
    }

    /// Rotations: unit quaternions.
    pub fn rotations(&mut self, values: &mut [[f32; 4]]) -> Result<(), StateError> {
        let to = |q: [f32; 4]| {
            let mut bytes = [0; 16];
            bytes.as_chunks_mut().0.iter_mut().zip(q).for_each(|(bytes, value)| *bytes = value.to_le_bytes());
            bytes
        };
        let from = |bytes: [u8; 16]| std::array::from_fn(|i| f32::from_le_bytes(part(&bytes, 4 * i)));
        self.slice(values, to, from, is_unit, "rotations")
    }

    /// Floats in the range of session values.
    pub fn f64s(&mut self, values: &mut [f64]) -> Result<(), StateError> {
        self.slice(values, f64::to_le_bytes, f64::from_le_bytes, |value| value.abs() <= LARGEST, "numbers")
    }

    /// Unrestricted ids.
    pub fn ids(&mut self, values: &mut [u32]) -> Result<(), StateError> {
        self.slice(values, u32::to_le_bytes, u32::from_le_bytes, |_| true, "ids")
    }

    /// Motion codes below `limit`.
    pub fn codes(&mut self, values: &mut [u16], limit: usize) -> Result<(), StateError> {
        self.slice(values, u16::to_le_bytes, u16::from_le_bytes, |code| usize::from(code) < limit, "motion codes")
    }

    fn slice<T: Copy, const N: usize>(
        &mut self,
        values: &mut [T],
        to: impl Fn(T) -> [u8; N],
        from: impl Fn([u8; N]) -> T,
        is_good: impl Fn(T) -> bool,
        what: &'static str,
    ) -> Result<(), StateError> {
        match self.span(values.len() * N)? {
            Span::Size => {}
            Span::Save(bytes) => {
                bytes.as_chunks_mut().0.iter_mut().zip(values).for_each(|(bytes, &mut value)| *bytes = to(value));
            }
            Span::Check(bytes) => {
                if !bytes.as_chunks().0.iter().all(|&bytes| is_good(from(bytes))) {
                    return Err(StateError::Field(what));
                }
            }
            Span::Load(bytes) => {
                values.iter_mut().zip(bytes.as_chunks().0).for_each(|(value, &bytes)| *value = from(bytes));
            }
        }
        Ok(())
    }
}

/// Whether a sample is in the range of session values.
pub fn is_sample(value: f32) -> bool {
    f64::from(value).abs() <= LARGEST
}

/// Whether an angle, a speed, a time, a level or a face value is in range.
pub fn is_moderate(value: f32) -> bool {
    value.abs() <= MOST
}

/// Whether a position is in range.
pub fn is_near(value: f32) -> bool {
    f64::from(value).abs() <= FARTHEST
}

/// Whether a quaternion is a rotation.
pub fn is_unit(q: [f32; 4]) -> bool {
    (q.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-2
}

/// Reads `N` bytes at `at`; the caller has checked the length.
fn part<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    *bytes[at..].first_chunk().expect("the caller's lengths")
}

/// Hash that identifies models and names: 64-bit FNV-1a.
#[derive(Clone, Copy, Debug)]
pub struct Fingerprint(pub u64);

impl Default for Fingerprint {
    fn default() -> Self {
        Self::new()
    }
}

impl Fingerprint {
    /// Fingerprint of no bytes.
    pub const fn new() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }

    /// Adds bytes and their number.
    pub fn add(&mut self, bytes: &[u8]) {
        self.extend(bytes);
        self.extend(&(bytes.len() as u64).to_le_bytes());
    }

    fn extend(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
}

/// Adds written bytes, without their number.
impl std::io::Write for Fingerprint {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
