"""Constants and structures of umo.h. Generated from umo-capi/src by umo-capi/header: change it there."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from ctypes import CFUNCTYPE, POINTER, Structure, c_char_p, c_double, c_float, c_int32, c_size_t, c_uint32, c_uint64, c_void_p
from typing import TYPE_CHECKING, Any, NamedTuple, Optional

if TYPE_CHECKING:
    from ._model import Model

# Version of this interface: major number in the upper 16 bits, minor number in the lower. A library serves
# programs with the same major number and at most its own minor number.
ABI_VERSION = 1
# Offset meaning: do not write this field.
ABSENT = 4294967295
# Visemes per frame.
VISEME_COUNT = 15
# Joints of every model.
JOINT_COUNT = 55
# The parameter takes only whole numbers.
PARAMETER_WHOLE = 1
# Maximum length in bytes of a self-test's report, including its terminating zero.
SELF_TEST_SIZE = 8192
# Maximum length in bytes of an error's detail, including its terminating zero.
ERROR_SIZE = 512
# Upper bound on the members of a scene.
SCENE_MEMBER_COUNT = 32


class Status(enum.IntEnum):
    """Result of a call: OK, or a negative error code."""

    OK = 0
    """Success."""
    NULL_POINTER = -1
    """A required pointer is NULL."""
    INVALID_HANDLE = -2
    """A handle is unknown, freed, or of another kind."""
    INVALID_ARGUMENT = -3
    """An argument is out of range."""
    STRUCT_SIZE = -4
    """Unknown `struct_size`: call the structure's initializer, or set it to `sizeof`."""
    BUFFER_TOO_SMALL = -5
    """A buffer is too small for the output."""
    VERSION = -6
    """The program was compiled with the header of an incompatible version."""
    IO = -7
    """A file cannot be read or written."""
    MODEL = -8
    """The file is not a usable model."""
    OUT_OF_MEMORY = -9
    """There is not enough memory, or the host's allocator returned NULL."""
    FULL = -10
    """No free slot: free a model, an engine or a session first."""
    BUSY = -11
    """Another thread is in a call that excludes this one: call again. Nothing was done."""
    FINISHED = -12
    """Audio was pushed after `umo_session_finish`: reset or interrupt the session first."""
    FAILED = -13
    """The session's computation failed: it gives no more frames. Free it."""
    CLOSED = -14
    """The session's engine was freed: it gives no more frames. Free it."""
    PANIC = -15
    """A panic of this library was caught, without output; the session concerned cannot be used any more. Free it,
    and report the defect: `umo_session_last_error` (or `umo_last_error`) has the panic's message and its place in
    the source.
    """
    UNSUPPORTED = -16
    """This model, processor or engine cannot do that."""
    STATE = -17
    """The bytes are not a state of a session with this configuration. Nothing was changed."""
    THREAD = -18
    """A worker thread could not be created or pinned."""
    PACKET = -19
    """The bytes are not a packet for this decoder. Nothing was changed."""
    TAKE = -20
    """The bytes are not a take, or a damaged one."""


# Axes, handedness and unit of length.
AXES: dict[str, int] = {
    "gltf": 0,
    "unreal": 1,
    "unity": 2,
}
# Threads that compute: the engine's own, or the host's.
ENGINE_MODES: dict[str, int] = {
    "threads": 0,
    "polled": 1,
}
# Priority of an engine's own threads.
PRIORITIES: dict[str, int] = {
    "normal": 0,
    "high": 1,
    "low": 2,
}
# Kinds of cores that an engine's own threads run on.
CORE_KINDS: dict[str, int] = {
    "auto": 0,
    "system": 1,
    "performance": 2,
    "efficiency": 3,
}
# Networks of a model to load.
MODEL_PARTS: dict[str, int] = {
    "all": 0,
    "mouth": 1,
}
# Hand of a gesture.
SIDES: dict[str, int] = {
    "auto": 0,
    "left": 1,
    "right": 2,
    "both": 3,
}
# Parts of the body that a gesture moves.
GESTURE_PARTS: dict[str, int] = {
    "head": 1,
    "trunk": 2,
    "left_arm": 4,
    "right_arm": 8,
}
# Level of a log message.
LOG_LEVELS: dict[str, int] = {
    "info": 1,
    "warning": 2,
    "error": 3,
}
# Precision of a model's weights.
PRECISIONS: dict[str, int] = {
    "stored": 0,
    "f32": 1,
    "bf16": 2,
    "int8": 3,
}
# Upper bound on the instruction set.
ISAS: dict[str, int] = {
    "best": 0,
    "scalar": 1,
    "avx2": 2,
    "avx512vnni": 3,
    "amx": 4,
    "avx512bf16": 5,
    "avxvnni": 6,
    "neon": 7,
    "neon_dotprod": 8,
    "neon_i8mm": 9,
    "portable": 256,
}
# Text of a model.
MODEL_TEXTS: dict[str, int] = {
    "name": 1,
    "license": 2,
    "notice": 3,
    "isa": 4,
    "prompts": 5,
}
# Parameter of a running session.
PARAMETERS: dict[str, int] = {
    "temperature": 1,
    "top_k": 2,
    "top_p": 3,
    "idle": 4,
    "gain_face": 16,
    "gain_hands": 17,
    "gain_upper": 18,
    "gain_lower": 19,
    "attention": 5,
    "output_delay": 6,
    "activity": 7,
    "expression": 8,
    "layer_gaze": 32,
    "layer_idle": 33,
    "layer_asymmetry": 34,
    "layer_nods": 35,
    "layer_mood": 36,
    "layer_feet": 37,
    "layer_body": 38,
}


