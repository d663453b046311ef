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

// Version of this interface: major number in the upper 16 bits, minor number in the lower. A library
// serves programs with the same major number and at most its own minor number.
#define UMO_ABI_VERSION 1

// glTF and Godot: Y up, right-handed, metres; the avatar looks along +Z, its left hand is towards +X.
#define UMO_AXES_GLTF 0

// Unreal: Z up, left-handed, centimetres; the avatar looks along +X, its right hand is towards +Y.
#define UMO_AXES_UNREAL 1

// Unity: Y up, left-handed, metres; the avatar looks along +Z, its right hand is towards +X.
#define UMO_AXES_UNITY 2

// The engine computes on its own threads.
#define UMO_ENGINE_THREADS 0

// The host computes by calling `umo_engine_poll`.
#define UMO_ENGINE_POLLED 1

// Default priority of the process's new threads.
#define UMO_PRIORITY_NORMAL 0

// Priority above normal: frames are nearly as fast beside a program that keeps every core busy. Linux
// refuses it to most users; Windows, Android and Apple's systems grant it.
#define UMO_PRIORITY_HIGH 1

// Priority below normal: threads use the time that others leave.
#define UMO_PRIORITY_LOW 2

// On a machine with fast and slow cores: a crowd on the kind whose cores are the fastest together; what one slower core
// computes with room to spare, on that core, unless the priority is high.
#define UMO_CORES_AUTO 0

// Threads run wherever the system puts them.
#define UMO_CORES_SYSTEM 1

// The fastest kind of cores alone.
#define UMO_CORES_PERFORMANCE 2

// The slowest kind of cores that is not low-power, alone.
#define UMO_CORES_EFFICIENCY 3

// Offset meaning: do not write this field.
#define UMO_ABSENT 4294967295

// The right hand; for a gesture with a target, the hand nearer to it.
#define UMO_SIDE_AUTO 0

// The left hand: the whole gesture is mirrored.
#define UMO_SIDE_LEFT 1

// The right hand.
#define UMO_SIDE_RIGHT 2

// Both hands if the gesture supports it, otherwise as `UMO_SIDE_AUTO`.
#define UMO_SIDE_BOTH 3

// Neck and head.
#define UMO_GESTURE_HEAD 1

// Spine.
#define UMO_GESTURE_TRUNK 2

// Left arm, from collar to fingers.
#define UMO_GESTURE_LEFT_ARM 4

// Right arm, from collar to fingers.
#define UMO_GESTURE_RIGHT_ARM 8

// Log level: information.
#define UMO_LOG_INFO 1

// Log level: warning.
#define UMO_LOG_WARNING 2

// Log level: error.
#define UMO_LOG_ERROR 3

// Weights as stored in the file.
#define UMO_PRECISION_STORED 0

// All products in f32.
#define UMO_PRECISION_F32 1

// Weights rounded to bfloat16.
#define UMO_PRECISION_BF16 2

// Weights rounded to int8.
#define UMO_PRECISION_INT8 3

// All networks of the model.
#define UMO_PARTS_ALL 0

// The live mouth alone, at its stored precision: a fraction of the memory. Sessions need `UMO_VOICE_MOUTH`, and engines have
// no threads.
#define UMO_PARTS_MOUTH 1

// The fastest instruction set of the processor.
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

// Added to one of the others: the same bits on every processor, from the same sound. docs/packets.md says when it pays.
#define UMO_ISA_PORTABLE 256

// Name of the model.
#define UMO_MODEL_NAME 1

// Licence of its weights.
#define UMO_MODEL_LICENSE 2

// Notice that must be shown to users; may be empty.
#define UMO_MODEL_NOTICE 3

// Instruction set that the model was packed for, such as `avx512vnni`.
#define UMO_MODEL_ISA 4

// Prompts that the model was trained with, one a line; empty if it has no list.
#define UMO_MODEL_PROMPTS 5

// Visemes per frame.
#define UMO_VISEME_COUNT 15

// Joints of every model.
#define UMO_JOINT_COUNT 55

// Sampling temperature: 0 always takes the likeliest code; the model's default is the value it was tuned for.
#define UMO_PARAMETER_TEMPERATURE 1

// Top-k sampling: number of the likeliest codes to sample from; 0 for all.
#define UMO_PARAMETER_TOP_K 2

// Top-p sampling: samples from the likeliest codes that together reach this probability.
#define UMO_PARAMETER_TOP_P 3

// Idle mode, while no audio comes: one of `UMO_IDLE_…`.
#define UMO_PARAMETER_IDLE 4

// Gain of the face's motion, jaw and eyes included: 0 is at rest, 1 as computed, 2 exaggerated.
#define UMO_PARAMETER_GAIN_FACE 16

// Gain of the fingers' motion.
#define UMO_PARAMETER_GAIN_HANDS 17

// Gain of the motion of spine, neck, head and arms.
#define UMO_PARAMETER_GAIN_UPPER 18

// Gain of the motion of pelvis and legs, and of the body through the world.
#define UMO_PARAMETER_GAIN_LOWER 19

// Attention of the avatar: one of `UMO_ATTENTION_…`.
#define UMO_PARAMETER_ATTENTION 5

// Delay of the output device in seconds, from playing a sound to hearing it: `umo_session_sample_pose`
// shows a pose that much earlier. 0 to 2; some 0.2 for Bluetooth.
#define UMO_PARAMETER_OUTPUT_DELAY 6

// Activity of the hands, 0 to 1: how often they leave rest. 0.5 is the default; at 1 they hardly rest, at 0 hardly rise.
#define UMO_PARAMETER_ACTIVITY 7

// Expression, 0 to 1: how far body and face follow the arousal of the voice. 0.5 is the default, 0 ignores the voice.
#define UMO_PARAMETER_EXPRESSION 8

// Strength of the layer of blinks, gaze and lids over the model's motion, 0 to 1.
#define UMO_PARAMETER_LAYER_GAZE 32

// Strength of breath, sway, weight shifts and fingers, and of hands at rest between gestures.
#define UMO_PARAMETER_LAYER_IDLE 33

// Strength of the asymmetry between the face's left and right.
#define UMO_PARAMETER_LAYER_ASYMMETRY 34

// Strength of nods on accents, and while listening.
#define UMO_PARAMETER_LAYER_NODS 35

// Strength of the mood's face and posture; without a mood, strength of removing a frown that no mood asked
// for.
#define UMO_PARAMETER_LAYER_MOOD 36

// Strength of planted feet, steps, and the root's return to where it stood.
#define UMO_PARAMETER_LAYER_FEET 37

// Strength of trunk, shoulders and legs that go with the hands.
#define UMO_PARAMETER_LAYER_BODY 38

// Speaking while its own audio is heard, otherwise idle; in a scene, and after `umo_session_push_other_audio`, also
// listening.
#define UMO_ATTENTION_AUTO 0

// Nothing in particular.
#define UMO_ATTENTION_IDLE 1

// The one who speaks: the avatar looks there, nods, and raises its brows.
#define UMO_ATTENTION_LISTENING 2

// An answer to give: the avatar looks away.
#define UMO_ATTENTION_THINKING 3

// Its own speech.
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

// The parameter takes only whole numbers.
#define UMO_PARAMETER_WHOLE 1

// Maximum length in bytes of a self-test's report, including its terminating zero.
#define UMO_SELF_TEST_SIZE 8192

// The mouth moves with the body, later than the sound by the session's latency.
#define UMO_VOICE_DELAYED 0

// The mouth follows the sound after `umo_latency.mouth_samples`: with the default model 11 ms at 16 kHz,
// 18 ms at 48 kHz. The body follows after the session's latency, and the stream has correspondingly more
// frames at its end. For a microphone, or a voice that is played as it arrives.
#define UMO_VOICE_LIVE 1

// The mouth alone, timed as with `UMO_VOICE_LIVE`: no chunk is computed, and the engine has nothing to do. The body is at
// rest, with the layers over it: it breathes, looks, nods and gestures as asked. For voice chat; the one voice of a model
// loaded with `UMO_PARTS_MOUTH`.
#define UMO_VOICE_MOUTH 2

// Chunks are output as frames only.
#define UMO_PACKETS_NONE 0

// Chunks are output as frames and as packets: pull both.
#define UMO_PACKETS_BESIDE_FRAMES 1

// Chunks are output as packets only, for a server whose avatars are shown elsewhere.
#define UMO_PACKETS_ONLY 2

// Maximum length in bytes of an error's detail, including its terminating zero.
#define UMO_ERROR_SIZE 512

// The member's looks: at whom, and away.
#define UMO_SCENE_LOOK 1

// Nods and raised brows of the member while it listens.
#define UMO_SCENE_NOD 2

// Half smiles of the member while it listens.
#define UMO_SCENE_SMILE 4

// Lean and shifts of weight of the member, its own and those that follow another's.
#define UMO_SCENE_MIRROR 8

// Giving way to who interrupts the member.
#define UMO_SCENE_YIELD 16

// Nobody speaks.
#define UMO_ROLE_IDLE 0

// Another member speaks.
#define UMO_ROLE_LISTENING 1

// The member speaks.
#define UMO_ROLE_SPEAKING 2

// Upper bound on the members of a scene.
#define UMO_SCENE_MEMBER_COUNT 32

// Binary glTF 2.0, `.glb`: a skinned figure, or the skeleton alone.
#define UMO_FORMAT_GLB 1

// VRM Animation 1.0, `.vrma`, for any VRM avatar.
#define UMO_FORMAT_VRMA 2

// An engine. A handle, never a pointer to memory.
typedef struct umo_engine umo_engine;

// A loaded model. A handle, never a pointer to memory.
typedef struct umo_model umo_model;

