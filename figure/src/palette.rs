//! The figure's colours as a texture, for programs that show vertex colours in their own way, or
//! not at all.
//!
//! glTF's vertex colours are linear light. Godot's compatibility renderer takes them for sRGB and
//! shows them too dark; other programs round them to 8 bits, which dark colours do not survive, or
//! leave them out. All of them agree on textures.
//!
//! The figure has no unwrapped surface, and needs none: within each connected piece of it, the
//! colours lie close to a plane of the RGB cube. Each piece gets a square of the texture that shows
//! its plane, and each vertex the place of its colour there. Between vertices, colours then blend
//! as they do between vertex colours.
//!
//! Cloth and leather have shades of one colour, and a relief that has places of its own on another
//! map. Godot reads every map at the colours' places. So these take as little of the texture as they
//! can, and where they do, [`Palette::flattened`] makes the relief's map flat: there the figure looks
//! as it would without, and where the map repeats, so small a spot is not seen.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

use crate::detail::{Detail, NormalMap};
use crate::picture::write_png;
use crate::vector::{self, V};
use crate::{Finish, Mesh};

/// Texels along a piece's square. A power of two, so that smaller versions of the texture keep the
/// squares apart.
const SQUARE: usize = 32;
/// Texels around the colours that are used, which filters may reach.
const BORDER: f32 = 2.0;
/// Rows of a piece with a relief, and pieces to a square.
const LINE: usize = 3;
const LINES: usize = SQUARE / LINE;
/// Texels that its shades take.
const SHADES: f32 = 12.0;

/// A texture of colours, and where in it each vertex has its own.
#[derive(Clone, Debug)]
pub struct Palette {
    /// Texels along each side.
    pub size: usize,
    /// sRGB, rows from the top. `[size * size]`
    pub pixels: Vec<[u8; 3]>,
    /// How surfaces of these colours reflect. `[size * size]`
    pub finishes: Vec<Finish>,
    /// Right and down from the texture's upper left corner, both 0..=1. `[vertices]`
    pub places: Vec<[f32; 2]>,
}

impl Palette {
    /// The colours of a mesh.
    pub fn new(mesh: &Mesh) -> Self {
        let pieces = pieces(mesh);
        let colors = mesh.colors.iter().map(|&[r, g, b, _]| [r, g, b]);
        let mut sets: BTreeMap<usize, Colors> = BTreeMap::new();
        for (vertex, (&piece, color)) in pieces.iter().zip(colors.clone()).enumerate() {
            let of = || Colors { detail: mesh.details[vertex], finish: mesh.finishes[vertex], set: BTreeSet::new() };
            sets.entry(piece).or_insert_with(of).set.insert(color);
        }
        // Those with a relief get a row each of the first squares, those of one relief side by side;
        // all others a square.
        let (lines, planes): (BTreeSet<_>, BTreeSet<_>) =
            sets.values().partition(|colors: &&Colors| colors.detail != Detail::None);
        let blocks = lines.len().div_ceil(LINES);
        let count = blocks + planes.len();
        let across = (1..).find(|n: &usize| n.is_power_of_two() && n * n >= count).unwrap_or(1);
        let size = across * SQUARE;
        let corner = |number: usize| [number % across * SQUARE, number / across * SQUARE];
        let mut pixels = vec![[0; 3]; size * size];
        let mut finishes = vec![Finish::default(); size * size];
        let mut squares: BTreeMap<&Colors, ([usize; 2], Square)> = BTreeMap::new();
        for (number, colors) in lines.into_iter().enumerate() {
            let [left, top] = corner(number / LINES);
            squares.insert(colors, ([left, top + number % LINES * LINE], Square::line(&colors.set)));
        }
        for (number, colors) in planes.into_iter().enumerate() {
            squares.insert(colors, (corner(blocks + number), Square::new(&colors.set)));
        }
        for (colors, ([left, top], square)) in &squares {
            let height = if colors.detail == Detail::None { SQUARE } else { LINE };
            for (x, y) in (0..height).flat_map(|y| (0..SQUARE).map(move |x| (x, y))) {
                pixels[(top + y) * size + left + x] = square.color([x as f32 + 0.5, y as f32 + 0.5]);
                finishes[(top + y) * size + left + x] = colors.finish;
            }
        }
        let places = pieces.iter().zip(colors).map(|(piece, color)| {
            let (corner, square) = &squares[&sets[piece]];
            let place = square.place(color);
            std::array::from_fn(|axis| (corner[axis] as f32 + place[axis]) / size as f32)
        });
        Self { size, pixels, finishes, places: places.collect() }
    }

