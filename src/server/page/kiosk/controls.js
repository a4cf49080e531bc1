// Mouse, touch, pen, keyboard and gamepad as intents. Movements are accumulated and sent once for each
// frame of the screen.

const DEGREES_A_PIXEL = 0.35;
const CLICK_PIXELS = 4;
/** By key name, with the prefixes Shift+ and Ctrl+. */
const KEYS = {
  ArrowLeft: { intent: "orbit", azimuth_deg: 5 },
  ArrowRight: { intent: "orbit", azimuth_deg: -5 },
  ArrowUp: { intent: "orbit", elevation_deg: -5 },
  ArrowDown: { intent: "orbit", elevation_deg: 5 },
  "Shift+ArrowLeft": { intent: "pan", right: -0.05 },
  "Shift+ArrowRight": { intent: "pan", right: 0.05 },
  "Shift+ArrowUp": { intent: "pan", up: 0.05 },
  "Shift+ArrowDown": { intent: "pan", up: -0.05 },
  "+": { intent: "zoom", factor: 1.1 },
  "=": { intent: "zoom", factor: 1.1 },
  "-": { intent: "zoom", factor: 1 / 1.1 },
  PageUp: { intent: "clip", by_mm: -5 },
  PageDown: { intent: "clip", by_mm: 5 },
  "[": { intent: "preset", step: -1 },
  "]": { intent: "preset", step: 1 },
  Enter: { intent: "place", phase: "commit" },
  Home: { intent: "reset" },
  0: { intent: "reset" },
  "Ctrl+z": { intent: "undo" },
  l: { intent: "next_label" },
};
/** Buttons of the standard gamepad: A, B, X, Y, shoulders, triggers, select, start, sticks, cross. */
const BUTTONS = [
  { intent: "place", phase: "commit" }, { intent: "undo" }, null, { intent: "next_label" },
  null, null, null, null, null, { intent: "reset" }, null, null,
  { intent: "clip", by_mm: -5 }, { intent: "clip", by_mm: 5 }, { intent: "preset", step: -1 }, { intent: "preset", step: 1 },
];
const SHOULDERS = [4, 5];
const TRIGGERS = [6, 7];
const DEAD_ZONE = 0.15;

/** Accumulated movements to send. */
class Sum {
  #orbit = [0, 0];
  #roll = 0;
  #pan = [0, 0];
  #zoom = 1;
  #due = false;

  constructor(send) {
    this.send = send;
  }

  orbit(azimuth, elevation) {
    this.#orbit = [this.#orbit[0] + azimuth, this.#orbit[1] + elevation];
    this.#later();
  }

  /** Rotation about the viewing axis; positive is counter-clockwise. */
  roll(degrees) {
    this.#roll += degrees;
    this.#later();
  }

  pan(right, up) {
    this.#pan = [this.#pan[0] + right, this.#pan[1] + up];
    this.#later();
  }

  zoom(factor) {
    this.#zoom *= factor;
    this.#later();
  }

