//! A host and a virtual remote, with answers lost, modes changed by others, and the remote
//! unplugged.

use super::*;
use crate::report::Blob;
use crate::report::calibration::AccelerometerCalibration;

/// Runs host and remote for some seconds in steps of 10 ms; every `lose`-th answer is lost. Returns
/// the reports.
fn talk(
    host: &mut Host,
    remote: &mut VirtualRemote,
    from_ns: u64,
    seconds: u64,
    lose: usize,
) -> Vec<InputReport> {
    let senses =
        RemoteSenses { blobs: [Some(Blob::at(500, 300)), None, None, None], ..RemoteSenses::default() };
    let (mut reports, mut answers) = (Vec::new(), 0);
    for step in 0..seconds * 100 {
        let now = from_ns + step * 10_000_000;
        if let Some(output) = host.poll(now) {
            for answer in remote.take(&output) {
                answers += 1;
                if lose == 0 || answers % lose != 0 {
                    host.take(now, &answer);
                }
            }
        }
        if remote.is_continuous() {
            let report = remote.report(&senses);
            host.take(now, &report);
            reports.push(report);
        }
    }
    reports
}

fn options() -> HostOptions {
    HostOptions { sensitivity: Sensitivity::Level3, full: false, gyroscope: false }
}

fn sees_blob(report: &InputReport) -> bool {
    matches!(report, InputReport::Data(data) if data.blobs.is_some_and(|blobs| blobs[0].is_some()))
}

#[test]
fn the_camera_comes_up_and_tells_its_calibration() {
    for lose in [0, 4] {
        let (mut host, mut remote) = (Host::new(options()), VirtualRemote::new(false));
        let reports = talk(&mut host, &mut remote, 0, 8, lose);
        assert_eq!(host.state(), HostState::Running, "with every {lose}th answer lost");
        assert!(sees_blob(reports.last().unwrap()));
        assert_eq!(remote.register(0xb0_0033), 3);
        assert_eq!(remote.register(0xb0_0006), 0xaa);
        let known = host.calibrations().unwrap();
        assert_eq!(known.accelerometer, Some(AccelerometerCalibration::TYPICAL));
        assert_eq!(known.ir.unwrap().size(), [769.0, 581.0]);
    }
}

#[test]
fn every_sensitivity_and_format_comes_up() {
    for level in 1..=6 {
        let sensitivity = Sensitivity::of_level(level).unwrap();
        let full = level % 2 == 0;
        let mut host = Host::new(HostOptions { sensitivity, full, gyroscope: false });
        let mut remote = VirtualRemote::new(false);
        let reports = talk(&mut host, &mut remote, 0, 2, 0);
        assert_eq!(host.state(), HostState::Running);
        assert_eq!(remote.register(0xb0_0008), sensitivity.blocks().0[8]);
        let last_two = &reports[reports.len() - 2..];
        let sees = |report: &InputReport| match report {
            InputReport::Interleaved(half) => half.blobs[0].is_some(),
            other => sees_blob(other),
        };
        assert!(last_two.iter().any(sees), "level {level}");
    }
    assert_eq!(Sensitivity::of_level(0), None);
    assert_eq!(Sensitivity::of_level(7), None);
}

#[test]
fn a_motion_plus_is_used_if_there_is_one() {
    for there in [true, false] {
        let mut host = Host::new(HostOptions { gyroscope: true, ..options() });
        let mut remote = VirtualRemote::new(there);
        talk(&mut host, &mut remote, 0, 3, 0);
        assert_eq!(host.state(), HostState::Running);
        assert_eq!(host.gyroscope().is_some(), there);
        assert_eq!(remote.register(0xa6_00fe), if there { 4 } else { 0 });
    }
}

/// After a status the remote is silent; a driver sets its own mode; both are set right without a
/// new start.
#[test]
fn the_mode_is_set_again() {
    let (mut host, mut remote) = (Host::new(options()), VirtualRemote::new(false));
    talk(&mut host, &mut remote, 0, 2, 0);
    host.take(2_000_000_000, &remote.status());
    remote.take(&Output::Mode { continuous: false, mode: DataMode::Single(Layout::AccelerationIr) });
    let reports = talk(&mut host, &mut remote, 2_010_000_000, 1, 0);
    assert!(sees_blob(reports.last().unwrap()));
    let foreign = DataMode::Single(Layout::AccelerationIrExtension6);
    remote.take(&Output::Mode { continuous: true, mode: foreign });
    let reports = talk(&mut host, &mut remote, 4_000_000_000, 1, 0);
    assert_eq!((reports[0].id(), reports.last().unwrap().id()), (0x37, 0x33));
    assert_eq!(host.restarts(), 0);
}

#[test]
fn a_remote_that_was_unplugged_is_brought_up_again() {
    let (mut host, mut remote) = (Host::new(options()), VirtualRemote::new(false));
    talk(&mut host, &mut remote, 0, 2, 0);
    let mut another = VirtualRemote::new(false);
    let reports = talk(&mut host, &mut another, 10_000_000_000, 4, 0);
    assert_eq!((host.state(), host.restarts()), (HostState::Running, 1));
    assert!(sees_blob(reports.last().unwrap()));
}

/// A device that never acknowledges is given up after the last try.
#[test]
fn a_refusal_ends() {
    let mut host = Host::new(options());
    let mut sent = 0;
    for step in 0..2000_u64 {
        let now = step * 10_000_000;
        if let Some(output) = host.poll(now) {
            sent += 1;
            let ack = super::super::report::Acknowledge {
                buttons: super::super::report::Buttons::default(),
                of: output.id(),
                error: 4,
            };
            host.take(now, &InputReport::Acknowledge(ack));
        }
    }
    assert_eq!(host.state(), HostState::Refused);
    assert!(sent < 40, "{sent}");
}
