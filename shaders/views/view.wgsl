// A view of the layers: each pixel is the mean of the intervals in it. The nearest interval shows;
// holes take the background layer or their farther side.
//
// `synthesize` of the crate `display` explains the method and gives the same bytes. Each pixel
// looks for the intervals that can reach it.

const FRONT: u32 = 0u;
const BACK: u32 = 1u;

// The nearest interval at a place; of several at one depth the one that begins last.
struct Shown {
    // -1 in a hole.
    pixel: i32,
    span: vec2<i32>,
    disparity: i32,
    // Where the next interval begins.
    coming: i32,
}

// A part of the line that no pixel covers, and its filling.
struct Hole {
    span: vec2<i32>,
    // Twice its colour.
    twice: vec3<i32>,
    // The pixel beside it that is mixed with the foreground, or -1; and whether it is on the left.
    mixed: i32,
    is_mixed_left: bool,
}

fn line_end() -> i32 {
    return i32(job.size_px.x) * UNIT;
}

fn last_pixel() -> i32 {
    return i32(job.size_px.x) - 1;
}

fn shown_at(layer: u32, at: i32, y: u32, around: i32) -> Shown {
    var found = Shown(-1, vec2<i32>(0), -1, line_end());
    let first = max(at / UNIT - around, 0);
    let last = min(at / UNIT + around, last_pixel());
    for (var x = first; x <= last; x++) {
        let span = spans[index_of(layer, x, y)];
        if span.x > at {
            found.coming = min(found.coming, span.x);
        } else if span.y > at {
            let d = disparity_at(layer, x, y);
            if d > found.disparity || (d == found.disparity && span.x >= found.span.x) {
                found.pixel = x;
                found.span = span;
                found.disparity = d;
            }
        }
    }
    return found;
}

// The next pixel of the same surface, away from a hole; the pixel itself where there is no next one.
fn inwards(x: i32, next: i32, y: u32) -> i32 {
    if next < 0 || next > last_pixel() {
        return x;
    }
    let step = abs(disparity_at(FRONT, next, y) - disparity_at(FRONT, x, y));
    return select(x, next, step <= SURFACE_STEP);
}

// The first and the last of the farthest pixels on the way from one pixel to another.
fn farthest_between(left: i32, right: i32, y: u32) -> vec2<i32> {
    let step = select(-1, 1, left <= right);
    var least = 256;
    var found = vec2<i32>(left);
    for (var x = left; x != right + step; x += step) {
        let d = disparity_at(FRONT, x, y);
        if d < least {
            least = d;
            found.x = x;
        }
        if d <= least {
            found.y = x;
        }
    }
    return found;
}

// The filling between the pixels on both sides of a hole; a side beyond the picture is -1.
fn filled_from(hole: ptr<function, Hole>, left: i32, right: i32, y: u32) {
    if left < 0 || right < 0 {
        let only = max(left, right);
        if only >= 0 {
            (*hole).twice = 2 * color_at(FRONT, only, y);
        }
        return;
    }
    let farthest = farthest_between(left, right, y);
    if farthest.x == left && farthest.y != right {
        let inner = inwards(left, left - 1, y);
        (*hole).twice = 2 * color_at(FRONT, inner, y);
        (*hole).mixed = select(-1, left, inner != left);
        (*hole).is_mixed_left = true;
    } else if farthest.y == right && farthest.x != left {
        let inner = inwards(right, right + 1, y);
        (*hole).twice = 2 * color_at(FRONT, inner, y);
        (*hole).mixed = select(-1, right, inner != right);
    } else {
        (*hole).twice = color_at(FRONT, farthest.x, y) + color_at(FRONT, farthest.y, y);
    }
}

// The hole at a place that nothing covers.
fn hole_at(at: i32, y: u32) -> Hole {
    var hole = Hole(vec2<i32>(0, line_end()), vec3<i32>(0), -1, false);
    let around = 3 * job.reach_px + 4;
    var left = -1;
    var right = -1;
    var left_order = vec2<i32>(-1);
    var right_disparity = -1;
    let last = min(at / UNIT + around, last_pixel());
    for (var x = max(at / UNIT - around, 0); x <= last; x++) {
        let span = spans[index_of(FRONT, x, y)];
        if span.x >= span.y {
            continue;
        }
        let d = disparity_at(FRONT, x, y);
        if span.y <= at && span.y > 0 {
            let is_nearer = d > left_order.x || (d == left_order.x && span.x >= left_order.y);
            if span.y > hole.span.x || (span.y == hole.span.x && is_nearer) {
                hole.span.x = span.y;
                left = x;
                left_order = vec2<i32>(d, span.x);
            }
        } else if span.x > at && span.x < line_end() {
            if span.x < hole.span.y || (span.x == hole.span.y && d >= right_disparity) {
                hole.span.y = span.x;
                right = x;
                right_disparity = d;
            }
        }
    }
    filled_from(&hole, left, right, y);
    return hole;
}

