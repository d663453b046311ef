//! How each face channel moves the face: a smooth bump of displacement where its name says.

use super::face::{Head, LIPS, Point};

/// The vertices that a shape may move.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Both,
    /// Above the line between the lips.
    Above,
    /// Below it.
    Below,
}

/// A shape on the body's left side, or in the middle.
struct Shape {
    /// The channel's name without `Left` or `Right`.
    stem: &'static str,
    part: Part,
    /// Degrees left and up.
    centre: [f32; 2],
    /// Degrees.
    radius: f32,
    /// Centimetres left, up and forward.
    by: [f32; 3],
}

const fn shape(stem: &'static str, part: Part, centre: [f32; 2], radius: f32, by: [f32; 3]) -> Shape {
    Shape { stem, part, centre, radius, by }
}

use Part::{Above, Below, Both};

/// ARKit's shapes; one row serves a left and a right channel.
const SHAPES: [Shape; 33] = [
    shape("eyeBlink", Both, [24.0, 17.0], 9.0, [0.0, -1.2, 0.2]),
    shape("eyeLookDown", Both, [24.0, 13.0], 7.0, [0.0, -0.5, 0.1]),
    shape("eyeLookIn", Both, [24.0, 13.0], 7.0, [-0.5, 0.0, 0.1]),
    shape("eyeLookOut", Both, [24.0, 13.0], 7.0, [0.5, 0.0, 0.1]),
    shape("eyeLookUp", Both, [24.0, 13.0], 7.0, [0.0, 0.5, 0.1]),
    shape("eyeSquint", Both, [24.0, 7.0], 9.0, [0.0, 0.6, 0.1]),
    shape("eyeWide", Both, [24.0, 19.0], 9.0, [0.0, 0.8, 0.0]),
    shape("jawForward", Below, [0.0, -52.0], 22.0, [0.0, 0.0, 1.2]),
    shape("jaw", Below, [0.0, -50.0], 22.0, [1.2, 0.0, 0.0]),
    shape("jawOpen", Below, [0.0, -42.0], 20.0, [0.0, -2.6, -0.5]),
    shape("mouthClose", Below, [0.0, LIPS], 10.0, [0.0, 0.7, 0.1]),
    shape("mouthFunnel", Both, [0.0, LIPS], 12.0, [0.0, 0.0, 1.0]),
    shape("mouthPucker", Both, [0.0, LIPS], 8.0, [0.0, 0.0, 1.5]),
    shape("mouth", Both, [0.0, LIPS], 14.0, [1.0, 0.0, 0.0]),
    shape("mouthSmile", Both, [19.0, LIPS], 10.0, [0.7, 1.0, -0.2]),
    shape("mouthFrown", Both, [19.0, LIPS], 10.0, [0.1, -1.0, 0.0]),
    shape("mouthDimple", Both, [21.0, LIPS], 8.0, [0.3, 0.0, -0.6]),
    shape("mouthStretch", Both, [20.0, -33.0], 11.0, [0.9, -0.3, 0.0]),
    shape("mouthRollLower", Below, [0.0, -34.0], 9.0, [0.0, 0.3, -0.7]),
    shape("mouthRollUpper", Above, [0.0, -26.0], 9.0, [0.0, -0.3, -0.7]),
    shape("mouthShrugLower", Below, [0.0, -38.0], 10.0, [0.0, 0.6, 0.4]),
    shape("mouthShrugUpper", Above, [0.0, -25.0], 10.0, [0.0, 0.5, 0.4]),
    shape("mouthPress", Both, [11.0, LIPS], 9.0, [0.0, 0.0, -0.5]),
    shape("mouthLowerDown", Below, [8.0, -33.0], 10.0, [0.0, -0.9, 0.0]),
    shape("mouthUpperUp", Above, [8.0, -27.0], 10.0, [0.0, 0.9, 0.1]),
    shape("browDown", Both, [22.0, 27.0], 10.0, [-0.1, -0.9, 0.1]),
    shape("browInnerUp", Both, [0.0, 27.0], 12.0, [0.0, 1.0, 0.1]),
    shape("browOuterUp", Both, [34.0, 28.0], 10.0, [0.0, 1.0, 0.0]),
    shape("cheekPuff", Both, [36.0, -18.0], 13.0, [0.7, 0.0, 1.0]),
    shape("cheekSquint", Both, [32.0, -1.0], 10.0, [0.0, 0.7, 0.2]),
    shape("noseSneer", Both, [8.0, -2.0], 8.0, [0.0, 0.7, 0.2]),
    shape("tongueOut", Below, [0.0, -33.0], 7.0, [0.0, -0.2, 2.0]),
    shape("nose", Both, [0.0, -6.0], 9.0, [0.0, 0.3, 0.6]),
];

/// Which sides of the face a channel moves.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Sides {
    Left,
    Right,
    Both,
}

/// The shape that a name asks for. A name that is not ARKit's, such as an SMPL-X coefficient's, gets one
/// of these shapes by its spelling: the coefficient's own is not ours to give away, and the mask's is enough
/// to see it move.
fn find(name: &str) -> (&'static Shape, Sides) {
    let by_stem = |stem: &str| SHAPES.iter().find(|shape| shape.stem == stem);
    if let Some(shape) = by_stem(name) {
        return (shape, Sides::Both);
    }
    for (suffix, side) in [("Left", Sides::Left), ("Right", Sides::Right)] {
        if let Some(shape) = name.strip_suffix(suffix).and_then(by_stem) {
            return (shape, side);
        }
    }
    // The FNV-1a hash: the same on every machine and in every version.
    let hash = name.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    let count = SHAPES.len();
    (&SHAPES[hash as usize % count], Sides::Both)
}

/// How far each vertex of the head moves at weight 1. `[vertices]`, metres.
pub(super) fn displacements(name: &str, head: &Head) -> Vec<[f32; 3]> {
    let (shape, sides) = find(name);
    let middle = shape.centre[0] == 0.0;
    let points = head.points.iter();
    points
        .map(|point| {
            let mut moved = [0.0; 3];
            if sides != Sides::Right {
                accumulate(&mut moved, shape, point, 1.0);
            }
            // A shape in the middle is its own mirror image, unless it is the right one of a pair.
            if sides == Sides::Right || (sides == Sides::Both && !middle) {
                accumulate(&mut moved, shape, point, -1.0);
            }
            moved
        })
        .collect()
}

/// Adds the shape, mirrored where `side` is -1.
fn accumulate(moved: &mut [f32; 3], shape: &Shape, point: &Point, side: f32) {
    let free = match (shape.part, point.lower) {
        (Part::Both, _) => 1.0,
        (Part::Above, false) | (Part::Below, true) => point.free,
        (Part::Above, true) | (Part::Below, false) => return,
    };
    let x = (point.left * side - shape.centre[0]) / shape.radius;
    let y = (point.up - shape.centre[1]) / shape.radius;
    let square = x * x + y * y;
    // Beyond three radii nothing moves: most of a shape's numbers are then exactly 0.
    if square < 9.0 {
        let metres = 0.01 * free * (-0.5 * square).exp();
        moved[0] += shape.by[0] * metres * side;
        moved[1] += shape.by[1] * metres;
        moved[2] += shape.by[2] * metres;
    }
}
