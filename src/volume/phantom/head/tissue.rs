//! The tissue at each place: all parts of the head painted over each other.

use glam::Vec3;

use super::super::noise::gradient_noise;
use super::super::sdf::{Box3, Field, LocalField, ellipsoid, smooth_step};
use super::brain::{Brain, LocalBrain};
use super::cavities::{Cavities, LocalCavities};
use super::edge::Edge;
use super::{face, jaw, skull, soft, teeth, vessels};

pub(super) const AIR_HU: f32 = -1000.0;
pub(super) const SKIN_HU: f32 = 20.0;
pub(super) const FAT_HU: f32 = -98.0;
pub(super) const MUSCLE_HU: f32 = 55.0;
pub(super) const GLAND_HU: f32 = 25.0;
pub(super) const CARTILAGE_HU: f32 = 105.0;
pub(super) const MUCOSA_HU: f32 = 42.0;
pub(super) const CORTICAL_HU: f32 = 1250.0;
pub(super) const CANCELLOUS_HU: f32 = 400.0;
pub(super) const ENAMEL_HU: f32 = 2200.0;
pub(super) const DENTINE_HU: f32 = 1500.0;
pub(super) const PULP_HU: f32 = 100.0;
pub(super) const AMALGAM_HU: f32 = 3000.0;
pub(super) const VITREOUS_HU: f32 = 12.0;
pub(super) const SCLERA_HU: f32 = 55.0;
pub(super) const LENS_HU: f32 = 95.0;
pub(super) const ARTERY_HU: f32 = 320.0;
pub(super) const VEIN_HU: f32 = 230.0;

/// Thickness of cortical bone, mm.
const CORTEX_MM: f32 = 1.7;
const SKIN_MM: f32 = 1.9;

/// Every part of the head.
pub(super) struct Anatomy {
    pub(super) skin: Field,
    pub(super) skull: Field,
    pub(super) mandible: Field,
    pub(super) neck_bones: Field,
    pub(super) cavity: Field,
    pub(super) teeth: teeth::Teeth,
    firm: Field,
    muscles: Field,
    glands: Field,
    cartilage: Field,
    eyeballs: Field,
    lenses: Field,
    eye_strings: Field,
    arteries: Field,
    veins: Field,
    cavities: Cavities,
    brain: Brain,
    seed: u64,
}

/// The parts near a block of voxels.
pub(super) struct LocalAnatomy<'a> {
    skin: LocalField<'a>,
    skull: LocalField<'a>,
    mandible: LocalField<'a>,
    neck_bones: LocalField<'a>,
    cavity: LocalField<'a>,
    crowns: LocalField<'a>,
    dentine: LocalField<'a>,
    pulp: LocalField<'a>,
    filling: LocalField<'a>,
    firm: LocalField<'a>,
    muscles: LocalField<'a>,
    glands: LocalField<'a>,
    cartilage: LocalField<'a>,
    eyeballs: LocalField<'a>,
    lenses: LocalField<'a>,
    eye_strings: LocalField<'a>,
    arteries: LocalField<'a>,
    veins: LocalField<'a>,
    cavities: LocalCavities<'a>,
    brain: LocalBrain<'a>,
    seed: u64,
}

impl Anatomy {
    pub(super) fn new(seed: u64) -> Self {
        let cavity = skull::cavity();
        Self {
            skin: face::skin(),
            skull: skull::skull(),
            mandible: jaw::mandible(),
            neck_bones: jaw::neck_bones(),
            teeth: teeth::teeth(),
            firm: firm(),
            muscles: soft::muscles(),
            glands: soft::glands(),
            cartilage: soft::cartilage(),
            eyeballs: soft::eyeballs(),
            lenses: soft::lenses(),
            eye_strings: soft::eye_strings(),
            arteries: vessels::arteries(&cavity, seed),
            veins: vessels::veins(&cavity, seed),
            cavities: Cavities::new(),
            brain: Brain::new(),
            cavity,
            seed,
        }
    }

