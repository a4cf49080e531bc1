// Mouse, touch and wheel on the stage, in terms of what they mean: turn, zoom, click, move the divider.

/** A press that travels less than this is a click, CSS pixels. */
const CLICK_PIXELS = 4;

/** Position in an element, as fractions of its width and height. */
function fractions(element, event) {
  const box = element.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
}

/**
 * Calls back with what is done on the stage: `turn(dx, dy)` in CSS pixels, `zoom(ratio, wheel)` with the event of a
 * wheel, `click([x, y])` and
 * `double()`. One finger turns, two zoom.
 */
export function onGestures(stage, divider, { turn, zoom, click, double }) {
  const pointers = new Map();
  let travelled = 0;
  let pinched = false;

  const pinchLength = () => {
    const [a, b] = [...pointers.values()];
    return Math.max(1, Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY));
  };

  stage.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || event.target === divider) return;
    stage.setPointerCapture(event.pointerId);
    if (pointers.size === 0) [travelled, pinched] = [0, false];
    pointers.set(event.pointerId, event);
    pinched ||= pointers.size > 1;
    stage.classList.add("turning");
  });

  stage.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const before = pointers.size === 2 ? pinchLength() : 0;
    pointers.set(event.pointerId, event);
    if (before) return zoom(pinchLength() / before);
    if (pinched) return; // the finger that is left after a pinch means nothing
    const [dx, dy] = [event.clientX - last.clientX, event.clientY - last.clientY];
    travelled += Math.hypot(dx, dy);
    if (travelled >= CLICK_PIXELS) turn(dx, dy);
  });

  const release = (event) => {
    if (!pointers.delete(event.pointerId) || pointers.size) return;
    stage.classList.remove("turning");
    if (event.type === "pointerup" && !pinched && travelled < CLICK_PIXELS) click(fractions(stage, event));
  };
  stage.addEventListener("pointerup", release);
  stage.addEventListener("pointercancel", release);

  stage.addEventListener("dblclick", (event) => {
    if (event.target !== divider) double();
  });

  const byWheel = (event) => {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1);
    zoom(Math.exp(-pixels * 0.0015), event);
  };
  stage.addEventListener("wheel", byWheel, { passive: false });
}

/** Calls back with where the divider is dragged or stepped to, as a fraction of the stage's width. */
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
