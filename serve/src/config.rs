//! Limits and times of a server.

use std::sync::Arc;
use std::time::Duration;

use umo_core::{EngineConfig, MAX_BATCH, MAX_SESSIONS, MAX_THREADS, SessionConfig, Threads};

use crate::door;
use crate::page::Page;
use crate::tokens::Tokens;

/// Upper bound on the configured durations.
const LONGEST: Duration = Duration::from_secs(24 * 3600);

/// Limits and timeouts of a server.
#[derive(Clone, Debug)]
pub struct Config {
    /// Maximum number of sessions at once.
    pub sessions: usize,
    /// Maximum number of sessions per client at once. A client is a token, or an address if there are no tokens.
    pub per_client: usize,
    /// The engine. Its number of sessions follows from [`Config::sessions`].
    pub engine: EngineConfig,
    /// Settings of a session that a hello does not give; `None` for the model's.
    pub session: Option<SessionConfig>,
    /// Page for browsers on this machine, if the server has one.
    pub page: Option<Arc<dyn Page>>,
    /// Accepted bearer tokens; without any, every client is accepted.
    pub tokens: Tokens,
    /// Origins of web pages that are accepted besides the server's own, as browsers write them:
    /// `https://avatar.example.com`.
    pub origins: Vec<String>,
    /// Whether a proxy reports the clients' addresses in `X-Forwarded-For`.
    pub is_behind_proxy: bool,
    /// Upper bound on audio computed ahead of real time, so that a client that sends a whole recording
    /// does not starve live speakers; zero for no limit.
    pub ahead: Duration,
    /// Audio that a session buffers before the server stops reading from its socket.
    pub buffer: Duration,
    /// Time limit for the request and the hello.
    pub hello_within: Duration,
    /// Time without audio or commands after which a session ends.
    pub idle: Duration,
    /// Interval between pings; a client that is silent for two of them counts as gone.
    pub heartbeat: Duration,
    /// Time limit for writing one message.
    pub stall: Duration,
    /// Time that running sessions have to finish after the server was told to stop.
    pub drain: Duration,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            sessions: 32,
            per_client: 32,
            engine: EngineConfig::default(),
            session: None,
            page: None,
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
    /// Checks that every value is in range; errors use the name of the command-line option.
    ///
    /// # Errors
    /// A message that names the option and its valid range.
    pub fn check(&self) -> Result<(), String> {
        let count = |name: &str, got: usize, most: usize| {
            if (1..=most).contains(&got) { Ok(()) } else { Err(format!("{name} {got}: expected 1 to {most}")) }
        };
        count("sessions", self.sessions, MAX_SESSIONS)?;
        count("per-client", self.per_client, MAX_SESSIONS)?;
        match self.engine.threads {
            Threads::Own(threads) => count("threads", threads, MAX_THREADS)?,
            Threads::Host(_) => return Err("threads: the engine of a server has its own".to_owned()),
        }
        count("batch", self.engine.max_batch, MAX_BATCH)?;
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

    /// Maximum number of connections: running sessions, sessions that are closing, and connections without a
    /// session, which include requests for health and metrics.
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
