//! Matrix product with packed weights of any element type: the plan of its computation, and the
//! product itself.

use core::fmt;

use crate::error::ShapeError;
use crate::gemm::{Epilogue, Input};
use crate::isa::Isa;
use crate::mat::{Mat, MatMut};
use crate::matmul_bf16::{Bf16Rows, matmul_bf16, matmul_bf16_rows, matmul_gated_bf16};
use crate::matmul_f32::{matmul_f32, matmul_gated_f32};
use crate::matmul_i4::{matmul_gated_i4, matmul_i4};
use crate::matmul_i8::{matmul_gated_i8, matmul_i8};
use crate::pack::{PANEL, PackedBf16, PackedF32, PackedI4, PackedI8};
use crate::quantize::QuantRows;

/// Element type of packed weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WeightType {
    /// Single precision.
    F32,
    /// bfloat16.
    Bf16,
    /// Codes of eight bits, with a scale per output.
    I8,
    /// Codes of four bits, with a scale per output and multipliers per group.
    I4,
}

impl WeightType {
    /// Whether activations are quantized for these weights.
    pub const fn is_quantized(self) -> bool {
        matches!(self, Self::I8 | Self::I4)
    }
}

/// Bits of float activations that products with bf16 weights use; with f32 weights they use all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activations {
    /// All bits.
    Exact,
    /// A high and a low bf16 part on tiles, all bits elsewhere.
    Split,
    /// The nearest bf16 where bf16 is multiplied faster than f32, all bits elsewhere.
    Rounded,
}

/// Form in which a product reads its rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowForm {
    /// Floats.
    Float,
    /// bf16 values ([`Bf16Rows`]).
    Bf16(Bf16Form),
    /// int8 codes ([`QuantRows`]).
    Quantized,
}

/// Conversion of floats to bf16.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bf16Form {
    /// [`crate::bf16::round_bf16`].
    Rounded,
    /// [`crate::matmul_bf16::split_bf16x2`].
    Split,
}

impl Bf16Form {
    /// bf16 values for each float.
    pub const fn parts(self) -> usize {
        match self {
            Self::Rounded => 1,
            Self::Split => 2,
        }
    }
}

/// Dimension of a product that threads divide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Division {
    /// Each thread computes all outputs of its rows.
    Rows,
    /// Each thread computes its outputs of all rows.
    Outputs,
}

/// Computation of a product.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Instruction set to compute it with.
    pub isa: Isa,
    /// Form of the rows.
    pub rows: RowForm,
    /// Dimension that threads divide.
    pub division: Division,
}

/// Plans the product of `m` rows with weights of `n` outputs. The number of inputs affects no choice.
///
/// Rows are rounded for any `m`, so that the bits of a row do not depend on the other rows. They are split for
/// many rows only, because few gain nothing; a row's bits are the same either way.
pub fn plan(isa: Isa, weights: WeightType, activations: Activations, m: usize, n: usize) -> Plan {
    let rows = match (weights, activations) {
        (WeightType::I8 | WeightType::I4, _) => RowForm::Quantized,
        (WeightType::Bf16, Activations::Rounded) if isa.multiplies_bf16() => RowForm::Bf16(Bf16Form::Rounded),
        (WeightType::Bf16, Activations::Split) if isa.has_tiles() && m >= 2 * PANEL => RowForm::Bf16(Bf16Form::Split),
        (WeightType::F32 | WeightType::Bf16, _) => RowForm::Float,
    };
    // With more than half as many rows as outputs, reading all weights costs a thread less than reading rows that
    // another thread converted: HuBERT's convolutions. Tiles were measured with outputs divided.
    let division = match rows {
        RowForm::Quantized | RowForm::Bf16(_) if m > n / 2 && !isa.has_tiles() => Division::Rows,
        _ => Division::Outputs,
    };
    let exact = weights == WeightType::Bf16 && activations == Activations::Exact;
    Plan { isa: if exact { isa.without_tiles() } else { isa }, rows, division }
}