// The change of colour of a mixed pixel beside a hole.
fn cleaned(hole: Hole, pixel: i32, y: u32) -> vec3<i32> {
    let change = hole.twice - 2 * color_at(FRONT, pixel, y);
    return change * min(hole.span.y - hole.span.x, UNIT) / UNIT;
}

// Whether a pixel shows everywhere from one place to another.
fn shows(pixel: i32, from_: i32, to: i32, y: u32) -> bool {
    var at = from_;
    while at < to {
        let now = shown_at(FRONT, at, y, job.reach_px + 2);
        if now.pixel != pixel {
            return false;
        }
        at = min(now.span.y, now.coming);
    }
    return true;
}

// The colour that a visible part has on top of its own, where a hole lies beside its pixel.
fn change_beside(shown: Shown, from_: i32, y: u32) -> vec3<i32> {
    var change = vec3<i32>(0);
    let x = shown.pixel;
    let begin = shown.span.x;
    let end = shown.span.y;
    var ends_right = x == last_pixel();
    if !ends_right {
        ends_right = spans[index_of(FRONT, x + 1, y)].x != end;
    }
    if ends_right && end < line_end() && shown_at(FRONT, end, y, job.reach_px).pixel < 0 && shows(x, from_, end, y) {
        let hole = hole_at(end, y);
        if hole.mixed == x && hole.is_mixed_left {
            change += cleaned(hole, x, y);
        }
    }
    var ends_left = x == 0;
    if !ends_left {
        ends_left = spans[index_of(FRONT, x - 1, y)].y != begin;
    }
    if ends_left && begin > 0 && shown_at(FRONT, begin - 1, y, job.reach_px).pixel < 0 && shows(x, begin, from_, y) {
        let hole = hole_at(begin - 1, y);
        if hole.mixed == x && !hole.is_mixed_left {
            change += cleaned(hole, x, y);
        }
    }
    return change;
}

// A part of a hole: the background layer, or the hole's colour.
fn filling(hole: Hole, from_: i32, to: i32, y: u32) -> vec3<i32> {
    if job.has_back == 0u {
        return hole.twice * (to - from_);
    }
    var sum = vec3<i32>(0);
    var at = from_;
    while at < to {
        let behind = shown_at(BACK, at, y, job.reach_px);
        if behind.pixel < 0 {
            let next = min(behind.coming, to);
            sum += hole.twice * (next - at);
            at = next;
        } else {
            let next = min(min(behind.span.y, behind.coming), to);
            sum += 2 * color_at(BACK, behind.pixel, y) * (next - at);
            at = next;
        }
    }
    return sum;
}

// Twice the colours of a pixel of the view times the widths that they cover.
fn sum_over(x: i32, y: u32) -> vec3<i32> {
    var sum = vec3<i32>(0);
    var at = x * UNIT;
    let end = at + UNIT;
    while at < end {
        let shown = shown_at(FRONT, at, y, job.reach_px);
        var next = min(end, shown.coming);
        if shown.pixel < 0 {
            let hole = hole_at(at, y);
            next = min(end, hole.span.y);
            sum += filling(hole, at, next, y);
        } else {
            next = min(next, shown.span.y);
            sum += (2 * color_at(FRONT, shown.pixel, y) + change_beside(shown, at, y)) * (next - at);
        }
        at = next;
    }
    return sum;
}

@compute @workgroup_size(8, 8)
fn synthesize_view(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= job.size_px) {
        return;
    }
    // A mixed pixel with holes on both sides gives way to both, which can leave the range.
    let mean = (sum_over(i32(id.x), id.y) + UNIT) / (2 * UNIT);
    let color = vec3<u32>(clamp(mean, vec3<i32>(0), vec3<i32>(255)));
    view[index_of(FRONT, i32(id.x), id.y)] = color.x | (color.y << 8u) | (color.z << 16u);
}
