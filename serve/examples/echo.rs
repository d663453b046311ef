//! Echo server with the WebSocket code of `umo serve` (`src/socket.rs`), for `scripts/test/protocols`: suites that test
//! servers expect their messages back. Prints its URL.

use std::io;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::routing::get;
use futures_util::StreamExt;
use tokio::net::TcpListener;
use umo_serve::protocol;

#[path = "../src/socket.rs"]
#[expect(dead_code, reason = "a session uses more of it")]
mod socket;

use socket::{Broken, Writer, bounded, leave, next};

/// Time limit for writing one message.
const STALL: Duration = Duration::from_secs(5);

#[tokio::main(flavor = "multi_thread", worker_threads = 2)]
async fn main() -> io::Result<()> {
    let listener = TcpListener::bind("127.0.0.1:0").await?;
    println!("ws://{}", listener.local_addr()?);
    let upgrade = async |upgrade: WebSocketUpgrade| bounded(upgrade).on_upgrade(echo);
    axum::serve(listener, Router::new().route("/", get(upgrade))).await
}

async fn echo(socket: WebSocket) {
    let (sink, mut stream) = socket.split();
    let writer = Writer::new(sink, STALL);
    let end = loop {
        match next(&mut stream).await {
            Ok(message @ (Message::Text(_) | Message::Binary(_))) => {
                writer.send(message).await;
            }
            Ok(Message::Ping(_) | Message::Pong(_)) => {}
            Ok(Message::Close(_)) => break Broken::Lost,
            Err(broken) => break broken,
        }
    };
    let closing = writer.finish().await;
    let is_closed = matches!(end, Broken::Lost);
    if let Broken::Invalid(code, reason) = end {
        closing.close(None, code, &reason).await;
    }
    leave(stream, is_closed).await;
}
