// Casts one ray per pixel: colour over the background, and view depth in mm.
//
// The twins of the functions here and in lib/ have the same names in `render::reference`, but for skipping, which
// changes nothing. Modes and depth rules are
// pipeline constants, so a pipeline contains only what it uses.

override MODE: u32 = 0u;
override SHADED: bool = true;
// Writes the number of volume samples in place of the depth, for measuring.
override COUNT_SAMPLES: bool = false;

const MODE_COMPOSITE: u32 = 0u;
const MODE_MIP: u32 = 1u;
const MODE_MINIP: u32 = 2u;
const MODE_MEAN: u32 = 3u;
const MODE_AVERAGE: u32 = 4u;
const MODE_ADDITIVE: u32 = 5u;
const MODE_ISOSURFACE: u32 = 6u;

// A ray that changes no byte of the picture hits nothing: faint noise must not scatter depths into the background.
const VISIBLE: f32 = 0.5 / 255.0;
// The threshold rule divides the neighbourhood of its crossing by 4, three times: to 1/64 of a sample distance.
const PARTS: i32 = 4;
const LEVELS: i32 = 3;
const MISS: f32 = 0x1p+127f;

// Rows from the top: red, green, blue, coverage as bytes from the lowest on.
@group(0) @binding(5) var<storage, read_write> color_out: array<u32>;
// Rows from the top: view depth in mm; anything above 1e38 is a miss.
@group(0) @binding(6) var<storage, read_write> depth_out: array<f32>;

struct Hit {
    // Premultiplied colour and coverage.
    color: vec4<f32>,
    // Distance along the ray, mm; MISS when nothing is visible.
    t: f32,
    // The first visible sample.
    first: f32,
    // Volume samples taken, gradients and depth refinement left out.
    samples: f32,
}

@compute @workgroup_size(8, 8)
fn raycast(@builtin(workgroup_id) tile: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let id = tile.xy * 8u + place_in_tile(index) + vec2<u32>(0u, frame.first_row);
    if any(id >= frame.size_px) {
        return;
    }
    let ray = ray_of_pixel(id);
    var hit: Hit;
    if MODE == MODE_COMPOSITE {
        hit = composite(ray);
    } else if MODE == MODE_ISOSURFACE {
        hit = isosurface(ray);
    } else {
        hit = project(ray);
    }
    let at = id.y * frame.size_px.x + id.x;
    write_hit(at, ray, hit);
    if DEPTH_RULE == DEPTH_TWO_LAYER {
        write_hit(at + frame.size_px.x * frame.size_px.y, ray, back_layer(ray, hit.first));
    }
}

fn write_hit(at: u32, ray: Ray, hit: Hit) {
    let over = hit.color.rgb + (1.0 - hit.color.a) * frame.background_rgb;
    color_out[at] = pack4x8unorm(vec4<f32>(over, hit.color.a));
    if COUNT_SAMPLES {
        depth_out[at] = hit.samples;
    } else {
        depth_out[at] = select(view_depth(ray, hit.t), MISS, hit.t >= MISS);
    }
}

// Pixels of a tile in blocks of 4x2: eight invocations that run as one vector follow rays that lie close together.
fn place_in_tile(index: u32) -> vec2<u32> {
    let block = index >> 3u;
    return vec2<u32>((index & 3u) + (block & 1u) * 4u, ((index >> 2u) & 1u) + (block >> 1u) * 2u);
}

// What a ray has gathered.
struct Gathered {
    // Premultiplied.
    color: vec3<f32>,
    opacity: f32,
    // The first visible sample.
    first: f32,
    // The last visible sample, and the opacity before it.
    last: f32,
    before_last: f32,
    // The sample that takes opacity to the threshold of an opaque ray, and the opacity before the one before it and
    // before itself.
    crossing: f32,
    before_crossing: vec2<f32>,
}

// What lies behind the first layer, as if that were not there: its colour, and its depth by the threshold rule.
fn back_layer(ray: Ray, first: f32) -> Hit {
    var hit: Hit;
    hit.t = MISS;
    let walk = walk_of(ray);
    let end = front_layer(ray, walk, first).end;
    if end < sample_count(ray) {
        hit = composite_from(ray, walk, end);
    }
    return hit;
}

fn composite(ray: Ray) -> Hit {
    return composite_from(ray, walk_of(ray), 0.0);
}

// Samples from number `start` on, blended front to back.
fn composite_from(ray: Ray, walk: Walk, start: f32) -> Hit {
    let count = sample_count(ray);
    var sum = Gathered(vec3<f32>(0.0), 0.0, count, -2.0, 0.0, count, vec2<f32>(0.0));
    var samples = 0.0;
    var k = start;
    while k < count && sum.opacity < OPAQUE {
        let next = next_sample(walk, k);
        if next > k {
            k = next;
            continue;
        }
        // Two samples for each look at the bricks: the second is taken in vain now and then, but shows nothing then.
        let p = sample_voxel(ray, k);
        let p_after = sample_voxel(ray, k + 1.0);
        let hu = sample_hu(p);
        let hu_after = sample_hu(p_after);
        gather(&sum, ray, k, p, hu);
        if k + 1.0 < count && !is_hidden(walk, k + 1.0) {
            gather(&sum, ray, k + 1.0, p_after, hu_after);
        }
        samples += min(2.0, count - k);
        k += 2.0;
    }
    var hit: Hit;
    hit.color = vec4<f32>(sum.color, sum.opacity);
    hit.first = sum.first;
    hit.samples = samples;
    hit.t = MISS;
    if sum.opacity >= VISIBLE {
        if DEPTH_RULE == DEPTH_THRESHOLD || DEPTH_RULE == DEPTH_TWO_LAYER {
            if DEPTH_RULE == DEPTH_TWO_LAYER && start == 0.0 {
                sum.opacity = front_layer(ray, walk, sum.first).opacity;
            }
            hit.t = threshold_crossing(ray, walk, sum);
        } else if DEPTH_RULE == DEPTH_FIRST_HIT {
            hit.t = first_hit(ray, sum.first);
        } else {
            hit.t = depth_by_rule(ray, walk, sum.first);
        }
    }
    return hit;
}

