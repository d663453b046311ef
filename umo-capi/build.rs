//! The name by which programs look up the shared library contains its major version, so that an incompatible one is not
//! loaded.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let major = std::env::var("CARGO_PKG_VERSION_MAJOR").expect("cargo sets it");
    match std::env::var("CARGO_CFG_TARGET_OS").expect("cargo sets it").as_str() {
        // Applications bundle their libraries there, without a version in the name.
        "android" => println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libumo.so"),
        "linux" | "freebsd" => {
            println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libumo.so.{major}");
        }
        "macos" | "ios" => println!("cargo::rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libumo.{major}.dylib"),
        // The polled mode computes on the caller's stack and needs 1 MiB of it (`umo_engine_poll`).
        "unknown" => println!("cargo::rustc-cdylib-link-arg=-zstack-size=2097152"),
        _ => {}
    }
}
