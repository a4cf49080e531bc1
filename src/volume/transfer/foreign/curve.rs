//! Functions of nodes with midpoint and sharpness, as VTK has them, and their values.
//!
//! A node says where it is, what value it has, and how the way to the next node goes: `midpoint` is
//! where, between 0 and 1 of it, half the way is done, and `sharpness` bends it from a straight
//! line (0) to a step (1). Beyond the first and last node the value stays. The formulas are those
//! of `vtkPiecewiseFunction` and `vtkColorTransferFunction`; a test compares with both.

use super::error::TransferImportError;
use super::space::{ColorSpace, NodeFraction};

/// One value, or red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Node<const N: usize> {
    pub(super) x: f64,
    pub(super) value: [f64; N],
    pub(super) midpoint: f64,
    pub(super) sharpness: f64,
}

/// The treatment of two nodes at one place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CoincidentNodes {
    /// The later one replaces the earlier: functions that are filled point by point.
    Replace,
    /// Both stay, the later one a little to the right: a step.
    Step,
}

/// A function of nodes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Curve<const N: usize> {
    nodes: Vec<Node<N>>,
}

/// From one node to its twin at the same place: nothing beside a table's steps, and enough to
/// survive being written and read.
pub(super) const TWIN_GAP: f64 = 1e-6;

/// Below this a way is straight, above the other it is a step.
const STRAIGHT: f64 = 0.01;
const STEP: f64 = 0.99;

impl<const N: usize> Node<N> {
    /// A node from which a straight line leads on.
    pub(super) fn plain(x: f64, value: [f64; N]) -> Self {
        Self { x, value, midpoint: 0.5, sharpness: 0.0 }
    }
}

impl<const N: usize> Curve<N> {
    /// Most nodes of a function: more than any tool's editor makes.
    pub(super) const MAX_NODES: usize = 4096;

    /// A function through these nodes, in any order. `what` names it in errors.
    ///
    /// # Errors
    /// When there are no points or too many, or a number is out of range.
    pub(super) fn new(
        mut nodes: Vec<Node<N>>,
        twins: CoincidentNodes,
        what: &str,
    ) -> Result<Self, TransferImportError> {
        if nodes.is_empty() || nodes.len() > Self::MAX_NODES {
            let allowed = format!("1 to {}", Self::MAX_NODES);
            return Err(TransferImportError::range(
                &format!("{what}: number of points"),
                &nodes.len(),
                &allowed,
            ));
        }
        for (i, node) in nodes.iter().enumerate() {
            let at = |part: &str| format!("{what}: point {i}: {part}");
            if !(-1e5..=1e5).contains(&node.x) {
                return Err(TransferImportError::range(&at("x"), &node.x, "-100000 to 100000"));
            }
            let parts = node.value.into_iter().map(|value| ("value", value));
            let bends = [("midpoint", node.midpoint), ("sharpness", node.sharpness)];
            for (part, value) in parts.chain(bends) {
                if !(0.0..=1.0).contains(&value) {
                    return Err(TransferImportError::range(&at(part), &value, "0 to 1"));
                }
            }
        }
        nodes.sort_by(|a, b| a.x.total_cmp(&b.x)); // stable: twins keep their order
        match twins {
            CoincidentNodes::Replace => nodes.dedup_by(|later, kept| {
                let same = later.x == kept.x;
                if same {
                    *kept = *later;
                }
                same
            }),
            CoincidentNodes::Step => {
                for i in 1..nodes.len() {
                    nodes[i].x = nodes[i].x.max(nodes[i - 1].x + TWIN_GAP);
                }
            }
        }
        Ok(Self { nodes })
    }

    pub(super) fn nodes(&self) -> &[Node<N>] {
        &self.nodes
    }

    /// The places of the first and the last node.
    pub(super) fn ends(&self) -> [f64; 2] {
        [self.nodes[0].x, self.nodes[self.nodes.len() - 1].x]
    }

    /// The same with every place moved by `x * scale + shift`; `scale` is above zero.
    pub(super) fn moved(mut self, scale: f64, shift: f64) -> Self {
        for node in &mut self.nodes {
            node.x = node.x * scale + shift;
        }
        self
    }

    /// The node before `x` (or at it), and the one after.
    fn around(&self, x: f64) -> (Option<&Node<N>>, Option<&Node<N>>) {
        let next = self.nodes.partition_point(|node| node.x <= x);
        (next.checked_sub(1).map(|i| &self.nodes[i]), self.nodes.get(next))
    }

    /// Where half of each way is done that is no straight line, and whether the function leaps
    /// there.
    pub(super) fn middles(&self) -> impl Iterator<Item = (f64, bool)> {
        let bent = self.nodes.windows(2).filter(|pair| !is_line(&pair[0]));
        bent.map(|pair| {
            let share = safe_midpoint(pair[0].midpoint);
            (pair[0].x + share * (pair[1].x - pair[0].x), pair[0].sharpness > STEP)
        })
    }
}

impl Curve<1> {
    pub(super) fn at(&self, x: f64) -> f64 {
        match self.around(x) {
            (Some(low), Some(high)) => {
                let way = NodeFraction::new(share(low, high.x, x), low.sharpness);
                way.between(low.value[0], high.value[0]).clamp(0.0, 1.0)
            }
            (Some(end), None) | (None, Some(end)) => end.value[0],
            (None, None) => 0.0,
        }
    }
}

