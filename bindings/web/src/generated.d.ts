// Constants and options of umo.h. Generated from umo-capi/src by umo-capi/header: change it there.

/** Parameter of a running session. */
export const Parameter: Readonly<{
  /** Sampling temperature: 0 always takes the likeliest code; the model's default is the value it was tuned for. */
  temperature: 1;
  /** Top-k sampling: number of the likeliest codes to sample from; 0 for all. */
  topK: 2;
  /** Top-p sampling: samples from the likeliest codes that together reach this probability. */
  topP: 3;
  /** Idle mode, while no audio comes: one of `Idle`. */
  idle: 4;
  /** Gain of the face's motion, jaw and eyes included: 0 is at rest, 1 as computed, 2 exaggerated. */
  gainFace: 16;
  /** Gain of the fingers' motion. */
  gainHands: 17;
  /** Gain of the motion of spine, neck, head and arms. */
  gainUpper: 18;
  /** Gain of the motion of pelvis and legs, and of the body through the world. */
  gainLower: 19;
  /** Attention of the avatar: one of `Attention`. */
  attention: 5;
  /**
   * Delay of the output device in seconds, from playing a sound to hearing it: `umo_session_sample_pose` shows a pose that
   * much earlier. 0 to 2; some 0.2 for Bluetooth.
   */
  outputDelay: 6;
  /** Activity of the hands, 0 to 1: how often they leave rest. 0.5 is the default; at 1 they hardly rest, at 0 hardly rise. */
  activity: 7;
  /** Expression, 0 to 1: how far body and face follow the arousal of the voice. 0.5 is the default, 0 ignores the voice. */
  expression: 8;
  /** Strength of the layer of blinks, gaze and lids over the model's motion, 0 to 1. */
  layerGaze: 32;
  /** Strength of breath, sway, weight shifts and fingers, and of hands at rest between gestures. */
  layerIdle: 33;
  /** Strength of the asymmetry between the face's left and right. */
  layerAsymmetry: 34;
  /** Strength of nods on accents, and while listening. */
  layerNods: 35;
  /** Strength of the mood's face and posture; without a mood, strength of removing a frown that no mood asked for. */
  layerMood: 36;
  /** Strength of planted feet, steps, and the root's return to where it stood. */
  layerFeet: 37;
  /** Strength of trunk, shoulders and legs that go with the hands. */
  layerBody: 38;
}>;
/** Attention of the avatar. */
export const Attention: Readonly<{
  /**
   * Speaking while its own audio is heard, otherwise idle; in a scene, and after `umo_session_push_other_audio`, also
   * listening.
   */
  auto: 0;
  /** Nothing in particular. */
  idle: 1;
  /** The one who speaks: the avatar looks there, nods, and raises its brows. */
  listening: 2;
  /** An answer to give: the avatar looks away. */
  thinking: 3;
  /** Its own speech. */
  speaking: 4;
}>;
/** Mood of face and posture. */
export const Mood: Readonly<{
  /** No mood: the model's face without its frown. */
  neutral: 0;
  /** Joy. */
  joy: 1;
  /** Sadness. */
  sad: 2;
  /** Anger. */
  angry: 3;
  /** Surprise. */
  surprised: 4;
  /** Disgust. */
  disgusted: 5;
  /** Fear. */
  afraid: 6;
}>;
/** Behaviour while no audio comes. */
export const Idle: Readonly<{
  /** The last pose is held. */
  hold: 0;
  /** `umo_session_sample_pose` eases to the rest pose. */
  rest: 1;
  /** The model runs on silence. */
  live: 2;
}>;

