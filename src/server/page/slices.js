// The state of slices: plane, position, thickness, window, and the query for one.
//
// Positions in DICOM patient coordinates (LPS), mm; windows in HU. It accesses only the controls of
// slices.

import { decimalsOf } from "./lengths.js";
import { clamp } from "./vectors.js";

/** Standard planes of the server: the axis of the slice numbers, and the directions of right and up. */
export const PLANES = {
  axial: { axis: 2, right: [1, 0, 0], up: [0, -1, 0] },
  coronal: { axis: 1, right: [1, 0, 0], up: [0, 0, 1] },
  sagittal: { axis: 0, right: [0, 1, 0], up: [0, 0, 1] },
};

/** No slice; the initial values of one. `at` is the centre of the picture, null is the centre of the volume. */
export const NO_SLICE = Object.freeze({ plane: "", at: null, zoom: 1, slab: 0, blend: "mean", center: 40, width: 400 });

const round = (value, decimals = 2) => Number(value.toFixed(decimals));

/** The volume's extent along a direction of the axes, mm. */
export function extent({ bounds_mm: [low, high] }, direction) {
  return direction.reduce((sum, part, i) => sum + Math.abs(part) * (high[i] - low[i]), 0);
}

/** Height in mm of a picture of this aspect (width / height) that shows the whole volume, divided by the zoom. */
function heightOf({ plane, zoom }, volume, aspect) {
  const { right, up } = PLANES[plane];
  return Math.max(extent(volume, up), extent(volume, right) / aspect) / zoom;
}

/** Query parameters of a slice for a picture of this aspect. */
export function sliceQuery(slice, volume, aspect) {
  const { plane, at, slab, blend, center, width } = slice;
  const decimals = decimalsOf(volume) + 1;
  return {
    mode: "slice",
    plane,
    center_mm: (at ?? volume.center_mm).map((mm) => round(mm, decimals)).join(","),
    height_mm: round(heightOf(slice, volume, aspect), decimals),
    slab_mm: slab,
    slab_blend: blend,
    window_hu: `${center},${width}`,
  };
}

/** Distance of a volume's slices along a patient axis, mm: that of the voxel axis nearest to it. */
export function sliceStep({ direction, spacing_mm: spacing }, axis) {
  const along = [0, 1, 2].map((voxel) => Math.abs(direction[3 * axis + voxel]));
  return spacing[along.indexOf(Math.max(...along))];
}

/** The number of the slice at a position along a patient axis, from 1, and how many there are. */
export function sliceNumber(volume, axis, mm) {
  const [low, high] = volume.bounds_mm.map((bound) => bound[axis]);
  const step = sliceStep(volume, axis);
  const count = Math.max(1, Math.round((high - low) / step));
  return [clamp(Math.floor((mm - low) / step) + 1, 1, count), count];
}

/** The slice moved by a number of slices along its axis, within the volume. */
export function paged(slice, volume, steps) {
  const { axis } = PLANES[slice.plane];
  return placed(slice, volume, (slice.at ?? volume.center_mm)[axis] + steps * sliceStep(volume, axis));
}

/** The next slice along its axis; the first one follows the last. */
export function advanced(slice, volume) {
  const { axis } = PLANES[slice.plane];
  const mm = (slice.at ?? volume.center_mm)[axis];
  const [number, count] = sliceNumber(volume, axis, mm);
  const step = sliceStep(volume, axis);
  return placed(slice, volume, number === count ? volume.bounds_mm[0][axis] + step / 2 : mm + step);
}

/** The slice with its window changed by a drag, CSS pixels: upwards is brighter, to the right is wider. */
export function windowed(slice, [dx, dy]) {
  const center = Math.round(clamp(slice.center + 2 * dy, -1024, 3071));
  return { ...slice, center, width: Math.round(clamp(slice.width + 4 * dx, 1, 6000)) };
}

/** The slice at a position along its axis, within the volume. */
function placed(slice, volume, mm) {
  const { axis } = PLANES[slice.plane];
  const at = [...(slice.at ?? volume.center_mm)];
  at[axis] = clamp(mm, volume.bounds_mm[0][axis], volume.bounds_mm[1][axis]);
  return { ...slice, at };
}

/** The slice after dragging its picture by fractions of its height, to the right and down. */
export function dragged(slice, volume, [dx, dy], aspect) {
  const { right, up } = PLANES[slice.plane];
  const height = heightOf(slice, volume, aspect);
  const at = (slice.at ?? volume.center_mm).map((value, i) => {
    const moved = value + height * (dy * up[i] - dx * right[i]);
    return clamp(moved, volume.bounds_mm[0][i], volume.bounds_mm[1][i]);
  });
  return { ...slice, at };
}

