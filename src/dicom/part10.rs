//! The file around a data set (PS3.10): preamble, file meta information, transfer syntax,
//! deflation.
//!
//! Files without preamble or meta information, as old archives have them, are taken when they begin
//! like a data set. The transfer syntax decides how elements are read here and how pixels are
//! decoded in `codec`.

use std::io::{Read, Seek, SeekFrom};

use dicom_dictionary_std::{tags, uids};
use dicom_encoding::transfer_syntax::TransferSyntaxIndex;
use dicom_transfer_syntax_registry::TransferSyntaxRegistry;
use parking_lot::{Mutex, MutexGuard};

use super::causes::DecodeError;
use super::dataset::{self, Bounds, Encoding, KeepOf, LocatedFault, ParsedDataSet};
use super::error::Defect;
use super::file_bytes::{Bytes, Reader};
use super::vr::is_vr;
use relief_base::Budget;

/// The largest deflated data set that is unpacked, in bytes: an enhanced CT of 1000 frames.
const LARGEST_INFLATED: u64 = 1 << 29;
/// Bytes that any thread may inflate at once: far more than a slice has. A larger data set waits
/// for its turn.
const SMALL_INFLATED: u64 = 1 << 25;
/// Bytes that are inflated at a time.
const INFLATED_PART: u64 = 1 << 20;
/// Retired by the standard, and so deprecated in the dictionary, but not by archives.
const EXPLICIT_VR_BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";

/// An opened file: the place and the encoding of its data set.
pub(super) struct Object {
    /// The bytes that hold the data set: the file's, or the inflated ones.
    pub(super) bytes: Bytes,
    /// The start of the data set in them.
    start: u64,
    pub(super) syntax: Syntax,
    /// Held as long as a large inflated data set is.
    _turn: Option<Turn>,
}

/// The turn of one large deflated data set: a file of half a megabyte may inflate to
/// [`LARGEST_INFLATED`] bytes, and without turns every thread could do so at once. The holder of
/// the turn waits for no other thread.
type Turn = MutexGuard<'static, ()>;

static TURN: Mutex<()> = Mutex::new(());

/// A transfer syntax.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Syntax {
    /// TransferSyntaxUID (0002,0010), or the UID of the guessed one.
    pub(super) uid: String,
    pub(super) encoding: Encoding,
    /// Whether the file did not say and the encoding was guessed.
    pub(super) guessed: bool,
    directory: bool,
}

/// The values of the file meta information.
#[derive(Default)]
struct Meta {
    syntax: Option<String>,
    class: Option<String>,
}

impl Object {
    /// Walks the data set up to Pixel Data; see [`dataset::walk`].
    pub(super) fn walk(&self, keep: KeepOf) -> Result<ParsedDataSet, Defect> {
        let (mut reader, end) = self.bytes.open()?;
        reader.seek(SeekFrom::Start(self.start))?;
        dataset::walk(&mut reader, self.start..end, self.syntax.encoding, keep)
    }

    /// Walks the data set within other bounds than images have; see [`dataset::walk_within`].
    pub(super) fn walk_within(&self, bounds: Bounds, keep: KeepOf) -> Result<ParsedDataSet, LocatedFault> {
        let at_top = |defect| LocatedFault { trail: Vec::new(), defect };
        let (mut reader, end) = self.bytes.open().map_err(at_top)?;
        reader.seek(SeekFrom::Start(self.start)).map_err(|error| at_top(error.into()))?;
        dataset::walk_within(bounds, &mut reader, self.start..end, self.syntax.encoding, keep)
    }

    /// Bytes of the inflated data set; 0 where none was deflated.
    pub(super) fn inflated_bytes(&self) -> u64 {
        match &self.bytes {
            Bytes::Memory(bytes) if self.syntax.uid == uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN => {
                bytes.len() as u64
            }
            _ => 0,
        }
    }

    /// Whether this is a DICOMDIR.
    pub(super) fn is_directory(&self) -> bool {
        self.syntax.directory
    }
}

