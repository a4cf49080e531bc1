// The page that makes a phone a wand: its orientation turns the volume and moves the cursor of a
// view, through the same intents as every other input device.
//
// The address names the view, and has a ticket where the server knows its callers. The page takes no
// frames: it acknowledges none, so the server sends it two and no more.

import { earthFromPhone, earthFromSpace, headingOf, pitchOf, viewFromPhone, viewFromSpace } from "./attitude.js";
import { readHeader } from "./frame.js";
import { canTrack, track } from "./space.js";

const $ = (id) => document.getElementById(id);
const parameters = new URLSearchParams(location.search);
/** Turn of the phone that moves the cursor by the picture's height, degrees. */
const DEGREES_A_HEIGHT = 30;
/** While Place is held, the cursor moves by this share of that. */
const PRECISE_GAIN = 0.2;
/** Drag on the pad that moves the cursor by the picture's height, CSS pixels. */
const PAD_A_HEIGHT = 900;
const BUZZ_MS = 20;
/** Landmarks go to the steepest rise of values near the cursor. */
const SNAP = { to: "gradient", radius_mm: 3 };

let seq = 0;
/** Full size of the picture, pixels. */
let full = null;
/** Place of the cursor in the picture, pixels. */
let cursor = null;
/** The newest attitude of the phone. */
let earth = null;
/** Where the phone is, m, while the browser tracks it in space; the end of that. */
let position = null;
let endTracking = null;
/** Whether the view was set to keep annotations. */
let places = false;
/** The button that is held (Turn or Point), and the attitude and the cursor at its beginning. */
let held = null;
/** The same of Place. */
let placing = null;

// ---------------------------------------------------------------- session

const url = new URL("/v1/session", location.href);
url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
for (const key of ["view", "ticket"]) if (parameters.has(key)) url.searchParams.set(key, parameters.get(key));
const socket = new WebSocket(url, "relief.v1");
socket.binaryType = "arraybuffer";

function send(message) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function intent(name, more = {}) {
  seq += 1;
  send({ type: "intent", seq, t_ns: Math.round(performance.now() * 1e6), intent: name, ...more });
}

function say(text, isBad = false) {
  $("state").textContent = text;
  $("state").classList.toggle("bad", isBad);
}

socket.addEventListener("open", () => {
  // The ticket says who places landmarks, where the server knows its callers.
  const author = parameters.has("ticket") ? {} : { author: localStorage.getItem("relief-author") ?? "phone" };
  const hello = { type: "hello", client: "relief wand", ...author, view: parameters.get("view"), role: "presenter" };
  send({ ...hello, accept: { color: ["jpeg"], depth: ["none"] } });
});
socket.addEventListener("message", ({ data }) => {
  if (typeof data !== "string") return learn(data);
  const message = JSON.parse(data);
  if (message.type === "welcome") {
    say(`Connected to ${message.view}`);
    document.documentElement.dataset.connection = "live";
  }
  if (message.type === "error") say(message.problem.detail ?? message.problem.title, true);
});
socket.addEventListener("close", ({ reason }) => {
  const again = parameters.has("ticket") ? "Scan a new code on the display." : "Load this page again.";
  say(`Not connected. ${reason ? `${reason} ` : ""}${again}`, true);
  document.documentElement.dataset.connection = "ended";
  for (const button of document.querySelectorAll("button")) button.disabled = true;
});

/** Learns the size of the picture from a frame. */
function learn(buffer) {
  try {
    full = readHeader(buffer).full;
    cursor ??= full.map((side) => side / 2);
  } catch (error) {
    say(error.message, true);
  }
}

// ---------------------------------------------------------------- sensors

function sense(event) {
  if (event.alpha === null || endTracking) return; // a machine without sensors, or a better one
  earth = earthFromPhone(event);
  $("sensors").hidden = true;
  document.documentElement.dataset.sensors = "on";
  move();
}

/** Listens to the sensors. Some browsers give them only after a tap and a question: `sense` hides the button where they come without. */
function listen() {
  if (!isSecureContext) {
    $("hint").textContent = "A page without https has no sensors. Use the pad; relief serve --tls-self-signed serves https.";
    return;
  }
  addEventListener("deviceorientation", sense);
  const ask = window.DeviceOrientationEvent?.requestPermission;
  $("sensors").hidden = !ask;
  $("sensors").addEventListener("click", async () => {
    if ((await ask.call(window.DeviceOrientationEvent)) !== "granted") {
      $("hint").textContent = "The browser refuses the sensors. Use the pad.";
      return;
    }
    removeEventListener("deviceorientation", sense);
    addEventListener("deviceorientation", sense); // again: the first was added without permission
  });
}

/** Takes poses in space in place of the sensors, until it is pressed again. */
async function trackInSpace() {
  if (endTracking) return endTracking();
  const follow = (pose) => {
    $("hint").textContent = pose ? "Turn moves the volume, too." : "The phone does not know where it is. Point it at something with edges.";
    if (!pose) return;
    [earth, position] = [earthFromSpace(pose.orientation), pose.position];
    document.documentElement.dataset.sensors = "space";
    move();
  };
  const ended = () => {
    release();
    [position, endTracking] = [null, null];
    $("space").setAttribute("aria-pressed", "false");
    $("hint").textContent = "Hold a button and move the phone.";
  };
  try {
    endTracking = await track(document.body, follow, ended);
    $("space").setAttribute("aria-pressed", "true");
  } catch (error) {
    $("hint").textContent = `The phone cannot be tracked in space: ${error.message}`;
  }
}

