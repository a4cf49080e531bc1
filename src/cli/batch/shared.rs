//! Parts that the subcommands of `relief batch` share: memory, progress and the manifest.

use std::collections::BTreeSet;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::adapter::AdapterArguments;
use crate::memory::available_bytes;
use relief_batch::{Job, read_manifest};
use relief_render::Renderer;

/// A run that failed in a way that may pass: EX_TEMPFAIL of sysexits.
pub(crate) const TRY_AGAIN: u8 = 75;

pub(crate) fn read(manifest: &Path) -> anyhow::Result<Vec<Job>> {
    let file =
        std::fs::File::open(manifest).with_context(|| format!("cannot read {}", manifest.display()))?;
    let jobs = read_manifest(BufReader::new(file))
        .with_context(|| format!("{} is no manifest", manifest.display()))?;
    let folder = folder_of(manifest);
    let jobs = jobs.into_iter().map(|job| job.resolved_in(folder));
    let mut jobs: Vec<Job> = jobs.collect::<std::io::Result<_>>()?;
    let missing: BTreeSet<PathBuf> = jobs.iter_mut().flat_map(Job::missing_paths).collect();
    for path in missing {
        eprintln!(
            "warning: {} does not exist, neither in {} nor in the current folder",
            path.display(),
            folder.display()
        );
    }
    Ok(jobs)
}

/// The folder of a manifest, which its relative paths start from.
pub(crate) fn folder_of(manifest: &Path) -> &Path {
    match manifest.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Bytes for volumes: voxels in memory, and their copies on an adapter.
pub(crate) struct MemoryShare {
    pub(crate) voxels: u64,
    adapter: u64,
}

impl MemoryShare {
    /// Splits an amount of memory; by default half of the available memory.
    pub(crate) fn of(memory: Option<u64>) -> anyhow::Result<Self> {
        let memory = memory.or_else(|| available_bytes().map(|bytes| bytes / 2)).unwrap_or(4 << 30);
        let Some(for_volumes) = memory.checked_sub(BESIDE_BYTES).filter(|bytes| *bytes >= BESIDE_BYTES / 2)
        else {
            bail!(
                "--memory is {} MiB, allowed: {} MiB and more",
                memory >> 20,
                (BESIDE_BYTES + BESIDE_BYTES / 2) >> 20
            );
        };
        let voxels = (for_volumes as f64 * VOXEL_SHARE) as u64;
        Ok(Self { voxels, adapter: for_volumes - voxels })
    }

    pub(crate) fn open_renderer(&self, adapter: &AdapterArguments) -> anyhow::Result<Renderer> {
        let mut renderer = adapter.open_renderer()?;
        let mut limits = renderer.volume_limits();
        limits.memory_bytes = limits.memory_bytes.min(self.adapter);
        renderer.set_volume_limits(limits);
        Ok(renderer)
    }
}

pub(crate) fn bar(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr_with_hz(5));
    let style = ProgressStyle::with_template("{prefix} {bar:40} {pos}/{len} {per_sec}, {eta} left {msg}");
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())).with_prefix(what)
}

/// Share of the memory for voxels that are not on the adapter: theirs there take five times as
/// much, with gradients.
const VOXEL_SHARE: f64 = 0.25;

/// Memory of the program and of a software adapter beside volumes.
const BESIDE_BYTES: u64 = 512 << 20;
