//! `.glb`: the skeleton, the figure in two meshes (body and head) with one shape per face channel, and their
//! animation.

use std::io::{self, Write};
use std::ops::Range;

use gltf_json as json;
use json::animation::Property;
use json::validation::Checked::Valid;
use json::{Index, Node, mesh};
use umo_core_base::memory::collected;
use umo_core_pose::clip::Clip;
use umo_core_pose::face::FaceKind;
use umo_core_pose::skeleton::{JOINT_NAMES, JOINTS};
use umo_figure::palette::Palette;
use umo_figure::{Figure, Helper, Mesh};

use crate::builder::{self, Builder, Textures};
use crate::shapes::{self, Shape};
use crate::tracks::{Tracks, continuous, track};

/// Writes the animation as binary glTF, on a figure. Without a figure, the file holds the bones, their skin and their
/// motion, but no face: in glTF, weights belong to a mesh.
///
/// # Errors
/// The animation is inconsistent ([`Clip::check`]) or exceeds glTF's 4 GiB, or writing to `out` fails.
pub fn write<W: Write>(clip: &Clip, figure: Option<Figure>, out: W) -> io::Result<()> {
    clip.check().map_err(invalid)?;
    let built = figure.map(|figure| BuiltFigure::new(figure, clip)).transpose()?;
    write_checked(clip, built.as_ref(), out)
}

/// A figure built on a skeleton. Building it takes most of the time of writing a file; it can be reused for every
/// animation of that skeleton.
#[derive(Debug)]
pub struct BuiltFigure {
    offsets_m: Vec<[f32; 3]>,
    face: FaceKind,
    pub(crate) mesh: Mesh,
    palette: Palette,
    textures: Textures,
}

impl BuiltFigure {
    /// Builds the figure on the clip's skeleton, with a face of the clip's kind.
    ///
    /// # Errors
    /// The skeleton does not fit a figure ([`Figure::mesh`]).
    pub fn new(figure: Figure, clip: &Clip) -> io::Result<Self> {
        let mesh = figure.mesh(&clip.skeleton).map_err(invalid)?;
        let mesh = match clip.face.kind {
            // With expression coefficients the jaw's joint opens the mouth; ARKit's shapes include the open jaw.
            FaceKind::SmplxExpression => mesh.on_the_jaw(),
            FaceKind::Arkit => mesh,
        };
        let palette = Palette::new(&mesh);
        let textures = Textures::new(&mesh, &palette)?;
        Ok(Self { offsets_m: clip.skeleton.offsets_m.clone(), face: clip.face.kind, mesh, palette, textures })
    }

    /// Whether the figure was built for clips like this.
    #[must_use]
    pub fn fits(&self, clip: &Clip) -> bool {
        self.face == clip.face.kind && self.offsets_m == clip.skeleton.offsets_m
    }

    /// Writes the animation as [`write()`] does, on this figure.
    ///
    /// # Errors
    /// As for [`write()`], or the clip does not [fit](Self::fits).
    pub fn write<W: Write>(&self, clip: &Clip, out: W) -> io::Result<()> {
        clip.check().map_err(invalid)?;
        if !self.fits(clip) {
            return Err(invalid("the figure was built for another skeleton or face"));
        }
        write_checked(clip, Some(self), out)
    }
}

fn write_checked<W: Write>(clip: &Clip, figure: Option<&BuiltFigure>, out: W) -> io::Result<()> {
    let mut builder = Builder::default();
    let joints = add_skeleton(&mut builder, clip);
    let of_mesh = figure.map_or(&[][..], |figure| &figure.mesh.helpers);
    let helpers = add_helpers(&mut builder, clip, of_mesh);
    let rest = rest_positions(clip);
    let places: Vec<_> = rest.iter().copied().chain(of_mesh.iter().map(|helper| rest[helper.of])).collect();
    let skin = add_skin(&mut builder, &[&joints[..], &helpers].concat(), &places);
    let meshes = figure.map(|figure| {
        let shapes: Vec<_> =
            clip.face.names.iter().map(|name| (name.clone(), shapes::shape(name, &figure.mesh))).collect();
        add_meshes(&mut builder, figure, &shapes, skin)
    });
    let helpers: Vec<_> = of_mesh.iter().zip(helpers).collect();
    add_animation(&mut builder, clip, &joints, &helpers, meshes.map(|[_, face]| face));
    builder.scene(joints[..1].iter().copied().chain(meshes.into_iter().flatten()).collect());
    builder.write(out)
}

