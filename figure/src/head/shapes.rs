//! The 52 ARKit shapes: displacement of each vertex of the head by each shape.

use super::eye::Eye;
use super::lids::Motion;
use super::lips::{self, WIDE, anchor, below, closed, jaw, line, opened};
use super::{Kind, Vertex};
use crate::vector::{V, add, ramp, scale, sub};

/// Vertices that a push may move.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Where {
    All,
    /// Above the line between the lips.
    Above,
    /// Below it.
    Below,
}

/// A smooth displacement of skin, lips and brows, in metres: strongest at `at`, a third as strong at a distance of
/// `wide`, and 0 beyond twice that. A push at the side is given for the left half.
struct Push {
    part: Where,
    at: V,
    wide: V,
    by: V,
}

const fn push(part: Where, at: V, wide: V, by: V) -> Push {
    Push { part, at, wide, by }
}

use Where::{Above, All, Below};

const MOUTH: f32 = -0.066;
/// Distance beyond the middle that a one-sided shape of a lip reaches, in metres.
pub(crate) const ACROSS: f32 = 0.012;

/// The pushes of a shape, by its name without `Left` or `Right`.
#[rustfmt::skip]
fn pushes(stem: &str) -> Vec<Push> {
    match stem {
        "eyeSquint" => vec![
            push(All, [0.034, -0.024, 0.01], [0.022, 0.013, 0.03], [0.0, 0.0042, 0.0012]),
        ],
        "eyeWide" => vec![push(All, [0.032, 0.026, 0.02], [0.024, 0.012, 0.03], [0.0, 0.0022, 0.0])],
        "browDown" => vec![
            push(All, [0.026, 0.025, 0.018], [0.027, 0.018, 0.04], [-0.0022, -0.0066, 0.0014]),
            push(All, [0.010, 0.020, 0.018], [0.012, 0.014, 0.04], [-0.0020, -0.0024, 0.0012]),
        ],
        "browInnerUp" => vec![push(All, [0.0, 0.027, 0.02], [0.026, 0.022, 0.04], [0.0, 0.0098, 0.0004])],
        "browOuterUp" => vec![push(All, [0.042, 0.026, 0.008], [0.021, 0.021, 0.04], [0.0, 0.0088, 0.0])],
        "cheekPuff" => vec![
            push(All, [0.043, -0.060, -0.004], [0.024, 0.027, 0.034], [0.0112, 0.0, 0.0072]),
            push(All, [0.0, MOUTH, 0.02], [0.028, 0.016, 0.03], [0.0, 0.0, 0.0018]),
        ],
        "cheekSquint" => vec![
            push(All, [0.039, -0.030, 0.006], [0.022, 0.017, 0.03], [0.0008, 0.0092, 0.0052]),
        ],
        "noseSneer" => vec![
            push(All, [0.0125, -0.038, 0.020], [0.0120, 0.014, 0.02], [0.0026, 0.0085, 0.0012]),
            push(Above, [0.016, -0.054, 0.016], [0.015, 0.013, 0.03], [0.0012, 0.0058, 0.0016]),
            push(All, [0.009, 0.004, 0.012], [0.013, 0.014, 0.03], [-0.0012, -0.0034, 0.0020]),
        ],
        _ => mouth_pushes(stem),
    }
}

