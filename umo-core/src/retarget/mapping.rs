//! Which bone follows which joint.

use super::names::{self, Convention};
use super::{RetargetError, Rig};
use crate::motion::skeleton::{JOINT_NAMES, JOINTS};

/// Joints without whose bones there is no body, and the one that each must hang below.
const NEEDED: [(usize, Option<usize>); 9] = [
    (0, None),
    (1, Some(0)),
    (2, Some(0)),
    (4, Some(1)),
    (5, Some(2)),
    (16, Some(0)),
    (17, Some(0)),
    (18, Some(16)),
    (19, Some(17)),
];

/// Others, and the one that each must hang below where both are there.
const BELOW: [(usize, usize); 8] = [(7, 4), (8, 5), (10, 7), (11, 8), (20, 18), (21, 19), (15, 0), (22, 15)];

/// What a rig must have nothing of to be one without arms, and what else those carry: a bust has
/// shoulders, hands alone are no arms.
const ARMS: [usize; 4] = [18, 19, 20, 21];
const LEGS: [usize; 8] = [1, 2, 4, 5, 7, 8, 10, 11];

/// A bust has no more bones than this beside its head whose part is not known: others may be the
/// limbs that were not found.
const UNKNOWN: usize = 4;

/// The spine and the neck, which may be any number of bones.
pub(super) const CHAINS: [&str; 2] = ["spine", "neck"];

/// Bones for joints. Not every joint needs one: its turn then goes to nothing, or to what is mapped
/// below it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mapping {
    /// Of the rig's bones, the one for each joint.
    pub(super) bones: [Option<usize>; JOINTS],
    /// From the hips up: together they make the turns of `spine1` to `spine3`.
    pub(super) spine: Vec<usize>,
    /// From the chest up: together they make the turn of `neck`.
    pub(super) neck: Vec<usize>,
    /// Joints that were said to have no bone.
    waived: [bool; JOINTS],
}

impl Default for Mapping {
    fn default() -> Self {
        Self { bones: [None; JOINTS], spine: Vec::new(), neck: Vec::new(), waived: [false; JOINTS] }
    }
}

/// How a bone turns: as a joint does in the world, or between two.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Follow {
    /// Of the rig's bones.
    pub bone: usize,
    /// The two between whose rotations in the world the bone's turn lies.
    pub joints: [usize; 2],
    /// How near to the second; 1 is that one's.
    pub share: f32,
}

