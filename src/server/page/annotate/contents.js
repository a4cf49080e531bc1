// Files of regions and meshes as the page draws them: `.seg.nrrd` masks and binary PLY, in patient
// LPS mm. It accesses no element.

/** Greatest number of a region's surface voxels drawn in 3D. */
const MOST_SKIN = 60_000;

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const vectors = (text) => [...text.matchAll(/\(([^)]*)\)/g)].map(([, inner]) => inner.split(",").map(Number));

const TYPES = {
  "unsigned char": Uint8Array, uint8: Uint8Array, uint8_t: Uint8Array, uchar: Uint8Array,
  "unsigned short": Uint16Array, uint16: Uint16Array, ushort: Uint16Array, uint16_t: Uint16Array, short: Int16Array, int16: Int16Array,
};

/** The content of a preview, whose file is base64. */
export function previewed({ content, label }) {
  return readRegion(Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0)), label);
}

/** The mask of one label: `{ dims, mask, origin, columns, inverse, skin }`, cropped to its voxels. */
async function readRegion(bytes, label) {
  const end = findBlankLine(bytes);
  const header = new TextDecoder("latin1").decode(bytes.subarray(0, end));
  const field = (name) => new RegExp(`^${name}:=?\\s*(.*)$`, "mi").exec(header)?.[1].trim() ?? "";
  const dims = field("sizes").split(/\s+/).map(Number).slice(-3);
  const Kind = TYPES[field("type")];
  const encoding = field("encoding");
  if (!Kind || dims.length !== 3 || !/^(raw|gzip|gz)$/.test(encoding)) throw new Error("this region's file has a form that the page cannot draw");
  const packed = bytes.subarray(end);
  const raw = encoding === "raw" ? packed.slice() : await inflated(packed);
  const values = new Kind(raw.buffer, 0, dims[0] * dims[1] * dims[2]);
  const flips = /right-anterior|RAS/i.test(field("space")) ? [-1, -1, 1] : [1, 1, 1];
  const lps = (vector) => vector.map((value, i) => value * flips[i]);
  const columns = vectors(field("space directions")).slice(-3).map(lps);
  const origin = lps(vectors(field("space origin"))[0]);
  return finish(values, label, dims, columns, origin);
}

function findBlankLine(bytes) {
  for (let i = 1; i < bytes.length; i += 1) {
    if (bytes[i] === 10 && (bytes[i - 1] === 10 || (bytes[i - 1] === 13 && bytes[i - 2] === 10))) return i + 1;
  }
  throw new Error("this region's file has no end of its header");
}

function finish(values, label, dims, columns, origin) {
  const [nx, ny, nz] = dims;
  const mask = new Uint8Array(values.length);
  for (let i = 0; i < values.length; i += 1) mask[i] = values[i] === label ? 1 : 0;
  const at = (x, y, z) => (x >= 0 && y >= 0 && z >= 0 && x < nx && y < ny && z < nz ? mask[x + nx * (y + ny * z)] : 0);
  const skin = [];
  for (let z = 0, i = 0; z < nz; z += 1) {
    for (let y = 0; y < ny; y += 1) {
      for (let x = 0; x < nx; x += 1, i += 1) {
        if (!mask[i]) continue;
        const inside = at(x - 1, y, z) & at(x + 1, y, z) & at(x, y - 1, z) & at(x, y + 1, z) & at(x, y, z - 1) & at(x, y, z + 1);
        if (!inside) skin.push([x, y, z]);
      }
    }
  }
  // The normal points to where the region is sparser within two voxels: smooth enough for shading.
  const slope = ([x, y, z]) => {
    const sum = [0, 0, 0];
    for (let k = -2; k <= 2; k += 1) {
      for (let j = -2; j <= 2; j += 1) {
        for (let i = -2; i <= 2; i += 1) {
          if (!at(x + i, y + j, z + k)) continue;
          sum[0] -= i;
          sum[1] -= j;
          sum[2] -= k;
        }
      }
    }
    return sum;
  };
  const place = ([x, y, z]) => origin.map((value, i) => value + columns[0][i] * x + columns[1][i] * y + columns[2][i] * z);
  const turn = ([x, y, z]) => [0, 1, 2].map((i) => columns[0][i] * x + columns[1][i] * y + columns[2][i] * z);
  const every = Math.max(1, Math.ceil(skin.length / MOST_SKIN));
  const points = [];
  for (let i = 0; i < skin.length; i += every) points.push({ at: place(skin[i]), normal: turn(slope(skin[i])) });
  const spacing = Math.min(...columns.map((column) => Math.hypot(...column)));
  return { kind: "region", dims, mask, origin, columns, inverse: inverse(columns), points, spacing: spacing * Math.sqrt(every) };
}

