//! Derivation of each tensor of the new model from the tensors of the sources.

use std::collections::BTreeSet;

use glob::Pattern;
use half::f16;
use umo_core::Config;
use umo_core_model::weights::layout::{self, Kind, Spec};
use umo_core_model::weights::writer::Storage;

use super::catalogue::{Catalogue, Entry};
use crate::args::{Convert, NewRows};
use crate::failure::Failure;
use crate::random::Random;

/// Small relative to a hidden state of order 1, so that every expert is tried when training starts.
const ROUTER_DEVIATION: f32 = 0.02;
/// Upper bound on the problems listed.
const MAX_LISTED: usize = 12;

const POSITION: &str = "audio.hubert.encoder.pos_conv_embed.conv";
/// Scale and direction of a weight norm: Hugging Face's original names, then its current ones.
const WEIGHT_NORM: [(&str, &str); 2] =
    [("weight_g", "weight_v"), ("parametrizations.weight.original0", "parametrizations.weight.original1")];
/// Tensors that duplicate the embedding table.
const TIED: [&str; 2] = ["lm.encoder.embed_tokens.weight", "lm.decoder.embed_tokens.weight"];
const TABLE: &str = "lm.shared.weight";
const HEAD: &str = "lm.lm_head.weight";
/// Unused tensors: needed only for training, heads for other tasks, and a table of old T5 versions that no layer reads.
const UNUSED: [&str; 8] = [
    "audio.hubert.masked_spec_embed",
    "audio.hubert.lm_head.*",
    "audio.hubert.projector.*",
    "audio.hubert.classifier.*",
    "audio.hubert.layer_weights",
    "lm.decoder.block.0.layer.1.EncDecAttention.relative_attention_bias.weight",
    "vq.*.quantizer.embedding.cluster_size",
    "vq.*.quantizer.embedding.embed_avg",
];

/// A tensor of the new model.
#[derive(Debug)]
pub(super) struct Plan<'a> {
    /// Name, shape and kind of the tensor.
    pub(super) spec: Spec,
    recipe: Recipe<'a>,
}

#[derive(Debug)]
enum Recipe<'a> {
    Copy(&'a Entry),
    /// Copies the source's rows; missing rows are the mean of the existing ones.
    Grow(&'a Entry),
    /// Folds a convolution's weight norm: a direction, and a scale per tap.
    WeightNorm {
        scale: &'a Entry,
        direction: &'a Entry,
    },
    /// Draws random values from this stream of the generator.
    Router(u64),
}

impl Plan<'_> {
    /// Whether rows are added to the source's.
    pub(super) fn grows(&self) -> bool {
        matches!(self.recipe, Recipe::Grow(_))
    }

    /// Returns the storage of the tensor if `floats` was requested.
    pub(super) fn storage(&self, floats: Storage) -> Storage {
        if matches!(self.spec.kind, Kind::Product | Kind::Table) { floats } else { Storage::F32 }
    }

    /// Computes the values.
    pub(super) fn values(&self, catalogue: &Catalogue, seed: u64) -> Result<Vec<f32>, Failure> {
        match self.recipe {
            Recipe::Copy(entry) => catalogue.read(entry),
            Recipe::Grow(entry) => Ok(grown(catalogue.read(entry)?, entry.shape[0], self.spec.shape[0])),
            Recipe::WeightNorm { scale, direction } => Ok(folded(&catalogue.read(scale)?, catalogue.read(direction)?)),
            Recipe::Router(stream) => {
                let mut random = Random::new(seed, stream);
                Ok((0..self.spec.len()).map(|_| ROUTER_DEVIATION * random.next()).collect())
            }
        }
    }
}

/// Refuses values that are not finite once stored.
pub(super) fn check(plan: &Plan, storage: Storage, values: Vec<f32>) -> Result<Vec<f32>, Failure> {
    let large = |v: &&f32| !v.is_finite() || storage == Storage::F16 && !f16::from_f32(**v).is_finite();
    match values.iter().find(large) {
        Some(value) => {
            Err(Failure::input(format!("tensor `{}`: {value} is beyond {}", plan.spec.name, storage.dtype())))
        }
        None => Ok(values),
    }
}

