// Picking: a click requests the patient position under it in the displayed picture. A marker stays at
// that position. A second click with Shift measures the distance from the first.

import { decimalsOf, lengthWords } from "./lengths.js";
import { notify, showFailure } from "./notice.js";
import { Projection } from "./projection.js";
import { $, state, volumePath } from "./state.js";
import { distance } from "./vectors.js";
import { request } from "./view.js";

const lps = ([x, y, z]) =>
  [[x, "L", "R"], [y, "P", "A"], [z, "H", "F"]]
    .map(([value, positive, negative]) => `${value < 0 ? negative : positive} ${Math.abs(value).toFixed(decimalsOf(state.volume))}`)
    .join(", ");

const wordsOf = (found) => [
  ["Patient", `${lps(found.patient_mm)} mm`],
  ["LPS", found.patient_mm.map((value) => value.toFixed(decimalsOf(state.volume) + 1)).join(", ")],
  ["View depth", lengthWords(found.depth_mm, decimalsOf(state.volume))],
  ...(found.segment ? [["Segment", found.segment.name ?? `label ${found.segment.label}`]] : []),
];

const distanceWords = (from, to) => [["Distance", `${lengthWords(distance(from, to), decimalsOf(state.volume))}, along a straight line`]];

export class Picks {
  #pick = null;
  /** The position from which the distance is measured. */
  #from = null;
  /** Number of the latest request: the response to an earlier click is discarded. */
  #asked = 0;

  /** `shown` returns the displayed picture. */
  constructor(shown) {
    this.shown = shown;
  }

  /** Picks at a point of the stage, in fractions of its width and height; with `measures`, measures from the previous pick. */
  async at([x, y], measures = false) {
    const picture = this.shown();
    if (!picture?.query) return;
    const { query, size } = picture;
    const number = (this.#asked += 1);
    const at = new URLSearchParams(query);
    // A picture under a time budget is incomplete: pick in the complete one, which is already requested.
    at.delete("budget_ms");
    at.set("u", Math.min(size[0] - 0.01, x * size[0]).toFixed(2));
    at.set("v", Math.min(size[1] - 0.01, y * size[1]).toFixed(2));
    try {
      const found = await (await request(`${volumePath("pick")}?${at}`)).json();
      if (number !== this.#asked) return;
      const from = measures ? this.#from ?? this.#pick?.patient ?? null : null;
      this.#from = found.hit ? from : null;
      this.#pick = found.hit ? { patient: found.patient_mm } : null;
      const words = found.hit ? [...wordsOf(found), ...(this.#from ? distanceWords(this.#from, found.patient_mm) : [])] : [];
      $("picked").replaceChildren(...words.map(line));
      if (!found.hit) notify("Nothing is shown there. Click on the volume itself, or choose a preset that shows more.");
    } catch (error) {
      if (number === this.#asked) showFailure(error);
    }
    this.draw();
  }

  /** Moves the marker to its position in the displayed picture. */
  draw() {
    const pick = this.#pick;
    const picture = this.shown();
    // A frame is meant for a display: no marker may cover it.
    const overlays = state.view !== "frame";
    $("picked").hidden = !pick || !overlays;
    const isSeen = pick && overlays && picture?.camera && picture.kind !== "frame";
    const projection = isSeen ? new Projection(picture.camera) : null;
    const at = projection?.project(pick.patient)?.at;
    const start = this.#from && projection?.project(this.#from)?.at;
    $("ruler").toggleAttribute("hidden", !start || !at);
    if (start && at) $("ruler").firstElementChild.setAttribute("d", `M${start.map((x) => x * 100)}L${at.map((x) => x * 100)}`);
    const inside = at && at.every((value) => value >= 0 && value <= 1);
    $("marker").hidden = !inside;
    if (inside) Object.assign($("marker").style, { left: `${at[0] * 100}%`, top: `${at[1] * 100}%` });
  }

  forget() {
    this.#asked += 1;
    this.#pick = this.#from = null;
    this.draw();
  }
}

function line([name, value]) {
  const made = document.createElement("div");
  const term = document.createElement("b");
  term.textContent = `${name}  `;
  made.append(term, value);
  return made;
}
