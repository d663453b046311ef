//! Avatars for many clients over WebSocket: audio in, frames or packets out.
//!
//! | module | part |
//! |---|---|
//! | [`config`] | limits, timeouts and their ranges |
//! | [`tokens`] | names and secrets of clients |
//! | `door` | accepted origins, and limits on connections without a session |
//! | `hub` | session slots, in all and by client, and whether new sessions are accepted |
//! | [`protocol`] | the messages |
//! | `room` | sessions that see each other |
//! | `session` | one client: audio to the engine, frames to the client |
//! | `socket` | its WebSocket: limits, reading, writing, close |
//! | [`page`] | a page for browsers on this machine, and its character |
//! | `metrics` | metrics for Prometheus |
//! | `server` | sockets, routes, shutdown |
//!
//! ```text
//! socket ──► session: hello, audio, commands ──► umo_core::Session ──► engine: batches of chunks
//!    ▲                                                                          │
//!    └──── socket ◄── bounded queue ◄── frames, packets, states ◄───────────────┘
//! ```
//!
//! Sessions never wait for each other. Memory per client is bounded: audio waits in a buffer of
//! [`Config::buffer`], then in the client; frames wait in the queue, then in the engine, which pauses that
//! client's session alone.
#![forbid(unsafe_code)]

pub mod config;
mod door;
mod hub;
mod metrics;
pub mod page;
pub mod protocol;
mod room;
mod server;
mod session;
mod socket;
pub mod tokens;

pub use config::Config;
pub use page::Page;
pub use server::{Server, ServerError, note, run};
pub use tokens::Tokens;
