//! The live mouth: face channels computed from incoming sound, ahead of the chunks (SPEC 2.10).
//!
//! ```text
//! samples ─▶ log-mel rows ─▶ level control ─▶ causal convolutions ─▶ channels ─▶ gate ─▶ mouth
//!            90 a second      level, noise     30 frames a second   └▶ voice activity ─┘
//! ```
//! A second head, if there is one, gives the mouth of a frame some frames later: it has heard what follows. `heard`
//! puts it over the frames of chunks.
//!
//! Everything is computed row by row and frame by frame, in the order of the samples, so that the sizes of
//! the pushes do not change any bits.

mod gate;
pub(crate) mod heard;
mod level;
mod network;

use umo_core_base::error::{LoadError, StepError, check_finite};
use umo_core_base::functions::Functions;
use umo_core_base::memory::{Arena, Slice};
use umo_core_base::samples::MAX_AMPLITUDE;
use umo_core_base::state::{StateError, StatePass};
use umo_kernels::gemm::Epilogue;
use umo_kernels::product::Rows;
use umo_kernels::{Isa, Mat, MatMut};

use crate::audio::spectrum::{Spectrum, SpectrumScratch};
use crate::config::{self, Config};
use crate::weights::Loader;
use gate::Gate;
pub use heard::{JAW_OPEN, MouthOver, TO_REST};
use level::{Level, LevelControl};
use network::{History, Network, NetworkScratch};

/// Values of a row in addition to its bands: the row's energy and the noise, relative to the level.
pub(crate) const LEVEL_FEATURES: usize = 2;

/// Range of a row's values: natural logarithms of power, relative to the level. More than 52 dB below the
/// level, nothing is distinguishable; only the first rows of a sudden sound are above it.
const LOWEST: f32 = -12.0;
const HIGHEST: f32 = 6.0;

/// Upper bound on the number of pushed samples in a valid state.
const MAX_SAMPLES: u64 = 1 << 56;

/// Piece of the silence after the last sample.
const SILENCE: [f32; 64] = [0.0; 64];

/// The live mouth's network, features and channels. Immutable, shared by all sessions of a model.
#[derive(Debug)]
pub struct Mouth {
    sizes: config::Mouth,
    clock: Clock,
    spectrum: Spectrum,
    /// `[bands + LEVEL_FEATURES]`.
    mean: Box<[f32]>,
    /// `[bands + LEVEL_FEATURES]`.
    scale: Box<[f32]>,
    control: LevelControl,
    network: Network,
    /// Channels without speech: `[channels]`.
    rest: Box<[f32]>,
    /// Indices in `face.names`.
    channels: Box<[usize]>,
}

/// Mapping of samples to rows and frames. A row ends at the last whole sample at or before its nominal time.
#[derive(Clone, Copy, Debug)]
struct Clock {
    sample_rate: u64,
    frame_rate: u64,
    /// Rows per second.
    row_rate: u64,
    /// Rows per frame.
    rows: u64,
    /// Number of rows after a frame's time that the frame depends on.
    ahead: u64,
}

impl Clock {
    fn new(config: &Config, sizes: &config::Mouth) -> Self {
        Self {
            sample_rate: config.audio.sample_rate as u64,
            frame_rate: config.frame_rate as u64,
            row_rate: (config.frame_rate * sizes.rows) as u64,
            rows: sizes.rows as u64,
            ahead: sizes.ahead as u64,
        }
    }

    /// Number of samples of the stream up to the end of row `row`; row 0 is silence before the stream.
    fn row_end(&self, row: u64) -> u64 {
        let (whole, part) = (row / self.row_rate, row % self.row_rate);
        whole * self.sample_rate + part * self.sample_rate / self.row_rate
    }

    /// Number of complete rows after `samples` samples, excluding row 0.
    fn rows_complete(&self, samples: u64) -> u64 {
        let (whole, part) = (samples / self.sample_rate, samples % self.sample_rate);
        // The largest row whose end is at most `samples`.
        whole * self.row_rate + ((part + 1) * self.row_rate).div_ceil(self.sample_rate) - 1
    }

    /// Frame that row `row` completes, if any.
    fn frame(&self, row: u64) -> Option<u64> {
        let after = row.checked_sub(self.ahead)?;
        after.is_multiple_of(self.rows).then_some(after / self.rows)
    }

    /// Number of frames in `samples` samples.
    fn frames(&self, samples: u64) -> u64 {
        let (whole, part) = (samples / self.sample_rate, samples % self.sample_rate);
        whole * self.frame_rate + part * self.frame_rate / self.sample_rate
    }

