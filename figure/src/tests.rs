//! Checks in numbers that each shape does what its name says, and that skin weights and mesh are consistent.

use super::*;
use crate::sample;
use std::collections::{HashMap, HashSet};
use std::sync::LazyLock;
use umo_core_pose::skeleton::ARKIT_NAMES;
use vector::{distance, mirrored, sub};

mod clothes;
mod details;
mod eyes;
mod helpers;
mod mouth;

/// The default figure on the sample skeleton, and on that of a smaller person with other proportions.
static FIGURES: LazyLock<[Mesh; 2]> = LazyLock::new(|| {
    let first = sample::skeleton();
    let mut other = first.clone();
    for offset in &mut other.offsets_m {
        *offset = [offset[0] * 0.94, offset[1] * 0.86, offset[2] * 0.9];
    }
    [first, other].map(|skeleton| mannequin(&skeleton).unwrap())
});

/// Every figure on the sample skeleton.
static ALL: LazyLock<[Mesh; 4]> = LazyLock::new(|| Figure::ALL.map(|figure| figure.mesh(&sample::skeleton()).unwrap()));

/// The mesh with some shapes at 1.
fn shaped(mesh: &Mesh, names: &[&str]) -> Vec<V> {
    let weights: Vec<f32> = mesh.morphs.iter().map(|m| if names.contains(&m.name) { 1.0 } else { 0.0 }).collect();
    mesh.shaped(&weights).positions
}

fn morph<'a>(mesh: &'a Mesh, name: &str) -> &'a Morph {
    mesh.morphs.iter().find(|morph| morph.name == name).unwrap()
}

#[test]
fn the_mesh_is_sound() {
    for mesh in FIGURES.iter().chain(ALL.iter()) {
        let count = mesh.positions.len();
        assert!((8_000..36_000).contains(&count), "{count} vertices");
        assert!(mesh.indices.len() <= 3 * 60_000, "{} triangles", mesh.indices.len() / 3);
        for length in [
            mesh.normals.len(),
            mesh.colors.len(),
            mesh.finishes.len(),
            mesh.details.len(),
            mesh.detail_places.len(),
            mesh.tangents.len(),
            mesh.joints.len(),
            mesh.weights.len(),
            mesh.jaw.len(),
        ] {
            assert_eq!(length, count);
        }
        assert!(mesh.positions.as_flattened().iter().all(|x| x.is_finite()));
        assert!(mesh.normals.iter().all(|&n| (vector::length(n) - 1.0).abs() < 1e-4));
        for (joints, weights) in mesh.joints.iter().zip(&mesh.weights) {
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            assert!(weights.is_sorted_by(|a, b| a >= b), "the heaviest first");
            assert!(joints.iter().zip(weights).all(|(&joint, &weight)| weight > 0.0 || joint == 0));
        }
        let (triangles, _) = mesh.indices.as_chunks::<3>();
        for corners in triangles {
            assert!(corners.iter().all(|&corner| (corner as usize) < count));
            let head = corners.iter().filter(|&&corner| corner as usize >= mesh.head).count();
            assert!(head == 0 || head == 3, "no triangle is of both head and body");
        }
    }
}

#[test]
fn cloth_and_hands_are_closed_and_face_outwards() {
    for mesh in FIGURES.iter().chain(ALL.iter()) {
        let (triangles, _) = mesh.indices.as_chunks::<3>();
        let body = triangles.iter().filter(|corners| (corners[0] as usize) < mesh.head);
        let mut edges: HashMap<[usize; 2], i32> = HashMap::new();
        let mut against = 0;
        // Duplicates of a vertex count as one.
        let originals = mesh.originals();
        for &[a, b, c] in body {
            for [from, to] in [[a, b], [b, c], [c, a]].map(|edge| edge.map(|vertex| originals[vertex as usize])) {
                *edges.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
            }
            let [p, q, r] = [a, b, c].map(|i| mesh.positions[i as usize]);
            let facing = vector::cross(sub(q, p), sub(r, p));
            against += usize::from(vector::dot(facing, mesh.normals[a as usize]) < 0.0);
        }
        let open = edges.iter().filter(|(_, both)| **both != 0).map(|(edge, _)| mesh.positions[edge[0]]);
        let open: Vec<V> = open.collect();
        assert!(
            open.is_empty(),
            "{} edges are not walked both ways, near {:?}",
            open.len(),
            &open[..open.len().min(5)]
        );
        assert!(against * 200 < triangles.len(), "{against} triangles face inwards");
    }
}

