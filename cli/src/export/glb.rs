//! `.glb`: glTF 2.0 with the skeleton, the figure in two meshes, body and head, one shape per face
//! channel, and the animation of all three.
//!
//! | module | part |
//! | --- | --- |
//! | `builder` | the binary buffer and what refers into it |
//! | `shapes` | how each face channel moves the head |
//! | `vrma` | the animation alone, for VRM avatars |

use super::{children, face_of, root_position};
use builder::Builder;
use gltf_json as json;
use json::animation::{Animation, Channel, Interpolation, Property, Sampler, Target};
use json::validation::Checked::Valid;
use json::{Accessor, Index, Node, mesh};
use std::io::{self, Write};
use umo_core::config::FaceKind;
use umo_core::motion::clip::Clip;
use umo_core::motion::skeleton::{JOINT_NAMES, JOINTS};
use umo_figure::palette::Palette;
use umo_figure::{Figure, Helper};

mod builder;
mod shapes;
pub mod vrma;

/// Writes the animation as binary glTF, worn by the figure.
///
/// # Errors
/// Those of `out`; an animation beyond glTF's 4 GiB.
pub fn write<W: Write>(clip: &Clip, figure: Figure, out: W) -> io::Result<()> {
    let figure = figure.mesh(&clip.skeleton).map_err(|cause| io::Error::new(io::ErrorKind::InvalidInput, cause))?;
    let figure = match clip.face.kind {
        // Expression coefficients leave the jaw to its joint; among ARKit's shapes is the open jaw.
        FaceKind::SmplxExpression => figure.on_the_jaw(),
        FaceKind::Arkit => figure,
    };
    let mut builder = Builder::default();
    let joints = add_skeleton(&mut builder, clip);
    let helpers = add_helpers(&mut builder, clip, &figure.helpers);
    let rest = rest_positions(clip);
    let places = figure.helpers.iter().map(|helper| rest[helper.of]);
    let places: Vec<_> = rest.iter().copied().chain(places).collect();
    let skin = add_skin(&mut builder, &[&joints[..], &helpers].concat(), &places);
    let palette = Palette::new(&figure);
    let material = builder.material("figure", &palette)?;
    let cloth = builder.surface(&figure, &palette, 0..figure.head);
    let mesh = builder.mesh("body", primitive(cloth, material), &[]);
    let body = builder.skinned("body", mesh, skin);

    let mut front = primitive(builder.surface(&figure, &palette, figure.head..figure.positions.len()), material);
    let names = &clip.face.names;
    if !names.is_empty() {
        let count = figure.positions.len() - figure.head;
        let targets = names.iter().map(|name| builder.morph_target(&shapes::shape(name, &figure), count));
        front.targets = Some(targets.collect());
    }
    let mesh = builder.mesh("face", front, names);
    let face = builder.skinned("face", mesh, skin);

    let helpers: Vec<_> = figure.helpers.iter().zip(helpers).collect();
    add_animation(&mut builder, clip, &joints, &helpers, face);
    builder.scene(vec![joints[0], body, face]);
    builder.write(out)
}

fn primitive(surface: builder::Attributes, material: Index<json::Material>) -> mesh::Primitive {
    mesh::Primitive {
        attributes: surface.attributes,
        indices: Some(surface.indices),
        material: Some(material),
        mode: Valid(mesh::Mode::Triangles),
        targets: None,
        extensions: None,
        extras: None,
    }
}

/// One node per joint. `[55]`
fn add_skeleton(builder: &mut Builder, clip: &Clip) -> Vec<Index<Node>> {
    (0..JOINTS)
        .map(|joint| {
            let below: Vec<_> = children(clip, joint).map(builder::index).collect();
            builder.root.push(Node {
                name: Some(JOINT_NAMES[joint].to_owned()),
                translation: Some(clip.skeleton.offsets_m[joint]),
                children: (!below.is_empty()).then_some(below),
                ..Node::default()
            })
        })
        .collect()
}

/// One node per helper joint, below the joint that it hangs on.
fn add_helpers(builder: &mut Builder, clip: &Clip, helpers: &[Helper]) -> Vec<Index<Node>> {
    let node = |helper: &Helper| {
        let node = builder.root.push(Node {
            name: Some(helper.name.clone()),
            translation: (!helper.is_in_place()).then(|| clip.skeleton.offsets_m[helper.of]),
            ..Node::default()
        });
        builder.root.nodes[helper.hangs_on].children.get_or_insert_default().push(node);
        node
    };
    helpers.iter().map(node).collect()
}

