// A live session: one WebSocket, its messages, and reconnection.
//
// Times are nanoseconds of this page's clock. The newest frame is displayed; a frame
// superseded during decoding is acknowledged with its successor.

import { ACCEPT, layersOf, readHeader, unpack } from "./frame.js";
import { withTicket } from "./identity.js";
import { intentsTo } from "./restore.js";

const FIRST_WAIT_MS = 100;
const LONGEST_WAIT_MS = 2000;
const TOKEN = "relief-session";
/** Number of consecutive invalid frames after which the connection is closed. */
const MOST_BAD = 20;
/** Close codes after which reconnecting would fail again. */
const FINAL = { 1008: "the server refuses this session", 4001: "this session goes on in another window", 4002: "the volume was removed" };

/** Refusals that are temporary: a server that has just started is still loading its series. */
function whyNotYet({ type, problem }) {
  if (type !== "error") return "";
  if (problem?.status === 503) return "the server is not ready yet";
  return problem?.code === "no-such-volume" ? "the server does not have this volume yet" : "";
}

/** Messages whose time of sending is kept. */
const MOST_SENT = 256;

const nowNs = () => Math.round((performance.timeOrigin + performance.now()) * 1e6);

export class Session {
  #socket = null;
  #wait = FIRST_WAIT_MS;
  #seq = 0;
  /** When intents and reports that no frame has shown yet were sent, by their number. */
  #sentMs = new Map();
  #newest = null;
  #view = null;
  #unpacking = false;
  #ended = false;
  #bad = 0;
  /** The reason of a temporary refusal. */
  #notYet = "";

  /**
   * `hello` is the message without `type` and `accept`; `show` gets (header, layers) and may take its time, `heard` gets every message of the server,
   * `changed` gets the state of the connection (connecting, live, waiting or ended) and a reason.
   */
  constructor(hello, { show, heard, changed }) {
    Object.assign(this, { hello, show, heard, changed });
    // The token is stored only while the page unloads: a duplicated tab gets a session of its own.
    this.token = sessionStorage.getItem(TOKEN);
    sessionStorage.removeItem(TOKEN);
    addEventListener("pagehide", () => this.token && sessionStorage.setItem(TOKEN, this.token));
    addEventListener("pageshow", () => sessionStorage.removeItem(TOKEN));
    this.#connect();
  }

  /** Sends an intent; without a connection it is discarded, because the user sees no view. */
  intent(intent) {
    this.#send({ type: "intent", seq: this.#next(), t_ns: nowNs(), ...intent });
  }

  /** Sends a report of a Wiimote, in hexadecimal digits. */
  report(report) {
    this.#send({ type: "report", seq: this.#next(), t_ns: nowNs(), report });
  }

  #next() {
    this.#seq += 1;
    this.#sentMs.set(this.#seq, performance.now());
    if (this.#sentMs.size > MOST_SENT) this.#sentMs.delete(this.#sentMs.keys().next().value);
    return this.#seq;
  }

  /** Milliseconds since the message was sent that a frame shows as its newest; undefined if an earlier frame showed it. */
  delayOf(showsSeq) {
    const sent = this.#sentMs.get(showsSeq);
    for (const seq of this.#sentMs.keys()) if (seq <= showsSeq) this.#sentMs.delete(seq);
    return sent === undefined ? undefined : performance.now() - sent;
  }

  /** Changes the options of the view; new sessions start with them. */
  settings(settings) {
    this.hello.settings = { ...this.hello.settings, ...settings };
    this.#send({ type: "settings", ...settings });
  }

  end(reason) {
    this.#ended = true;
    this.token = null;
    this.#socket?.close(1000);
    this.changed("ended", reason);
  }

  #send(message) {
    if (this.#socket?.readyState === WebSocket.OPEN) this.#socket.send(JSON.stringify(message));
  }

  async #connect() {
    this.changed("connecting");
    const url = new URL("/v1/session", location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    // For a load balancer, which cannot read the hello: all clients of a view must reach the same
    // server.
    for (const key of ["view", "volume"]) if (this.hello[key]) url.searchParams.set(key, this.hello[key]);
    await withTicket(url);
    if (this.#ended) return;
    const socket = new WebSocket(url, "relief.v1");
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    socket.addEventListener("open", () => {
      // A server that no longer knows the token uses the other fields.
      const resume = this.token ? { resume: this.token } : {};
      this.#send({ type: "hello", client: "relief kiosk", accept: ACCEPT, ...this.hello, ...resume });
    });
    socket.addEventListener("message", ({ data }) => (typeof data === "string" ? this.#read(data) : this.#take(data)));
    socket.addEventListener("close", ({ code, reason }) => this.#closed(code, reason));
  }

  /** Reports an invalid message; the next one may be valid. */
  #read(text) {
    let message = null;
    try {
      message = JSON.parse(text);
    } catch {
      // Reported below.
    }
    if (typeof message?.type !== "string") return this.changed("live", "the server said something that is no message");
    this.#hear(message);
  }

  #hear(message) {
    if (message.type === "welcome") {
      this.#wait = FIRST_WAIT_MS;
      this.#bad = 0;
      this.token = message.session;
      this.changed("live");
      if (this.#view && message.role === "presenter" && message.state.revision <= 1) this.#restore(message.state);
    }
    this.#notYet = whyNotYet(message);
    if (message.state?.look_at_mm) this.#view = message.state;
    this.heard(message);
  }

  /** The view is new: the server restarted, or dropped an idle view. */
  #restore({ look_at_mm: lookAt }) {
    if (this.#view.preset) this.intent({ intent: "preset", name: this.#view.preset });
    intentsTo(this.#view, lookAt).forEach((intent) => this.intent(intent));
  }

  #closed(code, reason) {
    this.#newest = null;
    if (this.#ended) return;
    const final = FINAL[code];
    if (final && !this.#notYet) return this.end(reason || final);
    this.changed("waiting", this.#notYet || reason);
    this.#notYet = "";
    setTimeout(() => this.#connect(), this.#wait);
    this.#wait = Math.min(2 * this.#wait, LONGEST_WAIT_MS);
  }

  /** Decodes one frame at a time, the newest. */
  async #take(buffer) {
    this.#newest = { buffer, socket: this.#socket };
    if (this.#unpacking) return;
    this.#unpacking = true;
    while (this.#newest) {
      const { buffer: bytes, socket } = this.#newest;
      this.#newest = null;
      await this.#showOne(bytes, socket);
    }
    this.#unpacking = false;
  }

  /** Displays and acknowledges a frame, or reports why it is invalid; the next one may be valid. */
  async #showOne(bytes, socket) {
    let header = null;
    let wrong = null;
    try {
      header = readHeader(bytes);
      await this.show(header, layersOf(header, await unpack(header, bytes)));
    } catch (error) {
      wrong = error.message;
    }
    // The frame belongs to an earlier connection: its number means another frame now, and the
    // server does not wait for it.
    if (socket !== this.#socket || socket.readyState !== WebSocket.OPEN) return;
    if (wrong !== null || this.#bad > 0) this.changed("live", wrong ?? "");
    this.#bad = wrong === null ? 0 : this.#bad + 1;
    // Without its number a frame cannot be acknowledged, and without acknowledgements none follows.
    if (!header || this.#bad >= MOST_BAD) socket.close(4000, "unreadable frames");
    else this.#send({ type: "ack", frame: header.sequence, t_ns: nowNs() });
  }
}
