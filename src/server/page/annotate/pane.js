// A pane: a picture of the volume, a layer for regions and meshes, an SVG layer for the rest;
// pointers and wheel on it.
//
// The two kinds of panes, `slice-pane.js` and `volume-pane.js`, define the content and the
// positions in it.

import { pinch } from "/gestures.js";
import { Fetcher, stillSize } from "/view.js";

/** A press that moves less than this is a click, CSS pixels. */
const CLICK_PIXELS = 4;
/** Pause after the last change before a complete picture is requested, ms. */
const STILL_MS = 180;

const SVG = "http://www.w3.org/2000/svg";

export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (key in made && key !== "list") made[key] = value;
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

export class Pane {
  #stillTimer = 0;
  #pointers = new Map();
  #gesture = null;
  #frame = 0;

  /** `hand` handles gestures first (see `hand.js`); `fail` gets errors. */
  constructor(host, { name, title, keys }, { model, hand, fail }) {
    Object.assign(this, { name, title, model, hand, shown: null, projection: null, fail });
    this.picture = element("canvas", { className: "picture" });
    this.picture.setAttribute("role", "img");
    this.picture.setAttribute("aria-label", `Picture, ${title}`);
    this.layer = element("canvas", { className: "layer" });
    this.layer.setAttribute("aria-hidden", "true");
    this.svg = document.createElementNS(SVG, "svg");
    this.svg.classList.add("overlay");
    this.svg.setAttribute("aria-hidden", "true");
    [this.crossLayer, this.itemLayer] = [0, 1].map(() => this.svg.appendChild(document.createElementNS(SVG, "g")));
    this.edges = Object.fromEntries(["top", "right", "bottom", "left"].map((edge) => [edge, element("span", { className: `edge edge-${edge}` })]));
    this.at = element("span", { className: "pane-at" });
    const big = element("button", {
      className: "pane-big", type: "button", title: `Enlarge ${title} (double click, Z)`, ariaLabel: `Enlarge ${title}`,
      onclick: () => this.enlarge(),
    });
    big.innerHTML = '<svg viewBox="0 0 20 20" aria-hidden="true"><path d="M3 8V3h5M12 3h5v5M17 12v5h-5M8 17H3v-5"/></svg>';
    this.busyBar = element("div", { className: "busy" });
    this.hint = element("p", { className: "for-readers", id: `keys-${name}` }, keys);
    this.bar = element("header", { className: "pane-bar" }, element("b", {}, title), this.at);
    this.root = element(
      "section", { className: `pane pane-${name}`, tabIndex: 0, ariaLabel: title },
      this.picture, this.layer, this.svg, ...Object.values(this.edges), this.bar, big, this.hint, this.busyBar,
    );
    this.root.dataset.pane = name;
    this.root.setAttribute("aria-describedby", `keys-${name}`);
    host.append(this.root);
    this.context = this.picture.getContext("2d", { alpha: false });
    this.fetcher = new Fetcher((picture) => this.#show(picture), fail, (busy) => this.busyBar.classList.toggle("on", busy));
    this.#listen();
    new ResizeObserver(() => this.#resized()).observe(this.root);
  }

  get size() {
    return [this.root.clientWidth, this.root.clientHeight];
  }

  /** Size of a still picture, pixels. */
  get pixels() {
    return stillSize(...this.size, Math.min(2, devicePixelRatio));
  }

  enlarge() {
    const grid = this.root.parentElement;
    const large = grid.dataset.large === this.name ? "" : this.name;
    grid.dataset.large = large;
    for (const pane of grid.children) pane.classList.toggle("large", pane.dataset.pane === large);
  }

  /** Requests a picture of the current state, unless it is displayed already. */
  refresh(moving = false) {
    if (!this.model.volume || this.root.clientWidth < 24) return;
    clearTimeout(this.#stillTimer);
    if (moving) this.#stillTimer = setTimeout(() => this.refresh(), STILL_MS);
    const order = { ...this.order(moving), moving };
    if (!this.#isShown(order)) this.fetcher.want(order);
  }

  /** Whether this picture, or the complete one of the same view, is displayed and will not be replaced by a late answer. */
  #isShown({ url, moving }) {
    return !this.fetcher.isBusy && this.shown?.url === url && (moving || !this.shown.moving);
  }

  /** Draws all layers over the picture, once for all changes before the next frame of the screen. */
  draw() {
    if (this.#frame) return;
    this.#frame = requestAnimationFrame(() => {
      this.#frame = 0;
      if (this.projection && this.root.clientWidth > 0) this.overlay();
    });
  }

  #resized() {
    clearTimeout(this.#stillTimer);
    this.#stillTimer = setTimeout(() => this.refresh(), 100);
    this.draw();
  }

  #show(picture) {
    this.shown?.bitmap.close();
    this.shown = picture;
    this.projection = this.projectionOf(picture);
    this.paint(picture);
    for (const edge of Object.keys(this.edges)) this.edges[edge].textContent = picture.camera?.edges[edge] ?? "";
    // For scripts that drive the page: the number of pictures, and whether the last one is complete.
    this.root.dataset.pictures = Number(this.root.dataset.pictures ?? 0) + 1;
    this.root.dataset.still = String(!picture.moving);
    this.draw();
    this.cine?.shown();
  }

  /** Draws a picture on the whole canvas. */
  paint({ bitmap }, width = bitmap.width) {
    if (this.picture.width !== width || this.picture.height !== bitmap.height) {
      Object.assign(this.picture, { width, height: bitmap.height });
    }
    this.context.drawImage(bitmap, 0, 0);
  }

  /** Fractions of the picture's width and height; a pixel is represented by its centre. */
  fractions(event) {
    const box = this.root.getBoundingClientRect();
    const half = 0.5 / devicePixelRatio;
    return [(event.clientX + half - box.left) / box.width, (event.clientY + half - box.top) / box.height];
  }

  #listen() {
    const { root } = this;
    root.addEventListener("pointerdown", (event) => this.#down(event));
    root.addEventListener("pointermove", (event) => this.#move(event));
    root.addEventListener("pointerup", (event) => this.#up(event));
    root.addEventListener("pointercancel", (event) => this.#up(event));
    root.addEventListener("contextmenu", (event) => event.preventDefault());
    root.addEventListener("dblclick", (event) => !event.target.closest("button") && this.hand.double(this) === false && this.enlarge());
    const byWheel = (event) => {
      event.preventDefault();
      const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1);
      this.wheel(pixels, event);
    };
    root.addEventListener("wheel", byWheel, { passive: false });
  }

  #down(event) {
    if (event.target.closest("button")) return;
    this.root.focus({ preventScroll: true });
    this.root.setPointerCapture(event.pointerId);
    this.#pointers.set(event.pointerId, event);
    if (this.#pointers.size > 1) {
      this.hand.cancel();
      this.#gesture = { kind: "pinch" };
      return;
    }
    const navigates = event.button !== 0 || event.altKey;
    const taken = !navigates && this.hand.down(this, this.fractions(event), event);
    this.#gesture = { kind: taken ? "hand" : "look", button: event.button, travelled: 0 };
    if (!taken) this.root.classList.add("turning");
  }

  #move(event) {
    const last = this.#pointers.get(event.pointerId);
    if (!last) return this.hand.hover(this, this.fractions(event), event);
    const before = [...this.#pointers.values()];
    this.#pointers.set(event.pointerId, event);
    const gesture = this.#gesture;
    if (gesture?.kind === "pinch") {
      if (before.length !== 2) return;
      const { ratio, by, middle } = pinch(before, [...this.#pointers.values()]);
      this.pan(by);
      this.zoom(ratio, this.fractions(middle));
    } else if (gesture?.kind === "hand") {
      this.hand.move(this, this.fractions(event), event);
    } else if (gesture?.kind === "look") {
      const [dx, dy] = [event.clientX - last.clientX, event.clientY - last.clientY];
      gesture.travelled += Math.hypot(dx, dy);
      if (gesture.travelled >= CLICK_PIXELS) this.drag([dx, dy], gesture, event);
    }
  }

  #up(event) {
    if (!this.#pointers.delete(event.pointerId) || this.#pointers.size) return;
    const gesture = this.#gesture;
    this.#gesture = null;
    this.root.classList.remove("turning");
    if (event.type === "pointercancel") return this.hand.cancel();
    if (gesture?.kind === "hand") this.hand.up(this, this.fractions(event), event);
    else if (gesture?.kind === "look" && gesture.travelled < CLICK_PIXELS && gesture.button === 0) this.click(this.fractions(event));
  }
}
