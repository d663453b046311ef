//! `umo model quantize`: writes the same model with smaller weights, one tensor at a time.

mod calibrate;
mod compensate;
mod equalize;
mod rotate;

use std::cell::RefCell;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use clap::ValueEnum;
use glob::Pattern;
use umo_core::{LoadError, ModelFile};
use umo_core_base::file::TemporaryFile;
use umo_core_model::calibration::Calibration;
use umo_core_model::weights::layout::{self, Kind, Spec};
use umo_core_model::weights::writer::{self, NewTensor, Storage, Values};

use crate::args::{Quantize, StorageArg, WeightsArg};
use crate::atomic_file;
use crate::failure::Failure;

/// Products for which int8 costs more accuracy than it saves time; `docs/quantization.md` has the measurements.
const DEFAULT_KEPT: [&str; 5] = [
    // The second and third convolutions have three quarters of the arithmetic. Each of the others would
    // cost as much accuracy.
    "audio.hubert.feature_extractor.conv_layers.[!12].*",
    "audio.hubert.feature_extractor.conv_layers.[0-9][0-9]*",
    "audio.hubert.encoder.pos_conv_embed.*",
    // Determines the sampled code; always computed in float.
    "lm.lm_head.weight",
    // Determines the code of a pose. Used only for start poses, always in float.
    "vq.[fhul]*.encoder.*",
];

/// Products with the best ratio of int4 savings to loss: half of the bytes read by a decoder step. All other
/// products become int8 when int4 is requested.
const INT4: [&str; 1] = ["lm.decoder.*.moe.experts.*"];

/// Tensors of layout `frames` that also stay out of bf16: small differences of large values, always in f32.
const KEPT_OF_FRAMES: &str = "vq.root.*";

/// Writes the quantized model.
pub(crate) fn run(args: &Quantize) -> Result<(), Failure> {
    let file =
        ModelFile::open(&args.input).map_err(|error| Failure::input(format!("{}: {error}", args.input.display())))?;
    let rules = Rules::new(args)?;
    let plans = plan(&file, &rules)?;
    if args.rotate {
        rotate::check(file.config())?;
    }
    if !args.calibrate.is_empty() && !plans.iter().any(|plan| plan.storage.is_quantized()) {
        return Err(Failure::input("--calibrate: no tensor becomes int8 or int4, and calibration affects no others"));
    }
    let output = atomic_file::create(&args.output)?;

    let failed = RefCell::new(None);
    let quantized = |name: &str| plans.iter().any(|plan| plan.name == name && plan.storage.is_quantized());
    let floats = |storage: fn(Storage) -> Storage| {
        let tensor = |plan| tensor(&file, plan, storage, args.rotate, &quantized, &failed);
        plans.iter().map(tensor).collect::<Result<Vec<NewTensor>, _>>()
    };
    let exact;
    let calibration;
    let tensors = if args.calibrate.is_empty() {
        floats(|storage| storage)?
    } else {
        // Equalization and rotation change the inputs of the products. The float model is therefore written
        // with them applied, and read again for the calibration.
        let tensors = floats(|storage| if storage.is_quantized() { Storage::F32 } else { storage })?;
        exact = Float::new(&args.output, |out| writer::write(out, file.config(), &tensors))
            .map_err(|failure| failed.take().map_or(failure, |error: LoadError| named(args, error)))?;
        let wanted = plans.iter().filter(|plan| plan.storage.is_quantized()).map(|plan| plan.name.clone());
        calibration = calibrate::run(&exact.file, wanted.collect(), &args.calibrate)?;
        plans.iter().map(|plan| calibrated(&exact.file, plan, &calibration, &failed)).collect::<Result<_, _>>()?
    };
    atomic_file::commit(output, |out| writer::write(out, file.config(), &tensors))
        .map_err(|failure| failed.take().map_or(failure, |error: LoadError| named(args, error)))?;

    let len = |storage| plans.iter().filter(|plan| plan.storage == storage).map(Plan::len).sum::<usize>() as f64;
    let all = plans.iter().map(Plan::len).sum::<usize>().max(1) as f64;
    let int4 = match len(Storage::Int4) {
        0.0 => String::new(),
        values => format!(" and {:.1} % in int4", 100.0 * values / all),
    };
    let bytes = std::fs::metadata(&args.output).map_err(Failure::environment)?.len();
    println!(
        "{}: {bytes} bytes of {}, {:.1} % of the values in int8{int4}",
        args.output.display(),
        file.len(),
        100.0 * len(Storage::Int8) / all
    );
    Ok(())
}

