//! Constants and structures of `umo.h`. Generated from umo-capi/src by umo-capi/header: change it there.
#![allow(dead_code, reason = "all of the interface, whether it is used here or not")]

use std::ffi::{c_char, c_void};

/// Version of this interface: major number in the upper 16 bits, minor number in the lower. A library
/// serves programs with the same major number and at most its own minor number.
pub(crate) const ABI_VERSION: u32 = 1;
/// glTF and Godot: Y up, right-handed, metres; the avatar looks along +Z, its left hand is towards +X.
pub(crate) const AXES_GLTF: u32 = 0;
/// Unreal: Z up, left-handed, centimetres; the avatar looks along +X, its right hand is towards +Y.
pub(crate) const AXES_UNREAL: u32 = 1;
/// Unity: Y up, left-handed, metres; the avatar looks along +Z, its right hand is towards +X.
pub(crate) const AXES_UNITY: u32 = 2;
/// The engine computes on its own threads.
pub(crate) const ENGINE_THREADS: u32 = 0;
/// The host computes by calling `umo_engine_poll`.
pub(crate) const ENGINE_POLLED: u32 = 1;
/// Default priority of the process's new threads.
pub(crate) const PRIORITY_NORMAL: u32 = 0;
/// Priority above normal: frames are nearly as fast beside a program that keeps every core busy. Linux
/// refuses it to most users; Windows, Android and Apple's systems grant it.
pub(crate) const PRIORITY_HIGH: u32 = 1;
/// Priority below normal: threads use the time that others leave.
pub(crate) const PRIORITY_LOW: u32 = 2;
/// On a machine with fast and slow cores: a crowd on the kind whose cores are the fastest together;
/// what one slower core computes with room to spare, on that core, unless the priority is high.
pub(crate) const CORES_AUTO: u32 = 0;
/// Threads run wherever the system puts them.
pub(crate) const CORES_SYSTEM: u32 = 1;
/// The fastest kind of cores alone.
pub(crate) const CORES_PERFORMANCE: u32 = 2;
/// The slowest kind of cores that is not low-power, alone.
pub(crate) const CORES_EFFICIENCY: u32 = 3;
/// Offset meaning: do not write this field.
pub(crate) const ABSENT: u32 = 4294967295;
/// The right hand; for a gesture with a target, the hand nearer to it.
pub(crate) const SIDE_AUTO: u32 = 0;
/// The left hand: the whole gesture is mirrored.
pub(crate) const SIDE_LEFT: u32 = 1;
/// The right hand.
pub(crate) const SIDE_RIGHT: u32 = 2;
/// Both hands if the gesture supports it, otherwise as `SIDE_AUTO`.
pub(crate) const SIDE_BOTH: u32 = 3;
/// Neck and head.
pub(crate) const GESTURE_HEAD: u32 = 1;
/// Spine.
pub(crate) const GESTURE_TRUNK: u32 = 2;
/// Left arm, from collar to fingers.
pub(crate) const GESTURE_LEFT_ARM: u32 = 4;
/// Right arm, from collar to fingers.
pub(crate) const GESTURE_RIGHT_ARM: u32 = 8;
/// Log level: information.
pub(crate) const LOG_INFO: u32 = 1;
/// Log level: warning.
pub(crate) const LOG_WARNING: u32 = 2;
/// Log level: error.
pub(crate) const LOG_ERROR: u32 = 3;
/// Weights as stored in the file.
pub(crate) const PRECISION_STORED: u32 = 0;
/// All products in f32.
pub(crate) const PRECISION_F32: u32 = 1;
/// Weights rounded to bfloat16.
pub(crate) const PRECISION_BF16: u32 = 2;
/// Weights rounded to int8.
pub(crate) const PRECISION_INT8: u32 = 3;
/// All networks of the model.
pub(crate) const PARTS_ALL: u32 = 0;
/// The live mouth alone, at its stored precision: a fraction of the memory. Sessions need
/// `VOICE_MOUTH`, and engines have no threads.
pub(crate) const PARTS_MOUTH: u32 = 1;
/// The fastest instruction set of the processor.
pub(crate) const ISA_BEST: u32 = 0;
/// Portable code.
pub(crate) const ISA_SCALAR: u32 = 1;
/// At most AVX2.
pub(crate) const ISA_AVX2: u32 = 2;
/// At most AVX-512 with VNNI.
pub(crate) const ISA_AVX512VNNI: u32 = 3;
/// At most AMX.
pub(crate) const ISA_AMX: u32 = 4;
/// At most AVX-512 with VNNI and products of bfloat16.
pub(crate) const ISA_AVX512BF16: u32 = 5;
/// At most AVX2 with VNNI.
pub(crate) const ISA_AVXVNNI: u32 = 6;
/// At most NEON, on 64-bit Arm.
pub(crate) const ISA_NEON: u32 = 7;
/// At most NEON with dot products of int8.
pub(crate) const ISA_NEON_DOTPROD: u32 = 8;
/// At most NEON with dot products and matrix products of int8.
pub(crate) const ISA_NEON_I8MM: u32 = 9;
/// Added to one of the others: the same bits on every processor, from the same sound. docs/packets.md
/// says when it pays.
pub(crate) const ISA_PORTABLE: u32 = 256;
/// Name of the model.
pub(crate) const MODEL_NAME: u32 = 1;
/// Licence of its weights.
pub(crate) const MODEL_LICENSE: u32 = 2;
/// Notice that must be shown to users; may be empty.
pub(crate) const MODEL_NOTICE: u32 = 3;
/// Instruction set that the model was packed for, such as `avx512vnni`.
pub(crate) const MODEL_ISA: u32 = 4;
/// Prompts that the model was trained with, one a line; empty if it has no list.
pub(crate) const MODEL_PROMPTS: u32 = 5;
/// Visemes per frame.
pub(crate) const VISEME_COUNT: usize = 15;
/// Joints of every model.
pub(crate) const JOINT_COUNT: usize = 55;
/// Sampling temperature: 0 always takes the likeliest code; the model's default is the value it was
/// tuned for.
pub(crate) const PARAMETER_TEMPERATURE: u32 = 1;
/// Top-k sampling: number of the likeliest codes to sample from; 0 for all.
pub(crate) const PARAMETER_TOP_K: u32 = 2;
/// Top-p sampling: samples from the likeliest codes that together reach this probability.
pub(crate) const PARAMETER_TOP_P: u32 = 3;
/// Idle mode, while no audio comes: one of `IDLE_…`.
pub(crate) const PARAMETER_IDLE: u32 = 4;
/// Gain of the face's motion, jaw and eyes included: 0 is at rest, 1 as computed, 2 exaggerated.
pub(crate) const PARAMETER_GAIN_FACE: u32 = 16;
/// Gain of the fingers' motion.
pub(crate) const PARAMETER_GAIN_HANDS: u32 = 17;
/// Gain of the motion of spine, neck, head and arms.
pub(crate) const PARAMETER_GAIN_UPPER: u32 = 18;
/// Gain of the motion of pelvis and legs, and of the body through the world.
pub(crate) const PARAMETER_GAIN_LOWER: u32 = 19;
/// Attention of the avatar: one of `ATTENTION_…`.
pub(crate) const PARAMETER_ATTENTION: u32 = 5;
/// Delay of the output device in seconds, from playing a sound to hearing it: `umo_session_sample_pose`
/// shows a pose that much earlier. 0 to 2; some 0.2 for Bluetooth.
pub(crate) const PARAMETER_OUTPUT_DELAY: u32 = 6;
/// Activity of the hands, 0 to 1: how often they leave rest. 0.5 is the default; at 1 they hardly rest,
/// at 0 hardly rise.
pub(crate) const PARAMETER_ACTIVITY: u32 = 7;
/// Expression, 0 to 1: how far body and face follow the arousal of the voice. 0.5 is the default, 0
/// ignores the voice.
pub(crate) const PARAMETER_EXPRESSION: u32 = 8;
/// Strength of the layer of blinks, gaze and lids over the model's motion, 0 to 1.
pub(crate) const PARAMETER_LAYER_GAZE: u32 = 32;
/// Strength of breath, sway, weight shifts and fingers, and of hands at rest between gestures.
pub(crate) const PARAMETER_LAYER_IDLE: u32 = 33;
/// Strength of the asymmetry between the face's left and right.
pub(crate) const PARAMETER_LAYER_ASYMMETRY: u32 = 34;
/// Strength of nods on accents, and while listening.
pub(crate) const PARAMETER_LAYER_NODS: u32 = 35;
/// Strength of the mood's face and posture; without a mood, strength of removing a frown that no mood
/// asked for.
pub(crate) const PARAMETER_LAYER_MOOD: u32 = 36;
/// Strength of planted feet, steps, and the root's return to where it stood.
pub(crate) const PARAMETER_LAYER_FEET: u32 = 37;
/// Strength of trunk, shoulders and legs that go with the hands.
pub(crate) const PARAMETER_LAYER_BODY: u32 = 38;
/// Speaking while its own audio is heard, otherwise idle; in a scene, and after
/// `umo_session_push_other_audio`, also listening.
pub(crate) const ATTENTION_AUTO: u32 = 0;
/// Nothing in particular.
pub(crate) const ATTENTION_IDLE: u32 = 1;
/// The one who speaks: the avatar looks there, nods, and raises its brows.
pub(crate) const ATTENTION_LISTENING: u32 = 2;
/// An answer to give: the avatar looks away.
pub(crate) const ATTENTION_THINKING: u32 = 3;
/// Its own speech.
pub(crate) const ATTENTION_SPEAKING: u32 = 4;
/// No mood: the model's face without its frown.
pub(crate) const MOOD_NEUTRAL: u32 = 0;
/// Joy.
pub(crate) const MOOD_JOY: u32 = 1;
/// Sadness.
pub(crate) const MOOD_SAD: u32 = 2;
/// Anger.
pub(crate) const MOOD_ANGRY: u32 = 3;
/// Surprise.
pub(crate) const MOOD_SURPRISED: u32 = 4;
/// Disgust.
pub(crate) const MOOD_DISGUSTED: u32 = 5;
/// Fear.
pub(crate) const MOOD_AFRAID: u32 = 6;
/// The lips meet: p, b, m.
pub(crate) const LIPS_CLOSED: u32 = 0;
/// The lower lip is at the upper teeth: f, v.
pub(crate) const LIPS_TEETH: u32 = 1;
/// The lips are rounded: w, and vowels such as that of "boot".
pub(crate) const LIPS_ROUND: u32 = 2;
/// The last pose is held.
pub(crate) const IDLE_HOLD: u32 = 0;
/// `umo_session_sample_pose` eases to the rest pose.
pub(crate) const IDLE_REST: u32 = 1;
/// The model runs on silence.
pub(crate) const IDLE_LIVE: u32 = 2;
/// The parameter takes only whole numbers.
pub(crate) const PARAMETER_WHOLE: u32 = 1;
/// Maximum length in bytes of a self-test's report, including its terminating zero.
pub(crate) const SELF_TEST_SIZE: usize = 8192;
/// The mouth moves with the body, later than the sound by the session's latency.
pub(crate) const VOICE_DELAYED: u32 = 0;
/// The mouth follows the sound after `Latency.mouth_samples`: with the default model 11 ms at 16 kHz,
/// 18 ms at 48 kHz. The body follows after the session's latency, and the stream has correspondingly
/// more frames at its end. For a microphone, or a voice that is played as it arrives.
pub(crate) const VOICE_LIVE: u32 = 1;
/// The mouth alone, timed as with `VOICE_LIVE`: no chunk is computed, and the engine has nothing to do.
/// The body is at rest, with the layers over it: it breathes, looks, nods and gestures as asked. For
/// voice chat; the one voice of a model loaded with `PARTS_MOUTH`.
pub(crate) const VOICE_MOUTH: u32 = 2;
/// Chunks are output as frames only.
pub(crate) const PACKETS_NONE: u32 = 0;
/// Chunks are output as frames and as packets: pull both.
pub(crate) const PACKETS_BESIDE_FRAMES: u32 = 1;
/// Chunks are output as packets only, for a server whose avatars are shown elsewhere.
pub(crate) const PACKETS_ONLY: u32 = 2;
/// Maximum length in bytes of an error's detail, including its terminating zero.
pub(crate) const ERROR_SIZE: usize = 512;
/// The member's looks: at whom, and away.
pub(crate) const SCENE_LOOK: u32 = 1;
/// Nods and raised brows of the member while it listens.
pub(crate) const SCENE_NOD: u32 = 2;
/// Half smiles of the member while it listens.
pub(crate) const SCENE_SMILE: u32 = 4;
/// Lean and shifts of weight of the member, its own and those that follow another's.
pub(crate) const SCENE_MIRROR: u32 = 8;
/// Giving way to who interrupts the member.
pub(crate) const SCENE_YIELD: u32 = 16;
/// Nobody speaks.
pub(crate) const ROLE_IDLE: u32 = 0;
/// Another member speaks.
pub(crate) const ROLE_LISTENING: u32 = 1;
/// The member speaks.
pub(crate) const ROLE_SPEAKING: u32 = 2;
/// Upper bound on the members of a scene.
pub(crate) const SCENE_MEMBER_COUNT: usize = 32;
/// Binary glTF 2.0, `.glb`: a skinned figure, or the skeleton alone.
pub(crate) const FORMAT_GLB: u32 = 1;
/// VRM Animation 1.0, `.vrma`, for any VRM avatar.
pub(crate) const FORMAT_VRMA: u32 = 2;
/// Success.
pub(crate) const STATUS_OK: i32 = 0;
/// A required pointer is NULL.
pub(crate) const STATUS_NULL_POINTER: i32 = -1;
/// A handle is unknown, freed, or of another kind.
pub(crate) const STATUS_INVALID_HANDLE: i32 = -2;
/// An argument is out of range.
pub(crate) const STATUS_INVALID_ARGUMENT: i32 = -3;
/// Unknown `struct_size`: call the structure's initializer, or set it to `sizeof`.
pub(crate) const STATUS_STRUCT_SIZE: i32 = -4;
/// A buffer is too small for the output.
pub(crate) const STATUS_BUFFER_TOO_SMALL: i32 = -5;
/// The program was compiled with the header of an incompatible version.
pub(crate) const STATUS_VERSION: i32 = -6;
/// A file cannot be read or written.
pub(crate) const STATUS_IO: i32 = -7;
/// The file is not a usable model.
pub(crate) const STATUS_MODEL: i32 = -8;
/// There is not enough memory, or the host's allocator returned NULL.
pub(crate) const STATUS_OUT_OF_MEMORY: i32 = -9;
/// No free slot: free a model, an engine or a session first.
pub(crate) const STATUS_FULL: i32 = -10;
/// Another thread is in a call that excludes this one: call again. Nothing was done.
pub(crate) const STATUS_BUSY: i32 = -11;
/// Audio was pushed after `umo_session_finish`: reset or interrupt the session first.
pub(crate) const STATUS_FINISHED: i32 = -12;
/// The session's computation failed: it gives no more frames. Free it.
pub(crate) const STATUS_FAILED: i32 = -13;
/// The session's engine was freed: it gives no more frames. Free it.
pub(crate) const STATUS_CLOSED: i32 = -14;
/// A panic of this library was caught, without output; the session concerned cannot be used any more.
/// Free it, and report the defect: `umo_session_last_error` (or `umo_last_error`) has the panic's
/// message and its place in the source.
pub(crate) const STATUS_PANIC: i32 = -15;
/// This model, processor or engine cannot do that.
pub(crate) const STATUS_UNSUPPORTED: i32 = -16;
/// The bytes are not a state of a session with this configuration. Nothing was changed.
pub(crate) const STATUS_STATE: i32 = -17;
/// A worker thread could not be created or pinned.
pub(crate) const STATUS_THREAD: i32 = -18;
/// The bytes are not a packet for this decoder. Nothing was changed.
pub(crate) const STATUS_PACKET: i32 = -19;
/// The bytes are not a take, or a damaged one.
pub(crate) const STATUS_TAKE: i32 = -20;

