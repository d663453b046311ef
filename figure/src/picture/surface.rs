//! Draws surfaces of third-party characters: textures, transparency, and double-sided surfaces.

use super::{Camera, FINE, Frame, KEY, Picture, V, cross, dot, linear, shade, sub, unit};

/// Upper bound on a texture's sides, sufficient for a contact sheet: larger textures are halved.
const LARGEST: usize = 1024;

/// A tiling texture.
pub struct Texture {
    width: usize,
    height: usize,
    /// `[height, width]`, linear light and opacity.
    pixels: Vec<[f32; 4]>,
}

impl Texture {
    /// Creates a texture from sRGB pixels, `[height, width]`; `None` if their number does not match.
    pub fn new(width: usize, height: usize, pixels: &[[u8; 4]]) -> Option<Self> {
        if width == 0 || height == 0 || width.checked_mul(height) != Some(pixels.len()) {
            return None;
        }
        let light = |&[r, g, b, a]: &[u8; 4]| [linear(r), linear(g), linear(b), f32::from(a) / 255.0];
        let mut texture = Self { width, height, pixels: pixels.iter().map(light).collect() };
        while texture.width > LARGEST || texture.height > LARGEST {
            texture = texture.halved();
        }
        Some(texture)
    }

    /// Halves each side that is longer than one pixel.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, down)| {
                    let row = (2 * y + down).min(self.height - 1);
                    self.pixels[row * self.width + (2 * x + right).min(self.width - 1)]
                });
                pixels.push(std::array::from_fn(|i| four.iter().map(|pixel| 0.25 * pixel[i]).sum()));
            }
        }
        Self { width, height, pixels }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a place in the texture")]
    fn at(&self, [u, v]: [f32; 2]) -> [f32; 4] {
        let place = |x: f32, size: usize| ((x - x.floor()) * size as f32) as usize % size;
        self.pixels[place(v, self.height) * self.width + place(u, self.width)]
    }
}

/// Interpretation of a surface's opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cover {
    /// The surface is opaque.
    Solid,
    /// Pixels with less opacity than this are discarded.
    Cut(f32),
    /// The background shines through. Draw such surfaces last.
    Clear,
}

/// A posed surface: triangles and material.
pub struct Surface<'a> {
    /// `[vertices]`
    pub positions: Vec<[f32; 3]>,
    /// `[vertices]`, unit length.
    pub normals: Vec<[f32; 3]>,
    /// `[vertices]`; empty without a texture.
    pub uv: Vec<[f32; 2]>,
    /// Three vertices per triangle, counter-clockwise from the front.
    pub indices: Vec<u32>,
    /// Linear light and opacity.
    pub color: [f32; 4],
    /// Factor of the colour.
    pub texture: Option<&'a Texture>,
    /// Interpretation of the opacity.
    pub cover: Cover,
    /// Whether the back is visible.
    pub is_double: bool,
}

/// A corner of a triangle on the screen.
#[derive(Clone, Copy)]
struct Corner {
    at: V,
    uv: [f32; 2],
    /// Light on the front and on the back.
    lit: [V; 2],
}

