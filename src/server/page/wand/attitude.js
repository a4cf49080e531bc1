// How a phone is held, from the angles of DeviceOrientationEvent, in the axes of the view.
//
// Earth's axes are x east, y north, z up; the angles are intrinsic rotations about z, x and y (W3C
// Device Orientation, 3.1). The view's axes are x right, y up, z towards the viewer, who holds the
// phone: its heading at the beginning is taken for the direction to the screen.
// Quaternions are x, y, z, w.

const HALF_RADIANS = Math.PI / 360;

const about = (axis, degrees) => {
  const quaternion = [0, 0, 0, Math.cos(degrees * HALF_RADIANS)];
  quaternion[axis] = Math.sin(degrees * HALF_RADIANS);
  return quaternion;
};

function times([ax, ay, az, aw], [bx, by, bz, bw]) {
  return [
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
    aw * bw - ax * bx - ay * by - az * bz,
  ];
}

const inverse = ([x, y, z, w]) => [-x, -y, -z, w];

function rotated(quaternion, [x, y, z]) {
  return times(times(quaternion, [x, y, z, 0]), inverse(quaternion)).slice(0, 3);
}

/** The rotation from the phone's axes (x right, y to its top edge, z out of its screen) to Earth's. */
export const earthFromPhone = ({ alpha, beta, gamma }) => times(times(about(2, alpha), about(0, beta)), about(1, gamma));

/** Direction in which a phone points, in Earth's axes: from lying flat (its top edge) to upright (its back). */
const forwardOf = (earth) => rotated(earth, [0, Math.SQRT1_2, -Math.SQRT1_2]);

/** The same from the orientation of WebXR, in the axes of the phone at the start (x right, y up, z towards the user). */
export const earthFromSpace = (orientation) => times(about(0, 90), orientation);

/** A position in those axes, in the axes of the view, for a screen that lies in the direction `heading`. */
export function viewFromSpace(position, heading) {
  return rotated(times(about(0, -90), times(about(2, -heading), about(0, 90))), position);
}

/** Heading of the phone, degrees from north to the west. */
export function headingOf(earth) {
  const [east, north] = forwardOf(earth);
  return (Math.atan2(-east, north) * 180) / Math.PI;
}

/** Height of the direction in which the phone points, degrees above the horizon, 45 below for a flat phone. */
export function pitchOf(earth) {
  return (Math.asin(Math.max(-1, Math.min(1, forwardOf(earth)[2]))) * 180) / Math.PI;
}

/** The phone's attitude in the axes of the view, for a screen that lies in the direction `heading`. */
export function viewFromPhone(earth, heading) {
  // Earth's axes with the heading as north, and then north away from the viewer, up as y.
  return times(about(0, -90), times(about(2, -heading), earth));
}
