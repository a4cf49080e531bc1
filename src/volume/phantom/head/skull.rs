//! The skull: vault, base and face, and the inside of the cranial cavity.
//!
//! Model space is patient LPS mm with the origin midway between the ear canals. Parts with x above
//! 0 that are added for `both` sides are given for the patient's left.

use super::super::sdf::{Field, block, cone, ellipsoid};

/// Depth to which a bone's distances must hold: beyond it there is marrow only.
const REACH_MM: f32 = 5.0;
/// From the inner to the outer table, mm.
const VAULT_MM: f32 = 6.5;

/// Vault, base and face as one solid; the cranial cavity is taken away by [`cavity`].
pub(super) fn skull() -> Field {
    let mut bone = Field::new(REACH_MM);
    vault(&mut bone);
    base(&mut bone);
    brow_and_cheek(&mut bone);
    upper_jaw(&mut bone);
    openings(&mut bone);
    spines_and_arches(&mut bone);
    bone
}

/// The ellipsoids of the vault, `shrink` mm inside its outer table.
fn dome(field: &mut Field, shrink: f32) {
    let radii = |r: [f32; 3]| r.map(|v| v - shrink);
    field.join(0.0, ellipsoid([0.0, 8.0, 47.0], radii([66.5, 86.0, 73.0])).turned(8.0, 0.0, 0.0));
    field.join(26.0, ellipsoid([0.0, -33.0, 57.0], radii([54.0, 55.0, 53.0])));
    field.join(26.0, ellipsoid([0.0, 44.0, 40.0], radii([60.0, 48.0, 58.0])));
    field.join_both(30.0, ellipsoid([30.0, 26.0, 65.0], radii([33.0, 42.0, 36.0])));
}

fn vault(bone: &mut Field) {
    dome(bone, 0.0);
    bone.join(16.0, ellipsoid([0.0, 44.0, 4.0], [52.0, 41.0, 29.0]));
    bone.cut(10.0, block([0.0, -92.0, -16.0], [80.0, 56.0, 46.0], 12.0)); // the face hangs below the front
    bone.join_both(10.0, ellipsoid([40.0, -12.0, 17.0], [27.0, 33.0, 26.0])); // middle cranial fossa
}

fn base(bone: &mut Field) {
    bone.join(6.0, block([0.0, -25.0, 12.0], [17.0, 17.0, 13.0], 5.0)); // body of the sphenoid
    bone.join(6.0, cone([0.0, -10.0, 16.0], 9.0, [0.0, 5.0, -16.0], 6.0).scaled([0.75, 1.0, 1.0])); // clivus
    bone.join_both(5.0, cone([60.0, 9.0, 2.0], 12.0, [15.0, -9.0, 8.0], 7.0)); // petrous
    bone.join_both(5.0, cone([55.0, 10.0, -4.0], 12.0, [53.0, 5.0, -27.0], 6.0)); // mastoid process
    bone.join_both(3.0, ellipsoid([14.0, 15.0, -22.0], [6.0, 10.0, 5.5]).turned(0.0, 0.0, -25.0)); // condyles
    bone.join(6.0, ellipsoid([0.0, 85.0, -1.0], [9.0, 7.0, 5.0])); // external occipital protuberance
    // Nuchal line.
    bone.join_path_both(4.0, &[[0.0, 86.0, 0.0, 2.5], [25.0, 80.0, 4.0, 2.2], [45.0, 60.0, 3.0, 1.5]]);
    bone.join_both(2.0, cone([47.0, -1.0, -14.0], 3.0, [40.0, -14.0, -46.0], 1.1)); // styloid process
    // Pterygoid.
    bone.join_both(4.0, block([13.5, -34.0, -16.0], [1.8, 7.0, 17.0], 1.5).turned(0.0, 0.0, -15.0));
    // Greater wing.
    bone.join_both(6.0, block([38.5, -55.0, 20.0], [2.6, 21.0, 17.0], 2.4).turned(0.0, 0.0, 44.0));
    bone.join(8.0, block([0.0, -58.0, 18.0], [14.0, 30.0, 17.0], 10.0)); // ethmoid
}

fn brow_and_cheek(bone: &mut Field) {
    bone.join(7.0, ellipsoid([0.0, -87.0, 43.0], [14.0, 6.5, 9.0])); // glabella
    bone.join_path_both(
        7.0,
        &[
            [8.0, -88.0, 42.0, 5.0],
            [26.0, -87.5, 42.5, 5.0],
            [42.0, -80.5, 39.5, 5.0],
            [51.0, -70.0, 31.0, 5.0],
        ],
    );
    bone.join_path_both(
        5.0,
        &[
            [51.0, -71.0, 31.0, 5.0],
            [52.0, -69.0, 19.0, 4.3],
            [51.0, -71.0, 7.0, 5.5],
            [46.0, -74.0, 0.0, 7.0],
        ],
    );
    bone.join_both(6.0, ellipsoid([45.0, -70.0, -6.0], [12.0, 10.0, 10.0]).turned(0.0, 0.0, -35.0)); // zygoma
    bone.join_path_both(
        5.0,
        &[
            [46.0, -76.0, 1.0, 5.0],
            [33.0, -83.0, -1.0, 4.6],
            [21.0, -86.0, 4.0, 4.2],
            [14.0, -88.0, 14.0, 4.0],
        ],
    );
    // Frontal process of the maxilla.
    bone.join_both(4.0, cone([13.0, -88.0, 2.0], 5.0, [8.5, -89.0, 35.0], 4.0));
}

