use super::*;
use crate::glb::Character;
use crate::glb::accessor::numbers;
use serde_json::Value;

fn character(name: &str) -> Vec<u8> {
    std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../cli/tests/characters/").to_owned() + name).unwrap()
}

/// JSON and buffer of a `.glb` file.
fn parts(bytes: &[u8]) -> (Value, Vec<u8>) {
    let file = Glb::split(bytes).unwrap();
    (serde_json::from_str(file.json).unwrap(), file.bin.to_vec())
}

fn nothing(_: &str) -> Result<Vec<u8>, String> {
    Err("not found".to_owned())
}

/// Numbers of every accessor.
fn contents(bytes: &[u8]) -> Vec<Vec<f32>> {
    let character = Character::read(bytes).unwrap();
    let (document, bin) = (character.document(), Glb::split(bytes).unwrap().bin);
    let kinds = ["SCALAR", "VEC2", "VEC3", "VEC4", "MAT4"];
    (0..document.accessors.len()).map(|at| numbers(document, bin, at, &kinds).unwrap().0).collect()
}

#[test]
fn a_plain_file_stays_as_it_is() {
    let bytes = character("character.glb");
    assert!(matches!(packed(&bytes, &mut nothing).unwrap(), Cow::Borrowed(_)));
}

#[test]
fn a_gltf_is_read_with_its_files_and_its_data_inside() {
    let bytes = character("character.glb");
    let (mut json, bin) = parts(&bytes);
    let picture = b"\x89PNG and so on".to_vec();
    json["images"] = json!([{ "uri": "a%20picture.png", "name": "p" }, { "uri": "lost.png" }]);
    json["buffers"][0]["uri"] = json!("the%20data.bin");
    let beside = |name: &str| match name {
        "the data.bin" => Ok(bin.clone()),
        "a picture.png" => Ok(picture.clone()),
        _ => Err("not found".to_owned()),
    };
    let mut inside = json.clone();
    inside["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{}", BASE64.encode(&bin)));
    for (text, mut file) in [
        (format!("\u{feff}\n{json}"), Box::new(beside) as Box<dyn FnMut(&str) -> Result<Vec<u8>, String>>),
        (inside.to_string(), Box::new(nothing)),
    ] {
        let packed = packed(text.as_bytes(), &mut file).unwrap();
        assert_eq!(contents(&packed), contents(&bytes));
        let (json, bin) = parts(&packed);
        assert_eq!(json["buffers"], json!([{ "byteLength": bin.len() }]));
        assert_eq!(json["images"][1], json!({ "uri": "lost.png" }));
        if text.starts_with('\u{feff}') {
            let image = &json["images"][0];
            assert_eq!(
                (&image["mimeType"], &image["name"], image.get("uri")),
                (&json!("image/png"), &json!("p"), None)
            );
            let view = &json["bufferViews"][usize::try_from(image["bufferView"].as_u64().unwrap()).unwrap()];
            let start = usize::try_from(view["byteOffset"].as_u64().unwrap()).unwrap();
            assert_eq!(bin[start..][..picture.len()], picture);
        }
    }
}

#[test]
fn a_buffer_that_cannot_be_had_is_named() {
    let (json, bin) = parts(&character("character.glb"));
    let refused = |uri: &str| {
        let mut json = json.clone();
        json["buffers"][0]["uri"] = uri.into();
        let mut asked = Vec::new();
        let mut file = |name: &str| {
            asked.push(name.to_owned());
            if name == "short.bin" { Ok(bin[..10].to_vec()) } else { Err("No such file".to_owned()) }
        };
        let problem = packed(json.to_string().as_bytes(), &mut file).unwrap_err();
        (problem, asked)
    };
    for (uri, wanted, asked) in [
        ("a.bin", "its buffer 0: `a.bin`: No such file", true),
        ("short.bin", "cut short, 10 of", true),
        ("../a.bin", "outside of the character's folder", false),
        ("sub/%2e%2e/%2e./a.bin", "outside of the character's folder", false),
        ("/etc/passwd", "outside of the character's folder", false),
        ("https://example.org/a.bin", "at another place (https:)", false),
        ("file:///a.bin", "at another place (file:)", false),
        ("C:\\a.bin", "at another place (C:)", false),
        ("data:text/plain,abc", "not in base64", false),
        ("data:;base64,a", "base64", false),
    ] {
        let (problem, files) = refused(uri);
        assert!(problem.contains(wanted), "{uri}: {problem}");
        assert_eq!(files.len(), usize::from(asked), "{uri}");
    }
    assert!(packed(b"RIFF", &mut nothing).unwrap_err().contains("not a glb file"));
    assert!(packed(b"{ \"buffers\": 3 }", &mut nothing).unwrap_err().contains("buffers"));
}

#[test]
fn what_meshopt_compressed_is_as_it_was_before() {
    let packed = packed(&character("meshopt.glb"), &mut nothing).unwrap().into_owned();
    let (json, _) = parts(&packed);
    assert_eq!(json["extensionsUsed"], json!(["KHR_mesh_quantization"]));
    assert!(!json.to_string().contains("meshopt"));
    let plain = character("character.glb");
    let [packed, plain] = [&packed, &plain].map(|bytes| Character::read(bytes).unwrap());
    let names =
        |character: &Character| character.rig().bones().iter().map(|bone| bone.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&packed), names(&plain));
    for bone in 0..plain.rig().len() {
        let (a, b) = (packed.rig().place(bone), plain.rig().place(bone));
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4), "bone {bone}: {a:?} {b:?}");
    }
}

#[test]
fn a_view_that_cannot_be_decompressed_is_refused_with_a_way_out() {
    let bytes = character("meshopt.glb");
    let (json, mut bin) = parts(&bytes);
    let compressed = &json["bufferViews"][1]["extensions"]["EXT_meshopt_compression"];
    // The vertex version of a later extension.
    bin[usize::try_from(compressed["byteOffset"].as_u64().unwrap()).unwrap()] = 0xa1;
    let newer = container(json.to_string().into_bytes(), &bin, &[]).unwrap();
    let problem = packed(&newer, &mut nothing).unwrap_err();
    for wanted in ["its view 1", "EXT_meshopt_compression", "version 1", "npx @gltf-transform/cli copy"] {
        assert!(problem.contains(wanted), "{problem}");
    }
}

#[test]
fn no_change_of_a_byte_makes_it_panic() {
    let bytes = character("meshopt.glb");
    for at in (0..bytes.len()).step_by(3) {
        let mut changed = bytes.clone();
        changed[at] ^= 1 << (at % 8);
        let _ = packed(&changed, &mut nothing);
    }
}
