//! Assignment of bones to joints.

use umo_core_pose::skeleton::{JOINT_NAMES, JOINTS};

use super::names::{self, Convention};
use super::{RetargetError, Rig};

/// Joints that a body needs, with the joint that each must be below.
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

/// Optional joints, with the joint that each must be below if both are mapped.
const BELOW: [(usize, usize); 8] = [(7, 4), (8, 5), (10, 7), (11, 8), (20, 18), (21, 19), (15, 0), (22, 15)];

/// Elbows and wrists. A rig without elbows has no arms and its wrists are unmapped: a bust has shoulders, and hands
/// alone are not arms.
const ARMS: [usize; 4] = [18, 19, 20, 21];
const LEGS: [usize; 8] = [1, 2, 4, 5, 7, 8, 10, 11];

/// Upper bound on the unidentified bones of a bust, outside its head: if there are more, they may be limbs that were
/// not found.
const UNKNOWN: usize = 4;

/// Spine and neck, which may have any number of bones.
pub(super) const CHAINS: [&str; 2] = ["spine", "neck"];

/// Bones of the joints. A joint may have none; the next mapped joints below it then take up its rotation, if there
/// are any.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mapping {
    /// The rig's bone of each joint.
    pub(super) bones: [Option<usize>; JOINTS],
    /// From the hips up; together they rotate like `spine1` to `spine3`.
    pub(super) spine: Vec<usize>,
    /// From the chest up; together they rotate like `neck`.
    pub(super) neck: Vec<usize>,
    /// Joints that are known to have no bone.
    waived: [bool; JOINTS],
}

impl Default for Mapping {
    fn default() -> Self {
        Self { bones: [None; JOINTS], spine: Vec::new(), neck: Vec::new(), waived: [false; JOINTS] }
    }
}

/// Source of a bone's rotation: a joint's world rotation, or one interpolated between two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Follow {
    /// Index of the bone in the rig.
    pub bone: usize,
    /// The two joints whose world rotations are interpolated.
    pub joints: [usize; 2],
    /// Interpolation weight of the second joint; 1 uses it alone.
    pub share: f32,
}

impl Mapping {
    /// Returns what each mapped bone follows. Bones of a spine or neck are spread evenly over the joints: the `k`-th
    /// of `n` of a spine takes the rotation at `3 k / n` of the way from the pelvis (0) to `spine3` (3).
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

    /// Finds the bones by name, with the known convention that fits best, and returns its name.
    ///
    /// # Errors
    /// [`RetargetError::Missing`] if none fits.
    pub fn guess(rig: &Rig) -> Result<(Self, &'static str), RetargetError> {
        let (mapping, convention) = Self::closest(rig);
        mapping.check(rig)?;
        Ok((mapping, convention))
    }

    /// Returns the best convention's mapping, which may be incomplete. Of several bodies in one file it maps the
    /// first.
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

    /// The mapping of the convention that finds the most bones.
    fn best(rig: &Rig, keys: &[names::Key]) -> (Self, &'static str) {
        let tried = names::CONVENTIONS.iter().map(|convention| (of_convention(rig, keys, convention), convention.name));
        let score = |mapping: &Self| {
            // Half a limb proves nothing: one convention's upper arm is another's clavicle.
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

    /// Returns the topmost bone of each further body: bones with the same names that do not belong to this one.
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

    /// Waives joints of a bust or a head: a rig that has a head but no legs or no arms, and no bones that could be
    /// those. Absent limbs are then not reported as missing.
    fn waive(&mut self, rig: &Rig) {
        let Some(head) = self.bones[15] else { return };
        let legs = LEGS.iter().all(|&joint| self.bones[joint].is_none());
        // Hands without arms, as in avatars for headsets, stay with the body.
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

    /// Number of unidentified bones: they are not below the head or an identified limb, and have no identified
    /// descendants.
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

    /// Whether there is a body that moves; a head alone stays in place.
    pub(super) fn has_body(&self) -> bool {
        self.bones[0].is_some()
    }

    /// Sets the bones of a joint by name: none, one, or for `spine` and `neck` several, from the lowest up. With
    /// none, the joint is known to have no bone and is not required.
    ///
    /// # Errors
    /// [`RetargetError`] if the joint or a bone does not exist, or several bones are given for a joint that takes
    /// one.
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

    /// [`Self::set`] by bone index. Later calls panic if an index is out of range.
    ///
    /// # Errors
    /// [`RetargetError`] if the joint does not exist, or several bones are given for a joint that takes one.
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

    /// The bone of a joint; of spine and neck only if it was set individually. Panics if the index is out of range.
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

    /// Returns the bones of each joint, in the order of the joints; spine and neck as chains.
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

    /// Checks that the mapping describes a body on `rig`.
    ///
    /// # Errors
    /// [`RetargetError`] if required joints are missing, a bone is mapped twice, or a bone is not below the one that
    /// it should be.
    pub fn check(&self, rig: &Rig) -> Result<(), RetargetError> {
        let missing = |&(joint, _): &(usize, Option<usize>)| self.bones[joint].is_none() && !self.waived[joint];
        let missing: Vec<_> = NEEDED.iter().filter(|need| missing(need)).map(|need| JOINT_NAMES[need.0]).collect();
        // Without the hips, a head stays in place and nothing else moves.
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

/// For the `k`-th of `n` bones, counted from 1: the two joints to interpolate, and the weight of the second.
#[expect(clippy::cast_precision_loss, reason = "a chain has far fewer than 2^24 bones")]
fn spread(k: usize, n: usize, joints: &[usize]) -> ([usize; 2], f32) {
    let steps = (joints.len() - 1) * k;
    let (from, rest) = (steps / n, steps % n);
    match rest {
        0 => ([joints[from]; 2], 1.0),
        rest => ([joints[from], joints[from + 1]], rest as f32 / n as f32),
    }
}

/// Maps the bones that a convention's names match.
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
