//! Early check of a file's header, which names a tensor whose bytes do not match its declaration.

use std::collections::BTreeMap;

use safetensors::tensor::TensorInfo;
use serde_json::value::RawValue;

use umo_core_base::error::LoadError;

/// Checks each tensor: its bytes must lie within the file and match its shape and type. Other errors of the header
/// are left to its parser.
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

/// Entries of the header, and the number of bytes after it.
fn split(bytes: &[u8]) -> Option<(BTreeMap<String, &RawValue>, usize)> {
    let (len, rest) = bytes.split_first_chunk()?;
    let (header, data) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*len)).ok()?)?;
    Some((serde_json::from_slice(header).ok()?, data.len()))
}
