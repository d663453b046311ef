//! Tensors to the forms that the networks compute with: packed products, vectors and tables.

use std::ops::Range;

use rayon::prelude::*;
use umo_kernels::pack::{PANEL, pack, pack_i8, packed_len, packed_len_i8, panels, quantize_weight_row};
use umo_kernels::{Bf16, Isa, Mat};

use super::{ModelFile, Tensor};
use crate::error::LoadError;
use crate::linear::{Linear, Precision, Weight};

/// Loads the parts of one model at one precision for one processor.
#[derive(Clone, Copy, Debug)]
pub struct Loader<'a> {
    file: &'a ModelFile,
    precision: Precision,
    isa: Isa,
}

/// How the values of one output row are ordered in the file.
#[derive(Clone, Copy, Debug)]
enum Order {
    /// As they are.
    Same,
    /// A convolution's `[channels, kernel]`, needed as `[kernel, channels]`.
    Convolution { channels: usize, kernel: usize },
}

impl Order {
    /// Index in the file's row of value `i` of the needed row.
    fn source(self, i: usize) -> usize {
        match self {
            Self::Same => i,
            Self::Convolution { channels, kernel } => (i % channels) * kernel + i / channels,
        }
    }
}

impl<'a> Loader<'a> {
    /// A loader of `file` for `isa`; `precision` says how products are computed.
    pub fn new(file: &'a ModelFile, precision: Precision, isa: Isa) -> Self {
        Self { file, precision, isa }
    }