impl Mapping {
    /// What each bone that has a joint follows. Bones of a spine or a neck are spread evenly over
    /// the joints: the `k`-th of `n` of a spine takes the rotation at `3 k / n` of the way from the
    /// pelvis (0) to `spine3` (3).
    pub fn follows(&self) -> impl Iterator<Item = Follow> + '_ {
        let bones = self.bones.iter().enumerate();
        let single = bones.filter_map(|(joint, bone)| Some(Follow { bone: (*bone)?, joints: [joint; 2], share: 1.0 }));
        let chains = [(&self.spine, &[0, 3, 6, 9][..]), (&self.neck, &[9, 12])];
        let spread = chains.into_iter().flat_map(|(chain, joints)| {
            let follow = move |(k, &bone): (usize, &usize)| {
                let (joints, share) = spread(k + 1, chain.len(), joints);
                Follow { bone, joints, share }
            };
            chain.iter().enumerate().map(follow)
        });
        single.chain(spread)
    }

    /// Finds the bones by their names, in the convention of those that are known which fits best.
    ///
    /// # Errors
    /// [`RetargetError::Missing`] where none fits.
    pub fn guess(rig: &Rig) -> Result<(Self, &'static str), RetargetError> {
        let (mapping, convention) = Self::closest(rig);
        mapping.check(rig)?;
        Ok((mapping, convention))
    }

    /// What the best convention finds, which may not be enough. Of several bodies in one file it is
    /// the first.
    pub fn closest(rig: &Rig) -> (Self, &'static str) {
        let mut keys = names::keys(rig);
        let (mut mapping, mut name) = Self::best(rig, &keys);
        let others = mapping.other_bodies(rig, &keys);
        if !others.is_empty() {
            let of_other = |bone: usize| others.iter().any(|&top| rig.is_below(bone, top));
            (0..rig.len()).filter(|&bone| of_other(bone)).for_each(|bone| keys[bone] = names::Key::default());
            (mapping, name) = Self::best(rig, &keys);
        }
        mapping.waive(rig);
        (mapping, name)
    }

    /// The mapping of the convention that finds most.
    fn best(rig: &Rig, keys: &[names::Key]) -> (Self, &'static str) {
        let tried = names::CONVENTIONS.iter().map(|convention| (of_convention(rig, keys, convention), convention.name));
        let score = |mapping: &Self| {
            // Half a limb says nothing: what one calls the upper arm is another's clavicle.
            let lower = |joint: usize| match joint {
                1 | 2 => joint + 3,
                16 | 17 => joint + 2,
                _ => joint,
            };
            let has = |joint: usize| mapping.bones[joint].is_some();
            let needed = NEEDED.iter().filter(|&&(joint, _)| has(joint) && has(lower(joint))).count();
            let found = mapping.bones.iter().flatten().count() + mapping.spine.len() + mapping.neck.len();
            (needed, found)
        };
        let best = tried.reduce(|best, next| if score(&next.0) > score(&best.0) { next } else { best });
        best.expect("there are conventions")
    }

    /// Bodies beside this one, of bones with the same names: the topmost bone of each that this one
    /// does not hang on.
    pub(super) fn other_bodies(&self, rig: &Rig, keys: &[names::Key]) -> Vec<usize> {
        let [Some(hips), Some(left), Some(right)] = [0, 1, 2].map(|joint| self.bones[joint]) else { return Vec::new() };
        let is_as =
            |bone: usize, of: usize| keys[bone] == keys[of] && rig.bones()[bone].deforms == rig.bones()[of].deforms;
        let carries =
            |bone: usize, thigh: usize| (0..rig.len()).any(|other| is_as(other, thigh) && rig.is_below(other, bone));
        let is_apart = |bone: usize| !rig.is_below(bone, hips) && !rig.is_below(hips, bone);
        let is_body = |&bone: &usize| {
            is_as(bone, hips) && is_apart(bone) && [left, right].iter().all(|&thigh| carries(bone, thigh))
        };
        let top = |mut bone: usize| {
            while let Some(parent) = rig.bones()[bone].parent.filter(|&parent| !rig.is_below(hips, parent)) {
                bone = parent;
            }
            bone
        };
        (0..rig.len()).filter(is_body).map(top).collect()
    }

    /// A rig with a head, without legs or arms and without bones that may be those, is a bust or a
    /// head: what it has not is not missing.
    fn waive(&mut self, rig: &Rig) {
        let Some(head) = self.bones[15] else { return };
        let legs = LEGS.iter().all(|&joint| self.bones[joint].is_none());
        // Hands without arms, as those of avatars for headsets, stay with the body.
        let arms = ARMS[..2].iter().all(|&joint| self.bones[joint].is_none());
        if (!legs && !arms) || self.unknown(rig, head) > UNKNOWN {
            return;
        }
        let is_waived = |joint: usize| match joint {
            0 => legs && arms,
            1..=5 => legs,
            _ => arms,
        };
        for (joint, _) in NEEDED.into_iter().filter(|&(joint, _)| is_waived(joint)) {
            self.waived[joint] = self.bones[joint].is_none();
        }
        if arms {
            ARMS[2..].iter().copied().chain(25..JOINTS).for_each(|joint| self.bones[joint] = None);
        }
    }

    /// Bones of which it is not known what they are: they hang on the trunk or on nothing that is
    /// known, and carry nothing that is.
    fn unknown(&self, rig: &Rig, head: usize) -> usize {
        let mut carries = vec![false; rig.len()];
        for &bone in self.bones.iter().flatten().chain(&self.spine).chain(&self.neck) {
            let mut at = Some(bone);
            while let Some(bone) = at.filter(|&bone| !std::mem::replace(&mut carries[bone], true)) {
                at = rig.bones()[bone].parent;
            }
        }
        let limbs: Vec<_> = (13..JOINTS).filter(|&joint| joint != 15).filter_map(|joint| self.bones[joint]).collect();
        let skinned = rig.bones().iter().any(|bone| bone.deforms);
        let is_unknown = |&bone: &usize| {
            let on = |limb: &usize| rig.is_below(bone, *limb);
            (rig.bones()[bone].deforms || !skinned) && !carries[bone] && !on(&head) && !limbs.iter().any(on)
        };
        (0..rig.len()).filter(is_unknown).count()
    }

    /// Whether there is a body that moves about: a head alone stays where it is.
    pub(super) fn has_body(&self) -> bool {
        self.bones[0].is_some()
    }

    /// Gives a joint its bone, by name: none, one, or for `spine` and `neck` several, from below.
    /// With none the joint is known to have no bone, and is not looked for.
    ///
    /// # Errors
    /// [`RetargetError`] where there is no such joint or bone.
    pub fn set(&mut self, rig: &Rig, joint: &str, bones: &[&str]) -> Result<(), RetargetError> {
        let find = |name: &&str| {
            let mut named = (0..rig.len()).filter(|&bone| rig.bones()[bone].name == *name);
            let first = named.next();
            let found = named
                .find(|&bone| rig.bones()[bone].deforms)
                .filter(|_| first.is_some_and(|first| !rig.bones()[first].deforms));
            let missing =
                || RetargetError::NoBone { joint: joint.to_owned(), bone: (*name).to_owned(), bones: rig.names() };
            found.or(first).ok_or_else(missing)
        };
        let found = bones.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        self.put(joint, &found)
    }

    /// [`Self::set`] by the bones' indices. Panics later where there are none of them.
    ///
    /// # Errors
    /// [`RetargetError`] where there is no such joint, or several bones are given to one.
    pub fn put(&mut self, joint: &str, bones: &[usize]) -> Result<(), RetargetError> {
        match joint {
            "spine" => {
                self.spine = bones.to_vec();
                [3, 6, 9].into_iter().for_each(|joint| self.bones[joint] = None);
            }
            "neck" => {
                self.neck = bones.to_vec();
                self.bones[12] = None;
            }
            _ => {
                let at = JOINT_NAMES.iter().position(|&name| name == joint);
                let at = at.ok_or_else(|| RetargetError::NoJoint(joint.to_owned()))?;
                self.bones[at] = match bones {
                    [] => None,
                    [bone] => Some(*bone),
                    _ => return Err(RetargetError::Several(joint.to_owned())),
                };
                self.waived[at] = bones.is_empty();
                if [3, 6, 9].contains(&at) {
                    self.spine.clear();
                }
            }
        }
        Ok(())
    }

    /// The bone of a joint; of spine and neck only where they were given one by one. Panics where
    /// there is no such joint.
    pub fn bone(&self, joint: usize) -> Option<usize> {
        self.bones[joint]
    }

    /// Bones of the spine, from the hips up.
    pub fn spine(&self) -> &[usize] {
        &self.spine
    }

    /// Bones of the neck, from the chest up.
    pub fn neck(&self) -> &[usize] {
        &self.neck
    }

    /// What each joint's bones are, in the joints' order; spine and neck as the chains that they
    /// are.
    pub fn entries(&self) -> Vec<(&'static str, Vec<usize>)> {
        let mut entries = Vec::new();
        for (joint, name) in JOINT_NAMES.into_iter().enumerate() {
            match joint {
                3 if !self.spine.is_empty() || [3, 6, 9].iter().all(|&j| self.bones[j].is_none()) => {
                    entries.push((CHAINS[0], self.spine.clone()));
                }
                6 | 9 if [3, 6, 9].iter().all(|&j| self.bones[j].is_none()) => {}
                12 if self.bones[12].is_none() => entries.push((CHAINS[1], self.neck.clone())),
                _ => entries.push((name, self.bones[joint].into_iter().collect())),
            }
        }
        entries
    }

    /// Refuses a mapping that makes no body on `rig`.
    ///
    /// # Errors
    /// [`RetargetError`]: joints that are needed and missing, a bone of two joints, or one that
    /// hangs where it should not.
    pub fn check(&self, rig: &Rig) -> Result<(), RetargetError> {
        let missing = |&(joint, _): &(usize, Option<usize>)| self.bones[joint].is_none() && !self.waived[joint];
        let missing: Vec<_> = NEEDED.iter().filter(|need| missing(need)).map(|need| JOINT_NAMES[need.0]).collect();
        // The hips carry everything: without them a head stays where it is, and nothing else moves.
        let is_carried = self.has_body() || self.waived[0];
        if !missing.is_empty() || !is_carried {
            let joints = if missing.is_empty() { vec![JOINT_NAMES[0]] } else { missing };
            return Err(RetargetError::Missing { joints, bones: rig.names() });
        }
        let name = |bone: usize| rig.bones()[bone].name.clone();
        let mut seen = vec![false; rig.len()];
        for bone in self.bones.iter().flatten().chain(&self.spine).chain(&self.neck) {
            if std::mem::replace(&mut seen[*bone], true) {
                return Err(RetargetError::Twice(name(*bone)));
            }
        }
        let needed = NEEDED.iter().filter_map(|&(joint, above)| Some((joint, above?)));
        let fingers = (0..JOINTS - 25).map(|i| (25 + i, if i % 3 == 0 { 20 + i / 15 } else { 24 + i }));
        let pairs = needed.chain(BELOW).chain(fingers);
        let pairs = pairs.filter_map(|(joint, above)| self.bones[joint].zip(self.bones[above]));
        let chain = |chain: &[usize]| chain.windows(2).map(|pair| (pair[1], pair[0])).collect::<Vec<_>>();
        let spine = self.spine.first().map(|&first| (first, self.bones[0].unwrap_or(first)));
        for (bone, above) in pairs.chain(chain(&self.spine)).chain(chain(&self.neck)).chain(spine) {
            if bone == above || !rig.is_below(bone, above) {
                return Err(RetargetError::Order { bone: name(bone), above: name(above) });
            }
        }
        Ok(())
    }
}

