// Crop: the visible part of the volume, a box with a slider and a handle for each side, and clip
// planes; the visibility of the table; and how cut faces look.
//
// Patient coordinates (LPS), mm. A box is its lowest and its highest corner; null is the whole
// volume.

import { decimalsOf, placeWords, stepIn } from "./lengths.js";
import { keptPlanes, planesQuery, recalledPlanes } from "./planes.js";
import { Projection } from "./projection.js";
import { clamp } from "./vectors.js";

const $ = (id) => document.getElementById(id);

/** Sides of a box: patient axis, corner (0 lowest, 1 highest) and name. */
const SIDES = [[0, 0, "right"], [0, 1, "left"], [1, 0, "front"], [1, 1, "back"], [2, 0, "foot"], [2, 1, "head"]];
/** Thinnest box. */
const LEAST_MM = 5;
/** How far an arrow key moves a side. */
const STEP_MM = 2;
const ARROWS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };

/** Query parameters of the visible part of the volume. */
export function cropQuery(state) {
  const { crop, volume } = state;
  const box = crop ? { clip_box_mm: crop.flat().map((mm) => mm.toFixed(decimalsOf(volume))).join(",") } : {};
  return { ...box, ...planesQuery(state), ...tableQuery(state), ...facesQuery(state) };
}

/** Whether a mode has cut faces that can be painted. */
const paintsFaces = (mode) => mode === "composite";

/** Query parameters of cut faces: none in modes that do not paint them. */
const facesQuery = ({ faces, mode }) => (faces === "slice" && paintsFaces(mode) ? { cut: faces } : {});

/** Updates the control of cut faces. */
export function describeFaces({ faces, mode }) {
  $("cut-slice-field").hidden = !paintsFaces(mode);
  $("cut-slice").checked = faces === "slice";
}

/** Query parameters of the table: pictures show it, or leave it out and outline it in slices. */
export const tableQuery = ({ table }) => (table === "keep" ? { table } : {});

/** The part of the address for the crop box, the planes, the table and cut faces; defaults are left out. */
export function keptCrop(state) {
  const { crop, volume } = state;
  const box = crop ? { crop: crop.flat().map((mm) => mm.toFixed(decimalsOf(volume))).join(",") } : {};
  const faces = state.faces === "slice" ? { faces: "slice" } : {};
  return { ...box, ...keptPlanes(state), ...tableQuery(state), ...faces };
}

/** Reads box, planes, table and cut faces from an address. */
export function recalledCrop(words) {
  const mm = (words.get("crop") ?? "").split(",").map(Number);
  const isBox = words.get("crop") && mm.length === 6 && mm.every(Number.isFinite) && [0, 1, 2].every((i) => mm[i] < mm[i + 3]);
  const table = words.get("table") === "keep" ? "keep" : "remove";
  const faces = words.get("faces") === "slice" ? "slice" : "lit";
  return { crop: isBox ? [mm.slice(0, 3), mm.slice(3)] : null, planes: recalledPlanes(words), table, faces };
}

/** The box with a side moved to `mm`, within the volume; null if it is the whole volume again. */
function withSide(crop, bounds, axis, corner, mm) {
  const box = (crop ?? bounds).map((place) => [...place]);
  const other = box[1 - corner][axis];
  const least = stepIn(bounds, LEAST_MM, 80);
  const [low, high] = corner === 0 ? [bounds[0][axis], other - least] : [other + least, bounds[1][axis]];
  box[corner][axis] = clamp(mm, Math.min(low, high), Math.max(low, high));
  const isWhole = box.every((place, end) => place.every((value, i) => Math.abs(value - bounds[end][i]) < stepIn(bounds, 0.05, 10_000)));
  return isWhole ? null : box;
}

/** Middle of a side of a box. */
const middleOf = (box, axis, corner) => [0, 1, 2].map((i) => (i === axis ? box[corner][i] : (box[0][i] + box[1][i]) / 2));

export class Crop {
  #rows;
  #handles;

  /**
   * `panel` gets a slider for each side, `layer` gets the handles, which are visible while `group` is open; `shown` returns the
   * displayed picture, `changed` is called with changes of the state.
   */
  constructor({ panel, layer, group, state, shown, changed }) {
    Object.assign(this, { layer, group, state, shown, changed });
    this.#rows = SIDES.map(([axis, corner, name]) => this.#row(panel, axis, corner, name));
    this.#handles = SIDES.map(([axis, corner, name]) => this.#handle(axis, corner, name));
    group.addEventListener("toggle", () => this.draw());
  }