/** Zooms within limits around a position in the picture (fractions of its size). */
export function zoomed(slice, ratio, volume, aspect, [x, y] = [0.5, 0.5]) {
  const nearer = { ...slice, zoom: clamp(slice.zoom * ratio, 0.5, 20) };
  const grown = nearer.zoom / slice.zoom - 1;
  const by = [-(x - 0.5) * aspect * grown, -(y - 0.5) * grown];
  return by.some(Boolean) ? dragged(nearer, volume, by, aspect) : nearer;
}

/** As text: plane, number, position on its axis as a letter and mm, and slab thickness. */
export function sliceWords({ plane, at, slab, blend }, volume) {
  const { axis } = PLANES[plane];
  const mm = (at ?? volume.center_mm)[axis];
  const letter = ["LR", "PA", "HF"][axis][mm < 0 ? 1 : 0];
  const place = `${sliceNumber(volume, axis, mm).join("/")}, ${letter} ${Math.abs(mm).toFixed(decimalsOf(volume))} mm`;
  const words = [plane, place];
  if (slab > 0) words.push(`${blend} of ${slab} mm`);
  return words;
}

/** The part of the address for a slice; empty without one. */
export function kept({ plane, at, slab, blend, center, width }) {
  if (!plane) return {};
  return { plane, at: (at ?? []).map((mm) => round(mm, 5)).join(","), slab, blend, window: `${center},${width}` };
}

/** Reads the slice from an address; invalid values are replaced by defaults. */
export function recalled(words) {
  const numbers = (name, count) => {
    const list = (words.get(name) ?? "").split(",").map(Number);
    return list.length === count && words.get(name) && list.every(Number.isFinite) ? list : null;
  };
  const plane = words.get("plane");
  if (!Object.hasOwn(PLANES, plane ?? "")) return { ...NO_SLICE };
  const [center, width] = numbers("window", 2) ?? [NO_SLICE.center, NO_SLICE.width];
  const [slab] = numbers("slab", 1) ?? [0];
  const blend = ["mean", "mip", "minip"].includes(words.get("blend")) ? words.get("blend") : "mean";
  return { ...NO_SLICE, plane, at: numbers("at", 3), slab: clamp(slab, 0, 100), blend, center, width: Math.max(1, width) };
}

/** Controls of the panel by id: the property of the slice, and the conversion of the value. */
const CONTROLS = { "slice-slab": "slab", "slice-blend": "blend", "slice-center": "center", "slice-width": "width" };

/** Updates the panel's controls from a slice, and hides those of volume views. */
export function showControls(find, slice, volume) {
  const isSlice = slice.plane !== "";
  for (const part of document.querySelectorAll("[data-of]")) part.hidden = (part.dataset.of === "slice") !== isSlice;
  if (!isSlice || !volume) return;
  for (const [id, key] of Object.entries(CONTROLS)) find(id).value = slice[key];
  const known = [...find("slice-window").options].map((option) => option.value);
  const window = `${slice.center},${slice.width}`;
  find("slice-window").value = known.includes(window) ? window : "";
  const { axis } = PLANES[slice.plane];
  const place = find("slice-place");
  [place.min, place.max, place.step] = [volume.bounds_mm[0][axis], volume.bounds_mm[1][axis], 0.1];
  place.value = (slice.at ?? volume.center_mm)[axis];
  find("slice-place-value").textContent = sliceWords({ ...slice, slab: 0 }, volume)[1];
  find("slice-slab-value").textContent = slice.slab > 0 ? `${slice.slab} mm` : "off";
}

/** Calls back with the change of a control, as a function of the slice. */
export function onControls(find, volume, change) {
  find("slice-window").addEventListener("change", ({ target }) => {
    const [center, width] = target.value.split(",").map(Number);
    change((slice) => ({ ...slice, center, width }), false);
  });
  find("slice-place").addEventListener("input", ({ target }) => {
    change((slice) => placed(slice, volume(), Number(target.value)), true);
  });
  for (const [id, key] of Object.entries(CONTROLS)) {
    find(id).addEventListener("input", ({ target }) => {
      const value = key === "blend" ? target.value : Number(target.value);
      const usable = key === "blend" || (target.value !== "" && target.checkValidity());
      if (usable) change((slice) => ({ ...slice, [key]: value }), target.type === "range");
    });
  }
}
