//! The mandible and the bones of the neck.
//!
//! They are kept apart from the skull, so that joints stay open instead of melting together.

use super::super::sdf::{Field, block, cone, ellipsoid};

const REACH_MM: f32 = 5.0;

/// The lower jaw.
pub(super) fn mandible() -> Field {
    let mut bone = Field::new(REACH_MM);
    // The body is a high, narrow bar: cones stretched upwards.
    let bar = [
        [0.0, -85.0, -69.0, 5.0],
        [9.0, -83.5, -69.0, 4.9],
        [20.0, -73.0, -67.5, 4.7],
        [29.0, -56.0, -65.0, 4.6],
        [38.0, -40.0, -61.5, 4.3],
        [45.5, -26.0, -57.0, 3.6],
    ];
    let piece = |w: &[[f32; 4]]| {
        let ([ax, ay, az, ar], [bx, by, bz, br]) = (w[0], w[1]);
        cone([ax, ay, az], ar, [bx, by, bz], br).scaled([1.0, 1.0, 0.42])
    };
    bone.join_all_both(0.0, bar.windows(2).map(piece).collect());
    bone.join_both(7.0, block([47.5, -28.0, -40.0], [3.2, 13.5, 25.0], 3.1).turned(7.0, 4.0, -4.0)); // ramus
    bone.join_both(8.0, ellipsoid([47.5, -24.0, -58.0], [4.5, 9.0, 8.0])); // angle
    bone.join_both(4.0, cone([49.0, -18.0, -20.0], 4.5, [50.0, -15.5, -9.0], 4.0)); // neck of the condyle
    bone.join_both(3.0, ellipsoid([50.0, -15.0, -7.0], [9.0, 4.6, 5.0])); // condyle
    bone.join_both(4.0, cone([47.0, -36.0, -26.0], 6.0, [45.0, -41.0, -5.0], 2.2)); // coronoid process
    bone.join(9.0, ellipsoid([0.0, -86.5, -77.0], [13.0, 6.0, 7.0])); // chin
    bone.join_both(7.0, ellipsoid([11.0, -84.5, -79.0], [7.0, 5.0, 4.5])); // mental tubercles
    bone.join(4.0, super::teeth::lower_ridge());
    bone.cut_both(1.0, cone([32.0, -72.0, -67.0], 1.7, [24.0, -66.0, -67.0], 1.5)); // mental foramen
    bone
}

/// Vertebrae C1 to C6 and the hyoid.
pub(super) fn neck_bones() -> Field {
    let mut bone = Field::new(REACH_MM);
    atlas(&mut bone);
    axis(&mut bone);
    for (body_z, body_y, spine_y) in
        [(-71.5, 17.0, 49.0), (-88.5, 15.5, 48.0), (-105.5, 15.5, 50.0), (-122.5, 17.0, 56.0)]
    {
        vertebra(&mut bone, body_z, body_y, spine_y);
    }
    bone.join_path_both(
        2.0,
        &[[0.0, -42.0, -83.0, 4.0], [13.0, -37.0, -83.0, 3.0], [22.0, -16.0, -79.0, 1.8]],
    );
    bone
}

fn atlas(bone: &mut Field) {
    bone.join_both(0.0, ellipsoid([19.0, 20.0, -33.5], [8.0, 9.5, 6.0]).turned(0.0, -12.0, 0.0));
    bone.join_path_both(3.0, &[[0.0, 6.5, -34.0, 3.6], [9.0, 8.5, -34.0, 3.2], [17.0, 15.0, -34.0, 4.0]]);
    bone.join_path_both(
        3.0,
        &[
            [20.0, 27.0, -33.0, 3.6],
            [17.0, 40.0, -33.0, 3.2],
            [9.0, 48.0, -34.0, 3.2],
            [0.0, 51.0, -34.0, 4.2],
        ],
    );
    bone.join_both(4.0, cone([24.0, 20.0, -34.0], 4.0, [38.0, 22.0, -36.0], 3.4)); // transverse process
}

fn axis(bone: &mut Field) {
    bone.join(1.5, block([0.0, 17.0, -52.5], [9.5, 8.0, 8.5], 3.0));
    bone.join(3.0, cone([0.0, 15.5, -46.0], 5.2, [0.0, 14.5, -25.0], 4.2)); // dens
    bone.join_both(4.0, ellipsoid([16.0, 20.0, -46.0], [8.5, 8.5, 4.5]).turned(0.0, -20.0, 0.0));
    arch_of(bone, -55.0, 60.0, 5.0);
}

fn vertebra(bone: &mut Field, z: f32, y: f32, spine_y: f32) {
    bone.join(1.0, block([0.0, y, z], [10.0, 8.0, 6.2], 2.4));
    bone.join_both(3.0, cone([8.0, y + 2.0, z + 3.0], 3.0, [16.0, y - 1.0, z], 3.2)); // transverse process
    arch_of(bone, z, spine_y, 3.2);
}

/// Pedicles, articular pillars, laminae and the spinous process.
fn arch_of(bone: &mut Field, z: f32, spine_y: f32, spine: f32) {
    bone.join_both(2.5, cone([9.0, 22.0, z + 1.0], 3.4, [18.0, 28.0, z], 4.5));
    bone.join_both(2.5, block([19.5, 29.0, z - 1.0], [5.5, 5.5, 7.2], 3.0).turned(-35.0, 0.0, 0.0));
    bone.join_both(3.0, cone([18.0, 33.0, z - 1.0], 3.2, [3.0, 42.0, z - 4.0], 3.2).scaled([1.0, 1.0, 0.6]));
    bone.join(3.0, cone([0.0, 41.0, z - 4.0], 3.4, [0.0, spine_y, z - 8.0], spine).scaled([1.0, 1.0, 0.75]));
}
