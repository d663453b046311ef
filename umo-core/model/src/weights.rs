//! The only reader of model files: bytes to checked tensors. Each error names its cause.

mod checksum;
mod header;
pub mod int4;
pub mod layout;
mod loader;
mod parallel;
mod source;
pub mod writer;

use std::collections::HashMap;
#[cfg(feature = "files")]
use std::path::Path;

use half::{bf16, f16};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, Metadata, TensorInfo};
use umo_kernels::pack::{GROUP, MAX_MULTIPLIER};

pub use loader::{Loader, Table, load_layers};
pub use umo_core_base::aligned::{AlignedBox, Plain};
use umo_core_base::error::LoadError;
use umo_core_base::memory::{self, SPARE, filled};
use umo_core_base::state::Fingerprint;

use crate::config::Config;
use source::Source;
use writer::Storage;

/// The version of the format that this library reads and writes.
pub const FORMAT_VERSION: &str = "1";

/// A model file: its bytes (mapped, owned or static), its config, and the location of each tensor.
#[derive(Debug)]
pub struct ModelFile {
    source: Source,
    config: Config,
    tensors: HashMap<String, TensorInfo>,
    data_start: usize,
    /// Checksum in the file, and the text of its config, which is covered by it.
    checksum: Option<(u32, String)>,
}

/// Largest size at which the checksum is verified on opening: 2 ms for the default model. Larger files would be read
/// twice; [`ModelFile::verify`] checks them.
const CHECKED_WHEN_OPENED: usize = 256 << 20;

impl ModelFile {
    /// Maps a file and checks its structure and config; tensors are checked as they are loaded.
    ///
    /// # Errors
    /// [`LoadError`] naming the file, key or tensor.
    #[cfg(feature = "files")]
    pub fn open(path: &Path) -> Result<Self, LoadError> {
        Self::from_source(Source::open(path)?)
    }

