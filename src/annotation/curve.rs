//! Smooth curves: a centripetal Catmull-Rom spline through given points, as a line of short
//! straight parts.
//!
//! E. Catmull and R. Rom, "A class of local interpolating splines", 1974; the knots are those of C.
//! Yuksel et al., "Parameterization and applications of Catmull-Rom curves", 2011: distance to the
//! power of a half, which makes no loops and no cusps within a part. Evaluated as P. Barry and R.
//! Goldman do (1988). Any length unit.

use glam::DVec3;

/// Points of the curve through `points`, including these, with `parts` straight segments between
/// two of them. A closed curve ends at its first point.
#[must_use]
pub fn catmull_rom(points: &[DVec3], closed: bool, parts: usize) -> Vec<DVec3> {
    // Points that coincide have no direction between them.
    let mut kept = points.to_vec();
    kept.dedup();
    if closed && kept.len() > 1 && kept.first() == kept.last() {
        kept.pop();
    }
    let count = kept.len();
    if count < 3 {
        return kept;
    }
    let spans = if closed { count } else { count - 1 };
    let mut curve = Vec::with_capacity(spans * parts + 1);
    for span in 0..spans {
        let controls = controls(&kept, span, closed);
        curve.extend((0..parts).map(|part| at(controls, part as f64 / parts as f64)));
    }
    curve.push(if closed { kept[0] } else { kept[count - 1] });
    curve
}

/// The four points that shape a span. Past an open end lies the mirror image of the point before
/// it.
fn controls(points: &[DVec3], span: usize, closed: bool) -> [DVec3; 4] {
    let count = points.len();
    let (a, b) = (points[span], points[(span + 1) % count]);
    let before = if closed || span > 0 { points[(span + count - 1) % count] } else { 2.0 * a - b };
    let after = if closed || span + 2 < count { points[(span + 2) % count] } else { 2.0 * b - a };
    [before, a, b, after]
}

/// The point at `share` of the way from the second to the third control point.
fn at(controls: [DVec3; 4], share: f64) -> DVec3 {
    let mut knots = [0.0; 4];
    for i in 1..4 {
        // Neighbours may coincide after wrapping: knots must still grow.
        knots[i] = knots[i - 1] + controls[i].distance(controls[i - 1]).sqrt().max(1e-9);
    }
    let t = knots[1] + (knots[2] - knots[1]) * share;
    let mut level = controls;
    for width in 1..4 {
        for i in 0..4 - width {
            // The pyramid's middle rows span at most two knots: its top is between the second and
            // the third.
            let (low, high) = if width == 3 { (knots[1], knots[2]) } else { (knots[i], knots[i + width]) };
            level[i] = level[i].lerp(level[i + 1], (t - low) / (high - low));
        }
    }
    level[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(count: usize) -> Vec<DVec3> {
        let angle = |i: usize| std::f64::consts::TAU * i as f64 / count as f64;
        (0..count).map(|i| DVec3::new(angle(i).cos(), angle(i).sin(), 0.0) * 10.0).collect()
    }

    #[test]
    fn the_curve_goes_through_its_points_in_order() {
        let points = [[0.0; 3], [1.0, 5.0, 0.0], [9.0, 5.0, 2.0], [9.0, -3.0, 2.0]].map(DVec3::from);
        let curve = catmull_rom(&points, false, 16);
        let mut from = 0;
        for point in points {
            let found = curve[from..].iter().position(|p| p.distance(point) < 1e-9);
            from += found.expect("the point is on the curve after those before it");
        }
        assert_eq!((curve[0], *curve.last().unwrap()), (points[0], points[3]));
    }

    #[test]
    fn a_closed_curve_through_points_of_a_circle_is_nearly_one() {
        let curve = catmull_rom(&ring(12), true, 16);
        assert_eq!(curve.first(), curve.last());
        let worst = curve.iter().map(|p| (p.length() - 10.0).abs()).fold(0.0, f64::max);
        assert!(worst < 0.02, "{worst} mm from a circle of 10 mm");
    }

    #[test]
    fn straight_points_give_a_straight_line_and_twins_no_nonsense() {
        let line: Vec<DVec3> = [0.0, 1.0, 1.0, 4.0, 9.0].map(|x| DVec3::new(x, 2.0 * x, 0.0)).to_vec();
        for p in catmull_rom(&line, false, 16) {
            assert!((p.y - 2.0 * p.x).abs() < 1e-9 && (0.0..=9.0).contains(&p.x), "{p}");
        }
        assert_eq!(catmull_rom(&[DVec3::ONE; 5], true, 16), [DVec3::ONE]);
    }
}
