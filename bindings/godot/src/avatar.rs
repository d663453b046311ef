//! The node: properties, methods, signals, and the clock from sound to motion.

mod follow;

use std::ffi::CString;
use std::mem::discriminant;
use std::path::PathBuf;
use std::rc::Rc;

use godot::classes::{AudioStreamWav, FileAccess, INode3D, Node3D, Os, ProjectSettings};
use godot::prelude::*;

use crate::ffi;
use crate::rig::{Face, Rig};
use crate::source::{self, Source};
use crate::umo::{FileGesture, Hint, Model, Play, Said, Session, Settings, Shown};

/// Folder of umo's library in a project, next to this one: one subfolder per platform, as in `umo.gdextension`.
const ADDON: &str = "res://addons/umo/bin/";
const PLATFORM: &str = if cfg!(target_os = "windows") {
    "windows-x64"
} else if cfg!(target_os = "macos") {
    "macos"
} else if cfg!(target_os = "android") {
    "android"
} else if cfg!(target_arch = "aarch64") {
    "linux-arm64"
} else {
    "linux-x64"
};
const LIBRARY: &str = if cfg!(target_os = "windows") {
    "umo.dll"
} else if cfg!(target_os = "macos") {
    "libumo.dylib"
} else {
    "libumo.so"
};

const IDLE_REST: i32 = ffi::IDLE_REST.cast_signed();
// Attributes of properties cannot take the numbers of their values from constants.
const _: () =
    assert!(ffi::IDLE_REST == 1 && ffi::IDLE_LIVE == 2 && ffi::ATTENTION_SPEAKING == 4 && ffi::MOOD_AFRAID == 6);
/// Hints of a kind that wait for a line, and as many as the library keeps.
const MOST_HINTS: usize = 64;
const VOICE_AUTO: i32 = 0;
const VOICE_LIVE: i32 = 2;
/// A sound that the player plays, and the motion time that belongs to it.
struct Line {
    stream: Variant,
    /// The last known position of the player, in seconds.
    position: f64,
    /// Position at which the source began, in seconds.
    start: f64,
    /// Motion time that belongs to `start`.
    base: f64,
    /// Seconds of audio that the session received before; `None` if unknown.
    first: Option<f64>,
    source: Source,
}

