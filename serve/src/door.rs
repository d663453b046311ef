//! Admission of connections: rejects web pages from foreign origins, and keeps one client's idle connections
//! from crowding out all others.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::http::{HeaderMap, HeaderName, StatusCode, header};

/// Maximum number of connections that have not sent a hello.
pub(crate) const WAITING: usize = 256;
/// Maximum number of these from one address.
pub(crate) const WAITING_OF_ONE: usize = 32;

/// Reason for refusing a request: status, label for the metrics, and message.
pub(crate) type Refused = (StatusCode, &'static str, String);

/// Admits or refuses a request by its headers: in a browser's request, `Origin` is the page that sent it and
/// `Host` the name it used for the server.
///
/// Pages from `origins` are accepted in addition to the server's own. If only this machine can reach the server,
/// its names are known, and any other name in `Host` is refused, against DNS rebinding.
pub(crate) fn check(headers: &HeaderMap, origins: &[String], is_loopback: bool) -> Result<(), Refused> {
    let host = one(headers, &header::HOST)?;
    let origin = one(headers, &header::ORIGIN)?;
    let named = |host: &str| origins.iter().any(|origin| authority(origin) == Some(host));
    if is_loopback && !host.is_some_and(|host| is_loopback_name(host) || named(host)) {
        let host = host.unwrap_or("no host");
        let reason = format!("{host} is not this machine's own name; --origin https://{host} makes it known\n");
        return Err((StatusCode::MISDIRECTED_REQUEST, "host", reason));
    }
    match origin {
        Some(origin) if !origins.iter().any(|known| known == origin) && authority(origin) != host => {
            let reason = format!("pages of {origin} are refused; --origin {origin} allows them\n");
            Err((StatusCode::FORBIDDEN, "origin", reason))
        }
        _ => Ok(()),
    }
}

/// Checks that `origin` has the form that browsers send.
pub(crate) fn check_origin(origin: &str) -> Result<(), String> {
    let is_known = authority(origin).is_some_and(|host| !host.is_empty() && !host.contains(['/', '@', '?', '#', ' ']));
    if origin == "null" || is_known && !origin.contains(|letter: char| letter.is_ascii_uppercase()) {
        return Ok(());
    }
    Err(format!("origin {origin}: expected as https://avatar.example.com or http://localhost:8000, without a path"))
}

/// Value of a header that may occur once at most.
fn one<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Result<Option<&'a str>, Refused> {
    let mut values = headers.get_all(name).iter();
    let value = values.next().map(|value| value.to_str()).transpose();
    match (value, values.next()) {
        (Ok(value), None) => Ok(value),
        _ => Err((StatusCode::BAD_REQUEST, "bad_request", format!("{name}: expected once, in ASCII\n"))),
    }
}

/// Host and port of an origin.
fn authority(origin: &str) -> Option<&str> {
    origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"))
}

/// Whether a host, with or without a port, is a loopback name or address.
fn is_loopback_name(host: &str) -> bool {
    let is_port = |port: &str| !port.is_empty() && port.bytes().all(|digit| digit.is_ascii_digit());
    let name = host.rsplit_once(':').filter(|(_, port)| is_port(port)).map_or(host, |(name, _)| name);
    let bare = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    name.eq_ignore_ascii_case("localhost") || bare.parse().is_ok_and(|address: IpAddr| address.is_loopback())
}

/// Number of connections without a session, by address.
#[derive(Debug, Default)]
pub(crate) struct Lobby {
    waiting: Mutex<HashMap<String, usize>>,
}

/// Seat of a connection in the lobby, freed on drop.
#[derive(Debug)]
pub(crate) struct Seat {
    lobby: Arc<Lobby>,
    address: String,
}

