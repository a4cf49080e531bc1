// A slice through the cursor: axial, sagittal, coronal, or an oblique one that follows the 3D view.

import { Cine } from "/cine.js";
import { tableQuery } from "/crop.js";
import { PLANES, advanced, extent, sliceNumber, sliceStep, windowed } from "/slices.js";
import { across, add, clamp, cross, dot, scale, sub, unit } from "./geometry.js";
import { crossSvg, itemsSvg } from "./overlay.js";
import { Pane, element } from "./pane.js";
import { SliceProjection } from "./projections.js";

export const PLANE_COLORS = { axial: "#ff7d70", sagittal: "#f2cf5b", coronal: "#7ddc84", oblique: "#b99cff" };

const round = (values, digits = 3) => values.map((value) => Number(value.toFixed(digits)));
const KEYS = "Arrow keys move the cursor, with Ctrl the picture, Page Up and Page Down go through slices, Space plays them, plus and minus zoom, Enter places a point at the cursor.";

/** Number of the slice, and its position as a letter and mm. */
function placeWords(volume, axis, mm) {
  return `${sliceNumber(volume, axis, mm).join("/")}, ${["LR", "PA", "HF"][axis][mm < 0 ? 1 : 0]} ${Math.abs(mm).toFixed(1)}`;
}

/** The directions of the right and upper edges of a plane's picture. */
function directions(name, model) {
  if (PLANES[name]) return PLANES[name];
  const { normal, up } = model.oblique;
  const upward = across(normal, up);
  return { right: cross(upward, normal), up: upward };
}

export class SlicePane extends Pane {
  #pan = [0, 0];
  #zoom = 1;

  constructor(host, name, parts) {
    const title = name[0].toUpperCase() + name.slice(1);
    super(host, { name, title, keys: KEYS }, parts);
    if (PLANES[name]) this.#addCine(title);
  }

