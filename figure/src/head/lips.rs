//! Geometry of the lips, their weights of the jaw, and the motion of the jaw.

use super::Kind;
use crate::vector::{V, ramp, scale, sub, turn_x};

/// A vertex of a lip or of the mouth behind it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) upper: bool,
    /// Index of the ring: 0 where the lips touch, 1 and up outwards, -1 and down into the mouth.
    pub(super) ring: i8,
    /// Contact point of the lips next to this vertex.
    pub(super) contact: V,
}

/// Half the mouth's width, metres.
pub(super) const WIDE: f32 = 0.0240;
/// Hinge of the jaw, and its angle in radians at `jawOpen` = 1.
const HINGE: V = [0.0, -0.036, -0.066];
const OPEN: f32 = 0.27;
/// Share of the gap between open lips that the upper lip covers when they close.
const UPPER_SHARE: f32 = 0.32;
/// Share of the lips' motion that the mouth behind them follows, by ring.
const WITHIN: [f32; 7] = [1.0, 1.0, 0.8, 0.45, 0.1, 0.0, 0.0];

/// Height of the line between the lips.
pub(super) fn line(x: f32) -> f32 {
    let t = (x.abs() / WIDE).min(1.2);
    -0.0668 + 0.0014 * t * t
}

/// Share of the jaw's motion that the mouth's corners follow.
const CORNER: f32 = 0.38;

/// 0 above the mouth, 1 below it. On the lips, the two values converge towards a corner and are equal beyond it.
pub(super) fn side(p: V, upper: Option<bool>) -> f32 {
    let x = p[0].abs();
    let rise = p[1] - line(x);
    let t = (x / WIDE).min(1.0);
    // Open lips form an oval.
    let joined = 1.0 - (1.0 - t * t).powf(0.62);
    // The influence of the corner's motion extends further up and down with the distance from the middle.
    let reach = 0.011 + 0.55 * (x - 0.5 * WIDE).max(0.0);
    let near = joined * (-(rise / reach).powi(2)).exp();
    if upper.unwrap_or(rise > 0.0) { CORNER * near } else { 1.0 - (1.0 - CORNER) * near }
}

/// Point whose motion a vertex follows, and the weight.
pub(super) fn anchor(kind: Kind, place: V) -> (V, f32) {
    match kind {
        Kind::Lip(point) if point.ring < 0 => (point.contact, WITHIN[usize::from(point.ring.unsigned_abs())]),
        _ => (place, 1.0),
    }
}

/// 0 for vertices above the mouth, 1 for those below it.
pub(super) fn below(kind: Kind, place: V) -> f32 {
    match kind {
        Kind::Lip(point) if point.ring <= 0 => side(point.contact, Some(point.upper)),
        Kind::Lip(point) => side(place, Some(point.upper)),
        _ => side(place, None),
    }
}

/// Weight of the jaw for a vertex, 0..=1.
pub(super) fn jaw(kind: Kind, place: V) -> f32 {
    match kind {
        Kind::LowerTeeth | Kind::Tongue(_) => 1.0,
        Kind::Lip(_) => below(kind, place),
        Kind::Skin => below(kind, place) * ramp(-0.062, -0.010, place[2]) * ramp(0.01, -0.03, place[1]),
        Kind::Lid(point) => point.share * below(kind, place) * ramp(0.01, -0.03, place[1]),
        _ => 0.0,
    }
}

/// Displacement by the fully open jaw, at weight 1.
pub(super) fn opened(p: V) -> V {
    sub(turn_x(p, HINGE, OPEN), p)
}

/// Displacement that closes the lips while the jaw is open.
pub(super) fn closed(kind: Kind, place: V) -> V {
    let (contact, upper, near) = match kind {
        // Around the lips, the vertex's position determines the share of the jaw's motion to undo.
        Kind::Lip(point) if point.ring > 0 => {
            let x = place[0].clamp(-WIDE, WIDE);
            ([x, line(x), point.contact[2]], point.upper, 1.0)
        }
        Kind::Lip(point) => (point.contact, point.upper, anchor(kind, place).1),
        Kind::Skin if place[2] > -0.03 => {
            let x = place[0].clamp(-WIDE, WIDE);
            ([x, line(x), 0.018], place[1] > line(place[0]), 1.0)
        }
        _ => return [0.0; 3],
    };
    let gap = side(contact, Some(false)) - side(contact, Some(true));
    let away = match kind {
        Kind::Lip(point) if point.ring <= 0 => 0.0,
        _ => ((place[1] - line(place[0])).abs() - 0.006).max(0.0),
    };
    let fades = (-(away / 0.0115).powi(2)).exp();
    let part = if upper { UPPER_SHARE } else { UPPER_SHARE - 1.0 };
    scale(opened(contact), gap * part * near * if fades < 0.01 { 0.0 } else { fades })
}
