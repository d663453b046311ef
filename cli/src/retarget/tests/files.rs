//! Skeletons in `.bvh` files.

use std::fmt::Write;

use proptest::prelude::*;
use umo_core_pose::rotation::axis_angle_to_quat;

use super::*;
use crate::bvh::{Bvh, Channel};

/// Joints in another order than umo's, with a spine of one bone, hanging arms and no fingers; offsets in centimetres.
const JOINTS: [(&str, Option<usize>, [f32; 3], &str); 16] = [
    ("Hips", None, [0.0, 0.0, 0.0], "pelvis"),
    ("Chest", Some(0), [0.0, 22.0, 0.0], ""),
    ("RightShoulder", Some(1), [-18.0, 20.0, -2.0], "right_shoulder"),
    ("RightElbow", Some(2), [-18.0, -20.0, 1.0], "right_elbow"),
    ("RightWrist", Some(3), [-2.0, -24.0, 5.0], "right_wrist"),
    ("LeftShoulder", Some(1), [18.0, 20.0, -2.0], "left_shoulder"),
    ("LeftElbow", Some(5), [18.0, -20.0, 1.0], "left_elbow"),
    ("LeftWrist", Some(6), [2.0, -24.0, 5.0], "left_wrist"),
    ("Neck", Some(1), [0.0, 25.0, -1.0], ""),
    ("Head", Some(8), [0.0, 10.0, 2.0], "head"),
    ("LeftHip", Some(0), [9.0, -4.0, 0.0], "left_hip"),
    ("LeftKnee", Some(10), [1.0, -42.0, 2.0], "left_knee"),
    ("LeftAnkle", Some(11), [0.0, -40.0, -3.0], "left_ankle"),
    ("RightHip", Some(0), [-9.0, -4.0, 0.0], "right_hip"),
    ("RightKnee", Some(13), [-1.0, -42.0, 2.0], "right_knee"),
    ("RightAnkle", Some(14), [0.0, -40.0, -3.0], "right_ankle"),
];

/// Returns the file's text: rotations in `order`, and position channels for all joints if `places`.
fn text(order: &str, places: bool, frames: &str) -> String {
    let mut text = "HIERARCHY\n".to_owned();
    write_joint(&mut text, 0, order, places);
    let count = frames.lines().count();
    write!(text, "MOTION\nFrames: {count}\nFrame Time: 0.008333\n{frames}").unwrap();
    text
}

fn write_joint(out: &mut String, at: usize, order: &str, places: bool) {
    let (name, parent, [x, y, z], _) = JOINTS[at];
    let kind = if parent.is_none() { "ROOT" } else { "JOINT" };
    let has_places = places || parent.is_none();
    let channels = if has_places { "6 Xposition Yposition Zposition" } else { "3" };
    let turns: Vec<_> = order.chars().map(|axis| format!("{axis}rotation")).collect();
    writeln!(out, "{kind} {name}\n{{\n OFFSET {x} {y} {z}\n CHANNELS {channels} {}", turns.join(" ")).unwrap();
    let below: Vec<_> = (0..JOINTS.len()).filter(|&child| JOINTS[child].1 == Some(at)).collect();
    below.iter().for_each(|&child| write_joint(out, child, order, places));
    if below.is_empty() {
        out.push_str(" End Site\n {\n  OFFSET 0 0 5\n }\n");
    }
    out.push_str("}\n");
}

/// Retargets a clip to a file's skeleton; returns its scale and the resulting file.
fn on_skeleton(text: &str, clip: &Clip) -> (f32, Bvh, String) {
    let target = Target::read("a.BVH".as_ref(), text.as_bytes().to_vec()).unwrap();
    let (mapping, _) = target.mapping(&Given::default()).unwrap();
    let retarget = prepare(&clip.skeleton, target.rig(), &mapping, target.floor(&mapping)).unwrap();
    let motion = motion(&retarget, clip).unwrap();
    let bytes = target.animated(&retarget, &motion, &Faces::default(), clip).unwrap();
    let text = String::from_utf8(bytes).unwrap();
    (retarget.scale(), Bvh::parse(&text).unwrap(), text)
}

/// Returns the joints' positions in a frame; position channels replace the offset if `replaces`.
fn places(bvh: &Bvh, frame: usize, replaces: bool) -> Vec<Vector> {
    let mut numbers = bvh.motion[frame * bvh.channels()..].iter();
    let mut world: Vec<(Vector, Quat)> = Vec::new();
    for joint in &bvh.joints {
        let (mut step, mut turned) = (joint.offset, IDENTITY);
        for channel in &joint.channels {
            let value: f32 = format!("{}", numbers.next().unwrap()).parse().unwrap();
            match channel {
                Channel::Position(axis) if replaces && joint.parent.is_some() => step[*axis] = value,
                Channel::Position(axis) => step[*axis] += value,
                Channel::Rotation(axis) => {
                    let mut by = [0.0; 3];
                    by[*axis] = value.to_radians();
                    turned = product(turned, axis_angle_to_quat(by));
                }
            }
        }
        let (from, above) = joint.parent.map_or(([0.0; 3], IDENTITY), |parent| world[parent]);
        let step = rotate(above, step);
        world.push((std::array::from_fn(|i| from[i] + step[i]), product(above, turned)));
    }
    world.into_iter().map(|(place, _)| place).collect()
}

