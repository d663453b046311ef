//! Limits and times of a server.

use std::time::Duration;

use umo_core::{MAX_BATCH, MAX_SESSIONS, MAX_THREADS, Priority};

use crate::door;
use crate::tokens::Tokens;

/// Most seconds of any time but [`Config::ahead`].
const LONGEST: Duration = Duration::from_secs(24 * 3600);

/// What a server allows.
#[derive(Clone, Debug)]
pub struct Config {
    /// Most sessions at once.
    pub sessions: usize,
    /// Most sessions of one client at once: of one token, or of one address where there are no
    /// tokens.
    pub per_client: usize,
    /// Threads that compute.
    pub threads: usize,
    /// Their priority.
    pub priority: Priority,
    /// The longest that a chunk waits for others, to be computed together.
    pub gather: Duration,
    /// Most sessions that are computed together.
    pub max_batch: usize,
    /// Who may come in; everybody where there are no tokens.
    pub tokens: Tokens,
    /// Origins of web pages that may come in beside the server's own, as browsers write them:
    /// `https://avatar.example.com`.
    pub origins: Vec<String>,
    /// Whether a proxy names the clients' addresses in `X-Forwarded-For`.
    pub is_behind_proxy: bool,
    /// Audio that is computed before its time has come, so that a client that sends a recording at
    /// once takes no time from those that speak; zero for no limit.
    pub ahead: Duration,
    /// Audio of a session that waits, before no more is read from its socket.
    pub buffer: Duration,
    /// Time for the request and the hello.
    pub hello_within: Duration,
    /// Time without audio and commands after which a session ends.
    pub idle: Duration,
    /// Time between pings; a client that is silent for twice as long has gone.
    pub heartbeat: Duration,
    /// Time that one message may take to be written.
    pub stall: Duration,
    /// Time that running sessions have to end in, once the server was told to stop.
    pub drain: Duration,
}

impl Default for Config {
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            sessions: 32,
            per_client: 32,
            threads: cores.min(2),
            priority: Priority::Normal,
            gather: Duration::ZERO,
            max_batch: 8,
            tokens: Tokens::default(),
            origins: Vec::new(),
            is_behind_proxy: false,
            ahead: Duration::from_secs(2),
            buffer: Duration::from_secs(30),
            hello_within: Duration::from_secs(10),
            idle: Duration::from_secs(300),
            heartbeat: Duration::from_secs(20),
            stall: Duration::from_secs(5),
            drain: Duration::from_secs(30),
        }
    }
}

impl Config {
    /// Refuses numbers that no server can have, by the name of the option.
    ///
    /// # Errors
    /// A sentence that says what was expected.
    pub fn check(&self) -> Result<(), String> {
        let count = |name: &str, got: usize, most: usize| {
            if (1..=most).contains(&got) { Ok(()) } else { Err(format!("{name} {got}: expected 1 to {most}")) }
        };
        count("sessions", self.sessions, MAX_SESSIONS)?;
        count("per-client", self.per_client, MAX_SESSIONS)?;
        count("threads", self.threads, MAX_THREADS)?;
        count("batch", self.max_batch, MAX_BATCH)?;
        self.origins.iter().try_for_each(|origin| door::check_origin(origin))?;
        for (name, time) in [
            ("buffer", self.buffer),
            ("hello-within", self.hello_within),
            ("idle", self.idle),
            ("heartbeat", self.heartbeat),
            ("stall", self.stall),
        ] {
            if time.is_zero() || time > LONGEST {
                return Err(format!("{name} {}: expected more than 0 and at most 86400 seconds", time.as_secs_f64()));
            }
        }
        if self.drain > LONGEST || self.ahead > LONGEST {
            return Err("drain and ahead: expected at most 86400 seconds".to_owned());
        }
        Ok(())
    }

    /// Most connections at once: sessions, those that end, and those that did not come to one, which
    /// include who asks for health and metrics.
    pub(crate) fn connections(&self) -> usize {
        2 * self.sessions + door::WAITING
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_range_are_refused_by_name() {
        assert_eq!(Config::default().check(), Ok(()));
        let none = Config { sessions: 0, ..Config::default() };
        assert!(none.check().unwrap_err().contains("sessions 0"));
        let never = Config { stall: Duration::ZERO, ..Config::default() };
        assert!(never.check().unwrap_err().contains("stall"));
        let nowhere = Config { origins: vec!["example.com".to_owned()], ..Config::default() };
        assert!(nowhere.check().unwrap_err().contains("origin example.com"));
        assert_eq!(Config { ahead: Duration::ZERO, drain: Duration::ZERO, ..Config::default() }.check(), Ok(()));
    }
}
