//! Procedural layers over the decoders' frames that keep a figure alive between and during the
//! model's gestures (SPEC 2.11).
//!
//! Layers run on the host's side of a session, one tick per frame in order. The host's requests take
//! effect at once, and a figure stays alive in silence. A tick reads only the frame, its cue and the
//! host's controls: frames do not depend on how audio was split into pushes or on when frames were
//! pulled.
//!
//! | order | module | contents |
//! |---|---|---|
//! | 1 | `rest`, `couple` | hands at rest between phrases of gestures; trunk, shoulders and legs that go with the hands |
//! | 2 | `gesture`, `words` | gestures on command and for words, over the model's motion |
//! | | `voiced`, `mood` | size, posture and face by the voice's arousal; face and posture of a mood; neutral only removes an unintended frown |
//! | 3 | `attention` | idle, listening, thinking, speaking: weights that the other layers read |
//! | 4 | `idle` | breath, sway, weight shifts, fingers |
//! | 5 | `nods` | head motion on accents and while listening |
//! | 6 | `gaze` | look-at: eyes, head and trunk; fixations and saccades; blinks and lids |
//! | 7 | `asymmetry` | small differences between the left and right of the face |
//! | 8 | `lips` | lip shapes of sounds whose times the host knows |
//! | 9 | `feet` | a root that stays near its home, planted feet, steps |
//! | | `company` | what the others of a scene ask for: `gaze` and `nods` answer to it; posture, half smiles, yielding |
//!
//! Implementation detail of `umo-core`, which re-exports what users need. No promise of stability.
//!
//! A new gain is reached over 0.4 s. A layer whose gain is 0 leaves the frame's bits unchanged.

#![deny(unsafe_code)]

mod asymmetry;
mod attention;
mod company;
mod couple;
mod error;
mod feet;
mod gains;
mod gaze;
pub mod gesture;
mod idle;
mod inhale;
mod leg;
pub(crate) mod lips;
mod mood;
mod nods;
mod noise;
mod rest;
mod rig;
#[cfg(test)]
mod trial;
mod voiced;
mod words;

use attention::Weights;
use rig::Rig;
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::face::Face;
use umo_core_pose::frame::{Cue, OwnedFrame};
use umo_core_pose::skeleton::Skeleton;

pub use attention::Attention;
pub use company::{Company, Role};
pub use error::RequestError;
pub use gesture::{Gesture, GestureOptions, GestureParts, Gestures, MAX_GESTURES, MAX_PENDING_GESTURES, Side};
pub use lips::{LipShape, MAX_HINT_SECONDS, MAX_PENDING_HINTS};
pub use mood::Mood;
pub use umo_core_words::{MAX_PENDING_WORDS, MAX_WORDS_SECONDS, RulesError, WordRules};

/// A layer whose strength can be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Blinks, fixations, saccades and lids; the eyes' share of a look-at.
    Gaze = 0,
    /// Breath, sway, weight shifts and fingers; hands at rest between gestures.
    Idle = 1,
    /// Small differences between the left and right of the face.
    Asymmetry = 2,
    /// Nods on accents, and while listening.
    Nods = 3,
    /// Face and posture of a mood; without a mood, removes the model's unintended frown.
    Mood = 4,
    /// Planted feet, steps, and the root's return to its home.
    Feet = 5,
    /// Trunk, shoulders and legs that go with the hands; stances.
    Body = 6,
}

/// Number of layers.
pub const LAYERS: usize = 7;

impl Layer {
    /// All layers in numeric order.
    pub const ALL: [Self; LAYERS] =
        [Self::Gaze, Self::Idle, Self::Asymmetry, Self::Nods, Self::Mood, Self::Feet, Self::Body];

    /// Name of the layer.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gaze => "gaze",
            Self::Idle => "idle",
            Self::Asymmetry => "asymmetry",
            Self::Nods => "nods",
            Self::Mood => "mood",
            Self::Feet => "feet",
            Self::Body => "body",
        }
    }
}

/// Initial gain of each layer, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerGains {
    gains: [f32; LAYERS],
}

impl LayerGains {
    /// Every layer at full gain.
    pub const ON: Self = Self { gains: [1.0; LAYERS] };
    /// All layers off: the decoders' frames, bit for bit.
    pub const OFF: Self = Self { gains: [0.0; LAYERS] };

    /// Replaces the gain of one layer. Gains are clamped to 0 to 1; NaN counts as 0.
    #[must_use]
    pub fn with(mut self, layer: Layer, gain: f32) -> Self {
        self.gains[layer as usize] = if gain.is_nan() { 0.0 } else { gain.clamp(0.0, 1.0) };
        self
    }

