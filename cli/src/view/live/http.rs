//! Requests from browsers on this machine. Other web pages open in a browser must not get access; they
//! are recognised by their `Host` and `Origin` headers.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Upper bound on the bytes of a request's head.
const MAX_HEAD: usize = 8 << 10;
/// Upper bound on the headers of a request. Browsers send about twenty.
const MAX_HEADERS: usize = 64;
/// Upper bound on the bytes of a character.
const MAX_BYTES: usize = 256 << 20;
/// Time limit for receiving a request, and for sending an answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// Interval between polls of an unfinished head.
const LOOK: Duration = Duration::from_millis(5);

/// Response to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// The page.
    Page,
    /// A stream, after a WebSocket handshake.
    Stream,
    /// Acceptance of a character; its size in bytes, which follow the head.
    Character(usize),
    /// A status only.
    Refuse(&'static str),
}

/// The relevant parts of a request.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Request<'a> {
    method: &'a str,
    path: &'a str,
    host: Vec<&'a str>,
    origin: Vec<&'a str>,
    is_upgrade: bool,
    length: Option<usize>,
}

impl<'a> Request<'a> {
    /// Parses a request's head, up to its empty line. `None` if it is not a complete HTTP/1.1 head.
    pub(super) fn parse(head: &'a str) -> Option<Self> {
        let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
        let mut parsed = httparse::Request::new(&mut headers);
        if !parsed.parse(head.as_bytes()).ok()?.is_complete() || parsed.version != Some(1) {
            return None;
        }
        let path = parsed.path?.split('?').next()?;
        let (host, origin) = (Vec::new(), Vec::new());
        let mut request = Self { method: parsed.method?, path, host, origin, is_upgrade: false, length: None };
        for header in parsed.headers {
            let value = std::str::from_utf8(header.value).ok()?;
            match header.name.to_ascii_lowercase().as_str() {
                "host" => request.host.push(value),
                "origin" => request.origin.push(value),
                "content-length" => request.length = value.parse().ok(),
                "upgrade" => request.is_upgrade = value.eq_ignore_ascii_case("websocket"),
                _ => {}
            }
        }
        Some(request)
    }

    /// Returns the response to the request on this port.
    ///
    /// The host check rejects pages whose domain name resolves to this machine (DNS rebinding). The origin check
    /// keeps all other pages from the stream and from sending a character.
    pub(super) fn answer(&self, port: u16) -> Answer {
        let names = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
        let [host] = self.host[..] else { return Answer::Refuse("400 Bad Request") };
        if !names.iter().any(|name| name == host) {
            return Answer::Refuse("421 Misdirected Request");
        }
        let is_own = matches!(self.origin[..], [origin] if origin.strip_prefix("http://") == Some(host));
        match (self.method, self.path) {
            ("GET", "/") => Answer::Page,
            ("GET", "/stream") if !self.is_upgrade => Answer::Refuse("426 Upgrade Required"),
            ("GET", "/stream") if is_own => Answer::Stream,
            ("POST", "/character") if is_own => match self.length {
                Some(length) if length <= MAX_BYTES => Answer::Character(length),
                Some(_) => Answer::Refuse("413 Content Too Large"),
                None => Answer::Refuse("411 Length Required"),
            },
            ("GET", "/stream") | ("POST", "/character") => Answer::Refuse("403 Forbidden"),
            ("GET", _) => Answer::Refuse("404 Not Found"),
            _ => Answer::Refuse("405 Method Not Allowed"),
        }
    }
}

/// Peeks the head of the pending request and returns it with its length, leaving it unread; `None` if it is
/// too long, not UTF-8, or incomplete at the time limit.
///
/// Returns an error if nothing arrives at all: browsers open connections in advance and would take a
/// refusal for the answer to their next request.
pub(super) fn peek_head(stream: &TcpStream, is_over: impl Fn() -> bool) -> io::Result<Option<(String, usize)>> {
    stream.set_read_timeout(Some(Duration::from_millis(200)))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let (start, mut bytes, mut is_begun) = (Instant::now(), vec![0; MAX_HEAD], false);
    while start.elapsed() < PATIENCE && !is_over() {
        let count = match stream.peek(&mut bytes) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if is_wait(&error) => continue,
            Err(error) => return Err(error),
        };
        is_begun = true;
        if let Some(at) = bytes[..count].windows(4).position(|four| four == b"\r\n\r\n") {
            let length = at + 4;
            return Ok(String::from_utf8(bytes[..length].to_vec()).ok().map(|head| (head, length)));
        }
        if count == MAX_HEAD {
            return Ok(None);
        }
        std::thread::sleep(LOOK);
    }
    if is_begun { Ok(None) } else { Err(io::ErrorKind::TimedOut.into()) }
}

/// Whether the error only means that nothing was received.
pub(super) fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted)
}

/// Sends the page in response to a request with a head of `length` bytes.
pub(super) fn send_page(stream: &mut TcpStream, length: usize, page: &str) -> io::Result<()> {
    send(stream, length, "200 OK", "text/html; charset=utf-8", page.as_bytes())
}

/// Sends a status in response to a request with a head of `length` bytes.
pub(super) fn refuse(stream: &mut TcpStream, length: usize, status: &str) -> io::Result<()> {
    tell(stream, length, status, status)
}

/// Reads the `size` bytes after a request's head of `length` bytes.
pub(super) fn body(stream: &mut TcpStream, length: usize, size: usize) -> io::Result<Vec<u8>> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.read_exact(&mut vec![0; length])?;
    let mut bytes = Vec::new();
    match stream.take(size as u64).read_to_end(&mut bytes)? == size {
        true => Ok(bytes),
        false => Err(io::ErrorKind::UnexpectedEof.into()),
    }
}

/// Sends a status and a line in response to a request with `length` unread bytes.
pub(super) fn tell(stream: &mut TcpStream, length: usize, status: &str, line: &str) -> io::Result<()> {
    send(stream, length, status, "text/plain; charset=utf-8", format!("{line}\n").as_bytes())
}

fn send(stream: &mut TcpStream, length: usize, status: &str, kind: &str, body: &[u8]) -> io::Result<()> {
    // Unread bytes would make the system reset the connection before the answer is read.
    stream.read_exact(&mut vec![0; length])?;
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nX-Frame-Options: DENY\r\nCross-Origin-Resource-Policy: same-origin\r\n\
         Referrer-Policy: no-referrer\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(body)?;
    stream.flush()
}
