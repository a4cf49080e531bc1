// Restores a view with intents after the server restarted. Quaternions are x, y, z, w.

const product = ([ax, ay, az, aw], [bx, by, bz, bw]) => [
  aw * bx + ax * bw + ay * bz - az * by,
  aw * by - ax * bz + ay * bw + az * bx,
  aw * bz + ax * by - ay * bx + az * bw,
  aw * bw - ax * bx - ay * by - az * bz,
];
const inverse = ([x, y, z, w]) => [-x, -y, -z, w];
const turned = (by, [x, y, z]) => product(product(by, [x, y, z, 0]), inverse(by)).slice(0, 3);

/** `patient_from_view` of the front view: a quarter turn about x. */
const FRONT = [Math.SQRT1_2, 0, 0, Math.SQRT1_2];

/**
 * The intents that bring a new view, whose focal point is `lookAt`, to the state `wanted`: the front view first, which is a
 * known orientation, then a rotation and a translation from there.
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
