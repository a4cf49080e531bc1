// Vectors of three numbers, as arrays. It touches no element.

export const add = (a, b) => a.map((value, i) => value + b[i]);
export const sub = (a, b) => a.map((value, i) => value - b[i]);
export const scale = (a, factor) => a.map((value) => value * factor);
export const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);
export const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
export const length = (a) => Math.hypot(...a);
export const unit = (a) => scale(a, 1 / (length(a) || 1));
export const lerp = (a, b, t) => a.map((value, i) => value + (b[i] - value) * t);
export const distance = (a, b) => length(sub(a, b));
export const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
