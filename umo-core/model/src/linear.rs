//! A product with packed weights, at the precision that the model was loaded with.

mod input;

use std::ops::Range;
use std::sync::Arc;

use umo_kernels::gemm::{Epilogue, Input};
use umo_kernels::matmul_bf16::{Bf16Rows, matmul_bf16, matmul_bf16_rows, matmul_gated_bf16};
use umo_kernels::matmul_f32::{matmul_f32, matmul_gated_f32};
use umo_kernels::matmul_i4::{matmul_gated_i4, matmul_i4};
use umo_kernels::matmul_i8::{matmul_gated_i8, matmul_i8};
use umo_kernels::{Bf16, Isa, Mat, MatMut, PANEL, PackedBf16, PackedF32, PackedI4, PackedI8, PrefetchHint, ShapeError};

use crate::calibration::Gram;
pub use input::{Bf16Values, Columns, QuantScratch, Quantized, Ready};
use umo_core_base::aligned::AlignedBox;
use umo_core_base::error::StepError;
use umo_core_base::team::Team;

/// Precision of products.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Weights as stored in the file, f32 activations and sums.
    F32,
    /// Weights rounded to bfloat16, f32 sums, and activations with at least 16 bits of f32's 24.
    Bf16,
    /// Int8 weights per output row, activations quantized per row, int32 sums.
    Int8,
    /// Each product as its weights are stored: int8 and int4 as [`Precision::Int8`], BF16 as [`Precision::Bf16`], all
    /// others as [`Precision::F32`]. Among int8 products, float activations may be rounded to bf16.
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

/// Back-end and threads, passed to every network.
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
        /// Packed quantized values.
        steps: AlignedBox<i8>,
        /// Scale of the quantized values, per output.
        scale: Box<[f32]>,
        /// Sum of the quantized values, per output.
        sum: Box<[i32]>,
    },
    /// int4 panels of blocks, with the multipliers of their groups.
    I4 {
        /// Packed codes.
        codes: AlignedBox<u8>,
        /// Scale of the codes, per output.
        scale: Box<[f32]>,
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
    /// Recorder of its inputs, for calibration.
    recorded: Option<Arc<Gram>>,
}

/// Bits of float activations that bf16 products use; f32 products use all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Activations {
    /// All bits: bf16 products are not used.
    Exact,
    /// A high and a low part: only tiles are fast enough for both.
    Split,
    /// Rounded to bf16.
    Rounded,
}

impl Linear {
    /// Wraps packed weights of `[outputs, inputs]`.
    pub fn new(weight: Weight, outputs: usize, inputs: usize) -> Self {
        Self { weight, bias: None, outputs, inputs, activations: Activations::Split, recorded: None }
    }

    /// Records its float inputs.
    #[must_use]
    pub(crate) fn recorded(self, recorded: Option<Arc<Gram>>) -> Self {
        Self { recorded, ..self }
    }

    /// Records the rows of a product of the outputs `range`. If threads share a product, the one with the first
    /// output records it.
    fn record(&self, x: Ready, index: Option<&[u32]>, range: &Range<usize>) -> Result<(), StepError> {
        match (&self.recorded, x) {
            (Some(gram), Ready::Float(x)) if range.start == 0 => gram.add(x, index),
            _ => Ok(()),
        }
    }

    /// Adds a bias `[outputs]`.
    #[must_use]
    pub fn with_bias(self, bias: Box<[f32]>) -> Self {
        Self { bias: Some(bias), ..self }
    }

    /// Uses all bits of float activations.
    #[must_use]
    pub fn exact(self) -> Self {
        Self { activations: Activations::Exact, ..self }
    }

    /// Rounds float activations to bf16 if the back-end multiplies bf16, unless [`Self::exact`] was set. For networks
    /// whose other products are int8, which are no more precise.
    #[must_use]
    pub fn rounded(self) -> Self {
        match self.activations {
            Activations::Exact => self,
            _ => Self { activations: Activations::Rounded, ..self },
        }
    }

