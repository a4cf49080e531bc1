// The state of a view: the camera as an orbit, the query for it, and the loop that fetches one
// picture at a time. It accesses no element of the page.
//
// Angles in degrees, lengths in mm, patient coordinates in DICOM LPS. Sizes in pixels of the
// picture.

import { signIn } from "./identity.js";
import { cropQuery, tableQuery } from "./crop.js";
import { labelQuery } from "./labels.js";
import { lightQuery } from "./light.js";
import { fitOf, orbitQuery } from "./orbit.js";
import { sliceQuery } from "./slices.js";
import { clamp } from "./vectors.js";

/** The view after a reset. It is slightly closer than the whole volume, whose corners are mostly air. */
export const HOME = Object.freeze({ azimuth: 20, elevation: 10, zoom: 1 });

/** Greatest number of pixels of a still picture: more takes a software renderer seconds. */
const STILL_PIXELS = 1_000_000;

/** Time budget of a picture while the view moves: the server casts fewer rays, ms. */
const MOVING_MS = 80;

/** Passes of a path-traced picture: while moving, at rest, and at most; and the time to spend on additional ones. */
const MOVING_PASSES = 1;
const FIRST_PASSES = 2;
const MOST_PASSES = 256;
const REFINING_MS = 1500;
/** How often light scatters at most in path-traced pictures. */
const SCATTERINGS = 4;

/** Number of retries if the server is busy, and the longest delay between them, ms. */
const MOST_TRIES = 8;
const LONGEST_WAIT_MS = 4000;

/** The size of a still picture for a stage of CSS pixels. */
export function stillSize(width, height, ratio) {
  const scale = Math.min(ratio, Math.sqrt(STILL_PIXELS / Math.max(1, width * height)));
  return [width, height].map((side) => Math.max(16, Math.round(side * scale)));
}

/** Query parameters of the look of the volume, without size and layout; `fit` corrects the zoom for the shape of the picture. */
function lookQuery(state, aspect, fit, moving = false) {
  const labels = labelQuery(state);
  if (state.slice.plane) return { ...sliceQuery(state.slice, state.volume, aspect), ...tableQuery(state), ...labels };
  const surface = state.mode === "isosurface" && state.iso !== null ? { iso_hu: state.iso } : {};
  // An empty list of overlays needs no parameter.
  const overlays = state.overlays.length ? { overlay: state.overlays.join(",") } : {};
  return {
    ...overlays,
    ...labels,
    ...(state.preset ? { preset: state.preset } : {}),
    mode: state.mode,
    ...surface,
    ...lightQuery(state, moving),
    ...cropQuery(state),
    ...(state.depthRule ? { depth_rule: state.depthRule } : {}),
    ...orbitQuery(state.pose, state.volume, state.fieldOfView, state.pose.zoom * fit),
  };
}

/** Query of a picture that fills the stage, with a time budget while moving. */
export function stageQuery(state, [width, height], layout, { passes, moving = false } = {}) {
  const look = lookQuery(state, width / height, fitOf([width, height], state.volume), moving);
  const query = { ...look, ...budget(moving), size_px: `${width},${height}`, layout, depth_filter: state.depthFilter };
  if (passes === undefined) return new URLSearchParams(query);
  const light = { passes, scatterings: SCATTERINGS, ...(moving ? {} : { denoise: true }) };
  return new URLSearchParams({ ...query, ...light });
}

/** Passes of the first requested picture; undefined in modes without passes. */
export function firstPasses(state, moving) {
  if (state.slice.plane || state.mode !== "path-traced") return undefined;
  return moving ? MOVING_PASSES : FIRST_PASSES;
}

/**
 * Passes to request after a picture, as many as take about `REFINING_MS`; undefined if there are enough. The server
 * continues its picture, so that only the additional passes take time.
 */
export function morePasses({ passes, added, moving, spent }) {
  if (passes === undefined || moving || passes >= MOST_PASSES) return undefined;
  const each = spent.render > 0 ? spent.render / added : REFINING_MS / passes;
  const more = clamp(Math.floor(REFINING_MS / each), 1, passes);
  return Math.min(MOST_PASSES, passes + more);
}

const budget = (moving) => (moving ? { budget_ms: MOVING_MS } : {});

