//! `umo retarget` onto umo's own files, which are characters like any other.

use super::program::{Folder, golden, umo};

/// A character, a skeleton, and the same motion in other formats.
fn made(folder: &Folder) -> [String; 4] {
    let names = ["own.glb", "own.bvh", "own.npz", "own.jsonl"].map(|name| folder.at(name));
    let (speech, model) = (folder.speech(), golden("mel_k2_arkit"));
    let mut args = vec!["animate", &speech, "--model", &model];
    args.extend(names.iter().flat_map(|name| ["-o", name]));
    umo(&args).success();
    names
}

#[test]
fn speech_and_motions_are_brought_to_characters_and_skeletons() {
    let folder = Folder::new();
    let [glb, bvh, npz, jsonl] = made(&folder);
    let (speech, model) = (folder.at("speech.wav"), golden("mel_k2_arkit"));
    for (onto, out) in [(&glb, folder.at("out.glb")), (&bvh, folder.at("out.bvh"))] {
        for input in [&speech, &glb, &bvh, &npz, &jsonl] {
            let ended = umo(&["retarget", input, "--onto", onto, "-o", &out, "--model", &model]).success();
            assert!(ended.out.contains("16 frames, 0.53 s") && ended.out.contains("SMPL-X names"), "{}", ended.out);
        }
    }
    // The speech and the file made of it give the same result.
    umo(&["retarget", &speech, "--onto", &bvh, "-o", &folder.at("a.bvh"), "--model", &model]).success();
    umo(&["retarget", &jsonl, "--onto", &bvh, "-o", &folder.at("b.bvh")]).success();
    let numbers = |name: &str| -> Vec<f64> {
        let text = String::from_utf8(folder.read(name)).unwrap();
        text.split_once("Frame Time:").unwrap().1.split_whitespace().map(|word| word.parse().unwrap()).collect()
    };
    let (a, b) = (numbers("a.bvh"), numbers("b.bvh"));
    assert_eq!(a.len(), b.len());
    // If the middle angle is near a right angle, the Euler angles may differ: most agree.
    let near = a.iter().zip(&b).filter(|(a, b)| (**a - **b).abs() < 0.01).count();
    assert!(near * 100 > a.len() * 99, "{near} of {}", a.len());
}

#[test]
fn a_character_is_inspected_and_said_what_it_lacks() {
    let folder = Folder::new();
    let [glb, bvh, npz, _] = made(&folder);
    let ended = umo(&["inspect", &glb]).success();
    for line in
        ["rest pose  T-pose", "bones      55 by SMPL-X names, for 53 of 53 joints", "shapes     52 of ARKit's 52"]
    {
        assert!(ended.out.contains(line), "{line}: {}", ended.out);
    }
    assert!(umo(&["inspect", &bvh]).success().out.contains("by SMPL-X names"));
    assert!(folder.refused(&["model", "inspect", &glb]).contains("`umo inspect "));
    assert!(folder.refused(&["inspect", "a.safetensors"]).contains("`umo model inspect a.safetensors`"));
    // The up axis, which the motion's file does not state, is reported if it is changed.
    let box_of = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/characters/");
    let [turned, boxes] = ["z_up.npz", "character.glb"].map(|name| format!("{box_of}{name}"));
    let ended = umo(&["retarget", &turned, "--onto", &boxes, "-o", &folder.at("out.glb")]).success();
    assert!(ended.err.contains("it was rotated to Y up"), "{}", ended.err);
    let ended = umo(&["retarget", &npz, "--onto", &boxes, "-o", &folder.at("out.glb")]).success();
    assert!(!ended.err.contains("upright") && !ended.err.contains("rate"), "{}", ended.err);
}

#[test]
fn the_mapping_is_shown_and_may_be_given() {
    let folder = Folder::new();
    let [glb, _, npz, _] = made(&folder);
    let shown = umo(&["retarget", "--onto", &glb, "--print-mapping"]).success();
    for line in ["SMPL-X names", "spine            spine1, spine2, spine3", "jawOpen"] {
        assert!(shown.out.contains(line), "{line}: {}", shown.out);
    }
    // The body in the form of a mapping file.
    for line in ["[body]\ngain = 0\n", "\nbelly = 1 # 0.", "\nthighs = 1 # 0."] {
        assert!(shown.out.contains(line), "{line}: {}", shown.out);
    }
    let body = folder.file("body.toml", b"[body]\ngain = 0.5\nbelly = 1.5\n");
    let shown = umo(&["retarget", "--onto", &glb, "--print-mapping", "--mapping", &body]).success();
    for line in ["\ngain = 0.5\n", "\nbelly = 1.5 # 0."] {
        assert!(shown.out.contains(line), "{line}: {}", shown.out);
    }
    let text = String::from_utf8(folder.read("own.bvh")).unwrap().replace("left_knee", "elbow of the leg");
    let odd = folder.file("odd.bvh", text.as_bytes());
    let refused = folder.refused(&["retarget", &npz, "--onto", &odd, "-o", &folder.at("out.bvh")]);
    for word in ["left_knee", "`elbow of the leg`", "--mapping"] {
        assert!(refused.contains(word), "{refused}");
    }
    let ended = umo(&["retarget", "--onto", &odd, "--print-mapping"]);
    assert!(ended.code == 2 && ended.out.contains("left_knee        -"), "{}", ended.out);
    let mapping = folder.file("map.toml", b"[bones]\nleft_knee = \"elbow of the leg\"\nhead = \"\"\n");
    let ended = umo(&["retarget", &npz, "--onto", &odd, "-o", &folder.at("out.bvh"), "--mapping", &mapping]).success();
    assert!(ended.err.contains("note: no bones for head"), "{}", ended.err);
}

