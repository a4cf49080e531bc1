// The view synthesis of the page: in a worker, or on the page's own thread where a browser has no
// graphics in workers.

import { outputOf } from "./outputs.js";
import { Synthesis } from "./synthesis.js";

/** Makes views on the page's own thread; the same methods as `InWorker`. */
class OnPage {
  place = "on the page's thread";
  #synthesis;

  constructor(query, profile) {
    this.#synthesis = new Synthesis(outputOf(new URLSearchParams(query)), profile);
  }

  async frame(size, layers, display) {
    const since = performance.now();
    this.#synthesis.take(size, layers, display);
    return this.#drawn(since);
  }

  async give(pixels) {
    const since = performance.now();
    this.#synthesis.give(pixels);
    return this.#drawn(since);
  }

  async follow(eyes) {
    return this.#synthesis.follow(eyes) ? this.#drawn(performance.now()) : {};
  }

  #drawn(since) {
    const image = this.#synthesis.draw();
    return { image, ms: performance.now() - since };
  }
}

/** Makes views in a worker. */
class InWorker {
  place = "in a worker";
  #worker;
  #number = 0;
  /** Callers that wait for the answer to a message, by its number. */
  #waiting = new Map();
  /** Why the worker answers nothing more. */
  #failed = null;

  constructor() {
    this.#worker = new Worker("/synthesis-worker.js", { type: "module" });
    this.#worker.addEventListener("message", ({ data }) => {
      const { resolve, reject } = this.#waiting.get(data.number);
      this.#waiting.delete(data.number);
      if (data.error) reject(new Error(data.error));
      else resolve(data);
    });
    // A worker that cannot start, or that ends, answers nothing more.
    this.#worker.addEventListener("error", ({ message }) => {
      this.#failed = new Error(message || "the worker of the view synthesis ended");
      for (const { reject } of this.#waiting.values()) reject(this.#failed);
      this.#waiting.clear();
    });
  }

  #call(call, values) {
    if (this.#failed) return Promise.reject(this.#failed);
    this.#number += 1;
    const answer = new Promise((resolve, reject) => this.#waiting.set(this.#number, { resolve, reject }));
    this.#worker.postMessage({ number: this.#number, call, values });
    return answer;
  }

  async start(query, profile) {
    try {
      await this.#call("start", { query, profile });
    } catch (error) {
      this.#worker.terminate();
      throw error;
    }
    return this;
  }

  frame(size, layers, display) {
    return this.#call("frame", { size, layers, display });
  }

  give(pixels) {
    return this.#call("give", { pixels });
  }

  follow(eyes) {
    return this.#call("follow", { eyes });
  }
}

/**
 * The view synthesis of an address; throws where the address or the browser does not allow it. `frame(size, layers, display)` and
 * `follow(eyes)` give the picture and how long it took (`image`, `ms`); `follow` gives no picture where the output follows nobody.
 * `give(pixels)` shows rendered views of the newest frame for the newest eyes, in the same arrangement.
 */
export async function synthesizerOf(query, profile) {
  if (typeof Worker === "function" && typeof OffscreenCanvas === "function") {
    try {
      return await new InWorker().start(query, profile);
    } catch {
      // Tried on the page below, which throws the reason if it is not the worker.
    }
  }
  return new OnPage(query, profile);
}
