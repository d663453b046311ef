//! Reflectance of surfaces.

/// Reflectance in the terms of physically based renderers; 255 stands for 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Finish {
    /// 0 is a mirror, 255 is chalk.
    pub roughness: u8,
    /// 255 for metal.
    pub metalness: u8,
}

impl Finish {
    pub(crate) const CLOTH: Self = Self::of(235);
    pub(crate) const SKIN: Self = Self::of(138);
    pub(crate) const LIP: Self = Self::of(115);
    pub(crate) const NAIL: Self = Self::of(82);
    pub(crate) const HAIR: Self = Self::of(158);
    pub(crate) const EYE: Self = Self::of(26);
    pub(crate) const TEETH: Self = Self::of(110);
    pub(crate) const TONGUE: Self = Self::of(90);
    pub(crate) const LEATHER: Self = Self::of(118);
    pub(crate) const RUBBER: Self = Self::of(200);
    pub(crate) const BRASS: Self = Self { roughness: 92, metalness: 255 };

    const fn of(roughness: u8) -> Self {
        Self { roughness, metalness: 0 }
    }
}
