//! Broken rigs, and rigs that only look broken.

use super::rigs::{ALL, MIXAMO, source};
use super::{moved, pose};
use proptest::prelude::*;
use umo_core::{Bone, Floor, MAX_BONES, Mapping, Pose, Retarget, RetargetError, Rig, StepError};
use umo_core_pose::rotation::IDENTITY;

fn bones() -> Vec<Bone> {
    MIXAMO.body(&|_| 1.0, 0.0).rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY).bones().to_vec()
}

fn refused(change: impl FnOnce(&mut Vec<Bone>)) -> RetargetError {
    let mut bones = bones();
    change(&mut bones);
    let rig = match Rig::new(bones) {
        Ok(rig) => rig,
        Err(error) => return error,
    };
    match Mapping::guess(&rig) {
        Ok((mapping, _)) => Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap_err(),
        Err(error) => error,
    }
}

fn at(bones: &[Bone], name: &str) -> usize {
    bones.iter().position(|bone| bone.name == format!("mixamorig:{name}")).unwrap()
}

#[test]
fn trees_that_are_none_are_refused() {
    let spine = |bones: &[Bone]| at(bones, "Spine");
    assert_eq!(refused(|bones| bones[0].parent = Some(spine(bones))), RetargetError::Cycle("Armature".to_owned()));
    assert!(matches!(refused(|bones| bones[5].parent = Some(5)), RetargetError::Cycle(_)));
    assert!(matches!(refused(|bones| bones[5].parent = Some(500)), RetargetError::Parent { parent: 500, .. }));
    let many = vec![Bone::new("", None, [0.0; 3]); MAX_BONES + 1];
    assert!(matches!(Rig::new(many), Err(RetargetError::TooMany { .. })));
    assert!(matches!(refused(Vec::clear), RetargetError::Missing { .. }));
}

#[test]
fn numbers_that_are_none_are_refused() {
    for bad in [f32::NAN, f32::INFINITY] {
        assert!(matches!(refused(|bones| bones[3].translation[1] = bad), RetargetError::NotFinite(_)));
        assert!(matches!(refused(|bones| bones[3].rotation[1] = bad), RetargetError::NotFinite(_)));
        assert!(matches!(refused(|bones| bones[3].scale[1] = bad), RetargetError::NotFinite(_)));
    }
    assert!(matches!(refused(|bones| bones[3].rotation = [0.0; 4]), RetargetError::NotFinite(_)));
    let far = |bones: &mut Vec<Bone>| bones.iter_mut().for_each(|bone| bone.translation[0] = f32::MAX);
    assert!(matches!(refused(far), RetargetError::NotFinite(_)));
}

#[test]
fn scales_that_would_shear_are_refused_where_they_matter() {
    for scale in [[1.0, 2.0, 1.0], [-1.0, 1.0, 1.0], [0.0; 3], [-1.0; 3]] {
        let found = refused(|bones| bones[0].scale = scale);
        assert_eq!(found, RetargetError::Scale("Armature".to_owned()));
        let mut bones = bones();
        // The last bone of a finger has no children.
        let last = at(&bones, "LeftHandIndex3");
        bones[last].scale = scale;
        let rig = Rig::new(bones).unwrap();
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
    }
}

#[test]
fn missing_or_misplaced_bones_are_named() {
    let missing = refused(|bones| {
        let arm = at(bones, "LeftArm");
        bones[arm].name = "Wing".to_owned();
    });
    let RetargetError::Missing { joints, bones } = &missing else { panic!("{missing}") };
    assert_eq!(joints, &["left_shoulder"]);
    assert!(bones.contains(&"Wing".to_owned()) && missing.to_string().contains("`Wing`"));
    let order = refused(|bones| {
        let (arm, leg) = (at(bones, "LeftForeArm"), at(bones, "RightLeg"));
        bones[arm].parent = Some(leg);
    });
    assert!(matches!(order, RetargetError::Order { .. }), "{order}");
    let flat = refused(|bones| bones.iter_mut().for_each(|bone| bone.translation = [0.0; 3]));
    assert_eq!(flat, RetargetError::Flat);

    let rig = Rig::new(bones.iter().map(|name| Bone::new(name.clone(), None, [0.0; 3])).collect()).unwrap();
    let mut mapping = Mapping::default();
    assert!(matches!(mapping.set(&rig, "tail", &["Wing"]), Err(RetargetError::NoJoint(_))));
    assert!(matches!(mapping.set(&rig, "head", &["Hed"]), Err(RetargetError::NoBone { .. })));
    assert!(matches!(mapping.set(&rig, "head", &["Wing", "Wing"]), Err(RetargetError::Several(_))));
    assert!(matches!(mapping.check(&rig), Err(RetargetError::Missing { .. })));
}

