//! Converts tensors to the forms that the networks compute with: packed products, vectors and tables.

use std::ops::Range;
use std::sync::Arc;

use umo_core_base::aligned::{AlignedBox, Plain, Pool};
use umo_core_base::error::LoadError;
use umo_core_base::memory::{SPARE, catch, filled, require};
use umo_kernels::matmul_i4;
use umo_kernels::pack::{
    PANEL, pack_row, pack_row_bf16, pack_row_i4, pack_row_i8, packed_len, packed_len_bf16, packed_len_i4, packed_len_i8,
};
use umo_kernels::quantize::quantize_weight_row;
use umo_kernels::{Bf16, Isa, ShapeError};

use super::parallel::*;
use super::writer::Storage;
use super::{ModelFile, Tensor};
use crate::calibration::Calibration;
use crate::linear::{Linear, Precision, Weight};

/// Loads the components of one model at one precision for one instruction set.
#[derive(Clone, Debug)]
pub struct Loader<'a> {
    file: &'a ModelFile,
    precision: Precision,
    /// Form of all products' weights, if the precision does not determine it per tensor.
    form: Option<Form>,
    /// Whether float products use all bits of their activations.
    exact: bool,
    /// Whether products have few rows, and so are bound by reading their weights.
    few_rows: bool,
    isa: Isa,
    /// Memory for packed weights.
    pool: Arc<Pool>,
    /// Recorder of the products' inputs.
    calibration: Option<&'a Calibration>,
}

/// Form of packed weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    F32,
    Bf16,
    Int8,
    /// Same values as int8, in half the bytes.
    Int4,
}

impl Form {
    /// Form of a product over tensors with this storage: loses no more precision than `precision` asks for. `int4`
    /// tells whether int4 is faster than the same values in int8.
    fn of(precision: Precision, int4: bool, stored: impl Iterator<Item = Storage> + Clone) -> Self {
        let all = |storage| stored.clone().all(|s| s == storage);
        match precision {
            Precision::Stored if int4 && all(Storage::Int4) => Self::Int4,
            Precision::Int8 => Self::Int8,
            Precision::Bf16 => Self::Bf16,
            Precision::Stored if stored.clone().all(Storage::is_quantized) => Self::Int8,
            Precision::Stored | Precision::F32 if all(Storage::Bf16) => Self::Bf16,
            Precision::Stored | Precision::F32 => Self::F32,
        }
    }
}

/// Packs one row as an output of its panel.
type PackRow<P> = fn(&[f32], usize, &mut [P]) -> Result<(), ShapeError>;

/// Order of the values of an output row in the file.
#[derive(Clone, Copy, Debug)]
enum Order {
    /// The needed order.
    Same,
    /// A convolution's `[channels, kernel]`, needed as `[kernel, channels]`.
    Convolution { channels: usize, kernel: usize },
}

impl Order {
    /// Values of a row in the needed order: `stored` itself, or sorted into `sorted`.
    fn sort<'a, T: Copy>(self, stored: &'a [T], sorted: &'a mut [T]) -> &'a [T] {
        let Self::Convolution { channels, kernel } = self else { return stored };
        for (tap, sorted) in sorted.chunks_exact_mut(channels).enumerate() {
            sorted.iter_mut().zip(stored[tap..].iter().step_by(kernel)).for_each(|(out, &v)| *out = v);
        }
        sorted
    }
}

impl<'a> Loader<'a> {
    /// Loads from `file` for `isa` at `precision`.
    pub fn new(file: &'a ModelFile, precision: Precision, isa: Isa) -> Self {
        let exact = precision == Precision::F32;
        Self { file, precision, form: None, exact, few_rows: false, isa, pool: Arc::default(), calibration: None }
    }

    /// Records the inputs of products in `calibration`.
    #[doc(hidden)]
    #[must_use]
    pub fn recording(self, calibration: &'a Calibration) -> Self {
        Self { calibration: Some(calibration), ..self }
    }

