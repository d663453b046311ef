//! Helper joints: parts of a joint's turn.
//!
//! Skin that follows two joints by shares shrinks where they are turned far from each other, most
//! of all where one is twisted against the other. Helper joints take a share of the turn, so that
//! what is between the two follows a joint between them.

use super::rest::{Rest, joint};
use super::vector::{V, hypot, sub, unit};
use umo_core::motion::rotation::{IDENTITY, Quat, inverse, normalized, product, slerp};
use umo_core::motion::skeleton::JOINTS;

/// A joint at another one's place that takes shares of its turn: of the swing of the bone, and of
/// the twist about it. Helper `i` of [`Mesh::helpers`](crate::Mesh::helpers) has the number 55 + i.
#[derive(Clone, Debug, PartialEq)]
pub struct Helper {
    /// `left_elbow_half`, for example.
    pub name: String,
    /// The joint whose turn it takes shares of, and at whose place it is.
    pub of: usize,
    /// The joint that it hangs on in files: `of`, or the parent of `of`. Where nothing turns the
    /// helper, its skin follows that joint.
    pub hangs_on: usize,
    /// Along the bone that twists, of unit length.
    pub axis: [f32; 3],
    /// Share of the swing, 0..=1.
    pub swing: f32,
    /// Share of the twist, 0..=1.
    pub twist: f32,
}

/// Of a helper on each side: its name; the joint; the bone that twists, from joint to joint;
/// shares of swing and twist.
type Row = (&'static str, &'static str, [&'static str; 2], f32, f32);

const TABLE: [Row; 9] = [
    ("shoulder_half", "shoulder", ["shoulder", "elbow"], 0.5, 0.0),
    ("shoulder_swing", "shoulder", ["shoulder", "elbow"], 1.0, 0.0),
    ("shoulder_twist", "shoulder", ["shoulder", "elbow"], 1.0, 0.5),
    ("elbow_half", "elbow", ["elbow", "wrist"], 0.5, 0.0),
    ("elbow_swing", "elbow", ["elbow", "wrist"], 1.0, 0.0),
    ("elbow_twist", "elbow", ["elbow", "wrist"], 1.0, 0.5),
    ("wrist_twist", "wrist", ["elbow", "wrist"], 0.0, 0.8),
    ("hip_half", "hip", ["hip", "knee"], 0.5, 0.0),
    ("knee_half", "knee", ["knee", "ankle"], 0.5, 0.0),
];
const SIDES: [&str; 2] = ["left", "right"];

/// The number of the helper joint of that name.
pub(super) fn number(name: &str) -> Option<usize> {
    let (side, rest) = name.split_once('_')?;
    let side = SIDES.iter().position(|&known| known == side)?;
    let row = TABLE.iter().position(|row| row.0 == rest)?;
    Some(JOINTS + side * TABLE.len() + row)
}

/// All of them, in the order of their numbers.
pub(super) fn all(rest: &Rest) -> Vec<Helper> {
    let helper = |side: &str, &(name, of, [from, to], swing, twist): &Row| {
        let along = sub(rest.side(side, to), rest.side(side, from));
        let hangs_on = if swing > 0.0 { of } else { from };
        Helper {
            name: format!("{side}_{name}"),
            of: joint(&format!("{side}_{of}")),
            hangs_on: joint(&format!("{side}_{hangs_on}")),
            axis: direction(along),
            swing,
            twist,
        }
    };
    SIDES.iter().flat_map(|side| TABLE.iter().map(move |row| helper(side, row))).collect()
}

/// A bone without length twists about X.
fn direction(along: V) -> V {
    if along.iter().any(|x| x.abs() > 1e-6) { unit(along) } else { [1.0, 0.0, 0.0] }
}

impl Helper {
    /// The helper's turn where its joint's is `turn`, both in the frame of the joint's parent.
    #[must_use]
    pub fn turn(&self, turn: Quat) -> Quat {
        let [x, y, z, w] = if turn[3] < 0.0 { turn.map(|value| -value) } else { turn };
        let along = x * self.axis[0] + y * self.axis[1] + z * self.axis[2];
        let size = hypot(along, w);
        let [ax, ay, az] = self.axis.map(|axis| axis * along / size);
        // Half a turn across the bone has no twist of its own.
        let twist = if size > 1e-6 { [ax, ay, az, w / size] } else { IDENTITY };
        let swing = product([x, y, z, w], inverse(twist));
        normalized(product(slerp(IDENTITY, swing, self.swing), slerp(IDENTITY, twist, self.twist)))
    }

    /// The helper's turn as files have it: in the frame of the joint that it hangs on.
    #[must_use]
    pub fn local_turn(&self, turn: Quat) -> Quat {
        let target = self.turn(turn);
        if self.hangs_on == self.of { normalized(product(inverse(turn), target)) } else { target }
    }

    /// Whether it is at the place of the joint that it hangs on.
    #[must_use]
    pub fn is_in_place(&self) -> bool {
        self.hangs_on == self.of
    }
}
