// A view brought back to where it was, by intents: for a server that was started anew. Quaternions
// x, y, z, w.

const product = ([ax, ay, az, aw], [bx, by, bz, bw]) => [
  aw * bx + ax * bw + ay * bz - az * by,
  aw * by - ax * bz + ay * bw + az * bx,
  aw * bz + ax * by - ay * bx + az * bw,
  aw * bw - ax * bx - ay * by - az * bz,
];
const inverse = ([x, y, z, w]) => [-x, -y, -z, w];
const turned = (by, [x, y, z]) => product(product(by, [x, y, z, 0]), inverse(by)).slice(0, 3);

/** `patient_from_view` of a look from the front: a quarter turn about x. */
const FRONT = [Math.SQRT1_2, 0, 0, Math.SQRT1_2];

/**
 * What brings a new view, whose focal point is `lookAt`, to the state `wanted`. A look from the front is a known orientation; from
 * there a hand turns what is seen, and moves the focal point to where the new one lies in view.
 */
export function intentsTo(wanted, lookAt) {
  const viewFromPatient = inverse(wanted.orientation_xyzw);
  const shift = turned(viewFromPatient, lookAt.map((mm, axis) => mm - wanted.look_at_mm[axis]));
  const { zoom, vertical_fov_deg, clip_mm, cursor_mm } = wanted;
  return [
    { intent: "look", azimuth_deg: 0, elevation_deg: 0, zoom, vertical_fov_deg },
    { intent: "grab", position_mm: [0, 0, 0], orientation_xyzw: [0, 0, 0, 1], mode: "both", pivot: "focal" },
    { intent: "move", position_mm: shift, orientation_xyzw: product(viewFromPatient, FRONT) },
    { intent: "release" },
    ...(clip_mm === null ? [] : [{ intent: "clip", to_mm: clip_mm }]),
    ...(cursor_mm === null ? [] : [{ intent: "cursor", point_mm: cursor_mm }]),
  ];
}
