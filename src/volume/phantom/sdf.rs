//! Signed distance fields of rounded parts, from which organic shapes are built.
//!
//! A [`Field`] is a list of parts, joined to or cut from those before with a smooth transition
//! of `blend` mm (quadratic polynomial blending after Quilez). Distances are negative inside, in
//! patient LPS mm. They are exact near the surface of balls, cones and blocks and first-order
//! elsewhere; beyond a field's `reach` only their sign and the fact that they are beyond it can be
//! relied on, which is what allows parts to be left out of a block of voxels that they cannot
//! touch.

use glam::{Mat3, Vec2, Vec3};

/// Farther than any reach: the distance of a field that is nowhere near.
pub(super) const FAR: f32 = 1.0e3;

/// An axis-aligned box, mm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Box3 {
    pub(super) min: Vec3,
    pub(super) max: Vec3,
}

impl Box3 {
    pub(super) fn around(center: Vec3, half: Vec3) -> Self {
        Self { min: center - half, max: center + half }
    }

    fn center(&self) -> Vec3 {
        (self.min + self.max) / 2.0
    }

    fn half_diagonal(&self) -> f32 {
        self.min.distance(self.max) / 2.0
    }

    /// Distance between two boxes; 0 where they meet.
    fn gap(&self, other: &Self) -> f32 {
        (self.min - other.max).max(other.min - self.max).max(Vec3::ZERO).length()
    }

    fn mirrored(&self) -> Self {
        Self {
            min: Vec3::new(-self.max.x, self.min.y, self.min.z),
            max: Vec3::new(-self.min.x, self.max.y, self.max.z),
        }
    }
}

/// A shape with a signed distance.
#[derive(Clone, Debug)]
pub(super) enum Solid {
    /// An ellipsoid, turned by `local_from_model`.
    Ellipsoid { center: Vec3, radii: Vec3, local_from_model: Mat3 },
    /// A capsule whose radius changes linearly from `a` to `b`; `scale` flattens it (above 1) or
    /// stretches it.
    Cone { a: Vec3, b: Vec3, radius_a: f32, radius_b: f32, scale: Vec3 },
    /// A box with rounded edges; `half` includes the rounding.
    Block { center: Vec3, half: Vec3, round: f32, local_from_model: Mat3 },
    /// A horseshoe: the front (-y) half of an elliptic wall with straight legs, as dental arches
    /// are.
    Arch { center: Vec3, radii: Vec2, leg: f32, half: Vec2, round: f32 },
}

/// An ellipsoid along the axes.
pub(super) fn ellipsoid(center: [f32; 3], radii: [f32; 3]) -> Solid {
    Solid::Ellipsoid { center: center.into(), radii: radii.into(), local_from_model: Mat3::IDENTITY }
}

/// A ball.
pub(super) fn ball(center: [f32; 3], radius: f32) -> Solid {
    ellipsoid(center, [radius; 3])
}

/// A capsule from `a` to `b` with a radius at each end.
pub(super) fn cone(a: [f32; 3], radius_a: f32, b: [f32; 3], radius_b: f32) -> Solid {
    Solid::Cone { a: a.into(), b: b.into(), radius_a, radius_b, scale: Vec3::ONE }
}

/// A rounded box along the axes.
pub(super) fn block(center: [f32; 3], half: [f32; 3], round: f32) -> Solid {
    Solid::Block { center: center.into(), half: half.into(), round, local_from_model: Mat3::IDENTITY }
}

/// A horseshoe of semi-axes `radii` in x and y around `center`, with legs of 10 mm, `half` wide
/// across the wall and along z.
pub(super) fn arch(center: [f32; 3], radii: [f32; 2], half: [f32; 2], round: f32) -> Solid {
    Solid::Arch { center: center.into(), radii: radii.into(), leg: 10.0, half: half.into(), round }
}

impl Solid {
    /// An ellipsoid or block turned about its centre: first about x (front up), then y (left up),
    /// then z (front to the left), degrees. Other shapes have no orientation of their own.
    pub(super) fn turned(mut self, about_x: f32, about_y: f32, about_z: f32) -> Self {
        let [x, y, z] = [-about_x, -about_y, about_z].map(f32::to_radians);
        let model_from_local = Mat3::from_rotation_z(z) * Mat3::from_rotation_y(y) * Mat3::from_rotation_x(x);
        if let Self::Ellipsoid { local_from_model, .. } | Self::Block { local_from_model, .. } = &mut self {
            *local_from_model = model_from_local.transpose();
        }
        self
    }

