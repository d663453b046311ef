//! The node: properties, methods, signals, and the clock from sound to motion.

mod follow;

use std::path::PathBuf;
use std::rc::Rc;

use godot::classes::{FileAccess, INode3D, Node3D, Os, ProjectSettings};
use godot::prelude::*;

use crate::ffi;
use crate::rig::{Face, Rig};
use crate::source::Source;
use crate::umo::{Engine, Model, Session, Settings, Shown};

/// Where a project keeps umo's library, beside this one.
const ADDON: &str = "res://addons/umo/bin/";
#[cfg(target_os = "windows")]
const LIBRARY: &str = "umo.dll";
#[cfg(target_os = "macos")]
const LIBRARY: &str = "libumo.dylib";
#[cfg(not(any(target_os = "windows", target_os = "macos")))]
const LIBRARY: &str = "libumo.so";

const IDLE_REST: i32 = 1;
/// What the player plays, and which time of the motion belongs to it.
struct Line {
    stream: Variant,
    /// Where the player was last, seconds.
    position: f64,
    /// Where the source began.
    start: f64,
    /// The motion's time of that.
    base: f64,
    source: Source,
}

/// A living avatar: moves a skeleton and blend shapes to what an audio player plays.
///
/// Main thread only, as everything of the scene tree.
#[derive(GodotClass)]
#[class(init, base = Node3D)]
pub(crate) struct UmoAvatar3D {
    /// The model, any path that Godot can read.
    #[export(file = "*.safetensors")]
    model: GString,
    /// The player that is heard: an AudioStreamPlayer, 2D or 3D.
    #[export]
    audio_player: NodePath,
    /// The Skeleton3D whose bones are moved: named as umo's joints or as Godot's humanoid profile.
    #[export]
    skeleton: NodePath,
    /// MeshInstance3Ds whose blend shapes are moved: named as ARKit's.
    #[export]
    meshes: Array<NodePath>,
    /// Whether the hips move through the world too.
    #[export]
    #[init(val = true)]
    move_root: bool,
    /// Keyframes predicted per chunk: fewer answer sooner; 0 is the model's own number. From the next open on.
    #[export]
    target: i32,
    /// Frames held back for smoother seams; -1 is the model's own number. From the next open on.
    #[export]
    #[init(val = -1)]
    lookahead: i32,
    /// What is shown while no audio comes.
    #[export(enum = (Hold = 0, Rest = 1, Live = 2))]
    #[var(set = set_idle)]
    #[init(val = IDLE_REST)]
    idle: i32,
    /// How much the face moves: 0 at rest, 1 as computed.
    #[export(range = (0.0, 2.0, 0.01))]
    #[var(set = set_gain_face)]
    #[init(val = 1.0)]
    gain_face: f64,
    /// How much the fingers move.
    #[export(range = (0.0, 2.0, 0.01))]
    #[var(set = set_gain_hands)]
    #[init(val = 1.0)]
    gain_hands: f64,
    /// How much spine, neck, head and arms move.
    #[export(range = (0.0, 2.0, 0.01))]
    #[var(set = set_gain_upper)]
    #[init(val = 1.0)]
    gain_upper: f64,
    /// How much pelvis and legs move.
    #[export(range = (0.0, 2.0, 0.01))]
    #[var(set = set_gain_lower)]
    #[init(val = 1.0)]
    gain_lower: f64,
    /// What the avatar is told, where the model takes texts.
    #[export(multiline)]
    #[var(set = set_prompt)]
    prompt: GString,
    /// The seed of all draws; -1 is the model's own.
    #[export]
    #[var(set = set_seed)]
    #[init(val = -1)]
    seed: i64,
    /// Samples per second of `push_audio`; 0 is the model's own. From the next open on; a player has its own.
    #[export]
    sample_rate: i32,
    /// Interleaved channels of `push_audio`. From the next open on.
    #[export]
    #[init(val = 1)]
    channels: i32,

    shared: Option<Rc<Model>>,
    session: Option<Session>,
    line: Option<Line>,
    /// Whether the session heard anything yet.
    heard: bool,
    /// The time of the motion that was shown last, and what that was.
    time: f64,
    shown: Shown,
    frame: Vec<f32>,
    rig: Option<Rig>,
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
        let told = self.follow(player, delta).and_then(|()| self.show());
        if let Err(error) = told {
            self.fail(&error);
        }
    }

    fn exit_tree(&mut self) {
        // The effect on the player's bus goes; what the player plays when the avatar comes back is a new line.
        self.line = None;
    }
}

#[godot_api]
impl UmoAvatar3D {
    /// The model is loaded, and the avatar takes audio.
    #[signal]
    fn opened();