/// An animated avatar: moves a skeleton and blend shapes to the sound of an audio player.
///
/// Use it on the main thread only, like everything in the scene tree.
#[derive(GodotClass)]
#[class(init, base = Node3D)]
pub(crate) struct UmoAvatar3D {
    /// The model file, at any path that Godot can read.
    #[export(file = "*.safetensors")]
    model: GString,
    /// The audio player whose sound drives the avatar: an AudioStreamPlayer, 2D or 3D.
    #[export]
    audio_player: NodePath,
    /// The Skeleton3D to animate. Its bones need names that `docs/retarget.md` lists.
    #[export]
    skeleton: NodePath,
    /// MeshInstance3Ds whose blend shapes are animated. The shapes need ARKit's names.
    #[export]
    meshes: Array<NodePath>,
    /// Whether the hips translate as well as rotate.
    #[export]
    #[init(val = true)]
    move_root: bool,
    /// Strength with which arms keep out of the body, whose girth is measured on the skeleton's meshes at rest: MeshInstance3Ds below
    /// it, skinned or on a BoneAttachment3D. 0: the body has no volume.
    #[export(range = (0.0, 1.0, 0.01))]
    volume: f64,
    /// Keyframes predicted per chunk: fewer reduce latency. 0 is the model's default. Applied at the next `open()`.
    #[export]
    #[init(val = 1)]
    target: i32,
    /// Frames held back for smoother seams; -1 is the model's default. Applied at the next `open()`.
    #[export]
    #[init(val = -1)]
    lookahead: i32,
    /// Low-pass filter of the body's motion, standard deviation in frames: 0 turns it off, -1 is the default. Applied
    /// at the next `open()`.
    #[export(range = (-1.0, 1.5, 0.1))]
    #[init(val = -1.0)]
    smoothing: f64,
    /// Guidance strength of the prompt, for models that support it. Applied at the next `open()`.
    #[export(range = (1.0, 3.0, 0.1))]
    #[init(val = 1.0)]
    guidance: f64,
    /// Keyframes of future sound to use, for models that support it. Applied at the next `open()`.
    #[export]
    horizon: i32,
    /// Extra output delay in seconds, in addition to the one that Godot knows (`AudioServer.get_output_latency`): for
    /// example of Bluetooth headphones.
    #[export(range = (0.0, 2.0, 0.01))]
    #[var(set = set_output_delay)]
    output_delay: f64,
    /// Behaviour while no audio arrives.
    #[export(enum = (Hold = 0, Rest = 1, Live = 2))]
    #[var(set = set_idle)]
    #[init(val = IDLE_REST)]
    idle: i32,
    /// Gain of the face's motion: 0 is the rest pose, 1 the model's motion.
    #[export(range = (0.0, 2.0, 0.01))]
    #[var(set = set_gain_face)]
    #[init(val = 1.0)]
    gain_face: f64,
    /// Gain of the fingers' motion.
    #[export(range = (0.0, 2.0, 0.01))]
    #[var(set = set_gain_hands)]
    #[init(val = 1.0)]
    gain_hands: f64,
    /// Gain of the motion of spine, neck, head and arms.
    #[export(range = (0.0, 2.0, 0.01))]
    #[var(set = set_gain_upper)]
    #[init(val = 1.0)]
    gain_upper: f64,
    /// Gain of the motion of pelvis and legs.
    #[export(range = (0.0, 2.0, 0.01))]
    #[var(set = set_gain_lower)]
    #[init(val = 1.0)]
    gain_lower: f64,
    /// Strength of the layer of blinks, gaze and eyelids over the model's motion.
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_layer_gaze)]
    #[init(val = 1.0)]
    layer_gaze: f64,
    /// Strength of the layer of breathing, sway, weight shifts and finger motion.
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_layer_idle)]
    #[init(val = 1.0)]
    layer_idle: f64,
    /// Strength of the layer of differences between the left and the right side of the face.
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_layer_asymmetry)]
    #[init(val = 1.0)]
    layer_asymmetry: f64,
    /// Strength of the layer of nods, on accents and while listening.
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_layer_nods)]
    #[init(val = 1.0)]
    layer_nods: f64,
    /// Strength of the layer of the mood's face and posture.
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_layer_mood)]
    #[init(val = 1.0)]
    layer_mood: f64,
    /// Strength of the layer of planted feet, steps and the return to the starting place.
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_layer_feet)]
    #[init(val = 1.0)]
    layer_feet: f64,
    /// Strength of the layer of trunk, shoulders and legs that go with the hands.
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_layer_body)]
    #[init(val = 1.0)]
    layer_body: f64,
    /// Amount by which body and face follow the arousal of the voice.
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_expression)]
    #[init(val = 0.5)]
    expression: f64,
    /// How often hands leave rest: 0.5 is as people do, 0 hardly ever, 1 nearly always.
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_activity)]
    #[init(val = 0.5)]
    activity: f64,
    /// Focus of attention. `Auto`: the avatar speaks while its audio is heard, listens while that of `push_other_audio`
    /// is heard, and is idle otherwise.
    #[export(enum = (Auto = 0, Idle = 1, Listening = 2, Thinking = 3, Speaking = 4))]
    #[var(set = set_attention)]
    attention: i32,
    /// The mood of face and posture.
    #[export(enum = (Neutral = 0, Joy = 1, Sad = 2, Angry = 3, Surprised = 4, Disgusted = 5, Afraid = 6))]
    #[var(set = set_mood)]
    mood: i32,
    #[export(range = (0.0, 1.0, 0.01))]
    #[var(set = set_mood_strength)]
    #[init(val = 1.0)]
    mood_strength: f64,
    /// A Node3D to look at, such as the camera; empty for none.
    #[export]
    gaze_target: NodePath,
    /// When the mouth moves. `Delayed`: together with the body. `Live`: with the sound, before the body; needs a model
    /// with a mouth network, otherwise it acts as `Delayed`. `Auto`: `Live` if the player's sound is not known in
    /// advance, such as a microphone's, else `Delayed`. Applied at the next `open()`.
    #[export(enum = (Auto = 0, Delayed = 1, Live = 2))]
    voice: i32,
    /// Language of the words of `hint_words`: `en` or `de`. Applied at the next `open()`.
    #[export]
    #[init(val = "en".into())]
    language: GString,
    /// Word rules of your own in TOML, added to the language's: `docs/words.md`. Applied at the next `open()`.
    #[export(multiline)]
    word_rules: GString,
    /// The text prompt, for models that take text.
    #[export(multiline)]
    #[var(set = set_prompt)]
    prompt: GString,
    /// The random seed; -1 is the model's default.
    #[export]
    #[var(set = set_seed)]
    #[init(val = -1)]
    seed: i64,
    /// Sample rate of `push_audio`; 0 is the model's default. A player brings its own. Applied at the next `open()`.
    #[export]
    sample_rate: i32,
    /// Number of interleaved channels of `push_audio`. Applied at the next `open()`.
    #[export]
    #[init(val = 1)]
    channels: i32,

    shared: Option<Rc<Model>>,
    session: Option<Session>,
    line: Option<Line>,
    /// Hints for the line that the player begins next, in seconds of that line.
    hints: Vec<Hint>,
    /// Whether the session has received any audio.
    heard: bool,
    /// The motion time that was shown last, and its pose.
    time: f64,
    shown: Shown,
    frame: Vec<f32>,
    rig: Option<Rig>,
    /// The game's time in seconds since the session was opened.
    clock: f64,
    /// Custom gestures.
    own_gestures: Vec<FileGesture>,
    /// Whether it looks at the target.
    gazes: bool,
    /// The problem already reported about a skeleton whose bone names form no humanoid.
    told_of_bones: Option<String>,
    faces: Vec<Option<Face>>,
    base: Base<Node3D>,
}

