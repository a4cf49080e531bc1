// Casts one ray per pixel: colour over the background, and view depth in mm.
//
// The functions here and in lib/ have twins of the same names in `render::processor`. Skipping does
// not change the result. Modes and depth rules are pipeline constants, so that
// a pipeline contains only the code it uses.

override MODE: u32 = 0u;
override SHADED: bool = true;
// One fetch for value and gradient of every sample if most samples are visible; otherwise gradients
// of visible samples only.
override FETCH_TOGETHER: bool = false;
// Software drivers split a dispatch into one run of tiles per core and wait for the last. Rows of
// tiles are therefore interleaved between runs, so that each run has an equal share of the visible
// part.
override RUNS: u32 = 1u;
// Paints the slice of the volume on cut faces.
override CUT_SLICE: bool = false;
// Writes the number of volume samples in place of the depth, for measuring.
override COUNT_SAMPLES: bool = false;

const MODE_COMPOSITE: u32 = 0u;
const MODE_MIP: u32 = 1u;
const MODE_MINIP: u32 = 2u;
const MODE_MEAN: u32 = 3u;
const MODE_AVERAGE: u32 = 4u;
const MODE_ADDITIVE: u32 = 5u;
const MODE_ISOSURFACE: u32 = 6u;

// A ray that changes no byte of the picture hits nothing: faint noise must not scatter depths into
// the background.
const VISIBLE: f32 = 0.5 / 255.0;
const MISS: f32 = 0x1p+127f;
// Half of a pre-integrated sample that adds less than this share of it gets no gradient of its own.
const LITTLE: f32 = 0.125;

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
    // Whether the slice on a cut face ends the ray.
    is_painted: bool,
    // Volume samples taken, gradients and depth refinement left out.
    samples: f32,
}

@compute @workgroup_size(8, 8)
fn raycast(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let tile = vec2<u32>(group.x, row_dealt_out(group.y, groups.y));
    let id = tile * 8u + place_in_tile(index) + vec2<u32>(frame.first_column, frame.first_row);
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
        write_hit(at + frame.size_px.x * frame.size_px.y, ray, back_layer(ray, hit));
    }
}

fn write_hit(at: u32, ray: Ray, hit: Hit) {
    let over = hit.color.rgb + (1.0 - hit.color.a) * frame.background_rgb;
    // Like pack4x8unorm, but with defined rounding of halves: pixels filled in beside the region
    // must have the same bytes.
    let bytes = vec4<u32>(round(clamp(vec4<f32>(over, hit.color.a), vec4<f32>(0.0), vec4<f32>(1.0)) * 255.0));
    color_out[at] = bytes.x | (bytes.y << 8u) | (bytes.z << 16u) | (bytes.w << 24u);
    if COUNT_SAMPLES {
        depth_out[at] = hit.samples;
    } else {
        depth_out[at] = select(view_depth(ray, hit.t), MISS, hit.t >= MISS);
    }
}

// Row number `turn` of a run: the first run has rows 0, RUNS, 2 RUNS and so on; the next run begins
// with row 1.
fn row_dealt_out(turn: u32, rows: u32) -> u32 {
    let whole = rows / RUNS;
    // The number of runs that have one row more.
    let longer = rows % RUNS;
    let ahead = longer * (whole + 1u);
    if turn < ahead {
        return turn % (whole + 1u) * RUNS + turn / (whole + 1u);
    }
    return (turn - ahead) % whole * RUNS + longer + (turn - ahead) / whole;
}

// Pixels of a tile in blocks of 4x2: eight invocations that run as one vector follow rays that lie
// close together.
fn place_in_tile(index: u32) -> vec2<u32> {
    let block = index >> 3u;
    return vec2<u32>((index & 3u) + (block & 1u) * 4u, ((index >> 2u) & 1u) + (block >> 1u) * 2u);
}

// The result of a ray.
struct Gathered {
    // Premultiplied.
    color: vec3<f32>,
    opacity: f32,
    // The first visible sample.
    first: f32,
    // The last visible sample, and the opacity before it.
    last: f32,
    before_last: f32,
    // The sample that takes opacity to the threshold of an opaque ray, and the opacity before the
    // one before it and before itself.
    crossing: f32,
    before_crossing: vec2<f32>,
}

// The ray behind the first layer, as if that layer were absent: its colour, and its depth by the
// threshold rule.
// Behind a painted face there is nothing.
fn back_layer(ray: Ray, front: Hit) -> Hit {
    var hit: Hit;
    hit.t = MISS;
    if front.is_painted {
        return hit;
    }
    let walk = walk_of(ray);
    let end = front_layer(ray, walk, front.first).end;
    if end < sample_count(ray) {
        hit = composite_from(ray, walk, end, 0.0);
    }
    return hit;
}

