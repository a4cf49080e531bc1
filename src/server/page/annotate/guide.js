// Guided placement: the landmarks of a template one after another, until all are placed or skipped.

import { askTemplate } from "./dialogs.js";
import { element } from "./pane.js";
import { icon } from "./list.js";

/** The tool for each kind in a template; regions are grown, and meshes are made from them. */
const TOOL_OF = { point: "point", line: "line", angle: "angle", curve: "curve", plane: "plane", region: "grow", mesh: "grow" };

const STATES = { defined: "placed", missing: "expected", skipped: "skipped" };

export class Guide {
  /** The id of the next item to place. */
  #current = null;
  /** The kinds of the template's items, by name. */
  #kinds = new Map();

  constructor(host, model, { annotations, change, took, say, fail }) {
    Object.assign(this, { host, model, annotations, change, took, say, fail });
    /** The template entry for the next item of a kind; null if the item is new. */
    model.expected = (kind) => {
      const expected = this.expected();
      return expected && this.kindOf(expected) === kind ? expected : null;
    };
    model.on("items guide", () => this.draw());
    this.input = element("input", { type: "file", accept: ".json,application/json", hidden: true, ariaLabel: "A template" });
    this.input.addEventListener("change", () => this.#bring(this.input.files[0]));
    host.after(this.input);
  }

  get entries() {
    return this.model.guided();
  }

  /** The entry of the next point; null if all are decided and none is selected. */
  expected() {
    const { entries } = this;
    const current = entries.find(({ item }) => item.id === this.#current);
    if (current) return current;
    const next = entries.find(({ item }) => item.state === "missing") ?? null;
    this.#current = next?.item.id ?? null;
    return next;
  }

  // ---------------------------------------------------------------- choosing a template

  async open() {
    try {
      const names = await this.annotations().templates().catch(() => this.model.templates);
      const choice = await askTemplate(names ?? [], this.#running());
      if (choice?.file) return this.input.click();
      if (choice?.name) await this.begin(choice.name);
      if (choice?.list) await this.goOn(...choice.list.split("\n"));
    } catch (error) {
      this.fail(error);
    }
  }

  /** Lists with missing or skipped landmarks. */
  #running() {
    return this.model.groups().flatMap(({ set, list, entries }) => {
      const total = entries.length;
      const done = entries.filter(({ item }) => item.state !== "missing").length;
      return entries.some(({ item }) => item.state !== "defined") ? [{ set, list, done, total }] : [];
    });
  }

  async #bring(file) {
    this.input.value = "";
    if (!file) return;
    try {
      const template = JSON.parse(await file.text());
      const name = String(template.name ?? file.name.replace(/\.json$/, "")).replace(/[^A-Za-z0-9._-]+/g, "-");
      await this.annotations().putTemplate(name, template);
      await this.begin(name);
    } catch (error) {
      this.fail(error instanceof SyntaxError ? new Error(`${file.name} is not JSON: ${error.message}`) : error);
    }
  }

  async begin(name) {
    const { set } = this.model;
    const { events } = await this.annotations().applyTemplate(name, set);
    await this.took(events);
    const made = events.find(({ item }) => item)?.item;
    const already = this.#running().find((group) => group.set === set && group.list === name);
    await this.goOn(set, made?.list ?? already?.list ?? name);
  }

  async goOn(set, list) {
    // A list from a file has no template: its items are points.
    const template = await this.annotations().template(list).catch(() => null);
    this.#kinds = new Map((template?.items ?? []).map(({ name, kind }) => [name, kind]));
    this.model.guide = [set, list];
    this.#current = null;
    this.model.chooseSet(set);
    this.#takeUp();
  }

  /** The tool for the current entry. */
  #takeUp() {
    const expected = this.expected();
    if (expected) this.model.chooseTool(TOOL_OF[this.kindOf(expected)] ?? "point");
    this.model.changed("guide");
  }

  kindOf({ item }) {
    return item.geometry?.kind ?? this.#kinds.get(item.name) ?? "point";
  }