    /// The normal map of a relief, flat where this mesh has its colours; none where there is no
    /// relief.
    pub fn flattened(&self, mesh: &Mesh, detail: Detail) -> Option<NormalMap> {
        let mut map = detail.normal_map()?;
        let places = self.places.iter().zip(&mesh.details).filter(|(_, own)| **own == detail);
        let range = |axis: usize| {
            let of = places.clone().map(|(place, _)| place[axis] * map.size[axis] as f32);
            let (low, high) = of.fold((f32::MAX, f32::MIN), |(low, high), x| (low.min(x), high.max(x)));
            // A filter reads the texels on both sides.
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the map")]
            let [from, to] = [low - 0.5, high + 0.5].map(|x| x.clamp(0.0, map.size[axis] as f32 - 1.0) as usize);
            from..=to
        };
        let (columns, rows) = (range(0), range(1));
        for row in rows {
            for column in columns.clone() {
                map.pixels[row * map.size[0] + column] = NormalMap::FLAT;
            }
        }
        Some(map)
    }

    /// Writes the colours as PNG.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write<W: Write>(&self, out: W) -> io::Result<()> {
        write_png(self.size, self.size, self.pixels.as_flattened(), out)
    }

    /// Writes the finishes as PNG: roughness in green, metalness in blue, as glTF has them.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_finishes<W: Write>(&self, out: W) -> io::Result<()> {
        let pixels: Vec<[u8; 3]> = self.finishes.iter().map(|one| [255, one.roughness, one.metalness]).collect();
        write_png(self.size, self.size, pixels.as_flattened(), out)
    }
}

/// The colours of a piece, and what else its surface has.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Colors {
    detail: Detail,
    finish: Finish,
    set: BTreeSet<[u8; 3]>,
}

/// A plane through colours, and the part of it that they take.
struct Square {
    middle: V,
    /// Orthonormal.
    axes: [V; 2],
    low: [f32; 2],
    /// Colour values to a texel.
    step: [f32; 2],
    /// Texels to where a colour is that fills an axis.
    middles: [f32; 2],
}

impl Square {
    /// Through the two colours that are the furthest apart, and the one that is the furthest from
    /// the line between them.
    fn new(colors: &BTreeSet<[u8; 3]>) -> Self {
        let colors: Vec<V> = colors.iter().map(|color| color.map(f32::from)).collect();
        let pairs = colors.iter().flat_map(|&a| colors.iter().map(move |&b| vector::sub(b, a)));
        let first = unit(longest(pairs)).unwrap_or([1.0, 0.0, 0.0]);
        let middle = colors[0];
        let off = colors.iter().map(|&color| {
            let from = vector::sub(color, middle);
            vector::sub(from, vector::scale(first, vector::dot(from, first)))
        });
        let second = unit(longest(off)).unwrap_or([0.0; 3]);
        let axes = [first, second];
        let along = |axis: usize| colors.iter().map(move |&color| vector::dot(vector::sub(color, middle), axes[axis]));
        let low = [0, 1].map(|axis| along(axis).fold(f32::INFINITY, f32::min));
        let high = [0, 1].map(|axis| along(axis).fold(f32::NEG_INFINITY, f32::max));
        let step = [0, 1].map(|axis: usize| (high[axis] - low[axis]) / (SQUARE as f32 - 2.0 * BORDER));
        Self { middle, axes, low, step, middles: [SQUARE as f32 / 2.0; 2] }
    }

    /// Shades of one colour, in a short row: the plane's second axis would only hold how they are
    /// rounded.
    fn line(colors: &BTreeSet<[u8; 3]>) -> Self {
        let mut line = Self::new(colors);
        line.step[0] *= (SQUARE as f32 - 2.0 * BORDER) / SHADES;
        line.axes[1] = [0.0; 3];
        (line.low[1], line.step[1]) = (0.0, 0.0);
        line.middles = [BORDER + 0.5 * SHADES, 0.5 * LINE as f32];
        line
    }

