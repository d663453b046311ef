//! What keeps a figure alive between and under the model's gestures: layers over the decoders'
//! frames (SPEC 2.11).
//!
//! Layers run on the host's side of a session, one tick per frame in order, so that what the host
//! asks for shows at once and a figure stays alive while no speech comes. A tick reads the frame,
//! its cue and the host's controls, and nothing else: frames do not depend on how audio was
//! cut or when frames were pulled.
//!
//! | order | module | what it does |
//! |---|---|---|
//! | 1 | `gesture` | gestures on command, over what the model does |
//! | 2 | `mood` | face and posture of a mood; neutral is neutral |
//! | 3 | `attention` | idle, listening, thinking, speaking: weights that the other layers read |
//! | 4 | `idle` | breath, sway, weight shifts, fingers |
//! | 5 | `nods` | the head on accents, and while listening |
//! | 6 | `gaze` | look-at: eyes, head and trunk; fixations and saccades; blinks and lids |
//! | 7 | `asymmetry` | the face's left and right a little apart |
//! | 8 | `lips` | lips of sounds that the host knows the times of |
//! | 9 | `feet` | a root that stays near its home, planted feet, steps |
//!
//! A gain that is set anew is reached over 0.4 s. A layer whose gain is 0 leaves the frame's bits as
//! they are.

mod asymmetry;
mod attention;
mod feet;
mod gains;
mod gaze;
pub(crate) mod gesture;
mod idle;
mod leg;
mod levels;
pub(crate) mod lips;
mod mood;
mod nods;
mod noise;
mod rig;
#[cfg(test)]
mod trial;

use crate::config::Config;
use crate::state::{StateError, StatePass};
use crate::stream::OwnedFrame;
use attention::Weights;
use rig::Rig;

pub(crate) use levels::Levels;

pub use attention::Attention;
pub use gesture::{
    Gesture, GestureOptions, GestureParts, Gestures, MAX_GESTURE_FRAMES, MAX_GESTURES, MAX_PENDING_GESTURES, Side,
};
pub use lips::{LipShape, MAX_HINT_SECONDS, MAX_PENDING_HINTS};
pub use mood::Mood;

/// A layer whose strength can be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Layer {
    /// Blinks, fixations, saccades and lids; the eyes' part of a look-at.
    Gaze = 0,
    /// Breath, sway, weight shifts and fingers.
    Idle = 1,
    /// The face's left and right a little apart.
    Asymmetry = 2,
    /// Nods on accents, and while listening.
    Nods = 3,
    /// The mood's face and posture; without a mood it takes a frown away that nothing asked for.
    Mood = 4,
    /// Planted feet, steps, and the root's way back to where it stood.
    Feet = 5,
}

/// Number of layers.
pub const LAYERS: usize = 6;

impl Layer {
    /// All layers, in the order of their numbers.
    pub const ALL: [Self; LAYERS] = [Self::Gaze, Self::Idle, Self::Asymmetry, Self::Nods, Self::Mood, Self::Feet];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gaze => "gaze",
            Self::Idle => "idle",
            Self::Asymmetry => "asymmetry",
            Self::Nods => "nods",
            Self::Mood => "mood",
            Self::Feet => "feet",
        }
    }
}

/// How strong each layer is at the start, each 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LifeConfig {
    gains: [f32; LAYERS],
}

impl LifeConfig {
    /// Every layer as strong as it was made to be.
    pub const ON: Self = Self { gains: [1.0; LAYERS] };
    /// The decoders' frames, bit for bit.
    pub const OFF: Self = Self { gains: [0.0; LAYERS] };

    /// With another gain for one layer. Gains are clamped to 0 to 1; NaN counts as 0.
    #[must_use]
    pub fn with(mut self, layer: Layer, gain: f32) -> Self {
        self.gains[layer as usize] = if gain.is_nan() { 0.0 } else { gain.clamp(0.0, 1.0) };
        self
    }

    /// One layer's gain.
    pub fn gain(&self, layer: Layer) -> f32 {
        self.gains[layer as usize]
    }

