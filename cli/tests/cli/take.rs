//! Takes: `umo animate -o x.umo`, `umo play`, and their pages by `umo view`.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};

use super::program::{Folder, golden, umo};

#[test]
fn a_take_plays_the_files_of_its_animation() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("frames_seven"));
    let (words, take) = (folder.file("words.txt", b"No! Never, you and I."), folder.at("motion.umo"));
    let (direct, played, glb) = (folder.at("direct.jsonl"), folder.at("played.jsonl"), folder.at("played.glb"));
    let made = ["animate", &speech, "--model", &model, "--words", &words, "--gesture", "wave@0.3,left", "--seed", "5"];
    umo(&[&made[..], &["-o", &take, "-o", &direct]].concat()).success();
    let ended = umo(&["play", &take, "--model", &model, "-o", &played, "-o", &glb]).success();
    assert!(ended.out.contains("16 frames") && ended.err.is_empty(), "{} {}", ended.out, ended.err);
    assert!(folder.read("direct.jsonl") == folder.read("played.jsonl"));
    assert!(folder.read("played.glb").starts_with(b"glTF"));
    // The same with other word rules says so.
    let ended = umo(&["play", &take, "--model", &model, "--language", "de", "-o", &played]).success();
    assert!(ended.err.contains("other word rules"), "{}", ended.err);
}

/// A gesture of a file is the host's: the take has its name alone.
#[test]
fn a_take_needs_the_gestures_of_its_host() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("frames_seven"));
    let (take, first) = (folder.at("motion.umo"), folder.at("first.jsonl"));
    umo(&["animate", &speech, "--model", &model, "-o", &first]).success();
    let clip = format!("bob={first},0.3,head");
    let (direct, played) = (folder.at("direct.jsonl"), folder.at("played.jsonl"));
    let own = ["--gesture-clip", &clip];
    umo(&[&["animate", &speech, "--model", &model, "--gesture", "bob", "-o", &take, "-o", &direct][..], &own].concat())
        .success();
    let line = folder.refused(&["play", &take, "--model", &model, "-o", &played]);
    assert!(line.contains("motion.umo") && line.contains("gesture `bob` at frame 0: unknown gesture"), "{line}");
    umo(&[&["play", &take, "--model", &model, "-o", &played][..], &own].concat()).success();
    assert!(folder.read("direct.jsonl") == folder.read("played.jsonl"));
}

#[test]
fn what_cannot_be_a_take_is_refused() {
    let folder = Folder::new();
    let (speech, model) = (folder.speech(), golden("frames_seven"));
    let (take, out) = (folder.at("motion.umo"), folder.at("out.jsonl"));
    umo(&["animate", &speech, "--model", &model, "-o", &take]).success();
    let bytes = folder.read("motion.umo");
    let cut = folder.file("cut.umo", &bytes[..bytes.len() - 1]);
    let other = golden("mel_k2_arkit");
    for (args, words) in [
        (&["play", &take, "--model", &other, "-o", &out][..], ["motion.umo", "another model"]),
        (&["play", &speech, "--model", &model, "-o", &out], ["speech.wav", "not a take"]),
        (&["play", &cut, "--model", &model, "-o", &out], ["cut.umo", "damaged"]),
        (&["animate", &speech, "--model", &model, "--retime", "-o", &take], ["--retime", "take"]),
    ] {
        let line = folder.refused(args);
        assert!(words.iter().all(|word| line.contains(word)), "{line}");
    }
}

/// Makes takes of one recording with these seeds: `1.umo` and so on.
fn takes(folder: &Folder, seeds: &[&str]) -> Vec<String> {
    let speech = folder.speech();
    let take = |seed: &&str| {
        let take = folder.at(&format!("{seed}.umo"));
        let words = folder.file("words.txt", b"No! \"Never\", you and I.");
        let made = ["--model", &golden("frames_seven"), "--words", &words, "--gesture", "wave@0.3,left"];
        umo(&[&["animate", &speech, "--seed", seed, "-o", &take][..], &made].concat()).success();
        take
    };
    seeds.iter().map(take).collect()
}

/// The page's description.
fn description(page: &[u8]) -> serde_json::Value {
    let page = std::str::from_utf8(page).unwrap();
    serde_json::from_str(page.split("id=\"scene\">").nth(1).unwrap().split("</script>").next().unwrap()).unwrap()
}

#[test]
fn the_page_of_a_take_has_its_score() {
    let folder = Folder::new();
    let take = &takes(&folder, &["1"])[0];
    let model = golden("frames_seven");
    let speech = folder.at("speech.wav");
    let ended = umo(&["view", take, "--audio", &speech, "--model", &model, "--no-open"]).success();
    assert!(ended.out.contains("1.html: 16 frames"), "{}", ended.out);
    let page = folder.read("1.html");
    let scene = description(&page);
    let takes = &scene["takes"];
    assert_eq!((&takes["stem"], &takes["audio"], &takes["kept"]), (&"1".into(), &"speech.wav".into(), &().into()));
    let events = takes["score"]["events"].as_array().unwrap();
    let wave = serde_json::json!({ "at": 0.3, "gesture": "wave", "side": "left" });
    assert!(events.contains(&wave), "{events:?}");
    assert!(
        events.iter().any(|event| event["words"].as_str().is_some_and(|words| words.contains("Never"))),
        "{events:?}"
    );
    assert!(events.iter().any(|event| event["both"].is_string() || event["right"].is_string()), "{events:?}");
    let page = std::str::from_utf8(&page).unwrap();
    assert!(page.contains("id=\"block-take-0\"") && page.contains("connect-src 'none'"));
    // `umo play` has the same frames.
    let played = folder.at("played.jsonl");
    umo(&["play", take, "--model", &model, "-o", &played]).success();
    umo(&["view", &played, "-o", &folder.at("played.html"), "--no-open"]).success();
    let frames = |page: &[u8]| {
        let page = std::str::from_utf8(page).unwrap();
        page.split("id=\"block-frames\">").nth(1).unwrap().split('<').next().unwrap().to_owned()
    };
    assert_eq!(frames(&folder.read("played.html")), frames(&folder.read("1.html")));
}