#[godot_api]
impl INode3D for UmoAvatar3D {
    fn ready(&mut self) {
        if !self.model.is_empty() {
            self.open();
        }
    }

    fn process(&mut self, delta: f64) {
        if self.audio_player.is_empty() || self.session.is_none() {
            return;
        }
        let player = self.base().get_node_or_null(&self.audio_player);
        self.clock += delta;
        let clock = self.clock;
        // Idle motion follows the game's time, because the game may render slowly or pause.
        let told = self.session.as_ref().map_or(Ok(()), |session| session.set_clock(clock));
        let told = told.and_then(|()| self.follow(player, delta)).and_then(|()| self.show());
        if let Err(error) = told {
            self.fail(&error);
        }
    }

    fn exit_tree(&mut self) {
        // Dropping the line removes the effect from the player's bus. When the avatar returns, the player's sound is a
        // new line.
        self.line = None;
    }
}

#[godot_api]
impl UmoAvatar3D {
    /// The model is loaded and the avatar accepts audio.
    #[signal]
    fn opened();

    /// An error occurred; the same message is in Godot's log. If `is_open()` is now false, the avatar stands still
    /// until it is opened again.
    #[signal]
    fn failed(message: GString);

    /// Loads the model, or reuses it if another avatar has loaded it, and restarts with the current properties.
    #[func]
    fn open(&mut self) -> bool {
        self.close();
        match self.load() {
            Ok(()) => {
                self.base_mut().call_deferred("emit_signal", vslice!["opened"]);
                true
            }
            Err(error) => {
                self.fail(&error);
                false
            }
        }
    }

    /// Plays a take, the bytes of a `.umo` file of the same model, until the next `open()`: the recorded motion, by the
    /// position of the audio player, which plays its sound, or by your own clock. `reset()` begins it anew. The avatar
    /// hears nothing meanwhile; looks, moods and gestures come on top. False if the take cannot be played.
    #[func]
    fn play_take(&mut self, take: PackedByteArray) -> bool {
        let Some(model) = &self.shared else {
            self.complain("play_take: open the avatar first");
            return false;
        };
        match Session::of_take(model, take.as_slice(), u32::try_from(self.idle).unwrap_or(u32::MAX)) {
            Ok(session) => {
                (self.line, self.session, self.gazes) = (None, Some(session), false);
                self.hints.clear();
                self.start_clock();
                true
            }
            Err(error) => {
                self.complain(&error);
                false
            }
        }
    }

    /// Releases session and model.
    #[func]
    fn close(&mut self) {
        (self.line, self.session, self.shared, self.rig) = (None, None, None, None);
        self.faces.clear();
        self.hints.clear();
        self.start_clock();
    }

    /// Whether the avatar accepts audio.
    #[func]
    fn is_open(&self) -> bool {
        self.session.is_some()
    }

    /// Feeds interleaved samples, full scale 1. Returns the number accepted: push the rest later.
    #[func]
    fn push_audio(&mut self, samples: PackedFloat32Array) -> i64 {
        self.heard = true;
        self.tell(|session| session.push(samples.as_slice())).unwrap_or(0) as i64
    }

    /// Feeds the interlocutor's audio, so that the avatar listens: interleaved samples, full scale 1, with the same
    /// rate and channels as its own audio.
    #[func]
    fn push_other_audio(&mut self, samples: PackedFloat32Array) {
        self.tell(|session| session.push_other(samples.as_slice()));
    }

    /// Schedules a visible lip shape, for example from the timings of a speech synthesiser: `shape` is 0 closed (p, b,
    /// m), 1 teeth (f, v) or 2 round (w). With an audio player `start` is in seconds of the stream that it plays now,
    /// or plays next; without one, of the audio pushed since the node was opened or reset. `duration` is at most 2
    /// seconds. Returns false if 64 hints are waiting: call again after one has passed.
    #[func]
    fn hint_lips(&mut self, shape: i32, start: f64, duration: f64) -> bool {
        if !(0..=2).contains(&shape) || !(start >= 0.0 && start.is_finite()) || !(0.0..=2.0).contains(&duration) {
            self.complain(&format!(
                "hint_lips({shape}, {start}, {duration}): expected a shape from 0 to 2, a time from 0 on and a \
                 duration from 0 to 2"
            ));
            return false;
        }
        self.hint(Hint { said: Said::Lips(shape.unsigned_abs()), start, duration })
    }

    /// Gives a word and its time, for example from a speech synthesiser: by the rules of `language` and `word_rules` some
    /// words become gestures. `start` and `end` are on the clock of `hint_lips`. Returns false if 64 words are waiting:
    /// call again after one has passed.
    #[func]
    fn hint_words(&mut self, text: GString, start: f64, end: f64) -> bool {
        let said = CString::new(text.to_string()).ok().filter(|_| start >= 0.0 && start <= end && end.is_finite());
        let Some(said) = said else {
            self.complain(&format!(
                "hint_words({text}, {start}, {end}): expected a text without zero bytes, a time from 0 on and an end after it"
            ));
            return false;
        };
        self.hint(Hint { said: Said::Words(said), start, duration: end - start })
    }

