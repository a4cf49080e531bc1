// The log drawer: every change with its author, reason and time, newest first.

import { element } from "./pane.js";

const MOST = 300;
const WORDS = { do: "", undo: "took back", redo: "made again" };

function words({ kind, version, item }, before) {
  if (WORDS[kind]) return WORDS[kind];
  if (!item) return "deleted";
  if (version === 1) return item.state === "missing" ? "expects" : "made";
  if (!before) return "changed";
  const changes = [];
  if (before.name !== item.name) changes.push(`renamed from “${before.name}”`);
  if (before.state !== item.state) changes.push(item.state === "defined" ? "placed" : item.state);
  else if (JSON.stringify(before.geometry) !== JSON.stringify(item.geometry)) changes.push("moved");
  if (before.locked !== item.locked) changes.push(item.locked ? "locked" : "unlocked");
  if (before.visible !== item.visible) changes.push(item.visible ? "shown" : "hidden");
  if (JSON.stringify(before.rgb) !== JSON.stringify(item.rgb)) changes.push("recoloured");
  return changes.join(", ") || "changed";
}

export class Log {
  constructor(host, button, model, { annotations, fail }) {
    Object.assign(this, { host, button, model, annotations, fail });
    model.on("items", () => host.hidden || this.#draw());
  }

  toggle() {
    this.host.hidden = !this.host.hidden;
    this.button.setAttribute("aria-expanded", String(!this.host.hidden));
    if (!this.host.hidden) this.#draw();
  }

  async #draw() {
    try {
      const after = Math.max(0, this.model.seq - MOST);
      const events = await this.annotations().log(MOST, after);
      const before = new Map();
      const rows = events.map((event) => {
        const known = before.get(event.id);
        before.set(event.id, event.item ?? known);
        return this.#row(event, known);
      });
      const close = element("button", { type: "button", className: "mini", ariaLabel: "Close the log", onclick: () => this.toggle() }, "×");
      this.host.replaceChildren(
        element("header", { className: "side-head" }, element("h2", {}, "Log"), element("span", { className: "count" }, `${this.model.seq} changes`), close),
        element("ol", {}, ...rows.reverse()),
      );
    } catch (error) {
      this.fail(error);
    }
  }

  #row(event, known) {
    const name = event.item?.name ?? known?.name ?? "an item";
    const time = new Date(event.time);
    const at = element("time", { dateTime: event.time, title: time.toLocaleString() }, time.toLocaleTimeString());
    const row = element("li", {}, element("b", {}, event.author), ` ${words(event, known)} `, element("i", {}, name), at);
    if (event.reason) row.append(element("small", {}, event.reason));
    row.dataset.seq = event.seq;
    row.dataset.kind = event.kind;
    return row;
  }
}
