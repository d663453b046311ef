//! Software renderer for pictures of the figure: a depth buffer, a key light and light from the sky.

mod letters;
pub mod sheet;
pub mod surface;

use crate::posed::Posed;
use crate::{Finish, Mesh};
use std::io::{self, Write};

/// Perspective camera that looks from `eye` to `target`, Y up.
#[derive(Clone, Copy)]
pub struct Camera {
    /// Position in metres.
    pub eye: [f32; 3],
    /// Point in the middle of the picture.
    pub target: [f32; 3],
    /// Height of the view at the target, in metres.
    pub height: f32,
}

/// A picture under construction, at twice its final resolution.
pub struct Picture {
    width: usize,
    height: usize,
    /// `[2 height, 2 width]`, linear light.
    light: Vec<[f32; 3]>,
    /// Distance from the camera, metres.
    depth: Vec<f32>,
}

/// Samples along each side of a pixel.
const FINE: usize = 2;
/// Background, sRGB.
const BACKGROUND: [u8; 3] = [238, 240, 243];
/// Direction to the key light in camera space: right, up, towards the camera.
const KEY: [f32; 3] = [-0.45, 0.62, 0.64];

/// A region of the picture: left, top, width, height in pixels.
pub type Frame = [usize; 4];

type V = [f32; 3];

fn sub(a: V, b: V) -> V {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: V, b: V) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: V) -> V {
    let size = dot(a, a).sqrt();
    a.map(|x| x / size)
}

/// A triangle corner on the screen: column and row in samples, depth, light.
#[derive(Clone, Copy)]
struct Corner {
    at: V,
    light: V,
}

impl Picture {
    /// An empty picture of `width` by `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        let samples = width * height * FINE * FINE;
        Self { width, height, light: vec![BACKGROUND.map(linear); samples], depth: vec![f32::MAX; samples] }
    }

    /// Draws a posed mesh into a region of the picture. `posed` is `mesh` in a pose.
    pub fn draw(&mut self, mesh: &Mesh, posed: &Posed, camera: Camera, frame: Frame) {
        let [left, top, width, height] = frame.map(|x| (x * FINE) as f32);
        let towards = unit(sub(camera.eye, camera.target));
        let right = unit(cross([0.0, 1.0, 0.0], towards));
        let up = cross(towards, right);
        let distance = dot(sub(camera.eye, camera.target), towards);
        let key = unit(KEY);
        // Half vector between the light and the eye.
        let half = unit([key[0], key[1], key[2] + 1.0]);
        let corners: Vec<Corner> = (0..mesh.positions.len())
            .map(|i| {
                let from = sub(posed.positions[i], camera.target);
                let away = distance - dot(from, towards);
                let zoom = height / camera.height * distance / away.max(1e-3);
                let normal = posed.normals[i];
                let seen = [dot(normal, right), dot(normal, up), dot(normal, towards)];
                let color = mesh.colors[i];
                let shine = gloss(mesh.finishes[i], dot(seen, half));
                let light = shade([color[0], color[1], color[2]], seen, normal[1], dot(seen, key));
                Corner {
                    at: [left + width / 2.0 + dot(from, right) * zoom, top + height / 2.0 - dot(from, up) * zoom, away],
                    light: light.map(|x| x + shine),
                }
            })
            .collect();
        let (triangles, _) = mesh.indices.as_chunks::<3>();
        let bounds = [left, top, left + width, top + height];
        for triangle in triangles {
            self.fill(triangle.map(|i| corners[i as usize]), bounds);
        }
    }

    /// Draws a closed line into a region of the picture, over what is there.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of the picture")]
    pub fn draw_line(&mut self, line: &[[f32; 3]], color: [u8; 3], camera: Camera, frame: Frame) {
        let [left, top, width, height] = frame.map(|x| x as f32);
        let towards = unit(sub(camera.eye, camera.target));
        let right = unit(cross([0.0, 1.0, 0.0], towards));
        let up = cross(towards, right);
        let distance = dot(sub(camera.eye, camera.target), towards);
        let seen = |at: &V| {
            let from = sub(*at, camera.target);
            let away = distance - dot(from, towards);
            let zoom = height / camera.height * distance / away.max(1e-3 * distance);
            [left + width / 2.0 + dot(from, right) * zoom, top + height / 2.0 - dot(from, up) * zoom]
        };
        let corners: Vec<_> = line.iter().map(seen).collect();
        for (at, &[x, y]) in corners.iter().enumerate() {
            let [to_x, to_y] = corners[(at + 1) % corners.len()];
            // Lines beyond the region end soon.
            let steps = (to_x - x).abs().max((to_y - y).abs()).ceil().clamp(1.0, 2.0 * height.max(width));
            for step in 0..=steps as usize {
                let share = step as f32 / steps;
                let (x, y) = (x + share * (to_x - x), y + share * (to_y - y));
                if (left..left + width).contains(&x) && (top..top + height).contains(&y) {
                    self.dot([x as usize, y as usize], color);
                }
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "samples of the picture")]
    fn fill(&mut self, [a, b, c]: [Corner; 3], [left, top, right, bottom]: [f32; 4]) {
        let edge = |p: V, q: V, x: f32, y: f32| (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
        let area = edge(a.at, b.at, c.at[0], c.at[1]);
        // Rows go down, so front faces have clockwise corners.
        if area >= 0.0 || !area.is_finite() {
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
                let between = |of: fn(&Corner) -> V| -> V {
                    let all = [of(&a), of(&b), of(&c)];
                    std::array::from_fn(|i| (0..3).map(|k| parts[k] * all[k][i]).sum())
                };
                let depth = between(|corner| corner.at)[2];
                let sample = y * self.width * FINE + x;
                if depth < self.depth[sample] {
                    self.depth[sample] = depth;
                    self.light[sample] = between(|corner| corner.light);
                }
            }
        }
    }

    /// Sets the colour of one pixel.
    fn dot(&mut self, [x, y]: [usize; 2], color: [u8; 3]) {
        for sample in 0..FINE * FINE {
            let (row, column) = (y * FINE + sample / FINE, x * FINE + sample % FINE);
            if row < self.height * FINE && column < self.width * FINE {
                self.light[row * self.width * FINE + column] = color.map(linear);
            }
        }
    }

    /// Writes the picture as PNG.
    ///
    /// # Errors
    /// Writing to `out` failed, or a side has more than `u32::MAX` pixels.
    pub fn write<W: Write>(&self, out: W) -> io::Result<()> {
        write_png(self.width, self.height, &self.pixels(), out)
    }

    /// `[height, width, 3]`, sRGB.
    fn pixels(&self) -> Vec<u8> {
        let mut pixels = Vec::with_capacity(self.width * self.height * 3);
        for y in 0..self.height {
            for x in 0..self.width {
                for channel in 0..3 {
                    let mut sum = 0.0;
                    for sample in 0..FINE * FINE {
                        let (row, column) = (y * FINE + sample / FINE, x * FINE + sample % FINE);
                        sum += self.light[row * self.width * FINE + column][channel];
                    }
                    pixels.push(encoded(sum / (FINE * FINE) as f32));
                }
            }
        }
        pixels
    }
}