fn named(args: &Quantize, error: LoadError) -> Failure {
    Failure::input(format!("{}: {error}", args.input.display()))
}

/// The temporary float model beside the output, deleted when dropped.
struct Float {
    file: ModelFile,
    /// Dropped after the file, which may be memory-mapped.
    _temporary: TemporaryFile,
}

impl Float {
    fn new(output: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> Result<Self, Failure> {
        let temporary = TemporaryFile::beside(output, write).map_err(Failure::environment)?;
        Ok(Self { file: ModelFile::open(temporary.path())?, _temporary: temporary })
    }
}

/// A tensor of the new file.
struct Plan {
    name: String,
    shape: Vec<usize>,
    storage: Storage,
}

impl Plan {
    fn len(&self) -> usize {
        self.shape.iter().product()
    }
}

/// Rules that choose the storage of each tensor.
struct Rules {
    weights: Storage,
    /// Patterns by descending precedence, so a later `--set` comes first; `None` keeps a tensor's storage.
    globs: Vec<(Pattern, Option<Storage>)>,
}

impl Rules {
    fn new(args: &Quantize) -> Result<Self, Failure> {
        let mut globs = Vec::new();
        for set in args.set.iter().rev() {
            let (glob, storage) =
                set.rsplit_once('=').ok_or_else(|| Failure::input(format!("--set {set}: expected GLOB=TYPE")))?;
            let storage = StorageArg::from_str(storage, false).map_err(|_| {
                Failure::input(format!("--set {set}: expected f32, bf16, int8 or int4, got `{storage}`"))
            })?;
            globs.push((pattern("--set", glob)?, Some(storage.into())));
        }
        for glob in &args.keep {
            globs.push((pattern("--keep", glob)?, None));
        }
        let weights = match args.weights {
            WeightsArg::Bf16 => Storage::Bf16,
            WeightsArg::Int8 => Storage::Int8,
            WeightsArg::Int4 => Storage::Int4,
        };
        Ok(Self { weights, globs })
    }

    /// Returns the storage of `name`, currently stored as `was`; `frames` says if the model has layout `frames`.
    fn storage(&self, name: &str, was: Storage, product: bool, frames: bool) -> Storage {
        if let Some((_, asked)) = self.globs.iter().find(|(glob, _)| glob.matches(name)) {
            return asked.unwrap_or(was);
        }
        let exact = frames && default(KEPT_OF_FRAMES).matches(name);
        let kept = exact || self.weights.is_quantized() && DEFAULT_KEPT.iter().any(|glob| default(glob).matches(name));
        match self.weights {
            _ if kept || !product => was,
            Storage::Int4 if !is_int4(name) => Storage::Int8,
            weights => weights,
        }
    }

