//! The triangles around each corner: for measures and smoothing.

use super::TriangleMesh;

/// For every corner its triangles, by their other two corners in order.
pub(super) struct Fans {
    start: Vec<u32>,
    sides: Vec<[u32; 2]>,
}

/// The configuration of triangles around a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fan {
    /// No triangle.
    Empty,
    /// One round that closes.
    Closed,
    /// Every edge has two triangles, in more than one round.
    Pinched,
    /// Some edge has not two triangles that run along it in opposite directions.
    Open,
}

impl Fans {
    pub(super) fn new(mesh: &TriangleMesh) -> Self {
        let mut start = vec![0u32; mesh.vertices.len() + 1];
        for corner in mesh.triangles.iter().flatten() {
            start[*corner as usize + 1] += 1;
        }
        for n in 1..start.len() {
            start[n] += start[n - 1];
        }
        let mut next = start.clone();
        let mut sides = vec![[0; 2]; 3 * mesh.triangles.len()];
        for &[a, b, c] in &mesh.triangles {
            for (corner, side) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
                sides[next[corner as usize] as usize] = side;
                next[corner as usize] += 1;
            }
        }
        Self { start, sides }
    }

    /// The number of corners.
    pub(super) fn len(&self) -> usize {
        self.start.len() - 1
    }

    /// The other two corners of each triangle around a corner.
    pub(super) fn around(&self, corner: usize) -> &[[u32; 2]] {
        &self.sides[self.start[corner] as usize..self.start[corner + 1] as usize]
    }

    pub(super) fn kind(&self, corner: usize) -> Fan {
        let sides = self.around(corner);
        if sides.is_empty() {
            return Fan::Empty;
        }
        // Each side leads from one neighbour to the next: a closed fan is one round through all of
        // them.
        let leads_to = |from: u32| {
            let mut ways = sides.iter().filter(|side| side[0] == from);
            let first = ways.next().map(|side| side[1]);
            if ways.next().is_some() { None } else { first }
        };
        if sides.len() > 64 {
            return Self::kind_of_many(sides);
        }
        let (mut at, mut steps) = (sides[0][0], 0);
        loop {
            let Some(next) = leads_to(at) else { return Fan::Open };
            (at, steps) = (next, steps + 1);
            if at == sides[0][0] {
                break;
            }
            if steps > sides.len() {
                return Fan::Open;
            }
        }
        if steps == sides.len() {
            return Fan::Closed;
        }
        Self::kind_of_many(sides)
    }

    /// The same by sorting: for corners with very many triangles, and those that are not as they
    /// should be.
    fn kind_of_many(sides: &[[u32; 2]]) -> Fan {
        let mut by_start = sides.to_vec();
        by_start.sort_unstable();
        let mut ends: Vec<u32> = sides.iter().map(|side| side[1]).collect();
        ends.sort_unstable();
        let is_once = by_start.windows(2).all(|pair| pair[0][0] != pair[1][0]);
        if !is_once || by_start.iter().map(|side| side[0]).ne(ends) {
            return Fan::Open;
        }
        let (mut at, mut steps) = (by_start[0][0], 0);
        loop {
            let Ok(place) = by_start.binary_search_by_key(&at, |side| side[0]) else { return Fan::Open };
            (at, steps) = (by_start[place][1], steps + 1);
            if at == by_start[0][0] {
                return if steps == sides.len() { Fan::Closed } else { Fan::Pinched };
            }
        }
    }
}
