//! Records: what a job wrote, beside what it wrote. Written last, so a job with a record is done.

use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::files::write_whole;
use super::manifest::{Job, JobKey, hex};
use super::product::Product;

/// What a job wrote.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The job.
    pub job: JobKey,
    /// Its series' name.
    pub series: String,
    /// Its view's name.
    pub view: String,
    /// The views that it belongs together with.
    pub group: String,
    /// The files beside this record.
    pub outputs: Vec<Written>,
    /// What the values of `VIEW.labels.png` from 1 on stand for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub structures: Vec<String>,
    /// Time on the adapter and over it, ms.
    pub render_ms: f64,
    /// From the frame to the last byte, ms.
    pub write_ms: f64,
    /// Width and height of the picture.
    pub size_px: [u32; 2],
    /// Warnings of the series' reading.
    pub warnings: Vec<String>,
}

/// A file that a job wrote.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Written {
    /// Its name, in the series' folder.
    pub file: String,
    /// Its SHA-256.
    pub sha256: String,
    /// Its length.
    pub bytes: u64,
}

/// Largest record that is read, bytes.
const LARGEST: u64 = 1 << 20;

impl Written {
    pub(super) fn new(file: String, bytes: &[u8]) -> Self {
        Self { file, sha256: hex(&Sha256::digest(bytes).into()), bytes: bytes.len() as u64 }
    }

    /// Whether the file is there and has these bytes.
    fn is_there(&self, folder: &Path) -> bool {
        let path = folder.join(&self.file);
        let has_length = std::fs::metadata(&path).is_ok_and(|found| found.len() == self.bytes);
        has_length && super::source::file_sha256(&path).is_ok_and(|found| found == self.sha256)
    }
}

impl Record {
    fn file_name(job: &Job) -> String {
        format!("{}.json", job.view)
    }

    /// Writes it into the folder of the job's series.
    pub(super) fn write(&self, job: &Job, folder: &Path) -> std::io::Result<()> {
        write_whole(&folder.join(Self::file_name(job)), &serde_json::to_vec_pretty(self)?)
    }

    /// The name of one of its files.
    pub(super) fn output(&self, product: Product) -> Option<&str> {
        let name = format!("{}.{}", self.view, product.ending());
        self.outputs.iter().map(|output| output.file.as_str()).find(|file| *file == name)
    }

    /// The record that a job of this key left, whatever became of its outputs.
    #[must_use]
    pub fn read(job: &Job, out: &Path) -> Option<Self> {
        let path = out.join(&job.series.name).join(Self::file_name(job));
        if std::fs::metadata(&path).ok()?.len() > LARGEST {
            return None;
        }
        let record: Self = serde_json::from_slice(&std::fs::read(path).ok()?).ok()?;
        (record.job == job.job).then_some(record)
    }

    /// The record of a job that is done: its key is this one, and all that it wrote is there unaltered.
    #[must_use]
    pub fn of_done(job: &Job, out: &Path) -> Option<Self> {
        let folder = out.join(&job.series.name);
        let record = Self::read(job, out)?;
        let is_whole = record.outputs.len() == job.products.len();
        (is_whole && record.outputs.iter().all(|output| output.is_there(&folder))).then_some(record)
    }
}
