//! Poses in the axes and units of others: which way is up, which hand, how long a unit is.
//!
//! umo's own are those of glTF: Y up, right-handed, metres; the avatar looks along +Z, its left
//! hand is towards +X.

use super::rotation::Quat;

/// A convention for places and rotations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// glTF, Godot, Blender's importers, umo itself: Y up, right-handed, metres.
    #[default]
    Gltf,
    /// Unreal: Z up, left-handed, centimetres; forwards +X, the avatar's right hand towards +Y.
    Unreal,
    /// Unity: Y up, left-handed, metres; forwards +Z, the avatar's right hand towards +X.
    Unity,
}

impl Axes {
    /// A place or an offset.
    #[must_use]
    pub fn place(self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        match self {
            Self::Gltf => [x, y, z],
            Self::Unreal => [100.0 * z, -100.0 * x, 100.0 * y],
            Self::Unity => [-x, y, z],
        }
    }

    /// The place in umo's own axes of one in these.
    #[must_use]
    pub fn place_from(self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        match self {
            Self::Gltf => [x, y, z],
            Self::Unreal => [-y / 100.0, z / 100.0, x / 100.0],
            Self::Unity => [-x, y, z],
        }
    }

    /// A rotation, as a quaternion x, y, z, w. An axis of rotation changes its sign where the hand
    /// changes, so that the same turn is meant.
    #[must_use]
    pub fn rotation(self, [x, y, z, w]: Quat) -> Quat {
        match self {
            Self::Gltf => [x, y, z, w],
            Self::Unreal => [-z, x, -y, w],
            Self::Unity => [x, -y, -z, w],
        }
    }

    /// The rotation in umo's own axes of one in these.
    #[must_use]
    pub fn rotation_from(self, [x, y, z, w]: Quat) -> Quat {
        match self {
            Self::Gltf => [x, y, z, w],
            Self::Unreal => [y, -z, -x, w],
            Self::Unity => [x, -y, -z, w],
        }
    }

    /// Units of length in a metre.
    #[must_use]
    pub const fn units_per_metre(self) -> f32 {
        match self {
            Self::Gltf | Self::Unity => 1.0,
            Self::Unreal => 100.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::rotation::{axis_angle_to_quat, product, rotate};
    use super::*;
    use proptest::prelude::*;

    const ALL: [Axes; 3] = [Axes::Gltf, Axes::Unreal, Axes::Unity];

    /// Worked out by hand: the avatar stands 1 m to its left, 2 m up, 3 m ahead.
    #[test]
    fn places_are_where_each_engine_has_them() {
        assert_eq!(Axes::Gltf.place([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        // Forwards is X, right is Y, up is Z, centimetres.
        assert_eq!(Axes::Unreal.place([1.0, 2.0, 3.0]), [300.0, -100.0, 200.0]);
        // Right is X, up is Y, forwards is Z.
        assert_eq!(Axes::Unity.place([1.0, 2.0, 3.0]), [-1.0, 2.0, 3.0]);
    }

    #[test]
    fn places_and_rotations_come_back() {
        for axes in ALL {
            let turn = [0.1, 0.2, 0.3, 0.9];
            assert_eq!(axes.rotation_from(axes.rotation(turn)), turn);
            let place = axes.place_from(axes.place([1.0, 2.0, 3.0]));
            assert!(place.iter().zip([1.0, 2.0, 3.0]).all(|(got, want)| (got - want).abs() < 1e-6), "{place:?}");
        }
    }

    /// Worked out by hand: the head turns a quarter to the avatar's left. By the right-hand rule
    /// about Y (up) that is +90 degrees; in both left-handed engines a turn to the left about the
    /// axis that points up is -90 degrees.
    #[test]
    fn a_look_to_the_left_is_one_in_every_engine() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let left = [0.0, half, 0.0, half];
        assert_eq!(Axes::Gltf.rotation(left), left);
        assert_eq!(Axes::Unreal.rotation(left), [0.0, 0.0, -half, half]);
        assert_eq!(Axes::Unity.rotation(left), [0.0, -half, 0.0, half]);
    }

    proptest! {
        /// Turning and then converting is converting and then turning, where the engine's own rule
        /// for quaternions is the same formula in its axes.
        #[test]
        fn rotations_and_places_belong_together(
            axis in proptest::array::uniform3(-3.0_f32..3.0),
            other in proptest::array::uniform3(-3.0_f32..3.0),
            v in proptest::array::uniform3(-1.0_f32..1.0),
        ) {
            let (q, p) = (axis_angle_to_quat(axis), axis_angle_to_quat(other));
            for axes in ALL {
                let near = |a: &[f32], b: &[f32], unit: f32| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 4e-6 * unit);
                let turned = axes.place(rotate(q, v));
                prop_assert!(near(&turned, &rotate(axes.rotation(q), axes.place(v)), axes.units_per_metre()));
                let both = product(axes.rotation(q), axes.rotation(p));
                prop_assert!(near(&axes.rotation(product(q, p)), &both, 1.0) || near(&axes.rotation(product(q, p)), &both.map(|x| -x), 1.0));
            }
        }
    }
}
