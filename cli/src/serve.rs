//! `umo serve`: avatars for many clients over WebSocket (crate `umo_serve`).

use std::net::ToSocketAddrs;
use std::time::Duration;

use umo_serve::{Config, ServerError, Tokens};

use crate::args::Serve;
use crate::failure::Failure;
use crate::model;

/// Serves until SIGTERM or Ctrl-C.
pub(crate) fn run(args: &Serve) -> Result<(), Failure> {
    let config = config(args)?;
    let sessions = config.sessions;
    let ready = |address| umo_serve::note(format_args!("listening at {address}, {sessions} places"));
    umo_serve::run(&args.listen, config, model::load(&args.engine.compute)?, ready)
        .map_err(|error| failure(&error, &format!("--listen {}", args.listen)))
}

/// Returns a server's failure; `place` is the argument with its address.
pub(crate) fn failure(error: &ServerError, place: &str) -> Failure {
    match error {
        ServerError::Config(problem) => Failure::Input(format!("--{problem}")),
        ServerError::Engine(error) => Failure::environment(error),
        ServerError::System(..) => Failure::environment(format!("{place}: {error}")),
    }
}

/// Returns the server's configuration from the arguments and the tokens file.
fn config(args: &Serve) -> Result<Config, Failure> {
    let tokens = match &args.tokens {
        None => Tokens::default(),
        Some(path) => {
            let wrong = |problem: String| Failure::Input(format!("{}: {problem}", path.display()));
            let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
            Tokens::parse(&text).map_err(wrong)?
        }
    };
    if tokens.is_empty() && !args.open && !is_local(&args.listen) {
        let problem =
            "this address can be reached from other machines: give --tokens FILE, or --open to accept everyone";
        return Err(Failure::Input(format!("--listen {}: {problem}", args.listen)));
    }
    Ok(Config {
        sessions: args.sessions,
        per_client: args.per_client.unwrap_or(args.sessions),
        engine: model::engine_config(&args.engine)?,
        session: None,
        page: None,
        tokens,
        origins: args.origin.clone(),
        is_behind_proxy: args.behind_proxy,
        ahead: Duration::from_secs_f64(args.ahead),
        buffer: Duration::from_secs_f64(args.buffer),
        hello_within: Duration::from_secs_f64(args.hello_within),
        idle: Duration::from_secs_f64(args.idle),
        heartbeat: Duration::from_secs_f64(args.heartbeat),
        stall: Duration::from_secs_f64(args.stall),
        drain: Duration::from_secs_f64(args.drain),
    })
}

/// Whether an address is reachable only from this machine. The server itself refuses invalid addresses.
fn is_local(address: &str) -> bool {
    address.to_socket_addrs().is_ok_and(|mut all| all.all(|address| address.ip().is_loopback()))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::args::{Args, Command};

    fn parsed(more: &[&str]) -> Result<Config, Failure> {
        let line = ["umo", "serve"].iter().chain(more);
        let Command::Serve(args) = Args::try_parse_from(line).unwrap().command else { panic!("serve") };
        config(&args)
    }

    #[test]
    fn an_address_that_others_reach_needs_tokens_or_a_word() {
        assert!(parsed(&[]).unwrap().tokens.is_empty());
        assert!(parsed(&["--listen", "localhost:1"]).is_ok());
        let refused = parsed(&["--listen", "0.0.0.0:1"]).unwrap_err();
        assert!(refused.to_string().contains("--tokens"), "{refused}");
        assert!(parsed(&["--listen", "0.0.0.0:1", "--open"]).is_ok());

        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("tokens");
        let with_file = || parsed(&["--listen", "0.0.0.0:1", "--tokens", file.to_str().unwrap()]);
        assert!(with_file().unwrap_err().to_string().contains("tokens"), "the file is missing");
        std::fs::write(&file, "studio short").unwrap();
        assert!(with_file().unwrap_err().to_string().contains("line 1"));
        std::fs::write(&file, "studio 0123456789abcdef").unwrap();
        assert_eq!(with_file().unwrap().tokens.name("0123456789abcdef"), Some("studio"));
    }

    #[test]
    fn one_client_may_have_all_places_unless_said_otherwise() {
        assert_eq!(parsed(&["--sessions", "5"]).unwrap().per_client, 5);
        assert_eq!(parsed(&["--sessions", "5", "--per-client", "2"]).unwrap().per_client, 2);
        assert!(Args::try_parse_from(["umo", "serve", "--idle", "-1"]).is_err());
    }
}
