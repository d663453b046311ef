//! Safe objects over the C interface: a model with its engine, sessions, and scenes.
//!
//! Errors are readable texts: umo's message for the status, and the detail of this error.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::ffi::CString;
use std::path::PathBuf;
use std::ptr::null_mut;
use std::rc::{Rc, Weak};
use std::sync::OnceLock;

use godot::builtin::PackedByteArray;

use crate::ffi::{self, Handle, JOINT_COUNT, Latency, Library, ModelInfo, Stats, Status, VISEME_COUNT};

/// Floats of a translation and of all rotations: where the channels begin in a frame.
pub(crate) const CHANNELS_AT: usize = 3 + 4 * JOINT_COUNT;

/// A loaded model and its engine, shared by all avatars that use the same file.
pub(crate) struct Model {
    library: &'static Library,
    model: Handle,
    engine: Handle,
    pub(crate) info: ModelInfo,
    pub(crate) channels: Vec<String>,
    pub(crate) parents: [i32; JOINT_COUNT],
    /// Where each joint is in its parent's frame at rest, metres.
    pub(crate) offsets: [[f32; 3]; JOINT_COUNT],
}

thread_local! {
    static MODELS: RefCell<HashMap<String, Weak<Model>>> = RefCell::default();
}

fn library(places: &[PathBuf]) -> Result<&'static Library, String> {
    static FOUND: OnceLock<&'static Library> = OnceLock::new();
    if let Some(library) = FOUND.get() {
        return Ok(library);
    }
    let library = Library::find(places)?;
    Ok(FOUND.get_or_init(|| library))
}

fn error_text(library: &Library, status: Status, detail: &str) -> String {
    // SAFETY: takes any status.
    let message = unsafe { (library.status_message)(status) };
    // SAFETY: static texts.
    let message = unsafe { ffi::text(message) };
    if detail.is_empty() || detail == message { message } else { format!("{message}: {detail}") }
}

/// Converts the status of a call that is not on a session.
fn check(library: &Library, status: Status) -> Result<(), String> {
    if status == 0 {
        return Ok(());
    }
    // SAFETY: takes nothing.
    let detail = unsafe { (library.last_error)() };
    // SAFETY: this thread's text, good until its next call.
    let detail = unsafe { ffi::text(detail) };
    Err(error_text(library, status, &detail))
}

/// A skeleton at rest and its mesh, in the skeleton's space: the arrays of `umo_rig`.
#[derive(Default)]
pub(crate) struct RestPose {
    pub(crate) gain: f32,
    pub(crate) parents: Vec<i32>,
    pub(crate) joints: Vec<i32>,
    pub(crate) places: Vec<f32>,
    pub(crate) rotations: Vec<f32>,
    pub(crate) vertices: Vec<f32>,
    pub(crate) vertex_bones: Vec<i32>,
    pub(crate) indices: Vec<u32>,
}

/// A character that the library puts poses on.
pub(crate) struct Character {
    library: &'static Library,
    handle: Handle,
    bones: u32,
}

impl Character {
    pub(crate) fn new(model: &Model, rest: &RestPose) -> Result<Self, String> {
        let library = model.library;
        let count = |length: usize| u32::try_from(length).map_err(|_| format!("{length} are too many"));
        let mut rig = std::mem::MaybeUninit::uninit();
        // SAFETY: `rig` is writable for its size.
        check(library, unsafe { (library.rig_init)(rig.as_mut_ptr(), size_of::<ffi::Rig>()) })?;
        // SAFETY: just initialised.
        let mut rig: ffi::Rig = unsafe { rig.assume_init() };
        rig.gain = rest.gain;
        rig.bone_count = count(rest.parents.len())?;
        rig.vertex_count = count(rest.vertex_bones.len())?;
        rig.index_count = count(rest.indices.len())?;
        rig.parents = rest.parents.as_ptr();
        rig.joints = rest.joints.as_ptr();
        rig.places = rest.places.as_ptr();
        rig.rotations = rest.rotations.as_ptr();
        rig.vertices = rest.vertices.as_ptr();
        rig.vertex_bones = rest.vertex_bones.as_ptr();
        rig.indices = rest.indices.as_ptr();
        let mut made = Self { library, handle: null_mut(), bones: rig.bone_count };
        // SAFETY: the arrays are as long as the counts say, and are read during the call.
        check(library, unsafe { (library.retarget_new)(model.model, &rig, &mut made.handle) })?;
        Ok(made)
    }

