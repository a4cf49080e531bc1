//! The file of `--tracker-geometry`.

use std::path::Path;

use anyhow::Context;
use relief_tracking::{ToolPlacement, TrackerGeometry};

/// Largest file, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// The placement that a file describes; without a file all axes are the same.
pub(crate) fn read_placement(path: Option<&Path>) -> anyhow::Result<ToolPlacement> {
    let Some(path) = path else { return Ok(TrackerGeometry::default().placement()?) };
    let about = || format!("cannot read {}", path.display());
    let bytes = relief_base::read_at_most(path, MOST_BYTES).with_context(about)?;
    let bytes = bytes.with_context(|| format!("{} is larger than 1 MiB", path.display()))?;
    let geometry: TrackerGeometry = serde_json::from_slice(&bytes).with_context(about)?;
    geometry.placement().with_context(about)
}