#[test]
fn a_take_of_a_model_without_phases_has_a_score_without_hands() {
    let folder = Folder::new();
    let (speech, model, take) = (folder.speech(), golden("mel_k2_arkit"), folder.at("parts.umo"));
    umo(&["animate", &speech, "--model", &model, "--gesture", "nod@0.2", "-o", &take]).success();
    umo(&["view", &take, "--model", &model, "--no-open"]).success();
    let score = &description(&folder.read("parts.html"))["takes"]["score"];
    assert_eq!(score["hands"], false);
    assert!(score["events"].as_array().unwrap().contains(&serde_json::json!({ "at": 0.2, "gesture": "nod" })));
}

#[test]
fn takes_of_one_recording_stand_side_by_side() {
    let folder = Folder::new();
    let takes = takes(&folder, &["1", "2", "3"]);
    let (page, model) = (folder.at("page.html"), golden("frames_seven"));
    let base = ["view", "--no-open", "--model", &model, "-o", &page];
    umo(&[&base[..], &[&takes[0], &takes[1], &takes[2]]].concat()).success();
    let scene = description(&folder.read("page.html"));
    let names: Vec<_> = scene["room"].as_array().unwrap().iter().map(|member| &member["name"]).collect();
    assert_eq!(names, ["1", "2", "3"]);
    assert_eq!((&scene["takes"]["stem"], &scene["takes"]["score"]), (&"1".into(), &().into()));
    let speech = folder.at("speech.wav");
    let other = folder.wav("other.wav", &[0.1; 9000]);
    let of_other = folder.at("other.umo");
    umo(&["animate", &other, "--model", &model, "-o", &of_other]).success();
    let (first, speech) = (&takes[0][..], &speech[..]);
    for (args, words) in [
        (&[first, &of_other][..], "other.umo: of another recording"),
        (&[first, speech], "speech.wav: only takes"),
        (&[speech, first], "1.umo: only takes"),
        (&[first; 9], "at most 8"),
        (&[first, "--audio", speech, "--audio", speech], "one --audio"),
        (&[first, &takes[1], "--onto", speech], "--onto goes with one take"),
        (&[first, "--words", speech], "a take: it has its words"),
        (&[speech, "--live"], "`umo live`"),
    ] {
        let line = folder.refused(&[&base[..], args].concat());
        assert!(line.contains(words), "{line}");
    }
    let line = folder.refused(&["view", first, "--live", "--model", &model, "-o", first]);
    assert!(line.contains("1.umo` is an input and an output"), "{line}");
}

/// Status and body of a page's request to the program at an address.
fn post(address: &str, what: &str, body: &str) -> (String, String) {
    let mut socket = TcpStream::connect(address).unwrap();
    let head = format!("POST /take/{what} HTTP/1.1\r\nHost: {address}\r\nOrigin: http://{address}\r\n");
    write!(socket, "{head}Connection: close\r\nContent-Length: {}\r\n\r\n{body}", body.len()).unwrap();
    let mut answer = Vec::new();
    socket.read_to_end(&mut answer).unwrap();
    let answer = String::from_utf8_lossy(&answer).into_owned();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    (head.split(' ').nth(1).unwrap().to_owned(), body.to_owned())
}

#[test]
fn a_served_page_saves_and_keeps_and_overwrites_no_take() {
    let folder = Folder::new();
    let takes = takes(&folder, &["1", "2"]);
    let model = golden("frames_seven");
    let serve = |more: &[&str], ask: &dyn Fn(&str)| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_umo"));
        program.args(["view", "--live", "--no-open", "--model", &model]).args(more).stdout(Stdio::piped());
        let mut program = program.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(program.stdout.take().unwrap()).read_line(&mut line).unwrap();
        ask(line.strip_prefix("http://").unwrap().split('/').next().unwrap());
        program.kill().unwrap();
        program.wait().unwrap();
    };
    serve(&[&takes[0]], &|address| {
        assert_eq!(post(address, "score", "a score").0, "200");
        assert_eq!(folder.read("1.toml"), b"a score");
        let (status, problem) = post(address, "draw", "another");
        assert!(status == "422" && problem.contains("--audio"), "{status} {problem}");
        let (status, problem) = post(address, "keep", "drawn");
        assert!(status == "422" && problem.contains("no take `drawn`"), "{status} {problem}");
        assert_eq!(post(address, "song", "").0, "422");
    });
    folder.file("mine.umo", b"something else");
    let mine = folder.at("mine.umo");
    serve(&[&takes[0], &takes[1], "-o", &mine], &|address| {
        let (status, problem) = post(address, "keep", "1");
        assert!(status == "422" && problem.contains("mine.umo is there already"), "{status} {problem}");
        std::fs::remove_file(&mine).unwrap();
        for take in ["1", "0"] {
            assert_eq!(post(address, "keep", take).0, "200");
        }
        assert_eq!(folder.read("mine.umo"), folder.read("1.umo"), "the page may change its mind");
        assert_eq!(post(address, "keep", "2").0, "422");
    });
}