// A character of the host's that poses are put on. A handle, never a pointer to memory.
typedef struct umo_retarget umo_retarget;

// A scene: up to `UMO_SCENE_MEMBER_COUNT` members. A handle, never a pointer to memory.
typedef struct umo_scene umo_scene;

// A session: one avatar. A handle, never a pointer to memory.
typedef struct umo_session umo_session;

// A take: a motion that was recorded, with what its host asked for. A handle, never a pointer to memory.
typedef struct umo_take umo_take;

// Result of a call: `UMO_STATUS_OK`, or a negative error code. Numbers are never reused.
typedef int32_t umo_status;

// Lends the threads of the host's job system to an engine. Each `umo_engine_poll` calls `submit` once
// for every compute thread except its own; the host then runs `job(context)` on another thread as soon
// as it can. The job computes until the poll is over and needs 1 MiB of stack. A job that runs late, or
// never, costs only speed. A job that runs after the engine was freed, or inside `submit`, returns at
// once.
typedef struct umo_jobs {
    // Passed to `submit`.
    void *userdata;
    // Submits a job. Called on the polling thread; must not wait for a job that runs on another thread,
    // and must not throw.
    void (*submit)(void *userdata, void (*job)(void *context), void *context);
} umo_jobs;

// A log callback. Called only by the functions that make and free models, engines and sessions or encode a
// text, on the calling thread; never by calls for the audio thread or the game thread, nor on the engine's
// threads.
typedef struct umo_log {
    // Passed to `write`.
    void *userdata;
    // Receives one of `UMO_LOG_…` and a zero-terminated text, valid until it returns. Must not throw.
    void (*write)(void *userdata, uint32_t level, const char *message);
} umo_log;

// Configuration of an engine. Initialise it with `umo_engine_config_init`.
typedef struct umo_engine_config {
    // `sizeof(umo_engine_config)`.
    uint32_t struct_size;
    // Threads that compute: one of `UMO_ENGINE_…`.
    uint32_t mode;
    // Number of compute threads, 1 to 64. With `UMO_ENGINE_POLLED` the polling thread is one of them, and
    // the engine starts the others unless `jobs` lends them.
    uint32_t threads;
    // Maximum number of sessions at once, 1 to 4,096.
    uint32_t max_sessions;
    // Maximum number of sessions in a batch, 1 to 64: larger batches read the weights less often and need
    // more memory.
    uint32_t max_batch;
    // Number of `cores`, 0 to 64.
    uint32_t core_count;
    // Processor numbers to pin the engine's own threads to, one thread each; threads beyond `core_count`
    // are not pinned. NULL pins none.
    const uint32_t *cores;
    // Lends the host's threads, which compute in place of the engine's own; or NULL. Only with
    // `UMO_ENGINE_POLLED`.
    const struct umo_jobs *jobs;
    // Log callback for this engine and its sessions, or NULL.
    const struct umo_log *log;
    // Priority of the engine's own threads: one of `UMO_PRIORITY_…`. If the system refuses it, they run at
    // `UMO_PRIORITY_NORMAL`, and `log` gets a warning that says what would permit it.
    uint32_t priority;
    // Batching window, milliseconds: the longest that a due chunk waits for others to be computed with. With 50 ms,
    // 32 avatars take about a fifth less processor time, and frames come later by the wait. A chunk does not wait at the
    // start of a stream, once at most half of its length is left until it would be late, or if all sessions are due.
    // 0: no chunk waits.
    uint32_t batch_window_ms;
    // Kinds of cores that the engine's own threads run on if `core_count` is 0: one of `UMO_CORES_…`. All but
    // `UMO_CORES_SYSTEM` start at most as many threads as the kind has cores. No effect where all cores are of one kind.
    uint32_t core_kinds;
} umo_engine_config;

// Layout of a frame in the host's memory: offsets in bytes from the frame's start. A value whose offset
// is `UMO_ABSENT` is not written, and bytes between values are left alone, so that frames can be the
// host's own structures. Initialise it with `umo_frame_layout_init`.
//
// Offsets and strides are multiples of the values' alignment in C: 4, and for `index` and `sample` that
// of `uint64_t`, which then also applies to `frame_stride`. Values must not overlap, not even in one
// byte, but values of different kinds may be interleaved. A layout that breaks this is
// `INVALID_ARGUMENT`, and `umo_last_error` names the fields.
typedef struct umo_frame_layout {
    // `sizeof(umo_frame_layout)`.
    uint32_t struct_size;
    // One of `UMO_AXES_…`.
    uint32_t axes;
    // Bytes from one frame to the next, at least up to the end of the last value.
    uint32_t frame_stride;
    // `uint64_t`: number of the frame since the start or the last reset; there are
    // `umo_model_info.frame_rate` frames per second.
    uint32_t index;
    // `uint64_t`: sample of the pushed audio, counted per channel, that the frame belongs to.
    uint32_t sample;
    // `float[3]`: translation of the root, to be added to the first joint's offset in
    // `umo_model_get_skeleton`. The floor is at 0 as in the model.
    uint32_t translation;
    // `float[4]` of the first joint: its rotation in its parent's frame, a unit quaternion x, y, z, w.
    uint32_t rotations;
    // Bytes from one joint's rotation to the next, at least 16.
    uint32_t rotation_stride;
    // `float` of the first face channel.
    uint32_t channels;
    // Bytes from one channel to the next, at least 4.
    uint32_t channel_stride;
    // `float[UMO_VISEME_COUNT]`: weights of the visemes; they sum to 1.
    uint32_t visemes;
    // Zero, as `umo_frame_layout_init` sets it: anything else is `INVALID_ARGUMENT`.
    uint32_t reserved;
} umo_frame_layout;

// Playback options of a gesture. Initialise them with `umo_gesture_options_init`.
typedef struct umo_gesture_options {
    // `sizeof(umo_gesture_options)`.
    uint32_t struct_size;
    // The hand: one of `UMO_SIDE_…`.
    uint32_t side;
    // Axes and units of `target`: one of `UMO_AXES_…`.
    uint32_t axes;
    // 1 if `target` is set, else 0.
    uint32_t has_target;
    // Time of the stroke, in seconds of the motion; the preparation begins correspondingly earlier.
    // Negative: as soon as no other gesture uses its parts.
    double at;
    // Playback speed, 0.5 to 2.
    float speed;
    // Strength, 0 to 1: lower values stay closer to the model's motion.
    float strength;
    // Point in the avatar's space, for pointing gestures; without one they point ahead.
    float target[3];
    // Variant, 0 to 255: 0 is the gesture as drawn; others go through its poses in turn, and each number has a
    // size, height and speed of its own.
    uint32_t variant;
} umo_gesture_options;

// A clip of the host's to make a gesture from. Initialise it with `umo_gesture_clip_init`.
typedef struct umo_gesture_clip {
    // `sizeof(umo_gesture_clip)`.
    uint32_t struct_size;
    // Axes of the rotations: one of `UMO_AXES_…`.
    uint32_t axes;
    // Parts of the body that it moves: a sum of `UMO_GESTURE_…`. The position and walking of the body stay
    // the model's.
    uint32_t parts;
    // Number of frames, 2 to 3,600.
    uint32_t frame_count;
    // Frames per second, 1 to 240.
    float rate;
    // Seconds from the first frame to the stroke.
    float stroke;
    // `float[frame_count][UMO_JOINT_COUNT][4]`: rotation of each joint in its parent's frame, a quaternion
    // x, y, z, w; identity in all joints is a T-pose. Read during the call.
    const float *rotations;
} umo_gesture_clip;

// Options for loading a model. Initialise them with `umo_model_config_init`.
typedef struct umo_model_config {
    // `sizeof(umo_model_config)`.
    uint32_t struct_size;
    // One of `UMO_PRECISION_…`.
    uint32_t precision;
    // Upper bound on the instruction set: one of `UMO_ISA_…`. Float products round differently on some of
    // them, so a session can give other frames, unless `UMO_ISA_PORTABLE` is added: docs/spec.md, section 2.9, says
    // which give equal ones.
    uint32_t isa;
    // Networks to load: one of `UMO_PARTS_…`.
    uint32_t parts;
    // Log callback for this model, or NULL. The structure is copied while the model is loaded.
    const struct umo_log *log;
} umo_model_config;

// Properties of a model. Set `struct_size`; `umo_model_get_info` writes the rest.
typedef struct umo_model_info {
    // `sizeof(umo_model_info)`.
    uint32_t struct_size;
    // Frames per second: 30.
    uint32_t frame_rate;
    // Sample rate of the model's input in Hz; sessions take any rate and resample.
    uint32_t sample_rate;
    // Joints of the body: the 55 of SMPL-X.
    uint32_t joints;
    // Face channels.
    uint32_t channels;
    // 1 if face channels are the 52 ARKit blendshapes, 0 to 1; 0 if they are SMPL-X expression
    // coefficients.
    uint32_t is_arkit;
    // Frames from one keyframe to the next.
    uint32_t keyframe_stride;
    // Keyframes predicted per chunk by default.
    uint32_t target;
    // Maximum number of keyframes per chunk.
    uint32_t max_target;
    // Frames held back by default.
    uint32_t lookahead;
    // Frames of future speech that a frame needs at most, with the default configuration.
    uint32_t latency_frames;
    // Maximum number of ids in a prompt.
    uint32_t max_prompt;
    // 1 if texts can be prompts, so that `umo_session_set_prompt` works.
    uint32_t has_text;
    // 1 if `UMO_MODEL_NOTICE` must be shown to users: for example, that the model was never trained.
    uint32_t has_notice;
    // Size of the model file in bytes.
    uint64_t file_size;
    // 1 if the model has a mouth network, so that sessions can use `UMO_VOICE_LIVE` and `UMO_VOICE_MOUTH`.
    uint32_t has_mouth;
    // Upper bound on `umo_session_config.horizon`: keyframes of audio behind a chunk that a session can
    // wait for. Useful if the whole recording is available. 0 if the model does not hear ahead.
    uint32_t max_horizon;
} umo_model_info;