    /// Writes the rotation of each bone in its parent, and returns the place of the hips. `seconds`: since the last pose.
    pub(crate) fn apply(
        &mut self,
        seconds: f32,
        rotations: &[f32],
        translation: &[f32],
        into: &mut [f32],
    ) -> Result<[f32; 3], String> {
        assert!(rotations.len() >= 4 * JOINT_COUNT && translation.len() >= 3 && into.len() >= 4 * self.bones as usize);
        let mut place = [0.0; 3];
        let (turns, at, into, hips) = (rotations.as_ptr(), translation.as_ptr(), into.as_mut_ptr(), place.as_mut_ptr());
        // SAFETY: the handle is of a character.
        check(self.library, unsafe { (self.library.retarget_set_step)(self.handle, seconds) })?;
        // SAFETY: all are long enough, which is checked above.
        let status = unsafe { (self.library.retarget_apply)(self.handle, turns, at, self.bones, into, hips) };
        check(self.library, status)?;
        Ok(place)
    }
}

impl Drop for Character {
    fn drop(&mut self) {
        // SAFETY: a handle is used once more; NULL is fine.
        unsafe { (self.library.retarget_free)(self.handle) };
    }
}

impl Model {
    /// Returns the model of that name; `read` loads its bytes if no avatar uses it yet.
    pub(crate) fn shared(
        name: &str,
        places: &[PathBuf],
        setting: impl Fn(&str) -> u32,
        read: impl FnOnce() -> Result<PackedByteArray, String>,
    ) -> Result<Rc<Self>, String> {
        let there = MODELS.with_borrow(|models| models.get(name).and_then(Weak::upgrade));
        if let Some(model) = there {
            return Ok(model);
        }
        let model = Rc::new(Self::load(library(places)?, read()?.as_slice(), setting)?);
        MODELS.with_borrow_mut(|models| {
            models.retain(|_, model| model.strong_count() > 0);
            models.insert(name.into(), Rc::downgrade(&model));
        });
        Ok(model)
    }

    fn load(library: &'static Library, bytes: &[u8], setting: impl Fn(&str) -> u32) -> Result<Self, String> {
        // What is made up to a failure is freed with it.
        let mut model = Self {
            library,
            model: null_mut(),
            engine: null_mut(),
            info: ModelInfo { struct_size: ffi::size::<ModelInfo>(), ..ModelInfo::default() },
            channels: Vec::new(),
            parents: [-1; JOINT_COUNT],
            offsets: [[0.0; 3]; JOINT_COUNT],
        };
        let (data, size, into) = (bytes.as_ptr(), bytes.len(), &mut model.model);
        // SAFETY: `data` has `size` bytes, not needed later; a NULL configuration is allowed.
        let status = unsafe { (library.model_load_memory)(ffi::ABI_VERSION, data, size, std::ptr::null(), into) };
        check(library, status)?;
        // SAFETY: the structure says its own size.
        let status = unsafe { (library.model_get_info)(model.model, &mut model.info) };
        check(library, status)?;
        for index in 0..model.info.channels {
            let mut name = std::ptr::null();
            // SAFETY: `name` is writable.
            let status = unsafe { (library.model_get_channel_name)(model.model, index, &mut name) };
            check(library, status)?;
            // SAFETY: good until the model is freed.
            model.channels.push(unsafe { ffi::text(name) });
        }
        let (parents, offsets) = (model.parents.as_mut_ptr(), model.offsets.as_flattened_mut().as_mut_ptr());
        // SAFETY: both have room for all joints.
        let status =
            unsafe { (library.model_get_skeleton)(model.model, ffi::AXES_GLTF, parents, offsets, JOINT_COUNT) };
        check(library, status)?;

        let mut config = std::mem::MaybeUninit::uninit();
        // SAFETY: `config` is writable for its size.
        let status = unsafe { (library.engine_config_init)(config.as_mut_ptr(), size_of::<ffi::EngineConfig>()) };
        check(library, status)?;
        // SAFETY: just initialised.
        let mut config: ffi::EngineConfig = unsafe { config.assume_init() };
        config.set(setting);
        // SAFETY: no cores, jobs or log are given.
        let status = unsafe { (library.engine_new)(model.model, &config, &mut model.engine) };
        check(library, status)?;
        Ok(model)
    }

    /// Notice that users of the model must be shown; may be empty.
    pub(crate) fn notice(&self) -> String {
        let mut text = std::ptr::null();
        // SAFETY: `text` is writable.
        let status = unsafe { (self.library.model_get_text)(self.model, ffi::MODEL_NOTICE, &mut text) };
        if status != 0 {
            return String::new();
        }
        // SAFETY: good until the model is freed.
        unsafe { ffi::text(text) }
    }

    /// Whether sessions may be live.
    pub(crate) fn has_mouth(&self) -> bool {
        self.info.has_mouth == 1
    }

