//! Mouth shapes for applications without ARKit channels: the 15 visemes of the Oculus set.
//!
//! Each viseme has a shape: the channels of an ARKit face that makes its sound. A frame's weights measure the
//! similarity of its mouth to each shape: `exp(-distance^2 / (2 WIDTH^2))`, divided by their sum. Lips that `mouthClose`
//! holds shut over a jaw that is open are a `PP` whatever else they do: people round and spread them meanwhile.

use crate::face::{Face, FaceKind};
use umo_core_base::functions::Functions;

/// Number of visemes.
pub const VISEMES: usize = 15;

/// Names of the visemes, in the order of the Oculus set.
pub const VISEME_NAMES: [&str; VISEMES] =
    ["sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "ih", "oh", "ou"];

/// Distance scale of the similarity between shapes.
const WIDTH: f32 = 0.12;

/// `mouthClose` from which lips are sealed over an open jaw, and what more seals them wholly; opening at which they are apart.
const SEAL: (f32, f32) = (0.06, 0.06);
const APART: f32 = 0.12;
/// Share of the other visemes' weights that sealed lips give to `PP`.
const SEALED: f32 = 0.85;
const PP: usize = 1;

/// Features of a mouth: each is an ARKit channel, or the mean of a left and a right one.
const FEATURES: [&[&str]; 12] = [
    &["jawOpen"],
    &["mouthClose"],
    &["mouthPressLeft", "mouthPressRight"],
    &["mouthRollLower"],
    &["mouthRollUpper"],
    &["mouthFunnel"],
    &["mouthPucker"],
    &["mouthStretchLeft", "mouthStretchRight"],
    &["mouthSmileLeft", "mouthSmileRight"],
    &["mouthUpperUpLeft", "mouthUpperUpRight"],
    &["mouthLowerDownLeft", "mouthLowerDownRight"],
    &["tongueOut"],
];

/// Shape of each viseme, in the order of [`FEATURES`].
#[rustfmt::skip]
const SHAPES: [[f32; FEATURES.len()]; VISEMES] = [
    // jaw, close, press, roll lower and upper, funnel, pucker, stretch, smile, upper up, lower
    // down, tongue
    [0.00, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], // sil
    [0.10, 0.10, 0.5, 0.3, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], // PP
    [0.08, 0.00, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0], // FF
    [0.18, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.4], // TH
    [0.15, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.2, 0.4, 0.1], // DD
    [0.25, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.2, 0.0], // kk
    [0.08, 0.00, 0.0, 0.0, 0.0, 0.5, 0.1, 0.0, 0.0, 0.2, 0.2, 0.0], // CH
    [0.04, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.4, 0.2, 0.1, 0.3, 0.0], // SS
    [0.12, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.0], // nn
    [0.14, 0.00, 0.0, 0.0, 0.0, 0.3, 0.3, 0.0, 0.0, 0.0, 0.1, 0.0], // RR
    [0.60, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.3, 0.0], // aa
    [0.35, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 0.3, 0.1, 0.3, 0.0], // E
    [0.18, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 0.5, 0.1, 0.2, 0.0], // ih
    [0.40, 0.00, 0.0, 0.0, 0.0, 0.4, 0.2, 0.0, 0.0, 0.0, 0.1, 0.0], // oh
    [0.12, 0.00, 0.0, 0.0, 0.0, 0.2, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0], // ou
];

/// ARKit channels of a viseme and their values, 0 to 1. Panics if `viseme` is not below [`VISEMES`].
pub fn shape(viseme: usize) -> impl Iterator<Item = (&'static str, f32)> {
    let features = FEATURES.iter().zip(SHAPES[viseme]).filter(|(_, weight)| *weight > 0.0);
    features.flat_map(|(channels, weight)| channels.iter().map(move |channel| (*channel, weight)))
}

/// Computes visemes from a model's face values.
#[derive(Clone, Debug)]
pub struct Visemes {
    /// Indices of each feature's channels; equal if it has only one.
    channels: [[usize; 2]; FEATURES.len()],
}

impl Visemes {
    /// Creates the mapping for a model's face; `None` if it is not an ARKit face.
    pub fn new(face: &Face) -> Option<Self> {
        if face.kind != FaceKind::Arkit {
            return None;
        }
        let find = |name: &str| face.names.iter().position(|n| n == name);
        let mut channels = [[0; 2]; FEATURES.len()];
        for (slot, names) in channels.iter_mut().zip(FEATURES) {
            *slot = [find(names.first()?)?, find(names.last()?)?];
        }
        Some(Self { channels })
    }

    /// Weight of each viseme, 0 to 1; the weights sum to 1. Never allocates.
    pub fn weights(&self, face: &[f32]) -> [f32; VISEMES] {
        let features = self.channels.map(|[a, b]| 0.5 * (face[a] + face[b]));
        let distance =
            |shape: &[f32; FEATURES.len()]| shape.iter().zip(&features).map(|(s, f)| (s - f) * (s - f)).sum::<f32>();
        let distances = SHAPES.map(|shape| distance(&shape));
        // Relative to the nearest, so that the weights of a mouth far from all shapes do not vanish.
        let nearest = distances.iter().copied().fold(f32::INFINITY, f32::min);
        let weights = distances.map(|d| (-(d - nearest) / (2.0 * WIDTH * WIDTH)).exponential());
        let sum: f32 = weights.iter().sum();
        let given = SEALED * sealed(&features);
        let mut weights = weights.map(|w| (1.0 - given) * w / sum);
        weights[PP] += given;
        weights
    }
}

/// Degree to which lips are sealed over an open jaw, 0 to 1.
fn sealed(features: &[f32; FEATURES.len()]) -> f32 {
    let [jaw, close, .., upper_up, lower_down, _] = features;
    let smooth = |x: f32| {
        let x = x.clamp(0.0, 1.0);
        x * x * (3.0 - 2.0 * x)
    };
    let opening = jaw - close + 0.5 * (upper_up + lower_down);
    smooth((close - SEAL.0) / SEAL.1) * smooth(1.0 - opening / APART)
}

#[cfg(test)]
mod tests {
    use super::super::skeleton::ARKIT_NAMES;
    use super::*;
    use proptest::prelude::*;

    fn arkit() -> Face {
        Face { kind: FaceKind::Arkit, names: ARKIT_NAMES.map(str::to_owned).to_vec() }
    }

    fn face(values: &[(&str, f32)]) -> Vec<f32> {
        let mut face = vec![0.0; ARKIT_NAMES.len()];
        for (name, value) in values {
            face[ARKIT_NAMES.iter().position(|n| n == name).unwrap()] = *value;
        }
        face
    }

    fn likeliest(face: &[f32]) -> &'static str {
        let weights = Visemes::new(&arkit()).unwrap().weights(face);
        let best = (0..VISEMES).max_by(|&a, &b| weights[a].total_cmp(&weights[b])).unwrap();
        VISEME_NAMES[best]
    }

    #[test]
    fn mouths_are_named_as_a_person_would() {
        assert_eq!(likeliest(&face(&[])), "sil");
        assert_eq!(
            likeliest(&face(&[("jawOpen", 0.7), ("mouthLowerDownLeft", 0.2), ("mouthLowerDownRight", 0.2)])),
            "aa"
        );
        assert_eq!(likeliest(&face(&[("mouthPucker", 0.8), ("jawOpen", 0.1)])), "ou");
        assert_eq!(likeliest(&face(&[("jawOpen", 0.45), ("mouthFunnel", 0.5)])), "oh");
        assert_eq!(
            likeliest(&face(&[("mouthPressLeft", 0.6), ("mouthPressRight", 0.6), ("mouthRollLower", 0.2)])),
            "PP"
        );
        assert_eq!(
            likeliest(&face(&[("mouthRollLower", 0.6), ("mouthUpperUpLeft", 0.3), ("mouthUpperUpRight", 0.3)])),
            "FF"
        );
        assert_eq!(likeliest(&face(&[("tongueOut", 0.5), ("jawOpen", 0.2)])), "TH");
        // A captured "b" before "u", and the "u".
        assert_eq!(likeliest(&face(&[("jawOpen", 0.15), ("mouthClose", 0.18), ("mouthPucker", 0.6)])), "PP");
        assert_eq!(likeliest(&face(&[("jawOpen", 0.18), ("mouthClose", 0.02), ("mouthPucker", 0.6)])), "ou");
        assert_eq!(likeliest(&face(&[("mouthSmileLeft", 0.6), ("mouthSmileRight", 0.6), ("jawOpen", 0.2)])), "ih");
    }

    #[test]
    fn every_shape_is_most_like_itself() {
        let visemes = Visemes::new(&arkit()).unwrap();
        for (i, shape) in SHAPES.iter().enumerate() {
            let mut face = vec![0.0; ARKIT_NAMES.len()];
            for (channels, value) in visemes.channels.iter().zip(shape) {
                channels.iter().for_each(|&channel| face[channel] = *value);
            }
            assert_eq!(likeliest(&face), VISEME_NAMES[i]);
        }
    }

    #[test]
    fn other_faces_have_none() {
        let expression = Face { kind: FaceKind::SmplxExpression, names: vec!["e0".to_owned()] };
        assert!(Visemes::new(&expression).is_none());
    }

    proptest! {
        #[test]
        fn weights_share_out_one(face in prop::collection::vec(0.0_f32..=1.0, 52)) {
            let weights = Visemes::new(&arkit()).unwrap().weights(&face);
            prop_assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
            prop_assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        }
    }
}
