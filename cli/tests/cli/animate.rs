//! `umo animate` and `umo text` where all is well.

use super::program::{Folder, golden, umo, voice};

/// `speech.wav` of [`Folder::speech`] in frames: 9000 samples.
const FRAMES: usize = 16;

fn lines(bytes: &[u8]) -> usize {
    String::from_utf8(bytes.to_vec()).unwrap().lines().count()
}

/// Writes every format and returns the files' bytes.
fn animate(folder: &Folder, name: &str, more: &[&str]) -> Vec<Vec<u8>> {
    let (speech, model) = (folder.speech(), golden("mel_k2_arkit"));
    let names = ["npz", "bvh", "glb", "csv", "jsonl"].map(|format| format!("{name}.{format}"));
    let paths: Vec<_> = names.iter().map(|name| folder.at(name)).collect();
    let mut args = vec!["animate", &speech, "--model", &model];
    args.extend(paths.iter().flat_map(|path| ["-o", path]));
    let ended = umo(&[&args[..], more].concat()).success();
    assert!(ended.out.contains(&format!("{FRAMES} frames")), "{}", ended.out);
    names.iter().map(|name| folder.read(name)).collect()
}

#[test]
fn one_run_writes_every_format() {
    let folder = Folder::new();
    let files = animate(&folder, "all", &[]);
    assert!(files[0].starts_with(b"PK"));
    assert!(files[1].starts_with(b"HIERARCHY"));
    assert!(String::from_utf8(files[1].clone()).unwrap().contains(&format!("Frames: {FRAMES}")));
    assert!(files[2].starts_with(b"glTF"));
    assert_eq!(lines(&files[3]), FRAMES + 1, "a heading and a line for each frame");
    let frames = String::from_utf8(files[4].clone()).unwrap();
    let frames: Vec<serde_json::Value> = frames.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(frames.len() >= FRAMES);
    let names = folder.names();
    assert_eq!(names, ["all.bvh", "all.csv", "all.glb", "all.jsonl", "all.npz", "speech.wav"]);
}

#[test]
fn the_same_seed_gives_the_same_files() {
    let folder = Folder::new();
    let first = animate(&folder, "a", &["--seed", "3", "--threads", "1"]);
    assert!(first == animate(&folder, "b", &["--seed", "3", "--threads", "3"]));
    for (file, other) in first.iter().zip(animate(&folder, "c", &["--seed", "4", "--threads", "1"])) {
        assert!(*file != other);
    }
    let greedy = animate(&folder, "d", &["--greedy"]);
    assert!(greedy != first && greedy == animate(&folder, "e", &["--greedy"]));
}

#[test]
fn the_format_may_be_told() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("mel_k2_arkit"));
    let (dat, jsonl) = (folder.at("motion.dat"), folder.at("motion.jsonl"));
    umo(&["animate", &speech, "--model", &model, "--format", "JSONL", "-o", &dat]).success();
    umo(&["animate", &speech, "--model", &model, "-o", &jsonl]).success();
    assert_eq!(folder.read("motion.dat"), folder.read("motion.jsonl"));
}

#[test]
fn an_earlier_file_is_replaced() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("mel_k2_arkit"));
    let out = folder.file("motion.bvh", b"an earlier motion");
    umo(&["animate", &speech, "--model", &model, "-o", &out]).success();
    assert!(folder.read("motion.bvh").starts_with(b"HIERARCHY"));
}

#[test]
fn a_start_pose_changes_what_follows() {
    let folder = Folder::new();
    animate(&folder, "first", &["--seed", "5"]);
    let start = folder.at("first.npz");
    let plain = animate(&folder, "plain", &["--greedy"]);
    let next = animate(&folder, "next", &["--greedy", "--start-pose", &start]);
    assert!(plain != next);
    assert!(next == animate(&folder, "again", &["--greedy", "--start-pose", &start]));
}

#[test]
fn a_prompt_changes_what_follows() {
    let folder = Folder::new();
    let plain = animate(&folder, "plain", &["--seed", "1"]);
    assert!(plain != animate(&folder, "told", &["--seed", "1", "--prompt", "wave with both hands, happily"]));
}

