// The state of the page: items, sets, the cursor, the selection. All other modules listen to it. It
// accesses no element.

import { measures, middleOf } from "./geometry.js";

/** The initial view of the 3D pane. */
export const HOME = Object.freeze({ azimuth: 20, elevation: 10, zoom: 1 });

/** Default colours of kinds of items, display-referred sRGB. */
const COLORS = {
  point: "#ffb86b", line: "#6fd6dc", angle: "#f78fb3", curve: "#9be564", plane: "#b99cff", region: "#ff8a75", mesh: "#ead9b0",
};

const hex = (channel) => Math.round(255 * channel).toString(16).padStart(2, "0");

/** An item's colour: its own, or that of its kind. */
export const colorOf = (item) =>
  item.rgb ? `#${item.rgb.map(hex).join("")}` : COLORS[item.geometry?.kind ?? "point"];

/** Whether an item belongs to the phase of a volume; items and volumes without phases belong everywhere. */
const isInPhase = ({ phase }, volume) => !phase || !volume?.phase || volume.phase.number === phase;

export const rgbOf = (color) => [1, 3, 5].map((at) => Number((parseInt(color.slice(at, at + 2), 16) / 255).toFixed(4)));

const AUTHOR = "relief-author";
const SET = "relief-set";

/** Storage may be forbidden; the page works without it. */
function kept(key, value) {
  try {
    if (value === undefined) return localStorage.getItem(key) ?? "";
    localStorage.setItem(key, value);
  } catch {
    // The preference is not kept.
  }
  return value ?? "";
}

/**
 * Notifies listeners of changes, once per turn of the event loop: `items`, `sets`, `cursor`, `selection`, `tool`, `draft`, `author`, `look`,
 * `window`, `pose`, `guide`.
 */
export class Model {
  #listeners = [];
  #changed = new Set();

  items = new Map();
  sets = [];
  templates = [];
  seq = 0;
  volume = null;
  /** The position where all slices meet, and the value there. */
  cursor = { mm: [0, 0, 0], hu: null };
  selected = null;
  /** Index of the grabbed point of the selected item. */
  handle = 0;
  tool = "navigate";
  snap = { to: "off", radius_mm: 5, hu: 300 };
  /** Window of the slices, HU; follows the anatomy of the volume until the user changes it. */
  window = { center: 40, width: 400, isOwn: false };
  /** Empty for values that are not HU, which no preset suits. */
  preset = "bone";
  hasOwnPreset = false;
  /** The 3D view, angles in degrees. */
  pose = { ...HOME };
  /** The part of the volume that the 3D view shows, and whether it shows the table; see `crop.js`. */
  crop = null;
  planes = [];
  table = "remove";
  /** The 3D view is never a slice. */
  slice = { plane: "" };
  /** Whether the oblique slice follows the orientation of the 3D view. */
  oblique = { follows: true, normal: [0.34, -0.92, 0.17], up: [0, 0, 1] };
  author = kept(AUTHOR);
  set = kept(SET) || "default";
  /** Hidden sets. */
  dark = new Set();
  /** The list of the template in progress, as [set, list]. */
  guide = null;

  on(names, listener) {
    this.#listeners.push([names.split(" "), listener]);
  }

  changed(...names) {
    if (!this.#changed.size) queueMicrotask(() => this.#tell());
    for (const name of names) this.#changed.add(name);
  }

  #tell() {
    const changed = this.#changed;
    this.#changed = new Set();
    for (const [names, listener] of this.#listeners) if (names.some((name) => changed.has(name))) listener(changed);
  }

  setAuthor(name) {
    this.author = kept(AUTHOR, name.trim());
    this.changed("author");
  }

  chooseSet(name) {
    this.set = kept(SET, name);
    this.changed("sets");
  }

  moveCursor(mm, hu = null) {
    const [low, high] = this.volume.bounds_mm;
    this.cursor = { mm: mm.map((value, i) => Math.min(high[i], Math.max(low[i], value))), hu };
    this.changed("cursor");
  }

  select(id, handle = 0) {
    if (this.selected === id && this.handle === handle) return;
    this.selected = id;
    this.handle = handle;
    this.changed("selection");
  }

  chooseTool(tool) {
    if (this.tool === tool) return;
    this.tool = tool;
    this.changed("tool");
  }

  /** Replaces all items by those of the server, with their measures. */
  take({ seq, items, sets = [], templates = null }) {
    this.seq = seq;
    this.items = new Map(items.map((entry) => [entry.item.id, entry]));
    this.sets = sets;
    if (templates) this.templates = templates;
    if (!this.items.has(this.selected)) this.selected = null;
    this.changed("items", "sets");
  }

  /** Applies the events of an own change; false if events before them are missing. */
  follow(events) {
    let whole = true;
    for (const { seq, id, version, item } of events) {
      if (seq <= this.seq) continue;
      whole &&= seq === this.seq + 1;
      this.seq = seq;
      if (item) this.items.set(id, { version, item, measures: measures(item.geometry) });
      else this.items.delete(id);
    }
    if (!this.items.has(this.selected)) this.selected = null;
    this.changed("items");
    return whole;
  }

  entry(id) {
    return this.items.get(id) ?? null;
  }

  /** Items to draw: visible ones of visible sets, and of this phase where the volume is one. */
  shown() {
    return [...this.items.values()].filter(({ item }) => item.visible && item.geometry && !this.dark.has(item.set) && isInPhase(item, this.volume));
  }

  /** Items by set and list: both sorted by name, items in their order. */
  groups() {
    const groups = new Map();
    for (const entry of this.items.values()) {
      const { set, list = "" } = entry.item;
      const key = `${set}\n${list}`;
      if (!groups.has(key)) groups.set(key, { set, list, entries: [] });
      groups.get(key).entries.push(entry);
    }
    const order = (a, b) => a.item.order - b.item.order || a.item.created.localeCompare(b.item.created);
    for (const group of groups.values()) group.entries.sort(order);
    return [...groups.values()].sort((a, b) => a.set.localeCompare(b.set) || a.list.localeCompare(b.list));
  }

  /** Items of the template in progress, in order; empty without one. */
  guided() {
    if (!this.guide) return [];
    const [set, list] = this.guide;
    return this.groups().find((group) => group.set === set && group.list === list)?.entries ?? [];
  }

  /** An unused name in the set: Point 1, Point 2, ... */
  freeName(kind) {
    const taken = new Set([...this.items.values()].filter(({ item }) => item.set === this.set).map(({ item }) => item.name));
    for (let number = 1; ; number += 1) if (!taken.has(`${kind} ${number}`)) return `${kind} ${number}`;
  }

  jumpTo(id) {
    const entry = this.entry(id);
    const middle = entry && middleOf(entry.item.geometry);
    if (middle) this.moveCursor(middle);
    this.select(id);
    return Boolean(middle);
  }
}
