//! Fine relief of cloth and leather, as tiling normal maps.
//!
//! A map is a height field over a square that tiles in both directions; its normals are the slopes. Heights are
//! computed by products, roots and integers only, which every processor rounds alike, so the pixels are the same
//! everywhere.

use std::io::{self, Write};

use crate::picture::write_png;

/// Relief of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Detail {
    /// None: skin, eyes, teeth, hair, rubber, metal.
    #[default]
    None,
    /// Stockinette of a sweater.
    Knit,
    /// Plain weave of a shirt.
    Weave,
    /// [`Weave`](Detail::Weave) with a line of stitches along the edge where v is 0.
    StitchedWeave,
    /// Diagonal ribs of trousers.
    Twill,
    /// Grain.
    Leather,
}

/// A normal map in tangent space: red along u, green against v (glTF's +Y), blue outwards.
#[derive(Clone, Debug)]
pub struct NormalMap {
    /// Texels across and down.
    pub size: [usize; 2],
    /// `[height * width]`, rows from the top; 0 for -1, 255 for 1.
    pub pixels: Vec<[u8; 3]>,
}

impl NormalMap {
    /// Pixel of a surface without relief.
    pub const FLAT: [u8; 3] = [128, 128, 255];

    /// Writes the map as PNG.
    ///
    /// # Errors
    /// Writing to `out` failed.
    pub fn write<W: Write>(&self, out: W) -> io::Result<()> {
        write_png(self.size[0], self.size[1], self.pixels.as_flattened(), out)
    }
}

/// Threads of the weave and the twill per repeat.
const THREADS: usize = 16;
/// Ribs of the twill per repeat.
const RIBS: usize = 8;
/// Stitches of the knit per repeat.
const STITCHES: usize = 8;
/// Cells of the leather's grain per repeat.
const CELLS: usize = 12;
/// Texels per repeat, across.
const WIDE: usize = 128;

impl Detail {
    /// All variants with a relief.
    pub const RELIEFS: [Self; 5] = [Self::Knit, Self::Weave, Self::StitchedWeave, Self::Twill, Self::Leather];

    /// Name for use in file names.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "plain",
            Self::Knit => "knit",
            Self::Weave => "weave",
            Self::StitchedWeave => "stitched-weave",
            Self::Twill => "twill",
            Self::Leather => "leather",
        }
    }

    /// Width and height of one repeat of the map, in metres.
    pub const fn repeat_m(self) -> [f32; 2] {
        match self {
            Self::None => [1.0, 1.0],
            // A stitch is 4 mm wide and 3 mm tall.
            Self::Knit => [0.032, 0.024],
            // Threads of 1.5 mm, and stitches of 3 mm.
            Self::Weave => [0.024, 0.024],
            Self::StitchedWeave => [0.024, 0.048],
            Self::Twill => [0.028, 0.028],
            Self::Leather => [0.030, 0.030],
        }
    }

    /// Number of stitches, threads, ribs or grains on one repeat, to the right and down. At less than three pixels
    /// for each of them, the relief should not be shown.
    pub const fn threads(self) -> [f32; 2] {
        match self {
            Self::None => [0.0; 2],
            Self::Knit => [STITCHES as f32; 2],
            Self::Weave => [THREADS as f32; 2],
            Self::StitchedWeave => [THREADS as f32, 2.0 * THREADS as f32],
            // Ribs are diagonal.
            Self::Twill => [RIBS as f32 * std::f32::consts::SQRT_2; 2],
            Self::Leather => [CELLS as f32; 2],
        }
    }

    /// Returns the normal map; `None` without a relief.
    pub fn normal_map(self) -> Option<NormalMap> {
        let height: fn(f32, f32) -> f32 = match self {
            Self::None => return None,
            Self::Knit => knit,
            Self::Weave => weave,
            Self::StitchedWeave => stitched_weave,
            Self::Twill => twill,
            Self::Leather => leather,
        };
        let [wide, tall] = self.repeat_m();
        let size = if self == Self::StitchedWeave { [WIDE, 2 * WIDE] } else { [WIDE, WIDE] };
        Some(normals(size, [wide, tall], height))
    }
}

