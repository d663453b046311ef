//! Limits on sessions, tokens, and clients that disconnect without a close.

use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use serde_json::json;
use tokio::io::AsyncReadExt;
use tokio::net::{TcpSocket, TcpStream};
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{client_async, connect_async};
use umo_serve::Tokens;

use super::client::{Client, http, status};
use super::{PATIENCE, Running};

const STUDIO: &str = "studio-0123456789";
const GAME: &str = "game-0123456789ab";

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn more_clients_than_places_are_refused_and_places_come_back() {
    let server = Running::new(|config| config.sessions = 2).await;
    let first = Client::new(server.address, json!({})).await.unwrap();
    let mut second = Client::new(server.address, json!({})).await.unwrap();
    let (code, reason, number) = Client::new(server.address, json!({})).await.unwrap_err();
    assert_eq!((code.as_str(), number), ("full", 4503), "{reason}");
    let metrics = http(server.address, "/metrics").await.1;
    for line in ["umo_serve_sessions 2", "umo_serve_sessions_refused_total{reason=\"full\"} 1"] {
        assert!(metrics.lines().any(|have| have == line), "{line}: {metrics}");
    }
    // One disconnects without a close, and one closes.
    drop(first);
    second.socket.close(None).await.unwrap();
    server.sessions(0).await;
    let _third = Client::new(server.address, json!({})).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn twice_as_many_clients_as_places_leave_those_that_run_their_frames() {
    const PLACES: u32 = 4;
    let server = Running::new(|config| config.sessions = 4).await;
    let speak = async |seed: u32| {
        let mut client = Client::new(server.address, json!({ "seed": seed })).await?;
        // All ask before any finishes.
        let asked = async {
            while !http(server.address, "/metrics").await.1.contains("refused_total{reason=\"full\"} 4") {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        let audio = super::speech(24_000, seed);
        for piece in audio[..8_000].chunks(320) {
            client.speak(piece, 640).await;
        }
        timeout(PATIENCE, asked).await.expect("the others are refused");
        client.speak(&audio[8_000..], 640).await;
        client.text(r#"{"type":"finish"}"#).await;
        let (frames, done) = client.frames_until_done().await;
        assert_eq!((frames.len(), done["frames"].as_u64()), (45, Some(45)));
        Ok::<_, (String, String, u16)>(
            super::only_bits(&frames) == super::offline(&super::settings(seed.into()), &audio),
        )
    };
    let all = tokio::join!(speak(0), speak(1), speak(2), speak(3), speak(4), speak(5), speak(6), speak(7));
    let all = [all.0, all.1, all.2, all.3, all.4, all.5, all.6, all.7];
    let refused = all.iter().filter_map(|outcome| outcome.as_ref().err());
    let reasons: Vec<_> =
        refused.map(|(code, reason, number)| (code.as_str(), reason.contains('4'), *number)).collect();
    assert_eq!(reasons, [("full", true, 4503); PLACES as usize]);
    assert_eq!(all.iter().filter(|outcome| **outcome == Ok(true)).count(), PLACES as usize);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn tokens_open_the_door_and_count_their_clients() {
    let tokens = Tokens::parse(&format!("studio {STUDIO}\ngame {GAME}")).unwrap();
    let server = Running::new(|config| (config.tokens, config.per_client) = (tokens, 1)).await;
    for hello in
        [json!({}), json!({ "token": "" }), json!({ "token": "studio" }), json!({ "token": "studio-0123456780" })]
    {
        let (code, reason, number) = Client::new(server.address, hello).await.unwrap_err();
        assert_eq!((code.as_str(), number), ("unauthorized", 4401), "{reason}");
    }
    let _studio = Client::new(server.address, json!({ "token": STUDIO })).await.unwrap();
    let (code, _, number) = Client::new(server.address, json!({ "token": STUDIO })).await.unwrap_err();
    assert_eq!((code.as_str(), number), ("client_limit", 4429));
    let _game = Client::new(server.address, json!({ "token": GAME })).await.unwrap();

    // A token in the request instead of the hello: a wrong one gets no WebSocket.
    let mut request = format!("ws://{}/v1/session", server.address).into_client_request().unwrap();
    request.headers_mut().insert("Authorization", "Bearer wrong-0123456789a".parse().unwrap());
    let Err(Error::Http(response)) = connect_async(request).await else { panic!("no WebSocket") };
    assert_eq!(response.status().as_u16(), 401);
    assert_eq!(http(server.address, "/healthz").await.0, 200);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn clients_that_do_nothing_or_have_gone_lose_their_places() {
    // The client answers pings, and does nothing else.
    let server = Running::new(|config| config.idle = Duration::from_millis(300)).await;
    let mut idle = Client::new(server.address, json!({})).await.unwrap();
    assert_eq!(idle.refusal().await.2, 4408);
    server.sessions(0).await;
    // The connection is half open: pings are not answered.
    let server = Running::new(|config| config.heartbeat = Duration::from_millis(150)).await;
    let mut silent = Client::new(server.address, json!({})).await.unwrap();
    server.sessions(0).await;
    assert_eq!(silent.refusal().await.2, 4409);
    // The client never sends a hello.
    let server = Running::new(|config| config.hello_within = Duration::from_millis(200)).await;
    let mut mute = Client::connect(server.address).await;
    assert_eq!(mute.refusal().await.2, 4400);
}

/// Browsers send the page's origin and the host's name.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn pages_of_other_sites_do_not_come_in() {
    let site = "https://avatar.example.com";
    let server = Running::new(|config| config.origins.push(site.to_owned())).await;
    let own = server.address.to_string();
    let ask = async |path: &str, host: &str, origin: &str| {
        let request = format!(
            "GET {path} HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        );
        status(server.address, &request).await
    };
    for (host, origin, expected) in [
        (&*own, "http://evil.example".to_owned(), 403),
        (&own, "null".to_owned(), 403),
        ("evil.example", "http://evil.example".to_owned(), 421),
        (&own, format!("http://{own}"), 101),
        (&own, site.to_owned(), 101),
        ("avatar.example.com", site.to_owned(), 101),
    ] {
        assert_eq!(ask("/v1/session", host, &origin).await, expected, "{host} {origin}");
    }
    for path in ["/metrics", "/healthz"] {
        assert_eq!(ask(path, "evil.example", "http://evil.example").await, 421);
        assert_eq!(ask(path, &own, "http://evil.example").await, 403);
    }
    let metrics = http(server.address, "/metrics").await.1;
    for line in
        ["umo_serve_sessions_refused_total{reason=\"origin\"} 4", "umo_serve_sessions_refused_total{reason=\"host\"} 3"]
    {
        assert!(metrics.lines().any(|have| have == line), "{line}: {metrics}");
    }
    server.sessions(0).await;
}

/// Silent connections: those of one address leave room for other addresses.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn idle_connections_lock_nobody_out() {
    const IDLE: usize = 100;
    let server = Running::new(|_| ()).await;
    let mut idle = Vec::new();
    for _ in 0..IDLE {
        idle.push(TcpStream::connect(server.address).await.unwrap());
    }
    // This machine has several loopback addresses.
    let socket = TcpSocket::new_v4().unwrap();
    socket.bind("127.0.0.2:0".parse().unwrap()).unwrap();
    let other = socket.connect(server.address).await.unwrap();
    let url = format!("ws://{}/v1/session", server.address);
    let (mut other, _) = timeout(PATIENCE, client_async(url, other)).await.unwrap().unwrap();
    other.send(Message::text(r#"{"type":"hello"}"#)).await.unwrap();
    let ready = timeout(PATIENCE, other.next()).await.unwrap().unwrap().unwrap();
    assert!(ready.to_text().unwrap().contains("ready"), "{ready}");
    // Connections of one address above the limit are closed at once, the others after the timeout.
    let mut closed = 0;
    for socket in &mut idle {
        closed += usize::from(timeout(Duration::from_millis(20), socket.read(&mut [0])).await.is_ok());
    }
    assert!((IDLE / 2..IDLE).contains(&closed), "{closed}");
}

/// Clients with a session do not count as waiting connections.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_address_may_have_more_sessions_than_connections_that_wait() {
    const SESSIONS: usize = 40;
    let server = Running::new(|config| (config.sessions, config.per_client) = (SESSIONS, SESSIONS)).await;
    let mut sessions = Vec::new();
    for _ in 0..SESSIONS {
        sessions.push(Client::new(server.address, json!({})).await.unwrap());
    }
}

/// Behind a proxy all connections are the proxy's: clients are counted by the address in its header.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn clients_behind_a_proxy_wait_each_for_itself() {
    let server = Running::new(|config| config.is_behind_proxy = true).await;
    let connect = async |client: &str| {
        let mut request = format!("ws://{}/v1/session", server.address).into_client_request().unwrap();
        request.headers_mut().insert("X-Forwarded-For", client.parse().unwrap());
        connect_async(request).await.map(|(socket, _)| socket)
    };
    let mut waiting = Vec::new();
    let refused = loop {
        match connect("192.0.2.1").await {
            Ok(socket) => waiting.push(socket),
            Err(error) => break error,
        }
    };
    let Error::Http(response) = refused else { panic!("{refused}") };
    assert_eq!((response.status().as_u16(), waiting.len()), (429, 32));
    let _other = connect("192.0.2.2").await.expect("another client has its own");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_that_does_not_read_ends_alone() {
    let server = Running::new(|config| config.stall = Duration::from_millis(300)).await;
    let mut slow = Client::new(server.address, json!({})).await.unwrap();
    let mut other = Client::new(server.address, json!({})).await.unwrap();
    // Each answer is a state of some hundred kilobytes, which soon fills the system's socket buffers.
    let asking = async {
        loop {
            slow.text(r#"{"type":"save"}"#).await;
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::select! {
        () = asking => {}
        () = server.sessions(1) => {}
    }
    let counted = async {
        let line = "umo_serve_sessions_ended_total{reason=\"slow_reader\"} 1";
        while !http(server.address, "/metrics").await.1.contains(line) {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(PATIENCE, counted).await.expect("the reason is counted");
    other.speak(&super::speech(16_000, 1), 3_200).await;
    other.text(r#"{"type":"finish"}"#).await;
    assert_eq!(other.frames_until_done().await.0.len(), 30);
    drop(slow);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_recording_that_comes_at_once_takes_no_more_than_real_time() {
    let server = Running::new(|config| config.ahead = Duration::from_millis(500)).await;
    let mut client = Client::new(server.address, json!({})).await.unwrap();
    let start = std::time::Instant::now();
    client.speak(&super::speech(32_000, 1), 32_000).await;
    client.text(r#"{"type":"finish"}"#).await;
    assert_eq!(client.frames_until_done().await.0.len(), 60);
    let took = start.elapsed();
    assert!(took > Duration::from_millis(1_400), "{took:?}");
}
