//! Animations that were written before, read back.

pub(crate) mod glb;
pub(crate) mod npz;

use std::path::Path;

use umo_core::config::Skeleton;
use umo_core::motion::clip::Clip;

use crate::export::jsonl;
use crate::failure::Failure;

/// Largest file that is read: some hours of motion.
const MAX_BYTES: u64 = 2 << 30;

/// The animation of a `.glb`, `.jsonl` or `.npz` file as this program writes it; `skeleton` is that of files which have none.
pub(crate) fn read(path: &Path, skeleton: &Skeleton) -> Result<Clip, Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let size = std::fs::metadata(path).map_err(|error| wrong(error.to_string()))?.len();
    if size > MAX_BYTES {
        return Err(wrong(format!("it is larger than {} GiB", MAX_BYTES >> 30)));
    }
    let clip = match path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("glb") => std::fs::read(path).map_err(|error| error.to_string()).and_then(|bytes| glb::parse(&bytes)),
        Some("jsonl") => {
            std::fs::read_to_string(path).map_err(|error| error.to_string()).and_then(|text| jsonl::read(&text))
        }
        _ => npz::read_own(path, skeleton),
    };
    let clip = clip.map_err(wrong)?;
    crate::export::check(&clip).map_err(|problem| wrong(problem.to_owned()))?;
    Ok(clip)
}

#[cfg(test)]
mod tests;