class Attention(enum.IntEnum):
    """Attention of the avatar."""

    AUTO = 0
    """Speaking while its own audio is heard, otherwise idle; in a scene, and after `umo_session_push_other_audio`,
    also listening.
    """
    IDLE = 1
    """Nothing in particular."""
    LISTENING = 2
    """The one who speaks: the avatar looks there, nods, and raises its brows."""
    THINKING = 3
    """An answer to give: the avatar looks away."""
    SPEAKING = 4
    """Its own speech."""


# Mood of face and posture.
MOODS: dict[str, int] = {
    "neutral": 0,
    "joy": 1,
    "sad": 2,
    "angry": 3,
    "surprised": 4,
    "disgusted": 5,
    "afraid": 6,
}
# Shape of the lips for a visible sound.
LIPS: dict[str, int] = {
    "closed": 0,
    "teeth": 1,
    "round": 2,
}


class Idle(enum.IntEnum):
    """Behaviour while no audio comes."""

    HOLD = 0
    """The last pose is held."""
    REST = 1
    """`umo_session_sample_pose` eases to the rest pose."""
    LIVE = 2
    """The model runs on silence."""


# Timing of the mouth, and whether there is a body.
VOICES: dict[str, int] = {
    "delayed": 0,
    "live": 1,
    "mouth": 2,
}
# Output of chunks as packets.
PACKETS: dict[str, int] = {
    "none": 0,
    "beside_frames": 1,
    "only": 2,
}
# Parts that a scene plays of a member.
SCENE_PARTS: dict[str, int] = {
    "look": 1,
    "nod": 2,
    "smile": 4,
    "mirror": 8,
    "yield": 16,
}


class Role(enum.IntEnum):
    """What a member of a scene does."""

    IDLE = 0
    """Nobody speaks."""
    LISTENING = 1
    """Another member speaks."""
    SPEAKING = 2
    """The member speaks."""


# Format of a file of frames.
FORMATS: dict[str, int] = {
    "glb": 1,
    "vrma": 2,
}

JobsSubmit = CFUNCTYPE(None, c_void_p, c_void_p, c_void_p)


class Jobs(Structure):
    """Lends the threads of the host's job system to an engine. Each `umo_engine_poll` calls `submit` once for every
    compute thread except its own; the host then runs `job(context)` on another thread as soon as it can. The job
    computes until the poll is over and needs 1 MiB of stack. A job that runs late, or never, costs only speed. A
    job that runs after the engine was freed, or inside `submit`, returns at once.
    """

    _fields_ = [
        # Passed to `submit`.
        ("userdata", c_void_p),
        # Submits a job. Called on the polling thread; must not wait for a job that runs on another thread, and must not
        # throw.
        ("submit", JobsSubmit),
    ]

LogWrite = CFUNCTYPE(None, c_void_p, c_uint32, c_char_p)


class Log(Structure):
    """A log callback. Called only by the functions that make and free models, engines and sessions or encode a text,
    on the calling thread; never by calls for the audio thread or the game thread, nor on the engine's threads.
    """

    _fields_ = [
        # Passed to `write`.
        ("userdata", c_void_p),
        # Receives one of `"info"`, `"warning"`, `"error"` and a zero-terminated text, valid until it returns. Must not
        # throw.
        ("write", LogWrite),
    ]


