//! The figure that speaks: a clothed person made by code on a skeleton's own bones,
//! smooth-skinned, with the 52 ARKit shapes, and pictures of it without a graphics card.
//!
//! [`Figure::mesh`] makes the mesh, [`Mesh::posed`] puts it in a pose, [`picture::Picture`] draws it.
//!
//! | module | what it makes |
//! |---|---|
//! | `look` | which figures there are, and what tells them apart |
//! | `body` | top, trousers, shoes and hands: solids of `field`, meshed by `nets`, and swept bands |
//! | `head` | face, eyes, mouth, hair, and the shapes |
//! | `skin` | which joints each vertex follows |
//! | [`Helper`] | joints that take shares of another one's turn |
//! | [`detail`] | fine relief of cloth and leather, as normal maps |
//! | `unwrap`, `body::charts` | where on those maps a surface is |
//! | [`palette`] | the colours as a texture |
//! | `posed` | the mesh in a pose, on the processor |
//! | [`picture`] | a depth buffer, light, PNG files |
//! | `rest`, `vector` | the skeleton's measures; points |
#![forbid(unsafe_code)]

use std::collections::HashMap;
use std::fmt;

use umo_core::config::Skeleton;
use umo_core::memory;
use umo_core::motion::skeleton::JOINTS;

mod body;
pub mod detail;
mod field;
mod finish;
mod head;
mod helper;
mod look;
mod nets;
pub mod palette;
pub mod picture;
mod posed;
mod rest;
pub mod sample;
mod skin;
#[cfg(test)]
mod tests;
mod unwrap;
mod vector;

use detail::Detail;
use field::Solid;
pub use finish::Finish;
pub use helper::Helper;
use look::{Color, Look, Top};
pub use look::{Figure, UnknownFigure};
pub use posed::Posed;
use rest::Rest;
use skin::Weights;
use vector::V;

/// Why no figure can be made on a skeleton.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FigureError {
    /// The skeleton does not have the model's 55 joints.
    Joints {
        /// Joints that it has.
        found: usize,
    },
    /// An offset is not finite.
    Offsets,
}

impl fmt::Display for FigureError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Joints { found } => write!(f, "the figure needs a skeleton of 55 joints, this one has {found}"),
            Self::Offsets => f.write_str("the skeleton's offsets are not finite"),
        }
    }
}

impl std::error::Error for FigureError {}

/// A skinned mesh with morph targets, in the rest pose, metres, Y up, facing +Z (as the model's
/// skeleton has it).
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// `[vertices]`, as the next eight.
    pub positions: Vec<[f32; 3]>,
    /// Unit length.
    pub normals: Vec<[f32; 3]>,
    /// sRGB and 255: skin, lips, teeth, tongue, eye white, iris, brows, cloth.
    pub colors: Vec<[u8; 4]>,
    /// How the surface reflects; one on each connected piece.
    pub finishes: Vec<Finish>,
    /// The fine relief of the surface; one on each triangle.
    pub details: Vec<Detail>,
    /// Right and down on the relief's map, in repeats of it; zeros where there is none. A vertex
    /// where two of its places meet is there more than once.
    pub detail_places: Vec<[f32; 2]>,
    /// Where the map's right is, of unit length and across the normal, and 1 or -1: the factor by
    /// which normal × right is the map's up. Zeros where there is no relief.
    pub tangents: Vec<[f32; 4]>,
    /// Up to four joints, from 55 on helper joints; 0 where the weight is 0.
    pub joints: Vec<[u8; 4]>,
    /// Weights of those joints; their sum is 1.
    pub weights: Vec<[f32; 4]>,
    /// The helper joints.
    pub helpers: Vec<Helper>,
    /// Triangles, counter-clockwise from outside.
    pub indices: Vec<u32>,
    /// How much each vertex follows the jaw where its joint opens the mouth and not a shape, 0..=1.
    /// `[vertices]`
    pub jaw: Vec<f32>,
    /// The first vertex of the head: shapes move none before it, and no triangle has corners on
    /// both sides.
    pub head: usize,
    /// One for each of the 52 ARKit channels, in the channels' order.
    pub morphs: Vec<Morph>,
}

/// How one channel at 1 moves the mesh; only the vertices that move.
#[derive(Clone, Debug)]
pub struct Morph {
    /// The channel's name.
    pub name: &'static str,
    /// Ascending.
    pub vertices: Vec<u32>,
    /// What is added to those vertices' positions, metres.
    pub positions: Vec<[f32; 3]>,
    /// What is added to their normals.
    pub normals: Vec<[f32; 3]>,
}

/// A piece of surface.
#[derive(Default)]
struct Part {
    positions: Vec<V>,
    normals: Vec<V>,
    indices: Vec<u32>,
    detail: Detail,
    /// As those of [`Mesh::detail_places`]; empty where there is no relief.
    places: Vec<[f32; 2]>,
    /// Likewise.
    tangents: Vec<[f32; 4]>,
}

