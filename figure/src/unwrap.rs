//! Texture layout: maps surfaces to a plane, so that fine relief has coordinates and directions on them.
//!
//! A surface has one or more charts. A chart maps points of the surface to the plane, in repeats of the relief's map.
//! Around a belt or a cuff it wraps after a whole number of repeats, so the relief has no seam there. A vertex on the
//! boundary of two charts is duplicated unless both map it to the same point.

use std::collections::{BTreeMap, HashMap};

use crate::Part;
use crate::detail::Detail;
use crate::vector::{V, add, cross, dot, length, scale, sub, unit};

/// Mapping of a part's vertices to the plane.
pub(crate) struct Chart<F> {
    /// Coordinates of a vertex, by its index, position and normal.
    pub(crate) place: F,
    /// Periods after which the chart wraps, right and down; infinite if it does not.
    pub(crate) period: [f32; 2],
}

/// Number of whole repeats that best fit a circumference.
pub(crate) fn repeats(metres: f32, repeat: f32) -> f32 {
    (metres / repeat).round().max(1.0)
}

impl Part {
    /// Gives the part a relief. `chart_of` selects the chart of a triangle.
    pub(crate) fn lay_out<F: Fn(usize, V, V) -> [f32; 2]>(
        &mut self,
        detail: Detail,
        charts: &[Chart<F>],
        chart_of: impl Fn([usize; 3], [V; 3]) -> usize,
    ) {
        let groups = self.split(charts, chart_of);
        self.detail = detail;
        self.tangents = self.tangents_of(&groups);
    }

    /// Duplicates vertices so that each has one place. Returns groups of vertices that were one, and whose places are
    /// equal or differ by a period of the chart.
    fn split<F: Fn(usize, V, V) -> [f32; 2]>(
        &mut self,
        charts: &[Chart<F>],
        chart_of: impl Fn([usize; 3], [V; 3]) -> usize,
    ) -> Vec<usize> {
        let mut places = vec![[0.0; 2]; self.positions.len()];
        // A vertex that is not used yet has none of these.
        let mut groups = vec![usize::MAX; self.positions.len()];
        let mut numbers: HashMap<(u32, [u32; 2], [bool; 2]), u32> = HashMap::new();
        let mut known: HashMap<(u32, [u32; 2]), usize> = HashMap::new();
        let mut indices = std::mem::take(&mut self.indices);
        let (triangles, _) = indices.as_chunks_mut::<3>();
        for corners in triangles {
            let chart = chart_of(corners.map(|i| i as usize), corners.map(|i| self.positions[i as usize]));
            let Chart { place, period } = &charts[chart];
            let own = corners.map(|i| place(i as usize, self.positions[i as usize], self.normals[i as usize]));
            // Whether the place is beyond the line where the chart wraps.
            let beyond: [[bool; 3]; 2] = std::array::from_fn(|axis| {
                let low = own.iter().map(|place| place[axis]).fold(f32::INFINITY, f32::min);
                let high = own.iter().map(|place| place[axis]).fold(f32::NEG_INFINITY, f32::max);
                own.map(|place| high - low > 0.5 * period[axis] && place[axis] - low < 0.5 * period[axis])
            });
            for (k, corner) in corners.iter_mut().enumerate() {
                let vertex = *corner as usize;
                let further = [beyond[0][k], beyond[1][k]];
                let bits = own[k].map(f32::to_bits);
                *corner = *numbers.entry((*corner, bits, further)).or_insert_with(|| {
                    let next = known.len();
                    let group = *known.entry((*corner, bits)).or_insert(next);
                    let place = [0, 1].map(|axis: usize| own[k][axis] + if further[axis] { period[axis] } else { 0.0 });
                    if groups[vertex] == usize::MAX {
                        (places[vertex], groups[vertex]) = (place, group);
                        return *corner;
                    }
                    self.positions.push(self.positions[vertex]);
                    self.normals.push(self.normals[vertex]);
                    places.push(place);
                    groups.push(group);
                    u32::try_from(groups.len() - 1).expect("the figure has few vertices")
                });
            }
        }
        self.indices = indices;
        self.places = places;
        groups
    }

