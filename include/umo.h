/*
 * umo: real-time full-body animation from speech. Samples in; poses of face, hands, upper and lower body out, 30 a second.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 * This file is written by cbindgen from umo-capi/src: change it there.
 *
 * C99 or newer, or C++11 or newer.
 *
 * Unless stated otherwise:
 *
 * - A fallible call returns a umo_status: UMO_STATUS_OK (0), or a negative error code. umo_status_message describes a
 *   status and what to do about it; umo_last_error, and for calls on a session umo_session_last_error, give the details.
 *   A call that fails changes nothing and writes no result.
 * - Models, engines and sessions are handles. NULL, freed and invalid handles are errors, not crashes. An object in use on
 *   another thread is not freed: its free function returns UMO_STATUS_BUSY.
 * - Models, engines and sessions may be freed in any order.
 * - Order of arguments: the object, inputs, outputs. Lengths are in elements, sizes in bytes.
 * - A structure starts with struct_size: its initialiser, or sizeof, sets it. Later versions only add fields at the end.
 * - Texts are UTF-8. Times are seconds, lengths metres, angles unit quaternions x y z w, sound is full scale at 1, unless
 *   a name says otherwise.
 * - No call throws or exits, and none aborts: an allocation that fails, of any size, is UMO_STATUS_OUT_OF_MEMORY. A small
 *   one is served from a reserve until its call ends with that status. That the system has memory for a thread's start is
 *   checked first.
 * - The library runs only on its own threads and inside calls.
 * - Everything is computed in the default floating-point environment: rounding to nearest, no traps, denormals kept. A
 *   call restores its caller's environment, exception flags included. The host's callbacks are called in the default one.
 * - _load, _new and _free allocate, and functions whose comment says so; the path from audio to frames never does.
 *
 * Threads of a session:        audio thread             any thread                    game thread
 *                              umo_session_push_audio   umo_session_interrupt, set_…   umo_session_pull_frames
 *                              umo_session_finish       umo_session_latency, stats     umo_session_sample_pose
 */

#ifndef UMO_H
#define UMO_H

#include <stddef.h>
#include <stdint.h>

#ifndef UMO_API
#if defined(_WIN32) && !defined(UMO_STATIC)
#define UMO_API __declspec(dllimport)
#else
#define UMO_API
#endif
#endif

#if defined(__cplusplus) && __cplusplus >= 201103L
#define UMO_NOEXCEPT noexcept
#else
#define UMO_NOEXCEPT
#endif

#if defined(__cplusplus) && __cplusplus >= 201703L
#define UMO_MUST_USE [[nodiscard]]
#elif defined(__GNUC__) || defined(__clang__)
#define UMO_MUST_USE __attribute__((warn_unused_result))
#else
#define UMO_MUST_USE
#endif

// The version of this interface: its major number in the upper 16 bits, its minor number in the
// lower. A library serves programs of the same major number and no larger minor one.
#define UMO_ABI_VERSION 1

// Y up, right-handed, metres; the avatar looks along +Z, its left hand is towards +X. glTF's and
// Godot's.
#define UMO_AXES_GLTF 0

// Z up, left-handed, centimetres; the avatar looks along +X, its right hand is towards +Y.
// Unreal's.
#define UMO_AXES_UNREAL 1

// Y up, left-handed, metres; the avatar looks along +Z, its right hand is towards +X. Unity's.
#define UMO_AXES_UNITY 2

// The engine has threads of its own.
#define UMO_ENGINE_THREADS 0

// The host computes by `umo_engine_poll`.
#define UMO_ENGINE_POLLED 1

// Threads have the priority of any new thread of the process.
#define UMO_PRIORITY_NORMAL 0

// Threads run before those of normal priority: frames are nearly as fast beside a program that
// keeps every core busy. Linux refuses it to most users; Windows, Android and Apple's systems
// grant it.
#define UMO_PRIORITY_HIGH 1

// Threads run behind those of normal priority, in the time that they leave.
#define UMO_PRIORITY_LOW 2

// Offset of a value that is not wanted.
#define UMO_ABSENT 4294967295

// The right hand; for a place to point at, the hand that is nearer to it.
#define UMO_SIDE_AUTO 0

// The left hand; the whole gesture is mirrored.
#define UMO_SIDE_LEFT 1

// The right hand.
#define UMO_SIDE_RIGHT 2

// Both hands, where a gesture of one hand can be done by both; else as `UMO_SIDE_AUTO`.
#define UMO_SIDE_BOTH 3

// Neck and head.
#define UMO_GESTURE_HEAD 1

// Spine.
#define UMO_GESTURE_TRUNK 2

// From the left collar to the fingers.
#define UMO_GESTURE_LEFT_ARM 4

// From the right collar to the fingers.
#define UMO_GESTURE_RIGHT_ARM 8

// Log level: information.
#define UMO_LOG_INFO 1

// Log level: warning.
#define UMO_LOG_WARNING 2

// Log level: error.
#define UMO_LOG_ERROR 3

// Weights as the file has them.
#define UMO_PRECISION_STORED 0

// All products in f32.
#define UMO_PRECISION_F32 1

// Weights rounded to bfloat16.
#define UMO_PRECISION_BF16 2

// Weights rounded to int8.
#define UMO_PRECISION_INT8 3

// The fastest instructions that the processor has.
#define UMO_ISA_BEST 0

// Portable code.
#define UMO_ISA_SCALAR 1

// At most AVX2.
#define UMO_ISA_AVX2 2

// At most AVX-512 with VNNI.
#define UMO_ISA_AVX512VNNI 3

// At most AMX.
#define UMO_ISA_AMX 4

// At most AVX-512 with VNNI and products of bfloat16.
#define UMO_ISA_AVX512BF16 5

// At most AVX2 with VNNI.
#define UMO_ISA_AVXVNNI 6

// At most NEON, on 64-bit Arm.
#define UMO_ISA_NEON 7

// At most NEON with dot products of int8.
#define UMO_ISA_NEON_DOTPROD 8

// At most NEON with dot products and matrix products of int8.
#define UMO_ISA_NEON_I8MM 9

// Name of the model.
#define UMO_MODEL_NAME 1

// Licence of its weights.
#define UMO_MODEL_LICENSE 2

// Notice that must be shown to users; may be empty.
#define UMO_MODEL_NOTICE 3

// The instructions that it was packed for, as `avx512vnni`.
#define UMO_MODEL_ISA 4

// Visemes per frame.
#define UMO_VISEME_COUNT 15

// Joints of every model.
#define UMO_JOINT_COUNT 55

// Sampling temperature: 0 always takes the likeliest code; the model says what it was tuned for.
#define UMO_PARAMETER_TEMPERATURE 1

// Top-k sampling: from this many of the likeliest codes; 0 is all.
#define UMO_PARAMETER_TOP_K 2

// Top-p sampling: from the likeliest codes that together reach this probability.
#define UMO_PARAMETER_TOP_P 3

// What is shown while no audio comes: one of `UMO_IDLE_…`.
#define UMO_PARAMETER_IDLE 4

// How much the face moves, jaw and eyes included: 0 at rest, 1 as computed, 2 exaggerated.
#define UMO_PARAMETER_GAIN_FACE 16

// How much the fingers move.
#define UMO_PARAMETER_GAIN_HANDS 17

// How much spine, neck, head and arms move.
#define UMO_PARAMETER_GAIN_UPPER 18

// How much pelvis and legs move, and the body through the world.
#define UMO_PARAMETER_GAIN_LOWER 19

// What the avatar attends to: one of `UMO_ATTENTION_…`.
#define UMO_PARAMETER_ATTENTION 5

// The output device's own delay, seconds from the sound that is played to the sound that is heard:
// `umo_session_sample_pose` shows the pose of so much earlier. 0 to 2; some 0.2 by Bluetooth.
#define UMO_PARAMETER_OUTPUT_DELAY 6

// Strength of the layer of blinks, gaze and lids over the model's motion, 0 to 1.
#define UMO_PARAMETER_LAYER_GAZE 32

// Strength of breath, sway, weight shifts and fingers.
#define UMO_PARAMETER_LAYER_IDLE 33

// Strength of the differences between the face's left and right.
#define UMO_PARAMETER_LAYER_ASYMMETRY 34

// Strength of nods on accents, and while listening.
#define UMO_PARAMETER_LAYER_NODS 35

// Strength of the mood's face and posture; without a mood, of what takes away a frown that nothing
// asked for.
#define UMO_PARAMETER_LAYER_MOOD 36