    /// Maximum number of samples from one row's end to the next.
    fn longest_hop(&self) -> usize {
        usize::try_from(self.sample_rate.div_ceil(self.row_rate)).expect("a rate fits a word")
    }
}

impl Mouth {
    /// Loads the live mouth if the config has a `mouth`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader) -> Result<Option<Self>, LoadError> {
        let config = loader.file().config();
        let Some(sizes) = &config.mouth else { return Ok(None) };
        let (loader, clock) = (loader.exact(), Clock::new(config, sizes));
        let spectrum = Spectrum::load(&loader, "mouth", sizes.window, sizes.fft, sizes.bands)?;
        let filters = loader.values("mouth.filters.weight", &[sizes.bands, spectrum.bins()])?;
        Ok(Some(Self {
            control: LevelControl::new(&filters, spectrum.window(), sizes.floor, clock.row_rate)?,
            mean: loader.vector("mouth.mean", sizes.features())?,
            scale: loader.vector("mouth.scale", sizes.features())?,
            network: Network::load(&loader, sizes)?,
            rest: loader.vector("mouth.rest", sizes.channels.len())?,
            channels: sizes
                .channels
                .iter()
                .filter_map(|name| config.face.names.iter().position(|n| n == name))
                .collect(),
            sizes: sizes.clone(),
            clock,
            spectrum,
        }))
    }

    /// Indices in `face.names` of the output channels, in output order.
    pub fn channels(&self) -> &[usize] {
        &self.channels
    }

    /// Channels without speech, in the same order.
    pub fn rest(&self) -> &[f32] {
        &self.rest
    }

    /// Number of frames known to a stream after `more` further samples.
    pub fn frames_after(&self, stream: &MouthStream, more: usize) -> u64 {
        let rows = self.clock.rows_complete(stream.samples + more as u64);
        rows.checked_sub(self.clock.ahead).map_or(0, |rows| rows / self.clock.rows + 1)
    }

    /// Number of samples at the model's rate that must be pushed after the time of a frame before it is
    /// emitted. This is all of the future that the frame depends on, including the window.
    pub fn latency_samples(&self) -> usize {
        let samples = (self.clock.ahead * self.clock.sample_rate).div_ceil(self.clock.row_rate);
        usize::try_from(samples).expect("`ahead` is small")
    }
}

/// The live mouth of one session: features, level, and the network's history. Allocates only in
/// [`Self::new`].
#[derive(Debug)]
pub struct MouthStream {
    /// Number of pushed samples.
    samples: u64,
    /// The window of the last complete row, then the samples after it: `[window + longest hop]`.
    recent: Slice<f32>,
    level: Level,
    /// The last rows: `[taps, bands + LEVEL_FEATURES]`, oldest first.
    rows: Slice<f32>,
    history: History,
    gate: Gate,
    /// Gate of the second head.
    later: Gate,
    scratch: Scratch,
}

/// The mouth of one frame.
#[derive(Clone, Copy, Debug)]
pub struct MouthFrame<'a> {
    /// Number of the frame: frame `i` is at `i / frame_rate` seconds of the stream.
    pub index: u64,
    /// Channels in the order of [`Mouth::channels`], each 0 to 1.
    pub channels: &'a [f32],
    /// Voice activity: 0 without speech, 1 with speech, and in between while the mouth opens or shuts.
    pub voiced: f32,
    /// The same channels of frame `index - behind`, from the second head; empty without one, and before that frame.
    pub later: &'a [f32],
}

/// Scratch memory for one row and one frame.
#[derive(Debug)]
struct Scratch {
    spectrum: SpectrumScratch,
    /// `[fft / 2 + 1]`.
    power: Slice<f32>,
    /// `[bands]`.
    energy: Slice<f32>,
    network: NetworkScratch,
    /// `[channels]`.
    values: Slice<f32>,
    /// `[channels]`, empty without a second head.
    later: Slice<f32>,
}

impl MouthStream {
    /// Creates a new stream of `mouth`.
    pub fn new(mouth: &Mouth) -> Self {
        Self::new_in(mouth, &Arena::system())
    }

    /// Like [`Self::new`], in memory of `arena`.
    pub fn new_in(mouth: &Mouth, arena: &Arena) -> Self {
        let sizes = &mouth.sizes;
        let mut stream = Self {
            samples: 0,
            recent: arena.filled(0.0, sizes.window + mouth.clock.longest_hop()),
            level: mouth.control.start(),
            rows: arena.filled(0.0, sizes.taps * sizes.features()),
            history: mouth.network.history(arena),
            gate: Gate::default(),
            later: Gate::default(),
            scratch: Scratch {
                spectrum: mouth.spectrum.scratch(arena),
                power: arena.filled(0.0, mouth.spectrum.bins()),
                energy: arena.filled(0.0, sizes.bands),
                network: mouth.network.scratch(arena),
                values: arena.filled(0.0, sizes.channels.len()),
                later: arena.filled(0.0, if sizes.behind > 0 { sizes.channels.len() } else { 0 }),
            },
        };
        stream.reset(mouth);
        stream
    }

