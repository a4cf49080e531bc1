// Compares the views that a display makes of a picture and its depth with views that are rendered for each
// eye. Computes one number for each view and a map of the differences.

/** The smallest difference that is white in the map: root mean square over views and colours, of 255. */
const WHITE = 64;

/** The pixels of a bitmap: red, green, blue, alpha. */
function pixelsOf(bitmap) {
  const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  return context.getImageData(0, 0, bitmap.width, bitmap.height).data;
}

/** Peak signal-to-noise ratio, dB, of a sum of squared differences of bytes. */
function decibels(squares, values) {
  return 10 * Math.log10((255 * 255 * values) / squares);
}

/**
 * Compares two quilts of views, bitmaps of one size, of a grid of columns and rows.
 * Returns the ratio of each view in dB, infinite where it is equal, and the map as ImageData of a view's size.
 */
export function compare(made, truth, [columns, rows]) {
  const [a, b] = [pixelsOf(made), pixelsOf(truth)];
  const [width, height] = [made.width / columns, made.height / rows];
  const map = new ImageData(width, height);
  const squaresOfPixel = new Float64Array(width * height);
  const squaresOfView = new Float64Array(columns * rows);
  for (let at = 0; at < a.length; at += 4) {
    const [x, y] = [(at / 4) % made.width, Math.floor(at / 4 / made.width)];
    const squares = (a[at] - b[at]) ** 2 + (a[at + 1] - b[at + 1]) ** 2 + (a[at + 2] - b[at + 2]) ** 2;
    squaresOfPixel[(y % height) * width + (x % width)] += squares;
    squaresOfView[Math.floor(y / height) * columns + Math.floor(x / width)] += squares;
  }
  const values = 3 * columns * rows;
  squaresOfPixel.forEach((squares, at) => {
    const grey = Math.round((Math.sqrt(squares / values) * 255) / WHITE);
    map.data.set([grey, grey, grey, 255], 4 * at);
  });
  return { psnr: [...squaresOfView].map((squares) => decibels(squares, 3 * width * height)), map };
}

/** The comparison in words: the mean and the worst of the views that differ. */
export function inWords(psnr) {
  const finite = psnr.filter(Number.isFinite);
  if (finite.length === 0) return "Equal to true views.";
  const mean = finite.reduce((sum, db) => sum + db, 0) / finite.length;
  return `${mean.toFixed(1)} dB from true views, the worst one ${Math.min(...finite).toFixed(1)} dB.`;
}
