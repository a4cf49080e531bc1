//! The pose of a Wiimote from the LEDs that its infrared camera sees.
//!
//! Arithmetic on reports. `report` decodes them into blobs, acceleration and angular rates;
//! `sensor` is the camera and [`Beacon`] the layout of LEDs; `correspondence` identifies blobs as
//! LEDs; `solve` finds the pose of a single view; `filter` joins poses over time; [`Tracker`] does
//! all of it. `calibrate` finds the camera from a survey; `host` sets up a remote's camera;
//! `simulate` makes recordings; `igtl` encodes poses for other programs
//! and decodes those of other trackers, whose axes `tool` describes. Sockets, threads and clocks are
//! not here.
//!
//! | space | definition |
//! |---|---|
//! | `Beacon` | the LED rig, mm; `up` is opposite to gravity |
//! | `Sensor` | the Wiimote's camera, mm: x right, y down, z forward |
//! | pixels | u right, v down, 1024 x 768; the raw y of reports points up, v = 767 - y |
//!
//! Times are ns of the source.
//!
//! **Single views.** The cost of a rotation is `r' Omega r` (SQPnP). Starts are the rotations
//! nearest to the six eigenvectors of the smallest eigenvalues with both signs; Newton's method on
//! SO(3) descends from them, and Levenberg-Marquardt refines in pixels. With a known up direction
//! one angle is left, so two LEDs suffice.
//!
//! **Correspondence.** All assignments are solved and scored by chi-square. The best one is used
//! only if every other is worse by 25; otherwise the view is ambiguous and has no pose.
//!
//! **Filter.** An error-state filter of position, velocity, rotation, rate and gyroscope bias: 15
//! numbers. Measurements are applied one number at a time, without inverses and without allocation.
//!
//! **Calibration** is a bundle adjustment of seven camera parameters and a pose per view, with the
//! poses eliminated by a Schur complement.

mod beacon;
mod calibrate;
mod correspondence;
mod design;
mod experiment;
mod filter;
mod head;
mod host;
mod igtl;
mod pose;
mod report;
mod sensor;
mod simulate;
mod solve;
mod tool;
mod tracker;

pub use beacon::{Beacon, BeaconError, MAX_LEDS};

pub use calibrate::{
    BlobIdentifier, Calibration, CalibrationError, CalibrationModel, CalibrationView, Parameter, Square,
    calibrate_camera, choose_views, moving_views,
};
pub use correspondence::{EarlierPose, Identified, IdentifyHints, MARGIN, identify_blobs};
pub use design::{DesignConditions, DesignScore, score_design, search_design};
pub use experiment::{
    Arm, ExperimentOutcome, ExperimentRun, ExperimentSetting, PlotPoint, TrackingMethod, run_experiment,
    simulate_survey,
};
pub use filter::{ErrorStateFilter, MotionDensity, State, Update, Verdict};
pub use head::{DisplayGeometry, HeadPose, HeadPoseError, OPENTRACK_BYTES};
pub use host::{Host, HostOptions, HostState, RemoteSenses, Sensitivity, VirtualRemote};
pub use igtl::{
    IGTL_HEADER_BYTES, IgtlError, IgtlHeader, igtl_acknowledgement, igtl_message, igtl_pose, igtl_position,
    igtl_tracking_data, igtl_transform,
};
pub use pose::{Pose, SensorPose};
pub use report::calibration::{
    AccelerometerCalibration, Calibrations, EepromError, IrCalibration, decode_ir,
};
pub use report::motion_plus::{GyroCalibration, GyroRange, MotionPlus};
pub use report::output::{DataMode, MemorySpace, Output, OutputError};
pub use report::recording::{
    MAX_LINE_BYTES, RecordingError, RecordingReader, TimedReport, bytes_of_hex, hex_of_bytes, recording_line,
};
pub use report::{
    Acknowledge, Blob, BlobExtent, Buttons, DataReport, Extension, Half, InputReport, InterleavedHalf,
    IrFormat, Layout, MAX_REPORT_BYTES, Memory, ReportError, Status,
};
pub use sensor::file::{CameraFileError, CameraFormat, YamlError, read_camera, write_camera};
pub use sensor::{LensError, Pinhole, PinholeError, TYPICAL_FOCAL_PX, ThinLens};
pub use simulate::{
    HiddenLed, PointingHand, PressedButton, ReportDelivery, SensorModel, SensorPath, SimulatedReport,
    Simulation, SurveyingHand,
};
pub use solve::bound::quantised_noise;
#[cfg(feature = "ipopt")]
pub use solve::ipopt::solve_with_ipopt;
pub use solve::paper::{PaperSolution, level_start, solve_as_published};
pub use solve::random::{Random, ViewRange, random_sightings};
pub use solve::{Gravity, MAX_SEEN, Minimum, PoseView, Sighting, Solutions};
pub use tool::{NotRigid, ToolPlacement, TrackerGeometry};
pub use tracker::{
    DroppedReports, FilterKind, Frame, Frames, PoseRecord, SolverKind, TrackedSample, Tracker,
    TrackerOptions, TrackingState,
};
