// A page that runs the model: a recording or the microphone in, a speaking three.js character out.

import { AmbientLight, Box3, Color, DirectionalLight, GridHelper, PerspectiveCamera, Scene, Timer, Vector3, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { VRMLoaderPlugin, VRMUtils } from "@pixiv/three-vrm";
import { Avatar } from "umo-web";
import { Character } from "umo-web/three";

const element = (id) => document.getElementById(id);
const say = (text) => (element("state").value = text);
const buttons = ["microphone", "file", "character", "stop"].map(element);
let avatar;
let context;
let end;
let gltf;
let character;

/** State that tests read. */
window.demo = { drawn: 0, mouth: 0, failed: null };

function failed(error) {
  window.demo.failed = error.message;
  say(error.message);
}

const renderer = new WebGLRenderer({ canvas: element("figure"), antialias: true });
const scene = new Scene();
const camera = new PerspectiveCamera(26, 1, 0.05, 50);
const timer = new Timer();
const sun = new DirectionalLight(0xffffff, 2);
sun.position.set(1, 2, 3);
scene.background = new Color(0x2d343d);
const floor = new GridHelper(6, 12, 0x56606c, 0x424b56);
scene.add(new AmbientLight(0xffffff, 1.2), sun, floor);

const loader = new GLTFLoader();
loader.register((parser) => new VRMLoaderPlugin(parser));

/** Creates an avatar for audio at this rate in a new worker, replacing the previous one. */
async function create(options) {
  avatar?.close();
  avatar = undefined;
  window.demo.avatar = undefined;
  const percent = ({ loaded, total }) => say(total ? `loading the model: ${Math.round((100 * loaded) / total)} %` : `loading the model: ${loaded >> 20} MB`);
  const parameters = new URLSearchParams(location.search);
  const model = parameters.get("model") ?? "umo-people.safetensors.gz";
  avatar = await Avatar.create({ model, onProgress: percent, onError: failed, ...options });
  window.demo.avatar = avatar;
  element("model").textContent = `${avatar.model.name} (${avatar.model.licence}). ${avatar.model.notice}`;
  if (gltf) wear();
}

/** Loads a character from a `.glb` or `.vrm` file. */
async function load(address) {
  const loaded = await loader.loadAsync(address);
  if (gltf) {
    scene.remove(gltf.scene);
    VRMUtils.deepDispose(gltf.scene);
  }
  gltf = loaded;
  if (gltf.userData.vrm) VRMUtils.rotateVRM0(gltf.userData.vrm);
  scene.add(gltf.scene);
  const { min, max } = new Box3().setFromObject(gltf.scene);
  const height = max.y - min.y;
  floor.position.y = min.y;
  camera.position.set(0.25 * height, min.y + 0.68 * height, 2.6 * height);
  camera.lookAt(new Vector3(0, min.y + 0.5 * height, 0));
  character = undefined;
  wear();
}

/** Connects the character to the avatar. */
function wear() {
  character?.free();
  character = new Character(gltf.userData.vrm ?? gltf.scene, avatar.model);
  window.demo.character = character;
  const { joints } = character.missing;
  element("missing").textContent = [character.speaks ? "" : "The character has no shapes that open its mouth.", joints.length > 0 ? `It has no bones for ${joints.join(", ")}.` : ""].join(" ");
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
    say(`listening; the mouth is ${Math.round(1000 * avatar.mouthLatency)} ms behind the sound, the body ${Math.round(1000 * avatar.latency)} ms`);
  });

element("file").onchange = ({ target }) =>
  started(async () => {
    const [file] = target.files;
    if (!file) return;
    await stop();
    const buffer = await context.decodeAudioData(await file.arrayBuffer());
    await create({ sampleRate: buffer.sampleRate });
    say("computing the first frames…");
    await avatar.say(buffer, context);
    end = () => avatar.call("reset");
    say(`speaks ${file.name}, ${buffer.duration.toFixed(1)} s`);
  });

element("character").onchange = ({ target }) =>
  started(async () => {
    const [file] = target.files;
    if (!file) return;
    const address = URL.createObjectURL(file);
    await load(address).finally(() => URL.revokeObjectURL(address));
    say(`${file.name} is on`);
  });

element("stop").onclick = () => started(stop);

function picture(now) {
  timer.update(now);
  const { clientWidth, clientHeight, width, height } = renderer.domElement;
  const ratio = Math.min(devicePixelRatio, 2);
  if (width !== Math.floor(clientWidth * ratio) || height !== Math.floor(clientHeight * ratio)) {
    renderer.setPixelRatio(ratio);
    renderer.setSize(clientWidth, clientHeight, false);
    camera.aspect = clientWidth / clientHeight;
    camera.updateProjectionMatrix();
  }
  if (avatar && character) {
    const pose = avatar.samplePose();
    character.apply(pose, timer.getDelta());
    const { demo } = window;
    demo.drawn = Math.max(demo.drawn, pose.index);
    demo.mouth = Math.max(demo.mouth, pose.face[avatar.model.channelNames.indexOf("jawOpen")]);
  }
  gltf?.userData.vrm?.update(timer.getDelta());
  renderer.render(scene, camera);
}

started(async () => {
  await create({});
  await load("figure.glb");
}).then(() => window.demo.failed || say("ready: speak, or choose a recording"));
renderer.setAnimationLoop(picture);
