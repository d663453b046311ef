//! Skin weights: each vertex follows the bones near it, smoothly.

use super::helper;
use super::rest::{Rest, joint};
use super::vector::{V, add, dot, length, ramp, scale, sub, unit};

/// A bone as a thick line segment.
pub(super) struct Bone {
    joint: u8,
    a: V,
    b: V,
    radius: f32,
}

/// A joint whose rotation helper joints spread over the surrounding skin.
struct Spread {
    parents: Vec<u8>,
    joint: u8,
    /// The helper joint with half of the joint's rotation.
    half: u8,
    twist: Option<Twist>,
}

/// The twisting bone, and the joint to follow at each share of its length.
struct Twist {
    from: V,
    to: V,
    steps: Vec<(f32, u8)>,
}

/// Bones that a part of the body may follow.
pub(super) struct Skin {
    bones: Vec<Bone>,
    spreads: Vec<Spread>,
    /// Distance over which a bone's influence falls to a third, in metres.
    soft: f32,
}

/// Threshold below which weights are dropped.
const MIN_WEIGHT: f32 = 0.02;

/// Up to four joints, 0 if the weight is 0; the weights sum to 1.
pub(super) type Weights = ([u8; 4], [f32; 4]);

/// Index of a joint or helper joint.
pub(super) fn number(name: &str) -> u8 {
    u8::try_from(helper::number(name).unwrap_or_else(|| joint(name))).expect("there are fewer than 256 joints")
}

/// Full weight on one joint.
pub(super) fn only(name: &str) -> Weights {
    ([number(name), 0, 0, 0], [1.0, 0.0, 0.0, 0.0])
}

impl Skin {
    pub(super) fn new(soft: f32) -> Self {
        Self { bones: Vec::new(), spreads: Vec::new(), soft }
    }

    pub(super) fn bone(mut self, name: &str, a: V, b: V, radius: f32) -> Self {
        self.bones.push(Bone { joint: number(name), a, b, radius });
        self
    }

    /// Spreads the rotation of a joint of one side; `twist` lists shares of its bone with the helper to follow.
    fn spread(mut self, rest: &Rest, side: &str, row: (&[&str], &str, &str), twist: &[(f32, &str)]) -> Self {
        let (parents, own, end) = row;
        let of =
            |name: &str| if name == "pelvis" || name == "spine3" { name.to_owned() } else { format!("{side}_{name}") };
        let steps = twist.iter().map(|&(at, name)| (at, number(&of(name)))).collect();
        self.spreads.push(Spread {
            parents: parents.iter().map(|name| number(&of(name))).collect(),
            joint: number(&of(own)),
            half: number(&of(&format!("{own}_half"))),
            twist: (!twist.is_empty()).then(|| Twist { from: rest.side(side, own), to: rest.side(side, end), steps }),
        });
        self
    }

    pub(super) fn weights(&self, p: V) -> Weights {
        let near: Vec<f32> = self.bones.iter().map(|bone| bone.distance(p)).collect();
        let nearest = near.iter().copied().fold(f32::MAX, f32::min);
        let mut all: Vec<(f32, u8)> = Vec::new();
        for (bone, d) in self.bones.iter().zip(near) {
            let weight = ((nearest - d) / self.soft).exp();
            match all.iter_mut().find(|(_, joint)| *joint == bone.joint) {
                Some(known) => known.0 = known.0.max(weight),
                None => all.push((weight, bone.joint)),
            }
        }
        let sum: f32 = all.iter().map(|one| one.0).sum();
        all.iter_mut().for_each(|one| one.0 /= sum);
        self.spreads.iter().for_each(|spread| spread.bend(&mut all));
        self.spreads.iter().for_each(|spread| spread.twist(p, &mut all));
        normalized(all)
    }
}

impl Spread {
    /// Skin that follows joint and parents alike is moved to the joint between them.
    fn bend(&self, all: &mut Vec<(f32, u8)>) {
        let own = all.iter().find(|one| one.1 == self.joint).map_or(0.0, |one| one.0);
        let above: f32 = all.iter().filter(|one| self.parents.contains(&one.1)).map(|one| one.0).sum();
        let less = own.min(above);
        if less <= 0.0 {
            return;
        }
        for (weight, joint) in all.iter_mut() {
            if *joint == self.joint {
                *weight -= less;
            } else if self.parents.contains(joint) {
                *weight *= 1.0 - less / above;
            }
        }
        all.push((2.0 * less, self.half));
    }