// Strength of planted feet, steps, and the root's way back to where it stood.
#define UMO_PARAMETER_LAYER_FEET 37

// Speaking while its own audio is heard, listening while `umo_session_push_other_audio`'s is, else
// idle.
#define UMO_ATTENTION_AUTO 0

// Nothing in particular.
#define UMO_ATTENTION_IDLE 1

// Who speaks to it: it looks there, nods and raises its brows at pauses.
#define UMO_ATTENTION_LISTENING 2

// An answer: it looks away.
#define UMO_ATTENTION_THINKING 3

// What it says.
#define UMO_ATTENTION_SPEAKING 4

// No mood: the model's face without its frown.
#define UMO_MOOD_NEUTRAL 0

// Joy.
#define UMO_MOOD_JOY 1

// Sadness.
#define UMO_MOOD_SAD 2

// Anger.
#define UMO_MOOD_ANGRY 3

// Surprise.
#define UMO_MOOD_SURPRISED 4

// Disgust.
#define UMO_MOOD_DISGUSTED 5

// Fear.
#define UMO_MOOD_AFRAID 6

// The lips meet: p, b, m.
#define UMO_LIPS_CLOSED 0

// The lower lip is at the upper teeth: f, v.
#define UMO_LIPS_TEETH 1

// The lips are rounded: w, and vowels such as that of "boot".
#define UMO_LIPS_ROUND 2

// The last pose is held.
#define UMO_IDLE_HOLD 0

// `umo_session_sample_pose` eases to the rest pose.
#define UMO_IDLE_REST 1

// The model runs on silence.
#define UMO_IDLE_LIVE 2

// Only whole numbers are allowed.
#define UMO_PARAMETER_WHOLE 1

// Bytes that a self-test's report may have, its end included.
#define UMO_SELF_TEST_SIZE 8192

// The mouth moves with the body, later than the sound by the session's latency.
#define UMO_VOICE_DELAYED 0

// The mouth moves as the sound is heard, later by `umo_latency.mouth_samples`: with the default model
// 56 ms at 16 kHz, 63 ms at 48 kHz. The body follows by the session's latency, and the stream has as
// many more frames at its end. For a microphone, or a voice that is played as it comes.
#define UMO_VOICE_LIVE 1

// Chunks are given as frames alone.
#define UMO_PACKETS_NONE 0

// Chunks are given as frames and as packets: both are to be pulled.
#define UMO_PACKETS_BESIDE_FRAMES 1

// Chunks are given as packets alone: for a server whose avatars are seen elsewhere.
#define UMO_PACKETS_ONLY 2

// Bytes that an error's detail may have, its end included.
#define UMO_ERROR_SIZE 512

// Binary glTF 2.0, `.glb`: the skeleton with a figure, or the bones alone.
#define UMO_FORMAT_GLB 1

// VRM Animation 1.0, `.vrma`, for any VRM avatar.
#define UMO_FORMAT_VRMA 2

// An engine. A handle, never a pointer to memory.
typedef struct umo_engine umo_engine;

// A loaded model. A handle, never a pointer to memory.
typedef struct umo_model umo_model;

// A session: one avatar. A handle, never a pointer to memory.
typedef struct umo_session umo_session;

// Result of a call: `UMO_STATUS_OK`, or a negative error code. Numbers are never used
// again for anything else.
typedef int32_t umo_status;

// Lends the threads of the host's job system to an engine. Each `umo_engine_poll` then calls
// `submit` for every thread but its own; the host runs `job(context)` on another thread as soon as
// it can, which computes until the poll is over and returns. It needs 1 MiB of stack. A job that
// is run late, or never, costs speed and nothing else; one that is run after the engine was freed,
// or by `submit` itself, returns at once.
typedef struct umo_jobs {
    // Given to `submit`.
    void *userdata;
    // Hands a job over. Called by the thread that polls; must not wait for a job that another thread
    // runs, and must not throw.
    void (*submit)(void *userdata, void (*job)(void *context), void *context);
} umo_jobs;

// A log callback. Called only by the functions that make and free models, engines and sessions, on
// their thread; never by the audio thread's or the game thread's calls, nor by the engine's
// threads.
typedef struct umo_log {
    // Given to `write`.
    void *userdata;
    // Gets one of `UMO_LOG_…` and a text that ends with a zero byte, good until it returns. Must not throw.
    void (*write)(void *userdata, uint32_t level, const char *message);
} umo_log;

// Configuration of an engine. Start it with `umo_engine_config_init`.
typedef struct umo_engine_config {
    // `sizeof(umo_engine_config)`.
    uint32_t struct_size;
    // `UMO_ENGINE_THREADS` or `UMO_ENGINE_POLLED`.
    uint32_t mode;
    // Threads that compute, 1 to 64: the engine's own, or, where the host polls, the polling
    // thread and as many more of the engine's own as make up the number.
    uint32_t threads;
    // Most sessions at once, 1 to 4,096.
    uint32_t max_sessions;
    // Most sessions that are computed together, 1 to 64: more read the weights less often and need
    // memory.
    uint32_t max_batch;
    // How many `cores` there are, 0 to 64.
    uint32_t core_count;
    // Processor numbers that the engine's own threads are bound to, one each, as far as they go;
    // NULL leaves that to the system.
    const uint32_t *cores;
    // The host's threads, where they are to compute in place of the engine's own, or NULL. Only
    // with `UMO_ENGINE_POLLED`.
    const struct umo_jobs *jobs;
    // Log callback for this engine and its sessions, or NULL.
    const struct umo_log *log;
    // `UMO_PRIORITY_…` of the engine's own threads. Where the system refuses it they are
    // `UMO_PRIORITY_NORMAL`, and `log` gets a warning that says what it takes.
    uint32_t priority;
    // The longest that a chunk which is due waits for others, to be computed together, milliseconds: with 50, 32 avatars
    // take about a fifth less processor time, and frames come later by the wait. A chunk does not wait at the start of a
    // stream, once half of its length or less is left until it would be late, or where all sessions are due. 0: none waits.
    uint32_t gather_ms;
} umo_engine_config;

// Where a frame's values go in memory of the host's own, in bytes from the frame's start. A value
// whose offset is `UMO_ABSENT` is not written; bytes between values are left alone, so that frames
// can be the host's own structures. Start it with `umo_frame_layout_init`.
//
// Offsets and strides are multiples of the alignment that C gives the values: 4, and for `index`
// and `sample` that of `uint64_t`, which `frame_stride` then has too. No two values overlap, not
// in one byte; values of one kind may lie between those of another. A layout that breaks this is
// `INVALID_ARGUMENT`, and `umo_last_error` names the fields.
typedef struct umo_frame_layout {
    // `sizeof(umo_frame_layout)`.
    uint32_t struct_size;
    // One of `UMO_AXES_…`.
    uint32_t axes;
    // Bytes from one frame to the next, at least the end of the last value.
    uint32_t frame_stride;
    // `uint64_t`: the frame's number since the start or the last reset,
    // `umo_model_info.frame_rate` a second.
    uint32_t index;
    // `uint64_t`: the sample of each channel of the pushed audio that the frame belongs to.
    uint32_t sample;
    // `float[3]`: where the root is, to be added to the first joint's offset in
    // `umo_model_get_skeleton`. The floor is at 0 where the model's is.
    uint32_t translation;
    // `float[4]` of the first joint: its rotation in its parent's frame, a unit quaternion x, y,
    // z, w.
    uint32_t rotations;
    // Bytes from one joint's rotation to the next, at least 16.
    uint32_t rotation_stride;
    // `float` of the first face channel.
    uint32_t channels;
    // Bytes from one channel to the next, at least 4.
    uint32_t channel_stride;
    // `float[UMO_VISEME_COUNT]`: how much the mouth is each of the visemes; they add up to 1.
    uint32_t visemes;
    // Zero, as `umo_frame_layout_init` sets it: anything else is `INVALID_ARGUMENT`.
    uint32_t reserved;
} umo_frame_layout;

// How a gesture is played. Start it with `umo_gesture_options_init`.
typedef struct umo_gesture_options {
    // `sizeof(umo_gesture_options)`.
    uint32_t struct_size;
    // Which hand: one of `UMO_SIDE_…`.
    uint32_t side;
    // Axes and units of `target`: one of `UMO_AXES_…`.
    uint32_t axes;
    // 1 where there is a `target`, else 0.
    uint32_t has_target;
    // Seconds of the motion at which the stroke falls; the preparation begins that much earlier.
    // Negative: as soon as no other gesture has its parts.
    double at;
    // How fast, 0.5 to 2.
    float speed;
    // How much of it, 0 to 1: less is nearer to what the model does.
    float strength;
    // A place in the avatar's space, for gestures that point; without one they point ahead.
    float target[3];
    // Zero.
    uint32_t reserved;
} umo_gesture_options;

