// Depth rules that look at a whole ray once more: where on a semi-transparent ray its depth is.
//
// Spaces: mm along the ray. `a` is the opacity of one sample, and `accumulated` that of all samples
// before it. The weight of a sample is (1 - accumulated) a. A ray is followed as far as the picture
// shows it: to the point where 1/512 of its light remains. Twin: `processor::depth_rules`.

override DEPTH_RULE: u32 = 0u;

const DEPTH_FIRST_HIT: u32 = 0u;
const DEPTH_THRESHOLD: u32 = 1u;
const DEPTH_MAX_OPACITY: u32 = 2u;
const DEPTH_MOST_CONTRIBUTING: u32 = 3u;
const DEPTH_EXPECTED: u32 = 4u;
const DEPTH_WYSIWYP: u32 = 5u;
const DEPTH_TWO_LAYER: u32 = 6u;

// A ray ends when so little of its light is left: half of 1/255 of a fully lit sample.
const OPAQUE: f32 = 1.0 - 1.0 / 512.0;
const BISECTIONS: i32 = 12;
// As great as the greatest: samples inside one material differ by less than this share.
const AS_GREAT: f32 = 1.0 - 1.0 / 256.0;
// An interval of the accumulated opacity ends where its slope has fallen below this share of its
// greatest, and then rises again by the same factor. Its start is where the slope reaches this
// share of the greatest: the middle of an edge.
const SLOPE_SHARE: f32 = 0.5;
// A layer ends where, once so much opacity has accumulated, opacity falls below this share of its
// greatest.
const LAYER_OPACITY: f32 = 0.35;
const LAYER_END_SHARE: f32 = 0.125;

fn opacity_at(ray: Ray, t: f32) -> f32 {
    if is_cut(ray, t) {
        return 0.0;
    }
    return voxel_opacity(voxel_at(ray, t));
}

// The depth of a ray by one of the rules from `max-opacity` to `wysiwyp`; `first` is its first
// visible sample.
fn depth_by_rule(ray: Ray, walk: Walk, first: f32) -> f32 {
    if DEPTH_RULE == DEPTH_MAX_OPACITY {
        return max_opacity(ray, walk, first);
    }
    if DEPTH_RULE == DEPTH_MOST_CONTRIBUTING {
        return most_contributing(ray, walk, first);
    }
    if DEPTH_RULE == DEPTH_EXPECTED {
        return expected(ray, walk, first);
    }
    return wysiwyp(ray, walk, first);
}

fn sample_opacity(ray: Ray, k: f32) -> f32 {
    if PRE_INTEGRATED {
        return passed_opacity(classify_passage(passage_of_sample(ray, k)));
    }
    return voxel_opacity(sample_voxel(ray, k));
}

