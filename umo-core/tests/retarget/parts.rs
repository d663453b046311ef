//! Rigs with missing parts: hands with fewer fingers, busts, heads.

use super::rigs::*;
use super::{angle_between, apart, less, moved, pose};
use proptest::prelude::*;
use umo_core::{Bone, Floor, JOINTS, Mapping, Pose, Retarget, RetargetError, Rig};
use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat, product};
use umo_core_pose::skeleton::joint_places;

/// Fingers that a hand has: index, middle, little, ring, thumb.
const HANDS: [(&str, [bool; 5]); 6] = [
    ("four fingers, no ring", [true, true, true, false, true]),
    ("four fingers, no little", [true, true, false, true, true]),
    ("three fingers", [true, true, false, false, true]),
    ("thumb and one", [false, true, false, false, true]),
    ("mitten", [false, true, false, false, false]),
    ("none", [false; 5]),
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The existing fingers have the source's directions, and so do hands with any fingers.
    #[test]
    fn hands_of_fewer_fingers_move_as_the_sources(pose in pose(), hand in 0..HANDS.len(), droop in 0.0_f32..1.2) {
        let (name, has) = HANDS[hand];
        let mut naming = READY_PLAYER_ME;
        for (finger, _) in has.iter().enumerate().filter(|(_, has)| !**has) {
            naming.fingers[finger] = "";
        }
        let body = naming.body(&|_| 1.0, droop);
        let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
        let (places, _) = moved(&retarget, &rig, &pose);
        let ours = joint_places(&source(), &pose);
        for (wrist, first) in [(20, 25), (21, 40)] {
            // From the wrist to a knuckle, and along each finger.
            let knuckle = if has[1] { first + 3 } else { first };
            let fingers = (0..5).filter(|&finger| has[finger]);
            let along = fingers.flat_map(|f| [(first + 3 * f, first + 3 * f + 1), (first + 3 * f + 1, first + 3 * f + 2)]);
            for (from, to) in along.chain([(wrist, knuckle)]) {
                let Some((a, b)) = body.bone(from).zip(body.bone(to)) else { continue };
                let angle = angle_between(less(places[b], places[a]), less(ours[to], ours[from]));
                prop_assert!(angle < 1e-3, "{name}: joint {from} to {to} is {angle} rad off");
            }
        }
    }
}

/// Reduces a rig to the bones that are kept and their ancestors.
fn only(naming: &Naming, keep: &[&str]) -> Rig {
    let body = naming.body(&|_| 1.0, 0.0);
    let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
    let is_kept = |bone: usize| {
        (0..rig.len()).any(|kept| keep.contains(&rig.bones()[kept].name.as_str()) && rig.is_below(kept, bone))
    };
    let kept: Vec<usize> = (0..rig.len()).filter(|&bone| is_kept(bone)).collect();
    let bones = kept.iter().map(|&bone| {
        let parent = rig.bones()[bone].parent.and_then(|parent| kept.iter().position(|&at| at == parent));
        Bone { parent, ..rig.bones()[bone].clone() }
    });
    Rig::new(bones.collect()).unwrap()
}

fn find(rig: &Rig, name: &str) -> usize {
    rig.bones().iter().position(|bone| bone.name == name).unwrap()
}

/// A pose with a leaning, turning body and a nodding head.
fn nod() -> Pose {
    let mut pose = Pose { translation: standing(&source())[0], ..Pose::REST };
    pose.rotations[0] = axis_angle_to_quat([0.0, 0.4, 0.0]);
    pose.rotations[6] = axis_angle_to_quat([0.2, 0.0, 0.0]);
    pose.rotations[12] = axis_angle_to_quat([0.1, 0.0, 0.0]);
    pose.rotations[15] = axis_angle_to_quat([0.3, 0.1, 0.0]);
    pose
}

fn turn_of(joints: &[usize]) -> [f32; 4] {
    joints.iter().fold(IDENTITY, |q, &joint| product(q, nod().rotations[joint]))
}

