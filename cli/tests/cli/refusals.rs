//! Invalid input: exit code 2, one line, and no file.

use safetensors::tensor::{Dtype, TensorView};

use super::program::{Folder, golden, golden_file, umo, voice};

/// A path that exists and is not a regular file.
const DEVICE: &str = if cfg!(windows) { "NUL" } else { "/dev/null" };

#[test]
fn recordings_without_sound_are_refused() {
    let folder = Folder::new();
    let out = folder.at("motion.npz");
    let whole = std::fs::read(folder.speech()).unwrap();
    let data = whole.windows(4).position(|bytes| bytes == b"data").unwrap();
    let mut lying = whole.clone();
    // The format chunk claims to extend beyond the end of the file.
    lying[16..20].copy_from_slice(&u32::MAX.to_le_bytes());
    let recordings = [
        (folder.file("nothing.wav", b""), "WAV"),
        (folder.file("text.wav", b"this is text, not a recording"), "WAV"),
        (folder.file("heading.wav", &whole[..12]), "format"),
        (folder.file("no_data.wav", &whole[..data]), "data"),
        (folder.file("cut_data.wav", &whole[..data + 8]), "empty"),
        (folder.file("lying.wav", &lying), "data"),
        (folder.wav("empty.wav", &[]), "empty"),
        (folder.wav("short.wav", &voice(80)), "less than one frame"),
        (folder.wav("one.wav", &voice(533)), "less than one frame"),
        (folder.at("missing.wav"), "no such file"),
        (folder.at(""), "directory"),
    ];
    for (recording, wanted) in &recordings {
        let line = folder.refused(&["animate", recording, "-o", &out]);
        assert!(line.contains(wanted) && line.contains(recording.trim_end_matches('/')), "{line}");
    }
}

