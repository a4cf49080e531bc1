//! The centre of an orbit, and its distance to show all of a volume.
//!
//! Spaces: patient mm. A framing holds for a whole turn about the patient's long axis, so that a
//! turning picture keeps its scale.

use glam::DVec3;

use super::Orbit;
use crate::Grid;
use relief_base::{Patient, Point};

/// A focal point and the space around it.
#[derive(Clone, Debug, PartialEq)]
pub struct Framing {
    center: Point<Patient>,
    shape: Shape,
    /// See [`Framing::narrowest_aspect`].
    narrowest: f64,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    /// A sphere of this radius, mm.
    Sphere(f64),
    /// Outermost points of a body about the centre, mm.
    Body {
        /// Those that it has when it turns about the long axis: each by its distance from the axis
        /// and its height.
        rim: Vec<[f64; 2]>,
        /// Those that it has from the front.
        front: Vec<DVec3>,
    },
}

/// Slices of a body, each with its outermost points.
const SLICES: usize = 128;
/// Columns of a slice, each with its foremost and its hindmost point; the slice has those at its
/// sides.
const COLUMNS: usize = 128;

impl Framing {
    /// The share of the limiting side that a body covers from the front, unless it would reach the
    /// picture's edge from another azimuth.
    pub const COVERAGE: f64 = 0.9;

    /// The share of half a picture's side within which a body stays from every azimuth.
    const REACH: f64 = 0.98;

    /// A sphere, which touches the upper and the lower edge of a picture.
    #[must_use]
    pub const fn of_sphere(center: Point<Patient>, radius_mm: f64) -> Self {
        Self { center, shape: Shape::Sphere(radius_mm), narrowest: 1.0 }
    }

    /// A sphere that represents a body: the smallest with which all of it stays in pictures of `orbit`
    /// that are `aspect` times as wide as high.
    #[must_use]
    pub fn sphere_of(body: &Self, orbit: &Orbit, aspect: f64) -> Self {
        const STEPS: usize = 20;
        let radius_mm = body.radius_mm(orbit, aspect);
        let (mut low, mut high) = (1.0f64.min(aspect), aspect);
        for _ in 0..STEPS {
            let middle = (low + high) / 2.0;
            let fits = body.radius_mm(orbit, middle) <= radius_mm * (1.0 + 1e-9);
            (low, high) = if fits { (low, middle) } else { (middle, high) };
        }
        let shape = Shape::Sphere(radius_mm);
        Self { center: body.center, shape, narrowest: high }
    }

    /// Width by height of the narrowest picture in whose height the sphere fits with all that it stands
    /// for, at least 1. In a narrower one a view has to stand back.
    #[must_use]
    pub fn narrowest_aspect(&self) -> f64 {
        self.narrowest
    }

    /// The bounding sphere of a volume.
    #[must_use]
    pub fn of_grid(grid: &Grid) -> Self {
        Self::of_sphere(grid.center(), grid.bounding_radius_mm())
    }

    /// The space that these points sweep when they turn about the long axis through the middle of
    /// their bounding box; `None` where there are no points, or all are the same.
    ///
    /// The focal point lies on that axis. Its height is that of the middle of the picture from the
    /// front, unless one end would leave the picture from another azimuth while there is room at the
    /// other end. The middle of the box is not that height where one end comes nearer to the eye.
    #[must_use]
    pub fn of_points(points: &[Point<Patient>]) -> Option<Self> {
        let low = points.iter().fold(DVec3::INFINITY, |low, point| low.min(point.xyz));
        let high = points.iter().fold(DVec3::NEG_INFINITY, |high, point| high.max(point.xyz));
        let (center, size) = ((low + high) / 2.0, high - low);
        if points.is_empty() || size == DVec3::ZERO {
            return None;
        }
        let share = |along: f64, of: f64, count: usize| {
            if of > 0.0 { (((along / of + 0.5) * count as f64) as usize).min(count - 1) } else { 0 }
        };
        let mut rim: Vec<Option<[f64; 2]>> = vec![None; SLICES + 2];
        let mut front: Vec<[Option<[DVec3; 2]>; COLUMNS + 1]> = vec![[None; COLUMNS + 1]; SLICES + 2];
        for at in points.iter().map(|point| point.xyz - center) {
            // The outermost slices are flat, so that no lower point is taken for the top.
            let slice = match at.z {
                z if 2.0 * z <= -size.z => 0,
                z if 2.0 * z >= size.z => SLICES + 1,
                z => 1 + share(z, size.z, SLICES),
            };
            let rho = at.truncate().length();
            let widest = rim[slice].get_or_insert([rho, at.z]);
            *widest = if rho > widest[0] { [rho, at.z] } else { *widest };
            let ends = front[slice][share(at.x, size.x, COLUMNS)].get_or_insert([at; 2]);
            ends[0] = if at.y < ends[0].y { at } else { ends[0] };
            ends[1] = if at.y > ends[1].y { at } else { ends[1] };
            let sides = front[slice][COLUMNS].get_or_insert([at; 2]);
            sides[0] = if at.x < sides[0].x { at } else { sides[0] };
            sides[1] = if at.x > sides[1].x { at } else { sides[1] };
        }
        let mut rim: Vec<[f64; 2]> = rim.into_iter().flatten().collect();
        let mut front: Vec<DVec3> = front.into_iter().flatten().flatten().flatten().collect();
        let height = balanced_height(&rim, &front);
        rim.iter_mut().for_each(|[_, z]| *z -= height);
        front.iter_mut().for_each(|at| at.z -= height);
        let center = Point::from_xyz(center + DVec3::Z * height);
        Some(Self { center, shape: Shape::Body { rim, front }, narrowest: 1.0 })
    }

