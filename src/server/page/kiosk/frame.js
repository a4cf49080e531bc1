// Decodes live frames (see docs/LIVE.md) and composes the frame of the display.
//
// Colour travels as JPEG or as differences in a zlib stream, disparity D as differences (255 is
// nearest). The header of the display is written here, after decoding, so that no lossy codec
// can damage it. Pixels are in rows from the top.

import { LAYOUTS } from "./layouts.js";

const HEADER_BYTES = 128;
const FLAGS = { lossless: 1, full: 2, still: 4, back: 8 };
const COLOR = { 1: "jpeg", 3: "rgb-deflate" };
const DEPTH = { 0: "none", 3: "d8-deflate" };
/** The encodings that this page accepts, for `hello`. */
export const ACCEPT = { color: ["jpeg", "rgb-deflate"], depth: ["d8-deflate"] };

/** Parses the header of a frame in an ArrayBuffer; throws if it is invalid. */
export function readHeader(buffer) {
  const view = new DataView(buffer);
  const magic = buffer.byteLength >= HEADER_BYTES ? view.getUint32(0, false) : 0;
  if (magic !== 0x524c4956 || view.getUint16(4, true) !== 1) throw new Error("this is no frame of relief.v1");
  const flags = view.getUint8(9);
  const pair = (at) => [view.getUint16(at, true), view.getUint16(at + 2, true)];
  const floats = (at, count) => Array.from({ length: count }, (_, i) => view.getFloat32(at + 4 * i, true));
  const header = {
    lossless: Boolean(flags & FLAGS.lossless),
    still: Boolean(flags & FLAGS.still),
    back: Boolean(flags & FLAGS.back),
    color: COLOR[view.getUint8(10)],
    depth: DEPTH[view.getUint8(11)],
    sequence: view.getUint32(12, true),
    showsSeq: Number(view.getBigUint64(16, true)),
    showsNs: view.getBigUint64(24, true),
    totalUs: view.getUint32(32, true),
    renderUs: view.getUint32(36, true),
    size: pair(48),
    full: pair(52),
    limits: floats(56, 2),
    eye: floats(80, 3),
    lookAt: floats(92, 3),
    display: [64, 65, 66, 67].map((at) => view.getUint8(at)),
    layout: LAYOUTS[view.getUint8(68)]?.name,
    colorBytes: view.getUint32(72, true),
    depthBytes: view.getUint32(76, true),
  };
  const length = HEADER_BYTES + header.colorBytes + header.depthBytes;
  if (length !== buffer.byteLength) throw new Error(`a frame of ${buffer.byteLength} bytes says that it has ${length}`);
  if (!header.color || header.depth === undefined) throw new Error("the frame has a format that was not asked for");
  return header;
}

/** Colour (RGBA, one byte each) and disparity of a frame, in the transmitted size. */
export async function unpack(header, buffer) {
  const [width, rows] = [header.size[0], header.size[1] * (header.back ? 2 : 1)];
  const color = new Uint8Array(buffer, HEADER_BYTES, header.colorBytes);
  const depth = new Uint8Array(buffer, HEADER_BYTES + header.colorBytes, header.depthBytes);
  const [rgba, disparity] = await Promise.all([
    header.color === "jpeg" ? fromJpeg(color, width, rows) : fromDifferences(color, width, rows),
    header.depth === "none" ? null : inflate(depth, width * rows).then((d) => summed(d, width, rows, 1)),
  ]);
  return { rgba, disparity };
}

const fromJpeg = (bytes, width, rows) => pixelsOf(new Blob([bytes], { type: "image/jpeg" }), width, rows);