// Adds sample k, at voxel index p, behind what was gathered before.
fn gather(sum: ptr<function, Gathered>, ray: Ray, k: f32, p: vec3<f32>, hu: f32) {
    if hu < frame.lowest_visible_hu || (*sum).opacity >= OPAQUE {
        return;
    }
    var sample = classify(hu);
    if GRADIENT_OPACITY {
        sample.a = modulated(sample.a, p);
    }
    if sample.a <= 0.0 {
        return;
    }
    var rgb = sample.rgb * frame.ambient;
    if SHADED {
        rgb = shade(sample.rgb, gradient_at(p), ray.direction);
    }
    let before = (*sum).opacity;
    let weight = (1.0 - before) * sample.a;
    (*sum).color += weight * rgb;
    (*sum).opacity = before + weight;
    (*sum).first = min((*sum).first, k);
    if DEPTH_RULE == DEPTH_THRESHOLD || DEPTH_RULE == DEPTH_TWO_LAYER {
        if before < frame.depth_fraction * OPAQUE {
            (*sum).crossing = k;
            (*sum).before_crossing = vec2<f32>(select(before, (*sum).before_last, (*sum).last == k - 1.0), before);
        }
        (*sum).last = k;
        (*sum).before_last = before;
    }
}

// Where opacity leaves zero between the sample before the first visible one and that one.
fn first_hit(ray: Ray, first: f32) -> f32 {
    var outside = max(ray.entry, sample_t(ray, first - 1.0));
    var inside = sample_t(ray, first);
    if opacity_at(ray, outside) > 0.0 {
        return outside;
    }
    for (var i = 0; i < BISECTIONS; i++) {
        let middle = 0.5 * (outside + inside);
        if opacity_at(ray, middle) > 0.0 {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    return inside;
}

// Opacity of 1/4^level of a sample's path: 1 - (1 - a)^(1 / 4^level), by square roots.
fn part_opacity(opacity: f32, level: i32) -> f32 {
    var transparency = max(1.0 - opacity, 0.0);
    for (var i = 0; i < level; i++) {
        transparency = sqrt(sqrt(transparency));
    }
    return 1.0 - transparency;
}

// Where accumulated opacity crosses its share of the ray's final opacity.
//
// First the sample whose slab holds the crossing, then that slab and the one before it in finer and finer parts: a
// sharp edge between two samples is seen by the later one alone, though it may lie nearer to the earlier. An opaque
// ray's crossing is at or a little behind the sample that gathering has kept; any other is looked for from the start.
fn threshold_crossing(ray: Ray, walk: Walk, sum: Gathered) -> f32 {
    let target_opacity = frame.depth_fraction * sum.opacity;
    let count = sample_count(ray);
    var before = 0.0;
    var accumulated = 0.0;
    var k = sum.first;
    if sum.opacity >= OPAQUE {
        before = sum.before_crossing.x;
        accumulated = sum.before_crossing.y;
        k = sum.crossing;
    }
    while k < count {
        let next_k = next_sample(walk, k);
        if next_k > k {
            before = accumulated;
            k = next_k;
            continue;
        }
        let next = accumulated + (1.0 - accumulated) * sample_opacity(ray, k);
        if next >= target_opacity {
            break;
        }
        before = accumulated;
        accumulated = next;
        k += 1.0;
    }
    let start = max(k - 1.0, 0.0);
    return refine_crossing(ray, sample_t(ray, start - 0.5), i32(k - start) + 1, before, target_opacity);
}

// The crossing within `slabs` sample distances from `begin` (mm) on, before which `before` has accumulated.
fn refine_crossing(ray: Ray, begin: f32, slabs: i32, before: f32, target_opacity: f32) -> f32 {
    var start = begin;
    var parts = slabs * PARTS;
    var settled = before;
    var part = frame.sample_distance_mm;
    var t = begin;
    for (var level = 1; level <= LEVELS; level++) {
        part /= f32(PARTS);
        var previous = settled;
        var accumulated = settled;
        var a = 0.0;
        var j = 0;
        while j < parts {
            a = part_opacity(opacity_at(ray, start + (f32(j) + 0.5) * part), level);
            let next = accumulated + (1.0 - accumulated) * a;
            if next >= target_opacity {
                break;
            }
            previous = accumulated;
            accumulated = next;
            j += 1;
        }
        t = start + (f32(j) + share_of_part(a, accumulated, target_opacity)) * part;
        if j == parts {
            // Finer parts add up to a little less than the coarse ones did: the crossing is at the end.
            t = start + f32(parts) * part;
            break;
        }
        start += f32(max(j - 1, 0)) * part;
        settled = previous;
        parts = min(j + 1, 2) * PARTS;
    }
    return clamp(t, ray.entry, ray.exit);
}

// How far into a part of opacity `a` the crossing lies, 0..1: opacity grows exponentially within it.
fn share_of_part(a: f32, accumulated: f32, target_opacity: f32) -> f32 {
    let whole = log(max(1.0 - a, 1e-30));
    let needed = log(max((1.0 - target_opacity) / (1.0 - accumulated), 1e-30));
    return clamp(needed / min(whole, -1e-30), 0.0, 1.0);
}
