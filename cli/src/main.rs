//! The program `umo`.

use std::process::ExitCode;

fn main() -> ExitCode {
    umo_cli::main(std::env::args_os())
}
