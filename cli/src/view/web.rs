//! `umo view --web`: the live page as a static folder for any web server. The model runs in the browser with the
//! npm package `umo-web`, whose files are copied beside the page.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use flate2::write::GzEncoder;
use serde_json::json;
use umo_core::SessionConfig;

use super::page;
use super::scene::{self, PageEngine};
use super::stream::{self, StreamPage};
use crate::args::{Page, PrecisionArg};
use crate::failure::Failure;
use crate::{atomic_file, model};

/// The package's folder, and the addresses of its module and of the model relative to the page.
const PLACE: &str = "umo";
const MODULE: &str = "umo/src/index.js";
const MODEL: &str = "model.safetensors.gz";
/// Default locations of the package.
const PACKAGES: [&str; 2] = ["node_modules/umo-web", "bindings/web"];
/// Licence files of the package that are copied if present.
const LICENCES: [&str; 3] = ["LICENSE-MIT", "LICENSE-APACHE", "third-party.txt"];
/// Ids of `umo_parameter`: the temperature, the hands' activity, the voice's expression, and the first layer's gain.
const TEMPERATURE: u32 = 1;
const ACTIVITY: u32 = 7;
const EXPRESSION: u32 = 8;
const FIRST_LAYER: u32 = 32;

/// Writes the folder.
pub(super) fn run(args: &Page, folder: &Path) -> Result<(), Failure> {
    check(args)?;
    args.words.refuse_with("--web, whose page has no words")?;
    let package = package(args.package.as_deref())?;
    let wearer = scene::wearer(&args.shown)?;
    let loaded = model::load(&args.compute)?;
    let session = stream::session(&args.generate, loaded.config());
    let input = args.input.as_deref().map(|path| (path, args.repair));
    let mut page = StreamPage::new(input, loaded, session, (args.voice, args.shown.figure.unwrap_or_default()))?;
    page.live.engine = Some(page_engine(args, &page.session));
    let (scene, _) = page.scene(wearer)?;
    let compressed = compressed(&model::bytes(args.compute.model.as_deref())?)?;
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
        ("--isa", args.compute.isa.is_some()),
        ("--threads", args.compute.threads.is_some()),
    ];
    match given.iter().find(|(_, given)| *given) {
        Some((name, _)) => Err(Failure::input(format!("{name} does not go with --web"))),
        None => args.shown.check(),
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

fn compressed(bytes: &[u8]) -> Result<Vec<u8>, Failure> {
    let mut gzip = GzEncoder::new(Vec::new(), flate2::Compression::best());
    gzip.write_all(bytes).and_then(|()| gzip.finish()).map_err(Failure::environment)
}

/// Returns the options for the page's engine.
fn page_engine(args: &Page, session: &SessionConfig) -> PageEngine {
    let (generate, avatar) = (&args.generate, &session.avatar);
    let mut parameters = Vec::new();
    if generate.greedy || generate.temperature.is_some() {
        parameters.push((TEMPERATURE, if generate.greedy { 0.0 } else { avatar.sampler.sampling.temperature }));
    }
    if generate.activity.is_some() {
        parameters.push((ACTIVITY, avatar.sampler.activity));
    }
    if generate.expression.is_some() {
        parameters.push((EXPRESSION, avatar.sampler.expression));
    }
    if !generate.layers.is_empty() {
        let gain = |layer| (FIRST_LAYER + layer as u32, session.layers.gain(layer));
        parameters.extend(umo_core::Layer::ALL.map(gain));
    }
    PageEngine {
        package: MODULE,
        model: MODEL,
        precision: match args.compute.precision {
            None | Some(PrecisionArg::Stored) => "stored",
            Some(PrecisionArg::F32) => "f32",
            Some(PrecisionArg::Bf16) => "bf16",
            Some(PrecisionArg::Int8) => "int8",
        },
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
