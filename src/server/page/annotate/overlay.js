// Annotations as SVG over a picture: text of elements, for a projection and a size in CSS pixels. It
// accesses no element.
//
// In a slice, items near the plane are opaque and fade with the distance. In 3D, hidden items are
// dimmed.

import { add, clamp, corners, cross, distance, dot, lerp, length, measureWords, measures as measured, outline, pointsOf, scale, sub, unit } from "./geometry.js";
import { SliceProjection } from "./projections.js";
import { colorOf } from "./model.js";

/** Distances from a slice's plane, mm: opaque up to the first, invisible from the second. */
const NEAR_MM = 1.5;
const REACH_MM = 12;
const HIDDEN = 0.32;
const MOST_LABELS = 150;
/** Number of attempts to place labels: with more labels there is no room for them. */
const MOST_TRIES = 600;
/** Above this number of items, unselected points are dots: one element for each colour and opacity. */
const CROWD = 400;
/** Length of the segments of lines whose opacity varies. */
const PART_MM = 3;
const MOST_PARTS = 60;

const escaped = (text) => text.replace(/[&<>"']/g, (letter) => `&#${letter.charCodeAt(0)};`);
const fixed = (value) => value.toFixed(1);

/** Opacity of a projected point, 0 to 1. */
function strength(projection, projected) {
  if (!projected) return 0;
  if (!(projection instanceof SliceProjection)) return projection.hides(projected) ? HIDDEN : 1;
  const off = Math.abs(projected.off);
  return off <= NEAR_MM ? 1 : 0.8 * Math.max(0, 1 - (off - NEAR_MM) / (REACH_MM - NEAR_MM)) ** 1.5;
}

class Drawing {
  constructor(projection, [width, height]) {
    Object.assign(this, { projection, width, height, parts: [], texts: [], boxes: [], dots: new Map(), tries: 0 });
  }

  /** A point drawn as a dot. */
  dot(at, color) {
    if (at.strength <= 0.1 || !this.isSeen(at)) return;
    const key = `stroke="${color}" opacity="${(Math.ceil(5 * at.strength) / 5).toFixed(1)}"`;
    const known = this.dots.get(key) ?? [];
    if (!known.length) this.dots.set(key, known);
    known.push(`M${fixed(at.x)} ${fixed(at.y)}h0`);
  }

  get svg() {
    const dots = [...this.dots].map(([attributes, places]) => `<path d="${places.join("")}" class="dots" ${attributes}/>`);
    return dots.join("") + this.parts.join("") + this.texts.join("");
  }

  place(point) {
    const projected = this.projection.project(point);
    if (!projected) return null;
    const [x, y] = [projected.at[0] * this.width, projected.at[1] * this.height];
    return { x, y, strength: strength(this.projection, projected), off: projected.off ?? 0 };
  }

  isSeen({ x, y }) {
    return x > -30 && y > -30 && x < this.width + 30 && y < this.height + 30;
  }

  /** A line through points, in segments of one opacity each. */
  line(points, attributes) {
    const runs = [];
    for (let i = 1; i < points.length; i += 1) {
      const count = Math.min(MOST_PARTS, Math.max(1, Math.ceil(distance(points[i - 1], points[i]) / PART_MM)));
      for (let part = 0; part < count; part += 1) {
        const [a, b] = [part, part + 1].map((at) => this.place(lerp(points[i - 1], points[i], at / count)));
        if (!a || !b) continue;
        const level = Math.round(5 * Math.min(a.strength, b.strength)) / 5 || (Math.max(a.strength, b.strength) > 0.1 ? 0.15 : 0);
        const last = runs.at(-1);
        if (last?.level === level && last.end === `${i}:${part}`) {
          last.path += `L${fixed(b.x)} ${fixed(b.y)}`;
          last.end = `${i}:${part + 1}`;
        } else {
          runs.push({ level, path: `M${fixed(a.x)} ${fixed(a.y)}L${fixed(b.x)} ${fixed(b.y)}`, end: `${i}:${part + 1}` });
        }
        if (part === count - 1) runs.at(-1).end = `${i + 1}:0`;
      }
    }
    for (const { level, path } of runs) if (level > 0) this.parts.push(`<path d="${path}" opacity="${level}" ${attributes}/>`);
  }

  point(at, { color, selected, active, locked }) {
    if (at.strength <= 0.03 || !this.isSeen(at)) return;
    const radius = selected ? 6 : 4.5;
    const form = locked
      ? `<rect x="${fixed(at.x - 4)}" y="${fixed(at.y - 4)}" width="8" height="8" rx="1"`
      : `<circle cx="${fixed(at.x)}" cy="${fixed(at.y)}" r="${radius}"`;
    const halo = selected ? `<circle cx="${fixed(at.x)}" cy="${fixed(at.y)}" r="${active ? 11 : 9}" class="halo" stroke="${color}"/>` : "";
    const dot = `<circle cx="${fixed(at.x)}" cy="${fixed(at.y)}" r="1.3" fill="${color}"/>`;
    const dashes = at.strength === HIDDEN ? ' stroke-dasharray="2 2"' : "";
    this.parts.push(`<g opacity="${at.strength.toFixed(2)}">${halo}${form} class="ring" stroke="${color}"${dashes}/>${dot}</g>`);
  }

  /** A label beside a position, if it overlaps no other; labels of selected items are always drawn. */
  text(at, words, { color, selected }) {
    if (at.strength < 0.3 || !this.isSeen(at) || ((this.texts.length >= MOST_LABELS || this.tries > MOST_TRIES) && !selected)) return;
    this.tries += 1;
    const width = (selected ? 7.2 : 6.5) * words.length;
    const [left, right] = [-9 - width, 9];
    const sides = [-7, 15, -21, 29].flatMap((dy) => [[right, dy], [left, dy]]);
    const inside = sides.filter(([dx]) => at.x + dx > 0 && at.x + dx + width < this.width);
    // Too wide for either side: above or below the position, shifted into the picture.
    const between = clamp(right, 2 - at.x, Math.max(2, this.width - width - 2) - at.x);
    const tries = inside.length ? inside : [[between, -12], [between, 20]];
    const free = tries.find(([dx, dy]) => !this.boxes.some((box) => overlaps(box, [at.x + dx, at.y + dy - 11, width, 14])));
    if (!free && !selected) return;
    const [dx, dy] = free ?? tries[0];
    this.boxes.push([at.x + dx, at.y + dy - 11, width, 14]);
    const opacity = Math.min(1, at.strength + 0.05).toFixed(2);
    // Widths are estimates: text on the left is aligned to its end.
    const [start, anchor] = dx === left ? [-9, ' text-anchor="end"'] : [dx, ""];
    this.texts.push(`<text x="${fixed(at.x + start)}"${anchor} y="${fixed(at.y + dy)}" fill="${color}" opacity="${opacity}"${selected ? ' class="chosen"' : ""}>${escaped(words)}</text>`);
  }
}

const overlaps = ([ax, ay, aw, ah], [bx, by, bw, bh]) => ax < bx + bw && bx < ax + aw && ay < by + bh && by < ay + ah;

/** The arc between the arms of an angle, near its vertex. */
function arc([a, corner, b]) {
  const [first, second] = [sub(a, corner), sub(b, corner)];
  const radius = 0.25 * Math.min(length(first), length(second));
  const [from, to] = [unit(first), unit(second)];
  const turn = Math.acos(Math.min(1, Math.max(-1, dot(from, to))));
  const side = unit(sub(to, scale(from, dot(from, to))));
  return Array.from({ length: 13 }, (_, i) => {
    const angle = (turn * i) / 12;
    return add(corner, scale(add(scale(from, Math.cos(angle)), scale(side, Math.sin(angle))), radius));
  });
}

/** The intersection of a plane's rectangle with a slice: two points, or nothing. */
function crossing(plane, projection) {
  const edges = corners(plane);
  const found = [];
  for (let i = 1; i < edges.length; i += 1) {
    const [a, b] = [edges[i - 1], edges[i]];
    const [from, to] = [a, b].map((point) => projection.project(point).off);
    if (from * to < 0) found.push(lerp(a, b, from / (from - to)));
  }
  return found.slice(0, 2);
}

function drawItem(drawing, { item, measures = measured(item.geometry) }, { selected, handle, crowded = false }) {
  const color = colorOf(item);
  const { geometry, locked, name } = item;
  if (crowded && geometry.kind === "point" && !selected) {
    const at = drawing.place(geometry.at_mm);
    if (!at) return;
    drawing.dot(at, color);
    return drawing.text(at, name, { color, selected });
  }
  const stroke = `class="${selected ? "path chosen" : "path"}" stroke="${color}"`;
  drawing.line(outline(geometry), stroke);
  if (geometry.kind === "angle") drawing.line(arc(geometry.points_mm), `class="path thin" stroke="${color}"`);
  if (geometry.kind === "plane") {
    const { center_mm: center, normal, size_mm: size } = geometry;
    drawing.line([center, add(center, scale(normal, 0.3 * Math.min(...size)))], `class="path thin" stroke="${color}"`);
    if (drawing.projection instanceof SliceProjection) {
      const meets = crossing(geometry, drawing.projection);
      if (meets.length === 2) drawing.line(meets, stroke);
    }
  }
  const points = pointsOf(geometry).map((point) => drawing.place(point));
  points.forEach((at, i) => at && drawing.point(at, { color, selected, active: selected && i === handle, locked }));
  const labelled = points.filter(Boolean).sort((a, b) => b.strength - a.strength)[0];
  const measure = measures[0] ? ` ${measureWords(measures[0])}` : "";
  if (labelled) drawing.text(labelled, `${name}${measure}`, { color, selected });
}

/**
 * SVG of items and of the draft on a picture of `size` CSS pixels. `draft` is an item that is not saved yet, with the
 * displacement by snapping.
 */
export function itemsSvg(entries, projection, size, { selected = null, handle = 0, draft = null, moved = null } = {}) {
  const drawing = new Drawing(projection, size);
  const crowded = entries.length > CROWD;
  const ordered = [...entries].sort((a, b) => (a.item.id === selected ? -1 : 0) - (b.item.id === selected ? -1 : 0));
  for (const entry of ordered) {
    const shown = moved?.id === entry.item.id ? { ...entry, ...moved } : entry;
    if (shown.item.geometry) drawItem(drawing, shown, { selected: entry.item.id === selected, handle, crowded });
  }
  if (draft) {
    drawItem(drawing, draft, { selected: true, handle: draft.handle });
    if (draft.from) drawing.line([draft.from, draft.to], 'class="path shift" stroke="#fff"');
  }
  return drawing.svg;
}

/** The lines where other planes cut a slice, through the cursor: `planes` are [normal, colour]. */
export function crossSvg(projection, cursor, planes, [width, height]) {
  const parts = [];
  const middle = projection.project(cursor).at;
  const [x, y] = [middle[0] * width, middle[1] * height];
  for (const [normal, color, weak] of planes) {
    const direction = cross(projection.normal, normal);
    if (length(direction) < 0.02) continue;
    const along = unit(direction);
    const [dx, dy] = unit([dot(along, projection.right), -dot(along, projection.up)]);
    for (const sign of [-1, 1]) {
      const [from, to] = [9 * sign, 4000 * sign];
      const ends = `x1="${fixed(x + dx * from)}" y1="${fixed(y + dy * from)}" x2="${fixed(x + dx * to)}" y2="${fixed(y + dy * to)}"`;
      parts.push(`<line ${ends} class="cross${weak ? " weak" : ""}" stroke="${color}"/>`);
    }
  }
  return parts.join("");
}

/** The cursor in 3D: three short lines along the patient's axes. */
export function cursorSvg(projection, cursor, colors, [width, height], bounds) {
  const parts = [];
  colors.forEach((color, axis) => {
    const [from, to] = bounds.map((corner) => cursor.map((value, i) => (i === axis ? Math.min(Math.max(value + (corner[i] > value ? 14 : -14), bounds[0][i]), bounds[1][i]) : value)));
    const [a, b] = [from, to].map((end) => projection.project(end)?.at);
    if (!a || !b) return;
    const ends = `x1="${fixed(a[0] * width)}" y1="${fixed(a[1] * height)}" x2="${fixed(b[0] * width)}" y2="${fixed(b[1] * height)}"`;
    parts.push(`<line ${ends} class="cross" stroke="${color}"/>`);
  });
  const at = projection.project(cursor)?.at;
  if (at) parts.push(`<circle cx="${fixed(at[0] * width)}" cy="${fixed(at[1] * height)}" r="3" class="cross-middle"/>`);
  return parts.join("");
}
