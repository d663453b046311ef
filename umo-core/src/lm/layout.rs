//! What the encoder reads: templates and their placeholders (SPEC 2.2, 2.3).

use crate::config::{Config, Modality, TemplateItem};
use crate::error::{LoadError, StepError};
use crate::part::{Part, PerPart};

/// Most tokens of a free text prompt.
pub const MAX_PROMPT_TOKENS: usize = 128;

/// Most tokens that any template of the model makes.
pub fn max_encoder_tokens(config: &Config) -> usize {
    let longest = config.templates.values().map(|items| items.iter().map(|item| item_len(config, item)).sum());
    longest.max().unwrap_or(1)
}

/// Tokens of the longest chunk: the start id, then four blocks with their markers.
pub fn max_decoder_tokens(config: &Config) -> usize {
    1 + 4 * (config.max_target + 2)
}

/// Audio tokens of the window of a chunk that predicts `target` keyframes.
pub fn window_tokens(config: &Config, target: usize) -> usize {
    (config.prefix + target) * config.tokens_per_keyframe()
}

fn item_len(config: &Config, item: &TemplateItem) -> usize {
    match item {
        TemplateItem::Id(_) => 1,
        TemplateItem::Name(name) if name == "audio" => window_tokens(config, config.max_target) + 2,
        TemplateItem::Name(name) if name == "text" => MAX_PROMPT_TOKENS,
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
}

/// What fills the placeholders of a template.
#[derive(Clone, Copy, Debug)]
pub struct Prompt<'a> {
    /// Units of the window; not read where the template has no audio.
    pub units: &'a [u32],
    /// The last codes of each part.
    pub history: PerPart<&'a [u16]>,
    /// Ids of a free text; not read where the template has no text.
    pub text: &'a [u32],
}

/// A template that is ready to be written out.
#[derive(Clone, Debug)]
pub struct Template {
    slots: Box<[Slot]>,
    audio: Modality,
    parts: PerPart<Modality>,
}

impl Template {
    /// The template `name` of a model.
    ///
    /// # Errors
    /// [`LoadError::Config`] where the model has none of this name.
    #[expect(clippy::cast_possible_truncation, reason = "ids are below the vocabulary's size, at most 2^22")]
    pub fn new(config: &Config, name: &str) -> Result<Self, LoadError> {
        let missing = || LoadError::config(format!("templates.{name}"), "missing: this model cannot do that");
        let items = config.templates.get(name).ok_or_else(missing)?;
        let slot = |item: &TemplateItem| match item {
            TemplateItem::Id(id) => Slot::Id(*id as u32),
            TemplateItem::Name(name) if name == "audio" => Slot::Audio,
            TemplateItem::Name(name) => {
                Part::ALL.into_iter().find(|part| part.name() == name).map_or(Slot::Text, Slot::History)
            }
        };
        Ok(Self {
            slots: items.iter().map(slot).collect(),
            audio: config.vocab.audio,
            parts: PerPart::from_fn(|part| config.vocab[part]),
        })
    }

    /// Whether the template reads audio.
    pub fn has_audio(&self) -> bool {
        self.slots.iter().any(|slot| matches!(slot, Slot::Audio))
    }

    /// Whether the template reads a free text.
    pub fn has_text(&self) -> bool {
        self.slots.iter().any(|slot| matches!(slot, Slot::Text))
    }

    /// Writes the encoder's ids and returns how many there are.
    ///
    /// # Errors
    /// [`StepError`] where `ids` is too short, or a code or unit is out of range.
    pub fn write(&self, prompt: Prompt, ids: &mut [u32]) -> Result<usize, StepError> {
        let mut writer = Writer { ids, len: 0 };
        for slot in &self.slots {
            match *slot {
                Slot::Id(id) => writer.push(id)?,
                Slot::Text => prompt.text.iter().try_for_each(|&id| writer.push(id))?,
                Slot::Audio => {
                    writer.block(&self.audio, "audio unit", prompt.units.iter().map(|&unit| unit as usize))?;
                }
                Slot::History(part) => {
                    let codes = prompt.history[part].iter().map(|&code| usize::from(code));
                    writer.block(&self.parts[part], "code", codes)?;
                }
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

    /// Start marker, codes, end marker.
    #[expect(clippy::cast_possible_truncation, reason = "ids are below the vocabulary's size, at most 2^22")]
    fn block(&mut self, m: &Modality, what: &'static str, codes: impl Iterator<Item = usize>) -> Result<(), StepError> {
        self.push(m.start as u32)?;
        for code in codes {
            if code >= m.codes {
                return Err(StepError::OutOfRange { what, got: code, limit: m.codes });
            }
            self.push((m.first + code) as u32)?;
        }
        self.push(m.end as u32)
    }
}
