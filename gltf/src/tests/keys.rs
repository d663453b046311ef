use std::collections::BTreeMap;

use gltf::animation::util::ReadOutputs;

use super::glb::{File, built};
use super::*;
use crate::keys::{Bound, Keying, Marker, MarkerKind};

/// A clip whose joints, root and face move by slow waves.
fn smooth(frames: usize, waves: &[[f32; 3]]) -> Clip {
    let mut clip = sample::clip(FaceKind::Arkit, frames, 0);
    let wave = |number: usize, frame: usize| {
        let [size, speed, phase] = waves[number % waves.len()];
        size * (frame as f32 * speed + phase + number as f32).sin()
    };
    for frame in 0..frames {
        for (joint, q) in clip.rotations[frame].iter_mut().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|axis| wave(3 * joint + axis, frame));
            let length = (x * x + y * y + z * z + 1.0).sqrt();
            *q = [x / length, y / length, z / length, 1.0 / length];
        }
        clip.translation[frame] = [0, 1, 2].map(|axis| wave(axis, frame));
        let channels = clip.face.names.len();
        let face = &mut clip.face_values[frame * channels..][..channels];
        face.iter_mut().enumerate().for_each(|(channel, value)| *value = wave(channel, frame).abs().min(1.0));
    }
    clip
}

fn keying(degrees: f32) -> Keying {
    let marker = |seconds, kind, name: &str| Marker { seconds, kind, name: name.to_owned() };
    let markers = vec![marker(0.25, MarkerKind::Stroke, "left"), marker(0.5, MarkerKind::Word, "so \"far\"")];
    Keying { bound: Bound::new(degrees).unwrap(), markers }
}

fn reduced(clip: &Clip, degrees: f32) -> File {
    File::parsed(&built(clip, |figure, bytes| figure.write_keyed(clip, Some(&keying(degrees)), bytes)))
}

/// Times and values of one property of a node.
struct Curve {
    times: Vec<f32>,
    values: Vec<f32>,
    is_turn: bool,
}

/// The file's curves, by node and whether they are rotations.
fn curves(file: &File) -> BTreeMap<(usize, bool), Curve> {
    let animation = file.gltf.animations().next().unwrap();
    let curve = |channel: gltf::animation::Channel<'_>| {
        let reader = channel.reader(|_| Some(&file.bin));
        let times: Vec<f32> = reader.read_inputs().unwrap().collect();
        let (values, is_turn) = match reader.read_outputs().unwrap() {
            ReadOutputs::Rotations(q) => (q.into_f32().flatten().collect(), true),
            ReadOutputs::Translations(t) => (t.flatten().collect(), false),
            ReadOutputs::MorphTargetWeights(w) => (w.into_f32().collect(), false),
            ReadOutputs::Scales(_) => panic!("nothing is scaled"),
        };
        ((channel.target().node().index(), is_turn), Curve { times, values, is_turn })
    };
    animation.channels().map(curve).collect()
}

impl Curve {
    fn key(&self, number: usize) -> &[f32] {
        let width = self.values.len() / self.times.len();
        &self.values[number * width..][..width]
    }

    /// The value at a time as glTF defines it: a line, or slerp for rotations.
    fn at(&self, seconds: f32) -> Vec<f32> {
        let last = self.times.len() - 1;
        let next = self.times.partition_point(|&time| time < seconds).min(last);
        let before = if self.times[next] <= seconds { next } else { next - 1 };
        let length = self.times[next] - self.times[before];
        let share = if length > 0.0 { (seconds - self.times[before]) / length } else { 0.0 };
        let (a, b) = (self.key(before), self.key(next));
        let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        let angle = if self.is_turn { dot.min(1.0).acos() } else { 0.0 };
        let [from, to] = if angle < 1e-2 {
            [1.0 - share, share]
        } else {
            [((1.0 - share) * angle).sin() / angle.sin(), (share * angle).sin() / angle.sin()]
        };
        a.iter().zip(b).map(|(a, b)| from * a + to * b).collect()
    }
}

