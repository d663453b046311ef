//! Deterministic writer of model files: the same model always gives the same bytes.

use std::collections::BTreeMap;
use std::io::{self, Seek, SeekFrom, Write};

use half::{bf16, f16};
use serde::Serialize;
use umo_kernels::quantize::quantize_weight_row;

use super::checksum::{self, Summed};
use super::parallel::*;
use super::{FORMAT_VERSION, int4};
use crate::config::Config;

/// Storage of a tensor's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// 32-bit floats.
    F32,
    /// 16-bit floats.
    F16,
    /// bfloat16.
    Bf16,
    /// Int8 values, with an F32 tensor `NAME.scale` of one per row of the first dimension.
    Int8,
    /// Int4 codes, two per byte, with an I8 tensor `NAME.multipliers` of one per 32 values of a row, and an F32
    /// tensor `NAME.scale` of one per row.
    Int4,
    /// Raw bytes.
    Bytes,
}

impl Storage {
    /// Name of the type in a model file's header, such as `BF16`.
    pub const fn dtype(self) -> &'static str {
        match self {
            Self::F32 => "F32",
            Self::F16 => "F16",
            Self::Bf16 => "BF16",
            Self::Int8 => "I8",
            Self::Int4 | Self::Bytes => "U8",
        }
    }

    /// Whether values are integers with scales.
    pub const fn is_quantized(self) -> bool {
        matches!(self, Self::Int8 | Self::Int4)
    }
}

/// Source of a tensor's values, read on writing, one tensor at a time.
pub enum Values<'a> {
    /// Numbers, in the file's order.
    Floats(Box<dyn Fn() -> io::Result<Vec<f32>> + 'a>),
    /// Bytes, for [`Storage::Bytes`].
    Bytes(&'a [u8]),
    /// Codes quantized in advance, for [`Storage::Int8`] and [`Storage::Int4`].
    Codes(Box<dyn Fn() -> io::Result<Codes> + 'a>),
}

/// Rows of a tensor in int8 or int4.
#[derive(Clone, Debug, PartialEq)]
pub struct Codes {
    /// One scale per row.
    pub scale: Vec<f32>,
    /// For int4, one multiplier per group of each row; empty for int8.
    pub multipliers: Vec<i8>,
    /// Int8 values or int4 codes, one per value of the tensor.
    pub codes: Vec<i8>,
}

impl std::fmt::Debug for Values<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Floats(_) => "Floats",
            Self::Bytes(_) => "Bytes",
            Self::Codes(_) => "Codes",
        })
    }
}

/// One tensor to be written.
#[derive(Debug)]
pub struct NewTensor<'a> {
    /// Name in the file.
    pub name: String,
    /// Shape; its product is the number of values.
    pub shape: Vec<usize>,
    /// Storage of the values.
    pub storage: Storage,
    /// Its values.
    pub values: Values<'a>,
}

/// One entry of the header; field order is the file's.
#[derive(Serialize)]
struct Entry {
    dtype: &'static str,
    shape: Vec<usize>,
    data_offsets: [usize; 2],
}

/// Writes a model file with its checksums, at the current position of `out`.
///
/// # Errors
/// The system's error.
pub fn write(out: &mut (impl Write + Seek), config: &Config, tensors: &[NewTensor]) -> io::Result<()> {
    let start = out.stream_position()?;
    let config = serde_json::to_string(config)?;
    let write_header = |out: &mut dyn Write, sum| -> io::Result<()> {
        let mut header = header(&config, sum, tensors)?;
        checksum::seal(&mut header);
        out.write_all(&(header.len() as u64).to_le_bytes())?;
        out.write_all(header.as_bytes())
    };
    // The checksum is known only after writing everything: the header, whose length does not depend on it, is then
    // written again.
    write_header(out, 0)?;
    let mut summed = Summed::new(&mut *out, &config);
    tensors.iter().try_for_each(|tensor| write_values(&mut summed, tensor))?;
    let sum = summed.finish();
    let end = out.stream_position()?;
    out.seek(SeekFrom::Start(start))?;
    write_header(out, sum)?;
    out.seek(SeekFrom::Start(end))?;
    Ok(())
}

fn header(config: &str, sum: u32, tensors: &[NewTensor]) -> io::Result<String> {
    let mut entries = BTreeMap::new();
    let metadata = BTreeMap::from([
        (checksum::KEY, checksum::text(sum)),
        ("config", config.to_owned()),
        ("format", "umo".to_owned()),
        (checksum::HEADER_KEY, checksum::text(0)),
        ("version", FORMAT_VERSION.to_owned()),
    ]);
    entries.insert("__metadata__".to_owned(), serde_json::to_value(metadata)?);
    let mut end = 0;
    let mut add = |name: String, dtype, shape: Vec<usize>, len: usize| -> io::Result<()> {
        let entry = Entry { dtype, shape, data_offsets: [end, end + len] };
        end += len;
        entries.insert(name, serde_json::to_value(entry)?);
        Ok(())
    };
    for tensor in tensors {
        let values = tensor.shape.iter().product::<usize>();
        let (name, mut shape) = (&tensor.name, tensor.shape.clone());
        if tensor.storage.is_quantized() {
            let rows = shape[0];
            add(format!("{name}.scale"), "F32", vec![rows], 4 * rows)?;
        }
        let len = match tensor.storage {
            Storage::F32 => 4 * values,
            Storage::F16 | Storage::Bf16 => 2 * values,
            Storage::Int8 | Storage::Bytes => values,
            Storage::Int4 => {
                let (rows, inputs) = (shape[0], shape[1..].iter().product());
                let groups = int4::groups(inputs);
                add(format!("{name}.multipliers"), "I8", vec![rows, groups], rows * groups)?;
                shape = vec![rows, int4::row_bytes(inputs)];
                rows * int4::row_bytes(inputs)
            }
        };
        add(name.clone(), tensor.storage.dtype(), shape, len)?;
    }
    let mut text = serde_json::to_string(&entries)?;
    // Data starts at a multiple of 64, so that a memory map is aligned for any type.
    while !(text.len() + 8).is_multiple_of(64) {
        text.push(' ');
    }
    Ok(text)
}

