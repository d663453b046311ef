//! A picture of a motion on the figure and on a character: some moments beside one another.

use glam::{Mat3, Mat4, Quat, Vec3};
use serde::Deserialize;
use umo_core::config::FaceKind;
use umo_core::glb::Glb;
use umo_core::glb::accessor::{floats, numbers, view_bytes};
use umo_core::glb::document::Document;
use umo_core::motion::clip::Clip;
use umo_core::motion::skeleton::ARKIT_NAMES;
use umo_core::retarget::{Mapping, Retarget};
use umo_figure::Figure;
use umo_figure::picture::surface::{Cover, Surface, Texture};
use umo_figure::picture::{Camera, Frame, Picture};

use super::{Character, Faces, Motion};

/// Moments of the motion, spread over it.
const MOMENTS: usize = 6;
/// Pixels of a body and of a head.
const BODY: [usize; 2] = [220, 330];
const HEAD: [usize; 2] = [220, 220];

const HEAD_JOINT: usize = 15;

/// Draws the sheet: for each moment the figure, the character, and the character's head.
///
/// # Errors
/// What of the character's surfaces is not as the format has it, or is compressed.
pub(super) fn draw(
    character: &Character,
    mapping: &Mapping,
    retarget: &Retarget,
    motion: &Motion,
    faces: &Faces,
    clip: &Clip,
) -> Result<Picture, String> {
    let stage = Stage::read(character, mapping)?;
    let mesh = Figure::default().mesh(&clip.skeleton).map_err(|error| error.to_string())?;
    let mesh = if clip.face.kind == FaceKind::Arkit { mesh } else { mesh.on_the_jaw() };
    let mut picture = Picture::new(MOMENTS * BODY[0], 2 * BODY[1] + HEAD[1]);
    for moment in 0..MOMENTS {
        let frame = (2 * moment + 1) * clip.len().saturating_sub(1) / (2 * MOMENTS);
        let left = moment * BODY[0];
        draw_figure(&mut picture, &mesh, clip, frame, [left, 0, BODY[0], BODY[1]]);
        let world = stage.world(character, retarget, motion, frame);
        let surfaces = stage.surfaces(&world, faces, clip, frame);
        let (body, head) = stage.cameras(&world, &surfaces);
        for (camera, [top, height]) in [(body, [BODY[1], BODY[1]]), (head, [2 * BODY[1], HEAD[1]])] {
            let place: Frame = [left, top, BODY[0], height];
            surfaces.iter().for_each(|surface| picture.draw_surface(surface, camera, place));
        }
    }
    Ok(picture)
}

/// The motion as it was made, on the figure.
fn draw_figure(picture: &mut Picture, mesh: &umo_figure::Mesh, clip: &Clip, frame: usize, place: Frame) {
    let value = |name: &&str| clip.face.names.iter().position(|known| known == name);
    let face = clip.face(frame);
    let weights: Vec<f32> = ARKIT_NAMES.iter().map(|name| value(name).map_or(0.0, |at| face[at])).collect();
    let posed = mesh.posed(&clip.skeleton, &clip.rotations[frame], clip.translation[frame], &weights);
    let target: [f32; 3] = std::array::from_fn(|i| clip.skeleton.offsets_m[0][i] + clip.translation[frame][i]);
    let target = [target[0], target[1] - 0.1, target[2]];
    let camera = Camera { eye: [target[0] + 1.2, target[1] + 0.25, target[2] + 3.8], target, height: 1.95 };
    picture.draw(mesh, &posed, camera, place);
}

/// What of a file's JSON only pictures need.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Looks {
    meshes: Vec<Mesh>,
    materials: Vec<Material>,
    textures: Vec<TextureOf>,
    images: Vec<Image>,
    extensions_required: Vec<String>,
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
struct Material {
    pbr_metallic_roughness: Metallic,
    alpha_mode: Option<String>,
    alpha_cutoff: Option<f32>,
    double_sided: bool,
}

#[derive(Clone, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Metallic {
    base_color_factor: Option<[f32; 4]>,
    base_color_texture: Option<Index>,
}

