// Fills cells of a coarse grid over the volume with the light that reaches them: from each placed
// light, or from everywhere.
//
// A ray from a cell's centre accumulates opacity from samples of the transfer function, or meets
// isosurfaces, as a ray of the picture does. It begins at a distance from the centre, so that the
// surface in which a cell lies does not count. Clipped parts cast no shadow. Cells beyond the reach
// of anything visible are never looked up and stay open.
//
// Spaces: start space of a camera of its own (see lib/frame.wgsl), which depends on the volume
// alone; voxel index. Lengths in mm. Twin: `processor::light_cells`.

// Looks around for openness, instead of towards lights.
override OPENNESS: bool = false;
// Isosurfaces stop light, not the transfer function.
override SURFACES: bool = false;

const MAX_SOURCES: u32 = 4u;
const DIRECTIONS: u32 = 32u;
// Less light than this counts as none.
const DARK: f32 = 1.0 / 512.0;

struct Source {
    // Unit vector towards a distant light, or the place of a near one.
    toward: vec3<f32>,
    is_near: u32,
    // Cosine of half the angle that the light fills.
    cos_half: f32,
    // Points of its disc.
    rays: u32,
    padding_a: u32,
    padding_b: u32,
}

struct Illumination {
    start_from_voxel: mat4x4<f32>,
    // Voxels along each edge of a cell.
    cell_voxels: vec3<f32>,
    // The first layer of cells of this dispatch.
    first_layer: u32,
    // Cells along i, j, k.
    cells: vec3<u32>,
    source_count: u32,
    // Where rays begin, and how far rays of openness go.
    begin_mm: f32,
    radius_mm: f32,
    // Visible bricks that are further away, in bricks, do not look up a cell.
    reach: u32,
    padding: u32,
    sources: array<Source, MAX_SOURCES>,
    // Unit vectors, evenly spread over the sphere.
    directions: array<vec4<f32>, DIRECTIONS>,
}

@group(1) @binding(0) var<uniform> illumination: Illumination;
// The share of each source that reaches a cell, or in x the open share of all directions.
@group(1) @binding(1) var cells_out: texture_storage_3d<rgba16float, write>;

@compute @workgroup_size(4, 4, 4)
fn illuminate(@builtin(global_invocation_id) id: vec3<u32>) {
    let cell = vec3<u32>(id.xy, id.z + illumination.first_layer);
    if any(cell >= illumination.cells) {
        return;
    }
    let voxel = (vec3<f32>(cell) + 0.5) * illumination.cell_voxels - 0.5;
    var light = vec4<f32>(1.0);
    if is_within_reach(voxel) {
        let place = (illumination.start_from_voxel * vec4<f32>(voxel, 1.0)).xyz;
        if OPENNESS {
            light.x = openness_at(place);
        } else {
            for (var i = 0u; i < illumination.source_count; i++) {
                light[i] = share_of(illumination.sources[i], place);
            }
        }
    }
    textureStore(cells_out, cell, light);
}

fn is_within_reach(voxel: vec3<f32>) -> bool {
    let brick = clamp(floor(voxel * frame.bricks_per_voxel), vec3<f32>(0.0), frame.brick_dims - 1.0);
    let at = u32(i32((brick.z * frame.brick_dims.y + brick.y) * frame.brick_dims.x + brick.x));
    return ((brick_distances[at >> 2u] >> ((at & 3u) * 8u)) & 255u) <= illumination.reach;
}

// The mean over all directions of the light that comes from the edge of the surroundings.
fn openness_at(place: vec3<f32>) -> f32 {
    var sum = 0.0;
    for (var i = 0u; i < DIRECTIONS; i++) {
        sum += light_passed(place, illumination.directions[i].xyz, illumination.radius_mm);
    }
    return sum / f32(DIRECTIONS);
}

