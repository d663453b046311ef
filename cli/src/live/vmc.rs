//! Poses as messages of the VMC protocol 2.7 (protocol.vmc.info), for VRM avatars: bones under Unity's names in Unity's
//! axes, the face as ARKit's blendshapes ("perfect sync") and as VRM's vowels and blinks.

use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};
use umo_core::{Config, FaceKind, FaceMap, JOINTS, Pose};
use umo_core_pose::rotation::{Quat, inverse, product, rotate};
use umo_gltf::vrm::{EXPRESSIONS, UNITY_BONES, standing_height, t_pose};

use crate::failure::Failure;

/// Size of a datagram that no network fragments, bytes.
const MAX_BYTES: usize = 1400;

/// Builder of pose datagrams.
pub(super) struct Sender {
    /// Each joint's parent; negative for the root.
    parents: Vec<i32>,
    /// Each joint's offset from its parent in the rest pose.
    offsets: Vec<[f32; 3]>,
    /// Each joint's rotation from the rest pose to VRM's T-pose, where an avatar's bones have no rotation.
    t_pose: [Quat; JOINTS],
    /// Size of the avatar relative to the model's skeleton.
    scale: f32,
    /// Names of the face's channels, if they are ARKit's.
    channels: Vec<String>,
    vowels: Option<FaceMap>,
}

impl Sender {
    /// For an avatar with hips `hips` metres above the floor; default: the model's height.
    pub(super) fn new(config: &Config, hips: Option<f32>) -> Result<Self, Failure> {
        let offsets = config.skeleton.offsets_m.clone();
        let own = standing_height(&offsets);
        let scale = hips.map_or(1.0, |hips| hips / own);
        if !(0.05..=20.0).contains(&scale) {
            return Err(Failure::input(format!("--hips: expected metres above the floor, as {own:.2}")));
        }
        let is_arkit = config.face.kind == FaceKind::Arkit;
        let channels = if is_arkit { config.face.names.clone() } else { Vec::new() };
        let vowels = is_arkit.then(|| FaceMap::new(&config.face, &EXPRESSIONS.map(|(known, _)| known)));
        let parents = config.skeleton.parents.clone();
        Ok(Self { parents, t_pose: t_pose(&offsets), offsets, scale, channels, vowels })
    }

    /// Returns the datagrams of a pose shown at `seconds`.
    pub(super) fn packets(&self, pose: &Pose, face: &[f32], seconds: f64) -> Result<Vec<Vec<u8>>, Failure> {
        let messages = self.messages(pose, face, seconds);
        let mut packets = Vec::new();
        let mut bundle = Vec::new();
        let mut bytes = 16;
        for message in messages {
            let packet = OscPacket::Message(message);
            let length = 4 + encode(&packet)?.len();
            if bytes + length > MAX_BYTES {
                packets.push(encode(&bundled(std::mem::take(&mut bundle)))?);
                bytes = 16;
            }
            bytes += length;
            bundle.push(packet);
        }
        packets.push(encode(&bundled(bundle))?);
        Ok(packets)
    }

    fn messages(&self, pose: &Pose, face: &[f32], seconds: f64) -> Vec<OscMessage> {
        let mut out = Vec::with_capacity(JOINTS + face.len() + EXPRESSIONS.len() + 4);
        let mut say = |addr: &str, args: Vec<OscType>| out.push(OscMessage { addr: addr.to_owned(), args });
        // Loaded, calibrated, normal mode, tracking.
        say("/VMC/Ext/OK", [1, 3, 0, 1].map(OscType::Int).to_vec());
        #[expect(clippy::cast_possible_truncation, reason = "the protocol's time is a float")]
        say("/VMC/Ext/T", vec![OscType::Float(seconds as f32)]);
        say("/VMC/Ext/Root/Pos", place("root", [0.0; 3], [0.0, 0.0, 0.0, 1.0]));
        for (joint, name) in UNITY_BONES.iter().enumerate() {
            let (at, turn) = self.relative_to_t_pose(pose, joint);
            say("/VMC/Ext/Bone/Pos", place(name, at.map(|x| x * self.scale), turn));
        }
        let mut value = |name: &str, value: f32| {
            say("/VMC/Ext/Blend/Val", vec![OscType::String(name.to_owned()), OscType::Float(value.clamp(0.0, 1.0))]);
        };
        for (name, &weight) in self.channels.iter().zip(face) {
            value(name, weight);
        }
        if let Some(map) = &self.vowels {
            let mut weights = [0.0; EXPRESSIONS.len()];
            map.apply(face, &mut weights);
            for ((_, name), weight) in EXPRESSIONS.iter().zip(weights) {
                value(name, weight);
            }
        }
        say("/VMC/Ext/Blend/Apply", Vec::new());
        out
    }

    /// Returns the position and rotation of a joint relative to its parent, for bones that have no rotation in the T-pose.
    fn relative_to_t_pose(&self, pose: &Pose, joint: usize) -> ([f32; 3], Quat) {
        let offset = self.offsets[joint];
        let Ok(parent) = usize::try_from(self.parents[joint]) else {
            let at = std::array::from_fn(|axis| offset[axis] + pose.translation[axis]);
            return (at, product(pose.rotations[joint], inverse(self.t_pose[joint])));
        };
        let above = self.t_pose[parent];
        (rotate(above, offset), product(product(above, pose.rotations[joint]), inverse(self.t_pose[joint])))
    }
}

/// Returns the arguments of a bone or root message: position in metres, then rotation, relative to the parent.
///
/// The model's axes are right-handed with X to the body's left, Unity's left-handed with X to its right.
fn place(name: &str, [x, y, z]: [f32; 3], [qx, qy, qz, qw]: [f32; 4]) -> Vec<OscType> {
    let numbers = [-x, y, z, qx, -qy, -qz, qw].map(OscType::Float);
    std::iter::once(OscType::String(name.to_owned())).chain(numbers).collect()
}

fn bundled(content: Vec<OscPacket>) -> OscPacket {
    // The time tag that means "immediately".
    OscPacket::Bundle(OscBundle { timetag: OscTime { seconds: 0, fractional: 1 }, content })
}

fn encode(packet: &OscPacket) -> Result<Vec<u8>, Failure> {
    encoder::encode(packet).map_err(|error| Failure::environment(format!("internal: {error}")))
}

#[cfg(test)]
mod tests;
