/** The server refused a session or ended it. */
export class ServeError extends Error {
  constructor(code: string, reason: string);
  /** Error code: "full", "unauthorized", "bad_request" …; "closed" if the connection broke. */
  readonly code: string;
}

/** A frame; its arrays are views of the received message. */
export interface RemoteFrame {
  index: number;
  sample: number;
  /** Rotation of each joint: x y z w, in its parent's frame. */
  rotations: Float32Array;
  /** Position of the root, metres. */
  translation: Float32Array;
  /** Values of the channels `ready.face`. */
  face: Float32Array;
}

/** Fields of the server's hello; see docs/serve.md. */
export interface Hello {
  token?: string;
  /** With "opus", `rate` must be 8000, 12000, 16000, 24000 or 48000. */
  audio?: "pcm" | "opus";
  rate?: number;
  output?: "frames" | "packets";
  voice?: "delayed" | "live";
  seed?: number;
  prompt?: string;
  /** Language of the words. */
  language?: "en" | "de";
  mood?: string;
  mood_strength?: number;
  target?: number;
  horizon?: number;
  layers?: number;
  /** Room whose members see each other, and the place there: x and z in metres, degrees to the left of +Z. */
  room?: string;
  place?: [number, number, number];
  handover?: boolean;
  /** Number of samples at the start that a restored session already has. */
  skip?: number;
  /** A saved state to continue from. */
  state?: Uint8Array;
}

/** The server's description of a session. */
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

/** A session on a server. */
export class RemoteAvatar {
  static connect(url: string, hello?: Hello): Promise<RemoteAvatar>;
  readonly ready: Ready;
  onframe: (frame: RemoteFrame) => void;
  onpacket: (packet: Uint8Array) => void;
  ondone: (done: { frames: number; late_frames: number }) => void;
  /** `samples` samples of this connection are included in the state; with `isHandover` the server is ending the
   * session. */
  onstate: (state: Uint8Array, samples: number, isHandover: boolean) => void;
  onend: (error: ServeError) => void;
  push(samples: Int16Array | Float32Array): void;
  pushOpus(packet: Uint8Array | ArrayBuffer): void;
  lost(packets?: number): void;
  finish(): void;
  interrupt(ease?: number): void;
  setMood(mood: string, strength?: number): void;
  /** Moves in the room. */
  setPlace(place: [number, number, number]): void;
  playGesture(name: string, options?: { at?: number; speed?: number; strength?: number; side?: string; target?: number[]; variant?: number }): void;
  hintWords(text: string, start: number, end: number): void;
  lookAt(point: Iterable<number>, strength?: number): void;
  save(): void;
  close(): void;
}
