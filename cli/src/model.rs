//! The choice of model, instruction set and threads.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use umo_core::{Config, Engine, EngineConfig, Model, ModelFile, Precision, Priority, Skeleton, Team};
use umo_core_base::team::{Cores, Placement};
use umo_kernels::Isa;

use crate::args::{Compute, EngineArgs};
use crate::failure::Failure;

/// The default model, if the build embeds it: see `build.rs`.
#[cfg(umo_embedded_model)]
static EMBEDDED: Option<&[u8]> = Some(include_bytes!(env!("UMO_EMBED_MODEL")));
#[cfg(not(umo_embedded_model))]
static EMBEDDED: Option<&[u8]> = None;

/// Environment variable that names the default model's file; it precedes embedded and installed models.
const VARIABLE: &str = "UMO_MODEL";
/// File name of an installed default model.
const FILE: &str = "umo-people.safetensors";

/// Opens the model at `path`, or the default model; prints the model's notice to standard error.
///
/// # Errors
/// [`Failure::Input`] naming the file; without a default model, the error lists the searched places.
pub(crate) fn open(path: Option<&Path>) -> Result<ModelFile, Failure> {
    let file = open_quietly(path)?;
    announce(file.config());
    Ok(file)
}

/// [`open`] without the notice, for callers that need only the skeleton.
pub(crate) fn open_quietly(path: Option<&Path>) -> Result<ModelFile, Failure> {
    place(path)?.open()
}

/// Returns the bytes of the file that [`open`] would open.
pub(crate) fn bytes(path: Option<&Path>) -> Result<Cow<'static, [u8]>, Failure> {
    match place(path)? {
        Place::Program(bytes) => Ok(Cow::Borrowed(bytes)),
        Place::File(path) => {
            std::fs::read(&path).map(Cow::Owned).map_err(|error| Failure::input(format!("{}: {error}", path.display())))
        }
    }
}

/// Location of a model.
enum Place {
    File(PathBuf),
    Program(&'static [u8]),
}

impl Place {
    fn open(self) -> Result<ModelFile, Failure> {
        match self {
            Self::Program(bytes) => Ok(ModelFile::from_static(bytes)?),
            Self::File(path) => {
                ModelFile::open(&path).map_err(|error| Failure::input(format!("{}: {error}", path.display())))
            }
        }
    }
}

fn place(path: Option<&Path>) -> Result<Place, Failure> {
    match path {
        Some(path) => Ok(Place::File(path.to_owned())),
        None => default(std::env::var_os(VARIABLE).map(PathBuf::from), EMBEDDED, &installed()),
    }
}

/// Returns the default model: the file that the environment names, the embedded one, or the first installed one.
fn default(named: Option<PathBuf>, embedded: Option<&'static [u8]>, installed: &[PathBuf]) -> Result<Place, Failure> {
    if let Some(path) = named.filter(|path| !path.as_os_str().is_empty()) {
        return Ok(Place::File(path));
    }
    if let Some(bytes) = embedded {
        return Ok(Place::Program(bytes));
    }
    match installed.iter().find(|path| path.is_file()) {
        Some(path) => Ok(Place::File(path.clone())),
        None => {
            let places: Vec<_> = installed.iter().map(|path| path.display().to_string()).collect();
            Err(Failure::Input(format!(
                "no default model: give --model FILE, set {VARIABLE}=FILE, or install it as one of {}",
                places.join(", ")
            )))
        }
    }
}

/// Returns the candidate paths of an installed default model: beside the program, as `scripts/build/install` and
/// packages install it, and in the user's and the system's data folders.
fn installed() -> Vec<PathBuf> {
    let mut places = Vec::new();
    let program = std::env::current_exe().ok();
    if let Some(folder) = program.as_deref().and_then(Path::parent) {
        places.push(folder.join(FILE));
        places.push(folder.join("../share/umo/models").join(FILE));
    }
    let home = std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".local/share"));
    if let Some(data) = std::env::var_os("XDG_DATA_HOME").map(PathBuf::from).or(home) {
        places.push(data.join("umo/models").join(FILE));
    }
    places.push(Path::new("/usr/share/umo/models").join(FILE));
    places
}

/// Returns the default model's skeleton.
pub(crate) fn skeleton() -> Result<Skeleton, Failure> {
    Ok(open_quietly(None)?.config().skeleton.clone())
}