/// Writes sRGB pixels, `[height, width, 3]`, as PNG.
pub(crate) fn write_png<W: Write>(width: usize, height: usize, pixels: &[u8], out: W) -> io::Result<()> {
    let mut encoder = png::Encoder::new(out, size(width)?, size(height)?);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::Balanced);
    encoder.write_header()?.write_image_data(pixels)?;
    Ok(())
}

fn size(pixels: usize) -> io::Result<u32> {
    u32::try_from(pixels).map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "the picture is too large"))
}

/// Diffuse shading: key light, sky and ground, and a faint rim.
fn shade(color: [u8; 3], seen: V, up: f32, key: f32) -> V {
    // The light wraps slightly around the shape, like that of a large lamp.
    let lit = ((key + 0.3) / 1.3).max(0.0);
    let fill = 0.5 + 0.5 * up;
    let rim = (1.0 - seen[2].max(0.0)).powi(3) * 0.10;
    let warm = [1.0, 0.97, 0.92];
    let sky = [0.92, 0.97, 1.05];
    std::array::from_fn(|i| linear(color[i]) * (0.74 * lit * warm[i] + (0.20 + 0.20 * fill) * sky[i]) + rim * 0.25)
}

/// Specular reflection of the key light; `half` is the cosine of the normal to the half vector.
fn gloss(finish: Finish, half: f32) -> f32 {
    let smooth = (1.0 - f32::from(finish.roughness) / 255.0).powi(2);
    half.max(0.0).powf(10.0 + 90.0 * smooth) * (0.01 + 0.24 * smooth)
}

/// Converts sRGB to linear light.
pub fn linear(value: u8) -> f32 {
    let x = f32::from(value) / 255.0;
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
fn encoded(light: f32) -> u8 {
    let x = light.clamp(0.0, 1.0);
    let x = if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (x * 255.0).round() as u8
}
