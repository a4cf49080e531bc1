//! Bytes and words of a file, with the place where they are.

use super::format::{MeshFileError, MeshFilePlace, MeshFormat};

/// Goes through bytes from front to back.
pub(super) struct Bytes<'a> {
    format: MeshFormat,
    bytes: &'a [u8],
    /// The next byte.
    pub(super) at: usize,
}

impl<'a> Bytes<'a> {
    pub(super) fn new(format: MeshFormat, bytes: &'a [u8], at: usize) -> Self {
        Self { format, bytes, at }
    }

    pub(super) fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    /// The next `count` bytes.
    pub(super) fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], MeshFileError> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let Some(end) = end else {
            let found = format!("the end after {} bytes", self.left());
            let expected = format!("{count} bytes of {what}");
            return Err(MeshFileError::new(self.format, MeshFilePlace::Byte(self.at), found, expected));
        };
        let part = &self.bytes[self.at..end];
        self.at = end;
        Ok(part)
    }

    pub(super) fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], MeshFileError> {
        let part = self.take(N, what)?;
        Ok(std::array::from_fn(|n| part[n]))
    }

    pub(super) fn u32(&mut self, what: &str) -> Result<u32, MeshFileError> {
        self.array(what).map(u32::from_le_bytes)
    }
}

/// Lines of text with their numbers, from 1, without blanks around them. Bytes that are no UTF-8
/// are replaced.
pub(super) fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, std::borrow::Cow<'_, str>)> {
    let lines = bytes.split(|byte| *byte == b'\n');
    (1..).zip(lines.map(|line| String::from_utf8_lossy(line.trim_ascii())))
}

/// As [`lines`]; a line that ends with a backslash goes on in the next one, and has the number of the
/// first.
pub(super) fn continued_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, std::borrow::Cow<'_, str>)> {
    let mut lines = lines(bytes);
    std::iter::from_fn(move || {
        let (number, mut text) = lines.next()?;
        while let Some(begun) = text.strip_suffix('\\') {
            let begun = format!("{begun} ");
            text = begun.into();
            let Some((_, rest)) = lines.next() else { break };
            text.to_mut().push_str(&rest);
        }
        Some((number, text))
    })
}

/// A finite number.
pub(super) fn number(format: MeshFormat, line: usize, word: Option<&str>) -> Result<f64, MeshFileError> {
    let found = word.unwrap_or("the end of the line");
    found
        .parse::<f64>()
        .ok()
        .filter(|number| number.is_finite())
        .ok_or_else(|| MeshFileError::new(format, MeshFilePlace::Line(line), found, "a finite number"))
}
