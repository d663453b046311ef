//! Output locations, and files left by an aborted run.

use std::process::{Command, Stdio};

use super::program::{Folder, golden, umo, voice};

fn program(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_umo"));
    command.args(args);
    command
}

/// Names may have 255 bytes.
#[test]
fn long_names_are_written() {
    let (folder, model) = (Folder::new(), golden("mel_k2_arkit"));
    let speech = folder.speech();
    for name in ["\u{5b57}".repeat(80) + ".jsonl", "a".repeat(249) + ".jsonl"] {
        umo(&["animate", &speech, "--model", &model, "-o", &folder.at(&name)]).success();
        assert!(!folder.read(&name).is_empty());
    }
    assert_eq!(folder.names().len(), 3, "{:?}", folder.names());
}

/// A reader that closes the pipe wants no more output.
#[test]
fn a_closed_pipe_is_no_failure() {
    let folder = Folder::new();
    let (model, speech, out) = (folder.tiny("tiny.safetensors", &[]), folder.speech(), folder.at("o.jsonl"));
    for args in [
        &["gestures"][..],
        &["--help"],
        &["model", "inspect", &model, "--tensors"],
        &["animate", &speech, "--model", &model, "-o", &out, "--timings"],
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let ended = program(args).stdout(writer).stderr(Stdio::piped()).output().unwrap();
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(0), "{args:?}: {said}");
        assert!(said.lines().all(|line| line.starts_with("note:")), "{args:?}: {said}");
    }
    // The reader of standard error is gone too.
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let ended = program(&["model", "inspect", "missing"]).stderr(writer).status().unwrap();
    assert_eq!(ended.code(), Some(2));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_behind_standard_output_is_one_line() {
    for args in [&["gestures"][..], &["--help"], &["model", "inspect"]] {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let ended = program(args).stdout(full).stderr(Stdio::piped()).output().unwrap();
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(1), "{args:?}: {said}");
        let errors: Vec<_> = said.lines().filter(|line| !line.starts_with("note:")).collect();
        assert!(
            errors.len() == 1 && errors[0].starts_with("error: cannot write to standard output"),
            "{args:?}: {said}"
        );
    }
}

