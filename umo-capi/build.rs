//! The name under which programs look the shared library up: its major version, so that an
//! incompatible one is not taken for this.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let major = std::env::var("CARGO_PKG_VERSION_MAJOR").expect("cargo sets it");
    match std::env::var("CARGO_CFG_TARGET_OS").expect("cargo sets it").as_str() {
        // What an application holds there has no version in its name.
        "android" => println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libumo.so"),
        "linux" | "freebsd" => {
            println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libumo.so.{major}");
        }
        "macos" | "ios" => println!("cargo::rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libumo.{major}.dylib"),
        // The polled mode computes on the caller's stack, of which it needs 1 MiB (`umo_engine_poll`).
        "unknown" => println!("cargo::rustc-cdylib-link-arg=-zstack-size=2097152"),
        _ => {}
    }
}
