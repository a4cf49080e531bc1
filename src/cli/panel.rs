//! `--panel`: the file that describes a panel with lenses.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, bail};

use relief_display::{Layout, LensPanel};

/// A description takes some hundred bytes.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// The panel of a file.
///
/// # Errors
/// When the layout has no lenses, or the file describes no panel.
pub(crate) fn panel_for(layout: Layout, path: &Path) -> anyhow::Result<LensPanel> {
    if !matches!(layout, Layout::Lenses(_)) {
        bail!("--panel is for layouts lenses-N; this one is {layout}");
    }
    read_panel(path)
}

/// The panel that a file describes.
pub(crate) fn read_panel(path: &Path) -> anyhow::Result<LensPanel> {
    let mut file = Vec::new();
    let read = File::open(path).and_then(|opened| opened.take(MAX_FILE_BYTES).read_to_end(&mut file));
    read.with_context(|| format!("cannot read {}", path.display()))?;
    LensPanel::from_json(&file).with_context(|| format!("{} is no panel", path.display()))
}
