//! Exports a figure as an avatar: it stands in a T-pose on the floor, faces +Z, and its bones have no rotations. Its
//! face has ARKit's 52 shapes and the 15 `viseme_…` of the Oculus set; a `.vrm` file also has VRM's expressions.

use std::io::{self, Write};

use gltf_json as json;
use json::{Index, Node};
use serde_json::{Map, Value, json};
use umo_core_pose::clip::Clip;
use umo_core_pose::face::{Face, FaceKind};
use umo_core_pose::pose::{Assembly, GAZE_SIDEWAYS, GAZE_UPWARDS};
use umo_core_pose::rotation::{IDENTITY, rotate};
use umo_core_pose::skeleton::{ARKIT_NAMES, JOINT_NAMES, JOINTS, Skeleton};
use umo_core_pose::visemes::{VISEME_NAMES, VISEMES};
use umo_figure::{Figure, FigureError};

use crate::builder::{self, Builder};
use crate::glb::{BuiltFigure, add_meshes, add_skin, invalid, rest_positions};
use crate::shapes::{self, Shape};
use crate::vrm::{bone, t_pose};

const JAW: usize = 22;
const EYES: [usize; 2] = [23, 24];
const COPYRIGHT: &str = "The umo authors; MIT OR Apache-2.0";

/// Names of the body's bones in Mixamo and Ready Player Me, in SMPL-X order.
const BONES: [&str; 25] = [
    "Hips",
    "LeftUpLeg",
    "RightUpLeg",
    "Spine",
    "LeftLeg",
    "RightLeg",
    "Spine1",
    "LeftFoot",
    "RightFoot",
    "Spine2",
    "LeftToeBase",
    "RightToeBase",
    "Neck",
    "LeftShoulder",
    "RightShoulder",
    "Head",
    "LeftArm",
    "RightArm",
    "LeftForeArm",
    "RightForeArm",
    "LeftHand",
    "RightHand",
    "Jaw",
    "LeftEye",
    "RightEye",
];

/// Names of the fingers in Mixamo, in SMPL-X order.
const FINGERS: [&str; 5] = ["Index", "Middle", "Pinky", "Ring", "Thumb"];

/// Part of an expression: an ARKit shape and its weight.
type Part = (&'static str, f32);

/// VRM's expressions, composed of ARKit's shapes; its vowels are visemes ([`VOWELS`]).
const EXPRESSIONS: [(&str, &[Part]); 13] = [
    ("neutral", &[]),
    ("blink", &[("eyeBlinkLeft", 1.0), ("eyeBlinkRight", 1.0)]),
    ("blinkLeft", &[("eyeBlinkLeft", 1.0)]),
    ("blinkRight", &[("eyeBlinkRight", 1.0)]),
    ("lookUp", &[("eyeLookUpLeft", 1.0), ("eyeLookUpRight", 1.0)]),
    ("lookDown", &[("eyeLookDownLeft", 1.0), ("eyeLookDownRight", 1.0)]),
    ("lookLeft", &[("eyeLookOutLeft", 1.0), ("eyeLookInRight", 1.0)]),
    ("lookRight", &[("eyeLookInLeft", 1.0), ("eyeLookOutRight", 1.0)]),
    (
        "happy",
        &[
            ("mouthSmileLeft", 0.8),
            ("mouthSmileRight", 0.8),
            ("cheekSquintLeft", 0.5),
            ("cheekSquintRight", 0.5),
            ("eyeSquintLeft", 0.3),
            ("eyeSquintRight", 0.3),
            ("browInnerUp", 0.15),
        ],
    ),
    (
        "angry",
        &[
            ("browDownLeft", 1.0),
            ("browDownRight", 1.0),
            ("eyeSquintLeft", 0.4),
            ("eyeSquintRight", 0.4),
            ("noseSneerLeft", 0.5),
            ("noseSneerRight", 0.5),
            ("mouthFrownLeft", 0.4),
            ("mouthFrownRight", 0.4),
            ("mouthPressLeft", 0.4),
            ("mouthPressRight", 0.4),
        ],
    ),
    (
        "sad",
        &[
            ("browInnerUp", 0.9),
            ("mouthFrownLeft", 0.7),
            ("mouthFrownRight", 0.7),
            ("mouthShrugLower", 0.4),
            ("eyeBlinkLeft", 0.2),
            ("eyeBlinkRight", 0.2),
        ],
    ),
    (
        "relaxed",
        &[
            ("mouthSmileLeft", 0.35),
            ("mouthSmileRight", 0.35),
            ("eyeSquintLeft", 0.2),
            ("eyeSquintRight", 0.2),
            ("eyeBlinkLeft", 0.2),
            ("eyeBlinkRight", 0.2),
        ],
    ),
    (
        "surprised",
        &[
            ("browInnerUp", 0.9),
            ("browOuterUpLeft", 0.9),
            ("browOuterUpRight", 0.9),
            ("eyeWideLeft", 0.8),
            ("eyeWideRight", 0.8),
            ("jawOpen", 0.35),
            ("mouthFunnel", 0.2),
        ],
    ),
];

/// VRM's vowels, and the viseme of each.
const VOWELS: [(&str, &str); 5] = [("aa", "aa"), ("ih", "ih"), ("ou", "ou"), ("ee", "E"), ("oh", "oh")];

/// File format of an avatar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// glTF 2.0, with bone names of Mixamo and Ready Player Me.
    Glb,
    /// VRM 1.0.
    Vrm,
}

