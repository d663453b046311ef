//! `umo view`: one HTML page with the avatar, its speech, and a record of how each frame was made; and the
//! page of `umo live`.
//!
//! | module | part |
//! | --- | --- |
//! | `scene` | contents: a motion, its speech, and the record of how it was made |
//! | `blocks` | the contents as base64 numbers with a description |
//! | `page` | the HTML file, from the sources in `page/` |
//! | `judge` | a page on which a person finds the speech of a motion |
//! | `take` | takes: one with its score, or several side by side |
//! | `desk` | the page of takes on loopback: saving, drawing, keeping |
//! | `stream` | a page whose frames come from a stream |
//! | `live` | that page on loopback, with streams of the program's engine |
//! | `web` | that page as a folder, with the engine in the browser |
//! | `browser` | opening the page |

mod blocks;
mod browser;
#[cfg(feature = "serve")]
mod desk;
mod judge;
#[cfg(feature = "serve")]
pub(crate) mod live;
mod page;
mod scene;
pub(crate) mod stream;
mod take;
mod web;

use std::io::Write;
use std::path::Path;

use umo_core_pose::clip::Clip;
use umo_figure::Figure;

use crate::args::Page;
use crate::atomic_file;
use crate::converse::Member;
use crate::failure::Failure;
use crate::retarget::is_character;
use scene::Scene;

/// Writes and opens the page.
pub(crate) fn run(args: &Page) -> Result<(), Failure> {
    if let Some(folder) = &args.web {
        return web::run(args, folder);
    }
    take::check(args)?;
    if args.live {
        return serve(args);
    }
    let path = match &args.output {
        Some(path) => path.clone(),
        None => input(args)?.with_extension("html"),
    };
    let output = atomic_file::create(&path)?;
    let scene = if args.judge.is_empty() {
        scene(input(args)?, args)?
    } else {
        args.words.refuse_with("--judge, whose recordings have words of their own")?;
        judge::scene(args)?
    };
    let html = page::html(&scene)?;
    atomic_file::commit(output, |out| out.write_all(html.as_bytes()))?;
    println!("{}: {} frames, {:.1} MB", path.display(), scene.frames(), html.len() as f64 / 1e6);
    if !args.shown.no_open {
        browser::open(&browser::address(&path));
    }
    Ok(())
}

/// Serves the page of takes.
fn serve(args: &Page) -> Result<(), Failure> {
    #[cfg(feature = "serve")]
    return desk::run(args);
    #[cfg(not(feature = "serve"))]
    Err(Failure::input(format!("--live {}: this build has no server for a page", input(args)?.display())))
}

/// Returns the page of a conversation.
pub(crate) fn conversation(
    members: &[Member],
    names: &[String],
    clips: Vec<Clip>,
    figures: &[Figure],
) -> Result<String, Failure> {
    page::html(&Scene::of_conversation(members, names, clips, figures)?)
}

/// Returns the recording or animation of a page with one.
fn input(args: &Page) -> Result<&Path, Failure> {
    args.input.as_deref().ok_or_else(|| Failure::input("expected a recording or an animation to view"))
}

/// Returns the contents of a page with one motion.
fn scene(input: &Path, args: &Page) -> Result<Scene, Failure> {
    let scene = if take::is_take(input) {
        take::Opened::new(args)?.scene(args, None)?
    } else if is_animation(input) {
        args.words.refuse_with("an animation: it has its gestures already")?;
        Scene::of_animation(input, args)?
    } else if !args.audio.is_empty() {
        return Err(Failure::input("--audio goes with an animation or a take: a recording is its own audio"));
    } else {
        Scene::of_speech(input, args)?
    };
    if args.shown.mapping.is_some() && scene.character.is_none() {
        return Err(Failure::input("--mapping goes with a character: --onto, or a character's file"));
    }
    Ok(scene)
}

/// Whether the file is an animation; other files are treated as recordings.
fn is_animation(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    is_character(path) || ["jsonl", "npz"].iter().any(|known| extension.eq_ignore_ascii_case(known))
}
