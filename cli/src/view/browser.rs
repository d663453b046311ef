//! Opening a page where a desktop is there.

use std::path::Path;
#[cfg(not(windows))]
use std::process::{Command, Stdio};

/// The address of a file.
pub(super) fn address(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

/// Opens a file or an address in the browser of the desktop; where there is none, nothing happens.
#[cfg(windows)]
pub(super) fn open(address: &str) {
    // Whoever has no browser has the address on the screen. The library takes an address as one
    // word whatever is in it, and shows no console.
    let _ = open::that_detached(address);
}

/// Opens a file or an address in the browser of the desktop; where there is none, nothing happens.
#[cfg(not(windows))]
pub(super) fn open(address: &str) {
    if let Some(mut command) = opener(address) {
        // Whoever has no browser has the address on the screen.
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