#[derive(Clone, Deserialize)]
struct Index {
    index: usize,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct TextureOf {
    source: Option<usize>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Image {
    buffer_view: Option<usize>,
}

/// A node's place and rotation, where they are not as at rest.
type Moved = (Option<[f32; 3]>, Option<[f32; 4]>);

/// A part of the character's surface at rest.
struct Part {
    node: usize,
    skin: Option<usize>,
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uv: Vec<[f32; 2]>,
    /// Four joints of the skin, and their shares; empty where the node alone moves it.
    bones: Vec<([usize; 4], [f32; 4])>,
    indices: Vec<u32>,
    /// What each shape moves positions and normals by.
    shapes: Vec<(Vec<Vec3>, Vec<Vec3>)>,
    rest: Vec<f32>,
    material: Material,
}

/// A character before the camera.
struct Stage {
    parts: Vec<Part>,
    /// Each skin's joints, and what brings the mesh's space to theirs.
    skins: Vec<Vec<(usize, Mat4)>>,
    /// By image.
    textures: Vec<Option<Texture>>,
    /// By texture, the image.
    sources: Vec<Option<usize>>,
    /// Nodes that are shown.
    shown: Vec<bool>,
    /// Where it looks, level, and where its head is; at rest.
    ahead: Vec3,
    head: Option<usize>,
    /// The lowest and the highest of it at rest.
    extent: [f32; 2],
}

impl Stage {
    fn read(character: &Character, mapping: &Mapping) -> Result<Self, String> {
        let file = Glb::split(character.bytes())?;
        let looks: Looks = serde_json::from_str(file.json).map_err(|error| error.to_string())?;
        let draco = "KHR_draco_mesh_compression";
        if looks.extensions_required.iter().any(|name| name == draco) {
            return Err(format!("its meshes are compressed in a way that a sheet does not read, {draco}"));
        }
        let document = character.document();
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
            return Err("it has bones and no body: there is no mesh to draw".to_owned());
        }
        // What lets light through is drawn over what does not.
        parts.sort_by_key(|part| part.material.alpha_mode.as_deref() == Some("BLEND"));
        let skins = document.skins.iter().map(|skin| {
            let matrices = skin.inverse_bind_matrices.map(|at| floats(document, file.bin, at, "MAT4")).transpose()?;
            let matrices = matrices.unwrap_or_default();
            let (matrices, _) = matrices.as_chunks::<16>();
            let matrix = |at: usize| matrices.get(at).map_or(Mat4::IDENTITY, Mat4::from_cols_array);
            Ok(skin.joints.iter().enumerate().map(|(at, &joint)| (joint, matrix(at))).collect())
        });
        let picture = |image: &Image| decoded(view_bytes(document, file.bin, image.buffer_view?).ok()?);
        let mut stage = Self {
            skins: skins.collect::<Result<_, String>>()?,
            textures: looks.images.iter().map(picture).collect(),
            sources: looks.textures.iter().map(|texture| texture.source).collect(),
            shown: shown(document, &looks),
            ahead: ahead(character, mapping),
            head: mapping.bone(HEAD_JOINT),
            extent: [0.0, 1.0],
            parts,
        };
        let rest = places(character, &|_| (None, None));
        let heights = stage.parts.iter().filter(|part| stage.shown[part.node]).flat_map(|part| {
            let (positions, _) = stage.posed(part, &rest, &part.rest);
            positions.into_iter().map(|position| position.y)
        });
        let (low, high) = heights.fold((f32::MAX, f32::MIN), |(low, high), y| (low.min(y), high.max(y)));
        if high > low && (high - low).is_finite() {
            stage.extent = [low, high];
        }
        Ok(stage)
    }

    /// Where every node is in a frame.
    fn world(&self, character: &Character, retarget: &Retarget, motion: &Motion, frame: usize) -> Vec<Mat4> {
        let moved = |node: usize| {
            let place = motion.hips.get(frame).filter(|_| node == retarget.hips()).copied();
            let turn = motion.rotations.get(frame).filter(|_| retarget.is_driven(node)).map(|row| row[node]);
            (place, turn)
        };
        places(character, &moved)
    }

    /// The surfaces where they are in a frame.
    fn surfaces(&self, world: &[Mat4], faces: &Faces, clip: &Clip, frame: usize) -> Vec<Surface<'_>> {
        let tracks = faces.tracks();
        let surface = |part: &'_ Part| {
            let track = tracks.iter().find(|track| track.node() == part.node);
            let weights = track.map_or_else(|| part.rest.clone(), |track| track.weights(clip.face(frame)));
            let (positions, normals) = self.posed(part, world, &weights);
            let metallic = &part.material.pbr_metallic_roughness;
            let image = metallic.base_color_texture.as_ref().and_then(|texture| *self.sources.get(texture.index)?);
            (positions, normals, image)
        };
        let shown = self.parts.iter().filter(|part| self.shown[part.node]);
        let drawn = shown.map(|part| {
            let (positions, normals, image) = surface(part);
            Surface {
                positions: positions.into_iter().map(Vec3::into).collect(),
                normals: normals.into_iter().map(Vec3::into).collect(),
                uv: part.uv.clone(),
                indices: part.indices.clone(),
                color: part.material.pbr_metallic_roughness.base_color_factor.unwrap_or([1.0; 4]),
                texture: image.and_then(|image| self.textures.get(image)?.as_ref()),
                cover: match part.material.alpha_mode.as_deref() {
                    Some("MASK") => Cover::Cut(part.material.alpha_cutoff.unwrap_or(0.5)),
                    Some("BLEND") => Cover::Clear,
                    _ => Cover::Solid,
                },
                is_double: part.material.double_sided,
            }
        });
        drawn.collect()
    }

    /// A part's positions and normals.
    fn posed(&self, part: &Part, world: &[Mat4], weights: &[f32]) -> (Vec<Vec3>, Vec<Vec3>) {
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

    /// The whole body, and the head, where they are now.
    fn cameras(&self, world: &[Mat4], surfaces: &[Surface]) -> (Camera, Camera) {
        let [low, high] = self.extent;
        let (mut least, mut most) = (Vec3::MAX, Vec3::MIN);
        for position in surfaces.iter().flat_map(|surface| &surface.positions) {
            let position = Vec3::from_array(*position);
            (least, most) = (least.min(position), most.max(position));
        }
        let size = 1.1 * (high - low);
        let middle = 0.5 * (least + most);
        let body = Vec3::new(middle.x, 0.5 * (low + high), middle.z);
        // Somewhat from its left, as the figure is seen.
        let side = Vec3::Y.cross(self.ahead);
        let from = (0.3 * side + self.ahead + 0.06 * Vec3::Y).normalize();
        let camera = |target: Vec3, height: f32| Camera {
            eye: (target + 2.2 * size * from).into(),
            target: target.into(),
            height,
        };
        let head = self.head.and_then(|head| world.get(head)).map_or(body, |head| head.w_axis.truncate());
        let crown = (high - head.y).clamp(0.06 * (high - low), 0.24 * (high - low));
        (camera(body, size), camera(head + 0.35 * crown * Vec3::Y, 2.4 * crown))
    }
}