canTrack().then((can) => {
  $("space").hidden = !can;
});
$("space").addEventListener("click", trackInSpace);

// ---------------------------------------------------------------- commands

/** The hand for `grab` and `move`: where and how the phone is held, in the axes of the view. */
function hand({ heading }) {
  const position_mm = position ? viewFromSpace(position, heading).map((metres) => 1000 * metres) : [0, 0, 0];
  return { position_mm, orientation_xyzw: viewFromPhone(earth, heading) };
}

/** The attitude and the cursor from which a movement starts. */
const anchor = () => (earth ? { heading: headingOf(earth), pitch: pitchOf(earth), cursor } : {});

function hold(name) {
  if (!earth) {
    $("hint").textContent = "No sensor has answered yet. Use the pad.";
    return;
  }
  held = { name, ...anchor() };
  $(name).classList.add("held");
  if (name === "turn") intent("grab", { ...hand(held), mode: position ? "both" : "rotate" });
}

function release() {
  if (held?.name === "turn") intent("release");
  if (held) $(held.name).classList.remove("held");
  held = null;
}

function move() {
  if (held?.name === "turn") intent("move", hand(held));
  if (placing?.cursor) pointFrom(placing, PRECISE_GAIN);
  else if (held?.name === "point" && held.cursor) pointFrom(held, 1);
}

/** Moves the cursor from an anchor by a share of the phone's turn. */
function pointFrom({ heading, pitch, cursor: from }, gain) {
  // Headings grow to the left; the difference is the short way round.
  const left = ((headingOf(earth) - heading + 540) % 360) - 180;
  const up = pitchOf(earth) - pitch;
  moveCursor(from, [-left, -up].map((degrees) => (gain * degrees) / DEGREES_A_HEIGHT));
}

/** Moves the cursor from a place by fractions of the picture's height, right and down; it stays in the picture. */
function moveCursor(from, by) {
  if (!from) return;
  cursor = from.map((px, axis) => Math.min(full[axis], Math.max(0, px + by[axis] * full[1])));
  intent("cursor", { at_px: cursor });
}

for (const name of ["turn", "point"]) {
  $(name).addEventListener("pointerdown", (event) => {
    event.currentTarget.setPointerCapture(event.pointerId);
    hold(name);
  });
  for (const end of ["pointerup", "pointercancel"]) $(name).addEventListener(end, release);
}

/** Begins to place a landmark, with a preview: the view keeps annotations from the first one on. */
function beginPlacing() {
  if (!places) send({ type: "settings", annotations: true, snap: SNAP });
  places = true;
  placing = anchor();
  $("place").classList.add("held");
  intent("place", { phase: "preview" });
}

/** Places the landmark, or nothing. Point goes on from here. */
function endPlacing(phase) {
  if (!placing) return;
  placing = null;
  $("place").classList.remove("held");
  intent("place", { phase });
  if (held?.name === "point") held = { name: "point", ...anchor() };
  if (phase === "commit") buzz();
}

const buzz = () => navigator.vibrate?.(BUZZ_MS);
const BUTTONS = {
  undo: ["undo"], next: ["next_label"], reset: ["reset"],
  "previous-preset": ["preset", { step: -1 }], "next-preset": ["preset", { step: 1 }],
};
for (const [id, [name, more]] of Object.entries(BUTTONS)) {
  $(id).addEventListener("click", () => {
    intent(name, more);
    buzz();
  });
}

$("place").addEventListener("pointerdown", (event) => {
  event.currentTarget.setPointerCapture(event.pointerId);
  beginPlacing();
});
$("place").addEventListener("pointerup", () => endPlacing("commit"));
$("place").addEventListener("pointercancel", () => endPlacing("cancel"));
// A key presses the button without a pointer.
$("place").addEventListener("click", ({ detail }) => {
  if (detail > 0) return;
  beginPlacing();
  endPlacing("commit");
});

// ---------------------------------------------------------------- pad

const fingers = new Map();
const spread = () => {
  const [a, b] = [...fingers.values()];
  return Math.max(1, Math.hypot(a.x - b.x, a.y - b.y));
};
$("pad").addEventListener("pointerdown", ({ pointerId, clientX, clientY, currentTarget }) => {
  currentTarget.setPointerCapture(pointerId);
  fingers.set(pointerId, { x: clientX, y: clientY });
});
$("pad").addEventListener("pointermove", ({ pointerId, clientX, clientY }) => {
  const before = fingers.get(pointerId);
  if (!before) return;
  const apart = fingers.size === 2 ? spread() : null;
  fingers.set(pointerId, { x: clientX, y: clientY });
  if (apart) return intent("zoom", { factor: spread() / apart });
  moveCursor(cursor, [(clientX - before.x) / PAD_A_HEIGHT, (clientY - before.y) / PAD_A_HEIGHT]);
});
for (const end of ["pointerup", "pointercancel"]) $("pad").addEventListener(end, ({ pointerId }) => fingers.delete(pointerId));

listen();