    /// The focal point.
    #[must_use]
    pub fn center(&self) -> Point<Patient> {
        self.center
    }

    /// The radius with which [`Orbit::camera`] shows the whole, mm, in a picture `aspect` times as
    /// wide as high: a sphere's own; a body covers [`Framing::COVERAGE`] of the limiting side from the
    /// front, and stays in the picture from every azimuth at the orbit's elevation.
    ///
    /// In view axes about the centre, a point at distance ρ from the long axis and height z is at
    /// depth ρ cos θ cos e + z sin e towards the eye, ρ sin θ beside and z cos e - ρ cos θ sin e
    /// above, θ being its azimuth against the eye's and e the elevation. An eye at distance d with
    /// half the field of view φ sees it within the share c of the width when d >= depth + |beside|
    /// / (c a tan φ), and of the height when d >= depth + |above| / (c tan φ); the largest over θ
    /// has a closed form. From the front, c is the share that opposite sides cover together.
    #[must_use]
    pub fn radius_mm(&self, orbit: &Orbit, aspect: f64) -> f64 {
        let (rim, front) = match &self.shape {
            Shape::Sphere(radius_mm) => return *radius_mm,
            Shape::Body { rim, front } => (rim, front),
        };
        let lens = Lens::of(orbit, aspect);
        let from_front = lens.needed_from_front(front, Self::COVERAGE);
        let turning = largest(rim.iter().map(|at| lens.needed_turning(*at, Self::REACH))).max(0.0);
        let needed = from_front.max(turning);
        if lens.is_parallel {
            // The eye is three radii away, and has to be outside.
            let reach = rim.iter().map(|[rho, z]| rho.hypot(*z)).fold(0.0, f64::max);
            return needed.max(reach / 2.5);
        }
        needed * (orbit.vertical_fov_deg.to_radians() / 2.0).sin()
    }
}

/// The height of the focal point, mm, in pictures of [`Orbit::default`]: see [`Framing::of_points`].
///
/// The needs of both ends are those of [`Framing::radius_mm`] for elevation 0, where they are linear
/// in the height, with opposite slopes.
fn balanced_height(rim: &[[f64; 2]], front: &[DVec3]) -> f64 {
    let above = Lens::of(&Orbit::default(), 1.0).above;
    let (front_above, above) = (Framing::COVERAGE * above, Framing::REACH * above);
    let ends = [1.0, -1.0];
    let from_front = ends.map(|end| largest(front.iter().map(|at| end * at.z / front_above - at.y)));
    let turning = ends.map(|end| largest(rim.iter().map(|[rho, z]| end * z / above + rho)));
    let needed = mean(from_front).max(mean(turning));
    let middle = (from_front[0] - mean(from_front)) * front_above;
    middle.max((turning[0] - needed) * above).min((needed - turning[1]) * above)
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::NEG_INFINITY, f64::max)
}

fn mean([a, b]: [f64; 2]) -> f64 {
    (a + b) / 2.0
}

/// The distance of an eye, mm; of a parallel projection, half of the picture's height.
struct Lens {
    is_parallel: bool,
    sine: f64,
    cosine: f64,
    /// Half of the picture's height and width, as shares of the eye's distance.
    above: f64,
    beside: f64,
    /// 1 where points nearer to the eye are larger.
    depth: f64,
}

