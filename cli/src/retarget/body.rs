//! A character's surfaces, read for pictures and measurements.

use glam::{Mat3, Mat4, Quat, Vec3};
use serde::Deserialize;
use umo_core::Mapping;
use umo_core_rig::glb::Glb;
use umo_core_rig::glb::accessor::{floats, numbers};
use umo_core_rig::glb::document::Document;

use super::Character;

/// Joints at the ankles.
const ANKLES: [usize; 2] = [7, 8];

/// The parts of a file's JSON that only surfaces need.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Looks {
    meshes: Vec<Mesh>,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<TextureOf>,
    pub(super) images: Vec<Image>,
    scene: usize,
    scenes: Vec<Scene>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Scene {
    nodes: Vec<usize>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    material: Option<usize>,
    #[serde(default = "triangles")]
    mode: u32,
    #[serde(default)]
    targets: Vec<Shape>,
}

fn triangles() -> u32 {
    4
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE", default)]
struct Attributes {
    position: Option<usize>,
    normal: Option<usize>,
    #[serde(rename = "TEXCOORD_0")]
    uv: Option<usize>,
    #[serde(rename = "JOINTS_0")]
    joints: Option<usize>,
    #[serde(rename = "WEIGHTS_0")]
    weights: Option<usize>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE", default)]
struct Shape {
    position: Option<usize>,
    normal: Option<usize>,
}

#[derive(Clone, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Material {
    pub(super) pbr_metallic_roughness: Metallic,
    pub(super) alpha_mode: Option<String>,
    pub(super) alpha_cutoff: Option<f32>,
    pub(super) double_sided: bool,
}

#[derive(Clone, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Metallic {
    pub(super) base_color_factor: Option<[f32; 4]>,
    pub(super) base_color_texture: Option<Index>,
}

