//! A product with packed weights, at the precision that the model was loaded with.

mod input;

use std::ops::Range;
use std::sync::Arc;

use umo_core_base::aligned::AlignedBox;
use umo_core_base::error::StepError;
use umo_core_base::team::Team;
use umo_kernels::gemm::Epilogue;
use umo_kernels::product::{
    Activations, Bf16Form, Division, Plan, Product, RowForm, Rows, WeightType, Weights, multiply, plan,
};
use umo_kernels::{Bf16, Isa, Mat, MatMut, PANEL, PackedBf16, PackedF32, PackedI4, PackedI8, PrefetchHint, ShapeError};

use crate::calibration::Gram;
pub use input::{Bf16Values, Columns, QuantScratch};

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
        /// Packed codes.
        codes: AlignedBox<i8>,
        /// Scale of the codes, per output.
        scale: Box<[f32]>,
        /// Sum of the codes, per output.
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
    fn record(&self, x: Rows, range: &Range<usize>) -> Result<(), StepError> {
        match (&self.recorded, x) {
            (Some(gram), Rows::Float(x)) if range.start == 0 => gram.add(x),
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

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Element type of the weights.
    fn weight_type(&self) -> WeightType {
        match &self.weight {
            Weight::F32(_) => WeightType::F32,
            Weight::Bf16(_) => WeightType::Bf16,
            Weight::I8 { .. } => WeightType::I8,
            Weight::I4 { .. } => WeightType::I4,
        }
    }

    /// Whether its activations are quantized.
    pub fn is_quantized(&self) -> bool {
        self.weight_type().is_quantized()
    }

    /// Plan of `outputs` outputs of `rows` rows.
    fn plan(&self, isa: Isa, rows: usize, outputs: usize) -> Plan {
        plan(isa, self.weight_type(), self.activations, rows, outputs)
    }

    /// Conversion to bf16 of the rows of a large product, if they are converted.
    pub fn bf16_form(&self, isa: Isa) -> Option<Bf16Form> {
        match self.plan(isa, usize::MAX, self.outputs).rows {
            RowForm::Bf16(form) => Some(form),
            RowForm::Float | RowForm::Quantized => None,
        }
    }

    /// Prefetch hint for a product of few rows with the outputs `range`: its first eight panels.
    pub fn prefetch_hint(&self, range: Range<usize>) -> PrefetchHint<'_> {
        fn of<T>(data: &[T], outputs: usize, range: Range<usize>) -> PrefetchHint<'_> {
            let first = first_panels(data, outputs, range, PREFETCHED_PANELS);
            let (left, right) = first.split_at(first.len() / 2);
            PrefetchHint::new(left, right)
        }
        match &self.weight {
            Weight::F32(data) => of(data, self.outputs, range),
            Weight::Bf16(data) => of(data, self.outputs, range),
            Weight::I8 { codes, .. } => of(codes, self.outputs, range),
            Weight::I4 { codes, .. } => of(codes, self.outputs, range),
        }
    }

    /// Prefetch hint for a gated product: the same number of panels, from both weights together.
    fn gated_prefetch_hint<'a>(&'a self, up: &'a Self, range: Range<usize>) -> PrefetchHint<'a> {
        fn of<'a, T>(gate: &'a [T], up: &'a [T], outputs: usize, range: Range<usize>) -> PrefetchHint<'a> {
            let first = |data| first_panels(data, outputs, range.clone(), PREFETCHED_PANELS / 2);
            PrefetchHint::new(first(gate), first(up))
        }
        match (&self.weight, &up.weight) {
            (Weight::F32(gate), Weight::F32(up)) => of(gate, up, self.outputs, range),
            (Weight::Bf16(gate), Weight::Bf16(up)) => of(gate, up, self.outputs, range),
            (Weight::I8 { codes: gate, .. }, Weight::I8 { codes: up, .. }) => of(gate, up, self.outputs, range),
            (Weight::I4 { codes: gate, .. }, Weight::I4 { codes: up, .. }) => of(gate, up, self.outputs, range),
            _ => PrefetchHint::NONE,
        }
    }

    /// Announces that the gated product with all outputs follows the next job, so that idle threads prefetch it.
    pub fn prefetch_gated_next(&self, up: &Self, cx: Compute) {
        cx.team.prefetch_next(self.outputs, PANEL, |range| self.gated_prefetch_hint(up, range).tuned_for(cx.isa));
    }

    /// Announces that the product with all outputs follows the next job, so that idle threads prefetch it.
    pub fn prefetch_next(&self, cx: Compute) {
        cx.team.prefetch_next(self.outputs, PANEL, |range| self.prefetch_hint(range).tuned_for(cx.isa));
    }

    /// Bytes of weights that one product reads.
    pub fn bytes(&self) -> usize {
        match &self.weight {
            Weight::F32(data) => size_of_val(&**data),
            Weight::Bf16(data) => size_of_val(&**data),
            Weight::I8 { codes, scale, sum } => codes.len() + size_of_val(&**scale) + size_of_val(&**sum),
            Weight::I4 { codes, scale } => codes.len() + size_of_val(&**scale),
        }
    }

    /// `y = epilogue(x . w^T + bias)`; `epilogue.bias` is set by this call.
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
        epilogue: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        self.forward_outputs(cx, quant, x, 0..self.outputs, epilogue, y)
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
        epilogue: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        let plan = self.plan(cx.isa, x.rows(), range.len());
        let by_rows = plan.division == Division::Rows && epilogue.scatter.is_none();
        let work = x.rows() * self.inputs * range.len();
        match plan.rows {
            RowForm::Bf16(form) if quant.converts_to(form, x.elements().len()) => {
                let values = quant.to_bf16(cx, form, x.elements())?;
                if by_rows {
                    return cx.team.rows(y, work, |rows, y| {
                        let x = values.rows(rows.start * x.stride(), rows.len(), x.cols(), x.stride())?;
                        self.apply_here(cx.isa, x, range.clone(), epilogue, y)
                    });
                }
                self.apply(cx, values.rows(0, x.rows(), x.cols(), x.stride())?, range, epilogue, y)
            }
            RowForm::Quantized if by_rows => {
                quant.quantized_rows(cx, x, y, work, |x, y| self.apply_here(cx.isa, x, range.clone(), epilogue, y))
            }
            _ => self.apply(cx, self.input(cx, quant, x)?, range, epilogue, y),
        }
    }

    /// Multiplies prepared rows.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn apply(
        &self,
        cx: Compute,
        x: Rows,
        range: Range<usize>,
        epilogue: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        let work = x.rows() * self.inputs * range.len();
        cx.team.columns(y, PANEL, work, |columns, y| {
            let epilogue = epilogue.outputs(columns.clone());
            self.apply_here(cx.isa, x, range.start + columns.start..range.start + columns.end, epilogue, y)
        })
    }

    /// Computes the outputs `range` on this thread only; `epilogue.bias` is set by this call.
    ///
    /// # Errors
    /// As in [`Self::apply`].
    pub fn apply_here(
        &self,
        isa: Isa,
        x: Rows,
        range: Range<usize>,
        epilogue: Epilogue,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        self.record(x, &range)?;
        let epilogue = Epilogue { bias: self.bias.as_deref().map(|bias| &bias[range.clone()]), ..epilogue };
        let plan = self.plan(isa, x.rows(), range.len());
        Ok(multiply(plan.isa, x, Product::Plain(self.weights(range)?, epilogue), y)?)
    }

    /// `y = gelu_tanh(x . self^T) * (x . up^T)` for the outputs `range`, on this thread only.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn apply_gated_here(
        &self,
        up: &Self,
        isa: Isa,
        x: Rows,
        range: Range<usize>,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        self.record(x, &range)?;
        up.record(x, &range)?;
        let plan = self.plan(isa, x.rows(), range.len());
        Ok(multiply(plan.isa, x, Product::Gated(self.weights(range.clone())?, up.weights(range)?), y)?)
    }

    /// Prepares `x` for this product and others of the same precision: quantizes it if their activations are
    /// quantized.
    ///
    /// # Errors
    /// [`StepError`] if `quant` is too small.
    pub fn input<'a>(&self, cx: Compute, quant: &'a mut QuantScratch, x: Mat<'a, f32>) -> Result<Rows<'a>, StepError> {
        if self.is_quantized() { quant.quantize(cx, x) } else { Ok(Rows::float(x)) }
    }

    /// Weights of the outputs `range`.
    fn weights(&self, range: Range<usize>) -> Result<Weights<'_>, ShapeError> {
        let (n, k) = (self.outputs, self.inputs);
        Ok(match &self.weight {
            Weight::F32(data) => Weights::F32(PackedF32::new(data, n, k)?.outputs(range)),
            Weight::Bf16(data) => Weights::Bf16(PackedBf16::new(data, n, k)?.outputs(range)),
            Weight::I8 { codes, scale, sum } => Weights::I8(PackedI8::new(codes, scale, sum, n, k)?.outputs(range)),
            Weight::I4 { codes, scale } => Weights::I4(PackedI4::new(codes, scale, n, k)?.outputs(range)),
        })
    }
}

/// Panels prefetched for a product of few rows, which reads them side by side.
const PREFETCHED_PANELS: usize = 8;

/// The first panels of the outputs `range`, at most `most`.
fn first_panels<T>(data: &[T], outputs: usize, range: Range<usize>, most: usize) -> &[T] {
    let panel = data.len() / outputs.div_ceil(PANEL).max(1);
    let all = &data[range.start / PANEL * panel..range.end.div_ceil(PANEL) * panel];
    &all[..all.len().min(most * panel)]
}