/** Rows of the inverse of the matrix whose columns are the steps of a voxel: from mm to indices. */
function inverse([a, b, c]) {
  const cross = (u, v) => [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
  const volume = a.reduce((sum, value, i) => sum + value * cross(b, c)[i], 0);
  return [cross(b, c), cross(c, a), cross(a, b)].map((row) => row.map((value) => value / volume));
}

const SIZES = { char: 1, uchar: 1, int8: 1, uint8: 1, short: 2, ushort: 2, int16: 2, uint16: 2, int: 4, uint: 4, int32: 4, uint32: 4, float: 4, float32: 4, double: 8, float64: 8 };

/** Vertices (x, y, z, ...) and triangles of a binary little-endian PLY. */
function readMesh(bytes) {
  const text = new TextDecoder("latin1").decode(bytes.subarray(0, Math.min(bytes.length, 16_384)));
  const end = text.indexOf("end_header\n") + "end_header\n".length;
  const count = (name) => Number(new RegExp(`element ${name} (\\d+)`).exec(text)?.[1] ?? 0);
  if (end < 12 || !text.includes("format binary_little_endian")) throw new Error("this mesh's file has a form that the page cannot draw");
  const [beforeFaces] = text.slice(0, end).split(/element face/);
  const properties = [...beforeFaces.matchAll(/property (\w+) (\w+)/g)].map(([, type, name]) => ({ type, name }));
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const read = (at, type) => (SIZES[type] === 8 ? view.getFloat64(at, true) : view.getFloat32(at, true));
  let offset = 0;
  const offsets = properties.map(({ type, name }) => ({ type, name, at: (offset += SIZES[type]) - SIZES[type] }));
  const axes = ["x", "y", "z"].map((axis) => offsets.find(({ name }) => name === axis));
  const vertices = new Float32Array(3 * count("vertex"));
  for (let i = 0; i < vertices.length; i += 1) {
    const axis = axes[i % 3];
    vertices[i] = read(end + offset * Math.floor(i / 3) + axis.at, axis.type);
  }
  const [, lengthType, indexType] = /property list (\w+) (\w+)/.exec(text) ?? [null, "uchar", "int"];
  const [lengthBytes, indexBytes] = [SIZES[lengthType], SIZES[indexType]];
  const triangles = new Uint32Array(3 * count("face"));
  let at = end + (offset * vertices.length) / 3;
  for (let face = 0; face < triangles.length; face += 3) {
    at += lengthBytes;
    for (let corner = 0; corner < 3; corner += 1, at += indexBytes) triangles[face + corner] = view.getUint32(at, true);
  }
  return { kind: "mesh", vertices, triangles };
}

/** Contents by name, each fetched once. */
export class Contents {
  #known = new Map();

  /** Calls `arrived` when a content is loaded and `fail` with errors. */
  constructor(annotations, arrived, fail) {
    Object.assign(this, { annotations, arrived, fail });
  }

  /** A geometry's decoded content; null while it loads, or if it cannot be drawn. */
  of(geometry) {
    const key = `${geometry.content}:${geometry.label ?? ""}`;
    if (!this.#known.has(key)) {
      this.#known.set(key, null);
      this.#fetch(key, geometry).catch((error) => this.fail(error));
    }
    return this.#known.get(key);
  }

  async #fetch(key, geometry) {
    const bytes = await this.annotations().content(geometry.content);
    this.#known.set(key, geometry.kind === "mesh" ? readMesh(bytes) : await readRegion(bytes, geometry.label));
    this.arrived();
  }
}