// Where opacity comes up to `level` between the sample before number k and that one, which reaches
// it.
fn level_crossing(ray: Ray, k: f32, level: f32) -> f32 {
    var outside = max(ray.entry, sample_t(ray, k - 1.0));
    var inside = sample_t(ray, k);
    if opacity_at(ray, outside) >= level {
        return outside;
    }
    for (var i = 0; i < BISECTIONS; i++) {
        let middle = 0.5 * (outside + inside);
        if opacity_at(ray, middle) >= level {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    return inside;
}

// Where the weight comes up to `level`, from sample `start` on, before which `accumulated` has
// accumulated.
fn weight_crossing(ray: Ray, walk: Walk, start: f32, accumulated_before: f32, level: f32) -> f32 {
    let count = sample_count(ray);
    var accumulated = accumulated_before;
    var k = start;
    while k < count {
        let next = next_sample(walk, k);
        if next > k {
            k = next;
            continue;
        }
        let weight = (1.0 - accumulated) * sample_opacity(ray, k);
        if weight >= level {
            break;
        }
        accumulated += weight;
        k += 1.0;
    }
    return level_crossing(ray, min(k, count - 1.0), level / (1.0 - accumulated));
}

// Where opacity first comes up to its greatest value, whatever lies before it.
fn max_opacity(ray: Ray, walk: Walk, first: f32) -> f32 {
    let count = sample_count(ray);
    var accumulated = 0.0;
    var greatest = 0.0;
    var k = first;
    while k < count && accumulated < OPAQUE {
        let next = next_sample(walk, k);
        if next > k {
            k = next;
            continue;
        }
        let a = sample_opacity(ray, k);
        greatest = max(greatest, a);
        accumulated += (1.0 - accumulated) * a;
        k += 1.0;
    }
    k = first;
    while k < count - 1.0 {
        let next = next_sample(walk, k);
        if next == k && sample_opacity(ray, k) >= AS_GREAT * greatest {
            break;
        }
        k = max(next, k + 1.0);
    }
    return level_crossing(ray, min(k, count - 1.0), AS_GREAT * greatest);
}

// Where the weight first comes up to its greatest value: the steepest rise of accumulated opacity.
fn most_contributing(ray: Ray, walk: Walk, first: f32) -> f32 {
    let count = sample_count(ray);
    var accumulated = 0.0;
    var greatest = 0.0;
    var k = first;
    while k < count && accumulated < OPAQUE {
        let next = next_sample(walk, k);
        if next > k {
            k = next;
            continue;
        }
        let weight = (1.0 - accumulated) * sample_opacity(ray, k);
        greatest = max(greatest, weight);
        accumulated += weight;
        k += 1.0;
    }
    return weight_crossing(ray, walk, first, 0.0, AS_GREAT * greatest);
}

// The mean of the samples' places by weight.
fn expected(ray: Ray, walk: Walk, first: f32) -> f32 {
    let count = sample_count(ray);
    var accumulated = 0.0;
    var moment = 0.0;
    var k = first;
    while k < count && accumulated < OPAQUE {
        let next = next_sample(walk, k);
        if next > k {
            k = next;
            continue;
        }
        let weight = (1.0 - accumulated) * sample_opacity(ray, k);
        accumulated += weight;
        moment += weight * (k - first);
        k += 1.0;
    }
    let t = sample_t(ray, first) + moment / accumulated * frame.sample_distance_mm;
    return clamp(t, ray.entry, ray.exit);
}

// An interval of the curve of accumulated opacity, between two lowest points of its slope.
struct Interval {
    // Its first sample, and the opacity accumulated before it.
    start: f32,
    before: f32,
    // The greatest weight in it.
    greatest: f32,
    // By how much opacity rises in it.
    rise: f32,
}

// What you see is what you pick: the start of the interval with the largest rise of accumulated
// opacity.
fn wysiwyp(ray: Ray, walk: Walk, first: f32) -> f32 {
    let count = sample_count(ray);
    var best = Interval(first, 0.0, 0.0, 0.0);
    var present = Interval(first, 0.0, 0.0, 0.0);
    // The lowest weight since the present interval's greatest, behind which the next one may begin.
    var valley = 0.0;
    var coming = Interval(first, 0.0, 0.0, 0.0);
    var falling = false;
    var accumulated = 0.0;
    var k = first;
    while k < count && accumulated < OPAQUE {
        let next = next_sample(walk, k);
        var weight = 0.0;
        if next == k {
            weight = (1.0 - accumulated) * sample_opacity(ray, k);
        }
        if falling && SLOPE_SHARE * weight > valley {
            present.rise = coming.before - present.before;
            if present.rise > best.rise {
                best = present;
            }
            present = coming;
            falling = false;
        }
        present.greatest = max(present.greatest, weight);
        accumulated += weight;
        k = max(next, k + 1.0);
        if weight < SLOPE_SHARE * present.greatest && (!falling || weight < valley) {
            falling = true;
            valley = weight;
            coming = Interval(k, accumulated, 0.0, 0.0);
        }
    }
    present.rise = accumulated - present.before;
    if present.rise > best.rise {
        best = present;
    }
    return weight_crossing(ray, walk, best.start, best.before, SLOPE_SHARE * best.greatest);
}

// The first layer of a ray.
struct FrontLayer {
    // The first sample behind it; the ray's number of samples where it reaches to the ray's end.
    end: f32,
    // The opacity accumulated in it.
    opacity: f32,
}

// The first layer ends where an object ends. The ray behind it is followed beyond the point where
// its light is used up.
fn front_layer(ray: Ray, walk: Walk, first: f32) -> FrontLayer {
    let count = sample_count(ray);
    var layer = FrontLayer(count, 0.0);
    var greatest = 0.0;
    var k = first;
    while k < count {
        let next = next_sample(walk, k);
        var a = 0.0;
        if next == k {
            a = sample_opacity(ray, k);
        }
        if layer.opacity >= LAYER_OPACITY && a < LAYER_END_SHARE * greatest {
            layer.end = k;
            break;
        }
        greatest = max(greatest, a);
        if layer.opacity < OPAQUE {
            layer.opacity += (1.0 - layer.opacity) * a;
        }
        k = max(next, k + 1.0);
    }
    return layer;
}
