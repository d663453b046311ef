//! `umo view`: its pages and its refusals. The rendering is tested in a browser
//! (`scripts/test/page`).

use super::program::{Ended, Folder, golden, umo, voice};

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

/// A `.glb` file with only this JSON.
fn glb(json: &str) -> Vec<u8> {
    let text = format!("{json}{}", " ".repeat(json.len().next_multiple_of(4) - json.len()));
    let word = |length: usize| u32::try_from(length).unwrap().to_le_bytes();
    [&b"glTF"[..], &word(2), &word(20 + text.len()), &word(text.len()), b"JSON", text.as_bytes()].concat()
}

/// The JSON of a `.glb` file with part of its text replaced.
fn replaced(file: &[u8], from: &str, to: &str) -> Vec<u8> {
    let length = usize::try_from(u32::from_le_bytes(file[12..16].try_into().unwrap())).unwrap();
    let json = std::str::from_utf8(&file[20..20 + length]).unwrap();
    assert!(json.contains(from), "{from}");
    let head = glb(json.replace(from, to).trim_end());
    let total = u32::try_from(head.len() + file.len() - 20 - length).unwrap().to_le_bytes();
    [&head[..8], &total, &head[12..], &file[20 + length..]].concat()
}

#[test]
fn a_character_wears_the_motion() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("mel_k2_arkit"));
    umo(&["animate", &speech, "--model", &model, "-o", &folder.at("motion.glb")]).success();
    // Bones with unknown names, and no animation.
    let stranger = replaced(&folder.read("motion.glb"), "\"animations\":", "\"extras\":");
    let stranger = ["pelvis", "spine1"]
        .iter()
        .fold(stranger, |glb, name| replaced(&glb, &format!("\"{name}\""), &format!("\"their_{name}\"")));
    let (stranger, page) = (folder.file("stranger.glb", &stranger), folder.at("page.html"));
    let names = "[bones]\npelvis = \"their_pelvis\"\nspine1 = \"their_spine1\"\n";
    let mapping = folder.file("bones.toml", names.as_bytes());
    view(&[&speech, "--onto", &stranger, "--mapping", &mapping, "-o", &page]).success();
    let onto = String::from_utf8(folder.read("page.html")).unwrap();
    assert!(onto.contains("\"character\":{\"nodes\":[") && onto.contains("id=\"block-character\""));
    assert!(onto.contains("\"record\":{") && onto.contains("id=\"block-audio\""));
    assert!(onto.contains("\"mesh\":{\"moving\":0,"), "the figure stays at home");
    // The output of `umo retarget` is complete, and is shown without the speech.
    let moved = folder.at("moved.glb");
    umo(&["retarget", &speech, "--model", &model, "--onto", &stranger, "--mapping", &mapping, "-o", &moved]).success();
    let ended = view(&[&moved, "--mapping", &mapping, "-o", &page]).success();
    assert!(ended.out.contains("page.html: 16 frames"), "{}", ended.out);
    let own = String::from_utf8(folder.read("page.html")).unwrap();
    let block =
        |page: &str| page.split("id=\"block-character\">").nth(1).unwrap().split('<').next().unwrap().to_owned();
    assert_eq!(block(&own), block(&onto), "the page has what `umo retarget` writes");
    assert!(own.contains("\"record\":null") && own.contains("\"audio\":null"));
    // A character of another program with umo's bone names is shown too; umo's own motion is shown on its figure.
    let motion = folder.read("motion.glb");
    for (name, glb, worn) in [("theirs.glb", replaced(&motion, "\"umo ", "\"abc "), true), ("ours.glb", motion, false)]
    {
        view(&[&folder.file(name, &glb), "-o", &page]).success();
        let page = String::from_utf8(folder.read("page.html")).unwrap();
        assert_eq!(page.contains("id=\"block-character\""), worn, "{name}");
    }
}