#[test]
fn the_same_skeleton_gives_the_same_mesh() {
    let skeleton = sample::skeleton();
    let [a, b] = [(); 2].map(|()| mannequin(&skeleton).unwrap());
    assert_eq!(a.positions, b.positions);
    assert_eq!(a.indices, b.indices);
    assert!(a.morphs.iter().zip(&b.morphs).all(|(a, b)| a.positions == b.positions && a.vertices == b.vertices));
}

#[test]
fn a_skeleton_without_lengths_still_gives_a_mesh() {
    let mut skeleton = sample::skeleton();
    skeleton.offsets_m.fill([0.0; 3]);
    let mesh = mannequin(&skeleton).unwrap();
    assert!(mesh.positions.as_flattened().iter().chain(mesh.normals.as_flattened()).all(|x| x.is_finite()));
    skeleton.offsets_m[7][1] = f32::NAN;
    assert!(mannequin(&skeleton).is_err());
    skeleton.offsets_m.pop();
    assert!(mannequin(&skeleton).is_err());
}

#[test]
fn every_shape_moves_something_and_nothing_far() {
    for mesh in FIGURES.iter() {
        let names: Vec<&str> = mesh.morphs.iter().map(|morph| morph.name).collect();
        assert_eq!(names, ARKIT_NAMES);
        for morph in &mesh.morphs {
            let far: Vec<f32> = morph.positions.iter().map(|&by| vector::length(by)).collect();
            let furthest = far.iter().copied().fold(0.0, f32::max);
            assert!((0.001..0.06).contains(&furthest), "{} moves {furthest} m", morph.name);
            assert!(morph.vertices.is_sorted_by(|a, b| a < b) && morph.vertices[0] as usize >= mesh.head);
            assert_eq!(morph.vertices.len(), morph.positions.len());
            assert_eq!(morph.vertices.len(), morph.normals.len());
        }
    }
}

#[test]
fn left_shapes_move_the_left_and_right_ones_mirror_them() {
    let mesh = &FIGURES[0];
    for name in ARKIT_NAMES {
        let Some(stem) = name.strip_suffix("Left") else { continue };
        let other = format!("{stem}Right");
        let (left, right) = (morph(mesh, name), morph(mesh, &other));
        assert_eq!(left.vertices.len(), right.vertices.len(), "{name}");
        let mut found: HashMap<[i64; 3], Vec<V>> = HashMap::new();
        for (&vertex, &by) in right.vertices.iter().zip(&right.positions) {
            found.entry(key(mesh.positions[vertex as usize])).or_default().push(by);
        }
        for (&vertex, &by) in left.vertices.iter().zip(&left.positions) {
            let place = mesh.positions[vertex as usize];
            if vector::length(by) > 1e-3 {
                let twins =
                    found.get(&key(mirrored(place))).unwrap_or_else(|| panic!("{name} has no twin at {place:?}"));
                let near = twins.iter().any(|&twin| distance(mirrored(by), twin) < 1e-5);
                assert!(near, "{name} at {place:?}: {by:?} and {twins:?}");
            }
            if !["jaw", "mouth"].contains(&stem) {
                let beyond = if stem.starts_with("mouth") { head::shapes::ACROSS } else { 0.0 };
                assert!(place[0] > -1.2 * beyond || by == [0.0; 3], "{name} moves {place:?}");
            }
        }
    }
}

/// Position quantized to 0.05 mm.
#[expect(clippy::cast_possible_truncation, reason = "metres times a million")]
fn key(p: V) -> [i64; 3] {
    p.map(|x| (f64::from(x) * 2e4).round() as i64)
}