// A clip of the host's own that becomes a gesture. Start it with `umo_gesture_clip_init`.
typedef struct umo_gesture_clip {
    // `sizeof(umo_gesture_clip)`.
    uint32_t struct_size;
    // Axes of the rotations: one of `UMO_AXES_…`.
    uint32_t axes;
    // Parts that it moves: a sum of `UMO_GESTURE_…`. Where the body stands and goes stays the
    // model's.
    uint32_t parts;
    // Frames, 2 to 3,600.
    uint32_t frame_count;
    // Frames a second, 1 to 240.
    float rate;
    // Seconds from the first frame to the stroke.
    float stroke;
    // `float[frame_count][UMO_JOINT_COUNT][4]`: each joint's rotation in its parent's frame, a
    // quaternion x, y, z, w; all joints at rest are a T-pose. Read during the call.
    const float *rotations;
} umo_gesture_clip;

// How a model is loaded. Start it with `umo_model_config_init`.
typedef struct umo_model_config {
    // `sizeof(umo_model_config)`.
    uint32_t struct_size;
    // One of `UMO_PRECISION_…`.
    uint32_t precision;
    // The fastest instructions that may be used: one of `UMO_ISA_…`. Float products round
    // differently on some of them, so that a session can give other frames: docs/spec.md, section 2.9, says which give
    // the same.
    uint32_t isa;
    // Zero.
    uint32_t reserved;
    // Log callback for this model, or NULL. Read while the model is loaded.
    const struct umo_log *log;
} umo_model_config;

// What a model has. Set `struct_size`, the rest is written by `umo_model_get_info`.
typedef struct umo_model_info {
    // `sizeof(umo_model_info)`.
    uint32_t struct_size;
    // Frames per second: 30.
    uint32_t frame_rate;
    // Samples per second of the model's input; sessions take any rate and resample.
    uint32_t sample_rate;
    // Joints of the body: 55, as SMPL-X has them.
    uint32_t joints;
    // Face channels.
    uint32_t channels;
    // 1 where face channels are the 52 ARKit blendshapes, 0 to 1; 0 where they are SMPL-X
    // expression coefficients.
    uint32_t is_arkit;
    // Frames from one keyframe to the next.
    uint32_t keyframe_stride;
    // Keyframes predicted per chunk by default.
    uint32_t target;
    // Most keyframes per chunk.
    uint32_t max_target;
    // Frames held back by default.
    uint32_t lookahead;
    // Frames of future speech that a frame needs at most, by default.
    uint32_t latency_frames;
    // Most ids of a prompt.
    uint32_t max_prompt;
    // 1 where texts can be prompts, so that `umo_session_set_prompt` works.
    uint32_t has_text;
    // 1 if `UMO_MODEL_NOTICE` must be shown to users: that the model was never trained,
    // say.
    uint32_t has_notice;
    // Bytes of the model file.
    uint64_t file_size;
    // 1 where the model has a mouth network, so that sessions may have `UMO_VOICE_LIVE`.
    uint32_t has_mouth;
    // Most keyframes of audio behind a chunk that a session can wait for
    // (`umo_session_config.horizon`): worth it where the whole recording is there. 0 where the
    // model does not hear ahead.
    uint32_t max_horizon;
} umo_model_info;

// What a parameter is. Set `struct_size`, the rest is written by `umo_parameter_get_info`.
typedef struct umo_parameter_info {
    // `sizeof(umo_parameter_info)`.
    uint32_t struct_size;
    // `UMO_PARAMETER_…`.
    uint32_t id;
    // `UMO_PARAMETER_WHOLE` or 0.
    uint32_t flags;
    // Zero.
    uint32_t reserved;
    // Least value.
    double minimum;
    // Largest value.
    double maximum;
    // Its name: static.
    const char *name;
} umo_parameter_info;

// Where a session's memory comes from. Both functions are needed. They are called by
// `umo_session_new`, `umo_session_free` and, where a session was freed while a chunk of it was
// computed, by the next of these or `umo_engine_free`; never by another thread than the one in
// that call. They must not throw, nor call functions of this library.
typedef struct umo_allocator {
    // Given to both.
    void *userdata;
    // Gives `size` bytes aligned to `alignment`, a power of two, or NULL.
    void *(*allocate)(void *userdata, size_t size, size_t alignment);
    // Takes back what `allocate` gave.
    void (*release)(void *userdata, void *memory, size_t size, size_t alignment);
} umo_allocator;

// Configuration of a session. Start it with `umo_session_config_init`.
typedef struct umo_session_config {
    // `sizeof(umo_session_config)`.
    uint32_t struct_size;
    // Samples per second of the audio that is pushed, 8,000 to 192,000.
    uint32_t sample_rate;
    // Interleaved channels of that audio, 1 to 64; they are mixed.
    uint32_t channels;
    // Keyframes predicted per chunk, 1 to `umo_model_info.max_target`: fewer answer sooner, more
    // see more at once.
    uint32_t target;
    // Frames held back until the next chunk, for smoother seams: that much later, too.
    uint32_t lookahead;
    // What is shown during silence: one of `UMO_IDLE_…`.
    uint32_t idle;
    // Milliseconds without audio after which that begins.
    uint32_t idle_after_ms;
    // Milliseconds that an ease to rest takes, and the way back.
    uint32_t ease_ms;
    // Frames that wait for the host before the engine stops computing: at least two chunks' worth.
    uint32_t queue_frames;
    // When the mouth moves: one of `UMO_VOICE_…`.
    uint32_t voice;
    // Seed of all draws: the same seed and audio give the same frames.
    uint64_t seed;
    // Which of the model's templates: NULL for `audio_to_motion`; `text_to_motion` needs no audio. For
    // it, `umo text` takes a `guidance` of 2.5 and a temperature of 0.7 at most
    // (`UMO_PARAMETER_TEMPERATURE`): the defaults here are those of speech.
    const char *template_name;
    // Where the session's memory comes from, or NULL for the system's. Read while the session is
    // made; what it names must live until the engine is freed.
    const struct umo_allocator *allocator;
    // Standard deviation of the low-pass of the body's motion, frames, 0 to 1.5: 0 for the model's own
    // motion. It looks two standard deviations ahead, 3 frames at most, where `lookahead` is less.
    float smoothing;
    // How strongly the prompt steers, 1 to 3, with models of layout `frames`: 1 is the prompt alone,
    // at half the cost of other values. Else 1.
    float guidance;
    // Keyframes of audio behind a chunk that it waits for, where the model was made to hear ahead:
    // that much later, too. Else 0.
    uint32_t horizon;
    // Whether chunks are given as packets: one of `UMO_PACKETS_…`.
    uint32_t packets;
    // Keyframes before those of its chunk that a packet says again: one that is lost changes nothing
    // where these are a chunk's. As many as fit the model's history.
    uint32_t packet_history;
    // Of a decoder: packets that may come before one that is missing counts as lost, 0 to 4.
    uint32_t patience;
} umo_session_config;

// The range of times that `umo_session_sample_pose` could sample. Set `struct_size`, the rest is written.
typedef struct umo_sampled {
    // `sizeof(umo_sampled)`.
    uint32_t struct_size;
    // 1 where the time asked for was later than the newest frame.
    uint32_t is_ahead;
    // Seconds of the oldest frame that is still there.
    double oldest;
    // Seconds of the newest frame that is ready.
    double newest;
} umo_sampled;

// How far motion is behind speech. Set `struct_size`, the rest is written by
// `umo_session_latency`.
typedef struct umo_latency {
    // `sizeof(umo_latency)`.
    uint32_t struct_size;
    // Zero.
    uint32_t reserved;
    // Samples of future audio, at the session's rate, that a frame needs at most: what no
    // processor can shorten. The configuration's `target`, `lookahead`, `smoothing`, `horizon` and
    // `sample_rate` make it.
    uint64_t algorithmic_samples;
    // Seconds from a chunk's last sample, or the end of the chunk before where that is later, to
    // its frames: median.
    double compute_p50;
    // Its 99th percentile.
    double compute_p99;
    // Its 99.9th percentile.
    double compute_p999;
    // Its largest.
    double compute_max;
    // Samples, at the session's rate, by which the newest frame is behind the newest audio now,
    // beyond `algorithmic_samples`: 0 while the engine keeps up.
    uint64_t backlog_samples;
    // The largest backlog since the session was made.
    uint64_t backlog_max_samples;
    // Samples of future audio, at the session's rate, that a frame's mouth needs at most:
    // `algorithmic_samples`, or less with `UMO_VOICE_LIVE`.
    uint64_t mouth_samples;
} umo_latency;

