//! Assigns face channels to the shapes of a character's meshes.

use umo_core_pose::face::{Face, FaceKind};

use super::expressions::{Expression, expressions};
use super::{Character, Given};
use crate::retarget::face::FaceMap;
use crate::retarget::{Mapping, Retarget, other_bodies};

const JAW: usize = 22;
const EYES: [usize; 2] = [23, 24];

/// Number of shapes of a mouth that has every vowel.
const VOWELS: usize = 5;
/// Hint for messages: the supported sets of shapes.
const SHAPES: &str = "ARKit's 52, the 15 visemes of Oculus or VRM's 5 vowels are known, others with --mapping";

/// Upper bound on the shapes of a mesh.
const MAX_SHAPES: usize = 4096;

/// A node whose mesh has shapes.
#[derive(Clone, Debug)]
struct MeshFace {
    node: usize,
    name: String,
    /// Names of the shapes; empty if they have none.
    shapes: Vec<String>,
    /// `[shapes]`, weights at rest.
    rest: Vec<f32>,
    map: FaceMap,
}

/// The shapes of a character.
#[derive(Clone, Debug, Default)]
pub struct Faces {
    meshes: Vec<MeshFace>,
    /// Expressions and their mapping, if the meshes' shapes have no known names.
    expressions: Option<(Vec<Expression>, FaceMap)>,
    /// Shapes that stay still, with the reason.
    notes: Vec<String>,
}

impl Faces {
    /// Finds the shapes that a face's channels move: by name, by the expressions of a VRM file, and by a mapping
    /// file. Of several characters in one file, only the shapes of the one that `mapping` moves are used.
    ///
    /// # Errors
    /// A channel or shape of the mapping file does not exist, or a mesh has more shapes than are supported.
    pub fn find(character: &Character, mapping: &Mapping, face: &Face, given: &Given) -> Result<Self, String> {
        let document = character.document();
        let is_other = of_others(character, mapping);
        let mut faces = Self::default();
        for (at, node) in document.nodes.iter().enumerate() {
            let Some(mesh) = node.mesh.and_then(|mesh| document.meshes.get(mesh)) else { continue };
            let count = mesh.shapes();
            if count == 0 || is_other[at] {
                continue;
            }
            if count > MAX_SHAPES {
                return Err(format!("mesh of node {at}: {count} shapes, at most {MAX_SHAPES} are taken"));
            }
            let name = mesh.name.clone().or_else(|| node.name.clone()).unwrap_or_else(|| format!("of node {at}"));
            if !mesh.is_even() {
                let counts: Vec<_> = mesh.primitives.iter().map(|part| part.targets.len().to_string()).collect();
                faces.notes.push(format!(
                    "mesh `{name}` stays still: its parts have {} shapes, expected as many",
                    counts.join(" and ")
                ));
                continue;
            }
            let shapes = mesh.shape_names().unwrap_or_else(|| vec![String::new(); count]);
            let rest = [&node.weights, &mesh.weights].into_iter().flatten().find(|weights| weights.len() == count);
            let rest = rest.cloned().unwrap_or_else(|| vec![0.0; count]);
            faces.meshes.push(MeshFace { node: at, name, rest, map: FaceMap::new(face, &shapes), shapes });
        }
        if !faces.meshes.iter().any(|mesh| mesh.map.opens_mouth(face) && mesh.map.plain_mouth().is_none()) {
            faces.use_expressions(expressions(document), face);
        }
        faces.link(face, given)?;
        let unnamed = faces.meshes.iter().filter(|mesh| mesh.shapes.iter().all(String::is_empty));
        let still = unnamed.filter(|mesh| faces.track(mesh).moved == 0);
        let why = |mesh: &MeshFace| {
            let lists = document.nodes[mesh.node].mesh.map(|at| document.meshes[at].shape_lists()).unwrap_or_default();
            let names = lists.first().map_or(0, Vec::len);
            let (name, count) = (&mesh.name, mesh.shapes.len());
            format!("mesh `{name}` stays still: {names} names for its {count} shapes; export it with a name for each")
        };
        let notes: Vec<_> = still.map(why).collect();
        faces.notes.extend(notes);
        Ok(faces)
    }