impl Curve<3> {
    pub(super) fn at(&self, x: f64, space: ColorSpace) -> [f64; 3] {
        match self.around(x) {
            (Some(low), _) if low.x == x => low.value,
            (Some(low), Some(high)) => {
                let way = NodeFraction::new(share(low, high.x, x), low.sharpness);
                space.between(way, low.value, high.value).map(|channel| channel.clamp(0.0, 1.0))
            }
            (Some(end), None) | (None, Some(end)) => end.value,
            (None, None) => [0.0; 3],
        }
    }
}

/// Neither end: halves of no length would have no slope.
fn safe_midpoint(midpoint: f64) -> f64 {
    midpoint.clamp(0.00001, 0.99999)
}

/// The share of the way from `low` to `high_x` that is done at `x`, with half of it at the midpoint.
fn share<const N: usize>(low: &Node<N>, high_x: f64, x: f64) -> f64 {
    let (s, midpoint) = ((x - low.x) / (high_x - low.x), safe_midpoint(low.midpoint));
    if s < midpoint { 0.5 * s / midpoint } else { 0.5 + 0.5 * (s - midpoint) / (1.0 - midpoint) }
}

/// Whether a way of this sharpness and midpoint is a straight line between its nodes.
pub(super) fn is_line<const N: usize>(node: &Node<N>) -> bool {
    node.sharpness < STRAIGHT && node.midpoint == 0.5
}

impl NodeFraction {
    /// The blend of two nodes at `share` of the way between them, bent by `sharpness`.
    fn new(share: f64, sharpness: f64) -> Self {
        if sharpness > STEP {
            return Self::Step { is_over: share >= 0.5 };
        }
        if sharpness < STRAIGHT {
            return Self::Line(share);
        }
        let power = 1.0 + 10.0 * sharpness;
        let bent = if share < 0.5 {
            0.5 * (2.0 * share).powf(power)
        } else {
            1.0 - 0.5 * (2.0 * (1.0 - share)).powf(power)
        };
        Self::Bent { share: bent, sharpness }
    }

    /// The value between two: for bent ways the cubic with the same slope at both ends, kept
    /// between them.
    pub(super) fn between(self, low: f64, high: f64) -> f64 {
        match self {
            Self::Step { is_over } => {
                if is_over {
                    high
                } else {
                    low
                }
            }
            Self::Line(s) => low + s * (high - low),
            Self::Bent { share: s, sharpness } => {
                let (s2, s3) = (s * s, s * s * s);
                let slope = (1.0 - sharpness) * (high - low);
                let rise = -2.0 * s3 + 3.0 * s2;
                let value = (1.0 - rise) * low + rise * high + (2.0 * s3 - 3.0 * s2 + s) * slope;
                value.clamp(low.min(high), low.max(high))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bend(midpoint: f64, sharpness: f64) -> Curve<1> {
        let nodes = vec![
            Node { x: 0.0, value: [0.2], midpoint, sharpness },
            Node { x: 10.0, value: [0.8], midpoint: 0.5, sharpness: 0.0 },
        ];
        Curve::new(nodes, CoincidentNodes::Step, "a test").unwrap()
    }

    #[test]
    fn half_the_way_is_done_at_the_midpoint_whatever_the_sharpness() {
        for midpoint in [0.1, 0.5, 0.7] {
            for sharpness in [0.0, 0.3, 0.9] {
                let value = bend(midpoint, sharpness).at(10.0 * midpoint);
                assert!((value - 0.5).abs() < 1e-9, "{midpoint} {sharpness}: {value}");
            }
        }
    }

    #[test]
    fn a_sharpness_of_one_is_a_step_at_the_midpoint() {
        let curve = bend(0.25, 1.0);
        assert_eq!([curve.at(2.49), curve.at(2.51)], [0.2, 0.8]);
        assert_eq!(curve.middles().collect::<Vec<_>>(), [(2.5, true)]);
    }

    #[test]
    fn values_stay_beyond_the_ends_and_twins_are_a_step_or_one() {
        assert_eq!([bend(0.5, 0.0).at(-5.0), bend(0.5, 0.0).at(50.0)], [0.2, 0.8]);
        let nodes = [(0.0, 0.0), (5.0, 0.1), (5.0, 0.9), (9.0, 1.0)].map(|(x, y)| Node::plain(x, [y]));
        let step = Curve::new(nodes.to_vec(), CoincidentNodes::Step, "a test").unwrap();
        assert!((step.at(5.0) - 0.1).abs() < 1e-9 && (step.at(5.0 + TWIN_GAP) - 0.9).abs() < 1e-6);
        let replaced = Curve::new(nodes.to_vec(), CoincidentNodes::Replace, "a test").unwrap();
        assert_eq!((replaced.nodes().len(), replaced.at(5.0)), (3, 0.9));
    }

    #[test]
    fn values_out_of_range_are_named() {
        let refused =
            |node: Node<1>| Curve::new(vec![node], CoincidentNodes::Step, "opacity").unwrap_err().to_string();
        let plain = Node::plain(0.0, [0.5]);
        for (node, part) in [
            (Node { x: 1e9, ..plain }, "opacity: point 0: x is 1000000000"),
            (Node { value: [1.5], ..plain }, "opacity: point 0: value is 1.5, allowed: 0 to 1"),
            (Node { midpoint: f64::NAN, ..plain }, "midpoint is NaN"),
            (Node { sharpness: -0.1, ..plain }, "sharpness is -0.1"),
        ] {
            assert!(refused(node).contains(part), "{}", refused(node));
        }
        let none = Curve::<1>::new(vec![], CoincidentNodes::Step, "opacity").unwrap_err().to_string();
        assert!(none.contains("number of points is 0, allowed: 1 to 4096"), "{none}");
    }
}