/// Packed weights.
#[derive(Clone, Copy, Debug)]
pub enum Weights<'a> {
    /// Single precision.
    F32(PackedF32<'a>),
    /// bfloat16.
    Bf16(PackedBf16<'a>),
    /// int8 codes.
    I8(PackedI8<'a>),
    /// int4 codes.
    I4(PackedI4<'a>),
}

/// Rows that a product reads, in one of the forms of [`RowForm`].
#[derive(Clone, Copy, Debug)]
pub enum Rows<'a> {
    /// Floats.
    Float(Input<'a, f32>),
    /// bf16 values.
    Bf16(Bf16Rows<'a>),
    /// Quantized values, and the index of the rows to read if not all.
    Quantized(QuantRows<'a>, Option<&'a [u32]>),
}

impl<'a> Rows<'a> {
    /// Every row of `x`.
    pub fn float(x: Mat<'a, f32>) -> Self {
        Self::Float(Input::all(x))
    }

    /// Every row of `x`.
    pub fn quantized(x: QuantRows<'a>) -> Self {
        Self::Quantized(x, None)
    }

    /// Row `index[i]` of all rows as row `i`, without a copy. The index of quantized rows is checked by the product.
    ///
    /// # Errors
    /// [`ProductError::Shape`] if an index is beyond the floats' rows; [`ProductError::Form`] for bf16 rows, which
    /// cannot be indexed.
    pub fn gather(self, index: &'a [u32]) -> Result<Self, ProductError> {
        match self {
            Self::Float(x) => Ok(Self::Float(Input::gather(x.mat, index)?)),
            Self::Quantized(x, _) => Ok(Self::Quantized(x, Some(index))),
            Self::Bf16(_) => Err(ProductError::Form),
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        match self {
            Self::Float(x) => x.rows(),
            Self::Bf16(x) => x.rows(),
            Self::Quantized(x, index) => index.map_or(x.codes.rows(), <[u32]>::len),
        }
    }
}

/// Product with rows.
#[derive(Clone, Copy, Debug)]
pub enum Product<'a> {
    /// A product with its epilogue.
    Plain(Weights<'a>, Epilogue<'a>),
    /// `gelu_tanh(x . gate) * (x . up)`.
    Gated(Weights<'a>, Weights<'a>),
}

/// Error of [`multiply`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProductError {
    /// A length disagrees.
    Shape(ShapeError),
    /// The rows have a form that no kernel multiplies with these weights: not that of their [`Plan`].
    Form,
}

impl From<ShapeError> for ProductError {
    fn from(error: ShapeError) -> Self {
        Self::Shape(error)
    }
}

impl fmt::Display for ProductError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shape(error) => error.fmt(f),
            Self::Form => f.write_str("weights and rows of different precisions"),
        }
    }
}

impl core::error::Error for ProductError {}

