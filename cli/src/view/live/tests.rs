use std::cell::Cell;
use std::io::{self, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};

use super::http::{self, Answer, Request};
use super::message::{Command, MAX_BYTES, Source, command, samples};

const PORT: u16 = 8123;

fn answer(method: &str, path: &str, headers: &[&str]) -> Answer {
    let head = format!("{method} {path} HTTP/1.1\r\n{}\r\n\r\n", headers.join("\r\n"));
    Request::parse(&head).map_or(Answer::Refuse("no request"), |request| request.answer(PORT))
}

const HOST: &str = "Host: 127.0.0.1:8123";
const UPGRADE: &str = "Upgrade: websocket";

#[test]
fn page_needs_its_secret_name() {
    assert_eq!(answer("GET", "/", &[HOST]), Answer::Page);
    assert_eq!(answer("GET", "/?x=1", &["host: localhost:8123"]), Answer::Page);
    for host in ["evil.example", "evil.example:8123", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8123.evil.example", ""] {
        assert_eq!(
            answer("GET", "/", &[&format!("Host: {host}")]),
            Answer::Refuse("421 Misdirected Request"),
            "{host}"
        );
    }
    assert_eq!(answer("GET", "/", &[]), Answer::Refuse("400 Bad Request"));
    assert_eq!(answer("GET", "/", &[HOST, HOST]), Answer::Refuse("400 Bad Request"));
    assert_eq!(answer("POST", "/", &[HOST]), Answer::Refuse("405 Method Not Allowed"));
    assert_eq!(answer("GET", "/../Cargo.toml", &[HOST]), Answer::Refuse("404 Not Found"));
}

#[test]
fn the_stream_is_for_the_page_alone() {
    let own = "Origin: http://127.0.0.1:8123";
    assert_eq!(answer("GET", "/stream", &[HOST, UPGRADE, own]), Answer::Stream);
    let local = ["Host: localhost:8123", UPGRADE, "Origin: http://localhost:8123"];
    assert_eq!(answer("GET", "/stream", &local), Answer::Stream);
    let refused = Answer::Refuse("403 Forbidden");
    for origin in
        ["http://evil.example", "null", "https://127.0.0.1:8123", "http://127.0.0.1:8124", "http://localhost:8123"]
    {
        assert_eq!(answer("GET", "/stream", &[HOST, UPGRADE, &format!("Origin: {origin}")]), refused, "{origin}");
    }
    assert_eq!(answer("GET", "/stream", &[HOST, UPGRADE]), refused, "no origin");
    assert_eq!(answer("GET", "/stream", &[HOST, UPGRADE, own, own]), refused, "two origins");
    assert_eq!(answer("GET", "/stream", &[HOST, own]), Answer::Refuse("426 Upgrade Required"));
}

#[test]
fn a_character_comes_from_the_page_alone_and_is_not_too_large() {
    let own = "Origin: http://127.0.0.1:8123";
    let given = |headers: &[&str]| answer("POST", "/character", &[&[HOST], headers].concat());
    assert_eq!(given(&[own, "Content-Length: 12"]), Answer::Character(12));
    assert_eq!(given(&[own]), Answer::Refuse("411 Length Required"));
    assert_eq!(given(&[own, "Content-Length: 99999999999"]), Answer::Refuse("413 Content Too Large"));
    let refused = Answer::Refuse("403 Forbidden");
    assert_eq!(given(&["Content-Length: 12"]), refused, "no origin");
    assert_eq!(given(&["Origin: http://evil.example", "Content-Length: 12"]), refused);
    assert_eq!(answer("GET", "/character", &[HOST, own]), Answer::Refuse("404 Not Found"));
}

#[test]
fn malformed_requests_are_refused() {
    for head in [
        "",
        "\r\n\r\n",
        "GET /\r\n\r\n",
        "GET / HTTP/1.0\r\n\r\n",
        "GET / x HTTP/1.1\r\n\r\n",
        "GET / HTTP/1.1\r\nnothing\r\n\r\n",
    ] {
        assert_eq!(Request::parse(head), None, "{head:?}");
    }
}

#[test]
fn commands_are_read_and_others_refused() {
    let start = |source, rate| Ok(Command::Start { source, rate });
    assert_eq!(command(r#"{"type":"start","source":"recording","rate":null}"#), start(Source::Recording, None));
    assert_eq!(
        command(r#"{"type":"start","source":"microphone","rate":48000}"#),
        start(Source::Microphone, Some(48000))
    );
    assert_eq!(command(r#"{"type":"finish"}"#), Ok(Command::Finish));
    for bad in [
        "",
        "{",
        "[]",
        r#"{"type":"leave"}"#,
        r#"{"type":"start"}"#,
        r#"{"type":"start","source":"file:///etc/passwd"}"#,
        r#"{"type":"start","source":"microphone"}"#,
        r#"{"type":"start","source":"microphone","rate":7}"#,
        r#"{"type":"start","source":"page"}"#,
        r#"{"type":"start","source":"microphone","rate":-1}"#,
        r#"{"type":"start","source":"microphone","rate":1e9}"#,
        r#"{"type":"start","source":"recording","more":1}"#,
    ] {
        assert!(command(bad).is_err(), "{bad}");
    }
    assert!(command(&"[".repeat(MAX_BYTES)).is_err());
}

#[test]
fn samples_are_whole_and_finite() {
    let bytes = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    assert_eq!(samples(&bytes(&[0.5, -1.0])), Ok(vec![0.5, -1.0]));
    assert_eq!(samples(&[]), Ok(vec![]));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
        assert!(samples(&bytes(&[0.0, bad])).is_err(), "{bad}");
    }
    assert!(samples(&[0; 7]).is_err());
}

/// Returns both ends of a connection to this program.
fn connection() -> (TcpStream, TcpStream) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let theirs = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
    (theirs, listener.accept().unwrap().0)
}

#[test]
fn a_connection_opened_in_advance_gets_no_answer() {
    let (theirs, ours) = connection();
    // Nothing arrives until it is time to stop: no refusal, which a browser would take for the answer
    // to a later request.
    let looks = Cell::new(0);
    let is_over = || looks.replace(looks.get() + 1) >= 2;
    assert_eq!(http::peek_head(&ours, is_over).unwrap_err().kind(), io::ErrorKind::TimedOut);
    // The browser disconnects.
    drop(theirs);
    assert!(http::peek_head(&ours, || false).is_err());
}

#[test]
fn half_a_request_is_none() {
    let (mut theirs, ours) = connection();
    theirs.write_all(b"GET / HT").unwrap();
    let looks = Cell::new(0);
    assert_eq!(http::peek_head(&ours, || looks.replace(looks.get() + 1) >= 2).unwrap(), None);
    theirs.write_all(b"TP/1.1\r\n\r\n").unwrap();
    assert_eq!(http::peek_head(&ours, || false).unwrap(), Some(("GET / HTTP/1.1\r\n\r\n".to_owned(), 18)));
}