  #later() {
    if (this.#due) return;
    this.#due = true;
    requestAnimationFrame(() => {
      this.#due = false;
      const [[azimuth_deg, elevation_deg], roll, [right, up], factor] = [this.#orbit, this.#roll, this.#pan, this.#zoom];
      [this.#orbit, this.#roll, this.#pan, this.#zoom] = [[0, 0], 0, [0, 0], 1];
      if (azimuth_deg || elevation_deg) this.send({ intent: "orbit", azimuth_deg, elevation_deg });
      const half = (roll * Math.PI) / 360;
      if (roll) this.send({ intent: "turn", rotation_xyzw: [0, 0, Math.sin(half), Math.cos(half)] });
      if (right || up) this.send({ intent: "pan", right, up });
      if (factor !== 1) this.send({ intent: "zoom", factor });
    });
  }
}

/**
 * Listens on an element and the window. `send` takes an intent, `placeOf` returns the picture's pixel at a client position
 * or null, and `keys` has the actions of other keys.
 */
export function onControls(element, { send, placeOf, keys }) {
  const sum = new Sum(send);
  onPointers(element, sum, (event) => {
    const at_px = placeOf(event.clientX, event.clientY);
    if (!at_px) return;
    send({ intent: "cursor", at_px });
    if (event.ctrlKey) send({ intent: "place", phase: "commit" });
  });
  element.addEventListener("wheel", (event) => {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1);
    if (event.ctrlKey) send({ intent: "clip", by_mm: Math.sign(pixels) * 5 });
    else sum.zoom(Math.exp(-pixels * 0.0015));
  }, { passive: false });
  element.addEventListener("dblclick", () => send({ intent: "reset" }));
  element.addEventListener("contextmenu", (event) => event.preventDefault());
  addEventListener("keydown", (event) => {
    if (event.metaKey || event.altKey || event.target.closest("input, select, dialog")) return;
    const held = `${event.ctrlKey ? "Ctrl+" : ""}${event.shiftKey && event.key.length > 1 ? "Shift+" : ""}`;
    const intent = KEYS[held + event.key];
    const other = keys[held + event.key];
    if (!intent && !other) return;
    event.preventDefault();
    if (intent) send(intent);
    else other();
  });
  onGamepads(sum, send);
}

/** One pointer rotates, with Alt freely; with Shift or the right button it translates. Two fingers translate and zoom. */
function onPointers(element, sum, click) {
  const pointers = new Map();
  let travelled = 0;
  const middle = () => {
    const all = [...pointers.values()];
    return [0, 1].map((axis) => all.reduce((total, p) => total + (axis ? p.clientY : p.clientX), 0) / all.length);
  };
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.max(1, Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY));
  };
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    if (pointers.size === 0) travelled = 0;
    pointers.set(event.pointerId, event);
  });
  element.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    const two = pointers.size === 2;
    const [before, apart] = [middle(), two ? spread() : 1];
    pointers.set(event.pointerId, event);
    const after = middle();
    const [dx, dy] = [after[0] - before[0], after[1] - before[1]];
    travelled += two ? CLICK_PIXELS : Math.hypot(dx, dy);
    if (travelled < CLICK_PIXELS) return;
    // The picture's height is that of the element: half the frame's width, all of its height.
    const height = element.clientHeight;
    if (two) sum.zoom(spread() / apart);
    if (two || event.shiftKey || event.buttons & 2) sum.pan(dx / height, -dy / height);
    else if (event.altKey) sum.roll(-dx * DEGREES_A_PIXEL);
    else sum.orbit(-dx * DEGREES_A_PIXEL, dy * DEGREES_A_PIXEL);
  });
  const release = (event) => {
    const known = pointers.delete(event.pointerId);
    if (known && !pointers.size && event.type === "pointerup" && travelled < CLICK_PIXELS) click(event);
  };
  element.addEventListener("pointerup", release);
  element.addEventListener("pointercancel", release);
}

/** The left stick rotates, the right one translates, shoulders roll, triggers zoom. Polled once for each frame. */
function onGamepads(sum, send) {
  let held = [];
  let last = 0;
  const axis = (value) => (Math.abs(value) < DEAD_ZONE ? 0 : value);
  const ask = (now) => {
    const pads = navigator.getGamepads().filter((pad) => pad?.mapping === "standard");
    const seconds = Math.min(0.1, (now - last) / 1000);
    last = now;
    for (const pad of pads) {
      const [x, y, right, down] = pad.axes.map(axis);
      if (x || y) sum.orbit(-x * 120 * seconds, y * 120 * seconds);
      if (right || down) sum.pan(right * seconds, -down * seconds);
      const difference = ([less, more]) => (pad.buttons[more]?.value ?? 0) - (pad.buttons[less]?.value ?? 0);
      if (difference(TRIGGERS)) sum.zoom(Math.exp(difference(TRIGGERS) * seconds));
      if (difference(SHOULDERS)) sum.roll(-difference(SHOULDERS) * 60 * seconds);
      const heldNow = pad.buttons.map((button) => button.pressed);
      heldNow.forEach((pressed, at) => pressed && !held[at] && BUTTONS[at] && send(BUTTONS[at]));
      held = heldNow;
    }
    if (pads.length) requestAnimationFrame(ask);
  };
  addEventListener("gamepadconnected", () => requestAnimationFrame(ask));
}
