//! Motion out of a character's file, brought to the joints of a model's skeleton.

use umo_core::{ModelFile, Quat, Skeleton};
use umo_core_pose::rotation::axis_angle_to_quat;
use umo_core_rig::glb::clip::read;

fn salute() -> Vec<u8> {
    std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/capi/salute.glb")).unwrap()
}

fn skeleton() -> Skeleton {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/umo-people/model.safetensors");
    ModelFile::open(path.as_ref()).unwrap().config().skeleton.clone()
}

#[test]
fn a_characters_animation_is_brought_to_the_joints() {
    let (skeleton, shoulder, head) = (skeleton(), 17, 15);
    let is_near = |a: Quat, b: [f32; 3]| {
        let b = axis_angle_to_quat(b.map(f32::to_radians));
        // The arms of the two skeletons differ by some degrees in a T-pose.
        a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>().abs() > 0.998
    };
    let frames = read(&salute(), None, &skeleton).unwrap();
    assert_eq!(frames.len(), 46);
    assert!(is_near(frames[0][shoulder], [0.0, 0.0, 70.0]), "{:?}", frames[0][shoulder]);
    assert!(is_near(frames[20][shoulder], [0.0, 0.0, 10.0]), "{:?}", frames[20][shoulder]);
    assert!(is_near(frames[20][19], [0.0, 120.0, 0.0]) && is_near(frames[20][head], [0.0; 3]));
    let frames = read(&salute(), Some("turn"), &skeleton).unwrap();
    assert!(frames.len() == 31 && is_near(frames[15][head], [0.0, 30.0, 0.0]));
}

#[test]
fn bad_files_are_refused_with_what_is_wrong() {
    let (skeleton, file) = (skeleton(), salute());
    let wrong = |bytes: &[u8], name: Option<&str>| read(bytes, name, &skeleton).unwrap_err();
    assert_eq!(wrong(b"RIFF", None), "not a glb file");
    assert_eq!(wrong(&file[..file.len() - 1], None), "the file is cut short");
    let other = wrong(&file, Some("wave"));
    assert!(other.contains("`wave`") && other.contains("salute") && other.contains("turn"), "{other}");
    // With the name of an arm bone removed.
    let mut nameless = file.clone();
    let text = b"mixamorig:RightArm";
    let at = nameless.windows(text.len()).position(|window| window == text).unwrap();
    nameless[at..at + text.len()].fill(b'x');
    let missing = wrong(&nameless, None);
    assert!(missing.contains("right_shoulder"), "{missing}");
    // No corrupted byte causes a panic.
    for at in 0..file.len() {
        let mut changed = file.clone();
        changed[at] ^= 1 << (at % 8);
        let _ = read(&changed, None, &skeleton);
    }
}
