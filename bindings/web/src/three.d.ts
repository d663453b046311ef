import type { ModelDescription, PoseValues } from "./index.js";

/** The part of three.js' Object3D that is used. */
export interface Node3D {
  name: string;
  children: Node3D[];
  position: { x: number; y: number; z: number; set(x: number, y: number, z: number): unknown };
  quaternion: { x: number; y: number; z: number; w: number; set(x: number, y: number, z: number, w: number): unknown };
  scale: { x: number; y: number; z: number; set(x: number, y: number, z: number): unknown };
  traverse(callback: (node: any) => void): void;
}

/** The part of a VRM of @pixiv/three-vrm that is used. */
export interface Vrm {
  scene: Node3D;
  humanoid: unknown;
  expressionManager?: unknown;
}

/** Moves a character by poses. */
export class Character {
  /** `bones` names bones that are not found, or null for a joint without one; with `moves: false` the character stays where it is. */
  constructor(target: Node3D | Vrm, model: ModelDescription, options?: { bones?: Record<string, Node3D | null>; moves?: boolean });
  /** The bones of each joint; `spine` and `neck` may be several, or each of the joints alone. */
  readonly bones: Record<string, Node3D[]>;
  /** Joints without a bone, and face channels that move no shape themselves. */
  readonly missing: { joints: string[]; channels: string[] };
  /** Whether some shape opens the mouth. */
  readonly speaks: boolean;
  /** Shows a pose. */
  apply(pose: PoseValues): void;
  /** Frees what the module keeps of it. */
  free(): void;
}
