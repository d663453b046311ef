//! Shutdown of a server, and sessions that move to another one.

use std::time::{Duration, Instant};

use serde_json::json;

use super::client::{Client, Event, http};
use super::{Running, offline, only_bits, settings, speech};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_stops_takes_nobody_and_lets_the_others_finish() {
    let mut server = Running::new(|_| ()).await;
    let audio = speech(32_000, 4);
    let mut client = Client::new(server.address, json!({ "seed": 4 })).await.unwrap();
    client.speak(&audio[..16_000], 3_200).await;
    server.stop();
    let refused = async {
        loop {
            match Client::new(server.address, json!({})).await {
                Err(refusal) if refusal.0 == "draining" => return refusal,
                // The server does not know of the shutdown yet.
                early => drop(early),
            }
        }
    };
    let (code, reason, number) = refused.await;
    assert_eq!((code.as_str(), number), ("draining", 1012), "{reason}");
    let (status, health) = http(server.address, "/healthz").await;
    assert!(status == 503 && health.contains("draining"), "{health}");

    client.speak(&audio[16_000..], 3_200).await;
    client.text(r#"{"type":"finish"}"#).await;
    assert_eq!(only_bits(&client.frames_until_done().await.0), offline(&settings(4), &audio));
    assert_eq!(client.refusal().await.2, 1012);
    server.ended().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sessions_that_do_not_finish_end_at_the_limit() {
    let mut server = Running::new(|config| config.drain = Duration::from_millis(300)).await;
    let mut client = Client::new(server.address, json!({})).await.unwrap();
    let start = Instant::now();
    server.stop();
    let (code, _, number) = client.refusal().await;
    assert_eq!((code.as_str(), number), ("draining", 1012));
    assert!(start.elapsed() >= Duration::from_millis(290));
    server.ended().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_session_moves_to_another_server_without_a_seam() {
    for output in ["frames", "packets"] {
        let (mut first, second) = (Running::new(|_| ()).await, Running::new(|_| ()).await);
        let audio = speech(48_000, 6);
        let hello = json!({ "seed": 6, "handover": true, "output": output });
        let mut client = Client::new(first.address, hello.clone()).await.unwrap();
        client.speak(&audio[..20_001], 3_201).await;
        // Part of it is computed before the move.
        let (mut frames, mut packets) = (Vec::new(), Vec::new());
        while frames.is_empty() && packets.is_empty() {
            match client.next().await {
                Event::Frames(more) => frames.extend(more),
                Event::Packet(packet) => packets.push(packet),
                other => panic!("{other:?}"),
            }
        }
        first.stop();
        let (state, samples) = loop {
            match client.next().await {
                Event::Frames(more) => frames.extend(more),
                Event::Packet(packet) => packets.push(packet),
                Event::Text(text) => {
                    assert_eq!((&text["type"], &text["is_handover"]), (&json!("state"), &json!(true)));
                    let state = client.state(&text).await;
                    break (state, usize::try_from(text["samples"].as_u64().unwrap()).unwrap());
                }
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(client.refusal().await.2, 1012);
        first.ended().await;

        let mut client = Client::with_state(second.address, hello, &state).await.unwrap();
        client.speak(&audio[samples..], 3_200).await;
        client.text(r#"{"type":"finish"}"#).await;
        if output == "frames" {
            frames.extend(client.frames_until_done().await.0);
            assert!(frames.iter().zip(0..).all(|(frame, index)| frame.index == index));
            assert_eq!(only_bits(&frames), offline(&settings(6), &audio));
            assert!(frames.iter().all(|frame| frame.sample < 48_000));
        } else {
            packets.extend(client.packets_until_done().await);
            let mut plain = Client::new(second.address, json!({ "seed": 6, "output": output })).await.unwrap();
            plain.speak(&audio, 3_200).await;
            plain.text(r#"{"type":"finish"}"#).await;
            assert_eq!(packets, plain.packets_until_done().await);
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_state_is_saved_on_request_and_the_session_goes_on() {
    let server = Running::new(|_| ()).await;
    let audio = speech(32_000, 8);
    let mut client = Client::new(server.address, json!({ "seed": 8 })).await.unwrap();
    client.speak(&audio[..16_000], 3_200).await;
    client.text(r#"{"type":"save"}"#).await;
    let (mut before, mut state) = (Vec::new(), None);
    while state.is_none() {
        match client.next().await {
            Event::Frames(frames) => before.extend(frames),
            Event::Text(text) => {
                assert_eq!((&text["type"], &text["is_handover"]), (&json!("state"), &json!(false)));
                state = Some(client.state(&text).await);
            }
            other => panic!("{other:?}"),
        }
    }
    client.speak(&audio[16_000..], 3_200).await;
    client.text(r#"{"type":"finish"}"#).await;
    let (after, _) = client.frames_until_done().await;
    before.extend(after);
    assert_eq!(only_bits(&before), offline(&settings(8), &audio));
    // A session with other settings refuses the state.
    let other = Client::with_state(server.address, json!({ "rate": 48_000 }), &state.unwrap()).await;
    assert_eq!(other.unwrap_err().0, "bad_request");
}