#[test]
fn files_that_are_no_characters_are_refused_in_words() {
    let folder = Folder::new();
    let speech = folder.speech();
    let refused = |args: &[&str]| folder.refused(&[&["view", "--no-open"], args].concat());
    let onto = |name: &str, bytes: &[u8]| refused(&[&speech, "--onto", &folder.file(name, bytes)]);
    assert!(onto("text.glb", b"not a character").contains("text.glb: not a glb file"));
    assert!(onto("cut.vrm", b"glTF\x02\0\0\0\xff\0\0\0").contains("cut.vrm: the file is cut short"));
    assert!(onto("bones.bvh", b"HIERARCHY").contains("bones and no body"));
    assert!(onto("person.gltf", b"{}").contains("person.gltf: no recognised humanoid skeleton"));
    let elsewhere = br#"{"buffers":[{"byteLength":4,"uri":"https://example.org/a.bin"}]}"#;
    assert!(onto("person.gltf", elsewhere).contains("`https://example.org/a.bin` is at another place"));
    assert!(onto("person.obj", b"v 0 0 0").contains("expected a character, .glb, .gltf or .vrm"));
    let thing = glb(r#"{"asset":{"version":"2.0"},"nodes":[{"name":"box","mesh":0}],"meshes":[{"primitives":[]}]}"#);
    assert!(onto("box.glb", &thing).contains("box.glb: no recognised humanoid skeleton"));
    assert!(refused(&[&folder.file("box.glb", &thing)]).contains("box.glb: no recognised humanoid skeleton"));
    assert!(refused(&[&speech, "--onto", &folder.at("missing.vrm")]).contains("missing.vrm"));

    umo(&["animate", &speech, "--model", &golden("mel_k2_arkit"), "-o", &folder.at("motion.glb")]).success();
    let figure = folder.read("motion.glb");
    let packed = replaced(&figure, "\"asset\":", "\"extensionsRequired\":[\"KHR_texture_basisu\"],\"asset\":");
    assert!(onto("packed.glb", &packed).contains("its textures are compressed"));
    let bare = replaced(&figure, "\"meshes\":", "\"extras\":");
    assert!(onto("bare.glb", &bare).contains("it lacks a mesh to show"));
    let still = replaced(&figure, "\"animations\":", "\"extras\":");
    assert!(refused(&[&folder.file("still.glb", &still)]).contains("still.glb: it has no animation"));
    let mapping = folder.file("bones.toml", b"[bones]\n");
    assert!(refused(&[&speech, "--mapping", &mapping]).contains("--mapping goes with a character"));
    assert_eq!(umo(&["view", &speech, "--onto", "a.glb", "--figure", "performer"]).code, 2);
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
    for args in [&["view"][..], &["view", &speech, "--port", "80"]] {
        assert_eq!(umo(args).code, 2, "{args:?}");
    }
}

/// The page's description.
fn description(page: &[u8]) -> serde_json::Value {
    let page = std::str::from_utf8(page).unwrap();
    serde_json::from_str(page.split("id=\"scene\">").nth(1).unwrap().split("</script>").next().unwrap()).unwrap()
}

#[test]
fn a_page_to_judge_has_equal_pieces_of_every_take() {
    let folder = Folder::new();
    let [one, two] = [("one.wav", 10.0), ("two.wav", 17.0)].map(|(name, seconds)| long(&folder, name, seconds));
    let page = folder.at("judge.html");
    let ended = view(&["--judge", &one, &two, "-o", &page]).success();
    assert!(ended.out.contains("judge.html: 720 frames"), "{}", ended.out);
    let first = folder.read("judge.html");
    let scene = description(&first);
    let takes = serde_json::json!([{ "name": one, "pieces": 1 }, { "name": two, "pieces": 2 }]);
    assert_eq!(scene["judge"], serde_json::json!({ "seconds": 8, "frames": 240, "takes": takes }));
    assert!(std::str::from_utf8(&first).unwrap().contains("data-main=\"umo/judge.js\""));
    view(&["--judge", &one, &two, "-o", &page]).success();
    assert!(folder.read("judge.html") == first, "the same seed gives the same page");

    // A finished motion, as captured ones are, beside one that is animated.
    let motion = folder.at("two.jsonl");
    umo(&["animate", &two, "--model", &golden("mel_k2_arkit"), "-o", &motion]).success();
    view(&["--judge", &one, &format!("{motion}={two}"), "-o", &page]).success();
    assert_eq!(description(&folder.read("judge.html"))["judge"], scene["judge"]);
}

#[test]
fn a_page_that_would_not_test_is_not_written() {
    let folder = Folder::new();
    let [one, two, short] =
        [("one.wav", 8.5), ("two.wav", 8.5), ("short.wav", 3.0)].map(|(name, seconds)| long(&folder, name, seconds));
    let (page, model) = (folder.at("judge.html"), golden("mel_k2_arkit"));
    let motion = folder.at("short.jsonl");
    umo(&["animate", &short, "--model", &model, "-o", &motion]).success();
    let refused = |given: &[&str]| {
        folder.refused(&[&["view", "--no-open", "--model", &model, "-o", &page, "--judge"], given].concat())
    };
    assert!(refused(&[&one]).contains("two recordings or more, of 8 s or more each"));
    assert!(refused(&[&one, &one]).contains("one.wav: it is given twice"));
    let problem = refused(&[&one, &short]);
    assert!(problem.contains("short.wav: 3.0 s are too short") && problem.contains("join recordings"), "{problem}");
    assert!(refused(&[&one, &format!("{motion}={two}")]).contains("short.jsonl: 3.0 s are too short"));
    assert!(refused(&[&one, &motion]).contains("short.jsonl=SPEECH.wav"));
    assert!(refused(&[&one, &folder.at("missing.wav")]).contains("no such file"));
    umo(&["animate", &two, "--model", &golden("mel_k1_upcycled"), "-o", &folder.at("two.jsonl")]).success();
    assert!(refused(&[&one, &format!("{}={two}", folder.at("two.jsonl"))]).contains("two.wav: its motion has another"));
    for more in [&["--onto", "a.glb"][..], &["--audio", &one], &["--web", "www"]] {
        assert_eq!(umo(&[&["view", "-o", &page, "--judge", &one, &two], more].concat()).code, 2, "{more:?}");
    }
    assert_eq!(umo(&["view", "--judge", &one, &two]).code, 2, "a page without a name");
}

/// A recording of this length.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "seconds of a test")]
fn long(folder: &Folder, name: &str, seconds: f64) -> String {
    folder.wav(name, &voice((seconds * 16_000.0) as usize))
}

/// A folder like the npm package, with empty files.
fn package(folder: &Folder) -> String {
    for (name, text) in
        [("dist/umo.wasm", "wasm"), ("src/index.js", "js"), ("src/index.d.ts", "types"), ("LICENSE-MIT", "MIT")]
    {
        let path = folder.at(&format!("package/{name}"));
        std::fs::create_dir_all(std::path::Path::new(&path).parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    folder.at("package")
}

#[test]
fn a_folder_for_web_servers_has_page_package_and_model() {
    let folder = Folder::new();
    let (speech, package, www) = (folder.speech(), package(&folder), folder.at("www"));
    let written = |more: &[&str]| {
        view(&[&["--web", &www, "--package", &package][..], more].concat()).success();
        String::from_utf8(folder.read("www/index.html")).unwrap()
    };
    let page = written(&[&speech, "--seed", "18446744073709551615", "--voice", "delayed"]);
    assert!(page.contains("id=\"block-audio\"") && page.contains("connect-src 'self';"));
    assert!(page.contains(r#""hasMouth":true,"voice":"delayed""#));
    assert!(page.contains(
        r#""engine":{"package":"umo/src/index.js","model":"model.safetensors.gz","precision":"stored","session""#
    ));
    assert!(page.contains(r#""seed":"18446744073709551615""#) && page.contains(r#""parameters":[]"#));
    for (name, text) in [("umo/dist/umo.wasm", "wasm"), ("umo/src/index.js", "js"), ("umo/LICENSE-MIT", "MIT")] {
        assert_eq!(folder.read(&format!("www/{name}")), text.as_bytes());
    }
    assert!(!std::path::Path::new(&folder.at("www/umo/src/index.d.ts")).exists());
    let mut model = Vec::new();
    let compressed = folder.read("www/model.safetensors.gz");
    std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(&compressed[..]), &mut model).unwrap();
    assert_eq!(model, std::fs::read(golden("mel_k2_arkit")).unwrap());
    assert_eq!(
        folder.read("www/model.safetensors.gz"),
        {
            written(&[]);
            compressed
        },
        "the same bytes again"
    );
    let page = written(&["--greedy", "--layers", "0.5"]);
    assert!(page.contains(r#""voice":null"#) && page.contains(r#""parameters":[[1,0.0],[32,0.5],"#));
}

#[test]
fn a_folder_for_web_servers_may_show_ones_own_character() {
    let folder = Folder::new();
    let (speech, package, www, own) = (folder.speech(), package(&folder), folder.at("www"), folder.at("own.glb"));
    umo(&["animate", &speech, "-o", &own, "--model", &golden("mel_k2_arkit")]).success();
    let mapping = folder.at("mapping.toml");
    std::fs::write(&mapping, "[bones]\njaw = \"\"\n").unwrap();
    view(&["--web", &www, "--package", &package, &speech, "--onto", &own, "--mapping", &mapping]).success();
    let page = String::from_utf8(folder.read("www/index.html")).unwrap();
    assert!(page.contains("id=\"block-character\""));
    let json = page.split("id=\"scene\">").nth(1).unwrap().split("</script>").next().unwrap();
    let scene: serde_json::Value = serde_json::from_str(json).unwrap();
    // The page's own engine moves bones and shapes, by the file and this mapping.
    assert_eq!(scene["character"]["given"]["bones"], serde_json::json!({ "jaw": "" }));
    let refused =
        |more: &[&str]| folder.refused(&[&["view", "--no-open", "--web", &www, "--package", &package], more].concat());
    assert!(refused(&["--mapping", &own]).contains("--onto"));
    assert!(refused(&["--onto", &speech]).contains("expected a character"));
}

#[test]
fn a_folder_for_web_servers_is_not_begun_without_what_it_needs() {
    let folder = Folder::new();
    let (package, www) = (package(&folder), folder.at("www"));
    let refused = |args: &[&str]| folder.refused(&[&["view", "--no-open", "--web", &www], args].concat());
    assert!(refused(&["--package", &folder.at("none")]).contains("umo-web"));
    assert!(refused(&[]).contains("node_modules/umo-web"));
    for more in [["--isa", "scalar"], ["--threads", "1"], ["--gesture", "wave"], ["--start-pose", "x.npz"]] {
        assert!(refused(&[&["--package", &package][..], &more].concat()).contains(more[0]), "{more:?}");
    }
    let voice = ["--package", &package, "--model", &golden("mel_k1_upcycled"), "--voice", "live"];
    assert!(refused(&voice).contains("mouth network"));
    assert!(!std::path::Path::new(&www).exists());
    for args in [&["-o", "x.html"][..], &["--port", "80"]] {
        assert_eq!(umo(&[&["view", "--web", &www], args].concat()).code, 2, "{args:?}");
    }
    let (speech, package) = (folder.speech(), package.as_str());
    assert_eq!(umo(&["view", &speech, "--package", package]).code, 2, "a package without --web");
    assert_eq!(umo(&["view", &speech, "--voice", "live"]).code, 2, "a voice without a stream");
}

#[test]
fn a_port_that_is_taken_is_the_machines_fault() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let ended = umo(&["live", "--no-open", "--model", &golden("mel_k2_arkit"), "--port", &port]);
    assert_eq!(ended.code, 1, "{}", ended.err);
    assert!(ended.err.contains(&port), "{}", ended.err);
}

#[test]
fn a_page_is_not_served_without_what_it_needs() {
    let folder = Folder::new();
    let refused = |args: &[&str]| folder.refused(&[&["live", "--no-open"], args].concat());
    let mapping = folder.file("bones.toml", b"[bones]\n");
    assert!(refused(&["--mapping", &mapping]).contains("--mapping goes with a character"));
    let thing = glb(r#"{"asset":{"version":"2.0"},"nodes":[{"name":"box","mesh":0}],"meshes":[{"primitives":[]}]}"#);
    let other = folder.file("other.glb", &thing);
    assert!(refused(&["--onto", &other]).contains("other.glb: no recognised humanoid skeleton"));
    for more in [["--start-pose", "x.npz"], ["--gesture", "wave"]] {
        assert!(refused(&more).contains(more[0]), "{more:?}");
    }
    assert!(refused(&["-"]).contains("--vmc"));
    let voice = ["--model", &golden("mel_k1_upcycled"), "--voice", "live"];
    assert!(refused(&voice).contains("mouth network"));
    // Options of the page do not go with other programs, nor theirs with the page.
    let vmc = ["--vmc", "127.0.0.1:39539"];
    for more in [["--port", "80"], ["--figure", "bea"], ["--onto", "a.glb"]] {
        let ended = umo(&[&["live"][..], &vmc, &more].concat());
        assert!(ended.code == 2 && ended.err.contains("cannot be used with"), "{more:?}: {}", ended.err);
    }
    assert_eq!(umo(&["live", "--no-open", "--rate", "16000"]).code, 2);
}
