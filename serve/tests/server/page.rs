//! The page of a server, the values of its character in frames, and settings that a hello leaves to the server.

use std::sync::Mutex;

use serde_json::json;
use umo_core::{Pose, SessionConfig};
use umo_core_rig::glb::Follower;
use umo_serve::Page;

use super::*;
use crate::client::{http, raw, status};

/// A page that refuses files of three bytes.
#[derive(Debug)]
struct Shown {
    follower: Option<Arc<Follower>>,
    files: Mutex<Vec<usize>>,
}

impl Page for Shown {
    fn html(&self) -> Arc<str> {
        "<p>page</p>".into()
    }

    fn follower(&self) -> Option<Arc<Follower>> {
        self.follower.clone()
    }

    fn put_on(&self, file: Vec<u8>) -> Result<(), String> {
        self.files.lock().unwrap().push(file.len());
        if file.len() == 3 { Err("three bytes".to_owned()) } else { Ok(()) }
    }

    fn answer(&self, what: &str, body: Vec<u8>) -> Result<Vec<u8>, String> {
        if what == "score" { Ok(body) } else { Err(format!("no {what}")) }
    }
}

fn page(follower: Option<Arc<Follower>>) -> Arc<Shown> {
    Arc::new(Shown { follower, files: Mutex::default() })
}

fn follower() -> Arc<Follower> {
    let file = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../cli/tests/characters/character.glb")).unwrap();
    let config = MODEL.config();
    let source = json!({ "skeleton": config.skeleton, "face": config.face }).to_string();
    Arc::new(Follower::read(&file, &source).unwrap().0)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_page_comes_and_takes_a_character_from_itself_alone() {
    let shown = page(None);
    let server = Running::new(|config| config.page = Some(Arc::clone(&shown) as Arc<dyn Page>)).await;
    let answer = raw(server.address, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n").await;
    assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with("<p>page</p>"), "{answer}");
    let answer = answer.to_ascii_lowercase();
    for header in ["x-frame-options: deny", "cache-control: no-store", "cross-origin-resource-policy: same-origin"] {
        assert!(answer.contains(header), "{answer}");
    }
    let post = async |headers: &str, length: usize| {
        let request =
            format!("POST /character HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n{headers}\r\n");
        status(server.address, &format!("{request}{}", "x".repeat(length.min(10)))).await
    };
    let own = "Origin: http://localhost\r\n";
    assert_eq!((post(own, 2).await, post(own, 3).await), (200, 422));
    assert_eq!((post("", 2).await, post("Origin: http://evil.example\r\n", 2).await), (403, 403));
    assert_eq!(post(own, 1 << 30).await, 413);
    assert_eq!(*shown.files.lock().unwrap(), [2, 3]);

    let bare = Running::new(|_| ()).await;
    assert_eq!(http(bare.address, "/").await.0, 404);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_page_of_takes_is_answered_and_no_other() {
    let shown = page(None);
    let server = Running::new(|config| config.page = Some(Arc::clone(&shown) as Arc<dyn Page>)).await;
    let post = async |what: &str, headers: &str, body: &str| {
        let head = format!("POST /take/{what} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
        raw(server.address, format!("{head}{headers}\r\n{body}").as_bytes()).await
    };
    let own = "Host: localhost\r\nOrigin: http://localhost\r\n";
    let answer = post("score", own, "version = 1").await;
    assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with("version = 1"), "{answer}");
    let answer = post("song", own, "").await;
    assert!(answer.starts_with("HTTP/1.1 422") && answer.ends_with("no song\n"), "{answer}");
    for (headers, status) in [
        ("Host: localhost\r\n", "403"),
        ("Host: localhost\r\nOrigin: http://evil.example\r\n", "403"),
        ("Host: evil.example\r\nOrigin: http://evil.example\r\n", "421"),
    ] {
        let answer = post("score", headers, "version = 1").await;
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{answer}");
    }
    let long = format!("POST /take/score HTTP/1.1\r\n{own}Content-Length: {}\r\n\r\n", 1 << 30);
    assert_eq!(status(server.address, &long).await, 413);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn frames_have_the_values_of_the_character_for_a_client_that_shows_it() {
    let follower = follower();
    let (shown, audio) = (page(Some(Arc::clone(&follower))), speech(32_000, 11));
    let server = Running::new(|config| config.page = Some(shown as Arc<dyn Page>)).await;
    let run = async |hello| {
        let mut client = Client::new(server.address, hello).await.unwrap();
        client.speak(&audio, 16_000).await;
        client.text(r#"{"type":"finish"}"#).await;
        (client.frames_until_done().await.0, client.ready["floats"].as_u64().unwrap())
    };
    let (plain, floats) = run(json!({})).await;
    let (worn, more) = run(json!({ "character": true })).await;
    assert!(more > floats && worn.len() == plain.len());
    let mut scratch = follower.scratch();
    for (worn, plain) in worn.iter().zip(&plain) {
        let values: Vec<f32> = plain.bits.iter().map(|&bits| f32::from_bits(bits)).collect();
        let (rotations, rest) = values.split_at(4 * umo_core::JOINTS);
        let rotations = rotations.as_chunks::<4>().0.try_into().unwrap();
        let pose = Pose { rotations, translation: rest[..3].try_into().unwrap() };
        let mut wanted = values.clone();
        follower.add(&mut scratch, &pose, &rest[3..], &mut wanted).unwrap();
        assert_eq!(worn.bits, wanted.iter().map(|value| value.to_bits()).collect::<Vec<_>>());
    }
    for hello in [json!({ "character": true, "output": "packets" }), json!({ "character": true })] {
        let other = Running::new(|_| ()).await;
        assert_eq!(Client::new(other.address, hello).await.unwrap_err().0, "bad_request");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_hello_without_settings_has_those_of_the_server() {
    let mut settings = SessionConfig::new(MODEL.config());
    settings.avatar.sampler.seed = 9;
    settings.avatar.target = 1;
    settings.avatar.lookahead = 3;
    let defaults = settings.clone();
    let server = Running::new(|config| config.session = Some(defaults)).await;
    let audio = speech(32_000, 12);
    let run = async |hello| {
        let mut client = Client::new(server.address, hello).await.unwrap();
        let target = if client.ready["chunk_frames"] == MODEL.config().keyframe_stride { 1 } else { 2 };
        client.speak(&audio, 16_000).await;
        client.text(r#"{"type":"finish"}"#).await;
        let frames = only_bits(&client.frames_until_done().await.0);
        client.text(r#"{"type":"stats"}"#).await;
        let client::Event::Text(stats) = client.next().await else { panic!("statistics") };
        assert_eq!((&stats["type"], &stats["samples"]), (&json!("stats"), &json!(32_000)));
        assert!(stats["chunks"].as_u64().unwrap() > 0);
        let times = ["compute_p50", "compute_p99", "compute_max"].map(|name| stats[name].as_f64().unwrap());
        assert!(0.0 < times[0] && times.is_sorted(), "{times:?}");
        (frames, target)
    };
    assert_eq!(run(json!({})).await, (offline(&settings, &audio), 1));
    settings.avatar.sampler.seed = 4;
    settings.avatar.target = 2;
    assert_eq!(run(json!({ "seed": 4, "target": 2 })).await, (offline(&settings, &audio), 2));
}