    /// The tissues in a region; `None` where there is only air.
    pub(super) fn near(&self, region: &Box3) -> Option<LocalAnatomy<'_>> {
        let skin = self.skin.near(region);
        if skin.is_absent() {
            return None;
        }
        Some(LocalAnatomy {
            skin,
            skull: self.skull.near(region),
            mandible: self.mandible.near(region),
            neck_bones: self.neck_bones.near(region),
            cavity: self.cavity.near(region),
            crowns: self.teeth.crowns.near(region),
            dentine: self.teeth.dentine.near(region),
            pulp: self.teeth.pulp.near(region),
            filling: self.teeth.filling.near(region),
            firm: self.firm.near(region),
            muscles: self.muscles.near(region),
            glands: self.glands.near(region),
            cartilage: self.cartilage.near(region),
            eyeballs: self.eyeballs.near(region),
            lenses: self.lenses.near(region),
            eye_strings: self.eye_strings.near(region),
            arteries: self.arteries.near(region),
            veins: self.veins.near(region),
            cavities: self.cavities.near(region),
            brain: self.brain.near(region),
            seed: self.seed,
        })
    }
}

impl LocalAnatomy<'_> {
    /// Value at a point of the region, without grain.
    pub(super) fn hu(&self, p: Vec3, edge: Edge) -> f32 {
        let skin = self.skin.distance(p);
        let inside = edge.cover(skin);
        if inside <= 0.0 {
            return AIR_HU;
        }
        let cavity = self.cavity.distance(p);
        let skull = self.skull.distance(p);
        let air = if self.cavities.is_absent() { f32::MAX } else { self.cavities.air(p, skull, self.seed) };
        let mut hu = if cavity < -4.0 { MUCOSA_HU } else { self.soft(p, -skin, air, edge) };
        hu = self.bone(hu, p, skull, cavity, air, edge);
        hu = self.teeth(hu, p, edge);
        if air < 4.0 {
            hu = edge.paint(hu, CANCELLOUS_HU, (self.cavities.folds(p) + 1.3).max(air.abs() - 4.0));
            hu = edge.paint(hu, AIR_HU, air);
        }
        if cavity < 2.0 {
            let brain = self.brain.hu(p, cavity, edge, self.seed);
            hu += (brain - hu) * edge.cover(cavity);
        }
        hu = edge.paint(hu, VEIN_HU, self.veins.distance(p));
        hu = edge.paint(hu, ARTERY_HU, self.arteries.distance(p));
        AIR_HU + (hu - AIR_HU) * inside
    }

    /// Label of the organ at a point of the region, of [`super::ORGANS`]; 0 for skin, fat and air
    /// outside.
    pub(super) fn label(&self, p: Vec3) -> u16 {
        let skull = self.skull.distance(p);
        let airways = || !self.cavities.is_absent() && self.cavities.air(p, skull, self.seed) < 0.0;
        let teeth = || self.crowns.distance(p).min(self.dentine.distance(p)) < 0.0;
        match () {
            () if self.skin.distance(p) >= 0.0 => 0,
            // Vessels are thinner than voxels: their partial volume is theirs.
            () if self.arteries.distance(p) < 0.7 => 6,
            () if self.veins.distance(p) < 0.7 => 7,
            () if self.cavity.distance(p) < 0.0 => 5,
            () if airways() => 10,
            () if teeth() => 4,
            // Half a millimetre more than bone's own edge: its partial volume belongs to it.
            () if skull < 0.5 => 1,
            () if self.mandible.distance(p) < 0.5 => 2,
            () if self.neck_bones.distance(p) < 0.5 => 3,
            () if self.eyeballs.distance(p) < 0.0 => 8,
            () if self.muscles.distance(p) < 0.0 => 9,
            () => 0,
        }
    }

    /// Skin, fat, muscle, glands, gristle, eyes.
    fn soft(&self, p: Vec3, depth: f32, air: f32, edge: Edge) -> f32 {
        let lumps = 12.0 * gradient_noise(p * 0.22, self.seed ^ 0xfa7);
        let mut hu = FAT_HU + lumps;
        let below_fat = 3.2 - depth;
        hu = edge.paint(hu, GLAND_HU + lumps, self.glands.distance(p).max(below_fat));
        let muscles = self.muscles.distance(p);
        if muscles < 3.0 {
            let grain = Vec3::new(0.16, 0.16, 0.07); // fibres run mostly along the body
            let strands = 0.7 * gradient_noise(p * grain, self.seed ^ 0x305c);
            hu = edge.paint(hu, MUSCLE_HU + 0.5 * lumps, (muscles + strands).max(below_fat));
        }
        hu = edge.paint(hu, MUCOSA_HU, self.firm.distance(p));
        hu = edge.paint(hu, CARTILAGE_HU, self.cartilage.distance(p));
        hu = edge.paint(hu, MUSCLE_HU, self.eye_strings.distance(p));
        let eye = self.eyeballs.distance(p);
        if eye < 3.0 {
            hu = edge.paint(hu, SCLERA_HU, eye);
            hu = edge.paint(hu, VITREOUS_HU, eye + 1.3);
            hu = edge.paint(hu, LENS_HU, self.lenses.distance(p));
        }
        hu = edge.paint(hu, MUCOSA_HU, air - 1.6);
        edge.paint(hu, SKIN_HU, depth - SKIN_MM)
    }

    /// Cortical bone around marrow, with sutures; open where there is air or brain.
    fn bone(&self, hu: f32, p: Vec3, skull: f32, cavity: f32, air: f32, edge: Edge) -> f32 {
        let solid = skull.min(self.mandible.distance(p)).min(self.neck_bones.distance(p));
        if solid > 2.5 || cavity < -4.0 {
            return hu;
        }
        let rough = 0.25 * gradient_noise(p * 0.13, self.seed ^ 0xb0e);
        let suture = if skull < 2.5 { suture(p, self.seed) } else { 0.0 };
        let surface = (solid + rough + 0.8 * suture).max(0.1 - cavity).max(0.8 - air);
        let sponge = CANCELLOUS_HU + 170.0 * gradient_noise(p * 0.45, self.seed ^ 0x590);
        let marrow = smooth_step(CORTEX_MM - 0.5, CORTEX_MM + 0.7, -surface) * (1.0 - suture);
        let value = CORTICAL_HU + (sponge - CORTICAL_HU) * marrow - 500.0 * suture;
        edge.paint(hu, value, surface)
    }

    fn teeth(&self, mut hu: f32, p: Vec3, edge: Edge) -> f32 {
        let (crown, root) = (self.crowns.distance(p), self.dentine.distance(p));
        if crown.min(root) > 2.0 {
            return hu;
        }
        hu = edge.paint(hu, PULP_HU, root - 0.45); // ligament
        hu = edge.paint(hu, ENAMEL_HU, crown);
        hu = edge.paint(hu, DENTINE_HU, root);
        hu = edge.paint(hu, PULP_HU, self.pulp.distance(p));
        edge.paint(hu, AMALGAM_HU, self.filling.distance(p))
    }
}

