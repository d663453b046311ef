//! Encoder input: templates and their placeholders (SPEC 2.2, 2.3).

use std::ops::Range;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{Arena, Slice};
use umo_core_pose::part::{Part, PerPart};

use crate::config::{Config, Modality, TemplateItem};

/// Maximum number of tokens in a free text prompt.
pub const MAX_PROMPT_TOKENS: usize = 128;

/// Length of the longest template of the model, in tokens.
pub fn max_encoder_tokens(config: &Config) -> usize {
    let longest = config.templates.values().map(|items| items.iter().map(|item| item_len(config, item)).sum());
    longest.max().unwrap_or(1)
}

/// Length of the longest chunk in decoder tokens: the start id, then four blocks with their markers. In
/// layout `frames`, one token per keyframe.
pub fn max_decoder_tokens(config: &Config) -> usize {
    if config.is_frames() { config.max_target } else { 1 + 4 * (config.max_target + 2) }
}

/// Number of audio tokens in the window of a chunk that predicts `target` keyframes, including the audio of
/// the keyframes behind the chunk.
pub fn window_tokens(config: &Config, target: usize) -> usize {
    (config.prefix + target + config.audio.ahead) * config.tokens_per_keyframe()
}

fn item_len(config: &Config, item: &TemplateItem) -> usize {
    match item {
        TemplateItem::Id(_) => 1,
        TemplateItem::Name(name) if name == "audio" => window_tokens(config, config.max_target) + 2,
        TemplateItem::Name(name) if name == "text" => MAX_PROMPT_TOKENS,
        TemplateItem::Name(name) if name == "history" => config.prefix,
        TemplateItem::Name(_) => config.prefix + 2,
    }
}

/// One item of a template, resolved.
#[derive(Clone, Copy, Debug)]
enum Slot {
    Id(u32),
    Audio,
    Text,
    History(Part),
    Keyframes,
}

/// Values for the placeholders of a template.
#[derive(Clone, Debug, Default)]
pub struct Prompt<'a> {
    /// Audio units of the window; ignored if the template has no audio.
    pub units: &'a [u32],
    /// Number of audio tokens at the end of the window that are still unknown; masks replace them.
    pub hidden_units: usize,
    /// Codes of the last keyframes, `[P, parts]`; ignored in layout `frames`.
    pub history: &'a [u16],
    /// Ids of the last keyframes, which follow the vocabulary; ignored in layout `parts`.
    pub keyframes: Range<u32>,
    /// Ids of a free text; ignored if the template has no text.
    pub text: &'a [u32],
}

/// A template with resolved placeholders.
#[derive(Clone, Debug)]
pub struct Template {
    slots: Slice<Slot>,
    has_audio: bool,
    has_text: bool,
    audio: Modality,
    parts: PerPart<Modality>,
    /// Upper bound of the ids of text. Keyframes in layout `frames` have ids from here on.
    text_ids: u32,
}

impl Template {
    /// Resolves the template `name` of a model.
    ///
    /// # Errors
    /// [`LoadError::Config`] if the model has no template of this name.
    pub fn new(config: &Config, name: &str) -> Result<Self, LoadError> {
        Self::new_in(config, name, &Arena::system())
    }

    /// Like [`Self::new`], in memory of `arena`.
    ///
    /// # Errors
    /// As [`Self::new`].
    #[expect(clippy::cast_possible_truncation, reason = "ids are below the vocabulary's size, at most 2^22")]
    pub fn new_in(config: &Config, name: &str, arena: &Arena) -> Result<Self, LoadError> {
        let missing = || LoadError::config(format!("templates.{name}"), "missing: this model does not support it");
        let items = config.templates.get(name).ok_or_else(missing)?;
        let slot = |item: &TemplateItem| match item {
            TemplateItem::Id(id) => Slot::Id(*id as u32),
            TemplateItem::Name(name) if name == "audio" => Slot::Audio,
            TemplateItem::Name(name) if name == "history" => Slot::Keyframes,
            TemplateItem::Name(name) => {
                Part::ALL.into_iter().find(|part| part.name() == name).map_or(Slot::Text, Slot::History)
            }
        };
        let has = |wanted: fn(&Slot) -> bool| items.iter().any(|item| wanted(&slot(item)));
        Ok(Self {
            has_audio: has(|slot| matches!(slot, Slot::Audio)),
            has_text: has(|slot| matches!(slot, Slot::Text)),
            slots: arena.collect(items.iter().map(slot)),
            audio: config.vocab.audio,
            text_ids: if config.is_frames() { config.vocab.size as u32 } else { u32::MAX },
            parts: PerPart::from_fn(|part| config.vocab[part]),
        })
    }

    /// Whether the template reads audio.
    pub fn has_audio(&self) -> bool {
        self.has_audio
    }

    /// Whether the template reads a free text.
    pub fn has_text(&self) -> bool {
        self.has_text
    }

    /// Writes the encoder's ids and returns their number.
    ///
    /// # Errors
    /// [`StepError`] if `ids` is too short, or a code or unit is out of range.
    pub fn write(&self, prompt: &Prompt, ids: &mut [u32]) -> Result<usize, StepError> {
        let mut writer = Writer { ids, len: 0 };
        for slot in &self.slots {
            match *slot {
                Slot::Id(id) => writer.push(id)?,
                Slot::Text => prompt.text.iter().try_for_each(|&id| {
                    if id >= self.text_ids {
                        let (got, limit) = (id as usize, self.text_ids as usize);
                        return Err(StepError::OutOfRange { what: "token id", got, limit });
                    }
                    writer.push(id)
                })?,
                Slot::Audio => {
                    let units = prompt.units.iter().map(|&unit| unit as usize);
                    writer.block(&self.audio, "audio unit", units, prompt.hidden_units)?;
                }
                Slot::History(part) => {
                    let codes = prompt.history.iter().skip(part as usize).step_by(Part::ALL.len());
                    let codes = codes.map(|&code| usize::from(code));
                    writer.block(&self.parts[part], "code", codes, 0)?;
                }
                Slot::Keyframes => prompt.keyframes.clone().try_for_each(|id| writer.push(id))?,
            }
        }
        Ok(writer.len)
    }
}

struct Writer<'a> {
    ids: &'a mut [u32],
    len: usize,
}

impl Writer<'_> {
    fn push(&mut self, id: u32) -> Result<(), StepError> {
        let limit = self.ids.len();
        let slot = self.ids.get_mut(self.len);
        *slot.ok_or(StepError::TooLong { what: "encoder tokens", got: limit + 1, limit })? = id;
        self.len += 1;
        Ok(())
    }

    /// Writes the start marker, the codes, `hidden` masks and the end marker.
    #[expect(clippy::cast_possible_truncation, reason = "ids are below the vocabulary's size, at most 2^22")]
    fn block(
        &mut self,
        m: &Modality,
        what: &'static str,
        codes: impl Iterator<Item = usize>,
        hidden: usize,
    ) -> Result<(), StepError> {
        self.push(m.start as u32)?;
        for code in codes {
            if code >= m.codes {
                return Err(StepError::OutOfRange { what, got: code, limit: m.codes });
            }
            self.push((m.first + code) as u32)?;
        }
        (0..hidden).try_for_each(|_| self.push(m.mask as u32))?;
        self.push(m.end as u32)
    }
}
