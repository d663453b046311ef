//! A first look at a file's header, so that a tensor whose bytes cannot be what it claims is called
//! by its name.

use std::collections::BTreeMap;

use safetensors::tensor::TensorInfo;
use serde_json::value::RawValue;

use crate::error::LoadError;

/// Checks each tensor by itself: that its bytes are in the file, and as many as its shape and type
/// need. What is wrong with the header as a whole is left to its reader.
pub(super) fn check(bytes: &[u8]) -> Result<(), LoadError> {
    let Some((entries, data)) = split(bytes) else { return Ok(()) };
    for (name, entry) in entries.iter().filter(|(name, _)| *name != "__metadata__") {
        let info: TensorInfo =
            serde_json::from_str(entry.get()).map_err(|error| LoadError::tensor(name, error.to_string()))?;
        let (start, end) = info.data_offsets;
        if start > end || end > data {
            let problem =
                format!("bytes {start} to {end} of the data, which has {data}: the file is cut, or its header wrong");
            return Err(LoadError::tensor(name, problem));
        }
        let bits = info.shape.iter().try_fold(info.dtype.bitsize(), |bits, &n| bits.checked_mul(n));
        if bits != Some(8 * (end - start)) {
            let problem =
                format!("{} {:?} does not take the {} bytes that it has", info.dtype, info.shape, end - start);
            return Err(LoadError::tensor(name, problem));
        }
    }
    Ok(())
}

/// The header's entries and the number of bytes after it.
fn split(bytes: &[u8]) -> Option<(BTreeMap<String, &RawValue>, usize)> {
    let (len, rest) = bytes.split_first_chunk()?;
    let (header, data) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*len)).ok()?)?;
    Some((serde_json::from_slice(header).ok()?, data.len()))
}