impl Lobby {
    fn waiting(&self) -> MutexGuard<'_, HashMap<String, usize>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a seat for a connection from this address; `None` if a limit is reached.
    pub(crate) fn enter(self: &Arc<Self>, address: &str) -> Option<Seat> {
        let mut waiting = self.waiting();
        let of_one = waiting.get(address).copied().unwrap_or(0);
        if of_one >= WAITING_OF_ONE || waiting.values().sum::<usize>() >= WAITING {
            return None;
        }
        waiting.insert(address.to_owned(), of_one + 1);
        Some(Seat { lobby: Arc::clone(self), address: address.to_owned() })
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        let mut waiting = self.lobby.waiting();
        match waiting.get_mut(&self.address) {
            Some(count) if *count > 1 => *count -= 1,
            _ => {
                waiting.remove(&self.address);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SITE: &str = "https://avatar.example.com";

    fn status(headers: &[(HeaderName, &str)], origins: &[&str], is_loopback: bool) -> u16 {
        let headers = headers.iter().map(|(name, value)| (name.clone(), value.parse().unwrap()));
        let mut map = HeaderMap::new();
        headers.for_each(|(name, value)| {
            map.append(name, value);
        });
        let origins: Vec<_> = origins.iter().map(|&origin| origin.to_owned()).collect();
        check(&map, &origins, is_loopback).map_or_else(|(status, ..)| status.as_u16(), |()| 200)
    }

    #[test]
    fn pages_of_other_sites_and_other_names_stay_out() {
        for (host, origin, origins, expected) in [
            ("127.0.0.1:8765", None, &[][..], 200),
            ("localhost:9000", None, &[], 200),
            ("LOCALHOST", None, &[], 200),
            ("[::1]:8765", None, &[], 200),
            ("127.0.0.1:8765", Some("http://127.0.0.1:8765"), &[], 200),
            ("127.0.0.1:8765", Some("http://127.0.0.1:8000"), &[], 403),
            ("127.0.0.1:8765", Some("http://evil.example"), &[], 403),
            ("127.0.0.1:8765", Some("null"), &[], 403),
            ("127.0.0.1:8765", Some("null"), &["null"], 200),
            ("127.0.0.1:8765", Some(SITE), &[SITE], 200),
            ("127.0.0.1:8765", Some("https://avatar.example.com.evil.example"), &[SITE], 403),
            ("avatar.example.com", Some(SITE), &[SITE], 200),
            ("avatar.example.com", None, &[SITE], 200),
            ("evil.example:8765", None, &[SITE], 421),
            // DNS rebinding: the name resolves to this machine.
            ("evil.example:8765", Some("http://evil.example:8765"), &[], 421),
            ("localhost.evil.example", None, &[], 421),
            ("127.0.0.1.evil.example:80", None, &[], 421),
            ("127.0.0.1:evil", None, &[], 421),
            ("", None, &[], 421),
        ] {
            let mut headers = vec![(header::HOST, host)];
            headers.extend(origin.map(|origin| (header::ORIGIN, origin)));
            assert_eq!(status(&headers, origins, true), expected, "{host} {origin:?} {origins:?}");
        }
        // A server that other machines can reach does not know the names they use for it.
        let host = (header::HOST, "10.0.0.7:8765");
        assert_eq!(status(std::slice::from_ref(&host), &[], false), 200);
        assert_eq!(status(&[], &[], false), 200);
        assert_eq!(status(&[host.clone(), (header::ORIGIN, "https://10.0.0.7:8765")], &[], false), 200);
        assert_eq!(status(&[host.clone(), (header::ORIGIN, "http://evil.example")], &[], false), 403);
        let twice = (header::ORIGIN, "http://10.0.0.7:8765");
        assert_eq!(status(&[host, twice.clone(), twice], &[], false), 400);
        assert_eq!(status(&[], &[], true), 421);
    }

    #[test]
    fn origins_are_written_as_browsers_write_them() {
        for good in ["null", SITE, "http://localhost:8000", "http://[::1]:8000"] {
            assert_eq!(check_origin(good), Ok(()));
        }
        for bad in
            ["", "avatar.example.com", "https://", "https://avatar.example.com/", "HTTPS://A", "https://a b", "*"]
        {
            assert!(check_origin(bad).unwrap_err().contains(bad));
        }
    }

    #[test]
    fn seats_are_bounded_by_address_and_in_all_and_come_back() {
        let lobby = Arc::new(Lobby::default());
        let mut seats: Vec<_> = (0..WAITING_OF_ONE).map(|_| lobby.enter("a").unwrap()).collect();
        assert!(lobby.enter("a").is_none());
        let other = lobby.enter("b").unwrap();
        seats.pop();
        seats.push(lobby.enter("a").unwrap());
        drop(other);
        let more = (0..).map_while(|other| lobby.enter(&other.to_string()));
        seats.extend(more);
        assert_eq!(seats.len(), WAITING);
        drop(seats);
        assert!(lobby.waiting().is_empty());
    }
}
