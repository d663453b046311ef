//! Exports umo's animations as binary glTF 2.0.
//!
//! [`glb::write`] writes the skeleton's animation, with a figure and its face or with the bones alone,
//! [`glb::write_room`] those of several characters at their places; [`vrma::write`] writes it for VRM avatars;
//! [`avatar::write`] writes a figure alone, for animation by other programs.
//!
//! | module | contents |
//! |---|---|
//! | [`glb`] | `.glb`: skeleton, skin, meshes, face shapes and their animation |
//! | [`avatar`] | `.glb` and `.vrm`: export of a figure as an avatar |
//! | [`vrma`] | `.vrma`: the animation alone, VRM Animation 1.0 |
//! | [`vrm`] | names of VRM's bones and expressions |
//! | [`keys`] | fewer keys that hold a motion within a bound, and markers |
//! | `builder` | the binary buffer and the objects that reference it |
//! | `tracks` | rotations, translations and weights over time |
//! | `shapes` | the figure's shape for each face channel |
#![forbid(unsafe_code)]

pub mod avatar;
mod builder;
pub mod glb;
pub mod keys;
mod shapes;
#[cfg(test)]
mod tests;
mod tracks;
pub mod vrm;
pub mod vrma;