// The mean over points of a source's disc of the light that comes from there.
fn share_of(source: Source, place: vec3<f32>) -> f32 {
    var toward = source.toward;
    var distance = NEVER;
    if source.is_near != 0u {
        let arm = source.toward - place;
        distance = length(arm);
        toward = arm / max(distance, 1e-6);
    }
    var sum = 0.0;
    for (var i = 0u; i < source.rays; i++) {
        // Vogel's spiral: as even as a sunflower's seeds.
        let turn = fract(f32(i) * 0.618034);
        let cosine = mix(1.0, source.cos_half, (f32(i) + 0.5) / f32(source.rays));
        let direction = select(toward, around(toward, cosine, turn), source.rays > 1u);
        sum += light_passed(place, direction, distance);
    }
    return sum / f32(source.rays);
}

// The share of light that passes on the last `longest` mm to a place, but for the stretch at its
// end.
fn light_passed(place: vec3<f32>, direction: vec3<f32>, longest: f32) -> f32 {
    var ray: Ray;
    ray.origin_voxel = (frame.voxel_from_start * vec4<f32>(place, 1.0)).xyz;
    ray.step_voxel = (frame.voxel_from_start * vec4<f32>(direction, 0.0)).xyz;
    let inside = box_interval(ray.origin_voxel, ray.step_voxel, 0.5);
    let interval = clip_interval(place, direction, vec2<f32>(max(inside.x, 0.0), min(inside.y, longest)));
    ray.entry = interval.x;
    ray.exit = interval.y;
    let cut = cut_interval(place, direction);
    ray.cut_in = cut.x;
    ray.cut_out = cut.y;
    let step = frame.sample_distance_mm;
    // Each sample stands for the stretch around it; values at neighbouring samples tell of surfaces
    // between them.
    ray.first = illumination.begin_mm + select(0.5 * step, 0.0, SURFACES);
    ray.first_voxel = voxel_at(ray, ray.first);
    ray.sample_voxels = ray.step_voxel * step;
    let first = max(ceil((ray.entry - ray.first) / step + ON_FACE), 0.0);
    let last = floor((ray.exit - ray.first) / step - ON_FACE);
    if SURFACES {
        return past_surfaces(ray, first, last);
    }
    return past_samples(ray, first, last);
}

fn past_samples(ray: Ray, first: f32, last: f32) -> f32 {
    let walk = walk_of(ray);
    var share = 1.0;
    var k = first;
    while k <= last && share > DARK {
        let next = next_sample(walk, k);
        if next > k {
            k = next;
            continue;
        }
        share *= 1.0 - voxel_opacity(sample_voxel(ray, k));
        k += 1.0;
    }
    return share;
}

// Steps are shorter than bricks: see raycast/isosurface.wgsl for why nothing is lost between empty
// ones.
fn past_surfaces(ray: Ray, first: f32, last: f32) -> f32 {
    let walk = walk_of(ray);
    var share = 1.0;
    var near = 0.0;
    var near_is_known = false;
    var k = first;
    while k <= last && share > DARK {
        if is_hidden(walk, k) {
            // There is no surface between a visible segment and a cut one.
            near_is_known = false;
            k = max(walk.cut_end, k + 1.0);
            continue;
        }
        let next = next_sample(walk, k);
        let is_empty = next > k;
        if !is_empty || near_is_known {
            let hu = sample_hu(sample_voxel(ray, k));
            if !near_is_known {
                near = select(hu, sample_hu(sample_voxel(ray, k - 1.0)), k > first && !is_hidden(walk, k - 1.0));
            }
            share *= past_levels(near, hu);
            near = hu;
            near_is_known = !is_empty;
        }
        k = select(k + 1.0, max(next, k + 1.0), is_empty);
    }
    return share;
}

fn past_levels(near: f32, far: f32) -> f32 {
    var share = 1.0;
    for (var i = 0u; i < frame.surface_count; i++) {
        let level = frame.surface_hu[i / 4u][i % 4u];
        if (near < level) != (far < level) {
            share *= 1.0 - frame.surface_rgba[i].a;
        }
    }
    return share;
}
