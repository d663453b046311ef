//! Text of `umo.h`, and of the files of the bindings that repeat its constants and structures.

mod c;
mod csharp;
mod godot;
mod interface;
mod parse;
mod python;
mod unreal;
mod web;

/// Root of the repository.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// First line of every generated file, as its language comments.
const NOTICE: &str = "Generated from umo-capi/src by umo-capi/header: change it there.";

/// A generated file.
pub(crate) struct File {
    /// Path in the repository.
    name: &'static str,
    /// Wanted text.
    text: String,
}

impl File {
    /// The line at which the repository's file differs; none if it is up to date.
    // Each of the two programs that include this module uses one of these functions.
    #[allow(dead_code, reason = "used by the test")]
    pub(crate) fn difference(&self) -> Option<String> {
        let kept = std::fs::read_to_string(format!("{ROOT}/{}", self.name)).unwrap_or_default();
        let same = kept.lines().zip(self.text.lines()).take_while(|(kept, wanted)| kept == wanted).count();
        (kept != self.text).then(|| format!("{}:{}", self.name, same + 1))
    }

    #[allow(dead_code, reason = "used by the program")]
    pub(crate) fn write(&self) -> std::io::Result<()> {
        std::fs::write(format!("{ROOT}/{}", self.name), &self.text)
    }
}

/// All generated files.
pub(crate) fn files() -> Vec<File> {
    let header = header();
    let interface = parse::parse(&header);
    let file = |name, text| File { name, text };
    vec![
        file("tests/capi/generated.h", c::layouts(&interface)),
        file("bindings/python/src/umo/_generated.py", python::module(&interface)),
        file("bindings/unity/Runtime/Native/Generated.cs", csharp::native(&interface)),
        file("bindings/unity/Runtime/UmoRuntime.Generated.cs", csharp::runtime(&interface)),
        file("bindings/godot/src/ffi/generated.rs", godot::module(&interface)),
        file("bindings/web/src/generated.js", web::module(&interface)),
        file("bindings/web/src/generated.d.ts", web::types(&interface)),
        file("bindings/unreal/Source/Umo/Public/UmoEngineSettings.h", unreal::settings(&interface)),
        file("include/umo.h", header),
    ]
}

/// Text of `umo.h`.
fn header() -> String {
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