/// Lends the threads of the host's job system to an engine. Each `umo_engine_poll` calls `submit` once
/// for every compute thread except its own; the host then runs `job(context)` on another thread as soon
/// as it can. The job computes until the poll is over and needs 1 MiB of stack. A job that runs late,
/// or never, costs only speed. A job that runs after the engine was freed, or inside `submit`, returns
/// at once.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Jobs {
    /// Passed to `submit`.
    pub(crate) userdata: *mut c_void,
    /// Submits a job. Called on the polling thread; must not wait for a job that runs on another thread,
    /// and must not throw.
    pub(crate) submit: *const c_void,
}

/// A log callback. Called only by the functions that make and free models, engines and sessions or
/// encode a text, on the calling thread; never by calls for the audio thread or the game thread, nor on
/// the engine's threads.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Log {
    /// Passed to `write`.
    pub(crate) userdata: *mut c_void,
    /// Receives one of `LOG_…` and a zero-terminated text, valid until it returns. Must not throw.
    pub(crate) write: *const c_void,
}

/// Configuration of an engine. Initialise it with `umo_engine_config_init`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct EngineConfig {
    /// `sizeof(EngineConfig)`.
    pub(crate) struct_size: u32,
    /// Threads that compute: one of `ENGINE_…`.
    pub(crate) mode: u32,
    /// Number of compute threads, 1 to 64. With `ENGINE_POLLED` the polling thread is one of them, and the
    /// engine starts the others unless `jobs` lends them.
    pub(crate) threads: u32,
    /// Maximum number of sessions at once, 1 to 4,096.
    pub(crate) max_sessions: u32,
    /// Maximum number of sessions in a batch, 1 to 64: larger batches read the weights less often and need
    /// more memory.
    pub(crate) max_batch: u32,
    /// Number of `cores`, 0 to 64.
    pub(crate) core_count: u32,
    /// Processor numbers to pin the engine's own threads to, one thread each; threads beyond `core_count`
    /// are not pinned. NULL pins none.
    pub(crate) cores: *const u32,
    /// Lends the host's threads, which compute in place of the engine's own; or NULL. Only with
    /// `ENGINE_POLLED`.
    pub(crate) jobs: *const Jobs,
    /// Log callback for this engine and its sessions, or NULL.
    pub(crate) log: *const Log,
    /// Priority of the engine's own threads: one of `PRIORITY_…`. If the system refuses it, they run at
    /// `PRIORITY_NORMAL`, and `log` gets a warning that says what would permit it.
    pub(crate) priority: u32,
    /// Batching window, milliseconds: the longest that a due chunk waits for others to be computed with.
    /// With 50 ms, 32 avatars take about a fifth less processor time, and frames come later by the wait. A
    /// chunk does not wait at the start of a stream, once at most half of its length is left until it would
    /// be late, or if all sessions are due. 0: no chunk waits.
    pub(crate) batch_window_ms: u32,
    /// Kinds of cores that the engine's own threads run on if `core_count` is 0: one of `CORES_…`. All but
    /// `CORES_SYSTEM` start at most as many threads as the kind has cores. No effect where all cores are of
    /// one kind.
    pub(crate) core_kinds: u32,
}

