//! `umo model random`: writes a model of the right structure with random weights.

mod frames;
mod sizes;

use std::cell::RefCell;

use umo_core::{Config, Part};
use umo_core_model::weights::layout::{self, Kind, Spec};
use umo_core_model::weights::writer::{self, NewTensor, Storage, Values};
use umo_core_pose::skeleton::joints_of;

use crate::args::{self, LayoutArg, StorageArg};
use crate::failure::Failure;
use crate::{atomic_file, quantize};

/// Small text vocabulary of random models.
static TEXT_MODEL: &[u8] = include_bytes!("../assets/text.model");

/// Writes a random model, reproducible for the same arguments.
pub(crate) fn run(args: &args::Random) -> Result<(), Failure> {
    let config = match args.layout {
        LayoutArg::Parts => sizes::config(args.size),
        LayoutArg::Frames => frames::config(args.size),
    };
    let output = atomic_file::create(&args.output)?;
    let specs = layout::specs(&config, true);
    let mut tensors: Vec<NewTensor> =
        specs.iter().enumerate().map(|(i, spec)| tensor(&config, spec, args, i as u64)).collect();
    tensors.push(NewTensor {
        name: umo_core_model::lm::text::TOKENIZER.to_owned(),
        shape: vec![TEXT_MODEL.len()],
        storage: Storage::Bytes,
        values: Values::Bytes(TEXT_MODEL),
    });
    atomic_file::commit(output, |out| writer::write(out, &config, &tensors))?;
    let parameters: usize = specs.iter().map(Spec::len).sum();
    println!("{}: {parameters} parameters", args.output.display());
    Ok(())
}

/// Returns the config of the smallest model, for tests.
#[cfg(test)]
pub(crate) fn tiny() -> Config {
    sizes::config(crate::args::Size::Tiny)
}

fn tensor<'a>(config: &'a Config, spec: &'a Spec, args: &args::Random, index: u64) -> NewTensor<'a> {
    let storage = match (args.store, spec.kind) {
        (StorageArg::F32, _) | (_, Kind::Mel | Kind::Listener | Kind::Centroids) => Storage::F32,
        (StorageArg::Int8, Kind::Product) => Storage::Int8,
        (StorageArg::Int4, Kind::Product) if quantize::is_int4(&spec.name) => Storage::Int4,
        (StorageArg::Int4, Kind::Product) => Storage::Int8,
        (StorageArg::Bf16 | StorageArg::Int8 | StorageArg::Int4, _) => Storage::Bf16,
    };
    let seed = args.seed;
    let values = Values::Floats(Box::new(move || Ok(values(config, spec, seed, index))));
    NewTensor { name: spec.name.clone(), shape: spec.shape.clone(), storage, values }
}

/// Returns values of about the magnitude of trained ones, so that activations stay of order 1 through all layers.
#[expect(clippy::cast_precision_loss, reason = "widths are far below 2^24")]
fn values(config: &Config, spec: &Spec, seed: u64, index: u64) -> Vec<f32> {
    let random = RefCell::new(Random::new(seed, index));
    let draw = |center: f32, size: f32| {
        let mut random = random.borrow_mut();
        (0..spec.len()).map(|_| center + size * random.next()).collect()
    };
    if let Some(rest) = rest(config, &spec.name) {
        return rest;
    }
    match spec.kind {
        Kind::Product | Kind::Listener => draw(0.0, gain(config, &spec.name) / (spec.inputs() as f32).sqrt()),
        Kind::Router => draw(0.0, 2.0 / (spec.inputs() as f32).sqrt()),
        Kind::Table | Kind::Centroids => draw(0.0, 1.0),
        Kind::Bias => draw(0.0, 0.02),
        Kind::Norm => draw(1.0, 0.05),
        Kind::PositionBias => draw(0.0, 0.5),
        Kind::Mel => sizes::mel_values(config, &spec.name),
    }
}

/// Returns the gain of a product. T5 does not scale its attention scores, so queries are small; additions to
/// a residual stream are damped; poses stay near the rest pose.
fn gain(config: &Config, name: &str) -> f32 {
    match name {
        _ if name.starts_with("lm.") && name.ends_with(".q.weight") => 0.2,
        _ if name.ends_with(".o.weight") || name.ends_with(".wo.weight") => 0.5,
        _ if last_convolution(config, name).is_some() => 0.2,
        _ if name.starts_with("vq.") => 0.7,
        _ => 1.0,
    }
}

/// Returns the part's name if `name` belongs to the last convolution of a motion decoder.
fn last_convolution<'a>(config: &Config, name: &'a str) -> Option<&'a str> {
    let (part, rest) = name.strip_prefix("vq.")?.split_once(".decoder.main.")?;
    let layers = match config.part_list().into_iter().find(|spec| spec.name == part) {
        Some(spec) => spec.layers,
        None => config.vq.root.layers,
    };
    let index: usize = rest.split('.').next()?.parse().ok()?;
    (index == 2 + 2 * layers).then_some(part)
}

/// Returns the bias of a decoder's last convolution: identity rotations, a neutral face, and a root
/// standing on the ground.
fn rest(config: &Config, name: &str) -> Option<Vec<f32>> {
    const NO_ROTATION: [f32; 6] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    const PELVIS_HEIGHT_M: f32 = 0.93;
    let part = last_convolution(config, name).filter(|_| name.ends_with(".bias"))?;
    let spec = config.part_list().into_iter().find(|spec| spec.name == part);
    let rotations = |part: Part| 6 * joints_of(part).count();
    let Some(places) = spec.as_ref().and_then(|spec| spec.channels(&config.face)) else {
        let mut bias = vec![0.0; config.vq.root.channels];
        let rotations = rotations(Part::Lower);
        bias[..rotations].as_chunks_mut().0.fill(NO_ROTATION);
        bias[rotations + 1] = PELVIS_HEIGHT_M;
        return Some(bias);
    };
    let rotations = rotations(places.part);
    let value = |channel: usize| if channel < rotations { NO_ROTATION[channel % 6] } else { 0.0 };
    Some(places.ranges.into_iter().flatten().map(value).collect())
}

/// Generator of uniform numbers of variance 1: SplitMix64 (Steele, Lea, Flood 2014), one stream per tensor.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        let mut random = Self(seed ^ stream.wrapping_mul(0xA076_1D64_78BD_642F));
        random.bits();
        random
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Returns a number between `-sqrt(3)` and `sqrt(3)`.
    #[expect(clippy::cast_precision_loss, reason = "24 bits fit an f32")]
    pub(crate) fn next(&mut self) -> f32 {
        const SQRT_3: f32 = 1.732_050_8;
        let unit = (self.bits() >> 40) as f32 / (1_u32 << 24) as f32;
        (2.0 * unit - 1.0) * SQRT_3
    }
}