fn write_values(out: &mut impl Write, tensor: &NewTensor) -> io::Result<()> {
    let values = match &tensor.values {
        Values::Bytes(bytes) => return out.write_all(bytes),
        Values::Floats(values) => values()?,
        Values::Codes(codes) => return write_codes(out, tensor, &codes()?),
    };
    match tensor.storage {
        Storage::F32 => write_all(out, &values, |v| v.to_le_bytes()),
        Storage::F16 => write_all(out, &values, |v| f16::from_f32(v).to_le_bytes()),
        Storage::Bf16 => write_all(out, &values, |v| bf16::from_f32(v).to_le_bytes()),
        Storage::Int8 => write_int8(out, &values, tensor.shape[0]),
        Storage::Int4 => write_int4(out, &values, tensor.shape[0]),
        Storage::Bytes => Err(io::Error::other(format!("tensor `{}`: bytes expected, numbers given", tensor.name))),
    }
}

/// Writes values in pieces that fit the processor's cache.
fn write_all<T: Copy, const N: usize>(
    out: &mut impl Write,
    values: &[T],
    bytes: impl Fn(T) -> [u8; N],
) -> io::Result<()> {
    const PIECE: usize = 4096;
    let mut piece = Vec::with_capacity(PIECE * N);
    for values in values.chunks(PIECE) {
        piece.clear();
        values.iter().for_each(|&v| piece.extend_from_slice(&bytes(v)));
        out.write_all(&piece)?;
    }
    Ok(())
}

/// Writes the scales of all rows, then their values.
fn write_int8(out: &mut impl Write, values: &[f32], rows: usize) -> io::Result<()> {
    let width = (values.len() / rows.max(1)).max(1);
    let (mut steps, mut scales) = (vec![0_i8; values.len()], vec![0.0; rows]);
    let all = values.par_chunks_exact(width).zip(steps.par_chunks_exact_mut(width)).zip(&mut scales);
    all.try_for_each_init(
        || (),
        |(), ((row, steps), scale)| {
            *scale = quantize_weight_row(row, steps).map_err(io::Error::other)?;
            io::Result::Ok(())
        },
    )?;
    write_all(out, &scales, f32::to_le_bytes)?;
    write_all(out, &steps, i8::to_le_bytes)
}

/// Writes codes quantized in advance.
fn write_codes(out: &mut impl Write, tensor: &NewTensor, codes: &Codes) -> io::Result<()> {
    let (rows, values) = (tensor.shape[0], tensor.shape.iter().product::<usize>());
    let groups = match tensor.storage {
        Storage::Int8 => 0,
        Storage::Int4 => int4::groups(values / rows.max(1)),
        _ => return Err(io::Error::other(format!("tensor `{}`: numbers expected, codes given", tensor.name))),
    };
    if (codes.scale.len(), codes.multipliers.len(), codes.codes.len()) != (rows, rows * groups, values) {
        return Err(io::Error::other(format!("tensor `{}`: codes of another shape", tensor.name)));
    }
    write_all(out, &codes.scale, f32::to_le_bytes)?;
    if tensor.storage == Storage::Int8 {
        return write_all(out, &codes.codes, i8::to_le_bytes);
    }
    write_int4_codes(out, codes, values / rows.max(1))
}

/// Writes multipliers and codes of rows of `width` values.
fn write_int4_codes(out: &mut impl Write, Codes { multipliers, codes, .. }: &Codes, width: usize) -> io::Result<()> {
    let bytes: Vec<u8> = codes.chunks_exact(width.max(1)).flat_map(|row| row.chunks(2).map(int4::byte)).collect();
    write_all(out, multipliers, i8::to_le_bytes)?;
    out.write_all(&bytes)
}

/// Writes the scales of all rows, their multipliers, then their codes.
fn write_int4(out: &mut impl Write, values: &[f32], rows: usize) -> io::Result<()> {
    let width = (values.len() / rows.max(1)).max(1);
    let groups = int4::groups(width);
    let (mut codes, mut multipliers, mut scales) = (vec![0; values.len()], vec![0; rows * groups], vec![0.0; rows]);
    let quantized = codes.par_chunks_exact_mut(width).zip(multipliers.par_chunks_exact_mut(groups));
    let all = values.par_chunks_exact(width).zip(quantized).zip(&mut scales);
    all.try_for_each_init(
        || vec![1.0; width],
        |importance, ((row, (codes, multipliers)), scale)| {
            *scale = int4::quantize_row(row, importance, codes, multipliers);
            io::Result::Ok(())
        },
    )?;
    write_all(out, &scales, f32::to_le_bytes)?;
    write_int4_codes(out, &Codes { scale: scales, multipliers, codes }, width)
}
