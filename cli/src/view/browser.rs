//! Opening a page on a desktop.

use std::path::Path;
#[cfg(not(windows))]
use std::process::{Command, Stdio};

/// Returns the address of a file.
pub(super) fn address(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

/// Opens a file or an address in the desktop's browser; a no-op without one.
#[cfg(windows)]
pub(super) fn open(address: &str) {
    // On failure, the address is still printed on the terminal. The library passes the address as a single
    // argument regardless of its contents, and shows no console.
    let _ = open::that_detached(address);
}

/// Opens a file or an address in the desktop's browser; a no-op without one.
#[cfg(not(windows))]
pub(super) fn open(address: &str) {
    if let Some(mut command) = opener(address) {
        // On failure, the address is still printed on the terminal.
        let _ = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    }
}

#[cfg(target_os = "macos")]
fn opener(address: &str) -> Option<Command> {
    let mut command = Command::new("open");
    command.arg(address);
    Some(command)
}

#[cfg(not(any(windows, target_os = "macos")))]
fn opener(address: &str) -> Option<Command> {
    let desktop = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    desktop.then(|| {
        let mut command = Command::new("xdg-open");
        command.arg(address);
        command
    })
}
