//! A model's config: every dimension, parsed from its file and checked once.

mod body;
mod check;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use body::{Channels, channel_names};
pub(crate) use check::MAX_PARTS;
use umo_core_base::error::LoadError;
use umo_core_pose::clip::Clip;
pub use umo_core_pose::face::{Face, FaceKind};
use umo_core_pose::part::PerPart;
pub use umo_core_pose::skeleton::Skeleton;

/// The `config` text of a model file (SPEC 3). Only [`Config::parse`] returns a checked one.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Name of the model.
    pub name: String,
    /// Licence of the weights.
    pub license: String,
    /// One line that the program prints on every run, for example that a model was never trained.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notice: Option<String>,
    /// Poses per second.
    pub frame_rate: usize,
    /// Frames from one keyframe to the next.
    pub keyframe_stride: usize,
    /// Keyframes of history, `P`.
    pub prefix: usize,
    /// Keyframes predicted per chunk by default, `N`.
    pub target: usize,
    /// Upper bound of `N` for a session.
    pub max_target: usize,
    /// Frames held back by default until the next chunk (SPEC 2.8).
    pub lookahead: usize,
    /// Meaning of one position of the decoder.
    #[serde(default, skip_serializing_if = "Layout::is_parts")]
    pub layout: Layout,
    /// Parts with their own codes, in order. Absent for the paper's four parts of one level, the only ones of layout
    /// `parts`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parts: Option<Vec<PartSpec>>,
    /// Audio tokenizer.
    pub audio: Audio,
    /// Ids of the language model.
    pub vocab: Vocab,
    /// Language model.
    pub lm: Lm,
    /// Depth network, in layout `frames`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<Depth>,
    /// Interpolation network.
    pub interp: Interp,
    /// Motion codecs.
    pub vq: Vq,
    /// Face channels.
    pub face: Face,
    /// The live mouth, if the model has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mouth: Option<Mouth>,
    /// Encoder inputs by name: `audio_to_motion`, `text_to_motion`.
    pub templates: BTreeMap<String, Vec<TemplateItem>>,
    /// Texts that the model was trained with, if it knows no others; absent if it takes any text, or none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompts: Option<Vec<String>>,
    /// Codes that stand for the time before the first frame. Models with [`parts`](Self::parts) use each part's
    /// `rest` instead.
    #[serde(default = "no_rest", skip_serializing_if = "is_no_rest")]
    pub rest: PerPart<usize>,
    /// Default sampling.
    pub sampling: Sampling,
    /// Bones.
    pub skeleton: Skeleton,
}

/// Meaning of one position of the decoder (SPEC 2.5, 2.13).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// A code of one part: the paper's layout.
    #[default]
    Parts,
    /// A keyframe, whose codes a depth network samples.
    Frames,
}

impl Layout {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
    fn is_parts(&self) -> bool {
        *self == Self::Parts
    }
}

/// A part with its own codes (SPEC 2.12).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PartSpec {
    /// Name in tensors: lowercase letters, digits and `_`.
    pub name: String,
    /// Names of its channels, all of one of the four body parts; empty for an annotation.
    pub channels: Vec<String>,
    /// Codes of each level, 1 to 256.
    pub codes: usize,
    /// Levels of residual quantization, 1 to 16.
    pub levels: usize,
    /// Width of a code's vector and of the hidden convolutions; absent in an annotation.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub width: usize,
    /// Convolutions between the residual blocks and the last one; absent in an annotation.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub layers: usize,
    /// Codes that stand for the time before the first frame, one per level.
    pub rest: Vec<usize>,
    /// Sampling of its codes, if it differs from the session's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampling: Option<Sampling>,
}

