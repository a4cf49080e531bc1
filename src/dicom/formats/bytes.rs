//! A file's bytes, unpacked where it is gzipped, and its first bytes.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use super::FormatError;

/// The format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum VolumeFormat {
    Nifti,
    Nrrd,
}

/// A file as it is read from front to back.
pub(super) struct Source<'a> {
    reader: BufReader<Box<dyn Read + Send + 'a>>,
}

const GZIP: [u8; 2] = [0x1f, 0x8b];

impl<'a> Source<'a> {
    /// Opens a file; one that begins as gzip does is unpacked on the way.
    pub(super) fn open(path: &Path) -> Result<Self, FormatError> {
        let failed = |source| FormatError::Read { path: path.to_owned(), source };
        Self::new(BufReader::new(File::open(path).map_err(failed)?)).map_err(failed)
    }

    /// A file that is in memory; gzip is unpacked on the way.
    pub(super) fn of_bytes(bytes: &'a [u8]) -> Result<Self, FormatError> {
        Self::new(bytes).map_err(FormatError::Damaged)
    }

    fn new(mut file: impl BufRead + Send + 'a) -> std::io::Result<Self> {
        let is_packed = file.fill_buf()?.starts_with(&GZIP);
        let reader: Box<dyn Read + Send + 'a> =
            if is_packed { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
        Ok(Self { reader: BufReader::with_capacity(1 << 16, reader) })
    }

    /// The format, by the first bytes, which stay to be read.
    pub(super) fn kind(&mut self) -> Result<VolumeFormat, FormatError> {
        let head = self.reader.fill_buf().map_err(FormatError::Damaged)?;
        let size =
            head.first_chunk().map(|four: &[u8; 4]| [i32::from_le_bytes(*four), i32::from_be_bytes(*four)]);
        if head.starts_with(b"NRRD0") {
            return Ok(VolumeFormat::Nrrd);
        }
        if size.is_some_and(|sizes| sizes.iter().any(|size| [348, 540].contains(size))) {
            return Ok(VolumeFormat::Nifti);
        }
        let shown: Vec<String> = head.iter().take(8).map(|byte| format!("{byte:02X}")).collect();
        let found =
            if shown.is_empty() { "nothing".to_owned() } else { format!("bytes {}", shown.join(" ")) };
        Err(FormatError::Unknown { found })
    }

    /// A small number of bytes.
    pub(super) fn take(&mut self, count: usize) -> Result<Vec<u8>, FormatError> {
        let mut bytes = Vec::new();
        self.reader.by_ref().take(count as u64).read_to_end(&mut bytes).map_err(FormatError::Damaged)?;
        if bytes.len() < count {
            return Err(FormatError::Cut { expected: count as u64, found: bytes.len() as u64 });
        }
        Ok(bytes)
    }

    /// A line without its end, of at most `longest` bytes; `None` where the file ends.
    pub(super) fn line(&mut self, longest: usize) -> Result<Option<String>, FormatError> {
        let mut bytes = Vec::new();
        let most = longest as u64 + 1;
        self.reader.by_ref().take(most).read_until(b'\n', &mut bytes).map_err(FormatError::Damaged)?;
        if bytes.is_empty() {
            return Ok(None);
        }
        if bytes.len() > longest && bytes.last() != Some(&b'\n') {
            let allowed = format!("lines of at most {longest} bytes");
            return Err(FormatError::header("the header", "a longer line", allowed));
        }
        let text = String::from_utf8_lossy(&bytes);
        Ok(Some(text.trim_end_matches(['\r', '\n']).to_owned()))
    }

    /// Reads the rest as gzip; the bytes before must not have been gzip.
    pub(super) fn unpack_rest(&mut self) {
        let packed = std::mem::replace(&mut self.reader, BufReader::new(Box::new(std::io::empty())));
        self.reader = BufReader::with_capacity(1 << 16, Box::new(MultiGzDecoder::new(packed)));
    }

    /// Up to `buffer.len()` bytes, fewer only where the file ends.
    pub(super) fn fill(&mut self, buffer: &mut [u8]) -> Result<usize, FormatError> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.reader.read(&mut buffer[filled..]).map_err(FormatError::Damaged)? {
                0 => break,
                count => filled += count,
            }
        }
        Ok(filled)
    }
}
