//! Differences between the figures: build, clothes, hair and colours.

use crate::vector::mix;
use std::fmt;
use std::str::FromStr;

/// One of the figures: two builds with two looks each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Figure {
    /// Straight build, short brown hair, sweater.
    #[default]
    Alex,
    /// Curved build, auburn bob, blouse with a belt.
    Bea,
    /// Straight build, dark skin, cropped black hair, shirt with a belt.
    Carl,
    /// Curved build, olive skin, black hair in a bun, sweater.
    Dina,
}

impl Figure {
    /// All figures.
    pub const ALL: [Self; 4] = [Self::Alex, Self::Bea, Self::Carl, Self::Dina];

    /// Name by which programs select it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Alex => "alex",
            Self::Bea => "bea",
            Self::Carl => "carl",
            Self::Dina => "dina",
        }
    }

    /// A short description of its looks.
    pub fn summary(self) -> &'static str {
        match self {
            Self::Alex => "straight build, short brown hair, sweater",
            Self::Bea => "curved build, auburn bob, blouse with a belt",
            Self::Carl => "straight build, dark skin, cropped black hair, shirt with a belt",
            Self::Dina => "curved build, olive skin, black hair in a bun, sweater",
        }
    }

    pub(crate) fn look(self) -> &'static Look {
        match self {
            Self::Alex => &ALEX,
            Self::Bea => &BEA,
            Self::Carl => &CARL,
            Self::Dina => &DINA,
        }
    }
}

/// No figure has that name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownFigure(String);

impl fmt::Display for UnknownFigure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = Figure::ALL.map(Figure::name).join(", ");
        write!(f, "unknown figure `{}`; figures: {names}", self.0)
    }
}

impl std::error::Error for UnknownFigure {}

impl FromStr for Figure {
    type Err = UnknownFigure;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|figure| figure.name() == name).ok_or_else(|| UnknownFigure(name.to_owned()))
    }
}

pub(crate) type Color = [u8; 3];

/// Interpolates between two colours: `a` at 0, `b` at 1.
pub(crate) fn mix_color(a: Color, b: Color, t: f32) -> Color {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two bytes")]
    std::array::from_fn(|i| (f32::from(a[i]) * (1.0 - t) + f32::from(b[i]) * t).round() as u8)
}

/// Measures of a body of size 1, metres, or factors.
pub(crate) struct Build {
    /// Half widths and half depths of the trunk by height over the pelvis.
    pub(crate) width: &'static [(f32, f32)],
    pub(crate) depth: &'static [(f32, f32)],
    /// Forward offsets of the trunk's sections.
    pub(crate) forward: &'static [(f32, f32)],
    /// The chest's two volumes: radius and protrusion.
    pub(crate) chest: [f32; 2],
    /// Radius of the deltoid, and a factor on the arms' radii.
    pub(crate) shoulder: f32,
    pub(crate) arm: f32,
    pub(crate) thigh: f32,
    pub(crate) neck: f32,
    pub(crate) hand: f32,
    pub(crate) face: Face,
}