fn upper_jaw(bone: &mut Field) {
    bone.join_both(8.0, ellipsoid([27.0, -65.0, -8.0], [17.0, 20.0, 18.0]));
    bone.join(6.0, ellipsoid([0.0, -76.0, -20.0], [22.0, 14.0, 8.0]));
    bone.join_both(6.0, ellipsoid([14.0, -77.0, -15.0], [15.0, 10.5, 13.0]));
    bone.join_both(4.0, cone([17.5, -81.0, -30.0], 4.0, [14.5, -85.5, -4.0], 3.6)); // over the canine's root
    bone.join(5.0, super::teeth::upper_ridge());
    bone.join(4.0, block([0.0, -64.0, -15.5], [24.0, 24.0, 2.4], 2.0)); // palate
}

fn openings(bone: &mut Field) {
    // Orbits: cones whose axes diverge forwards; the opening is wider than high.
    bone.cut_both(3.0, cone([35.5, -90.0, 20.5], 20.0, [12.0, -38.0, 23.0], 3.5).scaled([1.0, 1.0, 1.08]));
    bone.cut_both(2.0, cone([13.0, -36.0, 23.0], 3.0, [9.0, -22.0, 25.0], 2.5)); // optic canal
    bone.cut_both(1.5, cone([27.0, -90.0, 39.0], 1.8, [28.0, -86.0, 36.5], 1.8)); // supraorbital notch
    bone.cut_both(1.5, cone([29.0, -92.0, -9.0], 2.0, [28.5, -82.5, -7.0], 1.5)); // infraorbital foramen
    // Piriform aperture: narrow above, wide below.
    let shallow = [1.0, 0.42, 1.0];
    bone.cut_both(3.0, cone([1.5, -97.0, 12.0], 3.4, [5.0, -93.0, -6.0], 6.6).scaled(shallow));
    bone.cut(4.0, ellipsoid([0.0, 24.0, -22.0], [14.0, 17.5, 16.0])); // foramen magnum
    bone.cut(3.0, ellipsoid([0.0, -19.0, 27.0], [7.5, 6.5, 6.5])); // sella turcica
    bone.cut_both(4.0, ellipsoid([50.0, -15.0, -8.0], [12.0, 8.5, 10.5])); // fossa of the jaw joint
    bone.cut_path_both(1.0, &super::cavities::EAR_CANAL);
}

fn spines_and_arches(bone: &mut Field) {
    // Nasal bones.
    bone.join_both(2.5, cone([2.6, -89.0, 37.0], 4.3, [3.6, -100.0, 17.5], 2.6).scaled([0.58, 1.0, 1.0]));
    bone.join(2.0, cone([0.0, -84.0, -16.5], 3.4, [0.0, -95.0, -16.0], 1.9)); // anterior nasal spine
    bone.join(2.0, block([0.0, -9.5, 28.0], [8.0, 2.2, 5.0], 1.8)); // dorsum sellae
    bone.join_both(2.0, cone([9.0, -29.0, 27.0], 2.6, [10.0, -22.0, 29.5], 1.7)); // anterior clinoid
    bone.join_path_both(
        4.0,
        &[
            [50.0, -67.0, -4.0, 5.5],
            [59.0, -55.0, -3.0, 3.8],
            [65.5, -38.0, -1.0, 3.0],
            [66.5, -22.0, 2.0, 3.0],
            [62.0, -7.0, 5.5, 4.0],
            [60.0, 4.0, 7.0, 4.0],
        ],
    );
}

/// The cranial cavity: everything inside the inner table.
pub(super) fn cavity() -> Field {
    let mut cavity = Field::new(30.0);
    dome(&mut cavity, VAULT_MM);
    cavity.join(14.0, ellipsoid([0.0, 43.0, 5.0], [46.0, 35.5, 26.0])); // posterior fossa
    cavity.cut(8.0, block([0.0, -92.0, -5.0], [80.0, 58.0, 38.0], 9.0)); // the roof of the nose
    // The roofs of the orbits.
    cavity.cut_both(6.0, cone([35.5, -90.0, 20.5], 23.0, [12.0, -38.0, 22.0], 8.0));
    cavity.join_both(8.0, ellipsoid([39.0, -11.0, 18.0], [22.5, 27.5, 20.5])); // middle fossa
    cavity.cut(5.0, block([0.0, -25.0, 8.0], [14.0, 18.0, 15.0], 4.0)); // sphenoid
    cavity.cut(4.0, cone([0.0, -10.0, 16.0], 8.0, [0.0, 5.0, -18.0], 6.0).scaled([0.75, 1.0, 1.0])); // clivus
    cavity.cut_both(5.0, cone([62.0, 9.0, 1.0], 11.0, [16.0, -8.0, 8.0], 6.0)); // petrous ridges
    cavity.join(5.0, ellipsoid([0.0, -19.0, 27.0], [7.0, 6.0, 6.0])); // the pituitary's place
    cavity.cut(1.5, block([0.0, -9.5, 26.0], [8.0, 2.0, 6.0], 1.8));
    cavity.join(4.0, cone([0.0, 24.0, -8.0], 14.0, [0.0, 26.0, -34.0], 10.0)); // foramen magnum
    // Canal.
    cavity.join_path(4.0, &[[0.0, 26.0, -30.0, 9.5], [0.0, 29.0, -70.0, 8.5], [0.0, 27.0, -140.0, 8.5]]);
    cavity
}