pub(crate) fn invalid(cause: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, cause)
}

/// Adds the figure's body and its face with these shapes, as skinned nodes.
pub(crate) fn add_meshes(
    builder: &mut Builder,
    figure: &BuiltFigure,
    shapes: &[(String, Shape)],
    skin: Index<json::Skin>,
) -> [Index<Node>; 2] {
    let BuiltFigure { mesh, palette, textures, .. } = figure;
    let materials = builder.materials(textures);
    let mut surfaces = |range: Range<usize>| -> Vec<mesh::Primitive> {
        let used = materials.iter().filter(|(detail, _)| mesh.details[range.clone()].contains(detail));
        used.map(|&(detail, material)| primitive(builder.surface(mesh, palette, range.clone(), detail), material))
            .collect()
    };
    let cloth = surfaces(0..mesh.head);
    let mut front = surfaces(mesh.head..mesh.positions.len());
    let body = builder.mesh("body", cloth, &[]);
    let body = builder.skinned("body", body, skin);

    if !shapes.is_empty() {
        let count = mesh.positions.len() - mesh.head;
        let targets = shapes.iter().map(|(_, shape)| builder.morph_target(shape, count));
        // The head has no relief, so it is one surface.
        front[0].targets = Some(targets.collect());
    }
    let names: Vec<_> = shapes.iter().map(|(name, _)| name.clone()).collect();
    let face = builder.mesh("face", front, &names);
    [body, builder.skinned("face", face, skin)]
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

/// Adds one node per joint. `[55]`
fn add_skeleton(builder: &mut Builder, clip: &Clip) -> Vec<Index<Node>> {
    (0..JOINTS)
        .map(|joint| {
            let below: Vec<_> = clip.children(joint).map(builder::index).collect();
            builder.root.push(Node {
                name: Some(JOINT_NAMES[joint].to_owned()),
                translation: Some(clip.skeleton.offsets_m[joint]),
                children: (!below.is_empty()).then_some(below),
                ..Node::default()
            })
        })
        .collect()
}

/// Adds one node per helper joint, below the helper's parent joint.
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

/// Positions of the joints in the rest pose. `[55]`, metres.
pub(crate) fn rest_positions(clip: &Clip) -> Vec<[f32; 3]> {
    let mut rest: Vec<[f32; 3]> = Vec::with_capacity(JOINTS);
    for (joint, offset) in clip.skeleton.offsets_m.iter().enumerate() {
        let from = clip.parent(joint).map_or([0.0; 3], |parent| rest[parent]);
        rest.push(std::array::from_fn(|axis| from[axis] + offset[axis]));
    }
    rest
}

pub(crate) fn add_skin(builder: &mut Builder, joints: &[Index<Node>], rest: &[[f32; 3]]) -> Index<json::Skin> {
    // The rest pose has no rotations, so the inverse bind matrix subtracts the joint's position. Column-major.
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

/// Adds one channel per rotation of a joint or helper joint, one for the root's translation, one for all face
/// weights.
fn add_animation(
    builder: &mut Builder,
    clip: &Clip,
    joints: &[Index<Node>],
    helpers: &[(&Helper, Index<Node>)],
    face: Option<Index<Node>>,
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
    let places = collected((0..frames).map(|f| clip.root_position(f)));
    let places = builder.vectors(&places);
    tracks.add(joints[0], Property::Translation, places);
    if let (Some(face), false) = (face, clip.face.names.is_empty()) {
        let weights = builder.scalars(clip.face_values.iter().copied());
        tracks.add(face, Property::MorphTargetWeights, weights);
    }
    builder.root.push(tracks.animation);
}
