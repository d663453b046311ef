//! A picture of a motion on the figure and on a character: several moments side by side.

use glam::{Mat4, Vec3};
use umo_core::{ARKIT_NAMES, FaceKind, Mapping, Outline, Retarget, Volume};
use umo_core_pose::clip::Clip;
use umo_core_rig::glb::Glb;
use umo_core_rig::glb::accessor::view_bytes;
use umo_figure::Figure;
use umo_figure::picture::surface::{Cover, Surface, Texture};
use umo_figure::picture::{Camera, Frame, Picture};

use super::body::{Body, Image, Part, places};
use super::{Character, Faces, Motion};

/// Number of moments, evenly spread over the motion.
const MOMENTS: usize = 6;
/// Sizes of the pictures of a body and of a head, pixels.
const BODY: [usize; 2] = [220, 330];
const HEAD: [usize; 2] = [220, 220];

/// Colour of the outlines of a body's volume, sRGB.
const OUTLINE: [u8; 3] = [214, 60, 130];

const HEAD_JOINT: usize = 15;

/// Draws the sheet: for each moment the figure, the character, and the character's head; over the character, the
/// outlines of its volume if it has one.
///
/// # Errors
/// If a surface of the character violates the format or is compressed.
pub(super) fn draw(
    character: &Character,
    mapping: &Mapping,
    retarget: &Retarget,
    motion: &Motion,
    faces: &Faces,
    clip: &Clip,
    volume: Option<&Volume>,
) -> Result<Picture, String> {
    let outlines = volume.map_or_else(Vec::new, |volume| volume.outlines(character.rig(), mapping));
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
            let lines = outlines.iter().map(|line| posed(line, character, &world));
            lines.for_each(|line| picture.draw_line(&line, OUTLINE, camera, place));
        }
    }
    Ok(picture)
}

/// Draws the original motion on the figure.
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

/// A line where its bones are.
fn posed(line: &Outline, character: &Character, world: &[Mat4]) -> Vec<[f32; 3]> {
    let rig = character.rig();
    let place = |&(bone, at): &(usize, [f32; 3])| {
        let (_, turned, moved) = world[bone].to_scale_rotation_translation();
        let turn = turned * glam::Quat::from_array(rig.rotation(bone)).inverse();
        (moved + turn * (Vec3::from_array(at) - Vec3::from_array(rig.place(bone)))).to_array()
    };
    line.iter().map(place).collect()
}

/// A character prepared for drawing.
struct Stage {
    body: Body,
    /// Decoded textures, by image.
    textures: Vec<Option<Texture>>,
    /// Image of each texture.
    sources: Vec<Option<usize>>,
    /// Horizontal facing direction at rest.
    ahead: Vec3,
    head: Option<usize>,
    /// Lowest and highest Y at rest.
    extent: [f32; 2],
}

impl Stage {
    fn read(character: &Character, mapping: &Mapping) -> Result<Self, String> {
        let file = Glb::split(character.bytes())?;
        let body = Body::read(character, true)?;
        let document = character.document();
        let picture = |image: &Image| decoded(view_bytes(document, file.bin, image.buffer_view?).ok()?);
        Ok(Self {
            textures: body.looks.images.iter().map(picture).collect(),
            sources: body.looks.textures.iter().map(|texture| texture.source).collect(),
            ahead: ahead(character, mapping),
            head: mapping.bone(HEAD_JOINT),
            extent: body.extent(character).unwrap_or([0.0, 1.0]),
            body,
        })
    }

    /// Returns the world matrix of every node in a frame.
    fn world(&self, character: &Character, retarget: &Retarget, motion: &Motion, frame: usize) -> Vec<Mat4> {
        let moved = |node: usize| {
            let place = motion.hips.get(frame).filter(|_| node == retarget.hips()).copied();
            let turn = motion.rotations.get(frame).filter(|_| retarget.is_driven(node)).map(|row| row[node]);
            (place, turn)
        };
        places(character, &moved)
    }

    /// Returns the posed surfaces of a frame.
    fn surfaces(&self, world: &[Mat4], faces: &Faces, clip: &Clip, frame: usize) -> Vec<Surface<'_>> {
        let tracks = faces.tracks();
        let surface = |part: &'_ Part| {
            let track = tracks.iter().find(|track| track.node() == part.node);
            let weights = track.map_or_else(|| part.rest.clone(), |track| track.weights(clip.face(frame)));
            let (positions, normals) = self.body.posed(part, world, &weights);
            let metallic = &part.material.pbr_metallic_roughness;
            let image = metallic.base_color_texture.as_ref().and_then(|texture| *self.sources.get(texture.index)?);
            (positions, normals, image)
        };
        let drawn = self.body.parts().map(|part| {
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

    /// Returns cameras for the whole body and for the head in their current positions.
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
        // Slightly from its left, like the figure's camera.
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

/// Returns the horizontal facing direction at rest; +Z if no pair of joints shows the sides.
fn ahead(character: &Character, mapping: &Mapping) -> Vec3 {
    let place = |joint: usize| mapping.bone(joint).map(|bone| Vec3::from_array(character.rig().place(bone)));
    let pairs = [(16, 17), (1, 2), (23, 24)].into_iter();
    let side = pairs.filter_map(|(left, right)| Some(place(left)? - place(right)?)).next();
    let ahead = side.map(|side| side.cross(Vec3::Y).normalize_or_zero()).filter(|ahead| *ahead != Vec3::ZERO);
    ahead.unwrap_or(Vec3::Z)
}

/// Decodes a PNG or JPEG picture; `None` for other formats and damaged files.
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