// Statistics of a session. Set `struct_size`, the rest is written by `umo_session_stats`.
typedef struct umo_stats {
    // `sizeof(umo_stats)`.
    uint32_t struct_size;
    // Zero.
    uint32_t reserved;
    // Chunks computed.
    uint64_t chunks;
    // Frames computed.
    uint64_t frames;
    // Frames whose chunk was done later than real time needs it.
    uint64_t late_frames;
    // Frames that an interrupt or a reset dropped before they were shown.
    uint64_t dropped_frames;
    // Samples of each channel that were not taken because there was no room.
    uint64_t overruns;
    // Samples that were NaN, infinite or beyond 1e6, and became silence.
    uint64_t silenced;
    // Chunks whose body was held because the engine did not keep up (`umo_engine_set_late_limit`).
    uint64_t held_chunks;
} umo_stats;

// What came of a decoder's packets. Set `struct_size`, the rest is written by `umo_decoder_stats`.
typedef struct umo_received {
    // `sizeof(umo_received)`.
    uint32_t struct_size;
    // Zero.
    uint32_t reserved;
    // Packets that were taken.
    uint64_t packets;
    // Packets that came after their time or a second time: they changed nothing.
    uint64_t late;
    // Chunks whose packet did not come in time.
    uint64_t lost;
    // Keyframes of these that no other packet said: the last one was held.
    uint64_t held;
} umo_received;

// Frames that become a file, and whose they are. `umo_clip_init` fills in what is a model's;
// `layout`, `frames` and `frame_count` are the host's. What it points to is read during the call that
// is given it.
typedef struct umo_clip {
    // `sizeof(umo_clip)`.
    uint32_t struct_size;
    // As `umo_model_info.is_arkit`.
    uint32_t is_arkit;
    // Face channels, at most 1,024.
    uint32_t channel_count;
    // Frames in `frames`.
    uint32_t frame_count;
    // Frames a second.
    float rate;
    // Zero.
    uint32_t reserved;
    // Names of the face channels, UTF-8, as of `umo_model_get_channel_name`. `[channel_count]`
    const char *const *channels;
    // `int32_t[UMO_JOINT_COUNT]`: each joint's parent, as of `umo_model_get_skeleton`.
    const int32_t *parents;
    // `float[UMO_JOINT_COUNT][3]`: where each joint is in its parent's frame at rest, metres in
    // `UMO_AXES_GLTF`, whatever the axes of the frames are.
    const float *offsets;
    // How the frames lie, and in which axes. It must have translation, rotations and channels.
    const struct umo_frame_layout *layout;
    // The first frame; it is at second 0 of the file.
    const void *frames;
    // Who wears the motion in `UMO_FORMAT_GLB`: one of `umo_figure_name`. NULL: nobody, the file has
    // the bones alone, and no face.
    const char *figure;
} umo_clip;

// Where a file's bytes go.
typedef struct umo_output {
    // Given to `write`.
    void *userdata;
    // Takes the file's next bytes, at least one, which are good until it returns: 0 where it took
    // them, any other number to stop. Called by the thread that called `umo_clip_write`. Must not throw.
    int32_t (*write)(void *userdata, const void *bytes, size_t size);
} umo_output;

// Success.
#define UMO_STATUS_OK 0

// A required pointer is NULL.
#define UMO_STATUS_NULL_POINTER -1

// An unknown or freed handle, or one of another kind.
#define UMO_STATUS_INVALID_HANDLE -2

// An argument is out of range.
#define UMO_STATUS_INVALID_ARGUMENT -3

// Unknown `struct_size`: call the structure's initializer, or set it to `sizeof`.
#define UMO_STATUS_STRUCT_SIZE -4

// A buffer is too small for the output.
#define UMO_STATUS_BUFFER_TOO_SMALL -5

// The program was compiled with the header of another, incompatible version.
#define UMO_STATUS_VERSION -6

// A file cannot be read or written.
#define UMO_STATUS_IO -7

// Not a usable model file.
#define UMO_STATUS_MODEL -8

// There is not enough memory, or the host's allocator gave none.
#define UMO_STATUS_OUT_OF_MEMORY -9

// No free slot: free a model, an engine or a session first.
#define UMO_STATUS_FULL -10

// Another thread is in a call that excludes this one: call again. Nothing was done.
#define UMO_STATUS_BUSY -11

// Audio was pushed after `umo_session_finish`: reset or interrupt the session first.
#define UMO_STATUS_FINISHED -12

// The session's computation failed: it gives no more frames. Free it.
#define UMO_STATUS_FAILED -13

// The session's engine was freed: it gives no more frames. Free it.
#define UMO_STATUS_CLOSED -14

// A panic of this library was caught, without output; the session concerned can not be used any
// more. Free it, and report the defect: `umo_session_last_error` (or `umo_last_error`) has
// the panic's text and its place in the source.
#define UMO_STATUS_PANIC -15

// This model, processor or engine cannot do that.
#define UMO_STATUS_UNSUPPORTED -16

// Not a state of such a session. Nothing was changed.
#define UMO_STATUS_STATE -17

// A worker thread could not be created or pinned.
#define UMO_STATUS_THREAD -18

// Not a packet for such a decoder. Nothing was changed.
#define UMO_STATUS_PACKET -19

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// `UMO_ABI_VERSION` of the library, for programs that look it up while they run.
//
// Threads: any. Never allocates, never waits.
UMO_API uint32_t umo_abi_version(void) UMO_NOEXCEPT;

// The library's version, as `0.1.0`: static.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_version(void) UMO_NOEXCEPT;

// Fills an engine configuration with its defaults: two threads of its own (one where there is one
// core), 64 sessions, 8 of them together. A library that was built without threads has one that the
// host polls. `size` is `sizeof *config`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
//
// Pointers:
// `config` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_engine_config_init(struct umo_engine_config *config,
                                  size_t size)
UMO_NOEXCEPT;

// Creates an engine for a model, which may be freed before it. `config` may be NULL.
//
// Threads: any but the audio thread. Allocates everything that computing will need, and starts the
// engine's threads.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which
// number), `STRUCT_SIZE`, `THREAD`, `MODEL` (the model has no rest pose), `FULL` (1,024
// engines), `OUT_OF_MEMORY`, `UNSUPPORTED` (threads of its own, in a library that was built without
// them).
//
// Pointers:
// `config` is NULL or as long as its `struct_size` says, with `cores`, `jobs` and `log` as
// described; `engine` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_engine_new(const struct umo_model *model,
                          const struct umo_engine_config *config,
                          struct umo_engine **engine)
UMO_NOEXCEPT;

// Stops an engine's threads and frees it. Its sessions live on without it: frames that were ready
// can be pulled, then they say `CLOSED`. NULL is fine.
//
// Threads: any but the audio thread. Waits for the layer that is being computed, a few
// milliseconds at most.
// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is in progress, as `umo_engine_poll`, or a job
// that it gave to `umo_jobs.submit`). After `BUSY` the engine takes no other calls, and jobs that
// have not begun return at once; free it again when those in progress have returned:
// `while (umo_engine_free(engine) == UMO_STATUS_BUSY) wait_for_my_jobs();`
UMO_API umo_status umo_engine_free(struct umo_engine *engine) UMO_NOEXCEPT;

// What happens when there is more to compute than time: while chunks begin later than `seconds` behind
// real time, a growing share of them is computed without the language model, at a quarter of the cost.
// In these the body holds its pose, and the mouth comes from the model's mouth network, if it has one;
// sessions take turns. The share shrinks again when chunks are in time; `umo_stats.held_chunks` counts
// them. While the engine keeps up, every frame has the same bits.
//
// A negative number, as an engine begins, holds no body: frames come later and later, up to the ten
// seconds of audio that a session queues. Leave it so where audio is pushed faster than it is heard.
//
// Threads: any. Never allocates, never waits.
// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT` (not finite).
UMO_API
UMO_MUST_USE
umo_status umo_engine_set_late_limit(struct umo_engine *engine,
                                     double seconds)
UMO_NOEXCEPT;

