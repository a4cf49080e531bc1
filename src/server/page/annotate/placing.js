// Placing by hand: a press previews a point, its release places it. When the tool has enough points,
// they become an item.

import { distance, measures, planeOf } from "./geometry.js";
import { newId } from "./api.js";

/** The tools: least and greatest number of points, and the prefix of names. */
export const SHAPES = {
  point: { least: 1, most: 1, name: "Point" },
  line: { least: 2, most: 2, name: "Line" },
  angle: { least: 3, most: 3, name: "Angle" },
  curve: { least: 2, most: Infinity, name: "Curve" },
  contour: { least: 3, most: Infinity, name: "Contour" },
  plane: { least: 3, most: 3, name: "Plane" },
};

/** A click this close to the first point of a contour closes it, CSS pixels. */
const CLOSE_PIXELS = 10;
/** Points closer than this are one point: the second click of a double click. */
const SAME_MM = 0.3;

/** The geometry of the points placed so far: the finished one of the tool, or an intermediate one. */
function shapeOf(tool, points) {
  const [first, second, third] = points;
  const closed = tool === "contour" && points.length > 2;
  if (points.length === 1) return { kind: "point", at_mm: first };
  if (tool === "curve" || tool === "contour") return { kind: "curve", points_mm: points, closed, smooth: points.length > 2 };
  if (points.length === 2) return { kind: "line", ends_mm: [first, second] };
  if (tool === "plane") return planeOf(points) ?? { kind: "angle", points_mm: points };
  return { kind: "angle", points_mm: [first, second, third] };
}

export class Placing {
  #spots = [];
  #hover = null;
  #asked = 0;
  #busy = false;
  #latest = null;
  #queue = Promise.resolve();

  /** `spot` finds a position and snaps it; `commit` sends changes; `say` displays messages. */
  constructor(model, { spot, commit, say }) {
    Object.assign(this, { model, spot, commit, say });
  }

  get points() {
    return this.#spots.map(({ mm }) => mm);
  }

  get isBegun() {
    return this.#spots.length > 0 || this.#hover !== null;
  }

  /** The draft to draw. */
  get draft() {
    const spots = this.#hover ? [...this.#spots, this.#hover] : this.#spots;
    if (!spots.length) return null;
    const geometry = shapeOf(this.model.tool, spots.map(({ mm }) => mm));
    const last = spots.at(-1);
    const shift = last.snapped ? { from: last.from, to: last.mm } : {};
    return { item: { name: "", geometry, locked: false }, measures: measures(geometry), handle: spots.length - 1, ...shift };
  }

  /** Previews a position; of those that arrive during a request, only the last is requested next. */
  async preview(pane, at, event) {
    this.#latest = { pane, at, event };
    if (this.#busy) return;
    this.#busy = true;
    while (this.#latest) {
      const latest = this.#latest;
      this.#latest = null;
      const number = (this.#asked += 1);
      const found = await this.spot(latest.pane, latest.at, latest.event).catch(() => null);
      if (number === this.#asked) this.#show(found);
    }
    this.#busy = false;
  }

  #show(spot) {
    this.#hover = spot;
    if (spot?.snapped) this.say(`Snapped by ${distance(spot.from, spot.mm).toFixed(2)} mm`, { brief: true });
    this.model.changed("draft");
  }

  /** Places a point where the pointer was released. */
  release(pane, at, event) {
    this.#latest = null;
    this.#asked += 1;
    const { tool } = this.model;
    this.#queue = this.#queue.then(async () => {
      if (this.#closes(pane, at)) return this.#finish();
      const spot = await this.spot(pane, at, event);
      if (this.model.tool !== tool) return;
      this.#hover = null;
      if (!spot) this.say("Nothing is shown there: a point needs something to lie on. Slices have a place everywhere.");
      else await this.#add(spot);
      this.model.changed("draft");
    });
    return this.#queue;
  }

  /** Places a point at the cursor. */
  set(spot) {
    this.#queue = this.#queue.then(() => this.#add(spot));
    return this.#queue;
  }

  #closes(pane, at) {
    if (this.model.tool !== "contour" || this.#spots.length < 3) return false;
    const first = pane.projection?.project(this.#spots[0].mm);
    if (!first || Math.abs(first.off ?? 0) > 3) return false;
    return Math.hypot(...pane.size.map((side, i) => side * (at[i] - first.at[i]))) < CLOSE_PIXELS;
  }

  async #add(spot) {
    const last = this.#spots.at(-1);
    if (last && distance(last.mm, spot.mm) < SAME_MM) return;
    this.#spots.push(spot);
    this.model.changed("draft");
    if (this.#spots.length >= SHAPES[this.model.tool].most) await this.#finish();
  }

  /** Ends a curve with its present points. */
  finish() {
    this.#queue = this.#queue.then(() => this.#finish());
    return this.#queue;
  }

  async #finish() {
    const { least, name } = SHAPES[this.model.tool];
    const spots = this.#spots;
    if (!spots.length) return;
    if (spots.length < least) return this.say(`${name}: ${least - spots.length} more point${least - spots.length > 1 ? "s" : ""}, or Escape.`);
    const geometry = shapeOf(this.model.tool, spots.map(({ mm }) => mm));
    const last = spots.at(-1);
    this.cancel();
    if (this.model.tool === "plane" && geometry.kind !== "plane") return this.say("Those three points lie on a line, which is no plane. Set them again, apart from each other.");
    await this.commit(this.#change(geometry, last, name), last);
  }

  /** Saves the points as the expected landmark of a template, or as a new item. */
  #change(geometry, { placement }, name) {
    const expected = this.model.expected?.(geometry.kind) ?? null;
    if (expected) {
      const item = { ...expected.item, state: "defined", geometry, placement };
      return { change: "update", item, version: expected.version };
    }
    const item = {
      id: newId(), set: this.model.set, name: this.model.freeName(name), state: "defined", geometry, locked: false, visible: true, placement,
    };
    return { change: "create", item };
  }

  /** Removes the last point; returns false if there is none. */
  takeBack() {
    if (!this.#spots.pop()) return false;
    this.model.changed("draft");
    return true;
  }

  cancel() {
    const begun = this.isBegun;
    this.#spots = [];
    this.#hover = null;
    this.#latest = null;
    this.#asked += 1;
    this.model.changed("draft");
    return begun;
  }
}
