// The stage: requests pictures of the state, and draws the responses.
//
// A change immediately requests a picture under a time budget, and a complete one after a pause.

import { drawPicture } from "./draw.js";
import { showFailure } from "./notice.js";
import { $, DOT, state, volumePath } from "./state.js";
import { Fetcher, firstPasses, frameQuery, morePasses, stageQuery, stillSize } from "./view.js";

/** Pause after the last change before a complete picture is requested, ms. */
const STILL_MS = 220;
const RESIZED_MS = 120;

export class Stage {
  #timer = 0;
  #context = $("picture").getContext("2d", { alpha: false, willReadFrequently: true });
  /** The displayed picture and its request. */
  shown = null;

  /** Calls `asked` with every request and `drawn` with every picture. */
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

  /** Whether the displayed picture contains a view: colour and depth arrive together. */
  holds(view) {
    return this.shown?.kind === "rgbd" && !this.shown.moving && view !== "frame";
  }

  /** Requests a picture of the current state: under a time budget while moving, complete after a pause. */
  refresh({ moving = false } = {}) {
    if (!state.volume) return;
    clearTimeout(this.#timer);
    if (moving) this.#timer = setTimeout(() => this.refresh(), STILL_MS);
    this.fetcher.want(state.view === "frame" ? frameOrder(moving) : this.#order(moving));
    this.asked();
  }

  /** While moving, only colour is requested for the picture view; otherwise colour and depth, side by side in one PNG. */
  #order(moving, passes = firstPasses(state, moving), before = 0) {
    const full = stillSize(...this.size, Math.min(2, devicePixelRatio));
    const kind = moving && state.view === "picture" ? "color" : "rgbd";
    // A lossless picture of full size takes longer to pack than to render.
    const size = moving && kind === "rgbd" ? full.map((side) => Math.ceil(side / 2)) : full;
    const query = stageQuery(state, size, kind, { passes, moving });
    const accept = kind === "color" ? "image/jpeg" : "image/png";
    return { url: `${volumePath("frame")}?${query}`, accept, kind, moving, query, size, passes, added: passes - before };
  }

  /** Adds passes to a path-traced picture at rest until it has enough or the state changes. */
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

  /** Draws the displayed picture in the chosen view. */
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