class EngineConfig(Structure):
    """Configuration of an engine. Initialise it with `umo_engine_config_init`."""

    _fields_ = [
        # `sizeof(EngineConfig)`.
        ("struct_size", c_uint32),
        # Threads that compute: one of `"threads"`, `"polled"`.
        ("mode", c_uint32),
        # Number of compute threads, 1 to 64. With `"polled"` the polling thread is one of them, and the engine starts
        # the others unless `jobs` lends them.
        ("threads", c_uint32),
        # Maximum number of sessions at once, 1 to 4,096.
        ("max_sessions", c_uint32),
        # Maximum number of sessions in a batch, 1 to 64: larger batches read the weights less often and need more
        # memory.
        ("max_batch", c_uint32),
        # Number of `cores`, 0 to 64.
        ("core_count", c_uint32),
        # Processor numbers to pin the engine's own threads to, one thread each; threads beyond `core_count` are not
        # pinned. NULL pins none.
        ("cores", POINTER(c_uint32)),
        # Lends the host's threads, which compute in place of the engine's own; or NULL. Only with `"polled"`.
        ("jobs", POINTER(Jobs)),
        # Log callback for this engine and its sessions, or NULL.
        ("log", POINTER(Log)),
        # Priority of the engine's own threads: one of `"normal"`, `"high"`, `"low"`. If the system refuses it, they run
        # at `"normal"`, and `log` gets a warning that says what would permit it.
        ("priority", c_uint32),
        # Batching window, milliseconds: the longest that a due chunk waits for others to be computed with. With 50 ms,
        # 32 avatars take about a fifth less processor time, and frames come later by the wait. A chunk does not wait at
        # the start of a stream, once at most half of its length is left until it would be late, or if all sessions are
        # due. 0: no chunk waits.
        ("batch_window_ms", c_uint32),
        # Kinds of cores that the engine's own threads run on if `core_count` is 0: one of `"auto"`, `"system"`,
        # `"performance"`, `"efficiency"`. All but `"system"` start at most as many threads as the kind has cores. No
        # effect where all cores are of one kind.
        ("core_kinds", c_uint32),
    ]
    # Names of the values of fields.
    choices = {
        "mode": ENGINE_MODES,
        "priority": PRIORITIES,
        "core_kinds": CORE_KINDS,
    }


class FrameLayout(Structure):
    """Layout of a frame in the host's memory: offsets in bytes from the frame's start. A value whose offset is
    `ABSENT` is not written, and bytes between values are left alone, so that frames can be the host's own
    structures. Initialise it with `umo_frame_layout_init`. Offsets and strides are multiples of the values'
    alignment in C: 4, and for `index` and `sample` that of `uint64_t`, which then also applies to `frame_stride`.
    Values must not overlap, not even in one byte, but values of different kinds may be interleaved. A layout that
    breaks this is `INVALID_ARGUMENT`, and `umo_last_error` names the fields.
    """

    _fields_ = [
        # `sizeof(FrameLayout)`.
        ("struct_size", c_uint32),
        # One of `"gltf"`, `"unreal"`, `"unity"`.
        ("axes", c_uint32),
        # Bytes from one frame to the next, at least up to the end of the last value.
        ("frame_stride", c_uint32),
        # `uint64_t`: number of the frame since the start or the last reset; there are `ModelInfo.frame_rate` frames per
        # second.
        ("index", c_uint32),
        # `uint64_t`: sample of the pushed audio, counted per channel, that the frame belongs to.
        ("sample", c_uint32),
        # `float[3]`: translation of the root, to be added to the first joint's offset in `umo_model_get_skeleton`. The
        # floor is at 0 as in the model.
        ("translation", c_uint32),
        # `float[4]` of the first joint: its rotation in its parent's frame, a unit quaternion x, y, z, w.
        ("rotations", c_uint32),
        # Bytes from one joint's rotation to the next, at least 16.
        ("rotation_stride", c_uint32),
        # `float` of the first face channel.
        ("channels", c_uint32),
        # Bytes from one channel to the next, at least 4.
        ("channel_stride", c_uint32),
        # `float[UMO_VISEME_COUNT]`: weights of the visemes; they sum to 1.
        ("visemes", c_uint32),
        # Zero, as `umo_frame_layout_init` sets it: anything else is `INVALID_ARGUMENT`.
        ("reserved", c_uint32),
    ]
    # Names of the values of fields.
    choices = {
        "axes": AXES,
    }


class GestureOptions(Structure):
    """Playback options of a gesture. Initialise them with `umo_gesture_options_init`."""

    _fields_ = [
        # `sizeof(GestureOptions)`.
        ("struct_size", c_uint32),
        # The hand: one of `"auto"`, `"left"`, `"right"`, `"both"`.
        ("side", c_uint32),
        # Axes and units of `target`: one of `"gltf"`, `"unreal"`, `"unity"`.
        ("axes", c_uint32),
        # 1 if `target` is set, else 0.
        ("has_target", c_uint32),
        # Time of the stroke, in seconds of the motion; the preparation begins correspondingly earlier. Negative: as
        # soon as no other gesture uses its parts.
        ("at", c_double),
        # Playback speed, 0.5 to 2.
        ("speed", c_float),
        # Strength, 0 to 1: lower values stay closer to the model's motion.
        ("strength", c_float),
        # Point in the avatar's space, for pointing gestures; without one they point ahead.
        ("target", c_float * 3),
        # Variant, 0 to 255: 0 is the gesture as drawn; others go through its poses in turn, and each number has a size,
        # height and speed of its own.
        ("variant", c_uint32),
    ]
    # Names of the values of fields.
    choices = {
        "side": SIDES,
        "axes": AXES,
    }