/// Layout of a frame in the host's memory: offsets in bytes from the frame's start. A value whose
/// offset is `ABSENT` is not written, and bytes between values are left alone, so that frames can be
/// the host's own structures. Initialise it with `umo_frame_layout_init`. Offsets and strides are
/// multiples of the values' alignment in C: 4, and for `index` and `sample` that of `uint64_t`, which
/// then also applies to `frame_stride`. Values must not overlap, not even in one byte, but values of
/// different kinds may be interleaved. A layout that breaks this is `INVALID_ARGUMENT`, and
/// `umo_last_error` names the fields.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct FrameLayout {
    /// `sizeof(FrameLayout)`.
    pub(crate) struct_size: u32,
    /// One of `AXES_…`.
    pub(crate) axes: u32,
    /// Bytes from one frame to the next, at least up to the end of the last value.
    pub(crate) frame_stride: u32,
    /// `uint64_t`: number of the frame since the start or the last reset; there are `ModelInfo.frame_rate`
    /// frames per second.
    pub(crate) index: u32,
    /// `uint64_t`: sample of the pushed audio, counted per channel, that the frame belongs to.
    pub(crate) sample: u32,
    /// `float[3]`: translation of the root, to be added to the first joint's offset in
    /// `umo_model_get_skeleton`. The floor is at 0 as in the model.
    pub(crate) translation: u32,
    /// `float[4]` of the first joint: its rotation in its parent's frame, a unit quaternion x, y, z, w.
    pub(crate) rotations: u32,
    /// Bytes from one joint's rotation to the next, at least 16.
    pub(crate) rotation_stride: u32,
    /// `float` of the first face channel.
    pub(crate) channels: u32,
    /// Bytes from one channel to the next, at least 4.
    pub(crate) channel_stride: u32,
    /// `float[UMO_VISEME_COUNT]`: weights of the visemes; they sum to 1.
    pub(crate) visemes: u32,
    /// Zero, as `umo_frame_layout_init` sets it: anything else is `INVALID_ARGUMENT`.
    pub(crate) reserved: u32,
}

