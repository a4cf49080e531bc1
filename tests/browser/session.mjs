// The kiosk's session against a socket that is played here, in Node: `node session.mjs KIOSK`, where KIOSK is a folder with the
// page's modules. Prints one JSON object of what happened; what has to have happened is in tests/browser.rs.

import { deflateSync } from "node:zlib";
import { pathToFileURL } from "node:url";

const stored = new Map();
const listeners = {};
const sockets = [];

globalThis.sessionStorage = {
  getItem: (key) => stored.get(key) ?? null,
  setItem: (key, value) => stored.set(key, value),
  removeItem: (key) => stored.delete(key),
};
globalThis.addEventListener = (name, listener) => ((listeners[name] ??= []).push(listener));
globalThis.location = { href: "http://127.0.0.1:1/kiosk" };
globalThis.ImageData = class {
  constructor(data, width, height) {
    Object.assign(this, { data, width, height });
  }
};
globalThis.fetch = async () => ({ status: 404 });
globalThis.WebSocket = class {
  static OPEN = 1;

  constructor() {
    Object.assign(this, { readyState: 1, sent: [], closed: null, on: {} });
    sockets.push(this);
  }

  addEventListener(name, listener) {
    this.on[name] = listener;
  }

  send(text) {
    this.sent.push(JSON.parse(text));
  }

  close(code) {
    this.closed ??= code;
  }
};

const { Session } = await import(pathToFileURL(`${process.argv[2]}/session.js`));
const { compose } = await import(pathToFileURL(`${process.argv[2]}/frame.js`));
const acknowledged = (socket) => socket.sent.filter(({ type }) => type === "ack").map((ack) => ack.frame);

/** Waits until a socket got more acknowledgements than these, or was closed; five seconds at most. */
async function settle(socket, before) {
  for (let turn = 0; turn < 500 && acknowledged(socket).length === before && socket.closed === null; turn += 1) {
    await new Promise((done) => setTimeout(done, 10));
  }
}

/** A frame of 2 x 1 pixels in layout `color`, with this number; what `change` does makes it bad. */
function frame(sequence, change = () => {}) {
  const color = deflateSync(Uint8Array.of(10, 20, 30, 1, 1, 1));
  const bytes = new Uint8Array(128 + color.length);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, 0x524c4956, false);
  view.setUint16(4, 1, true);
  view.setUint8(10, 3); // rgb-deflate
  view.setUint32(12, sequence, true);
  [48, 52].forEach((at) => [2, 1].forEach((side, axis) => view.setUint16(at + 2 * axis, side, true)));
  view.setUint8(68, 7); // color
  view.setUint32(72, color.length, true);
  bytes.set(color, 128);
  change(view, bytes);
  return bytes.buffer;
}

/** A session whose socket is open. The server of this play gives no tickets. */
async function begin() {
  const seen = { shown: [], changed: [] };
  const before = sockets.length;
  const session = new Session({}, {
    show: (header, layers) => seen.shown.push([header.sequence, ...compose(header, layers).data.slice(0, 8)]),
    heard: () => {},
    changed: (state, reason = "") => seen.changed.push([state, reason]),
  });
  while (sockets.length === before) await new Promise((done) => setTimeout(done, 1));
  const socket = sockets.at(-1);
  socket.on.open();
  const say = (message) => socket.on.message({ data: JSON.stringify(message) });
  const give = async (data) => {
    const before = acknowledged(socket).length;
    socket.on.message({ data });
    await settle(socket, before);
  };
  return { session, seen, socket, say, give };
}

/** Invalid messages: they are reported, and later messages are handled. */
async function badTexts() {
  const { seen, socket, say } = await begin();
  for (const text of ["{not json", "7", "null", '{"type":3}']) socket.on.message({ data: text });
  say({ type: "welcome", session: "token-1", role: "presenter", state: { revision: 1 } });
  return { changed: seen.changed, closed: socket.closed };
}

/** A server that is not ready yet is asked again; one that refuses is not. */
async function tooEarly() {
  const refused = async (status, type) => {
    const { seen, socket, say } = await begin();
    say({ type: "error", fatal: true, problem: { status, type: `urn:relief:problem:${type}`, code: type, detail: "no volume is loaded" } });
    socket.on.close({ code: 1008, reason: "hello refused" });
    return seen.changed.at(-1)[0];
  };
  return {
    unavailable: await refused(503, "no-volume"),
    missing: await refused(404, "no-such-volume"),
    preset: await refused(404, "no-such-preset"),
    unprocessable: await refused(422, "out-of-range"),
  };
}

async function badFrames() {
  const { seen, socket, say, give } = await begin();
  say({ type: "welcome", session: "token-1", role: "presenter", state: { revision: 1 } });
  await give(frame(1));
  await give(frame(2, (view, bytes) => bytes.fill(0, 128))); // no zlib stream
  await give(frame(3));
  const after = { acknowledged: acknowledged(socket), closed: socket.closed, changed: [...seen.changed], shown: [...seen.shown] };
  for (let number = 4; number < 40 && socket.closed === null; number += 1) {
    await give(frame(number, (view, bytes) => bytes.fill(0, 128)));
  }
  return { ...after, closed_at_last: socket.closed, acknowledged_at_last: acknowledged(socket).length };
}

async function noFrame() {
  const { socket, give } = await begin();
  await give(frame(1, (view) => view.setUint32(0, 0)));
  return { closed: socket.closed, acknowledged: acknowledged(socket).length };
}

/** A tab that is copied, one that is loaded again, one whose session has ended. */
async function tokens() {
  stored.clear();
  const first = await begin();
  first.say({ type: "welcome", session: "token-1", role: "presenter", state: { revision: 1 } });
  const copied = stored.get("relief-session") ?? null;
  listeners.pagehide.at(-1)();
  const left = stored.get("relief-session") ?? null;
  const again = await begin();
  const resumed = again.socket.sent[0].resume ?? null;
  again.say({ type: "welcome", session: "token-1", role: "presenter", state: { revision: 1 } });
  again.socket.on.close({ code: 4001, reason: "" });
  listeners.pagehide.at(-1)();
  return { copied, left, resumed, ended: again.seen.changed.at(-1)[0], after: stored.get("relief-session") ?? null };
}

const parts = { bad_texts: badTexts, too_early: tooEarly, bad_frames: badFrames, no_frame: noFrame, tokens };
const seen = {};
// One after the other: the sockets are counted.
for (const [name, part] of Object.entries(parts)) seen[name] = await part();
console.log(JSON.stringify(seen));
process.exit(0);
