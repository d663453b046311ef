//! Puts the default model into the program where `UMO_EMBED_MODEL` names its file, as the
//! repository's `.cargo/config.toml` does. Without it the program looks for an installed one.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=UMO_EMBED_MODEL");
    println!("cargo::rustc-check-cfg=cfg(umo_embedded_model)");
    let Ok(path) = std::env::var("UMO_EMBED_MODEL") else { return };
    if !path.is_empty() {
        assert!(
            std::path::Path::new(&path).is_file(),
            "{path} is missing: run scripts/build/fetch-model, or build without a model in the program: UMO_EMBED_MODEL="
        );
        println!("cargo::rerun-if-changed={path}");
        println!("cargo::rustc-cfg=umo_embedded_model");
        println!("cargo::rustc-env=UMO_EMBED_MODEL={path}");
    }
}
