//! Retargeting: limbs have the source's directions on rigs of every convention, rotated, scaled and
//! in any pose.

#[path = "retarget/builds.rs"]
mod builds;
#[path = "retarget/conventions.rs"]
mod conventions;
#[path = "retarget/hostile.rs"]
mod hostile;
#[path = "retarget/parts.rs"]
mod parts;
#[path = "retarget/rigs.rs"]
mod rigs;

use proptest::prelude::*;
use rigs::{ALL, Body, MAKEHUMAN, MIXAMO, Naming, POSER, UNITY, UNREAL, Vector, source, standing};
use umo_core::{Bone, Floor, JOINTS, Mapping, Pose, Quat, Retarget, Rig};
use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat, inverse, normalized, product, rotate};
use umo_core_pose::skeleton::joint_places;

/// Radians.
const TOLERANCE: f64 = 1e-4;

/// Pairs of joints that define the direction of a limb or a finger.
fn limbs() -> impl Iterator<Item = (usize, usize)> {
    let limbs = [(1, 4), (4, 7), (2, 5), (5, 8), (16, 18), (18, 20), (17, 19), (19, 21), (20, 28), (21, 43)];
    let fingers = (25..JOINTS).filter(|joint| (joint - 25) % 3 < 2).map(|joint| (joint, joint + 1));
    limbs.into_iter().chain(fingers)
}

/// Positions and rotations of bones in the world, from their local transforms.
fn world(rig: &Rig, rotations: &[Quat], hips: (usize, Vector)) -> (Vec<Vector>, Vec<Quat>) {
    fn of(rig: &Rig, rotations: &[Quat], hips: (usize, Vector), bone: usize) -> (Vector, Quat, f32) {
        let Bone { parent, translation, scale, .. } = &rig.bones()[bone];
        let (from, turned, size) = parent.map_or(([0.0; 3], IDENTITY, 1.0), |parent| of(rig, rotations, hips, parent));
        let local = if bone == hips.0 { hips.1 } else { *translation };
        let step = rotate(turned, local.map(|x| x * size));
        (std::array::from_fn(|i| from[i] + step[i]), product(turned, rotations[bone]), size * scale[0])
    }
    (0..rig.len()).map(|bone| of(rig, rotations, hips, bone)).map(|(place, turned, _)| (place, turned)).unzip()
}

fn angle_between(a: Vector, b: Vector) -> f64 {
    let wide = |v: Vector| v.map(f64::from);
    let (a, b) = (wide(a), wide(b));
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    length(cross).atan2(a.iter().zip(b).map(|(a, b)| a * b).sum())
}

fn less(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}

/// Angle between two rotations, radians.
fn apart(a: Quat, b: Quat) -> f64 {
    let [x, y, z, w] = product(inverse(a), b).map(f64::from);
    2.0 * (x * x + y * y + z * z).sqrt().atan2(w)
}

/// Poses a rig, and returns positions and rotations in the world.
fn moved(retarget: &Retarget, rig: &Rig, pose: &Pose) -> (Vec<Vector>, Vec<Quat>) {
    let mut rotations = vec![IDENTITY; rig.len()];
    let hips = retarget.apply(&mut retarget.scratch(), pose, &mut rotations).unwrap();
    world(rig, &rotations, (retarget.hips(), hips))
}

/// Asserts that every limb that the rig has points in the source's direction.
fn check_limbs(body: &Body, rig: &Rig, axes: Quat, pose: &Pose) -> Result<(), TestCaseError> {
    let (mapping, _) = Mapping::guess(rig).unwrap();
    let retarget = Retarget::new(&source(), rig, &mapping, Floor::AtRest).unwrap();
    let (places, _) = moved(&retarget, rig, pose);
    let want = joint_places(&source(), pose);
    for (from, to) in limbs() {
        let Some((a, b)) = body.bone(from).zip(body.bone(to)) else { continue };
        let wanted = rotate(axes, less(want[to], want[from]));
        let angle = angle_between(less(places[b], places[a]), wanted);
        prop_assert!(angle < TOLERANCE, "joint {from} to {to}: {angle} rad");
    }
    Ok(())
}

