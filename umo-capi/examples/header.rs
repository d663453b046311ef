//! Writes `include/umo.h`: `cargo run -p umo-capi --example header`.

#[path = "../header/generate.rs"]
mod generate;

fn main() -> std::io::Result<()> {
    std::fs::write(generate::PATH, generate::header())
}
