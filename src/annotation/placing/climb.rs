//! The best place of a curved surface near a first one: steps in the tangent plane, each brought
//! back to the surface.

use glam::DVec3;

/// Steps end here, mm.
const LAST_STEP_MM: f64 = 0.002;

/// Most steps taken.
const MOST_STEPS: usize = 200;

/// A place on the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    pub(super) at: DVec3,
    /// Of unit length.
    pub(super) normal: DVec3,
    /// The function to maximise.
    pub(super) score: f64,
}

/// Climbs from a foothold. `project` brings a place near the surface onto it.
pub(super) fn climb(
    from: SurfacePoint,
    first_step_mm: f64,
    project: impl Fn(DVec3) -> Option<SurfacePoint>,
) -> SurfacePoint {
    let (mut best, mut step) = (from, first_step_mm);
    let mut steps = 0;
    while step > LAST_STEP_MM && steps < MOST_STEPS {
        steps += 1;
        let side = best.normal.any_orthonormal_vector();
        let other = best.normal.cross(side);
        let tried = [side, -side, other, -other].map(|way| project(best.at + way * step));
        let better = tried.into_iter().flatten().filter(|tried| tried.score > best.score);
        match better.max_by(|a, b| a.score.total_cmp(&b.score)) {
            Some(better) => best = better,
            None => step /= 2.0,
        }
    }
    best
}
