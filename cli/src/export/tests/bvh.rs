use super::*;
use std::str::{FromStr, SplitWhitespace};

/// A joint as a BVH file describes it.
#[derive(Default)]
struct Joint {
    name: String,
    parent: Option<usize>,
    offset: Point,
    channels: Vec<String>,
}

/// A BVH reader that relies only on the grammar.
struct Bvh {
    joints: Vec<Joint>,
    seconds: f64,
    /// `[frames]` of `[channels]`
    motion: Vec<Vec<f64>>,
}

fn next<T: FromStr>(words: &mut SplitWhitespace<'_>) -> T {
    let word = words.next().expect("a word");
    word.parse().ok().unwrap_or_else(|| panic!("unexpected `{word}`"))
}

fn expect(words: &mut SplitWhitespace<'_>, want: &str) {
    assert_eq!(words.next(), Some(want));
}

fn offset(words: &mut SplitWhitespace<'_>) -> Point {
    expect(words, "OFFSET");
    std::array::from_fn(|_| next(words))
}

impl Bvh {
    fn parse(text: &str) -> Self {
        let words = &mut text.split_whitespace();
        let mut joints = Vec::new();
        expect(words, "HIERARCHY");
        expect(words, "ROOT");
        Self::joint(words, None, &mut joints);
        expect(words, "MOTION");
        expect(words, "Frames:");
        let frames: usize = next(words);
        expect(words, "Frame");
        expect(words, "Time:");
        let seconds = next(words);
        let width: usize = joints.iter().map(|j| j.channels.len()).sum();
        let row = |words: &mut SplitWhitespace<'_>| (0..width).map(|_| next(words)).collect();
        let motion = (0..frames).map(|_| row(words)).collect();
        assert_eq!(words.next(), None, "nothing follows the last frame");
        Self { joints, seconds, motion }
    }

    fn joint(words: &mut SplitWhitespace<'_>, parent: Option<usize>, joints: &mut Vec<Joint>) {
        let name = next(words);
        expect(words, "{");
        let offset = offset(words);
        expect(words, "CHANNELS");
        let count: usize = next(words);
        let channels = (0..count).map(|_| next(words)).collect();
        let at = joints.len();
        joints.push(Joint { name, parent, offset, channels });
        let mut below = 0;
        loop {
            match words.next().expect("a joint, an end or a brace") {
                "JOINT" => Self::joint(words, Some(at), joints),
                "End" => {
                    expect(words, "Site");
                    expect(words, "{");
                    assert_ne!(self::offset(words), [0.0; 3], "a bone has a length");
                    expect(words, "}");
                }
                "}" => break,
                word => panic!("unexpected `{word}`"),
            }
            below += 1;
        }
        assert!(below > 0, "a joint without children ends somewhere");
    }

    /// Returns the positions of a frame by joint name, in the file's unit.
    fn positions(&self, frame: usize) -> Vec<(&str, Point)> {
        let mut numbers = self.motion[frame].iter();
        let mut turned: Vec<[f64; 4]> = Vec::new();
        let mut places: Vec<Point> = Vec::new();
        for joint in &self.joints {
            let mut step = joint.offset;
            let mut q = [0.0, 0.0, 0.0, 1.0];
            for channel in &joint.channels {
                let value = numbers.next().unwrap();
                let (sin, cos) = (value.to_radians() / 2.0).sin_cos();
                match channel.as_str() {
                    "Xposition" => step[0] += value,
                    "Yposition" => step[1] += value,
                    "Zposition" => step[2] += value,
                    "Xrotation" => q = multiply(q, [sin, 0.0, 0.0, cos]),
                    "Yrotation" => q = multiply(q, [0.0, sin, 0.0, cos]),
                    "Zrotation" => q = multiply(q, [0.0, 0.0, sin, cos]),
                    _ => panic!("unknown channel {channel}"),
                }
            }
            if let Some(parent) = joint.parent {
                let step = rotate(turned[parent], step);
                places.push(std::array::from_fn(|i| places[parent][i] + step[i]));
                turned.push(multiply(turned[parent], q));
            } else {
                places.push(step);
                turned.push(q);
            }
        }
        let names = self.joints.iter().map(|j| j.name.as_str());
        names.zip(places).collect()
    }
}

fn read(clip: &Clip) -> Bvh {
    let bytes = bytes_of(|clip, out| super::super::bvh::write(clip, out), clip);
    Bvh::parse(std::str::from_utf8(&bytes).unwrap())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn bvh_puts_every_joint_where_the_quaternions_do(clip in any_clip(FaceKind::Arkit, 3)) {
        let bvh = read(&clip);
        for frame in 0..3 {
            let want = positions(&clip, frame);
            let found = bvh.positions(frame);
            prop_assert_eq!(found.len(), JOINTS);
            for (name, place) in found {
                let joint = umo_core::JOINT_NAMES.iter().position(|&n| n == name).unwrap();
                let cm = want[joint].map(|x| x * 100.0);
                prop_assert!(distance(place, cm) < 1e-3, "{} {:?} {:?}", name, place, cm);
            }
        }
    }
}

#[test]
fn bvh_keeps_the_frame_rate() {
    let bvh = read(&sample::clip(FaceKind::SmplxExpression, 7, 1));
    assert_eq!(bvh.motion.len(), 7);
    assert!((bvh.seconds - 1.0 / 30.0).abs() < 1e-9);
}

#[test]
fn bvh_angles_do_not_jump_between_frames() {
    // A joint that keeps rotating about one axis, at 20 degrees a frame.
    let mut clip = sample::clip(FaceKind::Arkit, 60, 0);
    for axis in 0..3 {
        for (frame, rotations) in clip.rotations.iter_mut().enumerate() {
            let (sin, cos) = (frame as f32 * 10.0).to_radians().sin_cos();
            rotations[0] = [0.0, 0.0, 0.0, cos];
            rotations[0][axis] = sin;
        }
        let bvh = read(&clip);
        let jump = |pair: &[Vec<f64>]| -> f64 { (3..6).map(|i| (pair[0][i] - pair[1][i]).abs()).fold(0.0, f64::max) };
        let largest = bvh.motion.windows(2).map(jump).fold(0.0, f64::max);
        assert!((largest - 20.0).abs() < 1e-2, "axis {axis}: {largest}");
    }
}

#[test]
fn bvh_with_few_keys_has_every_frame_of_their_motion_and_markers_behind_its_first_word() {
    let clip = sample::clip(FaceKind::Arkit, 40, 1);
    let keying = super::keying(2.0);
    let few = bytes_of(|clip, out| super::super::bvh::write_keyed(clip, Some(&keying), out), &clip);
    let few = String::from_utf8(few).unwrap();
    let drawn = bytes_of(|clip, out| super::super::bvh::write(clip, out), &keying.bound.drawn(&clip));
    let (first, rest) = few.split_once('\n').unwrap();
    assert_eq!(first, "HIERARCHY # 0.260 stroke left; 0.560 word so_far; 9.000 stroke both;");
    assert_eq!(rest, String::from_utf8(drawn).unwrap().split_once('\n').unwrap().1);
    let read = crate::bvh::Bvh::parse(&few).unwrap();
    assert!(few[read.hierarchy..].starts_with("MOTION"));
    assert_eq!(read.motion, crate::bvh::Bvh::parse(&format!("HIERARCHY\n{rest}")).unwrap().motion);
}