    /// Replaces the named shapes by expressions, if the expressions open the mouth.
    fn use_expressions(&mut self, expressions: Vec<Expression>, face: &Face) {
        let names: Vec<_> = expressions.iter().map(|expression| expression.name.as_str()).collect();
        let map = FaceMap::new(face, &names);
        if !map.opens_mouth(face) {
            return;
        }
        let moved = map.moved();
        for mesh in &mut self.meshes {
            let of_expressions = moved.iter().flat_map(|&expression| &expressions[expression].shapes);
            for &(_, shape, _) in of_expressions.filter(|(node, ..)| *node == mesh.node) {
                mesh.map.release(shape);
            }
            if let Some(shape) = mesh.map.plain_mouth() {
                mesh.map.release(shape);
            }
        }
        self.expressions = Some((expressions, map));
    }

    /// Applies the mapping file, which overrides the shapes found by name.
    fn link(&mut self, face: &Face, given: &Given) -> Result<(), String> {
        let mut linked: Vec<(usize, usize)> = Vec::new();
        for (channel, name, share) in given.shapes() {
            let mut found = false;
            for (at, mesh) in self.meshes.iter_mut().enumerate() {
                let Some(shape) = mesh.shapes.iter().position(|known| known == name) else { continue };
                found = true;
                if !linked.contains(&(at, shape)) {
                    mesh.map.release(shape);
                    linked.push((at, shape));
                }
                // A face of another kind lacks this channel. Nothing moves then, which a note reports at the end.
                if !mesh.map.link(face, channel, shape, share) && face.kind == FaceKind::Arkit {
                    return Err(format!("the mapping's `{channel}` is not a face channel"));
                }
            }
            if !found {
                let names: Vec<_> = self.meshes.iter().flat_map(|mesh| &mesh.shapes).map(String::as_str).collect();
                return Err(format!("no shape `{name}` for `{channel}`; the shapes are {}", names.join(", ")));
            }
        }
        Ok(())
    }

    /// Releases the bones of jaw and eyes that shapes already turn.
    pub fn release_bones(&self, face: &Face, mapping: &Mapping, retarget: &mut Retarget) {
        let mut release = |joint: usize| {
            if let Some(bone) = mapping.bone(joint) {
                retarget.release(bone);
            }
        };
        if self.opens_mouth(face) {
            release(JAW);
        }
        if self.drives(face, "eyeLookOutLeft") {
            EYES.into_iter().for_each(release);
        }
    }

    /// Whether a shape follows this channel directly.
    pub fn drives(&self, face: &Face, channel: &str) -> bool {
        self.maps().any(|map| map.drives(face, channel))
    }

    /// Whether any shape opens the mouth.
    pub fn opens_mouth(&self, face: &Face) -> bool {
        self.maps().any(|map| map.opens_mouth(face))
    }

    fn maps(&self) -> impl Iterator<Item = &FaceMap> {
        self.meshes.iter().map(|mesh| &mesh.map).chain(self.expressions.iter().map(|(_, map)| map))
    }

    /// Returns the names of the expressions that move, with their weights for a frame's face values.
    pub fn expressions(&self, values: &[f32]) -> impl Iterator<Item = (&str, f32)> {
        self.expressions.iter().flat_map(|(list, map)| {
            let mut amounts = vec![0.0; map.shapes()];
            map.apply(values, &mut amounts);
            map.moved().into_iter().map(move |at| (list[at].name.as_str(), amounts[at]))
        })
    }

    /// Describes the shapes that stay still, and a mouth that does not move or lacks vowels.
    pub fn notes(&self, face: &Face, mapping: &Mapping) -> Vec<String> {
        let mut notes = self.notes.clone();
        if face.kind != FaceKind::Arkit {
            return notes;
        }
        let names = |map: &FaceMap, names: &dyn Fn(usize) -> String| -> Vec<String> {
            map.speaking().into_iter().map(names).collect()
        };
        let of_meshes = self.meshes.iter().map(|mesh| names(&mesh.map, &|shape| mesh.shapes[shape].clone()));
        let of_expressions = self.expressions.iter().map(|(list, map)| names(map, &|at| list[at].name.clone()));
        let most = of_meshes.chain(of_expressions).max_by_key(Vec::len).unwrap_or_default();
        if !self.opens_mouth(face) {
            let jaw = mapping.bone(JAW).is_some();
            let by = if jaw { "its mouth moves by the jaw bone only" } else { "its mouth cannot move" };
            notes.push(format!("{by}: no shape that opens it has a known name; {SHAPES}"));
        } else if !self.drives(face, "jawOpen") && most.len() < VOWELS {
            notes.push(format!("its mouth moves by {} only; {SHAPES}", most.join(", ")));
        }
        notes
    }

