// Where between samples a ray's depth is, by the rules `first-hit` and `threshold`.
//
// Spaces: mm along the ray. Twins in `processor::crossing`.

// The threshold rule divides the neighbourhood of its crossing by 4, three times: to 1/64 of a
// sample distance.
const PARTS: i32 = 4;
const LEVELS: i32 = 3;
// Parts of a pre-integrated sample's path in which something visible is looked for.
const PATH_PARTS: i32 = 16;

// Where opacity leaves zero between the sample before the first visible one and that one. A
// pre-integrated sample may be visible anywhere on its path.
fn first_hit(ray: Ray, first: f32) -> f32 {
    var outside = max(ray.entry, sample_t(ray, first - 1.0));
    var inside = sample_t(ray, first);
    if PRE_INTEGRATED {
        let part = frame.sample_distance_mm / f32(PATH_PARTS);
        outside = max(ray.entry, sample_t(ray, first - 0.5));
        inside = outside;
        for (var i = 0; i < PATH_PARTS && opacity_at(ray, inside) <= 0.0; i++) {
            outside = inside;
            inside = min(outside + part, ray.exit);
        }
    }
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
// First finds the sample whose slab holds the crossing, then searches that slab and the one before
// it in finer and finer parts. A sharp edge between two samples affects only the later one,
// although it may lie nearer to the earlier one. An opaque ray's crossing is at or slightly behind
// the sample that accumulation recorded. Other crossings are searched from the start.
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
    let slabs = i32(k - start) + 1;
    if start == 0.0 && opacity_at(ray, ray.entry) > 0.0 {
        // A cut face: the tissue between it and the first sample counts, so that the depth is the
        // face's.
        return refine_crossing(ray, ray.entry, slabs + 1, before, target_opacity);
    }
    return refine_crossing(ray, sample_t(ray, start - 0.5), slabs, before, target_opacity);
}

// The crossing within `slabs` sample distances from `begin` (mm) on, before which `before` has
// accumulated.
//
// The inputs of opacity are fetched every quarter of a sample distance and are linear between:
// finer parts fetch nothing.
fn refine_crossing(ray: Ray, begin: f32, slabs: i32, before: f32, target_opacity: f32) -> f32 {
    let count = slabs * PARTS;
    let part = frame.sample_distance_mm / f32(PARTS);
    // At the ends of the part before, and of this one.
    var early = vec2<f32>(0.0);
    var middle = vec2<f32>(0.0);
    var late = opacity_basis(voxel_at(ray, begin));
    var settled = before;
    var accumulated = before;
    var j = 0;
    while j < count {
        early = middle;
        middle = late;
        late = opacity_basis(voxel_at(ray, begin + f32(j + 1) * part));
        let t = begin + (f32(j) + 0.5) * part;
        let a = part_opacity(shown_opacity(ray, t, mix(middle, late, 0.5)), 1);
        let next = accumulated + (1.0 - accumulated) * a;
        if next >= target_opacity {
            break;
        }
        settled = accumulated;
        accumulated = next;
        j += 1;
    }
    if j == count {
        // Parts add up to a little less than samples did: the crossing is at the end.
        return clamp(begin + f32(count) * part, ray.entry, ray.exit);
    }
    // The positions from here on in parts, from the start of the part before; the first has none
    // before it.
    let origin = begin + f32(j - 1) * part;
    var start = select(0.0, 1.0, j == 0);
    var span = min(j + 1, 2);
    var size = 1.0;
    var s = 2.0;
    for (var level = 2; level <= LEVELS; level++) {
        size /= f32(PARTS);
        let last = span * PARTS;
        var previous = settled;
        accumulated = settled;
        var a = 0.0;
        j = 0;
        while j < last {
            s = start + (f32(j) + 0.5) * size;
            let basis = select(mix(early, middle, s), mix(middle, late, s - 1.0), s > 1.0);
            a = part_opacity(shown_opacity(ray, origin + s * part, basis), level);
            let next = accumulated + (1.0 - accumulated) * a;
            if next >= target_opacity {
                break;
            }
            previous = accumulated;
            accumulated = next;
            j += 1;
        }
        s = start + (f32(j) + share_of_part(a, accumulated, target_opacity)) * size;
        if j == last {
            s = start + f32(last) * size;
            break;
        }
        start += f32(max(j - 1, 0)) * size;
        span = min(j + 1, 2);
        settled = previous;
    }
    return clamp(origin + s * part, ray.entry, ray.exit);
}

// Opacity over one sample distance at a point of the ray.
fn shown_opacity(ray: Ray, t: f32, basis: vec2<f32>) -> f32 {
    return select(opacity_from(voxel_at(ray, t), basis), 0.0, is_cut(ray, t));
}

// How far into a part of opacity `a` the crossing lies, 0..1: opacity grows exponentially within
// it.
fn share_of_part(a: f32, accumulated: f32, target_opacity: f32) -> f32 {
    let whole = log(max(1.0 - a, 1e-30));
    let needed = log(max((1.0 - target_opacity) / (1.0 - accumulated), 1e-30));
    return clamp(needed / min(whole, -1e-30), 0.0, 1.0);
}