fn announce(config: &Config) {
    if let Some(notice) = &config.notice {
        eprintln!("note: {notice}");
    }
}

/// Returns the requested instruction set, or the best available one.
pub(crate) fn isa(compute: &Compute) -> Result<Isa, Failure> {
    let isa = match &compute.isa {
        None => Isa::detect(),
        Some(name) => Isa::from_name(name).ok_or_else(|| {
            let have: Vec<_> = Isa::available().map(Isa::name).collect();
            Failure::input(format!("--isa {name}: this processor has {}", have.join(", ")))
        })?,
    };
    Ok(if compute.portable { isa.portable() } else { isa })
}

/// Returns the requested number of threads, or the number of cores.
pub(crate) fn threads(compute: &Compute) -> Result<usize, Failure> {
    let most = umo_core::MAX_THREADS;
    match compute.threads {
        Some(threads) if (1..=most).contains(&threads) => Ok(threads),
        Some(threads) => Err(Failure::input(format!("--threads {threads}: expected 1 to {most}"))),
        None => Ok(std::thread::available_parallelism().map_or(1, |n| n.get().min(most))),
    }
}

/// Loads the model of the arguments.
pub(crate) fn load(compute: &Compute) -> Result<Arc<Model>, Failure> {
    let file = open(compute.model.as_deref())?;
    Ok(Arc::new(Model::load(&file, compute.precision(Precision::Stored), isa(compute)?)?))
}

/// Returns the engine configuration of the arguments.
pub(crate) fn engine_config(args: &EngineArgs) -> Result<EngineConfig, Failure> {
    Ok(args.config(threads(&args.compute)?))
}

/// Creates an engine for this many sessions.
pub(crate) fn engine(args: &EngineArgs, model: Arc<Model>, sessions: usize) -> Result<Engine, Failure> {
    engine_of(engine_config(args)?, model, sessions)
}

/// [`engine`] of a configuration.
pub(crate) fn engine_of(config: EngineConfig, model: Arc<Model>, sessions: usize) -> Result<Engine, Failure> {
    // A closed session keeps its place until the end of its batch.
    let config = EngineConfig { max_sessions: sessions + 1, max_batch: config.max_batch.min(sessions), ..config };
    let engine = Engine::new(model, &config).map_err(Failure::input)?;
    if engine.priority() != config.priority {
        let what = format!("--priority {}: the system refuses it: {}", config.priority, Priority::remedy());
        return Err(Failure::environment(what));
    }
    Ok(engine)
}

/// Returns a team with the requested number of threads, or one per core; on a machine with several kinds of cores, one
/// per core of the fastest kind, on these.
pub(crate) fn team(compute: &Compute) -> Result<Team, Failure> {
    let (threads, machine) = (threads(compute)?, Cores::system());
    let kind = machine.fastest(threads).filter(|_| compute.threads.is_none());
    let threads = kind.map_or(threads, |kind| threads.min(kind.cores));
    Team::placed(threads, Placement { kind, ..Placement::default() })
        .map_err(|error| Failure::environment(format!("cannot start {threads} threads: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_model_is_the_named_the_embedded_or_the_installed_one() {
        let folder = tempfile::tempdir().unwrap();
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mel_k2_arkit/model.safetensors");
        let installed = [folder.path().join("missing"), folder.path().join(FILE)];
        let name = |place: Result<Place, Failure>| place.unwrap().open().unwrap().config().name.clone();

        let Some(Failure::Input(text)) = default(None, None, &installed).err() else { panic!("the input is at fault") };
        assert!(text.contains("--model") && text.contains(VARIABLE) && text.contains(FILE), "{text}");

        std::fs::copy(&golden, &installed[1]).unwrap();
        let small = name(default(None, None, &installed));
        assert_eq!(small, ModelFile::open(&golden).unwrap().config().name);
        let embedded = name(default(None, EMBEDDED, &installed));
        assert_ne!(embedded, small, "the embedded model takes precedence over installed ones");
        assert_eq!(
            name(default(Some(golden.clone()), EMBEDDED, &[])),
            small,
            "a named model takes precedence over both"
        );
        assert_eq!(name(default(Some(PathBuf::new()), EMBEDDED, &[])), embedded, "an empty variable counts as unset");
        assert!(
            default(Some(folder.path().join("missing")), EMBEDDED, &installed).and_then(Place::open).is_err(),
            "a wrong name is refused"
        );
    }
}
