//! umo for Godot 4: the node [`UmoAvatar3D`](avatar::UmoAvatar3D), which moves a skeleton and blend
//! shapes to the sound of an audio player, and [`UmoScene3D`](scene::UmoScene3D), by which such nodes know each other. All of the work is done by umo, behind its C interface.
//!
//! | module | contents |
//! |---|---|
//! | `avatar` | the node: properties, methods, signals, and the clock from sound to motion |
//! | `scene` | the node of a scene: members, their places and targets |
//! | `source` | samples of an audio player |
//! | `wave` | decoder for the data of an `AudioStreamWAV` |
//! | `body` | meshes of a skeleton at rest, and poses with their volume |
//! | `rig` | mapping of joints to bones and of channels to blend shapes |
//! | `umo` | safe objects over the C interface |
//! | `ffi` | the declarations of `umo.h`, and the library, opened while the game runs |

mod avatar;
mod body;
mod ffi;
mod rig;
mod scene;
mod source;
mod umo;
mod wave;

use godot::init::{ExtensionLibrary, gdextension};

struct UmoExtension;

// SAFETY: required by the crate: only Godot calls the entry point.
#[gdextension]
unsafe impl ExtensionLibrary for UmoExtension {}