/// Playback options of a gesture. Initialise them with `umo_gesture_options_init`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct GestureOptions {
    /// `sizeof(GestureOptions)`.
    pub(crate) struct_size: u32,
    /// The hand: one of `SIDE_…`.
    pub(crate) side: u32,
    /// Axes and units of `target`: one of `AXES_…`.
    pub(crate) axes: u32,
    /// 1 if `target` is set, else 0.
    pub(crate) has_target: u32,
    /// Time of the stroke, in seconds of the motion; the preparation begins correspondingly earlier.
    /// Negative: as soon as no other gesture uses its parts.
    pub(crate) at: f64,
    /// Playback speed, 0.5 to 2.
    pub(crate) speed: f32,
    /// Strength, 0 to 1: lower values stay closer to the model's motion.
    pub(crate) strength: f32,
    /// Point in the avatar's space, for pointing gestures; without one they point ahead.
    pub(crate) target: [f32; 3],
    /// Variant, 0 to 255: 0 is the gesture as drawn; others go through its poses in turn, and each number
    /// has a size, height and speed of its own.
    pub(crate) variant: u32,
}

/// A clip of the host's to make a gesture from. Initialise it with `umo_gesture_clip_init`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct GestureClip {
    /// `sizeof(GestureClip)`.
    pub(crate) struct_size: u32,
    /// Axes of the rotations: one of `AXES_…`.
    pub(crate) axes: u32,
    /// Parts of the body that it moves: a sum of `GESTURE_…`. The position and walking of the body stay the
    /// model's.
    pub(crate) parts: u32,
    /// Number of frames, 2 to 3,600.
    pub(crate) frame_count: u32,
    /// Frames per second, 1 to 240.
    pub(crate) rate: f32,
    /// Seconds from the first frame to the stroke.
    pub(crate) stroke: f32,
    /// `float[frame_count][UMO_JOINT_COUNT][4]`: rotation of each joint in its parent's frame, a quaternion
    /// x, y, z, w; identity in all joints is a T-pose. Read during the call.
    pub(crate) rotations: *const f32,
}

