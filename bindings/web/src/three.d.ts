import type { ModelDescription, PoseValues } from "./index.js";

/** The subset of three.js' Object3D that is used. */
export interface Node3D {
  name: string;
  children: Node3D[];
  position: { x: number; y: number; z: number; set(x: number, y: number, z: number): unknown };
  quaternion: { x: number; y: number; z: number; w: number; set(x: number, y: number, z: number, w: number): unknown };
  scale: { x: number; y: number; z: number; set(x: number, y: number, z: number): unknown };
  traverse(callback: (node: any) => void): void;
}

/** The subset of a @pixiv/three-vrm VRM that is used. */
export interface Vrm {
  scene: Node3D;
  humanoid: unknown;
  expressionManager?: unknown;
}

/** Applies poses to a character. */
export class Character {
  /** `bones` gives bones that were not found, or null to leave a joint out; with `moves: false` the character stays
   * in place. `body` is that of a mapping file: `gain`, 0 to 1, keeps arms out of the body, and factors correct the girth
   * of `pelvis`, `belly`, `chest`, `neck`, `head`, `upper_arms`, `forearms`, `hands` and `thighs`. */
  constructor(target: Node3D | Vrm, model: ModelDescription, options?: { bones?: Record<string, Node3D | null>; moves?: boolean; body?: Record<string, number> });
  /** Bones of each joint; `spine` and `neck` may have several, or each of their joints a single one. */
  readonly bones: Record<string, Node3D[]>;
  /** Joints without a bone, and face channels that drive no shape themselves. */
  readonly missing: { joints: string[]; channels: string[] };
  /** Whether any shape opens the mouth. */
  readonly speaks: boolean;
  /** Shows a pose. `seconds`: since the last one, 1/30 if not given. */
  apply(pose: PoseValues, seconds?: number): void;
  /** Frees the character's memory in the module. */
  free(): void;
}