    /// Reads a model file from memory.
    ///
    /// # Errors
    /// [`LoadError`] naming the key or tensor.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, LoadError> {
        Self::from_source(Source::Owned(bytes))
    }

    /// Reads a model file from static bytes, without copying them.
    ///
    /// # Errors
    /// [`LoadError`] naming the key or tensor.
    pub fn from_static(bytes: &'static [u8]) -> Result<Self, LoadError> {
        Self::from_source(Source::Static(bytes))
    }

    fn from_source(source: Source) -> Result<Self, LoadError> {
        let bytes = source.bytes();
        // Parsing a header of this size takes several times its memory, for its names, maps and config.
        let header_len = bytes.first_chunk().map_or(0, |len| u64::from_le_bytes(*len)).min(bytes.len() as u64);
        memory::check(16 * usize::try_from(header_len).unwrap_or(usize::MAX / 16) + SPARE)?;
        let end = usize::try_from(header_len).unwrap_or(usize::MAX).saturating_add(8).min(bytes.len());
        let has_header_checksum = checksum::check_header(bytes.get(8..end).unwrap_or_default())?;
        memory::watch(|| header::check(bytes))??;
        let parsed = memory::watch(|| SafeTensors::read_metadata(bytes))?;
        let (header_len, metadata) = parsed.map_err(|error| LoadError::File(error.to_string()))?;
        let data_start = header_len + 8;
        let want = data_start + data_len(&metadata);
        if bytes.len() != want {
            return Err(LoadError::File(format!("expected {want} bytes, got {}", bytes.len())));
        }
        let config_text = config_text(&metadata)?;
        let config = memory::watch(|| Config::parse(config_text))??;
        let entry = |key: &str| metadata.metadata().as_ref().and_then(|entries| entries.get(key));
        if let (Some(said), false) = (entry(checksum::HEADER_KEY), has_header_checksum) {
            return Err(checksum::wrong(checksum::HEADER_KEY, said));
        }
        let checksum = match entry(checksum::KEY) {
            Some(said) => Some((checksum::parse(said)?, config_text.to_owned())),
            None => None,
        };
        let tensors = metadata.tensors().into_iter().map(|(name, info)| (name, info.clone())).collect();
        let file = Self { source, config, tensors, data_start, checksum };
        if file.len() <= CHECKED_WHEN_OPENED {
            file.verify()?;
        }
        Ok(file)
    }

    /// Verifies the file's checksum; returns whether it has one.
    ///
    /// # Errors
    /// [`LoadError::File`] if the bytes were changed after writing.
    pub fn verify(&self) -> Result<bool, LoadError> {
        let Some((said, config)) = &self.checksum else { return Ok(false) };
        let found = checksum::sum(config, &self.source.bytes()[self.data_start..]);
        if found == *said {
            return Ok(true);
        }
        Err(LoadError::File(format!(
            "it is damaged: its checksum is {}, expected {}; copy or download it again",
            checksum::text(found),
            checksum::text(*said)
        )))
    }

    /// The model's config.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Size of the file, bytes.
    #[doc(hidden)]
    pub fn len(&self) -> usize {
        self.source.bytes().len()
    }

    /// Whether the file is empty; never true for an opened file.
    #[doc(hidden)]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Name, type name, shape and number of bytes of every tensor, by name.
    #[doc(hidden)]
    pub fn tensors(&self) -> Vec<(&str, String, &[usize], usize)> {
        let mut list: Vec<_> = self
            .tensors
            .iter()
            .map(|(name, info)| {
                let bytes = info.data_offsets.1 - info.data_offsets.0;
                (name.as_str(), info.dtype.to_string(), info.shape.as_slice(), bytes)
            })
            .collect();
        list.sort_unstable_by_key(|(name, ..)| *name);
        list
    }

    /// Hash that identifies this model and its `usage`: of its config, and of evenly spread samples of every tensor.
    /// Cheap compared with loading.
    pub(crate) fn fingerprint(&self, usage: &str) -> u64 {
        /// Number of samples, and bytes in each.
        const PLACES: usize = 16;
        let mut sum = Fingerprint::new();
        sum.add(usage.as_bytes());
        serde_json::to_writer(&mut sum, &self.config).expect("a config came from such a text");
        let mut tensors = memory::with_capacity(self.tensors.len());
        tensors.extend(&self.tensors);
        tensors.sort_unstable_by_key(|(name, _)| *name);
        for (name, info) in tensors {
            sum.add(name.as_bytes());
            sum.add(format!("{:?} {:?}", info.dtype, info.shape).as_bytes());
            let bytes = self.slice(info);
            let last = bytes.len().saturating_sub(PLACES);
            for place in 0..PLACES {
                let start = last * place / (PLACES - 1);
                sum.add(&bytes[start..bytes.len().min(start + PLACES)]);
            }
        }
        sum.0
    }

    /// Whether the file has a tensor of this name.
    #[doc(hidden)]
    pub fn has(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    /// Whether the file has a tensor whose name starts with `prefix`.
    #[doc(hidden)]
    pub fn has_any(&self, prefix: &str) -> bool {
        self.tensors.keys().any(|name| name.starts_with(prefix))
    }

    /// Storage of a tensor, if this library can write it.
    ///
    /// # Errors
    /// [`LoadError::Tensor`] if it is missing or has a type that no umo model has.
    #[doc(hidden)]
    pub fn storage(&self, name: &str) -> Result<Storage, LoadError> {
        match self.info(name)?.dtype {
            Dtype::F32 => Ok(Storage::F32),
            Dtype::F16 => Ok(Storage::F16),
            Dtype::BF16 => Ok(Storage::Bf16),
            Dtype::I8 => Ok(Storage::Int8),
            Dtype::U8 if self.has(&multipliers(name)) => Ok(Storage::Int4),
            Dtype::U8 => Ok(Storage::Bytes),
            other => Err(LoadError::tensor(name, format!("expected F32, F16, BF16, I8 or U8, got {other}"))),
        }
    }

    /// Bytes of a one-dimensional U8 tensor, such as `text.tokenizer`.
    ///
    /// # Errors
    /// [`LoadError::Tensor`] if it is missing or has another type.
    #[doc(hidden)]
    pub fn raw(&self, name: &str) -> Result<&[u8], LoadError> {
        let info = self.info(name)?;
        if info.dtype != Dtype::U8 || info.shape.len() != 1 {
            return Err(LoadError::tensor(
                name,
                format!("expected U8 of one dimension, got {} {:?}", info.dtype, info.shape),
            ));
        }
        Ok(self.slice(info))
    }

    /// Returns the tensor `name`, which must have this `shape`: F32, F16, BF16, I8 with `name.scale`, or int4 codes
    /// of that shape in U8 with `name.scale` and `name.multipliers`.
    ///
    /// # Errors
    /// [`LoadError::Tensor`] if it is missing or has another shape or type.
    #[doc(hidden)]
    pub fn tensor(&self, name: &str, shape: &[usize]) -> Result<Tensor<'_>, LoadError> {
        let info = self.info(name)?;
        let (rows, cols) = (shape.first().copied().unwrap_or(1), shape.iter().skip(1).product());
        let int4 = info.dtype == Dtype::U8 && self.has(&multipliers(name));
        let stored = if int4 { &[rows, int4::row_bytes(cols)] } else { shape };
        if info.shape != stored {
            let what = if int4 { format!(" for int4 codes of {shape:?}") } else { String::new() };
            return Err(LoadError::tensor(name, format!("expected {stored:?}{what}, got {:?}", info.shape)));
        }
        let bytes = self.slice(info);
        let data = match info.dtype {
            Dtype::U8 if int4 => self.int4(name, bytes, rows, cols)?,
            Dtype::F32 => Data::F32(bytes.as_chunks().0),
            Dtype::F16 => Data::F16(bytes.as_chunks().0),
            Dtype::BF16 => Data::Bf16(bytes.as_chunks().0),
            Dtype::I8 => Data::I8(source::signed(bytes), self.scales(name, rows)?),
            other => {
                return Err(LoadError::tensor(name, format!("expected F32, F16, BF16 or I8, got {other}")));
            }
        };
        Ok(Tensor { name: name.to_owned(), data, rows, cols })
    }

    /// Int4 codes with the multipliers and scales of their rows.
    fn int4<'a>(&'a self, name: &str, codes: &'a [u8], rows: usize, cols: usize) -> Result<Data<'a>, LoadError> {
        let groups = int4::groups(cols);
        let name_of_multipliers = multipliers(name);
        let info = self.info(&name_of_multipliers)?;
        if info.dtype != Dtype::I8 || info.shape != [rows, groups] {
            let problem = format!("expected I8 [{rows}, {groups}], got {} {:?}", info.dtype, info.shape);
            return Err(LoadError::tensor(name_of_multipliers, problem));
        }
        let multipliers = source::signed(self.slice(info));
        let limit = MAX_MULTIPLIER.unsigned_abs();
        if let Some(at) = multipliers.iter().position(|multiplier| multiplier.unsigned_abs() > limit) {
            let (row, group, value) = (at / groups, at % groups, multipliers[at]);
            let problem = format!("value [{row}, {group}] is {value}, not within -{limit} to {limit}");
            return Err(LoadError::tensor(name_of_multipliers, problem));
        }
        Ok(Data::I4 { codes, multipliers, scale: self.scales(name, rows)? })
    }

    fn scales(&self, name: &str, rows: usize) -> Result<Vec<f32>, LoadError> {
        let scale = self.tensor(&format!("{name}.scale"), &[rows])?;
        let mut values = filled(0.0, rows);
        if scale.storage().is_quantized() {
            let problem = format!("expected F32, got {}", scale.storage().dtype());
            return Err(LoadError::tensor(scale.name, problem));
        }
        scale.read(&mut values)?;
        // A weight is an int8 value times its scale.
        if let Some(row) = values.iter().position(|scale| !(scale * 128.0).is_finite()) {
            let problem = format!("value [{row}] is {:e}: the weights of its row would not be finite", values[row]);
            return Err(LoadError::tensor(scale.name, problem));
        }
        Ok(values)
    }

    fn info(&self, name: &str) -> Result<&TensorInfo, LoadError> {
        self.tensors.get(name).ok_or_else(|| LoadError::tensor(name, "missing"))
    }

    fn slice(&self, info: &TensorInfo) -> &[u8] {
        &self.source.bytes()[self.data_start + info.data_offsets.0..self.data_start + info.data_offsets.1]
    }

    /// Tells the system that the pages of `tensor` were read and need not stay in memory.
    #[doc(hidden)]
    pub fn release(&self, tensor: &Tensor) {
        let (start, len) = tensor.extent();
        self.source.release(start as usize - self.source.bytes().as_ptr() as usize, len);
    }
}

