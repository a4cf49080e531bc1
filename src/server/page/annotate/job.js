// A long task: its name, its duration, and a button to cancel it.
//
// The server reports no progress, because growing and meshing do not know their duration. Leaving
// the page cancels the task.

import { element } from "./pane.js";

/** Tasks that end sooner are not displayed, ms. */
const SOON_MS = 300;

export class Job {
  #running = [];
  #timer = 0;

  constructor(host) {
    this.host = host;
    this.words = element("span");
    this.time = element("span", { className: "count" });
    const bar = element("progress", { ariaLabel: "Working" });
    const stop = element("button", { type: "button", onclick: () => this.cancel() }, "Cancel ", element("kbd", {}, "Esc"));
    host.replaceChildren(bar, this.words, this.time, stop);
  }

  /** Runs `ask` with an abort signal; returns its result or throws its error, an `AbortError` if it was cancelled. */
  async run(words, ask) {
    const job = { words, since: performance.now(), abort: new AbortController() };
    this.#running.push(job);
    this.#tell();
    try {
      return await ask(job.abort.signal);
    } finally {
      this.#running = this.#running.filter((other) => other !== job);
      this.#tell();
    }
  }

  /** Cancels the newest task; returns false if no task runs. */
  cancel() {
    const job = this.#running.pop();
    job?.abort.abort();
    this.#tell();
    return job !== undefined;
  }

  #tell() {
    clearTimeout(this.#timer);
    const job = this.#running.at(-1);
    const ms = job ? performance.now() - job.since : 0;
    this.host.hidden = !job || ms < SOON_MS;
    if (!job) return;
    if (this.words.textContent !== job.words) this.words.textContent = job.words;
    this.time.textContent = ms >= 1000 ? `${Math.floor(ms / 1000)} s` : "";
    this.#timer = setTimeout(() => this.#tell(), ms < SOON_MS ? SOON_MS - ms : 250);
  }
}