/// Options for loading a model. Initialise them with `umo_model_config_init`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct ModelConfig {
    /// `sizeof(ModelConfig)`.
    pub(crate) struct_size: u32,
    /// One of `PRECISION_…`.
    pub(crate) precision: u32,
    /// Upper bound on the instruction set: one of `ISA_…`. Float products round differently on some of
    /// them, so a session can give other frames, unless `ISA_PORTABLE` is added: docs/spec.md, section 2.9,
    /// says which give equal ones.
    pub(crate) isa: u32,
    /// Networks to load: one of `PARTS_…`.
    pub(crate) parts: u32,
    /// Log callback for this model, or NULL. The structure is copied while the model is loaded.
    pub(crate) log: *const Log,
}

/// Properties of a model. Set `struct_size`; `umo_model_get_info` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct ModelInfo {
    /// `sizeof(ModelInfo)`.
    pub(crate) struct_size: u32,
    /// Frames per second: 30.
    pub(crate) frame_rate: u32,
    /// Sample rate of the model's input in Hz; sessions take any rate and resample.
    pub(crate) sample_rate: u32,
    /// Joints of the body: the 55 of SMPL-X.
    pub(crate) joints: u32,
    /// Face channels.
    pub(crate) channels: u32,
    /// 1 if face channels are the 52 ARKit blendshapes, 0 to 1; 0 if they are SMPL-X expression
    /// coefficients.
    pub(crate) is_arkit: u32,
    /// Frames from one keyframe to the next.
    pub(crate) keyframe_stride: u32,
    /// Keyframes predicted per chunk by default.
    pub(crate) target: u32,
    /// Maximum number of keyframes per chunk.
    pub(crate) max_target: u32,
    /// Frames held back by default.
    pub(crate) lookahead: u32,
    /// Frames of future speech that a frame needs at most, with the default configuration.
    pub(crate) latency_frames: u32,
    /// Maximum number of ids in a prompt.
    pub(crate) max_prompt: u32,
    /// 1 if texts can be prompts, so that `umo_session_set_prompt` works.
    pub(crate) has_text: u32,
    /// 1 if `MODEL_NOTICE` must be shown to users: for example, that the model was never trained.
    pub(crate) has_notice: u32,
    /// Size of the model file in bytes.
    pub(crate) file_size: u64,
    /// 1 if the model has a mouth network, so that sessions can use `VOICE_LIVE` and `VOICE_MOUTH`.
    pub(crate) has_mouth: u32,
    /// Upper bound on `SessionConfig.horizon`: keyframes of audio behind a chunk that a session can wait
    /// for. Useful if the whole recording is available. 0 if the model does not hear ahead.
    pub(crate) max_horizon: u32,
}