/** Query of the frame for a display, with a time budget while moving. */
export function frameQuery(state, moving = false) {
  // All frame layouts have pictures of 16:9.
  const query = { ...lookQuery(state, 16 / 9, 1, moving), ...budget(moving), layout: state.layout };
  if (state.profile) query.profile = state.profile;
  const { factor, offset, depthFilter: depth_filter } = state;
  return new URLSearchParams({ ...query, factor, offset, depth_filter });
}

/** Durations of a Server-Timing header by name, ms. */
function timings(header) {
  const found = {};
  for (const entry of (header ?? "").split(",")) {
    const [name, ...parameters] = entry.trim().split(";");
    const duration = parameters.find((parameter) => parameter.startsWith("dur="));
    if (duration) found[name] = Number(duration.slice(4));
  }
  return found;
}

/** The message of a response that is not a picture. */
export class Refusal extends Error {
  constructor(message, retryMs) {
    super(message);
    this.retryMs = retryMs;
  }
}

/** Fetches, and turns problem documents into readable errors. */
export async function request(url, options) {
  let answer;
  try {
    answer = await fetch(url, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refusal("The server does not answer.", 2000);
  }
  if (answer.ok) return answer;
  if (answer.status === 401) signIn();
  const problem = await answer.json().catch(() => ({}));
  const seconds = Number(answer.headers.get("Retry-After"));
  const retryMs = answer.status === 503 ? 1000 * (seconds || 1) : undefined;
  throw new Refusal(problem.detail ?? `The server answered ${answer.status}.`, retryMs);
}

/** Decodes a picture without colour management, which would change the header in a frame's pixels. */
function decode(blob) {
  return createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
}

/**
 * Fetches the newest requested picture: at most one request is in flight, and only the latest of the others is kept. A
 * complete picture is aborted if another one is requested, and the server stops rendering it.
 */
export class Fetcher {
  #wanted = null;
  #running = null;

  /** `show` gets each picture with its request; `fail` gets an error, or null after recovery. */
  constructor(show, fail, busy) {
    Object.assign(this, { show, fail, busy });
  }

  /** Whether a request is in flight. */
  get isBusy() {
    return this.#running !== null;
  }

  /** Whether a newer request is waiting. */
  get hasWish() {
    return this.#wanted !== null;
  }

  /** Requests a picture: `{ url, accept, moving, ... }`. */
  want(order) {
    const running = this.#running?.order;
    this.#wanted = running?.url === order.url && running.accept === order.accept ? null : order;
    // A still picture may take long, and an outdated one is no longer needed.
    if (this.#wanted && running && !running.moving) this.#running.abort.abort();
    if (!this.#running) this.#run();
  }

  async #run() {
    while (this.#wanted) {
      const order = this.#wanted;
      this.#wanted = null;
      const abort = new AbortController();
      this.#running = { order, abort };
      this.busy(!order.moving);
      try {
        await this.#fetch(order, abort.signal);
        this.fail(null);
      } catch (error) {
        if (error.name !== "AbortError") await this.#recover(order, error);
      }
    }
    this.#running = null;
    this.busy(false);
  }

  async #fetch(order, signal) {
    const since = performance.now();
    const answer = await request(order.url, { headers: { Accept: order.accept }, signal });
    const bitmap = await decode(await answer.blob());
    const spent = timings(answer.headers.get("Server-Timing"));
    const camera = JSON.parse(answer.headers.get("Relief-Camera") ?? "null");
    const quality = JSON.parse(answer.headers.get("Relief-Quality") ?? "null");
    // A code, a semicolon, and the text for people.
    const warning = answer.headers.get("Relief-Warning")?.split("; ").slice(1).join("; ");
    this.show({ ...order, bitmap, camera, spent, quality, warning, totalMs: performance.now() - since });
  }

  /** Retries temporary errors a limited number of times with growing delays. A newer request goes first. */
  async #recover(order, error) {
    this.fail(error);
    const tries = (order.tries ?? 1) + 1;
    if (error.retryMs === undefined || tries > MOST_TRIES) return;
    const wait = Math.min(error.retryMs * 2 ** (tries - 2), LONGEST_WAIT_MS);
    await new Promise((resolve) => setTimeout(resolve, wait));
    this.#wanted ??= { ...order, tries };
  }
}