    /// Names of the gestures available to its sessions.
    pub(crate) fn gesture_names(&self) -> Vec<String> {
        let mut names = Vec::new();
        for index in 0.. {
            let mut name = std::ptr::null();
            // SAFETY: `name` is writable.
            let status = unsafe { (self.library.engine_get_gesture_name)(self.engine, index, &mut name) };
            if status != 0 {
                break;
            }
            // SAFETY: good until the engine is freed.
            names.push(unsafe { ffi::text(name) });
        }
        names
    }

    /// Adds a gesture for sessions opened later: the animation with that name in a `.glb` or `.vrm` file, or its first.
    pub(crate) fn add_gesture(&self, gesture: &FileGesture) -> Result<(), String> {
        let text =
            |text: &str| CString::new(text).map_err(|_| "a gesture's name must not contain zero bytes".to_owned());
        let (name, clip) = (text(&gesture.name)?, gesture.animation.as_deref().map(text).transpose()?);
        let clip = clip.as_ref().map_or(std::ptr::null(), |clip| clip.as_ptr());
        let (data, size) = (gesture.bytes.as_ptr(), gesture.bytes.len());
        let add = self.library.engine_add_gesture_memory;
        // SAFETY: both texts end with a zero byte, or the second is NULL; `data` has `size` bytes.
        let status = unsafe { add(self.engine, name.as_ptr(), data, size, clip, gesture.parts, gesture.stroke) };
        check(self.library, status)
    }

    /// Sets the rules of words for sessions opened later: those of a language, and to them those of a file's text.
    pub(crate) fn set_word_rules(&self, language: &str, toml: &str) -> Result<(), String> {
        let text = |text: &str| CString::new(text).map_err(|_| "word rules must not contain zero bytes".to_owned());
        let (language, toml) = (text(language)?, text(toml)?);
        let set = self.library.engine_set_word_rules;
        // SAFETY: both texts end with a zero byte.
        let status = unsafe { set(self.engine, language.as_ptr(), toml.as_ptr()) };
        check(self.library, status)
    }

    /// Default settings of its sessions.
    fn session_config(&self) -> Result<ffi::SessionConfig, String> {
        let (init, size) = (self.library.session_config_init, size_of::<ffi::SessionConfig>());
        let mut config = std::mem::MaybeUninit::uninit();
        // SAFETY: `config` is writable for its size.
        let status = unsafe { init(config.as_mut_ptr(), size, self.model) };
        check(self.library, status)?;
        // SAFETY: just initialised.
        Ok(unsafe { config.assume_init() })
    }

    pub(crate) fn joint_name(&self, joint: u32) -> String {
        // SAFETY: takes any index.
        let name = unsafe { (self.library.joint_name)(joint) };
        // SAFETY: static, or NULL.
        unsafe { ffi::text(name) }
    }

    pub(crate) fn viseme_name(&self, viseme: u32) -> String {
        // SAFETY: takes any index.
        let name = unsafe { (self.library.viseme_name)(viseme) };
        // SAFETY: static, or NULL.
        unsafe { ffi::text(name) }
    }

    /// Number of floats in a frame: translation, rotations, channels, and visemes if the model has ARKit's channels.
    pub(crate) fn frame_floats(&self) -> usize {
        CHANNELS_AT + self.channels.len() + if self.info.is_arkit == 1 { VISEME_COUNT } else { 0 }
    }

    /// Layout of a frame, after `head` bytes that are left untouched.
    #[expect(clippy::cast_possible_truncation, reason = "a frame has a few thousand bytes")]
    fn layout(&self, head: usize) -> ffi::FrameLayout {
        let channels = head + 4 * CHANNELS_AT;
        let visemes = channels + 4 * self.channels.len();
        ffi::FrameLayout {
            struct_size: ffi::size::<ffi::FrameLayout>(),
            axes: ffi::AXES_GLTF,
            frame_stride: (head + 4 * self.frame_floats()) as u32,
            index: ffi::ABSENT,
            sample: ffi::ABSENT,
            translation: head as u32,
            rotations: (head + 12) as u32,
            rotation_stride: 16,
            channels: channels as u32,
            channel_stride: 4,
            visemes: if self.info.is_arkit == 1 { visemes as u32 } else { ffi::ABSENT },
            reserved: 0,
        }
    }
}

impl Drop for Model {
    fn drop(&mut self) {
        // SAFETY: NULL is fine; sessions keep their `Rc` of this, so none is left, and no other
        // thread is in a call.
        unsafe { (self.library.engine_free)(self.engine) };
        // SAFETY: as above.
        unsafe { (self.library.model_free)(self.model) };
    }
}

