//! The mesh in a pose, computed on the CPU for pictures and tests.

use super::Mesh;
use super::vector::{V, add, dot, scale, sub, unit};
use umo_core_pose::rotation::{IDENTITY, Matrix, Quat, product, quat_to_matrix, rotate};
use umo_core_pose::skeleton::{JOINTS, Skeleton};

/// Positions and normals of all vertices.
pub struct Posed {
    /// `[vertices]`, metres.
    pub positions: Vec<V>,
    /// Unit length.
    pub normals: Vec<V>,
}

impl Mesh {
    /// Returns the rest pose with the shapes at `weights` (one per morph, or none).
    pub fn shaped(&self, weights: &[f32]) -> Posed {
        let mut posed = Posed { positions: self.positions.clone(), normals: self.normals.clone() };
        for (morph, &weight) in self.morphs.iter().zip(weights) {
            if weight == 0.0 {
                continue;
            }
            let moves = morph.positions.iter().zip(&morph.normals);
            for (&vertex, (&position, &normal)) in morph.vertices.iter().zip(moves) {
                let vertex = vertex as usize;
                posed.positions[vertex] = add(posed.positions[vertex], scale(position, weight));
                posed.normals[vertex] = add(posed.normals[vertex], scale(normal, weight));
            }
        }
        posed.normals.iter_mut().for_each(|normal| *normal = unit(*normal));
        posed
    }

    /// Poses the mesh: joints rotated by `rotations`, the root translated by `translation`, shapes at `weights`.
    pub fn posed(&self, skeleton: &Skeleton, rotations: &[Quat; JOINTS], translation: V, weights: &[f32]) -> Posed {
        let mut posed = self.shaped(weights);
        let moves = self.moves(skeleton, rotations, translation);
        for vertex in 0..self.positions.len() {
            let (position, normal) = (posed.positions[vertex], posed.normals[vertex]);
            let (mut place, mut facing) = ([0.0; 3], [0.0; 3]);
            for (&joint, &weight) in self.joints[vertex].iter().zip(&self.weights[vertex]) {
                if weight > 0.0 {
                    let (matrix, shift) = &moves[usize::from(joint)];
                    place = add(place, scale(add(turned(matrix, position), *shift), weight));
                    facing = add(facing, scale(turned(matrix, normal), weight));
                }
            }
            posed.positions[vertex] = place;
            posed.normals[vertex] = unit(facing);
        }
        posed
    }

    /// Transforms of each joint, then of each helper joint, from rest to the pose: a rotation, then a translation.
    pub(crate) fn moves(&self, skeleton: &Skeleton, rotations: &[Quat; JOINTS], translation: V) -> Vec<(Matrix, V)> {
        let (mut rest, mut places, mut turns) = ([[0.0; 3]; JOINTS], [translation; JOINTS], [IDENTITY; JOINTS]);
        let mut above = [IDENTITY; JOINTS];
        for (joint, (&parent, &offset)) in skeleton.parents.iter().zip(&skeleton.offsets_m).enumerate() {
            let Ok(parent) = usize::try_from(parent) else {
                (rest[joint], places[joint], turns[joint]) = (offset, add(translation, offset), rotations[joint]);
                continue;
            };
            above[joint] = turns[parent];
            rest[joint] = add(rest[parent], offset);
            places[joint] = add(places[parent], rotate(turns[parent], offset));
            turns[joint] = product(turns[parent], rotations[joint]);
        }
        let helpers = self.helpers.iter().map(|one| (one.of, product(above[one.of], one.turn(rotations[one.of]))));
        let all = turns.iter().copied().enumerate().chain(helpers);
        let moved = all.map(|(joint, turn)| {
            let matrix = quat_to_matrix(turn);
            (matrix, sub(places[joint], turned(&matrix, rest[joint])))
        });
        moved.collect()
    }
}

pub(crate) fn turned(matrix: &Matrix, v: V) -> V {
    matrix.map(|row| dot(row, v))
}
