//! How the extension is linked.

use std::env;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Apple's libraries have a name of their own, which is the folder of the build where none is given.
    if env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "macos") {
        println!("cargo::rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libumo_godot.dylib");
    }
}