// Description of a parameter. Set `struct_size`; `umo_parameter_get_info` writes the rest.
typedef struct umo_parameter_info {
    // `sizeof(umo_parameter_info)`.
    uint32_t struct_size;
    // Number of the parameter, `UMO_PARAMETER_…`.
    uint32_t id;
    // `UMO_PARAMETER_WHOLE` or 0.
    uint32_t flags;
    // Zero.
    uint32_t reserved;
    // Smallest value.
    double minimum;
    // Largest value.
    double maximum;
    // Name of the parameter: static.
    const char *name;
} umo_parameter_info;

// Allocator for a session's memory. Both functions are required. They are called by `umo_session_new`,
// by `umo_session_free` and, if a session was freed while a chunk of it was being computed, by the next
// call of either or `umo_engine_free`; always on the thread of that call. They must not throw, nor call
// functions of this library.
typedef struct umo_allocator {
    // Passed to both functions.
    void *userdata;
    // Returns `size` bytes aligned to `alignment`, a power of two, or NULL.
    void *(*allocate)(void *userdata, size_t size, size_t alignment);
    // Releases memory from `allocate`.
    void (*release)(void *userdata, void *memory, size_t size, size_t alignment);
} umo_allocator;

// Configuration of a session. Initialise it with `umo_session_config_init`.
typedef struct umo_session_config {
    // `sizeof(umo_session_config)`.
    uint32_t struct_size;
    // Sample rate of the pushed audio in Hz, 8,000 to 192,000.
    uint32_t sample_rate;
    // Interleaved channels of the pushed audio, 1 to 64; they are mixed.
    uint32_t channels;
    // Keyframes predicted per chunk, 1 to `umo_model_info.max_target`: fewer respond sooner, more give each
    // chunk more context.
    uint32_t target;
    // Frames held back until the next chunk, for smoother seams; they add to the latency.
    uint32_t lookahead;
    // Behaviour during silence: one of `UMO_IDLE_…`.
    uint32_t idle;
    // Milliseconds without audio after which `idle` begins.
    uint32_t idle_after_ms;
    // Duration in milliseconds of the ease to rest, and of the way back.
    uint32_t ease_ms;
    // Capacity of the queue of frames, at least two chunks' worth: the engine pauses while it is full.
    uint32_t queue_frames;
    // Timing of the mouth, and whether there is a body: one of `UMO_VOICE_…`.
    uint32_t voice;
    // Seed of all sampling: equal seeds and audio give equal frames.
    uint64_t seed;
    // Template of the model: NULL for `audio_to_motion`; `text_to_motion` needs no audio. For the latter,
    // `umo text` uses a `guidance` of 2.5 and a temperature of at most 0.7 (`UMO_PARAMETER_TEMPERATURE`);
    // the defaults here are for speech.
    const char *template_name;
    // Allocator of the session's memory, or NULL for the system's. Read while the session is made; its
    // functions and `userdata` must stay valid until the engine is freed.
    const struct umo_allocator *allocator;
    // Standard deviation, in frames, of a low-pass over the body's motion, 0 to 1.5; 0 for none. If
    // `lookahead` is less, it looks two standard deviations ahead, 3 frames at most.
    float smoothing;
    // Strength of the prompt's guidance, 1 to 3, for models of layout `frames`: 1 uses the prompt alone, at
    // half the cost of other values. Other models: 1.
    float guidance;
    // Keyframes of audio behind a chunk that the chunk waits for, if the model was trained to hear ahead;
    // they add to the latency. Otherwise 0.
    uint32_t horizon;
    // Output of chunks as packets: one of `UMO_PACKETS_…`.
    uint32_t packets;
    // Keyframes before its chunk that a packet repeats, as many as fit the model's history. With a chunk's
    // worth of them, the loss of one packet changes nothing.
    uint32_t packet_history;
    // Decoders only: packets that may arrive before a missing one counts as lost, 0 to 4.
    uint32_t reorder_window;
    // Bytes of memory for a take that is recorded while the session runs (`umo_session_take`), some 700 a second; 0 for none.
    // Not with `UMO_VOICE_LIVE`, `UMO_VOICE_MOUTH`, `UMO_PACKETS_ONLY` or decoders.
    uint64_t take_bytes;
} umo_session_config;

// Range of times available to `umo_session_sample_pose`. Set `struct_size`; the call writes the rest.
typedef struct umo_sampled {
    // `sizeof(umo_sampled)`.
    uint32_t struct_size;
    // 1 if the requested time was later than the newest frame.
    uint32_t is_ahead;
    // Time in seconds of the oldest frame that is still available.
    double oldest;
    // Time in seconds of the newest frame that is ready.
    double newest;
} umo_sampled;

// Delay of motion behind speech. Set `struct_size`; `umo_session_latency` writes the rest.
typedef struct umo_latency {
    // `sizeof(umo_latency)`.
    uint32_t struct_size;
    // Zero.
    uint32_t reserved;
    // Upper bound on the future audio that a frame needs, in samples at the session's rate: no processor
    // can shorten it. It follows from the configuration's `target`, `lookahead`, `smoothing`, `horizon`
    // and `sample_rate`.
    uint64_t algorithmic_samples;
    // Median computing time in seconds: from a chunk's last sample, or from the end of the previous chunk
    // if that is later, to the chunk's frames.
    double compute_p50;
    // 99th percentile of the computing time.
    double compute_p99;
    // 99.9th percentile of the computing time.
    double compute_p999;
    // Largest computing time.
    double compute_max;
    // Current delay of the newest frame behind the newest audio, beyond `algorithmic_samples`, in samples
    // at the session's rate: 0 while the engine keeps up.
    uint64_t backlog_samples;
    // The largest backlog since the session was made.
    uint64_t backlog_max_samples;
    // Upper bound on the future audio that a frame's mouth needs, in samples at the session's rate:
    // `algorithmic_samples`, or less with `UMO_VOICE_LIVE`.
    uint64_t mouth_samples;
} umo_latency;

// Statistics of a session. Set `struct_size`; `umo_session_stats` writes the rest.
typedef struct umo_stats {
    // `sizeof(umo_stats)`.
    uint32_t struct_size;
    // Zero.
    uint32_t reserved;
    // Chunks computed.
    uint64_t chunks;
    // Frames computed.
    uint64_t frames;
    // Frames whose chunk was computed too late for real time.
    uint64_t late_frames;
    // Frames that an interrupt or a reset dropped before they were shown.
    uint64_t dropped_frames;
    // Samples per channel that were not taken because there was no room.
    uint64_t overruns;
    // Samples that were NaN, infinite or beyond 1e6, and were replaced by silence.
    uint64_t silenced;
    // Chunks whose body was held because the engine did not keep up (`umo_engine_set_late_limit`).
    uint64_t held_chunks;
} umo_stats;

// Statistics of a decoder's packets. Set `struct_size`; `umo_decoder_stats` writes the rest.
typedef struct umo_received {
    // `sizeof(umo_received)`.
    uint32_t struct_size;
    // Zero.
    uint32_t reserved;
    // Packets accepted.
    uint64_t packets;
    // Packets that arrived too late or a second time and were ignored.
    uint64_t late;
    // Chunks whose packet did not arrive in time.
    uint64_t lost;
    // Keyframes of lost chunks that no other packet repeated, so that the last pose was held.
    uint64_t held;
} umo_received;

// Properties of a take. Set `struct_size`; `umo_take_get_info` writes the rest.
typedef struct umo_take_info {
    // `sizeof(umo_take_info)`.
    uint32_t struct_size;
    // Version of its format.
    uint32_t version;
    // Frames.
    uint32_t frames;
    // Frames per second.
    uint32_t frame_rate;
    // Packets.
    uint32_t packets;
    // Sample rate of the host's audio in Hz: that of a frame's sample while the take plays.
    uint32_t sample_rate;
    // Seed of all sampling.
    uint64_t seed;
    // Fingerprint of the model.
    uint64_t model;
    // Fingerprint of the audio that the avatar heard: FNV-1a of 64 bits over its samples, mono floats at
    // the model's rate.
    uint64_t audio;
    // Number of those samples.
    uint64_t audio_samples;
    // Fingerprint of the word rules.
    uint64_t rules;
} umo_take_info;

// Where a member stands. Initialise it with `umo_place_init`.
typedef struct umo_place {
    // `sizeof(umo_place)`.
    uint32_t struct_size;
    // Axes and units of the fields below: one of `UMO_AXES_…`.
    uint32_t axes;
    // Position on the floor, in the scene's space.
    float position[3];
    // Direction that it faces, in radians about the upward axis: 0 is the axis along which an avatar looks,
    // and the sign is that of a yaw in these axes: positive to the left in glTF's, to the right in Unity's and
    // Unreal's.
    float facing;
    // Height of the eyes above the position; the default is 1.6 m in glTF's axes.
    float eye_height;
} umo_place;

// State of a member of a scene. Set `struct_size`; `umo_scene_member` writes the rest.
typedef struct umo_member {
    // `sizeof(umo_member)`.
    uint32_t struct_size;
    // Whether it speaks: one of `UMO_ROLE_…`.
    uint32_t role;
    // Whom it attends to; 0 for nobody, or for a point of the host's.
    uint32_t attends_to;
    // 1 if it looks there now, 0 if it looks past.
    uint32_t is_contact;
    // Nods so far.
    uint32_t nods;
    // Brow raises so far.
    uint32_t brows;
    // Half smiles so far.
    uint32_t smiles;
    // Amount of yielding to another one that interrupts, 0 or 1.
    float yielding;
    // Level of its voice, root mean square, full scale 1.
    float level;
} umo_member;

