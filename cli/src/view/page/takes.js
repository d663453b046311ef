// The page of takes: the score that is edited, saved and drawn, and the take that is kept.

import { Editor } from "umo/editor.js";
import { KINDS, isHand } from "umo/score.js";
import { block } from "umo/scene.js";
import { save } from "umo/video.js";

const NAMES = { words: "Words", left: "Stroke, left hand", right: "Stroke, right hand", both: "Stroke, both hands", gesture: "Gesture", lips: "Lips", look: "Look", mood: "Mood", expression: "Expression", attention: "Attention", layer: "Layer" };

/** Seconds within which a stretch that is heard has just come to its end. */
const PASSED = 1.5;
/** Height of a name above the head's joint, metres. */
const ABOVE = 0.27;

/** The answer of the program. */
async function asked(what, body) {
  const answer = await fetch(`/take/${what}`, { method: "POST", body });
  if (!answer.ok) throw new Error((await answer.text()).trim());
  return answer;
}

/** Sets up the page's takes; returns its keys, and what the loop asks. */
export function takesOf({ scene, motion, timeline, clock, camera, play, seek, toggle, say, touch, showMember, $ }) {
  const { takes } = scene;
  const isServed = takes.kept !== null;
  const { stem, score } = takes;
  const failed = (error) => say(error.message, true);
  /** The frames before and after a drawing. */
  const frames = { old: motion.values, drawn: null };
  let until = null;

  /** The take that is kept: the one that was drawn, or a member. */
  const number = () => (score ? "drawn" : $("#member").value);
  const canKeep = () => !score || frames.drawn !== null;

  async function keep() {
    if (!canKeep()) return say(isServed ? "draw the edit, and it can be kept" : `this page cannot draw: save the score, and ${command()} draws it`, true);
    if (isServed) return say(`kept in ${await (await asked("keep", number())).text()}`);
    save(new File([block(`take-${number()}`, "u8")], `${stem}.umo`, { type: "application/octet-stream" }));
    return say(`${scene.room[number()].name} is kept as ${stem}.umo`);
  }

  const command = () => `\`umo animate ${takes.audio ?? "RECORDING"} --take ${stem}.umo --score ${stem}.toml -o ${stem}-2.umo\``;

  $("#keep").hidden = Boolean(score) && !isServed;
  const keepTake = () => keep().catch(failed);
  $("#keep").addEventListener("click", keepTake);
  if (!score) return { keys: { k: keepTake }, ends: () => false, name: names({ scene, camera, showMember, $ }) };

  const editor = new Editor({
    score,
    timeline,
    clock,
    toggle,
    async play(from, to) {
      seek(from);
      await play();
      until = to;
    },
    changed() {
      if (!isServed) say(editor.at > 0 ? `an edit: save it, and ${command()} draws it` : "");
    },
    compared: showFrames,
  });
  $("#event .hint code").textContent = isServed ? "" : command().slice(1, -1);
  $("#event .hint .served").hidden = !isServed;
  $("#event .hint .alone").hidden = isServed;
  $("#draw").hidden = !isServed;

  function showFrames() {
    motion.values = editor.isBefore || !frames.drawn ? frames.old : frames.drawn;
    touch();
  }

  async function saveScore() {
    const { text } = editor;
    if (isServed) say(`saved in ${await (await asked("score", text)).text()}`);
    else save(new File([text], `${stem}.toml`, { type: "application/toml" }));
    editor.keep();
  }

  async function draw() {
    $("#draw").disabled = true;
    say("draws the take anew…");
    try {
      const { text } = editor;
      frames.drawn = new Float32Array(await (await asked("draw", text)).arrayBuffer());
      if (text === editor.text) editor.keep();
      editor.compare(false);
      showFrames();
      timeline.draw();
      $("#keep").disabled = false;
      say("drawn: C compares it with the take before");
    } finally {
      $("#draw").disabled = false;
    }
  }

  const dialog = $("#add");
  const kinds = KINDS.filter((kind) => score.hands || !isHand(kind));
  dialog.querySelector(".kinds").append(
    ...kinds.map((kind) => {
      const button = document.createElement("button");
      button.value = kind;
      button.textContent = NAMES[kind];
      return button;
    }),
  );
  dialog.addEventListener("close", () => kinds.includes(dialog.returnValue) && editor.add(dialog.returnValue));
  const add = () => {
    dialog.returnValue = "";
    dialog.showModal();
  };
  const actions = {
    add,
    delete: () => editor.delete(),
    hear: () => editor.hear(),
    undo: () => editor.undo(),
    redo: () => editor.undo(1),
    before: () => editor.at > 0 && editor.compare(!editor.isBefore),
    save: () => saveScore().catch(failed),
    draw: () => isServed && !$("#draw").disabled && draw().catch(failed),
  };
  for (const name of Object.keys(actions)) $(name === "add" ? "#add-button" : `#${name}`).addEventListener("click", actions[name]);
  $("#keep").disabled = true;
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey || event.target.matches("input:not([type=range], [type=checkbox]), dialog *")) return;
    const action = { z: event.shiftKey ? actions.redo : actions.undo, y: actions.redo, s: actions.save }[event.key.toLowerCase()];
    if (!action) return;
    event.preventDefault();
    action();
  });
  addEventListener("beforeunload", (event) => editor.isEdited && event.preventDefault());
  timeline.useScore(editor);
  const step = (steps, end) => () => editor.move(steps, end);
  return {
    editor,
    keys: {
      n: () => editor.next(1),
      p: () => editor.next(-1),
      "[": step(-1),
      "]": step(1),
      "{": step(-1, "to"),
      "}": step(1, "to"),
      Delete: actions.delete,
      Backspace: actions.delete,
      a: add,
      r: actions.hear,
      u: actions.undo,
      y: actions.redo,
      c: actions.before,
      w: actions.save,
      g: actions.draw,
      k: keepTake,
      e: () => editor.fields.focus(),
    },
    /** Whether the stretch that is heard has come to its end. */
    ends(time) {
      if (until === null) return false;
      // Somebody who sought another place, or stopped it, hears on from there.
      const isOver = time >= until && time < until + PASSED && clock.playing;
      if (time >= until || !clock.playing) until = null;
      return isOver;
    },
    name() {},
  };
}

/** Names over the heads of takes side by side, which choose one; returns what places them. */
function names({ scene, camera, showMember, $ }) {
  const [view, head] = [$("#view"), scene.joints.indexOf("head")];
  const buttons = scene.room.map(({ name }, i) => {
    const button = document.createElement("button");
    button.textContent = name;
    button.addEventListener("click", () => showMember(i, camera.name));
    return button;
  });
  $("#names").append(...buttons);
  $("#names").hidden = false;
  return (all) =>
    buttons.forEach((button, i) => {
      const [x, y, z] = all[i].placed.places[head];
      const [left, top] = camera.project([x, y + ABOVE, z], view.clientWidth, view.clientHeight);
      button.hidden = left < 0 || left > view.clientWidth || top > view.clientHeight;
      Object.assign(button.style, { left: `${left}px`, top: `${Math.max(top, button.offsetHeight + 2)}px` });
      button.setAttribute("aria-pressed", String($("#member").value === String(i)));
    });
}