  /** Updates the controls from the state, and the handles on the displayed picture. */
  draw() {
    const { volume, crop, slice } = this.state;
    if (!volume) return;
    const box = crop ?? volume.bounds_mm;
    SIDES.forEach(([axis, corner, name], at) => {
      const { range, output } = this.#rows[at];
      range.step = stepIn(volume.bounds_mm, 0.5, 500);
      [range.min, range.max] = volume.bounds_mm.map((place) => place[axis]);
      range.value = box[corner][axis];
      output.textContent = placeWords(box[corner][axis], volume);
      this.#handles[at].setAttribute("aria-label", `Crop, ${name}: ${placeWords(box[corner][axis], volume)}`);
    });
    const camera = this.group.open && !slice.plane && this.shown()?.kind !== "frame" ? this.shown()?.camera : null;
    this.layer.hidden = !camera;
    if (camera) this.#place(new Projection(camera), box);
  }

  #place(projection, box) {
    SIDES.forEach(([axis, corner], at) => {
      const place = projection.project(middleOf(box, axis, corner))?.at;
      this.#handles[at].hidden = !place || place.some((value) => value < 0 || value > 1);
      if (place) Object.assign(this.#handles[at].style, { left: `${place[0] * 100}%`, top: `${place[1] * 100}%` });
    });
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((bits) => projection.project([0, 1, 2].map((i) => box[(bits >> i) & 1][i]))?.at);
    const edges = corners.flatMap((from, bits) => [1, 2, 4].filter((bit) => !(bits & bit)).map((bit) => [from, corners[bits | bit]]));
    const lines = edges.filter(([from, to]) => from && to).map(([from, to]) => `M${from.map((x) => x * 100)}L${to.map((x) => x * 100)}`);
    this.layer.querySelector("path").setAttribute("d", lines.join(""));
  }

  #set(axis, corner, mm, moving) {
    const { volume, crop } = this.state;
    this.changed({ crop: withSide(crop, volume.bounds_mm, axis, corner, mm) }, moving);
    this.draw();
  }

  #at(axis, corner) {
    return (this.state.crop ?? this.state.volume.bounds_mm)[corner][axis];
  }

  #row(panel, axis, corner, name) {
    const line = Object.assign(document.createElement("div"), { className: "crop-side" });
    const label = Object.assign(document.createElement("label"), { htmlFor: `crop-${name}`, textContent: `${name[0].toUpperCase()}${name.slice(1)}` });
    const output = document.createElement("output");
    const range = Object.assign(document.createElement("input"), { id: `crop-${name}`, type: "range" });
    range.addEventListener("input", () => this.#set(axis, corner, range.valueAsNumber, true));
    line.append(label, range, output);
    panel.append(line);
    return { range, output };
  }

  #handle(axis, corner, name) {
    const handle = Object.assign(document.createElement("button"), { type: "button", className: "crop-handle", title: `Drag: crop the ${name}` });
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      const projection = new Projection(this.shown().camera);
      const [from, mm] = [[event.clientX, event.clientY], this.#at(axis, corner)];
      const along = this.#pixelsPerMm(projection, axis, corner);
      const size = along[0] ** 2 + along[1] ** 2;
      handle.onpointermove = ({ clientX, clientY }) => {
        const by = ((clientX - from[0]) * along[0] + (clientY - from[1]) * along[1]) / Math.max(size, 1e-3);
        this.#set(axis, corner, mm + by, true);
      };
    });
    const release = () => (handle.onpointermove = null);
    handle.addEventListener("pointerup", release);
    handle.addEventListener("pointercancel", release);
    handle.addEventListener("keydown", (event) => {
      if (!ARROWS[event.key]) return;
      event.preventDefault();
      event.stopPropagation();
      this.#set(axis, corner, this.#at(axis, corner) + stepIn(this.state.volume.bounds_mm, STEP_MM, 200) * ARROWS[event.key], true);
    });
    this.layer.append(handle);
    return handle;
  }

  /** Movement of a handle on the screen for one mm of its side, CSS pixels. */
  #pixelsPerMm(projection, axis, corner) {
    const box = this.state.crop ?? this.state.volume.bounds_mm;
    const middle = middleOf(box, axis, corner);
    const moved = middle.map((value, i) => (i === axis ? value + 1 : value));
    const [a, b] = [middle, moved].map((place) => projection.project(place).at);
    return [(b[0] - a[0]) * this.layer.clientWidth, (b[1] - a[1]) * this.layer.clientHeight];
  }
}