    fn isa(&self, isa: Isa) -> Isa {
        if self.activations == Activations::Exact { isa.without_tiles() } else { isa }
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Whether its activations are quantized.
    pub fn is_quantized(&self) -> bool {
        matches!(self.weight, Weight::I8 { .. } | Weight::I4 { .. })
    }

    /// Prefetch hint for a product of few rows with the outputs `range`: its first eight panels.
    pub fn ahead(&self, range: Range<usize>) -> PrefetchHint<'_> {
        fn of<T>(data: &[T], outputs: usize, range: Range<usize>) -> PrefetchHint<'_> {
            let first = first_panels(data, outputs, range, PANELS_AHEAD);
            let (left, right) = first.split_at(first.len() / 2);
            PrefetchHint::new(left, right)
        }
        match &self.weight {
            Weight::F32(data) => of(data, self.outputs, range),
            Weight::Bf16(data) => of(data, self.outputs, range),
            Weight::I8 { steps, .. } => of(steps, self.outputs, range),
            Weight::I4 { codes, .. } => of(codes, self.outputs, range),
        }
    }

    /// Prefetch hint for a gated product: the same number of panels, from both weights together.
    fn ahead_gated<'a>(&'a self, up: &'a Self, range: Range<usize>) -> PrefetchHint<'a> {
        fn of<'a, T>(gate: &'a [T], up: &'a [T], outputs: usize, range: Range<usize>) -> PrefetchHint<'a> {
            let first = |data| first_panels(data, outputs, range.clone(), PANELS_AHEAD / 2);
            PrefetchHint::new(first(gate), first(up))
        }
        match (&self.weight, &up.weight) {
            (Weight::F32(gate), Weight::F32(up)) => of(gate, up, self.outputs, range),
            (Weight::Bf16(gate), Weight::Bf16(up)) => of(gate, up, self.outputs, range),
            (Weight::I8 { steps: gate, .. }, Weight::I8 { steps: up, .. }) => of(gate, up, self.outputs, range),
            (Weight::I4 { codes: gate, .. }, Weight::I4 { codes: up, .. }) => of(gate, up, self.outputs, range),
            _ => PrefetchHint::NONE,
        }
    }

    /// Announces that the gated product with all outputs follows the next job, so that idle threads prefetch it.
    pub fn expect_gated(&self, up: &Self, cx: Compute) {
        cx.team.expect(self.outputs, PANEL, |range| self.ahead_gated(up, range).tuned_for(cx.isa));
    }

    /// Announces that the product with all outputs follows the next job, so that idle threads prefetch it.
    pub fn expect(&self, cx: Compute) {
        cx.team.expect(self.outputs, PANEL, |range| self.ahead(range).tuned_for(cx.isa));
    }

    /// Bytes of weights that one product reads.
    pub fn bytes(&self) -> usize {
        match &self.weight {
            Weight::F32(data) => size_of_val(&**data),
            Weight::Bf16(data) => size_of_val(&**data),
            Weight::I8 { steps, scale, sum } => steps.len() + size_of_val(&**scale) + size_of_val(&**sum),
            Weight::I4 { codes, scale } => codes.len() + size_of_val(&**scale),
        }
    }

    /// `y = end(x . w^T + bias)`; `end.bias` is set by this call.
    ///
    /// Shapes: `x [rows, inputs]`, `y [rows, outputs]`.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
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

    /// Computes the outputs `range` only, which starts at a multiple of [`PANEL`]: for example one part's rows of the
    /// output head.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn forward_outputs(
        &self,
        cx: Compute,
        quant: &mut QuantScratch,
        x: Mat<f32>,
        range: Range<usize>,
        end: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        if self.goes_as_bf16(cx.isa, x.rows(), x.elements().len(), quant) {
            let values = self.to_bf16(cx, quant, x.elements())?;
            let work = x.rows() * self.inputs * range.len();
            if shares_rows(cx, x.rows(), range.len(), end) {
                return cx.team.rows(y, work, |rows, y| {
                    let x = values.rows(rows.start * x.stride(), rows.len(), x.cols(), x.stride())?;
                    self.apply_bf16(cx, x, range.clone(), end, y)
                });
            }
            let rows = values.rows(0, x.rows(), x.cols(), x.stride())?;
            return cx.team.columns(y, PANEL, work, |columns, y| {
                self.apply_bf16(cx, rows, range.start + columns.start..range.start + columns.end, end, y)
            });
        }
        if self.is_quantized() && shares_rows(cx, x.rows(), range.len(), end) {
            return quant.quantized_rows(cx, x, y, x.rows() * self.inputs * range.len(), |x, y| {
                self.apply_here(cx, x, None, range.clone(), end, y)
            });
        }
        let input = self.input(cx, quant, x)?;
        self.apply(cx, input, None, range, end, y)
    }

    /// Number of bf16 parts that each activation is converted to; 0 if it stays a float.
    pub fn parts(&self, isa: Isa) -> usize {
        match (self.activations, &self.weight) {
            (Activations::Split, Weight::Bf16(_)) if isa.has_tiles() => 2,
            (Activations::Rounded, Weight::Bf16(_)) if isa.multiplies_bf16() => 1,
            _ => 0,
        }
    }

    /// Whether `rows` rows, `values` values in all, are converted to bf16 before the product. Always if they are
    /// rounded, so that a row's result does not depend on the other rows. If they are split, only for many rows: few
    /// would gain nothing.
    fn goes_as_bf16(&self, isa: Isa, rows: usize, values: usize, quant: &QuantScratch) -> bool {
        match self.parts(isa) {
            0 => false,
            1 => true,
            _ => rows >= 2 * PANEL && quant.has_room_to_split(values),
        }
    }

    /// Converts activations for bf16 products, once for all threads and all rows that share a value.
    ///
    /// # Errors
    /// [`StepError`] if `quant` has no room for them.
    pub fn to_bf16<'a>(
        &self,
        cx: Compute,
        quant: &'a mut QuantScratch,
        values: &[f32],
    ) -> Result<Bf16Values<'a>, StepError> {
        if self.parts(cx.isa) == 1 { quant.round(cx, values) } else { quant.split(cx, values) }
    }

    /// Multiplies rows that are bf16 already, on this thread only.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees, or the weights are not bf16.
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

    /// Multiplies prepared input, over the rows in `index` (or all).
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
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

    /// Computes the outputs `range` on this thread only; `end.bias` is set by this call.
    ///
    /// # Errors
    /// As in [`Self::apply`].
    pub fn apply_here(
        &self,
        cx: Compute,
        x: Ready,
        index: Option<&[u32]>,
        range: Range<usize>,
        end: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        self.record(x, index, &range)?;
        let end = Epilogue { bias: self.bias.as_deref().map(|bias| &bias[range.clone()]), ..end };
        match (&self.weight, x) {
            (Weight::F32(_), Ready::Float(x)) => matmul_f32(cx.isa, gather(x, index)?, self.f32(range)?, end, y)?,
            (Weight::Bf16(_), Ready::Float(x)) => {
                matmul_bf16(self.isa(cx.isa), gather(x, index)?, self.bf16(range)?, end, y)?;
            }
            (Weight::I8 { .. }, Ready::Quant(x)) => matmul_i8(cx.isa, x.view()?, index, self.i8(range)?, end, y)?,
            (Weight::I4 { .. }, Ready::Quant(x)) => matmul_i4(cx.isa, x.view()?, index, self.i4(range)?, end, y)?,
            _ => return Err(MISMATCH),
        }
        Ok(())
    }

    /// Multiplies float rows by all weights on the calling thread, without a team; `end.bias` is set by this call.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees, or the weights are quantized.
    pub(crate) fn apply_alone(&self, isa: Isa, x: Mat<f32>, end: Epilogue, y: MatMut<f32>) -> Result<(), StepError> {
        let (x, all, end) = (Input::all(x), 0..self.outputs, Epilogue { bias: self.bias.as_deref(), ..end });
        match &self.weight {
            Weight::F32(_) => matmul_f32(isa, x, self.f32(all)?, end, y)?,
            Weight::Bf16(_) => matmul_bf16(self.isa(isa), x, self.bf16(all)?, end, y)?,
            Weight::I8 { .. } | Weight::I4 { .. } => return Err(MISMATCH),
        }
        Ok(())
    }

    /// `y = gelu_tanh(x . self^T) * (x . up^T)` for the outputs `range`, over the rows in `index` (or all), on this
    /// thread only.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn apply_gated_here(
        &self,
        up: &Self,
        cx: Compute,
        x: Ready,
        index: Option<&[u32]>,
        range: Range<usize>,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        self.record(x, index, &range)?;
        up.record(x, index, &range)?;
        match (&self.weight, &up.weight, x) {
            (Weight::F32(_), Weight::F32(_), Ready::Float(x)) => {
                matmul_gated_f32(cx.isa, gather(x, index)?, self.f32(range.clone())?, up.f32(range)?, y)?;
            }
            (Weight::Bf16(_), Weight::Bf16(_), Ready::Float(x)) => {
                let x = gather(x, index)?;
                matmul_gated_bf16(self.isa(cx.isa), x, self.bf16(range.clone())?, up.bf16(range)?, y)?;
            }
            (Weight::I8 { .. }, Weight::I8 { .. }, Ready::Quant(x)) => {
                matmul_gated_i8(cx.isa, x.view()?, index, self.i8(range.clone())?, up.i8(range)?, y)?;
            }
            (Weight::I4 { .. }, Weight::I4 { .. }, Ready::Quant(x)) => {
                matmul_gated_i4(cx.isa, x.view()?, index, self.i4(range.clone())?, up.i4(range)?, y)?;
            }
            _ => return Err(MISMATCH),
        }
        Ok(())
    }

    /// Prepares `x` for this product and others of the same precision: quantizes it if their activations are
    /// quantized.
    ///
    /// # Errors
    /// [`StepError`] if `quant` is too small.
    pub fn input<'a>(&self, cx: Compute, quant: &'a mut QuantScratch, x: Mat<'a, f32>) -> Result<Ready<'a>, StepError> {
        if self.is_quantized() { quant.quantize(cx, x) } else { Ok(Ready::Float(x)) }
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

    fn i4(&self, range: Range<usize>) -> Result<PackedI4<'_>, StepError> {
        let Weight::I4 { codes, scale } = &self.weight else { return Err(MISMATCH) };
        Ok(PackedI4::new(codes, scale, self.outputs, self.inputs)?.outputs(range))
    }
}

