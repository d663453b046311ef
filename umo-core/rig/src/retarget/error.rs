//! Reasons for which a skeleton or mapping is rejected.

use std::fmt;

/// Rejected skeleton or mapping.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RetargetError {
    /// More bones than are supported.
    TooMany {
        /// Number of bones.
        bones: usize,
        /// Upper bound on the number of bones.
        limit: usize,
    },
    /// A bone whose parent does not exist.
    Parent {
        /// The bone's name.
        bone: String,
        /// The parent's index.
        parent: usize,
    },
    /// A bone that is its own ancestor.
    Cycle(String),
    /// A bone with a number that is not finite, or a zero-length rotation.
    NotFinite(String),
    /// A bone with uneven, mirrored or zero scale has driven descendants: rotating those would shear them.
    Scale(String),
    /// Not the name of one of umo's joints.
    NoJoint(String),
    /// A mapping names a bone that does not exist.
    NoBone {
        /// The joint for which it was given.
        joint: String,
        /// The name that was not found.
        bone: String,
        /// Every bone's name.
        bones: Vec<String>,
    },
    /// Several bones were given for a joint that takes one.
    Several(String),
    /// Joints that a body needs and for which no bone was found.
    Missing {
        /// Names of the joints.
        joints: Vec<&'static str>,
        /// Every bone's name.
        bones: Vec<String>,
    },
    /// A bone that is mapped to two joints.
    Twice(String),
    /// A bone that is not a descendant of the one that should be above it.
    Order {
        /// The bone.
        bone: String,
        /// The bone that should be its ancestor.
        above: String,
    },
    /// Hips, shoulders or their sides coincide, so up and left cannot be determined.
    Flat,
    /// The source skeleton does not have 55 joints with parents first, or has a number that is not finite.
    Source,
}

impl fmt::Display for RetargetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooMany { bones, limit } => write!(f, "{bones} bones, at most {limit} are taken"),
            Self::Parent { bone, parent } => write!(f, "bone `{bone}`: its parent, number {parent}, is not there"),
            Self::Cycle(bone) => write!(f, "bone `{bone}` is its own ancestor"),
            Self::NotFinite(bone) => write!(f, "bone `{bone}`: its rest pose is not finite"),
            Self::Scale(bone) => {
                write!(f, "bone `{bone}` is scaled unevenly, mirrored or to nothing, above bones that move")
            }
            Self::NoJoint(name) => write!(f, "`{name}` is not a joint"),
            Self::NoBone { joint, bone, bones } => {
                write!(f, "no bone `{bone}` for joint `{joint}`; the bones are ")?;
                list(f, bones)
            }
            Self::Several(joint) => write!(f, "joint `{joint}` is one bone: only `spine` and `neck` may be several"),
            Self::Missing { joints, bones } => {
                write!(f, "no bones found for {}; the bones are ", joints.join(", "))?;
                list(f, bones)
            }
            Self::Twice(bone) => write!(f, "bone `{bone}` was given to two joints"),
            Self::Order { bone, above } => write!(f, "bone `{bone}` does not hang below `{above}`"),
            Self::Flat => write!(f, "hips and shoulders lie in one line or place: up and left cannot be determined"),
            Self::Source => write!(f, "the source is not a skeleton of 55 joints with parents first"),
        }
    }
}

/// Lists at most `SHOWN` names, and the number of the others.
fn list(f: &mut fmt::Formatter<'_>, names: &[String]) -> fmt::Result {
    const SHOWN: usize = 60;
    if names.is_empty() {
        return f.write_str("none");
    }
    for (i, name) in names.iter().take(SHOWN).enumerate() {
        write!(f, "{}`{name}`", if i == 0 { "" } else { ", " })?;
    }
    if names.len() > SHOWN { write!(f, " and {} more", names.len() - SHOWN) } else { Ok(()) }
}

impl std::error::Error for RetargetError {}
