// Gestures in panes by the chosen tool: navigate, grab, place, grow, paint.
//
// Panes navigate if no tool handles a gesture, so that no item changes by accident.

import { Grab } from "./grab.js";
import { Placing, SHAPES } from "./placing.js";
import { distance, fewestPoints, pointsOf, sub, withPoint, withoutPoint } from "./geometry.js";
import { request } from "/view.js";

/** Pause of the cursor before its value is requested, ms. */
const VALUE_MS = 70;

export class Hand {
  #valueTimer = 0;
  #lastPane = null;
  /** Whether the press is active: after Escape its release has no effect. */
  #pressed = false;

  /** `annotations` returns the interface of the current volume; `commit`, `say`, `fail` are the page's. */
  constructor(model, { annotations, commit, say, fail }) {
    Object.assign(this, { model, annotations, commit, say, fail });
    const parts = {
      spot: (pane, at, event) => this.spot(pane, at, event),
      snapped: (spot, event) => this.snapped(spot, event),
      commit: (change, spot, reason) => this.#made(change, spot, reason),
      say,
    };
    this.placing = new Placing(model, parts);
    this.grab = new Grab(model, parts);
    /** Set by the page: handles growing and painting. */
    this.structures = null;
    model.on("tool", () => this.cancel());
  }

  get draft() {
    return this.structures?.draft ?? this.placing.draft;
  }

  get moved() {
    return this.grab.moved;
  }

  get places() {
    return Object.hasOwn(SHAPES, this.model.tool);
  }

  // ---------------------------------------------------------------- where

  /** A position in a pane's picture with its provenance; null if no surface is visible there. */
  async spot(pane, at, event) {
    const found = await pane.locate(at);
    return found && this.snapped(found, event);
  }

  /** Snaps a position with the chosen method, and records it in the provenance. */
  async snapped(found, event) {
    const device = { kind: event?.pointerType || "keyboard" };
    const spot = { ...found, from: found.mm, placement: { method: found.method, device, camera: found.camera } };
    const { to, radius_mm, hu } = this.model.snap;
    if (to === "off" || event?.ctrlKey) return spot;
    try {
      const level = to === "surface" ? { hu } : {};
      // Along the line of sight if the position was picked in 3D: the intended position lies under
      // the pointer.
      const ray = found.ray ? { ray: found.ray } : {};
      const moved = await this.annotations().snap({ at_mm: found.mm, ...ray, to, radius_mm, ...level });
      const shift = moved.shift_mm ?? sub(moved.at_mm, found.mm);
      return { ...spot, mm: moved.at_mm, hu: moved.hu ?? null, snapped: true, placement: { ...spot.placement, snapped_mm: shift } };
    } catch (error) {
      this.say(`Not snapped: ${error.message}`, { brief: true });
      return spot;
    }
  }

  /** Moves the cursor to a position and requests the value there. */
  look(mm, hu = null) {
    this.model.moveCursor(mm, hu);
    clearTimeout(this.#valueTimer);
    if (hu === null) this.#valueTimer = setTimeout(() => this.#value(), VALUE_MS);
  }

  async #value() {
    const { cursor, volume } = this.model;
    const query = new URLSearchParams({
      mode: "slice", plane: "axial", center_mm: cursor.mm.map((value) => value.toFixed(3)).join(","), height_mm: 1, size_px: "15,15", u: 7, v: 7,
    });
    const found = await request(`/v1/volumes/${volume.id}/pick?${query}`).then((answer) => answer.json(), () => null);
    if (found?.hu == null || this.model.cursor !== cursor) return;
    this.model.cursor = { ...cursor, hu: found.hu };
    this.model.changed("cursor");
  }

  // ---------------------------------------------------------------- gestures

  down(pane, at, event) {
    this.#lastPane = pane;
    this.#pressed = true;
    if (this.model.tool === "edit") return this.grab.down(pane, at, event);
    if (this.structures?.takes(this.model.tool)) return this.structures.down(pane, at, event);
    if (!this.places) return false;
    this.placing.preview(pane, at, event);
    return true;
  }

