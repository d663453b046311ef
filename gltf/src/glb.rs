//! `.glb`: the skeleton, the figure in two meshes (body and head) with one shape per face channel, and their
//! animation; of one character, or of several in one room that share the figure.

use std::io::{self, Write};
use std::ops::Range;

use gltf_json as json;
use json::validation::Checked::Valid;
use json::{Index, Node, mesh};
use umo_core_base::memory::collected;
use umo_core_pose::clip::Clip;
use umo_core_pose::face::FaceKind;
use umo_core_pose::skeleton::{JOINT_NAMES, JOINTS};
use umo_figure::palette::Palette;
use umo_figure::{Figure, Helper, Mesh};

use crate::builder::{self, Builder, Textures};
use crate::keys::Keying;
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
    write_checked(&[Member::alone(clip, built.as_ref())], None, out)
}

/// A character of a room.
#[derive(Clone, Copy, Debug)]
pub struct Member<'a> {
    /// Name of its root node, and the prefix of the other names: `bob` has a `bob-pelvis`. The first character's names
    /// have no prefix, so that readers of a single one find it.
    pub name: &'a str,
    /// Its motion.
    pub clip: &'a Clip,
    /// Its figure. Members with the same one share its meshes and pictures.
    pub figure: Option<&'a BuiltFigure>,
    /// Its place, metres.
    pub position: [f32; 3],
    /// Its direction about y, radians: 0 is +Z, a quarter turn +X.
    pub facing: f32,
}

impl<'a> Member<'a> {
    fn alone(clip: &'a Clip, figure: Option<&'a BuiltFigure>) -> Self {
        Self { name: "", clip, figure, position: [0.0; 3], facing: 0.0 }
    }
}

/// Writes several characters with one animation. A single member is written as by [`write()`], without its place.
///
/// # Errors
/// As for [`write()`]; also if there is no member, if their clips differ in length or frame rate, or if a figure does not
/// [fit](BuiltFigure::fits) its clip.
pub fn write_room<W: Write>(members: &[Member<'_>], out: W) -> io::Result<()> {
    let first = members.first().ok_or_else(|| invalid("a room needs a member"))?;
    for Member { clip, figure, .. } in members {
        clip.check().map_err(invalid)?;
        if clip.len() != first.clip.len() || clip.frame_rate.to_bits() != first.clip.frame_rate.to_bits() {
            return Err(invalid("the members' clips differ in length or frame rate"));
        }
        if figure.is_some_and(|figure| !figure.fits(clip)) {
            return Err(invalid(OTHER));
        }
    }
    write_checked(members, None, out)
}

const OTHER: &str = "the figure was built for another skeleton or face";

/// A figure built on a skeleton. Building it takes most of the time of writing a file; it can be reused for every
/// animation of that skeleton.
#[derive(Debug)]
pub struct BuiltFigure {
    figure: Figure,
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
        let offsets_m = clip.skeleton.offsets_m.clone();
        Ok(Self { figure, offsets_m, face: clip.face.kind, mesh, palette, textures })
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
        self.write_keyed(clip, None, out)
    }

    /// [`Self::write`], with as few keys as a [`Keying`] allows, and its markers.
    ///
    /// # Errors
    /// As for [`Self::write`].
    pub fn write_keyed<W: Write>(&self, clip: &Clip, keying: Option<&Keying>, out: W) -> io::Result<()> {
        clip.check().map_err(invalid)?;
        if !self.fits(clip) {
            return Err(invalid(OTHER));
        }
        write_checked(&[Member::alone(clip, Some(self))], keying, out)
    }
}

