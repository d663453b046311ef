//! Speech to a full-body animation, on the command line.
//!
//! | module | what it does |
//! |---|---|
//! | [`args`] | the command line |
//! | `animate`, `text`, `gestures` | speech, or a text, to an animation; the gestures over it |
//! | `speech` | a recording, block by block |
//! | `batch` | many recordings with one model, computed together |
//! | `stage`, `inspect`, `random` | one stage alone; what a model holds; a model of random weights |
//! | `convert`, `quantize` | a model of published weights; the same model with smaller ones |
//! | `live` | speech as it comes to poses for other programs, over the network |
//! | `serve` | avatars for many clients over WebSocket |
//! | `view` | the page that shows an avatar, made once or served live |
//! | `bench`, `doctor` | how fast a model is on this machine; whether it computes rightly |
//! | [`export`], `import`, `start_pose` | files in and out |
//! | `draw`, `figure` | pictures of the figure that speaks (crate `umo_figure`); the figure as an avatar |
//! | `retarget` | an animation to another character |
//! | `bvh` | what files of this format hold |
//! | `vrm` | what VRM avatars call their bones and expressions |
//! | `model`, `failure`, `progress` | which model; what is said when something fails; how far the work is |
//! | `console`, `interrupt` | what is printed; signals that end the program |
#![deny(unsafe_code)]

// First: its macros are those of every module.
#[macro_use]
mod console;

mod animate;
pub mod args;
pub mod atomic_file;
mod batch;
mod bench;
mod bvh;
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
mod progress;
mod quantize;
mod random;
mod retarget;
#[cfg(feature = "serve")]
mod serve;
mod speech;
mod stage;
mod start_pose;
mod text;
mod view;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches};

use args::{Args, Command};
pub use failure::Failure;

/// Runs the program and says how it ended: 0, 2 where the input is at fault, 1 where the machine
/// is.
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let parsed = Args::command().try_get_matches_from(args).and_then(|matches| {
        let args = Args::from_arg_matches(&matches).map_err(|error| error.format(&mut Args::command()))?;
        Ok((args, matches))
    });
    let done = match parsed {
        Ok((args, matches)) => atomic_file::check(&matches).and_then(|()| run(args.command)),
        // Help and version go to standard output and are no failure; clap knows which is which.
        Err(error) => {
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
    // The server listens by itself.
    #[cfg(feature = "serve")]
    let listens = matches!(command, Command::Serve(_));
    #[cfg(not(feature = "serve"))]
    let listens = false;
    if !listens {
        interrupt::listen()?;
    }
    match command {
        Command::Animate(args) => animate::run(&args),
        Command::Batch(args) => batch::run(&args),
        Command::Text(args) => text::run(&args),
        Command::Gestures => gestures::run(),
        Command::Stage(args) => stage::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Quantize(args) => quantize::run(&args),
        Command::MakeRandom(args) => random::run(&args),
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
