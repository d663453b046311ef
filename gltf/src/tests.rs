//! Files are read back by the `gltf` crate, which shares no code with the writer.

use proptest::prelude::*;
use umo_core_pose::clip::Clip;
use umo_core_pose::face::FaceKind;
use umo_core_pose::skeleton::{JOINT_NAMES, JOINTS, joint_places};
use umo_figure::{Figure, sample};

mod avatar;
mod glb;
mod keys;
mod vrma;

const KINDS: [FaceKind; 2] = [FaceKind::SmplxExpression, FaceKind::Arkit];

type Point = [f64; 3];

/// Unit quaternions, in which quarter turns and their neighbours are as frequent as any others.
fn any_quaternion() -> impl Strategy<Value = [f32; 4]> {
    let corner = prop::sample::select(vec![-1.0_f32, 0.0, 1.0, 1e-4, 1e-7]);
    prop::array::uniform4(prop_oneof![-1.0_f32..1.0, corner]).prop_filter_map("no direction", |q| {
        let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        (length > 0.1).then(|| q.map(|x| x / length))
    })
}

/// A sample clip of `frames` frames with arbitrary joint rotations.
fn any_clip(kind: FaceKind, frames: usize) -> impl Strategy<Value = Clip> {
    prop::collection::vec(any_quaternion(), frames * JOINTS).prop_map(move |rotations| {
        let mut clip = sample::clip(kind, frames, 1);
        clip.rotations = rotations.as_chunks::<JOINTS>().0.to_vec();
        clip
    })
}

/// Joint positions of a frame in metres, which readers must reproduce.
fn positions(clip: &Clip, frame: usize) -> Vec<Point> {
    joint_places(&clip.skeleton, &clip.pose(frame)).map(|place| place.map(f64::from)).to_vec()
}

fn rotate([x, y, z, w]: [f64; 4], [a, b, c]: Point) -> Point {
    let t = [2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)];
    [a + w * t[0] + y * t[2] - z * t[1], b + w * t[1] + z * t[0] - x * t[2], c + w * t[2] + x * t[1] - y * t[0]]
}

fn multiply([x, y, z, w]: [f64; 4], [a, b, c, d]: [f64; 4]) -> [f64; 4] {
    [
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    ]
}

fn distance(a: Point, b: Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn a_clip_that_contradicts_itself_is_refused() {
    let mut clip = sample::clip(FaceKind::Arkit, 2, 1);
    clip.translation.truncate(1);
    let mut out = Vec::new();
    for error in [
        crate::glb::write(&clip, Some(Figure::default()), &mut out).unwrap_err(),
        crate::glb::write(&clip, None, &mut out).unwrap_err(),
        crate::vrma::write(&clip, &mut out).unwrap_err(),
    ] {
        assert_eq!(error.kind(), std::io::ErrorKind::InvalidInput);
        assert!(error.to_string().contains("translation"), "{error}");
    }
    assert!(out.is_empty());
}
