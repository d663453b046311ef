//! Ctrl-C, SIGTERM and SIGHUP: the program removes unfinished outputs and exits. A command that runs until
//! interrupted exits by itself.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Once, OnceLock};

use umo_core_base::file::remove_parts;

use crate::failure::Failure;

static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();
static LISTENING: Once = Once::new();

/// Returns a flag that the first signal sets, for a command that then ends by itself; a second signal exits.
pub(crate) fn stop() -> Arc<AtomicBool> {
    Arc::clone(STOP.get_or_init(Arc::default))
}

/// Starts to listen for the signals.
///
/// # Errors
/// [`Failure::Machine`] if the system refuses the handlers or the thread.
pub(crate) fn listen() -> Result<(), Failure> {
    let mut listening = Ok(());
    LISTENING.call_once(|| listening = listen_to_system());
    listening.map_err(|error| Failure::environment(format!("cannot listen to Ctrl-C: {error}")))
}

/// Exits with this status, or on the first signal sets the flag if a command asked for it.
fn told(status: i32) {
    if STOP.get().is_none_or(|stop| stop.swap(true, Ordering::SeqCst)) {
        remove_parts();
        std::process::exit(status);
    }
}

#[cfg(unix)]
fn listen_to_system() -> io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let heard = [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|&signal| !is_ignored(signal));
    let mut signals = signal_hook::iterator::Signals::new(heard)?;
    let listening = move || signals.forever().for_each(|signal| told(128 + signal));
    std::thread::Builder::new().name("umo-signals".to_owned()).spawn(listening).map(|_| ())
}

#[cfg(not(unix))]
fn listen_to_system() -> io::Result<()> {
    ctrlc::set_handler(|| told(130)).map_err(io::Error::other)
}

/// Whether the parent process had this signal ignored, as `nohup` does; it then stays ignored. Only Linux reports it.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}