/// Description of a parameter. Set `struct_size`; `umo_parameter_get_info` writes the rest.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct ParameterInfo {
    /// `sizeof(ParameterInfo)`.
    pub(crate) struct_size: u32,
    /// Number of the parameter, `PARAMETER_…`.
    pub(crate) id: u32,
    /// `PARAMETER_WHOLE` or 0.
    pub(crate) flags: u32,
    /// Zero.
    pub(crate) reserved: u32,
    /// Smallest value.
    pub(crate) minimum: f64,
    /// Largest value.
    pub(crate) maximum: f64,
    /// Name of the parameter: static.
    pub(crate) name: *const c_char,
}

/// Allocator for a session's memory. Both functions are required. They are called by `umo_session_new`,
/// by `umo_session_free` and, if a session was freed while a chunk of it was being computed, by the
/// next call of either or `umo_engine_free`; always on the thread of that call. They must not throw,
/// nor call functions of this library.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Allocator {
    /// Passed to both functions.
    pub(crate) userdata: *mut c_void,
    /// Returns `size` bytes aligned to `alignment`, a power of two, or NULL.
    pub(crate) allocate: *const c_void,
    /// Releases memory from `allocate`.
    pub(crate) release: *const c_void,
}

/// Configuration of a session. Initialise it with `umo_session_config_init`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct SessionConfig {
    /// `sizeof(SessionConfig)`.
    pub(crate) struct_size: u32,
    /// Sample rate of the pushed audio in Hz, 8,000 to 192,000.
    pub(crate) sample_rate: u32,
    /// Interleaved channels of the pushed audio, 1 to 64; they are mixed.
    pub(crate) channels: u32,
    /// Keyframes predicted per chunk, 1 to `ModelInfo.max_target`: fewer respond sooner, more give each
    /// chunk more context.
    pub(crate) target: u32,
    /// Frames held back until the next chunk, for smoother seams; they add to the latency.
    pub(crate) lookahead: u32,
    /// Behaviour during silence: one of `IDLE_…`.
    pub(crate) idle: u32,
    /// Milliseconds without audio after which `idle` begins.
    pub(crate) idle_after_ms: u32,
    /// Duration in milliseconds of the ease to rest, and of the way back.
    pub(crate) ease_ms: u32,
    /// Capacity of the queue of frames, at least two chunks' worth: the engine pauses while it is full.
    pub(crate) queue_frames: u32,
    /// Timing of the mouth, and whether there is a body: one of `VOICE_…`.
    pub(crate) voice: u32,
    /// Seed of all sampling: equal seeds and audio give equal frames.
    pub(crate) seed: u64,
    /// Template of the model: NULL for `audio_to_motion`; `text_to_motion` needs no audio. For the latter,
    /// `umo text` uses a `guidance` of 2.5 and a temperature of at most 0.7 (`PARAMETER_TEMPERATURE`); the
    /// defaults here are for speech.
    pub(crate) template_name: *const c_char,
    /// Allocator of the session's memory, or NULL for the system's. Read while the session is made; its
    /// functions and `userdata` must stay valid until the engine is freed.
    pub(crate) allocator: *const Allocator,
    /// Standard deviation, in frames, of a low-pass over the body's motion, 0 to 1.5; 0 for none. If
    /// `lookahead` is less, it looks two standard deviations ahead, 3 frames at most.
    pub(crate) smoothing: f32,
    /// Strength of the prompt's guidance, 1 to 3, for models of layout `frames`: 1 uses the prompt alone,
    /// at half the cost of other values. Other models: 1.
    pub(crate) guidance: f32,
    /// Keyframes of audio behind a chunk that the chunk waits for, if the model was trained to hear ahead;
    /// they add to the latency. Otherwise 0.
    pub(crate) horizon: u32,
    /// Output of chunks as packets: one of `PACKETS_…`.
    pub(crate) packets: u32,
    /// Keyframes before its chunk that a packet repeats, as many as fit the model's history. With a chunk's
    /// worth of them, the loss of one packet changes nothing.
    pub(crate) packet_history: u32,
    /// Decoders only: packets that may arrive before a missing one counts as lost, 0 to 4.
    pub(crate) reorder_window: u32,
    /// Bytes of memory for a take that is recorded while the session runs (`umo_session_take`), some 700 a
    /// second; 0 for none. Not with `VOICE_LIVE`, `VOICE_MOUTH`, `PACKETS_ONLY` or decoders.
    pub(crate) take_bytes: u64,
}

/// Range of times available to `umo_session_sample_pose`. Set `struct_size`; the call writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct Sampled {
    /// `sizeof(Sampled)`.
    pub(crate) struct_size: u32,
    /// 1 if the requested time was later than the newest frame.
    pub(crate) is_ahead: u32,
    /// Time in seconds of the oldest frame that is still available.
    pub(crate) oldest: f64,
    /// Time in seconds of the newest frame that is ready.
    pub(crate) newest: f64,
}