class GestureClip(Structure):
    """A clip of the host's to make a gesture from. Initialise it with `umo_gesture_clip_init`."""

    _fields_ = [
        # `sizeof(GestureClip)`.
        ("struct_size", c_uint32),
        # Axes of the rotations: one of `"gltf"`, `"unreal"`, `"unity"`.
        ("axes", c_uint32),
        # Parts of the body that it moves: a sum of `"head"`, `"trunk"`, `"left_arm"`, `"right_arm"`. The position and
        # walking of the body stay the model's.
        ("parts", c_uint32),
        # Number of frames, 2 to 3,600.
        ("frame_count", c_uint32),
        # Frames per second, 1 to 240.
        ("rate", c_float),
        # Seconds from the first frame to the stroke.
        ("stroke", c_float),
        # `float[frame_count][UMO_JOINT_COUNT][4]`: rotation of each joint in its parent's frame, a quaternion x, y, z,
        # w; identity in all joints is a T-pose. Read during the call.
        ("rotations", POINTER(c_float)),
    ]
    # Names of the values of fields.
    choices = {
        "axes": AXES,
        "parts": GESTURE_PARTS,
    }


class ModelConfig(Structure):
    """Options for loading a model. Initialise them with `umo_model_config_init`."""

    _fields_ = [
        # `sizeof(ModelConfig)`.
        ("struct_size", c_uint32),
        # One of `"stored"`, `"f32"`, `"bf16"`, `"int8"`.
        ("precision", c_uint32),
        # Upper bound on the instruction set: one of `"best"`, `"scalar"`, `"avx2"`, `"avx512vnni"`, `"amx"`,
        # `"avx512bf16"`, `"avxvnni"`, `"neon"`, `"neon_dotprod"`, `"neon_i8mm"`, `"portable"`. Float products round
        # differently on some of them, so a session can give other frames, unless `"portable"` is added: docs/spec.md,
        # section 2.9, says which give equal ones.
        ("isa", c_uint32),
        # Networks to load: one of `"all"`, `"mouth"`.
        ("parts", c_uint32),
        # Log callback for this model, or NULL. The structure is copied while the model is loaded.
        ("log", POINTER(Log)),
    ]
    # Names of the values of fields.
    choices = {
        "precision": PRECISIONS,
        "isa": ISAS,
        "parts": MODEL_PARTS,
    }


class ModelInfo(Structure):
    """Properties of a model. Set `struct_size`; `umo_model_get_info` writes the rest."""

    _fields_ = [
        # `sizeof(ModelInfo)`.
        ("struct_size", c_uint32),
        # Frames per second: 30.
        ("frame_rate", c_uint32),
        # Sample rate of the model's input in Hz; sessions take any rate and resample.
        ("sample_rate", c_uint32),
        # Joints of the body: the 55 of SMPL-X.
        ("joints", c_uint32),
        # Face channels.
        ("channels", c_uint32),
        # 1 if face channels are the 52 ARKit blendshapes, 0 to 1; 0 if they are SMPL-X expression coefficients.
        ("is_arkit", c_uint32),
        # Frames from one keyframe to the next.
        ("keyframe_stride", c_uint32),
        # Keyframes predicted per chunk by default.
        ("target", c_uint32),
        # Maximum number of keyframes per chunk.
        ("max_target", c_uint32),
        # Frames held back by default.
        ("lookahead", c_uint32),
        # Frames of future speech that a frame needs at most, with the default configuration.
        ("latency_frames", c_uint32),
        # Maximum number of ids in a prompt.
        ("max_prompt", c_uint32),
        # 1 if texts can be prompts, so that `umo_session_set_prompt` works.
        ("has_text", c_uint32),
        # 1 if `"notice"` must be shown to users: for example, that the model was never trained.
        ("has_notice", c_uint32),
        # Size of the model file in bytes.
        ("file_size", c_uint64),
        # 1 if the model has a mouth network, so that sessions can use `"live"` and `"mouth"`.
        ("has_mouth", c_uint32),
        # Upper bound on `SessionConfig.horizon`: keyframes of audio behind a chunk that a session can wait for. Useful
        # if the whole recording is available. 0 if the model does not hear ahead.
        ("max_horizon", c_uint32),
    ]


class ParameterInfo(Structure):
    """Description of a parameter. Set `struct_size`; `umo_parameter_get_info` writes the rest."""

    _fields_ = [
        # `sizeof(ParameterInfo)`.
        ("struct_size", c_uint32),
        # Number of the parameter, `"temperature"`, `"top_k"`, `"top_p"`, `"idle"`, `"gain_face"`, `"gain_hands"`,
        # `"gain_upper"`, `"gain_lower"`, `"attention"`, `"output_delay"`, `"activity"`, `"expression"`, `"layer_gaze"`,
        # `"layer_idle"`, `"layer_asymmetry"`, `"layer_nods"`, `"layer_mood"`, `"layer_feet"`, `"layer_body"`.
        ("id", c_uint32),
        # `PARAMETER_WHOLE` or 0.
        ("flags", c_uint32),
        # Zero.
        ("reserved", c_uint32),
        # Smallest value.
        ("minimum", c_double),
        # Largest value.
        ("maximum", c_double),
        # Name of the parameter: static.
        ("name", c_char_p),
    ]
    # Names of the values of fields.
    choices = {
        "id": PARAMETERS,
    }

