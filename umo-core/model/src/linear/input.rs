//! Prepared inputs of products, and scratch space for them: quantized rows, and bf16 values.

use std::ops::Range;

use umo_core_base::aligned::AlignedBox;
use umo_core_base::error::StepError;
use umo_core_base::memory::filled;
use umo_core_base::team::{MAX_PIECES, zip_split};
use umo_kernels::bf16::round_bf16;
use umo_kernels::matmul_bf16::{Bf16Rows, split_bf16x2};
use umo_kernels::product::{Bf16Form, Rows};
use umo_kernels::quantize::{QuantRows, quantization_scale, quantize_columns, quantize_rows, row_maxima};
use umo_kernels::{Bf16, Isa, Mat, MatMut, ShapeError};

use super::{Compute, Linear};

/// Activations for bf16 products.
#[derive(Clone, Copy, Debug)]
pub struct Bf16Values<'a> {
    /// Rounded values, or their high parts.
    high: &'a [Bf16],
    /// Low parts, if split.
    low: Option<&'a [Bf16]>,
}

impl<'a> Bf16Values<'a> {
    /// `rows` rows of `cols` values, `stride` apart, starting at the value `start`.
    ///
    /// # Errors
    /// [`ShapeError`] if there are fewer values.
    pub fn rows(&self, start: usize, rows: usize, cols: usize, stride: usize) -> Result<Rows<'a>, ShapeError> {
        let part = |part: &'a [Bf16]| Mat::with_stride(&part[start.min(part.len())..], rows, cols, stride);
        let high = part(self.high)?;
        Ok(Rows::Bf16(match self.low {
            Some(low) => Bf16Rows::split(high, part(low)?)?,
            None => Bf16Rows::rounded(high),
        }))
    }
}

/// Scratch space for quantized activations, `[rows, inputs]` at most. Rows that fill whole cache lines are an odd
/// number of lines apart: with an even number, the 16 rows of a tile would fall into few sets of L1.
#[derive(Debug)]
pub struct QuantScratch {
    codes: AlignedBox<i8>,
    scale: Box<[f32]>,
    /// bf16 values: rounded or high parts, and low parts. May be empty.
    parts: [AlignedBox<Bf16>; 2],
    /// Largest magnitude in each row, `[pieces, rows]`. May be empty.
    largest: AlignedBox<f32>,
}

/// A cache line.
const LINE: usize = 64;

/// Distance between rows of `width` quantized values.
fn stride(width: usize) -> usize {
    if width.is_multiple_of(2 * LINE) { width + LINE } else { width }
}

/// Rows that are quantized as soon as they are computed, while they are in L1; the next ones reuse their space.
const ROWS_IN_L1: usize = 8;

/// Approximate cost of quantizing one value, in multiply-adds.
const QUANTIZE_WORK: usize = 4;

/// A thread's columns of rows that become the input of the next product.
#[derive(Debug)]
pub struct Columns<'a> {
    /// `[rows, columns]`.
    pub y: MatMut<'a, f32>,
    /// Scratch space of the thread, with the number of values per column that [`QuantScratch::computed`] was given.
    pub room: &'a mut [f32],
    /// Largest magnitude in each row, if rows are quantized.
    largest: Option<&'a mut [f32]>,
    isa: Isa,
}

impl Columns<'_> {
    /// Marks the rows `rows` as complete; best called while they are in cache.
    ///
    /// # Errors
    /// [`StepError`] if the rows do not exist.
    pub fn complete(&mut self, rows: Range<usize>) -> Result<(), StepError> {
        if let Some(largest) = &mut self.largest {
            let (_, y) = self.y.reborrow().split_rows(rows.start);
            row_maxima(self.isa, &y.split_rows(rows.len()).0, &mut largest[rows])?;
        }
        Ok(())
    }
}

impl QuantScratch {
    /// Scratch space for at most `rows` rows and `values` values in all.
    pub fn with_values(rows: usize, values: usize) -> Self {
        let parts = [(); 2].map(|()| AlignedBox::zeroed(0));
        let (codes, scale) = (AlignedBox::zeroed(values + rows * LINE), filled(0.0, rows).into());
        Self { codes, scale, parts, largest: AlignedBox::zeroed(0) }
    }

    /// Adds the space that [`Self::computed`] needs.
    #[must_use]
    pub fn with_maxima(self) -> Self {
        Self { largest: AlignedBox::zeroed(MAX_PIECES * self.scale.len()), ..self }
    }

    /// Returns again the rows of `values` that were last prepared for `next`: for a product that is computed in
    /// pieces.
    ///
    /// # Errors
    /// [`StepError`] if there are fewer rows.
    pub fn again<'a>(&'a self, next: &Linear, values: &'a [f32], rows: usize) -> Result<Rows<'a>, StepError> {
        match next.is_quantized() {
            true => self.quantized(rows, next.inputs()),
            false => Ok(Rows::float(Mat::new(values, rows, next.inputs())?)),
        }
    }