    /// Resets the stream: clears all audio, and the next frame is frame 0.
    pub fn reset(&mut self, mouth: &Mouth) {
        self.samples = 0;
        self.recent.fill(0.0);
        self.level = mouth.control.start();
        self.scratch.energy.fill(mouth.sizes.floor);
        for row in self.rows.chunks_exact_mut(mouth.sizes.features()) {
            mouth.features(&self.scratch.energy, mouth.sizes.floor.logarithm(), self.level, row);
        }
        self.history.clear();
        (self.gate, self.later) = (Gate::default(), Gate::default());
    }

    /// Takes `samples` at the model's rate, mono, and calls `frame` for each frame that becomes known, in
    /// order. Treats samples that are not finite or too large as silence. Never allocates.
    ///
    /// # Errors
    /// [`StepError::NotFinite`] if the model's weights are defective.
    pub fn push(
        &mut self,
        mouth: &Mouth,
        isa: Isa,
        mut samples: &[f32],
        mut frame: impl FnMut(MouthFrame),
    ) -> Result<(), StepError> {
        let clock = mouth.clock;
        let mut row = clock.rows_complete(self.samples);
        while !samples.is_empty() {
            let (start, end) = (clock.row_end(row), clock.row_end(row + 1));
            let pending = as_index(self.samples - start);
            let (taken, rest) = samples.split_at(samples.len().min(as_index(end - self.samples)));
            let to = &mut self.recent[mouth.sizes.window + pending..][..taken.len()];
            for (to, &sample) in to.iter_mut().zip(taken) {
                *to = if (-MAX_AMPLITUDE..=MAX_AMPLITUDE).contains(&sample) { sample } else { 0.0 };
            }
            self.samples += taken.len() as u64;
            samples = rest;
            if self.samples == end {
                row += 1;
                self.recent.copy_within(as_index(end - start).., 0);
                self.row(mouth, isa)?;
                if let Some(index) = clock.frame(row) {
                    self.frame(mouth, isa)?;
                    let Scratch { values, later, .. } = &self.scratch;
                    let later = if index >= mouth.sizes.behind as u64 { &**later } else { &[] };
                    frame(MouthFrame { index, channels: values, voiced: self.gate.open(), later });
                }
            }
        }
        Ok(())
    }

    /// Ends the stream with silence: emits the remaining frames of all pushed samples. The stream must then
    /// be [reset](Self::reset) before the next push.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn finish(&mut self, mouth: &Mouth, isa: Isa, mut frame: impl FnMut(MouthFrame)) -> Result<(), StepError> {
        let total = mouth.clock.frames(self.samples);
        let end = if total == 0 { 0 } else { mouth.clock.row_end((total - 1) * mouth.clock.rows + mouth.clock.ahead) };
        while self.samples < end {
            let count = SILENCE.len().min(as_index(end - self.samples));
            self.push(mouth, isa, &SILENCE[..count], |known| {
                if known.index < total {
                    frame(known);
                }
            })?;
        }
        Ok(())
    }

    /// [`MouthFrame::voiced`] of the newest frame.
    pub fn voiced(&self) -> f32 {
        self.gate.open()
    }

    /// Level of the voice according to the level control, in dB of full scale: power summed over the mel
    /// bands, relative to that of white noise with a root mean square of 1.
    pub fn level_db(&self, mouth: &Mouth) -> f32 {
        mouth.control.decibels(self.level)
    }

    /// Describes the stream.
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("mouth", &mut self.samples, MAX_SAMPLES)?;
        pass.f32s(&mut self.recent)?;
        self.level.state(pass)?;
        pass.f32s(&mut self.rows)?;
        self.history.state(pass)?;
        self.gate.state(pass)?;
        if self.scratch.later.is_empty() { Ok(()) } else { self.later.state(pass) }
    }

    /// Computes the row whose window `recent` starts with.
    fn row(&mut self, mouth: &Mouth, isa: Isa) -> Result<(), StepError> {
        let (sizes, scratch) = (&mouth.sizes, &mut self.scratch);
        mouth.spectrum.power(&mut scratch.spectrum, &self.recent[..sizes.window], &mut scratch.power);
        let x = Mat::new(&scratch.power, 1, mouth.spectrum.bins())?;
        let y = MatMut::new(&mut scratch.energy, 1, sizes.bands)?;
        mouth.spectrum.filters.apply_here(isa, Rows::float(x), 0..sizes.bands, Epilogue::STORE, y)?;
        let energy = scratch.energy.iter().sum::<f32>().max(sizes.floor).logarithm();
        mouth.control.hear(&mut self.level, energy);
        self.rows.copy_within(sizes.features().., 0);
        let last = self.rows.len() - sizes.features();
        mouth.features(&scratch.energy, energy, self.level, &mut self.rows[last..]);
        Ok(())
    }

    /// Computes the frame of the last rows.
    fn frame(&mut self, mouth: &Mouth, isa: Isa) -> Result<(), StepError> {
        let Scratch { network, values, later, .. } = &mut self.scratch;
        let (now, before) = mouth.network.run(isa, &mut self.history, network, &self.rows)?;
        mouth.gated(&mut self.gate, now, values)?;
        if before.is_empty() { Ok(()) } else { mouth.gated(&mut self.later, before, later) }
    }
}

