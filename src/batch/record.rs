//! Records of finished jobs. A record is written after the outputs, so a job with a record is done.

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use super::manifest::{Job, JobKey};
use super::product::Product;
use super::sink::Sink;
use crate::output_file::OutputFile;

/// The outputs of a job.
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
    pub outputs: Vec<OutputFile>,
    /// The structures of the values of `VIEW.labels.png`, from 1 on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub structures: Vec<String>,
    /// Time of rays, of drawing over them, and of uploads to a graphics adapter, ms.
    pub render_ms: f64,
    /// From the frame to the last byte, ms.
    pub write_ms: f64,
    /// Width and height of the picture.
    pub size_px: [u32; 2],
    /// Warnings of the series' reading.
    pub warnings: Vec<String>,
    /// The warning about a picture that shows nothing or has no depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picture_warning: Option<String>,
}

/// Largest record that is read, bytes.
const LARGEST: u64 = 1 << 20;

impl Record {
    fn file_name(job: &Job) -> String {
        format!("{}.json", job.name())
    }

    /// Writes it, unless another worker has recorded this very job as done meanwhile.
    pub(super) fn write(&self, job: &Job, sink: &Sink) -> std::io::Result<()> {
        let (name, bytes) = (Self::file_name(job), Bytes::from(serde_json::to_vec_pretty(self)?));
        if sink.put_new(&name, bytes.clone())? || Self::of_done(job, sink).is_some() {
            return Ok(());
        }
        sink.put(&name, bytes)
    }

    /// The name of one of its files.
    #[must_use]
    pub fn output(&self, product: Product) -> Option<&str> {
        let name = format!("{}.{}", self.view, product.ending());
        self.outputs.iter().map(|output| output.file.as_str()).find(|file| *file == name)
    }

    /// The record that a job of this key left, whatever became of its outputs.
    ///
    /// # Errors
    /// When the place of the outputs does not answer, or refuses.
    pub fn read(job: &Job, sink: &Sink) -> std::io::Result<Option<Self>> {
        let Some(bytes) = sink.read(&Self::file_name(job), LARGEST)? else { return Ok(None) };
        let record: Option<Self> = serde_json::from_slice(&bytes).ok();
        Ok(record.filter(|record| record.job == job.job))
    }

    /// The record of a finished job: it has this key, and all its outputs exist unaltered.
    #[must_use]
    pub fn of_done(job: &Job, sink: &Sink) -> Option<Self> {
        let record = Self::read(job, sink).ok().flatten()?;
        let is_whole = record.outputs.len() == job.products.len();
        let is_there =
            |output: &OutputFile| sink.holds(&format!("{}/{}", job.series.name, output.file), output);
        (is_whole && record.outputs.iter().all(is_there)).then_some(record)
    }
}
