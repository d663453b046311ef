//! The command line of umo: speech to full-body animation.
//!
//! | module | purpose |
//! |---|---|
//! | [`args`] | the command line |
//! | `animate`, `text`, `gestures` | speech or text to an animation; gestures over it |
//! | `converse` | recordings of a conversation to avatars that see and hear each other |
//! | `speech` | a recording, block by block |
//! | `play`, `score` | takes: their frames, and changes of what they do |
//! | `words`, `transcript` | words of a recording, out of files; what their rules would do |
//! | `batch` | many recordings with one model, computed together |
//! | `stage`, `inspect`, `random` | a single stage; contents of a model or a character; a model of random weights |
//! | `convert`, `quantize` | a model from published weights; the same model with smaller weights |
//! | `live` | live speech to poses: on a page, or for other programs |
//! | `serve` | avatars for many clients over WebSocket |
//! | `view` | the page that shows an avatar, written once, served live, or as a folder |
//! | `bench`, `doctor` | a model's speed on this machine; the self-test |
//! | [`export`], `import`, `start_pose` | input and output files |
//! | `draw`, `figure` | pictures of the speaking figure (crate `umo_figure`); the figure as an avatar |
//! | `retarget` | an animation to another character |
//! | `bvh` | parser of BVH files |
//! | `model`, `failure`, `progress` | the model to use; error messages; progress of the work |
//! | `atomic_file`, `console`, `interrupt` | output files; printing; signals that end the program |
#![deny(unsafe_code)]

// First, because all modules use its macros.
#[macro_use]
mod console;

mod animate;
pub mod args;
pub mod atomic_file;
mod batch;
mod bench;
mod bvh;
mod converse;
mod convert;
mod doctor;
mod draw;
pub mod export;
mod failure;
mod figure;
mod gestures;
pub mod import;
mod inspect;
mod interrupt;
mod live;
mod model;
mod play;
mod progress;
mod quantize;
mod random;
mod retarget;
mod score;
#[cfg(feature = "serve")]
mod serve;
mod speech;
mod stage;
mod start_pose;
mod strokes;
mod text;
mod transcript;
mod view;
mod words;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::FromArgMatches;

use args::{Args, Command, ModelCommand};
pub use failure::Failure;

/// Runs the program and returns its exit code: 0, 2 if the input is at fault, or 1 if the machine is.
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let parsed = args::command().try_get_matches_from(args).and_then(|matches| {
        let args = Args::from_arg_matches(&matches).map_err(|error| error.format(&mut args::command()))?;
        Ok((args, matches))
    });
    let done = match parsed {
        Ok((args, matches)) => atomic_file::check(&matches).and_then(|()| run(args.command)),
        // Help and version go to standard output and are not failures; clap distinguishes them.
        Err(error) => {
            let error = args::suggest(error);
            let printed = error.print();
            if error.use_stderr() {
                return ExitCode::from(2);
            }
            console::remember(printed);
            Ok(())
        }
    };
    match done.and_then(|()| console::finish()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.code())
        }
    }
}

fn run(command: Command) -> Result<(), Failure> {
    // The server handles signals itself.
    let is_server = match &command {
        #[cfg(feature = "serve")]
        Command::Serve(_) => true,
        Command::Live(args) => !args.has_receivers(),
        Command::View(args) => args.live,
        _ => false,
    };
    if !is_server {
        interrupt::listen()?;
    }
    match command {
        Command::Animate(args) => animate::run(&args),
        Command::Play(args) => play::run(&args),
        Command::Score(args) => score::run(&args),
        Command::Converse(args) => converse::run(&args),
        Command::Batch(args) => batch::run(&args),
        Command::Text(args) => text::run(&args),
        Command::Gestures => gestures::run(),
        Command::Words(args) => words::run(&args),
        Command::Model(command) => match command {
            ModelCommand::Inspect(args) => inspect::run(&args),
            ModelCommand::Convert(args) => convert::run(&args),
            ModelCommand::Quantize(args) => quantize::run(&args),
            ModelCommand::Random(args) => random::run(&args),
            ModelCommand::Stage(args) => stage::run(&args),
        },
        Command::Inspect(args) => inspect::character(&args),
        Command::View(args) => view::run(&args),
        Command::Live(args) => live::run(&args),
        #[cfg(feature = "serve")]
        Command::Serve(args) => serve::run(&args),
        Command::Figure(args) => figure::run(&args),
        Command::Retarget(args) => retarget::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Draw(args) => draw::run(&args),
    }
}
