//! `umo converse`: one file of all members, a file for each, channels, places, and refusals.

use hound::{SampleFormat, WavSpec, WavWriter};

use super::program::{Ended, Folder, golden, umo, voice};

fn converse(args: &[&str]) -> Ended {
    umo(&[&["converse", "--model", &golden("mel_k2_arkit")], args].concat())
}

/// Two recordings of different length.
fn pair(folder: &Folder) -> [String; 2] {
    let late: Vec<f32> = [vec![0.0; 8000], voice(8000)].concat();
    [folder.wav("ada.wav", &voice(9000)), folder.wav("bob.wav", &late)]
}

/// JSON of a .glb file.
fn json(glb: &[u8]) -> serde_json::Value {
    let length = usize::try_from(u32::from_le_bytes(glb[12..16].try_into().unwrap())).unwrap();
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

#[test]
fn one_file_holds_all_members_and_the_same_command_gives_its_bytes_again() {
    let folder = Folder::new();
    let [ada, bob] = pair(&folder);
    let (out, again) = (folder.at("scene.glb"), folder.at("again.glb"));
    let ended = converse(&[&ada, &bob, "-o", &out, "--threads", "1"]).success();
    assert!(ended.out.contains("scene.glb: 2 members, 30 frames, 1.00 s"), "{}", ended.out);
    converse(&[&ada, &bob, "-o", &again, "--threads", "3"]).success();
    let scene = folder.read("scene.glb");
    assert!(scene == folder.read("again.glb"), "threads changed the scene");
    let json = json(&scene);
    let nodes = json["nodes"].as_array().unwrap();
    let node = |name: &str| nodes.iter().find(|node| node["name"] == name).unwrap();
    let place = |name: &str| node(name)["translation"][0].as_f64().unwrap();
    assert!((place("ada") + 0.6).abs() < 1e-5 && (place("bob") - 0.6).abs() < 1e-5);
    assert_eq!(node("face")["mesh"], node("bob-face")["mesh"], "members share the figure");
}

#[test]
fn every_member_has_a_file_in_any_format() {
    let folder = Folder::new();
    let [ada, bob] = pair(&folder);
    let outputs = ["ada.jsonl", "bob.npz"].map(|name| folder.at(name));
    converse(&[&ada, &bob, "-o", &outputs[0], "-o", &outputs[1], "-o", &folder.at("page.html")]).success();
    let lines = String::from_utf8(folder.read("ada.jsonl")).unwrap();
    assert_eq!(lines.lines().count(), 1 + 30, "silent after its end");
    assert!(folder.read("bob.npz").starts_with(b"PK"));
    let page = String::from_utf8(folder.read("page.html")).unwrap();
    let description = page.split("id=\"scene\">").nth(1).unwrap().split("</script>").next().unwrap();
    let description: serde_json::Value = serde_json::from_str(description).unwrap();
    assert_eq!(description["room"][1]["name"], "bob");
    for block in ["frames-0", "frames-1", "audio-0", "audio-1"] {
        assert!(page.contains(&format!("id=\"block-{block}\">")), "{block}");
    }
    // Other figures are beside the first.
    converse(&[&ada, &bob, "-o", &folder.at("page.html"), "--figure", "alex,bea"]).success();
    assert!(String::from_utf8(folder.read("page.html")).unwrap().contains("id=\"block-positions-1\">"));
}

#[test]
fn a_file_of_all_members_has_a_page_and_goes_to_a_character_for_each() {
    let folder = Folder::new();
    let [ada, bob] = pair(&folder);
    let (scene, page) = (folder.at("scene.glb"), folder.at("page.html"));
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/characters/character.glb");
    converse(&[&ada, &bob, "-o", &scene, "--figure", "carl,bea", "--places", "-1,0,60 1,0.5,-90"]).success();
    let view = |args: &[&str]| umo(&[&["view", &scene, "-o", &page, "--no-open"], args].concat());
    let ended = view(&["--audio", &ada, "--audio", &bob]).success();
    assert!(ended.out.contains("page.html: 30 frames"), "{}", ended.out);
    let described = || {
        let page = String::from_utf8(folder.read("page.html")).unwrap();
        let json = page.split("id=\"scene\">").nth(1).unwrap().split("</script>").next().unwrap();
        (serde_json::from_str::<serde_json::Value>(json).unwrap(), page)
    };
    let (description, html) = described();
    let member = &description["room"][1];
    assert_eq!((&member["name"], &member["figure"]), (&"bob".into(), &1.into()));
    assert_eq!(member["position"], serde_json::json!([1.0, 0.0, 0.5]));
    assert!((member["facing"].as_f64().unwrap() + std::f64::consts::FRAC_PI_2).abs() < 1e-6);
    assert!(!html.contains("id=\"block-audio-1\"></script>"), "bob is heard");
    view(&["--figure", "dina"]).success();
    let (description, html) = described();
    assert_eq!((&description["room"][1]["figure"], &description["otherMeshes"]), (&0.into(), &serde_json::json!([])));
    assert!(html.contains("id=\"block-audio-1\"></script>"), "silent");

    assert!(folder.refused(&["view", &scene, "--audio", &ada]).contains("2 members, but 1 voices"));
    assert!(folder.refused(&["view", &scene, "--onto", own]).contains("`umo retarget` writes a character for each"));
    let moved = ["a.glb", "b.glb"].map(|name| folder.at(name));
    let onto = ["--onto", own, "-o", &moved[0]];
    let refused = folder.refused(&[&["retarget", &*scene], &onto[..]].concat());
    assert!(refused.contains("2 members, ada, bob, but 1 outputs"), "{refused}");
    let both = [&onto[..], &["-o", &moved[1]]].concat();
    assert!(folder.refused(&[&["retarget", &*ada], &both[..]].concat()).contains("one motion, but 2 outputs"));
    let ended = umo(&[&["retarget", &*scene], &both[..]].concat()).success();
    assert!(ended.out.contains("a.glb: 30 frames") && ended.out.contains("b.glb: 30 frames"), "{}", ended.out);
    assert!(folder.read("a.glb") != folder.read("b.glb"), "each has its own motion");
}

/// A recording with two channels.
fn channels(folder: &Folder) -> String {
    let path = folder.at("two.wav");
    let spec = WavSpec { channels: 2, sample_rate: 16_000, bits_per_sample: 32, sample_format: SampleFormat::Float };
    let mut out = WavWriter::create(&path, spec).unwrap();
    for (at, sample) in voice(16_000).into_iter().enumerate() {
        // Each in turn, and a twentieth of it in the other channel.
        let turn = at < 8000;
        for own in [turn, !turn] {
            out.write_sample(if own { sample } else { 0.05 * sample }).unwrap();
        }
    }
    out.finalize().unwrap();
    path
}

#[test]
fn channels_are_members() {
    let folder = Folder::new();
    let path = channels(&folder);
    let places = folder.file("places.txt", b"-1,0,90\n1,0,-90\n");
    let out = folder.at("scene.glb");
    converse(&["--channels", &path, "--places", &places, "-o", &out]).success();
    let json = json(&folder.read("scene.glb"));
    let nodes = json["nodes"].as_array().unwrap();
    let node = nodes.iter().find(|node| node["name"] == "channel-2").unwrap();
    assert_eq!(node["translation"][0], 1.0);
    // The first is a person.
    converse(&["--channels", &path, "--person", "1", "-o", &out]).success();
    assert!(!String::from_utf8_lossy(&folder.read("scene.glb")).contains("channel-1"));
}

#[test]
fn a_person_is_heard_and_has_no_avatar() {
    let folder = Folder::new();
    let [ada, bob] = pair(&folder);
    let [scene, page, own] = ["scene.glb", "page.html", "own.jsonl"].map(|name| folder.at(name));
    let made = |args: &[&str]| {
        converse(&[args, &["-o", &own]].concat()).success();
        folder.read("own.jsonl")
    };
    let ended = converse(&[&bob, "--person", &ada, "-o", &scene, "-o", &page]).success();
    assert!(ended.out.contains("2 members, 30 frames"), "{}", ended.out);
    let json = json(&folder.read("scene.glb"));
    assert!(json["nodes"].as_array().unwrap().iter().all(|node| node["name"] != "ada"));
    let html = String::from_utf8(folder.read("page.html")).unwrap();
    assert!(html.contains("\"people\":[{\"name\":\"ada\"") && html.contains("id=\"block-person-0\">"));
    // Who speaks is looked at, wherever they stand.
    let left = made(&[&bob, "--person", &ada, "--places", "0,0,0 -1,0,0"]);
    let right = made(&[&bob, "--person", &ada, "--places", "0,0,0 1,0,0"]);
    assert!(left != right, "the person is not looked at");
    let alone = folder.refused(&["converse", &bob, "-o", &own]);
    assert!(alone.contains("2 to 32 members, this one 1"), "{alone}");
}

#[test]
fn words_and_prompts_are_each_avatars_own() {
    let folder = Folder::new();
    let [ada, bob] = pair(&folder);
    let names = ["a.jsonl", "b.jsonl"].map(|name| folder.at(name));
    let words = folder.file("words.srt", b"1\n00:00:00,300 --> 00:00:00,700\nno\n");
    let made = |more: &[&str]| {
        let outputs = ["-o", &names[0], "-o", &names[1]];
        let places = ["--places", "0,0,0 2,0,0"];
        converse(&[&[&*ada, &bob], &outputs[..], &places, more].concat()).success();
        ["a.jsonl", "b.jsonl"].map(|name| folder.read(name))
    };
    let plain = made(&[]);
    let said = made(&["--words", "-", "--words", &words]);
    assert!(plain[0] == said[0] && plain[1] != said[1], "the words are the second's");
    let refused =
        |more: &[&str]| folder.refused(&[&["converse", &*ada, &bob, "-o", &names[0], "-o", &names[1]], more].concat());
    assert!(refused(&["--words", &words]).contains("1 --words for 2 avatars"));
    assert!(refused(&["--prompt", "a", "--prompt", "b", "--prompt", "c"]).contains("3 --prompt for 2 avatars"));
}

#[test]
fn conversations_that_cannot_be_are_refused_before_the_work() {
    let folder = Folder::new();
    let [ada, bob] = pair(&folder);
    let (scene, npz) = (folder.at("scene.glb"), folder.at("a.npz"));
    let refused = |args: &[&str]| folder.refused(&[&["converse"], args].concat());
    assert!(refused(&[&ada, "-o", &scene]).contains("2 to 32 members, this one 1"));
    let many: Vec<&str> = (0..33).map(|_| &*ada).collect();
    assert!(refused(&[&many[..], &["-o", &scene]].concat()).contains("this one 33"));
    assert!(refused(&[&ada, &bob, "-o", &npz]).contains("1 outputs for 2 avatars"));
    assert!(refused(&[&ada, &bob, "-o", &npz, "-o", &scene, "-o", &folder.at("b.bvh")]).contains("3 outputs for 2"));
    assert!(refused(&[&ada, &bob, "-o", &scene, "--places", "0,0,0"]).contains("1 places for 2 members"));
    assert!(refused(&[&ada, &bob, "-o", &scene, "--places", "0,0 1,0,0"]).contains("`0,0`: expected a place"));
    assert!(refused(&["--channels", &ada, "-o", &scene]).contains("this one 1"));
    let two = channels(&folder);
    assert!(
        refused(&["--channels", &two, "--person", "3", "-o", &scene])
            .contains("--person 3: expected a channel, 1 to 2")
    );
    assert!(refused(&["--channels", &two, "--person", "1", "--person", "2", "-o", &scene]).contains("needs an avatar"));
    assert!(refused(&[&ada, &bob, "-o", &scene, "--gesture", "wave"]).contains("--gesture does not go"));
    assert!(refused(&[&ada, &folder.at("none.wav"), "-o", &scene]).contains("none.wav"));
    assert!(refused(&[&ada, &bob, "-o", &ada, "-o", &folder.at("b.npz")]).contains("input and an output"));
}
