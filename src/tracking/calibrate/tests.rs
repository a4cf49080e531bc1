//! Calibrations of simulated cameras, whose parameters are known.

use super::*;
use crate::beacon::Beacon;
use crate::simulate::{PointingHand, SensorPath, Simulation, SurveyingHand};

fn views(camera: Pinhole, path: &impl SensorPath, seed: u64) -> Vec<CalibrationView> {
    views_of(&Beacon::recommended(), camera, path, seed)
}

fn views_of(beacon: &Beacon, camera: Pinhole, path: &impl SensorPath, seed: u64) -> Vec<CalibrationView> {
    let simulation = Simulation { camera, ..Simulation::new(beacon.clone(), seed) };
    let mut identifier = BlobIdentifier::new(beacon.clone(), Pinhole::TYPICAL);
    let reports = simulation.record(path, 60.0);
    // Every fourth report: the blobs are followed as well, in a quarter of the time.
    let some = reports.iter().step_by(4);
    let found = some.filter_map(|made| identifier.push(made.t_ns, &made.report)).collect();
    choose_views(found, 250)
}

/// Invariant: A flat target calibrates a camera, and a remote at rest counts as one view.
///
/// Four LEDs on a sheet, in an uneven quadrangle. Views of a plane determine a focal length only by
/// their slant.
#[test]
fn a_flat_target_calibrates_too() {
    let sheet = Beacon::new(&[[0.0, 0.0, 0.0], [210.0, 20.0, 0.0], [170.0, 140.0, 0.0], [-30.0, 90.0, 0.0]]);
    let sheet = sheet.unwrap();
    let found = calibrate_camera(
        &views_of(&sheet, TRUE, &SurveyingHand::around(&sheet, 4), 4),
        &Pinhole::TYPICAL,
        CalibrationModel::Pinhole,
    )
    .unwrap();
    let errors = [found.camera.fx - TRUE.fx, found.camera.fy - TRUE.fy, found.camera.cx - TRUE.cx];
    for (error, sigma) in errors.into_iter().zip([0, 1, 3].map(|at| found.sigma[at])) {
        assert!(error.abs() < 4.0 * sigma && sigma < 13.7, "{error} beyond {sigma}: {found:?}");
    }
    assert!(found.held_out_rms_px < 0.6, "{}", found.held_out_rms_px);
}

/// Invariant: A flat target calibrates a camera, and a remote at rest counts as one view.
#[test]
fn a_remote_that_rests_is_one_view() {
    let all = views(TRUE, &SurveyingHand::around(&Beacon::recommended(), 5), 5);
    let resting: Vec<_> = all.iter().flat_map(|view| [view.clone(), view.clone(), view.clone()]).collect();
    assert_eq!(moving_views(resting).len(), all.len());
}

const TRUE: Pinhole = Pinhole { fx: 1372.0, fy: 1365.0, cx: 525.0, cy: 360.0, ..Pinhole::TYPICAL };

#[test]
fn a_camera_is_found_within_its_own_uncertainty() {
    let survey = SurveyingHand::around(&Beacon::recommended(), 1);
    let found =
        calibrate_camera(&views(TRUE, &survey, 1), &Pinhole::TYPICAL, CalibrationModel::Pinhole).unwrap();
    let errors = [
        found.camera.fx - TRUE.fx,
        found.camera.fy - TRUE.fy,
        found.camera.cx - TRUE.cx,
        found.camera.cy - TRUE.cy,
    ];
    for (error, sigma) in errors.into_iter().zip([0, 1, 3, 4].map(|at| found.sigma[at])) {
        assert!(error.abs() < 4.0 * sigma, "{error} beyond {sigma}: {found:?}");
    }
    assert!(found.sigma[0] < 8.0 && errors[0].abs() < 0.01 * TRUE.fx, "{found:?}");
    assert!((0.4..0.75).contains(&found.noise_px), "{}", found.noise_px);
    assert!(found.held_out_rms_px < 0.6, "{}", found.held_out_rms_px);
    assert_eq!(found.sigma[2], 0.0, "the skew was not looked for");
}

#[test]
fn radial_distortion_is_found_where_it_is_looked_for() {
    let bent = Pinhole { distortion: [-0.15, 0.0, 0.0, 0.0, 0.0], ..TRUE };
    let survey = SurveyingHand::around(&Beacon::recommended(), 2);
    let views = views(bent, &survey, 2);
    let found = calibrate_camera(&views, &Pinhole::TYPICAL, CalibrationModel::Radial).unwrap();
    assert!((found.camera.distortion[0] + 0.15).abs() < 4.0 * found.sigma[5], "{found:?}");
    assert!(found.sigma[5] < 0.06, "{found:?}");
    let without = calibrate_camera(&views, &Pinhole::TYPICAL, CalibrationModel::Pinhole).unwrap();
    assert!(without.rms_px > found.rms_px, "{} {}", without.rms_px, found.rms_px);
}

#[test]
fn views_that_tell_nothing_are_refused_with_the_reason() {
    let survey = SurveyingHand::around(&Beacon::recommended(), 3);
    let good = views(TRUE, &survey, 3);
    let refused = |views: &[CalibrationView]| {
        calibrate_camera(views, &Pinhole::TYPICAL, CalibrationModel::Pinhole).unwrap_err().to_string()
    };
    assert!(refused(&good[..5]).contains("5 different views"));
    let same = vec![good[0].clone(); 20];
    assert!(refused(&same).contains("span 0 degrees"), "{}", refused(&same));
    let still = views(TRUE, &PointingHand::before(&Beacon::recommended(), 1500.0, 1), 1);
    let message = refused(&still);
    assert!(
        message.contains("degrees") || message.contains("cover") || message.contains("different"),
        "{message}"
    );
    // LEDs of another beacon: half the size along one axis.
    let mut other = good;
    for sighting in other.iter_mut().flat_map(|view| &mut view.sightings) {
        sighting.led.z *= 0.5;
        sighting.led.x *= 1.2;
    }
    assert!(calibrate_camera(&other, &Pinhole::TYPICAL, CalibrationModel::Pinhole).is_err());
}