    /// An ellipsoid or block whose local axes are the columns of `model_from_local`.
    pub(super) fn along(mut self, model_from_local: Mat3) -> Self {
        if let Self::Ellipsoid { local_from_model, .. } | Self::Block { local_from_model, .. } = &mut self {
            *local_from_model = model_from_local.transpose();
        }
        self
    }

    /// A cone flattened (factor above 1) or stretched (below 1) along x, y and z, about its own
    /// axis.
    pub(super) fn scaled(mut self, factors: [f32; 3]) -> Self {
        if let Self::Cone { scale, .. } = &mut self {
            *scale = factors.into();
        }
        self
    }

    /// Signed distance, mm.
    fn distance(&self, p: Vec3) -> f32 {
        match self {
            Self::Ellipsoid { center, radii, local_from_model } => {
                ellipsoid_distance(*local_from_model * (p - *center), *radii)
            }
            Self::Cone { a, b, radius_a, radius_b, scale } => {
                let (along, from_a) = ((*b - *a) * *scale, (p - *a) * *scale);
                let t = (from_a.dot(along) / along.length_squared().max(1e-6)).clamp(0.0, 1.0);
                let radius = radius_a + (radius_b - radius_a) * t;
                ((from_a - along * t).length() - radius) / scale.max_element()
            }
            Self::Block { center, half, round, local_from_model } => {
                let q = (*local_from_model * (p - *center)).abs() - *half + *round;
                q.max(Vec3::ZERO).length() + q.max_element().min(0.0) - round
            }
            Self::Arch { center, radii, leg, half, round } => {
                arch_distance(p - *center, *radii, *leg, *half, *round)
            }
        }
    }

    /// A box that holds the shape.
    fn bounds(&self) -> Box3 {
        match self {
            Self::Ellipsoid { center, radii: half, local_from_model }
            | Self::Block { center, half, local_from_model, .. } => {
                let model_from_local = local_from_model.transpose();
                let spread = |axis: Vec3| axis.abs();
                let half = spread(model_from_local.x_axis) * half.x
                    + spread(model_from_local.y_axis) * half.y
                    + spread(model_from_local.z_axis) * half.z;
                Box3::around(*center, half)
            }
            Self::Cone { a, b, radius_a, radius_b, scale } => {
                let half = Vec3::splat(radius_a.max(*radius_b)) / *scale;
                Box3 { min: a.min(*b) - half, max: a.max(*b) + half }
            }
            Self::Arch { center, radii, leg, half, .. } => {
                let wall = *radii + half.x;
                Box3 {
                    min: *center - Vec3::new(wall.x, wall.y, half.y),
                    max: *center + Vec3::new(wall.x, *leg + half.x, half.y),
                }
            }
        }
    }
}

/// First-order distance to an ellipsoid: exact on the surface and for balls.
fn ellipsoid_distance(p: Vec3, radii: Vec3) -> f32 {
    let q = p / radii;
    let norm = q.length();
    if norm < 1e-3 {
        return -radii.min_element();
    }
    norm * (norm - 1.0) / (q / radii).length()
}

fn arch_distance(p: Vec3, radii: Vec2, leg: f32, half: Vec2, round: f32) -> f32 {
    let q = Vec2::new(p.x, p.y.min(0.0));
    let wall = ellipsoid_distance(q.extend(0.0), radii.extend(1.0)).abs();
    let behind = (p.y - leg).max(0.0);
    let d = Vec2::new(Vec2::new(wall, behind).length() - half.x, p.z.abs() - half.y) + round;
    d.max(Vec2::ZERO).length() + d.max_element().min(0.0) - round
}

/// Smallest of two distances, rounded off over `blend` mm.
pub(super) fn smooth_min(a: f32, b: f32, blend: f32) -> f32 {
    if blend <= 0.0 {
        return a.min(b);
    }
    let h = (blend - (a - b).abs()).max(0.0);
    a.min(b) - h * h / (4.0 * blend)
}

/// Largest of two distances, rounded off over `blend` mm.
pub(super) fn smooth_max(a: f32, b: f32, blend: f32) -> f32 {
    -smooth_min(-a, -b, blend)
}

