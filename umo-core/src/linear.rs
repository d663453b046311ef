//! A product with packed weights at the precision that the model was loaded at.

use std::ops::Range;

use umo_kernels::bf16::round_bf16;
use umo_kernels::matmul_bf16::{Bf16Rows, matmul_bf16, matmul_bf16_rows, matmul_gated_bf16, split};
use umo_kernels::matmul_f32::{Epilogue, Input, matmul_f32, matmul_gated_f32};
use umo_kernels::matmul_i8::{
    QuantRows, matmul_gated_i8, matmul_i8, quantize_columns, quantize_rows, row_maxima, step_size,
};
use umo_kernels::{Ahead, Bf16, Isa, Mat, MatMut, PANEL, PackedBf16, PackedF32, PackedI8, ShapeError};

use crate::error::StepError;
use crate::team::{MAX_PIECES, Team, both};
use crate::weights::AlignedBox;

/// How products are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Weights as the file has them, f32 activations and sums.
    F32,
    /// Weights rounded to bfloat16, f32 sums, and activations with at least 16 bits of f32's 24.
    Bf16,
    /// Int8 weights per output row, activations quantised per row, int32 sums.
    Int8,
    /// Each product as the file has its weights: as [`Precision::Int8`] where they are I8, as [`Precision::Bf16`] where
    /// they are BF16, otherwise as [`Precision::F32`]. Around int8 products less may do, where [`Linear::rounded`] says so.
    Stored,
}

impl Precision {
    /// The name used by `--precision`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::Bf16 => "bf16",
            Self::Int8 => "int8",
            Self::Stored => "stored",
        }
    }
}

/// What every network computes with: the processor and the threads.
#[derive(Clone, Copy, Debug)]
pub struct Compute<'a> {
    /// Back-end of every kernel.
    pub isa: Isa,
    /// Threads that share each product.
    pub team: &'a Team,
}

/// Packed weights.
#[derive(Debug)]
pub enum Weight {
    /// f32 panels.
    F32(AlignedBox<f32>),
    /// bf16 panels.
    Bf16(AlignedBox<Bf16>),
    /// int8 panels of quads.
    I8 {
        /// Packed steps.
        steps: AlignedBox<i8>,
        /// Real value of one step, per output.
        scale: Box<[f32]>,
        /// Sum of the steps, per output.
        sum: Box<[i32]>,
    },
}

/// `y = x . w^T + bias`, with `w [outputs, inputs]` packed.
#[derive(Debug)]
pub struct Linear {
    weight: Weight,
    bias: Option<Box<[f32]>>,
    outputs: usize,
    inputs: usize,
    activations: Activations,
}

/// What tiles for bf16 take of float activations; what is no tile takes all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Activations {
    /// All bits, so that no tile is used.
    Exact,
    /// A high and a low part.
    Split,
    /// Their bf16.
    Rounded,
}

/// Activations as tiles for bf16 take them.
#[derive(Clone, Copy, Debug)]
pub struct Bf16Values<'a> {
    /// The values rounded, or their high parts.
    first: &'a [Bf16],
    /// Low parts.
    rest: Option<&'a [Bf16]>,
}

impl<'a> Bf16Values<'a> {
    /// `rows` rows of `cols` values, `stride` apart, from the value `start` on.
    ///
    /// # Errors
    /// [`ShapeError`] where there are not as many.
    pub fn rows(&self, start: usize, rows: usize, cols: usize, stride: usize) -> Result<Bf16Rows<'a>, ShapeError> {
        let part = |part: &'a [Bf16]| Mat::with_stride(&part[start.min(part.len())..], rows, cols, stride);
        match self.rest {
            Some(rest) => Bf16Rows::split(part(self.first)?, part(rest)?),
            None => Ok(Bf16Rows::rounded(part(self.first)?)),
        }
    }
}

/// Room for quantised activations, `[rows, inputs]` at most. Rows are an odd number of cache lines apart where they are whole lines:
/// an even number would put 16 of them, a tile, into few sets of L1.
#[derive(Debug)]
pub struct QuantScratch {
    steps: AlignedBox<i8>,
    scale: Box<[f32]>,
    /// Values as tiles for bf16 take them: rounded, or their high parts; and low parts. Or nothing.
    parts: [AlignedBox<Bf16>; 2],
    /// The largest size of a value in each row, `[pieces, rows]`, or nothing.
    largest: AlignedBox<f32>,
}