    /// Tangents: the direction of steepest ascent of u along the surface at each vertex, and the side on which v
    /// falls. Averaged over the triangles by their angles, as in MikkTSpace.
    fn tangents_of(&self, groups: &[usize]) -> Vec<[f32; 4]> {
        let count = groups.iter().filter(|&&group| group != usize::MAX).max().map_or(0, |most| most + 1);
        let mut sums = vec![([0.0; 3], 0.0); count];
        let (triangles, _) = self.indices.as_chunks::<3>();
        for corners in triangles {
            let corners = corners.map(|i| i as usize);
            let Some((along, side)) = along_u(corners.map(|i| self.positions[i]), corners.map(|i| self.places[i]))
            else {
                continue;
            };
            for k in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|step| self.positions[corners[(k + step) % 3]]);
                let [p, q] = [unit(sub(b, a)), unit(sub(c, a))];
                let angle = length(cross(p, q)).atan2(dot(p, q));
                let sum = &mut sums[groups[corners[k]]];
                let flat = level(along, self.normals[corners[k]]);
                sum.0 = add(sum.0, scale(flat.unwrap_or_default(), angle));
                sum.1 += angle * side;
            }
        }
        groups
            .iter()
            .zip(&self.normals)
            .map(|(&group, &normal)| {
                let (sum, side) = sums.get(group).copied().unwrap_or_default();
                let [x, y, z] = level(sum, normal).unwrap_or_else(|| beside(normal));
                [x, y, z, if side < 0.0 { -1.0 } else { 1.0 }]
            })
            .collect()
    }
}

/// Lays triangles of a surface flat with minimal distortion of shape and size: as rigid as possible (Liu and others,
/// 2008). It alternates between the best rotation of each triangle and the best positions for these rotations.
/// `places` are the vertices' initial positions on the plane in metres, and receive the result; vertices without a
/// triangle stay.
pub(crate) fn flatten(positions: &[V], triangles: &[[usize; 3]], places: &mut [[f32; 2]]) {
    let flats: Vec<Flat> = triangles.iter().map(|&corners| Flat::new(corners, positions)).collect();
    let mut numbers = vec![usize::MAX; positions.len()];
    let mut vertices = Vec::new();
    for &vertex in triangles.iter().flatten() {
        if numbers[vertex] == usize::MAX {
            numbers[vertex] = vertices.len();
            vertices.push(vertex);
        }
    }
    let mut edges: BTreeMap<[usize; 2], f64> = BTreeMap::new();
    for (flat, k) in flats.iter().flat_map(|flat| (0..3).map(move |k| (flat, k))) {
        let [a, b] = flat.ends(k).map(|vertex| numbers[vertex]);
        *edges.entry([a.min(b), a.max(b)]).or_default() += flat.weights[k];
    }
    let edges: Vec<([usize; 2], f64)> = edges.into_iter().collect();
    let mut at: [Vec<f64>; 2] =
        [0, 1].map(|axis: usize| vertices.iter().map(|&vertex| f64::from(places[vertex][axis])).collect());
    for round in 0..ROUNDS {
        let before = at.clone();
        let mut wanted = [vec![0.0; vertices.len()], vec![0.0; vertices.len()]];
        for flat in &flats {
            let corners = flat.corners.map(|vertex| [0, 1].map(|axis: usize| at[axis][numbers[vertex]]));
            let [c, s] = flat.turn(corners);
            for k in 0..3 {
                let [x, y] = flat.edge(k);
                let [a, b] = flat.ends(k).map(|vertex| numbers[vertex]);
                for (axis, step) in [c * x - s * y, s * x + c * y].into_iter().enumerate() {
                    wanted[axis][a] -= flat.weights[k] * step;
                    wanted[axis][b] += flat.weights[k] * step;
                }
            }
        }
        for axis in 0..2 {
            solve(&edges, &wanted[axis], &mut at[axis]);
            if round + SETTLE < ROUNDS {
                at[axis].iter_mut().zip(&before[axis]).for_each(|(x, before)| *x += FURTHER * (*x - before));
            }
        }
    }
    for (number, &vertex) in vertices.iter().enumerate() {
        #[expect(clippy::cast_possible_truncation, reason = "places of metres")]
        let place = [0, 1].map(|axis: usize| at[axis][number] as f32);
        places[vertex] = place;
    }
}