    /// The file.
    pub fn file(&self) -> &'a ModelFile {
        self.file
    }

    /// The processor that weights are packed for.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// The same file and processor with products in full precision, for the tensors that lose by rounding.
    #[must_use]
    pub fn exact(self) -> Self {
        Self { precision: Precision::F32, ..self }
    }

    /// A vector of `len` values.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn vector(&self, name: &str, len: usize) -> Result<Box<[f32]>, LoadError> {
        self.values(name, &[len])
    }

    /// All values of a tensor, in the file's order.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn values(&self, name: &str, shape: &[usize]) -> Result<Box<[f32]>, LoadError> {
        let tensor = self.file.tensor(name, shape)?;
        let mut values = vec![0.0; tensor.rows() * tensor.cols()].into_boxed_slice();
        tensor.read(&mut values)?;
        Ok(values)
    }

    /// A product without bias: the tensors `names`, each `[outputs, inputs]`, one below the other.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn linear(&self, names: &[String], outputs: &[usize], inputs: usize) -> Result<Linear, LoadError> {
        let tensors = names.iter().zip(outputs).map(|(name, &n)| self.file.tensor(name, &[n, inputs]));
        self.product(&tensors.collect::<Result<Vec<_>, _>>()?, Order::Same)
    }

    /// The rows `range` of a product without bias, `[total, inputs]` in the file.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn linear_rows(
        &self,
        name: &str,
        total: usize,
        range: Range<usize>,
        inputs: usize,
    ) -> Result<Linear, LoadError> {
        let tensor = self.file.tensor(name, &[total, inputs])?;
        let tensors = std::slice::from_ref(&tensor);
        self.pack(&Rows { tensors, first: range.start, n: range.len(), order: Order::Same })
    }

    /// Checks the values of a tensor of which only some rows are loaded.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn check_values(&self, name: &str, rows: usize, cols: usize) -> Result<(), LoadError> {
        let tensor = self.file.tensor(name, &[rows, cols])?;
        (0..rows).into_par_iter().try_for_each_init(|| vec![0.0; cols], |values, row| tensor.read_row(row, values))?;
        self.file.release(&tensor);
        Ok(())
    }

    /// A product with bias: `{name}.weight` `[outputs, inputs]` and `{name}.bias`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn linear_with_bias(&self, name: &str, outputs: usize, inputs: usize) -> Result<Linear, LoadError> {
        let linear = self.linear(&[format!("{name}.weight")], &[outputs], inputs)?;
        Ok(linear.with_bias(self.vector(&format!("{name}.bias"), outputs)?))
    }

    /// A convolution `[outputs, channels, kernel]` as a product over windows of `[kernel, channels]`; a bias where the
    /// file has `{name}.bias` and `bias` asks for it.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn conv(
        &self,
        name: &str,
        outputs: usize,
        channels: usize,
        kernel: usize,
        bias: bool,
    ) -> Result<Linear, LoadError> {
        let tensor = self.file.tensor(&format!("{name}.weight"), &[outputs, channels, kernel])?;
        let linear = self.product(&[tensor], Order::Convolution { channels, kernel })?;
        if bias { Ok(linear.with_bias(self.vector(&format!("{name}.bias"), outputs)?)) } else { Ok(linear) }
    }

    /// A convolution in groups, one product per group over windows of `[kernel, channels per group]`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn grouped_conv(
        &self,
        name: &str,
        channels: usize,
        kernel: usize,
        groups: usize,
    ) -> Result<Vec<Linear>, LoadError> {
        let width = channels / groups;
        let tensor = self.file.tensor(&format!("{name}.weight"), &[channels, width, kernel])?;
        let bias = self.vector(&format!("{name}.bias"), channels)?;
        let order = Order::Convolution { channels: width, kernel };
        let products = bias.chunks_exact(width).enumerate().map(|(group, bias)| {
            let rows = Rows { tensors: std::slice::from_ref(&tensor), first: group * width, n: width, order };
            Ok(self.pack(&rows)?.with_bias(bias.into()))
        });
        products.collect()
    }

    /// A table whose rows are gathered, kept as the file has it.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn table(&self, name: &str, rows: usize, cols: usize) -> Result<Table, LoadError> {
        let tensor = self.file.tensor(name, &[rows, cols])?;
        let store = |bytes: Vec<u16>| bytes.into_boxed_slice();
        let values = if tensor.is_bf16() {
            let mut values = vec![0_u16; rows * cols];
            let mut row = vec![0.0; cols];
            for (r, out) in values.chunks_exact_mut(cols).enumerate() {
                tensor.read_row(r, &mut row)?;
                out.iter_mut().zip(&row).for_each(|(out, &v)| *out = Bf16::from_f32(v).0);
            }
            TableValues::Bf16(store(values))
        } else {
            TableValues::F32(self.values(name, &[rows, cols])?)
        };
        self.file.release(&tensor);
        Ok(Table { values, rows, cols })
    }

    fn product(&self, tensors: &[Tensor], order: Order) -> Result<Linear, LoadError> {
        let n = tensors.iter().map(Tensor::rows).sum();
        let linear = self.pack(&Rows { tensors, first: 0, n, order })?;
        tensors.iter().for_each(|tensor| self.file.release(tensor));
        Ok(linear)
    }

    /// Packs rows at this loader's precision: bf16 where the file has bf16 (nothing is lost) or where asked.
    fn pack(&self, rows: &Rows) -> Result<Linear, LoadError> {
        let (n, k) = (rows.n, rows.tensors[0].cols());
        let all = |f: fn(&Tensor) -> bool| rows.tensors.iter().all(f);
        let weight = match self.precision {
            Precision::Int8 => pack_int8(rows, n, k)?,
            Precision::F32 if all(|t| t.is_bf16()) => Weight::Bf16(pack_float(rows, n, k, Bf16::from_f32)?),
            Precision::F32 => Weight::F32(pack_float(rows, n, k, |v| v)?),
            Precision::Bf16 => Weight::Bf16(pack_float(rows, n, k, Bf16::from_f32)?),
        };
        Ok(Linear::new(weight, n, k))
    }
}

/// Output rows `first..first + n` of tensors that stand one below the other.
struct Rows<'a> {
    tensors: &'a [Tensor<'a>],
    first: usize,
    n: usize,
    order: Order,
}

impl Rows<'_> {
    /// The tensor and its row that hold output `row`.
    fn locate(&self, row: usize) -> (&Tensor<'_>, usize) {
        let mut row = self.first + row;
        for tensor in self.tensors {
            if row < tensor.rows() {
                return (tensor, row);
            }
            row -= tensor.rows();
        }
        unreachable!("rows are counted from the same tensors")
    }

    /// Reads output `row` in the needed order; `scratch` holds the file's.
    fn read(&self, row: usize, scratch: &mut [f32], out: &mut [f32]) -> Result<(), LoadError> {
        let (tensor, row) = self.locate(row);
        tensor.read_row(row, scratch)?;
        for (i, out) in out.iter_mut().enumerate() {
            *out = scratch[self.order.source(i)];
        }
        Ok(())
    }
}

