// A page that runs the model: a recording or the microphone in, joints and a face drawn with lines.

import { Avatar } from "./umo/src/index.js";
import { draw } from "./figure.js";

const element = (id) => document.getElementById(id);
const say = (text) => (element("state").value = text);
const buttons = ["microphone", "file", "stop"].map(element);
let avatar;
let context;
let end;

/** What a test reads. */
window.demo = { drawn: 0, mouth: 0, failed: null };

function failed(error) {
  window.demo.failed = error.message;
  say(error.message);
}

/** An avatar for audio at this rate, in a worker of its own; another one goes. */
async function create(options) {
  avatar?.close();
  avatar = undefined;
  window.demo.avatar = undefined;
  const percent = ({ loaded, total }) => say(total ? `loads the model: ${Math.round((100 * loaded) / total)} %` : `loads the model: ${loaded >> 20} MB`);
  const parameters = new URLSearchParams(location.search);
  const model = parameters.get("model") ?? "umo-people.safetensors.gz";
  avatar = await Avatar.create({ model, wasm: "umo/dist/umo.wasm", onProgress: percent, onError: failed, ...options });
  window.demo.avatar = avatar;
  element("model").textContent = `${avatar.model.name} (${avatar.model.licence}). ${avatar.model.notice}`;
}

async function started(what) {
  buttons.forEach((button) => (button.disabled = true));
  try {
    context ??= new AudioContext();
    await context.resume();
    await what();
  } catch (error) {
    failed(error);
  } finally {
    buttons.forEach((button) => (button.disabled = false));
  }
}

async function stop() {
  await end?.();
  end = undefined;
  say("ready");
}

element("microphone").onclick = () =>
  started(async () => {
    await stop();
    const stream = await navigator.mediaDevices.getUserMedia({ audio: true });
    await create({ sampleRate: context.sampleRate, voice: "live" });
    const ended = await avatar.listen(context.createMediaStreamSource(stream));
    end = () => {
      stream.getTracks().forEach((track) => track.stop());
      return ended();
    };
    say(`listens; the mouth is ${Math.round(1000 * avatar.mouthLatency)} ms behind the sound, the body ${Math.round(1000 * avatar.latency)} ms`);
  });

element("file").onchange = ({ target }) =>
  started(async () => {
    const [file] = target.files;
    if (!file) return;
    await stop();
    const buffer = await context.decodeAudioData(await file.arrayBuffer());
    await create({ sampleRate: buffer.sampleRate });
    say("computes the first frames…");
    await avatar.say(buffer, context);
    end = () => avatar.call("reset");
    say(`speaks ${file.name}, ${buffer.duration.toFixed(1)} s`);
  });

element("stop").onclick = () => started(stop);

function picture() {
  requestAnimationFrame(picture);
  if (!avatar?.pose) return;
  const pose = avatar.samplePose();
  draw(element("figure"), avatar.model, pose);
  const { demo } = window;
  demo.drawn = Math.max(demo.drawn, pose.index);
  demo.mouth = Math.max(demo.mouth, pose.face[avatar.model.channelNames.indexOf("jawOpen")]);
}

started(() => create({})).then(() => window.demo.failed || say("ready: speak, or choose a recording"));
picture();