/// Depth network (SPEC 2.13).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Depth {
    /// Width.
    pub d_model: usize,
    /// Heads of each attention.
    pub num_heads: usize,
    /// Inner width of a feed-forward.
    pub d_ff: usize,
    /// Layers.
    pub num_layers: usize,
    /// Epsilon added to mean squares.
    pub layer_norm_epsilon: f32,
    /// Whether each code sees the code at its position in the previous keyframe.
    #[serde(default, skip_serializing_if = "is_false")]
    pub before: bool,
    /// Audio token of the keyframe whose encoder state the network reads, if it reads any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heard: Option<usize>,
    /// Same for annotations and the parts of the body, if it is another token than the face's. It may belong to a
    /// later keyframe, up to the model's horizon.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body_heard: Option<usize>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_false(value: &bool) -> bool {
    !*value
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_zero(value: &usize) -> bool {
    *value == 0
}

/// Placeholder for an absent `rest`: no code has this number.
const NO_CODE: usize = usize::MAX;

fn no_rest() -> PerPart<usize> {
    PerPart::from_fn(|_| NO_CODE)
}

fn is_no_rest(rest: &PerPart<usize>) -> bool {
    *rest == no_rest()
}

/// Audio tokenizer (SPEC 2.1).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Audio {
    /// Kind of tokenizer.
    pub kind: AudioKind,
    /// Sample rate of the tokenizer's input.
    pub sample_rate: usize,
    /// Audio tokens per second.
    pub token_rate: usize,
    /// Number of distinct audio tokens.
    pub units: usize,
    /// Maximum horizon: keyframes of audio after the chunk that the encoder has positions for (SPEC 2.15).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub ahead: usize,
    /// Units that mark accents, if the tokenizer was trained to (SPEC 2.19).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accents: Option<Accents>,
    /// Dimensions of the HuBERT tokenizer, if `kind` is that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hubert: Option<Hubert>,
    /// Dimensions of the mel tokenizer, if `kind` is that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mel: Option<Mel>,
}

/// Units that mark the onset of an accented vowel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Accents {
    /// First such unit; all higher ones are, too.
    pub first: usize,
    /// Delay of the mark, audio tokens.
    pub delay: usize,
}

impl Accents {
    /// Whether a unit marks an accent.
    pub fn marks(self, unit: u32) -> bool {
        unit as usize >= self.first
    }
}

/// Kind of audio tokenizer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AudioKind {
    /// HuBERT features and k-means.
    Hubert,
    /// Log-mel features and k-means.
    Mel,
}

/// HuBERT, with Hugging Face's field names.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Hubert {
    /// Channels of each convolution.
    pub conv_dim: Vec<usize>,
    /// Kernel of each convolution.
    pub conv_kernel: Vec<usize>,
    /// Stride of each convolution.
    pub conv_stride: Vec<usize>,
    /// Width of the transformer.
    pub hidden_size: usize,
    /// Inner width of a feed-forward.
    pub intermediate_size: usize,
    /// Heads of each layer.
    pub num_attention_heads: usize,
    /// Layers that are stored and computed.
    pub num_hidden_layers: usize,
    /// Kernel of the position convolution.
    pub num_conv_pos_embeddings: usize,
    /// Groups of the position convolution.
    pub num_conv_pos_embedding_groups: usize,
    /// Epsilon added to variances.
    pub layer_norm_eps: f32,
    /// Whether samples are normalized to mean 0 and variance 1.
    pub do_normalize: bool,
}

/// Log-mel features with deltas.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Mel {
    /// Samples per window.
    pub window: usize,
    /// Length of the Fourier transform, even; the window is padded with zeros.
    pub fft: usize,
    /// Mel bands.
    pub bands: usize,
    /// Lower bound of a band's energy before the logarithm.
    pub floor: f32,
    /// Orders of differences appended to the log-mel bands.
    pub deltas: usize,
    /// Network on these features, whose outputs are quantized to units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network: Option<MelNetwork>,
}

impl Mel {
    /// Values per log-mel feature: the bands and all orders of differences.
    pub fn bands_width(&self) -> usize {
        self.bands * (1 + self.deltas)
    }

