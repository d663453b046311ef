//! `umo batch`: folders and manifests, resuming, failures, shards, and the bits of single runs.

use std::collections::BTreeMap;

use super::program::{Folder, golden, umo, voice};

/// Results by recording name.
fn results(bytes: &[u8]) -> BTreeMap<String, serde_json::Value> {
    let text = String::from_utf8(bytes.to_vec()).unwrap();
    let lines = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    lines.map(|line| (line["file"].as_str().unwrap().rsplit(['/', '\\']).next().unwrap().to_owned(), line)).collect()
}

#[test]
fn a_folder_is_animated_and_what_is_done_is_kept() {
    let (folder, model) = (Folder::new(), golden("mel_k2_arkit"));
    let speech = folder.speech();
    let bytes = std::fs::read(&speech).unwrap();
    std::fs::create_dir_all(folder.at("lines/deep")).unwrap();
    for name in ["lines/a.wav", "lines/deep/b.wav", "lines/c.WAV"] {
        std::fs::write(folder.at(name), &bytes).unwrap();
    }
    std::fs::write(folder.at("lines/notes.txt"), "no recording").unwrap();
    for name in ["hello.flac", "hello.mp3", "hello.ogg", "hello.opus", "hello.m4a"] {
        let from = format!("{}/../audio-file/test-files/{name}", env!("CARGO_MANIFEST_DIR"));
        std::fs::copy(from, folder.at(&format!("lines/{}-{name}", &name[6..]))).unwrap();
    }
    let (lines, out) = (folder.at("lines"), folder.at("out"));
    let batch = ["batch", &lines, "-o", &out, "--model", &model, "--format", "jsonl,csv", "--jobs", "3"];
    let ended = umo(&batch).success();
    assert!(ended.out.contains("8 made, 0 kept, 0 failed"), "{}", ended.out);
    // The bits of single runs.
    for recording in
        ["a.wav", "deep/b.wav", "flac-hello.flac", "mp3-hello.mp3", "ogg-hello.ogg", "opus-hello.opus", "m4a-hello.m4a"]
    {
        let (alone, name) = (folder.at("alone.jsonl"), recording.split_once('.').unwrap().0);
        umo(&["animate", &folder.at(&format!("lines/{recording}")), "--model", &model, "-o", &alone]).success();
        assert!(folder.read("alone.jsonl") == folder.read(&format!("out/{name}.jsonl")), "{name}");
    }
    let first = folder.read("out/results.jsonl");
    let done = results(&first);
    assert_eq!(done.len(), 8);
    assert_eq!(done["a.wav"]["frames"], 16);
    assert_eq!(done["a.wav"]["outputs"].as_array().unwrap().len(), 2);
    assert_eq!(done["a.wav"]["outputs"][0]["sha256"].as_str().unwrap().len(), 64);

    // A second run has nothing to do. A new date is not new content; changed bytes are.
    let ended = umo(&batch).success();
    assert!(ended.out.contains("0 made, 8 kept, 0 failed"), "{}", ended.out);
    assert!(folder.read("out/results.jsonl") == first);
    std::fs::write(folder.at("lines/a.wav"), &bytes).unwrap();
    std::fs::write(folder.at("out/deep/b.csv"), "changed").unwrap();
    let ended = umo(&batch).success();
    assert!(ended.out.contains("1 made, 7 kept, 0 failed"), "{}", ended.out);
    assert!(folder.read("out/deep/b.csv").starts_with(b"Timecode"));
    let ended = umo(&[&batch[..], &["--seed", "7"]].concat()).success();
    assert!(ended.out.contains("8 made, 0 kept, 0 failed"), "{}", ended.out);
}

