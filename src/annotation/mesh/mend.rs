//! Makes a closed mesh a 2-manifold again where decimation folded it: cutting and stitching.
//!
//! A. Guéziec et al., "Cutting and stitching: converting sets of polygons to manifold surfaces",
//! 2001. Whatever collapses in a closed mesh, each edge keeps as many triangles that run along it
//! one way as the other. So triangles that lie on each other back to back go; those around an edge
//! of four and more are paired, by angle, so that each pair bounds one body; and a corner whose
//! triangles make several rounds by these pairs becomes several corners, in one place. An edge
//! whose pairs still have both corners in common gets a corner in its middle for each pair but one.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use glam::DVec3;

use super::TriangleMesh;
use super::fans::{Fan, Fans};
use relief_base::Point;

/// A side of a triangle: the triangle, and its first corner (0 to 2).
type Side = (usize, usize);

impl TriangleMesh {
    /// Repairs a mesh that was closed before vertices were merged.
    pub(super) fn mend(&mut self) {
        let bad = self.bad_corners();
        if bad.is_empty() {
            return;
        }
        self.drop_back_to_back(&bad);
        let bad = self.bad_corners();
        let near: Vec<usize> = (0..self.triangles.len())
            .filter(|at| self.triangles[*at].iter().any(|corner| bad.contains(corner)))
            .collect();
        let pairs = self.pairs(&near);
        self.cut(&bad, &near, &pairs);
        self.part(&pairs);
    }

    /// Corners that are not surrounded by one round of triangles.
    fn bad_corners(&self) -> BTreeSet<u32> {
        use rayon::prelude::*;
        let fans = Fans::new(self);
        let is_bad = |corner: &usize| matches!(fans.kind(*corner), Fan::Open | Fan::Pinched);
        let found: Vec<usize> = (0..fans.len()).into_par_iter().filter(is_bad).collect();
        found.into_iter().map(|corner| corner as u32).collect()
    }

    /// Takes out pairs of triangles with the same corners in opposite order.
    fn drop_back_to_back(&mut self, bad: &BTreeSet<u32>) {
        let mut open: HashMap<([u32; 3], bool), Vec<usize>> = HashMap::new();
        let mut gone = vec![false; self.triangles.len()];
        for (at, corners) in self.triangles.iter().enumerate() {
            if !corners.iter().all(|corner| bad.contains(corner)) {
                continue;
            }
            let mut sorted = *corners;
            sorted.sort_unstable();
            let first = corners.iter().position(|corner| *corner == sorted[0]).unwrap_or_default();
            let is_rising = corners[(first + 1) % 3] == sorted[1];
            match open.get_mut(&(sorted, !is_rising)).and_then(Vec::pop) {
                Some(other) => (gone[at], gone[other]) = (true, true),
                None => open.entry((sorted, is_rising)).or_default().push(at),
            }
        }
        let mut at = 0;
        self.triangles.retain(|_| {
            at += 1;
            !gone[at - 1]
        });
    }

    /// For each side of some triangles the side that it is joined to.
    fn pairs(&self, near: &[usize]) -> BTreeMap<Side, Side> {
        let mut edges: BTreeMap<[u32; 2], Vec<Side>> = BTreeMap::new();
        for &at in near {
            for n in 0..3 {
                let [a, b] = [self.triangles[at][n], self.triangles[at][(n + 1) % 3]];
                edges.entry([a.min(b), a.max(b)]).or_default().push((at, n));
            }
        }
        let mut pairs = BTreeMap::new();
        for ([low, high], sides) in edges {
            for [one, other] in self.around([low, high], sides) {
                pairs.insert(one, other);
                pairs.insert(other, one);
            }
        }
        pairs
    }

