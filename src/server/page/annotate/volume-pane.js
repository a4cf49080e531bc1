// The 3D view: an orbit around the volume, picks in the displayed picture, and hidden items.

import { cropQuery } from "/crop.js";
import { fitOf, normalized, orbitQuery, shifted, zoomedAt } from "/orbit.js";
import { request } from "/view.js";
import { HOME } from "./model.js";
import { cursorSvg, itemsSvg } from "./overlay.js";
import { Pane } from "./pane.js";
import { CameraProjection, Depths } from "./projections.js";
import { PLANE_COLORS } from "./slice-pane.js";

const MOVING_MS = 80;
const FIELD_OF_VIEW = 22;
const KEYS = "Arrow keys turn, with Ctrl they move, plus and minus zoom, Home resets. Enter places a point at the cursor.";

export class VolumePane extends Pane {
  constructor(host, parts) {
    super(host, { name: "volume", title: "3D", keys: KEYS }, parts);
    this.copy = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  }

  order(moving) {
    const { model, pixels: size } = this;
    const layout = moving ? "color" : "rgbd";
    const orbit = orbitQuery(model.pose, model.volume, FIELD_OF_VIEW, model.pose.zoom * fitOf(size, model.volume));
    const look = { ...(model.preset ? { preset: model.preset } : {}), ...cropQuery(model), ...orbit, size_px: size.join(",") };
    const query = new URLSearchParams({ ...look, layout, profile: "philips-42", ...(moving ? { budget_ms: MOVING_MS } : {}) });
    const accept = moving ? "image/jpeg" : "image/png";
    return { url: `/v1/volumes/${model.volume.id}/frame?${query}`, accept, look, size, layout };
  }

  /** A complete picture has depth beside colour: it decides which items are hidden. */
  projectionOf({ bitmap, layout, camera }) {
    if (layout !== "rgbd") return new CameraProjection(camera);
    const [width, height] = [bitmap.width / 2, bitmap.height];
    Object.assign(this.copy.canvas, { width, height });
    this.copy.drawImage(bitmap, width, 0, width, height, 0, 0, width, height);
    const { data } = this.copy.getImageData(0, 0, width, height);
    const bytes = new Uint8Array(width * height);
    for (let i = 0; i < bytes.length; i += 1) bytes[i] = data[4 * i];
    return new CameraProjection(camera, new Depths(bytes, width, height, camera));
  }

  paint(picture) {
    super.paint(picture, picture.layout === "rgbd" ? picture.bitmap.width / 2 : picture.bitmap.width);
  }

  overlay() {
    const { model, projection } = this;
    const colors = ["sagittal", "coronal", "axial"].map((name) => PLANE_COLORS[name]);
    this.crossLayer.innerHTML = cursorSvg(projection, model.cursor.mm, colors, this.size, model.volume.bounds_mm);
    const { draft, moved } = this.hand;
    this.itemLayer.innerHTML = itemsSvg(model.shown(), projection, this.size, { ...model, draft, moved });
    const { azimuth, elevation } = model.pose;
    this.at.textContent = `${azimuth.toFixed(0)}° ${elevation.toFixed(0)}°`;
    this.hand.structures?.drawVolume(this);
    this.crop?.draw();
    this.planes?.draw();
  }

  /** The visible surface at a position in the picture; null if there is none. */
  async locate(at, signal) {
    if (!this.shown) return null;
    const { look, size } = this.shown;
    const inside = at.map((value, i) => Math.min(size[i] - 0.01, Math.max(0, value * size[i])).toFixed(2));
    const query = new URLSearchParams({ ...look, u: inside[0], v: inside[1] });
    const found = await (await request(`/v1/volumes/${this.model.volume.id}/pick?${query}`, { signal })).json();
    if (!found.hit) return null;
    const ray = this.projection.rayTo(found.patient_mm);
    return { mm: found.patient_mm, hu: found.hu ?? null, depth: found.depth_mm, ray, method: "pick", camera: this.projection.record() };
  }

  async click(at) {
    try {
      const found = await this.locate(at);
      if (found) this.hand.look(found.mm, found.hu);
      else this.hand.say("Nothing is shown there.");
    } catch (error) {
      this.fail(error);
    }
  }

  /** The left button rotates; the right one, or Shift, moves. */
  drag([dx, dy], { button }, event) {
    if (button === 2 || event.shiftKey) return this.pan([dx, dy]);
    const { azimuth, elevation, zoom } = this.model.pose;
    const degrees = 180 / this.size[1] / Math.max(1, Math.sqrt(zoom));
    this.turn({ azimuth: azimuth - dx * degrees, elevation: elevation + dy * degrees });
  }

  wheel(pixels) {
    this.zoom(Math.exp(-pixels * 0.0015));
  }

  /** Zooms, around a position in the picture if one is given. */
  zoom(ratio, at = null) {
    const { pose, volume } = this.model;
    this.turn(at ? zoomedAt(pose, volume, FIELD_OF_VIEW, this.size, ratio, at) : { zoom: pose.zoom * ratio });
  }

  /** Moves the picture, CSS pixels. */
  pan([dx, dy]) {
    const [, height] = this.size;
    this.turn(shifted(this.model.pose, this.model.volume, FIELD_OF_VIEW, fitOf(this.size, this.model.volume), [dx / height, dy / height]));
  }

  home() {
    this.turn({ ...HOME, shift: null });
  }

  turn(change) {
    this.model.pose = normalized({ ...this.model.pose, ...change });
    this.model.changed("pose");
  }

  /** Keyboard: rotates or moves the picture. */
  step(right, up, moves = false) {
    if (moves) return this.pan([0.05 * right * this.size[1], -0.05 * up * this.size[1]]);
    const { azimuth, elevation } = this.model.pose;
    this.turn({ azimuth: azimuth - 6 * right, elevation: elevation - 6 * up });
  }

  page(steps) {
    this.zoom(1.15 ** steps);
  }
}