fn quaternion() -> impl Strategy<Value = Quat> {
    prop::array::uniform4(-1.0_f32..1.0)
        .prop_filter("has a direction", |q| q.iter().map(|x| x * x).sum::<f32>() > 0.01)
        .prop_map(normalized)
}

fn pose() -> impl Strategy<Value = Pose> {
    (prop::collection::vec(quaternion(), JOINTS), prop::array::uniform3(-2.0_f32..2.0))
        .prop_map(|(rotations, at)| Pose { rotations: rotations.try_into().unwrap(), translation: at })
}

/// Rotations between the six axes: Y up, Z up, facing any way.
fn right_angles() -> impl Strategy<Value = Quat> {
    let quarter = std::f32::consts::FRAC_PI_2;
    (0..4_u8, 0..4_u8, 0..4_u8).prop_map(move |(x, y, z)| {
        let turn = |axis: usize, quarters: u8| {
            let mut v = [0.0; 3];
            v[axis] = quarter * f32::from(quarters);
            axis_angle_to_quat(v)
        };
        product(turn(0, x), product(turn(1, y), turn(2, z)))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn limbs_point_where_the_sources_do(
        pose in pose(),
        naming in 0..ALL.len(),
        droop in -0.3_f32..1.5,
        axes in prop::collection::vec(quaternion(), 90),
        world in right_angles(),
        unit in prop::sample::select(vec![0.01_f32, 1.0, 100.0]),
        scale in prop::sample::select(vec![0.01_f32, 1.0]),
        stretch in prop::collection::vec(0.7_f32..1.4, JOINTS),
    ) {
        // Legs of other proportions bend until the feet are at their targets.
        let stretch = |joint: usize| if [1, 2, 4, 5, 7, 8, 10, 11].contains(&joint) { stretch[1] } else { stretch[joint] };
        let body = ALL[naming].body(&stretch, droop);
        let rig = body.rig(world, unit, scale, &|bone| axes[bone]);
        check_limbs(&body, &rig, world, &pose)?;
    }

    #[test]
    fn a_body_that_stands_askew_keeps_its_own_ahead(pose in pose(), yaw in 0.5_f32..1.0, z_up in any::<bool>()) {
        let up = axis_angle_to_quat([if z_up { std::f32::consts::FRAC_PI_2 } else { 0.0 }, 0.0, 0.0]);
        let world = product(up, axis_angle_to_quat([0.0, yaw, 0.0]));
        let body = MIXAMO.body(&|_| 1.0, 0.7);
        check_limbs(&body, &body.rig(world, 1.0, 1.0, &|_| IDENTITY), world, &pose)?;
    }

    /// A round trip through a rig with other axes gives the original pose.
    #[test]
    fn the_same_skeleton_gets_the_same_pose(pose in pose()) {
        let skeleton = source();
        let bones = umo_core::JOINT_NAMES.iter().enumerate().map(|(joint, name)| {
            Bone::new(*name, usize::try_from(skeleton.parents[joint]).ok(), skeleton.offsets_m[joint])
        });
        let rig = Rig::new(bones.collect()).unwrap();
        let (mapping, convention) = Mapping::guess(&rig).unwrap();
        prop_assert_eq!(convention, "SMPL-X");
        let retarget = Retarget::new(&skeleton, &rig, &mapping, Floor::AtZero).unwrap();
        prop_assert!((retarget.scale() - 1.0).abs() < 1e-6);
        let mut rotations = vec![IDENTITY; rig.len()];
        let hips = retarget.apply(&mut retarget.scratch(), &pose, &mut rotations).unwrap();
        for (got, want) in rotations.iter().zip(pose.rotations) {
            prop_assert!(apart(*got, want) < 1e-5, "{} rad", apart(*got, want));
        }
        let want: Vector = std::array::from_fn(|i| skeleton.offsets_m[0][i] + pose.translation[i]);
        prop_assert!(less(hips, want).iter().all(|x| x.abs() < 1e-5), "{hips:?} {want:?}");
    }

    /// The source's pose is recovered from the posed rig, whatever its axes and rest pose: the
    /// world rotation of every joint that has its own bone.
    #[test]
    fn a_rigs_pose_gives_back_the_sources(
        pose in pose(), naming in 0..ALL.len(), axes in quaternion(), droop in 0.0_f32..1.2, stands in right_angles(),
    ) {
        let body = ALL[naming].body(&|_| 1.0, droop);
        let rig = body.rig(stands, 100.0, 1.0, &|_| axes);
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
        let mut scratch = retarget.scratch();
        let mut rotations = vec![IDENTITY; rig.len()];
        retarget.apply(&mut scratch, &pose, &mut rotations).unwrap();
        let back = retarget.joints(&mut scratch, &rotations).unwrap();
        let parents = source().parents;
        let turned = |rotations: &[Quat; JOINTS]| {
            let mut turned = *rotations;
            for joint in 1..JOINTS {
                turned[joint] = product(turned[usize::try_from(parents[joint]).unwrap()], rotations[joint]);
            }
            turned
        };
        let (want, got) = (turned(&pose.rotations), turned(&back));
        for joint in (0..JOINTS).filter(|&joint| mapping.bone(joint).is_some()).chain([9]) {
            prop_assert!(apart(got[joint], want[joint]) < 1e-3, "joint {joint}: {}", apart(got[joint], want[joint]));
        }
    }

    /// With any number of spine and neck bones, chest and head have the source's rotation relative to
    /// rest.
    #[test]
    fn chest_and_head_turn_as_the_sources(pose in pose(), naming in 0..ALL.len(), axes in quaternion()) {
        let body = ALL[naming].body(&|_| 1.0, 0.4);
        let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| axes);
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
        let (_, turned) = moved(&retarget, &rig, &pose);
        let chest = [0, 3, 6, 9].iter().fold(IDENTITY, |q, &joint| product(q, pose.rotations[joint]));
        let head = [12, 15].iter().fold(chest, |q, &joint| product(q, pose.rotations[joint]));
        let bone = *mapping.spine().last().unwrap();
        prop_assert!(apart(turned[bone], product(chest, rig.rotation(bone))) < TOLERANCE);
        let bone = mapping.bone(15).unwrap();
        prop_assert!(apart(turned[bone], product(head, rig.rotation(bone))) < TOLERANCE);
    }

    /// The palm has the source's orientation, also across the knuckles.
    #[test]
    fn palms_face_where_the_sources_do(pose in pose(), roll in -2.0_f32..2.0, droop in 0.0_f32..1.2) {
        let mut body = UNREAL.body(&|_| 1.0, droop);
        // The rig's hands are rotated about its forearms at rest.
        for (elbow, wrist) in [(18, 20), (19, 21)] {
            let [a, b] = [elbow, wrist].map(|joint| body.0[body.bone(joint).unwrap()].place);
            let length = less(b, a).iter().map(|x| x * x).sum::<f32>().sqrt();
            let turn = axis_angle_to_quat(less(b, a).map(|x| x / length * roll));
            for piece in body.0.iter_mut().filter(|p| p.joint.is_some_and(|j| j != wrist && rigs::hangs_on(j, wrist))) {
                let away = rotate(turn, less(piece.place, b));
                piece.place = std::array::from_fn(|i| b[i] + away[i]);
            }
        }
        let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
        let (places, _) = moved(&retarget, &rig, &pose);
        let want = joint_places(&source(), &pose);
        for (index, pinky) in [(25, 31), (40, 46)] {
            let across = less(places[body.bone(index).unwrap()], places[body.bone(pinky).unwrap()]);
            prop_assert!(angle_between(across, less(want[index], want[pinky])) < 3e-4);
        }
        check_limbs(&body, &rig, IDENTITY, &pose)?;
    }

    /// With legs of any proportions, the lower foot is as high in a crouch as in standing.
    #[test]
    fn feet_stay_on_the_ground(
        bend in 0.0_f32..1.2,
        thigh in 0.8_f32..1.25,
        shin in 0.8_f32..1.25,
        world in right_angles(),
        unit in prop::sample::select(vec![1.0_f32, 100.0]),
    ) {
        let skeleton = source();
        let mut pose = Pose::REST;
        for side in 0..2 {
            pose.rotations[1 + side] = axis_angle_to_quat([-bend, 0.0, 0.0]);
            pose.rotations[4 + side] = axis_angle_to_quat([2.0 * bend, 0.0, 0.0]);
            pose.rotations[7 + side] = axis_angle_to_quat([-bend, 0.0, 0.0]);
        }
        let floor = joint_places(&skeleton, &pose)[10][1];
        pose.translation = [0.4, 0.02 - floor, -0.3];
        let body = MIXAMO.body(&|joint| match joint { 4 | 5 => thigh, 7 | 8 => shin, _ => 1.0 }, 0.0);
        let rig = body.rig(world, unit, 1.0, &|_| IDENTITY);
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        let retarget = Retarget::new(&skeleton, &rig, &mapping, Floor::AtRest).unwrap();
        let (places, _) = moved(&retarget, &rig, &pose);
        for joint in [7, 8, 10, 11] {
            let bone = body.bone(joint).unwrap();
            let height = |place: Vector| rotate(inverse(world), place)[1];
            prop_assert!((height(places[bone]) - height(rig.place(bone))).abs() < 2e-4 * unit, "joint {joint}");
        }
        // Movement forward and sideways is in proportion to the legs.
        let hips = rotate(inverse(world), less(places[retarget.hips()], rig.place(retarget.hips())));
        prop_assert!((hips[0] - 0.4 * retarget.scale()).abs() < 1e-3 * unit);
        prop_assert!((hips[2] + 0.3 * retarget.scale()).abs() < 1e-3 * unit);
    }
}

#[test]
fn every_convention_is_known_by_its_names() {
    for naming in ALL {
        let body = naming.body(&|_| 1.0, 0.0);
        let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
        let (mapping, convention) = Mapping::guess(&rig).unwrap();
        assert_eq!(convention, naming.label);
        for (bone, piece) in body.0.iter().enumerate() {
            if let Some(joint) = piece.joint {
                assert_eq!(mapping.bone(joint), Some(bone), "{}: {}", naming.label, piece.name);
            }
        }
        let names = |chain: &[usize]| chain.iter().map(|&bone| rig.bones()[bone].name.clone()).collect::<Vec<_>>();
        assert_eq!(names(mapping.spine()), naming.spine);
        assert_eq!(names(mapping.neck()), naming.neck);
        let given: usize = mapping.entries().iter().map(|(_, bones)| bones.len()).sum();
        assert_eq!(given, body.0.len() - naming.above.len());
    }
}

/// Worked out by hand: a half turn of the source's chest alone, spread over five bones, is a
/// fifth for each.
#[test]
fn a_spine_of_other_length_shares_the_turn() {
    let body = MAKEHUMAN.body(&|_| 1.0, 0.0);
    let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
    let (mapping, _) = Mapping::guess(&rig).unwrap();
    let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
    let mut pose = Pose::REST;
    for joint in [3, 6, 9] {
        pose.rotations[joint] = axis_angle_to_quat([0.0, 0.3, 0.0]);
    }
    let mut rotations = vec![IDENTITY; rig.len()];
    retarget.apply(&mut retarget.scratch(), &pose, &mut rotations).unwrap();
    assert_eq!(mapping.spine().len(), 5);
    for &bone in mapping.spine() {
        assert!(apart(rotations[bone], axis_angle_to_quat([0.0, 0.18, 0.0])) < 1e-6, "{:?}", rotations[bone]);
    }
    assert!(apart(rotations[mapping.neck()[0]], IDENTITY) < 1e-6);
}

/// Bones that follow no joint keep their local transforms; the bones below compensate for missing
/// ones.
#[test]
fn joints_without_bones_are_folded_or_dropped() {
    for naming in [&POSER, &UNITY] {
        let body = naming.body(&|_| 1.0, 0.0);
        let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
        let mut pose = Pose::REST;
        // The neck and the toes nod; neither rig has both.
        pose.rotations[12] = axis_angle_to_quat([0.5, 0.0, 0.0]);
        pose.rotations[10] = axis_angle_to_quat([0.5, 0.0, 0.0]);
        let (_, turned) = moved(&retarget, &rig, &pose);
        assert!(apart(turned[mapping.bone(15).unwrap()], pose.rotations[12]) < 1e-6);
        assert!(apart(turned[mapping.bone(7).unwrap()], IDENTITY) < 1e-6);
    }
}

#[test]
fn a_body_at_rest_stands_where_it_stood() {
    for naming in ALL {
        let body = naming.body(&|_| 1.1, 0.0);
        let rig = body.rig(axis_angle_to_quat([std::f32::consts::FRAC_PI_2, 0.0, 0.0]), 100.0, 1.0, &|_| IDENTITY);
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
        assert!((retarget.scale() - 110.0).abs() < 1e-2, "{}", retarget.scale());
        let pose = Pose { translation: standing(&source())[0], ..Pose::REST };
        let (places, turned) = moved(&retarget, &rig, &pose);
        for bone in 0..rig.len() {
            assert!(less(places[bone], rig.place(bone)).iter().all(|x| x.abs() < 0.01), "{}", naming.label);
            assert!(apart(turned[bone], rig.rotation(bone)) < 1e-4, "{}", naming.label);
        }
    }
}

#[test]
fn hips_at_the_origin_stand_on_the_floor_where_it_is_at_zero() {
    let body = POSER.body(&|_| 1.0, 0.0);
    let rest = body.rig(IDENTITY, 100.0, 1.0, &|_| IDENTITY);
    let mut bones = rest.bones().to_vec();
    let height = std::mem::take(&mut bones[0].translation)[1];
    let rig = Rig::new(bones).unwrap();
    let (mapping, _) = Mapping::guess(&rig).unwrap();
    let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtZero).unwrap();
    let pose = Pose { translation: standing(&source())[0], ..Pose::REST };
    let (places, _) = moved(&retarget, &rig, &pose);
    // The rig has only ankles, which are 8 cm above the floor; the retargeter can only assume that its
    // soles are as thin as the source's.
    assert!((places[0][1] - (height - 6.0)).abs() < 0.01, "{places:?}");
}

