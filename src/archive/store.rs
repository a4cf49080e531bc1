//! Storage by STOW-RS, PS3.18 10.5: one object a request.
//!
//! An object that the archive already has is not sent again.

use bytes::Bytes;
use reqwest::StatusCode;
use serde_json::Value;

use crate::client::Archive;
use crate::error::ArchiveError;
use crate::search::JSON;

/// Largest answer to the storage of one object, bytes.
const LARGEST_OUTCOME: u64 = 1 << 20;

/// A DICOM file with the UIDs that it has.
#[derive(Clone)]
pub struct OutgoingObject {
    /// Of its study.
    pub study: String,
    /// Of its series.
    pub series: String,
    /// Of the object.
    pub instance: String,
    /// The file.
    pub file: Bytes,
}

/// The outcome of storing an object in an archive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreOutcome {
    /// It was stored.
    Stored,
    /// The archive had an object of this UID.
    AlreadyThere,
    /// The archive did not store it.
    Refused {
        /// Failure Reason (0008,1197), PS3.18 table I.2-2; absent if it gives none.
        reason: Option<u16>,
    },
}

impl Archive {
    /// Stores an object, unless the archive has it.
    ///
    /// # Errors
    /// When the archive does not answer, refuses access, or does not store objects by DICOMweb.
    pub fn store(&self, object: &OutgoingObject) -> Result<StoreOutcome, ArchiveError> {
        self.runtime.block_on(async {
            if self.tried(async || self.has(object).await).await? {
                return Ok(StoreOutcome::AlreadyThere);
            }
            let (kind, body) = body_of(&object.file);
            self.tried(async || self.sent(&kind, body.clone()).await).await
        })
    }

    async fn has(&self, object: &OutgoingObject) -> Result<bool, ArchiveError> {
        let OutgoingObject { study, series, instance, .. } = object;
        let path = format!("/studies/{study}/series/{series}/instances");
        match self.page(&path, &[("SOPInstanceUID", instance)], "object").await {
            // Some archives ignore the attribute, and list all instances.
            Ok(found) => Ok(found.matches.iter().any(|one| one.uid("00080018").as_deref() == Some(instance))),
            Err(ArchiveError::Missing { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }

    async fn sent(&self, kind: &str, body: Bytes) -> Result<StoreOutcome, ArchiveError> {
        let response = self.post("/studies", kind, JSON, body).await?;
        let status = response.status();
        if !matches!(status, StatusCode::OK | StatusCode::ACCEPTED | StatusCode::CONFLICT) {
            self.successful(response, "service for storage (STOW-RS)")?;
            return Err(self.answer("another status", "the outcome of a storage"));
        }
        let answer = self.body(response, LARGEST_OUTCOME).await?;
        let not_json = || self.answer("something else", "the outcome of a storage in DICOM's JSON");
        let answer = serde_json::from_slice::<Value>(&answer).map_err(|_| not_json())?;
        // Some archives put the outcome into a list.
        let answer = answer.get(0).unwrap_or(&answer);
        let failed = answer.get("00081198").and_then(|failed| failed.get("Value")?.get(0));
        let is_stored = answer.get("00081199").is_some_and(|stored| stored.get("Value").is_some());
        match failed {
            None if is_stored && status != StatusCode::CONFLICT => return Ok(StoreOutcome::Stored),
            None if status != StatusCode::CONFLICT => return Err(not_json()),
            _ => {}
        }
        let reason = failed.and_then(|failed| failed.get("00081197")?.get("Value")?.get(0)?.as_u64());
        Ok(StoreOutcome::Refused { reason: reason.and_then(|reason| u16::try_from(reason).ok()) })
    }
}

/// Content type and body of a request with one file.
fn body_of(file: &[u8]) -> (String, Bytes) {
    // A boundary that the file does not contain.
    let boundary = (0_u64..)
        .map(|number| format!("relief-{number:016x}"))
        .find(|boundary| memchr::memmem::find(file, boundary.as_bytes()).is_none())
        .unwrap_or_default();
    let head = format!("--{boundary}\r\nContent-Type: application/dicom\r\n\r\n");
    let body = [head.as_bytes(), file, format!("\r\n--{boundary}--\r\n").as_bytes()].concat();
    (format!("multipart/related; type=\"application/dicom\"; boundary={boundary}"), body.into())
}

/// UIDs are withheld.
impl std::fmt::Debug for OutgoingObject {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OutgoingObject").field("bytes", &self.file.len()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::part::PartReader;

    #[test]
    fn a_file_with_the_boundary_in_it_arrives_whole() {
        let file = b"DICM relief-0000000000000000 \r\n--relief-0000000000000001--\r\n";
        let (kind, body) = body_of(file);
        let mut reader = PartReader::of(&kind).unwrap();
        assert_eq!(reader.push(&body).unwrap(), file);
        assert!(reader.is_done());
    }
}
