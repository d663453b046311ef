//! `umo animate` and `umo text` with valid input.

use super::program::{Folder, golden, umo, voice};

/// Frames of `speech.wav` of [`Folder::speech`], 9000 samples.
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
    assert!(
        greedy == animate(&folder, "f", &["--temperature", "0"])
            && first != animate(&folder, "g", &["--temperature", "0.5"])
    );
}

#[test]
fn fewer_keys_and_markers_are_written_and_formats_without_keys_are_refused() {
    let folder = Folder::new();
    let words = folder.file("words.srt", b"1\n00:00:00,100 --> 00:00:00,300\nhello\n");
    let (speech, model) = (folder.speech(), golden("mel_k2_arkit"));
    let paths = ["few.glb", "few.bvh", "few.csv"].map(|name| folder.at(name));
    let mut args = vec!["animate", &speech, "--model", &model, "--reduce", "2", "--words", &words];
    args.extend(paths.iter().flat_map(|path| ["-o", path]));
    umo(&args).success();
    let glb = folder.read("few.glb");
    assert!(String::from_utf8_lossy(&glb).contains(r#""name":"hello""#));
    let [bvh, csv] = ["few.bvh", "few.csv"].map(|name| String::from_utf8(folder.read(name)).unwrap());
    assert!(bvh.starts_with("HIERARCHY # 0.100 word hello;\n") && bvh.contains(&format!("Frames: {FRAMES}")));
    assert!(csv.lines().count() <= FRAMES + 1 && csv.lines().any(|line| line.ends_with(",,hello")), "{csv}");
    let out = folder.at("o.npz");
    let refused = folder.refused(&["animate", &speech, "--model", &model, "--reduce", "2", "-o", &out]);
    assert!(refused.contains("--reduce: .npz has every frame"), "{refused}");
    assert_eq!(umo(&["animate", &speech, "--model", &model, "--reduce", "0", "-o", &paths[0]]).code, 2);
}

#[test]
fn format_option_overrides_the_extension() {
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

/// The default model's motion of the speech in `assets`, without layers: heading and frames.
fn performed(folder: &Folder, name: &str, more: &[&str]) -> (serde_json::Value, Vec<Frame>) {
    let speech = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/hello.wav");
    let out = folder.at(name);
    umo(&[&["animate", speech, "--layers", "0", "-o", &out][..], more].concat()).success();
    let bytes = folder.read(name);
    (heading(&bytes), frames_of(&bytes))
}

#[test]
fn a_motion_begins_at_its_start_pose() {
    let folder = Folder::new();
    let last = folder.at("last.npz");
    let plain = performed(&folder, "plain.jsonl", &["--greedy"]).1;
    // One pose is nearer than another by draws, which differ between processors: three poses.
    let (mut far, mut near) = (0.0, 0.0);
    for prompt in ["angry", "explaining", "a person waves"] {
        let before = performed(&folder, "before.jsonl", &["--prompt", prompt, "-o", &last]).1;
        let next = performed(&folder, "next.jsonl", &["--greedy", "--start-pose", &last]).1;
        far += apart(&plain[0].0, &before.last().unwrap().0);
        near += apart(&next[0].0, &before.last().unwrap().0);
    }
    assert!(near < 0.85 * far, "{near} and {far} radians from the start poses");
    performed(&folder, "again.jsonl", &["--greedy", "--start-pose", &last]);
    assert_eq!(folder.read("next.jsonl"), folder.read("again.jsonl"));
}

#[test]
fn a_prompt_is_seen_in_the_motion() {
    let folder = Folder::new();
    let of = |name: &str, prompt: &str| performed(&folder, name, &["--seed", "1", "--prompt", prompt]);
    let smile = |(heading, frames): &(serde_json::Value, Vec<Frame>)| {
        let names = heading["face"]["names"].as_array().unwrap();
        let at = names.iter().position(|name| name == "mouthSmileLeft").unwrap();
        frames.iter().map(|frame| frame.1["face"][at].as_f64().unwrap()).sum::<f64>() / frames.len() as f64
    };
    let moves = |frames: &[Frame]| frames.windows(2).map(|pair| apart(&pair[0].0, &pair[1].0)).sum::<f64>();
    let (joyful, sad) = (of("joyful.jsonl", "joyful"), of("sad.jsonl", "sad"));
    assert!(smile(&joyful) > smile(&sad) + 0.2, "{} and {}", smile(&joyful), smile(&sad));
    assert!(moves(&joyful.1) > 1.3 * moves(&sad.1), "{} and {}", moves(&joyful.1), moves(&sad.1));
    assert!(joyful == of("again.jsonl", "joyful"));
}

#[test]
fn chunk_lookahead_and_precision_options_work() {
    let folder = Folder::new();
    let mut motions = vec![];
    for precision in ["f32", "bf16", "int8"] {
        for (target, lookahead) in [("1", "0"), ("7", "42"), ("3", "9")] {
            let more = ["--precision", precision, "--target", target, "--lookahead", lookahead];
            let files = animate(&folder, "motion", &more);
            assert_eq!(lines(&files[3]), FRAMES + 1);
            motions.push(moved(&files[4], FRAMES));
        }
    }
    // Chunks of another size change the motion, and so do weights and inputs of 8 bits. Those of
    // 16 bits stay close to f32.
    let (f32, int8) = (&motions[..3], &motions[6..]);
    for (i, motion) in f32.iter().enumerate() {
        assert!(!f32[..i].contains(motion), "--target changes nothing");
        assert!(motion != &int8[i], "--precision changes nothing");
        let apart = motion.iter().flatten().zip(motions[3 + i].iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f64::max) < 0.1, "bf16 is far from f32");
    }
}

#[test]
fn lookahead_changes_the_audio_horizon() {
    let folder = Folder::new();
    let (speech, model, out) = (folder.speech(), golden("hubert_k1_smplx"), folder.at("motion.jsonl"));
    let of = |lookahead: &str| {
        umo(&["animate", &speech, "--model", &model, "--lookahead", lookahead, "-o", &out]).success();
        folder.read("motion.jsonl")
    };
    let (none, some) = (of("0"), of("9"));
    assert!(none != some && none == of("0"));
}

/// The numbers of every frame of a `.jsonl` file, at least one of which must change in a later
/// frame. Rotations are unit quaternions.
fn moved(jsonl: &[u8], frames: usize) -> Vec<Vec<f64>> {
    let text = std::str::from_utf8(jsonl).unwrap();
    let lines = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let numbers = |list: &serde_json::Value| -> Vec<f64> {
        list.as_array().unwrap().iter().map(|number| number.as_f64().expect("a finite number")).collect()
    };
    let frame = |line: serde_json::Value| {
        let mut all = numbers(&line["translation"]);
        for rotation in line["rotations"].as_array().unwrap() {
            let rotation = numbers(rotation);
            let length = rotation.iter().map(|x| x * x).sum::<f64>();
            assert!((length - 1.0).abs() < 1e-3 && rotation.len() == 4, "{rotation:?}");
            all.extend(rotation);
        }
        all
    };
    let motion: Vec<Vec<f64>> = lines.filter(|line| line.get("frame").is_some()).map(frame).collect();
    assert_eq!(motion.len(), frames);
    assert!(motion.iter().any(|frame| *frame != motion[0]), "nothing moves");
    motion
}

#[test]
fn the_models_default_size_and_stores_move() {
    let folder = Folder::new();
    let speech = folder.speech();
    let motions = ["f32", "bf16", "int8"].map(|store| {
        let (model, out) = (folder.tiny(store, &["--store", store]), folder.at("motion.jsonl"));
        let ended = umo(&["animate", &speech, "--model", &model, "-o", &out]).success();
        assert!(ended.err.contains("note: untrained model"), "{}", ended.err);
        moved(&folder.read("motion.jsonl"), FRAMES)
    });
    assert!(motions[0] != motions[2], "int8 has the motion of f32");
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

/// Asserts that the input is refused with `problem`, and accepted with a warning of it with `--repair`.
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

/// `tests/pipeline.rs` has what guidance does to a model's codes. How far a bow then goes is sampled, and differs between
/// processors.
#[test]
fn a_text_alone_is_guided() {
    let folder = Folder::new();
    let bow = |name: &str, more: &[&str]| {
        let out = folder.at(name);
        umo(&[&["text", "she bows", "--seconds", "2", "-o", &out][..], more].concat()).success();
        folder.read(name)
    };
    let guided = bow("guided.jsonl", &[]);
    assert!(guided == bow("given.jsonl", &["--guidance", "2.5"]));
    assert!(guided != bow("one.jsonl", &["--guidance", "1"]));
    // A model without guidance refuses it.
    let (smplx, out) = (golden("mel_k2_arkit"), folder.at("plain.csv"));
    umo(&["text", "a person waves", "--seconds", "1", "--model", &smplx, "-o", &out]).success();
    folder.refused(&["text", "a person waves", "--model", &smplx, "--guidance", "2", "-o", &out]);
}

#[test]
fn the_first_command_needs_no_model() {
    let folder = Folder::new();
    let (speech, out) = (folder.speech(), folder.at("hello.glb"));
    umo(&["animate", &speech, "-o", &out]).success();
    let (first, model) =
        (folder.read("hello.glb"), concat!(env!("CARGO_MANIFEST_DIR"), "/../models/umo-people/model.safetensors"));
    umo(&["animate", &speech, "--model", model, "-o", &out]).success();
    assert!(first == folder.read("hello.glb"), "not the model that ships");
    let gltf = gltf::Gltf::from_slice(&first).unwrap();
    let inputs = gltf.animations().flat_map(|animation| animation.channels().collect::<Vec<_>>());
    let keys: Vec<usize> = inputs.map(|channel| channel.sampler().input().count()).collect();
    assert!(keys.len() > 20 && keys.contains(&FRAMES), "{keys:?}");
}

#[test]
fn gestures_are_listed_and_played_at_their_times() {
    let folder = Folder::new();
    let listed = umo(&["gestures"]).success().out;
    assert!(["nod", "wave", "thumbs_up", "count_five"].iter().all(|name| listed.contains(name)), "{listed}");
    let (speech, model) = (folder.speech(), folder.tiny("tiny.safetensors", &[]));
    let made = |name: &str, more: &[&str]| {
        let out = folder.at(name);
        umo(&[&["animate", &speech, "--model", &model, "-o", &out][..], more].concat()).success();
        let bytes = folder.read(name);
        (heading(&bytes), frames_of(&bytes))
    };
    let (heading, plain) = made("plain.jsonl", &[]);
    let names = heading["joints"].as_array().unwrap();
    // The first frame that differs, and the joints that do in any.
    let changes = |other: &[Frame]| {
        let differ = |joint: &usize| plain.iter().zip(other).any(|(a, b)| a.0[*joint] != b.0[*joint]);
        let first = plain.iter().zip(other).position(|(a, b)| a != b).expect("a gesture");
        let joints = (0..55).filter(differ).map(|joint| names[joint].as_str().unwrap()).collect::<Vec<_>>();
        assert!(plain.iter().zip(other).all(|(a, b)| a.1 == b.1), "face or root differ");
        (first, joints)
    };
    let (first, joints) = changes(&made("nodded.jsonl", &["--gesture", "nod@0.5"]).1);
    assert!(first >= 4, "frame {first}");
    assert_eq!(joints, ["spine1", "spine2", "spine3", "neck", "head", "left_eye", "right_eye"]);
    // The frames of one animation serve as a gesture in another, for the parts that are named.
    let clip = format!("bob={},0.3,head", folder.at("nodded.jsonl"));
    let (first, joints) =
        changes(&made("bobbed.jsonl", &["--gesture-clip", &clip, "--gesture", "bob@0.5,strength=0.5"]).1);
    assert!(first >= 6, "frame {first}, more than 0.3 s before the stroke");
    assert_eq!(joints, ["neck", "head", "left_eye", "right_eye"]);
}

/// A model without text conditioning plays gestures of the table.
#[test]
fn a_text_that_names_a_gesture_is_that_gesture() {
    let folder = Folder::new();
    let (model, out) = (golden("hubert_k1_smplx"), folder.at("waved.npz"));
    let done = umo(&["text", "A person waves", "--seconds", "2", "--model", &model, "-o", &out]).success();
    assert!(done.err.contains("`wave`"), "{}", done.err);
    assert!(done.out.contains("60 frames"), "{}", done.out);
}

/// A frame of a `.jsonl` file: rotations, other values, line.
type Frame = (Vec<serde_json::Value>, serde_json::Value, String);

fn heading(bytes: &[u8]) -> serde_json::Value {
    let text = std::str::from_utf8(bytes).unwrap();
    serde_json::from_str(text.lines().next().unwrap()).unwrap()
}

/// Angle between two rotations, in radians.
fn angle(a: &serde_json::Value, b: &serde_json::Value) -> f64 {
    let dot: f64 = (0..4).map(|i| a[i].as_f64().unwrap() * b[i].as_f64().unwrap()).sum();
    2.0 * dot.abs().min(1.0).acos()
}

/// Mean angle between the joints of two poses.
fn apart(a: &[serde_json::Value], b: &[serde_json::Value]) -> f64 {
    a.iter().zip(b).map(|(a, b)| angle(a, b)).sum::<f64>() / a.len() as f64
}

/// Frames of a `.jsonl` file.
fn frames_of(bytes: &[u8]) -> Vec<Frame> {
    let text = String::from_utf8(bytes.to_vec()).unwrap();
    let lines = text.lines().skip(1).map(|line| {
        let mut frame: serde_json::Value = serde_json::from_str(line).unwrap();
        let rotations = frame.as_object_mut().unwrap().remove("rotations").unwrap();
        (rotations.as_array().unwrap().clone(), frame, line.to_owned())
    });
    lines.collect()
}

/// With the default model, whose units carry accents.
#[test]
fn retiming_moves_the_upper_body_alone_and_is_the_same_in_a_batch() {
    let folder = Folder::new();
    let speech = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/hello.wav");
    let made = |name: &str, more: &[&str]| {
        let out = folder.at(name);
        umo(&[&["animate", speech, "-o", &out][..], more].concat()).success();
        folder.read(name)
    };
    // The model's output without layers, which respond to the body's motion.
    let plain = frames_of(&made("plain.jsonl", &["--layers", "0"]));
    let retimed = frames_of(&made("retimed.jsonl", &["--layers", "0", "--retime"]));
    assert_eq!(plain.len(), retimed.len());
    assert!(plain[0].2 == retimed[0].2 && plain.last().unwrap().2 == retimed.last().unwrap().2);
    let mut changed = [false; 55];
    for (a, b) in plain.iter().zip(&retimed) {
        assert!(a.1 == b.1, "face or root differ");
        changed.iter_mut().zip(a.0.iter().zip(&b.0)).for_each(|(changed, (a, b))| *changed |= a != b);
    }
    // Pelvis, legs, feet, jaw and eyes do not change.
    let stays = [0, 1, 2, 4, 5, 7, 8, 10, 11, 22, 23, 24];
    assert!((0..55).all(|joint| changed[joint] != stays.contains(&joint)), "{changed:?}");

    let wanted = made("hello.jsonl", &["--retime"]);
    std::fs::create_dir(folder.at("lines")).unwrap();
    for name in ["a.wav", "b.wav", "c.wav"] {
        std::fs::copy(speech, folder.at(&format!("lines/{name}"))).unwrap();
    }
    let (lines, out) = (folder.at("lines"), folder.at("out"));
    let batch = ["batch", &lines, "-o", &out, "--format", "jsonl", "--jobs", "2"];
    umo(&[&batch[..], &["--retime"]].concat()).success();
    for name in ["a", "b", "c"] {
        assert!(folder.read(&format!("out/{name}.jsonl")) == wanted, "{name}");
    }
    // Retiming is one of the settings that a result depends on.
    let ended = umo(&batch).success();
    assert!(ended.out.contains("3 made, 0 kept"), "{}", ended.out);
    assert!(folder.read("out/a.jsonl") != wanted);
}

#[test]
fn a_model_without_accents_is_not_retimed() {
    let (folder, model) = (Folder::new(), golden("mel_k2_arkit"));
    let (speech, out) = (folder.speech(), folder.at("out.jsonl"));
    let refused = folder.refused(&["animate", &speech, "--model", &model, "--retime", "-o", &out]);
    assert!(refused.contains("no audio units with accents (`audio.accents`"), "{refused}");
}
