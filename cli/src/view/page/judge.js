// Entry point of the page to judge: plays a motion with its own speech and with another's, and collects the answers.

import { FigureBody, usualFloor } from "umo/body.js";
import { Camera, insetsOf, steer } from "umo/camera.js";
import { Clock } from "umo/clock.js";
import { readReliefs } from "umo/figure.js";
import { listenToKeys } from "umo/keys.js";
import { addMask, faceless } from "umo/mask.js";
import { clamp } from "umo/math.js";
import { Motion, place } from "umo/motion.js";
import { Picture } from "umo/picture.js";
import { readScene } from "umo/scene.js";
import { byFace, count, csvOf, jsonOf, trialsOf } from "umo/trials.js";
import { save } from "umo/video.js";

const $ = (selector) => document.querySelector(selector);
const $$ = (selector) => [...document.querySelectorAll(selector)];
const still = matchMedia("(prefers-reduced-motion: reduce)").matches;

const scene = readScene();
const { judge } = scene;
await readReliefs(scene.mesh);
const showMask = addMask(scene);
const motion = new Motion(scene);
const body = new FigureBody(scene, motion);
const picture = new Picture($("#view"), scene);
const camera = new Camera(body, still);
const floor = usualFloor(body, motion);

/** `#seed=1` in the address repeats an order. */
const seed = Number(location.hash.match(/^#seed=(\d+)$/)?.[1] ?? crypto.getRandomValues(new Uint32Array(1))[0]) >>> 0;
const trials = trialsOf(judge, seed);
const answers = [];
const clocks = new Map();

/** Seconds over which a piece of sound begins and ends. */
const FADE = 0.02;

let trial = null;
/** A or B, and its clock. */
let playing = null;
/** Time in the piece of motion. */
let at = 0;
let isFaceShown = false;
let isSaved = true;
let dirty = true;
let before = performance.now();
let insets = {};
let drawn = null;

function touch() {
  dirty = true;
}

/** The clock of a piece of sound, made when it is first heard. */
function clockOf({ index }) {
  if (!clocks.has(index)) {
    const rate = scene.audio.sampleRate;
    const length = judge.seconds * rate;
    const samples = scene.samples.slice(index * length, (index + 1) * length);
    const fade = Math.round(FADE * rate);
    for (let i = 0; i < fade; i++) for (const place of [i, length - 1 - i]) samples[place] *= i / fade;
    clocks.set(index, new Clock({ samples, audio: scene.audio }, judge.seconds));
  }
  return clocks.get(index);
}

const soundOf = (name) => ((name === "A") === trial.isOwnA ? trial.piece : trial.other);

/** Begins the next trial, or ends the test. */
function next() {
  const one = trials[answers.length];
  trial = one ? { ...one, plays: { A: 0, B: 0 }, heard: { A: false, B: false }, face: faceNow(), since: performance.now() } : null;
  at = 0;
  camera.show(body);
  showState();
}

const faceNow = () => (isFaceShown ? "shown" : "hidden");

/** Plays the motion from its start with A or B, or stops it. */
async function play(name) {
  const was = playing?.name;
  stop();
  if (!trial || was === name) return;
  const clock = clockOf(soundOf(name));
  clock.ended = () => {
    trial.heard[name] = true;
    stop();
  };
  clock.seek(0);
  at = 0;
  playing = { name, clock };
  showState();
  try {
    await clock.play();
  } catch {
    // Refused by the browser, or stopped before it began.
    if (playing?.clock === clock) stop();
    return;
  }
  if (playing?.clock === clock) trial.plays[name] += 1;
  else clock.pause();
}

function stop() {
  playing?.clock.pause();
  playing = null;
  showState();
}

const canAnswer = () => Boolean(trial?.heard.A && trial.heard.B);

/** Takes A, B or `equal` as the answer. */
function take(answer) {
  if (!canAnswer()) return;
  stop();
  const place = ({ take, part }) => [judge.takes[take].name, part * judge.seconds];
  const [[motion, start], [other, otherStart]] = [trial.piece, trial.other].map(place);
  answers.push({
    pair: answers.length + 1,
    motion,
    start,
    other,
    otherStart,
    own: trial.isOwnA ? "A" : "B",
    answer,
    face: trial.face,
    playsA: trial.plays.A,
    playsB: trial.plays.B,
    seconds: Number(((performance.now() - trial.since) / 1000).toFixed(2)),
    at: new Date().toISOString(),
  });
  isSaved = false;
  next();
  if (!trial) showResults();
}

function showFace(isShown) {
  isFaceShown = isShown;
  $("#face").checked = isShown;
  showMask(!isShown);
  if (trial && isShown) trial.face = "shown";
  touch();
}

function useCamera(name) {
  camera.use(name);
  for (const button of $$("[data-camera]")) button.setAttribute("aria-pressed", String(button.dataset.camera === name));
  touch();
}

function setTheme(name) {
  document.documentElement.dataset.theme = name;
  touch();
}

function taskText() {
  if (!trial) return `All ${trials.length} pairs are answered. Thank you: save the results.`;
  return canAnswer() ? "Which speech fits the motion better?" : "The same motion with two recordings, A and B. Play both to the end.";
}

function showState() {
  $("#state").textContent = `pair ${Math.min(answers.length + 1, trials.length)} of ${trials.length}`;
  $("#task").textContent = taskText();
  for (const button of $$("[data-play]")) {
    const name = button.dataset.play;
    button.disabled = !trial;
    button.dataset.playing = String(playing?.name === name);
    button.dataset.heard = String(Boolean(trial?.heard[name]));
    button.setAttribute("aria-label", playing?.name === name ? `Stop ${name}` : `Play ${name}`);
  }
  for (const button of $$("[data-answer]")) button.disabled = !canAnswer();
  touch();
}

const percent = (share) => (100 * share).toFixed(1);

/** Rows of the table of results, with a column for pairs whose face was hidden, and one for the others. */
function resultRows() {
  const columns = Object.entries(byFace(answers)).map(([face, some]) => [face, count(some)]);
  const row = (name, of) => [name, ...columns.map(([face, counts]) => of(counts, face))];
  return [
    row("face", (_, face) => face),
    ...["pairs", "right", "equal", "wrong"].map((name) => row(name, (counts) => counts[name])),
    row("share right", ({ share }) => `${percent(share)} %`),
    row("95 % interval", ({ low, high }) => `${percent(low)} to ${percent(high)} %`),
  ];
}

function showResults() {
  stop();
  const rows = answers.length > 0 ? resultRows() : [["No pair is answered yet."]];
  const lines = rows.map(([name, ...values]) => {
    const line = document.createElement("tr");
    line.append(Object.assign(document.createElement("th"), { scope: "row", textContent: name }));
    for (const value of values) line.insertCell().textContent = value;
    return line;
  });
  $("#results table").replaceChildren(...lines);
  for (const button of $$("#save-json, #save-csv")) button.disabled = answers.length === 0;
  $("#results").showModal();
}

function saveAs(extension, textOf) {
  const text = textOf({ about: $("#about").textContent, seed, seconds: judge.seconds, answers });
  save(new File([text], `umo-judge-${seed}.${extension}`, { type: "text/plain" }));
  isSaved = true;
}

function loop(now) {
  requestAnimationFrame(loop);
  const seconds = Math.min((now - before) / 1000, 0.1);
  before = now;
  if (playing) at = playing.clock.time;
  if (playing || dirty) draw(seconds);
}

function draw(seconds) {
  dirty = false;
  const index = trial?.piece.index ?? 0;
  const time = index * judge.frames + clamp(at * motion.rate, 0, judge.frames - 1);
  const moved = motion.pose(time / motion.rate);
  const pose = isFaceShown ? moved : faceless(scene, moved);
  const placed = place(scene, pose);
  drawn = { pose, placed, frame: time };
  if (camera.step(seconds, placed.places, floor)) touch();
  const theme = document.documentElement.dataset.theme;
  picture.draw({ pose, placed, feet: body.feet(placed.places, floor), camera, floor, theme, skeleton: false, insets });
  for (const button of $$("[data-play]")) {
    button.style.setProperty("--done", `${playing?.name === button.dataset.play ? (100 * at) / judge.seconds : 0}%`);
  }
}

const KEYS = {
  a: () => play("A"),
  b: () => play("B"),
  ArrowLeft: () => take("A"),
  ArrowDown: () => take("equal"),
  ArrowRight: () => take("B"),
  1: () => useCamera("half"),
  2: () => useCamera("whole"),
  f: () => showFace(!isFaceShown),
  r: showResults,
  t: () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
  "?": () => $("#help").showModal(),
  h: () => $("#help").showModal(),
};

function listen() {
  listenToKeys(KEYS, camera, touch);
  steer($("#view"), camera, touch);
  for (const button of $$("[data-play]")) button.addEventListener("click", () => play(button.dataset.play));
  for (const button of $$("[data-answer]")) button.addEventListener("click", () => take(button.dataset.answer));
  for (const button of $$("[data-camera]")) button.addEventListener("click", () => useCamera(button.dataset.camera));
  $("#face").addEventListener("change", (event) => showFace(event.target.checked));
  $("#results-button").addEventListener("click", showResults);
  $("#save-json").addEventListener("click", () => saveAs("json", jsonOf));
  $("#save-csv").addEventListener("click", () => saveAs("csv", csvOf));
  $("#theme").addEventListener("click", KEYS.t);
  $("#help-button").addEventListener("click", KEYS.h);
  const sized = new ResizeObserver(() => {
    insets = insetsOf($("#view"), $("header"), $("#transport"));
    touch();
  });
  for (const selector of ["#view", "#transport", "header"]) sized.observe($(selector));
  document.addEventListener("visibilitychange", touch);
  addEventListener("beforeunload", (event) => isSaved || event.preventDefault());
}

window.umo = {
  scene,
  seed,
  trials,
  answers,
  camera: useCamera,
  theme: setTheme,
  get trial() {
    return trial;
  },
  get playing() {
    return playing;
  },
  /** Frame of the last picture, counted over all pieces. */
  get frame() {
    return drawn.frame;
  },
  draw: () => draw(0),
  weights: () => picture.figure.weights(drawn.pose.face),
  onScreen(name) {
    const view = $("#view");
    return camera.project(drawn.placed.places[scene.joints.indexOf(name)], view.clientWidth, view.clientHeight);
  },
};
document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
listen();
useCamera("whole");
next();
draw(0);
requestAnimationFrame(loop);
document.documentElement.dataset.ready = "true";
