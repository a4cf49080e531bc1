// One frame's parameters, and the ray of a pixel.
//
// Spaces: view (mm; x right, y up, looking along -z), voxel index (integers are voxel centres).
// Lengths in mm. Rays start on a plane before the volume, `near_mm` from the eye, not at the eye:
// 32 bits cannot tell neighbouring samples apart when they count from an eye hundreds of metres
// away. "Start space" is view space moved to that plane.

struct Frame {
    // Voxel index of a position in start space.
    voxel_from_start: mat4x4<f32>,
    // Patient axes of a direction in view space.
    patient_from_view: mat3x3<f32>,
    // A gradient in HU/mm along the patient axes, of one in HU per two voxels along i, j, k.
    patient_from_voxel_gradient: mat3x3<f32>,
    // Voxels along i, j, k.
    dims: vec3<f32>,
    sample_distance_mm: f32,
    // Texture coordinates per voxel, 1 / dims.
    texture_per_voxel: vec3<f32>,
    // The first row of pixels of this dispatch: a picture may be made in bands, and where nothing
    // can be seen in part.
    first_row: u32,
    // Half the picture: at 1 mm before the eye (perspective) or everywhere (orthographic), mm.
    half_extent: vec2<f32>,
    size_px: vec2<u32>,
    background_rgb: vec3<f32>,
    is_orthographic: u32,
    ambient: f32,
    diffuse: f32,
    specular: f32,
    shininess: f32,
    // The transfer table: HU of entry 0, entries per HU, index of the last entry.
    table_first_hu: f32,
    table_entries_per_hu: f32,
    table_last: u32,
    // Share of a ray's final opacity at which the threshold rule puts its depth.
    depth_fraction: f32,
    clip_plane_count: u32,
    // View depth of the plane on which rays start; no part of the volume is nearer.
    near_mm: f32,
    // No value below this is visible, HU.
    lowest_visible_hu: f32,
    // 0 where every sample is to be taken, for tests. Not a pipeline constant: both must run the
    // same code.
    skipping: u32,
    // Bricks along i, j, k.
    brick_dims: vec3<f32>,
    bricks_per_voxel: f32,
    // A sphere whose inside is cut away, start space; a radius of 0 cuts nothing.
    cut_center: vec3<f32>,
    cut_radius_mm: f32,
    // Start space: what dot(n, p) + d >= 0 holds for is kept.
    clip_planes: array<vec4<f32>, 12>,
    // The volume's smallest value, and how far above it the largest is; at least 1. HU.
    lowest_hu: f32,
    span_hu: f32,
    // Sample distance in opacity units.
    units_per_sample: f32,
    surface_count: u32,
    // HU/mm of a component of 1 of precomputed gradients.
    gradient_scale: f32,
    // The first column of pixels of this dispatch.
    first_column: u32,
    // Where the middle of a perspective's picture is off the viewing axis, at 1 mm before the eye,
    // mm; right and up.
    lens_shift: vec2<f32>,
    // Isosurfaces, rising: the value that a ray has to pass (HU), four to a vector; colour and
    // opacity of a crossing.
    surface_hu: array<vec4<f32>, 2>,
    surface_rgba: array<vec4<f32>, 8>,
    // Distance over which the light of a cut face fades into that of gradients, mm.
    face_fade_mm: f32,
    // Window of the slice on cut faces: its lowest value, and one over its width; HU.
    face_lowest_hu: f32,
    face_per_hu: f32,
    padding: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;

// Points origin + direction * t for t in mm; `entry` and `exit` bound the part inside the box and
// the clip planes.
//
// Samples lie at whole sample distances from where the ray meets the box of voxel centres, half a
// voxel inside the volume's own: VTK's place for them. Clip planes hide samples but do not move
// them.
struct Ray {
    // Along the patient axes, unit length.
    direction: vec3<f32>,
    // Voxel index of the ray's start, and voxels per mm along it.
    origin_voxel: vec3<f32>,
    step_voxel: vec3<f32>,
    entry: f32,
    exit: f32,
    // The sphere cuts the part between these; empty if the ray misses it.
    cut_in: f32,
    cut_out: f32,
    // Distance of the first sample, mm.
    first: f32,
    // Voxel index of the first sample, and voxels from sample to sample.
    first_voxel: vec3<f32>,
    sample_voxels: vec3<f32>,
    // View depth per mm of t.
    depth_step: f32,
    // Normals along the patient axes, towards the eye, of the face through which the ray enters, and
    // of the sphere where the ray leaves it.
    entry_normal: vec3<f32>,
    wall_normal: vec3<f32>,
}

// A line of sight in start space: a point before the volume, and a direction of unit length.
struct Sight {
    origin: vec3<f32>,
    direction: vec3<f32>,
}

// The line of sight through a point of the picture, in pixels; u right, v down, centres at +0.5.
fn sight_through(position: vec2<f32>) -> Sight {
    let ndc = position / vec2<f32>(frame.size_px) * 2.0 - 1.0;
    let across = vec2<f32>(ndc.x, -ndc.y) * frame.half_extent;
    if frame.is_orthographic != 0u {
        return Sight(vec3<f32>(across, 0.0), vec3<f32>(0.0, 0.0, -1.0));
    }
    let beside = across + frame.lens_shift;
    return Sight(vec3<f32>(beside * frame.near_mm, 0.0), normalize(vec3<f32>(beside, -1.0)));
}

fn ray_of_pixel(pixel: vec2<u32>) -> Ray {
    let sight = sight_through(vec2<f32>(pixel) + 0.5);
    let origin = sight.origin;
    let direction = sight.direction;
    var ray: Ray;
    ray.direction = frame.patient_from_view * direction;
    ray.origin_voxel = (frame.voxel_from_start * vec4<f32>(origin, 1.0)).xyz;
    ray.step_voxel = (frame.voxel_from_start * vec4<f32>(direction, 0.0)).xyz;
    ray.depth_step = -direction.z;
    let volume_box = box_interval(ray.origin_voxel, ray.step_voxel, 0.5);
    let interval = clip_interval(origin, direction, vec2<f32>(max(volume_box.x, 0.0), volume_box.y));
    ray.entry = interval.x;
    ray.exit = interval.y;
    let cut = cut_interval(origin, direction);
    ray.cut_in = cut.x;
    ray.cut_out = cut.y;
    ray.entry_normal = entry_normal(ray, origin, direction);
    ray.wall_normal = vec3<f32>(0.0);
    if cut.x < cut.y {
        ray.wall_normal = frame.patient_from_view * normalize(frame.cut_center - origin - direction * cut.y);
    }
    var anchor = box_interval(ray.origin_voxel, ray.step_voxel, 0.0).x;
    if !(abs(anchor - ray.entry) < FAR_OFF) {
        anchor = ray.entry;
    }
    let distance = frame.sample_distance_mm;
    ray.first = anchor + ceil((ray.entry - anchor) / distance + ON_FACE) * distance;
    ray.first_voxel = voxel_at(ray, ray.first);
    ray.sample_voxels = ray.step_voxel * distance;
    return ray;
}

// A sample that lies on a face but for rounding, in sample distances: it counts as outside.
const ON_FACE: f32 = 1e-3;
// A ray along a face, between the two boxes, never meets the inner one, or only this far away, mm.
const FAR_OFF: f32 = 1e4;

// Where a ray is inside the box of voxel centres, grown by `margin` voxels: entry and exit.
fn box_interval(origin: vec3<f32>, step: vec3<f32>, margin: f32) -> vec2<f32> {
    // A component of zero would give 0/0 on a face; a tiny one gives a huge interval, as it should.
    let safe = select(step, vec3<f32>(1e-20), abs(step) < vec3<f32>(1e-20));
    let a = (vec3<f32>(-margin) - origin) / safe;
    let b = (frame.dims - 1.0 + margin - origin) / safe;
    let low = min(a, b);
    let high = max(a, b);
    return vec2<f32>(max(max(low.x, low.y), low.z), min(min(high.x, high.y), high.z));
}

fn clip_interval(origin: vec3<f32>, direction: vec3<f32>, interval: vec2<f32>) -> vec2<f32> {
    var kept = interval;
    for (var i = 0u; i < frame.clip_plane_count; i++) {
        let plane = frame.clip_planes[i];
        let height = dot(plane.xyz, origin) + plane.w;
        let slope = dot(plane.xyz, direction);
        if abs(slope) < 1e-12 {
            if height < 0.0 {
                kept.y = kept.x - 1.0;
            }
        } else if slope > 0.0 {
            kept.x = max(kept.x, -height / slope);
        } else {
            kept.y = min(kept.y, -height / slope);
        }
    }
    return kept;
}

// The normal of the face of the volume's box or the clip plane that a ray passes last before its
// entry.
fn entry_normal(ray: Ray, origin: vec3<f32>, direction: vec3<f32>) -> vec3<f32> {
    let safe = select(ray.step_voxel, vec3<f32>(1e-20), abs(ray.step_voxel) < vec3<f32>(1e-20));
    let forward = safe > vec3<f32>(0.0);
    let faces = (select(frame.dims - 0.5, vec3<f32>(-0.5), forward) - ray.origin_voxel) / safe;
    let last = max(max(faces.x, faces.y), faces.z);
    // Gradients and normals are transformed alike.
    var axis = vec3<f32>(0.0, 0.0, 1.0);
    if faces.x == last {
        axis = vec3<f32>(1.0, 0.0, 0.0);
    } else if faces.y == last {
        axis = vec3<f32>(0.0, 1.0, 0.0);
    }
    var entry = last;
    var normal = normalize(frame.patient_from_voxel_gradient * axis);
    for (var i = 0u; i < frame.clip_plane_count; i++) {
        let plane = frame.clip_planes[i];
        let slope = dot(plane.xyz, direction);
        let at = -(dot(plane.xyz, origin) + plane.w) / select(slope, 1.0, slope < 1e-12);
        if slope >= 1e-12 && at > entry {
            entry = at;
            normal = frame.patient_from_view * plane.xyz;
        }
    }
    return select(normal, -normal, dot(normal, ray.direction) > 0.0);
}

// Where a ray is inside the sphere that is cut away; an empty interval where it is not.
fn cut_interval(origin: vec3<f32>, direction: vec3<f32>) -> vec2<f32> {
    let to_center = frame.cut_center - origin;
    let middle = dot(to_center, direction);
    // From the distance of the ray to the centre: squares of the whole distance would lose small
    // differences.
    let beside = to_center - middle * direction;
    let half_squared = frame.cut_radius_mm * frame.cut_radius_mm - dot(beside, beside);
    if frame.cut_radius_mm <= 0.0 || half_squared <= 0.0 {
        return vec2<f32>(1e30, -1e30);
    }
    let half = sqrt(half_squared);
    return vec2<f32>(middle - half, middle + half);
}

// Whether the sphere hides a point of the ray. It hides samples but does not move them, as clip
// planes do.
fn is_cut(ray: Ray, t: f32) -> bool {
    return t > ray.cut_in && t < ray.cut_out;
}

// Samples have whole numbers from 0 on, kept as f32: a ray of a valid request has far below 2^24.
fn sample_count(ray: Ray) -> f32 {
    return max(0.0, floor((ray.exit - ray.first) / frame.sample_distance_mm - ON_FACE) + 1.0);
}

// Voxel index of sample k.
fn sample_voxel(ray: Ray, k: f32) -> vec3<f32> {
    return ray.first_voxel + ray.sample_voxels * k;
}

// Distance along the ray of sample k, mm; fractional k lie between samples.
fn sample_t(ray: Ray, k: f32) -> f32 {
    return ray.first + k * frame.sample_distance_mm;
}

fn voxel_at(ray: Ray, t: f32) -> vec3<f32> {
    return ray.origin_voxel + ray.step_voxel * t;
}

fn view_depth(ray: Ray, t: f32) -> f32 {
    return frame.near_mm + ray.depth_step * t;
}