/// Delay of motion behind speech. Set `struct_size`; `umo_session_latency` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct Latency {
    /// `sizeof(Latency)`.
    pub(crate) struct_size: u32,
    /// Zero.
    pub(crate) reserved: u32,
    /// Upper bound on the future audio that a frame needs, in samples at the session's rate: no processor
    /// can shorten it. It follows from the configuration's `target`, `lookahead`, `smoothing`, `horizon`
    /// and `sample_rate`.
    pub(crate) algorithmic_samples: u64,
    /// Median computing time in seconds: from a chunk's last sample, or from the end of the previous chunk
    /// if that is later, to the chunk's frames.
    pub(crate) compute_p50: f64,
    /// 99th percentile of the computing time.
    pub(crate) compute_p99: f64,
    /// 99.9th percentile of the computing time.
    pub(crate) compute_p999: f64,
    /// Largest computing time.
    pub(crate) compute_max: f64,
    /// Current delay of the newest frame behind the newest audio, beyond `algorithmic_samples`, in samples
    /// at the session's rate: 0 while the engine keeps up.
    pub(crate) backlog_samples: u64,
    /// The largest backlog since the session was made.
    pub(crate) backlog_max_samples: u64,
    /// Upper bound on the future audio that a frame's mouth needs, in samples at the session's rate:
    /// `algorithmic_samples`, or less with `VOICE_LIVE`.
    pub(crate) mouth_samples: u64,
}

/// Statistics of a session. Set `struct_size`; `umo_session_stats` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct Stats {
    /// `sizeof(Stats)`.
    pub(crate) struct_size: u32,
    /// Zero.
    pub(crate) reserved: u32,
    /// Chunks computed.
    pub(crate) chunks: u64,
    /// Frames computed.
    pub(crate) frames: u64,
    /// Frames whose chunk was computed too late for real time.
    pub(crate) late_frames: u64,
    /// Frames that an interrupt or a reset dropped before they were shown.
    pub(crate) dropped_frames: u64,
    /// Samples per channel that were not taken because there was no room.
    pub(crate) overruns: u64,
    /// Samples that were NaN, infinite or beyond 1e6, and were replaced by silence.
    pub(crate) silenced: u64,
    /// Chunks whose body was held because the engine did not keep up (`umo_engine_set_late_limit`).
    pub(crate) held_chunks: u64,
}

/// Statistics of a decoder's packets. Set `struct_size`; `umo_decoder_stats` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct Received {
    /// `sizeof(Received)`.
    pub(crate) struct_size: u32,
    /// Zero.
    pub(crate) reserved: u32,
    /// Packets accepted.
    pub(crate) packets: u64,
    /// Packets that arrived too late or a second time and were ignored.
    pub(crate) late: u64,
    /// Chunks whose packet did not arrive in time.
    pub(crate) lost: u64,
    /// Keyframes of lost chunks that no other packet repeated, so that the last pose was held.
    pub(crate) held: u64,
}

/// Properties of a take. Set `struct_size`; `umo_take_get_info` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct TakeInfo {
    /// `sizeof(TakeInfo)`.
    pub(crate) struct_size: u32,
    /// Version of its format.
    pub(crate) version: u32,
    /// Frames.
    pub(crate) frames: u32,
    /// Frames per second.
    pub(crate) frame_rate: u32,
    /// Packets.
    pub(crate) packets: u32,
    /// Sample rate of the host's audio in Hz: that of a frame's sample while the take plays.
    pub(crate) sample_rate: u32,
    /// Seed of all sampling.
    pub(crate) seed: u64,
    /// Fingerprint of the model.
    pub(crate) model: u64,
    /// Fingerprint of the audio that the avatar heard: FNV-1a of 64 bits over its samples, mono floats at
    /// the model's rate.
    pub(crate) audio: u64,
    /// Number of those samples.
    pub(crate) audio_samples: u64,
    /// Fingerprint of the word rules.
    pub(crate) rules: u64,
}

/// Where a member stands. Initialise it with `umo_place_init`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct Place {
    /// `sizeof(Place)`.
    pub(crate) struct_size: u32,
    /// Axes and units of the fields below: one of `AXES_…`.
    pub(crate) axes: u32,
    /// Position on the floor, in the scene's space.
    pub(crate) position: [f32; 3],
    /// Direction that it faces, in radians about the upward axis: 0 is the axis along which an avatar
    /// looks, and the sign is that of a yaw in these axes: positive to the left in glTF's, to the right in
    /// Unity's and Unreal's.
    pub(crate) facing: f32,
    /// Height of the eyes above the position; the default is 1.6 m in glTF's axes.
    pub(crate) eye_height: f32,
}

/// State of a member of a scene. Set `struct_size`; `umo_scene_member` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct Member {
    /// `sizeof(Member)`.
    pub(crate) struct_size: u32,
    /// Whether it speaks: one of `ROLE_…`.
    pub(crate) role: u32,
    /// Whom it attends to; 0 for nobody, or for a point of the host's.
    pub(crate) attends_to: u32,
    /// 1 if it looks there now, 0 if it looks past.
    pub(crate) is_contact: u32,
    /// Nods so far.
    pub(crate) nods: u32,
    /// Brow raises so far.
    pub(crate) brows: u32,
    /// Half smiles so far.
    pub(crate) smiles: u32,
    /// Amount of yielding to another one that interrupts, 0 or 1.
    pub(crate) yielding: f32,
    /// Level of its voice, root mean square, full scale 1.
    pub(crate) level: f32,
}