  move(pane, at, event) {
    if (!this.#pressed) return;
    if (this.model.tool === "edit") return this.grab.move(pane, at, event);
    if (this.structures?.takes(this.model.tool)) return this.structures.move(pane, at, event);
    this.placing.preview(pane, at, event);
  }

  up(pane, at, event) {
    if (!this.#pressed) return;
    this.#pressed = false;
    const done = this.model.tool === "edit"
      ? this.grab.up(pane, at, event)
      : this.structures?.takes(this.model.tool)
        ? this.structures.up(pane, at, event)
        : this.placing.release(pane, at, event);
    Promise.resolve(done).catch((error) => this.fail(error));
  }

  hover(pane, at, event) {
    if (event.pointerType === "touch") return;
    if (this.model.tool === "edit") {
      const found = this.grab.find(pane, at, event.pointerType);
      pane.root.classList.toggle("grabs", Boolean(found && !found.entry.item.locked));
      pane.root.classList.toggle("locked", Boolean(found?.entry.item.locked));
      pane.root.classList.toggle("adds", !found && Boolean(this.grab.between(pane, at, event.pointerType)));
    } else if (this.places && this.placing.points.length) {
      this.placing.preview(pane, at, event);
    } else if (this.structures?.takes(this.model.tool)) {
      this.structures.hover(pane, at, event);
    }
  }

  /** A double click ends a curve; returns false if no curve is being drawn. */
  double() {
    if (this.model.tool === "curve" || this.model.tool === "contour") {
      this.placing.finish().catch((error) => this.fail(error));
      return true;
    }
    return this.model.tool !== "navigate";
  }

  /** Cancels the current action; returns false if there is none. */
  cancel() {
    this.#pressed = false;
    const broken = [this.grab.cancel(), this.placing.cancel(), this.structures?.cancel() ?? false];
    return broken.some(Boolean);
  }

  /** Enter: places a point at the cursor, moves the chosen point there, or ends a curve. */
  async enter(ends) {
    const { tool, cursor } = this.model;
    if (ends && this.placing.points.length) return this.placing.finish();
    const pane = this.#lastPane;
    const camera = pane?.projection?.record();
    const found = { mm: cursor.mm, hu: cursor.hu, method: "slice", ...(camera ? { camera } : {}) };
    if (this.structures?.takes(tool)) return this.structures.at(found);
    const spot = await this.snapped(found, null);
    if (this.places) return this.placing.set(spot);
    if (tool === "edit") return this.#moveChosen(spot);
  }

  async #moveChosen(spot) {
    const entry = this.model.entry(this.model.selected);
    if (!entry?.item.geometry) return this.say("Choose an item in the list first: Enter moves its point to the cursor.");
    if (entry.item.locked) return this.say(`“${entry.item.name}” is locked. Press K to unlock it.`);
    if (!pointsOf(entry.item.geometry).length) return;
    const item = { ...entry.item, geometry: withPoint(entry.item.geometry, this.model.handle, spot.mm), placement: spot.placement };
    await this.#made({ change: "update", item, version: entry.version }, spot);
  }

  /** Removes the chosen point of a curve, if enough points remain; returns false if no point is chosen. */
  removePoint() {
    const { tool, selected, handle } = this.model;
    const entry = this.model.entry(selected);
    if (tool !== "edit" || entry?.item.geometry?.kind !== "curve") return false;
    const { item, version } = entry;
    const geometry = withoutPoint(item.geometry, handle);
    if (item.locked) this.say(`“${item.name}” is locked. Press K to unlock it.`);
    else if (!geometry) this.say(`“${item.name}” needs its ${fewestPoints(item.geometry)} points. Delete removes all of it.`);
    else this.#withoutPoint({ ...item, geometry }, version).catch((error) => this.fail(error));
    return true;
  }

  async #withoutPoint(item, version) {
    if (!(await this.commit([{ change: "update", item, version }], "point removed"))) return;
    this.model.select(item.id, Math.min(this.model.handle, item.geometry.points_mm.length - 1));
    this.say(`A point of “${item.name}” is removed.`, { brief: true });
  }

  async #made(change, spot, reason = change.change === "create" ? "placed" : "moved") {
    const { guide } = this.model;
    const events = await this.commit([change], reason);
    if (!events) return;
    this.look(spot.mm, spot.hu ?? null);
    this.model.select(change.item.id, this.model.selected === change.item.id ? this.model.handle : 0);
    const shift = spot.snapped ? `, snapped by ${distance(spot.from, spot.mm).toFixed(2)} mm` : "";
    const word = guide ? "placed" : reason;
    this.say(`“${change.item.name}”: ${word}${shift}.`, { brief: true });
    this.model.changed("guide");
  }
}
