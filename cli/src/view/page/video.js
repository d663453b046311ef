// Picture and sound as a video file, using the browser's recorder.

const TYPES = ["video/mp4;codecs=avc1.42E01F,mp4a.40.2", "video/webm;codecs=vp9,opus", "video/webm;codecs=vp8,opus", "video/webm"];
const RATE = 30;
const BITS = 6_000_000;

/** Audio elements already connected to a context: possible only once per element. */
const led = new WeakMap();
let context = null;

function soundOf(element) {
  context ??= new AudioContext();
  if (!led.has(element)) {
    const node = context.createMediaElementSource(element);
    node.connect(context.destination);
    led.set(element, node);
  }
  return led.get(element);
}

/** Records a canvas from `begin` to `stop`. */
export class Video {
  static get isPossible() {
    return typeof MediaRecorder === "function" && TYPES.some((type) => MediaRecorder.isTypeSupported(type));
  }

  /** Sound sources: audio elements, and streams with a delay in seconds each. */
  constructor(view, { elements = [], streams = [] }) {
    this.view = view;
    this.canvas = document.createElement("canvas");
    // Codecs need even sizes.
    [this.canvas.width, this.canvas.height] = [view.width, view.height].map((x) => x - (x % 2));
    this.painter = this.canvas.getContext("2d", { alpha: false });
    context ??= new AudioContext();
    context.resume();
    const heard = context.createMediaStreamDestination();
    this.sources = elements.map(soundOf);
    for (const [stream, delay] of streams) {
      const later = context.createDelay(5);
      later.delayTime.value = delay;
      context.createMediaStreamSource(stream).connect(later);
      this.sources.push(later);
    }
    for (const source of this.sources) source.connect(heard);
    this.heard = heard;
    const tracks = [...this.canvas.captureStream(RATE).getTracks(), ...heard.stream.getAudioTracks()];
    const mimeType = TYPES.find((type) => MediaRecorder.isTypeSupported(type));
    this.recorder = new MediaRecorder(new MediaStream(tracks), { mimeType, videoBitsPerSecond: BITS });
    this.parts = [];
    this.recorder.ondataavailable = ({ data }) => this.parts.push(data);
    this.draw();
  }

  /** Whether recording has started, which is at the first moving frame. */
  get hasBegun() {
    return this.recorder.state !== "inactive";
  }

  begin() {
    this.recorder.start(1000);
  }

  /** Captures the frame just drawn over the page's background. */
  draw() {
    const { painter, canvas, view } = this;
    painter.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--video").trim();
    painter.fillRect(0, 0, canvas.width, canvas.height);
    painter.drawImage(view, 0, 0);
  }

  /** Stops; returns the file, or null if nothing has moved. */
  async stop() {
    if (this.hasBegun) {
      const ended = new Promise((done) => (this.recorder.onstop = done));
      this.recorder.stop();
      await ended;
    }
    for (const source of this.sources) source.disconnect(this.heard);
    const { mimeType } = this.recorder;
    if (this.parts.length === 0) return null;
    return new File(this.parts, `umo.${mimeType.startsWith("video/mp4") ? "mp4" : "webm"}`, { type: mimeType });
  }
}

/** Passes a file to the browser's downloads. */
export function save(file) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = file.name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