/// Cubic step from 0 at `low` to 1 at `high`.
pub(super) fn smooth_step(low: f32, high: f32, value: f32) -> f32 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Operation {
    Join,
    Cut,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sides {
    One,
    Both,
}

/// Shapes of one part: their union is blended or cut as a whole.
#[derive(Clone, Debug)]
struct Part {
    shapes: Vec<(Solid, Box3)>,
    operation: Operation,
    blend: f32,
    sides: Sides,
}

impl Part {
    fn distance<'a>(&self, shapes: impl Iterator<Item = &'a Solid>, p: Vec3) -> f32 {
        let q = if self.sides == Sides::Both { Vec3::new(p.x.abs(), p.y, p.z) } else { p };
        shapes.fold(FAR, |nearest, shape| nearest.min(shape.distance(q)))
    }

    fn apply(&self, so_far: f32, distance: f32) -> f32 {
        match self.operation {
            Operation::Join => smooth_min(so_far, distance, self.blend),
            Operation::Cut => smooth_max(so_far, -distance, self.blend),
        }
    }

    fn gap(&self, bounds: &Box3, region: &Box3) -> f32 {
        let gap = bounds.gap(region);
        if self.sides == Sides::Both { gap.min(bounds.mirrored().gap(region)) } else { gap }
    }
}

/// Parts joined and cut in order.
#[derive(Clone, Debug)]
pub(super) struct Field {
    parts: Vec<Part>,
    reach: f32,
}

impl Field {
    /// An empty field whose distances count up to `reach` mm from its surface.
    pub(super) fn new(reach: f32) -> Self {
        Self { parts: Vec::new(), reach }
    }

    fn push(&mut self, shapes: Vec<Solid>, operation: Operation, blend: f32, sides: Sides) {
        let with_bounds = |shape: Solid| {
            let bounds = shape.bounds();
            (shape, bounds)
        };
        let shapes = shapes.into_iter().map(with_bounds).collect();
        self.parts.push(Part { shapes, operation, blend, sides });
    }

    /// Adds a part.
    pub(super) fn join(&mut self, blend: f32, shape: Solid) {
        self.push(vec![shape], Operation::Join, blend, Sides::One);
    }

    /// Adds a part given on the left (x above 0) and its mirror image.
    pub(super) fn join_both(&mut self, blend: f32, shape: Solid) {
        self.push(vec![shape], Operation::Join, blend, Sides::Both);
    }

    /// Adds several shapes as one part, and its mirror image: between them there is no smoothing,
    /// hence no bulge.
    pub(super) fn join_all_both(&mut self, blend: f32, shapes: Vec<Solid>) {
        self.push(shapes, Operation::Join, blend, Sides::Both);
    }

    /// Takes a part away.
    pub(super) fn cut(&mut self, blend: f32, shape: Solid) {
        self.push(vec![shape], Operation::Cut, blend, Sides::One);
    }

    /// Takes a part given on the left and its mirror image away.
    pub(super) fn cut_both(&mut self, blend: f32, shape: Solid) {
        self.push(vec![shape], Operation::Cut, blend, Sides::Both);
    }

    /// Adds a tube along a smooth curve through points (x, y, z, radius).
    pub(super) fn join_path(&mut self, blend: f32, points: &[[f32; 4]]) {
        self.push(tube(points), Operation::Join, blend, Sides::One);
    }

    /// Adds such a tube and its mirror image.
    pub(super) fn join_path_both(&mut self, blend: f32, points: &[[f32; 4]]) {
        self.push(tube(points), Operation::Join, blend, Sides::Both);
    }

    /// Takes such a tube and its mirror image away.
    pub(super) fn cut_path_both(&mut self, blend: f32, points: &[[f32; 4]]) {
        self.push(tube(points), Operation::Cut, blend, Sides::Both);
    }

    /// Signed distance, from all parts.
    pub(super) fn distance(&self, p: Vec3) -> f32 {
        self.parts.iter().fold(FAR, |so_far, part| {
            part.apply(so_far, part.distance(part.shapes.iter().map(|(shape, _)| shape), p))
        })
    }

    /// The parts that matter inside a region.
    pub(super) fn near(&self, region: &Box3) -> LocalField<'_> {
        let mut local = LocalField { parts: Vec::new(), shapes: Vec::new(), everywhere: FAR };
        let mut any_joined = false;
        for part in &self.parts {
            let start = local.shapes.len();
            let touching = |bounds| part.gap(bounds, region) <= self.reach + part.blend;
            local.shapes.extend(part.shapes.iter().filter(|(_, b)| touching(b)).map(|(shape, _)| shape));
            if local.shapes.len() > start {
                any_joined |= part.operation == Operation::Join;
                local.parts.push((part, start..local.shapes.len()));
            }
        }
        if !any_joined {
            return LocalField::constant(FAR);
        }
        let middle = local.distance(region.center());
        // First-order distances may grow a little faster than the way.
        if middle.abs() > self.reach + 1.5 * region.half_diagonal() {
            return LocalField::constant(FAR.copysign(middle));
        }
        local
    }
}

