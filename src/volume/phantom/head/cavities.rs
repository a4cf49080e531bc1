//! Air inside the head: sinuses, nose, mouth, throat, ears; and the walls in the nose.
//!
//! Left and right differ, as they do in people.

use glam::Vec3;

use super::super::noise::{cell_distances, gradient_noise};
use super::super::sdf::{Box3, Field, LocalField, ball, block, cone, ellipsoid};

/// The bony and gristly ear canal on the left, from the concha to the drum.
pub(super) const EAR_CANAL: [[f32; 4]; 4] =
    [[79.0, -2.0, 0.5, 4.0], [68.0, 0.5, 2.0, 3.4], [58.0, -1.0, 2.0, 3.2], [47.0, -3.5, 0.5, 3.4]];

/// Bone between a sinus and the outside of the skull, mucosa included, mm.
const WALL_MM: f32 = 2.8;

/// Air and the tissue that divides it.
pub(super) struct Cavities {
    /// Nose, throat, mouth, ear canals: open to the outside.
    air: Field,
    /// Sinuses: closed in by bone all round.
    sinuses: Field,
    /// Septum, conchae: mucosa over thin bone.
    folds: Field,
    /// The region of the mastoid cells.
    mastoid: Field,
}

/// The part of [`Cavities`] near a block of voxels.
pub(super) struct LocalCavities<'a> {
    air: LocalField<'a>,
    sinuses: LocalField<'a>,
    folds: LocalField<'a>,
    mastoid: LocalField<'a>,
}

impl Cavities {
    pub(super) fn new() -> Self {
        let mut air = Field::new(4.0);
        nose_and_throat(&mut air);
        air.join_path_both(0.0, &EAR_CANAL);
        air.join_both(1.0, ellipsoid([43.5, -3.0, 3.0], [3.0, 4.5, 6.0])); // middle ear
        let mut mastoid = Field::new(3.0);
        mastoid.join_both(4.0, ellipsoid([57.0, 10.0, -9.0], [8.0, 9.0, 14.0]));
        mastoid.join_both(4.0, ellipsoid([53.0, 9.0, 7.0], [11.0, 7.0, 6.0]));
        mastoid.cut_both(1.0, cone([79.0, 0.0, 1.0], 6.0, [47.0, -3.0, 1.0], 6.0));
        Self { air, sinuses: sinuses(), folds: folds(), mastoid }
    }

    pub(super) fn near(&self, region: &Box3) -> LocalCavities<'_> {
        LocalCavities {
            air: self.air.near(region),
            sinuses: self.sinuses.near(region),
            folds: self.folds.near(region),
            mastoid: self.mastoid.near(region),
        }
    }
}

impl LocalCavities<'_> {
    /// Whether there is no air near.
    pub(super) fn is_absent(&self) -> bool {
        self.air.is_absent() && self.sinuses.is_absent() && self.mastoid.is_absent()
    }

    /// Signed distance to air, mm, at a signed distance from the solid skull: walls of bone stay
    /// around sinuses.
    pub(super) fn air(&self, p: Vec3, skull: f32, seed: u64) -> f32 {
        let (open, closed) = (self.air.distance(p), self.sinuses.distance(p));
        let ripple =
            if open.min(closed).abs() < 4.0 { 0.5 * gradient_noise(p * 0.16, seed ^ 0x0a1) } else { 0.0 };
        let mut air =
            (open + ripple).min((closed + ripple).max(skull + WALL_MM)).max(-self.folds.distance(p));
        let mastoid = self.mastoid.distance(p).max(skull + WALL_MM);
        if mastoid < 2.0 {
            let (first, second) = cell_distances(p / 4.2, seed ^ 0x3a57);
            let walls = 0.9 - 2.1 * (second - first);
            air = air.min(walls.max(mastoid));
        }
        air
    }

    /// Signed distance to the folds that stand in the nose, mm.
    pub(super) fn folds(&self, p: Vec3) -> f32 {
        self.folds.distance(p)
    }
}

