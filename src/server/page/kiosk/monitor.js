// Test pictures for a 3D monitor, which takes picture and depth or views. The page makes them without
// a server, so that an error lies between page and panel.

import { composeLayers, headerBytes } from "./frame.js";
import { outputNames, outputOf } from "./outputs.js";
import { Panel } from "./panel.js";
import { Synthesis } from "./synthesis.js";

const $ = (id) => document.getElementById(id);
const SIZES = { wowvx: [960, 540], "wowvx-full-height": [960, 1080], "wowvx-4k": [1920, 2160] };
/** Content type computer graphics; the header replaces the display's own factor and offset. */
const [CGI, USE_BOTH] = [4, 0xc0];
const NEAR = 255;
/** The view synthesis of the chosen output, and its part of the address. */
let synthesis = null;
let outputQuery = "";

const panel = new Panel($("frame"), report);

const gray = (value) => 0xff000000 | (Math.max(0, Math.min(255, Math.round(value))) * 0x010101);
/** Yellow is near, blue is far, as 32-bit RGBA. */
const hue = (d) => 0xff000000 | ((255 - d) << 16) | (Math.round(0.8 * d) << 8) | d;

/** Colour and D at a position, for each test picture. */
const PICTURES = {
  ramps(x, y, [width, height]) {
    const d = Math.round(NEAR * (1 - x / (width - 1)));
    // Lines of equal depth, every sixteenth, and a band without any.
    const line = d % 16 === 0 && Math.floor((8 * y) / height) % 4 !== 0;
    return [line ? gray(255) : hue(d), d];
  },
  steps(x, y, [width, height]) {
    const [column, row] = [Math.floor((3 * x) / width), Math.floor((3 * y) / height)];
    const inside = [(3 * x) / width - column, (3 * y) / height - row].every((at) => at > 0.15 && at < 0.85);
    const d = inside ? Math.round((NEAR * (8 - (3 * row + column))) / 8) : 64;
    return [inside ? hue(d) : gray(40), d];
  },
  screen(x, y, [width, height], offset) {
    const tile = (Math.floor((16 * x) / width) + Math.floor((9 * y) / height)) % 2;
    return [gray(tile ? 200 : 90), offset];
  },
  grid(x, y, _, offset) {
    return [gray((x + y) % 2 ? 255 : 0), offset];
  },
};

/** The size of a picture that fills the screen, or the panel's own in layouts with depth. */
function sizeOf(name) {
  if (SIZES[name]) return SIZES[name];
  const [width, height] = [screen.width, screen.height].map((side) => Math.round(side * devicePixelRatio));
  return [name === "stereo" ? width / 2 : width, name === "top-bottom" ? height / 2 : height].map((side) => 2 * Math.floor(side / 2));
}

/** The part of the kiosk's address for the chosen output; empty in layouts with depth. */
function queryOfOutput(name) {
  if (SIZES[name]) return {};
  const value = (id) => $(id).value;
  const lens = { lens: [value("pitch"), value("slant"), value("center")].join(","), ...($("bgr").checked ? { subpixels: "bgr" } : {}) };
  return { output: name, span: value("span"), ...($("swap").checked ? { swap: "" } : {}), ...(name === "lenses" ? lens : {}) };
}

/** The frame of layers; views need a graphics context for each change of the output. */
function frameOf(name, size, layers, display) {
  if (SIZES[name]) return composeLayers(name, size, layers, display);
  const query = new URLSearchParams(queryOfOutput(name));
  if (query.toString() !== outputQuery) {
    synthesis?.end();
    synthesis = new Synthesis(outputOf(query), "philips-42");
    outputQuery = query.toString();
  }
  synthesis.take(size, layers, display);
  return synthesis.draw();
}

function draw() {
  const [layout, factor, offset] = [$("layout").value, Number($("factor").value), Number($("offset").value)];
  const size = layout === "quilt" ? [480, 270] : sizeOf(layout);
  const picture = PICTURES[$("picture").value];
  const layer = { color: new Uint32Array(size[0] * size[1]), depth: new Uint8Array(size[0] * size[1]) };
  for (let y = 0, at = 0; y < size[1]; y += 1) {
    for (let x = 0; x < size[0]; x += 1, at += 1) [layer.color[at], layer.depth[at]] = picture(x, y, size, offset);
  }
  const display = [CGI, factor, offset, USE_BOTH];
  panel.show(frameOf(layout, size, [layer], display));
  for (const id of ["factor", "offset", "span", "pitch", "slant", "center"]) $(`${id}-value`).textContent = $(id).value;
  const isViews = !SIZES[layout];
  $("view-tools").hidden = !isViews;
  $("lens-tools").hidden = layout !== "lenses";
  const query = new URLSearchParams({ ...(isViews ? { ...queryOfOutput(layout), size: size.join("x") } : { layout }), factor, offset });
  $("words").textContent = isViews ? `/kiosk?${query}` : `--layout ${layout} --factor ${factor} --offset ${offset}`;
  const bytes = headerBytes(display).slice(0, 10).map((byte) => byte.toString(16).padStart(2, "0").toUpperCase());
  $("words").title = isViews ? "" : `Header ${bytes.join(" ")}`;
  $("kiosk").href = `/kiosk?${query}`;
  report();
}

function report() {
  const isViews = !SIZES[$("layout").value];
  const found = panel.problems(!isViews);
  document.documentElement.dataset.test = found.length ? "bad" : "good";
  $("test").className = found.length ? "bad" : "good";
  $("test").textContent = found.length ? "The panel does not receive the frame unchanged." : `The panel receives ${isViews ? "" : "the header and "}every pixel unchanged.`;
  $("problems").replaceChildren(...found.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
}

const options = outputNames().map(([name, words]) => new Option(`${name}: ${words}`, name));
$("outputs").append(...options);
const INPUTS = ["picture", "layout", "factor", "offset", "span", "swap", "pitch", "slant", "center", "bgr"];
for (const id of INPUTS) $(id).addEventListener("input", draw);
$("full").addEventListener("click", () => document.documentElement.requestFullscreen());
$("hide").addEventListener("click", () => (document.querySelector(".tools").hidden = true));
addEventListener("keydown", (event) => {
  if (event.key === "Escape") document.querySelector(".tools").hidden = false;
});
draw();
