import type { ModelDescription, PoseValues } from "./index.js";

/** What of three.js' Object3D is used. */
export interface Node3D {
  name: string;
  parent: Node3D | null;
  position: { x: number; y: number; z: number; set(x: number, y: number, z: number): unknown; clone(): { x: number; y: number; z: number } };
  quaternion: { x: number; y: number; z: number; w: number; set(x: number, y: number, z: number, w: number): unknown };
  traverse(callback: (node: any) => void): void;
}

/** What of a VRM of @pixiv/three-vrm is used. */
export interface Vrm {
  scene: Node3D;
  humanoid: unknown;
  expressionManager?: { setValue(name: string, weight: number): void };
}

/** The bones of `root` by SMPL-X's names; bones with other names are left out. */
export function findBones(root: Node3D): Record<string, Node3D>;

/** Moves a character by poses. */
export class Character {
  constructor(target: Node3D | Vrm, model: ModelDescription, options?: { bones?: Record<string, Node3D>; moves?: boolean });
  readonly bones: Record<string, Node3D>;
  /** Joints without a bone, and face channels without a morph target. */
  readonly missing: { joints: string[]; channels: string[] };
  /** Whether the face has only VRM's vowels and blinks. */
  readonly isVowels: boolean;
  /** Shows a pose. */
  apply(pose: PoseValues): void;
}
