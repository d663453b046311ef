//! A server over loopback: its sessions have the bits of the library, and nothing that a client
//! does or omits affects the others.

#[path = "server/client.rs"]
mod client;
#[path = "server/drain.rs"]
mod drain;
#[path = "server/limits.rs"]
mod limits;
#[path = "server/opus.rs"]
mod opus;
#[path = "server/page.rs"]
mod page;
#[path = "server/wrong.rs"]
mod wrong;

use std::net::SocketAddr;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use client::{Client, Event, FrameBits, bits, http};
use serde_json::json;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tokio::time::timeout;
use umo_core::{
    Animation, Compute, Isa, JOINT_NAMES, JOINTS, LayerGains, Model, ModelFile, Precision, Session, SessionConfig,
    Team, Threads,
};
use umo_serve::{Config, Server};

/// A small model of random weights.
static MODEL: LazyLock<Arc<Model>> = LazyLock::new(|| load("tests/golden/mel_k2_arkit"));

fn load(folder: &str) -> Arc<Model> {
    let path = format!("{}/../{folder}/model.safetensors", env!("CARGO_MANIFEST_DIR"));
    let file = ModelFile::open(path.as_ref()).unwrap();
    Arc::new(Model::load(&file, Precision::Stored, Isa::detect()).unwrap())
}

/// Timeout of every wait.
const PATIENCE: Duration = Duration::from_secs(60);

/// A server in this process.
struct Running {
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    ended: JoinHandle<()>,
}

impl Running {
    /// Starts a server that computes as fast as it can, unless `change` says otherwise.
    async fn new(change: impl FnOnce(&mut Config)) -> Self {
        Self::of(Arc::clone(&MODEL), change).await
    }

    async fn of(model: Arc<Model>, change: impl FnOnce(&mut Config)) -> Self {
        let mut config = Config { ahead: Duration::ZERO, sessions: 4, per_client: 4, ..Config::default() };
        config.engine.threads = Threads::Own(1);
        change(&mut config);
        let server = Server::bind("127.0.0.1:0", config, model).await.unwrap();
        let (stop, told) = oneshot::channel();
        let address = server.address();
        let ended = tokio::spawn(server.run(async {
            let _ = told.await;
        }));
        Self { address, stop: Some(stop), ended }
    }

    fn stop(&mut self) {
        self.stop.take().unwrap().send(()).unwrap();
    }

    async fn ended(self) {
        timeout(PATIENCE, self.ended).await.expect("the server ends").unwrap();
    }

