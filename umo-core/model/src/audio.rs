//! Conversion of samples to audio units (SPEC 2.1): HuBERT or log-mel features, then the nearest centroid.

mod hubert;
mod kmeans;
mod mel;
pub mod resample;
pub(crate) mod spectrum;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{Arena, Slice, filled};
pub use umo_core_base::samples::{MAX_AMPLITUDE, silence_unusable};
use umo_core_base::state::{StateError, StatePass};
use umo_kernels::ShapeError;

use crate::config::AudioKind;
use crate::linear::Compute;
use crate::weights::Loader;
use hubert::Hubert;
use kmeans::Kmeans;
use mel::Mel;

/// Number of features whose units are looked up at a time when tokenising a whole file.
const BLOCK: usize = 128;

/// The audio tokenizer of one model. HuBERT's products follow the model's precision, except the first
/// convolution and the position convolution. The nearest centroid and mel features are always computed in
/// full precision.
#[derive(Debug)]
pub struct Tokenizer {
    network: Network,
    kmeans: Kmeans,
    /// Samples from one feature to the next.
    hop: usize,
    /// Samples that a feature covers before its own hop.
    reach: usize,
    width: usize,
}

#[derive(Debug)]
enum Network {
    Hubert(Box<Hubert>),
    Mel(Box<Mel>),
}

/// State of the tokenizer for one stream.
#[derive(Debug)]
pub struct AudioStream {
    /// Features before any layer with context, oldest first: `[window, width]`.
    features: Slice<f32>,
    /// The last samples, which the next feature covers too: `[reach]`.
    recent: Slice<f32>,
    window: usize,
    max_new: usize,
    started: bool,
    state: State,
}

#[derive(Debug)]
enum State {
    Hubert(hubert::Statistics),
    Mel(mel::Past),
}

/// Scratch memory for one call of [`Tokenizer::advance`], for any stream with at most this window and call
/// size.
#[derive(Debug)]
pub struct AudioScratch {
    /// Samples that the new features cover: `[reach + max_new * hop]`.
    samples: Box<[f32]>,
    /// `[window, units]`.
    scores: Box<[f32]>,
    window: usize,
    max_new: usize,
    network: Room,
}

#[derive(Debug)]
enum Room {
    Hubert(Box<hubert::Scratch>),
    Mel(mel::Scratch),
}

/// Progress of one chunk of audio through the tokenizer.
#[derive(Clone, Copy, Debug)]
pub struct Call {
    /// Number of new tokens.
    new: usize,
    /// Whether it is the stream's first.
    first: bool,
    /// Number of completed steps.
    step: usize,
}

impl AudioStream {
    /// Clears all audio: the next call starts a new stream.
    pub fn reset(&mut self) {
        self.started = false;
    }

    /// Features that the units of the last call were computed from: HuBERT's projected convolution features,
    /// or the mel features.
    ///
    /// Shape: `[window, width]`, oldest first.
    pub fn features(&self) -> &[f32] {
        &self.features
    }

    /// Describes the stream between two calls, after `consumed` samples.
    pub fn state(&mut self, pass: &mut StatePass, consumed: u64) -> Result<(), StateError> {
        let started = consumed > 0;
        if pass.loads() {
            self.started = started;
        }
        // Before the first call, the other fields are not used.
        if !pass.follows(started) {
            return Ok(());
        }
        pass.f32s(&mut self.features)?;
        pass.f32s(&mut self.recent)?;
        match &mut self.state {
            State::Hubert(statistics) => statistics.state(pass, consumed),
            State::Mel(past) => past.state(pass),
        }
    }

    /// Number of tokens in the window.
    pub fn window(&self) -> usize {
        self.window
    }
}