/// Iterations of [`flatten`], and of the solver within each, which starts from the previous solution.
const ROUNDS: usize = 60;
const STEPS: usize = 40;
/// Over-relaxation of all iterations except the last `SETTLE`: long sleeves and legs converge in half the iterations.
const FURTHER: f64 = 0.9;
const SETTLE: usize = 4;

/// A triangle laid flat by itself.
struct Flat {
    corners: [usize; 3],
    own: [[f64; 2]; 3],
    /// Weight of the edge from corner `k` to the next: half the cotangent of the opposite angle, clamped to be
    /// positive and not too large, so that slivers neither flip nor dominate.
    weights: [f64; 3],
}

impl Flat {
    fn new(corners: [usize; 3], positions: &[V]) -> Self {
        let [a, b, c] = corners.map(|vertex| positions[vertex]);
        let (e, f) = (sub(b, a), sub(c, a));
        let long = length(e).max(1e-9);
        let along = dot(e, f) / long;
        let high = length(cross(e, f)) / long;
        // On the plane v points down, so the triangle is upside down when seen from outside.
        let own = [[0.0, 0.0], [long, 0.0], [along, -high]].map(|place| place.map(f64::from));
        let weights = std::array::from_fn(|k| {
            let [p, q, r] = [0, 1, 2].map(|step| own[(k + step) % 3]);
            let (e, f) = ([p[0] - r[0], p[1] - r[1]], [q[0] - r[0], q[1] - r[1]]);
            let twice = (e[0] * f[1] - e[1] * f[0]).abs().max(1e-12);
            (0.5 * (e[0] * f[0] + e[1] * f[1]) / twice).clamp(0.05, 2.0)
        });
        Self { corners, own, weights }
    }

    fn ends(&self, k: usize) -> [usize; 2] {
        [self.corners[k], self.corners[(k + 1) % 3]]
    }

    fn edge(&self, k: usize) -> [f64; 2] {
        let [a, b] = [self.own[k], self.own[(k + 1) % 3]];
        [b[0] - a[0], b[1] - a[1]]
    }

    /// Cosine and sine of the rotation that best fits its corners.
    fn turn(&self, corners: [[f64; 2]; 3]) -> [f64; 2] {
        let (mut c, mut s) = (0.0, 0.0);
        for k in 0..3 {
            let [x, y] = self.edge(k);
            let [from, to] = [corners[k], corners[(k + 1) % 3]];
            let (u, v) = (to[0] - from[0], to[1] - from[1]);
            c += self.weights[k] * (x * u + y * v);
            s += self.weights[k] * (x * v - y * u);
        }
        let size = (c * c + s * s).sqrt();
        if size > 0.0 { [c / size, s / size] } else { [1.0, 0.0] }
    }
}

