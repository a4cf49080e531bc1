// Clip planes: each hides the part of the volume between a plane and the viewer at the time when the
// plane was added.
//
// Patient coordinates (LPS), mm. A plane is `{ towards, at }`: the unit vector to its hidden side, and
// its distance from the centre of the tissue along it.

import { directionsOf } from "./orbit.js";
import { decimalsOf, placeWords, stepIn } from "./lengths.js";
import { add, distance, length, scale } from "./vectors.js";

/** Greatest number of planes. */
const MOST = 4;

/** Query parameters of the planes: a point and the normal to the visible side of each. */
export function planesQuery({ planes, volume }) {
  if (!planes.length || !volume) return {};
  const numbers = planes.flatMap(({ towards, at }) => [
    ...add(volume.framing.center_mm, scale(towards, at)).map((mm) => mm.toFixed(decimalsOf(volume))),
    ...towards.map((part) => (-part).toFixed(4)),
  ]);
  return { clip_planes_mm: numbers.join(",") };
}

/** The part of the address for the planes; empty without planes. */
export function keptPlanes({ planes, volume }) {
  const words = planes.map(({ towards, at }) => [...towards.map((part) => part.toFixed(4)), at.toFixed(decimalsOf(volume))].join(","));
  return planes.length ? { planes: words.join(";") } : {};
}

/** Reads the planes from an address; invalid ones are left out. */
export function recalledPlanes(words) {
  const planes = (words.get("planes") ?? "").split(";").map((word) => word.split(",").map(Number));
  const isPlane = (numbers) => numbers.length === 4 && numbers.every(Number.isFinite) && length(numbers.slice(0, 3)) > 0.5;
  return planes.filter(isPlane).slice(0, MOST).map(([x, y, z, at]) => ({ towards: [x, y, z], at }));
}

export class Planes {
  #rows = [];

  /** `list` gets a row for each plane, `button` adds one, `changed` is called with changes of the state. */
  constructor({ list, button, state, changed }) {
    Object.assign(this, { list, button, state, changed });
    button.addEventListener("click", () => this.#add());
  }

  /** Updates the controls from the state. */
  draw() {
    const { planes, volume } = this.state;
    this.button.disabled = !volume || planes.length >= MOST;
    if (!volume) return;
    if (this.#rows.length !== planes.length) {
      this.#rows = planes.map((_, index) => this.#row(index));
      this.list.replaceChildren(...this.#rows.map(({ line }) => line));
    }
    const reach = distance(...volume.bounds_mm) / 2;
    planes.forEach(({ at }, index) => {
      const { range, output } = this.#rows[index];
      Object.assign(range, { step: stepIn(volume.bounds_mm, 0.5, 500), min: -reach, max: reach, value: at });
      output.textContent = placeWords(at, volume);
    });
  }

  #add() {
    const { planes, pose } = this.state;
    this.#set([...planes, { towards: directionsOf(pose).toEye, at: 0 }]);
    this.#rows.at(-1)?.range.focus();
  }

  #set(planes, moving = false) {
    this.changed({ planes }, moving);
    this.draw();
  }

  #row(index) {
    const line = Object.assign(document.createElement("div"), { className: "crop-side crop-plane" });
    const label = Object.assign(document.createElement("label"), { htmlFor: `plane-${index}`, textContent: `Plane ${index + 1}` });
    const range = Object.assign(document.createElement("input"), { id: `plane-${index}`, type: "range" });
    range.addEventListener("input", () => {
      const moved = { ...this.state.planes[index], at: range.valueAsNumber };
      this.#set(this.state.planes.with(index, moved), true);
    });
    const output = document.createElement("output");
    const remove = Object.assign(document.createElement("button"), { type: "button", textContent: "×", title: `Remove plane ${index + 1}` });
    remove.setAttribute("aria-label", remove.title);
    remove.addEventListener("click", () => {
      this.#set(this.state.planes.toSpliced(index, 1));
      this.button.focus();
    });
    line.append(label, range, output, remove);
    return { line, range, output };
  }
}