// Computes on the calling thread, where the engine was made with `UMO_ENGINE_POLLED`: until nothing is due, or until
// the next layer would no longer fit `budget` microseconds, by how long the last of its kind took. It computes one layer
// at least: one with a budget of 0. `more`, which may be NULL, becomes 1 where the budget left something that is due,
// else 0: a session is due when the audio of its next chunk was pushed and its queue of frames has room, so that one whose
// queue is full is due again once frames are pulled.
//
// Threads: one at a time, with at least 1 MiB of stack; not the audio thread. Never allocates;
// waits only for the engine's own threads and for work that lent ones have begun.
// Errors: `INVALID_HANDLE`, `BUSY` (another thread polls), `UNSUPPORTED` (the engine has threads
// of its own).
//
// Pointers:
// `more` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_engine_poll(struct umo_engine *engine,
                           uint32_t budget,
                           uint32_t *more)
UMO_NOEXCEPT;

// Fills a layout with that of frames without gaps in glTF's axes: index, sample, translation,
// rotations, channels, and visemes where the model has ARKit channels. `size` is `sizeof *layout`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`.
//
// Pointers:
// `layout` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_frame_layout_init(struct umo_frame_layout *layout,
                                 size_t size,
                                 const struct umo_model *model)
UMO_NOEXCEPT;

// Checks a layout against a model, and computes how many frames `size` bytes have room for.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT`, `UNSUPPORTED`:
// `umo_last_error` says what.
//
// Pointers:
// `layout` is NULL or as long as its `struct_size` says; `frames` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_frame_layout_check(const struct umo_frame_layout *layout,
                                  const struct umo_model *model,
                                  size_t size,
                                  size_t *frames)
UMO_NOEXCEPT;

// Fills the options of a gesture with their defaults: as soon as possible, at its own speed, whole.
// `size` is `sizeof *options`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
//
// Pointers:
// `options` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_gesture_options_init(struct umo_gesture_options *options,
                                    size_t size)
UMO_NOEXCEPT;

// Fills a clip with its defaults: every part, 30 frames a second, no frames yet. `size` is
// `sizeof *clip`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
//
// Pointers:
// `clip` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_gesture_clip_init(struct umo_gesture_clip *clip,
                                 size_t size)
UMO_NOEXCEPT;

// Adds a gesture of the host's own to those that sessions of an engine know which are made from now
// on; one of the same name is replaced. `name` is 1 to 64 letters, digits, `_`, `-` and spaces.
// The clip comes in over its first 0.4 seconds, or up to its stroke if that is earlier, and goes
// out over its last 0.55 seconds. An engine takes 256.
//
// Threads: any but the audio thread. Allocates.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `OUT_OF_MEMORY`, `INVALID_ARGUMENT`
// (`umo_last_error` says which field).
//
// Pointers:
// `name` is NULL or ends with a zero byte; `clip` is NULL or as long as its `struct_size` says,
// with `rotations` as described.
UMO_API
UMO_MUST_USE
umo_status umo_engine_add_gesture(struct umo_engine *engine,
                                  const char *name,
                                  const struct umo_gesture_clip *clip)
UMO_NOEXCEPT;

// Adds a gesture as `umo_engine_add_gesture` does, of the animation in a `.glb`, `.gltf` or `.vrm` file
// of any character with the bones of a human: Mixamo's, VRM's, Unreal's, Unity's, Godot's or
// `umo animate`'s names are known. Files that a `.gltf` names are read from its folder. The motion is
// brought to the model's skeleton.
//
// `path` is UTF-8. `animation` is the name of one in the file, or NULL for its first, of at most two
// minutes. `parts` is a sum of `UMO_GESTURE_…`. `stroke` is seconds from its start to the stroke;
// negative: its middle.
//
// Threads: any but the audio thread. Allocates.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `IO`, `OUT_OF_MEMORY`, `INVALID_ARGUMENT`
// (`umo_last_error` says what of the file is wrong, which bones were not found, or which
// argument), `UNSUPPORTED` (the library was built without files, or without umo-capi's feature
// `retarget`).
//
// Pointers:
// `name` and `path` are NULL or end with a zero byte; so does `animation`.
UMO_API
UMO_MUST_USE
umo_status umo_engine_add_gesture_file(struct umo_engine *engine,
                                       const char *name,
                                       const char *path,
                                       const char *animation,
                                       uint32_t parts,
                                       float stroke)
UMO_NOEXCEPT;

// The same for a file's `size` bytes in memory, read during the call. A `.gltf` has its data in its
// text then.
//
// Threads: any but the audio thread. Allocates.
// Errors: as `umo_engine_add_gesture_file`, but for `IO`.
//
// Pointers:
// `name` is NULL or ends with a zero byte; so does `animation`. `data` is NULL or has `size`
// readable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_engine_add_gesture_memory(struct umo_engine *engine,
                                         const char *name,
                                         const void *data,
                                         size_t size,
                                         const char *animation,
                                         uint32_t parts,
                                         float stroke)
UMO_NOEXCEPT;

// The name of a gesture that sessions of an engine know: built-in ones first, in a fixed order,
// then the host's. Good until the engine is freed. To list them, count `index` up from 0 until
// `INVALID_ARGUMENT`.
//
// Threads: any but the audio thread. Waits for another thread's `umo_engine_add_gesture`.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (no such index).
//
// Pointers:
// `name` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_engine_get_gesture_name(const struct umo_engine *engine,
                                       uint32_t index,
                                       const char **name)
UMO_NOEXCEPT;

// Fills a model configuration with its defaults. `size` is `sizeof *config`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
//
// Pointers:
// `config` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_model_config_init(struct umo_model_config *config,
                                 size_t size)
UMO_NOEXCEPT;

// Loads a model from a file. `abi` is `UMO_ABI_VERSION`; `path` is UTF-8; `config` may be NULL.
//
// Threads: any but the audio thread. Allocates, reads the file, starts threads for as long as it
// takes, and waits for them: a base-size int8 model takes some 0.3 s.
// Errors: `VERSION`, `NULL_POINTER`, `IO`, `MODEL` (`umo_last_error` names the tensor or key),
// `OUT_OF_MEMORY`, `FULL` (1,024 models), `THREAD`, `INVALID_ARGUMENT`, `STRUCT_SIZE`,
// `UNSUPPORTED` (the library was built without files: docs/platforms.md, "Consoles").
//
// Pointers:
// `path` is NULL or ends with a zero byte; `config` is NULL or as long as its `struct_size` says;
// `model` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_model_load(uint32_t abi,
                          const char *path,
                          const struct umo_model_config *config,
                          struct umo_model **model)
UMO_NOEXCEPT;

// Loads a model from memory, which is not copied and not needed any more when the call returns:
// weights are repacked for the processor.
//
// Threads, errors: as `umo_model_load`, but for `IO` and `UNSUPPORTED`.
//
// Pointers:
// As `umo_model_load`; `data` is NULL or has `size` readable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_model_load_memory(uint32_t abi,
                                 const void *data,
                                 size_t size,
                                 const struct umo_model_config *config,
                                 struct umo_model **model)
UMO_NOEXCEPT;

// Frees a model. Its engines keep what they need of it. NULL is fine.
//
// Threads: any but the audio thread. Texts and names of the model are freed with it.
// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_model_free`
// again; it takes no other calls).
UMO_API umo_status umo_model_free(struct umo_model *model) UMO_NOEXCEPT;

// What a model has.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`.
//
// Pointers:
// `info` is NULL or as long as its `struct_size` says, and writable.
UMO_API
UMO_MUST_USE
umo_status umo_model_get_info(const struct umo_model *model,
                              struct umo_model_info *info)
UMO_NOEXCEPT;

// One of the model's texts, UTF-8, good until the model is freed. `which` is one of `UMO_MODEL_…`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`.
//
// Pointers:
// `text` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_model_get_text(const struct umo_model *model,
                              uint32_t which,
                              const char **text)
UMO_NOEXCEPT;

// The name of a face channel, as `jawOpen`, good until the model is freed. `index` is below
// `umo_model_info.channels`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`.
//
// Pointers:
// `name` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_model_get_channel_name(const struct umo_model *model,
                                      uint32_t index,
                                      const char **name)
UMO_NOEXCEPT;

// The name of a joint, as `left_elbow`: static, NULL where `index` is not below `UMO_JOINT_COUNT`.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_joint_name(uint32_t index) UMO_NOEXCEPT;

// The name of a viseme of the Oculus set, as `PP`: static, NULL where `index` is not below
// `UMO_VISEME_COUNT`.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_viseme_name(uint32_t index) UMO_NOEXCEPT;

