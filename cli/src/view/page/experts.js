// The panel of experts: routing of the current chunk's tokens by kind.

import { expertColor } from "umo/lanes.js";

export class Experts {
  constructor(element, record, changed) {
    this.record = record;
    this.element = element;
    this.body = element.querySelector("tbody");
    this.caption = element.querySelector("caption");
    const choice = element.querySelector("select");
    const { layers } = record;
    layers.forEach(({ name }, i) => choice.add(new Option(name, String(i))));
    [this.layer] = layers;
    choice.addEventListener("change", () => {
      this.layer = layers[Number(choice.value)];
      this.shown = -1;
      changed(this.layer);
    });
    this.shown = -1;
  }

  /** Shows the chunk that produced a frame. */
  show(frame) {
    const { record } = this;
    const chunk = record.chunkOf(frame);
    if (!record.data || chunk < 0 || chunk === this.shown) return;
    this.shown = chunk;
    this.caption.textContent = `Chunk ${chunk + 1} of ${record.chunks.length}`;
    const style = getComputedStyle(this.element);
    const rows = record.data.kinds.map((name, kind) => {
      const counts = record.routed(chunk, kind, this.layer);
      const sum = counts.reduce((a, b) => a + b, 0);
      return row(name, counts, sum, (word) => style.getPropertyValue(word));
    });
    this.body.replaceChildren(...rows);
  }
}

function row(name, counts, sum, color) {
  const line = document.createElement("tr");
  const head = document.createElement("th");
  head.scope = "row";
  head.textContent = name;
  const cell = document.createElement("td");
  const bar = document.createElement("div");
  bar.className = "shares";
  counts.forEach((count, expert) => {
    const share = sum === 0 ? 0 : (100 * count) / sum;
    const part = document.createElement("span");
    part.style.width = `${share}%`;
    part.style.background = expertColor(color, expert);
    part.title = `expert ${expert + 1}: ${count} of ${sum}`;
    if (share >= 14) part.textContent = `${Math.round(share)} %`;
    bar.append(part);
  });
  const shares = counts.map((count, expert) => `expert ${expert + 1}: ${count}`).join(", ");
  bar.setAttribute("role", "img");
  bar.setAttribute("aria-label", `${name}: ${shares}`);
  cell.append(bar);
  line.append(head, cell);
  return line;
}