/// Settings of a session. `None` is the model's default.
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct Settings {
    pub(crate) sample_rate: Option<u32>,
    pub(crate) channels: u32,
    pub(crate) target: Option<u32>,
    pub(crate) lookahead: Option<u32>,
    pub(crate) seed: Option<u64>,
    /// Standard deviation of the body's low-pass filter, in frames.
    pub(crate) smoothing: Option<f32>,
    /// Guidance strength of the prompt.
    pub(crate) guidance: f32,
    /// Keyframes of future sound to use.
    pub(crate) horizon: u32,
    pub(crate) idle: u32,
    /// Whether the mouth moves with the sound, if the model has a mouth network.
    pub(crate) is_live: bool,
}

/// A gesture from a file.
pub(crate) struct FileGesture {
    pub(crate) name: String,
    pub(crate) bytes: Vec<u8>,
    pub(crate) animation: Option<String>,
    pub(crate) parts: u32,
    /// Seconds from its start to the stroke; negative for its middle.
    pub(crate) stroke: f32,
}

/// What is said at a time.
pub(crate) enum Said {
    /// A visible lip shape: 0 closed, 1 teeth, 2 round.
    Lips(u32),
    Words(CString),
}

/// What is said at a time, in seconds.
pub(crate) struct Hint {
    pub(crate) said: Said,
    pub(crate) start: f64,
    pub(crate) duration: f64,
}

impl Hint {
    /// The same, delayed by `seconds`.
    pub(crate) fn after(self, seconds: f64) -> Self {
        Self { start: self.start + seconds, ..self }
    }
}

/// Options of a gesture.
#[derive(Clone, Copy)]
pub(crate) struct Play {
    pub(crate) at: Option<f64>,
    pub(crate) side: u32,
    pub(crate) strength: f32,
    pub(crate) variant: u32,
    /// In the avatar's space, in metres.
    pub(crate) target: Option<[f32; 3]>,
}

/// Result of `Session::sample`.
#[derive(Clone, Copy, Default)]
pub(crate) struct Shown {
    pub(crate) index: u64,
    pub(crate) newest: f64,
}

/// One avatar's stream.
pub(crate) struct Session {
    pub(crate) model: Rc<Model>,
    session: Handle,
    /// Settings after defaults were filled in.
    pub(crate) sample_rate: u32,
    pub(crate) channels: u32,
    pub(crate) is_live: bool,
    /// Whether it plays a take.
    pub(crate) is_take: bool,
    /// Seconds after the newest frame at which the rest pose is reached, in the idle mode that returns to rest.
    pub(crate) rest_seconds: f64,
    /// Samples per channel accepted since the session began or was reset; `None` after a state was restored, which does
    /// not contain this number.
    pushed: Cell<Option<u64>>,
}

impl Session {
    pub(crate) fn open(model: &Rc<Model>, settings: Settings) -> Result<Self, String> {
        let library = model.library;
        let mut config = model.session_config()?;
        config.sample_rate = settings.sample_rate.unwrap_or(config.sample_rate);
        config.channels = settings.channels;
        config.target = settings.target.unwrap_or(config.target);
        config.lookahead = settings.lookahead.unwrap_or(config.lookahead);
        config.seed = settings.seed.unwrap_or(config.seed);
        config.smoothing = settings.smoothing.unwrap_or(config.smoothing);
        (config.guidance, config.horizon) = (settings.guidance, settings.horizon);
        config.idle = settings.idle;
        let is_live = settings.is_live && model.has_mouth();
        config.voice = if is_live { ffi::VOICE_LIVE } else { ffi::VOICE_DELAYED };
        let mut session = null_mut();
        // SAFETY: no template name or allocator is given.
        let status = unsafe { (library.session_new)(model.engine, &config, &mut session) };
        check(library, status)?;
        Ok(Self::of(model, session, &config, (is_live, false)))
    }

    /// A session that plays a take.
    pub(crate) fn of_take(model: &Rc<Model>, take: &[u8], idle: u32) -> Result<Self, String> {
        let library = model.library;
        let mut config = model.session_config()?;
        config.idle = idle;
        let (mut read, mut session) = (null_mut(), null_mut());
        // SAFETY: `take` has its length, `read` is writable.
        let status = unsafe { (library.take_new)(take.as_ptr(), take.len(), &mut read) };
        check(library, status)?;
        // SAFETY: no template name or allocator is given, `session` is writable.
        let status = unsafe { (library.decoder_new_of_take)(model.model, read, &config, &mut session) };
        let made = check(library, status);
        // SAFETY: just made; the session has what it needs of it.
        unsafe { (library.take_free)(read) };
        made?;
        Ok(Self::of(model, session, &config, (false, true)))
    }

