//! Hashes of files.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::failure::Failure;

/// Returns the SHA-256 of a file's contents.
pub(super) fn file_hash(path: &Path) -> Result<String, Failure> {
    let wrong = |cause: std::io::Error| Failure::input(format!("{}: {cause}", path.display()));
    let mut file = File::open(path).map_err(wrong)?;
    let (mut hash, mut piece) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        let count = file.read(&mut piece).map_err(wrong)?;
        if count == 0 {
            return Ok(data_encoding::HEXLOWER.encode(&hash.finalize()));
        }
        hash.update(&piece[..count]);
    }
}
