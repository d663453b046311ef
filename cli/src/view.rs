//! `umo view`: one HTML page with the avatar, its speech, and a record of how each frame was made; or the
//! same page served live.
//!
//! | module | part |
//! | --- | --- |
//! | `scene` | contents: a motion, its speech, and the record of how it was made |
//! | `blocks` | the contents as base64 numbers with a description |
//! | `page` | the HTML file, from the sources in `page/` |
//! | `live` | the page on loopback, and streams through a real engine |
//! | `web` | the live page as a folder, with the engine in the browser |
//! | `browser` | opening the page |

mod blocks;
mod browser;
mod live;
mod page;
mod scene;
mod web;

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::args::Page;
use crate::atomic_file;
use crate::failure::Failure;
use crate::retarget::is_character;
pub(crate) use live::session_rate;
use scene::Scene;

/// Writes and opens the page, or serves it.
pub(crate) fn run(args: &Page) -> Result<(), Failure> {
    if args.live {
        return live::run(args);
    }
    if let Some(folder) = &args.web {
        return web::run(args, folder);
    }
    let input = args.input.as_deref().ok_or_else(|| Failure::input("expected a recording or an animation to view"))?;
    let path = args.output.clone().unwrap_or_else(|| beside(input));
    let output = atomic_file::create(&path)?;
    let scene = if is_animation(input) {
        Scene::of_animation(input, args)?
    } else if args.audio.is_some() {
        return Err(Failure::input("--audio goes with an animation: a recording is its own audio"));
    } else {
        Scene::of_speech(input, args)?
    };
    if args.mapping.is_some() && scene.character.is_none() {
        return Err(Failure::input("--mapping goes with a character: --onto, or a character's file"));
    }
    let html = page::html(&scene)?;
    atomic_file::commit(output, |out| out.write_all(html.as_bytes()))?;
    println!("{}: {} frames, {:.1} MB", path.display(), scene.frames(), html.len() as f64 / 1e6);
    if !args.no_open {
        browser::open(&browser::address(&path));
    }
    Ok(())
}

/// Returns the default path of the page.
fn beside(input: &Path) -> PathBuf {
    input.with_extension("html")
}

/// Whether the file is an animation; other files are treated as recordings.
fn is_animation(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    is_character(path) || ["jsonl", "npz"].iter().any(|known| extension.eq_ignore_ascii_case(known))
}