/// Returns a plan for every tensor that `config` requires. Missing tensors, superfluous ones and
/// wrong shapes are refused.
pub(super) fn plan<'a>(config: &Config, catalogue: &'a Catalogue, args: &Convert) -> Result<Vec<Plan<'a>>, Failure> {
    let encoder = |name: &str| catalogue.get(&format!("vq.{name}.encoder.main.0.weight")).is_some();
    let encoders = config.part_list().iter().any(|part| encoder(&part.name));
    let (mut plans, mut problems, mut used) = (Vec::new(), Vec::new(), BTreeSet::new());
    for (stream, spec) in layout::specs(config, encoders).into_iter().enumerate() {
        match recipe(catalogue, &spec, stream as u64, args.new_rows, &mut used) {
            Ok(recipe) => plans.push(Plan { spec, recipe }),
            Err(problem) => problems.push(problem),
        }
    }
    let layers = config.audio.hubert.as_ref().map_or(0, |hubert| hubert.num_hidden_layers);
    for name in catalogue.names().filter(|name| !used.contains(*name) && !unused(name, layers)) {
        if config.is_frames() && name == HEAD {
            continue;
        }
        if TIED.contains(&name) || config.lm.tie_word_embeddings && name == HEAD {
            problems.extend(differs(catalogue, name)?);
        } else if let Some(entry) = catalogue.get(name) {
            problems.push(format!("{}: the config asks for no such tensor", catalogue.place(entry)));
        }
    }
    // Experts of a layer report the same missing tensor.
    let mut seen = BTreeSet::new();
    problems.retain(|problem| seen.insert(problem.clone()));
    if problems.is_empty() { Ok(plans) } else { Err(Failure::input(list(&problems))) }
}

fn list(problems: &[String]) -> String {
    let mut text = problems.iter().take(MAX_LISTED).cloned().collect::<Vec<_>>().join("\n");
    if problems.len() > MAX_LISTED {
        text += &format!("\nand {} more", problems.len() - MAX_LISTED);
    }
    text
}

/// Whether a tensor may be ignored.
fn unused(name: &str, layers: usize) -> bool {
    let layer = name.strip_prefix("audio.hubert.encoder.layers.").and_then(|rest| rest.split('.').next());
    layer.and_then(|i| i.parse::<usize>().ok()).is_some_and(|i| i >= layers)
        || UNUSED.iter().any(|glob| Pattern::new(glob).expect("the patterns above are well formed").matches(name))
}

fn recipe<'a>(
    catalogue: &'a Catalogue,
    spec: &Spec,
    stream: u64,
    new_rows: Option<NewRows>,
    used: &mut BTreeSet<String>,
) -> Result<Recipe<'a>, String> {
    let name = if catalogue.get(&spec.name).is_some() { spec.name.clone() } else { dense(&spec.name) };
    if let Some(entry) = catalogue.get(&name) {
        used.insert(name.clone());
        let table = name == TABLE || name == HEAD;
        return match (entry.shape == spec.shape, table && entry.shape.get(1) == spec.shape.get(1)) {
            (true, _) => Ok(Recipe::Copy(entry)),
            (false, true) => grow(catalogue, entry, spec, new_rows),
            (false, false) => Err(shape(catalogue, entry, &spec.shape)),
        };
    }
    if spec.kind == Kind::Router {
        return Ok(Recipe::Router(stream));
    }
    weight_norm(catalogue, spec, used).unwrap_or_else(|| Err(format!("tensor `{name}`: missing from the sources")))
}

/// Returns the name of the dense feed-forward tensor that an expert copies.
fn dense(name: &str) -> String {
    let parts = name.split_once(".moe.experts.").and_then(|(block, rest)| Some((block, rest.split_once('.')?.1)));
    parts.map_or_else(|| name.to_owned(), |(block, rest)| format!("{block}.DenseReluDense.{rest}"))
}