/// Solves for places whose weighted differences along the edges sum to `wanted`, by conjugate gradients that start at
/// `at`.
fn solve(edges: &[([usize; 2], f64)], wanted: &[f64], at: &mut [f64]) {
    let sums = |x: &[f64]| {
        let mut sums = vec![0.0; x.len()];
        for &([a, b], weight) in edges {
            let step = weight * (x[b] - x[a]);
            sums[a] -= step;
            sums[b] += step;
        }
        sums
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut rest: Vec<f64> = wanted.iter().zip(sums(at)).map(|(wanted, sum)| wanted - sum).collect();
    let mut along = rest.clone();
    let mut size = dot(&rest, &rest);
    for _ in 0..STEPS {
        if size < 1e-18 {
            return;
        }
        let sum = sums(&along);
        let step = size / dot(&along, &sum);
        at.iter_mut().zip(&along).for_each(|(x, along)| *x += step * along);
        rest.iter_mut().zip(&sum).for_each(|(x, sum)| *x -= step * sum);
        let before = size;
        size = dot(&rest, &rest);
        along.iter_mut().zip(&rest).for_each(|(along, rest)| *along = rest + size / before * *along);
    }
}

/// Direction on a triangle in which u rises and v is constant, of unit length, and 1 if v falls to its left as seen
/// from outside, else -1.
pub(crate) fn along_u([a, b, c]: [V; 3], [p, q, r]: [[f32; 2]; 3]) -> Option<(V, f32)> {
    let (e, f) = (sub(b, a), sub(c, a));
    let ([du, dv], [eu, ev]) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
    let turned = du * ev - dv * eu;
    let along = scale(sub(scale(e, ev), scale(f, dv)), turned.signum());
    let size = length(along);
    (turned.abs() > 1e-12 && size > 1e-12).then(|| (scale(along, 1.0 / size), -turned.signum()))
}

/// Component of a vector perpendicular to a normal, normalised.
fn level(v: V, normal: V) -> Option<V> {
    let flat = sub(v, scale(normal, dot(v, normal)));
    let size = length(flat);
    (size > 1e-6).then(|| scale(flat, 1.0 / size))
}

/// A direction perpendicular to a normal.
fn beside(normal: V) -> V {
    let least = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    unit(cross(normal, cross(least, normal)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::distance;

    /// A sheet of 24 by 30 cm rolled to a cone, with irregular triangles, and the positions of its vertices before
    /// rolling.
    fn cone() -> (Vec<V>, Vec<[usize; 3]>, Vec<[f32; 2]>) {
        let (columns, rows) = (13, 16);
        let mut flat = Vec::new();
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let uneven = 0.3 * ((7 * row + 5 * column) % 4) as f32 / 4.0;
            flat.push([0.02 * (column as f32 + uneven) - 0.12, 0.02 * (row as f32 - uneven) + 0.15]);
        }
        // A ray from the tip stays straight, and turns by twice the angle around the axis.
        let rolled = flat.iter().map(|&[x, y]: &[f32; 2]| {
            let (far, angle) = (x.hypot(y), 2.0 * x.atan2(y));
            [0.5 * far * angle.sin(), -0.75_f32.sqrt() * far, 0.5 * far * angle.cos()]
        });
        let mut triangles = Vec::new();
        for (row, column) in (0..rows - 1).flat_map(|row| (0..columns - 1).map(move |column| (row, column))) {
            let [a, b] = [row * columns + column, (row + 1) * columns + column];
            triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
        (rolled.collect(), triangles, flat)
    }

    #[test]
    fn what_can_be_laid_flat_keeps_all_its_lengths() {
        let (positions, triangles, flat) = cone();
        // Too wide by half, too short by a third, and sheared.
        let mut places: Vec<[f32; 2]> = flat.iter().map(|&[x, y]| [1.5 * x + 0.3 * y, 0.67 * y]).collect();
        places.push([7.0, 8.0]);
        let mut all = positions.clone();
        all.push([1.0; 3]);
        flatten(&all, &triangles, &mut places);
        for &[a, b, c] in &triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                let long = distance(positions[from], positions[to]);
                let [du, dv] = [0, 1].map(|axis: usize| places[to][axis] - places[from][axis]);
                assert!((du.hypot(dv) / long - 1.0).abs() < 0.02, "{} for {long}", du.hypot(dv));
            }
            let side = |[p, q, r]: [[f32; 2]; 3]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
            let [before, after] = [&flat, &places].map(|at| side([at[a], at[b], at[c]]).signum());
            assert_eq!(before, after, "a triangle is turned over");
        }
        assert_eq!(places.last(), Some(&[7.0, 8.0]));
    }
}
