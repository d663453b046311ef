//! Fields out of bytes, in order.

use umo_core_base::state::is_sample;

use super::TakeError;

/// Longest text of a take, bytes.
pub(super) const MAX_TEXT: usize = u16::MAX as usize;

/// Reads little-endian fields.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// A reader that begins at `at`.
    pub(super) fn from(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    /// Position of the next field.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    pub(super) fn is_at_end(&self) -> bool {
        self.at >= self.bytes.len()
    }

    pub(super) fn bytes(&mut self, count: usize) -> Result<&'a [u8], TakeError> {
        let bytes = self.bytes.get(self.at..).and_then(|rest| rest.get(..count));
        let bytes = bytes.ok_or(TakeError::Field("end"))?;
        self.at += count;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], TakeError> {
        self.bytes(N)?.try_into().map_err(|_| TakeError::Field(what))
    }

    pub(super) fn u8(&mut self, what: &'static str) -> Result<u8, TakeError> {
        self.array::<1>(what).map(|[byte]| byte)
    }

    pub(super) fn u16(&mut self, what: &'static str) -> Result<u16, TakeError> {
        self.array(what).map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self, what: &'static str) -> Result<u32, TakeError> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self, what: &'static str) -> Result<u64, TakeError> {
        self.array(what).map(u64::from_le_bytes)
    }

    /// A count or a size, of four bytes.
    pub(super) fn small(&mut self, what: &'static str) -> Result<usize, TakeError> {
        usize::try_from(self.u32(what)?).ok().filter(|&value| value <= 1 << 20).ok_or(TakeError::Field(what))
    }

    /// A finite number.
    pub(super) fn f32(&mut self, what: &'static str) -> Result<f32, TakeError> {
        let value = self.array(what).map(f32::from_le_bytes)?;
        if is_sample(value) { Ok(value) } else { Err(TakeError::Field(what)) }
    }

    /// A finite number.
    pub(super) fn f64(&mut self, what: &'static str) -> Result<f64, TakeError> {
        let value = self.array(what).map(f64::from_le_bytes)?;
        if value.is_finite() { Ok(value) } else { Err(TakeError::Field(what)) }
    }

    pub(super) fn within(&mut self, what: &'static str, from: f32, to: f32) -> Result<f32, TakeError> {
        let value = self.f32(what)?;
        if (from..=to).contains(&value) { Ok(value) } else { Err(TakeError::Field(what)) }
    }

    /// A number from 0 to 1.
    pub(super) fn share(&mut self, what: &'static str) -> Result<f32, TakeError> {
        self.within(what, 0.0, 1.0)
    }

    /// One of `all`, by its number.
    pub(super) fn one<T: Copy>(&mut self, what: &'static str, all: &[T]) -> Result<T, TakeError> {
        all.get(usize::from(self.u8(what)?)).copied().ok_or(TakeError::Field(what))
    }

    /// A text after its length.
    pub(super) fn text(&mut self, what: &'static str) -> Result<&'a str, TakeError> {
        let count = usize::from(self.u16(what)?);
        std::str::from_utf8(self.bytes(count)?).map_err(|_| TakeError::Field(what))
    }

    /// Items after their number, as bytes.
    pub(super) fn items<const N: usize>(&mut self) -> Result<&'a [[u8; N]], TakeError> {
        let count = usize::from(self.u16("number of items")?);
        Ok(self.bytes(N * count)?.as_chunks().0)
    }

    /// Items after their number.
    pub(super) fn list<T, const N: usize>(
        &mut self,
        what: &'static str,
        from: impl Fn([u8; N]) -> T,
    ) -> Result<Vec<T>, TakeError> {
        let items = self.items().map_err(|_| TakeError::Field(what))?;
        Ok(items.iter().map(|&bytes| from(bytes)).collect())
    }
}
