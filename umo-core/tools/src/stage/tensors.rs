//! Input and output tensors of a stage.

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use umo_core_pose::part::Part;

use super::StageError;

/// Input tensors, by name.
#[derive(Debug)]
pub struct Inputs<'a> {
    tensors: SafeTensors<'a>,
    /// Prefix of every name: a golden file holds the inputs of many cases.
    prefix: &'a str,
}

impl<'a> Inputs<'a> {
    /// Reads the tensors of a safetensors file whose names start with `prefix`.
    ///
    /// # Errors
    /// [`StageError::Input`] if `bytes` is not a safetensors file.
    pub fn new(bytes: &'a [u8], prefix: &'a str) -> Result<Self, StageError> {
        let tensors = SafeTensors::deserialize(bytes)
            .map_err(|error| StageError::Input { name: "*".to_owned(), problem: error.to_string() })?;
        Ok(Self { tensors, prefix })
    }

    /// A vector of F32.
    ///
    /// # Errors
    /// [`StageError::Input`] if it is missing, has another type or more than one dimension, or contains a NaN or
    /// infinite value.
    pub fn floats(&self, name: &str) -> Result<Vec<f32>, StageError> {
        let view = self.vector(name, Dtype::F32)?;
        let values: Vec<f32> = view.data().as_chunks().0.iter().map(|v| f32::from_le_bytes(*v)).collect();
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.error(name, format!("value [{i}] is {}, not a finite number", values[i]))),
            None => Ok(values),
        }
    }

    /// Rows of `width` F32 each.
    ///
    /// # Errors
    /// [`StageError::Input`] as in [`Self::floats`], but for two dimensions.
    pub fn float_rows(&self, name: &str, width: usize) -> Result<Vec<f32>, StageError> {
        let view = self.rows(name, Dtype::F32, width)?;
        let values: Vec<f32> = view.data().as_chunks().0.iter().map(|v| f32::from_le_bytes(*v)).collect();
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.error(name, format!("value [{i}] is {}, not a finite number", values[i]))),
            None => Ok(values),
        }
    }

    /// Rows of `width` codes each, I64.
    ///
    /// # Errors
    /// [`StageError::Input`] as in [`Self::codes`], but for two dimensions.
    pub fn code_rows(&self, name: &str, width: usize) -> Result<Vec<u16>, StageError> {
        let view = self.rows(name, Dtype::I64, width)?;
        let values = view.data().as_chunks().0.iter().map(|v| i64::from_le_bytes(*v));
        let convert =
            |value: i64| u16::try_from(value).map_err(|_| self.error(name, format!("{value} is out of range")));
        values.map(convert).collect()
    }

    fn rows(&self, name: &str, dtype: Dtype, width: usize) -> Result<TensorView<'_>, StageError> {
        let view = self.tensors.tensor(&format!("{}{name}", self.prefix));
        let view = view.map_err(|_| self.error(name, "missing".to_owned()))?;
        if view.dtype() == dtype && view.shape().len() == 2 && view.shape()[1] == width {
            return Ok(view);
        }
        let (got, shape) = (view.dtype(), view.shape());
        Err(self.error(name, format!("expected {dtype} of shape [T, {width}], got {got} {shape:?}")))
    }

    /// A vector of I64.
    ///
    /// # Errors
    /// [`StageError::Input`] if it is missing, has another type, or has more than one dimension.
    pub fn integers(&self, name: &str) -> Result<Vec<i64>, StageError> {
        let view = self.vector(name, Dtype::I64)?;
        Ok(view.data().as_chunks().0.iter().map(|v| i64::from_le_bytes(*v)).collect())
    }

    /// A vector of token ids.
    ///
    /// # Errors
    /// [`StageError::Input`] as in [`Self::integers`], or if a value is not an id.
    pub fn ids(&self, name: &str) -> Result<Vec<u32>, StageError> {
        self.converted(name)
    }

    /// A part's codes.
    ///
    /// # Errors
    /// [`StageError::Input`] as in [`Self::integers`], or if a code is out of range.
    pub fn codes(&self, part: Part) -> Result<Vec<u16>, StageError> {
        self.converted(&format!("codes.{}", part.name()))
    }

    fn converted<T: TryFrom<i64>>(&self, name: &str) -> Result<Vec<T>, StageError> {
        let convert = |value: i64| T::try_from(value).map_err(|_| self.error(name, format!("{value} is out of range")));
        self.integers(name)?.into_iter().map(convert).collect()
    }

    fn vector(&self, name: &str, dtype: Dtype) -> Result<TensorView<'_>, StageError> {
        let view = self.tensors.tensor(&format!("{}{name}", self.prefix));
        let view = view.map_err(|_| self.error(name, "missing".to_owned()))?;
        if view.dtype() == dtype && view.shape().len() == 1 {
            return Ok(view);
        }
        let (got, shape) = (view.dtype(), view.shape());
        Err(self.error(name, format!("expected {dtype} of one dimension, got {got} {shape:?}")))
    }

    fn error(&self, name: &str, problem: String) -> StageError {
        StageError::Input { name: format!("{}{name}", self.prefix), problem }
    }
}

/// One output tensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// Name.
    pub name: String,
    /// Shape.
    pub shape: Vec<usize>,
    /// Values.
    pub values: Values,
}

/// Values of an output.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// F32.
    Floats(Vec<f32>),
    /// I64.
    Integers(Vec<i64>),
}

impl Output {
    pub(super) fn floats(name: &str, shape: &[usize], values: Vec<f32>) -> Self {
        Self { name: name.to_owned(), shape: shape.to_vec(), values: Values::Floats(values) }
    }

    pub(super) fn integers(name: &str, values: Vec<i64>) -> Self {
        Self { name: name.to_owned(), shape: vec![values.len()], values: Values::Integers(values) }
    }

    pub(crate) fn codes(part: Part, codes: &[u16]) -> Self {
        Self::integers(&format!("codes.{}", part.name()), codes.iter().map(|&code| i64::from(code)).collect())
    }
}

/// Serializes tensors as a safetensors file.
///
/// # Errors
/// [`StageError::Input`] if two tensors have the same name.
pub fn serialize(outputs: &[Output]) -> Result<Vec<u8>, StageError> {
    let bytes: Vec<Vec<u8>> = outputs
        .iter()
        .map(|output| match &output.values {
            Values::Floats(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Values::Integers(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        })
        .collect();
    let views = outputs.iter().zip(&bytes).map(|(output, bytes)| {
        let dtype = if matches!(output.values, Values::Floats(_)) { Dtype::F32 } else { Dtype::I64 };
        let view = TensorView::new(dtype, output.shape.clone(), bytes);
        let name = output.name.clone();
        Ok((name.clone(), view.map_err(|e| StageError::Input { name, problem: e.to_string() })?))
    });
    let views: Vec<_> = views.collect::<Result<_, StageError>>()?;
    safetensors::serialize(views, None)
        .map_err(|error| StageError::Input { name: "*".to_owned(), problem: error.to_string() })
}
