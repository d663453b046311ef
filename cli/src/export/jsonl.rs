//! `.jsonl`: everything, one JSON object a line; the first describes the others.

use super::face_of;
use serde::Serialize;
use std::io::{self, Write};
use umo_core::config::FaceKind;
use umo_core::motion::clip::Clip;
use umo_core::motion::skeleton::{JOINT_NAMES, JOINTS};

#[derive(Serialize)]
struct Header<'a> {
    format: &'static str,
    version: u32,
    frame_rate: f32,
    frames: usize,
    joints: &'a [&'static str],
    parents: &'a [i32],
    offsets: &'a [[f32; 3]],
    face: Face<'a>,
    units: Units,
    axes: Axes,
}

#[derive(Serialize)]
struct Face<'a> {
    kind: &'static str,
    names: &'a [String],
}

#[derive(Serialize)]
struct Units {
    time: &'static str,
    offsets: &'static str,
    translation: &'static str,
    rotations: &'static str,
}

#[derive(Serialize)]
struct Axes {
    x: &'static str,
    y: &'static str,
    z: &'static str,
    handedness: &'static str,
}

#[derive(Serialize)]
struct Frame<'a> {
    frame: usize,
    time: f64,
    translation: [f32; 3],
    rotations: &'a [[f32; 4]],
    face: &'a [f32],
}

/// Writes a header line and then a line per frame.
///
/// # Errors
/// Those of `out`.
pub fn write<W: Write>(clip: &Clip, mut out: W) -> io::Result<()> {
    write_line(&header(clip), &mut out)?;
    for (frame, rotations) in clip.rotations.iter().enumerate() {
        let line = Frame {
            frame,
            time: frame as f64 / f64::from(clip.frame_rate),
            translation: clip.translation[frame],
            rotations: rotations.as_slice(),
            face: face_of(clip, frame),
        };
        write_line(&line, &mut out)?;
    }
    Ok(())
}

fn header(clip: &Clip) -> Header<'_> {
    Header {
        format: "umo-animation",
        version: 1,
        frame_rate: clip.frame_rate,
        frames: clip.rotations.len(),
        joints: const { &JOINT_NAMES as &[&str; JOINTS] },
        parents: &clip.skeleton.parents,
        offsets: &clip.skeleton.offsets_m,
        face: Face {
            kind: match clip.face.kind {
                FaceKind::SmplxExpression => "smplx_expression",
                FaceKind::Arkit => "arkit",
            },
            names: &clip.face.names,
        },
        units: Units {
            time: "seconds",
            offsets: "metres, from the parent joint",
            translation: "metres, added to the root's offset",
            rotations: "unit quaternions x y z w, relative to the parent",
        },
        axes: Axes { x: "left of the body", y: "up", z: "forward", handedness: "right" },
    }
}

fn write_line<W: Write>(line: &impl Serialize, out: &mut W) -> io::Result<()> {
    serde_json::to_writer(&mut *out, line)?;
    out.write_all(b"\n")
}