    /// Looks at a point in world space from the next frame on, the eyes first; strength 0 ends it. A `gaze_target`
    /// takes precedence.
    #[func]
    fn gaze_at(&mut self, point: Vector3, strength: f64) {
        let point = self.to_avatar(point);
        #[expect(clippy::cast_possible_truncation, reason = "a strength is 0 to 1")]
        self.tell(|session| session.look_at(point, strength as f32));
    }

    /// Plays a gesture over the current motion: one of `get_gesture_names()`, such as `wave`, `nod` or `thumbs_up`. Its
    /// stroke falls on `at`, a motion time in seconds; if that is negative, as soon as possible. `side` is 0 for the
    /// nearer hand, 1 left, 2 right, 3 both. `variant` 0 is the gesture as drawn, others up to 255 differ a
    /// little. Returns false if the name is unknown or eight gestures are waiting.
    #[func]
    fn play_gesture(
        &mut self,
        gesture: GString,
        #[opt(default = -1.0)] at: f64,
        #[opt(default = 0)] side: i32,
        #[opt(default = 1.0)] strength: f64,
        #[opt(default = 0)] variant: i32,
    ) -> bool {
        self.play(&gesture, at, side, strength, variant, None)
    }

    /// Plays a pointing gesture at a point in world space; the rest is as for `play_gesture`.
    #[func]
    fn play_gesture_at(
        &mut self,
        gesture: GString,
        point: Vector3,
        #[opt(default = -1.0)] at: f64,
        #[opt(default = 0)] side: i32,
        #[opt(default = 1.0)] strength: f64,
        #[opt(default = 0)] variant: i32,
    ) -> bool {
        self.play(&gesture, at, side, strength, variant, Some(self.to_avatar(point)))
    }

    /// Adds a custom gesture, available after the next `open()`: the animation in a `.glb` or `.vrm` file of any
    /// humanoid character. `animation` is its name in the file, empty for the first; `parts` is a sum of 1 (head), 2
    /// (trunk), 4 (left arm) and 8 (right arm); `stroke` is in seconds from its start, negative for its middle.
    #[func]
    fn add_gesture(&mut self, gesture: GString, file: GString, animation: GString, parts: i32, stroke: f64) -> bool {
        let bytes = FileAccess::get_file_as_bytes(&file);
        if bytes.is_empty() {
            let error = FileAccess::get_open_error();
            self.complain(&format!("the gesture's file `{file}` cannot be read: {error:?}"));
            return false;
        }
        #[expect(clippy::cast_possible_truncation, reason = "seconds of a gesture")]
        let added = FileGesture {
            name: gesture.to_string(),
            bytes: bytes.to_vec(),
            animation: (!animation.is_empty()).then(|| animation.to_string()),
            parts: u32::try_from(parts).unwrap_or(u32::MAX),
            stroke: stroke as f32,
        };
        if let Some(Err(error)) = self.shared.as_ref().map(|model| model.add_gesture(&added)) {
            self.complain(&format!("{file}: {error}"));
            return false;
        }
        self.own_gestures.retain(|known| known.name != added.name);
        self.own_gestures.push(added);
        true
    }

    /// Sets the game's time in seconds, which must never decrease, for avatars without an audio player: idle motion
    /// follows it from then on. With a player the node does this by itself.
    #[func]
    fn set_clock(&mut self, seconds: f64) {
        self.tell(|session| session.set_clock(seconds));
    }

    /// Names of the available gestures.
    #[func]
    fn get_gesture_names(&self) -> PackedStringArray {
        let names = self.shared.as_ref().map(|model| model.gesture_names()).unwrap_or_default();
        names.iter().map(GString::from).collect()
    }

    /// Whether the mouth moves with the sound.
    #[func]
    fn is_live(&self) -> bool {
        self.session.as_ref().is_some_and(|session| session.is_live)
    }

    /// Decodes a WAV, in any import format, to samples for `push_audio`: interleaved, full scale 1, at the stream's
    /// `mix_rate`, two channels if it is `stereo`. Empty if it cannot be decoded.
    #[func]
    fn decode(&self, stream: Gd<AudioStreamWav>) -> PackedFloat32Array {
        match source::samples(&stream) {
            Ok(samples) => samples.into(),
            Err(error) => {
                self.complain(&error);
                PackedFloat32Array::new()
            }
        }
    }

    /// Ends the audio: the last frames follow.
    #[func]
    fn finish(&mut self) {
        self.tell(Session::finish);
    }