#[derive(Clone, Deserialize)]
pub(super) struct Index {
    pub(super) index: usize,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct TextureOf {
    pub(super) source: Option<usize>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Image {
    pub(super) buffer_view: Option<usize>,
}

/// A node's translation and rotation; `None` if as at rest.
pub(super) type Moved = (Option<[f32; 3]>, Option<[f32; 4]>);

/// A part of the character's surface at rest.
pub(super) struct Part {
    pub(super) node: usize,
    skin: Option<usize>,
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    pub(super) uv: Vec<[f32; 2]>,
    /// Four joints of the skin and their weights per vertex; empty if the node alone moves the part.
    bones: Vec<([usize; 4], [f32; 4])>,
    pub(super) indices: Vec<u32>,
    /// Offsets of positions and normals per shape.
    shapes: Vec<(Vec<Vec3>, Vec<Vec3>)>,
    pub(super) rest: Vec<f32>,
    pub(super) material: Material,
}

/// A character's surfaces at rest.
pub(super) struct Body {
    parts: Vec<Part>,
    /// Joints of each skin, with the inverse bind matrices.
    skins: Vec<Vec<(usize, Mat4)>>,
    /// Whether each node is shown.
    shown: Vec<bool>,
    pub(super) looks: Looks,
}

impl Body {
    /// Reads the surfaces of a character; includes blendshapes if `shapes`.
    ///
    /// # Errors
    /// If a surface violates the format or is compressed, or if the file has no surface.
    pub(super) fn read(character: &Character, shapes: bool) -> Result<Self, String> {
        let file = Glb::split(character.bytes())?;
        let mut looks: Looks = serde_json::from_str(file.json).map_err(|error| error.to_string())?;
        let document = character.document();
        if !shapes {
            looks.meshes.iter_mut().flat_map(|mesh| &mut mesh.primitives).for_each(|part| part.targets.clear());
        }
        let mut parts = Vec::new();
        for (at, node) in document.nodes.iter().enumerate() {
            let Some(mesh) = node.mesh else { continue };
            let primitives = looks.meshes.get(mesh).map_or(&[][..], |mesh| &mesh.primitives);
            let weights = node.weights.clone().or_else(|| document.meshes.get(mesh)?.weights.clone());
            for primitive in primitives.iter().filter(|primitive| primitive.mode == 4) {
                let material = primitive.material.and_then(|at| looks.materials.get(at)).cloned().unwrap_or_default();
                let part = Part::read(document, file.bin, primitive, node.skin);
                let part = part.map_err(|error| format!("mesh {mesh}: {error}"))?;
                let rest = weights.clone().unwrap_or_default();
                parts.extend(part.map(|part| Part { node: at, rest, material, ..part }));
            }
        }
        if parts.is_empty() {
            return Err("it has bones and no body: it lacks a mesh".to_owned());
        }
        // Translucent parts are drawn after opaque ones.
        parts.sort_by_key(|part| part.material.alpha_mode.as_deref() == Some("BLEND"));
        let skins = document.skins.iter().map(|skin| {
            let matrices = skin.inverse_bind_matrices.map(|at| floats(document, file.bin, at, "MAT4")).transpose()?;
            let matrices = matrices.unwrap_or_default();
            let (matrices, _) = matrices.as_chunks::<16>();
            let matrix = |at: usize| matrices.get(at).map_or(Mat4::IDENTITY, Mat4::from_cols_array);
            Ok(skin.joints.iter().enumerate().map(|(at, &joint)| (joint, matrix(at))).collect())
        });
        let skins = skins.collect::<Result<_, String>>()?;
        Ok(Self { parts, skins, shown: shown(document, &looks), looks })
    }

    /// Returns the surfaces that are shown.
    pub(super) fn parts(&self) -> impl Iterator<Item = &Part> {
        self.parts.iter().filter(|part| self.shown[part.node])
    }

    /// Returns the lowest and highest Y of the surfaces at rest; `None` if their height is zero.
    pub(super) fn extent(&self, character: &Character) -> Option<[f32; 2]> {
        let rest = places(character, &|_| (None, None));
        let heights = self.parts().flat_map(|part| self.posed(part, &rest, &part.rest).0.into_iter().map(|at| at.y));
        let (low, high) = heights.fold((f32::MAX, f32::MIN), |(low, high), y| (low.min(y), high.max(y)));
        (high > low && (high - low).is_finite()).then_some([low, high])
    }

    /// Returns the lowest Y of the vertices that move with the feet, at rest; `None` if there are none.
    pub(super) fn soles(&self, character: &Character, mapping: &Mapping) -> Option<f32> {
        let rig = character.rig();
        let ankles: Vec<usize> = ANKLES.into_iter().filter_map(|joint| mapping.bone(joint)).collect();
        let of_foot: Vec<bool> =
            (0..rig.len()).map(|bone| ankles.iter().any(|&ankle| rig.is_below(bone, ankle))).collect();
        let rest = places(character, &|_| (None, None));
        let mut lowest: Option<f32> = None;
        for part in self.parts() {
            let joints = part.skin.and_then(|skin| self.skins.get(skin)).map_or(&[][..], Vec::as_slice);
            let bone = |vertex: usize| {
                let Some((bones, shares)) = part.bones.get(vertex) else { return Some(part.node) };
                let most = (0..4).reduce(|most, k| if shares[k] > shares[most] { k } else { most })?;
                joints.get(bones[most]).map(|(joint, _)| *joint)
            };
            if !(0..part.positions.len()).any(|vertex| bone(vertex).is_some_and(|bone| of_foot[bone])) {
                continue;
            }
            let (positions, _) = self.posed(part, &rest, &part.rest);
            let of_feet = positions.iter().enumerate().filter(|(at, _)| bone(*at).is_some_and(|bone| of_foot[bone]));
            lowest = of_feet.map(|(_, at)| at.y).chain(lowest).reduce(f32::min);
        }
        lowest.filter(|lowest| lowest.is_finite())
    }

    /// Returns a part's posed positions and normals.
    pub(super) fn posed(&self, part: &Part, world: &[Mat4], weights: &[f32]) -> (Vec<Vec3>, Vec<Vec3>) {
        let (mut positions, mut normals) = (part.positions.clone(), part.normals.clone());
        for ((moved, turned), &weight) in part.shapes.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            positions.iter_mut().zip(moved).for_each(|(position, &by)| *position += weight * by);
            normals.iter_mut().zip(turned).for_each(|(normal, &by)| *normal += weight * by);
        }
        let skin = self.skin_of(part);
        let matrices: Vec<Mat4> = skin.map_or_else(Vec::new, |skin| {
            skin.iter().map(|&(joint, bind)| world.get(joint).map_or(bind, |joint| *joint * bind)).collect()
        });
        for (vertex, (position, normal)) in positions.iter_mut().zip(&mut normals).enumerate() {
            let matrix = match part.bones.get(vertex).filter(|_| !matrices.is_empty()) {
                Some((joints, shares)) => {
                    let of = |k: usize| matrices.get(joints[k]).map_or(Mat4::ZERO, |matrix| *matrix * shares[k]);
                    of(0) + of(1) + of(2) + of(3)
                }
                None => world[part.node],
            };
            *position = matrix.transform_point3(*position);
            *normal = (Mat3::from_mat4(matrix) * *normal).normalize_or_zero();
        }
        (positions, normals)
    }

    fn skin_of(&self, part: &Part) -> Option<&[(usize, Mat4)]> {
        part.skin.and_then(|skin| self.skins.get(skin)).map(Vec::as_slice)
    }
}

/// Returns every node's world matrix, from its rest transform with the overrides of `moved`.
pub(super) fn places(character: &Character, moved: &dyn Fn(usize) -> Moved) -> Vec<Mat4> {
    let bones = character.rig().bones();
    let mut world: Vec<Option<Mat4>> = vec![None; bones.len()];
    for node in 0..bones.len() {
        let mut waiting = vec![node];
        while let Some(&at) = waiting.last() {
            match bones[at].parent.filter(|&parent| world[parent].is_none()) {
                Some(parent) => waiting.push(parent),
                None => {
                    let bone = &bones[at];
                    let (place, turn) = moved(at);
                    let local = Mat4::from_scale_rotation_translation(
                        Vec3::from_array(bone.scale),
                        Quat::from_array(turn.unwrap_or(bone.rotation)).normalize(),
                        Vec3::from_array(place.unwrap_or(bone.translation)),
                    );
                    let above = bone.parent.and_then(|parent| world[parent]);
                    world[at] = Some(above.map_or(local, |above| above * local));
                    waiting.pop();
                }
            }
        }
    }
    world.into_iter().map(Option::unwrap_or_default).collect()
}

impl Part {
    /// Reads a part; `None` if it has no positions.
    fn read(
        document: &Document,
        bin: &[u8],
        primitive: &Primitive,
        skin: Option<usize>,
    ) -> Result<Option<Self>, String> {
        let Some(position) = primitive.attributes.position else { return Ok(None) };
        let vectors = |at: usize| -> Result<Vec<Vec3>, String> {
            let (values, _) = numbers(document, bin, at, &["VEC3"])?;
            Ok(values.as_chunks::<3>().0.iter().copied().map(Vec3::from_array).collect())
        };
        let positions = vectors(position)?;
        let count = positions.len();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers of one list")]
        let indices: Vec<u32> = match primitive.indices {
            Some(at) => numbers(document, bin, at, &["SCALAR"])?.0.into_iter().map(|x| x as u32).collect(),
            None => (0..count).map(|x| x as u32).collect(),
        };
        let normals = match primitive.attributes.normal {
            Some(at) => vectors(at)?,
            None => flat(&positions, &indices),
        };
        let uv = match primitive.attributes.uv {
            Some(at) => numbers(document, bin, at, &["VEC2"])?.0.as_chunks().0.to_vec(),
            None => Vec::new(),
        };
        let mut bones = Vec::new();
        if let (Some(_), Some(joints), Some(weights)) =
            (skin, primitive.attributes.joints, primitive.attributes.weights)
        {
            let (joints, weights) =
                (numbers(document, bin, joints, &["VEC4"])?.0, numbers(document, bin, weights, &["VEC4"])?.0);
            let rows = joints.as_chunks::<4>().0.iter().zip(weights.as_chunks::<4>().0);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers of one list")]
            let row = |(joints, weights): (&[f32; 4], &[f32; 4])| {
                let sum: f32 = weights.iter().sum();
                let shares = if sum > 0.0 { weights.map(|weight| weight / sum) } else { [1.0, 0.0, 0.0, 0.0] };
                (joints.map(|joint| joint as usize), shares)
            };
            bones = rows.map(row).collect();
        }
        let nothing = || vec![Vec3::ZERO; count];
        let shape = |shape: &Shape| {
            let of = |at: Option<usize>| at.map_or_else(|| Ok(nothing()), vectors);
            Ok((of(shape.position)?, of(shape.normal)?))
        };
        let shapes = primitive.targets.iter().map(shape).collect::<Result<_, String>>()?;
        let (rest, material) = (Vec::new(), Material::default());
        Ok(Some(Self { node: 0, skin, positions, normals, uv, bones, indices, shapes, rest, material }))
    }
}

/// Computes vertex normals of a surface that has none.
fn flat(positions: &[Vec3], indices: &[u32]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in indices.as_chunks::<3>().0 {
        let corners = triangle.map(|corner| positions.get(corner as usize).copied());
        let [Some(a), Some(b), Some(c)] = corners else { continue };
        triangle.iter().for_each(|&corner| normals[corner as usize] += (b - a).cross(c - a));
    }
    normals.into_iter().map(Vec3::normalize_or_zero).collect()
}

/// Returns whether each node belongs to the scene; true for all if the file has no scene.
fn shown(document: &Document, looks: &Looks) -> Vec<bool> {
    let Some(scene) = looks.scenes.get(looks.scene) else { return vec![true; document.nodes.len()] };
    let mut shown = vec![false; document.nodes.len()];
    let mut waiting = scene.nodes.clone();
    while let Some(node) = waiting.pop() {
        if let Some(slot) = shown.get_mut(node).filter(|slot| !**slot) {
            *slot = true;
            waiting.extend(&document.nodes[node].children);
        }
    }
    shown
}
