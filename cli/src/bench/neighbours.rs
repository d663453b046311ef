//! Other programs that keep the machine busy during a measurement: one per core that computes, and one
//! that wakes up 10,000 times a second.

use std::hint::spin_loop;
use std::io::Read;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::args::Neighbour;
use crate::failure::Failure;

const WAKES_PER_SECOND: u32 = 10_000;
/// Iterations of a spinning program between checks whether it should stop.
const SPINS: u32 = 100_000;

/// Child processes that run until this is dropped or the parent process ends.
#[derive(Debug)]
pub(super) struct Neighbours(Vec<Child>);

impl Neighbours {
    /// Starts one spinning program per core, and one that wakes up.
    pub(super) fn start() -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::environment)?;
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        // Built up in place, so that the started ones are ended if a later one fails to start.
        let mut all = Self(Vec::with_capacity(cores + 1));
        for kind in std::iter::repeat_n("spin", cores).chain(["wake"]) {
            let child = Command::new(&program)
                .args(["bench", "--neighbour", kind])
                .stdin(Stdio::piped())
                .stdout(Stdio::null())
                .spawn()
                .map_err(|error| Failure::environment(format!("{}: {error}", program.display())))?;
            all.0.push(child);
        }
        Ok(all)
    }
}

impl Drop for Neighbours {
    fn drop(&mut self) {
        for child in &mut self.0 {
            // `kill` fails for one that has already ended.
            drop(child.kill());
            drop(child.wait());
        }
    }
}

/// Runs as such a program until standard input ends.
pub(super) fn be(kind: Neighbour) {
    let ended = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&ended);
    std::thread::spawn(move || {
        // A pipe error also counts as its end.
        drop(std::io::stdin().read_to_end(&mut Vec::new()));
        seen.store(true, Ordering::Relaxed);
    });
    while !ended.load(Ordering::Relaxed) {
        match kind {
            Neighbour::Spin => (0..SPINS).for_each(|_| spin_loop()),
            Neighbour::Wake => std::thread::sleep(Duration::from_secs(1) / WAKES_PER_SECOND),
        }
    }
}
