use umo_core_pose::skeleton::ARKIT_NAMES;

use super::*;
use proptest::prelude::*;

fn arkit() -> Face {
    Face { kind: FaceKind::Arkit, names: ARKIT_NAMES.map(str::to_owned).to_vec() }
}

fn values(of: &[(&str, f32)]) -> Vec<f32> {
    let value = |name: &&str| of.iter().find(|(known, _)| known == name).map_or(0.0, |(_, value)| *value);
    ARKIT_NAMES.iter().map(value).collect()
}

fn weights(map: &FaceMap, shapes: usize, of: &[(&str, f32)]) -> Vec<f32> {
    let mut weights = vec![0.25; shapes];
    map.apply(&values(of), &mut weights);
    weights
}

#[test]
fn arkit_names_are_found_however_they_are_spelt() {
    let spellings: [fn(&str) -> String; 5] = [
        str::to_owned,
        |name| format!("{}{}", name[..1].to_uppercase(), &name[1..]),
        |name| format!("Wolf3D_Head.{name}"),
        |name| words(name).join("_").to_uppercase(),
        |name| name.replace("Left", "_L").replace("Right", "_R"),
    ];
    for spelling in spellings {
        let shapes = ARKIT_NAMES.map(spelling);
        let map = FaceMap::new(&arkit(), &shapes);
        for (at, name) in ARKIT_NAMES.iter().enumerate() {
            assert_eq!(map.cause(&arkit(), at), *name, "{}", shapes[at]);
        }
    }
}

#[test]
fn other_shapes_are_left_alone() {
    let shapes = ["Smile", "mouthOpen", "JawOpen", "openJaw", "tongueOutside"];
    let map = FaceMap::new(&arkit(), &shapes);
    assert_eq!(map.moved(), [2]);
    let moved = weights(&map, 5, &[("jawOpen", 0.5), ("tongueOut", 1.0)]);
    assert_eq!(moved, [0.25, 0.25, 0.5, 0.25, 0.25]);
    let face = Face { kind: FaceKind::SmplxExpression, names: vec!["expression_0".to_owned()] };
    assert!(FaceMap::new(&face, &["expression_0", "aa"]).moved().is_empty());
}

/// Channels that move shapes with these names, each alone in its list.
fn cause(name: &str) -> String {
    FaceMap::new(&arkit(), &[name]).cause(&arkit(), 0)
}

#[test]
fn other_programs_names_are_known() {
    for (name, channel) in [
        // Groups in capitals, and the side in any position.
        ("BROW-InnerUp", "browInnerUp"),
        ("BROW-Down.L", "browDownLeft"),
        ("BROW-Left-OuterUp", "browOuterUpLeft"),
        ("BROW-raise.R", "browOuterUpRight"),
        ("EYE-blink.R", "eyeBlinkRight"),
        ("MOUTH-smile-left", "mouthSmileLeft"),
        ("JAW-open", "jawOpen"),
        // Character Creator.
        ("Brow_Raise_Inner_L", "browInnerUp"),
        ("Brow_Drop_R", "browDownRight"),
        ("Cheek_Raise_L", "cheekSquintLeft"),
        ("Mouth_Roll_In_Lower", "mouthRollLower"),
        ("Mouth_Up_Upper_R", "mouthUpperUpRight"),
        ("Eye_L_Look_L", "eyeLookOutLeft"),
        ("Eye_R_Look_L", "eyeLookInRight"),
        ("Eye_L_Look_Up", "eyeLookUpLeft"),
        ("Jaw_L", "jawLeft"),
        ("Mouth_R", "mouthRight"),
        // Faceshift and its successors.
        ("BrowsU_C", "browInnerUp"),
        ("BrowsU_R", "browOuterUpRight"),
        ("EyeOpen_L", "eyeWideLeft"),
        ("LipsFunnel", "mouthFunnel"),
        ("JawFwd", "jawForward"),
        ("Puff", "cheekPuff"),
        ("Sneer_L", "noseSneerLeft"),
        // Fuse.
        ("Blink_Left", "eyeBlinkLeft"),
        ("Smile_Right", "mouthSmileRight"),
        ("Midmouth_Left", "mouthLeft"),
        // Daz, and lists with additional shapes.
        ("Genesis9__facs_bs_BrowDownLeft_div2", "browDownLeft"),
        ("mouthFunnelUpper", "mouthFunnel"),
        ("browInnerUpLeft", "browInnerUp"),
        ("cheekPuffRight", "cheekPuff"),
    ] {
        assert_eq!(cause(name), channel, "{name}");
    }
    for name in ["Smile", "Frown", "squint", "Mouth", "Jaw", "upLeft", "Left", "L", "", "browsing", "eyesLookUp"] {
        assert_eq!(cause(name), "", "{name}");
    }
}