    /// Returns all frames that are ready, each once. A frame has `get_frame_floats()` numbers: the root's translation
    /// (3), the joints' rotations (4 each: x y z w), the channels, and the visemes if the model has them.
    #[func]
    fn pull_frames(&mut self) -> PackedFloat32Array {
        self.tell(Session::pull).map(PackedFloat32Array::from).unwrap_or_default()
    }

    /// Number of floats in a frame.
    #[func]
    fn get_frame_floats(&self) -> i64 {
        self.shared.as_ref().map_or(0, |model| model.frame_floats() as i64)
    }

    /// Returns the pose at a motion time in seconds, as one frame of `pull_frames`.
    #[func]
    fn sample_pose(&mut self, seconds: f64) -> PackedFloat32Array {
        let mut frame = std::mem::take(&mut self.frame);
        let sampled = self.tell(|session| session.sample(seconds, &mut frame));
        self.frame = frame;
        match sampled {
            Some(shown) => {
                self.saw(seconds, shown);
                self.frame.as_slice().into()
            }
            None => PackedFloat32Array::new(),
        }
    }

    /// Shows the pose at a motion time in seconds on skeleton and meshes: for your own clock, without a player.
    #[func]
    fn drive(&mut self, seconds: f64) {
        if let Err(error) = self.gaze() {
            self.complain(&error);
        }
        if !self.sample_pose(seconds).is_empty() {
            self.apply();
        }
    }

    /// The motion time that was shown last, in seconds.
    #[func]
    fn get_motion_time(&self) -> f64 {
        self.time
    }

    /// Drops all pending motion and eases to rest. The player's current sound is ignored until it starts again.
    #[func]
    fn interrupt(&mut self, milliseconds: i64) {
        let milliseconds = u32::try_from(milliseconds).unwrap_or(u32::MAX);
        if self.tell(|session| session.interrupt(milliseconds)).is_none() {
            return;
        }
        if let Some(line) = &mut self.line {
            line.source = Source::Dropped;
        }
    }

    /// Returns to the state after `open()`.
    #[func]
    fn reset(&mut self) {
        self.tell(Session::reset);
        self.line = None;
        self.hints.clear();
        self.start_clock();
    }

    /// Whether every frame was shown or pulled after `finish`, or after the end of the player's sound.
    #[func]
    fn is_done(&self) -> bool {
        self.tell(Session::is_done).unwrap_or(false)
    }

    /// Arousal of the voice at the newest frame shown or pulled, 0 to 1; 0.5 for an ordinary voice, and for none.
    #[func]
    fn arousal(&self) -> f64 {
        self.tell(Session::arousal).map_or(0.5, |[arousal, _]| arousal.into())
    }

    /// Change of the arousal per second, over the last seconds.
    #[func]
    fn arousal_trend(&self) -> f64 {
        self.tell(Session::arousal).map_or(0.0, |[_, trend]| trend.into())
    }

    /// Returns the complete state of the avatar's stream, for `restore_state`; empty while a chunk of it is being
    /// computed: try again in the next frame.
    #[func]
    fn save_state(&self) -> PackedByteArray {
        self.tell(Session::save).unwrap_or_default()
    }

    /// Continues from a saved state of this avatar, or of one with the same properties: the same audio then gives
    /// bit-identical motion. The player's current sound is ignored until it starts again.
    #[func]
    fn restore_state(&mut self, state: PackedByteArray) -> bool {
        let is_restored = self.tell(|session| session.restore(state.as_slice())).is_some();
        if is_restored {
            self.go_on();
        }
        is_restored
    }

    /// Delay of the motion behind the speech: `samples` of future audio that a frame needs, and the same in `seconds`;
    /// computing time in seconds: `compute_p50`, `compute_p99`, `compute_p999`, `compute_max`; additional delay in
    /// seconds because the engine does not keep up: `backlog` now, `backlog_max` at most; and `mouth_seconds` of future
    /// audio that a mouth needs, less if `is_live()`.
    #[func]
    fn latency(&mut self) -> VarDictionary {
        let rate = self.session.as_ref().map_or(1, |session| session.sample_rate);
        let Some(latency) = self.tell(Session::latency) else { return VarDictionary::new() };
        vdict! {
            "samples" => latency.algorithmic_samples as i64,
            "seconds" => latency.algorithmic_samples as f64 / f64::from(rate),
            "mouth_seconds" => latency.mouth_samples as f64 / f64::from(rate),
            "compute_p50" => latency.compute_p50,
            "compute_p99" => latency.compute_p99,
            "compute_p999" => latency.compute_p999,
            "compute_max" => latency.compute_max,
            "backlog" => latency.backlog_samples as f64 / f64::from(rate),
            "backlog_max" => latency.backlog_max_samples as f64 / f64::from(rate),
        }
    }

