//! Matrix views with checked shapes: every row of a view is inside its slice.

use crate::error::ShapeError;
use core::marker::PhantomData;
use core::ops::Range;
use core::ptr::NonNull;

/// A read-only matrix, `[rows, cols]`, row-major with any row stride.
///
/// Rows may overlap (`stride < cols`): a convolution's windows are the rows of such a view.
#[derive(Clone, Copy, Debug)]
pub struct Mat<'a, T> {
    data: &'a [T],
    rows: usize,
    cols: usize,
    stride: usize,
}

impl<'a, T> Mat<'a, T> {
    /// A dense view: `data` is `[rows, cols]`.
    ///
    /// # Errors
    /// [`ShapeError`] if `data` is shorter than `rows * cols`.
    pub fn new(data: &'a [T], rows: usize, cols: usize) -> Result<Self, ShapeError> {
        Self::with_stride(data, rows, cols, cols)
    }

    /// A view whose row `i` starts at `data[i * stride]`; rows may overlap.
    ///
    /// # Errors
    /// [`ShapeError`] if the last row ends beyond `data`.
    pub fn with_stride(data: &'a [T], rows: usize, cols: usize, stride: usize) -> Result<Self, ShapeError> {
        let want = extent(rows, cols, stride);
        if data.len() < want {
            return Err(ShapeError { arg: "data", want, got: data.len() });
        }
        // An empty matrix has no extent, whatever its stride.
        Ok(Self { data, rows, cols, stride: if cols == 0 { 0 } else { stride } })
    }

    /// Number of rows.
    #[inline]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    #[inline]
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Distance from one row's start to the next, in elements.
    #[inline]
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Row `i`, of `cols` elements. Panics if `i >= rows`.
    #[inline]
    pub fn row(&self, i: usize) -> &'a [T] {
        assert!(i < self.rows, "row {i} of {}", self.rows);
        &self.data[i * self.stride..i * self.stride + self.cols]
    }

    /// The elements from `N * chunk` on of row `i`. Panics if they are not all in the row.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    #[inline]
    pub(crate) fn chunk<const N: usize>(&self, i: usize, chunk: usize) -> &'a [T; N] {
        assert!(i < self.rows && chunk < self.cols / N);
        // SAFETY: every row is inside `data`, as the constructor checked, and the chunk
        // inside its row.
        let start = unsafe { self.data.as_ptr().add(i * self.stride + chunk * N) };
        // SAFETY: these are `N` elements of `data`, and an array has the alignment of its elements.
        unsafe { &*start.cast() }
    }

    /// All elements from the first to the last, including gaps between rows.
    #[inline]
    pub fn elements(&self) -> &'a [T] {
        &self.data[..extent(self.rows, self.cols, self.stride)]
    }

    /// The columns `range` of every row. Panics if `range` ends beyond `cols`.
    #[inline]
    pub fn columns(&self, range: Range<usize>) -> Mat<'a, T> {
        assert!(range.start <= range.end && range.end <= self.cols, "columns {range:?} of {}", self.cols);
        let data = if self.rows == 0 { self.data } else { &self.data[range.start..] };
        Mat { data, rows: self.rows, cols: range.end - range.start, stride: self.stride }
    }

    /// The rows `range`. Panics if `range` ends beyond `rows`.
    #[inline]
    pub fn row_range(&self, range: Range<usize>) -> Mat<'a, T> {
        assert!(range.start <= range.end && range.end <= self.rows, "rows {range:?} of {}", self.rows);
        let start = if range.is_empty() { 0 } else { range.start * self.stride };
        Mat { data: &self.data[start..], rows: range.end - range.start, cols: self.cols, stride: self.stride }
    }
}

/// A writable matrix, `[rows, cols]`, row-major; `stride >= cols`, so that no two rows share an
/// element.
///
/// It can be split into disjoint pieces by rows or by columns, each of which can be sent to
/// another thread.
#[derive(Debug)]
pub struct MatMut<'a, T> {
    start: NonNull<T>,
    rows: usize,
    cols: usize,
    stride: usize,
    borrow: PhantomData<&'a mut [T]>,
}

// SAFETY: a `MatMut` is the only access to its elements while it lives, like `&mut [T]`.
unsafe impl<T: Send> Send for MatMut<'_, T> {}
// SAFETY: a shared `MatMut` only gives out `&[T]`, like `&&mut [T]`.
unsafe impl<T: Sync> Sync for MatMut<'_, T> {}

impl<'a, T> MatMut<'a, T> {
    /// A dense view: `data` is `[rows, cols]`.
    ///
    /// # Errors
    /// [`ShapeError`] if `data` is shorter than `rows * cols`.
    pub fn new(data: &'a mut [T], rows: usize, cols: usize) -> Result<Self, ShapeError> {
        Self::with_stride(data, rows, cols, cols)
    }

