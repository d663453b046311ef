//! Reader of `.bvh` files written by `umo`: the 55 joints by name, centimetres.

use umo_core::{Quat, Skeleton};
use umo_core_pose::clip::Clip;
use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat, product};

use crate::bvh::{Bvh, Channel, Joint};

const METRES: f64 = 0.01;

pub(super) fn read(bytes: &[u8]) -> Result<Clip, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "it is not UTF-8")?;
    let bvh = Bvh::parse(text)?;
    let places = super::joints(bvh.joints.iter().map(|joint| Some(joint.name.as_str())))?;
    let parents: Vec<_> = bvh.joints.iter().map(|joint| joint.parent).collect();
    let mut clip = Clip {
        frame_rate: rate(bvh.frame_time),
        skeleton: Skeleton {
            parents: super::parents(&places, &parents)?,
            offsets_m: places.iter().map(|&place| metres(bvh.joints[place].offset.map(f64::from))).collect(),
        },
        face: super::face(Vec::new()),
        rotations: Vec::new(),
        translation: Vec::new(),
        face_values: Vec::new(),
    };
    let first = bvh.joints.iter().scan(0, |at, joint| Some(std::mem::replace(at, *at + joint.channels.len())));
    let first: Vec<usize> = first.collect();
    let root = places[0];
    let offset = bvh.joints[root].offset.map(f64::from);
    let offset = if bvh.replaces()[root] { offset } else { [0.0; 3] };
    for frame in bvh.motion.chunks_exact(bvh.channels().max(1)) {
        let values = |place: usize| &frame[first[place]..];
        clip.rotations.push(places.map(|place| rotation(&bvh.joints[place], values(place))));
        let place = position(&bvh.joints[root], values(root));
        clip.translation.push(metres(std::array::from_fn(|i| place[i] - offset[i])));
    }
    Ok(clip)
}

/// Returns frames per second; near-integer rates are rounded.
#[expect(clippy::cast_possible_truncation, reason = "rates are kept in f32")]
fn rate(frame_time: f64) -> f32 {
    let rate = 1.0 / frame_time;
    if (rate - rate.round()).abs() < 1e-3 { rate.round() as f32 } else { rate as f32 }
}

/// Returns a joint's rotation from its channels, the first outermost.
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is intended")]
fn rotation(joint: &Joint, values: &[f64]) -> Quat {
    joint.channels.iter().zip(values).fold(IDENTITY, |turned, (channel, &value)| match channel {
        Channel::Position(_) => turned,
        Channel::Rotation(axis) => {
            let mut by = [0.0; 3];
            by[*axis] = value.rem_euclid(360.0).to_radians() as f32;
            product(turned, axis_angle_to_quat(by))
        }
    })
}

fn position(joint: &Joint, values: &[f64]) -> [f64; 3] {
    let mut place = [0.0; 3];
    for (channel, &value) in joint.channels.iter().zip(values) {
        if let Channel::Position(axis) = channel {
            place[*axis] = value;
        }
    }
    place
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is intended; the result is checked")]
fn metres(cm: [f64; 3]) -> [f32; 3] {
    cm.map(|x| (x * METRES) as f32)
}
