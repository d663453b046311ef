// Recordings and characters dropped onto the page.

const CHARACTERS = ["glb", "vrm"];
const RECORDINGS = ["wav", "flac", "mp3", "ogg", "oga", "opus", "m4a", "mp4", "aac", "webm"];

const kindOf = ({ name, type }) => {
  const extension = name.toLowerCase().split(".").pop();
  if (CHARACTERS.includes(extension)) return "character";
  return RECORDINGS.includes(extension) || /^(audio|video)\//.test(type) ? "recording" : null;
};

/** Listens for files. `take` has a function per supported kind; `say` reports the result. */
export function listenForFiles(target, take, say) {
  const drop = async (file) => {
    const kind = kindOf(file);
    if (kind === null) return say(`${file.name}: expected a character, .glb or .vrm, or a recording`, true);
    try {
      say(`reads ${file.name}…`);
      say((await take[kind](file)) ?? "");
    } catch (error) {
      say(`${file.name}: ${error.message}`, true);
    }
  };
  target.addEventListener("dragover", (event) => {
    event.preventDefault();
    target.dataset.dropping = "true";
  });
  target.addEventListener("dragleave", (event) => {
    if (!event.relatedTarget) delete target.dataset.dropping;
  });
  target.addEventListener("drop", (event) => {
    event.preventDefault();
    delete target.dataset.dropping;
    // At most one of each kind: the last.
    for (const file of event.dataTransfer.files) drop(file);
  });
}

/** Handlers of a page with a finished take, which computes nothing. */
export const finished = {
  character: ({ name }) => Promise.reject(new Error(`this page holds one take, whose character is fixed: \`umo view RECORDING --onto ${name}\` makes one with this character, and a page of \`umo live\` or \`umo view --web\` takes it as it is dropped`)),
  recording: ({ name }) => Promise.reject(new Error(`this page holds one take and no model: \`umo view ${name}\` makes a page of this recording, and one of \`umo live\` or \`umo view --web\` takes it as it is dropped`)),
};

/** Decodes a recording to mono 16-bit samples, as the page stores them. */
export async function decoded(file) {
  const context = new OfflineAudioContext(1, 1, 48000);
  const buffer = await context.decodeAudioData(await file.arrayBuffer()).catch(() => {
    throw new Error("the browser cannot decode it: convert it to WAV");
  });
  const samples = new Int16Array(buffer.length);
  const channels = Array.from({ length: buffer.numberOfChannels }, (_, i) => buffer.getChannelData(i));
  for (let i = 0; i < samples.length; i++) {
    const mean = channels.reduce((sum, channel) => sum + channel[i], 0) / channels.length;
    samples[i] = Math.max(-32768, Math.min(32767, Math.round(mean * 32768)));
  }
  return { samples, sampleRate: buffer.sampleRate };
}
