//! Which model, which processor, how many threads.

use std::path::Path;

use umo_core::config::Skeleton;
use umo_core::{Config, ModelFile, Team};
use umo_kernels::Isa;

use crate::args::Compute;
use crate::failure::Failure;

/// The model in the program.
static DEFAULT: &[u8] = include_bytes!("../../models/umo-small/model.safetensors");

/// The model at `path`, or the one in the program; says on standard error what the model wants said.
pub(crate) fn open(path: Option<&Path>) -> Result<ModelFile, Failure> {
    let file = open_quietly(path)?;
    announce(file.config());
    Ok(file)
}

/// The same without a word, for whoever wants to know no more than its bones.
pub(crate) fn open_quietly(path: Option<&Path>) -> Result<ModelFile, Failure> {
    match path {
        Some(path) => ModelFile::open(path).map_err(|error| Failure::input(format!("{}: {error}", path.display()))),
        None => Ok(ModelFile::from_static(DEFAULT)?),
    }
}

/// The bones of the model in the program.
pub(crate) fn skeleton() -> Result<Skeleton, Failure> {
    Ok(ModelFile::from_static(DEFAULT)?.config().skeleton.clone())
}

fn announce(config: &Config) {
    if let Some(notice) = &config.notice {
        eprintln!("note: {notice}");
    }
}

/// The instruction set that was asked for, or the best one.
pub(crate) fn isa(compute: &Compute) -> Result<Isa, Failure> {
    let Some(name) = &compute.isa else { return Ok(Isa::detect()) };
    Isa::from_name(name).ok_or_else(|| {
        let have: Vec<_> = Isa::available().map(Isa::name).collect();
        Failure::input(format!("--isa {name}: this processor has {}", have.join(", ")))
    })
}

/// The number of threads that was asked for, or of cores.
pub(crate) fn threads(compute: &Compute) -> Result<usize, Failure> {
    let most = umo_core::team::MAX_THREADS;
    match compute.threads {
        Some(threads) if (1..=most).contains(&threads) => Ok(threads),
        Some(threads) => Err(Failure::input(format!("--threads {threads}: expected 1 to {most}"))),
        None => Ok(std::thread::available_parallelism().map_or(1, |n| n.get().min(most))),
    }
}

/// The threads that were asked for, or one per core.
pub(crate) fn team(compute: &Compute) -> Result<Team, Failure> {
    let threads = threads(compute)?;
    Team::new(threads).map_err(|error| Failure::machine(format!("cannot start {threads} threads: {error}")))
}
