// Lengths in mm as text, for volumes of any scale: bodies, and micro-CT whose voxels are a few µm. It touches no element.

import { distance } from "./vectors.js";

/** Decimals with which a length of a volume is written: a tenth of a millimetre, or a tenth of its smallest spacing. */
export function decimalsOf({ spacing_mm: spacing }) {
  const finest = Math.min(...spacing);
  return finest >= 0.1 ? 1 : Math.ceil(1 - Math.log10(finest));
}

/** A step of a control: `mm` in bodies, the diagonal divided by `parts` in smaller volumes. */
export const stepIn = (bounds, mm, parts) => Math.min(mm, distance(...bounds) / parts);

/** A length for people: in mm, or in µm where it is less than a tenth of a millimetre. */
export function lengthWords(mm, decimals = 1) {
  const size = Math.abs(mm);
  return size >= 0.1 || size === 0 ? `${mm.toFixed(decimals)} mm` : `${Number((1000 * mm).toPrecision(3))} µm`;
}

/** A position of a control along an axis of a volume. */
export const placeWords = (mm, volume) => `${mm.toFixed(decimalsOf(volume) - 1)} mm`;

/** The spacing of a volume for people. */
export function spacingWords({ spacing_mm: spacing }) {
  const isFine = Math.max(...spacing) < 0.1;
  const numbers = spacing.map((mm) => Number(isFine ? (1000 * mm).toPrecision(4) : mm.toFixed(3)));
  return `${numbers.join(" × ")} ${isFine ? "µm" : "mm"}`;
}
