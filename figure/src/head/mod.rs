//! The head: skin with openings for eyes and mouth, eyeballs, brows, ears, hair, teeth and tongue, and the 52 shapes.
//!
//! | module | contents |
//! |---|---|
//! | `base` | the bare head as a solid, and a map of its skin |
//! | `delaunay` | triangulation of the skin between the rings around eyes and mouth |
//! | `sheet` | half of a surface, and its mirror image |
//! | `eye`, `mouth`, `hair` | the parts that they name |
//! | `shapes`, `lids`, `lips` | displacement of each vertex by each channel |

use super::look::Look;
use super::rest::Rest;
use super::skin::{self, Weights};
use super::vector::{V, add, ramp, scale, sub};
use super::{Finish, Mesh, Morph, Part};
use base::Base;
use sheet::Sheet;
use umo_core_pose::skeleton::ARKIT_NAMES;

mod base;
mod delaunay;
mod eye;
mod hair;
mod lids;
mod lips;
mod mouth;
pub(crate) mod shapes;
mod sheet;

/// Part to which a vertex belongs, with the data that its shapes need.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Skin,
    /// Vertex of the left eye's lids, or its mirror image.
    Lid(lids::Point),
    /// Vertex of a lip, or of the mouth behind it.
    Lip(lips::Point),
    UpperTeeth,
    LowerTeeth,
    /// Position from root, 0, to tip, 1.
    Tongue(f32),
    Eyeball,
    Brow,
    Ear,
    Hair,
}

/// A vertex of the head, in metres of a head of size 1.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    place: V,
    kind: Kind,
    color: [u8; 3],
    /// The vertex whose normal this one shares: itself or an earlier one.
    smooth: usize,
}

/// Threshold below which a shape does not move a vertex, in metres.
const MIN_MOVE: f32 = 3e-5;

/// Head and neck with their shapes.
pub(super) struct Head {
    sheet: Sheet,
    /// `[vertices]`, positions in metres of a head of size 1, and unit normals.
    places: Vec<V>,
    normals: Vec<V>,
    /// In metres of a head of size 1; vertices are indexed from the head's first.
    morphs: Vec<Morph>,
    /// `[vertices]`
    finishes: Vec<Finish>,
}

impl Head {
    pub(super) fn new(rest: &Rest, look: &'static Look) -> Self {
        let eyes = origin(rest);
        let local = |p: V| scale(sub(p, eyes), 1.0 / rest.head);
        let base = Base::new(local(rest.at("neck")), look);
        let eye = eye::Eye::new(local(rest.at("left_eye")), look);

        let mut sheet = Sheet::default();
        let eye_ring = eye::add_lids(&mut sheet, &base, &eye);
        let mouth_ring = mouth::add_lips(&mut sheet, &base);
        add_skin(&mut sheet, &base, &eye_ring, &mouth_ring);
        mouth::add_nostril(&mut sheet, &base);
        mouth::add_teeth(&mut sheet, &base);
        mouth::add_tongue(&mut sheet, &base);
        eye::add_eyeball(&mut sheet, &eye);
        eye::add_lashes(&mut sheet, &eye);
        hair::add_brow(&mut sheet, &base);
        hair::add_ear(&mut sheet, &base);
        hair::add_hair(&mut sheet, &base);
        let sheet = sheet.whole();

        let places: Vec<V> = sheet.vertices.iter().map(|vertex| vertex.place).collect();
        let facing = sheet.facing(&places);
        let normals = sheet.normals(&facing);
        let morphs = ARKIT_NAMES.iter().map(|&name| morph(name, &sheet, &eye, &places, &facing, &normals)).collect();
        // Normals of the solid are smoother than those of the triangles.
        let smooth = sheet.vertices.iter().zip(normals);
        let normals = smooth.map(|(vertex, normal)| match vertex.kind {
            Kind::Skin => base.normal(vertex.place),
            _ => normal,
        });
        let normals = normals.collect();
        let finishes = sheet.vertices.iter().map(|vertex| finish(vertex.kind)).collect();
        Self { sheet, places, normals, morphs, finishes }
    }

    pub(super) fn add_to(self, mesh: &mut Mesh, rest: &Rest) {
        let (eyes, size) = (origin(rest), rest.head);
        let first = mesh.positions.len();
        let vertices = &self.sheet.vertices;
        let part = Part {
            positions: self.places.iter().map(|&p| add(eyes, scale(p, size))).collect(),
            normals: self.normals,
            indices: self.sheet.triangles.as_flattened().iter().map(|&i| number(i)).collect(),
            ..Part::default()
        };
        let colors: Vec<[u8; 3]> = vertices.iter().map(|vertex| vertex.color).collect();
        let weights: Vec<Weights> = vertices.iter().map(follow).collect();
        mesh.add_painted(part, &colors, self.finishes, &weights);
        mesh.head = first;
        mesh.jaw.resize(first, 0.0);
        mesh.jaw.extend(vertices.iter().map(|vertex| lips::jaw(vertex.kind, vertex.place)));
        mesh.morphs = self.morphs;
        for morph in &mut mesh.morphs {
            morph.vertices.iter_mut().for_each(|vertex| *vertex += number(first));
            morph.positions.iter_mut().for_each(|by| *by = scale(*by, size));
        }
    }
}

/// Distance of the head's origin in front of the eyeballs' centres, because eyes lie deep in the face.
const DEEP: f32 = 0.0042;

/// Origin of the head's coordinates.
fn origin(rest: &Rest) -> V {
    add(rest.middle("eye"), [0.0, 0.0, DEEP * rest.head])
}

