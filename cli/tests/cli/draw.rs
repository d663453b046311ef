//! `umo draw`: pictures of the figure.

use super::program::{Folder, golden, umo};

/// Width and height of a PNG file.
fn size(bytes: &[u8]) -> [u32; 2] {
    assert!(bytes.starts_with(b"\x89PNG\r\n\x1a\n"));
    [16, 20].map(|at| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()))
}

fn animated(folder: &Folder) -> String {
    let (speech, out) = (folder.speech(), folder.at("motion.jsonl"));
    umo(&["animate", &speech, "--model", &golden("mel_k2_arkit"), "-o", &out]).success();
    out
}

#[test]
fn frames_of_an_animation_stand_beside_one_another() {
    let folder = Folder::new();
    let (motion, out) = (animated(&folder), folder.at("out.png"));
    let draw = |more: &[&str]| {
        umo(&[&["draw", &motion, "-o", &out, "--width", "60", "--height", "80"], more].concat()).success();
        folder.read("out.png")
    };
    let first = draw(&["--at", "0"]);
    assert_eq!(size(&first), [60, 80]);
    assert_eq!(size(&draw(&["--at", "0", "--at", "0.2", "--at", "0.4"])), [180, 80]);
    assert_eq!(first, draw(&[]), "the first frame where no time is given");
    for view in ["three-quarter", "side", "back", "bust", "face"] {
        assert!(draw(&["--view", view]) != first, "{view} is another picture");
    }
}

#[test]
fn without_an_animation_every_shape_is_drawn() {
    let folder = Folder::new();
    umo(&["draw", "-o", &folder.at("shapes.png")]).success();
    let bytes = folder.read("shapes.png");
    assert!(size(&bytes).iter().all(|&side| side > 900));
    assert!(bytes.len() < 400_000, "{} bytes", bytes.len());
}

#[test]
fn draw_refuses_what_it_cannot_draw() {
    let folder = Folder::new();
    let (motion, out) = (animated(&folder), folder.at("out.png"));
    assert!(folder.refused(&["draw", &motion, "-o", &out, "--at", "9"]).contains("--at 9"));
    assert!(folder.refused(&["draw", &folder.at("none.jsonl"), "-o", &out]).contains("none.jsonl"));
    let broken = folder.file("broken.jsonl", b"{}");
    assert!(folder.refused(&["draw", &broken, "-o", &out]).contains("line 1"));
}
