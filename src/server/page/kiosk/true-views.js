// The rendered views of a picture at rest: they come from the server and replace those that the page
// makes of the picture and its depth, first refined ones, then true ones (see docs/VIEWS.md).

import { pixelsOf } from "./frame.js";

/** The qualities to request, in this order, for each value of `rest` in the address. */
const QUALITIES = { true: ["refined", "true"], synthesised: [] };
/** Delay between the last movement and the request for views, ms. */
const REST_MS = 150;
/** Limits of one request. */
const MOST = { eyes: 16, pixels: 2 ** 24, rows: 16384 };

/** The qualities to request; throws if the address has an unknown value. */
export function qualitiesOf(parameters) {
  const rest = parameters.get("rest") ?? "true";
  if (!Object.hasOwn(QUALITIES, rest)) throw new Error(`rest is ${rest.slice(0, 40)}; allowed: ${Object.keys(QUALITIES).join(", ")}`);
  return QUALITIES[rest];
}

export class TrueViews {
  #qualities;
  #show;
  #failed;
  #timer = 0;
  #running = new AbortController();

  /** `show(size, pixels, quality)` shows views (RGBA, one above the other); `failed(reason)` says why there are none. */
  constructor(qualities, { show, failed }) {
    this.#qualities = qualities;
    this.#show = show;
    this.#failed = failed;
  }

  /** The picture or the eyes move: views that are on their way are not shown. */
  moved() {
    clearTimeout(this.#timer);
    this.#running.abort();
  }

  /** A picture of this size is at rest in a live view, seen by these eyes (eye separations to the right of the middle). */
  rest(view, eyes, [width, height]) {
    this.moved();
    const rows = height * eyes.length;
    if (eyes.length > MOST.eyes || rows > MOST.rows || width * rows > MOST.pixels) return;
    const running = new AbortController();
    this.#running = running;
    this.#timer = setTimeout(() => this.#ask(view, eyes, [width, height], running.signal), REST_MS);
  }

  async #ask(view, eyes, [width, height], signal) {
    try {
      for (const quality of this.#qualities) {
        const query = new URLSearchParams({ eyes: eyes.join(","), quality });
        const answer = await fetch(`/v1/session/${encodeURIComponent(view)}/views?${query}`, { signal });
        if (answer.status === 204) return; // it moves
        if (!answer.ok) throw new Error((await answer.json()).detail);
        const pixels = await pixelsOf(await answer.blob(), width, height * eyes.length);
        if (signal.aborted) return;
        await this.#show([width, height], pixels, quality, signal);
      }
    } catch (error) {
      if (!signal.aborted) this.#failed(error.message);
    }
  }
}
