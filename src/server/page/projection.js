// How a camera shows the patient: from mm to fractions of its picture's width and height, and back.
// It accesses no element.
//
// All pages project with this module: markers, annotations and grabbing.

import { add, cross, scale, sub, unit } from "./vectors.js";

/** A camera from the header `Relief-Camera`. */
export class Projection {
  constructor(header) {
    const { camera, size_px: [width, height] } = header;
    Object.assign(this, { header, eye: camera.eye_mm, aspect: width / height });
    this.forward = unit(sub(camera.look_at_mm, camera.eye_mm));
    this.right = unit(cross(this.forward, camera.up));
    this.up = cross(this.right, this.forward);
    const { perspective, orthographic } = camera.projection;
    this.tangent = perspective ? Math.tan((perspective.vertical_fov_deg * Math.PI) / 360) : null;
    this.half = orthographic ? orthographic.height_mm / 2 : null;
    /** The picture's centre, mm to the right and up for each mm of depth; only perspective cameras are shifted. */
    this.shift = camera.lens_shift ?? [0, 0];
  }

  /** Half the visible height at a view depth, mm. */
  halfAt(depth) {
    return this.tangent === null ? this.half : depth * this.tangent;
  }

  /**
   * Projects a point: `at` ([right, down], 0 to 1 inside the picture) and its view `depth`; null behind the eye. It uses no
   * vector functions, because each picture projects thousands of points.
   */
  project([px, py, pz]) {
    const { eye, forward, right, up, shift } = this;
    const [x, y, z] = [px - eye[0], py - eye[1], pz - eye[2]];
    const depth = x * forward[0] + y * forward[1] + z * forward[2];
    const half = this.halfAt(depth);
    if (half <= 0) return null;
    const across = x * right[0] + y * right[1] + z * right[2] - shift[0] * depth;
    const upward = x * up[0] + y * up[1] + z * up[2] - shift[1] * depth;
    return { at: [0.5 + across / (2 * half * this.aspect), 0.5 - upward / (2 * half)], depth };
  }

  /** The point at a position in the picture and a view depth. */
  unproject([x, y], depth) {
    const half = this.halfAt(depth);
    const across = (2 * x - 1) * half * this.aspect + this.shift[0] * depth;
    const upward = (1 - 2 * y) * half + this.shift[1] * depth;
    return add(this.eye, add(scale(this.forward, depth), add(scale(this.right, across), scale(this.up, upward))));
  }

  /** The direction from the eye to a point, a unit vector. */
  rayTo(point) {
    return this.tangent === null ? this.forward : unit(sub(point, this.eye));
  }
}
