//! What the writers wrote comes back.

use std::path::PathBuf;

use umo_core::config::FaceKind;
use umo_core::motion::clip::Clip;

use super::*;
use crate::export;
use crate::sample;

const FORMATS: [&str; 3] = ["glb", "jsonl", "npz"];

fn there_and_back(clip: &Clip, extension: &str) -> (tempfile::TempDir, PathBuf, Clip) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("a.{extension}"));
    export::write(&path, None, clip).unwrap();
    let back = read(&path, &clip.skeleton).unwrap();
    (folder, path, back)
}

fn assert_alike(a: &Clip, b: &Clip) {
    assert_eq!((a.frame_rate, a.len(), &a.face.names), (b.frame_rate, b.len(), &b.face.names));
    assert_eq!(a.face.kind, b.face.kind);
    assert_eq!(a.skeleton.parents, b.skeleton.parents);
    let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-6) && a.len() == b.len();
    assert!(near(a.skeleton.offsets_m.as_flattened(), b.skeleton.offsets_m.as_flattened()));
    assert!(near(a.translation.as_flattened(), b.translation.as_flattened()));
    assert!(near(&a.face_values, &b.face_values));
    for (a, b) in a.rotations.as_flattened().iter().zip(b.rotations.as_flattened()) {
        let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        assert!(1.0 - dot.abs() < 1e-6, "{a:?} {b:?}");
    }
}

#[test]
fn glb_and_npz_come_back_as_they_were() {
    for kind in [FaceKind::Arkit, FaceKind::SmplxExpression] {
        for frames in [1, 2, 40] {
            let clip = sample::clip(kind, frames, 2);
            for extension in FORMATS {
                assert_alike(&clip, &there_and_back(&clip, extension).2);
            }
        }
    }
}

#[test]
fn a_frame_rate_that_is_no_whole_number_comes_back() {
    let mut clip = sample::clip(FaceKind::Arkit, 50, 1);
    clip.frame_rate = 23.976;
    for extension in FORMATS {
        let back = there_and_back(&clip, extension).2;
        assert!((back.frame_rate - clip.frame_rate).abs() < 1e-3, "{extension}: {}", back.frame_rate);
    }
}

#[test]
fn damage_is_refused_in_words() {
    let clip = sample::clip(FaceKind::Arkit, 3, 1);
    for extension in FORMATS {
        let (_folder, path, _) = there_and_back(&clip, extension);
        let bytes = std::fs::read(&path).unwrap();
        for keep in [0, 4, 12, bytes.len() / 2, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..keep]).unwrap();
            let failure = read(&path, &clip.skeleton).unwrap_err();
            assert_eq!(failure.code(), 2, "{failure}");
            assert!(failure.to_string().contains("a."), "{failure}");
        }
    }
}

#[test]
fn a_glb_of_something_else_is_refused() {
    let clip = sample::clip(FaceKind::Arkit, 3, 1);
    let (_folder, path, _) = there_and_back(&clip, "glb");
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(12).position(|word| word == b"\"left_wrist\"").unwrap();
    bytes[at + 1..at + 3].copy_from_slice(b"LE");
    std::fs::write(&path, &bytes).unwrap();
    let failure = read(&path, &clip.skeleton).unwrap_err().to_string();
    assert!(failure.contains("`left_wrist`"), "{failure}");
}