  #addCine(title) {
    const button = element("button", { className: "pane-cine", type: "button", title: `Play the slices of ${title} (Space)` }, "Play");
    button.setAttribute("aria-pressed", "false");
    this.root.append(button);
    const next = () => this.model.moveCursor(advanced({ plane: this.name, at: this.model.cursor.mm }, this.model.volume).at);
    this.cine = new Cine({ button, rate: document.getElementById("cine-rate"), next, rest: () => this.refresh() });
  }

  /** The plane to request: through the cursor, showing the whole volume magnified by the zoom. */
  wanted() {
    const { volume, cursor } = this.model;
    const { right, up } = directions(this.name, this.model);
    const normal = cross(right, up);
    const [width, height] = this.size;
    const aspect = width / height;
    const whole = Math.max(extent(volume, up), extent(volume, right) / aspect);
    const shift = add(scale(right, this.#pan[0]), scale(up, this.#pan[1]));
    const middle = add(volume.center_mm, shift);
    const center = add(middle, scale(normal, dot(sub(cursor.mm, middle), normal)));
    return { center: round(center), right, up, height: Number((whole / this.#zoom).toFixed(3)), aspect };
  }

  order(moving) {
    const view = this.wanted();
    const { center, width } = this.model.window;
    const size = this.pixels;
    const plane = PLANES[this.name] ? { plane: this.name } : { normal: round(cross(view.right, view.up), 6).join(","), up: round(view.up, 6).join(",") };
    const query = new URLSearchParams({
      ...plane, center_mm: view.center.join(","), height_mm: view.height, window_hu: `${center},${width}`, size_px: size.join(","), ...tableQuery(this.model),
    });
    const accept = moving ? "image/jpeg" : "image/png";
    return { url: `/v1/volumes/${this.model.volume.id}/slice?${query}`, accept, view, size };
  }

  /** The projection of the camera in the response: the server decides on right and up. */
  projectionOf({ camera, view }) {
    const { eye_mm: eye, look_at_mm: center, up, projection } = camera.camera;
    const right = unit(cross(sub(center, eye), up));
    const [width, height] = camera.size_px;
    return new SliceProjection({ ...view, center, right, up: unit(up), height: projection.orthographic.height_mm, aspect: width / height });
  }

  overlay() {
    const { model, projection } = this;
    const others = Object.keys(PLANE_COLORS).filter((name) => name !== this.name);
    const planes = others.map((name) => {
      const { right, up } = directions(name, model);
      return [cross(right, up), PLANE_COLORS[name], name === "oblique"];
    });
    this.crossLayer.innerHTML = crossSvg(projection, model.cursor.mm, planes, this.size);
    const { draft, moved } = this.hand;
    this.itemLayer.innerHTML = itemsSvg(model.shown(), projection, this.size, { ...model, draft, moved });
    const { mm } = model.cursor;
    const axis = PLANES[this.name]?.axis;
    this.at.textContent = axis === undefined ? (model.oblique.follows ? "as 3D" : "") : placeWords(model.volume, axis, mm[axis]);
    this.hand.structures?.drawSlice(this);
  }

  /** The patient position at a position in the picture. It is exact and needs no request. */
  async locate(at) {
    return this.projection && { mm: this.projection.unproject(at), method: "slice", camera: this.projection.record() };
  }

  click(at) {
    if (this.projection) this.hand.look(this.projection.unproject(at));
  }

  /** The left button moves the cursor, other buttons the picture; with Shift the window changes. */
  drag([dx, dy], { button }, event) {
    if (event.shiftKey) return this.#windowBy(dx, dy);
    if (button === 0 && !event.altKey) return this.click(this.fractions(event));
    this.pan([dx, dy]);
  }

  /** Moves the picture, CSS pixels. */
  pan([dx, dy]) {
    const perPixel = this.wanted().height / this.size[1];
    this.#pan = [this.#pan[0] - dx * perPixel, this.#pan[1] + dy * perPixel];
    this.refresh(true);
  }

  #windowBy(dx, dy) {
    this.model.window = { ...windowed(this.model.window, [dx, dy]), isOwn: true };
    this.model.changed("window");
  }

  /** Moves through slices by voxels. */
  page(steps) {
    const { right, up } = directions(this.name, this.model);
    const axis = PLANES[this.name]?.axis;
    const { volume } = this.model;
    const step = axis === undefined ? Math.min(...volume.spacing_mm) : sliceStep(volume, axis);
    // The viewing direction of an axial slice is towards the feet: wheel up moves towards the head.
    const towards = cross(right, up);
    const sign = Math.sign(towards.find((value) => Math.abs(value) > 0.5) ?? 1);
    this.model.moveCursor(add(this.model.cursor.mm, scale(towards, sign * steps * step)));
    this.hand.look(this.model.cursor.mm);
  }

  wheel(pixels, event) {
    if (event.ctrlKey) return this.zoom(Math.exp(-pixels * 0.0015), this.fractions(event));
    this.page((event.shiftKey ? 5 : 1) * -Math.sign(pixels || -event.deltaX));
  }

  /** Zooms around a position in the picture. */
  zoom(ratio, at = [0.5, 0.5]) {
    const before = this.wanted();
    this.#zoom = clamp(this.#zoom * ratio, 0.5, 30);
    const after = this.wanted();
    const [x, y] = [at[0] - 0.5, 0.5 - at[1]];
    const grown = before.height - after.height;
    this.#pan = [this.#pan[0] + x * grown * before.aspect, this.#pan[1] + y * grown];
    this.refresh(true);
  }

  home() {
    this.#pan = [0, 0];
    this.#zoom = 1;
    this.refresh();
  }

  /** Keyboard: moves the cursor in the plane by voxels to the right and up, or the picture. */
  step(right, up, moves = false) {
    if (moves) return this.pan([0.05 * right * this.size[1], -0.05 * up * this.size[1]]);
    const basis = directions(this.name, this.model);
    const step = Math.min(...this.model.volume.spacing_mm);
    const by = add(scale(basis.right, right * step), scale(basis.up, up * step));
    this.hand.look(add(this.model.cursor.mm, by));
  }
}
