//! Poses in other axes and units: up axis, handedness and unit of length.
//!
//! umo uses glTF's: Y up, right-handed, metres. The avatar faces +Z, and its left hand points towards +X.

use super::rotation::Quat;

/// A convention for positions and rotations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// glTF, Godot, Blender's importers, umo: Y up, right-handed, metres.
    #[default]
    Gltf,
    /// Unreal: Z up, left-handed, centimetres; forward is +X, the avatar's right hand is towards +Y.
    Unreal,
    /// Unity: Y up, left-handed, metres; forward is +Z, the avatar's right hand is towards +X.
    Unity,
}

impl Axes {
    /// Converts a position or an offset to this convention.
    #[must_use]
    pub fn place(self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        match self {
            Self::Gltf => [x, y, z],
            Self::Unreal => [100.0 * z, -100.0 * x, 100.0 * y],
            Self::Unity => [-x, y, z],
        }
    }

    /// Converts a position in this convention to umo's.
    #[must_use]
    pub fn place_from(self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        match self {
            Self::Gltf => [x, y, z],
            Self::Unreal => [-y / 100.0, z / 100.0, x / 100.0],
            Self::Unity => [-x, y, z],
        }
    }

    /// Converts a rotation, a quaternion x, y, z, w, to this convention. If the handedness differs, the axis
    /// changes sign, so that the result is the same physical rotation.
    #[must_use]
    pub fn rotation(self, [x, y, z, w]: Quat) -> Quat {
        match self {
            Self::Gltf => [x, y, z, w],
            Self::Unreal => [-z, x, -y, w],
            Self::Unity => [x, -y, -z, w],
        }
    }

    /// Converts a rotation in this convention to umo's.
    #[must_use]
    pub fn rotation_from(self, [x, y, z, w]: Quat) -> Quat {
        match self {
            Self::Gltf => [x, y, z, w],
            Self::Unreal => [y, -z, -x, w],
            Self::Unity => [x, -y, -z, w],
        }
    }

    /// Number of units of length in a metre.
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

    /// Derived by hand: the position is 1 m to the avatar's left, 2 m up, 3 m ahead.
    #[test]
    fn places_are_where_each_engine_has_them() {
        assert_eq!(Axes::Gltf.place([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        // Forward is X, right is Y, up is Z, in centimetres.
        assert_eq!(Axes::Unreal.place([1.0, 2.0, 3.0]), [300.0, -100.0, 200.0]);
        // Right is X, up is Y, forward is Z.
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

    /// Derived by hand: the head turns a quarter to the avatar's left. By the right-hand rule about Y (up)
    /// that is +90 degrees. In both left-handed engines, a turn to the left about the up axis is -90 degrees.
    #[test]
    fn a_look_to_the_left_is_one_in_every_engine() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let left = [0.0, half, 0.0, half];
        assert_eq!(Axes::Gltf.rotation(left), left);
        assert_eq!(Axes::Unreal.rotation(left), [0.0, 0.0, -half, half]);
        assert_eq!(Axes::Unity.rotation(left), [0.0, -half, 0.0, half]);
    }

    proptest! {
        /// Rotating and converting commute, if the engine's quaternion formula is the same in its own axes.
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