impl Part {
    /// Two triangles, along the shorter diagonal.
    fn add_quad(&mut self, [a, b, c, d]: [u32; 4]) {
        let at = |i: u32| self.positions[i as usize];
        let triangles = if vector::distance(at(a), at(c)) <= vector::distance(at(b), at(d)) {
            [a, b, c, a, c, d]
        } else {
            [a, b, d, b, c, d]
        };
        self.indices.extend(triangles);
    }
}

impl Mesh {
    /// Adds a part whose vertices get colour by their place and normal, and weights by their place.
    fn add(&mut self, part: Part, finish: Finish, color: impl Fn(V, V) -> Color, weights: impl Fn(V) -> Weights) {
        let colors: Vec<_> = part.positions.iter().zip(&part.normals).map(|(&p, &n)| color(p, n)).collect();
        let weights: Vec<_> = part.positions.iter().map(|&p| weights(p)).collect();
        let finishes = vec![finish; colors.len()];
        self.add_painted(part, &colors, finishes, &weights);
    }

    fn add_painted(&mut self, part: Part, colors: &[[u8; 3]], finishes: Vec<Finish>, weights: &[Weights]) {
        let first = u32::try_from(self.positions.len()).expect("the figure has few vertices");
        self.finishes.extend(finishes);
        let count = part.positions.len();
        self.details.extend(std::iter::repeat_n(part.detail, count));
        // All or, where there is no relief, none of them are there.
        self.detail_places.extend(part.places);
        self.tangents.extend(part.tangents);
        self.detail_places.resize(self.details.len(), [0.0; 2]);
        self.tangents.resize(self.details.len(), [0.0; 4]);
        self.colors.extend(colors.iter().map(|&[r, g, b]| [r, g, b, 255]));
        self.joints.extend(weights.iter().map(|one| one.0));
        self.weights.extend(weights.iter().map(|one| one.1));
        self.positions.extend(part.positions);
        self.normals.extend(part.normals);
        self.indices.extend(part.indices.iter().map(|i| i + first));
    }

    /// For each vertex the first one that it is a copy of: copies have other places on a relief's
    /// map. Itself where it is none.
    pub(crate) fn originals(&self) -> Vec<usize> {
        let mut first: HashMap<([u32; 3], [u32; 3], Finish), usize> = HashMap::new();
        let of = |vertex: usize| {
            if self.details[vertex] == Detail::None {
                return vertex;
            }
            let bits = |v: V| v.map(f32::to_bits);
            let key = (bits(self.positions[vertex]), bits(self.normals[vertex]), self.finishes[vertex]);
            *first.entry(key).or_insert(vertex)
        };
        (0..self.positions.len()).map(of).collect()
    }

    /// The same mesh for animations that open the mouth by the jaw joint: chin, lower lip and
    /// teeth, and tongue follow it.
    pub fn on_the_jaw(mut self) -> Self {
        let jaw = skin::number("jaw");
        for (vertex, &share) in self.jaw.iter().enumerate() {
            if share > 0.0 {
                let own = self.joints[vertex].into_iter().zip(self.weights[vertex]);
                let own = own.map(|(joint, weight)| (weight * (1.0 - share), joint)).filter(|one| one.0 > 0.0);
                let all = own.chain([(share, jaw)]).collect();
                (self.joints[vertex], self.weights[vertex]) = skin::normalized(all);
            }
        }
        self
    }
}

impl Mesh {
    /// The same mesh for programs that turn no helper joints: their skin follows the joint whose turn they share, by their
    /// share of its swing, and that joint's parent by the rest.
    pub fn without_helpers(mut self, skeleton: &Skeleton) -> Self {
        for (joints, weights) in self.joints.iter_mut().zip(&mut self.weights) {
            let mut shares = std::collections::BTreeMap::<u8, f32>::new();
            for (joint, weight) in joints.iter().zip(*weights).filter(|(_, weight)| *weight > 0.0) {
                let Some(helper) = usize::from(*joint).checked_sub(JOINTS).map(|at| &self.helpers[at]) else {
                    *shares.entry(*joint).or_default() += weight;
                    continue;
                };
                let parent = usize::try_from(skeleton.parents[helper.of]).unwrap_or(helper.of);
                for (of, share) in [(helper.of, helper.swing), (parent, 1.0 - helper.swing)] {
                    *shares.entry(u8::try_from(of).expect("55 joints")).or_default() += share * weight;
                }
            }
            (*joints, *weights) = skin::normalized(shares.into_iter().map(|(joint, weight)| (weight, joint)).collect());
        }
        self.helpers.clear();
        self
    }
}

/// The default figure on a skeleton's rest offsets (55 joints, names as the model's).
///
/// # Errors
/// A skeleton that has not 55 joints, or whose offsets are not finite.
pub fn mannequin(skeleton: &Skeleton) -> Result<Mesh, FigureError> {
    Figure::default().mesh(skeleton)
}

