// Collisions of light: with a surface where values change fast, a scattering medium where
// they do not.
//
// Both are weighed by the gradient and summed, not chosen between. Directions in start space, unit
// length: `eye` and `light` point away from the collision. Light is linear; a light of intensity 1
// makes a white surface that faces it 1, that is, its irradiance is pi.

struct Collision {
    // Linear colour.
    albedo: vec3<f32>,
    // Towards the eye's side.
    normal: vec3<f32>,
    // Share of a surface, 0..1; the rest is medium.
    surface: f32,
    eye: vec3<f32>,
}

// Gradients transform by the transpose of the points' inverse; differences are over two voxels.
fn gradient_per_mm(voxel: vec3<f32>) -> vec3<f32> {
    return 0.5 * central_differences(voxel) * mat3x3<f32>(
        frame.voxel_from_start[0].xyz,
        frame.voxel_from_start[1].xyz,
        frame.voxel_from_start[2].xyz,
    );
}

// Direction from a place to the middle of a light, and the distance, mm.
fn way_to(light: PathLight, place: vec3<f32>) -> vec4<f32> {
    if light.is_near == 0u {
        return vec4<f32>(light.toward, NO_COLLISION);
    }
    let arm = light.toward - place;
    let distance = length(arm);
    return vec4<f32>(arm / max(distance, 1e-6), distance);
}

// `gradient` in start space, HU per mm.
fn collision_of(albedo: vec3<f32>, gradient: vec3<f32>, eye: vec3<f32>) -> Collision {
    let steepness = dot(gradient, gradient);
    var collision: Collision;
    collision.albedo = albedo;
    collision.eye = eye;
    collision.normal = eye;
    collision.surface = 0.0;
    if steepness > 1e-12 {
        let normal = gradient * inverseSqrt(steepness);
        collision.normal = select(-normal, normal, dot(normal, eye) >= 0.0);
        let half_way = path.surface_hu_per_mm * path.surface_hu_per_mm;
        collision.surface = path.surface * steepness / (steepness + half_way);
    }
    return collision;
}

// Henyey and Greenstein's phase function times 4 pi; `cosine` of the angle by which light is
// turned.
fn phase(cosine: f32) -> f32 {
    let g = path.anisotropy;
    let base = max(1.0 + g * g - 2.0 * g * cosine, 1e-6);
    return (1.0 - g * g) / (base * sqrt(base));
}

// The light that leaves towards the eye for light of intensity 1 from one direction.
fn scattered(collision: Collision, light: vec3<f32>) -> vec3<f32> {
    let facing = max(dot(collision.normal, light), 0.0);
    var reflected = collision.albedo * facing;
    if facing > 0.0 && frame.specular > 0.0 {
        let middle = normalize(light + collision.eye);
        reflected += frame.specular * pow(max(dot(collision.normal, middle), 0.0), frame.shininess);
    }
    let medium = collision.albedo * 0.25 * phase(-dot(light, collision.eye));
    return mix(medium, reflected, collision.surface);
}

// A direction for light from all directions, in proportion to its contribution: the cosine at a
// surface, the phase function in a medium.
fn sampled_direction(collision: Collision, random: ptr<function, Random>) -> vec3<f32> {
    let choice = next_two(random);
    let u = next_two(random);
    if choice.x < collision.surface {
        return around(collision.normal, sqrt(1.0 - u.x), u.y);
    }
    return -around(collision.eye, sampled_phase(u.x), u.y);
}

// The cosine of the angle by which light is turned, in proportion to `phase`.
fn sampled_phase(u: f32) -> f32 {
    let g = path.anisotropy;
    if abs(g) < 1e-3 {
        return 1.0 - 2.0 * u;
    }
    let ratio = (1.0 - g * g) / (1.0 + g - 2.0 * g * u);
    return clamp((1.0 + g * g - ratio * ratio) / (2.0 * g), -1.0, 1.0);
}