#[test]
fn recordings_in_other_formats_are_named_with_how_to_convert_them() {
    let folder = Folder::new();
    let out = folder.at("motion.npz");
    let speex = [&b"OggS\0\x02"[..], &[0; 22], b"Speex   "].concat();
    let g_726 =
        [&b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0\x45\0\x01\0\x40\x1f\0\0\xa0\x0f\0\0\x01\0\x04\0data"[..], &[0; 8]].concat();
    // The first bytes of each format; then names only, for files whose first bytes are not known.
    for (name, start, format) in [
        ("b.amr", &b"#!AMR\n.........."[..], "AMR"),
        ("c.ogg", &speex[..], "Speex"),
        ("d.wav", &g_726[..], "encoding 0x0045"),
        ("f.WMA", b"????????????????", "Windows Media Audio"),
    ] {
        let recording = folder.file(name, start);
        for command in ["animate", "view"] {
            let line = folder.refused(&[command, &recording, "-o", &out]);
            let converted = format!("ffmpeg -i {recording} {}", recording.rsplit_once('.').unwrap().0);
            assert!(line.contains(format) && line.contains(&converted), "{line}");
        }
    }
}

#[test]
fn damaged_recordings_in_formats_that_are_read_are_refused() {
    let folder = Folder::new();
    let out = folder.at("motion.npz");
    let opus = [&b"OggS\0\x02"[..], &[0; 22], b"OpusHead"].concat();
    for (name, start, format) in [
        ("a.flac", &b"fLaC\0\0\0\x22............"[..], "FLAC"),
        ("b.ogg", b"OggS\0\x02..............", "Ogg"),
        ("c.mp3", b"ID3\x04\0\0............", "MP3"),
        ("d.mp3", b"\xff\xfb\x90\x64............", "MP3"),
        ("e.m4a", b"\0\0\0\x20ftypM4A ........", "MPEG-4"),
        ("f.wav", b"fLaC............", "FLAC"),
        ("g.M4A", b"????????????????", "MPEG-4"),
        ("h.ogg", &opus[..], "Ogg Opus"),
        ("i.opus", b"????????????????", "Ogg Opus"),
        ("j.aiff", b"FORM\0\0\0\0AIFF........", "AIFF"),
        ("k.webm", b"\x1a\x45\xdf\xa3............", "WebM"),
        ("l.wav", b"caff............", "Core Audio"),
    ] {
        let recording = folder.file(name, start);
        for command in ["animate", "view"] {
            let line = folder.refused(&[command, &recording, "-o", &out]);
            assert!(line.contains(&recording) && line.contains(&format!("not a whole {format}")), "{line}");
        }
    }
}

#[cfg(unix)]
#[test]
fn only_regular_files_are_opened() {
    let folder = Folder::new();
    let (out, speech, fifo) = (folder.at("motion.npz"), folder.speech(), folder.at("fifo"));
    assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    let onto = folder.at("moved.glb");
    for (path, kind) in
        [(fifo.as_str(), "a FIFO"), ("/dev/zero", "a character device"), ("/dev/null", "a character device")]
    {
        for args in [
            &["animate", path, "-o", &out][..],
            &["animate", &speech, "--model", path, "-o", &out],
            &["animate", &speech, "--start-pose", path, "-o", &out],
            &["model", "inspect", path],
            &["view", path, "-o", &out],
            &["model", "quantize", path, "--weights", "int8", "-o", &out],
            &["model", "stage", "encoder", "--in", path, "--out", &out],
            &["retarget", &speech, "--onto", path, "-o", &onto],
            &["draw", path, "-o", &out],
        ] {
            let line = folder.refused(args);
            assert!(line.contains(path) && line.contains(&format!("it is {kind}, not a regular file")), "{line}");
        }
    }
}

#[test]
fn damaged_model_differs_from_one_without_checksum() {
    let folder = Folder::new();
    let verify = |model: &str| umo(&["model", "inspect", "--verify", model]);
    assert!(verify(&golden("mel_k2_arkit")).success().out.contains("none"));
    for (name, more) in [("parts", &[][..]), ("frames", &["--layout", "frames"])] {
        let good = folder.tiny(name, more);
        assert_eq!(verify(&good).success().out, "checksum   right\n", "{name}");
        let mut damaged = std::fs::read(&good).unwrap();
        *damaged.last_mut().unwrap() ^= 0x10;
        let damaged = folder.file("damaged.safetensors", &damaged);
        for args in [&["model", "inspect", "--verify", &damaged][..], &["model", "inspect", &damaged]] {
            assert!(folder.refused(args).contains("it is damaged: its checksum is crc32:"), "{name}");
        }
    }
}

#[test]
fn a_model_whose_weights_are_defective_says_where() {
    let folder = Folder::new();
    let mut bytes = std::fs::read(golden("mel_k2_arkit")).unwrap();
    let name = "lm.decoder.final_layer_norm.weight";
    let range = {
        let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let data = tensors.tensor(name).unwrap().data();
        let start = data.as_ptr().addr() - bytes.as_ptr().addr();
        start..start + data.len()
    };
    for value in bytes[range].as_chunks_mut::<4>().0 {
        *value = 3e38_f32.to_le_bytes();
    }
    let model = folder.file("defective.safetensors", &bytes);
    let line = folder.refused(&["animate", &folder.speech(), "--model", &model, "-o", &folder.at("motion.npz")]);
    assert!(line.contains("face logits are not finite: the model's weights are defective"), "{line}");
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("mel_k2_arkit"));
    let refused = |out: &str, more: &[&str]| {
        folder.refused(&[&["animate", &speech, "--model", &model, "-o", out], more].concat())
    };
    std::fs::create_dir(folder.at("folder.npz")).unwrap();
    assert!(refused(&folder.at("folder.npz"), &[]).contains("directory"));
    assert!(refused(&folder.at("missing/motion.npz"), &[]).contains("missing/motion.npz"));
    assert!(refused(&folder.at("speech.wav/motion.npz"), &[]).contains("speech.wav/motion.npz"));
    let kept = folder.file("kept.bvh", b"an earlier motion");
    let mut permissions = std::fs::metadata(&kept).unwrap().permissions();
    permissions.set_readonly(true);
    std::fs::set_permissions(&kept, permissions).unwrap();
    assert!(refused(&kept, &[]).contains("read-only"));
    let device = refused(DEVICE, &["--format", "npz"]);
    assert!(cfg!(windows) || device.contains("regular"), "{device}");
    assert!(refused(&folder.at("motion"), &[]).contains("--format"));
    assert!(refused(&folder.at("motion.fbx"), &[]).contains("fbx"));
    assert!(refused(&folder.at("motion.npz"), &["--format", "fbx"]).contains("fbx"));
    // A valid output beside an invalid one is not left incomplete.
    refused(&folder.at("good.npz"), &["-o", &folder.at("missing/bad.npz")]);
    let (tiny, input) = (folder.tiny("tiny.safetensors", &[]), golden_file("mel_k2_arkit", "cases.safetensors"));
    let input = input.to_str().unwrap();
    for out in [folder.at("missing/out"), folder.at("folder.npz")] {
        folder.refused(&["model", "stage", "encoder", "--model", &model, "--in", input, "--out", &out]);
        folder.refused(&["model", "random", "--size", "tiny", "-o", &out]);
    }
    folder.refused(&["text", "a wave", "--model", &tiny, "-o", &folder.at("missing/out.npz")]);
    assert_eq!(folder.read("kept.bvh"), b"an earlier motion");
}

