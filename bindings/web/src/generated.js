// Constants and structures of umo.h. Generated from umo-capi/src by umo-capi/header: change it there.

/**
 * Version of this interface: major number in the upper 16 bits, minor number in the lower. A library serves programs with
 * the same major number and at most its own minor number.
 */
export const ABI_VERSION = 1;
/** Offset meaning: do not write this field. */
export const ABSENT = 4294967295;
/** Visemes per frame. */
export const VISEME_COUNT = 15;
/** Joints of every model. */
export const JOINT_COUNT = 55;
/** The parameter takes only whole numbers. */
export const PARAMETER_WHOLE = 1;
/** Maximum length in bytes of a self-test's report, including its terminating zero. */
export const SELF_TEST_SIZE = 8192;
/** Maximum length in bytes of an error's detail, including its terminating zero. */
export const ERROR_SIZE = 512;
/** Upper bound on the members of a scene. */
export const SCENE_MEMBER_COUNT = 32;
/** Result of a call: OK, or a negative error code. */
export const STATUSES = Object.freeze({
  /** Success. */
  OK: 0,
  /** A required pointer is NULL. */
  NULL_POINTER: -1,
  /** A handle is unknown, freed, or of another kind. */
  INVALID_HANDLE: -2,
  /** An argument is out of range. */
  INVALID_ARGUMENT: -3,
  /** Unknown `struct_size`: call the structure's initializer, or set it to `sizeof`. */
  STRUCT_SIZE: -4,
  /** A buffer is too small for the output. */
  BUFFER_TOO_SMALL: -5,
  /** The program was compiled with the header of an incompatible version. */
  VERSION: -6,
  /** A file cannot be read or written. */
  IO: -7,
  /** The file is not a usable model. */
  MODEL: -8,
  /** There is not enough memory, or the host's allocator returned NULL. */
  OUT_OF_MEMORY: -9,
  /** No free slot: free a model, an engine or a session first. */
  FULL: -10,
  /** Another thread is in a call that excludes this one: call again. Nothing was done. */
  BUSY: -11,
  /** Audio was pushed after `umo_session_finish`: reset or interrupt the session first. */
  FINISHED: -12,
  /** The session's computation failed: it gives no more frames. Free it. */
  FAILED: -13,
  /** The session's engine was freed: it gives no more frames. Free it. */
  CLOSED: -14,
  /**
   * A panic of this library was caught, without output; the session concerned cannot be used any more. Free it, and report
   * the defect: `umo_session_last_error` (or `umo_last_error`) has the panic's message and its place in the source.
   */
  PANIC: -15,
  /** This model, processor or engine cannot do that. */
  UNSUPPORTED: -16,
  /** The bytes are not a state of a session with this configuration. Nothing was changed. */
  STATE: -17,
  /** A worker thread could not be created or pinned. */
  THREAD: -18,
  /** The bytes are not a packet for this decoder. Nothing was changed. */
  PACKET: -19,
  /** The bytes are not a take, or a damaged one. */
  TAKE: -20,
});
/** Axes, handedness and unit of length. */
export const AXES = Object.freeze({
  /** glTF and Godot: Y up, right-handed, metres; the avatar looks along +Z, its left hand is towards +X. */
  gltf: 0,
  /** Unreal: Z up, left-handed, centimetres; the avatar looks along +X, its right hand is towards +Y. */
  unreal: 1,
  /** Unity: Y up, left-handed, metres; the avatar looks along +Z, its right hand is towards +X. */
  unity: 2,
});
/** Threads that compute: the engine's own, or the host's. */
export const ENGINE_MODES = Object.freeze({
  /** The engine computes on its own threads. */
  threads: 0,
  /** The host computes by calling `umo_engine_poll`. */
  polled: 1,
});
/** Priority of an engine's own threads. */
export const PRIORITIES = Object.freeze({
  /** Default priority of the process's new threads. */
  normal: 0,
  /**
   * Priority above normal: frames are nearly as fast beside a program that keeps every core busy. Linux refuses it to most
   * users; Windows, Android and Apple's systems grant it.
   */
  high: 1,
  /** Priority below normal: threads use the time that others leave. */
  low: 2,
});
/** Kinds of cores that an engine's own threads run on. */
export const CORE_KINDS = Object.freeze({
  /**
   * On a machine with fast and slow cores: a crowd on the kind whose cores are the fastest together; what one slower core
   * computes with room to spare, on that core, unless the priority is high.
   */
  auto: 0,
  /** Threads run wherever the system puts them. */
  system: 1,
  /** The fastest kind of cores alone. */
  performance: 2,
  /** The slowest kind of cores that is not low-power, alone. */
  efficiency: 3,
});
/** Networks of a model to load. */
export const MODEL_PARTS = Object.freeze({
  /** All networks of the model. */
  all: 0,
  /**
   * The live mouth alone, at its stored precision: a fraction of the memory. Sessions need `"mouth"`, and engines have no
   * threads.
   */
  mouth: 1,
});
/** Hand of a gesture. */
export const SIDES = Object.freeze({
  /** The right hand; for a gesture with a target, the hand nearer to it. */
  auto: 0,
  /** The left hand: the whole gesture is mirrored. */
  left: 1,
  /** The right hand. */
  right: 2,
  /** Both hands if the gesture supports it, otherwise as `"auto"`. */
  both: 3,
});
/** Parts of the body that a gesture moves. */
export const GESTURE_PARTS = Object.freeze({
  /** Neck and head. */
  head: 1,
  /** Spine. */
  trunk: 2,
  /** Left arm, from collar to fingers. */
  leftArm: 4,
  /** Right arm, from collar to fingers. */
  rightArm: 8,
});
/** Level of a log message. */
export const LOG_LEVELS = Object.freeze({
  /** Log level: information. */
  info: 1,
  /** Log level: warning. */
  warning: 2,
  /** Log level: error. */
  error: 3,
});
/** Precision of a model's weights. */
export const PRECISIONS = Object.freeze({
  /** Weights as stored in the file. */
  stored: 0,
  /** All products in f32. */
  f32: 1,
  /** Weights rounded to bfloat16. */
  bf16: 2,
  /** Weights rounded to int8. */
  int8: 3,
});
/** Upper bound on the instruction set. */
export const ISAS = Object.freeze({
  /** The fastest instruction set of the processor. */
  best: 0,
  /** Portable code. */
  scalar: 1,
  /** At most AVX2. */
  avx2: 2,
  /** At most AVX-512 with VNNI. */
  avx512vnni: 3,
  /** At most AMX. */
  amx: 4,
  /** At most AVX-512 with VNNI and products of bfloat16. */
  avx512bf16: 5,
  /** At most AVX2 with VNNI. */
  avxvnni: 6,
  /** At most NEON, on 64-bit Arm. */
  neon: 7,
  /** At most NEON with dot products of int8. */
  neonDotprod: 8,
  /** At most NEON with dot products and matrix products of int8. */
  neonI8mm: 9,
  /** Added to one of the others: the same bits on every processor, from the same sound. docs/packets.md says when it pays. */
  portable: 256,
});
/** Text of a model. */
export const MODEL_TEXTS = Object.freeze({
  /** Name of the model. */
  name: 1,
  /** Licence of its weights. */
  license: 2,
  /** Notice that must be shown to users; may be empty. */
  notice: 3,
  /** Instruction set that the model was packed for, such as `avx512vnni`. */
  isa: 4,
  /** Prompts that the model was trained with, one a line; empty if it has no list. */
  prompts: 5,
});
/** Parameter of a running session. */
export const Parameter = Object.freeze({
  /** Sampling temperature: 0 always takes the likeliest code; the model's default is the value it was tuned for. */
  temperature: 1,
  /** Top-k sampling: number of the likeliest codes to sample from; 0 for all. */
  topK: 2,
  /** Top-p sampling: samples from the likeliest codes that together reach this probability. */
  topP: 3,
  /** Idle mode, while no audio comes: one of `Idle`. */
  idle: 4,
  /** Gain of the face's motion, jaw and eyes included: 0 is at rest, 1 as computed, 2 exaggerated. */
  gainFace: 16,
  /** Gain of the fingers' motion. */
  gainHands: 17,
  /** Gain of the motion of spine, neck, head and arms. */
  gainUpper: 18,
  /** Gain of the motion of pelvis and legs, and of the body through the world. */
  gainLower: 19,
  /** Attention of the avatar: one of `Attention`. */
  attention: 5,
  /**
   * Delay of the output device in seconds, from playing a sound to hearing it: `umo_session_sample_pose` shows a pose that
   * much earlier. 0 to 2; some 0.2 for Bluetooth.
   */
  outputDelay: 6,
  /** Activity of the hands, 0 to 1: how often they leave rest. 0.5 is the default; at 1 they hardly rest, at 0 hardly rise. */
  activity: 7,
  /** Expression, 0 to 1: how far body and face follow the arousal of the voice. 0.5 is the default, 0 ignores the voice. */
  expression: 8,
  /** Strength of the layer of blinks, gaze and lids over the model's motion, 0 to 1. */
  layerGaze: 32,
  /** Strength of breath, sway, weight shifts and fingers, and of hands at rest between gestures. */
  layerIdle: 33,
  /** Strength of the asymmetry between the face's left and right. */
  layerAsymmetry: 34,
  /** Strength of nods on accents, and while listening. */
  layerNods: 35,
  /** Strength of the mood's face and posture; without a mood, strength of removing a frown that no mood asked for. */
  layerMood: 36,
  /** Strength of planted feet, steps, and the root's return to where it stood. */
  layerFeet: 37,
  /** Strength of trunk, shoulders and legs that go with the hands. */
  layerBody: 38,
});
/** Attention of the avatar. */
export const Attention = Object.freeze({
  /**
   * Speaking while its own audio is heard, otherwise idle; in a scene, and after `umo_session_push_other_audio`, also
   * listening.
   */
  auto: 0,
  /** Nothing in particular. */
  idle: 1,
  /** The one who speaks: the avatar looks there, nods, and raises its brows. */
  listening: 2,
  /** An answer to give: the avatar looks away. */
  thinking: 3,
  /** Its own speech. */
  speaking: 4,
});
/** Mood of face and posture. */
export const Mood = Object.freeze({
  /** No mood: the model's face without its frown. */
  neutral: 0,
  /** Joy. */
  joy: 1,
  /** Sadness. */
  sad: 2,
  /** Anger. */
  angry: 3,
  /** Surprise. */
  surprised: 4,
  /** Disgust. */
  disgusted: 5,
  /** Fear. */
  afraid: 6,
});
/** Shape of the lips for a visible sound. */
export const LIPS = Object.freeze({
  /** The lips meet: p, b, m. */
  closed: 0,
  /** The lower lip is at the upper teeth: f, v. */
  teeth: 1,
  /** The lips are rounded: w, and vowels such as that of "boot". */
  round: 2,
});
/** Behaviour while no audio comes. */
export const Idle = Object.freeze({
  /** The last pose is held. */
  hold: 0,
  /** `umo_session_sample_pose` eases to the rest pose. */
  rest: 1,
  /** The model runs on silence. */
  live: 2,
});
/** Timing of the mouth, and whether there is a body. */
export const VOICES = Object.freeze({
  /** The mouth moves with the body, later than the sound by the session's latency. */
  delayed: 0,
  /**
   * The mouth follows the sound after `Latency.mouthSamples`: with the default model 11 ms at 16 kHz, 18 ms at 48 kHz. The
   * body follows after the session's latency, and the stream has correspondingly more frames at its end. For a microphone,
   * or a voice that is played as it arrives.
   */
  live: 1,
  /**
   * The mouth alone, timed as with `"live"`: no chunk is computed, and the engine has nothing to do. The body is at rest,
   * with the layers over it: it breathes, looks, nods and gestures as asked. For voice chat; the one voice of a model loaded
   * with `"mouth"`.
   */
  mouth: 2,
});
/** Output of chunks as packets. */
export const PACKETS = Object.freeze({
  /** Chunks are output as frames only. */
  none: 0,
  /** Chunks are output as frames and as packets: pull both. */
  besideFrames: 1,
  /** Chunks are output as packets only, for a server whose avatars are shown elsewhere. */
  only: 2,
});
/** Parts that a scene plays of a member. */
export const SCENE_PARTS = Object.freeze({
  /** The member's looks: at whom, and away. */
  look: 1,
  /** Nods and raised brows of the member while it listens. */
  nod: 2,
  /** Half smiles of the member while it listens. */
  smile: 4,
  /** Lean and shifts of weight of the member, its own and those that follow another's. */
  mirror: 8,
  /** Giving way to who interrupts the member. */
  yield: 16,
});
/** What a member of a scene does. */
export const ROLES = Object.freeze({
  /** Nobody speaks. */
  idle: 0,
  /** Another member speaks. */
  listening: 1,
  /** The member speaks. */
  speaking: 2,
});
/** Format of a file of frames. */
export const FORMATS = Object.freeze({
  /** Binary glTF 2.0, `.glb`: a skinned figure, or the skeleton alone. */
  glb: 1,
  /** VRM Animation 1.0, `.vrma`, for any VRM avatar. */
  vrma: 2,
});