AllocatorAllocate = CFUNCTYPE(c_void_p, c_void_p, c_size_t, c_size_t)

AllocatorRelease = CFUNCTYPE(None, c_void_p, c_void_p, c_size_t, c_size_t)


class Allocator(Structure):
    """Allocator for a session's memory. Both functions are required. They are called by `umo_session_new`, by
    `umo_session_free` and, if a session was freed while a chunk of it was being computed, by the next call of
    either or `umo_engine_free`; always on the thread of that call. They must not throw, nor call functions of
    this library.
    """

    _fields_ = [
        # Passed to both functions.
        ("userdata", c_void_p),
        # Returns `size` bytes aligned to `alignment`, a power of two, or NULL.
        ("allocate", AllocatorAllocate),
        # Releases memory from `allocate`.
        ("release", AllocatorRelease),
    ]


class SessionConfig(Structure):
    """Configuration of a session. Initialise it with `umo_session_config_init`."""

    _fields_ = [
        # `sizeof(SessionConfig)`.
        ("struct_size", c_uint32),
        # Sample rate of the pushed audio in Hz, 8,000 to 192,000.
        ("sample_rate", c_uint32),
        # Interleaved channels of the pushed audio, 1 to 64; they are mixed.
        ("channels", c_uint32),
        # Keyframes predicted per chunk, 1 to `ModelInfo.max_target`: fewer respond sooner, more give each chunk more
        # context.
        ("target", c_uint32),
        # Frames held back until the next chunk, for smoother seams; they add to the latency.
        ("lookahead", c_uint32),
        # Behaviour during silence: one of `Idle`.
        ("idle", c_uint32),
        # Milliseconds without audio after which `idle` begins.
        ("idle_after_ms", c_uint32),
        # Duration in milliseconds of the ease to rest, and of the way back.
        ("ease_ms", c_uint32),
        # Capacity of the queue of frames, at least two chunks' worth: the engine pauses while it is full.
        ("queue_frames", c_uint32),
        # Timing of the mouth, and whether there is a body: one of `"delayed"`, `"live"`, `"mouth"`.
        ("voice", c_uint32),
        # Seed of all sampling: equal seeds and audio give equal frames.
        ("seed", c_uint64),
        # Template of the model: NULL for `audio_to_motion`; `text_to_motion` needs no audio. For the latter, `umo text`
        # uses a `guidance` of 2.5 and a temperature of at most 0.7 (`"temperature"`); the defaults here are for speech.
        ("template_name", c_char_p),
        # Allocator of the session's memory, or NULL for the system's. Read while the session is made; its functions and
        # `userdata` must stay valid until the engine is freed.
        ("allocator", POINTER(Allocator)),
        # Standard deviation, in frames, of a low-pass over the body's motion, 0 to 1.5; 0 for none. If `lookahead` is
        # less, it looks two standard deviations ahead, 3 frames at most.
        ("smoothing", c_float),
        # Strength of the prompt's guidance, 1 to 3, for models of layout `frames`: 1 uses the prompt alone, at half the
        # cost of other values. Other models: 1.
        ("guidance", c_float),
        # Keyframes of audio behind a chunk that the chunk waits for, if the model was trained to hear ahead; they add
        # to the latency. Otherwise 0.
        ("horizon", c_uint32),
        # Output of chunks as packets: one of `"none"`, `"beside_frames"`, `"only"`.
        ("packets", c_uint32),
        # Keyframes before its chunk that a packet repeats, as many as fit the model's history. With a chunk's worth of
        # them, the loss of one packet changes nothing.
        ("packet_history", c_uint32),
        # Decoders only: packets that may arrive before a missing one counts as lost, 0 to 4.
        ("reorder_window", c_uint32),
        # Bytes of memory for a take that is recorded while the session runs (`umo_session_take`), some 700 a second; 0
        # for none. Not with `"live"`, `"mouth"`, `"only"` or decoders.
        ("take_bytes", c_uint64),
    ]
    # Names of the values of fields.
    choices = {
        "voice": VOICES,
        "packets": PACKETS,
    }


class Sampled(Structure):
    """Range of times available to `umo_session_sample_pose`. Set `struct_size`; the call writes the rest."""

    _fields_ = [
        # `sizeof(Sampled)`.
        ("struct_size", c_uint32),
        # 1 if the requested time was later than the newest frame.
        ("is_ahead", c_uint32),
        # Time in seconds of the oldest frame that is still available.
        ("oldest", c_double),
        # Time in seconds of the newest frame that is ready.
        ("newest", c_double),
    ]


