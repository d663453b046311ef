//! Avatars for many clients over WebSocket: audio in, frames or packets out.
//!
//! | module | part |
//! |---|---|
//! | [`config`] | limits and times, and what they may be |
//! | [`tokens`] | the clients' names and secrets |
//! | `door` | which pages of browsers may come in, and how many connections wait |
//! | `hub` | places: how many sessions there are, how many of one client, and whether new ones may come |
//! | [`protocol`] | the messages |
//! | `session` | one client: audio to the engine, frames to the client |
//! | `metrics` | what Prometheus reads |
//! | `server` | sockets, routes, the end |
//!
//! ```text
//! socket ──► session: hello, audio, commands ──► umo_core::Session ──► engine: batches of chunks
//!    ▲                                                                          │
//!    └──── writer ◄── bounded queue ◄── frames, packets, states ◄───────────────┘
//! ```
//!
//! A session never waits for another. What a client sends or does not read is bounded: audio waits in
//! a buffer of [`Config::buffer`], then in the client; frames wait in the queue, then in the engine,
//! which stops computing for that client alone.
#![forbid(unsafe_code)]

pub mod config;
mod door;
mod hub;
mod metrics;
pub mod protocol;
mod server;
mod session;
pub mod tokens;

pub use config::Config;
pub use server::{Server, ServerError, run};
pub use tokens::Tokens;
