//! `--labels`: a label map for a series, brought to its grid.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;

use relief_session::{PlacedLabels, load_labels};
use relief_volume::{Grid, LabelMap};

/// Voxels that a label map may have, as a volume.
pub(super) const MOST_LABEL_VOXELS: u64 = 1 << 31;

/// Loads a label map onto the grid of a volume, with warnings on stderr.
pub(super) fn load(path: &Path, grid: &Grid) -> anyhow::Result<Arc<LabelMap>> {
    let start = Instant::now();
    let loaded = load_labels(path, MOST_LABEL_VOXELS, grid);
    let PlacedLabels { map, warnings } =
        loaded.with_context(|| format!("cannot use the label map {}", path.display()))?;
    for warning in warnings {
        eprintln!("warning: {warning}");
    }
    let (count, elapsed) = (map.segments().len(), start.elapsed());
    tracing::debug!("loaded {count} segments in {:.1} ms", elapsed.as_secs_f64() * 1e3);
    Ok(map)
}