class RawLatency(Structure):
    """Delay of motion behind speech. Set `struct_size`; `umo_session_latency` writes the rest."""

    _fields_ = [
        # `sizeof(RawLatency)`.
        ("struct_size", c_uint32),
        # Zero.
        ("reserved", c_uint32),
        # Upper bound on the future audio that a frame needs, in samples at the session's rate: no processor can shorten
        # it. It follows from the configuration's `target`, `lookahead`, `smoothing`, `horizon` and `sample_rate`.
        ("algorithmic_samples", c_uint64),
        # Median computing time in seconds: from a chunk's last sample, or from the end of the previous chunk if that is
        # later, to the chunk's frames.
        ("compute_p50", c_double),
        # 99th percentile of the computing time.
        ("compute_p99", c_double),
        # 99.9th percentile of the computing time.
        ("compute_p999", c_double),
        # Largest computing time.
        ("compute_max", c_double),
        # Current delay of the newest frame behind the newest audio, beyond `algorithmic_samples`, in samples at the
        # session's rate: 0 while the engine keeps up.
        ("backlog_samples", c_uint64),
        # The largest backlog since the session was made.
        ("backlog_max_samples", c_uint64),
        # Upper bound on the future audio that a frame's mouth needs, in samples at the session's rate:
        # `algorithmic_samples`, or less with `"live"`.
        ("mouth_samples", c_uint64),
    ]


class RawStats(Structure):
    """Statistics of a session. Set `struct_size`; `umo_session_stats` writes the rest."""

    _fields_ = [
        # `sizeof(RawStats)`.
        ("struct_size", c_uint32),
        # Zero.
        ("reserved", c_uint32),
        # Chunks computed.
        ("chunks", c_uint64),
        # Frames computed.
        ("frames", c_uint64),
        # Frames whose chunk was computed too late for real time.
        ("late_frames", c_uint64),
        # Frames that an interrupt or a reset dropped before they were shown.
        ("dropped_frames", c_uint64),
        # Samples per channel that were not taken because there was no room.
        ("overruns", c_uint64),
        # Samples that were NaN, infinite or beyond 1e6, and were replaced by silence.
        ("silenced", c_uint64),
        # Chunks whose body was held because the engine did not keep up (`umo_engine_set_late_limit`).
        ("held_chunks", c_uint64),
    ]


class RawReceived(Structure):
    """Statistics of a decoder's packets. Set `struct_size`; `umo_decoder_stats` writes the rest."""

    _fields_ = [
        # `sizeof(RawReceived)`.
        ("struct_size", c_uint32),
        # Zero.
        ("reserved", c_uint32),
        # Packets accepted.
        ("packets", c_uint64),
        # Packets that arrived too late or a second time and were ignored.
        ("late", c_uint64),
        # Chunks whose packet did not arrive in time.
        ("lost", c_uint64),
        # Keyframes of lost chunks that no other packet repeated, so that the last pose was held.
        ("held", c_uint64),
    ]


class RawTakeInfo(Structure):
    """Properties of a take. Set `struct_size`; `umo_take_get_info` writes the rest."""

    _fields_ = [
        # `sizeof(RawTakeInfo)`.
        ("struct_size", c_uint32),
        # Version of its format.
        ("version", c_uint32),
        # Frames.
        ("frames", c_uint32),
        # Frames per second.
        ("frame_rate", c_uint32),
        # Packets.
        ("packets", c_uint32),
        # Sample rate of the host's audio in Hz: that of a frame's sample while the take plays.
        ("sample_rate", c_uint32),
        # Seed of all sampling.
        ("seed", c_uint64),
        # Fingerprint of the model.
        ("model", c_uint64),
        # Fingerprint of the audio that the avatar heard: FNV-1a of 64 bits over its samples, mono floats at the model's
        # rate.
        ("audio", c_uint64),
        # Number of those samples.
        ("audio_samples", c_uint64),
        # Fingerprint of the word rules.
        ("rules", c_uint64),
    ]


class Place(Structure):
    """Where a member stands. Initialise it with `umo_place_init`."""

    _fields_ = [
        # `sizeof(Place)`.
        ("struct_size", c_uint32),
        # Axes and units of the fields below: one of `"gltf"`, `"unreal"`, `"unity"`.
        ("axes", c_uint32),
        # Position on the floor, in the scene's space.
        ("position", c_float * 3),
        # Direction that it faces, in radians about the upward axis: 0 is the axis along which an avatar looks, and the
        # sign is that of a yaw in these axes: positive to the left in glTF's, to the right in Unity's and Unreal's.
        ("facing", c_float),
        # Height of the eyes above the position; the default is 1.6 m in glTF's axes.
        ("eye_height", c_float),
    ]
    # Names of the values of fields.
    choices = {
        "axes": AXES,
    }