#[test]
fn a_sheet_shows_the_motion_with_or_without_a_file() {
    let folder = Folder::new();
    let [glb, bvh, npz, _] = made(&folder);
    let (out, sheet) = (folder.at("out.glb"), folder.at("sheet.png"));
    let ended = umo(&["retarget", &npz, "--onto", &glb, "-o", &out, "--sheet", &sheet]).success();
    assert!(ended.out.contains("sheet.png: the motion on the figure and on the character"), "{}", ended.out);
    let first = folder.read("sheet.png");
    assert!(first.starts_with(b"\x89PNG") && first.len() > 50_000, "{} bytes", first.len());
    std::fs::remove_file(&sheet).unwrap();
    umo(&["retarget", &npz, "--onto", &glb, "--sheet", &sheet]).success();
    assert!(folder.read("sheet.png") == first, "another picture without a file");
    // Outlines of the body's volume, in one colour, and where there is none.
    let body = folder.file("body.toml", b"[body]\ngain = 1\n");
    umo(&["retarget", &npz, "--onto", &glb, "--sheet", &sheet, "--mapping", &body]).success();
    let outlined = |name: &str| {
        let bytes = folder.read(name);
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels.as_chunks::<3>().0.iter().filter(|pixel| **pixel == [214, 60, 130]).count()
    };
    let count = outlined("sheet.png");
    assert!(count > 6 * 500, "{count} pixels of outlines");
    folder.file("plain.png", &first);
    assert_eq!(outlined("plain.png"), 0);
    for (onto, sheet, word) in [(&bvh, folder.at("s.png"), "no body"), (&glb, folder.at("s.jpg"), "expected .png")] {
        let refused = folder.refused(&["retarget", &npz, "--onto", onto, "--sheet", &sheet]);
        assert!(refused.contains(word), "{refused}");
    }
}

#[test]
fn what_cannot_be_brought_anywhere_is_refused() {
    let folder = Folder::new();
    let [glb, bvh, npz, _] = made(&folder);
    let text = folder.file("a.txt", b"");
    let bad = folder.file("bad.toml", b"[bones]\nnose = \"n\"");
    let out = folder.at("out.glb");
    for (args, word) in [
        (vec!["retarget", &npz, "--onto", &text, "-o", &out], "expected a character"),
        (vec!["retarget", &npz, "--onto", &bvh, "-o", &out], "expected .bvh"),
        (vec!["retarget", &text, "--onto", &glb, "-o", &out], "unknown format"),
        (vec!["retarget", &npz, "--onto", &out, "-o", &out], "(os error 2)"),
        (vec!["retarget", &npz, "--onto", &glb, "-o", &out, "--mapping", &bad], "for joint `nose`"),
        (vec!["retarget", &npz, "--onto", &glb, "-o", &out, "--mapping", &text], ""),
    ] {
        if word.is_empty() {
            // An empty mapping changes nothing, and is valid.
            umo(&args).success();
        } else {
            let refused = folder.refused(&args);
            assert!(refused.contains(word), "{refused}");
        }
    }
    assert_eq!(umo(&["retarget", &npz, "--onto", &glb]).code, 2, "an output is needed");
}

/// The program recognises its own exported figures as characters, with every face channel.
#[test]
fn figures_are_avatars_that_speech_moves() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("mel_k2_arkit"));
    for (name, convention) in [("alex.vrm", "VRM 1.0"), ("bea.glb", "Mixamo names")] {
        let (avatar, out) = (folder.at(name), folder.at(&format!("moved-{name}")));
        umo(&["figure", &name[..name.len() - 4], "-o", &avatar]).success();
        let shown = umo(&["retarget", "--onto", &avatar, "--print-mapping"]).success();
        for line in [convention, "jawOpen ", "eyeLookOutLeft ", "left_index3 ", "15 of 67 have no channel"] {
            assert!(shown.out.contains(line), "{name}: no `{line}` in {}", shown.out);
        }
        let ended = umo(&["retarget", &speech, "--onto", &avatar, "-o", &out, "--model", &model]).success();
        assert!(ended.out.contains("52 shapes"), "{name}: {}", ended.out);
    }
    let refused = folder.refused(&["figure", "alex", "-o", &folder.at("alex.fbx")]);
    assert!(refused.contains(".glb or .vrm"), "{refused}");
}
