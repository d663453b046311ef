//! Points spread evenly over a character's meshes in the bind pose, with the bone that each follows.
//!
//! Meshes that cannot be read are left out: a character moves without them.

use glam::{Mat4, Quat, Vec3};

use super::accessor::{floats, numbers};
use super::document::{Document, Primitive};
use crate::retarget::{Rig, SurfacePoint};

/// Points of a character, about.
const POINTS: f32 = 24_000.0;
/// Upper bound on a triangle's points, so that a ground plane does not take all.
const MOST: usize = 64;
/// Upper bound on the vertices that are read of one mesh.
const VERTICES: usize = 1 << 20;

/// A vertex in the bind pose.
#[derive(Clone, Copy)]
struct Vertex {
    place: Vec3,
    /// The bone that has at least half of its weight.
    bone: Option<usize>,
}

/// A triangle list in the bind pose.
struct Triangles {
    vertices: Vec<Vertex>,
    corners: Vec<[usize; 3]>,
}

/// Returns the points of all meshes.
pub(super) fn surface(document: &Document, bin: &[u8], rig: &Rig) -> Vec<SurfacePoint> {
    let world = world(rig);
    let mut parts = Vec::new();
    for (node, of) in document.nodes.iter().enumerate() {
        let Some(mesh) = of.mesh.and_then(|mesh| document.meshes.get(mesh)) else { continue };
        let weights = of.weights.as_deref().or(mesh.weights.as_deref()).unwrap_or_default();
        let skin = of.skin.and_then(|skin| joints(document, bin, skin));
        for primitive in &mesh.primitives {
            parts.extend(triangles(document, bin, primitive, weights, (node, skin.as_deref()), &world));
        }
    }
    points(&parts)
}

/// Returns points spread evenly over triangles, about 24,000: `vertices` are places at rest in the rig's world, each with
/// the bone that has at least half of its weight; `corners` are indices of vertices. Triangles without an area, and
/// points without a bone, are left out. Panics if an index is out of range.
pub fn spread(vertices: &[([f32; 3], Option<usize>)], corners: Vec<[usize; 3]>) -> Vec<SurfacePoint> {
    let vertices = vertices.iter().map(|&(place, bone)| Vertex { place: place.into(), bone }).collect();
    points(&[Triangles { vertices, corners }])
}

