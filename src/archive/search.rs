//! Search by QIDO-RS: the series that match an address, and the instances of a series.

use std::collections::BTreeSet;
use std::time::Duration;

use reqwest::header::WARNING;
use reqwest::{Response, StatusCode};
use serde::Serialize;

use crate::address::ArchiveAddress;
use crate::client::Archive;
use crate::error::{ArchiveError, Total};
use crate::matches::{Match, Matches};

/// Matches that one answer may have.
const PAGE: usize = 1_000;
/// Most series of one search.
const MOST_SERIES: usize = 10_000;
/// Most instances of one series.
const MOST_INSTANCES: usize = 200_000;
/// Largest answer, bytes.
const LARGEST_ANSWER: u64 = 64 << 20;
/// Most bytes of all answers of one search.
const LARGEST_SEARCH: u64 = 256 << 20;
/// Longest time of a search, all of its pages and tries together.
const LONGEST_SEARCH: Duration = Duration::from_secs(60);
/// Longest time of listing the instances of a series, which may have many pages.
const LONGEST_LISTING: Duration = Duration::from_secs(120);
pub(crate) const JSON: &str = "application/dicom+json";

/// A series that an archive has. Its texts come from the archive and may name the patient.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FoundSeries {
    /// UID of its study.
    pub study_uid: String,
    /// Its UID.
    pub series_uid: String,
    /// Such as CT.
    pub modality: String,
    /// Date of the study, YYYYMMDD; empty if unknown.
    pub study_date: String,
    /// Name of the patient.
    pub patient_name: String,
    /// Id of the patient.
    pub patient_id: String,
    /// Description of the study.
    pub study_description: String,
    /// Description of the series.
    pub description: String,
    /// Body part, as the scanner calls it.
    pub body_part: String,
    /// Number of its instances, if the archive knows it.
    pub instances: Option<u64>,
}

/// Attributes that are wanted beside those that a search always returns.
const FIELDS: [&str; 7] = [
    "PatientName",
    "PatientID",
    "StudyDate",
    "SeriesDescription",
    "StudyDescription",
    "BodyPartExamined",
    "NumberOfSeriesRelatedInstances",
];

/// One answer to a search.
pub(crate) struct Page {
    pub(crate) matches: Vec<Match>,
    /// Bytes of the answer.
    bytes: u64,
    /// Whether the answer announces further matches.
    has_more: bool,
}

impl Archive {
    /// The series that match an address, by date of the study, study and series.
    ///
    /// # Errors
    /// When the archive does not answer, refuses, or answers with anything but a list of series.
    pub fn series(&self, address: &ArchiveAddress) -> Result<Vec<FoundSeries>, ArchiveError> {
        let path = match address.study() {
            Some(study) => format!("/studies/{study}/series"),
            None => "/series".to_owned(),
        };
        let mut query: Vec<(&str, &str)> =
            address.query().iter().map(|(name, value)| (&**name, &**value)).collect();
        query.extend(address.series().map(|series| ("SeriesInstanceUID", series)));
        query.extend(FIELDS.map(|field| ("includefield", field)));
        let found = self.all(&path, &query, "0020000E", MOST_SERIES, "series");
        let found = self.runtime.block_on(self.within(LONGEST_SEARCH, found))?;
        let mut series: Vec<FoundSeries> =
            found.iter().filter_map(|attributes| FoundSeries::of(attributes, address)).collect();
        series.sort_by(|a, b| {
            let key =
                |one: &FoundSeries| (one.study_date.clone(), one.study_uid.clone(), one.series_uid.clone());
            key(a).cmp(&key(b))
        });
        Ok(series)
    }

    /// The UIDs of the instances of a series, sorted.
    ///
    /// # Errors
    /// As for [`Archive::series`]; also when the series has no instances, or when the archive lists
    /// fewer instances than it counts.
    pub(crate) fn instances(&self, study: &str, series: &str) -> Result<Vec<String>, ArchiveError> {
        let path = format!("/studies/{study}/series/{series}/instances");
        let found = self.all(&path, &[], "00080018", MOST_INSTANCES, "series");
        let found = self.runtime.block_on(self.within(LONGEST_LISTING, found))?;
        let uids: BTreeSet<String> =
            found.iter().filter_map(|attributes| attributes.uid("00080018")).collect();
        if uids.is_empty() {
            return Err(self.missing("series"));
        }
        match self.runtime.block_on(self.within(LONGEST_SEARCH, self.counted(study, series)))? {
            Some(count) if count > uids.len() as u64 => {
                Err(self.incomplete(uids.len(), Total::Instances(count)))
            }
            _ => Ok(uids.into_iter().collect()),
        }
    }