#[test]
fn models_that_are_no_models_are_refused() {
    let folder = Folder::new();
    let (speech, out) = (folder.speech(), folder.at("motion.npz"));
    let model = folder.tiny("tiny.safetensors", &[]);
    let bytes = folder.read("tiny.safetensors");
    for cut in [0, 1, 7, 8, 9, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&model, &bytes[..cut]).unwrap();
        let line = folder.refused(&["animate", &speech, "--model", &model, "-o", &out]);
        assert!(line.contains("tiny.safetensors"), "cut at {cut}: {line}");
        folder.refused(&["model", "inspect", &model]);
    }
    let others = [folder.at("missing"), folder.at(""), speech.clone(), DEVICE.to_owned()];
    let cases = golden_file("mel_k2_arkit", "cases.safetensors");
    for other in others.iter().map(String::as_str).chain([cases.to_str().unwrap()]) {
        folder.refused(&["animate", &speech, "--model", other, "-o", &out]);
        folder.refused(&["model", "inspect", other]);
        folder.refused(&["text", "a wave", "--model", other, "-o", &out]);
    }
}

#[test]
fn numbers_and_names_that_cannot_be_are_refused() {
    let folder = Folder::new();
    let (speech, out, model) = (folder.speech(), folder.at("motion.npz"), folder.tiny("tiny.safetensors", &[]));
    let options: [(&[&str], &str); 10] = [
        (&["--threads", "0"], "--threads 0"),
        (&["--threads", "100000"], "--threads 100000"),
        (&["--isa", "mmx"], "mmx"),
        (&["--isa", ""], "--isa"),
        (&["--target", "0"], "target"),
        (&["--target", "11"], "target"),
        (&["--target", "18446744073709551615"], "target"),
        (&["--lookahead", "61"], "lookahead"),
        (&["--format", ""], "format"),
        (&["--prompt", "\u{1f600} x".repeat(500).leak()], "prompt"),
    ];
    for (option, wanted) in options {
        let line = folder.refused(&[&["animate", &speech, "--model", &model, "-o", &out], option].concat());
        assert!(line.contains(wanted), "{option:?}: {line}");
    }
    for seconds in ["0", "nan", "inf", "1e9", "3600.001"] {
        let line = folder.refused(&["text", "a wave", "--model", &model, "--seconds", seconds, "-o", &out]);
        assert!(line.contains("--seconds"), "{line}");
    }
    folder.refused(&["text", "a wave", "--model", &model, "--seconds=-1", "-o", &out]);
}

