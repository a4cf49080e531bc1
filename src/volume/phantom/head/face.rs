//! The skin: head, face, ears and neck as one solid.

use glam::{Mat3, Vec3};

use super::super::sdf::{Field, cone, ellipsoid};
use super::soft::EYE_CENTER;

/// Skin and the fat beneath it count: distances hold to this depth, mm.
pub(super) const REACH_MM: f32 = 14.0;

/// The solid inside the skin.
pub(super) fn skin() -> Field {
    let mut skin = Field::new(REACH_MM);
    head(&mut skin);
    jaw_and_neck(&mut skin);
    eyes(&mut skin);
    nose(&mut skin);
    mouth(&mut skin);
    ear(&mut skin);
    skin
}

fn head(skin: &mut Field) {
    skin.join(0.0, ellipsoid([0.0, 8.0, 47.0], [72.5, 92.5, 79.5]).turned(8.0, 0.0, 0.0));
    skin.join(26.0, ellipsoid([0.0, -33.0, 57.0], [60.5, 61.0, 59.5]));
    skin.join(26.0, ellipsoid([0.0, 44.0, 40.0], [66.0, 54.0, 64.0]));
    skin.join_both(30.0, ellipsoid([30.0, 26.0, 65.0], [39.0, 48.0, 42.0]));
    skin.join(20.0, ellipsoid([0.0, 46.0, 2.0], [60.0, 46.0, 38.0]));
    skin.join_both(16.0, ellipsoid([50.0, 10.0, -14.0], [24.0, 26.0, 26.0])); // behind the ear
    skin.join_both(20.0, ellipsoid([50.0, -26.0, 10.0], [22.5, 42.0, 44.0])); // temples
    skin.join_both(16.0, ellipsoid([44.0, -62.0, 26.0], [15.0, 19.0, 24.0])); // beside the eyes
    skin.join(24.0, ellipsoid([0.0, -46.0, -10.0], [60.0, 47.0, 56.0])); // middle of the face
    skin.join_both(16.0, ellipsoid([44.0, -66.0, -4.0], [19.0, 18.0, 16.0])); // cheekbones
    skin.join_both(18.0, ellipsoid([34.0, -64.0, -30.0], [21.0, 25.0, 26.0])); // cheeks
    skin.join_path_both(
        18.0,
        &[
            [0.0, -90.5, 41.0, 4.5],
            [20.0, -90.5, 42.0, 4.2],
            [36.0, -84.5, 41.5, 4.0],
            [48.0, -73.0, 35.0, 4.0],
        ],
    );
}

fn jaw_and_neck(skin: &mut Field) {
    skin.join_both(22.0, ellipsoid([43.0, -36.0, -40.0], [19.5, 30.0, 32.0])); // masseter and angle
    skin.join(18.0, ellipsoid([0.0, -74.0, -36.0], [33.0, 28.0, 26.0])); // over the teeth
    // Body of the jaw.
    skin.join_both(18.0, ellipsoid([20.0, -65.0, -60.0], [21.0, 23.0, 20.0]).turned(0.0, 0.0, -25.0));
    skin.join(14.0, ellipsoid([0.0, -86.5, -76.0], [17.0, 14.5, 13.5])); // chin
    skin.join(20.0, ellipsoid([0.0, -47.0, -67.0], [34.0, 42.0, 18.0])); // floor of the mouth
    let neck = cone([0.0, 20.0, -10.0], 51.0, [0.0, 12.0, -150.0], 60.0).scaled([1.0, 0.97, 1.0]);
    skin.join(24.0, neck);
    skin.join_both(20.0, ellipsoid([30.0, 44.0, -120.0], [38.0, 34.0, 50.0])); // trapezius
    skin.join(8.0, ellipsoid([0.0, -43.0, -104.0], [9.0, 9.0, 13.0])); // Adam's apple
    skin.join_path_both(
        16.0,
        &[
            [52.0, 8.0, -30.0, 8.0],
            [47.0, -6.0, -66.0, 9.0],
            [37.0, -24.0, -105.0, 9.0],
            [28.0, -38.0, -145.0, 8.0],
        ],
    );
}

fn eyes(skin: &mut Field) {
    let [x, y, z] = EYE_CENTER;
    skin.cut_both(11.0, ellipsoid([x - 1.0, y - 27.0, z + 1.5], [16.0, 14.0, 11.0]));
    skin.cut_both(8.0, ellipsoid([16.5, -101.0, 24.5], [4.0, 8.0, 6.0])); // inner corner, beside the bridge
    skin.join_both(3.5, ellipsoid([x, y - 0.2, z - 0.2], [14.6, 14.2, 13.2])); // closed lids
    let lid = |dz: f32, dy: f32, r: f32| {
        [-13.0f32, -6.5, 0.0, 6.5, 13.0].map(|dx| {
            let sag = dz * (1.0 - dx * dx / 190.0);
            let front = (14.4f32 * 14.4 - dx * dx - (sag - 0.2) * (sag - 0.2)).max(20.0).sqrt();
            [x + dx, y - front + dy, z + sag - 1.0, r]
        })
    };
    skin.cut_path_both(0.9, &lid(-5.0, -0.35, 0.75)); // between the lids
    skin.cut_path_both(1.6, &lid(6.8, 0.4, 0.8)); // crease of the upper lid
    skin.join_path_both(1.6, &lid(-3.9, 0.9, 1.2)); // the upper lid's margin
}