    /// Statistics of the session: `chunks`, `frames`, `late_frames`, `dropped_frames`, `overruns`, `silenced`,
    /// `held_chunks`.
    #[func]
    fn stats(&mut self) -> VarDictionary {
        let Some(stats) = self.tell(Session::stats) else { return VarDictionary::new() };
        vdict! {
            "chunks" => stats.chunks as i64,
            "frames" => stats.frames as i64,
            "late_frames" => stats.late_frames as i64,
            "dropped_frames" => stats.dropped_frames as i64,
            "overruns" => stats.overruns as i64,
            "silenced" => stats.silenced as i64,
            "held_chunks" => stats.held_chunks as i64,
        }
    }

    /// Notice that users of the model must be shown; may be empty.
    #[func]
    fn get_notice(&self) -> GString {
        self.shared.as_ref().map(|model| GString::from(&model.notice())).unwrap_or_default()
    }

    /// Names of the joints, in the order of a frame's rotations.
    #[func]
    fn get_joint_names(&self) -> PackedStringArray {
        self.names(ffi::JOINT_COUNT, |model, index| model.joint_name(index))
    }

    /// Parent of each joint, -1 for the first.
    #[func]
    fn get_joint_parents(&self) -> PackedInt32Array {
        self.shared.as_ref().map(|model| PackedInt32Array::from(model.parents)).unwrap_or_default()
    }

    /// Rest position of each joint in its parent's frame, in metres.
    #[func]
    fn get_joint_offsets(&self) -> PackedVector3Array {
        let Some(model) = &self.shared else { return PackedVector3Array::new() };
        model.offsets.iter().map(|&[x, y, z]| Vector3::new(x, y, z)).collect()
    }

    /// Names of the face channels, in a frame's order.
    #[func]
    fn get_channel_names(&self) -> PackedStringArray {
        let count = self.shared.as_ref().map_or(0, |model| model.channels.len());
        self.names(count, |model, index| model.channels[index as usize].clone())
    }

    /// Names of the visemes, in a frame's order.
    #[func]
    fn get_viseme_names(&self) -> PackedStringArray {
        self.names(ffi::VISEME_COUNT, |model, index| model.viseme_name(index))
    }

    #[func]
    fn set_idle(&mut self, idle: i32) {
        if self.set(ffi::PARAMETER_IDLE, f64::from(idle)) {
            self.idle = idle;
        }
    }

    #[func]
    fn set_gain_face(&mut self, gain: f64) {
        if self.set(ffi::PARAMETER_GAIN_FACE, gain) {
            self.gain_face = gain;
        }
    }

    #[func]
    fn set_gain_hands(&mut self, gain: f64) {
        if self.set(ffi::PARAMETER_GAIN_HANDS, gain) {
            self.gain_hands = gain;
        }
    }

    #[func]
    fn set_gain_upper(&mut self, gain: f64) {
        if self.set(ffi::PARAMETER_GAIN_UPPER, gain) {
            self.gain_upper = gain;
        }
    }

    #[func]
    fn set_gain_lower(&mut self, gain: f64) {
        if self.set(ffi::PARAMETER_GAIN_LOWER, gain) {
            self.gain_lower = gain;
        }
    }

    #[func]
    fn set_layer_gaze(&mut self, strength: f64) {
        if self.set(ffi::PARAMETER_LAYER_GAZE, strength) {
            self.layer_gaze = strength;
        }
    }

    #[func]
    fn set_layer_idle(&mut self, strength: f64) {
        if self.set(ffi::PARAMETER_LAYER_IDLE, strength) {
            self.layer_idle = strength;
        }
    }

    #[func]
    fn set_layer_asymmetry(&mut self, strength: f64) {
        if self.set(ffi::PARAMETER_LAYER_ASYMMETRY, strength) {
            self.layer_asymmetry = strength;
        }
    }

    #[func]
    fn set_layer_nods(&mut self, strength: f64) {
        if self.set(ffi::PARAMETER_LAYER_NODS, strength) {
            self.layer_nods = strength;
        }
    }

    #[func]
    fn set_layer_mood(&mut self, strength: f64) {
        if self.set(ffi::PARAMETER_LAYER_MOOD, strength) {
            self.layer_mood = strength;
        }
    }

    #[func]
    fn set_layer_feet(&mut self, strength: f64) {
        if self.set(ffi::PARAMETER_LAYER_FEET, strength) {
            self.layer_feet = strength;
        }
    }

    #[func]
    fn set_layer_body(&mut self, strength: f64) {
        if self.set(ffi::PARAMETER_LAYER_BODY, strength) {
            self.layer_body = strength;
        }
    }

    #[func]
    fn set_expression(&mut self, amount: f64) {
        if self.set(ffi::PARAMETER_EXPRESSION, amount) {
            self.expression = amount;
        }
    }

    #[func]
    fn set_activity(&mut self, amount: f64) {
        if self.set(ffi::PARAMETER_ACTIVITY, amount) {
            self.activity = amount;
        }
    }

    #[func]
    fn set_output_delay(&mut self, seconds: f64) {
        if self.set(ffi::PARAMETER_OUTPUT_DELAY, seconds) {
            self.output_delay = seconds;
        }
    }

