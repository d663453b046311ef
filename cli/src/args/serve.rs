//! Arguments of `umo serve`.

use std::path::PathBuf;

use clap::Args as ClapArgs;

use super::EngineArgs;

/// Heading of the options for limits and timeouts.
const LIMITS: &str = "Limits";

/// Serve avatars over WebSocket.
///
/// Clients connect to ws://ADDRESS/v1/session, say hello in JSON, send 16-bit samples, and get frames or
/// packets. /healthz says whether new clients may come, /metrics has numbers for Prometheus. SIGTERM ends
/// it gracefully. For TLS, put a proxy in front.
#[derive(Debug, ClapArgs)]
pub struct Serve {
    /// Address to listen at; 0.0.0.0:PORT accepts other machines and needs --tokens or --open
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:8765")]
    pub listen: String,
    /// Most sessions at once; `umo bench --sessions N` measures how many this machine can take
    #[arg(long, value_name = "N", default_value_t = 32)]
    pub sessions: usize,
    /// Most sessions of one token, or of one address without tokens [default: --sessions]
    #[arg(long, value_name = "N")]
    pub per_client: Option<usize>,
    /// File of tokens, a line each: a name for the client, and its token of 16 characters or more
    #[arg(long, value_name = "FILE")]
    pub tokens: Option<PathBuf>,
    /// Accept clients without a token
    #[arg(long, conflicts_with = "tokens")]
    pub open: bool,
    /// Origin of web pages that may connect beside the server's own; may be repeated
    ///
    /// As browsers write it: `https://avatar.example.com`.
    #[arg(long, value_name = "ORIGIN")]
    pub origin: Vec<String>,
    /// Take clients' addresses from a proxy's X-Forwarded-For
    #[arg(long)]
    pub behind_proxy: bool,
    /// Audio computed ahead of real time; 0 for no limit
    ///
    /// A client that sends a recording at once then does not delay others.
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, value_parser = seconds, help_heading = LIMITS, hide_short_help = true)]
    pub ahead: f64,
    /// Audio of a session queued here before its client has to wait
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = seconds, help_heading = LIMITS, hide_short_help = true)]
    pub buffer: f64,
    /// Timeout of a client's hello
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0, value_parser = seconds, help_heading = LIMITS, hide_short_help = true)]
    pub hello_within: f64,
    /// Timeout of a session without audio and commands
    #[arg(long, value_name = "SECONDS", default_value_t = 300.0, value_parser = seconds, help_heading = LIMITS, hide_short_help = true)]
    pub idle: f64,
    /// Time between pings; a client silent for twice as long is disconnected
    #[arg(long, value_name = "SECONDS", default_value_t = 20.0, value_parser = seconds, help_heading = LIMITS, hide_short_help = true)]
    pub heartbeat: f64,
    /// Timeout of a client that reads a message
    #[arg(long, value_name = "SECONDS", default_value_t = 5.0, value_parser = seconds, help_heading = LIMITS, hide_short_help = true)]
    pub stall: f64,
    /// Time for running sessions to finish after SIGTERM
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = seconds, help_heading = LIMITS, hide_short_help = true)]
    pub drain: f64,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub engine: EngineArgs,
}

/// A timeout of a server.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.0..=86_400.0).contains(seconds));
    seconds.ok_or_else(|| "expected 0 to 86400 seconds".to_owned())
}
