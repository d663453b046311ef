//! Which of the figure's shapes each face channel moves.

use std::collections::BTreeMap;
use umo_figure::{Mesh, Morph};

/// One channel's shape: vertices of the head, ascending, counted from its first, and what is added
/// to them.
pub(crate) struct Shape {
    pub(crate) vertices: Vec<u32>,
    /// Metres.
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) normals: Vec<[f32; 3]>,
}

/// The shape that a name asks for. A name that is not ARKit's, such as an SMPL-X coefficient's,
/// gets one of ARKit's shapes by its spelling, a pair of them together: the coefficient's own is
/// not ours to give away, and this is enough to see it move.
pub(crate) fn shape(name: &str, mesh: &Mesh) -> Shape {
    if let Some(morph) = mesh.morphs.iter().find(|morph| morph.name == name) {
        return sum(&[morph], mesh.head);
    }
    // The FNV-1a hash: the same on every machine and in every version.
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
    sum(&[Some(chosen), twin].into_iter().flatten().collect::<Vec<_>>(), mesh.head)
}

/// The open jaw is its joint's, wherever names are not ARKit's.
fn opens_no_jaw(morph: &Morph) -> bool {
    !["jawOpen", "mouthClose"].contains(&morph.name)
}

fn sum(morphs: &[&Morph], first: usize) -> Shape {
    let mut all: BTreeMap<u32, [[f32; 3]; 2]> = BTreeMap::new();
    for morph in morphs {
        for (&vertex, moved) in morph.vertices.iter().zip(morph.positions.iter().zip(&morph.normals)) {
            let sums = all.entry(vertex).or_default();
            for (sums, moved) in sums.iter_mut().zip([moved.0, moved.1]) {
                sums.iter_mut().zip(moved).for_each(|(sum, moved)| *sum += moved);
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