    fn of(model: &Rc<Model>, session: Handle, config: &ffi::SessionConfig, (is_live, is_take): (bool, bool)) -> Self {
        let rest_seconds = f64::from(config.idle_after_ms + config.ease_ms) / 1000.0;
        let (sample_rate, channels, pushed) = (config.sample_rate, config.channels, Cell::new(Some(0)));
        let model = Rc::clone(model);
        Self { model, session, sample_rate, channels, is_live, is_take, rest_seconds, pushed }
    }

    /// Keeps two seconds of a take's frames ready, if it plays one.
    fn push_take(&self) -> Result<(), String> {
        const AHEAD: usize = 60;
        let mut more = u32::from(self.is_take);
        // A packet has a frame or more, except the first ones.
        for _ in 0..AHEAD {
            if more == 0 || self.ready()? >= AHEAD {
                break;
            }
            // SAFETY: `more` is writable.
            let status = unsafe { (self.model.library.decoder_push_take)(self.session, &mut more) };
            self.check(status)?;
        }
        Ok(())
    }

    /// Number of frames that are ready.
    fn ready(&self) -> Result<usize, String> {
        let mut ready = 0;
        // SAFETY: `ready` is writable.
        let status = unsafe { (self.model.library.session_ready_frames)(self.session, &mut ready) };
        self.check(status).map(|()| ready)
    }

    /// Number of the session in this process, never used again.
    pub(crate) fn id(&self) -> usize {
        self.session.addr()
    }

    fn check(&self, status: Status) -> Result<(), String> {
        if status == 0 {
            return Ok(());
        }
        let library = self.model.library;
        let mut buffer = [0; ffi::ERROR_SIZE];
        // SAFETY: the buffer has its size.
        let told = unsafe { (library.session_last_error)(self.session, buffer.as_mut_ptr(), buffer.len(), null_mut()) };
        // SAFETY: zeros, or what the library ended with a zero byte.
        let detail = if told == 0 { unsafe { ffi::text(buffer.as_ptr()) } } else { String::new() };
        Err(error_text(library, status, &detail))
    }

    /// Feeds interleaved samples. Returns the number accepted.
    pub(crate) fn push(&self, samples: &[f32]) -> Result<usize, String> {
        let mut taken = 0;
        let push = self.model.library.session_push_audio;
        // SAFETY: `samples` has its length.
        let status = unsafe { push(self.session, samples.as_ptr(), samples.len(), &mut taken) };
        self.took(taken);
        self.check(status).map(|()| taken)
    }

    /// Feeds interleaved 16-bit samples. Returns the number accepted.
    pub(crate) fn push_i16(&self, samples: &[i16]) -> Result<usize, String> {
        let mut taken = 0;
        let push = self.model.library.session_push_audio_i16;
        // SAFETY: `samples` has its length.
        let status = unsafe { push(self.session, samples.as_ptr(), samples.len(), &mut taken) };
        self.took(taken);
        self.check(status).map(|()| taken)
    }

    fn took(&self, samples: usize) {
        self.pushed.set(self.pushed.get().map(|before| before + samples as u64 / u64::from(self.channels)));
    }

    /// Seconds of accepted audio, the time base of hints; `None` if unknown.
    pub(crate) fn pushed_seconds(&self) -> Option<f64> {
        self.pushed.get().map(|samples| samples as f64 / f64::from(self.sample_rate))
    }

    /// Says what is said at a time of the accepted audio. False if 64 of its kind are waiting.
    pub(crate) fn hint(&self, hint: &Hint) -> Result<bool, String> {
        let (library, start, duration) = (self.model.library, hint.start, hint.duration);
        let status = match &hint.said {
            // SAFETY: takes no pointers but the handle.
            Said::Lips(shape) => unsafe { (library.session_hint_lips)(self.session, *shape, start, duration) },
            // SAFETY: the text ends with a zero byte.
            Said::Words(text) => unsafe {
                (library.session_hint_words)(self.session, text.as_ptr(), start, start + duration)
            },
        };
        if status == ffi::STATUS_BUSY {
            return Ok(false);
        }
        self.check(status).map(|()| true)
    }

    /// Feeds interleaved samples of the interlocutor.
    pub(crate) fn push_other(&self, samples: &[f32]) -> Result<(), String> {
        let push = self.model.library.session_push_other_audio;
        // SAFETY: `samples` has its length.
        let status = unsafe { push(self.session, samples.as_ptr(), samples.len()) };
        self.check(status)
    }

    /// Looks at a point in the avatar's space, in metres.
    pub(crate) fn look_at(&self, point: [f32; 3], strength: f32) -> Result<(), String> {
        let look_at = self.model.library.session_look_at;
        // SAFETY: `point` has three values.
        let status = unsafe { look_at(self.session, ffi::AXES_GLTF, point.as_ptr(), strength) };
        self.check(status)
    }

