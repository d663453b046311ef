//! The shape of a body's volume: lines to draw, and sizes to print.

use umo_core_pose::rotation::rotate;

use super::align::{Vector, axes, cross, dot, less};
use super::volume::{ANGLES, FOREARM, LIMBS, PARTS, RINGS, Shape, THIGH, UPPER_ARM};
use super::{Mapping, Rig, Volume};

/// Corners of a limb's circles.
const CORNERS: u8 = 12;

/// A closed line: places in the rig's world at rest, each with the bone that it follows.
pub type Outline = Vec<(usize, [f32; 3])>;

/// Direction of a radius of a cross-section, in the shape's axes.
#[expect(clippy::cast_precision_loss, reason = "sixteen")]
fn direction(angle: usize) -> Vector {
    // The perimeter of a diamond, from behind over the left.
    let quarter = 4.0 * angle as f32 / ANGLES as f32;
    let z = if quarter < 2.0 { quarter - 1.0 } else { 3.0 - quarter };
    let x = if quarter < 2.0 { 1.0 - z.abs() } else { z.abs() - 1.0 };
    let length = x.hypot(z);
    [x / length, 0.0, z / length]
}

impl Shape {
    /// Corners of a cross-section about the origin, in the shape's axes.
    #[expect(clippy::cast_precision_loss, reason = "a dozen")]
    fn section(&self, ring: usize) -> [Vector; ANGLES] {
        let height = self.ends[0] + (self.ends[1] - self.ends[0]) * ring as f32 / (RINGS - 1) as f32;
        std::array::from_fn(|angle| {
            let [x, _, z] = direction(angle).map(|part| part * self.radii[ring][angle]);
            [x, height, z]
        })
    }

    /// Width and depth of some cross-sections, the largest of each.
    fn extent(&self, rings: std::ops::Range<usize>) -> [f32; 2] {
        let across = |ring: &[f32; ANGLES], from: usize| ring[from] + ring[from + ANGLES / 2];
        let most = |from: usize| self.radii[rings.clone()].iter().map(|ring| across(ring, from)).fold(0.0, f32::max);
        [most(ANGLES / 4), most(0)]
    }
}

impl Volume {
    /// Returns closed lines around trunk, head and limbs at rest: cross-sections, each point with the bone that it
    /// follows. `rig` and `mapping` are those of which it was measured.
    pub fn outlines(&self, rig: &Rig, mapping: &Mapping) -> Vec<Outline> {
        let (Ok((axes, _)), Some(hips)) = (axes(rig, mapping), mapping.bone(0)) else { return Vec::new() };
        let spine: Vec<usize> = match mapping.spine() {
            [] => [3, 6, 9].into_iter().filter_map(|joint| mapping.bone(joint)).collect(),
            spine => spine.to_vec(),
        };
        let chest = spine.last().copied().unwrap_or(hips);
        let belly = spine.get((spine.len().max(1) - 1) / 2).copied().unwrap_or(hips);
        let mut lines = Vec::new();
        let mut add = |shape: &Shape, bone: &dyn Fn(f32) -> usize| {
            lines.extend((0..RINGS).map(|ring| {
                let placed = shape.section(ring).map(|at| {
                    let by = rotate(axes, at);
                    (bone(at[1]), std::array::from_fn(|i| shape.base[i] + by[i]))
                });
                placed.to_vec()
            }));
        };
        add(&self.trunk, &|height| match height / self.size {
            low if low < 0.2 => hips,
            middle if middle < 0.65 => belly,
            _ => chest,
        });
        if let Some(head) = mapping.bone(15) {
            add(&self.head, &|_| head);
        }
        for (limb, &(from, to)) in LIMBS.iter().enumerate() {
            for side in 0..2 {
                let is_neck = from == 12;
                let (from, to) = (from + side * usize::from(!is_neck), to + side);
                if let Some((a, b)) = mapping.bone(from).zip(mapping.bone(to)).filter(|_| !is_neck) {
                    lines.extend(circles(a, rig.place(a), rig.place(b), self.limbs[limb]));
                }
            }
        }
        lines
    }

    /// Returns each part that [`scale`](Self::scale) knows with its width and depth, in the rig's unit.
    pub fn sizes(&self) -> [(&'static str, [f32; 2]); PARTS.len()] {
        let round = |limb: usize| [2.0 * self.limbs[limb][0].max(self.limbs[limb][1]); 2];
        PARTS.map(|part| {
            let size = match part {
                "pelvis" => self.trunk.extent(0..4),
                "belly" => self.trunk.extent(4..8),
                "chest" => self.trunk.extent(8..RINGS),
                "head" => self.head.extent(0..RINGS),
                "neck" => round(0),
                "upper_arms" => round(UPPER_ARM),
                "forearms" => round(FOREARM),
                "thighs" => round(THIGH),
                _ => [2.0 * self.palm, 2.0 * self.finger],
            };
            (part, size)
        })
    }
}

/// Circles about a limb, from its bone to the next.
fn circles(bone: usize, from: Vector, to: Vector, radii: [f32; 2]) -> Vec<Outline> {
    let way = less(to, from);
    let other = if way[1].abs() > way[0].abs() { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let unit = |v: Vector| v.map(|x| x / dot(v, v).sqrt().max(f32::MIN_POSITIVE));
    let across = unit(cross(way, other));
    let along = unit(cross(way, across));
    let circle = |share: f32| {
        let radius = radii[0] + share * (radii[1] - radii[0]);
        let corner = |corner: u8| {
            let (sine, cosine) = (f32::from(corner) / f32::from(CORNERS) * std::f32::consts::TAU).sin_cos();
            let place = |i: usize| from[i] + share * way[i] + radius * (cosine * across[i] + sine * along[i]);
            (bone, std::array::from_fn(place))
        };
        (0..CORNERS).map(corner).collect()
    };
    [0.1, 0.5, 0.9].map(circle).to_vec()
}