/// Panels prefetched for a product of few rows, which reads them side by side.
const PANELS_AHEAD: usize = 8;

/// The first panels of the outputs `range`, at most `most`.
fn first_panels<T>(data: &[T], outputs: usize, range: Range<usize>, most: usize) -> &[T] {
    let panel = data.len() / outputs.div_ceil(PANEL).max(1);
    let all = &data[range.start / PANEL * panel..range.end.div_ceil(PANEL) * panel];
    &all[..all.len().min(most * panel)]
}

/// Weights of one precision with input of another: a defect of this library.
const MISMATCH: StepError = StepError::Disagree("weights and input of different precisions");

/// Whether threads share a product's rows and not its outputs. That suits HuBERT's convolutions: with at least half
/// as many rows as outputs, it is cheaper for each thread to read all weights than rows that another thread computed.
/// Tiles were measured with outputs shared.
fn shares_rows(cx: Compute, rows: usize, outputs: usize, end: Epilogue) -> bool {
    2 * rows > outputs && end.scatter.is_none() && !cx.isa.has_tiles()
}

fn gather<'a>(x: Mat<'a, f32>, index: Option<&'a [u32]>) -> Result<Input<'a, f32>, ShapeError> {
    match index {
        Some(index) => Input::gather(x, index),
        None => Ok(Input::all(x)),
    }
}
