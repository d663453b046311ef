import type { EngineOptions, Received, SessionOptions } from "./generated.js";

export { Attention, Idle, Mood, Parameter } from "./generated.js";
export type { EngineOptions, Received, SessionOptions } from "./generated.js";

/** A call that failed: `status` is the name that `umo.h` has for it, as "INVALID_ARGUMENT". */
export class UmoError extends Error {
  constructor(status: string, message: string);
  readonly status: string;
}

/** A URL, a response, or bytes; bytes may be compressed by gzip. */
export type Source = string | URL | Response | ArrayBuffer | ArrayBufferView;

/** Description of a model. */
export interface ModelDescription {
  readonly name: string;
  readonly licence: string;
  /** To be shown to users; may be empty. */
  readonly notice: string;
  /** The back-end: "simd128". */
  readonly isa: string;
  readonly isArkit: boolean;
  readonly hasMouth: boolean;
  readonly hasText: boolean;
  /** Frames a second. */
  readonly frameRate: number;
  readonly jointNames: string[];
  readonly channelNames: string[];
  readonly visemeNames: string[];
  /** Each joint's parent, -1 for the first. */
  readonly parents: number[];
  /** Where each joint is in its parent's frame at rest: x y z, metres. */
  readonly offsets: Float32Array;
  /** The module in this thread, which moves characters. */
  readonly library: unknown;
}

/** A body and a face at one moment. */
export interface PoseValues {
  /** Number of the frame, and the sample of the audio that it belongs to. */
  index: number;
  sample: number;
  /** Where the root is, metres, y up. */
  translation: Float32Array;
  /** Of each joint: x y z w, in its parent's frame. */
  rotations: Float32Array;
  /** Of each face channel. */
  face: Float32Array;
  /** Of each viseme. */
  visemes: Float32Array;
  /** Whether the requested time is later than the computed frames. */
  isAhead: boolean;
  /** Time of the newest ready frame in seconds, after `samplePose`. */
  newest?: number;
}

export class Pose implements PoseValues {
  constructor(model: ModelDescription);
  index: number;
  sample: number;
  translation: Float32Array;
  rotations: Float32Array;
  face: Float32Array;
  visemes: Float32Array;
  isAhead: boolean;
  newest?: number;
}

export type Precision = "stored" | "f32" | "bf16" | "int8";
export type Progress = { loaded: number; total?: number };

/** A model, and an engine that computes on the thread that calls `compute`. */
export class Model implements ModelDescription {
  static load(
    options: EngineOptions & {
      wasm: Source | WebAssembly.Module;
      model: Source;
      precision?: Precision;
      onProgress?: (progress: Progress) => void;
    },
  ): Promise<Model>;
  readonly name: string;
  readonly licence: string;
  readonly notice: string;
  readonly isa: string;
  readonly isArkit: boolean;
  readonly hasMouth: boolean;
  readonly hasText: boolean;
  readonly frameRate: number;
  readonly sampleRate: number;
  readonly jointNames: string[];
  readonly channelNames: string[];
  readonly visemeNames: string[];
  readonly parents: number[];
  readonly offsets: Float32Array;
  readonly library: unknown;
  /** Memory size of the module in bytes. */
  readonly memory: number;
  session(options?: SessionOptions & WordOptions): Session;
  /** Creates an avatar that is animated by received packets, or by a take, the bytes of a `.umo` file. */
  decoder(options?: SessionOptions & { take?: Uint8Array }): Session;
  /** Creates a scene: sessions of this model that know each other. */
  scene(options?: { seed?: number | bigint }): Scene;
  /** Computes due work for at most `milliseconds`, but at least one layer; returns whether there is more. */
  compute(milliseconds?: number): boolean;
  free(): void;
}

/** One avatar. */
export class Session {
  private constructor();
  /** Maximum number of future audio samples that a frame needs, and its mouth. */
  readonly latencySamples: number;
  readonly mouthSamples: number;
  /** Takes interleaved audio; returns the number of samples taken. */
  push(samples: Float32Array): number;
  /** Feeds the interlocutor's audio, so that the avatar listens. */
  pushOther(samples: Float32Array): void;
  finish(): void;
  interrupt(easeMs?: number): void;
  reset(): void;
  /** Pulls the next frame into `pose`; false if none is ready. */
  pull(pose: Pose): boolean;
  /** Pulls the ready packets of a session created with `packets`, to be sent to decoders unchanged. */
  pullPackets(): Uint8Array[];
  /** Takes a packet from the decoder's sender. Packets may arrive reordered or duplicated. */
  pushPacket(packet: Uint8Array): void;
  /** Computes the frames of the next packet of the decoder's take, if there is room; returns whether there may be more. */
  pushTake(): boolean;
  /** The take so far of a session created with `takeBytes`: the bytes of a `.umo` file. */
  take(): Uint8Array;
  /** Statistics of a decoder's packets. */
  readonly received: Received;
  /** The pose at motion time `seconds`. */
  samplePose(seconds: number, pose?: Pose): Pose;
  readonly ready: number;
  /** Arousal of the voice at the newest frame pulled or sampled, 0 to 1; 0.5 for an ordinary voice, and for none. */
  readonly arousal: number;
  /** Change of the arousal per second, over the last seconds. */
  readonly arousalTrend: number;
  readonly isDone: boolean;
  setClock(seconds: number): void;
  set(parameter: number, value: number): void;
  prompt(text: string): void;
  mood(mood: number, strength?: number): void;
  lookAt(point: [number, number, number], strength?: number): void;
  /** Gives words and their time, in seconds of the pushed audio: some become gestures. */
  hintWords(text: string, start: number, end: number): void;
  gesture(name: string, options?: GestureOptions): void;
  free(): void;
}