/// A cache line.
const LINE: usize = 64;

/// From a row of `width` steps to the next.
fn stride(width: usize) -> usize {
    if width.is_multiple_of(2 * LINE) { width + LINE } else { width }
}

/// Rows that are quantised as soon as they are computed, while L1 has them, and then make room for the next.
const ROWS_IN_L1: usize = 8;

/// Multiply-adds that quantising one value costs, roughly.
pub const QUANTIZE_WORK: usize = 4;

/// A thread's columns of rows that are computed to be the next product's input.
#[derive(Debug)]
pub struct Columns<'a> {
    /// `[rows, columns]`.
    pub y: MatMut<'a, f32>,
    /// What the thread computes them from: as many values for each column as [`QuantScratch::computed`] was told.
    pub room: &'a mut [f32],
    /// The largest size of a value in each row, where rows are quantised.
    largest: Option<&'a mut [f32]>,
    isa: Isa,
}

impl Columns<'_> {
    /// The rows `rows` are complete: best said while they are in cache.
    ///
    /// # Errors
    /// [`StepError`] where there are no such rows.
    pub fn complete(&mut self, rows: Range<usize>) -> Result<(), StepError> {
        if let Some(largest) = &mut self.largest {
            let (_, y) = self.y.reborrow().split_rows(rows.start);
            row_maxima(self.isa, &y.split_rows(rows.len()).0, &mut largest[rows])?;
        }
        Ok(())
    }
}

impl QuantScratch {
    /// Room for at most `rows` rows and `values` values in all.
    pub fn with_values(rows: usize, values: usize) -> Self {
        let parts = [(); 2].map(|()| AlignedBox::zeroed(0));
        let (steps, scale) = (AlignedBox::zeroed(values + rows * LINE), vec![0.0; rows].into());
        Self { steps, scale, parts, largest: AlignedBox::zeroed(0) }
    }

    /// The same with what [`Self::computed`] needs.
    #[must_use]
    pub fn with_maxima(self) -> Self {
        Self { largest: AlignedBox::zeroed(MAX_PIECES * self.scale.len()), ..self }
    }

