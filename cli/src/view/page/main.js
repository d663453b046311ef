// Entry point: wires up the page, its keys and its buttons.

import { CharacterBody, FigureBody, usualFloor } from "umo/body.js";
import { Camera, insetsOf, steer } from "umo/camera.js";
import { readTextures } from "umo/character.js";
import { Clock } from "umo/clock.js";
import { decoded, finished, listenForFiles } from "umo/drop.js";
import { Experts } from "umo/experts.js";
import { readReliefs } from "umo/figure.js";
import { inspector } from "umo/inspect.js";
import { listenToKeys } from "umo/keys.js";
import { Live, LiveClock } from "umo/live.js";
import { follow } from "umo/local.js";
import { clamp } from "umo/math.js";
import { Motion } from "umo/motion.js";
import { livePanel } from "umo/panel.js";
import { Picture } from "umo/picture.js";
import { Record } from "umo/record.js";
import { MemberBody, RoomClock } from "umo/room.js";
import { block, readScene } from "umo/scene.js";
import { Timeline } from "umo/timeline.js";
import { takesOf } from "umo/takes.js";
import { allTracks, trackList } from "umo/tracks.js";
import { Video, save } from "umo/video.js";

const $ = (selector) => document.querySelector(selector);
const still = matchMedia("(prefers-reduced-motion: reduce)").matches;

const scene = readScene();
let body = null;
if (scene.character) {
  scene.character.file = block("character", "u8");
  body = scene.character.body = new CharacterBody(scene, scene.character);
  await readTextures(body);
  if (scene.frames.length === 0 && !scene.live) body.becomeMotion();
} else {
  await Promise.all(scene.meshes.map(readReliefs));
}
const motion = new Motion(scene);
if (scene.live) body?.follow(motion);
for (const member of scene.room) member.body = new MemberBody(scene, member);
body ??= scene.room[0]?.body ?? new FigureBody(scene, motion);
const record = new Record(scene);
const clock = scene.live ? new LiveClock(scene, motion) : new (scene.voices.some(({ samples }) => samples.length > 0) ? RoomClock : Clock)(scene, motion.seconds);
const picture = new Picture($("#view"), scene);
const camera = new Camera(body, still);
const tracks = allTracks(scene, motion);
const timeline = new Timeline($("#timeline"), { scene, motion, record, clock, seek });
const experts = new Experts($("#experts"), record, (layer) => timeline.setLayer(layer));
trackList($("#tracks"), tracks, (chosen) => timeline.setTracks(chosen));
const live = scene.live ? new Live({ scene, motion, clock, changed: touch }) : null;

let skeleton = false;
let dirty = true;
let before = performance.now();
let floor = usualFloor(body, motion);
let shown = { ...body.at(0), all: [], time: 0 };
let drawn = 0;
let insets = {};

/** Finds the parts of the picture that title and controls cover. */
function findInsets() {
  insets = insetsOf($("#view"), $("header"), $("#transport"));
  touch();
}

/** Requests a redraw. */
function touch() {
  dirty = true;
}

function seek(seconds) {
  clock.seek(seconds);
  touch();
}

async function play() {
  try {
    await clock.play();
  } catch {
    // If the browser requires a user gesture, the button waits for it.
  }
  touch();
}

function pause() {
  clock.pause();
  touch();
}

const toggle = () => (clock.playing ? pause() : play());
const frameNow = () => clamp(Math.round(clock.time * motion.rate), motion.first, Math.max(motion.first, motion.end - 1));

/** Steps by frames, or to the next keyframe. */
function step(frames) {
  pause();
  seek((frameNow() + frames) / motion.rate);
}

function stepKeyframe(way) {
  const stride = record.stride || 1;
  const now = frameNow() / stride;
  pause();
  seek(((way > 0 ? Math.floor(now + 1e-6) + 1 : Math.ceil(now - 1e-6) - 1) * stride) / motion.rate);
}

