//! Seeded inputs with any alignment and stride, and outputs that detect writes outside of them.

use std::fmt::Debug;

use umo_kernels::{Mat, MatMut};

/// Number of canary elements on each side of a [`Guarded`] buffer.
pub const GUARD: usize = 64;

/// A small generator (SplitMix64): proptest shrinks its seed and the sizes, not thousands of individual values.
#[derive(Clone, Debug)]
pub struct Noise(u64);

impl Noise {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ (bits >> 31)
    }

    /// A number below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        usize::try_from(self.bits() % end as u64).expect("a remainder of a usize fits one")
    }

    /// An arbitrary int8.
    pub fn code(&mut self) -> i8 {
        self.bits().to_le_bytes()[0].cast_signed()
    }

    /// A number in `-size..size`.
    pub fn float(&mut self, size: f32) -> f32 {
        let unit = u32::try_from(self.bits() >> 40).expect("24 bits") as f32 / 8_388_608.0;
        (unit - 1.0) * size
    }

    /// An integer in `-size..=size` as a float.
    pub fn integer(&mut self, size: i16) -> f32 {
        let count = 2 * usize::from(size.unsigned_abs()) + 1;
        f32::from(i16::try_from(self.below(count)).expect("small") - size)
    }
}

/// Size of a cache line in bytes.
pub const LINE: usize = 64;

/// A row-major input with any stride. Its first element is `offset` elements after the start of a cache line. Its
/// last element is the last of the allocation, so an out-of-bounds read leaves the heap block.
#[derive(Debug)]
pub struct Placed<T> {
    data: Vec<T>,
    start: usize,
    offset: usize,
    rows: usize,
    cols: usize,
    stride: usize,
}

impl<T: Copy + Default> Placed<T> {
    /// `[rows, cols]` of values from `next`, with rows `cols + gap` apart; the gaps are filled from `next`, too.
    pub fn new(rows: usize, cols: usize, gap: usize, offset: usize, mut next: impl FnMut() -> T) -> Self {
        let stride = cols + gap;
        let len = if rows == 0 { 0 } else { (rows - 1) * stride + cols };
        let (mut data, start) = allocate(offset, len);
        data.resize(start, T::default());
        data.extend((0..len).map(|_| next()));
        Self { data, start, offset, rows, cols, stride }
    }

    /// A single row of these values.
    pub fn copy_of(values: &[T], offset: usize) -> Self {
        let mut values = values.iter();
        Self::new(1, values.len(), 0, offset, || *values.next().expect("as many as there are"))
    }

    /// The matrix.
    pub fn mat(&self) -> Mat<'_, T> {
        Mat::with_stride(&self.data[self.start..], self.rows, self.cols, self.stride).expect("sized by new")
    }

    /// All elements, including the gaps between rows.
    pub fn elements(&self) -> &[T] {
        &self.data[self.start..]
    }

    /// The row of a one-row input.
    pub fn row(&self) -> &[T] {
        if self.rows == 0 { &[] } else { self.mat().row(0) }
    }
}

impl<T: Copy + Default> Clone for Placed<T> {
    fn clone(&self) -> Self {
        let mut elements = self.elements().iter();
        let next = || *elements.next().expect("as many as there are");
        Self::new(self.rows, self.cols, self.stride - self.cols, self.offset, next)
    }
}

/// Returns an empty vector and the index at which to start in it, `offset` elements after a cache line's start, so
/// that `len` elements end with the allocation. The address of an allocation is not known beforehand, so the function
/// assumes that the next one of this size gets the same address, and retries. If that never holds, some space remains
/// at the end.
fn allocate<T>(offset: usize, len: usize) -> (Vec<T>, usize) {
    let (mut tried, mut front) = (vec![], 0);
    for _ in 0..16 {
        let data: Vec<T> = Vec::with_capacity(front + offset + len);
        let found = data.as_ptr().align_offset(LINE);
        if found == front {
            return (data, front + offset);
        }
        front = found;
        tried.push(data);
    }
    let data: Vec<T> = Vec::with_capacity(LINE / size_of::<T>() + offset + len);
    let start = data.as_ptr().align_offset(LINE) + offset;
    (data, start)
}

/// A type with a value that no kernel writes by accident.
pub trait Canary: Copy + PartialEq + Debug {
    /// The canary value.
    const CANARY: Self;
}

impl Canary for f32 {
    const CANARY: Self = -6.660_123e33;
}
impl Canary for f64 {
    const CANARY: Self = -6.660_123_456_789e233;
}
impl Canary for i8 {
    const CANARY: Self = -91;
}
impl Canary for u32 {
    const CANARY: Self = 0xdead_beef;
}

/// An output matrix with [`GUARD`] canaries on each side and in the gaps between rows.
#[derive(Clone, Debug)]
pub struct Guarded<T> {
    data: Vec<T>,
    offset: usize,
    rows: usize,
    cols: usize,
    stride: usize,
}

impl<T: Canary> Guarded<T> {
    /// `[rows, cols]`, with rows `cols + gap` apart, filled with canaries. It starts `offset` elements after the
    /// first guard.
    pub fn new(rows: usize, cols: usize, gap: usize, offset: usize) -> Self {
        let stride = cols + gap;
        Self { data: vec![T::CANARY; GUARD + offset + rows * stride + GUARD], offset, rows, cols, stride }
    }

    /// Like [`new`](Self::new), with `value` in all rows, for operations that accumulate.
    pub fn filled(rows: usize, cols: usize, gap: usize, offset: usize, value: T) -> Self {
        let mut filled = Self::new(rows, cols, gap, offset);
        for t in 0..rows {
            filled.mat().row_mut(t).fill(value);
        }
        filled
    }

    /// A single row of `len` elements.
    pub fn slice(len: usize, offset: usize) -> Self {
        Self::new(1, len, 0, offset)
    }

    /// Like [`new`](Self::new), with the values of `from`, for in-place operations.
    pub fn copy_of(from: Mat<T>, gap: usize, offset: usize) -> Self {
        let mut copy = Self::new(from.rows(), from.cols(), gap, offset);
        for t in 0..from.rows() {
            copy.mat().row_mut(t).copy_from_slice(from.row(t));
        }
        copy
    }

    /// The matrix, mutable.
    pub fn mat(&mut self) -> MatMut<'_, T> {
        let data = &mut self.data[GUARD + self.offset..];
        MatMut::with_stride(data, self.rows, self.cols, self.stride).expect("sized by new")
    }

    /// Row 0, mutable.
    pub fn first_row(&mut self) -> &mut [T] {
        &mut self.data[GUARD + self.offset..][..self.cols]
    }

    /// Row `t`.
    pub fn row(&self, t: usize) -> &[T] {
        &self.data[GUARD + self.offset + t * self.stride..][..self.cols]
    }

    /// Returns all rows, after checking that every canary is intact.
    pub fn checked(&self) -> Vec<Vec<T>> {
        let start = GUARD + self.offset;
        for (i, value) in self.data.iter().enumerate() {
            let inside =
                i >= start && i < start + self.rows * self.stride && (i - start) % self.stride.max(1) < self.cols;
            assert!(
                inside || *value == T::CANARY,
                "a write outside the output, at element {} of it",
                i.wrapping_sub(start)
            );
        }
        (0..self.rows).map(|t| self.row(t).to_vec()).collect()
    }
}

/// The bits of all values: `-0.0` and `0.0` differ, and NaN equals itself.
pub fn bits(rows: &[Vec<f32>]) -> Vec<Vec<u32>> {
    rows.iter().map(|row| row.iter().map(|value| value.to_bits()).collect()).collect()
}