/// Packs all panels in parallel.
fn pack_float<P: Copy + Default + Send>(
    rows: &Rows,
    n: usize,
    k: usize,
    convert: impl Fn(f32) -> P + Sync,
) -> Result<Box<[P]>, LoadError> {
    let mut packed = vec![P::default(); packed_len(n, k)].into_boxed_slice();
    packed.par_chunks_mut(PANEL * k).enumerate().try_for_each(|(p, panel)| {
        let count = PANEL.min(n - p * PANEL);
        let (mut scratch, mut values) = (vec![0.0; k], vec![0.0; count * k]);
        for (lane, row) in values.chunks_exact_mut(k).enumerate() {
            rows.read(p * PANEL + lane, &mut scratch, row)?;
        }
        let view = Mat::new(&values, count, k).expect("sized for the view");
        pack(view, &convert, panel).expect("one panel per chunk");
        Ok(())
    })?;
    Ok(packed)
}

/// Quantises and packs all panels in parallel; steps that the file already has are kept.
fn pack_int8(rows: &Rows, n: usize, k: usize) -> Result<Weight, LoadError> {
    let mut packed = vec![0_i8; packed_len_i8(n, k)].into_boxed_slice();
    let panel_len = packed.len() / panels(n).max(1);
    let (mut scale, mut sum) = (vec![0.0; n].into_boxed_slice(), vec![0; n].into_boxed_slice());
    let outputs = scale.par_chunks_mut(PANEL).zip(sum.par_chunks_mut(PANEL));
    packed.par_chunks_mut(panel_len.max(1)).zip(outputs).enumerate().try_for_each(|(p, (panel, (scale, sum)))| {
        let (mut scratch, mut values) = (vec![0.0; k], vec![0.0; k]);
        let mut steps = vec![0_i8; scale.len() * k];
        for (lane, row) in steps.chunks_exact_mut(k).enumerate() {
            let output = p * PANEL + lane;
            let (tensor, source_row) = rows.locate(output);
            if let Some((stored, step)) = tensor.steps(source_row) {
                scale[lane] = step;
                row.iter_mut().enumerate().for_each(|(i, v)| *v = stored[rows.order.source(i)].cast_signed());
            } else {
                rows.read(output, &mut scratch, &mut values)?;
                scale[lane] = quantize_weight_row(&values, row).expect("both `k` long");
            }
        }
        let view = Mat::new(&steps, scale.len(), k).expect("sized for the view");
        pack_i8(view, panel, sum).expect("one panel per chunk");
        Ok(())
    })?;
    Ok(Weight::I8 { steps: packed, scale, sum })
}

/// A table whose rows are looked up, `[rows, cols]`.
#[derive(Debug)]
pub struct Table {
    values: TableValues,
    rows: usize,
    cols: usize,
}

#[derive(Debug)]
enum TableValues {
    F32(Box<[f32]>),
    Bf16(Box<[u16]>),
}

impl Table {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Writes row `row` to `out [cols]`. Panics where `row` is no row.
    pub fn gather(&self, row: usize, out: &mut [f32]) {
        self.visit(row, out, |out, v| *out = v);
    }

    /// Adds row `row` to `out [cols]`. Panics where `row` is no row.
    pub fn add(&self, row: usize, out: &mut [f32]) {
        self.visit(row, out, |out, v| *out += v);
    }

    fn visit(&self, row: usize, out: &mut [f32], f: impl Fn(&mut f32, f32)) {
        let range = row * self.cols..(row + 1) * self.cols;
        match &self.values {
            TableValues::F32(values) => out.iter_mut().zip(&values[range]).for_each(|(out, &v)| f(out, v)),
            TableValues::Bf16(values) => {
                out.iter_mut().zip(&values[range]).for_each(|(out, &v)| f(out, Bf16(v).to_f32()));
            }
        }
    }
}
