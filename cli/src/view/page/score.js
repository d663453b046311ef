// The score of a take: its text, and edits of its events. Times in seconds. An event has an `id`, which no text shows.

/** Kinds of events in the order of a text. */
export const KINDS = ["words", "left", "right", "both", "gesture", "lips", "look", "mood", "expression", "attention", "layer"];
/** Phases of a hand, in the order of a gesture. */
export const PHASES = ["rest", "prepare", "stroke", "hold", "retract"];
/** Keys of an event after its kind, in the order of a text. */
const MORE = ["side", "strength", "speed", "variant", "target", "gain"];
/** Steps of the hands' spans and of other events, and the shortest of both. */
export const GRID = 0.1;
const FINE = 0.01;
/** Length of a stroke that is added, and of the way to it and back. */
const STROKE = 0.4;
const WAY = 0.3;

let last = 0;
/** The event with a number of its own. */
export const numbered = (event) => ({ ...event, id: ++last });

export const kindOf = (event) => KINDS.find((kind) => kind in event);
export const isHand = (kind) => ["left", "right", "both"].includes(kind);
const handsOf = (kind) => (kind === "both" ? ["left", "right"] : [kind]);
const isSpan = (event) => "to" in event;
/** A time on the grid of an event of this kind. */
export const onGrid = (kind, seconds) => {
  const steps = 1 / (isHand(kind) ? GRID : FINE);
  return Math.round(seconds * steps) / steps;
};
export const shortest = (kind) => (isHand(kind) ? GRID : 0.05);

/** A number with at most three decimals, and no zeros at its end. */
export const digits = (value) => String(Number(Number(value).toFixed(3)) + 0);

const escapes = { "\t": "\\t", "\n": "\\n", "\r": "\\r", '"': '\\"', "\\": "\\\\" };
const quoted = (text) => `"${text.replace(/["\\\u0000-\u001f\u007f-\u009f]/g, (c) => escapes[c] ?? `\\u${c.codePointAt(0).toString(16).toUpperCase().padStart(4, "0")}`)}"`;
const written = (value) => (Array.isArray(value) ? `[${value.map(digits).join(", ")}]` : typeof value === "string" ? quoted(value) : digits(value));

function line(event) {
  const keys = ["at", "to", kindOf(event), ...MORE].filter((key) => event[key] !== undefined);
  return `{ ${keys.map((key) => `${key} = ${written(event[key])}`).join(", ")} }`;
}

/** The score as a TOML text. */
export function textOf({ seconds, events }) {
  const rows = events.map((event) => ({ at: Number(digits(event.at)), rank: KINDS.indexOf(kindOf(event)), text: line(event) }));
  rows.sort((a, b) => a.at - b.at || a.rank - b.rank || (a.text < b.text ? -1 : a.text > b.text ? 1 : 0));
  const lines = rows.map(({ text }) => `    ${text},\n`).join("");
  return `# What a take does, in seconds: docs/scores.md\nversion = 1\nseconds = ${digits(seconds)}\nevents = [\n${lines}]\n`;
}

/** The rest of an event under a span of some hands. */
function cut(event, { at, to }, hands) {
  const kind = kindOf(event);
  const both = isHand(kind) ? handsOf(kind) : [];
  if (!both.some((hand) => hands.includes(hand)) || event.to <= at + 1e-6 || event.at >= to - 1e-6) return [event];
  const pieces = [];
  const piece = (kind, from, end) => {
    if (end - from < 1e-6) return;
    const { id, [kindOf(event)]: phase, ...rest } = event;
    pieces.push({ ...rest, at: from, to: end, [kind]: phase, id: pieces.length === 0 ? id : ++last });
  };
  piece(kind, event.at, at);
  for (const hand of both.filter((hand) => !hands.includes(hand))) piece(hand, Math.max(event.at, at), Math.min(event.to, to));
  piece(kind, to, event.to);
  return pieces;
}

/** The events with this one in place of that with its number; a span of a hand cuts the others of that hand. */
export function put(events, event) {
  const others = events.filter(({ id }) => id !== event.id);
  const kind = kindOf(event);
  return [...(isHand(kind) ? others.flatMap((other) => cut(other, event, handsOf(kind))) : others), event];
}

export const without = (events, id) => events.filter((event) => event.id !== id);