// Frames to export, with their skeleton and channels. `umo_clip_init` fills in the model's fields; the
// host sets `layout`, `frames` and `frame_count`. The memory that it points to is read only during the
// call that takes the clip.
typedef struct umo_clip {
    // `sizeof(umo_clip)`.
    uint32_t struct_size;
    // Same as `umo_model_info.is_arkit`.
    uint32_t is_arkit;
    // Number of face channels, at most 1,024.
    uint32_t channel_count;
    // Number of frames in `frames`.
    uint32_t frame_count;
    // Frames per second.
    float rate;
    // Zero.
    uint32_t reserved;
    // Names of the face channels, UTF-8, as from `umo_model_get_channel_name`. `[channel_count]`
    const char *const *channels;
    // `int32_t[UMO_JOINT_COUNT]`: index of each joint's parent, as from `umo_model_get_skeleton`.
    const int32_t *parents;
    // `float[UMO_JOINT_COUNT][3]`: rest position of each joint in its parent's frame, metres in
    // `UMO_AXES_GLTF`, whatever the axes of the frames.
    const float *offsets;
    // Layout and axes of the frames. It must have translation, rotations and channels.
    const struct umo_frame_layout *layout;
    // The first frame, at second 0 of the file.
    const void *frames;
    // Figure to skin in `UMO_FORMAT_GLB`: a name from `umo_figure_name`. NULL: the skeleton alone, without
    // a face.
    const char *figure;
} umo_clip;

// Destination of a file's bytes.
typedef struct umo_output {
    // Passed to `write`.
    void *userdata;
    // Takes the next bytes of the file, at least one; they are valid until it returns. Returns 0 to go on,
    // any other number to stop. Called on the thread that called `umo_clip_write`. Must not throw.
    int32_t (*write)(void *userdata, const void *bytes, size_t size);
} umo_output;

// A character's skeleton at rest, and its mesh. `umo_rig_init` fills in the defaults. The memory that it points to is
// read only by `umo_retarget_new`. Places and rotations are in the character's space, not relative to parents, in
// `axes`; it may face anywhere and stand in any pose between a T and an A. Scale is in the places.
typedef struct umo_rig {
    // `sizeof(umo_rig)`.
    uint32_t struct_size;
    // Axes of the character's space, and of the poses: one of `UMO_AXES_…`.
    uint32_t axes;
    // Number of bones, 1 to 65,536.
    uint32_t bone_count;
    // Number of points of the mesh; 0: the body has a person's proportions.
    uint32_t vertex_count;
    // Number of `indices`, three for each triangle; 0: the points are spread over the surface by the host.
    uint32_t index_count;
    // Strength of the body's volume, 0 to 1. 0: arms go through the body. At 1 they keep out of trunk, head, legs and
    // each other, and touch where the model's do.
    float gain;
    // Factors of the measured girth of pelvis, belly, chest, neck, head, upper arms, forearms, hands, thighs: 0 to 10.
    float girths[9];
    // Zero.
    uint32_t reserved;
    // Names of the bones, UTF-8; NULL if `joints` is given. `[bone_count]`
    const char *const *names;
    // `int32_t[bone_count]`: index of each bone's parent, -1 for none.
    const int32_t *parents;
    // `int32_t[bone_count]`: joint that each bone follows, -1 for none. Bones of the joints 3, 6 and 9 are the spine from
    // the hips up, whatever their number, bones of joint 12 the neck. NULL: found by `names`.
    const int32_t *joints;
    // `float[bone_count][3]`: places of the bones at rest.
    const float *places;
    // `float[bone_count][4]`: rotations of the bones at rest, quaternions x, y, z, w.
    const float *rotations;
    // `float[vertex_count][3]`: places of the mesh's points at rest.
    const float *vertices;
    // `int32_t[vertex_count]`: bone that has at least half of each point's weight, -1 for none.
    const int32_t *vertex_bones;
    // `uint32_t[index_count]`: points of the triangles.
    const uint32_t *indices;
} umo_rig;

// Success.
#define UMO_STATUS_OK 0

// A required pointer is NULL.
#define UMO_STATUS_NULL_POINTER -1

// A handle is unknown, freed, or of another kind.
#define UMO_STATUS_INVALID_HANDLE -2

// An argument is out of range.
#define UMO_STATUS_INVALID_ARGUMENT -3

// Unknown `struct_size`: call the structure's initializer, or set it to `sizeof`.
#define UMO_STATUS_STRUCT_SIZE -4

// A buffer is too small for the output.
#define UMO_STATUS_BUFFER_TOO_SMALL -5

// The program was compiled with the header of an incompatible version.
#define UMO_STATUS_VERSION -6

// A file cannot be read or written.
#define UMO_STATUS_IO -7

// The file is not a usable model.
#define UMO_STATUS_MODEL -8

// There is not enough memory, or the host's allocator returned NULL.
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

// A panic of this library was caught, without output; the session concerned cannot be used any more.
// Free it, and report the defect: `umo_session_last_error` (or `umo_last_error`) has the panic's
// message and its place in the source.
#define UMO_STATUS_PANIC -15

// This model, processor or engine cannot do that.
#define UMO_STATUS_UNSUPPORTED -16

// The bytes are not a state of a session with this configuration. Nothing was changed.
#define UMO_STATUS_STATE -17

// A worker thread could not be created or pinned.
#define UMO_STATUS_THREAD -18

// The bytes are not a packet for this decoder. Nothing was changed.
#define UMO_STATUS_PACKET -19

// The bytes are not a take, or a damaged one.
#define UMO_STATUS_TAKE -20

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns the library's `UMO_ABI_VERSION`, for programs that load the library at run time.
//
// Threads: any. Never allocates, never waits.
UMO_API uint32_t umo_abi_version(void) UMO_NOEXCEPT;

// Returns the library's version, such as `0.1.0`, as a static string.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_version(void) UMO_NOEXCEPT;

// Fills an engine configuration with its defaults: two threads of its own (one on a single core), 64
// sessions, batches of up to 8. In a library built without threads: one thread, polled by the host.
// `size` is `sizeof *config`.
//
// Threads: any but the audio thread. Asks the system for the number of processors, which may allocate for a
// moment and read files.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
//
// Pointers:
// `config` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_engine_config_init(struct umo_engine_config *config,
                                  size_t size)
UMO_NOEXCEPT;

// Creates an engine for a model. The model may be freed before the engine. `config` may be NULL.
//
// Threads: any but the audio thread. Allocates everything that computing will need, and starts the
// engine's threads.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which
// number), `STRUCT_SIZE`, `THREAD`, `MODEL` (the model has no rest pose), `FULL` (1,024
// engines), `OUT_OF_MEMORY`, `UNSUPPORTED` (threads of its own, in a library built without threads).
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

// Stops an engine's threads and frees it. Its sessions remain: frames that were ready can still be
// pulled, then calls return `CLOSED`. NULL is fine.
//
// Threads: any but the audio thread. Waits for the layer that is being computed, a few
// milliseconds at most.
// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is in progress, such as `umo_engine_poll`, or a job
// that it gave to `umo_jobs.submit`). After `BUSY` the engine takes no other calls, and jobs that
// have not begun return at once; free it again when those in progress have returned:
// `while (umo_engine_free(engine) == UMO_STATUS_BUSY) wait_for_my_jobs();`
UMO_API umo_status umo_engine_free(struct umo_engine *engine) UMO_NOEXCEPT;

// Sets the overload policy: while chunks start more than `seconds` behind real time, a growing share of
// them skips the language model, at a quarter of the cost. In these chunks the body holds its pose, and
// the mouth comes from the model's mouth network, if it has one; sessions take turns. The share shrinks
// again once chunks are in time; `umo_stats.held_chunks` counts them. While the engine keeps up, frames
// are bit-identical to those without a limit.
//
// A negative number, the default, never holds the body: frames then come later and later, up to the ten
// seconds of audio that a session queues. Keep the default if audio is pushed faster than real time.
//
// Threads: any. Never allocates, never waits.
// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT` (not finite).
UMO_API
UMO_MUST_USE
umo_status umo_engine_set_late_limit(struct umo_engine *engine,
                                     double seconds)
UMO_NOEXCEPT;

// Computes on the calling thread, for an engine made with `UMO_ENGINE_POLLED`: until nothing is due, or until the next
// layer would exceed `budget` microseconds, judged by the last one of its kind. It computes at least one layer; with
// a budget of 0, exactly one. `more`, which may be NULL, becomes 1 if the budget left due work, else 0. A session is
// due when the audio of its next chunk was pushed and its queue of frames has room. A session with a full queue is due
// again once frames are pulled.
//
// Threads: one at a time, with at least 1 MiB of stack; not the audio thread. Never allocates;
// waits only for the engine's own threads and for work that lent threads have begun.
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

// Sets the rules by which words become gestures (docs/words.md), for sessions created later: those of
// `language` (`"en"`, which is the default, or `"de"`; NULL keeps the present ones), and to them those of `toml`,
// the text of a file of rules (NULL for none). Gestures that the rules name must be known when a session is
// created.
//
// Threads: any but the audio thread. Allocates.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (a language without rules; not rules:
// `umo_last_error` says where and why), `OUT_OF_MEMORY`.
//
// Pointers:
// `language` and `toml` are NULL or end with a zero byte.
UMO_API
UMO_MUST_USE
umo_status umo_engine_set_word_rules(struct umo_engine *engine,
                                     const char *language,
                                     const char *toml)