    /// Values per quantized feature.
    pub fn width(&self) -> usize {
        self.network.as_ref().and_then(|network| network.widths.last()).copied().unwrap_or(self.bands_width())
    }
}

/// Dense layers with ReLU between them, on the last log-mel features.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MelNetwork {
    /// Number of input features: a token's own and those before it.
    pub taps: usize,
    /// Outputs of each layer.
    pub widths: Vec<usize>,
    /// Residual blocks after the first layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blocks: Option<MelBlocks>,
}

/// Residual blocks over time, each as wide as the first layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MelBlocks {
    /// Rows that a block reads: a token's own and those before it.
    pub kernel: usize,
    /// Number of blocks.
    pub count: usize,
}

impl MelNetwork {
    /// Width of the first layer and of every block.
    pub fn width(&self) -> usize {
        self.widths.first().copied().unwrap_or_default()
    }

    /// Weights of all blocks, without biases.
    pub fn block_weights(&self) -> usize {
        self.blocks.map_or(0, |blocks| blocks.count * (blocks.kernel + 1) * self.width() * self.width())
    }

    /// Outputs and inputs of each layer, on log-mel features of `width` values.
    pub fn layers(&self, width: usize) -> impl Iterator<Item = (usize, usize)> {
        let inputs = std::iter::once(self.taps * width).chain(self.widths.iter().copied());
        self.widths.iter().copied().zip(inputs)
    }
}

/// Ids of the language model (SPEC 2.2).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Vocab {
    /// Rows of the embedding table.
    pub size: usize,
    /// Padding id.
    pub pad: usize,
    /// End of sequence.
    pub eos: usize,
    /// First input id of the decoder.
    pub decoder_start: usize,
    /// Codes of the face.
    #[serde(default, skip_serializing_if = "Modality::is_absent")]
    pub face: Modality,
    /// Codes of the hands.
    #[serde(default, skip_serializing_if = "Modality::is_absent")]
    pub hands: Modality,
    /// Codes of the upper body.
    #[serde(default, skip_serializing_if = "Modality::is_absent")]
    pub upper: Modality,
    /// Codes of the lower body.
    #[serde(default, skip_serializing_if = "Modality::is_absent")]
    pub lower: Modality,
    /// Audio units.
    pub audio: Modality,
}

impl std::ops::Index<umo_core_pose::part::Part> for Vocab {
    type Output = Modality;

    fn index(&self, part: umo_core_pose::part::Part) -> &Modality {
        match part {
            umo_core_pose::part::Part::Face => &self.face,
            umo_core_pose::part::Part::Hands => &self.hands,
            umo_core_pose::part::Part::Upper => &self.upper,
            umo_core_pose::part::Part::Lower => &self.lower,
        }
    }
}

/// Ids of one kind of token. Absent for the parts in layout `frames`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Modality {
    /// Id of code 0.
    pub first: usize,
    /// Number of codes.
    pub codes: usize,
    /// Marker before a block.
    pub start: usize,
    /// Marker after a block.
    pub end: usize,
    /// Marker of a masked code.
    pub mask: usize,
}

impl Modality {
    fn is_absent(&self) -> bool {
        *self == Self::default()
    }
}

/// T5 with expert feed-forwards (SPEC 2.4), with Hugging Face's field names.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Lm {
    /// Width.
    pub d_model: usize,
    /// Width of a head.
    pub d_kv: usize,
    /// Inner width of an expert.
    pub d_ff: usize,
    /// Heads of each attention.
    pub num_heads: usize,
    /// Encoder layers.
    pub num_layers: usize,
    /// Decoder layers.
    pub num_decoder_layers: usize,
    /// Buckets of the relative position bias.
    pub relative_attention_num_buckets: usize,
    /// Distance from which all positions share the last bucket.
    pub relative_attention_max_distance: usize,
    /// Epsilon added to mean squares.
    pub layer_norm_epsilon: f32,
    /// Feed-forward form: `gated-gelu`.
    pub feed_forward_proj: String,
    /// Whether the output head is the embedding table, scaled by `d_model^-0.5`.
    pub tie_word_embeddings: bool,
    /// Experts of each feed-forward.
    pub experts: usize,
    /// Experts per row.
    pub top_k: usize,
}

