// The browser's microphone: raw samples without the browser's own processing.

/** Runs on the audio thread: collects samples and posts them in blocks of 20 ms. */
const WORKLET = `
registerProcessor("umo-microphone", class extends AudioWorkletProcessor {
  constructor() {
    super();
    this.piece = new Float32Array(Math.round(sampleRate / 50));
    this.filled = 0;
  }
  process([input]) {
    for (const sample of input[0] ?? []) {
      this.piece[this.filled++] = sample;
      if (this.filled === this.piece.length) {
        this.port.postMessage(this.piece.slice());
        this.filled = 0;
      }
    }
    return true;
  }
});`;

/** Opens the microphone and passes blocks of samples to `heard` until `stop` is called. */
export async function microphone(heard) {
  const stream = await navigator.mediaDevices.getUserMedia({
    audio: { channelCount: 1, echoCancellation: false, noiseSuppression: false, autoGainControl: false },
  });
  const context = new AudioContext();
  await context.resume();
  await context.audioWorklet.addModule(URL.createObjectURL(new Blob([WORKLET], { type: "text/javascript" })));
  const source = context.createMediaStreamSource(stream);
  const node = new AudioWorkletNode(context, "umo-microphone", { numberOfOutputs: 0 });
  node.port.onmessage = ({ data }) => heard(data);
  return {
    rate: context.sampleRate,
    stream,
    listen: () => source.connect(node),
    stop() {
      source.disconnect();
      stream.getTracks().forEach((track) => track.stop());
      context.close();
    },
  };
}
