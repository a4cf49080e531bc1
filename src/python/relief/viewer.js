// The browser's part of relief.Viewer: shows frames of a live session and sends commands (docs/LIVE.md).
//
// Messages pass through the kernel, which numbers commands. Frames are JPEG without depth.

const HEADER_BYTES = 128;
const DEGREES_A_PIXEL = 0.4;
const CLICK_PIXELS = 4;
/** When a message is sent again that had no effect, and how often: Jupyter may lose a message. */
const REPEAT_MS = 500;
const MOST_REPEATS = 3;
const KEYS = {
  ArrowLeft: { intent: "orbit", azimuth_deg: 5 },
  ArrowRight: { intent: "orbit", azimuth_deg: -5 },
  ArrowUp: { intent: "orbit", elevation_deg: -5 },
  ArrowDown: { intent: "orbit", elevation_deg: 5 },
  "+": { intent: "zoom", factor: 1.1 },
  "-": { intent: "zoom", factor: 1 / 1.1 },
  Home: { intent: "reset" },
};

/** Sequence number, full size and JPEG of a frame. */
function readFrame(view) {
  const header = new DataView(view.buffer, view.byteOffset, HEADER_BYTES);
  if (header.getUint32(0, false) !== 0x524c4956) throw new Error("this is no frame of relief.v1");
  const length = header.getUint32(72, true);
  return {
    sequence: header.getUint32(12, true),
    full: [header.getUint16(52, true), header.getUint16(54, true)],
    jpeg: new Blob([new Uint8Array(view.buffer, view.byteOffset + HEADER_BYTES, length)], { type: "image/jpeg" }),
  };
}

function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

/** Sums movements until the next frame of the browser, and sends them as commands. */
function movements(send) {
  let sum = null;
  return (change) => {
    if (!sum) {
      sum = { turn: [0, 0], pan: [0, 0], factor: 1 };
      requestAnimationFrame(() => {
        const { turn, pan, factor } = sum;
        sum = null;
        if (turn.some(Boolean)) send({ intent: "orbit", azimuth_deg: turn[0], elevation_deg: turn[1] });
        if (pan.some(Boolean)) send({ intent: "pan", right: pan[0], up: pan[1] });
        if (factor !== 1) send({ intent: "zoom", factor });
      });
    }
    change(sum);
  };
}

/** Turns pointer, wheel and keys on the canvas into commands. */
function listen(canvas, send) {
  const move = movements(send);
  let travelled = 0;
  canvas.addEventListener("pointerdown", (event) => {
    travelled = 0;
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!canvas.hasPointerCapture(event.pointerId)) return;
    const [dx, dy] = [event.movementX, event.movementY];
    travelled += Math.hypot(dx, dy);
    if (travelled < CLICK_PIXELS) return;
    const height = canvas.clientHeight;
    move((sum) => {
      const moves = event.shiftKey || event.buttons & 2;
      const [to, x, y] = moves ? [sum.pan, dx / height, -dy / height] : [sum.turn, -dx * DEGREES_A_PIXEL, dy * DEGREES_A_PIXEL];
      to[0] += x;
      to[1] += y;
    });
  });
  canvas.addEventListener("pointerup", (event) => {
    if (travelled >= CLICK_PIXELS || event.button !== 0) return;
    const box = canvas.getBoundingClientRect();
    const at = [((event.clientX - box.left) / box.width) * canvas.width, ((event.clientY - box.top) / box.height) * canvas.height];
    send({ intent: "cursor", at_px: at.map(Math.floor) });
  });
  canvas.addEventListener("dblclick", () => send({ intent: "reset" }));
  canvas.addEventListener("contextmenu", (event) => {
    event.preventDefault();
    event.stopPropagation();
  });
  const wheel = (event) => {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1);
    move((sum) => { sum.factor *= Math.exp(-pixels * 0.0015); });
  };
  canvas.addEventListener("wheel", wheel, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const intent = KEYS[event.key];
    if (!intent || event.ctrlKey || event.altKey || event.metaKey) return;
    // Jupyter would move to another cell.
    event.preventDefault();
    event.stopPropagation();
    send(intent);
  });
}

/** The menu of presets, bound to the model. */
function presetMenu(model, follow) {
  const options = model.get("_presets").map((name) => element("option", { value: name, textContent: name }));
  const menu = element("select", {}, element("option", { value: "", textContent: "automatic", hidden: true }), ...options);
  // A message, not a change of the model: Jupyter holds such changes back until it has heard of the last one.
  let repeat = null;
  const choose = (repeats = MOST_REPEATS) => {
    clearTimeout(repeat);
    model.send({ type: "preset", name: menu.value });
    if (repeats > 0) repeat = setTimeout(() => { if (model.get("preset") !== menu.value) choose(repeats - 1); }, REPEAT_MS);
  };
  menu.addEventListener("change", () => choose());
  follow("change:preset", () => { menu.value = model.get("preset") ?? ""; });
  return element("label", {}, "Preset ", menu);
}

function render({ model, el }) {
  const [width, height] = model.get("_size");
  const label = "Live view of the volume: arrow keys turn it, plus and minus zoom, Home resets it";
  const canvas = element("canvas", { width, height, tabIndex: 0, className: "relief-picture" });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", label);
  const status = element("output", { className: "relief-status" });
  const reset = element("button", { type: "button", textContent: "Reset view" });
  const send = (intent) => model.send({ type: "intent", ...intent });
  const followed = [];
  const follow = (event, act) => {
    model.on(event, act);
    followed.push([event, act]);
    if (event.startsWith("change:")) act();
  };

  // A frame that is not acknowledged stops the next ones, so a lost message is repeated.
  let repeat = null;
  const acknowledge = (frame, repeats = MOST_REPEATS) => {
    clearTimeout(repeat);
    model.send({ type: "ack", frame, t_ns: Math.round(performance.now() * 1e6) });
    if (repeats > 0) repeat = setTimeout(() => acknowledge(frame, repeats - 1), REPEAT_MS);
  };

  const context = canvas.getContext("2d", { alpha: false });
  let newest = null;
  let drawing = false;
  const show = async (view) => {
    newest = view;
    if (drawing) return;
    drawing = true;
    while (newest) {
      const { sequence, full, jpeg } = readFrame(newest);
      newest = null;
      const bitmap = await createImageBitmap(jpeg);
      if (canvas.width !== full[0] || canvas.height !== full[1]) [canvas.width, canvas.height] = full;
      context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
      bitmap.close();
      canvas.dataset.frame = sequence;
      acknowledge(sequence);
    }
    drawing = false;
  };

  listen(canvas, send);
  reset.addEventListener("click", () => send({ intent: "reset" }));
  follow("msg:custom", (message, buffers) => { if (message.type === "frame") show(buffers[0]); });
  const menu = presetMenu(model, follow);
  const say = () => {
    const cursor = model.get("cursor_mm");
    status.textContent = model.get("error") || (cursor ? `Cursor: ${cursor.map((mm) => mm.toFixed(1)).join(", ")} mm (LPS)` : "");
  };
  follow("change:error", say);
  follow("change:cursor_mm", say);
  el.classList.add("relief-viewer");
  el.append(canvas, element("div", { className: "relief-bar" }, menu, reset, status));
  model.send({ type: "ready" });
  return () => {
    clearTimeout(repeat);
    followed.forEach(([event, act]) => model.off(event, act));
  };
}

export default { render };
