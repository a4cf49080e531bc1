// The shaders that make views of a picture and its disparity, for WebGL2.
//
// The twin of `synthesize` in the server's crate `display` (src/display/views/warp.rs), which
// explains the method: every pixel is an interval that its disparity moves, the nearest interval
// shows, holes take the back layer or the farther side. All places are whole numbers of 1/4096
// pixel, and all sums whole numbers, so that both give the same bytes.
//
// First each pixel's interval is computed for each view. Then each pixel of the frame looks for the
// intervals that can reach it.

export const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1);
}`;

/** Where each pixel of a layer is in one view: from, to. */
export const SPANS = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp isampler2D;

uniform usampler2D depths;
// Column D, row view: how far a disparity moves, 1/4096 pixel.
uniform isampler2D shifts;
uniform int view;

out ivec2 span;

const int UNIT = 4096;
const int SURFACE_STEP = 4;

int shiftOf(int d) {
  return texelFetch(shifts, ivec2(d, view), 0).r;
}

// The way of the edge between a pixel and its neighbour: shared where both are one surface.
int edgeBeside(int d, int own, ivec2 neighbour) {
  int other = int(texelFetch(depths, neighbour, 0).r);
  int shift = shiftOf(other);
  return abs(d - other) <= SURFACE_STEP && abs(own - shift) < UNIT ? (own + shift) / 2 : own;
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  int d = int(texelFetch(depths, at, 0).r);
  int own = shiftOf(d);
  span = ivec2(own);
  if (at.x > 0) span.x = edgeBeside(d, own, at - ivec2(1, 0));
  if (at.x < textureSize(depths, 0).x - 1) span.y = edgeBeside(d, own, at + ivec2(1, 0));
  span += ivec2(at.x, at.x + 1) * UNIT;
}`;

/** Pixels of a block of a line that `FLATS` looks at. */
export const BLOCK_PX = 16;

/** Which blocks of a line, with all that may move into them, have one disparity. */
export const FLATS = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;

uniform usampler2D frontDepth;
uniform int reach;