    /// Calls `f` for each thread's columns of `values [rows, width]`, a multiple of `granule`, and prepares the rows
    /// for `next`. The thread that computed rows quantizes them, while they are in its cache: data written by another
    /// thread arrives more slowly than from memory. `f` must mark all rows as [`Columns::complete`]; `work` is the
    /// number of its multiply-adds. The second part of `room` is the number of scratch values per column.
    ///
    /// # Errors
    /// [`StepError`] if the scratch space is too small, or as returned by `f`.
    #[expect(clippy::too_many_arguments, reason = "one phase of a layer, each operand named")]
    pub fn computed<'a>(
        &'a mut self,
        cx: Compute,
        next: &Linear,
        (values, rows): (&'a mut [f32], usize),
        granule: usize,
        work: usize,
        (room, each): (&mut [f32], usize),
        f: impl Fn(Range<usize>, &mut Columns) -> Result<(), StepError> + Sync,
    ) -> Result<Rows<'a>, StepError> {
        let (width, pieces) = (next.inputs(), cx.team.pieces());
        let mut y = MatMut::new(values, rows, width)?;
        if room.len() < width * each {
            return Err(ShapeError { arg: "room", want: width * each, got: room.len() }.into());
        }
        let largest = if next.is_quantized() {
            let want = rows * stride(width);
            if self.largest.len() < pieces * rows || self.scale.len() < rows || self.codes.len() < want {
                return Err(ShapeError { arg: "quant", want, got: self.codes.len() }.into());
            }
            self.largest[..pieces * rows].fill(0.0);
            MatMut::new(&mut self.largest, pieces, rows)?
        } else {
            MatMut::new(&mut [], 0, rows)?
        };
        // Each piece has a row of `largest`, if that is not empty.
        fn row(largest: MatMut<'_, f32>, _: usize) -> (MatMut<'_, f32>, MatMut<'_, f32>) {
            let mine = largest.rows().min(1);
            largest.split_rows(mine)
        }
        let cut = zip_split(MatMut::split_columns, zip_split(row, |room, at| <[f32]>::split_at_mut(room, at * each)));
        cx.team.split(
            (y.reborrow(), (largest, room)),
            width,
            granule,
            work,
            cut,
            |range, (y, (mut largest, room))| {
                let largest = (largest.rows() > 0).then(|| largest.row_mut(0));
                f(range, &mut Columns { y, room, largest, isa: cx.isa })
            },
        )?;
        if !next.is_quantized() {
            return Ok(Rows::float(Mat::new(values, rows, width)?));
        }
        let (largest, others) = self.largest[..pieces * rows].split_at_mut(rows);
        for (t, largest) in largest.iter_mut().enumerate() {
            *largest = others.iter().skip(t).step_by(rows).fold(*largest, |largest, &other| largest.max(other));
            self.scale[t] = quantization_scale(*largest);
        }
        let (codes, largest) = (MatMut::with_stride(&mut self.codes, rows, width, stride(width))?, &*largest);
        let cut = zip_split(MatMut::split_columns, MatMut::split_columns);
        cx.team.split((y, codes), width, granule, rows * width * QUANTIZE_WORK, cut, |_, (y, codes)| {
            Ok(quantize_columns(cx.isa, &y, largest, codes)?)
        })?;
        self.quantized(rows, width)
    }

    /// Calls `f` for rows of `values`, which are as wide as `next`'s input, and of `also`, and prepares them for
    /// `next`. Each thread computes a few of its rows at a time; if they are quantized, these reuse the same space in
    /// `values`. `work` is the number of `f`'s multiply-adds for all rows.
    ///
    /// # Errors
    /// [`StepError`] if the scratch space is too small, or as returned by `f`.
    pub fn computed_rows<'a>(
        &'a mut self,
        cx: Compute,
        next: &Linear,
        values: &'a mut [f32],
        also: MatMut<f32>,
        work: usize,
        f: impl Fn(Range<usize>, MatMut<f32>, MatMut<f32>) -> Result<(), StepError> + Sync,
    ) -> Result<Rows<'a>, StepError> {
        let (rows, width) = (also.rows(), next.inputs());
        let mut y = MatMut::new(values, rows, width)?;
        if !next.is_quantized() {
            cx.team.rows_of_two(y, also, work, f)?;
            return Ok(Rows::float(Mat::new(values, rows, width)?));
        }
        let (codes, scale) = self.room(rows, width)?;
        let cut = zip_split(
            zip_split(MatMut::split_rows, MatMut::split_rows),
            zip_split(MatMut::split_rows, MatMut::split_rows),
        );
        let work = work + rows * width * QUANTIZE_WORK;
        let all = ((y.reborrow(), also), (codes, scale));
        cx.team.split(all, rows, 1, work, cut, |range, ((mut y, mut also), (mut codes, mut scale))| {
            for first in range.clone().step_by(ROWS_IN_L1) {
                let now = first..(first + ROWS_IN_L1).min(range.end);
                let (now_also, rest_also) = also.split_rows(now.len());
                let (now_codes, rest_codes) = codes.split_rows(now.len());
                let (mut now_scale, rest_scale) = scale.split_rows(now.len());
                (also, codes, scale) = (rest_also, rest_codes, rest_scale);
                let (mut y, _) = y.reborrow().split_rows(now.len());
                f(now, y.reborrow(), now_also)?;
                quantize_rows(cx.isa, y.dense(), now_codes.split_columns(width).0, now_scale.column_mut())?;
            }
            Ok(())
        })?;
        self.quantized(rows, width)
    }

    /// Quantizes the rows of `x`.
    ///
    /// # Errors
    /// [`StepError`] if the scratch space is too small.
    pub(super) fn quantize(&mut self, cx: Compute, x: Mat<f32>) -> Result<Rows<'_>, StepError> {
        let (rows, width) = (x.rows(), x.cols());
        let (codes, scale) = self.room(rows, width)?;
        cx.team.rows_of_two(codes, scale, rows * width * QUANTIZE_WORK, |range, codes, mut scale| {
            Ok(quantize_rows(cx.isa, x.row_range(range), codes.split_columns(width).0, scale.column_mut())?)
        })?;
        self.quantized(rows, width)
    }

    /// Calls `f` for rows of `x`, quantized, and the same rows of `y`. Each thread quantizes its own rows, so they
    /// are in its cache. `work` is the number of `f`'s multiply-adds for all rows.
    ///
    /// # Errors
    /// [`StepError`] if the scratch space is too small, or as returned by `f`.
    pub(super) fn quantized_rows(
        &mut self,
        cx: Compute,
        x: Mat<f32>,
        y: MatMut<f32>,
        work: usize,
        f: impl Fn(Rows, MatMut<f32>) -> Result<(), StepError> + Sync,
    ) -> Result<(), StepError> {
        let (rows, width) = (x.rows(), x.cols());
        let (codes, scale) = self.room(rows, width)?;
        let cut = zip_split(zip_split(MatMut::split_rows, MatMut::split_rows), MatMut::split_rows);
        let work = work + rows * width * QUANTIZE_WORK;
        cx.team.split(((codes, scale), y), rows, 1, work, cut, |range, ((mut codes, mut scale), y)| {
            let (scale, values) = (scale.column_mut(), codes.reborrow().split_columns(width).0);
            quantize_rows(cx.isa, x.row_range(range), values, scale)?;
            f(Rows::quantized(QuantRows::new(codes.dense().columns(0..width), scale)?), y)
        })
    }

    /// Converts `values` to bf16, once for all threads and all rows that share a value.
    ///
    /// # Errors
    /// [`StepError`] if the scratch space is too small.
    pub fn to_bf16(&mut self, cx: Compute, form: Bf16Form, values: &[f32]) -> Result<Bf16Values<'_>, StepError> {
        let [high, low] = &mut self.parts;
        let len = values.len();
        // One value per row, so that threads share them in any proportion.
        let rows = MatMut::new(high, len, 1)?;
        let low = match form {
            Bf16Form::Rounded => {
                cx.team.rows(rows, len, |range, mut y| {
                    let y = y.column_mut();
                    let (x, y) = (Mat::new(&values[range], 1, y.len())?, MatMut::new(y, 1, y.len())?);
                    Ok(round_bf16(cx.isa, x, y)?)
                })?;
                None
            }
            Bf16Form::Split => {
                cx.team.rows_of_two(rows, MatMut::new(low, len, 1)?, len, |range, mut high, mut low| {
                    Ok(split_bf16x2(cx.isa, &values[range], high.column_mut(), low.column_mut())?)
                })?;
                Some(&low[..len])
            }
        };
        Ok(Bf16Values { high: &high[..len], low })
    }

    /// Whether this number of values is converted to `form`: without space for split ones, products read the
    /// floats.
    pub(super) fn converts_to(&self, form: Bf16Form, values: usize) -> bool {
        form == Bf16Form::Rounded || self.parts.iter().all(|part| part.len() >= values)
    }

    /// Space for quantized values and scales, gaps between rows included, so that the writer can read them back.
    fn room(&mut self, rows: usize, width: usize) -> Result<(MatMut<'_, i8>, MatMut<'_, f32>), ShapeError> {
        let want = rows * stride(width);
        if self.scale.len() < rows || self.codes.len() < want {
            return Err(ShapeError { arg: "quant", want, got: self.codes.len() });
        }
        let codes = MatMut::new(&mut self.codes, rows, stride(width))?;
        Ok((codes, MatMut::new(&mut self.scale, rows, 1)?))
    }

    /// The rows quantized last.
    fn quantized(&self, rows: usize, width: usize) -> Result<Rows<'_>, StepError> {
        let codes = Mat::with_stride(&self.codes, rows, width, stride(width))?;
        Ok(Rows::quantized(QuantRows::new(codes, &self.scale[..rows])?))
    }

    /// Adds room for this number of rounded values or high parts, and of low parts: for products whose
    /// rows are converted ([`Linear::bf16_form`]).
    #[must_use]
    pub fn with_parts(self, values: [usize; 2]) -> Self {
        Self { parts: values.map(AlignedBox::zeroed), ..self }
    }

    /// Scratch space for `rows` rows of at most `width` values, or for more rows of fewer values.
    pub(crate) fn new(rows: usize, width: usize) -> Self {
        Self::with_values(rows, rows * width)
    }
}