/// Name of the multipliers of the int4 tensor `name`.
fn multipliers(name: &str) -> String {
    format!("{name}.multipliers")
}

fn data_len(metadata: &Metadata) -> usize {
    metadata.tensors().values().map(|info| info.data_offsets.1).max().unwrap_or(0)
}

fn config_text(metadata: &Metadata) -> Result<&str, LoadError> {
    let entries = metadata.metadata().as_ref();
    let entry = |key: &str| entries.and_then(|entries| entries.get(key)).map(String::as_str);
    match entry("format") {
        Some("umo") => {}
        Some(other) => return Err(LoadError::File(format!("metadata `format`: expected \"umo\", got {other:?}"))),
        None => return Err(LoadError::File("not a umo model: metadata `format` is missing".to_owned())),
    }
    match entry("version") {
        Some(FORMAT_VERSION) => {}
        other => {
            let got = other.unwrap_or("nothing");
            return Err(LoadError::File(format!("metadata `version`: expected \"{FORMAT_VERSION}\", got {got:?}")));
        }
    }
    entry("config").ok_or_else(|| LoadError::File("metadata `config` is missing".to_owned()))
}

/// A tensor of the file, as rows along its first dimension.
#[derive(Debug)]
pub struct Tensor<'a> {
    name: String,
    data: Data<'a>,
    rows: usize,
    cols: usize,
}