    /// Calls `f` for each thread's columns of `values [rows, width]`, a multiple of `granule`, and makes the rows ready for
    /// `next`. Rows are quantised by the thread that has computed them, which has them in its cache: what another thread
    /// has written comes slower than memory. `f` says of all rows that they are [`Columns::complete`]; `work` is its multiply-adds.
    /// `room` has as many values for each column as its second part says.
    ///
    /// # Errors
    /// [`StepError`] where there is no room, and what `f` returned.
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
    ) -> Result<Ready<'a>, StepError> {
        let (width, pieces) = (next.inputs, cx.team.pieces());
        let mut y = MatMut::new(values, rows, width)?;
        if room.len() < width * each {
            return Err(ShapeError { arg: "room", want: width * each, got: room.len() }.into());
        }
        let largest = if next.is_int8() {
            let want = rows * stride(width);
            if self.largest.len() < pieces * rows || self.scale.len() < rows || self.steps.len() < want {
                return Err(ShapeError { arg: "quant", want, got: self.steps.len() }.into());
            }
            self.largest[..pieces * rows].fill(0.0);
            MatMut::new(&mut self.largest, pieces, rows)?
        } else {
            MatMut::new(&mut [], 0, rows)?
        };
        // Each piece has a row of `largest`, where there is one.
        fn row(largest: MatMut<'_, f32>, _: usize) -> (MatMut<'_, f32>, MatMut<'_, f32>) {
            let mine = largest.rows().min(1);
            largest.split_rows(mine)
        }
        let cut = both(MatMut::split_columns, both(row, |room, at| <[f32]>::split_at_mut(room, at * each)));
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
        if !next.is_int8() {
            return Ok(Ready::Float(Mat::new(values, rows, width)?));
        }
        let (largest, others) = self.largest[..pieces * rows].split_at_mut(rows);
        for (t, largest) in largest.iter_mut().enumerate() {
            *largest = others.iter().skip(t).step_by(rows).fold(*largest, |largest, &other| largest.max(other));
            self.scale[t] = step_size(*largest);
        }
        let (steps, largest) = (MatMut::with_stride(&mut self.steps, rows, width, stride(width))?, &*largest);
        let cut = both(MatMut::split_columns, MatMut::split_columns);
        cx.team.split((y, steps), width, granule, rows * width * QUANTIZE_WORK, cut, |_, (y, steps)| {
            Ok(quantize_columns(cx.isa, &y, largest, steps)?)
        })?;
        self.ready(rows, width)
    }

    /// Calls `f` for rows of `values`, which are as wide as `next`'s input, and of `also`, and makes them ready for `next`. Each thread
    /// computes its rows some at a time; where they are quantised, these take each other's place in `values`. `work` is `f`'s
    /// multiply-adds for all rows.
    ///
    /// # Errors
    /// [`StepError`] where there is no room, and what `f` returned.
    pub fn computed_rows<'a>(
        &'a mut self,
        cx: Compute,
        next: &Linear,
        values: &'a mut [f32],
        also: MatMut<f32>,
        work: usize,
        f: impl Fn(Range<usize>, MatMut<f32>, MatMut<f32>) -> Result<(), StepError> + Sync,
    ) -> Result<Ready<'a>, StepError> {
        let (rows, width) = (also.rows(), next.inputs);
        let mut y = MatMut::new(values, rows, width)?;
        if !next.is_int8() {
            cx.team.rows_of_two(y, also, work, f)?;
            return Ok(Ready::Float(Mat::new(values, rows, width)?));
        }
        let want = rows * stride(width);
        if self.scale.len() < rows || self.steps.len() < want {
            return Err(ShapeError { arg: "quant", want, got: self.steps.len() }.into());
        }
        let steps = MatMut::with_stride(&mut self.steps, rows, width, stride(width))?;
        let scale = MatMut::new(&mut self.scale, rows, 1)?;
        let cut = both(both(MatMut::split_rows, MatMut::split_rows), both(MatMut::split_rows, MatMut::split_rows));
        let work = work + rows * width * QUANTIZE_WORK;
        let all = ((y.reborrow(), also), (steps, scale));
        cx.team.split(all, rows, 1, work, cut, |range, ((mut y, mut also), (mut steps, mut scale))| {
            for first in range.clone().step_by(ROWS_IN_L1) {
                let now = first..(first + ROWS_IN_L1).min(range.end);
                let (now_also, rest_also) = also.split_rows(now.len());
                let (now_steps, rest_steps) = steps.split_rows(now.len());
                let (mut now_scale, rest_scale) = scale.split_rows(now.len());
                (also, steps, scale) = (rest_also, rest_steps, rest_scale);
                let (mut y, _) = y.reborrow().split_rows(now.len());
                f(now, y.reborrow(), now_also)?;
                quantize_rows(cx.isa, y.dense(), now_steps, now_scale.column_mut())?;
            }
            Ok(())
        })?;
        self.ready(rows, width)
    }

    /// The rows that have been quantised.
    fn ready(&self, rows: usize, width: usize) -> Result<Ready<'_>, StepError> {
        let steps = Mat::with_stride(&self.steps, rows, width, stride(width))?;
        Ok(Ready::Quant(Quantised { steps, scale: &self.scale[..rows] }))
    }

    /// The same with room for so many values rounded or high parts, and so many low parts: for products of which
    /// [`Linear::parts`] is not 0.
    #[must_use]
    pub fn with_parts(self, values: [usize; 2]) -> Self {
        Self { parts: values.map(AlignedBox::zeroed), ..self }
    }

    /// Room for `rows` rows of at most `width` values, or for more rows of fewer values.
    pub fn new(rows: usize, width: usize) -> Self {
        Self::with_values(rows, rows * width)
    }
}

impl Linear {
    /// Wraps packed weights of `[outputs, inputs]`.
    pub fn new(weight: Weight, outputs: usize, inputs: usize) -> Self {
        Self { weight, bias: None, outputs, inputs, activations: Activations::Split }
    }

    /// The same with a bias `[outputs]`.
    #[must_use]
    pub fn with_bias(self, bias: Box<[f32]>) -> Self {
        Self { bias: Some(bias), ..self }
    }

    /// The same with all bits of float activations.
    #[must_use]
    pub fn exact(self) -> Self {
        Self { activations: Activations::Exact, ..self }
    }