#[test]
fn arguments_that_make_no_sense_are_refused() {
    let folder = Folder::new();
    let (speech, out) = (folder.speech(), folder.at("motion.npz"));
    for args in [
        &["animate", &speech, "-o", &out, "--threads", "many"][..],
        &["animate", &speech, "-o", &out, "--seed", "-1"],
        &["animate", &speech, "-o", &out, "--greedy", "--seed", "1"],
        &["animate", &speech, "-o", &out, "--temperature", "-1"],
        &["animate", &speech, "-o", &out, "--precision", "f8"],
        &["animate", &speech],
        &["animate", "-o", &out],
        &["dance"],
        &["animate", &speech, "-o", &out, "--gesture", "wave@soon"],
        &["animate", &speech, "-o", &out, "--gesture", "wave,up"],
        &["animate", &speech, "-o", &out, "--gesture", "point,to=1:2"],
        &["animate", &speech, "-o", &out, "--gesture-clip", "salute"],
        &["animate", &speech, "-o", &out, "--gesture-clip", "salute=a.glb,leg"],
    ] {
        // The usage follows the error, on separate lines.
        let ended = super::umo(args);
        assert_eq!(ended.code, 2, "{args:?}");
        assert_eq!(ended.err.lines().filter(|line| line.starts_with("error:")).count(), 1, "{}", ended.err);
    }
    assert_eq!(folder.names(), ["speech.wav"]);
}

#[test]
fn what_a_model_cannot_do_is_refused() {
    let folder = Folder::new();
    let (speech, csv, npz) = (folder.speech(), folder.at("motion.csv"), folder.at("motion.npz"));
    let (smplx, tiny) = (golden("hubert_k1_smplx"), folder.tiny("tiny.safetensors", &[]));
    assert!(folder.refused(&["animate", &speech, "--model", &smplx, "-o", &csv]).contains("ARKit"));
    assert!(folder.refused(&["animate", &speech, "--model", &tiny, "-o", &npz, "-o", &csv]).contains("ARKit"));
    let line = folder.refused(&["animate", &speech, "--model", &smplx, "--prompt", "happily", "-o", &npz]);
    assert!(line.contains("text"), "{line}");
    let line = folder.refused(&["text", "a backflip", "--model", &smplx, "-o", &npz]);
    for word in ["backflip", "the model takes no text", "wave", "thumbs_up"] {
        assert!(line.contains(word), "{line}");
    }
    for (gesture, problem) in [("fly@1", "thumbs_up"), ("wave@1,speed=9", "speed"), ("wave@-1", "time")] {
        let line = folder.refused(&["animate", &speech, "--model", &tiny, "-o", &npz, "--gesture", gesture]);
        assert!(line.contains(gesture.split(['@', ',']).next().unwrap()) && line.contains(problem), "{line}");
    }
    let clip = ["animate", &speech, "--model", &tiny, "-o", &npz, "--gesture-clip"];
    for (given, problem) in
        [(format!("salute={speech}"), "speech.wav"), ("salute=missing.glb".to_owned(), "missing.glb")]
    {
        let line = folder.refused(&[&clip[..], &[given.as_str()]].concat());
        assert!(line.contains(problem), "{line}");
    }
}

#[test]
fn start_poses_that_are_none_are_refused() {
    let folder = Folder::new();
    let (speech, out, start) = (folder.speech(), folder.at("motion.bvh"), folder.at("start.npz"));
    let model = golden("mel_k2_arkit");
    super::umo(&["animate", &speech, "--model", &model, "-o", &start]).success();
    let bytes = folder.read("start.npz");
    let refused = |model: &str, start: &str| {
        folder.refused(&["animate", &speech, "--model", model, "--start-pose", start, "-o", &out])
    };
    // A model without encoders cannot encode motion.
    let line = refused(&golden("mel_k1_upcycled"), &start);
    assert!(line.contains("encoder"), "{line}");
    for cut in [0, 1, 100, bytes.len() / 2, bytes.len() - 1] {
        refused(&model, &folder.file("cut.npz", &bytes[..cut]));
    }
    refused(&model, &speech);
    refused(&model, &folder.at("missing.npz"));
    refused(&model, &folder.at(""));
}