/// For the `k`-th of `n` bones, counted from 1, the joints between which it lies and how near to
/// the second.
#[expect(clippy::cast_precision_loss, reason = "a chain has far fewer than 2^24 bones")]
fn spread(k: usize, n: usize, joints: &[usize]) -> ([usize; 2], f32) {
    let steps = (joints.len() - 1) * k;
    let (from, rest) = (steps / n, steps % n);
    match rest {
        0 => ([joints[from]; 2], 1.0),
        rest => ([joints[from], joints[from + 1]], rest as f32 / n as f32),
    }
}

/// The bones that a convention's names find.
fn of_convention(rig: &Rig, keys: &[names::Key], convention: &Convention) -> Mapping {
    let mut mapping = Mapping::default();
    let find = |side, alternatives: &str| names::find(rig, keys, side, alternatives);
    for (joint, side, alternatives) in convention.joints() {
        mapping.bones[joint] = find(side, alternatives);
    }
    let depth = |bone: usize| std::iter::successors(Some(bone), |&bone| rig.bones()[bone].parent).count();
    let chain = |list: &str| {
        let mut chain: Vec<_> = list.split(' ').filter_map(|key| find(names::Side::Middle, key)).collect();
        chain.sort_by_key(|&bone| depth(bone));
        chain
    };
    (mapping.spine, mapping.neck) = (chain(convention.spine), chain(convention.neck));
    mapping
}
