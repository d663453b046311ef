// Record of how the frames were made: keyframes by the language model, the others by interpolation, and the experts
// used.

export class Record {
  constructor(scene) {
    this.stride = scene.model?.stride ?? 0;
    this.data = scene.record;
    this.parts = scene.record?.parts ?? [];
    const places = this.parts.reduce((sum, { levels }) => sum + levels, 0);
    /** Number of frames with codes. */
    this.coded = places > 0 ? scene.record.codes.length / places : 0;
  }

  /** Whether a record exists. */
  get isKnown() {
    return this.stride > 0;
  }

  isKeyframe(frame) {
    return this.isKnown && frame % this.stride === 0;
  }

  /** Codes of a part in a frame, one per level; empty if unknown or if the frame has vectors instead. */
  codes(part, frame) {
    const at = this.data ? frame / this.data.every : NaN;
    if (!Number.isInteger(at) || at >= this.coded) return [];
    const first = this.parts.slice(0, part).reduce((sum, { levels }) => sum + levels, 0);
    return Array.from({ length: this.parts[part].levels }, (_, level) => this.data.codes[(first + level) * this.coded + at]);
  }

  get chunks() {
    return this.data?.chunks ?? [];
  }

  /** The chunk that produced a frame, or -1. */
  chunkOf(frame) {
    return this.chunks.findIndex(({ first, frames }) => frame >= first && frame < first + frames);
  }

  /** Layers that can be queried: name, first, and one after the last. */
  get layers() {
    if (!this.data) return [];
    const { encoderLayers: encoder, decoderLayers: decoder } = this.data;
    const all = encoder + decoder;
    const each = Array.from({ length: all }, (_, i) => {
      const name = i < encoder ? `encoder layer ${i + 1}` : `decoder layer ${i - encoder + 1}`;
      return { name, from: i, to: i + 1 };
    });
    return [
      { name: "all layers", from: 0, to: all },
      { name: "encoder", from: 0, to: encoder },
      { name: "decoder", from: encoder, to: all },
      ...each,
    ];
  }

  /** Number of tokens of one kind routed to each expert in a chunk, over some layers. */
  routed(chunk, kind, { from, to }) {
    const { experts, kinds, encoderLayers, decoderLayers, routed } = this.data;
    const layers = encoderLayers + decoderLayers;
    const sums = new Array(experts).fill(0);
    for (let layer = from; layer < to; layer++) {
      const start = ((chunk * layers + layer) * kinds.length + kind) * experts;
      for (let expert = 0; expert < experts; expert++) sums[expert] += routed[start + expert];
    }
    return sums;
  }
}