    /// Distributes the joint's weight over helpers that twist by less, or by more.
    fn twist(&self, p: V, all: &mut Vec<(f32, u8)>) {
        let Some(Twist { from, to, steps }) = &self.twist else { return };
        let Some(place) = all.iter().position(|one| one.1 == self.joint) else { return };
        let (weight, along) = (all.swap_remove(place).0, sub(*to, *from));
        let t = dot(sub(p, *from), along) / dot(along, along).max(1e-12);
        let next = steps.iter().position(|step| step.0 > t).unwrap_or(steps.len());
        match (next.checked_sub(1).map(|k| steps[k]), steps.get(next)) {
            (Some((low, before)), Some(&(high, after))) => {
                let share = (t - low) / (high - low);
                all.extend([(weight * (1.0 - share), before), (weight * share, after)]);
            }
            (Some((_, only)), None) | (None, Some(&(_, only))) => all.push((weight, only)),
            (None, None) => all.push((weight, self.joint)),
        }
    }
}

/// Keeps the four largest weights, and normalises them.
pub(super) fn normalized(mut all: Vec<(f32, u8)>) -> Weights {
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let sum: f32 = all.iter().take(4).map(|one| one.0).sum();
    all.retain(|one| one.0 >= MIN_WEIGHT * sum);
    all.truncate(4);
    let sum: f32 = all.iter().map(|one| one.0).sum();
    let (mut joints, mut weights) = ([0; 4], [0.0; 4]);
    for (slot, (weight, joint)) in all.into_iter().enumerate() {
        joints[slot] = joint;
        weights[slot] = weight / sum;
    }
    (joints, weights)
}

impl Bone {
    fn distance(&self, p: V) -> f32 {
        let (along, from) = (sub(self.b, self.a), sub(p, self.a));
        let t = (dot(from, along) / dot(along, along).max(1e-12)).clamp(0.0, 1.0);
        length(sub(from, scale(along, t))) - self.radius
    }
}

/// Bones of trunk and arms.
pub(super) fn upper(rest: &Rest) -> Skin {
    let size = rest.size;
    let [pelvis, spine1, spine2, spine3, neck] = ["pelvis", "spine1", "spine2", "spine3", "neck"].map(|n| rest.at(n));
    let across = |p: V, half: f32| [[p[0] - half * size, p[1], p[2]], [p[0] + half * size, p[1], p[2]]];
    let low = add(rest.middle("hip"), [0.0, -0.02 * size, 0.0]);
    let mut skin = Skin::new(0.024 * size);
    for (name, place) in [("pelvis", low), ("pelvis", pelvis), ("spine1", spine1), ("spine2", spine2)] {
        let [a, b] = across(place, 0.06);
        skin = skin.bone(name, a, b, 0.09 * size);
    }
    let chest = add(spine3, scale(sub(neck, spine3), 0.45));
    let [a, b] = across(chest, 0.06);
    skin = skin.bone("spine3", a, b, 0.095 * size);
    for side in ["left", "right"] {
        let [collar, shoulder, elbow, wrist] = ["collar", "shoulder", "elbow", "wrist"].map(|n| rest.side(side, n));
        let name = |joint: &str| format!("{side}_{joint}");
        skin = skin
            .bone(&name("collar"), add(collar, scale(sub(shoulder, collar), 0.25)), shoulder, 0.05 * size)
            .bone(&name("shoulder"), add(shoulder, scale(sub(elbow, shoulder), 0.08)), elbow, 0.05 * size)
            .bone(&name("elbow"), elbow, wrist, 0.042 * size)
            .spread(
                rest,
                side,
                (&["shoulder"], "elbow", "wrist"),
                &[(0.12, "elbow_swing"), (0.32, "elbow_twist"), (0.54, "elbow"), (0.78, "wrist_twist")],
            )
            .spread(
                rest,
                side,
                (&["collar", "spine3"], "shoulder", "elbow"),
                &[(0.10, "shoulder_swing"), (0.45, "shoulder_twist"), (0.80, "shoulder")],
            );
    }
    // The hem follows the trousers.
    thighs(skin, rest)
}