class Member(Structure):
    """State of a member of a scene. Set `struct_size`; `umo_scene_member` writes the rest."""

    _fields_ = [
        # `sizeof(Member)`.
        ("struct_size", c_uint32),
        # Whether it speaks: one of `Role`.
        ("role", c_uint32),
        # Whom it attends to; 0 for nobody, or for a point of the host's.
        ("attends_to", c_uint32),
        # 1 if it looks there now, 0 if it looks past.
        ("is_contact", c_uint32),
        # Nods so far.
        ("nods", c_uint32),
        # Brow raises so far.
        ("brows", c_uint32),
        # Half smiles so far.
        ("smiles", c_uint32),
        # Amount of yielding to another one that interrupts, 0 or 1.
        ("yielding", c_float),
        # Level of its voice, root mean square, full scale 1.
        ("level", c_float),
    ]


class Clip(Structure):
    """Frames to export, with their skeleton and channels. `umo_clip_init` fills in the model's fields; the host sets
    `layout`, `frames` and `frame_count`. The memory that it points to is read only during the call that takes the
    clip.
    """

    _fields_ = [
        # `sizeof(Clip)`.
        ("struct_size", c_uint32),
        # Same as `ModelInfo.is_arkit`.
        ("is_arkit", c_uint32),
        # Number of face channels, at most 1,024.
        ("channel_count", c_uint32),
        # Number of frames in `frames`.
        ("frame_count", c_uint32),
        # Frames per second.
        ("rate", c_float),
        # Zero.
        ("reserved", c_uint32),
        # Names of the face channels, UTF-8, as from `umo_model_get_channel_name`. `[channel_count]`
        ("channels", POINTER(c_char_p)),
        # `int32_t[UMO_JOINT_COUNT]`: index of each joint's parent, as from `umo_model_get_skeleton`.
        ("parents", POINTER(c_int32)),
        # `float[UMO_JOINT_COUNT][3]`: rest position of each joint in its parent's frame, metres in `"gltf"`, whatever
        # the axes of the frames.
        ("offsets", POINTER(c_float)),
        # Layout and axes of the frames. It must have translation, rotations and channels.
        ("layout", POINTER(FrameLayout)),
        # The first frame, at second 0 of the file.
        ("frames", c_void_p),
        # Figure to skin in `"glb"`: a name from `umo_figure_name`. NULL: the skeleton alone, without a face.
        ("figure", c_char_p),
    ]

OutputWrite = CFUNCTYPE(c_int32, c_void_p, c_void_p, c_size_t)


class Output(Structure):
    """Destination of a file's bytes."""

    _fields_ = [
        # Passed to `write`.
        ("userdata", c_void_p),
        # Takes the next bytes of the file, at least one; they are valid until it returns. Returns 0 to go on, any other
        # number to stop. Called on the thread that called `umo_clip_write`. Must not throw.
        ("write", OutputWrite),
    ]


class Rig(Structure):
    """A character's skeleton at rest, and its mesh. `umo_rig_init` fills in the defaults. The memory that it points
    to is read only by `umo_retarget_new`. Places and rotations are in the character's space, not relative to
    parents, in `axes`; it may face anywhere and stand in any pose between a T and an A. Scale is in the places.
    """

    _fields_ = [
        # `sizeof(Rig)`.
        ("struct_size", c_uint32),
        # Axes of the character's space, and of the poses: one of `"gltf"`, `"unreal"`, `"unity"`.
        ("axes", c_uint32),
        # Number of bones, 1 to 65,536.
        ("bone_count", c_uint32),
        # Number of points of the mesh; 0: the body has a person's proportions.
        ("vertex_count", c_uint32),
        # Number of `indices`, three for each triangle; 0: the points are spread over the surface by the host.
        ("index_count", c_uint32),
        # Strength of the body's volume, 0 to 1. 0: arms go through the body. At 1 they keep out of trunk, head, legs
        # and each other, and touch where the model's do.
        ("gain", c_float),
        # Factors of the measured girth of pelvis, belly, chest, neck, head, upper arms, forearms, hands, thighs: 0 to
        # 10.
        ("girths", c_float * 9),
        # Zero.
        ("reserved", c_uint32),
        # Names of the bones, UTF-8; NULL if `joints` is given. `[bone_count]`
        ("names", POINTER(c_char_p)),
        # `int32_t[bone_count]`: index of each bone's parent, -1 for none.
        ("parents", POINTER(c_int32)),
        # `int32_t[bone_count]`: joint that each bone follows, -1 for none. Bones of the joints 3, 6 and 9 are the spine
        # from the hips up, whatever their number, bones of joint 12 the neck. NULL: found by `names`.
        ("joints", POINTER(c_int32)),
        # `float[bone_count][3]`: places of the bones at rest.
        ("places", POINTER(c_float)),
        # `float[bone_count][4]`: rotations of the bones at rest, quaternions x, y, z, w.
        ("rotations", POINTER(c_float)),
        # `float[vertex_count][3]`: places of the mesh's points at rest.
        ("vertices", POINTER(c_float)),
        # `int32_t[vertex_count]`: bone that has at least half of each point's weight, -1 for none.
        ("vertex_bones", POINTER(c_int32)),
        # `uint32_t[index_count]`: points of the triangles.
        ("indices", POINTER(c_uint32)),
    ]
    # Names of the values of fields.
    choices = {
        "axes": AXES,
    }