    /// Something did not work: umo's words, which are in Godot's log too. Where it is not `is_open()` now, the avatar keeps
    /// still until it is opened again.
    #[signal]
    fn failed(message: GString);

    /// Loads the model, or takes the one that another avatar has loaded, and starts anew with the properties as they are.
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

    /// Lets go of session and model.
    #[func]
    fn close(&mut self) {
        (self.line, self.session, self.shared, self.rig) = (None, None, None, None);
        self.faces.clear();
        self.start_clock();
    }

    /// Whether it takes audio.
    #[func]
    fn is_open(&self) -> bool {
        self.session.is_some()
    }

    /// Takes interleaved samples, full scale 1; how many of them there was room for: push the rest later.
    #[func]
    fn push_audio(&mut self, samples: PackedFloat32Array) -> i64 {
        self.heard = true;
        self.tell(|session| session.push(samples.as_slice())).unwrap_or(0) as i64
    }

    /// No more audio is pushed: the last frames come.
    #[func]
    fn finish(&mut self) {
        self.tell(Session::finish);
    }

    /// All frames that are ready, each once: `get_frame_floats()` numbers each, which are the root's translation (3), the
    /// joints' rotations (4 each: x y z w), the channels, and the visemes where the model has them.
    #[func]
    fn pull_frames(&mut self) -> PackedFloat32Array {
        self.tell(Session::pull).map(PackedFloat32Array::from).unwrap_or_default()
    }

    /// Floats of a frame.
    #[func]
    fn get_frame_floats(&self) -> i64 {
        self.shared.as_ref().map_or(0, |model| model.frame_floats() as i64)
    }

    /// The pose at a time of the motion, seconds, as one frame of `pull_frames`.
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

    /// Shows the pose at a time of the motion, seconds, on skeleton and meshes: for a clock of your own, without a player.
    #[func]
    fn drive(&mut self, seconds: f64) {
        if !self.sample_pose(seconds).is_empty() {
            self.apply();
        }
    }

    /// The time of the motion that was shown last, seconds.
    #[func]
    fn get_motion_time(&self) -> f64 {
        self.time
    }

    /// Drops what is not shown yet and eases to rest. What the player plays is not heard until it starts again.
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

    /// Back to the start: as newly opened.
    #[func]
    fn reset(&mut self) {
        self.tell(Session::reset);
        self.line = None;
        self.start_clock();
    }

    /// Whether every frame was shown or pulled after `finish`, or after the end of what the player played.
    #[func]
    fn is_done(&self) -> bool {
        self.tell(Session::is_done).unwrap_or(false)
    }

    /// Everything that the avatar's stream is, for `restore_state`; empty where a chunk of it is just computed: try again
    /// in the next frame.
    #[func]
    fn save_state(&self) -> PackedByteArray {
        self.tell(Session::save).unwrap_or_default()
    }

    /// Goes on as the stream did that was saved, of this avatar or of one with the same properties: the same audio then
    /// gives the same bits. What the player plays is not heard until it starts again.
    #[func]
    fn restore_state(&mut self, state: PackedByteArray) -> bool {
        if self.tell(|session| session.restore(state.as_slice())).is_none() {
            return false;
        }
        self.start_clock();
        self.heard = true;
        if let Some(line) = &mut self.line {
            line.source = Source::Dropped;
        }
        true
    }

    /// How far motion is behind speech: `samples` of future audio that a frame needs, the same in `seconds`, and what
    /// computing adds, seconds: `compute_p50`, `compute_p99`, `compute_p999`, `compute_max`; and by how many seconds frames
    /// are further behind than that, because the engine does not keep up: `backlog` now, `backlog_max` at most.
    #[func]
    fn latency(&mut self) -> VarDictionary {
        let rate = self.session.as_ref().map_or(1, |session| session.sample_rate);
        let Some(latency) = self.tell(Session::latency) else { return VarDictionary::new() };
        vdict! {
            "samples" => latency.algorithmic_samples as i64,
            "seconds" => latency.algorithmic_samples as f64 / f64::from(rate),
            "compute_p50" => latency.compute_p50,
            "compute_p99" => latency.compute_p99,
            "compute_p999" => latency.compute_p999,
            "compute_max" => latency.compute_max,
            "backlog" => latency.backlog_samples as f64 / f64::from(rate),
            "backlog_max" => latency.backlog_max_samples as f64 / f64::from(rate),
        }
    }