/// Builds a shape from the vertices that it moves or whose normals it changes.
fn morph(name: &'static str, sheet: &Sheet, eye: &eye::Eye, places: &[V], facing: &[V], normals: &[V]) -> Morph {
    let shape = shapes::Shape::new(name);
    let moves: Vec<V> = sheet.vertices.iter().map(|vertex| shape.moved(vertex, eye)).collect();
    let there: Vec<V> = places.iter().zip(&moves).map(|(&p, &by)| add(p, by)).collect();
    let turned = sheet.normals(&sheet.facing_after(facing, places, &there));
    let mut morph = Morph { name, vertices: Vec::new(), positions: Vec::new(), normals: Vec::new() };
    for (vertex, &by) in moves.iter().enumerate() {
        let turn = sub(turned[vertex], normals[vertex]);
        if by.iter().any(|x| x.abs() > MIN_MOVE) || turn.iter().any(|x| x.abs() > 0.02) {
            morph.vertices.push(number(vertex));
            morph.positions.push(by);
            morph.normals.push(turn);
        }
    }
    morph
}

fn finish(kind: Kind) -> Finish {
    match kind {
        Kind::Skin | Kind::Lid(_) | Kind::Ear => Finish::SKIN,
        // Skin begins at the edge of the red.
        Kind::Lip(point) if point.ring > 3 => Finish::SKIN,
        Kind::Lip(_) => Finish::LIP,
        Kind::UpperTeeth | Kind::LowerTeeth => Finish::TEETH,
        Kind::Tongue(_) => Finish::TONGUE,
        Kind::Eyeball => Finish::EYE,
        Kind::Brow | Kind::Hair => Finish::HAIR,
    }
}

fn number(at: usize) -> u32 {
    u32::try_from(at).expect("the figure has few vertices")
}

/// Skin weights of a vertex: eyeballs follow their joints, and the neck's skin blends into the neck.
fn follow(vertex: &Vertex) -> Weights {
    let [x, y, z] = vertex.place;
    match vertex.kind {
        Kind::Eyeball => skin::only(if x > 0.0 { "left_eye" } else { "right_eye" }),
        Kind::Skin => {
            // The neck leans back, so the throat is lower than the nape.
            let low = y + 0.25 * (z + 0.06);
            let neck = ramp(-0.105, -0.165, low);
            // Skin under the collar follows the chest, as the collar does.
            let chest = ramp(-0.132, -0.168, low);
            let parts = [("head", 1.0 - neck), ("neck", neck * (1.0 - chest)), ("spine3", neck * chest)];
            skin::normalized(parts.map(|(joint, weight)| (weight, skin::number(joint))).to_vec())
        }
        _ => skin::only("head"),
    }
}

/// Fills the skin between the rings; `eye` and `mouth` are the outermost vertices around them.
fn add_skin(sheet: &mut Sheet, base: &Base, eye: &[usize], mouth: &[usize]) {
    let map = |sheet: &Sheet, at: usize| base.map(sheet.vertices[at].place);
    let holes: [Vec<[f32; 2]>; 2] = [eye, mouth].map(|ring| ring.iter().map(|&at| map(sheet, at)).collect());
    let mut vertices: Vec<usize> = eye.iter().chain(mouth).copied().collect();
    let mut places: Vec<[f32; 2]> = holes.concat();
    let (end, bottom, top) = Base::BOUNDS;
    let mut add_point = |sheet: &mut Sheet, vertices: &mut Vec<usize>, at: [f32; 2]| {
        let least = (0.80 * Base::spacing(at)).powi(2);
        let clear = |other: &[f32; 2]| (other[0] - at[0]).powi(2) + (other[1] - at[1]).powi(2) > least;
        // Recent points are the likeliest to be near.
        if !places.iter().rev().all(clear) || holes.iter().any(|hole| within(hole, at)) {
            return;
        }
        let mut place = base.skin(at);
        if at[0] == 0.0 || at[0] == end {
            place[0] = 0.0;
        }
        vertices.push(sheet.add(place, Kind::Skin, base::skin_color(base, place)));
        places.push(at);
    };
    let columns = |from: f32, to: f32| {
        let mut all = vec![];
        let mut v = from;
        while v <= to {
            all.push(v);
            v += 0.0014;
        }
        all
    };
    // Seams and rims come first, so that they are straight.
    for u in [0.0, end] {
        columns(bottom, top).into_iter().for_each(|v| add_point(sheet, &mut vertices, [u, v]));
    }
    for v in [bottom, top] {
        columns(0.0, end).into_iter().for_each(|u| add_point(sheet, &mut vertices, [u, v]));
    }
    for v in columns(bottom, top) {
        columns(0.0, end).into_iter().for_each(|u| add_point(sheet, &mut vertices, [u, v]));
    }
    let points: Vec<[f64; 2]> = places.iter().map(|at| at.map(f64::from)).collect();
    for [a, b, c] in delaunay::triangulate(&points) {
        let centre = std::array::from_fn(|i| (places[a][i] + places[b][i] + places[c][i]) / 3.0);
        if !holes.iter().any(|hole| within(hole, centre)) {
            sheet.triangles.push([vertices[a], vertices[b], vertices[c]]);
        }
    }
}

/// Whether a point is inside a polygon; a polygon that touches `u` = 0 is closed along that line.
fn within(polygon: &[[f32; 2]], [u, v]: [f32; 2]) -> bool {
    let mut inside = false;
    for (k, a) in polygon.iter().enumerate() {
        let b = polygon[(k + 1) % polygon.len()];
        if (a[1] > v) != (b[1] > v) && u < a[0] + (v - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
            inside = !inside;
        }
    }
    inside
}
