//! Reads a character's animation as motion of the 55 joints.

use umo_core_base::memory::{self, with_capacity};
use umo_core_pose::clip::MAX_GESTURE_FRAMES;
use umo_core_pose::rotation::{Quat, normalized, slerp};
use umo_core_pose::skeleton::{JOINTS, Skeleton};

use super::accessor::floats;
use super::document::{Animation, Document};
use super::{Character, Glb, packed};
use crate::retarget::{Floor, Mapping, Retarget};

/// Frame rate of the result, in frames a second.
pub const RATE: f32 = 30.0;
/// Upper bound on the memory, in bytes, for parsing each byte of the JSON: a node `{}` with its comma becomes a
/// structure of some 400 bytes.
const MEMORY: usize = 160;

/// Reads the rotations of an animation, the one named or else the first, of a character in a `.glb` or `.vrm` file,
/// or in a `.gltf` with embedded data. They are resampled at [`RATE`] frames a second.
///
/// Unwinds to [`memory::catch`] if memory is exhausted.
///
/// # Errors
/// The file violates the format, bones were not found, no animation has the name (the error lists them), or the
/// animation is longer than a gesture can be.
pub fn read(bytes: &[u8], name: Option<&str>, skeleton: &Skeleton) -> Result<Vec<[Quat; JOINTS]>, String> {
    let elsewhere = |_: &str| Err("it is in another file, which a load from memory cannot reach".to_owned());
    let bytes = &*packed(bytes, &mut { elsewhere })?;
    memory::require(MEMORY.saturating_mul(Glb::split(bytes)?.json.len()).saturating_add(memory::SPARE));
    let character = Character::read(bytes)?;
    let mapping = match character.vrm_bones()? {
        Some((mapping, _)) => mapping,
        None => Mapping::closest(character.rig()).0,
    };
    mapping.check(character.rig()).map_err(|error| error.to_string())?;
    let retarget =
        Retarget::new(skeleton, character.rig(), &mapping, Floor::AtRest).map_err(|error| error.to_string())?;
    let file = Glb::split(bytes)?;
    let document = character.document();
    let animation = chosen(document, name)?;
    let tracks = tracks(document, animation, file.bin)?;
    let ends = tracks.iter().filter_map(|track| track.times.last());
    let seconds = ends.copied().fold(0.0, f32::max);
    let longest = (MAX_GESTURE_FRAMES - 1) as f32 / RATE;
    if !(seconds > 0.0 && seconds <= longest) {
        return Err(format!("its animation lasts {seconds} s, expected up to {longest:.1} s"));
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most as many as a gesture has")]
    let count = (seconds * RATE).ceil() as usize + 1;
    let rest: Vec<Quat> = character.rig().bones().iter().map(|bone| bone.rotation).collect();
    let (mut scratch, mut rotations) = (retarget.scratch(), rest.clone());
    let mut frames = with_capacity(count);
    for frame in 0..count {
        rotations.copy_from_slice(&rest);
        tracks.iter().for_each(|track| rotations[track.node] = track.at(frame as f32 / RATE));
        frames.push(retarget.joints(&mut scratch, &rotations).map_err(|error| error.to_string())?);
    }
    Ok(frames)
}

fn chosen<'a>(document: &'a Document, name: Option<&str>) -> Result<&'a Animation, String> {
    let Some(name) = name else { return document.animations.first().ok_or_else(|| "it has no animation".to_owned()) };
    let named = |animation: &&Animation| animation.name.as_deref() == Some(name);
    document.animations.iter().find(named).ok_or_else(|| {
        let names: Vec<_> = document.animations.iter().filter_map(|animation| animation.name.as_deref()).collect();
        format!("it has no animation `{name}`; there are {names:?}")
    })
}

/// Rotation keys of a node.
struct Track {
    node: usize,
    /// In seconds, strictly increasing.
    times: Vec<f32>,
    values: Vec<Quat>,
    holds: bool,
}

impl Track {
    fn at(&self, time: f32) -> Quat {
        let after = self.times.partition_point(|&key| key <= time);
        let Some(from) = after.checked_sub(1) else { return self.values[0] };
        match self.times.get(after) {
            Some(&end) if !self.holds => {
                slerp(self.values[from], self.values[after], (time - self.times[from]) / (end - self.times[from]))
            }
            _ => self.values[from],
        }
    }
}

fn tracks(document: &Document, animation: &Animation, bin: &[u8]) -> Result<Vec<Track>, String> {
    let mut tracks = Vec::new();
    for channel in animation.channels.iter().filter(|channel| channel.target.path == "rotation") {
        let Some(node) = channel.target.node else { continue };
        let wrong = |problem: &str| format!("the rotation of node {node}: {problem}");
        if node >= document.nodes.len() {
            return Err(wrong("there is no such node"));
        }
        let sampler = animation.samplers.get(channel.sampler).ok_or_else(|| wrong("it has no sampler"))?;
        let times = floats(document, bin, sampler.input, "SCALAR")?;
        let values = floats(document, bin, sampler.output, "VEC4")?;
        let mut values: Vec<Quat> = memory::collected(values.as_chunks().0.iter().map(|&q| normalized(q)));
        if sampler.interpolation.as_deref() == Some("CUBICSPLINE") {
            // A cubic spline key has two tangents beside its value. They are ignored, and the keys joined by arcs.
            values = memory::collected(values.chunks_exact(3).map(|key| key[1]));
        }
        if times.is_empty() || times.len() != values.len() || !times.windows(2).all(|pair| pair[0] < pair[1]) {
            return Err(wrong("its times do not increase, or are not one per value"));
        }
        tracks.push(Track { node, times, values, holds: sampler.interpolation.as_deref() == Some("STEP") });
    }
    match tracks.is_empty() {
        true => Err("its animation rotates no joint".to_owned()),
        false => Ok(tracks),
    }
}

#[cfg(test)]
mod tests {
    use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat};

    use super::*;

    #[test]
    fn keys_are_joined_by_arcs_or_held() {
        let (a, b) = (IDENTITY, axis_angle_to_quat([0.0, 1.0, 0.0]));
        let mut track = Track { node: 0, times: vec![1.0, 2.0], values: vec![a, b], holds: false };
        assert_eq!((track.at(0.0), track.at(1.0), track.at(2.0), track.at(9.0)), (a, a, b, b));
        let middle = axis_angle_to_quat([0.0, 0.5, 0.0]);
        assert!(track.at(1.5).iter().zip(middle).all(|(x, y)| (x - y).abs() < 1e-6));
        track.holds = true;
        assert_eq!((track.at(1.9), track.at(2.0)), (a, b));
    }
}
