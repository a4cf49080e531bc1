// The camera as an orbit around a patient position: angles in degrees, zoom, and focal point. It
// accesses no element.
//
// An orbit around the centre of the tissue is requested by its angles. A shifted orbit is requested
// as a camera, with the formulas of the server's `camera::Orbit`, so that a shift only moves the
// picture.

import { add, clamp, length, scale } from "./vectors.js";

const round = (value, digits) => Number(value.toFixed(digits));
const words = (vector, digits = 3) => vector.map((value) => round(value, digits)).join(",");

/** Keeps a pose in range: azimuth wraps, elevation ends at the poles. `shift`: from the centre of the tissue, mm, or null. */
export function normalized({ azimuth, elevation, zoom, shift = null }) {
  return {
    azimuth: ((((azimuth + 180) % 360) + 360) % 360) - 180,
    elevation: clamp(elevation, -90, 90),
    zoom: clamp(zoom, 0.2, 40),
    shift,
  };
}

/** Unit vectors of a view: from the patient to the eye, up, and right. */
export function directionsOf({ azimuth, elevation }) {
  const [a, e] = [azimuth, elevation].map((degrees) => (degrees * Math.PI) / 180);
  return {
    toEye: [Math.sin(a) * Math.cos(e), -Math.cos(a) * Math.cos(e), Math.sin(e)],
    up: [-Math.sin(a) * Math.sin(e), Math.cos(a) * Math.sin(e), Math.cos(e)],
    right: [Math.cos(a), Math.sin(a), 0],
  };
}

/** Radius of the sphere that fits into the picture's height at zoom 1, mm. */
const radiusOf = ({ framing }) => framing.radius_mm;

/** Distance of the eye, and height of the picture at the focal point, mm. A field of view of 0 is a parallel projection. */
function measuresOf(volume, zoom, fieldOfView) {
  const radius = radiusOf(volume);
  if (fieldOfView === 0) return { distance: 3 * radius, height: (2 * radius) / zoom };
  const half = (fieldOfView * Math.PI) / 360;
  const distance = radius / Math.sin(half);
  return { distance, height: (2 * distance * Math.tan(half)) / zoom };
}

/** Query parameters of a pose; `fitted` is its zoom for the shape of the picture. */
export function orbitQuery(pose, volume, fieldOfView, fitted) {
  if (!pose.shift) {
    const { azimuth, elevation } = pose;
    const angles = { azimuth_deg: round(azimuth, 3), elevation_deg: round(elevation, 3), zoom: round(fitted, 4) };
    return { ...angles, vertical_fov_deg: fieldOfView, frame: "tissue" };
  }
  const { toEye, up } = directionsOf(pose);
  const { distance, height } = measuresOf(volume, fitted, fieldOfView);
  const at = add(volume.framing.center_mm, pose.shift);
  const narrowed = (360 / Math.PI) * Math.atan(height / (2 * distance));
  const projection = fieldOfView === 0 ? { height_mm: round(height, 4) } : { vertical_fov_deg: round(narrowed, 6) };
  return { eye_mm: words(add(at, scale(toEye, distance))), look_at_mm: words(at), up: words(up, 9), ...projection };
}

/**
 * The pose after dragging its picture by fractions of its height, to the right and down. `fit` corrects the zoom for the
 * shape of the picture, see `fitOf`.
 */
export function shifted(pose, volume, fieldOfView, fit, [dx, dy]) {
  const { up, right } = directionsOf(pose);
  const { height } = measuresOf(volume, pose.zoom * fit, fieldOfView);
  const shift = add(pose.shift ?? [0, 0, 0], add(scale(right, -dx * height), scale(up, dy * height)));
  const far = length(shift) / radiusOf(volume);
  if (far < 1e-6) return { ...pose, shift: null };
  return { ...pose, shift: far > 1 ? scale(shift, 1 / far) : shift };
}

/** The pose after zooming around a position in the picture, in fractions of its size. */
export function zoomedAt(pose, volume, fieldOfView, [width, height], ratio, [x, y]) {
  const nearer = normalized({ ...pose, zoom: pose.zoom * ratio });
  const grown = nearer.zoom / pose.zoom - 1;
  const by = [-(x - 0.5) * (width / height) * grown, -(y - 0.5) * grown];
  return shifted(nearer, volume, fieldOfView, fitOf([width, height], volume), by);
}

/** Correction of the zoom for narrow pictures: the server fits the volume to the picture's height only. */
export const fitOf = ([width, height], { framing }) => Math.min(1, width / height / framing.narrowest_aspect);
