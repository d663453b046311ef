//! `umo view`: the pages that it writes, and what it refuses. What they show is tested in a browser
//! (`scripts/test-page`).

use super::program::{Ended, Folder, golden, umo};

fn view(args: &[&str]) -> Ended {
    umo(&[&["view", "--no-open", "--model", &golden("mel_k2_arkit")], args].concat())
}

#[test]
fn page_is_written_beside_its_recording() {
    let folder = Folder::new();
    let speech = folder.speech();
    let ended = view(&[&speech]).success();
    assert!(ended.out.contains("speech.html: 16 frames"), "{}", ended.out);
    let page = String::from_utf8(folder.read("speech.html")).unwrap();
    assert!(page.starts_with("<!doctype html>") && page.contains("<title>speech.wav"));
    assert!(page.contains("\"record\":{") && page.contains("id=\"block-audio\""));
    assert_eq!(folder.names(), ["speech.html", "speech.wav"]);
    view(&[&speech, "-o", &folder.at("again.html"), "--seed", "0"]).success();
    assert_eq!(folder.read("again.html"), page.as_bytes(), "the same seed gives the same page");
}

#[test]
fn parts_and_levels_of_a_model_are_named() {
    let folder = Folder::new();
    let speech = folder.speech();
    for (model, wanted) in [
        ("mel_k2_arkit", r#""parts":[{"name":"face","levels":1,"codes":256},{"name":"hands""#),
        ("frames_seven", r#""parts":[{"name":"intent","levels":1,"codes":4},{"name":"torso","levels":3,"codes":11},"#),
    ] {
        umo(&["view", "--no-open", &speech, "-o", &folder.at("page.html"), "--model", &golden(model)]).success();
        let page = String::from_utf8(folder.read("page.html")).unwrap();
        assert!(
            page.contains(wanted),
            "{model}: {}",
            page.split("\"record\":").nth(1).unwrap_or("no record").split("<").next().unwrap()
        );
        let kinds = if model == "frames_seven" { r#""history","chunk"]"# } else { r#""upper","lower"]"# };
        let every = if model == "frames_seven" { r#""every":6"# } else { r#""every":1"# };
        assert!(page.contains(kinds) && page.contains(every), "{model}");
    }
}

#[test]
fn animations_that_were_made_before_have_pages() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("mel_k2_arkit"));
    for format in ["npz", "glb", "jsonl"] {
        let (motion, page) = (folder.at(&format!("motion.{format}")), folder.at("page.html"));
        umo(&["animate", &speech, "--model", &model, "-o", &motion]).success();
        view(&[&motion, "-o", &page]).success();
        let silent = String::from_utf8(folder.read("page.html")).unwrap();
        assert!(silent.contains("\"record\":null") && silent.contains("\"audio\":null"), "{format}");
        view(&[&motion, "-o", &page, "--audio", &speech]).success();
        assert!(folder.read("page.html").len() > silent.len(), "{format}");
    }
}

#[test]
fn what_cannot_be_viewed_is_refused() {
    let folder = Folder::new();
    let speech = folder.speech();
    let refused = |args: &[&str]| folder.refused(&[&["view", "--no-open"], args].concat());
    assert!(refused(&[&folder.at("missing.wav")]).contains("no such file"));
    assert!(refused(&[&folder.at("missing.npz")]).contains("missing.npz"));
    assert!(refused(&[&speech, "-o", &folder.at("missing/page.html")]).contains("missing/page.html"));
    assert!(refused(&[&speech, "--audio", &speech]).contains("its own audio"));
    assert!(refused(&[&folder.file("text.glb", b"no motion")]).contains("text.glb"));
    assert!(refused(&[&folder.file("text.npz", b"no motion")]).contains("text.npz"));
    assert!(refused(&[&folder.file("text.jsonl", b"no motion")]).contains("text.jsonl"));
    assert!(refused(&["--live", "--start-pose", "x.npz"]).contains("--start-pose"));
    for args in [&["view"][..], &["view", &speech, "--port", "80"], &["view", "--live", &speech, "-o", "x.html"]] {
        assert_eq!(umo(args).code, 2, "{args:?}");
    }
}

#[test]
fn a_port_that_is_taken_is_the_machines_fault() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let ended = view(&["--live", "--port", &port]);
    assert_eq!(ended.code, 1, "{}", ended.err);
    assert!(ended.err.contains(&port), "{}", ended.err);
}