function useCamera(name) {
  camera.use(name);
  for (const button of document.querySelectorAll("[data-camera]")) {
    button.setAttribute("aria-pressed", String(button.dataset.camera === name));
  }
  touch();
}

/** Chooses the member that camera and curves show. */
function showMember(index, name = camera.name === "all" ? "half" : camera.name) {
  const member = scene.room[index];
  body = member.body;
  motion.values = member.frames;
  $("#member").value = String(index);
  camera.show(body);
  useCamera(name);
  timeline.draw();
}

/** Shows or hides the panels about how the motion was made. */
function setDetails(on) {
  document.documentElement.dataset.details = String(on);
  const button = $("#details");
  button.setAttribute("aria-expanded", String(on));
  button.textContent = on ? "Avatar only" : scene.takes?.score ? "Score" : "How it was made";
  findInsets();
  timeline.draw();
}

function setSkeleton(on) {
  skeleton = on;
  $("#skeleton").setAttribute("aria-pressed", String(on));
  touch();
}

function setTheme(name) {
  document.documentElement.dataset.theme = name;
  experts.shown = -1;
  timeline.draw();
  touch();
}

function setRate(rate) {
  clock.setRate(rate);
  $("#speed").value = String(rate);
}

function otherRate(way) {
  const rates = [...$("#speed").options].map(({ value }) => Number(value));
  setRate(rates[clamp(rates.indexOf(clock.rate) + way, 0, rates.length - 1)]);
}

/** Replaces the figure or the current character. */
async function putOn(file) {
  const bytes = new Uint8Array(await file.arrayBuffer());
  const character = await follow(scene, bytes, ({ loaded, total }) => say(`loading the model: ${total ? `${Math.round((100 * loaded) / total)} %` : `${loaded >> 20} MB`}`));
  character.body = new CharacterBody(scene, character, motion.rest);
  await readTextures(character.body);
  live.stop();
  scene.character = character;
  body = character.body;
  motion.fit(scene);
  body.follow(motion);
  picture.prepare();
  camera.show(body);
  floor = usualFloor(body, motion);
  useCamera(camera.name);
  timeline.draw();
  const { speaks, bones } = character.follower.description;
  const missing = Object.keys(bones).filter((joint) => bones[joint].length === 0);
  return [`${file.name} is on`, speaks ? "" : "it has no shapes that open its mouth", missing.length > 0 ? `no bones for ${missing.join(", ")}` : ""].filter(Boolean).join("; ");
}

/** Speaks another recording. */
async function hear(file) {
  const { samples, sampleRate } = await decoded(file);
  live.stop();
  Object.assign(scene, { samples, audio: { sampleRate }, isDropped: true });
  live.useRecording();
  touch();
  await live.start("recording");
  return `speaks ${file.name}`;
}

/** Sends a character to the program, whose page then shows it. */
async function send(file) {
  const answer = await fetch("/character", { method: "POST", body: file });
  if (!answer.ok) throw new Error(await answer.text());
  location.reload();
}

/** Shows a line of news in place of the notice. */
function say(text, isError = false) {
  const notice = $("#notice");
  scene.notice ??= notice.textContent;
  notice.textContent = text || scene.notice;
  notice.title = text;
  notice.dataset.kind = isError ? "error" : "";
}

let video = null;

/** Records a take from its start, or a stream until it ends; a second call stops it. */
async function saveVideo() {
  if (video) return endVideo();
  if (!Video.isPossible) return say("this browser cannot record video", true);
  pause();
  if (live && !live.isRunning) live.toggle();
  if (!live) {
    setRate(1);
    seek(0);
  }
  await until(() => !live || clock.playing || !live.isRunning);
  if (live && !clock.playing) return;
  const mouth = live?.mouth ? [[live.mouth.stream, clock.delay]] : [];
  const sound = live ? (live.mouth ? null : live.audio) : clock.audio;
  const voices = clock.stream ? [[clock.stream, 0]] : mouth;
  video = new Video($("#view"), { elements: sound ? [sound] : [], streams: voices });
  showVideo(true);
  if (!live) await play();
}

