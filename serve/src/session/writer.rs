//! The writing half of a socket: a bounded queue, and the task that drains it.

use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, WebSocket};
use futures_util::SinkExt;
use futures_util::stream::SplitSink;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use crate::protocol::{Code, Reply};

/// Capacity of the queue, in messages.
const QUEUE: usize = 16;
/// Maximum length of the reason in a close frame, in bytes.
const REASON: usize = 123;

type Sink = SplitSink<WebSocket, Message>;

/// Result of the writing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Written {
    /// All queued messages were written.
    All,
    /// The client has gone.
    Gone,
    /// The client does not read.
    Stalled,
}

/// The queue and its task.
#[derive(Debug)]
pub(super) struct Writer {
    queue: mpsc::Sender<Message>,
    task: JoinHandle<(Written, Sink)>,
    stall: Duration,
}

impl Writer {
    pub(super) fn new(sink: Sink, stall: Duration) -> Self {
        let (queue, waiting) = mpsc::channel(QUEUE);
        Self { queue, task: tokio::spawn(write(sink, waiting, stall)), stall }
    }

    /// Reserves a slot in the queue; `None` if it is full.
    pub(super) fn place(&self) -> Option<mpsc::Permit<'_, Message>> {
        self.queue.try_reserve().ok()
    }

    /// Queues a message once there is room; returns `false` if the writing has ended, as for a client that does not
    /// read.
    pub(super) async fn send(&self, message: Message) -> bool {
        self.queue.send(message).await.is_ok()
    }

    /// Waits until the writing task has ended.
    pub(super) async fn ended(&self) {
        self.queue.closed().await;
    }

    /// Closes the queue, waits until it is written, and returns the result.
    pub(super) async fn finish(self) -> Closing {
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
pub(super) struct Closing {
    pub(super) written: Written,
    sink: Option<Sink>,
    stall: Duration,
}

impl Closing {
    /// Sends the reason and closes the socket.
    pub(super) async fn close(self, code: Code, reason: &str) {
        let Some(mut sink) = self.sink else { return };
        let closing = async {
            sink.send(Message::Text(Reply::Error { code: code.name(), reason }.text().into())).await?;
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
