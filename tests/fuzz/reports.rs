//! Whatever bytes come from a remote, a recording, a camera file, a beacon or a network client.

use relief_tracking::{
    Beacon, Calibrations, InputReport, MAX_REPORT_BYTES, MotionPlus, Output, Pinhole, RecordingReader,
    Tracker, TrackerOptions,
};

/// A recording, a camera file, a beacon, and messages of trackers.
pub(crate) fn recording(bytes: &[u8]) {
    let _ = Calibrations::decode(bytes);
    let _ = MotionPlus::decode(bytes);
    let _ = bytes.first_chunk().map(relief_tracking::IgtlHeader::decode);
    transform(bytes);
    for line in RecordingReader::new(bytes) {
        if line.is_err() {
            break;
        }
    }
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = relief_tracking::read_camera(text);
        let _ = Beacon::read(text);
    }
}

/// Checks that decoded reports come back the same when they are encoded and decoded; and that a
/// tracker never gives a pose that is not finite.
pub(crate) fn reports(bytes: &[u8]) {
    let mut tracker = Tracker::new(Pinhole::TYPICAL, Beacon::recommended(), TrackerOptions::default());
    for (at, chunk) in bytes.chunks(MAX_REPORT_BYTES).enumerate() {
        if let Ok((output, rumble)) = Output::decode(chunk) {
            assert_eq!(Output::decode(&output.encode(rumble)), Ok((output, rumble)));
        }
        let Ok(report) = InputReport::decode(chunk) else { continue };
        assert_eq!(InputReport::decode(&report.encode()), Ok(report.clone()));
        let sample = tracker.push(at as u64 * 10_000_000, &report);
        if let Some(pose) = sample.and_then(|sample| sample.pose) {
            assert!(
                pose.position.iter().chain(pose.orientation.coords.iter()).all(|number| number.is_finite())
            );
        }
    }
}

/// A transform with these bytes as its body, whose checksum is right, by both forms of a body.
fn transform(body: &[u8]) {
    let message = relief_tracking::igtl_message("TRANSFORM", "tool", 0, body);
    let Some(Ok(header)) = message.first_chunk().map(relief_tracking::IgtlHeader::decode) else { return };
    for version in [1, 3] {
        let header = relief_tracking::IgtlHeader { version, ..header.clone() };
        if let Ok(Some(pose)) = relief_tracking::igtl_pose(&header, body) {
            assert!(pose.position.iter().all(|mm| mm.is_finite()), "{pose:?}");
        }
    }
}