/// Writes a figure on a skeleton, with the model's joints as bones.
///
/// # Errors
/// The skeleton is unusable ([`Figure::mesh`]), or writing to `out` fails.
pub fn write<W: Write>(figure: Figure, skeleton: &Skeleton, kind: Kind, out: W) -> io::Result<()> {
    let mut clip = standing(skeleton)?;
    let mut built = BuiltFigure::new(figure, &clip)?;
    built.mesh = built.mesh.without_helpers(&clip.skeleton);
    put_on_the_floor(&mut clip, &mut built);
    let mut builder = Builder::default();
    builder.root.asset.copyright = Some(COPYRIGHT.to_owned());
    let joints = add_bones(&mut builder, &clip, kind);
    let skin = add_skin(&mut builder, &joints, &rest_positions(&clip));
    let meshes = add_meshes(&mut builder, &built, &all_shapes(&clip, &built), skin);
    builder.scene([&joints[..1], &meshes].concat());
    // three.js names the group after the scene, and pages look for an avatar under this name.
    builder.root.scenes[0].name = Some("Armature".to_owned());
    if kind == Kind::Vrm {
        builder.extension("VRMC_vrm", vrm(figure, &clip, &joints, meshes));
    }
    builder.write(out)
}

/// A clip without frames: bones in a T-pose without rotations, and ARKit's face.
fn standing(skeleton: &Skeleton) -> io::Result<Clip> {
    let (parents, offsets) = (&skeleton.parents, &skeleton.offsets_m);
    if parents.len() != JOINTS || offsets.len() != JOINTS {
        return Err(invalid(FigureError::Joints { found: offsets.len() }));
    }
    let world = t_pose(offsets);
    let turned = |joint: usize| match usize::try_from(parents[joint]) {
        Ok(parent) => rotate(world[parent], offsets[joint]),
        Err(_) => [0.0; 3],
    };
    Ok(Clip {
        frame_rate: 30.0,
        skeleton: Skeleton { parents: parents.clone(), offsets_m: (0..JOINTS).map(turned).collect() },
        face: Face { kind: FaceKind::Arkit, names: ARKIT_NAMES.map(str::to_owned).to_vec() },
        rotations: Vec::new(),
        translation: Vec::new(),
        face_values: Vec::new(),
    })
}

/// Moves the figure so that the lowest point of the soles is at height 0.
fn put_on_the_floor(clip: &mut Clip, built: &mut BuiltFigure) {
    let lowest = built.mesh.positions.iter().map(|place| place[1]).fold(f32::INFINITY, f32::min);
    clip.skeleton.offsets_m[0][1] -= lowest;
    built.mesh.positions.iter_mut().for_each(|place| place[1] -= lowest);
}

/// Adds one node per joint. `[55]`
fn add_bones(builder: &mut Builder, clip: &Clip, kind: Kind) -> Vec<Index<Node>> {
    (0..JOINTS)
        .map(|joint| {
            let below: Vec<_> = clip.children(joint).map(builder::index).collect();
            builder.root.push(Node {
                name: Some(match kind {
                    Kind::Glb => mixamo_bone(joint),
                    Kind::Vrm => bone(joint),
                }),
                translation: Some(clip.skeleton.offsets_m[joint]),
                children: (!below.is_empty()).then_some(below),
                ..Node::default()
            })
        })
        .collect()
}

fn mixamo_bone(joint: usize) -> String {
    let Some(finger) = joint.checked_sub(BONES.len()) else { return BONES[joint].to_owned() };
    let side = if JOINT_NAMES[joint].starts_with("left") { "Left" } else { "Right" };
    format!("{side}Hand{}{}", FINGERS[finger / 3 % FINGERS.len()], finger % 3 + 1)
}

/// Ready Player Me's name of a viseme: the Oculus set, with vowels by their letters.
fn viseme_name(at: usize) -> String {
    let name = match VISEME_NAMES[at] {
        "ih" => "I",
        "oh" => "O",
        "ou" => "U",
        name => name,
    };
    format!("viseme_{name}")
}

