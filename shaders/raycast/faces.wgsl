// Cut faces: where the volume's edge, a clip plane or the cut-away sphere opens a body.
//
// Inside of a body, gradients follow noise and no surface. The first sample distance behind a face
// is therefore lit by the face's normal, which then fades into the gradient's direction. Directions
// along the patient axes; distances in mm along the ray. Twin: `processor::faces`.

// The direction by which the point at t mm is lit: the gradient, or the face's normal. Its length has
// no meaning.
fn faced(ray: Ray, t: f32, gradient: vec3<f32>) -> vec3<f32> {
    var behind = t - ray.entry;
    var normal = ray.entry_normal;
    if CUT_AWAY && ray.cut_out > ray.entry && t >= ray.cut_out {
        behind = t - ray.cut_out;
        normal = ray.wall_normal;
    }
    if behind >= frame.sample_distance_mm + frame.face_fade_mm {
        return gradient;
    }
    let share = (behind - frame.sample_distance_mm) / frame.face_fade_mm;
    // Towards the eye, as normals are.
    let slope = gradient * inverseSqrt(max(dot(gradient, gradient), NO_GRADIENT));
    let toward = select(slope, -slope, dot(slope, ray.direction) > 0.0);
    // Slowly at first: opaque bodies show little of the noise behind.
    let weight = max(share, 0.0) * max(share, 0.0);
    return mix(normal, toward, weight);
}

// A cut face on which the slice is painted.
struct Face {
    // Distance along the ray, mm; MISS where there is none.
    t: f32,
    grey: f32,
}

// The first face of a ray with a value above the window's lowest.
fn painted_face(ray: Ray) -> Face {
    if ray.exit <= ray.entry {
        return Face(MISS, 0.0);
    }
    let grey = face_grey(ray, ray.entry);
    if grey > 0.0 && !(CUT_AWAY && is_cut(ray, ray.entry)) {
        return Face(ray.entry, grey);
    }
    if CUT_AWAY && ray.cut_out > ray.entry && ray.cut_out < ray.exit {
        let wall = face_grey(ray, ray.cut_out);
        if wall > 0.0 {
            return Face(ray.cut_out, wall);
        }
    }
    return Face(MISS, 0.0);
}

fn face_grey(ray: Ray, t: f32) -> f32 {
    return min((sample_hu(voxel_at(ray, t)) - frame.face_lowest_hu) * frame.face_per_hu, 1.0);
}
