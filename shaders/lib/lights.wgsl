// Light of a visible sample: the headlight or placed lights, their shadows, and the occlusion by its
// surroundings take away.
//
// Shadows and openness are looked up in cells that `illuminate.wgsl` has filled: a cell's width
// before the surface, on the eye's side, so that a surface does not shade itself. Spaces: voxel
// index; directions along the patient axes, unit length; places in mm from the volume's centre,
// along the patient axes. Colours are display-referred. Twin: `processor::lights`.

// Whether there are lights in place of the headlight, whether they cast shadows, and whether
// surroundings count.
override PLACED_LIGHTS: bool = false;
override SHADOWS: bool = false;
override OCCLUSION: bool = false;

const MAX_PLACED: u32 = 4u;

struct PlacedLight {
    // Unit vector towards a distant light, or the place of a near one.
    toward: vec3<f32>,
    is_near: u32,
    // Colour times intensity.
    rgb: vec3<f32>,
    padding: f32,
}

struct Lighting {
    place_from_voxel: mat4x4<f32>,
    // Texture coordinates of the cells: for a step of one cell along a normal.
    texture_from_normal: mat3x3<f32>,
    // The same, per voxel.
    cells_from_voxel: vec3<f32>,
    light_count: u32,
    // Shares of shadows and of occlusion that show, 0..1.
    shadows: f32,
    occlusion: f32,
    padding_a: f32,
    padding_b: f32,
    lights: array<PlacedLight, MAX_PLACED>,
}

@group(1) @binding(0) var<uniform> lighting: Lighting;
// The share of each light that reaches a cell.
@group(1) @binding(1) var shadow_cells: texture_3d<f32>;
// The share of all directions that is open around a cell.
@group(1) @binding(2) var open_cells: texture_3d<f32>;

// The colour of a sample at voxel index p, seen along `direction`. The gradient's length does not
// matter. Without a gradient there is only ambient light.
fn lit(rgb: vec3<f32>, gradient: vec3<f32>, direction: vec3<f32>, p: vec3<f32>) -> vec3<f32> {
    if !PLACED_LIGHTS && !OCCLUSION {
        return shade(rgb, gradient, direction);
    }
    let length_squared = dot(gradient, gradient);
    let is_surface = length_squared >= NO_GRADIENT;
    // Towards the eye's side.
    let slope = gradient * select(0.0, inverseSqrt(max(length_squared, NO_GRADIENT)), is_surface);
    let normal = select(slope, -slope, dot(slope, direction) > 0.0);
    let cell = (p + 0.5) * lighting.cells_from_voxel + lighting.texture_from_normal * normal;
    let open = openness(cell);
    if !PLACED_LIGHTS {
        // The headlight represents light from all directions: enclosed places receive less of it.
        return open * shade(rgb, gradient, direction);
    }
    var sum = rgb * frame.ambient * open;
    if is_surface {
        sum += placed(rgb, normal, direction, p, cell);
    }
    return sum;
}

// The share of ambient light that is left: all of it where half of all directions is open, as
// before an even wall.
fn openness(cell: vec3<f32>) -> f32 {
    if !OCCLUSION {
        return 1.0;
    }
    let open = textureSampleLevel(open_cells, volume_sampler, cell, 0.0).x;
    return 1.0 - lighting.occlusion * (1.0 - min(2.0 * open, 1.0));
}

// Diffuse light and highlights (Blinn) of all lights, each less its shadow.
fn placed(rgb: vec3<f32>, normal: vec3<f32>, direction: vec3<f32>, p: vec3<f32>, cell: vec3<f32>) -> vec3<f32> {
    var reached = vec4<f32>(1.0);
    if SHADOWS {
        let share = textureSampleLevel(shadow_cells, volume_sampler, cell, 0.0);
        reached = 1.0 - lighting.shadows * (1.0 - share);
    }
    let place = (lighting.place_from_voxel * vec4<f32>(p, 1.0)).xyz;
    var sum = vec3<f32>(0.0);
    for (var i = 0u; i < lighting.light_count; i++) {
        let light = lighting.lights[i];
        var toward = light.toward;
        if light.is_near != 0u {
            let arm = light.toward - place;
            toward = arm / max(length(arm), 1e-6);
        }
        let facing = min(dot(normal, toward), 1.0);
        if facing <= 0.0 {
            continue;
        }
        var given = rgb * frame.diffuse * facing;
        if HIGHLIGHT {
            let between = toward - direction;
            let across = max(dot(normal, between), 0.0) / max(length(between), 1e-6);
            given += frame.specular * pow(min(across, 1.0), frame.shininess);
        }
        sum += reached[i] * light.rgb * given;
    }
    return sum;
}