function showVideo(isOn) {
  $("#video").setAttribute("aria-pressed", String(isOn));
  $("#video").setAttribute("aria-label", isOn ? "Stop video" : "Save video");
}

async function endVideo() {
  const ended = video;
  video = null;
  showVideo(false);
  const file = await ended.stop();
  scene.video = file;
  if (file) save(file);
}

const until = async (what) => {
  while (!what()) await new Promise((done) => setTimeout(done, 50));
};

const KEYS = {
  " ": () => (live ? live.toggle() : toggle()),
  k: () => (live ? live.toggle() : toggle()),
  ArrowLeft: () => step(-1),
  ArrowRight: () => step(1),
  ArrowUp: () => otherRate(1),
  ArrowDown: () => otherRate(-1),
  j: () => seek(clock.time - 1),
  l: () => seek(clock.time + 1),
  ",": () => stepKeyframe(-1),
  ".": () => stepKeyframe(1),
  Home: () => seek(0),
  End: () => seek(clock.seconds),
  1: () => useCamera("face"),
  2: () => useCamera("half"),
  3: () => useCamera("whole"),
  4: () => useCamera("hands"),
  0: () => scene.room.length > 0 && useCamera("all"),
  m: () => scene.room.length > 0 && showMember((Number($("#member").value) + 1) % scene.room.length),
  v: () => saveVideo().catch((error) => say(error.message, true)),
  d: () => setDetails(document.documentElement.dataset.details !== "true"),
  s: () => setSkeleton(!skeleton),
  t: () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
  "+": () => timeline.zoom(0.7),
  "=": () => timeline.zoom(0.7),
  "-": () => timeline.zoom(1.4),
  "?": () => $("#help").showModal(),
  h: () => $("#help").showModal(),
};

const takes = scene.takes ? takesOf({ scene, motion, timeline, clock, camera, play, seek, toggle, say, touch, showMember, $ }) : null;
Object.assign(KEYS, takes?.keys);

const timeText = (seconds) => {
  const tenths = Math.floor(seconds * 10 + 1e-6);
  return `${Math.floor(tenths / 600)}:${String(Math.floor((tenths % 600) / 10)).padStart(2, "0")}.${tenths % 10}`;
};

/** Updates buttons, numbers and lines that depend on the time. */
function showTime(time) {
  const frame = frameNow();
  const button = $("#play");
  button.dataset.playing = String(clock.playing);
  button.setAttribute("aria-label", clock.playing ? "Pause" : "Play");
  button.dataset.fresh = String(time === 0);
  const slider = $("#seek");
  slider.max = String(Math.max(clock.seconds, 1e-3));
  slider.value = String(time);
  slider.style.setProperty("--done", `${(100 * time) / Math.max(clock.seconds, 1e-3)}%`);
  slider.setAttribute("aria-valuetext", `${timeText(time)} of ${timeText(clock.seconds)}`);
  $("#time").textContent = `${timeText(time)} / ${timeText(clock.seconds)}`;
  const chip = $("#frame");
  const key = record.isKeyframe(frame);
  chip.hidden = motion.count === 0;
  chip.dataset.kind = !record.isKnown ? "unknown" : key ? "keyframe" : "filled";
  chip.textContent = `frame ${frame}${record.isKnown ? (key ? " · keyframe" : " · interpolated") : ""}`;
  experts.show(frame);
  timeline.follow(time);
}

function loop(now) {
  requestAnimationFrame(loop);
  const seconds = Math.min((now - before) / 1000, 0.1);
  before = now;
  const time = clock.time;
  if (live?.ends(time)) touch();
  if (takes?.ends(time)) pause();
  if (live?.isRunning) live.catchUp();
  if (video && clock.playing && !video.hasBegun) video.begin();
  if (video?.hasBegun && !clock.playing) endVideo();
  if (!clock.playing && !dirty) return;
  draw(time, seconds);
  video?.draw();
}