    /// Plays a gesture; `at` is the time of its stroke in seconds, `None` for as soon as possible.
    pub(crate) fn play_gesture(&self, name: &str, play: Play) -> Result<(), String> {
        let library = self.model.library;
        let name = CString::new(name).map_err(|_| "a gesture's name must not contain zero bytes".to_owned())?;
        let mut options = std::mem::MaybeUninit::uninit();
        let size = size_of::<ffi::GestureOptions>();
        // SAFETY: `options` is writable for its size.
        let status = unsafe { (library.gesture_options_init)(options.as_mut_ptr(), size) };
        check(library, status)?;
        // SAFETY: just initialised.
        let mut options: ffi::GestureOptions = unsafe { options.assume_init() };
        options.at = play.at.unwrap_or(options.at);
        options.side = play.side;
        options.strength = play.strength;
        options.variant = play.variant;
        if let Some(target) = play.target {
            (options.axes, options.has_target, options.target) = (ffi::AXES_GLTF, 1, target);
        }
        // SAFETY: the name ends with a zero byte, the options say their own size.
        let status = unsafe { (library.session_play_gesture)(self.session, name.as_ptr(), &options) };
        self.check(status)
    }

    pub(crate) fn set_mood(&self, mood: u32, strength: f32) -> Result<(), String> {
        // SAFETY: takes no pointers but the handle.
        let status = unsafe { (self.model.library.session_set_mood)(self.session, mood, strength) };
        self.check(status)
    }

    pub(crate) fn finish(&self) -> Result<(), String> {
        // SAFETY: takes no pointers but the handle.
        let status = unsafe { (self.model.library.session_finish)(self.session) };
        self.check(status)
    }

    pub(crate) fn interrupt(&self, ease_ms: u32) -> Result<(), String> {
        // SAFETY: takes no pointers but the handle.
        let status = unsafe { (self.model.library.session_interrupt)(self.session, ease_ms) };
        self.check(status)
    }

    pub(crate) fn reset(&self) -> Result<(), String> {
        // SAFETY: takes no pointers but the handle.
        let status = unsafe { (self.model.library.session_reset)(self.session) };
        self.pushed.set(Some(0));
        self.check(status)
    }

    /// Returns all frames that are ready, concatenated.
    pub(crate) fn pull(&self) -> Result<Vec<f32>, String> {
        self.push_take()?;
        let (library, width) = (self.model.library, self.model.frame_floats());
        // At least one: a pull that finds none requests motion on silence, and reports an error of the session.
        let mut frames = vec![0.0; self.ready()?.max(1) * width];
        let (layout, size, mut count) = (self.model.layout(0), 4 * frames.len(), 0);
        let pull = library.session_pull_frames;
        // SAFETY: `frames` has `size` bytes.
        let status = unsafe { pull(self.session, &layout, frames.as_mut_ptr(), size, &mut count) };
        self.check(status)?;
        frames.truncate(count * width);
        Ok(frames)
    }

    /// Arousal of the voice at the newest frame pulled or sampled, and its change per second.
    pub(crate) fn arousal(&self) -> Result<[f32; 2], String> {
        let [mut arousal, mut trend] = [0.0; 2];
        // SAFETY: both are writable.
        let status = unsafe { (self.model.library.session_arousal)(self.session, &mut arousal, &mut trend) };
        self.check(status)?;
        Ok([arousal, trend])
    }

    /// Writes the pose at a time into `frame`.
    pub(crate) fn sample(&self, seconds: f64, frame: &mut Vec<f32>) -> Result<Shown, String> {
        /// Floats before a frame's values, for its index.
        const HEAD: usize = 2;
        self.push_take()?;
        frame.resize(HEAD + self.model.frame_floats(), 0.0);
        let layout = self.model.layout(4 * HEAD);
        // With an index, frames must be aligned like it, even a single one.
        let layout = ffi::FrameLayout { index: 0, frame_stride: layout.frame_stride.next_multiple_of(8), ..layout };
        let size = ffi::size::<ffi::Sampled>();
        let mut sampled = ffi::Sampled { struct_size: size, ..ffi::Sampled::default() };
        let sample = self.model.library.session_sample_pose;
        let (into, bytes) = (frame.as_mut_ptr(), 4 * frame.len());
        // SAFETY: `frame` has `bytes` bytes, and its start needs no alignment.
        let status = unsafe { sample(self.session, seconds, &layout, into, bytes, &mut sampled) };
        self.check(status)?;
        let mut index = [0; 8];
        for (bytes, float) in index.chunks_exact_mut(4).zip(frame.drain(..HEAD)) {
            bytes.copy_from_slice(&float.to_ne_bytes());
        }
        let index = u64::from_ne_bytes(index);
        Ok(Shown { index, newest: sampled.newest })
    }

