//! The teeth: fourteen to a row (no wisdom teeth), each a crown with cusps and one to three roots.
//!
//! Teeth stand on an ellipse (the dental arch), shoulder to shoulder from the midline back. Crown
//! widths are close to the means that textbooks of dental anatomy give, mm.

use glam::{Mat3, Vec3};

use super::super::sdf::{Field, Solid, arch, ball, block, cone};

const REACH_MM: f32 = 3.0;
/// Centre of both dental arches in y.
const ARCH_Y: f32 = -54.0;

/// One row of teeth.
struct Row {
    /// Semi-axes of the arch through the middles of the crowns.
    radii: [f32; 2],
    /// Height of the necks (where enamel ends) and of the biting edges, mm.
    neck_z: f32,
    edge_z: f32,
    /// Height of the roots' tips.
    tip_z: f32,
    /// Width along the arch and thickness across it of each crown, from the midline back.
    crowns: [(f32, f32); 7],
}

const UPPER: Row = Row {
    radii: [25.5, 33.5],
    neck_z: -31.0,
    edge_z: -41.4,
    tip_z: -19.0,
    crowns: [(8.5, 6.0), (6.6, 5.6), (7.6, 7.4), (7.1, 8.6), (6.8, 8.6), (10.2, 10.4), (9.6, 10.2)],
};

const LOWER: Row = Row {
    radii: [24.0, 29.3],
    neck_z: -49.5,
    edge_z: -40.0,
    tip_z: -62.0,
    crowns: [(5.4, 5.6), (5.9, 5.9), (6.9, 7.2), (7.0, 7.6), (7.1, 8.0), (11.0, 10.0), (10.6, 9.8)],
};

/// The upper jaw's ridge.
pub(super) fn upper_ridge() -> Solid {
    tooth_ridge(-23.5, UPPER.radii, 8.0)
}

/// The lower jaw's ridge.
pub(super) fn lower_ridge() -> Solid {
    tooth_ridge(-57.5, LOWER.radii, 8.5)
}

/// Enamel, dentine, pulp and a filling.
pub(super) struct Teeth {
    /// Crowns, enamel outside.
    pub(super) crowns: Field,
    /// Roots and the cores of crowns.
    pub(super) dentine: Field,
    /// Pulp chambers and root canals.
    pub(super) pulp: Field,
    /// Amalgam in the first lower molar on the left: the one tooth that differs from its mirror
    /// image.
    pub(super) filling: Field,
    /// Middle of the biting edge of the upper left central incisor.
    pub(super) upper_incisor: Vec3,
    /// Middle of the biting edge of the lower left central incisor.
    pub(super) lower_incisor: Vec3,
}

/// Both rows.
pub(super) fn teeth() -> Teeth {
    let mut teeth = Teeth {
        crowns: Field::new(REACH_MM),
        dentine: Field::new(REACH_MM),
        pulp: Field::new(REACH_MM),
        filling: Field::new(REACH_MM),
        upper_incisor: Vec3::ZERO,
        lower_incisor: Vec3::ZERO,
    };
    teeth.upper_incisor = teeth.add_row(&UPPER);
    teeth.lower_incisor = teeth.add_row(&LOWER);
    let (molar, along) = stand(&LOWER, LOWER.crowns[..5].iter().map(|c| c.0).sum::<f32>() + 5.5);
    let top = molar + Vec3::new(0.0, 0.0, LOWER.edge_z - 1.2);
    teeth.filling.join(0.0, block(top.into(), [2.6, 3.6, 1.5], 0.8).along(frame(along)));
    teeth
}

impl Teeth {
    /// Adds a row on both sides and returns the edge of its first tooth.
    fn add_row(&mut self, row: &Row) -> Vec3 {
        let (mut from_midline, mut first_edge) = (0.0, Vec3::ZERO);
        for (n, &(width, depth)) in row.crowns.iter().enumerate() {
            let (foot, along) = stand(row, from_midline + width / 2.0);
            from_midline += width;
            self.add_tooth(row, n, foot, frame(along), width, depth);
            if n == 0 {
                first_edge = foot + Vec3::Z * row.edge_z;
            }
        }
        first_edge
    }

