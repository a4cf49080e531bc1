// A preview of a 3D display: the views of a frame as a wiggle, in a grid, or as an anaglyph, or their
// difference from true views. The server makes the views of colour and depth, and renders the true ones.

import { compare, inWords } from "./likeness.js";
import { request, stageQuery } from "./view.js";

/** Kinds of previews: the requested layout, and the greatest number of pixels of a view. */
const KINDS = {
  wiggle: { layout: "views-9", pixels: 250_000 },
  anaglyph: { layout: "anaglyph", pixels: 600_000 },
  views: { layout: "views-9", pixels: 120_000 },
  difference: { layout: "views-9", pixels: 120_000 },
};
/** Columns and rows of the nine views; the leftmost is at the bottom left. */
const GRID = [3, 3];
const STEP_MS = 60;
/** Pause after the last change before a preview is requested, ms. */
const STILL_MS = 350;

/** Top left corner of view `i` in the quilt, in fractions of its width and height. */
function placeOf(i, [columns, rows] = GRID) {
  return [(i % columns) / columns, (rows - 1 - Math.floor(i / columns)) / rows];
}

/** The view of a step of the wiggle: back and forth. */
function viewOf(step, count = GRID[0] * GRID[1]) {
  const at = step % (2 * count - 2);
  return at < count ? at : 2 * count - 2 - at;
}

/**
 * The address of a preview of the state's picture for a stage of CSS pixels; it covers the picture exactly. The last part of the path is
 * `frame` for views made of picture and depth, `views` for true ones.
 */
function previewUrl(kind, state, [width, height], part = "frame") {
  const { layout, pixels } = KINDS[kind];
  const scale = Math.min(1, Math.sqrt(pixels / Math.max(1, width * height)));
  const size = [width, height].map((side) => Math.max(16, Math.round(side * scale)));
  const query = stageQuery(state, size, layout);
  for (const key of ["factor", "offset"]) query.set(key, state[key]);
  if (state.profile) query.set("profile", state.profile);
  return `/v1/volumes/${state.volume.id}/${part}?${query}`;
}

/** Shows previews on a canvas that lies over the stage. */
export class Preview {
  #timer = 0;
  #shown = null;
  #abort = null;

  /**
   * `choices` are the radio buttons of the state's `preview`, `words` an element for a comparison's result; calls
   * `chosen` after a choice and `fail` with errors.
   */
  constructor(canvas, choices, words, state, { chosen, fail }) {
    Object.assign(this, { canvas, words, state, fail, context: canvas.getContext("2d", { alpha: false }) });
    for (const choice of choices) {
      choice.addEventListener("change", () => {
        state.preview = choice.value;
        this.changed();
        chosen();
      });
    }
  }

  /** The state changed: shows the live picture until the view rests. */
  changed() {
    clearTimeout(this.#timer);
    this.#abort?.abort();
    this.#hide();
    if (this.state.preview && this.state.volume) this.#timer = setTimeout(() => this.#fetch(), STILL_MS);
  }

  #hide() {
    this.canvas.hidden = true;
    this.words.hidden = true;
    this.#shown?.close();
    this.#shown = null;
  }

  async #fetch() {
    const abort = new AbortController();
    this.#abort = abort;
    const kind = this.state.preview;
    try {
      const parts = kind === "difference" ? ["frame", "views"] : ["frame"];
      const bitmaps = await Promise.all(parts.map((part) => this.#bitmap(kind, part, abort.signal)));
      if (abort.signal.aborted) return bitmaps.forEach((bitmap) => bitmap.close());
      const [bitmap] = kind === "difference" ? [await this.#compared(bitmaps)] : bitmaps;
      this.#shown = bitmap;
      this.canvas.hidden = false;
      this.#draw(kind, bitmap);
    } catch (error) {
      if (error.name !== "AbortError") this.fail(error);
    }
  }

  async #bitmap(kind, part, signal) {
    const { clientWidth, clientHeight } = this.canvas.parentElement;
    const url = previewUrl(kind, this.state, [clientWidth, clientHeight], part);
    const answer = await request(url, { headers: { Accept: "image/png" }, signal });
    return createImageBitmap(await answer.blob());
  }

  /** Shows how far the made views are from the true ones in words; returns the map as a bitmap. */
  async #compared([made, truth]) {
    const { psnr, map } = compare(made, truth, GRID);
    made.close();
    truth.close();
    this.words.textContent = inWords(psnr);
    this.words.hidden = false;
    return createImageBitmap(map);
  }

  #draw(kind, bitmap) {
    const [columns, rows] = kind === "wiggle" ? GRID : [1, 1];
    const [width, height] = [bitmap.width / columns, bitmap.height / rows];
    Object.assign(this.canvas, { width, height });
    this.canvas.setAttribute("aria-label", `${kind} of what a 3D display shows`);
    if (kind !== "wiggle") return this.context.drawImage(bitmap, 0, 0);
    const start = performance.now();
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const step = (now) => {
      if (this.#shown !== bitmap) return;
      const [x, y] = placeOf(viewOf(Math.max(0, Math.floor((now - start) / STEP_MS))));
      this.context.drawImage(bitmap, x * bitmap.width, y * bitmap.height, width, height, 0, 0, width, height);
      if (!still) requestAnimationFrame(step);
    };
    step(start);
  }
}
