//! `umo draw`: draws frames of an animation as one picture, or the figure in each of its blendshapes.

use std::path::Path;

use umo_core::{ARKIT_NAMES, FaceKind, Skeleton};
use umo_core_pose::clip::Clip;

use crate::args::{Draw, View};
use crate::export::jsonl;
use crate::failure::Failure;
use crate::{atomic_file, model};
use umo_figure::picture::{Camera, Picture, sheet};

/// Draws the picture that the arguments ask for.
pub(crate) fn run(args: &Draw) -> Result<(), Failure> {
    let picture = match &args.animation {
        Some(path) => frames(args, &read(path)?)?,
        None => {
            let skeleton = model::open(None)?.config().skeleton.clone();
            sheet::shapes(&args.figure.mesh(&skeleton)?, &skeleton)
        }
    };
    atomic_file::commit(atomic_file::create(&args.output)?, |out| picture.write(out))
}

fn read(path: &Path) -> Result<Clip, Failure> {
    let cannot = |cause: &dyn std::fmt::Display| Failure::input(format!("cannot read `{}`: {cause}", path.display()));
    let text = umo_core_base::file::read_to_string(path).map_err(|cause| cannot(&cause))?;
    jsonl::read(&text).map_err(|cause| cannot(&cause))
}

/// Draws the figure at each of the times, side by side.
fn frames(args: &Draw, clip: &Clip) -> Result<Picture, Failure> {
    let mesh = args.figure.mesh(&clip.skeleton)?;
    let mesh = if clip.face.kind == FaceKind::Arkit { mesh } else { mesh.on_the_jaw() };
    let times = if args.at.is_empty() { &[0.0][..] } else { &args.at };
    let (width, height) = (args.width, args.height);
    let mut picture = Picture::new(width * times.len(), height);
    for (cell, &time) in times.iter().enumerate() {
        let frame = frame_at(clip, time)?;
        let value = |name: &&str| clip.face.names.iter().position(|known| known == name);
        let face = clip.face(frame);
        let weights: Vec<f32> = ARKIT_NAMES.iter().map(|name| value(name).map_or(0.0, |at| face[at])).collect();
        let posed = mesh.posed(&clip.skeleton, &clip.rotations[frame], clip.translation[frame], &weights);
        let camera = camera(args.view, &clip.skeleton, clip.translation[frame]);
        picture.draw(&mesh, &posed, camera, [cell * width, 0, width, height]);
    }
    Ok(picture)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be a frame of the clip")]
fn frame_at(clip: &Clip, time: f32) -> Result<usize, Failure> {
    let frame = (time * clip.frame_rate).round();
    if !(0.0..clip.len() as f32).contains(&frame) {
        let length = clip.len() as f32 / clip.frame_rate;
        return Err(Failure::input(format!("--at {time} is outside the animation, which lasts {length:.2} s")));
    }
    Ok(frame as usize)
}

/// Returns the camera of a view, relative to the body's position.
fn camera(view: View, skeleton: &Skeleton, at: [f32; 3]) -> Camera {
    // Heights above the pelvis, for a body of human size.
    let (up, height, yaw) = match view {
        View::Front => (-0.10, 1.95, 0.0_f32),
        View::ThreeQuarter => (-0.10, 1.95, 0.6),
        View::Side => (-0.10, 1.95, 1.571),
        View::Back => (-0.10, 1.95, std::f32::consts::PI),
        View::Bust => (0.40, 0.90, 0.25),
        View::Face => (0.63, 0.30, 0.25),
    };
    let root = skeleton.offsets_m[0];
    let target = [at[0] + root[0], at[1] + root[1] + up, at[2] + root[2]];
    Camera { eye: [target[0] + 4.0 * yaw.sin(), target[1] + 0.25, target[2] + 4.0 * yaw.cos()], target, height }
}
