//! Serialization of a scene for a page: a description in JSON, numbers in base64.

use std::collections::BTreeSet;

use data_encoding::BASE64;
use serde::Serialize;
use umo_core::{FaceKind, JOINT_NAMES};
use umo_core_pose::clip::Clip;
use umo_core_rig::glb::Given;

use super::scene::{self, Audio, JudgeInfo, PageEngine, Record, RoomMember, Scene};
use super::take::Takes;
use umo_figure::Mesh;
use umo_figure::detail::Detail;

/// Description of the scene. Sizes count vertices and frames.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Description<'a> {
    title: &'a str,
    frame_rate: f32,
    joints: &'static [&'static str],
    parents: &'a [i32],
    offsets: &'a [[f32; 3]],
    face: Face<'a>,
    model: Option<Model<'a>>,
    mesh: MeshInfo,
    other_meshes: Vec<MeshInfo>,
    room: Vec<Member<'a>>,
    people: Vec<Person<'a>>,
    character: Option<Character<'a>>,
    audio: Option<AudioInfo>,
    record: Option<RecordInfo<'a>>,
    live: Option<Live<'a>>,
    judge: Option<&'a JudgeInfo>,
    rest: Option<Rest<'a>>,
    takes: Option<&'a Takes>,
}

#[derive(Serialize)]
struct Face<'a> {
    kind: &'static str,
    names: &'a [String],
}

#[derive(Serialize)]
struct Model<'a> {
    name: &'a str,
    stride: usize,
}

#[derive(Serialize)]
struct MeshInfo {
    /// Number of vertices that a morph target moves; they come first.
    moving: usize,
    /// Number of vertices with a position on a relief map; they come next.
    detailed: usize,
    details: Vec<DetailInfo>,
    morphs: Vec<MorphInfo>,
    helpers: Vec<HelperInfo>,
}

/// A relief, and the number of triangle corners with it. The corners are sorted by relief.
#[derive(Serialize)]
struct DetailInfo {
    name: &'static str,
    corners: usize,
    /// Threads across and down its map.
    threads: [f32; 2],
}

/// A helper joint that takes shares of another joint's rotation.
#[derive(Serialize)]
struct HelperInfo {
    of: usize,
    axis: [f32; 3],
    swing: f32,
    twist: f32,
}

#[derive(Serialize)]
struct MorphInfo {
    name: &'static str,
    count: usize,
}

/// A member of a conversation.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Member<'a> {
    name: &'a str,
    position: [f32; 3],
    facing: f32,
    /// Its mesh: 0 for `mesh`, others follow.
    figure: usize,
    sample_rate: u32,
}

/// Somebody without an avatar.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Person<'a> {
    name: &'a str,
    position: [f32; 3],
    sample_rate: u32,
}

/// The character that wears the motion in place of the mesh.
#[derive(Serialize)]
struct Character<'a> {
    /// Node of each of the 55 joints; `None` if the character lacks it.
    nodes: Vec<Option<usize>>,
    seconds: f64,
    /// First channel of its animation whose values come with a stream's frames.
    streamed: Option<usize>,
    given: Option<&'a Given>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct AudioInfo {
    sample_rate: u32,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct RecordInfo<'a> {
    parts: Vec<CodedPart<'a>>,
    kinds: &'static [&'static str],
    every: usize,
    experts: usize,
    encoder_layers: usize,
    decoder_layers: usize,
    chunks: Vec<Chunk>,
}

#[derive(Serialize)]
struct CodedPart<'a> {
    name: &'a str,
    levels: usize,
    codes: usize,
}

#[derive(Serialize)]
struct Chunk {
    first: usize,
    frames: usize,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Live<'a> {
    algorithmic_seconds: f64,
    has_mouth: bool,
    voice: Option<&'static str>,
    engine: Option<&'a PageEngine>,
}

#[derive(Serialize)]
struct Rest<'a> {
    rotations: &'a [[f32; 4]],
    translation: [f32; 3],
    face: &'a [f32],
}

/// Returns the page elements that hold the scene.
///
/// # Errors
/// Errors of the JSON writer.
pub(super) fn elements(scene: &Scene) -> serde_json::Result<String> {
    let orders: Vec<Order> = [&scene.mesh].into_iter().chain(&scene.other_meshes).map(Order::moving_first).collect();
    let mut page = Elements(String::new());
    page.description(&describe(scene, &orders))?;
    page.mesh(&scene.mesh, &orders[0], "");
    for (number, (mesh, order)) in scene.other_meshes.iter().zip(&orders[1..]).enumerate() {
        page.mesh(mesh, order, &format!("-{}", number + 1));
    }
    page.block("frames", frames(&scene.clip));
    for (number, member) in scene.room.iter().enumerate() {
        page.block(&format!("frames-{number}"), frames(&member.clip));
        page.block(&format!("audio-{number}"), samples(&member.audio));
    }
    for (number, person) in scene.people.iter().enumerate() {
        page.block(&format!("person-{number}"), samples(&person.audio));
    }
    if let Some(worn) = &scene.character {
        page.block("character", worn.file.iter().copied());
    }
    if let Some(audio) = &scene.audio {
        page.block("audio", samples(audio));
    }
    for (number, take) in scene.takes.iter().flat_map(|takes| &takes.files).enumerate() {
        page.block(&format!("take-{number}"), take.bytes().iter().copied());
    }
    if let Some(record) = &scene.record {
        page.block("codes", record.codes.iter().flatten().copied().flat_map(u16::to_le_bytes));
        page.block("routed", record.routed.iter().copied().flat_map(u32::to_le_bytes));
    }
    Ok(page.0)
}