impl Lens {
    fn of(orbit: &Orbit, aspect: f64) -> Self {
        let (sine, cosine) = orbit.elevation_deg.to_radians().sin_cos();
        let is_parallel = orbit.vertical_fov_deg == 0.0;
        let tangent = (orbit.vertical_fov_deg.to_radians() / 2.0).tan();
        let (above, depth) = if is_parallel { (1.0, 0.0) } else { (tangent, 1.0) };
        Self { is_parallel, sine, cosine, above, beside: above * aspect, depth }
    }

    /// For points to cover at most a share of the picture's width and height from the front: azimuth
    /// 0. The means of the needs of opposite sides, each for half of the share: exact where they are
    /// equal or the projection is parallel, and else to the second order of their difference.
    fn needed_from_front(&self, points: &[DVec3], share: f64) -> f64 {
        let side = |reach: &dyn Fn(&DVec3) -> f64| {
            largest(points.iter().map(|at| {
                let depth = self.depth * (at.z * self.sine - at.y * self.cosine);
                depth + reach(at) / share
            }))
        };
        let along = |sign: f64| side(&|at| sign * at.x / self.beside);
        let upright = |sign: f64| side(&|at| sign * (at.z * self.cosine + at.y * self.sine) / self.above);
        mean([along(1.0), along(-1.0)]).max(mean([upright(1.0), upright(-1.0)]))
    }

