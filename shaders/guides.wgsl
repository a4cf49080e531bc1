// Computes the guides of the denoiser: means over a pixel of the first collision, without noise.
//
// Nine rays through each pixel march through the medium and add up the albedo, the normal, the
// distance and the light without shadows of each step, weighed by the share of paths that collide
// there. Random paths have the same means. Light with shadows is taken at one place of each ray,
// from one point of each light: places and points differ from ray to ray, and are the same for all
// pixels.
//
// Spaces: start space (see lib/frame.wgsl), mm; voxel index. Light: linear, 1 is white.

struct Guide {
    // Linear colour, and the share of paths that collide.
    albedo: vec4<f32>,
    // Sum of unit normals towards the eye, and mean distance in mm.
    normal: vec4<f32>,
    // Light from all lights and from everywhere, without shadows.
    light: vec4<f32>,
    // The same with shadows.
    shadowed: vec4<f32>,
}

// Rows from the top.
@group(1) @binding(3) var<storage, read_write> guides: array<Guide>;

// Rays end where less than this share of the paths is left.
const LEAST_LEFT: f32 = 0.004;
// Shadows are marched in steps of this many sample distances.
const SHADOW_STEP: f32 = 2.0;
// Rays through a pixel.
const SIDE: u32 = 3u;
const RAYS: u32 = SIDE * SIDE;

@compute @workgroup_size(8, 8)
fn guide(@builtin(global_invocation_id) place: vec3<u32>) {
    let id = place.xy + vec2<u32>(frame.first_column, frame.first_row);
    if any(id >= frame.size_px) {
        return;
    }
    var sum = Guide();
    for (var i = 0u; i < RAYS; i++) {
        let offset = (vec2<f32>(vec2<u32>(i % SIDE, i / SIDE)) + 0.5) / f32(SIDE);
        add_ray(i, sight_through(vec2<f32>(id) + offset), &sum);
    }
    let share = 1.0 / f32(RAYS);
    sum.albedo *= share;
    sum.normal *= share;
    sum.light *= share;
    sum.shadowed *= share;
    guides[id.y * frame.size_px.x + id.x] = sum;
}

fn add_ray(number: u32, sight: Sight, sum: ptr<function, Guide>) {
    let segment = segment_of(sight.origin, sight.direction, NO_COLLISION);
    // Where this share of the paths has collided, light is taken with shadows.
    let chosen = 1.0 - (f32((number * 4u + 1u) % RAYS) + 0.5) / f32(RAYS);
    var left = 1.0;
    var t = segment.begin;
    while t < segment.end && left > LEAST_LEFT {
        let brick = brick_at(segment, t);
        if brick.bound <= 0.0 {
            t = brick.leave;
            continue;
        }
        let step = min(frame.sample_distance_mm, segment.end - t);
        let middle = t + 0.5 * step;
        t += step;
        let voxel = segment_voxel(segment, middle);
        let medium = medium_at(sample_hu(voxel));
        if medium.w <= 0.0 {
            continue;
        }
        let before = left;
        left *= exp(-medium.w * step);
        let share = before - left;
        let at = sight.origin + sight.direction * middle;
        let collision = collision_of(medium.rgb, gradient_per_mm(voxel), -sight.direction);
        var light = medium.rgb * path.environment;
        for (var i = 0u; i < path.light_count; i++) {
            light += scattered(collision, way_to(path.lights[i], at).xyz) * path.lights[i].radiance;
        }
        (*sum).albedo += share * vec4<f32>(medium.rgb, 1.0);
        (*sum).normal += share * vec4<f32>(collision.normal * collision.surface, middle);
        (*sum).light += share * vec4<f32>(light, 0.0);
        if before > chosen && left <= chosen {
            (*sum).shadowed += vec4<f32>(shadowed_light(number, at, collision), 0.0);
        }
    }
}

// Light at a collision, from one point of each light and from one direction of everywhere.
fn shadowed_light(number: u32, at: vec3<f32>, collision: Collision) -> vec3<f32> {
    // Strata of a disc or of a lobe: a different one for each ray.
    let u = vec2<f32>((f32(number) + 0.5) / f32(RAYS), (f32((number * 7u + 2u) % RAYS) + 0.5) / f32(RAYS));
    let openness = passing(segment_of(at, around(collision.normal, sqrt(1.0 - u.x), u.y), NO_COLLISION));
    var light = collision.albedo * path.environment * openness;
    for (var i = 0u; i < path.light_count; i++) {
        let way = way_to(path.lights[i], at);
        let direction = around(way.xyz, mix(1.0, path.lights[i].cos_half, u.x), u.y);
        let share = scattered(collision, direction);
        if any(share > vec3<f32>(0.0)) {
            light += share * path.lights[i].radiance * passing(segment_of(at, direction, way.w));
        }
    }
    return light;
}

// The share of light that passes a segment.
fn passing(segment: Segment) -> f32 {
    var depth = 0.0;
    var t = segment.begin;
    while t < segment.end && depth < 6.0 {
        let brick = brick_at(segment, t);
        if brick.bound <= 0.0 {
            t = brick.leave;
            continue;
        }
        let step = min(SHADOW_STEP * frame.sample_distance_mm, segment.end - t);
        depth += extinction_at(segment_voxel(segment, t + 0.5 * step)) * step;
        t += step;
    }
    return exp(-depth);
}