    /// The model file.
    pub fn file(&self) -> &'a ModelFile {
        self.file
    }

    /// Instruction set that weights are packed for.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Loader with products in full precision, for tensors that lose quality by rounding.
    #[must_use]
    pub fn exact(&self) -> Self {
        Self { exact: true, ..self.float() }
    }

    /// Loader with weights as stored, for tensors that lose quality by rounding to int8.
    #[must_use]
    pub fn float(&self) -> Self {
        Self { precision: Precision::F32, form: None, ..self.clone() }
    }

    /// Loader for products of few rows, or (the default) of many: int4 weights stay int4 if that is faster.
    #[must_use]
    pub fn for_few_rows(&self, few_rows: bool) -> Self {
        Self { few_rows, ..self.clone() }
    }

    /// Form of a product over tensors with this storage.
    fn form_of(&self, stored: impl Iterator<Item = Storage> + Clone) -> Form {
        Form::of(self.precision, matmul_i4::is_fast(self.isa, self.few_rows), stored)
    }

    /// Loader with the same form for all of the tensors `names`: products that share their input, or are multiplied
    /// with each other, must not differ even if their storage does.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn alike(&self, names: &[String]) -> Result<Self, LoadError> {
        let stored = names.iter().map(|name| self.file.storage(name)).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { form: Some(self.form_of(stored.into_iter())), ..self.clone() })
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
        let mut values = filled(0.0, tensor.rows() * tensor.cols()).into_boxed_slice();
        // A thread without its own allocator arena takes a whole page for each small allocation.
        require(SPARE);
        tensor.read(&mut values)?;
        Ok(values)
    }

    /// A product without bias: the tensors `names`, each `[outputs, inputs]`, stacked.
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
        for_each((0..rows).into_par_iter(), || filled(0.0, cols), |values, row| tensor.read_row(row, values))?;
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

    /// A convolution `[outputs, channels, kernel]` as a product over windows of `[kernel, channels]`; with a bias if
    /// `bias` is set and the file has `{name}.bias`.
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

    /// A grouped convolution: one product per group over windows of `[kernel, channels per group]`.
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

    /// A table for gathering rows, stored as in the file.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn table(&self, name: &str, rows: usize, cols: usize) -> Result<Table, LoadError> {
        let tensor = self.file.tensor(name, &[rows, cols])?;
        let values = if tensor.storage() == Storage::Bf16 {
            TableValues::Bf16(self.table_rows(&tensor, Bf16::from_f32)?)
        } else {
            TableValues::F32(self.table_rows(&tensor, |v| v)?)
        };
        self.file.release(&tensor);
        Ok(Table { values, rows, cols })
    }

    fn table_rows<P: Plain>(
        &self,
        tensor: &Tensor,
        convert: impl Fn(f32) -> P + Sync,
    ) -> Result<AlignedBox<P>, LoadError> {
        let cols = tensor.cols();
        let mut values = self.pool.zeroed::<P>(tensor.rows() * cols);
        let all = values.par_chunks_mut(cols.max(1)).enumerate().with_min_len(64);
        let room = || filled(0.0, cols);
        for_each(all, room, |row, (r, out)| {
            tensor.read_row(r, row)?;
            out.iter_mut().zip(row).for_each(|(out, v)| *out = convert(*v));
            Ok(())
        })?;
        Ok(values)
    }

    fn product(&self, tensors: &[Tensor], order: Order) -> Result<Linear, LoadError> {
        let n = tensors.iter().map(Tensor::rows).sum();
        let linear = self.pack(&Rows { tensors, first: 0, n, order })?;
        tensors.iter().for_each(|tensor| self.file.release(tensor));
        require(SPARE);
        Ok(linear)
    }

    fn pack(&self, rows: &Rows) -> Result<Linear, LoadError> {
        let stored = rows.tensors.iter().map(Tensor::storage);
        let weight = match self.form.unwrap_or_else(|| self.form_of(stored)) {
            Form::Int4 if matches!(rows.order, Order::Same) => self.pack_int4(rows)?,
            // Reordering a convolution's inputs would mix the groups, so it uses int8.
            Form::Int4 | Form::Int8 => self.pack_int8(rows)?,
            Form::Bf16 => Weight::Bf16(self.pack_float(rows, packed_len_bf16, pack_row_bf16)?),
            Form::F32 => Weight::F32(self.pack_float(rows, packed_len, pack_row)?),
        };
        let linear = Linear::new(weight, rows.n, rows.cols());
        let linear = match (self.calibration, rows.order) {
            (Some(calibration), Order::Same) => {
                linear.recorded(calibration.product(rows.named(), rows.cols(), self.isa))
            }
            _ => linear,
        };
        Ok(if self.exact { linear.exact() } else { linear })
    }

    /// Packs all panels in parallel, with the given length and row packing.
    fn pack_float<P: Plain>(
        &self,
        rows: &Rows,
        packed_len: fn(usize, usize) -> usize,
        pack_row: PackRow<P>,
    ) -> Result<AlignedBox<P>, LoadError> {
        let k = rows.cols();
        let mut packed = self.pool.zeroed(packed_len(rows.n, k));
        let panels = packed.par_chunks_mut(packed_len(1, k).max(1)).enumerate();
        let room = || RowBuffer::new(k);
        for_each(panels, room, |buffer, (p, panel)| {
            for lane in 0..PANEL.min(rows.n - p * PANEL) {
                let row = rows.floats(p * PANEL + lane, buffer)?;
                pack_row(row, lane, panel).expect("one panel per chunk");
            }
            Ok(())
        })?;
        Ok(packed)
    }

    /// Quantizes and packs all panels in parallel; values that are int8 in the file are kept.
    fn pack_int8(&self, rows: &Rows) -> Result<Weight, LoadError> {
        let (n, k) = (rows.n, rows.cols());
        let mut codes = self.pool.zeroed(packed_len_i8(n, k));
        let (mut scale, mut sum) = (filled(0.0, n).into_boxed_slice(), filled(0, n).into_boxed_slice());
        let outputs = scale.par_chunks_mut(PANEL).zip(sum.par_chunks_mut(PANEL));
        let panels = codes.par_chunks_mut(packed_len_i8(1, k).max(1)).zip(outputs).enumerate();
        let room = || RowBuffer::new(k);
        for_each(panels, room, |buffer, (p, (panel, (scale, sum)))| {
            for (lane, (scale, sum)) in scale.iter_mut().zip(sum).enumerate() {
                let row = rows.codes(p * PANEL + lane, buffer, scale)?;
                *sum = pack_row_i8(row, lane, panel).expect("one panel per chunk");
            }
            Ok(())
        })?;
        Ok(Weight::I8 { codes, scale, sum })
    }
}