#[test]
fn a_name_of_arkits_goes_before_others() {
    let map = FaceMap::new(&arkit(), &["Blink_Left", "eyeBlinkLeft"]);
    assert_eq!(map.moved(), [1]);
}

#[test]
fn mouths_of_two_shapes_open_and_smile() {
    // Ready Player Me without further morph targets.
    let shapes = ["mouthOpen", "mouthSmile"];
    let map = FaceMap::new(&arkit(), &shapes);
    assert!(map.opens_mouth(&arkit()));
    let of = [("jawOpen", 0.7), ("mouthClose", 0.2), ("mouthSmileLeft", 0.6), ("mouthSmileRight", 0.2)];
    let moved = weights(&map, 2, &of);
    assert!((moved[0] - 0.5 / 0.7).abs() < 1e-6 && (moved[1] - 0.4).abs() < 1e-6, "{moved:?}");
    assert_eq!(map.cause(&arkit(), 0), "jawOpen less mouthClose, over 0.7");
    assert_eq!(map.plain_mouth(), Some(0));
    assert_eq!(weights(&map, 2, &[("mouthClose", 0.3)]), [0.0, 0.0]);
    // With ARKit shapes, those two would open and smile twice.
    let all = ["mouthOpen", "mouthSmile", "jawOpen", "mouthSmileLeft", "mouthSmileRight"];
    assert_eq!(FaceMap::new(&arkit(), &all).moved(), [2, 3, 4]);
    // Visemes or vowels are preferred to a single shape.
    assert_eq!(FaceMap::new(&arkit(), &["aa", "mouthOpen"]).moved(), [0]);
    // Both lids and both brows in one shape each.
    let both = FaceMap::new(&arkit(), &["eyesClosed", "browDown", "EYE-wide"]);
    let moved = weights(&both, 3, &[("eyeBlinkLeft", 1.0), ("browDownRight", 0.5), ("eyeWideLeft", 0.5)]);
    assert_eq!(moved, [0.5, 0.25, 0.25]);
}

#[test]
fn a_few_visemes_speak_as_vowels() {
    let map = FaceMap::new(&arkit(), &["viseme_sil", "viseme_PP", "viseme_aa", "vrc.v_nn", "viseme_O"]);
    assert_eq!((map.moved(), map.speaking(), map.plain_mouth()), (vec![2, 4], vec![2, 4], None));
    assert_eq!(weights(&map, 5, &[("jawOpen", 0.7)])[2..], [1.0, 0.25, 0.0]);
    assert_eq!(weights(&map, 5, &[("jawOpen", 0.7), ("mouthPucker", 0.7)])[4], 1.0);
    assert!(FaceMap::new(&arkit(), &["jawOpen"]).speaking().is_empty());
}