    /// Gain of one layer.
    pub fn gain(&self, layer: Layer) -> f32 {
        self.gains[layer as usize]
    }

    /// Whether every gain is 0.
    pub fn is_off(&self) -> bool {
        self.gains == [0.0; LAYERS]
    }
}

/// The host's requests at this tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Controls {
    /// Gain that each layer approaches.
    pub layers: LayerGains,
    /// Target to look at in the avatar's space, metres.
    pub look_at: [f32; 3],
    /// Strength of the look-at, 0 to 1; 0 without a target.
    pub look_at_strength: f32,
    /// Attention of the avatar.
    pub attention: Attention,
    /// How far body and face follow the arousal of the voice, 0 to 1.
    pub expression: f32,
    /// Frequency of gestures, 0 to 1; at 1 hands are where the model has them.
    pub activity: f32,
    /// Mood of the avatar.
    pub mood: Mood,
    /// Strength of the mood, 0 to 1.
    pub mood_strength: f32,
    /// Requested gestures.
    pub gestures: gesture::Requests,
    /// Requested lip shapes.
    pub hints: lips::Hints,
    /// Words and their times.
    pub words: umo_core_words::Hints,
    /// The others of a scene, or the person at a microphone.
    pub company: Company,
}

/// Position of a frame in the host's audio.
#[derive(Clone, Copy, Debug)]
pub struct Heard {
    /// Position of the frame, sample frames.
    pub sample: u64,
    /// Samples a second.
    pub rate: usize,
}

impl Controls {
    /// Controls of a host that has set only the layers' gains.
    pub fn new(layers: LayerGains) -> Self {
        Self {
            layers,
            look_at: [0.0; 3],
            look_at_strength: 0.0,
            attention: Attention::Auto,
            expression: 0.0,
            activity: 1.0,
            mood: Mood::Neutral,
            mood_strength: 0.0,
            gestures: gesture::Requests::NONE,
            hints: lips::Hints::NONE,
            words: umo_core_words::Hints::NONE,
            company: Company::ALONE,
        }
    }

    /// Makes every request one of this epoch.
    pub fn move_to(&mut self, epoch: u32) {
        self.gestures.move_to(epoch);
        self.hints.move_to(epoch);
        self.words.move_to(epoch);
    }

    /// Whether values that stay in force are those of `other`.
    pub fn stands_as(&self, other: &Self) -> bool {
        let values = |controls: &Self| {
            let Self {
                layers, look_at, look_at_strength, attention, expression, activity, mood, mood_strength, ..
            } = *controls;
            (
                layers,
                (look_at_strength > 0.0).then_some((look_at, look_at_strength)),
                attention,
                (expression, activity),
                (mood, mood_strength),
            )
        };
        values(self) == values(other)
    }

    /// Saves or loads the controls.
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.places(&mut self.look_at)?;
        for share in self.layers.gains.iter_mut().chain([
            &mut self.look_at_strength,
            &mut self.mood_strength,
            &mut self.expression,
            &mut self.activity,
        ]) {
            pass.share(share)?;
        }
        self.gestures.state(pass)?;
        self.hints.state(pass)?;
        self.words.state(pass)?;
        self.company.state(pass)?;
        let attention = pass.limited("attention", self.attention as u64, Attention::ALL.len() as u64 - 1)?;
        let mood = pass.limited("mood", self.mood as u64, Mood::ALL.len() as u64 - 1)?;
        if pass.loads() {
            self.attention = Attention::ALL[usize::try_from(attention).unwrap_or_default()];
            self.mood = Mood::ALL[usize::try_from(mood).unwrap_or_default()];
        }
        Ok(())
    }
}

/// Inputs of every layer at a tick.
#[derive(Debug)]
pub(crate) struct Tick<'a> {
    /// Number of ticks before this one.
    pub(crate) number: u64,
    /// Duration of a tick, seconds.
    pub(crate) seconds: f32,
    pub(crate) seed: u64,
    pub(crate) cue: Cue,
    pub(crate) controls: &'a Controls,
    /// Weight of each attention state at this tick.
    pub(crate) weights: Weights,
    /// Where a word's gesture takes the eyes: to the left and down from the body's heading, radians.
    pub(crate) glance: Option<[f32; 2]>,
    pub(crate) rig: &'a Rig,
    /// How lively the voice is, times the expression: 0 for an ordinary one.
    pub(crate) lively: f32,
    /// Shift of weight in company, metres to the left.
    pub(crate) shift: f32,
    /// A stance's requests to the feet.
    pub(crate) stride: couple::Stride,
    /// Weight of rest of each hand.
    pub(crate) resting: [f32; 2],
    /// Gain of the layer.
    pub(crate) gain: f32,
}