    /// The number of a series' instances, where the archive counts them.
    async fn counted(&self, study: &str, series: &str) -> Result<Option<u64>, ArchiveError> {
        const COUNT: &str = "NumberOfSeriesRelatedInstances";
        let path = format!("/studies/{study}/series");
        let query = [("SeriesInstanceUID", series), ("includefield", COUNT)];
        let page = match self.tried(async || self.page(&path, &query, "series").await).await {
            // Some archives list instances but do not support this search.
            Err(ArchiveError::Missing { .. } | ArchiveError::Status { status: 400..=499 | 501, .. }) => {
                return Ok(None);
            }
            page => page?,
        };
        let is_wanted = |found: &&Match| found.text("0020000E") == series;
        Ok(page.matches.iter().find(is_wanted).and_then(|found| found.text("00201209").parse().ok()))
    }

    fn incomplete(&self, found: usize, expected: Total) -> ArchiveError {
        ArchiveError::Incomplete { archive: self.base.clone(), found, expected }
    }

    /// All matches, page by page. Archives that ignore `offset` send one page again and again: a
    /// page without a new `key` is the last one. If that page announces more matches, the list is
    /// incomplete, which is an error.
    async fn all(
        &self,
        path: &str,
        query: &[(&str, &str)],
        key: &str,
        most: usize,
        wanted: &'static str,
    ) -> Result<Vec<Match>, ArchiveError> {
        let (mut found, mut known) = (Vec::new(), BTreeSet::new());
        let (mut offset, mut has_more, mut bytes) = (0, false, 0);
        loop {
            let [limit, at] = [PAGE.to_string(), offset.to_string()];
            let paged = [query, &[("limit", &*limit), ("offset", &*at)]].concat();
            let page = self.tried(async || self.page(path, &paged, wanted).await).await?;
            let (count, before) = (page.matches.len(), found.len());
            bytes += page.bytes;
            if bytes > LARGEST_SEARCH {
                return Err(self.too_large(LARGEST_SEARCH, "bytes in answer to one search; narrow the query"));
            }
            has_more = page.has_more || (count == 0 && has_more);
            found.extend(page.matches.into_iter().filter(|attributes| match attributes.uid(key) {
                Some(uid) => known.insert(uid),
                None => false,
            }));
            if found.len() > most {
                return Err(self.too_large(most as u64, "matches; narrow the query"));
            }
            if count == 0 || found.len() == before {
                return if has_more { Err(self.incomplete(found.len(), Total::More)) } else { Ok(found) };
            }
            offset += count;
        }
    }

    pub(crate) async fn page(
        &self,
        path: &str,
        query: &[(&str, &str)],
        wanted: &'static str,
    ) -> Result<Page, ArchiveError> {
        let response = self.get(path, query, JSON, wanted).await?;
        if response.status() == StatusCode::NO_CONTENT {
            return Ok(Page { matches: Vec::new(), bytes: 0, has_more: false });
        }
        let has_more = has_more(&response);
        let body = self.body(response, LARGEST_ANSWER).await?;
        let Matches(matches) = serde_json::from_slice(&body)
            .map_err(|_| self.answer("something else", "a list in DICOM's JSON"))?;
        Ok(Page { matches, bytes: body.len() as u64, has_more })
    }
}

/// Whether an answer to a search has only a part of the matches: status 206, or a warning about
/// "additional results" (PS3.18 8.3.4.4). The number of the warning, 299, is not enough: other
/// warnings have it too.
fn has_more(response: &Response) -> bool {
    let is_cut =
        |warning: &[u8]| String::from_utf8_lossy(warning).to_ascii_lowercase().contains("additional results");
    response.status() == StatusCode::PARTIAL_CONTENT
        || response.headers().get_all(WARNING).iter().any(|warning| is_cut(warning.as_bytes()))
}

impl FoundSeries {
    /// A match without usable UIDs is left out: it cannot be retrieved.
    fn of(attributes: &Match, address: &ArchiveAddress) -> Option<Self> {
        let study = attributes.uid("0020000D").or_else(|| address.study().map(str::to_owned))?;
        let series_uid = attributes.uid("0020000E")?;
        let one = |tag: &str| attributes.text(tag).to_owned();
        Some(Self {
            study_uid: study,
            series_uid,
            modality: one("00080060"),
            study_date: one("00080020"),
            patient_name: one("00100010"),
            patient_id: one("00100020"),
            study_description: one("00081030"),
            description: one("0008103E"),
            body_part: one("00180015"),
            instances: one("00201209").parse().ok(),
        })
    }
}
