//! Contact sheet: the face in each of the 52 shapes, with its name.

use super::letters::write;
use super::{Camera, Picture};
use crate::{Mesh, Morph};
use umo_core_pose::face::{Face, FaceKind};
use umo_core_pose::pose::Assembly;
use umo_core_pose::rotation::IDENTITY;
use umo_core_pose::skeleton::{ARKIT_NAMES, JOINTS, Skeleton};

const COLUMNS: usize = 8;
/// Size of one face, and height of the line below it, in pixels.
const FACE: [usize; 2] = [150, 162];
const LINE: usize = 13;

/// Draws the face at rest, then with each shape at 1 (`mouthClose` together with `jawOpen`, as intended).
pub fn shapes(mesh: &Mesh, skeleton: &Skeleton) -> Picture {
    let rows = (ARKIT_NAMES.len() + 1).div_ceil(COLUMNS);
    let mut picture = Picture::new(COLUMNS * FACE[0], rows * (FACE[1] + LINE));
    let eyes = face_of(mesh);
    let names = std::iter::once("rest").chain(ARKIT_NAMES);
    for (cell, name) in names.enumerate() {
        let (left, top) = (cell % COLUMNS * FACE[0], cell / COLUMNS * (FACE[1] + LINE));
        let weights: [f32; 52] = std::array::from_fn(|at| {
            let with = name == "mouthClose" && ARKIT_NAMES[at] == "jawOpen";
            if with || ARKIT_NAMES[at] == name { 1.0 } else { 0.0 }
        });
        let mut rotations = [IDENTITY; JOINTS];
        let names = ARKIT_NAMES.map(str::to_owned).to_vec();
        Assembly::new(&Face { kind: FaceKind::Arkit, names }).turn_eyes(&weights, &mut rotations);
        let posed = mesh.posed(skeleton, &rotations, [0.0; 3], &weights);
        let camera = Camera { eye: [eyes[0] + 0.55, eyes[1] + 0.1, eyes[2] + 2.0], target: eyes, height: 0.215 };
        picture.draw(mesh, &posed, camera, [left, top, FACE[0], FACE[1]]);
        write(&mut picture, name, [left + 4, top + FACE[1] + 3]);
    }
    picture
}

/// Middle of the face, between lids and lips.
fn face_of(mesh: &Mesh) -> [f32; 3] {
    let seen = |morph: &&Morph| morph.name.starts_with("eyeBlink") || morph.name.starts_with("mouthFrown");
    let moved = mesh.morphs.iter().filter(seen).flat_map(|morph| &morph.vertices);
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for &vertex in moved {
        let place = mesh.positions[vertex as usize];
        low = std::array::from_fn(|i| low[i].min(place[i]));
        high = std::array::from_fn(|i| high[i].max(place[i]));
    }
    std::array::from_fn(|i| 0.5 * (low[i] + high[i]))
}