impl Tick<'_> {
    /// Seconds since the first tick.
    fn time(&self) -> f64 {
        self.number as f64 * f64::from(self.seconds)
    }
}

/// All layers of one avatar.
#[derive(Debug)]
pub struct LayerStack {
    rig: Rig,
    seconds: f32,
    seed: u64,
    ticks: u64,
    gains: gains::Gains,
    gesture: gesture::Player,
    words: words::Words,
    voiced: voiced::Voiced,
    rest: rest::Rest,
    couple: couple::Couple,
    mood: mood::Expression,
    attention: attention::State,
    idle: idle::Idle,
    nods: nods::Nods,
    gaze: gaze::Gaze,
    asymmetry: asymmetry::Asymmetry,
    lips: lips::Lips,
    feet: feet::Feet,
    presence: company::Presence,
}

impl LayerStack {
    /// Creates the layers at the start of a stream, for a model's skeleton and face.
    pub fn new(
        (skeleton, face): (&Skeleton, &Face),
        frame_rate: usize,
        rest: &OwnedFrame,
        seed: u64,
        (gestures, words): (Gestures, WordRules),
    ) -> Self {
        Self::of(Rig::new(skeleton, face, &rest.pose), 1.0 / frame_rate as f32, seed, gestures, words)
    }

    /// Creates the layers for a rig, with `seconds` per tick.
    fn of(rig: Rig, seconds: f32, seed: u64, gestures: Gestures, words: WordRules) -> Self {
        Self {
            seconds,
            seed,
            ticks: 0,
            gains: gains::Gains::new(),
            gesture: gesture::Player::new(gestures),
            words: words::Words::new(words),
            voiced: voiced::Voiced::new(),
            rest: rest::Rest::new(),
            couple: couple::Couple::new(),
            mood: mood::Expression::new(),
            attention: attention::State::new(),
            idle: idle::Idle::new(),
            nods: nods::Nods::new(),
            gaze: gaze::Gaze::new(),
            asymmetry: asymmetry::Asymmetry::new(),
            lips: lips::Lips::new(),
            feet: feet::Feet::new(),
            presence: company::Presence::new(),
            rig,
        }
    }

    /// Seed of the random draws.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Duration of a tick, seconds.
    pub fn seconds(&self) -> f32 {
        self.seconds
    }

    /// Whether a tick leaves the frame unchanged.
    pub fn is_off(&self, controls: &Controls) -> bool {
        self.gains.are_off(&controls.layers)
            && self.gesture.is_empty(&controls.gestures)
            && self.lips.is_empty(&controls.hints)
            && self.words.is_empty(&controls.words)
    }

    /// Number of gestures that began or were dropped before they began.
    pub fn begun_gestures(&self) -> u64 {
        self.gesture.begun()
    }

    /// Number of lip hints that were shown or dropped.
    pub fn passed_hints(&self) -> u64 {
        self.lips.passed()
    }

    /// Number of words that were decided or dropped.
    pub fn passed_words(&self) -> u64 {
        self.words.passed()
    }

    /// Rules of the words.
    pub fn word_rules(&self) -> &WordRules {
        self.words.rules()
    }

    /// Replaces the rules of the words, before the first one.
    pub fn set_word_rules(&mut self, rules: WordRules) {
        self.words = words::Words::new(rules);
    }

    /// Begins a new epoch from the current pose: earlier gestures fade out over `ticks`.
    pub fn interrupt(&mut self, epoch: u32, ticks: u64, controls: &Controls) {
        self.gesture.interrupt(epoch, ticks, 1.0 / self.seconds, &controls.gestures);
        self.lips.interrupt(epoch, &controls.hints);
        self.words.interrupt(epoch, &controls.words);
    }