#[test]
fn vowels_and_blinks_of_vrm_are_made_of_the_channels() {
    let shapes = ["a", "i", "u", "e", "o", "blink"];
    let map = FaceMap::new(&arkit(), &shapes);
    assert_eq!(map.moved(), [0, 1, 2, 3, 4, 5]);
    let wide = ["mouthSmileLeft", "mouthSmileRight", "mouthStretchLeft", "mouthStretchRight"].map(|name| (name, 0.25));
    let with = |more: &[(&str, f32)]| weights(&map, 6, &[&wide[..], more].concat());
    assert_eq!(weights(&map, 6, &[]), [0.0; 6]);
    assert_eq!(weights(&map, 6, &[("jawOpen", 0.7)]), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(weights(&map, 6, &[("mouthPucker", 0.9)]), [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    assert_eq!(weights(&map, 6, &[("mouthFunnel", 0.7), ("jawOpen", 1.0)]), [0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    assert_eq!(with(&[("jawOpen", 0.7)]), [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    assert!(with(&[("jawOpen", 0.175)])[1] > 0.7);
    assert_eq!(with(&[]), [0.0; 6], "a smile is not a vowel");
    assert_eq!(weights(&map, 6, &[("jawOpen", 0.7), ("mouthClose", 0.7)]), [0.0; 6]);
    assert_eq!(weights(&map, 6, &[("eyeBlinkLeft", 1.0)])[5], 0.5);
    let sides = FaceMap::new(&arkit(), &["blink", "blinkLeft", "Blink_R", "aa", "ou"]);
    assert_eq!(weights(&sides, 5, &[("eyeBlinkRight", 1.0)]), [0.25, 0.0, 1.0, 0.0, 0.0]);
}

#[test]
fn the_oculus_set_goes_before_vowels_and_arkit_before_both() {
    let oculus: Vec<_> = VISEME_NAMES.iter().map(|name| format!("viseme_{name}")).collect();
    let map = FaceMap::new(&arkit(), &oculus);
    assert_eq!(map.moved().len(), VISEMES);
    assert!(weights(&map, VISEMES, &[])[0] > 0.3, "silence");
    // Ready Player Me's three names.
    let others = oculus.iter().map(|name| match name.as_str() {
        "viseme_ih" => "viseme_I".to_owned(),
        "viseme_oh" => "viseme_O".to_owned(),
        "viseme_ou" => "viseme_U".to_owned(),
        _ => name.clone(),
    });
    assert_eq!(FaceMap::new(&arkit(), &others.collect::<Vec<_>>()).moved().len(), VISEMES);
    let both: Vec<_> = oculus.iter().map(String::as_str).chain(["jawOpen", "aa"]).collect();
    assert_eq!(FaceMap::new(&arkit(), &both).moved(), [VISEMES]);
}

#[test]
fn links_add_up_and_releases_take_away() {
    let mut map = FaceMap::new(&arkit(), &["jawOpen", "Mouth"]);
    assert!(map.link(&arkit(), "jawOpen", 1, 0.5) && map.link(&arkit(), "mouthFunnel", 1, 1.0));
    assert!(!map.link(&arkit(), "nothing", 1, 1.0) && !map.link(&arkit(), "jawOpen", 2, 1.0));
    assert_eq!(weights(&map, 2, &[("jawOpen", 0.5), ("mouthFunnel", 0.25)]), [0.5, 0.5]);
    assert_eq!(map.cause(&arkit(), 1), "0.5 jawOpen + mouthFunnel");
    map.release(0);
    assert_eq!(map.moved(), [1]);
}

proptest! {
    #[test]
    fn weights_stay_between_0_and_1(values in proptest::collection::vec(0.0_f32..=1.0, 52)) {
        for shapes in [&["aa", "ih", "ou", "ee", "oh", "blink"], &["jawOpen", "mouthLeft", "jaw", "R", "blinkL", "blinkR"]] {
            let map = FaceMap::new(&arkit(), shapes);
            let mut weights = vec![0.0; 6];
            map.apply(&values, &mut weights);
            prop_assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{weights:?}");
            prop_assert!(shapes[0] != "aa" || weights[..5].iter().sum::<f32>() < 1.0 + 1e-5);
        }
    }
}
