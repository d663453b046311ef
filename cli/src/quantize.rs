//! `umo quantize`: the same model with smaller weights, one tensor at a time.

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
use umo_core::calibration::Calibration;
use umo_core::file::TemporaryFile;
use umo_core::weights::layout::{self, Kind, Spec};
use umo_core::weights::writer::{self, NewTensor, Storage, Values};
use umo_core::{LoadError, ModelFile};

use crate::args::{Quantize, StorageArg, WeightsArg};
use crate::atomic_file;
use crate::failure::Failure;

/// Products that lose more by int8 than they gain; `docs/quantization.md` has the measurements.
const DEFAULT_KEPT: [&str; 5] = [
    // The second and third convolution have three quarters of the arithmetic; each of the others
    // would cost as much accuracy.
    "audio.hubert.feature_extractor.conv_layers.[!12].*",
    "audio.hubert.feature_extractor.conv_layers.[0-9][0-9]*",
    "audio.hubert.encoder.pos_conv_embed.*",
    // Decides which code is written, and is always computed in float.
    "lm.lm_head.weight",
    // Decides which code a pose is; only used for start poses, and always in float.
    "vq.[fhul]*.encoder.*",
];

/// Products that gain most by int4 for what they lose: half of a decoder step's reading; the others become
/// int8 with it.
const INT4: [&str; 1] = ["lm.decoder.*.moe.experts.*"];

/// Of layout `frames`, also kept from bf16: small differences of large values, always computed in f32.
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
        return Err(Failure::input("--calibrate: no tensor becomes int8 or int4, and no other is rounded by it"));
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
        // The products read other inputs once their channels are evened out or rotated: the float model is
        // written as that makes it, and read again.
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

/// The float model beside the output, gone when dropped.
struct Float {
    file: ModelFile,
    /// Dropped after the file, which may be mapped.
    _temporary: TemporaryFile,
}

impl Float {
    fn new(output: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> Result<Self, Failure> {
        let temporary = TemporaryFile::beside(output, write).map_err(Failure::environment)?;
        Ok(Self { file: ModelFile::open(temporary.path())?, _temporary: temporary })
    }
}

/// One tensor of the new file.
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

/// Which tensors become what.
struct Rules {
    weights: Storage,
    /// In the order of precedence, the last first; `None` keeps a tensor as it is.
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

    /// What `name` is stored as, `was` what it is now; `frames` of a model of that layout.
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

    /// A glob that names nothing is a slip of the pen.
    fn check(&self, names: &[&str]) -> Result<(), Failure> {
        match self.globs.iter().find(|(glob, _)| !names.iter().any(|name| glob.matches(name))) {
            Some((glob, _)) => Err(Failure::input(format!("`{glob}` matches no tensor of the model"))),
            None => Ok(()),
        }
    }
}

/// Whether a product becomes int4 where nothing else is asked for.
pub(crate) fn is_int4(name: &str) -> bool {
    INT4.iter().any(|glob| default(glob).matches(name)) && !DEFAULT_KEPT.iter().any(|glob| default(glob).matches(name))
}

fn pattern(option: &str, glob: &str) -> Result<Pattern, Failure> {
    Pattern::new(glob).map_err(|error| Failure::input(format!("{option} {glob}: {error}")))
}

fn default(glob: &str) -> Pattern {
    Pattern::new(glob).expect("the patterns above are well formed")
}

/// Every tensor of the file and what becomes of it, in the file's order of names.
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
                "tensor `{name}` is {what} already: quantise the float model that it was made from"
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
            return Err(Failure::input(format!("tensor `{name}` is no product or table: it cannot be int8 or int4")));
        }
        Ok(Plan { name: (*name).to_owned(), shape: shape.to_vec(), storage })
    };
    list.iter().map(plan).collect()
}

/// The new tensor; its values are read when they are written, and what is wrong with them is left
/// in `failed`.
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

/// The tensor of the float model `exact`, rounded as `calibration` says where it is quantized.
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

/// A tensor's values, as they are in the file or, with `rotated`, as they are after the rotation.
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
