//! `umo model stage`: runs a single stage on tensors from a file (SPEC 3.1).

use std::io::Write;
use std::path::Path;

use umo_core::{Precision, Sampler};
use umo_core_model::weights::Loader;
use umo_core_tools::stage::{self, Inputs, Options};

use crate::args::Stage;
use crate::failure::Failure;
use crate::{atomic_file, model};

/// Runs the stage.
pub(crate) fn run(args: &Stage) -> Result<(), Failure> {
    let stage = stage::Stage::from_name(&args.stage).ok_or_else(|| {
        let names: Vec<_> = stage::Stage::ALL.into_iter().map(stage::Stage::name).collect();
        Failure::input(format!("unknown stage `{}`: expected {}", args.stage, names.join(", ")))
    })?;
    let bytes = read(&args.input)?;
    let inputs = Inputs::new(&bytes, "").map_err(|e| Failure::input(format!("{}: {e}", args.input.display())))?;
    let file = model::open(args.compute.model.as_deref())?;
    let sampling = file.config().sampling;
    let sampler = if args.greedy { Sampler::GREEDY } else { Sampler { sampling, seed: args.seed, ..Sampler::GREEDY } };
    let output = atomic_file::create(&args.output)?;
    let loader = Loader::new(&file, args.compute.precision(Precision::F32), model::isa(&args.compute)?);
    let team = model::team(&args.compute)?;
    let tensors = stage::run(stage, &loader, &team, &inputs, Options { target: args.target, sampler })?;
    let bytes = stage::serialize(&tensors)?;
    atomic_file::commit(output, |out| out.write_all(&bytes))?;
    for tensor in &tensors {
        println!("{} {:?}", tensor.name, tensor.shape);
    }
    Ok(())
}

fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    umo_core_base::file::read(path).map_err(|error| Failure::input(format!("cannot read {}: {error}", path.display())))
}