    /// For a point to be within a share of the picture from every azimuth.
    fn needed_turning(&self, [rho, z]: [f64; 2], share: f64) -> f64 {
        let Self { sine, cosine, depth, .. } = *self;
        let (above, beside) = (share * self.above, share * self.beside);
        let in_width = rho * (depth * cosine).hypot(1.0 / beside) + depth * z * sine;
        let in_height = [1.0, -1.0].map(|side| {
            let along = depth * z * sine + side * z * cosine / above;
            along + rho * (depth * cosine - side * sine / above).abs()
        });
        in_width.max(in_height[0]).max(in_height[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The points of an elliptic cylinder: a body.
    fn body([a, b, height]: [f64; 3]) -> Vec<Point<Patient>> {
        let rings = (0..=10).flat_map(|ring| (0..360).map(move |deg| (ring, f64::from(deg).to_radians())));
        let point = |(ring, angle): (i32, f64)| {
            let z = height * (f64::from(ring) / 10.0 - 0.5);
            Point::new(50.0 + a * angle.cos(), -20.0 + b * angle.sin(), 300.0 + z)
        };
        rings.map(point).collect()
    }

    /// From each azimuth the larger share of width and height that points cover, and that of the
    /// farthest point from the middle.
    fn coverage(points: &[Point<Patient>], orbit: Orbit, size_px: [u32; 2]) -> Vec<[f64; 2]> {
        let aspect = f64::from(size_px[0]) / f64::from(size_px[1]);
        let framing = Framing::of_points(points).unwrap();
        let radius_mm = framing.radius_mm(&orbit, aspect);
        let azimuths = (0..36).map(|turn| f64::from(turn) * 10.0);
        let shares = |azimuth_deg: f64| {
            let camera = Orbit { azimuth_deg, ..orbit }.camera(framing.center(), radius_mm).unwrap();
            let seen = points.iter().map(|point| camera.project(*point, size_px).expect("before the eye"));
            let seen: Vec<[f64; 2]> = seen.map(|(u, v, _)| [u, v]).collect();
            let along = |axis: usize| {
                let side = f64::from(size_px[axis]);
                let low = -largest(seen.iter().map(|at| -at[axis]));
                let high = largest(seen.iter().map(|at| at[axis]));
                [(high - low) / side, (2.0 * high / side - 1.0).max(1.0 - 2.0 * low / side)]
            };
            let [wide, high] = [along(0), along(1)];
            [wide[0].max(high[0]), wide[1].max(high[1])]
        };
        azimuths.map(shares).collect()
    }

    #[test]
    fn a_body_fills_the_limiting_side_and_stays_in_the_picture_from_every_azimuth() {
        for sizes in [[200.0, 120.0, 300.0], [80.0, 95.0, 250.0], [200.0, 120.0, 40.0], [90.0, 200.0, 300.0]]
        {
            for vertical_fov_deg in [0.0, 22.0, 60.0, 150.0] {
                for elevation_deg in [0.0, 30.0, -75.0, 90.0] {
                    let orbit = Orbit { elevation_deg, vertical_fov_deg, ..Orbit::default() };
                    let shares = coverage(&body(sizes), orbit, [960, 540]);
                    let (front, most) = (shares[0][0], largest(shares.iter().map(|share| share[1])));
                    let what = format!("{sizes:?}, {vertical_fov_deg}, {elevation_deg}: {front}, {most}");
                    // 90 % from the front, or nearly the edge from elsewhere.
                    // The mean of two needs is not exact for wide lenses: see `needed_from_front`.
                    let allowed = match vertical_fov_deg {
                        ..=22.0 => 6e-3,
                        ..=60.0 => 0.01,
                        _ => 0.03,
                    };
                    assert!(front < Framing::COVERAGE + allowed && most < Framing::REACH + 1e-3, "{what}");
                    let is_tight = front > Framing::COVERAGE - allowed || most > Framing::REACH - 5e-3;
                    assert!(is_tight, "{what}");
                    assert!(vertical_fov_deg > 22.0 || elevation_deg != 0.0 || front > 0.84, "{what}");
                }
            }
        }
    }

    #[test]
    fn a_body_with_a_face_fills_the_picture_as_others_do() {
        // A cylinder with a nose at its lower end: from behind, the nose is far away.
        let mut head = body([80.0, 95.0, 180.0]);
        head.extend((0..20).map(|step| Point::new(50.0, -115.0 - f64::from(step) * 2.0, 220.0)));
        let shares = coverage(&head, Orbit::default(), [960, 540]);
        let most = largest(shares.iter().map(|share| share[1]));
        assert!(most < Framing::REACH + 1e-3, "{most}");
        let least = -largest(shares.iter().map(|share| -share[0]));
        assert!(least > 0.85 && shares[0][0] < 0.96, "{least}, {}", shares[0][0]);
    }

    #[test]
    fn the_margins_above_and_below_a_cone_are_equal() {
        // Wide below, as a head with its shoulders: the lower end is nearer to the eye than the tip.
        let ring = |height: f64| (0..360).map(move |deg| (height, f64::from(deg).to_radians()));
        let at = |(height, angle): (f64, f64)| {
            let radius = 100.0 * (1.0 - height / 250.0);
            Point::new(10.0 + radius * angle.cos(), radius * angle.sin(), 40.0 + height)
        };
        let cone: Vec<_> = (0..=20).flat_map(|step| ring(f64::from(step) * 10.0)).map(at).collect();
        let framing = Framing::of_points(&cone).unwrap();
        let orbit = Orbit::default();
        let camera = orbit.camera(framing.center(), framing.radius_mm(&orbit, 16.0 / 9.0)).unwrap();
        let rows: Vec<f64> = cone.iter().map(|at| camera.project(*at, [960, 540]).unwrap().1).collect();
        let top = rows.iter().copied().fold(f64::INFINITY, f64::min);
        let bottom = rows.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert!((top - (540.0 - bottom)).abs() < 0.01, "margins of {top} and {} px", 540.0 - bottom);
        let share = (bottom - top) / 540.0;
        assert!((share - Framing::COVERAGE).abs() < 2e-3, "{share}");
    }

    #[test]
    fn nothing_has_no_framing() {
        assert_eq!(Framing::of_points(&[]), None);
        let alone = [Point::new(1.0, 2.0, 3.0)];
        assert_eq!(Framing::of_points(&alone), None);
    }

    /// A box of these sides, mm, about the origin.
    fn corners(sides: [f64; 3]) -> Vec<Point<Patient>> {
        let corner =
            |n: usize| [0, 1, 2].map(|axis| sides[axis] * if n >> axis & 1 == 1 { 0.5 } else { -0.5 });
        (0..8).map(corner).map(|[x, y, z]| Point::new(x, y, z)).collect()
    }

    #[test]
    fn a_sphere_says_from_which_aspect_its_body_fits() {
        let orbit = Orbit { azimuth_deg: 20.0, elevation_deg: 10.0, ..Orbit::default() };
        for (sides, is_wide) in [([400.0, 250.0, 280.0], true), ([150.0, 180.0, 400.0], false)] {
            let body = Framing::of_points(&corners(sides)).unwrap();
            let sphere = Framing::sphere_of(&body, &orbit, 16.0 / 9.0);
            let (narrowest, radius_mm) = (sphere.narrowest_aspect(), sphere.radius_mm(&orbit, 1.0));
            assert_eq!(radius_mm, body.radius_mm(&orbit, 16.0 / 9.0));
            assert!(body.radius_mm(&orbit, narrowest) <= radius_mm * 1.000_001);
            if is_wide {
                assert!((1.1..1.78).contains(&narrowest), "{narrowest}");
                assert!(body.radius_mm(&orbit, narrowest - 0.01) > radius_mm);
            } else {
                assert!((narrowest - 1.0).abs() < 1e-5, "{narrowest}");
            }
        }
    }
}
