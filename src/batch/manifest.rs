//! Jobs as lines of JSON, their keys, and their division into parts.

use std::collections::HashMap;
use std::io::BufRead;
use std::str::FromStr;

use relief_base::sha256_of;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::annotations::KeptAnnotations;
use super::error::{JobError, ManifestError};
use super::names::is_name;
use super::product::Product;
use super::source::SeriesSource;
use relief_volume::Orbit;

/// One view of one series.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// See [`JobKey`].
    pub job: JobKey,
    /// The source of the series and its facts.
    pub series: SeriesSource,
    /// The view's name: part of the names of its files.
    pub view: String,
    /// The group of views that belong together, such as a turntable; empty for a single view.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub group: String,
    /// The scene, as in a scene file.
    pub scene: Value,
    /// Where from, around the volume; of no use to a scene that has a camera or a slice.
    #[serde(default)]
    pub orbit: Orbit,
    /// The outputs.
    pub products: Vec<Product>,
    /// The annotations, for outputs that draw them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub annotations: Option<KeptAnnotations>,
}

/// SHA-256, in hexadecimal digits, of all that a job's outputs depend on.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct JobKey(pub String);

/// One of several equal shares of the jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 0.
    pub index: u32,
    /// Their number.
    pub count: u32,
}

/// A text that is no share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a share is I/N with I from 0 to N-1, such as 0/4")]
pub struct InvalidShard;

impl FromStr for Shard {
    type Err = InvalidShard;

    fn from_str(text: &str) -> Result<Self, InvalidShard> {
        let parsed = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parsed {
            Some((index, count)) if index < count && count <= 100_000 => Ok(Self { index, count }),
            _ => Err(InvalidShard),
        }
    }
}

impl Shard {
    /// Whether a job is in this share. All views of a series are in the same one, so that it is
    /// loaded once.
    #[must_use]
    pub fn has(self, job: &Job) -> bool {
        let digits = job.series.sha256.get(..8).unwrap_or_default();
        // Jobs that were read have 64 digits.
        u32::from_str_radix(digits, 16).unwrap_or(0) % self.count == self.index
    }
}

impl Job {
    /// A job with the key of its content.
    #[must_use]
    pub fn new(
        series: SeriesSource,
        view: String,
        group: String,
        scene: Value,
        orbit: Orbit,
        products: Vec<Product>,
        annotations: Option<KeptAnnotations>,
    ) -> Self {
        let job = JobKey(String::new());
        let mut job = Self { job, series, view, group, scene, orbit, products, annotations };
        job.job = job.key();
        job
    }

    /// Series and view: the path of its files without their endings, below the folder of outputs.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}/{}", self.series.name, self.view)
    }

    /// The key of the inputs of its outputs. JSON objects are written with their keys sorted.
    fn key(&self) -> JobKey {
        let mut products: Vec<&str> = self.products.iter().map(|product| product.name()).collect();
        products.sort_unstable();
        let mut content = json!({
            "relief": env!("CARGO_PKG_VERSION"),
            "series": self.series.sha256,
            "scene": self.scene,
            "orbit": self.orbit,
            "products": products,
        });
        if let Some(annotations) = &self.annotations {
            content["annotations"] = annotations.sha256.clone().into();
        }
        if let Some(labels) = &self.series.labels {
            content["labels"] = labels.sha256.clone().into();
        }
        if let Some(first) = &self.series.first_phase {
            content["first_phase"] = first.sha256.clone().into();
        }
        JobKey(sha256_of(content.to_string().as_bytes()))
    }

    fn check(&self, line: usize) -> Result<(), ManifestError> {
        let wrong = |source| Err(ManifestError::Line { line, source });
        for (key, name) in [("series.name", &self.series.name), ("view", &self.view)] {
            if !is_name(name) {
                return wrong(JobError::Name { key, found: name.clone() });
            }
        }
        let hashes = [
            ("series.sha256", Some(&self.series.sha256)),
            ("series.labels.sha256", self.series.labels.as_ref().map(|labels| &labels.sha256)),
            ("series.first_phase.sha256", self.series.first_phase.as_ref().map(|first| &first.sha256)),
            ("annotations.sha256", self.annotations.as_ref().map(|kept| &kept.sha256)),
        ];
        for (what, hash) in hashes {
            if hash.is_some_and(|hex| hex.len() != 64 || !hex.bytes().all(|digit| digit.is_ascii_hexdigit()))
            {
                return wrong(JobError::Hash(what));
            }
        }
        if self.products.is_empty() {
            return wrong(JobError::NoProducts);
        }
        if self.annotations.is_none() && self.products.iter().any(|product| product.needs_annotations()) {
            return wrong(JobError::NoAnnotations);
        }
        let expected = self.key();
        if self.job != expected {
            return Err(ManifestError::Key { line, found: self.job.0.clone(), expected: expected.0 });
        }
        Ok(())
    }
}

/// Longest line of a manifest, bytes: a scene with many overlays.
const LONGEST_LINE: u64 = 16 << 20;

/// Reads a manifest: a job a line; empty lines are passed over.
///
/// # Errors
/// The first line that is no job, was altered after planning, or would write what another one
/// writes.
pub fn read_manifest(mut manifest: impl BufRead) -> Result<Vec<Job>, ManifestError> {
    let (mut jobs, mut lines, mut text) = (Vec::new(), HashMap::new(), Vec::new());
    for line in 1.. {
        text.clear();
        let wrong = |source| ManifestError::Line { line, source };
        let read = std::io::Read::take(&mut manifest, LONGEST_LINE).read_until(b'\n', &mut text);
        let read = read.map_err(|error| wrong(error.into()))?;
        if read as u64 == LONGEST_LINE {
            return Err(wrong(JobError::TooLong(LONGEST_LINE)));
        }
        if read == 0 {
            break;
        }
        if text.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        let mut reader = serde_json::Deserializer::from_slice(&text);
        let job: Job = serde_path_to_error::deserialize(&mut reader).map_err(|error| {
            wrong(JobError::Json { path: error.path().to_string(), source: error.into_inner() })
        })?;
        job.check(line)?;
        if let Some(first) = lines.insert(job.name(), line) {
            return Err(ManifestError::Twice { first, second: line, name: job.name() });
        }
        jobs.push(job);
    }
    Ok(jobs)
}