    /// Whether no layer does anything.
    pub fn is_off(&self) -> bool {
        self.gains == [0.0; LAYERS]
    }
}

/// What the engine knows of a frame beside its pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Cue {
    /// Root mean square of the frame's sound, full scale 1; 0 where there is none.
    pub(crate) level: f32,
    /// How sure the model is that each foot joint stands still, 0 to 1: left ankle and foot, right
    /// ankle and foot.
    pub(crate) contacts: [f32; 4],
}

/// What the host asks for, as of now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Controls {
    pub(crate) layers: LifeConfig,
    /// A point in the avatar's space, metres, to look at.
    pub(crate) look_at: [f32; 3],
    /// How much, 0 to 1; 0 for nothing to look at.
    pub(crate) look_at_strength: f32,
    pub(crate) attention: Attention,
    pub(crate) mood: Mood,
    /// 0 to 1.
    pub(crate) mood_strength: f32,
    pub(crate) gestures: gesture::Requests,
    pub(crate) hints: lips::Hints,
}

/// The place in the host's audio that a frame belongs to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Heard {
    pub(crate) sample: u64,
    /// Samples a second.
    pub(crate) rate: usize,
}

impl Controls {
    pub(crate) fn new(layers: LifeConfig) -> Self {
        Self {
            layers,
            look_at: [0.0; 3],
            look_at_strength: 0.0,
            attention: Attention::Auto,
            mood: Mood::Neutral,
            mood_strength: 0.0,
            gestures: gesture::Requests::NONE,
            hints: lips::Hints::NONE,
        }
    }

    /// Describes the controls.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.places(&mut self.look_at)?;
        for share in self.layers.gains.iter_mut().chain([&mut self.look_at_strength, &mut self.mood_strength]) {
            pass.share(share)?;
        }
        self.gestures.state(pass)?;
        self.hints.state(pass)?;
        let attention = pass.limited("attention", self.attention as u64, Attention::ALL.len() as u64 - 1)?;
        let mood = pass.limited("mood", self.mood as u64, Mood::ALL.len() as u64 - 1)?;
        if pass.loads() {
            self.attention = Attention::ALL[usize::try_from(attention).unwrap_or_default()];
            self.mood = Mood::ALL[usize::try_from(mood).unwrap_or_default()];
        }
        Ok(())
    }
}

/// What every layer reads at a tick.
#[derive(Debug)]
pub(crate) struct Tick<'a> {
    /// Ticks before this one.
    pub(crate) number: u64,
    /// Seconds of one tick.
    pub(crate) seconds: f32,
    pub(crate) seed: u64,
    pub(crate) cue: Cue,
    /// Level of who speaks to the avatar, as [`Cue::level`].
    pub(crate) other_level: f32,
    pub(crate) controls: &'a Controls,
    /// How much each state of attention counts at this tick.
    pub(crate) weights: Weights,
    pub(crate) rig: &'a Rig,
    /// This layer's gain.
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
pub(crate) struct Life {
    rig: Rig,
    seconds: f32,
    seed: u64,
    ticks: u64,
    gains: gains::Gains,
    gesture: gesture::Player,
    mood: mood::Expression,
    attention: attention::State,
    idle: idle::Idle,
    nods: nods::Nods,
    gaze: gaze::Gaze,
    asymmetry: asymmetry::Asymmetry,
    lips: lips::Lips,
    feet: feet::Feet,
}

impl Life {
    /// Layers at the start of a stream, for a model's skeleton and face.
    pub(crate) fn new(config: &Config, rest: &OwnedFrame, seed: u64, gestures: Gestures) -> Self {
        let rig = Rig::new(&config.skeleton, &config.face, &rest.pose);
        Self::of(rig, 1.0 / config.frame_rate as f32, seed, gestures)
    }

