//! umo for Godot 4: the node [`UmoAvatar3D`](avatar::UmoAvatar3D), which moves a skeleton and blend
//! shapes to what an audio player plays. All of the work is umo's, behind its C interface.
//!
//! | module | what it holds |
//! |---|---|
//! | `avatar` | the node: properties, methods, signals, and the clock from sound to motion |
//! | `source` | where the samples of a player come from |
//! | `wave` | samples out of the data of an `AudioStreamWAV` |
//! | `rig` | which joint moves which bone, which channel which blend shape |
//! | `umo` | safe objects over the C interface |
//! | `ffi` | what `umo.h` declares, and the library, opened while the game runs |

mod avatar;
mod ffi;
mod rig;
mod source;
mod umo;
mod wave;

use godot::init::{ExtensionLibrary, gdextension};

struct UmoExtension;

// SAFETY: the crate's own condition, that Godot and no other calls the entry point.
#[gdextension]
unsafe impl ExtensionLibrary for UmoExtension {}
