//! Takes: `umo animate -o x.umo`, and `umo play`.

use super::program::{Folder, golden, umo};

#[test]
fn a_take_plays_the_files_of_its_animation() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("frames_seven"));
    let (words, take) = (folder.file("words.txt", b"No! Never, you and I."), folder.at("motion.umo"));
    let (direct, played, glb) = (folder.at("direct.jsonl"), folder.at("played.jsonl"), folder.at("played.glb"));
    let made = ["animate", &speech, "--model", &model, "--words", &words, "--gesture", "wave@0.3,left", "--seed", "5"];
    umo(&[&made[..], &["-o", &take, "-o", &direct]].concat()).success();
    let ended = umo(&["play", &take, "--model", &model, "-o", &played, "-o", &glb]).success();
    assert!(ended.out.contains("16 frames") && ended.err.is_empty(), "{} {}", ended.out, ended.err);
    assert!(folder.read("direct.jsonl") == folder.read("played.jsonl"));
    assert!(folder.read("played.glb").starts_with(b"glTF"));
    // The same with other word rules says so.
    let ended = umo(&["play", &take, "--model", &model, "--language", "de", "-o", &played]).success();
    assert!(ended.err.contains("other word rules"), "{}", ended.err);
}

/// A gesture of a file is the host's: the take has its name alone.
#[test]
fn a_take_needs_the_gestures_of_its_host() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("frames_seven"));
    let (take, first) = (folder.at("motion.umo"), folder.at("first.jsonl"));
    umo(&["animate", &speech, "--model", &model, "-o", &first]).success();
    let clip = format!("bob={first},0.3,head");
    let (direct, played) = (folder.at("direct.jsonl"), folder.at("played.jsonl"));
    let own = ["--gesture-clip", &clip];
    umo(&[&["animate", &speech, "--model", &model, "--gesture", "bob", "-o", &take, "-o", &direct][..], &own].concat())
        .success();
    let line = folder.refused(&["play", &take, "--model", &model, "-o", &played]);
    assert!(line.contains("motion.umo") && line.contains("gesture `bob` at frame 0: unknown gesture"), "{line}");
    umo(&[&["play", &take, "--model", &model, "-o", &played][..], &own].concat()).success();
    assert!(folder.read("direct.jsonl") == folder.read("played.jsonl"));
}

#[test]
fn what_cannot_be_a_take_is_refused() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("frames_seven"));
    let (take, out) = (folder.at("motion.umo"), folder.at("out.jsonl"));
    umo(&["animate", &speech, "--model", &model, "-o", &take]).success();
    let bytes = folder.read("motion.umo");
    let cut = folder.file("cut.umo", &bytes[..bytes.len() - 1]);
    let other = golden("mel_k2_arkit");
    for (args, words) in [
        (&["play", &take, "--model", &other, "-o", &out][..], ["motion.umo", "another model"]),
        (&["play", &speech, "--model", &model, "-o", &out], ["speech.wav", "not a take"]),
        (&["play", &cut, "--model", &model, "-o", &out], ["cut.umo", "damaged"]),
        (&["animate", &speech, "--model", &model, "--retime", "-o", &take], ["--retime", "take"]),
    ] {
        let line = folder.refused(args);
        assert!(words.iter().all(|word| line.contains(word)), "{line}");
    }
}
