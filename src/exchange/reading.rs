//! Parts that readers of all formats share: new items of a context, their checks, and warnings that
//! are counted.

use std::collections::{BTreeMap, HashMap, HashSet};

use serde_path_to_error::Segment;

use super::{ExchangeError, Format, Imported, ReadContext, SyntaxError, outside};
use relief_annotation::{ContentId, Edit, Geometry, Item, ItemId, Method, Placement, Timestamp};
use relief_base::{Patient, Point};

/// Largest file of text: a hundred thousand items with all they may have.
pub(super) const MOST_BYTES: usize = 64 << 20;
/// Most objects in a file of JSON: each takes memory when it is read, be it as short as `{}`.
const MOST_OBJECTS: usize = 1_000_000;

/// A file that is being read.
pub(super) struct Reading<'a> {
    pub(super) format: Format,
    pub(super) context: &'a ReadContext<'a>,
    items: Vec<Item>,
    ids: HashSet<ItemId>,
    pub(super) contents: Vec<(ContentId, String, Vec<u8>)>,
    /// Warnings by kind: the first place, and the count.
    warnings: BTreeMap<String, (String, usize)>,
    now: Timestamp,
}

impl<'a> Reading<'a> {
    pub(super) fn new(format: Format, context: &'a ReadContext<'a>) -> Self {
        Self {
            format,
            context,
            items: Vec::new(),
            ids: HashSet::new(),
            contents: Vec::new(),
            warnings: BTreeMap::new(),
            now: Timestamp::now(),
        }
    }

    /// An item of this context; without a geometry it is missing.
    pub(super) fn item(&self, name: &str, geometry: Option<Geometry>) -> Result<Item, ExchangeError> {
        let placement = Placement { method: Method::Import, device: None, camera: None, snapped_mm: None };
        Ok(Item {
            set: self.context.set.to_owned(),
            list: self.context.list.to_owned(),
            order: u32::try_from(self.items.len()).unwrap_or(u32::MAX),
            frame_of_reference: self.context.frame_of_reference.cloned(),
            created: self.now,
            placement: Some(placement),
            ..Item::new(name, self.context.author, geometry)?
        })
    }

    /// Takes an item that was read at a place of the file, if it is as items are.
    pub(super) fn push(&mut self, place: &str, item: Item) -> Result<(), ExchangeError> {
        if self.items.len() == Edit::MOST_CHANGES {
            let allowed = Edit::MOST_CHANGES as u64;
            return Err(ExchangeError::TooLarge {
                format: self.format,
                what: "items",
                found: allowed + 1,
                allowed,
            });
        }
        item.validate().map_err(|error| ExchangeError::item(self.format, place, error))?;
        if !self.ids.insert(item.id) {
            return Err(ExchangeError::value(self.format, format!("{place} (id)"), item.id, "each id once"));
        }
        self.items.push(item);
        Ok(())
    }

    pub(super) fn count(&self) -> usize {
        self.items.len()
    }

    /// Tells of something unusual; of the same thing, the first place and the number.
    pub(super) fn warn(&mut self, place: &str, what: &str) {
        self.warnings.entry(what.to_owned()).or_insert_with(|| (place.to_owned(), 0)).1 += 1;
    }

    pub(super) fn finish(mut self) -> Imported {
        let mut names = HashMap::new();
        for item in &self.items {
            *names.entry((&item.list, &item.name)).or_insert(0) += 1;
        }
        let twice = names.values().filter(|count| **count > 1).count();
        let mut warnings: Vec<String> = std::mem::take(&mut self.warnings)
            .into_iter()
            .map(|(what, (place, count))| match (place.is_empty(), count) {
                (true, _) => what,
                (false, 1) => format!("{place}: {what}"),
                (false, _) => format!("{place} and {} more: {what}", count - 1),
            })
            .collect();
        if twice > 0 {
            warnings.push(format!("{twice} names are there more than once in a list"));
        }
        warnings.extend(self.context.grid.and_then(|grid| outside::warning(&self.items, grid)));
        Imported { items: self.items, contents: self.contents, warnings }
    }
}

/// The text of a file, without a byte order mark.
pub(super) fn text(format: Format, bytes: &[u8]) -> Result<&str, ExchangeError> {
    if bytes.len() > MOST_BYTES {
        let (found, allowed) = (bytes.len() as u64, MOST_BYTES as u64);
        return Err(ExchangeError::TooLarge { format, what: "bytes", found, allowed });
    }
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        ExchangeError::Syntax { format, place: format!("line {line}"), source: SyntaxError::Utf8 }
    })?;
    Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
}

/// Reads JSON; an error has the path of the fault.
pub(super) fn json<'t, T: serde::Deserialize<'t>>(format: Format, text: &'t str) -> Result<T, ExchangeError> {
    json_hiding(format, text, 0)
}

/// The same, with the first `hidden` keys of a path masked, where keys are UIDs that identify a
/// patient.
pub(super) fn json_hiding<'t, T: serde::Deserialize<'t>>(
    format: Format,
    text: &'t str,
    hidden: usize,
) -> Result<T, ExchangeError> {
    let objects = text.bytes().filter(|byte| *byte == b'{').count();
    if objects > MOST_OBJECTS {
        let (found, allowed) = (objects as u64, MOST_OBJECTS as u64);
        return Err(ExchangeError::TooLarge { format, what: "objects", found, allowed });
    }
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let read: T = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let segments = error.path().iter();
        let place: String = segments
            .enumerate()
            .map(|(n, segment)| match segment {
                _ if n < hidden => "...".to_owned(),
                Segment::Seq { index } => format!("[{index}]"),
                segment if n == 0 => segment.to_string(),
                segment => format!(".{segment}"),
            })
            .collect();
        let place = if place.is_empty() { "the file".to_owned() } else { place };
        ExchangeError::Syntax { format, place, source: error.into_inner().into() }
    })?;
    deserializer.end().map_err(|error| ExchangeError::Syntax {
        format,
        place: "the file".to_owned(),
        source: error.into(),
    })?;
    Ok(read)
}

/// LPS from RAS, or RAS from LPS: the axes to the left and to the back turn round. Never makes a
/// negative zero.
pub(super) fn mirrored([x, y, z]: [f64; 3]) -> [f64; 3] {
    [0.0 - x, 0.0 - y, z + 0.0]
}

pub(super) fn point([x, y, z]: [f64; 3]) -> Point<Patient> {
    Point::new(x, y, z)
}
