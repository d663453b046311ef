//! `--start-pose`: the last keyframes of a real motion as the history.

use std::path::Path;

use umo_core::motion::clip::{Clip, MotionEncoder};
use umo_core::weights::Loader;
use umo_core::{Compute, Config, Part, PerPart, Precision};

use crate::failure::Failure;
use crate::import::npz;

/// Codes of the keyframes that end with the file's last frame, oldest first.
pub(crate) fn codes(cx: Compute, loader: &Loader, path: &Path) -> Result<PerPart<Vec<u16>>, Failure> {
    let config = loader.file().config();
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    // A choice among codes, like the tokenizer's, is made in full precision.
    let loader = Loader::new(loader.file(), Precision::F32, loader.isa());
    let encoder = MotionEncoder::load(&loader)?
        .ok_or_else(|| Failure::input("this model cannot start from a pose: it has no `vq.*.encoder` tensors"))?;
    let clip = read(path, config).map_err(wrong)?;
    let codes = encoder.encode_clip(cx, &clip)?;
    let stride = config.keyframe_stride;
    Ok(PerPart::from_fn(|part| {
        let mut keyframes: Vec<u16> = codes[part].iter().rev().step_by(stride).take(config.prefix).copied().collect();
        keyframes.reverse();
        keyframes
    }))
}

/// The motion in an SMPL-X `.npz` file, with the model's bones and face, at the model's rate.
fn read(path: &Path, config: &Config) -> Result<Clip, String> {
    let empty = Clip::new(config);
    let wanted = empty.frame_rate;
    Ok(npz::fill(&mut npz::open(path)?, empty)?.at_rate(wanted))
}

/// The codes of every part as slices.
pub(crate) fn as_slices(codes: &PerPart<Vec<u16>>) -> PerPart<&[u16]> {
    PerPart::from_fn(|part: Part| codes[part].as_slice())
}
