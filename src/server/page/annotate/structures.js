// Structures: a region grown from a seed, painted with a sphere, or filled between contours; a mesh
// of a region.

import { colorOf } from "./model.js";
import { Contents, previewed } from "./contents.js";
import { drawIn3d, drawInSlice } from "./surfaces.js";

const $ = (id) => document.getElementById(id);
/** The colour of a previewed region, and of its seed. */
const PREVIEW_COLOR = "#ff8a75";
/** Pause after typing before a preview is requested, ms. */
const PAUSE_MS = 200;

const number = (id) => ($(id).value === "" ? null : Number($(id).value));

export class Structures {
  #pressed = null;
  #stroke = null;
  /** Aborts the requested preview. */
  #asking = null;
  /** The previewed region. */
  #extent = null;
  #timer = 0;

  /** `job` displays long tasks. */
  constructor(model, { annotations, spot, commit, took, say, fail, redraw, job }) {
    Object.assign(this, { model, annotations, spot, commit, took, say, fail, redraw, job, advance: () => {} });
    for (const button of document.querySelectorAll("[data-refine]")) button.addEventListener("click", () => this.refine(button.dataset.refine));
    this.contents = new Contents(annotations, redraw, fail);
    this.seed = null;
    $("grow-now").addEventListener("click", () => this.grow());
    $("grow-forget").addEventListener("click", () => this.cancel());
    for (const id of ["grow-low", "grow-high", "grow-ml", "grow-radius"]) {
      $(id).addEventListener("input", () => {
        clearTimeout(this.#timer);
        this.#timer = setTimeout(() => this.seed && this.preview(), PAUSE_MS);
      });
    }
  }

  takes(tool) {
    return tool === "grow" || tool === "paint";
  }

  /** The draft to draw: the seed, or the sphere of the brush. */
  get draft() {
    const { tool } = this.model;
    if (tool === "grow" && (this.#pressed ?? this.seed)) return marked("seed", (this.#pressed ?? this.seed).mm);
    if (tool === "paint" && this.#pressed) return marked("", this.#pressed.mm);
    return null;
  }

  // ---------------------------------------------------------------- gestures

  async down(pane, at, event) {
    return this.move(pane, at, event);
  }

  async move(pane, at, event) {
    const found = await this.spot(pane, at, event).catch(() => null);
    this.#pressed = found;
    this.model.changed("draft");
  }

  hover(pane, at) {
    if (this.model.tool !== "paint") return;
    this.ring(pane, at);
  }

  async up(pane, at, event) {
    const found = await this.spot(pane, at, event);
    this.#pressed = null;
    if (!found) return this.say("Nothing is shown there: a seed needs a place. Slices have one everywhere.");
    return this.at(found);
  }

  /** Starts at a known position. */
  at(found) {
    if (this.model.tool === "paint") return this.paint(found.mm);
    this.seed = found;
    this.model.moveCursor(found.mm, found.hu ?? null);
    $("grow-state").textContent = "Looking …";
    this.model.changed("draft");
    return this.preview();
  }

  cancel() {
    const begun = this.seed !== null || this.#pressed !== null;
    this.seed = null;
    this.#pressed = null;
    this.#asking?.abort();
    this.#show(null);
    $("grow-now").disabled = true;
    $("grow-state").textContent = "Press on the structure.";
    if (begun) this.model.changed("draft");
    return begun;
  }

  /** Draws the brush at the pointer. */
  ring(pane, at) {
    const radius = (number("paint-radius") ?? 5) / (pane.projection?.height ?? Infinity);
    const svg = pane.itemLayer;
    svg.querySelector(".brush")?.remove();
    if (!(radius > 0) || !Number.isFinite(radius)) return;
    const ring = document.createElementNS("http://www.w3.org/2000/svg", "circle");
    const [width, height] = pane.size;
    for (const [key, value] of Object.entries({ class: "brush", cx: at[0] * width, cy: at[1] * height, r: radius * height })) ring.setAttribute(key, value);
    svg.append(ring);
  }

  // ---------------------------------------------------------------- regions

  #order() {
    const limits = { max_ml: number("grow-ml"), max_radius_mm: number("grow-radius") };
    const known = Object.fromEntries(Object.entries(limits).filter(([, value]) => value !== null));
    return { seed_mm: this.seed.mm, hu: [number("grow-low") ?? -1024, number("grow-high") ?? 3071], ...known };
  }

  /** Draws the extent of a preview; null draws none. */
  #show(extent) {
    if (extent === this.#extent) return;
    this.#extent = extent;
    this.redraw();
  }

  /** Requests the size and extent of the region before it is made. */
  async preview() {
    const { seed } = this;
    $("grow-now").disabled = true;
    this.#asking?.abort();
    const asking = (this.#asking = new AbortController());
    try {
      const found = await this.annotations().grow({ ...this.#order(), preview: true }, asking.signal);
      const extent = await previewed(found);
      if (seed !== this.seed || asking.signal.aborted) return;
      this.#show(extent);
      const ml = found.volume_ml;
      $("grow-state").textContent = `${ml.toFixed(ml < 10 ? 2 : 1)} ml.`;
      $("grow-now").disabled = false;
    } catch (error) {
      if (seed !== this.seed || asking.signal.aborted) return;
      this.#show(null);
      $("grow-state").textContent = refusalWords(error);
    }
  }

  async grow() {
    if (!this.seed) return;
    $("grow-now").disabled = true;
    $("grow-state").textContent = "Growing …";
    const body = { ...this.#order(), name: this.model.freeName("Region"), set: this.model.set };
    const made = await this.#made(`Growing “${body.name}” …`, (signal) => this.annotations().grow(body, signal), "grow-state");
    if (!made) {
      $("grow-now").disabled = this.seed === null;
      return;
    }
    this.cancel();
    await this.#becomeExpected(made, "region");
  }

  get #region() {
    const chosen = this.model.entry(this.model.selected);
    return chosen?.item.geometry?.kind === "region" ? chosen : null;
  }

  /** Smooths the chosen region, fills its holes, or keeps its largest part. */
  async refine(step) {
    const region = this.#region;
    if (!region) return this.say("Choose a region in the list first.");
    if (region.item.locked) return this.say(`“${region.item.name}” is locked. Unlock it in the list to change it.`);
    const body = { region: region.item.id, version: region.version, step };
    const made = await this.#made(`Refining “${region.item.name}” …`, (signal) => this.annotations().refine(body, signal));
    if (made === undefined) this.say(`“${region.item.name}” stays as it is: the step changes nothing.`, { brief: true });
  }

  async paint(mm) {
    const region = this.#region;
    if (region?.item.locked) return this.say(`“${region.item.name}” is locked. Unlock it in the list to paint on it.`);
    const mode = $("paint-mode").value;
    if (!region && mode === "erase") return this.say("Choose the region to erase from in the list first.");
    const what = region ? { region: region.item.id, version: region.version } : { name: this.model.freeName("Region"), set: this.model.set };
    this.#stroke = (this.#stroke ?? Promise.resolve()).then(() => this.#made("Painting …", (signal) => this.annotations().paint({ center_mm: mm, radius_mm: number("paint-radius") ?? 5, mode, ...what }, signal)));
    await this.#stroke;
  }

  /** Makes a mesh of a region. */
  async mesh(entry) {
    const body = { region: entry.item.id, name: `${entry.item.name} mesh`, set: entry.item.set };
    const made = await this.#made(`Making a mesh of “${entry.item.name}” …`, (signal) => this.annotations().mesh(body, signal));
    if (made) await this.#becomeExpected(made, "mesh");
  }

  /** Moves the new geometry into the entry that the template expects, in one change. */
  async #becomeExpected(made, kind) {
    const expected = this.model.expected?.(kind);
    const entry = this.model.entry(made.id);
    if (!expected || !entry) return;
    const item = { ...expected.item, state: "defined", geometry: entry.item.geometry };
    const events = await this.commit([{ change: "delete", id: made.id, version: entry.version }, { change: "update", item, version: expected.version }], "expected by the template");
    if (events) this.advance();
  }

  /** Fills a region between closed curves. */
  fill(entries) {
    const [first] = entries;
    const body = { curves: entries.map(({ item }) => item.id), name: this.model.freeName("Region"), set: first.item.set };
    return this.#made("Filling between contours …", (signal) => this.annotations().fill(body, signal));
  }

  async #made(words, ask, stateId = null) {
    try {
      const { events } = await this.job.run(words, ask);
      await this.took(events);
      const made = events.at(-1)?.item;
      if (made) this.model.select(made.id);
      const ml = made?.geometry?.volume_ml;
      this.say(ml == null ? "Done." : `“${made.name}”: ${ml.toFixed(2)} ml.`, { brief: true });
      return made;
    } catch (error) {
      if (error.name === "AbortError") {
        if (stateId) $(stateId).textContent = "Broken off.";
        this.say("Broken off: nothing was made.", { brief: true });
      } else if (stateId) $(stateId).textContent = refusalWords(error);
      else this.fail(error);
      return null;
    }
  }

  // ---------------------------------------------------------------- drawing

  #shapes() {
    const preview = this.#extent ? [{ content: this.#extent, color: PREVIEW_COLOR, selected: true }] : [];
    const shapes = this.model.shown().flatMap(({ item }) => {
      if (item.geometry.kind !== "region" && item.geometry.kind !== "mesh") return [];
      const content = this.contents.of(item.geometry);
      return content ? [{ content, color: colorOf(item), selected: item.id === this.model.selected }] : [];
    });
    return [...shapes, ...preview];
  }

  drawSlice(pane) {
    drawInSlice(pane, this.#shapes());
  }

  drawVolume(pane) {
    drawIn3d(pane, this.#shapes());
  }
}

const marked = (name, mm) => ({ item: { name, geometry: { kind: "point", at_mm: mm }, locked: false, rgb: [1, 0.54, 0.46] }, measures: [], handle: 0 });

/** The message of a refusal, as a sentence. */
const refusalWords = ({ message }) => message.charAt(0).toUpperCase() + message.slice(1);