/// Normals of a height field in metres over one repeat, with coordinates in `[0, 1)`, right and down.
fn normals([width, height]: [usize; 2], [wide, tall]: [f32; 2], relief: fn(f32, f32) -> f32) -> NormalMap {
    let at = |x: usize, y: usize| {
        relief(((x % width) as f32 + 0.5) / width as f32, ((y % height) as f32 + 0.5) / height as f32)
    };
    let heights: Vec<f32> = (0..width * height).map(|i| at(i % width, i / width)).collect();
    let at = |x: usize, y: usize| heights[y % height * width + x % width];
    let step = [2.0 * wide / width as f32, 2.0 * tall / height as f32];
    let mut tilts: Vec<[f32; 2]> = Vec::with_capacity(heights.len());
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let right = (at(x + 1, y) - at(x + width - 1, y)) / step[0];
        // Up is opposite to the order of rows.
        let up = (at(x, y + height - 1) - at(x, y + 1)) / step[1];
        let long = (1.0 + right * right + up * up).sqrt();
        tilts.push([-right / long, -up / long]);
    }
    // The slopes of a periodic height have zero mean, but the normals' mean is tilted where ridges lean. From afar,
    // where a map is seen as its mean, the surface must keep its normal.
    for _ in 0..3 {
        let mean = [0, 1].map(|axis: usize| tilts.iter().map(|tilt| tilt[axis]).sum::<f32>() / tilts.len() as f32);
        tilts.iter_mut().for_each(|tilt| *tilt = [tilt[0] - mean[0], tilt[1] - mean[1]]);
    }
    let pixels = tilts.iter().map(|&[x, y]| [x, y, (1.0 - x * x - y * y).max(0.0).sqrt()].map(byte));
    NormalMap { size: [width, height], pixels: pixels.collect() }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=255")]
fn byte(x: f32) -> u8 {
    // 128 stands for 0; for readers that use 127.5, the error is below that of their filters.
    (127.5 * x + 127.5 + 1e-3).round().clamp(0.0, 255.0) as u8
}

/// Parabola that is 0 at the ends of `[0, 1]` and 1 in the middle.
fn arch(x: f32) -> f32 {
    1.0 - (2.0 * x - 1.0) * (2.0 * x - 1.0)
}

fn fraction(x: f32) -> f32 {
    x - x.floor()
}

/// Index of the cell, of `count` per repeat, that contains `x`.
#[expect(clippy::cast_possible_truncation, reason = "a small whole number")]
fn cell(x: f32, count: usize) -> usize {
    let count = i64::try_from(count).expect("small");
    usize::try_from((x.floor() as i64).rem_euclid(count)).expect("not negative")
}

/// A pseudo-random number in `[0, 1)` (Wellons' `lowbias32`).
fn chance(a: usize, b: usize, salt: u32) -> f32 {
    let [a, b] = [a, b].map(|n| u32::try_from(n).expect("few cells"));
    let mut x = a.wrapping_mul(0x9e37_79b9) ^ b.wrapping_mul(0x85eb_ca6b) ^ salt.wrapping_mul(0xc2b2_ae35);
    for factor in [0x7feb_352d_u32, 0x846c_a68b] {
        x = (x ^ x >> 16).wrapping_mul(factor);
    }
    ((x ^ x >> 16) >> 8) as f32 / 16_777_216.0
}

/// Two strands lean towards each other in each column.
fn knit(x: f32, y: f32) -> f32 {
    let (across, down) = (x * STITCHES as f32, y * STITCHES as f32);
    let column = cell(across, STITCHES);
    // 0 between columns, 1 in a column's middle.
    let inner = 1.0 - (2.0 * fraction(across) - 1.0).abs();
    let along = down - 0.62 * inner + 0.16 * (chance(column, 0, 1) - 0.5);
    let row = cell(along, STITCHES);
    let half = usize::from(fraction(across) > 0.5);
    let full = 0.85 + 0.3 * chance(2 * column + half, row, 2);
    let strand = 0.35 + 0.65 * arch(fraction(along));
    0.00042 * full * arch(inner).max(0.0).sqrt() * strand
}

/// Threads that cross over and under each other.
fn weave(x: f32, y: f32) -> f32 {
    let (across, down) = (x * THREADS as f32, y * THREADS as f32);
    let (column, row) = (cell(across, THREADS), cell(down, THREADS));
    woven(fraction(across), fraction(down), column, row)
}

fn woven(across: f32, down: f32, column: usize, row: usize) -> f32 {
    let is_upright = (column + row).is_multiple_of(2);
    let (side, length, thread) = if is_upright { (across, down, column) } else { (down, across, row) };
    let thick = 0.8 + 0.4 * chance(thread, usize::from(is_upright), 3);
    0.00014 * thick * arch(side) * (0.45 + 0.55 * arch(length))
}

/// A line of stitches 4.5 mm from the edge, in a shallow groove.
fn stitched_weave(x: f32, y: f32) -> f32 {
    let down = y * 2.0 * THREADS as f32;
    let (column, row) = (cell(x * THREADS as f32, THREADS), cell(down, 2 * THREADS));
    let cloth = woven(fraction(x * THREADS as f32), fraction(down), column, row);
    let off = (y * 48.0 - 4.5) / 1.1;
    let groove = (1.0 - (off / 2.2) * (off / 2.2)).max(0.0);
    let along = fraction(x * 8.0) / 0.78;
    let stitch = if along < 1.0 { (1.0 - off * off).max(0.0).sqrt() * arch(along).max(0.0).sqrt() } else { 0.0 };
    cloth * (1.0 - 0.7 * groove) - 0.00045 * groove * groove + 0.0005 * stitch
}