/** The event, moved by some seconds within the score. */
export function moved(event, by, seconds) {
  const kind = kindOf(event);
  const length = isSpan(event) ? event.to - event.at : 0;
  const at = onGrid(kind, Math.min(Math.max(event.at + by, 0), Math.max(seconds - length, 0)));
  return { ...event, at, ...(isSpan(event) ? { to: onGrid(kind, at + length) } : {}) };
}

/** The event with one end, `at` or `to`, moved by some seconds. */
export function stretched(event, end, by, seconds) {
  if (!isSpan(event)) return moved(event, by, seconds);
  const kind = kindOf(event);
  const time = onGrid(kind, event[end] + by);
  const bounded = end === "at" ? Math.min(Math.max(time, 0), event.to - shortest(kind)) : Math.max(Math.min(time, seconds), event.at + shortest(kind));
  return { ...event, [end]: onGrid(kind, bounded) };
}

/** The events with a stroke: where its hands rest before and after it, they prepare and retract. */
function withStroke(events, stroke, seconds) {
  const kind = kindOf(stroke);
  const hands = handsOf(kind);
  let all = put(events, stroke);
  const moves = (at) => all.some((event) => {
    const other = kindOf(event);
    return isHand(other) && event[other] !== "rest" && handsOf(other).some((hand) => hands.includes(hand)) && event.at < at && at < event.to;
  });
  const way = (from, step, phase) => {
    let steps = 0;
    const next = () => from + step * (steps + 0.5);
    while (steps * GRID < WAY - 1e-6 && next() > 0 && next() < seconds && !moves(next())) steps += 1;
    if (steps === 0) return;
    const [at, to] = [from, from + step * steps].sort((a, b) => a - b).map((time) => onGrid(kind, time));
    all = put(all, numbered({ at, to, [kind]: phase }));
  };
  way(stroke.at, -GRID, "prepare");
  way(stroke.to, GRID, "retract");
  return all;
}

/** An event of a kind at a time, as it is added. `names` has the gestures, moods and others that exist. */
function fresh(kind, at, names) {
  switch (kind) {
    case "words":
      return { at, to: at + 0.4, words: "words" };
    case "gesture":
      return { at, gesture: names.gestures[0] };
    case "lips":
      return { at, to: at + 0.1, lips: names.lips[0] };
    case "look":
      return { at, look: [0, 1.6, 2], strength: 1 };
    case "mood":
      return { at, mood: names.moods[1] ?? names.moods[0], strength: 0.5 };
    case "expression":
      return { at, expression: 0.5 };
    case "attention":
      return { at, attention: names.attentions[0] };
    case "layer":
      return { at, layer: names.layers[0], gain: 0.5 };
    default:
      return { at, to: at + STROKE, [kind]: "stroke", strength: 0.5 };
  }
}

/** The events with another of this kind, and its number. */
export function added(events, kind, at, score) {
  const event = moved(numbered(fresh(kind, onGrid(kind, at), score)), 0, score.end(kind));
  return { id: event.id, events: isHand(kind) ? withStroke(events, event, score.end(kind)) : put(events, event) };
}

const HAND = { left: "left hand", right: "right hand", both: "both hands" };

/** An event in words. */
export function saying(event) {
  const kind = kindOf(event);
  const value = event[kind];
  const name = isHand(kind) ? `${HAND[kind]}, ${value}` : kind === "look" ? `look at ${value.map(digits).join(", ")}` : `${kind} ${value}`;
  const time = isSpan(event) ? `${digits(event.at)} to ${digits(event.to)} s` : `${digits(event.at)} s`;
  const strength = event.strength === undefined ? [] : [`strength ${digits(event.strength)}`];
  return [name, time, ...strength, ...(event.side ? [`side ${event.side}`] : []), ...(event.gain === undefined ? [] : [`gain ${digits(event.gain)}`])].join(", ");
}

/** The short text on an event. */
export function label(event) {
  const kind = kindOf(event);
  const value = event[kind];
  if (isHand(kind)) return value === "rest" ? "" : value;
  if (kind === "look") return value.map(digits).join(" ");
  if (kind === "layer") return `${value} ${digits(event.gain)}`;
  return kind === "expression" ? digits(value) : value;
}