    /// What the session went through: `chunks`, `frames`, `late_frames`, `dropped_frames`, `overruns`, `silenced`.
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
        }
    }

    /// What users must be told about the model, empty where there is nothing.
    #[func]
    fn get_notice(&self) -> GString {
        self.shared.as_ref().map(|model| GString::from(&model.notice())).unwrap_or_default()
    }

    /// Names of the joints, in the order of a frame's rotations.
    #[func]
    fn get_joint_names(&self) -> PackedStringArray {
        self.names(ffi::JOINTS, |model, index| model.joint_name(index))
    }

    /// For each joint its parent, -1 for the first.
    #[func]
    fn get_joint_parents(&self) -> PackedInt32Array {
        self.shared.as_ref().map(|model| PackedInt32Array::from(model.parents)).unwrap_or_default()
    }

    /// For each joint its place in its parent's frame at rest, metres.
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
        self.names(ffi::VISEMES, |model, index| model.viseme_name(index))
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
    fn set_prompt(&mut self, prompt: GString) {
        let told = self.tell(|session| session.set_prompt(&prompt.to_string()));
        if told.is_some() || self.session.is_none() {
            self.prompt = prompt;
        }
    }

    #[func]
    fn set_seed(&mut self, seed: i64) {
        self.seed = seed;
        // What the model's own seed is, only a new session knows.
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
        let engine = Engine { threads: setting("umo/threads"), max_sessions: setting("umo/max_avatars") };
        self.shared = Some(Model::shared(&path.to_string(), &places(), engine, read)?);
        self.open_session(None)
    }

    /// A session for samples of that rate and channels, or of those that the properties say.
    fn open_session(&mut self, format: Option<(u32, u32)>) -> Result<(), String> {
        let Some(model) = &self.shared else { return Ok(()) };
        let given = |value: i32| u32::try_from(value).ok().filter(|&value| value > 0);
        let (sample_rate, channels) = match format {
            Some((rate, channels)) => (Some(rate), channels),
            None => (given(self.sample_rate), u32::try_from(self.channels).unwrap_or(0)),
        };
        let settings = Settings {
            sample_rate,
            channels,
            target: given(self.target),
            lookahead: u32::try_from(self.lookahead).ok(),
            seed: u64::try_from(self.seed).ok(),
            idle: u32::try_from(self.idle).unwrap_or(u32::MAX),
        };
        let session = Session::open(model, settings)?;
        let gains = [
            (ffi::PARAMETER_GAIN_FACE, self.gain_face),
            (ffi::PARAMETER_GAIN_HANDS, self.gain_hands),
            (ffi::PARAMETER_GAIN_UPPER, self.gain_upper),
            (ffi::PARAMETER_GAIN_LOWER, self.gain_lower),
        ];
        for (parameter, gain) in gains {
            session.set_parameter(parameter, gain)?;
        }
        if !self.prompt.is_empty() {
            session.set_prompt(&self.prompt.to_string())?;
        }
        self.session = Some(session);
        self.start_clock();
        Ok(())
    }

    fn start_clock(&mut self) {
        (self.heard, self.time, self.shown) = (false, 0.0, Shown::default());
    }

    /// A call on the session, whose error is told; nothing where there is no session or it fails.
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
        // Later: whoever made this node may not have connected the signal yet, or is still in a call of it.
        self.to_gd().call_deferred("emit_signal", vslice!["failed", error]);
    }

    /// It cannot go on.
    fn fail(&mut self, error: &str) {
        (self.line, self.session) = (None, None);
        self.complain(error);
    }

    /// Whether the session takes a parameter's value; without a session any is taken until the next open.
    fn set(&self, parameter: u32, value: f64) -> bool {
        self.session.is_none() || self.tell(|session| session.set_parameter(parameter, value)).is_some()
    }

    fn names(&self, count: usize, name: impl Fn(&Model, u32) -> String) -> PackedStringArray {
        let Some(model) = &self.shared else { return PackedStringArray::new() };
        (0..).take(count).map(|index| GString::from(&name(model, index))).collect()
    }
}

/// Where umo's library may lie: in the project, beside the game, wherever the system looks.
fn places() -> Vec<PathBuf> {
    let project = ProjectSettings::singleton().globalize_path(&format!("{ADDON}{LIBRARY}")).to_string();
    let game = PathBuf::from(Os::singleton().get_executable_path().to_string());
    let beside = game.parent().map(|folder| folder.join(LIBRARY));
    [Some(project.into()), beside, Some(LIBRARY.into())].into_iter().flatten().collect()
}

/// A number among the project's settings, 0 where there is none.
fn setting(name: &str) -> u32 {
    let settings = ProjectSettings::singleton();
    if !settings.has_setting(name) {
        return 0;
    }
    settings.get_setting(name).try_to::<i64>().ok().and_then(|value| u32::try_from(value).ok()).unwrap_or(0)
}