fn composite(ray: Ray) -> Hit {
    if !CUT_SLICE {
        return composite_from(ray, walk_of(ray), 0.0, 0.0);
    }
    let face = painted_face(ray);
    if face.t >= MISS {
        return composite_from(ray, walk_of(ray), 0.0, 0.0);
    }
    // The face is opaque, and ends the ray.
    var before = ray;
    before.exit = select(ray.cut_in, ray.entry - frame.sample_distance_mm, face.t == ray.entry);
    var hit = composite_from(before, walk_of(before), 0.0, 1.0);
    if hit.t >= MISS {
        hit.t = face.t;
    }
    hit.color += (1.0 - hit.color.a) * vec4<f32>(vec3<f32>(face.grey), 1.0);
    hit.is_painted = true;
    return hit;
}

// Samples from number `start` on, blended front to back; `behind` is the opacity behind the last one,
// 0 or 1.
fn composite_from(ray: Ray, walk: Walk, start: f32, behind: f32) -> Hit {
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
        // Two samples for each look at the bricks: the second is taken in vain now and then, but
        // shows nothing then.
        if PRE_INTEGRATED {
            let passage = passage_of_sample(ray, k);
            gather_passage(&sum, ray, k, passage);
            if k + 1.0 < count && !is_hidden(walk, k + 1.0) {
                let after = Passage(passage.back, hu_along(ray, k + 1.0), hu_along(ray, k + 1.5));
                gather_passage(&sum, ray, k + 1.0, after);
            }
        } else {
            let p = sample_voxel(ray, k);
            let p_after = sample_voxel(ray, k + 1.0);
            let fetched = fetch(p);
            let fetched_after = fetch(p_after);
            gather(&sum, ray, k, p, fetched);
            if k + 1.0 < count && !is_hidden(walk, k + 1.0) {
                gather(&sum, ray, k + 1.0, p_after, fetched_after);
            }
        }
        samples += min(2.0, count - k);
        k += 2.0;
    }
    var hit: Hit;
    hit.color = vec4<f32>(sum.color, sum.opacity);
    hit.first = sum.first;
    hit.samples = samples;
    hit.t = MISS;
    if behind > 0.0 {
        // The depth is that of the face where the samples before it do not reach the threshold.
        if sum.opacity < VISIBLE || frame.depth_fraction * OPAQUE > sum.opacity {
            return hit;
        }
        sum.opacity = 1.0;
    }
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

// The unclassified sample: its value (w), and its gradient if one fetch returns both.
fn fetch(p: vec3<f32>) -> vec4<f32> {
    if FETCH_TOGETHER {
        return gradient_and_hu(p);
    }
    return vec4<f32>(vec3<f32>(0.0), sample_hu(p));
}

// Adds sample k, at voxel index p, behind the samples accumulated before.
fn gather(sum: ptr<function, Gathered>, ray: Ray, k: f32, p: vec3<f32>, fetched: vec4<f32>) {
    let hu = fetched.w;
    if hu < frame.lowest_visible_hu || (*sum).opacity >= OPAQUE {
        return;
    }
    var sample = classify_at(p, hu);
    if GRADIENT_OPACITY && sample.a > 0.0 {
        sample.a = modulated(sample.a, gradient_factor(p));
    }
    if sample.a <= 0.0 {
        return;
    }
    var rgb = sample.rgb * frame.ambient;
    if SHADED {
        var gradient = fetched.xyz;
        if !FETCH_TOGETHER {
            gradient = gradient_at(p);
        }
        gradient = faced(ray, sample_t(ray, k), gradient);
        rgb = lit(sample.rgb, gradient, ray.direction, p);
    }
    blend(sum, k, rgb, sample.a);
}

// Adds pre-integrated sample k behind the samples accumulated before.
fn gather_passage(sum: ptr<function, Gathered>, ray: Ray, k: f32, passage: Passage) {
    let highest = max(max(passage.front, passage.middle), passage.back);
    if highest < frame.lowest_visible_hu || (*sum).opacity >= OPAQUE {
        return;
    }
    let passed = classify_passage(passage);
    let opacity = passed_opacity(passed);
    if opacity <= 0.0 {
        return;
    }
    var front = passed.front.rgb * frame.ambient;
    var back = passed.back.rgb * frame.ambient;
    if SHADED {
        // A half that adds little to the other is lit like that.
        let front_place = select(-0.25, 0.25, passed.front.a < LITTLE * opacity);
        let back_place = select(0.25, -0.25, passed.back.a < LITTLE * opacity);
        let p = sample_voxel(ray, k + front_place);
        let gradient = faced(ray, sample_t(ray, k + front_place), gradient_at(p));
        front = lit(passed.front.rgb, gradient, ray.direction, p);
        var p_behind = p;
        var gradient_behind = gradient;
        if back_place != front_place {
            p_behind = sample_voxel(ray, k + back_place);
            gradient_behind = faced(ray, sample_t(ray, k + back_place), gradient_at(p_behind));
        }
        back = lit(passed.back.rgb, gradient_behind, ray.direction, p_behind);
    }
    blend(sum, k, (passed.front.a * front + passed.back.a * back) / opacity, opacity);
}

// Adds a sample of this lit colour and opacity, above 0.
fn blend(sum: ptr<function, Gathered>, k: f32, rgb: vec3<f32>, opacity: f32) {
    let before = (*sum).opacity;
    let weight = (1.0 - before) * opacity;
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
