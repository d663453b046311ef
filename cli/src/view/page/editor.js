// The score of a take in the timeline: events that are chosen, moved, lengthened, added and deleted.

import { Fields } from "umo/fields.js";
import { clamp } from "umo/math.js";
import { GRID, added, isHand, kindOf, label, moved, numbered, onGrid, put, saying, shortest, stretched, textOf, without } from "umo/score.js";

/** Lanes: name, and the kinds of events in it. The first ones are always there. */
const LANES = [
  { name: "words", kinds: ["words"] },
  { name: "left hand", kinds: ["left"] },
  { name: "right hand", kinds: ["right", "both"] },
  { name: "gestures", kinds: ["gesture"] },
  { name: "looks", kinds: ["look"] },
  { name: "moods", kinds: ["mood"] },
  { name: "lips", kinds: ["lips"] },
  { name: "expression", kinds: ["expression"] },
  { name: "attention", kinds: ["attention"] },
  { name: "layers", kinds: ["layer"] },
];
const ALWAYS = 6;
/** Seconds that are heard before and after an event, and of one without an end. */
const AROUND = 0.5;
const MOMENT = 1;
/** Width of an end that can be drawn, and the least way of a drag, CSS pixels. */
const EDGE = 7;
const STILL = 3;

export class Editor {
  /** `play(from, to)` plays a stretch, `toggle` starts or stops, `say` shows a line of news, `compared` is told whether the state before all edits is shown. */
  constructor({ score, timeline, clock, play, toggle, changed, compared }) {
    Object.assign(this, { score, timeline, clock, play, toggle, changed, compared });
    score.end = (kind) => (isHand(kind) ? onGrid("both", score.seconds) : score.seconds);
    this.history = [score.events.map(numbered)];
    this.at = this.saved = 0;
    this.chosen = null;
    this.dragged = null;
    this.isBefore = false;
    this.buttons = new Map();
    this.element = document.querySelector("#events");
    this.fields = new Fields(document.querySelector("#event"), score, (event) => this.edit(this.fitted(event)));
    this.element.hidden = document.querySelector("#event").hidden = document.querySelector("#score").hidden = false;
    this.listen();
    this.show();
  }

  /** Events as they are shown: before all edits, as one is dragged, or now. */
  get events() {
    return this.isBefore ? this.history[0] : (this.dragged?.events ?? this.history[this.at]);
  }

  get event() {
    return this.events.find(({ id }) => id === this.chosen) ?? null;
  }

  get text() {
    return textOf({ seconds: this.score.seconds, events: this.history[this.at] });
  }

  get isEdited() {
    return this.at !== this.saved;
  }

  /** Lanes with events, and those that are always there. */
  get lanes() {
    const has = ({ kinds }) => this.events.some((event) => kinds.includes(kindOf(event)));
    return LANES.filter((lane, i) => (i < ALWAYS ? this.score.hands || !isHand(lane.kinds[0]) : has(lane)));
  }

  /** Replaces the events, as one step that can be undone. */
  commit(events) {
    this.compare(false);
    if (this.saved > this.at) this.saved = -1;
    this.history = [...this.history.slice(0, this.at + 1), events];
    this.at += 1;
    this.show();
    this.changed();
  }

  edit(event) {
    this.commit(put(this.history[this.at], event));
  }

  /** The event with times that are on the grid and in order. */
  fitted(event) {
    const kind = kindOf(event);
    const end = this.score.end(kind);
    if (!("to" in event)) return moved(event, 0, end);
    const at = onGrid(kind, clamp(event.at, 0, end - shortest(kind)));
    return { ...event, at, to: onGrid(kind, clamp(event.to, at + shortest(kind), end)) };
  }

  choose(id, isFocused = true) {
    this.chosen = id;
    this.show();
    const { event } = this;
    if (!event) return;
    this.timeline.reveal(event.at, event.to ?? event.at);
    if (isFocused) this.buttons.get(id)?.focus({ preventScroll: true });
  }