impl Syntax {
    /// Whether pixels are stored as they are, in the data set's byte order.
    pub(super) fn is_native(&self) -> bool {
        matches!(
            self.uid.as_str(),
            uids::IMPLICIT_VR_LITTLE_ENDIAN
                | uids::EXPLICIT_VR_LITTLE_ENDIAN
                | EXPLICIT_VR_BIG_ENDIAN
                | uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN
        )
    }

    /// The name of the transfer syntax.
    pub(super) fn name(&self) -> &'static str {
        TransferSyntaxRegistry.get(&self.uid).map_or("unknown", |syntax| syntax.name())
    }
}

/// Opens a file as far as its data set.
///
/// # Errors
/// When it is not DICOM, or its beginning is cut short.
pub(super) fn open(bytes: Bytes, budget: &Budget) -> Result<Object, Defect> {
    let (mut reader, length) = bytes.open()?;
    let mut position = find_start(&mut reader)?;
    reader.seek(SeekFrom::Start(position))?;
    let meta = read_meta(&mut reader, &mut position, length)?;
    let syntax = syntax(&meta, &mut reader, position)?;
    if syntax.uid != uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN {
        return Ok(Object { bytes, start: position, syntax, _turn: None });
    }
    reader.seek(SeekFrom::Start(position))?;
    let (inflated, turn) = inflate(reader, budget)?;
    Ok(Object { bytes: Bytes::Memory(inflated), start: 0, syntax, _turn: turn })
}

/// The start of the file meta information or of the bare data set.
fn find_start(reader: &mut Reader) -> Result<u64, Defect> {
    let mut head = Vec::new();
    reader.by_ref().take(132).read_to_end(&mut head)?;
    if head.get(128..132) == Some(b"DICM") {
        return Ok(132);
    }
    if head.starts_with(b"DICM") {
        return Ok(4);
    }
    // A bare data set begins with file meta (0002,....), a file-set (0004,....) or identifying
    // group (0008,....).
    let plausible = match head.get(..8) {
        Some(&[2 | 4 | 8, 0, _, _, ..]) => guess_encoding(&head).is_some(),
        Some(&[0, 8, _, _, ..]) => guess_encoding(&head) == Some(Encoding::ExplicitBig),
        _ => false,
    };
    if plausible { Ok(0) } else { Err(Defect::NotDicom { found: describe(&head) }) }
}

fn describe(head: &[u8]) -> String {
    if head.is_empty() {
        return "an empty file".to_owned();
    }
    let shown: Vec<String> = head.iter().take(8).map(|byte| format!("{byte:02X}")).collect();
    format!("bytes {}", shown.join(" "))
}

/// How the element at the start of `head` is encoded; `None` when it does not look like an element.
fn guess_encoding(head: &[u8]) -> Option<Encoding> {
    let &[a, b, c, d, e, f, g, h] = head.first_chunk::<8>()?;
    if is_vr([e, f]) {
        // The first group is a small number; its high byte is zero in the file's byte order.
        return Some(if a == 0 && b != 0 { Encoding::ExplicitBig } else { Encoding::ExplicitLittle });
    }
    let length = u32::from_le_bytes([e, f, g, h]);
    let plausible = b == 0 && (c, d) != (0xFF, 0xFF) && length < 1 << 16;
    plausible.then_some(Encoding::ImplicitLittle)
}

/// Reads group 0002, whatever its group length says, since writers get it wrong.
fn read_meta(reader: &mut Reader, position: &mut u64, end: u64) -> Result<Meta, Defect> {
    let mut meta = Meta::default();
    loop {
        let before = *position;
        if end - before < 8 {
            return Ok(meta);
        }
        let header = dataset::read_header(reader, position, end, Encoding::ExplicitLittle)?;
        if header.tag.0 != 0x0002 {
            reader.seek(SeekFrom::Start(before))?;
            *position = before;
            return Ok(meta);
        }
        let length = u64::from(header.length.unwrap_or(0));
        let found = end - *position;
        if found < length {
            return Err(Defect::Short { tag: header.tag, found, expected: length });
        }
        match header.tag {
            tags::TRANSFER_SYNTAX_UID => meta.syntax = Some(read_uid(reader, length)?),
            tags::MEDIA_STORAGE_SOP_CLASS_UID => meta.class = Some(read_uid(reader, length)?),
            _ => {}
        }
        *position += length;
        reader.seek(SeekFrom::Start(*position))?;
    }
}

