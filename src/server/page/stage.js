// The stage: requests pictures of the state, and draws the responses.
//
// A change asks at once for a picture under a budget of time, and for a whole one when things are
// still.

import { drawPicture } from "./draw.js";
import { showFailure } from "./notice.js";
import { $, DOT, state, volumePath } from "./state.js";
import { Fetcher, firstPasses, frameQuery, morePasses, stageQuery, stillSize } from "./view.js";

/** A pause this long counts as standing still. */
const STILL_MS = 220;
const RESIZED_MS = 120;

export class Stage {
  #timer = 0;
  #context = $("picture").getContext("2d", { alpha: false, willReadFrequently: true });
  /** The picture that is shown, with its order. */
  shown = null;

  /** `asked` is called with every request, `drawn` with every picture. */
  constructor({ asked, drawn }) {
    Object.assign(this, { host: $("stage"), asked, drawn });
    this.fetcher = new Fetcher((picture) => this.#show(picture), showFailure, (busy) => $("busy").classList.toggle("on", busy));
    let resized = 0;
    new ResizeObserver(() => {
      clearTimeout(resized);
      resized = setTimeout(() => this.refresh(), RESIZED_MS);
    }).observe(this.host);
  }

  get isBusy() {
    return this.fetcher.isBusy;
  }

  get size() {
    return [this.host.clientWidth, this.host.clientHeight];
  }

  /** Whether what is shown holds a view already: colour and depth come together. */
  holds(view) {
    return this.shown?.kind === "rgbd" && !this.shown.moving && view !== "frame";
  }

  /** Asks for the picture of the present state; while moving one under a budget, and a whole one after a pause. */
  refresh({ moving = false } = {}) {
    if (!state.volume) return;
    clearTimeout(this.#timer);
    if (moving) this.#timer = setTimeout(() => this.refresh(), STILL_MS);
    this.fetcher.want(state.view === "frame" ? frameOrder(moving) : this.#order(moving));
    this.asked();
  }

  /** While moving, colour alone is enough for the picture; else colour and depth come side by side in one PNG. */
  #order(moving, passes = firstPasses(state, moving), before = 0) {
    const full = stillSize(...this.size, Math.min(2, devicePixelRatio));
    const kind = moving && state.view === "picture" ? "color" : "rgbd";
    // A lossless picture of full size takes longer to pack than to render.
    const size = moving && kind === "rgbd" ? full.map((side) => Math.ceil(side / 2)) : full;
    const query = stageQuery(state, size, kind, { passes, moving });
    const accept = kind === "color" ? "image/jpeg" : "image/png";
    return { url: `${volumePath("frame")}?${query}`, accept, kind, moving, query, size, passes, added: passes - before };
  }

  /** A path-traced picture that stands still gets more passes, until it has enough or something changes. */
  #refine(picture) {
    const passes = picture.kind === "rgbd" ? morePasses(picture) : undefined;
    if (passes !== undefined && !this.fetcher.hasWish) this.fetcher.want(this.#order(false, passes, picture.passes));
  }

  #show(picture) {
    this.shown?.bitmap.close();
    this.shown = picture;
    this.draw();
    this.drawn(picture);
    // The directions of the displayed picture, which may be older than the latest request.
    for (const edge of ["left", "right", "top", "bottom"]) {
      $(`edge-${edge}`).textContent = picture.camera?.edges[edge] ?? "";
      $(`edge-${edge}`).hidden = picture.kind === "frame";
    }
    $("timing").textContent = timingWords(picture);
    $("picture-warning").textContent = picture.warning ?? "";
    $("picture-warning").hidden = picture.warning === undefined;
    this.#refine(picture);
  }

  /** Draws what is shown in the view that is chosen. */
  draw() {
    if (this.shown) drawPicture(this.#context, this.shown, state, this.host.clientWidth * devicePixelRatio);
  }
}

function frameOrder(moving) {
  return { url: `${volumePath("frame")}?${frameQuery(state, moving)}`, accept: "image/png", kind: "frame", moving };
}

const ms = (value) => `${Math.round(value)} ms`;

function timingWords({ bitmap, camera, quality, spent, passes, totalMs }) {
  const { queue = 0, render = 0, upload = 0, overlay = 0, encode = 0 } = spent;
  const [width, height] = camera?.size_px ?? [bitmap.width, bitmap.height];
  const rendered = render + upload > 0 ? `render ${ms(render + upload + overlay)}` : "render reused";
  const times = [`queue ${ms(queue)}`, rendered, `encode ${ms(encode)}`, `in all ${ms(totalMs)}`];
  const rays = quality?.reduced ? [`rays ${quality.rays_px.join(" × ")}`] : [];
  return [`${width} × ${height}`, ...rays, ...(passes === undefined ? [] : [`${passes} passes`]), ...times].join(DOT);
}
