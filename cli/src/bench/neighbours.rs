//! Other programs that keep the machine busy while a model is measured: one that computes on every
//! core, and one that wakes up 10,000 times a second.

use std::hint::spin_loop;
use std::io::Read;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::args::Neighbour;
use crate::failure::Failure;

const WAKES_PER_SECOND: u32 = 10_000;
/// Times that one that computes does so before it looks whether it is still wanted.
const SPINS: u32 = 100_000;

/// They run until this is dropped, or its process ends.
#[derive(Debug)]
pub(super) struct Neighbours(Vec<Child>);

impl Neighbours {
    /// One that computes for every core, and one that wakes up.
    pub(super) fn start() -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::environment)?;
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        // What has started is ended where one of the others does not.
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
            // One that has ended by itself cannot be killed.
            drop(child.kill());
            drop(child.wait());
        }
    }
}

/// Is such a program until standard input ends.
pub(super) fn be(kind: Neighbour) {
    let ended = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&ended);
    std::thread::spawn(move || {
        // An error of a pipe is its end as well.
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
