//! Poses of the hand, raw reports, and intents.

use serde::{Deserialize, Serialize};

use super::error::{MessageError, MessageFault};
use crate::interaction::Intent;
use relief_tracking::{Buttons, MAX_REPORT_BYTES, TrackingState, bytes_of_hex};
use relief_volume::CameraFile;

/// A pose: of the tracked Wiimote, of an orbit, or a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// Rising number, which frames echo.
    pub seq: u64,
    /// When it was taken, ns of the client's clock, which frames echo.
    pub t_ns: u64,
    /// The pose.
    pub what: PoseKind,
}

/// The kinds of pose.
#[derive(Clone, Debug, PartialEq)]
pub enum PoseKind {
    /// The Wiimote's camera in the beacon's frame, as `relief track` writes it, and the buttons
    /// held.
    Remote(RemotePose),
    /// Angles and zoom around the volume.
    Orbit(OrbitPose),
    /// A camera, as in a request.
    Camera(CameraFile),
}

/// A tracked Wiimote.
#[derive(Clone, Debug, PartialEq)]
pub struct RemotePose {
    /// The tracking state.
    pub state: TrackingState,
    /// Position in beacon mm, and orientation x, y, z, w, of the sensor; while tracking.
    pub pose: Option<([f64; 3], [f64; 4])>,
    /// Names of the buttons held.
    pub buttons: Vec<String>,
}

/// Angles around the volume; an omitted angle stays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrbitPose {
    /// 0 from the front, 90 from the patient's left.
    pub azimuth_deg: f64,
    /// 90 from the head, -90 from the feet.
    pub elevation_deg: f64,
    /// 1 fits the whole into the picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zoom: Option<f64>,
}

/// A pose as written: exactly one kind.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct PoseFile {
    seq: u64,
    t_ns: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    state: Option<TrackingState>,
    #[serde(skip_serializing_if = "Option::is_none")]
    position_mm: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    orientation_xyzw: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    buttons: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    orbit: Option<OrbitPose>,
    #[serde(skip_serializing_if = "Option::is_none")]
    camera: Option<CameraFile>,
}

/// A raw report of a Wiimote.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawReport {
    /// Rising number, in one row with those of poses.
    pub seq: u64,
    /// When it came, ns of the client's clock.
    pub t_ns: u64,
    /// The report in hexadecimal digits, from its id on.
    pub report: String,
}

impl RawReport {
    /// The report's bytes.
    ///
    /// # Errors
    /// When they are no pairs of hexadecimal digits, or more than a report has.
    pub fn bytes(&self) -> Result<Vec<u8>, MessageError> {
        let wrong = || MessageError::new("report", MessageFault::Report(MAX_REPORT_BYTES));
        let digits = Some(self.report.as_str()).filter(|digits| digits.len() <= 2 * MAX_REPORT_BYTES);
        digits.and_then(bytes_of_hex).ok_or_else(wrong)
    }
}

/// An intent, with its number and time.
#[derive(Clone, Debug, PartialEq)]
pub struct IntentMessage {
    /// Rising number, in one row with those of poses.
    pub seq: u64,
    /// When it was uttered, ns of the client's clock.
    pub t_ns: u64,
    /// The intent.
    pub intent: Intent,
}

impl Pose {
    pub(super) fn of(file: PoseFile) -> Result<Self, MessageError> {
        let PoseFile { seq, t_ns, state, position_mm, orientation_xyzw, buttons, orbit, camera } = file;
        let is_remote =
            state.is_some() || position_mm.is_some() || orientation_xyzw.is_some() || buttons.is_some();
        let what = match (orbit, camera) {
            (Some(orbit), None) if !is_remote => PoseKind::Orbit(orbit),
            (None, Some(camera)) if !is_remote => PoseKind::Camera(camera),
            (None, None) if is_remote => {
                let state = state.ok_or_else(|| MessageError::new("state", MessageFault::NoState))?;
                let pose = position_mm.zip(orientation_xyzw);
                if pose.is_some() != (state == TrackingState::Tracking)
                    || position_mm.is_some() != orientation_xyzw.is_some()
                {
                    return Err(MessageError::new("state", MessageFault::Untracked));
                }
                PoseKind::Remote(RemotePose { state, pose, buttons: checked(buttons.unwrap_or_default())? })
            }
            _ => return Err(MessageError::new(".", MessageFault::PoseKinds)),
        };
        Ok(Self { seq, t_ns, what })
    }

    pub(super) fn file(&self) -> PoseFile {
        let base = PoseFile { seq: self.seq, t_ns: self.t_ns, ..PoseFile::default() };
        match &self.what {
            PoseKind::Orbit(orbit) => PoseFile { orbit: Some(*orbit), ..base },
            PoseKind::Camera(camera) => PoseFile { camera: Some(*camera), ..base },
            PoseKind::Remote(RemotePose { state, pose, buttons }) => PoseFile {
                state: Some(*state),
                position_mm: pose.map(|(position, _)| position),
                orientation_xyzw: pose.map(|(_, orientation)| orientation),
                buttons: Some(buttons.clone()),
                ..base
            },
        }
    }
}

/// Names of buttons, each known and there once.
fn checked(buttons: Vec<String>) -> Result<Vec<String>, MessageError> {
    let known: Vec<&'static str> = Buttons::ALL.iter().map(|(_, name)| *name).collect();
    for (i, name) in buttons.iter().enumerate() {
        if !known.contains(&name.as_str()) || buttons[..i].contains(name) {
            let fault = MessageFault::Button { found: name.chars().take(40).collect(), known };
            return Err(MessageError::new(&format!("buttons[{i}]"), fault));
        }
    }
    Ok(buttons)
}