  /** Chooses the next event in time, or the one before. */
  next(way) {
    const order = [...this.events].sort((a, b) => a.at - b.at || a.id - b.id);
    if (order.length === 0) return;
    const now = order.findIndex(({ id }) => id === this.chosen);
    const from = order.findIndex(({ at }) => at >= this.clock.time - 1e-6);
    const start = from < 0 ? order.length - 1 : from;
    const to = now < 0 ? (way > 0 ? start : start - 1) : now + way;
    this.choose(order[(to + order.length) % order.length].id);
  }

  /** Moves the chosen event, or its end, by steps of the grid. */
  move(steps, end = null) {
    const { event, score } = this;
    if (!event || this.isBefore) return;
    const most = score.end(kindOf(event));
    const next = end ? stretched(event, end, steps * GRID, most) : moved(event, steps * GRID, most);
    if (next.at !== event.at || next.to !== event.to) this.edit(next);
    this.choose(event.id);
  }

  add(kind, at = this.clock.time) {
    this.compare(false);
    const { id, events } = added(this.events, kind, at, this.score);
    this.commit(events);
    this.choose(id, false);
    this.fields.focus();
  }

  delete() {
    if (!this.event || this.isBefore) return;
    const hadFocus = document.activeElement === this.buttons.get(this.chosen);
    const id = this.chosen;
    this.chosen = null;
    this.commit(without(this.events, id));
    if (hadFocus) document.querySelector("#view").focus();
  }

  undo(way = -1) {
    this.compare(false);
    this.at = clamp(this.at + way, 0, this.history.length - 1);
    this.show();
    this.changed();
  }

  /** Plays the stretch around the chosen event. */
  hear() {
    const { event } = this;
    if (event) this.play(Math.max(0, event.at - AROUND), (event.to ?? event.at + MOMENT) + AROUND);
  }

  /** Shows the score before all edits, or now. */
  compare(isBefore) {
    if (isBefore === this.isBefore) return;
    this.isBefore = isBefore;
    this.compared(isBefore);
    this.show();
  }

  keep() {
    this.saved = this.at;
    this.show();
  }

  /** Shows the events, the buttons and the fields as they are. */
  show() {
    const { event } = this;
    const set = (id, isOff) => (document.querySelector(id).disabled = isOff);
    set("#undo", this.at === 0);
    set("#redo", this.at === this.history.length - 1);
    set("#delete", !event || this.isBefore);
    set("#hear", !event);
    set("#before", this.at === 0);
    document.querySelector("#before").setAttribute("aria-pressed", String(this.isBefore));
    document.querySelector("#save").dataset.edited = String(this.isEdited);
    this.fields.show(event, this.isBefore);
    this.timeline.draw();
  }

  /** Puts the events onto their lanes. */
  layOut(lanes) {
    const { timeline, element, events } = this;
    element.style.left = `${timeline.gutter}px`;
    element.style.height = timeline.canvas.style.height;
    const places = new Map();
    for (const lane of lanes.filter(({ kind }) => kind === "score")) {
      const own = events.filter((event) => lane.kinds.includes(kindOf(event))).sort((a, b) => a.at - b.at);
      own.forEach((event, i) => {
        const next = own[i + 1]?.at ?? this.score.seconds;
        // A gesture ends by itself; the others are in force until the next one.
        places.set(event, { lane, until: kindOf(event) === "gesture" ? Math.min(next, event.at + MOMENT) : next });
      });
    }
    const left = lanes.find(({ kinds }) => kinds?.[0] === "left");
    for (const event of events) {
      const { lane, until } = places.get(event);
      const kind = kindOf(event);
      const button = this.buttons.get(event.id) ?? this.button(event.id);
      const [from, to] = [event.at, event.to ?? until].map((time) => timeline.x(time) - timeline.gutter);
      const top = (kind === "both" ? left : lane).top;
      Object.assign(button.style, { left: `${from}px`, width: `${Math.max(to - from - 1, 5)}px`, top: `${top + 1}px`, height: `${lane.top + lane.height - top - 3}px` });
      button.style.setProperty("--strength", String(event.strength ?? 1));
      button.dataset.kind = isHand(kind) ? event[kind] : kind;
      button.dataset.open = String(event.to === undefined);
      button.firstChild.textContent = label(event);
      button.title = button.ariaLabel = saying(event);
      button.setAttribute("aria-pressed", String(event.id === this.chosen));
      button.tabIndex = event.id === this.chosen || (!this.event && event === events[0]) ? 0 : -1;
    }
    const ids = new Set(events.map(({ id }) => id));
    for (const [id, button] of this.buttons) {
      if (ids.has(id)) continue;
      button.remove();
      this.buttons.delete(id);
    }
    element.dataset.before = String(this.isBefore);
  }

