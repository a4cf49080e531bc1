// Test pictures for a 2D-plus-depth monitor. The page makes them without a server, so that an error
// lies between page and panel.

import { composeLayers, headerBytes } from "./frame.js";
import { Panel } from "./panel.js";

const $ = (id) => document.getElementById(id);
const SIZES = { wowvx: [960, 540], "wowvx-full-height": [960, 1080], "wowvx-4k": [1920, 2160] };
/** Content type computer graphics; the header replaces the display's own factor and offset. */
const [CGI, USE_BOTH] = [4, 0xc0];
const NEAR = 255;

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

function draw() {
  const [layout, factor, offset] = [$("layout").value, Number($("factor").value), Number($("offset").value)];
  const size = SIZES[layout];
  const picture = PICTURES[$("picture").value];
  const layer = { color: new Uint32Array(size[0] * size[1]), depth: new Uint8Array(size[0] * size[1]) };
  for (let y = 0, at = 0; y < size[1]; y += 1) {
    for (let x = 0; x < size[0]; x += 1, at += 1) [layer.color[at], layer.depth[at]] = picture(x, y, size, offset);
  }
  const display = [CGI, factor, offset, USE_BOTH];
  panel.show(composeLayers(layout, size, [layer], display));
  $("factor-value").textContent = factor;
  $("offset-value").textContent = offset;
  $("words").textContent = `--layout ${layout} --factor ${factor} --offset ${offset}`;
  const bytes = headerBytes(display).slice(0, 10).map((byte) => byte.toString(16).padStart(2, "0").toUpperCase());
  $("words").title = `Header ${bytes.join(" ")}`;
  $("kiosk").href = `/kiosk?${new URLSearchParams({ layout, factor, offset })}`;
  report();
}

function report() {
  const found = panel.problems(true);
  document.documentElement.dataset.test = found.length ? "bad" : "good";
  $("test").className = found.length ? "bad" : "good";
  $("test").textContent = found.length ? "The panel does not receive the frame unchanged." : "The panel receives the header and every pixel unchanged.";
  $("problems").replaceChildren(...found.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
}

for (const id of ["picture", "layout", "factor", "offset"]) $(id).addEventListener("input", draw);
$("full").addEventListener("click", () => document.documentElement.requestFullscreen());
$("hide").addEventListener("click", () => (document.querySelector(".tools").hidden = true));
addEventListener("keydown", (event) => {
  if (event.key === "Escape") document.querySelector(".tools").hidden = false;
});
draw();
