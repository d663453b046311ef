//! Helper joints, which take a share of a joint's rotation.
//!
//! Skin that blends two joints shrinks when they are rotated far from each other, most of all when one is twisted
//! against the other. Helper joints take a share of the rotation, so the skin in between follows an intermediate
//! joint.

use super::rest::{Rest, joint};
use super::vector::{V, hypot, sub, unit};
use umo_core_pose::rotation::{IDENTITY, Quat, inverse, normalized, product, slerp};
use umo_core_pose::skeleton::JOINTS;

/// A joint at the position of another one that takes shares of its rotation: of the bone's swing, and of the twist
/// about it. Helper `i` of [`Mesh::helpers`](crate::Mesh::helpers) has the joint index 55 + i.
#[derive(Clone, Debug, PartialEq)]
pub struct Helper {
    /// Name, for example `left_elbow_half`.
    pub name: String,
    /// The joint whose rotation it shares and at whose position it is.
    pub of: usize,
    /// The parent joint in files: `of`, or the parent of `of`. If nothing rotates the helper, its skin follows that
    /// joint.
    pub hangs_on: usize,
    /// Axis of the twisting bone, of unit length.
    pub axis: [f32; 3],
    /// Share of the swing, 0..=1.
    pub swing: f32,
    /// Share of the twist, 0..=1.
    pub twist: f32,
}

/// A helper of each side: its name; the joint; the twisting bone, from joint to joint; shares of swing and twist.
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

/// Index of the helper joint of that name.
pub(super) fn number(name: &str) -> Option<usize> {
    let (side, rest) = name.split_once('_')?;
    let side = SIDES.iter().position(|&known| known == side)?;
    let row = TABLE.iter().position(|row| row.0 == rest)?;
    Some(JOINTS + side * TABLE.len() + row)
}

/// All helpers, in the order of their indices.
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

/// Direction of a bone; X if it has no length.
fn direction(along: V) -> V {
    if along.iter().any(|x| x.abs() > 1e-6) { unit(along) } else { [1.0, 0.0, 0.0] }
}

impl Helper {
    /// Returns the helper's rotation if its joint's is `turn`, both in the frame of the joint's parent.
    #[must_use]
    pub fn turn(&self, turn: Quat) -> Quat {
        let [x, y, z, w] = if turn[3] < 0.0 { turn.map(|value| -value) } else { turn };
        let along = x * self.axis[0] + y * self.axis[1] + z * self.axis[2];
        let size = hypot(along, w);
        let [ax, ay, az] = self.axis.map(|axis| axis * along / size);
        // A half turn across the bone has no defined twist.
        let twist = if size > 1e-6 { [ax, ay, az, w / size] } else { IDENTITY };
        let swing = product([x, y, z, w], inverse(twist));
        normalized(product(slerp(IDENTITY, swing, self.swing), slerp(IDENTITY, twist, self.twist)))
    }

    /// Returns the helper's rotation as stored in files, in the frame of the joint that it hangs on.
    #[must_use]
    pub fn local_turn(&self, turn: Quat) -> Quat {
        let target = self.turn(turn);
        if self.hangs_on == self.of { normalized(product(inverse(turn), target)) } else { target }
    }

    /// Whether it is at the position of the joint that it hangs on.
    #[must_use]
    pub fn is_in_place(&self) -> bool {
        self.hangs_on == self.of
    }
}
