//! Assigns the figure's shapes to face channels.

use std::collections::BTreeMap;
use umo_core_pose::rotation::{Quat, rotate};
use umo_core_pose::visemes;
use umo_figure::{Mesh, Morph};

/// Shape of one channel: vertex indices, ascending and relative to the head's first vertex, with the displacements.
pub(crate) struct Shape {
    pub(crate) vertices: Vec<u32>,
    /// Metres.
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) normals: Vec<[f32; 3]>,
}

/// Returns the shape of a name. A name that is not ARKit's, such as an SMPL-X coefficient's, gets one of ARKit's
/// shapes by its hash, both sides of a pair together. The coefficient's own shape may not be redistributed, and this
/// suffices to see it move.
pub(crate) fn shape(name: &str, mesh: &Mesh) -> Shape {
    if let Some(morph) = mesh.morphs.iter().find(|morph| morph.name == name) {
        return sum(&[(morph, 1.0)], mesh.head);
    }
    // FNV-1a, so that the choice is the same on every machine and in every version.
    let hash = name.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    let left = mesh.morphs.iter().filter(|morph| !morph.name.ends_with("Right"));
    let left: Vec<&Morph> = left.filter(|morph| opens_no_jaw(morph)).collect();
    let chosen = left[hash as usize % left.len()];
    let twin = chosen.name.strip_suffix("Left").and_then(|stem| {
        let right = format!("{stem}Right");
        mesh.morphs.iter().find(|morph| morph.name == right)
    });
    // A push to the left and one to the right would cancel out.
    let twin = twin.filter(|_| !["jawLeft", "mouthLeft"].contains(&chosen.name));
    sum(&[Some(chosen), twin].into_iter().flatten().map(|morph| (morph, 1.0)).collect::<Vec<_>>(), mesh.head)
}

/// Whether a shape leaves the jaw closed: if names are not ARKit's, the jaw's joint opens it.
fn opens_no_jaw(morph: &Morph) -> bool {
    !["jawOpen", "mouthClose"].contains(&morph.name)
}

/// A viseme of the Oculus set, composed of ARKit's shapes.
pub(crate) fn viseme(at: usize, mesh: &Mesh) -> Shape {
    let find = |name| mesh.morphs.iter().find(move |morph| morph.name == name);
    let morphs: Vec<_> = visemes::shape(at).filter_map(|(name, share)| Some((find(name)?, share))).collect();
    sum(&morphs, mesh.head)
}

/// Extends a shape by eyeball rotations, which elsewhere the eyes' joints perform: `turns` holds joint, rotation and
/// the joint's position.
pub(crate) fn with_eyes(shape: Shape, mesh: &Mesh, turns: &[(usize, Quat, [f32; 3])]) -> Shape {
    let mut moved: BTreeMap<u32, [[f32; 3]; 2]> = BTreeMap::new();
    let old = shape.positions.into_iter().zip(shape.normals).map(|(position, normal)| [position, normal]);
    moved.extend(shape.vertices.into_iter().zip(old));
    for &(joint, turn, center) in turns {
        for vertex in mesh.head..mesh.positions.len() {
            let own = mesh.joints[vertex].iter().zip(mesh.weights[vertex]).find(|(of, _)| usize::from(**of) == joint);
            let Some((_, weight)) = own.filter(|(_, weight)| *weight > 0.0) else { continue };
            let arm: [f32; 3] = std::array::from_fn(|axis| mesh.positions[vertex][axis] - center[axis]);
            let (to, normal) = (rotate(turn, arm), rotate(turn, mesh.normals[vertex]));
            let sums =
                moved.entry(u32::try_from(vertex - mesh.head).expect("the figure has few vertices")).or_default();
            for axis in 0..3 {
                sums[0][axis] += weight * (to[axis] - arm[axis]);
                sums[1][axis] += weight * (normal[axis] - mesh.normals[vertex][axis]);
            }
        }
    }
    Shape {
        vertices: moved.keys().copied().collect(),
        positions: moved.values().map(|moved| moved[0]).collect(),
        normals: moved.values().map(|moved| moved[1]).collect(),
    }
}

fn sum(morphs: &[(&Morph, f32)], first: usize) -> Shape {
    let mut all: BTreeMap<u32, [[f32; 3]; 2]> = BTreeMap::new();
    for (morph, share) in morphs {
        for (&vertex, moved) in morph.vertices.iter().zip(morph.positions.iter().zip(&morph.normals)) {
            let sums = all.entry(vertex).or_default();
            for (sums, moved) in sums.iter_mut().zip([moved.0, moved.1]) {
                sums.iter_mut().zip(moved).for_each(|(sum, moved)| *sum += share * moved);
            }
        }
    }
    let first = u32::try_from(first).expect("the figure has few vertices");
    Shape {
        vertices: all.keys().map(|vertex| vertex - first).collect(),
        positions: all.values().map(|moved| moved[0]).collect(),
        normals: all.values().map(|moved| moved[1]).collect(),
    }
}