UMO_NOEXCEPT;

// Fills a layout for frames without gaps, in glTF's axes: index, sample, translation, rotations,
// channels, and visemes if the model has ARKit channels. `size` is `sizeof *layout`.
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

// Checks a layout against a model, and computes the number of frames that fit in `size` bytes.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT`, `UNSUPPORTED`
// (`umo_last_error` has the reason).
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

// Fills gesture options with their defaults: as soon as possible, at normal speed and full strength.
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

// Fills a clip with its defaults: all parts, 30 frames per second, no frames. `size` is `sizeof *clip`.
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

// Adds a gesture of the host's to an engine, for sessions that are created later; a gesture of the same
// name is replaced. `name` is 1 to 64 letters, digits, `_`, `-` and spaces. The clip fades in over its
// first 0.4 seconds, or up to its stroke if that is earlier, and fades out over its last 0.55 seconds. An
// engine holds 256 added gestures.
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

// Adds a gesture, as `umo_engine_add_gesture` does, from the animation in a `.glb`, `.gltf` or `.vrm`
// file of any humanoid character: bone names of Mixamo, VRM, Unreal, Unity, Godot and `umo animate` are
// recognised. Files that a `.gltf` names are read from its folder. The motion is retargeted to the
// model's skeleton.
//
// `path` is UTF-8. `animation` is the name of an animation in the file, or NULL for the first; it may
// last two minutes at most. `parts` is a sum of `UMO_GESTURE_…`. `stroke` is the time of the stroke in
// seconds from the start; if negative, the middle.
//
// Threads: any but the audio thread. Allocates.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `IO`, `OUT_OF_MEMORY`, `INVALID_ARGUMENT`
// (`umo_last_error` says which part of the file is wrong, which bones were not found, or which
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

// Adds a gesture, as `umo_engine_add_gesture_file` does, from a file's `size` bytes in memory, read
// during the call. A `.gltf` must then embed its data.
//
// Threads: any but the audio thread. Allocates.
// Errors: as `umo_engine_add_gesture_file`, except `IO`.
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

// Gets the name of a gesture that an engine's sessions know: built-in ones first, in a fixed order, then
// the host's. Valid until the engine is freed. To list all, count `index` up from 0 until
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
// Threads: any but the audio thread. Allocates, reads the file, starts threads for the duration of the
// call, and waits for them: a base-size int8 model takes some 0.3 s.
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

// Loads a model from memory, which is not copied and no longer needed when the call returns: weights are
// repacked for the processor.
//
// Threads, errors: as `umo_model_load`, except `IO` and `UNSUPPORTED`.
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

// Frees a model. Its engines keep the parts that they need. NULL is fine.
//
// Threads: any but the audio thread. Texts and names of the model are freed with it.
// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_model_free`
// again; it takes no other calls).
UMO_API umo_status umo_model_free(struct umo_model *model) UMO_NOEXCEPT;

// Gets the properties of a model.
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

// Gets one of the model's texts, UTF-8, valid until the model is freed. `which` is one of `UMO_MODEL_…`.
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

// Gets the name of a face channel, such as `jawOpen`, valid until the model is freed. `index` is below
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

// Returns the name of a joint, such as `left_elbow`: static, or NULL if `index` is not below
// `UMO_JOINT_COUNT`.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_joint_name(uint32_t index) UMO_NOEXCEPT;

// Returns the name of a viseme of the Oculus set, such as `PP`: static, or NULL if `index` is not below
// `UMO_VISEME_COUNT`.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_viseme_name(uint32_t index) UMO_NOEXCEPT;

// Gets the skeleton: for each joint its parent's index, -1 for the first, and its rest position in its
// parent's frame, x y z, in the axes and units of `which` (one of `UMO_AXES_…`). Either array may be
// NULL; `joints` is their capacity in joints, at least `UMO_JOINT_COUNT`. If all rotations are the
// identity, the body stands in a T-pose.
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

// Encodes a prompt as ids for `umo_session_set_prompt_ids`, at most `umo_model_info.max_prompt` of
// them. `count` is written even if `capacity` is too small. The model's log gets a warning if the model has a
// list of prompts that lacks `text`.
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

// Gets the description of the parameter at `index`, from 0; `INVALID_ARGUMENT` past the last one.
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

// Computes the gain of each channel that brings the speech of a whole recording to its normal level, for
// `count` interleaved samples at `sample_rate` Hz. The gains are 1 for a plain recording. They differ if
// its level is far from that of speech, if its channels cancel each other, or if only the centre channel
// (the third, with five channels or more) has speech. Multiply each channel by its gain before you push
// the samples into a session; `gains` has room for `channels` values, 1 to 64.
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

// Tests this machine with a model, for about 10 seconds or less. Every kernel of every back-end that the processor
// supports is compared with its scalar reference. The model's motion is compared with recorded motion, or for a model
// without a record with a second run. The model's speed is measured if the library has threads and a clock. `passed`
// is 1 if no fault was found. `report` is a text of several lines: processor, comparisons, faults, speed, and changes
// that would make it faster. It contains no path, host name or user name. `size` is at least `UMO_SELF_TEST_SIZE`.
//
// Threads: any but the audio thread. Allocates, starts threads, and waits for them.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL` (nothing was tested), `OUT_OF_MEMORY`. Faults found by
// the test are not errors of the call.
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

// Fills a session configuration with the model's defaults, for mono audio at the model's rate. `size`
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

// Gets the size and alignment, in bytes, of the single block that `umo_session_new` takes from the
// allocator for this configuration. Either may be NULL.
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
// piece from the configuration's allocator, of the size that `umo_session_memory` gives. From the system
// it takes less than 1 KiB for the duration of the call. The first session of a `sample_rate` that is
// not the model's also takes the filter that converts it, which the engine keeps: to 16,000 samples per
// second 3 KiB from 48,000, 390 KiB from 44,100, and at most 1 MiB from any rate.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which
// number), `STRUCT_SIZE`, `FULL` (the engine's `max_sessions`, or 16,384 sessions in all),
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
// threads that call it without a pause cannot keep it alive.
//
// Threads: any but the audio thread. Waits a millisecond or so for calls in progress. If a chunk of it
// is being computed, its memory is released when the next session is made or freed, or with the
// engine.
// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_session_free`
// again; nothing was freed).
UMO_API umo_status umo_session_free(struct umo_session *session) UMO_NOEXCEPT;

// Copies the detail of the last failed call on the session, from any thread, to `buffer`, which has
// `size` bytes; `UMO_ERROR_SIZE` is enough. `length`, which may be NULL, gets its length without the
// terminating zero.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL`, `BUSY` (a call is failing at this moment).
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

// Pushes audio for the avatar to speak: `count` interleaved samples, full scale 1, a multiple of the
// session's channel count. `taken`, which may be NULL, gets the number of samples that there was room
// for: push the rest again later. Samples that are NaN, infinite or beyond 1e6 become silence.
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

// Pushes 16-bit samples, with a full scale of 32,768, as `umo_session_push_audio` does.
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

// Feeds the voice of a person at a microphone: `count` interleaved samples at the session's rate and
// channels, full scale 1. From then on the person stands 1.5 m ahead of the avatar, until a reset, and the
// two are as in a scene: the avatar looks there and away, listens, nods, and gives way. In a scene of the
// host's, its members count instead. Only the loudness is used; NaN and infinite samples count as silence.
//
// Threads: one at a time, concurrently with any other call; meant for the recording thread. Never
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

// Ends the audio: the tail is completed, and `floor(seconds * 30)` frames come out in all. A second
// call is a no-op.
//
// Threads: any; not during a push. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pushes), `FAILED`, `CLOSED`,
// `PANIC`.
UMO_API UMO_MUST_USE umo_status umo_session_finish(struct umo_session *session) UMO_NOEXCEPT;

// Barge-in: drops everything not shown yet and eases to the rest pose within `ease_ms` milliseconds, at
// most 10,000. Audio pushed from now on starts a new stream, whose frames follow the ease. The frame
// index continues, and the avatar stays where it stands. The new stream's first frame is number
// `last + 1 + ease`: `last` is the last frame handed out by a pull or a sample, and the ease takes
// `ceil(ease_ms * frame_rate / 1000)` frames. Sample from that time on to see the stream from its start.
// The new stream blends out of the rest pose over the same number of frames, limited by the session's
// `ease_ms`; the face takes a quarter of them.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `FAILED`, `CLOSED`, `PANIC`.
UMO_API
UMO_MUST_USE
umo_status umo_session_interrupt(struct umo_session *session,
                                 uint32_t ease_ms)
UMO_NOEXCEPT;

// Resets the session to its start: everything pushed and not shown is dropped, the frame index starts
// at 0, and the output is that of a new session with the same settings.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `FAILED`, `CLOSED`, `PANIC`.
UMO_API UMO_MUST_USE umo_status umo_session_reset(struct umo_session *session) UMO_NOEXCEPT;

// Takes ready frames in order, each once, up to the number that fit in `size` bytes in `layout`. `count`
// gets the number of frames, 0 if none is ready.
//
// Threads: one at a time, concurrently with any other call. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (the layout),
// `UNSUPPORTED` (the layout has visemes, but the model does not), `BUFFER_TOO_SMALL` (not one frame
// fits), `BUSY` (another thread pulls); `FAILED`, `CLOSED`, `PANIC` once all ready frames have been
// pulled.
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

// Gets the number of frames that `umo_session_pull_frames` would give.
//
// Threads: any; not during a pull. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls), `PANIC`.
//
// Pointers:
// `count` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_ready_frames(struct umo_session *session,
                                    size_t *count)
