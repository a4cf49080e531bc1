// How views are arranged in the frame of a display: the outputs of this page beside 2D plus depth.
//
// Quilts have the columns and rows that the server's layouts views-N have. Sizes in pixels. A picture of W × H gives the frame of each output.

import { GRIDS, PROFILES } from "./layouts.js";

/** By name: the number in the shader, the frame, the number of views, and the place of a frame's pixel in the picture. */
const OUTPUTS = {
  flat: { arrangement: 0, views: 1, frame: ([w, h]) => [w, h], place: ([x, y]) => [x, y], words: "one view" },
  stereo: { arrangement: 1, views: 2, frame: ([w, h]) => [2 * w, h], place: ([x, y], [w]) => [x % w, y], words: "side by side" },
  "stereo-half": {
    arrangement: 2, views: 2, frame: ([w, h]) => [w, h], place: ([x, y], [w]) => [(2 * x) % w, y], words: "side by side, half as wide",
  },
  "top-bottom": { arrangement: 3, views: 2, frame: ([w, h]) => [w, 2 * h], place: ([x, y], [, h]) => [x, y % h], words: "above each other" },
  "top-bottom-half": {
    arrangement: 4, views: 2, frame: ([w, h]) => [w, h], place: ([x, y], [, h]) => [x, (2 * y) % h], words: "above each other, half as high",
  },
  lines: { arrangement: 5, views: 2, frame: ([w, h]) => [w, h], place: (at) => at, words: "line by line" },
  columns: { arrangement: 6, views: 2, frame: ([w, h]) => [w, h], place: (at) => at, words: "column by column" },
  checkerboard: { arrangement: 7, views: 2, frame: ([w, h]) => [w, h], place: (at) => at, words: "checkerboard" },
  quilt: {
    arrangement: 1, views: 9, frame: ([w, h], [columns, rows]) => [columns * w, rows * h], place: ([x, y], [w, h]) => [x % w, y % h],
    words: "a quilt, the leftmost view at the bottom left",
  },
  lenses: { arrangement: 8, views: 9, frame: ([w, h]) => [w, h], place: (at) => at, words: "a panel with lenses" },
};

/** Names of the outputs and what they are, in the order of a menu. */
export const outputNames = () => Object.entries(OUTPUTS).map(([name, { words }]) => [name, words]);

/** Largest number of views of a quilt or a panel. */
const MOST_VIEWS = 72;

/** A list of numbers in the address, or the usual ones; throws where it is something else. */
function numbersOf(parameters, name, usual, check, allowed) {
  if (!parameters.has(name)) return usual;
  const found = parameters.get(name).split(",").map(Number);
  if (found.length !== usual.length || !found.every(Number.isFinite) || !check(found)) {
    throw new Error(`${name} is ${parameters.get(name).slice(0, 40)}; allowed: ${allowed}`);
  }
  return found;
}

/** The output in the address; undefined if the display takes the frames themselves. Throws if it is invalid. */
export function outputOf(parameters) {
  const name = parameters.get("output");
  if (name === null || name === "frame") return undefined;
  const output = Object.hasOwn(OUTPUTS, name) ? OUTPUTS[name] : undefined;
  if (!output) throw new Error(`output is ${name.slice(0, 40)}; allowed: frame, ${Object.keys(OUTPUTS).join(", ")}`);
  const whole = ([views]) => Number.isInteger(views) && views >= 2 && views <= MOST_VIEWS;
  const [views] = output.views > 2 ? numbersOf(parameters, "views", [output.views], whole, `2 to ${MOST_VIEWS}`) : [output.views];
  const [span] = numbersOf(parameters, "span", [views > 2 ? 2 : 1], ([n]) => n >= 0 && n <= 60, "0 to 60 eye separations");
  const [eye] = numbersOf(parameters, "eye", [0], ([n]) => Math.abs(n) <= 16, "-16 to 16 eye separations from the middle");
  const [inches] = numbersOf(parameters, "inches", [0], ([n]) => n > 1 && n < 1000, "1 to 1000");
  const [distance] = numbersOf(parameters, "distance", [0], ([mm]) => mm >= 50 && mm <= 20000, "50 to 20000 mm");
  const lens = numbersOf(parameters, "lens", [5, 0.333, 0], ([pitch]) => pitch > 0, "pixels from lens to lens, slant, centre");
  for (const [key, allowed] of [["subpixels", ["rgb", "bgr"]], ["layers", ["1", "2"]]]) {
    const found = parameters.get(key) ?? allowed[0];
    if (!allowed.includes(found)) throw new Error(`${key} is ${found.slice(0, 40)}; allowed: ${allowed.join(", ")}`);
  }
  if (parameters.has("layout")) throw new Error("layout is set; allowed: nothing beside output, which chooses the layout itself");
  const isBgr = parameters.get("subpixels") === "bgr";
  return { name, ...output, views, grid: GRIDS[Math.max(2, views)], span, eye, inches, distance, lens, isBgr, isSwapped: parameters.has("swap") };
}

/** The screen of a display: its width, and from where it is seen, mm. Throws if the profile has no such name. */
export function screenOf({ inches, distance }, profile) {
  const known = PROFILES[profile];
  if (!known) throw new Error(`profile is ${profile}; allowed: ${Object.keys(PROFILES).join(", ")}`);
  const screenWidthMm = inches ? (inches * MM_PER_INCH * 16) / Math.hypot(16, 9) : known.screenWidthMm;
  // Displays are seen from twice their width where the address has no distance: 1.86 m for 42 inches.
  return { ...known, screenWidthMm, distance: distance || 2 * screenWidthMm };
}

const MM_PER_INCH = 25.4;
const EYE_SEPARATION_MM = 65;

/**
 * The places of tracked eyes, in eye separations: those from which a viewer at the usual distance sees the same. Points near
 * the screen move against it in proportion to the way of the eye, and inversely to its distance.
 */
export function trackedEyes({ views, distance }, { left_mm: left, right_mm: right }) {
  const seen = ([x, , z]) => (x / EYE_SEPARATION_MM) * (distance / z);
  if (views > 2) return null; // a display of several views is seen from several places
  return views === 1 ? [(seen(left) + seen(right)) / 2] : [seen(left), seen(right)];
}

/**
 * The eyes that see on a display of the profile what these eyes see on the screen of the output: on a screen half as wide,
 * eyes are twice as far apart in terms of its width. Within what the server takes.
 */
export function seenThrough(output, profile, eyes) {
  const wider = PROFILES[profile].screenWidthMm / screenOf(output, profile).screenWidthMm;
  return eyes.map((eye) => Math.max(-MOST_EYES, Math.min(MOST_EYES, eye * wider)));
}

/** Farthest place of an eye that the server renders, in eye separations. */
const MOST_EYES = 16;

/** The places of the eyes, from left to right and even, in eye separations; those of the tracked viewer where `tracked` is set. */
export function eyesOf({ views, span, eye, tracked }) {
  if (tracked) return tracked;
  const last = Math.max(1, views - 1);
  return Array.from({ length: views }, (_, i) => eye + ((2 * i - (views - 1)) / (2 * last)) * span);
}
