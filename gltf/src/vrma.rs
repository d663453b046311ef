//! `.vrma`: VRM Animation 1.0 (`VRMC_vrm_animation`), for any VRM avatar: the bones of VRM's humanoid, the face as
//! VRM's vowels and blinks, brows and cheeks as ARKit's shapes, and the gaze.

use std::io::{self, Write};

use gltf_json as json;
use json::{Index, Node};
use serde_json::{Map, Value, json};
use umo_core_base::memory::{collected, with_capacity};
use umo_core_pose::clip::Clip;
use umo_core_pose::face::FaceKind;
use umo_core_pose::rotation::{Quat, inverse, normalized, product};
use umo_core_pose::skeleton::JOINTS;
use umo_core_rig::retarget::face::FaceMap;

use crate::builder::{self, Builder};
use crate::keys::Keying;
use crate::tracks::{Tracks, track};
use crate::vrm::{EXPRESSIONS, bone, standing_height, t_pose};

const JAW: usize = 22;
const EYES: [usize; 2] = [23, 24];

/// Name prefixes of channels that VRM's vowels, blinks and gaze already cover: with both, an avatar would open its
/// mouth twice.
const SAID: [&str; 5] = ["jaw", "mouth", "tongue", "eyeBlink", "eyeLook"];

/// Writes the animation for VRM avatars.
///
/// # Errors
/// The animation is inconsistent ([`Clip::check`]) or exceeds glTF's 4 GiB, or writing to `out` fails.
pub fn write<W: Write>(clip: &Clip, out: W) -> io::Result<()> {
    write_keyed(clip, None, out)
}

/// [`write()`], with as few keys as a [`Keying`] allows, and its markers.
///
/// # Errors
/// As for [`write()`].
pub fn write_keyed<W: Write>(clip: &Clip, keying: Option<&Keying>, out: W) -> io::Result<()> {
    clip.check().map_err(|what| io::Error::new(io::ErrorKind::InvalidInput, what))?;
    let mut builder = Builder::default();
    let mut tracks = Tracks::new(&mut builder, clip, keying.map(|keying| keying.bound));
    let joints = add_bones(&mut builder, clip);
    let bones: Map<String, Value> = (0..JOINTS)
        .filter(|joint| !EYES.contains(joint))
        // With ARKit's channels, the vowels open the mouth.
        .filter(|&joint| joint != JAW || clip.face.kind == FaceKind::SmplxExpression)
        .map(|joint| (bone(joint), json!({ "node": joints[joint].value() })))
        .collect();
    for joint in (0..JOINTS).filter(|joint| bones.contains_key(&bone(*joint))) {
        tracks.rotations(&mut builder, joints[joint], track(clip, joint));
    }
    let places = collected((0..clip.rotations.len()).map(|frame| clip.root_position(frame)));
    tracks.places(&mut builder, joints[0], places);

    let mut roots = vec![joints[0]];
    let mut add = |builder: &mut Builder, name: &str, values: Vec<f32>| -> Value {
        let node = builder.root.push(Node { name: Some(name.to_owned()), ..Node::default() });
        let rows = collected(values.iter().map(|&weight| [weight.clamp(0.0, 1.0), 0.0, 0.0]));
        tracks.places(builder, node, rows);
        roots.push(node);
        json!({ "node": node.value() })
    };
    let (mut preset, mut custom) = (Map::new(), Map::new());
    for (name, values) in presets(clip) {
        let node = add(&mut builder, name, values);
        preset.insert(name.to_owned(), node);
    }
    for (name, values) in shapes(clip) {
        let node = add(&mut builder, name, values);
        custom.insert(name.to_owned(), node);
    }

    let gaze = builder.root.push(Node { name: Some("gaze".to_owned()), ..Node::default() });
    tracks.rotations(&mut builder, gaze, gaze_of(clip));
    roots.push(gaze);
    let eyes = EYES.map(|joint| clip.skeleton.offsets_m[joint]);
    let from_head: [f32; 3] = std::array::from_fn(|axis| f32::midpoint(eyes[0][axis], eyes[1][axis]));

    builder.root.push(tracks.animation);
    builder.scene(roots);
    if let Some(keying) = keying {
        builder.mark(keying);
    }
    let mut extension = json!({
        "specVersion": "1.0",
        "humanoid": { "humanBones": bones },
        "lookAt": { "node": gaze.value(), "offsetFromHeadBone": from_head },
    });
    if !preset.is_empty() {
        extension["expressions"] = json!({ "preset": preset, "custom": custom });
    }
    builder.extension("VRMC_vrm_animation", extension);
    builder.write(out)
}

/// Adds one node per joint, in VRM's T-pose. The alignment of a limb with its axis is part of the rest pose, so the
/// animation's rotations need no correction. `[55]`
fn add_bones(builder: &mut Builder, clip: &Clip) -> Vec<Index<Node>> {
    let world = t_pose(&clip.skeleton.offsets_m);
    (0..JOINTS)
        .map(|joint| {
            let below: Vec<_> = clip.children(joint).map(builder::index).collect();
            let mut offset = clip.skeleton.offsets_m[joint];
            let mut turn = world[joint];
            match clip.parent(joint) {
                Some(parent) => turn = product(inverse(world[parent]), turn),
                None => offset[1] = standing_height(&clip.skeleton.offsets_m),
            }
            builder.root.push(Node {
                name: Some(bone(joint)),
                translation: Some(offset),
                rotation: Some(json::scene::UnitQuaternion(turn)),
                children: (!below.is_empty()).then_some(below),
                ..Node::default()
            })
        })
        .collect()
}

/// VRM's preset expressions and their weights over time; empty for faces that are not ARKit's.
fn presets(clip: &Clip) -> Vec<(&'static str, Vec<f32>)> {
    if clip.face.kind != FaceKind::Arkit {
        return Vec::new();
    }
    let names = EXPRESSIONS.map(|(name, _)| name);
    let map = FaceMap::new(&clip.face, &names);
    let mut weights = [0.0; EXPRESSIONS.len()];
    let mut all = collected(names.iter().map(|_| with_capacity(clip.rotations.len())));
    for frame in 0..clip.rotations.len() {
        map.apply(clip.face(frame), &mut weights);
        all.iter_mut().zip(&weights).for_each(|(values, &weight)| values.push(weight));
    }
    names.into_iter().zip(all).collect()
}

/// Channels without a VRM expression, under ARKit's names.
fn shapes(clip: &Clip) -> impl Iterator<Item = (&str, Vec<f32>)> {
    let names = if clip.face.kind == FaceKind::Arkit { clip.face.names.as_slice() } else { &[] };
    let others = names.iter().enumerate().filter(|(_, name)| !SAID.iter().any(|said| name.starts_with(said)));
    others.map(|(channel, name)| {
        let values = (0..clip.rotations.len()).map(|frame| clip.face(frame)[channel]);
        (name.as_str(), collected(values))
    })
}

/// Gaze relative to the head: the mean of both eyes. `[frames]`
fn gaze_of(clip: &Clip) -> Vec<Quat> {
    let [left, right] = EYES.map(|joint| track(clip, joint));
    let both = left.into_iter().zip(right).map(|(left, right)| {
        let dot: f32 = left.iter().zip(right).map(|(a, b)| a * b).sum();
        let sum: Quat = std::array::from_fn(|i| left[i] + if dot < 0.0 { -right[i] } else { right[i] });
        normalized(sum)
    });
    collected(both)
}
