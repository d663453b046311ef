//! The header in the repository is the one that the sources say.

#[path = "../header/generate.rs"]
mod generate;

#[test]
fn header_is_current() {
    let kept = std::fs::read_to_string(generate::PATH).expect("include/umo.h is there");
    // Not compared by an assertion: the texts are long.
    let differs = kept.lines().zip(generate::header().lines()).position(|(kept, wanted)| kept != wanted);
    let same = kept == generate::header();
    assert!(same, "include/umo.h differs at line {differs:?}: run `cargo run -p umo-capi --example header`");
}