    /// Texels right and down in the square.
    fn place(&self, color: [u8; 3]) -> [f32; 2] {
        let from = vector::sub(color.map(f32::from), self.middle);
        [0, 1].map(|axis| {
            let along = vector::dot(from, self.axes[axis]) - self.low[axis];
            // One colour has no plane: it fills the square.
            if self.step[axis] > 0.0 { BORDER + along / self.step[axis] } else { self.middles[axis] }
        })
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=255")]
    fn color(&self, place: [f32; 2]) -> [u8; 3] {
        let along: [f32; 2] = [0, 1].map(|axis: usize| self.low[axis] + (place[axis] - BORDER) * self.step[axis]);
        let by = vector::add(vector::scale(self.axes[0], along[0]), vector::scale(self.axes[1], along[1]));
        vector::add(self.middle, by).map(|value| value.round().clamp(0.0, 255.0) as u8)
    }
}

fn longest(vectors: impl Iterator<Item = V>) -> V {
    vectors.fold([0.0; 3], |most, v| if vector::dot(v, v) > vector::dot(most, most) { v } else { most })
}

fn unit(v: V) -> Option<V> {
    let length = vector::dot(v, v).sqrt();
    // Less than that is rounding.
    (length > 0.5).then(|| vector::scale(v, 1.0 / length))
}

/// The connected piece that each vertex is in, as the number of one of its vertices.
pub(crate) fn pieces(mesh: &Mesh) -> Vec<usize> {
    fn first(of: &mut [usize], mut vertex: usize) -> usize {
        while of[vertex] != vertex {
            of[vertex] = of[of[vertex]];
            vertex = of[vertex];
        }
        vertex
    }
    let mut of = mesh.originals();
    let (triangles, _) = mesh.indices.as_chunks::<3>();
    for &[a, b, c] in triangles {
        for other in [b, c] {
            let (a, other) = (first(&mut of, a as usize), first(&mut of, other as usize));
            of[a] = other;
        }
    }
    (0..of.len()).map(|vertex| first(&mut of, vertex)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Figure, sample};

    /// The texture between texels, as graphics cards read it.
    fn read(palette: &Palette, [u, v]: [f32; 2]) -> V {
        let at = [u, v].map(|x| x * palette.size as f32 - 0.5);
        let mut sum = [0.0; 3];
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let [x, y] = at.map(f32::floor);
            let share = |d: i32, at: f32, low: f32| if d == 1 { at - low } else { 1.0 - (at - low) };
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the texture")]
            let texel = (y as usize + dy as usize) * palette.size + x as usize + dx as usize;
            let weight = share(dx, at[0], x) * share(dy, at[1], y);
            sum = vector::add(sum, vector::scale(palette.pixels[texel].map(f32::from), weight));
        }
        sum
    }

    #[test]
    fn every_vertex_finds_its_colour_and_every_triangle_the_colours_between() {
        for figure in Figure::ALL {
            check(&figure.mesh(&sample::skeleton()).unwrap());
        }
    }

    #[test]
    fn relief_is_flat_where_colours_are_and_almost_nowhere_else() {
        for figure in Figure::ALL {
            let mesh = figure.mesh(&sample::skeleton()).unwrap();
            let palette = Palette::new(&mesh);
            for detail in Detail::RELIEFS.into_iter().filter(|detail| mesh.details.contains(detail)) {
                let (map, whole) = (palette.flattened(&mesh, detail).unwrap(), detail.normal_map().unwrap());
                let places = palette.places.iter().zip(&mesh.details).filter(|(_, own)| **own == detail);
                for (place, _) in places {
                    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the map")]
                    let near = [0, 1].map(|axis: usize| {
                        let at = place[axis] * map.size[axis] as f32 - 0.5;
                        [at.floor() as usize, at.floor() as usize + 1]
                    });
                    for (x, y) in near[1].into_iter().flat_map(|y| near[0].map(|x| (x, y))) {
                        assert_eq!(map.pixels[y * map.size[0] + x], NormalMap::FLAT, "{figure:?} {detail:?}");
                    }
                }
                let changed = map.pixels.iter().zip(&whole.pixels).filter(|(a, b)| a != b).count();
                assert!(changed * 50 < map.pixels.len(), "{figure:?} {detail:?}: {changed} texels");
            }
            assert!(palette.flattened(&mesh, Detail::None).is_none());
        }
    }

    fn check(mesh: &Mesh) {
        let palette = Palette::new(mesh);
        assert_eq!(palette.pixels.len(), palette.size * palette.size);
        let pieces = pieces(mesh);
        assert!(pieces.iter().enumerate().all(|(vertex, &piece)| mesh.finishes[vertex] == mesh.finishes[piece]));
        for (finish, [u, v]) in mesh.finishes.iter().zip(&palette.places) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the texture")]
            let [x, y] = [u, v].map(|at| (at * palette.size as f32) as usize);
            assert_eq!(palette.finishes[y * palette.size + x], *finish);
        }
        let color = |vertex: u32| {
            let [r, g, b, _] = mesh.colors[vertex as usize];
            [r, g, b].map(f32::from)
        };
        let apart = |a: V, b: V| vector::sub(a, b).iter().fold(0.0_f32, |most, v| most.max(v.abs()));
        let (triangles, _) = mesh.indices.as_chunks::<3>();
        let mut most = 0.0_f32;
        for corners in triangles {
            let places = corners.map(|corner| palette.places[corner as usize]);
            let mean = |values: [V; 3]| {
                values.into_iter().fold([0.0; 3], |sum, v| vector::add(sum, vector::scale(v, 1.0 / 3.0)))
            };
            for (corner, place) in corners.iter().zip(places) {
                most = most.max(apart(read(&palette, place), color(*corner)));
            }
            let middle = [0, 1].map(|axis: usize| places.iter().map(|place| place[axis]).sum::<f32>() / 3.0);
            most = most.max(apart(read(&palette, middle), mean(corners.map(color))));
        }
        assert!(most < 3.0, "a colour is {most} of 255 away");
    }
}
