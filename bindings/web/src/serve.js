// A client of `umo serve`: sends speech to a server and receives frames or packets. For browsers, and Node with
// WebSocket.

const PIECE = 32768;

/** The server refused a session or ended it. */
export class ServeError extends Error {
  constructor(code, reason) {
    super(reason);
    this.name = "ServeError";
    this.code = code;
  }
}

/** A session on a server. */
export class RemoteAvatar {
  onframe = () => {};
  onpacket = () => {};
  ondone = () => {};
  onstate = () => {};
  onend = () => {};

  #socket;
  #waiting = null;
  #state = null;
  #filled = 0;
  #error = null;

  constructor(socket, ready) {
    this.#socket = socket;
    this.ready = ready;
    socket.onmessage = ({ data }) => this.#take(data);
    socket.onerror = null;
    socket.onclose = ({ reason }) => this.onend(this.#error ?? new ServeError("closed", reason || "the connection ended"));
  }

  /** Opens a session; `hello` has the fields of the server's hello, and `state` a saved state to continue from. */
  static connect(url, { state, ...hello } = {}) {
    return new Promise((resolve, reject) => {
      const socket = new WebSocket(url);
      socket.binaryType = "arraybuffer";
      socket.onopen = () => {
        const bytes = state ? new Uint8Array(state) : new Uint8Array();
        socket.send(JSON.stringify({ type: "hello", ...hello, ...(state ? { restore: bytes.length } : {}) }));
        for (let at = 0; at < bytes.length; at += PIECE) socket.send(bytes.slice(at, at + PIECE));
      };
      socket.onclose = ({ reason }) => reject(new ServeError("closed", reason || `no connection to ${url}`));
      socket.onerror = () => reject(new ServeError("closed", `no connection to ${url}`));
      socket.onmessage = ({ data }) => {
        const first = JSON.parse(data);
        if (first.type === "ready") resolve(new RemoteAvatar(socket, first));
        else reject(new ServeError(first.code, first.reason));
      };
    });
  }

  /** Sends mono samples: an Int16Array, or a Float32Array of full scale 1. */
  push(samples) {
    const data = samples instanceof Int16Array ? samples : integers(samples);
    for (let at = 0; at < data.length; at += PIECE / 2) this.#socket.send(data.slice(at, at + PIECE / 2));
  }

  /** Sends one Opus packet, as carried by RTP. The hello must have `audio: "opus"`. */
  pushOpus(packet) { this.#socket.send(packet); }

  /** Reports that packets before the next one were lost: the server conceals them. */
  lost(packets = 1) { this.#say({ type: "lost", packets }); }

  /** Ends the speech: its last frames arrive, then `ondone`. */
  finish() { this.#say({ type: "finish" }); }

  /** Drops unsent frames and eases to rest; audio pushed afterwards starts a new speech. */
  interrupt(ease = 0.2) { this.#say({ type: "interrupt", ease }); }

  /** Moves in the room: x and z in metres, degrees to the left of +Z. */
  setPlace(place) { this.#say({ type: "place", place }); }

  setMood(mood, strength = 1) { this.#say({ type: "mood", mood, strength }); }

  playGesture(name, options = {}) { this.#say({ type: "gesture", name, ...options }); }

  /** Gives words and their time, in seconds of the audio sent since the session began: some become gestures. */
  hintWords(text, start, end) { this.#say({ type: "words", text, start, end }); }

  lookAt(point, strength = 1) { this.#say({ type: "look_at", point: [...point], strength }); }

  /** Requests the session's state, which is passed to `onstate`. */
  save() { this.#say({ type: "save" }); }

  close() { this.#socket.close(); }

  #say(message) { this.#socket.send(JSON.stringify(message)); }

  #take(data) {
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (message.type === "done") this.ondone(message);
      else if (message.type === "state") [this.#waiting, this.#state, this.#filled] = [message, new Uint8Array(message.bytes), 0];
      else if (message.type === "error") this.#error = new ServeError(message.code, message.reason);
      return;
    }
    const kind = new Uint8Array(data, 0, 1)[0];
    if (kind === 1) this.#frames(data);
    else if (kind === 2) this.onpacket(new Uint8Array(data, 1));
    else if (kind === 3 && this.#waiting) this.#piece(new Uint8Array(data, 1));
  }

  #piece(bytes) {
    this.#state.set(bytes, this.#filled);
    this.#filled += bytes.length;
    if (this.#filled < this.#state.length) return;
    this.onstate(this.#state, this.#waiting.samples, this.#waiting.is_handover);
    this.#waiting = this.#state = null;
  }

  #frames(data) {
    const view = new DataView(data);
    const [count, floats, bones] = [view.getUint16(2, true), view.getUint32(4, true), 4 * this.ready.joints];
    for (let i = 0, at = 8; i < count; i++, at += 16 + 4 * floats) {
      const values = new Float32Array(data, at + 16, floats);
      this.onframe({
        index: Number(view.getBigUint64(at, true)),
        sample: Number(view.getBigUint64(at + 8, true)),
        rotations: values.subarray(0, bones),
        translation: values.subarray(bones, bones + 3),
        face: values.subarray(bones + 3),
      });
    }
  }
}

function integers(samples) {
  return Int16Array.from(samples, (sample) => Math.max(-32768, Math.min(32767, Math.round(sample * 32768))));
}