/// Degrees between two rotations, or the distance of two places, or of the weights that are farthest apart.
fn apart(a: &[f32], b: &[f32], is_turn: bool) -> f64 {
    let differences = |sign: f64| a.iter().zip(b).map(move |(&a, &b)| f64::from(a) - sign * f64::from(b));
    let length = |sign: f64| differences(sign).map(|d| d * d).sum::<f64>().sqrt();
    match (is_turn, a.len()) {
        (true, _) => (4.0 * (length(1.0).min(length(-1.0)) / 2.0).asin()).to_degrees(),
        (false, 3) => length(1.0),
        (false, _) => differences(1.0).map(f64::abs).fold(0.0, f64::max),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn a_file_of_few_keys_is_within_the_bound_in_every_frame(
        frames in 1_usize..70,
        waves in prop::collection::vec([0.0_f32..0.8, 0.01_f32..0.4, 0.0_f32..6.0], 1..7),
        bound in 0.05_f32..8.0,
    ) {
        let clip = smooth(frames, &waves);
        let (whole, few) = (curves(&File::of(&clip)), curves(&reduced(&clip, bound)));
        prop_assert!(whole.keys().eq(few.keys()));
        for (name, curve) in &whole {
            // f32 keeps a unit quaternion to some ten-thousandths of a degree.
            let most = f64::from(bound) * if curve.is_turn { 1.0 } else { 0.01 } + 1e-3;
            for (number, &seconds) in curve.times.iter().enumerate() {
                let off = apart(&few[name].at(seconds), curve.key(number), curve.is_turn);
                prop_assert!(off < most, "{:?} at {}: {} of {}", name, seconds, off, most);
            }
        }
        let drawn = Bound::new(bound).unwrap().drawn(&clip);
        for (frame, (whole, drawn)) in clip.rotations.iter().zip(&drawn.rotations).enumerate() {
            let off = whole.iter().zip(drawn).map(|(a, b)| apart(a, b, true)).fold(0.0, f64::max);
            prop_assert!(off < f64::from(bound) + 1e-3, "frame {}: {}", frame, off);
        }
    }
}

#[test]
fn straight_pieces_need_a_key_at_their_ends_alone() {
    let mut clip = smooth(61, &[[0.0; 3]]);
    for (frame, rotations) in clip.rotations.iter_mut().enumerate() {
        let turn = if frame <= 20 { frame as f32 } else { 20.0 - (frame - 20) as f32 };
        let (sin, cos) = (turn * 0.02).sin_cos();
        rotations[18] = [sin, 0.0, 0.0, cos];
    }
    let file = reduced(&clip, 0.1);
    let found = curves(&file);
    let seconds = |name: &str| found[&(file.node(name).index(), true)].times.clone();
    assert_eq!(seconds("left_elbow"), [0.0, 20.0 / 30.0, 2.0]);
    assert_eq!(seconds("right_elbow"), [0.0, 2.0]);
}

#[test]
fn markers_are_in_the_extras_of_the_scene() {
    let clip = smooth(20, &[[0.2, 0.1, 0.0]]);
    let extras = |file: &File| file.gltf.scenes().next().unwrap().extras().as_ref().map(|json| json.get().to_owned());
    let said: serde_json::Value = serde_json::from_str(&extras(&reduced(&clip, 1.0)).unwrap()).unwrap();
    let want = serde_json::json!([
        { "time": 0.25, "kind": "stroke", "name": "left" },
        { "time": 0.5, "kind": "word", "name": "so \"far\"" },
    ]);
    assert_eq!(said["markers"], want);
    assert_eq!(extras(&File::of(&clip)), None);
}

#[test]
fn a_bound_has_a_range() {
    assert!([0.01, 1.0, 45.0].iter().all(|&degrees| Bound::new(degrees).is_some()));
    assert!([0.0, -1.0, 46.0, f32::NAN].iter().all(|&degrees| Bound::new(degrees).is_none()));
}
