//! Muscles, glands and cartilage, between the fat under the skin and the bones.

use super::super::sdf::{Field, ball, block, cone, ellipsoid};

const REACH_MM: f32 = 2.5;

/// All striated muscle.
pub(super) fn muscles() -> Field {
    let mut muscle = Field::new(REACH_MM);
    chewing(&mut muscle);
    face(&mut muscle);
    neck(&mut muscle);
    muscle
}

fn chewing(muscle: &mut Field) {
    // Temporalis.
    muscle.join_both(0.0, ellipsoid([63.0, -26.0, 36.0], [8.5, 34.0, 37.0]).turned(0.0, 8.0, 0.0));
    muscle.join_both(6.0, cone([58.0, -34.0, 12.0], 8.0, [48.0, -40.0, -10.0], 4.0)); // its tendon's end
    // Masseter.
    muscle.join_both(0.0, block([56.5, -35.0, -34.0], [6.0, 15.0, 28.0], 5.5).turned(-12.0, 2.0, 10.0));
    // Medial pterygoid.
    muscle.join_both(0.0, block([38.0, -28.0, -36.0], [5.0, 12.0, 22.0], 4.5).turned(-10.0, -14.0, 14.0));
    muscle.join_both(0.0, cone([19.0, -38.0, -8.0], 8.5, [44.0, -19.0, -9.0], 4.5)); // lateral pterygoid
}

fn face(muscle: &mut Field) {
    muscle.join(0.0, ellipsoid([0.0, -54.0, -39.0], [21.0, 30.0, 17.0])); // tongue
    muscle.join(5.0, ellipsoid([0.0, -52.0, -60.0], [15.0, 28.0, 18.0])); // its root
    muscle.join_both(0.0, cone([4.5, -82.0, -79.0], 5.0, [6.0, -46.0, -82.0], 5.5)); // geniohyoid, digastric
    // Buccinator.
    muscle.join_both(0.0, cone([31.0, -76.0, -25.0], 4.0, [36.0, -50.0, -36.0], 3.2).scaled([1.0, 1.0, 0.5]));
    muscle.join_path(
        0.0,
        &[
            [-22.0, -90.0, -40.0, 3.5],
            [-10.0, -99.0, -34.0, 4.5],
            [10.0, -99.0, -34.0, 4.5],
            [22.0, -90.0, -40.0, 3.5],
        ],
    );
    muscle.join_path(
        0.0,
        &[
            [-22.0, -90.0, -41.0, 3.5],
            [-10.0, -98.0, -46.0, 4.5],
            [10.0, -98.0, -46.0, 4.5],
            [22.0, -90.0, -41.0, 3.5],
        ],
    );
}

fn neck(muscle: &mut Field) {
    muscle.join_path_both(
        0.0,
        &[
            [56.0, 10.0, -26.0, 6.0],
            [50.0, 0.0, -62.0, 9.5],
            [41.0, -18.0, -98.0, 10.0],
            [31.0, -33.0, -140.0, 9.0],
        ],
    ); // sternocleidomastoid
    muscle.join_path_both(
        0.0,
        &[
            [14.0, 66.0, -14.0, 11.0],
            [13.0, 56.0, -50.0, 13.0],
            [14.0, 55.0, -90.0, 13.0],
            [16.0, 60.0, -140.0, 13.0],
        ],
    ); // semispinalis
    muscle.join_path_both(
        0.0,
        &[
            [38.0, 46.0, -14.0, 9.0],
            [33.0, 50.0, -50.0, 12.0],
            [36.0, 48.0, -90.0, 14.0],
            [42.0, 50.0, -140.0, 16.0],
        ],
    ); // splenius, trapezius
    muscle.join_path_both(
        0.0,
        &[[32.0, 27.0, -44.0, 8.0], [37.0, 26.0, -90.0, 11.0], [42.0, 28.0, -140.0, 13.0]],
    );
    muscle.join_path_both(
        0.0,
        &[[25.0, 12.0, -60.0, 6.0], [29.0, 9.0, -100.0, 9.0], [36.0, 6.0, -140.0, 11.0]],
    );
    // Longus colli.
    muscle.join_path_both(0.0, &[[7.0, 1.0, -24.0, 6.5], [8.0, 2.0, -70.0, 6.0], [9.0, 2.0, -140.0, 7.0]]);
    muscle.join_both(0.0, cone([10.0, 52.0, -34.0], 8.0, [24.0, 38.0, -38.0], 8.0)); // below the occiput
    muscle.join_path_both(
        0.0,
        &[[9.0, -42.0, -88.0, 5.5], [13.0, -43.0, -108.0, 5.5], [12.0, -42.0, -140.0, 6.0]],
    ); // strap
    muscle.join(2.0, block([0.0, -8.0, -70.0], [17.0, 2.2, 60.0], 2.0)); // pharyngeal wall
}