#[test]
fn chunks_lookahead_and_precision_may_be_told() {
    let folder = Folder::new();
    for precision in ["f32", "bf16", "int8"] {
        for (target, lookahead) in [("1", "0"), ("7", "42"), ("3", "9")] {
            let more = ["--precision", precision, "--target", target, "--lookahead", lookahead];
            assert_eq!(lines(&animate(&folder, "motion", &more)[3]), FRAMES + 1);
        }
    }
}

#[test]
fn the_models_default_size_and_stores_move() {
    let folder = Folder::new();
    let speech = folder.speech();
    for store in ["f32", "bf16", "int8"] {
        let (model, out) = (folder.tiny(store, &["--store", store]), folder.at("motion.npz"));
        let ended = umo(&["animate", &speech, "--model", &model, "-o", &out]).success();
        assert!(ended.err.contains("note: untrained model"), "{}", ended.err);
    }
}

#[test]
fn whole_file_units_are_compared_with_the_streams() {
    let folder = Folder::new();
    let (speech, out) = (folder.speech(), folder.at("motion.bvh"));
    for (model, equal) in [("mel_k2_arkit", true), ("hubert_k1_smplx", false)] {
        let ended = umo(&["animate", &speech, "--whole-file-units", "--model", &golden(model), "-o", &out]).success();
        let note = ended.err.lines().find(|line| line.starts_with("note:")).expect("a note");
        assert!(note.contains("of 29 audio units"), "{note}");
        assert!(!equal || note.starts_with("note: 0 of"), "{note}");
    }
}

#[test]
fn samples_that_are_no_numbers_are_refused_or_repaired() {
    let folder = Folder::new();
    let mut samples = voice(9000);
    (samples[100], samples[200], samples[300]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
    let (speech, out) = (folder.wav("nan.wav", &samples), folder.at("motion.csv"));
    let model = golden("mel_k2_arkit");
    damaged(&folder, &["animate", &speech, "--model", &model, "-o", &out], "3 samples");
    assert_eq!(lines(&folder.read("motion.csv")), FRAMES + 1);
}

#[test]
fn a_recording_that_was_cut_is_refused_or_repaired() {
    let folder = Folder::new();
    let speech = folder.speech();
    let bytes = folder.read("speech.wav");
    std::fs::write(&speech, &bytes[..bytes.len() - 4 * 4500]).unwrap();
    let (out, model) = (folder.at("motion.csv"), golden("mel_k2_arkit"));
    damaged(&folder, &["animate", &speech, "--model", &model, "-o", &out], "claims");
    assert_eq!(lines(&folder.read("motion.csv")), FRAMES / 2 + 1);
}

/// Refused with `problem`, and with `--repair` done with a warning of it.
fn damaged(folder: &Folder, args: &[&str], problem: &str) {
    let refused = folder.refused(args);
    assert!(refused.contains(problem) && refused.contains("--repair"), "{refused}");
    let repaired = umo(&[args, &["--repair"]].concat()).success();
    assert!(repaired.err.starts_with("warning: ") && repaired.err.contains(problem), "{}", repaired.err);
}

#[test]
fn text_becomes_motion_of_the_length_asked_for() {
    let folder = Folder::new();
    let model = golden("mel_k2_arkit");
    let text = |words: &str, seconds: &str, name: &str| {
        let out = folder.at(name);
        umo(&["text", words, "--seconds", seconds, "--model", &model, "-o", &out]).success();
        folder.read(name)
    };
    let wave = text("a person waves", "1.25", "wave.csv");
    assert_eq!(lines(&wave), 37 + 1);
    assert!(wave == text("a person waves", "1.25", "again.csv"));
    assert!(wave != text("turn left and walk", "1.25", "turn.csv"));
    assert_eq!(lines(&text("a", "0.001", "short.csv")), 1 + 1);
}

#[test]
fn the_first_command_needs_no_model() {
    let folder = Folder::new();
    let (speech, out) = (folder.speech(), folder.at("hello.glb"));
    umo(&["animate", &speech, "-o", &out]).success();
    assert!(folder.read("hello.glb").starts_with(b"glTF"));
}
