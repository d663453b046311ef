//! The program as a user runs it: files in, files out, exit codes, and messages on standard
//! error.

#[path = "cli/program.rs"]
mod program;

#[path = "cli/animate.rs"]
mod animate;
#[path = "cli/batch.rs"]
mod batch;
#[path = "cli/bench.rs"]
mod bench;
#[path = "cli/converse.rs"]
mod converse;
#[path = "cli/draw.rs"]
mod draw;
#[path = "cli/outputs.rs"]
mod outputs;
#[path = "cli/recordings.rs"]
mod recordings;
#[path = "cli/refusals.rs"]
mod refusals;
#[path = "cli/retarget.rs"]
mod retarget;
#[path = "cli/stage.rs"]
mod stage;
#[path = "cli/take.rs"]
mod take;
#[path = "cli/view.rs"]
mod view;

use program::{Folder, umo};

#[test]
fn help_and_version_are_no_failure() {
    for args in [&["--help"][..], &["--version"], &["animate", "--help"], &["model", "stage", "-h"]] {
        let ended = umo(args).success();
        assert!(!ended.out.is_empty() && ended.err.is_empty(), "{args:?}");
    }
    assert!(umo(&["--version"]).out.starts_with("umo "));
    assert!(umo(&["model", "stage", "--help"]).out.contains("interp"));
    // Without a command the program prints its help on standard error.
    assert_eq!(umo(&[]).code, 2);
}

/// Lines of a help screen; none is wider than the screen.
fn help(args: &[&str]) -> Vec<String> {
    let lines: Vec<_> = umo(args).success().out.lines().map(str::to_owned).collect();
    lines.iter().for_each(|line| assert!(line.chars().count() <= 100, "{args:?}: {line}"));
    lines
}

#[test]
fn help_shows_nine_commands_and_then_the_others() {
    let lines = help(&["--help"]);
    let below = |heading: &str| -> Vec<String> {
        let rows = lines.iter().skip_while(|line| *line != heading).skip(1);
        let rows = rows.take_while(|line| line.starts_with("  "));
        rows.map(|line| line.split_whitespace().next().unwrap().to_owned()).collect()
    };
    let first = ["animate", "converse", "view", "live", "serve", "batch", "retarget", "text", "doctor"];
    assert_eq!(below("Commands:"), [&first[..], &["help"]].concat());
    assert_eq!(
        below("More commands:"),
        ["play", "score", "model", "bench", "inspect", "figure", "draw", "gestures", "words"]
    );
    assert!(lines.len() <= 30, "{}", lines.len());
    for name in first.into_iter().chain(["bench", "play"]) {
        assert!(help(&[name, "-h"]).len() <= 30, "{name}: {}", help(&[name, "-h"]).len());
    }
    let (short, long) = (help(&["animate", "-h"]).join("\n"), help(&["animate", "--help"]).join("\n"));
    for (word, is_short) in [("--seed", true), ("--smoothing", false), ("Tuning:", false), ("Testing:", false)] {
        assert!(long.contains(word) && short.contains(word) == is_short, "{word}");
    }
}

#[test]
fn an_old_name_is_refused_with_the_present_one() {
    for (old, now) in [
        (&["convert"][..], "model convert"),
        (&["quantize", "a", "-o", "b"], "model quantize"),
        (&["make-random"], "model random"),
        (&["stage", "encoder"], "model stage"),
    ] {
        let ended = umo(old);
        assert!(ended.code == 2 && ended.err.contains(now), "{old:?}: {}", ended.err);
    }
    let ended = umo(&["convrt"]);
    assert!(ended.code == 2 && !ended.err.contains("model"), "{}", ended.err);
}

#[test]
fn inspect_tells_sizes_tensors_and_config() {
    let folder = Folder::new();
    let tiny = folder.tiny("tiny.safetensors", &[]);
    let summary = umo(&["model", "inspect", &tiny]).success();
    for word in ["umo-tiny-random", "MIT OR Apache-2.0", "mel, 3 bands", "text_to_motion", "active", "lm ", "vq "] {
        assert!(summary.out.contains(word), "no `{word}` in {}", summary.out);
    }
    let row = |name: &str| -> Vec<usize> {
        let line = summary.out.lines().find(|line| line.starts_with(name)).expect("a row of the table");
        line.split_whitespace().skip(1).map(|n| n.parse().unwrap()).collect()
    };
    let (lm, all, file) = (row("lm "), row("all "), row("file "));
    assert!(lm[1] < lm[0], "one expert of four is active");
    assert!(lm[0] < all[0] && all[2] < file[0]);
    assert_eq!(file[0] as u64, std::fs::metadata(&tiny).unwrap().len());

    let tensors = umo(&["model", "inspect", &tiny, "--tensors"]).success();
    assert!(tensors.out.starts_with(&summary.out));
    assert!(tensors.out.lines().any(|line| line.starts_with("lm.shared.weight ") && line.contains("BF16")));

    let config = umo(&["model", "inspect", &tiny, "--config"]).success();
    let config: serde_json::Value = serde_json::from_str(&config.out).unwrap();
    assert_eq!(config["keyframe_stride"], 6);

    let built_in = umo(&["model", "inspect"]).success();
    assert!(built_in.out.contains("ARKit"));
}

#[test]
fn random_models_are_the_same_every_time() {
    let folder = Folder::new();
    let bytes = |name: &str, more: &[&str]| std::fs::read(folder.tiny(name, more)).unwrap();
    let first = bytes("a", &[]);
    assert_eq!(first, bytes("b", &["--seed", "0"]));
    assert_ne!(first, bytes("c", &["--seed", "1"]));
    let stored = ["f32", "bf16", "int8"].map(|store| bytes(store, &["--store", store]));
    assert_eq!(first, stored[1]);
    assert!(stored[0].len() > stored[1].len() && stored[1].len() > stored[2].len());
    assert!(folder.names().iter().all(|name| !name.contains("part")), "{:?}", folder.names());
}
