//! Meshes the surface of a solid by surface nets on a non-uniform grid, with vertices projected onto the surface.

use super::Part;
use super::field::Solid;
use super::vector::{V, add, distance, mix, scale, unit};

/// Planes of a grid along X, Y and Z, in metres, ascending.
pub(super) struct Grid(pub(super) [Vec<f32>; 3]);

/// Planes from `low` to `high`; `step(at)` is the distance to the next one.
pub(super) fn planes(low: f32, high: f32, step: impl Fn(f32) -> f32) -> Vec<f32> {
    let mut at = low;
    let mut all = vec![at];
    while at < high {
        at += step(at);
        all.push(at);
    }
    all
}

/// Like [`planes`], symmetric about 0, with a plane at 0.
pub(super) fn even_planes(high: f32, step: impl Fn(f32) -> f32) -> Vec<f32> {
    let right = planes(0.0, high, step);
    right.iter().skip(1).rev().map(|x| -x).chain(right.iter().copied()).collect()
}

impl Grid {
    fn sizes(&self) -> [usize; 3] {
        [self.0[0].len(), self.0[1].len(), self.0[2].len()]
    }

    fn corner(&self, [i, j, k]: [usize; 3]) -> V {
        [self.0[0][i], self.0[1][j], self.0[2][k]]
    }
}

/// Vertices, normals and triangles of the surface inside the grid.
pub(super) fn surface(solid: &Solid, grid: &Grid) -> Part {
    let [nx, ny, nz] = grid.sizes();
    let index = |[i, j, k]: [usize; 3]| (i * ny + j) * nz + k;
    let field = sampled(solid, grid);
    let mut part = Part::default();
    let mut vertex = vec![u32::MAX; nx * ny * nz];
    for i in 0..nx - 1 {
        for j in 0..ny - 1 {
            for k in 0..nz - 1 {
                let cell = [i, j, k];
                if let Some(start) = crossing(cell, grid, |corner| field[index(corner)]) {
                    let [low, high] = [grid.corner(cell), grid.corner([i + 1, j + 1, k + 1])];
                    let place = solid.settle(start, 0.35 * distance(low, high));
                    vertex[index(cell)] = u32::try_from(part.positions.len()).expect("a grid has few cells");
                    part.positions.push(place);
                    part.normals.push(unit(solid.gradient(place)));
                }
            }
        }
    }
    for i in 1..nx - 1 {
        for j in 1..ny - 1 {
            for k in 1..nz - 1 {
                for axis in 0..3 {
                    add_face(&mut part, [i, j, k], axis, |at| field[index(at)], |cell| vertex[index(cell)]);
                }
            }
        }
    }
    part
}

/// Number of corners along a side of the blocks that are tested together.
const BLOCK: usize = 4;
/// A block is far from the surface if the field at its centre exceeds its half diagonal by this factor; the field is
/// only approximately a distance.
const FAR: f32 = 1.8;

/// The field at the grid's corners; far from the surface, the value of a nearby point.
fn sampled(solid: &Solid, grid: &Grid) -> Vec<f32> {
    let [nx, ny, nz] = grid.sizes();
    let mut field = vec![0.0; nx * ny * nz];
    let starts = |n: usize| (0..n).step_by(BLOCK).map(move |from| (from, (from + BLOCK).min(n)));
    for (i, i_end) in starts(nx) {
        for (j, j_end) in starts(ny) {
            for (k, k_end) in starts(nz) {
                let (low, high) = (grid.corner([i, j, k]), grid.corner([i_end - 1, j_end - 1, k_end - 1]));
                let middle = solid.at(mix(low, high, 0.5));
                let far = middle.abs() > FAR * 0.5 * distance(low, high);
                for i in i..i_end {
                    for j in j..j_end {
                        for k in k..k_end {
                            let at = (i * ny + j) * nz + k;
                            field[at] = if far { middle } else { solid.at(grid.corner([i, j, k])) };
                        }
                    }
                }
            }
        }
    }
    field
}

/// Mean of the points where the cell's edges cross the surface.
fn crossing(cell: [usize; 3], grid: &Grid, field: impl Fn([usize; 3]) -> f32) -> Option<V> {
    let [i, j, k] = cell;
    let inside = (0..8).filter(|bit| field([i + (bit & 1), j + (bit >> 1 & 1), k + (bit >> 2)]) < 0.0).count();
    if inside == 0 || inside == 8 {
        return None;
    }
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in 0..4 {
            let mut from = cell;
            from[u] += side & 1;
            from[v] += side >> 1;
            let mut to = from;
            to[axis] += 1;
            let (a, b) = (field(from), field(to));
            if (a < 0.0) != (b < 0.0) {
                sum = add(sum, mix(grid.corner(from), grid.corner(to), a / (a - b)));
                count += 1.0;
            }
        }
    }
    Some(scale(sum, 1.0 / count))
}

/// Adds two triangles around the edge from `at` along `axis`, if the surface crosses it.
fn add_face(
    part: &mut Part,
    at: [usize; 3],
    axis: usize,
    field: impl Fn([usize; 3]) -> f32,
    vertex: impl Fn([usize; 3]) -> u32,
) {
    let mut to = at;
    to[axis] += 1;
    let (a, b) = (field(at) < 0.0, field(to) < 0.0);
    if a == b {
        return;
    }
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let cell = |du: usize, dv: usize| {
        let mut cell = at;
        cell[u] -= du;
        cell[v] -= dv;
        vertex(cell)
    };
    let mut corners = [cell(1, 1), cell(0, 1), cell(0, 0), cell(1, 0)];
    if b {
        corners.reverse();
    }
    part.add_quad(corners);
}