    /// Returns the channels of a face that directly move a shape.
    pub fn driven<'a>(&self, face: &'a Face) -> Vec<&'a str> {
        let is_driven = |name: &&String| self.meshes.iter().any(|mesh| mesh.map.drives(face, name));
        face.names.iter().filter(is_driven).map(String::as_str).collect()
    }

    /// Names of all shapes.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.meshes.iter().flat_map(|mesh| &mesh.shapes).map(String::as_str)
    }

    /// Number of shapes that move.
    pub fn moved(&self) -> usize {
        self.tracks().iter().map(|track| track.moved).sum()
    }

    /// Number of all shapes.
    pub fn shapes(&self) -> usize {
        self.meshes.iter().map(|mesh| mesh.shapes.len()).sum()
    }

    /// Returns the nodes whose shapes move.
    pub fn tracks(&self) -> Vec<Track<'_>> {
        self.meshes.iter().map(|mesh| self.track(mesh)).filter(|track| track.moved > 0).collect()
    }

    fn track<'a>(&'a self, mesh: &'a MeshFace) -> Track<'a> {
        let expressions = self.expressions.as_ref();
        let mut shares = Vec::new();
        if let Some((list, map)) = expressions {
            for at in map.moved() {
                let here = list[at].shapes.iter().filter(|(node, ..)| *node == mesh.node);
                shares.extend(here.map(|&(_, shape, share)| (at, shape, share)));
            }
        }
        let mut moved = mesh.map.moved();
        moved.extend(shares.iter().map(|(_, shape, _)| *shape));
        moved.sort_unstable();
        moved.dedup();
        Track { mesh, expressions: expressions.map(|(_, map)| map), shares, moved: moved.len() }
    }

    /// Lists the shapes that move with their causes, one per line.
    pub fn list(&self, face: &Face) -> Vec<String> {
        let mut lines = Vec::new();
        for mesh in &self.meshes {
            lines.push(format!("shapes of `{}`", mesh.name));
            let moved = mesh.map.moved();
            lines.extend(moved.iter().map(|&at| format!("  {:<24} {}", mesh.shapes[at], mesh.map.cause(face, at))));
            let still = mesh.shapes.len() - moved.len();
            lines.push(format!("  {still} of {} have no channel", mesh.shapes.len()));
        }
        if let Some((expressions, map)) = &self.expressions {
            lines.push("VRM expressions".to_owned());
            let moved = map.moved().into_iter();
            lines.extend(moved.map(|at| format!("  {:<24} {}", expressions[at].name, map.cause(face, at))));
        }
        lines
    }
}

/// A node whose shapes move.
pub struct Track<'a> {
    mesh: &'a MeshFace,
    expressions: Option<&'a FaceMap>,
    /// Expression, shape, and the shape's weight when the expression is 1.
    shares: Vec<(usize, usize, f32)>,
    /// Number of shapes that move.
    moved: usize,
}

impl Track<'_> {
    /// The node.
    pub fn node(&self) -> usize {
        self.mesh.node
    }

    /// Number of shapes of the mesh.
    pub fn len(&self) -> usize {
        self.mesh.rest.len()
    }

    /// Shapes that face channels move directly; expressions may move others.
    pub fn moved(&self) -> Vec<usize> {
        self.mesh.map.moved()
    }

    /// Returns the weights of all shapes for a frame's face values; shapes that do not move keep their rest weight.
    pub fn weights(&self, values: &[f32]) -> Vec<f32> {
        let mut weights = self.mesh.rest.clone();
        if let Some(map) = self.expressions {
            let mut amounts = vec![0.0; map.shapes()];
            map.apply(values, &mut amounts);
            self.shares.iter().for_each(|&(_, shape, _)| weights[shape] = 0.0);
            for &(expression, shape, share) in &self.shares {
                weights[shape] = (weights[shape] + share * amounts[expression]).clamp(0.0, 1.0);
            }
        }
        self.mesh.map.apply(values, &mut weights);
        weights
    }
}

/// For each node, whether it belongs to a character other than the one that `mapping` moves.
fn of_others(character: &Character, mapping: &Mapping) -> Vec<bool> {
    let (rig, document) = (character.rig(), character.document());
    let others = other_bodies(rig, mapping);
    let is_other = |node: usize| others.iter().any(|&top| rig.is_below(node, top));
    let joint = |node: usize| document.nodes[node].skin.and_then(|skin| document.skins.get(skin)?.joints.first());
    (0..document.nodes.len()).map(|node| is_other(node) || joint(node).is_some_and(|&joint| is_other(joint))).collect()
}
