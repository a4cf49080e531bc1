// Projections: a ray's samples become one value, unshaded.
//
// The extremes (MIP, MinIP) and the mean go through the transfer function; average and additive are
// greys of their own, as VTK has them. Values in HU, distances in mm; opacities of the table are
// per opacity unit, whatever the sample distance.

// Bending below this, in HU per squared sample distance, is rounding.
const FLAT_HU: f32 = 0.05;

fn project(ray: Ray) -> Hit {
    if MODE == MODE_MIP || MODE == MODE_MINIP {
        return project_extreme(ray);
    }
    return project_sum(ray);
}

// The largest or smallest value along the ray, through the transfer function; its depth is where
// that value lies.
fn project_extreme(ray: Ray) -> Hit {
    // The smallest value is the largest of the negated ones.
    let sign = select(1.0, -1.0, MODE == MODE_MINIP);
    let walk = walk_of(ray);
    let count = sample_count(ray);
    var largest = -1e30;
    var at = -1.0;
    var samples = 0.0;
    var k = 0.0;
    while k < count {
        let next = next_sample(walk, k);
        if next > k {
            k = next;
            continue;
        }
        let p = sample_voxel(ray, k);
        let value = sign * sample_hu(p);
        samples += 1.0;
        if value > largest && is_shown(p) {
            largest = value;
            at = k;
        }
        k += 1.0;
    }
    var hit: Hit;
    hit.color = vec4<f32>(0.0);
    hit.samples = samples;
    hit.t = MISS;
    if at >= 0.0 {
        let sample = classify_at(sample_voxel(ray, at), sign * largest);
        hit.color = vec4<f32>(sample.rgb * sample.a, sample.a);
        if sample.a >= VISIBLE {
            hit.t = peak_t(ray, at, largest, sign);
        }
    }
    return hit;
}

// The top of the parabola through the largest sample and its neighbours, at most half a sample
// away. Where values are all but linear the parabola has no top worth the name: the sample itself.
fn peak_t(ray: Ray, at: f32, largest: f32, sign: f32) -> f32 {
    let t = sample_t(ray, at);
    let before = sign * sample_hu(voxel_at(ray, t - frame.sample_distance_mm));
    let after = sign * sample_hu(voxel_at(ray, t + frame.sample_distance_mm));
    let curvature = before - 2.0 * largest + after;
    var offset = 0.0;
    if curvature < -FLAT_HU {
        offset = clamp(0.5 * (before - after) / curvature, -0.5, 0.5);
    }
    let top = clamp(t + offset * frame.sample_distance_mm, ray.entry, ray.exit);
    return select(top, t, is_cut(ray, top));
}

// How bright a value is: 0 for the volume's smallest, 1 for its largest.
fn brightness_of(hu: f32) -> f32 {
    return clamp((hu - frame.lowest_hu) / frame.span_hu, 0.0, 1.0);
}

// The contribution of a sample: its brightness, weighted by its opacity except for the plain mean.
fn share_of_sample(hu: f32) -> f32 {
    if MODE == MODE_MEAN {
        return brightness_of(hu);
    }
    return opacity_of(hu) * brightness_of(hu);
}

// The sum of the samples' shares: as the mean over all samples of the ray that the sphere does not
// hide, or per opacity unit of path. Its depth is the mean depth of the samples, each weighted by
// its share. Samples of empty bricks have no share.
fn project_sum(ray: Ray) -> Hit {
    let walk = walk_of(ray);
    let count = sample_count(ray);
    let shown_count = count - hidden_count(walk, count);
    var sum = 0.0;
    var moment = 0.0;
    var samples = 0.0;
    var k = 0.0;
    while k < count {
        let next = next_sample(walk, k);
        if next > k {
            k = next;
            continue;
        }
        let share = share_of_sample(sample_hu(sample_voxel(ray, k)));
        samples += 1.0;
        sum += share;
        moment += share * k;
        k += 1.0;
    }
    var hit: Hit;
    hit.color = vec4<f32>(0.0);
    hit.samples = samples;
    hit.t = MISS;
    if shown_count > 0.0 {
        hit.color = color_of_sum(sum, shown_count);
        // A grey is opaque even where it is black.
        let shown = select(hit.color.r, hit.color.a, MODE == MODE_MEAN);
        if shown >= VISIBLE {
            let middle = 0.5 * (count - 1.0);
            hit.t = clamp(sample_t(ray, select(middle, moment / sum, sum > 0.0)), ray.entry, ray.exit);
        }
    }
    return hit;
}

fn color_of_sum(sum: f32, count: f32) -> vec4<f32> {
    if MODE == MODE_ADDITIVE {
        return vec4<f32>(vec3<f32>(min(sum * frame.units_per_sample, 1.0)), 1.0);
    }
    let mean = sum / count;
    if MODE == MODE_MEAN {
        let sample = classify(frame.lowest_hu + mean * frame.span_hu);
        return vec4<f32>(sample.rgb * sample.a, sample.a);
    }
    return vec4<f32>(vec3<f32>(mean), 1.0);
}
