// Isosurfaces: where the value along a ray passes given values, lit and blended front to back.
//
// A crossing lies between two neighbouring samples on different sides of a surface's value, from
// below or from above. So that none is lost at the ends, the ray's entry and exit count as samples
// before the first and behind the last. A body that is cut by a clip plane or by the volume's faces
// is open there: a cut is no surface. Values in HU, distances in mm.

// To 1/256 of a sample distance; a straight line through the ends of the remaining interval refines
// it further.
const HALVINGS: i32 = 8;

struct Trace {
    color: vec3<f32>,
    opacity: f32,
    // Where opacity reached the target; MISS when it did not.
    t: f32,
    // Opacity behind the surface at t.
    opacity_at_t: f32,
    samples: f32,
}

// Two neighbouring samples.
struct Stretch {
    near_t: f32,
    near_hu: f32,
    far_t: f32,
    far_hu: f32,
}

fn isosurface(ray: Ray) -> Hit {
    // The first surface, and all that is behind it.
    let whole = trace_surfaces(ray, 0.0);
    var hit: Hit;
    hit.color = vec4<f32>(whole.color, whole.opacity);
    hit.samples = whole.samples;
    hit.t = MISS;
    if whole.opacity >= VISIBLE {
        hit.t = whole.t;
        let target_opacity = frame.depth_fraction * whole.opacity;
        if DEPTH_RULE == DEPTH_THRESHOLD && whole.opacity_at_t < target_opacity {
            hit.t = trace_surfaces(ray, target_opacity).t;
        }
    }
    return hit;
}

// The place of sample k among the samples: its own number, but the ray's entry for -1 and its exit
// for `count`.
fn place_of(ray: Ray, k: f32, count: f32) -> f32 {
    if k < 0.0 {
        return (ray.entry - ray.first) / frame.sample_distance_mm;
    }
    return select(k, (ray.exit - ray.first) / frame.sample_distance_mm, k >= count);
}

// Follows the ray through all surfaces; `t` is that of the first one at which opacity reaches the
// target.
//
// An empty brick lies on one side of every surface, and so do two that touch, since they share
// voxels. Neighbouring samples in empty bricks thus have no crossing between them, as long as a
// step is shorter than a brick. A sample before or behind a visible brick is taken, whatever brick
// it is in.
fn trace_surfaces(ray: Ray, target_opacity: f32) -> Trace {
    var trace = Trace(vec3<f32>(0.0), 0.0, MISS, 0.0, 0.0);
    if ray.exit <= ray.entry {
        return trace;
    }
    let walk = walk_of(ray);
    let count = sample_count(ray);
    let step = abs(walk.brick_step);
    let may_skip = max(max(step.x, step.y), step.z) < 0.99;
    var near_hu = 0.0;
    var near_is_known = false;
    var k = -1.0;
    while k <= count && trace.opacity < OPAQUE {
        let place = place_of(ray, k, count);
        var next = place;
        if may_skip {
            // Hidden samples count: a surface may lie before the sphere, behind the sample before.
            next = next_in_bricks(walk, place);
        }
        let is_empty = next > place;
        // A position between samples belongs to the sample before it, and the search continues at
        // least at the next sample.
        let next_k = select(k + 1.0, max(k + 1.0, floor(next)), is_empty);
        if !is_empty || near_is_known {
            let hu = sample_hu(sample_voxel(ray, place));
            trace.samples += 1.0;
            if k >= 0.0 {
                let near = place_of(ray, k - 1.0, count);
                if !near_is_known {
                    near_hu = sample_hu(sample_voxel(ray, near));
                    trace.samples += 1.0;
                }
                let interval = Stretch(sample_t(ray, near), near_hu, sample_t(ray, place), hu);
                trace = meet_surfaces(ray, interval, trace, target_opacity);
            }
            near_hu = hu;
            near_is_known = !is_empty;
        }
        k = next_k;
    }
    return trace;
}

// The surfaces within an interval, in their order along the ray: values rise or fall through them
// one after another.
fn meet_surfaces(ray: Ray, interval: Stretch, before: Trace, target_opacity: f32) -> Trace {
    var trace = before;
    var rest = interval;
    let rises = interval.far_hu > interval.near_hu;
    for (var i = 0u; i < frame.surface_count; i++) {
        let index = select(frame.surface_count - 1u - i, i, rises);
        let level = frame.surface_hu[index / 4u][index % 4u];
        if (interval.near_hu < level) == (interval.far_hu < level) {
            continue;
        }
        let t = crossing_t(ray, rest, level);
        trace = blend_surface(ray, t, frame.surface_rgba[index], trace, target_opacity);
        // The next surface lies behind this one.
        rest.near_t = t;
        rest.near_hu = level;
    }
    return trace;
}

// The part inside the sphere is absent. Its wall is not a surface, and neither is a clip plane.
fn blend_surface(ray: Ray, t: f32, rgba: vec4<f32>, before: Trace, target_opacity: f32) -> Trace {
    var trace = before;
    if CUT_AWAY && is_cut(ray, t) {
        return trace;
    }
    var rgb = rgba.rgb * frame.ambient;
    if SHADED {
        let p = voxel_at(ray, t);
        rgb = lit(rgba.rgb, gradient_at(p), ray.direction, p);
    }
    let weight = (1.0 - trace.opacity) * rgba.a;
    trace.color += weight * rgb;
    trace.opacity += weight;
    if trace.t >= MISS && trace.opacity >= target_opacity {
        trace.t = t;
        trace.opacity_at_t = trace.opacity;
    }
    return trace;
}

// Where the value passes `level` within an interval whose ends are on different sides of it.
fn crossing_t(ray: Ray, interval: Stretch, level: f32) -> f32 {
    var near_t = interval.near_t;
    var far_t = interval.far_t;
    var near = interval.near_hu - level;
    var far = interval.far_hu - level;
    let near_is_below = interval.near_hu < interval.far_hu;
    for (var i = 0; i < HALVINGS; i++) {
        let middle = 0.5 * (near_t + far_t);
        let value = sample_hu(voxel_at(ray, middle)) - level;
        if (value < 0.0) == near_is_below {
            near_t = middle;
            near = value;
        } else {
            far_t = middle;
            far = value;
        }
    }
    let across = far - near;
    if across == 0.0 {
        return far_t;
    }
    return near_t + clamp(-near / across, 0.0, 1.0) * (far_t - near_t);
}
