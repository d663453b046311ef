//! The messages: JSON text both ways; binary samples in; binary frames, packets and states out.
//!
//! A client's binary message is 16-bit little-endian mono samples, one Opus packet, or a piece of the state
//! that its hello announced. The first byte of a server's binary message is its kind:
//!
//! | byte | content |
//! |---|---|
//! | 1 | frames: a zero byte, `u16` count, `u32` floats per frame; then for each `u64` index, `u64` sample, floats |
//! | 2 | one packet |
//! | 3 | a piece of a state; the text message before the first piece gives the length of the state |
//!
//! All numbers are little-endian. The floats of a frame are 55 rotations x y z w, the root translation, and
//! the face channels.

use serde::{Deserialize, Serialize};
use umo_core::{Frame, GestureOptions, JOINTS, Mood, Side};

/// Version of the protocol.
pub const VERSION: u32 = 1;
/// Maximum length of a message in either direction, in bytes.
pub const MOST_BYTES: usize = 64 << 10;

/// First byte of a message that holds frames.
pub const FRAMES: u8 = 1;
/// First byte of a message that holds a packet.
pub const PACKET: u8 = 2;
/// First byte of a message that holds a piece of a state.
pub const STATE: u8 = 3;

/// Length in bytes of a frame message's header.
const HEAD: usize = 8;
/// Maximum number of frames in a message.
const FRAMES_AT_ONCE: usize = 32;

/// First message of a client: settings of its session.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hello {
    /// Protocol version, [`VERSION`].
    #[serde(default = "version")]
    pub version: u32,
    /// Bearer token, if the request had none.
    #[serde(default)]
    pub token: Option<String>,
    /// Format of the client's audio.
    #[serde(default)]
    pub audio: AudioKind,
    /// Sample rate in Hz; for Opus, the rate that packets are decoded to.
    #[serde(default = "rate", deserialize_with = "whole")]
    pub rate: usize,
    /// Requested output.
    #[serde(default)]
    pub output: Output,
    /// Timing of the mouth.
    #[serde(default)]
    pub voice: VoiceKind,
    /// Free-text prompt, for models that accept one.
    #[serde(default)]
    pub prompt: Option<String>,
    /// Language of the words.
    #[serde(default)]
    pub language: Option<String>,
    /// Initial mood.
    #[serde(default)]
    pub mood: Option<MoodName>,
    /// Strength of the mood, 0 to 1.
    #[serde(default = "one")]
    pub mood_strength: f32,
    /// Seed of the sampling; the server's default if absent, as for the next three.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Keyframes in a chunk.
    #[serde(default)]
    pub target: Option<usize>,
    /// Audio behind a chunk that the chunk waits for, in keyframes.
    #[serde(default)]
    pub horizon: Option<usize>,
    /// Strength of the procedural layers over the model's motion, 0 to 1.
    #[serde(default)]
    pub layers: Option<f32>,
    /// Whether the values of the channels of the server's character follow the face in each frame.
    #[serde(default)]
    pub character: bool,
    /// Whether the client takes the session's state when the server stops.
    #[serde(default)]
    pub handover: bool,
    /// Room that the session joins: those in it see each other.
    #[serde(default)]
    pub room: Option<String>,
    /// Place in the room: x and z in metres, and degrees to the left of +Z.
    #[serde(default)]
    pub place: Option<[f32; 3]>,
    /// Length in bytes of a state that follows in binary messages and that the session resumes from.
    #[serde(default)]
    pub restore: Option<usize>,
    /// Number of leading samples to drop: the part of a packet that the state already covers, and the
    /// earlier packets that let the decoder converge.
    #[serde(default)]
    pub skip: usize,
}

const fn version() -> u32 {
    VERSION
}

const fn rate() -> usize {
    16_000
}

/// Deserializes a whole number, also if written as a float: `44100.0`.
#[expect(clippy::cast_possible_truncation, reason = "whole and in range")]
fn whole<'de, D: serde::Deserializer<'de>>(from: D) -> Result<usize, D::Error> {
    let number = f64::deserialize(from)?;
    if number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number) {
        return Ok(number as usize);
    }
    Err(serde::de::Error::custom(format!("{number}: expected a whole number")))
}

const fn one_packet() -> u32 {
    1
}

const fn one() -> f32 {
    1.0
}

/// Format of a client's audio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AudioKind {
    /// 16-bit little-endian mono samples.
    #[default]
    Pcm,
    /// One packet of RFC 6716 per message, mono or stereo.
    Opus,
}