/// A UID: at most 64 characters (PS3.5 9.1); longer values are cut, and then match nothing.
fn read_uid(reader: &mut Reader, length: u64) -> Result<String, Defect> {
    let mut bytes = Vec::new();
    reader.by_ref().take(length.min(66)).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).trim_matches(['\0', ' ']).to_owned())
}

fn syntax(meta: &Meta, reader: &mut Reader, position: u64) -> Result<Syntax, Defect> {
    let directory = meta.class.as_deref() == Some(uids::MEDIA_STORAGE_DIRECTORY_STORAGE);
    if let Some(uid) = meta.syntax.clone().filter(|uid| !uid.is_empty()) {
        let encoding = match uid.as_str() {
            uids::IMPLICIT_VR_LITTLE_ENDIAN => Encoding::ImplicitLittle,
            EXPLICIT_VR_BIG_ENDIAN => Encoding::ExplicitBig,
            _ => Encoding::ExplicitLittle, // all compressed ones (PS3.5 A.4)
        };
        return Ok(Syntax { uid, encoding, guessed: false, directory });
    }
    reader.seek(SeekFrom::Start(position))?;
    let mut head = Vec::new();
    reader.by_ref().take(8).read_to_end(&mut head)?;
    let encoding = guess_encoding(&head).unwrap_or(Encoding::ImplicitLittle);
    let uid = match encoding {
        Encoding::ImplicitLittle => uids::IMPLICIT_VR_LITTLE_ENDIAN,
        Encoding::ExplicitLittle => uids::EXPLICIT_VR_LITTLE_ENDIAN,
        Encoding::ExplicitBig => EXPLICIT_VR_BIG_ENDIAN,
    };
    Ok(Syntax { uid: uid.to_owned(), encoding, guessed: true, directory })
}

fn inflate(reader: Reader, budget: &Budget) -> Result<(bytes::Bytes, Option<Turn>), Defect> {
    let damaged =
        |error: std::io::Error| Defect::Codec { codec: "deflate", source: DecodeError::decoder(error) };
    let mut decoder = flate2::read::DeflateDecoder::new(reader);
    let mut bytes = Vec::new();
    let mut turn = None;
    loop {
        let before = bytes.len() as u64;
        budget.unpack(INFLATED_PART)?;
        decoder.by_ref().take(INFLATED_PART).read_to_end(&mut bytes).map_err(damaged)?;
        let length = bytes.len() as u64;
        if length > LARGEST_INFLATED {
            return Err(Defect::LargeInflated { limit: LARGEST_INFLATED });
        }
        if length - before < INFLATED_PART {
            return Ok((bytes.into(), turn));
        }
        if length >= SMALL_INFLATED && turn.is_none() {
            turn = Some(TURN.lock()); // it guards no data
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn deflated(bytes: u64) -> Reader {
        let mut packed = Vec::new();
        flate2::read::DeflateEncoder::new(std::io::repeat(7).take(bytes), flate2::Compression::fast())
            .read_to_end(&mut packed)
            .unwrap();
        Bytes::Memory(packed.into()).open().unwrap().0
    }

    #[test]
    fn large_data_sets_are_inflated_one_at_a_time() {
        for (size, waits) in [(0, false), (9, false), (SMALL_INFLATED - 1, false), (SMALL_INFLATED + 9, true)]
        {
            let (bytes, turn) = inflate(deflated(size), &Budget::default()).unwrap();
            assert_eq!((bytes.len() as u64, turn.is_some()), (size, waits));
            assert!(bytes.iter().all(|&byte| byte == 7));
            assert!(!waits || TURN.is_locked());
        }
        let too_large = inflate(deflated(LARGEST_INFLATED + 1), &Budget::default());
        assert!(matches!(too_large, Err(Defect::LargeInflated { limit: LARGEST_INFLATED })));
    }
}
