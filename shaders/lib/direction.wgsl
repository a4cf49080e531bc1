// Directions around an axis.

const PI: f32 = 3.14159265;

// The unit vector at an angle of this cosine from `axis`, `turn` (0..1) of the way around it.
fn around(axis: vec3<f32>, cosine: f32, turn: f32) -> vec3<f32> {
    let other = select(vec3<f32>(1.0, 0.0, 0.0), vec3<f32>(0.0, 1.0, 0.0), abs(axis.x) > 0.7);
    let x = normalize(cross(other, axis));
    let y = cross(axis, x);
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    let angle = 2.0 * PI * turn;
    return axis * cosine + (x * cos(angle) + y * sin(angle)) * sine;
}