    /// The same for a rig, at `seconds` a tick.
    fn of(rig: Rig, seconds: f32, seed: u64, gestures: Gestures) -> Self {
        Self {
            seconds,
            seed,
            ticks: 0,
            gains: gains::Gains::new(),
            gesture: gesture::Player::new(gestures),
            mood: mood::Expression::new(),
            attention: attention::State::new(),
            idle: idle::Idle::new(),
            nods: nods::Nods::new(),
            gaze: gaze::Gaze::new(),
            asymmetry: asymmetry::Asymmetry::new(),
            lips: lips::Lips::new(),
            feet: feet::Feet::new(),
            rig,
        }
    }

    /// Whether a tick leaves the frame as it is.
    pub(crate) fn is_off(&self, controls: &Controls) -> bool {
        self.gains.are_off(&controls.layers)
            && self.gesture.is_empty(&controls.gestures)
            && self.lips.is_empty(&controls.hints)
    }

    /// Gestures that began, or were dropped before.
    pub(crate) fn begun_gestures(&self) -> u64 {
        self.gesture.begun()
    }

    /// Hints of lips that were shown, or dropped.
    pub(crate) fn passed_hints(&self) -> u64 {
        self.lips.passed()
    }

    /// A new epoch begins where the avatar stands: gestures of before go out within some ticks.
    pub(crate) fn interrupt(&mut self, epoch: u32, ticks: u64, controls: &Controls) {
        self.gesture.interrupt(epoch, ticks, 1.0 / self.seconds, &controls.gestures);
        self.lips.interrupt(epoch, &controls.hints);
    }

    /// What a state must have in common with these layers.
    pub(crate) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        self.gesture.identity(pass)
    }

    /// Back to the start of a stream, of an epoch.
    pub(crate) fn reset(&mut self, epoch: u32, controls: &Controls) {
        self.ticks = 0;
        self.gains = gains::Gains::new();
        self.gesture.reset(epoch, &controls.gestures);
        self.lips.interrupt(epoch, &controls.hints);
        self.mood = mood::Expression::new();
        self.attention = attention::State::new();
        self.idle = idle::Idle::new();
        self.nods = nods::Nods::new();
        self.gaze = gaze::Gaze::new();
        self.asymmetry = asymmetry::Asymmetry::new();
        self.feet = feet::Feet::new();
    }

    /// One tick: changes the next frame of the decoders into what is shown; `heard` is none for a frame
    /// that no audio belongs to. Never allocates.
    pub(crate) fn apply(
        &mut self,
        frame: &mut OwnedFrame,
        controls: &Controls,
        other_level: f32,
        heard: Option<Heard>,
    ) {
        let is_off = self.is_off(controls);
        let gains = self.gains.advance(&controls.layers, self.seconds);
        if is_off {
            self.ticks += 1;
            return;
        }
        let mut tick = Tick {
            number: self.ticks,
            seconds: self.seconds,
            seed: self.seed,
            cue: frame.cue,
            other_level,
            controls,
            weights: Weights::default(),
            rig: &self.rig,
            gain: 1.0,
        };
        tick.weights = self.attention.advance(&tick);
        self.gaze.read(frame, &self.rig);
        self.gesture.apply(frame, &tick);
        let at = |layer: Layer, tick: &mut Tick| {
            tick.gain = gains[layer as usize];
            tick.gain > 0.0
        };
        if at(Layer::Mood, &mut tick) {
            self.mood.apply(frame, &tick);
        }
        if at(Layer::Idle, &mut tick) {
            self.idle.apply(frame, &tick);
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

    /// Describes the layers between two ticks, and their seed: what is drawn goes on where it was.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("seed of the layers", &mut self.seed, u64::MAX)?;
        pass.number("ticks", &mut self.ticks, crate::stream::MAX_INDEX)?;
        self.gains.state(pass)?;
        self.gesture.state(pass)?;
        self.mood.state(pass)?;
        self.attention.state(pass)?;
        self.idle.state(pass)?;
        self.nods.state(pass)?;
        self.gaze.state(pass)?;
        self.asymmetry.state(pass)?;
        self.lips.state(pass)?;
        self.feet.state(pass)
    }
}
