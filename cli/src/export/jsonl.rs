//! `.jsonl`: the whole animation, one JSON object a line; the first describes the others.

use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use umo_core::{FaceKind, JOINT_NAMES, JOINTS, Skeleton};
use umo_core_model::config;
use umo_core_pose::clip::Clip;

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

/// Writes a header line, then a line per frame.
///
/// # Errors
/// Errors of `out`.
pub fn write<W: Write>(clip: &Clip, mut out: W) -> io::Result<()> {
    write_line(&header(clip), &mut out)?;
    for (frame, rotations) in clip.rotations.iter().enumerate() {
        let line = Frame {
            frame,
            time: frame as f64 / f64::from(clip.frame_rate),
            translation: clip.translation[frame],
            rotations: rotations.as_slice(),
            face: clip.face(frame),
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

/// The fields read from the first line.
#[derive(Deserialize)]
struct Start {
    format: String,
    version: u32,
    frame_rate: f32,
    parents: Vec<i32>,
    offsets: Vec<[f32; 3]>,
    face: Names,
}

#[derive(Deserialize)]
struct Names {
    kind: String,
    names: Vec<String>,
}

/// The fields read from the other lines.
#[derive(Deserialize)]
struct Row {
    translation: [f32; 3],
    rotations: Vec<[f32; 4]>,
    face: Vec<f32>,
}

/// Reads an animation written by [`write()`].
///
/// # Errors
/// The line and its problem, or a description of the animation's inconsistency.
pub fn read(text: &str) -> Result<Clip, String> {
    let mut lines = text.lines().enumerate();
    let (_, first) = lines.next().ok_or("it is empty")?;
    let start: Start = serde_json::from_str(first).map_err(|cause| format!("line 1: {cause}"))?;
    if start.format != "umo-animation" || start.version != 1 {
        return Err(format!("line 1: expected umo-animation of version 1, got {} of {}", start.format, start.version));
    }
    let kind = match start.face.kind.as_str() {
        "arkit" => FaceKind::Arkit,
        "smplx_expression" => FaceKind::SmplxExpression,
        other => return Err(format!("line 1: unknown kind of face `{other}`")),
    };
    let mut clip = Clip {
        frame_rate: start.frame_rate,
        skeleton: Skeleton { parents: start.parents, offsets_m: start.offsets },
        face: config::Face { kind, names: start.face.names },
        rotations: Vec::new(),
        translation: Vec::new(),
        face_values: Vec::new(),
    };
    for (number, line) in lines {
        let row: Row = serde_json::from_str(line).map_err(|cause| format!("line {}: {cause}", number + 1))?;
        let rotations = row.rotations.try_into();
        let rotations = rotations.map_err(|_| format!("line {}: expected {JOINTS} rotations", number + 1))?;
        if row.face.len() != clip.face.names.len() {
            return Err(format!("line {}: expected {} face values", number + 1, clip.face.names.len()));
        }
        clip.rotations.push(rotations);
        clip.translation.push(row.translation);
        clip.face_values.extend(row.face);
    }
    clip.check()?;
    Ok(clip)
}
