//! Load test: many clients in real time against a running server. Prints the number of refused clients and of late
//! frames.
//!
//! ```sh
//! umo serve --sessions 32 &
//! cargo run --release -p umo-serve --example load -- ws://127.0.0.1:8765/v1/session 40 60
//! ```
//!
//! Arguments: URL, number of clients, and seconds of speech per client, sent in pieces of 20 ms. A frame is late if it
//! arrives more than one chunk after its own time plus the session's latency: a player that started as late as possible
//! would have run out of frames.

use std::env;
use std::process::ExitCode;
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio::time::{Instant, MissedTickBehavior, interval};
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;
use umo_serve::protocol::FRAMES;

const RATE: usize = 16_000;
/// Samples per message.
const PIECE: usize = RATE / 50;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Result of one client.
#[derive(Debug)]
enum Outcome {
    Refused(String),
    Served { frames: u64, late: u64, late_by_server: u64, worst: Duration },
}

fn main() -> ExitCode {
    let args: Vec<String> = env::args().skip(1).collect();
    let [url, clients, seconds] = args.as_slice() else {
        eprintln!("usage: load URL CLIENTS SECONDS; UMO_TOKEN is sent if set");
        return ExitCode::from(2);
    };
    let (Ok(clients), Ok(seconds)) = (clients.parse(), seconds.parse()) else {
        eprintln!("CLIENTS and SECONDS are numbers");
        return ExitCode::from(2);
    };
    match tokio::runtime::Runtime::new()
        .map_err(Failure::from)
        .map(|runtime| runtime.block_on(run(url, clients, seconds)))
    {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

async fn run(url: &str, clients: u64, seconds: usize) {
    let running: Vec<_> = (0..clients)
        .map(|seed| {
            let url = url.to_owned();
            tokio::spawn(async move {
                // Clients start at different times.
                tokio::time::sleep(Duration::from_millis(seed * 37 % 1_000)).await;
                speak(&url, seed, seconds).await
            })
        })
        .collect();
    let (mut served, mut refused, mut failed, mut all) = (0, 0, 0, (0, 0, 0, Duration::ZERO));
    for client in running {
        match client.await {
            Ok(Ok(Outcome::Served { frames, late, late_by_server, worst })) => {
                served += 1;
                all = (all.0 + frames, all.1 + late, all.2 + late_by_server, all.3.max(worst));
            }
            Ok(Ok(Outcome::Refused(reason))) => {
                if refused == 0 {
                    println!("refused: {reason}");
                }
                refused += 1;
            }
            Ok(Err(error)) => {
                eprintln!("failed: {error}");
                failed += 1;
            }
            Err(error) => {
                eprintln!("failed: {error}");
                failed += 1;
            }
        }
    }
    let (frames, late, late_by_server, worst) = all;
    println!("clients served {served}, refused {refused}, failed {failed}");
    println!("frames {frames}, late here {late}, late for the server {late_by_server}");
    println!("longest delay beyond the latency: {:.0} ms", 1e3 * worst.as_secs_f64());
}

async fn speak(url: &str, seed: u64, seconds: usize) -> Result<Outcome, Failure> {
    let (socket, _) = connect_async(url).await?;
    let (mut sink, mut stream) = socket.split();
    let mut hello = json!({ "type": "hello", "rate": RATE, "seed": seed });
    if let Ok(token) = env::var("UMO_TOKEN") {
        hello["token"] = token.into();
    }
    sink.send(Message::text(hello.to_string())).await?;
    let Some(Message::Text(first)) = stream.next().await.transpose()? else { return Err("no answer".into()) };
    let ready: Value = serde_json::from_str(&first)?;
    if ready["type"] != "ready" {
        return Ok(Outcome::Refused(ready["reason"].to_string()));
    }
    let number = |key: &str| ready[key].as_u64().ok_or(format!("no {key} in {ready}"));
    let latency = Duration::from_secs_f64(number("latency_samples")? as f64 / RATE as f64);
    let (rate, floats) = (number("frame_rate")?, usize::try_from(number("floats")?)?);
    let chunk = Duration::from_secs_f64(number("chunk_frames")? as f64 / rate as f64);

    let start = Instant::now();
    let speaking = tokio::spawn(async move {
        let mut tick = interval(Duration::from_millis(20));
        tick.set_missed_tick_behavior(MissedTickBehavior::Burst);
        let mut noise = u32::try_from(seed % 1_000_000).unwrap_or_default() + 1;
        for _ in 0..seconds * RATE / PIECE {
            tick.tick().await;
            let piece = (0..PIECE).flat_map(|_| {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let bytes = noise.to_le_bytes();
                // A quarter of full scale.
                (i16::from_le_bytes([bytes[2], bytes[3]]) / 4).to_le_bytes()
            });
            sink.send(Message::binary(piece.collect::<Vec<u8>>())).await?;
        }
        sink.send(Message::text(r#"{"type":"finish"}"#)).await?;
        Ok::<_, Failure>(sink)
    });
    let (mut frames, mut late, mut worst) = (0, 0, Duration::ZERO);
    while let Some(message) = stream.next().await {
        match message? {
            Message::Binary(bytes) if bytes.first() == Some(&FRAMES) => {
                for frame in bytes[8..].chunks_exact(16 + 4 * floats) {
                    let index = u64::from_le_bytes(frame[..8].try_into()?);
                    let due = start + latency + Duration::from_secs_f64(index as f64 / rate as f64);
                    let delay = Instant::now().saturating_duration_since(due);
                    worst = worst.max(delay);
                    late += u64::from(delay > chunk);
                    frames += 1;
                }
            }
            Message::Text(text) => {
                let text: Value = serde_json::from_str(&text)?;
                if text["type"] != "done" {
                    return Err(text.to_string().into());
                }
                speaking.await??.close().await?;
                let late_by_server = text["late_frames"].as_u64().unwrap_or_default();
                return Ok(Outcome::Served { frames, late, late_by_server, worst });
            }
            _ => {}
        }
    }
    Err("the server closed without a message".into())
}