// The bones: for each joint its parent's index, -1 for the first, and where it is in its parent's
// frame at rest, x y z, in `which` axes (one of `UMO_AXES_…`) and their unit. Either may be NULL;
// `joints` is how many there is room for, at least `UMO_JOINT_COUNT`. With rotations all identity
// the body stands in a T-pose.
//
// Threads: any. Never allocates, never waits.
// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT`, `BUFFER_TOO_SMALL`.
//
// Pointers:
// `parents` is NULL or has room for `joints` values; `offsets` is NULL or has room for
// `3 * joints` values.
UMO_API
UMO_MUST_USE
umo_status umo_model_get_skeleton(const struct umo_model *model,
                                  uint32_t which,
                                  int32_t *parents,
                                  float *offsets,
                                  size_t joints)
UMO_NOEXCEPT;

// The ids of a prompt, for `umo_session_set_prompt_ids`: at most `umo_model_info.max_prompt` of
// them. `count` is written even where there is no room for them all.
//
// Threads: any but the audio thread. Allocates.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `UNSUPPORTED` (the model takes no texts),
// `INVALID_ARGUMENT` (too long), `OUT_OF_MEMORY`, `BUFFER_TOO_SMALL`.
//
// Pointers:
// `text` is NULL or has `length` readable bytes; `ids` is NULL or has room for `capacity` values;
// `count` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_model_encode_text(const struct umo_model *model,
                                 const char *text,
                                 size_t length,
                                 uint32_t *ids,
                                 size_t capacity,
                                 size_t *count)
UMO_NOEXCEPT;

// What the parameter at `index` is, from 0 on: `INVALID_ARGUMENT` says that there are no more.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT`.
//
// Pointers:
// `info` is NULL or as long as its `struct_size` says, and writable.
UMO_API
UMO_MUST_USE
umo_status umo_parameter_get_info(uint32_t index,
                                  struct umo_parameter_info *info)
UMO_NOEXCEPT;

// The gain of each channel at which a whole recording's speech is heard, `count` interleaved samples at
// `sample_rate` per second. Ones for a plain recording; others are far from the level of speech, have
// channels that cancel each other, or speech in the channel in front alone (of five channels and more, the
// third). Multiply each channel with its gain before the samples are pushed into a session; `gains` has
// room for `channels` values, 1 to 64.
//
// Threads: any but the audio thread. Allocates.
// Errors: `NULL_POINTER`, `INVALID_ARGUMENT` (a rate or a number of channels out of range, or not a
// multiple of the channels), `PANIC`.
//
// Pointers:
// `samples` is NULL or has `count` readable values; `gains` is NULL or has room for `channels` values.
UMO_API
UMO_MUST_USE
umo_status umo_recording_gains(const float *samples,
                               size_t count,
                               uint32_t sample_rate,
                               uint32_t channels,
                               float *gains)
UMO_NOEXCEPT;

// Tests this machine with a model, for about 10 seconds or less: every kernel of every back-end that the processor has is
// compared with its scalar reference, the model's motion with recorded motion (a model without a record with a second
// run), and the model's speed is measured if the library has threads and a clock. `passed` is 1 if nothing is wrong.
// `report` is a text of several lines: processor, comparisons, faults, speed, and changes that would make it faster. It
// names no path, host or user. `size` is at least `UMO_SELF_TEST_SIZE`.
//
// Threads: any but the audio thread. Allocates, starts threads, and waits for them.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL` (nothing was tested), `OUT_OF_MEMORY`. Faults that
// the test finds are not errors of the call.
//
// Pointers:
// `passed` is NULL or writable; `report` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_self_test(const struct umo_model *model,
                         uint32_t *passed,
                         char *report,
                         size_t size)
UMO_NOEXCEPT;

// Fills a session configuration with the model's defaults: mono audio at the model's rate. `size`
// is `sizeof *config`.
//
// Threads: any. Allocates for a moment.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned),
// `OUT_OF_MEMORY`.
//
// Pointers:
// `config` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_session_config_init(struct umo_session_config *config,
                                   size_t size,
                                   const struct umo_model *model)
UMO_NOEXCEPT;

// How much memory `umo_session_new` takes from the allocator for such a session, in one piece:
// bytes and alignment. Either may be NULL.
//
// Threads: any but the audio thread. Allocates what `umo_session_new` takes from the system.
// Errors: as `umo_session_new`.
//
// Pointers:
// As `umo_session_new`; `size` and `alignment` are NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_memory(const struct umo_engine *engine,
                              const struct umo_session_config *config,
                              size_t *size,
                              size_t *alignment)
UMO_NOEXCEPT;

// Creates a session: one avatar at the start of its stream. `config` may be NULL.
//
// Threads: any but the audio thread. Allocates everything that the session will ever need, in one
// piece from the configuration's allocator, of the size that `umo_session_memory` gives. The system
// gives less than 1 KiB for the time of the call, and for the first session of a `sample_rate` that
// is not the model's the filter that converts it, which the engine keeps: to 16,000 samples per
// second 3 KiB from 48,000, 390 KiB from 44,100, and at most 1 MiB from any rate.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which
// number), `STRUCT_SIZE`, `FULL` (the engine's places, or 16,384 sessions in all),
// `OUT_OF_MEMORY`.
//
// Pointers:
// `config` is NULL or as long as its `struct_size` says, with `template_name` and `allocator` as
// described; `session` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_new(struct umo_engine *engine,
                           const struct umo_session_config *config,
                           struct umo_session **session)
UMO_NOEXCEPT;

// Frees a session. NULL is fine. From here on other calls on it get `INVALID_HANDLE`, so that
// threads that never pause do not keep it.
//
// Threads: any but the audio thread. Waits a millisecond or so for calls in progress. Where a
// chunk of it is just computed, its memory goes back with the next session that is made or freed,
// or with the engine.
// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_session_free`
// again; nothing was freed).
UMO_API umo_status umo_session_free(struct umo_session *session) UMO_NOEXCEPT;

// The detail of the last failed call on the session, from any thread: a copy in
// `buffer`, which has `size` bytes; `UMO_ERROR_SIZE` are enough. `length`, which may be NULL, gets
// its length without the end.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL`, `BUSY` (a call is just failing).
//
// Pointers:
// `buffer` is NULL or has `size` writable bytes; `length` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_last_error(const struct umo_session *session,
                                  char *buffer,
                                  size_t size,
                                  size_t *length)
UMO_NOEXCEPT;

// Takes audio for the avatar to speak: `count` interleaved samples, full scale 1, a multiple
// of the session's channel count. `taken`, which may be NULL, gets how many of them there was room for:
// the rest is to be pushed again later. Samples that are NaN, or beyond 1e6, become silence.
//
// Threads: one at a time, meant for the audio thread. Never allocates, never waits; at most one
// system call, to wake the engine.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not a multiple of the channel count),
// `BUSY` (another thread pushes), `FINISHED`, `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `samples` is NULL or has `count` readable values; `taken` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_push_audio(struct umo_session *session,
                                  const float *samples,
                                  size_t count,
                                  size_t *taken)
UMO_NOEXCEPT;

// `umo_session_push_audio` for 16-bit samples, whose full scale is 32,768.
//
// Threads, errors: as `umo_session_push_audio`.
//
// Pointers:
// As `umo_session_push_audio`.
UMO_API
UMO_MUST_USE
umo_status umo_session_push_audio_i16(struct umo_session *session,
                                      const int16_t *samples,
                                      size_t count,
                                      size_t *taken)
UMO_NOEXCEPT;

// Takes audio of who speaks to the avatar, so that it listens: `count` interleaved samples at the
// session's rate and channels, full scale 1. Only their loudness is used; samples that are no
// number count as silence.
//
// Threads: one at a time, beside any other call; meant for the thread that records. Never
// allocates, never waits, makes no system call.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not a multiple of the channel
// count), `BUSY` (another thread is in this call), `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `samples` is NULL or has `count` readable values.
UMO_API
UMO_MUST_USE
umo_status umo_session_push_other_audio(struct umo_session *session,
                                        const float *samples,
                                        size_t count)
UMO_NOEXCEPT;

// No more audio: the tail is completed, and `floor(seconds * 30)` frames come out in all. A second
// call changes nothing.
//
// Threads: any; not beside a push. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pushes), `FAILED`, `CLOSED`,
// `PANIC`.
UMO_API UMO_MUST_USE umo_status umo_session_finish(struct umo_session *session) UMO_NOEXCEPT;