impl Loader<'_> {
    /// Packs all panels of int4 weights in parallel, unchanged.
    fn pack_int4(&self, rows: &Rows) -> Result<Weight, LoadError> {
        let (n, k) = (rows.n, rows.cols());
        let mut codes = self.pool.zeroed(packed_len_i4(n, k));
        let mut scale = filled(0.0, n).into_boxed_slice();
        let panels = codes.par_chunks_mut(packed_len_i4(1, k).max(1)).zip(scale.par_chunks_mut(PANEL)).enumerate();
        let room = || filled(0, k);
        for_each(panels, room, |row, (p, (panel, scale))| {
            for (lane, scale) in scale.iter_mut().enumerate() {
                let (tensor, source) = rows.locate(p * PANEL + lane);
                let stored = tensor.int4_row(source, row);
                let (multipliers, of_row) = stored.expect("only int4 tensors have this form");
                *scale = of_row;
                pack_row_i4(row, multipliers, lane, panel).expect("checked as the tensor was opened");
            }
            Ok(())
        })?;
        Ok(Weight::I4 { codes, scale })
    }
}

/// Loads the layers `0..count` of a network by `load`, on the pool's threads.
///
/// # Errors
/// As returned by `load`, or [`LoadError::Memory`]; no further layer is then started.
pub fn load_layers<T: Send>(
    count: usize,
    load: impl Fn(usize) -> Result<T, LoadError> + Sync + Send,
) -> Result<Box<[T]>, LoadError> {
    let layers: Result<Vec<T>, LoadError> = (0..count).into_par_iter().map(|i| catch(|| load(i))?).collect();
    Ok(layers?.into())
}

