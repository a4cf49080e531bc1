// The state in the address: a reload or a link shows the same view. Invalid values are replaced by
// the defaults.

import { keptCrop, recalledCrop } from "./crop.js";
import { kept as keptLabels, recalled as recalledLabels } from "./labels.js";
import { decimalsOf } from "./lengths.js";
import { keptLight, recalledLight } from "./light.js";
import { normalized } from "./orbit.js";
import { kept as keptSlice, recalled as recalledSlice } from "./slices.js";
import { $, VIEWS, overlayBoxes, state } from "./state.js";
import { clamp } from "./vectors.js";
import { HOME } from "./view.js";

/** Defaults of the display settings; other values are kept in the address. */
const USUAL = { profile: "", factor: 64, offset: 128 };

/** Least time between two changes of the address, ms: browsers refuse more than 100 in 30 s. */
const BETWEEN_MS = 400;
let written = -BETWEEN_MS;
let waiting = null;

/** Writes the state into the address: immediately, or delayed if it changes often. */
export function remember() {
  if (!state.volume || waiting !== null) return;
  const wait = written + BETWEEN_MS - performance.now();
  if (wait <= 0) return write();
  waiting = setTimeout(write, wait);
}

// Pending changes are written when the page closes.
addEventListener("pagehide", () => waiting !== null && write());

function write() {
  clearTimeout(waiting);
  waiting = null;
  written = performance.now();
  const { azimuth, elevation, zoom, shift } = state.pose;
  const { preset, mode, iso, view, layout, overlays, fieldOfView, preview, depthFilter: filter, depthRule: rule } = state;
  const kept = { volume: state.volume.id, ...(preset ? { preset } : {}), mode, view, layout, filter, ...(rule ? { rule } : {}), fov: fieldOfView };
  if (iso !== null) kept.iso = iso;
  if (overlays.length) kept.overlay = overlays.join(",");
  if (preview) kept.preview = preview;
  for (const [key, usual] of Object.entries(USUAL)) if (state[key] !== usual) kept[key] = state[key];
  const pose = { az: azimuth.toFixed(1), el: elevation.toFixed(1), zoom: zoom.toFixed(2) };
  if (shift) pose.shift = shift.map((mm) => mm.toFixed(decimalsOf(state.volume))).join(",");
  const parts = { ...kept, ...pose, ...keptSlice(state.slice), ...keptLight(state.light), ...keptLabels(state.labels), ...keptCrop(state) };
  history.replaceState(null, "", `#${new URLSearchParams(parts)}`);
}

/** Reads the state from the address, limited to values that the menus offer; returns the id of its volume. */
export function recall(presets) {
  const kept = new URLSearchParams(location.hash.slice(1));
  const number = (name, otherwise) => {
    const value = Number(kept.get(name) ?? NaN);
    return Number.isFinite(value) ? value : otherwise;
  };
  const word = (name, allowed) => (allowed.includes(kept.get(name)) ? kept.get(name) : undefined);
  const values = (id) => [...$(id).options].map((option) => option.value);
  const shift = (kept.get("shift") ?? "").split(",").map(Number);
  const { azimuth, elevation, zoom } = HOME;
  state.pose = normalized({
    azimuth: number("az", azimuth),
    elevation: number("el", elevation),
    zoom: number("zoom", zoom),
    shift: kept.has("shift") && shift.length === 3 && shift.every((mm) => Math.abs(mm) < 1e4) ? shift : null,
  });
  state.slice = recalledSlice(kept);
  state.labels = recalledLabels(kept);
  state.light = recalledLight(kept);
  Object.assign(state, recalledCrop(kept));
  state.fieldOfView = number("fov", 22) === 0 ? 0 : 22;
  state.own = { preset: kept.has("preset"), window: kept.has("window") };
  state.preset = word("preset", presets.map((preset) => preset.name)) ?? presets[0].name;
  state.mode = word("mode", values("mode")) ?? presets.find(({ name }) => name === state.preset).mode;
  state.iso = kept.has("iso") ? number("iso", 300) : null;
  const switched = (kept.get("overlay") ?? "").split(",");
  state.overlays = overlayBoxes().map((box) => box.value).filter((name) => switched.includes(name));
  state.view = word("view", VIEWS) ?? "picture";
  state.layout = word("layout", values("layout")) ?? "wowvx";
  state.depthFilter = word("filter", values("depth-filter")) ?? "none";
  state.depthRule = word("rule", values("depth-rule")) ?? "";
  state.profile = word("profile", values("profile")) ?? USUAL.profile;
  for (const key of ["factor", "offset"]) state[key] = Math.round(clamp(number(key, USUAL[key]), 0, 255));
  state.preview = word("preview", [...$("panel").querySelectorAll('input[name="preview"]')].map((input) => input.value)) ?? "";
  return kept.get("volume");
}
