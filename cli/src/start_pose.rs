//! `--start-pose`: the last keyframes of a recorded motion as the history.

use std::path::Path;

use umo_core::{Animation, Compute, Config, Precision};
use umo_core_model::motion::MotionEncoder;
use umo_core_model::weights::Loader;
use umo_core_pose::clip::Clip;

use crate::failure::Failure;
use crate::import::npz;

/// Sets the history to the keyframes that end with the file's last frame.
pub(crate) fn begin(cx: Compute, loader: &Loader, path: &Path, animation: &mut Animation) -> Result<(), Failure> {
    let config = loader.file().config();
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    // The encoder chooses codes, so it runs in full precision, like the tokenizer.
    let loader = Loader::new(loader.file(), Precision::F32, loader.isa());
    let encoder = MotionEncoder::load(&loader)?
        .ok_or_else(|| Failure::input("this model cannot start from a pose: it has no `vq.*.encoder` tensors"))?;
    let clip = read(path, config).map_err(wrong)?;
    // `[T, levels]` of each part.
    let codes = encoder.encode_clip_list(cx, &clip)?;
    let levels: Vec<usize> = config.part_list().iter().map(|part| part.levels).collect();
    let frames = codes[0].len() / levels[0];
    let mut keyframes: Vec<usize> = (0..frames).rev().step_by(config.keyframe_stride).take(config.prefix).collect();
    keyframes.reverse();
    let row = |part: usize, frame: usize| &codes[part][frame * levels[part]..(frame + 1) * levels[part]];
    let parts = 0..codes.len();
    let rows = keyframes.iter().flat_map(|&frame| parts.clone().flat_map(move |part| row(part, frame)));
    Ok(animation.avatar_mut().set_history(&rows.copied().collect::<Vec<u16>>())?)
}

/// Reads the motion of an SMPL-X `.npz` file with the model's bones and face, resampled to the model's rate.
fn read(path: &Path, config: &Config) -> Result<Clip, String> {
    let empty = config.clip();
    let wanted = empty.frame_rate;
    let (clip, notes) = npz::fill(&mut npz::open(path)?, empty)?;
    notes.iter().for_each(|note| eprintln!("note: {}: {note}", path.display()));
    Ok(clip.at_rate(wanted))
}