  button(id) {
    const button = document.createElement("button");
    button.className = "event";
    button.dataset.id = String(id);
    button.append(document.createElement("span"));
    this.buttons.set(id, button);
    this.element.append(button);
    return button;
  }

  /** The part of an event that a press takes: `at` or `to` at its ends, or `all`. */
  part(event, button, x) {
    if (event.to === undefined) return "all";
    const { left, width } = button.getBoundingClientRect();
    const edge = Math.min(EDGE, width / 4);
    return x - left < edge ? "at" : left + width - x < edge ? "to" : "all";
  }

  listen() {
    const { element } = this;
    const eventOf = (target) => this.events.find(({ id }) => String(id) === target.closest(".event")?.dataset.id);
    element.addEventListener("pointerdown", (press) => {
      const event = eventOf(press.target);
      if (!event || press.button !== 0) return;
      press.preventDefault();
      const part = this.part(event, press.target.closest(".event"), press.clientX);
      this.choose(event.id);
      if (this.isBefore) return;
      element.setPointerCapture(press.pointerId);
      this.dragged = { event, part, x: press.clientX, events: null };
    });
    element.addEventListener("pointermove", (point) => {
      if (this.dragged) return this.drag(point.clientX);
      const event = eventOf(point.target);
      if (event) element.style.cursor = this.isBefore || this.part(event, point.target.closest(".event"), point.clientX) === "all" ? "grab" : "ew-resize";
    });
    element.addEventListener("pointerup", () => {
      const events = this.dragged?.events;
      this.dragged = null;
      if (events) this.commit(events);
    });
    element.addEventListener("pointercancel", () => {
      this.dragged = null;
      this.show();
    });
    element.addEventListener("click", (press) => {
      // Of the keyboard and of assistive technology.
      const event = press.detail === 0 && eventOf(press.target);
      if (event) this.choose(event.id);
    });
    element.addEventListener("dblclick", () => this.fields.focus());
    element.addEventListener("keydown", (press) => {
      const action = this.key(press);
      if (!action) return;
      press.preventDefault();
      press.stopPropagation();
      action();
    });
    element.addEventListener("focusin", ({ target }) => {
      const event = eventOf(target);
      if (event && event.id !== this.chosen) this.choose(event.id, false);
    });
    this.timeline.canvas.addEventListener("dblclick", (press) => {
      const { left, top } = this.timeline.canvas.getBoundingClientRect();
      const lane = this.timeline.laneAt(press.clientY - top);
      if (lane?.kind === "score") this.add(lane.kinds[0], this.timeline.seconds(press.clientX - left));
    });
  }

  /** The action of a key on an event. */
  key({ key, shiftKey, ctrlKey, metaKey, altKey }) {
    if (ctrlKey || metaKey || altKey) return null;
    const keys = {
      ArrowLeft: () => this.move(-1, shiftKey ? "to" : null),
      ArrowRight: () => this.move(1, shiftKey ? "to" : null),
      Enter: () => this.hear(),
      " ": this.toggle,
      Escape: () => {
        this.choose(null);
        document.querySelector("#view").focus();
      },
    };
    return keys[key] ?? null;
  }

  drag(x) {
    const { event, part, x: from } = this.dragged;
    const { timeline, score } = this;
    if (!this.dragged.events && Math.abs(x - from) < STILL) return;
    const by = timeline.seconds(x) - timeline.seconds(from);
    const most = score.end(kindOf(event));
    const next = part === "all" ? moved(event, by, most) : stretched(event, part, by, most);
    const isSame = next.at === event.at && next.to === event.to;
    this.dragged.events = isSame ? null : put(this.history[this.at], next);
    this.fields.show(this.event, false);
    timeline.draw();
  }
}
