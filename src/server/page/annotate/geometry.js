// Shapes in patient LPS mm as numbers: vectors, curves, measures, and the points that people can
// grab. It accesses no element.
//
// The formulas are those of the server's `annotation` crate: a measure displayed while a point moves
// equals the one that the server returns afterwards.

import { lengthWords } from "/lengths.js";
import { add, cross, distance, dot, length, lerp, scale, sub, unit } from "/vectors.js";

export * from "/vectors.js";

/** Segments between two points of a smooth curve: for measuring, and for drawing. */
const PARTS = 32;
const DRAWN_PARTS = 10;

/** A unit vector perpendicular to another, as close as possible to a preferred direction. */
export function across(normal, along = [0, 0, 1]) {
  const flat = sub(along, scale(normal, dot(along, normal)));
  if (length(flat) > 1e-3) return unit(flat);
  const axis = Math.abs(normal[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  return unit(sub(axis, scale(normal, dot(axis, normal))));
}

/** Points of a centripetal Catmull-Rom spline through `points`; a closed one ends where it begins. */
function catmullRom(points, closed, parts) {
  let kept = points.filter((point, i) => i === 0 || distance(point, points[i - 1]) > 0);
  if (closed && kept.length > 1 && distance(kept[0], kept.at(-1)) === 0) kept = kept.slice(0, -1);
  const count = kept.length;
  if (count < 3) return kept;
  const mirrored = (a, b) => sub(scale(a, 2), b);
  const curve = [];
  for (let span = 0; span < (closed ? count : count - 1); span += 1) {
    const [a, b] = [kept[span], kept[(span + 1) % count]];
    const before = closed || span > 0 ? kept[(span + count - 1) % count] : mirrored(a, b);
    const after = closed || span + 2 < count ? kept[(span + 2) % count] : mirrored(b, a);
    for (let part = 0; part < parts; part += 1) curve.push(between([before, a, b, after], part / parts));
  }
  curve.push(closed ? kept[0] : kept.at(-1));
  return curve;
}

/** The point at a share of the way from the second to the third of four control points. */
function between(controls, share) {
  const knots = [0];
  for (let i = 1; i < 4; i += 1) knots.push(knots[i - 1] + Math.max(1e-9, Math.sqrt(distance(controls[i], controls[i - 1]))));
  const t = knots[1] + (knots[2] - knots[1]) * share;
  let level = controls;
  for (let width = 1; width < 4; width += 1) {
    level = level.slice(0, -1).map((point, i) => {
      const [low, high] = width === 3 ? [knots[1], knots[2]] : [knots[i], knots[i + width]];
      return lerp(point, level[i + 1], (t - low) / (high - low));
    });
  }
  return level[0];
}

/** The corners of a plane's rectangle, the first one again at the end. */
export function corners({ center_mm: center, normal, axis, size_mm: [width, height] }) {
  const [along, down] = [scale(axis, width / 2), scale(cross(normal, axis), height / 2)];
  const corner = (x, y) => add(center, add(scale(along, x), scale(down, y)));
  return [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1), corner(-1, -1)];
}

/** A geometry as a line to be drawn; nothing of points, regions and meshes. */
export function outline(geometry, parts = DRAWN_PARTS) {
  switch (geometry?.kind) {
    case "line": return geometry.ends_mm;
    case "angle": return geometry.points_mm;
    case "plane": return corners(geometry);
    case "curve": {
      const { points_mm: points, closed, smooth } = geometry;
      if (smooth) return catmullRom(points, closed, parts);
      return closed ? [...points, points[0]] : points;
    }
    default: return [];
  }
}

/** The points that users place and can grab. */
export function pointsOf(geometry) {
  switch (geometry?.kind) {
    case "point": return [geometry.at_mm];
    case "line": return geometry.ends_mm;
    case "angle": case "curve": return geometry.points_mm;
    case "plane": return [geometry.center_mm];
    default: return [];
  }
}

/** The geometry with one of its points moved. */
export function withPoint(geometry, index, at) {
  const replaced = (points) => points.map((point, i) => (i === index ? at : point));
  switch (geometry.kind) {
    case "point": return { ...geometry, at_mm: at };
    case "line": return { ...geometry, ends_mm: replaced(geometry.ends_mm) };
    case "plane": return { ...geometry, center_mm: at };
    default: return { ...geometry, points_mm: replaced(geometry.points_mm) };
  }
}

/** The least number of points of an item; for most kinds the number is fixed. */
export function fewestPoints(geometry) {
  if (geometry?.kind !== "curve") return pointsOf(geometry).length;
  return geometry.closed ? 3 : 2;
}

/** A curve with one more point, before the one of this index. */
export function withInserted(curve, index, at) {
  const points = curve.points_mm;
  return { ...curve, points_mm: [...points.slice(0, index), at, ...points.slice(index)] };
}

/** A curve without one of its points; null if too few remain. */
export function withoutPoint(geometry, index) {
  const points = pointsOf(geometry);
  if (geometry?.kind !== "curve" || points.length <= fewestPoints(geometry)) return null;
  return { ...geometry, points_mm: points.filter((_, i) => i !== index) };
}

/** Cache of segments by curve: each pointer move needs them, and a changed curve is a new object. */
const KNOWN_PARTS = new WeakMap();

/** A curve as segments, each with the index of a point that is inserted there. */
export function partsOf(curve) {
  if (!KNOWN_PARTS.has(curve)) KNOWN_PARTS.set(curve, cut(curve));
  return KNOWN_PARTS.get(curve);
}

function cut(curve) {
  const { points_mm: points, closed } = curve;
  const line = outline(curve);
  const spans = closed ? points.length : points.length - 1;
  const each = (line.length - 1) / spans;
  return line.slice(1).map((to, i) => ({ from: line[i], to, index: Math.min(spans, Math.floor(i / each + 1e-6) + 1) }));
}

const pathLength = (points) => points.slice(1).reduce((sum, point, i) => sum + distance(point, points[i]), 0);

/** Measures of a geometry: names, values and units, as the server computes them. */
export function measures(geometry) {
  switch (geometry?.kind) {
    case "line": return [{ name: "length", value: distance(...geometry.ends_mm), unit: "mm" }];
    case "angle": {
      const [a, corner, b] = geometry.points_mm;
      const [first, second] = [sub(a, corner), sub(b, corner)];
      const angle = Math.atan2(length(cross(first, second)), dot(first, second));
      return [{ name: "angle", value: (angle * 180) / Math.PI, unit: "deg" }];
    }
    case "curve": {
      const line = outline(geometry, PARTS);
      const found = [{ name: "length", value: pathLength(line), unit: "mm" }];
      if (geometry.closed) {
        const turn = (sum, point, i) => add(sum, cross(sub(line[i], line[0]), sub(point, line[0])));
        found.push({ name: "area", value: length(line.slice(1).reduce(turn, [0, 0, 0])) / 2, unit: "mm2" });
      }
      return found;
    }
    case "region": return [{ name: "volume", value: geometry.volume_ml, unit: "mL" }];
    case "mesh": {
      const area = { name: "area", value: geometry.area_mm2, unit: "mm2" };
      return geometry.volume_ml == null ? [area] : [{ name: "volume", value: geometry.volume_ml, unit: "mL" }, area];
    }
    default: return [];
  }
}

const UNITS = { mm: "mm", deg: "°", mm2: "mm²", mL: "ml" };

/** A measure as text. */
export function measureWords({ value, unit: code }) {
  if (code === "mm" && value < 0.1) return lengthWords(value);
  const digits = value >= 1000 ? 0 : value >= 100 ? 1 : 2;
  const number = code === "deg" ? value.toFixed(1) : value.toFixed(digits);
  return code === "deg" ? `${number}°` : `${number} ${UNITS[code] ?? code}`;
}

/** A position with the letters of the patient's directions. */
export const places = (mm) =>
  mm.map((value, i) => `${["LR", "PA", "HF"][i][value < 0 ? 1 : 0]} ${Math.abs(value).toFixed(1)}`).join("  ");

/** The rectangle that three points span: the first two along its width. */
export function planeOf([a, b, c], least = 20) {
  const normal = unit(cross(sub(b, a), sub(c, a)));
  if (!(length(normal) > 0.5)) return null;
  const axis = unit(sub(b, a));
  const center = scale(add(add(a, b), c), 1 / 3);
  const reach = (direction) => 2 * Math.max(...[a, b, c].map((point) => Math.abs(dot(sub(point, center), direction))));
  const size = [reach(axis), reach(cross(normal, axis))].map((mm) => Math.max(least, mm));
  return { kind: "plane", center_mm: center, normal, axis, size_mm: size };
}

/** The centre of the points of a geometry. */
export function middleOf(geometry) {
  const points = pointsOf(geometry);
  if (!points.length) return null;
  return scale(points.reduce(add, [0, 0, 0]), 1 / points.length);
}
