//! A bounded walk over a DICOM data set that keeps the few attributes a CT volume needs.
//!
//! This reader of element headers (PS3.5 section 7) skips unneeded elements and records where Pixel
//! Data begins, so that pixels later go from the file into the volume in one copy. It is not a
//! complete object model. A general parser builds nested sequences by recursion, and a few
//! kilobytes of nested items then overflow the stack, which no caller can catch. Here skipping is a
//! loop, and kept sequences have a depth limit.
//!
//! Units: positions and lengths in bytes from the start of the source.

use std::io::{BufRead, Seek};
use std::ops::Range;

use dicom_core::Tag;
use dicom_dictionary_std::tags;

use super::error::Defect;
use super::vr::{has_long_length, is_vr};

/// How elements are written: implicit or explicit VR, and the byte order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    ImplicitLittle,
    ExplicitLittle,
    ExplicitBig,
}

/// The part of an element that is kept, by its tag.
pub(super) type KeepOf = fn(Tag) -> Retention;

/// The treatment of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Retention {
    Nothing,
    Value,
    Items,
}

/// The kept elements of a data set or sequence item, in file order.
#[derive(Clone, Debug, Default)]
pub(super) struct DataSet {
    elements: Vec<(Tag, Value)>,
}

/// A kept element's value.
#[derive(Clone, Debug)]
enum Value {
    Bytes { bytes: Vec<u8>, big_endian: bool },
    Items(Vec<DataSet>),
}

/// The place of Pixel Data in the source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PixelElement {
    /// Position of the first byte of the value.
    pub(super) position: u64,
    /// Length of the value; `None` when encapsulated (undefined length).
    pub(super) length: Option<u64>,
}

/// A walked data set: the kept elements, and the Pixel Data if there is any.
#[derive(Clone, Debug)]
pub(super) struct ParsedDataSet {
    pub(super) data: DataSet,
    pub(super) pixels: Option<PixelElement>,
}

/// An element's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) tag: Tag,
    pub(super) vr: [u8; 2],
    /// `None` for undefined length.
    pub(super) length: Option<u32>,
}

/// The longest value that is kept. The attributes wanted here are numbers, codes and UIDs; offset
/// tables apart.
const LONGEST_VALUE: u32 = 1 << 16;
/// The longest Extended Offset Table: 8 bytes per frame.
const LONGEST_OFFSET_TABLE: u32 = 1 << 24;
/// Functional groups nest two deep (group, macro item); directory records one.
const DEEPEST_KEPT: u32 = 4;
/// Begins an item of a sequence, or a fragment of encapsulated Pixel Data.
pub(super) const ITEM: Tag = Tag(0xFFFE, 0xE000);
/// Ends an item of undefined length.
const ITEM_DELIMITATION: Tag = Tag(0xFFFE, 0xE00D);
/// Ends a sequence of undefined length.
pub(super) const SEQUENCE_DELIMITATION: Tag = Tag(0xFFFE, 0xE0DD);
const UNDEFINED: u32 = u32::MAX;

impl DataSet {
    /// The raw bytes of a kept value.
    pub(super) fn bytes(&self, tag: Tag) -> Option<&[u8]> {
        match self.value(tag)? {
            Value::Bytes { bytes, .. } => Some(bytes),
            Value::Items(_) => None,
        }
    }

    /// A text value without its padding; `None` when absent.
    pub(super) fn text(&self, tag: Tag) -> Option<String> {
        let text = String::from_utf8_lossy(self.bytes(tag)?);
        Some(text.trim_matches(['\0', ' ', '\t', '\r', '\n']).to_owned())
    }

    /// An unsigned integer of two or four bytes; `Err` holds the number of bytes if
    /// it is another.
    pub(super) fn unsigned(&self, tag: Tag) -> Result<Option<u32>, usize> {
        let Some(Value::Bytes { bytes, big_endian }) = self.value(tag) else {
            return Ok(None);
        };
        match (bytes.as_slice(), big_endian) {
            ([], _) => Ok(None),
            (&[a, b], false) => Ok(Some(u16::from_le_bytes([a, b]).into())),
            (&[a, b], true) => Ok(Some(u16::from_be_bytes([a, b]).into())),
            (&[a, b, c, d], false) => Ok(Some(u32::from_le_bytes([a, b, c, d]))),
            (&[a, b, c, d], true) => Ok(Some(u32::from_be_bytes([a, b, c, d]))),
            _ => Err(bytes.len()),
        }
    }

