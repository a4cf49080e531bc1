// Editing by grabbing: a point of an item follows the pointer, and is saved on release.

import { add, clamp, distance, dot, lerp, measures, partsOf, pointsOf, scale, sub, withInserted, withPoint } from "./geometry.js";
import { SliceProjection } from "./projections.js";

/** Greatest distance between pointer and point, CSS pixels. */
const REACH = { mouse: 12, pen: 14, touch: 24 };
/** Greatest distance from a slice's plane at which a point can be grabbed in it, mm. */
const OFF_MM = 6;
/** A point this close to the visible surface stays on the surface, mm. */
const ON_SURFACE_MM = 5;

/** The curve with a new point at the pressed position. */
function added({ entry, index, point }) {
  const { item } = entry;
  return { ...entry, item: { ...item, geometry: withInserted(item.geometry, index, point) } };
}

export class Grab {
  #held = null;
  #busy = false;
  #latest = null;

  constructor(model, { spot, snapped, commit, say }) {
    Object.assign(this, { model, spot, snapped, commit, say });
  }

  /** The item while it is moved. */
  get moved() {
    return this.#held?.moved ?? null;
  }

  /** The handle at a position in a pane's picture: `{ entry, index, point }`. */
  find(pane, at, pointer) {
    if (!pane.projection) return null;
    let best = null;
    for (const entry of this.model.shown()) {
      pointsOf(entry.item.geometry).forEach((point, index) => {
        const seen = pane.projection.project(point);
        if (!seen || Math.abs(seen.off ?? 0) > OFF_MM) return;
        const pixels = Math.hypot(...pane.size.map((side, i) => side * (seen.at[i] - at[i])));
        // Where handles overlap, the selected one wins, then the nearest.
        const rank = pixels + (entry.item.id === this.model.selected ? -4 : 0) + Math.abs(seen.off ?? 0);
        if (pixels <= (REACH[pointer] ?? REACH.mouse) && (!best || rank < best.rank)) best = { entry, index, point, rank };
      });
    }
    return best;
  }

  /** The point to add to the selected curve at a position in a pane's picture: `{ entry, index, point, adds }`. */
  between(pane, at, pointer) {
    const entry = this.model.entry(this.model.selected);
    if (!pane.projection || entry?.item.geometry?.kind !== "curve" || entry.item.locked || !entry.item.visible) return null;
    const reach = 0.7 * (REACH[pointer] ?? REACH.mouse);
    const pixels = (seen) => seen.at.map((value, i) => value * pane.size[i]);
    const place = at.map((value, i) => value * pane.size[i]);
    let best = null;
    for (const { from, to, index } of partsOf(entry.item.geometry)) {
      const ends = [from, to].map((point) => pane.projection.project(point));
      if (ends.some((seen) => !seen || Math.abs(seen.off ?? 0) > OFF_MM)) continue;
      const [a, b] = ends.map(pixels);
      const along = sub(b, a);
      const share = clamp(dot(sub(place, a), along) / (dot(along, along) || 1), 0, 1);
      const off = distance(place, lerp(a, b, share));
      if (off <= reach && (!best || off < best.off)) best = { entry, index, point: lerp(from, to, share), off, adds: true };
    }
    return best;
  }

  down(pane, at, event) {
    const found = this.find(pane, at, event.pointerType) ?? this.between(pane, at, event.pointerType);
    if (!found) return false;
    const { index, point, adds = false } = found;
    const entry = adds ? added(found) : found.entry;
    this.model.select(entry.item.id, index);
    if (entry.item.locked) {
      this.say(`“${entry.item.name}” is locked. Unlock it in the list, or press K, to move it.`);
      return true;
    }
    const seen = pane.projection.project(point);
    // Keep the offset between the pointer and the middle of the point.
    const slip = at.map((value, i) => value - seen.at[i]);
    const onSurface = !(pane.projection instanceof SliceProjection) && this.#liesOnSurface(pane.projection, seen);
    this.#held = { entry, index, point, seen, slip, onSurface, adds, moved: null, started: at };
    if (adds) this.#show(this.#held, { mm: point });
    return true;
  }

  #liesOnSurface(projection, { at, depth }) {
    const surface = projection.depths?.at(at);
    return surface !== undefined && Math.abs(surface - depth) < ON_SURFACE_MM + projection.depths.tolerance;
  }

  async move(pane, at, event) {
    if (!this.#held) return;
    this.#latest = { pane, at, event };
    if (this.#busy) return;
    this.#busy = true;
    while (this.#latest && this.#held) {
      const { pane: where, at: place, event: last } = this.#latest;
      this.#latest = null;
      const held = this.#held;
      const spot = await this.#target(held, where, place, last).catch(() => null);
      if (spot && held === this.#held) this.#show(held, spot);
    }
    this.#busy = false;
  }

  #show(held, spot) {
    const item = { ...held.entry.item, geometry: withPoint(held.entry.item.geometry, held.index, spot.mm) };
    held.moved = { id: item.id, item, measures: measures(item.geometry), spot };
    this.model.changed("draft");
  }

  /** The new position of the point: in its slice, on its surface, or perpendicular to the line of sight. */
  async #target({ point, seen, slip, onSurface }, pane, at, event) {
    const aim = at.map((value, i) => value - slip[i]);
    const { projection } = pane;
    if (projection instanceof SliceProjection) {
      const flat = projection.unproject(aim);
      const off = dot(sub(point, projection.center), projection.normal);
      return this.snapped({ mm: add(flat, scale(projection.normal, off)), method: "slice", camera: projection.record() }, event);
    }
    if (onSurface && !event.shiftKey) {
      const spot = await this.spot(pane, aim, event);
      if (spot) return spot;
    }
    const mm = projection.unproject(aim, seen.depth);
    return this.snapped({ mm, ray: projection.rayTo(mm), method: "pick", camera: projection.record() }, event);
  }

  async up(pane, at, event) {
    const held = this.#held;
    if (!held) return;
    this.#latest = null;
    const still = Math.hypot(...pane.size.map((side, i) => side * (at[i] - held.started[i]))) < 3;
    // An added point may stay at the pressed position. An existing one is saved only if it moved.
    const there = held.adds ? { mm: held.point } : null;
    const spot = still ? there : await this.#target(held, pane, at, event).catch(() => there);
    if (!spot || (!held.adds && distance(spot.mm, held.point) < 1e-6)) return this.cancel();
    if (this.#held !== held) return;
    this.#show(held, spot);
    const item = { ...held.moved.item, ...(spot.placement ? { placement: spot.placement } : {}) };
    await this.commit({ change: "update", item, version: held.entry.version }, spot, held.adds ? "point added" : "moved");
    this.cancel();
  }

  cancel() {
    const held = this.#held !== null;
    this.#held = null;
    this.#latest = null;
    if (held) this.model.changed("draft");
    return held;
  }
}
