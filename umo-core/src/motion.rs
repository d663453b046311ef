//! Codes to poses: VQ decoders, the root network, rotations (SPEC 2.7).

pub mod skeleton;