/// Output of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Output {
    /// Poses.
    #[default]
    Frames,
    /// Codes, to be decoded elsewhere.
    Packets,
}

/// Timing of the mouth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VoiceKind {
    /// With the body.
    #[default]
    Delayed,
    /// With the audio, as it is heard.
    Live,
}

/// Mood, given by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct MoodName(pub Mood);

impl TryFrom<String> for MoodName {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let known = || Mood::ALL.map(Mood::name).join(", ");
        let found = Mood::ALL.into_iter().find(|mood| mood.name() == name);
        found.map(Self).ok_or_else(|| format!("unknown mood `{name}`; known: {}", known()))
    }
}

/// Hand for a gesture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names say it")]
pub enum SideName {
    #[default]
    Auto,
    Left,
    Right,
    Both,
}

/// Text message of a client.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// The first message of a connection.
    Hello(Hello),
    /// Ends the speech: its last frames follow, then `done`. The next `interrupt` begins another speech.
    Finish,
    /// Reports Opus packets lost before the next one, which are concealed.
    Lost {
        /// Number of lost packets.
        #[serde(default = "one_packet")]
        packets: u32,
    },
    /// Drops everything unsent and eases to rest; later audio is a new speech.
    Interrupt {
        /// Duration of the ease, in seconds.
        #[serde(default)]
        ease: f64,
    },
    /// Changes the mood.
    Mood {
        /// Name of the mood.
        mood: MoodName,
        /// Strength, 0 to 1.
        #[serde(default = "one")]
        strength: f32,
    },
    /// Plays a gesture over the motion.
    Gesture {
        /// Name of the gesture.
        name: String,
        /// Time of the stroke, in seconds of the motion; as soon as possible if absent.
        #[serde(default)]
        at: Option<f64>,
        /// Playback speed, 0.5 to 2.
        #[serde(default = "one")]
        speed: f32,
        /// Strength, 0 to 1.
        #[serde(default = "one")]
        strength: f32,
        /// The hand that gestures.
        #[serde(default)]
        side: SideName,
        /// Point to point at, in metres.
        #[serde(default)]
        target: Option<[f32; 3]>,
        /// Variant; 0 is the gesture as drawn.
        #[serde(default)]
        variant: u8,
    },
    /// Gives words and their time.
    Words {
        /// The words.
        text: String,
        /// Start in seconds of the audio sent since the session's start.
        start: f64,
        /// End, as the start.
        end: f64,
    },
    /// Looks at a point.
    LookAt {
        /// The point, in metres.
        point: [f32; 3],
        /// Strength, 0 to 1.
        #[serde(default = "one")]
        strength: f32,
    },
    /// Moves in the room.
    Place {
        /// The new place, as in the hello.
        place: [f32; 3],
    },
    /// Requests a copy of the session's state; the session continues.
    Save,
    /// Requests the session's statistics.
    Stats,
}

impl Request {
    /// Parses a text message.
    ///
    /// # Errors
    /// A message for the client.
    pub fn parse(text: &str) -> Result<Self, String> {
        serde_json::from_str(text).map_err(|error| format!("this message is not understood: {error}"))
    }
}

/// Builds the options of a gesture.
pub(crate) fn gesture_options(
    at: Option<f64>,
    (speed, strength): (f32, f32),
    side: SideName,
    target: Option<[f32; 3]>,
    variant: u8,
) -> GestureOptions {
    let side = match side {
        SideName::Auto => Side::Auto,
        SideName::Left => Side::Left,
        SideName::Right => Side::Right,
        SideName::Both => Side::Both,
    };
    GestureOptions { at, speed, strength, side, target, variant }
}

/// Text message of the server.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Reply<'a> {
    /// The session has begun.
    Ready(Ready<'a>),
    /// All frames of a speech were sent.
    Done {
        /// Frames since the session began.
        frames: u64,
        /// Frames whose chunk was computed too late for real time.
        late_frames: u64,
    },
    /// Announces the session's state, in the binary messages that follow.
    State {
        /// Samples of this connection that the state covers; the client sends later ones again when it
        /// restores the state.
        samples: u64,
        /// Length of the state in bytes.
        bytes: usize,
        /// Whether the server now ends the session.
        is_handover: bool,
    },
    /// Statistics of the session. Times in seconds, of computing a chunk.
    Stats {
        /// Samples of this connection that the engine has taken.
        samples: u64,
        /// Chunks so far.
        chunks: u64,
        /// Frames whose chunk was computed too late for real time.
        late_frames: u64,
        /// Median time.
        compute_p50: f64,
        /// 99th percentile.
        compute_p99: f64,
        /// Longest time.
        compute_max: f64,
    },
    /// The session ends, or was refused.
    Error {
        /// Machine-readable code.
        code: &'static str,
        /// Human-readable message.
        reason: &'a str,
    },
}