/// Salivary and lacrimal glands, lymphatic tissue, thyroid.
pub(super) fn glands() -> Field {
    let mut gland = Field::new(REACH_MM);
    // Parotid.
    gland.join_both(0.0, ellipsoid([59.0, -13.0, -30.0], [8.0, 11.0, 21.0]).turned(0.0, 6.0, 12.0));
    gland.join_both(0.0, ellipsoid([31.0, -40.0, -80.0], [8.5, 13.0, 9.0])); // submandibular
    gland.join_both(0.0, ellipsoid([47.0, -76.0, 29.0], [3.2, 6.0, 5.0])); // lacrimal
    gland.join_both(0.0, ellipsoid([15.0, -18.0, -38.0], [5.0, 7.0, 11.0])); // palatine tonsil
    gland.join_both(0.0, ellipsoid([16.0, -30.0, -126.0], [8.0, 9.0, 18.0])); // thyroid
    gland.join(0.0, ellipsoid([0.0, -18.5, 27.0], [6.0, 5.0, 4.0])); // pituitary
    gland
}

/// Gristle: larynx, discs between vertebrae, ear and nose.
pub(super) fn cartilage() -> Field {
    let mut gristle = Field::new(REACH_MM);
    gristle.join_path_both(
        0.0,
        &[[0.5, -47.5, -100.0, 2.0], [12.0, -38.0, -101.0, 1.9], [19.0, -22.0, -100.0, 1.8]],
    );
    gristle.join_path_both(
        2.0,
        &[[0.5, -46.0, -107.0, 2.0], [12.0, -37.0, -108.0, 1.9], [17.0, -23.0, -108.0, 1.8]],
    );
    gristle.join_path_both(
        0.0,
        &[
            [0.0, -41.0, -119.0, 2.2],
            [11.0, -34.0, -118.0, 2.4],
            [10.0, -21.0, -115.0, 3.0],
            [0.0, -18.5, -114.0, 3.0],
        ],
    ); // cricoid
    for (y, z) in [(16.5, -63.2), (16.0, -80.0), (15.5, -97.0), (16.0, -114.0), (18.0, -131.0)] {
        gristle.join(0.0, ellipsoid([0.0, y, z], [9.5, 8.0, 3.0]));
    }
    gristle
}

/// Eyes: the ball's surface is a sphere of this centre (left) and radius, mm.
pub(super) const EYE_CENTER: [f32; 3] = [32.0, -78.5, 21.0];
/// Radius of the eyeball with its sclera, mm.
pub(super) const EYE_RADIUS: f32 = 12.2;

/// Centre of the left lens and semi-axes of both, mm.
pub(super) const LENS_CENTER: [f32; 3] = [32.4, -86.1, 21.0];
/// Semi-axes along x, y and z.
pub(super) const LENS_RADII: [f32; 3] = [4.6, 2.3, 4.6];

/// Both eyeballs.
pub(super) fn eyeballs() -> Field {
    let mut eyes = Field::new(3.0);
    eyes.join_both(0.0, ball(EYE_CENTER, EYE_RADIUS));
    eyes
}

/// Both lenses.
pub(super) fn lenses() -> Field {
    let mut lenses = Field::new(REACH_MM);
    lenses.join_both(0.0, ellipsoid(LENS_CENTER, LENS_RADII));
    lenses
}

/// Optic nerves and the muscles that turn the eyes.
pub(super) fn eye_strings() -> Field {
    let mut strings = Field::new(REACH_MM);
    let apex = [14.0, -41.0, 23.0];
    strings.join_path_both(
        0.0,
        &[
            [31.0, -67.0, 21.0, 2.3],
            [25.0, -56.0, 21.5, 2.2],
            [15.0, -42.0, 23.0, 2.0],
            [6.0, -24.0, 29.0, 2.2],
        ],
    );
    for (belly, end, r) in [
        ([20.5, -64.0, 21.0], [21.5, -76.0, 21.0], 2.3), // medial rectus
        ([38.5, -62.0, 21.0], [43.5, -76.0, 21.0], 2.2), // lateral
        ([28.0, -62.0, 31.0], [31.5, -76.0, 33.0], 2.2), // superior
        ([28.5, -62.0, 11.5], [31.5, -76.0, 9.5], 2.3),  // inferior
    ] {
        let points = [(apex, 1.5), (belly, r), (end, 1.2)].map(|([x, y, z], r)| [x, y, z, r]);
        strings.join_path_both(0.5, &points);
    }
    strings
}
