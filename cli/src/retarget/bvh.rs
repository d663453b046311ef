//! A skeleton in a `.bvh` file, and the animation on it: the file's original hierarchy with new frames.

use std::fmt::Write;

use umo_core::{Bone, Retarget, Rig};

use super::Motion;
use crate::bvh::{Bvh, Channel, Joint};
use crate::export::bvh::continued;
use crate::export::rotation;

/// A `.bvh` file whose skeleton is to be moved.
pub(super) struct Target {
    text: String,
    bvh: Bvh,
    rig: Rig,
}

impl Target {
    /// Reads a `.bvh` file.
    ///
    /// # Errors
    /// A description of the first violation of the format.
    pub(super) fn read(bytes: Vec<u8>) -> Result<Self, String> {
        let text = String::from_utf8(bytes).map_err(|_| "it is not UTF-8")?;
        let bvh = Bvh::parse(&text)?;
        let mut bones: Vec<_> =
            bvh.joints.iter().map(|joint| Bone::new(joint.name.clone(), joint.parent, joint.offset)).collect();
        // Bone ends count as bones without names: they show the direction of a limb's last bone.
        for (at, joint) in bvh.joints.iter().enumerate() {
            bones.extend(joint.end.map(|end| Bone::new("", Some(at), end)));
        }
        let rig = Rig::new(bones).map_err(|error| error.to_string())?;
        Ok(Self { text, bvh, rig })
    }

    pub(super) fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Returns the file with `motion` in place of its original frames.
    ///
    /// # Errors
    /// If a driven joint lacks three rotation channels, or the hips lack three position channels.
    pub(super) fn animated(&self, retarget: &Retarget, motion: &Motion) -> Result<Vec<u8>, String> {
        let joints = &self.bvh.joints;
        for (at, joint) in joints.iter().enumerate().filter(|(at, _)| retarget.is_driven(*at)) {
            if axes(joint).is_none() {
                return Err(format!("joint `{}`: expected three rotation channels about different axes", joint.name));
            }
            if at == retarget.hips() && places(joint) < 3 {
                return Err(format!("joint `{}` carries the body: expected three position channels", joint.name));
            }
        }
        let mut out = self.text[..self.bvh.hierarchy].to_owned();
        // Writing to a `String` cannot fail.
        let _ = write!(
            out,
            "MOTION\nFrames: {}\nFrame Time: {:.9}\n",
            motion.hips.len(),
            1.0 / f64::from(motion.frame_rate)
        );
        let replaces = self.bvh.replaces();
        // Values of the position channels that place a joint at a position in its parent's frame.
        let channels = |at: usize, place: [f64; 3]| match replaces[at] {
            true => place,
            false => std::array::from_fn(|i| place[i] - f64::from(joints[at].offset[i])),
        };
        let still: Vec<_> = (0..joints.len()).map(|at| channels(at, joints[at].offset.map(f64::from))).collect();
        let mut before = vec![[0.0; 3]; joints.len()];
        for (rotations, hips) in motion.rotations.iter().zip(&motion.hips) {
            let mut line = Vec::with_capacity(self.bvh.channels());
            for (at, joint) in joints.iter().enumerate() {
                let place = match at == retarget.hips() {
                    true => channels(at, hips.map(f64::from)),
                    false => still[at],
                };
                if let Some(axes) = axes(joint) {
                    let angles = rotation::euler(&rotation::matrix(rotations[at]), axes).map(f64::to_degrees);
                    before[at] = continued(angles, before[at]);
                }
                let mut turns = before[at].into_iter();
                line.extend(joint.channels.iter().map(|channel| match channel {
                    Channel::Position(axis) => place[*axis],
                    Channel::Rotation(_) => turns.next().unwrap_or(0.0),
                }));
            }
            for (at, value) in line.iter().enumerate() {
                let _ = write!(out, "{}{value:.6}", if at == 0 { "" } else { " " });
            }
            out.push('\n');
        }
        Ok(out.into_bytes())
    }
}

/// Returns the axes of a joint's rotation channels, if there are exactly three.
fn axes(joint: &Joint) -> Option<[usize; 3]> {
    let turns = joint.channels.iter().filter_map(|channel| match channel {
        Channel::Rotation(axis) => Some(*axis),
        Channel::Position(_) => None,
    });
    turns.collect::<Vec<_>>().try_into().ok()
}

/// Returns the number of a joint's position channels.
fn places(joint: &Joint) -> usize {
    joint.channels.iter().filter(|channel| matches!(channel, Channel::Position(_))).count()
}
