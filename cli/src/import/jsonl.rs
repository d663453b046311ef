//! Reader of `.jsonl` files written by `umo`: a header line, then a line per frame.

use serde::Deserialize;
use umo_core::config::{Face, FaceKind, Skeleton};
use umo_core::motion::clip::Clip;
use umo_core::motion::rotation::Quat;
use umo_core::motion::skeleton::JOINT_NAMES;

use super::MAX_FRAMES;

#[derive(Deserialize)]
struct Header {
    format: String,
    version: u32,
    frame_rate: f32,
    joints: Vec<String>,
    parents: Vec<i32>,
    offsets: Vec<[f32; 3]>,
    face: FaceHeader,
}

#[derive(Deserialize)]
struct FaceHeader {
    kind: String,
    names: Vec<String>,
}

#[derive(Deserialize)]
struct Frame {
    translation: [f32; 3],
    rotations: Vec<Quat>,
    face: Vec<f32>,
}

pub(super) fn read(bytes: &[u8]) -> Result<Clip, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "it is not UTF-8")?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text.lines().enumerate();
    let (_, first) = lines.next().ok_or("it is empty")?;
    let header: Header = serde_json::from_str(first).map_err(|error| format!("line 1: {error}"))?;
    if header.format != "umo-animation" || header.version != 1 || header.joints != JOINT_NAMES {
        return Err("not an animation written by umo (version 1, 55 joints)".to_owned());
    }
    let kind = match header.face.kind.as_str() {
        "arkit" => FaceKind::Arkit,
        "smplx_expression" => FaceKind::SmplxExpression,
        kind => return Err(format!("line 1: unknown face `{kind}`")),
    };
    let mut clip = Clip {
        frame_rate: header.frame_rate,
        skeleton: Skeleton { parents: header.parents, offsets_m: header.offsets },
        face: Face { kind, names: header.face.names },
        rotations: Vec::new(),
        translation: Vec::new(),
        face_values: Vec::new(),
    };
    for (number, line) in lines.take(MAX_FRAMES) {
        let wrong = |problem: String| format!("line {}: {problem}", number + 1);
        let frame: Frame = serde_json::from_str(line).map_err(|error| wrong(error.to_string()))?;
        let rotations = frame.rotations.try_into().map_err(|_| wrong("expected 55 rotations".to_owned()))?;
        if frame.face.len() != clip.face.names.len() {
            return Err(wrong("expected one face value per name".to_owned()));
        }
        clip.rotations.push(rotations);
        clip.translation.push(frame.translation);
        clip.face_values.extend(frame.face);
    }
    Ok(clip)
}
