// Mouse, touch, pen, keyboard and gamepad as intents. Movements are added up and sent once for each picture of the screen.

const DEGREES_A_PIXEL = 0.35;
const CLICK_PIXELS = 4;
const KEYS = {
  ArrowLeft: { intent: "orbit", azimuth_deg: 5 },
  ArrowRight: { intent: "orbit", azimuth_deg: -5 },
  ArrowUp: { intent: "orbit", elevation_deg: -5 },
  ArrowDown: { intent: "orbit", elevation_deg: 5 },
  "+": { intent: "zoom", factor: 1.1 },
  "-": { intent: "zoom", factor: 1 / 1.1 },
  PageUp: { intent: "clip", by_mm: -5 },
  PageDown: { intent: "clip", by_mm: 5 },
  "[": { intent: "preset", step: -1 },
  "]": { intent: "preset", step: 1 },
  Home: { intent: "reset" },
  u: { intent: "undo" },
  n: { intent: "next_label" },
};
/** Of the standard gamepad: A places, B undoes, X the next label, Y resets, shoulders clip, the cross changes the preset. */
const BUTTONS = [
  { intent: "place", phase: "commit" }, { intent: "undo" }, { intent: "next_label" }, { intent: "reset" },
  { intent: "clip", by_mm: -5 }, { intent: "clip", by_mm: 5 }, null, null, null, null, null, null, null, null,
  { intent: "preset", step: -1 }, { intent: "preset", step: 1 },
];
const DEAD_ZONE = 0.15;

/** Sums of what is still to be sent. */
class Sum {
  #orbit = [0, 0];
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
      const [[azimuth_deg, elevation_deg], [right, up], factor] = [this.#orbit, this.#pan, this.#zoom];
      [this.#orbit, this.#pan, this.#zoom] = [[0, 0], [0, 0], 1];
      if (azimuth_deg || elevation_deg) this.send({ intent: "orbit", azimuth_deg, elevation_deg });
      if (right || up) this.send({ intent: "pan", right, up });
      if (factor !== 1) this.send({ intent: "zoom", factor });
    });
  }
}

/**
 * Listens on an element and the window. `send` takes an intent, `placeOf` gives the picture's pixel under a client position,
 * or null, and `keys` has what other keys do.
 */
export function onControls(element, { send, placeOf, keys }) {
  const sum = new Sum(send);
  onPointers(element, sum, (event) => {
    const at_px = placeOf(event.clientX, event.clientY);
    if (at_px) send({ intent: "cursor", at_px });
  });
  element.addEventListener("wheel", (event) => {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1);
    if (event.shiftKey) send({ intent: "clip", by_mm: Math.sign(pixels) * 5 });
    else sum.zoom(Math.exp(-pixels * 0.0015));
  }, { passive: false });
  element.addEventListener("dblclick", () => send({ intent: "reset" }));
  element.addEventListener("contextmenu", (event) => event.preventDefault());
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, dialog")) return;
    const intent = KEYS[event.key === "=" ? "+" : event.key];
    const other = keys[event.key];
    if (!intent && !other) return;
    event.preventDefault();
    if (intent) send(intent);
    else other();
  });
  onGamepads(sum, send);
}

/** One pointer turns, with Shift or the right button shifts; two fingers shift and zoom; a click is a click. */
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
    else sum.orbit(-dx * DEGREES_A_PIXEL, dy * DEGREES_A_PIXEL);
  });
  const release = (event) => {
    const known = pointers.delete(event.pointerId);
    if (known && !pointers.size && event.type === "pointerup" && travelled < CLICK_PIXELS) click(event);
  };
  element.addEventListener("pointerup", release);
  element.addEventListener("pointercancel", release);
}

/** The left stick turns, the right one shifts, the triggers zoom. Asked once a picture while there is a gamepad. */
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
      const zoom = (pad.buttons[7]?.value ?? 0) - (pad.buttons[6]?.value ?? 0);
      if (zoom) sum.zoom(Math.exp(zoom * seconds));
      const now_held = pad.buttons.map((button) => button.pressed);
      now_held.forEach((pressed, at) => pressed && !held[at] && BUTTONS[at] && send(BUTTONS[at]));
      held = now_held;
    }
    if (pads.length) requestAnimationFrame(ask);
  };
  addEventListener("gamepadconnected", () => requestAnimationFrame(ask));
}