fn describe_mesh(mesh: &umo_figure::Mesh, order: &Order) -> MeshInfo {
    let morph = |morph: &umo_figure::Morph| MorphInfo { name: morph.name, count: morph.vertices.len() };
    let helper =
        |one: &umo_figure::Helper| HelperInfo { of: one.of, axis: one.axis, swing: one.swing, twist: one.twist };
    MeshInfo {
        moving: order.moving,
        detailed: order.detailed,
        details: details(mesh)
            .into_iter()
            .map(|detail| DetailInfo {
                name: detail.name(),
                corners: corners(mesh, detail).count(),
                threads: detail.threads(),
            })
            .collect(),
        morphs: mesh.morphs.iter().map(morph).collect(),
        helpers: mesh.helpers.iter().map(helper).collect(),
    }
}

fn describe<'a>(scene: &'a Scene, orders: &[Order]) -> Description<'a> {
    let part = |part: &'a scene::CodedPart| CodedPart { name: &part.name, levels: part.levels, codes: part.codes };
    let record = |record: &'a Record| RecordInfo {
        parts: record.parts.iter().map(part).collect(),
        kinds: record.kinds,
        every: record.every,
        experts: record.experts,
        encoder_layers: record.encoder_layers,
        decoder_layers: record.decoder_layers,
        chunks: record.chunks.iter().map(|&(first, frames)| Chunk { first, frames }).collect(),
    };
    let clip = &scene.clip;
    Description {
        title: &scene.title,
        frame_rate: clip.frame_rate,
        joints: &JOINT_NAMES,
        parents: &clip.skeleton.parents,
        offsets: &clip.skeleton.offsets_m,
        face: Face {
            kind: match clip.face.kind {
                FaceKind::Arkit => "arkit",
                FaceKind::SmplxExpression => "smplx_expression",
            },
            names: &clip.face.names,
        },
        model: scene.model.as_ref().map(|model| Model { name: &model.name, stride: model.stride }),
        mesh: describe_mesh(&scene.mesh, &orders[0]),
        other_meshes: scene
            .other_meshes
            .iter()
            .zip(&orders[1..])
            .map(|(mesh, order)| describe_mesh(mesh, order))
            .collect(),
        room: scene.room.iter().map(describe_member).collect(),
        people: scene.people.iter().map(describe_person).collect(),
        character: scene.character.as_ref().map(|worn| Character {
            nodes: worn.nodes.to_vec(),
            seconds: worn.seconds,
            streamed: worn.streamed,
            given: worn.given.as_ref(),
        }),
        audio: scene.audio.as_ref().map(|audio| AudioInfo { sample_rate: audio.sample_rate }),
        record: scene.record.as_ref().map(record),
        live: scene.live.as_ref().map(|live| Live {
            algorithmic_seconds: live.algorithmic_seconds,
            has_mouth: live.has_mouth,
            voice: live.voice,
            engine: live.engine.as_ref(),
        }),
        judge: scene.judge.as_ref(),
        rest: scene.live.as_ref().map(|live| Rest {
            rotations: &live.rest.rotations,
            translation: live.rest.translation,
            face: &live.rest_face,
        }),
        takes: scene.takes.as_ref(),
    }
}

fn describe_member(member: &RoomMember) -> Member<'_> {
    let RoomMember { name, place, figure, audio, .. } = member;
    Member { name, position: place.position, facing: place.facing, figure: *figure, sample_rate: audio.sample_rate }
}

fn describe_person(person: &scene::Person) -> Person<'_> {
    Person { name: &person.name, position: person.place.position, sample_rate: person.audio.sample_rate }
}

fn samples(audio: &Audio) -> impl Iterator<Item = u8> {
    audio.samples.iter().copied().flat_map(i16::to_le_bytes)
}

/// Returns each frame's rotations, root translation and face values in sequence.
pub(super) fn frames(clip: &Clip) -> impl Iterator<Item = u8> {
    (0..clip.len()).flat_map(|frame| {
        let rotations = clip.rotations[frame].as_flattened().iter();
        rotations.chain(&clip.translation[frame]).chain(clip.face(frame)).copied().flat_map(f32::to_le_bytes)
    })
}

/// Returns the reliefs of a mesh, sorted.
fn details(mesh: &Mesh) -> BTreeSet<Detail> {
    mesh.details.iter().copied().collect()
}

