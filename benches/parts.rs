//! The timed parts of a chunk: encoding, one decoder step, both together, HuBERT,
//! and in layout `frames` the depth network; and a whole chunk of the default model.

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use umo_core::{
    Compute, Config, Engine, EngineConfig, Model, ModelFile, Part, Poll, Precision, Sampler, Session, SessionConfig,
    Threads,
};
use umo_core_model::audio::Tokenizer;
use umo_core_model::layout::FREE;
use umo_core_model::lm::decoder::Sequence;
use umo_core_model::lm::depth::{DepthNet, DepthScratch, Task};
use umo_core_model::lm::generate::{ChunkSampling, Generator, Heads};
use umo_core_model::lm::{Lengths, Lm, LmScratch};
use umo_core_model::weights::{AlignedBox, Loader};
use umo_core_tools::floor;
use umo_kernels::activation::argmax;
use umo_kernels::{Mat, peak};

use crate::{READ_BYTES, Random, isa};

/// Encoder tokens.
pub const TOKENS: usize = 256;
const SECONDS: usize = 3;
const OK: &str = "the model and its input are sound";

/// An avatar of the default model with speech as input.
#[derive(Debug)]
pub struct Speaker {
    engine: Engine,
    avatar: Session,
    chunk: Vec<f32>,
}

impl Speaker {
    /// Loads the default model for this many threads.
    pub fn load(threads: usize) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/umo-people/model.safetensors");
        let file = ModelFile::open(&path).expect(OK);
        let model = Arc::new(Model::load(&file, Precision::Stored, isa()).expect(OK));
        let config = EngineConfig { threads: Threads::Host(threads - 1), max_sessions: 1, ..EngineConfig::default() };
        let engine = Engine::new(model, &config).expect("threads can be started");
        let config = engine.model().config();
        let samples = config.target * config.samples_per_keyframe();
        let avatar = engine.session(&SessionConfig::new(config)).expect("the first session");
        // Syllables, five a second, of a voice at 120 Hz.
        let sound = |i: u32| {
            let time = f64::from(i) / 16_000.0;
            let voice: f64 = (1..12).map(|k| (TAU * 120.0 * f64::from(k) * time).sin() / f64::from(k)).sum();
            #[expect(clippy::cast_possible_truncation, reason = "it is sound")]
            let sample = (0.1 * voice * (TAU * 2.5 * time).sin().powi(2)) as f32;
            sample
        };
        let chunk = (0..).take(samples).map(sound).collect();
        Self { engine, avatar, chunk }
    }

    /// Computes a chunk, from samples to frames.
    pub fn chunk(&mut self) {
        self.avatar.push_audio(&self.chunk).expect("there is room");
        while self.engine.poll(Duration::MAX).expect("the host polls") != Poll::Idle {}
        self.avatar.pull_frames(usize::MAX, |_| ()).expect("one thread pulls");
    }
}

/// The language model with random input and buffers for its results.
#[derive(Debug)]
pub struct Language {
    config: Config,
    lengths: Lengths,
    lm: Lm,
    ids: Vec<u32>,
    hidden: Vec<f32>,
    scratch: LmScratch,
    sequence: Sequence,
    heads: Arc<Heads>,
    generator: Generator,
    codes: Vec<u16>,
    logits: Vec<f32>,
    /// Decoder positions computed so far.
    at: usize,
}

impl Language {
    /// Loads the language model in the file's own precision.
    pub fn load(file: &ModelFile) -> Self {
        let config = file.config().clone();
        let lengths = Lengths { encoder: TOKENS, decoder: Lengths::of(&config).decoder };
        let mut random = Random::new(4);
        let loader = Loader::new(file, Precision::Stored, isa());
        let lm = Lm::load(&loader, lengths).expect(OK);
        let heads = Arc::new(Heads::load(&loader).expect(OK));
        let id = |_| u32::try_from(random.below(config.vocab.size)).expect("an id is small");
        Self {
            lengths,
            ids: (0..TOKENS).map(id).collect(),
            hidden: vec![0.0; TOKENS * lm.d_model()],
            scratch: LmScratch::new(&config, TOKENS),
            sequence: Sequence::new(&config, lengths, lm.cross_storage()),
            generator: Generator::new(&config, Arc::clone(&heads)),
            heads,
            codes: vec![0; Part::ALL.len() * config.target],
            logits: vec![0.0; config.vq.codes],
            at: lengths.decoder,
            lm,
            config,
        }
    }

    /// Number of codes of one chunk.
    pub fn codes(&self) -> usize {
        4 * self.config.target
    }

    /// Encodes the tokens.
    pub fn encode(&mut self, cx: Compute) {
        self.lm.encode(cx, &mut self.scratch, &self.ids, &[TOKENS], &mut self.hidden).expect(OK);
    }

    /// Runs one decoder step and the logits of one part's codes; the tokens must be encoded.
    pub fn step(&mut self, cx: Compute) {
        if self.at == self.lengths.decoder {
            let states = Mat::new(&self.hidden, TOKENS, self.lm.d_model()).expect(OK);
            self.lm.attend_to(cx, &mut self.scratch, states, &mut self.sequence).expect(OK);
            self.at = 0;
        }
        self.sequence.set_ids(&self.ids[self.at..=self.at]).expect(OK);
        self.lm.decode(cx, &mut self.scratch, std::slice::from_mut(&mut self.sequence)).expect(OK);
        self.heads.logits(cx, &mut self.scratch, 0, Part::Face, &mut self.logits).expect(OK);
        self.at += 1;
    }