    fn add_tooth(&mut self, row: &Row, n: usize, foot: Vec3, frame: Mat3, width: f32, depth: f32) {
        let up = (row.neck_z - row.edge_z).signum(); // from the biting edge to the root
        let at = |u: f32, v: f32, z: f32| <[f32; 3]>::from(foot + frame * Vec3::new(u, v, 0.0) + Vec3::Z * z);
        let (half_width, half_depth) = (width / 2.0 - 0.15, depth / 2.0);
        let height = (row.neck_z - row.edge_z).abs();
        let is_front = n < 3;
        if is_front {
            // A chisel: full width and thin at the edge, narrow and thick at the neck.
            let blade = [half_width, half_depth * 0.5, height * 0.3];
            let middle = row.edge_z + up * blade[2] + if n == 2 { -up * 0.8 } else { 0.0 };
            self.crowns.join_both(0.0, block(at(0.0, 0.3, middle), blade, 1.3).along(frame));
            let swell =
                cone(at(0.0, 0.0, middle), half_width * 0.75, at(0.0, 0.0, row.neck_z), half_width * 0.78);
            self.crowns.join_both(2.5, swell);
        } else {
            let top = row.edge_z + up * (if n < 5 { 1.9 } else { 2.4 });
            let half = [half_width, half_depth, (row.neck_z - top).abs() / 2.0];
            self.crowns.join_both(0.0, block(at(0.0, 0.0, (top + row.neck_z) / 2.0), half, 2.4).along(frame));
            self.add_cusps(n, &at, row.edge_z + up * 2.9, half_width, half_depth);
        }
        self.add_roots(row, n, &at, half_width, half_depth);
        self.pulp
            .join_both(0.0, cone(at(0.0, 0.0, row.neck_z - up * 2.0), 0.9, at(0.0, 0.0, row.tip_z), 0.4));
    }

    fn add_cusps(
        &mut self,
        n: usize,
        at: &dyn Fn(f32, f32, f32) -> [f32; 3],
        z: f32,
        half_width: f32,
        half_depth: f32,
    ) {
        let (along, across) = (if n < 5 { 0.0 } else { half_width * 0.5 }, half_depth * 0.52);
        for (u, v) in [(along, across), (along, -across), (-along, across), (-along, -across)] {
            self.crowns.join_both(0.8, ball(at(u, v, z), 2.0));
        }
    }

    fn add_roots(
        &mut self,
        row: &Row,
        n: usize,
        at: &dyn Fn(f32, f32, f32) -> [f32; 3],
        half_width: f32,
        half_depth: f32,
    ) {
        let up = (row.tip_z - row.neck_z).signum();
        let core = cone(
            at(0.0, 0.0, row.neck_z - up * 4.0),
            half_width * 0.55,
            at(0.0, 0.0, row.neck_z + up * 1.5),
            half_width * 0.78,
        );
        self.dentine.join_both(1.0, core);
        let spread: &[(f32, f32)] =
            if n < 5 { &[(0.0, 0.0)] } else { &[(0.5, 0.3), (-0.5, 0.3), (0.0, -0.5)] };
        let tip = row.tip_z + if n == 2 { up * 3.0 } else { 0.0 };
        for &(u, v) in spread {
            let (u, v) = (u * half_width, v * half_depth);
            let thick = if n < 5 { half_width * 0.72 } else { 2.3 };
            let root = cone(at(u * 0.8, v * 0.8, row.neck_z), thick, at(u, v, tip), 0.9);
            self.dentine.join_both(1.5, root);
        }
    }
}

/// Foot point (z = 0) and direction of the arch at an arc length from the midline, on the left.
fn stand(row: &Row, arc_length: f32) -> (Vec3, Vec3) {
    const STEPS: usize = 4000;
    let [a, b] = row.radii;
    // A quarter of the ellipse and a straight end, walked in small steps.
    let point = |step: usize| {
        let t = step as f32 / STEPS as f32 * 2.4;
        if t < std::f32::consts::FRAC_PI_2 {
            Vec3::new(a * t.sin(), ARCH_Y - b * t.cos(), 0.0)
        } else {
            Vec3::new(a, ARCH_Y + (t - std::f32::consts::FRAC_PI_2) * b, 0.0)
        }
    };
    let mut walked = 0.0;
    for step in 1..STEPS {
        let (here, next) = (point(step - 1), point(step));
        walked += here.distance(next);
        if walked >= arc_length {
            return (next, (next - here).normalize());
        }
    }
    (point(STEPS), Vec3::Y)
}

/// Columns: along the arch, across it, up.
fn frame(along: Vec3) -> Mat3 {
    Mat3::from_cols(along, Vec3::Z.cross(along), Vec3::Z)
}

/// The ridge that carries a row of teeth.
fn tooth_ridge(z: f32, radii: [f32; 2], half_height: f32) -> Solid {
    arch([0.0, ARCH_Y, z], radii, [5.2, half_height], 3.5)
}
