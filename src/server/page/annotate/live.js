// Changes by other people: pushed by the server over a live session's WebSocket, and polled without
// one.
//
// Polling is cheap: a response without changes is a 304. The session acknowledges no frames, so the
// server sends it only two.

import { withTicket } from "/identity.js";

const OFTEN_MS = 2000;
/** Polling interval while the server sends changes: only for those that a broken connection lost, ms. */
const SELDOM_MS = 20_000;
const LONGEST_WAIT_MS = 30_000;
/** The close code of a refused session: a server that has just started does not have the volume yet. */
const REFUSED = 1008;

/** Parses a message; null if it is invalid, then polling finds the change. */
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
  #notified = false;
  #socket = null;
  #ended = false;

  /**
   * Calls `news(seq)` when there may be changes, which returns "there" or the reason why they cannot be had; and
   * `changed` with "live", "asking" or that reason.
   */
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
    if (!this.#ended) this.#timer = setTimeout(() => this.#ask(), this.#notified ? SELDOM_MS : OFTEN_MS);
  }

  async #ask(seq) {
    clearTimeout(this.#timer);
    if (this.#ended) return;
    if (!document.hidden) {
      const found = await this.news(seq);
      if (this.#ended) return;
      this.changed(found === "there" ? (this.#notified ? "live" : "asking") : found);
    }
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
      this.#notified = true;
      this.#ask(message.seq);
    });
    socket.addEventListener("close", ({ code }) => {
      this.#notified = false;
      if (this.#ended) return;
      this.#ask(); // "live" is no longer true
      if (code === REFUSED) this.#wait = LONGEST_WAIT_MS;
      setTimeout(() => this.#connect(), this.#wait);
      this.#wait = Math.min(2 * this.#wait, LONGEST_WAIT_MS);
    });
  }
}
