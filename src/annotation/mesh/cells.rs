//! The 256 ways in which a surface can pass between eight voxels.
//!
//! A cell lies between 2³ voxel centres, its corners; bit x + 2y + 4z of its case is set where that
//! corner is inside. An edge of the cell is crossed where one of its two ends is inside. On a face,
//! crossings are joined in pairs; the joints around a cell close to one or more rings, its sheets.
//! Where two diagonal corners of a face are inside, each is cut off separately: voxels of a region
//! are neighbours only through faces, and so are they here.

use std::sync::LazyLock;

/// The table of all cases.
pub(super) struct Cells {
    /// Sheets of each case, at most 4.
    pub(super) sheets: [u8; 256],
    /// Of each case and edge its sheet; 255 where it is not crossed. Edges: see [`edge`].
    pub(super) sheet_of: [[u8; 12]; 256],
    /// Of each case and sheet the mean of its crossings' middles, in the cell: 0..1.
    pub(super) places: [[[f64; 3]; 4]; 256],
    /// Of each case the faces whose two joints are parts of one sheet, a bit for each face. Faces:
    /// see [`face`].
    pub(super) twice: [u8; 256],
    /// The number of crossed edges at corner 0 in each case.
    pub(super) quads: [u8; 256],
}

/// The table, made on first use.
pub(super) static CELLS: LazyLock<Cells> = LazyLock::new(Cells::new);

/// The edge along `axis`, at `u` and `v` (0 or 1) along the two axes that follow it in the order x,
/// y, z, x, y.
pub(super) const fn edge(axis: usize, u: usize, v: usize) -> usize {
    axis * 4 + u + 2 * v
}

/// The face across `axis` at its lower (0) or upper (1) end.
pub(super) const fn face(axis: usize, side: usize) -> usize {
    axis * 2 + side
}

/// Both corners of an edge, the lower first.
fn ends(edge: usize) -> [usize; 2] {
    let axis = edge / 4;
    let low = (edge & 1) << ((axis + 1) % 3) | (edge >> 1 & 1) << ((axis + 2) % 3);
    [low, low | 1 << axis]
}

/// The edge between two neighbouring corners.
fn between(a: usize, b: usize) -> usize {
    let axis = (a ^ b).trailing_zeros() as usize;
    edge(axis, a >> ((axis + 1) % 3) & 1, a >> ((axis + 2) % 3) & 1)
}

/// The corners of a face, in order around it.
fn around(face: usize) -> [usize; 4] {
    let (axis, side) = (face / 2, face % 2);
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    [0, u, u | v, v].map(|corner| corner | side << axis)
}

impl Cells {
    fn new() -> Self {
        let mut cells = Self {
            sheets: [0; 256],
            sheet_of: [[255; 12]; 256],
            places: [[[0.0; 3]; 4]; 256],
            twice: [0; 256],
            quads: [0; 256],
        };
        for case in 0..256 {
            cells.fill(case);
        }
        cells
    }

    fn fill(&mut self, case: usize) {
        let is_in = |corner: usize| case >> corner & 1 == 1;
        let is_crossed = |edge: usize| is_in(ends(edge)[0]) != is_in(ends(edge)[1]);
        let joints: Vec<[usize; 3]> =
            (0..6).flat_map(|face| joints(face, is_in).into_iter().map(move |[a, b]| [face, a, b])).collect();
        let mut sheet_of = [255u8; 12];
        for start in (0..12).filter(|edge| is_crossed(*edge)) {
            if sheet_of[start] != 255 {
                continue;
            }
            let sheet = self.sheets[case];
            self.sheets[case] += 1;
            let mut open = vec![start];
            while let Some(at) = open.pop() {
                if sheet_of[at] == 255 {
                    sheet_of[at] = sheet;
                    let others = joints.iter().filter(|joint| joint[1..].contains(&at));
                    open.extend(others.map(|joint| if joint[1] == at { joint[2] } else { joint[1] }));
                }
            }
            let own: Vec<usize> = (0..12).filter(|edge| sheet_of[*edge] == sheet).collect();
            let place = |axis: usize| {
                let middle =
                    |edge: &usize| ends(*edge).map(|end| (end >> axis & 1) as f64).iter().sum::<f64>() / 2.0;
                own.iter().map(middle).sum::<f64>() / own.len() as f64
            };
            self.places[case][usize::from(sheet)] = [place(0), place(1), place(2)];
        }
        for face in 0..6 {
            let sheets: Vec<u8> =
                joints.iter().filter(|joint| joint[0] == face).map(|j| sheet_of[j[1]]).collect();
            self.twice[case] |= u8::from(sheets.len() == 2 && sheets[0] == sheets[1]) << face;
        }
        self.sheet_of[case] = sheet_of;
        self.quads[case] = (0..3).filter(|axis| is_crossed(edge(*axis, 0, 0))).count() as u8;
    }
}

/// Pairs of crossed edges that are joined on a face: none, one or two.
fn joints(face: usize, is_in: impl Fn(usize) -> bool) -> Vec<[usize; 2]> {
    let corners = around(face);
    let crossed: Vec<usize> = (0..4)
        .filter(|n| is_in(corners[*n]) != is_in(corners[(n + 1) % 4]))
        .map(|n| between(corners[n], corners[(n + 1) % 4]))
        .collect();
    match crossed[..] {
        [a, b] => vec![[a, b]],
        [_, _, _, _] => (0..4)
            .filter(|n| is_in(corners[*n]))
            .map(|n| [between(corners[(n + 3) % 4], corners[n]), between(corners[n], corners[(n + 1) % 4])])
            .collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheets_are_those_of_well_known_cases() {
        let sheets =
            |corners: &[usize]| CELLS.sheets[corners.iter().map(|corner| 1 << corner).sum::<usize>()];
        assert_eq!(sheets(&[]), 0);
        assert_eq!(sheets(&[3]), 1);
        assert_eq!(sheets(&[0, 1, 2, 3]), 1);
        assert_eq!(sheets(&[0, 7]), 2);
        assert_eq!(sheets(&[0, 3]), 2, "corners across a face are apart");
        assert_eq!(sheets(&[0, 3, 5, 6]), 4);
        assert_eq!(sheets(&[0, 1, 2, 4, 5, 7]), 1, "and all around a tunnel they are not");
        assert_eq!(CELLS.places[1][0], [1.0 / 6.0; 3]);
        assert_eq!(CELLS.places[0b0000_1111][0], [0.5; 3]);
    }

    #[test]
    fn every_sheet_is_one_ring() {
        for case in 0..256usize {
            let is_in = |corner: usize| case >> corner & 1 == 1;
            let joints: Vec<[usize; 2]> = (0..6).flat_map(|face| joints(face, is_in)).collect();
            for edge in 0..12 {
                let ways = joints.iter().flatten().filter(|at| **at == edge).count();
                let is_crossed = CELLS.sheet_of[case][edge] != 255;
                assert_eq!(ways, 2 * usize::from(is_crossed), "case {case}, edge {edge}");
                assert_eq!(between(ends(edge)[0], ends(edge)[1]), edge);
            }
        }
    }
}