    /// Encodes the tokens and generates a chunk's number of codes greedily, one after the other, as a
    /// decoder without markers does.
    pub fn steps(&mut self, cx: Compute) {
        self.encode(cx);
        let states = Mat::new(&self.hidden, TOKENS, self.lm.d_model()).expect(OK);
        self.lm.attend_to(cx, &mut self.scratch, states, &mut self.sequence).expect(OK);
        let mut id = self.config.vocab.decoder_start;
        for part in Part::ALL {
            for _ in 0..self.config.target {
                self.sequence.set_ids(&[u32::try_from(id).expect("an id is small")]).expect(OK);
                self.lm.decode(cx, &mut self.scratch, std::slice::from_mut(&mut self.sequence)).expect(OK);
                self.heads.logits(cx, &mut self.scratch, 0, part, &mut self.logits).expect(OK);
                id = self.config.vocab[part].first + argmax(cx.isa, &self.logits).expect("there are codes");
            }
        }
        self.at = self.lengths.decoder;
    }

    /// Encodes the tokens and generates a chunk's codes greedily, with the markers between its
    /// parts.
    pub fn chunk(&mut self, cx: Compute) {
        self.encode(cx);
        let states = Mat::new(&self.hidden, TOKENS, self.lm.d_model()).expect(OK);
        let draw = ChunkSampling { sampler: Sampler::GREEDY, chunk: 0, target: self.config.target };
        let Self { lm, scratch, sequence, generator, codes, .. } = self;
        generator.generate(cx, lm, scratch, states, sequence, draw, codes).expect(OK);
        self.at = self.lengths.decoder;
    }
}

/// The depth network with one random decoder state for each avatar.
#[derive(Debug)]
pub struct Depth {
    net: DepthNet,
    scratch: DepthScratch,
    /// `[avatars, d_model]`
    states: Vec<f32>,
    /// `[avatars, places, d_model]`
    heard: Vec<f32>,
    tasks: Vec<Task>,
    /// `[avatars, codes of a keyframe]`
    before: Vec<u16>,
    free: Vec<u16>,
}

impl Depth {
    /// Loads the depth network in the file's own precision, for this many avatars.
    pub fn load(file: &ModelFile, avatars: usize) -> Self {
        let config = file.config();
        let mut random = Random::new(6);
        let net = DepthNet::load(&Loader::new(file, Precision::Stored, isa())).expect(OK);
        let sampler = Sampler { sampling: config.sampling, seed: 7, ..Sampler::GREEDY };
        let places = config
            .depth
            .as_ref()
            .map_or(0, |depth| usize::from(depth.heard.is_some()) + usize::from(depth.body_heard.is_some()));
        let task =
            |row| Task { member: row, row, unprompted: None, guidance: 1.0, rest: 0.0, sampler, chunk: 0, keyframe: 0 };
        Self {
            scratch: net.scratch(avatars),
            states: (0..avatars * config.lm.d_model).map(|_| random.normal()).collect(),
            heard: (0..avatars * places * config.lm.d_model).map(|_| random.normal()).collect(),
            tasks: (0..avatars).map(task).collect(),
            before: vec![0; avatars * net.codes()],
            free: vec![FREE; avatars * net.codes()],
            net,
        }
    }

    /// Number of codes of a keyframe.
    pub fn codes(&self) -> usize {
        self.net.codes()
    }

    /// Samples the codes of one keyframe of every avatar, as a stream does.
    pub fn draw(&mut self, cx: Compute) {
        let mut first = 0;
        while first < self.tasks.len() {
            let codes = first * self.net.codes();
            let tasks = (&self.tasks[first..], &self.before[codes..], &self.free[codes..]);
            let states = (&self.states[..], &self.heard[..]);
            let drawn = self.net.draw(cx, &mut self.scratch, states, tasks, 0..self.net.codes(), |_, _| ());
            first += drawn.expect(OK);
        }
    }
}

/// The audio tokenizer with three seconds of noise.
#[derive(Debug)]
pub struct Audio {
    tokenizer: Tokenizer,
    samples: Vec<f32>,
}

impl Audio {
    /// Loads the tokenizer in the file's own precision.
    pub fn load(file: &ModelFile) -> Self {
        let mut random = Random::new(5);
        Self {
            tokenizer: Tokenizer::load(&Loader::new(file, Precision::Stored, isa())).expect(OK),
            samples: (0..SECONDS * file.config().audio.sample_rate).map(|_| 0.1 * random.unit()).collect(),
        }
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.samples.len()
    }

    /// Computes the features.
    pub fn features(&self, cx: Compute) {
        self.tokenizer.features(cx, &self.samples).expect(OK);
    }
}

/// Reading memory at full bandwidth on the same threads: the lower bound of a decoder
/// step's time.
#[derive(Debug)]
pub struct Reading {
    memory: AlignedBox<i8>,
    /// The fastest order on this processor.
    order: peak::Order,
    /// Position where the last call ended.
    at: usize,
}

impl Reading {
    /// Allocates as much memory as the decoder's weights take, in huge pages.
    pub fn new() -> Self {
        let mut memory = AlignedBox::<i8>::zeroed(READ_BYTES);
        memory.fill(1);
        Self { memory, order: floor::faster_order(1, isa(), READ_BYTES).0, at: 0 }
    }

    /// Reads the next `bytes`, divided among the threads.
    pub fn read(&mut self, cx: Compute, bytes: usize) {
        if self.at + bytes > self.memory.len() {
            self.at = 0;
        }
        let bytes = &self.memory[self.at..][..bytes];
        let share = bytes.len().div_ceil(cx.team.threads());
        cx.team.run(&|thread| {
            let end = bytes.len().min((thread + 1) * share);
            peak::read(cx.isa, self.order, &bytes[end.min(thread * share)..end]);
        });
        self.at += bytes.len();
    }
}

impl Default for Reading {
    fn default() -> Self {
        Self::new()
    }
}
