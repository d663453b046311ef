//! A client for the tests.

use std::net::SocketAddr;

use futures_util::{SinkExt, StreamExt};
use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};
use umo_core::Pose;
use umo_serve::protocol::{FRAMES, MOST_BYTES, PACKET, STATE};

use crate::PATIENCE;

/// A frame as bits.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FrameBits {
    pub(crate) index: u64,
    pub(crate) sample: u64,
    pub(crate) bits: Vec<u32>,
}

pub(crate) fn bits(pose: &Pose, face: &[f32]) -> Vec<u32> {
    pose.rotations.as_flattened().iter().chain(&pose.translation).chain(face).map(|value| value.to_bits()).collect()
}

/// A message from a server.
#[derive(Debug)]
pub(crate) enum Event {
    Text(Value),
    Frames(Vec<FrameBits>),
    Packet(Vec<u8>),
    /// Part of a state.
    State(Vec<u8>),
    /// The close code.
    Closed(Option<u16>),
}

#[derive(Debug)]
pub(crate) struct Client {
    pub(crate) socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    pub(crate) ready: Value,
}

impl Client {
    /// A socket without a hello.
    pub(crate) async fn connect(address: SocketAddr) -> Self {
        let (socket, _) = connect_async(format!("ws://{address}/v1/session")).await.unwrap();
        Self { socket, ready: Value::Null }
    }

    /// Opens a session, or returns the refusal.
    pub(crate) async fn new(address: SocketAddr, hello: Value) -> Result<Self, (String, String, u16)> {
        Self::with_state(address, hello, &[]).await
    }

    /// Opens a session from a saved state.
    pub(crate) async fn with_state(
        address: SocketAddr,
        mut hello: Value,
        state: &[u8],
    ) -> Result<Self, (String, String, u16)> {
        let mut client = Self::connect(address).await;
        hello["type"] = "hello".into();
        if !state.is_empty() {
            hello["restore"] = state.len().into();
        }
        client.text(&hello.to_string()).await;
        for piece in state.chunks(MOST_BYTES) {
            client.binary(piece).await;
        }
        match client.next().await {
            Event::Text(text) if text["type"] == "ready" => Ok(Self { ready: text, ..client }),
            Event::Text(text) => Err(client.closed(&text).await),
            other => panic!("{other:?}"),
        }
    }

    pub(crate) async fn text(&mut self, text: &str) {
        self.socket.send(Message::text(text)).await.unwrap();
    }

    pub(crate) async fn binary(&mut self, bytes: &[u8]) {
        self.socket.send(Message::binary(bytes.to_vec())).await.unwrap();
    }

    /// Sends samples in messages of `piece` bytes.
    pub(crate) async fn speak(&mut self, samples: &[i16], piece: usize) {
        let bytes: Vec<u8> = samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
        for piece in bytes.chunks(piece) {
            self.binary(piece).await;
        }
    }

    pub(crate) async fn next(&mut self) -> Event {
        loop {
            let message = timeout(PATIENCE, self.socket.next()).await.expect("the server says something");
            return match message {
                Some(Ok(Message::Text(text))) => Event::Text(serde_json::from_str(&text).unwrap()),
                Some(Ok(Message::Binary(bytes))) => match bytes[0] {
                    FRAMES => Event::Frames(frames(&bytes)),
                    PACKET => Event::Packet(bytes[1..].to_vec()),
                    STATE => Event::State(bytes[1..].to_vec()),
                    other => panic!("a message of kind {other}"),
                },
                Some(Ok(Message::Close(frame))) => Event::Closed(frame.map(|frame| frame.code.into())),
                Some(Ok(_)) => continue,
                Some(Err(_)) | None => Event::Closed(None),
            };
        }
    }