impl Picture {
    /// Draws a surface into a region of the picture. Triangles with invalid vertex indices are skipped.
    pub fn draw_surface(&mut self, surface: &Surface, camera: Camera, frame: Frame) {
        let [left, top, width, height] = frame.map(|x| (x * FINE) as f32);
        let towards = unit(sub(camera.eye, camera.target));
        let right = unit(cross([0.0, 1.0, 0.0], towards));
        let up = cross(towards, right);
        let distance = dot(sub(camera.eye, camera.target), towards);
        let key = unit(KEY);
        let lit = |normal: V| {
            let seen = [dot(normal, right), dot(normal, up), dot(normal, towards)];
            shade([255; 3], seen, normal[1], dot(seen, key))
        };
        let corner = |(i, (&position, &normal)): (usize, (&V, &V))| {
            let from = sub(position, camera.target);
            let away = distance - dot(from, towards);
            let zoom = height / camera.height * distance / away.max(1e-3 * distance);
            Corner {
                at: [left + width / 2.0 + dot(from, right) * zoom, top + height / 2.0 - dot(from, up) * zoom, away],
                uv: surface.uv.get(i).copied().unwrap_or_default(),
                lit: [lit(normal), lit(normal.map(|x| -x))],
            }
        };
        let corners: Vec<_> = surface.positions.iter().zip(&surface.normals).enumerate().map(corner).collect();
        let bounds = [left, top, left + width, top + height];
        let (triangles, _) = surface.indices.as_chunks::<3>();
        for triangle in triangles {
            let found = triangle.map(|i| corners.get(i as usize).copied());
            if let [Some(a), Some(b), Some(c)] = found {
                self.fill_surface(surface, [a, b, c], bounds);
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "samples of the picture")]
    fn fill_surface(&mut self, surface: &Surface, [a, b, c]: [Corner; 3], [left, top, right, bottom]: [f32; 4]) {
        let edge = |p: V, q: V, x: f32, y: f32| (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
        let area = edge(a.at, b.at, c.at[0], c.at[1]);
        // Rows go down, so front faces have clockwise corners.
        let behind = area > 0.0;
        if area == 0.0 || !area.is_finite() || (behind && !surface.is_double) {
            return;
        }
        let span = |axis: usize, low: f32, high: f32| {
            let all = [a.at[axis], b.at[axis], c.at[axis]];
            let from = all.iter().copied().fold(f32::MAX, f32::min).max(low).ceil();
            let to = all.iter().copied().fold(f32::MIN, f32::max).min(high - 1.0).floor();
            from as usize..(to + 1.0).max(0.0) as usize
        };
        for y in span(1, top, bottom) {
            for x in span(0, left, right) {
                let (px, py) = (x as f32, y as f32);
                let parts =
                    [edge(b.at, c.at, px, py) / area, edge(c.at, a.at, px, py) / area, edge(a.at, b.at, px, py) / area];
                if parts.iter().any(|&part| part < 0.0) {
                    continue;
                }
                let between = |of: &dyn Fn(&Corner) -> f32| parts[0] * of(&a) + parts[1] * of(&b) + parts[2] * of(&c);
                let depth = between(&|corner| corner.at[2]);
                let sample = y * self.width * FINE + x;
                if depth <= 0.0 || depth >= self.depth[sample] {
                    continue;
                }
                let uv = [0, 1].map(|i| between(&|corner| corner.uv[i]));
                let texel = surface.texture.map_or([1.0; 4], |texture| texture.at(uv));
                let cover = surface.color[3] * texel[3];
                let light: V = std::array::from_fn(|i| {
                    surface.color[i] * texel[i] * between(&|corner| corner.lit[usize::from(behind)][i])
                });
                match surface.cover {
                    Cover::Cut(least) if cover < least => {}
                    Cover::Clear => {
                        let under = self.light[sample];
                        self.light[sample] = std::array::from_fn(|i| under[i] + cover * (light[i] - under[i]));
                    }
                    Cover::Solid | Cover::Cut(_) => {
                        self.depth[sample] = depth;
                        self.light[sample] = light;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: Frame = [0, 0, 8, 8];
    const CAMERA: Camera = Camera { eye: [0.0, 0.0, 4.0], target: [0.0; 3], height: 2.0 };

    /// A square that faces the camera.
    fn square<'a>(texture: Option<&'a Texture>) -> Surface<'a> {
        Surface {
            positions: vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]],
            normals: vec![[0.0, 0.0, 1.0]; 4],
            uv: vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
            indices: vec![0, 1, 2, 0, 2, 3],
            color: [1.0; 4],
            texture,
            cover: Cover::Solid,
            is_double: false,
        }
    }

    fn pixel(surface: &Surface, [x, y]: [usize; 2]) -> [u8; 3] {
        let mut picture = Picture::new(8, 8);
        picture.draw_surface(surface, CAMERA, FRAME);
        let at = 3 * (8 * y + x);
        picture.pixels()[at..at + 3].try_into().unwrap()
    }

    #[test]
    fn a_texture_lies_upright_and_may_have_holes() {
        // Red above blue, to the left of green above a transparent pixel.
        let pixels = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 9, 9, 0]];
        let texture = Texture::new(2, 2, &pixels).unwrap();
        let mut surface = square(Some(&texture));
        let empty = pixel(&Surface { positions: Vec::new(), ..square(None) }, [1, 1]);
        let strongest = |[r, g, b]: [u8; 3]| [r, g, b].iter().enumerate().max_by_key(|(_, light)| **light).unwrap().0;
        assert_eq!([[1, 1], [6, 1], [1, 6]].map(|at| strongest(pixel(&surface, at))), [0, 1, 2]);
        surface.cover = Cover::Cut(0.5);
        assert_eq!(pixel(&surface, [6, 6]), empty);
        surface.cover = Cover::Clear;
        assert_eq!(pixel(&surface, [6, 6]), empty);
        assert_eq!(strongest(pixel(&surface, [1, 1])), 0);
    }

    #[test]
    fn only_double_sides_are_seen_from_behind() {
        let mut surface = square(None);
        let (front, empty) =
            (pixel(&surface, [4, 4]), pixel(&Surface { positions: Vec::new(), ..square(None) }, [4, 4]));
        assert_ne!(front, empty);
        surface.indices.reverse();
        assert_eq!(pixel(&surface, [4, 4]), empty);
        surface.is_double = true;
        assert_ne!(pixel(&surface, [4, 4]), empty);
        // Invalid vertex indices.
        surface.indices = vec![0, 1, 99];
        assert_eq!(pixel(&surface, [4, 4]), empty);
    }

    #[test]
    fn large_textures_are_halved() {
        assert!(Texture::new(2, 2, &[[0; 4]; 3]).is_none() && Texture::new(0, 0, &[]).is_none());
        let pixels: Vec<[u8; 4]> = (0..3000).map(|x| if x < 1500 { [0; 4] } else { [255; 4] }).collect();
        let texture = Texture::new(3000, 1, &pixels).unwrap();
        assert_eq!((texture.width, texture.height), (750, 1));
        assert_eq!([texture.at([0.1, 0.5])[0], texture.at([0.9, 0.5])[0]], [0.0, 1.0]);
    }
}