out uint flat_;

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  int first = at.x * ${BLOCK_PX} - reach - 2;
  int last = (at.x + 1) * ${BLOCK_PX} + reach + 1;
  flat_ = 0u;
  // At the sides of a picture there are holes.
  if (first < 0 || last >= textureSize(frontDepth, 0).x) return;
  uint d = texelFetch(frontDepth, ivec2(first, at.y), 0).r;
  for (int x = first + 1; x <= last; x += 1) {
    if (texelFetch(frontDepth, ivec2(x, at.y), 0).r != d) return;
  }
  flat_ = 1u;
}`;

/** The frame of an output. */
export const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp isampler2DArray;

// Colour and disparity of the front layer and of the back layer, rows from the top.
uniform usampler2D frontColor;
uniform usampler2D frontDepth;
uniform usampler2D backColor;
uniform usampler2D backDepth;
// Where each pixel is in each view, 1/4096 pixel: see SPANS.
uniform isampler2DArray frontSpans;
uniform isampler2DArray backSpans;
// Blocks of one disparity: see FLATS.
uniform usampler2D flats;
// Views that were rendered, where there are any: they are shown as they are.
uniform highp usampler2DArray given;
uniform bool isGiven;
uniform ivec2 sizePx;
uniform bool hasBack;
// Whole pixels that a disparity moves at most.
uniform int reach;
// How views are arranged (see outputs.js), the frame, and the order of views.
uniform int arrangement;
uniform ivec2 framePx;
uniform ivec2 gridPx;
uniform int viewCount;
uniform bool isSwapped;
// Of a panel with lenses: pixels from lens to lens, pixels that a lens moves from line to line, the
// place of its middle as a share, and the place of red and blue in a pixel, thirds.
uniform vec3 lens;
uniform ivec2 redBlue;

out vec4 outColor;

const int UNIT = 4096;
const int SURFACE_STEP = 4;
// More parts than a pixel of a view can have in a picture.
const int MOST_PARTS = 24;

int row;
int view;

int depthAt(bool back, int x) {
  return int(back ? texelFetch(backDepth, ivec2(x, row), 0).r : texelFetch(frontDepth, ivec2(x, row), 0).r);
}

ivec3 colorAt(bool back, int x) {
  return ivec3(back ? texelFetch(backColor, ivec2(x, row), 0).rgb : texelFetch(frontColor, ivec2(x, row), 0).rgb);
}

ivec2 spanOf(bool back, int x) {
  ivec3 at = ivec3(x, row, view);
  return back ? texelFetch(backSpans, at, 0).rg : texelFetch(frontSpans, at, 0).rg;
}

// The nearest interval at a place; of several at one depth the one that begins last.
struct Shown {
  // -1 in a hole.
  int pixel;
  ivec2 span;
  int depth;
  // Where the next interval begins.
  int coming;
};

Shown shownAt(bool back, int at, int around) {
  Shown found = Shown(-1, ivec2(0), -1, sizePx.x * UNIT);
  int middle = at / UNIT;
  int first = max(middle - around, 0);
  int last = min(middle + around, sizePx.x - 1);
  for (int x = first; x <= last; x += 1) {
    ivec2 span = spanOf(back, x);
    if (span.x > at) {
      found.coming = min(found.coming, span.x);
    } else if (span.y > at) {
      int d = depthAt(back, x);
      if (d > found.depth || (d == found.depth && span.x >= found.span.x)) {
        found.pixel = x;
        found.span = span;
        found.depth = d;
      }
    }
  }
  return found;
}

// A part of the line that no pixel covers, and its filling.
struct Hole {
  ivec2 span;
  // Twice its colour.
  ivec3 twice;
  // The pixel beside it that is mixed with the foreground, or -1; and whether it is on the left.
  int mixed;
  bool mixedLeft;
};

int inwards(int x, int next) {
  bool exists = next >= 0 && next < sizePx.x;
  return exists && abs(depthAt(false, next) - depthAt(false, x)) <= SURFACE_STEP ? next : x;
}

// The hole at a place that nothing covers.
Hole holeAt(int at) {
  Hole hole = Hole(ivec2(0, sizePx.x * UNIT), ivec3(0), -1, false);
  int around = 3 * reach + 4;
  int middle = at / UNIT;
  int left = -1;
  int right = -1;
  ivec2 leftOrder = ivec2(-1);
  ivec2 rightOrder = ivec2(-1);
  for (int x = max(middle - around, 0); x <= min(middle + around, sizePx.x - 1); x += 1) {
    ivec2 span = spanOf(false, x);
    if (span.x >= span.y) continue;
    int d = depthAt(false, x);
    if (span.y <= at && span.y > 0) {
      ivec2 order = ivec2(d, span.x);
      bool ends = span.y == hole.span.x && (order.x > leftOrder.x || (order.x == leftOrder.x && order.y >= leftOrder.y));
      if (span.y > hole.span.x || ends) {
        hole.span.x = span.y;
        left = x;
        leftOrder = order;
      }
    } else if (span.x > at && span.x < sizePx.x * UNIT) {
      bool begins = span.x == hole.span.y && d >= rightOrder.x;
      if (span.x < hole.span.y || begins) {
        hole.span.y = span.x;
        right = x;
        rightOrder = ivec2(d, span.x);
      }
    }
  }
  if (left < 0 && right < 0) return hole;
  if (left < 0 || right < 0) {
    hole.twice = 2 * colorAt(false, max(left, right));
    return hole;
  }
  // The first and the last of the farthest pixels on the way from left to right.
  int step = left <= right ? 1 : -1;
  int least = 256;
  int one = left;
  int other = left;
  for (int x = left; ; x += step) {
    int d = depthAt(false, x);
    if (d < least) {
      least = d;
      one = x;
    }
    if (d <= least) other = x;
    if (x == right) break;
  }
  if (one == left && other != right) {
    int inner = inwards(left, left - 1);
    hole.twice = 2 * colorAt(false, inner);
    hole.mixed = inner != left ? left : -1;
    hole.mixedLeft = true;
  } else if (other == right && one != left) {
    int inner = inwards(right, right + 1);
    hole.twice = 2 * colorAt(false, inner);
    hole.mixed = inner != right ? right : -1;
  } else {
    hole.twice = colorAt(false, one) + colorAt(false, other);
  }
  return hole;
}

ivec3 truncated(ivec3 value, int by) {
  return sign(value) * (abs(value) / by);
}

// The change of colour of a mixed pixel beside a hole.
ivec3 cleaned(Hole hole, int pixel) {
  ivec3 change = hole.twice - 2 * colorAt(false, pixel);
  return truncated(change * min(hole.span.y - hole.span.x, UNIT), UNIT);
}

// Whether pixel x shows everywhere from one place to another.
bool shows(Shown shown, int from, int to) {
  for (int part = 0; part < MOST_PARTS && from < to; part += 1) {
    Shown now = shownAt(false, from, reach + 2);
    if (now.pixel != shown.pixel) return false;
    from = min(now.span.y, now.coming);
  }
  return true;
}

// The colour that a visible part has on top of its own, where a hole lies beside its pixel.
ivec3 changeBeside(Shown shown, int from) {
  ivec3 change = ivec3(0);
  int x = shown.pixel;
  bool endsRight = x == sizePx.x - 1 || spanOf(false, x + 1).x != shown.span.y;
  int end = shown.span.y;
  if (endsRight && end < sizePx.x * UNIT && shownAt(false, end, reach).pixel < 0 && shows(shown, from, end)) {
    Hole hole = holeAt(end);
    if (hole.mixed == x && hole.mixedLeft) change += cleaned(hole, x);
  }
  bool endsLeft = x == 0 || spanOf(false, x - 1).y != shown.span.x;
  int begin = shown.span.x;
  if (endsLeft && begin > 0 && shownAt(false, begin - 1, reach).pixel < 0 && shows(shown, begin, from)) {
    Hole hole = holeAt(begin - 1);
    if (hole.mixed == x && !hole.mixedLeft) change += cleaned(hole, x);
  }
  return change;
}

// A part of a hole: the back layer, or the hole's colour.
ivec3 filled(Hole hole, int from, int to) {
  if (!hasBack) return hole.twice * (to - from);
  ivec3 sum = ivec3(0);
  for (int part = 0; part < MOST_PARTS && from < to; part += 1) {
    Shown behind = shownAt(true, from, reach);
    int next = min(behind.pixel < 0 ? to : behind.span.y, min(behind.coming, to));
    sum += (behind.pixel < 0 ? hole.twice : 2 * colorAt(true, behind.pixel)) * (next - from);
    from = next;
  }
  return sum;
}

// A pixel of a view where everything around has one disparity: two pixels side by side.
ivec3 flatPixel(ivec2 at) {
  int place = 2 * at.x * UNIT - spanOf(false, at.x).x;
  int x = place / UNIT;
  int share = place - x * UNIT;
  ivec3 sum = 2 * colorAt(false, x) * (UNIT - share) + 2 * colorAt(false, x + 1) * share;
  return (sum + UNIT) / (2 * UNIT);
}

// A pixel of a view, 0 to 255.
ivec3 pixelOf(int viewNumber, ivec2 at) {
  view = isSwapped ? viewCount - 1 - viewNumber : viewNumber;
  row = at.y;
  if (isGiven) return ivec3(texelFetch(given, ivec3(at, view), 0).rgb);
  if (texelFetch(flats, ivec2(at.x / ${BLOCK_PX}, row), 0).r == 1u) return flatPixel(at);
  int from = at.x * UNIT;
  int end = from + UNIT;
  ivec3 sum = ivec3(0);
  for (int part = 0; part < MOST_PARTS && from < end; part += 1) {
    Shown shown = shownAt(false, from, reach);
    int next = min(end, shown.coming);
    if (shown.pixel < 0) {
      Hole hole = holeAt(from);
      next = min(end, hole.span.y);
      sum += filled(hole, from, next);
    } else {
      next = min(next, shown.span.y);
      sum += (2 * colorAt(false, shown.pixel) + changeBeside(shown, from)) * (next - from);
    }
    from = next;
  }
  return (sum + UNIT) / (2 * UNIT);
}

// The mean of two pixels of a view.
ivec3 meanOf(int viewNumber, ivec2 one, ivec2 other) {
  return (pixelOf(viewNumber, one) + pixelOf(viewNumber, other) + 1) / 2;
}

int lensView(ivec2 at, int third) {
  float along = (float(at.x) + (float(third) + 0.5) / 3.0 + float(at.y) * lens.y) / lens.x - lens.z;
  return min(int(fract(along) * float(viewCount)), viewCount - 1);
}

ivec3 frameAt(ivec2 at) {
  if (arrangement == 0) return pixelOf(0, at);
  // A grid of views: the first at the bottom left, rows upwards.
  if (arrangement == 1) {
    ivec2 tile = at / sizePx;
    return pixelOf(tile.x + gridPx.x * (gridPx.y - 1 - tile.y), at - tile * sizePx);
  }
  // Half as wide each, side by side.
  if (arrangement == 2) {
    int half_ = sizePx.x / 2;
    int eye = at.x < half_ ? 0 : 1;
    ivec2 one = ivec2(2 * (at.x - eye * half_), at.y);
    return meanOf(eye, one, one + ivec2(1, 0));
  }
  // Above each other, the left eye's above.
  if (arrangement == 3) return at.y < sizePx.y ? pixelOf(0, at) : pixelOf(1, at - ivec2(0, sizePx.y));
  // The same at half the height.
  if (arrangement == 4) {
    int half_ = sizePx.y / 2;
    int eye = at.y < half_ ? 0 : 1;
    ivec2 one = ivec2(at.x, 2 * (at.y - eye * half_));
    return meanOf(eye, one, one + ivec2(0, 1));
  }
  // Every other line, column, or field of a checkerboard is the right eye's.
  if (arrangement == 5) return pixelOf(at.y & 1, at);
  if (arrangement == 6) return pixelOf(at.x & 1, at);
  if (arrangement == 7) return pixelOf((at.x + at.y) & 1, at);
  // A panel with lenses: red, green and blue of a pixel belong to different views.
  int red = lensView(at, redBlue.x);
  int green = lensView(at, 1);
  int blue = lensView(at, redBlue.y);
  ivec3 color = pixelOf(green, at);
  color.r = red == green ? color.r : pixelOf(red, at).r;
  color.b = blue == green ? color.b : pixelOf(blue, at).b;
  return color;
}

void main() {
  ivec2 at = ivec2(int(gl_FragCoord.x), framePx.y - 1 - int(gl_FragCoord.y));
  outColor = vec4(vec3(frameAt(at)) / 255.0, 1.0);
}`;