    /// The same with float activations rounded to bf16 where tiles take them, unless it is exact: for networks whose other
    /// products are int8, which leaves no more digits.
    #[must_use]
    pub fn rounded(self) -> Self {
        match self.activations {
            Activations::Exact => self,
            _ => Self { activations: Activations::Rounded, ..self },
        }
    }

    fn isa(&self, cx: Compute) -> Isa {
        if self.activations == Activations::Exact { cx.isa.without_tiles() } else { cx.isa }
    }

    /// Outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Whether activations are quantised for it.
    pub fn is_int8(&self) -> bool {
        matches!(self.weight, Weight::I8 { .. })
    }

    /// What a product with few rows reads first for the outputs `range`: eight panels.
    pub fn ahead(&self, range: Range<usize>) -> Ahead<'_> {
        const PANELS: usize = 8;
        fn of<T>(data: &[T], outputs: usize, range: Range<usize>) -> Ahead<'_> {
            let panel = data.len() / outputs.div_ceil(PANEL).max(1);
            let first = &data[range.start / PANEL * panel..range.end.div_ceil(PANEL) * panel];
            let first = &first[..first.len().min(PANELS * panel)];
            let (left, right) = first.split_at(first.len() / 2);
            Ahead::new(left, right)
        }
        match &self.weight {
            Weight::F32(data) => of(data, self.outputs, range),
            Weight::Bf16(data) => of(data, self.outputs, range),
            Weight::I8 { steps, .. } => of(steps, self.outputs, range),
        }
    }

    /// Tells the threads that the product with all outputs comes after the next job.
    pub fn expect(&self, cx: Compute) {
        cx.team.expect(self.outputs, PANEL, |range| self.ahead(range));
    }

    /// Bytes that one product reads.
    pub fn bytes(&self) -> usize {
        match &self.weight {
            Weight::F32(data) => size_of_val(&**data),
            Weight::Bf16(data) => size_of_val(&**data),
            Weight::I8 { steps, scale, sum } => steps.len() + size_of_val(&**scale) + size_of_val(&**sum),
        }
    }

    /// `y = end(x . w^T + bias)`; `end.bias` is set by this call.
    ///
    /// Shapes: `x [rows, inputs]`, `y [rows, outputs]`.
    ///
    /// # Errors
    /// [`StepError`] where a length disagrees.
    pub fn forward(
        &self,
        cx: Compute,
        quant: &mut QuantScratch,
        x: Mat<f32>,
        end: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        self.forward_outputs(cx, quant, x, 0..self.outputs, end, y)
    }

    /// The outputs `range` alone, which starts at a multiple of [`PANEL`]: as the rows of one part in the output head.
    ///
    /// # Errors
    /// [`StepError`] where a length disagrees.
    pub fn forward_outputs(
        &self,
        cx: Compute,
        quant: &mut QuantScratch,
        x: Mat<f32>,
        range: Range<usize>,
        end: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        if self.goes_to_tiles(cx.isa, x.rows(), x.elements().len(), quant) {
            let rows = self.to_bf16(cx, quant, x.elements())?.rows(0, x.rows(), x.cols(), x.stride())?;
            return cx.team.columns(y, PANEL, x.rows() * self.inputs * range.len(), |columns, y| {
                self.apply_bf16(cx, rows, range.start + columns.start..range.start + columns.end, end, y)
            });
        }
        let input = self.input(cx, quant, x)?;
        self.apply(cx, input, None, range, end, y)
    }

    /// Parts of a value that tiles for bf16 take, 0 where there are no such tiles or they do not serve.
    pub fn parts(&self, isa: Isa) -> usize {
        match (self.activations, &self.weight) {
            (Activations::Split, Weight::Bf16(_)) if isa.has_tiles() => 2,
            (Activations::Rounded, Weight::Bf16(_)) if isa.has_tiles() => 1,
            _ => 0,
        }
    }

    /// Whether `rows` rows, of `values` values in all, are made bf16 before the product: always where that rounds them, so
    /// that a row is the same among others; where it cuts them in two, only for many rows, since few would gain nothing.
    fn goes_to_tiles(&self, isa: Isa, rows: usize, values: usize, quant: &QuantScratch) -> bool {
        match self.parts(isa) {
            0 => false,
            1 => true,
            _ => rows >= 2 * PANEL && quant.parts.iter().all(|part| part.len() >= values),
        }
    }

    /// Values as tiles take them for this product, once for all threads and all rows that share a value.
    ///
    /// # Errors
    /// [`StepError`] where `quant` has no room for them.
    pub fn to_bf16<'a>(
        &self,
        cx: Compute,
        quant: &'a mut QuantScratch,
        values: &[f32],
    ) -> Result<Bf16Values<'a>, StepError> {
        let [first, rest] = &mut quant.parts;
        // As many rows as there are values, so that threads share them as they come.
        let column = |part| MatMut::new(part, values.len(), 1);
        if self.parts(cx.isa) == 1 {
            cx.team.rows(column(first)?, values.len(), |range, mut y| {
                let y = y.column_mut();
                let (x, y) = (Mat::new(&values[range], 1, y.len())?, MatMut::new(y, 1, y.len())?);
                Ok(round_bf16(cx.isa, x, y)?)
            })?;
            return Ok(Bf16Values { first: &first[..values.len()], rest: None });
        }
        cx.team.rows_of_two(column(first)?, column(rest)?, values.len(), |range, mut high, mut low| {
            Ok(split(cx.isa, &values[range], high.column_mut(), low.column_mut())?)
        })?;
        Ok(Bf16Values { first: &first[..values.len()], rest: Some(&rest[..values.len()]) })
    }

    /// The product of rows that are bf16 already, on this thread alone.
    ///
    /// # Errors
    /// [`StepError`] where a length disagrees, or the weights are no bf16.
    pub fn apply_bf16(
        &self,
        cx: Compute,
        x: Bf16Rows,
        range: Range<usize>,
        end: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        let end = Epilogue { bias: self.bias.as_deref().map(|bias| &bias[range.clone()]), ..end };
        Ok(matmul_bf16_rows(cx.isa, x, self.bf16(range)?, end, y)?)
    }

    /// The product of input that is ready, over the rows that `index` names (or all).
    ///
    /// # Errors
    /// [`StepError`] where a length disagrees.
    pub fn apply(
        &self,
        cx: Compute,
        x: Ready,
        index: Option<&[u32]>,
        range: Range<usize>,
        end: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        let work = x.rows(index) * self.inputs * range.len();
        cx.team.columns(y, PANEL, work, |columns, y| {
            let end = end.outputs(columns.clone());
            self.apply_here(cx, x, index, range.start + columns.start..range.start + columns.end, end, y)
        })
    }

    /// The same for the outputs `range` on this thread alone; `end.bias` is set by this call.
    ///
    /// # Errors
    /// As [`Self::apply`].
    pub fn apply_here(
        &self,
        cx: Compute,
        x: Ready,
        index: Option<&[u32]>,
        range: Range<usize>,
        end: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        let end = Epilogue { bias: self.bias.as_deref().map(|bias| &bias[range.clone()]), ..end };
        match (&self.weight, x) {
            (Weight::F32(_), Ready::Float(x)) => matmul_f32(cx.isa, gather(x, index)?, self.f32(range)?, end, y)?,
            (Weight::Bf16(_), Ready::Float(x)) => {
                matmul_bf16(self.isa(cx), gather(x, index)?, self.bf16(range)?, end, y)?;
            }
            (Weight::I8 { .. }, Ready::Quant(x)) => matmul_i8(cx.isa, x.view()?, index, self.i8(range)?, end, y)?,
            _ => return Err(MISMATCH),
        }
        Ok(())
    }

    /// `y = gelu_tanh(x . self^T) * (x . up^T)` for the outputs `range`, over the rows that `index` names (or all), on this
    /// thread alone.
    ///
    /// # Errors
    /// [`StepError`] where a length disagrees.
    pub fn apply_gated_here(
        &self,
        up: &Self,
        cx: Compute,
        x: Ready,
        index: Option<&[u32]>,
        range: Range<usize>,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        match (&self.weight, &up.weight, x) {
            (Weight::F32(_), Weight::F32(_), Ready::Float(x)) => {
                matmul_gated_f32(cx.isa, gather(x, index)?, self.f32(range.clone())?, up.f32(range)?, y)?;
            }
            (Weight::Bf16(_), Weight::Bf16(_), Ready::Float(x)) => {
                let x = gather(x, index)?;
                matmul_gated_bf16(self.isa(cx), x, self.bf16(range.clone())?, up.bf16(range)?, y)?;
            }
            (Weight::I8 { .. }, Weight::I8 { .. }, Ready::Quant(x)) => {
                matmul_gated_i8(cx.isa, x.view()?, index, self.i8(range.clone())?, up.i8(range)?, y)?;
            }
            _ => return Err(MISMATCH),
        }
        Ok(())
    }

    /// Makes `x` ready for this product and all others of the same precision: quantises it where they are int8.
    ///
    /// # Errors
    /// [`StepError`] where `quant` is too small.
    pub fn input<'a>(&self, cx: Compute, quant: &'a mut QuantScratch, x: Mat<'a, f32>) -> Result<Ready<'a>, StepError> {
        if !self.is_int8() {
            return Ok(Ready::Float(x));
        }
        let (rows, width) = (x.rows(), x.cols());
        let want = rows * stride(width);
        if quant.scale.len() < rows || quant.steps.len() < want {
            return Err(ShapeError { arg: "quant", want, got: quant.steps.len() }.into());
        }
        let steps = MatMut::with_stride(&mut quant.steps, rows, width, stride(width))?;
        let scale = MatMut::new(&mut quant.scale, rows, 1)?;
        cx.team.rows_of_two(steps, scale, rows * width * QUANTIZE_WORK, |range, steps, mut scale| {
            Ok(quantize_rows(cx.isa, x.row_range(range), steps, scale.column_mut())?)
        })?;
        quant.ready(rows, width)
    }

    fn f32(&self, range: Range<usize>) -> Result<PackedF32<'_>, StepError> {
        let Weight::F32(data) = &self.weight else { return Err(MISMATCH) };
        Ok(PackedF32::new(data, self.outputs, self.inputs)?.outputs(range))
    }

    fn bf16(&self, range: Range<usize>) -> Result<PackedBf16<'_>, StepError> {
        let Weight::Bf16(data) = &self.weight else { return Err(MISMATCH) };
        Ok(PackedBf16::new(data, self.outputs, self.inputs)?.outputs(range))
    }

    fn i8(&self, range: Range<usize>) -> Result<PackedI8<'_>, StepError> {
        let Weight::I8 { steps, scale, sum } = &self.weight else { return Err(MISMATCH) };
        Ok(PackedI8::new(steps, scale, sum, self.outputs, self.inputs)?.outputs(range))
    }
}

