// Mouse, touch and wheel on the stage as gestures: turn, zoom, click, move the divider.

/** A press that moves less than this is a click, CSS pixels. */
const CLICK_PIXELS = 4;

/** Position in an element, as fractions of its width and height. */
function fractions(element, event) {
  const box = element.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
}

/** A gesture of two fingers: the ratio of their distances, and the movement of their midpoint, CSS pixels. */
export function pinch(before, after) {
  const apart = ([a, b]) => Math.max(1, Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY));
  const middle = ([a, b]) => [(a.clientX + b.clientX) / 2, (a.clientY + b.clientY) / 2];
  const [from, to] = [middle(before), middle(after)];
  return { ratio: apart(after) / apart(before), by: [to[0] - from[0], to[1] - from[1]], middle: { clientX: to[0], clientY: to[1] } };
}

/**
 * Calls back with gestures on the stage: `turn(dx, dy)` and `pan(dx, dy)` in CSS pixels, `zoom(ratio, { wheel, at })` with the
 * wheel event or the midpoint of two fingers, `click([x, y], event)` and `double()`. One finger turns, two zoom and pan; a mouse
 * with Shift or the right button pans, and passes its event.
 */
export function onGestures(stage, divider, { turn, pan, zoom, click, double }) {
  const pointers = new Map();
  let travelled = 0;
  let pinched = false;

  stage.addEventListener("pointerdown", (event) => {
    if (![0, 2].includes(event.button) || event.target === divider || event.target.closest("button, a")) return;
    stage.setPointerCapture(event.pointerId);
    if (pointers.size === 0) [travelled, pinched] = [0, false];
    pointers.set(event.pointerId, event);
    pinched ||= pointers.size > 1;
    stage.classList.add("turning");
  });

  stage.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const before = [...pointers.values()];
    pointers.set(event.pointerId, event);
    if (before.length === 2) {
      const { ratio, by, middle } = pinch(before, [...pointers.values()]);
      pan(...by);
      return zoom(ratio, { at: fractions(stage, middle) });
    }
    if (pinched) return; // the finger that is left after a pinch means nothing
    const [dx, dy] = [event.clientX - last.clientX, event.clientY - last.clientY];
    travelled += Math.hypot(dx, dy);
    if (travelled < CLICK_PIXELS) return;
    if (event.shiftKey || event.buttons & 2) pan(dx, dy, event);
    else turn(dx, dy);
  });

  const release = (event) => {
    if (!pointers.delete(event.pointerId) || pointers.size) return;
    stage.classList.remove("turning");
    const clicked = event.type === "pointerup" && event.button === 0 && !pinched && travelled < CLICK_PIXELS;
    if (clicked) click(fractions(stage, event), event);
  };
  stage.addEventListener("pointerup", release);
  stage.addEventListener("pointercancel", release);
  stage.addEventListener("contextmenu", (event) => event.preventDefault());

  stage.addEventListener("dblclick", (event) => {
    if (event.target !== divider) double();
  });

  const byWheel = (event) => {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1);
    zoom(Math.exp(-pixels * 0.0015), { wheel: event });
  };
  stage.addEventListener("wheel", byWheel, { passive: false });
}

/** Calls back with the position of the dragged or stepped divider, as a fraction of the stage's width. */
export function onDivider(stage, divider, moveTo) {
  divider.addEventListener("pointerdown", (event) => divider.setPointerCapture(event.pointerId));
  divider.addEventListener("pointermove", (event) => {
    if (divider.hasPointerCapture(event.pointerId)) moveTo(fractions(stage, event)[0]);
  });
  divider.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
    if (!step) return;
    event.preventDefault();
    moveTo(Number(divider.getAttribute("aria-valuenow")) / 100 + step);
  });
}
