//! The target skeleton at rest.

use umo_core_pose::rotation::{IDENTITY, Quat, inverse, normalized, product, rotate};

use super::RetargetError;

/// Upper bound on the bones of a rig.
pub const MAX_BONES: usize = 1 << 16;

/// Tolerance of a bone's scale between axes, relative to the largest.
const EVEN: f32 = 1e-3;

/// A bone at rest, relative to its parent: scaled, then rotated, then translated.
#[derive(Clone, Debug, PartialEq)]
pub struct Bone {
    /// Name; may be empty.
    pub name: String,
    /// Index of the parent bone.
    pub parent: Option<usize>,
    /// In the file's unit.
    pub translation: [f32; 3],
    /// Any non-zero length.
    pub rotation: Quat,
    /// Along the bone's axes.
    pub scale: [f32; 3],
    /// Whether a mesh follows it; of two bones with one name, such a bone is preferred.
    pub deforms: bool,
}

impl Bone {
    /// Creates a bone without rotation or scale at rest.
    pub fn new(name: impl Into<String>, parent: Option<usize>, translation: [f32; 3]) -> Self {
        Self { name: name.into(), parent, translation, rotation: IDENTITY, scale: [1.0; 3], deforms: false }
    }
}

/// World transform of a bone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct World {
    pub(super) place: [f32; 3],
    pub(super) rotation: Quat,
    /// Scale of the bone's children.
    pub(super) scale: f32,
}

impl World {
    pub(super) const ORIGIN: Self = Self { place: [0.0; 3], rotation: IDENTITY, scale: 1.0 };

    /// World position of a point at `place` in this bone's frame.
    pub(super) fn at(&self, place: [f32; 3]) -> [f32; 3] {
        let turned = rotate(self.rotation, place.map(|x| x * self.scale));
        std::array::from_fn(|i| self.place[i] + turned[i])
    }

    /// Position in this bone's frame of a point at `place` in the world.
    pub(super) fn within(&self, place: [f32; 3]) -> [f32; 3] {
        let apart = std::array::from_fn(|i| place[i] - self.place[i]);
        rotate(inverse(self.rotation), apart).map(|x| x / self.scale)
    }
}

/// Validated bones: one or more trees with finite numbers.
#[derive(Clone, Debug)]
pub struct Rig {
    bones: Vec<Bone>,
    /// Every bone, parents before their children.
    order: Vec<usize>,
    /// World transforms at rest.
    world: Vec<World>,
    /// Nearest unevenly scaled ancestor.
    uneven: Vec<Option<usize>>,
}

impl Rig {
    /// Validates bones, which may be in any order, and normalises their rotations.
    ///
    /// # Errors
    /// [`RetargetError`] if there are more than [`MAX_BONES`], a parent is missing, a bone is its own ancestor, or a
    /// number is not finite.
    pub fn new(mut bones: Vec<Bone>) -> Result<Self, RetargetError> {
        if bones.len() > MAX_BONES {
            return Err(RetargetError::TooMany { bones: bones.len(), limit: MAX_BONES });
        }
        let order = order(&bones)?;
        for bone in &mut bones {
            check_numbers(bone)?;
            bone.rotation = normalized(bone.rotation);
        }
        let mut world = vec![World::ORIGIN; bones.len()];
        let mut uneven = vec![None; bones.len()];
        for &at in &order {
            let bone = &bones[at];
            let above = bone.parent.map_or(World::ORIGIN, |parent| world[parent]);
            world[at] = World {
                place: above.at(bone.translation),
                rotation: product(above.rotation, bone.rotation),
                scale: above.scale * bone.scale.iter().sum::<f32>() / 3.0,
            };
            if !world[at].place.iter().all(|x| x.is_finite()) || !world[at].scale.is_finite() {
                return Err(RetargetError::NotFinite(bone.name.clone()));
            }
            uneven[at] = bone.parent.and_then(|parent| uneven[parent].or((!is_even(&bones[parent])).then_some(parent)));
        }
        Ok(Self { bones, order, world, uneven })
    }

    /// The bones, in the order given.
    pub fn bones(&self) -> &[Bone] {
        &self.bones
    }

    /// Number of bones.
    pub fn len(&self) -> usize {
        self.bones.len()
    }

    /// Whether there are no bones.
    pub fn is_empty(&self) -> bool {
        self.bones.is_empty()
    }

    /// World position of a bone at rest, in the file's unit. Panics if the index is out of range.
    pub fn place(&self, bone: usize) -> [f32; 3] {
        self.world[bone].place
    }

    /// World rotation of a bone at rest. Panics if the index is out of range.
    pub fn rotation(&self, bone: usize) -> Quat {
        self.world[bone].rotation
    }

    /// Whether `bone` is `above` or one of its descendants.
    pub fn is_below(&self, bone: usize, above: usize) -> bool {
        let mut at = Some(bone);
        while let Some(bone) = at {
            if bone == above {
                return true;
            }
            at = self.bones[bone].parent;
        }
        false
    }

    pub(crate) fn order(&self) -> &[usize] {
        &self.order
    }

    /// Position of a bone's child, if it has exactly one.
    pub(super) fn tip(&self, bone: usize) -> Option<[f32; 3]> {
        let mut below = (0..self.len()).filter(|&child| self.bones[child].parent == Some(bone));
        below.next().filter(|_| below.next().is_none()).map(|child| self.place(child))
    }

    /// Rejects a bone with an unevenly scaled ancestor.
    pub(super) fn check_scale(&self, bone: usize) -> Result<(), RetargetError> {
        self.uneven[bone].map_or(Ok(()), |above| Err(RetargetError::Scale(self.bones[above].name.clone())))
    }

    /// All non-empty names, for messages.
    pub(crate) fn names(&self) -> Vec<String> {
        self.bones.iter().map(|bone| bone.name.clone()).filter(|name| !name.is_empty()).collect()
    }
}

/// Indices of all bones, parents first. Bones that are not reached are part of a cycle.
fn order(bones: &[Bone]) -> Result<Vec<usize>, RetargetError> {
    let mut below = vec![Vec::new(); bones.len()];
    let mut order = Vec::with_capacity(bones.len());
    for (at, bone) in bones.iter().enumerate() {
        match bone.parent {
            None => order.push(at),
            Some(parent) => {
                below.get_mut(parent).ok_or_else(|| RetargetError::Parent { bone: bone.name.clone(), parent })?.push(at)
            }
        }
    }
    let mut next = 0;
    while let Some(&at) = order.get(next) {
        order.extend_from_slice(&below[at]);
        next += 1;
    }
    if order.len() == bones.len() {
        return Ok(order);
    }
    let mut reached = vec![false; bones.len()];
    order.iter().for_each(|&at| reached[at] = true);
    let lost = reached.iter().position(|reached| !reached).expect("fewer were reached than there are");
    Err(RetargetError::Cycle(bones[lost].name.clone()))
}

fn check_numbers(bone: &Bone) -> Result<(), RetargetError> {
    let numbers = bone.translation.iter().chain(&bone.rotation).chain(&bone.scale);
    let length = bone.rotation.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
    match numbers.into_iter().all(|x| x.is_finite()) && length > 1e-12 {
        true => Ok(()),
        false => Err(RetargetError::NotFinite(bone.name.clone())),
    }
}

fn is_even(bone: &Bone) -> bool {
    let (least, most) = bone.scale.iter().fold((f32::MAX, f32::MIN), |(a, b), &x| (a.min(x), b.max(x)));
    least > 1e-9 && most - least <= EVEN * most
}