    /// A view whose row `i` starts at `data[i * stride]`.
    ///
    /// # Errors
    /// [`ShapeError`] if `stride < cols`, or the last row would end beyond `data`.
    pub fn with_stride(data: &'a mut [T], rows: usize, cols: usize, stride: usize) -> Result<Self, ShapeError> {
        if stride < cols {
            return Err(ShapeError { arg: "stride", want: cols, got: stride });
        }
        let want = extent(rows, cols, stride);
        if data.len() < want {
            return Err(ShapeError { arg: "data", want, got: data.len() });
        }
        Ok(Self { start: NonNull::from(data).cast(), rows, cols, stride, borrow: PhantomData })
    }

    /// Number of rows.
    #[inline]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    #[inline]
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Distance from one row's start to the next, in elements.
    #[inline]
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Row `i`. Panics if `i >= rows`.
    #[inline]
    pub fn row(&self, i: usize) -> &[T] {
        assert!(i < self.rows, "row {i} of {}", self.rows);
        // SAFETY: `i < rows`, and the constructor checked that every row is inside the
        // borrowed slice.
        let start = unsafe { self.start.add(i * self.stride) };
        // SAFETY: `cols` elements from there are inside the slice, initialised, and borrowed by
        // `self`.
        unsafe { core::slice::from_raw_parts(start.as_ptr(), self.cols) }
    }

    /// Row `i`, writable. Panics if `i >= rows`.
    #[inline]
    pub fn row_mut(&mut self, i: usize) -> &mut [T] {
        assert!(i < self.rows, "row {i} of {}", self.rows);
        // SAFETY: `i < rows`, and the constructor checked that every row is inside the
        // borrowed slice.
        let start = unsafe { self.start.add(i * self.stride) };
        // SAFETY: `cols` elements from there are inside the slice and no other live reference
        // reaches them: `self` is borrowed exclusively, and pieces cut from one view are disjoint.
        unsafe { core::slice::from_raw_parts_mut(start.as_ptr(), self.cols) }
    }

    /// The same rows, read-only. Panics if there are gaps between them, which do not belong
    /// to this view.
    #[inline]
    pub fn dense(&self) -> Mat<'_, T> {
        assert!(self.cols == self.stride || self.rows <= 1, "{} columns at stride {}", self.cols, self.stride);
        // SAFETY: the constructor checked that `rows` rows lie inside the slice; without gaps all
        // elements up to the end of the last row are this view's, which is borrowed.
        let data = unsafe { core::slice::from_raw_parts(self.start.as_ptr(), self.rows * self.cols) };
        Mat { data, rows: self.rows, cols: self.cols, stride: self.cols }
    }

    /// All elements of a contiguous matrix of one column. Panics if it has several columns
    /// or a stride.
    #[inline]
    pub fn column_mut(&mut self) -> &mut [T] {
        assert!(self.cols == 1 && self.stride == 1, "{} columns at stride {}", self.cols, self.stride);
        // SAFETY: the constructor checked that `rows` elements lie inside the slice, one after the
        // other, and `self` is borrowed exclusively.
        unsafe { core::slice::from_raw_parts_mut(self.start.as_ptr(), self.rows) }
    }

    /// The same view with a shorter lifetime.
    #[inline]
    pub fn reborrow(&mut self) -> MatMut<'_, T> {
        MatMut { start: self.start, rows: self.rows, cols: self.cols, stride: self.stride, borrow: PhantomData }
    }

    /// Splits into the rows before `at` and those from `at` on. Panics if `at > rows`.
    #[inline]
    pub fn split_rows(self, at: usize) -> (MatMut<'a, T>, MatMut<'a, T>) {
        assert!(at <= self.rows, "row {at} of {}", self.rows);
        let offset = if at == self.rows { 0 } else { at * self.stride };
        // SAFETY: `offset` is the start of a row of the slice, or 0.
        let below = unsafe { self.start.add(offset) };
        let piece = |start, rows| MatMut { start, rows, cols: self.cols, stride: self.stride, borrow: PhantomData };
        (piece(self.start, at), piece(below, self.rows - at))
    }

    /// Splits into the columns before `at` and those from `at` on. Panics if `at > cols`.
    #[inline]
    pub fn split_columns(self, at: usize) -> (MatMut<'a, T>, MatMut<'a, T>) {
        assert!(at <= self.cols, "column {at} of {}", self.cols);
        let offset = if self.rows == 0 { 0 } else { at };
        // SAFETY: `offset <= cols`, inside the first row or one past its end.
        let right = unsafe { self.start.add(offset) };
        let piece = |start, cols| MatMut { start, rows: self.rows, cols, stride: self.stride, borrow: PhantomData };
        (piece(self.start, at), piece(right, self.cols - at))
    }
}

/// Number of elements from the first of row 0 to the last of the last row; saturates, so that absurd
/// shapes fail the check.
#[inline]
fn extent(rows: usize, cols: usize, stride: usize) -> usize {
    if rows == 0 || cols == 0 { 0 } else { (rows - 1).saturating_mul(stride).saturating_add(cols) }
}