/// Diagonal ribs of threads that float over others, with furrows between them.
fn twill(x: f32, y: f32) -> f32 {
    let (across, down) = ((x + y) * RIBS as f32, y * THREADS as f32);
    let rib = arch(fraction(across)).max(0.0).sqrt();
    let thread = arch(fraction(down));
    let thick = 0.85 + 0.3 * chance(cell(across, RIBS), cell(down, THREADS), 4);
    0.00034 * thick * rib * (0.7 + 0.3 * thread)
}

/// Cells with creases between them.
fn leather(x: f32, y: f32) -> f32 {
    let (across, down) = (x * CELLS as f32, y * CELLS as f32);
    let (mut first, mut second, mut swell) = (f32::MAX, f32::MAX, 0.0);
    for (dx, dy) in (-2..=2_i8).flat_map(|dy| (-2..=2_i8).map(move |dx| (dx, dy))) {
        let (left, top) = (across.floor() + f32::from(dx), down.floor() + f32::from(dy));
        let (column, row) = (cell(left, CELLS), cell(top, CELLS));
        let place = [5, 6].map(|salt| 0.1 + 0.8 * chance(column, row, salt));
        let off = [left + place[0] - across, top + place[1] - down];
        let far = (off[0] * off[0] + off[1] * off[1]).sqrt();
        if far < first {
            (second, first, swell) = (first, far, chance(column, row, 7));
        } else if far < second {
            second = far;
        }
    }
    // Distance from the nearest crease, with a rounded edge.
    let t = ((second - first) / 0.42).clamp(0.0, 1.0);
    0.00017 * (0.75 + 0.5 * swell * t) * t * (2.0 - t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_are_unit_and_their_mean_is_straight_up() {
        for detail in Detail::RELIEFS {
            let map = detail.normal_map().unwrap();
            assert_eq!(map.pixels.len(), map.size[0] * map.size[1]);
            let normal = |pixel: &[u8; 3]| pixel.map(|x| f64::from(x) / 127.5 - 1.0);
            let mut sum = [0.0; 3];
            let mut lowest = 1.0_f64;
            for n in map.pixels.iter().map(normal) {
                let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
                assert!((length - 1.0).abs() < 0.5 * 3.0_f64.sqrt() / 127.5, "{detail:?}: {length}");
                lowest = lowest.min(n[2]);
                (0..3).for_each(|axis| sum[axis] += n[axis]);
            }
            let mean = sum.map(|x| x / map.pixels.len() as f64);
            // A flat place is stored as 128, which is 0.004 above 0.
            assert!(mean[0].abs() < 0.005 && mean[1].abs() < 0.005, "{detail:?}: {mean:?}");
            // There is a relief, but a shallow one.
            assert!((0.5..0.97).contains(&lowest), "{detail:?}: {lowest}");
            assert!(mean[2] > 0.9, "{detail:?}: {mean:?}");
        }
        assert!(Detail::None.normal_map().is_none());
    }

    #[test]
    fn maps_repeat_without_an_edge() {
        for detail in Detail::RELIEFS {
            let NormalMap { size: [width, height], pixels } = detail.normal_map().unwrap();
            let apart = |a: usize, b: usize| {
                (0..3).map(|axis| i32::from(pixels[a][axis].abs_diff(pixels[b][axis]))).sum::<i32>()
            };
            let column = |x: usize| (0..height).map(|y| apart(y * width + x, y * width + (x + 1) % width)).sum::<i32>();
            let row = |y: usize| (0..width).map(|x| apart(y * width + x, (y + 1) % height * width + x)).sum::<i32>();
            // The step across the edge is at most the largest one inside.
            assert!(column(width - 1) <= (0..width - 1).map(column).max().unwrap(), "{detail:?}");
            assert!(row(height - 1) <= (0..height - 1).map(row).max().unwrap(), "{detail:?}");
        }
    }

    #[test]
    fn files_are_small_and_do_not_change() {
        for detail in Detail::RELIEFS {
            let mut files = [Vec::new(), Vec::new()];
            files.iter_mut().for_each(|file| detail.normal_map().unwrap().write(file).unwrap());
            assert_eq!(files[0], files[1]);
            assert!(files[0].len() < 100_000, "{detail:?}: {} bytes", files[0].len());
        }
    }
}
