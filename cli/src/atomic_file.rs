//! Atomically written files, with the program's error messages.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use clap::ArgMatches;
use umo_core_base::file::AtomicFile;

use crate::args::GestureClip;
use crate::failure::Failure;

/// Names of the arguments that hold output files.
const OUTPUTS: [&str; 4] = ["output", "sheet", "plot", "results"];

/// Refuses outputs that are also inputs of the command, and `-`. `matches` may be those of a command above it.
pub(crate) fn check(matches: &ArgMatches) -> Result<(), Failure> {
    if let Some((_, below)) = matches.subcommand() {
        return check(below);
    }
    let (mut outputs, mut inputs) = (Vec::new(), Vec::new());
    for id in matches.ids() {
        let paths = matches.try_get_many::<PathBuf>(id.as_str()).ok().flatten().into_iter().flatten();
        let clips = matches.try_get_many::<GestureClip>(id.as_str()).ok().flatten().into_iter().flatten();
        if OUTPUTS.contains(&id.as_str()) { &mut outputs } else { &mut inputs }
            .extend(paths.chain(clips.map(|clip| &clip.file)).map(PathBuf::as_path));
    }
    if outputs.contains(&Path::new("-")) {
        return Err(Failure::input(
            "`-`: outputs are files and do not go to standard output; `./-` is a file of that name",
        ));
    }
    refuse_inputs(&outputs, &inputs)
}

/// Refuses outputs that would overwrite an input.
pub(crate) fn refuse_inputs(outputs: &[&Path], inputs: &[&Path]) -> Result<(), Failure> {
    let file = |path: &&Path| fs::canonicalize(path).ok().filter(|path| path.is_file());
    let read: HashSet<_> = inputs.iter().filter_map(file).collect();
    match outputs.iter().find(|output| file(output).is_some_and(|output| read.contains(&output))) {
        Some(both) => {
            Err(Failure::input(format!("`{}` is an input and an output: name another output", both.display())))
        }
        None => Ok(()),
    }
}

/// [`AtomicFile::create`] with the program's message.
pub(crate) fn create(path: &Path) -> Result<AtomicFile, Failure> {
    AtomicFile::create(path).map_err(|cause| Failure::input(format!("cannot write `{}`: {cause}", path.display())))
}

/// [`AtomicFile::commit`] with the program's message.
pub(crate) fn commit(
    whole: AtomicFile,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), Failure> {
    let path = whole.path().to_owned();
    whole.commit(write).map_err(|cause| Failure::environment(format!("cannot write `{}`: {cause}", path.display())))
}