    /// Refuses a glob that matches no tensor, which is likely a typo.
    fn check(&self, names: &[&str]) -> Result<(), Failure> {
        match self.globs.iter().find(|(glob, _)| !names.iter().any(|name| glob.matches(name))) {
            Some((glob, _)) => Err(Failure::input(format!("`{glob}` matches no tensor of the model"))),
            None => Ok(()),
        }
    }
}

/// Whether a product becomes int4 by default when int4 is requested.
pub(crate) fn is_int4(name: &str) -> bool {
    INT4.iter().any(|glob| default(glob).matches(name)) && !DEFAULT_KEPT.iter().any(|glob| default(glob).matches(name))
}

fn pattern(option: &str, glob: &str) -> Result<Pattern, Failure> {
    Pattern::new(glob).map_err(|error| Failure::input(format!("{option} {glob}: {error}")))
}

fn default(glob: &str) -> Pattern {
    Pattern::new(glob).expect("the patterns above are well formed")
}

/// Returns the plan of every tensor, in the file's order of names.
fn plan(file: &ModelFile, rules: &Rules) -> Result<Vec<Plan>, Failure> {
    let specs = layout::specs(file.config(), true);
    let specs: HashMap<&str, &Spec> = specs.iter().map(|spec| (spec.name.as_str(), spec)).collect();
    let list = file.tensors();
    let names: Vec<&str> = list.iter().map(|(name, ..)| *name).collect();
    rules.check(&names)?;
    let plan = |(name, _, shape, _): &(&str, String, &[usize], usize)| {
        let (was, spec) = (file.storage(name)?, specs.get(name));
        if was.is_quantized() {
            let what = if was == Storage::Int8 { "int8" } else { "int4" };
            return Err(Failure::input(format!(
                "tensor `{name}` is {what} already: quantize the float model that it was made from"
            )));
        }
        if let Some(spec) = spec {
            file.tensor(name, &spec.shape)?;
        }
        let storage = match was {
            Storage::Bytes => was,
            _ => {
                let product = spec.is_some_and(|spec| spec.kind == Kind::Product);
                rules.storage(name, was, product, file.config().is_frames())
            }
        };
        let rows = spec.is_some_and(|spec| matches!(spec.kind, Kind::Product | Kind::Table));
        if storage.is_quantized() && !rows {
            return Err(Failure::input(format!(
                "tensor `{name}` is neither a product nor a table: it cannot be int8 or int4"
            )));
        }
        Ok(Plan { name: (*name).to_owned(), shape: shape.to_vec(), storage })
    };
    list.iter().map(plan).collect()
}

/// Returns the new tensor. Its values are read when they are written; an error among them is left in `failed`.
fn tensor<'a>(
    file: &'a ModelFile,
    plan: &'a Plan,
    storage: fn(Storage) -> Storage,
    rotated: bool,
    quantized: &'a dyn Fn(&str) -> bool,
    failed: &'a RefCell<Option<LoadError>>,
) -> Result<NewTensor<'a>, Failure> {
    let values = match plan.storage {
        Storage::Bytes => Values::Bytes(file.raw(&plan.name)?),
        _ => Values::Floats(Box::new(move || {
            let read = || {
                let read = |name: &str, shape: &[usize]| read(file, name, shape, rotated);
                let mut values = read(&plan.name, &plan.shape)?;
                equalize::apply(&read, &plan.name, &plan.shape, quantized, &mut values)?;
                Ok(values)
            };
            read().map_err(|error: LoadError| {
                let message = error.to_string();
                failed.replace(Some(error));
                io::Error::other(message)
            })
        })),
    };
    Ok(NewTensor { name: plan.name.clone(), shape: plan.shape.clone(), storage: storage(plan.storage), values })
}

/// Returns the tensor of the float model `exact`, rounded with `calibration` if it is quantized.
fn calibrated<'a>(
    exact: &'a ModelFile,
    plan: &'a Plan,
    calibration: &'a Calibration,
    failed: &'a RefCell<Option<LoadError>>,
) -> Result<NewTensor<'a>, Failure> {
    let floats = move || {
        read(exact, &plan.name, &plan.shape, false).map_err(|error| {
            let message = error.to_string();
            failed.replace(Some(error));
            io::Error::other(message)
        })
    };
    let values = match plan.storage {
        Storage::Bytes => Values::Bytes(exact.raw(&plan.name)?),
        storage if storage.is_quantized() => Values::Codes(Box::new(move || {
            calibrate::codes(calibration, (&plan.name, &plan.shape), &floats()?, storage)
        })),
        _ => Values::Floats(Box::new(floats)),
    };
    Ok(NewTensor { name: plan.name.clone(), shape: plan.shape.clone(), storage: plan.storage, values })
}

/// Reads a tensor's values; applies the rotation if `rotated`.
fn read(file: &ModelFile, name: &str, shape: &[usize], rotated: bool) -> Result<Vec<f32>, LoadError> {
    let tensor = file.tensor(name, shape)?;
    let mut values = vec![0.0; shape.iter().product()];
    tensor.read(&mut values)?;
    file.release(&tensor);
    if rotated {
        rotate::apply(file, name, shape, &mut values)?;
    }
    Ok(values)
}