    /// Whether all frames of a finished stream were handed out; an error if the rest will never come.
    pub(crate) fn is_done(&self) -> Result<bool, String> {
        let mut done = 0;
        // SAFETY: `done` is writable.
        let status = unsafe { (self.model.library.session_is_done)(self.session, &mut done) };
        self.check(status).map(|()| done == 1)
    }

    /// The session's complete state.
    pub(crate) fn save(&self) -> Result<PackedByteArray, String> {
        let library = self.model.library;
        let mut size = 0;
        // SAFETY: `size` is writable.
        let status = unsafe { (library.session_state_size)(self.session, &mut size) };
        self.check(status)?;
        let mut state = PackedByteArray::new();
        state.resize(size);
        // SAFETY: `state` has `size` bytes.
        let status =
            unsafe { (library.session_save)(self.session, state.as_mut_slice().as_mut_ptr(), size, &mut size) };
        self.check(status)?;
        state.resize(size);
        Ok(state)
    }

    /// Restores a saved state.
    pub(crate) fn restore(&self, state: &[u8]) -> Result<(), String> {
        // SAFETY: `state` has its length.
        let status = unsafe { (self.model.library.session_restore)(self.session, state.as_ptr(), state.len()) };
        self.forget_pushed();
        self.check(status)
    }

    /// Its state was restored, which does not contain what was pushed.
    pub(crate) fn forget_pushed(&self) {
        self.pushed.set(None);
    }

    pub(crate) fn set_prompt(&self, text: &str) -> Result<(), String> {
        // SAFETY: `text` has its length.
        let status = unsafe { (self.model.library.session_set_prompt)(self.session, text.as_ptr(), text.len()) };
        self.check(status)
    }

    /// Sets the game's time in seconds.
    pub(crate) fn set_clock(&self, seconds: f64) -> Result<(), String> {
        // SAFETY: takes any number.
        let status = unsafe { (self.model.library.session_set_clock)(self.session, seconds) };
        self.check(status)
    }

    pub(crate) fn set_seed(&self, seed: u64) -> Result<(), String> {
        // SAFETY: takes no pointers but the handle.
        let status = unsafe { (self.model.library.session_set_seed)(self.session, seed) };
        self.check(status)
    }

    pub(crate) fn set_parameter(&self, parameter: u32, value: f64) -> Result<(), String> {
        // SAFETY: takes no pointers but the handle.
        let status = unsafe { (self.model.library.session_set_parameter)(self.session, parameter, value) };
        self.check(status)
    }

    pub(crate) fn latency(&self) -> Result<Latency, String> {
        let mut latency = Latency { struct_size: ffi::size::<Latency>(), ..Latency::default() };
        // SAFETY: the structure says its own size.
        let status = unsafe { (self.model.library.session_latency)(self.session, &mut latency) };
        self.check(status).map(|()| latency)
    }

    pub(crate) fn stats(&self) -> Result<Stats, String> {
        let mut stats = Stats { struct_size: ffi::size::<Stats>(), ..Stats::default() };
        // SAFETY: the structure says its own size.
        let status = unsafe { (self.model.library.session_stats)(self.session, &mut stats) };
        self.check(status).map(|()| stats)
    }
}

/// Where a member of a scene stands: glTF's axes, which are Godot's.
pub(crate) struct Standing {
    /// On the floor.
    pub(crate) position: [f32; 3],
    /// 0 is +Z, positive to its left, radians.
    pub(crate) facing: f32,
    pub(crate) eye_height: f32,
}

impl Standing {
    fn place(&self) -> ffi::Place {
        ffi::Place {
            struct_size: ffi::size::<ffi::Place>(),
            axes: ffi::AXES_GLTF,
            position: self.position,
            facing: self.facing,
            eye_height: self.eye_height,
        }
    }
}

/// Target of a member's looks.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Target {
    Free,
    Member(u32),
    Point([f32; 3]),
}

/// Avatars that know each other, and people with microphones.
pub(crate) struct Scene {
    library: &'static Library,
    scene: Handle,
}

impl Scene {
    /// Makes a scene with the library that computes `session`.
    pub(crate) fn new(session: &Session, seed: u64) -> Result<Self, String> {
        let library = session.model.library;
        let mut scene = null_mut();
        // SAFETY: `scene` is writable.
        let status = unsafe { (library.scene_new)(seed, &mut scene) };
        check(library, status)?;
        Ok(Self { library, scene })
    }

