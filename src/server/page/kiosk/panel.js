// A canvas whose pixels are the panel's: one pixel of the frame on one of the screen; and the
// detection of anything that prevents it.
//
// No step may convert colours. The canvas is sRGB, like all untagged content, so its
// numbers reach the panel unchanged if the browser treats the screen as sRGB. A page cannot read
// the screen, but it can detect another colour space.

import { isHeader, readBytes } from "./frame.js";

export class Panel {
  #context;
  #device = [0, 0];

  /** Calls `changed` when the screen or its scaling changes. */
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.#context = canvas.getContext("2d", { alpha: false, colorSpace: "srgb", willReadFrequently: true });
    const observer = new ResizeObserver(([entry]) => {
      const [box] = entry.devicePixelContentBoxSize ?? [];
      const { width, height } = entry.contentRect;
      const scaled = [width, height].map((side) => Math.round(side * devicePixelRatio));
      this.#device = box ? [box.inlineSize, box.blockSize] : scaled;
      changed();
    });
    try {
      observer.observe(canvas, { box: "device-pixel-content-box" });
    } catch {
      observer.observe(canvas);
    }
    for (const query of ["(color-gamut: p3)", "(dynamic-range: high)"]) matchMedia(query).addEventListener("change", changed);
  }

  /** Displays a frame, ImageData or a canvas, each of its pixels on one of the screen. */
  show(image) {
    const { canvas } = this;
    if (canvas.width !== image.width || canvas.height !== image.height) {
      [canvas.width, canvas.height] = [image.width, image.height];
    }
    // The ratio may have changed with the window's screen.
    const sides = [image.width, image.height].map((side) => `${side / devicePixelRatio}px`);
    [canvas.style.width, canvas.style.height] = sides;
    if (image instanceof ImageData) this.#context.putImageData(image, 0, 0);
    else this.#context.drawImage(image, 0, 0);
  }

  /** The frame's pixel under a client position; null outside. */
  pixelAt(x, y) {
    const box = this.canvas.getBoundingClientRect();
    const at = [((x - box.left) / box.width) * this.canvas.width, ((y - box.top) / box.height) * this.canvas.height];
    return at[0] >= 0 && at[1] >= 0 && at[0] < this.canvas.width && at[1] < this.canvas.height ? at : null;
  }

  /** The reasons why the frame does not reach the panel unchanged; empty if it does. `wantsHeader`: the layout has a header. */
  problems(wantsHeader) {
    const { width, height } = this.canvas;
    const found = [];
    const [across, down] = this.#device;
    if (across !== width || down !== height) {
      found.push(`The frame of ${width} × ${height} covers ${across} × ${down} pixels of the screen: set the scaling to 100 %.`);
    }
    const screenPx = [screen.width, screen.height].map((side) => Math.round(side * devicePixelRatio));
    if (screenPx[0] !== width || screenPx[1] !== height) {
      found.push(`The screen has ${screenPx.join(" × ")} pixels, the frame ${width} × ${height}.`);
    }
    if (matchMedia("(color-gamut: p3)").matches || matchMedia("(dynamic-range: high)").matches) {
      found.push("The browser converts colours for a screen that is not sRGB, and with them the header: "
        + "start it with --force-color-profile=srgb.");
    }
    if (wantsHeader) {
      const bytes = width >= 511 ? readBytes(this.#context.getImageData(0, 0, 511, 1).data) : [];
      if (!isHeader(bytes)) found.push("The header in the canvas is damaged: something alters what is drawn.");
    }
    return found;
  }
}