export interface EngineOptions {
  /**
   * Number of compute threads, 1 to 64. With `"polled"` the polling thread is one of them, and the engine starts the others
   * unless `jobs` lends them.
   */
  threads?: number;
  /** Maximum number of sessions at once, 1 to 4,096. */
  maxSessions?: number;
  /** Maximum number of sessions in a batch, 1 to 64: larger batches read the weights less often and need more memory. */
  maxBatch?: number;
  /**
   * Priority of the engine's own threads: one of `"normal"`, `"high"`, `"low"`. If the system refuses it, they run at
   * `"normal"`, and `log` gets a warning that says what would permit it.
   */
  priority?: "normal" | "high" | "low";
  /**
   * Batching window, milliseconds: the longest that a due chunk waits for others to be computed with. With 50 ms, 32 avatars
   * take about a fifth less processor time, and frames come later by the wait. A chunk does not wait at the start of a
   * stream, once at most half of its length is left until it would be late, or if all sessions are due. 0: no chunk waits.
   */
  batchWindowMs?: number;
  /**
   * Kinds of cores that the engine's own threads run on if `coreCount` is 0: one of `"auto"`, `"system"`, `"performance"`,
   * `"efficiency"`. All but `"system"` start at most as many threads as the kind has cores. No effect where all cores are of
   * one kind.
   */
  coreKinds?: "auto" | "system" | "performance" | "efficiency";
}

export interface SessionOptions {
  /** Sample rate of the pushed audio in Hz, 8,000 to 192,000. */
  sampleRate?: number;
  /** Interleaved channels of the pushed audio, 1 to 64; they are mixed. */
  channels?: number;
  /** Keyframes predicted per chunk, 1 to `ModelInfo.maxTarget`: fewer respond sooner, more give each chunk more context. */
  target?: number;
  /** Frames held back until the next chunk, for smoother seams; they add to the latency. */
  lookahead?: number;
  /** Behaviour during silence: one of `Idle`. */
  idle?: number;
  /** Milliseconds without audio after which `idle` begins. */
  idleAfterMs?: number;
  /** Duration in milliseconds of the ease to rest, and of the way back. */
  easeMs?: number;
  /** Capacity of the queue of frames, at least two chunks' worth: the engine pauses while it is full. */
  queueFrames?: number;
  /** Timing of the mouth, and whether there is a body: one of `"delayed"`, `"live"`, `"mouth"`. */
  voice?: "delayed" | "live" | "mouth";
  /** Seed of all sampling: equal seeds and audio give equal frames. */
  seed?: number | bigint;
  /**
   * Standard deviation, in frames, of a low-pass over the body's motion, 0 to 1.5; 0 for none. If `lookahead` is less, it
   * looks two standard deviations ahead, 3 frames at most.
   */
  smoothing?: number;
  /**
   * Strength of the prompt's guidance, 1 to 3, for models of layout `frames`: 1 uses the prompt alone, at half the cost of
   * other values. Other models: 1.
   */
  guidance?: number;
  /**
   * Keyframes of audio behind a chunk that the chunk waits for, if the model was trained to hear ahead; they add to the
   * latency. Otherwise 0.
   */
  horizon?: number;
  /** Output of chunks as packets: one of `"none"`, `"besideFrames"`, `"only"`. */
  packets?: "none" | "besideFrames" | "only";
  /**
   * Keyframes before its chunk that a packet repeats, as many as fit the model's history. With a chunk's worth of them, the
   * loss of one packet changes nothing.
   */
  packetHistory?: number;
  /** Decoders only: packets that may arrive before a missing one counts as lost, 0 to 4. */
  reorderWindow?: number;
  /**
   * Bytes of memory for a take that is recorded while the session runs (`umo_session_take`), some 700 a second; 0 for none.
   * Not with `"live"`, `"mouth"`, `"only"` or decoders.
   */
  takeBytes?: number | bigint;
}

/** Statistics of a decoder's packets. */
export interface Received {
  /** Packets accepted. */
  packets: number;
  /** Packets that arrived too late or a second time and were ignored. */
  late: number;
  /** Chunks whose packet did not arrive in time. */
  lost: number;
  /** Keyframes of lost chunks that no other packet repeated, so that the last pose was held. */
  held: number;
}
