//! Linker settings of the extension.

use std::env;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // On Apple's systems the library has an install name; the default is a path into the build folder.
    if env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "macos") {
        println!("cargo::rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libumo_godot.dylib");
    }
}