/// Interpolation network (SPEC 2.6).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Interp {
    /// Width.
    pub d_model: usize,
    /// Heads of each attention.
    pub num_heads: usize,
    /// Inner width of a feed-forward.
    pub d_ff: usize,
    /// Layers over time.
    pub temporal_layers: usize,
    /// Layers over the four parts of a frame.
    pub part_layers: usize,
    /// Rows of the position table.
    pub max_frames: usize,
}

/// Motion codecs (SPEC 2.7).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Vq {
    /// Codes of each part; absent if [`Config::parts`] is given.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub codes: usize,
    /// Width of a code's vector and of the hidden convolutions; if [`Config::parts`] is given, of the root network
    /// only.
    pub width: usize,
    /// Jaw and expression.
    #[serde(default, skip_serializing_if = "Codec::is_absent")]
    pub face: Codec,
    /// Finger joints.
    #[serde(default, skip_serializing_if = "Codec::is_absent")]
    pub hands: Codec,
    /// Upper body joints.
    #[serde(default, skip_serializing_if = "Codec::is_absent")]
    pub upper: Codec,
    /// Lower body joints, root velocity and foot contact.
    #[serde(default, skip_serializing_if = "Codec::is_absent")]
    pub lower: Codec,
    /// Root network.
    pub root: Codec,
}

impl std::ops::Index<umo_core_pose::part::Part> for Vq {
    type Output = Codec;

    fn index(&self, part: umo_core_pose::part::Part) -> &Codec {
        match part {
            umo_core_pose::part::Part::Face => &self.face,
            umo_core_pose::part::Part::Hands => &self.hands,
            umo_core_pose::part::Part::Upper => &self.upper,
            umo_core_pose::part::Part::Lower => &self.lower,
        }
    }
}

/// One motion codec. Absent for the four parts if [`Config::parts`] is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Codec {
    /// Values per frame.
    pub channels: usize,
    /// Convolutions between the residual blocks and the last one.
    pub layers: usize,
}

impl Codec {
    fn is_absent(&self) -> bool {
        *self == Self::default()
    }

    /// Frames on each side that a decoded frame depends on: two residual blocks of two convolutions, `layers`, and
    /// one more.
    pub fn decoder_reach(&self) -> usize {
        4 + self.layers + 1
    }

    /// Frames on each side that an encoded frame depends on: one convolution and a residual block of two per layer.
    pub fn encoder_reach(&self) -> usize {
        3 * self.layers
    }
}

/// The live mouth (SPEC 2.10): log-mel rows, then causal convolutions at the frame rate.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Mouth {
    /// Samples per window.
    pub window: usize,
    /// Length of the Fourier transform, even; the window is padded with zeros.
    pub fft: usize,
    /// Mel bands.
    pub bands: usize,
    /// Lower bound of a band's energy before the logarithm.
    pub floor: f32,
    /// Rows of features per frame.
    pub rows: usize,
    /// Rows after a frame's time that the frame depends on: its latency.
    pub ahead: usize,
    /// Rows that the first layer reads, up to the newest.
    pub taps: usize,
    /// Width of every layer except the last.
    pub width: usize,
    /// Kernel of the dilated convolutions, frames.
    pub kernel: usize,
    /// Dilation of each block, frames.
    pub dilations: Vec<usize>,
    /// Frames that the second head waits for behind a frame; 0 for a network without one.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub behind: usize,
    /// Face channels that it outputs, by their names in `face.names`.
    pub channels: Vec<String>,
}

impl Mouth {
    /// Values per row of features.
    pub fn features(&self) -> usize {
        self.bands + crate::mouth::LEVEL_FEATURES
    }

