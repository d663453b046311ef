//! The generated files in the repository are those that the sources say.

#[path = "../header/generate.rs"]
mod generate;

#[test]
fn generated_files_are_current() {
    let differences: Vec<_> = generate::files().iter().filter_map(generate::File::difference).collect();
    let command = "cargo run --release -p umo-capi --example header";
    assert!(differences.is_empty(), "{} differ: run `{command}`", differences.join(", "));
}