    #[func]
    fn set_attention(&mut self, attention: i32) {
        if self.set(ffi::PARAMETER_ATTENTION, f64::from(attention)) {
            self.attention = attention;
        }
    }

    #[func]
    fn set_mood(&mut self, mood: i32) {
        if self.send_mood(mood, self.mood_strength) {
            self.mood = mood;
        }
    }

    #[func]
    fn set_mood_strength(&mut self, strength: f64) {
        if self.send_mood(self.mood, strength) {
            self.mood_strength = strength;
        }
    }

    #[func]
    fn set_prompt(&mut self, prompt: GString) {
        let told = self.tell(|session| session.set_prompt(&prompt.to_string()));
        if told.is_some() || self.session.is_none() {
            self.prompt = prompt;
        }
    }

    #[func]
    fn set_seed(&mut self, seed: i64) {
        self.seed = seed;
        // Only a new session knows the model's default seed.
        if let Ok(seed) = u64::try_from(seed) {
            self.tell(|session| session.set_seed(seed));
        }
    }
}

impl UmoAvatar3D {
    fn load(&mut self) -> Result<(), String> {
        let path = self.model.clone();
        let read = || {
            let bytes = FileAccess::get_file_as_bytes(&path);
            if bytes.is_empty() {
                let error = FileAccess::get_open_error();
                return Err(format!("the model `{path}` cannot be read: {error:?}"));
            }
            Ok(bytes)
        };
        let model = Model::shared(&path.to_string(), &places(), setting, read)?;
        self.own_gestures.iter().try_for_each(|gesture| model.add_gesture(gesture))?;
        self.shared = Some(model);
        self.open_session(None, self.voice == VOICE_LIVE)
    }

    /// Opens a session for this sample rate and channel count, or else for the ones in the properties. The mouth moves
    /// with the sound if `is_live` and the model supports it.
    fn open_session(&mut self, format: Option<(u32, u32)>, is_live: bool) -> Result<(), String> {
        let Some(model) = &self.shared else { return Ok(()) };
        let given = |value: i32| u32::try_from(value).ok().filter(|&value| value > 0);
        let (sample_rate, channels) = match format {
            Some((rate, channels)) => (Some(rate), channels),
            None => (given(self.sample_rate), u32::try_from(self.channels).unwrap_or(0)),
        };
        #[expect(clippy::cast_possible_truncation, reason = "small numbers")]
        let settings = Settings {
            sample_rate,
            channels,
            target: given(self.target),
            lookahead: u32::try_from(self.lookahead).ok(),
            seed: u64::try_from(self.seed).ok(),
            smoothing: (self.smoothing >= 0.0).then_some(self.smoothing as f32),
            guidance: self.guidance as f32,
            horizon: u32::try_from(self.horizon).unwrap_or(0),
            idle: u32::try_from(self.idle).unwrap_or(u32::MAX),
            is_live,
        };
        // Avatars share the model: its rules are set for each, whose session keeps them.
        model.set_word_rules(&self.language.to_string(), &self.word_rules.to_string())?;
        let session = Session::open(model, settings)?;
        let gains = [
            (ffi::PARAMETER_GAIN_FACE, self.gain_face),
            (ffi::PARAMETER_GAIN_HANDS, self.gain_hands),
            (ffi::PARAMETER_GAIN_UPPER, self.gain_upper),
            (ffi::PARAMETER_GAIN_LOWER, self.gain_lower),
            (ffi::PARAMETER_LAYER_GAZE, self.layer_gaze),
            (ffi::PARAMETER_LAYER_IDLE, self.layer_idle),
            (ffi::PARAMETER_LAYER_ASYMMETRY, self.layer_asymmetry),
            (ffi::PARAMETER_LAYER_NODS, self.layer_nods),
            (ffi::PARAMETER_LAYER_MOOD, self.layer_mood),
            (ffi::PARAMETER_LAYER_FEET, self.layer_feet),
            (ffi::PARAMETER_LAYER_BODY, self.layer_body),
            (ffi::PARAMETER_EXPRESSION, self.expression),
            (ffi::PARAMETER_ACTIVITY, self.activity),
            (ffi::PARAMETER_ATTENTION, f64::from(self.attention)),
            (ffi::PARAMETER_OUTPUT_DELAY, self.output_delay),
        ];
        for (parameter, gain) in gains {
            session.set_parameter(parameter, gain)?;
        }
        if self.mood != 0 {
            #[expect(clippy::cast_possible_truncation, reason = "a strength is 0 to 1")]
            session.set_mood(u32::try_from(self.mood).unwrap_or(u32::MAX), self.mood_strength as f32)?;
        }
        if !self.prompt.is_empty() {
            session.set_prompt(&self.prompt.to_string())?;
        }
        self.session = Some(session);
        self.gazes = false;
        self.start_clock();
        Ok(())
    }

    fn start_clock(&mut self) {
        (self.heard, self.time, self.clock, self.shown) = (false, 0.0, 0.0, Shown::default());
    }

