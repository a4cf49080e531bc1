//! The intersection of a surface of triangles and a plane.

use std::collections::HashMap;

use super::SurfaceMesh;
use super::slice::{Cut, between};
use relief_base::{Patient, Point};

/// An edge by its corners, the lower index first: where it crosses the plane is one place for both
/// of its triangles.
type Edge = [u32; 2];

/// The outlines of a surface in a plane: each through its points, closed ones ending where they
/// begin.
pub(super) fn contours(shape: &SurfaceMesh, cut: &Cut) -> Vec<Vec<Point<Patient>>> {
    let distances: Vec<f64> = shape.vertices.iter().map(|&vertex| cut.distance(vertex)).collect();
    let is_before = |corner: u32| distances[corner as usize] >= 0.0;
    let mut neighbours: HashMap<Edge, Vec<Edge>> = HashMap::new();
    let mut edges: Vec<Edge> = Vec::new(); // in the order of triangles: the same outlines every time
    for &[a, b, c] in &*shape.triangles {
        let crossed =
            [[a, b], [b, c], [c, a]].into_iter().filter(|[from, to]| is_before(*from) != is_before(*to));
        let crossed: Vec<Edge> = crossed.map(|[from, to]| [from.min(to), from.max(to)]).collect();
        if let [one, other] = crossed[..] {
            for (edge, next) in [(one, other), (other, one)] {
                let known = neighbours.entry(edge).or_insert_with(|| {
                    edges.push(edge);
                    Vec::with_capacity(2)
                });
                known.push(next);
            }
        }
    }
    let place = |[a, b]: Edge| {
        let [from, to] = [a, b].map(|corner| distances[corner as usize]);
        let [first, last] = [a, b].map(|corner| shape.vertices[corner as usize]);
        cut.flattened(between(first, last, from / (from - to)))
    };
    // Open lines start at one of their ends; the remaining ones are closed.
    let mut starts: Vec<Edge> = edges.iter().copied().filter(|edge| neighbours[edge].len() == 1).collect();
    starts.extend(&edges);
    starts
        .into_iter()
        .filter_map(|start| walk(start, &mut neighbours))
        .map(|line| line.into_iter().map(place).collect())
        .collect()
}

/// Follows an outline from here on, and takes it out.
fn walk(start: Edge, neighbours: &mut HashMap<Edge, Vec<Edge>>) -> Option<Vec<Edge>> {
    let mut line = vec![start];
    let mut here = start;
    while let Some(next) = neighbours.get_mut(&here).and_then(Vec::pop) {
        if let Some(back) = neighbours.get_mut(&next)
            && let Some(at) = back.iter().position(|edge| *edge == here)
        {
            back.swap_remove(at);
        }
        line.push(next);
        here = next;
    }
    (line.len() > 1).then_some(line)
}
