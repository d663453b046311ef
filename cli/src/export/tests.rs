//! Each format is read back by an independent reader.

use super::*;
use proptest::prelude::*;
use umo_core::{FaceKind, JOINTS};
use umo_figure::sample;
use umo_gltf::keys::{Bound, Keying, Marker, MarkerKind};

mod bvh;
mod csv;
mod jsonl;
mod npz;
mod output;
mod rotation;

const KINDS: [FaceKind; 2] = [FaceKind::SmplxExpression, FaceKind::Arkit];

type Point = [f64; 3];

fn bytes_of(write: impl Fn(&Clip, &mut Vec<u8>) -> io::Result<()>, clip: &Clip) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(clip, &mut bytes).unwrap();
    bytes
}

/// Generates quaternions; components of quarter turns and values close to them, where Euler angles are weakest,
/// occur as often as others.
fn any_quaternion() -> impl Strategy<Value = [f32; 4]> {
    let corner = prop::sample::select(vec![-1.0_f32, 0.0, 1.0, 1e-4, 1e-7]);
    let even = -1.0_f32..1.0;
    let number = prop_oneof![even, corner];
    prop::array::uniform4(number).prop_filter_map("no direction", |q| {
        let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        (length > 0.1).then(|| q.map(|x| x / length))
    })
}

/// Generates a sample clip of `frames` frames with arbitrary joint rotations.
fn any_clip(kind: FaceKind, frames: usize) -> impl Strategy<Value = Clip> {
    prop::collection::vec(any_quaternion(), frames * JOINTS).prop_map(move |rotations| {
        let mut clip = sample::clip(kind, frames, 1);
        clip.rotations = rotations.as_chunks::<JOINTS>().0.to_vec();
        clip
    })
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

/// Returns the joint positions of a frame from the quaternions, metres: the reference for skeleton formats.
fn positions(clip: &Clip, frame: usize) -> Vec<Point> {
    let mut turned: Vec<[f64; 4]> = Vec::new();
    let mut places: Vec<Point> = Vec::new();
    for (joint, q) in clip.rotations[frame].iter().enumerate() {
        let q = q.map(f64::from);
        let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        let q = q.map(|x| x / length);
        let offset = clip.skeleton.offsets_m[joint].map(f64::from);
        if let Ok(parent) = usize::try_from(clip.skeleton.parents[joint]) {
            let step = rotate(turned[parent], offset);
            let from = places[parent];
            places.push(std::array::from_fn(|i| from[i] + step[i]));
            turned.push(multiply(turned[parent], q));
        } else {
            let moved = clip.translation[frame].map(f64::from);
            places.push(std::array::from_fn(|i| offset[i] + moved[i]));
            turned.push(q);
        }
    }
    places
}

fn distance(a: Point, b: Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Few keys with three markers, of which the last is behind the end.
fn keying(degrees: f32) -> Keying {
    let marker = |seconds, kind, name: &str| Marker { seconds, kind, name: name.to_owned() };
    let markers = vec![
        marker(0.26, MarkerKind::Stroke, "left"),
        marker(0.56, MarkerKind::Word, "so far"),
        marker(9.0, MarkerKind::Stroke, "both"),
    ];
    Keying { bound: Bound::new(degrees).unwrap(), markers }
}

#[test]
fn format_comes_from_a_name_or_an_extension() {
    for format in Format::ALL {
        assert_eq!(Format::parse(format.name()).unwrap(), format);
        let path = format!("a.b/out.{}", format.name().to_uppercase());
        assert_eq!(Format::from_extension(path.as_ref()).unwrap(), format);
    }
    let message = Format::parse("fbx").unwrap_err().to_string();
    assert_eq!(message, "unknown format `fbx`: expected npz, bvh, glb, vrma, csv, jsonl");
    let message = Format::from_extension("folder.glb/out".as_ref()).unwrap_err();
    assert!(message.to_string().contains("`folder.glb/out`"), "{message}");
}

#[test]
fn a_writer_passes_on_a_failure_at_any_byte() {
    for kind in KINDS {
        let clip = sample::clip(kind, 2, 1);
        for format in Format::ALL {
            if format.check_face(&clip.face).is_err() {
                continue;
            }
            let size = written(format, &clip, usize::MAX).unwrap();
            // Building a glb's figure is slow.
            let places = if format == Format::Glb { 2 } else { 20 };
            for room in (0..size).step_by(size / places).chain([size - 1]) {
                let cause = written(format, &clip, room).unwrap_err();
                assert_eq!(cause.kind(), io::ErrorKind::StorageFull, "{format:?} at {room}");
            }
        }
    }
}

/// Writes to a disk with `room` bytes left; returns the number of bytes written.
fn written(format: Format, clip: &Clip, room: usize) -> io::Result<usize> {
    let mut disk = Disk { used: 0, room };
    match format {
        Format::Npz => super::npz::write(clip, &mut disk)?,
        Format::Bvh => super::bvh::write(clip, &mut disk)?,
        Format::Glb => umo_gltf::glb::write(clip, Some(Figure::default()), &mut disk)?,
        Format::Csv => super::csv::write(clip, &mut disk)?,
        Format::Vrma => umo_gltf::vrma::write(clip, &mut disk)?,
        Format::Jsonl => super::jsonl::write(clip, &mut disk)?,
    }
    Ok(disk.used)
}

struct Disk {
    used: usize,
    room: usize,
}

impl io::Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.used + bytes.len() > self.room {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.used += bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