fn nose(skin: &mut Field) {
    skin.join(8.0, cone([0.0, -91.0, 34.0], 5.5, [0.0, -104.0, 16.0], 6.3));
    skin.join(5.0, cone([0.0, -103.0, 17.0], 5.8, [0.0, -115.0, -1.5], 7.2));
    skin.join_both(9.0, cone([5.0, -90.0, 30.0], 6.0, [8.5, -101.0, 2.0], 7.5)); // sides
    skin.join(5.0, ellipsoid([0.0, -115.5, -4.0], [8.6, 7.4, 7.2])); // tip
    skin.join_both(5.0, ellipsoid([10.4, -104.0, -6.5], [6.8, 9.6, 6.8]).turned(16.0, 0.0, 12.0)); // wings
    skin.join(5.0, cone([0.0, -111.5, -10.5], 3.4, [0.0, -101.0, -15.0], 4.0)); // columella
    skin.join_both(16.0, ellipsoid([15.0, -86.0, 2.0], [12.0, 10.0, 16.0])); // flanks
    skin.cut_both(1.8, cone([6.4, -111.0, -18.0], 3.2, [5.6, -102.0, -6.0], 3.0).scaled([1.15, 0.85, 1.0]));
    skin.cut_path_both(
        2.5,
        &[
            [14.5, -109.5, -0.5, 0.5],
            [17.2, -104.5, -0.5, 0.7],
            [18.6, -99.5, -6.0, 0.9],
            [16.8, -98.5, -12.0, 0.8],
        ],
    );
    skin.cut_path_both(
        10.0,
        &[[20.0, -100.0, -9.0, 0.5], [27.0, -97.0, -24.0, 0.7], [33.5, -97.0, -41.0, 0.4]],
    );
}

fn mouth(skin: &mut Field) {
    skin.join(18.0, ellipsoid([0.0, -87.5, -29.0], [26.0, 14.0, 14.0])); // upper lip's skin
    skin.join(12.0, ellipsoid([0.0, -88.0, -49.0], [22.0, 13.0, 11.0]));
    skin.cut(5.0, cone([0.0, -108.0, -20.0], 0.6, [0.0, -107.8, -31.0], 1.3)); // philtrum
    skin.cut(9.0, ellipsoid([0.0, -109.0, -59.0], [22.0, 7.0, 4.5])); // above the chin
    // Lips: an upper one with a bow, a fuller lower one, and the line between them.
    skin.join_path_both(
        2.4,
        &[
            [0.0, -104.8, -36.4, 2.8],
            [5.0, -105.0, -35.2, 3.3],
            [13.0, -100.4, -37.0, 2.8],
            [25.0, -88.5, -39.4, 1.6],
        ],
    );
    skin.join_path_both(
        2.8,
        &[
            [0.0, -103.4, -45.0, 4.2],
            [8.0, -102.4, -44.8, 3.9],
            [16.0, -97.8, -43.0, 2.9],
            [25.0, -88.5, -40.0, 1.6],
        ],
    );
    skin.cut_path_both(
        1.6,
        &[
            [0.0, -108.4, -40.2, 0.9],
            [8.0, -107.2, -40.0, 0.9],
            [16.0, -102.4, -40.2, 0.9],
            [24.0, -95.6, -39.8, 0.8],
        ],
    );
}

/// The left ear's own axes: back, up, out of its plane.
fn ear_point(back: f32, up: f32, out: f32) -> [f32; 3] {
    let (origin, axes) = (Vec3::new(75.0, 0.0, 2.0), ear_axes());
    (origin + axes * Vec3::new(back, up, out)).into()
}

fn ear_axes() -> Mat3 {
    let back = Vec3::new(0.52, 0.84, -0.14).normalize();
    let out = back.cross(Vec3::new(0.05, 0.2, 0.98)).normalize();
    Mat3::from_cols(back, out.cross(back), out)
}

fn ear_tube(points: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let place = |&[back, up, out, r]: &[f32; 4]| {
        let [x, y, z] = ear_point(back, up, out);
        [x, y, z, r]
    };
    points.iter().map(place).collect()
}

fn ear(skin: &mut Field) {
    let plate = |back, up, out, radii: [f32; 3]| ellipsoid(ear_point(back, up, out), radii).along(ear_axes());
    skin.join_both(4.0, plate(9.0, 7.0, 1.0, [13.0, 23.0, 2.6]));
    skin.join_both(4.0, plate(4.5, -18.0, 1.5, [6.5, 9.0, 2.8])); // lobule
    skin.join_both(8.0, plate(3.0, 0.0, -5.0, [7.0, 13.0, 8.0])); // root
    let rim = [
        [0.0, 2.0, 1.5, 1.8],
        [-3.0, 12.0, 3.0, 2.3],
        [0.0, 24.0, 3.5, 2.6],
        [9.0, 30.5, 4.0, 2.7],
        [18.5, 25.0, 4.0, 2.7],
        [21.5, 13.0, 4.0, 2.5],
        [18.5, 0.0, 3.5, 2.3],
        [12.5, -11.0, 3.0, 2.2],
        [8.0, -18.0, 2.5, 2.6],
    ];
    skin.join_path_both(1.8, &ear_tube(&rim)); // helix
    skin.join_path_both(
        2.2,
        &ear_tube(&[
            [8.0, -8.0, 3.4, 1.9],
            [13.5, 0.0, 3.8, 2.0],
            [13.0, 10.0, 3.8, 2.0],
            [7.0, 20.0, 3.0, 1.6],
        ]),
    );
    skin.cut_both(2.5, plate(4.5, 0.0, 4.5, [7.0, 9.0, 5.5])); // concha
    skin.join_both(2.0, plate(-3.0, -2.0, 3.5, [3.0, 4.0, 2.4])); // tragus
    skin.cut_path_both(1.0, &super::cavities::EAR_CANAL);
}
