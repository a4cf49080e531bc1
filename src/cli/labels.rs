//! `--labels`: a label map for a series, brought to its grid.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, bail};

use crate::dicom::{self, LoadLimits};
use crate::formats;
use crate::volume::{Grid, LabelMap};

/// Share of the labelled space that lies in the volume below which a map may well be of another series.
const DOUBTFUL_SHARE: f64 = 0.5;

/// Bytes that the voxels of a segmentation object may take, two for each.
const LIMITS: LoadLimits = LoadLimits { voxel_bytes: 4 << 30 };

/// Loads a label map onto the grid of a volume, with warnings on stderr.
pub(super) fn load(path: &Path, grid: &Grid) -> anyhow::Result<Arc<LabelMap>> {
    let start = Instant::now();
    let (map, warnings) = read(path)?;
    for warning in warnings {
        eprintln!("warning: {warning}");
    }
    let placed = if map.grid() == grid { map } else { placed(&map, grid)? };
    let (count, elapsed) = (placed.segments().len(), start.elapsed());
    tracing::debug!("loaded {count} segments in {:.1} ms", elapsed.as_secs_f64() * 1e3);
    // Requests are compared by it: not when the first of them waits.
    let _ = placed.content_hash();
    Ok(Arc::new(placed))
}

/// Reads a file by what it begins with: NIfTI, NRRD, or else DICOM.
pub(super) fn read(path: &Path) -> anyhow::Result<(LabelMap, Vec<String>)> {
    let failed = || format!("cannot use the label map {}", path.display());
    std::fs::File::open(path).with_context(failed)?;
    if path.is_dir() {
        bail!("the label map {} is a folder, expected a file", path.display());
    }
    if formats::is_known(path) {
        let found = formats::read_labels(path).with_context(failed)?;
        return Ok((found.map, found.warnings));
    }
    let found = dicom::load_segmentation(LIMITS, path)
        .with_context(|| format!("{}: neither NIfTI nor NRRD, and no usable DICOM segmentation", failed()))?;
    Ok((found.map, found.warnings))
}

fn placed(map: &LabelMap, grid: &Grid) -> anyhow::Result<LabelMap> {
    let placed = map.resampled(grid);
    let space = |map: &LabelMap| map.labelled_voxels() as f64 * map.voxel_mm3();
    let share = space(&placed) / space(map).max(f64::MIN_POSITIVE);
    if map.labelled_voxels() > 0 && placed.labelled_voxels() == 0 {
        let span = |grid: &Grid| {
            let bounds = grid.bounds();
            format!("{:.0} to {:.0} mm", bounds.min.xyz, bounds.max.xyz)
        };
        bail!(
            "the label map lies elsewhere: it spans {} and the volume {} (patient LPS); are they of the same scan?",
            span(map.grid()),
            span(grid)
        );
    }
    if share < DOUBTFUL_SHARE {
        eprintln!(
            "warning: only {:.0} % of what is labelled lies in the volume; is the label map of this scan?",
            100.0 * share
        );
    }
    Ok(placed)
}