/// Returns points of all parts together.
fn points(parts: &[Triangles]) -> Vec<SurfacePoint> {
    let area = |part: &Triangles, [a, b, c]: [usize; 3]| {
        let [a, b, c] = [a, b, c].map(|corner| part.vertices[corner].place);
        0.5 * (b - a).cross(c - a).length()
    };
    let all = || parts.iter().flat_map(|part| part.corners.iter().map(move |&corners| (part, corners)));
    let total: f32 = all().map(|(part, corners)| area(part, corners)).filter(|area| area.is_finite()).sum();
    let mut points = Vec::new();
    for (part, corners) in all() {
        let area = area(part, corners);
        if !(area > 0.0 && area.is_finite()) {
            continue;
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most `MOST`")]
        let count = ((POINTS * area / total).ceil() as usize).clamp(1, MOST);
        let [a, b, c] = corners.map(|corner| part.vertices[corner]);
        for at in 0..count {
            // Even over the triangle: the additive sequence of the plastic number, folded.
            #[expect(clippy::cast_precision_loss, reason = "at most `MOST`")]
            let at = at as f32;
            let (mut u, mut v) = ((0.5 + 0.754_877_7 * at).fract(), (0.5 + 0.569_840_3 * at).fract());
            if count == 1 {
                (u, v) = (1.0 / 3.0, 1.0 / 3.0);
            } else if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let shares = [1.0 - u - v, u, v];
            let most = [a, b, c].into_iter().zip(shares).max_by(|a, b| a.1.total_cmp(&b.1));
            let place = a.place * shares[0] + b.place * u + c.place * v;
            if let Some(bone) = most.and_then(|(vertex, _)| vertex.bone) {
                #[expect(clippy::cast_precision_loss, reason = "at most `MOST`")]
                let area = area / count as f32;
                points.push(SurfacePoint { bone, place: place.to_array(), area });
            }
        }
    }
    points
}

/// World matrices of the bones at rest.
fn world(rig: &Rig) -> Vec<Mat4> {
    let mut world = vec![Mat4::IDENTITY; rig.len()];
    for &at in rig.order() {
        let bone = &rig.bones()[at];
        let [scale, translation] = [bone.scale, bone.translation].map(Vec3::from_array);
        let local = Mat4::from_scale_rotation_translation(scale, Quat::from_array(bone.rotation), translation);
        world[at] = bone.parent.map_or(local, |parent| world[parent] * local);
    }
    world
}

/// Joints of a skin, with the inverse bind matrices.
fn joints(document: &Document, bin: &[u8], skin: usize) -> Option<Vec<(usize, Mat4)>> {
    let skin = document.skins.get(skin)?;
    let matrices = match skin.inverse_bind_matrices {
        Some(at) => floats(document, bin, at, "MAT4").ok()?,
        None => Vec::new(),
    };
    let matrix = |at: usize| matrices.as_chunks::<16>().0.get(at).map_or(Mat4::IDENTITY, Mat4::from_cols_array);
    Some(skin.joints.iter().enumerate().map(|(at, &joint)| (joint, matrix(at))).collect())
}

/// Reads a part of a mesh; `None` if it has no triangles that can be read.
fn triangles(
    document: &Document,
    bin: &[u8],
    primitive: &Primitive,
    weights: &[f32],
    (node, skin): (usize, Option<&[(usize, Mat4)]>),
    world: &[Mat4],
) -> Option<Triangles> {
    let index = |value: &serde_json::Value| usize::try_from(value.as_u64()?).ok();
    let attribute = |name: &str| primitive.attributes.get(name).and_then(index);
    if primitive.mode.as_ref().is_some_and(|mode| index(mode) != Some(4)) {
        return None;
    }
    let position = attribute("POSITION")?;
    document.accessors.get(position).filter(|accessor| accessor.count <= VERTICES && accessor.buffer_view.is_some())?;
    let read = |at: usize, kind: &str| numbers(document, bin, at, &[kind]).ok().map(|(values, _)| values);
    let mut places = read(position, "VEC3")?;
    for (target, &weight) in primitive.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
        let moved = target.get("POSITION").and_then(index).and_then(|at| read(at, "VEC3"));
        for (place, by) in places.iter_mut().zip(moved.into_iter().flatten()) {
            *place += weight * by;
        }
    }
    let bound = skin.and_then(|skin| {
        let (joints, shares) = (read(attribute("JOINTS_0")?, "VEC4")?, read(attribute("WEIGHTS_0")?, "VEC4")?);
        Some((skin, joints, shares))
    });
    let vertex = |(at, place): (usize, &[f32; 3])| {
        let place = Vec3::from_array(*place);
        let Some((skin, joints, shares)) = &bound else {
            return Vertex { place: world[node].transform_point3(place), bone: Some(node) };
        };
        let (Some(joints), Some(shares)) = (joints.as_chunks::<4>().0.get(at), shares.as_chunks::<4>().0.get(at))
        else {
            return Vertex { place, bone: None };
        };
        let total: f32 = shares.iter().sum();
        let (mut matrix, mut bone) = (Mat4::ZERO, None);
        for (&joint, share) in joints.iter().zip(shares.map(|share| share / total)) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number of one list")]
            let of = skin.get(joint as usize).filter(|_| share > 0.0);
            if let Some(&(joint, bind)) = of
                && let Some(frame) = world.get(joint)
            {
                matrix += *frame * bind * share;
                bone = if share >= 0.5 { Some(joint) } else { bone };
            }
        }
        Vertex { place: matrix.transform_point3(place), bone }
    };
    let vertices: Vec<Vertex> = places.as_chunks::<3>().0.iter().enumerate().map(vertex).collect();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers of one list")]
    let corners: Vec<usize> = match primitive.indices.as_ref().and_then(index) {
        Some(at) => read(at, "SCALAR")?.into_iter().map(|x| x as usize).collect(),
        None => (0..vertices.len()).collect(),
    };
    let corners = corners.as_chunks::<3>().0.iter().copied();
    let corners = corners.filter(|corners| corners.iter().all(|&corner| corner < vertices.len())).collect();
    Some(Triangles { vertices, corners })
}