/// Factors and offsets of the head's solid.
pub(crate) struct Face {
    /// Width of jaw and chin, 1 for the straight build.
    pub(crate) jaw: f32,
    /// Protrusion of the brow ridge, in metres.
    pub(crate) brow: f32,
    /// Width of the nose, 1 for the straight build.
    pub(crate) nose: f32,
    /// Fullness of the lips.
    pub(crate) lips: f32,
    /// Length of the lashes, in metres.
    pub(crate) lashes: f32,
    /// Thickness of the brows, 1 for the straight build.
    pub(crate) brows: f32,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Top {
    /// Over the trousers, with a ribbed neck.
    Sweater,
    /// Tucked in, with a collar, and a belt over it.
    Shirt,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Hair {
    Short,
    Bob,
    Crop,
    Bun,
}

/// Skin colours. All lie in the plane of the first three, so that one small texture holds their blends.
pub(crate) struct Skin {
    pub(crate) base: Color,
    pub(crate) blush: Color,
    /// Occluded skin, and lash lines.
    pub(crate) shade: Color,
    pub(crate) lip: Color,
    pub(crate) nail: Color,
}

pub(crate) struct Look {
    pub(crate) build: &'static Build,
    pub(crate) top: Top,
    pub(crate) hair: Hair,
    pub(crate) skin: Skin,
    /// Hair: roots and tips.
    pub(crate) strands: [Color; 2],
    /// Iris: outer and inner part.
    pub(crate) iris: [Color; 2],
    pub(crate) cloth: Color,
    pub(crate) trousers: Color,
    pub(crate) belt: Color,
    pub(crate) shoes: Color,
    pub(crate) soles: Color,
}

impl Skin {
    /// A colour of that plane, by its shares of blush and shade.
    pub(crate) fn toned(&self, blush: f32, shade: f32) -> Color {
        let at = |color: Color| color.map(f32::from);
        let warm = mix(at(self.base), at(self.blush), blush);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
        mix(warm, at(self.shade), shade).map(|x| x.round().clamp(0.0, 255.0) as u8)
    }
}

static STRAIGHT: Build = Build {
    width: &[
        (-0.15, 0.146),
        (-0.09, 0.152),
        (0.0, 0.141),
        (0.09, 0.131),
        (0.16, 0.134),
        (0.26, 0.148),
        (0.33, 0.152),
        (0.385, 0.143),
        (0.425, 0.120),
        (0.455, 0.092),
        (0.485, 0.069),
        (0.52, 0.056),
        (0.56, 0.052),
    ],
    depth: &[
        (-0.15, 0.100),
        (-0.09, 0.104),
        (0.0, 0.097),
        (0.10, 0.088),
        (0.20, 0.095),
        (0.29, 0.104),
        (0.35, 0.101),
        (0.40, 0.088),
        (0.45, 0.069),
        (0.49, 0.056),
        (0.56, 0.052),
    ],
    forward: &[
        (-0.10, -0.012),
        (0.05, -0.006),
        (0.20, -0.008),
        (0.30, -0.006),
        (0.40, -0.020),
        (0.47, -0.034),
        (0.56, -0.026),
    ],
    chest: [0.060, 0.010],
    shoulder: 0.0415,
    arm: 1.0,
    thigh: 1.0,
    neck: 1.0,
    hand: 1.0,
    face: Face { jaw: 1.0, brow: 0.0016, nose: 1.0, lips: 1.14, lashes: 0.0050, brows: 1.0 },
};

static CURVED: Build = Build {
    width: &[
        (-0.15, 0.148),
        (-0.09, 0.156),
        (0.0, 0.140),
        (0.08, 0.118),
        (0.14, 0.113),
        (0.21, 0.122),
        (0.28, 0.131),
        (0.34, 0.134),
        (0.385, 0.127),
        (0.425, 0.104),
        (0.455, 0.080),
        (0.485, 0.060),
        (0.52, 0.049),
        (0.56, 0.046),
    ],
    depth: &[
        (-0.15, 0.102),
        (-0.09, 0.106),
        (0.0, 0.094),
        (0.09, 0.079),
        (0.16, 0.078),
        (0.25, 0.087),
        (0.32, 0.088),
        (0.37, 0.082),
        (0.42, 0.072),
        (0.46, 0.059),
        (0.49, 0.049),
        (0.56, 0.046),
    ],
    forward: &[
        (-0.10, -0.014),
        (0.05, -0.004),
        (0.20, -0.010),
        (0.30, -0.010),
        (0.40, -0.020),
        (0.47, -0.032),
        (0.56, -0.026),
    ],
    chest: [0.058, 0.022],
    shoulder: 0.0370,
    arm: 0.88,
    thigh: 1.0,
    neck: 0.88,
    hand: 0.92,
    face: Face { jaw: 0.87, brow: 0.0, nose: 0.88, lips: 1.20, lashes: 0.0072, brows: 0.72 },
};

static ALEX: Look = Look {
    build: &STRAIGHT,
    top: Top::Sweater,
    hair: Hair::Short,
    skin: Skin {
        base: [232, 186, 160],
        blush: [224, 150, 128],
        shade: [146, 92, 76],
        lip: [200, 128, 114],
        nail: [238, 196, 178],
    },
    strands: [[58, 40, 31], [118, 84, 60]],
    iris: [[74, 108, 122], [132, 164, 166]],
    cloth: [76, 124, 134],
    trousers: [60, 67, 82],
    belt: [70, 46, 34],
    shoes: [222, 218, 210],
    soles: [244, 242, 238],
};

static BEA: Look = Look {
    build: &CURVED,
    top: Top::Shirt,
    hair: Hair::Bob,
    skin: Skin {
        base: [240, 200, 178],
        blush: [232, 160, 142],
        shade: [158, 102, 88],
        lip: [204, 104, 104],
        nail: [226, 140, 140],
    },
    strands: [[92, 42, 26], [168, 88, 52]],
    iris: [[82, 104, 66], [140, 150, 96]],
    cloth: [236, 226, 212],
    trousers: [52, 74, 96],
    belt: [120, 74, 46],
    shoes: [96, 62, 46],
    soles: [58, 42, 36],
};

static CARL: Look = Look {
    build: &STRAIGHT,
    top: Top::Shirt,
    hair: Hair::Crop,
    skin: Skin {
        base: [128, 84, 62],
        blush: [126, 70, 52],
        shade: [62, 36, 28],
        lip: [122, 72, 64],
        nail: [170, 126, 108],
    },
    strands: [[24, 20, 19], [48, 40, 36]],
    iris: [[58, 36, 24], [96, 62, 40]],
    cloth: [142, 164, 196],
    trousers: [92, 84, 72],
    belt: [52, 36, 28],
    shoes: [64, 48, 42],
    soles: [34, 30, 28],
};

static DINA: Look = Look {
    build: &CURVED,
    top: Top::Sweater,
    hair: Hair::Bun,
    skin: Skin {
        base: [206, 154, 120],
        blush: [198, 122, 94],
        shade: [120, 74, 56],
        lip: [178, 96, 86],
        nail: [214, 160, 136],
    },
    strands: [[28, 22, 24], [66, 50, 48]],
    iris: [[66, 42, 28], [112, 76, 48]],
    cloth: [164, 82, 74],
    trousers: [46, 48, 58],
    belt: [40, 34, 32],
    shoes: [212, 206, 198],
    soles: [238, 236, 230],
};