fn check(bvh: &Bvh, clip: &Clip, scale: f32, replaces: bool) {
    // The file's feet have only ankles. They stand as high above the floor as the source's ankles above its soles.
    let rest = joint_places(&clip.skeleton, &umo_core::Pose::REST);
    let sole = [7, 8, 10, 11].map(|joint| rest[joint][1]).into_iter().fold(f32::MAX, f32::min) - 0.02;
    let standing = rest[7][1] - sole;
    for frame in 0..clip.len() {
        let found = places(bvh, frame, replaces);
        let want = joint_places(&clip.skeleton, &clip.pose(frame));
        let place = |name: &str| {
            let joint = JOINTS.iter().find(|(.., joint)| *joint == name).unwrap().0;
            found[bvh.joints.iter().position(|known| known.name == joint).unwrap()]
        };
        // Legs of other proportions bend until the feet are in position.
        for (from, to) in limbs().into_iter().filter(|(from, _)| !from.ends_with("hip") && !from.ends_with("knee")) {
            let angle = angle_between(less(place(to), place(from)), less(want[joint(to)], want[joint(from)]));
            assert!(angle < TOLERANCE, "{from} to {to}: {angle} rad");
        }
        let feet = [place("left_ankle")[1], place("right_ankle")[1]];
        let lowest = feet[0].min(feet[1]);
        let source = want[joint("left_ankle")][1].min(want[joint("right_ankle")][1]);
        let wanted = scale * (source - standing + 0.02);
        assert!((lowest - wanted).abs() < 0.02, "{lowest} cm for {wanted}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn every_order_of_channels_says_the_same_motion(
        order in prop::sample::select(vec!["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]),
        amount in 0_u8..4,
        places in any::<bool>(),
    ) {
        let clip = sample::clip(FaceKind::Arkit, 5, amount);
        let before = text(order, places, "");
        let (scale, bvh, after) = on_skeleton(&before, &clip);
        let hierarchy = |text: &str| text.split_once("MOTION").unwrap().0.to_owned();
        prop_assert_eq!(hierarchy(&before), hierarchy(&after));
        prop_assert!((bvh.frame_time - 1.0 / 30.0).abs() < 1e-6);
        prop_assert_eq!(bvh.motion.len(), 5 * bvh.channels());
        check(&bvh, &clip, scale, true);
    }
}

#[test]
fn places_are_written_as_the_file_has_them() {
    let clip = sample::clip(FaceKind::Arkit, 2, 1);
    let zeros = vec!["0"; JOINTS.len() * 6].join(" ");
    let (scale, bvh, _) = on_skeleton(&text("ZXY", true, &zeros), &clip);
    check(&bvh, &clip, scale, false);
    assert_eq!(bvh.motion[6..9], [0.0; 3]);
    let (_, bvh, _) = on_skeleton(&text("ZXY", true, ""), &clip);
    assert_eq!(bvh.motion[6..9], [0.0, 22.0, 0.0]);
}

#[test]
fn umos_own_files_come_back_as_they_were() {
    let clip = sample::clip(FaceKind::SmplxExpression, 6, 1);
    let mut bytes = Vec::new();
    crate::export::bvh::write(&clip, &mut bytes).unwrap();
    let (_, bvh, _) = on_skeleton(std::str::from_utf8(&bytes).unwrap(), &clip);
    let first = Bvh::parse(std::str::from_utf8(&bytes).unwrap()).unwrap();
    for (at, (a, b)) in bvh.motion.iter().zip(&first.motion).enumerate() {
        // Equivalent angles may differ by a full turn, or by half a turn each; positions decide.
        assert!((a - b).abs() < 2e-3 || at % bvh.channels() > 2, "{at}: {a} {b}");
    }
    for frame in 0..clip.len() {
        for (a, b) in places(&bvh, frame, true).iter().zip(places(&first, frame, true)) {
            assert!(less(*a, b).iter().all(|x| x.abs() < 2e-3), "{a:?} {b:?}");
        }
    }
}

#[test]
fn joints_that_cannot_be_turned_are_refused() {
    let clip = sample::clip(FaceKind::Arkit, 1, 1);
    let refused = |text: String| {
        let target = Target::read("a.bvh".as_ref(), text.into_bytes()).unwrap();
        let (mapping, _) = target.mapping(&Given::default()).unwrap();
        let retarget = prepare(&clip.skeleton, target.rig(), &mapping, target.floor(&mapping)).unwrap();
        target.animated(&retarget, &motion(&retarget, &clip).unwrap(), &Faces::default(), &clip).unwrap_err()
    };
    let two = text("ZXY", false, "").replacen("CHANNELS 3 Zrotation Xrotation", "CHANNELS 2 Zrotation", 1);
    assert!(refused(two).contains("three rotation channels"));
    let fixed = text("ZXY", false, "").replace("CHANNELS 6 Xposition Yposition Zposition", "CHANNELS 3");
    assert!(refused(fixed).contains("three position channels"));
}