/// Calls `work` for each item on the pool's threads, with scratch space that each thread allocates when it first
/// needs it.
///
/// # Errors
/// As returned by `work`, or [`LoadError::Memory`] if `room` cannot be allocated; no further item is then started.
fn for_each<I: ParallelIterator, R: Send>(
    items: I,
    room: impl Fn() -> R + Sync + Send,
    work: impl Fn(&mut R, I::Item) -> Result<(), LoadError> + Sync + Send,
) -> Result<(), LoadError> {
    items.try_for_each_init(
        || None,
        |made, item| {
            let made = match made {
                Some(made) => made,
                None => made.insert(catch(&room)?),
            };
            work(made, item)
        },
    )
}

/// Output rows `first..first + n` of stacked tensors.
struct Rows<'a> {
    tensors: &'a [Tensor<'a>],
    first: usize,
    n: usize,
    order: Order,
}

/// Buffers for one row on its way from the file to a panel.
struct RowBuffer {
    stored: Vec<f32>,
    sorted: Vec<f32>,
    codes: Vec<i8>,
    /// Expanded int4 values.
    unpacked: Vec<i8>,
}

impl RowBuffer {
    fn new(k: usize) -> Self {
        Self { stored: filled(0.0, k), sorted: filled(0.0, k), codes: filled(0, k), unpacked: filled(0, k) }
    }
}

impl Rows<'_> {
    fn cols(&self) -> usize {
        self.tensors.first().map_or(0, Tensor::cols)
    }

    /// Names of the tensors, and the rows taken from each.
    fn named(&self) -> Vec<(String, Range<usize>)> {
        let (mut first, end) = (0, self.first + self.n);
        let mut named = Vec::new();
        for tensor in self.tensors {
            let rows = self.first.max(first) - first..end.min(first + tensor.rows()).max(first) - first;
            first += tensor.rows();
            if !rows.is_empty() {
                named.push((tensor.name().to_owned(), rows));
            }
        }
        named
    }

    /// The tensor and its row for output `row`.
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

    /// Output `row` in the needed order.
    fn floats<'a>(&self, row: usize, buffer: &'a mut RowBuffer) -> Result<&'a [f32], LoadError> {
        let (tensor, row) = self.locate(row);
        tensor.read_row(row, &mut buffer.stored)?;
        Ok(self.order.sort(&buffer.stored, &mut buffer.sorted))
    }

    /// Output `row` as quantized values with their `scale`, in the needed order.
    fn codes<'a>(&'a self, row: usize, buffer: &'a mut RowBuffer, scale: &mut f32) -> Result<&'a [i8], LoadError> {
        let (tensor, source) = self.locate(row);
        if let Some((stored, of_row)) = tensor.int8_row(source, &mut buffer.unpacked) {
            *scale = of_row;
            return Ok(self.order.sort(stored, &mut buffer.codes));
        }
        tensor.read_row(source, &mut buffer.stored)?;
        let values = self.order.sort(&buffer.stored, &mut buffer.sorted);
        *scale = quantize_weight_row(values, &mut buffer.codes).expect("both `k` long");
        Ok(&buffer.codes)
    }
}

/// A table for reading rows by index, `[rows, cols]`.
#[derive(Debug)]
pub struct Table {
    values: TableValues,
    rows: usize,
    cols: usize,
}

#[derive(Debug)]
enum TableValues {
    F32(AlignedBox<f32>),
    Bf16(AlignedBox<Bf16>),
}

impl Table {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Copies row `row` to `out [cols]`. Panics if `row` is out of range.
    pub fn gather(&self, row: usize, out: &mut [f32]) {
        self.visit(row, out, |out, v| *out = v);
    }

    /// Adds row `row` to `out [cols]`. Panics if `row` is out of range.
    pub fn add(&self, row: usize, out: &mut [f32]) {
        self.visit(row, out, |out, v| *out += v);
    }

    fn visit(&self, row: usize, out: &mut [f32], f: impl Fn(&mut f32, f32)) {
        let range = row * self.cols..(row + 1) * self.cols;
        match &self.values {
            TableValues::F32(values) => out.iter_mut().zip(&values[range]).for_each(|(out, &v)| f(out, v)),
            TableValues::Bf16(values) => {
                out.iter_mut().zip(&values[range]).for_each(|(out, &v)| f(out, v.to_f32()));
            }
        }
    }
}
