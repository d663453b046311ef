//! Surfaces laid out on a plane, so that fine relief has a place and a direction on them.
//!
//! A surface has one or more charts. A chart says where on the plane a point of the surface lies, in
//! repeats of the relief's map. Around a limb it comes back to where it began after a whole number
//! of repeats, so the relief has no seam there; vertices on that line are there twice, once with
//! either place.

use std::collections::HashMap;

use crate::Part;
use crate::detail::Detail;
use crate::vector::{V, add, cross, dot, length, scale, sub, unit};

/// Where the vertices of a part are on the plane.
pub(crate) struct Chart<F> {
    /// Of a vertex, by its number, place and normal.
    pub(crate) place: F,
    /// After how much it begins again, right and down; infinite where it does not.
    pub(crate) period: [f32; 2],
}

/// A relief that goes once around in a whole number of repeats.
pub(crate) fn repeats(metres: f32, repeat: f32) -> f32 {
    (metres / repeat).round().max(1.0)
}

impl Part {
    /// Gives the part a relief. `chart_of`: which of the charts a triangle belongs to.
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

    /// Adds vertices so that each has one place; returns which of them lie together on one chart and
    /// were one vertex.
    fn split<F: Fn(usize, V, V) -> [f32; 2]>(
        &mut self,
        charts: &[Chart<F>],
        chart_of: impl Fn([usize; 3], [V; 3]) -> usize,
    ) -> Vec<usize> {
        let mut places = vec![[0.0; 2]; self.positions.len()];
        // A vertex that is not in use yet has none of these.
        let mut groups = vec![usize::MAX; self.positions.len()];
        let mut numbers: HashMap<(u32, usize, [bool; 2]), u32> = HashMap::new();
        let mut known: HashMap<(u32, usize), usize> = HashMap::new();
        let mut indices = std::mem::take(&mut self.indices);
        let (triangles, _) = indices.as_chunks_mut::<3>();
        for corners in triangles {
            let chart = chart_of(corners.map(|i| i as usize), corners.map(|i| self.positions[i as usize]));
            let Chart { place, period } = &charts[chart];
            let own = corners.map(|i| place(i as usize, self.positions[i as usize], self.normals[i as usize]));
            // Beyond the line where the chart begins again, or not.
            let beyond: [[bool; 3]; 2] = std::array::from_fn(|axis| {
                let low = own.iter().map(|place| place[axis]).fold(f32::INFINITY, f32::min);
                let high = own.iter().map(|place| place[axis]).fold(f32::NEG_INFINITY, f32::max);
                own.map(|place| high - low > 0.5 * period[axis] && place[axis] - low < 0.5 * period[axis])
            });
            for (k, corner) in corners.iter_mut().enumerate() {
                let vertex = *corner as usize;
                let further = [beyond[0][k], beyond[1][k]];
                *corner = *numbers.entry((*corner, chart, further)).or_insert_with(|| {
                    let next = known.len();
                    let group = *known.entry((*corner, chart)).or_insert(next);
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

    /// Where u rises fastest along the surface at each vertex, and on which side of it v falls: the
    /// mean over its triangles by their angles, as MikkTSpace has it.
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

/// The direction on a triangle in which u rises and v does not, of unit length, and 1 where v falls
/// to the left of it as seen from outside, or -1.
pub(crate) fn along_u([a, b, c]: [V; 3], [p, q, r]: [[f32; 2]; 3]) -> Option<(V, f32)> {
    let (e, f) = (sub(b, a), sub(c, a));
    let ([du, dv], [eu, ev]) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
    let turned = du * ev - dv * eu;
    let along = scale(sub(scale(e, ev), scale(f, dv)), turned.signum());
    let size = length(along);
    (turned.abs() > 1e-12 && size > 1e-12).then(|| (scale(along, 1.0 / size), -turned.signum()))
}

/// The part of a vector across a normal, of unit length.
fn level(v: V, normal: V) -> Option<V> {
    let flat = sub(v, scale(normal, dot(v, normal)));
    let size = length(flat);
    (size > 1e-6).then(|| scale(flat, 1.0 / size))
}

/// Some direction across a normal.
fn beside(normal: V) -> V {
    let least = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    unit(cross(normal, cross(least, normal)))
}