/// Where every node is: its rest, and what of it is elsewhere.
fn places(character: &Character, moved: &dyn Fn(usize) -> Moved) -> Vec<Mat4> {
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
    /// None where it has no positions.
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

/// Normals of a surface that brings none.
fn flat(positions: &[Vec3], indices: &[u32]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in indices.as_chunks::<3>().0 {
        let corners = triangle.map(|corner| positions.get(corner as usize).copied());
        let [Some(a), Some(b), Some(c)] = corners else { continue };
        triangle.iter().for_each(|&corner| normals[corner as usize] += (b - a).cross(c - a));
    }
    normals.into_iter().map(Vec3::normalize_or_zero).collect()
}

/// Nodes of the scene that a viewer shows: all where there is none.
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

/// Where the character looks at rest, level; ahead of the file where it has no sides.
fn ahead(character: &Character, mapping: &Mapping) -> Vec3 {
    let place = |joint: usize| mapping.bone(joint).map(|bone| Vec3::from_array(character.rig().place(bone)));
    let pairs = [(16, 17), (1, 2), (23, 24)].into_iter();
    let side = pairs.filter_map(|(left, right)| Some(place(left)? - place(right)?)).next();
    let ahead = side.map(|side| side.cross(Vec3::Y).normalize_or_zero()).filter(|ahead| *ahead != Vec3::ZERO);
    ahead.unwrap_or(Vec3::Z)
}

/// A PNG or JPEG picture; none where it is of another kind or damaged.
fn decoded(bytes: &[u8]) -> Option<Texture> {
    if bytes.starts_with(b"\x89PNG") { png_texture(bytes) } else { jpeg_texture(bytes) }
}

fn png_texture(bytes: &[u8]) -> Option<Texture> {
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().ok()?;
    let mut pixels = vec![0; reader.output_buffer_size()?];
    let info = reader.next_frame(&mut pixels).ok()?;
    let channels = info.color_type.samples();
    let pixel = |row: &[u8]| match *row {
        [grey] => [grey, grey, grey, 255],
        [grey, cover] => [grey, grey, grey, cover],
        [r, g, b] => [r, g, b, 255],
        [r, g, b, cover, ..] => [r, g, b, cover],
        [] => [255; 4],
    };
    let pixels: Vec<_> = pixels[..info.buffer_size()].chunks_exact(channels).map(pixel).collect();
    Texture::new(info.width as usize, info.height as usize, &pixels)
}

fn jpeg_texture(bytes: &[u8]) -> Option<Texture> {
    let mut decoder = zune_jpeg::JpegDecoder::new(bytes);
    let pixels = decoder.decode().ok()?;
    let (width, height) = decoder.dimensions()?;
    let channels = pixels.len().checked_div(width.checked_mul(height)?)?;
    let pixel = |row: &[u8]| match *row {
        [r, g, b, ..] => [r, g, b, 255],
        [grey, ..] => [grey, grey, grey, 255],
        [] => [255; 4],
    };
    let pixels: Vec<_> = pixels.chunks_exact(channels.max(1)).map(pixel).collect();
    Texture::new(width, height, &pixels)
}
