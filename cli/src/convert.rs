//! `umo model convert`: builds one model from published safetensors weights, with one tensor in memory at a time.

mod catalogue;
mod plan;
mod source;

use std::cell::RefCell;
use std::io;
use std::path::Path;

use umo_core::{Config, LoadError};
use umo_core_model::lm::text::TOKENIZER;
use umo_core_model::weights::writer::{self, NewTensor, Storage, Values};

use crate::args::Convert;
use crate::atomic_file;
use crate::failure::Failure;
use catalogue::Catalogue;
use plan::Plan;

/// Writes the model.
pub(crate) fn run(args: &Convert) -> Result<(), Failure> {
    let mut config = config(args)?;
    let catalogue = Catalogue::open(args, &config)?;
    let plans = plan::plan(&config, &catalogue, args)?;
    if config.notice.is_none() && plans.iter().any(Plan::grows) {
        config.notice = Some("The rows of its new tokens are not trained.".to_owned());
    }
    let tokenizer = args.tokenizer.as_deref().map(read).transpose()?;
    let output = atomic_file::create(&args.output)?;

    let failed = RefCell::new(None);
    let mut tensors: Vec<NewTensor> =
        plans.iter().map(|plan| tensor(plan, &catalogue, args.seed, args.dtype.into(), &failed)).collect();
    if let Some(bytes) = &tokenizer {
        tensors.push(NewTensor {
            name: TOKENIZER.to_owned(),
            shape: vec![bytes.len()],
            storage: Storage::Bytes,
            values: Values::Bytes(bytes),
        });
    }
    atomic_file::commit(output, |out| writer::write(out, &config, &tensors))
        .map_err(|failure| failed.take().unwrap_or(failure))?;

    let parameters: usize = plans.iter().map(|plan| plan.spec.len()).sum();
    println!("{}: {parameters} parameters", args.output.display());
    if let Some(notice) = &config.notice {
        eprintln!("note: {notice}");
    }
    Ok(())
}

/// Reads the new model's config and checks it with the requested experts.
fn config(args: &Convert) -> Result<Config, Failure> {
    let named = |error: LoadError| Failure::input(format!("{}: {error}", args.config.display()));
    let bytes = read(&args.config)?;
    let text = str::from_utf8(&bytes).map_err(|error| Failure::input(format!("{}: {error}", args.config.display())))?;
    let mut config = Config::parse(text).map_err(named)?;
    if config.audio.hubert.is_none() {
        return Err(named(LoadError::Config {
            key: "audio.kind".to_owned(),
            problem: "expected \"hubert\": other tokenizers have no published weights, training/ makes them".to_owned(),
        }));
    }
    config.lm.experts = args.experts.unwrap_or(config.lm.experts);
    config.lm.top_k = args.top_k.unwrap_or(config.lm.top_k);
    let text = serde_json::to_string(&config).map_err(Failure::environment)?;
    Config::parse(&text).map_err(named)
}

fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    umo_core_base::file::read(path)
        .map_err(|cause| Failure::input(format!("cannot read `{}`: {cause}", path.display())))
}

/// Returns the new tensor. Its values are computed when they are written; an error among them is left in `failed`.
fn tensor<'a>(
    plan: &'a Plan,
    catalogue: &'a Catalogue,
    seed: u64,
    floats: Storage,
    failed: &'a RefCell<Option<Failure>>,
) -> NewTensor<'a> {
    let storage = plan.storage(floats);
    let values = Values::Floats(Box::new(move || {
        let values = plan.values(catalogue, seed).and_then(|values| plan::check(plan, storage, values));
        values.map_err(|failure| {
            let message = failure.to_string();
            failed.replace(Some(failure));
            io::Error::other(message)
        })
    }));
    NewTensor { name: plan.spec.name.clone(), shape: plan.spec.shape.clone(), storage, values }
}