UMO_NOEXCEPT;

// Gets the arousal of the voice at the newest frame that was pulled or sampled: how lively it speaks, 0 to 1, ten
// times a second. It is 0.5 for an ordinary voice, and without one. `trend` is its change per second over the last
// seconds. `UMO_PARAMETER_EXPRESSION` changes neither.
//
// Threads: any; not during a pull. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls), `PANIC`.
//
// Pointers:
// `arousal` and `trend` are NULL or writable; `trend` may be NULL.
UMO_API
UMO_MUST_USE
umo_status umo_session_arousal(struct umo_session *session,
                               float *arousal,
                               float *trend)
UMO_NOEXCEPT;

// Whether the stream has ended: `done` becomes 1 once `umo_session_finish` was called and all frames
// were handed out by pulls or samples; before that it is 0. This is how a host that only samples learns
// that no more frames will come.
//
// Threads: any; not during a pull. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls); `FAILED`, `CLOSED`,
// `PANIC` if the remaining frames will never come.
//
// Pointers:
// `done` is NULL or writable.
UMO_API UMO_MUST_USE umo_status umo_session_is_done(struct umo_session *session, uint32_t *done) UMO_NOEXCEPT;

// Sets the host's time, in seconds from any origin, 0 to 1e9. From the first call on, motion while no
// frames come, eases to it and back, and `idle_after_ms` follow this time instead of the system's clock.
// For hosts that render slower or faster than real time, pause, or replay: call it for every picture,
// before `umo_session_sample_pose`. The time never goes back: an earlier value counts as the latest so
// far. Only `umo_session_restore` goes back, to the state's time.
//
// Threads: one at a time, concurrently with any other call except a pull or a sample. Never allocates,
// never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not in 0 to 1e9), `BUSY` (another
// thread pulls), `PANIC`.
UMO_API
UMO_MUST_USE
umo_status umo_session_set_clock(struct umo_session *session,
                                 double seconds)
UMO_NOEXCEPT;

// Interpolates the pose at `seconds` of the motion (frame index / 30), less `UMO_PARAMETER_OUTPUT_DELAY`,
// for renderers at any rate: rotations take the shorter way, all other values are linear. Frames before
// that time are consumed, as by `umo_session_pull_frames`. A time before the oldest frame gives the
// oldest frame; a time after the newest frame gives the pose of the idle mode. The time never goes back:
// an earlier value counts as the latest so far. `sampled` may be NULL.
//
// Threads: one at a time, concurrently with any other call except a pull. Never allocates, never waits.
// Errors: as `umo_session_pull_frames`, and `INVALID_ARGUMENT` for a time that is NaN or infinite.
// However, a session that failed, or whose engine was freed, continues to give its last pose, and
// `umo_session_is_done` returns the error.
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

// Sets the prompt from the next chunk on: `length` bytes of UTF-8, at most 128 ids' worth. An empty text
// removes the prompt. The engine's log gets a warning if the model has a list of prompts that lacks `text`.
//
// Threads: any but the audio thread. Allocates: `umo_session_set_prompt_ids` does not.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `UNSUPPORTED` (the model takes no texts),
// `INVALID_ARGUMENT` (not UTF-8, too long), `OUT_OF_MEMORY`, `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `text` is NULL or has `length` readable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_session_set_prompt(struct umo_session *session,
                                  const char *text,
                                  size_t length)
UMO_NOEXCEPT;

// Sets the prompt from the next chunk on, as ids from `umo_model_encode_text`.
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

// Sets the seed of sampling from the next chunk on.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
UMO_API UMO_MUST_USE umo_status umo_session_set_seed(struct umo_session *session, uint64_t seed) UMO_NOEXCEPT;

// Sets a parameter, one of `UMO_PARAMETER_…`, within its range from `umo_parameter_get_info`. Sampling
// changes with the next chunk, the idle mode and gains with the next frame that is handed out.
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

// Gets a parameter's value.
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
// head, then the trunk, within the limits of the body. A strength of 0 ends it. The point may be set
// again for every frame.
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

// Schedules a viseme hint, for a sound that is visible on the lips (bilabial, labiodental, rounded):
// `shape` is one of `UMO_LIPS_…`, `start` and `duration` are seconds of the audio pushed since the
// session began or was reset. The lips are in the shape during that time, and reach and leave it within
// 60 ms, whatever the model does. Models without ARKit blendshapes ignore hints. Hints may come in any
// order, before or after their audio; a hint whose frames were pulled already has no effect.
// `umo_session_interrupt` drops pending hints.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (an unknown shape, a start that is
// negative or not a number, or a duration outside 0 to 2), `BUSY` (64 hints are pending: call again
// when the time of one has passed; or another thread is in a setter), `FAILED`, `CLOSED`, `PANIC`.
UMO_API
UMO_MUST_USE
umo_status umo_session_hint_lips(struct umo_session *session,
                                 uint32_t shape,
                                 double start,
                                 double duration)
UMO_NOEXCEPT;

// Gives the words of `text` and their time, `start` to `end` in seconds of the audio pushed since the session
// began or was reset: usually one word with its punctuation; several share the time by their syllables. By the
// engine's rules (`umo_engine_set_word_rules`) some words become gestures, whose stroke falls on the stressed
// vowel; those of `umo_session_play_gesture` come first. Words may come in any order, before or after their
// audio; one that comes less than 1.6 seconds before its frame may be gestured late or not at all.
// `umo_session_interrupt` drops pending words.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not UTF-8, more than 64 words, a start that is
// negative or not a number, or an end that is not 0 to 30 seconds later), `BUSY` (more than 64 words would be
// pending: call again when the time of some has come; or another thread is in a setter), `FAILED`, `CLOSED`,
// `PANIC`.
//
// Pointers:
// `text` is NULL or ends with a zero byte.
UMO_API
UMO_MUST_USE
umo_status umo_session_hint_words(struct umo_session *session,
                                  const char *text,
                                  double start,
                                  double end)
UMO_NOEXCEPT;

// Plays a gesture over the model's motion: the parts of the body that it moves ease to it and back, the
// others continue. `name` is one that `umo_engine_get_gesture_name` lists; upper case counts as lower
// case, and spaces and hyphens as underscores. Gestures of the same parts follow each other in the order
// of the calls; one with a time takes their place. `umo_session_interrupt` releases the playing gesture
// and drops pending ones. `options` may be NULL.
//
// Threads: any. Never allocates; waits at most for another thread's setter.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (unknown name, or an
// option out of range), `BUSY` (eight gestures are pending: call again when one has begun; or another
// thread is in a setter), `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `name` is NULL or ends with a zero byte; `options` is NULL or as long as its `struct_size` says.
UMO_API
UMO_MUST_USE
umo_status umo_session_play_gesture(struct umo_session *session,
                                    const char *name,
                                    const struct umo_gesture_options *options)
UMO_NOEXCEPT;

// Gets the delay of motion behind speech.
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

// Gets statistics of the session.
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

// Gets the maximum size of a state of the session, in bytes; it is constant for the session's lifetime.
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

// Saves the session's whole state to `state`, which has `size` bytes, at least `umo_session_state_size`:
// queued audio, queued frames, history, settings. `written` gets the number of bytes used. They hold no
// addresses: they can be kept in a file, sent, and restored in another process. The session continues
// as if nothing had happened. A chunk that is being computed is computed again by the restored session,
// which then gives the frames that the state does not have.
//
// Threads: one at a time; not during a push, a pull or a setter. Never allocates, never waits for a chunk.
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

// Restores a state that was saved from this session or from another one of the same model and
// configuration: equal calls then give equal frames, bit for bit, on any number of threads, whatever seed
// the session was made with. `size` is the length that `umo_session_save` wrote.
//
// Threads: one at a time; not during a push, a pull or a setter. Never allocates, never waits for a chunk.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STATE` (not a state of a session with this configuration:
// `umo_session_last_error` says what disagrees), `BUSY` (as `umo_session_save`, or a chunk of this
// session is being computed: restore again later, or into a session to which no audio was pushed),
// `FAILED`, `CLOSED`, `PANIC`.
//
// Pointers:
// `state` is NULL or has `size` readable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_session_restore(struct umo_session *session,
                               const void *state,
                               size_t size)
UMO_NOEXCEPT;

// Gets the maximum size of a packet of the session, in bytes; 0 for a session made without packets.
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

// Takes ready packets in order, each once, of a session whose configuration has `packets`: at most
// `most`, and as many as fit in `bytes`, back to back. `lengths[i]` gets the length of each in bytes,
// `count` their number. `size` is at least `umo_session_packet_size`. Send each packet to the decoders
// unchanged; they tolerate loss, duplicates and reordering.
//
// Threads: one at a time, concurrently with any other call. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (a session without packets),
// `BUFFER_TOO_SMALL`, `BUSY` (another thread pulls packets); `FAILED`, `CLOSED`, `PANIC` once all
// ready packets have been pulled.
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

// Creates a decoder: a session that gets its frames from packets, where the avatar is shown. It needs no
// engine. All `umo_session_…` calls work on it except those that take audio, texts or a state, and
// `umo_session_interrupt`: these are for the sender. Free it with `umo_session_free`. In `config`, which
// may be NULL, `target`, `lookahead` and `smoothing` must equal the sender's, and the model must be the
// same file at the same precision; layers, seed, idle mode, ease, queue and `reorder_window` are the decoder's
// own. `allocator` must be NULL: its memory comes from the system.
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

