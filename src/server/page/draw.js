// Draws a fetched picture in the chosen view. Rows and columns are those of the picture,
// not of the stage.

/**
 * Draws `shown` ({ bitmap, kind }): kind "rgbd" has colour on the left and disparity on the right, "color" and
 * "frame" are shown as they are. `view` is picture, depth, split or frame; `split` is where depth begins, 0 to 1.
 * `room` is the width in device pixels: a larger frame is reduced by an integer factor, which averages its black lines
 * without moiré; one that fits keeps its pixels.
 */
export function drawPicture(context, { bitmap, kind }, { view, split, factor, offset }, room) {
  const { canvas } = context;
  const width = kind === "rgbd" ? bitmap.width / 2 : bitmap.width;
  const scale = kind === "frame" ? 1 / Math.max(1, Math.ceil(width / room)) : 1;
  const [across, down] = [width, bitmap.height].map((side) => Math.round(side * scale));
  if (canvas.width !== across || canvas.height !== down) {
    canvas.width = across;
    canvas.height = down;
  }
  canvas.classList.toggle("pixels", kind === "frame" && scale === 1);
  context.imageSmoothingQuality = "high";
  context.drawImage(bitmap, 0, 0, width, bitmap.height, 0, 0, across, down);
  if (kind !== "rgbd" || view === "picture" || view === "frame") return;
  const from = view === "split" ? Math.round(split * width) : 0;
  if (from < width) drawDepth(context, bitmap, from, { factor, offset });
}

/** The depth half as a display with this factor and offset interprets it: brighter is nearer, mid-grey is the screen. */
function drawDepth(context, bitmap, from, { factor, offset }) {
  const [half, height] = [bitmap.width / 2, bitmap.height];
  const width = half - from;
  context.drawImage(bitmap, half + from, 0, width, height, from, 0, width, height);
  const pixels = context.getImageData(from, 0, width, height);
  const curve = Uint8ClampedArray.from({ length: 256 }, (_, d) => 128 + (d - offset) * (factor / 64));
  for (let i = 0; i < pixels.data.length; i += 4) {
    pixels.data[i] = pixels.data[i + 1] = pixels.data[i + 2] = curve[pixels.data[i]];
  }
  context.putImageData(pixels, from, 0);
}