impl Mouth {
    /// Puts a head's outputs `[channels + 1]` through its gate.
    fn gated(&self, gate: &mut Gate, outputs: &[f32], values: &mut [f32]) -> Result<(), StepError> {
        check_finite(outputs, "the mouth's channels")?;
        let (voice, channels) = outputs.split_last().ok_or(StepError::Empty("mouth channel"))?;
        let open = gate.hear(*voice);
        for ((value, &channel), &rest) in values.iter_mut().zip(channels).zip(&self.rest) {
            *value = (rest + open * (channel.clamp(0.0, 1.0) - rest)).clamp(0.0, 1.0);
        }
        Ok(())
    }

    /// Frames that the second head waits for; `None` without one.
    pub fn behind(&self) -> Option<usize> {
        (self.sizes.behind > 0).then_some(self.sizes.behind)
    }
}

impl Mouth {
    /// Computes a row's normalised features `[bands + LEVEL_FEATURES]` from its bands' energies and the
    /// logarithm of their sum.
    fn features(&self, energies: &[f32], energy: f32, level: Level, row: &mut [f32]) {
        let logarithms = energies.iter().map(|energy| energy.max(self.sizes.floor).logarithm());
        let values = logarithms.chain([energy, level.noise]).map(|value| (value - level.voice).clamp(LOWEST, HIGHEST));
        for (((to, value), mean), scale) in row.iter_mut().zip(values).zip(&self.mean).zip(&self.scale) {
            *to = (value - mean) * scale;
        }
    }
}

/// Converts a number of samples that fits a buffer.
fn as_index(samples: u64) -> usize {
    usize::try_from(samples).expect("at most a buffer's length")
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::linear::Precision;
    use crate::weights::ModelFile;

    fn frames(mouth: &Mouth, stream: &mut MouthStream, samples: &[f32]) -> Vec<(u64, Vec<f32>, f32)> {
        let mut frames = Vec::new();
        let take = |frame: MouthFrame| frames.push((frame.index, frame.channels.to_vec(), frame.voiced));
        stream.push(mouth, Isa::detect(), samples, take).unwrap();
        frames
    }

    /// A state saved within a row and loaded into another stream continues with the same bits.
    #[test]
    fn a_restored_stream_goes_on() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/mel_k2_arkit/model.safetensors");
        let file = ModelFile::open(&path).unwrap();
        let mouth = Mouth::load(&Loader::new(&file, Precision::Stored, Isa::detect())).unwrap().unwrap();
        let samples: Vec<f32> =
            (0..24_000_u16).map(|i| (f32::from(i) * 0.11).sin() * (f32::from(i) * 1e-3).sin()).collect();
        let (before, after) = samples.split_at(11_111);

        let mut stream = MouthStream::new(&mouth);
        frames(&mouth, &mut stream, before);
        let mut size = StatePass::size();
        stream.state(&mut size).unwrap();
        let mut bytes = vec![0; size.end().unwrap()];
        let mut save = StatePass::save(&mut bytes, 0, 0);
        stream.state(&mut save).unwrap();
        assert_eq!(save.end(), Ok(bytes.len()), "a state has one size");
        let expected = frames(&mouth, &mut stream, after);

        let mut other = MouthStream::new(&mouth);
        frames(&mouth, &mut other, &samples[..3000]);
        other.state(&mut StatePass::check(&bytes, 0).unwrap()).unwrap();
        other.state(&mut StatePass::load(&bytes, 0)).unwrap();
        assert_eq!(frames(&mouth, &mut other, after), expected);
        assert!(expected.len() > 20 && expected.iter().any(|frame| frame.1 != expected[0].1));
    }
}