#[test]
fn a_mapping_may_be_given_by_hand() {
    let naming = Naming { hips: "a b c", spine: &["x", "y"], ..UNITY };
    let body = naming.body(&|_| 1.0, 0.0);
    let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
    assert!(Mapping::guess(&rig).is_err());
    let (mut mapping, _) = Mapping::closest(&rig);
    mapping.set(&rig, "pelvis", &["a b c"]).unwrap();
    mapping.set(&rig, "spine", &["x", "y"]).unwrap();
    mapping.set(&rig, "jaw", &[]).unwrap();
    mapping.check(&rig).unwrap();
    assert_eq!((mapping.bone(0), mapping.spine().len(), mapping.bone(22)), (Some(0), 2, None));
    mapping.set(&rig, "spine2", &["x"]).unwrap();
    assert_eq!((mapping.spine().len(), mapping.bone(6)), (0, Some(1)));
    assert!(mapping.entries().contains(&("spine2", vec![1])));
    let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
    assert!(retarget.is_driven(1) && !retarget.is_driven(2));
}

#[test]
fn a_bone_that_is_released_stays_at_rest() {
    let body = MAKEHUMAN.body(&|_| 1.0, 0.0);
    let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
    let (mapping, _) = Mapping::guess(&rig).unwrap();
    let mut retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
    let jaw = mapping.bone(22).unwrap();
    let mut pose = Pose::REST;
    pose.rotations[22] = axis_angle_to_quat([0.3, 0.0, 0.0]);
    let turn = |retarget: &Retarget| {
        let mut rotations = vec![IDENTITY; rig.len()];
        retarget.apply(&mut retarget.scratch(), &pose, &mut rotations).unwrap();
        rotations[jaw]
    };
    assert!(apart(turn(&retarget), pose.rotations[22]) < 1e-6);
    retarget.release(jaw);
    assert!(!retarget.is_driven(jaw) && apart(turn(&retarget), IDENTITY) < 1e-6);
}