/// ARKit's shapes, of which the gaze shapes also rotate the eyeballs, then the visemes.
fn all_shapes(clip: &Clip, built: &BuiltFigure) -> Vec<(String, Shape)> {
    let (mesh, places) = (&built.mesh, rest_positions(clip));
    let assembly = Assembly::new(&clip.face);
    let arkit = ARKIT_NAMES.iter().enumerate().map(|(at, name)| {
        let (mut values, mut rotations) = ([0.0; ARKIT_NAMES.len()], [IDENTITY; JOINTS]);
        values[at] = 1.0;
        assembly.turn_eyes(&values, &mut rotations);
        let turned = EYES.into_iter().filter(|&eye| rotations[eye] != IDENTITY);
        let turns: Vec<_> = turned.map(|eye| (eye, rotations[eye], places[eye])).collect();
        let shape = shapes::shape(name, mesh);
        ((*name).to_owned(), if turns.is_empty() { shape } else { shapes::with_eyes(shape, mesh, &turns) })
    });
    let visemes = (0..VISEMES).map(|at| (viseme_name(at), shapes::viseme(at, mesh)));
    arkit.chain(visemes).collect()
}

/// The `VRMC_vrm` extension: author and permissions, bones, expressions, gaze.
fn vrm(figure: Figure, clip: &Clip, joints: &[Index<Node>], [body, face]: [Index<Node>; 2]) -> Value {
    // The mouth opens by shapes: no vertex is bound to the jaw.
    let bones = (0..JOINTS).filter(|&joint| joint != JAW);
    let bones: Map<String, Value> =
        bones.map(|joint| (bone(joint), json!({ "node": joints[joint].value() }))).collect();
    let eyes = EYES.map(|joint| clip.skeleton.offsets_m[joint]);
    let from_head: [f32; 3] = std::array::from_fn(|axis| f32::midpoint(eyes[0][axis], eyes[1][axis]));
    let range = |radians: f32| json!({ "inputMaxValue": radians.to_degrees().round(), "outputScale": 1.0 });
    let (sideways, upwards) = (range(GAZE_SIDEWAYS), range(GAZE_UPWARDS));
    json!({
        "specVersion": "1.0",
        "meta": meta(figure),
        "humanoid": { "humanBones": bones },
        "firstPerson": { "meshAnnotations": [
            { "node": body.value(), "type": "both" },
            { "node": face.value(), "type": "thirdPersonOnly" },
        ] },
        "lookAt": {
            "type": "expression",
            "offsetFromHeadBone": from_head,
            "rangeMapHorizontalInner": sideways,
            "rangeMapHorizontalOuter": sideways,
            "rangeMapVerticalDown": upwards,
            "rangeMapVerticalUp": upwards,
        },
        "expressions": expressions(face),
    })
}

/// The permissions of umo's licences, in VRM's terms.
fn meta(figure: Figure) -> Value {
    let mut name = figure.name().to_owned();
    name[..1].make_ascii_uppercase();
    json!({
        "name": name,
        "version": env!("CARGO_PKG_VERSION"),
        "authors": ["The umo authors"],
        "copyrightInformation": COPYRIGHT,
        "licenseUrl": "https://vrm.dev/licenses/1.0/",
        "otherLicenseUrl": "https://spdx.org/licenses/MIT.html",
        "avatarPermission": "everyone",
        "commercialUsage": "corporation",
        "creditNotation": "required",
        "allowRedistribution": true,
        "modification": "allowModificationRedistribution",
        "allowExcessivelyViolentUsage": true,
        "allowExcessivelySexualUsage": true,
        "allowPoliticalOrReligiousUsage": true,
        "allowAntisocialOrHateUsage": true,
    })
}

/// VRM's presets, and each of ARKit's shapes under its own name for programs that set them all.
fn expressions(face: Index<Node>) -> Value {
    let bind = |index: usize, weight: f32| json!({ "node": face.value(), "index": index, "weight": weight });
    let shape = |name: &str| ARKIT_NAMES.iter().position(|known| *known == name).expect("an ARKit shape");
    let viseme = |name: &str| VISEME_NAMES.iter().position(|known| *known == name).expect("a viseme");
    let mut preset = Map::new();
    for (name, parts) in EXPRESSIONS {
        let binds: Vec<_> = parts.iter().map(|&(part, weight)| bind(shape(part), weight)).collect();
        preset.insert(name.to_owned(), json!({ "morphTargetBinds": binds }));
    }
    for (name, of) in VOWELS {
        preset.insert(name.to_owned(), json!({ "morphTargetBinds": [bind(ARKIT_NAMES.len() + viseme(of), 1.0)] }));
    }
    let custom = ARKIT_NAMES.iter().enumerate();
    let custom: Map<String, Value> =
        custom.map(|(at, name)| ((*name).to_owned(), json!({ "morphTargetBinds": [bind(at, 1.0)] }))).collect();
    json!({ "preset": preset, "custom": custom })
}
