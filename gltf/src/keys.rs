//! Fewer keys: the frames between which straight lines hold a motion.
//!
//! Frames are chosen greedily, each key as far from the last one as a line reaches, which doubling and bisection find
//! (P. K. Agarwal, S. Har-Peled, N. H. Mustafa, Y. Wang: Near-Linear Time Approximation Algorithms for Curve
//! Simplification, Algorithmica 42, 2005). Keys keep their values, and lines between them are what every reader draws:
//! Blender drops the tangents of splines.

use umo_core_base::memory::{collected, with_capacity};
use umo_core_pose::clip::Clip;
use umo_core_pose::rotation::{Quat, slerp};
use umo_core_pose::skeleton::JOINTS;

/// Largest error of a shape's weight, and of the root's place in metres, for each degree: an arm of 0.6 m that turns by a
/// degree moves its hand by a centimetre.
const PER_DEGREE: f32 = 0.01;

/// Largest error of a motion of few keys, in every frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    degrees: f32,
}

impl Bound {
    /// A joint's rotation is off by at most these degrees, 0.01 to 45; a shape's weight by at most a hundredth for each
    /// degree, the root's place by a centimetre. `None` outside this range.
    #[must_use]
    pub fn new(degrees: f32) -> Option<Self> {
        (0.01..=45.0).contains(&degrees).then_some(Self { degrees })
    }

    /// The largest error of a joint's rotation.
    #[must_use]
    pub fn degrees(self) -> f32 {
        self.degrees
    }

    /// The largest error of a shape's weight, and of a place in metres.
    #[must_use]
    pub fn amount(self) -> f32 {
        PER_DEGREE * self.degrees
    }

    /// Frames that hold a joint's rotations.
    #[must_use]
    pub fn rotations(self, values: &[Quat]) -> Vec<usize> {
        // The distance of two unit quaternions whose rotations are so far apart.
        let most = 2.0 * (f64::from(self.degrees).to_radians() / 4.0).sin();
        keys(values.len(), |[from, at, to]| {
            let line = slerp(values[from], values[to], share([from, at, to]));
            let apart = |sign: f64| -> f64 {
                line.iter().zip(values[at]).map(|(&a, b)| (f64::from(a) - sign * f64::from(b)).powi(2)).sum()
            };
            apart(1.0).min(apart(-1.0)) <= most * most
        })
    }

    /// Frames that hold places, metres.
    #[must_use]
    pub fn places(self, values: &[[f32; 3]]) -> Vec<usize> {
        keys(values.len(), |[from, at, to]| {
            let line = between(&values[from], &values[to], share([from, at, to]));
            line.zip(values[at]).map(|(a, b)| (a - b).powi(2)).sum::<f32>() <= self.amount().powi(2)
        })
    }

    /// Frames that hold rows of `width` weights, every weight of a row. `is_kept` names frames that are keys anyway.
    ///
    /// # Panics
    /// If `width` is 0.
    #[must_use]
    pub fn rows(self, values: &[f32], width: usize, is_kept: impl Fn(usize) -> bool) -> Vec<usize> {
        let row = |frame: usize| &values[frame * width..][..width];
        keys(values.len() / width, |[from, at, to]| {
            let mut line = between(row(from), row(to), share([from, at, to])).zip(row(at));
            !is_kept(at) && line.all(|(a, b)| (a - b).abs() <= self.amount())
        })
    }

    /// The motion of the body as its keys give it, with a value for every frame.
    #[must_use]
    pub fn drawn(self, clip: &Clip) -> Clip {
        let mut drawn = clip.clone();
        for joint in 0..JOINTS {
            let track: Vec<Quat> = collected(clip.rotations.iter().map(|frame| frame[joint]));
            for [from, at, to] in inner(&self.rotations(&track)) {
                drawn.rotations[at][joint] = slerp(track[from], track[to], share([from, at, to]));
            }
        }
        for [from, at, to] in inner(&self.places(&clip.translation)) {
            let line = between(&clip.translation[from], &clip.translation[to], share([from, at, to]));
            drawn.translation[at].iter_mut().zip(line).for_each(|(value, on)| *value = on);
        }
        drawn
    }
}

/// Frames of keys, the first and last among them. `holds` tells whether the line between the outer two of three frames
/// is near enough at the middle one.
fn keys(frames: usize, holds: impl Fn([usize; 3]) -> bool) -> Vec<usize> {
    let reaches = |from: usize, to: usize| to < frames && (from + 1..to).all(|at| holds([from, at, to]));
    let mut keys = with_capacity(frames);
    keys.push(0);
    let mut from = 0;
    while from + 1 < frames {
        let mut step = 1;
        while reaches(from, from + 2 * step) {
            step *= 2;
        }
        let (mut near, mut far) = (from + step, from + 2 * step);
        while far - near > 1 {
            let middle = near.midpoint(far);
            *(if reaches(from, middle) { &mut near } else { &mut far }) = middle;
        }
        keys.push(near);
        from = near;
    }
    keys
}

/// Every frame between two keys, between those keys.
fn inner(keys: &[usize]) -> impl Iterator<Item = [usize; 3]> {
    keys.windows(2).flat_map(|pair| (pair[0] + 1..pair[1]).map(|at| [pair[0], at, pair[1]]))
}

fn share([from, at, to]: [usize; 3]) -> f32 {
    (at - from) as f32 / (to - from) as f32
}

fn between(a: &[f32], b: &[f32], share: f32) -> impl Iterator<Item = f32> {
    a.iter().zip(b).map(move |(a, b)| a + share * (b - a))
}

/// A moment of the motion that a file names.
#[derive(Clone, Debug, PartialEq)]
pub struct Marker {
    /// Its time from the first frame.
    pub seconds: f64,
    /// Its kind.
    pub kind: MarkerKind,
    /// The word, or the hands of the stroke.
    pub name: String,
}

/// Kind of a [`Marker`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkerKind {
    /// The stroke of a gesture begins.
    Stroke,
    /// A word begins.
    Word,
}

impl MarkerKind {
    /// Name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stroke => "stroke",
            Self::Word => "word",
        }
    }
}

/// Settings of a motion for people who edit its curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Keying {
    /// Largest error of the curves.
    pub bound: Bound,
    /// Its markers, by time.
    pub markers: Vec<Marker>,
}

impl Keying {
    /// The markers as glTF extras hold them.
    pub(crate) fn extras(&self) -> serde_json::Value {
        let marker = |Marker { seconds, kind, name }: &Marker| serde_json::json!({ "time": seconds, "kind": kind.name(), "name": name });
        serde_json::json!({ "markers": self.markers.iter().map(marker).collect::<Vec<_>>() })
    }
}
