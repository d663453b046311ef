//! Invalid input.

use serde_json::json;
use tokio::io::AsyncWriteExt;
use tokio_tungstenite::MaybeTlsStream;

use super::client::{Client, raw};
use super::{Running, offline, only_bits, settings, speech};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn garbage_is_refused_with_a_reason_and_harms_nobody() {
    let server = Running::new(|_| ()).await;
    let audio = speech(24_000, 9);
    let mut speaking = Client::new(server.address, json!({ "seed": 9 })).await.unwrap();
    speaking.speak(&audio[..8_000], 1_000).await;

    for bytes in [
        &b"\0\xff\xfe garbage \r\n\r\n"[..],
        b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
        b"POST /v1/session HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
    ] {
        let answer = raw(server.address, bytes).await;
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 4"), "{answer}");
    }
    // After the handshake: bytes that are not WebSocket frames.
    let upgrade = "GET /v1/session HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
        Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
    let answer = raw(server.address, &[upgrade.as_bytes(), &[0x7f; 300]].concat()).await;
    assert!(answer.starts_with("HTTP/1.1 101"), "{answer}");

    for hello in [
        json!({ "rate": 1 }),
        json!({ "version": 2 }),
        json!({ "rate": 1e9 }),
        json!({ "target": 99 }),
        json!({ "horizon": 99 }),
        json!({ "layers": 2 }),
        json!({ "mood": "happy" }),
        json!({ "restore": 1_000_000_000 }),
        json!({ "output": "packets", "mood": "joy" }),
        json!({ "unknown": true }),
    ] {
        let (code, reason, _) = Client::new(server.address, hello.clone()).await.unwrap_err();
        assert_eq!(code, "bad_request", "{hello}: {reason}");
    }
    let forged = Client::with_state(server.address, json!({}), &[7; 1_000]).await.unwrap_err();
    assert_eq!(forged.0, "bad_request", "{}", forged.1);

    for first in ["", "{", "[]", r#"{"type":"finish"}"#, r#"{"type":"hello","rate":null}"#] {
        let mut client = Client::connect(server.address).await;
        client.text(first).await;
        assert_eq!(client.refusal().await.0, "bad_request", "{first}");
    }
    let mut client = Client::connect(server.address).await;
    client.binary(&[1, 2, 3]).await;
    assert_eq!(client.refusal().await.0, "bad_request");

    for wrong in
        ["nonsense", r#"{"type":"hello"}"#, r#"{"type":"interrupt","ease":-1}"#, r#"{"type":"interrupt","ease":1e9}"#]
    {
        let mut client = Client::new(server.address, json!({})).await.unwrap();
        client.text(wrong).await;
        assert_eq!(client.refusal().await.0, "bad_request", "{wrong}");
    }
    let mut client = Client::new(server.address, json!({})).await.unwrap();
    client.text(r#"{"type":"finish"}"#).await;
    client.binary(&[0; 640]).await;
    assert_eq!(client.refusal().await.0, "bad_request");
    // An oversized message is not read to its end.
    let mut client = Client::new(server.address, json!({})).await.unwrap();
    client.binary(&[0; 70_000]).await;
    let (code, _, number) = client.refusal().await;
    assert_eq!((code.as_str(), number), ("bad_request", 1009));

    speaking.speak(&audio[8_000..], 1_000).await;
    speaking.text(r#"{"type":"finish"}"#).await;
    assert_eq!(only_bits(&speaking.frames_until_done().await.0), offline(&settings(9), &audio));
    server.sessions(1).await;
}

/// A ping of 126 bytes: one more than allowed.
const LONG_PING: [u8; 134] = {
    let mut frame = [0; 134];
    (frame[0], frame[1], frame[3]) = (0x89, 0xfe, 126);
    frame
};

/// Invalid WebSocket frames of a client, before and after the hello: the server names the fault, with the close codes of
/// RFC 6455.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_breaks_the_protocol_is_closed_with_a_reason() {
    let server = Running::new(|_| ()).await;
    for (bytes, part, expected) in [
        (&[0x81, 0x01, b'a'][..], "unmasked", 1002),
        (&[0xf1, 0x80, 0, 0, 0, 0], "Reserved", 1002),
        (&[0x83, 0x80, 0, 0, 0, 0], "invalid opcode", 1002),
        (&[0x8b, 0x80, 0, 0, 0, 0], "invalid opcode", 1002),
        (&[0x09, 0x80, 0, 0, 0, 0], "Fragmented", 1002),
        (&[0x80, 0x80, 0, 0, 0, 0], "Continue", 1002),
        (&LONG_PING, "too big", 1002),
        (&[0x81, 0x81, 0, 0, 0, 0, 0xff], "UTF-8", 1007),
    ] {
        for has_hello in [false, true] {
            let mut client = match has_hello {
                true => Client::new(server.address, json!({})).await.unwrap(),
                false => Client::connect(server.address).await,
            };
            let MaybeTlsStream::Plain(socket) = client.socket.get_mut() else { panic!("no TLS here") };
            socket.write_all(bytes).await.unwrap();
            let (code, reason, number) = client.refusal().await;
            assert_eq!((code.as_str(), number), ("bad_request", expected), "{bytes:?}: {reason}");
            assert!(reason.contains(part), "{bytes:?}: {reason}");
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn bytes_that_come_one_by_one_are_messages_all_the_same() {
    let server = Running::new(|_| ()).await;
    let audio = speech(4_000, 2);
    let mut client = Client::new(server.address, json!({ "seed": 2 })).await.unwrap();
    let MaybeTlsStream::Plain(socket) = client.socket.get_mut() else { panic!("no TLS here") };
    let samples: Vec<u8> = audio.iter().flat_map(|sample| sample.to_le_bytes()).collect();
    for piece in samples.chunks(125) {
        // A client's binary message: length, a mask of zeros, payload.
        let length = u8::try_from(piece.len()).unwrap();
        for byte in [0x82, 0x80 | length, 0, 0, 0, 0].iter().chain(piece) {
            socket.write_all(&[*byte]).await.unwrap();
        }
    }
    client.text(r#"{"type":"finish"}"#).await;
    assert_eq!(only_bits(&client.frames_until_done().await.0), offline(&settings(2), &audio));
}