fn shape(catalogue: &Catalogue, entry: &Entry, want: &[usize]) -> String {
    format!("{}: expected {want:?}, got {:?}", catalogue.place(entry), entry.shape)
}

fn grow<'a>(
    catalogue: &Catalogue,
    entry: &'a Entry,
    spec: &Spec,
    new_rows: Option<NewRows>,
) -> Result<Recipe<'a>, String> {
    let (have, want) = (entry.shape[0], spec.shape[0]);
    match new_rows {
        _ if have == 0 || have > want => Err(shape(catalogue, entry, &spec.shape)),
        Some(NewRows::Mean) => Ok(Recipe::Grow(entry)),
        None => Err(format!(
            "{}: {have} rows, the config's vocabulary has {want}: `--new-rows mean` starts the rest at the mean of \
             these, training/ trains them",
            catalogue.place(entry)
        )),
    }
}

/// Returns the recipe of the position convolution if the source stores it as direction and scale.
fn weight_norm<'a>(
    catalogue: &'a Catalogue,
    spec: &Spec,
    used: &mut BTreeSet<String>,
) -> Option<Result<Recipe<'a>, String>> {
    let stem = spec.name.strip_suffix("weight").filter(|stem| stem.strip_suffix('.') == Some(POSITION))?;
    WEIGHT_NORM.iter().find_map(|(scale, direction)| {
        let names = [format!("{stem}{scale}"), format!("{stem}{direction}")];
        let (scale, direction) = (catalogue.get(&names[0])?, catalogue.get(&names[1])?);
        used.extend(names);
        let taps = [1, 1, spec.shape[2]];
        Some(match (scale.shape == taps, direction.shape == spec.shape) {
            (true, true) => Ok(Recipe::WeightNorm { scale, direction }),
            (false, _) => Err(shape(catalogue, scale, &taps)),
            (_, false) => Err(shape(catalogue, direction, &spec.shape)),
        })
    })
}

/// Returns the problem with a duplicate of the embedding table, if it differs.
fn differs(catalogue: &Catalogue, name: &str) -> Result<Option<String>, Failure> {
    let (Some(entry), Some(table)) = (catalogue.get(name), catalogue.get(TABLE)) else { return Ok(None) };
    let same = entry.shape == table.shape && catalogue.read(entry)? == catalogue.read(table)?;
    Ok((!same).then(|| format!("{}: differs from the shared table, which it should repeat", catalogue.place(entry))))
}

/// Extends `values` from `have` to `want` rows with the mean row.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    reason = "a mean of floats is one; rows are few"
)]
fn grown(mut values: Vec<f32>, have: usize, want: usize) -> Vec<f32> {
    let width = values.len() / have;
    let mut mean = vec![0.0_f64; width];
    for row in values.chunks_exact(width) {
        mean.iter_mut().zip(row).for_each(|(mean, &v)| *mean += f64::from(v) / have as f64);
    }
    let mean: Vec<f32> = mean.iter().map(|&v| v as f32).collect();
    (have..want).for_each(|_| values.extend_from_slice(&mean));
    values
}

/// Computes `scale * direction / |direction|`, with the norm over all axes except the taps.
#[expect(clippy::cast_possible_truncation, reason = "computed in f64 to be rounded once")]
fn folded(scale: &[f32], mut direction: Vec<f32>) -> Vec<f32> {
    let taps = scale.len();
    let mut squares = vec![0.0_f64; taps];
    for row in direction.chunks_exact(taps) {
        squares.iter_mut().zip(row).for_each(|(sum, &v)| *sum += f64::from(v).powi(2));
    }
    let factors: Vec<f64> = scale.iter().zip(&squares).map(|(&g, sum)| f64::from(g) / sum.sqrt()).collect();
    for row in direction.chunks_exact_mut(taps) {
        row.iter_mut().zip(&factors).for_each(|(v, factor)| *v = (f64::from(*v) * factor) as f32);
    }
    direction
}