/// Returns the corners of the triangles with a relief.
fn corners(mesh: &Mesh, detail: Detail) -> impl Iterator<Item = u32> + '_ {
    let (triangles, _) = mesh.indices.as_chunks::<3>();
    triangles.iter().filter(move |corners| mesh.details[corners[0] as usize] == detail).flatten().copied()
}

/// A vertex order: vertices moved by a morph target come first, then other vertices with a relief.
struct Order {
    /// Old index of every vertex.
    old: Vec<u32>,
    /// New index of every vertex.
    new: Vec<u32>,
    moving: usize,
    detailed: usize,
}

impl Order {
    #[expect(clippy::cast_possible_truncation, reason = "indices of vertices are 32-bit")]
    fn moving_first(mesh: &Mesh) -> Self {
        let mut moves = vec![false; mesh.positions.len()];
        for &vertex in mesh.morphs.iter().flat_map(|morph| &morph.vertices) {
            moves[vertex as usize] = true;
        }
        let rank = |vertex: u32| match (moves[vertex as usize], mesh.details[vertex as usize]) {
            (true, _) => 0,
            (false, Detail::None) => 2,
            (false, _) => 1,
        };
        let mut old: Vec<u32> = (0..moves.len() as u32).collect();
        old.sort_by_key(|&vertex| rank(vertex));
        let count = |wanted| old.iter().filter(|&&vertex| rank(vertex) == wanted).count();
        let (moving, detailed) = (count(0), count(1));
        let mut new = vec![0; old.len()];
        old.iter().enumerate().for_each(|(at, &vertex)| new[vertex as usize] = at as u32);
        Self { moving, detailed, old, new }
    }

    /// Returns `values` in the new order.
    fn sort<'a, T: Copy>(&'a self, values: &'a [T]) -> impl Iterator<Item = T> + 'a {
        self.old.iter().map(|&vertex| values[vertex as usize])
    }

    fn place(&self, vertex: u32) -> u32 {
        self.new[vertex as usize]
    }
}

/// HTML elements of a page.
struct Elements(String);

impl Elements {
    fn description(&mut self, description: &Description) -> serde_json::Result<()> {
        let json = serde_json::to_string(description)?;
        self.0 += "<script type=\"application/json\" id=\"scene\">";
        // In JSON, `<` occurs only in strings; escaping it keeps a string from closing the element.
        self.0 += &json.replace('<', "\\u003c");
        self.0 += "</script>\n";
        Ok(())
    }

    fn block(&mut self, name: &str, bytes: impl Iterator<Item = u8>) {
        self.0 += &format!("<script type=\"text/plain\" id=\"block-{name}\">");
        BASE64.encode_append(&bytes.collect::<Vec<u8>>(), &mut self.0);
        self.0 += "</script>\n";
    }

    fn floats(&mut self, name: &str, rows: impl Iterator<Item = [f32; 3]>) {
        self.block(name, rows.flatten().flat_map(f32::to_le_bytes));
    }

    fn mesh(&mut self, mesh: &Mesh, order: &Order, end: &str) {
        let name = |name: &str| format!("{name}{end}");
        self.floats(&name("positions"), order.sort(&mesh.positions));
        self.floats(&name("normals"), order.sort(&mesh.normals));
        self.block(&name("colors"), order.sort(&mesh.colors).flatten());
        self.block(&name("roughness"), order.sort(&mesh.finishes).map(|finish| finish.roughness));
        self.block(&name("joints"), order.sort(&mesh.joints).flatten());
        self.block(
            &name("weights"),
            order.sort(&mesh.weights).flatten().flat_map(|weight| share(weight).to_le_bytes()),
        );
        let sorted = details(mesh).into_iter().flat_map(|detail| corners(mesh, detail));
        self.block(&name("indices"), sorted.flat_map(|vertex| order.place(vertex).to_le_bytes()));
        let places = order.sort(&mesh.detail_places).skip(order.moving).take(order.detailed);
        self.block(&name("detail-places"), places.flatten().flat_map(f32::to_le_bytes));
        for (detail, map) in details(mesh).into_iter().filter_map(|detail| Some((detail, detail.normal_map()?))) {
            let mut png = Vec::new();
            map.write(&mut png).expect("memory takes all that is written");
            self.block(&name(&format!("detail-{}", detail.name())), png.into_iter());
        }
        let vertices = mesh.morphs.iter().flat_map(|morph| &morph.vertices);
        self.block(&name("morph-vertices"), vertices.flat_map(|&vertex| order.place(vertex).to_le_bytes()));
        self.floats(&name("morph-positions"), mesh.morphs.iter().flat_map(|morph| morph.positions.iter().copied()));
        self.floats(&name("morph-normals"), mesh.morphs.iter().flat_map(|morph| morph.normals.iter().copied()));
    }
}

/// Quantizes a weight from 0 to 1 to 16 bits.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
fn share(weight: f32) -> u16 {
    (weight.clamp(0.0, 1.0) * 65535.0).round() as u16
}

#[cfg(test)]
mod tests;