#[test]
fn a_bone_of_two_joints_is_refused() {
    let rig = Rig::new(bones()).unwrap();
    let (mut mapping, _) = Mapping::guess(&rig).unwrap();
    mapping.set(&rig, "jaw", &["mixamorig:Head"]).unwrap();
    assert_eq!(mapping.check(&rig), Err(RetargetError::Twice("mixamorig:Head".to_owned())));
}

#[test]
fn a_source_that_is_no_skeleton_is_refused() {
    let rig = Rig::new(bones()).unwrap();
    let (mapping, _) = Mapping::guess(&rig).unwrap();
    let refused = |change: fn(&mut umo_core::Skeleton)| {
        let mut source = source();
        change(&mut source);
        Retarget::new(&source, &rig, &mapping, Floor::AtRest).unwrap_err()
    };
    assert_eq!(refused(|s| s.parents[7] = 7), RetargetError::Source);
    assert_eq!(refused(|s| s.parents[7] = -1), RetargetError::Source);
    assert_eq!(refused(|s| s.offsets_m[7][0] = f32::NAN), RetargetError::Source);
    assert_eq!(refused(|s| s.offsets_m.truncate(9)), RetargetError::Source);
}

#[test]
fn another_rigs_room_is_refused() {
    let rig = Rig::new(bones()).unwrap();
    let (mapping, _) = Mapping::guess(&rig).unwrap();
    let retarget = Retarget::new(&source(), &rig, &mapping, Floor::AtRest).unwrap();
    let mut short = vec![IDENTITY; rig.len() - 1];
    let found = retarget.apply(&mut retarget.scratch(), &Pose::REST, &mut short);
    assert!(matches!(found, Err(StepError::Disagree(_))));
    assert!(matches!(retarget.joints(&mut retarget.scratch(), &short), Err(StepError::Disagree(_))));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Bones without length have no direction, and poses may hold any values: the output is always unit
    /// rotations.
    #[test]
    fn any_input_gives_unit_rotations(
        pose in pose(),
        naming in 0..ALL.len(),
        flat in prop::collection::vec(any::<bool>(), 90),
        bad in prop::collection::vec((0_usize..55, prop::num::f32::ANY), 0..9),
    ) {
        let mut pose = pose;
        for (joint, value) in bad {
            pose.rotations[joint][joint % 4] = value;
            pose.translation[joint % 3] = value.clamp(-1e6, 1e6);
        }
        let body = ALL[naming].body(&|_| 1.0, 0.0);
        let mut bones = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY).bones().to_vec();
        for (bone, _) in bones.iter_mut().zip(flat).filter(|(_, flat)| *flat) {
            bone.translation = [0.0; 3];
        }
        let rig = Rig::new(bones).unwrap();
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        if let Ok(retarget) = Retarget::new(&source(), &rig, &mapping, Floor::AtZero) {
            let (places, turned) = moved(&retarget, &rig, &pose);
            prop_assert!(places.iter().flatten().all(|x| x.is_finite()));
            prop_assert!(turned.iter().all(|q| (q.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-5));
        }
    }

    /// Any tree of bones is accepted or refused, without a panic.
    #[test]
    fn random_trees_never_panic(
        parents in prop::collection::vec(prop::option::of(0_usize..70), 60),
        places in prop::collection::vec(prop::array::uniform3(-1.0_f32..1.0), 60),
        pose in pose(),
    ) {
        let names = bones();
        let bones = names.iter().zip(parents).zip(places);
        let bones = bones.map(|((bone, parent), place)| Bone::new(bone.name.clone(), parent, place));
        let Ok(rig) = Rig::new(bones.collect()) else { return Ok(()) };
        let Ok((mapping, _)) = Mapping::guess(&rig) else { return Ok(()) };
        if let Ok(retarget) = Retarget::new(&source(), &rig, &mapping, Floor::AtRest) {
            moved(&retarget, &rig, &pose);
        }
    }
}
