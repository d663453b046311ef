//! Builds the left half of a surface, and mirrors it.

use super::{Kind, Vertex};
use crate::vector::{V, add, cross, dot, length, mirrored, scale, sub, unit};

/// Vertices and triangles; vertices at X = 0 belong to both halves.
#[derive(Default)]
pub(super) struct Sheet {
    pub(super) vertices: Vec<Vertex>,
    pub(super) triangles: Vec<[usize; 3]>,
}

impl Sheet {
    pub(super) fn add(&mut self, place: V, kind: Kind, color: [u8; 3]) -> usize {
        self.vertices.push(Vertex { place, kind, color, smooth: self.vertices.len() });
        self.vertices.len() - 1
    }

    /// Duplicates a vertex in another colour.
    pub(super) fn recolored(&mut self, at: usize, color: [u8; 3]) -> usize {
        self.vertices.push(Vertex { color, ..self.vertices[at] });
        self.vertices.len() - 1
    }

    /// Adds triangles between two rows of vertices. Seen from outside, `upper` is to the left when walking along
    /// `lower`.
    pub(super) fn strip(&mut self, lower: &[usize], upper: &[usize]) {
        for (low, high) in lower.windows(2).zip(upper.windows(2)) {
            let (a, b, c, d) = (low[0], low[1], high[1], high[0]);
            let at = |i: usize| self.vertices[i].place;
            if length(sub(at(a), at(c))) <= length(sub(at(b), at(d))) {
                self.triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                self.triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
    }

    /// Completes the surface by its mirror image.
    pub(super) fn whole(mut self) -> Self {
        // Triangles with coincident corners are degenerate.
        let flat = |t: &[usize; 3], s: &Self| {
            let [a, b, c] = t.map(|i| s.vertices[i].place);
            length(cross(sub(b, a), sub(c, a))) < 1e-12
        };
        let kept: Vec<_> = self.triangles.iter().copied().filter(|t| !flat(t, &self)).collect();
        self.triangles = kept;
        let count = self.vertices.len();
        let mut twin: Vec<usize> = Vec::with_capacity(count);
        for at in 0..count {
            let vertex = self.vertices[at];
            if vertex.place[0].abs() < 1e-6 {
                self.vertices[at].place[0] = 0.0;
                twin.push(at);
            } else {
                twin.push(self.vertices.len());
                let smooth = twin.get(vertex.smooth).copied().unwrap_or(self.vertices.len());
                self.vertices.push(Vertex { place: mirrored(vertex.place), smooth, ..vertex });
            }
        }
        for at in 0..self.triangles.len() {
            let [a, b, c] = self.triangles[at].map(|i| twin[i]);
            self.triangles.push([a, c, b]);
        }
        self
    }

    /// Sums of the normals around each vertex, weighted by the triangles' angles, for vertices at `places`.
    pub(super) fn facing(&self, places: &[V]) -> Vec<V> {
        let mut sums = vec![[0.0; 3]; places.len()];
        for triangle in &self.triangles {
            self.face(triangle, places, 1.0, &mut sums);
        }
        sums
    }

    /// Updates such sums after some vertices have moved `from` one place `to` another; only the triangles around
    /// those are summed again.
    pub(super) fn facing_after(&self, before: &[V], from: &[V], to: &[V]) -> Vec<V> {
        let mut sums = before.to_vec();
        for triangle in &self.triangles {
            if triangle.iter().any(|&i| from[i] != to[i]) {
                self.face(triangle, from, -1.0, &mut sums);
                self.face(triangle, to, 1.0, &mut sums);
            }
        }
        sums
    }

    /// Unit normals from such sums.
    pub(super) fn normals(&self, sums: &[V]) -> Vec<V> {
        self.vertices.iter().map(|vertex| unit(sums[vertex.smooth])).collect()
    }

    fn face(&self, triangle: &[usize; 3], places: &[V], times: f32, sums: &mut [V]) {
        let at = triangle.map(|i| places[i]);
        let face = cross(sub(at[1], at[0]), sub(at[2], at[0]));
        let size = length(face);
        if size < 1e-14 {
            return;
        }
        for k in 0..3 {
            let (a, b) = (sub(at[(k + 1) % 3], at[k]), sub(at[(k + 2) % 3], at[k]));
            let angle = size.atan2(dot(a, b));
            let sum = &mut sums[self.vertices[triangle[k]].smooth];
            *sum = add(*sum, scale(face, times * angle / size));
        }
    }
}
