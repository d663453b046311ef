// Runs on the audio thread: mixes its input to one channel and posts it to the engine's worker in blocks of about 20
// ms.

const QUANTA = 8;

class UmoPush extends AudioWorkletProcessor {
  constructor() {
    super();
    this.block = null;
    this.length = 0;
    this.target = null;
    this.isOn = true;
    this.port.onmessage = ({ data }) => {
      if (data.target) this.target = data.target;
      if (data.end) this.isOn = false;
    };
  }

  process([input]) {
    if (!this.isOn) return false;
    if (!this.target) return true;
    // An input without a source has no channels: push silence, so that time advances.
    const size = input[0]?.length ?? 128;
    this.block ??= new Float32Array(QUANTA * size);
    for (const channel of input) {
      for (let i = 0; i < size; i++) this.block[this.length + i] += channel[i] / input.length;
    }
    if (this.length === 0) this.start = currentTime;
    this.length += size;
    if (this.length + size > this.block.length) {
      const block = this.block.subarray(0, this.length);
      this.target.postMessage(block, [block.buffer]);
      this.port.postMessage({ time: this.start });
      [this.block, this.length] = [null, 0];
    }
    return true;
  }
}

registerProcessor("umo-push", UmoPush);