fn write_checked<W: Write>(members: &[Member<'_>], keying: Option<&Keying>, out: W) -> io::Result<()> {
    let mut builder = Builder::default();
    let mut bodies: Vec<Body> = Vec::with_capacity(members.len());
    for (at, member) in members.iter().enumerate() {
        let same = |before: &Member| match (before.figure, member.figure) {
            (Some(a), Some(b)) => std::ptr::eq(a, b),
            _ => false,
        };
        let like = members[..at].iter().position(same).map(|before| &bodies[before]);
        let body = add_body(&mut builder, member, like);
        bodies.push(body);
    }
    let mut tracks = Tracks::new(&mut builder, members[0].clip, keying.map(|keying| keying.bound));
    for (member, body) in members.iter().zip(&bodies) {
        add_tracks(&mut builder, &mut tracks, member, body);
    }
    builder.root.push(tracks.animation);
    let mut roots = Vec::new();
    for (at, (member, body)) in members.iter().zip(&bodies).enumerate() {
        let root = if members.len() == 1 { body.joints[0] } else { add_place(&mut builder, member, body, at == 0) };
        roots.extend([root].into_iter().chain(body.nodes.into_iter().flatten()));
    }
    builder.scene(roots);
    if let Some(keying) = keying {
        builder.mark(keying);
    }
    builder.write(out)
}

/// A member in the file.
struct Body {
    joints: Vec<Index<Node>>,
    helpers: Vec<Index<Node>>,
    skin: Index<json::Skin>,
    /// Meshes and nodes of body and face.
    meshes: Option<[Index<json::Mesh>; 2]>,
    nodes: Option<[Index<Node>; 2]>,
}

/// Adds bones, skin and meshes; all but the bones are shared with a body of the same figure.
fn add_body(builder: &mut Builder, member: &Member<'_>, like: Option<&Body>) -> Body {
    let Member { clip, figure, .. } = *member;
    let of_mesh = figure.map_or(&[][..], |figure| &figure.mesh.helpers);
    let joints = add_skeleton(builder, clip);
    let helpers = add_helpers(builder, clip, of_mesh, &joints);
    let all = [&joints[..], &helpers].concat();
    let skin = match like {
        Some(like) => {
            let matrices = builder.root.skins[like.skin.value()].inverse_bind_matrices;
            push_skin(builder, &all, matrices)
        }
        None => {
            let rest = rest_positions(clip);
            let places: Vec<_> = rest.iter().copied().chain(of_mesh.iter().map(|helper| rest[helper.of])).collect();
            add_skin(builder, &all, &places)
        }
    };
    let meshes = figure.map(|figure| match like.and_then(|like| like.meshes) {
        Some(meshes) => meshes,
        None => {
            let names = clip.face.names.iter();
            let shapes: Vec<_> = names.map(|name| (name.clone(), shapes::shape(name, &figure.mesh))).collect();
            add_surfaces(builder, figure, &shapes)
        }
    });
    let nodes = meshes.map(|meshes| add_skinned(builder, meshes, skin));
    Body { joints, helpers, skin, meshes, nodes }
}

/// Adds the node of a member's place above its bones, and sets its name before the others. The node says which figure
/// the member wears.
fn add_place(builder: &mut Builder, member: &Member<'_>, body: &Body, is_first: bool) -> Index<Node> {
    if !is_first {
        let prefix = |name: &mut Option<String>| {
            let own = name.take().unwrap_or_default();
            *name = Some(format!("{}-{own}", member.name));
        };
        let nodes = body.joints.iter().chain(&body.helpers).chain(body.nodes.iter().flatten());
        nodes.for_each(|node| prefix(&mut builder.root.nodes[node.value()].name));
        prefix(&mut builder.root.skins[body.skin.value()].name);
    }
    let (sine, cosine) = (0.5 * member.facing).sin_cos();
    let figure = member.figure.map(|built| serde_json::json!({ "figure": built.figure.name() }));
    builder.root.push(Node {
        name: Some(member.name.to_owned()),
        translation: Some(member.position),
        rotation: Some(json::scene::UnitQuaternion([0.0, sine, 0.0, cosine])),
        children: Some(vec![body.joints[0]]),
        extras: figure.and_then(|figure| serde_json::value::to_raw_value(&figure).ok()),
        ..Node::default()
    })
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
    let meshes = add_surfaces(builder, figure, shapes);
    add_skinned(builder, meshes, skin)
}

/// Adds the meshes of the figure's body and of its face with these shapes.
fn add_surfaces(builder: &mut Builder, figure: &BuiltFigure, shapes: &[(String, Shape)]) -> [Index<json::Mesh>; 2] {
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
    if !shapes.is_empty() {
        let count = mesh.positions.len() - mesh.head;
        let targets = shapes.iter().map(|(_, shape)| builder.morph_target(shape, count));
        // The head has no relief, so it is one surface.
        front[0].targets = Some(targets.collect());
    }
    let names: Vec<_> = shapes.iter().map(|(name, _)| name.clone()).collect();
    [body, builder.mesh("face", front, &names)]
}

fn add_skinned(
    builder: &mut Builder,
    [body, face]: [Index<json::Mesh>; 2],
    skin: Index<json::Skin>,
) -> [Index<Node>; 2] {
    [builder.skinned("body", body, skin), builder.skinned("face", face, skin)]
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
    let first = builder.root.nodes.len();
    (0..JOINTS)
        .map(|joint| {
            let below: Vec<_> = clip.children(joint).map(|child| builder::index(first + child)).collect();
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
fn add_helpers(builder: &mut Builder, clip: &Clip, helpers: &[Helper], joints: &[Index<Node>]) -> Vec<Index<Node>> {
    let node = |helper: &Helper| {
        let node = builder.root.push(Node {
            name: Some(helper.name.clone()),
            translation: (!helper.is_in_place()).then(|| clip.skeleton.offsets_m[helper.of]),
            ..Node::default()
        });
        builder.root.nodes[joints[helper.hangs_on].value()].children.get_or_insert_default().push(node);
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
    push_skin(builder, joints, Some(matrices))
}

fn push_skin(
    builder: &mut Builder,
    joints: &[Index<Node>],
    matrices: Option<Index<json::Accessor>>,
) -> Index<json::Skin> {
    builder.root.push(json::Skin {
        inverse_bind_matrices: matrices,
        joints: joints.to_vec(),
        skeleton: Some(joints[0]),
        name: Some("skeleton".to_owned()),
        extensions: None,
        extras: None,
    })
}

/// Adds one channel per rotation of a joint or helper joint, one for the root's translation, one for all face
/// weights.
fn add_tracks(builder: &mut Builder, tracks: &mut Tracks, member: &Member<'_>, body: &Body) {
    let Member { clip, figure, .. } = *member;
    let frames = clip.rotations.len();
    for (joint, &node) in body.joints.iter().enumerate() {
        tracks.rotations(builder, node, track(clip, joint));
    }
    for (helper, &node) in figure.iter().flat_map(|figure| &figure.mesh.helpers).zip(&body.helpers) {
        let turns = clip.rotations.iter().map(|frame| helper.local_turn(frame[helper.of]));
        tracks.rotations(builder, node, continuous(turns));
    }
    let places = collected((0..frames).map(|f| clip.root_position(f)));
    tracks.places(builder, body.joints[0], places);
    if let (Some([_, face]), false) = (body.nodes, clip.face.names.is_empty()) {
        tracks.weights(builder, face, &clip.face_values, clip.face.names.len());
    }
}
