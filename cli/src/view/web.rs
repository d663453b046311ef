//! `umo view --web`: the live page as a static folder for any web server. The model runs in the browser with the
//! npm package `umo-web`, whose files are copied beside the page.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::write::GzEncoder;
use serde_json::json;
use umo_core::{Engine, EngineConfig, Model, Precision, SessionConfig, Threads};

use super::live::{check_voice, rest, session};
use super::page;
use super::scene::{self, Audio, PageEngine, Scene};
use crate::args::{Page, PrecisionArg, VoiceArg};
use crate::failure::Failure;
use crate::retarget::Wearer;
use crate::speech::Speech;
use crate::{atomic_file, model};

/// The package's folder, and the addresses of its module and of the model relative to the page.
const PLACE: &str = "umo";
const MODULE: &str = "umo/src/index.js";
const MODEL: &str = "model.safetensors.gz";
/// Default locations of the package.
const PACKAGES: [&str; 2] = ["node_modules/umo-web", "bindings/web"];
/// Licence files of the package that are copied if present.
const LICENCES: [&str; 3] = ["LICENSE-MIT", "LICENSE-APACHE", "third-party.txt"];
/// Ids of `umo_parameter`: the temperature, and the first layer's gain.
const TEMPERATURE: u32 = 1;
const FIRST_LAYER: u32 = 32;

/// Writes the folder.
pub(super) fn run(args: &Page, folder: &Path) -> Result<(), Failure> {
    check(args)?;
    let package = package(args.package.as_deref())?;
    let audio = args.input.as_deref().map(|path| recording(path, args.repair)).transpose()?;
    let wearer = scene::wearer(args)?;
    let compressed = compressed(&model::bytes(args.generate.model.as_deref())?)?;
    let mut scene = scene(args, wearer)?;
    scene.audio = audio;
    put_package(&package, &folder.join(PLACE))?;
    put(&folder.join(MODEL), &compressed)?;
    put(&folder.join("index.html"), page::html(&scene)?.as_bytes())?;
    println!("{}: serve this folder, by `python3 -m http.server -d` or any web server", folder.display());
    Ok(())
}

/// Refuses options that the browser's engine does not support.
fn check(args: &Page) -> Result<(), Failure> {
    let generate = &args.generate;
    let given = [
        ("--start-pose", generate.start_pose.is_some()),
        ("--gesture", !generate.gesture.is_empty()),
        ("--gesture-clip", !generate.gesture_clip.is_empty()),
        ("--isa", generate.compute.isa.is_some()),
        ("--threads", generate.compute.threads.is_some()),
    ];
    match given.iter().find(|(_, given)| *given) {
        Some((name, _)) => Err(Failure::input(format!("{name} does not go with --web"))),
        None if args.mapping.is_some() && args.onto.is_none() => {
            Err(Failure::input("--mapping goes with a character: --onto"))
        }
        None => Ok(()),
    }
}

/// Returns the folder of the npm package.
fn package(named: Option<&Path>) -> Result<PathBuf, Failure> {
    let is_one = |folder: &Path| folder.join("dist/umo.wasm").is_file() && folder.join("src/index.js").is_file();
    let found = match named {
        Some(folder) => is_one(folder).then_some(folder),
        None => PACKAGES.map(Path::new).into_iter().find(|folder| is_one(folder)),
    };
    found.map(Path::to_owned).ok_or_else(|| {
        let places = named.map_or_else(|| PACKAGES.join(" or "), |folder| folder.display().to_string());
        Failure::input(format!(
            "no package umo-web with dist/umo.wasm in {places}: install it by npm, or build it by bindings/web/build"
        ))
    })
}

fn recording(path: &Path, repair: bool) -> Result<Audio, Failure> {
    Audio::new(&Speech::open(path, repair)?)
}

fn compressed(bytes: &[u8]) -> Result<Vec<u8>, Failure> {
    let mut gzip = GzEncoder::new(Vec::new(), flate2::Compression::best());
    gzip.write_all(bytes).and_then(|()| gzip.finish()).map_err(Failure::environment)
}