function draw(time, seconds) {
  dirty = false;
  const { pose, placed } = body.at(time);
  const all = scene.room.length > 0 ? scene.room.map((member) => member.body.at(time)) : [{ pose, placed }];
  const feet = all.flatMap((one, i) => (scene.room[i]?.body ?? body).feet(one.placed.places, floor));
  shown = { time, pose, placed, all };
  if (camera.step(seconds, placed.places, floor)) touch();
  const theme = document.documentElement.dataset.theme;
  const from = picture.draw({ pose, placed, all, feet, camera, floor, theme, skeleton, insets });
  if (from) clock.hear?.(from);
  showTime(time);
  takes?.name(all);
  if (live) {
    live.look();
    panel.show();
  }
  drawn += 1;
}

const panel = live ? livePanel({ scene, motion, live, $ }) : null;
let counted = 0;
if (live) {
  // The timeline of a stream grows; the floor is known once there are feet.
  setInterval(() => {
    if (motion.end === counted) return;
    if (counted < 60) floor = usualFloor(body, motion);
    counted = motion.end;
    timeline.draw();
    touch();
  }, 250);
}

function listen() {
  listenToKeys(KEYS, camera, touch);
  const take = !live ? finished : { recording: hear, character: scene.live.engine ? putOn : send };
  listenForFiles(document.documentElement, take, say);
  $("#video").addEventListener("click", KEYS.v);
  $("#play").addEventListener("click", () => (live ? live.toggle() : toggle()));
  $("#details").addEventListener("click", KEYS.d);
  $("#back").addEventListener("click", () => stepKeyframe(-1));
  $("#on").addEventListener("click", () => stepKeyframe(1));
  $("#seek").addEventListener("input", (event) => seek(Number(event.target.value)));
  $("#member").addEventListener("change", (event) => showMember(Number(event.target.value)));
  $("#speed").addEventListener("change", (event) => setRate(Number(event.target.value)));
  $("#skeleton").addEventListener("click", () => setSkeleton(!skeleton));
  $("#theme").addEventListener("click", KEYS.t);
  $("#help-button").addEventListener("click", () => $("#help").showModal());
  $("#wider").addEventListener("click", () => timeline.zoom(1.4));
  $("#closer").addEventListener("click", () => timeline.zoom(0.7));
  for (const button of document.querySelectorAll("[data-camera]")) {
    button.addEventListener("click", () => useCamera(button.dataset.camera));
  }
  steer($("#view"), camera, touch);
  const sized = new ResizeObserver(findInsets);
  for (const selector of ["#view", "#transport", "header"]) sized.observe($(selector));
  // Redraw when the page becomes visible again.
  document.addEventListener("visibilitychange", () => {
    live?.catchUp();
    touch();
  });
  clock.ended = touch;
}

window.umo = inspector({
  scene,
  motion,
  clock,
  camera,
  picture,
  live,
  takes,
  last: () => ({ ...shown, drawn }),
  actions: {
    play,
    pause,
    camera: useCamera,
    details: setDetails,
    follow: showMember,
    skeleton: setSkeleton,
    theme: setTheme,
    seek(seconds) {
      seek(seconds);
      draw(clock.time, 0);
    },
  },
});
document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
document.documentElement.dataset.live = String(Boolean(live));
document.documentElement.dataset.takes = !scene.takes ? "none" : scene.takes.score ? "one" : "several";
listen();
$("#member").append(...scene.room.map(({ name }, i) => new Option(name, String(i))));
for (const one of [$("#member"), $("[data-camera=all]")]) one.hidden = scene.room.length === 0;
useCamera(scene.room.length > 0 ? "all" : "half");
setDetails(false);
draw(0, 0);
requestAnimationFrame(loop);
document.documentElement.dataset.ready = "true";
// Autoplay unless reduced motion is preferred; browsers may refuse without a user gesture, and the button waits.
if (!live && !still) play();