fn mouth_pushes(stem: &str) -> Vec<Push> {
    match stem {
        "mouthSmile" => vec![
            push(All, [WIDE + 0.009, MOUTH + 0.002, 0.008], [0.0175, 0.020, 0.035], [0.0098, 0.0118, -0.0058]),
            push(All, [0.040, -0.036, 0.005], [0.020, 0.018, 0.03], [0.0016, 0.0044, 0.0030]),
        ],
        "mouthFrown" => vec![
            push(All, [WIDE + 0.005, MOUTH, 0.010], [0.0155, 0.016, 0.03], [0.0006, -0.0100, -0.0006]),
            push(Below, [0.014, MOUTH - 0.012, 0.02], [0.014, 0.010, 0.03], [0.0, 0.0016, 0.0010]),
        ],
        "mouthDimple" => {
            vec![push(All, [WIDE + 0.003, MOUTH + 0.001, 0.01], [0.012, 0.013, 0.03], [0.0050, 0.0014, -0.0092])]
        }
        "mouthStretch" => {
            vec![push(All, [WIDE, MOUTH - 0.002, 0.012], [0.019, 0.018, 0.03], [0.0088, -0.0026, -0.0052])]
        }
        "mouthPress" => vec![
            push(Above, [0.010, MOUTH + 0.004, 0.02], [0.016, 0.008, 0.03], [0.0, -0.0028, -0.0022]),
            push(Below, [0.010, MOUTH - 0.005, 0.02], [0.016, 0.009, 0.03], [0.0, 0.0034, -0.0022]),
            push(All, [WIDE + 0.006, MOUTH, 0.01], [0.012, 0.012, 0.03], [0.0012, 0.0, 0.0026]),
        ],
        "mouthLowerDown" => {
            vec![push(Below, [0.0090, MOUTH - 0.004, 0.02], [0.0205, 0.017, 0.03], [0.0012, -0.0084, 0.0014])]
        }
        "mouthUpperUp" => vec![
            push(Above, [0.0090, MOUTH + 0.004, 0.02], [0.0205, 0.017, 0.03], [0.0008, 0.0070, 0.0012]),
            push(Above, [0.024, MOUTH + 0.024, 0.015], [0.016, 0.014, 0.03], [0.0, 0.0026, 0.0018]),
        ],
        "mouthRollLower" => vec![
            push(Below, [0.0, MOUTH - 0.004, 0.025], [0.030, 0.0085, 0.03], [0.0, 0.0040, -0.0085]),
            push(Below, [0.0, MOUTH - 0.015, 0.02], [0.026, 0.010, 0.03], [0.0, 0.0026, -0.0008]),
        ],
        "mouthRollUpper" => vec![
            push(Above, [0.0, MOUTH + 0.003, 0.025], [0.030, 0.0075, 0.03], [0.0, -0.0036, -0.0080]),
            push(Above, [0.0, MOUTH + 0.013, 0.02], [0.026, 0.010, 0.03], [0.0, -0.0026, -0.0004]),
        ],
        "mouthShrugLower" => vec![
            push(Below, [0.0, MOUTH - 0.006, 0.02], [0.026, 0.014, 0.03], [0.0, 0.0058, 0.0040]),
            push(Above, [0.0, MOUTH + 0.003, 0.02], [0.024, 0.010, 0.03], [0.0, 0.0040, 0.0014]),
            push(Below, [0.0, -0.098, 0.012], [0.024, 0.018, 0.03], [0.0, 0.0050, 0.0014]),
        ],
        "mouthShrugUpper" => vec![
            push(Above, [0.0, MOUTH + 0.005, 0.02], [0.026, 0.014, 0.03], [0.0, 0.0056, 0.0034]),
            push(Below, [0.0, MOUTH - 0.004, 0.02], [0.020, 0.008, 0.03], [0.0, 0.0030, 0.0]),
        ],
        _ => Vec::new(),
    }
}

/// One channel's shape.
pub(super) struct Shape {
    /// The name without `Left` or `Right`.
    stem: &'static str,
    /// 1 for the left, -1 for the right, 0 for both.
    side: f32,
    pushes: Vec<Push>,
    lids: Motion,
}

impl Shape {
    pub(super) fn new(name: &'static str) -> Self {
        let sides = [("Left", 1.0), ("Right", -1.0)];
        let half = sides.iter().find_map(|&(suffix, side)| Some((name.strip_suffix(suffix)?, side)));
        let (stem, side) = half.unwrap_or((name, 0.0));
        Self { stem, side, pushes: pushes(stem), lids: lid_motion(stem) }
    }