  end() {
    this.model.guide = null;
    this.#current = null;
    this.model.changed("guide");
  }

  // ---------------------------------------------------------------- progress

  /** After an entry was placed or skipped: selects the next missing one, wrapping around. */
  advance() {
    const { entries } = this;
    const at = entries.findIndex(({ item }) => item.id === this.#current);
    const order = [...entries.slice(at + 1), ...entries.slice(0, Math.max(0, at + 1))];
    this.#current = order.find(({ item }) => item.state === "missing")?.item.id ?? null;
    if (!this.#current && entries.length) this.say(`All of “${this.model.guide[1]}” is decided.`);
    this.#takeUp();
  }

  /** Makes this entry the next one. */
  choose(id) {
    this.#current = id;
    this.model.jumpTo(id);
    this.#takeUp();
  }

  async skip() {
    const entry = this.expected();
    if (!entry) return;
    if (entry.item.state === "missing") await this.change(entry, { state: "skipped" }, "skipped");
    this.advance();
  }

  /** Returns to the previous entry, placed or not. */
  back() {
    const { entries } = this;
    const at = entries.findIndex(({ item }) => item.id === this.#current);
    const before = entries[(at < 0 ? entries.length : at) - 1];
    if (before) this.choose(before.item.id);
  }

  // ---------------------------------------------------------------- drawing

  draw() {
    const { entries, host } = this;
    host.hidden = !this.model.guide;
    if (host.hidden) return;
    const expected = this.expected();
    const count = (state) => entries.filter(({ item }) => item.state === state).length;
    const [placed, skipped, total] = [count("defined"), count("skipped"), entries.length];
    Object.assign(host.dataset, { placed, skipped, total, expected: expected?.item.name ?? "" });
    const bar = element("div", { className: "progress" }, ...entries.map(({ item }) =>
      element("i", { className: `${item.state}${item.id === expected?.item.id ? " now" : ""}`, title: item.name })));
    bar.setAttribute("role", "progressbar");
    for (const [key, value] of Object.entries({ valuemin: 0, valuemax: total, valuenow: placed + skipped, label: "Landmarks decided" })) bar.setAttribute(`aria-${key}`, value);
    const words = [`${placed} of ${total} placed`, ...(skipped ? [`${skipped} skipped`] : [])].join(", ");
    const close = element("button", {
      type: "button", className: "mini", ariaLabel: "End the template", title: "End the template; it can be gone on with", onclick: () => this.end(),
    }, "×");
    const button = (text, press, more = {}) => element("button", { type: "button", onclick: press, ...more }, text);
    const now = expected
      ? [
          element("p", { className: "expected" }, element("small", {}, expected.item.state === "missing" ? "Place now" : `Place again (${STATES[expected.item.state]})`), element("b", {}, expected.item.name)),
          ...(expected.item.description ? [element("p", { className: "hint" }, expected.item.description)] : []),
        ]
      : [element("p", { className: "expected done" }, element("b", {}, "All decided"))];
    const ring = element("ol", {}, ...entries.map(({ item }) => this.#row(item, expected)));
    host.replaceChildren(
      element("header", { className: "side-head" }, element("h2", {}, this.model.guide[1] || this.model.guide[0]), element("span", { className: "count" }, words), close),
      bar, ...now,
      element("div", { className: "guide-buttons" },
        button("Back", () => this.back()),
        button("Skip", () => this.skip().catch(this.fail), { disabled: !expected || expected.item.state === "defined", title: "Go on without it (S); it can be come back to" })),
      element("details", { open: this.isOpen ?? false, ontoggle: ({ target }) => (this.isOpen = target.open) }, element("summary", {}, "All landmarks"), ring),
    );
  }

  #row(item, expected) {
    const now = item.id === expected?.item.id;
    const button = element("button", { type: "button", className: `${item.state}${now ? " now" : ""}`, onclick: () => this.choose(item.id) },
      icon(item.state === "defined" ? "point" : "missing"), item.name, element("small", {}, STATES[item.state]));
    if (now) button.setAttribute("aria-current", "step");
    return element("li", {}, button);
  }
}
