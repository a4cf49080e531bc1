//! Control points through a colour function and an opacity function whose nodes lie anywhere.
//!
//! Every node of either becomes a control point. Between them both may bend; there points are added
//! until straight lines between all of them are near enough. Steps become ramps of next to no
//! length. Values in HU.

use super::curve::{Curve, TWIN_GAP, is_line};
use super::space::ColorSpace;
use crate::transfer::{ControlPoint, TransferFunction};

/// The largest error of straight lines at the examined places: a quarter of 1/255, while there is
/// room for enough points. Elsewhere it is less than twice that.
pub(super) const TOLERANCE: f64 = 1.0 / 1024.0;

/// Where this cannot be reached with as many points as there may be, the tolerance is doubled up to
/// this; then nodes are all that is left.
const WORST: f64 = 1.0 / 16.0;

/// Parts of a segment of a curve; the ends of each are compared with a straight line.
const PROBES: u32 = 24;

/// Halvings of the way between two nodes, at most.
const HALVINGS: u32 = 12;

/// Half the length of the ramp that replaces a step, HU: less than a table resolves. Of functions
/// that span little, such as those of 0 to 1, it is a part of their span.
const HALF_RAMP_HU: f64 = 1.0 / 64.0;
const HALF_RAMP_SHARE: f64 = 1.0 / 65536.0;

/// The joint control points, HU rising.
pub(super) fn join(color: &Curve<3>, space: ColorSpace, opacity: &Curve<1>) -> Vec<ControlPoint> {
    let both = Joint::new(color, space, opacity);
    let breaks = both.breaks();
    let mut tolerance = TOLERANCE;
    loop {
        let points = both.points(&breaks, tolerance);
        if points.len() <= TransferFunction::MAX_POINTS || tolerance == f64::INFINITY {
            return points;
        }
        tolerance = if tolerance < WORST { 2.0 * tolerance } else { f64::INFINITY };
    }
}

/// Points of a function over magnitudes, which begin at 0. Ways that bend are divided.
pub(super) fn over_magnitudes(opacity: &Curve<1>) -> Vec<[f64; 2]> {
    const PARTS: u32 = 16;
    let mut places = vec![0.0];
    for pair in opacity.nodes().windows(2) {
        let parts = if is_line(&pair[0]) { 1 } else { PARTS };
        let share = |i: u32| f64::from(i) / f64::from(parts);
        places.extend((0..parts).map(|i| pair[0].x + share(i) * (pair[1].x - pair[0].x)));
    }
    places.push(opacity.ends()[1]);
    places.retain(|x| *x >= 0.0);
    places.dedup();
    places.into_iter().map(|x| [x, opacity.at(x)]).collect()
}

struct Joint<'a> {
    color: &'a Curve<3>,
    space: ColorSpace,
    opacity: &'a Curve<1>,
    half_ramp: f64,
}

impl<'a> Joint<'a> {
    fn new(color: &'a Curve<3>, space: ColorSpace, opacity: &'a Curve<1>) -> Self {
        let ends = [color.ends(), opacity.ends()];
        let low = ends.iter().fold(f64::INFINITY, |low, [first, _]| low.min(*first));
        let high = ends.iter().fold(f64::NEG_INFINITY, |high, [_, last]| high.max(*last));
        let half_ramp = HALF_RAMP_HU.min(HALF_RAMP_SHARE * (high - low));
        Self { color, space, opacity, half_ramp }
    }

    fn at(&self, hu: f64) -> ControlPoint {
        let [r, g, b] = self.color.at(hu, self.space);
        ControlPoint { hu, rgba: [r, g, b, self.opacity.at(hu)] }
    }

    /// The places that need a control point: nodes, and both sides of leaps.
    fn breaks(&self) -> Vec<f64> {
        let (color, opacity) = (self.color.nodes(), self.opacity.nodes());
        let nodes = color.iter().map(|node| node.x).chain(opacity.iter().map(|node| node.x));
        let middles = self.color.middles().chain(self.opacity.middles());
        let sides = middles.flat_map(|(x, leaps)| {
            let half = if leaps { self.half_ramp } else { 0.0 };
            [x - half, x + half]
        });
        let mut breaks: Vec<f64> = nodes.chain(sides).collect();
        if self.space == ColorSpace::Step {
            breaks.extend(color.iter().map(|node| node.x + TWIN_GAP));
        }
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        breaks
    }