    /// Waits until the server has `count` sessions.
    async fn sessions(&self, count: usize) {
        let wanted = format!("\"sessions\":{count},");
        let reached = async {
            while !http(self.address, "/healthz").await.1.contains(&wanted) {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        timeout(PATIENCE, reached).await.unwrap_or_else(|_| panic!("{count} sessions"));
    }
}

/// Noise over a tone.
fn speech(samples: usize, seed: u32) -> Vec<i16> {
    let mut noise = seed.wrapping_mul(2_654_435_761).wrapping_add(1);
    (0..samples)
        .map(|i| {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            #[expect(clippy::cast_possible_truncation, reason = "within 16 bits")]
            let sample = (8_000.0 * (0.05 * i as f32).sin() + 3_000.0 * (noise >> 16) as f32 / 65_536.0) as i16;
            sample
        })
        .collect()
}

/// The frames that `umo animate` makes of a recording.
fn offline(config: &SessionConfig, samples: &[i16]) -> Vec<Vec<u32>> {
    let model = &*MODEL;
    assert_eq!(config.sample_rate, model.config().audio.sample_rate);
    let samples: Vec<f32> = samples.iter().map(|&sample| f32::from(sample) / 32768.0).collect();
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let mut animation = Animation::with_layers(model, &config.avatar, config.layers, config.gestures.clone()).unwrap();
    animation.push_audio(&samples).unwrap();
    animation.finish(samples.len() * model.config().frame_rate / config.sample_rate);
    let mut frames = Vec::new();
    while animation.step(model, cx, &mut |frame| frames.push(bits(frame.pose, frame.face))).unwrap() {}
    frames
}

fn settings(seed: u64) -> SessionConfig {
    let mut config = SessionConfig::new(MODEL.config());
    config.avatar.sampler.seed = seed;
    config
}

fn only_bits(frames: &[FrameBits]) -> Vec<Vec<u32>> {
    frames.iter().map(|frame| frame.bits.clone()).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sessions_have_the_bits_of_the_library_whatever_the_pieces() {
    let server = Running::new(|_| ()).await;
    let one = async |seed: u64, piece: usize| {
        let audio = speech(40_000, u32::try_from(seed).unwrap());
        let mut client = Client::new(server.address, json!({ "seed": seed })).await.unwrap();
        assert_eq!(client.ready["rate"], 16_000);
        client.speak(&audio, piece).await;
        client.text(r#"{"type":"finish"}"#).await;
        let (frames, done) = client.frames_until_done().await;
        assert_eq!(done["frames"], 75);
        assert!(frames.iter().zip(0..).all(|(frame, index)| frame.index == index));
        assert_eq!(only_bits(&frames), offline(&settings(seed), &audio), "seed {seed}");
        // Another speech on the same socket: begins with an interrupt, and frame numbers continue.
        client.text(r#"{"type":"interrupt"}"#).await;
        client.speak(&audio[..16_000], 4_000).await;
        client.text(r#"{"type":"finish"}"#).await;
        let (frames, _) = client.frames_until_done().await;
        assert_eq!((frames.first().unwrap().index, frames.len()), (75, 30));
    };
    timeout(PATIENCE, async { tokio::join!(one(0, 32_000), one(1, 999), one(7, 1_001)) }).await.unwrap();
    server.sessions(0).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn packets_decode_to_the_bits_of_the_library() {
    let server = Running::new(|_| ()).await;
    let audio = speech(40_000, 3);
    let mut client = Client::new(server.address, json!({ "output": "packets", "seed": 3 })).await.unwrap();
    client.speak(&audio, 3_200).await;
    client.text(r#"{"type":"finish"}"#).await;
    let packets = client.packets_until_done().await;

    let mut config = settings(3);
    config.layers = LayerGains::OFF;
    let decoder = Session::decoder(&MODEL, &config).unwrap();
    let mut frames = Vec::new();
    for packet in &packets {
        decoder.push_packet(packet).unwrap();
        while decoder.pull_frames(8, |frame| frames.push(bits(frame.pose, frame.face))).unwrap() > 0 {}
    }
    assert_eq!(frames, offline(&config, &audio));

    client.text(r#"{"type":"mood","mood":"joy"}"#).await;
    assert_eq!(client.refusal().await.0, "bad_request");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn commands_reach_the_session() {
    let server = Running::new(|_| ()).await;
    let audio = speech(32_000, 5);
    let face = MODEL.config().face.names.clone();
    let run = async |commands: &[&str]| {
        let mut client = Client::new(server.address, json!({ "mood_strength": 0.5, "language": "de" })).await.unwrap();
        for command in commands {
            client.text(command).await;
        }
        client.speak(&audio, 16_000).await;
        client.text(r#"{"type":"finish"}"#).await;
        only_bits(&client.frames_until_done().await.0)
    };
    let plain = run(&[]).await;
    // The mean of a value's change over all frames.
    let change = |moved: &[Vec<u32>], value: usize| {
        let sum = |frames: &[Vec<u32>]| frames.iter().map(|frame| f32::from_bits(frame[value])).sum::<f32>();
        assert_eq!(moved.len(), plain.len());
        (sum(moved) - sum(&plain)) / plain.len() as f32
    };
    // Values of a frame: rotations, translation, face.
    let channel = |name: &str| JOINTS * 4 + 3 + face.iter().position(|known| known == name).unwrap();
    let joint = |name: &str| 4 * JOINT_NAMES.iter().position(|&known| known == name).unwrap();
    let happy = run(&[r#"{"type":"mood","mood":"joy"}"#]).await;
    assert!(change(&happy, channel("mouthSmileLeft")) > 0.05, "{}", change(&happy, channel("mouthSmileLeft")));
    let waving = run(&[r#"{"type":"gesture","name":"wave"}"#]).await;
    let turned = |name: &str| (0..4).map(|i| change(&waving, joint(name) + i).abs()).fold(0.0, f32::max);
    assert!(
        turned("right_elbow") > 0.1 && turned("left_elbow") < 0.01,
        "{} {}",
        turned("right_elbow"),
        turned("left_elbow")
    );
    // A point on the avatar's left.
    let looking = run(&[r#"{"type":"look_at","point":[1,1.5,1]}"#]).await;
    assert!(change(&looking, channel("eyeLookOutLeft")) > 0.01, "{}", change(&looking, channel("eyeLookOutLeft")));
    assert!(change(&looking, joint("head") + 1) > 0.01, "{}", change(&looking, joint("head") + 1));
    let denying = run(&[r#"{"type":"words","text":"Nein!","start":1.5,"end":1.9}"#]).await;
    assert!(denying[..15] == plain[..15] && denying != plain, "a word at 1.5 s");
    let refused = [
        (json!({}), r#"{"type":"gesture","name":"moonwalk"}"#),
        (json!({ "output": "packets" }), r#"{"type":"words","text":"Stop!","start":1.5,"end":1.9}"#),
    ];
    for (hello, message) in refused {
        let mut client = Client::new(server.address, hello).await.unwrap();
        client.text(message).await;
        let (code, reason, number) = client.refusal().await;
        assert_eq!((code.as_str(), number), ("bad_request", 4400), "{reason}");
    }
    let Err((code, reason, _)) = Client::new(server.address, json!({ "language": "xx" })).await else {
        panic!("a language without rules")
    };
    assert!(code == "bad_request" && reason.contains("en, de"), "{reason}");
}

/// Mean of the head's turn to its left over the frames of a listener, who sends no audio, while another one speaks there.
async fn turned_to(server: &Running, room: &str, speaker: [f32; 3]) -> f32 {
    let listener = json!({ "room": room, "place": [0, 0, 0] });
    let mut listener = Client::new(server.address, listener).await.unwrap();
    let mut speaker = Client::new(server.address, json!({ "room": room, "place": speaker })).await.unwrap();
    speaker.speak(&speech(48_000, 5), 16_000).await;
    let head = 4 * JOINT_NAMES.iter().position(|&name| name == "head").unwrap() + 1;
    let mut turns = Vec::new();
    while turns.len() < 75 {
        let Event::Frames(frames) = listener.next().await else { panic!("frames without audio") };
        turns.extend(frames.iter().map(|frame| f32::from_bits(frame.bits[head])));
    }
    speaker.text(r#"{"type":"place","place":[0,1,180]}"#).await;
    speaker.text(r#"{"type":"finish"}"#).await;
    assert!(speaker.frames_until_done().await.0.len() >= 90);
    turns[30..].iter().sum::<f32>() / (turns.len() - 30) as f32
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sessions_in_a_room_see_each_other() {
    let server = Running::new(|_| ()).await;
    let (left, right) =
        tokio::join!(turned_to(&server, "left", [1.0, 0.5, -110.0]), turned_to(&server, "right", [-1.0, 0.5, 110.0]));
    assert!(left - right > 0.2, "{left} {right}");
    for (hello, wanted) in [
        (json!({ "place": [0, 0, 0] }), "only in a room"),
        (json!({ "room": "" }), "1 to 64 bytes"),
        (json!({ "room": "a", "place": [1e30, 0, 0] }), "place"),
        (json!({ "room": "a", "output": "packets" }), "packets"),
    ] {
        let Err((code, reason, _)) = Client::new(server.address, hello).await else { panic!("{wanted}") };
        assert!(code == "bad_request" && reason.contains(wanted), "{reason}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_prompt_that_the_model_does_not_know_is_noted() {
    let server = Running::of(load("models/umo-people"), |_| ()).await;
    for (prompt, is_known) in [("joyful", true), ("a backflip", false)] {
        let client = Client::new(server.address, json!({ "prompt": prompt })).await.unwrap();
        let note = client.ready.get("note").map(|note| note.as_str().unwrap());
        assert_eq!(note.is_none(), is_known, "{note:?}");
        assert!(note.is_none_or(|note| note.contains("`a backflip`") && note.contains("joyful")), "{note:?}");
    }
}
