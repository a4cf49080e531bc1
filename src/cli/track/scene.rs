//! The beacon and the camera of the tracking commands.

use std::path::Path;
use std::path::PathBuf;

use anyhow::Context;

use crate::text_file::read_text;
use relief_tracking::{Beacon, Pinhole};
/// Source of reports, camera and beacon.
#[derive(Debug, clap::Args)]
pub(crate) struct TrackSceneArguments {
    /// The LEDs; the recommended beacon by default
    #[arg(long, value_name = "BEACON.toml")]
    beacon: Option<PathBuf>,
    /// The camera, YAML of OpenCV or ROS; a typical Wiimote by default, whose distances are 3 %
    /// uncertain
    #[arg(long, value_name = "CAMERA.yaml")]
    sensor: Option<PathBuf>,
    /// Noise of a blob's coordinates before they are rounded, px
    #[arg(long, value_name = "PX", default_value_t = 0.5, value_parser = noise)]
    noise_px: f64,
}

impl TrackSceneArguments {
    pub(crate) fn beacon(&self) -> anyhow::Result<Beacon> {
        read_beacon(self.beacon.as_deref())
    }

    pub(crate) fn camera(&self) -> anyhow::Result<Pinhole> {
        read_camera(self.sensor.as_deref())
    }

    pub(crate) fn noise_px(&self) -> f64 {
        self.noise_px
    }
}

pub(crate) fn noise(text: &str) -> Result<f64, String> {
    let px: f64 = text.parse().map_err(|error| format!("{error}"))?;
    if (0.01..=20.0).contains(&px) { Ok(px) } else { Err("allowed: 0.01 to 20 px".to_owned()) }
}

/// The beacon of a file, or the recommended one.
pub(crate) fn read_beacon(path: Option<&Path>) -> anyhow::Result<Beacon> {
    let Some(path) = path else { return Ok(Beacon::recommended()) };
    Beacon::read(&read_text(path)?).with_context(|| format!("{} is not a beacon file", path.display()))
}

/// The camera of a file, or a typical one.
pub(crate) fn read_camera(path: Option<&Path>) -> anyhow::Result<Pinhole> {
    let Some(path) = path else { return Ok(Pinhole::TYPICAL) };
    relief_tracking::read_camera(&read_text(path)?)
        .with_context(|| format!("{} is not a camera file", path.display()))
}