#[test]
fn brows_cheeks_and_nose_go_where_their_names_say() {
    let mesh = &FIGURES[0];
    // Upward motion of the vertex that moves furthest.
    let up = |name: &str| -> f32 {
        let all = morph(mesh, name).positions.iter();
        all.copied().max_by(|&a, &b| vector::length(a).total_cmp(&vector::length(b))).unwrap()[1]
    };
    for name in ["browInnerUp", "browOuterUpLeft", "cheekSquintLeft", "noseSneerLeft"] {
        assert!(up(name) > 0.004, "{name} goes {} m up", up(name));
    }
    assert!(up("browDownLeft") < -0.004);
    let puffed = shaped(mesh, &["cheekPuff"]);
    let wide = |all: &[V]| -> f32 {
        let cheeks = mesh.positions.iter().zip(all).filter(|(rest, _)| rest[0] > 0.03);
        cheeks.map(|(rest, now)| now[0] - rest[0]).fold(0.0, f32::max)
    };
    assert!(wide(&puffed) > 0.008);
    let moved: HashSet<u32> = morph(mesh, "browDownLeft").vertices.iter().copied().collect();
    let lips = morph(mesh, "mouthSmileLeft").vertices.iter().filter(|v| moved.contains(v)).count();
    assert!(lips * 4 < moved.len(), "a frown leaves the mouth alone");
}

/// The hand begins inside the sleeve, and bending the wrist to human limits does not expose its start.
#[test]
fn the_skin_under_the_sleeve_goes_with_the_forearm() {
    let skeleton = sample::skeleton();
    let (mesh, rest) = (&FIGURES[0], rest::Rest::new(&skeleton).unwrap());
    let (wrist, elbow) = (rest.side("left", "wrist"), rest.side("left", "elbow"));
    let along = vector::unit(sub(wrist, elbow));
    let cuff = -body::CUFF * rest.between("left_wrist", "left_elbow");
    let joint = usize::from(skin::number("left_wrist"));
    let is_hidden = |p: V| {
        let from = sub(p, wrist);
        (-0.05..cuff).contains(&vector::dot(from, along)) && vector::length(from) < 0.06
    };
    let hand = clothes::hand(mesh, "left");
    let hidden: Vec<usize> = hand.into_iter().filter(|&vertex| is_hidden(mesh.positions[vertex])).collect();
    assert!(hidden.len() > 20, "{}", hidden.len());
    for axis in 0..3 {
        for angle in [-1.0_f32, 1.0] {
            let mut rotations = [umo_core_pose::rotation::IDENTITY; umo_core_pose::skeleton::JOINTS];
            rotations[joint][axis] = (0.5 * angle).sin();
            rotations[joint][3] = (0.5 * angle).cos();
            let posed = mesh.posed(&skeleton, &rotations, [0.0; 3], &[]);
            for &vertex in &hidden {
                let thickness = |p: V| {
                    let from = sub(p, wrist);
                    vector::length(sub(from, vector::scale(along, vector::dot(from, along))))
                };
                let out = thickness(posed.positions[vertex]) - thickness(mesh.positions[vertex]);
                assert!(out < 5e-3, "vertex {vertex} comes out by {out} m when the wrist turns about axis {axis}");
            }
        }
    }
}

#[test]
fn the_jaw_joint_moves_chin_and_lower_lip_only() {
    let mesh = FIGURES[0].clone();
    let jaw = skin::number("jaw");
    assert!(mesh.joints.iter().flatten().all(|&joint| joint != jaw));
    let open = morph(&mesh, "jawOpen");
    let moved: HashSet<u32> = open.vertices.iter().copied().collect();
    let other = mesh.clone().on_the_jaw();
    let mut followers = 0;
    for (vertex, (joints, weights)) in other.joints.iter().zip(&other.weights).enumerate() {
        assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        if joints[0] == jaw {
            followers += 1;
            assert!(moved.contains(&u32::try_from(vertex).unwrap()), "what follows the joint follows the shape");
        }
    }
    assert!(followers > 300);
}