    /// Pairs of sides around an edge. Seen along it, a body reaches from a triangle that runs
    /// backwards to the next, by angle, that runs forwards.
    fn around(&self, [low, high]: [u32; 2], sides: Vec<Side>) -> Vec<[Side; 2]> {
        let place = |corner: u32| self.vertices[corner as usize].xyz;
        let axis = (place(high) - place(low)).normalize_or(DVec3::Z);
        let (across, up) = axis.any_orthonormal_pair();
        // Right-handed about the axis.
        let up = if across.cross(up).dot(axis) < 0.0 { -up } else { up };
        let mut ring: Vec<(f64, bool, Side)> = sides
            .into_iter()
            .map(|(at, n)| {
                let to = place(self.triangles[at][(n + 2) % 3]) - place(low);
                let angle = to.dot(up).atan2(to.dot(across));
                (angle, self.triangles[at][n] == low, (at, n))
            })
            .collect();
        ring.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        let mut pairs = Vec::new();
        while let Some(at) = (0..ring.len()).find(|n| !ring[*n].1 && ring[(n + 1) % ring.len()].1) {
            let next = (at + 1) % ring.len();
            pairs.push([ring[at].2, ring[next].2]);
            ring.remove(at.max(next));
            ring.remove(at.min(next));
        }
        pairs
    }

    /// Gives every round of triangles about a corner a corner of its own.
    fn cut(&mut self, bad: &BTreeSet<u32>, near: &[usize], pairs: &BTreeMap<Side, Side>) {
        let mut seen: BTreeMap<u32, Vec<Side>> = BTreeMap::new();
        for &at in near {
            for n in 0..3 {
                if bad.contains(&self.triangles[at][n]) {
                    seen.entry(self.triangles[at][n]).or_default().push((at, n));
                }
            }
        }
        let mut changes = Vec::new();
        for (corner, own) in seen {
            let mut done = BTreeSet::new();
            let mut is_given = false;
            for start in own {
                if done.contains(&start) {
                    continue;
                }
                let number = if is_given {
                    self.vertices.push(self.vertices[corner as usize]);
                    self.vertices.len() as u32 - 1
                } else {
                    corner
                };
                is_given = true;
                // Over the side that begins at the corner to the next triangle, until round.
                let mut at = start;
                while done.insert(at) {
                    changes.push((at, number));
                    let Some(&(next, side)) = pairs.get(&at) else { break };
                    at = (next, (side + 1) % 3);
                }
            }
        }
        for ((at, n), number) in changes {
            self.triangles[at][n] = number;
        }
    }

    /// Gives pairs of sides that still have both corners in common with another pair a corner in
    /// their middle.
    fn part(&mut self, pairs: &BTreeMap<Side, Side>) {
        let mut known: BTreeMap<[u32; 2], usize> = BTreeMap::new();
        let mut middles: BTreeMap<usize, [Option<u32>; 3]> = BTreeMap::new();
        for (&(at, n), &(other, m)) in pairs.iter().filter(|(one, other)| one < other) {
            let [a, b] = [self.triangles[at][n], self.triangles[at][(n + 1) % 3]];
            let count = known.entry([a.min(b), a.max(b)]).or_default();
            *count += 1;
            if *count > 1 {
                let middle = (self.vertices[a as usize].xyz + self.vertices[b as usize].xyz) / 2.0;
                let number = self.vertices.len() as u32;
                self.vertices.push(Point::from_xyz(middle));
                middles.entry(at).or_default()[n] = Some(number);
                middles.entry(other).or_default()[m] = Some(number);
            }
        }
        for (at, splits) in middles {
            let corners = self.triangles[at];
            let ring: Vec<u32> = (0..3).flat_map(|n| std::iter::once(corners[n]).chain(splits[n])).collect();
            let middle =
                corners.iter().map(|corner| self.vertices[*corner as usize].xyz).sum::<DVec3>() / 3.0;
            let number = self.vertices.len() as u32;
            self.vertices.push(Point::from_xyz(middle));
            let mut fan = (0..ring.len()).map(|n| [ring[n], ring[(n + 1) % ring.len()], number]);
            self.triangles[at] = fan.next().unwrap_or(corners);
            self.triangles.extend(fan);
        }
    }
}