impl Reply<'_> {
    pub(crate) fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_else(|_| "{\"type\":\"error\",\"code\":\"internal\"}".to_owned())
    }
}

/// Properties of a session that has begun.
#[derive(Clone, Debug, Serialize)]
#[expect(missing_docs, reason = "docs/serve.md has them in a table")]
pub struct Ready<'a> {
    pub version: u32,
    pub model: &'a str,
    pub rate: usize,
    pub audio: AudioKind,
    pub output: Output,
    pub frame_rate: usize,
    pub joints: usize,
    pub face: &'a [String],
    pub floats: usize,
    pub chunk_frames: usize,
    pub latency_samples: usize,
    pub mouth_samples: usize,
    pub state_bytes: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Machine-readable reason why a session ended or was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "docs/serve.md has them in a table")]
pub enum Code {
    BadRequest,
    BadFrame,
    NotUtf8,
    TooBig,
    Unauthorized,
    ClientLimit,
    Full,
    Draining,
    SlowReader,
    Idle,
    Silent,
    Internal,
}

impl Code {
    /// Code in text messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::BadRequest | Self::BadFrame | Self::NotUtf8 | Self::TooBig => "bad_request",
            Self::Unauthorized => "unauthorized",
            Self::ClientLimit => "client_limit",
            Self::Full => "full",
            Self::Draining => "draining",
            Self::SlowReader => "slow_reader",
            Self::Idle => "idle",
            Self::Silent => "silent",
            Self::Internal => "internal",
        }
    }

    /// Code in the WebSocket close frame: the protocol's own if it has one, otherwise 4000 plus a number like
    /// HTTP's status.
    pub const fn number(self) -> u16 {
        match self {
            Self::BadRequest => 4400,
            Self::BadFrame => 1002,
            Self::NotUtf8 => 1007,
            Self::TooBig => 1009,
            Self::Unauthorized => 4401,
            Self::Idle => 4408,
            Self::Silent => 4409,
            Self::SlowReader => 4410,
            Self::ClientLimit => 4429,
            Self::Full => 4503,
            Self::Draining => 1012,
            Self::Internal => 1011,
        }
    }
}

/// Number of floats in a frame without a character.
pub(crate) const fn floats(face: usize) -> usize {
    4 * JOINTS + 3 + face
}

/// Number of frames of this many floats in a message: within [`MOST_BYTES`], and at least one.
pub(crate) fn frames_at_once(floats: usize) -> usize {
    ((MOST_BYTES - HEAD) / (16 + 4 * floats)).clamp(1, FRAMES_AT_ONCE)
}

/// Splits a state into messages of at most [`MOST_BYTES`].
pub(crate) fn state_messages(state: &[u8]) -> impl Iterator<Item = Vec<u8>> {
    state.chunks(MOST_BYTES - 1).map(|piece| [&[STATE], piece].concat())
}

/// A frame message being built.
#[derive(Debug)]
pub(crate) struct FrameMessage {
    bytes: Vec<u8>,
    count: u16,
}

impl FrameMessage {
    pub(crate) fn new(floats: usize, most: usize) -> Self {
        let mut bytes = Vec::with_capacity(HEAD + most * (16 + 4 * floats));
        bytes.extend([FRAMES, 0, 0, 0]);
        bytes.extend(u32::try_from(floats).unwrap_or_default().to_le_bytes());
        Self { bytes, count: 0 }
    }

    /// Adds a frame, and the values of a character's channels in it.
    pub(crate) fn push(&mut self, frame: &Frame, worn: &[f32]) {
        self.bytes.extend(frame.index.to_le_bytes());
        self.bytes.extend(frame.sample.to_le_bytes());
        let rotations = frame.pose.rotations.as_flattened();
        for value in rotations.iter().chain(&frame.pose.translation).chain(frame.face).chain(worn) {
            self.bytes.extend(value.to_le_bytes());
        }
        self.count += 1;
    }

