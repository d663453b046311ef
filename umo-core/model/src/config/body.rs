//! Parts with codes, and the body channels that each of them moves (SPEC 2.12).

use std::ops::Range;

use umo_core_pose::part::{Part, PerPart};
use umo_core_pose::pose::{FIRST_CONTACT, FIRST_FACE_VALUE};
use umo_core_pose::skeleton::{JOINT_NAMES, joints_of};

use super::{Codec, Config, Face, Layout, PartSpec, Sampling};

/// Channels of the lower body between its rotations and its foot contacts.
pub(super) const ROOT_VELOCITY: &str = "root_velocity";
/// The lower body's last channels.
pub(super) const CONTACTS: &str = "contacts";

/// Channels of one of the four body parts, as listed by a part of the config.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channels {
    /// The body part.
    pub part: Part,
    /// Ranges within the body part's channels, in the order of the config's part.
    pub ranges: Vec<Range<usize>>,
}

impl Channels {
    /// Number of channels.
    pub fn count(&self) -> usize {
        self.ranges.iter().map(Range::len).sum()
    }
}

/// Names of a body part's channels with their ranges, in order: a joint's name is its 6D rotation, a face channel's
/// name one value, `root_velocity` three and `contacts` four.
pub fn channel_names(part: Part, face: &Face) -> Vec<(&str, Range<usize>)> {
    let joints = joints_of(part).enumerate().map(|(i, joint)| (JOINT_NAMES[joint], 6 * i..6 * i + 6));
    let mut names: Vec<_> = joints.collect();
    match part {
        Part::Face => {
            let values = face.names.iter().map(String::as_str).zip(FIRST_FACE_VALUE..);
            names.extend(values.map(|(name, at)| (name, at..at + 1)));
        }
        Part::Lower => {
            names.push((ROOT_VELOCITY, FIRST_CONTACT - 3..FIRST_CONTACT));
            names.push((CONTACTS, FIRST_CONTACT..FIRST_CONTACT + 4));
        }
        Part::Hands | Part::Upper => {}
    }
    names
}

impl PartSpec {
    /// Whether it has no channels.
    pub fn is_annotation(&self) -> bool {
        self.channels.is_empty()
    }

    /// Whether its channels belong to the face.
    pub(crate) fn is_face(&self, face: &Face) -> bool {
        self.channels(face).is_some_and(|channels| channels.part == Part::Face)
    }

    /// Dimensions of its decoder for this number of channels.
    pub fn codec(&self, channels: usize) -> Codec {
        Codec { channels, layers: self.layers }
    }

    /// Ranges of its channels; `None` for an annotation, or if a name is unknown or belongs to another body part than
    /// the first.
    pub fn channels(&self, face: &Face) -> Option<Channels> {
        let first = self.channels.first()?;
        Part::ALL.into_iter().find_map(|part| {
            let names = channel_names(part, face);
            let place = |wanted: &String| names.iter().find(|(name, _)| name == wanted).map(|(_, at)| at.clone());
            place(first)?;
            Some(Channels { part, ranges: self.channels.iter().map(place).collect::<Option<_>>()? })
        })
    }
}

impl Config {
    /// Audio tokens, counted from a keyframe's first, whose encoder states the depth network reads: none, one for all
    /// parts, or one for the face's parts and one for the others.
    #[doc(hidden)]
    pub fn heard_tokens(&self) -> impl Iterator<Item = usize> + Clone + use<> {
        let depth = self.depth.as_ref();
        [depth.and_then(|depth| depth.heard), depth.and_then(|depth| depth.body_heard)].into_iter().flatten()
    }

    /// Parts with codes: [`Self::parts`], or the paper's four parts of one level.
    pub fn part_list(&self) -> Vec<PartSpec> {
        let of = |part: Part| PartSpec {
            name: part.name().to_owned(),
            channels: channel_names(part, &self.face).into_iter().map(|(name, _)| name.to_owned()).collect(),
            codes: self.vq.codes,
            levels: 1,
            width: self.vq.width,
            layers: self.vq[part].layers,
            rest: vec![self.rest[part]],
            sampling: None,
        };
        self.parts.clone().unwrap_or_else(|| Part::ALL.map(of).to_vec())
    }

    /// Number of codes of each of the four parts in layout `parts`.
    #[doc(hidden)]
    pub fn part_codes(&self) -> usize {
        self.parts.as_ref().and_then(|parts| parts.first()).map_or(self.vq.codes, |first| first.codes)
    }

    /// Sampling of the four parts in layout `parts`, if it differs from the session's.
    pub(crate) fn part_sampling(&self) -> PerPart<Option<Sampling>> {
        PerPart::from_fn(|part| self.parts.as_ref().and_then(|parts| parts[part as usize].sampling))
    }

    /// Whether a position of the decoder is a keyframe.
    pub fn is_frames(&self) -> bool {
        self.layout == Layout::Frames
    }

    /// Codes of one keyframe: the levels of all parts.
    pub fn codes_per_keyframe(&self) -> usize {
        self.parts.as_ref().map_or(Part::ALL.len(), |parts| parts.iter().map(|part| part.levels).sum())
    }
}
