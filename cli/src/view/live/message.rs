//! Messages between page and program: commands, news, samples and frames.

use serde::{Deserialize, Serialize};
use umo_core::{Frame, Latency, MAX_AMPLITUDE, MAX_RATE, MIN_RATE, Stats};

/// Upper bound on the samples of one message.
pub(super) const MAX_SAMPLES: usize = 1 << 16;
/// Upper bound on the bytes of one message.
pub(super) const MAX_BYTES: usize = 4 * MAX_SAMPLES;

/// A command from a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Command {
    /// Starts a stream.
    Start {
        /// Source of the audio.
        source: Source,
        /// Sample rate of the page's audio.
        rate: Option<u32>,
    },
    /// Ends the audio.
    Finish,
}

/// Source of the audio.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Source {
    /// The program's own recording.
    Recording,
    /// A recording that the page sends in real time.
    Page,
    /// The page's microphone.
    Microphone,
}

/// A message to the page; times in seconds.
#[derive(Debug, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(super) enum News<'a> {
    /// The stream accepts audio from now on.
    Started {
        /// Whether the mouth moves with the sound.
        live: bool,
        /// Upper bound on the future audio that a mouth needs.
        mouth_seconds: f64,
        /// Upper bound on the future audio that a body needs.
        body_seconds: f64,
    },
    /// Statistics of the stream.
    Status {
        /// Median time to compute a chunk.
        compute_p50: f64,
        /// 99th percentile of that time.
        compute_p99: f64,
        /// Maximum of that time.
        compute_max: f64,
        /// Number of chunks so far.
        chunks: u64,
        /// Number of frames computed too late for real time.
        late_frames: u64,
        /// Number of samples that found no room.
        overruns: u64,
    },
    /// Every frame was sent.
    Done {
        /// Number of frames.
        frames: u64,
    },
    /// The stream ended with an error.
    Error {
        /// Description.
        reason: &'a str,
    },
}

impl News<'_> {
    pub(super) fn status(latency: &Latency, stats: &Stats) -> Self {
        Self::Status {
            compute_p50: latency.compute_p50.as_secs_f64(),
            compute_p99: latency.compute_p99.as_secs_f64(),
            compute_max: latency.compute_max.as_secs_f64(),
            chunks: stats.chunks,
            late_frames: stats.late_frames,
            overruns: stats.overruns,
        }
    }

    pub(super) fn json(&self) -> String {
        serde_json::to_string(self).expect("plain numbers and words")
    }
}

/// Parses a command, or returns its problem.
pub(super) fn command(text: &str) -> Result<Command, String> {
    let command = serde_json::from_str(text).map_err(|error| format!("not a command: {error}"))?;
    if let Command::Start { source, rate } = command {
        let known = rate.is_some_and(|rate| (MIN_RATE..=MAX_RATE).contains(&(rate as usize)));
        if source != Source::Recording && !known {
            return Err(format!("what the page sends has a rate of {MIN_RATE} to {MAX_RATE}"));
        }
    }
    Ok(command)
}

/// Parses the samples of a message, 32-bit floats, or returns their problem.
pub(super) fn samples(bytes: &[u8]) -> Result<Vec<f32>, String> {
    let (samples, []) = bytes.as_chunks::<4>() else {
        return Err("samples are 32-bit floats: a message has four bytes for each".to_owned());
    };
    let samples: Vec<f32> = samples.iter().map(|&sample| f32::from_le_bytes(sample)).collect();
    match samples.iter().all(|sample| (-MAX_AMPLITUDE..=MAX_AMPLITUDE).contains(sample)) {
        true => Ok(samples),
        false => Err("a sample is not a usable number".to_owned()),
    }
}

/// Consecutive frames for one message: the index of the first, then the values of each.
#[derive(Debug, Default)]
pub(super) struct Frames(Vec<u8>);

impl Frames {
    /// Adds a frame, and the values of a character's channels in it.
    #[expect(clippy::cast_possible_truncation, reason = "2^32 frames are four years")]
    pub(super) fn add(&mut self, frame: Frame, worn: &[f32]) {
        if self.0.is_empty() {
            self.0.extend((frame.index as u32).to_le_bytes());
        }
        let rotations = frame.pose.rotations.as_flattened().iter();
        let values = rotations.chain(&frame.pose.translation).chain(frame.face).chain(worn);
        self.0.extend(values.flat_map(|value| value.to_le_bytes()));
    }

    /// Returns the message; `None` if there are no frames.
    pub(super) fn message(self) -> Option<Vec<u8>> {
        (!self.0.is_empty()).then_some(self.0)
    }
}
