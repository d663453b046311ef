//! Writes `include/umo.h` and the generated files of the bindings: `cargo run --release -p umo-capi --example header`.

#[path = "../header/generate.rs"]
mod generate;

fn main() -> std::io::Result<()> {
    generate::files().iter().try_for_each(generate::File::write)
}