    fn points(&self, breaks: &[f64], tolerance: f64) -> Vec<ControlPoint> {
        let mut points: Vec<ControlPoint> = breaks.first().map(|first| self.at(*first)).into_iter().collect();
        let lines = self.space == ColorSpace::Rgb
            && self.color.nodes().iter().all(is_line)
            && self.opacity.nodes().iter().all(is_line);
        for pair in breaks.windows(2) {
            let (low, high) = (self.at(pair[0]), self.at(pair[1]));
            if !lines {
                self.refine(&low, &high, tolerance, HALVINGS, &mut points);
            }
            points.push(high);
        }
        points
    }

    /// Adds the points that are needed strictly between two.
    fn refine(
        &self,
        low: &ControlPoint,
        high: &ControlPoint,
        tolerance: f64,
        halvings: u32,
        points: &mut Vec<ControlPoint>,
    ) {
        let span = high.hu - low.hu;
        if halvings == 0 || span <= self.half_ramp {
            return;
        }
        let is_off = |share: f64| {
            let exact = self.at(low.hu + share * span).rgba;
            let line = |c: usize| low.rgba[c] + share * (high.rgba[c] - low.rgba[c]);
            (0..4).any(|c| (exact[c] - line(c)).abs() > tolerance)
        };
        if (1..PROBES).any(|i| is_off(f64::from(i) / f64::from(PROBES))) {
            let middle = self.at(low.hu + 0.5 * span);
            self.refine(low, &middle, tolerance, halvings - 1, points);
            points.push(middle);
            self.refine(&middle, high, tolerance, halvings - 1, points);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::curve::{CoincidentNodes, Node};
    use super::*;

    fn curve<const N: usize>(nodes: &[(f64, [f64; N], f64, f64)]) -> Curve<N> {
        let node = |&(x, value, midpoint, sharpness): &(f64, [f64; N], f64, f64)| Node {
            x,
            value,
            midpoint,
            sharpness,
        };
        Curve::new(nodes.iter().map(node).collect(), CoincidentNodes::Step, "a test").unwrap()
    }

    #[test]
    fn straight_functions_have_a_point_for_each_node_and_no_more() {
        let color = curve(&[(0.0, [0.0; 3], 0.5, 0.0), (100.0, [1.0; 3], 0.5, 0.0)]);
        let opacity = curve(&[(-50.0, [0.0], 0.5, 0.0), (50.0, [0.5], 0.5, 0.0)]);
        let points = join(&color, ColorSpace::Rgb, &opacity);
        assert_eq!(points.iter().map(|point| point.hu).collect::<Vec<_>>(), [-50.0, 0.0, 50.0, 100.0]);
        assert_eq!(points[1].rgba, [0.0, 0.0, 0.0, 0.25]);
        assert_eq!(points[3].rgba, [1.0, 1.0, 1.0, 0.5]);
    }

    #[test]
    fn bent_functions_are_met_within_the_tolerance_and_steps_up_to_their_ramp() {
        let color = curve(&[
            (0.0, [0.2, 0.3, 0.8], 0.3, 0.4),
            (900.0, [0.7, 0.0, 0.1], 0.5, 1.0),
            (1000.0, [1.0; 3], 0.5, 0.0),
        ]);
        let opacity = curve(&[(0.0, [0.0], 0.8, 0.9), (700.0, [1.0], 0.5, 0.0), (1200.0, [0.3], 0.5, 0.0)]);
        for space in
            [ColorSpace::Rgb, ColorSpace::Lab, ColorSpace::Diverging, ColorSpace::Hsv { wraps: true }]
        {
            let points = join(&color, space, &opacity);
            assert!(points.len() < 400, "{space:?}: {} points", points.len());
            let transfer = TransferFunction::new(points, 1.0).unwrap();
            for i in 0..12_000 {
                let hu = f64::from(i) * 0.1 + 0.037;
                if (hu - 950.0).abs() < 2.0 * HALF_RAMP_HU {
                    continue;
                }
                let [r, g, b] = color.at(hu, space);
                let exact = [r, g, b, opacity.at(hu)];
                let off = transfer.at(hu).iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(off < 2.0 * TOLERANCE, "{space:?} at {hu}: off by {off}");
            }
        }
    }

    #[test]
    fn many_bent_nodes_still_make_a_transfer_function() {
        let nodes: Vec<_> = (0..500).map(|i| (f64::from(i), [f64::from(i % 2)], 0.5, 0.5)).collect();
        let color = curve(&[(0.0, [0.0; 3], 0.5, 0.0)]);
        let points = join(&color, ColorSpace::Rgb, &curve(&nodes));
        assert!(points.len() <= TransferFunction::MAX_POINTS, "{} points", points.len());
    }
}
