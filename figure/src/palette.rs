//! The figure's colours as a texture, for programs that do not display vertex colours, or display them differently.
//!
//! glTF's vertex colours are linear. Godot's compatibility renderer treats them as sRGB and shows them too dark;
//! other programs quantize them to 8 bits, which ruins dark colours, or ignore them. All programs agree on textures.
//!
//! The figure needs no unwrapped surface: within each of its connected pieces, the colours lie close to a plane of
//! the RGB cube. Each piece gets a square of the texture that shows its plane, and each vertex the texture
//! coordinates of its colour. Between vertices, colours then blend as vertex colours do.
//!
//! Cloth and leather have shades of one colour, and a relief with separate coordinates on another map. Godot reads
//! every map at the colours' coordinates. These pieces therefore occupy as little of the texture as possible, and
//! [`Palette::flattened`] makes the relief's map flat there. In Godot, the figure then looks as if it had no relief;
//! in other programs the flat spot is too small to be seen.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

use crate::detail::{Detail, NormalMap};
use crate::picture::write_png;
use crate::vector::{self, V};
use crate::{Finish, Mesh};

/// Texels along the side of a piece's square. A power of two, so that mipmaps keep the squares apart.
const SQUARE: usize = 32;
/// Texels around the used colours that filters may reach.
const BORDER: f32 = 2.0;
/// Rows of a piece with a relief, and number of such pieces per square.
const LINE: usize = 3;
const LINES: usize = SQUARE / LINE;
/// Texels that its shades take up.
const SHADES: f32 = 12.0;

/// A texture of colours, and the texture coordinates of each vertex.
#[derive(Clone, Debug)]
pub struct Palette {
    /// Texels along each side.
    pub size: usize,
    /// sRGB, rows from the top. `[size * size]`
    pub pixels: Vec<[u8; 3]>,
    /// Reflectance of surfaces with these colours. `[size * size]`
    pub finishes: Vec<Finish>,
    /// `[vertices]`, right and down from the texture's upper left corner, both 0..=1.
    pub places: Vec<[f32; 2]>,
}

impl Palette {
    /// Builds the palette of a mesh.
    pub fn new(mesh: &Mesh) -> Self {
        let pieces = pieces(mesh);
        let colors = mesh.colors.iter().map(|&[r, g, b, _]| [r, g, b]);
        let mut sets: BTreeMap<usize, Colors> = BTreeMap::new();
        for (vertex, (&piece, color)) in pieces.iter().zip(colors.clone()).enumerate() {
            let of = || Colors { detail: mesh.details[vertex], finish: mesh.finishes[vertex], set: BTreeSet::new() };
            sets.entry(piece).or_insert_with(of).set.insert(color);
        }
        // Pieces with a relief get one row each of the first squares, grouped by relief; all others get a square.
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

    /// Returns the normal map of a relief, made flat where this mesh has its colours; `None` without a relief.
    pub fn flattened(&self, mesh: &Mesh, detail: Detail) -> Option<NormalMap> {
        let mut map = detail.normal_map()?;
        let places = self.places.iter().zip(&mesh.details).filter(|(_, own)| **own == detail);
        let range = |axis: usize| {
            let of = places.clone().map(|(place, _)| place[axis] * map.size[axis] as f32);
            let (low, high) = of.fold((f32::MAX, f32::MIN), |(low, high), x| (low.min(x), high.max(x)));
            // A filter reads the neighbouring texels, too.
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
    /// Writing to `out` failed.
    pub fn write<W: Write>(&self, out: W) -> io::Result<()> {
        write_png(self.size, self.size, self.pixels.as_flattened(), out)
    }

    /// Writes the finishes as PNG: roughness in green, metalness in blue, as glTF defines.
    ///
    /// # Errors
    /// Writing to `out` failed.
    pub fn write_finishes<W: Write>(&self, out: W) -> io::Result<()> {
        let pixels: Vec<[u8; 3]> = self.finishes.iter().map(|one| [255, one.roughness, one.metalness]).collect();
        write_png(self.size, self.size, pixels.as_flattened(), out)
    }
}

/// Colours of a piece, and its other surface properties.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Colors {
    detail: Detail,
    finish: Finish,
    set: BTreeSet<[u8; 3]>,
}

/// A plane through colours, and the region of it that they occupy.
struct Square {
    middle: V,
    /// Orthonormal.
    axes: [V; 2],
    low: [f32; 2],
    /// Colour units per texel.
    step: [f32; 2],
    /// Texel coordinate of the single colour along an axis without extent.
    middles: [f32; 2],
}

impl Square {
    /// Plane through the two colours that are furthest apart, and the one that is furthest from the line between
    /// them.
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

    /// Shades of one colour in a short row: the plane's second axis would only hold rounding errors.
    fn line(colors: &BTreeSet<[u8; 3]>) -> Self {
        let mut line = Self::new(colors);
        line.step[0] *= (SQUARE as f32 - 2.0 * BORDER) / SHADES;
        line.axes[1] = [0.0; 3];
        (line.low[1], line.step[1]) = (0.0, 0.0);
        line.middles = [BORDER + 0.5 * SHADES, 0.5 * LINE as f32];
        line
    }

    /// Texel coordinates in the square, right and down.
    fn place(&self, color: [u8; 3]) -> [f32; 2] {
        let from = vector::sub(color.map(f32::from), self.middle);
        [0, 1].map(|axis| {
            let along = vector::dot(from, self.axes[axis]) - self.low[axis];
            // A single colour has no plane: it fills the square.
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
    // Anything shorter is rounding.
    (length > 0.5).then(|| vector::scale(v, 1.0 / length))
}

/// Connected piece of each vertex, identified by one of its vertices.
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

    /// Samples the texture between texels, like a GPU.
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
