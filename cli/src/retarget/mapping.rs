//! The file that says which bone is what, TOML or JSON:
//!
//! ```toml
//! [bones]
//! pelvis = "Root_M"
//! spine = ["Spine1_M", "Chest_M"]
//! left_thumb1 = ""                  # there is none
//!
//! [face]
//! jawOpen = "Mouth_Open"
//! eyeBlinkLeft = { Lid_L = 0.8 }
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use umo_core::retarget::{Mapping, RetargetError, Rig};

use crate::failure::Failure;

/// What a mapping file says.
#[derive(Clone, Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Given {
    /// Joints, and their bones.
    bones: BTreeMap<String, Names>,
    /// Channels, and the shapes that follow them.
    face: BTreeMap<String, Shapes>,
}

#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(untagged)]
enum Names {
    One(String),
    Several(Vec<String>),
}

#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(untagged)]
enum Shapes {
    One(String),
    Several(Vec<String>),
    Shares(BTreeMap<String, f32>),
}

impl Given {
    /// Reads a file.
    ///
    /// # Errors
    /// Where in it something is not as it should be.
    pub(crate) fn read(path: &Path) -> Result<Self, Failure> {
        let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
        let text = umo_core::file::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
        let json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
        Self::parse(&text, json).map_err(wrong)
    }

    /// Reads a file's text.
    pub(crate) fn parse(text: &str, json: bool) -> Result<Self, String> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        match json {
            true => serde_json::from_str(text).map_err(|error| error.to_string()),
            false => toml::from_str(text).map_err(|error| error.to_string()),
        }
    }

    /// What is what by a file's own table, or else by names, with what is given over that; and who
    /// names so.
    pub(crate) fn over(&self, rig: &Rig, table: Option<(Mapping, &'static str)>) -> Result<(Mapping, String), String> {
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

    /// Puts the bones in a mapping, over what it has.
    pub(crate) fn apply(&self, rig: &Rig, mapping: &mut Mapping) -> Result<(), RetargetError> {
        for (joint, names) in &self.bones {
            let names = match names {
                Names::One(name) => std::slice::from_ref(name),
                Names::Several(names) => names,
            };
            let names: Vec<_> = names.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
            mapping.set(rig, joint, &names)?;
        }
        Ok(())
    }

    /// Channels, the shapes that follow them, and how much.
    pub(crate) fn shapes(&self) -> impl Iterator<Item = (&str, &str, f32)> {
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