/// Ctrl-C, SIGTERM and a closed terminal leave the previous file and nothing else.
#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_ended_leaves_nothing() {
    let folder = Folder::new();
    let speech = folder.wav("long.wav", &voice(16_000 * 1200));
    let out = folder.file("o.glb", b"before");
    let mut before = folder.names();
    before.sort();
    for (signal, number) in [("INT", 2), ("TERM", 15), ("HUP", 1)] {
        // As from a terminal, however the tests were started.
        let mut command = Command::new("env");
        command.arg("--default-signal").args([env!("CARGO_BIN_EXE_umo"), "animate", &speech, "-o", &out]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        while !folder.names().iter().any(|name| name.ends_with(".part")) {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it was told to");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let told = Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status().unwrap();
        assert!(told.success());
        assert_eq!(child.wait().unwrap().code(), Some(128 + number), "{signal}");
        assert_eq!((folder.names(), folder.read("o.glb")), (before.clone(), b"before".to_vec()), "{signal}");
    }
}

/// Signals that were ignored at the start, as by `nohup`, stay ignored.
#[cfg(target_os = "linux")]
#[test]
fn signals_that_are_ignored_end_nothing() {
    let folder = Folder::new();
    let (model, speech) = (golden("mel_k2_arkit"), folder.wav("long.wav", &voice(16_000 * 60)));
    let out = folder.at("o.jsonl");
    let mut command = Command::new("env");
    command.arg("--ignore-signal=HUP").args([env!("CARGO_BIN_EXE_umo"), "animate", &speech, "-o", &out]);
    let mut child = command.args(["--model", &model]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    while !folder.names().iter().any(|name| name.ends_with(".part") || name == "o.jsonl") {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let _ = Command::new("kill").args(["-HUP", &child.id().to_string()]).stderr(Stdio::null()).status().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(!folder.read("o.jsonl").is_empty());
}

#[test]
fn an_input_is_no_output() {
    let (folder, model) = (Folder::new(), golden("mel_k2_arkit"));
    let speech = folder.speech();
    let recording = folder.read("speech.wav");
    #[cfg(unix)]
    std::os::unix::fs::symlink(&speech, folder.at("link.wav")).unwrap();
    #[cfg(not(unix))]
    std::fs::copy(&speech, folder.at("link.wav")).unwrap();
    let indirect = folder.at("./speech.wav");
    let animation = folder.at("o.jsonl");
    umo(&["animate", &speech, "--model", &model, "-o", &animation]).success();
    for args in [
        &["animate", &speech, "-o", &speech, "--format", "jsonl"][..],
        &["animate", &speech, "-o", &folder.at("b.jsonl"), "-o", &indirect, "--format", "jsonl"],
        #[cfg(unix)]
        &["animate", &folder.at("link.wav"), "-o", &speech, "--format", "jsonl"],
        &["animate", &speech, "--start-pose", &animation, "-o", &animation],
        &["animate", &speech, "--gesture-clip", &format!("mine={animation},1.0"), "-o", &animation],
        &["retarget", &animation, "--onto", &animation, "-o", &animation],
        &["draw", &animation, "-o", &animation],
        &["view", &animation, "--no-open", "-o", &animation],
        &["model", "quantize", &speech, "-o", &speech, "--weights", "int8"],
    ] {
        let line = folder.refused(args);
        assert!(line.contains("is an input and an output"), "{args:?}: {line}");
    }
    assert!(folder.read("speech.wav") == recording);
    // The same for a manifest's outputs, including its results file.
    folder.file("lines.jsonl", br#"{"file": "speech.wav", "output": "lines.jsonl"}"#);
    assert!(folder.refused(&["batch", &folder.at("lines.jsonl")]).contains("is an input and an output"));
    folder.file("results.jsonl", br#"{"file": "speech.wav"}"#);
    assert!(folder.refused(&["batch", &folder.at("results.jsonl")]).contains("is an input and an output"));
}

#[test]
fn standard_output_is_no_output() {
    let folder = Folder::new();
    let speech = folder.speech();
    for args in [&["animate", &speech, "-o", "-", "--format", "jsonl"][..], &["batch", &speech, "-o", "-"]] {
        assert!(folder.refused(args).contains("standard output"), "{args:?}");
    }
}

#[test]
fn outputs_of_a_manifest_stay_in_their_folder() {
    let folder = Folder::new();
    folder.speech();
    let (manifest, out) = (folder.at("lines.csv"), folder.at("out/deep"));
    let elsewhere = folder.at("x.jsonl");
    for name in ["../x.jsonl", "a/../../x.jsonl", "a.jsonl;../../x.jsonl", &elsewhere] {
        folder.file("lines.csv", format!("file,output\nspeech.wav,{name}\n").as_bytes());
        for more in [&["-o", &*out][..], &[]] {
            let line = folder.refused(&[&["batch", &manifest], more].concat());
            assert!(line.contains("line 1") && line.contains("outside"), "{line}");
        }
    }
    folder.file("lines.csv", b"file,output\nspeech.wav,a/../b/x.jsonl\n");
    umo(&["batch", &manifest, "-o", &out, "--model", &golden("mel_k2_arkit")]).success();
    assert!(!folder.read("out/deep/b/x.jsonl").is_empty());
}

#[test]
fn a_prompt_that_the_model_does_not_know_is_said() {
    let folder = Folder::new();
    let (speech, out) = (folder.speech(), folder.at("o.jsonl"));
    let said = |prompt: &str| umo(&["animate", &speech, "--prompt", prompt, "-o", &out]).success().err;
    let note = said("qwerty");
    assert!(
        note.starts_with("note: ")
            && note.contains("`qwerty`")
            && note.contains("talking")
            && note.lines().count() == 1,
        "{note}"
    );
    assert_eq!(said("Calm"), "");
}