/// Weights of one precision met input of another: a defect of this library.
const MISMATCH: StepError = StepError::Shape(ShapeError { arg: "precision", want: 0, got: 1 });

fn gather<'a>(x: Mat<'a, f32>, index: Option<&'a [u32]>) -> Result<Input<'a, f32>, ShapeError> {
    match index {
        Some(index) => Input::gather(x, index),
        None => Ok(Input::all(x)),
    }
}

/// Activations in the form that a product takes.
#[derive(Clone, Copy, Debug)]
pub enum Ready<'a> {
    /// As they are.
    Float(Mat<'a, f32>),
    /// Quantised.
    Quant(Quantised<'a>),
}

impl<'a> Ready<'a> {
    /// The rows `range`. Panics where `range` ends beyond them.
    #[must_use]
    pub fn row_range(self, range: Range<usize>) -> Ready<'a> {
        match self {
            Self::Float(x) => Self::Float(x.row_range(range)),
            Self::Quant(x) => {
                Self::Quant(Quantised { steps: x.steps.row_range(range.clone()), scale: &x.scale[range] })
            }
        }
    }

    fn rows(&self, index: Option<&[u32]>) -> usize {
        index.map_or_else(
            || match self {
                Self::Float(x) => x.rows(),
                Self::Quant(x) => x.scale.len(),
            },
            <[u32]>::len,
        )
    }
}

/// Quantised rows in a scratch.
#[derive(Clone, Copy, Debug)]
pub struct Quantised<'a> {
    steps: Mat<'a, i8>,
    scale: &'a [f32],
}

impl<'a> Quantised<'a> {
    fn view(&self) -> Result<QuantRows<'a>, ShapeError> {
        QuantRows::new(self.steps, self.scale)
    }
}