/// Depth of the sutures of the vault at a point, 0..1.
fn suture(p: Vec3, seed: u64) -> f32 {
    if p.z < 34.0 {
        return 0.0;
    }
    let wiggle = 2.2 * gradient_noise(p * 0.17, seed ^ 0x507) + 1.3 * gradient_noise(p * 0.5, seed ^ 0x508);
    let coronal = p.y + 22.0 + 0.22 * (118.0 - p.z) + wiggle;
    let lambdoid = (p.z - 92.0 + 0.62 * p.x.abs() + wiggle) * 0.85;
    let in_back = p.y > 42.0;
    let sagittal = p.x + wiggle;
    let on_top = p.y > -24.0 && p.z > 88.0;
    let mut nearest = if p.z > 40.0 && !in_back { coronal.abs() } else { f32::MAX };
    if in_back {
        nearest = nearest.min(lambdoid.abs());
    }
    if on_top {
        nearest = nearest.min(sagittal.abs());
    }
    1.0 - smooth_step(0.3, 1.3, nearest)
}

/// Firm soft tissue without fat: ears, nose, lips, lids.
fn firm() -> Field {
    let mut firm = Field::new(2.5);
    firm.join_both(0.0, ellipsoid([85.0, 8.0, 6.0], [11.0, 22.0, 34.0]));
    firm.join(0.0, ellipsoid([0.0, -108.0, -5.0], [17.0, 12.0, 16.0]));
    firm.join(2.0, ellipsoid([0.0, -101.0, -40.0], [25.0, 8.0, 9.0]));
    firm.join_both(0.0, ellipsoid([32.0, -91.0, 21.0], [15.0, 4.5, 12.0]));
    firm
}