/// Returns the page's contents before its stream begins, with the options for its engine.
fn scene(args: &Page, wearer: Option<Wearer>) -> Result<Scene, Failure> {
    let generate = &args.generate;
    let file = model::open(generate.model.as_deref())?;
    let isa = model::isa(&generate.compute)?;
    let loaded = Arc::new(Model::load(&file, generate.compute.precision(Precision::Stored), isa)?);
    drop(file);
    let config = EngineConfig { threads: Threads::Own(1), max_sessions: 1, max_batch: 1, ..EngineConfig::default() };
    let engine = Engine::new(loaded, &config).map_err(Failure::input)?;
    check_voice(args, engine.model())?;
    let session = session(generate, engine.model().config());
    let mut live = rest(&engine, &session)?;
    live.engine = Some(page_engine(args, &session));
    let title = args.input.as_deref().map_or_else(|| "microphone".to_owned(), |path| path.display().to_string());
    let config = engine.model().config();
    let mut character = None;
    if let Some(wearer) = wearer {
        let mut still = config.clip();
        still.push(&live.rest, &live.rest_face);
        character = Some(wearer.follow(&still)?.0);
    }
    Scene::of_stream(&title, config, args, live, character)
}

fn page_engine(args: &Page, session: &SessionConfig) -> PageEngine {
    let (generate, avatar) = (&args.generate, &session.avatar);
    let mut parameters = Vec::new();
    if generate.greedy || generate.temperature.is_some() {
        parameters.push((TEMPERATURE, if generate.greedy { 0.0 } else { avatar.sampler.sampling.temperature }));
    }
    if !generate.life.is_empty() {
        let gain = |layer| (FIRST_LAYER + layer as u32, session.layers.gain(layer));
        parameters.extend(umo_core::Layer::ALL.map(gain));
    }
    PageEngine {
        package: MODULE,
        model: MODEL,
        precision: match generate.compute.precision {
            None | Some(PrecisionArg::Stored) => "stored",
            Some(PrecisionArg::F32) => "f32",
            Some(PrecisionArg::Bf16) => "bf16",
            Some(PrecisionArg::Int8) => "int8",
        },
        voice: args.voice.map(|voice| match voice {
            VoiceArg::Live => "live",
            VoiceArg::Delayed => "delayed",
        }),
        session: json!({
            "target": avatar.target,
            "lookahead": avatar.lookahead,
            "horizon": avatar.horizon,
            "smoothing": avatar.smoothing,
            "guidance": avatar.guidance,
            // A string, because JavaScript's numbers have 53 bits.
            "seed": generate.seed.to_string(),
        }),
        parameters,
    }
}

/// Copies the package's files that a browser needs, and its licences.
fn put_package(package: &Path, place: &Path) -> Result<(), Failure> {
    let read = |path: &Path| fs::read(path).map_err(|error| Failure::input(format!("{}: {error}", path.display())));
    let listed = fs::read_dir(package.join("src")).and_then(|entries| entries.collect::<Result<Vec<_>, _>>());
    let sources = listed.map_err(|error| Failure::input(format!("{}: {error}", package.display())))?;
    for path in sources.iter().map(fs::DirEntry::path).filter(|path| path.extension() == Some(OsStr::new("js"))) {
        put(&place.join("src").join(path.file_name().unwrap_or_default()), &read(&path)?)?;
    }
    put(&place.join("dist/umo.wasm"), &read(&package.join("dist/umo.wasm"))?)?;
    for path in LICENCES.map(|name| package.join(name)).iter().filter(|path| path.is_file()) {
        put(&place.join(path.file_name().unwrap_or_default()), &read(path)?)?;
    }
    Ok(())
}

/// Writes a file and creates its parent folders.
fn put(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)
            .map_err(|error| Failure::input(format!("cannot write `{}`: {error}", folder.display())))?;
    }
    atomic_file::commit(atomic_file::create(path)?, |out| out.write_all(bytes))
}