/// A [`Field`] without the parts that cannot touch a region.
#[derive(Clone, Debug)]
pub(super) struct LocalField<'a> {
    parts: Vec<(&'a Part, std::ops::Range<usize>)>,
    shapes: Vec<&'a Solid>,
    everywhere: f32,
}

impl LocalField<'_> {
    fn constant(distance: f32) -> Self {
        Self { parts: Vec::new(), shapes: Vec::new(), everywhere: distance }
    }

    /// Signed distance of a point of the region.
    pub(super) fn distance(&self, p: Vec3) -> f32 {
        self.parts.iter().fold(self.everywhere, |so_far, (part, range)| {
            part.apply(so_far, part.distance(self.shapes[range.clone()].iter().copied(), p))
        })
    }

    /// Whether the field is beyond its reach in the whole region.
    pub(super) fn is_absent(&self) -> bool {
        self.parts.is_empty() && self.everywhere > 0.0
    }
}

/// Cones along a Catmull-Rom curve through points (x, y, z, radius), four to a span.
fn tube(points: &[[f32; 4]]) -> Vec<Solid> {
    const STEPS: usize = 4;
    let last = points.len() - 1;
    let at = |step: usize| -> [f32; 4] {
        let (span, t) = ((step / STEPS).min(last), (step % STEPS) as f32 / STEPS as f32);
        let [p0, p1, p2, p3] =
            [span.saturating_sub(1), span, (span + 1).min(last), (span + 2).min(last)].map(|n| points[n]);
        std::array::from_fn(|c| catmull_rom([p0[c], p1[c], p2[c], p3[c]], t))
    };
    let segment = |step| {
        let ([ax, ay, az, ar], [bx, by, bz, br]) = (at(step), at(step + 1));
        cone([ax, ay, az], ar, [bx, by, bz], br)
    };
    (0..last * STEPS).map(segment).collect()
}

fn catmull_rom([p0, p1, p2, p3]: [f32; 4], t: f32) -> f32 {
    let (a, b) = (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3, 3.0 * (p1 - p2) + p3 - p0);
    p1 + 0.5 * t * (p2 - p0 + t * (a + t * b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_simple_shapes_are_exact() {
        let p = Vec3::new(3.0, 4.0, 0.0);
        assert!((ball([0.0; 3], 2.0).distance(p) - 3.0).abs() < 1e-5);
        assert!((cone([0.0; 3], 1.0, [3.0, 0.0, 0.0], 1.0).distance(p) - 3.0).abs() < 1e-5);
        assert!((block([0.0; 3], [1.0, 4.0, 1.0], 0.5).distance(p) - 2.0).abs() < 0.1);
        assert!(ellipsoid([0.0; 3], [3.0, 8.0, 2.0]).distance(Vec3::new(0.0, 8.0, 0.0)).abs() < 1e-5);
        assert!(ball([0.0; 3], 2.0).distance(Vec3::ZERO) < -1.9);
    }

    #[test]
    fn turning_lifts_the_front() {
        let rod = ellipsoid([0.0; 3], [1.0, 10.0, 1.0]).turned(30.0, 0.0, 0.0);
        assert!(rod.distance(Vec3::new(0.0, -7.8, 4.5)) < 0.0);
        assert!(rod.distance(Vec3::new(0.0, -7.8, -4.5)) > 0.0);
    }

    #[test]
    fn leaving_parts_out_changes_nothing_within_reach() {
        let mut field = Field::new(3.0);
        field.join(0.0, ellipsoid([0.0, 5.0, 0.0], [30.0, 40.0, 25.0]).turned(10.0, 0.0, 0.0));
        field.join_both(6.0, cone([20.0, -30.0, 0.0], 8.0, [40.0, -35.0, 9.0], 3.0));
        field.cut_both(4.0, ball([12.0, -30.0, 8.0], 9.0));
        field.join_path_both(
            1.0,
            &[[5.0, -20.0, 20.0, 3.0], [15.0, -30.0, 28.0, 2.0], [30.0, -20.0, 20.0, 3.0]],
        );
        let half = Vec3::splat(4.0);
        for n in 0..1000u32 {
            let at = [n % 10, n / 10 % 10, n / 100].map(|v| v as f32 * 10.0 - 45.0);
            let local = field.near(&Box3::around(at.into(), half));
            for corner in [Vec3::ZERO, half, -half, Vec3::new(3.0, -4.0, 1.0)] {
                let p = Vec3::from(at) + corner;
                let (whole, part) = (field.distance(p), local.distance(p));
                let same = (whole - part).abs() < 1e-4 || (whole.abs() > 3.0 && part * whole > 9.0);
                assert!(same, "{p}: {whole} with all parts, {part} with those near");
            }
        }
    }
}