/// Values as stored (little-endian, unaligned).
#[derive(Debug)]
enum Data<'a> {
    F32(&'a [[u8; 4]]),
    F16(&'a [[u8; 2]]),
    Bf16(&'a [[u8; 2]]),
    I8(&'a [i8], Vec<f32>),
    I4 { codes: &'a [u8], multipliers: &'a [i8], scale: Vec<f32> },
}

impl Tensor<'_> {
    /// Name in the file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Number of rows: the first dimension.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of values per row.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Storage of the values.
    pub fn storage(&self) -> Storage {
        match self.data {
            Data::F32(_) => Storage::F32,
            Data::F16(_) => Storage::F16,
            Data::Bf16(_) => Storage::Bf16,
            Data::I8(..) => Storage::Int8,
            Data::I4 { .. } => Storage::Int4,
        }
    }

    /// Reads row `row` into `out [cols]`.
    ///
    /// # Errors
    /// [`LoadError::Tensor`] if a value is not finite.
    pub fn read_row(&self, row: usize, out: &mut [f32]) -> Result<(), LoadError> {
        let range = row * self.cols..(row + 1) * self.cols;
        match &self.data {
            Data::F32(data) => convert(&data[range], out, |v| f32::from_le_bytes(*v)),
            Data::F16(data) => convert(&data[range], out, |v| f16::from_le_bytes(*v).to_f32()),
            Data::Bf16(data) => convert(&data[range], out, |v| bf16::from_le_bytes(*v).to_f32()),
            Data::I8(data, scale) => convert(&data[range], out, |&v| f32::from(v) * scale[row]),
            Data::I4 { scale, .. } => {
                let (codes, multipliers) = (self.int4_codes(row), self.multipliers(row));
                for (i, out) in out.iter_mut().enumerate() {
                    *out = f32::from(int4::code(codes, i) * multipliers[i / GROUP]) * scale[row];
                }
            }
        }
        // No early exit, so that it vectorizes.
        if out.iter().fold(true, |finite, v| finite & v.is_finite()) {
            return Ok(());
        }
        let at = out.iter().position(|v| !v.is_finite()).unwrap_or_default();
        Err(LoadError::tensor(&*self.name, format!("value [{row}, {at}] is {}, not a finite number", out[at])))
    }

    /// Returns the int8 values of row `row` and their scale, if the tensor is stored as int8, or as int4, which are
    /// expanded into `buffer [cols]`.
    pub fn int8_row<'a>(&'a self, row: usize, buffer: &'a mut [i8]) -> Option<(&'a [i8], f32)> {
        match &self.data {
            Data::I8(data, scale) => Some((&data[row * self.cols..(row + 1) * self.cols], scale[row])),
            Data::I4 { scale, .. } => {
                let (codes, multipliers) = (self.int4_codes(row), self.multipliers(row));
                for (i, value) in buffer.iter_mut().enumerate() {
                    *value = int4::code(codes, i) * multipliers[i / GROUP];
                }
                Some((buffer, scale[row]))
            }
            _ => None,
        }
    }

    /// Writes the int4 codes of row `row` to `codes [cols]`; returns the multipliers of its groups and its scale, if
    /// the tensor is stored as int4.
    pub fn int4_row(&self, row: usize, codes: &mut [i8]) -> Option<(&[i8], f32)> {
        let Data::I4 { scale, .. } = &self.data else { return None };
        let stored = self.int4_codes(row);
        codes.iter_mut().enumerate().for_each(|(i, out)| *out = int4::code(stored, i));
        Some((self.multipliers(row), scale[row]))
    }

    /// Bytes of a row's int4 codes; empty if the tensor is not int4.
    fn int4_codes(&self, row: usize) -> &[u8] {
        let len = int4::row_bytes(self.cols);
        match &self.data {
            Data::I4 { codes, .. } => &codes[row * len..(row + 1) * len],
            _ => &[],
        }
    }

    /// Multipliers of a row's groups; empty if the tensor is not int4.
    fn multipliers(&self, row: usize) -> &[i8] {
        let groups = int4::groups(self.cols);
        match &self.data {
            Data::I4 { multipliers, .. } => &multipliers[row * groups..(row + 1) * groups],
            _ => &[],
        }
    }

    /// Reads every value.
    ///
    /// # Errors
    /// [`LoadError::Tensor`] if a value is not finite.
    pub fn read(&self, out: &mut [f32]) -> Result<(), LoadError> {
        if self.cols == 0 {
            return Ok(());
        }
        out.chunks_exact_mut(self.cols).enumerate().try_for_each(|(row, out)| self.read_row(row, out))
    }

    /// Address and number of the bytes in memory.
    fn extent(&self) -> (*const u8, usize) {
        match &self.data {
            Data::F32(data) => (data.as_ptr().cast(), size_of_val(*data)),
            Data::F16(data) | Data::Bf16(data) => (data.as_ptr().cast(), size_of_val(*data)),
            Data::I8(data, _) => (data.as_ptr().cast(), data.len()),
            Data::I4 { codes, .. } => (codes.as_ptr(), codes.len()),
        }
    }
}

fn convert<T>(data: &[T], out: &mut [f32], f: impl Fn(&T) -> f32) {
    for (out, value) in out.iter_mut().zip(data) {
        *out = f(value);
    }
}