    /// Unsigned 16-bit integers; none when absent.
    pub(super) fn words(&self, tag: Tag) -> Vec<u16> {
        let Some(Value::Bytes { bytes, big_endian }) = self.value(tag) else { return Vec::new() };
        let word = |pair: &[u8]| {
            let pair = [pair[0], pair[1]];
            if *big_endian { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) }
        };
        bytes.chunks_exact(2).map(word).collect()
    }

    /// 32-bit floats, and the number of bytes left over; none when absent.
    pub(super) fn floats(&self, tag: Tag) -> (Vec<f32>, usize) {
        let Some(Value::Bytes { bytes, big_endian }) = self.value(tag) else { return (Vec::new(), 0) };
        let (whole, rest) = bytes.as_chunks::<4>();
        let float =
            |&four: &[u8; 4]| if *big_endian { f32::from_be_bytes(four) } else { f32::from_le_bytes(four) };
        (whole.iter().map(float).collect(), rest.len())
    }

    /// The items of a kept sequence; none when absent.
    pub(super) fn items(&self, tag: Tag) -> &[Self] {
        match self.value(tag) {
            Some(Value::Items(items)) => items,
            _ => &[],
        }
    }

    fn value(&self, tag: Tag) -> Option<&Value> {
        self.elements.iter().find(|(t, _)| *t == tag).map(|(_, value)| value)
    }
}

/// The depth of kept sequences, the length of kept values, and the memory of all of them, at
/// most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Bounds {
    pub(super) deepest: u32,
    pub(super) longest_value: u32,
    /// Bytes of memory of all kept elements and items. Empty ones count, too: each takes a place in
    /// a list.
    pub(super) kept_bytes: u64,
}

impl Bounds {
    /// Those of images: kept attributes for 50,000 frames.
    pub(super) const IMAGES: Self =
        Self { deepest: DEEPEST_KEPT, longest_value: LONGEST_VALUE, kept_bytes: 64 << 20 };
    /// Those of CT slices, whose kept attributes are numbers, codes and UIDs.
    pub(super) const SLICES: Self = Self { longest_value: 1 << 10, ..Self::IMAGES };
}

/// A fault of a data set, and its path: sequences, and item numbers from 1.
#[derive(Debug)]
pub(super) struct LocatedFault {
    pub(super) trail: Vec<(Tag, usize)>,
    pub(super) defect: Defect,
}

/// Walks the data set that begins at the reader's position and stops at Pixel Data or at `end`.
///
/// # Errors
/// When an element is cut short, or items nest deeper than any standard sequence.
pub(super) fn walk<R: BufRead + Seek>(
    source: &mut R,
    range: Range<u64>,
    encoding: Encoding,
    keep: KeepOf,
) -> Result<ParsedDataSet, Defect> {
    walk_within(Bounds::IMAGES, source, range, encoding, keep).map_err(|located| located.defect)
}

/// As [`walk`], within other bounds.
///
/// # Errors
/// As [`walk`], with the place.
pub(super) fn walk_within<R: BufRead + Seek>(
    bounds: Bounds,
    source: &mut R,
    range: Range<u64>,
    encoding: Encoding,
    keep: KeepOf,
) -> Result<ParsedDataSet, LocatedFault> {
    let Range { start, end } = range;
    let mut walker = DataSetReader { source, position: start, end, keep, bounds, kept: 0, trail: Vec::new() };
    let walked = walker.elements(encoding, Some(end), 0);
    let (data, pixels) = walked.map_err(|defect| LocatedFault { trail: walker.trail, defect })?;
    Ok(ParsedDataSet { data, pixels })
}

/// Reads one element header, for loops that handle elements themselves (file meta, fragments).
///
/// # Errors
/// When fewer bytes are left than a header takes.
pub(super) fn read_header<R: BufRead + Seek>(
    source: &mut R,
    position: &mut u64,
    end: u64,
    encoding: Encoding,
) -> Result<Header, Defect> {
    let (keep, bounds, trail) = (|_| Retention::Nothing, Bounds::IMAGES, Vec::new());
    let mut walker = DataSetReader { source, position: *position, end, keep, bounds, kept: 0, trail };
    let header = walker.header(encoding)?;
    *position = walker.position;
    Ok(header)
}

