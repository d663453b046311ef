//! A mapping file: bones of joints, and shapes that follow channels. As TOML:
//!
//! ```toml
//! [bones]
//! pelvis = "Root_M"
//! spine = ["Spine1_M", "Chest_M"]
//! left_thumb1 = ""                  # has no bone
//!
//! [face]
//! jawOpen = "Mouth_Open"
//! eyeBlinkLeft = { Lid_L = 0.8 }
//!
//! [body]
//! gain = 1.0                        # 0 without
//! belly = 1.2                       # times its measured girth
//! ```

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::retarget::{Mapping, RetargetError, Rig, Volume};

/// The contents of a mapping file.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Given {
    /// Bones of each joint.
    bones: BTreeMap<String, Names>,
    /// Shapes that follow each channel.
    face: BTreeMap<String, Shapes>,
    /// `gain`, 0 by default, and factors of the parts of the body.
    body: BTreeMap<String, f32>,
}

/// Key of the gain in [`Given::body`].
const GAIN: &str = "gain";

#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(untagged)]
enum Names {
    One(String),
    Several(Vec<String>),
    /// Index among the file's nodes.
    Node(usize),
}

#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(untagged)]
enum Shapes {
    One(String),
    Several(Vec<String>),
    Shares(BTreeMap<String, f32>),
}

impl Given {
    /// Returns the mapping of a file's own table, or else by names, overridden by the given bones, and the naming
    /// convention.
    ///
    /// # Errors
    /// A joint or a bone does not exist.
    pub fn over(&self, rig: &Rig, table: Option<(Mapping, &'static str)>) -> Result<(Mapping, String), String> {
        let (mut mapping, convention) = match table {
            Some((mapping, version)) => (mapping, version.to_owned()),
            None => {
                let (mapping, convention) = Mapping::closest(rig);
                (mapping, format!("{convention} names"))
            }
        };
        self.apply(rig, &mut mapping).map_err(|error| error.to_string())?;
        Ok((mapping, convention))
    }

    /// Overrides bones of a mapping by the given ones.
    ///
    /// # Errors
    /// [`RetargetError`] if a joint or a bone does not exist.
    pub fn apply(&self, rig: &Rig, mapping: &mut Mapping) -> Result<(), RetargetError> {
        for (joint, names) in &self.bones {
            let names = match names {
                Names::One(name) => std::slice::from_ref(name),
                Names::Several(names) => names,
                Names::Node(node) if *node < rig.len() => {
                    mapping.put(joint, &[*node])?;
                    continue;
                }
                Names::Node(node) => {
                    let (joint, bone) = (joint.clone(), format!("node {node}"));
                    return Err(RetargetError::NoBone { joint, bone, bones: rig.names() });
                }
            };
            let names: Vec<_> = names.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
            mapping.set(rig, joint, &names)?;
        }
        Ok(())
    }

    /// Returns a volume with the given parts' factors, and the gain; `None` without a volume.
    ///
    /// # Errors
    /// A part does not exist, or a value is not in its range.
    pub fn volume(&self, volume: Option<Volume>) -> Result<Option<(Volume, f32)>, String> {
        let gain = self.body.get(GAIN).copied().unwrap_or(0.0);
        if !(0.0..=1.0).contains(&gain) {
            return Err(format!("body: gain {gain} is not between 0 and 1"));
        }
        let Some(mut volume) = volume else { return Ok(None) };
        for (part, &factor) in self.body.iter().filter(|(part, _)| *part != GAIN) {
            volume.scale(part, factor)?;
        }
        Ok(Some((volume, gain)))
    }

    /// Factor of the girth of a part of the body.
    pub fn girth(&self, part: &str) -> f32 {
        self.body.get(part).copied().unwrap_or(1.0)
    }

    /// Returns the given channels, the shapes that follow them, and their gains.
    pub fn shapes(&self) -> impl Iterator<Item = (&str, &str, f32)> {
        self.face.iter().flat_map(|(channel, shapes)| {
            let shares: Vec<(&str, f32)> = match shapes {
                Shapes::One(name) => vec![(name, 1.0)],
                Shapes::Several(names) => names.iter().map(|name| (name.as_str(), 1.0)).collect(),
                Shapes::Shares(shares) => shares.iter().map(|(name, &share)| (name.as_str(), share)).collect(),
            };
            let named = shares.into_iter().filter(|(name, _)| !name.is_empty());
            named.map(|(name, share)| (channel.as_str(), name, share)).collect::<Vec<_>>()
        })
    }
}