#[test]
fn an_avatar_for_headsets_moves_without_arms_and_legs() {
    // Ready Player Me's half body has no arms between chest and hands.
    let mut rig = only(&READY_PLAYER_ME, &["Head", "LeftEye", "RightEye", "LeftHandIndex1", "RightHandIndex1"]);
    let bones = rig.bones().iter().map(|bone| {
        let between = ["Shoulder", "Arm", "ForeArm"].iter().any(|part| bone.name.ends_with(part));
        Bone { name: if between { String::new() } else { bone.name.clone() }, ..bone.clone() }
    });
    rig = Rig::new(bones.collect()).unwrap();
    let (mapping, label) = Mapping::guess(&rig).unwrap();
    assert_eq!(label, "Mixamo");
    let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
    let (places, turned) = moved(&retarget, &rig, &nod());
    assert!(apart(turned[find(&rig, "Head")], turn_of(&[0, 6, 12, 15])) < 1e-5);
    assert!(apart(turned[find(&rig, "Spine2")], turn_of(&[0, 6])) < 1e-5);
    // Hands stay with the chest.
    assert!(!retarget.is_driven(find(&rig, "LeftHand")));
    let hips = find(&rig, "Hips");
    assert!(less(places[hips], rig.place(hips)).iter().all(|x| x.abs() < 1e-4));
}

#[test]
fn a_bust_and_a_head_move_against_the_chest_that_they_have_not() {
    let bust = only(&UNREAL_4, &["head", "clavicle_l", "clavicle_r"]);
    let (mapping, _) = Mapping::guess(&bust).unwrap();
    let retarget = Retarget::new(&source(), &bust, &mapping, Floor::AtRest).unwrap();
    let (_, turned) = moved(&retarget, &bust, &nod());
    assert!(apart(turned[find(&bust, "head")], turn_of(&[0, 6, 12, 15])) < 1e-5);

    let bones = vec![
        Bone::new("Armature", None, [0.0; 3]),
        Bone::new("Neck", Some(0), [0.0, 1.4, 0.0]),
        Bone::new("Head", Some(1), [0.0, 0.1, 0.02]),
        Bone::new("LeftEye", Some(2), [0.03, 0.1, 0.08]),
        Bone::new("RightEye", Some(2), [-0.03, 0.1, 0.08]),
        Bone::new("Hair", Some(2), [0.0, 0.2, 0.0]),
    ];
    let head = Rig::new(bones.clone()).unwrap();
    let (mapping, _) = Mapping::guess(&head).unwrap();
    let retarget = Retarget::new(&source(), &head, &mapping, Floor::AtRest).unwrap();
    let (places, turned) = moved(&retarget, &head, &nod());
    assert!(apart(turned[2], turn_of(&[12, 15])) < 1e-5, "the body's turn and lean are not the head's");
    assert_eq!(places[1], head.place(1), "a head without a body stays where it is");
    let mut pose = nod();
    pose.translation = [3.0, 1.0, -2.0];
    assert_eq!(moved(&retarget, &head, &pose).0[1], head.place(1));

    // Alone, without a neck or eyes, and in a file whose Z is up.
    let alone = Rig::new(vec![Bone::new("head", None, [0.0, 0.0, 1.5])]).unwrap();
    let (mapping, _) = Mapping::guess(&alone).unwrap();
    let retarget = Retarget::new(&source(), &alone, &mapping, Floor::AtZero).unwrap();
    assert!(apart(moved(&retarget, &alone, &nod()).1[0], turn_of(&[12, 15])) < 1e-5);
}

#[test]
fn a_body_whose_limbs_are_not_known_is_no_bust() {
    let mut body = READY_PLAYER_ME.body(&|_| 1.0, 0.0);
    for piece in &mut body.0 {
        for (known, other) in [("UpLeg", "Zb"), ("Leg", "Zc"), ("Foot", "Zd"), ("ToeBase", "Ze")] {
            piece.name = piece.name.replace(known, other);
        }
    }
    let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
    let Err(RetargetError::Missing { joints, .. }) = Mapping::guess(&rig) else { panic!("legs are missing") };
    assert_eq!(joints, ["left_hip", "right_hip", "left_knee", "right_knee"]);
    // A joint that is mapped to no bone is not searched for.
    let (mut mapping, _) = Mapping::closest(&rig);
    joints.iter().for_each(|joint| mapping.set(&rig, joint, &[]).unwrap());
    mapping.check(&rig).unwrap();
    assert!(Retarget::new(&source(), &rig, &mapping, Floor::AtRest).is_ok());
    assert!((0..JOINTS).filter(|&joint| mapping.bone(joint).is_some()).count() > 30);
}
