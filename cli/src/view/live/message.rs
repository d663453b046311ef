//! What page and program say to each other: commands, news, samples and frames.

use serde::{Deserialize, Serialize};
use umo_core::audio::MAX_AMPLITUDE;
use umo_core::session::{Frame, Latency, MAX_RATE, MIN_RATE, Stats};

/// Most samples of one message.
pub(super) const MAX_SAMPLES: usize = 1 << 16;
/// Most bytes of one message.
pub(super) const MAX_BYTES: usize = 4 * MAX_SAMPLES;

/// What a page asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Command {
    /// A new stream.
    Start {
        /// Source of the audio.
        source: Source,
        /// Samples a second of what the page sends.
        rate: Option<u32>,
    },
    /// No more sound.
    Finish,
}

/// Source of the audio.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Source {
    /// The recording that the program was given.
    Recording,
    /// A recording that the page sends as it is spoken.
    Page,
    /// The page's microphone.
    Microphone,
}

/// A message to the page; times in seconds.
#[derive(Debug, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(super) enum News<'a> {
    /// Audio is taken from now on.
    Started {
        /// Whether the mouth moves with the sound.
        live: bool,
        /// Future audio that a mouth needs at most.
        mouth_seconds: f64,
        /// Future audio that a body needs at most.
        body_seconds: f64,
    },
    /// How the stream goes.
    Status {
        /// Median time of computing a chunk.
        compute_p50: f64,
        /// Its 99th percentile.
        compute_p99: f64,
        /// Its largest.
        compute_max: f64,
        /// Chunks so far.
        chunks: u64,
        /// Frames that were computed later than real time needs them.
        late_frames: u64,
        /// Samples that found no room.
        overruns: u64,
    },
    /// Every frame was sent.
    Done {
        /// How many.
        frames: u64,
    },
    /// The stream ends because of this.
    Error {
        /// In words.
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

/// A command, or what is wrong with it.
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

/// The samples of a message, 32-bit floats, or what is wrong with them.
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

/// Frames in a row for one message: the number of the first, then the values of each.
#[derive(Debug, Default)]
pub(super) struct Frames(Vec<u8>);

impl Frames {
    /// Adds a frame, and what a character's channels have in it.
    #[expect(clippy::cast_possible_truncation, reason = "2^32 frames are four years")]
    pub(super) fn add(&mut self, frame: Frame, worn: &[f32]) {
        if self.0.is_empty() {
            self.0.extend((frame.index as u32).to_le_bytes());
        }
        let rotations = frame.pose.rotations.as_flattened().iter();
        let values = rotations.chain(&frame.pose.translation).chain(frame.face).chain(worn);
        self.0.extend(values.flat_map(|value| value.to_le_bytes()));
    }

    /// The message; none without a frame.
    pub(super) fn message(self) -> Option<Vec<u8>> {
        (!self.0.is_empty()).then_some(self.0)
    }
}