// Decodes a packet of `size` bytes, and computes the frames that become final. Packets may be lost,
// duplicated, late and in any order. A packet that is missing after a later one and `reorder_window` more have
// arrived is concealed, and the next packet leads back to the sender's motion. A refused packet changes
// nothing.
//
// Threads: one at a time, concurrently with any other call; meant for the receiving thread. Never
// allocates, never waits; takes the time of a chunk's motion decoders.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `PACKET` (`umo_session_last_error` has the reason),
// `INVALID_ARGUMENT` (the session is not a decoder), `BUSY` (another thread pushes, or the queue of
// frames is full: pull some, then push the packet again), `FAILED`, `PANIC`.
//
// Pointers:
// `packet` is NULL or has `size` readable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_decoder_push_packet(struct umo_session *decoder,
                                   const void *packet,
                                   size_t size)
UMO_NOEXCEPT;

// Gets statistics of a decoder's packets.
//
// Threads: any; not during a push. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (the session is not a
// decoder), `BUSY` (another thread pushes), `PANIC`.
//
// Pointers:
// `stats` is NULL or as long as its `struct_size` says, and writable.
UMO_API
UMO_MUST_USE
umo_status umo_decoder_stats(const struct umo_session *decoder,
                             struct umo_received *stats)
UMO_NOEXCEPT;

// Reads a take from memory, as `umo animate` or `umo_session_take` wrote it; copies the bytes. Takes of all
// earlier versions are read. Free it with `umo_take_free`; sessions that play it go on.
//
// Threads: any but the audio thread. Allocates.
// Errors: `NULL_POINTER`, `TAKE` (`umo_last_error` says what is damaged), `FULL` (16,384 takes),
// `OUT_OF_MEMORY`.
//
// Pointers:
// `bytes` is NULL or has `size` readable bytes; `take` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_take_new(const void *bytes,
                        size_t size,
                        struct umo_take **take)
UMO_NOEXCEPT;

// Frees a take. NULL is fine.
//
// Threads: any but the audio thread. Waits a millisecond or so for calls in progress.
// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_take_free` again).
UMO_API umo_status umo_take_free(struct umo_take *take) UMO_NOEXCEPT;

// Gets the properties of a take.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`.
//
// Pointers:
// `info` is NULL or as long as its `struct_size` says, and writable.
UMO_API
UMO_MUST_USE
umo_status umo_take_get_info(const struct umo_take *take,
                             struct umo_take_info *info)
UMO_NOEXCEPT;

// Creates a decoder that plays a take, with the model that the take was made with: `umo_decoder_push_take`
// takes the place of packets, and everything that shows or changes frames works as in any session. Where
// this host asks for nothing of its own, the frames are the recorded ones, bit for bit; `umo_session_reset`
// begins the take anew. Of `config`, which may be NULL, the idle mode, the ease and the queue count; the
// rest is the take's. `allocator` must be NULL.
//
// Threads: any but the audio thread. Allocates everything that the decoder will ever need.
// Errors: as `umo_decoder_new`; `INVALID_ARGUMENT` also for a take of another model, or with a gesture that
// is not built in.
//
// Pointers:
// `config` is NULL or as long as its `struct_size` says; `decoder` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_decoder_new_of_take(const struct umo_model *model,
                                   const struct umo_take *take,
                                   const struct umo_session_config *config,
                                   struct umo_session **decoder)
UMO_NOEXCEPT;

// Computes the frames of the take's next packet, if the queue has room for them. `more`, which may be NULL,
// gets 0 once every packet was taken, otherwise 1. Call it more often than chunks begin, for example before
// each pose: most calls find no room, and return at once.
//
// Threads: one at a time, concurrently with any other call. Never allocates, never waits; takes the time of
// a chunk's motion decoders.
// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT` (the session plays no take), `BUSY` (another thread pushes),
// `PACKET`, `FAILED`, `PANIC`.
//
// Pointers:
// `more` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_decoder_push_take(struct umo_session *decoder,
                                 uint32_t *more)
UMO_NOEXCEPT;

// Gets the size in bytes of the take that the session has recorded so far; its configuration has
// `take_bytes`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (the session records no take), `BUSY` (the
// take is being written to), `PANIC`.
//
// Pointers:
// `size` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_take_size(const struct umo_session *session,
                                 size_t *size)
UMO_NOEXCEPT;

// Writes the take of the frames that the session has shown so far to `take`, which has `size` bytes;
// `written` gets the number used. The take begins at the session's start or its last reset. It ends at an
// interrupt, where its memory ends, and at what a take cannot say: a restored state, company in a scene,
// silence that the engine inserts, a held body, a gap in the frames.
//
// Threads: any. Never allocates, never waits; calls on the session that show or ask for something wait
// while it is copied.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (the session records no take),
// `BUFFER_TOO_SMALL` (fewer than `umo_session_take_size` by now), `BUSY` (the take is being written to),
// `PANIC`.
//
// Pointers:
// `take` is NULL or has `size` writable bytes; `written` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_session_take(const struct umo_session *session,
                            void *take,
                            size_t size,
                            size_t *written)
UMO_NOEXCEPT;

// Returns the message of a status, with a remedy: static, never NULL, in English.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_status_message(umo_status status) UMO_NOEXCEPT;

// Returns the detail of this thread's last failed call of a function without a session, such as the key,
// file, tensor or argument. Never NULL; the storage belongs to the thread, and its next failure
// overwrites it.
//
// Threads: any but the audio thread. Never waits. Calls on sessions keep their detail with the
// session: `umo_session_last_error`.
UMO_API const char *umo_last_error(void) UMO_NOEXCEPT;

// Fills a place with its defaults: at the origin, in the axes of glTF, eyes at 1.6 m. `size` is `sizeof *place`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
//
// Pointers:
// `place` is NULL or has `size` writable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_place_init(struct umo_place *place,
                          size_t size)
UMO_NOEXCEPT;

// Creates an empty scene. Its random choices follow from `seed`: equal seeds, voices and times of updates give equal
// frames.
//
// Threads: any but the audio thread. Allocates everything that the scene will ever need.
// Errors: `NULL_POINTER`, `FULL` (1,024 scenes), `OUT_OF_MEMORY`.
//
// Pointers:
// `scene` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_scene_new(uint64_t seed,
                         struct umo_scene **scene)
UMO_NOEXCEPT;

// Frees a scene. NULL is fine. Its sessions go on alone: free them before or after.
//
// Threads: any but the audio thread. Waits a millisecond or so for calls in progress.
// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_scene_free` again).
UMO_API umo_status umo_scene_free(struct umo_scene *scene) UMO_NOEXCEPT;

// Adds a member at a place (NULL: the default), and writes its number to `member`: from 1 on, never used again
// in this scene. `session` is an avatar, of any engine, or a decoder; it may be in one scene at a time. A session that
// is freed leaves the scene with the next update. With NULL the member has no body: a person, whose voice comes
// by `umo_scene_push_audio`.
//
// Threads: one at a time. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE` (of the scene or the session), `STRUCT_SIZE`, `INVALID_ARGUMENT` (unknown
// axes, a number that is not finite or too large), `FULL` (`UMO_SCENE_MEMBER_COUNT`), `BUSY` (another thread is in a call
// on the scene), `PANIC`.
//
// Pointers:
// `place` is NULL or as long as its `struct_size` says; `member` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_scene_add(struct umo_scene *scene,
                         struct umo_session *session,
                         const struct umo_place *place,
                         uint32_t *member)
UMO_NOEXCEPT;

// Removes a member. Its session goes on alone, and the others look elsewhere.
//
// Threads: one at a time. Never allocates; waits at most for a copy of a few bytes.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (no such member), `BUSY`, `PANIC`.
UMO_API UMO_MUST_USE umo_status umo_scene_remove(struct umo_scene *scene, uint32_t member) UMO_NOEXCEPT;

// Moves a member.
//
// Threads: one at a time. Never allocates, never waits.
// Errors: as `umo_scene_remove`, and `STRUCT_SIZE`, `INVALID_ARGUMENT` (as `umo_scene_add`).
//
// Pointers:
// `place` is NULL or as long as its `struct_size` says.
UMO_API
UMO_MUST_USE
umo_status umo_scene_set_place(struct umo_scene *scene,
                               uint32_t member,
                               const struct umo_place *place)
UMO_NOEXCEPT;

// Sets the target of a member's look, whatever is said: another member, `other`, or a point of the scene in `axes`
// (`UMO_AXES_…`), three values. With an `other` of 0 and NULL the scene chooses again.
//
// Threads: one at a time. Never allocates, never waits.
// Errors: as `umo_scene_remove`, and `INVALID_ARGUMENT` (both `other` and `point`, the member itself, unknown axes, a
// point that is not finite or beyond 10 km).
//
// Pointers:
// `point` is NULL or has three readable values.
UMO_API
UMO_MUST_USE
umo_status umo_scene_set_target(struct umo_scene *scene,
                                uint32_t member,
                                uint32_t other,
                                uint32_t axes,
                                const float *point)
UMO_NOEXCEPT;

// Sets the parts that the scene plays of a member: the sum of `UMO_SCENE_…`; all at first. Other parts are
// the session's own, or the host's; with 0 the session moves as if alone.
//
// Threads: one at a time. Never allocates, never waits.
// Errors: as `umo_scene_remove`, and `INVALID_ARGUMENT` (unknown bits).
UMO_API
UMO_MUST_USE
umo_status umo_scene_set_allowed(struct umo_scene *scene,
                                 uint32_t member,
                                 uint32_t parts)
UMO_NOEXCEPT;

