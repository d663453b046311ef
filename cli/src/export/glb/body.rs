//! The body: one octahedron per bone, which follows the joint that the bone starts at.

use super::Surface;
use crate::export::{children, tip};
use umo_core::motion::clip::Clip;
use umo_core::motion::skeleton::JOINTS;

/// Where the octahedron is widest, as a part of the bone's length, and how wide.
const WAIST_AT: f32 = 0.2;
const WAIST: f32 = 0.13;
/// Half width of the widest and the narrowest bone, metres.
const WIDTHS: (f32, f32) = (0.004, 0.045);
/// A bone shorter than this, in metres, has no direction to speak of.
const SHORTEST: f32 = 1e-4;

pub(super) fn add(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(super) fn subtract(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    add(a, scale(b, -1.0))
}

pub(super) fn scale(a: [f32; 3], by: f32) -> [f32; 3] {
    a.map(|x| x * by)
}

pub(super) fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn length(a: [f32; 3]) -> f32 {
    a.iter().map(|x| x * x).sum::<f32>().sqrt()
}

pub(super) fn unit(a: [f32; 3]) -> [f32; 3] {
    scale(a, 1.0 / length(a))
}

/// The bones from each joint to its children, and one beyond each joint that has none.
pub(super) fn bones(clip: &Clip, rest: &[[f32; 3]]) -> Surface {
    let mut surface = Surface::default();
    for (joint, &from) in rest.iter().enumerate().take(JOINTS) {
        let mut leaf = true;
        for child in children(clip, joint) {
            leaf = false;
            add_bone(&mut surface, joint, from, rest[child]);
        }
        if leaf {
            add_bone(&mut surface, joint, from, add(from, tip(clip, joint)));
        }
    }
    surface
}

fn add_bone(surface: &mut Surface, joint: usize, from: [f32; 3], to: [f32; 3]) {
    let along = subtract(to, from);
    let size = length(along);
    if size < SHORTEST {
        return;
    }
    // Any direction that is not the bone's own gives two more across it.
    let other = if along[0].abs() < 0.7 * size { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let right = unit(cross(along, other));
    let front = unit(cross(along, right));
    let width = (size * WAIST).clamp(WIDTHS.0, WIDTHS.1);
    let middle = add(from, scale(along, WAIST_AT));
    let corner = |axis, by| add(middle, scale(axis, by));
    let ring = [corner(right, width), corner(front, width), corner(right, -width), corner(front, -width)];
    for i in 0..4 {
        let (a, b) = (ring[i], ring[(i + 1) % 4]);
        add_facet(surface, joint, [to, a, b]);
        add_facet(surface, joint, [from, b, a]);
    }
}

/// A flat triangle with corners of its own, so that the edges are sharp.
fn add_facet(surface: &mut Surface, joint: usize, corners: [[f32; 3]; 3]) {
    let [a, b, c] = corners;
    let normal = unit(cross(subtract(b, a), subtract(c, a)));
    let joint = u8::try_from(joint).expect("there are 55 joints");
    for corner in corners {
        let at = u16::try_from(surface.positions.len()).expect("55 bones have few corners");
        surface.indices.push(at);
        surface.positions.push(corner);
        surface.normals.push(normal);
        surface.joints.push([joint, 0, 0, 0]);
        surface.weights.push([1.0, 0.0, 0.0, 0.0]);
    }
}
