// The fields of the event that is chosen in the score.

import { PHASES, isHand, kindOf, saying } from "umo/score.js";

const SIDES = ["left", "right", "both"];
const share = (key, name = key) => ({ key, name, min: 0, max: 1, step: 0.05 });

/** Fields of an event: a key with numbers or choices, or a function of the event. */
function fieldsOf(event, score) {
  const kind = kindOf(event);
  const step = isHand(kind) ? 0.1 : 0.01;
  const time = (key, name) => ({ key, name, min: 0, max: score.end(kind), step });
  const times = [time("at", "from"), ...("to" in event ? [time("to", "to")] : [])];
  if (!("to" in event)) times[0].name = "at";
  const own = {
    words: [{ key: "words", name: "words", isText: true }],
    gesture: [
      { key: "gesture", name: "gesture", choices: score.gestures },
      { key: "side", name: "side", choices: ["", ...SIDES] },
      { key: "strength", name: "strength", min: 0, max: 2, step: 0.05, usual: 1 },
      { key: "speed", name: "speed", min: 0.25, max: 4, step: 0.05, usual: 1 },
      { key: "variant", name: "variant", min: 0, max: 255, step: 1, usual: 0 },
      ...["x", "y", "z"].map((name, axis) => ({ key: "target", name: `target ${name}, m`, axis, step: 0.05 })),
    ],
    lips: [{ key: "lips", name: "lips", choices: score.lips }],
    look: [...["x", "y", "z"].map((name, axis) => ({ key: "look", name: `${name}, m`, axis, step: 0.05 })), share("strength")],
    mood: [{ key: "mood", name: "mood", choices: score.moods }, share("strength")],
    expression: [share("expression")],
    attention: [{ key: "attention", name: "attention", choices: score.attentions }],
    layer: [{ key: "layer", name: "layer", choices: score.layers }, share("gain")],
  };
  const hand = () => [
    { key: "hands", name: "hands", choices: SIDES },
    { key: kind, name: "phase", choices: PHASES },
    ...(event[kind] === "stroke" ? [{ ...share("strength"), optional: true }] : []),
  ];
  return [...(isHand(kind) ? hand() : own[kind]), ...times];
}

const valueOf = (event, { key, axis, usual }) => {
  if (key === "hands") return kindOf(event);
  if (axis !== undefined) return event[key]?.[axis] ?? "";
  return event[key] ?? usual ?? "";
};

/** The event with the value of a field. */
function changed(event, { key, axis, usual, optional, choices, isText }, value) {
  const kind = kindOf(event);
  if (key === "hands") {
    const { [kind]: phase, ...rest } = event;
    return { ...rest, [value]: phase };
  }
  if (axis !== undefined) {
    const { [key]: old, ...rest } = event;
    // Without a number in any field, there is no place.
    if (value === "" && key === "target") return rest;
    const place = [...(old ?? [0, 1.2, 1])];
    place[axis] = Number(value);
    return { ...rest, [key]: place };
  }
  const { [key]: old, ...rest } = event;
  const meant = isText || choices ? value : Number(value);
  if (meant === usual || (value === "" && (optional || key === "side"))) return rest;
  const next = { ...rest, [key]: meant };
  // Only strokes have a strength.
  if (key === kind && isHand(kind) && meant !== "stroke") delete next.strength;
  if (key === kind && isHand(kind) && meant === "stroke") next.strength ??= 0.5;
  return next;
}

export class Fields {
  /** `edit` takes the event as a field changes it. */
  constructor(element, score, edit) {
    Object.assign(this, { element, score, edit, built: "" });
    this.head = element.querySelector("h2");
    this.form = element.querySelector("form");
    this.form.addEventListener("submit", (event) => event.preventDefault());
  }

  /** Shows an event, or none. */
  show(event, isFixed) {
    this.event = event;
    this.form.hidden = !event;
    this.element.querySelector(".hint").hidden = Boolean(event);
    this.head.textContent = event ? `${isHand(kindOf(event)) ? "Hands" : kindOf(event)[0].toUpperCase() + kindOf(event).slice(1)}` : "Score";
    if (!event) {
      this.built = "";
      return;
    }
    this.head.title = saying(event);
    const fields = fieldsOf(event, this.score);
    const built = `${event.id} ${fields.map(({ key, name }) => key + name).join()}`;
    if (built !== this.built) this.build(fields);
    this.built = built;
    this.inputs.forEach(({ input, field }) => {
      if (document.activeElement !== input || !field.isText) input.value = String(valueOf(event, field));
      input.disabled = isFixed;
    });
  }

  build(fields) {
    this.inputs = fields.map((field) => {
      const input = document.createElement(field.choices ? "select" : "input");
      if (field.choices) input.append(...field.choices.map((choice) => new Option(choice || "its own", choice)));
      else input.type = field.isText ? "text" : "number";
      for (const name of ["min", "max", "step"]) if (field[name] !== undefined && !field.choices) input[name] = String(field[name]);
      input.addEventListener("change", () => {
        const isWrong = !input.checkValidity() || (input.type === "number" && input.value === "" && !field.optional && field.key !== "target");
        if (isWrong && input.validity.stepMismatch === false) input.value = String(valueOf(this.event, field));
        else this.edit(changed(this.event, field, input.value));
      });
      const row = document.createElement("label");
      const words = document.createElement("span");
      words.textContent = field.name;
      row.append(words, input);
      return { input, field, row };
    });
    this.form.replaceChildren(...this.inputs.map(({ row }) => row));
  }

  /** Puts the cursor into the first field. */
  focus() {
    const [first] = this.inputs ?? [];
    first?.input.focus();
    first?.input.select?.();
  }
}
