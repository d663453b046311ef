//! Speech in Opus packets.

use std::path::Path;

use ropus::{Channels, DecodeMode, Decoder};
use serde_json::json;

use super::client::{Client, Event};
use super::{Running, offline, only_bits, settings};

/// Packets that `scripts/opus-test-files` makes.
fn packets(name: &str) -> Vec<Vec<u8>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/opus").join(name).with_extension("packets");
    let bytes = std::fs::read(path).unwrap();
    let (mut rest, mut packets) = (bytes.as_slice(), Vec::new());
    while let Some((length, after)) = rest.split_first_chunk() {
        let (packet, after) = after.split_at(u16::from_le_bytes(*length).into());
        packets.push(packet.to_vec());
        rest = after;
    }
    packets
}

/// Packets decoded at 16 kHz; an empty packet counts as lost.
fn decoded(packets: &[Vec<u8>], size: usize) -> Vec<i16> {
    let mut decoder = Decoder::new(16_000, Channels::Mono).unwrap();
    let mut samples = Vec::new();
    for packet in packets {
        let mut room = vec![0; if packet.is_empty() { size } else { 1_920 }];
        let made = decoder.decode(packet, &mut room, DecodeMode::Normal).unwrap();
        samples.extend_from_slice(&room[..made]);
    }
    samples
}

async fn finished(client: &mut Client) -> Vec<Vec<u32>> {
    client.text(r#"{"type":"finish"}"#).await;
    only_bits(&client.frames_until_done().await.0)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn packets_animate_as_the_samples_that_they_decode_to() {
    let server = Running::new(|_| ()).await;
    for (name, size) in [("voice", 320), ("narrow", 960), ("stereo", 160)] {
        let all = packets(name);
        let mut client = Client::new(server.address, json!({ "seed": 2, "audio": "opus" })).await.unwrap();
        assert_eq!(client.ready["audio"], "opus");
        for packet in &all {
            client.binary(packet).await;
        }
        assert_eq!(finished(&mut client).await, offline(&settings(2), &decoded(&all, size)), "{name}");
    }
    // The last packets are lost.
    let mut all = packets("voice");
    let kept = all.len() - 3;
    all[kept..].fill(Vec::new());
    let mut client = Client::new(server.address, json!({ "seed": 2, "audio": "opus" })).await.unwrap();
    for packet in &all[..kept] {
        client.binary(packet).await;
    }
    client.text(r#"{"type":"lost","packets":2}"#).await;
    client.text(r#"{"type":"lost"}"#).await;
    assert_eq!(finished(&mut client).await, offline(&settings(2), &decoded(&all, 320)));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_session_of_opus_goes_on_from_its_state() {
    const PACKET: usize = 320;
    /// Number of packets after which a new decoder has converged.
    const BEFORE: usize = 5;
    let server = Running::new(|_| ()).await;
    let all = std::array::from_fn::<_, 3, _>(|_| packets("voice")).concat();
    let hello = json!({ "seed": 4, "audio": "opus" });
    let mut client = Client::new(server.address, hello.clone()).await.unwrap();
    for packet in &all {
        client.binary(packet).await;
    }
    client.text(r#"{"type":"save"}"#).await;
    let (mut before, mut samples, mut state) = (Vec::new(), 0, None);
    while state.is_none() {
        match client.next().await {
            Event::Frames(frames) => before.extend(frames),
            Event::Text(text) => {
                samples = usize::try_from(text["samples"].as_u64().unwrap()).unwrap();
                state = Some(client.state(&text).await);
            }
            other => panic!("{other:?}"),
        }
    }
    client.text(r#"{"type":"finish"}"#).await;
    let (rest, _) = client.frames_until_done().await;

    let first = (samples / PACKET).saturating_sub(BEFORE);
    let mut hello = hello;
    hello["skip"] = (samples - first * PACKET).into();
    let mut client = Client::with_state(server.address, hello, &state.unwrap()).await.unwrap();
    for packet in &all[first..] {
        client.binary(packet).await;
    }
    client.text(r#"{"type":"finish"}"#).await;
    let (after, _) = client.frames_until_done().await;
    // No frame after the state is missing, and the last is the same; bits differ, as the decoder began later.
    assert_eq!(after.last().map(|frame| frame.index), rest.last().map(|frame| frame.index));
    assert!(after.len() >= rest.len() && after.len() <= rest.len() + before.len() + 30);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_no_packet_is_refused_with_a_reason() {
    let server = Running::new(|_| ()).await;
    for hello in [json!({ "audio": "opus", "rate": 44_100 }), json!({ "audio": "mp3" }), json!({ "skip": -1 })] {
        assert_eq!(Client::new(server.address, hello.clone()).await.unwrap_err().0, "bad_request", "{hello}");
    }
    // Empty; a frame count of 0; more frames than bytes; and bytes that are not a valid packet.
    for wrong in [&[][..], &[0x4b, 0], &[0x4a, 255, 255], &[0x0b, 0x3f, 1]] {
        let mut client = Client::new(server.address, json!({ "audio": "opus" })).await.unwrap();
        client.binary(&packets("voice")[0]).await;
        client.binary(wrong).await;
        let (code, reason, number) = client.refusal().await;
        assert_eq!((code.as_str(), number), ("bad_request", 4400), "{wrong:?}: {reason}");
        assert!(reason.contains("not an Opus packet"), "{reason}");
    }
    for (audio, wrong) in [("pcm", 1), ("opus", 0), ("opus", 51)] {
        let mut client = Client::new(server.address, json!({ "audio": audio })).await.unwrap();
        client.text(&json!({ "type": "lost", "packets": wrong }).to_string()).await;
        assert_eq!(client.refusal().await.0, "bad_request", "{audio} {wrong}");
    }
}
