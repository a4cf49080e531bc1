//! Recorded reports: one JSON object a line, with the time at which the report arrived.
//!
//! ```text
//! {"t_ns":1000000,"report":"33402086aaff..."}
//! ```
//!
//! `t_ns` counts nanoseconds from any start; `report` is hexadecimal, from the report's id on.
//! Blank lines are skipped, unknown keys are refused. Lines are bounded, so a file of any size is
//! read in little memory.

use std::io::{BufRead, Read};

use data_encoding::{HEXLOWER, HEXLOWER_PERMISSIVE};

use super::{InputReport, MAX_REPORT_BYTES, ReportError};

/// A longer line is no recorded report.
pub const MAX_LINE_BYTES: usize = 256;

/// A report and when it arrived.
#[derive(Clone, Debug, PartialEq)]
pub struct TimedReport {
    /// Nanoseconds from any start.
    pub t_ns: u64,
    /// The report.
    pub report: InputReport,
}

/// A recording that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be read.
    #[error("line {line}: {source}")]
    Read {
        /// Line, from 1.
        line: usize,
        /// The system's error.
        source: std::io::Error,
    },
    /// A line longer than any report.
    #[error(
        "line {line} is longer than {MAX_LINE_BYTES} bytes; expected {{\"t_ns\":..., \"report\":\"hex\"}}"
    )]
    TooLong {
        /// Line, from 1.
        line: usize,
    },
    /// A line that is not such an object.
    #[error("line {line}: {source}; expected {{\"t_ns\":..., \"report\":\"hex\"}}")]
    Json {
        /// Line, from 1.
        line: usize,
        /// The fault.
        source: serde_json::Error,
    },
    /// A report that is not hexadecimal.
    #[error("line {line}: the report is not 1 to {MAX_REPORT_BYTES} bytes in hexadecimal")]
    Hex {
        /// Line, from 1.
        line: usize,
    },
    /// Bytes that are no report.
    #[error("line {line}: {source}")]
    Report {
        /// Line, from 1.
        line: usize,
        /// Why.
        source: ReportError,
    },
}

#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    t_ns: u64,
    report: String,
}

/// Reads a recording report by report.
#[derive(Debug)]
pub struct RecordingReader<R> {
    source: R,
    buffer: Vec<u8>,
    line: usize,
}

impl<R: BufRead> RecordingReader<R> {
    /// Reads from `source`.
    pub fn new(source: R) -> Self {
        Self { source, buffer: Vec::new(), line: 0 }
    }

    /// The number of the line that was read last, from 1.
    #[must_use]
    pub fn line(&self) -> usize {
        self.line
    }

    /// The next line without its end; `None` at the end of the file.
    fn next_line(&mut self) -> Result<Option<&[u8]>, RecordingError> {
        loop {
            self.buffer.clear();
            self.line += 1;
            let line = self.line;
            let mut bounded = (&mut self.source).take(MAX_LINE_BYTES as u64 + 1);
            let read = bounded.read_until(b'\n', &mut self.buffer);
            if read.map_err(|source| RecordingError::Read { line, source })? == 0 {
                return Ok(None);
            }
            if self.buffer.len() > MAX_LINE_BYTES {
                return Err(RecordingError::TooLong { line });
            }
            if !self.buffer.trim_ascii().is_empty() {
                return Ok(Some(self.buffer.trim_ascii()));
            }
        }
    }

    fn next_report(&mut self) -> Result<Option<TimedReport>, RecordingError> {
        let Some(text) = self.next_line()? else { return Ok(None) };
        let parsed = serde_json::from_slice::<Line>(text);
        let line = self.line;
        let Line { t_ns, report } = parsed.map_err(|source| RecordingError::Json { line, source })?;
        let bytes = bytes_of_hex(&report).ok_or(RecordingError::Hex { line })?;
        let report = InputReport::decode(&bytes).map_err(|source| RecordingError::Report { line, source })?;
        Ok(Some(TimedReport { t_ns, report }))
    }
}

impl<R: BufRead> Iterator for RecordingReader<R> {
    type Item = Result<TimedReport, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_report().transpose()
    }
}

/// The line of a recording for this report, without its end.
#[must_use]
pub fn recording_line(t_ns: u64, report: &[u8]) -> String {
    format!("{{\"t_ns\":{t_ns},\"report\":\"{}\"}}", hex_of_bytes(report))
}

/// Two digits a byte.
#[must_use]
pub fn hex_of_bytes(bytes: &[u8]) -> String {
    HEXLOWER.encode(bytes)
}

/// Bytes of hexadecimal digits, 1 to 22 of them; `None` for anything else.
#[must_use]
pub fn bytes_of_hex(text: &str) -> Option<Vec<u8>> {
    let is_allowed = (2..=2 * MAX_REPORT_BYTES).contains(&text.len());
    is_allowed.then(|| HEXLOWER_PERMISSIVE.decode(text.as_bytes()).ok()).flatten()
}