    /// Displacement of a vertex by the shape at 1, in metres.
    pub(super) fn moved(&self, vertex: &Vertex, eye: &Eye) -> V {
        let Vertex { place, kind, .. } = *vertex;
        match (self.stem, self.side == 0.0) {
            ("jawOpen", _) => scale(opened(place), jaw(kind, place)),
            ("jawForward", _) => scale([0.0, -0.0010, 0.0095], jaw(kind, place)),
            ("jaw", _) => scale([0.0110 * self.side, 0.0, 0.0], jaw(kind, place)),
            ("mouth", _) => aside(vertex, self.side),
            ("mouthClose", _) => closed(kind, place),
            ("mouthFunnel", _) => gathered(vertex, [0.34, 0.0100, 0.0066], 0.0044),
            ("mouthPucker", _) => gathered(vertex, [0.46, 0.0130, 0.0002], 0.0026),
            ("tongueOut", _) => tongue(vertex),
            (_, false) => self.halved(vertex, eye),
            (_, true) => self.whole(vertex),
        }
    }

    /// Displacement of a shape that moves both sides; pushes in the middle count once.
    fn whole(&self, vertex: &Vertex) -> V {
        if !yields(vertex.kind) {
            return [0.0; 3];
        }
        self.pushes.iter().fold([0.0; 3], |moved, push| {
            let own = push.on(vertex, 1.0);
            let other = if push.at[0] > 0.0 { push.on(vertex, -1.0) } else { [0.0; 3] };
            add(moved, add(own, other))
        })
    }

    /// Displacement of a one-sided shape: lids rotate, other parts are pushed. The other side stays, except for lips.
    fn halved(&self, vertex: &Vertex, eye: &Eye) -> V {
        let out = vertex.place[0] * self.side;
        // With left and right both at 1, the middle of the lips moves as far as its neighbours.
        let beyond = if self.stem.starts_with("mouth") { ACROSS } else { 0.0 };
        if out < -beyond || (out <= 0.0 && beyond == 0.0) || !yields(vertex.kind) {
            return [0.0; 3];
        }
        let mut twin = *vertex;
        twin.place[0] = out.abs() * self.side;
        let pushed = self.pushes.iter().fold([0.0; 3], |moved, push| add(moved, push.on(&twin, self.side)));
        let pushed = scale(pushed, if beyond > 0.0 { ramp(-beyond, beyond, out) } else { ramp(0.0, 0.010, out) });
        let Kind::Lid(point) = vertex.kind else { return pushed };
        let turned = sub(eye.lid_place(&point, point.turned(self.lids)), eye.lid_place(&point, point.rest));
        // A lid on the eyeball does not follow the skin's pushes.
        add(scale(pushed, point.share), [turned[0] * self.side, turned[1], turned[2]])
    }
}

/// Whether pushes of the skin move vertices of this kind.
fn yields(kind: Kind) -> bool {
    matches!(kind, Kind::Skin | Kind::Lip(_) | Kind::Brow | Kind::Lid(_))
}

fn lid_motion(stem: &str) -> Motion {
    let still = Motion::default();
    match stem {
        "eyeBlink" => Motion { close: 1.0, ..still },
        "eyeLookDown" => Motion { upper: -12.0, lower: -5.0, ..still },
        "eyeLookUp" => Motion { upper: 10.0, lower: 4.0, ..still },
        "eyeLookIn" => Motion { aside: -4.0, ..still },
        "eyeLookOut" => Motion { aside: 4.0, ..still },
        "eyeSquint" => Motion { upper: -7.0, lower: 11.0, ..still },
        "eyeWide" => Motion { upper: 10.0, lower: -4.0, ..still },
        "cheekSquint" => Motion { lower: 9.0, ..still },
        "browDown" => Motion { upper: -3.0, ..still },
        "noseSneer" => Motion { lower: 4.0, ..still },
        "mouthSmile" => Motion { lower: 3.0, ..still },
        _ => still,
    }
}