/// Multiplies `x [m, k]` with weights `[n, k]` into `y [m, n]`; shapes, numerics and cost as in the functions of the
/// weights' type, for instance [`matmul_i8`] and [`matmul_gated_i8`].
///
/// # Errors
/// [`ProductError::Shape`] if a length disagrees, [`ProductError::Form`] if the rows do not have the form of the
/// weights' [`Plan`].
pub fn multiply(isa: Isa, x: Rows, product: Product, y: MatMut<f32>) -> Result<(), ProductError> {
    use Product::{Gated, Plain};
    match (x, product) {
        (Rows::Float(x), Plain(Weights::F32(w), epilogue)) => matmul_f32(isa, x, w, epilogue, y)?,
        (Rows::Float(x), Plain(Weights::Bf16(w), epilogue)) => matmul_bf16(isa, x, w, epilogue, y)?,
        (Rows::Bf16(x), Plain(Weights::Bf16(w), epilogue)) => matmul_bf16_rows(isa, x, w, epilogue, y)?,
        (Rows::Quantized(x, index), Plain(Weights::I8(w), epilogue)) => matmul_i8(isa, x, index, w, epilogue, y)?,
        (Rows::Quantized(x, index), Plain(Weights::I4(w), epilogue)) => matmul_i4(isa, x, index, w, epilogue, y)?,
        (Rows::Float(x), Gated(Weights::F32(gate), Weights::F32(up))) => matmul_gated_f32(isa, x, gate, up, y)?,
        (Rows::Float(x), Gated(Weights::Bf16(gate), Weights::Bf16(up))) => matmul_gated_bf16(isa, x, gate, up, y)?,
        (Rows::Quantized(x, index), Gated(Weights::I8(gate), Weights::I8(up))) => {
            matmul_gated_i8(isa, x, index, gate, up, y)?;
        }
        (Rows::Quantized(x, index), Gated(Weights::I4(gate), Weights::I4(up))) => {
            matmul_gated_i4(isa, x, index, gate, up, y)?;
        }
        _ => return Err(ProductError::Form),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TYPES: [WeightType; 4] = [WeightType::F32, WeightType::Bf16, WeightType::I8, WeightType::I4];
    const ACTIVATIONS: [Activations; 3] = [Activations::Exact, Activations::Split, Activations::Rounded];

    #[test]
    fn rows_are_converted_where_the_instruction_set_gains() {
        for isa in Isa::available() {
            for m in [1, 2 * PANEL - 1, 2 * PANEL, usize::MAX] {
                let form = |weights, activations| plan(isa, weights, activations, m, 64).rows;
                for activations in ACTIVATIONS {
                    assert_eq!(form(WeightType::F32, activations), RowForm::Float);
                    assert_eq!(form(WeightType::I8, activations), RowForm::Quantized);
                    assert_eq!(form(WeightType::I4, activations), RowForm::Quantized);
                }
                let name = isa.name();
                assert_eq!(form(WeightType::Bf16, Activations::Exact), RowForm::Float, "{name}");
                let rounded = matches!(name, "avx512bf16" | "amx");
                let expected = if rounded { RowForm::Bf16(Bf16Form::Rounded) } else { RowForm::Float };
                assert_eq!(form(WeightType::Bf16, Activations::Rounded), expected, "{name}");
                let split = name == "amx" && m >= 2 * PANEL;
                let expected = if split { RowForm::Bf16(Bf16Form::Split) } else { RowForm::Float };
                assert_eq!(form(WeightType::Bf16, Activations::Split), expected, "{name} {m}");
            }
        }
    }

    #[test]
    fn threads_divide_rows_from_half_as_many_as_outputs_on() {
        for isa in Isa::available() {
            for (m, n) in [(1, 1), (1, 2), (2, 3), (16, 32), (17, 32), (usize::MAX, 32)] {
                for weights in TYPES {
                    let plan = plan(isa, weights, Activations::Rounded, m, n);
                    let rows = plan.rows != RowForm::Float && isa.name() != "amx" && m as u128 * 2 > n as u128;
                    assert_eq!(plan.division == Division::Rows, rows, "{} {weights:?} {m} {n}", isa.name());
                }
            }
        }
    }

    #[test]
    fn exact_products_avoid_tiles() {
        for isa in Isa::available() {
            for (weights, activations) in TYPES.into_iter().flat_map(|weights| ACTIVATIONS.map(|a| (weights, a))) {
                let exact = (weights, activations) == (WeightType::Bf16, Activations::Exact);
                let expected = if exact { isa.without_tiles() } else { isa };
                assert_eq!(plan(isa, weights, activations, 4, 64).isa, expected, "{}", isa.name());
            }
        }
    }

    #[test]
    fn rows_of_another_form_are_an_error() {
        let (isa, x, codes, scale) = (Isa::SCALAR, [1.0; 4], [1_i8; 4], [1.0]);
        let (floats, mut y) = ([1.0; 4 * PANEL], [0.0; PANEL]);
        let weights = Weights::F32(PackedF32::new(&floats, PANEL, 4).unwrap());
        let quantized = Rows::quantized(QuantRows::new(Mat::new(&codes, 1, 4).unwrap(), &scale).unwrap());
        for (x, expected) in [(Rows::float(Mat::new(&x, 1, 4).unwrap()), Ok(())), (quantized, Err(ProductError::Form))]
        {
            for product in [Product::Plain(weights, Epilogue::STORE), Product::Gated(weights, weights)] {
                assert_eq!(multiply(isa, x, product, MatMut::new(&mut y, 1, PANEL).unwrap()), expected);
            }
        }
    }
}
