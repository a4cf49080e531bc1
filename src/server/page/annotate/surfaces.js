// Draws regions and meshes on a pane's layer: as areas and outlines in slices, as lit surfaces in
// 3D, hidden parts dimmed.

const rgb = (color) => [1, 3, 5].map((at) => parseInt(color.slice(at, at + 2), 16));

/** Prepares a layer for its pane: returns its size in layer pixels, half the CSS pixels if that is enough. */
function cleared(pane, scale) {
  const [width, height] = pane.size.map((side) => Math.max(1, Math.round(side * scale)));
  const { layer } = pane;
  if (layer.width !== width || layer.height !== height) Object.assign(layer, { width, height });
  const context = layer.getContext("2d");
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** `shapes` are `{ content, color, selected }`. */
export function drawInSlice(pane, shapes) {
  const scale = Math.min(2, devicePixelRatio);
  if (!shapes.length) return cleared(pane, 0);
  const { context, width, height } = cleared(pane, scale);
  for (const shape of shapes) {
    if (shape.content.kind === "region") drawArea(context, pane.projection, shape, width, height);
    else drawCut(context, pane.projection, shape, width, height, scale);
  }
}

/** The voxels in the slice's plane, with an opaque outline. */
function drawArea(context, projection, { content, color, selected }, width, height) {
  const [w, h] = [Math.ceil(width / 2), Math.ceil(height / 2)];
  const index = (x, y) => {
    const point = projection.unproject([x / w, y / h]);
    return content.inverse.map((row) => row.reduce((sum, value, i) => sum + value * (point[i] - content.origin[i]), 0));
  };
  const start = index(0.5, 0.5);
  const [across, down] = [index(1.5, 0.5), index(0.5, 1.5)].map((end) => end.map((value, i) => value - start[i]));
  const [nx, ny, nz] = content.dims;
  const hit = new Uint8Array(w * h);
  for (let row = 0, i = 0; row < h; row += 1) {
    for (let column = 0; column < w; column += 1, i += 1) {
      const x = Math.round(start[0] + across[0] * column + down[0] * row);
      const y = Math.round(start[1] + across[1] * column + down[1] * row);
      const z = Math.round(start[2] + across[2] * column + down[2] * row);
      if (x >= 0 && y >= 0 && z >= 0 && x < nx && y < ny && z < nz) hit[i] = content.mask[x + nx * (y + ny * z)];
    }
  }
  const image = new ImageData(w, h);
  const [r, g, b] = rgb(color);
  for (let i = 0; i < hit.length; i += 1) {
    if (!hit[i]) continue;
    const edge = !(hit[i - 1] && hit[i + 1] && hit[i - w] && hit[i + w]);
    image.data.set([r, g, b, edge ? 235 : selected ? 110 : 70], 4 * i);
  }
  const small = new OffscreenCanvas(w, h);
  small.getContext("2d").putImageData(image, 0, 0);
  context.drawImage(small, 0, 0, width, height);
}

/** The intersection of triangles with the slice's plane. */
function drawCut(context, projection, { content, color, selected }, width, height, scale) {
  const { vertices, triangles } = content;
  const { center, normal } = projection;
  const offs = new Float32Array(vertices.length / 3);
  for (let i = 0; i < offs.length; i += 1) {
    offs[i] = normal[0] * (vertices[3 * i] - center[0]) + normal[1] * (vertices[3 * i + 1] - center[1]) + normal[2] * (vertices[3 * i + 2] - center[2]);
  }
  context.beginPath();
  const ends = [];
  for (let face = 0; face < triangles.length; face += 3) {
    ends.length = 0;
    for (let corner = 0; corner < 3; corner += 1) {
      const [a, b] = [triangles[face + corner], triangles[face + ((corner + 1) % 3)]];
      if (offs[a] < 0 === offs[b] < 0) continue;
      const t = offs[a] / (offs[a] - offs[b]);
      ends.push([0, 1, 2].map((i) => vertices[3 * a + i] + t * (vertices[3 * b + i] - vertices[3 * a + i])));
    }
    if (ends.length !== 2) continue;
    const [from, to] = ends.map((point) => projection.project(point).at);
    context.moveTo(from[0] * width, from[1] * height);
    context.lineTo(to[0] * width, to[1] * height);
  }
  context.strokeStyle = color;
  context.lineWidth = (selected ? 2.4 : 1.6) * scale;
  context.lineCap = "round";
  context.stroke();
}

/** Surfaces with their depths, dimmed where the volume hides them. */
export function drawIn3d(pane, shapes) {
  if (!shapes.length) return cleared(pane, 0);
  const { context, width, height } = cleared(pane, 1);
  const image = new ImageData(width, height);
  const nearest = new Float32Array(width * height).fill(Infinity);
  for (const shape of shapes) {
    const draw = shape.content.kind === "mesh" ? fillTriangles : fillVoxels;
    draw(shape, pane.projection, { width, height, data: image.data, nearest });
  }
  const { depths } = pane.projection;
  if (depths) {
    for (let y = 0, i = 0; y < height; y += 1) {
      for (let x = 0; x < width; x += 1, i += 1) {
        const seen = nearest[i] < Infinity ? depths.at([(x + 0.5) / width, (y + 0.5) / height]) : undefined;
        if (seen !== undefined && seen + depths.tolerance < nearest[i]) image.data[4 * i + 3] = 70;
      }
    }
  }
  context.putImageData(image, 0, 0);
}

/** Brightness of a surface by its normal, with a light at the eye: 0.25 to 1. */
const lit = (facing) => 0.25 + 0.75 * Math.min(1, Math.abs(facing));

function fillVoxels({ content, color, selected }, projection, target) {
  const base = rgb(color);
  for (const { at, normal } of content.points) {
    const seen = projection.project(at);
    if (!seen) continue;
    const size = Math.hypot(...normal) || 1;
    const facing = (normal[0] * projection.forward[0] + normal[1] * projection.forward[1] + normal[2] * projection.forward[2]) / size;
    const beside = projection.project(at.map((value, i) => value + content.spacing * projection.right[i]));
    const half = Math.max(0.5, 0.9 * Math.abs(beside.at[0] - seen.at[0]) * target.width);
    const [x, y] = [seen.at[0] * target.width, seen.at[1] * target.height];
    const shade = base.map((channel) => channel * lit(facing));
    for (let row = Math.round(y - half); row <= y + half; row += 1) {
      for (let column = Math.round(x - half); column <= x + half; column += 1) put(target, column, row, seen.depth, shade, selected);
    }
  }
}

function put({ width, height, data, nearest }, x, y, depth, shade, selected) {
  if (x < 0 || y < 0 || x >= width || y >= height) return;
  const i = y * width + x;
  if (depth >= nearest[i]) return;
  nearest[i] = depth;
  data[4 * i] = shade[0];
  data[4 * i + 1] = shade[1];
  data[4 * i + 2] = shade[2];
  data[4 * i + 3] = selected ? 235 : 200;
}

function fillTriangles({ content, color, selected }, projection, target) {
  const { vertices, triangles } = content;
  const count = vertices.length / 3;
  const placed = new Float32Array(3 * count);
  for (let i = 0; i < count; i += 1) {
    const seen = projection.project([vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]]);
    placed.set(seen ? [seen.at[0] * target.width, seen.at[1] * target.height, seen.depth] : [NaN, NaN, NaN], 3 * i);
  }
  const base = rgb(color);
  const corner = (i) => [vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]];
  for (let face = 0; face < triangles.length; face += 3) {
    const [a, b, c] = [triangles[face], triangles[face + 1], triangles[face + 2]];
    const [p, q, r] = [corner(a), corner(b), corner(c)];
    const [u, v] = [q.map((value, i) => value - p[i]), r.map((value, i) => value - p[i])];
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const facing = (normal[0] * projection.forward[0] + normal[1] * projection.forward[1] + normal[2] * projection.forward[2]) / (Math.hypot(...normal) || 1);
    fillTriangle(placed, a, b, c, base.map((channel) => channel * lit(facing)), target, selected);
  }
}