    pub(crate) async fn frames_until_done(&mut self) -> (Vec<FrameBits>, Value) {
        let mut all = Vec::new();
        loop {
            match self.next().await {
                Event::Frames(frames) => all.extend(frames),
                Event::Text(text) if text["type"] == "done" => return (all, text),
                other => panic!("{other:?}"),
            }
        }
    }

    pub(crate) async fn packets_until_done(&mut self) -> Vec<Vec<u8>> {
        let mut all = Vec::new();
        loop {
            match self.next().await {
                Event::Packet(packet) => all.push(packet),
                Event::Text(text) if text["type"] == "done" => return all,
                other => panic!("{other:?}"),
            }
        }
    }

    /// The state that a text announces.
    pub(crate) async fn state(&mut self, text: &Value) -> Vec<u8> {
        let bytes = usize::try_from(text["bytes"].as_u64().unwrap()).unwrap();
        let mut state = Vec::new();
        while state.len() < bytes {
            let Event::State(piece) = self.next().await else { panic!("a piece of the state") };
            assert!(piece.len() < MOST_BYTES);
            state.extend(piece);
        }
        assert_eq!(state.len(), bytes);
        state
    }

    /// The word, the sentence and the close code of the server's refusal; earlier messages are
    /// ignored.
    pub(crate) async fn refusal(&mut self) -> (String, String, u16) {
        loop {
            match self.next().await {
                Event::Text(text) if text["type"] == "error" => return self.closed(&text).await,
                Event::Closed(code) => panic!("closed with {code:?} and no reason"),
                _ => {}
            }
        }
    }

    async fn closed(&mut self, text: &Value) -> (String, String, u16) {
        assert_eq!(text["type"], "error", "{text}");
        let Event::Closed(Some(number)) = self.next().await else { panic!("a close after {text}") };
        let word = |key: &str| text[key].as_str().unwrap().to_owned();
        (word("code"), word("reason"), number)
    }
}

fn frames(bytes: &[u8]) -> Vec<FrameBits> {
    let count = u16::from_le_bytes([bytes[2], bytes[3]]);
    let floats = usize::try_from(u32::from_le_bytes(bytes[4..8].try_into().unwrap())).unwrap();
    let size = 16 + 4 * floats;
    assert_eq!(bytes.len(), 8 + usize::from(count) * size);
    bytes[8..]
        .chunks_exact(size)
        .map(|frame| FrameBits {
            index: u64::from_le_bytes(frame[..8].try_into().unwrap()),
            sample: u64::from_le_bytes(frame[8..16].try_into().unwrap()),
            bits: frame[16..].as_chunks::<4>().0.iter().map(|&bytes| u32::from_le_bytes(bytes)).collect(),
        })
        .collect()
}

/// Status and body of the answer to a GET.
pub(crate) async fn http(address: SocketAddr, path: &str) -> (u16, String) {
    let request = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    let text = raw(address, request.as_bytes()).await;
    let status = text.split(' ').nth(1).unwrap().parse().unwrap();
    (status, text.split_once("\r\n\r\n").unwrap().1.to_owned())
}

/// Status of the answer to a request that leaves the connection open.
pub(crate) async fn status(address: SocketAddr, request: &str) -> u16 {
    let mut socket = TcpStream::connect(address).await.unwrap();
    socket.write_all(request.as_bytes()).await.unwrap();
    let mut answer = [0; 12];
    timeout(PATIENCE, socket.read_exact(&mut answer)).await.expect("an answer").unwrap();
    str::from_utf8(&answer).unwrap()[9..].parse().unwrap()
}

/// The server's whole answer to these bytes.
pub(crate) async fn raw(address: SocketAddr, bytes: &[u8]) -> String {
    let mut socket = TcpStream::connect(address).await.unwrap();
    socket.write_all(bytes).await.unwrap();
    let mut answer = Vec::new();
    // A server may reset the connection on invalid input.
    let _ = timeout(PATIENCE, socket.read_to_end(&mut answer)).await.expect("an answer or an end");
    String::from_utf8_lossy(&answer).into_owned()
}