/// Where the joints are in the rest pose. `[55]`, metres.
fn rest_positions(clip: &Clip) -> Vec<[f32; 3]> {
    let mut rest: Vec<[f32; 3]> = Vec::with_capacity(JOINTS);
    for (joint, offset) in clip.skeleton.offsets_m.iter().enumerate() {
        let from = super::parent(clip, joint).map_or([0.0; 3], |parent| rest[parent]);
        rest.push(std::array::from_fn(|axis| from[axis] + offset[axis]));
    }
    rest
}

fn add_skin(builder: &mut Builder, joints: &[Index<Node>], rest: &[[f32; 3]]) -> Index<json::Skin> {
    // The rest pose has no rotations, so a joint's inverse is to subtract its place. Column-major.
    let inverse = rest
        .iter()
        .flat_map(|&[x, y, z]| [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-x, -y, -z, 1.0]]);
    let matrices = builder.matrices(&inverse.collect::<Vec<_>>());
    builder.root.push(json::Skin {
        inverse_bind_matrices: Some(matrices),
        joints: joints.to_vec(),
        skeleton: Some(joints[0]),
        name: Some("skeleton".to_owned()),
        extensions: None,
        extras: None,
    })
}

/// One channel per rotation of a joint or helper joint, one for the root's place, one for all face
/// weights.
fn add_animation(
    builder: &mut Builder,
    clip: &Clip,
    joints: &[Index<Node>],
    helpers: &[(&Helper, Index<Node>)],
    face: Index<Node>,
) {
    let frames = clip.rotations.len();
    let mut tracks = Tracks::new(builder, clip);
    for (joint, &node) in joints.iter().enumerate() {
        let values = builder.vectors(&track(clip, joint));
        tracks.add(node, Property::Rotation, values);
    }
    for &(helper, node) in helpers {
        let turns = clip.rotations.iter().map(|frame| helper.local_turn(frame[helper.of]));
        let values = builder.vectors(&continuous(turns));
        tracks.add(node, Property::Rotation, values);
    }
    let places: Vec<_> = (0..frames).map(|f| root_position(clip, f)).collect();
    let places = builder.vectors(&places);
    tracks.add(joints[0], Property::Translation, places);
    if !clip.face.names.is_empty() {
        let weights: Vec<_> = (0..frames).flat_map(|f| face_of(clip, f)).collect();
        let weights = builder.scalars(weights.into_iter().copied());
        tracks.add(face, Property::MorphTargetWeights, weights);
    }
    builder.root.push(tracks.animation);
}

/// An animation in the making: what moves, at the clip's frames.
struct Tracks {
    times: Index<Accessor>,
    animation: Animation,
}

impl Tracks {
    fn new(builder: &mut Builder, clip: &Clip) -> Self {
        let times: Vec<f32> = (0..clip.rotations.len()).map(|f| f as f32 / clip.frame_rate).collect();
        let times = builder.times(&times);
        let animation = Animation {
            channels: Vec::new(),
            samplers: Vec::new(),
            name: Some("speech".to_owned()),
            extensions: None,
            extras: None,
        };
        Self { times, animation }
    }

    /// `output` has a value for every frame.
    fn add(&mut self, node: Index<Node>, property: Property, output: Index<Accessor>) {
        let sampler = builder::index(self.animation.samplers.len());
        self.animation.samplers.push(Sampler {
            input: self.times,
            output,
            interpolation: Valid(Interpolation::Linear),
            extensions: None,
            extras: None,
        });
        self.animation.channels.push(Channel {
            sampler,
            target: Target { node, path: Valid(property), extensions: None, extras: None },
            extensions: None,
            extras: None,
        });
    }
}

fn track(clip: &Clip, joint: usize) -> Vec<[f32; 4]> {
    continuous(clip.rotations.iter().map(|frame| frame[joint]))
}

/// Rotations, each of exact length and on the same side as the one before: not every program takes
/// the shorter way between two quaternions.
fn continuous(rotations: impl Iterator<Item = [f32; 4]>) -> Vec<[f32; 4]> {
    let mut before = [0.0, 0.0, 0.0, 1.0];
    let rotations = rotations.map(|q| {
        let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        let dot: f32 = q.iter().zip(before).map(|(a, b)| a * b).sum();
        let sign = if dot < 0.0 { -1.0 } else { 1.0 };
        before = q.map(|x| x * sign / length);
        before
    });
    rotations.collect()
}