    /// Outputs of the last layer: the channels and the voice activity.
    pub fn outputs(&self) -> usize {
        self.channels.len() + 1
    }
}

/// One item of a template: a token id, or the name of an input.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(untagged)]
pub enum TemplateItem {
    /// A token id.
    Id(usize),
    /// `audio`, `text`, or a part; in layout `frames` `history` instead of the parts.
    Name(String),
}

/// Default sampling (SPEC 2.5).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Sampling {
    /// Divisor of the logits; 0 is greedy.
    pub temperature: f32,
    /// Number of likeliest codes to sample from; 0 is all.
    pub top_k: usize,
    /// Cumulative probability of the likeliest codes to sample from.
    pub top_p: f32,
}

impl Config {
    /// Returns the model's prompts as a clause if it has a list of them that lacks `text`: it was not trained with
    /// `text`, and its motion is then arbitrary.
    pub fn unknown_prompt(&self, text: &str) -> Option<String> {
        let prompts = self.prompts.as_ref()?;
        if prompts.iter().any(|known| known.eq_ignore_ascii_case(text.trim())) {
            return None;
        }
        let named: Vec<&str> = prompts.iter().map(String::as_str).filter(|prompt| !prompt.is_empty()).collect();
        Some(format!("the model's prompts are {}", named.join(", ")))
    }

    /// Parses and checks a config.
    ///
    /// # Errors
    /// [`LoadError::Config`] with the key, the value found and the value expected.
    pub fn parse(text: &str) -> Result<Self, LoadError> {
        let mut json = serde_json::Deserializer::from_str(text);
        let config: Self = serde_path_to_error::deserialize(&mut json)
            .map_err(|error| LoadError::config(error.path().to_string(), error.inner().to_string()))?;
        json.end().map_err(|error| LoadError::config(".", error.to_string()))?;
        check::check(&config)?;
        Ok(config)
    }

    /// Returns an empty motion with this model's frame rate, bones and face.
    #[doc(hidden)]
    pub fn clip(&self) -> Clip {
        Clip::new(self.frame_rate as f32, self.skeleton.clone(), self.face.clone())
    }

    /// Samples per audio token.
    pub fn hop(&self) -> usize {
        self.audio.sample_rate / self.audio.token_rate
    }

    /// Audio tokens per keyframe.
    pub fn tokens_per_keyframe(&self) -> usize {
        self.keyframe_stride * self.audio.token_rate / self.frame_rate
    }

    /// Samples per keyframe.
    pub fn samples_per_keyframe(&self) -> usize {
        self.tokens_per_keyframe() * self.hop()
    }

    /// Maximum number of frames of future speech that a frame needs, with this number of keyframes per chunk and of
    /// frames held back: the rest of its chunk, the next chunk if the frame comes after its chunk's last keyframe,
    /// and the frames held back. For an avatar's settings, see
    /// [`AvatarConfig::latency_frames`](crate::avatar::AvatarConfig::latency_frames).
    pub fn latency_frames(&self, target: usize, lookahead: usize) -> usize {
        (target + 1) * self.keyframe_stride - 1 + lookahead
    }

    /// Number of samples before `hop * j` that feature `j` of a stream covers.
    pub fn feature_reach_back(&self) -> usize {
        let window = match (&self.audio.hubert, &self.audio.mel) {
            (Some(hubert), _) if self.audio.kind == AudioKind::Hubert => hubert.receptive_field(),
            (_, Some(mel)) => mel.window,
            _ => self.hop(),
        };
        window.saturating_sub(self.hop())
    }
}

impl Hubert {
    /// Number of samples that one feature covers.
    pub fn receptive_field(&self) -> usize {
        let (mut field, mut step) = (1, 1);
        for (kernel, stride) in self.conv_kernel.iter().zip(&self.conv_stride) {
            field += (kernel - 1) * step;
            step *= stride;
        }
        field
    }
}
