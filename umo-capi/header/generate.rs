//! Generates `umo.h` from the sources.

/// Path of the checked-in header.
pub(crate) const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../include/umo.h");

/// The generated header.
pub(crate) fn header() -> String {
    let folder = env!("CARGO_MANIFEST_DIR");
    let mut config = cbindgen::Config::from_file(format!("{folder}/cbindgen.toml")).expect("cbindgen.toml is a config");
    config.header = Some(include_str!("head.h").trim_end().to_owned());
    config.after_includes = Some(format!("\n{}", include_str!("macros.h").trim_end()));
    // cbindgen finds the other modules from there.
    let builder = cbindgen::Builder::new().with_config(config).with_src(format!("{folder}/src/lib.rs"));
    let mut text = Vec::new();
    builder.generate().expect("the sources parse").write(&mut text);
    let text = String::from_utf8(text).expect("sources are UTF-8");
    // Rust's safety sections are about pointers in C.
    text.replace("// # Safety\n", "// Pointers:\n").replace("[`", "`").replace("`]", "`")
}