class Latency(NamedTuple):
    """Delay of motion behind speech."""

    algorithmic_samples: int
    """Upper bound on the future audio that a frame needs, in samples at the session's rate: no processor can shorten
    it. It follows from the configuration's `target`, `lookahead`, `smoothing`, `horizon` and `sample_rate`.
    """
    compute_p50: float
    """Median computing time in seconds: from a chunk's last sample, or from the end of the previous chunk if that is
    later, to the chunk's frames.
    """
    compute_p99: float
    """99th percentile of the computing time."""
    compute_p999: float
    """99.9th percentile of the computing time."""
    compute_max: float
    """Largest computing time."""
    backlog_samples: int
    """Current delay of the newest frame behind the newest audio, beyond `algorithmic_samples`, in samples at the
    session's rate: 0 while the engine keeps up.
    """
    backlog_max_samples: int
    """The largest backlog since the session was made."""
    mouth_samples: int
    """Upper bound on the future audio that a frame's mouth needs, in samples at the session's rate:
    `algorithmic_samples`, or less with `"live"`.
    """


class Stats(NamedTuple):
    """Statistics of a session."""

    chunks: int
    """Chunks computed."""
    frames: int
    """Frames computed."""
    late_frames: int
    """Frames whose chunk was computed too late for real time."""
    dropped_frames: int
    """Frames that an interrupt or a reset dropped before they were shown."""
    overruns: int
    """Samples per channel that were not taken because there was no room."""
    silenced: int
    """Samples that were NaN, infinite or beyond 1e6, and were replaced by silence."""
    held_chunks: int
    """Chunks whose body was held because the engine did not keep up (`umo_engine_set_late_limit`)."""


class Received(NamedTuple):
    """Statistics of a decoder's packets."""

    packets: int
    """Packets accepted."""
    late: int
    """Packets that arrived too late or a second time and were ignored."""
    lost: int
    """Chunks whose packet did not arrive in time."""
    held: int
    """Keyframes of lost chunks that no other packet repeated, so that the last pose was held."""


class TakeInfo(NamedTuple):
    """Properties of a take."""

    version: int
    """Version of its format."""
    frames: int
    """Frames."""
    frame_rate: int
    """Frames per second."""
    packets: int
    """Packets."""
    sample_rate: int
    """Sample rate of the host's audio in Hz: that of a frame's sample while the take plays."""
    seed: int
    """Seed of all sampling."""
    model: int
    """Fingerprint of the model."""
    audio: int
    """Fingerprint of the audio that the avatar heard: FNV-1a of 64 bits over its samples, mono floats at the model's
    rate.
    """
    audio_samples: int
    """Number of those samples."""
    rules: int
    """Fingerprint of the word rules."""


class EngineArguments:
    """Base of `Engine`: its arguments."""

    def __init__(
        self,
        model: Optional[Model] = None,
        *,
        polled: bool = False,
        cores: Sequence[int] = (),
        threads: Optional[int] = None,
        max_sessions: Optional[int] = None,
        max_batch: Optional[int] = None,
        priority: Optional[str] = None,
        batch_window: Optional[float] = None,
        core_kinds: Optional[str] = None,
    ) -> None:
        """Makes an engine. What is None is the library's default.

        - `threads`: Number of compute threads, 1 to 64. With `"polled"` the polling thread is one of them, and
          the engine starts the others unless `jobs` lends them.
        - `max_sessions`: Maximum number of sessions at once, 1 to 4,096.
        - `max_batch`: Maximum number of sessions in a batch, 1 to 64: larger batches read the weights less
          often and need more memory.
        - `priority`: Priority of the engine's own threads: one of `"normal"`, `"high"`, `"low"`. If the system
          refuses it, they run at `"normal"`, and `log` gets a warning that says what would permit it.
        - `batch_window`: Batching window, seconds: the longest that a due chunk waits for others to be computed
          with. With 50 ms, 32 avatars take about a fifth less processor time, and frames come later by the
          wait. A chunk does not wait at the start of a stream, once at most half of its length is left until it
          would be late, or if all sessions are due. 0: no chunk waits.
        - `core_kinds`: Kinds of cores that the engine's own threads run on if `core_count` is 0: one of
          `"auto"`, `"system"`, `"performance"`, `"efficiency"`. All but `"system"` start at most as many
          threads as the kind has cores. No effect where all cores are of one kind.
        """
        self._make(model, polled, cores, threads=threads, max_sessions=max_sessions, max_batch=max_batch, priority=priority, batch_window_ms=batch_window, core_kinds=core_kinds)

    def _make(self, model: Optional[Model], polled: bool, cores: Sequence[int], **settings: Any) -> None:
        raise NotImplementedError
