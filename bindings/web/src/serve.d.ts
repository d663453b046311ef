/** The server gives no session, or ends it. */
export class ServeError extends Error {
  constructor(code: string, reason: string);
  /** A word: "full", "unauthorized", "bad_request" …; "closed" where the connection broke. */
  readonly code: string;
}

/** A frame; its arrays belong to the message that it came with. */
export interface RemoteFrame {
  index: number;
  sample: number;
  /** Of each joint: x y z w, in its parent's frame. */
  rotations: Float32Array;
  /** Where the root is, metres. */
  translation: Float32Array;
  /** The channels of `ready.face`. */
  face: Float32Array;
}

/** Fields of the server's hello, in docs/serve.md. */
export interface Hello {
  token?: string;
  /** "opus": `rate` is 8000, 12000, 16000, 24000 or 48000. */
  audio?: "pcm" | "opus";
  rate?: number;
  output?: "frames" | "packets";
  voice?: "delayed" | "live";
  seed?: number;
  prompt?: string;
  mood?: string;
  mood_strength?: number;
  target?: number;
  horizon?: number;
  layers?: number;
  handover?: boolean;
  /** Samples at the start that a restored session knows already. */
  skip?: number;
  /** A state to go on from. */
  state?: Uint8Array;
}

/** What the server says of a session. */
export interface Ready {
  version: number;
  model: string;
  rate: number;
  audio: "pcm" | "opus";
  output: "frames" | "packets";
  frame_rate: number;
  joints: number;
  face: string[];
  floats: number;
  chunk_frames: number;
  latency_samples: number;
  mouth_samples: number;
  state_bytes: number;
  /** What to tell the developer: the model was not trained with the prompt. */
  note?: string;
}

/** A session of a server. */
export class RemoteAvatar {
  static connect(url: string, hello?: Hello): Promise<RemoteAvatar>;
  readonly ready: Ready;
  onframe: (frame: RemoteFrame) => void;
  onpacket: (packet: Uint8Array) => void;
  ondone: (done: { frames: number; late_frames: number }) => void;
  /** `samples` of this connection are part of the state; with `isHandover` the server ends the session now. */
  onstate: (state: Uint8Array, samples: number, isHandover: boolean) => void;
  onend: (error: ServeError) => void;
  push(samples: Int16Array | Float32Array): void;
  pushOpus(packet: Uint8Array | ArrayBuffer): void;
  lost(packets?: number): void;
  finish(): void;
  interrupt(ease?: number): void;
  setMood(mood: string, strength?: number): void;
  playGesture(name: string, options?: { at?: number; speed?: number; strength?: number; side?: string; target?: number[] }): void;
  lookAt(point: Iterable<number>, strength?: number): void;
  save(): void;
  close(): void;
}