    /// Checks the properties that a state must share with these layers.
    pub fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        self.gesture.identity(pass)?;
        pass.same("set of word rules", self.words.rules().fingerprint())
    }

    /// Returns to the start of a stream in `epoch`.
    pub fn reset(&mut self, epoch: u32, controls: &Controls) {
        self.ticks = 0;
        self.gains = gains::Gains::new();
        self.gesture.reset(epoch, &controls.gestures);
        self.lips.interrupt(epoch, &controls.hints);
        self.words.reset(epoch, &controls.words);
        self.voiced = voiced::Voiced::new();
        self.rest = rest::Rest::new();
        self.couple = couple::Couple::new();
        self.mood = mood::Expression::new();
        self.attention = attention::State::new();
        self.idle = idle::Idle::new();
        self.nods = nods::Nods::new();
        self.gaze = gaze::Gaze::new();
        self.asymmetry = asymmetry::Asymmetry::new();
        self.feet = feet::Feet::new();
        self.presence = company::Presence::new();
    }

    /// Goes on in another epoch, with the requests of the present one.
    pub fn move_to(&mut self, epoch: u32) {
        self.gesture.move_to(epoch);
        self.lips.move_to(epoch);
        self.words.move_to(epoch);
    }

    /// Lets a tick pass while the layers are off.
    pub fn skip(&mut self, controls: &Controls) {
        self.gains.advance(&controls.layers, self.seconds);
        self.ticks += 1;
    }

    /// Runs one tick: turns the decoders' next frame into the frame to show. `heard` is `None` for a frame
    /// without audio. Never allocates.
    pub fn apply(&mut self, frame: &mut OwnedFrame, controls: &Controls, heard: Option<Heard>) {
        if self.is_off(controls) {
            return self.skip(controls);
        }
        let gains = self.gains.advance(&controls.layers, self.seconds);
        let mut tick = Tick {
            number: self.ticks,
            seconds: self.seconds,
            seed: self.seed,
            cue: frame.cue,
            controls,
            weights: Weights::default(),
            glance: None,
            rig: &self.rig,
            lively: 0.0,
            shift: 0.0,
            stride: couple::Stride::default(),
            resting: [0.0; 2],
            gain: 1.0,
        };
        tick.weights = self.attention.advance(&tick);
        tick.lively = self.voiced.advance(&tick);
        tick.shift = self.presence.advance(&tick);
        self.gaze.read(frame, &self.rig);
        if let Some(heard) = heard {
            self.words.apply(&mut self.gesture, frame, &tick, heard);
        }
        tick.glance = self.gesture.glance(&tick);
        let at = |layer: Layer, tick: &mut Tick| {
            tick.gain = gains[layer as usize];
            tick.gain > 0.0
        };
        // Gestures on command have their own size.
        if at(Layer::Mood, &mut tick) {
            voiced::Voiced::apply(frame, &tick);
            self.presence.yield_floor(frame, &tick);
        }
        let (mut resting, mut phrase) = ([0.0; 2], None);
        if at(Layer::Idle, &mut tick) {
            tick.resting = self.rest.advance(&frame.pose, &tick);
            (resting, phrase) = (tick.resting.map(|weight| tick.gain * weight), self.rest.phrase(&tick));
        }
        if at(Layer::Body, &mut tick) {
            tick.stride = self.couple.apply(&mut frame.pose, &tick, resting, phrase);
        }
        if at(Layer::Idle, &mut tick) {
            self.rest.apply(&mut frame.pose, &tick);
        }
        self.gesture.apply(frame, &tick);
        if at(Layer::Mood, &mut tick) {
            self.mood.apply(frame, &tick);
            self.presence.smile(frame, &tick);
        }
        if at(Layer::Idle, &mut tick) {
            self.idle.apply(frame, &tick);
            self.presence.lean(frame, &tick);
        }
        if at(Layer::Nods, &mut tick) {
            self.nods.apply(frame, &tick);
        }
        if at(Layer::Gaze, &mut tick) {
            self.gaze.apply(frame, &tick);
        }
        if at(Layer::Asymmetry, &mut tick) {
            self.asymmetry.apply(frame, &tick);
        }
        if let Some(heard) = heard {
            self.lips.apply(frame, &self.rig, &controls.hints, heard, self.seconds);
        }
        if at(Layer::Feet, &mut tick) {
            self.feet.apply(frame, &tick);
        }
        self.ticks += 1;
    }

    /// Saves or loads the layers between two ticks, and their seed: random draws continue where they were.
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("seed of the layers", &mut self.seed, u64::MAX)?;
        pass.number("ticks", &mut self.ticks, umo_core_pose::frame::MAX_INDEX)?;
        self.gains.state(pass)?;
        self.gesture.state(pass)?;
        self.words.state(pass)?;
        self.voiced.state(pass)?;
        self.rest.state(pass)?;
        self.couple.state(pass)?;
        self.mood.state(pass)?;
        self.attention.state(pass)?;
        self.idle.state(pass)?;
        self.nods.state(pass)?;
        self.gaze.state(pass)?;
        self.asymmetry.state(pass)?;
        self.lips.state(pass)?;
        self.feet.state(pass)?;
        self.presence.state(pass)
    }
}

/// A source file of this crate, as panics name it.
pub const SOURCE: &str = file!();
