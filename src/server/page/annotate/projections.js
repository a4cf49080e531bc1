// How a picture shows the patient: from mm to fractions of its width and height, and back. It
// accesses no element.
//
// Both projections have `project(point)`, which returns `at` ([right, down], 0 to 1 inside the
// picture) and the distance of the point: `off` from a slice's plane, `depth` from a camera; and
// `unproject(at)`.

import { Projection } from "/projection.js";
import { add, cross, scale } from "/vectors.js";

/** A slice: an orthographic picture of a plane. All directions are unit vectors. */
export class SliceProjection {
  constructor({ center, right, up, height, aspect }) {
    Object.assign(this, { center, right, up, height, width: height * aspect, normal: cross(right, up) });
  }

  /** Without vector functions, as in the camera: each picture projects thousands of points. */
  project([px, py, pz]) {
    const { center, right, up, normal } = this;
    const [x, y, z] = [px - center[0], py - center[1], pz - center[2]];
    const across = x * right[0] + y * right[1] + z * right[2];
    const upward = x * up[0] + y * up[1] + z * up[2];
    return { at: [0.5 + across / this.width, 0.5 - upward / this.height], off: x * normal[0] + y * normal[1] + z * normal[2] };
  }

  unproject([x, y]) {
    const across = scale(this.right, (x - 0.5) * this.width);
    return add(this.center, add(across, scale(this.up, (0.5 - y) * this.height)));
  }

  /** The camera in the format of provenance records. */
  record() {
    const eye = add(this.center, scale(this.normal, 500));
    return { eye_mm: eye, look_at_mm: this.center, up: this.up, height_mm: this.height };
  }
}

/** A camera, with the depths of the visible surfaces if they are known. */
export class CameraProjection extends Projection {
  constructor(header, depths = null) {
    super(header);
    this.depths = depths;
  }

  /** Whether a visible surface hides a projected point. */
  hides({ at, depth }) {
    const seen = this.depths?.at(at);
    return seen !== undefined && seen + this.depths.tolerance < depth;
  }

  record() {
    const { eye_mm, look_at_mm, up, projection } = this.header.camera;
    const form = projection.perspective
      ? { vertical_fov_deg: projection.perspective.vertical_fov_deg }
      : { height_mm: projection.orthographic.height_mm };
    return { eye_mm, look_at_mm, up, ...form };
  }
}

/** The disparity curve of the requested profile: `philips-42`, disparity 0 to 255 to Z from near (0) to far (1). */
const CURVE = { zd: 0.467481, vz: 7.655192, m: -1960.37, c: 127.5 };

/** View depths of a picture from its disparities: a byte for each pixel, so the resolution is about 1/255 of the depth range. */
export class Depths {
  constructor(bytes, width, height, { near_mm: near, far_mm: far }) {
    Object.assign(this, { bytes, width, height });
    const { zd, vz, m, c } = CURVE;
    this.table = Float32Array.from({ length: 256 }, (_, d) => {
      const z = (m * vz) / (m + c - d) + zd - vz;
      // The farthest value means background.
      return d === 0 ? Infinity : near + Math.min(1, Math.max(0, z)) * (far - near);
    });
    /** Half a quantisation step, and a margin for the roughness of surfaces. */
    this.tolerance = (far - near) / 255 + 2.5;
  }

  at([x, y]) {
    const [column, row] = [Math.floor(x * this.width), Math.floor(y * this.height)];
    if (column < 0 || row < 0 || column >= this.width || row >= this.height) return undefined;
    return this.table[this.bytes[row * this.width + column]];
  }
}