/** The pixels (RGBA, one byte each) of an encoded picture; throws if it has another size. */
export async function pixelsOf(blob, width, rows) {
  // No colour conversion: the picture has no profile, and its values are those of the display.
  const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
  const bitmap = await createImageBitmap(blob, options);
  if (bitmap.width !== width || bitmap.height !== rows) throw new Error("a picture has another size than was announced");
  const context = new OffscreenCanvas(width, rows).getContext("2d", { alpha: false, willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  return context.getImageData(0, 0, width, rows).data;
}

async function fromDifferences(bytes, width, rows) {
  const rgb = summed(await inflate(bytes, 3 * width * rows), width, rows, 3);
  const rgba = new Uint8ClampedArray(4 * width * rows).fill(255);
  for (let from = 0, to = 0; from < rgb.length; from += 3, to += 4) {
    rgba[to] = rgb[from];
    rgba[to + 1] = rgb[from + 1];
    rgba[to + 2] = rgb[from + 2];
  }
  return rgba;
}

/** A zlib stream of this many bytes; throws when there are more or fewer. */
async function inflate(bytes, length) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const out = new Uint8Array(length);
  let at = 0;
  for (const reader = stream.getReader(); ;) {
    const { value, done } = await reader.read();
    if (done) break;
    if (at + value.length > length) throw new Error(`a picture unpacks to more than ${length} bytes`);
    out.set(value, at);
    at += value.length;
  }
  if (at !== length) throw new Error(`a picture unpacks to ${at} bytes, expected ${length}`);
  return out;
}

/** Undoes horizontal prediction in place: from the pixel on the left, in the first column from the one above. */
function summed(values, width, rows, channels) {
  const line = width * channels;
  for (let y = 0; y < rows; y += 1) {
    const start = y * line;
    for (let c = 0; c < channels; c += 1) if (y > 0) values[start + c] += values[start - line + c];
    for (let at = start + channels; at < start + line; at += 1) values[at] += values[at - channels];
  }
  return values;
}

/** For every pixel of the full size the index of the nearest transmitted one. */
function places(from, to) {
  return Uint32Array.from({ length: to }, (_, at) => Math.floor(((2 * at + 1) * from) / (2 * to)));
}

/** RGBA and disparity of one layer, enlarged to full size. */
function enlarged({ rgba, disparity }, [fromWidth, fromHeight], [width, height], layer) {
  const first = layer * fromWidth * fromHeight;
  const pixels = new Uint32Array(rgba.buffer, rgba.byteOffset, rgba.length / 4);
  const color = new Uint32Array(width * height);
  const depth = new Uint8Array(width * height);
  const [columns, lines] = [places(fromWidth, width), places(fromHeight, height)];
  for (let y = 0, to = 0; y < height; y += 1) {
    const row = first + lines[y] * fromWidth;
    for (let x = 0; x < width; x += 1, to += 1) {
      color[to] = pixels[row + columns[x]];
      depth[to] = disparity?.[row + columns[x]] ?? 0;
    }
  }
  return { color, depth };
}

const OPAQUE_BLACK = 0xff000000;

/** The layers of a frame at full size, front first. `picture` is the result of `unpack`. */
export function layersOf(header, picture) {
  if (!header.layout) throw new Error("the frame has no layout that this page can compose");
  return (header.back ? [0, 1] : [0]).map((layer) => enlarged(picture, header.size, header.full, layer));
}

/** The display's frame as ImageData. */
export function compose(header, layers) {
  return composeLayers(header.layout, header.full, layers, header.display);
}

/** The layout of this name: whether it has a header, and where picture and disparity lie. */
export const layoutOf = (name) => Object.values(LAYOUTS).find((layout) => layout.name === name);

/** The frame of layers of colour (opaque RGBA in 32 bits) and depth (D), front first, in a layout. */
export function composeLayers(name, [width, height], layers, display) {
  const { placement, hasHeader } = layoutOf(name);
  if (!placement) return imageOf(layers[0].color.slice(), width, height);
  const { frameLines, lineStep, back } = placement;
  const pixels = new Uint32Array(2 * width * height * frameLines).fill(OPAQUE_BLACK);
  layers.forEach((layer, at) => {
    const first = at * (back === "below" ? height : 1);
    for (let y = 0; y < height; y += 1) {
      const line = (first + y * lineStep) * 2 * width;
      pixels.set(layer.color.subarray(y * width, (y + 1) * width), line);
      for (let x = 0; x < width; x += 1) pixels[line + width + x] = OPAQUE_BLACK | (layer.depth[y * width + x] * 0x010101);
    }
  });
  const image = imageOf(pixels, 2 * width, height * frameLines);
  if (hasHeader) writeHeader(image, headerBytes(display, Boolean(back)));
  return image;
}

function imageOf(pixels, width, height) {
  return new ImageData(new Uint8ClampedArray(pixels.buffer), width, height, { colorSpace: "srgb" });
}

// ---------------------------------------------------------------- the display's header

/** CRC-32 with Ethernet's polynomial, without initial value, reflection and final xor. */
function crc32(bytes) {
  let crc = 0;
  for (const byte of bytes) {
    crc ^= byte << 24;
    for (let bit = 0; bit < 8; bit += 1) crc = crc & 0x80000000 ? (crc << 1) ^ 0x04c11db7 : crc << 1;
  }
  return [24, 16, 8, 0].map((shift) => (crc >>> shift) & 0xff);
}

/** All 32 bytes of the header, from H1 to H4. */
export function headerBytes(display, declipse = false) {
  const base = [0xf1, ...display, 0];
  const extended = [0xf2, 0x14, declipse ? 0xef : 0x00, ...new Array(15).fill(0)];
  return [...base, ...crc32(base), ...extended, ...crc32(extended)];
}

/** Writes bytes into the top blue bits of the even pixels of the first line. */
function writeHeader(image, bytes) {
  bytes.forEach((byte, at) => {
    for (let y = 0; y < 8; y += 1) {
      const blue = 4 * (16 * at + 2 * (7 - y)) + 2;
      image.data[blue] = (image.data[blue] & 0x7f) | (((byte >> y) & 1) << 7);
    }
  });
}

/** The 32 bytes in the first line of RGBA pixels. */
export function readBytes(line) {
  return Array.from({ length: 32 }, (_, at) => {
    let byte = 0;
    for (let y = 0; y < 8; y += 1) byte |= (line[4 * (16 * at + 2 * (7 - y)) + 2] >> 7) << y;
    return byte;
  });
}

/** Whether these bytes are a header with two valid checksums. */
export function isHeader(bytes) {
  const right = (from, to) => crc32(bytes.slice(from, to)).every((byte, at) => byte === bytes[to + at]);
  return bytes[0] === 0xf1 && bytes[10] === 0xf2 && right(0, 6) && right(10, 28);
}
