// Follows light paths and adds them up: each dispatch adds passes to a picture.
//
// A path goes from the eye to a collision and on to further ones, up to the number of scatterings.
// Each collision receives light straight from each light; a path that leaves the volume ends in the
// surroundings.
// Sums are in linear light. The output is their mean over the background, as display-referred sRGB.
// Passes are added one by one in order, so the sum has the same bits for any grouping into
// dispatches.
//
// Spaces: start space (see lib/frame.wgsl), mm; voxel index. Light: linear, 1 is white.

// Rows from the top: sums over passes of linear red, green, blue and collisions.
@group(1) @binding(3) var<storage, read_write> sums: array<vec4<f32>>;
// Rows from the top: red, green, blue, coverage as bytes from the lowest on.
@group(1) @binding(4) var<storage, read_write> picture: array<u32>;
// The same sums over the passes of odd numbers: two halves of a picture tell how noisy it is.
@group(1) @binding(5) var<storage, read_write> odd_sums: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn pathtrace(@builtin(global_invocation_id) place: vec3<u32>) {
    let id = place.xy + vec2<u32>(frame.first_column, frame.first_row);
    if any(id >= frame.size_px) {
        return;
    }
    let at = id.y * frame.size_px.x + id.x;
    var sum = vec4<f32>(0.0);
    var odd_sum = vec4<f32>(0.0);
    if path.first_pass > 0u {
        sum = sums[at];
        odd_sum = odd_sums[at];
    }
    let end = path.first_pass + path.passes;
    for (var pass_number = path.first_pass; pass_number < end; pass_number++) {
        let light = light_of_path(id, pass_number);
        sum += light;
        if (pass_number & 1u) == 1u {
            odd_sum += light;
        }
    }
    sums[at] = sum;
    odd_sums[at] = odd_sum;
    let mean = sum / f32(end);
    let linear = mean.rgb * path.exposure + (1.0 - mean.a) * path.background;
    picture[at] = pack4x8unorm(vec4<f32>(display_referred(linear), mean.a));
}

// Paths whose share is below this may end before the last scattering.
const FAINT_PATH: f32 = 0.25;

// Linear light that one path brings, and whether it collided.
fn light_of_path(pixel: vec2<u32>, pass_number: u32) -> vec4<f32> {
    var random = random_of(pixel, pass_number, path.seed);
    // Anywhere in the pixel: edges are smooth once there are passes enough.
    let sight = sight_through(vec2<f32>(pixel) + next_two(&random));
    var segment = segment_of(sight.origin, sight.direction, NO_COLLISION);
    var t = free_flight(segment, &random);
    if t >= NO_COLLISION {
        return vec4<f32>(0.0);
    }
    var place = sight.origin + sight.direction * t;
    var eye = -sight.direction;
    var light = vec3<f32>(0.0);
    // The share of the light of a collision that reaches the eye.
    var share = vec3<f32>(1.0);
    for (var scattering = 1u; ; scattering++) {
        let voxel = segment_voxel(segment, t);
        let albedo = medium_at(sample_hu(voxel)).rgb;
        let collision = collision_of(albedo, gradient_per_mm(voxel), eye);
        for (var i = 0u; i < path.light_count; i++) {
            light += share * light_of(path.lights[i], place, collision, &random);
        }
        share *= albedo;
        if scattering >= path.scatterings {
            light += share * path.environment * unblocked(place, collision, &random);
            break;
        }
        // Russian roulette, as in `transmittance`: a faint path ends, or continues with more weight.
        let most = max(share.r, max(share.g, share.b));
        if most < FAINT_PATH {
            if next_two(&random).x * FAINT_PATH >= most {
                break;
            }
            share *= FAINT_PATH / most;
        }
        let direction = sampled_direction(collision, &random);
        segment = segment_of(place, direction, NO_COLLISION);
        t = free_flight(segment, &random);
        if t >= NO_COLLISION {
            light += share * path.environment;
            break;
        }
        place += direction * t;
        eye = -direction;
    }
    return vec4<f32>(light, 1.0);
}

// An estimate of the share of light from everywhere that reaches a collision, for an albedo of 1.
fn unblocked(place: vec3<f32>, collision: Collision, random: ptr<function, Random>) -> f32 {
    if all(path.environment <= vec3<f32>(0.0)) {
        return 0.0;
    }
    let direction = sampled_direction(collision, random);
    return transmittance(segment_of(place, direction, NO_COLLISION), random);
}

// From a point of the light's disc straight to the collision.
fn light_of(light: PathLight, place: vec3<f32>, collision: Collision, random: ptr<function, Random>) -> vec3<f32> {
    let way = way_to(light, place);
    let u = next_two(random);
    let direction = around(way.xyz, mix(1.0, light.cos_half, u.x), u.y);
    let share = scattered(collision, direction);
    if all(share <= vec3<f32>(0.0)) {
        return vec3<f32>(0.0);
    }
    return share * light.radiance * transmittance(segment_of(place, direction, way.w), random);
}

// sRGB's transfer function (IEC 61966-2-1), values clamped to 0..1.
fn display_referred(linear: vec3<f32>) -> vec3<f32> {
    let x = clamp(linear, vec3<f32>(0.0), vec3<f32>(1.0));
    let curved = 1.055 * pow(x, vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curved, 12.92 * x, x <= vec3<f32>(0.0031308));
}