    /// Goes on from a state that was restored, by itself or with its scene.
    pub(crate) fn go_on(&mut self) {
        self.session.iter().for_each(Session::forget_pushed);
        self.start_clock();
        self.heard = true;
        if let Some(line) = &mut self.line {
            line.source = Source::Dropped;
        }
    }

    /// Calls the session and reports an error; `None` if there is no session or the call fails.
    fn tell<T>(&self, call: impl FnOnce(&Session) -> Result<T, String>) -> Option<T> {
        match call(self.session.as_ref()?) {
            Ok(value) => Some(value),
            Err(error) => {
                self.complain(&error);
                None
            }
        }
    }

    fn complain(&self, error: &str) {
        godot_error!("umo: {error}");
        // Deferred: the owner of this node may not have connected the signal yet, or may be in a call of it.
        self.to_gd().call_deferred("emit_signal", vslice!["failed", error]);
    }

    /// Reports an error after which the session cannot continue.
    fn fail(&mut self, error: &str) {
        (self.line, self.session) = (None, None);
        self.complain(error);
    }

    /// Whether the session accepts the value of a parameter; without a session every value is accepted until the next
    /// open.
    fn set(&self, parameter: u32, value: f64) -> bool {
        self.session.is_none() || self.tell(|session| session.set_parameter(parameter, value)).is_some()
    }

    /// Passes a hint to the session, at once or when its line begins. False if 64 of its kind are waiting.
    fn hint(&mut self, hint: Hint) -> bool {
        if self.audio_player.is_empty() {
            return self.tell(|session| session.hint(&hint)).unwrap_or(false);
        }
        if self.is_heard() {
            return self.hint_line(hint);
        }
        let kind = discriminant(&hint.said);
        let has_room = self.hints.iter().filter(|other| discriminant(&other.said) == kind).count() < MOST_HINTS;
        if has_room {
            self.hints.push(hint);
        }
        has_room
    }

    fn play(
        &self,
        gesture: &GString,
        at: f64,
        side: i32,
        strength: f64,
        variant: i32,
        target: Option<[f32; 3]>,
    ) -> bool {
        let [side, variant] = [side, variant].map(|number| u32::try_from(number).unwrap_or(u32::MAX));
        #[expect(clippy::cast_possible_truncation, reason = "a strength is 0 to 1")]
        let play = Play { at: (at >= 0.0).then_some(at), side, strength: strength as f32, variant, target };
        self.tell(|session| session.play_gesture(&gesture.to_string(), play)).is_some()
    }

    fn send_mood(&self, mood: i32, strength: f64) -> bool {
        let mood = u32::try_from(mood).unwrap_or(u32::MAX);
        #[expect(clippy::cast_possible_truncation, reason = "a strength is 0 to 1")]
        let strength = strength as f32;
        self.session.is_none() || self.tell(|session| session.set_mood(mood, strength)).is_some()
    }

    /// The avatar's session, if it is open.
    pub(crate) fn session(&self) -> Option<&Session> {
        self.session.as_ref()
    }

    /// The avatar's space in the world: the skeleton's, or the node's if there is no skeleton.
    pub(crate) fn space(&self) -> Transform3D {
        let skeleton = if self.skeleton.is_empty() { None } else { self.base().get_node_or_null(&self.skeleton) };
        let space = skeleton.and_then(|node| node.try_cast::<Node3D>().ok()).unwrap_or_else(|| self.to_gd().upcast());
        space.get_global_transform()
    }

    /// Where the eyes are in the avatar's space, once a skeleton with a head was shown.
    pub(crate) fn eyes(&self) -> Option<Vector3> {
        self.rig.as_ref().and_then(Rig::eyes)
    }

    /// Converts a point from world space to the avatar's space.
    fn to_avatar(&self, point: Vector3) -> [f32; 3] {
        (self.space().affine_inverse() * point).to_array()
    }

    fn names(&self, count: usize, name: impl Fn(&Model, u32) -> String) -> PackedStringArray {
        let Some(model) = &self.shared else { return PackedStringArray::new() };
        (0..).take(count).map(|index| GString::from(&name(model, index))).collect()
    }
}

/// Possible places of umo's library: in the project, next to the game, or on the system's search path.
fn places() -> Vec<PathBuf> {
    let project = ProjectSettings::singleton().globalize_path(&format!("{ADDON}{PLATFORM}/{LIBRARY}")).to_string();
    let game = PathBuf::from(Os::singleton().get_executable_path().to_string());
    let beside = game.parent().map(|folder| folder.join(LIBRARY));
    [Some(project.into()), beside, Some(LIBRARY.into())].into_iter().flatten().collect()
}

/// Reads a number from the project settings, 0 if it is not set.
fn setting(name: &str) -> u32 {
    let settings = ProjectSettings::singleton();
    if !settings.has_setting(name) {
        return 0;
    }
    settings.get_setting(name).try_to::<i64>().ok().and_then(|value| u32::try_from(value).ok()).unwrap_or(0)
}
