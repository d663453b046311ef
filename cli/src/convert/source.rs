//! A safetensors file that is not a umo model; tensors are read one at a time.

use std::cell::RefCell;
use std::fmt;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use half::{bf16, f16};
use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};

use crate::failure::Failure;

/// Upper bound that the format sets on the header's length.
const MAX_HEADER: u64 = 100_000_000;

/// An open file and its tensors' locations.
#[derive(Debug)]
pub(super) struct Source {
    path: PathBuf,
    /// File handle, seeked to each tensor before it is read.
    file: RefCell<File>,
    metadata: Metadata,
    data_start: u64,
}

impl Source {
    /// Reads the header and checks that the file has the announced length.
    fn open(path: &Path) -> Result<Self, Failure> {
        let failure = |problem: &dyn fmt::Display| Failure::input(format!("{}: {problem}", path.display()));
        let mut file = umo_core_base::file::open(path).map_err(|cause| failure(&cause))?;
        let (header, len) =
            header(&mut file).map_err(|cause| failure(&format_args!("no safetensors file: {cause}")))?;
        let metadata: Metadata =
            serde_json::from_slice(&header).map_err(|error| failure(&format_args!("no safetensors file: {error}")))?;
        let data_start = 8 + header.len() as u64;
        let want = data_start + metadata.data_len() as u64;
        if len != want {
            return Err(failure(&format_args!("expected {want} bytes, got {len}: fetch it again")));
        }
        Ok(Self { path: path.to_owned(), file: RefCell::new(file), metadata, data_start })
    }

    /// Opens the file at `path`, or all files of a folder, which are shards of one checkpoint.
    pub(super) fn open_all(path: &Path) -> Result<Vec<Self>, Failure> {
        if !path.is_dir() {
            return Ok(vec![Self::open(path)?]);
        }
        let failure = |problem: &dyn fmt::Display| Failure::input(format!("{}: {problem}", path.display()));
        let entries = path.read_dir().and_then(Iterator::collect::<io::Result<Vec<_>>>);
        let mut paths: Vec<_> = entries.map_err(|cause| failure(&cause))?.iter().map(std::fs::DirEntry::path).collect();
        paths.retain(|path| path.extension().is_some_and(|extension| extension == "safetensors"));
        paths.sort_unstable();
        if paths.is_empty() {
            return Err(failure(&"no .safetensors in it; training/ converts other formats"));
        }
        paths.iter().map(|path| Self::open(path)).collect()
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns names and shapes, sorted by name.
    pub(super) fn tensors(&self) -> Vec<(String, Vec<usize>)> {
        let tensors = self.metadata.tensors().into_iter();
        let mut list: Vec<_> = tensors.map(|(name, info)| (name, info.shape.clone())).collect();
        list.sort_unstable();
        list
    }

    /// Reads all values of a tensor.
    pub(super) fn read(&self, name: &str) -> Result<Vec<f32>, Failure> {
        let failure =
            |problem: &dyn fmt::Display| Failure::input(format!("{}: tensor `{name}`: {problem}", self.path.display()));
        let info = self.metadata.info(name).ok_or_else(|| failure(&"missing"))?;
        let bytes = self.bytes(info).map_err(|cause| failure(&cause))?;
        let values: Vec<f32> = match info.dtype {
            Dtype::F32 => bytes.as_chunks().0.iter().map(|v| f32::from_le_bytes(*v)).collect(),
            Dtype::F16 => bytes.as_chunks().0.iter().map(|v| f16::from_le_bytes(*v).to_f32()).collect(),
            Dtype::BF16 => bytes.as_chunks().0.iter().map(|v| bf16::from_le_bytes(*v).to_f32()).collect(),
            // k-means centroids may be F64.
            #[expect(clippy::cast_possible_truncation, reason = "a value too large becomes infinite and is refused")]
            Dtype::F64 => bytes.as_chunks().0.iter().map(|v| f64::from_le_bytes(*v) as f32).collect(),
            other => return Err(failure(&format_args!("expected F32, F16, BF16 or F64, got {other}"))),
        };
        match values.iter().find(|v| !v.is_finite()) {
            Some(value) => Err(failure(&format_args!("{value} among the values, not a finite number"))),
            None => Ok(values),
        }
    }

    fn bytes(&self, info: &TensorInfo) -> io::Result<Vec<u8>> {
        let (start, end) = info.data_offsets;
        let mut file = self.file.borrow_mut();
        file.seek(SeekFrom::Start(self.data_start + start as u64))?;
        let mut bytes = vec![0; end - start];
        file.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

/// Returns the header's text and the length of the file in bytes.
fn header(file: &mut File) -> io::Result<(Vec<u8>, u64)> {
    let len = file.metadata()?.len();
    let mut size = [0; 8];
    file.read_exact(&mut size)?;
    let size = u64::from_le_bytes(size);
    if size > MAX_HEADER.min(len) {
        return Err(io::Error::other("its header would be longer than it may be"));
    }
    let mut header = Vec::new();
    file.take(size).read_to_end(&mut header)?;
    Ok((header, len))
}