// Drops everything that is not shown yet and eases to the rest pose within `ease_ms` milliseconds,
// at most 10,000: barge-in. Audio pushed from now on starts a new
// stream, whose frames follow the ease; the frame index goes on, and the avatar stays where it
// stands: the new stream's first frame is number `last + 1 + ease`, where `last` is the last frame
// that was handed out, by a pull or by a sample, and the ease takes
// `ceil(ease_ms * frame_rate / 1000)` frames. Sample from that time on to see it from its start.
// As many frames of the new stream, at most the session's `ease_ms`, come out of the rest pose, the face
// in a quarter of them.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `FAILED`, `CLOSED`, `PANIC`.
UMO_API
UMO_MUST_USE
umo_status umo_session_interrupt(struct umo_session *session,
                                 uint32_t ease_ms)
UMO_NOEXCEPT;

// Back to the start: everything that was pushed and not shown is dropped, the frame index starts
// at 0, and what follows is what a new session with the same settings gives.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `FAILED`, `CLOSED`, `PANIC`.
UMO_API UMO_MUST_USE umo_status umo_session_reset(struct umo_session *session) UMO_NOEXCEPT;

// Takes frames that are ready, in order, each once: as many as there are and as `size` bytes have
// room for in `layout`. `count` gets how many there were, 0 where none is ready.
//
// Threads: one at a time, beside any other call. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (the layout),
// `UNSUPPORTED` (the layout wants visemes that the model does not have), `BUFFER_TOO_SMALL` (not
// one frame fits), `BUSY` (another thread pulls); `FAILED`, `CLOSED`, `PANIC` when all that was
// ready has been pulled.
//
// Pointers:
// `layout` is NULL or as long as its `struct_size` says; `frames` is NULL or has `size` writable
// bytes; `count` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_pull_frames(struct umo_session *session,
                                   const struct umo_frame_layout *layout,
                                   void *frames,
                                   size_t size,
                                   size_t *count)
UMO_NOEXCEPT;

// How many frames `umo_session_pull_frames` would give.
//
// Threads: any; not beside a pull. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls), `PANIC`.
//
// Pointers:
// `count` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_ready_frames(struct umo_session *session,
                                    size_t *count)
UMO_NOEXCEPT;

// Whether the stream has ended: `done` becomes 1 when `umo_session_finish` was called and every
// frame was handed out, by pulls or by samples; before that 0. A session whose frames are only
// sampled learns here that no more will come.
//
// Threads: any; not beside a pull. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls); `FAILED`, `CLOSED`,
// `PANIC` where the rest will never come.
//
// Pointers:
// `done` is NULL or writable.
UMO_API UMO_MUST_USE umo_status umo_session_is_done(struct umo_session *session, uint32_t *done) UMO_NOEXCEPT;

// What time it is for the host, in seconds from any moment on, 0 to 1e9: from the first call on, what
// moves while no frames come, eases to it and back, and `idle_after_ms` go by this time, and no
// longer by the system's clock. For hosts that render slower or faster than real time, pause, or
// replay: call it with every picture, before `umo_session_sample_pose`. Times that go back are
// held; `umo_session_restore` goes back to the state's.
//
// Threads: one at a time, beside any other call but a pull or a sample. Never allocates, never
// waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not in 0 to 1e9), `BUSY` (another
// thread pulls), `PANIC`.
UMO_API
UMO_MUST_USE
umo_status umo_session_set_clock(struct umo_session *session,
                                 double seconds)
UMO_NOEXCEPT;

// The pose at `seconds` of the motion (frame index / 30), less `UMO_PARAMETER_OUTPUT_DELAY`, for a
// renderer at a rate of its own: rotations turn the shorter way, all else is linear. Frames before
// that time are taken as `umo_session_pull_frames` takes them. A time that is earlier than the oldest
// frame gives the oldest; one that is later than the newest gives what the idle mode says; times that
// go back are held. `sampled` may be NULL.
//
// Threads: one at a time, beside any other call but a pull. Never allocates, never waits.
// Errors: as `umo_session_pull_frames`, and `INVALID_ARGUMENT` for a time that is NaN or infinite;
// but a session that failed, or whose engine is gone, goes on to give its last pose:
// `umo_session_is_done` says so.
//
// Pointers:
// `layout` is NULL or as long as its `struct_size` says; `frame` is NULL or has `size` writable
// bytes; `sampled` is NULL or as long as its `struct_size` says, and writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_sample_pose(struct umo_session *session,
                                   double seconds,
                                   const struct umo_frame_layout *layout,
                                   void *frame,
                                   size_t size,
                                   struct umo_sampled *sampled)
UMO_NOEXCEPT;

// Sets the prompt from the next chunk on: `length` bytes of UTF-8, at most 128 ids'
// worth. No bytes end it.
//
// Threads: any but the audio thread. Allocates: `umo_session_set_prompt_ids` does not.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `UNSUPPORTED` (the model takes no texts),
// `INVALID_ARGUMENT` (no UTF-8, too long), `OUT_OF_MEMORY`, `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `text` is NULL or has `length` readable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_session_set_prompt(struct umo_session *session,
                                  const char *text,
                                  size_t length)
UMO_NOEXCEPT;

// The same as ids, as `umo_model_encode_text` gives them.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (too many, or one that the model
// does not have), `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `ids` is NULL or has `count` readable values.
UMO_API
UMO_MUST_USE
umo_status umo_session_set_prompt_ids(struct umo_session *session,
                                      const uint32_t *ids,
                                      size_t count)
UMO_NOEXCEPT;

// The seed of sampling from the next chunk on.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
UMO_API UMO_MUST_USE umo_status umo_session_set_seed(struct umo_session *session, uint64_t seed) UMO_NOEXCEPT;

// Sets a parameter, one of `UMO_PARAMETER_…`, within the range that `umo_parameter_get_info` says.
// Sampling changes with the next chunk, the idle mode and gains with the next frame that is handed
// out.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `BUSY`, `FAILED`, `CLOSED`,
// `PANIC`.
UMO_API
UMO_MUST_USE
umo_status umo_session_set_parameter(struct umo_session *session,
                                     uint32_t parameter,
                                     double value)
UMO_NOEXCEPT;

// A parameter's value.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `BUSY`, `PANIC`.
//
// Pointers:
// `value` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_get_parameter(const struct umo_session *session,
                                     uint32_t parameter,
                                     double *value)
UMO_NOEXCEPT;

// Looks at a point from the next frame on: `point` is three coordinates in the avatar's space, in
// the axes and units of `axes` (`UMO_AXES_…`), `strength` 0 to 1. The eyes turn first, then the
// head, then the trunk, as far as a body turns. A strength of 0 ends it. The point may be set anew
// for every frame.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (unknown axes, a coordinate that is
// not finite or beyond 10 km, a strength outside 0 to 1), `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `point` is NULL or has three readable values.
UMO_API
UMO_MUST_USE
umo_status umo_session_look_at(struct umo_session *session,
                               uint32_t axes,
                               const float *point,
                               float strength)
UMO_NOEXCEPT;

// Sets the mood of face and posture from the next frame on: `mood` is one of `UMO_MOOD_…`,
// `strength` 0 to 1. Changes are blended over a second.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `BUSY`, `FAILED`, `CLOSED`,
// `PANIC`.
UMO_API
UMO_MUST_USE
umo_status umo_session_set_mood(struct umo_session *session,
                                uint32_t mood,
                                float strength)
UMO_NOEXCEPT;

// Says that a sound is heard that one sees on the lips: `shape` is one of `UMO_LIPS_…`, `start` and
// `duration` are seconds of the audio that was pushed since the session began or was reset. The lips
// are in the shape then, and reach and leave it within 60 ms, whatever the model does; models without
// ARKit's shapes show nothing of it. Sounds may come in any order, before their audio or after it; one
// whose frames were pulled already shows no more. `umo_session_interrupt` drops those that wait.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (an unknown shape, a time that is no
// number of seconds from 0 on, or a duration outside 0 to 2), `BUSY` (64 sounds wait already: call
// again when the time of one has passed; or another thread is in a setter), `FAILED`, `CLOSED`,
// `PANIC`.
UMO_API
UMO_MUST_USE
umo_status umo_session_hint_lips(struct umo_session *session,
                                 uint32_t shape,
                                 double start,
                                 double duration)
UMO_NOEXCEPT;

// Plays a gesture over what the model does: its parts of the body ease to it and back, the others
// go on. `name` is one that `umo_engine_get_gesture_name` lists; upper case counts as lower case,
// and spaces and hyphens as underscores. Gestures of the same parts follow each other in the order
// of the calls; one with a time takes their place. `umo_session_interrupt` lets go of what plays
// and waits. `options` may be NULL.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (no gesture has the
// name, or an option is out of its range), `BUSY` (eight gestures wait already: call again when
// one has begun; or another thread is in a setter), `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `name` is NULL or ends with a zero byte; `options` is NULL or as long as its `struct_size` says.
UMO_API
UMO_MUST_USE
umo_status umo_session_play_gesture(struct umo_session *session,
                                    const char *name,
                                    const struct umo_gesture_options *options)
