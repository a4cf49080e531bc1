//! A series of a job: found again where it was planned, checked to be the same, loaded.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::error::Lasting;
use super::gate::{Gate, Held};
use super::manifest::hex;
use crate::dicom::{self, LoadLimits, SeriesEntry, Strictness};
use crate::formats;
use crate::volume::Volume;

/// Where a series is and what it is.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeriesSource {
    /// A folder, file, DICOMDIR or zip; or a volume as `.nii`, `.nii.gz` or `.nrrd`.
    pub path: PathBuf,
    /// Its UID, where the path holds several series.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uid: Option<String>,
    /// What outputs are called after: a name from a table, or the beginning of the hash.
    pub name: String,
    /// SHA-256 of its files.
    pub sha256: String,
}

/// A volume with the bytes that it holds of a gate.
pub(super) struct Loaded<'a> {
    pub(super) volume: Volume,
    /// Warnings of its reading.
    pub(super) warnings: Vec<String>,
    _held: Held<'a>,
}

/// Why a series was not loaded.
pub(super) type Trouble = (Lasting, String);

/// SHA-256 of a volume's file.
pub(super) fn file_sha256(path: &Path) -> std::io::Result<String> {
    use sha2::{Digest, Sha256};
    let mut file = std::fs::File::open(path)?;
    let (mut hasher, mut part) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match std::io::Read::read(&mut file, &mut part)? {
            0 => return Ok(hex(&hasher.finalize().into())),
            read => hasher.update(&part[..read]),
        }
    }
}

impl SeriesSource {
    /// Loads it, within what the gate allows, when there is room. A reason goes where others read it, so it names no file: what
    /// series lie in may be called after patients.
    pub(super) fn load<'a>(&self, gate: &'a Gate) -> Result<Loaded<'a>, Trouble> {
        let is_file = formats::is_known(&self.path);
        let loaded = if is_file { self.load_file(gate) } else { self.load_series(gate) };
        loaded.map_err(|(kind, reason)| (kind, self.without_path(reason)))
    }

    fn without_path(&self, reason: String) -> String {
        let path = self.path.display().to_string();
        if path.is_empty() {
            return reason;
        }
        let mut parts = reason.split(&path);
        let mut told = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            // Up to what is said of the file.
            told.push_str("its files");
            told.push_str(part.find(": ").map_or("", |end| &part[end..]));
        }
        told
    }

    fn load_series<'a>(&self, gate: &'a Gate) -> Result<Loaded<'a>, Trouble> {
        let found = dicom::discover(&self.path, Strictness::Lenient, &|_| ()).map_err(of_dicom)?;
        let entry = found.select(self.uid.as_deref()).map_err(of_dicom)?;
        self.expect(&hex(&entry.content_sha256().map_err(of_dicom)?))?;
        let bytes = needed_bytes(entry);
        if bytes > gate.limit() {
            return Err(too_large(bytes, gate.limit()));
        }
        let mut held = gate.hold(bytes);
        let limits = LoadLimits { voxel_bytes: gate.limit() };
        let loaded = dicom::load_within(limits, entry, Strictness::Lenient, &|_| ()).map_err(of_dicom)?;
        held.shrink(size_of_val(loaded.volume.voxels_hu()) as u64);
        let warnings = found.warnings().into_iter().chain(loaded.warnings);
        let warnings = warnings.map(|warning| warning.message).collect();
        Ok(Loaded { volume: loaded.volume, warnings, _held: held })
    }

    fn load_file<'a>(&self, gate: &'a Gate) -> Result<Loaded<'a>, Trouble> {
        let sha256 = file_sha256(&self.path).map_err(|error| (Lasting::Retryable, error.to_string()))?;
        self.expect(&sha256)?;
        // How large it is, is known when it is read.
        let mut held = gate.hold(gate.limit());
        let limits = formats::Limits { voxels: gate.limit() / size_of::<i16>() as u64 };
        let read = formats::read_volume_within(limits, &self.path)
            .map_err(|error| (Lasting::Permanent, error.to_string()))?;
        held.shrink(size_of_val(read.volume.voxels_hu()) as u64);
        Ok(Loaded { volume: read.volume, warnings: read.warnings, _held: held })
    }

    fn expect(&self, found: &str) -> Result<(), Trouble> {
        if self.sha256 == found {
            return Ok(());
        }
        Err((
            Lasting::Permanent,
            "the series' files are not those that were planned with; plan anew".to_owned(),
        ))
    }
}

/// Voxels as read, and once more while they are resampled, as uneven stacks are.
fn needed_bytes(entry: &SeriesEntry) -> u64 {
    entry.voxel_bytes()
}

fn too_large(needed: u64, allowed: u64) -> Trouble {
    let (needed, allowed) = (needed.div_ceil(1 << 20), allowed >> 20);
    let reason =
        format!("the volume needs {needed} MiB, and {allowed} MiB are for voxels; allow more with --memory");
    (Lasting::Permanent, reason)
}

fn of_dicom(error: dicom::Error) -> Trouble {
    let kind = match &error {
        dicom::Error::Unreadable { source, .. } if source.kind() != std::io::ErrorKind::NotFound => {
            Lasting::Retryable
        }
        dicom::Error::Memory { .. } => Lasting::Retryable,
        _ => Lasting::Permanent,
    };
    // A list of UIDs is nothing for a report that goes elsewhere.
    let reason = match error {
        dicom::Error::SeveralSeries { count, .. } => {
            format!("{count} series are there, and the job names none")
        }
        dicom::Error::UnknownSeries { .. } => "the series is no longer there".to_owned(),
        other => other.to_string(),
    };
    (kind, reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_name_no_file() {
        let (name, sha256) = ("a".to_owned(), String::new());
        let source = SeriesSource { path: "/archive/DOE^JOHN".into(), uid: None, name, sha256 };
        for (reason, told) in [
            ("cannot read /archive/DOE^JOHN/JOHN 1.dcm: gone", "cannot read its files: gone"),
            ("no series in /archive/DOE^JOHN", "no series in its files"),
            ("too large", "too large"),
        ] {
            assert_eq!(source.without_path(reason.to_owned()), told);
        }
    }
}