/** Where a member of a scene stands: glTF's axes, metres. */
export interface PlaceOptions {
  /** On the floor. */
  position?: [number, number, number];
  /** Radians about the upward axis: 0 is +z, positive to its left. */
  facing?: number;
  /** 1.6 if not given. */
  eyeHeight?: number;
}

/** State of a member of a scene. */
export interface MemberInfo {
  role: "idle" | "listening" | "speaking";
  /** Whom it attends to; 0 for nobody, or for a point. */
  attendsTo: number;
  /** Whether it looks there now, rather than past. */
  isContact: boolean;
  /** Nods, brow raises and half smiles so far. */
  nods: number;
  brows: number;
  smiles: number;
  /** 1 while it yields to who interrupts it, else 0. */
  yielding: number;
  /** Level of its voice, root mean square, full scale 1. */
  level: number;
}

/** Avatars that know each other, and people with microphones: up to 32 members, each a number from 1 on. */
export class Scene {
  private constructor();
  /** Adds a session of the same model, or with `null` a person; returns the member's number. */
  add(session: Session | null, place?: PlaceOptions): number;
  remove(member: number): void;
  setPlace(member: number, place: PlaceOptions): void;
  /** Makes a member look at another, or at a point of the scene, whatever is said; `null` ends it. */
  setTarget(member: number, target: number | [number, number, number] | null): void;
  /** Sets the parts that the scene plays of a member; all at first. */
  setAllowed(member: number, parts: Iterable<"look" | "nod" | "smile" | "mirror" | "yield">): void;
  /** Feeds the voice of a person: any rate, full scale 1. */
  push(member: number, samples: Float32Array): void;
  /** Advances the scene: once per picture, before poses are pulled or sampled. */
  update(seconds: number): void;
  /** The member that has the floor; 0 for nobody. */
  readonly floor: number;
  member(member: number): MemberInfo;
  /** Saves the scene and the sessions of its members. */
  save(): Uint8Array;
  restore(state: Uint8Array): void;
  free(): void;
}

export interface GestureOptions {
  side?: "auto" | "left" | "right" | "both";
  /** Motion time of the stroke in seconds; as soon as possible if not given. */
  at?: number;
  speed?: number;
  strength?: number;
  /** A point to point at, metres. */
  target?: [number, number, number];
  /** 0 is the gesture as drawn; others up to 255 differ a little. */
  variant?: number;
}

/** The rules by which words become gestures. */
export interface WordOptions {
  language?: "en" | "de";
  /** Text of a file of rules to add. */
  wordRules?: string;
}

/** A character from a `.glb` file that follows poses. */
export class Follower {
  /** `given`: bones and shapes that were not found, as in a mapping file; a bone may be a node index. */
  constructor(file: Uint8Array, model: ModelDescription, given?: { bones?: Record<string, string | string[] | number>; face?: Record<string, unknown> });
  readonly description: {
    convention: string;
    bones: Record<string, number[]>;
    /** The node of each joint. */
    nodes: (number | null)[];
    /** Node, path and value of every property where the bind pose differs from the file. */
    held: [number, "translation" | "rotation" | "scale", number[]][];
    driven: number[];
    hips: number | null;
    tracks: { node: number; count: number; moved: number[] }[];
    expressions: string[];
    /** Face channels that drive no shape themselves. */
    still: string[];
    speaks: boolean;
  };
  /** Rotations of `driven`, position of `hips`, weights of `tracks`, weights of `expressions`. Valid until the next
   * call. `seconds`: since the last pose, 1/30 if not given. */
  values(pose: PoseValues, seconds?: number): Float32Array;
  free(): void;
}

/** An avatar whose engine runs in a worker. */
export class Avatar {
  static create(
    options: SessionOptions & WordOptions & {
      model: Source;
      wasm?: Source | WebAssembly.Module;
      precision?: Precision;
      worker?: Worker;
      delay?: number;
      onProgress?: (progress: Progress) => void;
      onError?: (error: Error) => void;
    },
  ): Promise<Avatar>;
  readonly model: ModelDescription;
  /** Maximum future audio in seconds that a frame needs, and its mouth. */
  readonly latency: number;
  readonly mouthLatency: number;
  /** Latency in seconds that the AudioContext does not know, such as a Bluetooth speaker's or a television's. */
  delay: number;
  /** The newest pose; the rest pose before the first. */
  readonly pose: PoseValues;
  /** Motion time to show now, in seconds. */
  readonly time: number;
  /** Whether all of a recording has been shown. */
  readonly isDone?: boolean;
  /** The error that ended the session. */
  readonly error?: Error;
  /** Speaks the output of an audio node from now on; the returned function stops it. */
  listen(source: AudioNode): Promise<() => Promise<void>>;
  /** Speaks and plays a recording; resolves when playback starts. `words` are the recording's, each with its start and
   * end in seconds. */
  say(buffer: AudioBuffer, context: AudioContext, output?: AudioNode, words?: [text: string, start: number, end: number][]): Promise<void>;
  /** Plays a take, the bytes of a `.umo` file, beside its recording, if that is given; resolves when playback starts. */
  play(take: Uint8Array, context: AudioContext, buffer?: AudioBuffer, output?: AudioNode): Promise<void>;
  /** The pose to show now. Never waits. Call it once per frame. */
  samplePose(seconds?: number): PoseValues;
  /** Calls the session in the worker, such as `call("gesture", "wave")`. */
  call(name: "push" | "finish" | "interrupt" | "reset" | "set" | "prompt" | "mood" | "lookAt" | "gesture" | "hintWords" | "pushOther" | "play" | "pull" | "samplePose", ...args: unknown[]): Promise<any>;
  close(): void;
}