struct DataSetReader<'a, R> {
    source: &'a mut R,
    position: u64,
    end: u64,
    keep: KeepOf,
    bounds: Bounds,
    /// Bytes of memory that kept elements and items take.
    kept: u64,
    /// The kept items around the position: an error leaves them.
    trail: Vec<(Tag, usize)>,
}

type Elements = (DataSet, Option<PixelElement>);

impl<R: BufRead + Seek> DataSetReader<'_, R> {
    /// Elements up to `bound`, to an item delimiter where there is no bound, or to Pixel Data at
    /// the top level.
    fn elements(&mut self, encoding: Encoding, bound: Option<u64>, depth: u32) -> Result<Elements, Defect> {
        let mut data = DataSet::default();
        while bound.is_none_or(|bound| self.position < bound) {
            if self.end - self.position < 8 && bound == Some(self.end) {
                break; // a few bytes of padding behind the last element
            }
            let header = self.header(encoding)?;
            if header.tag == ITEM_DELIMITATION {
                break;
            }
            if header.tag == tags::PIXEL_DATA && depth == 0 {
                let length = header.length.map(u64::from);
                return Ok((data, Some(PixelElement { position: self.position, length })));
            }
            self.element(header, encoding, depth, &mut data)?;
        }
        Ok((data, None))
    }

    fn element(
        &mut self,
        header: Header,
        encoding: Encoding,
        depth: u32,
        data: &mut DataSet,
    ) -> Result<(), Defect> {
        let inner = if &header.vr == b"UN" { Encoding::ImplicitLittle } else { encoding };
        match ((self.keep)(header.tag), header.length) {
            (Retention::Value, Some(length)) => {
                let bytes = self.value(header.tag, length)?;
                let big_endian = inner == Encoding::ExplicitBig;
                data.elements.push((header.tag, Value::Bytes { bytes, big_endian }));
            }
            (Retention::Items, length) => {
                self.charge(size_of::<(Tag, Value)>() as u64)?;
                let items = self.items(header.tag, inner, length, depth + 1)?;
                data.elements.push((header.tag, Value::Items(items)));
            }
            (_, Some(length)) => self.skip(header.tag, length)?,
            (_, None) => self.skip_undefined(inner)?,
        }
        Ok(())
    }

    fn items(
        &mut self,
        tag: Tag,
        encoding: Encoding,
        length: Option<u32>,
        depth: u32,
    ) -> Result<Vec<DataSet>, Defect> {
        if depth > self.bounds.deepest {
            return Err(Defect::Nesting { limit: self.bounds.deepest });
        }
        let bound = length.map(|length| self.position.saturating_add(length.into()).min(self.end));
        let mut items = Vec::new();
        while bound.is_none_or(|bound| self.position < bound) {
            let header = self.header(encoding)?;
            if header.tag != ITEM {
                if header.tag == SEQUENCE_DELIMITATION {
                    break;
                }
                return Err(Defect::NotAnItem { found: header.tag });
            }
            let bound = header.length.map(|length| self.position.saturating_add(length.into()).min(self.end));
            self.charge(size_of::<DataSet>() as u64)?;
            self.trail.push((tag, items.len() + 1));
            items.push(self.elements(encoding, bound, depth)?.0);
            self.trail.pop();
        }
        Ok(items)
    }

    /// Counts memory for a kept element or item.
    fn charge(&mut self, bytes: u64) -> Result<(), Defect> {
        self.kept = self.kept.saturating_add(bytes);
        let limit = self.bounds.kept_bytes;
        if self.kept > limit { Err(Defect::LargeDataSet { limit }) } else { Ok(()) }
    }

    /// Skips the rest of an element of undefined length: a loop, so that nesting costs no stack.
    fn skip_undefined(&mut self, outer: Encoding) -> Result<(), Defect> {
        let mut open = 1u64;
        // The number of open containers at which an unknown-VR sequence, implicit by PS3.5 6.2.2,
        // is left again.
        let mut implicit_until = None;
        while open > 0 {
            let encoding = if implicit_until.is_some() { Encoding::ImplicitLittle } else { outer };
            let header = self.header(encoding)?;
            match (header.tag, header.length) {
                (ITEM_DELIMITATION | SEQUENCE_DELIMITATION, _) => open -= 1,
                (tag, Some(length)) => self.skip(tag, length)?,
                (_, None) => {
                    if &header.vr == b"UN" && implicit_until.is_none() {
                        implicit_until = Some(open);
                    }
                    open += 1;
                }
            }
            if implicit_until.is_some_and(|level| open <= level) {
                implicit_until = None;
            }
        }
        Ok(())
    }

    fn header(&mut self, encoding: Encoding) -> Result<Header, Defect> {
        let [a, b, c, d, e, f, g, h] = self.take::<8>("an element header")?;
        let big = encoding == Encoding::ExplicitBig;
        let u16_of = |x, y| if big { u16::from_be_bytes([x, y]) } else { u16::from_le_bytes([x, y]) };
        let u32_of = |bytes| if big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) };
        let tag = Tag(u16_of(a, b), u16_of(c, d));
        let vr = [e, f];
        // Items and delimiters have no VR. Some writers leave single elements implicit in an
        // explicit data set.
        let implicit = encoding == Encoding::ImplicitLittle || tag.0 == 0xFFFE || !is_vr(vr);
        let length = if implicit {
            u32_of([e, f, g, h])
        } else if has_long_length(vr) {
            u32_of(self.take::<4>("an element length")?)
        } else {
            u16_of(g, h).into()
        };
        let vr = if implicit { [0; 2] } else { vr };
        Ok(Header { tag, vr, length: (length != UNDEFINED).then_some(length) })
    }

    fn value(&mut self, tag: Tag, length: u32) -> Result<Vec<u8>, Defect> {
        let longest = self.bounds.longest_value;
        let limit = if tag == tags::EXTENDED_OFFSET_TABLE { LONGEST_OFFSET_TABLE } else { longest };
        if length > limit {
            return Err(Defect::LongValue { tag, found: length, limit });
        }
        self.check_left(length.into(), tag)?;
        self.charge(size_of::<(Tag, Value)>() as u64 + u64::from(length))?;
        let mut bytes = vec![0; length as usize];
        self.source.read_exact(&mut bytes)?;
        self.position += u64::from(length);
        Ok(bytes)
    }

    fn skip(&mut self, tag: Tag, length: u32) -> Result<(), Defect> {
        self.check_left(length.into(), tag)?;
        self.source.seek_relative(length.into())?;
        self.position += u64::from(length);
        Ok(())
    }

    fn take<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], Defect> {
        let left = self.end.saturating_sub(self.position);
        if left < N as u64 {
            return Err(Defect::Cut { what, position: self.position, found: left, expected: N as u64 });
        }
        let mut bytes = [0; N];
        self.source.read_exact(&mut bytes)?;
        self.position += N as u64;
        Ok(bytes)
    }

    fn check_left(&self, expected: u64, tag: Tag) -> Result<(), Defect> {
        let found = self.end.saturating_sub(self.position);
        if found < expected { Err(Defect::Short { tag, found, expected }) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn keep_rows_and_shared_groups(tag: Tag) -> Retention {
        match tag {
            tags::ROWS => Retention::Value,
            tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE => Retention::Items,
            _ => Retention::Nothing,
        }
    }

    fn walked(bytes: &[u8], encoding: Encoding) -> Result<ParsedDataSet, Defect> {
        walk(&mut Cursor::new(bytes), 0..bytes.len() as u64, encoding, keep_rows_and_shared_groups)
    }

    const ROWS_EXPLICIT: [u8; 10] = [0x28, 0, 0x10, 0, b'U', b'S', 2, 0, 0, 2];
    const ROWS_IMPLICIT: [u8; 10] = [0x28, 0, 0x10, 0, 2, 0, 0, 0, 0, 2];
    const ROWS_BIG: [u8; 10] = [0, 0x28, 0, 0x10, b'U', b'S', 0, 2, 2, 0];

    #[test]
    fn the_three_encodings_give_the_same_value() {
        for (bytes, encoding) in [
            (ROWS_EXPLICIT, Encoding::ExplicitLittle),
            (ROWS_IMPLICIT, Encoding::ImplicitLittle),
            (ROWS_BIG, Encoding::ExplicitBig),
            (ROWS_IMPLICIT, Encoding::ExplicitLittle), // one stray implicit element
        ] {
            let data = walked(&bytes, encoding).unwrap().data;
            assert_eq!(data.unsigned(tags::ROWS), Ok(Some(512)), "{encoding:?}");
        }
    }

    #[test]
    fn a_hundred_thousand_nested_items_are_skipped_without_recursion() {
        let mut bytes = Vec::new();
        for _ in 0..100_000 {
            bytes.extend_from_slice(&[0x09, 0, 0x10, 0, 0xFF, 0xFF, 0xFF, 0xFF]); // private sequence, undefined
            bytes.extend_from_slice(&[0xFE, 0xFF, 0x00, 0xE0, 0xFF, 0xFF, 0xFF, 0xFF]); // item, undefined
        }
        assert!(matches!(walked(&bytes, Encoding::ImplicitLittle), Err(Defect::Cut { .. })));
        for _ in 0..100_000 {
            bytes.extend_from_slice(&[0xFE, 0xFF, 0x0D, 0xE0, 0, 0, 0, 0]);
            bytes.extend_from_slice(&[0xFE, 0xFF, 0xDD, 0xE0, 0, 0, 0, 0]);
        }
        bytes.extend_from_slice(&ROWS_IMPLICIT);
        let data = walked(&bytes, Encoding::ImplicitLittle).unwrap().data;
        assert_eq!(data.unsigned(tags::ROWS), Ok(Some(512)));
    }

    #[test]
    fn kept_sequences_nest_no_deeper_than_the_standard_does() {
        let mut bytes = Vec::new();
        for _ in 0..1000 {
            bytes.extend_from_slice(&[0x00, 0x52, 0x29, 0x92, 0xFF, 0xFF, 0xFF, 0xFF]); // shared groups in themselves
            bytes.extend_from_slice(&[0xFE, 0xFF, 0x00, 0xE0, 0xFF, 0xFF, 0xFF, 0xFF]);
        }
        assert!(matches!(walked(&bytes, Encoding::ImplicitLittle), Err(Defect::Nesting { limit: 4 })));
    }

    #[test]
    fn an_unknown_sequence_inside_an_explicit_data_set_is_implicit() {
        let mut bytes = vec![0x09, 0, 0x10, 0, b'U', b'N', 0, 0, 0xFF, 0xFF, 0xFF, 0xFF];
        bytes.extend_from_slice(&[0xFE, 0xFF, 0x00, 0xE0, 0xFF, 0xFF, 0xFF, 0xFF]);
        bytes.extend_from_slice(&[0x09, 0, 0x11, 0, b'U', b'S', 0, 0]); // implicit: a length of 21333, not a VR
        bytes.extend_from_slice(&vec![7; 0x5355]);
        bytes.extend_from_slice(&[0xFE, 0xFF, 0x0D, 0xE0, 0, 0, 0, 0, 0xFE, 0xFF, 0xDD, 0xE0, 0, 0, 0, 0]);
        bytes.extend_from_slice(&ROWS_EXPLICIT);
        let data = walked(&bytes, Encoding::ExplicitLittle).unwrap().data;
        assert_eq!(data.unsigned(tags::ROWS), Ok(Some(512)));
    }

    #[test]
    fn a_length_beyond_the_end_names_the_element_and_both_lengths() {
        let bytes = [0x28, 0, 0x10, 0, 0xF0, 0xFF, 0xFF, 0, 1, 2];
        let defect = walked(&bytes, Encoding::ImplicitLittle).unwrap_err();
        assert!(matches!(defect, Defect::LongValue { found: 0x00FF_FFF0, .. }), "{defect}");
        let bytes = [0x28, 0, 0x30, 0, 0xF0, 0xFF, 0xFF, 0, 1, 2];
        let defect = walked(&bytes, Encoding::ImplicitLittle).unwrap_err();
        assert_eq!(
            defect.to_string(),
            "element (0028,0030): found 2 bytes, expected 16777200 (the file is cut short)"
        );
    }
}