/** Interpolates barycentric coordinates at the centres of pixels. */
function fillTriangle(placed, a, b, c, shade, target, selected) {
  const [ax, ay, az, bx, by, bz, cx, cy, cz] = [a, b, c].flatMap((i) => [placed[3 * i], placed[3 * i + 1], placed[3 * i + 2]]);
  const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
  if (!(Math.abs(area) > 1e-6)) return;
  const [left, right] = [Math.max(0, Math.floor(Math.min(ax, bx, cx))), Math.min(target.width - 1, Math.ceil(Math.max(ax, bx, cx)))];
  const [top, bottom] = [Math.max(0, Math.floor(Math.min(ay, by, cy))), Math.min(target.height - 1, Math.ceil(Math.max(ay, by, cy)))];
  for (let y = top; y <= bottom; y += 1) {
    for (let x = left; x <= right; x += 1) {
      const [px, py] = [x + 0.5, y + 0.5];
      const ofB = ((px - ax) * (cy - ay) - (py - ay) * (cx - ax)) / area;
      const ofC = ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) / area;
      if (ofB < -1e-4 || ofC < -1e-4 || ofB + ofC > 1.0001) continue;
      put(target, x, y, az + ofB * (bz - az) + ofC * (cz - az), shade, selected);
    }
  }
}
