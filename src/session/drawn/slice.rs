//! The intersection of items with a slice, as lines in its plane.

use relief_base::{Patient, Point, Vector};
use relief_render::RenderRequest;

/// The largest distance from the slab of a point that is shown, mm: about a slice of a CT series.
pub(super) const REACH_MM: f64 = 2.5;

/// The plane of a slice, as its camera sees it.
pub(super) struct Cut {
    /// A point of the plane.
    center: Point<Patient>,
    /// Away from the plane, to the eye.
    pub(super) towards_eye: Vector<Patient>,
    /// Half the slab and the reach beyond it, mm.
    reach_mm: f64,
}

/// The distance before the plane at which things are drawn, so that it does not hide them, mm.
const BEFORE_MM: f64 = 0.01;

/// A share of the way from one point to another.
pub(super) fn between(from: Point<Patient>, to: Point<Patient>, share: f64) -> Point<Patient> {
    Point::from_xyz(from.xyz.lerp(to.xyz, share))
}

impl Cut {
    /// The plane through the focal point of a slice's request, across its view.
    pub(super) fn of(request: &RenderRequest) -> Self {
        let camera = &request.camera;
        let back = camera.eye() - camera.look_at();
        let towards_eye = back.normalized().unwrap_or_else(|| Vector::from_xyz(glam::DVec3::Z));
        Self { center: camera.look_at(), towards_eye, reach_mm: request.slab_mm / 2.0 + REACH_MM }
    }

    /// Distance before the plane, mm; negative behind it.
    pub(super) fn distance(&self, point: Point<Patient>) -> f64 {
        (point - self.center).dot(self.towards_eye)
    }

    /// The place of the plane that is nearest, a little before it.
    pub(super) fn flattened(&self, point: Point<Patient>) -> Point<Patient> {
        point + self.towards_eye * (BEFORE_MM - self.distance(point))
    }

    /// The place in the plane of a point within reach.
    pub(super) fn near(&self, point: Point<Patient>) -> Option<Point<Patient>> {
        (self.distance(point).abs() <= self.reach_mm).then(|| self.flattened(point))
    }

    /// The parts of a line within reach, each as a line in the plane.
    pub(super) fn lines(&self, line: &[Point<Patient>]) -> Vec<Vec<Point<Patient>>> {
        let mut parts: Vec<Vec<Point<Patient>>> = Vec::new();
        let mut goes_on = false;
        for ends in line.windows(2) {
            let Some([from, to]) = self.within([ends[0], ends[1]]) else {
                goes_on = false;
                continue;
            };
            let [a, b] = [from, to].map(|share| self.flattened(between(ends[0], ends[1], share)));
            match parts.last_mut().filter(|_| goes_on && from == 0.0) {
                Some(part) => part.push(b),
                None => parts.push(vec![a, b]),
            }
            goes_on = to == 1.0;
        }
        // A line that runs straight through is a point of the plane, which a line shows by its
        // width.
        parts
    }

    /// The shares of a segment between which it is within reach.
    fn within(&self, [a, b]: [Point<Patient>; 2]) -> Option<[f64; 2]> {
        let [from, to] = [a, b].map(|point| self.distance(point));
        let along = to - from;
        if along == 0.0 {
            return (from.abs() <= self.reach_mm).then_some([0.0, 1.0]);
        }
        let [one, other] = [-self.reach_mm, self.reach_mm].map(|edge| (edge - from) / along);
        let (first, last) = (one.min(other).max(0.0), one.max(other).min(1.0));
        (first <= last).then_some([first, last])
    }
}
