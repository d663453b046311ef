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

/** What a model has. */
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
  /** Whether the time asked for is later than what has been computed. */
  isAhead: boolean;
  /** Seconds of the newest frame that is ready, after `samplePose`. */
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

/** A model, and an engine that computes in the thread that calls `compute`. */
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
  /** Bytes of memory that the module has. */
  readonly memory: number;
  session(options?: SessionOptions): Session;
  /** An avatar whose frames come of packets, where it is seen. */
  decoder(options?: SessionOptions): Session;
  /** Computes what is due, in at most `milliseconds`, but one layer at least; returns whether there is more. */
  compute(milliseconds?: number): boolean;
  free(): void;
}

/** One avatar. */
export class Session {
  private constructor();
  /** Samples of future audio that a frame needs at most, and its mouth. */
  readonly latencySamples: number;
  readonly mouthSamples: number;
  /** Takes audio, interleaved; returns how many samples there was room for. */
  push(samples: Float32Array): number;
  /** Takes audio of who speaks to the avatar, so that it listens. */
  pushOther(samples: Float32Array): void;
  finish(): void;
  interrupt(easeMs?: number): void;
  reset(): void;
  /** Takes the next frame into `pose`; false where none is ready. */
  pull(pose: Pose): boolean;
  /** Packets that are ready, to be sent to decoders as they are, of a session made with `packets`. */
  pullPackets(): Uint8Array[];
  /** Takes a packet of a decoder's sender, in any order and any number of times. */
  pushPacket(packet: Uint8Array): void;
  /** What came of a decoder's packets. */
  readonly received: Received;
  /** The pose at `seconds` of the motion. */
  samplePose(seconds: number, pose?: Pose): Pose;
  readonly ready: number;
  readonly isDone: boolean;
  setClock(seconds: number): void;
  set(parameter: number, value: number): void;
  prompt(text: string): void;
  mood(mood: number, strength?: number): void;
  lookAt(point: [number, number, number], strength?: number): void;
  gesture(name: string, options?: GestureOptions): void;
  free(): void;
}

export interface GestureOptions {
  side?: "auto" | "left" | "right" | "both";
  /** Seconds of the motion at which the stroke falls; as soon as it can without. */
  at?: number;
  speed?: number;
  strength?: number;
  /** A place to point at, metres. */
  target?: [number, number, number];
}

/** A character of a `.glb` file that follows poses. */
export class Follower {
  /** `given`: bones and shapes that are not found, as a mapping file has them; a bone may be the number of a node. */
  constructor(file: Uint8Array, model: ModelDescription, given?: { bones?: Record<string, string | string[] | number>; face?: Record<string, unknown> });
  readonly description: {
    convention: string;
    bones: Record<string, number[]>;
    /** The node of each joint. */
    nodes: (number | null)[];
    /** Node, path and value of what the bind pose has elsewhere than the file. */
    held: [number, "translation" | "rotation" | "scale", number[]][];
    driven: number[];
    hips: number | null;
    tracks: { node: number; count: number; moved: number[] }[];
    expressions: string[];
    /** Face channels that move no shape themselves. */
    still: string[];
    speaks: boolean;
  };
  /** Rotations of `driven`, the place of `hips`, weights of `tracks`, weights of `expressions`: good until the next call. */
  values(pose: PoseValues): Float32Array;
  free(): void;
}

/** An avatar whose engine runs in a worker. */
export class Avatar {
  static create(
    options: SessionOptions & {
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
  /** Seconds of future audio that a frame needs at most, and its mouth. */
  readonly latency: number;
  readonly mouthLatency: number;
  /** Seconds that the device's sound is later than its AudioContext knows: a Bluetooth speaker's or a television's. */
  delay: number;
  /** The newest pose; at rest before the first. */
  readonly pose: PoseValues;
  /** Seconds of the motion that are to be seen now. */
  readonly time: number;
  /** Whether all of a recording has been shown. */
  readonly isDone?: boolean;
  /** What ended the session. */
  readonly error?: Error;
  /** Speaks what an audio node plays, from now on; the result ends it. */
  listen(source: AudioNode): Promise<() => Promise<void>>;
  /** Speaks and plays a recording; resolves when it begins to sound. */
  say(buffer: AudioBuffer, context: AudioContext, output?: AudioNode): Promise<void>;
  /** The pose to show now. Never waits. Call it once for each picture. */
  samplePose(seconds?: number): PoseValues;
  /** Calls the session in the worker, as `call("gesture", "wave")`. */
  call(name: "push" | "finish" | "interrupt" | "reset" | "set" | "prompt" | "mood" | "lookAt" | "gesture" | "pushOther" | "pull" | "samplePose", ...args: unknown[]): Promise<any>;
  close(): void;
}
