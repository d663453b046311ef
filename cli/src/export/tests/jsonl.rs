use super::*;
use serde_json::Value;

fn lines(clip: &Clip) -> Vec<Value> {
    let bytes = bytes_of(|clip, out| super::super::jsonl::write(clip, out), clip);
    let text = String::from_utf8(bytes).unwrap();
    assert!(text.ends_with('\n'));
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn get<T: serde::de::DeserializeOwned>(value: &Value, pointer: &str) -> T {
    let found = value.pointer(pointer).unwrap_or_else(|| panic!("no {pointer}"));
    serde_json::from_value(found.clone()).unwrap()
}

#[test]
fn jsonl_describes_itself_in_its_first_line() {
    let clip = sample::clip(FaceKind::Arkit, 4, 1);
    let header = &lines(&clip)[0];
    assert_eq!(get::<String>(header, "/format"), "umo-animation");
    assert_eq!(get::<u32>(header, "/version"), 1);
    assert_eq!(get::<f32>(header, "/frame_rate"), 30.0);
    assert_eq!(get::<usize>(header, "/frames"), 4);
    assert_eq!(get::<Vec<String>>(header, "/joints"), umo_core::JOINT_NAMES);
    assert_eq!(get::<Vec<i32>>(header, "/parents"), clip.skeleton.parents);
    assert_eq!(get::<Vec<[f32; 3]>>(header, "/offsets"), clip.skeleton.offsets_m);
    assert_eq!(get::<String>(header, "/face/kind"), "arkit");
    assert_eq!(get::<Vec<String>>(header, "/face/names"), clip.face.names);
    assert_eq!(get::<String>(header, "/axes/y"), "up");
    assert_eq!(get::<String>(header, "/units/time"), "seconds");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn jsonl_keeps_every_number(clip in any_clip(FaceKind::SmplxExpression, 2)) {
        let lines = lines(&clip);
        prop_assert_eq!(lines.len(), 3);
        for (frame, line) in lines[1..].iter().enumerate() {
            prop_assert_eq!(get::<usize>(line, "/frame"), frame);
            prop_assert_eq!(get::<f64>(line, "/time"), frame as f64 / 30.0);
            prop_assert_eq!(get::<[f32; 3]>(line, "/translation"), clip.translation[frame]);
            let rotations = get::<Vec<[f32; 4]>>(line, "/rotations");
            prop_assert_eq!(rotations.as_slice(), clip.rotations[frame].as_slice());
            let face = get::<Vec<f32>>(line, "/face");
            prop_assert_eq!(face.as_slice(), clip.face(frame));
        }
    }
}

#[test]
fn jsonl_is_read_back_exactly() {
    for kind in KINDS {
        let clip = sample::clip(kind, 3, 1);
        let bytes = bytes_of(|clip, out| super::super::jsonl::write(clip, out), &clip);
        let text = String::from_utf8(bytes).unwrap();
        assert_eq!(super::super::jsonl::read(&text).unwrap(), clip);
        for (broken, expected) in [
            (text.replacen("umo-animation", "other", 1), "line 1"),
            (text.replacen("\"version\":1", "\"version\":2", 1), "line 1"),
            (text.replacen("\"kind\":\"", "\"kind\":\"un", 1), "unknown kind of face"),
            (text.replacen("\"face\":[0.0", "\"face\":[0.0,0.0", 1), "face values"),
            (text[..text.len() / 2].to_owned(), "line"),
            (String::new(), "empty"),
        ] {
            let cause = super::super::jsonl::read(&broken).unwrap_err();
            assert!(cause.contains(expected), "{cause}");
        }
    }
}
