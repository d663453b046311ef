//! Solids as implicit functions: negative inside, and approximately the distance near the surface.

use super::vector::{V, add, curve, dot, length, scale, sub};

/// A primitive.
pub(super) enum Shape {
    /// Round about the line from `a` to `b`; `radii` are pairs of a share of the way and the radius there.
    Tube { a: V, b: V, radii: Vec<(f32, f32)> },
    /// Half axes along X, Y and Z.
    Ellipsoid { centre: V, radii: V },
    /// Horizontal sections: height, half width, half depth and forward offset, as curves over the height.
    Stack { x: f32, width: Vec<(f32, f32)>, depth: Vec<(f32, f32)>, forward: Vec<(f32, f32)> },
    /// Folds of cloth for `Join::Displace`, with the given height in metres: waves along `along` within `reach` of
    /// the centre.
    Folds { centre: V, reach: f32, along: V, length: f32, height: f32 },
    /// The half space on the side opposite to `normal`.
    Below { point: V, normal: V },
}

/// Operation that joins a shape to the ones before it; the length is the width of the blend.
#[derive(Clone, Copy)]
pub(super) enum Join {
    Union(f32),
    Cut(f32),
    Within(f32),
    /// Displaces the existing surface outwards by the shape's value.
    Displace,
}

/// Step of the finite differences of a gradient, in metres.
const STEP: f32 = 5e-4;

/// Shapes joined one after another.
#[derive(Default)]
pub(super) struct Solid(Vec<(Shape, Join)>);

impl Solid {
    pub(super) fn with(mut self, shape: Shape, join: Join) -> Self {
        self.0.push((shape, join));
        self
    }

    pub(super) fn at(&self, p: V) -> f32 {
        self.0.iter().fold(f32::MAX, |field, (shape, join)| {
            let own = shape.at(p);
            match *join {
                Join::Union(width) => smooth_min(field, own, width),
                Join::Cut(width) => -smooth_min(-field, own, width),
                Join::Within(width) => -smooth_min(-field, -own, width),
                Join::Displace => field - own,
            }
        })
    }

    /// Direction of steepest ascent of the field, not of unit length.
    pub(super) fn gradient(&self, p: V) -> V {
        std::array::from_fn(|axis| {
            let mut step = [0.0; 3];
            step[axis] = STEP;
            (self.at(add(p, step)) - self.at(sub(p, step))) / (2.0 * STEP)
        })
    }

    /// Approximately the nearest point of the surface, at most `reach` from `p`.
    pub(super) fn settle(&self, p: V, reach: f32) -> V {
        let mut at = p;
        for _ in 0..2 {
            let field = self.at(at);
            let gradient = self.rise(at, field);
            let steep = dot(gradient, gradient).max(0.05);
            at = add(at, scale(gradient, -field / steep));
        }
        let moved = sub(at, p);
        let far = length(moved);
        if far > reach { add(p, scale(moved, reach / far)) } else { at }
    }

    /// Direction of steepest ascent of the field, whose value at `p` is `here`; not of unit length.
    fn rise(&self, p: V, here: f32) -> V {
        std::array::from_fn(|axis| {
            let mut beside = p;
            beside[axis] += STEP;
            (self.at(beside) - here) / STEP
        })
    }
}

/// Ambient occlusion at `p` around `normal`, 0..=1, from the distances of the solids (Evans 2006).
pub(super) fn occlusion(solids: &[&Solid], p: V, normal: V, reach: f32) -> f32 {
    let (mut sum, mut most) = (0.0, 0.0);
    for step in 1..=5_u8 {
        let out = reach * (f32::from(step) / 5.0).powf(1.5);
        let at = add(p, scale(normal, out));
        let free = solids.iter().map(|solid| solid.at(at)).fold(out, f32::min);
        let weight = 0.75_f32.powi(i32::from(step));
        sum += weight * (1.0 - (free / out).clamp(0.0, 1.0));
        most += weight;
    }
    sum / most
}

impl Shape {
    /// A tube whose radius varies linearly.
    pub(super) fn cone(a: V, b: V, from: f32, to: f32) -> Self {
        Self::Tube { a, b, radii: vec![(0.0, from), (1.0, to)] }
    }

    pub(super) fn ball(centre: V, radius: f32) -> Self {
        Self::Ellipsoid { centre, radii: [radius; 3] }
    }

    pub(super) fn at(&self, p: V) -> f32 {
        match self {
            Self::Tube { a, b, radii } => {
                let (along, from) = (sub(*b, *a), sub(p, *a));
                let t = (dot(from, along) / dot(along, along).max(1e-12)).clamp(0.0, 1.0);
                let radius =
                    if let &[(_, from), (_, to)] = radii.as_slice() { from + (to - from) * t } else { curve(radii, t) };
                length(sub(from, scale(along, t))) - radius
            }
            Self::Ellipsoid { centre, radii } => {
                let from = sub(p, *centre);
                let near: V = std::array::from_fn(|i| from[i] / radii[i]);
                let steep: V = std::array::from_fn(|i| near[i] / radii[i]);
                let (near, steep) = (length(near), length(steep));
                // At the centre the quotient is undefined, and any depth will do.
                if steep < 1e-6 { -radii[0].min(radii[1]).min(radii[2]) } else { near * (near - 1.0) / steep }
            }
            Self::Stack { x, width, depth, forward } => {
                let (wide, deep) = (curve(width, p[1]), curve(depth, p[1]));
                let (u, w) = ((p[0] - x) / wide, (p[2] - curve(forward, p[1])) / deep);
                // Slightly squarer than an ellipse.
                let (u, w) = (u * u, w * w);
                let round = 0.72 * (u + w).sqrt() + 0.28 * (u * u + w * w).sqrt().sqrt();
                (round - 1.0) * wide.min(deep)
            }
            Self::Folds { centre, reach, along, length: wave, height } => {
                let from = sub(p, *centre);
                let near = (1.0 - dot(from, from) / (reach * reach)).max(0.0);
                height * near * near * (std::f32::consts::TAU * dot(from, *along) / wave).sin()
            }
            Self::Below { point, normal } => dot(sub(p, *point), *normal),
        }
    }
}

/// Minimum of two values, rounded if they are within `width` of each other.
pub(super) fn smooth_min(a: f32, b: f32, width: f32) -> f32 {
    if width <= 0.0 {
        return a.min(b);
    }
    let near = (width - (a - b).abs()).max(0.0) / width;
    a.min(b) - near * near * width * 0.25
}
