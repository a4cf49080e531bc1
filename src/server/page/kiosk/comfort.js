// How far pictures stand in front of the screen and behind it, and whether that is comfortable.
//
// Parallax is a share of the screen's width for eyes one separation (65 mm) apart; positive is in front of the screen. The usual
// limit is one degree of disparity (Lambooij et al., J. Imaging Sci. Technol. 53(3), 2009): 3.5 % of a
// 42-inch screen seen from 1.9 m.

import { PROFILES } from "./layouts.js";

const EYE_SEPARATION_MM = 65;
const USUAL_FACTOR = 64;
const USUAL_LIMITS = [0.035, 0.035];
const MOST_PERCENT = 20;
/** Share of the visible pixels at each end that do not count: a wire in front hurts nobody. */
const OUTLIERS = 0.01;
const BARS = 64;

/** Limits in front of the screen and behind it, from `comfort=FRONT,BEHIND` in per cent; throws if they are invalid. */
export function comfortOf(parameters) {
  if (!parameters.has("comfort")) return USUAL_LIMITS;
  const found = parameters.get("comfort").split(",").map(Number);
  if (found.length !== 2 || !found.every((percent) => percent > 0 && percent <= MOST_PERCENT)) {
    throw new Error(`comfort is ${parameters.get("comfort").slice(0, 40)}; allowed: per cent in front and behind, up to ${MOST_PERCENT} each`);
  }
  return found.map((percent) => percent / 100);
}

/** Parallax by disparity D, for the factor and offset of a display's header. */
function parallaxes(profile, [, factor, offset]) {
  const { m, screenWidthMm } = PROFILES[profile];
  const scale = -(EYE_SEPARATION_MM / screenWidthMm) * (factor / USUAL_FACTOR) / m;
  return Float64Array.from({ length: 256 }, (_, d) => scale * (d - offset));
}

/**
 * The parallax of a picture: `front` and `behind` (shares of the width, 0 if nothing is there), and `counts` of visible pixels by
 * disparity. D = 0 is the background.
 */
export function parallaxOf(depth, profile, display) {
  const counts = new Uint32Array(256);
  for (const d of depth) counts[d] += 1;
  counts[0] = 0;
  const visible = counts.reduce((sum, count) => sum + count, 0);
  const known = parallaxes(profile, display);
  if (!visible) return { front: 0, behind: 0, counts, parallax: known };
  const end = (order) => {
    let left = visible * OUTLIERS;
    return order.find((d) => (left -= counts[d]) < 0);
  };
  const upwards = Array.from(counts.keys());
  const [farthest, nearest] = [end(upwards), end(upwards.toReversed())];
  return { front: Math.max(0, known[nearest]), behind: Math.max(0, -known[farthest]), counts, parallax: known };
}

const percent = (share) => `${(100 * share).toFixed(1)} %`;

/** The parallax in words. */
export const comfortWords = ({ front, behind }) => `${percent(front)} of the width in front of the screen, ${percent(behind)} behind`;

/** Sentences about what lies outside of the limits; none if all is comfortable. */
export function comfortProblems({ front, behind }, [mostFront, mostBehind]) {
  const found = [];
  if (front > mostFront) found.push(`Parallax in front of the screen is ${percent(front)} of the width, above ${percent(mostFront)}. Reduce factor or offset.`);
  if (behind > mostBehind) found.push(`Parallax behind the screen is ${percent(behind)} of the width, above ${percent(mostBehind)}. Reduce factor.`);
  return found;
}

/** Whether a point (patient mm) lies outside of the depth that the frame can show: a sentence, or an empty text. */
export function outsideWords(what, point, { limits: [near, far], eye, lookAt }) {
  if (!point) return "";
  const axis = lookAt.map((at, i) => at - eye[i]);
  const depth = point.reduce((sum, at, i) => sum + (at - eye[i]) * axis[i], 0) / Math.hypot(...axis);
  if (depth >= near && depth <= far) return "";
  return `${what} is ${Math.abs(depth - (depth < near ? near : far)).toFixed(0)} mm ${depth < near ? "in front of" : "behind"} the depth that the display shows.`;
}

/** The warning about landmarks outside of the depth (`outside` of the state); empty if there are none. */
export function landmarksOutsideWords(outside) {
  if (!outside) return "";
  const count = outside.count - 1;
  const others = count ? `; ${count === 1 ? "another landmark is" : `${count} other landmarks are`} outside of it, too` : "";
  return `“${outside.label}” is ${Math.abs(outside.behind_mm)} mm ${outside.behind_mm < 0 ? "in front of" : "behind"} the depth that the display shows${others}.`;
}

/** Draws the histogram: from far (left) to near, with the screen and the limits as lines. */
export function drawHistogram(canvas, { counts, parallax }, [mostFront, mostBehind]) {
  const context = canvas.getContext("2d");
  const { width, height } = canvas;
  const bars = new Float64Array(BARS);
  counts.forEach((count, d) => (bars[Math.floor((d * BARS) / 256)] += count));
  const most = Math.max(1, ...bars);
  context.fillStyle = "#10151b";
  context.fillRect(0, 0, width, height);
  bars.forEach((count, i) => {
    const share = parallax[Math.floor(((i + 0.5) * 256) / BARS)];
    context.fillStyle = share > mostFront || -share > mostBehind ? "#ff8a80" : "#7fb6e8";
    const tall = (count / most) * (height - 4);
    context.fillRect((i * width) / BARS, height - tall, width / BARS - 1, tall);
  });
  context.fillStyle = "#e8edf2";
  const screen = parallax.findIndex((share) => share >= 0);
  if (screen >= 0) context.fillRect((screen * width) / 256, 0, 1, height);
}