UMO_NOEXCEPT;

// How far motion is behind speech.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `PANIC`.
//
// Pointers:
// `latency` is NULL or as long as its `struct_size` says, and writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_latency(const struct umo_session *session,
                               struct umo_latency *latency)
UMO_NOEXCEPT;

// Statistics of the session.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `PANIC`.
//
// Pointers:
// `stats` is NULL or as long as its `struct_size` says, and writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_stats(const struct umo_session *session,
                             struct umo_stats *stats)
UMO_NOEXCEPT;

// Most bytes that a state of the session can have: the same for as long as it lives.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `PANIC`.
//
// Pointers:
// `size` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_state_size(const struct umo_session *session,
                                  size_t *size)
UMO_NOEXCEPT;

// Writes everything that the session is to `state`, which has `size` bytes, at least
// `umo_session_state_size`: audio that waits, frames that wait, history, settings. `written` gets
// how many bytes that took. They hold no address: they can be kept in a file, sent, and restored
// in another process. The session goes on as if nothing had happened. A chunk that is just computed is
// computed again by the session that is restored, which gives the frames that the state does not have.
//
// Threads: one at a time; not beside a push, a pull or a setter. Never allocates, never waits for a chunk.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (too few bytes), `BUSY` (another
// thread is in a call on the session: save again later), `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `state` is NULL or has `size` writable bytes; `written` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_save(struct umo_session *session,
                            void *state,
                            size_t size,
                            size_t *written)
UMO_NOEXCEPT;

// Makes the session what it, or another one of the same model and configuration, was when it was
// saved: the same calls then give the same frames, bit for bit, on any number of threads, whatever
// seed the session was made with. `size` is what `umo_session_save` wrote.
//
// Threads: one at a time; not beside a push, a pull or a setter. Never allocates, never waits for a chunk.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STATE` (the bytes are no state of such a session:
// `umo_session_last_error` says what disagrees), `BUSY` (as `umo_session_save`, or a chunk of this
// session is just computed: restore again later, or into a session to which no audio was pushed), `FAILED`,
// `CLOSED`, `PANIC`.
//
// Pointers:
// `state` is NULL or has `size` readable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_session_restore(struct umo_session *session,
                               const void *state,
                               size_t size)
UMO_NOEXCEPT;

// Bytes of the longest packet of the session; 0 where it was made without packets.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `PANIC`.
//
// Pointers:
// `size` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_packet_size(const struct umo_session *session,
                                   size_t *size)
UMO_NOEXCEPT;

// Takes packets that are ready, in order, each once, of a session whose configuration has `packets`:
// as many as there are, as `bytes` has room for and at most `most`, back to back. `lengths[i]` gets
// the bytes of each, `count` how many there were. `size` is at least what `umo_session_packet_size`
// says. Each packet is to be sent to the decoders as it is; what of it is lost, doubled or out of
// order they make good.
//
// Threads: one at a time, beside any other call. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (a session without packets),
// `BUFFER_TOO_SMALL`, `BUSY` (another thread pulls packets); `FAILED`, `CLOSED`, `PANIC` when all
// that was ready has been pulled.
//
// Pointers:
// `bytes` is NULL or has `size` writable bytes; `lengths` is NULL or has `most` writable values;
// `count` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_pull_packets(struct umo_session *session,
                                    void *bytes,
                                    size_t size,
                                    size_t *lengths,
                                    size_t most,
                                    size_t *count)
UMO_NOEXCEPT;

// Creates a decoder: a session whose frames come of packets, on the side where an avatar is seen. It
// needs no engine. Every `umo_session_…` call works on it but those that take audio, texts or a
// state, and `umo_session_interrupt`: these are for its sender. `umo_session_free` frees it. Of
// `config`, which may be NULL, `target`, `lookahead` and `smoothing` are the sender's, and the model is
// the same file at the same precision; layers, seed, idle mode, ease, queue and `patience` are its own.
// `allocator` is NULL: its memory comes from the system.
//
// Threads: any but the audio thread. Allocates everything that the decoder will ever need.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which
// number), `STRUCT_SIZE`, `FULL` (16,384 sessions in all), `OUT_OF_MEMORY`.
//
// Pointers:
// `config` is NULL or as long as its `struct_size` says; `decoder` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_decoder_new(const struct umo_model *model,
                           const struct umo_session_config *config,
                           struct umo_session **decoder)
UMO_NOEXCEPT;

// Takes a packet of `size` bytes, and computes the frames that it makes final. Packets may be lost,
// come twice, late and in any order: what is missing when a later one has come, and `patience` more,
// is made up for, and the next packet leads back. A refused packet changes nothing.
//
// Threads: one at a time, beside any other call; meant for the thread that receives. Never
// allocates, never waits; takes the time of a chunk's motion decoders.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `PACKET` (`umo_session_last_error` says what is wrong
// with it), `INVALID_ARGUMENT` (a session that is no decoder), `BUSY` (another thread pushes, or
// the queue of frames is full: take some, then push it again), `FAILED`, `PANIC`.
//
// Pointers:
// `packet` is NULL or has `size` readable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_decoder_push_packet(struct umo_session *decoder,
                                   const void *packet,
                                   size_t size)
UMO_NOEXCEPT;

// What came of a decoder's packets.
//
// Threads: any; not beside a push. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (a session that is no
// decoder), `BUSY` (another thread pushes), `PANIC`.
//
// Pointers:
// `stats` is NULL or as long as its `struct_size` says, and writable.
UMO_API
UMO_MUST_USE
umo_status umo_decoder_stats(const struct umo_session *decoder,
                             struct umo_received *stats)
UMO_NOEXCEPT;

// What a status says, and what to do about it: static, never NULL, in English.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_status_message(umo_status status) UMO_NOEXCEPT;

// The detail of this thread's last failed call of a function that names no session; with it, which
// key, file, tensor or argument. Never NULL; in fixed storage of the thread's own, which the
// thread's next failure overwrites.
//
// Threads: any but the audio thread. Never waits. Calls on sessions keep their detail with the
// session: `umo_session_last_error`.
UMO_API const char *umo_last_error(void) UMO_NOEXCEPT;

// The name of a figure, as `alex`: static, NULL where there are no more. The first is the default.
// NULL in a library that was built without the writer of glTF.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_figure_name(uint32_t index) UMO_NOEXCEPT;

// Fills a clip with what is a model's: skeleton, face channels, frame rate, and with the default
// figure. What it points to is good until the model is freed. `size` is `sizeof *clip`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
//
// Pointers:
// `clip` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_clip_init(struct umo_clip *clip,
                         size_t size,
                         const struct umo_model *model)
UMO_NOEXCEPT;

// Writes frames as a file of `format`, one of `UMO_FORMAT_…`, piece by piece: the same bytes as
// `umo animate` writes. `umo_clip_write_file` writes one on disk.
//
// Threads: any but the audio thread. Allocates up to six times the frames' size and 16 MB; a figure
// takes some 0.7 s of a core, half of it on a second thread where the system starts one.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (`umo_last_error` says what of the clip
// is wrong), `IO` (`output` stopped it), `OUT_OF_MEMORY`, `UNSUPPORTED` (the library was built
// without the writer of glTF).
//
// Pointers:
// `clip` is NULL or as long as its `struct_size` says, and what it points to is as described; `output`
// is NULL or readable, with a `write` that is NULL or as described.
UMO_API
UMO_MUST_USE
umo_status umo_clip_write(const struct umo_clip *clip,
                          uint32_t format,
                          const struct umo_output *output)
UMO_NOEXCEPT;

// The same into a file, which appears whole or not at all: on an error, one of that name stays as it
// was. `path` is UTF-8, on every system.
//
// Threads: any but the audio thread. Allocates, writes the file, and waits until it is on the disk.
// Errors: as `umo_clip_write`; `IO` (`umo_last_error` has the path and what the system says),
// `UNSUPPORTED` also where the library was built without files.
//
// Pointers:
// As `umo_clip_write`; `path` is NULL or ends with a zero byte.
UMO_API
UMO_MUST_USE
umo_status umo_clip_write_file(const struct umo_clip *clip,
                               uint32_t format,
                               const char *path)
UMO_NOEXCEPT;

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* UMO_H */