#[test]
fn stages_refuse_what_they_cannot_read() {
    let folder = Folder::new();
    let (model, out) = (folder.tiny("tiny.safetensors", &[]), folder.at("out.safetensors"));
    let run = |stage: &str, input: &str, more: &[&str]| {
        folder.refused(&[&["model", "stage", stage, "--model", &model, "--in", input, "--out", &out], more].concat())
    };
    let write = |name: &str, tensors: &[(&str, Dtype, Vec<usize>, Vec<u8>)]| {
        let path = folder.at(name);
        let views: Vec<_> = tensors
            .iter()
            .map(|(name, dtype, shape, bytes)| (*name, TensorView::new(*dtype, shape.clone(), bytes).unwrap()))
            .collect();
        safetensors::serialize_to_file(views, None, path.as_ref()).unwrap();
        path
    };
    let ids = |name: &str, ids: &[i64]| {
        let bytes = ids.iter().flat_map(|id| id.to_le_bytes()).collect();
        write(name, &[("input_ids", Dtype::I64, vec![ids.len()], bytes)])
    };
    let good = ids("good", &[3, 4, 5]);
    assert!(run("dance", &good, &[]).contains("dance"));
    assert!(run("encoder", &folder.file("text", b"not tensors"), &[]).contains("text"));
    run("encoder", &folder.at("missing"), &[]);
    run("encoder", &folder.at(""), &[]);
    assert!(run("decoder", &good, &[]).contains("decoder_input_ids"));
    assert!(run("motion", &good, &[]).contains("codes.face"));
    assert!(run("mel", &good, &[]).contains("audio"));
    assert!(run("hubert", &good, &[]).contains("audio.kind"));
    assert!(run("generate", &good, &["--target", "0"]).contains("target"));
    assert!(run("generate", &good, &["--target", "11"]).contains("target"));
    assert!(run("encoder", &ids("large", &[3, 1 << 40]), &[]).contains("input_ids"));
    assert!(run("encoder", &ids("negative", &[-1]), &[]).contains("input_ids"));
    assert!(run("encoder", &ids("outside", &[100_000]), &[]).contains("100000"));
    run("encoder", &ids("none", &[]), &[]);
    run("generate", &ids("none", &[]), &[]);
    let square = write("square", &[("input_ids", Dtype::I64, vec![1, 1], vec![0; 8])]);
    assert!(run("encoder", &square, &[]).contains("input_ids"));
    let short = write("short", &[("input_ids", Dtype::I32, vec![2], vec![0; 8])]);
    assert!(run("encoder", &short, &[]).contains("input_ids"));
    let audio = |name, samples: &[f32]| {
        let bytes = samples.iter().flat_map(|v| v.to_le_bytes()).collect();
        write(name, &[("audio", Dtype::F32, vec![samples.len()], bytes)])
    };
    run("mel", &audio("brief", &[0.5; 399]), &[]);
    run("mel", &audio("silent", &[]), &[]);
    assert!(run("mel", &audio("nan", &[f32::NAN; 800]), &[]).contains("[0] is NaN"));
    let codes = |name, code: i64, count: usize| {
        let tensors = ["codes.face", "codes.hands", "codes.upper", "codes.lower"].map(|name| {
            (name, Dtype::I64, vec![count], vec![code; count].iter().flat_map(|c| c.to_le_bytes()).collect())
        });
        write(name, &tensors)
    };
    for stage in ["motion", "interp"] {
        run(stage, &codes("beyond", 8, 3), &[]);
        run(stage, &codes("far", 70_000, 3), &[]);
        run(stage, &codes("below", -1, 3), &[]);
        run(stage, &codes("no_frames", 0, 0), &[]);
    }
    run("motion", &codes("mask", 7, 3), &[]);
    run("interp", &codes("too_long", 1, 129), &[]);
}