// Structures where pointers have 32 bits: bytes; and of each field the offset, the type, and the names of its values.
export const JOBS = {
  size: 8,
  fields: {
    userdata: [0, "Pointer"],
    submit: [4, "Pointer"],
  },
};
export const LOG = {
  size: 8,
  fields: {
    userdata: [0, "Pointer"],
    write: [4, "Pointer"],
  },
};
export const ENGINE_CONFIG = {
  size: 48,
  fields: {
    structSize: [0, "Uint32"],
    mode: [4, "Uint32", ENGINE_MODES],
    threads: [8, "Uint32"],
    maxSessions: [12, "Uint32"],
    maxBatch: [16, "Uint32"],
    coreCount: [20, "Uint32"],
    cores: [24, "Pointer"],
    jobs: [28, "Pointer"],
    log: [32, "Pointer"],
    priority: [36, "Uint32", PRIORITIES],
    batchWindowMs: [40, "Uint32"],
    coreKinds: [44, "Uint32", CORE_KINDS],
  },
  options: ["threads", "maxSessions", "maxBatch", "priority", "batchWindowMs", "coreKinds"],
};
export const FRAME_LAYOUT = {
  size: 48,
  fields: {
    structSize: [0, "Uint32"],
    axes: [4, "Uint32", AXES],
    frameStride: [8, "Uint32"],
    index: [12, "Uint32"],
    sample: [16, "Uint32"],
    translation: [20, "Uint32"],
    rotations: [24, "Uint32"],
    rotationStride: [28, "Uint32"],
    channels: [32, "Uint32"],
    channelStride: [36, "Uint32"],
    visemes: [40, "Uint32"],
    reserved: [44, "Uint32"],
  },
};
export const GESTURE_OPTIONS = {
  size: 48,
  fields: {
    structSize: [0, "Uint32"],
    side: [4, "Uint32", SIDES],
    axes: [8, "Uint32", AXES],
    hasTarget: [12, "Uint32"],
    at: [16, "Float64"],
    speed: [24, "Float32"],
    strength: [28, "Float32"],
    target: [32, "Float32"],
    variant: [44, "Uint32"],
  },
};
export const GESTURE_CLIP = {
  size: 28,
  fields: {
    structSize: [0, "Uint32"],
    axes: [4, "Uint32", AXES],
    parts: [8, "Uint32", GESTURE_PARTS],
    frameCount: [12, "Uint32"],
    rate: [16, "Float32"],
    stroke: [20, "Float32"],
    rotations: [24, "Pointer"],
  },
};
export const MODEL_CONFIG = {
  size: 20,
  fields: {
    structSize: [0, "Uint32"],
    precision: [4, "Uint32", PRECISIONS],
    isa: [8, "Uint32", ISAS],
    parts: [12, "Uint32", MODEL_PARTS],
    log: [16, "Pointer"],
  },
};
export const MODEL_INFO = {
  size: 72,
  fields: {
    structSize: [0, "Uint32"],
    frameRate: [4, "Uint32"],
    sampleRate: [8, "Uint32"],
    joints: [12, "Uint32"],
    channels: [16, "Uint32"],
    isArkit: [20, "Uint32"],
    keyframeStride: [24, "Uint32"],
    target: [28, "Uint32"],
    maxTarget: [32, "Uint32"],
    lookahead: [36, "Uint32"],
    latencyFrames: [40, "Uint32"],
    maxPrompt: [44, "Uint32"],
    hasText: [48, "Uint32"],
    hasNotice: [52, "Uint32"],
    fileSize: [56, "BigUint64"],
    hasMouth: [64, "Uint32"],
    maxHorizon: [68, "Uint32"],
  },
};
export const PARAMETER_INFO = {
  size: 40,
  fields: {
    structSize: [0, "Uint32"],
    id: [4, "Uint32"],
    flags: [8, "Uint32"],
    reserved: [12, "Uint32"],
    minimum: [16, "Float64"],
    maximum: [24, "Float64"],
    name: [32, "Pointer"],
  },
};
export const ALLOCATOR = {
  size: 12,
  fields: {
    userdata: [0, "Pointer"],
    allocate: [4, "Pointer"],
    release: [8, "Pointer"],
  },
};
export const SESSION_CONFIG = {
  size: 88,
  fields: {
    structSize: [0, "Uint32"],
    sampleRate: [4, "Uint32"],
    channels: [8, "Uint32"],
    target: [12, "Uint32"],
    lookahead: [16, "Uint32"],
    idle: [20, "Uint32"],
    idleAfterMs: [24, "Uint32"],
    easeMs: [28, "Uint32"],
    queueFrames: [32, "Uint32"],
    voice: [36, "Uint32", VOICES],
    seed: [40, "BigUint64"],
    templateName: [48, "Pointer"],
    allocator: [52, "Pointer"],
    smoothing: [56, "Float32"],
    guidance: [60, "Float32"],
    horizon: [64, "Uint32"],
    packets: [68, "Uint32", PACKETS],
    packetHistory: [72, "Uint32"],
    reorderWindow: [76, "Uint32"],
    takeBytes: [80, "BigUint64"],
  },
  options: ["sampleRate", "channels", "target", "lookahead", "idle", "idleAfterMs", "easeMs", "queueFrames", "voice", "seed", "smoothing", "guidance", "horizon", "packets", "packetHistory", "reorderWindow", "takeBytes"],
};
export const SAMPLED = {
  size: 24,
  fields: {
    structSize: [0, "Uint32"],
    isAhead: [4, "Uint32"],
    oldest: [8, "Float64"],
    newest: [16, "Float64"],
  },
};
export const LATENCY = {
  size: 72,
  fields: {
    structSize: [0, "Uint32"],
    reserved: [4, "Uint32"],
    algorithmicSamples: [8, "BigUint64"],
    computeP50: [16, "Float64"],
    computeP99: [24, "Float64"],
    computeP999: [32, "Float64"],
    computeMax: [40, "Float64"],
    backlogSamples: [48, "BigUint64"],
    backlogMaxSamples: [56, "BigUint64"],
    mouthSamples: [64, "BigUint64"],
  },
};
export const STATS = {
  size: 64,
  fields: {
    structSize: [0, "Uint32"],
    reserved: [4, "Uint32"],
    chunks: [8, "BigUint64"],
    frames: [16, "BigUint64"],
    lateFrames: [24, "BigUint64"],
    droppedFrames: [32, "BigUint64"],
    overruns: [40, "BigUint64"],
    silenced: [48, "BigUint64"],
    heldChunks: [56, "BigUint64"],
  },
};
export const RECEIVED = {
  size: 40,
  fields: {
    structSize: [0, "Uint32"],
    reserved: [4, "Uint32"],
    packets: [8, "BigUint64"],
    late: [16, "BigUint64"],
    lost: [24, "BigUint64"],
    held: [32, "BigUint64"],
  },
};
export const TAKE_INFO = {
  size: 64,
  fields: {
    structSize: [0, "Uint32"],
    version: [4, "Uint32"],
    frames: [8, "Uint32"],
    frameRate: [12, "Uint32"],
    packets: [16, "Uint32"],
    sampleRate: [20, "Uint32"],
    seed: [24, "BigUint64"],
    model: [32, "BigUint64"],
    audio: [40, "BigUint64"],
    audioSamples: [48, "BigUint64"],
    rules: [56, "BigUint64"],
  },
};
export const PLACE = {
  size: 28,
  fields: {
    structSize: [0, "Uint32"],
    axes: [4, "Uint32", AXES],
    position: [8, "Float32"],
    facing: [20, "Float32"],
    eyeHeight: [24, "Float32"],
  },
};
export const MEMBER = {
  size: 36,
  fields: {
    structSize: [0, "Uint32"],
    role: [4, "Uint32", ROLES],
    attendsTo: [8, "Uint32"],
    isContact: [12, "Uint32"],
    nods: [16, "Uint32"],
    brows: [20, "Uint32"],
    smiles: [24, "Uint32"],
    yielding: [28, "Float32"],
    level: [32, "Float32"],
  },
};
export const CLIP = {
  size: 48,
  fields: {
    structSize: [0, "Uint32"],
    isArkit: [4, "Uint32"],
    channelCount: [8, "Uint32"],
    frameCount: [12, "Uint32"],
    rate: [16, "Float32"],
    reserved: [20, "Uint32"],
    channels: [24, "Pointer"],
    parents: [28, "Pointer"],
    offsets: [32, "Pointer"],
    layout: [36, "Pointer"],
    frames: [40, "Pointer"],
    figure: [44, "Pointer"],
  },
};
export const OUTPUT = {
  size: 8,
  fields: {
    userdata: [0, "Pointer"],
    write: [4, "Pointer"],
  },
};
export const RIG = {
  size: 96,
  fields: {
    structSize: [0, "Uint32"],
    axes: [4, "Uint32", AXES],
    boneCount: [8, "Uint32"],
    vertexCount: [12, "Uint32"],
    indexCount: [16, "Uint32"],
    gain: [20, "Float32"],
    girths: [24, "Float32"],
    reserved: [60, "Uint32"],
    names: [64, "Pointer"],
    parents: [68, "Pointer"],
    joints: [72, "Pointer"],
    places: [76, "Pointer"],
    rotations: [80, "Pointer"],
    vertices: [84, "Pointer"],
    vertexBones: [88, "Pointer"],
    indices: [92, "Pointer"],
  },
};