fn sinuses() -> Field {
    let mut air = Field::new(4.0);
    air.join(0.0, ellipsoid([29.0, -65.0, -6.0], [15.0, 17.5, 16.0]).turned(0.0, 0.0, -8.0));
    air.join(0.0, ellipsoid([-28.5, -64.5, -6.0], [14.5, 17.0, 15.5]).turned(0.0, 0.0, 8.0));
    air.join_both(3.0, ellipsoid([22.0, -66.0, -14.0], [8.0, 10.0, 5.5])); // alveolar recess
    air.join(0.0, ellipsoid([11.5, -87.5, 46.0], [10.5, 3.6, 9.0]));
    air.join(2.0, ellipsoid([21.0, -87.0, 45.0], [8.0, 3.0, 5.0]));
    air.join(0.0, ellipsoid([-8.5, -88.0, 44.0], [7.0, 3.4, 7.0]));
    air.join(0.0, ellipsoid([7.5, -27.0, 11.5], [7.0, 11.5, 9.0]));
    air.join(0.0, ellipsoid([-6.5, -27.5, 10.5], [5.5, 10.5, 7.5]));
    for (n, y) in [-75.0f32, -66.5, -58.0, -49.5, -42.0].into_iter().enumerate() {
        let odd = (n % 2) as f32;
        air.join(0.0, ball([8.3 + 0.4 * odd, y, 26.0 - odd], 4.1));
        air.join(0.0, ball([-8.0 - 0.5 * odd, y + 2.0, 25.0 + odd], 4.0));
        air.join_both(0.0, ball([9.0 - 0.4 * odd, y + 1.0, 17.0 + odd], 3.7));
    }
    air
}

fn nose_and_throat(air: &mut Field) {
    air.join_both(0.0, block([7.5, -64.0, 1.0], [6.3, 24.0, 13.0], 4.5)); // nasal cavity
    air.join_both(3.0, block([4.0, -68.0, 14.0], [2.8, 19.0, 14.0], 2.5)); // its narrow roof
    air.join_both(4.0, cone([5.5, -101.0, -6.0], 4.4, [6.0, -86.0, -4.0], 6.0)); // vestibule
    air.join_both(2.0, cone([6.2, -110.0, -16.5], 3.9, [5.6, -102.0, -6.0], 4.0)); // nostril
    air.join_both(4.0, cone([7.0, -42.0, -2.0], 6.5, [4.0, -30.0, -8.0], 8.0)); // choana
    air.join(5.0, ellipsoid([0.0, -24.0, -10.0], [15.0, 8.0, 10.0])); // nasopharynx
    air.join_path(
        4.0,
        &[
            [0.0, -20.0, -14.0, 7.0],
            [0.0, -14.0, -36.0, 6.0],
            [0.0, -13.0, -58.0, 7.0],
            [0.0, -17.0, -80.0, 8.0],
            [0.0, -26.0, -96.0, 5.0],
            [0.0, -30.0, -108.0, 5.0],
            [0.0, -31.0, -120.0, 8.0],
            [0.0, -30.0, -145.0, 8.5],
        ],
    );
    air.join(3.0, ellipsoid([0.0, -54.0, -20.6], [19.0, 27.0, 2.4])); // between tongue and palate
    air.join(3.0, cone([0.0, -30.0, -21.0], 2.6, [0.0, -19.0, -30.0], 3.0));
    air.cut(1.5, cone([0.0, -36.0, -17.5], 3.4, [0.0, -21.0, -29.0], 2.6)); // soft palate
    // Epiglottis.
    air.cut(1.0, cone([0.0, -30.0, -78.0], 2.0, [0.0, -20.0, -66.0], 1.3).scaled([0.35, 1.0, 1.0]));
}

fn folds() -> Field {
    let mut folds = Field::new(3.0);
    folds.join_path(
        0.0,
        &[[0.0, -100.0, 2.0, 1.1], [0.8, -84.0, 3.0, 1.2], [1.6, -66.0, 3.0, 1.2], [0.0, -40.0, 3.0, 1.3]],
    );
    // The septum: the curve above, drawn out into a sheet.
    folds.join(1.0, block([0.4, -68.0, 6.0], [1.2, 33.0, 26.0], 1.0));
    // Inferior concha.
    folds.join_both(0.0, cone([9.5, -82.0, -7.0], 2.4, [9.5, -46.0, -7.5], 3.0).scaled([1.0, 1.0, 0.75]));
    folds.join_both(2.0, cone([13.5, -82.0, -3.0], 1.6, [13.5, -46.0, -3.0], 1.6)); // its root
    // Middle concha.
    folds.join_both(0.0, cone([7.5, -77.0, 5.0], 1.8, [7.5, -46.0, 4.0], 2.4).scaled([1.0, 1.0, 0.7]));
    folds.join_both(1.5, cone([11.0, -77.0, 9.0], 1.4, [11.0, -46.0, 8.0], 1.4));
    folds.join_both(0.0, cone([5.0, -62.0, 15.0], 1.2, [5.0, -44.0, 14.0], 1.5)); // superior
    folds
}