fn thighs(mut skin: Skin, rest: &Rest) -> Skin {
    for side in ["left", "right"] {
        let [hip, knee] = ["hip", "knee"].map(|n| rest.side(side, n));
        skin = skin
            .bone(&format!("{side}_hip"), add(hip, scale(sub(knee, hip), 0.12)), knee, 0.075 * rest.size)
            .spread(rest, side, (&["pelvis"], "hip", "knee"), &[]);
    }
    skin
}

/// Bones of hips and legs.
pub(super) fn lower(rest: &Rest) -> Skin {
    let size = rest.size;
    let mut skin = Skin::new(0.022 * size);
    let hips = ["left", "right"].map(|side| rest.side(side, "hip"));
    let lift = [0.0, 0.045 * size, 0.0];
    skin = skin.bone("pelvis", add(hips[0], lift), add(hips[1], lift), 0.095 * size);
    for side in ["left", "right"] {
        let [knee, ankle] = ["knee", "ankle"].map(|n| rest.side(side, n));
        skin = skin.bone(&format!("{side}_knee"), knee, ankle, 0.055 * size).spread(
            rest,
            side,
            (&["hip"], "knee", "ankle"),
            &[],
        );
    }
    thighs(skin, rest)
}

/// Bones of one foot.
pub(super) fn foot(rest: &Rest, side: &str) -> Skin {
    let size = rest.size;
    let [ankle, foot] = ["ankle", "foot"].map(|n| rest.side(side, n));
    let toes = add(foot, [0.0, 0.0, 0.06 * size]);
    Skin::new(0.016 * size)
        .bone(&format!("{side}_ankle"), ankle, add(ankle, scale(sub(foot, ankle), 0.8)), 0.04 * size)
        .bone(&format!("{side}_foot"), foot, toes, 0.035 * size)
}

/// Weights of the sock: the foot's at the ankle, the leg's inside the trousers.
pub(super) fn sock(rest: &Rest, side: &str, p: V) -> Weights {
    let (ankle, size) = (rest.side(side, "ankle"), rest.size);
    let up = ramp(-0.006 * size, 0.020 * size, p[1] - ankle[1]);
    normalized(vec![(up, number(&format!("{side}_knee"))), (1.0 - up, number(&format!("{side}_ankle")))])
}

/// Bones of one hand, and the forearm's for the part inside the sleeve.
pub(super) struct Hand {
    skin: Skin,
    wrist: V,
    /// Direction from the elbow to the wrist, of unit length.
    along: V,
    size: f32,
    /// The joint that the forearm's end follows.
    forearm: u8,
}

impl Hand {
    pub(super) fn new(rest: &Rest, side: &str, fingers: &[&str; 5]) -> Self {
        let at = |name: &str| rest.side(side, name);
        let (wrist, size) = (at("wrist"), rest.between(&format!("{side}_wrist"), &format!("{side}_middle1")) / 0.095);
        let mut skin = Skin::new(0.0055 * size);
        let wrist_name = format!("{side}_wrist");
        for finger in fingers {
            let [a, b, c] = [1, 2, 3].map(|bone| at(&format!("{finger}{bone}")));
            let radius = 0.009 * size;
            let name = |bone: u8| format!("{side}_{finger}{bone}");
            let short = if *finger == "thumb" { 0.6 } else { 0.88 };
            skin = skin
                .bone(&wrist_name, wrist, add(wrist, scale(sub(a, wrist), short)), radius * 1.1)
                .bone(&name(1), a, b, radius)
                .bone(&name(2), b, c, radius)
                .bone(&name(3), c, rest.finger_tip(side, finger), radius);
        }
        let along = unit(sub(wrist, at("elbow")));
        Self { skin, wrist, along, size, forearm: number(&format!("{side}_wrist_twist")) }
    }

    /// Weights of a vertex. From the cuff on, only the forearm's count, so bending the wrist does not expose what the
    /// sleeve hides.
    pub(super) fn weights(&self, p: V) -> Weights {
        let (joints, weights) = self.skin.weights(p);
        let hand = ramp(-0.0165 * self.size, 0.012 * self.size, dot(sub(p, self.wrist), self.along));
        let own = joints.into_iter().zip(weights).map(|(joint, weight)| (weight * hand, joint));
        normalized(own.filter(|one| one.0 > 0.0).chain([(1.0 - hand, self.forearm)]).collect())
    }
}
