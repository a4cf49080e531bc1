//! D(Z) against the published constants and numbers, its closed form, and its inverse.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, its helpers too")]

use proptest::prelude::*;
use relief_base::{Disparity, ScaledDepth};
use relief_display::{DisparityConstants, DisplayProfile, ProfileError, ProfileName};

fn profile(constants: DisparityConstants) -> DisplayProfile {
    DisplayProfile::new([1920, 1080], [960, 540], constants).unwrap()
}

fn disparity(profile: &DisplayProfile, z: f64) -> f64 {
    profile.disparity(ScaledDepth(z)).0
}

/// Numbers of the two Philips displays at a quarter, half and three quarters of the depth range,
/// and their ends.
#[test]
fn named_displays_have_the_published_disparities() {
    for (name, zd, at_quarters) in [
        (ProfileName::Philips20, 0.459_813, [183.2423, 117.2523, 56.3614]),
        (ProfileName::Philips42, 0.467_481, [184.8218, 119.2076, 57.7265]),
    ] {
        let profile = DisplayProfile::named(name);
        for (z, d) in [0.25, 0.5, 0.75].into_iter().zip(at_quarters) {
            assert!((disparity(&profile, z) - d).abs() < 1e-4, "{} at {z}", name.name());
        }
        // The constants are published with six digits, so the ends are met to three.
        for (z, d) in [(0.0, 255.0), (zd, 127.5), (1.0, 0.0)] {
            assert!((disparity(&profile, z) - d).abs() < 1e-3, "{} at {z}", name.name());
        }
        assert_eq!(profile.disparity(ScaledDepth(0.0)).to_byte(), 255);
        assert_eq!(profile.disparity(ScaledDepth(1.0)).to_byte(), 0);
        assert_eq!((profile.frame_px(), profile.sub_image_px()), ([1920, 1080], [960, 540]));
    }
}

#[test]
fn the_family_gives_the_published_constants_from_the_viewing_distance_alone() {
    for published in [DisparityConstants::PHILIPS_20, DisparityConstants::PHILIPS_42] {
        let derived = DisparityConstants::from_viewing_distance(published.vz).unwrap();
        assert!((derived.zd - published.zd).abs() < 1e-6, "{derived:?}");
        assert!((derived.m - published.m).abs() < 1e-2, "{derived:?}");
        assert_eq!(derived.c, published.c);
    }
}

#[test]
fn the_4k_display_is_of_the_family_and_has_its_own_frame() {
    let profile = DisplayProfile::named(ProfileName::Dimenco4k);
    assert_eq!((profile.frame_px(), profile.sub_image_px()), ([3840, 2160], [1920, 2160]));
    let constants = profile.constants();
    assert_eq!(constants, DisparityConstants::from_viewing_distance(constants.vz).unwrap());
}

#[test]
fn values_outside_the_range_are_clamped() {
    let profile = DisplayProfile::named(ProfileName::Philips42);
    for (z, inside) in
        [(-3.0, 0.0), (-1e300, 0.0), (1.5, 1.0), (f64::INFINITY, 1.0), (f64::NEG_INFINITY, 0.0)]
    {
        assert_eq!(profile.disparity(ScaledDepth(z)), profile.disparity(ScaledDepth(inside)), "{z}");
    }
    assert_eq!(profile.scaled_depth(Disparity(300.0)), profile.scaled_depth(Disparity(255.0)));
    assert_eq!(profile.scaled_depth(Disparity(-1.0)), profile.scaled_depth(Disparity(0.0)));
}

#[test]
fn constants_that_no_display_can_have_are_refused() {
    let good = DisparityConstants::PHILIPS_42;
    let refused = |constants: DisparityConstants| constants.checked().unwrap_err();
    for vz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(refused(DisparityConstants { vz, ..good }), ProfileError::ViewingDistance(_)));
        assert!(DisparityConstants::from_viewing_distance(vz).is_err());
    }
    for zd in [0.0, 1.0, f64::NAN] {
        assert!(matches!(refused(DisparityConstants { zd, ..good }), ProfileError::DisplayPlane(_)));
    }
    let inside = DisparityConstants { zd: 0.5, vz: 0.4, ..good };
    assert_eq!(refused(inside), ProfileError::ViewerInside { vz: 0.4, zd: 0.5 });
    for m in [0.0, 10.0, f64::NEG_INFINITY] {
        assert!(matches!(refused(DisparityConstants { m, ..good }), ProfileError::Slope(_)));
    }
    assert!(matches!(refused(DisparityConstants { c: 256.0, ..good }), ProfileError::ScreenDisparity(_)));
    assert!(matches!(
        DisplayProfile::new([0, 1080], [960, 540], good),
        Err(ProfileError::Size { what: "frame_px", .. })
    ));
}

proptest! {
    /// D(0) = 255, D(Zd) = 127.5 and D(1) = 0 for every viewing distance, and D falls in between.
    #[test]
    fn every_member_of_the_family_meets_its_three_points(vz in 0.1f64..1000.0, z in 0.0f64..0.99) {
        let constants = DisparityConstants::from_viewing_distance(vz).unwrap();
        let profile = profile(constants);
        prop_assert!((disparity(&profile, 0.0) - 255.0).abs() < 1e-9);
        prop_assert!((disparity(&profile, constants.zd) - 127.5).abs() < 1e-9);
        prop_assert!(disparity(&profile, 1.0).abs() < 1e-9);
        prop_assert!(disparity(&profile, z) > disparity(&profile, z + 0.01));
    }

    #[test]
    fn the_inverse_gives_scaled_depth_back(vz in 0.1f64..1000.0, z in 0.0f64..=1.0) {
        let profile = profile(DisparityConstants::from_viewing_distance(vz).unwrap());
        let back = profile.scaled_depth(profile.disparity(ScaledDepth(z))).0;
        prop_assert!((back - z).abs() < 1e-9, "{z} became {back}");
    }

    /// The parallax in eye separations is (D - C) / M, and also (Z - Zd) / (Z - Zd + vz) by similar
    /// triangles.
    #[test]
    fn disparity_is_the_parallax_of_similar_triangles(z in 0.0f64..=1.0) {
        let constants = DisparityConstants::from_viewing_distance(7.0).unwrap();
        let DisparityConstants { zd, vz, m, c } = constants;
        let parallax = (disparity(&profile(constants), z) - c) / m;
        prop_assert!((parallax - (z - zd) / (z - zd + vz)).abs() < 1e-12);
    }
}