    fn check(&self, status: Status) -> Result<(), String> {
        if status == 0 {
            return Ok(());
        }
        let mut buffer = [0; ffi::ERROR_SIZE];
        let last_error = self.library.scene_last_error;
        // SAFETY: the buffer has its size.
        let told = unsafe { last_error(self.scene, buffer.as_mut_ptr(), buffer.len(), null_mut()) };
        // SAFETY: zeros, or what the library ended with a zero byte.
        let detail = if told == 0 { unsafe { ffi::text(buffer.as_ptr()) } } else { String::new() };
        Err(error_text(self.library, status, &detail))
    }

    /// Adds an avatar, or without a session a person. Returns the member's number.
    pub(crate) fn add(&self, session: Option<&Session>, standing: &Standing) -> Result<u32, String> {
        let mut member = 0;
        let session = session.map_or(null_mut(), |session| session.session);
        // SAFETY: the place says its own size, `member` is writable.
        let status = unsafe { (self.library.scene_add)(self.scene, session, &standing.place(), &mut member) };
        self.check(status).map(|()| member)
    }

    /// The state of the scene and of its members' sessions.
    pub(crate) fn save(&self) -> Result<PackedByteArray, String> {
        let mut size = 0;
        // SAFETY: `size` is writable.
        let status = unsafe { (self.library.scene_state_size)(self.scene, &mut size) };
        self.check(status)?;
        let mut state = PackedByteArray::new();
        state.resize(size);
        // SAFETY: `state` has `size` bytes.
        let status =
            unsafe { (self.library.scene_save)(self.scene, state.as_mut_slice().as_mut_ptr(), size, &mut size) };
        self.check(status)?;
        state.resize(size);
        Ok(state)
    }

    /// Restores a saved state.
    pub(crate) fn restore(&self, state: &[u8]) -> Result<(), String> {
        // SAFETY: `state` has its length.
        let status = unsafe { (self.library.scene_restore)(self.scene, state.as_ptr(), state.len()) };
        self.check(status)
    }

    /// Removes a member, unless it has left with its session.
    pub(crate) fn remove(&self, member: u32) {
        // SAFETY: takes no pointers but the handle.
        unsafe { (self.library.scene_remove)(self.scene, member) };
    }

    pub(crate) fn set_place(&self, member: u32, standing: &Standing) -> Result<(), String> {
        // SAFETY: the place says its own size.
        let status = unsafe { (self.library.scene_set_place)(self.scene, member, &standing.place()) };
        self.check(status)
    }

    pub(crate) fn set_target(&self, member: u32, target: Target) -> Result<(), String> {
        let (other, point) = match &target {
            Target::Free => (0, std::ptr::null()),
            Target::Member(other) => (*other, std::ptr::null()),
            Target::Point(point) => (0, point.as_ptr()),
        };
        // SAFETY: the point is NULL or has three values.
        let status = unsafe { (self.library.scene_set_target)(self.scene, member, other, ffi::AXES_GLTF, point) };
        self.check(status)
    }

    /// Sets the parts that the scene plays of a member.
    pub(crate) fn set_allowed(&self, member: u32, parts: u32) -> Result<(), String> {
        // SAFETY: takes no pointers but the handle.
        let status = unsafe { (self.library.scene_set_allowed)(self.scene, member, parts) };
        self.check(status)
    }

    /// Feeds a person's voice.
    pub(crate) fn push(&self, member: u32, samples: &[f32]) -> Result<(), String> {
        let push = self.library.scene_push_audio;
        // SAFETY: `samples` has its length.
        let status = unsafe { push(self.scene, member, samples.as_ptr(), samples.len()) };
        self.check(status)
    }

    pub(crate) fn update(&self, seconds: f64) -> Result<(), String> {
        // SAFETY: takes any number.
        let status = unsafe { (self.library.scene_update)(self.scene, seconds) };
        self.check(status)
    }

    /// The member that has the floor; 0 for nobody.
    pub(crate) fn floor(&self) -> Result<u32, String> {
        let mut member = 0;
        // SAFETY: `member` is writable.
        let status = unsafe { (self.library.scene_floor)(self.scene, &mut member) };
        self.check(status).map(|()| member)
    }

    pub(crate) fn member(&self, member: u32) -> Result<ffi::Member, String> {
        let mut info = ffi::Member { struct_size: ffi::size::<ffi::Member>(), ..ffi::Member::default() };
        // SAFETY: the structure says its own size.
        let status = unsafe { (self.library.scene_member)(self.scene, member, &mut info) };
        self.check(status).map(|()| info)
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: made by `scene_new`, and no other thread is in a call on it.
        unsafe { (self.library.scene_free)(self.scene) };
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        // SAFETY: made by `session_new`, and no other thread is in a call on it.
        unsafe { (self.model.library.session_free)(self.session) };
    }
}