impl Figure {
    /// This figure on a skeleton's rest offsets (55 joints, names as the model's).
    ///
    /// # Errors
    /// A skeleton that has not 55 joints, or whose offsets are not finite.
    pub fn mesh(self, skeleton: &Skeleton) -> Result<Mesh, FigureError> {
        let (rest, look) = (Rest::new(skeleton)?, self.look());
        let mut mesh = Mesh { helpers: helper::all(&rest), ..Mesh::default() };
        // Head and body take as long as each other.
        let head = std::thread::scope(|scope| {
            let head = || memory::catch(|| head::Head::new(&rest, look));
            // A system without threads, or with no room for one more, starts none.
            let started = memory::check_thread().map(|()| std::thread::Builder::new().spawn_scoped(scope, head));
            add_body(&mut mesh, &rest, look);
            match started {
                Ok(Ok(thread)) => thread.join().expect("the head's thread does not panic"),
                _ => head(),
            }
        });
        let head = head.unwrap_or_else(|missing| memory::refuse(missing.bytes));
        head.add_to(&mut mesh, &rest);
        Ok(mesh)
    }
}

/// How far light that reaches cloth may be kept away, metres.
const SHADED: f32 = 0.09;

/// A colour where less light comes.
fn darker(color: Color, shade: f32) -> Color {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a byte")]
    color.map(|x| (f32::from(x) * (1.0 - 0.55 * shade)).round() as u8)
}

/// Cloth, shoes and hands.
fn add_body(mesh: &mut Mesh, rest: &Rest, look: &Look) {
    let upper = skin::upper(rest);
    let lower = skin::lower(rest);
    let top = body::top(rest, look);
    let trousers = body::trousers(rest, look);
    let shaded =
        |color: Color, solids: &[&Solid], p: V, n: V| darker(color, field::occlusion(solids, p, n, SHADED * rest.size));
    let cloth = [&top.solid, &trousers.solid];
    mesh.add(
        body::charts::top(rest, look, &top),
        Finish::CLOTH,
        |p, n| shaded(look.cloth, &cloth[..1], p, n),
        |p| upper.weights(p),
    );
    let legs = body::charts::trousers(rest, look, &trousers);
    mesh.add(legs, Finish::CLOTH, |p, n| shaded(look.trousers, &cloth, p, n), |p| lower.weights(p));
    mesh.add(body::neck_band(rest, look), Finish::CLOTH, |_, _| look.cloth, |p| upper.weights(p));
    if look.top == Top::Shirt {
        let belt = body::belt(rest, look);
        let (buttons, buckle) = body::buttons(rest, &top.solid, &belt.solid);
        mesh.add(body::collar(rest, look), Finish::CLOTH, |_, _| look.cloth, |p| upper.weights(p));
        let leather = |p: V, n: V| shaded(look.belt, &[&top.solid, &belt.solid], p, n);
        mesh.add(body::charts::belt(rest, look, &belt), Finish::LEATHER, leather, |p| lower.weights(p));
        mesh.add(buttons, Finish::NAIL, |_, _| [228, 222, 210], |p| upper.weights(p));
        mesh.add(buckle, Finish::BRASS, |_, _| [186, 168, 120], |p| lower.weights(p));
    }
    for side in ["left", "right"] {
        // Bands go wholly with the bone that they end.
        let [forearm, knee] = ["wrist_twist", "knee"].map(|joint| format!("{side}_{joint}"));
        mesh.add(body::cuff(rest, look, side), Finish::CLOTH, |_, _| look.cloth, |_| skin::only(&forearm));
        let hem = |p: V, n: V| shaded(look.trousers, &cloth[1..], p, n);
        mesh.add(body::leg_hem(rest, side), Finish::CLOTH, hem, |_| skin::only(&knee));
        let foot = skin::foot(rest, side);
        let [shoe, sole, sock] = body::shoe(rest, side);
        let feet = [&shoe.solid, &sole.solid, &trousers.solid];
        let upper = if look.top == Top::Shirt { Finish::LEATHER } else { Finish::RUBBER };
        mesh.add(body::laces(rest, side, &shoe.solid), Finish::CLOTH, |_, _| look.soles, |p| foot.weights(p));
        let leather = body::charts::shoe(rest, side, &shoe);
        mesh.add(leather, upper, |p, n| shaded(look.shoes, &feet, p, n), |p| foot.weights(p));
        mesh.add(sole.surface(), Finish::RUBBER, |p, n| shaded(look.soles, &feet[1..2], p, n), |p| foot.weights(p));
        mesh.add(sock.surface(), Finish::CLOTH, |p, n| shaded(look.belt, &feet, p, n), |p| skin::sock(rest, side, p));
        let weights = skin::Hand::new(rest, side, &body::FINGERS);
        let hand = body::hand(rest, side, look.build);
        let skin_color = |p: V, n: V| {
            let dark = field::occlusion(&[&hand.solid, &top.solid], p, n, 0.025 * rest.size);
            look.skin.toned(0.25, 0.75 * dark)
        };
        mesh.add(hand.surface(), Finish::SKIN, skin_color, |p| weights.weights(p));
        for finger in body::FINGERS {
            let nail = body::nail(rest, side, finger, look.build, &hand.solid);
            mesh.add(nail, Finish::NAIL, |_, _| look.skin.nail, |_| skin::only(&format!("{side}_{finger}3")));
        }
    }
}
