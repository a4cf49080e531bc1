//! The first part of a multipart answer (RFC 2046), while the answer arrives.
//!
//! Keeps at most a header and a boundary in memory; bytes of the part are passed on as they come.

/// Longest header of a part, bytes.
const LONGEST_HEADER: usize = 16 << 10;
/// Longest boundary (RFC 2046).
const LONGEST_BOUNDARY: usize = 70;

/// Splits an answer of one part.
#[derive(Debug)]
pub(crate) struct PartReader {
    /// `--` and the boundary.
    dashed: Vec<u8>,
    state: State,
    /// Bytes that are not decided on yet.
    held: Vec<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Before the first boundary, or within the header behind it.
    Header,
    /// Within the part.
    Content,
    /// Behind it.
    Done,
}

/// Why an answer cannot be split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Malformed;

impl PartReader {
    /// A reader for an answer with this content type.
    pub(crate) fn of(content_type: &str) -> Result<Self, Malformed> {
        let boundary = boundary(content_type).ok_or(Malformed)?;
        Ok(Self { dashed: format!("--{boundary}").into_bytes(), state: State::Header, held: Vec::new() })
    }

    /// Takes bytes of the answer; the bytes that belong to the part.
    pub(crate) fn push(&mut self, bytes: &[u8]) -> Result<Vec<u8>, Malformed> {
        if self.state == State::Done {
            return Ok(Vec::new());
        }
        self.held.extend_from_slice(bytes);
        if self.state == State::Header {
            match self.header_end()? {
                None => return Ok(Vec::new()),
                Some(end) => drop(self.held.drain(..end)),
            }
            self.state = State::Content;
        }
        let delimiter = [b"\r\n", &*self.dashed].concat();
        if let Some(end) = memchr::memmem::find(&self.held, &delimiter) {
            self.state = State::Done;
            self.held.truncate(end);
            return Ok(std::mem::take(&mut self.held));
        }
        // The end may be the beginning of a delimiter.
        let certain = self.held.len().saturating_sub(delimiter.len() - 1);
        let rest = self.held.split_off(certain);
        Ok(std::mem::replace(&mut self.held, rest))
    }

    /// Whether the part has ended.
    pub(crate) fn is_done(&self) -> bool {
        self.state == State::Done
    }

    /// The place behind the header of the first part.
    fn header_end(&self) -> Result<Option<usize>, Malformed> {
        let begin = memchr::memmem::find(&self.held, &self.dashed).map(|at| at + self.dashed.len());
        let end =
            begin.and_then(|at| memchr::memmem::find(&self.held[at..], b"\r\n\r\n").map(|end| at + end + 4));
        match end {
            None if self.held.len() > LONGEST_HEADER => Err(Malformed),
            end => Ok(end),
        }
    }
}

fn boundary(content_type: &str) -> Option<&str> {
    let (kind, parameters) = content_type.split_once(';')?;
    if !kind.trim().to_ascii_lowercase().starts_with("multipart/") {
        return None;
    }
    // A quoted value, such as a media type, may have no `;` in DICOMweb.
    let value = parameters.split(';').find_map(|parameter| {
        let (name, value) = parameter.split_once('=')?;
        name.trim().eq_ignore_ascii_case("boundary").then(|| value.trim().trim_matches('"'))
    })?;
    (1..=LONGEST_BOUNDARY).contains(&value.len()).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TYPE: &str = "multipart/related; type=\"application/dicom\"; boundary=\"b1\"";

    fn split(answer: &[u8], step: usize) -> (Vec<u8>, bool) {
        let mut reader = PartReader::of(TYPE).unwrap();
        let mut part = Vec::new();
        for bytes in answer.chunks(step) {
            part.extend(reader.push(bytes).unwrap());
        }
        (part, reader.is_done())
    }

    proptest! {
        #[test]
        fn a_part_arrives_whole_in_pieces_of_any_size(
            content in proptest::collection::vec(prop_oneof![Just(b'\r'), Just(b'\n'), Just(b'-'), Just(b'b')], 0..80),
            step in 1_usize..20,
        ) {
            prop_assume!(memchr::memmem::find(&content, b"\r\n--b1").is_none());
            let head = b"a preamble\r\n--b1\r\nContent-Type: application/dicom\r\n\r\n";
            let answer = [&head[..], &content, b"\r\n--b1--\r\n"].concat();
            prop_assert_eq!(split(&answer, step), (content, true));
        }

        #[test]
        fn no_bytes_cause_a_panic(answer in proptest::collection::vec(any::<u8>(), 0..400), step in 1_usize..40) {
            let mut reader = PartReader::of(TYPE).unwrap();
            for bytes in answer.chunks(step) {
                let _ = reader.push(bytes);
            }
        }
    }

    #[test]
    fn a_part_that_was_cut_off_is_not_done() {
        assert_eq!(split(b"--b1\r\n\r\nwhole", 3), (b"".to_vec(), false));
        let long = [b"--b1\r\nA: b\r\n\r\n".to_vec(), vec![7; 100]].concat();
        let (part, is_done) = split(&long, 9);
        assert!(!is_done && part.len() < 100);
    }

    #[test]
    fn answers_that_are_not_multipart_are_refused() {
        for other in ["application/json", "multipart/related", "multipart/related; boundary="] {
            assert_eq!(PartReader::of(other).unwrap_err(), Malformed, "{other}");
        }
        let mut reader = PartReader::of(TYPE).unwrap();
        assert_eq!(reader.push(&[b'a'; LONGEST_HEADER + 1]), Err(Malformed));
    }
}