    pub(crate) fn finish(mut self) -> (Vec<u8>, u64) {
        self.bytes[2..4].copy_from_slice(&self.count.to_le_bytes());
        (self.bytes, self.count.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hello_has_defaults_and_refuses_what_it_does_not_know() {
        let Ok(Request::Hello(hello)) = Request::parse(r#"{"type":"hello"}"#) else { panic!("a hello") };
        assert_eq!((hello.version, hello.rate, hello.output, hello.layers), (1, 16_000, Output::Frames, None));
        assert!(hello.token.is_none() && !hello.handover && hello.audio == AudioKind::Pcm);
        let full = r#"{"type":"hello","rate":48000,"audio":"opus","skip":7,"output":"packets","voice":"live","mood":"joy","mood_strength":0.5,
            "seed":18446744073709551615,"prompt":"she is glad","handover":true,"restore":9}"#;
        let Ok(Request::Hello(hello)) = Request::parse(full) else { panic!("a hello") };
        assert_eq!(hello.mood, Some(MoodName(Mood::Joy)));
        assert_eq!((hello.audio, hello.skip), (AudioKind::Opus, 7));
        assert_eq!((hello.output, hello.voice, hello.seed), (Output::Packets, VoiceKind::Live, Some(u64::MAX)));
        let Ok(Request::Hello(hello)) = Request::parse(r#"{"type":"hello","rate":44100.0}"#) else { panic!("a hello") };
        assert_eq!(hello.rate, 44_100);
        for (text, part) in [
            (r#"{"type":"hello","rate":44100.5}"#, "44100.5"),
            (r#"{"type":"hello","rat":1}"#, "rat"),
            (r#"{"type":"hello","rate":"fast"}"#, "fast"),
            (r#"{"type":"hello","rate":-1}"#, "-1"),
            (r#"{"type":"hello","output":"film"}"#, "film"),
            (r#"{"type":"hello","audio":"mp3"}"#, "mp3"),
            (r#"{"type":"lost","packets":-1}"#, "-1"),
            (r#"{"type":"hello","mood":"happy"}"#, "joy"),
            (r#"{"type":"greet"}"#, "greet"),
            (r#"{"rate":1}"#, "type"),
            ("", "EOF"),
            ("[[[[", "sequence"),
        ] {
            let error = Request::parse(text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn a_state_of_any_length_comes_in_messages_that_a_client_may_send() {
        for length in [1, MOST_BYTES - 1, MOST_BYTES, 900_000] {
            let state: Vec<u8> = (0..=250).cycle().take(length).collect();
            let messages: Vec<_> = state_messages(&state).collect();
            assert!(messages.iter().all(|message| message[0] == STATE && message.len() <= MOST_BYTES));
            assert_eq!(messages.len(), length.div_ceil(MOST_BYTES - 1));
            assert!(messages.iter().flat_map(|message| &message[1..]).eq(&state), "{length}");
        }
    }

    #[test]
    fn commands_are_read() {
        assert_eq!(Request::parse(r#"{"type":"finish"}"#), Ok(Request::Finish));
        assert_eq!(Request::parse(r#"{"type":"lost"}"#), Ok(Request::Lost { packets: 1 }));
        assert_eq!(Request::parse(r#"{"type":"interrupt","ease":0.25}"#), Ok(Request::Interrupt { ease: 0.25 }));
        let look = Request::parse(r#"{"type":"look_at","point":[0,1.5,2]}"#);
        assert_eq!(look, Ok(Request::LookAt { point: [0.0, 1.5, 2.0], strength: 1.0 }));
        let Ok(Request::Gesture { name, side, at, variant, .. }) =
            Request::parse(r#"{"type":"gesture","name":"wave","side":"left","at":2.5,"variant":3}"#)
        else {
            panic!("a gesture")
        };
        assert_eq!((name.as_str(), side, at, variant), ("wave", SideName::Left, Some(2.5), 3));
        assert!(Request::parse(r#"{"type":"mood","mood":"sad","strngth":1}"#).is_err());
    }

    #[test]
    fn replies_are_json_with_a_type() {
        let text = Reply::Error { code: Code::Full.name(), reason: "a \"reason\"" }.text();
        assert_eq!(text, r#"{"type":"error","code":"full","reason":"a \"reason\""}"#);
        assert!(Reply::Done { frames: 3, late_frames: 0 }.text().starts_with(r#"{"type":"done","frames":3"#));
    }
}