// Feeds the voice of a member without a body: `count` samples, full scale 1, at any rate, of any number of channels.
// Only their loudness is used; NaN and infinite samples count as silence. A voice without samples for a quarter of a
// second of the scene is silent.
//
// Threads: any, concurrently with any other call; meant for the recording thread. Never allocates, never waits, makes no
// system call.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (no such member, or one with a body), `PANIC`.
//
// Pointers:
// `samples` is NULL or has `count` readable values.
UMO_API
UMO_MUST_USE
umo_status umo_scene_push_audio(struct umo_scene *scene,
                                uint32_t member,
                                const float *samples,
                                size_t count)
UMO_NOEXCEPT;

// Advances the scene by `seconds`: once per picture, before frames are pulled or sampled. Reads the voice of each
// session at the frame that was pulled or sampled last, and tells each session what to do from its next frame on. Of a time
// longer than a second the rest is left out. `umo_session_look_at`, attention, mood and gestures of a session come first.
//
// Threads: one at a time, meant for the game thread. Never allocates, never waits, makes no system call.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (negative or not finite), `BUSY`, `PANIC`.
UMO_API
UMO_MUST_USE
umo_status umo_scene_update(struct umo_scene *scene,
                            double seconds)
UMO_NOEXCEPT;

// Gets the member that has the floor; 0 for nobody.
//
// Threads: one at a time. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY`, `PANIC`.
//
// Pointers:
// `member` is NULL or writable.
UMO_API UMO_MUST_USE umo_status umo_scene_floor(struct umo_scene *scene, uint32_t *member) UMO_NOEXCEPT;

// Gets the state of a member.
//
// Threads: one at a time. Never allocates, never waits.
// Errors: as `umo_scene_remove`, and `STRUCT_SIZE`.
//
// Pointers:
// `info` is NULL or as long as its `struct_size` says, and writable.
UMO_API
UMO_MUST_USE
umo_status umo_scene_member(struct umo_scene *scene,
                            uint32_t member,
                            struct umo_member *info)
UMO_NOEXCEPT;

// Gets the number of bytes that `umo_scene_save` writes at most; it changes with the members.
//
// Threads: one at a time. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY`, `PANIC`.
//
// Pointers:
// `size` is NULL or writable.
UMO_API UMO_MUST_USE umo_status umo_scene_state_size(struct umo_scene *scene, size_t *size) UMO_NOEXCEPT;

// Saves the scene and the sessions of all its members to `state`, which has `size` bytes; `written` gets their
// number. Decoders have no state: their senders do.
//
// Threads: one at a time; not during a push, a pull or a setter of a member's session. Never allocates, never waits
// for a chunk.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL`, `BUSY` (also as `umo_session_save`, of any member), `FAILED`
// and `CLOSED` of a member's session, `PANIC`. Then the bytes are not a state.
//
// Pointers:
// `state` is NULL or has `size` writable bytes; `written` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_scene_save(struct umo_scene *scene,
                          void *state,
                          size_t size,
                          size_t *written)
UMO_NOEXCEPT;

// Restores a state of this scene, or of another one to which the same members were added in the same order, with
// sessions of the same models and configurations: equal calls then give equal frames. After an error neither the scene
// nor any session has changed.
//
// Threads: one at a time; not during a push, a pull or a setter of a member's session. Never allocates, never waits
// for a chunk.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STATE` (`umo_scene_last_error` says what disagrees), `BUSY` (also as
// `umo_session_restore`, of any member), `FAILED` and `CLOSED` of a member's session, `PANIC`.
//
// Pointers:
// `state` is NULL or has `size` readable bytes.
UMO_API
UMO_MUST_USE
umo_status umo_scene_restore(struct umo_scene *scene,
                             const void *state,
                             size_t size)
UMO_NOEXCEPT;

// Copies the detail of the last failed call on the scene, from any thread, to `buffer`, which has `size` bytes;
// `UMO_ERROR_SIZE` is enough. `length`, which may be NULL, gets its length without the terminating zero.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL`, `BUSY` (a call is failing at this moment).
//
// Pointers:
// `buffer` is NULL or has `size` writable bytes; `length` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_scene_last_error(const struct umo_scene *scene,
                                char *buffer,
                                size_t size,
                                size_t *length)
UMO_NOEXCEPT;

// Returns the name of a figure, such as `alex`: static, or NULL if `index` is past the last one. The
// first is the default. Always NULL in a library built without the glTF writer.
//
// Threads: any. Never allocates, never waits.
UMO_API const char *umo_figure_name(uint32_t index) UMO_NOEXCEPT;

// Fills a clip with the model's skeleton, face channels and frame rate, and the default figure. Its
// pointers are valid until the model is freed. `size` is `sizeof *clip`.
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
// `umo animate` writes. `umo_clip_write_file` writes to disk.
//
// Threads: any but the audio thread. Allocates up to six times the frames' size and 16 MB; a figure
// takes some 0.7 s of a core, half of it on a second thread if the system can start one.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (`umo_last_error` says which part of the
// clip is wrong), `IO` (`output` stopped it), `OUT_OF_MEMORY`, `UNSUPPORTED` (the library was built
// without the glTF writer).
//
// Pointers:
// `clip` is NULL or as long as its `struct_size` says, and its pointers are as described; `output` is
// NULL or readable, and its `write` is NULL or as described.
UMO_API
UMO_MUST_USE
umo_status umo_clip_write(const struct umo_clip *clip,
                          uint32_t format,
                          const struct umo_output *output)
UMO_NOEXCEPT;

// Writes frames to a file, as `umo_clip_write` does. The file appears complete or not at all: after an
// error, an existing file of that name is unchanged. `path` is UTF-8 on every system.
//
// Threads: any but the audio thread. Allocates, writes the file, and waits until it is on the disk.
// Errors: as `umo_clip_write`; `IO` (`umo_last_error` has the path and the system's message),
// `UNSUPPORTED` also if the library was built without files.
//
// Pointers:
// As `umo_clip_write`; `path` is NULL or ends with a zero byte.
UMO_API
UMO_MUST_USE
umo_status umo_clip_write_file(const struct umo_clip *clip,
                               uint32_t format,
                               const char *path)
UMO_NOEXCEPT;

// Fills a character with its defaults: no bones, no mesh, a gain of 1, girths of 1. `size` is `sizeof *rig`.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
//
// Pointers:
// `rig` is NULL or has `size` writable bytes.
UMO_API UMO_MUST_USE umo_status umo_rig_init(struct umo_rig *rig, size_t size) UMO_NOEXCEPT;

// Prepares a character for poses of the model's skeleton, which is copied: the model may be freed. The character stands
// on the floor at rest. Its parts without points, and characters without points, have a person's proportions; a
// character without arms, hands or legs keeps no volume.
//
// Threads: any but the audio thread. Allocates. A mesh of 100,000 triangles takes some 50 ms.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `FULL` (4,096 characters), `OUT_OF_MEMORY`,
// `INVALID_ARGUMENT` (`umo_last_error` says which bone, point or number is wrong, or which joints have no bone),
// `UNSUPPORTED` (the library was built without umo-capi's feature `retarget`).
//
// Pointers:
// `rig` is NULL or as long as its `struct_size` says, and its pointers are as described; `retarget` is NULL or writable.
UMO_API
UMO_MUST_USE
umo_status umo_retarget_new(const struct umo_model *model,
                            const struct umo_rig *rig,
                            struct umo_retarget **retarget)
UMO_NOEXCEPT;

// Frees a character. NULL is fine.
//
// Threads: any but the audio thread. Waits a millisecond or so for calls in progress.
// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_retarget_free` again).
UMO_API umo_status umo_retarget_free(struct umo_retarget *retarget) UMO_NOEXCEPT;

// Gets the joint that each bone follows, -1 for a bone that keeps its rest rotation: `bone_count` values. The bone of
// joint 0 is the one that moves; a head without a body has none.
//
// Threads: any. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (another number of bones).
//
// Pointers:
// `joints` is NULL or has room for `bone_count` values.
UMO_API
UMO_MUST_USE
umo_status umo_retarget_get_joints(const struct umo_retarget *retarget,
                                   uint32_t bone_count,
                                   int32_t *joints)
UMO_NOEXCEPT;

// Sets the time from the last pose to the next one, in seconds; it holds until it is set again. A character begins with
// 1/30. A host that applies poses at another rate sets it before every pose, or once if the rate is constant: arms then
// leave the body and come back as fast as at 30 a second. 0.001 to 0.2 are used as they are, others as the nearer of these.
// Without volume it has no effect.
//
// Threads: one at a time. Never allocates, never waits.
// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT` (negative or not finite), `BUSY` (another thread is in a call on the
// character).
UMO_API
umo_status umo_retarget_set_step(struct umo_retarget *retarget,
                                 float seconds)
UMO_NOEXCEPT;

// Puts a pose on a character: `pose_rotations` are a frame's, four values for each of the 55 joints, and
// `pose_translation` its three; both in the rig's axes. Writes the rotation of each bone relative to its parent, four
// values for each of `bone_count` bones, and the place of the bone of joint 0 in the character's space, three values
// (NULL: not wanted). With volume a pose depends on those before it: give the frames of one motion in order, 30 a second or
// at the times of `umo_retarget_set_step`.
//
// Threads: one at a time. Never allocates, never waits.
// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (another number of bones, a number that is not finite),
// `BUSY` (another thread is in a call on the character), `PANIC`.
//
// Pointers:
// `pose_rotations` is NULL or has 220 readable values, `pose_translation` three; `rotations` is NULL or has room for four
// values for each bone, `place` for three.
UMO_API
UMO_MUST_USE
umo_status umo_retarget_apply(struct umo_retarget *retarget,
                              const float *pose_rotations,
                              const float *pose_translation,
                              uint32_t bone_count,
                              float *rotations,
                              float *place)
UMO_NOEXCEPT;

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* UMO_H */
