//! A client's WebSocket: its limits, the reading, the writing from a bounded queue, and its end. `examples/echo.rs`
//! includes this file.

use std::error::Error;
use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};

use crate::protocol::{Code, MOST_BYTES};

/// Size of a socket's read buffer, in bytes.
const READ: usize = 8 << 10;
/// Time limit for the client's close frame.
const FAREWELL: Duration = Duration::from_secs(2);
/// Delay before a connection with unread input is closed.
const LAST_LOOK: Duration = Duration::from_millis(500);
/// Capacity of the queue, in messages.
const QUEUE: usize = 16;
/// Maximum length of the reason in a close frame, in bytes.
const REASON: usize = 123;

type Sink = SplitSink<WebSocket, Message>;

/// Sets the limits of a socket.
pub(crate) fn bounded(upgrade: WebSocketUpgrade) -> WebSocketUpgrade {
    upgrade.max_message_size(MOST_BYTES).max_frame_size(MOST_BYTES).read_buffer_size(READ)
}

/// Reason why no more messages can be read.
#[derive(Debug)]
pub(crate) enum Broken {
    /// The connection is lost.
    Lost,
    /// The client violates the WebSocket protocol or a limit, and is told so.
    Invalid(Code, String),
}

/// Reads the next message.
pub(crate) async fn next(stream: &mut SplitStream<WebSocket>) -> Result<Message, Broken> {
    match stream.next().await {
        Some(Ok(message)) => Ok(message),
        Some(Err(error)) => Err(broken(&error)),
        None => Err(Broken::Lost),
    }
}

/// Classifies a read error.
fn broken(error: &axum::Error) -> Broken {
    use tungstenite::Error::{AlreadyClosed, Capacity, ConnectionClosed, Io, Protocol, Utf8};
    use tungstenite::error::ProtocolError::ResetWithoutClosingHandshake;
    let code = match error.source().and_then(|error| error.downcast_ref()) {
        None | Some(ConnectionClosed | AlreadyClosed | Io(_) | Protocol(ResetWithoutClosingHandshake)) => {
            return Broken::Lost;
        }
        Some(Utf8(_)) => Code::NotUtf8,
        Some(Capacity(_)) => Code::TooBig,
        Some(_) => Code::BadFrame,
    };
    Broken::Invalid(code, error.to_string())
}

/// Waits for the end of a connection, after a close frame of the client (`is_closed`) or of the server.
pub(crate) async fn leave(mut stream: SplitStream<WebSocket>, mut is_closed: bool) {
    // Reading answers the client's close frame. Unread input would reset the connection, and the client would
    // lose the reason.
    let reading = async {
        while let Some(Ok(message)) = stream.next().await {
            is_closed |= matches!(message, Message::Close(_));
        }
    };
    let _ = timeout(FAREWELL, reading).await;
    // After invalid input the rest is not read: the client has this long to read the reason.
    if !is_closed {
        sleep(LAST_LOOK).await;
    }
}

/// Result of the writing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Written {
    /// All queued messages were written.
    All,
    /// The client has gone.
    Gone,
    /// The client does not read.
    Stalled,
}

/// The queue and its task.
#[derive(Debug)]
pub(crate) struct Writer {
    queue: mpsc::Sender<Message>,
    task: JoinHandle<(Written, Sink)>,
    stall: Duration,
}

impl Writer {
    pub(crate) fn new(sink: Sink, stall: Duration) -> Self {
        let (queue, waiting) = mpsc::channel(QUEUE);
        Self { queue, task: tokio::spawn(write(sink, waiting, stall)), stall }
    }

    /// Reserves a slot in the queue; `None` if it is full.
    pub(crate) fn place(&self) -> Option<mpsc::Permit<'_, Message>> {
        self.queue.try_reserve().ok()
    }

    /// Queues a message once there is room; returns `false` if the writing has ended, as for a client that does not
    /// read.
    pub(crate) async fn send(&self, message: Message) -> bool {
        self.queue.send(message).await.is_ok()
    }

    /// Waits until the writing task has ended.
    pub(crate) async fn ended(&self) {
        self.queue.closed().await;
    }

    /// Closes the queue, waits until it is written, and returns the result.
    pub(crate) async fn finish(self) -> Closing {
        let Self { queue, mut task, stall } = self;
        drop(queue);
        match timeout(2 * stall, &mut task).await {
            Ok(Ok((written, sink))) => Closing { written, sink: Some(sink), stall },
            Ok(Err(_)) => Closing { written: Written::Gone, sink: None, stall },
            Err(_) => {
                task.abort();
                Closing { written: Written::Stalled, sink: None, stall }
            }
        }
    }
}

/// A socket whose queue is closed.
#[derive(Debug)]
pub(crate) struct Closing {
    pub(crate) written: Written,
    sink: Option<Sink>,
    stall: Duration,
}

impl Closing {
    /// Sends the last text, if there is one, and closes the socket.
    pub(crate) async fn close(self, last: Option<String>, code: Code, reason: &str) {
        let Some(mut sink) = self.sink else { return };
        let closing = async {
            if let Some(text) = last {
                sink.send(Message::Text(text.into())).await?;
            }
            let frame = CloseFrame { code: code.number(), reason: shortened(reason).into() };
            sink.send(Message::Close(Some(frame))).await
        };
        // A client that does not take the message in time has gone, or never reads.
        let _ = timeout(self.stall, closing).await;
    }
}

async fn write(mut sink: Sink, mut waiting: mpsc::Receiver<Message>, stall: Duration) -> (Written, Sink) {
    while let Some(message) = waiting.recv().await {
        match timeout(stall, sink.send(message)).await {
            Ok(Ok(())) => {}
            Ok(Err(_)) => return (Written::Gone, sink),
            Err(_) => return (Written::Stalled, sink),
        }
    }
    (Written::All, sink)
}

/// Truncates a reason to the room in a close frame.
fn shortened(reason: &str) -> &str {
    &reason[..reason.floor_char_boundary(REASON)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_are_cut_between_characters() {
        assert_eq!(shortened("short"), "short");
        assert_eq!(shortened(&"é".repeat(100)).len(), 122);
    }
}
