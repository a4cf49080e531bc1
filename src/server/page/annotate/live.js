// Changes by other people: pushed by the server over a live session's WebSocket, and polled without
// one.
//
// Asking costs little: an answer without news is a 304. A session that only listens takes no
// frames: it acknowledges none, so two are sent to it, once.

import { withTicket } from "/identity.js";

const OFTEN_MS = 2000;
/** While changes are told, asking is only for what a broken line swallowed. */
const SELDOM_MS = 20_000;
const LONGEST_WAIT_MS = 30_000;
/** The close code of a session that the server does not want. */
const REFUSED = 1008;

/** A message; null of what is none, which asking makes up for. */
function read(text) {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}

export class Live {
  #timer = 0;
  #wait = 1000;
  #told = false;
  #socket = null;
  #ended = false;

  /** `news(seq)` is called when there may be some; `changed` with "live", "asking" or "away". */
  constructor(volume, author, { news, changed }) {
    Object.assign(this, { volume, author, news, changed });
    this.#connect();
    this.#later();
    document.addEventListener("visibilitychange", () => document.hidden || this.#ask());
  }

  end() {
    this.#ended = true;
    clearTimeout(this.#timer);
    this.#socket?.close(1000);
  }

  #later() {
    clearTimeout(this.#timer);
    if (!this.#ended) this.#timer = setTimeout(() => this.#ask(), this.#told ? SELDOM_MS : OFTEN_MS);
  }

  async #ask(seq) {
    clearTimeout(this.#timer);
    if (this.#ended) return;
    const there = document.hidden ? true : await this.news(seq);
    this.changed(there ? (this.#told ? "live" : "asking") : "away");
    this.#later();
  }

  async #connect() {
    if (this.#ended) return;
    const url = new URL("/v1/session", location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    url.searchParams.set("volume", this.volume.id); // for a proxy before several servers
    await withTicket(url);
    if (this.#ended) return;
    const socket = new WebSocket(url, "relief.v1");
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    socket.addEventListener("open", () => {
      const who = this.author ? { author: this.author } : {};
      // The smallest allowed picture, because it is not displayed.
      const least = { size_px: [64, 64], accept: { color: ["jpeg"], depth: ["none"] }, settings: { annotations: true, display: { layout: "color" } } };
      socket.send(JSON.stringify({ type: "hello", client: "relief annotate", volume: this.volume.id, ...who, ...least }));
    });
    socket.addEventListener("message", ({ data }) => {
      if (typeof data !== "string") return;
      const message = read(data);
      if (message?.type === "welcome") this.#wait = 1000;
      if (message?.type !== "annotations") return;
      this.#told = true;
      this.#ask(message.seq);
    });
    socket.addEventListener("close", ({ code }) => {
      this.#told = false;
      if (this.#ended) return;
      this.#later();
      // Refused: it would be again.
      if (code === REFUSED) return;
      setTimeout(() => this.#connect(), this.#wait);
      this.#wait = Math.min(2 * this.#wait, LONGEST_WAIT_MS);
    });
  }
}