#[test]
fn manifests_say_how_each_line_is_made() {
    let (folder, model) = (Folder::new(), golden("mel_k2_arkit"));
    folder.speech();
    folder.file(
        "lines.csv",
        b"file,output,seed,mood,speaker\n\
          speech.wav,a.jsonl;a.bvh,5,,\n\
          speech.wav,b.jsonl,,joy=0.5,ada\n\
          speech.wav,c.jsonl,,joy=0.5,ada\n\
          speech.wav,d.jsonl,,,bob\n\
          missing.wav,e.jsonl,,,\n",
    );
    folder.file("broken.wav", b"RIFF");
    let rows = [
        r#"{"file": "speech.wav", "output": ["a.jsonl", "a.bvh"], "seed": 5}"#,
        "",
        r#"{"file": "speech.wav", "output": "b.jsonl", "mood": "joy=0.5", "speaker": "ada"}"#,
        r#"{"file": "broken.wav"}"#,
    ];
    folder.file("lines.jsonl", rows.join("\n").as_bytes());
    let run = |manifest: &str, out: &str, more: &[&str]| {
        let (manifest, out) = (folder.at(manifest), folder.at(out));
        umo(&[&["batch", &manifest, "-o", &out, "--model", &model, "--format", "npz"], more].concat())
    };
    let ended = run("lines.csv", "csv", &[]);
    // The others are done, and the failure is named.
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("missing.wav") && ended.err.contains("1 of 5 lines failed"), "{}", ended.err);
    assert!(ended.out.contains("4 made, 0 kept, 1 failed"), "{}", ended.out);
    let frames = |name: &str| folder.read(&format!("csv/{name}.jsonl"));
    let alone = folder.at("alone.jsonl");
    umo(&["animate", &folder.at("speech.wav"), "--model", &model, "--seed", "5", "-o", &alone]).success();
    assert!(frames("a") == folder.read("alone.jsonl"));
    assert!(frames("b") == frames("c") && frames("b") != frames("d") && frames("b") != frames("a"));
    assert!(folder.read("csv/a.bvh").starts_with(b"HIERARCHY"));
    let text = String::from_utf8(folder.read("csv/results.jsonl")).unwrap();
    let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.iter().map(|line| line["line"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    assert_eq!((&lines[1]["speaker"], &lines[3]["speaker"]), (&"ada".into(), &"bob".into()));
    assert!(lines[4]["error"].as_str().unwrap().contains("missing.wav"));

    let ended = run("lines.jsonl", "jsonl", &[]);
    assert!(ended.code == 2 && ended.err.contains("broken.wav"), "{}", ended.err);
    for name in ["a.jsonl", "a.bvh", "b.jsonl"] {
        assert!(folder.read(&format!("jsonl/{name}")) == folder.read(&format!("csv/{name}")), "{name}");
    }
    assert!(!folder.names().iter().any(|name| name.contains("broken.npz")));
}

#[test]
fn shards_are_all_lines_once() {
    let (folder, tiny) = (Folder::new(), Folder::new());
    let model = tiny.tiny("tiny.safetensors", &[]);
    folder.speech();
    let rows: Vec<String> =
        (0..20).map(|i| format!(r#"{{"file": "speech.wav", "output": "{i}.npz", "seed": {i}}}"#)).collect();
    folder.file("lines.jsonl", rows.join("\n").as_bytes());
    let (manifest, out) = (folder.at("lines.jsonl"), folder.at("out"));
    let mut lines = Vec::new();
    for shard in ["1/3", "2/3", "3/3"] {
        umo(&["batch", &manifest, "-o", &out, "--model", &model, "--shard", shard]).success();
        let name = format!("out/results-{}.jsonl", shard.replace('/', "-of-"));
        let text = String::from_utf8(folder.read(&name)).unwrap();
        lines.extend(
            text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["line"].as_u64().unwrap()),
        );
    }
    lines.sort_unstable();
    assert_eq!(lines, (1..=20).collect::<Vec<u64>>());
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 20 + 3);
}

#[test]
fn a_thousand_lines() {
    let (folder, tiny) = (Folder::new(), Folder::new());
    let model = tiny.tiny("tiny.safetensors", &[]);
    folder.speech();
    let rows: Vec<String> =
        (0..1000).map(|i| format!(r#"{{"file": "speech.wav", "output": "{i}.bvh", "seed": {i}}}"#)).collect();
    folder.file("lines.jsonl", rows.join("\n").as_bytes());
    let (manifest, out) = (folder.at("lines.jsonl"), folder.at("out"));
    let batch = ["batch", &manifest, "-o", &out, "--model", &model, "--jobs", "16"];
    let ended = umo(&batch).success();
    assert!(ended.out.contains("1000 made, 0 kept, 0 failed; 16000 frames"), "{}", ended.out);
    // As after a run that stopped in the middle of a line: the last result is truncated, a file is missing.
    let all = folder.read("out/results.jsonl");
    std::fs::write(folder.at("out/results.jsonl"), &all[..all.len() - 40]).unwrap();
    std::fs::remove_file(folder.at("out/500.bvh")).unwrap();
    let ended = umo(&batch).success();
    assert!(ended.out.contains("2 made, 998 kept, 0 failed"), "{}", ended.out);
}

#[test]
fn wrong_manifests_are_refused_before_any_work() {
    let (folder, model) = (Folder::new(), golden("mel_k2_arkit"));
    folder.speech();
    let refused = |name: &str, text: &str, more: &[&str], word: &str| {
        let manifest = folder.file(name, text.as_bytes());
        let ended = umo(&[&["batch", &manifest, "--model", &model], more].concat());
        assert!(ended.code == 2 && ended.err.contains(word), "{text}: {}", ended.err);
    };
    refused("a.jsonl", r#"{"file": "speech.wav", "moood": "joy"}"#, &[], "moood");
    refused("a.jsonl", r#"{"file": "speech.wav", "mood": "happy"}"#, &[], "unknown mood `happy`");
    refused("a.jsonl", r#"{"file": "speech.wav", "output": "x.fbx"}"#, &[], "fbx");
    refused("a.jsonl", "", &[], "no recording");
    refused("a.csv", "file,output\nspeech.wav,a.glb\nspeech.wav,a.glb\n", &[], "output of two lines");
    refused("a.csv", "recording\nspeech.wav\n", &[], "recording");
    refused("a.txt", "speech.wav", &[], ".csv or .jsonl");
    refused("a.csv", "file\nspeech.wav\n", &["--shard", "4/3"], "I/N");
    refused("a.csv", "file\nspeech.wav\n", &["--jobs", "0"], "1 to 64");
    refused("a.csv", "file\nspeech.wav\n", &["--format", "fbx"], "fbx");
    assert!(umo(&["batch", &folder.at("nowhere")]).err.contains("nowhere"));
    assert!(folder.names().iter().all(|name| !name.ends_with(".glb")), "{:?}", folder.names());
}

#[test]
fn lines_of_a_scene_are_one_conversation() {
    let (folder, model) = (Folder::new(), golden("mel_k2_arkit"));
    folder.speech();
    folder.wav("late.wav", &[vec![0.0; 8000], super::program::voice(8000)].concat());
    let rows = "file,output,scene,seed\n\
                speech.wav,a.jsonl,inn,0\n\
                speech.wav,alone.jsonl,,0\n\
                late.wav,b.jsonl,inn,1\n";
    let manifest = folder.file("lines.csv", rows.as_bytes());
    let out = folder.at("out");
    let batch = ["batch", &manifest, "-o", &out, "--model", &model];
    let ended = umo(&batch).success();
    assert!(ended.out.contains("3 made, 0 kept, 0 failed"), "{}", ended.out);
    // The bits of the command, and not those of a line alone.
    let [a, b] = ["a.jsonl", "b.jsonl"].map(|name| folder.at(name));
    let speech = [folder.at("speech.wav"), folder.at("late.wav")];
    umo(&["converse", &speech[0], &speech[1], "--model", &model, "-o", &a, "-o", &b]).success();
    for name in ["a.jsonl", "b.jsonl"] {
        assert!(folder.read(name) == folder.read(&format!("out/{name}")), "{name}");
    }
    assert_ne!(folder.read("a.jsonl"), folder.read("out/alone.jsonl"));
    assert!(umo(&batch).success().out.contains("0 made, 3 kept, 0 failed"));
    // Each member's frames depend on every recording of its scene.
    folder.wav("late.wav", &super::program::voice(16_000));
    assert!(umo(&batch).success().out.contains("2 made, 1 kept, 0 failed"));
    let shard = |shard: &str| umo(&[&batch[..], &["--shard", shard]].concat()).success().out;
    assert!(shard("1/2").contains("2 made, 0 kept") && shard("2/2").contains("1 made, 0 kept"));

    for (rows, word) in [
        ("file,scene\nspeech.wav,inn\n", "scene inn: a conversation has 2 to 32 members, this one 1"),
        ("file,place\nspeech.wav,\"0,0,0\"\n", "line 1 has a place and no scene"),
        ("file,output,scene,place\nspeech.wav,a.npz,inn,\"0,0,0\"\nspeech.wav,b.npz,inn,\n", "some of its lines"),
    ] {
        let manifest = folder.file("wrong.csv", rows.as_bytes());
        let ended = umo(&["batch", &manifest, "--model", &model]);
        assert!(ended.code == 2 && ended.err.contains(word), "{}", ended.err);
    }
}

#[test]
fn takes_are_kept_beside_the_outputs() {
    let (folder, model) = (Folder::new(), golden("frames_seven"));
    let (speech, words) = (folder.speech(), folder.file("words.txt", b"No! Never, you and I."));
    folder.file(
        "lines.csv",
        b"file,output,seed,words\nspeech.wav,,5,words.txt\nspeech.wav,b.jsonl,6,\nspeech.wav,c.umo;c.jsonl,7,\n",
    );
    let (manifest, out) = (folder.at("lines.csv"), folder.at("out"));
    let batch = ["batch", &manifest, "-o", &out, "--model", &model, "--format", "jsonl,UMO", "--gesture", "wave@0.3"];
    let ended = umo(&batch).success();
    assert!(ended.out.contains("3 made, 0 kept, 0 failed"), "{}", ended.out);
    assert!(!folder.names().iter().any(|name| name.contains("b.umo")));
    // The bytes of single runs.
    let (take, alone) = (folder.at("alone.umo"), folder.at("alone.jsonl"));
    for (name, seed, more) in [("speech", "5", &["--words", &*words][..]), ("c", "7", &[])] {
        let made = ["animate", &speech, "--model", &model, "--seed", seed, "--gesture", "wave@0.3", "-o", &take];
        umo(&[&made[..], &["-o", &alone], more].concat()).success();
        assert!(folder.read("alone.umo") == folder.read(&format!("out/{name}.umo")), "{name}");
        assert!(folder.read("alone.jsonl") == folder.read(&format!("out/{name}.jsonl")), "{name}");
    }
    // A line whose take is gone is made anew.
    assert!(umo(&batch).success().out.contains("0 made, 3 kept, 0 failed"));
    std::fs::remove_file(folder.at("out/c.umo")).unwrap();
    assert!(umo(&batch).success().out.contains("1 made, 2 kept, 0 failed"));

    // Files of few keys, with markers.
    let rows = folder.file("few.csv", b"file,seed,words\nspeech.wav,5,words.txt\n");
    let few = ["batch", &rows, "-o", &folder.at("few"), "--model", &model, "--format", "glb", "--reduce", "2"];
    umo(&few).success();
    let (glb, words) = (folder.at("alone.glb"), folder.at("words.txt"));
    umo(&["animate", &speech, "--model", &model, "--seed", "5", "--words", &words, "--reduce", "2", "-o", &glb])
        .success();
    assert!(folder.read("alone.glb") == folder.read("few/speech.glb"));
    let line = folder.refused(&[&few[..7], &["jsonl", "--reduce", "2"]].concat());
    assert!(line.contains("--reduce") && line.contains(".jsonl"), "{line}");

    folder.file("scene.csv", b"file,output,scene\nspeech.wav,a.umo,talk\nspeech.wav,b.npz,talk\n");
    folder.file("two.csv", b"file,output\nspeech.wav,a.umo;b.umo\n");
    let refused = |manifest: &str, more: &[&str]| {
        folder.refused(&[&["batch", &folder.at(manifest), "-o", &out, "--model", &model][..], more].concat())
    };
    assert!(refused("scene.csv", &[]).contains("a take (.umo)"));
    assert!(refused("lines.csv", &["--retime"]).contains("a take (.umo)"));
    assert!(refused("two.csv", &[]).contains("one take"));
    assert!(refused("two.csv", &["--format", "foo"]).contains("unknown format `foo`"));
}

/// A gesture that was added to a score survives another recording of its words, at their new time.
#[test]
fn a_line_that_is_made_anew_keeps_the_changes_of_its_score() {
    let (folder, model) = (Folder::new(), golden("frames_seven"));
    let record = |silence: usize, text: &str| {
        folder.wav("speech.wav", &[vec![0.0; silence], voice(48_000)].concat());
        let time = |milliseconds: usize| format!("00:00:0{},{:03}", milliseconds / 1000, milliseconds % 1000);
        let start = silence / 16;
        let words = format!("1\n{} --> {}\n{text}\n", time(start + 400), time(start + 900));
        folder.file("words.srt", words.as_bytes());
    };
    record(0, "hello there");
    folder.file("lines.csv", b"file,output,words\nspeech.wav,a.umo;a.jsonl,words.srt\n");
    let (manifest, out, take) = (folder.at("lines.csv"), folder.at("out"), folder.at("out/a.umo"));
    let run = || umo(&["batch", &manifest, "-o", &out, "--model", &model]);
    run().success();
    let (first, plain) = (folder.read("out/a.jsonl"), folder.file("plain.umo", &folder.read("out/a.umo")));
    let own = umo(&["score", &take, "--model", &model]).success().out;
    let score = |text: &str| drop(folder.file("out/a.toml", text.as_bytes()));
    score(&own);
    let ended = run().success();
    assert!(ended.out.contains("1 made") && !ended.err.contains("note:"), "{} {}", ended.out, ended.err);
    assert!(folder.read("out/a.jsonl") == first && String::from_utf8(folder.read("out/a.toml")).unwrap() == own);

    let changed = own.replace("\n]", "\n    { at = 0.5, gesture = \"nod\" }, # yes\n]");
    score(&changed);
    assert!(run().success().out.contains("1 made"));
    assert!(String::from_utf8(folder.read("out/a.toml")).unwrap() == changed, "a score that is still right stays");
    let (direct, toml) = (folder.at("direct.jsonl"), folder.at("out/a.toml"));
    let animate = ["animate", &folder.at("speech.wav"), "--model", &model, "--take", &plain, "--score", &toml];
    umo(&[&animate[..], &["-o", &direct]].concat()).success();
    assert!(folder.read("out/a.jsonl") == folder.read("direct.jsonl") && folder.read("direct.jsonl") != first);
    assert!(run().success().out.contains("0 made, 1 kept"));

    record(8000, "Hello, there!");
    let ended = run().success();
    assert!(ended.err.contains("a.toml: added gesture `nod`: kept at 1.0 s (was 0.5 s)"), "{}", ended.err);
    let moved = String::from_utf8(folder.read("out/a.toml")).unwrap();
    assert!(moved.contains("{ at = 1, gesture = \"nod\" }") && moved.contains("Hello, there!"), "{moved}");
    let done = &results(&folder.read("out/results.jsonl"))["speech.wav"];
    assert_eq!(done["edits"].as_array().unwrap().len(), 1);
    assert!(run().success().out.contains("0 made, 1 kept"));

    record(0, "good day");
    let ended = run().success();
    assert!(ended.err.contains("dropped (was at 1.0 s): none of the words is said any more"), "{}", ended.err);
    assert!(!String::from_utf8(folder.read("out/a.toml")).unwrap().contains("nod"));

    score("version = 1\nevents = [\n    { at = 0 },\n]\n");
    let ended = run();
    assert!(ended.code == 2 && ended.err.contains("a.toml:3: "), "{}", ended.err);
}