impl Tokenizer {
    /// Loads the tokenizer that the config names.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor or key.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let missing = |key: &str| LoadError::config(key, "missing");
        let (network, width) = match config.audio.kind {
            AudioKind::Hubert => {
                let sizes = config.audio.hubert.as_ref().ok_or_else(|| missing("audio.hubert"))?;
                (Network::Hubert(Box::new(Hubert::load(loader, sizes)?)), sizes.hidden_size)
            }
            AudioKind::Mel => {
                let sizes = config.audio.mel.as_ref().ok_or_else(|| missing("audio.mel"))?;
                (Network::Mel(Box::new(Mel::load(&loader.exact(), sizes, config.hop())?)), sizes.width())
            }
        };
        let kmeans = Kmeans::load(&loader.exact(), config.audio.units, width)?;
        Ok(Self { network, kmeans, hop: config.hop(), reach: config.feature_reach_back(), width })
    }

    /// Number of values per feature.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of samples from one feature to the next.
    pub fn hop(&self) -> usize {
        self.hop
    }

    /// Number of samples that one feature covers: the minimum that [`Tokenizer::features`] accepts.
    pub fn field(&self) -> usize {
        self.reach + self.hop
    }

    /// Runs the network on a whole clip: returns features `[T, width]` and their units `[T]`. Allocates.
    ///
    /// Feature `j` covers the samples `hop * j .. hop * j + field`. All statistics are computed over the
    /// clip.
    ///
    /// # Errors
    /// [`StepError::Empty`] if the clip is too short for one feature.
    pub fn features(&self, cx: Compute, audio: &[f32]) -> Result<(Vec<f32>, Vec<u32>), StepError> {
        if audio.len() < self.field() {
            return Err(StepError::Empty("audio feature"));
        }
        let count = (audio.len() - self.field()) / self.hop + 1;
        let mut features = filled(0.0, count * self.width);
        match &self.network {
            Network::Hubert(hubert) => hubert.features(cx, audio, self.hop, &mut features)?,
            Network::Mel(mel) => {
                let (mut past, mut scratch) = (mel.past(&Arena::system()), mel.scratch(count));
                mel.begin(cx, &mut past, &mut scratch)?;
                mel.extract(cx, &mut past, &mut scratch, audio, &mut features)?;
            }
        }
        let mut units = filled(0, count);
        let mut scores = filled(0.0, count.min(BLOCK) * self.kmeans.units());
        for (features, units) in features.chunks(BLOCK * self.width).zip(units.chunks_mut(BLOCK)) {
            self.kmeans.nearest(cx, features, &mut scores, units)?;
        }
        Ok((features, units))
    }

    /// Returns the units of a whole recording, one per hop, and the unit of silence. Allocates.
    ///
    /// Unit `j` corresponds to the stream's feature `j`, except that statistics and layers with context see
    /// the whole recording.
    ///
    /// # Errors
    /// [`StepError`] if the network fails.
    pub fn whole_file(&self, cx: Compute, samples: &[f32]) -> Result<(Vec<u32>, u32), StepError> {
        let count = samples.len().div_ceil(self.hop);
        let mut padded = filled(0.0, self.reach + count.max(1) * self.hop);
        padded[self.reach..self.reach + samples.len()].copy_from_slice(samples);
        let (_, mut units) = self.features(cx, &padded)?;
        units.truncate(count);
        let (_, silence) = self.features(cx, &filled(0.0, self.field()))?;
        Ok((units, silence[0]))
    }

    /// Creates a stream with a window of `window` tokens that takes at most `max_new` tokens per call,
    /// `1..=window`.
    ///
    /// # Panics
    /// If `max_new` is outside that range.
    pub fn stream(&self, window: usize, max_new: usize) -> AudioStream {
        self.stream_in(window, max_new, &Arena::system())
    }

    /// Like [`Self::stream`], in memory of `arena`.
    ///
    /// # Panics
    /// As [`Self::stream`].
    pub fn stream_in(&self, window: usize, max_new: usize, arena: &Arena) -> AudioStream {
        assert!((1..=window).contains(&max_new), "{max_new} new tokens per call in a window of {window}");
        AudioStream {
            features: arena.filled(0.0, window * self.width),
            recent: arena.filled(0.0, self.reach),
            window,
            max_new,
            started: false,
            state: match &self.network {
                Network::Hubert(hubert) => State::Hubert(hubert.statistics(arena)),
                Network::Mel(mel) => State::Mel(mel.past(arena)),
            },
        }
    }

    /// Allocates scratch for streams of at most `window` tokens and `max_new` tokens per call.
    pub fn scratch(&self, window: usize, max_new: usize) -> AudioScratch {
        AudioScratch {
            samples: filled(0.0, self.reach + max_new.max(1) * self.hop).into(),
            scores: filled(0.0, window * self.kmeans.units()).into(),
            window,
            max_new,
            network: match &self.network {
                Network::Hubert(hubert) => {
                    Room::Hubert(Box::new(hubert.scratch(hubert.block_samples(max_new, self.hop), window)))
                }
                Network::Mel(mel) => Room::Mel(mel.scratch(max_new)),
            },
        }
    }

    /// Appends one chunk of audio and writes the units of the whole window that ends with it. Never
    /// allocates.
    ///
    /// Shapes: `samples` a multiple of the hop, at most `max_new` hops; `units [window]`. Feature `j` covers
    /// the samples `hop * j - reach .. hop * j + hop` of the stream. Its convolutions are computed in the
    /// call that brings its samples, with the statistics of all audio up to that call's end. Layers with
    /// context are computed over the window in every call. Time before the stream is silence.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees, or `stream` or `scratch` is too small or belongs to another
    /// tokenizer.
    pub fn advance(
        &self,
        cx: Compute,
        stream: &mut AudioStream,
        scratch: &mut AudioScratch,
        samples: &[f32],
        units: &mut [u32],
    ) -> Result<(), StepError> {
        let mut call = self.begin(stream, scratch, samples)?;
        while self.step(cx, stream, scratch, &mut call, units)? {}
        Ok(())
    }

    /// Takes one chunk of audio like [`Self::advance`], to be computed with [`Self::step`].
    ///
    /// # Errors
    /// As [`Self::advance`].
    pub fn begin(
        &self,
        stream: &mut AudioStream,
        scratch: &mut AudioScratch,
        samples: &[f32],
    ) -> Result<Call, StepError> {
        let new = self.check(stream, scratch, samples)?;
        let (reach, first) = (self.reach, !stream.started);
        if first {
            stream.recent.fill(0.0);
        }
        let waveform = &mut scratch.samples[..reach + samples.len()];
        waveform[..reach].copy_from_slice(&stream.recent);
        waveform[reach..].copy_from_slice(samples);
        // A call brings at least one hop, which is at least as long as the reach.
        stream.recent.copy_from_slice(&samples[samples.len() - reach..]);
        stream.features.copy_within(new * self.width.., 0);
        stream.started = true;
        Ok(Call { new, first, step: 0 })
    }

    /// Computes the next step of a call: a block of features, or a layer. Returns whether there is more to
    /// do; the last step writes `units [window]`. Never allocates.
    ///
    /// # Errors
    /// As [`Self::advance`]; the stream then needs [`AudioStream::reset`].
    pub fn step(
        &self,
        cx: Compute,
        stream: &mut AudioStream,
        scratch: &mut AudioScratch,
        call: &mut Call,
        units: &mut [u32],
    ) -> Result<bool, StepError> {
        if units.len() != stream.window {
            return Err(ShapeError { arg: "units", want: stream.window, got: units.len() }.into());
        }
        let (reach, window, Call { new, first, step }) = (self.reach, stream.window, *call);
        let waveform = &mut scratch.samples[..reach + new * self.hop];
        let (old, fresh) = stream.features.split_at_mut((window - new) * self.width);
        let scores = &mut scratch.scores[..window * self.kmeans.units()];
        call.step += 1;
        match (&self.network, &mut stream.state, &mut scratch.network) {
            (Network::Hubert(hubert), State::Hubert(statistics), Room::Hubert(room)) => {
                let (blocks, layers) = (Hubert::blocks(new), hubert.layers());
                if step == 0 {
                    if first {
                        statistics.clear();
                    }
                    statistics.add_waveform(&waveform[reach..]);
                    if first {
                        waveform[..reach].fill(statistics.silence());
                    }
                    hubert.add_conv_outputs(cx, statistics, room, waveform, reach)?;
                } else if step <= blocks {
                    hubert.extract(cx, statistics, room, waveform, self.hop, step - 1, fresh)?;
                } else if step == blocks + 1 {
                    if first {
                        let silence = &mut waveform[..reach + self.hop];
                        silence.fill(statistics.silence());
                        hubert.fill(cx, statistics, room, silence, old)?;
                    }
                    hubert.begin_encode(cx, room, &stream.features)?;
                } else if step <= blocks + 1 + layers {
                    hubert.encode_layer(cx, room, window, step - blocks - 2)?;
                }
                if step < blocks + 1 + layers {
                    return Ok(true);
                }
                self.kmeans.nearest(cx, hubert.encoded(room, window), scores, units)?;
            }
            (Network::Mel(mel), State::Mel(past), Room::Mel(room)) => {
                if first {
                    mel.begin(cx, past, room)?;
                    mel.fill(room, old);
                }
                mel.extract(cx, past, room, waveform, fresh)?;
                self.kmeans.nearest(cx, &stream.features, scores, units)?;
            }
            _ => return Err(StepError::Order("an audio stream or scratch of another tokenizer")),
        }
        Ok(false)
    }

    /// Checks the lengths of a call and returns its number of new tokens.
    fn check(&self, stream: &AudioStream, scratch: &AudioScratch, samples: &[f32]) -> Result<usize, StepError> {
        let new = samples.len() / self.hop;
        if samples.is_empty() {
            return Err(StepError::Empty("audio sample"));
        }
        if !samples.len().is_multiple_of(self.hop) {
            return Err(ShapeError { arg: "samples", want: new * self.hop, got: samples.len() }.into());
        }
        let limit = stream.max_new.min(scratch.max_new);
        if new > limit {
            return Err(StepError::TooLong { what: "audio tokens of one call", got: new, limit });
        }
        if stream.window > scratch.window {
            return Err(StepError::TooLong { what: "audio window", got: stream.window, limit: scratch.window });
        }
        if stream.features.len() != stream.window * self.width || stream.recent.len() != self.reach {
            return Err(StepError::Order("an audio stream or scratch of another tokenizer"));
        }
        Ok(new)
    }
}
