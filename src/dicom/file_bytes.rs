//! The bytes of a file, on disk or in memory, and a buffered reader of either.

use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::PathBuf;

use super::error::Defect;

/// A file's bytes, on disk or in memory.
pub(super) enum Bytes {
    Disk(PathBuf),
    Memory(bytes::Bytes),
    /// The first bytes of a zip entry, and its size.
    Beginning(bytes::Bytes, u64),
}

/// A reader of either.
pub(super) enum Reader {
    Disk(BufReader<File>),
    Memory(Cursor<bytes::Bytes>),
}

impl Bytes {
    /// A reader at the start, and the length in bytes.
    pub(super) fn open(&self) -> Result<(Reader, u64), Defect> {
        match self {
            Self::Disk(path) => {
                let file = File::open(path)?;
                let length = file.metadata()?.len();
                Ok((Reader::Disk(BufReader::new(file)), length))
            }
            Self::Memory(bytes) => Ok((Reader::Memory(Cursor::new(bytes.clone())), bytes.len() as u64)),
            Self::Beginning(bytes, length) => Ok((Reader::Memory(Cursor::new(bytes.clone())), *length)),
        }
    }

    /// Fills `target` with the bytes from `position` on.
    pub(super) fn read_exact_at(&self, position: u64, target: &mut [u8]) -> Result<(), Defect> {
        match self {
            Self::Disk(path) => {
                let mut file = File::open(path)?;
                file.seek(SeekFrom::Start(position))?;
                file.read_exact(target)?;
            }
            Self::Memory(bytes) | Self::Beginning(bytes, _) => {
                let mut cursor = Cursor::new(bytes);
                cursor.set_position(position);
                cursor.read_exact(target)?;
            }
        }
        Ok(())
    }
}

impl Read for Reader {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        match self {
            Self::Disk(reader) => reader.read(buffer),
            Self::Memory(reader) => reader.read(buffer),
        }
    }
}

impl std::io::BufRead for Reader {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        match self {
            Self::Disk(reader) => reader.fill_buf(),
            Self::Memory(reader) => reader.fill_buf(),
        }
    }

    fn consume(&mut self, amount: usize) {
        match self {
            Self::Disk(reader) => reader.consume(amount),
            Self::Memory(reader) => reader.consume(amount),
        }
    }
}

impl Seek for Reader {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        match self {
            Self::Disk(reader) => reader.seek(to),
            Self::Memory(reader) => reader.seek(to),
        }
    }

    // The default would seek from the start and drop the buffer, a system call for every skipped
    // element.
    fn seek_relative(&mut self, offset: i64) -> std::io::Result<()> {
        match self {
            Self::Disk(reader) => reader.seek_relative(offset),
            Self::Memory(reader) => reader.seek_relative(offset),
        }
    }
}
