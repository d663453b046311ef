// A character that follows poses: the retargeter of `umo retarget`, on this thread.

import { UmoError } from "./engine.js";

export class Follower {
  #library;
  #character;
  #memory;
  #size;
  /** Buffers of a pose and of the character's values. */
  #pose;
  #values;

  /**
   * Reads a character from the bytes of a `.glb` or `.vrm` file. `model` is an avatar's or a `Model`; `given` is the
   * content of a mapping file, `{ bones: { left_elbow: "Arm_2.L" }, face: { jawOpen: "Mouth_Open" } }`, where a bone
   * may also be a node index.
   */
  constructor(file, model, given = {}) {
    const { library, parents, offsets, channelNames, isArkit } = model;
    if (!library) throw new UmoError("NULL_POINTER", "the model has no `library`: pass `avatar.model`, or the result of `Model.load`");
    const skeleton = { parents, offsets_m: parents.map((_, joint) => Array.from(offsets.subarray(3 * joint, 3 * joint + 3))) };
    const source = { skeleton, face: { kind: isArkit ? "arkit" : "smplx_expression", names: channelNames }, given };
    const text = new TextEncoder().encode(`${JSON.stringify(source)}\0`);
    const [data, words] = [file, text].map((bytes) => library.allocate(bytes.length));
    library.bytes(data, file.length).set(file);
    library.bytes(words, text.length).set(text);
    const { scratch } = library;
    try {
      library.call("umo_web_character_new", data, file.length, words, scratch, scratch + 4);
    } finally {
      if (!library.trap) [[data, file], [words, text]].forEach(([at, { length }]) => library.run("umo_web_free", at, length));
    }
    this.#library = library;
    this.#character = library.view.getUint32(scratch, true);
    /** The names of the values, as described at `umo_core_rig::glb::Follower::read`. */
    this.description = JSON.parse(library.text(library.view.getUint32(scratch + 4, true)));
    const { driven, hips, tracks, expressions } = this.description;
    this.#pose = 4 * parents.length + 3 + channelNames.length;
    this.#values = 4 * driven.length + (hips === null ? 0 : 3) + tracks.reduce((sum, { count }) => sum + count, 0) + expressions.length;
    this.#size = 4 * (this.#pose + this.#values);
    this.#memory = library.allocate(this.#size);
  }

  /**
   * Returns the values for a pose: a rotation for each of `description.driven`, the position of `hips` if there is one,
   * the weights of all shapes for each of `tracks`, and the weights of `expressions`. Valid until the next call of the
   * module. `seconds`: since the last pose.
   */
  values({ rotations, translation, face }, seconds = 1 / 30) {
    const library = this.#library;
    // Its buffers are freed with it.
    if (this.#character === 0) throw new UmoError("INVALID_HANDLE", "the character was freed");
    const { buffer } = library.exports.memory;
    const from = new Float32Array(buffer, this.#memory, this.#pose);
    from.set(rotations);
    from.set(translation, rotations.length);
    from.set(face, rotations.length + 3);
    const to = this.#memory + 4 * this.#pose;
    library.call("umo_web_character_apply", this.#character, seconds, this.#memory, to, this.#values);
    return new Float32Array(library.exports.memory.buffer, to, this.#values);
  }

  /** Frees it. Twice is fine. */
  free() {
    if (this.#character === 0 || this.#library.trap) return;
    this.#library.call("umo_web_character_free", this.#character);
    this.#library.run("umo_web_free", this.#memory, this.#size);
    this.#character = 0;
  }
}