impl Push {
    /// Displacement of a vertex by the push, mirrored if `side` is -1.
    fn on(&self, vertex: &Vertex, side: f32) -> V {
        let ([x, y, z], share) = anchor(vertex.kind, vertex.place);
        // The anchor of a vertex behind the lips lies in the left half, so the sign comes from the vertex.
        let x = x.abs() * if vertex.place[0] < 0.0 { -side } else { side };
        let strength = share * self.strength([x, y, z]);
        if strength == 0.0 {
            return [0.0; 3];
        }
        let low = below(vertex.kind, vertex.place);
        let part = match self.part {
            All => 1.0,
            Above => 1.0 - low,
            Below => low,
        };
        let [x, y, z] = scale(self.by, part * strength);
        [x * side, y, z]
    }

    fn strength(&self, p: V) -> f32 {
        let off: f32 = (0..3).map(|i| ((p[i] - self.at[i]) / self.wide[i]).powi(2)).sum();
        // Close to a Gaussian, but exactly 0 at the end.
        (1.0 - off / 4.0).max(0.0).powi(4)
    }
}

/// Displacement of both lips to one side.
fn aside(vertex: &Vertex, side: f32) -> V {
    let (place, share) = match vertex.kind {
        Kind::Lip(_) | Kind::Skin => anchor(vertex.kind, vertex.place),
        _ => return [0.0; 3],
    };
    let place = [place[0].abs() * if vertex.place[0] < 0.0 { -1.0 } else { 1.0 }, place[1], place[2]];
    let push = push(All, [0.006 * side, MOUTH, 0.02], [0.030, 0.019, 0.04], [0.0115 * side, 0.0008, -0.0008]);
    scale(push.by, share * push.strength(place))
}

/// Displacement that draws the lips to the middle: share of the width, forwards, apart (metres at the lips), and how
/// far they turn outwards.
fn gathered(vertex: &Vertex, [narrow, forward, apart]: [f32; 3], full: f32) -> V {
    let (place, share) = match vertex.kind {
        Kind::Lip(_) | Kind::Skin => anchor(vertex.kind, vertex.place),
        _ => return [0.0; 3],
    };
    let reach = push(All, [0.0, MOUTH, 0.02], [0.032, 0.020, 0.04], [0.0; 3]).strength(place);
    let low = below(vertex.kind, vertex.place);
    let away = (place[1] - line(place[0])).abs();
    let rim = ramp(0.016, 0.0, away);
    // The corners stay together.
    let t = (place[0].abs() / WIDE).min(1.0);
    let open = (1.0 - 2.0 * low) * ((1.0 - t * t) * apart * rim + full * ramp(0.0, 0.004, away) * rim);
    let round = 1.0 - 0.35 * t * t;
    scale([-narrow * vertex.place[0], open, forward * round], reach * share)
}

/// Displacement of the tongue out between parted lips, and down.
fn tongue(vertex: &Vertex) -> V {
    let Vertex { place, kind, .. } = *vertex;
    let (along, share) = anchor(kind, place);
    match kind {
        Kind::Tongue(s) => {
            let out = s.powf(1.4);
            [0.08 * place[0] * out, 0.0034 * ramp(0.0, 0.6, s) - 0.0052 * s.powi(6), 0.0405 * out]
        }
        Kind::Skin | Kind::Lip(_) => {
            let low = below(kind, place);
            let near = push(All, [0.0, lips::line(0.0), 0.02], [0.026, 0.017, 0.04], [0.0; 3]).strength(along);
            let (up, down) = (scale([0.0, 0.0028, 0.0006], 1.0 - low), scale([0.0, -0.0085, 0.0008], low));
            scale(add(up, down), near * share)
        }
        Kind::LowerTeeth => [0.0, -0.0062, 0.0],
        _ => [0.0; 3],
    }
}
