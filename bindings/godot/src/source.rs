//! Reads the samples of an audio player.

use godot::classes::{AudioEffect, AudioEffectCapture, AudioServer, AudioStream, AudioStreamWav, Node};
use godot::prelude::*;

use crate::umo::Session;
use crate::wave::{Coding, Wave};

/// A start before this many seconds counts as a start from the beginning: the player was slightly ahead of the frame
/// that noticed it.
const FROM_START: f64 = 0.25;
/// Length of a capture's buffer in seconds, for the time in which no frame is drawn.
const CAPTURE_SECONDS: f32 = 1.0;

/// Source of the samples.
pub(crate) enum Source {
    /// The samples of an `AudioStreamWAV`, in advance of their sound.
    Wav(Wav),
    /// The mix of the player's bus, as it sounds.
    Capture(Capture),
    /// Nothing more: the avatar was interrupted while the player plays on.
    Dropped,
}

pub(crate) struct Wav {
    data: PackedByteArray,
    wave: Wave,
    rate: u32,
    /// Decoded samples, and the number of them already fed.
    decoded: Vec<i16>,
    taken: usize,
    is_finished: bool,
}

impl Wav {
    /// Returns `None` if the stream has an unknown sample format, from a later Godot.
    fn new(stream: &Gd<AudioStreamWav>) -> Result<Option<Self>, String> {
        // By name: the getter panics at formats that are not in the oldest supported Godot.
        let format = stream.get("format").try_to::<i64>().unwrap_or(-1);
        let rate = u32::try_from(stream.get_mix_rate()).ok();
        let Some((coding, rate)) = Coding::of(format).zip(rate) else { return Ok(None) };
        let channels = if stream.is_stereo() { 2 } else { 1 };
        let data = stream.get_data();
        let wave = Wave::new(coding, channels, data.as_slice()).map_err(|problem| wrong(stream, &problem))?;
        Ok(Some(Self { data, wave, rate, decoded: Vec::new(), taken: 0, is_finished: false }))
    }

    pub(crate) fn seconds(&self) -> f64 {
        self.wave.frames() as f64 / f64::from(self.rate)
    }

    /// Seeks to a position of the player. Returns the actual position in seconds.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a position within the stream")]
    fn seek(&mut self, position: f64) -> f64 {
        if position < FROM_START {
            return 0.0;
        }
        let frame = (position.min(self.seconds()) * f64::from(self.rate)) as usize;
        self.wave.seek(frame, self.data.as_slice());
        frame as f64 / f64::from(self.rate)
    }

    /// Feeds as many samples as the session accepts, and ends the stream after the last one.
    fn feed(&mut self, session: &Session) -> Result<(), String> {
        while !self.is_finished {
            if self.taken == self.decoded.len() {
                self.taken = 0;
                self.decoded.clear();
                self.wave
                    .read(self.data.as_slice(), &mut self.decoded)
                    .map_err(|problem| format!("the WAV: {problem}"))?;
            }
            if self.decoded.is_empty() {
                self.is_finished = true;
                return session.finish();
            }
            self.taken += session.push_i16(&self.decoded[self.taken..])?;
            if self.taken < self.decoded.len() {
                return Ok(());
            }
        }
        Ok(())
    }
}

/// All samples of a stream, interleaved, full scale 1.
pub(crate) fn samples(stream: &Gd<AudioStreamWav>) -> Result<Vec<f32>, String> {
    let unknown = || wrong(stream, "its format is not known");
    let mut wav = Wav::new(stream)?.ok_or_else(unknown)?;
    let mut samples = Vec::new();
    loop {
        wav.decoded.clear();
        wav.wave.read(wav.data.as_slice(), &mut wav.decoded).map_err(|problem| wrong(stream, &problem))?;
        if wav.decoded.is_empty() {
            return Ok(samples);
        }
        samples.extend(wav.decoded.iter().map(|&sample| f32::from(sample) / 32768.0));
    }
}

fn wrong(stream: &Gd<AudioStreamWav>, problem: &str) -> String {
    let path = stream.get_path();
    let name = if path.is_empty() { "an AudioStreamWAV".to_owned() } else { format!("`{path}`") };
    format!("{name}: {problem}; import the WAV again")
}

/// Our own effect on a bus, removed when dropped.
pub(crate) struct Capture {
    effect: Gd<AudioEffectCapture>,
    rate: u32,
    /// Number of frames fed.
    frames: u64,
}

impl Capture {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rates are whole and positive")]
    fn new(player: &Gd<Node>) -> Result<Self, String> {
        let mut server = AudioServer::singleton();
        let bus = player.get("bus").try_to::<StringName>().unwrap_or_default();
        let index = server.get_bus_index(&bus);
        if index < 0 {
            return Err(format!("there is no audio bus `{bus}`"));
        }
        let mut effect = AudioEffectCapture::new_gd();
        effect.set_buffer_length(CAPTURE_SECONDS);
        server.add_bus_effect(index, &effect);
        Ok(Self { effect, rate: server.get_mix_rate().round() as u32, frames: 0 })
    }

    /// Seconds of audio fed.
    pub(crate) fn seconds(&self) -> f64 {
        self.frames as f64 / f64::from(self.rate)
    }

    fn feed(&mut self, session: &Session) -> Result<(), String> {
        let count = self.effect.get_frames_available();
        if count > 0 {
            let frames = self.effect.get_buffer(count);
            let samples: Vec<f32> = frames.as_slice().iter().flat_map(|frame| [frame.x, frame.y]).collect();
            // Samples that do not fit are lost and counted in umo's statistics; the clock goes on.
            session.push(&samples)?;
            self.frames += frames.len() as u64;
        }
        Ok(())
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        let mut server = AudioServer::singleton();
        let ours = self.effect.clone().upcast::<AudioEffect>();
        for bus in 0..server.get_bus_count() {
            for index in (0..server.get_bus_effect_count(bus)).rev() {
                if server.get_bus_effect(bus, index).as_ref() == Some(&ours) {
                    server.remove_bus_effect(bus, index);
                }
            }
        }
    }
}

impl Source {
    /// Opens the source of a player from `position` on. Also returns the actual position at which it begins.
    pub(crate) fn of(player: &Gd<Node>, position: f64) -> Result<(Self, f64), String> {
        let stream = player.get("stream").try_to::<Option<Gd<AudioStream>>>().ok().flatten();
        let wav = stream.and_then(|stream| stream.try_cast::<AudioStreamWav>().ok());
        if let Some(mut wav) = wav.as_ref().map(Wav::new).transpose()?.flatten() {
            let start = wav.seek(position);
            return Ok((Self::Wav(wav), start));
        }
        Ok((Self::Capture(Capture::new(player)?), 0.0))
    }

    /// Sample rate and channel count that its session must have.
    pub(crate) fn format(&self) -> Option<(u32, u32)> {
        match self {
            Self::Wav(wav) => Some((wav.rate, if wav.wave.channels() == 2 { 2 } else { 1 })),
            Self::Capture(capture) => Some((capture.rate, 2)),
            Self::Dropped => None,
        }
    }

    /// Feeds samples to the session.
    pub(crate) fn feed(&mut self, session: &Session) -> Result<(), String> {
        match self {
            Self::Wav(wav) => wav.feed(session),
            Self::Capture(capture) => capture.feed(session),
            Self::Dropped => Ok(()),
        }
    }
}