/// Frames to export, with their skeleton and channels. `umo_clip_init` fills in the model's fields; the
/// host sets `layout`, `frames` and `frame_count`. The memory that it points to is read only during the
/// call that takes the clip.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Clip {
    /// `sizeof(Clip)`.
    pub(crate) struct_size: u32,
    /// Same as `ModelInfo.is_arkit`.
    pub(crate) is_arkit: u32,
    /// Number of face channels, at most 1,024.
    pub(crate) channel_count: u32,
    /// Number of frames in `frames`.
    pub(crate) frame_count: u32,
    /// Frames per second.
    pub(crate) rate: f32,
    /// Zero.
    pub(crate) reserved: u32,
    /// Names of the face channels, UTF-8, as from `umo_model_get_channel_name`. `[channel_count]`
    pub(crate) channels: *const *const c_char,
    /// `int32_t[UMO_JOINT_COUNT]`: index of each joint's parent, as from `umo_model_get_skeleton`.
    pub(crate) parents: *const i32,
    /// `float[UMO_JOINT_COUNT][3]`: rest position of each joint in its parent's frame, metres in
    /// `AXES_GLTF`, whatever the axes of the frames.
    pub(crate) offsets: *const f32,
    /// Layout and axes of the frames. It must have translation, rotations and channels.
    pub(crate) layout: *const FrameLayout,
    /// The first frame, at second 0 of the file.
    pub(crate) frames: *const c_void,
    /// Figure to skin in `FORMAT_GLB`: a name from `umo_figure_name`. NULL: the skeleton alone, without a
    /// face.
    pub(crate) figure: *const c_char,
}

/// Destination of a file's bytes.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Output {
    /// Passed to `write`.
    pub(crate) userdata: *mut c_void,
    /// Takes the next bytes of the file, at least one; they are valid until it returns. Returns 0 to go on,
    /// any other number to stop. Called on the thread that called `umo_clip_write`. Must not throw.
    pub(crate) write: *const c_void,
}

/// A character's skeleton at rest, and its mesh. `umo_rig_init` fills in the defaults. The memory that
/// it points to is read only by `umo_retarget_new`. Places and rotations are in the character's space,
/// not relative to parents, in `axes`; it may face anywhere and stand in any pose between a T and an A.
/// Scale is in the places.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Rig {
    /// `sizeof(Rig)`.
    pub(crate) struct_size: u32,
    /// Axes of the character's space, and of the poses: one of `AXES_…`.
    pub(crate) axes: u32,
    /// Number of bones, 1 to 65,536.
    pub(crate) bone_count: u32,
    /// Number of points of the mesh; 0: the body has a person's proportions.
    pub(crate) vertex_count: u32,
    /// Number of `indices`, three for each triangle; 0: the points are spread over the surface by the host.
    pub(crate) index_count: u32,
    /// Strength of the body's volume, 0 to 1. 0: arms go through the body. At 1 they keep out of trunk,
    /// head, legs and each other, and touch where the model's do.
    pub(crate) gain: f32,
    /// Factors of the measured girth of pelvis, belly, chest, neck, head, upper arms, forearms, hands,
    /// thighs: 0 to 10.
    pub(crate) girths: [f32; 9],
    /// Zero.
    pub(crate) reserved: u32,
    /// Names of the bones, UTF-8; NULL if `joints` is given. `[bone_count]`
    pub(crate) names: *const *const c_char,
    /// `int32_t[bone_count]`: index of each bone's parent, -1 for none.
    pub(crate) parents: *const i32,
    /// `int32_t[bone_count]`: joint that each bone follows, -1 for none. Bones of the joints 3, 6 and 9 are
    /// the spine from the hips up, whatever their number, bones of joint 12 the neck. NULL: found by
    /// `names`.
    pub(crate) joints: *const i32,
    /// `float[bone_count][3]`: places of the bones at rest.
    pub(crate) places: *const f32,
    /// `float[bone_count][4]`: rotations of the bones at rest, quaternions x, y, z, w.
    pub(crate) rotations: *const f32,
    /// `float[vertex_count][3]`: places of the mesh's points at rest.
    pub(crate) vertices: *const f32,
    /// `int32_t[vertex_count]`: bone that has at least half of each point's weight, -1 for none.
    pub(crate) vertex_bones: *const i32,
    /// `uint32_t[index_count]`: points of the triangles.
    pub(crate) indices: *const u32,
}

impl EngineConfig {
    /// Sets what a project sets: numbers by their names. 0 is the library's default.
    pub(crate) fn set(&mut self, setting: impl Fn(&str) -> u32) {
        let set = |name, field: &mut u32| match setting(name) {
            0 => {}
            value => *field = value,
        };
        set("umo/threads", &mut self.threads);
        set("umo/max_sessions", &mut self.max_sessions);
        set("umo/max_batch", &mut self.max_batch);
        set("umo/priority", &mut self.priority);
        set("umo/batch_window_ms", &mut self.batch_window_ms);
        set("umo/core_kinds", &mut self.core_kinds);
    }
}
